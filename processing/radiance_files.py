"""Radiance pictures (.hdr) for ``evalglare``, ``falsecolor`` and ``pvalue``: value / 179, EXPOSURE, VIEW, RGBE.

Radiance takes luminance as 179 (0.265 R + 0.670 G + 0.065 B) whatever a file's PRIMARIES say; our weights are those
of Rec. 709. A blue sky would come out 2 % darker. So each pixel is written times (our luminance / Radiance's): grey
stays as it is, hue and saturation too, and every tool of Radiance finds the luminance of the picture in cd/m2.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from processing.errors import PictureFileError
from processing.images import LUMINANCE_WEIGHTS, Floats, LuminanceImage
from processing.picture_checks import check_image, check_light, check_size, refused
from processing.picture_writing import write_bytes
from processing.radiance_rgbe import RunLengthError, decode_rows, encode_rows, from_rgbe, to_rgbe
from processing.sphere import Equirectangular, Geometry, LensMapping, Perspective

WHITE_EFFICACY_LM_W = 179.0
RADIANCE_WEIGHTS = (0.265, 0.670, 0.065)
"""As ``evalglare`` and ``pvalue -b`` use them (Radiance, src/common/color.h)."""
MARK = "daylit_luminance=radiance-weights"

_MAX_FILE_BYTES = 1 << 31
_MAX_HEADER_BYTES = 1 << 20
_ROWS = 128
_FIT = 1e-6


@dataclass(frozen=True)
class RadiancePicture:
    """A Radiance file's light: without validity and uncertainty, so it is no `LuminanceImage`."""

    rgb: Floats
    """(H, W, 3): cd/m2 (value x 179, EXPOSURE divided out), Rec. 709."""
    view: str
    """The last VIEW line without its name, or empty."""
    exposure: float
    header: tuple[str, ...]
    """All lines of the header."""


def write_radiance_hdr(path: Path, image: LuminanceImage) -> None:
    """Write a picture in cd/m2 as Radiance RGBE, durably; step of the code: at most 0.8 % of a pixel's largest channel.

    Raises `PictureFileError` for a picture that breaks its type's promises, and for a geometry that has no view in
    Radiance (equisolid, polynomial, rolled, off-centre; anything but a fisheye, perspective or equirectangular).
    """
    check_image(image, path)
    width, height = image.geometry.width_px, image.geometry.height_px
    view = view_of(image.geometry, path)
    lines = ["#?RADIANCE", "SOFTWARE= daylit", MARK, "FORMAT=32-bit_rle_rgbe", "EXPOSURE=1"]
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
    return RadiancePicture(rgb, views[-1] if views else "", exposure, tuple(lines))


def view_of(geometry: Geometry, where: Path | str) -> str:
    """Return the options of Radiance's VIEW line for a geometry; empty for the whole sphere, which has none.

    Raises `PictureFileError` where Radiance has no such view.
    """
    if isinstance(geometry, Equirectangular):
        return ""
    if isinstance(geometry, Perspective):
        return _perspective_view(geometry, where)
    middle = (geometry.width_px / 2, geometry.height_px / 2)
    centre = geometry.centre_px or middle
    if max(abs(c - m) for c, m in zip(centre, middle, strict=True)) > 1e-3 or geometry.width_px != geometry.height_px:
        raise _no_view(where, "a fisheye that is not centred in a square")
    reach = geometry.width_px / 2 / geometry.radius_px
    if geometry.mapping is LensMapping.EQUIDISTANT and reach * geometry.half_field_rad <= math.pi:
        kind, degrees = "-vta", math.degrees(2 * reach * geometry.half_field_rad)
    elif geometry.mapping is LensMapping.ORTHOGRAPHIC and reach * math.sin(geometry.half_field_rad) <= 1 + _FIT:
        kind = "-vth"
        degrees = math.degrees(2 * math.asin(min(1.0, reach * math.sin(geometry.half_field_rad))))
    else:
        raise _no_view(where, f"this {geometry.mapping} fisheye")
    up = _vector(math.sin(geometry.top_azimuth_rad), math.cos(geometry.top_azimuth_rad), 0.0)
    return f"{kind} -vp 0 0 0 -vd 0 0 1 -vu {up} -vh {degrees:.9g} -vv {degrees:.9g}"


def _perspective_view(geometry: Perspective, where: Path | str) -> str:
    level = math.cos(geometry.pitch_rad)
    if geometry.roll_rad or level < _FIT:
        raise _no_view(where, "a perspective view that is rolled or looks straight up or down")
    ahead = _vector(
        level * math.sin(geometry.yaw_rad), level * math.cos(geometry.yaw_rad), math.sin(geometry.pitch_rad)
    )
    tall = 2 * math.atan(math.tan(geometry.fov_x_rad / 2) * geometry.height_px / geometry.width_px)
    angles = f"-vh {math.degrees(geometry.fov_x_rad):.9g} -vv {math.degrees(tall):.9g}"
    return f"-vtv -vp 0 0 0 -vd {ahead} -vu 0 0 1 {angles}"


def _vector(*values: float) -> str:
    return " ".join(f"{round(value, 12) + 0.0:.12g}" for value in values)


def _no_view(where: Path | str, what: str) -> PictureFileError:
    return refused(
        where,
        f"Radiance has no view for {what}",
        advice="project it to an equidistant or orthographic fisheye that fills a square first",
    )


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
    size = re.fullmatch(rb"-Y ([0-9]{1,9}) \+X ([0-9]{1,9})", data[end + 2 : stop].strip())
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
