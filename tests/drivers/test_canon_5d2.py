"""The EOS driver against byte-exact dialogues: what it says, in which order, and what it makes of the answers."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Self

import pytest

from drivers.camera import Camera, CameraSettings, FrameFormat, FrameRef
from drivers.canon_5d2.camera import Canon5D2
from drivers.canon_5d2.codes import SHUTTER_CODES
from drivers.errors import (
    BatteryLowError,
    DeviceBusyError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
    ExposureFailedError,
    OperationRefusedError,
    ProtocolViolationError,
    SettingRefusedError,
    StoreFullError,
    UnsupportedError,
)
from mocks.instruments.recorded import recording
from tests.drivers.dialogue import BUSY, OK, Dialogue, device_info, object_info, u32_array
from tests.drivers.scripted import (
    ControlIn,
    ControlOut,
    FakeClock,
    Reopen,
    Reset,
    ScriptedTransport,
    Step,
    command,
    data,
)
from tests.drivers.test_canon_encoding import added_record, list_record, record, value_record

DEVICE_OPERATIONS = recording("eos_5d2").codes("operations")
TEXTS = ("Canon Inc.", "Canon EOS 5D Mark II", "3-1.0.7", "0123456789abcdef0123456789abcdef")
END = bytes.fromhex("0800000000000000")
JPEG_L = bytes.fromhex("01000000 10000000 01000000 00000000 03000000")
RAW_JPEG_L = bytes.fromhex("02000000 10000000 06000000 00000000 04000000 10000000 01000000 00000000 03000000")
PAPER = CameraSettings(iso=200, f_number=16, color_temperature_k=6500, width_px=5616, height_px=3744)
CLOCK_S = int(FakeClock().utc_now().timestamp())
POLLS_UNTIL_OVERDUE = 101
"""One each 50 ms for 5 s, after the two that let go of the button."""

AE_MODE, FOCUS, DRIVE, FORMAT, WB, KELVIN, ISO, APERTURE, DESTINATION, SHUTTER, SHOTS = (
    0xD105,
    0xD108,
    0xD106,
    0xD120,
    0xD109,
    0xD10A,
    0xD103,
    0xD101,
    0xD11C,
    0xD102,
    0xD11B,
)
BEFORE = {
    AE_MODE: 3,
    FOCUS: 3,
    DRIVE: 1,
    WB: 0,
    KELVIN: 5200,
    ISO: 0x48,
    APERTURE: 0x30,
    DESTINATION: 2,
    SHUTTER: 0x60,
    SHOTS: 900,
    0xD111: 2,
    0xD113: CLOCK_S,
}
"""What the camera has before the bracket."""
WANTED = {DRIVE: 0, FORMAT: JPEG_L, WB: 9, KELVIN: 6500, ISO: 0x50, APERTURE: 0x48, DESTINATION: 2}
"""The paper's settings in the order in which they are made."""


def value_bytes(value: int | bytes) -> bytes:
    return value if isinstance(value, bytes) else struct.pack("<I", value)


def reported(prop: int, value: int | bytes) -> bytes:
    return record(0xC189, struct.pack("<I", prop) + value_bytes(value))


def wants_transfer(handle: int, size: int, name: str, ofc: int = 0x3801) -> bytes:
    return record(0xC186, struct.pack("<5I", handle, ofc, 0, size, 0) + name.encode().ljust(16, b"\0"))


def first_stream(before: dict[int, int], destinations: Sequence[int] = (2, 4)) -> bytes:
    """As a 60D begins: all values, then all lists."""
    values = b"".join(value_record(p, v) for p, v in before.items()) + reported(FORMAT, RAW_JPEG_L)
    formats = struct.pack("<III", FORMAT, 3, 2) + JPEG_L + RAW_JPEG_L
    lists = list_record(SHUTTER, [0x0C, *sorted(SHUTTER_CODES)]) + list_record(ISO, [0x48, 0x50, 0x58])
    lists += list_record(APERTURE, [0x30, 0x38, 0x40, 0x48]) + list_record(DESTINATION, destinations)
    lists += list_record(DRIVE, [0, 1]) + list_record(WB, [0, 9]) + list_record(KELVIN, [5200, 6500])
    return values + lists + record(0xC18A, formats) + list_record(0xD113, [], form=1)


class CanonDialogue(Dialogue):
    """The camera's usual answers."""

    def __init__(self, **before: int) -> None:
        super().__init__()
        self.state: dict[int, int | bytes] = {**BEFORE, FORMAT: RAW_JPEG_L}
        self.before = {**BEFORE, **{int(k[1:], 16): v for k, v in before.items()}}
        self.state.update(self.before)

    def poll(self, *records: bytes) -> Self:
        self.ask(0x9116, gives=b"".join(records) + END)
        return self

    def connect(
        self,
        operations: Sequence[int] = DEVICE_OPERATIONS,
        *,
        extension: int = 6,
        destinations: Sequence[int] = (2, 4),
    ) -> Self:
        self.open()
        self.ask(0x1001, gives=device_info(extension, operations, (0xD402,), TEXTS))
        self.ask(0x9114, 1).ask(0x9115, 1)
        self.poll(first_stream(self.before, destinations)).poll().ask(0x911C).poll()
        self.ask(0x9129, 2).ask(0x9129, 1)
        return self.poll()

    def ensure(self, prop: int, value: int | bytes) -> Self:
        """A property that has the value is asked for, another one is written; either way the camera reports it."""
        if self.state.get(prop) == value:
            self.ask(0x9127, prop)
        else:
            raw = value_bytes(value)
            self.ask(0x9110, sends=struct.pack("<II", 8 + len(raw), prop) + raw)
        self.state[prop] = value
        return self.poll(reported(prop, value))

    def prepare(self, **changed: int | bytes) -> Self:
        self.poll()
        for prop, value in {**WANTED, **{int(k[1:], 16): v for k, v in changed.items()}}.items():
            self.ensure(prop, value)
        if self.state[DESTINATION] == 4:
            self.ask(0x911A, 0x0FFFFFFF, 0x1000, 1)
        else:
            self.ask(0x1007, 0xFFFFFFFF, 0, 0, gives=u32_array([0x91000001]))
        return self

    def shutter(self, code: int) -> Self:
        self.poll().ensure(SHUTTER, code)
        return self.poll()

    def arm(self) -> Self:
        self.poll().poll()
        self.ask(0x9128, 1, 0)
        return self.poll(record(0xC18E, b"")).poll()

    def press(self, answer: int = OK) -> Self:
        self.ask(0x9128, 2, 0, answer=answer)
        return self

    def let_go(self) -> Self:
        """The two polls of the driver that let go of the button."""
        self.ask(0x9129, 2)
        self.poll(record(0xC18B, struct.pack("<I", 1)))
        self.ask(0x9129, 1)
        return self

    def start(self, **options: str) -> tuple[Canon5D2, ScriptedTransport]:
        clock = FakeClock()
        transport = self.transport(clock)
        return Canon5D2(lambda: transport, clock, **options), transport  # type: ignore[arg-type]


def armed() -> CanonDialogue:
    return CanonDialogue().connect().prepare().shutter(0x68).arm()


def ready_to_fire(camera: Canon5D2, settings: CameraSettings = PAPER) -> None:
    camera.connect()
    camera.prepare(settings)
    camera.set_shutter(1 / 60)
    camera.arm()


def poll_until_done(camera: Canon5D2, transport: ScriptedTransport) -> tuple[FrameRef, ...]:
    for _ in range(10_000):
        before_s = transport.clock.now_s
        progress = camera.poll_exposure()
        assert transport.clock.now_s - before_s <= 0.05 + 1e-9
        if progress.done:
            return progress.frames
    raise AssertionError("never done")


def test_published_vectors_are_what_the_scripts_are_made_of() -> None:
    assert command(0x9110, 0x14) == bytes.fromhex("0c000000 0100 1091 14000000")
    sent = data(0x9110, 0x14, struct.pack("<III", 12, SHUTTER, 0x68))
    assert sent == bytes.fromhex("18000000 0200 1091 14000000 0c000000 02d10000 68000000")
    assert command(0x9128, 0x15, 2, 0) == bytes.fromhex("14000000 0100 2891 15000000 02000000 00000000")
    assert reported(SHUTTER, 0x68) == bytes.fromhex("10000000 89c10000 02d10000 68000000")
    assert wants_transfer(0x91900001, 25_000_000, "IMG_0001.CR2", 0xB103) == bytes.fromhex(
        "2c000000 86c10000 01009091 03b10000 00000000 40787d01 00000000 494d475f 30303031 2e435232 00000000"
    )


def test_one_whole_frame_on_the_card() -> None:
    dialogue = armed().press().let_go()
    dialogue.poll(record(0xC18B, bytes(4)), added_record(0x91000002, 9000, "IMG_0002.JPG"))
    dialogue.ask(0x1008, 0x91000002, gives=object_info("IMG_0002.JPG", 0x3801, 9000, storage=0x00010001))
    dialogue.ask(0x101B, 0x91000002, 0, 6000, gives=b"a" * 6000, results=(6000,))
    dialogue.ask(0x101B, 0x91000002, 6000, 3000, gives=b"b" * 3000, results=(3000,))
    dialogue.ask(0x1008, 0x91000002, gives=object_info("IMG_0002.JPG", 0x3801, 9000, storage=0x00010001))
    dialogue.ask(0x100B, 0x91000002, 0)
    dialogue.ask(0x911D).poll().ask(0x9114, 0).ask(0x9115, 0).ask(0x1003)
    camera, transport = dialogue.start()
    assert isinstance(camera, Camera)

    identity = camera.connect()
    assert (identity.model, identity.serial, identity.firmware) == (TEXTS[1], TEXTS[3], TEXTS[2])
    assert (len(camera.shutter_times_s), camera.shutter_times_s[0], camera.shutter_times_s[-1]) == (55, 30, 1 / 8000)
    readbacks = {r.name: r for r in camera.prepare(PAPER)}
    assert all(r.honoured for r in readbacks.values())
    assert {name: r.got for name, r in readbacks.items()} == {
        "exposure mode (dial)": "M",
        "drive mode": "single",
        "image format": "JPEG L fine",
        "white balance": "colour temperature",
        "colour temperature": "6500 K",
        "ISO": "200",
        "aperture": "f/16",
        "destination": "card",
    }
    shutter = camera.set_shutter(1 / 60)
    assert (shutter.nominal_s, shutter.raw) == (1 / 60, "0x68")
    camera.arm()
    camera.release()
    (frame,) = poll_until_done(camera, transport)
    assert frame == FrameRef(0x91000002, "IMG_0002.JPG", FrameFormat.JPEG, 9000, 0x00010001)
    assert camera.read_chunk(frame, 0, 6000) + camera.read_chunk(frame, 6000, 3000) == b"a" * 6000 + b"b" * 3000
    camera.finish_frame(frame)
    camera.delete(frame)
    camera.close()
    transport.assert_finished()
    assert transport.closed


def test_pictures_for_the_computer_are_acknowledged() -> None:
    dialogue = CanonDialogue(xD11B=50).connect().prepare(xD11C=4).shutter(0x68)
    dialogue.poll().poll().ask(0x911A, 0x0FFFFFFF, 0x1000, 1)
    dialogue.ask(0x9128, 1, 0).poll(record(0xC18E, b"")).poll()
    dialogue.press().let_go().poll(wants_transfer(0x91900001, 4000, "IMG_0001.JPG"))
    dialogue.ask(0x101B, 0x91900001, 0, 4000, gives=b"c" * 4000, results=(4000,)).ask(0x9117, 0x91900001)
    camera, transport = dialogue.start(destination="pc")
    ready_to_fire(camera)
    camera.release()
    (frame,) = poll_until_done(camera, transport)
    assert camera.read_chunk(frame, 0, 4000) == b"c" * 4000
    camera.finish_frame(frame)
    camera.finish_frame(frame)
    camera.delete(frame)
    transport.assert_finished()


def test_raw_beside_jpeg_in_the_order_of_the_cameras_own_list() -> None:
    dialogue = CanonDialogue().connect().prepare(xD120=RAW_JPEG_L).shutter(0x68).arm().press().let_go()
    dialogue.poll(added_record(0x91000002, 25_000_000, "IMG_0002.CR2", ofc=0xB103))
    dialogue.ask(0x1008, 0x91000002, gives=object_info("IMG_0002.CR2", 0xB103, 25_000_000, storage=0x00010001))
    dialogue.poll(added_record(0x91000003, 9000, "IMG_0002.JPG"))
    dialogue.ask(0x1008, 0x91000003, gives=object_info("IMG_0002.JPG", 0x3801, 9000, storage=0x00010001))
    camera, transport = dialogue.start()
    ready_to_fire(camera, CameraSettings(200, 16, 6500, 5616, 3744, keep_raw=True))
    camera.release()
    frames = poll_until_done(camera, transport)
    assert [(f.format, f.handle) for f in frames] == [(FrameFormat.JPEG, 0x91000003), (FrameFormat.CR2, 0x91000002)]
    transport.assert_finished()


def test_every_third_stop_is_set_by_its_code() -> None:
    assert len(SHUTTER_CODES) == 55
    dialogue = CanonDialogue().connect()
    for code in sorted(SHUTTER_CODES):
        dialogue.shutter(code)
    camera, transport = dialogue.start()
    camera.connect()
    for code in sorted(SHUTTER_CODES):
        assert camera.set_shutter(SHUTTER_CODES[code]).nominal_s == SHUTTER_CODES[code]
    transport.assert_finished()


def test_nearest_stop_is_taken_and_both_are_recorded() -> None:
    camera, transport = CanonDialogue().connect().shutter(0x7B).start()
    camera.connect()
    shutter = camera.set_shutter(1 / 310)
    assert (shutter.asked_s, shutter.nominal_s, shutter.raw) == (1 / 310, 1 / 320, "0x7b")
    transport.assert_finished()


def test_all_wrong_controls_are_named_at_once() -> None:
    camera, transport = (
        CanonDialogue(xD105=2, xD108=0)
        .connect()
        .poll()
        .poll()
        .ask(0x1004, answer=0x2013)
        .ask(0x9127, 0xD113, answer=0x200A)
        .start()
    )
    camera.connect()
    with pytest.raises(SettingRefusedError, match=r"dial stands at Av: turn it to M; the lens is on AF"):
        camera.prepare(PAPER)
    status = camera.status()
    assert len(status.problems) == 2
    assert not status.ready
    transport.assert_finished()


def test_dial_turned_during_the_bracket_is_found() -> None:
    dialogue = CanonDialogue().connect().prepare().poll(reported(ISO, 0x58)).poll()
    camera, transport = dialogue.start()
    camera.connect()
    camera.prepare(PAPER)
    with pytest.raises(SettingRefusedError, match="somebody turned a dial"):
        camera.set_shutter(1 / 60)
    transport.assert_finished()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"iso": 210}, "ISO"),
        ({"f_number": 15}, "aperture"),
        ({"width_px": 5000}, "5616x3744"),
        ({"f_number": 22}, r"only: f/5\.6, f/8, f/11, f/16"),
        ({"width_px": 4080, "height_px": 2720}, r"asked JPEG M fine, got only: JPEG L fine, JPEG L fine \+ RAW L"),
    ],
)
def test_what_the_camera_has_not_is_refused_by_name(changes: dict[str, float], words: str) -> None:
    dialogue = CanonDialogue().connect().poll()
    before = {"f_number": (DRIVE, FORMAT, WB, KELVIN, ISO), "height_px": (DRIVE,)}
    for prop in before.get(list(changes)[-1], ()) if changes != {"f_number": 15} else ():
        dialogue.ensure(prop, WANTED[prop])
    camera, transport = dialogue.start()
    camera.connect()
    settings = {"iso": 200, "f_number": 16, "color_temperature_k": 6500, "width_px": 5616, "height_px": 3744}
    with pytest.raises(SettingRefusedError, match=words):
        camera.prepare(CameraSettings(**{**settings, **changes}))  # type: ignore[arg-type]
    transport.assert_finished()


def test_setting_that_reads_back_as_another_is_refused() -> None:
    dialogue = CanonDialogue().connect().poll()
    dialogue.ask(0x9110, sends=struct.pack("<III", 12, DRIVE, 0)).poll(reported(DRIVE, 4))
    for _ in range(100):
        dialogue.poll()
    camera, _ = dialogue.start()
    camera.connect()
    with pytest.raises(SettingRefusedError, match="asked single, got fast"):
        camera.prepare(PAPER)


def test_busy_write_is_repeated_after_draining() -> None:
    dialogue = CanonDialogue().connect().poll()
    dialogue.ask(0x9110, sends=struct.pack("<III", 12, SHUTTER, 0x68), answer=BUSY)
    dialogue.poll(reported(SHOTS, 899))
    dialogue.ask(0x9110, sends=struct.pack("<III", 12, SHUTTER, 0x68)).poll(reported(SHUTTER, 0x68)).poll()
    camera, transport = dialogue.start()
    camera.connect()
    assert camera.set_shutter(1 / 60).raw == "0x68"
    transport.assert_finished()


def test_busy_write_ends_within_its_limit() -> None:
    dialogue = CanonDialogue().connect().poll()
    for _ in range(60):
        dialogue.ask(0x9110, sends=struct.pack("<III", 12, SHUTTER, 0x68), answer=BUSY).poll()
    camera, transport = dialogue.start()
    camera.connect()
    before_s = transport.clock.now_s
    with pytest.raises(DeviceBusyError):
        camera.set_shutter(1 / 60)
    assert transport.clock.now_s - before_s <= 5.5


def test_camera_that_stays_busy_is_not_armed() -> None:
    dialogue = CanonDialogue().connect().prepare().shutter(0x68).poll(record(0xC18B, struct.pack("<I", 1)))
    for _ in range(22):
        dialogue.poll()
    for _ in range(100):
        dialogue.ask(0x911C, answer=BUSY).poll()
    camera, transport = dialogue.start()
    camera.connect()
    camera.prepare(PAPER)
    camera.set_shutter(1 / 60)
    before_s = transport.clock.now_s
    with pytest.raises(DeviceBusyError, match="nobody fetched"):
        camera.arm()
    assert transport.clock.now_s - before_s <= 16.5


def test_idle_that_was_never_reported_is_found_by_asking() -> None:
    dialogue = CanonDialogue().connect().prepare().poll(record(0xC18B, struct.pack("<I", 1)))
    for _ in range(22):
        dialogue.poll()
    dialogue.ask(0x911C, answer=BUSY).poll().ask(0x911C).poll().ensure(SHUTTER, 0x68).poll()
    camera, transport = dialogue.start()
    camera.connect()
    camera.prepare(PAPER)
    camera.set_shutter(1 / 60)
    transport.assert_finished()


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (0x2002, OperationRefusedError),
        (BUSY, DeviceBusyError),
        (0x200C, StoreFullError),
        (0xA101, BatteryLowError),
    ],
)
def test_refused_full_press_lets_go_of_the_button(answer: int, error: type[DeviceError]) -> None:
    dialogue = armed().press(answer).poll().ask(0x9129, 1)
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    with pytest.raises(error):
        camera.release()
    transport.assert_finished()


def test_stood_down_camera_lets_go_of_the_half_press_before_anything_else() -> None:
    dialogue = armed().ask(0x9129, 1)
    camera, transport = dialogue.shutter(0x60).start()
    ready_to_fire(camera)
    camera.set_shutter(1 / 30)
    transport.assert_finished()


@pytest.mark.parametrize(
    ("result", "error", "words"),
    [
        (0, None, ""),
        (1, ExposureFailedError, "no focus"),
        (3, ExposureFailedError, "mirror"),
        (7, StoreFullError, "full"),
        (8, StoreFullError, "write-protected"),
        (0x2005, ExposureFailedError, "0x2005"),
    ],
)
def test_one_step_release_where_two_steps_are_unknown(result: int, error: type[DeviceError] | None, words: str) -> None:
    dialogue = CanonDialogue().connect().prepare().shutter(0x68).poll().poll()
    dialogue.ask(0x9128, 1, 0, answer=0x2005).ask(0x910F, results=(result,))
    if error is None:
        dialogue.poll(added_record(0x91000002, 9000, "IMG_0002.JPG"))
        dialogue.ask(0x1008, 0x91000002, gives=object_info("IMG_0002.JPG", 0x3801, 9000, storage=0x00010001))
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    if error is None:
        camera.release()
        assert len(poll_until_done(camera, transport)) == 1
    else:
        with pytest.raises(error, match=words):
            camera.release()
    transport.assert_finished()


def test_folders_doubled_and_old_objects_make_no_frame() -> None:
    dialogue = armed().press().let_go()
    dialogue.poll(
        added_record(0x91100000, 0, "101CANON", ofc=0x3001),
        added_record(0x91000001, 9000, "IMG_0001.JPG", code=0xC187),
        added_record(0x91000002, 0, "IMG_0002.JPG"),
        wants_transfer(0x91900001, 4000, "IMG_0009.JPG"),
        record(0xC182, struct.pack("<I", 0x91000001)),
    )
    dialogue.poll(added_record(0x91000002, 9000, "IMG_0002.JPG", code=0xC187), added_record(0x91000002, 9000, "X.JPG"))
    dialogue.ask(0x1008, 0x91000002, gives=object_info("IMG_0002.JPG", 0x3801, 9000, storage=0x00010001))
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    camera.release()
    (frame,) = poll_until_done(camera, transport)
    assert (frame.handle, frame.name) == (0x91000002, "IMG_0002.JPG")
    transport.assert_finished()


def test_announcement_that_the_card_contradicts_is_not_believed() -> None:
    """Its handle is free; the true one is found on the card once it is overdue."""
    dialogue = armed().press().let_go()
    dialogue.poll(added_record(0x91000004, 9000, "IMG_0002.JPG"))
    dialogue.ask(0x1008, 0x91000004, answer=0x2009)
    for _ in range(POLLS_UNTIL_OVERDUE - 1):
        dialogue.poll()
    dialogue.ask(0x1007, 0xFFFFFFFF, 0, 0, gives=u32_array([0x91000001, 0x91000002]))
    dialogue.ask(0x1008, 0x91000002, gives=object_info("IMG_0002.JPG", 0x3801, 9000, storage=0x00010001))
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    camera.release()
    assert [f.handle for f in poll_until_done(camera, transport)] == [0x91000002]
    transport.assert_finished()


def test_lost_announcement_is_made_good_from_the_card() -> None:
    dialogue = armed().press().let_go()
    for _ in range(POLLS_UNTIL_OVERDUE):
        dialogue.poll()
    dialogue.ask(0x1007, 0xFFFFFFFF, 0, 0, gives=u32_array([0x91000001, 0x91000002]))
    dialogue.ask(0x1008, 0x91000002, gives=object_info("IMG_0002.JPG", 0x3801, 9000, storage=0x00010001))
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    camera.release()
    released_s = transport.clock.now_s
    frames = poll_until_done(camera, transport)
    assert [f.handle for f in frames] == [0x91000002]
    assert 5.0 <= transport.clock.now_s - released_s <= 5.1
    transport.assert_finished()


def test_no_picture_at_all_fails_within_its_limit() -> None:
    """Pictures for the computer cannot be looked up, so nothing but polls happens until the limit."""
    dialogue = CanonDialogue().connect().prepare(xD11C=4).shutter(0x68).arm().press().let_go()
    for _ in range(600):
        dialogue.poll()
    camera, transport = dialogue.start(destination="pc")
    ready_to_fire(camera)
    camera.release()
    released_s = transport.clock.now_s
    with pytest.raises(ExposureFailedError, match="no picture"):
        poll_until_done(camera, transport)
    assert 25.0 <= transport.clock.now_s - released_s <= 26.1


def test_busy_transfer_during_an_exposure_is_not_tried_again() -> None:
    dialogue = armed().press().ask(0x101B, 0x91000001, 0, 1000, answer=BUSY)
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    camera.release()
    with pytest.raises(DeviceBusyError):
        camera.read_chunk(FrameRef(0x91000001, "IMG_0001.JPG", FrameFormat.JPEG, 1000), 0, 1000)
    assert not camera.can_transfer_while_exposing
    transport.assert_finished()


@pytest.mark.parametrize("answer", [0xA102, 0xA106])
def test_a_picture_that_is_not_ready_yet_is_asked_for_later(answer: int) -> None:
    """libgphoto2 on A102: "not there yet ... so wait"."""
    frame = FrameRef(0x91000001, "IMG_0001.JPG", FrameFormat.JPEG, 1000)
    dialogue = CanonDialogue().connect().ask(0x101B, 0x91000001, 0, 1000, answer=answer)
    dialogue.ask(0x101B, 0x91000001, 0, 1000, gives=b"d" * 1000, results=(1000,))
    camera, transport = dialogue.start()
    camera.connect()
    with pytest.raises(DeviceBusyError):
        camera.read_chunk(frame, 0, 1000)
    assert camera.read_chunk(frame, 0, 1000) == b"d" * 1000
    transport.assert_finished()


def test_poll_does_not_wait_between_two_chunks() -> None:
    dialogue = armed().press().let_go().poll()
    dialogue.ask(0x101B, 0x91000001, 0, 1000, gives=b"d" * 1000, results=(1000,))
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    camera.release()
    camera.poll_exposure()
    camera.poll_exposure()
    frame = FrameRef(0x91000001, "IMG_0001.JPG", FrameFormat.JPEG, 1000)
    before_s = transport.clock.now_s
    assert camera.read_chunk(frame, 0, 1000) == b"d" * 1000
    assert not camera.poll_exposure().done
    assert transport.clock.now_s == before_s


def test_older_body_is_read_by_its_own_partial_read() -> None:
    operations = [code for code in DEVICE_OPERATIONS if code != 0x101B]
    dialogue = CanonDialogue().connect(operations)
    dialogue.ask(0x9107, 0x91000001, 0, 1000, gives=b"e" * 1000)
    camera, transport = dialogue.start()
    camera.connect()
    assert camera.read_chunk(FrameRef(0x91000001, "I", FrameFormat.JPEG, 1000), 0, 4096 // 4 - 24) == b"e" * 1000
    transport.assert_finished()


def test_unfetched_picture_of_a_crash_is_let_go_at_connect() -> None:
    dialogue = CanonDialogue()
    dialogue.open().ask(0x1001, gives=device_info(0xB, DEVICE_OPERATIONS, (0xD402,), TEXTS))
    dialogue.ask(0x9114, 1, answer=BUSY)
    dialogue.poll(wants_transfer(0x91900001, 4000, "IMG_0001.JPG")).ask(0x9114, 1).ask(0x9115, 1)
    dialogue.poll(first_stream(BEFORE)).poll().ask(0x911C, answer=0x2002).poll().ask(0x9129, 2, answer=0x2002).ask(
        0x9129, 1, answer=0x2002
    )
    dialogue.poll().ask(0x9117, 0x91900001)
    camera, transport = dialogue.start()
    camera.connect()
    transport.assert_finished()


def test_keep_alive_speaks_every_ten_seconds_and_when_warned() -> None:
    dialogue = CanonDialogue().connect()
    dialogue.poll().ask(0x911D).poll(record(0xC18D, struct.pack("<I", 30))).poll().ask(0x911D).poll().poll()
    camera, transport = dialogue.start()
    camera.connect()
    camera.keep_alive()
    transport.clock.sleep(10.0)
    camera.keep_alive()
    camera.keep_alive()
    camera.keep_alive()
    transport.assert_finished()


def test_status_reports_battery_space_and_clock() -> None:
    dialogue = CanonDialogue(xD111=4).connect().poll()
    dialogue.ask(0x1004, gives=u32_array([0x00010001]))
    space = struct.pack("<HHHQQI", 4, 3, 0, 2 * 10**10, 10**10, 0xFFFFFFFF)
    dialogue.ask(0x1005, 0x00010001, gives=space + b"\x03C\0F\0\0\0\0")
    dialogue.ask(0x9127, 0xD113).poll(reported(0xD113, CLOCK_S + 60))
    camera, transport = dialogue.start()
    camera.connect()
    status = camera.status()
    assert (status.battery_frac, status.free_bytes, status.free_frames) == (0.75, 10**10, 900)
    assert status.clock_utc == datetime.fromtimestamp(CLOCK_S + 60, UTC)
    assert (status.ready, status.problems, status.warnings) == (True, (), ())
    transport.assert_finished()


def test_silent_controls_are_warned_of() -> None:
    dialogue = CanonDialogue()
    del dialogue.before[AE_MODE], dialogue.before[FOCUS]
    dialogue.connect().poll().ask(0x1004, answer=0x2013).ask(0x9127, 0xD113, answer=0x200A)
    camera, transport = dialogue.start()
    camera.connect()
    status = camera.status()
    assert (len(status.warnings), status.problems, status.free_bytes) == (2, (), None)
    transport.assert_finished()


def test_camera_that_never_stops_sending_is_given_up() -> None:
    dialogue = CanonDialogue().connect()
    for n in range(250):
        dialogue.poll(reported(SHOTS, n))
    camera, _ = dialogue.start()
    camera.connect()
    with pytest.raises(DeviceError, match="still sending"):
        camera.status()


def test_garbled_event_stream_is_a_violation() -> None:
    dialogue = CanonDialogue().connect().ask(0x9116, gives=reported(SHOTS, 5))
    camera, _ = dialogue.start()
    camera.connect()
    with pytest.raises(ProtocolViolationError):
        camera.status()


def test_another_kind_of_camera_is_refused_and_let_go() -> None:
    dialogue = CanonDialogue()
    dialogue.open().ask(0x1001, gives=device_info(4, DEVICE_OPERATIONS, (), TEXTS)).ask(0x1003)
    camera, transport = dialogue.start()
    with pytest.raises(UnsupportedError, match="extension 0x4, not 0x6 or 0xb"):
        camera.connect()
    assert transport.closed


def test_microsofts_extension_without_canons_operations_is_no_eos() -> None:
    dialogue = CanonDialogue()
    dialogue.open().ask(0x1001, gives=device_info(6, (0x1001, 0x100E), (), TEXTS)).ask(0x1003)
    camera, _ = dialogue.start()
    with pytest.raises(UnsupportedError, match="lacks the operations 0x9110"):
        camera.connect()


@pytest.mark.parametrize(("extension", "listed", "card"), [(6, (1, 5, 4), 1), (0xB, (2, 4, 6), 2), (6, (2, 6, 4), 2)])
def test_the_card_is_what_the_camera_lists_beside_the_computer(
    extension: int, listed: tuple[int, ...], card: int
) -> None:
    """Lists of a 5D Mark III, a 60D and a 70D (libgphoto2); the camera stands at "computer" before."""
    dialogue = CanonDialogue(xD11C=4).connect(extension=extension, destinations=listed).prepare(xD11C=card)
    camera, transport = dialogue.start()
    camera.connect()
    readback = {r.name: r for r in camera.prepare(PAPER)}["destination"]
    assert (readback.got, readback.raw) == ("card", card.to_bytes(4, "little").hex())
    transport.assert_finished()


def test_no_card_listed_is_no_card() -> None:
    dialogue = CanonDialogue(xD11C=4).connect(destinations=(4,)).poll()
    camera, transport = dialogue.start()
    camera.connect()
    with pytest.raises(SettingRefusedError, match="asked card, got only: computer"):
        camera.prepare(PAPER)
    transport.assert_finished()


def test_everything_raises_typed_errors_before_connect() -> None:
    camera, transport = CanonDialogue().start()
    frame = FrameRef(1, "a", FrameFormat.JPEG, 1, 1)
    for call in (
        camera.status,
        camera.arm,
        camera.release,
        camera.poll_exposure,
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


def test_recovery_lets_go_of_the_button_and_sets_nothing() -> None:
    dialogue = armed()
    lost = DeviceLostError("unplugged")
    dialogue.steps.append(Step(command(0x9128, dialogue.last_id + 1, 2, 0), raises=lost))
    dialogue.steps += [Step(Reset(), raises=DeviceLostError("unplugged")), Step(Reopen())]
    dialogue.open().ask(0x1001, gives=device_info(0xB, DEVICE_OPERATIONS, (0xD402,), TEXTS))
    dialogue.ask(0x9114, 1).ask(0x9115, 1).poll(first_stream(BEFORE)).poll().ask(0x911C).poll().ask(0x9129, 2).ask(
        0x9129, 1
    ).poll()
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    with pytest.raises(DeviceLostError):
        camera.release()
    camera.recover()
    transport.assert_finished()


def test_recovery_after_a_mute_moment_keeps_the_session() -> None:
    dialogue = armed().press()
    dialogue.last_id += 1
    dialogue.steps.append(Step(command(0x9129, dialogue.last_id, 2)))
    cancel = ControlOut(0x64, struct.pack("<HI", 0x4001, dialogue.last_id))
    dialogue.steps += [Step(cancel), Step(ControlIn(0x67, 32), [bytes.fromhex("04000120")])]
    dialogue.ask(0x1001, gives=device_info(0xB, DEVICE_OPERATIONS, (0xD402,), TEXTS))
    dialogue.ask(0x9114, 1).ask(0x9115, 0).ask(0x9115, 1).poll().ask(0x911C).poll().ask(0x9129, 2).ask(0x9129, 1)
    dialogue.poll(added_record(0x91000002, 9000, "IMG_0002.JPG")).poll()
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    camera.release()
    with pytest.raises(DeviceTimeoutError):
        camera.poll_exposure()
    camera.recover()
    assert camera.shutter_times_s[0] == 30
    transport.assert_finished()


def test_another_camera_after_a_lost_connection_is_refused() -> None:
    dialogue = armed()
    dialogue.steps.append(Step(command(0x9128, dialogue.last_id + 1, 2, 0), raises=DeviceLostError("unplugged")))
    dialogue.steps += [Step(Reset()), Step(Reopen())]
    other = (*TEXTS[:3], "f" * 32)
    dialogue.open().ask(0x1001, gives=device_info(0xB, DEVICE_OPERATIONS, (0xD402,), other)).ask(0x1003)
    camera, transport = dialogue.start()
    ready_to_fire(camera)
    with pytest.raises(DeviceLostError):
        camera.release()
    with pytest.raises(DeviceNotFoundError, match="another camera"):
        camera.recover()
    assert transport.closed


def test_state_that_was_lost_on_the_way_is_reported_again() -> None:
    dialogue = CanonDialogue()
    dialogue.open().ask(0x1001, gives=device_info(0xB, DEVICE_OPERATIONS, (0xD402,), TEXTS))
    dialogue.ask(0x9114, 1).ask(0x9115, 1).poll().ask(0x9115, 0).ask(0x9115, 1)
    dialogue.poll(first_stream(BEFORE)).poll().ask(0x911C).poll().ask(0x9129, 2).ask(0x9129, 1).poll()
    camera, transport = dialogue.prepare().start()
    camera.connect()
    readbacks = camera.prepare(PAPER)
    assert len(readbacks) == 8, "the mode dial and seven settings"
    assert all(r.honoured for r in readbacks)
    transport.assert_finished()


def test_unknown_property_is_asked_for_before_it_is_written() -> None:
    """A destination that is written without need would be answered with "busy"."""
    dialogue = CanonDialogue()
    del dialogue.before[DESTINATION]
    dialogue.connect().poll()
    for prop in (DRIVE, FORMAT, WB, KELVIN, ISO, APERTURE):
        dialogue.ensure(prop, WANTED[prop])
    dialogue.ask(0x9127, DESTINATION).poll(reported(DESTINATION, 2)).ensure(DESTINATION, 2)
    dialogue.ask(0x1007, 0xFFFFFFFF, 0, 0, gives=u32_array([0x91000001]))
    camera, transport = dialogue.start()
    camera.connect()
    readbacks = camera.prepare(PAPER)
    assert len(readbacks) == 8, "the mode dial and seven settings"
    assert all(r.honoured for r in readbacks)
    transport.assert_finished()
