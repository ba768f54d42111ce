"""Floor, ceiling, walls with their holes, skirting and cornice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from shapely import box as rectangle
from shapely import union_all
from shapely.geometry import Polygon

from mocks.rooms.mesh import Part
from mocks.rooms.model import Door, Finish, Plan, Role, Window
from mocks.rooms.plan_forms import inner_angle_rad
from mocks.rooms.plan_space import openings_of
from mocks.rooms.shell_faces import flat, on_wall, part_of, plan_rng, swept

LAP_M = 0.002
"""How far floor and ceiling reach under the walls, so that no light passes between."""
ARCHITRAVE_M = 0.065
TO_FLOOR_M = 0.15
"""A window with a lower sill interrupts the skirting."""
CORNICE_FROM_M = 2.85


def floor_and_ceiling(plan: Plan, finish: Finish) -> list[Part]:
    """Return floor and ceiling; texture u runs along the longest wall."""
    longest = max(range(len(plan.polygon)), key=plan.wall_length_m)
    (ux, uy), (vx, vy) = plan.wall_axes(longest)
    turned = Polygon([(x * ux + y * uy, x * vx + y * vy) for x, y in plan.polygon])
    area = turned.buffer(LAP_M, join_style="mitre")
    u, v = (ux, uy, 0.0), (vx, vy, 0.0)
    return [
        part_of(flat(area, (0.0, 0.0, 0.0), u, v), finish.floor, "floor", "floor"),
        part_of(flat(area, (0.0, 0.0, plan.height_m), u, v, back=True), finish.ceiling, "ceiling", "ceiling"),
    ]


def walls(plan: Plan, finish: Finish) -> list[Part]:
    """Return one part per wall, with holes for its windows and doors; texture u runs along the wall from its start."""
    return [_wall(plan, finish, wall) for wall in range(len(plan.polygon))]


def _wall(plan: Plan, finish: Finish, wall: int) -> Part:
    length = plan.wall_length_m(wall)
    holes = union_all([_hole(o) for o in openings_of(plan, wall)])
    face = flat(
        rectangle(0.0, 0.0, length, plan.height_m).difference(holes),
        (0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0),
        (0.0, 0.0, 1.0),
        back=True,
    )
    part = on_wall(plan, wall, [part_of(face, finish.wall_material(wall), "wall")])[0]
    # Walls share the polygon's very corners: rounding along an edge must leave no gap.
    vertices = part.mesh.vertices.copy()
    for end, corner in zip((0.0, length), plan.wall_ends(wall), strict=True):
        vertices[np.isclose(face.vertices[:, 0], end, atol=1e-9), :2] = corner
    return replace(part, mesh=replace(part.mesh, vertices=vertices), wall=wall)


def _hole(opening: Window | Door) -> Polygon:
    low, height = (opening.sill_m, opening.height_m) if isinstance(opening, Window) else (0.0, opening.height_m)
    return rectangle(opening.start_m, low, opening.start_m + opening.width_m, low + height)


def mouldings(plan: Plan, finish: Finish) -> list[Part]:
    """Return the skirting, and the cornice of some high rooms."""
    rng = plan_rng(plan, 1)
    thick, high = 0.014, plan.skirting_m
    plain = [(0.0, 0.0), (thick, 0.0), (thick, high - 0.006), (thick - 0.005, high), (0.0, high)]
    old = [(0.0, 0.0), (0.018, 0.0), (0.018, high - 0.035), (0.012, high - 0.028), (0.011, high - 0.012)]
    old += [(0.006, high), (0.0, high)]
    profile = old if high > 0.1 else plain
    with_cornice = plan.height_m > CORNICE_FROM_M and rng.random() < 0.6
    top, drop = plan.height_m, float(rng.uniform(0.07, 0.1))
    out = [(0.0, top - drop), (0.012, top - drop), (0.016, top - 0.75 * drop)]
    bow = [
        (0.016 + 0.7 * drop * math.sin(a), top - 0.1 * drop - 0.65 * drop * math.cos(a)) for a in (0.3, 0.7, 1.1, 1.5)
    ]
    crown = [*out, *bow, (0.8 * drop + 0.016, top), (0.0, top)]
    found: list[Part] = []
    for wall in range(len(plan.polygon)):
        skirts = [swept(profile, a, b, cut) for a, b, cut in _runs(plan, wall)]
        if skirts:
            found += on_wall(plan, wall, [part_of(skirts, finish.trim, "skirting", role=Role.FIXTURE)])
        if with_cornice:
            run = swept(crown, 0.0, plan.wall_length_m(wall), _mitres(plan, wall))
            found += on_wall(plan, wall, [part_of(run, finish.ceiling, "cornice", "ceiling")])
    return found


def _mitres(plan: Plan, wall: int) -> tuple[float, float]:
    corners = (wall, (wall + 1) % len(plan.polygon))
    a, b = (1.0 / math.tan(inner_angle_rad(plan.polygon, corner) / 2) for corner in corners)
    return a, b


def _runs(plan: Plan, wall: int) -> list[tuple[float, float, tuple[float, float]]]:
    """Return the stretches of a wall that have skirting, with the cuts of their ends."""
    gaps = [
        (o.start_m - ARCHITRAVE_M, o.start_m + o.width_m + ARCHITRAVE_M)
        if isinstance(o, Door)
        else (o.start_m, o.start_m + o.width_m)
        for o in openings_of(plan, wall)
        if isinstance(o, Door) or o.sill_m < TO_FLOOR_M
    ]
    first, last = _mitres(plan, wall)
    length = plan.wall_length_m(wall)
    at, cut, runs = 0.0, first, []
    for start, end in sorted(gaps):
        runs.append((at, start, (cut, 0.0)))
        at, cut = end, 0.0
    runs.append((at, length, (cut, last)))
    return [run for run in runs if run[1] - run[0] > 0.02]
