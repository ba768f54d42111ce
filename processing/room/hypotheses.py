"""Rooms that the boundaries may mean, each fitted: rectilinear, boxes, with slanted walls, and the bare polygon."""

import math
from dataclasses import dataclass

import numpy as np

from processing.ground.arrays import Doubles
from processing.room import outline as outlines
from processing.room.columns import Columns
from processing.room.outline import ALONG_X, ALONG_Y, FREE, Outline
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.surfaces.maps import wall_ranges

# Walls fitted to boundaries: all parameters of an outline at once, robustly, and what the fit is worth.
CAP = 3.0  # standard deviations beyond which a column counts as unexplained
BROKEN = 1e3  # residual of an outline that is no room
AZIMUTH_SIGMA_RAD = math.radians(0.7)
CHANGE_SIGMA = 0.5  # of the logarithm of distances: a weak tie that keeps walls which few columns see
MOST_ROUNDS = 12  # of the robust fit; chosen, never swept
PRICES = (8.0, 16.0, 32.0, 64.0, 128.0)  # of a wall, in squared standard deviations: from many walls to few
FREE_EXTRA = 14.0  # what a wall at any angle must explain more than one at a right angle
WALL_PRICE = 60.0  # of a wall in the final comparison; chosen, as those below, on simulated rooms of validation seeds
UNSEEN_PRICE, SLANTED_PRICE = 40.0, 50.0  # chosen, never swept
MOST_WALLS = 16  # chosen, never swept
SIMPLIFIED = (0.03, 0.06, 0.1)  # of the bare polygon: tolerances in camera heights


@dataclass(frozen=True)
class Fit:
    """An outline fitted to boundaries."""

    outline: Outline
    polygon: Doubles
    """(N, 2), counter-clockwise, in camera heights."""
    cost: float
    """Sum over columns of the capped squared residuals of both boundaries, in standard deviations."""
    unexplained: float
    """Share of columns beyond `CAP`."""


def residuals(polygon: Doubles, ratio: float, columns: Columns) -> Doubles:
    """Return (2, N): predicted less found inverse distances, by floor and ceiling, in standard deviations.

    ``polygon`` (K, 2) in camera heights, around the camera.
    """
    distance, _ = wall_ranges(polygon, columns.azimuth_rad)
    inverse = 1 / np.maximum(distance, 1e-3)
    return np.stack(
        [(inverse - columns.floor) / columns.floor_sigma, (inverse * ratio - columns.ceiling) / columns.ceiling_sigma]
    )


def cost_of(polygon: Doubles, ratio: float, columns: Columns) -> tuple[float, float]:
    """Return the capped cost of a polygon (K, 2), and the share of unexplained columns."""
    found = np.minimum(np.abs(residuals(polygon, ratio, columns)), CAP)
    return float((found**2).sum()), float((found >= CAP).any(axis=0).mean())


def fitted(outline: Outline, columns: Columns, *, rounds: int = MOST_ROUNDS) -> Fit | None:
    """Return an outline with its walls where the columns say, by Gauss-Newton with robust weights; None if no room.

    Steps that break the room (walls that cross, a camera outside) are shortened.
    """
    values = outlines.values_of(outline)
    count = len(outline.walls)
    distances = np.maximum(np.abs(values[2 : 2 + count]), 0.3) * CHANGE_SIGMA
    free = np.full(len(values) - 2 - count, 0.3)
    start, scale = values.copy(), np.concatenate([[AZIMUTH_SIGMA_RAD, columns.ratio_sigma], distances, free])
    polygon = outlines.polygon_of(outline)
    if polygon is None:
        return None
    best = _objective(outline, values, start, scale, columns)
    for _ in range(rounds):
        step = _step(outline, values, start, scale, columns)
        if step is None:
            break
        size = 1.0
        while size > 0.05:
            tried = _objective(outline, values + size * step, start, scale, columns)
            if tried < best:
                break
            size /= 2
        else:
            break
        values = values + size * step
        gain, best = best - tried, tried
        if gain < 1e-3 * max(best, 1.0):
            break
    found = outlines.with_values(outline, values)
    polygon = outlines.polygon_of(found)
    if polygon is None:
        return None
    cost, unexplained = cost_of(polygon, found.ratio, columns)
    return Fit(found, polygon, cost, unexplained)


def _plain(outline: Outline, values: Doubles, columns: Columns) -> Doubles | None:
    moved = outlines.with_values(outline, values)
    polygon = outlines.polygon_of(moved)
    return None if polygon is None else residuals(polygon, moved.ratio, columns).ravel()


def _objective(outline: Outline, values: Doubles, start: Doubles, scale: Doubles, columns: Columns) -> float:
    found = _plain(outline, values, columns)
    if found is None:
        return math.inf
    squared = (found / CAP) ** 2
    # Geman-McClure: as the cap of the final cost, but smooth.
    return float(CAP**2 * (squared / (1 + squared)).sum() + (((values - start) / scale) ** 2).sum())


def _step(outline: Outline, values: Doubles, start: Doubles, scale: Doubles, columns: Columns) -> Doubles | None:
    found = _plain(outline, values, columns)
    if found is None:
        return None
    slopes = np.zeros((len(found), len(values)))
    for k in range(len(values)):
        nudge = np.zeros(len(values))
        nudge[k] = 1e-4
        moved = _plain(outline, values + nudge, columns)
        if moved is not None:
            slopes[:, k] = (moved - found) / 1e-4
    # Columns at corners and edges of occlusion jump; their slopes mean nothing.
    slopes[(np.abs(slopes) > BROKEN).any(axis=1)] = 0.0
    weight = 1 / (1 + (found / CAP) ** 2) ** 2
    normal = slopes.T @ (slopes * weight[:, None]) + np.diag(1 / scale**2)
    right = slopes.T @ (weight * found) + (values - start) / scale**2
    return np.asarray(-np.linalg.solve(normal + 1e-9 * np.eye(len(values)), right))


# How well a room agrees with what the pixels show: classes on floor, ceiling and walls.
ON_FLOOR = (SceneClass.FLOOR, SceneClass.FURNITURE, SceneClass.FIXTURE, SceneClass.TRIPOD)
ON_CEILING = (SceneClass.CEILING, SceneClass.FIXTURE)
ON_WALL = (SceneClass.WALL, SceneClass.WINDOW, SceneClass.DOOR, SceneClass.FURNITURE, SceneClass.FIXTURE)
COLUMNS = 128  # 2.8 degrees each; chosen, never swept
LEAST_SHARE = 0.03  # the most that one column may speak against a room: 3.5 nats; chosen, never swept


class ClassTable:
    """Probabilities that pixels fit on floor, ceiling or wall, summed down columns, so that a room is judged fast."""

    def __init__(self, evidence: SceneEvidence) -> None:
        step = max(1, evidence.probabilities.shape[2] // COLUMNS)
        width = evidence.probabilities.shape[2]
        chosen = np.arange(step // 2, width, step)
        part = evidence.probabilities[:, :, chosen]
        rows, columns = part.shape[1:]
        self.azimuth_rad = ((chosen + 0.5) / width - 0.5) * (2 * math.pi)
        self._edges = np.linspace(math.pi / 2, -math.pi / 2, rows + 1)
        # Solid angle, so that poles do not count for more than they show.
        weight = np.diff(-np.sin(self._edges))[:, None] / 2 / columns
        self._sums = {}
        for name, classes in (("ceiling", ON_CEILING), ("wall", ON_WALL), ("floor", ON_FLOOR)):
            share = part[[int(c) for c in classes]].sum(axis=0, dtype=np.float64)
            loss = -np.log(np.maximum(share, LEAST_SHARE)) * weight
            self._sums[name] = np.concatenate([np.zeros((1, columns)), np.cumsum(loss, axis=0)])

    def loss(self, polygon: Doubles, ratio: float) -> float:
        """Return the mean of -log(share of classes that may be there) over the sphere; polygon (K, 2): 0 is perfect."""
        distance, _ = wall_ranges(polygon, self.azimuth_rad)
        up, down = np.arctan2(ratio, distance), np.arctan2(-1.0, distance)
        ceiling = self._at("ceiling", up)
        wall = self._at("wall", down) - self._at("wall", up)
        floor = self._sums["floor"][-1] - self._at("floor", down)
        return float((ceiling + wall + floor).sum())

    def _at(self, name: str, latitude: Doubles) -> Doubles:
        """Return what is summed from the top down to a latitude in each column."""
        sums = self._sums[name]
        place = np.clip((math.pi / 2 - latitude) / math.pi * (len(sums) - 1), 0, len(sums) - 1)
        row = np.minimum(place.astype(int), len(sums) - 2)
        part = place - row
        columns = np.arange(sums.shape[1])
        return np.asarray((1 - part) * sums[row, columns] + part * sums[row + 1, columns])


def overhead_share(evidence: SceneEvidence) -> float:
    """Return how much of what is above 50 degrees may be a ceiling: little of it outdoors."""
    rows = evidence.probabilities.shape[1]
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows) * math.pi
    above = latitude > math.radians(50)
    share = evidence.share(*ON_CEILING)[above].mean(axis=1)
    weight = np.cos(latitude[above])
    return float((share * weight).sum() / weight.sum())


def class_entropy(evidence: SceneEvidence) -> float:
    """Return the mean entropy (natural) of the classes over the sphere: how unsure the network is of what it sees."""
    share = evidence.probabilities.astype(np.float64)
    rows = -(share * np.log(np.maximum(share, 1e-6))).sum(axis=0).mean(axis=1)
    weight = np.cos((0.5 - (np.arange(len(rows)) + 0.5) / len(rows)) * math.pi)
    return float((rows * weight).sum() / weight.sum())


@dataclass(frozen=True)
class Hypothesis:
    """A possible room."""

    name: str
    fit: Fit
    price: float
    """Of its walls."""

    @property
    def total(self) -> float:
        """Return what it costs: unexplained columns and walls."""
        return self.fit.cost + self.price


def hypotheses(columns: Columns, turned_rad: float, *, slanted: bool = True) -> list[Hypothesis]:
    """Return rooms that the columns may mean, the cheapest first, each fitted; the same outline once."""
    costs = outlines.stretch_costs(columns, turned_rad, (ALONG_X, ALONG_Y, FREE) if slanted else (ALONG_X, ALONG_Y))
    menus: dict[str, dict[int, float]] = {"rectilinear": {ALONG_X: 0.0, ALONG_Y: 0.0}}
    if slanted:
        menus["slanted"] = {ALONG_X: 0.0, ALONG_Y: 0.0, FREE: FREE_EXTRA}
        menus["any angle"] = {FREE: 0.0}
    found: dict[tuple[object, ...], Hypothesis] = {}
    for name, kinds in menus.items():
        for price in PRICES:
            _, stretches = outlines.divide(costs, columns.corner, price, kinds)
            outline = outlines.outline_of(stretches, columns.azimuth_rad, turned_rad, columns.ratio)
            if outline is None or len(outline.walls) > MOST_WALLS:
                continue
            key = _key(outline)
            if key in found:
                continue
            fit = fitted(outline, columns)
            if fit is not None:
                found[key] = Hypothesis(name, fit, price_of(outline))
    found.update({(f"polygon {t}",): h for t in SIMPLIFIED if (h := _bare(columns, turned_rad, t)) is not None})
    return sorted(found.values(), key=lambda h: h.total)


def _key(outline: Outline) -> tuple[object, ...]:
    """Return what distinguishes outlines before fitting: walls of the same kinds that look the same way."""
    return tuple(
        (w.kind, w.seen, round(w.normal_rad, 1), round(math.log(abs(w.distance) + 0.1), 1)) for w in outline.walls
    )


def price_of(outline: Outline) -> float:
    """Return what the walls of an outline cost."""
    kinds = [(w.kind, w.seen) for w in outline.walls]
    return float(sum(WALL_PRICE * seen + UNSEEN_PRICE * (not seen) + SLANTED_PRICE * (k == FREE) for k, seen in kinds))


def _bare(columns: Columns, turned_rad: float, tolerance: float) -> Hypothesis | None:
    """Return the polygon through all columns, simplified: right where nothing else is, and never crossing itself."""
    import shapely

    below = columns.floor_sigma**-2.0
    above = (columns.ceiling_sigma / columns.ratio) ** -2.0
    inverse = (columns.floor * below + columns.ceiling / columns.ratio * above) / (below + above)
    reach = 1 / np.maximum(inverse, 0.05)
    points = np.stack([reach * np.sin(columns.azimuth_rad), reach * np.cos(columns.azimuth_rad)], axis=-1)[::-1]
    simple = shapely.Polygon(points).simplify(tolerance)
    corners = np.asarray(simple.exterior.coords)[:-1] if simple.geom_type == "Polygon" else np.zeros((0, 2))
    if not 3 <= len(corners) <= 60:
        return None
    outline = Outline((), turned_rad, columns.ratio)
    if not shapely.LinearRing(corners).is_ccw:
        corners = corners[::-1]
    if not shapely.Polygon(corners).contains(shapely.Point(0, 0)):
        return None
    cost, unexplained = cost_of(corners, columns.ratio, columns)
    price = (WALL_PRICE + SLANTED_PRICE) * len(corners)
    return Hypothesis("polygon", Fit(outline, corners, cost, unexplained), price)
