"""Windows: reveals, sill boards, frames with their casements and bars, and the clear panes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely import box as rectangle
from shapely import union_all
from shapely.geometry import Polygon

from mocks.rooms.model import Finish, Part, Plan, Window
from mocks.rooms.shell.surfaces import flat, on_wall, part_of
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh, quad, turned
from processing.ground.shapes import cylinder, rounded_box, tube

FRAME_DEPTH_M = 0.068
CASEMENT_PROUD_M = 0.012
BAR_M = 0.024
BAR_DEPTH_M = 0.042
PLATE_M = 0.03
BOARD_M = 0.022
NOSE_M = 0.032
EAR_M = 0.03
LAP_M = 0.002


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

    def inset(self, by_m: float) -> _Rect:
        return _Rect(self.x0 + by_m, self.z0 + by_m, self.x1 - by_m, self.z1 - by_m)

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
    parts: list[Part] = []
    for window in plan.windows:
        parts += on_wall(plan, window.wall, _window(window, finish))
    return parts


def _opening(window: Window) -> _Rect:
    end, top = window.start_m + window.width_m, window.sill_m + window.height_m
    return _Rect(window.start_m, window.sill_m, end, top)


def _casements(window: Window) -> list[_Rect]:
    """Return the casements side by side within the fixed frame."""
    inner = _opening(window).inset(window.frame_m * 0.5)
    step = (inner.x1 - inner.x0) / window.panes_across
    return [
        _Rect(inner.x0 + i * step, inner.z0, inner.x0 + (i + 1) * step, inner.z1) for i in range(window.panes_across)
    ]


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
    wall = finish.wall_material(window.wall)
    parts = [part_of(_reveal(window), wall, "reveal"), part_of(_plate(window), finish.window_frame, *_FRAME)]
    parts.append(part_of(_frame(window), finish.window_frame, *_FRAME))
    parts.append(part_of(_handles(window), finish.metal, *_FRAME))
    parts.append(part_of(_board(window), finish.trim, "window sill"))
    return parts


_FRAME = ("window frame", "windowpane")


def _reveal(window: Window) -> list[Mesh]:
    """Return the sides, head and bottom of the hole through the wall."""
    o, depth = _opening(window), window.depth_m
    width, height = o.x1 - o.x0, o.z1 - o.z0
    return [
        quad((o.x0, 0, o.z0), (0, 0, height), (0, -depth, 0)),
        quad((o.x1, 0, o.z0), (0, -depth, 0), (0, 0, height)),
        quad((o.x0, 0, o.z1), (width, 0, 0), (0, -depth, 0)),
        quad((o.x0, 0, o.z0), (0, -depth, 0), (width, 0, 0)),
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
    for g in glass:
        width, height = g.x1 - g.x0, g.z1 - g.z0
        faces += [
            quad((g.x0, inner, g.z0), (0, 0, height), (0, -PLATE_M, 0)),
            quad((g.x1, inner, g.z0), (0, -PLATE_M, 0), (0, 0, height)),
            quad((g.x0, inner, g.z1), (width, 0, 0), (0, -PLATE_M, 0)),
            quad((g.x0, inner, g.z0), (0, -PLATE_M, 0), (width, 0, 0)),
        ]
    return faces


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
    a, b, w = (rect.x0, rect.x1, width_m)
    bars = [
        ((a, rect.z0), (a + w, rect.z1)),
        ((b - w, rect.z0), (b, rect.z1)),
        ((a + w - 0.001, rect.z0), (b - w + 0.001, rect.z0 + w)),
        ((a + w - 0.001, rect.z1 - w), (b - w + 0.001, rect.z1)),
    ]
    return [rounded_box((x0, outer_m, z0), (x1, front_m, z1), radius_m) for (x0, z0), (x1, z1) in bars]


def _handles(window: Window) -> list[Mesh]:
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
        lever = tube(
            [(x, front + 0.036, z + 0.009), (x, front + 0.04, z - 0.06), (x, front + 0.036, z - 0.115)], 0.0085
        )
        found += [plate, neck, lever]
    return found


def _board(window: Window) -> Mesh:
    """Return the sill board with its nose and ears; at the floor a threshold."""
    back, z = -window.depth_m + PLATE_M, window.sill_m
    start, end = window.start_m, window.start_m + window.width_m
    if z < 0.1:
        return rounded_box((start, back, z - 0.004), (end, 0.0, z + 0.012), 0.003)
    return rounded_box((start - EAR_M, back, z - BOARD_M), (end + EAR_M, NOSE_M, z + LAP_M), 0.006, 2)
