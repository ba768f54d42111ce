"""The structure of a PNG, walked before any decoder sees it: chunks in order, their checksums, the end (ISO 15948)."""

from __future__ import annotations

import zlib

from station.frames.facts import FrameProblemError, Reason

SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_CHUNKS = 100_000
"""Chosen: a picture of 100 Mpx in chunks of 8 kB has half as many."""
DEPTH_AT = 24
"""Byte of the header (IHDR) that holds the bits a channel."""
TOO_DEEP = "more than 8 bits a channel: brackets are merged from 8 bits"


def read_png(data: bytes) -> bytes | None:
    """Return the EXIF block (eXIf) of a PNG that is whole; None where it has none.

    Raises `FrameProblemError`: ``not_jpeg`` for another kind of file, ``truncated``, ``damaged``, ``unsupported``.
    """
    if not data.startswith(SIGNATURE):
        raise FrameProblemError(Reason.NOT_JPEG, f"not a PNG (it starts with {data[:4].hex(' ')})")
    at, exif = len(SIGNATURE), None
    for number in range(MAX_CHUNKS):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 12 + length
        if end > len(data):
            raise FrameProblemError(Reason.TRUNCATED, f"chunk {number} ends at byte {end} of {len(data)}")
        if zlib.crc32(data[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise FrameProblemError(Reason.DAMAGED, f"the checksum of chunk {number} is wrong")
        if number == 0 and (kind != b"IHDR" or length != 13):
            raise FrameProblemError(Reason.DAMAGED, "its first chunk is no header")
        if kind == b"eXIf":
            exif = data[at + 8 : end - 4]
        if kind == b"IEND":
            if data[DEPTH_AT] > 8:
                raise FrameProblemError(Reason.UNSUPPORTED, TOO_DEEP)
            return exif
        at = end
    raise FrameProblemError(Reason.DAMAGED, f"more than {MAX_CHUNKS} chunks")
