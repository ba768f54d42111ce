"""Our geometries as Radiance's views, and back (options of rpict: -vt type, -vd direction, -vu up, -vh -vv angles)."""

from __future__ import annotations

import math
from pathlib import Path

from processing.errors import PictureFileError
from processing.pictures.writing import refused
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, Perspective

_FIT = 1e-6


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


def geometry_of(view: str, width: int, height: int) -> Fisheye | None:
    """Return the fisheye that a view's options describe; None for other views and for none at all.

    Taken are ``-vta`` and ``-vth`` with one angle both ways in a square picture. A direction that is not given is taken
    as upwards: the tools that make such pictures of skies leave it out.
    """
    words = view.split()
    kinds = {"-vta": LensMapping.EQUIDISTANT, "-vth": LensMapping.ORTHOGRAPHIC}
    mapping = next((kinds[word] for word in words if word in kinds), None)
    try:
        across, along = (float(words[words.index(name) + 1]) for name in ("-vh", "-vv"))
        ahead = _numbers(words, "-vd", (0.0, 0.0, 1.0))
        up = _numbers(words, "-vu", (0.0, 1.0, 0.0))
    except (ValueError, IndexError):
        return None
    limit = 360 if mapping is LensMapping.EQUIDISTANT else 180
    level = math.hypot(ahead[0], ahead[1]) > _FIT * ahead[2]
    if mapping is None or width != height or across != along or not 0 < across <= limit or level:
        return None
    # Where up is along the direction itself, as Radiance's default is, the picture's top is taken as +y.
    top = math.atan2(up[0], up[1]) if math.hypot(up[0], up[1]) > _FIT else 0.0
    return Fisheye(width, height, mapping, width / 2, math.radians(across / 2), None, top)


def _numbers(words: list[str], name: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    if name not in words:
        return default
    place = words.index(name)
    x, y, z = (float(word) for word in words[place + 1 : place + 4])
    return x, y, z
