"""How a patch of sun differs from its surface in the shade: by brightness, hardly by colour. Furniture does by both."""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

import numpy as np
import numpy.typing as npt


LEAST_RATIO = 1.8
"""Of sunlit to shaded luminance of one surface, below which it is no direct sun."""
RED_IN_SUN, BLUE_IN_SUN = (-0.25, 1.0), (-2.5, 0.3)
"""Natural logarithms of red and blue over green, against the surface in the shade: a low sun is warmer than the sky."""


def coloured_as_behind(rgb: Floats, plane: npt.NDArray[np.int16], places: Flags, hidden: Flags) -> Flags:
    """Return those of the ``places`` (H, W) that have the colour of the plane behind, or that in warm sunlight.

    ``rgb`` (H, W, 3) is linear light, ``plane`` (H, W) numbers the room's planes; a plane's colour is that of what
    nothing has ``hidden``.
    """
    told = np.zeros_like(places)
    logs = np.log(np.maximum(rgb, 1e-6))
    red, blue = logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]
    for index in np.unique(plane[places]):
        known = (plane == index) & ~hidden & (rgb > 0).all(axis=-1)
        here = places & (plane == index)
        if not known.any():
            continue
        redder, bluer = red[here] - np.median(red[known]), blue[here] - np.median(blue[known])
        warm = (redder > RED_IN_SUN[0]) & (redder < RED_IN_SUN[1])
        told[here] = warm & (bluer > BLUE_IN_SUN[0]) & (bluer < BLUE_IN_SUN[1])
    return told
