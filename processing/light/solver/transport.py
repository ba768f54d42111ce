"""Light that goes from surface to surface, and the light map: the irradiance of every patch.

Rays spread by the cosine from every patch find which patches light it: their mean radiosity is its irradiance. The same
rays serve every bounce, every sky and every albedo, so that all of them are cheap once the rays are cast. Small bright
patches (where the sun falls, lamps) are rarely met by chance: shots are aimed at them too, and both are joined by the
balance heuristic (Veach 1997).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from processing.errors import NoBalanceError, ParameterError
from processing.ground.arrays import Doubles, Floats, Indices, Int32s
from processing.ground.kernels import compiled
from processing.light.solver.kernels import STEP_OFF_M, Key, cosine_rays, random
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage, in_parts
from processing.light.solver.sun import sunlight
from processing.pictures.images import LUMINANCE_WEIGHTS

MOST_BOUNCES = 3000  # only ends what never settles (albedo 0.9 is settled after 110); chosen, never swept
SETTLED = 1e-5  # of all light: what may still come when bounces end; chosen, far below the noise of any effort
SKY_SHARE, SUN_SHARE, SHOT_SHARE = 0.25, 0.25, 0.25
"""Of the rays spent on bounces: to each pane, to the sun, to what it lights. Chosen (benchmark render)."""
GOALS = 8192  # places on bright patches that shots are aimed at; chosen: more change no error (benchmark render)


class Links(NamedTuple):
    """What the rays (S) of N points met."""

    patch: Int32s
    """(N, S), -1 where none."""
    density: Floats
    """(N, S): cos cos' / (pi r2), the chance of that ray per m2."""


def links_of(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> Links:
    """Cast ``samples`` rays from each point: ``points`` (N, K, 3), m, K = 1 or ``samples``; ``normals`` (N, 3)."""
    patch, density = np.empty((len(normals), samples), np.int32), np.empty((len(normals), samples), np.float32)
    shifts = random(key, len(normals), 2)
    for part in in_parts(len(normals), samples):
        count = len(normals[part])
        origins, rays = np.empty((2, count, samples, 3), np.float32)
        cosine_rays(points[part], normals[part], shifts[part], origins, rays)
        cosine = np.einsum("ic,isc->is", normals[part], rays)
        flat, ahead = origins.reshape(-1, 3), rays.reshape(-1, 3)
        hits = stage.tracer.cast(flat, ahead)
        met, facing = stage.met(flat, ahead, hits)
        patch[part] = met.reshape(count, samples)
        far2 = np.maximum(hits.distance_m, np.float32(1e-4)) ** 2
        density[part] = (cosine.ravel() * facing / (np.pi * far2)).reshape(count, samples)
    return Links(patch, density)


def patch_points(stage: Stage, samples: int, key: Key) -> Floats:
    """Return places spread over every patch, shape (patches, samples, 3), m."""
    which = np.repeat(np.arange(stage.patches.count), samples)
    return stage.patches.places(which, key).reshape(-1, samples, 3)


@dataclass(frozen=True)
class BrightPatches:
    """Patches (B of P) that deserve shots of their own, and with what chance."""

    radiosity: Doubles
    """(P, 3) lm/m2: of the bright ones, 0 elsewhere."""
    chance: Doubles
    """(P,): of a shot, per m2."""
    patch: Indices
    """(B,): which are bright."""
    upto: Doubles
    """(B,): running sum of their chances, ends at 1."""

    @classmethod
    def of(cls, stage: Stage, radiosity: Doubles) -> Self | None:
        """Return the patches that give any of this light (P, 3), lm/m2; None where none does."""
        power = (radiosity @ np.asarray(LUMINANCE_WEIGHTS)) * stage.patches.area_m2
        patch = np.flatnonzero(power > 0)
        if not len(patch):
            return None
        share = power[patch] / power[patch].sum()
        chance = np.zeros(len(power))
        chance[patch] = share / stage.patches.area_m2[patch]
        return cls(np.where(chance[:, None] > 0, radiosity, 0.0), chance, patch, np.cumsum(share))


class _Goals(NamedTuple):
    """Places (G) on bright patches, spread by their light."""

    places: Floats
    """(G, 3), m."""
    normals: Floats
    """(G, 3), unit."""
    light: Floats
    """(G, 3): radiosity, lm/m2."""
    chance: Floats
    """(G,): of a shot, per m2."""


def bounced(
    stage: Stage,
    links: Links,
    radiosity: Doubles,
    bright: BrightPatches | None,
    places: tuple[Floats, Floats],
    shots: int,
    key: Key,
) -> tuple[Floats, Floats]:
    """Return the irradiance (N, 3), lx, by light from other surfaces, and half of what its own two halves differ by.

    ``links``: what the points' rays met.
    ``radiosity`` (P, 3) lm/m2 of all patches, but for what ``bright`` holds.
    ``bright``: patches at which ``shots`` are aimed from each point.
    ``places``: points (N, K, 3), m, from each of which shots start in turn, and their normals (N, 3).
    """
    points, normals = places
    out, apart = np.zeros((len(normals), 3), np.float32), np.zeros(len(normals), np.float32)
    table, glow = np.zeros((len(radiosity), 4), np.float32), np.zeros((1, 3), np.float32)
    table[:, :3] = radiosity
    if bright is not None:
        table[:, 3], glow = bright.chance, bright.radiosity.astype(np.float32)
    _add_met(links, table, glow, shots, out, apart)
    if bright is None:
        return out, apart
    goal = (np.arange(GOALS) + 0.5) / GOALS
    patch = bright.patch[np.minimum(np.searchsorted(bright.upto, goal), len(bright.patch) - 1)]
    light, chance = bright.radiosity[patch].astype(np.float32), bright.chance[patch].astype(np.float32)
    goals = _Goals(stage.patches.places(patch, (*key, 1)), stage.patches.normal[patch], light, chance)
    shift = random((*key, 0), len(normals), 1)[:, 0]
    counts = (shots, links.patch.shape[1])
    for part in in_parts(len(normals), 4 * shots):
        most = len(normals[part]) * shots
        origins, ways = np.empty((2, most, 3), np.float32)
        ends = np.empty((2, most), np.int32)
        used = _aim(points[part], normals[part], shift[part], goals, shots, origins, ways, ends)
        free = stage.tracer.free(origins[:used], ways[:used])
        _add_shots(normals[part], goals, ends, ways, free, counts, out[part], apart[part])
    return out, apart


@compiled
def _add_met(links, table, bright, shots, out, apart):  # type: ignore[no-untyped-def]
    """Add to ``out`` (N, 3) the mean radiosity that rays met; of bright patches what the balance heuristic leaves them.

    ``table`` (P, 4): radiosity that counts in full, and the density of the ``shots`` at a bright patch (0: none);
    ``bright`` (P, 3): radiosity that is weighted against them. To ``apart`` (N,) goes half the difference in green
    between the estimates of even and odd rays."""
    samples = links.patch.shape[1]
    for i in range(links.patch.shape[0]):
        r = g = b = odd = 0.0
        for s in range(samples):
            k = links.patch[i, s]
            if k < 0:
                continue
            light = table[k, 1]
            r += table[k, 0]
            b += table[k, 2]
            if table[k, 3] > 0:
                by_chance = samples * links.density[i, s]
                share = by_chance / (by_chance + shots * table[k, 3])
                r += share * bright[k, 0]
                light += share * bright[k, 1]
                b += share * bright[k, 2]
            g += light
            odd += light if s & 1 else -light
        out[i, 0] += r / samples
        out[i, 1] += g / samples
        out[i, 2] += b / samples
        apart[i] += odd / samples


@compiled
def _aim(points, normals, shift, goals, shots, origins, ways, ends):  # type: ignore[no-untyped-def]
    """Fill rays (N x shots, 3) from points (N, K, 3) to goals that face them, and return how many there are.

    ``ends`` (2, N x shots): which goal, and whose ray (counted from 1, negative for a point's odd shots). Ways are not
    of unit length: they end at the goal at 1."""
    count, used = goals.places.shape[0], 0
    for i in range(points.shape[0]):
        for s in range(shots):
            k = int(((shift[i] + s / shots) % 1.0) * count)
            here = there = 0.0
            for c in range(3):
                origins[used, c] = points[i, s % points.shape[1], c] + STEP_OFF_M * normals[i, c]
                ways[used, c] = goals.places[k, c] - origins[used, c]
                here += ways[used, c] * normals[i, c]
                there -= ways[used, c] * goals.normals[k, c]
            if here > 0 and there > 0:
                ends[0, used] = k
                ends[1, used] = -(i + 1) if s & 1 else i + 1
                used += 1
    return used


@compiled
def _add_shots(normals, goals, ends, ways, free, counts, out, apart):  # type: ignore[no-untyped-def]
    """Add what aimed shots bring that are ``free``: ``counts`` are shots and, weighted against them, cosine rays."""
    shots, samples = counts
    for j in range(free.shape[0]):
        if not free[j]:
            continue
        k, i = ends[0, j], abs(ends[1, j]) - 1
        far2 = here = there = 0.0
        for c in range(3):
            far2 += ways[j, c] * ways[j, c]
            here += ways[j, c] * normals[i, c]
            there -= ways[j, c] * goals.normals[k, c]
        # Both cosines still hold the distance: form = cos cos' / (pi r2).
        form = here * there / (math.pi * max(far2 * far2, 1e-16))
        # Balance heuristic: chance / (shots chance + samples form), already divided by the shots' own density.
        share = form / (shots * goals.chance[k] + samples * form)
        for c in range(3):
            out[i, c] += share * goals.light[k, c]
        apart[i] += share * goals.light[k, 1] if ends[1, j] < 0 else -share * goals.light[k, 1]


@dataclass(frozen=True)
class LightMap:
    """Irradiance (P, 3) in lx, RGB: means over each patch."""

    sun: Doubles
    """By the sun's own disc."""
    rest: Doubles
    """All else: sky, lamps, bounces."""
    bright: BrightPatches | None
    """What the sun lights and lamps, with its radiosity."""
    links: Links

    @property
    def total(self) -> Doubles:
        """Return sun and rest: (P, 3), lx."""
        return self.sun + self.rest


def light_map(stage: Stage, samples: int = 64, seed: int = 0, links: Links | None = None) -> LightMap:
    """Return the light of all patches of a scene; ``samples`` rays from each patch gather the bounces.

    Deterministic: the same scene, samples and seed give the same light, bit by bit. ``links`` are the bounces' rays
    where they are known already, of another sky or other albedo.
    """
    if not 1 <= samples <= 1 << 20:
        raise ParameterError(f"{samples} samples", advice="give 1 to 1,048,576", samples=True)
    normals = stage.patches.normal

    def few(share: float) -> int:
        return max(1, round(samples * share))

    def spread(count: int, purpose: int) -> Floats:
        return patch_points(stage, count, (seed, purpose))

    if links is None:
        links = links_of(stage, spread(samples, 0), normals, samples, (seed, 1))
    sky = skylight(stage, spread(few(SKY_SHARE), 2), normals, few(SKY_SHARE), (seed, 3))
    sun = sunlight(stage, spread(few(SUN_SHARE), 4), normals, few(SUN_SHARE), (seed, 5))
    shots = few(SHOT_SHARE)
    return settled(stage, links, (sky, sun, stage.exitance), spread(shots, 6), shots, (seed, 7))


def settled(
    stage: Stage, links: Links, given: tuple[Doubles, Doubles, Doubles], points: Floats, shots: int, key: Key
) -> LightMap:
    """Return the light of all patches (P) once it has settled: E = first + mean of albedo x E over the rays' patches.

    ``links``: what the patches' rays met.
    ``given`` (P, 3) each: irradiance by the sky and by the sun, lx, and what lamps give off, lm/m2.
    ``points`` (P, K, 3): places from which ``shots`` are aimed at what is sunlit and at lamps.
    Raises `NoBalanceError`: it never settles: what is given off is not absorbed.
    """
    sky, sun, lamps = given
    bright = BrightPatches.of(stage, stage.albedo * sun + lamps)
    places = (points, stage.patches.normal)
    by_bright, _ = bounced(stage, links, np.zeros_like(sky), bright, places, shots, key)
    first = sky + by_bright
    total = first.copy()
    if not settle(links.patch, stage.albedo, first, total, MOST_BOUNCES, SETTLED):
        text = "light is emitted but never absorbed"
        likely = "a closed room in which everything has an albedo of 1"
        advice = "give some surface an albedo below 1, or an opening"
        raise NoBalanceError(text, where="light transport", likely=likely, advice=advice)
    return LightMap(sun, total, bright, links)


@compiled
def settle(links, albedo, first, total, most, least):  # type: ignore[no-untyped-def]
    """Bring irradiance ``total`` (P, 3) to balance: first + mean of albedo x total over what each point's rays met.

    ``links`` (P, S) are patches, -1 for none; ``albedo`` and ``first`` (P, 3). Each patch takes what is newest of the
    others (Gauss and Seidel), which takes half the rounds of a bounce at a time. Ends once what is still to come is
    below ``least`` of all light; returns whether it does within ``most`` rounds.
    """
    samples = links.shape[1]
    radiosity = albedo * total
    before = 0.0
    for turn in range(most):
        change = whole = 0.0
        for i in range(links.shape[0]):
            r = g = b = 0.0
            for s in range(samples):
                k = links[i, s]
                if k >= 0:
                    r += radiosity[k, 0]
                    g += radiosity[k, 1]
                    b += radiosity[k, 2]
            r, g, b = first[i, 0] + r / samples, first[i, 1] + g / samples, first[i, 2] + b / samples
            change += abs(r - total[i, 0]) + abs(g - total[i, 1]) + abs(b - total[i, 2])
            whole += r + g + b
            total[i, 0], total[i, 1], total[i, 2] = r, g, b
            radiosity[i, 0], radiosity[i, 1], radiosity[i, 2] = albedo[i, 0] * r, albedo[i, 1] * g, albedo[i, 2] * b
        # Rounds shrink by a steady ratio in the end: what is still to come is a geometric series.
        ratio = change / before if turn > 0 and before > 0 else 0.0
        if turn > 1 and ratio < 1 and change * ratio <= least * whole * (1 - ratio):
            return True
        if change == 0.0:
            return True
        before = change
    return False
