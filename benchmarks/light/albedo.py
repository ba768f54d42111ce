"""Albedo by inverse radiosity in simulated rooms of test seeds, from the truth panorama of the emptied room.

``median_err`` and ``p95_err`` are of the absolute error (mean of R, G, B) over all that the room shows, by
solid angle: fixtures, curtains, doors and blinds too, of which the room model knows nothing. ``day_*`` are of rooms
without lit lamps, ``lamps_*`` of those with. ``measured_pct`` is the share of pixels whose own albedo is measured.
``relight_median_err_pct``: the recovered room under another sky against the simulated room under it, luminance of all
visible surfaces; as in `daylit relight`, what covers windows follows the light on them, and the land outside is that of
the first picture. The light outdoors comes from a picture of the upper half with the sun in it; what lies below the
horizon is not given. Rows are kept (`benchmarks.kept_rows`).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.truth_rooms import LIGHT_QUALITY, kept_list, room_model_of, truth_of
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from mocks.worlds.light import Site
from processing.light.picture.relight_photo import veil_gains, with_captured_land
from processing.light.picture.render import render
from processing.light.scene.albedo import RoomAlbedo, albedo_of_room
from processing.light.scene.outdoor import outdoors_of
from processing.light.scene.scene import Outdoors
from processing.light.solver.irradiance import EFFORTS
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.sphere import Equirectangular, directions, solid_angles

CODE = {"ours": ("processing/light/**/*.py",)}
ROWS, OUTDOOR_ROWS, RELIGHT_ROWS = 256, 256, 64
QUICK_ROOMS, FULL_ROOMS, RELIT_ROOMS = 2, 16, 8
QUANTILES = 1000
REVEAL_M = 0.24
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    kept = Rows("albedo", seed, CODE, keep=not quick)
    rooms = kept_list("test", 4 * FULL_ROOMS, seed, quality=LIGHT_QUALITY)[: QUICK_ROOMS if quick else FULL_ROOMS]
    rows = [kept.row(f"albedo {number}", lambda n=number, u=use: albedo_row(n, u)) for number, use in rooms]  # type: ignore[misc]
    unlit = [one for one, row in zip(rooms, rows, strict=True) if not row["lamps"]][: 1 if quick else RELIT_ROOMS]
    relights = [kept.row(f"relight {number}", lambda n=number, u=use: relight_row(n, u)) for number, use in unlit]  # type: ignore[misc]
    metrics: dict[str, float] = {
        "rooms": len(rows),
        "relit_rooms": len(relights),
        "measured_pct": round(100 * float(np.mean([row["measured"] for row in rows])), 2),
        "room_median_err": round(float(np.median([row["median"] for row in rows])), 4),
        "cpu_s": round(float(np.median([row["cpu_s"] for row in rows])), 2),
    }
    groups = {"": rows, "day_": [r for r in rows if not r["lamps"]], "lamps_": [r for r in rows if r["lamps"]]}
    for name, mine in groups.items():
        if mine:
            pooled = np.concatenate([row["quantiles"] for row in mine])
            metrics[f"{name}median_err"] = round(float(np.median(pooled)), 4)
            metrics[f"{name}p95_err"] = round(float(np.quantile(pooled, 0.95)), 4)
    if relights:
        metrics["relight_median_err_pct"] = round(float(np.median([row["error_pct"] for row in relights])), 2)
    notes = [f"{row['room']}: median {row['median']:.3f}, p95 {row['p95']:.3f}; {row['notes']}" for row in rows]
    return {
        "metrics": metrics,
        "notes": [*notes, *(f"{row['room']} relit: {row['error_pct']:.1f} %" for row in relights)],
    }


def albedo_row(number: int, use: Use) -> dict[str, Any]:
    """Return one room's albedo errors: their quantiles by solid angle, `QUANTILES` at even steps."""
    room, truth = truth_of(number, use, quality=LIGHT_QUALITY)
    found, cpu_s = estimated(room, truth.empty_rgb)
    actual = truth.empty_albedo.reshape(ROWS, 2, 2 * ROWS, 2, 3).mean(axis=(1, 3))
    whole = (truth.empty_albedo.max(axis=2) > 0).reshape(ROWS, 2, 2 * ROWS, 2).all(axis=(1, 3))
    where = whole & (found.picture.max(axis=2) > 0)
    sample = weighed(np.abs(found.picture - actual).mean(axis=2)[where], where)
    return {
        "room": room.name,
        "lamps": room.lamps_on,
        "median": float(np.median(sample)),
        "p95": float(np.quantile(sample, 0.95)),
        "quantiles": [round(float(v), 5) for v in sample],
        "measured": float(found.measured[where].mean()),
        "cpu_s": cpu_s,
        "notes": "; ".join(found.notes),
    }


def relight_row(number: int, use: Use) -> dict[str, Any]:
    """Return one room's error under another sky."""
    room, truth = truth_of(number, use, quality=LIGHT_QUALITY)
    return {"room": room.name, "error_pct": relight_error(room, estimated(room, truth.empty_rgb)[0])}


def estimated(room: Room, empty_rgb: np.ndarray) -> tuple[RoomAlbedo, float]:
    """Return a room's albedo as its true emptied panorama gives it, and the CPU seconds that took."""
    outdoors = outdoors_of_room(room)
    start_s = time.process_time()
    found = albedo_of_room(picture(empty_rgb), room_model_of(room), outdoors, reveal_m=REVEAL_M, rows=ROWS)
    return found, time.process_time() - start_s


def weighed(values: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return `QUANTILES` of the values, drawn by their pixels' solid angles at even steps: every room counts alike."""
    area = solid_angles(Equirectangular(where.shape[1], where.shape[0]))[where]
    order = np.argsort(values)
    upto = np.cumsum(area[order])
    places = np.searchsorted(upto, (np.arange(QUANTILES) + 0.5) / QUANTILES * upto[-1])
    return values[order][places]


def picture(rgb: np.ndarray, validity: np.ndarray | None = None) -> LuminanceImage:
    """Return a panorama as a calibrated picture."""
    shape = rgb.shape[:2]
    return LuminanceImage(
        rgb=rgb.astype(np.float32),
        uncertainty=np.full(shape, 0.02, np.float32),
        validity=np.zeros(shape, np.uint8) if validity is None else validity,
        geometry=Equirectangular(shape[1], shape[0]),
        scale_uncertainty=0.02,
    )


def outdoors_of_room(room: Room) -> Outdoors:
    """Return the light outdoors as a picture of the sky gives it: the upper half, with the sun in one pixel."""
    geometry = Equirectangular(2 * OUTDOOR_ROWS, OUTDOOR_ROWS)
    rays, _ = directions(geometry)
    world = RoomWorld(room, LIGHT_QUALITY)
    rgb = world.radiance(Site.OUTDOOR, rays.astype(np.float32), math.pi / OUTDOOR_ROWS).astype(np.float64)
    disc = room.sky.disc()
    if disc is not None:
        place = np.unravel_index(np.argmax(rays @ np.array(disc.direction)), rays.shape[:2])
        rgb[place] += room.sky.sun_normal_illuminance_rgb / solid_angles(geometry)[place]
    below = rays[..., 2] <= 0
    rgb[below] = 0
    return outdoors_of(picture(rgb, np.where(below, Validity.OUTSIDE, Validity.VALID).astype(np.uint8)))


def relight_error(room: Room, found: RoomAlbedo) -> float:
    """Return the median relative error (%) of the recovered room under another sky."""
    other = make_room(room.seed, room.plan.use, sky="clear" if room.sky.kind == "overcast" else "overcast")
    other = replace(other, lamps_on=False)
    rays = equirectangular(RELIGHT_ROWS)
    world = RoomWorld(other.emptied(), LIGHT_QUALITY)
    actual = world.radiance(Site.INDOOR, rays.reshape(-1, 3), math.pi / RELIGHT_ROWS).reshape(*rays.shape) @ WEIGHTS
    before, after = found.scene.outdoors, with_captured_land(outdoors_of_room(other), found.scene.outdoors)
    pairs = zip(found.scene.panes, veil_gains(found.scene, before, after), strict=True)
    panes = tuple(replace(pane, veil_cd_m2=pane.veil_cd_m2 * np.float32(gain)) for pane, gain in pairs)
    scene = replace(found.scene, panes=panes, outdoors=after)
    geometry = Equirectangular(2 * RELIGHT_ROWS, RELIGHT_ROWS)
    ours = render(scene, geometry, room.eye, effort=EFFORTS["draft"]).rgb @ WEIGHTS
    step = ROWS // RELIGHT_ROWS
    solid = (found.picture.max(axis=2) > 0)[step // 2 :: step, step // 2 :: step] & (actual > 0)
    return 100 * float(np.median(np.abs(ours[solid] / actual[solid] - 1)))
