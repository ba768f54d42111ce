"""The meter's board where the meter is known to have looked: the rectangle with edges along its sides and few inside.

On the plane that touches the sphere there, a board on a stand is an upright rectangle. All rectangles about the place
are compared; neither noise, nor light that changes across the board, nor a wall as bright beside one side hides it.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Indices
from processing.ground.board import on_tangent_plane
from processing.ground.seam import row_latitudes

VIEW_PX = 64  # side of the view in which it is looked for: 0.6 and 0.3 degrees a pixel; chosen
REACHES = (0.36, 0.18)
"""Half sides of that view on the tangent plane: for half a metre seen from 0.9 m, and for boards too small in it."""
LEAST_SIDE_PX = 6  # of the board in that view; chosen, less has no inside
EDGE_STOPS = 0.08  # over two pixels of that view, from which there is an edge for sure; chosen
TINT_SHARE = 0.5  # of an edge in log2 of blue over red: two channels' noise, a room's colours on the board; chosen
OFF_MIDDLE = 0.2  # of a side: how far beside the board's middle the meter looks at most; chosen
SLENDER = 1.8  # times as long as the other one a side is at most; chosen
RIM_PX = 2  # of the view: what an edge is wide, and not inside
LEAST_LIKELY = 0.42
"""Share of the sides that is edge, less that of the inside: 23 boards of 24 validation rooms have more, and 3 % of
other places there."""


class _Rectangle(NamedTuple):
    """A rectangle of whole pixels of a view, and how likely it is a board, up to 1."""

    likely: float
    reach: float
    left: int
    right: int
    top: int
    bottom: int


def board_around(level: Floats, seed: tuple[int, int], tint: Floats | None = None) -> Flags | None:
    """Return the pixels (H, W) of a board around a pixel, with its edge; None where nothing looks like one.

    ``level`` (H, W): finite log2 luminance of an upright whole panorama. ``seed``: row and column where the meter
    looked, the column far from the seam. ``tint`` (H, W): log2 of blue over red; its edges are the board's too.
    """
    found = max((_likeliest(level, seed, tint, reach) for reach in REACHES), key=lambda one: one.likely)
    if found.likely < LEAST_LIKELY:
        return None
    high, wide = level.shape
    longitude = (np.arange(wide) - seed[1]) * (2 * math.pi / wide)
    latitude = row_latitudes(high)
    u, v, ahead = on_tangent_plane(longitude[None, :], latitude[:, None], float(latitude[seed[0]]))
    across, down = ((1 + one / found.reach) * (VIEW_PX / 2) for one in (u, -v))
    inside = (found.left <= across) & (across <= found.right + 1) & (found.top <= down) & (down <= found.bottom + 1)
    board = (inside & (ahead > 0.5)).astype(np.uint8)
    return np.asarray(cv2.dilate(board, np.ones((3, 3), np.uint8)), bool)


def _likeliest(level: Floats, seed: tuple[int, int], tint: Floats | None, reach: float) -> _Rectangle:
    across, down = _edges(_view(level, seed, reach), 1.0)
    if tint is not None:
        other = _edges(_view(tint, seed, reach), TINT_SHARE)
        across, down = np.maximum(across, other[0]), np.maximum(down, other[1])
    # Sums along columns, along rows, and over boxes, so that any rectangle's sides and inside are differences. A side
    # may lie a pixel beside its edge: boards are turned, and lean.
    beside, brush = np.maximum(across, down), np.ones((1, 3), np.uint8)
    column = np.pad(np.cumsum(cv2.dilate(across, brush), axis=0), ((1, 0), (0, 0)))
    row = np.pad(np.cumsum(cv2.dilate(down, brush.T), axis=1), ((0, 0), (1, 0)))
    box = np.pad(np.cumsum(np.cumsum(beside, axis=0), axis=1), ((1, 0), (1, 0)))
    pairs = _sides()
    left, right = (one[:, None] for one in pairs)
    top, bottom = (one[None, :] for one in pairs)
    wide, high = right - left + 1, bottom - top + 1
    sides = [(column[bottom + 1, at] - column[top, at]) / high for at in (left, right)]
    sides += [(row[at, right + 1] - row[at, left]) / wide for at in (top, bottom)]
    low, far, up, end = left + RIM_PX, right + 1 - RIM_PX, top + RIM_PX, bottom + 1 - RIM_PX
    inside = (box[end, far] - box[up, far] - box[end, low] + box[up, low]) / ((far - low) * (end - up))
    weakest = np.minimum(np.minimum(sides[0], sides[1]), np.minimum(sides[2], sides[3]))
    likely = (weakest + sum(sides) / 4) / 2 - inside
    likely = np.where((wide < SLENDER * high) & (high < SLENDER * wide), likely, -1.0)
    first, second = np.unravel_index(int(likely.argmax()), likely.shape)
    ends = (int(one[k]) for k in (first, second) for one in pairs)
    return _Rectangle(float(likely[first, second]), reach, *ends)


def _sides() -> tuple[Indices, Indices]:
    """Return the first and last pixels of all stretches of a view that have its middle about theirs."""
    middle = VIEW_PX // 2
    first, last = np.meshgrid(np.arange(RIM_PX, middle), np.arange(middle, VIEW_PX - RIM_PX), indexing="ij")
    long = last - first
    good = (long >= LEAST_SIDE_PX) & (np.abs(first + last - 2 * middle) <= 2 * OFF_MIDDLE * long)
    return first[good], last[good]


def _view(values: Floats, seed: tuple[int, int], reach: float) -> Floats:
    """Return what lies within a reach of a pixel on the plane that touches the sphere there, (VIEW_PX, VIEW_PX)."""
    high, wide = values.shape
    at = ((np.arange(VIEW_PX) + 0.5) * (2 / VIEW_PX) - 1) * reach
    u, v = np.meshgrid(at, -at)
    middle_rad = float(row_latitudes(high)[seed[0]])
    sine, cosine = math.sin(middle_rad), math.cos(middle_rad)
    ahead, up = cosine - v * sine, sine + v * cosine
    x = seed[1] + np.arctan2(u, ahead) * (wide / (2 * math.pi))
    y = (0.5 - np.arctan2(up, np.hypot(u, ahead)) / math.pi) * high - 0.5
    coarser = reach / VIEW_PX * high / math.pi
    if coarser > 0.5:  # finer pictures are blurred first, that no pixel is skipped
        values = np.asarray(cv2.GaussianBlur(values, (0, 0), coarser), np.float32)
    return np.asarray(cv2.remap(values, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR), np.float32)


def _edges(view: Floats, share: float) -> tuple[Doubles, Doubles]:
    """Return 0..1 for each pixel of a view: how surely there is an edge across rows, and across columns."""
    found = []
    for axis in (1, 0):
        step = np.abs(np.diff(view, axis=axis))
        both = step.take(range(1, VIEW_PX - 1), axis) + step.take(range(VIEW_PX - 2), axis)
        padding = ((0, 0), (1, 1)) if axis else ((1, 1), (0, 0))
        found.append(np.pad(np.minimum(share / EDGE_STOPS * both, 1).astype(np.float64), padding))
    return found[0], found[1]
