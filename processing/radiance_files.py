"""Radiance pictures (.hdr) for ``evalglare``, ``falsecolor`` and ``pvalue``: value / 179, EXPOSURE, VIEW, RGBE.

Radiance takes luminance as 179 (0.265 R + 0.670 G + 0.065 B) whatever a file's PRIMARIES say; our weights are those
of Rec. 709. A blue sky would come out 2 % darker. So each pixel is written times (our luminance / Radiance's): grey
stays as it is, hue and saturation too, and every tool of Radiance finds the luminance of the picture in cd/m2.
"""

from __future__ import annotations

from processing.ground.arrays import Floats

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from processing.images import LUMINANCE_WEIGHTS, LuminanceImage
from processing.picture_checks import check_image, check_light, check_size, refused
from processing.picture_writing import write_bytes
from processing.radiance_rgbe import RunLengthError, decode_rows, encode_rows, from_rgbe, to_rgbe
from processing.radiance_views import geometry_of, view_of
from processing.sphere import Geometry

WHITE_EFFICACY_LM_W = 179.0
RADIANCE_WEIGHTS = (0.265, 0.670, 0.065)
"""As ``evalglare`` and ``pvalue -b`` use them (Radiance, src/common/color.h)."""
MARK = "daylit_luminance=radiance-weights"
RELATIVE_MARK = "daylit_units=relative"
"""In the header of a picture whose scale nothing gave: its values are no watts, and not to be taken for cd/m2."""

_MAX_FILE_BYTES = 1 << 31
_MAX_HEADER_BYTES = 1 << 20
_ROWS = 128


@dataclass(frozen=True)
class RadiancePicture:
    """A Radiance file's light: without validity and uncertainty, so it is no `LuminanceImage`."""

    rgb: Floats
    """(H, W, 3): cd/m2 (value x 179, EXPOSURE divided out), Rec. 709."""
    view: str
    """The last VIEW line without its name, or empty."""
    geometry: Geometry | None
    """What the view says, where it is a fisheye that looks up."""
    exposure: float
    header: tuple[str, ...]
    """All lines of the header."""

    @property
    def absolute(self) -> bool:
        """Whether daylit wrote the values as cd/m2; other programs' files do not say what their values are."""
        return MARK in self.header and RELATIVE_MARK not in self.header


def write_radiance_hdr(path: Path, image: LuminanceImage) -> None:
    """Write a picture in cd/m2 as Radiance RGBE, durably; step of the code: at most 0.8 % of a pixel's largest channel.

    Raises `PictureFileError` for a picture that breaks its type's promises, and for a geometry that has no view in
    Radiance (equisolid, polynomial, rolled, off-centre; anything but a fisheye, perspective or equirectangular).
    """
    check_image(image, path)
    width, height = image.geometry.width_px, image.geometry.height_px
    view = view_of(image.geometry, path)
    lines = ["#?RADIANCE", "SOFTWARE= daylit", MARK, "FORMAT=32-bit_rle_rgbe", "EXPOSURE=1"]
    lines += [] if image.absolute else [RELATIVE_MARK]
    lines += [f"VIEW= {view}"] if view else []
    blocks = ["\n".join([*lines, "", f"-Y {height} +X {width}", ""]).encode("ascii")]
    for top in range(0, height, _ROWS):
        rows = image.rgb[top : top + _ROWS]
        gain = _ratio(rows, LUMINANCE_WEIGHTS, RADIANCE_WEIGHTS) * np.float32(1 / WHITE_EFFICACY_LM_W)
        blocks.append(encode_rows(to_rgbe(rows * gain[..., None], top)))
    write_bytes(path, b"".join(blocks))


def read_radiance_hdr(path: Path) -> RadiancePicture:
    """Read an RGBE picture: of daylit (the inverse of `write_radiance_hdr`), or of others (values taken as Rec. 709).

    Raises `PictureFileError` for damage (rows that end early, overrun or go on), XYZE, turned or mirrored rows and
    colour-corrected files.
    """
    try:
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise refused(path, f"is larger than {_MAX_FILE_BYTES} bytes")
        data = path.read_bytes()
    except OSError as error:
        raise refused(path, f"cannot be read ({error.strerror})") from error
    lines, width, height, start = _header(data, path)
    exposure = _exposure(lines, path)
    try:
        rgbe = decode_rows(data[start:], width, height)
    except RunLengthError as error:
        raise refused(
            path, f"is damaged: {error}", likely="cut short or overwritten", advice="copy it again"
        ) from error
    with np.errstate(over="ignore"):
        rgb = from_rgbe(rgbe) * np.float32(WHITE_EFFICACY_LM_W / exposure)
    check_light(rgb, path)
    if MARK in lines:
        rgb *= _ratio(rgb, RADIANCE_WEIGHTS, LUMINANCE_WEIGHTS)[..., None]
    views = [line.partition("=")[2].strip() for line in lines if line.startswith("VIEW=")]
    view = views[-1] if views else ""
    return RadiancePicture(rgb, view, geometry_of(view, width, height), exposure, tuple(lines))


def _ratio(rgb: Floats, above: tuple[float, ...], below: tuple[float, ...]) -> Floats:
    """Return luminance by one set of weights over that by another, (H, W); 1 where it is black."""
    over, under = (rgb @ np.array(weights, dtype=np.float32) for weights in (above, below))
    return np.asarray(np.divide(over, under, out=np.ones_like(over), where=under > 0), dtype=np.float32)


def _header(data: bytes, path: Path) -> tuple[list[str], int, int, int]:
    """Return the header's lines, width, height, and where the pixels begin."""
    if not data.startswith(b"#?"):
        raise refused(path, "is no Radiance picture")
    end = data.find(b"\n\n", 0, _MAX_HEADER_BYTES)
    stop = data.find(b"\n", end + 2, end + 80)
    if end < 0 or stop < 0:
        raise refused(path, "has a damaged header", likely="cut short or overwritten")
    lines = data[:end].decode("utf-8", "replace").split("\n")
    size = re.fullmatch(rb"-Y +([0-9]{1,9}) +\+X +([0-9]{1,9})", data[end + 2 : stop].strip())
    if size is None:
        raise refused(path, f"has the size {data[end + 2 : stop]!r}; '-Y height +X width' is taken")
    height, width = (int(value) for value in size.groups())
    check_size(width, height, path)
    formats = [line.partition("=")[2].strip() for line in lines if line.startswith("FORMAT=")]
    if any(one != "32-bit_rle_rgbe" for one in formats):
        raise refused(path, f"has the format {formats[-1]}", advice="convert it with ra_xyze -r")
    return lines, width, height, stop + 1


def _exposure(lines: list[str], path: Path) -> float:
    """Return the product of all EXPOSURE lines."""
    exposure = 1.0
    for line in lines:
        name, _, value = line.partition("=")
        if name == "COLORCORR" and value.split() != ["1", "1", "1"]:
            raise refused(path, f"was colour-corrected ({value.strip()})")
        if name == "EXPOSURE":
            try:
                exposure *= float(value)
            except ValueError:
                exposure = math.nan
    if not (math.isfinite(exposure) and exposure > 0):
        raise refused(path, "has an EXPOSURE that is no positive number")
    return exposure
