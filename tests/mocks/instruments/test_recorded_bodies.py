"""The drivers against cameras generated from recordings of real bodies: connect, settings, bracket, disconnect.

And the reverse: what a driver takes for granted is looked up in the camera's own list, or found in a recording; each
constant that was wrong once, put back, makes a capture fail.
"""

from __future__ import annotations

import dataclasses
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
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.camera import ThetaZ1
from drivers.usb_link import UsbLink
from mocks.instruments.canon_5d2 import SimulatedCanon5D2
from mocks.instruments.canon_records import END, CanonOptions
from mocks.instruments.clock import VirtualClock
from mocks.instruments.recorded import recorded_bodies, recording
from mocks.instruments.theta_z1 import SimulatedThetaZ1, ThetaOptions
from mocks.instruments.usb.bus import SimulatedUsbBackend
from tests.drivers.test_cameras_on_simulators import NamedShots

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
    assert body.is_whole()
    stream = b"".join(e.encode() for e in body.stream()) + END
    assert len(stream) == body.raw["events"].get("first_bytes", len(stream))
    assert len(decode_events(stream)) == len(body.stream())


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
    "SHUTTER_CODES": 0xD102,
    "SHUTTER_CODES_HALF": 0xD102,
    "ISO_CODES": 0xD103,
    "APERTURE_CODES": 0xD101,
}
"""Tables of which only what the camera lists is used (`drivers.canon_5d2.settings`)."""
IN_A_LIST = {
    "DRIVE_SINGLE": 0xD106,
    "FOCUS_MANUAL": None,  # a lens switch: reported, never listed; the value of a recorded 60D
    "WB_COLOR_TEMPERATURE": 0xD109,
    "DESTINATION_PC": 0xD11C,
    "AE_MANUAL": None,  # the dial: reported, never listed
    "AE_BULB": None,
}
NOT_RECORDED = {
    **dict.fromkeys(("BULB_START", "BULB_END"), "operations of the 5D Mark II and 1000D only"),
    **dict.fromkeys(("LENS_COVER", "LOW_BATTERY", "OBJECT_NOT_READY"), "refusals that no recording met"),
}


def _recorded(name: str) -> tuple[set[int], set[int], set[int]]:
    """Return the operations, properties and events of a body, as recorded."""
    body = recording(name)
    props = {e.prop for e in body.stream() if e.code in (0xC189, 0xC18A)}
    return set(body.codes("operations")), props, set(body.codes("events")) | {e.code for e in body.stream()}


def test_every_operation_and_property_of_the_canon_driver_is_in_a_recording() -> None:
    """Those that the 5D Mark II lists itself, and its properties in the stream of a 60D or a 5D Mark III."""
    own = set(recording("eos_5d2").codes("operations"))
    assert {op.name for op in canon_codes.CanonOperation if op not in own} == set()
    streams = [_recorded(name)[1] for name in ("eos_60d", "eos_5d3", "eos_1000d")]
    text_props = {p for p in canon_codes.CanonProp if p.name in ("OWNER", "ARTIST", "COPYRIGHT", "SERIAL_NUMBER")}
    missing = {p.name for p in canon_codes.CanonProp if not any(p in props for props in streams)}
    assert missing <= {p.name for p in text_props}


@pytest.mark.parametrize("body", ["eos_60d", "eos_5d3"])
def test_values_that_the_driver_writes_are_listed_by_real_bodies(body: str) -> None:
    stream = b"".join(e.encode() for e in recording(body).stream()) + END
    lists = {r.prop: r for r in decode_events(stream) if isinstance(r, AvailableValues)}
    numbers = {p: r.numbers for p, r in lists.items()} | recording(body).dial_at_m()
    for name, prop in LOOKED_UP.items():
        table = getattr(canon_codes, name)
        assert table.keys() & set(numbers[prop]) or name == "SHUTTER_CODES_HALF", name
        if name == "SHUTTER_CODES":
            assert set(numbers[prop]) <= table.keys(), "a real body has a shutter time that the driver does not know"
    for name, prop in IN_A_LIST.items():
        assert prop is None or getattr(canon_codes, name) in numbers[prop], name
    files = {f for formats in lists[0xD120].formats for f in formats}
    assert {(f.file_type, f.size, f.compression) for f in files} >= {(1, 0, 3), (6, 0, 4)}


def test_every_property_of_the_theta_driver_is_recorded_or_specified() -> None:
    """Recorded: in DeviceInfo of firmware 1.50.1. Later ones are asked for before use (`ThetaProperties.has`)."""
    props = set(recording("theta_z1").codes("properties"))
    later = {p.name for p in ricoh_codes.RicohProp if p not in props}
    assert later == {"IMAGE_STITCHING", "EXPOSURE_STATUS", "MODE_MEMORY"}
    assert set(recording("theta_z1").codes("operations")) >= set(ricoh_codes.RicohOperation)
    answered = recording("theta_z1").raw["answered_while_busy"]
    assert re.search(r"list 0 1 ", answered[f"{ricoh_codes.RicohProp.SLEEP_MODE:04X}"]), "awake, asleep: as the driver"


def test_records_of_the_driver_are_in_a_recorded_stream_or_listed_by_devices() -> None:
    seen = set().union(*(_recorded(name)[2] for name in recorded_bodies("canon")))
    decoded = {canon_codes.CanonEvent.PROP_VALUE_CHANGED, canon_codes.CanonEvent.AVAIL_LIST_CHANGED}
    assert seen >= decoded | {canon_codes.CanonEvent.REQUEST_GET_EVENT, canon_codes.CanonEvent.CTG_INFO_CHECK_COMPLETE}
    assert issubclass(canon_codes.CanonEvent, IntEnum)
