"""The renderer's scenes: a room's triangles in plain colours under one light, pictured on the six faces of a cube.

Mitsuba's stock path tracer does the light transport, so that the truth shares nothing with our own rendering. Light
bounces off textures by their mean albedo; the textures themselves are seen by `mocks.rooms.view`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mocks.light import Floats, Vector
from mocks.rooms.cube import FACES, Cube
from mocks.rooms.engine import environment_emitter, mesh_shape, mitsuba, sun_emitter
from mocks.rooms.mesh import Part, merge
from mocks.rooms.model import Material

MAX_DEPTH = 16
_RUSSIAN_ROULETTE_DEPTH = 8
_DARK = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Lighting:
    """One component of light: what comes in from outside, and whether the lamps are lit.

    ``environment_rgb`` is an equirectangular map (rows, 2 rows, 3) in cd/m2 as seen through the glass; ``sun`` the
    direction to the sun and its illuminance (lx, RGB) on a plane facing it, behind the glass.
    """

    environment_rgb: Floats | None = None
    sun: tuple[Vector, Vector] | None = None
    lamps: bool = False


@dataclass(frozen=True)
class Sampling:
    """How much work goes into a picture."""

    cube: Cube
    samples: int
    seed: int = 0
    max_depth: int = MAX_DEPTH


@dataclass(frozen=True)
class _Group:
    """What one shape of the renderer needs to be of one make."""

    colour: Vector
    roughness: float | None
    emission: Vector = field(default=_DARK)


def load_scene(parts: Sequence[Part], lighting: Lighting, *, glossy: bool, max_depth: int = MAX_DEPTH) -> Any:
    """Return the renderer's scene; with ``glossy`` false every surface is matte."""
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": _RUSSIAN_ROULETTE_DEPTH},
    }
    groups: dict[_Group, list[Part]] = defaultdict(list)
    for part in parts:
        groups[_group_of(part.material, lighting, glossy)].append(part)
    for index, (group, members) in enumerate(groups.items()):
        emitter = None
        if group.emission != _DARK:
            emitter = {"type": "area", "radiance": _rgb(group.emission)}
        scene[f"shape{index}"] = mesh_shape(merge(p.mesh for p in members), _bsdf(group), emitter)
    if lighting.environment_rgb is not None:
        scene["environment"] = environment_emitter(lighting.environment_rgb)
    if lighting.sun is not None:
        scene["sun"] = sun_emitter(*lighting.sun)
    return mitsuba().load_dict(scene)


def render_cube(scene: Any, eye: Vector, sampling: Sampling) -> Floats:
    """Return radiance on the six faces (6, side, side, 3) around ``eye``."""
    mi = mitsuba()
    side = sampling.cube.side_px
    out = np.empty((6, side, side, 3), np.float32)
    for index, (ahead, _, above) in enumerate(FACES):
        sensor = mi.load_dict(_camera(eye, ahead, above, sampling))
        picture = mi.render(scene, sensor=sensor, spp=sampling.samples, seed=sampling.seed * 6 + index)
        out[index] = np.array(picture)[..., :3]
    return out


def _camera(eye: Vector, ahead: Vector, above: Vector, sampling: Sampling) -> dict[str, Any]:
    mi = mitsuba()
    target = [float(e + a) for e, a in zip(eye, ahead, strict=True)]
    cube = sampling.cube
    return {
        "type": "perspective",
        "fov": 2 * float(np.degrees(np.arctan(cube.half_width))),
        "near_clip": 1e-3,
        "to_world": mi.ScalarTransform4f().look_at(origin=list(eye), target=target, up=list(above)),
        "film": {
            "type": "hdrfilm",
            "width": cube.side_px,
            "height": cube.side_px,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "independent"},
    }


def _group_of(material: Material, lighting: Lighting, glossy: bool) -> _Group:
    emission = material.emission_cd_m2 if lighting.lamps else _DARK
    return _Group(material.colour, material.roughness if glossy else None, emission)


def _bsdf(group: _Group) -> dict[str, Any]:
    inner: dict[str, Any] = {"type": "diffuse", "reflectance": _rgb(group.colour)}
    if group.roughness is not None:
        inner = {"type": "principled", "base_color": _rgb(group.colour), "roughness": group.roughness, "specular": 0.5}
    return {"type": "twosided", "bsdf": inner}


def _rgb(value: Vector) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(v) for v in value]}
