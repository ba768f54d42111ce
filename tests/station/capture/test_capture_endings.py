"""How a capture ends when something goes wrong outside the cameras: no camera in use, no wait without an end."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

import station.capture.conductor
from drivers.camera import FrameRef
from drivers.clock import SystemClock
from drivers.errors import DeviceLostError, OperationRefusedError, StoreFullError
from station.capture.capture import Capture, CaptureRequest
from station.capture.events import EventKind
from station.errors import DiskFullError
from station.session.store import SessionStore
from tests.station.capture.fake_camera import FakeCamera
from tests.station.capture.test_capture import STOPS_S, TABLE, FakeMeter, make_rig, run


def camera_threads() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name.startswith(("camera-", "intake-"))]


def test_a_full_disk_found_by_both_cameras_leaves_no_thread_with_a_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_store: SessionStore, _record: object) -> None:
        raise DiskFullError("no space left")

    monkeypatch.setattr(SessionStore, "add_frame", full)
    cameras = [FakeCamera(SystemClock(), readout_s=lag_s) for lag_s in (0.02, 1.0)]
    with pytest.raises(DiskFullError):
        run(make_rig(*cameras), tmp_path)
    assert not camera_threads()


@pytest.mark.parametrize("kind", [EventKind.RELEASED, EventKind.SAVED])
def test_the_second_ctrl_c_ends_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: EventKind) -> None:
    camera = FakeCamera(SystemClock(), chunk_s=0.05, chunk_bytes=200)
    job = Capture.new(make_rig(camera), CaptureRequest(room="x", into=tmp_path, stops_s=STOPS_S))
    result: list[EventKind] = []
    pump = station.capture.conductor.Conductor._pump

    def interrupted(self: station.capture.conductor.Conductor) -> object:
        if kind in result and EventKind.FAILED not in result:
            result.append(EventKind.FAILED)  # once
            raise KeyboardInterrupt
        return pump(self)

    monkeypatch.setattr(station.capture.conductor.Conductor, "_pump", interrupted)

    def watch() -> None:
        for event in job.events():
            assert EventKind.FAILED not in result, "something is reported after the interruption"
            result.append(event.kind)

    with pytest.raises(KeyboardInterrupt):
        watch()
    assert not camera_threads()


class OrderedCamera(FakeCamera):
    """Notes what is done to it, in order."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.done: list[str] = []

    def arm(self) -> None:
        super().arm()
        self.done.append("arm")

    def release(self) -> None:
        self.done.append("release")
        super().release()

    def delete(self, frame: FrameRef) -> None:
        super().delete(frame)
        self.done.append("delete")


def test_an_armed_camera_deletes_nothing_until_it_has_fired(tmp_path: Path) -> None:
    camera = OrderedCamera(SystemClock())
    slow = FakeCamera(SystemClock(), readout_s=0.4)  # its partner is set up ahead, and its frames become safe then
    run(make_rig(camera, slow, indoor=TABLE.model_copy(update={"delete_after": True})), tmp_path)
    assert len(camera.deleted) == len(STOPS_S)
    armed = [after for before, after in zip(camera.done, camera.done[1:], strict=False) if before == "arm"]
    assert set(armed) == {"release"}


def test_only_frames_that_count_are_deleted(tmp_path: Path) -> None:
    camera = FakeCamera(SystemClock(), spoil=lambda shot, _s, data: data[:200] if shot == 2 else data)
    run(make_rig(camera, indoor=TABLE.model_copy(update={"delete_after": True})), tmp_path)
    assert 2 not in camera.deleted
    assert len(camera.deleted) == len(STOPS_S)


def test_a_picture_that_is_protected_costs_no_recovery(tmp_path: Path) -> None:
    for kind in (OperationRefusedError("protected", response_code=0x200D), StoreFullError("the card is locked")):
        camera = FakeCamera(SystemClock(), failures={("delete", nth): kind for nth in range(1, 10)})
        rig = make_rig(camera, indoor=TABLE.model_copy(update={"delete_after": True}))
        manifest, _, _ = run(rig, tmp_path / type(kind).__name__)
        assert (manifest.status, camera.recovered, camera.calls["delete"]) == ("complete", 0, len(STOPS_S))


def test_a_meter_that_died_costs_no_retake(tmp_path: Path) -> None:
    """The last reading has failed already when the retake ends and it is to be begun anew."""
    camera = FakeCamera(SystemClock(), spoil=lambda shot, _s, data: data[:200] if shot == len(STOPS_S) else data)
    meter = FakeMeter(34.0, DeviceLostError("unplugged"), DeviceLostError("still"))
    manifest, _, _ = run(make_rig(camera, meter=meter), tmp_path)
    assert len(manifest.frames) == len(STOPS_S)
    assert manifest.missing == ("meter reading after",)


def test_asked_to_stop_while_it_waits_for_a_frame_an_adaptive_bracket_takes_no_further_stop(tmp_path: Path) -> None:
    camera = FakeCamera(SystemClock(), chunk_s=0.05, chunk_bytes=500)
    request = CaptureRequest(room="x", into=tmp_path, stops_s=STOPS_S, mode="adaptive")
    job = Capture.new(make_rig(camera), request)
    for event in job.events():
        if event.kind is EventKind.EXPOSED:
            job.ask_stop()
    assert len(camera.opened_s) == 1
    assert len(job.store.manifest.frames) == 1
    job.store.close()
