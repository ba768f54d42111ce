"""Rooms of test seeds for time against error: their shapes, windows and furniture's boxes, under light of three kinds.

Everything is matte and plain, so that four renderers can have the same scene: ours, Mitsuba's `path`, Radiance, Cycles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.light.render_scenes import _box, sky_outdoors
from benchmarks.truth_rooms import room_model_of, truth_list
from mocks.rooms.room import make_room
from processing.ground.room_model import OpeningKind, RoomModel
from processing.light.scene.scene import Material, Outdoors, Part, Scene, Sun, plain, shell_of

KINDS = ("sun", "overcast", "lamps")
SMALL_M, LARGE_M = 0.9, 2.4
"""Width of the only window in sun, and of the largest under clouds, where the wall has room for it."""
SUN_LX = (75e3, 70e3, 62e3)
LAMP_CD_M2 = (9e3, 8e3, 6e3)
BLUISH = np.array([0.8, 1.0, 1.3])


@dataclass(frozen=True)
class RaceRoom:
    """One room of the race."""

    name: str
    kind: str
    scene: Scene
    eye_m: tuple[float, float, float]


def race_rooms(count: int, seed: int) -> list[RaceRoom]:
    """Return ``count`` rooms of test seeds with a window: small with sun, large overcast, night with lamps in turn."""
    found: list[RaceRoom] = []
    for number, use in truth_list("test", 4 * count, seed):
        if len(found) == count:
            break
        room = make_room(number, use)
        model = room_model_of(room)
        windows = [o for o in model.openings if o.kind is OpeningKind.WINDOW]
        if windows:
            kind = KINDS[len(found) % len(KINDS)]
            found.append(RaceRoom(room.name, kind, _scene(model, kind, room), room.eye))
    return found


def _scene(model: RoomModel, kind: str, room: object) -> Scene:
    model = _with_window(model, SMALL_M if kind == "sun" else LARGE_M if kind == "overcast" else None)
    finish = room.finish  # type: ignore[attr-defined]
    floor = tuple(float(v) for v in finish.floor.colour)
    colours = {"floor": floor, "ceiling": (0.8, 0.8, 0.78)}
    walls = tuple(
        float(v) for v in np.clip(finish.wall.colour if hasattr(finish, "wall") else (0.65, 0.63, 0.6), 0, 0.9)
    )
    surfaces, panes = shell_of(model, reveal_m=0.2, albedo=lambda name: plain(colours.get(name, walls)))
    parts = _boxes(room, model)
    if kind == "lamps":
        parts = (*parts, _lamp(model))
    return Scene(surfaces, panes, _outdoors(kind, panes[0].across_m), parts)


def _with_window(model: RoomModel, width_m: float | None) -> RoomModel:
    """Return a room with one window only, as wide as asked for where its wall allows; None: as it is."""
    windows = [o for o in model.openings if o.kind is OpeningKind.WINDOW]
    first = max(windows, key=lambda o: o.end_m - o.start_m)
    if width_m is None:
        return model.model_copy(update={"openings": tuple(windows)})
    a, b = model.floor[first.wall], model.floor[(first.wall + 1) % len(model.floor)]
    long = math.dist(a, b)
    half, middle = min(width_m, long - 0.4) / 2, (first.start_m + first.end_m) / 2
    middle = min(max(middle, half + 0.2), long - half - 0.2)
    one = first.model_copy(update={"start_m": middle - half, "end_m": middle + half})
    return model.model_copy(update={"openings": (one,)})


def _outdoors(kind: str, across: np.ndarray) -> Outdoors:
    if kind == "overcast":
        return sky_outdoors(lambda rays: 6000 * np.repeat((1 + 2 * rays[..., 2:]) / 3, 3, axis=-1), rows=128)
    if kind == "lamps":
        return Outdoors(np.full((16, 32, 3), 0.02, np.float32))
    # Panes go along their wall with the room on their left: outside is to the right.
    out = np.array([across[1], -across[0]]) / np.linalg.norm(across)
    turn = math.radians(20)
    x, y = math.cos(turn) * out[0] - math.sin(turn) * out[1], math.sin(turn) * out[0] + math.cos(turn) * out[1]
    high = math.radians(35)
    sun = Sun((x * math.cos(high), y * math.cos(high), math.sin(high)), SUN_LX)
    around = np.array(sun.direction)
    return sky_outdoors(
        lambda rays: (3000 + 9000 * np.exp(4 * (rays @ around) - 4))[..., None] * BLUISH, rows=128, sun=sun
    )


def _boxes(room: object, model: RoomModel) -> tuple[Part, ...]:
    """Return up to six boxes of furniture along the room, away from the camera: half the way to each corner."""
    rng = np.random.default_rng(room.seed)  # type: ignore[attr-defined]
    parts = []
    for x, y in model.floor[:6]:
        far = math.hypot(x, y)
        share = 0.62
        if far * share < 0.9:
            continue
        size = rng.uniform((0.35, 0.35, 0.4), (0.7, 0.7, 1.1))
        colour = tuple(float(v) for v in rng.uniform(0.15, 0.7, 3))
        centre = (share * x, share * y, size[2] / 2 + 0.001)
        parts.append(_box(centre, tuple(size), colour))  # type: ignore[arg-type]
    return tuple(parts)


def _lamp(model: RoomModel) -> Part:
    """Return a shining box of 40 cm below the ceiling, not quite over the camera."""
    box = _box((0.3, 0.4, model.ceiling_height_m - 0.06), (0.4, 0.4, 0.08), (0.02, 0.02, 0.02))
    return replace(box, name="lamp", material=Material("lamp", (0.02, 0.02, 0.02), emission_cd_m2=LAMP_CD_M2))
