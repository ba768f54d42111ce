"""Relighting from stored rays against direct renders; the sun's place; other viewpoints against simulated truth.

Rooms of test seeds (floor, height, windows as drawn; plain colours, three boxes), 128 rows, under a clear and an
overcast sky of other times. ``median_err_pct`` and ``p95_err_pct``: luminance of relit pictures against direct renders
of 96 rays a pixel in two halves, which nothing cleans; their noise, known from the halves, is taken out in quadrature
(``p95`` has it in it). ``speedup``: CPU time of a fresh render (4 rays a pixel, cleaned) over that of another light
from a ready basis, lowered by the square of their rms errors' ratio where ours is larger. ``day_ratio``: basis, view
and twelve lights over one fresh render (wanted: at most 3). ``sun_err_deg``: direction of the sun in room axes against
pvlib's own figures, largest. ``viewpoint_median_err_pct``: a simulated room's emptied panorama shown from 0.6 m lower,
against the simulated room from there, what the camera saw but for windows; ``viewpoint_seen_pct`` how much of it that
is. ``photo_*``: an emptied room's photograph at another time of the day against the simulated room then
(`relight_photo`), its light from a picture of that sky (``picture``) or the model's (``model``); ``unchanged``: the
photograph as it is. Figures are medians over rooms; rows are kept (`benchmarks.kept_rows`).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.light.albedo import outdoors_of_room, picture
from benchmarks.light.relight_photo import photographs
from benchmarks.light.render_scenes import _box, sky_outdoors
from benchmarks.paired import Cost, cost_of
from benchmarks.seeds import seeds
from benchmarks.truth_rooms import LIGHT_QUALITY, room_model_of, truth_list, truth_of
from mocks.rooms.room import make_room
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from mocks.worlds.light import Site
from processing.calibration.outdoor.sun_place import Place
from processing.ground.arrays import Vector
from processing.light.picture.render import render
from processing.light.picture.viewpoint import seen_from
from processing.light.scene.albedo import albedo_of_room
from processing.light.scene.scene import Outdoors, Scene, plain, shell_of
from processing.light.solver.basis import BASIS_EFFORTS, basis_of
from processing.light.solver.irradiance import Effort
from processing.light.solver.relight import RelightView
from processing.light.solver.sight import sight_of
from processing.light.solver.stage import Stage
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.relighting.weather import daylight_at, sun_direction, usual_weather
from processing.sphere import Equirectangular

WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)
HERE = Place(40.44, -79.99)
TIMES = (
    datetime(2025, 3, 20, 14, tzinfo=UTC),
    datetime(2025, 6, 21, 20, tzinfo=UTC),
    datetime(2025, 12, 5, 17, tzinfo=UTC),
)
CODE = {
    "ours": (
        "processing/light/**/*.py",
        "processing/relighting/*.py",
        "mocks/rooms/**/*.py",
        "benchmarks/light/relight*.py",
    ),
}
LOWER_M = 0.6
HEIGHT = 128
VIEW_ROWS = 128
LONG = Effort(pixel_samples=48, patch_samples=256, sun_samples=256, clean=False)
"""Of the renders that relit pictures are held against."""
FRESH = Effort(pixel_samples=4)
RAYS = "%, of the rays alone: relit pictures add 15 to 30 % for albedo, windows and shape, and a modelled sky's"
DARK = sky_outdoors(lambda rays: np.zeros(rays.shape), rows=16)


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    kept, left = _done(tasks(seed, quick=quick), Rows("relight", seed, CODE, keep=not quick))
    found, views, photos, sun = (kept[kind] for kind in ("render", "view", "photo", "sun"))
    fresh = {key: _middle(found, f"fresh_{key}") for key in ("s", "rms")}
    metrics = {
        "speedup": round(_middle(found, "speedup"), 1),
        **{f"{key}_err_pct": round(_middle(found, key), 3) for key in ("median", "p95", "rms")},
        "bias_pct": round(_middle(found, "bias"), 3),
        "stated_err_pct": round(_middle(found, "stated"), 3),
        "cpu_s": round(_middle(found, "relit_s"), 3),
        "ready_cpu_s": round(_middle(found, "ready_s"), 3),
        "basis_mb": round(_middle(found, "basis_mb"), 1),
        "day_ratio": round(_middle(found, "day_ratio"), 2),
        "sun_err_deg": round(sun[0]["deg"], 5),
        "viewpoint_median_err_pct": round(_middle(views, "err_pct"), 2),
        "viewpoint_seen_pct": round(_middle(views, "seen_pct"), 2),
    }
    for key in ("unchanged_err_pct", "picture_err_pct", "picture_p95_pct", "picture_bias_pct"):
        metrics[f"photo_{key}"] = round(_middle(photos, key), 2)
    for key in ("model_err_pct", "model_p95_pct", "model_bias_pct", "stated_err_pct"):
        metrics[f"photo_{key}"] = round(_middle(photos, key), 2)
    patches = [row for row in photos if row["sun_iou"] is not None]
    if patches:
        metrics["photo_sun_iou"] = round(_middle(patches, "sun_iou"), 3)
    metrics |= {"rooms": len(found), "views": len(views), "photos": len(photos), "rows_left": left}
    rival = {"cpu_s": round(fresh["s"], 3), "rms_err_pct": round(fresh["rms"], 3)}
    notes = [_line(row) for row in (*found, *views, *photos)]
    return {
        "metrics": metrics,
        "rivals": {"fresh_render": rival},
        "units": {"sun_err_deg": "degrees", **dict.fromkeys(("stated_err_pct", "photo_stated_err_pct"), RAYS)},
        "notes": notes,
    }


def _done(
    tasks: Sequence[tuple[str, str, Callable[[], dict[str, Any]]]], rows: Rows
) -> tuple[dict[str, list[dict[str, Any]]], int]:
    """Return rows by kind, of what each task (kind, name, work) makes or has made, and how many are left at the end.

    Of every kind there is at least one, however late it is.
    """
    found: dict[str, list[dict[str, Any]]] = {kind: [] for kind, _, _ in tasks}
    left = 0
    for kind, name, work in tasks:
        key = f"{kind}-{name}"
        if rows.late and found[kind] and not rows.knows(key):
            left += 1
            continue
        found[kind].append({"key": key} | rows.row(key, work, even_late=not found[kind]))
    if left:
        print(f"{left} rows are left; run again to go on", file=sys.stderr)
    return found, left


def tasks(seed: int, *, quick: bool) -> list[tuple[str, str, Callable[[], dict[str, Any]]]]:
    """Return all work as (kind, name, work), room by room: an unfinished run has some of everything."""
    count, times = (1, 100) if quick else (8, 10_000)
    found: list[tuple[str, str, Callable[[], dict[str, Any]]]] = [
        ("sun", f"{times}", lambda: {"deg": sun_error_deg(times, seed)})
    ]
    for plain_room, (number, use) in zip(seeds("test", count, seed), truth_list("test", count, seed), strict=True):
        found += [
            ("render", f"{plain_room}", partial(against_renders, plain_room, HEIGHT, quick=quick)),
            ("photo", f"{use}-{number}", partial(photographs, number, use, quick=quick)),
            ("view", f"{use}-{number}", partial(viewpoint, number, use)),
        ]
    return found


def _middle(rows: list[dict[str, Any]], key: str) -> float:
    return float(np.median([row[key] for row in rows]))


def _line(row: dict[str, Any]) -> str:
    shown = [f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items() if k != "key"]
    return f"{row['key']}: {', '.join(shown)}"


def scene_of_seed(number: int) -> tuple[Scene, Vector]:
    """Return a room of a seed's plan in plain colours, with boxes, and the place of its camera."""
    room = room_model_of(make_room(number))
    rng = np.random.default_rng([number, 5])
    colours = {"floor": rng.uniform(0.1, 0.4, 3), "ceiling": np.full(3, 0.8)}
    walls = rng.uniform(0.4, 0.75, 3)

    def albedo(name: str) -> Any:
        red, green, blue = (float(v) for v in colours.get(name, walls))
        return plain((red, green, blue))

    surfaces, panes = shell_of(
        room, reveal_m=0.2, albedo=albedo, transmittance=dict.fromkeys(range(64), (0.7, 0.72, 0.7))
    )
    around = [(1.2, 0.3), (-1.1, 0.6), (0.2, -1.2)]
    boxes = tuple(
        _box((x, y, h / 2), (0.6, 0.8, h), (0.5, 0.35, 0.25)) for (x, y), h in zip(around, (0.4, 0.8, 0.5), strict=True)
    )
    return Scene(surfaces, panes, DARK, boxes), (0.0, 0.0, room.camera_height_m)


def lights_of_seed(number: int, *, quick: bool) -> list[Outdoors]:
    """Return other lights: a clear sky, of another season in each room, and an overcast one."""
    heading = float(np.random.default_rng([number, 6]).uniform(0, 2 * math.pi))
    time_utc = TIMES[1 if quick else number % len(TIMES)]
    kinds = [("clear", time_utc), ("overcast", TIMES[0])]
    return [daylight_at(t, HERE, heading, usual_weather(kind), DARK).outdoors for kind, t in kinds]  # type: ignore[arg-type]


def against_renders(number: int, rows: int, *, quick: bool) -> dict[str, Any]:
    """Return errors and costs of one room's lights."""
    scene, eye = scene_of_seed(number)
    geometry, effort = Equirectangular(2 * rows, rows), replace(BASIS_EFFORTS["standard"], rows=rows)
    fresh_effort = replace(FRESH, rows=rows)
    long = replace(LONG, rows=rows)
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
    errors: list[np.ndarray] = []
    fresh_errors: list[np.ndarray] = []
    noise, stated, bias = [], [], []
    costs: dict[str, list[Cost]] = {"relit": [], "fresh": []}
    for light in lights:
        lit = scene.under(light)
        twice = [(render(lit, geometry, eye, effort=long, seed=n).rgb @ WEIGHTS)[solid] for n in (91, 92)]
        truth = (twice[0] + twice[1]) / 2
        pictures: list[Any] = []
        costs["relit"].append(_third(partial(_kept, pictures, partial(made[0].relit, light))))
        fresh_render = partial(render, lit, geometry, eye, effort=fresh_effort, seed=3)
        costs["fresh"].append(cost_of(partial(_kept, pictures, fresh_render)))
        ours, theirs = ((one.rgb @ WEIGHTS)[solid] for one in (pictures[0], pictures[-1]))
        usable = np.minimum(*twice) > 1e-3 * np.median(truth)
        compared = [one[usable] for one in (truth, *twice)]
        for sample, one in ((errors, ours), (fresh_errors, theirs)):
            sample.append(np.array([one[usable] / against - 1 for against in compared]))
        noise.append(compared[1] / compared[2] - 1)
        stated.append(pictures[0].error)
        bias.append(ours.sum() / truth.sum() - 1)
    every, fresh = np.concatenate(errors, axis=1), np.concatenate(fresh_errors, axis=1)
    rms, fresh_rms = _rms(every), _rms(fresh)
    measured = float(np.median(np.abs(every[0])))
    # Half of what two references differ by is the noise of their mean.
    own = float(np.median(np.abs(np.concatenate(noise)))) / 2
    relit_s, fresh_s = (float(np.median([c.cpu_s for c in costs[key]])) for key in ("relit", "fresh"))
    return {
        "speedup": fresh_s / relit_s * min(1.0, (fresh_rms / rms) ** 2),
        "day_ratio": (ready_cost.cpu_s + 12 * relit_s) / fresh_s,
        "median": 100 * math.sqrt(max(measured**2 - own**2, 0.0)),
        "with_noise": 100 * measured,
        "p95": 100 * float(np.quantile(np.abs(every[0]), 0.95)),
        "rms": 100 * rms,
        "fresh_rms": 100 * fresh_rms,
        "stated": 100 * float(np.mean(stated)),
        "bias": 100 * float(np.mean(bias)),
        "relit_s": relit_s,
        "fresh_s": fresh_s,
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
    """Return the root mean square of errors (3, n) against two references' mean and each, without their noise.

    The product of the errors against two independent references has none of it in its mean. The worst per mille
    (single pixels at the edge of the sun) is left out.
    """
    worst = np.abs(relative).max(axis=0)
    kept = worst <= np.quantile(worst, 0.999)
    return math.sqrt(max(float(np.mean(relative[1, kept] * relative[2, kept])), 0.0))


def sun_error_deg(count: int, seed: int) -> float:
    """Return the largest angle between our sun in room axes and pvlib's, by times, places and headings."""
    import pandas as pd
    from pvlib.solarposition import spa_python

    from processing.calibration.outdoor.sun_place import sun_place

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


def viewpoint(number: int, use: Any) -> dict[str, float]:
    """Return the median relative error of what the camera saw, shown from lower down, and its share, in per cent."""
    room, truth = truth_of(number, use, quality=LIGHT_QUALITY)
    found = albedo_of_room(
        picture(truth.empty_rgb), room_model_of(room), outdoors_of_room(room), reveal_m=0.24, rows=2 * VIEW_ROWS
    )
    x, y, z = room.eye
    lower = (x, y, z - LOWER_M)
    geometry = Equirectangular(2 * VIEW_ROWS, VIEW_ROWS)
    ours = seen_from(found.scene, truth.empty_rgb, room.eye, geometry, lower)
    there = replace(room, plan=replace(room.plan, camera_height_m=z - LOWER_M)).emptied()
    rays = equirectangular(VIEW_ROWS)
    actual = (
        RoomWorld(there, LIGHT_QUALITY)
        .radiance(Site.INDOOR, rays.reshape(-1, 3), math.pi / VIEW_ROWS)
        .reshape(*rays.shape)
        @ WEIGHTS
    )
    usable = ours.seen & (actual > 0)
    error = float(np.median(np.abs((ours.rgb @ WEIGHTS)[usable] / actual[usable] - 1)))
    return {"err_pct": 100 * error, "seen_pct": 100 * float(ours.seen[~ours.glass].mean())}
