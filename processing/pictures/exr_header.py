"""The header of an OpenEXR file, read by ourselves before the library may allocate anything.

The library leaves out parts that it cannot read without an exception; only the file's own header tells how many
there should be, how large, and of which channels (OpenEXR file layout, version 2).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from processing.pictures.writing import check_size, refused

MAGIC = b"\x76\x2f\x31\x01"
MAX_HEADER_BYTES = 1 << 24
MAX_PARTS = 64
MAX_CHANNELS = 256

_LONG_NAMES, _DEEP, _MULTIPART = 0x400, 0x800, 0x1000
_KNOWN_FLAGS = 0x200 | _LONG_NAMES | _DEEP | _MULTIPART
_SAMPLE_BYTES = {0: 4, 1: 2, 2: 4}
_NEEDED = {"channels": "chlist", "compression": "compression", "dataWindow": "box2i", "displayWindow": "box2i"}
_BOUNDED_COMPRESSIONS = range(10)
"""Of these none packs a picture more than a few thousandfold (zlib's limit is 1032)."""
_MAX_RATIO, _FREE_BYTES = 2500, 1 << 26


@dataclass(frozen=True)
class ExrPart:
    """What one part of a file should be."""

    width: int
    height: int
    channels: dict[str, int]
    """Name to bytes a sample (2: half, 4: float or whole number)."""
    sampled_everywhere: bool
    """No channel has fewer samples than pixels."""
    whole: bool
    """The data window is the display window: nothing was cropped."""
    compression: int


def read_header(path: Path) -> list[ExrPart]:
    """Return the parts that a file's header promises.

    Raises `PictureFileError` for what is not OpenEXR, for deep data, for a header that cannot be right, and for sizes
    that no picture has or that the file is too short to hold.
    """
    try:
        size_bytes = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(MAX_HEADER_BYTES)
    except OSError as error:
        raise refused(path, f"cannot be read ({error.strerror})") from error
    if len(head) < 8 or head[:4] != MAGIC:
        raise refused(path, "is not OpenEXR", likely="another kind of file, or an empty one")
    flags = struct.unpack_from("<I", head, 4)[0]
    if flags & 0xFF != 2 or flags & ~0xFF & ~_KNOWN_FLAGS:
        raise refused(path, f"is OpenEXR of an unknown version (0x{flags:x})")
    if flags & _DEEP:
        raise refused(path, "holds deep data, which is no picture")
    try:
        parts = _parts(head, multipart=bool(flags & _MULTIPART), path=path)
    except (struct.error, UnicodeDecodeError, ValueError, IndexError) as error:
        raise refused(path, "has a damaged header", likely="cut short or overwritten") from error
    for part in parts:
        _check_part(part, size_bytes, path)
    return parts


def _parts(head: bytes, *, multipart: bool, path: Path) -> list[ExrPart]:
    place, parts = 8, []
    while not (multipart and head[place] == 0):
        attributes, place = _attributes(head, place)
        parts.append(_part(attributes, path))
        if not multipart:
            break
        if len(parts) > MAX_PARTS:
            raise refused(path, f"has more than {MAX_PARTS} parts")
    if not parts:
        raise refused(path, "has no parts")
    return parts


def _attributes(head: bytes, place: int) -> tuple[dict[str, tuple[str, bytes]], int]:
    """Return one part's attributes (name to type and value) and where the next thing begins."""
    found: dict[str, tuple[str, bytes]] = {}
    while head[place] != 0:
        name, place = _text(head, place)
        kind, place = _text(head, place)
        (size,) = struct.unpack_from("<i", head, place)
        place += 4
        if size < 0 or place + size > len(head) or name in found:
            raise ValueError(name)
        found[name] = kind, head[place : place + size]
        place += size
    return found, place + 1


def _text(head: bytes, place: int) -> tuple[str, int]:
    end = head.index(b"\0", place, place + 256)
    return head[place:end].decode("utf-8"), end + 1


def _part(attributes: dict[str, tuple[str, bytes]], path: Path) -> ExrPart:
    for name, kind in _NEEDED.items():
        if attributes.get(name, ("", b""))[0] != kind:
            raise refused(path, f"lacks the attribute {name}")
    layout = attributes.get("type", ("string", b"scanlineimage"))[1]
    if layout not in (b"scanlineimage", b"tiledimage"):
        raise refused(path, f"holds {layout[:40]!r}, which is no picture")
    data = struct.unpack("<4i", attributes["dataWindow"][1])
    channels, even = _channels(attributes["channels"][1])
    return ExrPart(
        width=data[2] - data[0] + 1,
        height=data[3] - data[1] + 1,
        channels=channels,
        sampled_everywhere=even,
        whole=data == struct.unpack("<4i", attributes["displayWindow"][1]),
        compression=attributes["compression"][1][0],
    )


def _channels(value: bytes) -> tuple[dict[str, int], bool]:
    channels: dict[str, int] = {}
    place, even = 0, True
    while value[place] != 0:
        name, place = _text(value, place)
        kind, _, x_step, y_step = struct.unpack_from("<iIii", value, place)
        place += 16
        if kind not in _SAMPLE_BYTES or name in channels or len(channels) >= MAX_CHANNELS:
            raise ValueError(name)
        channels[name] = _SAMPLE_BYTES[kind]
        even = even and x_step == y_step == 1
    return channels, even


def _check_part(part: ExrPart, size_bytes: int, path: Path) -> None:
    check_size(part.width, part.height, path)
    plain_bytes = part.width * part.height * sum(part.channels.values())
    too_short = part.compression == 0 and part.sampled_everywhere and size_bytes < plain_bytes
    packed = part.compression in _BOUNDED_COMPRESSIONS and plain_bytes > max(_FREE_BYTES, _MAX_RATIO * size_bytes)
    if too_short or packed:
        raise refused(path, f"is too short for {part.width} x {part.height} pixels", likely="cut short, or a bomb")
