"""Pictures to look at: 8-bit sRGB from linear light, JPEG and PNG files."""

from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Flags, Floats
from processing.ground.colour import luminance_cd_m2, srgb_of_linear
from processing.pictures.frames import refuse_early_end
from processing.pictures.writing import check_size, refused, write_bytes

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

KEY = 0.28  # where the mean of the logarithm goes: rooms are mostly light walls, so higher than middle grey (0.18)
_WHITE_SHARE = 0.995  # of the pixels below white; chosen
_ROWS = 256  # at a time, for memory


def preview_rgb8(rgb: Floats) -> Bytes:
    """Return linear light (H, W, 3) as 8-bit sRGB: scaled, highlights rolled off, encoded (IEC 61966-2-1).

    The mean of the logarithm goes to `KEY`, and the brightest half per cent is white (Reinhard et al. 2002, eq. 4, on
    luminance). All black stays black.
    """
    sample = luminance_cd_m2(rgb[:: max(1, rgb.shape[0] // 512), :: max(1, rgb.shape[1] // 1024)])
    lit = sample[sample > 0].astype(np.float64)
    scale = KEY / float(np.exp(np.log(lit).mean())) if lit.size else 1.0
    white = max(1.0, float(np.quantile(sample * scale, _WHITE_SHARE)))
    out = np.empty(rgb.shape, dtype=np.uint8)
    for top in range(0, rgb.shape[0], _ROWS):
        rows = rgb[top : top + _ROWS] * np.float32(scale)
        luminance = luminance_cd_m2(rows)[..., None]
        out[top : top + _ROWS] = srgb_of_linear(rows * ((1 + luminance / np.float32(white * white)) / (1 + luminance)))
    return out


def jpeg_bytes(rgb8: Bytes) -> bytes:
    """Return a JPEG (4:4:4) of an 8-bit picture (H, W, 3)."""
    from PIL import Image

    check_rgb8(rgb8)
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgb8)).save(out, "JPEG", quality=90, subsampling=0)
    return out.getvalue()


def png_bytes(array: Bytes) -> bytes:
    """Return a PNG of a mask (H, W) or a picture (H, W, 3), 8 bits, without loss."""
    from PIL import Image

    if array.ndim == 3:
        check_rgb8(array)
    out = io.BytesIO()
    way = zlib.Z_RLE if array.ndim == 2 else zlib.Z_DEFAULT_STRATEGY  # a mask is runs of alike pixels
    Image.fromarray(np.ascontiguousarray(array)).save(out, "PNG", compress_level=6, compress_type=way)
    return out.getvalue()


def check_rgb8(rgb8: Bytes) -> None:
    """Raise `ParameterError` for what is no 8-bit picture (H, W, 3)."""
    if rgb8.dtype != np.uint8 or rgb8.ndim != 3 or rgb8.shape[2] != 3 or not rgb8.size:
        raise ParameterError(f"an 8-bit picture is uint8 (H, W, 3), not {rgb8.dtype} {rgb8.shape}")


# Masks as files: PNG of 8 bits, 0 or 255, that any drawing program opens and corrects.


MAX_BYTES = 1 << 28  # chosen: no honest mask is larger
SIXTEEN_BITS = ("I;16", "I;16B", "I;16L", "I;16N")
EIGHT_BITS = ("1", "L", "P", "PA", "RGB", "RGBX", "CMYK", "YCbCr", "LA", "RGBA", "La", "RGBa")
"""Pillow's names of pictures that it brings to 8 bits by itself."""


def write_mask(path: Path, mask: Flags) -> None:
    """Write booleans (H, W) durably: 255 where true."""
    if mask.ndim != 2 or mask.dtype != np.bool_ or not mask.size:
        raise refused(path, f"a mask is bool (H, W), not {mask.dtype} {mask.shape}")
    write_bytes(path, png_bytes(mask.astype(np.uint8) * np.uint8(255)))


def read_mask(path: Path) -> Flags:
    """Return booleans (H, W): true where a picture file is at least half bright (in any channel), and not transparent.

    Raises `PictureFileError`: no picture, one of a size that masks cannot have, or of values without a known white
    (32-bit integers, floats); names the file.
    """
    from PIL import Image

    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise refused(path, f"cannot be read: {error.strerror}") from error
    if len(raw) > MAX_BYTES:
        raise refused(path, f"larger than {MAX_BYTES} bytes")
    try:
        with Image.open(io.BytesIO(raw), formats=("PNG", "JPEG", "BMP", "TIFF")) as picture:
            # Before anything is decoded: a small file may claim any size.
            check_size(picture.width, picture.height, path)
            marked = _marked(picture, path)
            refuse_early_end(raw, str(path))
            return marked
    # Decoders raise whatever their formats make of damaged bytes.
    except (OSError, SyntaxError, ValueError, EOFError, TypeError, Image.DecompressionBombError) as error:
        why = str(error).partition(" <")[0]  # Pillow adds the object it was given
        raise refused(path, f"is not a readable mask: {why}", advice="give a PNG, black and white") from error


def _marked(picture: ImageFile, path: Path) -> Flags:
    """Return where an opened picture is at least half bright and not transparent."""
    if picture.mode in SIXTEEN_BITS:
        return np.asarray(np.asarray(picture) >= 1 << 15)
    if picture.mode not in EIGHT_BITS:
        text = f"has pixels of the kind {picture.mode}, for which white is undefined"
        raise refused(path, text, advice="give a PNG of 8 or 16 bits, black and white")
    if picture.mode in ("1", "L") and "transparency" not in picture.info:
        return np.asarray(np.asarray(picture.convert("L")) >= 128)
    if picture.mode in ("LA", "RGBA", "La", "RGBa", "PA") or "transparency" in picture.info:
        values = np.asarray(picture.convert("RGBA"))
        return np.asarray((values[..., :3].max(axis=2) >= 128) & (values[..., 3] >= 128))
    return np.asarray(np.asarray(picture.convert("RGB")).max(axis=2) >= 128)
