"""CIE 171:2006, 5.9 to 5.14: daylight through roof and facade openings, unglazed and glazed, by our own scene code.

Black rooms of 4 x 4 x 3 m; the overcast and a uniform sky, ground of albedo 0.3 where it is seen. Against quadrature
(`analytic.through_opening_lux`); glass of 6 mm (0.88 head on, one sheet) by Fresnel's equations written anew here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from benchmarks.light import analytic as _analytic
from benchmarks.light.render_scenes import room_model, sky_outdoors
from processing.light.scene.scene import Outdoors, Pane, Scene, shell_of
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage

HEAD_ON, INDEX, GROUND = 0.88, 1.526, 0.3
UP, IN, ASIDE = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
Vector = tuple[float, float, float]
SKIES = {"overcast": _analytic.overcast, "uniform": _analytic.uniform}


def daylight(samples: int, seed: int) -> dict[str, float]:
    """Return the worst error (%) of openings in roof and facade, unglazed and glazed."""
    worst: dict[str, float] = {}
    for sky in SKIES.values():
        level = GROUND / math.pi * _analytic.open_ground_lux(sky)
        outdoors = sky_outdoors(
            lambda rays, sky=sky: np.repeat(sky(rays[..., 2:]), 3, axis=-1),
            rows=1024,  # type: ignore[misc]
            ground_albedo=GROUND,
        )
        for name, opening, points in _openings():
            for sheets in (0, 1):
                key = f"{name}_{'glazed' if sheets else 'unglazed'}"
                errors = _errors(opening, points, (outdoors, sky, level), sheets, samples, seed)
                worst[key] = max(worst.get(key, 0.0), errors, key=abs)
    return worst


def _openings() -> Iterator[tuple[str, tuple[Vector, Vector, Vector], list[tuple[Vector, Vector]]]]:
    """Yield openings (corner, level side, other side) and points with the way they face, in a room from 0 to 4 m."""
    for side in (1.0, 4.0):
        low = 2 - side / 2
        points: list[tuple[Vector, Vector]] = [((0.5, 2.0, 0.0), UP), ((2.0, 2.0, 0.0), UP), ((0.001, 2.0, 1.5), ASIDE)]
        yield "roof", ((low, low, 3.0), (side, 0.0, 0.0), (0.0, side, 0.0)), points
    for wide, sill, high in ((2.0, 1.0, 1.0), (4.0, 0.0, 3.0)):
        start = 2 - wide / 2
        points = [((2.0, 1.0, 0.0), UP), ((2.0, 3.0, 0.0), UP), ((0.001, 2.0, 1.5), ASIDE)]
        yield "facade", ((start, 0.0, sill), (wide, 0.0, 0.0), (0.0, 0.0, high)), points


def _errors(
    opening: tuple[Vector, Vector, Vector],
    points: list[tuple[Vector, Vector]],
    light: tuple[Outdoors, _analytic.SkyLuminance, float],
    sheets: int,
    samples: int,
    seed: int,
) -> float:
    outdoors, sky, ground = light
    floor = shell_of(room_model(4, 4, 3, None))[0][:1]  # in nobody's way
    corner, across, up = (np.array(v) for v in opening)
    tint = (HEAD_ON,) * 3 if sheets else (1.0, 1.0, 1.0)
    stage = Stage.of(Scene(floor, (Pane(corner, across, up, tint, sheets=sheets),), outdoors), 1.0)
    worst = 0.0
    for place, facing in points:
        many = np.tile(np.float32([[place]]), (200, 1, 1))
        found = skylight(stage, many, np.tile(np.float32([facing]), (200, 1)), samples, (seed, 17)).mean()
        wanted = _analytic.through_opening_lux(
            place,
            facing,
            opening,
            lambda sine: np.where(sine > 0, sky(np.maximum(sine, 0)), ground),
            _glass if sheets else np.ones_like,
        )
        worst = max(worst, 100 * (found / wanted - 1), key=abs)
    return worst


def _glass(cosine: np.ndarray) -> np.ndarray:
    """Return the transmittance of one sheet by summing the rays that bounce within it, polarisation by polarisation."""
    angle = np.arccos(np.clip(cosine, 1e-9, 1))
    inner = np.arcsin(np.sin(angle) / INDEX)
    straight = (1 - INDEX) / (1 + INDEX)
    absorbed = HEAD_ON * (1 + straight**2) / (1 - straight**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        across = np.sin(angle - inner) ** 2 / np.sin(angle + inner) ** 2
        along = np.tan(angle - inner) ** 2 / np.tan(angle + inner) ** 2
    level = np.where(angle < 1e-6, straight**2, np.nan)
    r = [np.where(np.isfinite(level), level, v) for v in (across, along)]
    passed = sum((1 - v) ** 2 * sum(v ** (2 * k) for k in range(60)) for v in r) / 2
    return np.asarray(passed * absorbed ** (1 / np.cos(inner)))
