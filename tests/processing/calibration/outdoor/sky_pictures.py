"""Merged sky pictures of the simulated outdoor camera without noise, and what is true of them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from mocks.optics.camera import CANON_5D2, ND3_TINT, image_rows
from mocks.worlds.light import luminance_cd_m2
from mocks.worlds.simple_room import SimpleRoom
from mocks.worlds.sky import SimpleSky
from processing.calibration.outdoor import outdoor
from processing.calibration.outdoor.lens import ImageCircle, LensModel
from processing.calibration.outdoor.nd_filter import NdFilter
from processing.calibration.outdoor.outdoor import OutdoorOptics, OutdoorView, outdoor_view
from processing.calibration.scale.vignetting import fit_flat
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.sphere import Geometry, LensMapping


@cache
def optics_of(width: int) -> OutdoorOptics:
    """Return the simulated camera's optics for pictures of a width; the fall-off as a flat field shows it."""
    circle = ImageCircle((width / 2, width / 3), width * 16 / 36 * math.sin(math.pi / 4), (width, width * 2 // 3))
    lens = LensModel(LensMapping.EQUISOLID, circle)
    x, y = np.arange(width) + 0.5, np.arange(width * 2 // 3)[:, None] + 0.5
    flat = np.repeat(CANON_5D2.lens.falloff(x, y, (width, width * 2 // 3))[..., None], 3, axis=-1)
    falloff = replace(fit_flat([flat], lens.fisheye()), relative_uncertainty=0.0)
    return OutdoorOptics(lens, falloff, NdFilter(ND3_TINT, 3.0))


def sky_picture(sky: SimpleSky, width: int, *, clip: float | None = None) -> RelativeImage:
    """Return what a perfect merge gives, times the filter's density, without glare; values above ``clip`` clipped."""
    size = (width, width * 2 // 3)
    rgb = image_rows(SimpleRoom(sky=sky), CANON_5D2, size, range(size[1])) * np.float32(10**CANON_5D2.filter.density)
    geometry = optics_of(width).lens.fisheye()
    x, y = np.arange(size[0]) + 0.5, np.arange(size[1])[:, None] + 0.5
    inside = CANON_5D2.lens.falloff(x, y, size) > 0
    validity = np.where(inside, Validity.VALID, Validity.OUTSIDE).astype(np.uint8)
    if clip is not None:
        validity[(rgb.max(axis=-1) >= clip) & inside] = Validity.CLIPPED
        rgb = np.minimum(rgb, np.float32(clip))
    rgb[~inside] = 0
    uncertainty = np.where(inside, np.float32(0.01), np.float32(np.inf))
    return RelativeImage(rgb.astype(np.float32), uncertainty.astype(np.float32), validity, geometry)


def correct_outdoor(
    image: RelativeImage, optics: OutdoorOptics, target: Geometry | None = None, *, top_azimuth_rad: float | None = None
) -> RelativeImage:
    """Return an outdoor picture as merged after the whole chain: lens, fall-off, filter, then in another geometry.

    ``target``: None is hemispherical, as many rows as the image circle has, azimuth 0 on top.
    """
    image = outdoor.with_lens(image, optics, top_azimuth_rad)
    image = outdoor.correct_colour(outdoor.correct_vignetting(image, optics), optics)
    if target is None:
        lens = optics.lens.circle.scaled((image.rgb.shape[1], image.rgb.shape[0]))
        target = outdoor_view(OutdoorView.HEMISPHERICAL, max(2, round(2 * lens.radius_px)))
    return outdoor.project(image, target)


def in_cd_m2(image: RelativeImage) -> LuminanceImage:
    """Return a picture whose scale is already absolute."""
    return LuminanceImage(image.rgb, image.uncertainty, image.validity, image.geometry, 0.02)


def true_horizontal_lx(sky: SimpleSky) -> tuple[float, float]:
    """Return the illuminance on level ground: of sky and hedges, and of the sun."""
    rows = 400
    sine = np.sqrt((np.arange(rows) + 0.5) / rows)[:, None]
    azimuth = (np.arange(2 * rows) + 0.5) * (math.pi / rows)
    flat = np.sqrt(1 - sine**2)
    parts = np.broadcast_arrays(flat * np.sin(azimuth), flat * np.cos(azimuth), sine)
    even = luminance_cd_m2(sky.radiance(np.stack(parts, axis=-1).astype(np.float32)))
    sun = sky.sun
    normal = float(luminance_cd_m2(np.array(sun.radiance_rgb, dtype=np.float32))) * sun.solid_angle_sr
    return float(even.mean(dtype=np.float64)) * math.pi, normal * math.sin(sky.sun_elevation_rad)
