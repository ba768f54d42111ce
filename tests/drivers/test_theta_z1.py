"""The Theta Z1 driver against byte-exact dialogues: what it says, in which order, and what it makes of the answers."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Self

import pytest

from drivers.camera import Camera, CameraSettings, FrameFormat, FrameRef
from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    ExposureFailedError,
    SettingRefusedError,
    StoreFullError,
    UnsupportedError,
)
from drivers.theta_z1.camera import ThetaZ1
from tests.drivers.dialogue import BUSY, OK, Dialogue, device_info, enumeration, object_info, ptp_string, u32_array
from tests.drivers.scripted import FakeClock, Reopen, Reset, ScriptedTransport, Step, command, data, event

OPERATIONS = (
    0x1001,
    0x1002,
    0x1003,
    0x1004,
    0x1005,
    0x1007,
    0x1008,
    0x1009,
    0x100B,
    0x100E,
    0x1014,
    0x1015,
    0x1016,
    0x101B,
)
PROPERTIES = (
    0x5001,
    0x5002,
    0x5003,
    0x5005,
    0x5007,
    0x500E,
    0x500F,
    0x5011,
    0x5012,
    0x5013,
    0xD006,
    0xD00F,
    0xD803,
    0xD808,
    0xD80B,
    0xD80E,
    0xD813,
    0xD81B,
    0xD824,
    0xD825,
    0xD827,
    0xD834,
    0xD83E,
)
TEXTS = ("Ricoh Company, Ltd.", "RICOH THETA Z1", "2.20.3", "10012345")
LENGTHS = {
    0x5001: "B",
    0xD808: "B",
    0xD80B: "B",
    0xD80E: "B",
    0xD824: "B",
    0xD825: "B",
    0xD827: "B",
    0xD83E: "B",
    0x5012: "I",
    0xD006: "I",
    0xD81B: "I",
    0xD00F: "Q",
}
"""Properties that are no u16."""
PAPER = CameraSettings(iso=100, f_number=5.6, color_temperature_k=6500, width_px=6720, height_px=3360)
FRACTIONS = [(n, d) for n, d in [(4, 1), (1, 1), (1, 4), (1, 15), (1, 60), (1, 250), (1, 8000)]]
OLD = (0x64, 0x65)
"""Handles on the camera before the bracket."""


def number(prop: int, value: int) -> bytes:
    return struct.pack("<" + LENGTHS.get(prop, "H"), value)


class ThetaDialogue(Dialogue):
    """The camera's usual answers."""

    def __init__(self, properties: Sequence[int] = PROPERTIES) -> None:
        super().__init__()
        self.properties = properties

    def get(self, prop: int, value: int) -> Self:
        self.ask(0x1015, prop, gives=number(prop, value))
        return self

    def set(self, prop: int, value: int, reads: int | None = None) -> Self:
        """Write, then read back."""
        self.ask(0x1016, prop, sends=number(prop, value))
        return self.get(prop, value if reads is None else reads)

    def wake(self) -> Self:
        self.get(0xD80E, 0)
        self.ask(0x1016, 0xD80E, sends=b"\0")
        return self.get(0x500E, 2)

    def ready(self) -> Self:
        self.get(0xD808, 0)
        return self.get(0xD83E, 0) if 0xD83E in self.properties else self

    def handles(self, *handles: int) -> Self:
        self.ask(0x1007, 0xFFFFFFFF, 0, 0, gives=u32_array(handles))
        return self

    def shutter_list(self) -> Self:
        values = [d << 32 | n for n, d in FRACTIONS]
        self.ask(0x1014, 0xD00F, gives=enumeration(0xD00F, 8, "Q", [0, *values]))
        return self

    def connect(self, operations: Sequence[int] = OPERATIONS) -> Self:
        self.open()
        self.ask(0x1001, gives=device_info(6, operations, self.properties, TEXTS))
        self.wake().ready()
        if 0xD83E not in self.properties:
            self.get(0x5013, 1).ask(0x1016, 0x5013, sends=number(0x5013, 1))
        return self.handles(*OLD).shutter_list()

    def modes(self) -> Self:
        self.wake().ready().get(0xD803, 180).get(0xD81B, 64800)
        self.set(0xD803, 0).set(0xD81B, 0).set(0x5013, 1).set(0xD824, 0).set(0x5012, 0).set(0xD80B, 0)
        return self.set(0x500E, 1)

    def prepare(self, *, f_numbers: Sequence[int] = (0, 210, 350, 560), f_number: int = 560, raw: int = 0) -> Self:
        self.modes()
        self.ask(0x1014, 0x5007, gives=enumeration(0x5007, 4, "H", f_numbers))
        size = ptp_string("6720x3360")
        self.ask(0x1016, 0x5003, sends=size).ask(0x1015, 0x5003, gives=size)
        self.set(0xD827, raw)
        if 0xD834 in self.properties:
            self.set(0xD834, 3)
        self.set(0xD825, 4).set(0x5005, 0x8007).set(0xD813, 6500).set(0x5007, f_number).set(0x500F, 100)
        return self.shutter_list().handles(*OLD)

    def witnesses(self) -> Self:
        return self.get(0x500E, 1).get(0x5005, 0x8007).get(0xD813, 6500).get(0x5007, 560).get(0x500F, 100)

    def awake(self) -> Self:
        return self.get(0xD80E, 0).ready().witnesses()

    def shutter(self, n: int, d: int) -> Self:
        self.awake()
        return self.set(0xD00F, d << 32 | n)

    def release(self, answer: int = OK) -> Self:
        self.ready()
        self.ask(0x100E, 0, 0, answer=answer)
        return self

    def looks_at(self, handle: int, name: str = "R0010007.JPG", fmt: int = 0x3801, size: int = 9000) -> Self:
        self.ask(0x1008, handle, gives=object_info(name, fmt, size))
        return self


Start = Callable[[ThetaDialogue], tuple[ThetaZ1, ScriptedTransport]]


@pytest.fixture
def start() -> Start:
    def begin(dialogue: ThetaDialogue) -> tuple[ThetaZ1, ScriptedTransport]:
        clock = FakeClock()
        transport = dialogue.transport(clock)
        return ThetaZ1(lambda: transport, clock), transport

    return begin


@pytest.fixture
def armed() -> ThetaDialogue:
    """Connected, prepared, set to 1/60 s."""
    return ThetaDialogue().connect().prepare().shutter(1, 60)


def ready_to_fire(camera: ThetaZ1) -> None:
    camera.connect()
    camera.prepare(PAPER)
    camera.set_shutter(1 / 60)
    camera.arm()


def test_published_vectors_are_what_the_scripts_are_made_of() -> None:
    assert command(0x1016, 9, 0xD00F) == bytes.fromhex("10000000 0100 1610 09000000 0fd00000")
    sent = data(0x1016, 9, number(0xD00F, 60 << 32 | 1))
    assert sent == bytes.fromhex("14000000 0200 1610 09000000 01000000 3c000000")
    assert command(0x100E, 10, 0, 0) == bytes.fromhex("14000000 0100 0e10 0a000000 00000000 00000000")
    assert event(0x4002, 10, 0x64) == bytes.fromhex("10000000 0400 0240 0a000000 64000000")
    assert event(0x400D, 10, 10) == bytes.fromhex("10000000 0400 0d40 0a000000 0a000000")


def test_one_whole_frame(start: Start, armed: ThetaDialogue) -> None:
    armed.release().event(0x4002, 0x66).event(0x400D, armed.last_id)
    armed.looks_at(0x66)
    armed.ask(0x101B, 0x66, 0, 6000, gives=b"a" * 6000, results=(6000,))
    armed.ask(0x101B, 0x66, 6000, 3000, gives=b"b" * 3000, results=(3000,))
    armed.looks_at(0x66).ask(0x100B, 0x66, 0)
    armed.ask(0x1016, 0xD803, sends=number(0xD803, 180)).ask(0x1016, 0xD81B, sends=number(0xD81B, 64800))
    armed.ask(0x1003)
    camera, transport = start(armed)
    assert isinstance(camera, Camera)

    identity = camera.connect()
    assert (identity.model, identity.serial, identity.firmware) == ("RICOH THETA Z1", "10012345", "2.20.3")
    assert camera.shutter_times_s == tuple(n / d for n, d in FRACTIONS)
    readbacks = camera.prepare(PAPER)
    assert all(r.honoured for r in readbacks)
    assert {r.name: r.got for r in readbacks}["f-number"] == "f/5.6"
    shutter = camera.set_shutter(1 / 60)
    assert (shutter.asked_s, shutter.nominal_s, shutter.raw) == (1 / 60, 1 / 60, "1/60")
    camera.arm()
    camera.release()
    progress = camera.poll_exposure()
    assert progress.done
    (frame,) = progress.frames
    assert frame == FrameRef(0x66, "R0010007.JPG", FrameFormat.JPEG, 9000, 0x00020001)
    assert camera.read_chunk(frame, 0, 6000) + camera.read_chunk(frame, 6000, 3000) == b"a" * 6000 + b"b" * 3000
    camera.finish_frame(frame)
    camera.delete(frame)
    camera.close()
    transport.assert_finished()
    assert transport.closed


def test_index_form_of_f_number(start: Start) -> None:
    camera, transport = start(ThetaDialogue().connect().prepare(f_numbers=(0, 1, 2, 3), f_number=3))
    camera.connect()
    readbacks = {r.name: r for r in camera.prepare(PAPER)}
    assert (readbacks["f-number"].got, readbacks["f-number"].raw) == ("f/5.6", "3")
    transport.assert_finished()


def test_unknown_form_of_f_number_is_refused(start: Start) -> None:
    dialogue = ThetaDialogue().connect().modes()
    dialogue.ask(0x1014, 0x5007, gives=enumeration(0x5007, 4, "H", (0, 56)))
    camera, transport = start(dialogue)
    camera.connect()
    with pytest.raises(SettingRefusedError, match="lists \\[0, 56\\]"):
        camera.prepare(PAPER)
    transport.assert_finished()


def test_sleeping_camera_is_woken_with_patience(start: Start) -> None:
    dialogue = ThetaDialogue()
    dialogue.open().ask(0x1001, gives=device_info(6, OPERATIONS, PROPERTIES, TEXTS))
    dialogue.get(0xD80E, 1)
    dialogue.ask(0x1016, 0xD80E, sends=b"\0", answer=BUSY)
    dialogue.get(0xD80E, 1).ask(0x1016, 0xD80E, sends=b"\0")
    dialogue.ask(0x1015, 0x500E, answer=BUSY)
    dialogue.wake().ready().handles().shutter_list()
    camera, transport = start(dialogue)
    before_s = transport.clock.now_s
    camera.connect()
    assert 2.0 <= transport.clock.now_s - before_s < 3.0
    transport.assert_finished()


def test_camera_that_does_not_wake_is_named_within_its_limit(start: Start) -> None:
    dialogue = ThetaDialogue()
    dialogue.open().ask(0x1001, gives=device_info(6, OPERATIONS, PROPERTIES, TEXTS))
    for _ in range(11):
        dialogue.get(0xD80E, 1).ask(0x1016, 0xD80E, sends=b"\0", answer=BUSY)
    camera, transport = start(dialogue)
    with pytest.raises(DeviceBusyError, match="wake it by its power button"):
        camera.connect()
    transport.assert_finished()


def test_no_static_stitching_is_reported_not_hidden(start: Start) -> None:
    old_firmware = tuple(p for p in PROPERTIES if p not in (0xD834, 0xD83E))
    camera, transport = start(ThetaDialogue(old_firmware).connect().prepare())
    camera.connect()
    (dishonoured,) = [r for r in camera.prepare(PAPER) if not r.honoured]
    assert (dishonoured.name, dishonoured.asked) == ("stitching", "static")
    transport.assert_finished()


def test_setting_that_takes_at_the_second_attempt(start: Start) -> None:
    dialogue = ThetaDialogue().connect().prepare().awake()
    dialogue.set(0xD00F, 60 << 32 | 1, reads=15 << 32 | 1).set(0xD00F, 60 << 32 | 1)
    camera, transport = start(dialogue)
    camera.connect()
    camera.prepare(PAPER)
    assert camera.set_shutter(1 / 60).raw == "1/60"
    transport.assert_finished()


def test_setting_that_never_takes_is_refused(start: Start) -> None:
    dialogue = ThetaDialogue().connect().prepare().awake()
    for _ in range(2):
        dialogue.set(0xD00F, 60 << 32 | 1, reads=15 << 32 | 1)
    camera, transport = start(dialogue)
    camera.connect()
    camera.prepare(PAPER)
    with pytest.raises(SettingRefusedError, match="shutter"):
        camera.set_shutter(1 / 60)
    transport.assert_finished()


def test_a_time_that_reads_back_reduced_is_the_one_asked(start: Start) -> None:
    dialogue = ThetaDialogue().connect().prepare().awake()
    dialogue.set(0xD00F, 4 << 32 | 1, reads=8 << 32 | 2)
    camera, transport = start(dialogue)
    camera.connect()
    camera.prepare(PAPER)
    assert camera.set_shutter(0.25).nominal_s == 0.25
    transport.assert_finished()


@pytest.mark.parametrize("iso", [65535, 102_400, 90])
def test_an_iso_that_it_does_not_have_is_refused_and_not_written(start: Start, iso: int) -> None:
    """65535 is its code of the automatic, and larger ones do not fit the property."""
    dialogue = ThetaDialogue().connect().modes()
    dialogue.ask(0x1014, 0x5007, gives=enumeration(0x5007, 4, "H", (0, 210, 350, 560)))
    camera, transport = start(dialogue)
    camera.connect()
    with pytest.raises(SettingRefusedError, match=f"ISO {iso} cannot be set"):
        camera.prepare(replace(PAPER, iso=iso))
    transport.assert_finished()


def test_refused_value_is_a_setting_error(start: Start) -> None:
    dialogue = ThetaDialogue().connect().prepare().awake()
    dialogue.ask(0x1016, 0xD00F, sends=number(0xD00F, 60 << 32 | 1), answer=0x201C)
    camera, transport = start(dialogue)
    camera.connect()
    camera.prepare(PAPER)
    with pytest.raises(SettingRefusedError, match="0x201c"):
        camera.set_shutter(1 / 60)
    transport.assert_finished()


def test_nearest_stop_is_taken_and_both_are_recorded(start: Start) -> None:
    camera, transport = start(ThetaDialogue().connect().prepare().shutter(1, 250))
    camera.connect()
    camera.prepare(PAPER)
    shutter = camera.set_shutter(1 / 200)
    assert (shutter.asked_s, shutter.nominal_s, shutter.raw) == (1 / 200, 1 / 250, "1/250")
    transport.assert_finished()


def test_settings_lost_in_sleep_are_found_before_the_exposure(start: Start) -> None:
    camera, transport = start(ThetaDialogue().connect().prepare().get(0xD80E, 1).wake().ready().get(0x500E, 2))
    camera.connect()
    camera.prepare(PAPER)
    with pytest.raises(SettingRefusedError, match="slept"):
        camera.set_shutter(1 / 60)
    transport.assert_finished()


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan")])
def test_no_time_is_no_shutter(start: Start, wrong: float) -> None:
    camera, transport = start(ThetaDialogue().connect().prepare().awake())
    camera.connect()
    camera.prepare(PAPER)
    with pytest.raises(SettingRefusedError):
        camera.set_shutter(wrong)
    transport.assert_finished()


def test_raw_makes_two_frames_whatever_the_order_of_events(start: Start) -> None:
    dialogue = ThetaDialogue().connect().prepare(raw=1).shutter(1, 60).release()
    dialogue.event(0x400D).event(0x4002, 0x67).event(0x4002, 0x66)
    dialogue.looks_at(0x67, "R0010007.DNG", 0x3811, 40_000_000).looks_at(0x66)
    camera, transport = start(dialogue)
    camera.connect()
    camera.prepare(CameraSettings(100, 5.6, 6500, 6720, 3360, keep_raw=True))
    camera.set_shutter(1 / 60)
    camera.arm()
    camera.release()
    progress = camera.poll_exposure()
    assert progress.done
    assert [f.format for f in progress.frames] == [FrameFormat.JPEG, FrameFormat.DNG]
    transport.assert_finished()


def test_folders_doubled_and_foreign_events_make_no_frame(start: Start, armed: ThetaDialogue) -> None:
    armed.release()
    capture = armed.last_id
    armed.event(0x4002, 0x70).event(0x4006, 0xD808).event(0x4002, OLD[0]).event(0x400D, capture - 5)
    armed.event(0x4002, 0x66).event(0x4002, 0x66)
    armed.looks_at(0x70, "101RICOH", 0x3001, 0).looks_at(0x66)
    armed.event(0x400D, capture, transaction_id=capture)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    first = camera.poll_exposure()
    assert (first.done, [f.handle for f in first.frames]) == (False, [0x66])
    assert camera.poll_exposure().done
    transport.assert_finished()


def test_late_event_of_an_earlier_capture_is_not_this_frame(start: Start, armed: ThetaDialogue) -> None:
    armed.release(answer=BUSY)
    earlier = armed.last_id
    armed.release()
    capture = armed.last_id
    armed.event(0x4002, 0x66, transaction_id=earlier).event(0x4002, 0x67).event(0x400D, capture)
    armed.looks_at(0x67)
    camera, transport = start(armed)
    ready_to_fire(camera)
    with pytest.raises(DeviceBusyError):
        camera.release()
    camera.arm()
    camera.release()
    progress = camera.poll_exposure()
    assert [f.handle for f in progress.frames] == [0x67]
    transport.assert_finished()


def test_stale_events_are_taken_in_before_the_release(start: Start, armed: ThetaDialogue) -> None:
    armed.event(0x4002, 0x66).event(0x400D)
    armed.release().event(0x4002, 0x66).event(0x4002, 0x67).event(0x400D)
    armed.looks_at(0x67)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    assert [f.handle for f in camera.poll_exposure().frames] == [0x67]
    transport.assert_finished()


def poll_until_done(camera: ThetaZ1, transport: ScriptedTransport) -> tuple[tuple[FrameRef, ...], float]:
    begin_s = transport.clock.now_s
    for _ in range(10_000):
        before_s = transport.clock.now_s
        progress = camera.poll_exposure()
        assert transport.clock.now_s - before_s <= 0.05
        if progress.done:
            return progress.frames, transport.clock.now_s - begin_s
    raise AssertionError("never done")


def test_lost_events_are_made_good_from_the_store(start: Start, armed: ThetaDialogue) -> None:
    armed.release()
    armed.handles(*OLD, 0x66).looks_at(0x66).ready()
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    frames, took_s = poll_until_done(camera, transport)
    assert [f.handle for f in frames] == [0x66]
    assert 8.0 <= took_s <= 10.0
    transport.assert_finished()


def test_lost_capture_complete_is_made_good_by_the_cameras_state(start: Start, armed: ThetaDialogue) -> None:
    armed.release().event(0x4002, 0x66)
    armed.looks_at(0x66).get(0xD808, 0).get(0xD83E, 2).ready()
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    frames, took_s = poll_until_done(camera, transport)
    assert [f.handle for f in frames] == [0x66]
    assert 2.0 <= took_s <= 2.2
    transport.assert_finished()


def test_busy_camera_is_asked_for_the_frame_again(start: Start, armed: ThetaDialogue) -> None:
    armed.release().event(0x4002, 0x66).event(0x400D)
    armed.ask(0x1008, 0x66, answer=BUSY).looks_at(0x66)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    assert not camera.poll_exposure().done
    assert camera.poll_exposure().done
    transport.assert_finished()


@pytest.mark.parametrize("answer", [OK, 0x2009, 0x2015], ids=["no bytes yet", "no such object", "no information"])
def test_a_picture_announced_before_it_is_written_is_looked_at_again(
    start: Start, armed: ThetaDialogue, answer: int
) -> None:
    armed.release().event(0x4002, 0x66).event(0x400D)
    armed.looks_at(0x66, size=0) if answer == OK else armed.ask(0x1008, 0x66, answer=answer)
    armed.handles(*OLD, 0x66).looks_at(0x66)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    frames, took_s = poll_until_done(camera, transport)
    assert [(f.handle, f.size_bytes) for f in frames] == [(0x66, 9000)]
    assert took_s < 2.0
    transport.assert_finished()


def test_a_camera_that_still_saves_is_waited_for_before_the_next_stop(start: Start, armed: ThetaDialogue) -> None:
    armed.get(0xD80E, 0).ready().ask(0x1015, 0x500E, answer=BUSY).witnesses().set(0xD00F, 60 << 32 | 1)
    camera, transport = start(armed)
    camera.connect()
    camera.prepare(PAPER)
    camera.set_shutter(1 / 60)
    camera.set_shutter(1 / 60)
    transport.assert_finished()


def test_no_picture_at_all_fails_within_its_limit(start: Start, armed: ThetaDialogue) -> None:
    armed.release()
    for _ in range(18):
        armed.handles(*OLD)
    armed.get(0xD006, 0x00400000)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    with pytest.raises(ExposureFailedError, match="shooting hardware failure"):
        poll_until_done(camera, transport)
    transport.assert_finished()


def test_full_store_is_named(start: Start, armed: ThetaDialogue) -> None:
    armed.release().event(0x400A, 0x00020001).event(0x400D)
    armed.handles(*OLD).ready().get(0xD006, 1)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    with pytest.raises(StoreFullError, match="memory is full"):
        poll_until_done(camera, transport)
    transport.assert_finished()


def test_the_last_picture_that_fits_is_waited_for(start: Start, armed: ThetaDialogue) -> None:
    """StoreFull comes while it is stitched: the store does not show it yet, and the camera is not ready."""
    armed.release().event(0x400A, 0x00020001)
    armed.handles(*OLD).get(0xD808, 1)
    armed.handles(*OLD, 0x70).looks_at(0x70).ready()
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    assert [frame.handle for frame in poll_until_done(camera, transport)[0]] == [0x70]
    transport.assert_finished()


def test_refused_release_is_typed(start: Start, armed: ThetaDialogue) -> None:
    armed.release(answer=0x200C)
    camera, transport = start(armed)
    ready_to_fire(camera)
    with pytest.raises(StoreFullError):
        camera.release()
    transport.assert_finished()


def test_busy_transfer_during_an_exposure_is_not_tried_again(start: Start, armed: ThetaDialogue) -> None:
    armed.release().ask(0x101B, 0x64, 0, 1000, answer=BUSY)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    with pytest.raises(DeviceBusyError):
        camera.read_chunk(FrameRef(0x64, "R.JPG", FrameFormat.JPEG, 1000), 0, 1000)
    assert not camera.can_transfer_while_exposing
    transport.assert_finished()


def test_another_kind_of_camera_is_refused_and_let_go(start: Start) -> None:
    dialogue = ThetaDialogue()
    dialogue.open().ask(0x1001, gives=device_info(0xB, OPERATIONS, PROPERTIES, TEXTS)).ask(0x1003)
    camera, transport = start(dialogue)
    with pytest.raises(UnsupportedError, match="extension 0xb, not 0x6"):
        camera.connect()
    assert transport.closed


def test_missing_operation_is_named(start: Start) -> None:
    dialogue = ThetaDialogue()
    operations = [code for code in OPERATIONS if code != 0x100E]
    dialogue.open().ask(0x1001, gives=device_info(6, operations, PROPERTIES, TEXTS)).ask(0x1003)
    camera, transport = start(dialogue)
    with pytest.raises(UnsupportedError, match="0x100e"):
        camera.connect()
    assert transport.closed


def test_status_reports_battery_space_clock_and_errors(start: Start) -> None:
    dialogue = ThetaDialogue().connect()
    dialogue.get(0xD006, 0x00200000 | 0x8).get(0x5002, 0x8001).get(0xD80E, 0).get(0x5001, 67)
    dialogue.ask(0x1004, gives=u32_array([0x00020001]))
    dialogue.ask(0x1005, 0x00020001, gives=struct.pack("<HHHQQI", 3, 3, 0, 2 * 10**10, 10**10, 1234) + b"\0\0")
    dialogue.ask(0x1015, 0x5011, gives=ptp_string("20230519T155400-0400"))
    camera, transport = start(dialogue)
    camera.connect()
    status = camera.status()
    assert (status.battery_frac, status.free_bytes, status.free_frames) == (0.67, 10**10, 1234)
    assert status.clock_utc == datetime(2023, 5, 19, 19, 54, tzinfo=UTC)
    assert not status.ready
    assert len(status.problems) == 2
    assert "battery temperature" in status.problems
    assert status.warnings == ("clock not set",)
    transport.assert_finished()


def test_everything_raises_typed_errors_before_connect(start: Start) -> None:
    camera, transport = start(ThetaDialogue())
    frame = FrameRef(1, "a", FrameFormat.JPEG, 1)
    for call in (
        camera.status,
        camera.arm,
        camera.release,
        camera.poll_exposure,
        camera.keep_alive,
        camera.list_frames,
        lambda: camera.prepare(PAPER),
        lambda: camera.set_shutter(1.0),
        lambda: camera.read_chunk(frame, 0, 1),
        lambda: camera.delete(frame),
    ):
        with pytest.raises(DeviceError):
            call()
    camera.close()
    transport.assert_finished()


def test_a_camera_that_was_never_there_can_be_recovered_when_it_comes() -> None:
    clock = FakeClock()
    transport = ThetaDialogue().connect().wake().ready().handles().transport(clock)
    attempts = 0

    def open_transport() -> ScriptedTransport:
        nonlocal attempts
        attempts += 1
        if attempts == 1:
            raise DeviceNotFoundError("not there")
        return transport

    camera = ThetaZ1(open_transport, clock)
    with pytest.raises(DeviceNotFoundError):
        camera.connect()
    with pytest.raises(DeviceLostError):
        camera.arm()
    camera.connect()
    assert attempts == 2


def test_recovery_after_unplugging_wakes_and_forgets_but_sets_nothing(start: Start, armed: ThetaDialogue) -> None:
    armed.release().event(0x4002, 0x66)
    armed.steps.append(Step(command(0x1008, armed.last_id + 1, 0x66), raises=DeviceLostError("unplugged")))
    armed.steps += [Step(Reset(), raises=DeviceLostError("unplugged")), Step(Reopen())]
    armed.open().ask(0x1001, gives=device_info(6, OPERATIONS, PROPERTIES, TEXTS))
    armed.wake().ready().handles(*OLD, 0x66)
    camera, transport = start(armed)
    ready_to_fire(camera)
    camera.release()
    with pytest.raises(DeviceLostError):
        camera.poll_exposure()
    camera.recover()
    with pytest.raises(ExposureFailedError, match="no exposure is running"):
        camera.poll_exposure()
    transport.assert_finished()
