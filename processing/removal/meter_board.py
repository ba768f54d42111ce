"""The meter's white board and its stand, from where the meter looked: a session says so, and no network need guess.

The board is the even, four-cornered region at the target; its stand is what is thin, hangs together with the board's
lower edge, and reaches down from there. A sheet on a wall or on furniture has no stand.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Flags, Floats
from processing.removal.round_masks import row_latitudes, row_solid_angles

STEPS_STOPS = (0.03, 0.06, 0.10, 0.20)
"""Between neighbours of one even surface, more is an edge: a dim board before a white wall needs the least."""
LEAST_SR, MOST_SR = 6e-4, 0.35
"""From a sheet of paper at 5 m to half a metre at 0.9 m."""
LEAST_FILLED = 0.85
"""Of the rectangle around it, turned as fits best: a wall's remains and a floor's patches fill less."""
MOST_LATITUDE_RAD = math.radians(60)
THIN_RAD = math.radians(3.5)
"""What is narrower may be a pole or a leg; what is wider is left to other evidence."""
STAND_STOPS, POLE_STOPS = 0.35, 0.12
"""By which a leg, and a pole over its length, differs from what is beside it."""
TEXTURE_SHARE, TEXTURE_TIMES = 0.75, 2.5
"""What this share of a row beside the stand does not exceed is texture; a stand differs by this many times as much."""
POLE_REACH, POLE_RAD = 0.1, math.radians(3)
"""Of the board's width, how far from its middle a pole is looked for; over which length it is averaged."""
REACH = 0.4
"""Of the board's width, to either side of its middle: how far legs spread."""
LEAST_POLE_RAD = math.radians(4)
"""Below the board, from which it stands on something of its own."""


def meter_board(luminance: Floats, target: tuple[float, float]) -> tuple[Flags, bool]:
    """Return the mask (H, W) of board and stand in an upright panorama, and whether there is a stand.

    Parameters
    ----------
    luminance
        (H, W) float32, any scale; W = 2 H. What is not finite or not above zero is no part of a board.
    target
        Where the meter looked: longitude and latitude in rad.

    Nothing is marked where no board is seen at the target (a wall was measured, the target lies beyond 60 degrees).
    """
    height, width = luminance.shape
    nothing = np.zeros((height, width), bool)
    if not all(map(math.isfinite, target)) or abs(target[1]) > MOST_LATITUDE_RAD:
        return nothing, False
    middle, row = width // 2, min(int((0.5 - target[1] / math.pi) * height), height - 1)
    shift = middle - int((target[0] / (2 * math.pi) + 0.5) * width)
    known = np.isfinite(luminance) & (luminance > 0)
    level = np.log2(np.where(known, luminance, np.float32(1e-6))).astype(np.float32)
    level = np.roll(level, shift, axis=1)
    board = _even_region(np.asarray(cv2.medianBlur(level, 3), np.float32), np.roll(known, shift, axis=1), (row, middle))
    if board is None:
        return nothing, False
    stand = _stand(level, board)
    return np.roll(board | stand, -shift, axis=1), bool(stand.any())


def _even_region(level: Floats, known: Flags, seed: tuple[int, int]) -> Flags | None:
    """Return the largest region around a place that has no edges in it and can be a board; None where none can."""
    across = np.abs(np.diff(level, axis=1, append=level[:, -1:]))
    down = np.abs(np.diff(level, axis=0, append=level[-1:]))
    weight = row_solid_angles((level.shape[0], level.shape[1]))
    found = None
    for step in STEPS_STOPS:
        free = (across < step) & (down < step) & known
        near = _nearest(free, seed)
        if near is None:
            continue
        _, labels = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
        region = labels == labels[near]
        rows, columns = np.nonzero(region)
        size_sr = float((region.sum(axis=1) * weight.ravel()).sum())
        if LEAST_SR <= size_sr <= MOST_SR and _filled(rows, columns, level.shape[0]) >= LEAST_FILLED:
            found = region
    if found is None:
        return None
    # Its edge, which is half board and half what is behind it, goes with it.
    return np.asarray(cv2.dilate(found.astype(np.uint8), np.ones((5, 5), np.uint8)), bool)


def _nearest(free: Flags, seed: tuple[int, int]) -> tuple[int, int] | None:
    """Return the place without an edge next to a place, at most two pixels away."""
    row, column = seed
    around = [(row + r, column + c) for r in (0, -1, 1, -2, 2) for c in (0, -1, 1, -2, 2)]
    inside = [(r, c) for r, c in around if 0 <= r < free.shape[0]]
    return next((place for place in inside if free[place]), None)


def _filled(rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp], height: int) -> float:
    """Return the share of the smallest rectangle around pixels that they fill, on a plane that touches the sphere."""
    latitude = row_latitudes(height)[rows]
    centre = float(latitude.mean())
    longitude = (columns - columns.mean()) * (math.pi / height)
    ahead = np.sin(centre) * np.sin(latitude) + np.cos(centre) * np.cos(latitude) * np.cos(longitude)
    x = np.cos(latitude) * np.sin(longitude) / ahead
    y = (np.cos(centre) * np.sin(latitude) - np.sin(centre) * np.cos(latitude) * np.cos(longitude)) / ahead
    if ahead.min() <= 0.2:
        return 0.0
    points = np.stack([x, y], axis=1).astype(np.float32)
    pixel = math.pi / height
    (_, (wide, high), _) = cv2.minAreaRect(points)
    area = float((np.cos(latitude) / ahead**3).sum()) * pixel**2
    return area / ((wide + pixel) * (high + pixel))


def _stand(level: Floats, board: Flags) -> Flags:
    """Return what is thin, unlike what is beside it, and hangs from the board's lower edge."""
    height = level.shape[0]
    rows, columns = np.nonzero(board)
    low, left, right = int(rows.max()), int(columns.min()), int(columns.max())
    window, narrow = np.zeros_like(board), np.zeros_like(board)
    for mask, share in ((window, REACH), (narrow, POLE_REACH)):
        reach = max(2, round(share * (right - left)))
        mask[low - 2 :, (left + right) // 2 - reach : (left + right) // 2 + reach + 1] = True
    wide = 2 * (right - left)
    beside = np.r_[max(0, left - wide) : left, right : min(level.shape[1], right + wide)]
    brush = max(3, round(THIN_RAD / math.pi * height)) | 1
    long = max(3, round(POLE_RAD / math.pi * height)) | 1
    poles = _unlike(np.asarray(cv2.blur(level, (1, long)), np.float32), (brush, 1))
    legs = np.maximum(_unlike(level, (brush, 1)), _unlike(level, (brush, brush)))
    pole = (poles > np.maximum(POLE_STOPS, _usual(poles, beside))) & narrow
    seen = ((pole | ((legs > np.maximum(STAND_STOPS, _usual(legs, beside))) & window)) & ~board).astype(np.uint8)
    thin = np.asarray(cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8)), np.uint8)
    _, labels = cv2.connectedComponents(thin, connectivity=8)
    hanging = np.unique(labels[low : low + 4][narrow[low : low + 4]])
    found = np.isin(labels, hanging[hanging > 0])
    depth = (int(np.nonzero(found)[0].max()) - low) * math.pi / height if found.any() else 0.0
    if depth < LEAST_POLE_RAD:
        return np.zeros_like(board)
    return np.asarray(cv2.dilate(found.astype(np.uint8), np.ones((3, 3), np.uint8)), bool)


def _usual(unlike: Floats, beside: npt.NDArray[np.intp]) -> Floats:
    """Return (H, 1): by how much a stand must differ from what is beside it; a carpet's texture does not."""
    texture = np.quantile(unlike[:, beside], TEXTURE_SHARE, axis=1).astype(np.float32)[:, None]
    return np.asarray(TEXTURE_TIMES * cv2.blur(texture, (1, 9)), np.float32)


def _unlike(level: Floats, brush: tuple[int, int]) -> Floats:
    """Return by how much each place is darker or brighter than what lies a brush's width away on both sides."""
    shape = cv2.getStructuringElement(cv2.MORPH_RECT, brush)
    hats = [cv2.morphologyEx(level, how, shape) for how in (cv2.MORPH_BLACKHAT, cv2.MORPH_TOPHAT)]
    return np.asarray(np.maximum(*hats), np.float32)
