"""Veiling glare: light that the lens scatters over the whole picture, estimated where there can be none.

No bracket removes it (McCann and Rizzi 2007). Outside a fisheye's image circle no ray of the scene arrives: what is
there is scattered in the lens and the body. Indoors the darkest place of the picture bounds it from above. The figure
is that of ISO 9358: veil over the mean luminance of the field. The correction takes the veil as uniform.
"""

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from processing.errors import LensError, ParameterError
from processing.ground.arrays import Bytes, Floats, Rgb
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2

Picture = TypeVar("Picture", RelativeImage, LuminanceImage)

RIM_GAP = 1.06  # in radii: nearer to the image circle the lens's own blur and its bright rim reach out
MIN_SURROUND_PX = 400  # chosen
MAX_DARK_SHARE = 0.25
"""Of the surround: where more of it is too dark to measure, what is left are the brightest by chance, not the veil."""
_DARKEST_SHARE = 0.001  # of the field; chosen
_MAD_SIGMA = 1.4826  # of a normal distribution: 1 / quantile(0.75)


@dataclass(frozen=True)
class GlareEstimate:
    """A veil in a picture's own units, and what it is worth."""

    veil_rgb: Rgb
    uncertainty: float
    """Standard uncertainty of the veil's luminance, relative to it: how uneven it is over the places it was read in."""
    index: float
    """Luminance of the veil over the mean luminance of the field (veiling glare index, ISO 9358), 0 to 1."""
    upper_bound: bool
    """The true veil may be anything from 0 to this (estimated from a dark place inside the scene)."""
    n_pixels: int


def veil_from_surround(rgb: Floats, validity: Bytes, centre_px: tuple[float, float], radius_px: float) -> GlareEstimate:
    """Return the veil from the frame around the image circle of an uncropped fisheye picture (H, W, 3), linear.

    ``validity``: clipped pixels of the surround are left out. Dark ones count with their values, so that the median is
    not of the bright ones alone. Raises `LensError` where less than 400 pixels are valid, which is no surround, and
    where more than a quarter is dark: then the veil is less than the longest frame shows.
    """
    height, width = validity.shape
    radius = np.hypot(np.arange(width)[None] + 0.5 - centre_px[0], np.arange(height)[:, None] + 0.5 - centre_px[1])
    surround = (radius > RIM_GAP * radius_px) & (validity != Validity.CLIPPED)
    usable = surround & (validity != Validity.DARK)
    inside = radius < radius_px
    if int(usable.sum()) < MIN_SURROUND_PX or not inside.any():
        raise LensError(
            f"{int(usable.sum())} usable pixels around the image circle; {MIN_SURROUND_PX} are needed",
            likely="a cropped picture, or stops too short to see the surround",
            advice="give the uncropped frames, or the veil itself",
        )
    dark = 1 - float(usable.sum()) / float(surround.sum())
    if dark > MAX_DARK_SHARE:
        raise LensError(
            f"{100 * dark:.0f} % of the surround of the image circle is too dark to measure",
            likely="a veil weaker than the longest frame shows",
            advice="add a longer frame, or leave the veil on",
        )
    return _estimate(rgb[surround], float(luminance_cd_m2(rgb[inside]).mean(dtype=np.float64)), upper_bound=False)


def veil_bound_from_darkest(image: LuminanceImage) -> GlareEstimate:
    """Return an upper bound of the veil: the mean of the darkest thousandth of what the picture shows.

    Valid and dark pixels count. Raises `LensError` for a picture in which nothing is valid.
    """
    usable = (image.validity == Validity.VALID) | (image.validity == Validity.DARK)
    if not usable.any():
        raise LensError("the picture has no valid pixels")
    luminance = luminance_cd_m2(image.rgb)
    if not np.isfinite(luminance.sum(dtype=np.float64)):
        raise ParameterError("the picture holds values that light cannot have (not finite)")
    count = max(1, int(_DARKEST_SHARE * int(usable.sum())))
    limit = np.partition(luminance[usable], count - 1)[count - 1]
    darkest = usable & (luminance <= limit)
    return _estimate(image.rgb[darkest], float(luminance[usable].mean(dtype=np.float64)), upper_bound=True)


def _estimate(samples: Floats, field: float, *, upper_bound: bool) -> GlareEstimate:
    """Return the channels' medians; their spread as uncertainty, for a veil is not quite uniform."""
    veil = np.median(samples.astype(np.float64), axis=0)
    values = luminance_cd_m2(samples)
    middle = float(np.median(values))
    spread = _MAD_SIGMA * float(np.median(np.abs(values - middle)))
    red, green, blue = (float(value) for value in veil)
    if not min(red, green, blue, field) >= 0:
        raise ParameterError("the picture holds values that light cannot have (negative)")
    return GlareEstimate(
        veil_rgb=(red, green, blue),
        uncertainty=spread / middle if middle > 0 else 0.0,
        index=min(1.0, middle / field) if field > 0 else 0.0,
        upper_bound=upper_bound,
        n_pixels=int(samples.shape[0]),
    )


def subtract_veil(image: Picture, glare: GlareEstimate) -> Picture:
    """Return the picture without a uniform veil; its doubt goes into each pixel's uncertainty.

    What falls to 0 or below becomes 0, `Validity.DARK`, with infinite uncertainty. Pixels outside the field stay.
    Raises `ParameterError` for an upper bound, which is not a value to subtract, and for a negative veil. The picture's
    arrays keep their shape and unit.
    """
    if glare.upper_bound:
        raise ParameterError("an upper bound of the veil cannot be subtracted", advice="estimate it from the surround")
    if min(glare.veil_rgb) < 0 or not math.isfinite(sum(glare.veil_rgb)):
        raise ParameterError(f"a veil is finite and not negative, not {glare.veil_rgb}")
    veil = np.array(glare.veil_rgb, dtype=np.float32)
    inside = image.validity != Validity.OUTSIDE
    rgb = np.where(inside[..., None], np.maximum(image.rgb - veil, np.float32(0)), image.rgb)
    before, after = luminance_cd_m2(image.rgb), luminance_cd_m2(rgb)
    veil_sigma = float(luminance_cd_m2(veil)) * glare.uncertainty
    lit = inside & (after > 0)
    own = np.multiply(before, image.uncertainty, out=np.zeros_like(before), where=lit)
    sigma = np.hypot(own, veil_sigma)
    known = np.divide(sigma, after, out=np.full_like(after, np.inf), where=lit)
    uncertainty = np.where(inside, known, image.uncertainty).astype(np.float32)
    dark = inside & ~lit & (image.validity != Validity.CLIPPED)
    validity = np.where(dark, np.uint8(Validity.DARK), image.validity).astype(np.uint8)
    attributes = {**image.attributes, "veil_rgb": list(glare.veil_rgb), "veil_uncertainty": glare.uncertainty}
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, attributes=attributes)
