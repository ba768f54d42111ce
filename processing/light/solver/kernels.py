"""Random numbers and compiled loops over rays: directions to sample, and which patch a ray met.

Arrays of rays are (N, S, 3): S rays from each of N points. ``points`` are (N, 1, 3), or (N, S, 3) with a place for each
ray, in metres; ``normals`` (N, 3) are unit; ``shifts`` (N, 2) in [0, 1) turn each point's own set of sample numbers.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from processing.ground.arrays import Doubles, Floats, Int32s
from processing.ground.kernels import compiled, inner

Key: TypeAlias = tuple[int, ...]  # the seed, then what the numbers are for
_DOMAIN = 811  # chosen: keeps these random numbers apart from those of other rooms of the code with the same seed
FIRST, SECOND = 0.7548776662466927, 0.5698402909980532
"""Roberts's R2 sequence (2018): n * (FIRST, SECOND) mod 1 covers the square evenly for every n."""
STEP_OFF_M = 2e-4  # how far rays start off their surface; chosen: above the rounding of float32 in a room of 20 m
FURNITURE, PANE = -1, -2  # owners of triangles that belong to no surface of the room


class Ownership(NamedTuple):
    """Whose the triangles (M) and the patches are, for compiled loops."""

    owner: Int32s
    """(M,): the surface's number, `FURNITURE` or `PANE`."""
    item: Int32s
    """(M,): of furniture the patch, of panes the pane's number."""
    normals: Floats
    """(M, 3), unit."""
    frames: Doubles
    """(surfaces, 3, 3): origin, u / texel width, v / texel height."""
    grids: Int32s
    """(surfaces, 3): columns, rows, first patch."""


def random(key: Key, rows: int, columns: int) -> Doubles:
    """Return numbers, shape (rows, columns), in [0, 1) that depend on key, row and column alone.

    More rows change none of the rows before: two scenes that share their first patches or pixels meet the same chance
    there, and their difference is quiet.
    """
    return np.random.default_rng([_DOMAIN, *key]).random((rows, columns))


@compiled
def cosine_rays(points, normals, shifts, origins, directions):  # type: ignore[no-untyped-def]
    """Fill ``origins`` and ``directions`` (N, S, 3) of rays spread by the cosine to each point's normal."""
    samples, several = directions.shape[1], points.shape[1] > 1
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        # Duff and others (2017): a basis without branches on small numbers.
        sign = 1.0 if z >= 0 else -1.0
        a = -1.0 / (sign + z)
        b = x * y * a
        for s in range(samples):
            u = (shifts[i, 0] + (s + 1) * FIRST) % 1.0
            v = (shifts[i, 1] + (s + 1) * SECOND) % 1.0
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
def met_patches(origins, directions, triangle, distance, ownership, patch, facing):  # type: ignore[no-untyped-def]
    """Fill the patch (R,) that each ray (R, 3) met (-1: a pane, nothing, or a surface's back) and its cosine there.

    ``triangle`` (R,) and ``distance`` (R,), m, are the rays' hits; ``ownership`` is an `Ownership`.
    """
    owner, item, tri_normals = ownership.owner, ownership.item, ownership.normals
    frames, grids = ownership.frames, ownership.grids
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


@inner
def _solid_angle(x0, y0, z0, x1, y1):  # type: ignore[no-untyped-def]
    """Return the solid angle of a rectangle (x0..x1, y0..y1) at z0 < 0, and what else `_on_rectangle` needs of it.

    Urena, Fajardo and King (2013), "An area-preserving parametrization for spherical rectangles"."""
    # Of the normals of the four sides' planes through the eye only z matters.
    n0z, n1z = -y0 / math.sqrt(z0 * z0 + y0 * y0), x1 / math.sqrt(z0 * z0 + x1 * x1)
    n2z, n3z = y1 / math.sqrt(z0 * z0 + y1 * y1), -x0 / math.sqrt(z0 * z0 + x0 * x0)
    g0 = math.acos(min(max(-n0z * n1z, -1.0), 1.0))
    g1 = math.acos(min(max(-n1z * n2z, -1.0), 1.0))
    g2 = math.acos(min(max(-n2z * n3z, -1.0), 1.0))
    g3 = math.acos(min(max(-n3z * n0z, -1.0), 1.0))
    rest = 2 * math.pi - g2 - g3
    return g0 + g1 - rest, rest, n0z, n2z


@inner
def _on_rectangle(sides, angles, p, q):  # type: ignore[no-untyped-def]
    """Return a place (x, y) on a rectangle, ``sides`` (x0, y0, z0, x1, y1), for p, q in 0..1.

    ``angles``: what `_solid_angle` returned of it."""
    (x0, y0, z0, x1, y1), (solid, rest, n0z, n2z) = sides, angles
    angle = p * solid + rest
    fu = (math.cos(angle) * n0z - n2z) / math.sin(angle)
    cu = min(1.0 / math.sqrt(fu * fu + n0z * n0z), 1.0) * (1.0 if fu > 0 else -1.0)
    x = -(cu * z0) / max(math.sqrt(max(1 - cu * cu, 0.0)), 1e-7)
    x = min(max(x, x0), x1)
    d2 = x * x + z0 * z0
    h0, h1 = y0 / math.sqrt(d2 + y0 * y0), y1 / math.sqrt(d2 + y1 * y1)
    h = h0 + q * (h1 - h0)
    return x, h * math.sqrt(d2) / math.sqrt(1 - h * h) if h * h < 1 - 1e-6 else y1


@compiled
def pane_rays(points, normals, shifts, rectangle, origins, ways, weight):  # type: ignore[no-untyped-def]
    """Fill ``origins``, ``ways`` (N, S, 3), m, to a ``rectangle`` (3, 3: corner, across, up), uniform in solid angle.

    ``weight`` (N, S): cosine times the rectangle's solid angle, sr; 0 where the rectangle is behind the surface, and
    then the ray is not filled.
    """
    corner, across, up = rectangle[0], rectangle[1], rectangle[2]
    samples = ways.shape[1]
    wide = math.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
    high = math.sqrt(up[0] ** 2 + up[1] ** 2 + up[2] ** 2)
    ax, ay, az = across[0] / wide, across[1] / wide, across[2] / wide
    bx, by, bz = up[0] / high, up[1] / high, up[2] / high
    several, start = points.shape[1] > 1, np.empty(3, np.float32)
    sides, angles, cx, cy, cz = (0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0
    for i in range(normals.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        reach = max(nx * across[0] + ny * across[1] + nz * across[2], 0.0)
        reach += max(nx * up[0] + ny * up[1] + nz * up[2], 0.0)
        for s in range(samples):
            if s == 0 or several:
                # What all rays from one place share: the rectangle as it is seen from there.
                for c in range(3):
                    start[c] = points[i, s if several else 0, c] + STEP_OFF_M * normals[i, c]
                dx, dy, dz = corner[0] - start[0], corner[1] - start[1], corner[2] - start[2]
                cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                z0 = dx * cx + dy * cy + dz * cz
                ahead = abs(z0) >= 1e-6 and nx * dx + ny * dy + nz * dz + reach > 0
                if z0 > 0:
                    z0, cx, cy, cz = -z0, -cx, -cy, -cz
                x0, y0 = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz
                sides = x0, y0, z0, x0 + wide, y0 + high
                angles = _solid_angle(x0, y0, z0, x0 + wide, y0 + high) if ahead else (0.0, 0.0, 0.0, 0.0)
            weight[i, s] = 0.0
            if not angles[0] > 1e-12:
                continue
            p, q = (shifts[i, 0] + (s + 1) * FIRST) % 1.0, (shifts[i, 1] + (s + 1) * SECOND) % 1.0
            x, y = _on_rectangle(sides, angles, p, q)
            far = math.sqrt(x * x + y * y + z0 * z0)
            ox, oy, oz = x * ax + y * bx + z0 * cx, x * ay + y * by + z0 * cy, x * az + y * bz + z0 * cz
            cosine = (ox * nx + oy * ny + oz * nz) / far
            if cosine > 0:
                weight[i, s] = cosine * angles[0]
                origins[i, s, 0], origins[i, s, 1], origins[i, s, 2] = start[0], start[1], start[2]
                ways[i, s, 0], ways[i, s, 1], ways[i, s, 2] = ox, oy, oz


@compiled
def towards_panes(points, direction, corners, across, up, out):  # type: ignore[no-untyped-def]
    """Fill whether the ray from each point (N, 3) in one direction meets a pane's rectangle, with a little margin."""
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
