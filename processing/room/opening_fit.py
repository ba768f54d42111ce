"""One opening's rectangle on its wall, fitted to evidence and edges.

What an opening shows is not its rectangle: a window's frame and panes stand back in the wall by the depth of its
reveal, so that they look smaller and shifted; a door's casing lies around it on the wall. The fit knows both: it places
the rectangle so that what should be seen of it matches the classes, and edges of light run along both outlines.

Rectangles are (u0, v0, u1, v1) in metres of the wall's plane, v down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats
from processing.room.opening_kernels import box_scores, edge, region
from processing.room.wall_views import WallView
from processing.segmentation.evidence import SceneClass

Box = tuple[float, float, float, float]

HIDING = (SceneClass.FURNITURE, SceneClass.TRIPOD, SceneClass.FIXTURE)
"""What may hide an opening: there, classes tell nothing."""
COMMON_EDGE = 0.3
"""Edge strength anywhere on a wall."""
FRAMES_M = (0.03, 0.045, 0.06, 0.075, 0.1)
REACH_M, PASSES = 0.3, 3
STAY_PER_M = 1.0
"""What a side pays for leaving its place without a reason."""
LEAST_SIDE_M = 0.3
AROUND_M = 0.3
"""Width of the wall around an opening that its light is compared with."""


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


WINDOW = Kind(
    SceneClass.WINDOW,
    (-0.08, -0.05, *(0.04 * i for i in range(12))),
    (0.23, 0.12),
    to_floor=False,
    odds=1.5,
    weights=(10, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0),
    last_weights=(9.4, 3.9, 0.1, 2.4, 0, 0.8, 1.8, 1.2, -0.3, 1.85, 1.9, 1.75, 3.8),
)
DOOR = Kind(
    SceneClass.DOOR,
    (-0.1, -0.08, -0.06, -0.04, -0.02, 0.0, 0.05, 0.1),
    (-0.06, 0.03),
    to_floor=True,
    odds=2.5,
    weights=(10, 1, 1, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0),
    usual_width_m=(0.82, 0.12),
    usual_head_m=(2.03, 0.08),
)


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
        """Return the share (h, w) of what is looked for."""
        share = self.share
        shown = share[self.kind.shown] + share[SceneClass.FIXTURE] if self.cloth else share[self.kind.shown]
        return np.asarray(shown, dtype=np.float32)

    @cached_property
    def votes(self) -> Floats:
        """Return for and against the kind at each texel (h, w), -1..1; 0 where something hides the wall."""
        shown = self.shown
        hiding = [each for each in HIDING if not (self.cloth and each is SceneClass.FIXTURE)]
        hidden = self.share[hiding].sum(axis=0)
        return np.where(self.view.known, 2 * shown + hidden - 1, 0.0).astype(np.float32)

    @cached_property
    def _votes_sum(self) -> Doubles:
        return np.asarray(cv2.integral(self.votes, sdepth=cv2.CV_64F), dtype=np.float64)

    @cached_property
    def _edge_sums(self) -> tuple[Doubles, Doubles, tuple[Doubles, Doubles]]:
        """Return running sums of edges along upright and level lines; and signed ones: brighter to the right, below."""
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
        return found[0], found[1], (found[2], found[3])

    def region(self, box: Box) -> float:
        """Return the sum of votes (m2) in a box; ends between texels count in part."""
        return float(region(self._votes_sum, self.view.px_per_m, *box))

    def level_edge(self, v_m: float, u0_m: float, u1_m: float) -> float:
        """Return how much edge (m) runs along a level line; 0 at the wall's own ends."""
        return float(edge(self._edge_sums[1], self.view.px_per_m, v_m, u0_m, u1_m))

    def scores(self, recess_m: float, boxes: Doubles, weights: Sequence[float] | None = None) -> Doubles:
        """Return the scores (n,) of boxes (n, 4): larger is better, 0 is no opening. ``weights`` None: the kind's."""
        out = np.empty(len(boxes))
        view, used = self.view, np.array(weights or self.kind.weights, dtype=np.float64)
        eye, frames = np.array(view.eye, dtype=np.float64), np.array(FRAMES_M)
        box_scores(self._votes_sum, *self._edge_sums, view.px_per_m, eye, recess_m, used, frames, boxes, out)
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
    return (
        min(u0, eye_u + (u0 - eye_u) * grow),
        min(v0, eye_v + (v0 - eye_v) * grow),
        max(u1, eye_u + (u1 - eye_u) * grow),
        max(v1, eye_v + (v1 - eye_v) * grow),
    )


def score_of(field: Field, recess_m: float, box: Box) -> float:
    """Return the score of one opening."""
    return float(field.scores(recess_m, np.array([box], dtype=np.float64))[0])


def recess_cost(kind: Kind, recess_m: float) -> float:
    """Return what an unusual recess costs, in units of the score."""
    return 0.5 * ((recess_m - kind.usual_recess_m[0]) / kind.usual_recess_m[1]) ** 2


def fitted(field: Field, recess_m: float, start: Box, weights: Sequence[float] | None = None) -> tuple[float, Box]:
    """Return the best score and rectangle near a start: each side is moved in turn, a few times."""
    view = field.view
    start = _kept_inside(view, start)
    sides = list(start)
    step = 1 / view.px_per_m
    moves = np.arange(-math.ceil(REACH_M / step), math.ceil(REACH_M / step) + 1) * step
    limits = (view.plane.width_m, view.plane.height_m)
    best = -math.inf
    for _ in range(PASSES):
        for which in (0, 2, 1) if field.kind.to_floor else (0, 2, 1, 3):
            tried = start[which] + moves
            low = 0.0 if which < 2 else sides[which - 2] + LEAST_SIDE_M
            high = sides[which + 2] - LEAST_SIDE_M if which < 2 else limits[which % 2]
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
    view, p = one.field.view, one.field.view.px_per_m
    inside = np.zeros(view.known.shape, bool)
    around = np.zeros(view.known.shape, bool)
    for part, box, wider in ((inside, shown_box(view, one.recess_m, one.box), 0.0), (around, one.box, AROUND_M)):
        u0, v0 = (max(0, round((side - wider) * p)) for side in box[:2])
        u1, v1 = (max(0, round((side + wider) * p)) for side in box[2:])
        part[v0:v1, u0:u1] = True
    u0, v0, u1, v1 = (max(0, round(side * p)) for side in one.box)
    around[v0:v1, u0:u1] = False
    inside, around = inside & view.known, around & view.known
    if not inside.any() or not around.any():
        return 0.0
    return float(np.median(view.log_luminance[inside]) - np.median(view.log_luminance[around]))


def _kept_inside(view: WallView, box: Box) -> Box:
    width, height = view.plane.width_m, view.plane.height_m
    u0, v0 = max(0.0, box[0]), max(0.0, box[1])
    return u0, v0, min(width, max(box[2], u0 + LEAST_SIDE_M)), min(height, max(box[3], v0 + LEAST_SIDE_M))
