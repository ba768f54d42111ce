"""All triangles of a room, and rays through them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mocks.rooms.light.engine import EngineError
from mocks.rooms.model import Part
from processing.ground.arrays import Flags, Floats, Int32s

_BLOCK = 1 << 18


@dataclass(frozen=True)
class Hits:
    """Where rays end: ``face`` is the triangle (-1: none, the ray leaves), ``distance_m`` inf where none.

    ``weights`` (N, 3) are the barycentric shares of the triangle's corners.
    """

    face: Int32s
    distance_m: Floats
    weights: Floats


class Geometry:
    """The triangles of parts, in one list each of corners, normals and uv, with an index from triangle to part."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = tuple(parts)
        meshes = [part.mesh for part in self.parts]
        self.corners: Floats = np.concatenate([m.vertices[m.faces] for m in meshes]).astype(np.float32)
        self.normals: Floats = np.concatenate([m.normals[m.faces] for m in meshes]).astype(np.float32)
        self.uv: Floats = np.concatenate([m.uv[m.faces] for m in meshes]).astype(np.float32)
        self.part_of: Int32s = np.repeat(np.arange(len(meshes), dtype=np.int32), [len(m.faces) for m in meshes])
        edges = self.corners[:, 1:] - self.corners[:, :1]
        flat = np.cross(edges[:, 0], edges[:, 1])
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        self.face_normals: Floats = (flat / np.maximum(length, 1e-20)).astype(np.float32)

    @cached_property
    def _scene(self) -> Any:
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            likely = "a system that Embree has no package for, such as Linux on ARM"
            advice = "generate rooms on another computer; --simulate room works everywhere"
            raise EngineError(f"rays cannot be cast: {error}", where="embreex", likely=likely, advice=advice) from error
        scene = EmbreeScene(robust=True)
        TriangleMesh(scene, np.ascontiguousarray(self.corners))
        return scene

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """Return what rays (N, 3) meet first; ``origins`` may be one point (3,)."""
        count = len(directions)
        origins = np.broadcast_to(np.asarray(origins, dtype=np.float32), (count, 3))
        face, distance = np.empty(count, np.int32), np.empty(count, np.float32)
        weights = np.empty((count, 3), np.float32)
        for start in range(0, count, _BLOCK):
            part = slice(start, min(start + _BLOCK, count))
            rays = np.ascontiguousarray(directions[part], dtype=np.float32)
            found = self._scene.run(np.ascontiguousarray(origins[part]), rays, query="INTERSECT", output=True)
            face[part], distance[part] = found["primID"], found["tfar"]
            weights[part, 1], weights[part, 2] = found["u"], found["v"]
        weights[:, 0] = 1 - weights[:, 1] - weights[:, 2]
        distance[face < 0] = np.inf
        return Hits(face, distance, weights)

    def blocked(self, origins: Floats, directions: Floats) -> Flags:
        """Return which rays (N, 3), from origins (N, 3) in metres, meet anything at all, (N,)."""
        out = np.empty(len(directions), bool)
        for start in range(0, len(directions), _BLOCK):
            part = slice(start, min(start + _BLOCK, len(directions)))
            rays = np.ascontiguousarray(directions[part], dtype=np.float32)
            found = self._scene.run(np.ascontiguousarray(origins[part], dtype=np.float32), rays, query="OCCLUDED")
            out[part] = found >= 0
        return out

    def shading_normals(self, hits: Hits) -> Floats:
        """Return interpolated unit normals (N, 3); where a ray left, zero."""
        normal = np.einsum("nkc,nk->nc", self.normals[hits.face], hits.weights)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
        normal[hits.face < 0] = 0
        return np.asarray(normal, dtype=np.float32)

    def texture_uv(self, hits: Hits) -> Floats:
        """Return texture coordinates in metres (N, 2)."""
        return np.asarray(np.einsum("nkc,nk->nc", self.uv[hits.face], hits.weights), dtype=np.float32)
