"""The emptied panorama with the room's own sunlight in its place: what materials and furniture are lit by."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from processing.ground.arrays import Flags
from processing.pictures.images import LuminanceImage

SUN_RIM_RAD, FURNITURE_RIM_RAD = math.radians(1.5), math.radians(0.8)
"""By which sunlight stands again beyond its mask, and keeps away from what stood there (chosen: removal fills over the
masks' edges, half shadow beside the sun and rims of furniture)."""


@dataclass(frozen=True)
class EmptyRoom:
    """The panorama without furniture, its own sunlight in its place."""

    image: LuminanceImage
    filled: Flags | None = None
    """(H, W): what removal made up; None where nothing was removed."""
    sunless: Flags | None = None
    """(H, W): what is shown without the direct sun that may fall there."""


def with_sunlight(
    empty: LuminanceImage, before: LuminanceImage, filled: Flags, sunlight: Flags, hidden: Flags
) -> EmptyRoom:
    """Return the emptied panorama with the direct sunlight that removal took away, where nothing hid it.

    The sun's patch lights the room, and furniture is put into the room as it was photographed. ``before``: the
    photograph; ``filled``, ``sunlight``, ``hidden``: (H, W), what removal filled, direct sunlight, and what stood in
    the way (furniture, tripod, shadows).
    """
    back = _grown(sunlight, SUN_RIM_RAD) & ~_grown(hidden, FURNITURE_RIM_RAD)
    image = replace(
        empty,
        rgb=np.where(back[..., None], before.rgb, empty.rgb),
        validity=np.where(back, before.validity, empty.validity),
        uncertainty=np.where(back, before.uncertainty, empty.uncertainty),
    )
    return EmptyRoom(image, filled & ~back, filled & ~back)


def _grown(mask: Flags, by_rad: float) -> Flags:
    """Return a mask of a panorama grown on all sides; columns wrap."""
    radius = round(by_rad / math.pi * mask.shape[0])
    if radius == 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    wide = np.pad(mask.astype(np.uint8), ((0, 0), (radius, radius)), mode="wrap")
    return np.asarray(cv2.dilate(wide, disc)[:, radius:-radius] > 0)
