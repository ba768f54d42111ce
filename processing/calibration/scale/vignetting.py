"""Fall-off of light towards the edge of a lens's field: a radial polynomial, given, or fitted to pictures.

Paper, section 3, step (1); Inanici 2006. V(r) = 1 + sum c_i r^p_i; a picture is divided by V to correct it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import LensError
from processing.ground.arrays import Doubles, Floats, Indices
from processing.ground.tables import table_of
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, Fisheye
from processing.sphere.geometry import polar_of_radius

EVEN_POWERS = (2, 4, 6, 8)
"""Of r, what fits take: a symmetric lens's fall-off is smooth in the middle, which is off by 1 % without the 8th."""
COPY_SIGMA = 0.01
"""Relative, at the rim, of a published fall-off for another copy of the lens; chosen: none's spread is published."""
TURNED_SIGMA = 0.005
"""Relative, at the rim, of a fall-off by turned pictures, beside their scatter: of twelve hostile rigs (validation)."""
_LEAST, _MOST = 0.02, 4.0  # chosen: no lens falls or rises so far
_MIN_SAMPLES = 50  # chosen: ten times the unknowns
RINGS = 200  # of a flat field, all of one area; chosen


@dataclass(frozen=True)
class Vignetting:
    """A radial fall-off; r is the distance in the picture in radii of the image circle, or with ``in_angle`` the angle
    from the axis over half the field."""

    powers: tuple[int, ...]
    coefficients: tuple[float, ...]
    relative_uncertainty: float = 0.0
    """Standard uncertainty of V, relative, at the rim; a fit's is nowhere above it."""
    f_number: float | None = None
    in_angle: bool = False
    source: str = ""

    def __post_init__(self) -> None:
        if len(self.powers) != len(self.coefficients) or any(p < 0 for p in self.powers):
            raise LensError("vignetting: as many coefficients as powers, and no negative power")
        values = self.evaluate(np.linspace(0, 1, 257))
        if not (np.isfinite(values).all() and values.min() > _LEAST and values.max() < _MOST):
            text = f"vignetting between {values.min():.3g} and {values.max():.3g} inside the field"
            likely = "coefficients of another radius unit, or a fit that runs away"
            raise LensError(text, likely=likely, advice="r is 1 at the edge of the image circle")

    def evaluate(self, r: npt.ArrayLike) -> Doubles:
        """Return V at r (radii); r beyond 1 counts as 1. Both of any one shape; V is 1 on the axis."""
        r = np.clip(np.asarray(r, dtype=np.float64), 0, 1)
        total = np.ones_like(r)
        for power, coefficient in zip(self.powers, self.coefficients, strict=True):
            total += coefficient * r**power
        return total

    def map(self, geometry: Fisheye) -> Floats:
        """Return V for each pixel (H, W) of a fisheye picture."""
        r = np.hypot(*geometry.offsets_px()) / geometry.radius_px
        # A fine table is right to 1e-7 and ten times cheaper than powers or angles of every pixel.
        knots = np.linspace(0, 1, 2049)
        # Of the field's half: the angle from the axis at these distances.
        share = np.arctan2(*polar_of_radius(geometry, knots)) / geometry.half_field_rad if self.in_angle else knots
        return np.asarray(np.interp(r, knots, self.evaluate(share)), dtype=np.float32)

    def correct(self, rgb: Floats, geometry: Fisheye) -> Floats:
        """Return the picture (H, W, 3) as a lens without fall-off would have given it."""
        return np.asarray(rgb / self.map(geometry)[..., None], dtype=np.float32)


def published_vignetting(name: str) -> Vignetting:
    """Return a published fall-off: canon_8mm_f5_6, canon_8mm_f8, canon_8mm_f11 or theta_z1 (`lens_data.toml`)."""
    known = table_of("processing.calibration", "lens_data")["vignetting"]
    if name not in known:
        raise LensError(f"no such published vignetting data: {name!r}", advice=f"one of {', '.join(known)}")
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in known[name].items()}
    return Vignetting(**values, relative_uncertainty=COPY_SIGMA)


def fit_flat(frames: Sequence[Floats], geometry: Fisheye, *, powers: tuple[int, ...] = EVEN_POWERS) -> Vignetting:
    """Fit the fall-off to linear pictures (H, W, 3) of an evenly lit field (an integrating sphere, a diffuser).

    Medians of rings of equal area, so that dust and noise do not count; each frame has a brightness of its own.
    """
    r = np.hypot(*geometry.offsets_px()) / geometry.radius_px
    ring = np.minimum((r * r * RINGS).astype(int), RINGS)
    order = np.argsort(ring, axis=None, kind="stable")
    edges = np.searchsorted(ring.ravel()[order], np.arange(RINGS + 1))
    rows, scene, level = [], [], []
    for number, frame in enumerate(frames):
        values = luminance_cd_m2(frame).ravel()[order]
        for first, last in pairwise(edges):
            if last > first and (middle := float(np.median(values[first:last]))) > 0 and np.isfinite(middle):
                rows.append(float(np.sqrt(np.mean(r.ravel()[order[first:last]] ** 2))))
                level.append(np.log(middle))
                scene.append(number)
    return _solve(np.array(rows), np.array(level), np.array(scene, dtype=int), powers, "fitted to a flat field")


def _solve(r: Doubles, level: Doubles, scene: Indices, powers: tuple[int, ...], source: str) -> Vignetting:
    """Solve log level = log scene[scene] + log V(r), scene by scene free, by reweighted Gauss-Newton."""
    if r.size < _MIN_SAMPLES:
        raise LensError(f"{r.size} usable samples of the vignetting", likely="frames that are dark, or miss the field")
    count = np.maximum(np.bincount(scene), 1)
    basis = r[:, None] ** np.array(powers, dtype=np.float64)
    found, weights = np.zeros(len(powers)), np.ones_like(r)
    off, spread = level, np.inf
    for _ in range(30):
        v = np.maximum(1 + basis @ found, 0.05)
        slopes = _centred(basis / v[:, None], scene, count)
        off = _centred((level - np.log(v))[:, None], scene, count)[:, 0]
        spread = max(1.4826 * float(np.median(np.abs(off))), 1e-6)
        weights = 1 / (1 + (off / (3 * spread)) ** 2)
        normal = slopes.T @ (slopes * weights[:, None]) / r.size
        if np.linalg.eigvalsh(normal)[0] < 1e-7:
            text = "the frames do not separate the vignetting from the scene"
            advice = "turn it by a right angle between the pictures, or photograph a flat field"
            raise LensError(text, likely="the camera was turned about its lens's axis, or not turned", advice=advice)
        step = np.linalg.solve(normal, slopes.T @ (weights * off) / r.size)
        found = found + step
        if np.abs(step).max() < 1e-9:
            break
    covariance = np.linalg.inv(normal) * spread**2 / r.size
    knots = np.linspace(0, 1, 33)[:, None] ** np.array(powers, dtype=np.float64)
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", knots, covariance, knots)) / np.maximum(1 + knots @ found, 0.05)
    return Vignetting(powers, tuple(map(float, found)), float(sigma.max()), source=source)


def _centred(values: Doubles, scene: Indices, count: Indices) -> Doubles:
    """Return values (n, k) less the mean of their scene point: which eliminates the scene."""
    means = np.stack([np.bincount(scene, column) / count for column in values.T], axis=-1)
    return np.asarray(values - means[scene])


# Fall-off in a stitched panorama: that of the two fisheyes it was made of, which look ahead and back.


_ROWS, _PARTS = 90, 8  # cells of 2 degrees, and parts of each by which turns are found; chosen
_EVEN_FRAC = 0.1  # of a cell, that it may vary; chosen: what is left out are edges
_LEAST_ALIKE = 0.9  # correlation; chosen: a simulated room's pictures have 0.99, of two alike 0.90 at most


def fit_turned(pictures: Sequence[RelativeImage]) -> Vignetting:
    """Fit a panorama camera's fall-off to pictures of one room, between which it was turned about its upright axis.

    A direction shows the same light in all, farther from a lens's axis in some. Each has a brightness of its own; how
    far the camera was turned is found. Raises `LensError`: by 0 or 180 degrees, or the pictures are of several rooms.
    """
    latitude, longitude = (((np.arange(n) + 0.5) / n - 0.5) * np.pi for n in (_ROWS, 2 * _ROWS * _PARTS))
    places = np.sqrt(1 - np.abs(np.cos(latitude)[:, None] * np.cos(2 * longitude)))
    samples, start = [], None
    for picture in pictures:
        light = luminance_cd_m2(picture.rgb) * (picture.validity == Validity.VALID)
        fine = np.maximum(cv2.resize(light, places.shape[::-1], interpolation=cv2.INTER_AREA), 1e-20)
        # The turn after which the pictures are most alike
        shape = (np.log(fine) - np.log(fine).mean(axis=1, keepdims=True)) * np.cos(latitude)[:, None]
        waves = np.fft.rfft(shape / max(float(np.linalg.norm(shape)), 1e-20), axis=1)
        start = waves if start is None else start
        alike = np.fft.irfft((start * waves.conj()).sum(axis=0))
        if alike.max() < _LEAST_ALIKE:
            raise LensError("the pictures do not show one room from one place", advice="only turn the camera")
        turn = int(np.argmax(alike))
        cells, r = (np.roll(one, turn, axis=1).reshape(-1, _PARTS) for one in (fine, places))
        samples.append((r.mean(axis=1), np.log(cells.mean(axis=1)), cells.std(axis=1) / cells.mean(axis=1)))
    r, level, uneven = np.moveaxis(np.array(samples), 1, 0)
    use = np.flatnonzero(uneven.max(axis=0) < _EVEN_FRAC)
    # Where two lenses change places, each stands in as often for the other.
    level = level[:, use] - np.median(level[:, use] - level[0, use], axis=1, keepdims=True)
    scene = np.tile(np.arange(use.size), len(level))
    found = _solve(r[:, use].ravel(), level.ravel(), scene, EVEN_POWERS, "fitted to a room, the camera turned")
    return replace(found, relative_uncertainty=float(np.hypot(found.relative_uncertainty, TURNED_SIGMA)))


def correct_panorama(image: RelativeImage, vignetting: Vignetting) -> RelativeImage:
    """Return the panorama as lenses without fall-off would have given it; the correction's doubt is added."""
    assert isinstance(image.geometry, Equirectangular)
    # V for each pixel (H, W) of a panorama whose middle column lies on the front lens's axis. Each lens serves the
    # half in front of it. r = 1 at the stitch, 90 degrees from the axis; in an equisolid picture r is sin(theta / 2)
    # / sin(45 degrees), with ``in_angle`` theta / 90 degrees.
    longitude = ((np.arange(image.geometry.width_px) + 0.5) / image.geometry.width_px - 0.5) * (2 * np.pi)
    latitude = (0.5 - (np.arange(image.geometry.height_px) + 0.5) / image.geometry.height_px) * np.pi
    knots = np.linspace(0, 1, 4097)  # of the cosine to the axis, of which V is a smooth enough function
    r = np.arccos(knots) / (np.pi / 2) if vignetting.in_angle else np.sqrt(1 - knots)
    values = vignetting.evaluate(r)
    cosine = np.abs(np.cos(longitude)).astype(np.float32)
    rgb, uncertainty = np.empty_like(image.rgb), np.empty_like(image.uncertainty)
    for row, flat in enumerate(np.cos(latitude)):
        towards = cosine * np.float32(flat)
        rgb[row] = image.rgb[row] / np.interp(towards, knots, values).astype(np.float32)[:, None]
        # On the axis nothing falls off; at the stitch the doubt is whole.
        doubt = np.float32(vignetting.relative_uncertainty) * np.sqrt(np.maximum(1 - towards**2, 0))
        uncertainty[row] = np.hypot(image.uncertainty[row], doubt)
    return replace(image, rgb=rgb, uncertainty=uncertainty)
