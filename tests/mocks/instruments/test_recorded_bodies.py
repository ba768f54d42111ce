"""The drivers against cameras generated from recordings of real bodies: connect, settings, bracket, disconnect.

And the reverse: what a driver takes for granted is looked up in the camera's own list, or found in a recording; each
constant that was wrong once, put back, makes a capture fail.
"""

from __future__ import annotations

import dataclasses
import hashlib
import re
from enum import IntEnum

import pytest

from drivers.camera import CameraSettings
from drivers.canon_5d2 import camera as canon_camera
from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2 import settings as canon_settings
from drivers.canon_5d2.camera import Canon5D2
from drivers.canon_5d2.operations import AvailableValues, decode_events, encode_number
from drivers.errors import DeviceBusyError, SettingRefusedError, UnsupportedError
from drivers.ptp.codes import Response
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.camera import ThetaZ1
from drivers.usb_link import UsbLink
from mocks.instruments import canon_records
from mocks.instruments.canon_5d2 import SimulatedCanon5D2
from mocks.instruments.canon_records import END, CanonOptions
from mocks.instruments.ptp.wire import Request
from mocks.instruments.recorded import recorded_bodies, recording
from mocks.instruments.theta_z1 import SimulatedThetaZ1, ThetaOptions
from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.drivers.test_cameras_on_simulators import NamedShots
from tests.virtual_clock import VirtualClock

STOPS_S = (1 / 4, 1 / 60, 1 / 1000)
CANONS = ["eos_60d", "eos_5d3", "eos_5d2"]
PAPER = CameraSettings(iso=200, f_number=16, color_temperature_k=6500, width_px=5616, height_px=3744)
THETA = CameraSettings(iso=100, f_number=5.6, color_temperature_k=6500, width_px=6720, height_px=3360)


def canon(body: str, destination: str = "card", **options: object) -> tuple[Canon5D2, SimulatedCanon5D2, VirtualClock]:
    clock = VirtualClock()
    device = SimulatedCanon5D2(NamedShots(), clock, options=CanonOptions(body=body, **options))  # type: ignore[arg-type]
    backend, ids = SimulatedUsbBackend([device], clock), recording(body).raw["usb_id"]
    camera = Canon5D2(lambda: UsbLink.open(*ids, backend=backend, clock=clock), clock, destination=destination)  # type: ignore[arg-type]
    return camera, device, clock


def theta(options: ThetaOptions) -> tuple[ThetaZ1, VirtualClock]:
    clock = VirtualClock()
    backend = SimulatedUsbBackend([SimulatedThetaZ1(NamedShots(), clock, options=options)], clock)
    return ThetaZ1(lambda: UsbLink.open(*ricoh_codes.USB_ID, backend=backend, clock=clock), clock), clock


def bracket(camera: Canon5D2 | ThetaZ1, clock: VirtualClock, settings: CameraSettings) -> list[bytes]:
    """Connect, set, take `STOPS_S`, read each frame whole, disconnect."""
    camera.connect()
    camera.prepare(settings)
    frames = []
    for stop_s in STOPS_S:
        assert camera.set_shutter(stop_s).nominal_s == pytest.approx(stop_s)
        camera.arm()
        camera.release()
        while not (progress := camera.poll_exposure()).done:
            clock.sleep(0.05)
        (frame,) = progress.frames
        content = b""
        while len(content) < frame.size_bytes:
            content += camera.read_chunk(frame, len(content), 1 << 16)
        camera.finish_frame(frame)
        frames.append(content)
    camera.close()
    return frames


@pytest.mark.parametrize("name", recorded_bodies("canon"))
def test_the_first_answer_is_the_recorded_one_to_the_byte(name: str) -> None:
    body = recording(name)
    stream = b"".join(e.encode() for e in body.stream()) + END
    recorded = body.raw["events"].get("first_sha256")  # none where the dump gives no raw bytes
    assert recorded is None or hashlib.sha256(stream).hexdigest() == recorded
    assert len(stream) == body.raw["events"].get("first_bytes", len(stream))
    assert len(decode_events(stream)) == len(body.stream())


def test_a_change_of_destination_is_answered_as_recorded() -> None:
    recorded = recording("eos_60d").stream("to_card")
    assert len(decode_events(b"".join(e.encode() for e in recording("eos_60d").stream("to_computer")) + END)) == 9
    camera, device, _ = canon("eos_60d", destination="card")
    camera.connect()
    device.settings.values[canon_codes.CanonProp.CAPTURE_DESTINATION] = canon_codes.DESTINATION_PC
    data = canon_records.value_changed(canon_codes.CanonProp.CAPTURE_DESTINATION, 2).payload
    answer = device.rules[canon_codes.CanonOperation.SET_DEVICE_PROP_VALUE_EX].handler(
        Request(canon_codes.CanonOperation.SET_DEVICE_PROP_VALUE_EX, 9, (), (8 + 4).to_bytes(4, "little") + data)
    )
    assert answer.code == Response.OK
    assert [r.payload[:4] for r in device.records] == [e.payload[:4] for e in recorded]


@pytest.mark.parametrize("destination", ["card", "pc"])
@pytest.mark.parametrize("body", CANONS)
def test_a_bracket_with_a_recorded_canon(body: str, destination: str) -> None:
    camera, device, clock = canon(body, destination)
    frames = bracket(camera, clock, PAPER)
    assert [f.split()[1] for f in frames] == [f"{s:.9f}".encode() for s in STOPS_S]
    assert device.remote_mode == device.event_mode == 0
    cards = {"eos_60d": 2, "eos_5d3": 1, "eos_5d2": 1}
    assert device.settings.number(canon_codes.CanonProp.CAPTURE_DESTINATION) == (
        4 if destination == "pc" else cards[body]
    )


def test_a_body_as_its_owner_left_it_is_refused_by_the_names_of_its_controls() -> None:
    camera, _, _ = canon("eos_60d", ae_mode=None)
    camera.connect()
    with pytest.raises(SettingRefusedError, match="mode dial stands at Av: turn it to M"):
        camera.prepare(PAPER)


def test_a_body_without_colour_temperature_is_refused_before_it_is_written() -> None:
    camera, device, _ = canon("eos_1000d")
    camera.connect()
    with pytest.raises(SettingRefusedError, match="white balance cannot be set: asked colour temperature, got only"):
        camera.prepare(PAPER)
    assert device.settings.number(canon_codes.CanonProp.WHITE_BALANCE) == 6


def test_a_bracket_with_the_recorded_theta() -> None:
    """Firmware 1.50.1, which cannot stitch statically, in the state in which it was recorded."""
    camera, clock = theta(ThetaOptions(firmware="1.50.1", busy_as_recorded=True))
    frames = bracket(camera, clock, THETA)
    assert [f.split()[1] for f in frames] == [f"{s:.9f}".encode() for s in STOPS_S]


def test_a_theta_that_stays_busy_is_named_with_a_remedy() -> None:
    camera, _ = theta(ThetaOptions(firmware="1.50.1", busy_as_recorded=True, cured_by_waking=False))
    with pytest.raises(DeviceBusyError, match="power button"):
        camera.connect()


# ---- wrong constants, put back


@pytest.mark.parametrize("body", CANONS)
def test_canons_own_extension_alone_would_refuse_every_real_body(body: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = dataclasses.replace(canon_camera.MODEL, vendor_extension_ids=(0x0B,))
    monkeypatch.setattr(canon_camera, "MODEL", before)
    camera, clock = canon(body)[::2]
    with pytest.raises(UnsupportedError, match="extension 0x6, not 0xb"):
        bracket(camera, clock, PAPER)


def test_a_card_that_is_always_2_would_fail_on_compact_flash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(canon_settings, "_destination", lambda _remote, to_card: encode_number(2 if to_card else 4))
    for body in ("eos_5d3", "eos_5d2"):
        camera, clock = canon(body)[::2]
        with pytest.raises(SettingRefusedError, match="destination"):
            bracket(camera, clock, PAPER)


def test_a_format_written_unlisted_would_be_refused_by_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the check: by name, nothing written. Without: the camera gets it, which can lock a real one."""
    settings = dataclasses.replace(PAPER, width_px=2784, height_px=1856)  # size 2: not in a 5D Mark III's list
    camera, device, _ = canon("eos_5d3")
    seen: list[int] = []
    monkeypatch.setattr(device, "takes_setting", lambda prop: seen.append(prop) or True)
    camera.connect()
    with pytest.raises(SettingRefusedError, match="asked JPEG S fine, got only"):
        camera.prepare(settings)
    monkeypatch.setattr(canon_settings, "_require_listed", lambda _remote, _setting: None)
    with pytest.raises(SettingRefusedError, match="image format cannot be set: asked JPEG S fine, got response 0x201c"):
        camera.prepare(settings)
    assert canon_codes.CanonProp.IMAGE_FORMAT not in seen


# ---- every constant has a witness


LOOKED_UP = {
    **dict.fromkeys(("SHUTTER_CODES", "SHUTTER_CODES_HALF"), 0xD102),
    "ISO_CODES": 0xD103,
    "APERTURE_CODES": 0xD101,
    "DRIVE_SINGLE": 0xD106,
    "WB_COLOR_TEMPERATURE": 0xD109,
    "DESTINATION_PC": 0xD11C,
    "IMAGE_SIZES_PX": 0xD120,
    **dict.fromkeys(("IMAGE_TYPE_JPEG", "IMAGE_TYPE_RAW", "IMAGE_SIZE_LARGE"), 0xD120),
    **dict.fromkeys(("IMAGE_SIZE_MEDIUM", "IMAGE_SIZE_SMALL"), 0xD120),
    **dict.fromkeys(("IMAGE_COMPRESSION_NORMAL", "IMAGE_COMPRESSION_FINE", "IMAGE_COMPRESSION_RAW"), 0xD120),
}
"""Written or offered only where the camera lists the value of this property (`drivers.canon_5d2.settings.make`)."""
REPORTED = {"AE_MANUAL": "eos_5d3's Tv is 1, a 60D's Av is 2", "AE_BULB": "as AE_MANUAL", "FOCUS_MANUAL": "eos_60d"}
"""Positions of controls: the camera reports them, nobody writes them."""
ELSEWHERE = {
    "CanonEvent.BULB_EXPOSURE_TIME": "libgphoto2; sent after bulb exposures, which are not taken",
    "CanonEvent.CTG_INFO_CHECK_COMPLETE": "the streams of eos_60d and eos_5d3",
    "CanonProp.MIRROR_UP_SETTING": "eos_5d3",
    "CanonProp.HIGHLIGHT_TONE_PRIORITY": "eos_5d3",
    "CanonResponse": "libgphoto2: no recording met a refusal of Canon's own",
    "LIST_FORM": "every recorded list",
    "USB_ID": "eos_5d2",
    "VENDOR_EXTENSION_IDS": "6: all recordings; 0x0B: what libgphoto2 makes of it",
}
"""Where else a constant is from."""


def witness(name: str, value: object) -> str:
    """Return where a constant of `drivers.canon_5d2.codes` is looked up or recorded, or say that it is in neither."""
    for table in (ELSEWHERE, REPORTED):
        if found := table.get(name) or table.get(name.partition(".")[0]):
            return found
    if name in LOOKED_UP:
        return f"looked up in the list of {LOOKED_UP[name]:X}"
    for body in map(recording, recorded_bodies("canon")):
        both = [*body.codes("operations"), *body.codes("events"), *body.codes("events", "device_info_ex")]
        both += body.codes("properties", "device_info_ex")
        if value in both or value in {e.prop for e in body.stream() if e.code in (0xC189, 0xC18A)}:
            return f"recorded: {body.name}"
    return ""


def constants() -> dict[str, object]:
    """Return every constant of the Canon driver's tables, members of enumerations by ``Class.NAME``."""
    found: dict[str, object] = {}
    for name, value in vars(canon_codes).items():
        if isinstance(value, type) and issubclass(value, IntEnum) and value is not IntEnum:
            found |= {f"{name}.{member.name}": member for member in value}
        elif name.isupper():
            found[name] = value
    return found


def test_every_constant_of_the_canon_driver_is_looked_up_or_recorded() -> None:
    found = {name: witness(name, value) for name, value in constants().items()}
    assert not [name for name, where in found.items() if not where]
    assert found["CanonOperation.REMOTE_RELEASE_ON"] == "recorded: eos_5d2"
    assert found["CanonProp.CAPTURE_DESTINATION"].startswith("recorded: ")
    assert not {*LOOKED_UP, *REPORTED} - set(constants()), "a name that no constant has"
    assert not {op.name for op in canon_codes.CanonOperation} - {
        op.name for op in canon_codes.CanonOperation if op in recording("eos_5d2").codes("operations")
    }, "an operation that a 5D Mark II does not list"


@pytest.mark.parametrize("body", ["eos_60d", "eos_5d3"])
def test_values_that_the_driver_writes_are_listed_by_real_bodies(body: str) -> None:
    stream = b"".join(e.encode() for e in recording(body).stream()) + END
    lists = {r.prop: r for r in decode_events(stream) if isinstance(r, AvailableValues)}
    numbers = {p: r.numbers for p, r in lists.items()} | recording(body).dial_at_m()
    for name in ("SHUTTER_CODES", "ISO_CODES", "APERTURE_CODES"):
        assert getattr(canon_codes, name).keys() & set(numbers[LOOKED_UP[name]]), name
    assert set(numbers[0xD102]) <= canon_codes.SHUTTER_CODES.keys(), "a time that the driver does not know"
    for name in ("DRIVE_SINGLE", "WB_COLOR_TEMPERATURE", "DESTINATION_PC"):
        assert getattr(canon_codes, name) in numbers[LOOKED_UP[name]], name
    files = {f for formats in lists[0xD120].formats for f in formats}
    assert {(f.file_type, f.size, f.compression) for f in files} >= {(1, 0, 3), (6, 0, 4)}


def test_every_property_of_the_theta_driver_is_recorded_or_asked_for() -> None:
    """Recorded: in DeviceInfo of firmware 1.50.1. Later ones are asked for before use (`ThetaProperties.has`)."""
    props = set(recording("theta_z1").codes("properties"))
    later = {p.name for p in ricoh_codes.RicohProp if p not in props}
    assert later == {"IMAGE_STITCHING", "EXPOSURE_STATUS", "MODE_MEMORY"}
    assert set(recording("theta_z1").codes("operations")) >= set(ricoh_codes.RicohOperation)
    answered = recording("theta_z1").raw["answered_while_busy"]
    assert re.search(r"list 0 1 ", answered[f"{ricoh_codes.RicohProp.SLEEP_MODE:04X}"]), "awake, asleep: as the driver"
