"""Furniture's edges in a large picture: smooth, as a lens shows them, not stairs.

A pixel whose middle sees one thing and whose neighbours see another is looked at by several rays. Each takes the
colour that the nearest pixel shows of the same thing; room that appears beside an edge is the photograph's own pixel,
with the change of light of its neighbours.
"""

from __future__ import annotations

import numpy as np

from processing.ground.arrays import Floats
from processing.light.scene.scene import Vector
from processing.light.solver.kernels import FIRST, SECOND, compiled
from processing.light.solver.sight import FIRST_PART, Sight, sight_along
from processing.light.solver.stage import Stage

RAYS = 8
"""In each pixel of an edge."""
STEP_M, TURNED = 0.01, 0.9
"""Height of a step, and cosine between normals, from which two pixels of one part are an edge."""


def edge_pixels(sight: Sight) -> np.ndarray:
    """Return which pixels (h, w) of a band lie at an edge of furniture; columns wrap, rows do not."""
    label = sight.label.reshape(sight.shape)
    normal, point = (each.reshape(*sight.shape, 3) for each in (sight.normal, sight.point))
    edge = np.zeros(sight.shape, bool)
    for axis in (0, 1):
        other = np.roll(label, 1, axis)
        furniture = (label >= FIRST_PART) | (other >= FIRST_PART)
        bent = np.einsum("ijk,ijk->ij", normal, np.roll(normal, 1, axis)) < TURNED
        step = np.abs(np.einsum("ijk,ijk->ij", point - np.roll(point, 1, axis), normal)) > STEP_M
        apart = furniture & ((label != other) | bent | step)
        if axis == 0:
            apart[0] = False
        edge |= apart | np.roll(apart, -1, axis)
    return edge


def smooth_edges(
    stage: Stage, sight: Sight, first_row: int, rows: int, eye_m: Vector, photograph: Floats, shown: Floats
) -> Floats:
    """Return a band's picture (h, w, 3) with smooth edges of furniture.

    Parameters
    ----------
    sight
        What the band's pixels see; its first row is row ``first_row`` of a panorama of ``rows``.
    photograph, shown
        (h, w, 3): the band without furniture, and with it, stairs and all.
    """
    row, column = np.nonzero(edge_pixels(sight))
    out = shown.copy()
    if not len(row):
        return out
    at_once = 1 << 17
    for start in range(0, len(row), at_once):
        part = slice(start, start + at_once)
        r, c = row[part].astype(np.int64), column[part].astype(np.int64)
        seen = sight_along(stage, _rays(r + first_row, c, rows), eye_m, (len(r), RAYS))
        _mixed(
            *(r, c, seen.label.reshape(-1, RAYS), seen.normal.reshape(-1, RAYS, 3)),
            *(seen.distance_m.reshape(-1, RAYS), sight.label.reshape(sight.shape)),
            *(sight.normal.reshape(*sight.shape, 3), sight.distance_m.reshape(sight.shape)),
            *(photograph, shown, FIRST_PART, out),
        )
    return out


def _rays(row: np.ndarray, column: np.ndarray, rows: int) -> Floats:
    """Return the directions (n x `RAYS`, 3) of places spread over pixels of a panorama."""
    k = np.arange(RAYS) + 0.5
    down, across = (k * FIRST) % 1.0, (k * SECOND) % 1.0
    latitude = (0.5 - (row[:, None] + down) / rows) * np.pi
    longitude = ((column[:, None] + across) / (2 * rows) - 0.5) * 2 * np.pi
    level = np.cos(latitude)
    found = np.stack([np.sin(longitude) * level, np.cos(longitude) * level, np.sin(latitude)], axis=-1)
    return np.ascontiguousarray(found.reshape(-1, 3), dtype=np.float32)


@compiled
def _likest(label, normal, far, y, x, labels, normals, fars):  # type: ignore[no-untyped-def]
    """Return the row and column of the pixel around (y, x) that shows most nearly the same thing; -1 where none."""
    rows, columns = labels.shape
    best, at_y, at_x = -1e30, -1, -1
    for r in range(max(y - 1, 0), min(y + 2, rows)):
        for dc in range(-1, 2):
            c = (x + dc) % columns
            if labels[r, c] != label:
                continue
            score = -0.01 * (abs(r - y) + abs(dc))
            for k in range(3):
                score += 4.0 * normal[k] * normals[r, c, k]  # which way it faces counts more than how far it is
            if far < 1e6 and fars[r, c] < 1e6:
                score -= min(10.0 * abs(far - fars[r, c]) / far, 2.0)
            if score > best:
                best, at_y, at_x = score, r, c
    return at_y, at_x


@compiled
def _mixed(row, column, label, normal, far, labels, normals, fars, photograph, shown, first_part, out):  # type: ignore[no-untyped-def]
    rays = label.shape[1]
    for i in range(row.shape[0]):
        y, x = row[i], column[i]
        red = green = blue = 0.0
        for s in range(rays):
            r, c = _likest(label[i, s], normal[i, s], far[i, s], y, x, labels, normals, fars)
            if r < 0:
                r, c = y, x
            gains = labels[r, c] < first_part
            for k in range(3):
                value = shown[r, c, k]
                if gains:
                    value = photograph[y, x, k]
                    if photograph[r, c, k] > 0:
                        value *= min(shown[r, c, k] / photograph[r, c, k], 4.0)
                if k == 0:
                    red += value
                elif k == 1:
                    green += value
                else:
                    blue += value
        out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / rays, green / rays, blue / rays
