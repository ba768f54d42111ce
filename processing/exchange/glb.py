"""A binary glTF 2.0 file put together: buffers, pictures, materials, meshes; and nothing that knows of rooms.

Positions and normals are given in our frame (z up) and written in glTF's (y up): (x, y, z) becomes (x, z, -y).
"""

from __future__ import annotations

import hashlib
import io
import json
import struct
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Json: TypeAlias = dict[str, Any]

_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_ARRAY, _INDEX = 34962, 34963
_CLAMP, _LINEAR, _MIPMAP = 33071, 9729, 9987
_PNG_BELOW_PX = 33
"""Small pictures are kept without loss."""


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

    def add_picture(self, rgb8: npt.NDArray[np.uint8], *, repeat: bool) -> int:
        """Add a texture of an sRGB picture (h, w, 3), once; its first row is the top, v = 0 in glTF."""
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
        kind = "image/png" if lossless else "image/jpeg"
        source = self._append("images", {"bufferView": view, "mimeType": kind})
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
    ) -> None:
        """Add a node with a mesh: corners and normals (n, 3) in our frame, uv (n, 2), faces (m, 3).

        Corners that are alike in all become one.
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
        mesh = self._append("meshes", {"name": name, "primitives": [part]})
        node = self._append("nodes", {"name": name, "mesh": mesh})
        self._json["scenes"][0]["nodes"].append(node)

    def data(self) -> bytes:
        """Return the file."""
        binary = bytes(self._binary) + b"\0" * (-len(self._binary) % 4)
        text = json.dumps({**self._json, "buffers": [{"byteLength": len(binary)}]}, allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(binary)
        return (
            struct.pack("<4sII", b"glTF", 2, total)
            + struct.pack("<I4s", len(text), b"JSON")
            + text
            + struct.pack("<I4s", len(binary), b"BIN\0")
            + binary
        )

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

    def _accessor(
        self, values: npt.NDArray[np.generic], kind: str, *, bounds: bool = False, index: bool = False
    ) -> int:
        view = self._view(np.ascontiguousarray(values).tobytes(), _INDEX if index else _ARRAY)
        entry: Json = {
            "bufferView": view,
            "componentType": {2: _USHORT, 4: _UINT}[values.itemsize] if index else _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self._append("accessors", entry)


def _welded(corners: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.intp]]:
    """Return the different rows of (n, k) in the order in which they come, and which of them each row is."""
    rows = np.ascontiguousarray(corners).view(np.dtype((np.void, corners.dtype.itemsize * corners.shape[1]))).ravel()
    _, first, same = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return corners[first[order]], place[same.ravel()]


def y_up(vectors: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Return (n, 3) vectors of our frame in glTF's."""
    # Adding 0 makes -0 plain.
    return np.column_stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]]).astype(np.float32) + np.float32(0)
