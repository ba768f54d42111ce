"""Relighting from stored rays against direct renders; the sun's place; other viewpoints against simulated truth.

Rooms of test seeds (floor, height, windows as drawn; plain colours, three boxes), under clear and overcast skies of
other times. ``median_err_pct`` and ``p95_err_pct``: luminance of relit pictures against long direct renders, which
nothing cleans. ``speedup``: CPU time of a fresh render (4 rays a pixel, cleaned) over that of another light from a
ready basis, lowered by the square of their rms errors' ratio where ours is larger. ``day_ratio``: basis, view and
twelve lights over one fresh render (wanted: at most 3). ``sun_err_deg``: direction of the sun in room axes against
pvlib's own figures, largest. ``viewpoint_median_err_pct``: a simulated room's emptied
panorama shown from 0.6 m lower, against the simulated room from there, what the camera saw but for windows;
``viewpoint_seen_pct`` how much of it that is.
"""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

import numpy as np

from benchmarks._paired import Cost, cost_of
from benchmarks._render_scenes import _box
from benchmarks._truth_rooms import QUALITY, kept_list, room_model_of, truth_of
from benchmarks.albedo import outdoors_of_room, picture
from benchmarks.seeds import seeds
from mocks.light import Site
from mocks.rooms.room import make_room
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from processing.calibration.clear_sky import Place
from processing.images import LUMINANCE_WEIGHTS
from processing.relighting.weather import daylight_at, sun_direction, usual_weather
from processing.rendering.albedo import albedo_of_room
from processing.rendering.irradiance import Effort
from processing.rendering.outdoor import sky_outdoors
from processing.rendering.relight import RelightView
from processing.rendering.relight_basis import BasisEffort, basis_of
from processing.rendering.render import render
from processing.rendering.scene import Outdoors, Scene, Vector, plain
from processing.rendering.shell import shell_of
from processing.rendering.sight import sight_of
from processing.rendering.stage import Stage
from processing.rendering.viewpoint import seen_from
from processing.sphere import Equirectangular

WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)
HERE = Place(40.44, -79.99)
TIMES = (
    datetime(2025, 3, 20, 14, tzinfo=UTC),
    datetime(2025, 6, 21, 20, tzinfo=UTC),
    datetime(2025, 12, 5, 17, tzinfo=UTC),
)
LOWER_M = 0.6
FRESH = Effort(pixel_samples=4)
DARK = sky_outdoors(lambda rays: np.zeros(rays.shape), rows=16)


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    rows = 128 if quick else 256
    found = [against_renders(number, rows, quick=quick) for number in seeds("test", 1 if quick else 8, seed)]
    errors = np.concatenate([one["errors"] for one in found])
    ours, theirs = (float(np.sqrt(np.mean([one[key] ** 2 for one in found]))) for key in ("rms", "fresh_rms"))
    relit_s, fresh_s, ready_s = (
        float(np.median([one[key] for one in found])) for key in ("relit_s", "fresh_s", "ready_s")
    )
    metrics = {
        "speedup": round(fresh_s / relit_s * min(1.0, (theirs / ours) ** 2), 1),
        "median_err_pct": round(100 * float(np.median(errors)), 3),
        "p95_err_pct": round(100 * float(np.quantile(errors, 0.95)), 3),
        "rms_err_pct": round(100 * ours, 3),
        "bias_pct": round(100 * float(np.mean([one["bias"] for one in found])), 3),
        "told_err_pct": round(100 * float(np.mean([one["told"] for one in found])), 3),
        "cpu_s": round(relit_s, 3),
        "ready_cpu_s": round(ready_s, 3),
        "basis_mb": round(float(np.median([one["basis_mb"] for one in found])), 1),
        "day_ratio": round((ready_s + 12 * relit_s) / fresh_s, 2),
        "sun_err_deg": round(sun_error_deg(100 if quick else 10_000, seed), 5),
    }
    views = [viewpoint(*one) for one in kept_list("test", 16, seed)[: 1 if quick else 8]]
    metrics |= {
        "viewpoint_median_err_pct": round(100 * float(np.median([v[0] for v in views])), 2),
        "viewpoint_seen_pct": round(100 * float(np.median([v[1] for v in views])), 2),
        "rooms": len(found),
    }
    rival = {"cpu_s": round(fresh_s, 3), "rms_err_pct": round(100 * theirs, 3)}
    return {"metrics": metrics, "rivals": {"fresh_render": rival}, "units": {"sun_err_deg": "degrees"}}


def scene_of_seed(number: int) -> tuple[Scene, Vector]:
    """Return a room of a seed's plan in plain colours, with boxes, and the place of its camera."""
    room = room_model_of(make_room(number))
    rng = np.random.default_rng([number, 5])
    colours = {"floor": rng.uniform(0.1, 0.4, 3), "ceiling": np.full(3, 0.8)}
    walls = rng.uniform(0.4, 0.75, 3)

    def albedo(name: str) -> Any:
        return plain(tuple(float(v) for v in colours.get(name, walls)))

    surfaces, panes = shell_of(
        room, reveal_m=0.2, albedo=albedo, transmittance=dict.fromkeys(range(64), (0.7, 0.72, 0.7))
    )
    around = [(1.2, 0.3), (-1.1, 0.6), (0.2, -1.2)]
    boxes = tuple(
        _box((x, y, h / 2), (0.6, 0.8, h), (0.5, 0.35, 0.25)) for (x, y), h in zip(around, (0.4, 0.8, 0.5), strict=True)
    )
    return Scene(surfaces, panes, DARK, boxes), (0.0, 0.0, room.camera_height_m)


def lights_of_seed(number: int, *, quick: bool) -> list[Outdoors]:
    """Return other lights: clear skies of several times, and an overcast one."""
    heading = float(np.random.default_rng([number, 6]).uniform(0, 2 * math.pi))
    kinds = [("clear", t) for t in TIMES[1 : 2 if quick else None]] + [("overcast", TIMES[0])]
    return [daylight_at(t, HERE, heading, usual_weather(kind), DARK).outdoors for kind, t in kinds]  # type: ignore[arg-type]


def against_renders(number: int, rows: int, *, quick: bool) -> dict[str, Any]:
    """Return errors and costs of one room's lights."""
    scene, eye = scene_of_seed(number)
    geometry, effort = Equirectangular(2 * rows, rows), BasisEffort(rows=rows)
    fresh_effort = replace(FRESH, rows=rows)
    long = replace(FRESH, rows=rows, pixel_samples=192, patch_samples=256, sun_samples=256, clean=False)
    lights = lights_of_seed(number, quick=quick)
    made: list[RelightView] = []

    def ready() -> None:
        stage = Stage.of(scene, effort.texel_m)
        made.append(RelightView(stage, basis_of(stage, eye, effort=effort), rows))

    ready()
    made[0].relit(lights[0])
    ready_cost = cost_of(ready)
    solid = sight_of(made[0].stage, geometry, eye).solid.reshape(rows, 2 * rows)
    render(scene.under(lights[0]), geometry, eye, effort=fresh_effort)
    errors, fresh_errors, told, bias = [], [], [], []
    costs: dict[str, list[Cost]] = {"relit": [], "fresh": []}
    for light in lights:
        lit = scene.under(light)
        truth = (render(lit, geometry, eye, effort=long, seed=91).rgb @ WEIGHTS)[solid]
        pictures: list[Any] = []
        costs["relit"].append(_third(partial(_kept, pictures, partial(made[0].relit, light))))
        fresh_render = partial(render, lit, geometry, eye, effort=fresh_effort, seed=3)
        costs["fresh"].append(cost_of(partial(_kept, pictures, fresh_render)))
        ours, theirs = ((one.rgb @ WEIGHTS)[solid] for one in (pictures[0], pictures[-1]))
        usable = truth > 1e-3 * np.median(truth)
        errors.append(ours[usable] / truth[usable] - 1)
        fresh_errors.append(theirs[usable] / truth[usable] - 1)
        told.append(pictures[0].error)
        bias.append(ours.sum() / truth.sum() - 1)
    every, fresh = np.concatenate(errors), np.concatenate(fresh_errors)
    return {
        "errors": np.abs(every),
        "rms": _rms(every),
        "fresh_rms": _rms(fresh),
        "told": float(np.mean(told)),
        "bias": float(np.mean(bias)),
        "relit_s": float(np.median([c.cpu_s for c in costs["relit"]])),
        "fresh_s": float(np.median([c.cpu_s for c in costs["fresh"]])),
        "ready_s": ready_cost.cpu_s,
        "basis_mb": made[0].basis.bytes / 2**20,
    }


def _kept(pictures: list[Any], work: Any) -> None:
    pictures.append(work())


def _third(work: Any) -> Cost:
    """Return the cost of one of three runs: CPU seconds come in ticks."""
    whole = cost_of(lambda: [work() for _ in range(3)])
    return Cost(whole.cpu_s / 3, whole.wall_s / 3)


def _rms(relative: np.ndarray) -> float:
    """Return the root mean square, the worst per mille (single pixels at the edge of the sun) left out."""
    kept = np.abs(relative) <= np.quantile(np.abs(relative), 0.999)
    return float(np.sqrt(np.mean(relative[kept] ** 2)))


def sun_error_deg(count: int, seed: int) -> float:
    """Return the largest angle between our sun in room axes and pvlib's, by times, places and headings."""
    import pandas as pd
    from pvlib.solarposition import spa_python

    from processing.calibration.clear_sky import sun_place

    rng = np.random.default_rng([seed, 7])
    start = datetime(2000, 1, 1, tzinfo=UTC)
    places = [Place(float(rng.uniform(-65, 65)), float(rng.uniform(-180, 180))) for _ in range(20)]
    worst = 0.0
    for place in places:
        times = [start + timedelta(minutes=int(m)) for m in rng.integers(0, 50 * 525_960, count // 20)]
        theirs = spa_python(pd.DatetimeIndex(times), place.latitude_deg, place.longitude_deg)
        for time_utc, azimuth, elevation in zip(times, theirs["azimuth"], theirs["apparent_elevation"], strict=True):
            heading = float(rng.uniform(0, 2 * math.pi))
            ours = np.array(sun_direction(sun_place(time_utc, place), heading))
            level = math.cos(math.radians(elevation))
            across = math.radians(azimuth) - heading
            goal = np.array([math.sin(across) * level, math.cos(across) * level, math.sin(math.radians(elevation))])
            worst = max(worst, math.degrees(2 * math.asin(min(float(np.linalg.norm(ours - goal)) / 2, 1.0))))
    return worst


def viewpoint(number: int, use: Any) -> tuple[float, float]:
    """Return the median relative error of what the camera saw, shown from lower down, and its share."""
    room, truth = truth_of(number, use)
    found = albedo_of_room(
        picture(truth.empty_rgb), room_model_of(room), outdoors_of_room(room), reveal_m=0.24, rows=256
    )
    x, y, z = room.eye
    lower = (x, y, z - LOWER_M)
    geometry = Equirectangular(256, 128)
    ours = seen_from(found.scene, truth.empty_rgb, room.eye, geometry, lower)
    there = replace(room, plan=replace(room.plan, camera_height_m=z - LOWER_M)).emptied()
    rays = equirectangular(128)
    actual = (
        RoomWorld(there, QUALITY).radiance(Site.INDOOR, rays.reshape(-1, 3), math.pi / 128).reshape(*rays.shape)
        @ WEIGHTS
    )
    usable = ours.seen & (actual > 0)
    error = float(np.median(np.abs((ours.rgb @ WEIGHTS)[usable] / actual[usable] - 1)))
    return error, float(ours.seen[~ours.glass].mean())
