"""Rendering: physics by calculation and by Radiance, time against error beside others, staged pictures, growth.

All through our own scene code. ``analytic_err_pct`` is the worst of the integrating cube, the white furnace, form
factors and daylight through openings (Walsh's closed form; CIE 171's roof and facade openings, unglazed and glazed).
``radiance_diff_pct``: illuminance of a grid at table height in a room with a window under an even sky, against
Radiance (`rtrace -I`, -ab 9; quick: 6), root mean square.

**Time against error** (`render_time`): rooms of test seeds, a third each with a small window and sun, a large window
under clouds, and lamps at night; quick runs take one and look at fewer pixels. ``to_3_pct_cpu_s`` and ``to_1_5_..``:
our CPU seconds for a panorama of 512 x 256 of that relative rms error, median of rooms. ``equal_error_speedup``: CPU
time of Mitsuba's stock ``path`` with the sky as environment map, brought to 3 % by its own law (error falls with the
root of time), over ours. Cycles (with portals and Open Image Denoise; DAYLIT_BPY names a Python that has bpy) and
Radiance (mkillum, ambient cache): their CPU time over ours at their own error.

**Staging**: ``changed_median_err_pct``: boxes staged with ``differential`` into a bare room against the furnished room
rendered at length, where light or surface changed; ``unchanged_identical_pct``: kept pixels that are bit-identical.
Full runs also stage furniture in simulated rooms by all four methods (`render_methods`; rivals, with a contact sheet),
and by a shadow catcher in Cycles where DAYLIT_BPY names a Python that has ``bpy``,
and measure and draw what pixels, triangles and error cost (``growth_width``, ``full_size_*``: `render_growth`).

Rows are kept (`benchmarks.kept_rows`): DAYLIT_BENCH_CPU_S ends a run after so much CPU time; run again to go on.
"""

from __future__ import annotations

import importlib
import math
import os
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.light import analytic as _analytic
from benchmarks.light.render_daylight import daylight
from benchmarks.light.render_growth import draw, growth
from benchmarks.light.render_methods import CATCHER, METHODS, contact_sheet, ibl, methods_row
from benchmarks.light.render_race import race_rooms
from benchmarks.light.render_scenes import EYE, boxes, clear_sky, plain_room, radiance_grid, room_model, sky_outdoors
from benchmarks.light.render_time import BPY, denoised_path, plain_path, race_row, seconds_to, truth_of_room
from benchmarks.light.render_time import ours as timed
from benchmarks.truth_rooms import is_kept, truth_list
from mocks.optics.picture_cache import default_folder
from processing.light.picture.composite import differential
from processing.light.picture.render import render
from processing.light.scene.scene import Outdoors, Scene, plain, shell_of
from processing.light.solver.irradiance import Effort, gathered
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage
from processing.light.solver.transport import light_map, links_of, patch_points
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular

CODE = {"ours": ("processing/light/**/*.py",), "theirs": ()}
RACE_ROOMS, RADIANCE_ROOMS, METHOD_ROOMS, SHEET_ROOMS = 8, 3, 4, 4
"""Radiance takes longest, and is looked at in a room of each kind."""
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)
QUICK_TRUTH = {"pixels": 200, "rays": 256, "patch_rays": 48}
QUICK_SAMPLES, QUICK_STAGED_ROWS, QUICK_RADIANCE_SAMPLES = 64, 48, 256
REFERENCE = Effort(texel_m=0.05, patch_samples=256, rows=4096, pixel_samples=1024, sun_samples=512, clean=False)
AMBIENT = {
    True: ("-ab", "6", "-ad", "512", "-as", "128", "-aa", "0.2", "-ar", "64", "-lw", "1e-5"),
    False: ("-ab", "9", "-ad", "4096", "-as", "1024", "-aa", "0.08", "-ar", "256", "-lw", "1e-7"),
}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics and rivals; see the module's docstring."""
    cases = analytic(QUICK_SAMPLES if quick else 1024, seed)
    worst = max(cases, key=lambda case: abs(cases[case]))
    metrics: dict[str, float] = {"analytic_err_pct": round(abs(cases[worst]), 4)}
    metrics |= {f"{name}_pct": round(error, 4) for name, error in cases.items()}
    metrics["radiance_diff_pct"] = round(against_radiance(quick=quick, seed=seed), 3)
    rows = Rows("render", seed, CODE, keep=not quick)
    race = raced(rows, quick=quick, seed=seed)
    raced_metrics, rivals = race_figures(race)
    staged, boxes_ibl = staging(QUICK_STAGED_ROWS if quick else 128, seed)
    rivals["ibl_boxes"] = boxes_ibl
    notes = [f"analytic: worst is {worst}", *(_methods(row) for row in race)]
    found = growth(rows, quick=quick, seed=seed)
    widths = list(found["width"])
    if not quick:
        largest = found["width"][widths[-1]]
        staged["growth_width"] = largest["cpu_s"] / found["width"][widths[1]]["cpu_s"]
        staged |= {"full_size_cpu_s": largest["cpu_s"], "full_size_peak_mb": largest["peak_mb"]}
        draw(found, race)
        methods, more = staged_by_methods(rows, seed)
        rivals |= methods
        notes += more
    return {"metrics": metrics | raced_metrics | staged, "rivals": rivals, "notes": notes}


def raced(rows: Rows, *, quick: bool, seed: int) -> list[dict[str, Any]]:
    """Return the rows of all rooms of the race."""
    if not quick:
        return [
            race_row(rows, room, seed, with_radiance=k < RADIANCE_ROOMS)
            for k, room in enumerate(race_rooms(RACE_ROOMS, seed))
        ]
    room = race_rooms(1, seed)[0]
    truth = truth_of_room(room, seed, **QUICK_TRUTH)
    row: dict[str, Any] = {"room": room.name, "kind": room.kind, "noise": truth.noise}
    row |= {f"ours_{n}": timed(room, truth, n, seed + 1) for n in (2, 16)}
    return [row | {"path": plain_path(room, truth, seed), "denoised_path": denoised_path(room, truth, seed)}]


def race_figures(race: list[dict[str, Any]]) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return our figures and those of the others, medians over rooms."""

    def median(values: list[float]) -> float:
        return round(float(np.median(values)), 3)

    to_3 = [seconds_to(row, 0.03) for row in race]
    path = [row["path"]["cpu_s"] * (row["path"]["rel"] / 0.03) ** 2 for row in race]
    metrics = {
        "equal_error_speedup": median([p / t for p, t in zip(path, to_3, strict=True)]),
        "equal_error_speedup_least": round(min(p / t for p, t in zip(path, to_3, strict=True)), 1),
        "race_rooms": len(race),
        "to_3_pct_cpu_s": median(to_3),
        "to_1_5_pct_cpu_s": median([seconds_to(row, 0.015) for row in race]),
        "rel_rmse_pct": median([100 * row["ours_16"]["rel"] for row in race]),
        "median_err_pct": median([100 * row["ours_16"]["median"] for row in race]),
        "cpu_s": median([row["ours_16"]["cpu_s"] for row in race]),
        "bias_pct": median([100 * row["ours_16"]["bias"] for row in race]),
        "worst_bias_pct": round(max((100 * row["ours_16"]["bias"] for row in race), key=abs), 3),
        "path_bias_pct": median([100 * row["path"]["bias"] for row in race]),
    }
    rivals = {"plain_path": {"to_3_pct_cpu_s": median(path)}}
    for name in ("denoised_path", "cycles", "radiance"):
        mine = [row for row in race if name in row]
        if mine:
            ratios = [row[name]["cpu_s"] / seconds_to(row, row[name]["rel"]) for row in mine]
            rivals[name] = {
                "cpu_s": median([row[name]["cpu_s"] for row in mine]),
                "rel_rmse_pct": median([100 * row[name]["rel"] for row in mine]),
                "bias_pct": median([100 * row[name]["bias"] for row in mine]),
                "ratio_it_over_ours": median(ratios),
                "ratio_it_over_ours_least": round(min(ratios), 2),
            }
    return metrics, rivals


def _methods(row: dict[str, Any]) -> str:
    """Return one room's figures in words."""
    figures = [
        f"{name} {row[name]['cpu_s']:.1f} s {100 * row[name]['rel']:.1f} % ({100 * row[name]['bias']:+.2f} %)"
        for name in row
        if isinstance(row[name], dict)
    ]
    return f"{row['room']}, {row['kind']} (reference's noise {100 * row['noise']:.1f} %): {'; '.join(figures)}"


def staged_by_methods(rows: Rows, seed: int) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return the errors of the four methods in simulated rooms, medians over rooms, and draw their contact sheet."""
    found, sheets = [], []
    for number, use in truth_list("test", 4 * METHOD_ROOMS, seed):
        if len(found) < METHOD_ROOMS and is_kept(number, use):
            sheet = default_folder().parent / f"render-methods-{number}.npz"
            key = f"methods {number}{' and catcher' if os.environ.get(BPY) else ''}"
            found.append(rows.row(key, lambda n=number, u=use, s=sheet: methods_row(n, u, s)))  # type: ignore[misc]
            sheets.append(sheet)
    if not found:
        return {}, ["no simulated room is kept: run python -m benchmarks.truth_rooms test 8 first"]
    contact_sheet(sheets[:SHEET_ROOMS], [row["room"] for row in found[:SHEET_ROOMS]])
    names = [name for name in (*METHODS, CATCHER) if all(name in row for row in found)]
    methods = {name: _medians([row[name] for row in found]) for name in names}
    return methods, [f"{row['room']}: {', '.join(_method(row, name) for name in names)}" for row in found]


def _medians(rows: list[dict[str, float]]) -> dict[str, float]:
    """Return the medians of shares, as %, and of CPU seconds where all rows have them."""
    found = {}
    for key in [key for key in rows[0] if all(key in row for row in rows)]:
        middle = float(np.median([row[key] for row in rows]))
        found |= {key: round(middle, 2)} if key == "cpu_s" else {f"{key}_pct": round(100 * middle, 2)}
    return found


def _method(row: dict[str, Any], name: str) -> str:
    return f"{name} {100 * row[name]['median']:.1f} %"


def analytic(samples: int, seed: int) -> dict[str, float]:
    """Return the signed errors (%) of scenes that can be calculated."""
    dark = sky_outdoors(lambda rays: np.zeros(rays.shape), rows=16)
    found = {f"cube_{albedo:g}": _cube(albedo, dark, samples, seed) for albedo in (0.2, 0.5, 0.8)}
    surfaces, _ = shell_of(room_model(5, 4, 2.7, None), albedo=lambda _: plain(0.6))
    glowing = tuple(replace(s, emission_cd_m2=plain(10.0)) for s in surfaces)
    stage = Stage.of(Scene(glowing, (), dark), 0.25)
    radiance = 10 + 0.6 / math.pi * light_map(stage, samples, seed).total.mean()
    found["furnace"] = 100 * (radiance / 25 - 1)
    links = links_of(stage, patch_points(stage, samples, (seed, 9)), stage.patches.normal, samples, (seed, 10))
    columns, rows, _ = (int(v) for v in stage.patches.grids[0])
    first = int(stage.patches.grids[1][2])
    ceiling = int(stage.patches.grids[1][0] * stage.patches.grids[1][1])
    seen = links.patch[: columns * rows]
    share = ((seen >= first) & (seen < first + ceiling)).mean()
    found["form_factor"] = 100 * (share / _analytic.parallel_form_factor(5, 4, 2.7) - 1)
    found["closure"] = 100 * ((links.patch >= 0).mean() - 1)
    found |= {f"daylight_{name}": error for name, error in daylight(max(samples // 4, 32), seed).items()}
    return found | {"daylight": _walsh(samples, seed)}


def _cube(albedo: float, dark: Outdoors, samples: int, seed: int) -> float:
    surfaces, _ = shell_of(room_model(4, 4, 4, None), albedo=lambda _: plain(albedo))
    lamp = replace(surfaces[1], emission_cd_m2=plain(10_000 / 16 / math.pi))
    stage = Stage.of(Scene((surfaces[0], lamp, *surfaces[2:]), (), dark), 0.2)
    light = light_map(stage, samples, seed).total[:, 1]
    area = stage.patches.area_m2
    indirect = (light * area).sum() / area.sum() - 10_000 / 96
    return float(100 * (indirect / _analytic.indirect_lux(10_000, 96, albedo) - 1))


def _walsh(samples: int, seed: int) -> float:
    """Return the worst error (%) of floor points before an unglazed window under the overcast sky."""
    sky = sky_outdoors(lambda rays: np.repeat((1 + 2 * rays[..., 2:]) / 3, 3, axis=-1), rows=512, ground_albedo=0.0)
    surfaces, panes = shell_of(room_model(5, 4, 2.7, (1.5, 3.5, 0.8, 2.3)), reveal_m=0.0, albedo=lambda _: plain(0.0))
    stage = Stage.of(Scene(surfaces, panes, sky), 0.5)
    errors = []
    for y in (-1.5, -1.0, 0.0, 1.0, 1.8):
        many = np.tile(np.float32([[[0.0, y, 0.0]]]), (200, 1, 1))
        up = np.tile(np.float32([0, 0, 1]), (200, 1))
        lux = skylight(stage, many, up, samples, (seed, 11)).mean()
        facade = _analytic.overcast_behind_facade_lux
        errors.append(100 * (lux / (2 * (facade(y + 2, 1.0, 2.3) - facade(y + 2, 1.0, 0.8))) - 1))
    return max(errors, key=abs)


def against_radiance(*, quick: bool, seed: int) -> float:
    """Return how far our mean illuminance is from Radiance's (%), root mean square over the grid's points."""
    if importlib.util.find_spec("pyradiance") is None:
        raise RuntimeError("pyradiance is not installed (pip install daylit[bench])")
    level, samples = 1000.0, QUICK_RADIANCE_SAMPLES if quick else 2048
    even = Outdoors(np.full((16, 32, 3), level, np.float32))
    scene = plain_room(even)
    points = np.array([(x, y, 0.75) for x in (-1.5, 0.0, 1.5) for y in (-1.2, 0.0, 1.2)])
    stage = Stage.of(scene, 0.1)
    light = light_map(stage, samples, seed)
    many = np.repeat(points, 32, axis=0).astype(np.float32)
    up = np.tile(np.float32([0, 0, 1]), (len(many), 1))
    ours = gathered(stage, light, many, up, samples, seed).reshape(len(points), 32, 3).mean(axis=(1, 2))
    theirs = radiance_grid(scene, points, level, AMBIENT[quick])
    return float(100 * np.sqrt(np.mean((ours / theirs - 1) ** 2)))


def staging(rows: int, seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return the errors of a staged photograph where something changed: ours, and lit by the panorama alone."""
    geometry, bare = Equirectangular(2 * rows, rows), plain_room(clear_sky())
    many, few = (256, 256) if rows > 64 else (64, 64)
    long = replace(REFERENCE, texel_m=0.1, patch_samples=many, pixel_samples=few)
    photograph = render(bare, geometry, EYE, effort=long, seed=seed + 60).rgb
    truth = render(bare.furnished(boxes()), geometry, EYE, effort=long, seed=seed + 61).rgb
    ours = differential(photograph, bare, boxes(), EYE, seed=seed)
    lone = ibl(photograph, boxes(), EYE, bare, seed=seed)
    changed = ~ours.kept & (truth @ WEIGHTS > 0)
    figures = {}
    for name, staged in (("ours", ours), ("ibl", lone)):
        relative = np.abs((staged.rgb @ WEIGHTS)[changed] / (truth @ WEIGHTS)[changed] - 1)
        own = relative[ours.furniture[changed]]
        figures[name] = {
            "changed_median_err_pct": round(100 * float(np.median(relative)), 3),
            "changed_p95_err_pct": round(100 * float(np.quantile(relative, 0.95)), 3),
            "furniture_median_err_pct": round(100 * float(np.median(own)), 3),
        }
    same = 100.0 * float((ours.rgb[ours.kept] == photograph[ours.kept]).all(axis=-1).mean())
    return figures["ours"] | {"unchanged_identical_pct": same}, figures["ibl"]
