"""Rays in the built-in room: which face a ray meets, and what stands between two points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mocks.worlds.light import Reals, Vector
from mocks.worlds.room_plan import CAMERA_HEIGHT_M, Box, RoomPlan
from processing.ground.arrays import Floats, Int32s

FLOOR, CEILING = 4, 5
WINDOW_WALL = 3
DOOR_WALL, PICTURE_WALL = 0, 1
_IN_PLANE = ((1, 2), (0, 2), (0, 1))


@dataclass(frozen=True)
class Faces:
    """All rectangles of the room. Face ``2 axis + side`` is a wall (0 low, 1 high side); six a solid follow.

    ``u`` and ``v`` run along the two axes other than ``axis``, in their order.
    """

    axis: Int32s
    normal_sign: Floats
    low: Floats
    high: Floats

    def __len__(self) -> int:
        return len(self.axis)

    def extent_m(self, face: int) -> tuple[float, float]:
        """Return the lengths of a face along u and v."""
        u, v = _IN_PLANE[self.axis[face]]
        size = self.high[face] - self.low[face]
        return float(size[u]), float(size[v])

    def points(self, face: int, u: Reals, v: Reals) -> Floats:
        """Return the points at fractions u, v (0..1) of a face."""
        axis_u, axis_v = _IN_PLANE[self.axis[face]]
        out = np.broadcast_to(self.low[face], (*u.shape, 3)).astype(np.float32)
        size = self.high[face] - self.low[face]
        out[..., axis_u] += u * size[axis_u]
        out[..., axis_v] += v * size[axis_v]
        return out

    def normal(self, face: int) -> Floats:
        """Return the unit normal that points into the room."""
        out = np.zeros(3, dtype=np.float32)
        out[self.axis[face]] = self.normal_sign[face]
        return out


def room_faces(plan: RoomPlan) -> Faces:
    """Return the faces of the walls (normals inwards) and of each solid (normals outwards)."""
    blocks = [(plan.low, plan.high, -1.0), *((box.low, box.high, 1.0) for box in plan.solids)]
    axis, sign, low, high = [], [], [], []
    for block_low, block_high, outwards in blocks:
        for a in range(3):
            for side in range(2):
                face_low, face_high = list(block_low), list(block_high)
                face_low[a] = face_high[a] = (block_low, block_high)[side][a]
                axis.append(a)
                sign.append(outwards * (2 * side - 1))
                low.append(face_low)
                high.append(face_high)
    f32 = np.float32
    return Faces(np.array(axis, np.int32), np.array(sign, f32), np.array(low, f32), np.array(high, f32))


@dataclass(frozen=True)
class Hits:
    """Where camera rays end: the face of each, its distance, and the point."""

    face: Int32s
    distance_m: Floats
    point: Floats


def cast(plan: RoomPlan, directions: Floats) -> Hits:
    """Return the first face that each ray (N, 3) from the camera meets."""
    origin = np.array([0, 0, CAMERA_HEIGHT_M], dtype=np.float32)
    with np.errstate(divide="ignore"):
        inverse = 1 / directions
    ahead = directions > 0
    walls = np.where(ahead, np.array(plan.high, np.float32) - origin, np.array(plan.low, np.float32) - origin)
    with np.errstate(invalid="ignore"):
        reach = np.where(directions == 0, np.float32(np.inf), walls * inverse)
    axis = np.argmin(reach, axis=1)
    every = np.arange(len(axis))
    distance = reach[every, axis]
    face = (2 * axis + ahead[every, axis]).astype(np.int32)
    for index, box in enumerate(plan.solids):
        _hit_box(index, box, directions, (inverse, face, distance))
    return Hits(face, distance, origin + directions * distance[:, None])


def _hit_box(index: int, box: Box, directions: Floats, state: tuple[Reals, Int32s, Floats]) -> None:
    """Let a box take the rays that meet it before anything so far."""
    inverse, face, distance = state
    axis_of_cone, cos_limit = _cone(box)
    cos_off = sum(directions[:, i] * axis_of_cone[i] for i in range(3))
    near_it = np.flatnonzero(cos_off > cos_limit)
    if near_it.size == 0:
        return
    origin = np.array([0, 0, CAMERA_HEIGHT_M], dtype=np.float32)
    some = inverse[near_it]
    to_low = (np.array(box.low, np.float32) - origin) * some
    to_high = (np.array(box.high, np.float32) - origin) * some
    entries = np.minimum(to_low, to_high)
    entry = entries.max(axis=1)
    hit = (entry > 0) & (entry < np.maximum(to_low, to_high).min(axis=1)) & (entry < distance[near_it])
    rays = near_it[hit]
    axis = entries[hit].argmax(axis=1)
    from_high = directions[rays, axis] < 0
    face[rays] = 6 * (index + 1) + 2 * axis + from_high
    distance[rays] = entry[hit]


@lru_cache(maxsize=256)
def _cone(box: Box) -> tuple[Floats, float]:
    """Return axis and cosine of a cone from the camera that holds the box."""
    corners = np.array([[x, y, z] for x in _ends(box, 0) for y in _ends(box, 1) for z in _ends(box, 2)])
    corners -= [0, 0, CAMERA_HEIGHT_M]
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    centre = corners.mean(axis=0)
    centre /= np.linalg.norm(centre)
    return centre.astype(np.float32), float((corners @ centre).min()) - 1e-3


def _ends(box: Box, axis: int) -> tuple[float, float]:
    return box.low[axis], box.high[axis]


def blocked(plan: RoomPlan, start: Floats, end: Floats) -> npt.NDArray[np.bool_]:
    """Return whether a solid lies between two arrays of points (..., 3), which broadcast."""
    # Axis by axis: NumPy is several times slower when it reduces over a last axis of three.
    starts = [np.ascontiguousarray(start[..., axis]) for axis in range(3)]
    deltas = [end[..., axis] - starts[axis] for axis in range(3)]
    inverses = [1 / np.where(delta == 0, np.float32(1e-12), delta) for delta in deltas]
    hidden = np.zeros(deltas[0].shape, dtype=bool)
    for box in plan.solids:
        entry: Reals | float = -np.inf
        leave: Reals | float = np.inf
        for axis in range(3):
            to_low = (np.float32(box.low[axis]) - starts[axis]) * inverses[axis]
            to_high = (np.float32(box.high[axis]) - starts[axis]) * inverses[axis]
            entry = np.maximum(entry, np.minimum(to_low, to_high))
            leave = np.minimum(leave, np.maximum(to_low, to_high))
        # The margins keep a point on the box's own face from shadowing itself.
        hidden |= (entry < leave) & (leave > 1e-3) & (entry < 1 - 1e-3)
    return hidden


def through_window(plan: RoomPlan, point: Floats, direction: Floats) -> tuple[Floats, Floats, Floats]:
    """Follow rays (N, 3) to the window's outer plane: x there, z there, and the way in metres (inf: not ahead)."""
    plane = plan.high[1] + plan.wall_thickness_m
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (plane - point[..., 1]) / direction[..., 1]
        way = np.where(direction[..., 1] > 1e-6, way, np.float32(np.inf)).astype(np.float32)
        reach = np.where(np.isfinite(way), way, 0)
    return point[..., 0] + direction[..., 0] * reach, point[..., 2] + direction[..., 2] * reach, way


def pane_distance_m(plan: RoomPlan, x: Floats, z: Floats) -> Floats:
    """Return how far inside a glass pane a point of the outer plane is (negative: on frame, bar or wall)."""
    window, frame = plan.window, plan.frame_m
    middle = (window.a0 + window.a1) / 2
    side = np.minimum(x - window.a0, window.a1 - x) - frame
    bar = np.abs(x - middle) - frame / 2
    level = np.minimum(z - window.z0, window.z1 - z) - frame
    return np.asarray(np.minimum(np.minimum(side, bar), level), dtype=np.float32)


def in_window(plan: RoomPlan, x: Floats, z: Floats) -> npt.NDArray[np.bool_]:
    """Return whether points of the window wall's plane lie in its opening."""
    window = plan.window
    return np.asarray((x > window.a0) & (x < window.a1) & (z > window.z0) & (z < window.z1))


def sun_visibility(plan: RoomPlan, point: Floats, sun: Vector, radius_rad: float) -> Floats:
    """Return which fraction of the sun's disc shines through the window onto each point (N, 3), softly edged."""
    out = np.zeros(len(point), dtype=np.float32)
    direction = np.array(sun, dtype=np.float32)
    if direction[1] <= 0:
        return out
    inner = point + direction * ((plan.high[1] - point[:, 1]) / direction[1])[:, None]
    maybe = np.flatnonzero(in_window(plan, inner[:, 0], inner[:, 2]))
    if maybe.size == 0:
        return out
    some = point[maybe]
    x, z, way = through_window(plan, some, np.broadcast_to(direction, some.shape))
    half_shade = np.maximum(way * math.tan(radius_rad), 1e-4)
    lit = np.clip(pane_distance_m(plan, x, z) / half_shade * 0.5 + 0.5, 0, 1)
    hidden = blocked(plan, some, some + direction * way[:, None])
    out[maybe] = np.where(hidden, 0, lit)
    return out
