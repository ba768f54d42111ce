"""Fisheye lenses: how the angle from the axis becomes a place in the picture, and where the image circle lies in it.

r is in radii of the image circle throughout; the mappings themselves are in `processing.sphere.geometry`.

The circle is found from the last fall of light along rays from the picture's middle: on each, every strong fall from
light to dark is a candidate for the edge. A circle is chosen that most rays agree with (Fischler, Bolles 1981), then
fitted to sub-pixel edges by robust least squares. Dark parts of the sky give no edge there, flare outside gives edges
that lie on no circle: both only cost rays.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np

from processing.errors import LensError
from processing.ground.arrays import AnyArray, Doubles, Floats, Indices
from processing.sphere import Fisheye, LensMapping

Circle: TypeAlias = tuple[float, float, float]
"""x and y of the centre, and the radius: pixels, or shares of the picture's width and height."""


@dataclass(frozen=True)
class ImageCircle:
    """Where the field ends in a picture of ``size_px`` (width, height): centre and radius in pixels, sub-pixel."""

    centre_px: tuple[float, float]
    radius_px: float
    size_px: tuple[int, int]
    sigma_px: float = 0.0
    """Standard uncertainty of the radius (and of each coordinate of the centre)."""
    support: float = 1.0
    """Share of the rays on which the edge was seen."""

    def scaled(self, size_px: tuple[int, int]) -> Self:
        """Return the circle in a picture of another size and the same shape."""
        across, down = size_px[0] / self.size_px[0], size_px[1] / self.size_px[1]
        if abs(across / down - 1) > 0.01:
            text = f"a circle of a {self.size_px[0]}x{self.size_px[1]} picture in one of {size_px[0]}x{size_px[1]}"
            likely = "a cropped picture, or another camera"
            raise LensError(text, likely=likely, advice="find the circle in this picture")
        x, y = self.centre_px
        return type(self)(
            (x * across, y * down), self.radius_px * across, size_px, self.sigma_px * across, self.support
        )


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
        (wide, high), at, half = circle.size_px, circle.centre_px, self.half_field_rad
        return Fisheye(wide, high, self.mapping, circle.radius_px, half, at, top_azimuth_rad, self.polynomial)


_COARSE_PX = 640  # pixels of the longer side in which the circle is first looked for
_RAYS, _FINE_RAYS = 360, 1440  # coarse and fine search; chosen
_KEPT_A_RAY = 4  # candidates; chosen
_LEAST_CONTRAST = 0.2  # of an edge; chosen
_FLOOR = 0.02  # of full scale: contrasts below this level are mostly noise
_TRIALS = 600  # random circles; chosen
_LEAST_SHARE = 0.25  # of the rays inside the picture that must agree
_TOLERANCE = 0.012  # of the radius, in the coarse search
_SMALLEST_PX = 400  # the side to which large pictures are reduced; chosen
_MOST_ROUNDS, _SAME_PX = 12, 0.05  # of the fine search; chosen: 0.2 CPU s, a fifth of what edges scatter by


def find_image_circle(frames: AnyArray | Sequence[AnyArray]) -> ImageCircle:
    """Return the image circle of one picture (H, W, 3) or (H, W), or of several of one camera (better: a bracket).

    8- and 16-bit codes or linear values; the picture's middle lies inside the circle. Raises `LensError` where no
    circle is seen: all dark, all bright, or a picture that is lit to its edges.
    """
    import cv2

    pictures = [_grey(f) for f in ([frames] if isinstance(frames, np.ndarray) else frames)]
    if not pictures or any(p.shape != pictures[0].shape for p in pictures):
        raise LensError("frames of different sizes have no common image circle", advice="give frames of one camera")
    height, width = pictures[0].shape
    try:
        return _circle_in(pictures)
    except LensError:
        factor = min(height, width) / _SMALLEST_PX
        if factor < 4:
            raise
    # Stray light in the surround makes the edge flat over some pixels; in smaller pictures it is steep again.
    small = [cv2.resize(p, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA) for p in pictures]
    return _circle_in([np.asarray(p, dtype=np.float32) for p in small]).scaled((width, height))


def _circle_in(pictures: list[Floats]) -> ImageCircle:
    height, width = pictures[0].shape
    x, y, radius = _coarse_circle(pictures)
    # The first round looks farther, others across the edge that is found by then, until it stays.
    for number in range(_MOST_ROUNDS):
        before, reach = (x, y, radius), 0.008 if number else 0.02
        points, weights = _fine_edges(pictures, before, max(4.0, reach * radius))
        x, y, radius, sigma, share = _fit(points, weights, before)
        if number and max(abs(now - then) for now, then in zip((x, y, radius), before, strict=True)) < _SAME_PX:
            break
    return ImageCircle((float(x), float(y)), float(radius), (width, height), float(sigma), float(share))


def _grey(frame: AnyArray) -> Floats:
    """Return a picture (H, W) of 0..1 whose dark parts still differ."""
    picture = np.asarray(frame)
    if picture.ndim not in (2, 3) or min(picture.shape[:2]) < 16:
        raise LensError(f"no picture to find a circle in: shape {picture.shape}")
    grey = picture.astype(np.float32) if picture.ndim == 2 else picture.mean(axis=-1, dtype=np.float32)
    if picture.dtype.kind in "ui":
        return np.asarray(grey / np.float32(np.iinfo(picture.dtype).max))
    grey = np.nan_to_num(grey, nan=0.0, posinf=0.0, neginf=0.0)
    lit = grey[grey > 0]
    # Linear values: the middle of what is lit becomes 0.5, a sun 1.
    return np.asarray(grey / (grey + np.float32(np.median(lit) if lit.size else 1.0)))


def _profiles(picture: Floats, centre: tuple[float, float], radii: Doubles, angles: Doubles) -> Floats:
    """Return the picture along rays (rays, radii), bilinear; -1 outside the picture."""
    import cv2

    ways = np.cos(angles)[:, None] * radii, np.sin(angles)[:, None] * radii
    x, y = ((at + way - 0.5).astype(np.float32) for at, way in zip(centre, ways, strict=True))
    return np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, (-1.0,)))


def _coarse_circle(pictures: list[Floats]) -> Circle:
    """Return centre and radius to about a coarse pixel."""
    import cv2

    height, width = pictures[0].shape
    scale = max(1.0, max(height, width) / _COARSE_PX)
    size = (round(width / scale), round(height / scale))
    small = [np.asarray(cv2.resize(p, size, interpolation=cv2.INTER_AREA), dtype=np.float32) for p in pictures]
    rays, points, weights = (np.concatenate(some) for some in zip(*map(_falls, small), strict=True))
    if len(np.unique(rays)) < _LEAST_SHARE * _RAYS:
        raise _nothing()
    x, y, radius = _agreed(rays, points, weights, size)
    return x * width / size[0], y * height / size[1], radius * width / size[0]


def _falls(picture: Floats) -> tuple[Indices, Doubles, Doubles]:
    """Return ray numbers, points (n, 2) and heights of the strongest falls of light outwards on each ray."""
    height, width = picture.shape
    radii = np.arange(0.15 * min(height, width), 0.75 * max(height, width), dtype=np.float64)
    angles = np.linspace(0, 2 * math.pi, _RAYS, endpoint=False)
    profile = _profiles(picture, (width / 2, height / 2), radii, angles)
    inner, outer = profile[:, :-4], profile[:, 4:]
    # Contrast, not height: dark hedges before a dark surround are an edge as much as the sky above them.
    fall = np.where(outer >= 0, (inner - outer) / (inner + outer + _FLOOR), 0)
    peak = fall[:, 1:-1]
    is_peak = (peak >= fall[:, :-2]) & (peak > fall[:, 2:]) & (peak > _LEAST_CONTRAST)
    ranked = np.where(is_peak, peak, 0)
    order = np.argsort(-ranked, axis=1)[:, :_KEPT_A_RAY]
    ray = np.repeat(np.arange(_RAYS), order.shape[1])
    height_of = np.take_along_axis(ranked, order, axis=1).ravel().astype(np.float64)
    radius = radii[order.ravel() + 3]
    kept = height_of > 0
    angle = angles[ray[kept]]
    points = np.stack([width / 2 + radius[kept] * np.cos(angle), height / 2 + radius[kept] * np.sin(angle)], axis=-1)
    return ray[kept], points, height_of[kept]


def _agreed(rays: Indices, points: Doubles, weights: Doubles, size: tuple[int, int]) -> Circle:
    """Return the circle through three candidates that most rays agree with."""
    rng = np.random.default_rng(1)
    middle, diagonal = (size[0] / 2, size[1] / 2), math.hypot(*size)
    chance = weights / weights.sum()
    best, best_score = (0.0, 0.0, 0.0), 0.0
    for _ in range(_TRIALS):
        circle = _through(points[rng.choice(len(points), 3, replace=False, p=chance)])
        # As the tolerance grows with the radius, a circle as large as a field would agree with everything.
        if circle is None or circle[2] > diagonal or math.dist(circle[:2], middle) > circle[2]:
            continue
        off = np.abs(np.hypot(points[:, 0] - circle[0], points[:, 1] - circle[1]) - circle[2])
        near = off < max(1.0, _TOLERANCE * circle[2])
        score = float(np.bincount(rays[near], minlength=_RAYS).astype(bool).sum()) + 0.1 * float(weights[near].sum())
        if score > best_score:
            best, best_score = circle, score
    if best[2] == 0:
        raise _nothing()
    distance = np.hypot(points[:, 0] - best[0], points[:, 1] - best[1])
    tolerance = max(1.0, _TOLERANCE * best[2])

    def agreeing(radius: float) -> int:
        return int(np.unique(rays[np.abs(distance - radius) < tolerance]).size)

    # A skyline just inside the edge may be as round as the edge itself: the outermost good circle counts.
    counts = {r: agreeing(r) for r in np.linspace(best[2], 1.08 * best[2], 40)}
    if counts[best[2]] < _LEAST_SHARE * _RAYS:
        raise _nothing()
    return best[0], best[1], max(r for r, n in counts.items() if n >= 0.6 * counts[best[2]])


def _through(points: Doubles) -> Circle | None:
    """Return the circle through three points; None where they lie on a line or far too near each other."""
    (ax, ay), (bx, by), (cx, cy) = points
    twice = 2 * ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    if abs(twice) < 1e3:
        return None
    b2, c2 = (bx - ax) ** 2 + (by - ay) ** 2, (cx - ax) ** 2 + (cy - ay) ** 2
    x, y = ((cy - ay) * b2 - (by - ay) * c2) / twice, ((bx - ax) * c2 - (cx - ax) * b2) / twice
    return float(ax + x), float(ay + y), math.hypot(x, y)


def _fine_edges(pictures: list[Floats], circle: Circle, reach: float) -> tuple[Doubles, Doubles]:
    """Return sub-pixel edge points (n, 2) and their weights: of each ray the outermost that is clear."""
    x, y, radius = circle
    radii = radius + np.arange(-reach, reach + 0.25, 0.5)
    angles = np.linspace(0, 2 * math.pi, _FINE_RAYS, endpoint=False)
    found = [_edge_of(_profiles(picture, (x, y), radii, angles), radii) for picture in pictures]
    places, contrasts = np.array([place for place, _ in found]), np.array([contrast for _, contrast in found])
    best = contrasts.max(axis=0)
    # Short frames show the skyline's edge only, long ones the field's: the outermost clear one is meant.
    at = np.where(contrasts >= 0.5 * best, places, -np.inf).max(axis=0)
    kept = best > 0
    return np.stack([x + at * np.cos(angles), y + at * np.sin(angles)], axis=-1)[kept], best[kept]


def _edge_of(profile: Floats, radii: Doubles) -> tuple[Doubles, Doubles]:
    """Return where each profile falls last (the centroid of its fall there), and with what contrast."""
    level = profile.astype(np.float64)
    half = 3  # samples: 1.5 pixels to either side
    inner, outer = level[:, : -2 * half], level[:, 2 * half :]
    contrast = (inner - outer) / (np.abs(inner) + np.abs(outer) + _FLOOR)
    strong = contrast >= np.maximum(_LEAST_CONTRAST, 0.6 * contrast.max(axis=1))[:, None]
    last = contrast.shape[1] - 1 - strong[:, ::-1].argmax(axis=1)
    # The top of that last rise of contrast, then the centroid of the fall around it.
    around = np.abs(np.arange(contrast.shape[1])[None, :] - last[:, None]) <= 2 * half
    peak = np.where(around, contrast, -1).argmax(axis=1) + half
    fall = np.clip(-np.diff(level, axis=1), 0, None)
    weight = fall * (np.abs(np.arange(fall.shape[1])[None, :] + 0.5 - peak[:, None]) <= half + 1)
    place = (weight @ ((radii[:-1] + radii[1:]) / 2)) / np.maximum(weight.sum(axis=1), 1e-12)
    usable = strong.any(axis=1) & (level.min(axis=1) >= 0) & (weight.sum(axis=1) > 0)
    return place, np.where(usable, contrast.max(axis=1), 0)


def _fit(points: Doubles, weights: Doubles, start: Circle) -> tuple[float, float, float, float, float]:
    """Return centre, radius, standard uncertainty and share of agreeing rays, by iteratively reweighted squares."""
    if len(points) < 0.1 * _FINE_RAYS:
        raise _nothing()
    circle = np.array(start)
    used = weights
    for _ in range(12):
        away = points - circle[:2]
        distance = np.hypot(away[:, 0], away[:, 1])
        off = distance - circle[2]
        scale = max(1.4826 * float(np.median(np.abs(off - np.median(off)))), 0.02)
        used = weights / (1 + (off / (2 * scale)) ** 2) ** 2
        slopes = np.column_stack([away / distance[:, None], np.ones(len(points))])
        normal = slopes.T @ (slopes * used[:, None])
        if np.linalg.cond(normal) > 1e8:
            raise _nothing()
        step = np.linalg.solve(normal, slopes.T @ (used * off))
        circle = circle + step
        if np.abs(step).max() < 1e-4:
            break
    agreeing = np.abs(off) < 3 * scale + 0.5
    # Neighbouring rays share pixels: count one in four as independent.
    covariance = np.linalg.inv(slopes[agreeing].T @ slopes[agreeing]) * scale**2 * 4
    sigma = math.sqrt(float(np.diag(covariance).max()))
    return float(circle[0]), float(circle[1]), float(circle[2]), sigma, float(agreeing.sum()) / _FINE_RAYS


def _nothing() -> LensError:
    return LensError(
        "no image circle was found",
        likely="frames all dark or all bright, a lens that fills the frame, or a cropped picture",
        advice="give frames of middle exposures; of a camera that daylit captures with, image_circle in the rig file",
    )
