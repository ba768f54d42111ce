"""Code tables of the Ricoh Theta Z1 over USB; source: Ricoh's USB API specification (devices.md section 2)."""

from __future__ import annotations

from enum import IntEnum

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

ISO_VALUES = (
    80, 100, 125, 160, 200, 250, 320, 400, 500, 640, 800, 1000, 1250, 1600, 2000, 2500, 3200, 4000, 5000, 6400,
)  # fmt: skip
ISO_AUTO = 0xFFFF  # Ricoh's USB API

SHUTTER_FRACTIONS: tuple[tuple[int, int], ...] = (
    (60, 1), (30, 1), (25, 1), (20, 1), (15, 1), (13, 1), (10, 1), (8, 1), (6, 1), (5, 1), (4, 1),
    (32, 10), (25, 10), (2, 1), (16, 10), (13, 10), (1, 1), (10, 13), (10, 16), (1, 2), (10, 25),
    (1, 3), (1, 4), (1, 5), (1, 6), (1, 8), (1, 10), (1, 13), (1, 15), (1, 20), (1, 25), (1, 30), (1, 40),
    (1, 50), (1, 60), (1, 80), (1, 100), (1, 125), (1, 160), (1, 200), (1, 250), (1, 320), (1, 400), (1, 500),
    (1, 640), (1, 800), (1, 1000), (1, 1250), (1, 1600), (1, 2000), (1, 2500), (1, 3200), (1, 4000), (1, 5000),
    (1, 6400), (1, 8000), (1, 10000), (1, 12500), (1, 16000), (1, 20000), (1, 25000),
)  # fmt: skip
"""Legal (numerator, denominator) in manual mode, longest first; on the wire LE32 numerator, LE32 denominator."""

ERROR_INFO_BITS: dict[int, tuple[str, bool]] = {
    0x00000001: ("no free memory", False),
    0x00000004: ("too many files", False),
    0x00000008: ("clock not set", True),
    0x00000010: ("compass error", True),
    0x00000800: ("plug-in boot error", True),
    0x00100000: ("temperature warning", True),
    0x00200000: ("battery temperature", False),
    0x00400000: ("shooting hardware failure", False),
    0x08000000: ("internal memory failure", False),
    0x20000000: ("miscellaneous failure", False),
    0x40000000: ("charging fault", False),
    0x80000000: ("board temperature error", False),
}
"""Bit of ErrorInfo -> (meaning, whether the camera can still shoot)."""
