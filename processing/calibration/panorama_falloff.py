"""Fall-off in a stitched panorama: that of the two fisheyes it was made of, which look ahead and back."""

from __future__ import annotations

from processing.ground.arrays import Floats

from dataclasses import replace

import numpy as np

from processing.calibration.vignetting import Vignetting
from processing.images import RelativeImage
from processing.sphere import Equirectangular


def panorama_falloff(geometry: Equirectangular, vignetting: Vignetting) -> Floats:
    """Return V for each pixel (H, W) of a panorama whose middle column lies on the front lens's axis.

    Each lens serves the half in front of it. r = 1 at the stitch, 90 degrees from the axis; in an equisolid picture r
    is sin(theta / 2) / sin(45 degrees), with ``in_angle`` theta / 90 degrees.
    """
    longitude = ((np.arange(geometry.width_px) + 0.5) / geometry.width_px - 0.5) * (2 * np.pi)
    latitude = (0.5 - (np.arange(geometry.height_px) + 0.5) / geometry.height_px) * np.pi
    knots = np.linspace(0, 1, 4097)  # of the cosine to the axis, of which V is a smooth enough function
    r = np.arccos(knots) / (np.pi / 2) if vignetting.in_angle else np.sqrt(1 - knots)
    values = vignetting.evaluate(r)
    cosine = np.abs(np.cos(longitude)).astype(np.float32)
    out = np.empty((geometry.height_px, geometry.width_px), dtype=np.float32)
    for row, flat in enumerate(np.cos(latitude)):
        out[row] = np.interp(cosine * np.float32(flat), knots, values)
    return out


def correct_panorama(image: RelativeImage, vignetting: Vignetting) -> RelativeImage:
    """Return the panorama as lenses without fall-off would have given it; the correction's doubt is added."""
    assert isinstance(image.geometry, Equirectangular)
    rgb = image.rgb / panorama_falloff(image.geometry, vignetting)[..., None]
    uncertainty = np.hypot(image.uncertainty, np.float32(vignetting.relative_uncertainty)).astype(np.float32)
    return replace(image, rgb=np.asarray(rgb, dtype=np.float32), uncertainty=uncertainty)
