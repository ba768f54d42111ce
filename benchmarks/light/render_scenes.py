"""Rooms for the rendering benchmark, made of our own scene types, and the same rooms for Mitsuba and Radiance."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from processing.ground.arrays import Doubles
from processing.ground.mitsuba_variants import load_mitsuba, usable_variant
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.light.scene.outdoor import GROUND_ALBEDO, with_ground
from processing.light.scene.patches import surface_triangles
from processing.light.scene.scene import Material, Outdoors, Part, Scene, Sun, plain, shell_of
from processing.sphere import Equirectangular, Perspective, directions

EYE = (0.0, 0.0, 1.6)
COLOURS = {"floor": 0.3, "ceiling": 0.8}
WALLS = 0.6


def sky_outdoors(
    radiance: Callable[[Doubles], Doubles],
    *,
    rows: int = 256,
    ground_albedo: float = GROUND_ALBEDO,
    sun: Sun | None = None,
) -> Outdoors:
    """Return the light of a sky: a function of unit directions above the horizon to cd/m2, both of shape (..., 3)."""
    rays, _ = directions(Equirectangular(2 * rows, rows))
    above = np.broadcast_to(rays[..., 2:] > 0, rays.shape)
    sky = np.where(above, radiance(rays * np.where(above, 1, [1, 1, -1])), 0.0).astype(np.float32)
    return Outdoors(with_ground(sky, above[..., 0], sun, ground_albedo), sun)


def room_model(width_m: float, depth_m: float, height_m: float, window: tuple[float, ...] | None) -> RoomModel:
    x, y = width_m / 2, depth_m / 2
    openings = ()
    if window:
        start, end, sill, head = window
        openings = (Opening(kind=OpeningKind.WINDOW, wall=0, start_m=start, end_m=end, sill_m=sill, head_m=head),)
    return RoomModel(
        source="given",
        floor=((-x, -y), (x, -y), (x, y), (-x, y)),
        camera_height_m=1.6,
        ceiling_height_m=height_m,
        openings=openings,
    )


def clear_sky() -> Outdoors:
    """A sky brighter around its sun, 35 degrees high."""
    high = math.radians(35)
    sun = Sun((0.2 * math.cos(high), -math.sqrt(0.96) * math.cos(high), math.sin(high)), (75e3, 70e3, 62e3))
    around = np.array(sun.direction)
    return sky_outdoors(
        lambda rays: (3000 + 9000 * np.exp(4 * (rays @ around) - 4))[..., None] * np.array([0.8, 1.0, 1.3]),
        rows=128,
        sun=sun,
    )


def plain_room(outdoors: Outdoors, *, window: tuple[float, ...] | None = (1.5, 3.5, 0.8, 2.3)) -> Scene:
    """5 x 4 x 2.7 m, a window of 2 x 1.5 m to the sun."""
    surfaces, panes = shell_of(
        room_model(5, 4, 2.7, window), reveal_m=0.2, albedo=lambda name: plain(COLOURS.get(name, WALLS))
    )
    return Scene(surfaces, panes, outdoors)


def boxes() -> tuple[Part, ...]:
    """Three boxes for furniture."""
    return (
        _box((1.5, 1.0, 0.4), (1.0, 0.8, 0.8), (0.6, 0.3, 0.2)),
        _box((-1.5, 0.5, 0.5), (0.6, 1.2, 1.0), (0.3, 0.5, 0.2)),
        _box((0.0, 1.2, 0.2), (1.2, 0.6, 0.4), (0.7, 0.7, 0.7)),
    )


def _box(centre: tuple[float, ...], size: tuple[float, ...], colour: tuple[float, float, float]) -> Part:
    low, high = np.array(centre) - np.array(size) / 2, np.array(centre) + np.array(size) / 2
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], np.int32)
    return Part("box", corners, faces, Material("box", colour))


def triangles_of(scene: Scene) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
    """Return triangles (M, 3, 3) and the plain colour of each surface and part."""
    found = [
        (surface_triangles(s), tuple(float(v) for v in s.albedo.reshape(-1, 3).mean(axis=0))) for s in scene.surfaces
    ]
    found += [(p.vertices_m[p.faces], p.material.colour) for p in scene.parts]
    return found  # type: ignore[return-value]


def emissions_of(scene: Scene) -> list[tuple[float, ...]]:
    """Return the radiance (cd/m2) that each surface and part gives off by itself, in the order of `triangles_of`."""
    found = [tuple(float(v) for v in s.emission_cd_m2.reshape(-1, 3).mean(axis=0)) for s in scene.surfaces]
    return [*found, *(tuple(p.material.emission_cd_m2) for p in scene.parts)]


class PlainPath:
    """The scene in Mitsuba, with its stock path tracer and an environment map that holds the sun."""

    def __init__(self, scene: Scene) -> None:
        self.mi: Any = load_mitsuba(usable_variant())
        mi = self.mi
        self.variant = mi.variant()
        parts: dict[str, Any] = {"type": "scene", "integrator": {"type": "path", "max_depth": -1, "rr_depth": 12}}
        for number, ((triangles, colour), glow) in enumerate(
            zip(triangles_of(scene), emissions_of(scene), strict=True)
        ):
            parts[f"part{number}"] = self._mesh(triangles, colour, glow)
        rotate = mi.ScalarTransform4f([[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
        parts["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(_with_sun(scene.outdoors)), "to_world": rotate}
        self.scene = mi.load_dict(parts)

    def _mesh(self, triangles: np.ndarray, colour: tuple[float, ...], glow: tuple[float, ...]) -> Any:
        mi = self.mi
        props = mi.Properties()
        inner = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(colour)}}
        props["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": inner})
        if any(glow):
            props["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": list(glow)}})
        mesh = mi.Mesh("part", 3 * len(triangles), len(triangles), props=props)
        values = mi.traverse(mesh)
        values["vertex_positions"] = triangles.astype(np.float32).ravel()
        values["faces"] = np.arange(3 * len(triangles), dtype=np.uint32)
        values.update()
        return mesh

    def picture(self, view: Perspective, spp: int, seed: int) -> np.ndarray:
        """Return the view's picture (H, W, 3)."""
        mi = self.mi
        ahead = [math.sin(view.yaw_rad), math.cos(view.yaw_rad), 0.0]
        target = [EYE[k] + ahead[k] for k in range(3)]
        film = {
            "type": "hdrfilm",
            "width": view.width_px,
            "height": view.height_px,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        }
        camera = {
            "type": "perspective",
            "fov": math.degrees(view.fov_x_rad),
            "near_clip": 1e-3,
            "to_world": mi.ScalarTransform4f().look_at(origin=list(EYE), target=target, up=[0, 0, 1]),
            "film": film,
        }
        return np.array(mi.render(self.scene, sensor=mi.load_dict(camera), spp=spp, seed=seed))

    def pixels(self, eye_m: tuple[float, ...], rays: np.ndarray, spp: int, seed: int) -> np.ndarray:
        """Return what the stock integrator sees along ``rays`` (N, 3), unit, from a point: (N, 3) cd/m2.

        One radiance meter a ray, side by side on one film: that works in every variant.
        """
        pixel = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
        film = pixel | {"width": len(rays), "pixel_format": "rgb", "component_format": "float32"}
        meters = {
            f"meter{k:06d}": {"type": "radiancemeter", "origin": list(eye_m), "direction": ray, "film": pixel}
            for k, ray in enumerate(rays.astype(float).tolist())
        }
        sampler = {"type": "independent"}
        batch = self.mi.load_dict({"type": "batch", "film": film, "sampler": sampler, **meters})
        return np.array(self.mi.render(self.scene, sensor=batch, spp=spp, seed=seed), np.float64)[0]


def _with_sun(outdoors: Outdoors) -> np.ndarray:
    """Return the sky on Mitsuba's grid (its rows begin and end at the poles) with the sun in one texel, energy kept."""
    rows, columns = outdoors.rgb.shape[:2]
    out = np.concatenate([outdoors.rgb[:1], (outdoors.rgb[1:] + outdoors.rgb[:-1]) / 2, outdoors.rgb[-1:]]).copy()
    if outdoors.sun is not None:
        x, y, z = outdoors.sun.direction
        row = round((0.5 - math.asin(z) / math.pi) * rows)
        column = int((math.atan2(x, y) / (2 * math.pi) + 0.5) * columns)
        solid = math.cos(math.pi / 2 - row * math.pi / rows) * (math.pi / rows) * (2 * math.pi / columns)
        out[row, column] += np.array(outdoors.sun.normal_illuminance_lx, np.float32) / solid
    return out


def radiance_grid(scene: Scene, points: np.ndarray, level: float, ambient: tuple[str, ...]) -> np.ndarray:
    """Return Radiance's illuminance (lx) at points (N, 3) facing up, the sky and ground a uniform ``level`` cd/m2."""
    import tempfile
    from pathlib import Path

    pr: Any = importlib.import_module("pyradiance")
    text = [f"void glow even 0 0 4 {level / 179} {level / 179} {level / 179} 0", "even source all 0 0 4 0 0 1 360"]
    for number, (triangles, colour) in enumerate(triangles_of(scene)):
        text.append(f"void plastic m{number} 0 0 5 {colour[0]} {colour[1]} {colour[2]} 0 0")
        for k, corners in enumerate(triangles):
            places = " ".join(f"{v:.6f}" for v in corners.ravel())
            text.append(f"m{number} polygon p{number}_{k} 0 0 9 {places}")
    rays = "\n".join(" ".join(f"{v:.6f}" for v in (*p, 0, 0, 1)) for p in points).encode()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "room.rad")
        path.write_text("\n".join(text))
        octree = Path(folder, "room.oct")
        octree.write_bytes(pr.oconv(str(path)))
        found = pr.rtrace(
            rays, str(octree), inform="a", outform="a", header=False, irradiance=True, params=list(ambient)
        )
    values = np.array([[float(v) for v in line.split()[:3]] for line in found.decode().splitlines() if line.strip()])
    return 179 * values.mean(axis=1)
