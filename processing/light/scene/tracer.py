"""What a ray meets: Embree where it is installed, else Mitsuba's own ray tracer (LLVM or CUDA).

`DAYLIT_RENDERER` names one (`embree`, `llvm`, `cuda`); all give the same picture but for rounding. Measured on small
rooms, one core: Embree 8 to 10 million rays a CPU second, Mitsuba's LLVM variant through NumPy 3.3 million.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from processing.errors import EngineError
from processing.ground.arrays import Floats, Int32s
from processing.light.scene.engine import usable_variant, with_variant

ASKED = "DAYLIT_RENDERER"
EMBREE, LLVM, CUDA = "embree", "llvm", "cuda"
NEARLY = 0.999
"""Of the way to a place, that must be free for it to be seen."""
VARIANTS = {LLVM: "llvm_ad_rgb", CUDA: "cuda_ad_rgb"}


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


class Tracer(Protocol):
    """A set of triangles that can be asked what rays meet first."""

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """Return the first hits of rays (n, 3); directions are unit vectors."""
        ...

    def free(self, origins: Floats, ways: Floats) -> npt.NDArray[np.bool_]:
        """Return where nothing stands in the way (n,) from origins to origins + `NEARLY` ways."""
        ...


def tracer_of(triangles: Floats) -> Tracer:
    """Return a tracer of triangles (m, 3, 3)."""
    asked = os.environ.get(ASKED) or None
    if asked not in (None, EMBREE, LLVM, CUDA):
        raise EngineError(
            f"no renderer is called {asked!r}", where=ASKED, advice=f"say {EMBREE}, {LLVM} or {CUDA}, or leave it unset"
        )
    if asked in (None, EMBREE) and find_spec("embreex") is not None:
        return EmbreeTracer(triangles)
    if asked == EMBREE:
        raise EngineError("embreex is not installed", where=ASKED, advice="pip install embreex, or leave it unset")
    return MitsubaTracer(triangles, VARIANTS[asked] if asked else None)


class EmbreeTracer:
    """Embree through `embreex`, one thread."""

    def __init__(self, triangles: Floats) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, np.ascontiguousarray(triangles, dtype=np.float32))

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """Return the first hits of rays (n, 3)."""
        if not len(directions):
            none = np.empty(0, np.float32)
            return Hits(np.empty(0, np.int32), none, none, none)
        found = self._scene.run(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(directions, np.float32),
            query="INTERSECT",
            output=True,
        )
        distance = np.where(found["primID"] >= 0, found["tfar"], np.float32(np.inf))
        return Hits(found["primID"], distance, found["u"], found["v"])

    def free(self, origins: Floats, ways: Floats) -> npt.NDArray[np.bool_]:
        """Return where nothing stands in the way (n,)."""
        if not len(ways):
            return np.empty(0, bool)
        found = self._scene.run(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(ways, np.float32),
            dists=np.full(len(ways), NEARLY, np.float32),
            query="OCCLUDED",
        )
        return np.asarray(found < 0)


class MitsubaTracer:
    """Mitsuba's ray tracer in a vectorised variant."""

    def __init__(self, triangles: Floats, variant: str | None = None) -> None:
        chosen = variant or usable_variant()
        if chosen not in VARIANTS.values():
            raise EngineError(
                "no ray tracer works here",
                likely="embreex is not packaged for this system, and no LLVM of 16 or newer was found",
                advice="install LLVM 16 or newer (Debian: libllvm19)",
            )
        self._mi: Any = with_variant(chosen)
        mesh = self._mi.Mesh("triangles", 3 * len(triangles), len(triangles))
        values = self._mi.traverse(mesh)
        values["vertex_positions"] = np.ascontiguousarray(triangles, np.float32).ravel()
        values["faces"] = np.arange(3 * len(triangles), dtype=np.uint32)
        values.update()
        self._scene = self._mi.load_dict({"type": "scene", "triangles": mesh})

    def cast(self, origins: Floats, directions: Floats) -> Hits:
        """Return the first hits of rays (n, 3)."""
        mi = self._mi
        if not len(directions):
            none = np.empty(0, np.float32)
            return Hits(np.empty(0, np.int32), none, none, none)
        ray = mi.Ray3f(mi.Point3f(np.asarray(origins).T), mi.Vector3f(np.asarray(directions).T))
        found = self._scene.ray_intersect_preliminary(ray, coherent=False)
        distance, places = found.t.numpy(), found.prim_uv.numpy()
        met = np.isfinite(distance)
        triangle = np.where(met, found.prim_index.numpy().astype(np.int64), -1).astype(np.int32)
        return Hits(triangle, distance, places[0], places[1])

    def free(self, origins: Floats, ways: Floats) -> npt.NDArray[np.bool_]:
        """Return where nothing stands in the way (n,)."""
        mi = self._mi
        if not len(ways):
            return np.empty(0, bool)
        ray = mi.Ray3f(mi.Point3f(np.asarray(origins).T), mi.Vector3f(np.asarray(ways).T))
        ray.maxt = mi.Float(NEARLY)
        return np.asarray(~self._scene.ray_test(ray).numpy())
