"""Compiled loops over rays: directions to sample, which patch a ray met, light from outside, bounces."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numba
import numpy as np
import numpy.typing as npt

# Random numbers that stay with their row: more rows, or other draws before, change none of the rows there were.
#
# So two scenes that share their first patches or pixels meet the same chance there, and their difference is quiet.


Key: TypeAlias = tuple[int, ...]
"""The seed, then what the numbers are for."""
_DOMAIN = 811


def random(key: Key, rows: int, columns: int) -> npt.NDArray[np.float64]:
    """Return numbers (rows, columns) in [0, 1) that depend on key, row and column alone."""
    return np.random.default_rng([_DOMAIN, *key]).random((rows, columns))


FIRST, SECOND = 0.7548776662466927, 0.5698402909980532
"""Roberts's R2 sequence: n * (FIRST, SECOND) mod 1 covers the square evenly for every n."""
STEP_OFF_M = 2e-4
"""How far rays start off their surface."""
FURNITURE, PANE = -1, -2


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function, kept on disk where its cache can be written."""
    settings: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **settings)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # numba: no folder for its cache
        return numba.njit(**settings)(function)  # type: ignore[no-any-return]


@compiled
def cosine_rays(points, normals, shifts, start, samples, origins, directions):  # type: ignore[no-untyped-def]
    """Fill rays (n, samples, 3) spread by the cosine; ``points`` (n, samples or 1, 3), ``shifts`` (n, 2)."""
    several = points.shape[1] > 1
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        # Duff and others (2017): a basis without branches on small numbers.
        sign = 1.0 if z >= 0 else -1.0
        a = -1.0 / (sign + z)
        b = x * y * a
        for s in range(samples):
            u = (shifts[i, 0] + (start + s + 1) * FIRST) % 1.0
            v = (shifts[i, 1] + (start + s + 1) * SECOND) % 1.0
            radius, angle = math.sqrt(u), 2 * math.pi * v
            p, q, w = radius * math.cos(angle), radius * math.sin(angle), math.sqrt(max(1.0 - u, 0.0))
            directions[i, s, 0] = p * (1.0 + sign * x * x * a) + q * b + w * x
            directions[i, s, 1] = p * sign * b + q * (sign + y * y * a) + w * y
            directions[i, s, 2] = -p * sign * x - q * y + w * z
            k = s if several else 0
            origins[i, s, 0] = points[i, k, 0] + STEP_OFF_M * x
            origins[i, s, 1] = points[i, k, 1] + STEP_OFF_M * y
            origins[i, s, 2] = points[i, k, 2] + STEP_OFF_M * z


@compiled
def met_patches(  # type: ignore[no-untyped-def]
    origins, directions, triangle, distance, owner, item, tri_normals, frames, grids, patch, facing
):
    """Fill the patch that each ray (n) met (-1: a pane, nothing, or a surface's back) and its cosine there."""
    for i in range(triangle.shape[0]):
        patch[i] = -1
        facing[i] = 0.0
        t = triangle[i]
        if t < 0 or owner[t] == PANE:
            continue
        cosine = 0.0
        for c in range(3):
            cosine -= directions[i, c] * tri_normals[t, c]
        if owner[t] == FURNITURE:
            patch[i] = item[t]
            facing[i] = abs(cosine)
            continue
        if cosine <= 0:
            continue
        f = owner[t]
        u = v = 0.0
        for c in range(3):
            place = origins[i, c] + distance[i] * directions[i, c] - frames[f, 0, c]
            u += place * frames[f, 1, c]
            v += place * frames[f, 2, c]
        columns, rows = grids[f, 0], grids[f, 1]
        column = min(max(math.floor(u), 0), columns - 1)
        row = min(max(math.floor(v), 0), rows - 1)
        patch[i] = grids[f, 2] + row * columns + column
        facing[i] = cosine


@compiled
def bounce(links, radiosity, out):  # type: ignore[no-untyped-def]
    """Fill irradiance (n, 3): the mean radiosity of the patches that each point's rays met; -1 gives no light."""
    samples = links.shape[1]
    for i in range(links.shape[0]):
        r = g = b = 0.0
        for s in range(samples):
            k = links[i, s]
            if k >= 0:
                r += radiosity[k, 0]
                g += radiosity[k, 1]
                b += radiosity[k, 2]
        out[i, 0], out[i, 1], out[i, 2] = r / samples, g / samples, b / samples


@compiled
def bounce_bright(links, density, radiosity, chance, shots, out):  # type: ignore[no-untyped-def]
    """Add the light of bright patches that rays met, weighted against ``shots`` aimed at them (balance heuristic).

    ``density`` (n, samples) is cos cos' / (pi r2) of each ray; ``chance`` (n,) the aimed shots' density per m2.
    """
    samples = links.shape[1]
    for i in range(links.shape[0]):
        for s in range(samples):
            k = links[i, s]
            if k >= 0 and chance[k] > 0:
                found = samples * density[i, s]
                weight = found / (found + shots * chance[k]) / samples
                for c in range(3):
                    out[i, c] += radiosity[k, c] * weight


@compiled
def _on_rectangle(x0, y0, z0, x1, y1, p, q):  # type: ignore[no-untyped-def]
    """Return the solid angle of a rectangle (x0..x1, y0..y1) at z0 < 0, and a place (x, y) on it for p, q in 0..1.

    Urena, Fajardo and King (2013), "An area-preserving parametrization for spherical rectangles".
    """
    # Of the normals of the four sides' planes through the eye only z matters.
    n0z, n1z = -y0 / math.sqrt(z0 * z0 + y0 * y0), x1 / math.sqrt(z0 * z0 + x1 * x1)
    n2z, n3z = y1 / math.sqrt(z0 * z0 + y1 * y1), -x0 / math.sqrt(z0 * z0 + x0 * x0)
    g0 = math.acos(min(max(-n0z * n1z, -1.0), 1.0))
    g1 = math.acos(min(max(-n1z * n2z, -1.0), 1.0))
    g2 = math.acos(min(max(-n2z * n3z, -1.0), 1.0))
    g3 = math.acos(min(max(-n3z * n0z, -1.0), 1.0))
    rest = 2 * math.pi - g2 - g3
    solid = g0 + g1 - rest
    if not solid > 1e-12:
        return 0.0, x0, y0
    angle = p * solid + rest
    fu = (math.cos(angle) * n0z - n2z) / math.sin(angle)
    cu = min(1.0 / math.sqrt(fu * fu + n0z * n0z), 1.0) * (1.0 if fu > 0 else -1.0)
    x = -(cu * z0) / max(math.sqrt(max(1 - cu * cu, 0.0)), 1e-7)
    x = min(max(x, x0), x1)
    d2 = x * x + z0 * z0
    h0, h1 = y0 / math.sqrt(d2 + y0 * y0), y1 / math.sqrt(d2 + y1 * y1)
    h = h0 + q * (h1 - h0)
    y = h * math.sqrt(d2) / math.sqrt(1 - h * h) if h * h < 1 - 1e-6 else y1
    return solid, x, y


@compiled
def pane_rays(  # type: ignore[no-untyped-def]
    points, normals, shifts, start, samples, corner, across, up, origins, directions, weight
):
    """Fill rays (n, samples, 3) to a rectangle, uniform in solid angle; ``weight``: cos x solid angle, 0 if hidden."""
    wide = math.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
    high = math.sqrt(up[0] ** 2 + up[1] ** 2 + up[2] ** 2)
    ax, ay, az = across[0] / wide, across[1] / wide, across[2] / wide
    bx, by, bz = up[0] / high, up[1] / high, up[2] / high
    several = points.shape[1] > 1
    for i in range(normals.shape[0]):
        for s in range(samples):
            k = s if several else 0
            cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            for c in range(3):
                origins[i, s, c] = points[i, k, c] + STEP_OFF_M * normals[i, c]
            dx, dy, dz = corner[0] - origins[i, s, 0], corner[1] - origins[i, s, 1], corner[2] - origins[i, s, 2]
            z0 = dx * cx + dy * cy + dz * cz
            weight[i, s] = 0.0
            directions[i, s, 0], directions[i, s, 1], directions[i, s, 2] = cx, cy, cz
            if abs(z0) < 1e-6:
                continue
            if z0 > 0:
                z0, cx, cy, cz = -z0, -cx, -cy, -cz
            x0, y0 = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz
            p = (shifts[i, 0] + (start + s + 1) * FIRST) % 1.0
            q = (shifts[i, 1] + (start + s + 1) * SECOND) % 1.0
            solid, x, y = _on_rectangle(x0, y0, z0, x0 + wide, y0 + high, p, q)
            far = math.sqrt(x * x + y * y + z0 * z0)
            ox, oy, oz = x * ax + y * bx + z0 * cx, x * ay + y * by + z0 * cy, x * az + y * bz + z0 * cz
            directions[i, s, 0], directions[i, s, 1], directions[i, s, 2] = ox / far, oy / far, oz / far
            cosine = (ox * normals[i, 0] + oy * normals[i, 1] + oz * normals[i, 2]) / far
            if cosine > 0:
                weight[i, s] = cosine * solid


@compiled
def add_outdoors(  # type: ignore[no-untyped-def]
    owner, item, pane, triangle, ray, directions, weight, picture, tint, normal, cell, clear, veil, samples, out
):
    """Add to ``out`` (n, 3) what rays (k) that reach a pane bring in; ``ray`` (k,) tells each one's point.

    ``cell`` (k,) is the place on the pane where ``clear`` (cells,) and ``veil`` (cells, 3) are read; ``tint`` (m, 3) is
    its transmittance at cosines to its ``normal`` evenly from 0 to 1 (m = 1: alike at all).
    """
    last = tint.shape[0] - 1
    rows, columns = picture.shape[0], picture.shape[1]
    for k in range(ray.shape[0]):
        t = triangle[k]
        if t < 0 or owner[t] != PANE or item[t] != pane:
            continue
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        across = (math.atan2(x, y) / (2 * math.pi) + 0.5) * columns - 0.5
        down = (0.5 - math.asin(min(max(z, -1.0), 1.0)) / math.pi) * rows - 0.5
        c0, r0 = math.floor(across), math.floor(down)
        fc, fr = across - c0, down - r0
        low, high = min(max(int(r0), 0), rows - 1), min(max(int(r0) + 1, 0), rows - 1)
        left, right = int(c0) % columns, (int(c0) + 1) % columns
        share = weight[k] / samples
        i = ray[k]
        facing = min(abs(x * normal[0] + y * normal[1] + z * normal[2]), 1.0) * last
        step = min(math.floor(facing), max(last - 1, 0))
        part = facing - step
        for c in range(3):
            above = picture[low, left, c] * (1 - fc) + picture[low, right, c] * fc
            below = picture[high, left, c] * (1 - fc) + picture[high, right, c] * fc
            through = tint[step, c] * (1 - part) + tint[min(step + 1, last), c] * part
            outside = through * (above * (1 - fr) + below * fr)
            out[i, c] += share * (clear[cell[k]] * outside + veil[cell[k], c])


@compiled
def towards_panes(points, direction, corners, across, up, out):  # type: ignore[no-untyped-def]
    """Fill whether the ray from each point (n, 3) in one direction meets a pane's rectangle, with a little margin."""
    for j in range(corners.shape[0]):
        ax, ay, az = across[j, 0], across[j, 1], across[j, 2]
        bx, by, bz = up[j, 0], up[j, 1], up[j, 2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        into = direction[0] * nx + direction[1] * ny + direction[2] * nz
        if abs(into) < 1e-12:
            continue
        a2, b2 = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
        for i in range(points.shape[0]):
            if out[i]:
                continue
            dx, dy, dz = corners[j, 0] - points[i, 0], corners[j, 1] - points[i, 1], corners[j, 2] - points[i, 2]
            t = (dx * nx + dy * ny + dz * nz) / into
            if t <= 0:
                continue
            ex, ey, ez = t * direction[0] - dx, t * direction[1] - dy, t * direction[2] - dz
            u, v = (ex * ax + ey * ay + ez * az) / a2, (ex * bx + ey * by + ez * bz) / b2
            margin_u, margin_v = (0.02 + 0.01 * t) / math.sqrt(a2), (0.02 + 0.01 * t) / math.sqrt(b2)
            out[i] = -margin_u <= u <= 1 + margin_u and -margin_v <= v <= 1 + margin_v
