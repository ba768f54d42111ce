"""The stages verify and merge on small sessions with a known truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR, SyntheticBracket, expose, synthetic_bracket
from mocks.optics.sensor import ToneCurve
from processing.calibration.profile import CameraProfile, CameraState, RigProfile, save_profile
from processing.calibration.profile_records import NoiseRecord, ResponseRecord, ShutterRecord
from processing.calibration.response.prior import AMPLITUDES, LOG_STRENGTHS
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.errors import BracketError, ProcessingError
from processing.pictures.exr import read_exr
from processing.pictures.images import RelativeImage, luminance_cd_m2
from processing.pipeline import STAGES
from processing.running.requests import RunRequest
from processing.running.results import Action, RunReport
from processing.running.runner import process
from processing.sphere import Equirectangular, Fisheye
from station.errors import IntegrityError
from station.session.session import Side
from tests.processing.stages.sessions import bracket_session

SIZE = (384, 192)
TWO = tuple(stage for stage in STAGES if stage.name in ("verify", "merge"))


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_STATE", str(tmp_path / "state"))


@pytest.fixture(scope="module")
def truth() -> SyntheticBracket:
    return synthetic_bracket(SIZE, 11)


@pytest.fixture(scope="module")
def session(truth: SyntheticBracket, tmp_path_factory: pytest.TempPathFactory) -> Path:
    sides: dict[Side, Any] = {Side.INDOOR: truth.frames, Side.OUTDOOR: truth.frames}
    return bracket_session(tmp_path_factory.mktemp("sessions"), sides, truth.nominal_s)


def run(session: Path, **request: Any) -> RunReport:
    return process(session, RunRequest(**{"until": "merge", **request}), stages=TWO)


def warnings(report: RunReport) -> list[str]:
    return [warning["code"] for warning in report.stages[-1].summary["warnings"]]


def stops_off(image: RelativeImage, truth: SyntheticBracket) -> npt.NDArray[Any]:
    """Difference from the truth in stops, free of the scale, where pixels are valid."""
    good = (image.validity == 0) & (truth.luminance > 0.1)
    off = np.log2(luminance_cd_m2(image.rgb)[good]) - np.log2(truth.luminance[good])
    return off - np.median(off)


def picture(session: Path, side: str) -> RelativeImage:
    found = read_exr(session / "stages" / "merge" / f"{side}.exr")
    assert isinstance(found, RelativeImage)
    return found


def test_both_sides_are_merged_and_then_skipped(session: Path, truth: SyntheticBracket) -> None:
    report = run(session)
    assert [s.action for s in report.stages] == [Action.RAN, Action.RAN]
    for side, geometry in (("indoor", Equirectangular), ("outdoor", Fisheye)):
        image = picture(session, side)
        assert isinstance(image.geometry, geometry)
        assert image.attributes["side"] == side
        assert np.median(np.abs(stops_off(image, truth))) < 0.04
    result = json.loads((session / "stages" / "merge" / "response.json").read_text())
    assert result["indoor"]["source"] == "recovered"
    assert result["indoor"]["times_source"] == "estimated"
    assert [t["nominal_s"] for t in result["indoor"]["times"]] == list(truth.nominal_s)
    curve = result["indoor"]["curve"]
    assert len(curve["log2_exposure"][0]) == 256
    # How the fit was judged, and what prior it chose: of patches left out (chi-squared), of amplitude and stiffness.
    assert all(0.3 < chi2 < 3 for chi2 in curve["held_out"]), curve["held_out"]
    assert len(curve["held_out"]) == len(curve["prior_strength"]) == 3
    assert all(a in AMPLITUDES and s in LOG_STRENGTHS for a, s in curve["prior_strength"])
    assert "modes" not in curve
    metrics = report.stages[-1].summary["metrics"]["indoor"]
    assert len(metrics["frames"]) == 9
    assert "quality" in report.stages[-1].summary["honoured"]
    again = run(session)
    assert [s.action for s in again.stages] == [Action.SKIPPED, Action.SKIPPED]


@pytest.mark.long
@pytest.mark.usefixtures("anew")
def test_the_same_session_gives_the_same_bytes(session: Path) -> None:
    run(session, options={"--side": "indoor"})
    folder = session / "stages" / "merge"
    names = ("indoor.exr", "response.json", "result.json")
    before = {name: (folder / name).read_bytes() for name in names}
    again = run(session, force=("merge",), options={"--side": "indoor"})
    assert [s.action for s in again.stages] == [Action.SKIPPED, Action.RAN]
    assert {name: (folder / name).read_bytes() for name in names} == before


def test_one_side_on_request_and_max_error_are_reported(session: Path) -> None:
    report = run(session, options={"--side": "indoor"}, max_error=0.05)
    summary = report.stages[-1].summary
    assert summary["left_out"]["outdoor"] == "only indoor was asked for"
    assert "5 %" in summary["honoured"]["max_error"]
    assert not (session / "stages" / "merge" / "outdoor.exr").exists()


def test_a_picture_of_another_bracket_is_named_by_its_file(truth: SyntheticBracket, tmp_path: Path) -> None:
    frames = [frame[:, ::-1] if k == 4 else frame for k, frame in enumerate(truth.frames)]
    mixed = bracket_session(tmp_path, {Side.INDOOR: frames}, truth.nominal_s)
    with pytest.raises(BracketError, match="another view than the frames before and after it") as caught:
        run(mixed)
    assert caught.value.where.startswith("indoor/04_")


def profile(path: Path, truth: SyntheticBracket, change: Callable[[RigProfile], RigProfile] = lambda p: p) -> Path:
    fit = recover_response([Bracket8(truth.frames, truth.true_s)])
    when = datetime(2023, 5, 19, tzinfo=UTC)
    camera = CameraProfile(
        side=Side.INDOOR,
        state=CameraState(f_number=5.6, iso=100),
        created_utc=when,
        response=ResponseRecord.of(fit.curve),
        noise=NoiseRecord.of(fit.noise),
        shutter=ShutterRecord(rule="nominal"),
    )
    save_profile(path, change(RigProfile(created_utc=when, cameras={Side.INDOOR: camera})))
    return path


def test_a_profile_gives_curve_and_times_and_is_checked(session: Path, truth: SyntheticBracket, tmp_path: Path) -> None:
    file = profile(tmp_path / "calibration.json", truth)
    report = run(session, options={"--calibration": file, "--side": "indoor"})
    assert "files calibration" in {path for path, _, _ in report.stages[-1].changes}
    metrics = report.stages[-1].summary["metrics"]["indoor"]
    assert metrics["response_source"] == metrics["times_source"] == "profile"
    assert metrics["drift_stops"] < 0.03
    assert "drifted" not in warnings(report)
    assert np.median(np.abs(stops_off(picture(session, "indoor"), truth))) < 0.03


def test_another_cameras_curve_is_reported_as_drift_or_refused(
    session: Path, truth: SyntheticBracket, tmp_path: Path
) -> None:
    tone = (ToneCurve(contrast=0.36), ToneCurve(contrast=0.41), ToneCurve(contrast=0.46))
    other = synthetic_bracket(SIZE, 12, sensor=replace(REFERENCE_SENSOR, tone=tone))
    file = profile(tmp_path / "calibration.json", other)
    try:
        report = run(session, options={"--calibration": file, "--side": "indoor"})
    except BracketError as error:
        assert "contradict" in error.message  # noqa: PT017 (either answer is right, silence is not)
    else:
        assert "drifted" in warnings(report)


def test_other_settings_than_the_profiles_are_reported(session: Path, truth: SyntheticBracket, tmp_path: Path) -> None:
    def at_iso_400(rig: RigProfile) -> RigProfile:
        camera = rig.cameras[Side.INDOOR]
        state = camera.state.model_copy(update={"iso": 400})
        return rig.model_copy(update={"cameras": {Side.INDOOR: camera.model_copy(update={"state": state})}})

    file = profile(tmp_path / "calibration.json", truth, at_iso_400)
    report = run(session, options={"--calibration": file, "--side": "indoor"})
    assert "profile" in warnings(report)


def test_a_known_camera_rule_gives_the_times(truth: SyntheticBracket, tmp_path: Path) -> None:
    session = bracket_session(tmp_path, {Side.INDOOR: truth.frames}, truth.nominal_s, model="Canon EOS 5D Mark II")
    report = run(session)
    assert report.stages[-1].summary["left_out"]["outdoor"] == "the session has no outdoor frames"
    result = json.loads((session / "stages" / "merge" / "response.json").read_text())
    assert result["indoor"]["times_source"] == "rule of the camera: thirds"
    assert "outdoor" not in result


def test_an_outdoor_bracket_without_information_is_left_out_and_reported(
    truth: SyntheticBracket, tmp_path: Path
) -> None:
    dark = [frame // 200 for frame in truth.frames]
    sides: dict[Side, Any] = {Side.INDOOR: truth.frames, Side.OUTDOOR: dark}
    session = bracket_session(tmp_path, sides, truth.nominal_s)
    report = run(session)
    assert "outdoor-refused" in warnings(report)
    assert report.stages[-1].summary["left_out"]["outdoor"]
    assert picture(session, "indoor").rgb.max() > 0
    with pytest.raises(ProcessingError):
        run(session, options={"--side": "outdoor"})


def test_a_session_without_frames_and_one_of_two_settings_are_refused(truth: SyntheticBracket, tmp_path: Path) -> None:
    empty = bracket_session(tmp_path / "empty", {}, truth.nominal_s)
    with pytest.raises(BracketError, match="nothing to merge"):
        run(empty)
    mixed = bracket_session(tmp_path / "mixed", {Side.INDOOR: truth.frames[:3]}, truth.nominal_s[:3])
    data = json.loads((mixed / "session.json").read_text())
    data["frames"][1]["iso"] = 200
    (mixed / "session.json").write_text(json.dumps(data))
    (mixed / "journal.jsonl").unlink()
    with pytest.raises(BracketError, match="different iso: 100, 200"):
        run(mixed)


def test_a_changed_frame_ends_the_run_with_its_name(truth: SyntheticBracket, tmp_path: Path) -> None:
    session = bracket_session(tmp_path, {Side.INDOOR: truth.frames[:3]}, truth.nominal_s[:3])
    process(session, RunRequest(until="verify"), stages=TWO)
    frame = next((session / "indoor").iterdir())
    data = bytearray(frame.read_bytes())
    data[-3] ^= 1
    frame.chmod(0o644)
    frame.write_bytes(data)
    with pytest.raises(IntegrityError, match=frame.name):
        run(session)


def test_further_exposures_behind_the_planned_stops_are_merged(truth: SyntheticBracket, tmp_path: Path) -> None:
    further_s = (truth.nominal_s[0], truth.nominal_s[0], 15.0)
    shots = zip(range(3), further_s, strict=True)
    frames = [*truth.frames, *(expose(truth.radiance, time_s, truth.sensor, 900 + i) for i, time_s in shots)]
    found = {}
    for times_s in (truth.nominal_s, (*truth.nominal_s, *further_s[:2]), (*truth.nominal_s, *further_s)):
        session = bracket_session(tmp_path, {Side.INDOOR: frames[: len(times_s)]}, times_s)
        report = run(session)
        image = picture(session, "indoor")
        dim = (truth.luminance > 0.1) & (truth.luminance < 0.6) & (image.validity == 0)
        off = np.log2(luminance_cd_m2(image.rgb)) - np.log2(truth.luminance)
        found[len(times_s)] = float(np.median(np.abs(off - np.median(off[image.validity == 0]))[dim]))
        frames_used = report.stages[-1].summary["metrics"]["indoor"]["frames"]
        assert [frame["time_s"] for frame in frames_used] == sorted(
            (frame["time_s"] for frame in frames_used), reverse=True
        )
        assert len(frames_used) == len(times_s), "frames of one time are no copies of each other"
    few, repeated, longer = found.values()
    assert longer < repeated < 0.8 * few
