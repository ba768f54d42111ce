"""All that is known of a simulated room, as pictures and lists, and on disk: OpenEXR, PNG and truth.json.

It is what every later answer is compared with; `benchmarks.truth_files` reads it back.
"""

import json
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.errors import DaylitError
from mocks.rooms.light.engine import irradiance_at
from mocks.rooms.light.geometry import Geometry
from mocks.rooms.light.light import lightings
from mocks.rooms.light.transport import load_scene
from mocks.rooms.model import Role
from mocks.rooms.room import Room
from mocks.rooms.sky.outdoors import directions_at
from mocks.rooms.view import RoomView
from mocks.rooms.world import RoomWorld
from mocks.worlds.light import LUMINANCE_WEIGHTS, Site, Vector
from processing.ground.arrays import AnyArray, Flags, Floats, Int16s

NOTHING = -1
"""Of class, instance and wall pictures: the ray leaves through a window (class), or nothing of that kind is there."""
WINDOWPANE = 8  # of ADE20K
_FINE = 3  # chosen: 9 samples a pixel


@dataclass(frozen=True)
class TruthPictures:
    """Equirectangular pictures (H, 2 H), longitude 0 (+y) at the centre, growing to the right; row 0 up.

    Geometry is that of the pixel's middle; light and albedo are means over the pixel. ``depth_m`` is the distance
    along the ray, inf through a window. ``ade`` is the ADE20K class, windowpane where the outdoors is seen, -1 for
    equipment. ``instance`` is the item's number, 0 for the shell. ``sunlit`` is the share of the sun's disc that
    the surface sees. ``luminance_rgb`` is the room as it stands, ``empty_rgb`` without its furniture, in RGB cd/m2;
    the sun's disc itself is in neither. ``empty_albedo`` and ``empty_sunlit`` belong to the emptied room.
    """

    luminance_rgb: Floats
    empty_rgb: Floats
    albedo: Floats
    empty_albedo: Floats
    depth_m: Floats
    normal: Floats
    ade: Int16s
    instance: Int16s
    wall: Int16s
    surface: Int16s
    """Index into ``surface_names``, -1 through a window."""
    surface_names: tuple[str, ...]
    furniture: Flags
    """Furniture and clutter: what is to be removed."""
    tripod: Flags
    sunlit: Floats
    empty_sunlit: Floats


@dataclass(frozen=True)
class PointLight:
    """Illuminance (lx) at a place, on a plane with a normal."""

    name: str
    point_m: Vector
    normal: Vector
    illuminance_lx: float


def equirectangular(rows: int) -> Floats:
    """Return unit directions of the pixel centres (H, 2 H, 3)."""
    longitude = ((np.arange(2 * rows) + 0.5) / (2 * rows) - 0.5) * (2 * math.pi)
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows) * math.pi
    return directions_at(longitude, latitude[:, None])


def truth_pictures(world: RoomWorld, rows: int = 512) -> TruthPictures:
    """Return all truths of a room as pictures (H, 2 H)."""
    empty = RoomWorld(world.room.emptied(), world.quality, world.drift)
    rays = equirectangular(rows)
    flat = rays.reshape(-1, 3)
    surface = world.view.surfaces(flat)
    parts = world.view.geometry.parts
    names = tuple(dict.fromkeys(part.surface for part in parts))
    shape = rays.shape[:2]

    def picture(values: AnyArray, outside: float) -> npt.NDArray[Any]:
        out = np.full((flat.shape[0], *values.shape[1:]), outside, values.dtype)
        out[surface.ray] = values
        return out.reshape(*shape, *values.shape[1:])

    def of_parts(values: list[Any], outside: float, kind: Any) -> npt.NDArray[Any]:
        return picture(np.array(values, kind)[surface.part], outside)

    removed = (Role.FURNITURE, Role.CLUTTER)
    tripods = [i.instance for i in world.room.items if i.kind == "tripod"]
    albedo, sunlit = _means(world.view, rows)
    empty_albedo, empty_sunlit = _means(empty.view, rows)
    return TruthPictures(
        luminance_rgb=_mean_radiance(world, rows),
        empty_rgb=_mean_radiance(empty, rows),
        albedo=albedo,
        empty_albedo=empty_albedo,
        depth_m=picture(surface.hits.distance_m, np.inf),
        normal=picture(surface.normal, 0),
        ade=of_parts([p.ade for p in parts], WINDOWPANE, np.int16),
        instance=of_parts([p.instance for p in parts], 0, np.int16),
        wall=of_parts([p.wall for p in parts], NOTHING, np.int16),
        surface=of_parts([names.index(p.surface) for p in parts], NOTHING, np.int16),
        surface_names=names,
        furniture=of_parts([p.role in removed for p in parts], False, bool),
        tripod=of_parts([p.instance in tripods for p in parts], False, bool),
        sunlit=sunlit,
        empty_sunlit=empty_sunlit,
    )


def point_lights(room: Room, *, samples: int = 4096, grid_m: float = 1.0) -> list[PointLight]:
    """Return illuminances: on a grid at table height (0.75 m), vertically and on level ground at the camera's place.

    Each is traced by itself, direct sun included. Outdoors, the open horizontal illuminance.
    """
    geometry = Geometry(room.parts())
    scenes = [load_scene(geometry.parts, light, glossy=False) for light in lightings(room).values()]
    out: list[PointLight] = []
    for name, point, normal in _places(room, geometry, grid_m):
        rgb = np.sum([irradiance_at(scene, point, normal, samples, seed=len(out)) for scene in scenes], axis=0)
        out.append(PointLight(name, point, normal, float(rgb @ LUMINANCE_WEIGHTS)))
    sky_lx, sun_lx = room.sky.horizontal_illuminance_lx()
    out.append(PointLight("outdoors, horizontal", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), sky_lx + sun_lx))
    return out


def description(room: Room) -> dict[str, Any]:
    """Return the room's geometry, place, time, light and furniture as plain values for JSON."""
    plan = asdict(room.plan)
    items = [
        {"kind": i.kind, "role": str(i.role), "instance": i.instance, "position_m": i.position_m, "size_m": i.size_m}
        | {"turn_rad": i.turn_rad}
        for i in room.items
    ]
    moment = asdict(room.moment) | {"utc": room.moment.utc.isoformat()}
    sky_lx, sun_lx = room.sky.horizontal_illuminance_lx()
    sky = asdict(room.sky) | {"sky_horizontal_lx": sky_lx, "sun_horizontal_lx": sun_lx}
    return {
        "name": room.name,
        "plan": plan,
        "furniture": items,
        "moment": moment,
        "sky": sky,
        "lamps_on": room.lamps_on,
        "glass_transmittance": room.glass_transmittance,
        "materials": {k: v["name"] if isinstance(v, dict) else v for k, v in asdict(room.finish).items()},
    }


def _places(room: Room, geometry: Geometry, grid_m: float) -> list[tuple[str, Vector, Vector]]:
    from shapely import Point, Polygon

    floor = Polygon(room.plan.polygon).buffer(-0.3)
    low_x, low_y, high_x, high_y = floor.bounds
    found: list[tuple[str, Vector, Vector]] = []
    for x in np.arange(math.ceil(low_x / grid_m) * grid_m, high_x, grid_m):
        for y in np.arange(math.ceil(low_y / grid_m) * grid_m, high_y, grid_m):
            point = (float(x), float(y), 0.75)
            if floor.contains(Point(x, y)) and _free(geometry, point):
                found.append((f"table height {x:+.1f} {y:+.1f}", point, (0.0, 0.0, 1.0)))
    sides: dict[str, Vector] = {"ahead": (0, 1, 0), "right": (1, 0, 0), "behind": (0, -1, 0), "left": (-1, 0, 0)}
    return found + [(f"camera, vertical, {name}", room.eye, normal) for name, normal in sides.items()]


def _free(geometry: Geometry, point: Vector) -> bool:
    """Return whether a point lies in the open: up and down, the next surface is seen from its outer side."""
    start = np.array([point, point], np.float32)
    hits = geometry.cast(start, np.array([(0, 0, 1), (0, 0, -1)], np.float32))
    if (hits.face < 0).any():
        return False
    towards = geometry.face_normals[hits.face][:, 2] * np.array([1, -1])
    return bool((towards < 0).all() and (hits.distance_m > 0.02).all())


def _fine_rays(rows: int) -> list[Floats]:
    """Return the directions of ``_FINE`` x ``_FINE`` places in each pixel."""
    fine = equirectangular(rows * _FINE)
    return [fine[i::_FINE, j::_FINE].reshape(-1, 3) for i in range(_FINE) for j in range(_FINE)]


def _mean_radiance(world: RoomWorld, rows: int) -> Floats:
    total = np.zeros((rows, 2 * rows, 3), np.float64)
    for rays in _fine_rays(rows):
        total += world.radiance(Site.INDOOR, rays, math.pi / (rows * _FINE)).reshape(total.shape)
    return (total / _FINE**2).astype(np.float32)


def _means(view: RoomView, rows: int) -> tuple[Floats, Floats]:
    """Return albedo (0 through windows) and the sunlit share, averaged over the pixels."""
    albedo = np.zeros((2 * rows * rows, 3), np.float64)
    sunlit = np.zeros(2 * rows * rows, np.float64)
    for rays in _fine_rays(rows):
        surface = view.surfaces(rays, math.pi / (rows * _FINE))
        albedo[surface.ray] += surface.albedo
        sunlit[surface.ray] += view.sunlit(surface)
    shape = (rows, 2 * rows)
    count = _FINE**2
    return (albedo / count).reshape(*shape, 3).astype(np.float32), (sunlit / count).reshape(shape).astype(np.float32)


FORMAT = 1  # of the truth's files; counts up
TRUTH_NAME = "truth.json"
LIGHT = {"luminance_rgb": "luminance.exr", "empty_rgb": "empty_luminance.exr", "depth_m": "depth.exr"}
LIGHT |= {name: f"{name}.exr" for name in ("albedo", "empty_albedo", "normal", "sunlit", "empty_sunlit")}
"""Pictures of 32-bit floats, by field of `TruthPictures`: channels R, G, B, or Y alone."""
NUMBERS = {"ade": "ade.png", "instance": "instance.png", "wall": "wall.png", "surface": "surface.png"}
"""16-bit PNG. All but instances are stored plus 1, so that 0 stands for none (-1)."""
MASKS = {"furniture": "furniture.png", "tripod": "tripod.png"}  # 8-bit PNG, 0 or 255
COUNTED_FROM_0 = ("instance",)


class TruthFileError(DaylitError, code="SIM-004", exit_code=6):
    """The truth of a simulated room cannot be written, or what is there is not whole."""


def save_truth(folder: Path, room: Room, pictures: TruthPictures, lights: list[PointLight]) -> None:
    """Write the truth into a new folder.

    Raises `TruthFileError`: the folder is there already or may not be written, or the disk is full.
    """
    try:
        folder.mkdir(parents=True)
        _write(folder, room, pictures, lights)
    except (OSError, RuntimeError) as error:
        text = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise TruthFileError(text, where=str(folder), advice="free some space, or choose another folder") from error


def _write(folder: Path, room: Room, pictures: TruthPictures, lights: list[PointLight]) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    for name, file in LIGHT.items():
        picture = np.ascontiguousarray(getattr(pictures, name), dtype=np.float32)
        channels = {"Y" if picture.ndim == 2 else "RGB": picture}
        OpenEXR.File(header, channels).write(os.fspath(folder / file))
    for name, file in NUMBERS.items():
        values = getattr(pictures, name)
        _write_png(folder / file, (values if name in COUNTED_FROM_0 else values + np.int16(1)).astype(np.uint16))
    for name, file in MASKS.items():
        _write_png(folder / file, getattr(pictures, name).astype(np.uint8) * np.uint8(255))
    facts = {
        "format": FORMAT,
        **description(room),
        "seed": room.seed,
        "point_lights": [asdict(light) for light in lights],
        "surface_names": pictures.surface_names,
        "rows": pictures.ade.shape[0],
        "pictures": {**LIGHT, **NUMBERS, **MASKS},
    }
    (folder / TRUTH_NAME).write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n", "utf-8")


def _write_png(path: Path, picture: AnyArray) -> None:
    import cv2

    whole, data = cv2.imencode(".png", picture)
    if not whole:
        raise OSError("the picture cannot be encoded")
    path.write_bytes(data.tobytes())
