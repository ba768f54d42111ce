"""The sun's direct light: shadow rays to its disc from places, from patches and from all that a picture sees.

Rays to the disc's rim find out whether a place lies in half shadow; only there rays go all over the disc. In a large
picture, what is lit and what is shaded are large areas: every few pixels one is looked at, and all within a block whose
four corners agree is as they are; only along the edges of light every pixel has shadow rays of its own."""

import math
from typing import NamedTuple

import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Indices, Int32s
from processing.ground.kernels import compiled, inner
from processing.light.scene.scene import Pane, Sun
from processing.light.solver.kernels import FIRST, PANE, SECOND, STEP_OFF_M, Key, random, towards_panes
from processing.light.solver.sight import Sight
from processing.light.solver.stage import Stage, in_parts

RIM_RAYS, RIM_AREA = 12, 0.98
"""Rays to the sun's rim (as a share of its area): if they agree, less than 2 % of the disc can look otherwise."""
BLOCK_RAD, MOST_STEP = 0.004, 8
"""Width of a block: 1 cm at 2.5 m, thinner than what shades a room; in pixels at most ``MOST_STEP``. Chosen."""
ALONG = 0.7  # of a row or a column, from which on what is covered runs along it
BAR_M = 0.12  # as wide as a bar in mid-window may be; what is wider and does not hang from its top is outdoors
DRAWN = 0.85  # of what is seen before the sky: covered as much, all of it is a drawn blind or curtain


def clear_of_sun(pane: Pane, eye_height_m: float) -> Floats:
    """Return which cells (H, W) of a pane let the sun in, 0 or 1; ``eye_height_m``: from where it was looked through.

    What stands at the glass runs along it: columns from top to bottom (frames, curtains), rows from side to side (bars,
    blinds). A tree, a house, a shadow on the lawn stand far away: another sun crosses the glass elsewhere. Below the
    horizon bars and bushes look alike: columns are found above it where there is sky. A pane of a single cell is left
    as it is: nothing is known of where its covering is."""
    if pane.clear.size == 1:
        return pane.clear
    covered = pane.clear < 0.5
    rows, columns = covered.shape
    high_m, wide_m = (float(np.linalg.norm(v)) for v in (pane.up_m, pane.across_m))
    height = pane.corner_m[2] + pane.up_m[2] * (1 - (np.arange(rows) + 0.5) / rows)
    sky = height > eye_height_m
    if sky.mean() < 0.2:
        sky = np.ones(rows, bool)
    if covered[sky].mean() >= DRAWN:
        return np.where(covered, np.float32(0), np.float32(1))
    upright = covered[sky].mean(axis=0) >= ALONG
    level = covered.mean(axis=1) >= ALONG
    hung = np.logical_and.accumulate(level)
    bars = _thin(level & ~hung, BAR_M * rows / max(high_m, 1e-9))
    curtains = np.logical_and.accumulate(upright) | np.logical_and.accumulate(upright[::-1])[::-1]
    posts = _thin(upright & ~curtains, 2 * BAR_M * columns / max(wide_m, 1e-9))
    shut = (hung | bars)[:, None] | (curtains | posts)[None, :]
    return np.where(shut, np.float32(0), np.float32(1))


RIM_M, RIM_LINES, RIM_PLACES = 0.3, 4, 3
"""Width of a rim at most: more is shade; lines of cells across it, and sunlit places of each, that it is found by at
least. Chosen."""


def sun_rim(pane: Pane, sun: Sun, points: Floats, shown: Flags) -> tuple[int, ...]:
    """Return how many cells along a pane's edges let no sun in, as `Pane.sun_rim` (4,), by its photographed patches.

    ``points`` (N, 3), m: places in sight that the sun would reach through the bare room's panes; ``shown`` (N,): which
    of them are sunlit. Casings are taken for glass and the depth of reveals is not known, so that a patch as the model
    has it began beside the photographed one."""
    direction, (rows, columns) = np.asarray(sun.direction, np.float64), pane.clear.shape
    ahead_m = (pane.corner_m - points) @ pane.normal / (direction @ pane.normal)
    u, v = pane.shares(points + ahead_m[:, None] * direction)
    mine, found = (ahead_m > 0) & (np.abs(u - 0.5) < 0.5) & (np.abs(v - 0.5) < 0.5), list[int]()
    lit, u, v = shown[mine], u[mine] * columns, v[mine] * rows
    for depth, along, count, side_m in ((u, v, columns, pane.across_m), (v, u, rows, pane.up_m)):
        line, most = np.floor(along), RIM_M * count / float(np.linalg.norm(side_m))
        for away in (depth, count - depth):
            starts = list[float]()
            for one in np.unique(line[lit]):
                first = np.sort(away[(line == one) & lit])[:RIM_PLACES]
                # Where no dark place is in sight before it, nobody knows where it begins.
                if len(first) == RIM_PLACES and (away[(line == one) & ~lit] < first[-1]).any():
                    starts.append(float(first[-1]))
            start = float(np.quantile(starts, 0.25)) if len(starts) >= RIM_LINES else 0.0
            found.append(round(start) if start <= most else 0)
    return tuple(found)


def within_rim(pane: Pane) -> Floats:
    """Return how much of each cell (H, W) of a pane the sun's beam passes, 0 to 1, and on its rim (`sun_rim`)."""
    (rows, columns), (first, last, top, bottom) = pane.clear.shape, pane.sun_rim
    inner = pane.clear_for_sun[top : rows - bottom, first : columns - last]
    return np.pad(inner, ((top, bottom), (first, last)))


def _thin(flags: Flags, most: float) -> Flags:
    """Return the runs of true values that are at most so long (at least one is always thin)."""
    out = np.zeros_like(flags)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start <= max(most, 1.0):
            out[start:end] = True
    return out


class _Glass(NamedTuple):
    """All panes, for compiled loops."""

    owner: Int32s
    """(M,), and ``item`` (M,): whose the scene's triangles are (`kernels.Ownership`)."""
    item: Int32s
    panes: Doubles
    """(P, 3, 3): corner, across / length^2, up / length^2."""
    sizes: Int32s
    """(P, 3): rows, columns and first cell of each in ``clear``."""
    tints: Doubles
    """(P, 3): transmittance in the sun's direction."""
    clear: Floats
    """(cells,): how much of each cell of all panes is clear."""


def _glass_of(stage: Stage, sun: Sun) -> _Glass:
    panes, towards = stage.scene.panes, np.asarray(sun.direction, np.float64)[None]
    frames = [(p.corner_m, p.across_m / (p.across_m @ p.across_m), p.up_m / (p.up_m @ p.up_m)) for p in panes]
    first = np.cumsum([0] + [p.clear.size for p in panes[:-1]])
    sizes = [(*p.clear.shape, start) for p, start in zip(panes, first, strict=True)]
    tints = [p.through(towards)[0] for p in panes]
    clear = np.concatenate([within_rim(p).ravel() for p in panes]).astype(np.float32)
    arrays = np.array(frames, np.float64), np.array(sizes, np.int32), np.array(tints, np.float64), clear
    return _Glass(stage.patches.owner, stage.patches.item, *arrays)


def may_see_sun(stage: Stage, sun: Sun, points: Floats, normals: Floats) -> Flags:
    """Return which places (N,) face the sun through a pane, were nothing else in the way.

    ``points`` (N, 3), m; ``normals`` (N, 3)."""
    near, panes = np.zeros(len(points), bool), stage.scene.panes
    direction = np.asarray(sun.direction, np.float64)
    facing: Flags = normals @ direction.astype(np.float32) > 0
    if panes and facing.any():
        corners = [np.array([getattr(p, name) for p in panes]) for name in ("corner_m", "across_m", "up_m")]
        towards_panes(points, direction, *corners, near)
    return near & facing


def sunlight(stage: Stage, points: Floats, normals: Floats, samples: int, key: Key) -> Doubles:
    """Return the sun's direct irradiance (N, 3), lx.

    ``points`` (N, K, 3), m: one place each (K = 1) with ``samples`` rays where it lies in half shadow, or K places,
    over which the mean is taken, with one ray each to a random place of the disc; ``normals`` (N, 3)."""
    out, sun = np.zeros((len(normals), 3)), stage.scene.outdoors.sun
    if sun is None:
        return out
    near = np.zeros(len(normals), bool)
    for k in range(points.shape[1]):
        rest = np.flatnonzero(~near)
        near[rest] = may_see_sun(stage, sun, points[rest, k], normals[rest])
    lit = np.flatnonzero(near)
    if not len(lit):
        return out
    shifts = random(key, len(normals), 2)[lit]
    if points.shape[1] == 1:
        tint, _ = sun_tint(stage, sun, points[lit, 0], normals[lit], samples, shifts)
    else:
        tint, _ = _tints(stage, sun, points[lit], normals[lit], shifts, points.shape[1], 0.0)
    cosine = normals[lit] @ np.asarray(sun.direction, np.float32)
    out[lit] = tint * cosine[:, None] * np.asarray(sun.normal_illuminance_lx)
    return out


def sun_tint(
    stage: Stage, sun: Sun, points: Floats, normals: Floats, samples: int, shifts: Doubles
) -> tuple[Floats, Flags]:
    """Return what share of the sun's disc reaches places through glass (N, 3), and which (N,) lie in half shadow.

    ``points`` (N, 3), m; ``normals`` (N, 3); ``shifts`` (N, 2) random in [0, 1). Rays to the rim first; where they
    differ, ``samples`` all over the disc."""
    places = points[:, None]
    tint, unsure = _tints(stage, sun, places, normals, shifts, RIM_RAYS, RIM_AREA)
    again = np.flatnonzero(unsure)
    if len(again):
        tint[again], _ = _tints(stage, sun, places[again], normals[again], shifts[again], samples, 0.0)
    return tint, unsure


def _tints(
    stage: Stage, sun: Sun, points: Floats, normals: Floats, shifts: Doubles, samples: int, rim_area: float
) -> tuple[Floats, Flags]:
    """Return the mean of what glass lets through of each point's rays (N, 3), and where (N,) those differ."""
    glass, frame = _glass_of(stage, sun), _disc_frame(sun)
    out, apart = np.empty((len(points), 3), np.float32), np.empty(len(points), np.bool_)
    for part in in_parts(len(points), samples):
        origins, rays = np.empty((2, len(points[part]), samples, 3), np.float32)
        _disc_rays(points[part], normals[part], shifts[part], frame, rim_area, origins, rays)
        hits = stage.tracer.cast(origins.reshape(-1, 3), rays.reshape(-1, 3))
        _disc_tints(glass, hits.triangle, hits.distance_m, origins, rays, out[part], apart[part])
    return out, apart


def _disc_frame(sun: Sun) -> Doubles:
    """Return the way to the sun's middle and two sides across it, as long as its radius at a distance of 1: (3, 3)."""
    axis = np.asarray(sun.direction, np.float64)
    side = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    return np.array([axis, *(np.tan(sun.radius_rad) * np.array([side, np.cross(axis, side)]))])


@compiled
def _disc_rays(points, normals, shifts, frame, rim_area, origins, directions):  # type: ignore[no-untyped-def]
    """Fill rays (N, S, 3) to the sun's disc: even over it, or with ``rim_area`` > 0 around that share of it.

    ``points`` (N, 1 or S, 3), m; ``frame`` (3, 3) of `_disc_frame`; ``shifts`` (N, 2) random in [0, 1)."""
    samples, several = directions.shape[1], points.shape[1] > 1
    for i in range(points.shape[0]):
        for s in range(samples):
            if rim_area > 0:
                u, v = rim_area, (shifts[i, 1] + s) / samples
            else:
                u = (shifts[i, 0] + (s + 0.5) * FIRST) % 1.0
                v = (shifts[i, 1] + (s + 0.5) * SECOND) % 1.0
            radius, angle = math.sqrt(u), 2 * math.pi * v
            p, q = radius * math.cos(angle), radius * math.sin(angle)
            x = frame[0, 0] + p * frame[1, 0] + q * frame[2, 0]
            y = frame[0, 1] + p * frame[1, 1] + q * frame[2, 1]
            z = frame[0, 2] + p * frame[1, 2] + q * frame[2, 2]
            length = math.sqrt(x * x + y * y + z * z)
            directions[i, s, 0], directions[i, s, 1], directions[i, s, 2] = x / length, y / length, z / length
            k = s if several else 0
            for c in range(3):
                origins[i, s, c] = points[i, k, c] + STEP_OFF_M * normals[i, c]


@compiled
def _disc_tints(glass, triangle, distance, origins, directions, out, apart):  # type: ignore[no-untyped-def]
    """Fill the mean of what glass lets through (N, 3) of each point's rays (N, S, 3), and whether (N,) they differ."""
    owner, item, panes, sizes = glass.owner, glass.item, glass.panes, glass.sizes
    tints, clear = glass.tints, glass.clear
    samples = directions.shape[1]
    for i in range(directions.shape[0]):
        low, high = 1e30, -1e30
        out[i, 0] = out[i, 1] = out[i, 2] = 0.0
        for s in range(samples):
            k = i * samples + s
            t = triangle[k]
            level = 0.0
            if t >= 0 and owner[t] == PANE:
                j = item[t]
                u = v = 0.0
                for c in range(3):
                    place = origins[i, s, c] + distance[k] * directions[i, s, c] - panes[j, 0, c]
                    u += place * panes[j, 1, c]
                    v += place * panes[j, 2, c]
                rows, columns = sizes[j, 0], sizes[j, 1]
                row = min(max(math.floor((1.0 - v) * rows), 0), rows - 1)
                column = min(max(math.floor(u * columns), 0), columns - 1)
                share = clear[sizes[j, 2] + row * columns + column]
                for c in range(3):
                    out[i, c] += share * tints[j, c]
                    level += share * tints[j, c]
            low, high = min(low, level), max(high, level)
        for c in range(3):
            out[i, c] /= samples
        apart[i] = high > 1.01 * low


def sun_of(
    stage: Stage, sight: Sight, samples: int, seed: int, among: Flags | None = None, block: int | None = None
) -> Floats:
    """Return the sun's direct irradiance (N, 3), lx, of what a picture's pixels see; 0 for those not ``among`` (N,).

    ``samples`` rays go to its disc from places in half shadow. ``block``: pixels a block; None: by the picture's size.
    """
    out = np.zeros((len(sight.label), 3), np.float32)
    sun = stage.scene.outdoors.sun
    if sun is None:
        return out
    chosen = sight.solid if among is None else sight.solid & among
    pixels = np.flatnonzero(chosen)
    pixels = pixels[may_see_sun(stage, sun, sight.point[pixels], sight.normal[pixels])]
    if not len(pixels):
        return out
    chosen = np.zeros(len(chosen), bool)
    chosen[pixels] = True
    step = _block_px(sight) if block is None else block
    tint = _picture_tint(stage, sun, sight, (samples, step), seed, chosen)
    cosine = sight.normal[pixels] @ np.asarray(sun.direction, np.float32)
    out[pixels] = tint[pixels] * cosine[:, None] * np.asarray(sun.normal_illuminance_lx, np.float32)
    return out


def _picture_tint(stage: Stage, sun: Sun, sight: Sight, effort: tuple[int, int], seed: int, chosen: Flags) -> Floats:
    """Return what of the sun's disc reaches each chosen pixel (N, 3); ``effort``: samples, pixels a block."""
    samples, step = effort
    tint = np.zeros((len(chosen), 3), np.float32)
    shifts = random((seed, 30), len(chosen), 2)

    def look(pixels: Indices) -> Flags:
        seen = sight.point[pixels], sight.normal[pixels]
        tint[pixels], unsure = sun_tint(stage, sun, *seen, samples, shifts[pixels])
        return unsure

    if step == 1:
        look(np.flatnonzero(chosen))
        return tint
    # First the corners of all blocks.
    high, wide = sight.shape
    rows, columns = np.arange(high), np.arange(wide)
    at = ((rows % step == 0) | (rows == high - 1))[:, None] & ((columns % step == 0) | (columns == wide - 1))
    corners = np.flatnonzero(at.ravel() & chosen)
    sure, todo = np.zeros(sight.shape, bool), np.zeros(sight.shape, bool)
    unsure = look(corners)
    sure.ravel()[corners[~unsure]] = True
    # Then blocks are filled from their corners where those agree; pixels of all others are looked at themselves.
    shaped = (sight.normal.reshape(high, wide, 3), sight.point.reshape(high, wide, 3), chosen.reshape(high, wide))
    _fill_blocks(step, sight.label.reshape(high, wide), *shaped, sure, tint.reshape(high, wide, 3), todo)
    todo.ravel()[corners] = False
    look(np.flatnonzero(todo))
    return tint


def _block_px(sight: Sight) -> int:
    """Return how many pixels wide blocks are."""
    high, wide = sight.shape
    if high < 2 or wide < 2:
        return 1
    return block_px(float(np.linalg.norm(sight.rays[wide].astype(np.float64) - sight.rays[0])))


def block_px(apart_rad: float) -> int:
    """Return how many pixels wide blocks are, of pixels so far apart."""
    return min(max(math.floor(BLOCK_RAD / max(apart_rad, 1e-9)), 1), MOST_STEP)


@compiled
def _fill_blocks(step, label, normals, points, chosen, sure, tint, todo):  # type: ignore[no-untyped-def]
    """Fill what lies within blocks of pixels whose four corners agree, and mark all else in ``todo``.

    A block counts only where all its pixels are ``chosen``, show one thing, and lie in one plane; ``sure`` (H, W) are
    corners of which ``tint`` (H, W, 3) is known. Blocks share their corners' rows and columns."""
    high, wide = label.shape
    for top in range(0, high, step):
        bottom = min(top + step, high - 1)
        for left in range(0, wide, step):
            right = min(left + step, wide - 1)
            alike = sure[top, left] and sure[top, right] and sure[bottom, left] and sure[bottom, right]
            if alike:
                for c in range(3):
                    value = tint[top, left, c]
                    slack = 1e-6 + 0.001 * value
                    alike = alike and abs(tint[top, right, c] - value) <= slack
                    alike = alike and abs(tint[bottom, left, c] - value) <= slack
                    alike = alike and abs(tint[bottom, right, c] - value) <= slack
            alike = alike and _one_plane(top, bottom, left, right, label, normals, points, chosen)
            for r in range(top, min(top + step, high)):
                for k in range(left, min(left + step, wide)):
                    if not chosen[r, k] or sure[r, k]:
                        continue
                    if alike:
                        for c in range(3):
                            tint[r, k, c] = tint[top, left, c]
                    else:
                        todo[r, k] = True


@inner
def _one_plane(top, bottom, left, right, label, normals, points, chosen):  # type: ignore[no-untyped-def]
    first = label[top, left]
    for r in range(top, bottom + 1):
        for k in range(left, right + 1):
            if label[r, k] != first or not chosen[r, k]:
                return False
            turned = lift = 0.0
            for c in range(3):
                turned += normals[top, left, c] * normals[r, k, c]
                lift += normals[top, left, c] * (points[r, k, c] - points[top, left, c])
            if turned < 0.99 or abs(lift) > 0.003:
                return False
    return True
