"""Whether a raw companion is what its name says: magic, size, and directories that point inside the file.

Nothing of a raw file is decoded: frames are measured on the JPEG, and the raw file is kept for later work.
"""

from __future__ import annotations

import mmap

from station.frame_problem import FrameProblemError, Reason
from station.tiff import Directory, TiffReader

MIN_SIZE_BYTES = 100_000
MAX_DIRECTORIES = 16
_STRIP_OFFSETS, _STRIP_SIZES, _TILE_OFFSETS, _TILE_SIZES, _CHILDREN, _DNG_VERSION = (
    273,
    279,
    324,
    325,
    330,
    0xC612,
)


def check_raw(data: bytes | mmap.mmap, format_: str) -> None:
    """Check a CR2 or DNG file (``format_`` "cr2" or "dng"), the whole file as bytes or mapped.

    Raises
    ------
    FrameProblemError
        ``not_raw``, ``truncated`` or ``damaged``.
    """
    if len(data) < 16 or bytes(data[:4]) not in (b"II*\0", b"MM\0*"):
        raise FrameProblemError(Reason.NOT_RAW, f"not a {format_.upper()} file: no TIFF header")
    if len(data) < MIN_SIZE_BYTES:
        raise FrameProblemError(Reason.TRUNCATED, f"{len(data)} bytes; no raw file is below {MIN_SIZE_BYTES}")
    if format_ == "cr2" and bytes(data[8:11]) != b"CR\x02":
        raise FrameProblemError(Reason.NOT_RAW, "not a CR2 file: the mark CR 2 is missing at byte 8")
    reader = TiffReader(data, Reason.DAMAGED)
    directories = _directories(reader)
    if format_ == "dng" and _DNG_VERSION not in directories[0].entries:
        raise FrameProblemError(Reason.NOT_RAW, "not a DNG file: no DNG version in its first directory")
    furthest = max(_furthest(reader, directory) for directory in directories)
    if furthest == 0:
        raise FrameProblemError(Reason.DAMAGED, "no picture in any directory")
    if furthest > len(data):
        raise FrameProblemError(Reason.TRUNCATED, f"picture data to byte {furthest} of {len(data)}")


def _directories(reader: TiffReader) -> list[Directory]:
    """Return the chain of directories and, for DNG, the children of the first."""
    found: list[Directory] = []
    pending = [reader.first_at]
    while pending:
        if len(found) >= MAX_DIRECTORIES:
            raise reader.problem(f"more than {MAX_DIRECTORIES} directories")
        directory = reader.directory(pending.pop(0))
        found.append(directory)
        children = directory.entries.get(_CHILDREN)
        pending += reader.integers(children, MAX_DIRECTORIES) if children else ()
        pending += [directory.next_at] if directory.next_at else []
    return found


def _furthest(reader: TiffReader, directory: Directory) -> int:
    """Return the first byte behind the strips or tiles of a directory (0: it has none)."""
    end = 0
    for offsets_tag, sizes_tag in ((_STRIP_OFFSETS, _STRIP_SIZES), (_TILE_OFFSETS, _TILE_SIZES)):
        offsets, sizes = directory.entries.get(offsets_tag), directory.entries.get(sizes_tag)
        if offsets is None or sizes is None:
            continue
        places = zip(reader.integers(offsets, 100_000), reader.integers(sizes, 100_000), strict=False)
        end = max([end, *(at + size for at, size in places)])
    return end
