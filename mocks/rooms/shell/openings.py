"""Windows and doors as meshes: panes, frames, reveals; leaves, jambs, handles, the hallway behind an open door."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from shapely import box as rectangle
from shapely import union_all
from shapely.geometry import Polygon

from mocks.rooms.model import Door, Finish, Part, Plan, Window
from mocks.rooms.plan.forms import HALL_DEPTH_M, HALL_SIDE_M
from mocks.rooms.shell.surfaces import ARCHITRAVE_M, flat, mirrored, on_wall, part_of, plan_rng
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh, box, quad, turned
from processing.ground.shapes import cylinder, rounded_box, tube

FRAME_DEPTH_M = 0.068  # usual window profile (68 mm timber)
CASEMENT_PROUD_M = 0.012  # chosen: how far a casement stands out of its frame
BAR_M = 0.024  # chosen: glazing bar
BAR_DEPTH_M = 0.042  # chosen: its depth
PLATE_M = 0.03  # chosen: from the facade to the frame
BOARD_M = 0.022  # usual window board
NOSE_M = 0.032  # chosen: how far the board stands out
EAR_M = 0.03  # chosen: how far it runs past the reveal
LAP_M = 0.002  # chosen: no gap between meshes


@dataclass(frozen=True)
class Pane:
    """A clear glass rectangle in the plane of the outer wall face: a corner and two sides; u x v looks outside."""

    window: int
    corner: Vector
    u: Vector
    v: Vector


@dataclass(frozen=True)
class _Rect:
    """A rectangle of the wall, in its own frame."""

    x0: float
    z0: float
    x1: float
    z1: float

    def inset(self, by_m: float) -> Self:
        return type(self)(self.x0 + by_m, self.z0 + by_m, self.x1 - by_m, self.z1 - by_m)

    def area(self) -> Polygon:
        return rectangle(self.x0, self.z0, self.x1, self.z1)


def window_panes(plan: Plan) -> list[Pane]:
    """Return the clear panes of all windows, in the room's coordinates."""
    found = []
    for number, window in enumerate(plan.windows):
        (ax, ay), _ = plan.wall_axes(window.wall)
        for glass in _glass(window):
            x, y = plan.on_wall(window.wall, glass.x0, -window.depth_m)
            across, up = glass.x1 - glass.x0, glass.z1 - glass.z0
            found.append(Pane(number, (x, y, glass.z0), (ax * across, ay * across, 0.0), (0.0, 0.0, up)))
    return found


def window_parts(plan: Plan, finish: Finish) -> list[Part]:
    """Return all that belongs to the windows."""
    return [part for window in plan.windows for part in on_wall(plan, window.wall, _window(window, finish))]


def _opening(window: Window) -> _Rect:
    end, top = window.start_m + window.width_m, window.sill_m + window.height_m
    return _Rect(window.start_m, window.sill_m, end, top)


def _casements(window: Window) -> list[_Rect]:
    """Return the casements side by side within the fixed frame."""
    hole = _opening(window).inset(window.frame_m * 0.5)
    step = (hole.x1 - hole.x0) / window.panes_across
    return [_Rect(hole.x0 + i * step, hole.z0, hole.x0 + (i + 1) * step, hole.z1) for i in range(window.panes_across)]


def _lights(window: Window) -> list[_Rect]:
    """Return the glazed opening of each casement, bars included."""
    return [casement.inset(window.frame_m * 0.75) for casement in _casements(window)]


def _glass(window: Window) -> list[_Rect]:
    found = []
    for light in _lights(window):
        step = (light.z1 - light.z0 + BAR_M) / window.panes_up
        for k in range(window.panes_up):
            low = light.z0 + k * step
            found.append(_Rect(light.x0, low, light.x1, low + step - BAR_M))
    return found


def _window(window: Window, finish: Finish) -> list[Part]:
    return [
        part_of(_lined(_opening(window), 0.0, window.depth_m), finish.wall_material(window.wall), "reveal"),
        part_of(_plate(window), finish.window_frame, *_FRAME),
        part_of(_frame(window), finish.window_frame, *_FRAME),
        part_of(_window_handles(window), finish.metal, *_FRAME),
        part_of(_board(window), finish.trim, "window sill"),
    ]


_FRAME = ("window frame", "windowpane")


def _lined(hole: _Rect, front_m: float, depth_m: float) -> list[Mesh]:
    """Return the sides, head and bottom of a hole, from ``front_m`` outwards."""
    width, height = hole.x1 - hole.x0, hole.z1 - hole.z0
    return [
        quad((hole.x0, front_m, hole.z0), (0, 0, height), (0, -depth_m, 0)),
        quad((hole.x1, front_m, hole.z0), (0, -depth_m, 0), (0, 0, height)),
        quad((hole.x0, front_m, hole.z1), (width, 0, 0), (0, -depth_m, 0)),
        quad((hole.x0, front_m, hole.z0), (0, -depth_m, 0), (width, 0, 0)),
    ]


def _plate(window: Window) -> list[Mesh]:
    """Return all that is not glass as one plate at the outer side: light enters through the panes and nowhere else."""
    glass = _glass(window)
    area = _opening(window).inset(-LAP_M).area().difference(union_all([g.area() for g in glass]))
    outer, inner = -window.depth_m, -window.depth_m + PLATE_M
    faces = [
        flat(area, (0.0, outer, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        flat(area, (0.0, inner, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), back=True),
    ]
    return faces + [mesh for g in glass for mesh in _lined(g, inner, PLATE_M)]


def _frame(window: Window) -> list[Mesh]:
    """Return the fixed frame, the casements that stand proud of it and their glazing bars."""
    outer, o = -window.depth_m + 0.004, _opening(window)
    front = -window.depth_m + FRAME_DEPTH_M
    members = _ring(o, window.frame_m * 0.5 + 0.004, outer, front, 0.003)
    for casement, light in zip(_casements(window), _lights(window), strict=True):
        inner = casement.inset(0.0015)
        members += _ring(inner, light.x0 - inner.x0, outer, front + CASEMENT_PROUD_M, 0.005)
        step = (light.z1 - light.z0 + BAR_M) / window.panes_up
        for k in range(1, window.panes_up):
            z = light.z0 + k * step
            low, high = (light.x0 - 0.003, outer, z - BAR_M), (light.x1 + 0.003, outer + BAR_DEPTH_M, z)
            members.append(rounded_box(low, high, 0.006))
    return members


def _ring(rect: _Rect, width_m: float, outer_m: float, front_m: float, radius_m: float) -> list[Mesh]:
    """Return four members around a rectangle, the uprights over the full height."""
    a, b, w = rect.x0, rect.x1, width_m
    bars = [
        ((a, rect.z0), (a + w, rect.z1)),
        ((b - w, rect.z0), (b, rect.z1)),
        ((a + w - 0.001, rect.z0), (b - w + 0.001, rect.z0 + w)),
        ((a + w - 0.001, rect.z1 - w), (b - w + 0.001, rect.z1)),
    ]
    return [rounded_box((x0, outer_m, z0), (x1, front_m, z1), radius_m) for (x0, z0), (x1, z1) in bars]


def _window_handles(window: Window) -> list[Mesh]:
    """Return a handle on each casement, on the side where it opens, pointing down."""
    front = -window.depth_m + FRAME_DEPTH_M + CASEMENT_PROUD_M
    casements = _casements(window)
    found = []
    for i, casement in enumerate(casements):
        at_end = i % 2 == 0 and i + 1 < len(casements)
        if not at_end and i % 2 == 1:
            continue  # Its neighbour's handle closes both.
        x = casement.x1 - window.frame_m * 0.38 if at_end else casement.x0 + window.frame_m * 0.38
        z = casement.z0 + 0.45 * (casement.z1 - casement.z0)
        plate = rounded_box((x - 0.013, front - 0.002, z - 0.035), (x + 0.013, front + 0.009, z + 0.035), 0.006, 2)
        neck = turned(cylinder((x, front, z), 0.008, 0.036, 0.002, 12), (1.0, 0.0, 0.0), -np.pi / 2, (x, front, z))
        bow = [(x, front + 0.036, z + 0.009), (x, front + 0.04, z - 0.06), (x, front + 0.036, z - 0.115)]
        found += [plate, neck, tube(bow, 0.0085)]
    return found


def _board(window: Window) -> Mesh:
    """Return the sill board with its nose and ears; at the floor a threshold."""
    back, z = -window.depth_m + PLATE_M, window.sill_m
    start, end = window.start_m, window.start_m + window.width_m
    if z < 0.1:
        return rounded_box((start, back, z - 0.004), (end, 0.0, z + 0.012), 0.003)
    return rounded_box((start - EAR_M, back, z - BOARD_M), (end + EAR_M, NOSE_M, z + LAP_M), 0.006, 2)


LEAF_M = 0.04  # usual interior door, 40 mm
GAP_M = 0.003  # usual gap around a leaf
UNDERCUT_M = 0.007  # usual gap under a leaf
KNUCKLE_M = 0.016  # the hinge's axis before the wall's face: an opened leaf stands clear of the architrave
CASING_M = 0.015  # chosen: how far it stands out
HANDLE_M = 1.03  # usual height of handles
HALL_OVER_M = 0.2  # chosen: the hall's ceiling above the door
STYLES = ("flat", "two panels", "four panels", "three panels", "grooves")


def door_parts(plan: Plan, finish: Finish) -> list[Part]:
    """Return all that belongs to the doors; those of one room are alike."""
    style = str(plan_rng(plan, 2).choice(STYLES, p=[0.28, 0.24, 0.2, 0.16, 0.12]))
    parts: list[Part] = []
    for door in plan.doors:
        own = [part_of(_lining(door), finish.trim, "door frame", "door"), *_leaf(door, finish, style)]
        parts += on_wall(plan, door.wall, own + _hallway(door, plan, finish))
    return parts


def _lining(door: Door) -> list[Mesh]:
    """Return the lined hole through the wall, the stop that the leaf shuts against, and both architraves."""
    x0, x1, h, depth = door.start_m, door.start_m + door.width_m, door.height_m, door.depth_m
    lining = _lined(_Rect(x0, 0.0, x1, h), 0.0, depth)[:3]  # its bottom is the threshold
    shut = GAP_M + LEAF_M
    back, front = (-shut - 0.03, -shut) if door.opens == "in" else (-depth + shut, -depth + shut + 0.03)
    e, t = 0.001, 0.012
    stops = [
        rounded_box((x0 - e, back, 0.0), (x0 + t, front, h), 0.002),
        rounded_box((x1 - t, back, 0.0), (x1 + e, front, h), 0.002),
        rounded_box((x0, back, h - t), (x1, front, h + e), 0.002),
    ]
    a = ARCHITRAVE_M
    casing = [
        rounded_box((x0 - a, -e, 0.0), (x0, CASING_M, h + a), 0.004, 2),
        rounded_box((x1, -e, 0.0), (x1 + a, CASING_M, h + a), 0.004, 2),
        rounded_box((x0 - e, -e, h), (x1 + e, CASING_M, h + a), 0.004, 2),
    ]
    hall_casing = [replace(mirrored(m, 1), vertices=mirrored(m, 1).vertices - (0.0, depth, 0.0)) for m in casing]
    return [*lining, *stops, *casing, *hall_casing]


def _leaf(door: Door, finish: Finish, style: str) -> list[Part]:
    """Return the leaf where it hangs. It is made shut with its hinge at the origin, opening towards +y."""
    width, height = door.width_m, door.height_m
    slab = _slab(width - 2 * GAP_M, height - UNDERCUT_M - GAP_M, style)
    # The knuckles of two hinges lie at the axis that the leaf turns about.
    hinges = [cylinder((0.0, KNUCKLE_M - 0.006, z), 0.007, 0.09, 0.003, 12) for z in (0.2, height - 0.3)]

    def hung(mesh: Mesh) -> Mesh:
        mesh = turned(mesh, (0.0, 0.0, 1.0), door.open_rad, (0.0, KNUCKLE_M, 0.0))
        x, y = door.start_m, 0.0
        if door.hinge == "end":
            mesh, x = mirrored(mesh, 0), door.start_m + width
        if door.opens == "out":
            mesh, y = mirrored(mesh, 1), -door.depth_m
        return replace(mesh, vertices=mesh.vertices + np.array([x, y, 0.0]))

    return [
        part_of([hung(m) for m in slab], finish.door, "door", "door"),
        part_of([hung(m) for m in _lever_handles(width) + hinges], finish.metal, "door", "door"),
    ]


def _slab(width: float, height: float, style: str) -> list[Mesh]:
    """Return the leaf with its panels on both faces, which lie ``GAP_M`` and ``GAP_M + LEAF_M`` behind the wall."""
    x0, z0, front, back = GAP_M, UNDERCUT_M, -GAP_M, -GAP_M - LEAF_M
    fields = _fields(style, width, height)
    if not fields:
        return [rounded_box((x0, back, z0), (x0 + width, front, z0 + height), 0.002)]
    sunk = 0.012 if style != "grooves" else 0.004
    area = rectangle(0.0, 0.0, width, height)
    for field in fields:
        area = area.difference(rectangle(*field))
    inner = 0.001
    core = box((x0 + inner, back + sunk, z0 + inner), (x0 + width - inner, front - sunk, z0 + height - inner))
    found = [
        core,
        flat(area, (x0, front, z0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), back=True),
        flat(area, (x0, back, z0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        *_edges(x0, z0, width, height, front, back),
    ]
    for a, b, c, d in fields:
        for face, inwards in ((front, -sunk), (back, sunk)):
            found += _bevel((x0 + a, z0 + b, x0 + c, z0 + d), face, inwards)
            if style != "grooves":
                y0, y1 = sorted((face + inwards * 1.3, face + inwards * 0.35))
                m = 0.045
                found.append(rounded_box((x0 + a + m, y0, z0 + b + m), (x0 + c - m, y1, z0 + d - m), 0.005))
    return found


def _fields(style: str, width: float, height: float) -> list[tuple[float, float, float, float]]:
    """Return the sunk fields of a leaf, as x0, z0, x1, z1 from its lower hinge corner."""
    stile, rail, foot = 0.115, 0.115, 0.2
    left, right, middle = stile, width - stile, width / 2
    lock = 0.95
    if style == "two panels":
        return [(left, foot, right, lock - rail / 2), (left, lock + rail / 2, right, height - rail)]
    if style == "four panels":
        halves = ((left, middle - 0.05), (middle + 0.05, right))
        rows = ((foot, lock - 0.2), (lock - 0.02, height - rail))
        return [(a, b, c, d) for a, c in halves for b, d in rows]
    if style == "three panels":
        step = (height - foot - rail + 0.09) / 3
        return [(left, foot + k * step, right, foot + (k + 1) * step - 0.09) for k in range(3)]
    if style == "grooves":
        return [(0.002, z, width - 0.002, z + 0.008) for z in np.arange(1, 5) * height / 5]
    return []


def _bevel(field: tuple[float, float, float, float], face_m: float, sunk_m: float) -> list[Mesh]:
    """Return the slanted rim of a sunk field: four faces from the leaf's surface down to its bottom."""
    x0, z0, x1, z1 = field
    slope = min(abs(sunk_m), (z1 - z0) * 0.45)
    outer = np.array([(x0, z0), (x1, z0), (x1, z1), (x0, z1)])
    inner = outer + slope * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    found = []
    for k in range(4):
        n = (k + 1) % 4
        ring = [(*outer[k], face_m), (*outer[n], face_m), (*inner[n], face_m + sunk_m), (*inner[k], face_m + sunk_m)]
        corners = np.array([(x, y, z) for x, z, y in ring])
        normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
        normal /= np.linalg.norm(normal)
        if normal[1] * sunk_m > 0:  # Faces look out of the leaf, against the way the field is sunk.
            corners, normal = corners[::-1], -normal
        uv = np.ascontiguousarray(corners[:, [0, 2]])
        found.append(Mesh(corners, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))
    return found


def _edges(x0: float, z0: float, width: float, height: float, front: float, back: float) -> list[Mesh]:
    thick = front - back
    return [
        quad((x0, back, z0), (0, 0, height), (0, thick, 0)),
        quad((x0 + width, back, z0), (0, thick, 0), (0, 0, height)),
        quad((x0, back, z0), (0, thick, 0), (width, 0, 0)),
        quad((x0, back, z0 + height), (width, 0, 0), (0, thick, 0)),
    ]


def _lever_handles(width: float) -> list[Mesh]:
    """Return rose, neck, lever and key plate on both faces."""
    x, z = width - 0.065, HANDLE_M
    found = []
    for face, way in ((-GAP_M, 1.0), (-GAP_M - LEAF_M, -1.0)):
        start = (x, face, z)
        turn = -way * math.pi / 2
        rose = turned(cylinder(start, 0.026, 0.008, 0.003), (1.0, 0.0, 0.0), turn, start)
        neck = turned(cylinder(start, 0.0095, 0.048, 0.0, 14), (1.0, 0.0, 0.0), turn, start)
        y = face + way * 0.047
        lever = tube([(x + 0.009, y, z), (x - 0.05, y + way * 0.003, z), (x - 0.12, y, z - 0.002)], 0.0095, 12)
        low = (x, face, z - 0.075)
        plate = turned(cylinder(low, 0.024, 0.006, 0.002), (1.0, 0.0, 0.0), turn, low)
        found += [rose, neck, lever, plate]
    return found


def _hallway(door: Door, plan: Plan, finish: Finish) -> list[Part]:
    """Return the closed, dark room behind: its walls, floor and ceiling look inwards."""
    x0, x1 = door.start_m - HALL_SIDE_M, door.start_m + door.width_m + HALL_SIDE_M
    near, far = -door.depth_m, -door.depth_m - HALL_DEPTH_M
    top = min(door.height_m + HALL_OVER_M, plan.height_m)
    wide, deep = x1 - x0, near - far
    hole = rectangle(door.start_m, 0.0, door.start_m + door.width_m, door.height_m)
    face = rectangle(x0, 0.0, x1, top).difference(hole)
    sides = [
        flat(face, (0.0, near, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        quad((x0, far, 0), (0, 0, top), (wide, 0, 0)),
        quad((x0, far, 0), (0, deep, 0), (0, 0, top)),
        quad((x1, far, 0), (0, 0, top), (0, deep, 0)),
    ]
    floor = quad((x0, far, 0), (wide, 0, 0), (0, deep, 0))
    threshold = quad((door.start_m, near, 0), (door.width_m, 0, 0), (0, door.depth_m, 0), (door.start_m - x0, deep))
    return [
        part_of(sides, finish.wall, "hallway"),
        part_of([floor, threshold], finish.floor, "hallway", "floor"),
        part_of(quad((x0, far, top), (0, deep, 0), (wide, 0, 0)), finish.ceiling, "hallway", "ceiling"),
    ]
