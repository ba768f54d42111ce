"""Draw the plan of an empty room: its outline about the camera, windows, doors and fixtures. Same seed, same plan."""

from __future__ import annotations

import numpy as np

from mocks.rooms.model import Plan, Use
from mocks.rooms.plan_check import check_plan
from mocks.rooms.plan_fixtures import draw_fixtures
from mocks.rooms.plan_forms import Outline, draw_camera, draw_outline, draw_turn_rad, rectangle, seen_from
from mocks.rooms.plan_openings import draw_doors, draw_windows

__all__ = ["check_plan", "draw_plan"]

ATTEMPTS = 40
FALLBACK_M = (4.2, 3.6)
"""Sides of the rectangle that is used should no form fit."""


def draw_plan(rng: np.random.Generator, use: Use, *, lamps_on: bool = False) -> Plan:
    """Return a valid plan (`check_plan` finds nothing). ``lamps_on`` lights its ceiling lamps."""
    for _ in range(ATTEMPTS):
        outline = draw_outline(rng, use)
        camera = draw_camera(rng, outline.points)
        if camera is None:
            continue
        plan = _furnish(rng, use, seen_from(outline, camera, draw_turn_rad(rng)), lamps_on)
        if plan is not None:
            return plan
    width, depth = FALLBACK_M
    still = np.random.default_rng(0)
    outline = seen_from(rectangle(width, depth), (width / 2, depth / 2), 0.0)
    return next(p for p in (_furnish(still, use, outline, lamps_on) for _ in range(ATTEMPTS)) if p is not None)


def _furnish(rng: np.random.Generator, use: Use, outline: Outline, lamps_on: bool) -> Plan | None:
    """Return the outline with height, openings and fixtures; None if that did not come out valid."""
    tall = rng.random() < 0.22
    height = float(rng.uniform(2.8, 3.4) if tall else rng.uniform(2.36, 2.75))
    skirting = float(rng.uniform(0.1, 0.16) if tall else rng.uniform(0.05, 0.09))
    bare = Plan(use, outline.points, round(height, 3), (), (), skirting_m=round(skirting, 3))
    plan = draw_doors(rng, draw_windows(rng, bare, outline.bay))
    if plan is None:
        return None
    plan = draw_fixtures(rng, plan, lamps_on)
    return None if check_plan(plan) else plan
