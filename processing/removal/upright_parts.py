"""Walls of more than one colour: posts, panels, jambs and doors that furniture hides the lower end of; pictures.

Their edges run upright, so behind what hides them too. A wall is divided where such an edge comes down to a hole that
reaches its foot, and each part is filled by itself: no colour runs into the next one.
"""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from processing.ground.arrays import Flags, Floats, Indices
from processing.removal.illumination import ToneScale

# Chosen by looking at four furnished real rooms (docs/measurements/real.md).
STEP = 0.18  # tone by which both sides of an edge differ: less is the light's or a joint of boards
SIDE_M, SIDE_PX = 0.03, 3  # of what is compared on both sides; at least
LONG_M, ALONG = 0.7, 0.85
"""How far an edge must be seen above the hole, and in what share of the rows: pictures and mirrors end before."""
HEAD_M, CEILING_M = 1.85, 0.35
"""Above the floor, up to which an edge reaches at least: doors do; below the ceiling, that of a thing: curtains do."""
NEAR_M, NEAR_SHARE = 0.15, 0.5  # just above the hole, where so much of an edge must be seen, too: what ends there hangs
FOOT_M, MOSTLY = 0.3, 0.8
"""Above the floor, as far as a hole may end and still reach the wall's foot; share of a column that it is from there.
"""
MOSTLY_THING = 0.5  # of what is seen of a wall's part, from which it is a thing and no wall (chosen)
LOWER_M, LOWER_SHARE = 0.25, 0.4
"""Above the hole, from where on down so much of a row may be the lower edge of what hangs, or of its frame."""
NARROW_M = 0.25  # width up to which what hides a wall hides no edge of it: poles, cables, lamps' stands
GAP_M, GAP_PX = 0.05, 2  # above the hole's rim, of mixed pixels; at least


class Part(NamedTuple):
    """Columns of a wall between two upright edges."""

    columns: slice
    top: int
    """Row from which on down it is one surface: above a door's lintel is wall."""


def upright_parts(values: Floats, seen: tuple[Flags, Flags], hole: Flags, px_per_m: float) -> list[Part]:
    """Return the parts, from left to right, of a wall's texture (H, W, 3), linear light: one without upright edges.

    ``seen``: what may be learnt from, and what is probably no part of the wall, (H, W) each; an edge counts only above
    the ``hole`` (H, W).
    """
    (known, things), (height, width) = seen, hole.shape
    values, known, narrow = _bridged(values, known, px_per_m)
    hole = hole & ~narrow
    rim, side = _rims(hole, px_per_m), side_px(px_per_m)
    tone = ToneScale.of(values, known).tone(values)
    step, level = steps(tone, known, side), level_edges(tone, known, side)
    beside = cv2.dilate(things.astype(np.uint8), np.ones((1, 2 * side + 1), np.uint8)).astype(bool)
    strength, tops = np.zeros(width), np.zeros(width, int)
    gap = max(GAP_PX, round(GAP_M * px_per_m))
    for x in np.flatnonzero(rim < height):
        # Of a ragged rim, its highest place beside the edge, else its own.
        for start in (int(rim[max(0, x - side) : x + side + 1].min()), int(rim[x])):
            low = max(0, start - gap)
            top = _upper_end(step[:low, x], px_per_m)
            if top is None:
                continue
            of_thing = beside[top:low, x].mean() > 0.5
            if top <= (CEILING_M * px_per_m if of_thing else height - HEAD_M * px_per_m):
                strength[x], tops[x] = np.abs(step[top:low, x]).mean(), top
                break
    edges = []
    while strength.max() > 0:
        best = int(strength.argmax())
        edges.append((best, int(tops[best])))
        strength[max(0, best - 2 * side) : best + 2 * side + 1] = 0
    return _between(_standing(sorted(edges), (known, things, level), rim, px_per_m), width)


def _bridged(values: Floats, known: Flags, px_per_m: float) -> tuple[Floats, Flags, Flags]:
    """Return values (H, W, 3), what is ``known`` of them, and the gaps (H, W) up to `NARROW_M` wide that were bridged:
    each half is as what is seen beside it, so that an edge that runs behind a pole stands in its middle."""
    wide = np.ones((1, round(NARROW_M * px_per_m) + 1), np.uint8)
    unknown = (~known).astype(np.uint8)
    narrow = ~known & (cv2.morphologyEx(unknown, cv2.MORPH_OPEN, wide, borderType=cv2.BORDER_REPLICATE) == 0)
    columns = np.arange(known.shape[1])
    left = np.maximum.accumulate(np.where(known, columns, -known.shape[1]), axis=1)
    right = np.minimum.accumulate(np.where(known, columns, 2 * known.shape[1])[:, ::-1], axis=1)[:, ::-1]
    nearest = np.where(narrow, np.where(columns - left <= right - columns, left, right), columns)
    return np.take_along_axis(values, nearest[..., None], axis=1), known | narrow, narrow


def _standing(
    edges: list[tuple[int, int]], seen: tuple[Flags, Flags, Flags], rim: Indices, px_per_m: float
) -> list[tuple[int, int]]:
    """Return the edges (column, upper end) without those of pictures: things that end below the ceiling, and whose
    lower frame is seen, or which lie too high to be anything else.

    Of the other edge of one, which is hidden, nobody knows. ``seen``: as of `upright_parts`, and edges that run level,
    (H, W) each; ``rim`` (W,): where the hole begins."""
    known, things, level = seen
    rows, near, gone = np.arange(len(known))[:, None], max(1, round(NEAR_M * px_per_m)), set()
    for columns, top in _between(edges, len(rim)):
        own = known[:, columns] & (rows >= top) & (rows < rim[columns])
        thing = own & things[:, columns]
        low = int(np.median(rim[columns]))
        hung = top > CEILING_M * px_per_m and ends_level(level[:, columns], low, px_per_m)
        hung |= _cut(top, low, known, px_per_m)
        if hung and thing.sum() > MOSTLY_THING * own.sum():
            beside = {columns.start: thing[:, :near], columns.stop: thing[:, -near:]}
            gone |= {column for column, part in beside.items() if part.any()}
    return [edge for edge in edges if edge[0] not in gone]


def _rims(hole: Flags, px_per_m: float) -> Indices:
    """Return, for each column, the highest row of the hole that reaches the wall's foot; H where none does.

    Rests of things may be seen in it."""
    height = len(hole)
    upward = hole[::-1]
    near = upward[: max(1, round(FOOT_M * px_per_m))].any(axis=0)
    share = np.cumsum(upward, axis=0) / np.arange(1, height + 1)[:, None]
    within = upward & (share >= MOSTLY)
    return np.where(near & within.any(axis=0), within[::-1].argmax(axis=0), height)


def side_px(px_per_m: float) -> int:
    """Return how many texels are compared on either side of an edge."""
    return max(SIDE_PX, round(SIDE_M * px_per_m))


def steps(tone: Floats, known: Flags, side: int) -> Floats:
    """Return (H, W): by how much the tone is higher on the right of each texel than on its left, in the channel where
    it is most; 0 where either side is not known."""
    share = cv2.blur(known.astype(np.float32), (side, 1), borderType=cv2.BORDER_CONSTANT)
    mean = cv2.blur(np.where(known[..., None], tone, 0).astype(np.float32), (side, 1), borderType=cv2.BORDER_CONSTANT)
    mean = mean / np.maximum(share, 1e-6)[..., None]
    off = side // 2 + 1
    right, left = np.roll(mean, -off, axis=1), np.roll(mean, off, axis=1)
    both = (np.roll(share, -off, axis=1) > 0.5) & (np.roll(share, off, axis=1) > 0.5)
    both[:, :off] = both[:, -off:] = False
    apart = right - left
    most = np.abs(apart).argmax(axis=-1)[..., None]
    return np.where(both, np.take_along_axis(apart, most, axis=-1)[..., 0], 0).astype(np.float32)


def level_edges(tone: Floats, known: Flags, side: int) -> Flags:
    """Return (H, W): where tones above and below differ by more than `STEP`; see `steps`."""
    return np.asarray(np.abs(steps(tone.swapaxes(0, 1), known.T, side).T) > STEP)


def ends_level(level: Flags, low: int, px_per_m: float) -> bool:
    """Return whether what comes down to the row ``low`` has a lower edge, by its columns' level edges (H, W)."""
    start = max(0, low - round(LOWER_M * px_per_m))
    return bool(level[start:].mean(axis=1).max(initial=0.0) > LOWER_SHARE)


def _upper_end(step: Floats, px_per_m: float) -> int | None:
    """Return the highest row of an edge that comes down to the last of a column's steps (N,); None where none does."""
    count = len(step)
    long, near = (max(1, round(length_m * px_per_m)) for length_m in (LONG_M, NEAR_M))
    if count < long:
        return None
    run = (np.abs(step) > STEP) & (np.sign(step) == np.sign(np.median(step[-long:])))
    if run[-long:].mean() < ALONG or run[-near:].mean() < NEAR_SHARE:
        return None
    share = np.cumsum(run[::-1]) / np.arange(1, count + 1)
    return count - 1 - int(np.flatnonzero((share >= ALONG) & run[::-1])[-1])


def _between(edges: list[tuple[int, int]], width: int) -> list[Part]:
    """Return the parts between edges (column, upper end): each as high as both of its edges go."""
    borders = [(0, 0), *edges, (width, 0)]
    return [Part(slice(left, right), max(high, other)) for (left, high), (right, other) in itertools.pairwise(borders)]


# Pictures and mirrors on walls that lose a part to what is removed before them: a rectangle is seen to go on.
#
# Chosen by the demo's room and eight furnished real ones (docs/measurements/real.md).
AROUND_M = 0.25  # of a thing as the network sees it: where its frame may end, and whose median is the wall's paint
UNLIKE = 0.12  # tone by which a picture or its frame differs from the paint around it
LEAST_M, MOST_M = 0.15, 2.5  # sides of a picture
LOST = (0.005, 0.35)  # share of its rectangle that is removed: less is its rim, of more nobody knows what it was
FULL = 0.95  # of its rectangle as far as that is seen, that it fills: others are several things, or have no corners
ROW_SEEN = 0.25  # of the outermost rows and columns of a picture
RIM_M = 0.3  # below the ceiling and above the floor, within which what ends is a curtain or stands
CUT_M = (1.0, 1.98)  # above the floor: between them lies a picture cut all along; glass doors and curtains do not
CLOSED_M = 0.04  # of the upper frame, that is the lower one of a picture cut all along


def torn_pictures(
    values: Floats, known: Flags, things: Flags, hole: Flags, px_per_m: float
) -> Iterator[tuple[Flags, int]]:
    """Yield the rectangle (H, W) of each picture on a wall of which a part is in the ``hole`` (H, W), and how many of
    its last rows are as the first ones: of one that is cut all along nobody knows where it ended, so it ends there.

    ``values`` (H, W, 3): the wall's texture, linear light, where ``known`` (H, W); ``things`` (H, W): what is probably
    no part of it.
    """
    if not (known & things).any() or not (known & ~things).any():
        return
    tone = ToneScale.of(values, known).tone(values)
    around, least = round(AROUND_M * px_per_m), LEAST_M * px_per_m
    labels, _ = ndimage.label(known & things)
    for number, thing in enumerate(ndimage.find_objects(labels), 1):
        if min(side.stop - side.start for side in thing) < least:
            continue
        rows, columns = (slice(max(0, side.start - around), side.stop + around) for side in thing)
        part = np.s_[rows, columns]
        mine, paint = labels[part] == number, known[part] & ~things[part]
        if not paint.any():
            continue
        off = np.abs(tone[part] - np.median(tone[part][paint], axis=0)).max(axis=-1)
        unlike = known[part] & (off > UNLIKE)
        unlike = cv2.morphologyEx(unlike.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        found = _rectangle(unlike.astype(bool), mine, hole[part])
        if found is None:
            continue
        box = rows.start + found[0].start, rows.start + found[0].stop
        across = slice(columns.start + found[1].start, columns.start + found[1].stop)
        whole, side, low = np.zeros_like(hole), side_px(px_per_m), found[0].stop
        whole[slice(*box), across] = True
        if not _is_picture(whole, px_per_m):
            continue
        # Glass doors and curtains show no lower edge: they go on down.
        level = level_edges(tone[part], known[part], side)[: low + side, found[1]]
        closed = max(1, round(CLOSED_M * px_per_m))
        below = hole[box[1] : box[1] + 2 * closed, across].all(axis=1)  # of a ragged rim
        if ends_level(level, low, px_per_m):
            yield whole, 0
        elif _cut(*box, whole, px_per_m) and things[whole & known].mean() > MOSTLY_THING and below.any():
            whole[box[1] : box[1] + int(below.argmax()) + closed, across] = True
            yield whole, closed


def _cut(top: int, low: int, wall: Flags, px_per_m: float) -> bool:
    """Return whether a thing that is seen between two rows of a ``wall`` (H, W), with no lower frame, is a picture."""
    return (len(wall) - low) / px_per_m > CUT_M[0] and (len(wall) - top) / px_per_m < CUT_M[1]


def _rectangle(unlike: Flags, thing: Flags, hole: Flags) -> tuple[slice, slice] | None:
    """Return the box of what is ``unlike`` the wall and hangs together with a thing, (H, W) each; None where it is none
    that the ``hole`` (H, W) cuts."""
    labels, count = ndimage.label(unlike)
    if not count:
        return None
    sizes = np.bincount(labels[thing], minlength=count + 1)
    sizes[0] = 0
    if not sizes.any():
        return None
    own = labels == sizes.argmax()
    box: tuple[slice, slice] = ndimage.find_objects(own.astype(np.int32))[0]
    # Shade below it is narrower than its frame.
    for axis in (0, 1):
        wide = np.flatnonzero(own[box].mean(axis=1 - axis) > ROW_SEEN)
        if not wide.size:
            return None
        side = slice(box[axis].start + int(wide[0]), box[axis].start + int(wide[-1]) + 1)
        box = (side, box[1]) if axis == 0 else (box[0], side)
    seen, lost = ~hole[box], float(hole[box].mean())
    if not LOST[0] < lost < LOST[1]:
        return None
    return box if (ndimage.binary_fill_holes(own | hole)[box] & seen).sum() > FULL * seen.sum() else None


def _is_picture(whole: Flags, px_per_m: float) -> bool:
    """Return whether a rectangle (H, W) of a wall is as large as a picture, and hangs."""
    rows, columns = (np.flatnonzero(whole.any(axis=axis)) for axis in (1, 0))
    sides = [len(one) / px_per_m for one in (rows, columns)]
    hangs = rows[0] > RIM_M * px_per_m and rows[-1] < len(whole) - RIM_M * px_per_m
    return bool(hangs and min(sides) >= LEAST_M and max(sides) <= MOST_M)
