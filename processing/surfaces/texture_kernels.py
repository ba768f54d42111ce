"""Texels from pixels and pixels from texels, each averaged over what it covers (compiled)."""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np

MOST_FINE = 8
"""Samples across a texel or pixel: finer detail than that is lost to aliasing, which is then below 1 in 64."""
LEAST_KNOWN = 0.5
"""Share of a texel's samples that must be known."""
CLEAR = 1e-3
"""Weight of masked pixels that spoils a sample."""


@nb.njit(cache=True, nogil=True)
def _fineness(extent_px: float) -> int:
    return min(MOST_FINE, max(1, int(np.ceil(0.8 * extent_px))))


@nb.njit(cache=True, nogil=True)
def _add_sample(picture: Any, masked: Any, x: float, y: float, sums: Any) -> bool:
    """Add the panorama's value at a place in pixels to ``sums``; False where a masked pixel has part in it."""
    height, width, channels = picture.shape
    # Within half a row of a pole, the pole's own row.
    y = min(max(y - 0.5, 0.0), height - 1.0)
    x = x - 0.5
    left, up = int(np.floor(x)), int(y)
    right_part, down_part = x - left, y - up
    down = min(up + 1, height - 1)
    right = (left + 1) % width
    left %= width
    if masked.size > 0:
        hidden = (1 - down_part) * ((1 - right_part) * masked[up, left] + right_part * masked[up, right])
        hidden += down_part * ((1 - right_part) * masked[down, left] + right_part * masked[down, right])
        if hidden > CLEAR:
            return False
    for c in range(channels):
        above = (1 - right_part) * picture[up, left, c] + right_part * picture[up, right, c]
        below = (1 - right_part) * picture[down, left, c] + right_part * picture[down, right, c]
        sums[c] += (1 - down_part) * above + down_part * below
    return True


@nb.njit(cache=True, nogil=True)
def unwrapped(
    picture: Any, masked: Any, axes: Any, texel_m: float, yaw_rad: float, seen: Any, values: Any, known: Any,
    density: Any,
) -> None:  # fmt: skip
    """Fill a texture (h, w, C) from a panorama; ``axes``: the plane's origin as seen from the camera, u, v, normal."""
    corner, u_axis, v_axis, normal = axes[0], axes[1], axes[2], axes[3]
    height, width, channels = picture.shape
    row_rad, column_rad = np.pi / height, 2 * np.pi / width
    sums = np.zeros(channels)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if not seen[i, j]:
                continue
            d = corner + ((j + 0.5) * texel_m) * u_axis + ((i + 0.5) * texel_m) * v_axis
            distance = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
            facing = abs(d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]) / distance
            flat = max(np.sqrt(d[0] ** 2 + d[1] ** 2) / distance, np.sin(row_rad / 2))
            density[i, j] = facing * (texel_m / distance) ** 2 / (row_rad * column_rad * flat)
            fine = _fineness(texel_m / distance / row_rad)
            sums[:] = 0.0
            count = 0
            for a in range(fine * fine):
                across = (j + (a % fine + 0.5) / fine) * texel_m
                along = (i + (a // fine + 0.5) / fine) * texel_m
                dx = corner[0] + across * u_axis[0] + along * v_axis[0]
                dy = corner[1] + across * u_axis[1] + along * v_axis[1]
                dz = corner[2] + across * u_axis[2] + along * v_axis[2]
                x = (np.arctan2(dx, dy) - yaw_rad) / column_rad + width / 2
                y = height / 2 - np.arctan2(dz, np.sqrt(dx * dx + dy * dy)) / row_rad
                count += _add_sample(picture, masked, x, y, sums)
            if count >= LEAST_KNOWN * fine * fine:
                known[i, j] = True
                for c in range(channels):
                    values[i, j, c] = sums[c] / count


@nb.njit(cache=True, nogil=True)
def _plane_met(floor: Any, dx: float, dy: float, dz: float, camera_m: float, ceiling_m: float) -> int:
    """Return which plane a ray from the camera meets: 0 floor, 1 ceiling, 2 + i wall i."""
    nearest, wall = np.inf, -1
    n = floor.shape[0]
    for i in range(n):
        x0, y0 = floor[i, 0], floor[i, 1]
        x1, y1 = floor[(i + 1) % n, 0], floor[(i + 1) % n, 1]
        side, ahead, area = dx * y0 - dy * x0, dx * y1 - dy * x1, x0 * y1 - y0 * x1
        if side <= 0 < ahead and area > 0 and area < nearest * (ahead - side):
            nearest, wall = area / (ahead - side), i
    height = camera_m + nearest * dz
    if height < 0:
        return 0
    return 1 if height > ceiling_m else 2 + wall


@nb.njit(cache=True, nogil=True)
def _add_texel(texture: Any, inside: Any, x: float, y: float, sums: Any) -> None:
    """Add a texture's value at a place in texels, from texels inside its outline where there are any."""
    height, width, channels = texture.shape
    x = min(max(x - 0.5, 0.0), width - 1.0)
    y = min(max(y - 0.5, 0.0), height - 1.0)
    left, up = int(x), int(y)
    right, down = min(left + 1, width - 1), min(up + 1, height - 1)
    right_part, down_part = x - left, y - up
    a = (1 - right_part) * (1 - down_part)
    b, c, d = right_part * (1 - down_part), (1 - right_part) * down_part, right_part * down_part
    ia, ib, ic, id_ = a * inside[up, left], b * inside[up, right], c * inside[down, left], d * inside[down, right]
    total = ia + ib + ic + id_
    if total > 1e-6:
        a, b, c, d = ia / total, ib / total, ic / total, id_ / total
    for k in range(channels):
        sums[k] += a * texture[up, left, k] + b * texture[up, right, k]
        sums[k] += c * texture[down, left, k] + d * texture[down, right, k]


@nb.njit(cache=True, nogil=True)
def _alone(planes: Any, row: int, column: int) -> bool:
    """Return whether a pixel's neighbours all see its plane."""
    height, width = planes.shape
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            if planes[min(max(row + i, 0), height - 1), (column + j) % width] != planes[row, column]:
                return False
    return True


@nb.njit(cache=True, nogil=True)
def wrapped(
    texture: Any, inside: Any, planes: Any, index: int, rows: Any, columns: Any, axes: Any, px_per_m: float,
    yaw_rad: float, floor: Any, camera_m: float, ceiling_m: float, values: Any,
) -> None:  # fmt: skip
    """Fill ``values`` (n, C) of pixels that see a plane, each averaged over the part of it that sees the plane."""
    corner, u_axis, v_axis, normal = axes[0], axes[1], axes[2], axes[3]
    height, width = planes.shape
    row_rad, column_rad = np.pi / height, 2 * np.pi / width
    sums = np.zeros(texture.shape[2])
    distance = corner[0] * normal[0] + corner[1] * normal[1] + corner[2] * normal[2]
    for p in range(rows.shape[0]):
        whole = _alone(planes, rows[p], columns[p])
        latitude = np.pi / 2 - (rows[p] + 0.5) * row_rad
        longitude = (columns[p] + 0.5 - width / 2) * column_rad + yaw_rad
        facing = np.cos(latitude) * (np.sin(longitude) * normal[0] + np.cos(longitude) * normal[1])
        facing = max(abs(facing + np.sin(latitude) * normal[2]), 1e-6)
        fine = _fineness(abs(distance) / facing**2 * row_rad * px_per_m)
        sums[:] = 0.0
        count = 0
        for a in range(fine * fine):
            lat = np.pi / 2 - (rows[p] + (a // fine + 0.5) / fine) * row_rad
            lon = (columns[p] + (a % fine + 0.5) / fine - width / 2) * column_rad + yaw_rad
            dx, dy, dz = np.sin(lon), np.cos(lon), np.tan(lat)
            if not whole and _plane_met(floor, dx, dy, dz, camera_m, ceiling_m) != index:
                continue
            towards = dx * normal[0] + dy * normal[1] + dz * normal[2]
            scale = distance / towards
            ox, oy, oz = dx * scale - corner[0], dy * scale - corner[1], dz * scale - corner[2]
            u = (ox * u_axis[0] + oy * u_axis[1] + oz * u_axis[2]) * px_per_m
            v = (ox * v_axis[0] + oy * v_axis[1] + oz * v_axis[2]) * px_per_m
            _add_texel(texture, inside, u, v, sums)
            count += 1
        for c in range(texture.shape[2]):
            values[p, c] = sums[c] / max(count, 1)
