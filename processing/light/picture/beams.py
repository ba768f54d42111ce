"""Rays that bring light to places of a bare room, kept: what is put in their way takes theirs away, and no other's.

Of a body that moves only the rays near it are asked again, so that its shade follows it in a fraction of a second. What
a body gives back is taken as even over all of it (`Body.glow`): bounces beyond the first are the bare room's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from processing.ground.arrays import Doubles, Floats, Indices, Int16s, Int64s
from processing.ground.kernels import compiled
from processing.light.solver.kernels import STEP_OFF_M, cosine_rays, random
from processing.light.solver.sky import sky_beams
from processing.light.solver.stage import Stage
from processing.light.solver.transport import LightMap

FAR_M = 100.0  # chosen: beyond every pane
Pose: TypeAlias = tuple[float, float, float, float, float]
"""Cosine and sine of a body's turn, and where its own origin stands, m."""


class Beams(NamedTuple):
    """Rays (K) that light places (N)."""

    place: Int64s
    """(K,): whose."""
    origin: Floats
    """(K, 3), m."""
    way: Floats
    """(K, 3), m: to where the light comes from."""
    light: Floats
    """(K, 3), lx."""
    share: Floats
    """(K,): by which the radiosity of what stops it counts instead; 0: it came from outdoors."""


def beams_at(
    stage: Stage, light: LightMap, points: Floats, normals: Floats, samples: tuple[int, int], seed: int
) -> tuple[Beams, Floats]:
    """Return the rays of places in a room's settled light, without the sun's own; and (N,) their harmonic mean, m.

    ``points`` and ``normals`` (N, 3); ``samples``: rays from each for bounces, and to each pane.
    """
    count, spread = len(points), samples[0]
    origins, rays = np.empty((2, count, spread, 3), np.float32)
    cosine_rays(points[:, None], normals, random((seed, 60), count, 2), origins, rays)
    starts, ahead = origins.reshape(-1, 3), rays.reshape(-1, 3)
    hits = stage.tracer.cast(starts, ahead)
    patch, _ = stage.met(starts, ahead, hits)
    met = np.flatnonzero(patch >= 0)
    radiosity = stage.albedo * light.rest + (0 if light.bright is None else light.bright.radiosity)
    far = np.where(np.isfinite(hits.distance_m), hits.distance_m, FAR_M)
    found = [(met // spread, starts[met], ahead[met] * far[met, None], radiosity[patch[met]] / spread, 1 / spread)]
    for place, way, brought in sky_beams(stage, points[:, None], normals, samples[1], (seed, 61)):
        found.append((place, points[place] + STEP_OFF_M * normals[place], way * np.float32(FAR_M), brought, 0.0))
    *parts, shares = zip(*found, strict=True)
    share = np.concatenate([np.full(len(one), s, np.float32) for one, s in zip(parts[0], shares, strict=True)])
    origin, way, brings = (np.concatenate(part).astype(np.float32) for part in parts[1:])
    mean_m = 1 / np.mean(1 / np.maximum(far, 0.02).reshape(count, spread), axis=1)
    return Beams(np.concatenate(parts[0]).astype(np.int64), origin, way, brings, share), mean_m


@dataclass(frozen=True, eq=False)
class Body:
    """A body where it stands; ``stage`` holds it in its own frame."""

    stage: Stage
    pose: Pose

    @cached_property
    def box(self) -> Doubles:
        """Return its least and its greatest corner in its own frame, shape (2, 3), m."""
        corners = self.stage.patches.triangles.reshape(-1, 3)
        return np.array([corners.min(axis=0) - 1e-4, corners.max(axis=0) + 1e-4], np.float64)

    @cached_property
    def albedo(self) -> Doubles:
        """Return its mean albedo, shape (3,)."""
        return np.asarray(np.average(self.stage.albedo, axis=0, weights=self.stage.patches.area_m2 + 1e-12))

    def near(self, origin: Floats, way: Floats) -> tuple[Indices, Floats, Floats]:
        """Return which rays (K, 3), m, come near it (M,), and these in its own frame: origins and ways (M, 3)."""
        chosen, (starts, ways) = np.empty(len(way), np.intp), np.empty((2, len(way), 3), np.float32)
        used = _near(origin, way, np.array(self.pose), self.box, chosen, starts, ways)
        return chosen[:used], starts[:used], ways[:used]

    def stops(self, beams: Beams) -> Indices:
        """Return which of the rays it stops: (M,)."""
        chosen, starts, ways = self.near(beams.origin, beams.way)
        return chosen[~self.stage.tracer.free(starts, ways)]

    def turned(self, vectors: Floats) -> Floats:
        """Return vectors (N, 3) of its own frame in the room's."""
        c, s = self.pose[:2]
        return vectors @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], np.float32)


class Field:
    """Places and the rays that light them; which of those each body stops is known until it moves."""

    def __init__(self, beams: Beams, count: int) -> None:
        self.beams, self._count = beams, count
        self._stopped: dict[Body, Indices] = {}

    def under(self, bodies: Sequence[Body], glow: Doubles | None = None) -> Floats:
        """Return the irradiance (N, 3), lx, with bodies in the way, which themselves give ``glow`` (B, 3), lm/m2."""
        stopped = np.full(len(self.beams.place), -1, np.int16)
        self._stopped = {one: self._stopped[one] for one in bodies if one in self._stopped}
        for number, one in enumerate(bodies):
            if one not in self._stopped:
                self._stopped[one] = one.stops(self.beams)
            stopped[self._stopped[one]] = number
        out = np.zeros((self._count, 3), np.float32)
        _add(self.beams, stopped, np.zeros((len(bodies), 3)) if glow is None else glow, out)
        return out


@compiled
def _add(beams, stopped: Int16s, glow, out):  # type: ignore[no-untyped-def]
    """Add the light of rays that nothing stops to ``out`` (N, 3), and the glow of what stops the others."""
    for k in range(beams.place.shape[0]):
        i, body = beams.place[k], stopped[k]
        for c in range(3):
            out[i, c] += beams.light[k, c] if body < 0 else beams.share[k] * glow[body, c]


@compiled
def _near(origin, way, pose, box, chosen, starts, ways):  # type: ignore[no-untyped-def]
    """Fill which rays meet a box in its own frame, and those in that frame; returns how many."""
    used, one = 0, origin.shape[0] == 1
    for k in range(way.shape[0]):
        j = 0 if one else k
        x, y, enter, leave = origin[j, 0] - pose[2], origin[j, 1] - pose[3], 0.0, 1.0
        starts[used, 0], starts[used, 1] = pose[0] * x + pose[1] * y, pose[0] * y - pose[1] * x
        ways[used, 0] = pose[0] * way[k, 0] + pose[1] * way[k, 1]
        ways[used, 1] = pose[0] * way[k, 1] - pose[1] * way[k, 0]
        starts[used, 2], ways[used, 2] = origin[j, 2] - pose[4], way[k, 2]
        for c in range(3):
            step = ways[used, c] if abs(ways[used, c]) > 1e-9 else 1e-9
            a, b = (box[0, c] - starts[used, c]) / step, (box[1, c] - starts[used, c]) / step
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        if enter <= leave:
            chosen[used] = k
            used += 1
    return used
