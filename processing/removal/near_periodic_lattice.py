"""The lattice of a near-periodic texture: two shifts that bring it onto itself, found from its self-correlation."""

from __future__ import annotations

from processing.ground.arrays import Doubles, Indices

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processing.removal.near_periodic_correlation import SelfCorrelation


LATTICE_NCC = 0.52
"""Mean NCC at the eight nearest nodes from which there is a lattice: true patterns have 0.59 to 0.96, carpet and
laminate 0.05 to 0.14 (measured), a real carpet with patches of sun 0.45."""
PEAK_NCC = 0.13
"""At a node from which its place counts when the lattice is refined."""
CANDIDATES = 48
LONGEST = 0.45
"""Of a step against the texture's size: a pattern must be seen to repeat."""
ORIENTED_NCC = 0.52
"""The same, of which way the grain runs: herringbone has 0.71 to 0.75, planks, laminate and carpet none (measured)."""
NODE_REACH = 5


@dataclass(frozen=True)
class Lattice:
    """Shifts (x, y) in pixels that bring the pattern onto itself."""

    a_px: Doubles
    b_px: Doubles
    strength: float
    """Mean NCC at the eight nodes nearest to zero."""

    def nodes(self, reach: int) -> Doubles:
        """Return (n, 2): all combinations of up to ``reach`` of both vectors but zero."""
        i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1), indexing="ij")
        keep = (i != 0) | (j != 0)
        return np.asarray(i[keep][:, None] * self.a_px + j[keep][:, None] * self.b_px)


def peaks(correlation: SelfCorrelation, *, least: float = 0.15, count: int = CANDIDATES) -> tuple[Doubles, Doubles]:
    """Return shifts (n, 2) of local maxima with dy > 0, or dy = 0 < dx, strongest first, and their NCC."""
    ncc = np.nan_to_num(correlation.ncc, nan=-1.0).astype(np.float32)
    reach = 7
    local = cv2.dilate(ncc, np.ones((reach, reach), np.uint8))
    cy, cx = correlation.centre
    y, x = np.nonzero((ncc >= local) & (ncc > least))
    dy, dx = y - cy, x - cx
    half = ((dy > 0) | ((dy == 0) & (dx > 0))) & (np.hypot(dx, dy) > 4)
    dx, dy, y, x = dx[half], dy[half], y[half], x[half]
    value = ncc[y, x].astype(np.float64)
    prominence = value - _valley(ncc, correlation.centre, dx, dy)
    order = np.argsort(-(value + 0.5 * prominence))[:count]
    return np.stack([dx, dy], axis=-1)[order].astype(np.float64), value[order]


def _valley(ncc: npt.NDArray[np.float32], centre: tuple[int, int], dx: Indices, dy: Indices) -> Doubles:
    """Return the least NCC on the way from zero to each shift: a true period climbs out of a valley."""
    t = np.linspace(0.1, 0.9, 33)
    x = np.clip(np.rint(centre[1] + dx[:, None] * t).astype(np.intp), 0, ncc.shape[1] - 1)
    y = np.clip(np.rint(centre[0] + dy[:, None] * t).astype(np.intp), 0, ncc.shape[0] - 1)
    return np.asarray(ncc[y, x].min(axis=1), np.float64)


def find_lattice(correlation: SelfCorrelation, least: float = LATTICE_NCC) -> Lattice | None:
    """Return the lattice whose nodes explain the correlation best, or None where the best is below ``least``."""
    shifts, values = peaks(correlation)
    if len(shifts) < 2:
        return None
    first, second = np.triu_indices(len(shifts), 1)
    a, b = shifts[first], shifts[second]
    cross = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    wide = cross > 0.2 * np.hypot(*a.T) * np.hypot(*b.T)
    limit = LONGEST * np.array([4 / 3 * correlation.centre[1], 4 / 3 * correlation.centre[0]])
    wide &= (np.abs(a) < limit).all(axis=1) & (np.abs(b) < limit).all(axis=1)
    a, b = a[wide], b[wide]
    if not len(a):
        return None
    score = _scores(correlation, a, b, 0.6 * float(values[0]))
    for best in np.argsort(-score)[:4]:
        lattice = _measured(correlation, *_refined(correlation, *reduced(a[best], b[best])))
        if lattice is not None and lattice.strength >= least:
            return lattice
    return None


def _scores(correlation: SelfCorrelation, a: Doubles, b: Doubles, bar: float) -> Doubles:
    """Return, per pair, the NCC above ``bar`` summed over its nodes: sparse lattices have few, wrong ones have low."""
    grid = np.arange(-NODE_REACH, NODE_REACH + 1)
    i, j = (g.ravel() for g in np.meshgrid(grid, grid))
    half = (j > 0) | ((j == 0) & (i > 0))
    nodes = i[half][None, :, None] * a[:, None, :] + j[half][None, :, None] * b[:, None, :]
    ncc = correlation.at(nodes)
    # Far nodes are measured from fewer pixels, and drift off a basis that is rounded to whole pixels.
    distance = np.asarray(np.hypot(nodes[..., 0], nodes[..., 1]), np.float64)
    weight = 1.0 / (1.0 + distance / max(correlation.centre))
    return np.asarray(np.nansum((ncc - bar) * weight, axis=1))


def reduced(a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """Return the shortest basis of the same lattice (Gauss reduction)."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    for _ in range(64):
        if a @ a > b @ b:
            a, b = b, a
        step = np.rint(float(a @ b) / max(float(a @ a), 1e-12))
        if step == 0:
            break
        b = b - step * a
    return a, b


def _refined(correlation: SelfCorrelation, a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """Return the basis fitted by least squares to the peaks next to its nodes, from the nearest nodes outwards."""
    basis = np.stack([a, b])
    for reach in (1, 2, 3, 4):
        grid = np.arange(-reach, reach + 1)
        combos = np.stack([g.ravel() for g in np.meshgrid(grid, grid)], axis=-1)
        combos = combos[(combos[:, 1] > 0) | ((combos[:, 1] == 0) & (combos[:, 0] > 0))]
        found = [peak_near(correlation, combo @ basis) for combo in combos]
        ok = np.array([f is not None and f[1] > PEAK_NCC for f in found])
        if ok.sum() < 2 or np.linalg.matrix_rank(combos[ok]) < 2:
            continue
        places = np.array([f[0] for f, use in zip(found, ok, strict=True) if use and f is not None])
        weight = np.sqrt([f[1] for f, use in zip(found, ok, strict=True) if use and f is not None])[:, None]
        basis = np.linalg.lstsq(combos[ok] * weight, places * weight, rcond=None)[0]
    return basis[0], basis[1]


def peak_near(correlation: SelfCorrelation, shift: Doubles, radius: int = 3) -> tuple[Doubles, float] | None:
    """Return the sub-pixel maximum of the NCC within some pixels of a shift and its value; None where unknown."""
    x, y = (round(float(v)) for v in (shift[0] + correlation.centre[1], shift[1] + correlation.centre[0]))
    height, width = correlation.ncc.shape
    if not (radius < x < width - radius - 1 and radius < y < height - radius - 1):
        return None
    window = correlation.ncc[y - radius : y + radius + 1, x - radius : x + radius + 1]
    if not np.isfinite(window).all():
        return None
    i, j = (int(v) for v in np.unravel_index(int(np.argmax(window)), window.shape))
    n = correlation.ncc[y - radius + i - 1 : y - radius + i + 2, x - radius + j - 1 : x - radius + j + 2]
    if not np.isfinite(n).all():
        return None
    fine = np.array([_vertex(n[1, 0], n[1, 1], n[1, 2]), _vertex(n[0, 1], n[1, 1], n[2, 1])])
    place = np.array([x - radius + j - correlation.centre[1], y - radius + i - correlation.centre[0]]) + fine
    return place, float(n[1, 1])


def _vertex(left: float, middle: float, right: float) -> float:
    """Return where a parabola through three neighbours has its top, within half a step."""
    bend = left - 2 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < -1e-12 else 0.0


def _measured(correlation: SelfCorrelation, a: Doubles, b: Doubles) -> Lattice | None:
    a, b = reduced(a, b)
    lattice = Lattice(a, b, 0.0)
    nodes = lattice.nodes(1)
    values = [peak[1] for node in nodes if (peak := peak_near(correlation, node, 2)) is not None]
    if len(values) < 4:
        return None
    return Lattice(a, b, float(np.mean(values)))
