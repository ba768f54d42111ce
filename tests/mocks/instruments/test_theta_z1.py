"""The simulated Theta over the real pyusb, byte for byte and manner for manner (Ricoh USB API specification)."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from drivers.ptp.codes import Event, Operation, Prop, Response
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.codes import RicohProp
from mocks.instruments.faults import Fault, FaultSchedule
from mocks.instruments.theta_z1 import (
    READABLE_WHILE_BUSY,
    RECORDING,
    THETA_TIMING,
    SimulatedThetaZ1,
    ThetaOptions,
)
from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.mocks.instruments.raw_host import RawHost
from tests.mocks.optics.shot_sources import TinyShots, exposure_time
from tests.virtual_clock import VirtualClock

OK, BUSY = Response.OK, Response.DEVICE_BUSY
MANUAL_SETTINGS = [
    (Prop.EXPOSURE_PROGRAM_MODE, "0100"),
    (Prop.WHITE_BALANCE, "0780"),
    (RicohProp.COLOR_TEMPERATURE, "6419"),
    (Prop.F_NUMBER, "3002"),
    (Prop.EXPOSURE_INDEX, "6400"),
    (RicohProp.SHUTTER_SPEED, "01000000 3c000000"),
    (RicohProp.IMAGE_STITCHING, "0300"),
]
"""Manual, 6500 K, F5.6, ISO 100, 1/60 s, static stitching."""


class Bench:
    """A Theta, its clock and a host; keyword arguments are the camera's."""

    def __init__(self, *faults: Fault, open_session: bool = True, padding: int = 0, **how: object) -> None:
        self.clock = VirtualClock()
        self.shots = TinyShots(padding)
        self.camera = SimulatedThetaZ1(self.shots, self.clock, faults=FaultSchedule.of(*faults), **how)  # type: ignore[arg-type]
        self.backend = SimulatedUsbBackend([self.camera], self.clock)
        self.host = RawHost(self.backend, ricoh_codes.USB_ID)
        if open_session:
            self.host.open()

    def manual(self) -> None:
        for prop, value in MANUAL_SETTINGS:
            assert self.host.set(prop, bytes.fromhex(value)) == OK

    def shoot(self) -> int:
        """Capture and return the handle of the first picture."""
        assert self.host.call(Operation.INITIATE_CAPTURE, 0, 0).code == OK
        code, _, (handle,) = self.host.event()
        assert code == Event.OBJECT_ADDED
        while self.host.event()[0] != Event.CAPTURE_COMPLETE:
            pass
        return handle


def set_raw(bench: Bench, prop: int, text: str) -> int:
    return bench.host.set(prop, bytes.fromhex(text))


def test_the_dialogue_of_the_published_vectors() -> None:
    bench = Bench(open_session=False)
    host = bench.host

    def exchange(*sent: str) -> str:
        for text in sent:
            host.write(bytes.fromhex(text))
        return host.read().hex(" ")

    assert exchange("10 00 00 00 01 00 02 10 00 00 00 00 01 00 00 00") == "0c 00 00 00 03 00 01 20 00 00 00 00"
    host.tid = 1
    for _ in range(7):
        host.get(Prop.BATTERY_LEVEL)
    assert host.set(Prop.EXPOSURE_PROGRAM_MODE, b"\1\0") == OK
    sent = (
        "10 00 00 00 01 00 16 10 09 00 00 00 0f d0 00 00",
        "14 00 00 00 02 00 16 10 09 00 00 00 01 00 00 00 3c 00 00 00",
    )
    assert exchange(*sent) == "0c 00 00 00 03 00 01 20 09 00 00 00"
    sent = ("14 00 00 00 01 00 0e 10 0a 00 00 00 00 00 00 00 00 00 00 00",)
    assert exchange(*sent) == "0c 00 00 00 03 00 01 20 0a 00 00 00"
    assert host.interrupt_bytes(5000).hex(" ") == "10 00 00 00 04 00 02 40 0a 00 00 00 64 00 00 00"
    assert host.interrupt_bytes(5000).hex(" ") == "10 00 00 00 04 00 0d 40 0a 00 00 00 0a 00 00 00"


def test_endpoints_are_the_unusual_ones() -> None:
    host = Bench().host
    assert (host.bulk_in, host.bulk_out, host.interrupt) == (0x81, 0x01, 0x82)
    assert (host.usb.product, host.usb.manufacturer) == ("RICOH THETA Z1", "Ricoh Company, Ltd.")


def test_device_info_begins_and_ends_as_the_dump() -> None:
    data = Bench(open_session=False).host.call(Operation.GET_DEVICE_INFO).data
    assert data[:11] == bytes.fromhex("6400 06000000 6e00 00 0000")
    operations = struct.unpack_from("<I", data, 11)[0]
    assert struct.unpack_from(f"<{operations}H", data, 15) == RECORDING.codes("operations")
    assert data.endswith("10010001\0".encode("utf-16-le"))


def test_storage_as_the_dump() -> None:
    host = Bench().host
    assert host.call(Operation.GET_STORAGE_IDS).data.hex() == "0100000001000200"
    info = host.call(Operation.GET_STORAGE_INFO, 0x00020001).data
    assert struct.unpack_from("<HHHQ", info) == (3, 3, 0, 21055815680)
    assert info.endswith(b"\0\0"), "description and label are empty"
    assert host.call(Operation.GET_STORAGE_INFO, 5).code == Response.INVALID_STORAGE_ID


@pytest.mark.parametrize(("index", "values"), [(False, (0, 210, 350, 560)), (True, (0, 1, 2, 3))])
def test_both_f_number_encodings(index: bool, values: tuple[int, ...]) -> None:
    bench = Bench(options=ThetaOptions(f_number_index=index))
    set_raw(bench, Prop.EXPOSURE_PROGRAM_MODE, "0100")
    desc = bench.host.call(Operation.GET_DEVICE_PROP_DESC, Prop.F_NUMBER).data
    assert desc[-11:] == b"\2" + struct.pack("<5H", 4, *values)


@pytest.mark.parametrize(
    ("prop", "value", "code"),
    [
        (RicohProp.SHUTTER_SPEED, "01000000 3d000000", Response.INVALID_PROP_VALUE),
        (RicohProp.SHUTTER_SPEED, "01000000", Response.INVALID_PROP_FORMAT),
        (Prop.EXPOSURE_INDEX, "0700", Response.INVALID_PROP_VALUE),
        (Prop.BATTERY_LEVEL, "05", Response.ACCESS_DENIED),
        (0x5FFF, "00", Response.DEVICE_PROP_NOT_SUPPORTED),
        (Prop.CAPTURE_DELAY, "01000000", Response.INVALID_PROP_VALUE),
        (Prop.DATE_TIME, "00", Response.INVALID_PROP_VALUE),
        (RicohProp.COLOR_TEMPERATURE, "6519", Response.INVALID_PROP_VALUE),
    ],
)
def test_settings_are_checked(prop: int, value: str, code: int) -> None:
    bench = Bench()
    bench.manual()
    assert set_raw(bench, prop, value) == code


def test_what_the_program_forbids_is_refused() -> None:
    bench = Bench()
    assert set_raw(bench, RicohProp.SHUTTER_SPEED, "01000000 3c000000") == Response.INVALID_PROP_VALUE
    assert set_raw(bench, RicohProp.COLOR_TEMPERATURE, "6419") == Response.INVALID_PROP_VALUE, "needs WB 8007"
    bench.manual()
    assert set_raw(bench, RicohProp.FILTER, "03") == OK
    assert bench.host.get(Prop.EXPOSURE_PROGRAM_MODE) == b"\2\0", "a filter forces automatic exposure"
    assert bench.host.get(RicohProp.SHUTTER_SPEED) == bytes(8)
    assert set_raw(bench, Prop.EXPOSURE_PROGRAM_MODE, "0100") == Response.INVALID_PROP_VALUE


def test_sleep_delay_is_rounded_up() -> None:
    bench = Bench()
    assert set_raw(bench, RicohProp.SLEEP_DELAY, "0500") == OK
    assert bench.host.get(RicohProp.SLEEP_DELAY) == b"\x3c\0"


def test_asleep_most_properties_are_busy_until_it_is_woken() -> None:
    bench = Bench(options=ThetaOptions(asleep=True))
    describe = Operation.GET_DEVICE_PROP_DESC
    codes = {p: bench.host.call(describe, p).code for p in RECORDING.codes("properties")}
    assert {p for p, code in codes.items() if code == OK} == set(READABLE_WHILE_BUSY)
    assert set(codes.values()) == {OK, BUSY}
    assert bench.host.call(Operation.INITIATE_CAPTURE, 0, 0).code == BUSY
    assert set_raw(bench, RicohProp.SLEEP_MODE, "00") == OK
    assert bench.host.call(Operation.GET_DEVICE_PROP_VALUE, Prop.F_NUMBER).code == BUSY, "waking takes its time"
    bench.clock.sleep(THETA_TIMING.wake_s)
    assert bench.host.call(Operation.GET_DEVICE_PROP_VALUE, Prop.F_NUMBER).code == OK


@pytest.mark.parametrize("remembers", [False, True])
def test_idle_for_the_sleep_delay_it_forgets_its_settings(remembers: bool) -> None:
    bench = Bench(options=ThetaOptions(later_firmware=True))
    bench.manual()
    set_raw(bench, RicohProp.MODE_MEMORY, f"{remembers:02x}")
    bench.clock.sleep(181)
    assert bench.host.call(Operation.GET_DEVICE_PROP_VALUE, RicohProp.SLEEP_MODE).data == b"\1"
    set_raw(bench, RicohProp.SLEEP_MODE, "00")
    bench.clock.sleep(2)
    assert bench.host.get(Prop.EXPOSURE_PROGRAM_MODE) == (b"\1\0" if remembers else b"\2\0")


def test_sleep_delay_zero_keeps_it_awake_until_auto_power_off() -> None:
    bench = Bench()
    set_raw(bench, RicohProp.SLEEP_DELAY, "0000")
    bench.clock.sleep(64000)
    assert bench.host.get(RicohProp.SLEEP_MODE) == b"\0"
    bench.clock.sleep(64801)
    bench.camera.advance()
    assert not bench.camera.plugged
    assert list(bench.backend.enumerate_devices()) == []


def test_a_capture_is_taken_as_set_and_takes_its_time() -> None:
    bench = Bench()
    bench.manual()
    released_s = bench.clock.monotonic_s()
    handle = bench.shoot()
    (record,) = bench.camera.exposure_log
    assert record.start_s - released_s == pytest.approx(THETA_TIMING.release_lag_s, abs=0.004)
    assert record.end_s - record.start_s == pytest.approx(1 / 64), "the true time is a power of two"
    assert (record.iso, record.f_number, record.color_temperature_k) == (100, 5.6, 6500)
    jpeg = bench.host.call(Operation.GET_OBJECT, handle).data
    assert exposure_time(jpeg) == pytest.approx(1 / 60)
    assert (bench.shots.requests[0].width_px, bench.shots.requests[0].height_px) == (6720, 3360)
    info = bench.host.call(Operation.GET_OBJECT_INFO, handle).data
    assert struct.unpack_from("<IHHI", info) == (0x00020001, 0x3801, 0, len(jpeg))
    assert "R0010001.JPG".encode("utf-16-le") in info


def test_while_exposing_it_is_busy() -> None:
    bench = Bench(options=ThetaOptions(later_firmware=True))
    bench.manual()
    set_raw(bench, RicohProp.SHUTTER_SPEED, "04000000 01000000")
    bench.host.call(Operation.INITIATE_CAPTURE, 0, 0)
    bench.clock.sleep(1)
    assert bench.host.call(Operation.INITIATE_CAPTURE, 0, 0).code == BUSY
    assert set_raw(bench, Prop.EXPOSURE_INDEX, "6400") == BUSY
    assert bench.host.get(RicohProp.EXPOSURE_STATUS) == b"\1"
    bench.clock.sleep(3.5)
    assert bench.host.get(RicohProp.EXPOSURE_STATUS) == b"\2"
    bench.clock.sleep(THETA_TIMING.processing_s)
    assert bench.host.get(RicohProp.EXPOSURE_STATUS) == b"\0"


@pytest.mark.parametrize("together", [True, False])
def test_transfers_while_exposing_are_an_option(together: bool) -> None:
    bench = Bench(timing=replace(THETA_TIMING, transfer_while_exposing=together))
    handle = bench.shoot()
    bench.host.call(Operation.INITIATE_CAPTURE, 0, 0)
    assert bench.host.call(Operation.GET_OBJECT, handle).code == (OK if together else BUSY)
    assert bench.host.call(Operation.GET_PARTIAL_OBJECT, handle, 0, 10).code == (OK if together else BUSY)


def test_raw_plus_announces_two_objects() -> None:
    bench = Bench(timing=replace(THETA_TIMING, raw_cycle_s=0.0))
    set_raw(bench, RicohProp.IMAGE_FORMAT, "01")
    first = bench.shoot()
    formats = [
        struct.unpack_from("<IH", bench.host.call(Operation.GET_OBJECT_INFO, h).data)[1] for h in (first, first + 1)
    ]
    assert formats == [0x3801, 0x3811]


def test_a_transfer_takes_the_time_of_its_bytes() -> None:
    bench = Bench(padding=5_000_000)
    handle = bench.shoot()
    before_s = bench.clock.monotonic_s()
    data = bench.host.call(Operation.GET_OBJECT, handle).data
    assert bench.clock.monotonic_s() - before_s == pytest.approx(len(data) / 25e6, rel=0.02)


def test_partial_objects() -> None:
    bench = Bench()
    handle = bench.shoot()
    whole = bench.host.call(Operation.GET_OBJECT, handle).data
    part = bench.host.call(Operation.GET_PARTIAL_OBJECT, handle, 500, 100)
    assert (part.params, part.data) == ((100,), whole[500:600])
    rest = bench.host.call(Operation.GET_PARTIAL_OBJECT, handle, len(whole) - 7, 100)
    assert (rest.params, rest.data) == ((7,), whole[-7:])
    assert bench.host.call(Operation.GET_PARTIAL_OBJECT, handle, len(whole) + 1, 1).code == Response.INVALID_PARAMETER


def test_listing_and_deleting() -> None:
    bench = Bench()
    handle = bench.shoot()
    handles = bench.host.call(Operation.GET_OBJECT_HANDLES, 0xFFFFFFFF, 0x3801, 0).data
    assert handles == struct.pack("<II", 1, handle)
    assert bench.host.call(Operation.GET_NUM_OBJECTS, 0xFFFFFFFF, 0, 0xFFFFFFFF).params == (1,), "DCIM, at the root"
    assert bench.host.call(Operation.DELETE_OBJECT, handle, 0).code == OK
    assert bench.host.call(Operation.GET_OBJECT, handle).code == Response.INVALID_OBJECT_HANDLE
    assert bench.host.call(Operation.GET_OBJECT, 0x62).code == Response.INVALID_OBJECT_HANDLE, "a folder"


def test_image_size_reports_storage_but_own_changes_are_not_echoed() -> None:
    bench = Bench()
    bench.host.set(Prop.IMAGE_SIZE, bytes([9]) + "1920x960\0".encode("utf-16-le"))
    assert bench.host.event()[:2] == (Event.STORAGE_INFO_CHANGED, 0)
    set_raw(bench, Prop.EXPOSURE_PROGRAM_MODE, "0100")
    with pytest.raises(OSError, match="timed out"):
        bench.host.event(100)


def test_the_clock_can_be_set_and_runs() -> None:
    bench = Bench()
    text = "20240102T030405+0900"
    bench.host.set(Prop.DATE_TIME, bytes([21]) + (text + "\0").encode("utf-16-le"))
    bench.clock.sleep(10)
    assert bench.host.get(Prop.DATE_TIME)[1:].decode("utf-16-le").rstrip("\0") == "20240102T030415+0900"


def test_a_self_timer_can_be_stopped() -> None:
    bench = Bench()
    set_raw(bench, Prop.CAPTURE_DELAY, "10270000")
    bench.host.call(Operation.INITIATE_CAPTURE, 0, 0)
    assert bench.host.get(RicohProp.CAPTURE_STATUS) == b"\2"
    assert bench.host.call(0x99A2).code == OK
    bench.clock.sleep(20)
    assert bench.host.get(RicohProp.CAPTURE_STATUS) == b"\0"
    assert (bench.camera.exposure_log, list(bench.camera.store.files())) == ([], [])
    assert bench.host.call(0x99A2).code == Response.CAPTURE_ALREADY_TERMINATED


def test_only_single_stills_start_with_initiate_capture() -> None:
    bench = Bench()
    set_raw(bench, Prop.STILL_CAPTURE_MODE, "0300")
    assert bench.host.call(Operation.INITIATE_CAPTURE, 0, 0).code == BUSY


def test_a_picture_outlives_the_cable() -> None:
    bench = Bench()
    bench.host.call(Operation.INITIATE_CAPTURE, 0, 0)
    bench.camera.unplug(replug_after_s=5)
    bench.clock.sleep(6)
    again = RawHost(bench.backend, ricoh_codes.USB_ID)
    again.open()
    assert again.call(Operation.GET_OBJECT_HANDLES, 0xFFFFFFFF, 0x3801, 0).data[:4] == b"\1\0\0\0"
    with pytest.raises(OSError, match="timed out"):
        again.event(100)


def test_the_same_seed_gives_the_same_moments() -> None:
    def starts(seed: int) -> list[float]:
        bench = Bench(seed=seed)
        for _ in range(3):
            bench.shoot()
        return [r.start_s for r in bench.camera.exposure_log]

    assert starts(1) == starts(1)
    assert starts(1) != starts(2)


def test_power_down_takes_it_off_the_bus() -> None:
    bench = Bench()
    assert bench.host.call(Operation.POWER_DOWN).code == OK
    bench.clock.sleep(1)
    bench.camera.advance()
    assert not bench.camera.plugged
