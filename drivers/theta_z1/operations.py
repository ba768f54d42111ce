"""The Theta Z1's encodings as pure functions: shutter fractions, f-numbers, error bits.

Source: Ricoh USB API specification and libgphoto2 (devices.md 2.5 to 2.8).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from drivers.errors import ProtocolViolationError
from drivers.theta_z1.codes import ERROR_INFO_BITS, F_NUMBER_INDEX

SHUTTER_BYTES = 8
F_NUMBER_560 = 560
"""In the enumeration of a camera that counts f-numbers times 100."""


@dataclass(frozen=True)
class Fraction32:
    """A shutter time as the camera writes it: two u32; 4/1 is four seconds, 1/60 a sixtieth, 0/0 automatic."""

    numerator: int
    denominator: int

    @classmethod
    def from_u64(cls, value: int) -> Fraction32:
        """Split the integer that property D00F carries: numerator in its low half (first on the wire)."""
        return cls(value & 0xFFFFFFFF, value >> 32)

    def to_u64(self) -> int:
        """Return the integer that property D00F carries."""
        return self.denominator << 32 | self.numerator

    def to_bytes(self) -> bytes:
        """Return the eight bytes on the wire: LE32 numerator, LE32 denominator."""
        return struct.pack("<II", self.numerator, self.denominator)

    @classmethod
    def from_bytes(cls, raw: bytes) -> Fraction32:
        """Decode eight bytes of the wire; `ProtocolViolationError` for any other length."""
        if len(raw) != SHUTTER_BYTES:
            raise ProtocolViolationError(
                f"a shutter speed of {len(raw)} bytes, not {SHUTTER_BYTES}",
                where="Theta Z1",
                likely="the answer was cut",
                advice="resynchronise and read it again",
            )
        return cls(*struct.unpack("<II", raw))

    @property
    def is_time(self) -> bool:
        """Whether it stands for a time (0/0 is automatic)."""
        return self.numerator > 0 and self.denominator > 0

    @property
    def seconds(self) -> float:
        """Nominal exposure time; only where `is_time`."""
        return self.numerator / self.denominator

    def __str__(self) -> str:
        return f"{self.numerator}/{self.denominator}"


def nearest_shutter(shutter_s: float, fractions: Collection[Fraction32]) -> Fraction32:
    """Return the fraction nearest to ``shutter_s`` (> 0 s) on the scale of stops.

    Raises `ValueError`: ``shutter_s`` is no positive time, or there is nothing to choose from.
    """
    if not fractions or not (shutter_s > 0 and math.isfinite(shutter_s)):
        raise ValueError(f"no shutter time for {shutter_s!r} s among {len(fractions)}")
    return min(fractions, key=lambda f: abs(math.log2(f.seconds / shutter_s)))


def f_number_codes(enumeration: Iterable[int]) -> Mapping[int, str] | None:
    """Return the f-number encoding (code -> text) that an enumeration of property 5007 shows, or None.

    Sources disagree: newer pages of the specification number the apertures 1, 2, 3; working scripts write the PTP
    form, f-number times 100. The camera's own list decides.
    """
    values = set(enumeration)
    if F_NUMBER_560 in values:
        return {v: f"{v / 100:g}" if v else "auto" for v in sorted(values)}
    if values == set(F_NUMBER_INDEX):
        return F_NUMBER_INDEX
    return None


def f_number_code(f_number: float, codes: Mapping[int, str]) -> int | None:
    """Return the code of an f-number in an encoding, or None where it has none."""
    return next(
        (code for code, text in codes.items() if code and math.isclose(float(text), f_number, rel_tol=1e-3)), None
    )


def error_texts(error_info: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (problems, warnings) that the bits of ErrorInfo (D006) name; unknown bits are warnings."""
    problems: list[str] = []
    warnings: list[str] = []
    for bit in (1 << n for n in range(32)):
        if error_info & bit:
            text, can_shoot = ERROR_INFO_BITS.get(bit, (f"unknown error bit {bit:#010x}", True))
            (warnings if can_shoot else problems).append(text)
    return tuple(problems), tuple(warnings)
