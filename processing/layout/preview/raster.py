"""Depth buffers: triangles into pixels, and how much of a set of lights points see."""

from __future__ import annotations

from processing.ground.arrays import Doubles, Int32s

from typing import TypeAlias

import numba
import numpy as np
import numpy.typing as npt



@numba.njit(cache=True)
def nearest_faces(
    points: Doubles, faces: Int32s, rows: int, columns: int
) -> tuple[Doubles, Int32s]:  # pragma: no cover (compiled)
    """Return (rows, columns) depth (inf: none) and face (-1: none) of triangles; points are (x, y, depth) in pixels.

    Depth is interpolated linearly in the picture, which is right where it is a distance along parallel rays or the
    negative inverse of one along a pinhole's axis.
    """
    depth = np.full((rows, columns), np.inf)
    face_of = np.full((rows, columns), -1, dtype=np.int32)
    for f in range(faces.shape[0]):
        ax, ay, az = points[faces[f, 0]]
        bx, by, bz = points[faces[f, 1]]
        cx, cy, cz = points[faces[f, 2]]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        inverse = 1.0 / area
        x0, x1 = max(int(np.floor(min(ax, bx, cx))), 0), min(int(np.ceil(max(ax, bx, cx))), columns - 1)
        y0, y1 = max(int(np.floor(min(ay, by, cy))), 0), min(int(np.ceil(max(ay, by, cy))), rows - 1)
        for y in range(y0, y1 + 1):
            py = y + 0.5
            for x in range(x0, x1 + 1):
                px = x + 0.5
                u = ((bx - px) * (cy - py) - (by - py) * (cx - px)) * inverse
                v = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) * inverse
                w = 1.0 - u - v
                if u >= -1e-9 and v >= -1e-9 and w >= -1e-9:
                    z = u * az + v * bz + w * cz
                    if z < depth[y, x]:
                        depth[y, x] = z
                        face_of[y, x] = f
    return depth, face_of


@numba.njit(cache=True)
def seen_share(points: Doubles, frame: Doubles, depth: Doubles, bias: float) -> Doubles:  # pragma: no cover (compiled)
    """Return how much (0 to 1) of a light each place sees: the bilinear share of depths that do not lie before it.

    `frame` (3, 4) takes a place to (x, y, depth) in the light's picture.
    """
    rows, columns = depth.shape
    share = np.ones(points.shape[0])
    at = np.empty(3)
    for k in range(points.shape[0]):
        for i in range(3):
            at[i] = frame[i, 3]
            for j in range(3):
                at[i] += frame[i, j] * points[k, j]
        fx, fy = at[0] - 0.5, at[1] - 0.5
        ix, iy = int(np.floor(fx)), int(np.floor(fy))
        if ix < 0 or iy < 0 or ix >= columns - 1 or iy >= rows - 1:
            continue
        u, v, near = fx - ix, fy - iy, at[2] - bias
        total = 0.0
        if depth[iy, ix] > near:
            total += (1 - u) * (1 - v)
        if depth[iy, ix + 1] > near:
            total += u * (1 - v)
        if depth[iy + 1, ix] > near:
            total += (1 - u) * v
        if depth[iy + 1, ix + 1] > near:
            total += u * v
        share[k] = total
    return share
