"""Furniture's edges in a large picture: smooth, as a lens shows them, not stairs.

A pixel whose middle sees one thing and whose neighbours see another is looked at by several rays. Each takes the
colour that the nearest pixel shows of the same thing; room that appears beside an edge is the photograph's own pixel,
with the change of light of its neighbours.
"""

from typing import NamedTuple, Self

import numpy as np

from processing.ground.arrays import Floats, Int32s, Vector
from processing.ground.kernels import compiled, inlined
from processing.light.solver.kernels import FIRST, SECOND
from processing.light.solver.sight import FIRST_PART, Sight, sight_along
from processing.light.solver.stage import Stage, in_parts

MOST_GAIN = 4.0  # by which new furniture may brighten a place of the room
RAYS = 8  # in each pixel of an edge
STEP_M, TURNED = 0.01, 0.9
"""Height of a step, and cosine between normals, from which two pixels of one part are an edge."""


def edge_pixels(sight: Sight) -> np.ndarray:
    """Return which pixels (H, W) of a band lie at an edge of furniture; columns wrap, rows do not."""
    shape, edge = sight.shape, np.zeros(sight.shape, bool)
    normal, point = (each.reshape(*shape, 3) for each in (sight.normal, sight.point))
    _edges(sight.label.reshape(shape), normal, point, edge)
    return edge


@compiled
def _edges(label, normal, point, edge):  # type: ignore[no-untyped-def]
    for y in range(label.shape[0]):
        for x in range(label.shape[1]):
            for down in range(2):
                r, k = y - down, (x - 1 + down) % label.shape[1]
                if r < 0 or (label[y, x] < FIRST_PART and label[r, k] < FIRST_PART):
                    continue
                turned = lift = np.float32(0)
                for c in range(3):
                    turned += normal[y, x, c] * normal[r, k, c]
                    lift += (point[y, x, c] - point[r, k, c]) * normal[y, x, c]
                if label[y, x] != label[r, k] or turned < TURNED or abs(lift) > STEP_M:
                    edge[y, x] = edge[r, k] = True


def smooth_edges(
    stage: Stage, sight: Sight, first_row: int, rows: int, eye_m: Vector, photograph: Floats, shown: Floats
) -> Floats:
    """Return a band's picture (H, W, 3) with smooth edges of furniture.

    ``sight``: what the band's pixels see; its first row is row ``first_row`` of a panorama of ``rows``.
    ``photograph``, ``shown`` (H, W, 3): the band without furniture, and with it, stairs and all.
    """
    row, column = np.nonzero(edge_pixels(sight))
    out = shown.copy()
    if not len(row):
        return out
    for part in in_parts(len(row), RAYS):
        r, c = row[part].astype(np.int64), column[part].astype(np.int64)
        # The directions (n x `RAYS`, 3) of places spread over pixels of a panorama
        k = np.arange(RAYS) + 0.5
        down, across = (k * FIRST) % 1.0, (k * SECOND) % 1.0
        latitude = (0.5 - ((r + first_row)[:, None] + down) / rows) * np.pi
        longitude = ((c[:, None] + across) / (2 * rows) - 0.5) * 2 * np.pi
        level = np.cos(latitude)
        found = np.stack([np.sin(longitude) * level, np.cos(longitude) * level, np.sin(latitude)], axis=-1)
        seen = sight_along(stage, np.ascontiguousarray(found.reshape(-1, 3), dtype=np.float32), eye_m, (len(r), RAYS))
        _mix(np.stack([r, c]), _Seen.of(seen), _Seen.of(sight), photograph, shown, out)
    return out


class _Seen(NamedTuple):
    """What pixels, or the rays through them, see, for compiled loops: arrays (A, B, ...)."""

    label: Int32s
    normal: Floats
    far: Floats
    """(A, B), m."""

    @classmethod
    def of(cls, sight: Sight) -> Self:
        shape = sight.shape
        return cls(sight.label.reshape(shape), sight.normal.reshape(*shape, 3), sight.distance_m.reshape(shape))


@inlined
def _likest(rays, i, s, y, x, pixels):  # type: ignore[no-untyped-def]
    """Return row and column of the pixel around (y, x) that shows most nearly what ray (i, s) meets; -1 where none."""
    label, normal, far = rays.label[i, s], rays.normal[i, s], rays.far[i, s]
    labels, normals, fars = pixels
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
def _mix(places, rays, pixels, photograph, shown, out):  # type: ignore[no-untyped-def]
    """Fill pixels of ``out`` (H, W, 3) at ``places`` (2, N: row, column) with the mean of what their rays' likest show.

    ``rays`` and ``pixels`` are `_Seen`; ``photograph`` and ``shown`` (H, W, 3), cd/m2, without and with furniture.
    """
    samples = rays.label.shape[1]
    for i in range(places.shape[1]):
        y, x = places[0, i], places[1, i]
        red = green = blue = 0.0
        for s in range(samples):
            r, c = _likest(rays, i, s, y, x, pixels)
            if r < 0:
                r, c = y, x
            # The room itself: the photograph's own pixel, with the change of light beside it.
            gains = pixels.label[r, c] < FIRST_PART
            for k in range(3):
                value = shown[r, c, k]
                if gains:
                    value = photograph[y, x, k]
                    if photograph[r, c, k] > 0:
                        value *= min(shown[r, c, k] / photograph[r, c, k], MOST_GAIN)
                if k == 0:
                    red += value
                elif k == 1:
                    green += value
                else:
                    blue += value
        out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / samples, green / samples, blue / samples
