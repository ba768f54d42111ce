"""Where a large picture must be looked at pixel by pixel, and where a coarse grid of nodes says it all.

Light changes slowly over a wall. A block whose four corners show one surface of the room, with changes of light that
agree, and in which no furniture can be seen, is filled from its corners; blocks of furniture, of sunlight and of edges
are looked at themselves. Measured on a staged bedroom at 6720 x 3360: docs/measurements/pipeline.md.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Int32s, Vector
from processing.ground.kernels import compiled, inlined
from processing.light.solver.kernels import FURNITURE
from processing.light.solver.stage import Stage

CAP_RAD = 0.03  # furniture's triangles that look larger are divided; chosen: caps then fit their outline well
EVEN = np.float32(0.02)
"""Relative: by how much the change of light may differ among a block's corners. Chosen: between them a straight line
then misses it by 0.1 % at most (p99)."""
LEAST_CHANGE = np.float32(0.004)
"""Relative: a smaller change of light is within the noise, and the photograph's pixel is kept as it is."""
MOST_MIRRORED = np.float32(0.5)  # of a floor's pixel that is taken to be mirrored light


def furniture_blocks(stage: Stage, shape: tuple[int, int], step: int, eye_m: Vector) -> Flags:
    """Return in which blocks of ``step`` pixels of a panorama (H, W) furniture may be seen, and one more all round.

    Each triangle lies in a cap of the sphere, and the cap in a box of longitude and latitude: none is missed.
    """
    rows, columns = -(-shape[0] // step), -(-shape[1] // step)
    found = np.zeros((rows, columns), np.uint8)
    corners = stage.patches.triangles[stage.patches.owner == FURNITURE].astype(np.float64) - np.asarray(eye_m)
    while len(corners):
        ways = corners / np.maximum(np.linalg.norm(corners, axis=2, keepdims=True), 1e-9)
        middle = ways.sum(axis=1)
        middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-9)
        reach = np.arccos(np.clip(np.einsum("ijk,ik->ij", ways, middle), -1, 1)).max(axis=1)
        small = reach < CAP_RAD
        _mark(middle[small], reach[small], shape[0] / (step * math.pi), shape[1] / step, found)
        corners = _quarters(corners[~small])
        if np.abs(corners).max(initial=1) < 1e-3:  # about the eye itself
            return np.ones((rows, columns), bool)
    around = np.pad(found, ((1, 1), (0, 0)), mode="edge")
    around = np.pad(around, ((0, 0), (1, 1)), mode="wrap")
    return np.asarray(cv2.dilate(around, np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0)


def _quarters(corners: Doubles) -> Doubles:
    """Return each triangle (N, 3, 3) cut into four."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(one, axis=1) for one in four])


class Nodes(NamedTuple):
    """A grid's nodes (n, m), every ``step`` pixels and at the last row, and what they show."""

    label: Int32s
    gain: Floats
    """(n, m, 3): change of light."""
    mirror: Floats
    """(n, m, 6): mirrored by a floor before and after; (n, m, 0) where no floor mirrors."""
    plain: Flags
    """Whether neither sun nor lamp shines there, and a small picture's light reaches it."""
    last_row: int
    """Of the band, at which the last nodes stand; the others stand every ``step`` rows and columns."""


class Band(NamedTuple):
    """What is filled (h, w, ...): the picture, and which pixels are kept."""

    shown: Floats
    kept: Flags
    todo: Flags
    """Pixels that must be looked at."""


@compiled
def _mark(middle, reach, per_rad, around, found):  # type: ignore[no-untyped-def]
    """Mark the blocks of caps (N,): ``per_rad`` blocks a radian of latitude, ``around`` of them around a row."""
    rows, columns = found.shape
    for i in range(middle.shape[0]):
        latitude = math.asin(min(max(middle[i, 2], -1.0), 1.0))
        top, bottom = (math.pi / 2 - latitude - reach[i]) * per_rad, (math.pi / 2 - latitude + reach[i]) * per_rad
        wide = math.pi
        if abs(latitude) + reach[i] < math.pi / 2 - 1e-6:
            wide = math.asin(min(math.sin(reach[i]) / math.cos(latitude), 1.0))
        at, half = (math.atan2(middle[i, 0], middle[i, 1]) / (2 * math.pi) + 0.5) * around, wide * per_rad + 1
        first, last = math.floor(at - half), min(math.floor(at + half), math.floor(at - half) + columns - 1)
        for r in range(max(math.floor(top), 0), min(math.floor(bottom), rows - 1) + 1):
            for c in range(first, last + 1):
                found[r, c % columns] = 1


@inlined
def much(shown, photo) -> bool:  # type: ignore[no-untyped-def]
    """Return whether one channel differs from the photograph's. Numbers, no arrays: handing these on costs more."""
    return bool(abs(shown - photo) >= LEAST_CHANGE * max(photo, np.float32(1e-12)))


@inlined
def add_mirrored(old, new, gain, weights, photo, i, j, shown):  # type: ignore[no-untyped-def]
    """Add to ``shown`` what a glossy floor mirrors now, ``new`` (3,), less what it mirrored before, ``old`` (3,).

    Mirrored light is not shaded where it falls, so what was mirrored before is not changed by ``gain`` (3,). No more is
    taken to be mirrored than the photograph can hold: there the model is wrong, not the photograph.
    """
    seen = held = np.float32(0)
    for c in range(3):
        held += weights[c] * photo[i, j, c]
        seen += weights[c] * old[c]
    believed = min(MOST_MIRRORED * held / max(seen, np.float32(1e-9)), np.float32(1))
    for c in range(3):
        more = believed * (new[c] - old[c] * gain[c])
        shown[i, j, c] += max(more, -MOST_MIRRORED * photo[i, j, c] * gain[c])


@compiled
def fill_plain(nodes, step, near, photo, weights, band):  # type: ignore[no-untyped-def]
    """Fill the blocks of a band (h, w), kept so far, that their corners show; mark pixels of others in ``band.todo``.

    ``near`` (blocks): where furniture may be seen; ``weights`` (3,): luminance of R, G and B.
    """
    high, wide = photo.shape[0], photo.shape[1]
    corner, scratch = np.empty((4, 9), np.float32), np.empty((3, 9), np.float32)
    rows, columns = nodes.label.shape
    for top in range(0, high, step):
        j = top // step
        below = min(j + 1, rows - 1)
        for left in range(0, wide, step):
            i = left // step
            beside = (i + 1) % columns
            right, bottom = min(left + step, wide), min(top + step, high)
            if near[j, i] or not _agree(nodes, j, below, i, beside, corner):
                band.todo[top:bottom, left:right] = True
                continue
            if nodes.label[j, i] < 0:
                continue  # kept as it is, as all of a band is to begin with
            count = 9 if _mirrored(nodes, j, below, i, beside, corner) else 3
            block = top, bottom, left, right, np.float32(max(min(step, nodes.last_row - top), 1))
            _one_block(block, (corner, scratch), count, photo, weights, band)


@inlined
def _agree(nodes, j, below, i, beside, corner) -> bool:  # type: ignore[no-untyped-def]
    """Return whether four nodes show one thing in one light; fill ``corner`` (4, 3) with their gains."""
    label = nodes.label[j, i]
    for n in range(4):
        y, x = (below if n >= 2 else j), (beside if n % 2 else i)
        if nodes.label[y, x] != label or not nodes.plain[y, x]:
            return False
        for c in range(3):
            corner[n, c] = nodes.gain[y, x, c]
    for c in range(3):
        low = min(corner[0, c], corner[1, c], corner[2, c], corner[3, c])
        most = max(corner[0, c], corner[1, c], corner[2, c], corner[3, c])
        if most - low > EVEN * most:
            return False
    return True


@inlined
def _mirrored(nodes, j, below, i, beside, corner) -> bool:  # type: ignore[no-untyped-def]
    """Return whether a floor mirrors light at any of four nodes; fill ``corner`` (4, 9) from the fourth column on."""
    if nodes.mirror.shape[2] == 0:
        return False
    there = False
    for n in range(4):
        y, x = (below if n >= 2 else j), (beside if n % 2 else i)
        for c in range(6):
            corner[n, 3 + c] = nodes.mirror[y, x, c]
            there |= corner[n, 3 + c] != 0
    return there


@inlined
def _one_block(block, values, count, photo, weights, band):  # type: ignore[no-untyped-def]
    """Fill a ``block`` (top, bottom, left, right, rows from node to node) from its corners' first ``count`` values.

    ``values``: the corners' (4, 9) and scratch (3, 9)."""
    (top, bottom, left, right, tall), (corner, scratch) = block, values
    begin, step, mixed = scratch[0], scratch[1], scratch[2]
    across = np.float32(1) / np.float32(right - left)
    for r in range(top, bottom):
        v = min(np.float32(r - top) / tall, np.float32(1))
        for c in range(count):
            begin[c] = corner[0, c] + v * (corner[2, c] - corner[0, c])
            step[c] = (corner[1, c] + v * (corner[3, c] - corner[1, c]) - begin[c]) * across
        for k in range(left, right):
            u = np.float32(k - left)
            gain = begin[0] + u * step[0], begin[1] + u * step[1], begin[2] + u * step[2]
            p, q, t = photo[r, k, 0], photo[r, k, 1], photo[r, k, 2]
            x, y, z = p * gain[0], q * gain[1], t * gain[2]
            if count > 3:
                for c in range(count):
                    mixed[c] = begin[c] + u * step[c]
                band.shown[r, k, 0], band.shown[r, k, 1], band.shown[r, k, 2] = x, y, z
                add_mirrored(mixed[3:6], mixed[6:9], mixed, weights, photo, r, k, band.shown)
                x, y, z = band.shown[r, k, 0], band.shown[r, k, 1], band.shown[r, k, 2]
            if much(x, p) or much(y, q) or much(z, t):
                band.kept[r, k] = False
            else:
                x, y, z = p, q, t
            band.shown[r, k, 0], band.shown[r, k, 1], band.shown[r, k, 2] = x, y, z
