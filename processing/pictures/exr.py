"""Pictures as OpenEXR: float32, cd/m2 as they are, every field of the picture's type, and nothing else.

For people and other programs ZIP (`write_exr`); between stages ZSTD, which takes a third of its time, and of which our
own checksum shows flipped bits (`write_stage_exr`). Channels: R, G, B (float), ``uncertainty`` (float, between
stages half), ``validity`` and, where it was looked for, ``ghost`` (half: exact for 0 to 255). docs/reference/files.md
lists the attributes. The same picture gives the same bytes.

The header of a file is read by ourselves before the library may allocate anything: the library leaves out parts that it
cannot read without an exception; only the file's own header says how many there should be, how large, and of which
channels (OpenEXR file layout, version 2).
"""

import ctypes
import json
import math
import struct
import sys
import zlib
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.errors import LensError, ParameterError, PictureFileError
from processing.ground.arrays import Bytes, Flags, Floats, bands
from processing.ground.threads import Later, at_once, behind, side_by_side, threads
from processing.pictures.frames import refuse_alpha
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.pictures.writing import P, check_image, check_light, check_size, handed_on, refused, write_whole
from processing.sphere.geometry import geometry_from_json, geometry_to_json

MAGIC = b"\x76\x2f\x31\x01"
MAX_HEADER_BYTES = 1 << 24  # chosen: no honest header is longer
MAX_PARTS, MAX_CHANNELS = 64, 256  # chosen

_LONG_NAMES, _DEEP, _MULTIPART = 0x400, 0x800, 0x1000  # bits of the version field
_KNOWN_FLAGS = 0x200 | _LONG_NAMES | _DEEP | _MULTIPART  # and the bit of single tiled files
_SAMPLE_BYTES = {0: 4, 1: 2, 2: 4}  # by pixel type: unsigned, half, float
_NEEDED = {"channels": "chlist", "compression": "compression", "dataWindow": "box2i", "displayWindow": "box2i"}
_BOUNDED_COMPRESSIONS = range(10)  # of these none packs a picture more than a few thousandfold (zlib's limit is 1032)
_MAX_RATIO, _FREE_BYTES = 2500, 1 << 26  # chosen, above zlib's 1032
CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # Rec. 709: x and y of red, green, blue and white
UNSCALED = "luminance in relative units"
"""``daylitKind`` of a `LuminanceImage` that is not absolute; such a file has no ``whiteLuminance``."""

_DAMAGED = "damaged on disk or in transfer; the library could not read all of it"
_AGAIN = "copy it again, or rerun the stage that made it (--force)"
_UNDERSHOOT = 0.05  # of the picture's mean: lossy compression makes negative values of black ones

Channels = dict[str, npt.NDArray[Any]]
ZSTD_LEVEL = 3
"""Of stage files, where a build exports its C interface: 0.8 CPU s for 22.6 MP; OpenEXR's 5: 1.9 s, 1 to 2 % less."""
_FOREIGN, _CHANGED = "was not written by daylit", "has changed since it was written: its checksum differs"
_TEXTS = ("daylitKind", "daylitGeometry", "daylitScaleUncertainty", "daylitProvenance")


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
        raise refused(path, "holds deep data, not a picture")
    try:
        parts = _parts(head, multipart=bool(flags & _MULTIPART), path=path)
    except (struct.error, UnicodeDecodeError, ValueError, IndexError) as error:
        raise refused(path, "has a damaged header", likely="cut short or overwritten") from error
    for part in parts:
        check_size(part.width, part.height, path)
        plain_bytes = part.width * part.height * sum(part.channels.values())
        too_short = part.compression == 0 and part.sampled_everywhere and size_bytes < plain_bytes
        packed = part.compression in _BOUNDED_COMPRESSIONS and plain_bytes > max(_FREE_BYTES, _MAX_RATIO * size_bytes)
        if too_short or packed:
            raise refused(path, f"is too short for {part.width} x {part.height} pixels", likely="cut short, or a bomb")
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
        raise refused(path, f"holds {layout[:40]!r}, which is not a picture")
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


def write_exr(path: Path, image: RelativeImage | LuminanceImage) -> None:
    """Write a picture with all its fields, durably, for whoever reads OpenEXR; `read_exr` gives an equal one back.

    ``attributes`` must be JSON values (tuples come back as lists). Raises `PictureFileError` for a picture that
    breaks its type's promises (NaN, infinite or negative light, wrong shapes), `DiskError` and `DiskFullError`.
    """
    check_image(image, path)
    _write(path, image, "ZIP_COMPRESSION", {"validity": np.float16, "ghost": np.float16})


def write_stage_exr(path: Path, image: P, made: Flags | None = None, *, own: bool = False, later: Later = at_once) -> P:
    """Write a picture for later stages and return it as they read it (`handed_on`); raises as `write_exr`.

    ``made`` (H, W): where it was estimated rather than photographed; ``own``: it may be rounded in place; ``later`` is
    given what writes the file, and may put it off.
    """
    check_image(image, path)
    image = handed_on(image, made, own=own)
    halves: dict[str, type] = dict.fromkeys(("uncertainty", "validity", "ghost"), np.float16)
    later(partial(_write, path, image, "ZSTD_COMPRESSION", halves))
    return image


def _library() -> Any:
    """Return OpenEXR's module, packing with `threads` (one pool for all files, none unless asked) at `ZSTD_LEVEL`."""
    import OpenEXR

    if OpenEXR.global_thread_count() != threads():
        OpenEXR.set_global_thread_count(threads())
    with suppress(AttributeError, OSError):
        ctypes.CDLL(OpenEXR.__file__).exr_set_default_zstd_compression_level(ZSTD_LEVEL)
    return OpenEXR


def _write(path: Path, image: RelativeImage | LuminanceImage, coding: str, halves: dict[str, type]) -> None:
    library = _library()
    planes: Channels = {"RGB": image.rgb, "uncertainty": image.uncertainty, "validity": image.validity}
    planes |= {} if image.ghost is None else {"ghost": image.ghost}
    # Our own attributes; numbers as decimal text, which keeps float64 (EXR's own are float32)
    luminance = isinstance(image, LuminanceImage)
    try:
        provenance = json.dumps(dict(image.attributes), sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise refused(path, f"attributes are not plain JSON values ({error})") from error
    values = (
        ("luminance" if _in_cd_m2(image) else UNSCALED) if luminance else "relative",
        json.dumps(geometry_to_json(image.geometry), sort_keys=True, allow_nan=False),
        repr(float(image.scale_uncertainty)) if isinstance(image, LuminanceImage) else "none",
        provenance,
    )
    texts = dict(zip(_TEXTS, values, strict=True))
    header = {
        "compression": getattr(library, coding),
        "type": library.scanlineimage,
        "chromaticities": CHROMATICITIES,
        **({"whiteLuminance": 1.0} if _in_cd_m2(image) else {}),
        **texts,
        "daylitCrc32": f"{_digest(texts, planes):08x}",
    }
    channels = {name: np.ascontiguousarray(plane, dtype=halves.get(name)) for name, plane in planes.items()}
    write_whole(path, lambda part: library.File(header, channels).write(_plain_name(part)))


def _plain_name(path: Path) -> str:
    """Return a path as the library takes it; `PictureFileError` for one that is not UTF-8."""
    if (name := str(path)).encode(errors="replace").decode() != name:
        raise refused(path, "is in a folder whose name is not UTF-8", advice="rename that folder")
    return name


def read_exr(path: Path) -> RelativeImage | LuminanceImage:
    """Read a picture that `write_exr` wrote.

    Raises `PictureFileError` for a file of another program (`read_exr_rgb` reads those) and for any damage: parts,
    channels or shapes that are not as the header says, changed values or attributes (CRC-32), impossible light.
    """
    header, arrays = _read(path)
    texts = {name: str(header[name]) for name in _TEXTS if name in header}
    if set(texts) != set(_TEXTS) or "daylitCrc32" not in header:
        raise refused(path, _FOREIGN, advice="import it, or give a picture made by daylit process")
    missing = {"RGB", "uncertainty", "validity"} - set(arrays)
    if missing or set(arrays) - {"RGB", "uncertainty", "validity", "ghost"}:
        raise refused(path, f"has the channels {sorted(arrays)}", likely=_DAMAGED, advice=_AGAIN)
    # As each is turned, its halves are let go.
    planes: Channels = {"RGB": arrays.pop("RGB"), "uncertainty": _single(arrays.pop("uncertainty"))}
    planes |= {name: _codes(arrays.pop(name), path) for name in ("validity", "ghost") if name in arrays}
    with behind() as later:
        same = later(lambda: header["daylitCrc32"] == f"{_digest(texts, planes):08x}")
        try:
            image = _image(texts, planes, path)
            if header.get("whiteLuminance", 0.0) != (1.0 if _in_cd_m2(image) else 0.0):
                text = "has another whiteLuminance than it was written with"
                raise refused(path, text, likely=_DAMAGED, advice=_AGAIN)
            check_image(image, path)
        finally:
            if not same.result():  # rather said than anything else that is wrong
                raise refused(path, _CHANGED, likely=_DAMAGED, advice=_AGAIN)
    return image


def read_any_exr(path: Path) -> RelativeImage | LuminanceImage | tuple[Floats, float | None]:
    """Read a picture of daylit, or anyone's: then light (H, W, 3) as `read_exr_rgb` returns it. Raises as these do."""
    try:
        return read_exr(path)
    except PictureFileError as error:
        if _FOREIGN not in str(error):
            raise
    return read_exr_rgb(path)


def read_exr_rgb(path: Path) -> tuple[Floats, float | None]:
    """Read the light of anyone's OpenEXR picture: float32 (H, W, 3), and its ``whiteLuminance`` or None.

    ``whiteLuminance`` is the cd/m2 of (1, 1, 1); the values are given as they are in the file.
    Small negative values, as lossy compression makes them, become 0. Raises `PictureFileError` for damage, for deep
    or cropped or subsampled data, several parts, other channels than R, G, B (opaque A), primaries other than Rec. 709.
    """
    header, arrays = _read(path)
    together = next((arrays[name] for name in ("RGB", "RGBA") if name in arrays), None)
    if together is None:
        names = ", ".join(sorted(read_header(path)[0].channels))
        raise refused(path, f"has the channels {names}, not R, G and B", advice="save channels R, G and B")
    rgb = np.ascontiguousarray(together[..., :3], dtype=np.float32)
    if together.shape[2] == 4:
        refuse_alpha(together[..., 3], path.name)
    primaries = np.ravel(header.get("chromaticities", CHROMATICITIES))
    if not np.allclose(primaries, CHROMATICITIES, atol=2e-3):
        raise refused(path, f"has the primaries {primaries.tolist()}, not those of Rec. 709")
    low, mean = float(rgb.min()), float(rgb.mean(dtype=np.float64))
    if math.isfinite(mean) and -_UNDERSHOOT * max(mean, 0.0) <= low < 0:
        rgb = np.maximum(rgb, np.float32(0))
    white = header.get("whiteLuminance")
    if white is not None and not (isinstance(white, float) and math.isfinite(white) and white > 0):
        raise refused(path, f"has whiteLuminance {white}")
    check_light(rgb, path, 1.0 if white is None else white)
    return rgb, white if isinstance(white, float) else None


def _in_cd_m2(image: RelativeImage | LuminanceImage) -> bool:
    return isinstance(image, LuminanceImage) and image.absolute


def _digest(texts: dict[str, str], planes: Channels) -> int:
    """Return the CRC-32 of the attributes' texts and of all values (light float32, codes one byte)."""
    crc = zlib.crc32("\0".join(texts[name] for name in _TEXTS).encode())
    for name in sorted(planes):
        crc = zlib.crc32(name.encode(), crc)
        crc = zlib.crc32(np.ascontiguousarray(planes[name]).view(np.uint8).data, crc)
    return crc


def _single(plane: npt.NDArray[Any]) -> Floats:
    """Return values as float32; halves by a table, several times as fast as NumPy turns them."""
    if plane.dtype != np.float16:
        return np.asarray(plane, np.float32)
    table = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)
    out = np.empty(plane.shape, np.float32)
    rows_at_once = bands(len(plane), 64)  # for the processor's cache
    side_by_side(lambda rows: np.take(table, plane[rows].view(np.uint16), out=out[rows], mode="clip"), rows_at_once)
    return out


def _codes(plane: npt.NDArray[Any], path: Path) -> Bytes:
    codes = np.empty(plane.shape, np.uint8)
    for rows in bands(len(plane), 64):
        values = _single(plane[rows])
        with np.errstate(invalid="ignore"):
            codes[rows] = values.astype(np.uint8)
        if not np.array_equal(codes[rows], values):
            raise refused(path, "holds codes that are not whole numbers from 0 to 255", likely=_DAMAGED, advice=_AGAIN)
    return codes


def _image(texts: dict[str, str], planes: Channels, path: Path) -> RelativeImage | LuminanceImage:
    try:
        geometry = geometry_from_json(json.loads(texts["daylitGeometry"]))
        attributes = json.loads(texts["daylitProvenance"])
        if not isinstance(attributes, dict):
            raise TypeError("provenance is not an object")
        rgb, uncertainty = (np.asarray(planes[name], dtype=np.float32) for name in ("RGB", "uncertainty"))
        validity = np.asarray(planes["validity"], dtype=np.uint8)
        ghost = np.asarray(planes["ghost"], dtype=np.uint8) if "ghost" in planes else None
        kind = texts["daylitKind"]
        if kind == "relative":
            return RelativeImage(rgb, uncertainty, validity, geometry, ghost, attributes)
        if kind not in ("luminance", UNSCALED):
            raise ValueError(f"daylitKind is {kind[:40]!r}")
        scale = float(texts["daylitScaleUncertainty"])
        return LuminanceImage(rgb, uncertainty, validity, geometry, scale, ghost, attributes, kind != UNSCALED)
    except (ValueError, TypeError, RecursionError, ParameterError, LensError) as error:
        raise refused(path, f"has invalid attributes ({error})", likely=_DAMAGED, advice=_AGAIN) from error


def _read(path: Path) -> tuple[dict[str, Any], Channels]:
    """Return the only part's header and channels as the library gives them, compared with the file's own header."""
    library, parts = _library(), read_header(path)
    whole, full = parts[0].whole, parts[0].sampled_everywhere
    wrong = {len(parts) > 1: "of several parts", not whole: "cropped (data window)", not full: "subsampled"}.get(True)
    if wrong is not None:
        raise refused(path, f"is {wrong}", advice="save the whole picture, as one part, each channel at full size")
    try:
        # The library reports damage on standard output, where commands write their JSON.
        with redirect_stdout(sys.stderr), library.File(_plain_name(path)) as file:
            if len(file.parts) != 1:
                raise refused(path, "cannot be decoded", likely=_DAMAGED, advice=_AGAIN)
            header = dict(file.header())
            arrays = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, TypeError, MemoryError, UnicodeDecodeError) as error:
        raise refused(path, f"cannot be decoded ({error})", likely=_DAMAGED, advice=_AGAIN) from error
    for _ in _differences(parts[0], arrays):
        raise refused(path, "does not match its header", likely=_DAMAGED, advice=_AGAIN)
    return header, arrays


def _differences(part: ExrPart, arrays: Channels) -> Iterator[str]:
    """Yield the names of channels that are missing, unasked for, or of another size than the header says."""
    found: set[str] = set()
    for name, pixels in arrays.items():
        # The library joins R, G, B (and A); of a layer ("left.R") under its name.
        ends = "RGBA"[: np.shape(pixels)[2]] if np.ndim(pixels) == 3 else ""
        found |= set(ends) if name in ("RGB", "RGBA") else {f"{name}.{end}" for end in ends} or {name}
        if np.shape(pixels)[:2] != (part.height, part.width):
            yield name
    yield from found ^ set(part.channels)
