"""Whole panoramas: pictures and masks that go on round the seam and over the poles, measured in angles.

A panorama is equirectangular, W = 2 H: column 0 lies beside column W - 1, all pixels of the first row meet at the
zenith, those of the last at the nadir (docs/reference/coordinates.md).
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import AnyArray, Doubles, Flags, Floats, Indices, Int16s, Int32s, Int64s

WIDE_PX = 8.0  # chosen, for time: a Gaussian's work grows with its width
Picture = TypeVar("Picture", bound=npt.NDArray[np.generic])


def wrapped(picture: Picture, pad_px: int) -> Picture:
    """Return (H, W + 2 pad[, C]): a panorama (H, W[, C]) continued by ``pad_px`` <= W columns beyond its seam."""
    if not pad_px:
        return picture
    return np.concatenate([picture[:, -pad_px:], picture, picture[:, :pad_px]], axis=1)  # type: ignore[return-value]


def row_latitudes(rows: int) -> Doubles:
    """Return the latitudes (ROWS,) of the rows' middles of a whole panorama."""
    return np.asarray((0.5 - (np.arange(rows) + 0.5) / rows) * math.pi)


def row_solid_angles(shape: tuple[int, int]) -> Doubles:
    """Return the solid angle (ROWS, 1) in sr of one pixel of each row of a whole panorama."""
    edges = np.sin((0.5 - np.arange(shape[0] + 1) / shape[0]) * math.pi)
    return np.asarray((edges[:-1] - edges[1:])[:, None] * (2 * math.pi / shape[1]))


def summed(labels: Int32s, *parts: Flags | Floats | int) -> tuple[AnyArray, ...]:
    """Return, for each of the ``parts`` (H, W), its solid angle (sr) by the labels (H, W) of a whole panorama."""
    weight = row_solid_angles((labels.shape[0], labels.shape[1]))
    return tuple(np.bincount(labels.ravel(), np.broadcast_to(weight * part, labels.shape).ravel()) for part in parts)


def share_of_sphere(mask: Flags) -> float:
    """Return which part of the sphere a mask (H, W) of a whole panorama covers, 0..1."""
    return float(np.count_nonzero(mask, axis=1) @ row_solid_angles(mask.shape[:2])[:, 0] / (4 * math.pi))


def components(mask: Flags) -> tuple[int, Int32s]:
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
    pairs = [(int(left[i]), int(right[i + s])) for s in (-1, 0, 1) for i in range(max(0, -s), len(left) - max(0, s))]
    for row in (labels[0], labels[-1]):
        met = np.unique(row[row > 0])
        pairs += [(int(met[0]), int(one)) for one in met[1:]]
    for one, other in pairs:
        if one and other:
            a, b = sorted((root(one), root(other)))
            parent[b] = a
    kept, numbers = np.unique(np.array([root(one) for one in range(count)]), return_inverse=True)
    return len(kept) - 1, np.asarray(labels if len(kept) == count else numbers.astype(np.int32)[labels], np.int32)


def spanned(part: Flags) -> tuple[Indices, Indices]:
    """Return the rows (N,) and the columns (M,) that hold some of a ``part`` (H, W), which must hold some pixel.

    Columns run on round the seam: those before it are given as negative, -W to -1.
    """
    columns = np.flatnonzero(part.any(axis=0))
    widest = int(np.diff(columns, append=columns[0] + part.shape[1]).argmax()) + 1
    around = np.concatenate([columns[widest:] - part.shape[1], columns[:widest]])
    return np.flatnonzero(part.any(axis=1)), around


def grown(mask: Flags, angle_rad: float) -> Flags:
    """Return all places within an angle of a mask (H, W), on the sphere: exact for the middles of pixels."""
    rows, columns = mask.shape
    found = mask.copy()
    if angle_rad <= 0 or not mask.any():
        return found
    latitude, step = row_latitudes(rows), math.pi / rows
    reach = math.ceil(angle_rad / step)
    some = np.asarray(mask.any(axis=1), bool)
    away = _columns_away(mask)
    for down in range(-reach, reach + 1):
        source = np.arange(max(0, -down), min(rows, rows - down))
        source = source[some[source]]
        if not source.size:
            continue
        half = _half_widths(latitude[source], latitude[source + down], angle_rad, columns)
        for row, widest in zip(source, half, strict=True):
            found[row + down] |= away[row] <= widest
    return found


def _columns_away(mask: Flags) -> Int16s | Int32s:
    """Return how many columns each place is from the nearest of its row's mask, round the seam; more than all: none."""
    columns = mask.shape[1]
    kind = np.int16 if 3 * columns < np.iinfo(np.int16).max else np.int32
    place = np.arange(columns, dtype=kind)
    left = np.where(mask, place, kind(-columns))
    np.maximum.accumulate(left, axis=1, out=left)
    # Before a row's first place, the nearest on the left is its last one, beyond the seam.
    beyond = left[:, -1:] - kind(columns)
    left = np.minimum(place - np.maximum(left, beyond), kind(2 * columns))
    right = np.where(mask, place, kind(2 * columns))
    right = np.minimum.accumulate(right[:, ::-1], axis=1)[:, ::-1]
    right = np.minimum(right, right[:, :1] + kind(columns)) - place
    return np.asarray(np.minimum(left, right))


def _half_widths(here: Doubles, there: Doubles, angle_rad: float, columns: int) -> Int64s:
    """Return how many columns to either side lie within an angle, from latitudes to others; -1: none does."""
    level = np.maximum(np.cos(here) * np.cos(there), 1e-12)
    cosine = (math.cos(angle_rad) - np.sin(here) * np.sin(there)) / level
    half = np.arccos(np.clip(cosine, -1, 1)) / (2 * math.pi / columns)
    # Rounding must not take the place itself.
    none = (cosine > 1 + 1e-9) & (np.abs(here - there) > angle_rad)
    return np.where(none, -1, np.minimum(np.floor(half + 1e-9), columns // 2)).astype(np.int64)


def resized(values: Floats, shape: tuple[int, int]) -> Floats:
    """Return a picture (H, W) or (H, W, C) of the whole sphere at another size: by area down, linear up, round."""
    height, width = values.shape[:2]
    if (height, width) == shape:
        return np.asarray(values, dtype=np.float32)
    if shape[0] <= height and shape[1] <= width:
        halved = height == 2 * shape[0]
        return _by_channel(values, lambda one: cv2.resize(one, shape[::-1], interpolation=cv2.INTER_AREA), apart=halved)
    pad = 2
    wide = wrapped(values, pad)
    x = ((np.arange(shape[1]) + 0.5) / (shape[1] / width) - 0.5 + pad).astype(np.float32)
    y = ((np.arange(shape[0]) + 0.5) * (height / shape[0]) - 0.5).astype(np.float32)
    bands = np.array_split(np.clip(y, 0, height - 1), -(-shape[0] // 256))  # that stay in the processor's cache
    how: Any = {"interpolation": cv2.INTER_LINEAR, "borderMode": cv2.BORDER_REPLICATE}
    return _by_channel(wide, lambda one: np.concatenate([cv2.remap(one, *np.meshgrid(x, y), **how) for y in bands]))


def _by_channel(values: Floats, change: Callable[[Floats], npt.ArrayLike], *, apart: bool = False) -> Floats:
    """Return a picture changed channel by channel: OpenCV takes no more than four at once everywhere.

    Three are changed together, for a quarter of the time, and the same but for rounding where one is halved: ``apart``.
    """
    if values.ndim == 2 or (values.shape[2] == 3 and not apart):
        return np.asarray(change(np.ascontiguousarray(values, np.float32)), np.float32)
    layers = [_by_channel(values[..., k], change) for k in range(values.shape[2])]
    return np.stack(layers, axis=-1)


def smoothed(values: Floats, angle_rad: float) -> Floats:
    """Return a picture (H, W) or (H, W, C) smoothed by a Gaussian of a standard deviation on the equator, round; a wide
    one (`WIDE_PX`) is worked out at half the size, to 2 % of the range of values."""
    sigma_px = angle_rad / (math.pi / values.shape[0])
    if sigma_px < 0.3:
        return values
    if sigma_px > WIDE_PX:
        half = resized(values, (-(-values.shape[0] // 2), -(-values.shape[1] // 2)))
        return resized(smoothed(half, angle_rad), (values.shape[0], values.shape[1]))
    pad = min(math.ceil(3 * sigma_px), values.shape[1])
    out = cv2.GaussianBlur(wrapped(values, pad), (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(out[:, pad : pad + values.shape[1]], dtype=np.float32)
