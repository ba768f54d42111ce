"""The few EXIF facts that a frame is checked by, read from the TIFF block of the Exif segment (CIPA DC-008).

Why not a library: maker notes are where EXIF readers break (most of libexif's CVEs), libraries read them or guess past
damage in silence, and twelve tags of two directories need one page. Thumbnails, GPS, interoperability and maker notes
are never visited. The reader runs in the worker process all the same (`station.frames.worker`).
"""

import itertools
import mmap
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from station.frames.problems import FrameProblemError, Reason

# Directories of a TIFF structure (EXIF, CR2, DNG), read strictly and within bounds (TIFF 6.0, section 2).
#
# Each directory is read once, at a position that no other directory may overlap, so there is nothing to loop
# in; values are looked at only when asked for, and only with a count that the asker set a limit to.

# Chosen: cameras write below a hundred. Sizes by type: TIFF 6.0, section 2.
MAX_ENTRIES = 1_000
SIZES_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
BYTE, ASCII, SHORT, LONG, RATIONAL, IFD = 1, 2, 3, 4, 5, 13
YEARS = range(1970, 2101)  # chosen: of dates that a camera can mean; time zones and offsets stay within datetime's
MAX_EXPOSURE_S = 3600.0  # chosen: longer is damage, not a bracket

_MAKE, _MODEL, _ORIENTATION, _EXIF_DIRECTORY = 0x010F, 0x0110, 0x0112, 0x8769
_EXPOSURE_TIME, _F_NUMBER, _ISO = 0x829A, 0x829D, 0x8827
_TAKEN, _OFFSET, _TAKEN_OFFSET, _TAKEN_SUBSECOND = 0x9003, 0x9010, 0x9011, 0x9291
_WIDTH, _HEIGHT, _WHITE_BALANCE, _SERIAL = 0xA002, 0xA003, 0xA403, 0xA431


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
        return int.from_bytes(bytes(self.data[at : at + size_bytes]), "little" if self.order == "little" else "big")

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


def read_exif(block: bytes | mmap.mmap) -> dict[str, Any]:
    """Return the facts of a TIFF block (at most 64 KiB, as a JPEG segment is) or of a raw file, whole.

    They are the fields of `station.frames.facts.ExifRecord`, fit for JSON, and may be in the main directory (TIFF/EP).
    Raises `FrameProblemError`: ``exif_damaged``: not a TIFF block, a directory or a wanted value out of range,
    overlapping or repeated, or a value that cannot be (1/0 s, month 13).
    """
    reader = TiffReader(block, Reason.EXIF_DAMAGED)
    main = reader.directory(reader.first_at).entries
    pointer = main.get(_EXIF_DIRECTORY)
    exif = main if pointer is None else reader.directory(reader.integers(pointer)[0]).entries
    taken = _taken(reader, exif)
    return {
        "exposure_s": _seconds(reader, exif.get(_EXPOSURE_TIME)),
        "f_number": _rational(reader, exif.get(_F_NUMBER)),
        "iso": _iso(reader, exif.get(_ISO)),
        "taken_local": None if taken is None else taken.isoformat(),
        "offset_min": parse_offset(_text(reader, exif, _TAKEN_OFFSET) or _text(reader, exif, _OFFSET)),
        "make": _text(reader, main, _MAKE),
        "model": _text(reader, main, _MODEL),
        "serial": _text(reader, exif, _SERIAL),
        "white_balance": _integer(reader, exif.get(_WHITE_BALANCE)),
        "orientation": _integer(reader, main.get(_ORIENTATION)),
        "width_px": _integer(reader, exif.get(_WIDTH)),
        "height_px": _integer(reader, exif.get(_HEIGHT)),
    }


def _text(reader: TiffReader, entries: Mapping[int, Entry], tag: int) -> str:
    entry = entries.get(tag)
    return "" if entry is None else reader.text(entry)


def _integer(reader: TiffReader, entry: Entry | None) -> int | None:
    return None if entry is None else reader.integers(entry)[0]


def _rational(reader: TiffReader, entry: Entry | None) -> float | None:
    """Return a positive ratio; 0 stands for "unknown" (a lens without contacts writes F0)."""
    return (None if entry is None else reader.rational(entry)) or None


def _seconds(reader: TiffReader, entry: Entry | None) -> float | None:
    value = _rational(reader, entry)
    if value is not None and value > MAX_EXPOSURE_S:
        raise reader.problem(f"an exposure time of {value:g} s")
    return value


def _iso(reader: TiffReader, entry: Entry | None) -> int | None:
    """Return the sensitivity; 65535 means "larger than this field holds" and says nothing."""
    value = None if entry is None else reader.integers(entry, max_count=3)[0]
    return None if value in (0, 65535) else value


_OTHER_DATE = re.compile(r"\d{1,4}[-/.]\d\d?[-/.]\d{1,4}([ T][\d:.]+)?(Z|[+-][\d:]+)?")  # as other programs write it


def _taken(reader: TiffReader, exif: Mapping[int, Entry]) -> datetime | None:
    """Return the moment by the camera's clock; None for blanks, an odd year, and dates in another form (ISO 8601)."""
    text = _text(reader, exif, _TAKEN)
    try:
        taken = datetime.strptime(text, "%Y:%m:%d %H:%M:%S")  # noqa: DTZ007 (the camera's clock has no zone)
    except ValueError as error:
        if not text.strip(" :0") or _OTHER_DATE.fullmatch(text):
            return None
        raise reader.problem(f"not a date: {text[:40]!r}") from error
    if taken.year not in YEARS:
        return None
    digits = _text(reader, exif, _TAKEN_SUBSECOND)
    if digits.isdigit():
        taken = taken.replace(microsecond=int(digits[:6].ljust(6, "0")))
    return taken


def parse_offset(text: str) -> int | None:
    """Return minutes east of UTC for "+02:00"; None for anything else, for nothing depends on it."""
    sign, digits = text[:1], text[1:].replace(":", "")
    if sign not in ("+", "-") or len(digits) != 4 or not digits.isdigit():
        return None
    minutes = int(digits[:2]) * 60 + int(digits[2:])
    if minutes > 14 * 60:
        return None
    return -minutes if sign == "-" else minutes


# Whether a raw companion is what its name says: magic, size, and directories that point inside the file.
#
# Nothing of a raw file is decoded: frames are measured on the JPEG, and the raw file is kept for later work.

# Chosen: the smallest raw file of our cameras has megabytes and a handful of directories.
MIN_SIZE_BYTES = 100_000
MAX_DIRECTORIES = 16  # chosen: cameras write four to six
_BITS, _COLOURS, _PLANES = 258, 262, 284
_NOT_RGB = (5, 8, 9, 10)  # photometric interpretation: CMYK, three kinds of Lab; TIFF 6.0
_STRIP_OFFSETS, _STRIP_SIZES, _TILE_OFFSETS, _TILE_SIZES, _CHILDREN, _DNG_VERSION = 273, 279, 324, 325, 330, 0xC612
"""TIFF 6.0; EP's SubIFDs; DNG specification."""


def check_raw(data: bytes | mmap.mmap, format_: str) -> None:
    """Check a CR2 or DNG file (``format_`` "cr2" or "dng"), the whole file as bytes or mapped.

    Raises `FrameProblemError`: ``not_raw``, ``truncated`` or ``damaged``.
    """
    if len(data) < 16 or bytes(data[:4]) not in (b"II*\0", b"MM\0*"):
        raise FrameProblemError(Reason.NOT_RAW, f"not a {format_.upper()} file: no TIFF header")
    if len(data) < MIN_SIZE_BYTES:
        raise FrameProblemError(Reason.TRUNCATED, f"{len(data)} bytes; no raw file is below {MIN_SIZE_BYTES}")
    if format_ == "cr2" and bytes(data[8:11]) != b"CR\x02":
        raise FrameProblemError(Reason.NOT_RAW, "not a CR2 file: the mark CR 2 is missing at byte 8")
    reader = TiffReader(data, Reason.DAMAGED)
    # The chain of directories and, for DNG, the children of the first
    directories: list[Directory] = []
    pending = [reader.first_at]
    while pending:
        if len(directories) >= MAX_DIRECTORIES:
            raise reader.problem(f"more than {MAX_DIRECTORIES} directories")
        directory = reader.directory(pending.pop(0))
        directories.append(directory)
        children = directory.entries.get(_CHILDREN)
        pending += reader.integers(children, MAX_DIRECTORIES) if children else ()
        pending += [directory.next_at] if directory.next_at else []
    if format_ == "dng" and _DNG_VERSION not in directories[0].entries:
        raise FrameProblemError(Reason.NOT_RAW, "not a DNG file: no DNG version in its first directory")
    _check_strips(reader, directories)


def check_tiff(data: bytes) -> bytes:
    """Return the bytes of a TIFF picture, in which EXIF is looked for, once its strips are found to lie inside.

    Raises `FrameProblemError`: ``damaged``, ``truncated``, or ``unsupported`` for CMYK, CIELab and the like, and for
    more than 8 bits with the channels one after the other or 0 for white, of which the decoder takes no notice.
    """
    reader = TiffReader(data, Reason.DAMAGED)
    first = reader.directory(reader.first_at)
    _check_strips(reader, [first])
    wanted = [first.entries.get(tag) for tag in (_BITS, _COLOURS, _PLANES)]
    bits, colours, planes = (None if one is None else reader.integers(one, 8)[0] for one in wanted)
    if colours in _NOT_RGB:
        raise FrameProblemError(Reason.UNSUPPORTED, "its colours are neither grey nor RGB: save it as RGB")
    if (bits or 1) > 8 and (planes == 2 or colours == 0):
        raise FrameProblemError(Reason.UNSUPPORTED, "its channels lie one after the other, or its white is 0")
    return data


def _check_strips(reader: TiffReader, directories: Sequence[Directory]) -> None:
    """Refuse directories without strips or tiles, and any that reach beyond the file."""
    end = 0
    for one, tags in itertools.product(directories, ((_STRIP_OFFSETS, _STRIP_SIZES), (_TILE_OFFSETS, _TILE_SIZES))):
        offsets, sizes = map(one.entries.get, tags)
        if offsets is not None and sizes is not None:
            places = zip(reader.integers(offsets, 100_000), reader.integers(sizes, 100_000), strict=False)
            end = max([end, *(at + size for at, size in places)])
    if end == 0:
        raise reader.problem("no picture in any directory")
    if end > len(reader.data):
        raise FrameProblemError(Reason.TRUNCATED, f"picture data to byte {end} of {len(reader.data)}")
