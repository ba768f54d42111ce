"""A scene as one GLB file: the room's surfaces with their albedo, panes as thin glass, furniture; y up, metres.

Surfaces of the room are single-sided and face inwards, so that from outside one looks into the room. A texture of
albedo is meant to be lit by the viewer; with ``lit`` a surface instead shows a picture as it is
(KHR_materials_unlit): the photograph's own daylight. What lights the room is told in the asset's extras.
"""

from __future__ import annotations

from processing.ground.arrays import Bytes, Doubles, Floats

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.exchange.glb import Glb, Json
from processing.layout.furniture.model import srgb_of_linear
from processing.picture_writing import write_bytes
from processing.rendering.scene import Pane, Part, Scene, Surface
from processing.rendering.sight import LEAST_AGREEMENT
from processing.rendering.triangles import pane_triangles, surface_triangles

GLASS_ALPHA = 0.15
"""Of a pane: what it adds of its own tint; the rest is what lies behind."""
_UNLIT, _STRONG = "KHR_materials_unlit", "KHR_materials_emissive_strength"


def scene_glb(scene: Scene, *, max_texture_px: int = 1024, lit: Mapping[str, Bytes] | None = None) -> bytes:
    """Return a scene as GLB.

    Parameters
    ----------
    max_texture_px
        Longest side of a texture; larger ones are averaged down.
    lit
        By surface name, an sRGB picture (h, w, 3) laid out as its albedo: shown instead of it, unlit.

    Raises
    ------
    ParameterError
        A texture size below 1, or a picture of a surface that is not there.
    """
    if max_texture_px < 1:
        raise ParameterError(f"textures of {max_texture_px} px", advice="give at least 1")
    shown = dict(lit or {})
    unknown = set(shown) - {surface.name for surface in scene.surfaces}
    if unknown:
        raise ParameterError(f"pictures of {sorted(unknown)}: the scene has no such surfaces")
    glb = Glb("daylit", _light(scene))
    for surface in scene.surfaces:
        _add_surface(glb, surface, shown.get(surface.name), max_texture_px)
    for part in scene.parts:
        _add_part(glb, part, max_texture_px)
    # Last, so that viewers which blend in the file's order have all that lies behind.
    for pane in scene.panes:
        _add_pane(glb, pane)
    return glb.data()


def write_scene_glb(
    path: Path, scene: Scene, *, max_texture_px: int = 1024, lit: Mapping[str, Bytes] | None = None
) -> None:
    """Write `scene_glb` durably."""
    write_bytes(path, scene_glb(scene, max_texture_px=max_texture_px, lit=lit))


def _light(scene: Scene) -> Json:
    sun = scene.outdoors.sun
    if sun is None:
        return {"units": "metres; emission in cd/m2", "sun": None}
    x, y, z = sun.direction
    towards = [float(v) + 0.0 for v in (x, z, -y)]
    lux = [float(v) for v in sun.normal_illuminance_lx]
    return {"units": "metres; emission in cd/m2", "sun": {"towards": towards, "normal_illuminance_lx_rgb": lux}}


def _add_surface(glb: Glb, surface: Surface, picture: Bytes | None, most_px: int) -> None:
    triangles = surface_triangles(surface)
    if not len(triangles):  # a wall that is all window
        return
    if picture is None:
        look = _albedo(glb, surface.albedo, most_px, repeat=False) | {"roughnessFactor": 1.0, "metallicFactor": 0.0}
        material: Json = {"name": surface.name, "pbrMetallicRoughness": look}
        material |= _emission(glb, surface.emission_cd_m2, most_px)
    else:
        texture = glb.add_picture(_smaller(picture, most_px).astype(np.uint8), repeat=False)
        look = {"baseColorTexture": {"index": texture}, "roughnessFactor": 1.0, "metallicFactor": 0.0}
        material = {"name": surface.name, "pbrMetallicRoughness": look, "extensions": {_UNLIT: {}}}
    corners = triangles.reshape(-1, 3)
    offset = corners - surface.origin_m
    uv = np.column_stack([offset @ surface.u_axis / surface.width_m, offset @ surface.v_axis / surface.height_m])
    normals = np.broadcast_to(surface.normal, corners.shape)
    faces = np.arange(len(corners)).reshape(-1, 3)
    glb.add_mesh(surface.name, corners, normals, uv, faces, glb.add_material(material))


def _add_part(glb: Glb, part: Part, most_px: int) -> None:
    m = part.material
    look: Json = {"roughnessFactor": m.roughness, "metallicFactor": m.metallic}
    colour = [float(c) for c in m.colour]
    if m.texture is not None and part.uv is not None:
        look |= _albedo(glb, m.texture, most_px, repeat=True)
        # The factor multiplies the texture, which `_albedo` may have to leave as it is.
        factor = look.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        look["baseColorFactor"] = [*(a * b for a, b in zip(factor[:3], colour, strict=True)), 1.0]
    else:
        look["baseColorFactor"] = [*colour, 1.0]
    material: Json = {"name": m.name, "pbrMetallicRoughness": look, "doubleSided": True}
    material |= _emission(glb, np.asarray(m.emission_cd_m2, np.float32).reshape(1, 1, 3), most_px)
    corners, normals = _corners(part)
    uv = None
    if part.uv is not None:
        uv = part.uv[part.faces.ravel()].astype(np.float64)
        uv[:, 1] = 1 - uv[:, 1]  # ours counts from the lower left corner, glTF's from the upper left
    faces = np.arange(len(corners)).reshape(-1, 3)
    glb.add_mesh(part.name, corners, normals, uv, faces, glb.add_material(material))


def _corners(part: Part) -> tuple[Doubles, Doubles]:
    """Return corners (3 m, 3) and their normals: the part's own where it is round, else each triangle's."""
    triangles = part.vertices_m[part.faces]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = np.where(length > 0, normal / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])
    flat = np.repeat(unit, 3, axis=0)
    if part.normals is None:
        return triangles.reshape(-1, 3), flat
    own = part.normals[part.faces.ravel()].astype(np.float64)
    own /= np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-12)
    agree = np.einsum("ij,ij->i", own, flat)
    # A mesh may be wrong about its normals; as in our own pictures, its faces then tell.
    turned = own * np.where(agree < 0, -1.0, 1.0)[:, None]
    return triangles.reshape(-1, 3), np.where((np.abs(agree) > LEAST_AGREEMENT)[:, None], turned, flat)


def _add_pane(glb: Glb, pane: Pane) -> None:
    tint = [float(v) for v in pane.transmittance]
    material = glb.add_material(
        {
            "name": f"pane-{pane.opening}",
            "pbrMetallicRoughness": {
                "baseColorFactor": [*tint, GLASS_ALPHA],
                "roughnessFactor": 0.0,
                "metallicFactor": 0.0,
            },
            "alphaMode": "BLEND",
            "doubleSided": True,
        }
    )
    corners = pane_triangles(pane).reshape(-1, 3)
    normal = np.cross(pane.across_m, pane.up_m)
    normal = np.broadcast_to(normal / np.linalg.norm(normal), corners.shape)
    glb.add_mesh(f"pane-{pane.opening}", corners, normal, None, np.arange(6).reshape(2, 3), material)


def _albedo(glb: Glb, texture: Floats, most_px: int, *, repeat: bool) -> Json:
    """Return the base colour: a factor for one colour, a texture for more."""
    if texture.shape[:2] == (1, 1):
        return {"baseColorFactor": [*(float(v) for v in texture[0, 0]), 1.0]}
    return {"baseColorTexture": {"index": glb.add_picture(srgb_of_linear(_smaller(texture, most_px)), repeat=repeat)}}


def _emission(glb: Glb, light: Floats, most_px: int) -> Json:
    """Return what shines: factors up to 1 and, in cd/m2, how strong."""
    strength = float(light.max())
    if strength <= 0:
        return {}
    share = light / np.float32(strength)
    strong = {"extensions": {_STRONG: {"emissiveStrength": strength}}}
    if light.shape[:2] == (1, 1):
        return {"emissiveFactor": [float(v) for v in share[0, 0]], **strong}
    texture = glb.add_picture(srgb_of_linear(_smaller(share, most_px)), repeat=False)
    return {"emissiveFactor": [1.0, 1.0, 1.0], "emissiveTexture": {"index": texture}, **strong}


def _smaller(texture: npt.NDArray[np.generic], most_px: int) -> npt.NDArray[np.generic]:
    """Return a texture averaged down to at most this many pixels a side."""
    import cv2

    high, wide = texture.shape[:2]
    longest = max(high, wide)
    if longest <= most_px:
        return texture
    size = (max(1, round(wide * most_px / longest)), max(1, round(high * most_px / longest)))
    return np.asarray(cv2.resize(np.ascontiguousarray(texture), size, interpolation=cv2.INTER_AREA))
