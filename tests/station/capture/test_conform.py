"""The conformance suite passes on every simulated instrument, and fails on what does not conform."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from drivers.camera import CameraSettings, FrameRef
from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2.camera import Canon5D2
from drivers.clock import Clock
from drivers.errors import DeviceTimeoutError
from drivers.meter.dialect import SHIPPED, load_dialect
from drivers.meter.ls160 import KonicaMinoltaMeter
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.camera import ThetaZ1
from drivers.usb_link import UsbLink
from mocks.instruments.canon_5d2 import CANON_TIMING, CanonOptions, SimulatedCanon5D2
from mocks.instruments.exposures import CameraTiming
from mocks.instruments.ls160 import MeterFault, MeterFaultKind, SimulatedMeter
from mocks.instruments.theta_z1 import THETA_TIMING, SimulatedThetaZ1, ThetaOptions
from mocks.instruments.usb.bus import SimulatedUsbBackend
from station.capture.conform import CAMERA_CHECKS, METER_CHECKS, CameraBench, Outcome, run_camera, run_meter
from tests.drivers.memory_line import MemoryLine
from tests.mocks.optics.shot_sources import TinyShots
from tests.station.capture.fake_camera import FakeCamera
from tests.virtual_clock import VirtualClock

SIZE = (64, 32)


def theta(clock: Clock, *, keep_raw: bool = False, **changes: object) -> CameraBench:
    timing = changes.pop("timing", THETA_TIMING)
    assert isinstance(timing, CameraTiming)
    options = ThetaOptions(image_size_px=SIZE, **changes)  # type: ignore[arg-type]
    backend = SimulatedUsbBackend([SimulatedThetaZ1(TinyShots(), clock, timing=timing, options=options)], clock)
    camera = ThetaZ1(lambda: UsbLink.open(*ricoh_codes.USB_ID, backend=backend, clock=clock), clock)
    return CameraBench(camera, CameraSettings(100, 5.6, 6500, *SIZE, keep_raw=keep_raw), clock, may_delete=True)


def canon(clock: Clock, *, keep_raw: bool = False) -> CameraBench:
    options = CanonOptions(image_size_px=SIZE)
    device = SimulatedCanon5D2(TinyShots(), clock, timing=CANON_TIMING, options=options)
    backend = SimulatedUsbBackend([device], clock)
    camera = Canon5D2(
        lambda: UsbLink.open(*canon_codes.USB_ID, backend=backend, clock=clock),
        clock,
        sizes_px={canon_codes.IMAGE_SIZE_LARGE: SIZE},
    )
    settings = CameraSettings(200, 16, 6500, *SIZE, keep_raw=keep_raw)
    return CameraBench(camera, settings, clock, may_delete=True)


CAMERAS: dict[str, Callable[[Clock], CameraBench]] = {
    "theta": theta,
    "theta, raw": lambda clock: theta(clock, keep_raw=True),
    "theta, f-number index": lambda clock: theta(clock, f_number_index=True),
    "theta, later firmware": lambda clock: theta(clock, later_firmware=True),
    "theta, asleep": lambda clock: theta(clock, asleep=True),
    "theta, busy while exposing": lambda clock: theta(
        clock, timing=CameraTiming(0.12, 0.9, 25e6, transfer_while_exposing=False)
    ),
    "canon": canon,
    "canon, raw": lambda clock: canon(clock, keep_raw=True),
}


def failures(outcomes: list[Outcome]) -> list[str]:
    return [f"{o.name}: {o.detail}" for o in outcomes if not o.passed]


@pytest.mark.parametrize("name", ["theta", "canon"])
def test_no_more_is_asked_of_a_picture_than_it_has(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a capture asks, and libgphoto2: what a camera answers beyond the end is not known."""
    bench = CAMERAS[name](VirtualClock())
    read = bench.camera.read_chunk

    def strict(frame: FrameRef, offset: int, max_bytes: int) -> bytes:
        assert offset + max_bytes <= frame.size_bytes
        return read(frame, offset, max_bytes)

    monkeypatch.setattr(bench.camera, "read_chunk", strict)
    assert failures(list(run_camera(bench))) == []


@pytest.mark.parametrize("name", CAMERAS)
def test_simulated_cameras_conform(name: str) -> None:
    outcomes = list(run_camera(CAMERAS[name](VirtualClock())))
    assert not failures(outcomes)
    assert len(outcomes) == len(CAMERA_CHECKS)


@pytest.mark.parametrize("language", SHIPPED)
def test_simulated_meters_conform(language: str) -> None:
    clock = VirtualClock()
    instrument = SimulatedMeter(lambda _t: 34.63, language=language)
    meter = KonicaMinoltaMeter(lambda: MemoryLine(instrument, clock), load_dialect(language), clock)
    outcomes = list(run_meter(meter, clock))
    assert not failures(outcomes)
    assert len(outcomes) == len(METER_CHECKS)


def test_a_meter_in_the_wrong_unit_does_not_pass() -> None:
    clock = VirtualClock()
    instrument = SimulatedMeter(lambda _t: 34.63, faults=(MeterFault(MeterFaultKind.UNIT_FL),))
    meter = KonicaMinoltaMeter(lambda: MemoryLine(instrument, clock), load_dialect("ls100"), clock)
    assert any("wrong_unit" in f for f in failures(list(run_meter(meter, clock))))


@pytest.mark.parametrize(
    ("spoil", "check"),
    [
        ({"failures": {("release", 1): DeviceTimeoutError("silent")}}, "takes_pictures"),
        ({"spoil": lambda shot, shutter_s, data: data[:-2]}, "gives_the_same_bytes_in_any_chunks"),
        ({"shutter_times_s": (1.0, 4.0)}, "has_the_bracket"),
        ({"failures": {("recover", 1): DeviceTimeoutError("silent")}}, "recovers"),
        ({}, "refuses_impossible_settings"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_does_not_conform_is_named(spoil: dict[str, object], check: str) -> None:
    clock = VirtualClock()
    camera = FakeCamera(clock, **spoil)  # type: ignore[arg-type]
    outcomes = list(run_camera(CameraBench(camera, CameraSettings(100, 5.6, 6500, *SIZE), clock)))
    assert check in {o.name for o in outcomes if not o.passed}
