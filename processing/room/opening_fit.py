"""One opening's rectangle on its wall, fitted to evidence and edges.

What an opening shows is not its rectangle: a window's frame and panes stand back in the wall by the depth of its
reveal, so that they look smaller and shifted; a door's casing lies around it on the wall. The fit knows both: it places
the rectangle so that what should be seen of it matches the classes, and edges of light run along both outlines.

Rectangles are (u0, v0, u1, v1) in metres of the wall's plane, v down.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats
from processing.ground.kernels import compiled, inner
from processing.ground.tables import table_of
from processing.room.wall_views import WallView
from processing.segmentation.evidence import SceneClass

# How well rectangles on a wall explain what is seen there (compiled).

APART_TEXELS = 1.5  # outlines that are nearer to each other are one


class WallSums(NamedTuple):
    """Running sums over a wall's texture of H x W texels, and where the camera is."""

    votes: Doubles
    """(H + 1, W + 1): votes for the opening, from the upper left corner."""
    upright: Doubles
    """(W, H + 1): strength of edges along upright lines, from the top."""
    level: Doubles
    """(H, W + 1): the same along level lines, from the left."""
    brighter: tuple[Doubles, Doubles]
    """Like ``upright`` and ``level``, of signed edges: positive where it is brighter to the right, or below."""
    px_per_m: float
    eye: Doubles
    """(3,): the camera's (u, v) and its distance from the wall, m."""


@inner
def _summed(table: Any, y: float, x: float) -> float:
    row, column = min(int(y), table.shape[0] - 2), min(int(x), table.shape[1] - 2)
    down, right = y - row, x - column
    above = table[row, column] * (1 - right) + table[row, column + 1] * right
    below = table[row + 1, column] * (1 - right) + table[row + 1, column + 1] * right
    return float(above * (1 - down) + below * down)


@compiled
def region(table: Any, px_per_m: float, u0: float, v0: float, u1: float, v1: float) -> float:
    """Return the sum (m2) of a rectangle from running sums (H + 1, W + 1); ends between texels count in part."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    x0, x1 = min(max(u0 * px_per_m, 0.0), width), min(max(u1 * px_per_m, 0.0), width)
    y0, y1 = min(max(v0 * px_per_m, 0.0), height), min(max(v1 * px_per_m, 0.0), height)
    total: float = _summed(table, y1, x1) - _summed(table, y0, x1) - _summed(table, y1, x0) + _summed(table, y0, x0)
    return total / px_per_m**2


@compiled
def edge(table: Any, px_per_m: float, at_m: float, start_m: float, end_m: float) -> float:
    """Return the sum (m) of edges along a line from running sums (LINES, N + 1); 0 at the wall's own ends."""
    at = at_m * px_per_m
    lines, last = table.shape[0], table.shape[1] - 1
    if not 1 < at < lines - 1:
        return 0.0
    place = min(max(at - 0.5, 0.0), lines - 1.001)
    line = int(place)
    share = place - line
    first = int(min(max(np.rint(start_m * px_per_m), 0), last))
    after = int(min(max(np.rint(end_m * px_per_m), 0), last))
    one, other = table[line, after] - table[line, first], table[line + 1, after] - table[line + 1, first]
    return float((one * (1 - share) + other * share) / px_per_m)


@inner
def _shown(eye: Any, recess_m: float, box: Any, out: Any) -> None:
    u0, v0, u1, v1 = box[0], box[1], box[2], box[3]
    if recess_m <= 0:
        out[0], out[1], out[2], out[3] = u0 + recess_m, v0 + recess_m, u1 - recess_m, v1
        return
    k = eye[2] / (eye[2] + recess_m)
    out[0] = max(u0, eye[0] + (u0 - eye[0]) * k)
    out[1] = max(v0, eye[1] + (v0 - eye[1]) * k)
    out[2] = min(u1, eye[0] + (u1 - eye[0]) * k)
    out[3] = min(v1, eye[1] + (v1 - eye[1]) * k)


@inner
def _glass(upright: Any, level: Any, px_per_m: float, frames_m: Any, shown: Any) -> float:
    """Return the edges around the glass, within a frame as wide on all sides as suits best."""
    best = -np.inf
    for frame in frames_m:
        u0, v0, u1, v1 = shown[0] + frame, shown[1] + frame, shown[2] - frame, shown[3] - frame
        found = edge(upright, px_per_m, u0, v0, v1) + edge(upright, px_per_m, u1, v0, v1)
        found += edge(level, px_per_m, v0, u0, u1) + edge(level, px_per_m, v1, u0, u1)
        best = max(best, found)
    return best


@compiled
def box_scores(wall: WallSums, recess_m: float, weights: Any, frames_m: Any, boxes: Any, out: Any) -> None:
    """Fill ``out`` (N,) with the scores of rectangles ``boxes`` (N, 4), m.

    ``weights`` (13,): of area, of outer edges (upright, upper, lower), of inner ones likewise, of the glass's, of the
    rectangle's own width and height, and of outer edges that are brighter inside (upright, upper, lower).
    ``frames_m`` (K,): widths of a window's frame that are tried.
    """
    votes, upright, level, brighter, px_per_m, eye = wall
    shown = np.empty(4)
    apart = APART_TEXELS / px_per_m
    for i in range(len(boxes)):
        box = boxes[i]
        _shown(eye, recess_m, box, shown)
        seen = region(votes, px_per_m, shown[0], shown[1], shown[2], shown[3])
        # Networks call a reveal now wall, now window.
        total = weights[0] * max(seen, region(votes, px_per_m, box[0], box[1], box[2], box[3]))
        for side in range(4):
            table = level if side % 2 else upright
            start, end = (0, 2) if side % 2 else (1, 3)
            which = 0 if side % 2 == 0 else (side + 1) // 2
            total += weights[4 + which] * edge(table, px_per_m, shown[side], shown[start], shown[end])
            if abs(shown[side] - box[side]) > apart:
                total += weights[1 + which] * edge(table, px_per_m, box[side], box[start], box[end])
            if weights[10 + which] != 0:
                signed = edge(brighter[side % 2], px_per_m, box[side], box[start], box[end])
                total += weights[10 + which] * (signed if side < 2 else -signed)
        if weights[7] != 0:
            total += weights[7] * _glass(upright, level, px_per_m, frames_m, shown)
        out[i] = total + weights[8] * (box[2] - box[0]) + weights[9] * (box[3] - box[1])


# Kinds of openings, and the fit of their rectangles.

Box = tuple[float, float, float, float]

HIDING = (SceneClass.FURNITURE, SceneClass.TRIPOD, SceneClass.FIXTURE)
"""What may hide an opening: there, classes say nothing."""
COMMON_EDGE = 0.3  # edge strength anywhere on a wall
FRAMES_M = (0.03, 0.045, 0.06, 0.075, 0.1)
REACH_M, PASSES = 0.3, 3
STAY_PER_M = 1.0  # what a side pays for leaving its place without a reason
LEAST_SIDE_M = 0.3  # chosen: narrower than windows and doors are
AROUND_M = 0.3  # width of the wall around an opening that its light is compared with


@dataclass(frozen=True)
class Kind:
    """What the fit must know of windows, or of doors."""

    shown: SceneClass
    recesses_m: tuple[float, ...]
    """Above 0: what is seen stands back so far; below 0: it lies around the opening by so much."""
    usual_recess_m: tuple[float, float]
    """Mean and spread."""
    to_floor: bool
    odds: float
    """By which the network's odds are raised: it is slow to call a wall broken."""
    weights: tuple[float, ...]
    """Of `box_scores`."""
    last_weights: tuple[float, ...] | None = None
    """The same for the last fit, once the recess is known."""
    usual_width_m: tuple[float, float] | None = None
    usual_head_m: tuple[float, float] | None = None


_KINDS: dict[str, dict[str, Any]] = {
    kind: {name: tuple(value) if isinstance(value, list) else value for name, value in row.items()}
    for kind, row in table_of(__package__, "opening_kinds").items()
}
WINDOW, DOOR = Kind(SceneClass.WINDOW, **_KINDS["window"]), Kind(SceneClass.DOOR, **_KINDS["door"])


@dataclass(frozen=True)
class Field:
    """Sums over a wall, for one kind of opening."""

    view: WallView
    kind: Kind
    cloth: bool = False
    """Blinds belong to what is looked for."""

    @cached_property
    def share(self) -> Floats:
        """Return probabilities (len(SceneClass), h, w) with the kind's odds raised."""
        odds = np.ones((len(self.view.share), 1, 1), np.float32)
        odds[self.kind.shown] = self.kind.odds
        raised = self.view.share * odds
        return np.asarray(raised / np.maximum(raised.sum(axis=0), 1e-6), dtype=np.float32)

    @cached_property
    def shown(self) -> Floats:
        """Return the share (H, W) of what is looked for."""
        share = self.share
        shown = share[self.kind.shown] + share[SceneClass.FIXTURE] if self.cloth else share[self.kind.shown]
        return np.asarray(shown, dtype=np.float32)

    @cached_property
    def votes(self) -> Floats:
        """Return for and against the kind at each texel (H, W), -1..1; 0 where something hides the wall."""
        shown = self.shown
        hiding = [each for each in HIDING if not (self.cloth and each is SceneClass.FIXTURE)]
        return np.where(self.view.known, 2 * shown + self.share[hiding].sum(axis=0) - 1, 0.0).astype(np.float32)

    @cached_property
    def _sums(self) -> WallSums:
        standing = np.minimum(self.share[[SceneClass.FURNITURE, SceneClass.TRIPOD]].sum(axis=0), 1)
        # Curtains have upright edges of their own; sill and head are seen over radiators and under rods.
        cloth = 0.0 if self.cloth else self.share[SceneClass.FIXTURE]
        across, down = self.view.edges
        clear = self.view.known * (1 - standing)
        bare = self.view.known * (1 - np.minimum(standing + cloth, 1))
        found = []
        for upright, level, common in ((np.abs(across), np.abs(down), COMMON_EDGE), (across, down, 0.0)):
            # An edge that is tilted or wavy by a texel is still one edge.
            first = np.cumsum((cv2.blur(upright, (3, 1)) - common) * bare, axis=0, dtype=np.float64)
            second = np.cumsum((cv2.blur(level, (1, 3)) - common) * clear, axis=1, dtype=np.float64)
            found += [np.ascontiguousarray(np.pad(first, ((1, 0), (0, 0))).T), np.pad(second, ((0, 0), (1, 0)))]
        votes = np.asarray(cv2.integral(self.votes, sdepth=cv2.CV_64F), np.float64)
        eye = np.array(self.view.eye, np.float64)
        return WallSums(votes, found[0], found[1], (found[2], found[3]), self.view.px_per_m, eye)

    def region(self, box: Box) -> float:
        """Return the sum of votes (m2) in a box; ends between texels count in part."""
        return float(region(self._sums.votes, self.view.px_per_m, *box))

    def level_edge(self, v_m: float, u0_m: float, u1_m: float) -> float:
        """Return how much edge (m) runs along a level line; 0 at the wall's own ends."""
        return float(edge(self._sums.level, self.view.px_per_m, v_m, u0_m, u1_m))

    def scores(self, recess_m: float, boxes: Doubles, weights: Sequence[float] | None = None) -> Doubles:
        """Return the scores (N,) of boxes (N, 4): larger is better, 0 is no opening. ``weights`` None: the kind's."""
        out = np.empty(len(boxes))
        view, used = self.view, np.array(weights or self.kind.weights, dtype=np.float64)
        box_scores(self._sums, recess_m, used, np.array(FRAMES_M), boxes, out)
        usual, head = self.kind.usual_width_m, self.kind.usual_head_m
        if usual:
            out -= 0.25 * ((boxes[:, 2] - boxes[:, 0] - usual[0]) / usual[1]) ** 2
        if head:
            out -= 0.25 * ((view.plane.height_m - boxes[:, 1] - head[0]) / head[1]) ** 2
        return out


@dataclass(frozen=True)
class Candidate:
    """A rectangle on a wall, and how well it explains what is seen there."""

    field: Field
    box: Box
    recess_m: float
    score: float


def shown_box(view: WallView, recess_m: float, box: Box) -> Box:
    """Return what is seen of an opening on the wall: behind a reveal, or with the casing around."""
    u0, v0, u1, v1 = box
    if recess_m <= 0:
        return u0 + recess_m, v0 + recess_m, u1 - recess_m, v1
    eye_u, eye_v, away = view.eye
    k = away / (away + recess_m)
    far = (eye_u + (u0 - eye_u) * k, eye_v + (v0 - eye_v) * k, eye_u + (u1 - eye_u) * k, eye_v + (v1 - eye_v) * k)
    return max(u0, far[0]), max(v0, far[1]), min(u1, far[2]), min(v1, far[3])


def box_of_shown(view: WallView, recess_m: float, shown: Box) -> Box:
    """Return the opening of which a box is seen: the inverse of `shown_box`."""
    u0, v0, u1, v1 = shown
    if recess_m <= 0:
        return u0 - recess_m, v0 - recess_m, u1 + recess_m, v1
    eye_u, eye_v, away = view.eye
    grow = (away + recess_m) / away
    far = [eye + (side - eye) * grow for eye, side in zip((eye_u, eye_v, eye_u, eye_v), shown, strict=True)]
    return min(u0, far[0]), min(v0, far[1]), max(u1, far[2]), max(v1, far[3])


def score_of(field: Field, recess_m: float, box: Box) -> float:
    """Return the score of one opening."""
    return float(field.scores(recess_m, np.array([box], dtype=np.float64))[0])


def fitted(field: Field, recess_m: float, start: Box, weights: Sequence[float] | None = None) -> tuple[float, Box]:
    """Return the best score and rectangle near a start: each side is moved in turn, a few times."""
    view = field.view
    width, height = view.plane.width_m, view.plane.height_m
    u0, v0 = max(0.0, start[0]), max(0.0, start[1])
    start = u0, v0, min(width, max(start[2], u0 + LEAST_SIDE_M)), min(height, max(start[3], v0 + LEAST_SIDE_M))
    sides = list(start)
    step = 1 / view.px_per_m
    moves = np.arange(-math.ceil(REACH_M / step), math.ceil(REACH_M / step) + 1) * step
    best = -math.inf
    for _ in range(PASSES):
        for which in (0, 2, 1) if field.kind.to_floor else (0, 2, 1, 3):
            tried = start[which] + moves
            low = 0.0 if which < 2 else sides[which - 2] + LEAST_SIDE_M
            high = sides[which + 2] - LEAST_SIDE_M if which < 2 else (width, height)[which % 2]
            tried = tried[(tried >= low - 1e-9) & (tried <= high + 1e-9)]
            if not tried.size:
                continue
            boxes = np.repeat(np.array([sides], dtype=np.float64), len(tried), axis=0)
            boxes[:, which] = tried
            found = field.scores(recess_m, boxes, weights) - STAY_PER_M * np.abs(tried - start[which])
            place = int(found.argmax())
            best, sides[which] = float(found[place]), float(tried[place])
    return best, (sides[0], sides[1], sides[2], sides[3])


def fitted_last(one: Candidate) -> Candidate:
    """Return an opening fitted once more from where it is, by the last weights of its kind; its score stays.

    By day what belongs to a window, reveals too, is brighter than the wall. That counts in full where its inside is a
    stop brighter than what is around it, and not at all where it is darker: at night.
    """
    last = one.field.kind.last_weights
    if last is None:
        return one
    day = float(np.clip(brighter_inside(one), 0.0, 1.0))
    weights = (*last[:10], *(day * each for each in last[10:]))
    return replace(one, box=fitted(one.field, one.recess_m, one.box, weights)[1])


def brighter_inside(one: Candidate) -> float:
    """Return by how many stops what is seen of an opening is brighter than what is around it; medians; 0: unknown."""
    inside, around = inside_around(one)
    light = one.field.view.log_luminance
    return float(np.median(light[inside]) - np.median(light[around])) if inside.any() and around.any() else 0.0


def inside_around(one: Candidate) -> tuple[Flags, Flags]:
    """Return what is seen of an opening, and `AROUND_M` around it, of the known texels of its wall, (H, W) each."""
    view, p = one.field.view, one.field.view.px_per_m
    inside, around = np.zeros((2, *view.known.shape), bool)
    for part, box, wider in ((inside, shown_box(view, one.recess_m, one.box), 0.0), (around, one.box, AROUND_M)):
        u0, v0 = (max(0, round((side - wider) * p)) for side in box[:2])
        u1, v1 = (max(0, round((side + wider) * p)) for side in box[2:])
        part[v0:v1, u0:u1] = True
    u0, v0, u1, v1 = (max(0, round(side * p)) for side in one.box)
    around[v0:v1, u0:u1] = False
    return inside & view.known, around & view.known
