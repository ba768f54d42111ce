"""The gate before a JPEG decoder: what the markers of a file say, read from its bytes within fixed limits.

Written from ITU-T T.81 annex B. Nothing is decoded. Accepted is what a digital camera writes: Huffman-coded baseline,
extended or progressive, 8 bits, three components; everything else is refused before a decoder sees it.
"""

import re
import zlib
from dataclasses import dataclass, field

from station.frames.problems import FrameProblemError, Reason

# Chosen: nine times the larger camera's pixels.
MAX_PIXELS = 200_000_000
MAX_SEGMENTS = 2_000  # chosen: against hostile files; cameras write about 20
MAX_SCANS = 100  # a picture has at most 3 x 64 coefficients to send bit by bit; encoders use about ten scans

_SOI, _EOI, _SOS, _APP1, _APP2 = 0xD8, 0xD9, 0xDA, 0xE1, 0xE2
_BASELINE, _EXTENDED, _PROGRESSIVE = 0xC0, 0xC1, 0xC2
_NO_CAMERA_OF_OURS = {
    **dict.fromkeys((0xC3, 0xC7, 0xCB, 0xCF), "lossless coding"),
    **dict.fromkeys((0xC5, 0xC6, 0xDE, 0xDF), "hierarchical coding"),
    **dict.fromkeys((0xC9, 0xCA, 0xCC, 0xCD, 0xCE), "arithmetic coding"),
    0xDC: "a late height (DNL)",
    0xC8: "the reserved JPG extension",
}
_END_OF_SCAN = re.compile(rb"\xff+[\x01-\xcf\xd8-\xfe]")
_EXIF_MARK = b"Exif\0\0"
_SRGB = re.compile(rb"s\0?R\0?G\0?B")  # in descriptions of profiles, of one byte a letter or two
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_PNG_CHUNKS = 100_000  # chosen: a picture of 100 Mpx in chunks of 8 kB has half as many


@dataclass(frozen=True)
class JpegHeader:
    """What the markers say. ``exif`` is the TIFF block of the Exif segment, without its mark."""

    width_px: int
    height_px: int
    progressive: bool
    exif: bytes | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _FrameSize:
    width_px: int
    height_px: int
    progressive: bool
    component_ids: bytes
    blocks: int


@dataclass
class _Walk:
    """What has been seen so far on the way through the markers."""

    frame: _FrameSize | None = None
    exif: bytes | None = None
    has_previews: bool = False
    scan_bytes: int = 0
    scans: int = 0
    scanned: set[int] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)


def read_header(data: bytes) -> JpegHeader:
    """Walk the markers of a whole JPEG file and return what they say.

    Raises `FrameProblemError`: ``not_jpeg``, ``truncated``, ``damaged``, ``unsupported``, ``too_large`` or
    ``trailing_data``.
    """
    if data[:3] != b"\xff\xd8\xff":
        raise FrameProblemError(Reason.NOT_JPEG, _what_it_is(data))
    walk = _Walk()
    position = 2
    for _ in range(MAX_SEGMENTS):
        marker, position = _next_marker(data, position)
        if marker == _EOI:
            return _finish(data, position, walk)
        payload, position = _segment(data, position, marker)
        if marker == _SOS:
            position = _scan(data, position, payload, walk)
        else:
            _take(marker, payload, walk)
    raise FrameProblemError(Reason.DAMAGED, f"more than {MAX_SEGMENTS} marker segments")


def _what_it_is(data: bytes) -> str:
    if not data:
        return "the file is empty"
    if not data.strip(b"\0"):
        return "the file contains only zeros"
    return f"not a JPEG: it starts with {data[:4].hex(' ')}, not ff d8 ff"


def _next_marker(data: bytes, position: int) -> tuple[int, int]:
    """Return the marker code at ``position`` (fill bytes skipped) and the position behind it."""
    if position < len(data) and data[position] != 0xFF:
        raise FrameProblemError(Reason.DAMAGED, f"no marker at byte {position}, where one must be")
    while position < len(data) and data[position] == 0xFF:
        position += 1
    if position >= len(data):
        raise FrameProblemError(Reason.TRUNCATED, "the file ends before the end-of-image mark")
    marker = data[position]
    if marker < 0xC0 or 0xD0 <= marker <= _SOI:
        raise FrameProblemError(Reason.DAMAGED, f"marker ff{marker:02x} at byte {position - 1} is not allowed there")
    if marker in _NO_CAMERA_OF_OURS:
        raise FrameProblemError(Reason.UNSUPPORTED, f"{_NO_CAMERA_OF_OURS[marker]}, which no supported camera writes")
    return marker, position + 1


def _segment(data: bytes, position: int, marker: int) -> tuple[bytes, int]:
    """Return the payload of the segment whose length field is at ``position``, and the position behind it."""
    length = int.from_bytes(data[position : position + 2], "big")
    if position + 2 > len(data) or position + max(length, 2) > len(data):
        raise FrameProblemError(Reason.TRUNCATED, f"the file ends inside segment ff{marker:02x}")
    if length < 2:
        raise FrameProblemError(Reason.DAMAGED, f"segment ff{marker:02x} says it is {length} bytes long")
    return data[position + 2 : position + length], position + length


def _take(marker: int, payload: bytes, walk: _Walk) -> None:
    """Note what a segment says, where we need it."""
    if marker in (_BASELINE, _EXTENDED, _PROGRESSIVE):
        if walk.frame is not None:
            raise FrameProblemError(Reason.DAMAGED, "two frame headers in one picture")
        walk.frame = _frame_size(payload, progressive=marker == _PROGRESSIVE)
    elif marker == _APP1 and payload.startswith(_EXIF_MARK):
        if walk.exif is not None:
            raise FrameProblemError(Reason.EXIF_DAMAGED, "two EXIF segments, which may contradict each other")
        walk.exif = payload[len(_EXIF_MARK) :]
        if b"R03\0" in walk.exif:  # DCF's mark of Adobe RGB; cameras embed no profile beside it
            walk.notes.append("it is in Adobe RGB by its EXIF, and is taken as sRGB: strong colours are somewhat off")
    elif marker == _APP2 and payload.startswith(b"MPF\0"):
        walk.has_previews = True
    elif marker == _APP2 and payload.startswith(b"ICC_PROFILE\0\1") and not _SRGB.search(payload):
        walk.notes.append("its colour profile is not sRGB's, and is not applied: strong colours are somewhat off")


def _frame_size(payload: bytes, *, progressive: bool) -> _FrameSize:
    """Read a frame header (T.81 B.2.2) and refuse what is out of range."""
    count = payload[5] if len(payload) >= 6 else 0
    if len(payload) < 6 or len(payload) != 6 + 3 * count:
        raise FrameProblemError(Reason.DAMAGED, "a frame header of the wrong length")
    height_px, width_px = int.from_bytes(payload[1:3], "big"), int.from_bytes(payload[3:5], "big")
    if payload[0] != 8:
        raise FrameProblemError(Reason.UNSUPPORTED, f"{payload[0]} bits per sample; cameras write 8")
    if count != 3:
        raise FrameProblemError(Reason.UNSUPPORTED, f"{count} colour components; cameras write 3")
    if len(set(payload[6::3])) != count:
        raise FrameProblemError(Reason.DAMAGED, "two colour components of the same name")
    if width_px == 0 or height_px == 0:
        raise FrameProblemError(Reason.DAMAGED, f"a picture of {width_px}x{height_px} pixels")
    if width_px * height_px > MAX_PIXELS:
        raise FrameProblemError(Reason.TOO_LARGE, f"{width_px}x{height_px} pixels; the limit is {MAX_PIXELS}")
    return _FrameSize(width_px, height_px, progressive, payload[6::3], _blocks(width_px, height_px, payload[7::3]))


def _blocks(width_px: int, height_px: int, factors: bytes) -> int:
    """Return how many 8x8 blocks the three components have, from their sampling factors."""
    pairs = [(factor >> 4, factor & 15) for factor in factors]
    if any(not (1 <= h <= 4 and 1 <= v <= 4) for h, v in pairs):
        raise FrameProblemError(Reason.DAMAGED, "a sampling factor outside 1 to 4")
    h_max, v_max = max(h for h, _ in pairs), max(v for _, v in pairs)
    return sum(-(-width_px * h // (8 * h_max)) * -(-height_px * v // (8 * v_max)) for h, v in pairs)


def _scan(data: bytes, position: int, payload: bytes, walk: _Walk) -> int:
    """Check a scan header and return the position of the marker that ends the scan's data."""
    if walk.frame is None:
        raise FrameProblemError(Reason.DAMAGED, "picture data before the frame header")
    count = payload[0] if payload else 0
    if not 1 <= count <= 3 or len(payload) != 4 + 2 * count:
        raise FrameProblemError(Reason.DAMAGED, "a scan header of the wrong length")
    components = set(payload[1 : 1 + 2 * count : 2])
    if len(components) != count or not components <= set(walk.frame.component_ids):
        raise FrameProblemError(Reason.DAMAGED, "a scan of a component that the picture does not have, or twice")
    if components & walk.scanned and not walk.frame.progressive:
        raise FrameProblemError(Reason.DAMAGED, "a second scan of the same component")
    walk.scanned |= components
    walk.scans += 1
    if walk.scans > MAX_SCANS:
        raise FrameProblemError(Reason.DAMAGED, f"more than {MAX_SCANS} scans")
    end = _END_OF_SCAN.search(data, position)
    if end is None:
        raise FrameProblemError(Reason.TRUNCATED, "the file ends inside the picture data, without an end-of-image mark")
    walk.scan_bytes += end.start() - position
    return end.start()


def _finish(data: bytes, end: int, walk: _Walk) -> JpegHeader:
    if walk.frame is None or walk.scans == 0:
        raise FrameProblemError(Reason.DAMAGED, "no picture between start and end of the file")
    if walk.scanned != set(walk.frame.component_ids):
        raise FrameProblemError(Reason.TRUNCATED, "a colour component has no picture data")
    # Refuse data that cannot fill the picture: a block costs a bit for its mean, in sequential mode two
    least_bytes = walk.frame.blocks * (1 if walk.frame.progressive else 2) // 8
    if walk.scan_bytes < least_bytes:
        needed = f"{walk.frame.width_px}x{walk.frame.height_px} pixels need {least_bytes} or more"
        raise FrameProblemError(Reason.TRUNCATED, f"{walk.scan_bytes} bytes of picture data, where {needed}")
    # Allow zero padding, previews that a multi-picture (MPF) segment announces, Samsung's trailer (SEF); nothing else
    tail = data[end:].strip(b"\0")
    if tail and not ((walk.has_previews and tail.startswith(b"\xff\xd8\xff")) or tail.endswith(b"SEFT")):
        raise FrameProblemError(Reason.TRAILING_DATA, f"{len(data) - end} bytes after the end-of-image mark at {end}")
    if len(data) > end:
        what = "previews or a trailer" if tail else "padding"
        walk.notes.append(f"{len(data) - end} bytes of {what} after the picture")
    frame = walk.frame
    return JpegHeader(frame.width_px, frame.height_px, frame.progressive, walk.exif, tuple(walk.notes))


# The structure of a PNG, likewise walked before any decoder sees it: chunks, their checksums, the end (ISO 15948).


def read_png(data: bytes) -> bytes | None:
    """Return the EXIF block (eXIf) of a PNG that is whole; None where it has none.

    Raises `FrameProblemError`: ``not_jpeg`` for another kind of file, ``truncated``, ``damaged``.
    """
    if not data.startswith(PNG_SIGNATURE):
        raise FrameProblemError(Reason.NOT_JPEG, f"not a PNG (it starts with {data[:4].hex(' ')})")
    at, exif = len(PNG_SIGNATURE), None
    for number in range(MAX_PNG_CHUNKS):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 12 + length
        if end > len(data):
            raise FrameProblemError(Reason.TRUNCATED, f"chunk {number} ends at byte {end} of {len(data)}")
        if zlib.crc32(data[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise FrameProblemError(Reason.DAMAGED, f"the checksum of chunk {number} is wrong")
        if number == 0 and (kind != b"IHDR" or length != 13):
            raise FrameProblemError(Reason.DAMAGED, "its first chunk is not a header")
        if number == 0 and int.from_bytes(data[16:20], "big") * int.from_bytes(data[20:24], "big") > MAX_PIXELS:
            raise FrameProblemError(Reason.TOO_LARGE, f"its header says more than {MAX_PIXELS:,} pixels")
        if kind == b"eXIf":
            exif = data[at + 8 : end - 4]
        if kind == b"IEND":
            return exif
        at = end
    raise FrameProblemError(Reason.DAMAGED, f"more than {MAX_PNG_CHUNKS} chunks")
