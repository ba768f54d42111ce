"""Scenes whose light is known by calculation, built and rendered as the rooms are; errors in per cent, by case.

``spp`` is the number of rays that start from each meter.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.light import analytic
from mocks.rooms.light.engine import environment_emitter, irradiance_at, irradiance_over, mesh_shape, mitsuba
from processing.ground.mesh import Mesh, box, merge, quad

Errors = dict[str, float]
Triple = tuple[float, float, float]
UP: Triple = (0.0, 0.0, 1.0)
SKIES = {"overcast": analytic.overcast, "uniform": analytic.uniform}
GROUND_ALBEDO = 0.3


def furnace(spp: int, seed: int) -> Errors:
    """White furnaces: where every surface gives off or passes on the same light, all is equally bright.

    Closed: a room with two blocks, every surface emitting 20 and reflecting 80 %. Open: a white room without loss,
    open to the front, with a block in it, under a uniform sky.
    """
    room, blocks = inwards(box((0, 0, 0), (5, 4, 2.7))), [box((1, 1, 0), (2, 3, 0.8)), box((4, 0, 0), (5, 1, 2))]
    whole = merge([room, *blocks])
    closed = _scene(room=mesh_shape(whole, _diffuse(0.8), _area(20.0)))
    front_open = merge([_without_front((0, 0, 0), (5, 4, 2.7)), *blocks])
    opened = _scene(room=mesh_shape(front_open, _diffuse(1.0)), sky=_sky(analytic.uniform, 1.0))
    places: dict[str, tuple[Triple, Triple]] = {
        "floor": ((3.0, 2.0, 0.0), UP),
        "corner": ((0.02, 3.98, 0.02), (1.0, -1.0, 1.0)),
        "wall": ((2.5, 4.0, 1.3), (0.0, -1.0, 0.0)),
    }
    errors = {}
    for number, (name, (point, normal)) in enumerate(places.items()):
        wanted = math.pi * analytic.furnace_radiance(20.0, 0.8)
        errors[f"closed, {name}"] = _error(irradiance_at(closed, point, normal, spp, seed + number), wanted)
        errors[f"open, {name}"] = _error(irradiance_at(opened, point, normal, spp, seed + number), math.pi)
    return errors


def integrating(spp: int, seed: int) -> Errors:
    """Reflected light on the floor of a cube (4 m, 10 klm in its middle) and in a sphere, at three albedos."""
    flux_lm = 10_000.0
    errors = {}
    for number, albedo in enumerate((0.2, 0.5, 0.8)):
        cube = inwards(box((-2, -2, -2), (2, 2, 2)))
        lamp = {"type": "point", "position": [0, 0, 0], "intensity": {"type": "rgb", "value": flux_lm / (4 * math.pi)}}
        scene = _scene(cube=mesh_shape(cube, _diffuse(albedo)), lamp=lamp)
        floor = irradiance_over(scene, quad((-2, -2, -2), (4, 0, 0), (0, 4, 0)), spp, seed + number)
        errors[f"cube, albedo {albedo}"] = _error(floor, analytic.indirect_lux(flux_lm, 96.0, albedo))
        sphere = {"type": "sphere", "radius": 2.0, "flip_normals": True, "bsdf": _diffuse(albedo)}
        scene = _scene(sphere=sphere, lamp=lamp)
        wall = irradiance_at(scene, (0.0, 0.0, -1.999), UP, spp, seed + number)
        errors[f"sphere, albedo {albedo}"] = _error(wall, analytic.indirect_lux(flux_lm, 16 * math.pi, albedo))
    return errors


def form_factors(spp: int, seed: int) -> Errors:
    """Rectangles that shine on each other, with nothing else: parallel and at a right angle."""
    floor = quad((0, 0, 0), (5, 0, 0), (0, 4, 0))
    cases = {
        "floor and ceiling": (
            inwards(quad((0, 0, 2.7), (5, 0, 0), (0, 4, 0))),
            analytic.parallel_form_factor(5, 4, 2.7),
        ),
        "floor and wall": (quad((0, 0, 0), (0, 4, 0), (0, 0, 2.7)), analytic.perpendicular_form_factor(5, 2.7, 4)),
        "far squares": (inwards(quad((0, 0, 10), (5, 0, 0), (0, 4, 0))), analytic.parallel_form_factor(5, 4, 10)),
    }
    errors = {}
    for number, (name, (lamp, factor)) in enumerate(cases.items()):
        scene = _scene(lamp=mesh_shape(lamp, _diffuse(0.0), _area(100.0)))
        errors[name] = _error(irradiance_over(scene, floor, spp, seed + number), math.pi * 100.0 * factor)
    return errors


def daylight(spp: int, seed: int) -> Errors:
    """Black rooms of 4 x 4 x 3 m with an unglazed opening in roof or wall, as in CIE 171:2006, 5.9 to 5.12.

    Roof: 1 x 1 m and 4 x 4 m, points on the floor and a wall: the sky's part. Facade: 2 x 1 m and 4 x 3 m, points on
    the floor and on the wall behind: sky and ground (albedo 0.3).
    """
    roofs = {"roof 1 x 1 m": (1.5, 1.5, 1.0, 1.0), "roof 4 x 4 m": (0.0, 0.0, 4.0, 4.0)}
    facades = {"facade 2 x 1 m": (1.0, 1.0, 2.0, 1.0), "facade 4 x 3 m": (0.0, 0.0, 4.0, 3.0)}
    to_roof: list[tuple[Triple, Triple]] = [
        ((2.0, 2.0, 0.0), UP),
        ((0.8, 2.0, 0.0), UP),
        ((0.0, 2.0, 1.2), (1.0, 0.0, 0.0)),
    ]
    to_facade: list[tuple[Triple, Triple]] = [
        ((2.0, 1.0, 0.0), UP),
        ((2.0, 3.0, 0.0), UP),
        ((2.0, 4.0, 1.5), (0.0, -1.0, 0.0)),
    ]
    cases = [(name, _roof(*hole), to_roof) for name, hole in roofs.items()]
    cases += [(name, _facade(*hole), to_facade) for name, hole in facades.items()]
    errors = {}
    for sky_name, sky in SKIES.items():
        ground = GROUND_ALBEDO * analytic.open_ground_lux(sky) / math.pi

        def light(sine: Any, sky: Any = sky, ground: float = ground) -> Any:
            return np.where(sine < 0, ground, sky(np.maximum(sine, 0.0)))

        for number, (name, (walls, opening), points) in enumerate(cases):
            scene = _scene(room=mesh_shape(walls, _diffuse(0.0)), sky=_sky(light, 1.0))
            for place, (point, normal) in enumerate(points):
                wanted = analytic.through_opening_lux(point, normal, opening, light)
                found = irradiance_at(scene, point, normal, spp, seed + 10 * number + place)
                errors[f"{name}, {sky_name}, point {place + 1}"] = _error(found, wanted)
    return errors


def inwards(mesh: Mesh) -> Mesh:
    """Return the mesh seen from its other side."""
    return Mesh(mesh.vertices, -mesh.normals, mesh.uv, np.ascontiguousarray(mesh.faces[:, ::-1]))


def _roof(x: float, y: float, width: float, depth: float) -> tuple[Mesh, tuple[Triple, Triple, Triple]]:
    """Return a room's walls with a hole in the roof, and the hole."""
    room = [quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), *_walls(4)]
    strips = [((0, 0), (4, y)), ((0, y + depth), (4, 4)), ((0, y), (x, y + depth)), ((x + width, y), (4, y + depth))]
    for (x0, y0), (x1, y1) in strips:
        if x1 > x0 and y1 > y0:
            room.append(inwards(quad((x0, y0, 3), (x1 - x0, 0, 0), (0, y1 - y0, 0))))
    return merge(room), ((x, y, 3.0), (width, 0.0, 0.0), (0.0, depth, 0.0))


def _facade(x: float, z: float, width: float, height: float) -> tuple[Mesh, tuple[Triple, Triple, Triple]]:
    """Return a room's walls with a hole in the wall y = 0, and the hole."""
    room = [quad((0, 0, 0), (4, 0, 0), (0, 4, 0)), inwards(quad((0, 0, 3), (4, 0, 0), (0, 4, 0))), *_walls(3)]
    strips = [((0, 0), (4, z)), ((0, z + height), (4, 3)), ((0, z), (x, z + height)), ((x + width, z), (4, z + height))]
    for (x0, z0), (x1, z1) in strips:
        if x1 > x0 and z1 > z0:
            room.append(inwards(quad((x0, 0, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0))))
    return merge(room), ((x, 0.0, z), (width, 0.0, 0.0), (0.0, 0.0, height))


def _walls(count: int) -> list[Mesh]:
    """Return the walls of a 4 x 4 x 3 m room: left, behind, right, front."""
    up = (0.0, 0.0, 3.0)
    starts: list[tuple[Triple, Triple]] = [
        ((0, 0, 0), (0, 4, 0)),
        ((0, 4, 0), (4, 0, 0)),
        ((4, 4, 0), (0, -4, 0)),
        ((4, 0, 0), (-4, 0, 0)),
    ]
    return [quad(corner, along, up) for corner, along in starts[:count]]


def _without_front(low: Triple, high: Triple) -> Mesh:
    """Return a block seen from inside without its face at the least y, which `box` makes first."""
    whole = inwards(box(low, high))
    return Mesh(whole.vertices, whole.normals, whole.uv, whole.faces[2:])


def _sky(light: analytic.SkyLuminance, scale: float, height: int = 256) -> dict[str, Any]:
    sine = np.sin(math.pi * (0.5 - (np.arange(height) + 0.5) / height))
    rows = (scale * light(sine)).astype(np.float32)
    return environment_emitter(np.tile(rows[:, None, None], (1, 2 * height, 3)))


def _scene(**parts: Any) -> Any:
    return mitsuba().load_dict({"type": "scene", **parts})


def _diffuse(albedo: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}


def _area(radiance: float) -> dict[str, Any]:
    return {"type": "area", "radiance": {"type": "rgb", "value": radiance}}


def _error(found_rgb: Any, wanted: float) -> float:
    """Return the error in per cent; the three channels saw the same light."""
    return 100 * (float(np.mean(found_rgb)) / wanted - 1)
