"""What can be seen without any network: whether a picture is a whole, lit panorama."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.errors import NoRoomError
from processing.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular

LARGEST_BLANK = 0.3
"""Share of the sphere without data or detail from which a picture is refused."""
STEP_ROWS = 256


@dataclass(frozen=True)
class PictureFacts:
    """Shares (0..1) of the sphere."""

    blank: float
    """Without data, or black."""


def check_picture(image: RelativeImage | LuminanceImage) -> PictureFacts:
    """Return what is wrong with a panorama but may be borne.

    Raises
    ------
    NoRoomError
        Not equirectangular, not twice as wide as high (cropped), black, or blank over much of the sphere.
    """
    geometry = image.geometry
    if not isinstance(geometry, Equirectangular):
        raise NoRoomError("the picture is not equirectangular", advice="give a whole panorama")
    if abs(geometry.width_px / geometry.height_px - 2) > 0.02 or geometry.height_px < 16:
        raise NoRoomError(
            f"the picture is {geometry.width_px} x {geometry.height_px} px; a whole panorama is twice as wide as high",
            likely="it is cropped",
            advice="pad it to 2:1 with its middle on the horizon, or export it whole",
        )
    step = max(1, geometry.height_px // STEP_ROWS)
    small, data = luminance_cd_m2(image.rgb[::step, ::step]), image.validity[::step, ::step] != Validity.OUTSIDE
    if not (small > 0).any() or _contrast_stops(small) < 0.05:
        raise NoRoomError("the picture is black or of one even brightness", advice="check exposure and lens cap")
    blank = _blank(small, data)
    if blank > LARGEST_BLANK:
        raise NoRoomError(
            f"{100 * blank:.0f} % of the sphere show nothing",
            likely="the panorama is cropped above or below, or most of it is black",
            advice="give a whole panorama",
        )
    return PictureFacts(blank)


def _contrast_stops(luminance: np.ndarray) -> float:
    bright = luminance[luminance > 0]
    return float(np.log2(np.quantile(bright, 0.9) / max(float(np.quantile(bright, 0.1)), 1e-30)))


def _blank(luminance: np.ndarray, data: np.ndarray) -> float:
    """Return the share of the sphere without data, black, or in nearly black rows that reach a pole."""
    rows = luminance.shape[0]
    even = luminance.max(axis=1) <= 1e-3 * np.median(luminance[luminance > 0])
    reach = np.zeros(rows, bool)
    # A row or two at a pole are even in any panorama.
    for order in (np.arange(rows), np.arange(rows)[::-1]):
        run = int(np.argmin(even[order])) if not even.all() else rows
        if run > rows // 32:
            reach[order[:run]] = True
    dark = (luminance <= 0) | ~data | reach[:, None]
    weight = np.cos((0.5 - (np.arange(rows) + 0.5) / rows) * math.pi)
    return float((dark.mean(axis=1) * weight).sum() / weight.sum())
