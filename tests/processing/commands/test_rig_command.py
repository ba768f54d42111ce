"""``daylit rig calibrate`` on small simulated rig sessions."""

from __future__ import annotations

import io
import json
import math
import re
import shutil
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import daylit
from benchmarks.photometry.rig import DENSE_STOPS_S
from benchmarks.sessions import BODIES, Taken, write_session
from mocks.optics.camera import ND3_TINT, Filter
from mocks.optics.lenses import EquirectangularLens
from mocks.worlds.light import UniformWorld, unit
from mocks.worlds.simple_room import SimpleRoom
from processing.calibration.profile import RigProfile, load_profile
from processing.calibration.profile_records import ShutterRecord
from processing.calibration.scale.chart import ChartView
from processing.calibration.scale.chart_patches import FoundChart, reflectances
from processing.calibration.scale.vignetting import COPY_SIGMA
from processing.commands import rig as rig_command
from processing.errors import LensError, ParameterError
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.pictures.modes import modes_of
from processing.rig import calibrate, camera_fit
from processing.rig.calibrate import RigResult, one_colour
from processing.rig.camera_fit import CameraFit, outdoor_lens, read_side
from processing.sphere import Equirectangular, LensMapping
from station.session.session import Side
from tests.processing.commands.rigs import SMALL, without_raw


@pytest.fixture(scope="module")
def sessions(raw_rig: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of JPEGs alone: what is made of them is made once, for the files of raw frames, too."""
    folder = tmp_path_factory.mktemp("rig")
    for name in ("chart", "room", "plain"):
        without_raw(raw_rig / name, folder / name, *Side)
    return folder


@dataclass(frozen=True)
class LampWorld(UniformWorld):
    """A dark room, twice as bright ahead, with a lamp of 3 degrees; or the lamp hidden by a black card."""

    ahead: tuple[float, float, float] = (0.3, 0.9, 0.3)
    hidden: bool = False

    def radiance(self, site, directions, pixel_rad=0.0, component=None):  # type: ignore[no-untyped-def]
        cosine = directions @ np.array(unit(self.ahead), np.float32)
        light = 0.5 * (1.5 + 0.5 * directions[..., 1])
        light = np.where(cosine > math.cos(math.radians(6)), 0.01 if self.hidden else light, light)
        if not self.hidden:
            light = np.where(cosine > math.cos(math.radians(1.5)), 40_000.0, light)
        return np.repeat(light[..., None], 3, axis=-1).astype(np.float32)


@dataclass(frozen=True)
class Calibrated:
    """What the command made of chart, room, ND pair and lamps, and said as JSON and in lines."""

    profile: RigProfile
    path: Path
    answer: dict[str, Any]
    lines: list[str]


@pytest.fixture(scope="module")
def calibrated(sessions: Path) -> Calibrated:
    results, out = [], sessions / "lab.json"
    pair = [sessions / "lamp", sessions / "lamp-hidden"]
    for path in pair:
        write_session(path, Taken(LampWorld(hidden=path.name.endswith("hidden")), SMALL, (Side.INDOOR,)))
    lamps = ["--lamp", *map(str, pair)]
    chart, room, plain = (str(sessions / name) for name in ("chart", "room", "plain"))
    asked = ["rig", "calibrate", chart, room, "--nd", chart, plain, "--lens-data", "theta_z1", *lamps]
    work, said = calibrate.calibrate_rig, io.StringIO()

    def kept(*given: Any) -> RigResult:
        results.append(work(*given))
        return results[-1]

    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said):
        patch.setattr(calibrate, "calibrate_rig", kept)
        code = daylit.main([*asked, "--into", str(out), "--json"])
    answer = json.loads(said.getvalue())
    assert code == 0, answer
    return Calibrated(load_profile(out), out, answer, rig_command._lines(results[0]))


def test_profile_with_k2_and_pictures(calibrated: Calibrated) -> None:
    profile, answer = calibrated.profile, calibrated.answer
    assert profile.k2 is not None
    assert profile.k2.n_patches >= 5
    assert abs(profile.k2.value / profile.k2.white_ratio - 1) < 0.05
    assert set(profile.k2.corrections) == {"panorama", "nd"}
    outdoor = profile.cameras[Side.OUTDOOR]
    assert outdoor.nd is not None
    assert outdoor.nd.density == pytest.approx(3.0, abs=0.03)
    assert outdoor.lens is not None
    assert outdoor.lens.radius == pytest.approx(2 * 8 / 36 * 0.5**0.5, rel=0.01)
    assert (outdoor.lens.mapping, outdoor.lens.source.partition(";")[0]) == ("equisolid", "equisolid")
    assert all(camera.shutter.rule == "thirds" for camera in profile.cameras.values())
    for side, camera in profile.cameras.items():
        assert camera.response is not None
        assert len(camera.response.held_out) == len(camera.response.prior_strength) == 3
        assert f"patches left out: {camera.response.held_out[0] ** 0.5:.2f}/" in answer["cameras"][side]["response_fit"]
    assert profile.cameras[Side.INDOOR].vignetting.relative_uncertainty == COPY_SIGMA
    assert [Path(p).read_bytes()[:4] for p in answer["pictures"]] == [b"\x89PNG"] * 2


def test_a_chart_that_is_dark_through_the_filter_is_warned_of(sessions: Path, tmp_path: Path) -> None:
    chart = tmp_path / "chart"
    shutil.copytree(sessions / "chart", chart)
    manifest = json.loads((chart / "session.json").read_text())
    manifest["frames"] = [f for f in manifest["frames"] if f["side"] == "indoor" or f["asked_s"] <= 4]
    (chart / "session.json").write_text(json.dumps(manifest))
    varied = (sessions / "room", sessions / "plain")
    dark, bright = (
        calibrate.calibrate_rig(calibrate.RigRequest(path, sessions=varied), datetime.now(UTC)).profile.warnings
        for path in (chart, sessions / "chart")
    )
    assert any("too little of a channel" in text for text in dark)
    assert not any("too little of a channel" in text for text in bright)


def test_the_lens_of_a_camera_that_nobody_knows_is_assumed_as_everywhere(sessions: Path) -> None:
    side = read_side(sessions / "chart", Side.OUTDOOR)
    assert side is not None
    assert side.device is not None
    assert outdoor_lens(side, math.pi / 2).mapping is LensMapping.EQUISOLID
    lens = outdoor_lens(replace(side, device=side.device.model_copy(update={"kind": "imported"})), math.pi / 2)
    assert lens.mapping is LensMapping.EQUIDISTANT
    assert lens.source.startswith("equidistant (assumed)")


def test_a_chart_of_one_camera_gives_no_k2_and_says_so(sessions: Path) -> None:
    profile = calibrate.calibrate_rig(calibrate.RigRequest(sessions / "plain"), datetime.now(UTC)).profile
    assert profile.k2 is None
    assert "no k2: the chart session has frames of the outdoor camera only" in profile.warnings
    asked = calibrate.RigRequest(sessions / "plain", corners={Side.INDOOR: (1, 1, 2, 1, 2, 2, 1, 2)})
    with pytest.raises(ParameterError, match="no frames of the indoor camera"):
        calibrate.calibrate_rig(asked, datetime.now(UTC))


def test_lens_data_that_nobody_has_published_are_refused_before_the_work(sessions: Path) -> None:
    asked, said = calibrate.RigRequest(sessions / "plain", lens_data=("theta_z2",)), list[str]()
    with pytest.raises(LensError, match="theta_z2"):
        calibrate.calibrate_rig(asked, datetime.now(UTC), said.append)
    assert not any("shutter times" in text for text in said)


def test_lamps_in_the_dark_show_stray_light_that_a_session_loses(
    sessions: Path, calibrated: Calibrated, tmp_path: Path
) -> None:
    out, said = calibrated.path, "\n".join(calibrated.lines)
    assert "stray light: 0." in said
    assert re.search(r"patches left out: ([0-9.]+/){2}[0-9.]+ standard deviations; prior \(amplitude .*\): [0-9]", said)
    cameras = calibrated.profile.cameras
    assert cameras[Side.OUTDOOR].glare is None
    found = cameras[Side.INDOOR].glare
    assert found is not None
    assert found.two_lenses
    # The simulated lens scatters 0.5 % evenly.
    assert found.index == pytest.approx(0.005, rel=0.3)
    session = shutil.copytree(sessions / "room", tmp_path / "room")
    for glare in ("auto", "keep"):
        words = ["--calibration", str(out), "--k1", "1", "--glare", glare]
        assert daylit.main(["process", str(session), "--until", "calibrate", *words]) in (0, None)
        facts = json.loads((session / "stages/calibrate/calibration.json").read_text())["indoor"]
        assert ("veil" in facts) == (glare == "auto")
        picture = read_exr(session / "stages/calibrate/indoor.exr")
        assert isinstance(picture, LuminanceImage)
        named = any(mode.name.startswith("stray light, measured") for mode in modes_of(picture))
        assert named == (glare == "auto")


def test_lamps_at_several_places_are_fitted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each for itself first, so that one that shows nothing spoils nothing."""
    fitted = list[int]()

    def fit(pairs: Any, *, two_lenses: bool) -> str:
        fitted.append(len(pairs))
        assert two_lenses
        if pairs[0][0] == "dark":
            raise LensError("both pictures show the same")
        return f"of {len(pairs)}"

    monkeypatch.setattr(camera_fit, "kernel_from_lamps", fit)
    monkeypatch.setattr(CameraFit, "merged", lambda _camera, taken: taken.path.name)
    camera = CameraFit(Side.INDOOR, None, ShutterRecord())  # type: ignore[arg-type]
    pairs: Any = [[SimpleNamespace(path=Path(name))] * 2 for name in ("near", "dark", "far")]
    found = camera_fit.with_lamps(camera, pairs)
    assert (found.glare, fitted) == ("of 2", [1, 1, 1, 2])
    assert ["dark is not used" in text for text in found.warnings] == [True]


def test_charts_with_and_without_the_filter_that_are_swapped_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    light, doubt = reflectances(), np.full(24, 0.01)
    shown = {"with": (light / 1000, doubt), "without": (light, doubt)}
    monkeypatch.setattr(camera_fit, "_patches", lambda _camera, taken: shown[taken.path.name])
    camera = CameraFit(Side.OUTDOOR, None, ShutterRecord())  # type: ignore[arg-type]
    dim, full = (SimpleNamespace(path=Path(name)) for name in shown)
    found = camera_fit.with_filter(camera, dim, full).filter  # type: ignore[arg-type]
    assert found is not None
    assert found.density == pytest.approx(3)
    for given in ((full, dim), (full, full)):
        with pytest.raises(ParameterError) as refused:
            camera_fit.with_filter(camera, *given)  # type: ignore[arg-type]
        assert "swapped" in str(refused.value.likely)


def test_a_lamp_that_a_camera_does_not_see_is_a_warning(sessions: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = sessions / "room"
    taken = read_side(room, Side.INDOOR)
    assert taken is not None
    shape = (24, 48)
    dark = RelativeImage(
        np.ones((*shape, 3), np.float32), np.ones(shape, np.float32), np.zeros(shape, np.uint8), Equirectangular(48, 24)
    )
    camera = CameraFit(Side.INDOOR, None, ShutterRecord())  # type: ignore[arg-type]
    monkeypatch.setattr(CameraFit, "merged", lambda _camera, _taken: dark)
    monkeypatch.setattr(calibrate, "fit_camera", lambda *_: camera)
    found = calibrate._camera(calibrate.RigRequest(room, lamps=((room, room),)), Side.INDOOR, taken)
    assert found.glare is None
    assert found.warnings[0].startswith("indoor: room is not used for stray light: both pictures show the same lamps")
    assert "a darker room" in found.warnings[0]


def test_one_chart_in_both_cameras_undoes_the_filters_colour() -> None:
    seen = reflectances() * (0.9, 1.0, 1.1)
    indoor = FoundChart(np.zeros((4, 2)), seen, np.full(24, 0.01), np.full(24, 99), 0.0, "corners")
    outdoor = replace(indoor, rgb=Filter(3.0, ND3_TINT).apply(seen.astype(np.float32)).astype(np.float64))
    picture = RelativeImage(
        np.ones((2, 4, 3), np.float32), np.ones((2, 4), np.float32), np.zeros((2, 4), np.uint8), Equirectangular(4, 2)
    )
    found, view = one_colour(indoor, ChartView(picture, outdoor), np.full(24, 0.01))
    zenith = np.array([[0.6, 0.9, 1.7]], np.float32)
    shown = found.correct(Filter(3.0, ND3_TINT).apply(zenith))
    np.testing.assert_allclose(shown[0, ::2] / shown[0, 1], zenith[0, ::2] / zenith[0, 1], rtol=1e-3)
    np.testing.assert_allclose(view.chart.rgb / view.chart.rgb[18, 1], seen / seen[18, 1], atol=1e-4)
    assert found.density == 0


def test_the_panoramas_falloff_is_measured_by_turning_the_camera(sessions: Path, tmp_path: Path) -> None:
    body = BODIES[Side.INDOOR]
    aside = replace(body, optics=replace(body.optics, lens=EquirectangularLens(yaw_rad=1.4)))
    taken = Taken(SimpleRoom(3), SMALL, (Side.INDOOR,), stops_s=DENSE_STOPS_S, bodies={Side.INDOOR: aside})
    turned = (sessions / "room", write_session(tmp_path / "turned", taken))
    request = calibrate.RigRequest(sessions / "chart", (turned[0],), turned=turned, lens_data=("theta_z1",))
    chart = read_side(request.chart, Side.INDOOR)
    assert chart is not None
    found = calibrate._camera(request, Side.INDOOR, chart).vignetting
    assert found is not None
    assert found.source.endswith("the camera turned")
    angle = math.radians(84)  # from a lens's axis, where the published fall-off of another copy is 1.2 % off
    true = math.cos(0.21 * angle) * (1 - 0.08 * (angle - 0.9) ** 2)
    assert float(found.evaluate(math.sqrt(1 - math.cos(angle)))) == pytest.approx(true, rel=0.003)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--corners", "outdoor:1,2,3"], "four corners"),
        (["--corners", "upstairs:1,2,3,4,5,6,7,8"], "upstairs"),
        (["--shutter", "indoor:fifths"], "fifths"),
        (["--corners", "indoor:1,1,2,1,2,2,1,2"], "pixels per patch of the chart"),
        (["--corners", "indoor:1,1,2000,1,2000,40,1,40"], "outside the frame"),
        (["--nd", "plain", "plain"], "given twice"),
        (["--flat", "room"], "outdoor camera"),
        (["--turned", "room", "--turned", "plain"], "indoor camera in 2 or more"),
        (["--lamp", "room", "plain"], "took both"),
    ],
)
def test_what_cannot_be_is_refused(
    sessions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], named: str
) -> None:
    out = tmp_path / "lab.json"
    words = [str(sessions / word) if word in ("chart", "plain", "room") else word for word in words]
    taken = [str(sessions / name) for name in ("chart", "room")]
    assert daylit.main(["rig", "calibrate", *taken, "--into", str(out), *words]) in (2, 5)
    assert named in capsys.readouterr().err
    assert not out.exists()


def test_a_folder_that_is_not_there_is_refused_before_the_work(
    sessions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrate, "calibrate_rig", None)
    out = str(tmp_path / "nowhere" / "lab.json")
    assert daylit.main(["rig", "calibrate", str(sessions / "chart"), "--into", out]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_no_session_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["rig", "calibrate", str(tmp_path), "--into", str(tmp_path / "x.json")]) == 4
    assert "session.json" in capsys.readouterr().err
