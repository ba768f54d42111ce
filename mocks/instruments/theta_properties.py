"""The Theta Z1's device properties (Ricoh USB API specification; forms as the specification lists them)."""

from drivers.ptp.codes import DataType, Prop
from drivers.theta_z1 import codes
from mocks.instruments.ptp.datasets import Property, u8, u16

# Values as Ricoh's USB API specification lists them.
AUTO_SHUTTER = 0
TAKES_COLOR_TEMPERATURE = 0x8007  # Ricoh's USB API: the white balance that lets a temperature be set
ISO_LIMITS = tuple(v for v in codes.ISO_VALUES if v >= 200)
WHITE_BALANCES = (2, 4, 0x8001, 0x8002, 6, 0x8020, 0x8003, 0x8004, 0x8005, 0x8006, TAKES_COLOR_TEMPERATURE, 0x8008)
BIASES = (-2000, -1700, -1300, -1000, -700, -300, 0, 300, 700, 1000, 1300, 1700, 2000)
PROGRAMS = (1, 2, 3, 4, 0x8003)
STILL_MODES = (1, 3, 0x8002, 0x8003, 0x8004, 0x8005, 0x8006, 0x8007)
LATER_PROPERTIES = (codes.RicohProp.EXPOSURE_STATUS, codes.RicohProp.MODE_MEMORY)
"""Of firmware 3.10.2 and 3.60.3."""


def shutter_value(fraction: tuple[int, int]) -> int:
    """Return (numerator, denominator) as the integer whose little-endian bytes are numerator, then denominator."""
    numerator, denominator = fraction
    return denominator << 32 | numerator


def shutter_fraction(value: int) -> tuple[int, int]:
    """Return the (numerator, denominator) of a property value."""
    return value & 0xFFFFFFFF, value >> 32


def theta_properties(listed: tuple[int, ...], *, f_number_index: bool, image_sizes: tuple[str, ...]) -> list[Property]:
    """Return the properties that DeviceInfo lists, in the defaults the camera wakes with.

    Those that neither the recording nor the specification explains are there, read-only and 0.
    """
    f_numbers = tuple(codes.F_NUMBER_INDEX if f_number_index else codes.F_NUMBER_TIMES_100)
    known = [*_standard(f_numbers, image_sizes), *_vendor()]
    known += [u8(codes.RicohProp.EXPOSURE_STATUS, 0, writable=False), u8(codes.RicohProp.MODE_MEMORY, 0, 0, 1)]
    known += [u8(0xD814, 0, 0, 1), u8(0xD82C, 2, 1, 2, 3)]  # as recorded; the specification does not name them
    explained = {p.code: p for p in known}
    return [explained.get(code) or u8(code, 0, writable=False) for code in listed]


def _standard(f_numbers: tuple[int, ...], image_sizes: tuple[str, ...]) -> list[Property]:
    text, u32 = DataType.STRING, DataType.UINT32
    return [
        Property(Prop.BATTERY_LEVEL, DataType.UINT8, 100, span=(0, 100, 1)),
        u16(Prop.FUNCTIONAL_MODE, 0, writable=False),
        Property(Prop.IMAGE_SIZE, text, image_sizes[0], writable=True, choices=image_sizes),
        u16(Prop.WHITE_BALANCE, 2, *WHITE_BALANCES),
        u16(Prop.F_NUMBER, 0, *f_numbers),
        u16(Prop.EXPOSURE_PROGRAM_MODE, 2, *PROGRAMS),
        u16(Prop.EXPOSURE_INDEX, codes.ISO_AUTO, codes.ISO_AUTO, *codes.ISO_VALUES),
        Property(Prop.EXPOSURE_BIAS, DataType.INT16, 0, writable=True, choices=BIASES),
        Property(Prop.DATE_TIME, text, "", writable=True),
        Property(Prop.CAPTURE_DELAY, u32, 0, writable=True, span=(0, 10000, 1000)),
        u16(Prop.STILL_CAPTURE_MODE, 1, *STILL_MODES),
        Property(Prop.TIMELAPSE_NUMBER, DataType.UINT16, 0, writable=True, span=(0, 9999, 1)),
        Property(Prop.TIMELAPSE_INTERVAL, u32, 6000, writable=True, span=(6000, 3600000, 1000)),
        Property(Prop.AUDIO_VOLUME, u32, 100, writable=True, span=(0, 100, 1)),
    ]


def _vendor() -> list[Property]:
    u32 = DataType.UINT32
    shutters = (AUTO_SHUTTER, *map(shutter_value, codes.SHUTTER_FRACTIONS))
    return [
        Property(codes.RicohProp.ERROR_INFO, u32, 0),
        Property(codes.RicohProp.SHUTTER_SPEED, DataType.UINT64, AUTO_SHUTTER, writable=True, choices=shutters),
        Property(codes.RicohProp.PERCEIVED_DEVICE_TYPE, u32, 1),
        Property(codes.RicohProp.GPS_INFO, DataType.STRING, "", writable=True),
        Property(codes.RicohProp.SLEEP_DELAY, DataType.UINT16, 180, writable=True, span=(0, 65534, 1)),
        u8(codes.RicohProp.CAPTURE_STATUS, 0, writable=False),
        u8(codes.RicohProp.FILTER, 0, 0, 1, 2, 3, 4),
        u8(codes.RicohProp.BATTERY_STATUS, 0, writable=False),
        u8(codes.RicohProp.SLEEP_MODE, 0, 0, 1),
        Property(codes.RicohProp.BRACKET_PARAMETERS, DataType.ARRAY | DataType.UINT128, (), writable=True),
        Property(codes.RicohProp.COLOR_TEMPERATURE, DataType.UINT16, 5000, writable=True, span=(2500, 10000, 100)),
        Property(codes.RicohProp.AUTO_POWER_OFF_DELAY, u32, 64800, writable=True, span=(0, 2592000, 60)),
        u16(codes.RicohProp.CAPTURED_PICTURES, 0, writable=False),
        u8(codes.RicohProp.FUNCTION, 0, 0, 1, 2),
        u8(codes.RicohProp.TOP_BOTTOM_CORRECTION, 0, 0, 1, 2, 3, 4),
        u16(codes.RicohProp.ISO_AUTO_HIGH_LIMIT, 3200, *ISO_LIMITS),
        u8(codes.RicohProp.IMAGE_FORMAT, 0, 0, 1),
        u16(codes.RicohProp.IMAGE_STITCHING, 1, 1, 2, 3, 4, 6, 7),
    ]
