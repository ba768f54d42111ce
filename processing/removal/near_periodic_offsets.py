"""Shifts from which a hole may be filled: lattice nodes, steps along planks, or wherever a texture is like itself."""

from __future__ import annotations

from processing.ground.arrays import Doubles, Flags, Floats

from dataclasses import dataclass

import cv2
import numpy as np

from processing.removal.near_periodic_correlation import SelfCorrelation
from processing.removal.near_periodic_lattice import Lattice

MOST = 64
"""Offsets that are tried."""
LINE_SHARE = 0.6
"""Of the grain that must run one way."""


@dataclass(frozen=True)
class Line:
    """A direction along which a texture resembles itself: that of planks."""

    direction: Doubles
    """(2,), unit."""
    strength: float
    """0..1: how much of the grain runs that way."""


def lattice_offsets(lattice: Lattice, known: Flags, hole: Flags) -> Doubles:
    """Return the nodes that reach known pixels, nearest first: what is near has like light and like wear."""
    height, width = known.shape
    basis = np.stack([lattice.a_px, lattice.b_px])
    reach = min(40, int(np.ceil(1.1 * np.hypot(height, width) / max(np.linalg.norm(basis, axis=1).min(), 1.0))))
    nodes = lattice.nodes(reach)
    nodes = nodes[(np.abs(nodes[:, 0]) < 0.9 * width) & (np.abs(nodes[:, 1]) < 0.9 * height)]
    nodes = nodes[np.argsort(np.hypot(*nodes.T))]
    if len(nodes) <= MOST:
        return np.asarray(nodes, np.float64)
    # Far nodes matter only for what near ones cannot reach: keep the near half, thin out the rest evenly.
    far = nodes[MOST // 2 :]
    return np.concatenate([nodes[: MOST // 2], far[np.linspace(0, len(far) - 1, MOST // 2).astype(np.intp)]])


def find_line(field: Floats, known: Flags) -> Line | None:
    """Return the direction in which nearly all grain runs, of a field as `oriented` gives it, or None."""
    if not known.any():
        return None
    # Edges lie across the gradient, hence the sign.
    cosine, sine = (-field[known]).mean(axis=0)
    strength = float(np.hypot(cosine, sine)) / max(float(np.hypot(*field[known].T).mean()), 1e-9)
    if strength < LINE_SHARE:
        return None
    half = 0.5 * np.arctan2(sine, cosine)
    return Line(np.array([np.cos(half), np.sin(half)]), strength)


def line_offsets(line: Line, correlation: SelfCorrelation) -> Doubles:
    """Return shifts along the line, both ways, and those of highest NCC whatever their direction."""
    rng = np.random.default_rng(3)
    reach = 0.95 * max(correlation.centre)
    along = np.linspace(0.08, 1, MOST // 3) * reach
    along = along * (1 + 0.1 * rng.uniform(-1, 1, along.size))
    straight = along[:, None] * line.direction
    loose = loose_offsets(correlation, MOST // 3)
    return np.concatenate([straight, -straight, loose])


def loose_offsets(correlation: SelfCorrelation, count: int = MOST) -> Doubles:
    """Return the shifts with the highest NCC that are not next to each other, near and far ones alike."""
    ncc = np.nan_to_num(correlation.ncc, nan=-1.0).astype(np.float32)
    cy, cx = correlation.centre
    y, x = np.mgrid[: ncc.shape[0], : ncc.shape[1]]
    away = np.hypot(x - cx, y - cy)
    spacing = max(3, round(0.03 * max(ncc.shape)))
    local = cv2.dilate(ncc, np.ones((2 * spacing + 1,) * 2, np.uint8))
    py, px = np.nonzero((ncc >= local) & (ncc > -1) & (away > 2 * spacing))
    ring = (away[py, px] / (0.25 * max(cy, cx))).astype(np.intp)
    # The best of each distance in turn, so that deep holes are reached too.
    order = np.argsort(-ncc[py, px], kind="stable")
    rank = np.empty(len(py), np.intp)
    for one in range(int(ring.max()) + 1 if len(ring) else 0):
        inside = order[ring[order] == one]
        rank[inside] = np.arange(len(inside))
    chosen = np.argsort(rank, kind="stable")[:count]
    found = np.stack([px[chosen] - cx, py[chosen] - cy], axis=-1).astype(np.float64)
    return found if len(found) else np.array([[2.0 * spacing, 0.0], [-2.0 * spacing, 0.0]])
