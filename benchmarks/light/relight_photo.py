"""A photograph in another light against the simulated room truly in it.

The emptied room is photographed once, at its own moment; its albedo and windows are recovered from that and from the
picture of the sky, and it is shown at another time of the same day. Once under the true sky of that time (a picture of
it, as `daylit relight --sky`), once under the model's (`--at`, weather as captured).
"""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import timedelta
from typing import Any

import numpy as np

from benchmarks.light.albedo import REVEAL_M, outdoors_of_room, picture
from benchmarks.truth_rooms import LIGHT_QUALITY, room_model_of, truth_of
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.sky.daylight import LOWEST_SUN_RAD, Moment, sun_of
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from mocks.worlds.light import Site
from processing.calibration.outdoor.sun_place import Place
from processing.light.picture.relight_photo import photograph_under, with_captured_land
from processing.light.scene.albedo import albedo_of_room
from processing.light.solver.basis import BASIS_EFFORTS, basis_of
from processing.light.solver.relight import RelightView, Relit
from processing.light.solver.stage import Stage
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.relighting.weather import captured_weather, daylight_at, level_illuminance
from processing.sphere import Equirectangular, solid_angles

ROWS, QUICK_ROWS = 256, 128
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)
LEAST_PATCH = 0.005
"""Of all that is not glass, that the sun must light for its patch to be compared."""
STEPS_H = (3, -3, 2, -2, 4, -4, 1, -1)


def other_moment(moment: Moment) -> Moment:
    """Return another time of the same day, three hours later if the sun is up then, else one that is near that."""
    for hours in STEPS_H:
        found = replace(moment, utc=moment.utc + timedelta(hours=hours))
        if sun_of(found)[1] >= LOWEST_SUN_RAD:
            return found
    return moment


def photographs(number: int, use: Use, *, quick: bool = False) -> dict[str, Any]:
    """Return the errors of one room, in per cent of luminance, by solid angle over what is not glass."""
    rows, effort = (QUICK_ROWS, BASIS_EFFORTS["draft"]) if quick else (ROWS, BASIS_EFFORTS["standard"])
    room, truth = truth_of(number, use, quality=LIGHT_QUALITY)
    moment = other_moment(room.moment)
    other = make_room(number, use, sky=room.sky.kind, moment=moment, lamps_on=room.lamps_on)
    actual, direct = _truly(other, rows)
    captured, then = outdoors_of_room(room), outdoors_of_room(other)
    found = albedo_of_room(picture(truth.empty_rgb), room_model_of(room), captured, reveal_m=REVEAL_M, rows=rows)
    stage = Stage.of(found.scene, effort.texel_m)
    times = len(truth.empty_rgb) // rows
    photograph = truth.empty_rgb.reshape(rows, times, 2 * rows, times, 3).mean(axis=(1, 3)).astype(np.float32)
    view = RelightView(stage, basis_of(stage, room.eye, effort=effort), rows)
    before = view.relit(found.scene.outdoors)
    place = Place(moment.latitude_deg, moment.longitude_deg)
    weather = captured_weather(found.scene.outdoors, room.moment.utc, place)
    modelled = daylight_at(moment.utc, place, moment.heading_rad, weather, found.scene.outdoors).outdoors
    row: dict[str, Any] = {"room": room.name, "sky": room.sky.kind, "lamps": room.lamps_on}
    level = photograph @ WEIGHTS
    surfaces = view.full.solid.reshape(level.shape) & (direct >= 0) & (actual > 0)
    row["unchanged_err_pct"] = _figures(level, actual, surfaces)[0]
    for name, outdoors in (("picture", with_captured_land(then, found.scene.outdoors)), ("model", modelled)):
        shown, after = photograph_under(photograph, view, before, outdoors)
        values = _figures(shown.rgb @ WEIGHTS, actual, surfaces)
        row |= {f"{name}_{key}_pct": value for key, value in zip(("err", "p95", "bias"), values, strict=True)}
    row["stated_err_pct"] = 100 * after.error
    row["sun_iou"] = _sun_iou(after, direct, surfaces)
    row["modelled_lx"], row["true_lx"] = (float(sum(level_illuminance(o)) @ WEIGHTS) for o in (modelled, then))
    return row


def _truly(room: Room, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the luminance of the emptied room as it truly is, and the share of the sun that it sees; -1 for glass."""
    world = RoomWorld(room.emptied(), LIGHT_QUALITY)
    rays = equirectangular(rows)
    flat = rays.reshape(-1, 3)
    rgb = world.radiance(Site.INDOOR, flat, math.pi / rows).reshape(*rays.shape)
    surface = world.view.surfaces(flat, math.pi / rows)
    share = np.full(len(flat), -1.0)
    share[surface.ray] = world.view.sunlit(surface)
    return rgb @ WEIGHTS, share.reshape(rays.shape[:2])


def _figures(ours: np.ndarray, actual: np.ndarray, where: np.ndarray) -> tuple[float, float, float]:
    """Return median and 95 % of the relative error, and the relative error of all light, in per cent."""
    area = solid_angles(Equirectangular(2 * len(where), len(where)))[where]
    off = np.abs(ours[where] / actual[where] - 1)
    order = np.argsort(off)
    upto = np.cumsum(area[order]) / area.sum()
    median, most = (float(off[order][np.searchsorted(upto, q)]) for q in (0.5, 0.95))
    bias = float((ours[where] * area).sum() / (actual[where] * area).sum() - 1)
    return 100 * median, 100 * most, 100 * bias


def _sun_iou(after: Relit, direct: np.ndarray, where: np.ndarray) -> float | None:
    """Return how well the patch of sun lies where it truly does; None where the sun lights hardly anything."""
    truly = (direct > 0.5) & where
    area = solid_angles(Equirectangular(2 * len(where), len(where)))
    if area[truly].sum() < LEAST_PATCH * area[where].sum():
        return None
    level = after.sun @ WEIGHTS
    if not (level > 0).any():
        return 0.0
    shown = (level > 0.3 * np.quantile(level[level > 0], 0.9)) & where
    return float(area[truly & shown].sum() / area[truly | shown].sum())
