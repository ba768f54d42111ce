"""What a glTF or GLB file promises, checked before anything is read or allocated for it."""

from __future__ import annotations

import json
import struct
from typing import Any

from processing.errors import ModelFileError

MAX_JSON_BYTES = 16 * 2**20
MAX_NODES = 20_000
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu")
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}


def check_gltf(data: bytes, where: str, max_triangles: int) -> None:
    """Raise `ModelFileError` where a file's JSON, counts, sizes or tree of nodes cannot be right."""
    document = _document(data, where)
    try:
        _check(document, where, max_triangles)
    except (TypeError, KeyError, ValueError, AttributeError, IndexError, OverflowError):
        raise ModelFileError("its JSON is not glTF's", where=where, likely="a damaged file") from None


def _document(data: bytes, where: str) -> dict[str, Any]:
    text = _glb_json(data, where) if data[:4] == b"glTF" else data
    if len(text) > MAX_JSON_BYTES and data[:4] == b"glTF":
        raise ModelFileError(f"more than {MAX_JSON_BYTES // 2**20} MiB of JSON", where=where)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise ModelFileError("its JSON cannot be read", where=where, likely="not a glTF file, or cut off") from None
    if not isinstance(document, dict) or "asset" not in document:
        raise ModelFileError("no glTF: it has no 'asset'", where=where)
    return document


def _glb_json(data: bytes, where: str) -> bytes:
    if len(data) < 20:
        raise ModelFileError("cut off within its header", where=where)
    version, length, chunk, kind = struct.unpack("<IIII", data[4:20])
    if version != 2 or kind != 0x4E4F534A:
        raise ModelFileError(f"GLB version {version}; 2 is read", where=where)
    if length > len(data) or 20 + chunk > len(data):
        raise ModelFileError(f"cut off: {len(data)} of {max(length, 20 + chunk)} bytes", where=where)
    return data[20 : 20 + chunk]


def _check(document: dict[str, Any], where: str, max_triangles: int) -> None:
    for name in document.get("extensionsRequired", ()):
        if name in COMPRESSED:
            raise ModelFileError(f"compressed ({name})", where=where, advice="export it without compression")
    triangles = _mesh_triangles(document, where, max_triangles)
    total = _tree_triangles(document, triangles, where)
    if total > max_triangles:
        raise ModelFileError(f"{total} triangles; at most {max_triangles} are read", where=where)


def _mesh_triangles(document: dict[str, Any], where: str, most: int) -> list[int]:
    """Return each mesh's number of triangles; check that accessors lie within their buffers."""
    accessors, views = document.get("accessors", []), document.get("bufferViews", [])
    sizes = [int(b["byteLength"]) for b in document.get("buffers", [])]
    for view in views:
        start, long = int(view.get("byteOffset", 0)), int(view["byteLength"])
        if start < 0 or long < 0 or start + long > sizes[view["buffer"]]:
            raise ModelFileError("data promised beyond the end of its buffer", where=where)
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
                raise ModelFileError("data promised beyond the end of its buffer", where=where)
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
