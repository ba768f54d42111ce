"""The meter's spot in a picture: what lies in a small round part of the sphere, pixel by pixel with its share.

Pixels are taken as what they are, averages over their area: a pixel counts by the part of the spot that it covers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.errors import ScaleError
from processing.ground.arrays import Doubles, Indices
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, Geometry, pixels

SPOT_DIAMETER_RAD = math.radians(1 / 3)
"""Of an LS-160."""
_SAMPLES = 16_384
"""Spread evenly over the spot: an edge across it is then right to 0.1 % of its contrast."""


@dataclass(frozen=True)
class Spot:
    """A round part of the sphere: longitude (right of ahead) and latitude of its middle, and its width; radians."""

    longitude_rad: float
    latitude_rad: float
    diameter_rad: float = SPOT_DIAMETER_RAD

    def direction(self) -> Doubles:
        """Return the unit vector to its middle."""
        flat = math.cos(self.latitude_rad)
        x, y = flat * math.sin(self.longitude_rad), flat * math.cos(self.longitude_rad)
        return np.array((x, y, math.sin(self.latitude_rad)))


@dataclass(frozen=True)
class SpotPixels:
    """The pixels that a spot touches, and the share of the spot that each covers (sum 1)."""

    row: Indices
    column: Indices
    share: Doubles

    def mean(self, plane: npt.NDArray[np.generic]) -> float:
        """Return the mean of a plane (H, W) over the spot."""
        return float(np.asarray(plane[self.row, self.column], dtype=np.float64) @ self.share)

    @property
    def n_effective(self) -> float:
        """Return how many whole pixels carry the mean."""
        return float(1 / np.sum(self.share**2))


def spot_pixels(geometry: Geometry, spot: Spot) -> SpotPixels:
    """Return the pixels of a spot.

    Raises
    ------
    ScaleError
        Part of the spot lies outside the picture.
    """
    x, y, seen = pixels(geometry, _spread(spot.direction(), spot.diameter_rad / 2))
    if not np.all(seen):
        raise ScaleError(
            f"the meter's spot at {_named(spot)} is outside the picture",
            likely="a target for another camera",
            advice="give the target's direction: longitude right of the picture's middle, latitude up",
        )
    column, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    wide, high = geometry.width_px, geometry.height_px
    column = column % wide if isinstance(geometry, Equirectangular) else np.clip(column, 0, wide - 1)
    place, count = np.unique(np.clip(row, 0, high - 1) * wide + column, return_counts=True)
    return SpotPixels(place // wide, place % wide, count / count.sum())


def spot_luminance(image: RelativeImage, spot: Spot) -> float:
    """Return the mean luminance of a spot in the picture's own scale."""
    found = spot_pixels(image.geometry, spot)
    return float(luminance_cd_m2(image.rgb[found.row, found.column]) @ found.share)


def shares(image: RelativeImage, found: SpotPixels) -> dict[Validity, float]:
    """Return what share of a spot has each validity."""
    validity = image.validity[found.row, found.column]
    return {kind: float(found.share[validity == kind].sum()) for kind in Validity}


def moved(spot: Spot, angle_rad: float, count: int = 8) -> list[Spot]:
    """Return ``count`` spots around one, ``angle_rad`` away in evenly spaced ways."""
    out = []
    centre, side, up = _frame(spot.direction())
    for turn in np.arange(count) * (2 * math.pi / count):
        way = math.cos(angle_rad) * centre + math.sin(angle_rad) * (math.cos(turn) * side + math.sin(turn) * up)
        out.append(Spot(math.atan2(way[0], way[1]), math.asin(float(np.clip(way[2], -1, 1))), spot.diameter_rad))
    return out


def _named(spot: Spot) -> str:
    return f"longitude {math.degrees(spot.longitude_rad):.2f}, latitude {math.degrees(spot.latitude_rad):.2f} degrees"


def _frame(centre: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return three vectors at right angles, the first the one given."""
    pole = np.array((0.0, 0.0, 1.0)) if abs(centre[2]) < 0.9 else np.array((0.0, 1.0, 0.0))
    side = np.cross(centre, pole)
    side /= np.linalg.norm(side)
    return centre, side, np.cross(side, centre)


def _spread(centre: Doubles, radius_rad: float) -> Doubles:
    """Return directions (n, 3), each for the same solid angle of a disc (a sunflower: golden-angle spiral)."""
    middle, side, up = _frame(centre)
    # Equal steps of 1 - cos(angle) are equal solid angles.
    drop = (1 - math.cos(radius_rad)) * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    off = np.sqrt(drop * (2 - drop))[:, None]
    turn = (np.arange(_SAMPLES) * (math.pi * (3 - math.sqrt(5))))[:, None]
    return np.asarray((1 - drop)[:, None] * middle + off * (np.cos(turn) * side + np.sin(turn) * up))
