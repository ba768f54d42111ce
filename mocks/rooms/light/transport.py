"""The renderer's scenes: a room's triangles in plain colours under one light, pictured on the six faces of a cube.

Mitsuba's stock path tracer does the light transport, so that the truth shares nothing with our own rendering. Light
bounces off textures by their mean albedo; the textures themselves are seen by `mocks.rooms.view`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mocks.rooms.light.cube import FACES, Cube
from mocks.rooms.light.engine import PATH, environment_emitter, mesh_shape, mitsuba, square_film, sun_emitter
from mocks.rooms.light.sunlight import SunPatch
from mocks.rooms.model import Part
from mocks.worlds.light import Vector
from processing.ground.arrays import Floats
from processing.ground.mesh import merge

_RUSSIAN_ROULETTE_DEPTH = 5
"""Paths of any length, ended by chance from here on: no light is lost, and half the work is saved."""
_DARK = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Lighting:
    """One component of light: what comes in from outside, and whether the lamps are lit.

    ``environment_rgb`` is an equirectangular map (H, 2 H, 3) in cd/m2 as seen through the glass; ``sun`` the
    direction to the sun and its illuminance (lx, RGB) on a plane facing it, behind the glass;
    ``patches``, instead of it, are what the sun lights: only the light that they give off is rendered.
    """

    environment_rgb: Floats | None = None
    sun: tuple[Vector, Vector] | None = None
    patches: tuple[SunPatch, ...] = ()
    lamps: bool = False


@dataclass(frozen=True)
class Sampling:
    """How much work goes into a picture."""

    cube: Cube
    samples: int
    seed: int = 0


def load_scene(parts: Sequence[Part], lighting: Lighting, *, glossy: bool) -> Any:
    """Return the renderer's scene; with ``glossy`` false every surface is matte.

    All matte triangles are one shape with the albedo at its corners, all glossy ones another: the renderer is several
    times as fast as with a shape for each part.
    """
    # The camera sees surfaces only: neither the outdoors nor lamps nor the sun's patches.
    path = {**PATH, "rr_depth": _RUSSIAN_ROULETTE_DEPTH, "hide_emitters": True}
    scene: dict[str, Any] = {"type": "scene", "integrator": path}
    groups: dict[str, list[Part]] = {"matte": [], "shiny": [], "lamp": []}
    for part in parts:
        lit = lighting.lamps and part.material.emission_cd_m2 != _DARK
        groups["lamp" if lit else "shiny" if glossy and part.material.roughness is not None else "matte"].append(part)
    for name in ("matte", "shiny"):
        if groups[name]:
            scene[name] = _shape(groups[name], shiny=name == "shiny")
    for index, part in enumerate(groups["lamp"]):
        emitter = {"type": "area", "radiance": _rgb(part.material.emission_cd_m2)}
        bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _rgb(part.material.colour)}}
        scene[f"lamp{index}"] = mesh_shape(part.mesh, bsdf, emitter)
    if lighting.environment_rgb is not None:
        scene["environment"] = environment_emitter(lighting.environment_rgb)
    if lighting.sun is not None:
        scene["sun"] = sun_emitter(*lighting.sun)
    whole = sum(patch.power for patch in lighting.patches)
    for index, patch in enumerate(lighting.patches):
        glow = {"type": "area", "radiance": _rgb(patch.radiance_rgb), "sampling_weight": patch.power / whole}
        scene[f"patch{index}"] = mesh_shape(patch.mesh, {"type": "diffuse", "reflectance": _rgb(patch.albedo)}, glow)
    return mitsuba().load_dict(scene)


def _shape(parts: Sequence[Part], *, shiny: bool) -> Any:
    """Return one shape of many parts, with their colours (and roughness) as attributes of the corners."""
    counts = [len(p.mesh.vertices) for p in parts]
    colours = np.repeat(np.array([p.material.colour for p in parts], np.float32), counts, axis=0)
    colour = {"type": "mesh_attribute", "name": "vertex_albedo"}
    inner: dict[str, Any] = {"type": "diffuse", "reflectance": colour}
    if shiny:
        roughness = {"type": "mesh_attribute", "name": "vertex_roughness"}
        inner = {"type": "principled", "base_color": colour, "roughness": roughness, "specular": 0.5}
    shape = mesh_shape(merge(p.mesh for p in parts), {"type": "twosided", "bsdf": inner})
    shape.add_attribute("vertex_albedo", 3, colours.ravel())
    if shiny:
        rough = np.repeat(np.array([p.material.roughness for p in parts], np.float32), counts)
        shape.add_attribute("vertex_roughness", 1, rough)
    return shape


def render_cube(scene: Any, eye: Vector, sampling: Sampling, faces: Sequence[int] = range(6)) -> Floats:
    """Return radiance (cd/m2 as RGB) on six faces, shape (6, S, S, 3), around ``eye``; zero on those not asked for."""
    mi = mitsuba()
    side = sampling.cube.side_px
    out = np.zeros((6, side, side, 3), np.float32)
    for index in faces:
        ahead, _, above = FACES[index]
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
        "film": square_film(cube.side_px),
        "sampler": {"type": "independent"},
    }


def _rgb(value: Vector) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(v) for v in value]}
