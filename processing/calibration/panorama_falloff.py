"""Fall-off of a panorama stitched from two fisheyes, one looking ahead (+y of the camera), one back.

Each point is seen by the fisheye it is nearer to; r is the equisolid image height, 1 at the stitch: an angle a from the
axis gives sin(a / 2) / sin(45 degrees).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from processing.calibration.vignetting import Vignetting
from processing.errors import LensError
from processing.images import Floats, RelativeImage
from processing.sphere import Equirectangular


def panorama_falloff(geometry: Equirectangular, vignetting: Vignetting) -> Floats:
    """Return the fall-off (H, W), 1 in the middle of each fisheye."""
    longitude = ((np.arange(geometry.width_px) + 0.5) / geometry.width_px - 0.5) * (2 * np.pi)
    latitude = (0.5 - (np.arange(geometry.height_px) + 0.5) / geometry.height_px) * np.pi
    cos_axis = np.abs(np.cos(latitude)[:, None] * np.cos(longitude)[None, :])
    knots = np.linspace(0, 1, 2049)
    angle = 2 * np.arcsin(knots * np.sin(np.pi / 4))
    values = vignetting.evaluate(angle / (np.pi / 2) if vignetting.in_angle else knots)
    return np.interp(np.sqrt(1 - cos_axis), knots, values).astype(np.float32)


def correct_panorama(image: RelativeImage, vignetting: Vignetting | None) -> RelativeImage:
    """Return the panorama divided by its fisheyes' fall-off, whose uncertainty is added; itself for None.

    Raises
    ------
    LensError
        The picture is no panorama as the camera stitched it.
    """
    if vignetting is None:
        return image
    if not isinstance(image.geometry, Equirectangular):
        raise LensError("the fall-off of two fisheyes belongs to an equirectangular picture")
    rgb = image.rgb / panorama_falloff(image.geometry, vignetting)[..., None]
    sigma = np.float32(vignetting.relative_uncertainty)
    return replace(image, rgb=rgb, uncertainty=np.hypot(image.uncertainty, sigma) if sigma else image.uncertainty)
