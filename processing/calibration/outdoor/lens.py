"""Fisheye lenses: how the angle from the axis becomes a place in the picture; calibrated or by the textbook.

r is in radii of the image circle throughout; the mappings themselves are `processing.sphere.geometry`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from processing.calibration.outdoor.image_circle import ImageCircle, find_image_circle
from processing.errors import LensError
from processing.ground.arrays import Doubles
from processing.sphere import Fisheye, LensMapping
from processing.sphere.geometry import polar_of_radius, radius_of_polar

__all__ = ["ImageCircle", "LensModel", "MappingFit", "find_image_circle", "fit_mapping"]


@dataclass(frozen=True)
class LensModel:
    """A lens on a camera: its mapping, its field, and where its image circle lies.

    ``polynomial`` is that of `LensMapping.POLYNOMIAL`: theta / half_field = c1 r + c2 r2 + ..., sum 1, monotone.
    """

    mapping: LensMapping
    circle: ImageCircle
    half_field_rad: float = math.pi / 2
    polynomial: tuple[float, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        self.fisheye()  # which refuses what no lens can be

    def fisheye(self, size_px: tuple[int, int] | None = None, top_azimuth_rad: float = 0.0) -> Fisheye:
        """Return the geometry of this camera's pictures of a size (None: that of the circle)."""
        circle = self.circle if size_px is None else self.circle.scaled(size_px)
        return Fisheye(
            circle.size_px[0],
            circle.size_px[1],
            self.mapping,
            circle.radius_px,
            self.half_field_rad,
            circle.centre_px,
            top_azimuth_rad,
            self.polynomial,
        )

    def angle(self, r: npt.ArrayLike) -> Doubles:
        """Return the angle from the axis (rad) at distances r of 0..1 (radii)."""
        sine, cosine = polar_of_radius(self.fisheye(), np.asarray(r, dtype=np.float64))
        return np.asarray(np.arctan2(sine, cosine))

    def radius(self, theta_rad: npt.ArrayLike) -> Doubles:
        """Return r (radii) of angles from the axis, 0..half_field: the inverse of `angle`; beyond, 1."""
        theta = np.asarray(theta_rad, dtype=np.float64)
        return radius_of_polar(self.fisheye(), np.sin(theta), np.cos(theta))[0]


@dataclass(frozen=True)
class MappingFit:
    """A mapping found from known directions."""

    lens: LensModel
    rms_rad: float
    """Root mean square of what remains, in angle from the axis."""
    count: int


def fit_mapping(
    points_px: npt.ArrayLike, directions: npt.ArrayLike, circle: ImageCircle, *, terms: int = 4, centre: bool = True
) -> MappingFit:
    """Fit the polynomial mapping to points (N, 2) whose directions (N, 3) are known, z along the lens's axis.

    Stars, or markers on a known frame. ``centre``: the axis' place in the picture is found too, else it is the circle's
    centre. The radius stays the circle's; the field that belongs to it is a result. Raises `LensError` for too few
    points, points that do not reach 0.7 of the radius, or a fit that is not monotone.
    """
    from scipy.optimize import least_squares

    points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
    ways = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
    if len(points) != len(ways) or len(points) < terms + 4:
        raise LensError(f"{len(points)} points for {terms} terms and a centre", advice="give more stars or markers")
    theta = np.arctan2(np.hypot(ways[:, 0], ways[:, 1]), ways[:, 2])
    reach = np.hypot(*(points - circle.centre_px).T) / circle.radius_px
    if reach.max() < 0.7:
        raise LensError(f"the points reach {reach.max():.2f} of the radius", advice="add points near the edge")

    def residuals(unknown: Doubles) -> Doubles:
        moved = points - circle.centre_px - (unknown[:2] if centre else 0.0)
        r = np.hypot(moved[:, 0], moved[:, 1]) / circle.radius_px
        return np.asarray(np.polynomial.polynomial.polyval(r, np.concatenate([[0.0], unknown[2:]])) - theta)

    powers = reach[:, None] ** np.arange(1, terms + 1)
    start = np.concatenate([[0.0, 0.0], np.linalg.lstsq(powers, theta, rcond=None)[0]])
    found = least_squares(residuals, start, loss="soft_l1", f_scale=5e-3, x_scale=(1.0, 1.0, *[0.01] * terms))
    angles = found.x[2:]
    half_field = float(angles.sum())
    dx, dy = found.x[:2] if centre else (0.0, 0.0)
    moved = replace(circle, centre_px=(circle.centre_px[0] + float(dx), circle.centre_px[1] + float(dy)))
    polynomial = tuple(float(a) / half_field for a in angles)
    lens = LensModel(LensMapping.POLYNOMIAL, moved, half_field, polynomial, "fitted to known directions")
    return MappingFit(lens, float(np.sqrt(np.mean(residuals(found.x) ** 2))), len(points))
