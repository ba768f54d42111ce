"""The simulated 5D Mark II over the real pyusb: event stream, modes, busy rules, button (libgphoto2; a 60D's log)."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2.codes import CanonEvent, CanonOperation, CanonProp, CanonResponse
from drivers.ptp.codes import Event, Operation, Response
from mocks.instruments.canon_5d2 import CANON_TIMING, CanonOptions, SimulatedCanon5D2
from mocks.instruments.canon_records import object_added, transfer_requested
from mocks.instruments.faults import Fault, FaultSchedule
from mocks.instruments.ptp.datasets import StoredObject
from mocks.instruments.recorded import recording
from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.mocks.instruments.fault_dicts import fault_of
from tests.mocks.instruments.raw_host import RawHost, Reply
from tests.mocks.optics.shot_sources import TinyShots, exposure_time
from tests.virtual_clock import VirtualClock

OK, BUSY = Response.OK, Response.DEVICE_BUSY
EMPTY = bytes.fromhex("08 00 00 00 00 00 00 00")
RAW_AND_JPEG = "02000000 10000000 06000000 00000000 04000000 10000000 01000000 00000000 03000000"


class Bench:
    """A 5D2, its clock and a host in remote and event mode; keyword arguments are the camera's."""

    def __init__(self, *faults: Fault, remote: bool = True, **how: object) -> None:
        self.clock = VirtualClock()
        self.shots = TinyShots()
        self.camera = SimulatedCanon5D2(self.shots, self.clock, faults=FaultSchedule.of(*faults), **how)  # type: ignore[arg-type]
        self.backend = SimulatedUsbBackend([self.camera], self.clock)
        self.host = RawHost(self.backend, canon_codes.USB_ID)
        self.host.open()
        if remote:
            for operation in (CanonOperation.SET_REMOTE_MODE, CanonOperation.SET_EVENT_MODE):
                assert self.host.call(operation, 1).code == OK
            self.drain()

    def stream(self) -> bytes:
        reply = self.host.call(CanonOperation.GET_EVENT)
        assert reply.code == OK
        return reply.data

    def drain(self) -> list[tuple[int, bytes]]:
        """Return the records waiting: (code, payload)."""
        data, records, at = self.stream(), [], 0
        while True:
            size, code = struct.unpack_from("<II", data, at)
            assert 8 <= size <= len(data) - at
            if code == 0:
                assert (size, at + 8) == (8, len(data))
                return records
            records.append((code, data[at + 8 : at + size]))
            at += size

    def value(self, prop: int, value: int | str) -> Reply:
        """Send SetDevicePropValueEx with a number or with the hex of a structure."""
        body = struct.pack("<I", value) if isinstance(value, int) else bytes.fromhex(value)
        return self.host.call(
            CanonOperation.SET_DEVICE_PROP_VALUE_EX, data=struct.pack("<II", 8 + len(body), prop) + body
        )

    def to_computer(self) -> None:
        assert self.value(CanonProp.CAPTURE_DESTINATION, 4).code == OK
        assert self.host.call(CanonOperation.PC_HDD_CAPACITY, 0x0FFFFFFF, 0x1000, 1).code == OK
        self.drain()

    def press(self, *params: int) -> int:
        return self.host.call(CanonOperation.REMOTE_RELEASE_ON, *params).code

    def release(self, *params: int) -> int:
        return self.host.call(CanonOperation.REMOTE_RELEASE_OFF, *params).code

    def shoot(self) -> list[tuple[int, bytes]]:
        """Take a picture and return the records it caused, up to idle."""
        assert (self.press(1, 0), self.press(2, 0), self.release(2), self.release(1)) == (OK, OK, OK, OK)
        records: list[tuple[int, bytes]] = []
        while (CanonEvent.CAMERA_STATUS_CHANGED, bytes(4)) not in records:
            self.clock.sleep(0.1)
            records += self.drain()
        return records


def numbers(payload: bytes) -> tuple[int, ...]:
    return struct.unpack(f"<{len(payload) // 4}I", payload[: len(payload) // 4 * 4])


def codes(records: list[tuple[int, bytes]]) -> list[int]:
    return [code for code, _ in records]


def handles(records: list[tuple[int, bytes]], code: int) -> list[int]:
    return [numbers(payload)[0] for c, payload in records if c == code]


def test_interface_and_device_info() -> None:
    bench = Bench(remote=False)
    assert (bench.host.bulk_in, bench.host.bulk_out, bench.host.interrupt) == (0x81, 0x02, 0x83)
    assert bench.host.event_packet == 8
    data = bench.host.call(Operation.GET_DEVICE_INFO).data
    assert data[:11] == bytes.fromhex("6400 06000000 c800 00 0000")
    count = struct.unpack_from("<I", data, 11)[0]
    operations = struct.unpack_from(f"<{count}H", data, 15)
    assert operations == recording("eos_5d2").codes("operations")
    assert 0x100E not in operations
    assert bench.host.call(0x100E).code == Response.OPERATION_NOT_SUPPORTED


def test_first_stream_lists_all_values_then_all_lists() -> None:
    bench = Bench(remote=False)
    assert bench.stream() == EMPTY, "no event mode, no events"
    bench.host.call(CanonOperation.SET_REMOTE_MODE, 1)
    bench.host.call(CanonOperation.SET_EVENT_MODE, 1)
    records = bench.drain()
    kinds = codes(records)
    changed = kinds.index(CanonEvent.AVAIL_LIST_CHANGED)
    assert set(kinds[:changed]) == {CanonEvent.PROP_VALUE_CHANGED}
    assert set(kinds[changed:]) == {CanonEvent.AVAIL_LIST_CHANGED}
    assert [numbers(p)[0] for _, p in records[:6]] == [0xD105, 0xD108, 0xD106, 0xD107, 0xD109, 0xD10A]
    lists = {numbers(p)[0]: numbers(p)[1:3] for _, p in records[changed:]}
    assert lists[0xD102] == (3, 55)
    assert lists[0xD101] == (3, 17)
    assert lists[0xD10A] == (3, 76)
    assert lists[0xD11C] == (3, 3)
    assert lists[0xD105] == (1, 0), "the dial decides"
    assert bench.stream() == EMPTY


def test_the_vectors_of_records() -> None:
    bench = Bench()
    bench.host.tid = 0x14
    bench.camera.excuse_transaction_id()
    bench.host.write(bytes.fromhex("0c 00 00 00 01 00 10 91 14 00 00 00"))
    bench.host.write(bytes.fromhex("18 00 00 00 02 00 10 91 14 00 00 00 0c 00 00 00 02 d1 00 00 68 00 00 00"))
    assert bench.host.read().hex(" ") == "0c 00 00 00 03 00 01 20 14 00 00 00"
    bench.host.tid = 0x15
    assert bench.stream() == bytes.fromhex("10 00 00 00 89 c1 00 00 02 d1 00 00 68 00 00 00") + EMPTY
    image = StoredObject(0x91900001, 0, 0xB103, "IMG_0001.CR2", 0, bytes(25_000_000))
    assert transfer_requested(image).encode().hex(" ") == (
        "2c 00 00 00 86 c1 00 00 01 00 90 91 03 b1 00 00 00 00 00 00 40 78 7d 01 00 00 00 00 "
        "49 4d 47 5f 30 30 30 31 2e 43 52 32 00 00 00 00"
    )
    added = object_added(image).encode()
    assert (len(added), added[0x28:0x34]) == (0x3C, b"IMG_0001.CR2")


def test_a_real_image_format_record() -> None:
    records = Bench(remote=False).camera.settings.value_record(CanonProp.IMAGE_FORMAT)
    assert records.encode() == bytes.fromhex(
        "20 00 00 00 89 C1 00 00 20 D1 00 00 01 00 00 00 10 00 00 00 01 00 00 00 00 00 00 00 03 00 00 00"
    )


def test_changing_the_destination_answers_as_the_log() -> None:
    bench = Bench(options=CanonOptions(destination=4))
    assert bench.value(CanonProp.CAPTURE_DESTINATION, 1).code == OK
    data = bench.stream()
    assert len(data) == 120
    bench.value(CanonProp.CAPTURE_DESTINATION, 4)
    assert [numbers(p)[0] for _, p in bench.drain()] == [0xD11B, 0xD11C, 0xD120, 0xD11E, 0xD11C, 0xD11F]


def test_destination_already_set_is_busy() -> None:
    assert Bench().value(CanonProp.CAPTURE_DESTINATION, 1).code == BUSY


@pytest.mark.parametrize(
    ("prop", "value", "code"),
    [
        (CanonProp.SHUTTER_SPEED, 0x11, Response.INVALID_PROP_VALUE),
        (CanonProp.APERTURE, 0x58, Response.INVALID_PROP_VALUE),
        (CanonProp.AUTO_EXPOSURE_MODE, 0, Response.ACCESS_DENIED),
        (CanonProp.SERIAL_NUMBER, "41 00", Response.ACCESS_DENIED),
        (0xD1FF, 0, Response.DEVICE_PROP_NOT_SUPPORTED),
        (CanonProp.ISO_SPEED, "50", Response.INVALID_DATASET),
        (CanonProp.IMAGE_FORMAT, "01000000", Response.INVALID_DATASET),
        (CanonProp.IMAGE_FORMAT, RAW_AND_JPEG, OK),
        (CanonProp.OWNER, "61 62 00", OK),
    ],
)
def test_settings_are_checked(prop: int, value: int | str, code: int) -> None:
    assert Bench().value(prop, value).code == code


def test_a_lying_total_is_refused() -> None:
    reply = Bench().host.call(CanonOperation.SET_DEVICE_PROP_VALUE_EX, data=struct.pack("<III", 16, 0xD102, 0x68))
    assert reply.code == Response.INVALID_DATASET


def test_remote_mode_is_needed() -> None:
    bench = Bench(remote=False)
    assert bench.value(CanonProp.SHUTTER_SPEED, 0x68).code == CanonResponse.OPERATION_REFUSED
    assert bench.press(3, 0) == CanonResponse.OPERATION_REFUSED
    assert bench.host.call(CanonOperation.REMOTE_RELEASE).code == CanonResponse.OPERATION_REFUSED


def test_undrained_events_make_it_busy() -> None:
    bench = Bench()
    bench.value(CanonProp.ISO_SPEED, 0x50)
    assert bench.value(CanonProp.SHUTTER_SPEED, 0x68).code == BUSY
    assert bench.press(3, 0) == BUSY
    bench.drain()
    assert bench.press(3, 0) == OK


def test_the_interrupt_pipe_says_poll_now() -> None:
    bench = Bench()
    assert bench.host.event()[0] == CanonEvent.REQUEST_GET_EVENT
    bench.value(CanonProp.ISO_SPEED, 0x50)
    assert bench.host.event()[0] == CanonEvent.REQUEST_GET_EVENT


def test_a_requested_property_comes_as_an_event() -> None:
    bench = Bench()
    assert bench.host.call(CanonOperation.REQUEST_DEVICE_PROP_VALUE, CanonProp.SERIAL_NUMBER).code == OK
    ((code, payload),) = bench.drain()
    assert (code, payload) == (
        CanonEvent.PROP_VALUE_CHANGED,
        bytes.fromhex("af d1 00 00") + b"0123456789abcdef0123456789abcdef\0",
    )


def test_card_capture() -> None:
    bench = Bench()
    for prop, value in ((0xD102, 0x68), (0xD101, 0x48), (0xD103, 0x50), (0xD109, 9), (0xD10A, 6500)):
        assert bench.value(prop, value).code == OK
        bench.drain()
    pressed_s = bench.clock.monotonic_s()
    records = bench.shoot()
    assert codes(records)[0] == CanonEvent.CAMERA_STATUS_CHANGED
    (handle,) = handles(records, CanonEvent.OBJECT_ADDED_EX)
    (record,) = bench.camera.exposure_log
    assert record.start_s - pressed_s == pytest.approx(CANON_TIMING.release_lag_s, abs=0.01)
    assert record.end_s - record.start_s == pytest.approx(1 / 64)
    assert (record.iso, record.f_number, record.color_temperature_k) == (200, 16, 6500)
    jpeg = bench.host.call(CanonOperation.GET_OBJECT, handle).data
    assert exposure_time(jpeg) == pytest.approx(1 / 60)
    assert bench.host.call(CanonOperation.GET_PARTIAL_OBJECT, handle, 10, 20).data == jpeg[10:30]
    assert bench.host.call(Operation.DELETE_OBJECT, handle).code == OK
    assert (CanonEvent.OBJECT_REMOVED, struct.pack("<I", handle)) in bench.drain()
    events = [bench.host.event() for _ in range(2)]
    while events[-1][0] == CanonEvent.REQUEST_GET_EVENT:
        events.append(bench.host.event())
    assert events[-1] == (Event.OBJECT_REMOVED, 0, (handle,))


def test_computer_capture_stays_busy_until_fetched() -> None:
    bench = Bench()
    bench.to_computer()
    bench.value(CanonProp.IMAGE_FORMAT, RAW_AND_JPEG)
    bench.drain()
    records = bench.shoot()
    assert handles(records, CanonEvent.OBJECT_ADDED_EX) == []
    first, second = handles(records, CanonEvent.REQUEST_OBJECT_TRANSFER)
    assert first == 0x91900001
    assert bench.host.call(Operation.GET_PARTIAL_OBJECT, first, 0, 4).data == b"II*\0"
    for handle in (first, second):
        assert bench.press(3, 0) == BUSY
        assert bench.value(CanonProp.SHUTTER_SPEED, 0x60).code == BUSY
        assert bench.host.call(CanonOperation.TRANSFER_COMPLETE, handle).code == OK
    assert bench.host.call(CanonOperation.TRANSFER_COMPLETE, first).code == Response.INVALID_OBJECT_HANDLE
    assert bench.press(3, 0) == OK


def test_an_unfetched_picture_is_lost_with_the_cable() -> None:
    bench = Bench()
    bench.to_computer()
    bench.shoot()
    bench.camera.unplug(replug_after_s=1)
    bench.clock.sleep(2)
    assert bench.camera.memory == {}


def test_the_computer_must_offer_room() -> None:
    bench = Bench()
    bench.value(CanonProp.CAPTURE_DESTINATION, 4)
    bench.drain()
    assert bench.press(3, 0) == Response.STORE_FULL
    assert bench.host.call(CanonOperation.REMOTE_RELEASE).params == (7,)


def test_pc_capacity_repeats_the_shots_for_card_and_computer() -> None:
    bench = Bench()
    bench.value(CanonProp.CAPTURE_DESTINATION, 4)
    bench.drain()
    bench.host.call(CanonOperation.PC_HDD_CAPACITY, 0x0FFFFFFF, 0x1000, 1)
    shots = [numbers(p) for _, p in bench.drain()]
    assert shots == [(0xD11B, 1600), (0xD11B, 0x0FFFFFFF * 0x1000 // 10_000_000)]


def test_while_exposing_it_is_busy() -> None:
    bench = Bench()
    bench.value(CanonProp.SHUTTER_SPEED, 0x28)
    bench.drain()
    assert bench.press(3, 0) == OK
    assert bench.drain() == [(CanonEvent.CAMERA_STATUS_CHANGED, b"\1\0\0\0")]
    for call in (CanonOperation.RESET_UI_LOCK, CanonOperation.AF_CANCEL, CanonOperation.REMOTE_RELEASE):
        assert bench.host.call(call).code == BUSY
    assert bench.value(CanonProp.ISO_SPEED, 0x48).code == BUSY
    bench.clock.sleep(5)
    assert bench.host.call(CanonOperation.RESET_UI_LOCK).code == OK


def test_a_held_button_does_not_fire_again() -> None:
    bench = Bench()
    bench.press(3, 0)
    bench.clock.sleep(2)
    bench.drain()
    assert bench.press(2, 0) == BUSY
    bench.release(3)
    assert bench.press(3, 0) == OK
    assert len(bench.camera.exposure_log) == 2


def test_autofocus_takes_its_time_and_says_so() -> None:
    bench = Bench(options=CanonOptions(lens_manual=False), timing=replace(CANON_TIMING, focus_s=3.0))
    pressed_s = bench.clock.monotonic_s()
    bench.press(1, 0)
    assert bench.drain() == []
    bench.clock.sleep(3)
    ((code, payload),) = bench.drain()
    assert (code, numbers(payload)[0]) == (CanonEvent.PROP_VALUE_CHANGED, CanonProp.FOCUS_INFO_EX)
    assert bench.press(2, 0) == OK
    assert bench.camera.exposure_log[0].start_s - pressed_s > 3


def test_no_focus_no_picture() -> None:
    bench = Bench(options=CanonOptions(lens_manual=False, focus_finds=False))
    assert bench.host.call(CanonOperation.REMOTE_RELEASE).params == (1,)
    bench.press(1, 0)
    bench.clock.sleep(1)
    bench.drain()
    assert bench.press(2, 0) == CanonResponse.OPERATION_REFUSED
    bench.release(3)
    assert bench.press(3, 1) == OK, "without autofocus it opens"


def test_bulb() -> None:
    bench = Bench(options=CanonOptions(ae_mode=4))
    assert bench.host.call(CanonOperation.BULB_START).params == (0,)
    bench.drain()
    bench.clock.sleep(12)
    assert bench.host.call(CanonOperation.KEEP_DEVICE_ON).code == OK
    assert bench.host.call(CanonOperation.BULB_END).params == (0,)
    assert bench.camera.exposure_log[0].end_s - bench.camera.exposure_log[0].start_s == pytest.approx(12, abs=0.1)
    bench.clock.sleep(2)
    assert CanonEvent.OBJECT_ADDED_EX in codes(bench.drain())
    assert Bench().host.call(CanonOperation.BULB_START).code == CanonResponse.OPERATION_REFUSED, "the dial is on M"


@pytest.mark.parametrize(("kept_on", "there"), [(True, True), (False, False)])
def test_it_switches_itself_off_unless_kept_on(kept_on: bool, there: bool) -> None:
    bench = Bench()
    seen: list[int] = []
    for _ in range(12):
        bench.clock.sleep(10)
        bench.camera.advance()
        if not bench.camera.plugged:
            break
        seen += codes(bench.drain())
        if kept_on:
            assert bench.host.call(CanonOperation.KEEP_DEVICE_ON).code == OK
    assert bench.camera.plugged is there
    assert (CanonEvent.WILL_SOON_SHUTDOWN in seen) is not kept_on
    bench.camera.replug()
    assert bench.camera.plugged


def test_extended_listings() -> None:
    bench = Bench()
    bench.shoot()
    data = bench.host.call(CanonOperation.GET_OBJECT_INFO_EX, 0x00010001, 0xFFFFFFFF, 0x00100000).data
    count, length, folder = struct.unpack_from("<III", data)
    assert (count, length, len(data)) == (1, 0x38, 4 + 0x38)
    assert data[4 + 0x24 :].startswith(b"DCIM\0")
    assert folder == 0x90000000
    info = bench.host.call(CanonOperation.GET_DEVICE_INFO_EX).data
    assert struct.unpack_from("<II", info)[1] == len(CanonEvent)


def test_the_lens_and_the_dial_are_reported() -> None:
    bench = Bench(options=CanonOptions(lens_manual=False, ae_mode=2))
    values = bench.camera.settings.values
    assert (values[CanonProp.FOCUS_MODE], values[CanonProp.AUTO_EXPOSURE_MODE]) == (0, 2)
    assert bench.value(CanonProp.SHUTTER_SPEED, 0x68).code == Response.INVALID_PROP_VALUE
    assert bench.value(CanonProp.APERTURE, 0x48).code == OK


def test_records_of_the_stream_cannot_stall() -> None:
    with pytest.raises(ValueError, match="stall"):
        Bench(fault_of({"kind": "stall", "event": 0xC181, "phase": "event"}))
