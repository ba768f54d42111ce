"""Which pixels show furniture: evidence joined with the room, cut at edges, filtered by the floor (paper, fig. 3b)."""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from processing.ground.arrays import Bytes, Doubles, Flags, Floats, Indices, Int32s
from processing.ground.seam import components, grown, resized, row_latitudes, smoothed, summed, wrapped
from processing.removal.edges import SURE, colour_distance, snapped, surface_outliers
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR, SurfaceMaps

FLOOR_SLACK_RAD = math.radians(2.5)  # errors of the floor's boundary
ON_FLOOR_SHARE = 0.05  # of a component's solid angle that lies before the floor, from which it stands on it ...
FOOT_SHARE = 0.10  # ... or of the columns it is seen in, those whose lowest pixel does.
LEAST_SR = 2e-5  # smaller components are noise: about 1.5 x 1.5 pixels of 1024 x 512
EVIDENCE_WEIGHT = 1.03  # of the network's log odds
NEARER_WEIGHT, NEARER_FROM, NEARER_SHARE = 3.0, 0.1, 0.42
"""Of how much nearer than its wall a place is seen (natural logarithm), from what errors make; and least probability:
the smooth front of a large wardrobe looks like a wall to one network of two. With less, rooms that are estimated too
large lose walls (hotel_visualizer: IoU 0.78, and 0.71 at a least probability of 0.3)."""
HERE_WEIGHT, AROUND_WEIGHT = 0.16, 0.40
"""Of the colours' distance from the surface's own, at the place and within `AROUND_RAD` of it."""
AROUND_RAD = math.radians(1.0)
BIAS = -1.1  # on validation rooms 0.80 of what is taken is furniture, and 0.88 of the furniture is taken
CUT_SHARE = 0.4
"""Of the graph cut's vote beside the probability's: a cut alone loses whole pieces that have the wall's colour."""
LEAST_ON_WALL, LEAST_AT_SILL, SILL_RAD = 0.2, 0.5, math.radians(2)
"""Probability below which the cut adds nothing on walls; the same within this angle of windows and doors, whose frames
have the colours of a wardrobe beside them (chosen by looking; two simulated and two real rooms score the same)."""
AGREED, FLOOR_DOUBTFUL = 0.55, 0.45
"""Mean probability of two networks that stands against a cut (a pale chair has the wall's colour); least one on floor
within a doubtful segment. Two real rooms: IoU 0.84 -> 0.86 (looked at) and 0.72 -> 0.80 (only scored)."""
TAKEN = 0.45  # from which of both together a place is furniture
SHARPNESS = 4.0  # of the soft mask about that
TOUCH_RAD = math.radians(0.8)  # how near a thing must be to what is removed (chosen)
ISLAND_SR = 0.08
"""What furniture goes all round is taken with it up to this size (16 degrees square): it would be left hanging."""
SEGMENTS = (150.0, 300.0)
"""Thresholds of the graph segmentation (Felzenszwalb, Huttenlocher 2004): colour segments at two scales ..."""
SEGMENT_BLUR, SEGMENT_PX = 0.6, 40
SEAM_SHARE = 0.25  # of the picture's width, by which it goes on beyond its seam where it is cut into segments (chosen)
DOUBTFUL, SEED_SHARE = 0.3, 0.3
"""... whose parts of more than the first probability are furniture where so much of them already is. Chosen on one real
room (bedroom_hn): recall 0.91 -> 0.95 at the same IoU, by fused evidence; by our network alone IoU falls by 0.03."""
CEILING_DOUBT, OPENING_DOUBT = 0.7, 0.65
"""Natural logarithm of odds taken off before the ceiling, and before windows and doors."""
LEAST_DOOR = 0.15
"""Probability of a door that is likelier than furniture, from which a place of a wall is one: a dark doorway that is no
known opening is unlike its wall, and went with the plant before it (chosen by the demo's room). Two networks' only: by
ours alone masks of two test rooms lost 0.02 of their IoU."""
AJAR = math.exp(-OPENING_DOUBT)  # share of furniture's probability from which a door's counts as more, at a known door
BESIDE_RAD, MOST_BESIDE = math.radians(1.6), 0.5
"""How far around the upper half of a door is looked; share of furniture there from which it is a wardrobe's front
(chosen on two real rooms: 0.35 round a door, 0.6 to 0.7 round a wardrobe)."""
HALVED_SR = 0.03  # segments up to that size go whole (a lamp's shade at two metres: 0.02; chosen)
THING_SEGMENTS, THING_PX = 60.0, 12  # threshold and least size of its segments of colour: a lamp's pole is one (chosen)
HALF, HALF_SR = 0.5, 0.01  # of a segment on a wall, from which the rest goes too; its largest size (chosen)
MOSTLY_HIDDEN = 0.7  # of an opening, from which it is a part of what hides it (chosen)
FRAME_RAD, BAR_RAD, LEAST_FRAME_PX = math.radians(4), math.radians(0.8), 20
"""As wide as a window's frame may be seen; half as wide as a bar; pixels that teach colours (chosen)."""
FITTED_LARGE, FITTED, FITTED_FOOT_RAD = 0.3, 0.55, math.radians(4.5)
"""Of the wall below a window, what is fitted there; mean probability of furniture up to which it is (a niche: 0.49;
chairs and tables there in three rooms: 0.63 and more); above the floor, where skirting is drawn anew (chosen)."""
FITTED_WIDE_RAD, FITTED_SIDES = math.radians(5), 1.4  # beside a pane, as wide as niches are; so much higher (chosen)
BEST, HARDLY, LIKELY, LIKELY_HERE, SURE_FLOOR = 0.95, 0.7, 0.7, 0.5, 0.95
"""Quantile of the floor's probability that is its best; up to which a floor is hardly seen; shares of the best in the
mean of a segment of colour, and at a place, from which that is floor; what the best is raised to (chosen on nine real
rooms against two networks' masks: six stay as they are, two get back 0.7 to 1 of their floor, with 0.005 of furniture;
the ninth's bed stays floor, as before)."""
STAYS, MOST_FURNITURE, STAYS_SR = 0.5, 0.25, 3e-3
"""Probability of openings, and of fixtures, from which they surely are some; mean one of furniture up to which such a
part is none (a wardrobe's doors have 0.32; doors, mirrors and curtains of seven real rooms up to 0.14); least size."""
SKIRTING_SHARE, SKIRTING_SLACK_RAD = 0.14, math.radians(1.2)
"""Of the camera's height, as high as skirting may be; error of the floor's boundary against it (chosen)."""
SKIRTING_LONG_RAD = math.radians(4)  # shorter strips along a wall's foot are things (chosen)


@dataclass(frozen=True)
class FurnitureFound:
    """Furniture of a panorama at working size."""

    mask: Flags
    probability: Floats
    """(H, W): before filtering by the floor, with edges; furniture is above one half."""
    stays: Flags
    """(H, W): doors, windows, curtains and mirrors that are none, as far as they could be taken for it."""
    dropped: int
    """Components that are not attached to the floor."""
    dropped_sr: float


def find_furniture(
    probabilities: Floats,
    maps: SurfaceMaps,
    rgb8: Bytes,
    *,
    doors: Flags | None = None,
    whole: bool = False,
    reach_m: Floats | None = None,
) -> FurnitureFound:
    """Return the furniture of an upright panorama.

    ``probabilities`` (8, H, W).
    ``maps``: of the room, at the same size.
    ``rgb8`` (H, W, 3), sRGB.
    ``doors`` (H, W): those of the estimated room; None: it has none.
    ``whole``: complete things to the borders of their colours: for evidence that two networks share.
    ``reach_m`` (H, W): distance to what is seen, as far as it is known.
    """
    # The probability (H, W) of furniture: the network's, what the room says, and unusual colours. Weights are a
    # logistic regression on simulated rooms of validation seeds and real rooms that may be looked at
    # (docs/reference/detection.md), rounded.
    share = np.clip(probabilities[SceneClass.FURNITURE], 1e-3, 1 - 1e-3)
    unusual = surface_outliers(probabilities, maps, rgb8)
    odds = EVIDENCE_WEIGHT * np.log(share / (1 - share)) + BIAS
    odds += HERE_WEIGHT * unusual + AROUND_WEIGHT * smoothed(unusual, AROUND_RAD)
    if reach_m is not None:
        nearer = np.maximum(np.log(maps.depth_m / np.maximum(reach_m, 1e-3)) - NEARER_FROM, 0)
        odds += NEARER_WEIGHT * np.where((share > NEARER_SHARE) & (maps.plane >= FIRST_WALL), nearer, 0)
    before = (maps.opening >= 0) | (whole & doors_in(probabilities, maps))
    odds -= CEILING_DOUBT * (maps.plane == CEILING) + OPENING_DOUBT * before
    prior = np.asarray(1 / (1 + np.exp(-odds)), dtype=np.float32)
    openings = (maps.opening >= 0) | (probabilities[[SceneClass.WINDOW, SceneClass.DOOR]].sum(axis=0) > STAYS)
    least = np.where(grown(openings, SILL_RAD), LEAST_AT_SILL, LEAST_ON_WALL) * (maps.plane >= FIRST_WALL)
    vote = CUT_SHARE * snapped(prior, rgb8) * (prior > least) + (1 - CUT_SHARE) * prior
    soft = np.clip(0.5 + SHARPNESS * (vote - TAKEN), 0, 1).astype(np.float32)
    stays = np.zeros_like(maps.plane, bool) if doors is None else ajar(probabilities, doors, soft > 0.5, rgb8)
    if whole:
        agreed = (soft > 0.5) | (probabilities[SceneClass.FURNITURE] > AGREED)
        likely = np.where((maps.plane == FLOOR) & (prior < FLOOR_DOUBTFUL), 0, prior).astype(np.float32)
        soft = np.where(completed(agreed, likely, rgb8), np.maximum(soft, np.float32(0.75)), soft)
        stays = stays | _by_segment(staying(probabilities, rgb8, maps.plane == FLOOR), soft > 0.5, rgb8)
    soft[stays] = 0
    soft[frames_seen(soft > 0.5, prior > SURE, maps, rgb8)] = 0
    kept, dropped, dropped_sr = attached(without_skirting(soft > 0.5, maps), maps.plane == FLOOR)
    islands = islands_in(kept, (maps.opening >= 0) | stays)
    return FurnitureFound(kept | islands, np.where(islands, np.float32(1), soft), stays, dropped, dropped_sr)


def doors_in(probabilities: Floats, maps: SurfaceMaps) -> Flags:
    """Return where (H, W) below the ceiling a door is likelier than furniture and floor, of probabilities (8, H, W)."""
    door = probabilities[SceneClass.DOOR]
    others = probabilities[[SceneClass.FURNITURE, SceneClass.FLOOR]].max(axis=0)
    return np.asarray((door > np.maximum(others, LEAST_DOOR)) & (maps.plane != CEILING))


def ajar(probabilities: Floats, doors: Flags, mask: Flags, rgb8: Bytes) -> Flags:
    """Return the segments of colour (H, W) at known ``doors`` (H, W) that are doors rather than furniture by
    probabilities (8, H, W): the leaf of an open door stands before its wall like a wardrobe, a doorway is as dark.

    ``mask`` (H, W): of furniture. What has that beside its upper half is a front of it; what is all below the camera is
    a door only if that is likelier (a plant's leaves before one).
    """
    labels = segments(rgb8.tobytes(), rgb8.shape, SEGMENTS[0], SEGMENT_PX)
    near, tall = grown(doors, SILL_RAD), np.arange(len(mask))[:, None] < len(mask) // 2
    door, furniture = probabilities[[SceneClass.DOOR, SceneClass.FURNITURE]]
    size, at_doors, high, door, furniture = summed(labels, 1, near, tall, door, furniture)
    found = ((at_doors > 0) & (door > LEAST_DOOR * size) & (door > np.where(high > 0, AJAR, 1) * furniture))[labels]
    count, parts = components(found)
    for one in range(1, count + 1):
        part = parts == one
        rows = np.flatnonzero(part.any(axis=1))
        beside = (grown(part, BESIDE_RAD) & ~part)[: (rows[0] + rows[-1]) // 2]
        if np.count_nonzero(mask[: len(beside)] & beside) > MOST_BESIDE * np.count_nonzero(beside):
            found &= ~part
    return found


def mostly_seen(openings: Flags, mask: Flags) -> Flags:
    """Return the ``openings`` (H, W) without specks, and what a ``mask`` (H, W) has most of: a wardrobe's doors."""
    labels = components(openings)[1]
    size, hidden = summed(labels, 1, mask)
    return np.asarray(openings & ((size > STAYS_SR) & (hidden < MOSTLY_HIDDEN * size))[labels])


def frames_seen(mask: Flags, sure: Flags, maps: SurfaceMaps, rgb8: Bytes) -> Flags:
    """Return what (H, W) a ``mask`` (H, W) has of an opening's rim, if it is coloured like the rest of the opening
    more than like what is for ``sure`` (H, W) before the wall beside it: the network's pixels are wider than frames.

    What is wider than a bar before the middle of a pane, or its foot on the floor, is none: a table's top, a sofa."""
    found, bare = np.zeros_like(mask), (maps.plane >= FIRST_WALL) & (maps.opening < 0)
    for number in np.unique(maps.opening[maps.opening >= 0]):
        pane = maps.opening == number
        seen, hidden, beside = pane & ~mask, pane & mask, grown(pane, FRAME_RAD) & ~pane & sure
        if seen.sum() > hidden.sum() and min(part.sum() for part in (seen, hidden, beside)) >= LEAST_FRAME_PX:
            alike = hidden & grown(seen, FRAME_RAD) & (colour_distance(rgb8, seen) < colour_distance(rgb8, beside))
            middle = alike & ~grown(bare, FRAME_RAD)
            wide, labels = grown(~grown(~middle, BAR_RAD), BAR_RAD), components(alike)[1]
            found |= alike & ~np.isin(labels, labels[wide & alike])
    return found


def fitted_below_windows(mask: Flags, probability: Floats, maps: SurfaceMaps) -> Flags:
    """Return the wall (H, W) below each window of which a ``mask`` (H, W) has much that is hardly furniture by its
    ``probability`` (H, W): a niche, a radiator, an air conditioner belong to the building."""
    found, side = np.zeros_like(mask), np.ones((1, 2 * round(FITTED_WIDE_RAD / math.pi * len(mask)) + 1), np.uint8)
    high, higher = (~grown(maps.plane == FLOOR, times * FITTED_FOOT_RAD) for times in (1, FITTED_SIDES))
    for number in np.unique(maps.opening[maps.opening >= 0]):
        pane = maps.opening == number
        wall = maps.plane == maps.plane[pane][0]
        below = np.maximum.accumulate(pane, axis=0) & ~pane & high & wall
        taken = below & mask
        if taken.sum() > FITTED_LARGE * below.sum() and probability[taken].mean() < FITTED:
            found |= below | ((cv2.dilate(below.astype(np.uint8), side) > 0) & higher & wall & (maps.opening < 0))
    return found


@lru_cache(maxsize=4)
def segments(picture: bytes, shape: tuple[int, ...], scale: float, least_px: int) -> Int32s:
    """Return each pixel's segment of colour (H, W), round the seam; ``picture``: the bytes of a ``shape`` (H, W, 3)."""
    width, pad = shape[1], round(shape[1] * SEAM_SHARE)
    around = wrapped(np.frombuffer(picture, np.uint8).reshape(shape), pad)
    cutter = cv2.ximgproc.segmentation.createGraphSegmentation(SEGMENT_BLUR, scale, least_px)
    labels = np.asarray(cutter.processImage(around), np.int32)
    # Beyond each end the other one is shown again: segments that are mostly the same places are one.
    count, links = int(labels.max()) + 1, []
    for beyond, own in ((slice(0, pad), slice(width, width + pad)), (slice(-pad, None), slice(pad, 2 * pad))):
        again, there = labels[:, beyond].ravel(), labels[:, own].ravel()
        pairs, both = np.unique(again * np.int64(count) + there, return_counts=True)
        one, other = np.divmod(pairs, count)
        either = np.bincount(again, minlength=count)[one] + np.bincount(there, minlength=count)[other] - both
        links.append(np.stack([one, other])[:, 2 * both > either])
    ends = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(count, count))
    labels = np.asarray(connected_components(graph, directed=False)[1], np.int32)[labels[:, pad : pad + width]]
    labels.setflags(write=False)
    return labels


def completed(mask: Flags, probability: Floats, rgb8: Bytes) -> Flags:
    """Return a mask (H, W) grown to doubtful places (``probability``, (H, W)) within one connected segment of colour.

    Half a bed is worse than none: what has the colour of its other half, and may be furniture, goes with it.
    """
    doubtful, grown_to = probability > DOUBTFUL, mask.copy()
    for scale in SEGMENTS:
        labels = segments(rgb8.tobytes(), rgb8.shape, scale, SEGMENT_PX)
        seeds, parts = summed(labels, mask, doubtful)
        grown_to |= (seeds > SEED_SHARE * np.maximum(parts, 1e-9))[labels] & doubtful
    return grown_to


def halved(mask: Flags, things: Floats, rgb8: Bytes) -> Flags:
    """Return the small segments of colour (H, W) that a ``mask`` (H, W) has most of, such as a lamp's shade, where
    ``things`` (H, W), the probability of such, is more than one half in the mean."""
    labels = segments(rgb8.tobytes(), rgb8.shape, SEGMENTS[0], SEGMENT_PX)
    size, taken, likely = summed(labels, 1, mask, things)
    return np.asarray(((size < HALVED_SR) & (taken > MOSTLY_HIDDEN * size) & (likely > size / 2))[labels], bool)


def halves_on_walls(gone: Flags, rgb8: Bytes, stays: Flags) -> Flags:
    """Return the rest (H, W) of small segments of colour on walls that what is ``gone`` (H, W) has most of: the tip of
    a branch would hang in the air.

    ``rgb8`` (H, W, 3): sRGB; ``stays`` (H, W): what is no wall, or the room's own.
    """
    labels = segments(rgb8.tobytes(), rgb8.shape, THING_SEGMENTS, THING_PX)
    size, goes = summed(labels, 1, gone)
    small = (size < HALF_SR) & (goes > HALF * size)
    return np.asarray(small[labels] & ~gone & ~stays)


def with_seen_floor(probabilities: Floats, floor_rad: Doubles, rgb8: Bytes) -> Floats:
    """Return probabilities (8, h, w) with the floor surer where it is likeliest, if it is hardly seen anywhere.

    In a full room a network takes all below the walls for furniture and rugs; bare floor is still likelier floor than
    these. ``floor_rad`` (N,): latitude of the floor's boundary, by columns. ``rgb8`` (H, W, 3): sRGB.
    """
    (high, wide), own = rgb8.shape[:2], probabilities[SceneClass.FLOOR]
    foot = np.interp(np.linspace(0, len(floor_rad) - 1, wide), np.arange(len(floor_rad)), floor_rad)
    share, below = resized(own, (high, wide)), row_latitudes(high)[:, None] < foot
    best = float(np.quantile(share[below], BEST)) if below.any() else 1.0
    if best > HARDLY:
        return probabilities
    labels = segments(rgb8.tobytes(), rgb8.shape, SEGMENTS[0], SEGMENT_PX)
    size, part = summed(labels, below, share * below)
    mean = (part / np.maximum(size, 1e-9))[labels]
    alike = below & (mean > LIKELY * best)
    likely = alike & (share > LIKELY_HERE * best)
    likely |= alike & islands_in(likely, ~alike)
    more = np.where(likely, np.clip(SURE_FLOOR * np.minimum(mean / best, 1) - share, 0, 1), 0).astype(np.float32)
    floor = np.minimum(own + resized(more, (own.shape[0], own.shape[1])), 1)
    found = probabilities * ((1 - floor) / np.maximum(1 - own, 1e-6))
    found[SceneClass.FLOOR] = floor
    return np.asarray(found, np.float32)


def staying(probabilities: Floats, rgb8: Bytes, flat: Flags) -> Flags:
    """Return the doors, windows, curtains, mirrors (H, W) that are no furniture whatever their colours, each whole.

    Parts of another colour that may be such (a curtain's shaded end) go with them. ``flat`` (H, W): the floor.
    """
    found, furniture = np.zeros_like(flat), probabilities[SceneClass.FURNITURE]
    for classes in ([SceneClass.WINDOW, SceneClass.DOOR], [SceneClass.FIXTURE]):
        own = probabilities[classes].sum(axis=0)
        _, labels = components(own > STAYS)
        size, less, low = summed(labels, 1, furniture, flat)
        sure = (size > STAYS_SR) & (less < MOST_FURNITURE * size) & (low < size / 2)
        sure[0] = False
        found |= completed(sure[labels], np.where(own > furniture, own, 0).astype(np.float32), rgb8)
    return found


def _by_segment(stays: Flags, mask: Flags, rgb8: Bytes) -> Flags:
    """Return what stays (H, W) where that and a ``mask`` (H, W) of furniture meet: a segment of colour is what more of
    it is without contradiction, and stays where it is contradicted all over."""
    labels = segments(rgb8.tobytes(), rgb8.shape, SEGMENTS[0], SEGMENT_PX)
    one, other = summed(labels, stays & ~mask, mask & ~stays)
    found = (one >= other)[labels] & (stays | (mask & (one > 0)[labels]))
    # The rim of furniture, of mixed colours, is its own.
    return np.asarray(found & ~((one == 0)[labels] & grown(mask & ~found, TOUCH_RAD)), bool)


def without_skirting(mask: Flags, maps: SurfaceMaps) -> Flags:
    """Return a mask (H, W) without the low strips along the foot of walls: dark skirting looks like furniture."""
    height = len(mask)
    px_rad = math.pi / height
    foot = height - (maps.plane == FLOOR).sum(axis=0)
    down = np.maximum((foot + 0.5) * px_rad - math.pi / 2, px_rad)
    top = (math.pi / 2 + np.arctan((1 - SKIRTING_SHARE) * np.tan(down)) - SKIRTING_SLACK_RAD) / px_rad
    rows, end = np.arange(height)[:, None], foot + SKIRTING_SLACK_RAD / px_rad
    strip = (rows >= top) & (rows <= end)
    rim = ((rows >= top - 1) & (rows < top)) | ((rows > end) & (rows <= end + 1))
    low = ~(mask & rim).any(axis=0) & (mask & strip).any(axis=0)
    brush = np.ones((1, 2 * round(SKIRTING_LONG_RAD / px_rad / 2) + 1), np.uint8)
    wide = np.concatenate([low, low, low])[None].astype(np.uint8)
    long = cv2.morphologyEx(wide, cv2.MORPH_OPEN, brush)[0, len(low) : 2 * len(low)].astype(bool)
    return np.asarray(mask & ~(strip & long), bool)


def attached(mask: Flags, floor: Flags) -> tuple[Flags, int, float]:
    """Return the components of a mask (H, W) attached to the ``floor`` (H, W), and count and sr of the others.

    A component is attached where enough of it, or of its lower contour, lies before the floor's region (widened by
    `FLOOR_SLACK_RAD`). Clutter on furniture stays, as it hangs together with what it stands on.
    """
    count, labels = components(mask)
    if not count:
        return mask.copy(), 0, 0.0
    near_floor = grown(floor, FLOOR_SLACK_RAD)
    size, before = summed(labels, 1, near_floor)
    foot, feet = lower_ends(labels, near_floor, count)
    stands = (before >= ON_FLOOR_SHARE * size) | (foot >= FOOT_SHARE * np.maximum(feet, 1))
    stands &= (before > 0) & (size >= LEAST_SR)
    stands[0] = False
    gone = ~stands
    gone[0] = False
    return stands[labels], int((gone & (size >= LEAST_SR)).sum()), float(size[gone].sum())


def islands_in(mask: Flags, never: Flags, most_sr: float = ISLAND_SR) -> Flags:
    """Return the components up to ``most_sr`` that a mask (H, W) encloses, but for those mostly in ``never`` (H, W)."""
    labels = components(~mask)[1]
    size, barred = summed(labels, 1, never)
    small = (size < most_sr) & (barred < size / 2)
    return np.asarray(small[labels] & ~mask, bool)


def beyond(mask: Flags, passages: Flags) -> Flags:
    """Return the components of a ``mask`` (H, W) that stand in the next room, as most of their lower ends are seen
    through ``passages`` (H, W): what one cuts would be left in halves."""
    count, labels = components(mask)
    there, ends = lower_ends(labels, grown(passages, TOUCH_RAD), count)
    return np.asarray((there > ends / 2)[labels])


def lower_ends(labels: Int32s, near_floor: Flags, count: int) -> tuple[Indices, Indices]:
    """Return, for each of the components (H, W), how many of its lower ends lie ``near_floor`` (H, W), and how many
    there are."""
    below = np.vstack([labels[1:], np.zeros((1, labels.shape[1]), labels.dtype)])
    contour = (labels > 0) & (below != labels)
    feet = np.bincount(labels[contour], minlength=count + 1)
    return np.bincount(labels[contour & near_floor], minlength=count + 1), feet
