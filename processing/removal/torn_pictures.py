"""Pictures and mirrors on walls that lose a part to what is removed before them: a rectangle is seen to go on."""

from collections.abc import Iterator

import cv2
import numpy as np
from scipy import ndimage

from processing.ground.arrays import Flags, Floats
from processing.removal.illumination import ToneScale
from processing.removal.upright_parts import ends_level, level_edges, side_px

# Chosen by the demo's room and eight furnished real ones (docs/measurements/real.md).
AROUND_M = 0.25  # of a thing as the network sees it: where its frame may end, and whose median is the wall's paint
UNLIKE = 0.12  # tone by which a picture or its frame differs from the paint around it
LEAST_M, MOST_M = 0.15, 2.5  # sides of a picture
LOST = (0.005, 0.35)  # share of its rectangle that is removed: less is its rim, of more nobody knows what it was
FULL = 0.95  # of its rectangle as far as that is seen, that it fills: others are several things, or have no corners
ROW_SEEN = 0.25  # of the highest and the lowest row of a picture
RIM_M = 0.3  # below the ceiling and above the floor, within which what ends is a curtain or stands


def torn_pictures(values: Floats, known: Flags, things: Flags, hole: Flags, px_per_m: float) -> Iterator[Flags]:
    """Yield the rectangle (H, W) of each picture on a wall of which a part is in the ``hole`` (H, W).

    ``values`` (H, W, 3): the wall's texture, linear light, where ``known`` (H, W); ``things`` (H, W): what is probably
    no part of it.
    """
    if not (known & things).any() or not (known & ~things).any():
        return
    tone = ToneScale.of(values, known).tone(values)
    around, least = round(AROUND_M * px_per_m), LEAST_M * px_per_m
    labels, _ = ndimage.label(known & things)
    for number, box in enumerate(ndimage.find_objects(labels), 1):
        if min(side.stop - side.start for side in box) < least:
            continue
        rows, columns = (slice(max(0, side.start - around), side.stop + around) for side in box)
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
        whole, side, low = np.zeros_like(hole), side_px(px_per_m), found[0].stop
        whole[part][found] = True
        # Glass doors and curtains show no lower edge: they go on down.
        level = level_edges(tone[part], known[part], side)[: low + side, found[1]]
        if _is_picture(whole, px_per_m) and ends_level(level, low, px_per_m):
            yield whole


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
    wide = np.flatnonzero(own[box].mean(axis=1) > ROW_SEEN)
    if not wide.size:
        return None
    box = (slice(box[0].start + int(wide[0]), box[0].start + int(wide[-1]) + 1), box[1])
    seen, lost = ~hole[box], float(hole[box].mean())
    if not LOST[0] < lost < LOST[1]:
        return None
    full = ndimage.binary_fill_holes(own | hole)[box] & seen
    return box if full.sum() > FULL * seen.sum() else None


def _is_picture(whole: Flags, px_per_m: float) -> bool:
    """Return whether a rectangle (H, W) of a wall is as large as a picture, and hangs."""
    rows, columns = (np.flatnonzero(whole.any(axis=axis)) for axis in (1, 0))
    sides = [len(one) / px_per_m for one in (rows, columns)]
    hangs = rows[0] > RIM_M * px_per_m and rows[-1] < len(whole) - RIM_M * px_per_m
    return bool(hangs and min(sides) >= LEAST_M and max(sides) <= MOST_M)
