"""``daylit rig calibrate`` on small simulated rig sessions."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import daylit
from benchmarks.photometry.rig import CHART_STOPS_S, DENSE_STOPS_S
from benchmarks.sessions import Taken, write_session
from mocks.optics.chart import ChartRoom
from mocks.worlds.simple_room import SimpleRoom
from processing.calibration.profile import load_profile
from station.session.session import Side

SMALL = 16


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    write_session(folder / "chart", Taken(ChartRoom(0), SMALL, stops_s=CHART_STOPS_S))
    write_session(folder / "room", Taken(SimpleRoom(3), SMALL, (Side.INDOOR,), stops_s=DENSE_STOPS_S))
    write_session(folder / "plain", Taken(ChartRoom(0), SMALL, (Side.OUTDOOR,), nd=False, stops_s=DENSE_STOPS_S))
    return folder


def test_profile_with_k2_and_pictures(sessions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "lab.json"
    chart, room, plain = (str(sessions / name) for name in ("chart", "room", "plain"))
    code = daylit.main(
        ["rig", "calibrate", chart, room, "--nd", chart, plain, "--lens-data", "theta_z1", "--into", str(out), "--json"]
    )
    answer = json.loads(capsys.readouterr().out)
    assert code == 0, answer
    profile = load_profile(out)
    assert profile.k2 is not None
    assert profile.k2.n_patches >= 5
    assert abs(profile.k2.value / profile.k2.white_ratio - 1) < 0.05
    assert set(profile.k2.corrections) == {"panorama", "nd"}
    outdoor = profile.cameras[Side.OUTDOOR]
    assert outdoor.nd is not None
    assert outdoor.nd.density == pytest.approx(3.0, abs=0.03)
    assert outdoor.lens is not None
    assert outdoor.lens.radius == pytest.approx(2 * 8 / 36 * 0.5**0.5, rel=0.01)
    assert all(camera.shutter.rule == "thirds" for camera in profile.cameras.values())
    assert [Path(p).read_bytes()[:4] for p in answer["pictures"]] == [b"\x89PNG"] * 2


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--corners", "outdoor:1,2,3"], "four corners"),
        (["--corners", "upstairs:1,2,3,4,5,6,7,8"], "upstairs"),
        (["--shutter", "indoor:fifths"], "fifths"),
        (["--corners", "indoor:1,1,2,1,2,2,1,2"], "chart"),
    ],
)
def test_what_cannot_be_is_refused(
    sessions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], named: str
) -> None:
    out = tmp_path / "lab.json"
    code = daylit.main(
        ["rig", "calibrate", str(sessions / "chart"), str(sessions / "room"), "--into", str(out), *words]
    )
    assert code in (2, 5)
    assert named in capsys.readouterr().err
    assert not out.exists()


def test_no_session_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["rig", "calibrate", str(tmp_path), "--into", str(tmp_path / "x.json")]) == 4
    assert "session.json" in capsys.readouterr().err
