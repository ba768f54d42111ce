"""The capture as a state machine, with cameras that follow the contract and fail on request."""

from __future__ import annotations

import dataclasses
import io
import itertools
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from PIL import Image

from drivers.camera import CameraIdentity, CameraSettings, CameraStatus, ExposureProgress, SettingReadback
from drivers.clock import SteadyClock, SystemClock
from drivers.errors import (
    BatteryLowError,
    DaylitError,
    DeviceBusyError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
    ExposureFailedError,
    ProtocolViolationError,
    StoreFullError,
)
from drivers.meter.interface import MeterIdentity, MeterReading, ReadingStatus
from drivers.theta_z1.camera import RELEASE_LAG_S
from station.capture.capture import Capture, CaptureRequest
from station.capture.events import CaptureEvent, EventKind
from station.capture.preflight import PreflightError
from station.capture.rig import Rig, open_rig
from station.capture.rig_file import CameraTable, LimitsTable, MeterTable, RigFile
from station.commands.following import verdict
from station.errors import SessionError, UsageError
from station.session.session import SessionManifest, SessionStatus, Side
from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.conftest import LONG
from tests.station.capture.fake_camera import SIZE, FakeCamera

STOPS_S = (0.25, 1 / 15, 1 / 60, 1 / 250)
TABLE = CameraTable(kind="theta_z1", iso=100, f_number=5.6, size_px=SIZE)


class FakeMeter:
    """Reads what it is set to, one value a reading."""

    kind = "fake"

    def __init__(self, *values: float | ReadingStatus | DeviceError) -> None:
        self.values = list(values)

    def connect(self) -> MeterIdentity:
        return MeterIdentity("Fake meter", "7", "fake", dialect_verified=False, port="nowhere")

    def measure(self, *, n_samples: int = 1, timeout_s: float = 15.0) -> MeterReading:
        value = self.values.pop(0)
        if isinstance(value, DeviceError):
            raise value
        number = None if isinstance(value, ReadingStatus) else value
        status = value if isinstance(value, ReadingStatus) else ReadingStatus.OK
        return MeterReading(status, number, "raw", datetime.now(UTC), 0.0, "fake", False)

    def close(self) -> None:
        return None


def make_rig(*cameras: FakeCamera, meter: FakeMeter | None = None, **tables: object) -> Rig:
    sides = (Side.INDOOR, Side.OUTDOOR)[: len(cameras)]
    file = RigFile(
        indoor=TABLE,
        outdoor=TABLE if len(cameras) > 1 else None,
        meter=MeterTable() if meter else None,
        limits=LimitsTable(min_free_disk_mb=0, max_start_skew_s=1.0),
    )
    file = file.model_copy(update=tables)
    return Rig(file, dict(zip(sides, cameras, strict=True)), meter, SteadyClock(SystemClock()), simulated=True)


def run(rig: Rig, into: Path, **request: object) -> tuple[SessionManifest, Path, list[CaptureEvent]]:
    job = Capture.new(rig, CaptureRequest(**{"room": "Test Room", "into": into, "stops_s": STOPS_S, **request}))
    events = list(job.events())
    manifest, path = job.store.manifest, job.store.path
    job.store.close()
    return manifest, path, events


def kinds(events: list[CaptureEvent]) -> set[EventKind]:
    return {e.kind for e in events}


@pytest.fixture
def camera() -> FakeCamera:
    return FakeCamera(SystemClock())


def test_two_cameras_and_meter_make_a_complete_session(tmp_path: Path) -> None:
    cameras = [FakeCamera(SystemClock(), release_lag_s=lag) for lag in (0.0, 0.03)]
    manifest, path, _ = run(make_rig(*cameras, meter=FakeMeter(34.63, 34.9)), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE
    assert len(manifest.frames) == 2 * len(STOPS_S)
    assert [r.when for r in manifest.readings] == ["before", "after"]
    assert manifest.drift_frac == pytest.approx(34.9 / 34.63 - 1)
    assert all(sorted(c.safe) == [1, 2, 3, 4] for c in cameras)
    report = verify_session(path)
    assert report.intact, report.problems
    order = [shutter_s for _, shutter_s in cameras[0].opened_s]
    assert order == sorted(order), "a full bracket runs from short to long"


def test_release_lag_is_taken_off(tmp_path: Path) -> None:
    cameras = [FakeCamera(SystemClock(), release_lag_s=lag) for lag in (0.0, 0.05)]
    run(make_rig(*cameras), tmp_path)
    skews = [abs(a - b) for (a, _), (b, _) in zip(cameras[0].opened_s, cameras[1].opened_s, strict=True)]
    assert sorted(skews)[len(skews) // 2] < 0.04, "without the correction each would be 0.05"


def test_the_verdict_is_of_shutters_not_of_releases(tmp_path: Path) -> None:
    """Two cameras whose shutters open together are released as far apart as their lags are."""
    cameras = [FakeCamera(SystemClock(), release_lag_s=lag_s) for lag_s in (0.0, 0.2)]
    tables = [TABLE.model_copy(update={"release_lag_s": lag_s}) for lag_s in (0.0, 0.2)]
    manifest, _, _ = run(make_rig(*cameras, indoor=tables[0], outdoor=tables[1]), tmp_path)
    (apart,) = [line for line in verdict(manifest) if "apart" in line]
    assert int(apart.split()[-3]) < 100, apart
    rig = open_rig(RigFile(indoor=TABLE, outdoor=tables[1].model_copy(update={"kind": "canon_5d2"})))
    assert [t.release_lag_s for t in rig.file.cameras().values()] == [RELEASE_LAG_S, 0.2]


def test_device_names_never_become_paths(tmp_path: Path, camera: FakeCamera) -> None:
    manifest, path, _ = run(make_rig(camera), tmp_path)
    assert {f.file for f in manifest.frames} == {p.relative_to(path).as_posix() for p in path.glob("indoor/*")}
    assert manifest.frames[0].camera_name.startswith("../../etc/")


def test_meterless_and_one_sided_sessions_are_marked(tmp_path: Path, camera: FakeCamera) -> None:
    manifest, _, _ = run(make_rig(camera), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE
    assert {"one_side", "no_meter"} <= {w.code for w in manifest.warnings}


def test_typed_readings_are_recorded_as_typed(tmp_path: Path, camera: FakeCamera) -> None:
    manifest, _, _ = run(make_rig(camera), tmp_path, typed_readings=(34.63, 40.0))
    assert [(r.when, r.status, r.luminance_cd_m2) for r in manifest.readings] == [
        ("before", "typed", 34.63),
        ("after", "typed", 40.0),
    ]
    assert "drift" in {w.code for w in manifest.warnings}


@pytest.mark.parametrize("value", [float("nan"), -1.0, 0.0, 1e9])
def test_impossible_typed_reading_is_refused(tmp_path: Path, camera: FakeCamera, value: float) -> None:
    with pytest.raises(UsageError):
        run(make_rig(camera), tmp_path, typed_readings=(value,))


def test_reading_without_a_number_is_recorded_and_leaves_the_session_partial(
    tmp_path: Path, camera: FakeCamera
) -> None:
    meter = FakeMeter(ReadingStatus.OVER_RANGE, 12.0)
    manifest, _, _ = run(make_rig(camera, meter=meter), tmp_path)
    assert manifest.readings[0].luminance_cd_m2 is None
    assert manifest.status is SessionStatus.PARTIAL
    assert manifest.missing == ("meter reading before",)


def test_a_meter_that_dies_during_the_bracket_costs_no_frame(tmp_path: Path, camera: FakeCamera) -> None:
    meter = FakeMeter(34.0, DeviceLostError("unplugged"))
    manifest, _, _ = run(make_rig(camera, meter=meter), tmp_path)
    assert len(manifest.frames) == len(STOPS_S)
    assert manifest.missing == ("meter reading after",)


RECOVERABLE: list[Callable[[], DeviceError]] = [
    lambda: DeviceTimeoutError("silent"),
    lambda: DeviceLostError("unplugged"),
    lambda: ProtocolViolationError("nonsense"),
    lambda: DeviceBusyError("busy"),
    lambda: ExposureFailedError("no picture"),
]
STATES = ["set_shutter", "arm", "release", "poll_exposure", "read_chunk", "finish_frame"]


CASES = list(itertools.product(STATES, RECOVERABLE))


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("state", "error"),
    CASES if LONG else CASES[::4],  # of the short ones, too, each state and each error is one
    ids=lambda case: case if isinstance(case, str) else type(case()).__name__,
)
def test_every_fault_in_every_state_is_recovered(tmp_path: Path, state: str, error: Callable[[], DeviceError]) -> None:
    cameras = [FakeCamera(SystemClock(), failures={(state, 2): error()}), FakeCamera(SystemClock())]
    manifest, path, _ = run(make_rig(*cameras), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE, manifest.missing
    assert verify_session(path).intact


@pytest.mark.parametrize("error", [StoreFullError("full"), BatteryLowError("empty")])
def test_what_needs_a_person_stops_and_is_resumed(tmp_path: Path, error: DeviceError) -> None:
    broken = FakeCamera(SystemClock(), failures={("release", 3): error})
    with pytest.raises(type(error)):
        run(make_rig(broken, FakeCamera(SystemClock())), tmp_path)
    (path,) = tmp_path.iterdir()
    with SessionStore.open(path, writable=True) as store:
        before = {f.file: f.sha256 for f in store.manifest.frames}
        assert before
        job = Capture.resume(make_rig(FakeCamera(SystemClock()), FakeCamera(SystemClock())), store)
        list(job.events())
        after = store.manifest
    assert after.status is SessionStatus.COMPLETE
    assert before.items() <= {f.file: f.sha256 for f in after.frames}.items()
    assert "resumed" in {w.code for w in after.warnings}
    assert verify_session(path).intact


def test_a_session_that_is_resumed_warns_once_of_what_stayed_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    status = CameraStatus(0.9, 10**10, 1000, None, ready=True, warnings=("the dial is not reported",))
    monkeypatch.setattr(FakeCamera, "status", lambda _: status)
    cameras = [FakeCamera(SystemClock(), failures={("release", 3): StoreFullError("full")}), FakeCamera(SystemClock())]
    with pytest.raises(StoreFullError):
        run(make_rig(*cameras), tmp_path)
    (path,) = tmp_path.iterdir()
    with SessionStore.open(path, writable=True) as store:
        list(Capture.resume(make_rig(*cameras), store).events())
        found = [w for w in store.manifest.warnings if w.code.startswith("preflight")]
    assert found
    assert len(set(found)) == len(found)


def test_a_camera_that_stays_broken_leaves_a_partial_session_that_names_what_is_missing(tmp_path: Path) -> None:
    lost = DeviceLostError("unplugged")
    broken = FakeCamera(SystemClock(), failures={("release", 2): lost, ("recover", 1): DeviceLostError("still gone")})
    with pytest.raises(DeviceLostError):
        run(make_rig(broken), tmp_path)
    (path,) = tmp_path.iterdir()
    report = verify_session(path)
    assert report.intact
    assert report.status == "partial"
    assert len(report.missing) + report.frames_checked == len(STOPS_S)
    assert len(report.missing) >= len(STOPS_S) - 1


def test_an_endlessly_failing_stop_is_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    failures = {("release", n): DeviceTimeoutError("silent") for n in (2, 3, 4)}
    manifest, _, events = run(make_rig(FakeCamera(SystemClock(), failures=failures)), tmp_path)
    assert len(manifest.frames) == len(STOPS_S) - 1
    assert manifest.missing == ("indoor: stop 2 (1/60 s)",)
    assert EventKind.RECOVERING in kinds(events)


def spoil_first(change: Callable[[bytes], bytes], shots: tuple[int, ...]) -> Callable[[int, float, bytes], bytes]:
    return lambda shot, _shutter_s, data: change(data) if shot in shots else data


@pytest.mark.parametrize(
    "change",
    [lambda data: data[: len(data) // 2], lambda _data: b"not a jpeg at all" * 100],
    ids=["truncated", "not a JPEG"],
)
def test_a_bad_frame_is_retaken_once(tmp_path: Path, change: Callable[[bytes], bytes]) -> None:
    camera = FakeCamera(SystemClock(), spoil=spoil_first(change, (2,)))
    manifest, path, events = run(make_rig(camera), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE
    assert [r.stop for r in manifest.rejected] == [2]
    assert manifest.frame(Side.INDOOR, 2).retakes == 1  # type: ignore[union-attr]
    assert (path / str(manifest.rejected[0].file)).exists(), "kept aside"
    assert EventKind.REJECTED in kinds(events)
    assert verify_session(path).intact


def test_a_frame_that_stays_bad_is_named(tmp_path: Path) -> None:
    camera = FakeCamera(SystemClock(), spoil=lambda shot, s, data: data[:100] if abs(s - 1 / 60) < 1e-6 else data)
    manifest, _, _ = run(make_rig(camera), tmp_path)
    assert manifest.missing == ("indoor: stop 2 (1/60 s)",)
    assert len(manifest.rejected) == 2


def test_a_repeated_frame_and_a_lying_exposure_are_caught(tmp_path: Path) -> None:
    frames: list[bytes] = []

    def repeat_third(shot: int, _shutter_s: float, data: bytes) -> bytes:
        frames.append(data)
        return frames[1] if shot == 3 else data

    manifest, _, _ = run(make_rig(FakeCamera(SystemClock(), spoil=repeat_third)), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE
    assert len(manifest.rejected) == 1


def black(data: bytes) -> bytes:
    """The same JPEG with its EXIF, but black: what a shutter that stays shut gives."""
    image = Image.open(io.BytesIO(data))
    buffer = io.BytesIO()
    Image.new("RGB", image.size).save(buffer, "JPEG", exif=image.info["exif"])
    return buffer.getvalue()


@pytest.mark.parametrize("shots", [(1,), (2,)], ids=["first", "later"])
def test_a_black_frame_is_retaken(tmp_path: Path, shots: tuple[int, ...]) -> None:
    camera = FakeCamera(SystemClock(), spoil=spoil_first(black, shots))
    manifest, path, _ = run(make_rig(camera), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE
    assert len(camera.opened_s) == len(STOPS_S) + 1
    assert all(f.statistics and f.statistics.mean_frac > 0.02 for f in manifest.frames)
    assert "brightness_order" not in {w.code for w in manifest.warnings}
    assert verify_session(path).intact


def test_a_frame_that_stays_black_is_named(tmp_path: Path) -> None:
    shortest = min(STOPS_S)
    camera = FakeCamera(SystemClock(), spoil=lambda _shot, s, data: black(data) if abs(s - shortest) < 1e-6 else data)
    manifest, _, _ = run(make_rig(camera), tmp_path)
    assert len(camera.opened_s) == len(STOPS_S) + 1, "retaken once"
    assert any("1/250" in w.message for w in manifest.warnings)


def test_camera_that_cannot_transfer_while_exposing_still_works(tmp_path: Path) -> None:
    camera = FakeCamera(SystemClock(), overlaps=False, chunk_bytes=200, chunk_s=0.01)
    manifest, _, _ = run(make_rig(camera), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE
    assert not camera.can_transfer_while_exposing


def test_frames_are_deleted_only_on_request(tmp_path: Path) -> None:
    for delete in (False, True):
        camera = FakeCamera(SystemClock())
        rig = make_rig(camera, indoor=TABLE.model_copy(update={"delete_after": delete}))
        run(rig, tmp_path / str(delete))
        assert bool(camera.deleted) is delete


def test_adaptive_bracket_leaves_out_what_adds_nothing(tmp_path: Path) -> None:
    camera = FakeCamera(SystemClock(), gain=1e5)  # so bright that long stops add nothing dark
    manifest, _, events = run(make_rig(camera), tmp_path, mode="adaptive")
    assert manifest.status is SessionStatus.COMPLETE
    assert manifest.skipped
    assert all("already nothing" in s.reason for s in manifest.skipped)
    assert len(manifest.frames) + len(manifest.skipped) == len(STOPS_S)
    assert EventKind.SKIPPED in kinds(events)


def test_ask_stop_ends_after_the_pair_and_keeps_it(tmp_path: Path, camera: FakeCamera) -> None:
    job = Capture.new(make_rig(camera), CaptureRequest(room="x", into=tmp_path, stops_s=STOPS_S))

    def watch() -> Iterator[CaptureEvent]:
        for event in job.events():
            if event.kind is EventKind.RELEASED:
                job.ask_stop()
            yield event

    list(watch())
    assert len(job.store.manifest.frames) == 1
    assert job.store.manifest.status is SessionStatus.PARTIAL
    job.store.close()


def test_preflight_names_everything_at_once(tmp_path: Path) -> None:
    cameras = [FakeCamera(SystemClock(), failures={("connect", 1): DeviceLostError(f"camera {n}")}) for n in (1, 2)]
    with pytest.raises(PreflightError) as caught:
        run(make_rig(*cameras), tmp_path)
    assert "camera 1" in str(caught.value)
    assert "camera 2" in str(caught.value)
    assert not list(tmp_path.iterdir()), "no session before preflight has passed"


def test_low_battery_is_refused_before_anything_is_exposed(tmp_path: Path, camera: FakeCamera) -> None:
    rig = make_rig(camera, limits=LimitsTable(min_battery_frac=0.95, min_free_disk_mb=0))
    with pytest.raises(DaylitError, match="battery"):
        run(rig, tmp_path)
    assert not camera.opened_s


def test_resume_needs_the_cameras_of_the_session(tmp_path: Path) -> None:
    cameras = [FakeCamera(SystemClock(), failures={("release", 2): StoreFullError("full")}), FakeCamera(SystemClock())]
    with pytest.raises(StoreFullError):
        run(make_rig(*cameras), tmp_path)
    (path,) = tmp_path.iterdir()
    with SessionStore.open(path, writable=True) as store, pytest.raises(SessionError, match="outdoor"):
        Capture.resume(make_rig(FakeCamera(SystemClock())), store)


def test_resume_with_other_settings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreFullError):
        run(make_rig(FakeCamera(SystemClock(), failures={("release", 2): StoreFullError("full")})), tmp_path)
    (path,) = tmp_path.iterdir()
    other = make_rig(FakeCamera(SystemClock()), indoor=TABLE.model_copy(update={"iso": 200}))
    with SessionStore.open(path, writable=True) as store, pytest.raises(SessionError, match="iso was 100, is 200"):
        Capture.resume(other, store)


def test_resume_with_another_body_is_refused(tmp_path: Path) -> None:
    class Twin(FakeCamera):
        def connect(self) -> CameraIdentity:
            return dataclasses.replace(super().connect(), serial="43")

    with pytest.raises(StoreFullError):
        run(make_rig(FakeCamera(SystemClock(), failures={("release", 2): StoreFullError("full")})), tmp_path)
    (path,) = tmp_path.iterdir()
    twin = Twin(SystemClock())
    with (
        SessionStore.open(path, writable=True) as store,
        pytest.raises(DeviceNotFoundError, match="serial number 43, the session has frames of 42"),
    ):
        list(Capture.resume(make_rig(twin), store).events())
    assert not twin.opened_s
    with SessionStore.open(path, writable=True) as store:
        list(Capture.resume(make_rig(FakeCamera(SystemClock())), store).events())
        assert store.manifest.status is SessionStatus.COMPLETE


def test_long_texts_of_a_device_are_cut_and_a_long_room_is_refused(tmp_path: Path, camera: FakeCamera) -> None:
    class Talker(FakeCamera):
        def prepare(self, settings: CameraSettings) -> tuple[SettingReadback, ...]:
            super().prepare(settings)
            return (SettingReadback("iso", "100", "x" * 600, "00" * 600),)

    manifest, _, _ = run(make_rig(Talker(SystemClock())), tmp_path)
    assert len(manifest.devices[0].settings[0].raw) == 500
    with pytest.raises(UsageError, match="room"):
        Capture.new(make_rig(camera), CaptureRequest(room="x" * 600, into=tmp_path))


@pytest.mark.parametrize("asked", [{"room": "caf\udce9"}, {"address": "caf\udce9"}, {"address": "x" * 600}])
def test_names_that_no_session_can_hold_are_refused_before_anything_is_exposed(
    tmp_path: Path, camera: FakeCamera, asked: dict[str, str]
) -> None:
    """A name typed in Latin-1 comes with a lone surrogate, which JSON in UTF-8 has no bytes for."""
    with pytest.raises(UsageError, match="address"):
        run(make_rig(camera), tmp_path, **asked)
    assert not camera.calls
    assert not list(tmp_path.iterdir())


def test_a_frame_announced_larger_than_any_is_not_fetched(tmp_path: Path) -> None:
    class Boaster(FakeCamera):
        def poll_exposure(self) -> ExposureProgress:
            progress = super().poll_exposure()
            huge = tuple(dataclasses.replace(f, size_bytes=1 << 31) for f in progress.frames if f.handle == 2)
            return dataclasses.replace(progress, frames=huge or progress.frames)

    manifest, _, _ = run(make_rig(Boaster(SystemClock())), tmp_path)
    assert manifest.status is SessionStatus.COMPLETE


def test_settings_and_devices_are_in_the_manifest(tmp_path: Path, camera: FakeCamera) -> None:
    manifest, _, _ = run(make_rig(camera), tmp_path)
    (device,) = manifest.devices
    assert (device.role, device.serial, device.simulated) == ("indoor", "42", True)
    assert device.settings[0].name == "iso"
    assert abs(device.clock_offset_s or 0) < 1


def test_fakes_follow_the_contract() -> None:
    from drivers.camera import Camera

    assert isinstance(FakeCamera(SystemClock()), Camera)
    assert dataclasses.is_dataclass(FakeCamera)
