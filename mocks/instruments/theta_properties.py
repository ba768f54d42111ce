"""The Theta Z1's device properties (Ricoh USB API specification; forms as the specification lists them)."""

from collections.abc import Iterator

from drivers.ptp.codes import DataType, Prop
from drivers.theta_z1 import codes
from mocks.instruments.ptp.datasets import Property
from processing.ground.tables import table_of

# Values as Ricoh's USB API specification lists them.
AUTO_SHUTTER = 0
TAKES_COLOR_TEMPERATURE = 0x8007  # Ricoh's USB API: the white balance that lets a temperature be set
ISO_LIMITS = tuple(v for v in codes.ISO_VALUES if v >= 200)
LATER_PROPERTIES = (codes.RicohProp.EXPOSURE_STATUS, codes.RicohProp.MODE_MEMORY)
"""Of firmware 3.10.2 and 3.60.3."""


def shutter_fraction(value: int) -> tuple[int, int]:
    """Return the (numerator, denominator) of a property value: its little-endian bytes are one, then the other."""
    return value & 0xFFFFFFFF, value >> 32


def theta_properties(listed: tuple[int, ...], *, f_number_index: bool, image_sizes: tuple[str, ...]) -> list[Property]:
    """Return the properties that DeviceInfo lists, in the defaults the camera wakes with.

    Those that neither the recording nor the specification explains are there, read-only and 0.
    """
    f_numbers = tuple(codes.F_NUMBER_INDEX if f_number_index else codes.F_NUMBER_TIMES_100)
    shutters = (AUTO_SHUTTER, *(below << 32 | above for above, below in codes.SHUTTER_FRACTIONS))
    isos, u16, ricoh = (codes.ISO_AUTO, *codes.ISO_VALUES), DataType.UINT16, codes.RicohProp
    computed = [
        Property(Prop.IMAGE_SIZE, DataType.STRING, image_sizes[0], writable=True, choices=image_sizes),
        Property(Prop.F_NUMBER, u16, 0, writable=True, choices=f_numbers),
        Property(Prop.EXPOSURE_INDEX, u16, codes.ISO_AUTO, writable=True, choices=isos),
        Property(ricoh.SHUTTER_SPEED, DataType.UINT64, AUTO_SHUTTER, writable=True, choices=shutters),
        Property(ricoh.BRACKET_PARAMETERS, DataType.ARRAY | DataType.UINT128, (), writable=True),
        Property(ricoh.ISO_AUTO_HIGH_LIMIT, u16, 3200, writable=True, choices=ISO_LIMITS),
    ]
    explained = {p.code: p for p in (*computed, *_tabled())}
    return [explained.get(code) or Property(code, DataType.UINT8, 0) for code in listed]


def _tabled() -> Iterator[Property]:
    named: dict[str, int] = {prop.name: prop for prop in (*Prop, *codes.RicohProp)}
    for name, row in table_of(__package__, "theta_properties").items():
        code, span = named.get(name) or int(name, 16), row.get("span")
        default, writable, choices = row.get("default", 0), row.get("writable", True), tuple(row.get("choices", ()))
        yield Property(code, DataType[row["type"]], default, writable, choices, tuple(span) if span else None)
