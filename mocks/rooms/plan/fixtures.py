"""What is fixed to the walls and ceiling of an empty room: heating, sockets, curtains and blinds, lamps."""

from dataclasses import replace
from typing import Any

import numpy as np
from shapely import maximum_inscribed_circle
from shapely.geometry import Point as Spot
from shapely.geometry import Polygon

from mocks.rooms.model import Fixture, Plan, Point, Use, Window
from mocks.rooms.plan.forms import TRIM_M, openings_of
from mocks.rooms.plan.openings import fixture_problems

RADIATOR_BOTTOM_M = 0.12  # usual clearance above the floor
PLATE_M = 0.081  # usual size of switches (81 mm)
CLOTH_DEPTH_M = 0.13  # how far curtains hang into the room
ROD_OVER_M = 0.1  # height of a curtain rod above its window


def draw_fixtures(rng: np.random.Generator, plan: Plan, lamps_on: bool) -> Plan:
    """Return the plan with fixtures; each is left out where it does not fit."""
    plan = _with_radiators(rng, plan)
    plan = _with_switches(rng, plan)
    plan = _with_window_cloth(rng, plan)
    plan = _with_sockets(rng, plan)
    return _with_lamps(rng, plan, lamps_on)


def _add(plan: Plan, *fixtures: Fixture) -> Plan:
    """Return the plan with the fixtures if all of them fit, else as it was."""
    rounded = []
    for f in fixtures:
        sizes: dict[str, Any] = {n: round(getattr(f, n), 4) for n in ("start_m", "width_m", "bottom_m", "height_m")}
        rounded.append(replace(f, centre=(round(f.centre[0], 4), round(f.centre[1], 4)), **sizes))
    candidate = replace(plan, fixtures=(*plan.fixtures, *rounded))
    return plan if fixture_problems(candidate) else candidate


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(1, 2**31))


def _with_radiators(rng: np.random.Generator, plan: Plan) -> Plan:
    kind = "column radiator" if plan.height_m > 2.8 and rng.random() < 0.6 else "panel radiator"
    if rng.random() < 0.2:
        return plan
    seed, share = _seed(rng), float(rng.uniform(0.7, 1.0))
    deep = float(rng.choice([0.1, 0.13, 0.16]))
    for window in plan.windows:
        if window.sill_m < 0.4 or rng.random() < 0.2:
            continue
        width = min(max(share * window.width_m, 0.4), 1.8)
        height = min(0.6, window.sill_m - RADIATOR_BOTTOM_M - 0.1)
        start = window.start_m + (window.width_m - width) / 2
        plan = _add(plan, Fixture(kind, window.wall, start, width, RADIATOR_BOTTOM_M, height, deep, seed=seed))
    if not plan.fixtures:
        wall = int(rng.integers(len(plan.polygon)))
        width, start = float(rng.uniform(0.45, 0.6)), float(rng.uniform(0.1, 0.9)) * plan.wall_length_m(wall)
        plan = _add(plan, Fixture("panel radiator", wall, start, width, RADIATOR_BOTTOM_M, 1.7, 0.1, seed=seed))
    return plan


def _with_switches(rng: np.random.Generator, plan: Plan) -> Plan:
    """Add a light switch at each door's handle side (or its other side), sometimes a thermostat above it."""
    for door in plan.doors:
        bottom = 1.1 - PLATE_M / 2
        aside = TRIM_M + float(rng.uniform(0.06, 0.12))
        sides = (door.start_m + door.width_m + aside, door.start_m - aside - PLATE_M)
        for start in sides if door.hinge == "start" else sides[::-1]:
            before = len(plan.fixtures)
            plan = _add(plan, Fixture("switch", door.wall, start, PLATE_M, bottom, PLATE_M, 0.011, seed=_seed(rng)))
            if len(plan.fixtures) > before:
                if rng.random() < 0.3:
                    plan = _add(plan, Fixture("thermostat", door.wall, start, PLATE_M, 1.42, PLATE_M, 0.025))
                break
    return plan


def _with_sockets(rng: np.random.Generator, plan: Plan) -> Plan:
    bottom = float(rng.choice([0.22, 0.26, 0.3]))
    for wall in range(len(plan.polygon)):
        for _ in range(int(rng.integers(0, 3))):
            width = PLATE_M * int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15]))
            start = float(rng.uniform(0.15, 1.0)) * plan.wall_length_m(wall)
            plan = _add(plan, Fixture("socket", wall, start, width, bottom, PLATE_M, 0.01, seed=_seed(rng)))
    return plan


def _with_window_cloth(rng: np.random.Generator, plan: Plan) -> Plan:
    choice = str(rng.choice(["none", "curtains", "roller blind", "venetian blind"], p=[0.34, 0.36, 0.17, 0.13]))
    seed, long = _seed(rng), rng.random() < 0.7
    drawn = float(rng.uniform(0.1, 0.6))
    for window in plan.windows:
        if choice == "curtains":
            plan = _with_curtains(rng, plan, window, seed, long)
        elif choice != "none" and rng.random() < 0.9 and window.depth_m >= 0.2:
            share = drawn if choice == "roller blind" else float(rng.choice([0.14, 0.5, 0.99], p=[0.4, 0.2, 0.4]))
            height = share * (window.height_m - 0.02)
            bottom = window.sill_m + window.height_m - 0.005 - height
            start, width = window.start_m + 0.01, window.width_m - 0.02
            plan = _add(plan, Fixture(choice, window.wall, start, width, bottom, height, 0.02, seed=seed))
    return plan


def _with_curtains(rng: np.random.Generator, plan: Plan, window: Window, seed: int, long: bool) -> Plan:
    """Add a rod and two gathered curtains, or a single one; none if anything is in the way."""
    top = min(window.sill_m + window.height_m + ROD_OVER_M, plan.height_m - 0.05)
    # How far a rod may reach along the wall: to a corner or half way to the next opening at most
    side_m = float(rng.uniform(0.2, 0.35))
    left, right = 0.03, plan.wall_length_m(window.wall) - 0.03
    for other in (o for o in openings_of(plan, window.wall) if o is not window):
        if other.start_m > window.start_m:
            right = min(right, (window.start_m + window.width_m + other.start_m) / 2 - 0.02)
        else:
            left = max(left, (other.start_m + other.width_m + window.start_m) / 2 + 0.02)
    start, end = max(left, window.start_m - side_m), min(right, window.start_m + window.width_m + side_m)
    gather = min(max(0.2 * window.width_m, 0.2), 0.45)
    widths = [gather, gather]
    if rng.random() < 0.2:
        widths[int(rng.integers(2))] = gather + 0.45 * window.width_m
    sides = [0, 1] if rng.random() < 0.85 else [int(rng.integers(2))]
    rod = Fixture("curtain rod", window.wall, start, end - start, top - 0.03, 0.045, CLOTH_DEPTH_M, seed=seed)
    for bottom in (0.02, window.sill_m - 0.08) if long else (window.sill_m - 0.08,):
        low = max(bottom, 0.02)
        places = (start + 0.03, end - 0.03 - widths[1])
        shape = (low, top - 0.02 - low, CLOTH_DEPTH_M)
        cloths = [Fixture("curtain", window.wall, places[k], widths[k], *shape, seed=seed + k) for k in sides]
        changed = _add(plan, rod, *cloths)
        if changed is not plan:
            return changed
    return plan


def _with_lamps(rng: np.random.Generator, plan: Plan, lamps_on: bool) -> Plan:
    kind = str(rng.choice(["dome lamp", "disc lamp", "pendant lamp", "spot", "none"], p=[0.28, 0.2, 0.27, 0.15, 0.1]))
    if kind == "none" and not lamps_on and plan.use is Use.EMPTY:
        return plan
    if kind == "spot":
        return _with_spots(rng, plan, lamps_on)
    kind = "dome lamp" if kind == "none" else kind
    middle = Spot(maximum_inscribed_circle(Polygon(plan.polygon), tolerance=0.02).coords[0])
    width = float(rng.uniform(*{"dome lamp": (0.28, 0.42), "disc lamp": (0.3, 0.5), "pendant lamp": (0.3, 0.55)}[kind]))
    drop = 0.0
    seed = _seed(rng)
    for attempt in range(8):
        if kind == "pendant lamp":
            drop = min(float(rng.uniform(0.5, 1.0)), plan.height_m - 1.85)
        height = {"dome lamp": 0.12, "disc lamp": 0.06}.get(kind, drop)
        spread = 0.12 + 0.1 * attempt
        place = (middle.x + float(rng.normal(0, spread)), middle.y + float(rng.normal(0, spread)))
        changed = _add(plan, _ceiling(plan, kind, place, width, height, lamps_on, seed))
        if changed is not plan:
            return changed
    return _add(plan, _ceiling(plan, "disc lamp", (middle.x, middle.y), 0.35, 0.06, lamps_on, seed))


def _with_spots(rng: np.random.Generator, plan: Plan, lamps_on: bool) -> Plan:
    """Add recessed spots in rows parallel to the longest wall."""
    longest = max(range(len(plan.polygon)), key=plan.wall_length_m)
    clear = Polygon(plan.polygon).buffer(-0.45)
    length = plan.wall_length_m(longest)
    # How far the room reaches from that wall's line
    (x0, y0), _ = plan.wall_ends(longest)
    _, inward = plan.wall_axes(longest)
    away = max((x - x0) * inward[0] + (y - y0) * inward[1] for x, y in plan.polygon)
    across, up = max(2, round(length / float(rng.uniform(1.3, 1.9)))), max(2, round(away / 1.6))
    seed = _seed(rng)
    for i in range(across):
        for j in range(up):
            place = plan.on_wall(longest, length * (i + 0.5) / across, away * (j + 0.5) / up)
            if clear.contains(Spot(place)):
                plan = _add(plan, _ceiling(plan, "spot", place, 0.08, 0.012, lamps_on, seed))
    return plan


def _ceiling(plan: Plan, kind: str, place: Point, width_m: float, height_m: float, lit: bool, seed: int) -> Fixture:
    bottom = plan.height_m - height_m
    return Fixture(kind, -1, 0.0, width_m, bottom, height_m, width_m, centre=place, lit=lit, seed=seed)
