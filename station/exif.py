"""The few EXIF facts that a frame is checked by, read from the TIFF block of the Exif segment (CIPA DC-008).

Why not a library: maker notes are where EXIF readers break (most of libexif's CVEs), libraries read them or
guess past damage in silence, and twelve tags of two directories need one page. Thumbnails, GPS,
interoperability and maker notes are never visited. The reader runs in the worker process all the same
(`station.frame_worker`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from station.frame_problem import Reason
from station.tiff import Entry, TiffReader

MAX_EXPOSURE_S = 3600.0

_MAKE, _MODEL, _ORIENTATION, _EXIF_DIRECTORY = 0x010F, 0x0110, 0x0112, 0x8769
_EXPOSURE_TIME, _F_NUMBER, _ISO = 0x829A, 0x829D, 0x8827
_TAKEN, _OFFSET, _TAKEN_OFFSET, _TAKEN_SUBSECOND = 0x9003, 0x9010, 0x9011, 0x9291
_WIDTH, _HEIGHT, _WHITE_BALANCE, _SERIAL = 0xA002, 0xA003, 0xA403, 0xA431


@dataclass(frozen=True)
class ExifFacts:
    """What the camera wrote about the frame; None or "" where it wrote nothing.

    ``taken_local`` is the camera's own clock, without zone; ``offset_min`` its zone, minutes east of UTC,
    where given. ``white_balance`` is 0 for automatic and 1 for manual.
    """

    exposure_s: float | None = None
    f_number: float | None = None
    iso: int | None = None
    taken_local: datetime | None = None
    offset_min: int | None = None
    make: str = ""
    model: str = ""
    serial: str = ""
    white_balance: int | None = None
    orientation: int | None = None
    width_px: int | None = None
    height_px: int | None = None


def read_exif(block: bytes) -> ExifFacts:
    """Return the facts of a TIFF block (at most 64 KiB, as a JPEG segment is).

    Raises
    ------
    FrameProblemError
        ``exif_damaged``: not a TIFF block, a directory or a wanted value out of range, overlapping or
        repeated, or a value that cannot be (1/0 s, month 13).
    """
    reader = TiffReader(block, Reason.EXIF_DAMAGED)
    main = reader.directory(reader.first_at).entries
    pointer = main.get(_EXIF_DIRECTORY)
    exif = {} if pointer is None else reader.directory(reader.integers(pointer)[0]).entries
    return ExifFacts(
        exposure_s=_seconds(reader, exif.get(_EXPOSURE_TIME)),
        f_number=_rational(reader, exif.get(_F_NUMBER)),
        iso=_iso(reader, exif.get(_ISO)),
        taken_local=_taken(reader, exif),
        offset_min=parse_offset(_text(reader, exif, _TAKEN_OFFSET) or _text(reader, exif, _OFFSET)),
        make=_text(reader, main, _MAKE),
        model=_text(reader, main, _MODEL),
        serial=_text(reader, exif, _SERIAL),
        white_balance=_integer(reader, exif.get(_WHITE_BALANCE)),
        orientation=_integer(reader, main.get(_ORIENTATION)),
        width_px=_integer(reader, exif.get(_WIDTH)),
        height_px=_integer(reader, exif.get(_HEIGHT)),
    )


def _text(reader: TiffReader, entries: Mapping[int, Entry], tag: int) -> str:
    entry = entries.get(tag)
    return "" if entry is None else reader.text(entry)


def _integer(reader: TiffReader, entry: Entry | None) -> int | None:
    return None if entry is None else reader.integers(entry)[0]


def _rational(reader: TiffReader, entry: Entry | None) -> float | None:
    """Return a positive ratio; 0 stands for "unknown" (a lens without contacts writes F0)."""
    value = None if entry is None else reader.rational(entry)
    return value or None


def _seconds(reader: TiffReader, entry: Entry | None) -> float | None:
    value = _rational(reader, entry)
    if value is not None and value > MAX_EXPOSURE_S:
        raise reader.problem(f"an exposure time of {value:g} s")
    return value


def _iso(reader: TiffReader, entry: Entry | None) -> int | None:
    """Return the sensitivity; 65535 means "larger than this field holds" and says nothing."""
    value = None if entry is None else reader.integers(entry, max_count=3)[0]
    return None if value in (0, 65535) else value


def _taken(reader: TiffReader, exif: Mapping[int, Entry]) -> datetime | None:
    """Return the moment of the frame by the camera's clock; a clock never set writes blanks or zeros."""
    text = _text(reader, exif, _TAKEN)
    if not text.strip(" :0"):
        return None
    try:
        taken = datetime.strptime(text, "%Y:%m:%d %H:%M:%S")  # noqa: DTZ007 (the camera's clock has no zone)
    except ValueError as error:
        raise reader.problem(f"a date that is none: {text[:40]!r}") from error
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
