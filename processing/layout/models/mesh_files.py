"""Furniture files into triangles: OBJ, glTF and GLB through trimesh, with limits, and never outside their folder.

What a file says of other files is read by `FolderFiles` alone: names that lead out of the catalogue's folder are not
followed. Sizes, counts and references are checked before trimesh allocates anything.
"""

import io
import json
import logging
import re
import struct
import urllib.parse
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, cast

import numpy as np
from PIL import Image

from processing.errors import ModelFileError
from processing.ground.arrays import Bytes, Doubles, Int64s
from processing.ground.colour import linear_of_srgb
from processing.layout.furniture.model import Material

MAX_JSON_BYTES = 16 * 2**20
MAX_NODES = 20_000  # chosen: beyond any piece of furniture; a hostile file ends here
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu")
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
SUFFIXES = (".glb", ".gltf", ".obj")
MAX_FILE_BYTES = 96 * 2**20
MAX_TRIANGLES = 1_000_000  # chosen: beyond any piece of furniture
MAX_TEXTURE_PIXELS = 8192 * 8192
KEPT_TEXTURE_PX = 1024  # chosen: finer than a staged picture shows
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif")
GREY = (0.5, 0.5, 0.5)
_CORNER = re.compile(rb"-?\d+(/(-?\d+)?(/(-?\d+)?)?)?")


def check_gltf(data: bytes, where: str, max_triangles: int) -> None:
    """Raise `ModelFileError` where a file's JSON, counts, sizes or tree of nodes cannot be right."""
    text = _glb_json(data, where) if data[:4] == b"glTF" else data
    if len(text) > MAX_JSON_BYTES and data[:4] == b"glTF":
        raise ModelFileError(f"more than {MAX_JSON_BYTES // 2**20} MiB of JSON", where=where)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise ModelFileError("its JSON cannot be read", where=where, likely="not a glTF file, or cut off") from None
    if not isinstance(document, dict) or "asset" not in document:
        raise ModelFileError("no glTF: it has no 'asset'", where=where)
    try:
        for name in document.get("extensionsRequired", ()):
            if name in COMPRESSED:
                raise ModelFileError(f"compressed ({name})", where=where, advice="export it without compression")
        total = _tree_triangles(document, _mesh_triangles(document, where, max_triangles), where)
        if total > max_triangles:
            raise ModelFileError(f"{total} triangles; at most {max_triangles} are read", where=where)
    except (TypeError, KeyError, ValueError, AttributeError, IndexError, OverflowError):
        raise ModelFileError("its JSON is not glTF's", where=where, likely="a damaged file") from None


def _glb_json(data: bytes, where: str) -> bytes:
    if len(data) < 20:
        raise ModelFileError("cut off within its header", where=where)
    version, length, chunk, kind = struct.unpack("<IIII", data[4:20])
    if version != 2 or kind != 0x4E4F534A:
        raise ModelFileError(f"GLB version {version}; 2 is read", where=where)
    if length > len(data) or 20 + chunk > len(data):
        raise ModelFileError(f"cut off: {len(data)} of {max(length, 20 + chunk)} bytes", where=where)
    return data[20 : 20 + chunk]


def _mesh_triangles(document: dict[str, Any], where: str, most: int) -> list[int]:
    """Return each mesh's number of triangles; check that accessors lie within their buffers."""
    accessors, views = document.get("accessors", []), document.get("bufferViews", [])
    sizes = [int(b["byteLength"]) for b in document.get("buffers", [])]
    for view in views:
        start, long = int(view.get("byteOffset", 0)), int(view["byteLength"])
        if start < 0 or long < 0 or start + long > sizes[view["buffer"]]:
            raise ModelFileError("its data ends before the declared length", where=where)
    for accessor in accessors:
        count = int(accessor["count"])
        if not 0 <= count <= 3 * most:
            raise ModelFileError(f"{count} values in one accessor", where=where)
        bytes_each = _WIDTHS[accessor["type"]] * _BYTES[accessor["componentType"]]
        if "bufferView" in accessor:
            view = views[accessor["bufferView"]]
            step = int(view.get("byteStride", bytes_each))
            if int(accessor.get("byteOffset", 0)) + step * max(count - 1, 0) + bytes_each * (count > 0) > int(
                view["byteLength"]
            ):
                raise ModelFileError("its data ends before the declared length", where=where)
    return [
        sum(
            int(accessors[p["indices"] if "indices" in p else p["attributes"]["POSITION"]]["count"]) // 3
            for p in mesh["primitives"]
        )
        for mesh in document.get("meshes", [])
    ]


def _tree_triangles(document: dict[str, Any], triangles: list[int], where: str) -> int:
    """Return how many triangles all nodes together show; refuse nodes that contain themselves."""
    nodes = document.get("nodes", [])
    if len(nodes) > MAX_NODES:
        raise ModelFileError(f"{len(nodes)} nodes; at most {MAX_NODES} are read", where=where)
    parents = [0] * len(nodes)
    for node in nodes:
        for child in node.get("children", ()):
            parents[child] += 1
    if any(count > 1 for count in parents):
        raise ModelFileError("a node that has several parents", where=where)
    roots = [k for k, count in enumerate(parents) if count == 0]
    seen, total = 0, 0
    while roots:
        node = nodes[roots.pop()]
        seen += 1
        total += triangles[node["mesh"]] if "mesh" in node else 0
        roots += node.get("children", ())
    if seen != len(nodes):
        raise ModelFileError("nodes that contain themselves", where=where)
    return total


@dataclass(frozen=True, eq=False)
class RawPart:
    """Triangles of one material as the file has them."""

    vertices: Doubles
    faces: Int64s
    uv: Doubles | None
    """(n, 2) a vertex, v upwards."""
    material: Material


@dataclass(frozen=True, eq=False)
class RawModel:
    """A file's triangles, in its own units and axes."""

    parts: tuple[RawPart, ...]
    notes: tuple[str, ...]


@dataclass
class FolderFiles:
    """What trimesh may read besides the file (its "resolver"): files of the catalogue's folder, not too large."""

    folder: Path
    root: Path
    notes: list[str] = field(default_factory=list)

    def get(self, name: str) -> bytes:
        """Return a file's bytes; raise `FileNotFoundError` (noted) where it is missing, outside, or too large."""
        asked = self._inside(str(name))
        if asked is None:
            raise self._refused(f"'{_shown(name)}' points outside the folder and was not read")
        beside = asked.parent.iterdir() if asked.parent.is_dir() else ()
        other_case = (p for p in beside if p.name.lower() == asked.name.lower() and p.is_file())
        path = asked if asked.is_file() else next(other_case, None)
        if path is None or not path.resolve().is_relative_to(self.root.resolve()):
            raise self._refused(f"'{_shown(name)}' is missing")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise self._refused(f"'{_shown(name)}' is larger than {MAX_FILE_BYTES // 2**20} MiB and was not read")
        data = path.read_bytes()
        if path.suffix.lower() in PICTURES:
            wrong = picture_fault(data)
            if wrong:
                raise self._refused(f"texture '{_shown(name)}' {wrong} and was left out")
        return data

    __getitem__ = get

    def keys(self) -> list[str]:
        """Return no names: nothing is offered, only asked for."""
        return []

    def __contains__(self, name: object) -> bool:
        return False

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def _inside(self, name: str) -> Path | None:
        rel = urllib.parse.unquote(name).strip().replace("\\", "/")
        wrong = "\0" in rel or ":" in rel or PurePosixPath(rel).is_absolute() or PureWindowsPath(rel).is_absolute()
        if wrong or not rel or len(rel) > 500:
            return None
        path = (self.folder / rel).resolve()
        return path if path.is_relative_to(self.root.resolve()) else None

    def _refused(self, note: str) -> FileNotFoundError:
        if note not in self.notes:
            self.notes.append(note)
        return FileNotFoundError(note)


def picture_fault(data: bytes) -> str:
    """Return what is wrong with a picture's header, or "" for nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            width, height = Image.open(io.BytesIO(data)).size
        except Exception:  # noqa: BLE001 (Pillow fails in many ways on damaged pictures, and on bombs)
            return "cannot be read"
    return f"has {width} x {height} pixels" if width * height > MAX_TEXTURE_PIXELS else ""


def _shown(name: object) -> str:
    return "".join(c if c.isprintable() else "?" for c in str(name))[:80]


def read_model_file(path: Path, root: Path) -> RawModel:
    """Return a file's triangles with materials; raise `ModelFileError` saying what is wrong with it."""
    where = path.name
    if not path.resolve().is_relative_to(root.resolve()):
        raise ModelFileError("a link that points outside the catalogue's folder", where=where)
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise ModelFileError(f"{size / 2**20:.0f} MiB; at most {MAX_FILE_BYTES // 2**20} are read", where=where)
        data = path.read_bytes()
    except OSError as error:
        raise ModelFileError(f"cannot be read: {error.strerror}", where=where) from None
    kind = path.suffix.lower()
    if kind == ".obj":
        data = checked_obj(data, where)
    elif kind in SUFFIXES:
        check_gltf(data, where, MAX_TRIANGLES)
    else:
        raise ModelFileError(f"'{kind}' files are not read; {', '.join(SUFFIXES)} are", where=where)
    files = FolderFiles(path.parent, root)
    scene = _loaded(data, kind[1:], files, where)
    parts, notes = [], list(files.notes)
    for mesh in scene:
        part, said = _raw_part(mesh)
        if part is not None:
            parts.append(part)
        notes += [note for note in said if note not in notes]
    if not parts:
        raise ModelFileError("it holds no triangles", where=where)
    if sum(len(p.faces) for p in parts) > MAX_TRIANGLES:
        raise ModelFileError(f"more than {MAX_TRIANGLES} triangles", where=where)
    return RawModel(tuple(parts), tuple(notes))


def checked_obj(data: bytes, where: str) -> bytes:
    """Return an OBJ file's bytes; raise `ModelFileError` for what is none, or names vertices that it does not have."""
    if b"\0" in data[:4096]:
        raise ModelFileError("not a text file", where=where)
    vertices = len(re.findall(rb"^\s*v\s", data, re.M))
    faces = re.findall(rb"^\s*f\s+([^\r\n#]*)", data, re.M)
    if not vertices or not faces:
        raise ModelFileError("no vertices or no faces", where=where, likely="not an OBJ file, or an empty one")
    if len(faces) > MAX_TRIANGLES:
        raise ModelFileError(f"more than {MAX_TRIANGLES} faces", where=where)
    numbers = re.findall(rb"(?:^|\s)(-?\d+)", b"\n".join(faces))
    if any(not _CORNER.fullmatch(corner) for face in faces for corner in face.split()) or not numbers:
        raise ModelFileError("a face names no vertices", where=where, likely="a damaged file")
    worst = max(numbers, key=len)
    if len(worst) > 12:
        raise ModelFileError(f"a face names vertex {worst[:20].decode()}...", where=where)
    index = np.array(numbers, dtype=np.int64)
    if (index == 0).any():
        raise ModelFileError("a face names vertex 0; they are counted from 1", where=where)
    if np.abs(index).max() > vertices:
        raise ModelFileError(f"a face names vertex {int(index[np.abs(index).argmax()])} of {vertices}", where=where)
    return _absolute(data) if (index < 0).any() else data


def _absolute(data: bytes) -> bytes:
    """Return an OBJ whose faces count from the end rewritten to count from the start."""
    seen = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = []
    for line in data.splitlines():
        words = line.split()
        if words and words[0] in seen:
            seen[words[0]] += 1
        if words and words[0] == b"f":
            corners = []
            for corner in words[1:]:
                places = zip(corner.split(b"/"), seen.values(), strict=False)
                corners.append(
                    b"/".join(b"%d" % (int(p) + 1 + n if int(p) < 0 else int(p)) if p else b"" for p, n in places)
                )
            lines.append(b" ".join([b"f", *corners]))
        else:
            lines.append(line)
    return b"\n".join(lines) + b"\n"


def _loaded(data: bytes, kind: str, files: FolderFiles, where: str) -> list[Any]:
    """Return trimesh's meshes of a file, in the scene's places."""
    import trimesh

    logger = logging.getLogger("trimesh")
    quiet, logger.disabled = logger.disabled, True
    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=cast(Any, files), process=False)
        return [m for m in scene.dump(concatenate=False) if isinstance(m, trimesh.Trimesh) and len(m.faces)]
    except Exception as error:  # noqa: BLE001 (a damaged file makes its reader fail in any way)
        said = "; ".join(files.notes) or f"{type(error).__name__}: {_shown(error)}"
        raise ModelFileError(f"cannot be read: {said}", where=where, likely="a damaged file") from None
    finally:
        logger.disabled = quiet


def _raw_part(mesh: Any) -> tuple[RawPart | None, list[str]]:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    if not len(faces) or not len(vertices):
        return None, []
    uv = getattr(mesh.visual, "uv", None)
    uv = None if uv is None else np.asarray(uv, dtype=np.float64)
    notes: list[str] = []
    if uv is not None and (uv.shape != (len(vertices), 2) or not np.isfinite(uv).all()):
        notes.append("texture coordinates that are not numbers were dropped")
        uv = None
    material = _material(mesh.visual, notes, textured=uv is not None)
    return RawPart(vertices, faces, uv if material.texture is not None else None, material), notes


def _material(visual: Any, notes: list[str], *, textured: bool) -> Material:
    """Return trimesh's material in our terms; what it does not say is plain grey."""
    given = getattr(visual, "material", None)
    name = _shown(getattr(given, "name", None) or "unnamed")
    if given is None:
        return Material(name, GREY, two_sided=True)
    pbr = given if type(given).__name__ == "PBRMaterial" else given.to_pbr()
    factor = getattr(pbr, "baseColorFactor", None)
    coded = np.full(4, 255.0) if factor is None else np.asarray(factor, dtype=np.float64).ravel()
    coded = coded / 255.0 if coded.max() > 1.0 or np.asarray(factor).dtype == np.uint8 else coded
    coded = np.clip(np.nan_to_num(np.append(coded, np.ones(4))[:4], nan=0.5), 0, 1)
    texture = _texture(getattr(pbr, "baseColorTexture", None), notes) if textured else None
    colour = coded[:3]
    if pbr is not given:
        # An OBJ's Kd is meant for the screen; beside a texture it is mostly a leftover.
        colour = linear_of_srgb(np.rint(255 * colour).astype(np.uint8)) if texture is None else np.ones(3)
    r, g, b = (float(c) for c in colour)
    # glTF's factors are 1 where they are left out, and multiply a picture's green and blue; OBJ has no metal.
    picture = _texture(getattr(pbr, "metallicRoughnessTexture", None), notes)
    means = np.ones(2) if picture is None else picture.mean(axis=(0, 1))[1:] / 255
    usual = {"roughnessFactor": 1.0, "metallicFactor": float(pbr is given)}
    stated = [one if (v := getattr(pbr, key, None)) is None else v for key, one in usual.items()]
    rough, metal = np.clip(np.array(stated) * means, 0, 1).tolist()
    opacity = float(coded[3]) if coded[3] > 0.02 else 1.0
    return Material(name, (r, g, b), max(rough, 0.05), metal, texture, None, opacity=opacity)


def _texture(image: Any, notes: list[str]) -> Bytes | None:
    """Return a picture's pixels, at most 1024 wide; None (noted) where it cannot be read."""
    if image is None:
        return None
    try:
        if image.width * image.height > MAX_TEXTURE_PIXELS:
            notes.append(f"a texture of {image.width} x {image.height} pixels is too large and was left out")
            return None
        if max(image.size) > KEPT_TEXTURE_PX:
            scale = KEPT_TEXTURE_PX / max(image.size)
            image.draft("RGB", (KEPT_TEXTURE_PX, KEPT_TEXTURE_PX))
            size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
            size = tuple(min(s, KEPT_TEXTURE_PX) for s in size)
            image = image.convert("RGB").resize(size, Image.Resampling.BOX)
        return np.asarray(image.convert("RGB"), dtype=np.uint8)
    except Exception as error:  # noqa: BLE001 (Pillow fails in many ways on damaged pictures)
        notes.append(f"a texture cannot be read ({type(error).__name__}) and was left out")
        return None
