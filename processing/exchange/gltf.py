"""A scene as one GLB file: the room's surfaces with their albedo, panes as thin glass, furniture; y up, metres.

Surfaces of the room are single-sided and face inwards, so that from outside one looks into the room. A texture of
albedo is meant to be lit by the viewer; with ``lit`` a surface instead shows a picture as it is
(KHR_materials_unlit): the photograph's own daylight. What lights the room is recorded in the asset's extras.
"""

import hashlib
import io
import json
import math
import struct
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Bytes, Doubles, Floats, Indices, Vector
from processing.ground.colour import srgb_of_linear
from processing.ground.mesh import y_up
from processing.ground.room_model import RoomModel
from processing.light.scene.patches import pane_triangles, surface_triangles
from processing.light.scene.scene import Pane, Part, Scene, Sun, Surface
from processing.light.solver.sight import LEAST_AGREEMENT
from processing.pictures.images import LuminanceImage
from processing.pictures.writing import write_bytes
from processing.sphere import Equirectangular
from processing.surfaces.maps import planes_of
from processing.surfaces.textures import unwrap

# A binary glTF 2.0 file put together: buffers, pictures, materials, meshes; and nothing that knows of rooms.
#
# Positions and normals are given in our frame (z up) and written in glTF's (y up): (x, y, z) becomes (x, z, -y).

Json: TypeAlias = dict[str, Any]

_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_ARRAY, _INDEX = 34962, 34963
_CLAMP, _LINEAR, _MIPMAP = 33071, 9729, 9987
_PNG_BELOW_PX = 33  # small pictures are kept without loss


class Glb:
    """A glTF file in the making; `data` gives its bytes."""

    def __init__(self, generator: str, extras: Mapping[str, object]) -> None:
        self._binary = bytearray()
        self._json: Json = {
            "asset": {"version": "2.0", "generator": generator, "extras": dict(extras)},
            "scene": 0,
            "scenes": [{"nodes": []}],
        }
        self._known: dict[tuple[bytes, bool], int] = {}
        self._groups: dict[str, int] = {}

    def add_picture(self, rgb8: Bytes, *, repeat: bool) -> int:
        """Add a texture of an sRGB picture (H, W, 3), once; its first row is the top, v = 0 in glTF."""
        from PIL import Image

        key = hashlib.sha256(str(rgb8.shape).encode() + np.ascontiguousarray(rgb8).tobytes()).digest(), repeat
        if key in self._known:
            return self._known[key]
        out = io.BytesIO()
        lossless = max(rgb8.shape[:2]) < _PNG_BELOW_PX
        image = Image.fromarray(np.ascontiguousarray(rgb8))
        if lossless:
            image.save(out, "PNG")
        else:
            image.save(out, "JPEG", quality=92, subsampling=0)
        view = self._view(out.getvalue())
        source = self._append("images", {"bufferView": view, "mimeType": "image/png" if lossless else "image/jpeg"})
        sampler: Json = {"magFilter": _LINEAR, "minFilter": _MIPMAP}
        if not repeat:
            sampler |= {"wrapS": _CLAMP, "wrapT": _CLAMP}
        self._known[key] = self._append("textures", {"source": source, "sampler": self._once("samplers", sampler)})
        return self._known[key]

    def add_material(self, material: Json) -> int:
        """Add a material as glTF has it, with the extensions that it uses declared."""
        used = set(self._json.get("extensionsUsed", ())) | set(material.get("extensions", ()))
        if used:
            self._json["extensionsUsed"] = sorted(used)
        return self._once("materials", material)

    def add_mesh(
        self,
        name: str,
        corners_m: npt.NDArray[np.floating],
        normals: npt.NDArray[np.floating],
        uv: npt.NDArray[np.floating] | None,
        faces: npt.NDArray[np.integer],
        material: int,
        group: str | None = "room",
    ) -> None:
        """Add a node with a mesh: corners and normals (N, 3) in our frame, uv (N, 2), faces (M, 3).

        Corners that are alike in all become one. The node lies below that of its group, if it has one.
        """
        columns = [y_up(corners_m), y_up(normals), *([] if uv is None else [np.asarray(uv, np.float32)])]
        places, same = _welded(np.concatenate(columns, axis=1))
        attributes = {
            "POSITION": self._accessor(places[:, :3], "VEC3", bounds=True),
            "NORMAL": self._accessor(places[:, 3:6], "VEC3"),
        }
        if uv is not None:
            attributes["TEXCOORD_0"] = self._accessor(places[:, 6:], "VEC2")
        small = np.uint16 if len(places) < 65_536 else np.uint32
        indices = self._accessor(same[np.asarray(faces).ravel()].astype(small), "SCALAR", index=True)
        part = {"attributes": attributes, "indices": indices, "material": material}
        self._put({"name": name, "mesh": self._append("meshes", {"name": name, "primitives": [part]})}, group)

    def add_camera(self, eye_m: Vector) -> None:
        """Add a camera at a place (m, our frame) that looks ahead (+y), as wide as a still."""
        lens = {"type": "perspective", "perspective": {"yfov": STILL_FIELD_RAD, "znear": 0.05, "aspectRatio": 1.5}}
        node = {"name": "camera", "camera": self._append("cameras", {"name": "camera", **lens})}
        self._put(node | {"translation": y_up(np.array([eye_m]))[0].tolist()})

    def add_sun(self, sun: Sun) -> None:
        """Add the sun as KHR_lights_punctual has it: a direction, and illuminance in lux."""
        normal_lx = sun.normal_illuminance_lx
        x, y, z = (float(v) for v in y_up(np.array([sun.direction]))[0])
        # A light shines along its node's -z: the shortest turn takes +z to where the sun is.
        turn = np.array([-y, x, 0.0, 1 + z]) if z > -1 + 1e-9 else np.array([1.0, 0.0, 0.0, 0.0])
        most = float(np.max(normal_lx))  # colours end at 1; a viewer multiplies the two
        light = {"name": "sun", "type": "directional", "color": [float(v) / most for v in normal_lx], "intensity": most}
        self._json.setdefault("extensions", {})[_LIGHTS] = {"lights": [light]}
        self._json["extensionsUsed"] = sorted({*self._json.get("extensionsUsed", ()), _LIGHTS})
        turn /= np.linalg.norm(turn)
        self._put({"name": "sun", "rotation": turn.tolist(), "extensions": {_LIGHTS: {"light": 0}}})

    def _put(self, node: Json, group: str | None = None) -> None:
        """Add a node to the scene, or below the node of a group."""
        number = self._append("nodes", node)
        siblings: list[int] = self._json["scenes"][0]["nodes"]
        if group is not None:
            if group not in self._groups:
                self._groups[group] = self._append("nodes", {"name": group, "children": []})
                siblings.append(self._groups[group])
            siblings = self._json["nodes"][self._groups[group]]["children"]
        siblings.append(number)

    def data(self) -> bytes:
        """Return the file."""
        binary = bytes(self._binary) + b"\0" * (-len(self._binary) % 4)
        text = json.dumps({**self._json, "buffers": [{"byteLength": len(binary)}]}, allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(binary))
        text_head, binary_head = struct.pack("<I4s", len(text), b"JSON"), struct.pack("<I4s", len(binary), b"BIN\0")
        return head + text_head + text + binary_head + binary

    def _append(self, table: str, entry: Json) -> int:
        rows: list[Json] = self._json.setdefault(table, [])
        rows.append(entry)
        return len(rows) - 1

    def _once(self, table: str, entry: Json) -> int:
        rows: list[Json] = self._json.setdefault(table, [])
        return rows.index(entry) if entry in rows else self._append(table, entry)

    def _view(self, data: bytes, target: int | None = None) -> int:
        self._binary += b"\0" * (-len(self._binary) % 4)
        view: Json = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        self._binary += data
        return self._append("bufferViews", view if target is None else view | {"target": target})

    def _accessor(self, array: npt.NDArray[np.generic], kind: str, *, bounds: bool = False, index: bool = False) -> int:
        view = self._view(np.ascontiguousarray(array).tobytes(), _INDEX if index else _ARRAY)
        component = {2: _USHORT, 4: _UINT}[array.itemsize] if index else _FLOAT
        entry: Json = {"bufferView": view, "componentType": component, "count": len(array), "type": kind}
        if bounds:
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        return self._append("accessors", entry)


def _welded(corners: Floats) -> tuple[Floats, Indices]:
    """Return the different rows of (n, k) in the order in which they come, and which of them each row is."""
    rows = np.ascontiguousarray(corners).view(np.dtype((np.void, corners.dtype.itemsize * corners.shape[1]))).ravel()
    _, first, same = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return corners[first[order]], place[same.ravel()]


MODEL_PX_PER_M, MOST_DETAIL = 220.0, 1.5
"""Of the models' walls, floor and ceiling; most that detail is over its surroundings: beyond it light ends (chosen)."""
GLASS_ALPHA = 0.15  # of a pane: what it adds of its own tint; the rest is what lies behind
MOST_PX = 2048  # of a texture's longer side; chosen
_STRONG = "KHR_materials_emissive_strength"
_LIGHTS = "KHR_lights_punctual"
STILL_FIELD_RAD = 2 * math.atan(12 / 18)
"""Height of a frame of 24 mm before a lens of 18 mm (chosen: within the 16 to 24 mm of interior photographs)."""


def scene_glb(scene: Scene, *, eye_m: Vector | None = None) -> bytes:
    """Return a scene as GLB: the room and each piece of furniture a node with its parts, the sun, and a camera.

    ``eye_m``: where the panorama's camera stood, our frame; None: no camera is written.
    """
    glb = Glb("daylit", _light(scene))
    for surface in scene.surfaces:
        _add_surface(glb, surface)
    for part in scene.parts:
        _add_part(glb, part)
    # Last, so that viewers which blend in the file's order have all that lies behind.
    for pane in scene.panes:
        _add_pane(glb, pane)
    if eye_m is not None:
        glb.add_camera(eye_m)
    sun = scene.outdoors.sun
    if sun is not None and max(sun.normal_illuminance_lx) > 0:
        glb.add_sun(sun)
    return glb.data()


def finely(scene: Scene, image: LuminanceImage, room: RoomModel) -> Scene:
    """Return the scene with albedo of its planes as fine as the panorama shows them, up to `MODEL_PX_PER_M`.

    What the light (H, W, 3) of the emptied panorama has of detail within a coarse texel is taken for albedo's.
    """
    import cv2

    assert isinstance(image.geometry, Equirectangular)
    planes = {plane.index: plane for plane in planes_of(room)}
    surfaces = []
    for one in scene.surfaces:
        away = abs(float((np.array([0.0, 0.0, room.camera_height_m]) - one.origin_m) @ one.normal))
        px_per_m = min(MODEL_PX_PER_M, image.rgb.shape[0] / math.pi / max(away, 0.3))
        high, wide = one.albedo.shape[:2]
        if one.plane in planes and px_per_m * one.width_m > 1.5 * wide:
            seen = unwrap(image.rgb, image.geometry, room, planes[one.plane], px_per_m)
            size = seen.values.shape[1::-1]
            coarse = cv2.resize(cv2.resize(seen.values, (wide, high), interpolation=cv2.INTER_AREA), size)
            detail = np.clip((seen.values + 1e-6) / (coarse + 1e-6), 1 / MOST_DETAIL, MOST_DETAIL)
            fine = cv2.resize(one.albedo, size) * np.where(seen.known[..., None], detail, 1)
            surfaces.append(replace(one, albedo=np.clip(fine, 0, 1).astype(np.float32)))
        else:
            surfaces.append(one)
    return replace(scene, surfaces=tuple(surfaces))


def write_scene_glb(path: Path, scene: Scene, eye_m: Vector | None = None) -> None:
    """Write `scene_glb` durably."""
    write_bytes(path, scene_glb(scene, eye_m=eye_m))


def _light(scene: Scene) -> Json:
    sun = scene.outdoors.sun
    if sun is None:
        return {"units": "metres; emission in cd/m2", "sun": None}
    x, y, z = sun.direction
    towards = [float(v) + 0.0 for v in (x, z, -y)]
    lux = [float(v) for v in sun.normal_illuminance_lx]
    return {"units": "metres; emission in cd/m2", "sun": {"towards": towards, "normal_illuminance_lx_rgb": lux}}


def _add_surface(glb: Glb, surface: Surface) -> None:
    triangles = surface_triangles(surface)
    if not len(triangles):  # a wall that is all window
        return
    look = _albedo(glb, surface.albedo, repeat=False) | {"roughnessFactor": 1.0, "metallicFactor": 0.0}
    material = {"name": surface.name, "pbrMetallicRoughness": look} | _emission(glb, surface.emission_cd_m2)
    corners = triangles.reshape(-1, 3)
    offset = corners - surface.origin_m
    uv = np.column_stack([offset @ surface.u_axis / surface.width_m, offset @ surface.v_axis / surface.height_m])
    normals = np.broadcast_to(surface.normal, corners.shape)
    glb.add_mesh(surface.name, corners, normals, uv, np.arange(len(corners)).reshape(-1, 3), glb.add_material(material))


def _add_part(glb: Glb, part: Part) -> None:
    m = part.material
    look: Json = {"roughnessFactor": m.roughness, "metallicFactor": m.metallic}
    colour = [float(c) for c in m.colour]
    if m.texture is not None and part.uv is not None:
        look |= _albedo(glb, m.texture, repeat=True)
        # The factor multiplies the texture, which `_albedo` may have to leave as it is.
        factor = look.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        look["baseColorFactor"] = [*(a * b for a, b in zip(factor[:3], colour, strict=True)), 1.0]
    else:
        look["baseColorFactor"] = [*colour, 1.0]
    material: Json = {"name": m.name, "pbrMetallicRoughness": look, "doubleSided": True}
    material |= _emission(glb, np.asarray(m.emission_cd_m2, np.float32).reshape(1, 1, 3))
    corners, normals = _corners(part)
    uv = None
    if part.uv is not None:
        uv = part.uv[part.faces.ravel()].astype(np.float64)
        uv[:, 1] = 1 - uv[:, 1]  # ours counts from the lower left corner, glTF's from the upper left
    faces = np.arange(len(corners)).reshape(-1, 3)
    # A part is named by its piece and its material; one of a single material by its piece alone.
    piece, several, _ = part.name.partition(": ")
    glb.add_mesh(part.name, corners, normals, uv, faces, glb.add_material(material), piece if several else None)


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
    # A mesh may be wrong about its normals; as in our own pictures, its faces then decide.
    turned = own * np.where(agree < 0, -1.0, 1.0)[:, None]
    return triangles.reshape(-1, 3), np.where((np.abs(agree) > LEAST_AGREEMENT)[:, None], turned, flat)


def _add_pane(glb: Glb, pane: Pane) -> None:
    tint = [*map(float, pane.transmittance), GLASS_ALPHA]
    look = {"baseColorFactor": tint, "roughnessFactor": 0.0, "metallicFactor": 0.0}
    material = glb.add_material(
        {"name": f"pane-{pane.opening}", "pbrMetallicRoughness": look, "alphaMode": "BLEND", "doubleSided": True}
    )
    corners = pane_triangles(pane).reshape(-1, 3)
    normal = np.cross(pane.across_m, pane.up_m)
    normal = np.broadcast_to(normal / np.linalg.norm(normal), corners.shape)
    glb.add_mesh(f"pane-{pane.opening}", corners, normal, None, np.arange(6).reshape(2, 3), material)


def _albedo(glb: Glb, texture: Floats, *, repeat: bool) -> Json:
    """Return the base colour: a factor for one colour, a texture for more."""
    if texture.shape[:2] == (1, 1):
        return {"baseColorFactor": [*(float(v) for v in texture[0, 0]), 1.0]}
    return {"baseColorTexture": {"index": glb.add_picture(srgb_of_linear(_smaller(texture)), repeat=repeat)}}


def _emission(glb: Glb, light: Floats) -> Json:
    """Return what shines: factors up to 1 and, in cd/m2, how strong."""
    strength = float(light.max())
    if strength <= 0:
        return {}
    share = light / np.float32(strength)
    strong = {"extensions": {_STRONG: {"emissiveStrength": strength}}}
    if light.shape[:2] == (1, 1):
        return {"emissiveFactor": [float(v) for v in share[0, 0]], **strong}
    texture = glb.add_picture(srgb_of_linear(_smaller(share)), repeat=False)
    return {"emissiveFactor": [1.0, 1.0, 1.0], "emissiveTexture": {"index": texture}, **strong}


def _smaller(texture: Floats) -> Floats:
    """Return a texture averaged down to at most `MOST_PX` a side."""
    import cv2

    high, wide = texture.shape[:2]
    longest = max(high, wide)
    if longest <= MOST_PX:
        return texture
    size = (max(1, round(wide * MOST_PX / longest)), max(1, round(high * MOST_PX / longest)))
    return np.asarray(cv2.resize(np.ascontiguousarray(texture), size, interpolation=cv2.INTER_AREA))
