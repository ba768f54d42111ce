"""Light from the sky: rays through each pane, spread evenly over its solid angle.

The same rays are either summed at once under the sky of the scene (`skylight`), or kept with the cell of the sky that
each reaches (`sky_rays`), so that any other sky is a sum over stored rays (`add_sky`).
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats, Indices, Int64s, UInt16s
from processing.ground.kernels import compiled
from processing.light.scene.scene import Outdoors, Pane, transmittance_table
from processing.light.solver.kernels import Key, pane_rays, random
from processing.light.solver.stage import Stage, in_parts
from processing.sphere import Equirectangular
from processing.sphere.resampling import resample

SKY_ROWS = 128  # the stored sky's cells are 1.4 degrees wide; rays meet them at random: that blurs, and has no bias
SKY_CELLS = 2 * SKY_ROWS * SKY_ROWS


class _Glass(NamedTuple):
    """A pane's glass and what covers it, for compiled loops."""

    tint: Doubles
    """(M, 3): transmittance at cosines evenly from 0 to 1 (M = 1: alike at all)."""
    normal: Doubles
    """(3,), unit."""
    clear: Floats
    """(cells,): how much of it is clear."""
    veil: Floats
    """(cells, 3) cd/m2: radiance of what covers it."""


class _PaneRays(NamedTuple):
    """Rays (K) that reach a pane."""

    point: Int64s
    """(K,): which point they come from."""
    direction: Floats
    """(K, 3), unit."""
    weight: Floats
    """(K,), sr: irradiance by radiance."""
    cell: Indices
    """(K,): where they meet the pane, flat index into its ``clear``."""


class SkyRays(NamedTuple):
    """Stored rays (K) of N points that reach the sky or what covers a pane."""

    first: Int64s
    """(N + 1,): where each point's rays begin."""
    cell: UInt16s
    """(K,): of the sky's cells, row by row; from `SKY_CELLS` on what covers each pane."""
    tint: UInt16s
    """(K,): the pane whose glass colours the light; the number of panes: nothing does."""
    weight: Floats
    """(K,), sr: irradiance by radiance."""


def _rays_to(stage: Stage, number: int, points: Floats, normals: Floats, samples: int, key: Key) -> Iterator[_PaneRays]:
    """Yield the rays, of ``samples`` from each point to one pane, that nothing stops on their way."""
    pane = stage.scene.panes[number]
    rectangle = np.array([pane.corner_m, pane.across_m, pane.up_m], np.float64)
    lengths2 = np.square(rectangle).sum(axis=1)
    shifts = random((*key, number), len(normals), 2)
    for part in in_parts(len(normals), samples):
        shape = (len(normals[part]), samples)
        origins, rays = np.empty((2, *shape, 3), np.float32)
        weight = np.empty(shape, np.float32)
        pane_rays(points[part], normals[part], shifts[part], rectangle, origins, rays, weight)
        starts, ways = origins.reshape(-1, 3), rays.reshape(-1, 3)
        ahead = np.empty(len(ways), np.int64)
        count = _ahead_first(weight.ravel(), starts, ways, ahead)
        free, cell = stage.tracer.free(starts[:count], ways[:count]), np.empty(count, np.int64)
        count = _arrived(free, (starts, ways, ahead), (rectangle, lengths2), pane.clear.shape, cell)
        ahead = ahead[:count]
        shares = weight.ravel()[ahead] / np.float32(samples)
        yield _PaneRays(part.start + ahead // samples, ways[:count], shares, cell[:count])


@compiled
def _ahead_first(weight, starts, ways, ahead) -> int:  # type: ignore[no-untyped-def]
    """Move rays (N, 3) of some ``weight`` (N,) to the front, write to ``ahead`` which they were; return how many."""
    count = 0
    for i in range(weight.shape[0]):
        if weight[i] > 0:
            ahead[count] = i
            for c in range(3):
                starts[count, c], ways[count, c] = starts[i, c], ways[i, c]
            count += 1
    return count


@compiled
def _arrived(free, rays, place, grid, cell) -> int:  # type: ignore[no-untyped-def]
    """Move ``free`` (N,) rays to the front, of unit length, write where on the pane's ``grid`` to ``cell``; return how
    many.

    ``rays``: starts (N, 3), ways to the pane (N, 3) and which they were (N,); ``place``: the pane's corner, across and
    up (3, 3), m, and their squared lengths (3,)."""
    (starts, ways, ahead), (rectangle, lengths2) = rays, place
    count = 0
    for i in range(free.shape[0]):
        if not free[i]:
            continue
        u = v = far2 = 0.0
        for c in range(3):
            offset = starts[i, c] + ways[i, c] - rectangle[0, c]
            u += offset * rectangle[1, c]
            v += offset * rectangle[2, c]
            far2 += ways[i, c] ** 2
        row = min(max(math.floor((1 - v / lengths2[2]) * grid[0]), 0), grid[0] - 1)
        column = min(max(math.floor(u / lengths2[1] * grid[1]), 0), grid[1] - 1)
        cell[count] = row * grid[1] + column
        ahead[count] = ahead[i]
        for c in range(3):
            ways[count, c] = ways[i, c] / math.sqrt(far2)
        count += 1
    return count


def skylight(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> Doubles:
    """Return the irradiance (N, 3), lx, that the panes give under the scene's sky, without the sun.

    ``points`` (N, K, 3), m: one place each (K = 1), or ``samples`` of them; ``normals`` (N, 3); ``samples`` rays go
    from each point to each pane.
    """
    out = np.zeros((len(normals), 3))
    for number in range(len(stage.scene.panes)):
        for rays in _rays_to(stage, number, points, normals, samples, key):
            _add_outdoors(rays, stage.scene.outdoors.rgb, _glass_of(stage.scene.panes[number]), out)
    return out


def _glass_of(pane: Pane) -> _Glass:
    tint = transmittance_table(pane.transmittance, pane.sheets)
    return _Glass(tint, pane.normal, pane.clear.ravel(), pane.veil_cd_m2.reshape(-1, 3))


def sky_beams(
    stage: Stage, points: Floats, normals: Floats, samples: int, key: Key
) -> Iterator[tuple[Int64s, Floats, Doubles]]:
    """Yield the rays of `skylight` one by one: whose (K,), their direction (K, 3), what each brings (K, 3), lx."""
    for number, pane in enumerate(stage.scene.panes):
        for rays in _rays_to(stage, number, points, normals, samples, key):
            brought = np.zeros((len(rays.point), 3))
            alone = rays._replace(point=np.arange(len(rays.point)))
            _add_outdoors(alone, stage.scene.outdoors.rgb, _glass_of(pane), brought)
            yield rays.point, rays.direction, brought


@compiled
def _add_outdoors(rays, picture, glass, out):  # type: ignore[no-untyped-def]
    """Add to irradiance ``out`` (N, 3) what `_PaneRays` bring in from ``picture`` (H, 2 H, 3) cd/m2, bilinearly."""
    clear, veil, tint, normal = glass.clear, glass.veil, glass.tint, glass.normal
    last = tint.shape[0] - 1
    rows, columns = picture.shape[0], picture.shape[1]
    for k in range(rays.point.shape[0]):
        x, y, z = rays.direction[k, 0], rays.direction[k, 1], rays.direction[k, 2]
        across = (math.atan2(x, y) / (2 * math.pi) + 0.5) * columns - 0.5
        down = (0.5 - math.asin(min(max(z, -1.0), 1.0)) / math.pi) * rows - 0.5
        c0, r0 = math.floor(across), math.floor(down)
        fc, fr = across - c0, down - r0
        low, high = min(max(int(r0), 0), rows - 1), min(max(int(r0) + 1, 0), rows - 1)
        left, right = int(c0) % columns, (int(c0) + 1) % columns
        i, cell, weight = rays.point[k], rays.cell[k], rays.weight[k]
        # The transmittance at this angle, between two entries of its table.
        facing = min(abs(x * normal[0] + y * normal[1] + z * normal[2]), 1.0) * last
        step = min(math.floor(facing), max(last - 1, 0))
        part = facing - step
        for c in range(3):
            above = picture[low, left, c] * (1 - fc) + picture[low, right, c] * fc
            below = picture[high, left, c] * (1 - fc) + picture[high, right, c] * fc
            through = tint[step, c] * (1 - part) + tint[min(step + 1, last), c] * part
            outside = through * (above * (1 - fr) + below * fr)
            out[i, c] += weight * (clear[cell] * outside + veil[cell, c])


def sky_rays(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> SkyRays:
    """Return where ``samples`` rays from each point to each pane end: ``points`` (N, K, 3), ``normals`` (N, 3)."""
    panes, kinds = stage.scene.panes, (np.int64, np.uint16, np.uint16, np.float32)
    parts: list[tuple[npt.NDArray[Any], ...]] = [tuple(np.empty(0, kind) for kind in kinds)]
    for number, pane in enumerate(panes):
        veil = pane.veil_cd_m2.reshape(-1, 3).mean(axis=1) / max(float(veil_means(pane).mean()), 1e-20)
        clear = pane.clear.ravel()
        for rays in _rays_to(stage, number, points, normals, samples, key):
            lit, covered = np.flatnonzero(clear[rays.cell] > 0), np.flatnonzero(veil[rays.cell] > 0)
            # Glass lets through less at an angle; its colour hardly changes with it, and is multiplied later.
            dimmed = pane.through(rays.direction[lit]).mean(axis=1) / max(float(np.mean(pane.transmittance)), 1e-9)
            weight = rays.weight[lit] * clear[rays.cell[lit]] * dimmed
            parts.append((rays.point[lit], sky_cell(rays.direction[lit]), np.full(len(lit), number, np.uint16), weight))
            cell = np.full(len(covered), SKY_CELLS + number, np.uint16)
            weight = rays.weight[covered] * veil[rays.cell[covered]]
            parts.append((rays.point[covered], cell, np.full(len(covered), len(panes), np.uint16), weight))
    point, cell, tint, weight = (np.concatenate(column) for column in zip(*parts, strict=True))
    rank = np.argsort(point, kind="stable")
    first = np.searchsorted(point[rank], np.arange(len(normals) + 1)).astype(np.int64)
    return SkyRays(first, cell[rank].astype(np.uint16), tint[rank].astype(np.uint16), weight[rank].astype(np.float32))


def sky_cell(rays: Floats) -> UInt16s:
    """Return the sky's cell (N,) in the direction of rays (N, 3), unit."""
    column = ((np.arctan2(rays[:, 0], rays[:, 1]) / (2 * np.pi) + 0.5) * 2 * SKY_ROWS).astype(np.int64) % (2 * SKY_ROWS)
    row = ((0.5 - np.arcsin(np.clip(rays[:, 2], -1, 1)) / np.pi) * SKY_ROWS).astype(np.int64).clip(0, SKY_ROWS - 1)
    return (row * 2 * SKY_ROWS + column).astype(np.uint16)


def veil_means(pane: Pane) -> Doubles:
    """Return the mean radiance (shape (3,), cd/m2) of what covers a pane."""
    mean: Doubles = pane.veil_cd_m2.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    return mean


def sky_values(outdoors: Outdoors, panes: tuple[Pane, ...]) -> Floats:
    """Return the radiance of the sky's cells and then of what covers each pane: (C, 3) cd/m2."""
    rgb = outdoors.rgb
    if rgb.shape[0] != SKY_ROWS:
        source = Equirectangular(rgb.shape[1], rgb.shape[0])
        rgb, _ = resample(np.ascontiguousarray(rgb), source, Equirectangular(2 * SKY_ROWS, SKY_ROWS))
    return np.concatenate([rgb.reshape(-1, 3), *(veil_means(pane)[None] for pane in panes)]).astype(np.float32)


@compiled
def add_sky(rays, colours, values, out, apart):  # type: ignore[no-untyped-def]
    """Add the light of stored `SkyRays` to irradiance ``out`` (N, 3), lx.

    ``colours`` (panes + 1, 3): transmittance; ``values`` (C, 3): radiance of the sky's cells (`sky_values`). To
    ``apart`` (N,) goes half the difference in green between the estimates of the odd and of the even rays.
    """
    for i in range(out.shape[0]):
        r = g = b = odd = 0.0
        for k in range(rays.first[i], rays.first[i + 1]):
            c, t, w = rays.cell[k], rays.tint[k], rays.weight[k]
            r += w * colours[t, 0] * values[c, 0]
            light = w * colours[t, 1] * values[c, 1]
            g += light
            b += w * colours[t, 2] * values[c, 2]
            odd += light if k & 1 else -light
        out[i, 0] += r
        out[i, 1] += g
        out[i, 2] += b
        apart[i] += odd
