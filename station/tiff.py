"""Directories of a TIFF structure (EXIF, CR2, DNG), read strictly and within bounds (TIFF 6.0, section 2).

Each directory is read once, at a position that no other directory may overlap, so there is nothing to loop
in; values are looked at only when asked for, and only with a count that the asker set a limit to.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass, field

from station.frame_problem import FrameProblemError, Reason

MAX_ENTRIES = 1_000
SIZES_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
BYTE, ASCII, SHORT, LONG, RATIONAL, IFD = 1, 2, 3, 4, 5, 13


@dataclass(frozen=True)
class Entry:
    """One entry of a directory: where it stands, its type, count, and where its value lies."""

    tag: int
    type: int
    count: int
    value_at: int


@dataclass(frozen=True)
class Directory:
    """The entries of one directory by tag, and where the next directory is (0: none)."""

    entries: dict[int, Entry]
    next_at: int


@dataclass
class TiffReader:
    """Reads directories and small values from the bytes of a TIFF structure.

    ``reason`` is what a problem is reported as; ``magic`` the number behind the byte order (42).
    """

    data: bytes | mmap.mmap
    reason: Reason
    order: str = field(init=False)
    first_at: int = field(init=False)
    _taken: list[tuple[int, int]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        mark = bytes(self.data[:2])
        if mark not in (b"II", b"MM") or len(self.data) < 14:
            raise self.problem(f"no TIFF header (it starts with {bytes(self.data[:4]).hex(' ')})")
        self.order = "little" if mark == b"II" else "big"
        if self.number(2, 2) != 42:
            raise self.problem(f"TIFF version {self.number(2, 2)}, not 42")
        self.first_at = self.number(4, 4)

    def problem(self, message: str) -> FrameProblemError:
        """Return the error to raise, with this reader's reason."""
        return FrameProblemError(self.reason, message)

    def number(self, at: int, size_bytes: int) -> int:
        """Return the unsigned integer at byte ``at``; the caller knows that it lies within the data."""
        raw = bytes(self.data[at : at + size_bytes])
        return int.from_bytes(raw, "little" if self.order == "little" else "big")

    def directory(self, at: int) -> Directory:
        """Read the directory at byte ``at``; refuse one out of range, read before, or overlapping another."""
        if at < 8 or at + 2 > len(self.data):
            raise self.problem(f"a directory at byte {at} of {len(self.data)}")
        count = self.number(at, 2)
        end = at + 2 + 12 * count
        if count == 0 or count > MAX_ENTRIES or end + 4 > len(self.data):
            raise self.problem(f"a directory of {count} entries at byte {at} of {len(self.data)}")
        if any(at < taken_end and taken_at < end for taken_at, taken_end in self._taken):
            raise self.problem(f"the directory at byte {at} overlaps another (a loop)")
        self._taken.append((at, end))
        entries: dict[int, Entry] = {}
        for entry_at in range(at + 2, end, 12):
            entry = self._entry(entry_at)
            if entry.tag in entries:
                raise self.problem(f"tag {entry.tag:#06x} twice in one directory")
            entries[entry.tag] = entry
        return Directory(entries, self.number(end, 4))

    def _entry(self, at: int) -> Entry:
        tag, type_, count = self.number(at, 2), self.number(at + 2, 2), self.number(at + 4, 4)
        inline = SIZES_BYTES.get(type_, 8) * count <= 4
        return Entry(tag, type_, count, at + 8 if inline else self.number(at + 8, 4))

    def _value_at(self, entry: Entry, types: tuple[int, ...], max_count: int) -> int:
        """Return where the value of an entry is, once type, count and place are found in order."""
        if entry.type not in types or not 1 <= entry.count <= max_count:
            raise self.problem(f"tag {entry.tag:#06x} has type {entry.type} and count {entry.count}")
        end = entry.value_at + SIZES_BYTES[entry.type] * entry.count
        if end > len(self.data):
            raise self.problem(f"tag {entry.tag:#06x} points to bytes {entry.value_at} to {end} of {len(self.data)}")
        return entry.value_at

    def integers(self, entry: Entry, max_count: int = 1) -> tuple[int, ...]:
        """Return the values of a BYTE, SHORT, LONG or IFD entry."""
        at = self._value_at(entry, (BYTE, SHORT, LONG, IFD), max_count)
        size_bytes = SIZES_BYTES[entry.type]
        return tuple(self.number(at + i * size_bytes, size_bytes) for i in range(entry.count))

    def rational(self, entry: Entry) -> float | None:
        """Return the value of a RATIONAL entry; None for 0/0, which cameras write for "unknown"."""
        at = self._value_at(entry, (RATIONAL,), 1)
        numerator, denominator = self.number(at, 4), self.number(at + 4, 4)
        if denominator == 0 and numerator != 0:
            raise self.problem(f"tag {entry.tag:#06x} is {numerator}/0")
        return numerator / denominator if denominator else None

    def text(self, entry: Entry, max_count: int = 256) -> str:
        """Return an ASCII entry up to its first NUL, trimmed, with everything unprintable replaced by "?"."""
        at = self._value_at(entry, (ASCII,), max_count)
        raw = bytes(self.data[at : at + entry.count]).split(b"\0", 1)[0]
        return "".join(chr(c) if 32 <= c < 127 else "?" for c in raw).strip()
