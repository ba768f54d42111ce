"""Masks as files: PNG of 8 bits, 0 or 255, that any drawing program opens and corrects."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from processing.ground.arrays import Flags
from processing.pictures.preview import write_png
from processing.pictures.writing import check_size, refused

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile


MAX_BYTES = 1 << 28  # chosen: no honest mask is larger
SIXTEEN_BITS = ("I;16", "I;16B", "I;16L", "I;16N")
EIGHT_BITS = ("1", "L", "P", "PA", "RGB", "RGBX", "CMYK", "YCbCr", "LA", "RGBA", "La", "RGBa")
"""Pillow's names of pictures that it brings to 8 bits by itself."""


def write_mask(path: Path, mask: Flags) -> None:
    """Write booleans (H, W) durably: 255 where true."""
    if mask.ndim != 2 or mask.dtype != np.bool_ or not mask.size:
        raise refused(path, f"a mask is bool (H, W), not {mask.dtype} {mask.shape}")
    write_png(path, mask.astype(np.uint8) * np.uint8(255))


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
            return _marked(picture, path)
    # Decoders raise whatever their formats make of damaged bytes.
    except (OSError, SyntaxError, ValueError, EOFError, TypeError, Image.DecompressionBombError) as error:
        raise refused(path, f"is no mask that can be read: {error}", advice="give a PNG, black and white") from error


def _marked(picture: ImageFile, path: Path) -> Flags:
    """Return where an opened picture is at least half bright and not transparent."""
    if picture.mode in SIXTEEN_BITS:
        return np.asarray(np.asarray(picture) >= 1 << 15)
    if picture.mode not in EIGHT_BITS:
        raise refused(
            path,
            f"has pixels of the kind {picture.mode}, of which nobody knows what is white",
            advice="give a PNG of 8 or 16 bits, black and white",
        )
    if picture.mode in ("1", "L") and "transparency" not in picture.info:
        return np.asarray(np.asarray(picture.convert("L")) >= 128)
    if picture.mode in ("LA", "RGBA", "La", "RGBa", "PA") or "transparency" in picture.info:
        values = np.asarray(picture.convert("RGBA"))
        return np.asarray((values[..., :3].max(axis=2) >= 128) & (values[..., 3] >= 128))
    return np.asarray(np.asarray(picture.convert("RGB")).max(axis=2) >= 128)
