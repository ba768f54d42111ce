"""Time against error in one room of the race: ours, Mitsuba's `path`, Radiance, Cycles, against a long reference.

Errors are of luminance at `PIXELS` pixels of a 512 x 256 panorama, the same for all: those that see a matte surface and
lie at no edge and in no half shadow (renderers differ in how they blend there, and a denoiser blends too). The
reference gathers at those pixels only, which is why it can be long. ``path`` and Radiance also look at those pixels
only; the time of ``path`` is brought to the whole picture by their share, Radiance's is left as it is (its ambient
cache, most of its time, serves all pixels): a lower bound.
"""

from __future__ import annotations

import math
import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.light.render_race import RaceRoom
from benchmarks.light.render_radiance import radiance_pixels
from benchmarks.light.render_scenes import PlainPath, emissions_of, triangles_of
from benchmarks.paired import cost_of
from processing.light.picture.render import render
from processing.light.solver.irradiance import Effort, cleaned, gathered
from processing.light.solver.sight import Sight, albedo_of, emission_of, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.light.solver.transport import light_map
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular

ROWS, PIXELS = 256, 1500
REFERENCE_TEXEL_M, REFERENCE_PATCH, REFERENCE_RAYS = 0.07, 128, 1024
EFFORTS = {
    rays: Effort(patch_samples=patch, pixel_samples=rays, cleaning="fast")
    for rays, patch in ((2, 16), (4, 32), (16, 64))
}
PATH_SPP, DENOISED_SPP, CYCLES_SPP = 32, 8, 4
BPY = "DAYLIT_BPY"
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)


@dataclass(frozen=True)
class Truth:
    """The reference at some pixels."""

    pixels: np.ndarray
    rays: np.ndarray
    luminance: np.ndarray
    noise: float
    """Its own relative rms error, from two halves."""


def truth_of_room(
    room: RaceRoom,
    seed: int,
    *,
    pixels: int = PIXELS,
    rays: int = REFERENCE_RAYS,
    patch_rays: int = REFERENCE_PATCH,
) -> Truth:
    """Return the reference of a room."""
    stage = Stage.of(room.scene, REFERENCE_TEXEL_M)
    sight = sight_of(stage, Equirectangular(2 * ROWS, ROWS), room.eye_m)
    sun = sun_of(stage, sight, 256, seed) @ WEIGHTS
    inner = np.flatnonzero(_inner(sight, sun, ~emission_of(stage, sight).any(axis=1)))
    chosen = np.sort(np.random.default_rng(seed + 5).choice(inner, min(pixels, len(inner)), replace=False))
    some = sight.some(chosen)
    albedo = albedo_of(stage, some).astype(np.float64)
    halves = []
    for half in range(2):
        light = light_map(stage, patch_rays, seed + 900 + half)
        found = gathered(stage, light, some.point, some.normal, rays, seed + 900 + half)
        direct = sun_of(stage, sight, 256, seed)[chosen]
        halves.append((albedo * (found + direct) / math.pi) @ WEIGHTS)
    mean = (halves[0] + halves[1]) / 2
    noise = float(np.sqrt(np.mean(((halves[0] - halves[1]) / (2 * mean)) ** 2)))
    return Truth(chosen, sight.rays[chosen], mean, noise)


def _inner(sight: Sight, sun: np.ndarray, dark: np.ndarray) -> np.ndarray:
    """Return pixels (N,) whose neighbours see the same thing, in the same sun, that gives no light of its own."""
    kernel = np.ones((3, 3), np.uint8)
    label = sight.label.reshape(sight.shape).astype(np.float32)
    same = (cv2.dilate(label, kernel) == cv2.erode(label, kernel)) & dark.reshape(sight.shape)
    for c in range(3):
        turn = np.ascontiguousarray(sight.normal.reshape(*sight.shape, 3)[..., c])
        same &= cv2.dilate(turn, kernel) - cv2.erode(turn, kernel) < 0.01
    lit = sun.reshape(sight.shape).astype(np.float32)
    same &= cv2.dilate(lit, np.ones((7, 7), np.uint8)) <= 1.05 * cv2.erode(lit, np.ones((7, 7), np.uint8))
    return np.asarray(same.ravel() & sight.solid)


def errors(luminance: np.ndarray, truth: Truth) -> dict[str, float]:
    """Return relative rms error, median and bias."""
    apart = luminance / truth.luminance - 1
    return {
        "rel": float(np.sqrt(np.mean(apart**2))),
        "median": float(np.median(np.abs(apart))),
        "bias": float(luminance.sum() / truth.luminance.sum() - 1),
    }


def ours(room: RaceRoom, truth: Truth, rays: int, seed: int) -> dict[str, float]:
    """Return our CPU seconds for the whole picture, scene and light map included, and the error."""
    found: list[np.ndarray] = []
    geometry = Equirectangular(2 * ROWS, ROWS)
    render(room.scene, Equirectangular(64, 32), room.eye_m, effort=EFFORTS[2], seed=seed)
    cost = cost_of(lambda: found.append(render(room.scene, geometry, room.eye_m, effort=EFFORTS[rays], seed=seed).rgb))
    return {"cpu_s": cost.cpu_s} | errors(found[0].reshape(-1, 3)[truth.pixels] @ WEIGHTS, truth)


def plain_path(room: RaceRoom, truth: Truth, seed: int) -> dict[str, float]:
    """Return the CPU seconds of Mitsuba's path for the whole picture at `PATH_SPP`, its noise, and its bias.

    Its noise comes from two runs, so that its sun, one texel of its sky wide, does not count as an error.
    """
    path = PlainPath(room.scene)
    path.pixels(room.eye_m, truth.rays[:64], 4, seed)
    found: list[np.ndarray] = []
    costs = [
        cost_of(lambda k=k: found.append(path.pixels(room.eye_m, truth.rays, PATH_SPP, seed + k) @ WEIGHTS)).cpu_s  # type: ignore[misc]
        for k in (1, 2)
    ]
    share = len(truth.pixels) / (2 * ROWS * ROWS)
    apart = (found[0] - found[1]) / math.sqrt(2) / truth.luminance
    scores = errors((found[0] + found[1]) / 2, truth)
    return {"cpu_s": sum(costs) / 2 / share, "rel": float(np.sqrt(np.mean(apart**2))), "bias": scores["bias"]}


def denoised_path(room: RaceRoom, truth: Truth, seed: int) -> dict[str, float]:
    """Return the CPU seconds of Mitsuba's path at `DENOISED_SPP` with our denoiser and our guides, and its error.

    As ours, what is denoised is light without the surfaces' colour; first hits and guides are not counted.
    """
    stage = Stage.of(room.scene, REFERENCE_TEXEL_M)
    sight = sight_of(stage, Equirectangular(2 * ROWS, ROWS), room.eye_m)
    albedo, glow = albedo_of(stage, sight), emission_of(stage, sight)
    path = PlainPath(room.scene)
    path.pixels(room.eye_m, sight.rays[:64], 4, seed)
    found: list[np.ndarray] = []

    def whole() -> None:
        noisy = path.pixels(room.eye_m, sight.rays, DENOISED_SPP, seed + 1)
        light = np.where(albedo > 0, (noisy - glow) / np.where(albedo > 0, albedo, 1), 0).astype(np.float32)
        clean = cleaned(light.reshape(ROWS, 2 * ROWS, 3), sight, wraps=True, quality="fast")
        found.append(clean.reshape(-1, 3) * albedo + glow)

    cost = cost_of(whole)
    return {"cpu_s": cost.cpu_s} | errors(found[0][truth.pixels] @ WEIGHTS, truth)


def radiance(room: RaceRoom, truth: Truth) -> dict[str, float]:
    """Return Radiance's CPU seconds for the truth's pixels, and its error."""
    values, cpu_s = radiance_pixels(room.scene, room.eye_m, truth.rays)
    return {"cpu_s": cpu_s} | errors(values @ WEIGHTS, truth)


def cycles(room: RaceRoom, truth: Truth, spp: int) -> dict[str, float] | None:
    """Return the CPU seconds of Cycles with portals and denoiser, and its error; None where there is no bpy."""
    python = os.environ.get(BPY)
    if not python:
        return None
    with tempfile.TemporaryDirectory() as name:
        source, target = Path(name, "room.npz"), Path(name, "out.npz")
        np.savez(source, **_as_arrays(room))  # type: ignore[arg-type]
        script = Path(__file__).with_name("render_cycles.py")
        subprocess.run([python, script, source, target, str(spp), str(ROWS)], check=True, capture_output=True)
        made = np.load(target)
        return {"cpu_s": float(made["cpu_s"])} | errors(made["picture"].reshape(-1, 3)[truth.pixels] @ WEIGHTS, truth)


def _as_arrays(room: RaceRoom) -> dict[str, Any]:
    scene = room.scene
    every = triangles_of(scene)
    sun = scene.outdoors.sun
    return {
        "triangles": np.concatenate([t for t, _ in every]).astype(np.float32),
        "part": np.concatenate([np.full(len(t), k) for k, (t, _) in enumerate(every)]),
        "colour": np.array([colour for _, colour in every]),
        "emission": np.array(emissions_of(scene)),
        "panes": np.array([(p.corner_m, p.across_m, p.up_m) for p in scene.panes]),
        "sky": scene.outdoors.rgb,
        "sun": np.array([] if sun is None else [*sun.direction, *sun.normal_illuminance_lx]),
        "eye": np.array(room.eye_m),
    }


def race_row(rows: Rows, room: RaceRoom, seed: int, *, with_radiance: bool) -> dict[str, Any]:
    """Return one room's figures of all methods, from kept rows where they are known."""

    def truth() -> Truth:
        kept = rows.row(f"{room.name} truth", lambda: _kept(truth_of_room(room, seed)), kind="theirs")
        return Truth(*(np.array(kept[k]) for k in ("pixels", "rays", "luminance")), kept["noise"])

    known = truth()
    row: dict[str, Any] = {"room": room.name, "kind": room.kind, "noise": known.noise}
    for rays in EFFORTS:
        row[f"ours_{rays}"] = rows.row(f"{room.name} ours {rays}", lambda n=rays: ours(room, known, n, seed + 1))  # type: ignore[misc]
    row["path"] = rows.row(f"{room.name} path {PATH_SPP}", lambda: plain_path(room, known, seed), kind="theirs")
    spp = DENOISED_SPP
    row["denoised_path"] = rows.row(f"{room.name} denoised {spp}", lambda: denoised_path(room, known, seed))
    if os.environ.get(BPY):
        row["cycles"] = rows.row(
            f"{room.name} cycles {CYCLES_SPP}", lambda: cycles(room, known, CYCLES_SPP), kind="theirs"
        )
    if with_radiance:
        row["radiance"] = rows.row(f"{room.name} radiance", lambda: radiance(room, known), kind="theirs")
    return row


def _kept(truth: Truth) -> dict[str, Any]:
    return {
        "pixels": truth.pixels.tolist(),
        "rays": truth.rays.astype(float).round(7).tolist(),
        "luminance": truth.luminance.tolist(),
        "noise": truth.noise,
    }


def seconds_to(row: dict[str, Any], error: float) -> float:
    """Return our CPU seconds to a relative rms error, along the line between the two efforts around it (log, log)."""
    points = sorted((v["rel"], v["cpu_s"]) for k, v in row.items() if k.startswith("ours_"))
    x, y = np.log([p[0] for p in points]), np.log([p[1] for p in points])
    if error >= points[-1][0]:
        return points[-1][1]  # the least effort is better than asked for
    if error <= points[0][0]:
        # Beyond the most effort noise falls with the root of time.
        return float(points[0][1] * (points[0][0] / error) ** 2)
    return float(np.exp(np.interp(math.log(error), x, y)))
