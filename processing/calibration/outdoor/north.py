"""North: from the sun's place in the outdoor picture, the time and the site; or from the recorded heading."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Literal

from processing.calibration.outdoor.clear_sky import Place, sun_place
from processing.calibration.outdoor.sun_disc import Sun, find_sun
from processing.errors import SunError
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.sphere import Equirectangular, Fisheye

WARN_RAD = math.radians(1.0)
"""Disagreement in elevation that is worth a warning: a camera off level, or a clock that is wrong."""
REFUSE_RAD = math.radians(8.0)
"""What was found is not the sun, or not at that time and place."""
COMPASS_SIGMA_RAD = math.radians(5.0)
"""Of a heading read from a compass."""


@dataclass(frozen=True)
class North:
    """Which way the picture's top (a panorama's middle column) faces: compass azimuth, clockwise from north."""

    top_azimuth_rad: float
    """In 0..2 pi."""
    sigma_rad: float
    source: Literal["sun", "heading"]
    elevation_off_rad: float | None = None
    """The sun's elevation in the picture less that of time and site."""
    warnings: tuple[str, ...] = ()


def north_from_sun(
    image: RelativeImage | LuminanceImage,
    time_utc: datetime,
    place: Place,
    *,
    sun: Sun | None = None,
    time_sigma_s: float = 2.0,
    level_sigma_rad: float = math.radians(0.05),
) -> North:
    """Return where the picture's top faces. ``sun``: as `find_sun` gave it for this picture (None: it is found).

    The uncertainty has parts from the picture, the clock (``time_sigma_s``) and the levelling of the camera; an error e
    along the horizon is e / cos(elevation) of azimuth. Raises `SunError` where there is no sun, where its elevation
    disagrees with time and site by more than 8 degrees, or where it stands at the zenith, which has no azimuth.
    """
    sun = sun or find_sun(image)
    expected = sun_place(time_utc, place)
    off = sun.elevation_rad - expected.elevation_rad
    _agree(sun, expected.elevation_rad, off)
    in_picture = sun.azimuth_rad - _top_of(image.geometry)
    later = sun_place(time_utc + timedelta(minutes=1), place)
    rate = math.remainder(later.azimuth_rad - expected.azimuth_rad, 2 * math.pi) / 60
    across = math.hypot(sun.sigma_rad, level_sigma_rad * math.sin(abs(sun.elevation_rad))) / math.cos(sun.elevation_rad)
    sigma = math.hypot(across, rate * time_sigma_s)
    if sigma > math.pi / 8:
        raise SunError("the sun stands at the zenith and has no azimuth", advice="take north from the recorded heading")
    return North((expected.azimuth_rad - in_picture) % (2 * math.pi), sigma, "sun", off, _warnings(off, sun))


def north_from_heading(heading_rad: float, sigma_rad: float = COMPASS_SIGMA_RAD) -> North:
    """Return a recorded heading (compass azimuth of the picture's top) as a north."""
    return North(heading_rad % (2 * math.pi), sigma_rad, "heading")


def oriented(geometry: Fisheye, north: North, heading_rad: float = 0.0) -> Fisheye:
    """Return the geometry with its top where it faces, in a world whose +y has the compass azimuth ``heading_rad``."""
    return replace(geometry, top_azimuth_rad=math.remainder(north.top_azimuth_rad - heading_rad, 2 * math.pi))


def _top_of(geometry: object) -> float:
    """Return the azimuth (from +y) that a picture's top, or a panorama's middle, is taken to have."""
    if isinstance(geometry, Fisheye):
        return geometry.top_azimuth_rad
    if isinstance(geometry, Equirectangular):
        return geometry.yaw_rad
    raise SunError("north is found in fisheye pictures and panoramas, not in perspective views")


def _agree(sun: Sun, expected_rad: float, off_rad: float) -> None:
    if abs(off_rad) > REFUSE_RAD:
        raise SunError(
            f"the sun stands {math.degrees(sun.elevation_rad):.1f} degrees high in the picture, "
            f"and {math.degrees(expected_rad):.1f} by time and site",
            likely="a wrong clock, zone or site, a camera far off level, or a lamp taken for the sun",
            advice="check the session's time and site, or take north from the recorded heading",
            found_deg=math.degrees(sun.elevation_rad),
            expected_deg=math.degrees(expected_rad),
        )


def _warnings(off_rad: float, sun: Sun) -> tuple[str, ...]:
    found = []
    if abs(off_rad) > WARN_RAD + 3 * sun.sigma_rad:
        way = "higher" if off_rad > 0 else "lower"
        found.append(
            f"the sun is {abs(math.degrees(off_rad)):.1f} degrees {way} in the picture than time and site say: "
            "a camera off level, or a clock that is minutes off"
        )
    if sun.cut:
        found.append("part of the sun lies outside the field; its centre is that of a disc fitted to the rest")
    return tuple(found)
