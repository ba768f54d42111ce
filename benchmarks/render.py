"""Rendering: physics by calculation and by Radiance, time against error beside plain path tracing, staged pictures.

All through our own scene code. ``analytic_err_pct`` is the worst of the integrating cube, the white furnace, form
factors and the overcast sky through a window (Walsh). ``radiance_diff_pct``: illuminance of a grid at table height in
a room with a window under an even sky, against Radiance (`rtrace -I`, -ab 9; quick: 6), root mean square.
``equal_error_speedup``: CPU time of Mitsuba's stock ``path`` with the sky as environment map, brought to our error by
its own law (error falls with the root of time), over ours, on the same view of a room with sun; errors against a long
run of ours (another seed, finer patches, nothing denoised). ``path_mean_diff_pct`` is how far the two methods' mean
luminances are apart, which tells of a bias in either. ``changed_median_err_pct``: furniture staged into the picture of
the bare room with ``differential`` against the furnished room rendered at length, where light or surface changed;
``unchanged_identical_pct`` how many kept pixels are bit-identical.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks import _analytic
from benchmarks._paired import cost_of
from benchmarks._render_scenes import EYE, PlainPath, boxes, clear_sky, plain_room, radiance_grid, room_model
from processing.images import LUMINANCE_WEIGHTS
from processing.rendering.composite import differential, ibl
from processing.rendering.daylight import skylight
from processing.rendering.irradiance import Effort, gathered
from processing.rendering.lightmap import light_map
from processing.rendering.outdoor import sky_outdoors
from processing.rendering.render import render
from processing.rendering.scene import Outdoors, Scene, plain
from processing.rendering.shell import shell_of
from processing.rendering.sight import sight_of
from processing.rendering.stage import Stage
from processing.rendering.transport import links_of, patch_points
from processing.sphere import Equirectangular, Perspective

WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)
REFERENCE = Effort(texel_m=0.05, patch_samples=256, rows=4096, pixel_samples=1024, sun_samples=512, clean=False)
AMBIENT = {
    True: ("-ab", "6", "-ad", "512", "-as", "128", "-aa", "0.2", "-ar", "64", "-lw", "1e-5"),
    False: ("-ab", "9", "-ad", "4096", "-as", "1024", "-aa", "0.08", "-ar", "256", "-lw", "1e-7"),
}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics and rivals; see the module's docstring."""
    cases = analytic(64 if quick else 1024, seed)
    worst = max(cases, key=lambda case: abs(cases[case]))
    metrics: dict[str, float] = {"analytic_err_pct": round(abs(cases[worst]), 4)}
    metrics |= {f"{name}_pct": round(error, 4) for name, error in cases.items()}
    metrics["radiance_diff_pct"] = round(against_radiance(quick=quick, seed=seed), 3)
    timed, rival = against_path(quick=quick, seed=seed)
    staged, other = staging(48 if quick else 128, seed)
    notes = [f"analytic: worst is {worst}; furniture and rooms are of our own scene types, truth by a long run of ours"]
    return {"metrics": metrics | timed | staged, "rivals": {"plain_path": rival, "ibl": other}, "notes": notes}


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
    level, samples = 1000.0, 256 if quick else 2048
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


def against_path(*, quick: bool, seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return our cost and error, the speed-up at equal error, and the rival's figures."""
    view = Perspective(96, 72, 1.7) if quick else Perspective(384, 288, 1.7)
    scene = plain_room(clear_sky()).furnished(boxes())
    stage = Stage.of(scene, REFERENCE.texel_m)
    effort = replace(REFERENCE, texel_m=0.1, pixel_samples=256) if quick else REFERENCE
    truth = render(stage, view, EYE, effort=effort, seed=seed + 50).rgb @ WEIGHTS
    solid = sight_of(stage, view, EYE).solid.reshape(truth.shape)
    ours = Effort(pixel_samples=8, patch_samples=32)
    render(scene, view, EYE, effort=ours, seed=seed)
    pictures: list[np.ndarray] = []
    cost = cost_of(lambda: pictures.append(render(scene, view, EYE, effort=ours, seed=seed + 1).rgb @ WEIGHTS))
    path = PlainPath(scene)
    path.picture(view, 4, seed)
    theirs = cost_of(lambda: pictures.append(path.picture(view, 64 if quick else 256, seed + 2) @ WEIGHTS))
    error, rival = (_errors(picture, truth, solid) for picture in pictures)
    speedup = theirs.cpu_s * (rival["rel"] / error["rel"]) ** 2 / cost.cpu_s
    apart = 100 * (pictures[1][solid].mean() / pictures[0][solid].mean() - 1)
    metrics = {
        "equal_error_speedup": round(speedup, 1),
        "cpu_s": round(cost.cpu_s, 3),
        "rel_rmse_pct": round(100 * error["rel"], 3),
        "median_err_pct": round(100 * error["median"], 3),
        "bias_pct": round(100 * error["bias"], 3),
        "path_mean_diff_pct": round(apart, 3),
    }
    return metrics, {"cpu_s": round(theirs.cpu_s, 3), "rel_rmse_pct": round(100 * rival["rel"], 3)}


def _errors(picture: np.ndarray, truth: np.ndarray, where: np.ndarray) -> dict[str, float]:
    relative = picture[where] / truth[where] - 1
    return {
        "rel": float(np.sqrt(np.mean(relative**2))),
        "median": float(np.median(np.abs(relative))),
        "bias": float(picture[where].sum() / truth[where].sum() - 1),
    }


def staging(rows: int, seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return the errors of a staged photograph where something changed: ours, and lit by the panorama alone."""
    geometry, bare = Equirectangular(2 * rows, rows), plain_room(clear_sky())
    long = replace(REFERENCE, texel_m=0.1, pixel_samples=256)
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
