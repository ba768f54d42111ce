"""The baked light of furnished rooms with sun in them: run time and error, beside a plain path tracer's.

The measure is the renderer's own meter on the very points: walls, floor and ceiling that the camera sees out of the
direct sun, under the whole sky with the sun's disc, without anything that baking does to be quick (a sky cut to what
can enter, sun patches as lamps, components apart, masks, noise removal). It is kept on disk: it is not what is timed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.paired import Cost, cost_of
from benchmarks.seeds import seeds
from mocks.optics.picture_cache import PictureCache, content_key
from mocks.rooms.light.cube import Cube
from mocks.rooms.light.engine import irradiance_at
from mocks.rooms.light.geometry import Geometry
from mocks.rooms.light.light import ENVIRONMENT_ROWS, QUALITIES, Baked, Quality, bake, lightings
from mocks.rooms.light.sunlight import enters
from mocks.rooms.light.transport import Lighting, Sampling, load_scene, render_cube
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.view import RoomView, Surface
from mocks.rooms.world import LIGHT_VERSION
from mocks.worlds.light import LUMINANCE_WEIGHTS, Vector
from processing.ground.arrays import Doubles, Floats

POINTS, RAYS, CANDIDATES = 40, 4000, 200
SAMPLES, BATCHES = 2**15, 4
OURS = ("draft",)
WARM = Quality(16, 1)
_LIFT_M = 1e-3


@dataclass(frozen=True)
class Scene:
    """A room and what is known of its light: points, their illuminance (lx) and its standard error (relative)."""

    room: Room
    geometry: Geometry
    places: Surface
    truth_lx: Doubles
    truth_error: Doubles


@dataclass(frozen=True)
class Run:
    """What one method took in one room, and its relative errors at the points."""

    method: str
    label: str
    cost: Cost
    errors: Doubles
    bias: float
    """Of the mean over all points."""


@dataclass(frozen=True)
class Summary:
    """A method's figures over all rooms: mean cost of one room, errors of all points together."""

    method: str
    label: str
    cpu_s: float
    wall_s: float
    median_err_pct: float
    p95_err_pct: float
    bias_pct: float

    def figures(self) -> dict[str, float]:
        """Return the figures by key."""
        return {
            "cpu_s": round(self.cpu_s, 2),
            "wall_s": round(self.wall_s, 2),
            "median_err_pct": round(self.median_err_pct, 2),
            "p95_err_pct": round(self.p95_err_pct, 2),
            "bias_pct": round(self.bias_pct, 2),
        }

    def __str__(self) -> str:
        """Return the figures for a note."""
        return (
            f"{self.method} {self.label}: {self.cpu_s:.1f} CPU s, {self.wall_s:.1f} s, error median "
            f"{self.median_err_pct:.1f} %, 95th percentile {self.p95_err_pct:.1f} %, bias {self.bias_pct:+.1f} %"
        )


@dataclass(frozen=True)
class Outcome:
    """What a benchmark reports of the rooms' light."""

    metrics: dict[str, float]
    rival: dict[str, float]
    notes: list[str]
    summaries: list[Summary]


def room_light(rooms: int, seed: int, qualities: Sequence[str] = OURS, samples: Sequence[int] = (16,)) -> Outcome:
    """Measure the baked light at some qualities and plain paths at some samples a pixel, the first the rival."""
    scenes = [measured_scene(room, seed) for room in sunny_rooms(rooms, seed)]
    warm_up(scenes[0])
    ours = {name: summary([baked_run(scene, name) for scene in scenes]) for name in qualities}
    plain = [summary([plain_run(scene, count) for scene in scenes]) for count in samples]
    metrics: dict[str, float] = {"room_light_rooms": len(scenes)}
    for name in OURS:
        metrics |= {f"room_{name}_{key}": value for key, value in ours[name].figures().items()}
    noise_pct = 100 * float(np.median(np.concatenate([scene.truth_error for scene in scenes])))
    metrics["room_light_truth_noise_pct"] = round(noise_pct, 2)
    rival = plain[0].figures() | {"ratio_draft_over_it": round(cost_ratio(ours["draft"], plain[0]), 5)}
    names = ", ".join(scene.room.name for scene in scenes)
    notes = [f"room light in {names}; the measure's own standard error is {noise_pct:.1f} %"]
    summaries = [*ours.values(), *plain]
    return Outcome(metrics, rival, notes + [str(one) for one in summaries], summaries)


def sunny_rooms(count: int, seed: int) -> list[Room]:
    """Return the first furnished test rooms in which a clear sky's sun shines through a window."""
    found: list[Room] = []
    for number in seeds("test", CANDIDATES, seed):
        room = make_room(number, sky="clear", lamps_on=False)
        if room.plan.use is not Use.EMPTY and enters(room.panes, room.sky.disc()):
            found.append(room)
        if len(found) == count:
            break
    return found


def measured_scene(room: Room, seed: int, samples: int = SAMPLES) -> Scene:
    """Return a room with points drawn evenly over what the camera sees, and their light from ``samples`` rays each."""
    geometry = Geometry(room.parts())
    view = RoomView(room, geometry, {}, WARM.face_px)
    rng = np.random.default_rng([seed, 29])
    rays = rng.normal(size=(RAYS, 3))
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
    seen = view.surfaces(rays)
    plain = np.array([part.surface in ("wall", "floor", "ceiling") for part in geometry.parts])
    fit = np.flatnonzero(plain[seen.part] & (view.sunlit(seen) == 0))
    places = view.surfaces(rays[seen.ray[rng.choice(fit, POINTS, replace=False)]])
    found = _metered(room, geometry, places, samples)
    mean = found.mean(axis=1)
    return Scene(room, geometry, places, mean, found.std(axis=1, ddof=1) / BATCHES**0.5 / mean)


def baked_run(scene: Scene, name: str) -> Run:
    """Bake all components at a quality, with the sky's map at hand."""
    quality, lights = QUALITIES[name], lightings(scene.room)

    def work() -> dict[str, Baked]:
        return {key: bake(scene.room, scene.geometry, light, quality) for key, light in lights.items()}

    return _run(scene, ("baked", name), quality.face_px, work)


def plain_run(scene: Scene, samples: int) -> Run:
    """Render the draft's cube as one would at first: the whole sky, the sun's disc, nothing done about the noise."""
    cube, room, light = Cube(QUALITIES["draft"].face_px), scene.room, _whole(scene.room)
    colours = np.array([part.material.colour for part in scene.geometry.parts] + [(1.0, 1.0, 1.0)], np.float32)

    def work() -> dict[str, Baked]:
        renderer = load_scene(scene.geometry.parts, light, glossy=False)
        radiance = render_cube(renderer, room.eye, Sampling(cube, samples))
        rays = cube.directions().reshape(-1, 3)
        hits = scene.geometry.cast(np.array(room.eye, np.float32), rays)
        part = np.where(hits.face >= 0, scene.geometry.part_of[hits.face], -1)
        albedo = np.maximum(colours[part], np.float32(0.01)).reshape(radiance.shape)
        return {"light": Baked(np.asarray(radiance * np.float32(np.pi) / albedo, dtype=np.float32), None)}

    return _run(scene, ("plain path", f"{samples} spp"), cube.face_px, work)


def warm_up(scene: Scene) -> None:
    """Bake once with next to no work, so that no figure counts what is loaded and compiled."""
    bake(scene.room, scene.geometry, Lighting(environment_rgb=np.ones((16, 32, 3), np.float32)), WARM)


def summary(runs: Sequence[Run]) -> Summary:
    """Return the figures of one method's runs in several rooms."""
    errors = np.abs(np.concatenate([run.errors for run in runs]))
    return Summary(
        runs[0].method,
        runs[0].label,
        float(np.mean([run.cost.cpu_s for run in runs])),
        float(np.mean([run.cost.wall_s for run in runs])),
        100 * float(np.median(errors)),
        100 * float(np.percentile(errors, 95)),
        100 * float(np.mean([run.bias for run in runs])),
    )


def cost_ratio(ours: Summary, rival: Summary) -> float:
    """Return our CPU time over the rival's at our median error; its error falls with the root of its time."""
    return ours.cpu_s / (rival.cpu_s * (rival.median_err_pct / ours.median_err_pct) ** 2)


def _run(scene: Scene, name: tuple[str, str], face_px: int, work: Callable[[], dict[str, Baked]]) -> Run:
    made: dict[str, Baked] = {}
    cost = cost_of(lambda: made.update(work()))
    view = RoomView(scene.room, scene.geometry, made, face_px)
    found = _luminous(view.irradiance(scene.places, tuple(made)))
    return Run(*name, cost, found / scene.truth_lx - 1, float(found.sum() / scene.truth_lx.sum() - 1))


def _whole(room: Room) -> Lighting:
    """Return all daylight at once: the whole sky and land, and the sun's disc."""
    glass = np.array(room.glass_transmittance, np.float32)
    red, green, blue = (float(v) for v in room.sky.sun_normal_illuminance_rgb * glass)
    return Lighting(
        environment_rgb=room.sky.environment(ENVIRONMENT_ROWS) * glass,
        sun=(room.sky.sun_direction, (red, green, blue)),
    )


def _metered(room: Room, geometry: Geometry, places: Surface, samples: int) -> Doubles:
    """Return illuminances (points, batches), from the cache or measured now (a minute or so)."""
    cache = PictureCache()
    key = content_key(
        "room light measured", LIGHT_VERSION, room.key, places.point.tolist(), samples, version("mitsuba")
    )
    if (data := cache.read(key, ".json")) is not None:
        return np.array(json.loads(data))
    scene = load_scene(geometry.parts, _whole(room), glossy=False)
    each = samples // BATCHES
    found = [[_meter(scene, places, k, each, b) for b in range(BATCHES)] for k in range(POINTS)]
    cache.write(key, ".json", json.dumps(found).encode())
    return np.array(found)


def _meter(scene: Any, places: Surface, number: int, samples: int, batch: int) -> float:
    normal = places.normal[number]
    point = places.point[number] + np.float32(_LIFT_M) * normal
    rgb = irradiance_at(scene, _vector(point), _vector(normal), samples, seed=BATCHES * number + batch)
    return float(_luminous(rgb))


def _luminous(rgb: Floats | Doubles) -> Doubles:
    return np.asarray(rgb.astype(np.float64) @ np.asarray(LUMINANCE_WEIGHTS, np.float64))


def _vector(values: Floats) -> Vector:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
