"""Albedo by inverse radiosity in simulated rooms of test seeds, from the truth panorama of the emptied room.

``median_err`` and ``p95_err`` are of the absolute error (mean of R, G, B) over all that the room shows, by
solid angle: fixtures, curtains, doors and blinds too, of which the room model knows nothing. ``day_*`` are of rooms
without lit lamps, ``lamps_*`` of those with. ``told_pct`` is the share of pixels that tell their own albedo.
``relight_median_err_pct``: the recovered room under another sky against the simulated room under it, luminance of all
visible surfaces. The light outdoors comes from a picture of the upper half with the sun in it; what lies below the
horizon is not given.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks._truth_rooms import QUALITY, kept_list, room_model_of, truth_of
from mocks.light import Site
from mocks.rooms.room import Room, make_room
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from processing.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.rendering.albedo import RoomAlbedo, albedo_of_room
from processing.rendering.irradiance import EFFORTS
from processing.rendering.outdoor import outdoors_of
from processing.rendering.render import render
from processing.rendering.scene import Outdoors
from processing.sphere import Equirectangular, directions, solid_angles

ROWS, OUTDOOR_ROWS, RELIGHT_ROWS = 256, 256, 64
QUICK_ROOMS, FULL_ROOMS = 2, 16
REVEAL_M = 0.24
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    errors: dict[str, list[np.ndarray]] = {"all": [], "day": [], "lamps": []}
    told, cpu_s, relights, notes = [], [], [], []
    rooms = kept_list("test", 4 * FULL_ROOMS, seed)[: QUICK_ROOMS if quick else FULL_ROOMS]
    for number, use in rooms:
        room, truth = truth_of(number, use)
        outdoors = outdoors_of_room(room)
        start_s = time.process_time()
        found = albedo_of_room(picture(truth.empty_rgb), room_model_of(room), outdoors, reveal_m=REVEAL_M, rows=ROWS)
        cpu_s.append(time.process_time() - start_s)
        actual = truth.empty_albedo.reshape(ROWS, 2, 2 * ROWS, 2, 3).mean(axis=(1, 3))
        whole = (truth.empty_albedo.max(axis=2) > 0).reshape(ROWS, 2, 2 * ROWS, 2).all(axis=(1, 3))
        where = whole & (found.picture.max(axis=2) > 0)
        sample = weighed(np.abs(found.picture - actual).mean(axis=2)[where], where)
        errors["all"].append(sample)
        errors["lamps" if room.lamps_on else "day"].append(sample)
        told.append(found.told[where].mean())
        notes.append(f"{room.name}: median {np.median(sample):.3f}; {'; '.join(found.notes)}")
        if not room.lamps_on and len(relights) < (1 if quick else 8):
            relights.append(relight_error(room, found))
    metrics = {"rooms": len(rooms), "told_pct": round(100 * float(np.mean(told)), 2)}
    for name, key in (("all", ""), ("day", "day_"), ("lamps", "lamps_")):
        if errors[name]:
            pooled = np.concatenate(errors[name])
            metrics[f"{key}median_err"] = round(float(np.median(pooled)), 4)
            metrics[f"{key}p95_err"] = round(float(np.quantile(pooled, 0.95)), 4)
    metrics["cpu_s"] = round(float(np.median(cpu_s)), 2)
    if relights:
        metrics["relight_median_err_pct"] = round(float(np.median(relights)), 2)
    return {"metrics": metrics, "notes": notes}


def weighed(values: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return 4,000 of the values, drawn by their pixels' solid angles at even steps: every room counts alike."""
    area = solid_angles(Equirectangular(where.shape[1], where.shape[0]))[where]
    order = np.argsort(values)
    upto = np.cumsum(area[order])
    places = np.searchsorted(upto, (np.arange(4000) + 0.5) / 4000 * upto[-1])
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
    """Return the light outdoors as a picture of the sky tells it: the upper half, with the sun in one pixel."""
    geometry = Equirectangular(2 * OUTDOOR_ROWS, OUTDOOR_ROWS)
    rays, _ = directions(geometry)
    world = RoomWorld(room, QUALITY)
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
    world = RoomWorld(other.emptied(), QUALITY)
    actual = world.radiance(Site.INDOOR, rays.reshape(-1, 3), math.pi / RELIGHT_ROWS).reshape(*rays.shape) @ WEIGHTS
    scene = found.scene.under(outdoors_of_room(other))
    geometry = Equirectangular(2 * RELIGHT_ROWS, RELIGHT_ROWS)
    ours = render(scene, geometry, room.eye, effort=EFFORTS["draft"]).rgb @ WEIGHTS
    step = ROWS // RELIGHT_ROWS
    solid = (found.picture.max(axis=2) > 0)[step // 2 :: step, step // 2 :: step] & (actual > 0)
    return 100 * float(np.median(np.abs(ours[solid] / actual[solid] - 1)))
