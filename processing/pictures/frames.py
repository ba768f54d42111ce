"""Frames of a bracket, decoded when they are asked for: JPEG, 16-bit TIFF and PNG, camera raw, arrays.

Only whole numbers of 8 or 16 bits: so no NaN or infinity can come in. Orientation tags are not applied: all frames of
a bracket lie as the sensor saw them. A damaged file is refused with its name, never shown in part.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import simplejpeg

from processing.errors import ParameterError, PictureFileError
from processing.ground.arrays import Bytes, UInt16s
from processing.pictures.mosaic import CameraColours, camera_colours, camera_rgb, saturation

Codes: TypeAlias = Bytes | UInt16s
Reduce: TypeAlias = Literal[1, 2, 4, 8]
MAX_PIXELS = 200_000_000  # more than any camera of today; a header that says more is a mistake or an attack
RAW_ENDINGS = (".cr2", ".cr3", ".dng", ".nef", ".arw", ".raf", ".rw2", ".orf")
RAW_BORDER = 0.03  # of the sensor's side, that a camera's own picture may leave out; chosen
_CHANNELS = ((), (1,), (3,), (4,))  # behind height and width: grey, RGB, RGB with alpha


@dataclass(frozen=True)
class ArrayFrame:
    """A frame that is in memory already; see `array_frame`."""

    array: Codes = field(repr=False)
    name: str
    """What reports and errors call it."""
    size_px: tuple[int, int]
    """Width and height."""
    depth_bits: int
    """8 or 16."""
    linear: bool
    """Whether the codes are proportional to exposure (65535 at saturation); else a response curve is needed."""

    def decode(self, reduce: Reduce = 1) -> Codes:
        """Return the array itself, or reduced. The result is (H, W, 3), uint8 or uint16 as the frame has it."""
        return _reduced(self.array, reduce)


@dataclass(frozen=True)
class JpegFrame:
    """An 8-bit JPEG; see `jpeg_frame`."""

    source: Path | bytes = field(repr=False)
    name: str
    size_px: tuple[int, int]
    depth_bits: int = 8
    linear: bool = False

    def decode(self, reduce: Reduce = 1) -> Codes:
        """Decode exactly (no fast DCT, no fast upsampling: those are up to 26 codes off); reduced in the DCT.

        The result is (H, W, 3), uint8 or uint16 as the frame has it.
        """
        data = _bytes(self.source, self.name)
        width, height = (-(-side // _checked(reduce)) for side in self.size_px)
        try:
            # Strict: what libjpeg-turbo would only warn of (lost data, premature end) is an error.
            rgb = simplejpeg.decode_jpeg(data, "RGB", min_height=height, min_width=width, strict=True)
        except (ValueError, MemoryError) as error:
            raise damaged_picture(self.name, str(error)) from error
        if rgb.shape != (height, width, 3):
            raise damaged_picture(self.name, f"it decodes to {rgb.shape[1]} x {rgb.shape[0]}, not {width} x {height}")
        return np.asarray(rgb, dtype=np.uint8)


@dataclass(frozen=True)
class LosslessFrame:
    """A TIFF or PNG; see `lossless_frame`."""

    path: Path
    name: str
    size_px: tuple[int, int]
    depth_bits: int
    linear: bool

    def decode(self, reduce: Reduce = 1) -> Codes:
        """Decode whole, then reduce. The result is (H, W, 3), uint8 or uint16 as the frame has it."""
        pixels = _reduced(_lossless_pixels(self.path, self.name), reduce)
        if 8 * pixels.itemsize > self.depth_bits:
            import cv2

            pixels = _contiguous(cv2.convertScaleAbs(pixels, alpha=1 / 257))
        return pixels


@dataclass(frozen=True)
class RawFrame:
    """A camera's raw file; see `raw_frame`."""

    source: Path | bytes = field(repr=False)
    name: str
    size_px: tuple[int, int]
    colours: CameraColours = field(repr=False)
    depth_bits: int = 16
    linear: bool = True
    white: float = 1.0
    """Where wells saturate, see `mosaic.saturation`."""

    def decode(self, reduce: Reduce = 1) -> Codes:
        """Return the camera's own channels, see `mosaic.camera_rgb`; the middle of the sensor where it is larger."""
        with _opened_raw(self.source, self.name) as raw:
            codes = camera_rgb(raw, self.white)
        (width, height), (left, top) = self.size_px, _border((codes.shape[1], codes.shape[0]), self.size_px)
        return _reduced(np.ascontiguousarray(codes[top : top + height, left : left + width]), reduce)


FrameSource: TypeAlias = ArrayFrame | JpegFrame | LosslessFrame | RawFrame
"""One exposure that can be decoded, as often as needed, from any thread."""


def array_frame(array: Codes, name: str = "array", *, linear: bool | None = None) -> ArrayFrame:
    """Return a frame of uint8 or uint16 (H, W, 3) RGB in memory; ``linear`` by default: 16 bits are, 8 are not."""
    if array.dtype not in (np.uint8, np.uint16) or array.ndim != 3 or array.shape[2] != 3 or not array.size:
        text = f"a frame is uint8 or uint16 of shape (height, width, 3), not {array.dtype} of {array.shape}"
        raise ParameterError(text, where=name)
    is_linear = array.dtype == np.uint16 if linear is None else linear
    return ArrayFrame(_contiguous(array), name, (array.shape[1], array.shape[0]), 8 * array.itemsize, is_linear)


def jpeg_frame(source: Path | str | bytes, name: str | None = None) -> JpegFrame:
    """Return a frame of a JPEG file or its bytes; the header is read and checked now, the rest when decoded."""
    where = name or ("JPEG bytes" if isinstance(source, bytes) else Path(source).name)
    kept = source if isinstance(source, bytes) else Path(source)
    data = _bytes(kept, where)
    size = _jpeg_size(data, where)
    try:
        height, width, _, _ = simplejpeg.decode_jpeg_header(data, strict=True)
    except ValueError as error:
        raise damaged_picture(where, str(error)) from error
    if (width, height) != size:
        raise damaged_picture(where, "it states two sizes")
    return JpegFrame(kept, where, size)


def lossless_frame(path: Path | str, name: str | None = None, *, coded: bool = False) -> LosslessFrame:
    """Return a frame of a TIFF or PNG, grey or RGB: 16 bits are linear, 8 bits need a response curve.

    ``coded``: 16 bits do, too, and are rounded to the 8 bits of which curves are tables. An alpha channel must be
    opaque. Checksums of a PNG and the strips of a TIFF are checked when it is decoded.
    """
    path = Path(path)
    where = name or path.name
    pixels = _lossless_pixels(path, where)
    size = (pixels.shape[1], pixels.shape[0])
    deep = pixels.dtype == np.uint16 and not coded
    return LosslessFrame(path, where, size, 16 if deep else 8, deep)


def raw_frame(
    source: Path | str | bytes, name: str | None = None, within: tuple[int, int] | None = None, white: float | None = 1
) -> RawFrame:
    """Return a frame of a camera raw file or its bytes; ``within``: width and height of the camera's JPEG of it.

    Cameras' pictures leave out a border of the sensor. ``white``: where wells saturate; None: as its own wells show.
    Raises `PictureFileError` for a file that cannot be used.
    """
    kept = source if isinstance(source, bytes) else Path(source)
    where = name or (kept.name if isinstance(kept, Path) else "raw bytes")
    with _opened_raw(kept, where) as raw:
        colours, white = camera_colours(raw, where), saturation(raw) if white is None else white
        size = checked_size(raw.sizes.width, raw.sizes.height, where)
    if within and not all(0 <= own - asked <= RAW_BORDER * own for own, asked in zip(size, within, strict=True)):
        what = f"it has {size[0]} x {size[1]} wells, the camera's picture {within[0]} x {within[1]} pixels"
        raise PictureFileError(what, where=where, advice="set the camera to its full picture size")
    left, top = _border(size, within or size)
    shifted = np.roll(colours.cell, (-top, -left), axis=(0, 1))
    return RawFrame(kept, where, within or size, colours._replace(cell=shifted), white=white)


def _border(sensor: tuple[int, int], picture: tuple[int, int]) -> tuple[int, int]:
    return (sensor[0] - picture[0]) // 2, (sensor[1] - picture[1]) // 2


def frame_of(path: Path | str, name: str | None = None, *, coded: bool = False) -> FrameSource:
    """Return the frame of a file by its ending: .jpg .jpeg .tif .tiff .png (`lossless_frame`), or a raw format."""
    ending = Path(path).suffix.lower()
    if ending in (".jpg", ".jpeg"):
        return jpeg_frame(path, name)
    if ending in (".tif", ".tiff", ".png"):
        return lossless_frame(path, name, coded=coded)
    if ending in RAW_ENDINGS:
        return raw_frame(path, name)
    raise PictureFileError(f"no frame format has the ending {ending or '(none)'}", where=name or Path(path).name)


def same_file(a: FrameSource, b: FrameSource) -> bool:
    """Return whether two frames come from the same bytes; without decoding them."""
    first, second = (getattr(f, "source", getattr(f, "path", None)) for f in (a, b))
    if not isinstance(first, Path | bytes) or not isinstance(second, Path | bytes):
        return a is b
    sizes = [s.stat().st_size if isinstance(s, Path) else len(s) for s in (first, second)]
    return sizes[0] == sizes[1] and _bytes(first, a.name) == _bytes(second, b.name)


def _lossless_pixels(path: Path, name: str) -> Codes:
    import cv2

    data = _bytes(path, name)
    checked_size(*_lossless_size(data, name), name)
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except (cv2.error, MemoryError) as error:
        raise damaged_picture(name, str(error)) from error
    if pixels is None:
        raise damaged_picture(name, "it cannot be decoded")
    if pixels.dtype not in (np.uint8, np.uint16) or pixels.ndim not in (2, 3) or pixels.shape[2:] not in _CHANNELS:
        text = f"it holds {pixels.dtype} of shape {pixels.shape}, not grey or RGB of 8 or 16 bits"
        advice = "floating-point light: save it as OpenEXR (.exr); otherwise as 8 or 16-bit RGB"
        raise PictureFileError(text, where=name, advice=advice)
    if pixels.ndim == 2 or pixels.shape[2] == 1:
        return _contiguous(np.repeat(pixels.reshape(*pixels.shape[:2], 1), 3, axis=2))
    if pixels.shape[2] == 4:
        refuse_alpha(_contiguous(pixels[..., 3]), name)
    return _contiguous(pixels[..., 2::-1])


def refuse_alpha(alpha: npt.NDArray[Any], name: str) -> None:
    """Let an alpha channel (H, W), codes or 0 to 1, of opaque pixels pass; `PictureFileError` for any other."""
    seen = alpha < (1 if alpha.dtype.kind == "f" else np.iinfo(alpha.dtype).max)
    if seen.any():
        text = f"{float(seen.mean()):.1%} of it is transparent: what is behind is unknown"
        advice = "save it without transparency (flatten it, or switch 'film transparent' off)"
        raise PictureFileError(text, where=name, advice=advice)


def _jpeg_size(data: bytes, name: str) -> tuple[int, int]:
    """Return width and height of a JPEG of the kinds that cameras write: Huffman coded, 8 bits, grey or YCbCr.

    Others (lossless, arithmetic, four colours) are refused before the decoder sees them: reduced decoding of lossless
    ones writes beyond its buffer (libjpeg-turbo 3, found with damaged files)."""
    if data[:2] != b"\xff\xd8":
        raise damaged_picture(name, "it does not start like a JPEG")
    at = 2
    while at + 10 <= len(data):
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at] != 0xFF:
            break
        if marker == 0xFF:  # fill bytes
            at += 1
            continue
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = (int.from_bytes(data[at + k : at + k + 2], "big") for k in (5, 7))
            if marker > 0xC2 or data[at + 4] != 8 or data[at + 9] not in (1, 3):
                raise damaged_picture(name, f"a JPEG of a kind that cameras do not write (frame type {marker:#x})")
            return checked_size(width, height, name)
        if marker in (0xD8, 0xD9, 0xDA) or length < 2:
            break
        at += 2 + length
    raise damaged_picture(name, "it has no frame header")


def refuse_early_end(data: bytes, name: str) -> None:
    """Raise `PictureFileError` for a JPEG or PNG that ends well-formed, before its last row: Pillow shows the rest."""
    import cv2

    try:
        if data.startswith(b"\xff\xd8"):
            simplejpeg.decode_jpeg(data, "GRAY", strict=True)
        elif data.startswith(b"\x89PNG") and cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) is None:
            raise ValueError("its picture data end early")
    except (ValueError, MemoryError, cv2.error) as error:
        raise damaged_picture(name, str(error)) from error


def _lossless_size(data: bytes, name: str) -> tuple[int, int]:
    """Return width and height that the file says it has, after what checks its format allows."""
    import warnings

    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # of half of `MAX_PIXELS`
            with Image.open(io.BytesIO(data), formats=("PNG", "TIFF")) as image:
                size = image.size
                if image.mode in ("CMYK", "LAB"):
                    raise PictureFileError(f"its colours are {image.mode}", where=name, advice="save it as RGB")
                if image.format == "PNG":
                    image.verify()
                else:
                    check_strips(image.tag_v2, len(data), name)  # type: ignore[attr-defined]
    except Exception as error:  # Pillow raises nearly anything over damaged files
        if isinstance(error, PictureFileError):
            raise
        raise damaged_picture(name, str(error)) from error
    return size


def check_strips(tags: Any, length: int, name: str) -> None:
    """Refuse a TIFF of these tags whose strips or tiles reach beyond the file: libtiff would leave them black.

    And one of more than 8 bits whose channels lie one after the other, or whose white is 0: OpenCV takes no notice.
    """
    if np.max(tags.get(258, 1)) > 8 and (tags.get(284) == 2 or tags.get(262) == 0):
        what, advice = "its channels lie one after the other, or its white is 0", "save it interleaved (RGBRGB)"
        raise PictureFileError(what, where=name, advice=advice)
    for offsets, sizes in ((273, 279), (324, 325)):
        starts, counts = tags.get(offsets, ()), tags.get(sizes, ())
        pairs = zip(np.atleast_1d(starts), np.atleast_1d(counts), strict=True)
        if any(int(start) + int(count) > length for start, count in pairs):
            raise damaged_picture(name, "it ends before its last strip")


def _reduced(pixels: Codes, reduce: int) -> Codes:
    if _checked(reduce) == 1:
        return pixels
    import cv2

    height, width = (-(-side // reduce) for side in pixels.shape[:2])
    edges = ((0, height * reduce - pixels.shape[0]), (0, width * reduce - pixels.shape[1]), (0, 0))
    whole: Any = np.pad(pixels, edges, mode="edge")
    return _contiguous(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


def _contiguous(pixels: Any) -> Codes:
    kept: Codes = np.ascontiguousarray(pixels)
    return kept


def _checked(reduce: int) -> int:
    if reduce not in (1, 2, 4, 8):
        raise ParameterError(f"frames are reduced by 1, 2, 4 or 8, not by {reduce}")
    return reduce


def _bytes(source: Path | bytes, name: str) -> bytes:
    if isinstance(source, bytes):
        return source
    try:
        return source.read_bytes()
    except OSError as error:
        raise PictureFileError(f"cannot be read: {error.strerror}", where=name) from error


def checked_size(width: int, height: int, name: str) -> tuple[int, int]:
    """Return width and height; `PictureFileError` for more pixels than a picture has."""
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        text = f"its header says {width} x {height} pixels; a picture has 1 to {MAX_PIXELS:,}"
        raise PictureFileError(text, where=name, likely="damage")
    return int(width), int(height)


def damaged_picture(name: str, what: str) -> PictureFileError:
    """Return the error of a file that cannot be decoded."""
    text = f"it is damaged or not what its name suggests: {what}"
    advice = "get the file from its source again, or leave it out"
    return PictureFileError(text, where=name, likely="a copy that was cut short, or a failing card", advice=advice)


@contextmanager
def _opened_raw(source: Path | bytes, name: str) -> Iterator[Any]:
    import rawpy

    try:
        with rawpy.imread(io.BytesIO(_bytes(source, name))) as raw:
            yield raw
    except rawpy.LibRawError as error:
        raise damaged_picture(name, error.args[0].decode("ascii", "replace")) from error
