"""The 5D Mark II's settings as its GetEvent stream shows them: values, lists, and the order of the first reply.

Codes and encodings as libgphoto2 documents them; the order and the list lengths are those of a real 60D's log, its
nearest relative with one.
"""

from __future__ import annotations

from collections.abc import Iterator

from drivers.ptp import canon_codes
from drivers.ptp.canon_codes import CanonProp
from mocks import canon_stream
from mocks.canon_stream import Record
from mocks.ptp_wire import u32s

BULB = 0x0C
MODEL_ID_5D2 = 0x80000218
MODES = {"p": 0, "tv": 1, "av": 2, "m": 3, "bulb": 4, "green": 9}
"""Positions of the mode dial and the value of AutoExposureMode each gives."""
WHITE_BALANCES = (0, 1, 8, 2, 3, 4, 5, 6, 9)
KELVINS = tuple(range(2500, 10001, 100))
DESTINATIONS = (2, 4, 6)
WRITABLE: dict[int, tuple[int, ...]] = {
    CanonProp.APERTURE: tuple(canon_codes.APERTURE_CODES),
    CanonProp.SHUTTER_SPEED: tuple(canon_codes.SHUTTER_CODES),
    CanonProp.ISO_SPEED: tuple(canon_codes.ISO_CODES),
    CanonProp.EXP_COMPENSATION: (0x10, 0x0D, 0x0B, 0x08, 0x05, 0x03, 0, 0xFD, 0xFB, 0xF8, 0xF5, 0xF3, 0xF0),
    CanonProp.DRIVE_MODE: (0, 1, 0x10, 0x11),
    CanonProp.METERING_MODE: (1, 3, 4, 5),
    CanonProp.WHITE_BALANCE: WHITE_BALANCES,
    CanonProp.COLOR_TEMPERATURE: KELVINS,
    CanonProp.COLOR_SPACE: (1, 2),
    CanonProp.PICTURE_STYLE: (0x81, 0x82, 0x83, 0x84, 0x85, 0x86, 0x21, 0x22, 0x23),
    CanonProp.CAPTURE_DESTINATION: DESTINATIONS,
    CanonProp.EVF_OUTPUT_DEVICE: (0, 1, 2),
}
"""Numeric properties that the host may write, with their lists."""
FREELY_WRITABLE = (CanonProp.AUTO_POWER_OFF, CanonProp.CAMERA_TIME, CanonProp.MIRROR_LOCKUP_STATE)
"""Numeric properties without a list."""
TEXTS = (CanonProp.OWNER, CanonProp.ARTIST, CanonProp.COPYRIGHT, CanonProp.SERIAL_NUMBER)
FORMAT_COPIES = (CanonProp.IMAGE_FORMAT, 0xD121, 0xD122, 0xD123)
"""ImageFormat, and its copies for CF, SD and PC."""
OTHER_SHOTS = (0xD11E, 0xD11F)
"""Two numbers that follow AvailableShots in the log; nobody says what they are."""

DUMP_ORDER = (
    0xD105, 0xD108, 0xD106, 0xD107, 0xD109, 0xD10A, 0xD10F, 0xD11B, 0xD114, 0xD116, 0xD110, 0xD101, 0xD102, 0xD103,
    0xD104, 0xD11D, 0xD111, 0xD113, 0xD120, 0xD121, 0xD122, 0xD123, 0xD11C, 0xD11E, 0xD11F, 0xD1B0, 0xD1BF, 0xD115,
    0xD1D0, 0xD1D1, 0xD1AF,
)  # fmt: skip


def image_format(*files: tuple[int, int, int]) -> bytes:
    """Return the value of ImageFormat for files of (type, size, compression)."""
    return u32s([len(files)]) + b"".join(u32s([0x10, *file]) for file in files)


JPEG_LARGE_FINE = (canon_codes.IMAGE_TYPE_JPEG, canon_codes.IMAGE_SIZE_LARGE, canon_codes.IMAGE_COMPRESSION_FINE)
RAW_LARGE = (canon_codes.IMAGE_TYPE_RAW, canon_codes.IMAGE_SIZE_LARGE, canon_codes.IMAGE_COMPRESSION_RAW)
JPEGS = tuple(
    (canon_codes.IMAGE_TYPE_JPEG, size, compression)
    for size in canon_codes.IMAGE_SIZES_PX
    for compression in (canon_codes.IMAGE_COMPRESSION_FINE, canon_codes.IMAGE_COMPRESSION_NORMAL)
)
FORMATS: dict[bytes, tuple[tuple[int, int, int], ...]] = {
    image_format(*files): files
    for files in (*((jpeg,) for jpeg in JPEGS), (RAW_LARGE,), *((RAW_LARGE, jpeg) for jpeg in JPEGS))
}
"""Every ImageFormat the camera takes, with the files it makes."""


def initial_numbers(mode: str, *, manual_focus: bool, auto_power_off_s: int) -> dict[int, int]:
    """Return the numeric settings a camera is switched on with."""
    return {
        CanonProp.AUTO_EXPOSURE_MODE: MODES[mode],
        CanonProp.FOCUS_MODE: canon_codes.FOCUS_MANUAL if manual_focus else 0,
        CanonProp.DRIVE_MODE: 0,
        CanonProp.METERING_MODE: 3,
        CanonProp.WHITE_BALANCE: 0,
        CanonProp.COLOR_TEMPERATURE: 5200,
        CanonProp.COLOR_SPACE: 1,
        CanonProp.AVAILABLE_SHOTS: 0,
        CanonProp.AUTO_POWER_OFF: auto_power_off_s,
        CanonProp.MODEL_ID: MODEL_ID_5D2,
        CanonProp.PICTURE_STYLE: 0x81,
        CanonProp.APERTURE: 0x30,
        CanonProp.SHUTTER_SPEED: BULB if mode == "bulb" else 0x68,
        CanonProp.ISO_SPEED: 0x48,
        CanonProp.EXP_COMPENSATION: 0,
        0xD11D: 0,
        CanonProp.BATTERY_POWER: 2,
        CanonProp.CAMERA_TIME: 0,
        CanonProp.CAPTURE_DESTINATION: canon_codes.DESTINATION_CARD,
        0xD11E: 0,
        0xD11F: 0,
        CanonProp.EVF_OUTPUT_DEVICE: 0,
        CanonProp.MIRROR_LOCKUP_STATE: 0,
    }


class CanonSettings:
    """All properties with their present values."""

    def __init__(self, numbers: dict[int, int], serial: str) -> None:
        self.numbers = numbers
        self.texts: dict[int, str] = dict.fromkeys(map(int, TEXTS), "") | {int(CanonProp.SERIAL_NUMBER): serial}
        self.format = image_format(JPEG_LARGE_FINE)

    def value_record(self, prop: int) -> Record | None:
        """Return PropValueChanged of a property, or None for one the camera lacks."""
        if prop in FORMAT_COPIES:
            return canon_stream.structure(prop, self.format)
        if prop in self.texts:
            return canon_stream.text(prop, self.texts[prop])
        return canon_stream.number(prop, self.numbers[prop]) if prop in self.numbers else None

    def list_record(self, prop: int) -> Record:
        """Return AvailListChanged of a property, empty where the host has no choice."""
        if prop in FORMAT_COPIES:
            return canon_stream.structured_choices(prop, FORMATS)
        if prop == CanonProp.SHUTTER_SPEED and self.numbers[CanonProp.AUTO_EXPOSURE_MODE] == canon_codes.AE_BULB:
            return canon_stream.choices(prop, (BULB,))
        return canon_stream.choices(prop, WRITABLE[prop]) if prop in WRITABLE else canon_stream.no_choices(prop)

    def choices(self, prop: int) -> tuple[int, ...]:
        """Return the list of a numeric property; empty where any value goes."""
        if prop == CanonProp.SHUTTER_SPEED and self.numbers[CanonProp.AUTO_EXPOSURE_MODE] == canon_codes.AE_BULB:
            return (BULB,)
        return WRITABLE.get(prop, ())

    def everything(self) -> Iterator[Record]:
        """Yield the first reply: all values, then all lists."""
        for prop in DUMP_ORDER:
            record = self.value_record(prop)
            if record is not None:
                yield record
        for prop in DUMP_ORDER:
            if prop in WRITABLE or prop in FORMAT_COPIES or prop == CanonProp.FOCUS_MODE:
                yield self.list_record(prop)

    @property
    def files(self) -> tuple[tuple[int, int, int], ...]:
        """What one exposure makes: (type, size, compression) of each file."""
        return FORMATS[self.format]
