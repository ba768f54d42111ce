"""The slow part of a texture: light falling across a plane, fitted to what is known and continued through holes.

In tones (logarithms of light) light and pattern add up. Two sources give the light: pixels one lattice step apart,
whose difference holds no pattern (pairwise), and the tones themselves, where the pattern's contrast is low (smooth).
Both go into one robust least-squares fit of a coarse grid of values that bends little.
"""

import math
from dataclasses import dataclass
from typing import Any, Self

import cv2
import numpy as np
from scipy.sparse import csr_array

from processing.ground.arrays import Doubles, Flags, Floats, Indices, Int16s, bands
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.ground.kernels import compiled
from processing.pictures.images import luminance_cd_m2

# Wide Gaussian blurs at a cost that does not grow with their width.

NARROW_PX = 4.0  # standard deviation up to which the blur is exact; wider ones run on a smaller picture
SWEEPS, LAST_SWEEPS = 6, 2  # at each size of the pyramid, at the full one; chosen (four more: 1 % of texels by 1e-4)
CELLS = 7  # of the grid along the longer side
SAMPLES = 6000  # of a fit; chosen, never swept
ROUNDS = 5  # of reweighting; chosen, never swept
BRIGHT = 1.0  # exponent: brighter pairs count more; chosen, never swept
LEAST_SHARE = 0.3  # of a window that is known; chosen, never swept
SLOPE = 0.7  # of the resistance to slopes against that to bends: what the pattern may explain is not light


def blurred(picture: Floats, sigma_px: float) -> Floats:
    """Return a picture of shape (H, W[, C]) blurred by a Gaussian; wide ones to within some percent of its range."""
    if sigma_px <= NARROW_PX:
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px).reshape(picture.shape), np.float32)
    factor = NARROW_PX / 1.6 / sigma_px
    size = tuple(max(1, round(n * factor)) for n in picture.shape[1::-1])
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    scale = (size[0] / picture.shape[1], size[1] / picture.shape[0])
    small = cv2.GaussianBlur(small, (0, 0), sigmaX=max(sigma_px * scale[0], 0.3), sigmaY=max(sigma_px * scale[1], 0.3))
    wide = cv2.resize(small, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide.reshape(picture.shape), np.float32)


def known_mean(values: Floats, known: Flags, sigma_px: float) -> tuple[Floats, Floats]:
    """Return the local mean (H, W[, C]) of the known values, and the share (H, W) of the neighbourhood that is known.

    ``values`` (H, W[, C]) count where ``known`` (H, W), weighted by a Gaussian (normalised convolution).
    """
    share = blurred(known.astype(np.float32), sigma_px)
    total = blurred(np.where(_as(known, values), values, 0).astype(np.float32), sigma_px)
    return np.asarray(total / np.maximum(_as(share, values), 1e-6), np.float32), share


# Tones: the logarithm of light, in which illumination and reflectance add up and every error is a relative one.

TOE = 0.03  # of the median luminance: what is added before the logarithm, so that noise near black stays small
TONE_WEIGHTS = np.array(LUMINANCE_WEIGHTS, np.float32)


@dataclass(frozen=True)
class ToneScale:
    """The light added before the logarithm, in the picture's unit."""

    toe: float

    @classmethod
    def of(cls, rgb: Floats, known: Flags) -> Self:
        """Return the scale that suits the known pixels of (H, W, 3); 1e-6 where nothing is known or all is black."""
        seen = luminance_cd_m2(rgb[known]) if known.any() else np.zeros(1, np.float32)
        return cls(max(TOE * float(np.median(seen)), 1e-6))

    def tone(self, rgb: Floats) -> Floats:
        """Return log(rgb + toe), for ``rgb`` (..., 3) of any shape."""
        return np.asarray(np.log(np.maximum(rgb, 0) + np.float32(self.toe)), np.float32)

    def light(self, tone: Floats) -> Floats:
        """Return the light of tones of any shape; never negative."""
        return np.asarray(np.maximum(np.exp(np.minimum(tone, 80.0)) - np.float32(self.toe), 0), np.float32)


def grey(tone: Floats) -> Floats:
    """Return (H, W): the tone's weighted mean over the channels."""
    return np.asarray(tone @ TONE_WEIGHTS, np.float32)


def spread(values: Floats, given: Flags) -> Floats:
    """Return ``values``, of shape (H, W[, C]), where ``given`` (H, W), elsewhere their membrane; 0 without any."""
    if not given.any():
        return np.zeros_like(values)
    picture = np.where(given if values.ndim == 2 else given[..., None], values, 0).astype(np.float32)
    return _level(picture, given.astype(np.float32), LAST_SWEEPS)


def _level(values: Floats, share: Floats, sweeps: int = SWEEPS) -> Floats:
    """Return the membrane; ``share`` (H, W) is how much of each pixel is given, by which ``values`` are multiplied."""
    fixed = share > 0
    own = values / _as(np.maximum(share, 1e-12), values)
    if fixed.all() or min(share.shape) < 2:
        mean = values.reshape(-1, *values.shape[2:]).sum(axis=0) / max(float(share.sum()), 1e-12)
        return np.asarray(np.where(_as(fixed, values), own, mean), np.float32)
    height, width = share.shape
    small = (max(1, (width + 1) // 2), max(1, (height + 1) // 2))
    even = (0, height % 2, 0, width % 2)
    coarse = _level(_halved(values, even, small), _halved(share, even, small))
    up = cv2.resize(coarse, (small[0] * 2, small[1] * 2), interpolation=cv2.INTER_LINEAR)
    up = up.reshape(small[1] * 2, small[0] * 2, *values.shape[2:])[:height, :width]
    out = np.asarray(np.where(_as(fixed, values), own, up), np.float32)
    both = [out.reshape(height, -1), np.array(out.reshape(height, -1))]
    free, rows = np.repeat(~fixed, both[0].shape[1] // width, axis=1), np.flatnonzero(~fixed.all(axis=1))
    for _ in range(sweeps):
        _sweep(free, rows, both[0].shape[1] // width, *both)
        both.reverse()
    return both[0].reshape(values.shape)


@compiled
def _sweep(free: Any, rows: Any, step: int, old: Any, new: Any) -> None:
    """Fill ``new`` (H, W) where it is ``free``, in ``rows`` alone, with means of four neighbours in ``old``: those of a
    row lie ``step`` apart, its channels."""
    height, width = old.shape
    for i in rows:
        up, row, down = old[max(i - 1, 0)], old[i], old[min(i + 1, height - 1)]
        mine, todo = new[i], free[i]
        for k in range(step, width - step):
            mean = (up[k] + row[k - step] + row[k + step] + down[k]) * np.float32(0.25)
            mine[k] = mean if todo[k] else mine[k]
        for k in range(step):
            last = width - step + k
            if todo[k]:
                mine[k] = (up[k] + row[k] + row[k + step] + down[k]) * np.float32(0.25)
            if todo[last]:
                mine[last] = (up[last] + row[last - step] + row[last] + down[last]) * np.float32(0.25)


def _halved(picture: Floats, even: tuple[int, int, int, int], size: tuple[int, int]) -> Floats:
    """Return the means of squares of four; what ``even`` adds at the lower and right edge counts as not given."""
    padded = cv2.copyMakeBorder(picture, *even, cv2.BORDER_CONSTANT, value=0)
    small = cv2.resize(padded, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small.reshape(size[1], size[0], *picture.shape[2:]), np.float32)


def _as(flat: Floats | Flags, like: Floats) -> Floats:
    return np.asarray(flat if like.ndim == 2 else flat[..., None])


@dataclass(frozen=True)
class _Grid:
    """Bilinear values on nodes; ``step_px`` apart."""

    rows: int
    columns: int
    step_px: float

    @classmethod
    def over(cls, shape: tuple[int, int]) -> Self:
        step = max(max(shape) / CELLS, 2.0)
        return cls(int(np.ceil(shape[0] / step)) + 1, int(np.ceil(shape[1] / step)) + 1, step)

    def rows_at(self, y: Indices, x: Indices) -> Doubles:
        """Return the dense design matrix (N, NODES)."""
        v, u = y / self.step_px, x / self.step_px
        i, j = np.minimum(v.astype(np.intp), self.rows - 2), np.minimum(u.astype(np.intp), self.columns - 2)
        fv, fu = v - i, u - j
        design = np.zeros((len(y), self.rows * self.columns))
        n = np.arange(len(y))
        for di, dj, w in ((0, 0, (1 - fv) * (1 - fu)), (0, 1, (1 - fv) * fu), (1, 0, fv * (1 - fu)), (1, 1, fv * fu)):
            design[n, (i + di) * self.columns + j + dj] += w
        return design

    def bending(self) -> Doubles:
        """Return (K, NODES): the rows of all second differences of the nodes, and of slopes and twists."""
        index = np.arange(self.rows * self.columns).reshape(self.rows, self.columns)
        stencils = (
            ((1, -2, 1), (index[:-2], index[1:-1], index[2:])),
            ((1, -2, 1), (index[:, :-2], index[:, 1:-1], index[:, 2:])),
            ((-SLOPE, SLOPE), (index[:-1], index[1:])),
            ((-SLOPE, SLOPE), (index[:, :-1], index[:, 1:])),
            ((1.4, -1.4, -1.4, 1.4), (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:])),
        )
        found = [np.zeros((nodes[0].size, index.size)) for _, nodes in stencils]
        for rows, (weights, nodes) in zip(found, stencils, strict=True):
            for weight, node in zip(weights, nodes, strict=True):
                rows[np.arange(len(rows)), node.ravel()] = weight
        return np.concatenate(found)

    def image(self, nodes: Doubles, shape: tuple[int, int]) -> Floats:
        """Return the values (H, W, C) of all pixels, smoothly between the nodes."""
        y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
        grid = nodes.reshape(self.rows, self.columns, -1).astype(np.float32)
        at = (x / np.float32(self.step_px), y / np.float32(self.step_px))
        out = cv2.remap(grid, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return blurred(np.asarray(out.reshape(*shape, -1), np.float32), 0.35 * self.step_px)


def fit_illumination(tone: Floats, known: Flags, hole: Flags, steps_px: Doubles | None, *, bend: float = 1.0) -> Floats:
    """Return (h, w, 3): the slow part of the tone, mean 0 over the known pixels, continued through the hole.

    ``tone`` (H, W, 3): natural logarithm of light; only what is ``known`` (H, W) counts.
    ``hole`` (H, W): there the light is clamped to the range that it has around.
    ``steps_px`` (2, 2): the lattice's two steps (dx, dy), if the pattern has a lattice: pixels one step apart then give
      the light and the tones themselves only its mean. None: the tones give all.
    ``bend``: resistance to bending, relative to the usual one.
    """
    if not known.any():
        return np.zeros(tone.shape, np.float32)
    shape, rng = tone.shape[:2], np.random.default_rng(5)
    grid = _Grid.over(shape)
    # Design and target of single pixels, averaged over a neighbourhood as wide as a lattice cell
    cell = 0.0 if steps_px is None else float(np.sqrt(abs(np.linalg.det(steps_px))))
    sigma = max(0.02 * max(tone.shape[:2]), 0.4 * cell, 1.0)
    y, x = _sample(known, rng, SAMPLES // 2)
    design, target = grid.rows_at(y, x), known_mean(tone, known, sigma)[0][y, x].astype(np.float64)
    unary = len(design)
    if steps_px is not None:
        pair_design, pair_target, pair_base = _pairs(grid, tone, known, steps_px, rng)
        design, target = np.concatenate([design, pair_design]), np.concatenate([target, pair_target])
    base = np.ones(len(design))
    if len(design) > unary:
        base[:unary], base[unary:] = 0.02, pair_base
    slow: Floats = grid.image(_robust(design, target, base, grid.bending(), bend), shape)
    slow = slow - slow[known].mean(axis=0)
    # The light with the hole's values kept within the range of the known ones near the hole
    if not hole.any():
        return slow
    near = cv2.dilate(hole.astype(np.uint8), np.ones((15, 15), np.uint8)).astype(bool) & known
    if not near.any():
        near = known
    low, high = slow[near].min(axis=0), slow[near].max(axis=0)
    return np.asarray(np.where(hole[..., None], np.clip(slow, low, high), slow), np.float32)


def local_light(rest: Floats, known: Flags, sigma_px: float) -> Floats:
    """Return (H, W, C): what slow part a fit left, at the scale of ``sigma_px``, and its membrane through holes.

    For surfaces without a lattice, whose pattern nothing separates from light: glow and soft shadows meet at the rim.
    """
    mean, share = known_mean(rest, known, sigma_px)
    return spread(mean, known & (share > LEAST_SHARE))


def _pairs(
    grid: _Grid, tone: Floats, known: Flags, steps_px: Doubles, rng: np.random.Generator
) -> tuple[Doubles, Doubles, Doubles]:
    """Return design, target and weight of differences between pixels one lattice step apart.

    Brighter pixels weigh more: what little light dark ones give off is glints and what lies behind them."""
    smooth, _ = known_mean(tone, known, 1.5)
    bright = grey(smooth) - float(np.median(grey(smooth)[known]))
    designs, targets, weights = [], [], []
    a, b = steps_px
    for step in (a, b, a + b, a - b, 2 * a, 2 * b):
        dx, dy = (round(float(v)) for v in step)
        both = _both_known(known, dx, dy)
        if both.sum() < 20:
            continue
        y, x = _sample(both, rng, SAMPLES // 4)
        designs.append(grid.rows_at(y + dy, x + dx) - grid.rows_at(y, x))
        targets.append((smooth[y + dy, x + dx] - smooth[y, x]).astype(np.float64))
        weights.append(np.exp(BRIGHT * np.clip(np.minimum(bright[y, x], bright[y + dy, x + dx]), -3, 1)))
    if not designs:
        return np.zeros((0, grid.rows * grid.columns)), np.zeros((0, tone.shape[2])), np.zeros(0)
    return np.concatenate(designs), np.concatenate(targets), np.concatenate(weights).astype(np.float64)


def _both_known(known: Flags, dx: int, dy: int) -> Flags:
    """Return where a pixel and the one (dx, dy) further are known."""
    height, width = known.shape
    both = np.zeros_like(known)
    if abs(dx) >= width or abs(dy) >= height:
        return both
    rows, columns = slice(max(0, -dy), min(height, height - dy)), slice(max(0, -dx), min(width, width - dx))
    there = known[rows.start + dy : rows.stop + dy, columns.start + dx : columns.stop + dx]
    both[rows, columns] = known[rows, columns] & there
    return both


def _sample(among: Flags, rng: np.random.Generator, count: int) -> tuple[Indices, Indices]:
    y, x = np.nonzero(among)
    if len(y) > count:
        chosen = rng.choice(len(y), count, replace=False)
        y, x = y[chosen], x[chosen]
    return y, x


def _robust(design: Doubles, target: Doubles, base: Doubles, bending: Doubles, bend: float) -> Doubles:
    """Return the nodes (n, c) by iteratively reweighted least squares (Huber on the grey residual)."""
    # In proportion to the data, so that the stiffness does not depend on the number of samples.
    stiff = bending.T @ bending * (bend * 0.02 * base.sum()) + 1e-6 * base.sum() * np.eye(design.shape[1])
    weight, sparse = base, csr_array(design)  # a row has at most eight nodes
    nodes = np.zeros((design.shape[1], target.shape[1]))
    for _ in range(ROUNDS):
        weighted = csr_array(sparse.multiply(weight[:, None]))
        nodes = np.linalg.solve((sparse.T @ weighted).toarray() + stiff, weighted.T @ target)
        off = np.abs(grey((target - sparse @ nodes).astype(np.float32)))
        scale = max(1.5 * float(np.median(off)), 1e-4)
        weight = base / np.maximum(off / scale, 1.0)
    return nodes


RIM_RAD, MOST_RIM = math.radians(1.5), (0.35, 0.2)
"""On which the last step at a filling's rim runs out; tone and colour by which both sides may differ there, else what
is seen is another thing (chosen by looking at eight real rooms)."""
TONE_END = np.float32(1e-6)  # below which there is no tone
RIM_ROWS = 1024  # from twice as many rows on it is worked out in a smaller picture (chosen: its reach is then 8 pixels)


def _rim_steps(rgb: Floats, filled: Flags, planes: Int16s) -> tuple[Indices, Indices, Doubles, Doubles]:
    """Return row and column (K,) of what is filled at a rim; in tones (K, 3) the sum by which the neighbours that are
    seen are brighter; and how many these are (K,)."""
    high, wide = filled.shape
    edge = filled & (cv2.erode(filled.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    edge[:, [0, -1]] |= filled[:, [0, -1]]  # whose neighbours are across the seam
    row, column = np.nonzero(edge)
    tone, step, count = np.log(np.maximum(rgb[row, column], TONE_END)), np.zeros((len(row), 3)), np.zeros(len(row))
    for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        beside = np.clip(row + down, 0, high - 1), (column + right) % wide
        off = np.log(np.maximum(rgb[beside], TONE_END)) - tone
        colour, alike = np.abs(off - grey(off)[:, None]).max(axis=1), planes[beside] == planes[row, column]
        fit = ~filled[beside] & alike & (np.abs(grey(off)) < MOST_RIM[0]) & (colour < MOST_RIM[1])
        step[fit] += off[fit]
        count[fit] += 1
    return row, column, step, count


def meet_rims(rgb: Floats, filled: Flags, planes: Int16s) -> None:
    """Bring what is ``filled`` (H, W) of a panorama (H, W, 3), in place, to the tone of what is seen beside it.

    Textures meet at their rims in the mean of some texels; where light falls off steeply there, or shade was lifted, a
    hair line remains between one pixel and the next. Only pixels of one of ``planes`` (H, W) are compared.
    """
    (high, wide), (row, column, step, count) = filled.shape, _rim_steps(rgb, filled, planes)
    if not count.any():
        return
    # What runs out over tens of pixels is worked out in a smaller picture.
    shrink, reach_px = max(1, high // RIM_ROWS), RIM_RAD / math.pi * high
    shape = -(-high // shrink), -(-wide // shrink)
    cell = np.ravel_multi_index((row // shrink, column // shrink), shape)
    total = np.bincount(cell, count, math.prod(shape))
    mean = np.stack([np.bincount(cell, part, len(total)) for part in step.T], axis=-1) / np.maximum(total, 1)[:, None]
    rim: Flags = (total > 0).reshape(shape)
    away = cv2.distanceTransform((~rim).astype(np.uint8), cv2.DIST_L2, 5) * np.float32(shrink / reach_px)
    more = (
        known_mean(mean.reshape(*shape, 3).astype(np.float32), rim, reach_px / 2 / shrink)[0] * np.exp(-away)[..., None]
    )
    x = ((np.arange(wide, dtype=np.float32) + 0.5) / shrink - 0.5)[None]
    for rows in bands(high, RIM_ROWS // 4):
        own = filled[rows]
        y = ((np.arange(rows.start, rows.stop, dtype=np.float32) + 0.5) / shrink - 0.5)[:, None]
        x_map, y_map = (np.ascontiguousarray(one) for one in np.broadcast_arrays(x, y))
        part = cv2.remap(more, x_map, y_map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        rgb[rows][own] *= np.exp(part[own])
