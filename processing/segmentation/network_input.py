"""What the compact network is shown: a small tone-mapped copy of a panorama. Training makes its pictures with it.

The exposure is taken from the picture itself and the curve has no white point, so that a calibrated picture with the
sun in it and an ordinary JPEG of the same room look alike to the network.
"""

from __future__ import annotations

from processing.ground.arrays import Floats

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.images import LUMINANCE_WEIGHTS


WIDTH_PX, HEIGHT_PX = 256, 128
MIDDLE = 0.18
"""To which the picture's median luminance is scaled."""
BRIGHTEST = 12.0
"""Scaled values are cut here before pixels are averaged: the sun may fill one pixel of the copy, not its neighbours."""
_KNEE = 0.35
_SAMPLES_PX = 512
_BAND_ROWS = 256


def network_picture(rgb: npt.ArrayLike) -> Floats:
    """Return the network's view (128, 256, 3), 0..1, of an equirectangular picture (H, W, 3) of linear RGB.

    A black picture stays black. The result does not depend on the picture's scale.

    Raises
    ------
    ParameterError
        Values that are not finite or below 0, another shape, fewer than 8 x 4 pixels.
    """
    picture = np.asarray(rgb)
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.shape[0] < 4 or picture.shape[1] < 8:
        raise ParameterError(
            f"a picture of shape {picture.shape} for the room network", advice="give (H, W, 3), 8 x 4 pixels or more"
        )
    gain = exposure(picture)
    wide = picture.shape[1] >= WIDTH_PX and picture.shape[0] >= HEIGHT_PX
    bands = []
    for start in range(0, picture.shape[0], _BAND_ROWS):
        band = _scaled(picture[start : start + _BAND_ROWS], gain, start)
        # Means over an area are means over rows of means over columns: no scaled copy of the whole picture is needed.
        if wide:
            band = np.asarray(cv2.resize(band, (WIDTH_PX, len(band)), interpolation=cv2.INTER_AREA), np.float32)
        bands.append(band)
    joined = np.concatenate(bands)
    if wide:
        return curve(np.asarray(cv2.resize(joined, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA), np.float32))
    return curve(_enlarged(joined))


def _scaled(band: npt.NDArray[np.floating], gain: float, first_row: int) -> Floats:
    """Return values times the gain, cut at `BRIGHTEST`."""
    lowest, highest = band.min(), band.max()
    if not (lowest >= 0 and highest < np.inf):
        raise ParameterError(
            f"values that light cannot have in rows {first_row} to {first_row + len(band) - 1}",
            advice="replace NaN, infinite and negative pixels; mark them invalid instead",
        )
    exact = 1e-30 < gain < 1e30 and band.dtype == np.float32
    factor = np.float32(gain) if exact else np.float64(gain)
    with np.errstate(over="ignore"):
        return np.asarray(np.minimum(band * factor, BRIGHTEST), dtype=np.float32)


def exposure(picture: npt.NDArray[np.floating]) -> float:
    """Return the factor that brings the median luminance (of what is not black, by solid angle) to ``MIDDLE``, or 0."""
    step = max(1, picture.shape[1] // _SAMPLES_PX)
    few = np.asarray(picture[step // 2 :: step, step // 2 :: step], dtype=np.float64)
    luminance = few @ np.array(LUMINANCE_WEIGHTS)
    latitude = (0.5 - (np.arange(luminance.shape[0]) + 0.5) / luminance.shape[0]) * np.pi
    weight = np.broadcast_to(np.cos(latitude)[:, None], luminance.shape)
    lit = np.isfinite(luminance) & (luminance > 0)
    if not lit.any():
        return 0.0
    order = np.argsort(luminance[lit], kind="stable")
    total = np.cumsum(weight[lit][order])
    median = luminance[lit][order][int(np.searchsorted(total, total[-1] / 2))]
    return float(min(MIDDLE / median, 1e300))


def curve(scaled: Floats) -> Floats:
    """Return what is shown for scaled values >= 0: rising, below 1, without a white point."""
    return np.sqrt(scaled / (scaled + np.float32(_KNEE)))


def _enlarged(scaled: Floats) -> Floats:
    """Return a picture smaller than the copy at the copy's size, linear between its pixels' middles."""
    height, width = scaled.shape[:2]
    pad = width // 2
    around = np.concatenate([scaled[:, -pad:], scaled, scaled[:, :pad]], axis=1)
    x = ((np.arange(WIDTH_PX) + 0.5) * width / WIDTH_PX - 0.5 + pad).astype(np.float32)
    y = ((np.arange(HEIGHT_PX) + 0.5) * height / HEIGHT_PX - 0.5).astype(np.float32)
    grid_x, grid_y = np.meshgrid(x, y)
    drawn = cv2.remap(around, grid_x, grid_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(drawn, dtype=np.float32)
