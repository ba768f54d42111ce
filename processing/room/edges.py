"""Strips of the full-size picture along predicted boundaries, and the edges in them.

A strip holds log luminance over offsets in latitude from the prediction, one column an azimuth. HDR is used as it is:
log differences are contrasts of the surfaces, in the darkest corner and beside a window alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Flags
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.sphere import Equirectangular
from processing.sphere.resampling import linear_samples

REACH_RAD = math.radians(2.6)
"""Of a strip to both sides."""
SIDE_RAD = math.radians(0.3)
"""Height that is averaged on either side of an edge; at least a pixel."""
LEAST_CONTRAST = 0.08
"""Log difference at which an edge counts half."""
DARK_SHARE = 1e-3
"""Of the picture's median luminance, below which contrast is noise."""


@dataclass(frozen=True)
class Strip:
    """Edges along one boundary: strength (columns, offsets) in 0..1, at latitudes prediction + ``offset_rad``."""

    offset_rad: Doubles
    strength: npt.NDArray[np.float32]
    contrast: npt.NDArray[np.float32]
    """(columns, offsets): log luminance above less below."""

    def at(self, offsets: Doubles) -> Doubles:
        """Return the strength at (..., columns) offsets; 0 beyond the strip."""
        step = self.offset_rad[1] - self.offset_rad[0]
        place = (offsets - self.offset_rad[0]) / step
        inside = (place >= 0) & (place <= len(self.offset_rad) - 1)
        low = np.clip(place.astype(int), 0, len(self.offset_rad) - 2)
        part = np.clip(place - low, 0, 1)
        columns = np.arange(self.strength.shape[0])
        value = (1 - part) * self.strength[columns, low] + part * self.strength[columns, low + 1]
        return np.where(inside, value, 0.0)


def strip_along(image: RelativeImage | LuminanceImage, azimuth_rad: Doubles, latitude_rad: Doubles) -> Strip:
    """Return the edges around latitudes (n,) predicted at azimuths (n,), of an equirectangular picture."""
    geometry = image.geometry
    assert isinstance(geometry, Equirectangular)
    pixel = math.pi / geometry.height_px
    step = max(pixel, math.radians(0.05)) / 2
    reach = math.ceil(REACH_RAD / step)
    offset = np.arange(-reach, reach + 1) * step
    side = max(round(max(SIDE_RAD, pixel) / step), 1)
    wide = np.arange(-reach - side, reach + side + 1) * step
    light = _log_luminance(image, geometry, azimuth_rad, np.clip(latitude_rad[:, None] + wide, -1.55, 1.55))
    running = np.concatenate([np.zeros((len(light), 1)), np.cumsum(light, axis=1)], axis=1)
    middle = np.arange(side, side + len(offset))
    # The sample in the middle belongs to neither side.
    above = running[:, middle + 1 + side] - running[:, middle + 1]
    below = running[:, middle] - running[:, middle - side]
    contrast = (above - below) / side
    strength = contrast**2 / (contrast**2 + LEAST_CONTRAST**2)
    return Strip(np.asarray(offset, dtype=np.float64), strength.astype(np.float32), contrast.astype(np.float32))


def _log_luminance(
    image: RelativeImage | LuminanceImage, geometry: Equirectangular, azimuth_rad: Doubles, latitude_rad: Doubles
) -> Doubles:
    turns = (azimuth_rad - geometry.yaw_rad) / (2 * math.pi) + 0.5
    x = (turns % 1.0) * geometry.width_px - 0.5
    y = np.clip((0.5 - latitude_rad / math.pi) * geometry.height_px - 0.5, 0, geometry.height_px - 1)
    columns = np.broadcast_to(x[:, None], y.shape).astype(np.float32)
    light = luminance_cd_m2(linear_samples(image.rgb, columns, y.astype(np.float32), cv2.BORDER_WRAP))
    step = max(1, geometry.height_px // 64)
    usual = float(np.median(luminance_cd_m2(image.rgb[::step, ::step])))
    return np.log(np.maximum(light, max(usual * DARK_SHARE, 1e-12)).astype(np.float64))


def peaks_near(strip: Strip, expected: Doubles, within_rad: float, least: float) -> tuple[Doubles, Flags]:
    """Return each column's strongest edge near an expected offset (columns,), to a part of a step, and which have one.

    Edges farther away count less; a column whose strength does not come down on both sides has none.
    """
    step = strip.offset_rad[1] - strip.offset_rad[0]
    away = strip.offset_rad[None] - expected[:, None]
    near = np.abs(away) <= within_rad
    size = np.abs(strip.contrast)
    value = np.where(near, size * (1 - 0.5 * (away / within_rad) ** 2), 0.0)
    best = np.clip(value.argmax(axis=1), 1, len(strip.offset_rad) - 2)
    columns = np.arange(len(best))
    before, here, after = (size[columns, best + k].astype(np.float64) for k in (-1, 0, 1))
    bend = before - 2 * here + after
    found = (strip.strength[columns, best] >= least) & near[columns, best]
    found &= (bend < 0) & (here >= before) & (here >= after)
    shift = np.where(found, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
    return strip.offset_rad[best] + np.clip(shift, -0.5, 0.5) * step, found
