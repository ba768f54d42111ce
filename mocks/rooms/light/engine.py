"""Mitsuba, loaded when first needed, in the fastest variant that is safe on this computer.

``llvm_ad_rgb`` where an LLVM library is proven to work (`processing.ground.mitsuba_variants`), else ``scalar_rgb``,
which works everywhere; ``DAYLIT_MITSUBA_VARIANT`` chooses either. The two give the same pictures but for their noise.
Both use as many threads as this process may use cores.

Below that, the parts that every simulated scene is built of, in world axes and photometric units, and the meter that
the analytic tests read: what they prove holds for the rooms because both are made of these parts.
"""

import math
import os
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DaylitError
from mocks.worlds.light import SUN_RADIUS_RAD, Vector, unit, vector_of
from processing.ground.arrays import Doubles, Floats
from processing.ground.mesh import Mesh, quad
from processing.ground.mitsuba_variants import LLVM, SCALAR, load_mitsuba, usable_library, version_in_name

PATH: dict[str, Any] = {"type": "path", "max_depth": -1, "rr_depth": 12}
"""The integrator: paths of any length, ended by chance (which leaves the mean as it is) from the 12th bounce on."""

_SUN_DISTANCE_M = 1e5  # far enough that the sun stands at the same place (to 0.1 mrad) for all of a room
_METER_PIXELS, _METER_SIDE_M = 4, 1e-3

ASKED = "DAYLIT_MITSUBA_VARIANT"
LIBRARIES = ("mitsuba", "embreex", "pyoidn", "pvlib", "shapely")
"""What generated rooms need; packages of embreex and pyoidn do not exist for every system."""


class EngineError(DaylitError, code="SIM-003", exit_code=2):
    """The renderer asked for cannot be had."""


@dataclass(frozen=True)
class Engine:
    """The renderer in use."""

    variant: str
    """``llvm_ad_rgb`` or ``scalar_rgb``."""
    llvm: Path | None
    """The LLVM library of the former."""

    def __str__(self) -> str:
        """Return the renderer in words, and what would make it faster."""
        name = f"Mitsuba {version('mitsuba')} {self.variant}"
        if self.llvm:
            return f"{name} (LLVM {version_in_name(self.llvm.resolve()) or 'of unknown version'} at {self.llvm})"
        if os.environ.get(ASKED) == SCALAR:
            return f"{name} (as {ASKED} says)"
        return f"{name} (install LLVM 16 or newer, e.g. `apt install libllvm19`, for about twice the speed)"


@cache
def engine() -> Engine:
    """Return the renderer for this process, chosen once."""
    asked = os.environ.get(ASKED)
    if asked not in (None, "", SCALAR, LLVM):
        advice = f"use {SCALAR} or {LLVM}, or leave it unset"
        raise EngineError(f"no renderer is called {asked!r}", where=ASKED, likely="a misspelt name", advice=advice)
    library = None if asked == SCALAR else usable_library()
    if asked == LLVM and library is None:
        likely = "LLVM 16 or newer is not installed, or not where it is looked for"
        advice = f"install libllvm19, or name the library in DRJIT_LIBLLVM_PATH, or use {SCALAR}"
        raise EngineError("no LLVM library works here", where=ASKED, likely=likely, advice=advice)
    return Engine(LLVM, library) if library else Engine(SCALAR, None)


def missing_libraries() -> list[str]:
    """Return what generated rooms need and is not installed."""
    return [name for name in LIBRARIES if find_spec(name) is None]


@cache
def mitsuba() -> Any:
    """Return the module ``mitsuba`` with the variant set."""
    return load_mitsuba(engine().variant)


def environment_emitter(map_rgb: Floats) -> dict[str, Any]:
    """Return sky and land as a Mitsuba emitter.

    ``map_rgb``: radiance, shape (H, 2 H, 3): an equirectangular picture with +y at its centre, +x to the right of it, z
      up, and pixel centres at half integers.

    Mitsuba interpolates between texels whose rows begin and end exactly at the poles. Every pixel's light is shared
    among the two rows beside it in the proportion in which their interpolation covers it, so that the light of the
    whole sphere is kept exactly, for any picture, and a uniform one stays uniform.
    """
    mi = mitsuba()
    rows = np.einsum("ji,ick->jck", _shares(map_rgb.shape[0]), map_rgb.astype(np.float64)).astype(np.float32)
    to_world = mi.ScalarTransform4f([[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(rows)), "to_world": to_world}


def _shares(height: int) -> Doubles:
    """Return (height + 1, height): what share each pixel row has in the mean light of each texel row."""
    # Simpson's rule on 64 parts of each pixel: exact to rounding at any height in use.
    parts = 64
    fall = np.linspace(1, 0, parts + 1)
    theta = math.pi / height * (np.arange(height)[:, None] + 1 - fall)
    weight = np.sin(theta) * np.array([1, *([4, 2] * (parts // 2))[:-1], 1])
    own = np.arange(height)
    shares = np.zeros((height + 1, height))
    shares[own, own] = (weight * fall).sum(axis=1)
    shares[own + 1, own] = (weight * (1 - fall)).sum(axis=1)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def sun_emitter(way: Vector, normal_illuminance_rgb: Vector, radius_rad: float = SUN_RADIUS_RAD) -> dict[str, Any]:
    """Return the sun as a far disc of its true size that gives this illuminance (lx, as RGB) on a plane facing it."""
    mi = mitsuba()
    towards = unit(way)
    side = (0.0, 0.0, 1.0) if abs(towards[2]) < 0.9 else (1.0, 0.0, 0.0)
    place = [_SUN_DISTANCE_M * v for v in towards]
    transform = mi.ScalarTransform4f
    to_world = transform().look_at(origin=place, target=[0, 0, 0], up=list(side))
    radiance = [v / (math.pi * math.sin(radius_rad) ** 2) for v in normal_illuminance_rgb]
    return {
        "type": "disk",
        "to_world": to_world @ transform().scale(_SUN_DISTANCE_M * math.tan(radius_rad)),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        "light": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
    }


def mesh_shape(mesh: Mesh, bsdf: Any, emitter: dict[str, Any] | None = None, sensor: Any = None) -> Any:
    """Return a mesh as a Mitsuba shape; ``bsdf``, ``emitter`` and ``sensor`` are Mitsuba's objects or dictionaries."""
    mi = mitsuba()
    props = mi.Properties()
    for name, part in (("bsdf", bsdf), ("emitter", emitter), ("sensor", sensor)):
        if part is not None:
            props[name] = mi.load_dict(part) if isinstance(part, dict) else part
    shape = mi.Mesh(
        "mesh", len(mesh.vertices), len(mesh.faces), props=props, has_vertex_normals=True, has_vertex_texcoords=True
    )
    params = mi.traverse(shape)
    params["vertex_positions"] = mesh.vertices.astype(np.float32).ravel()
    params["vertex_normals"] = mesh.normals.astype(np.float32).ravel()
    params["vertex_texcoords"] = mesh.uv.astype(np.float32).ravel()
    params["faces"] = mesh.faces.astype(np.uint32).ravel()
    params.update()
    return shape


def square_film(side_px: int) -> dict[str, Any]:
    """Return what a sensor's light falls on: each pixel has its own samples only, as RGB of 32-bit floats."""
    pixels = {"width": side_px, "height": side_px, "pixel_format": "rgb", "component_format": "float32"}
    return {"type": "hdrfilm", **pixels, "rfilter": {"type": "box"}}


def irradiance_over(scene: Any, mesh: Mesh, spp: int, seed: int = 0) -> Doubles:
    """Return the mean illuminance (lx, as RGB, shape (3,)) over a mesh that need not be in the scene.

    The mesh is not put into the scene, so that the meter neither shades nor reflects. About ``spp`` rays start from it.
    """
    mi = mitsuba()
    sampler = {"type": "multijitter"}
    meter = mi.load_dict({"type": "irradiancemeter", "sampler": sampler, "film": square_film(_METER_PIXELS)})
    shape = mesh_shape(mesh, {"type": "diffuse"}, sensor=meter)
    # The sampler spreads square numbers of rays best.
    each = max(1, round(math.sqrt(spp) / _METER_PIXELS)) ** 2
    picture = mi.render(scene, sensor=shape.sensor(), integrator=mi.load_dict(PATH), spp=each, seed=seed)
    mean: Doubles = np.array(picture, dtype=np.float64).reshape(-1, 3).mean(axis=0)
    return mean


def irradiance_at(scene: Any, point: Vector, normal: Vector, spp: int, seed: int = 0) -> Doubles:
    """Return the illuminance (lx, as RGB, shape (3,)) at a point on a plane with this normal."""
    axis = np.array(unit(normal))
    u = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    u *= _METER_SIDE_M / np.linalg.norm(u)
    v = np.cross(axis, u)
    corner = np.array(point) - (u + v) / 2
    return irradiance_over(scene, quad(vector_of(corner), vector_of(u), vector_of(v)), spp, seed)
