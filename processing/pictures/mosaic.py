"""A raw file's wells as a picture in the camera's own colours, before any matrix; and the matrix that the file states.

In each frame every channel is interpolated from its own wells alone, so that a saturated well spoils no other channel.
What is merged from a bracket is interpolated anew, with all channels.
"""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from processing.errors import PictureFileError
from processing.ground.arrays import Doubles, Floats, Indices, UInt16s

FULL = 65535.0  # largest code of 16 bits
PEDESTAL = 512.0  # code of no light, so that noise below black is kept; chosen: 30 sigma of a good sensor's
SATURATED = 0.98  # of the file's white level; chosen: wells' gains differ by less
PILE, PILED = 0.005, 4  # of the top level, to both sides; how many more wells there than in as much below; chosen
LEAST_PILE, LEAST_WELLS = 1e-4, 100  # of the wells looked at, and in all: fewer are hot ones, or chance; chosen
LEAST_WHITE = 0.5  # of the stated white level; chosen: below, an even dark picture would look like a pile
EVEN = 0.01  # of log light: two directions that differ by less are alike; chosen
HOT = 0.15  # of log light, by which a well is brighter than all eight of its colour around it; chosen
_SAME = np.zeros((5, 5), np.uint8)
_SAME[::2, ::2], _SAME[2, 2] = 1, 0
_AROUND = (_SAME / 8).astype(np.float32)
_BESIDE = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.uint8)
_ALONG = tuple(np.array(t, np.float32) for t in ((0.5, 0, 0.5), (-0.25, 0, 0.5, 0, -0.25), (-1, 0, 1)))
_NEAR = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], np.float32)


def saturation(raw: Any) -> float:
    """Return where an opened raw file's wells saturate, of the white level stated for its camera, above black; up to 1.

    By the file's own levels, and where wells pile up at the top, more closely than photons' noise would have them.
    """
    wells, black = raw.raw_image_visible[::5], float(np.mean(raw.black_level_per_channel))  # odd: all wells of a cell
    reach = max(float(raw.white_level) - black, 1.0)
    above = np.append(np.cumsum(np.bincount(wells.ravel())[::-1])[::-1], 0)  # wells of a code or a higher one
    top = int(np.count_nonzero(above >= max(LEAST_PILE * wells.size, LEAST_WELLS))) - 1
    ends = [math.ceil(top + k * PILE * (top - black)) for k in (-3, -1, 1)]
    lower, low, over = (int(n) for n in above[np.clip(ends, 0, len(above) - 1)])
    piled = low - over > PILED * max(lower - low, over)
    found = [*(raw.camera_white_level_per_channel or ()), *([top] if piled else [])]
    share = min((one - black for one in found if one - black > LEAST_WHITE * reach), default=reach) / reach
    return share if share < SATURATED else 1.0


def camera_rgb(raw: Any, white: float = 1.0) -> UInt16s:
    """Return (H, W, 3) of an opened raw file: `PEDESTAL` is black, `FULL` a saturated well or one interpolated from it.

    Bilinear, per channel; wells of a channel keep their own value. ``white``: see `saturation`.
    """
    colours = np.array(["RGB".index(chr(letter)) for letter in raw.color_desc])
    wells, place = raw.raw_image_visible, raw.raw_colors_visible
    black = np.array(raw.black_level_per_channel, np.float32)
    level = (wells - black[place]) / (np.float32(white) * (np.float32(raw.white_level) - black))[place]
    channel, full = colours[place], level >= SATURATED
    codes = np.empty((*wells.shape, 3), np.uint16)
    for c in range(3):
        mine = channel == c
        near = _filtered(np.where(mine, level, 0), _NEAR) / np.maximum(_filtered(mine.astype(np.float32), _NEAR), 1)
        spoilt = cv2.dilate((mine & full).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        code = np.rint(PEDESTAL + (FULL - PEDESTAL) * np.where(mine, level, near)).clip(0, FULL)
        codes[..., c] = np.where(np.where(mine, full, spoilt), FULL, code)
    return codes


_WORST_CONDITION = 100.0  # of a camera's matrix; chosen: cameras' are below 5


class CameraColours(NamedTuple):
    """What the channels of raw frames are."""

    matrix: Doubles
    """(3, 3): Rec. 709 of them. Light's own colour is kept: there is no white balance."""
    cell: Indices
    """(2, 2): the channel of each well of a cell of two by two, from the picture's corner."""


def camera_colours(raw: Any, name: str) -> CameraColours:
    """Return what an opened raw file states of its colours, by its matrix for daylight.

    White light (D65) of luminance 1 saturates the first channel that does. Raises `PictureFileError` for a file whose
    colours are not known.
    """
    colours, known = raw.color_desc.decode("ascii", "replace"), np.array(raw.color_matrix, np.float64)[:, :3]
    cell = None if raw.raw_pattern is None else np.array(raw.raw_pattern)
    if (
        not known.any()
        or not np.linalg.cond(known) < _WORST_CONDITION
        or set(colours) != set("RGB")
        or cell is None
        or cell.shape != (2, 2)
    ):
        what = f"its colours are unknown: filters {colours}, {'a' if known.any() else 'no'} matrix"
        raise PictureFileError(what, where=name, advice="give the camera's JPEGs")
    # LibRaw's matrix is of channels that are balanced for daylight.
    balance = np.array(raw.daylight_whitebalance[:3])
    return CameraColours(known * (balance / balance.min()), np.array(["RGB".index(c) for c in colours])[cell])


def demosaiced(rgb: Floats, cell: Indices, linear_below: float) -> Floats:
    """Return light (H, W, 3) with what lies between a channel's wells found anew from all channels together.

    For a merged picture, whose wells hold what no code can: interpolated along edges, not across (Hamilton and Adams
    1997, US 5,629,734), colours as ratios (Kimmel 1999), so in logarithms; in the light itself far below
    ``linear_below``, where noise would bias them. ``rgb``: camera_rgb's channels, at their wells as merged.
    """
    height, width = rgb.shape[:2]
    channel = np.tile(cell, (-(-height // 2), -(-width // 2)))[:height, :width]
    own = np.take_along_axis(rgb, channel[..., None], axis=2)[..., 0]
    log = np.log(np.maximum(own, -0.5 * linear_below) + linear_below, dtype=np.float32)
    # A hot well is brighter than those of its colour around it; a lamp as small brightens those beside it, too.
    excess = log - cv2.dilate(log, _SAME)
    hot = (excess > HOT) & (cv2.dilate(log - cv2.erode(log, _SAME), _BESIDE) < excess / 2)
    log = np.where(hot, _filtered(log, _AROUND), log)
    total = weights = np.zeros_like(log)
    for axis in (0, 1):
        mean, bend, step = (_filtered(log, np.expand_dims(taps, axis)) for taps in _ALONG)
        weight = (np.abs(step) + 4 * np.abs(bend) + EVEN) ** -2
        total, weights = total + weight * (mean + bend), weights + weight
    green = np.where(channel == 1, log, total / weights)
    out = np.repeat(green[..., None], 3, axis=2)
    for c in (0, 2):
        mine = (channel == c).astype(np.float32)
        ratio = _filtered((log - green) * mine, _NEAR) / np.maximum(_filtered(mine, _NEAR), 1)
        out[..., c] = np.where(mine > 0, log, green + ratio)
    return np.asarray(np.exp(out) - np.float32(linear_below))


def _filtered(plane: Floats, kernel: Floats) -> Floats:
    return np.asarray(cv2.filter2D(plane, -1, kernel, borderType=cv2.BORDER_REFLECT_101))
