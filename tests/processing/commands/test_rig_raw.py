"""``daylit rig calibrate`` on sessions with raw files, and what `daylit process` makes of its profile."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import daylit
from benchmarks.sessions import Taken, write_session
from mocks.worlds.light import Site, UniformWorld, luminance_cd_m2
from processing.calibration.profile import RigProfile, load_profile, save_profile
from station.session.session import Side
from tests.processing.commands.rigs import INDOOR, OUTDOOR, RAW, SMALL, UnderTheSky, without_raw

SMALLER = 16
"""Of the frames' size: the session's; the rig's are `SMALL`."""
OFF = {"linear": 0.02, "profile": 0.05}
"""Of the sky's illuminance, by frames; 1.0 and 1.9 % are found, and with the other frames' k2 it would be 50 %."""


def sky_lux() -> float:
    z, around = np.meshgrid((np.arange(200) + 0.5) / 200, np.linspace(0, 2 * np.pi, 400, endpoint=False), indexing="ij")
    flat = np.sqrt(1 - z**2)
    rays = np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=-1).astype(np.float32)
    return float(2 * np.pi * np.mean(luminance_cd_m2(UnderTheSky().radiance(Site.OUTDOOR, rays)) * z))


@pytest.fixture(scope="module")
def rig(raw_rig: Path) -> Path:
    write_session(raw_rig / "flat", Taken(UniformWorld(20_000.0), SMALL, (OUTDOOR,), raw=RAW))
    write_session(raw_rig / "session", Taken(UnderTheSky(), SMALLER, raw=RAW, seed=1))
    return raw_rig


def calibrated(rig: Path, chart: str, into: str) -> RigProfile:
    words = [*(str(rig / name) for name in (chart, "room")), "--nd", str(rig / chart), str(rig / "plain")]
    words += ["--flat", str(rig / "flat"), "--lens-data", "theta_z1", "--into", str(rig / into)]
    assert daylit.main(["rig", "calibrate", *words]) == 0
    return load_profile(rig / into)


@pytest.fixture(scope="module")
def profile(rig: Path) -> RigProfile:
    return calibrated(rig, "chart", "lab.json")


def processed(at: Path, profile: Path, frames: str = "auto") -> tuple[dict, dict]:
    """Return the results of merge and calibrate."""
    words = ["--until", "calibrate", "--calibration", str(profile), "--frames", frames]
    assert daylit.main(["process", str(at), *words]) in (0, None)
    merge, calibrate = (json.loads((at / "stages" / s / "result.json").read_text()) for s in ("merge", "calibrate"))
    return merge, calibrate


def sources(merge: dict) -> dict[str, str]:
    return {side: found["response_source"] for side, found in merge["metrics"].items()}


def test_raw_files_of_rig_and_session_are_used_and_right(rig: Path, profile: RigProfile) -> None:
    part = profile.raw
    assert part is not None
    assert profile.k2 is not None
    assert part.k2 is not None
    assert (profile.frames, part.frames) == (dict.fromkeys(Side, "jpeg"), dict.fromkeys(Side, "raw"))
    assert part.k2.value / profile.k2.value == pytest.approx(1.5, rel=0.03)
    jpegs, raws = profile.cameras[OUTDOOR], part.cameras[OUTDOOR]
    assert raws.response is None
    assert raws.nd is not None
    assert raws.nd.density == pytest.approx(3.0, abs=0.03)
    assert raws.vignetting not in (None, jpegs.vignetting)
    for frames, source in (("auto", "linear"), ("jpeg", "profile")):
        merge, found = processed(rig / "session", rig / "lab.json", frames)
        assert sources(merge) == {"indoor": source, "outdoor": source}
        assert not any("raw" in name for name in merge["left_out"])
        assert found["metrics"]["outdoor_lux"] == pytest.approx(sky_lux(), rel=OFF[source])
        assert not any("k2" in warning["message"] for warning in found["warnings"])


def test_a_profile_of_jpegs_keeps_to_them_and_says_why(rig: Path, profile: RigProfile) -> None:
    """Also one from before profiles said what they hold for."""
    old = json.loads(profile.model_dump_json(exclude={"raw", "frames"}))
    (rig / "old.json").write_text(json.dumps(old))
    merge, found = processed(rig / "session", rig / "old.json")
    assert sources(merge) == {"indoor": "profile", "outdoor": "profile"}
    assert all("holds for this camera's JPEGs only" in merge["left_out"][f"{side} raw files"] for side in Side)
    assert found["metrics"]["outdoor_lux"] == pytest.approx(sky_lux(), rel=OFF["profile"])
    merge, found = processed(rig / "session", rig / "old.json", "raw")
    assert sources(merge) == {"indoor": "linear", "outdoor": "linear"}
    assert any("k2 may not hold" in warning["message"] for warning in found["warnings"])


def test_a_session_with_raw_files_of_one_camera_is_merged_from_both_cameras_jpegs(
    rig: Path, profile: RigProfile, tmp_path: Path
) -> None:
    assert profile.raw is not None
    at = without_raw(rig / "session", tmp_path / "session", OUTDOOR)
    merge, found = processed(at, rig / "lab.json")
    assert sources(merge) == {"indoor": "profile", "outdoor": "profile"}
    assert "0 raw files beside 9 pictures" in merge["left_out"]["indoor raw files"]
    assert found["metrics"]["outdoor_lux"] == pytest.approx(sky_lux(), rel=OFF["profile"])


def test_a_raw_file_that_breaks_leaves_both_cameras_jpegs(rig: Path, profile: RigProfile, tmp_path: Path) -> None:
    assert profile.raw is not None
    at = tmp_path / "session"
    shutil.copytree(rig / "session", at, ignore=shutil.ignore_patterns("stages"))
    manifest = json.loads((at / "session.json").read_text())
    [broken] = [f for f in manifest["frames"] if f["file"] == "outdoor/04.dng"]
    broken["size_bytes"] = 3000
    (at / "outdoor/04.dng").write_bytes(data := (at / "outdoor/04.dng").read_bytes()[:3000])
    broken["sha256"] = hashlib.sha256(data).hexdigest()
    (at / "session.json").write_text(json.dumps(manifest))
    merge, found = processed(at, rig / "lab.json")
    assert sources(merge) == {"indoor": "profile", "outdoor": "profile"}
    assert "outdoor/04.dng" in merge["left_out"]["indoor raw files"]
    assert found["metrics"]["outdoor_lux"] == pytest.approx(sky_lux(), rel=OFF["profile"])


def test_a_rig_with_raw_files_of_one_camera_holds_for_just_that_pair(rig: Path, tmp_path: Path) -> None:
    without_raw(rig / "chart", rig / "chart-mixed", OUTDOOR)
    mixed = calibrated(rig, "chart-mixed", "mixed.json")
    assert mixed.raw is not None
    assert mixed.raw.frames == {INDOOR: "raw", OUTDOOR: "jpeg"}
    merge, found = processed(rig / "session", rig / "mixed.json")
    assert sources(merge) == {"indoor": "linear", "outdoor": "profile"}
    assert "JPEGs only" in merge["left_out"]["outdoor raw files"]
    assert "indoor raw files" not in merge["left_out"]
    assert found["metrics"]["outdoor_lux"] == pytest.approx(sky_lux(), rel=OFF["linear"])
    assert not any("k2" in warning["message"] for warning in found["warnings"])


def test_raw_files_that_cannot_be_used_leave_a_profile_of_jpegs_and_a_warning(
    rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chart = tmp_path / "chart"
    shutil.copytree(rig / "chart", chart)
    (chart / "outdoor/03.dng").write_bytes(b"no raw file")
    words = [
        "rig",
        "calibrate",
        str(chart),
        str(rig / "room"),
        str(rig / "plain"),
        "--into",
        str(tmp_path / "lab.json"),
    ]
    assert daylit.main(words) == 0
    assert "the profile covers JPEGs only" in (said := capsys.readouterr().out)
    assert "chart/outdoor/03.dng" in said
    assert load_profile(tmp_path / "lab.json").raw is None


def test_a_profile_with_its_raw_part_is_read_as_written(rig: Path, profile: RigProfile) -> None:
    save_profile(rig / "again.json", profile)
    assert load_profile(rig / "again.json") == profile
    assert profile.of({INDOOR: True, OUTDOOR: True}) is profile.raw
    assert profile.of({INDOOR: True}) is profile.raw
    for other in ({}, {INDOOR: False}, {INDOOR: True, OUTDOOR: False}):
        assert profile.of(other) is profile
