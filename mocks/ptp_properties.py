"""Device properties of a simulated camera: their types, forms, rules and the DevicePropDesc dataset."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from drivers.ptp.codes import DataType, FormFlag
from mocks import ptp_wire
from mocks.ptp_wire import Value


@dataclass(frozen=True)
class Property:
    """One property: ``choices`` makes an enumeration, ``span`` (min, max, step) a range."""

    code: int
    data_type: int
    default: Value
    writable: bool = False
    choices: tuple[Value, ...] = ()
    span: tuple[int, int, int] | None = None

    def allows(self, value: Value) -> bool:
        """Whether the form allows ``value``."""
        if self.choices:
            return value in self.choices
        if self.span and isinstance(value, int):
            low, high, step = self.span
            return low <= value <= high and (value - low) % step == 0
        return True

    def describe(self, current: Value, choices: tuple[Value, ...]) -> bytes:
        """Return the DevicePropDesc dataset with the choices as they are now."""
        head = struct.pack("<HHB", self.code, self.data_type, int(self.writable))
        values = ptp_wire.typed(self.data_type, self.default) + ptp_wire.typed(self.data_type, current)
        if choices:
            items = b"".join(ptp_wire.typed(self.data_type, c) for c in choices)
            return head + values + struct.pack("<BH", FormFlag.ENUMERATION, len(choices)) + items
        if self.span:
            span = b"".join(ptp_wire.typed(self.data_type, v) for v in self.span)
            return head + values + bytes([FormFlag.RANGE]) + span
        return head + values + bytes([FormFlag.NONE])


class PropertyTable:
    """Properties with their current values."""

    def __init__(self, properties: Iterable[Property]) -> None:
        self.properties = {p.code: p for p in properties}
        self.values: dict[int, Value] = {p.code: p.default for p in self.properties.values()}

    def number(self, code: int) -> int:
        """Return the current value of an integer property."""
        value = self.values[code]
        assert isinstance(value, int)
        return value

    def text(self, code: int) -> str:
        """Return the current value of a string property."""
        value = self.values[code]
        assert isinstance(value, str)
        return value

    def reset(self, keep: Iterable[int] = ()) -> None:
        """Bring every writable property but ``keep`` back to its default."""
        kept = set(keep)
        for code, prop in self.properties.items():
            if prop.writable and code not in kept:
                self.values[code] = prop.default


def u8(code: int, default: int, *choices: int, writable: bool = True) -> Property:
    """Return an 8-bit property."""
    return Property(code, DataType.UINT8, default, writable, choices)


def u16(code: int, default: int, *choices: int, writable: bool = True) -> Property:
    """Return a 16-bit property."""
    return Property(code, DataType.UINT16, default, writable, choices)
