"""Masks on the whole sphere: round the seam, over the poles, and measured in angles rather than pixels."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int32]


def row_latitudes(rows: int) -> Doubles:
    """Return the latitudes (rows,) of the rows' middles of a whole panorama."""
    return np.asarray((0.5 - (np.arange(rows) + 0.5) / rows) * math.pi)


def row_solid_angles(shape: tuple[int, int]) -> Doubles:
    """Return the solid angle (rows, 1) in sr of one pixel of each row of a whole panorama."""
    edges = np.sin((0.5 - np.arange(shape[0] + 1) / shape[0]) * math.pi)
    return np.asarray((edges[:-1] - edges[1:])[:, None] * (2 * math.pi / shape[1]))


def share_of_sphere(mask: Flags) -> float:
    """Return which part of the sphere a mask covers, 0..1."""
    return float((mask * row_solid_angles((mask.shape[0], mask.shape[1]))).sum() / (4 * math.pi))


def components(mask: Flags) -> tuple[int, Integers]:
    """Return the number of components and their numbers (H, W) from 1, 0 outside; 8-neighbours, round the seam.

    Pixels of the first row all meet at the zenith, those of the last at the nadir.
    """
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    if not mask.size:
        return 0, np.asarray(labels, np.int32)
    parent = np.arange(count)

    def root(one: int) -> int:
        while parent[one] != one:
            one = int(parent[one])
        return one

    left, right = labels[:, 0], labels[:, -1]
    pairs = [(int(left[i]), int(right[j])) for s in (-1, 0, 1) for i, j in _rows_beside(len(left), s)]
    for row in (labels[0], labels[-1]):
        met = np.unique(row[row > 0])
        pairs += [(int(met[0]), int(one)) for one in met[1:]]
    for one, other in pairs:
        if one and other:
            a, b = sorted((root(one), root(other)))
            parent[b] = a
    roots = np.array([root(one) for one in range(count)])
    kept, numbers = np.unique(roots, return_inverse=True)
    return len(kept) - 1, np.asarray(numbers[labels], dtype=np.int32)


def _rows_beside(rows: int, step: int) -> list[tuple[int, int]]:
    return [(i, i + step) for i in range(rows) if 0 <= i + step < rows]


def grown(mask: Flags, angle_rad: float) -> Flags:
    """Return all places within an angle of a mask (H, W), on the sphere.

    Up to a pixel: rows and columns are treated one after the other, so that the reach is a lens, not a circle, which
    differs by less than a tenth up to 0.2 rad.
    """
    rows = mask.shape[0]
    if angle_rad <= 0 or not mask.any():
        return mask.copy()
    found = mask.copy()
    step = math.pi / rows
    reach = max(1, round(angle_rad / step))
    for down in range(-reach, reach + 1):
        rest = math.sqrt(max(angle_rad**2 - (down * step) ** 2, 0.0))
        moved = _moved_rows(mask, down)
        found |= _widened(moved, rest)
    return found


def shrunk(mask: Flags, angle_rad: float) -> Flags:
    """Return the places of a mask that are farther than an angle from everything outside it."""
    return ~grown(~mask, angle_rad)


def _moved_rows(mask: Flags, down: int) -> Flags:
    """Return the mask moved down by rows; what passes a pole comes down half way round."""
    rows, columns = mask.shape
    source = np.arange(rows) - down
    inside = np.where(source < 0, -1 - source, np.where(source >= rows, 2 * rows - 1 - source, source))
    moved = mask[np.clip(inside, 0, rows - 1)]
    beyond = (source < 0) | (source >= rows)
    if beyond.any():
        moved[beyond] = np.roll(moved[beyond], columns // 2, axis=1)
    return np.asarray(moved, bool)


def _widened(mask: Flags, angle_rad: float) -> Flags:
    """Return the mask widened along each row by an angle on the sphere, round the seam."""
    rows, columns = mask.shape
    cosine = np.maximum(np.cos(row_latitudes(rows)), 1e-9)
    half = np.minimum(np.floor(angle_rad / cosine / (2 * math.pi / columns) + 0.5), columns // 2).astype(np.int64)
    some = np.flatnonzero(mask.any(axis=1))
    out = np.zeros_like(mask)
    if not some.size:
        return out
    most = int(half[some].max())
    part = mask[some].astype(np.int32)
    padded = np.concatenate([part[:, columns - most :], part, part[:, :most]], axis=1) if most else part
    sums = np.concatenate([np.zeros((len(some), 1), np.int64), np.cumsum(padded, axis=1)], axis=1)
    middle = np.arange(columns)[None, :] + most
    low, high = middle - half[some, None], middle + half[some, None] + 1
    out[some] = np.take_along_axis(sums, high, axis=1) > np.take_along_axis(sums, low, axis=1)
    return out


def resized(values: Floats, shape: tuple[int, int]) -> Floats:
    """Return a picture (H, W) or (H, W, C) of the whole sphere at another size: by area down, linear up, round."""
    height, width = values.shape[:2]
    if (height, width) == shape:
        return np.asarray(values, dtype=np.float32)
    if shape[0] <= height and shape[1] <= width:
        return np.asarray(cv2.resize(values, shape[::-1], interpolation=cv2.INTER_AREA), dtype=np.float32)
    pad = 2
    wide = np.concatenate([values[:, width - pad :], values, values[:, :pad]], axis=1)
    scale = shape[1] / width
    x = ((np.arange(shape[1]) + 0.5) / scale - 0.5 + pad).astype(np.float32)
    y = ((np.arange(shape[0]) + 0.5) * (height / shape[0]) - 0.5).astype(np.float32)
    at_x, at_y = np.meshgrid(x, np.clip(y, 0, height - 1))
    out = cv2.remap(wide, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out.reshape(*shape, *values.shape[2:]), dtype=np.float32)


def smoothed(values: Floats, angle_rad: float) -> Floats:
    """Return a picture (H, W) or (H, W, C) smoothed by a Gaussian of a standard deviation on the equator, round."""
    sigma_px = angle_rad / (math.pi / values.shape[0])
    if sigma_px < 0.3:
        return values
    pad = min(math.ceil(3 * sigma_px), values.shape[1])
    wide = np.concatenate([values[:, values.shape[1] - pad :], values, values[:, :pad]], axis=1)
    out = cv2.GaussianBlur(wide, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(out[:, pad : pad + values.shape[1]], dtype=np.float32)
