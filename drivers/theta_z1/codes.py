"""Code tables of the Ricoh Theta Z1 over USB; source: Ricoh's USB API specification (devices.md section 2)."""

import tomllib
from enum import IntEnum
from importlib.resources import files

# As lsusb and DeviceInfo of a Theta Z1 give them.
USB_ID = (0x05CA, 0x036D)
VENDOR_EXTENSION_ID = 0x00000006  # as the recorded body reports it


class RicohProp(IntEnum):
    """Vendor properties."""

    ERROR_INFO = 0xD006
    SHUTTER_SPEED = 0xD00F
    PERCEIVED_DEVICE_TYPE = 0xD407
    GPS_INFO = 0xD801
    SLEEP_DELAY = 0xD803
    CAPTURE_STATUS = 0xD808
    FILTER = 0xD80B
    BATTERY_STATUS = 0xD80C
    SLEEP_MODE = 0xD80E
    BRACKET_PARAMETERS = 0xD812
    COLOR_TEMPERATURE = 0xD813
    AUTO_POWER_OFF_DELAY = 0xD81B
    CAPTURED_PICTURES = 0xD822
    FUNCTION = 0xD824
    TOP_BOTTOM_CORRECTION = 0xD825
    ISO_AUTO_HIGH_LIMIT = 0xD826
    IMAGE_FORMAT = 0xD827
    IMAGE_STITCHING = 0xD834
    EXPOSURE_STATUS = 0xD83E
    MODE_MEMORY = 0xD841


class RicohOperation(IntEnum):
    """Vendor operations."""

    STOP_SELF_TIMER = 0x99A2


# Property values of Ricoh's USB API specification.
WHITE_BALANCE_COLOR_TEMPERATURE = 0x8007
EXPOSURE_PROGRAM_MANUAL = 1  # PIMA 15740
STILL_CAPTURE_SINGLE = 1  # PIMA 15740
STITCHING_STATIC = 3  # Ricoh's USB API

F_NUMBER_TIMES_100 = {0: "auto", 210: "2.1", 350: "3.5", 560: "5.6"}
F_NUMBER_INDEX = {0: "auto", 1: "2.1", 2: "3.5", 3: "5.6"}
"""The two encodings that sources disagree about (devices.md 2.6); the driver asks the camera which it uses."""

_tables = tomllib.loads((files(__package__) / "codes.toml").read_text("utf-8"))
ISO_VALUES: tuple[int, ...] = tuple(_tables["iso"])
ISO_AUTO = 0xFFFF  # Ricoh's USB API

SHUTTER_FRACTIONS: tuple[tuple[int, int], ...] = tuple((above, below) for above, below in _tables["shutter"])
"""Legal (numerator, denominator) in manual mode, longest first; on the wire LE32 numerator, LE32 denominator."""

ERROR_INFO_BITS = {int(bit, 16): (str(text), bool(usable)) for bit, (text, usable) in _tables["error_info"].items()}
"""Bit of ErrorInfo -> (meaning, whether the camera can still shoot)."""
TYPES: dict[str, list[str]] = _tables["types"]  # names of properties by the name of their `drivers.ptp.codes.DataType`
