"""What goes with removed furniture: things on it and beside it, slits, legs, and floor that is hardly one."""

import math
from collections.abc import Iterator
from typing import Any, TypeAlias

import cv2
import numpy as np
from scipy import ndimage

from processing.ground.arrays import Bytes, Flags, Floats, Int32s
from processing.ground.room_model import RoomModel
from processing.ground.seam import components, grown, resized, row_solid_angles, spanned, summed
from processing.removal.furniture import SEGMENT_BLUR, THING_PX, THING_SEGMENTS, TOUCH_RAD, segments
from processing.removal.illumination import known_mean
from processing.segmentation.evidence import SceneClass
from processing.sphere import Equirectangular
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR, SurfaceMaps, planes_of
from processing.surfaces.textures import texel_places, unwrap

THING_RAD = (math.radians(22), math.radians(14))
"""Height and width of the largest thing that stands on furniture, or lies beside it (chosen)."""
THING_CONTRAST, LYING_CONTRAST = 18.0, 36.0
"""Distance in CIE L*a*b* (8-bit) of its colour from what is around; on the floor, whose boards differ too (chosen)."""
LAYERS = 3  # of things on things (chosen)
POLE_RAD, POLE_REACH_RAD = math.radians(1.5), math.radians(6)
"""Width of a pole, and how far above what is seen of it a lamp's shade is looked for: its light hides it (chosen)."""
BOARD_SHARE, BOARD_RAD = 0.2, math.radians(1.2)
"""Of a segment of colour that is seen as skirting, from which it is one (more is missed than seen); how far beside what
goes the rest of it is (chosen)."""
LONE_SHARE, LONE_MOST, LONE_SR = 0.12, 8, 2e-4
"""Probability of furniture or fixtures from which something small may lie on the floor by itself (a pile of books is
seen at a fifth; bare floor at a twentieth), how many there may be (more are a pattern), and its least size (chosen)."""
LONE_CONTRAST, LONE_RING = 24.0, 0.8
"""As `LYING_CONTRAST`, shade apart; share of what is around that must be floor: skirting is no thing (chosen)."""
UNSURE, SHARD_SR, SLIT_RAD, BARRED_RAD = 0.4, 8e-3, math.radians(1.0), math.radians(0.75)
"""Probability of things, or of walls, from which floor beside furniture goes; largest shard of a wall; half the width
of slits between what goes; how near to what stays floor stays (chosen by looking at furnished real rooms)."""
SURE, LARGE_SR, ALIKE, SPREAD = 0.15, 0.05, 0.15, 1.25
"""Probability of things below which floor surely is floor; size from which unsure floor stays where its median tone is
within so much (natural logarithm) of sure floor's and varies at most so many times as much (chosen as those above)."""
LEG_RAD = (math.radians(2.4), math.radians(6), math.radians(0.8))
"""Largest width, largest length and least length of a leg below what is known of its chair (chosen as those above)."""
LEG_DARK, LEG_DARKEST, LEG_GRAIN = 0.09, 0.25, 3.0
"""By how much a leg is darker than beside it (natural logarithm), its darkest part, and in multiples of the bare
surface's own grain (chosen as those above). Judged by colour, joints between boards would count as legs."""
GLARE_RAD, GLARE_CHROMA, GLARE_TIMES, GLARE_MEAN = math.radians(0.35), 0.3, 3.0, 0.5
"""Blur of its colour; natural logarithm by which that differs from the floor's, in multiples of the floor's own spread,
and in the mean; the next: by which it is brighter; share of its outline that furniture cuts; largest size (chosen by
looking at eight furnished real rooms: one has such a reflection; of the others next to nothing is taken)."""
GLARE_BRIGHT, GLARE_CUT, GLARE_SR = 0.7, 0.4, 0.15
Part: TypeAlias = tuple[tuple[Any, ...], Flags]
"""Rows and columns of a box of a picture, by which arrays (H, W) are indexed, and the part of it."""

CRUMB_TONE, CRUMB_LIGHT_RAD, CRUMB_SR, SPARSE_SR, CRUMB_PX = 0.2, math.radians(1.5), 1.5e-3, 6e-3, 3
"""Natural logarithm by which a crumb differs from its wall's light, over what that is taken; largest size, and of a
dark one that fills less than half of its box (a plate or a socket is bright and fills it: it stays); least pixels.
These and the next chosen by looking at eight furnished real rooms."""
CRUMB_NEAR_RAD, CRUMB_APART_PX, CRUMB_TIMES = math.radians(5), 2, 2.0
"""How near to what goes most of a crumb lies; how far from other surfaces; and how many times as many of them there are
than elsewhere on that wall: else they are its pattern."""
CEILING_ROWS, CEILING_PX_PER_M, APART_M, ODD, LEAST_CELLS = 512, 40.0, (0.4, 0.15), 0.2, 4
"""How finely a ceiling is looked at; how far from its edges, and over what its light is taken; natural logarithm by
which what hangs there differs, and least of it (chosen: of ten real rooms all nine with lamps, detectors or joints)."""


def with_things(mask: Flags, rgb8: Bytes, floor: Flags, barred: Flags, likely: Floats | None = None) -> Flags:
    """Return a mask (H, W) with the small things that touch it, whole: segments of colour unlike what is around them.

    A lamp, a vase or a screen on removed furniture would be left in the air. So are those that lie on the floor by
    themselves where something is ``likely`` (H, W), a probability; None: of what it cuts only the rest is judged.
    ``barred`` (H, W): what stays.
    """
    labels = segments(rgb8.tobytes(), rgb8.shape, THING_SEGMENTS, THING_PX)
    colours = cv2.cvtColor(rgb8, cv2.COLOR_RGB2Lab).astype(np.float32)
    found, tried, px_rad = mask.copy(), np.zeros(int(labels.max()) + 1, bool), math.pi / len(mask)
    poles = np.zeros_like(mask)
    if likely is not None:
        found |= _lone(labels, colours, floor & (likely > LONE_SHARE) & ~found & ~barred, floor)
    for _ in range(LAYERS):
        near = np.unique(labels[(grown(found, TOUCH_RAD) | poles) & ~found & ~barred])
        for label in near[~tried[near]]:
            tried[label] = True
            part = labels == label
            rest = part & ~found if likely is None else part
            rows, columns = spanned(rest)
            high, wide = np.ptp(rows) * px_rad, (np.ptp(columns) + 1) * px_rad
            if high > THING_RAD[0] or wide > THING_RAD[1] or (part & barred).sum() > 0.3 * part.sum():
                continue
            off = _contrast(rest, found, colours)
            if off > (LYING_CONTRAST if (part & floor).sum() > 0.5 * part.sum() else THING_CONTRAST):
                found |= part & ~barred
                if wide < POLE_RAD < high:
                    poles[max(0, rows[0] - round(POLE_REACH_RAD / px_rad)) : rows[0], columns] = True
    return found


def whole_boards(rests: Flags, gone: Flags, boards: Flags, rgb8: Bytes) -> Flags:
    """Return ``rests`` (H, W) without skirting on the floor of which more would stay than goes, and with the rest near
    by of what mostly goes: half of it would be jagged.

    ``gone`` (H, W): what goes in any case; ``boards`` (H, W): where skirting is seen; ``rgb8`` (H, W, 3): sRGB.
    """
    labels = segments(rgb8.tobytes(), rgb8.shape, THING_SEGMENTS, THING_PX)
    size, goes, board = summed(labels, 1, gone | rests, boards)
    board, most = (board > BOARD_SHARE * size)[labels], (goes >= size / 2)[labels]
    return ((rests & (most | ~board)) | (grown(gone | rests, BOARD_RAD) & board & most)) & ~gone


def _lone(labels: Int32s, colours: Floats, where: Flags, floor: Flags) -> Flags:
    """Return small things (H, W) with the ``floor`` (H, W) all around them: what in ``where`` (H, W) is no shade on it.

    What is brighter than the floor or of another colour is a thing; what touches that and is no larger, its dark side.
    """
    px_rad, found = math.pi / len(labels), np.zeros_like(where)
    size, inside = summed(labels, 1, where)
    small = []
    for label in np.flatnonzero((inside > 0.5 * size) & (size > LONE_SR)):
        part = labels == label
        rows, columns = spanned(part)
        if max(np.ptp(rows) / THING_RAD[0], np.ptp(columns) / THING_RAD[1]) * px_rad <= 1:
            small.append((float(size[label]), part))
    things = [part for _, part in small if _contrast(part, found, colours, floor) > LONE_CONTRAST]
    if not 0 < len(things) <= LONE_MOST:
        return found
    count, number = components(np.logical_or.reduce(things))
    for one in range(1, count + 1):
        reach, whole = grown(number == one, TOUCH_RAD), float(summed(number, 1)[0][one])
        found |= number == one
        for own, part in small:
            if own <= whole and (part & reach).any():
                found |= part
    return found


def _contrast(part: Flags, found: Flags, colours: Floats, floor: Flags | None = None) -> float:
    """Return how far the colour of a part (H, W) is from what is around, without what is found already.

    ``floor`` (H, W): 0 where that is not around it; what is only darker is then no farther than its shade."""
    (high, wide), (rows, columns) = part.shape, spanned(part)
    beside = np.arange(columns[0] - 6, columns[-1] + 7) % wide
    window = np.ix_(np.arange(max(0, rows[0] - 6), min(rows[-1] + 7, high)), beside)
    ring = cv2.dilate(part[window].astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)
    ring &= ~part[window] & ~found[window]
    if not ring.any():
        return math.inf
    off = colours[part].mean(axis=0) - np.median(colours[window][ring], axis=0)
    if floor is not None:
        off[0] = max(off[0], 0)
        off *= (ring & floor[window]).sum() > LONE_RING * ring.sum()
    return float(np.linalg.norm(off))


def rests_beside(gone: Flags, probabilities: Floats, luminance: Floats, maps: SurfaceMaps, stays: Flags) -> Flags:
    """Return what else goes beside what is ``gone`` (H, W): slits, legs, and floor that is hardly one.

    That is what the network half sees (cables, rims of rugs), deep shade that it takes for a thing, of which relighting
    leaves a patch with an edge, and shards of walls where the room's floor is by mistake.

    ``probabilities`` (C, H, W), 0..1, by `SceneClass`; ``luminance`` (H, W), linear, of any unit; ``stays`` (H, W):
    what is not to go.
    """
    floor, near = (maps.plane == FLOOR) & ~grown(stays, BARRED_RAD), grown(gone, TOUCH_RAD)
    tone = np.log(np.clip(luminance, 1e-3 * float(np.median(luminance)) + 1e-9, 1e20)).astype(np.float32)
    weight = np.broadcast_to(row_solid_angles((gone.shape[0], gone.shape[1])), gone.shape)
    likely = probabilities[[SceneClass.FURNITURE, SceneClass.FIXTURE]].sum(axis=0)
    sure = tone[floor & ~gone & (likely < SURE)]
    usual, most_spread = (np.median(sure), SPREAD * sure.std()) if len(sure) else (np.inf, 0.0)
    # What is as narrow as a slit does not bar one.
    goes = ~grown(~grown(gone, SLIT_RAD), SLIT_RAD) & ~(stays & grown(~grown(~stays, SLIT_RAD), SLIT_RAD))
    for share, most_sr in ((likely, math.inf), (probabilities[SceneClass.WALL], SHARD_SR)):
        for box, part in _parts(floor & ~gone & (share > UNSURE)):
            size_sr = weight[box][part].sum()
            clear = size_sr > LARGE_SR and abs(np.median(tone[box][part]) - usual) < ALIKE
            if (part & near[box]).any() and size_sr < most_sr and not (clear and tone[box][part].std() < most_spread):
                goes[box] |= part
    bare = (maps.opening < 0) & (maps.plane != CEILING) & ~grown(stays, BARRED_RAD)
    goes |= _legs(gone | goes, near, tone, bare)
    return np.asarray(goes & ~gone)


def torn_glare(gone: Flags, rgb: Floats, free: Flags) -> Flags:
    """Return the reflections of windows in a floor (H, W) that what is ``gone`` (H, W) cuts: a torn piece would stay.

    They are bright and of the colour of daylight. ``rgb`` (H, W, 3), linear, of any unit; ``free`` (H, W): floor that
    is seen, without patches of sun.
    """
    found = np.zeros_like(gone)
    if not free.any():
        return found
    light = cv2.GaussianBlur(np.nan_to_num(rgb, nan=0, posinf=0), (0, 0), GLARE_RAD / math.pi * len(rgb))
    tone = np.log(np.maximum(light, 1e-4 * float(np.median(light)) + 1e-9))
    chroma, level = tone[..., ::2] - tone[..., 1:2], tone.mean(axis=-1)
    off = chroma - np.median(chroma[free], axis=0)
    spread = 1.4826 * np.median(np.abs(off[free]), axis=0) + 0.02
    apart = np.linalg.norm(off, axis=-1)
    weight = np.broadcast_to(row_solid_angles((gone.shape[0], gone.shape[1])), gone.shape)
    odd = free & (apart > GLARE_CHROMA) & (np.linalg.norm(off / spread, axis=-1) > GLARE_TIMES)
    for box, part in _parts(odd):
        bright = np.median(level[box][part]) - np.median(level[free]) > GLARE_BRIGHT
        if not bright or apart[box][part].mean() < GLARE_MEAN or weight[box][part].sum() > GLARE_SR:
            continue
        whole = np.zeros_like(gone)
        whole[box] = part
        rim = grown(whole, TOUCH_RAD) & ~whole
        if gone[rim].mean() > GLARE_CUT:
            found |= whole
    return found


def crumbs_on_walls(gone: Flags, rgb: Floats, maps: SurfaceMaps, bar: Flags, cut: Flags) -> Flags:
    """Return small things (H, W) on walls near what is ``gone`` (H, W), left in the air: a flower's tip, a hook.

    ``rgb`` (H, W, 3), linear, of any unit; ``bar`` (H, W): what is no wall, or stays; ``cut`` (H, W): wall that stays
    although furniture may be seen before it, so that what touches what is gone there may be the rest of a thing.
    """
    rgb = np.nan_to_num(rgb, nan=0, posinf=0)
    tone = np.log(np.clip(rgb, 1e-3 * float(np.median(rgb)) + 1e-9, 1e20)).astype(np.float32)
    weight = np.broadcast_to(row_solid_angles((gone.shape[0], gone.shape[1])), gone.shape)
    near, found, apart_px = grown(gone, CRUMB_NEAR_RAD), np.zeros_like(gone), 2 * CRUMB_APART_PX + 1
    touched = cv2.dilate(gone.astype(np.uint8), np.ones((apart_px, apart_px), np.uint8)).astype(bool)
    for number in np.unique(maps.plane[near & (maps.plane >= FIRST_WALL)]):
        wall = (maps.plane == number) & (maps.opening < 0) & ~bar
        fit, off, more = wall & ~gone, np.zeros(gone.shape, np.float32), np.zeros_like(tone)
        for _ in range(3):
            more = tone - known_mean(tone, fit, CRUMB_LIGHT_RAD / math.pi * len(gone))[0]
            off = np.abs(more).max(axis=-1)
            fit &= off < CRUMB_TONE
        odd = (wall & ~gone & (off > CRUMB_TONE)).astype(np.uint8)
        odd = cv2.morphologyEx(odd, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        inner = cv2.erode((wall | gone).astype(np.uint8), np.ones((apart_px, apart_px), np.uint8)).astype(bool)
        parts: tuple[list[Part], list[Part]] = ([], [])
        for box, part in _parts(odd > 0):
            solid, bright = part.mean() > 0.5, more[box][part].mean() > 0
            rest = bool((cut & touched)[box][part].any())
            small = weight[box][part].sum() < (CRUMB_SR if (solid or bright) and not rest else SPARSE_SR)
            apart = rest or inner[box][part].all()
            if small and part.sum() >= CRUMB_PX and apart and not (solid and bright):
                parts[int(near[box][part].mean() > 0.5)].append((box, part))
        room = [float(weight[wall & ~gone & side].sum()) for side in (~near, near)]
        if len(parts[1]) * room[0] > CRUMB_TIMES * len(parts[0]) * room[1]:
            for box, part in parts[1]:
                found[box] |= part
    return found


def _parts(mask: Flags) -> Iterator[Part]:
    """Yield the box of each part of a mask (H, W), round the seam, and the part in it."""
    labels = components(mask)[1]
    for number, place in enumerate(ndimage.find_objects(labels), 1):
        if (box := place) is not None:
            if place[1] == slice(0, mask.shape[1]):
                rows, columns = spanned(labels == number)
                box = np.ix_(np.arange(rows[0], rows[-1] + 1), np.arange(columns[0], columns[-1] + 1))
            yield box, labels[box] == number


def _legs(gone: Flags, near: Flags, tone: Floats, bare: Flags) -> Flags:
    """Return thin dark uprights (H, W), brackets too, that go down from ``near`` what is ``gone`` (H, W) over ``bare``
    floor and walls (H, W)."""
    wide, long, high = (max(1, round(size / math.pi * len(gone))) for size in LEG_RAD)
    tone = np.asarray(cv2.GaussianBlur(tone, (0, 0), SEGMENT_BLUR), np.float32)
    darker = cv2.morphologyEx(tone, cv2.MORPH_CLOSE, np.ones((1, wide | 1), np.uint8)) - tone
    below = cv2.dilate(gone.astype(np.uint8), np.ones((long + 1, 1), np.uint8), anchor=(0, long)).astype(bool)
    zone, apart = bare & below & ~gone, bare & ~below
    least = max(LEG_DARK, LEG_GRAIN * float(np.median(darker[apart]))) if apart.any() else LEG_DARKEST
    upright = np.ones((2 * high | 1, 1), np.uint8)
    dark = cv2.morphologyEx((zone & (darker > least)).astype(np.uint8), cv2.MORPH_CLOSE, upright)
    found = np.zeros_like(gone)
    for box, part in _parts(zone & (dark > 0)):
        tall, reaches = len(part), (part & near[box]).any() and darker[box][part].max() > LEG_DARKEST
        if reaches and tall >= high:
            found[box] |= part
    return found


def on_ceiling(room: RoomModel, rgb: Floats) -> list[Any] | None:
    """Return where something hangs on the ceiling (a lamp, a fan, a detector): x and y in metres, of each the place
    nearest to the camera, since what hangs lower is seen behind it. None: no ceiling is seen.

    ``rgb`` (H, 2 H, 3): the upright panorama, linear light of any unit.
    """
    rows = min(len(rgb), CEILING_ROWS)
    tone = np.log(np.maximum(resized(rgb, (rows, 2 * rows)).mean(axis=-1), 1e-6)).astype(np.float32)
    plane = planes_of(room)[CEILING]
    seen = unwrap(tone, Equirectangular(2 * rows, rows), room, plane, CEILING_PX_PER_M)
    edge, around = (CEILING_PX_PER_M * size_m for size_m in APART_M)
    inner = cv2.distanceTransform(np.pad(seen.known, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1] > edge
    odd = inner & (np.abs(seen.values - known_mean(seen.values, seen.known, around)[0]) > ODD)
    odd = cv2.morphologyEx(odd.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)) > 0
    labels, places = ndimage.label(odd)[0], texel_places(plane, CEILING_PX_PER_M)[..., :2]
    parts = [places[labels == k] for k in range(1, labels.max() + 1)] if odd.sum() >= LEAST_CELLS else []
    return [part[np.hypot(*part.T).argmin()].round(3).tolist() for part in parts] if inner.any() else None
