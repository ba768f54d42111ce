"""What of a plane's texture may be copied and learnt from: what looks as the plane looks elsewhere too.

A mask is never quite right: beside it stand the rest of a rug, a chair's foot, a board that nobody took for furniture.
Copied into the hole they are shards. Such a thing is seen in one place; boards, tiles, grain and wear are seen in many.
So each texel's look (colour, tone and roughness, the slow light taken out) is sought away from it. How unlike is too
unlike depends on the texture: a varied floor allows much. A thing ends at an edge; light and shadow, which run out,
stay: the light's fit needs them.
"""

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats
from processing.removal.illumination import ToneScale, fit_illumination, grey

CELL_M = 0.03  # chosen, never swept
MOST_CELLS = 200  # of the longer side; at 110 a stool's leg was lost in its cell
AWAY_M = 0.6  # from a cell, where its look is sought: what is smaller and alone is a thing
LEAST_CELLS = 600  # known cells, under which it is unknown what is usual
GREY_WEIGHT, ROUGH_WEIGHT = 0.25, 0.1  # against colour: shadows are darker, and yet the plane
USUAL_SHARE = 0.04  # of the known cells that must look so
TOLERANCE, LEAST_TOLERANCE = 2.6, 0.1
"""Times the median cell's distance (rests may be a third of all that is seen); least of it (at 0.18 a mat of a tiled
floor's colour was copied)."""
LEVELS = (4.0, 2.0, 1.0)  # times the tolerance: a white board beside a grey box is found before both
EDGE = 0.7  # of the tolerance: as far as a thing reaches from what is surely odd
SMOOTH_CELLS = 1.2  # chosen, never swept
SAMPLES = 800  # chosen, never swept
ACROSS_CELLS, STEEP = 4, 0.6  # across so many cells, a thing's border shows so much of what its middle differs by
RIM_CELLS = 2  # around what is odd: its edge, its contact shadow
LEAST_CLUMP = 3  # cells of what is left out: fewer are chance
ISLAND = 0.06  # of the largest part that is seen in one piece: smaller ones are islands
MOST_OUT = 0.35  # of the known cells: if more is odd, the plane is odd


def plane_sources(values: Floats, sources: Flags, px_per_m: float) -> Flags:
    """Return those of ``sources`` (H, W) that look as the plane does; ``values`` (H, W, 3) are linear light.

    All of them where too little is seen to judge.
    """
    factor = min(1.0, 1 / (CELL_M * px_per_m), MOST_CELLS / max(sources.shape))
    size = tuple(max(2, round(n * factor)) for n in sources.shape[1::-1])
    share = np.asarray(cv2.resize(sources.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)
    seen = np.asarray(share > 0.3)
    if seen.sum() < LEAST_CELLS:
        return sources
    odd = _odd(_looks(values, sources, share, seen), seen, AWAY_M * px_per_m * factor)
    if odd.sum() > MOST_OUT * seen.sum():
        odd[:] = False
    wide = cv2.dilate(odd.astype(np.uint8), np.ones((2 * RIM_CELLS + 1,) * 2, np.uint8)).astype(bool)
    wide |= cv2.dilate(_islands(seen & ~wide).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    if not wide.any():
        return sources
    out = cv2.resize(wide.astype(np.uint8), sources.shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
    return np.asarray(sources & ~out)


def _islands(seen: Flags) -> Flags:
    """Return what is seen between holes, in small parts: mostly shadow and rests of things."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(seen.astype(np.uint8))
    size = stats[:, cv2.CC_STAT_AREA].astype(np.float64)
    size[0] = 0
    small = size < ISLAND * size.max()
    small[0] = False
    return np.asarray(small[labels])


def _looks(values: Floats, sources: Flags, share: Floats, seen: Flags) -> Floats:
    """Return (H, W, 5) how cells look: colour, tone, roughness, in weighted natural logarithms."""
    tone = ToneScale.of(values, sources).tone(values)
    weight = sources.astype(np.float32)
    mean = _means(tone * weight[..., None], share)
    level = grey(tone)
    spread = _means(level**2 * weight, share) - _means(level * weight, share) ** 2
    rough = 0.5 * np.log(np.maximum(spread, 1e-4))
    # Daylight and lamps fall across one floor: its colour changes slowly, too.
    mean = mean - fit_illumination(np.where(seen[..., None], mean, 0), seen, ~seen, None, bend=4.0)
    shade = grey(mean)
    colour = mean - shade[..., None]
    looks = np.concatenate([colour, GREY_WEIGHT * shade[..., None], ROUGH_WEIGHT * rough[..., None]], axis=-1)
    looks = np.where(seen[..., None], looks, 0).astype(np.float32)
    known = cv2.GaussianBlur(seen.astype(np.float32), (0, 0), SMOOTH_CELLS)
    smooth = cv2.GaussianBlur(looks, (0, 0), SMOOTH_CELLS)
    return np.asarray(smooth / np.maximum(known, 1e-3)[..., None], np.float32)


def _means(picture: Floats, share: Floats) -> Floats:
    small = cv2.resize(picture, share.shape[::-1], interpolation=cv2.INTER_AREA)
    over = np.maximum(share, 1e-3)
    return np.asarray(small / (over if small.ndim == 2 else over[..., None]), np.float32)


def _odd(looks: Floats, seen: Flags, away_px: float) -> Flags:
    """Return the cells whose look is not found elsewhere, in clumps."""
    places = np.argwhere(seen).astype(np.float64)
    chosen = np.random.default_rng(13).permutation(len(places))[:SAMPLES]
    square = _squares(looks[seen], looks[seen][chosen])
    square[_squares(places, places[chosen]) < away_px**2] = np.inf
    rank = max(1, round(USUAL_SHARE * len(chosen)))
    nearest = np.sqrt(np.partition(square, rank, axis=1)[:, rank])
    if not np.isfinite(nearest).all():
        # All that is seen lies together.
        return np.zeros_like(seen)
    tolerance = max(TOLERANCE * float(np.median(nearest)), LEAST_TOLERANCE)
    off = np.zeros(seen.shape)
    off[seen] = nearest
    odd, steep = np.zeros_like(seen), _steepness(looks, seen)
    for level in LEVELS:
        odd |= _things(looks, steep, off / (level * tolerance), seen & ~odd)
    return odd


def _things(looks: Floats, steep: Floats, off: Doubles, seen: Flags) -> Flags:
    """Return the clumps that are off by more than 1 and end at an edge, as far as they are off by `EDGE`."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(((off > EDGE) & seen).astype(np.uint8))
    found = np.zeros_like(seen)
    for label in np.unique(labels[(off > 1) & seen]):
        clump = labels == label
        if stats[label, cv2.CC_STAT_AREA] >= LEAST_CLUMP and _ends(looks, steep, clump, seen & (labels == 0)):
            found |= clump
    return found


def _ends(looks: Floats, steep: Floats, clump: Flags, usual: Flags) -> bool:
    """Return whether a clump ends at an edge, as things do; light and shadow run out.

    ``steep`` (H, W): how much looks change across `ACROSS_CELLS`. Towards a hole nobody sees how a clump ends: what has
    no other border is a thing.
    """
    outside = cv2.distanceTransform((~clump).astype(np.uint8), cv2.DIST_L2, 3)
    inside = cv2.distanceTransform(clump.astype(np.uint8), cv2.DIST_L2, 3)
    around = usual & (outside > ACROSS_CELLS) & (outside <= 3 * ACROSS_CELLS)
    border = (outside <= ACROSS_CELLS) & (inside <= ACROSS_CELLS)
    border &= cv2.dilate(around.astype(np.uint8), np.ones((2 * ACROSS_CELLS + 1,) * 2, np.uint8)).astype(bool)
    if not border.any():
        return True
    core = clump & (inside >= 0.7 * inside.max())
    whole = float(np.linalg.norm(looks[core].mean(axis=0) - looks[around].mean(axis=0)))
    return float(np.quantile(steep[border], 0.7)) > STEEP * whole


def _steepness(looks: Floats, seen: Flags) -> Floats:
    """Return (H, W): how much looks change across `ACROSS_CELLS` at most, near each cell."""
    half, found = ACROSS_CELLS // 2, np.zeros(seen.shape, np.float32)
    for axis in (0, 1):
        one, other = np.roll(looks, half, axis), np.roll(looks, -half, axis)
        both = np.roll(seen, half, axis) & np.roll(seen, -half, axis)
        for line in (slice(0, half), slice(-half, None)):
            both[(line, slice(None)) if axis == 0 else (slice(None), line)] = False
        found = np.maximum(found, np.where(both, np.linalg.norm(one - other, axis=-1), 0))
    return np.asarray(cv2.dilate(found, np.ones((ACROSS_CELLS + 1,) * 2, np.uint8)), np.float32)


def _squares(a: Floats | Doubles, b: Floats | Doubles) -> Doubles:
    """Return (N, M): squared distances between rows."""
    found = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.asarray(np.maximum(found, 0), np.float64)
