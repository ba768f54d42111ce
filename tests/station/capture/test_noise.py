"""Further exposures until a bracket's noise is as asked: what is stated, what is taken, and faults meanwhile."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceLostError, ExposureFailedError
from station.capture.capture import Capture
from station.capture.events import CaptureEvent, EventKind
from station.capture.reference import MOST_FURTHER, error_by_noise, further_time_s
from station.frames.facts import FrameFacts
from station.frames.worker import inspect
from station.session.session import SessionManifest, SessionStatus, Side
from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.station.capture.fake_camera import FakeCamera
from tests.station.capture.test_capture import STOPS_S, black, make_rig, run

TIMES_S = (0.4, 0.3, 0.25, 1 / 15, 1 / 60, 1 / 250)


def camera(**options: Any) -> FakeCamera:
    return FakeCamera(SystemClock(), shutter_times_s=TIMES_S, **options)


def noises(events: list[CaptureEvent]) -> list[dict[str, Any]]:
    return [event.data for event in events if event.kind is EventKind.NOISE]


def first_error(into: Path) -> float:
    """Return the error of the nine stops of a fake camera, by asking for what they have anyway."""
    _, _, events = run(make_rig(camera()), into, noise_frac=0.5)
    (said,) = noises(events)
    return float(said["error_frac"][Side.INDOOR])


def assert_whole(manifest: SessionManifest, path: Path) -> None:
    assert manifest.status is SessionStatus.COMPLETE
    assert not manifest.missing
    report = verify_session(path)
    assert report.intact, report.problems


def test_longer_frames_are_taken_until_the_noise_is_as_asked(tmp_path: Path) -> None:
    asked = 0.9 * first_error(tmp_path)
    cameras = [camera(), camera()]
    manifest, path, events = run(make_rig(*cameras), tmp_path, noise_frac=asked)
    assert_whole(manifest, path)
    said = noises(events)
    assert max(said[0]["error_frac"].values()) > asked >= max(said[-1]["error_frac"].values())
    assert [one["next_s"] for one in said[:-1]] == list(manifest.bracket.stops_s[len(STOPS_S) :])
    assert len(manifest.bracket.order) == len(STOPS_S) < len(manifest.bracket.stops_s)
    # Both cameras took it together, and the stop that is repeated to compare came last
    assert len(manifest.frames) == 2 * len(manifest.bracket.stops_s)
    assert len(manifest.references) == 2
    assert "noise" not in {warning.code for warning in manifest.warnings}


def test_a_bracket_that_nobody_asked_of_is_as_before(tmp_path: Path) -> None:
    manifest, path, events = run(make_rig(camera()), tmp_path)
    assert_whole(manifest, path)
    assert manifest.bracket.stops_s == STOPS_S
    assert not noises(events)
    assert not manifest.references
    assert '"noise"' not in (path / "journal.jsonl").read_text()


def test_there_are_only_so_many_and_what_is_not_reached_is_a_warning(tmp_path: Path) -> None:
    manifest, path, _ = run(make_rig(camera()), tmp_path, noise_frac=0.005)
    assert_whole(manifest, path)
    assert len(manifest.bracket.stops_s) == len(STOPS_S) + MOST_FURTHER
    (warning,) = (warning for warning in manifest.warnings if warning.code == "noise")
    assert "asked 0.5%" in warning.message


def test_a_side_that_shows_nothing_is_said_to_be_unknown(tmp_path: Path) -> None:
    """NaN and infinity are no JSON: the journal has null for them, and the capture ends as it should."""
    manifest, path, events = run(
        make_rig(camera(), camera(spoil=lambda _n, _s, data: black(data))), tmp_path, noise_frac=0.05
    )
    assert manifest.status is SessionStatus.COMPLETE
    assert {one["error_frac"][Side.OUTDOOR] for one in noises(events)} == {None}
    assert all(one["error_frac"][Side.INDOOR] > 0 for one in noises(events))
    assert '"outdoor":null' in (path / "journal.jsonl").read_text()
    (warning,) = (warning for warning in manifest.warnings if warning.code == "noise")
    assert "outdoor unknown" in warning.message


def test_further_frames_that_are_spoilt_cost_nothing_but_themselves(tmp_path: Path) -> None:
    one = camera(spoil=lambda shot, _time_s, data: data[: len(data) // 2] if shot > len(STOPS_S) else data)
    manifest, path, _ = run(make_rig(one), tmp_path, noise_frac=0.01)
    assert_whole(manifest, path)
    assert {frame.stop for frame in manifest.frames} == set(range(len(STOPS_S)))
    assert {"frame_missing", "noise"} <= {warning.code for warning in manifest.warnings}
    assert len(one.opened_s) == len(STOPS_S) + 2 + 1, "once more, no other since it brought nothing, and one to compare"


@pytest.mark.parametrize("error", [ExposureFailedError("no picture"), DeviceLostError("unplugged")])
def test_a_camera_that_fails_in_a_further_frame_is_recovered(tmp_path: Path, error: Any) -> None:
    one = camera(failures={("release", len(STOPS_S) + 1): error})
    manifest, path, events = run(make_rig(one), tmp_path, noise_frac=0.9 * first_error(tmp_path))
    assert_whole(manifest, path)
    assert one.recovered >= 1
    assert max(noises(events)[-1]["error_frac"].values()) <= noises(events)[-1]["asked_frac"]


def test_a_capture_that_ends_in_a_further_frame_lacks_nothing_and_can_be_resumed_before(tmp_path: Path) -> None:
    rig = make_rig(camera())
    job = Capture.new(rig, _request(tmp_path, 0.01))
    for event in job.events():
        if event.kind is EventKind.NOISE:
            job.ask_stop()
    manifest, path = job.store.manifest, job.store.path
    job.store.close()
    assert_whole(manifest, path)
    with SessionStore.open(path, writable=True) as store:
        frame = next(f for f in store.manifest.frames if f.stop == 1)
        store.withdraw_frame(frame.side, frame.stop, frame.format, "to be taken again")
    with SessionStore.open(path, writable=True) as store:
        again = Capture.resume(make_rig(camera()), store)
        for _ in again.events():
            pass
        assert store.manifest.status is SessionStatus.COMPLETE


def _request(into: Path, noise_frac: float) -> Any:
    from station.capture.capture import CaptureRequest

    return CaptureRequest(room="Test Room", into=into, stops_s=STOPS_S, noise_frac=noise_frac)


def facts(light: float, noise: float, parts: int = 128) -> FrameFacts:
    patches, noises_ = (light,) * parts, (noise,) * parts
    return FrameFacts(name="f", size_bytes=1, sha256="0" * 64, patches=patches, noise=noises_)


def test_frames_count_by_their_inverse_variance() -> None:
    one = error_by_noise(Side.INDOOR, {0: facts(0.1, 0.02)}, (4.0,))
    assert one == pytest.approx(1.96 * 0.02)
    two = error_by_noise(Side.INDOOR, {0: facts(0.1, 0.02), 1: facts(0.1, 0.02)}, (4.0, 4.0))
    assert two == pytest.approx(one / math.sqrt(2))
    beside = error_by_noise(Side.INDOOR, {0: facts(0.1, 0.02), 1: facts(0.001, 0.5), 2: facts(0.95, 0.001)}, (4, 1, 15))
    assert beside == pytest.approx(one), "frames that are dark or clipped there say nothing"
    assert math.isnan(error_by_noise(Side.INDOOR, {0: facts(0.1, 0.0)}, (4.0,)))
    assert math.isinf(error_by_noise(Side.INDOOR, {0: facts(0.001, 0.3)}, (4.0,)))


def test_what_is_dark_outdoors_is_no_sky() -> None:
    sky, trees = facts(0.1, 0.02), facts(0.006, 0.2)
    both = sky.model_copy(
        update={"patches": sky.patches[:100] + trees.patches[:28], "noise": sky.noise[:100] + trees.noise[:28]}
    )
    assert error_by_noise(Side.OUTDOOR, {0: both}, (4.0,)) == pytest.approx(1.96 * 0.02)
    assert error_by_noise(Side.INDOOR, {0: both}, (4.0,)) == pytest.approx(1.96 * 0.2)


def test_the_next_exposure_reaches_by_itself_what_is_asked() -> None:
    times_s = (4.0, 5.0, 8.0, 10.0, 15.0, 30.0)
    assert further_time_s(0.056, 0.03, times_s) == 15.0
    assert further_time_s(0.031, 0.03, times_s) == 5.0
    assert further_time_s(math.inf, 0.03, times_s) == 30.0


@pytest.mark.parametrize(("level", "sigma"), [(60, 3.0), (128, 4.0), (200, 3.0)])
def test_the_noise_of_a_frame_is_measured(tmp_path: Path, level: int, sigma: float) -> None:
    rng = np.random.default_rng(1)
    pixels = np.clip(np.rint(level + sigma * rng.standard_normal((480, 960, 1)) * np.ones(3)), 0, 255).astype(np.uint8)
    path = tmp_path / "f.jpg"
    cv2.imwrite(str(path), pixels, [cv2.IMWRITE_JPEG_QUALITY, 98])
    request = {"path": str(path), "format": "jpeg", "exact": True, "circle": (0.5, 0.5, 0.2)}
    noise = np.array(inspect(request, lambda: "")["noise"]).reshape(8, 16)
    code = np.array([level - 0.5, level + 0.5]) / 255
    step = np.diff(((code + 0.055) / 1.055) ** 2.4)[0] / ((level / 255 + 0.055) / 1.055) ** 2.4
    assert np.median(noise[noise > 0]) == pytest.approx(step * math.hypot(sigma, 0.5), rel=0.1)
    assert not noise[[0, 0, -1, -1], [0, -1, 0, -1]].any(), "outside the circle"
    assert not inspect({**request, "exact": False}, lambda: "")["noise"]


def test_the_command_refuses_what_is_no_percentage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import daylit

    for text in ("0", "80"):
        assert daylit.main(["capture", "x", "--simulate", "uniform:100", "--noise", text]) == 2
        assert "--noise" in capsys.readouterr().err
    assert daylit.main(["capture", "x", "--simulate", "room", "--dry-run", "--noise", "3"]) == 0
    assert "further exposures" in capsys.readouterr().out
