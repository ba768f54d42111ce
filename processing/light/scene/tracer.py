"""What a ray meets: Embree where it is installed, else Mitsuba's own ray tracer (LLVM or CUDA).

`DAYLIT_RENDERER` names one (`embree`, `llvm`, `cuda`, `scalar`); all give the same picture but for rounding. Measured
on small rooms, one core: Embree 8 to 10 million rays a CPU second, Mitsuba through NumPy 3.3 million (LLVM); its
scalar variant, ray by ray, 0.08 million. The last is taken only where it is asked for.
"""

import os
from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from processing.errors import EngineError
from processing.ground.arrays import Doubles, Flags, Floats, Int32s
from processing.ground.kernels import compiled
from processing.ground.mitsuba_variants import CUDA, LLVM, SCALAR, load_mitsuba, usable_library, usable_variant

ASKED = "DAYLIT_RENDERER"
EMBREE = "embree"
NEARLY = 0.999  # of the way to a place, that must be free for it to be seen
VARIANTS = {"llvm": LLVM, "cuda": CUDA, "scalar": SCALAR}


@dataclass(frozen=True)
class Hits:
    """Where rays end."""

    triangle: Int32s
    """-1 where a ray leaves."""
    distance_m: Floats
    """Inf where a ray leaves."""
    u: Floats
    """Share of the triangle's second corner."""
    v: Floats
    """Share of its third corner."""


class Tracer(ABC):
    """A set of triangles that can be asked what rays meet first."""

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """Return the first hits of rays: ``origins`` (N, 3) in metres, ``directions`` (N, 3) of unit length."""
        none = np.empty(0, np.float32)
        return self._cast(origins, directions) if len(directions) else Hits(np.empty(0, np.int32), none, none, none)

    def free(self, origins: Floats, ways: Floats) -> Flags:
        """Return where (N,) nothing lies between ``origins`` (N, 3) and origins + `NEARLY` ``ways`` (N, 3), metres."""
        return self._free(origins, ways) if len(ways) else np.empty(0, bool)

    @abstractmethod
    def _cast(self, origins: Floats, directions: Floats) -> Hits: ...

    @abstractmethod
    def _free(self, origins: Floats, ways: Floats) -> Flags: ...


def tracer_of(triangles: Floats) -> Tracer:
    """Return a tracer of triangles (M, 3, 3)."""
    asked = os.environ.get(ASKED) or None
    if asked not in (None, EMBREE, *VARIANTS):
        names = ", ".join([EMBREE, *VARIANTS])
        raise EngineError(f"no renderer is called {asked!r}", where=ASKED, advice=f"one of {names}, or leave it unset")
    if asked in (None, EMBREE) and find_spec("embreex") is not None:
        return EmbreeTracer(triangles)
    if asked == EMBREE:
        raise EngineError("embreex is not installed", where=ASKED, advice="pip install embreex, or leave it unset")
    return MitsubaTracer(triangles, VARIANTS[asked] if asked else None)


class EmbreeTracer(Tracer):
    """Embree through `embreex`, one thread."""

    def __init__(self, triangles: Floats) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene, self._corners = EmbreeScene(robust=True), np.ascontiguousarray(triangles, dtype=np.float32)
        self._inverses = _inverses(self._corners)
        TriangleMesh(self._scene, self._corners)

    def _cast(self, origins: Floats, directions: Floats) -> Hits:
        origins, directions = np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32)
        triangle = self._scene.run(origins, directions, query="INTERSECT")  # alone: a third faster than with places
        distance, u, v = np.empty((3, len(triangle)), np.float32)
        _places(origins, directions, self._corners, self._inverses, triangle, distance, u, v)
        return Hits(triangle, distance, u, v)

    def _free(self, origins: Floats, ways: Floats) -> Flags:
        found = self._scene.run(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(ways, np.float32),
            dists=np.full(len(ways), NEARLY, np.float32),
            query="OCCLUDED",
        )
        return np.asarray(found < 0)


def _inverses(triangles: Floats) -> Doubles:
    """Return (M, 3, 3): what turns a place less the first corner into shares of both sides and of the normal."""
    one, other = (triangles[:, k].astype(np.float64) - triangles[:, 0] for k in (1, 2))
    normal = np.cross(one, other)
    rows = np.stack([np.cross(other, normal), np.cross(normal, one), normal], axis=1)
    return np.asarray(rows / np.maximum(np.square(normal).sum(axis=-1), 1e-300)[:, None, None])


@compiled
def _places(origins, ways, corners, inverses, triangle, distance, u, v):  # type: ignore[no-untyped-def]
    """Fill where rays (N, 3) meet the triangles (N,), -1 for none, of ``corners`` (M, 3, 3)."""
    for i in range(triangle.shape[0]):
        t = triangle[i]
        distance[i], u[i], v[i] = np.inf, 0.0, 0.0
        if t >= 0:
            a = b = c = da = db = dc = 0.0
            for k in range(3):
                off, way = origins[i, k] - np.float64(corners[t, 0, k]), ways[i, k]
                a, b, c = a + inverses[t, 0, k] * off, b + inverses[t, 1, k] * off, c + inverses[t, 2, k] * off
                da, db, dc = da + inverses[t, 0, k] * way, db + inverses[t, 1, k] * way, dc + inverses[t, 2, k] * way
            far = max(-c / dc, 0.0) if dc != 0.0 else 0.0
            distance[i], u[i], v[i] = far, min(max(a + far * da, 0.0), 1.0), min(max(b + far * db, 0.0), 1.0)


class MitsubaTracer(Tracer):
    """Mitsuba's ray tracer; in its scalar variant one ray at a time, which is slow but works everywhere."""

    def __init__(self, triangles: Floats, variant: str | None = None) -> None:
        """``triangles`` (M, 3, 3) in metres; ``variant`` None: the fastest vectorised one that works.

        Raises `EngineError` where the variant, or any vectorised one, cannot be had.
        """
        self._variant = variant or usable_variant()
        if (variant is None and self._variant == SCALAR) or (variant == LLVM and usable_library() is None):
            raise EngineError(
                "no ray tracer works here" if variant is None else "no LLVM library works here",
                likely="embreex is not available for this system, and no LLVM 16 or newer was found",
                advice=f"install LLVM 16 or newer (Debian: libllvm19), or set {ASKED}=scalar, which is slow",
            )
        self._mi: Any = load_mitsuba(self._variant)
        mesh = self._mi.Mesh("triangles", 3 * len(triangles), len(triangles))
        values = self._mi.traverse(mesh)
        values["vertex_positions"] = np.ascontiguousarray(triangles, np.float32).ravel()
        values["faces"] = np.arange(3 * len(triangles), dtype=np.uint32)
        values.update()
        self._scene = self._mi.load_dict({"type": "scene", "triangles": mesh})

    def _cast(self, origins: Floats, directions: Floats) -> Hits:
        mi = self._mi
        if self._variant == SCALAR:
            hits = [
                self._scene.ray_intersect_preliminary(mi.Ray3f(o, d)) for o, d in zip(origins, directions, strict=True)
            ]
            distance = np.array([h.t for h in hits], np.float32)
            places = np.array([h.prim_uv for h in hits], np.float32).T
            index = np.array([h.prim_index for h in hits], np.int64)
        else:
            ray = mi.Ray3f(mi.Point3f(np.asarray(origins).T), mi.Vector3f(np.asarray(directions).T))
            found = self._scene.ray_intersect_preliminary(ray, coherent=False)
            distance, places = found.t.numpy(), found.prim_uv.numpy()
            index = found.prim_index.numpy().astype(np.int64)
        return Hits(np.where(np.isfinite(distance), index, -1).astype(np.int32), distance, places[0], places[1])

    def _free(self, origins: Floats, ways: Floats) -> Flags:
        mi = self._mi
        if self._variant == SCALAR:
            both = zip(origins, ways, strict=True)
            rays = (mi.Ray3f(mi.Point3f(o), mi.Vector3f(w), NEARLY, 0.0, []) for o, w in both)
            return ~np.array([self._scene.ray_test(ray) for ray in rays], bool)
        ray = mi.Ray3f(mi.Point3f(np.asarray(origins).T), mi.Vector3f(np.asarray(ways).T))
        ray.maxt = mi.Float(NEARLY)
        return np.asarray(~self._scene.ray_test(ray).numpy())
