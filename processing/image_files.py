"""Pictures in and out of files; each kind of file has a module of its own (docs/formats.md).

``.exr`` keeps everything and is what stages hand on; ``.hdr`` is for Radiance's tools; JPEG and PNG are to look at.
"""

from __future__ import annotations

from processing.exr_files import read_exr, read_exr_rgb, write_exr
from processing.picture_preview import jpeg_bytes, png_bytes, preview_rgb8, write_jpeg, write_png
from processing.radiance_files import RadiancePicture, read_radiance_hdr, write_radiance_hdr

__all__ = [
    "RadiancePicture",
    "jpeg_bytes",
    "png_bytes",
    "preview_rgb8",
    "read_exr",
    "read_exr_rgb",
    "read_radiance_hdr",
    "write_exr",
    "write_jpeg",
    "write_png",
    "write_radiance_hdr",
]
