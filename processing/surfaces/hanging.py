"""What hangs from the ceiling in the middle of a room and is seen before its walls: pendant lamps."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Flags, Floats, Indices, Int16s
from processing.ground.room_model import RoomModel
from processing.ground.seam import components
from processing.sphere import Equirectangular
from processing.surfaces.maps import CEILING, FIRST_WALL, boundary_latitudes, opening_map, wall_ranges

HALF_M, HALF_PX, LOW_M, BESIDE = 0.45, 170, 1.2, (0.6, 0.75)
"""Half the width that is looked at for what hangs from a ceiling, and its pixels; the height above the floor down to
which it may hang; shares of that half, from which on the surface behind is learnt, and nothing hangs (chosen)."""
ODD, CLEAR, BLUR, NOISE, ROUNDS, ALIKE_SIDES, SOLID, ROD = (2.8, 4.0), 12.0, 2.0, 0.003, 6, 0.7, 0.8, 0.15
"""In multiples of the noise of the surface behind, by which shades and rods before it differ, and clearly; deviation in
pixels over which shades are compared; least noise (natural logarithm); rounds of fitting; share of it that is seen on
both sides, and of its convex hull that is seen, from which all of these are it; of its width, below which a row is the
rod's (chosen by looking at a pale shade before a pale wall)."""
OPENING_ROWS = 512  # of the map by which a window behind is known (chosen)
SQUARE, DISC = np.ones((9, 9), np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (25, 25))
"""Gaps that are closed, and what is no rod, in pixels (chosen)."""


class Hanging(NamedTuple):
    """What hangs from the ceiling and is seen before a wall of a panorama (H, 2 H)."""

    row: Indices
    """(N,), and ``column`` (N,): its pixels."""
    column: Indices
    share: Floats
    """(N,), 0..1: how much of each pixel shows it."""
    mount: tuple[int, int]
    """Row and column of its place on the ceiling."""
    far_m: float
    """Level distance from the camera."""


def hanging(room: RoomModel, rgb: Floats, places: list[Any] | None) -> Iterator[Hanging]:
    """Yield what hangs from ``places`` (of `removal.rests.on_ceiling`) so low that it is seen before a wall.

    ``rgb`` (H, 2 H, 3): the upright panorama, linear light of any unit.
    """
    (high, wide), openings = rgb.shape[:2], opening_map(room, Equirectangular(2 * OPENING_ROWS, OPENING_ROWS))
    for x, y in places or ():
        if (far_m := math.hypot(x, y)) < 2 * HALF_M:
            continue  # above the camera
        half_rad = math.asin(HALF_M / far_m)
        heights_m = room.ceiling_height_m, min(LOW_M, room.ceiling_height_m / 2)
        top, low = (math.atan2(z_m - room.camera_height_m, far_m) for z_m in heights_m)
        mount = int((0.5 - top / math.pi) * high), int((math.atan2(x, y) / math.pi + 1) * high) % wide
        first, last = (int((0.5 - angle / math.pi) * high) for angle in (min(top + half_rad / 3, math.pi / 2), low))
        half_px = max(1, round(half_rad / math.pi * high))
        row, column = np.arange(first, last), np.arange(mount[1] - half_px, mount[1] + half_px + 1)
        # At one scale, whatever the size of the picture is.
        size = (2 * HALF_PX + 1, max(2, round(len(row) * HALF_PX / half_px)))
        seen = np.asarray(cv2.resize(rgb[row][:, column % wide], size, interpolation=cv2.INTER_AREA), np.float32)
        at, along = (np.linspace(one[0], one[-1], count) for one, count in zip((row, column), size[::-1], strict=True))
        azimuth, latitude = ((along + 0.5) / high - 1) * math.pi, (0.5 - (at + 0.5) / high) * math.pi
        ceiling, wall = latitude[:, None] > boundary_latitudes(room, azimuth)[0], wall_ranges(room.floor, azimuth)[1]
        opening = openings[np.ix_(*((one * OPENING_ROWS / high).astype(int) for one in (at, along % wide)))]
        behind = np.where(ceiling, CEILING, FIRST_WALL + wall) + 100 * (1 + opening)
        part = _before(seen, behind, round((mount[0] - first) * HALF_PX / half_px))
        if (part & ~ceiling).any():
            share = cv2.GaussianBlur(part.astype(np.float32), (0, 0), 0.7)
            share = cv2.resize(share, (len(column), len(row)), interpolation=cv2.INTER_LINEAR)
            i, j = np.nonzero(share > 0.02)
            yield Hanging(row[i], column[j] % wide, np.asarray(share[i, j], np.float32), mount, far_m)


def _before(seen: Floats, behind: Int16s, mount: int) -> Flags:
    """Return what (h, w) of a picture (h, w, 3) hangs in its middle from row ``mount`` down; ``behind``: `_differs`.

    A shade is as wide to the left as to the right, and convex; what is neither is taken as it is seen."""
    off, half = _differs(seen, behind), behind.shape[1] // 2
    even, sharp = (np.linalg.norm(one, axis=-1) for one in (cv2.GaussianBlur(off, (0, 0), BLUR), off))
    away, reach = np.abs(np.arange(-half, half + 1)), half // 8
    odd = cv2.morphologyEx(_bytes((even > ODD[0]) & (away < BESIDE[1] * half)), cv2.MORPH_CLOSE, SQUARE)
    labels = components(odd.astype(bool))[1]
    near = np.unique(labels[max(0, mount - reach) : mount + reach, away < 3])
    part = np.isin(labels, near[near > 0])
    sides = max((part & np.roll(part[:, ::-1], by, axis=1) for by in range(-reach, reach + 1)), key=np.count_nonzero)
    alike = sides.sum() > ALIKE_SIDES * part.sum()
    part = sides if alike else part
    rod = np.maximum(ODD[1], (sharp * part).max(axis=1, keepdims=True) / 2)  # its rim is blurred
    found, bulk = part & (sharp > rod) & (away < (reach if alike else half)), cv2.erode(_bytes(part), DISC)
    labels, sure = components(part & cv2.dilate(cv2.dilate(bulk, DISC), SQUARE).astype(bool))[1], np.zeros_like(part)
    for one in range(1, labels.max() + 1):
        shade, hull = labels == one, np.zeros(part.shape, np.uint8)
        # Blurring widens what hardly differs by some pixels, and what does ends where it does by half.
        clear = (usual := float(np.median(even[shade]))) > CLEAR
        shade = _bytes(shade & (even > np.maximum(cv2.dilate(even, SQUARE), usual / 2) / 2) if clear else shade)
        # The end of the rod above it would make a tent of its hull.
        shade[(wide := shade.sum(axis=1)) < ROD * wide.max()] = 0
        cv2.fillConvexPoly(hull, cv2.convexHull(cv2.findNonZero(shade)), 1)
        brush = SQUARE[:1, :1] if clear else SQUARE[:5, :5]
        found |= (drawn := cv2.erode(hull if shade.sum() > SOLID * hull.sum() else shade, brush) > 0)
        sure |= drawn & clear
    found = np.asarray(cv2.morphologyEx(_bytes(found), cv2.MORPH_CLOSE, SQUARE[:, :1]) > 0)
    if sure.any():
        # What hangs together neither with a clear shade nor with its place on the ceiling is an uneven wall.
        labels = components(cv2.dilate(_bytes(found), SQUARE) > 0)[1]
        sure[max(0, mount - reach) : mount + reach, away < reach] = True
        found &= np.isin(labels, labels[sure & found])
    return found


def _differs(seen: Floats, behind: Int16s) -> Floats:
    """Return by how much a picture (h, w, 3) differs from what is ``behind`` (h, w), numbers of surfaces, as these are
    seen on both sides: in level and colour, multiples of their noise (h, w, 3)."""
    tone = cv2.GaussianBlur(np.log(np.maximum(seen, 1e-6)), (0, 0), BLUR / 2)
    tone = np.stack([tone.mean(axis=-1), tone[..., 0] - tone[..., 1], tone[..., 2] - tone[..., 1]], axis=-1)
    y, x = np.meshgrid(*(np.linspace(-1, 1, size) for size in behind.shape), indexing="ij")
    slow, off = np.stack([x**a * y**b for a in range(4) for b in range(4 - a)], axis=-1), np.zeros_like(tone)
    for surface in np.unique(behind):
        mine = behind == surface
        fit = mine & (np.abs(x) > BESIDE[0])
        for _ in range(ROUNDS):
            some = tuple(one[::8] for one in np.nonzero(fit))  # for time
            if len(some[0]) < HALF_PX:
                break
            rest = tone - slow @ np.linalg.lstsq(slow[some], tone[some], rcond=None)[0]
            noise = 1.4826 * np.median(np.abs(rest[fit]), axis=0) + NOISE
            fit = mine & (np.abs(rest) < 3 * noise).all(axis=-1)
            off[mine] = (rest / noise)[mine]
    off[cv2.morphologyEx(behind.astype(np.int16), cv2.MORPH_GRADIENT, SQUARE[:5, :5]) > 0] = 0
    return np.asarray(off, np.float32)


def _bytes(mask: Flags) -> Bytes:
    return mask.astype(np.uint8)
