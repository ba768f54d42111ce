"""Shifts from which a hole may be filled: lattice nodes, steps along planks, or wherever the texture resembles itself."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from processing.removal.near_periodic_correlation import Doubles, Flags, SelfCorrelation
from processing.removal.near_periodic_lattice import LINE_NCC, Lattice

MOST = 64
"""Offsets that are tried."""
ANGLES = 90


@dataclass(frozen=True)
class Line:
    """A direction along which a texture resembles itself: that of planks."""

    direction: Doubles
    """(2,), unit."""
    strength: float
    """Mean NCC along it."""


def lattice_offsets(lattice: Lattice, known: Flags, hole: Flags) -> Doubles:
    """Return the nodes that reach known pixels, the nearest first: what is near has like light and like wear."""
    height, width = known.shape
    basis = np.stack([lattice.a_px, lattice.b_px])
    reach = min(40, int(np.ceil(1.1 * np.hypot(height, width) / max(np.linalg.norm(basis, axis=1).min(), 1.0))))
    nodes = lattice.nodes(reach)
    nodes = nodes[(np.abs(nodes[:, 0]) < 0.9 * width) & (np.abs(nodes[:, 1]) < 0.9 * height)]
    nodes = nodes[np.argsort(np.hypot(*nodes.T))]
    if len(nodes) <= MOST:
        return nodes
    # Far nodes matter only for what near ones cannot reach: keep the near half, thin out the rest evenly.
    far = nodes[MOST // 2 :]
    return np.concatenate([nodes[: MOST // 2], far[np.linspace(0, len(far) - 1, MOST // 2).astype(np.intp)]])


def find_line(correlation: SelfCorrelation) -> Line | None:
    """Return the direction along which the NCC stays high, or None where it does in none."""
    reach = 0.6 * min(correlation.centre)
    t = np.linspace(0.15 * reach, reach, 40)
    angle = np.arange(ANGLES) * np.pi / ANGLES
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ncc = correlation.at(direction[:, None, :] * t[:, None])
    mean = np.nanmean(np.where(np.isfinite(ncc).any(axis=1, keepdims=True), ncc, 0), axis=1)
    best = int(np.argmax(mean))
    # Planks have a narrow ridge: other directions see nothing of it.
    if mean[best] < LINE_NCC or mean[best] - np.median(mean) < 0.5 * LINE_NCC:
        return None
    return Line(direction[best], float(mean[best]))


def line_offsets(line: Line, correlation: SelfCorrelation) -> Doubles:
    """Return shifts along the line, both ways, and along it beside the nearest like neighbours across."""
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
