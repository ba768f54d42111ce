"""JPEG pictures for people and viewers, with XMP that says what they show (docs/formats.md)."""

from __future__ import annotations

from processing.ground.arrays import Bytes

import io
from pathlib import Path

import numpy as np

from processing.errors import ParameterError
from processing.exchange.xmp import PanoramaTags, packet
from processing.picture_writing import write_bytes

LONGEST_SIDE_PX = 65_500
"""Of JPEG."""


def jpeg_bytes(
    rgb8: Bytes,
    *,
    panorama: PanoramaTags | None = None,
    staged: bool = False,
    relative: bool = False,
    title: str = "",
    quality: int = 92,
) -> bytes:
    """Return a JPEG (4:4:4) of an 8-bit sRGB picture (H, W, 3) with an XMP packet; see `xmp.packet`.

    Raises `ParameterError` for another array, a size that JPEG cannot have, a quality outside 1 to 95, and a panorama
    that the picture does not fit into.
    """
    from PIL import Image

    if rgb8.dtype != np.uint8 or rgb8.ndim != 3 or rgb8.shape[2] != 3 or not rgb8.size:
        raise ParameterError(f"an 8-bit picture is uint8 (H, W, 3), not {rgb8.dtype} {rgb8.shape}")
    if max(rgb8.shape[:2]) > LONGEST_SIDE_PX:
        raise ParameterError(f"a JPEG is at most {LONGEST_SIDE_PX} pixels wide and high", advice="make it smaller")
    if not 1 <= quality <= 95:
        raise ParameterError(f"a JPEG quality of {quality}", advice="1 to 95")
    height, width = rgb8.shape[:2]
    xmp = packet(width, height, panorama=panorama, staged=staged, relative=relative, title=title)
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgb8)).save(out, "JPEG", quality=quality, subsampling=0, xmp=xmp)
    return out.getvalue()


def write_jpeg(
    path: Path,
    rgb8: Bytes,
    *,
    panorama: PanoramaTags | None = None,
    staged: bool = False,
    relative: bool = False,
    title: str = "",
    quality: int = 92,
) -> None:
    """Write `jpeg_bytes` durably. ``staged``: furniture was added; ``relative``: the light's scale is unknown."""
    data = jpeg_bytes(rgb8, panorama=panorama, staged=staged, relative=relative, title=title, quality=quality)
    write_bytes(path, data)


__all__ = ["PanoramaTags", "jpeg_bytes", "write_jpeg"]
