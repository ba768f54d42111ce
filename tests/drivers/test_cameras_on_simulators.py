"""Both drivers against the simulated cameras through the real pyusb: whole brackets, and faults between.

Time is virtual and single-threaded. Pictures are small made-up bytes that name their exposure, so that a frame of
another exposure shows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from drivers.camera import CameraSettings, FrameFormat, FrameRef
from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2.camera import Canon5D2
from drivers.clock import Deadline
from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceNotFoundError,
    DeviceTimeoutError,
    SettingRefusedError,
)
from drivers.ptp.codes import Operation
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.camera import ThetaZ1
from drivers.theta_z1.codes import RicohProp
from drivers.usb_link import UsbLink
from mocks.instruments.canon_5d2 import SimulatedCanon5D2
from mocks.instruments.canon_records import CanonOptions
from mocks.instruments.exposures import ShotRequest
from mocks.instruments.faults import Fault, FaultKind, FaultSchedule, Phase
from mocks.instruments.theta_z1 import SimulatedThetaZ1, ThetaOptions
from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.conftest import LONG
from tests.virtual_clock import VirtualClock

NINE_STOPS = (4, 1, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
CHUNK_BYTES = 64 * 1024
SETTINGS = {
    "theta_z1": CameraSettings(100, 5.6, 6500, 6720, 3360),
    "canon_5d2": CameraSettings(200, 16, 6500, 5616, 3744),
}
RAW = {"theta_z1": FrameFormat.DNG, "canon_5d2": FrameFormat.CR2}
EXPOSURE_LIMIT_S = 45.0
STEP_LIMIT_S = 120.0
"""Of recovery, settings and one exposure together, each wait at its worst."""

Driver = ThetaZ1 | Canon5D2


class NamedShots:
    """Pictures that say how they were exposed, of uneven sizes."""

    def jpeg(self, request: ShotRequest) -> bytes:
        return self._picture("jpeg", request, 100_000 + request.sequence)

    def raw(self, request: ShotRequest) -> bytes:
        return self._picture("raw", request, 300_000)

    def _picture(self, kind: str, request: ShotRequest, size: int) -> bytes:
        label = f"{kind} {request.shutter_s:.9f} {request.iso} {request.f_number:g} {request.color_temperature_k} "
        return (label.encode() * (size // len(label) + 1))[:size]


@dataclass
class Setup:
    """A simulated camera and the driver that speaks to it."""

    kind: str
    clock: VirtualClock
    device: SimulatedThetaZ1 | SimulatedCanon5D2
    camera: Driver

    def settings(self, *, keep_raw: bool = False) -> CameraSettings:
        plain = SETTINGS[self.kind]
        return CameraSettings(
            plain.iso, plain.f_number, plain.color_temperature_k, plain.width_px, plain.height_px, keep_raw
        )

    def fetch(self, frame: FrameRef) -> bytes:
        """Read a whole frame, with patience for a busy camera."""
        content = b""
        deadline = Deadline.after(self.clock, 60.0)
        while len(content) < frame.size_bytes:
            try:
                content += self.camera.read_chunk(frame, len(content), CHUNK_BYTES)
            except DeviceBusyError:
                deadline.check("chunk")
                self.clock.sleep(0.03)
        self.camera.finish_frame(frame)
        return content

    def expose(self, shutter_s: float) -> tuple[FrameRef, ...]:
        """Take one exposure and return its frames."""
        nominal_s = self.camera.set_shutter(shutter_s).nominal_s
        self.camera.arm()
        self.camera.release()
        deadline = Deadline.after(self.clock, nominal_s + EXPOSURE_LIMIT_S)
        while not (progress := self.camera.poll_exposure()).done:
            deadline.check("picture")
        return progress.frames


Make = Callable[..., Setup]
Options = ThetaOptions | CanonOptions | None


@pytest.fixture(params=["theta_z1", "canon_5d2"])
def make(request: pytest.FixtureRequest) -> Make:
    kind: str = request.param

    def build(*faults: Fault, options: Options = None, **driver_options: str) -> Setup:
        clock = VirtualClock()
        schedule = FaultSchedule.of(*faults)
        device: SimulatedThetaZ1 | SimulatedCanon5D2
        if kind == "theta_z1":
            how = options if isinstance(options, ThetaOptions) else ThetaOptions()
            device = SimulatedThetaZ1(NamedShots(), clock, faults=schedule, options=how)
        else:
            how_canon = options if isinstance(options, CanonOptions) else CanonOptions()
            device = SimulatedCanon5D2(NamedShots(), clock, faults=schedule, options=how_canon)
        backend = SimulatedUsbBackend([device], clock)
        ids = ricoh_codes.USB_ID if kind == "theta_z1" else canon_codes.USB_ID

        def open_transport() -> UsbLink:
            return UsbLink.open(*ids, backend=backend, clock=clock)

        driver: Driver
        if kind == "theta_z1":
            driver = ThetaZ1(open_transport, clock)
        else:
            driver = Canon5D2(open_transport, clock, **driver_options)  # type: ignore[arg-type]
        return Setup(kind, clock, device, driver)

    return build


def label_of(kind: str, shutter_s: float, settings: CameraSettings) -> bytes:
    kelvin = settings.color_temperature_k
    return f"{kind} {shutter_s:.9f} {settings.iso} {settings.f_number:g} {kelvin} ".encode()


@pytest.mark.parametrize("keep_raw", [False, True], ids=["jpeg", "raw+"])
def test_whole_bracket(make: Make, keep_raw: bool) -> None:
    setup = make()
    identity = setup.camera.connect()
    assert identity.serial
    settings = setup.settings(keep_raw=keep_raw)
    readbacks = setup.camera.prepare(settings)
    assert [r.name for r in readbacks if not r.honoured] == []
    status = setup.camera.status()
    assert (status.problems, status.ready) == ((), True)
    assert status.clock_utc is not None
    assert abs((status.clock_utc - setup.clock.utc_now()).total_seconds()) < 2
    handles = set()
    for stop in NINE_STOPS:
        frames = setup.expose(stop)
        expected = [FrameFormat.JPEG, RAW[setup.kind]] if keep_raw else [FrameFormat.JPEG]
        assert [f.format for f in frames] == expected
        for frame in frames:
            content = setup.fetch(frame)
            kind = "jpeg" if frame.format is FrameFormat.JPEG else "raw"
            assert content.startswith(label_of(kind, stop, settings)), content[:60]
            assert len(content) == frame.size_bytes
            handles.add(frame.handle)
        setup.camera.keep_alive()
    assert len(handles) == 9 * (1 + keep_raw)
    assert handles == {f.handle for f in setup.camera.list_frames()}
    for frame in setup.camera.list_frames():
        setup.camera.delete(dataclasses.replace(frame, name="OTHER.JPG"))
    assert len(setup.camera.list_frames()) == len(handles), "a picture that only has the handle is left alone"
    for frame in setup.camera.list_frames():
        setup.camera.delete(frame)
    assert setup.camera.list_frames() == ()
    setup.camera.close()


def test_a_handle_is_free_again_when_its_picture_was_deleted(make: Make) -> None:
    """Cameras make handles of file numbers, and number from the last file on the card when the newest was deleted."""
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    handles = set()
    for stop in NINE_STOPS[:3]:
        (frame,) = setup.expose(stop)
        assert setup.fetch(frame).startswith(label_of("jpeg", stop, setup.settings()))
        setup.camera.delete(frame)
        setup.device.store._next_handle = frame.handle
        handles.add(frame.handle)
    assert len(handles) == 1
    setup.camera.close()


def test_transfer_behind_the_next_exposure(make: Make) -> None:
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    (first,) = setup.expose(1 / 60)
    setup.camera.set_shutter(1)
    setup.camera.arm()
    setup.camera.release()
    content = b""
    deadline = Deadline.after(setup.clock, EXPOSURE_LIMIT_S)
    while not (progress := setup.camera.poll_exposure()).done:
        deadline.check("picture")
        if setup.camera.can_transfer_while_exposing and len(content) < first.size_bytes:
            try:
                content += setup.camera.read_chunk(first, len(content), CHUNK_BYTES)
            except DeviceBusyError:
                assert not setup.camera.can_transfer_while_exposing
    assert len(content) == first.size_bytes
    assert content.startswith(label_of("jpeg", 1 / 60, setup.settings()))
    assert setup.fetch(progress.frames[0]).startswith(label_of("jpeg", 1, setup.settings()))


def test_second_program_start_finds_the_camera_usable(make: Make) -> None:
    """The first program is killed: its session stays open in the camera, its button half pressed."""
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    setup.camera.set_shutter(1 / 60)
    setup.camera.arm()
    setup.camera._link.session._transport.close()
    setup.camera._link._session = None
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    (frame,) = setup.expose(1 / 60)
    assert setup.fetch(frame).startswith(label_of("jpeg", 1 / 60, setup.settings()))


def take_with_recovery(setup: Setup, stop: float, attempts: int = 3) -> bytes:
    """Take one stop as the station does: after a device error recover, prepare again, retake."""
    camera = setup.camera
    for attempt in range(attempts):
        begun_s = setup.clock.monotonic_s()
        try:
            if attempt > 0:
                camera.recover()
                camera.prepare(setup.settings())
            (frame,) = setup.expose(stop)
            return setup.fetch(frame)
        except DeviceError:
            if attempt == attempts - 1:
                raise
        finally:
            assert setup.clock.monotonic_s() - begun_s <= STEP_LIMIT_S
    raise AssertionError("unreachable")


HARD_FAULTS = (
    FaultKind.NO_ANSWER,
    FaultKind.LATE_ANSWER,
    FaultKind.STALL,
    FaultKind.WRONG_TRANSACTION_ID,
    FaultKind.DUPLICATE_RESPONSE,
    FaultKind.OVERSIZE_LENGTH,
    FaultKind.BUSY,
)
"""The torture run has all of them; these are one of each sort."""


def operations_of_one_stop(make: Make) -> tuple[int, int]:
    """Which operation of a run is the first of its first stop, and how many there are until the last byte."""
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    before = setup.camera._link.session.last_transaction_id
    (frame,) = setup.expose(1 / 60)
    setup.fetch(frame)
    opening = 1  # OpenSession has no number of its own
    return before + opening + 1, setup.camera._link.session.last_transaction_id - before


def survives(setup: Setup) -> bool:
    """Take one stop in spite of the fault; returns whether the fault came about."""
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    content = take_with_recovery(setup, 1 / 60)
    assert content.startswith(label_of("jpeg", 1 / 60, setup.settings()))
    return bool(setup.device.faults.fired)


@pytest.mark.sweep
@pytest.mark.parametrize("kind", HARD_FAULTS, ids=str)
def test_a_fault_at_every_operation_of_a_stop_is_survived(make: Make, kind: FaultKind) -> None:
    first, count = operations_of_one_stop(make)
    assert count >= 5, "shutter, release, and the pieces of a frame"
    for nth in range(first + (0 if LONG else HARD_FAULTS.index(kind) % 3), first + count, 1 if LONG else 3):
        assert survives(make(Fault(kind, nth=nth))), nth


@pytest.mark.sweep
@pytest.mark.parametrize("phase", ["command", "data", "response"])
def test_unplugging_at_every_operation_of_a_stop_is_survived(make: Make, phase: str) -> None:
    first, count = operations_of_one_stop(make)
    fired = 0
    for nth in range(first, first + count, 1 if LONG else 2):
        setup = make(Fault(FaultKind.UNPLUG, nth=nth, phase=Phase(phase), byte=3, parameters={"replug_after_s": 2.0}))
        fired += survives(setup)
    assert fired >= (3 if LONG else 1), "most operations have no data phase, some have"


@pytest.mark.parametrize(
    "kind",
    [FaultKind.LOST_EVENT, FaultKind.DUPLICATE_EVENT, FaultKind.OTHER_OBJECT_EVENT, FaultKind.REORDERED_EVENT],
    ids=str,
)
def test_events_gone_wrong_cost_time_but_no_frame(make: Make, kind: FaultKind) -> None:
    for nth in range(1, 5):
        setup = make(Fault(kind, nth=nth))
        setup.camera.connect()
        setup.camera.prepare(setup.settings())
        handles = []
        for stop in (1 / 60, 1 / 4):
            content = take_with_recovery(setup, stop)
            assert content.startswith(label_of("jpeg", stop, setup.settings())), (nth, stop)
            handles.append(content[:30])
        assert len(set(handles)) == 2


def test_camera_that_stays_away_is_named_in_time(make: Make) -> None:
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    setup.device.unplug()
    with pytest.raises(DeviceError):
        setup.camera.set_shutter(1)
    begun_s = setup.clock.monotonic_s()
    with pytest.raises(DeviceError):
        setup.camera.recover()
    assert setup.clock.monotonic_s() - begun_s <= 30.0
    setup.device.replug()
    setup.camera.recover()
    setup.camera.prepare(setup.settings())
    assert setup.expose(1 / 60)


@pytest.mark.parametrize("shutter_s", [8, 30])
def test_error_during_a_long_exposure_waits_for_its_end(make: Make, shutter_s: float) -> None:
    setup = make()
    camera = setup.camera
    camera.connect()
    camera.prepare(setup.settings())
    camera.set_shutter(shutter_s)
    camera.arm()
    camera.release()
    for _ in range(20):
        assert not camera.poll_exposure().done
    camera._link.session.broken = "made up by this test"
    camera.recover()
    camera.prepare(setup.settings())
    (frame,) = setup.expose(1 / 60)
    assert setup.fetch(frame).startswith(label_of("jpeg", 1 / 60, setup.settings()))


@pytest.mark.parametrize(
    "options",
    [ThetaOptions(f_number_index=True), ThetaOptions(later_firmware=True), ThetaOptions(asleep=True)],
    ids=["f-number index", "later firmware", "asleep"],
)
@pytest.mark.parametrize("make", ["theta_z1"], indirect=True)
def test_firmwares_of_the_theta(make: Make, options: ThetaOptions) -> None:
    setup = make(options=options)
    setup.camera.connect()
    assert all(r.honoured for r in setup.camera.prepare(setup.settings()))
    for stop in (1 / 60, 1):
        (frame,) = setup.expose(stop)
        assert setup.fetch(frame).startswith(label_of("jpeg", stop, setup.settings()))


@pytest.mark.parametrize("make", ["theta_z1"], indirect=True)
def test_theta_that_fell_asleep_between_two_stops(make: Make) -> None:
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    assert setup.expose(1)
    assert isinstance(setup.device, SimulatedThetaZ1)
    setup.device.fall_asleep()
    with pytest.raises(SettingRefusedError, match="slept"):
        setup.camera.set_shutter(1 / 60)
    assert take_with_recovery(setup, 1 / 60)


@pytest.mark.parametrize("make", ["canon_5d2"], indirect=True)
def test_pictures_for_the_computer_on_the_simulator(make: Make) -> None:
    setup = make(destination="pc")
    setup.camera.connect()
    settings = setup.settings(keep_raw=True)
    setup.camera.prepare(settings)
    for stop in (1 / 60, 1):
        frames = setup.expose(stop)
        assert [f.format for f in frames] == [FrameFormat.JPEG, FrameFormat.CR2]
        for frame, kind in zip(frames, ("jpeg", "raw"), strict=True):
            assert setup.fetch(frame).startswith(label_of(kind, stop, settings))
    setup.camera.close()


@pytest.mark.parametrize("make", ["canon_5d2"], indirect=True)
@pytest.mark.parametrize(
    ("options", "words"),
    [(CanonOptions(ae_mode=2), "turn it to M"), (CanonOptions(lens_manual=False), "switch it to MF")],
    ids=["dial", "lens"],
)
def test_wrong_controls_of_the_canon(make: Make, options: CanonOptions, words: str) -> None:
    setup = make(options=options)
    setup.camera.connect()
    with pytest.raises(SettingRefusedError, match=words):
        setup.camera.prepare(setup.settings())
    assert words in setup.camera.status().problems[0]


@pytest.mark.parametrize("make", ["canon_5d2"], indirect=True)
def test_canon_stays_on_through_a_long_pause(make: Make) -> None:
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    for _ in range(200):
        setup.clock.sleep(5.0)
        setup.camera.keep_alive()
    assert setup.expose(1 / 60)


@pytest.mark.parametrize("make", ["canon_5d2"], indirect=True)
@pytest.mark.parametrize(("busy_s", "released"), [(2.0, False), (7.0, True)], ids=["writing", "exposing"])
def test_a_canon_that_is_closed_while_it_is_busy_gets_its_own_buttons_back(
    make: Make, busy_s: float, released: bool
) -> None:
    """As after Ctrl-C, twice: recorded bodies answer busy while they expose."""
    setup = make()
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    if released:
        setup.camera.set_shutter(1)
        setup.camera.arm()
        setup.camera.release()
    setup.device._held_until_s = setup.clock.monotonic_s() + busy_s
    setup.camera.close()
    last = [o for o in setup.device.stats.operations if o.operation == canon_codes.CanonOperation.SET_REMOTE_MODE][-1]
    assert (last.params, last.code) == ((0,), 0x2001)


@pytest.mark.parametrize("make", ["theta_z1"], indirect=True)
def test_a_theta_that_was_away_when_it_was_closed_gets_its_sleep_back_later(make: Make) -> None:
    setup = make()
    properties = setup.device.properties
    asleep_after = [properties.number(p) for p in (RicohProp.SLEEP_DELAY, RicohProp.AUTO_POWER_OFF_DELAY)]
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    setup.device.unplug()
    setup.camera.close()
    setup.device.replug()
    assert properties.number(RicohProp.SLEEP_DELAY) == 0
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    setup.camera.close()
    assert [properties.number(p) for p in (RicohProp.SLEEP_DELAY, RicohProp.AUTO_POWER_OFF_DELAY)] == asleep_after


@pytest.mark.parametrize("make", ["theta_z1"], indirect=True)
def test_a_theta_whose_station_was_killed_falls_asleep_again_after_the_next(make: Make) -> None:
    """Nobody knows any more what its sleep times were: it gets Ricoh's own."""
    setup = make()
    for prop in (RicohProp.SLEEP_DELAY, RicohProp.AUTO_POWER_OFF_DELAY):
        setup.device.properties.values[prop] = 0
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    setup.camera.close()
    properties = setup.device.properties
    assert [properties.number(p) for p in (RicohProp.SLEEP_DELAY, RicohProp.AUTO_POWER_OFF_DELAY)] == [180, 64_800]


@pytest.mark.parametrize("make", ["theta_z1"], indirect=True)
def test_a_release_that_is_answered_when_the_shutter_has_closed_counts(make: Make) -> None:
    """Ricoh gives no figure; libgphoto2 waits 100 s for the answer to a capture."""
    setup = make()
    rule = setup.device.rules[Operation.INITIATE_CAPTURE]
    late = dataclasses.replace(rule, handler=lambda r: dataclasses.replace(rule.handler(r), delay_s=30.5))
    setup.device.rules[Operation.INITIATE_CAPTURE] = late
    setup.camera.connect()
    setup.camera.prepare(setup.settings())
    assert len(setup.expose(30)) == 1
    assert len(setup.device.exposure_log) == 1


def test_another_camera_is_found_out_though_it_was_silent_when_first_asked(make: Make) -> None:
    setup = make(Fault(FaultKind.NO_ANSWER, code=Operation.GET_DEVICE_INFO, nth=2))
    setup.camera.connect()
    setup.device.unplug(replug_after_s=1.0)
    setup.device.identity = dataclasses.replace(setup.device.identity, serial="another body")
    with pytest.raises(DeviceError):
        setup.camera.arm()
    with pytest.raises(DeviceTimeoutError):
        setup.camera.recover()
    with pytest.raises(DeviceNotFoundError, match="another camera answers"):
        setup.camera.recover()
