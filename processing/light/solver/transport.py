"""Light that goes from surface to surface.

Rays spread by the cosine from every patch tell which patches light it: their mean radiosity is its irradiance. The
same rays serve every bounce, every sky and every albedo, so that all of them are cheap once the rays are cast. Small
bright patches (where the sun falls, lamps) are rarely met by chance: shots are aimed at them too, and both are
joined by the balance heuristic (Veach 1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from processing.errors import NoBalanceError
from processing.ground.arrays import Doubles, Floats, Int32s
from processing.light.solver.kernels import STEP_OFF_M, Key, bounce, bounce_bright, cosine_rays, random
from processing.light.solver.stage import RAYS_AT_ONCE, Stage
from processing.pictures.images import LUMINANCE_WEIGHTS

MOST_BOUNCES = 3000
SETTLED = 1e-5
"""Relative change of a bounce, below which light has settled (with what is still to come extrapolated)."""


@dataclass(frozen=True)
class Links:
    """What the rays of n points met."""

    patch: Int32s
    """(n, samples), -1 where none."""
    density: Floats
    """(n, samples): cos cos' / (pi r2), the chance of that ray per m2."""


def links_of(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> Links:
    """Cast ``samples`` rays from each point: ``points`` (n, k, 3), k = 1 or ``samples``; ``normals`` (n, 3)."""
    patch, density = np.empty((len(normals), samples), np.int32), np.empty((len(normals), samples), np.float32)
    shifts = random(key, len(normals), 2)
    at_once = max(1, RAYS_AT_ONCE // samples)
    for start in range(0, len(normals), at_once):
        part = slice(start, start + at_once)
        count = len(normals[part])
        origins, rays = np.empty((2, count, samples, 3), np.float32)
        cosine_rays(points[part], normals[part], shifts[part], 0, samples, origins, rays)
        cosine = np.einsum("ic,isc->is", normals[part], rays)
        flat, ahead = origins.reshape(-1, 3), rays.reshape(-1, 3)
        hits = stage.tracer.cast(flat, ahead)
        met, facing = stage.met(flat, ahead, hits)
        patch[part] = met.reshape(count, samples)
        far2 = np.maximum(hits.distance_m, np.float32(1e-4)) ** 2
        density[part] = (cosine.ravel() * facing / (np.pi * far2)).reshape(count, samples)
    return Links(patch, density)


def patch_points(stage: Stage, samples: int, key: Key) -> Floats:
    """Return places spread over every patch: (patches, samples, 3)."""
    which = np.repeat(np.arange(stage.patches.count), samples)
    return stage.patches.places(which, key).reshape(-1, samples, 3)


@dataclass(frozen=True)
class BrightPatches:
    """Patches that deserve shots of their own, and with what chance."""

    radiosity: Doubles
    """(patches, 3): of the bright ones, 0 elsewhere."""
    chance: Doubles
    """(patches,): of a shot, per m2."""
    patch: np.ndarray
    """(b,): which are bright."""
    upto: Doubles
    """(b,): running sum of their chances, ends at 1."""

    @classmethod
    def of(cls, stage: Stage, radiosity: Doubles) -> BrightPatches | None:
        """Return the patches that give any of this light (patches, 3); None where none does."""
        power = (radiosity @ np.asarray(LUMINANCE_WEIGHTS)) * stage.patches.area_m2
        patch = np.flatnonzero(power > 0)
        if not len(patch):
            return None
        share = power[patch] / power[patch].sum()
        chance = np.zeros(len(power))
        chance[patch] = share / stage.patches.area_m2[patch]
        return cls(np.where(chance[:, None] > 0, radiosity, 0.0), chance, patch, np.cumsum(share))


def from_bright(
    stage: Stage,
    bright: BrightPatches,
    points: Floats,
    normals: Floats,
    links: Links,
    shots: int,
    key: Key,
) -> Doubles:
    """Return the irradiance (n, 3) that bright patches give, by the points' own rays and by aimed shots."""
    out = np.zeros((len(normals), 3))
    samples = links.patch.shape[1]
    bounce_bright(links.patch, links.density, bright.radiosity, bright.chance, shots, out)
    offset = random((*key, 0), len(normals), 1)[:, 0]
    for shot in range(shots):
        goal = (shot + offset) / shots
        chosen = bright.patch[np.minimum(np.searchsorted(bright.upto, goal), len(bright.patch) - 1)]
        here = points[:, shot % points.shape[1]]
        out += _shots(stage, bright, here, normals, chosen, (samples, shots), (*key, 1 + shot))
    return out


def _shots(
    stage: Stage,
    bright: BrightPatches,
    points: Floats,
    normals: Floats,
    chosen: np.ndarray,
    counts: tuple[int, int],
    key: Key,
) -> Doubles:
    """Return what one aimed shot from each point finds, weighted against the rays that find it by chance."""
    samples, shots = counts
    goals = stage.patches.places(chosen, key)
    start = points + np.float32(STEP_OFF_M) * normals
    way = goals - start
    far2 = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
    way /= np.sqrt(far2)[:, None]
    here = np.einsum("ij,ij->i", way, normals)
    there = -np.einsum("ij,ij->i", way, stage.patches.normal[chosen])
    useful = np.flatnonzero((here > 0) & (there > 0))
    out = np.zeros((len(points), 3))
    hits = stage.tracer.cast(start[useful], way[useful])
    met, _ = stage.met(start[useful], way[useful], hits)
    seen = useful[(met == chosen[useful]) | (hits.distance_m > np.sqrt(far2[useful]) * 0.999)]
    form = here[seen] * there[seen] / (np.pi * far2[seen])
    chance = bright.chance[chosen[seen]]
    # Balance heuristic: chance / (shots chance + samples form), already divided by the shots' own density.
    out[seen] = bright.radiosity[chosen[seen]] * (form / (shots * chance + samples * form))[:, None]
    return out


def settle(stage: Stage, links: Links, first: Doubles, albedo: Doubles) -> Doubles:
    """Return the irradiance (n, 3) of all patches once light has settled: E = first + mean of albedo x E.

    Raises
    ------
    NoBalanceError
        It never settles: what is given off is not absorbed.
    """
    total, more, out = first.copy(), first, np.empty_like(first)
    whole = max(float(first.sum()), 1e-300)
    before = whole
    for _ in range(MOST_BOUNCES):
        bounce(links.patch, albedo * more, out)
        total += out
        now = float(out.sum())
        ratio = now / before if before > 0 else 0.0
        left = now * ratio / (1 - ratio) if ratio < 1 else np.inf
        if left < SETTLED * whole:
            return total
        if left < 0.2 * float(total.sum()) and _steady(out, more, ratio):
            # From here on every bounce is the one before, dimmed: the rest is a geometric series.
            return total + out * (ratio / (1 - ratio))
        more, before = out.copy(), now
    raise NoBalanceError(
        "light is given off but not absorbed",
        where="light transport",
        likely="a closed room in which everything has an albedo of 1",
        advice="give some surface an albedo below 1, or an opening",
    )


def _steady(now: Doubles, before: Doubles, ratio: float) -> bool:
    return bool(np.abs(now - ratio * before).max() <= 1e-3 * now.max())
