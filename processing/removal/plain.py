"""Plain surfaces: walls and ceilings of one colour, with light that falls across them, skirting, and grain.

A hole is filled with the continued light, the profile of the rows beside it (skirting and cornice run level along a
wall) and grain copied from along the same rows, so that the result is neither smooth nor smeared."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from processing.ground.arrays import Flags, Floats
from processing.ground.colour import largest_channel
from processing.removal.illumination import ToneScale, blurred, fit_illumination, grey, known_mean, spread

# What furniture takes from the light of the wall beside it: it does not go on where the furniture is removed.
#
# Beside what stands before a wall, the wall gets less light than further away. Continued through the hole, that draws
# the shadow of what is no longer there. So a wall's light is estimated from further away, and in the hole it
# rises from what it is at the rim, which stays as it is, to what it is around. What furniture takes
# from the whole room cannot be put back without changing what is seen.

NEAR_M = 0.5  # from the hole, as far as what is removed is taken to darken the wall
AROUND_M = (1.0, 4.0)
"""Neighbourhoods in which the light further away is measured; the wide one where the near one sees nothing."""
WIDE_SHARE = 0.02  # of the wide neighbourhood's weight against the near one's
RISE_M = 0.4  # from the rim into the hole, on which the light rises
MOST_RISE, MOST_RISE_FLOOR = 0.4, 0.12
"""Tone by which it rises at most; floors have bright and dark boards (chosen by four simulated rooms)."""
LEAST_FAR = 0.3  # of the known texels that must be far from the hole
OUTLIER = 4.0  # robust standard deviations from its row's profile beyond which a pixel is a socket, a picture, a switch
LEAST_SPREAD = 0.01  # of log tone; chosen, never swept
OTHER_COLOUR, MOST_OTHER, MOST_OF_ROW = 0.3, 0.35, 0.7
"""Tone by which a colour is off and no light's doing; the shares of all that is known, and of a row, that may be so."""
GRAIN_PX, MOST_BLOCKS = 3.0, 60  # chosen, never swept
ROUGH, COARSE_GRAIN = 0.2, 0.04  # roughness of a floor from which its grain is coarse; of its size, how coarse (chosen)
FEW = 0.1  # of the columns near the hole: rows with fewer known ones hardly have a profile
TRUSTED = 0.6  # trust in a row's profile from which it is its own; below, it is more and more as usual on other walls
BOARD = 0.1  # tone against the wall from which what is usual is a board (chosen)
UNEVEN = 0.04  # tone by which a row of skirting may vary along the wall
SLOW_ROWS = 0.08  # of the height: slower changes are light
CALM = 5.0  # times the median energy of grain, from which there is more than grain
NEAR = 0.25  # of the texture's width: how far from the hole rows are still looked at for their profile
FADE = 0.06  # of a floor's size, on which what its smooth light leaves at the rim runs out (chosen on two real rooms)
DRIFT = 0.1  # tone by which a wall's light may change from the nearest that is surely it into a hole (chosen)


def away_from(known: Flags, hole: Flags, px_per_m: float) -> Flags:
    """Return the ``known`` texels (H, W) further than `NEAR_M` from the hole; all of them where those are too few."""
    far = known & (_away_px(hole) > NEAR_M * px_per_m)
    return far if far.sum() > LEAST_FAR * known.sum() else known


def rising_light(light: Floats, clean: Flags, seen: Flags, hole: Flags, px_per_m: float, most: float) -> Floats:
    """Return (H, W), >= 0: the tone by which light in the hole is above its membrane; 0 elsewhere, and at the rim.

    ``light`` (H, W, 3): tones where ``clean`` (H, W), and in the hole as filled. It rises away from all that is
    ``seen``, by ``most`` at most. It never falls: a place behind furniture is not darker than around for that."""
    if not hole.any() or not clean.any():
        return np.zeros(hole.shape, np.float32)
    away = _away_px(hole) / np.float32(NEAR_M * px_per_m)
    weight = np.where(clean, 1 - np.exp(-(away**2)), 0).astype(np.float32)
    total, share = np.zeros(hole.shape, np.float32), np.full(hole.shape, 1e-9, np.float32)
    level = grey(light)
    for around_m, part in zip(AROUND_M, (1.0, WIDE_SHARE), strict=True):
        total += np.float32(part) * blurred(level * weight, around_m * px_per_m)
        share += np.float32(part) * blurred(weight, around_m * px_per_m)
    rise = np.clip(total / share - level, 0, most)
    inward = cv2.distanceTransform((hole | ~seen).astype(np.uint8), cv2.DIST_L2, 5)
    rise *= 1 - np.exp(-((inward / np.float32(RISE_M * px_per_m)) ** 2))
    # Where nothing is far enough to measure, nothing rises.
    return np.where(hole & (share > 1e-5), rise, 0).astype(np.float32)


def _away_px(hole: Flags) -> Floats:
    """Return each texel's distance to the hole; beyond the texture where there is none."""
    if not hole.any():
        return np.full(hole.shape, 2.0 * max(hole.shape), np.float32)
    return np.asarray(cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, 5), np.float32)


@dataclass(frozen=True)
class PlainFill:
    """A plain texture without its hole."""

    values: Floats
    """(H, W, 3): the given values, bit for bit, but in the hole."""
    confidence: Floats
    profile: Floats
    """(H, 1, 3): tone of each row against the light."""
    clean: Flags
    """(H, W): known pixels that show the surface itself."""
    roughness: float
    """Standard deviation of the known tones about light and profile: 0.01 paint, above 0.1 a pattern."""


def fill_plain(
    values: Floats,
    known: Flags,
    hole: Flags,
    *,
    level_rows: bool,
    usual_rows: Floats | None = None,
    beside: Flags | None = None,
    most_rough: float = np.inf,
    px_per_m: float | None = None,
) -> PlainFill:
    """Fill ``hole`` of a texture (H, W, 3), linear light, from ``known``; ``level_rows``: rows have a profile.

    ``usual_rows`` (H, 3): tone that rows have on other walls (skirting), where this one's are not seen. ``beside``
    (H, W): what is seen though not to be learnt from; soft shadows there run out in the hole. A surface rougher than
    ``most_rough`` (what is seen through a window) gets no grain. ``px_per_m``: of a wall before which the hole's things
    stood; the light that they took from it is given back (`occlusion`). None: light goes on as it is at the rim."""
    known = known & ~hole
    scale = ToneScale.of(values, known)
    tone = scale.tone(values)
    # All below is about this level: where nothing says otherwise, the surface has it.
    if beside is not None:
        known = known & ~_other_colours(tone, known)
    level = np.median(tone[known], axis=0) if known.any() else np.zeros(3)
    tone = np.where(known[..., None], tone - level, 0).astype(np.float32)
    lit = known if px_per_m is None else away_from(known, hole, px_per_m)
    slow = fit_illumination(tone, lit, hole, None, bend=0.1)
    if px_per_m is not None:
        # Light does not grow on into what nobody sees.
        rim = spread(slow, lit)
        slow = np.clip(slow, rim - DRIFT, rim + DRIFT)
    rest = np.where(known[..., None], tone - slow, 0).astype(np.float32)
    profile = _profile(rest, known, hole, usual_rows) if level_rows else np.zeros((len(rest), 1, 3), np.float32)
    rest = np.where(known[..., None], rest - profile, 0).astype(np.float32)
    clean = known & ~_outliers(rest, known)
    for grain_px in (GRAIN_PX, COARSE_GRAIN * max(clean.shape)):
        mean, share = known_mean(rest, clean, grain_px)
        low = spread(mean, clean & (share > 0.3))
        grain = np.where(clean[..., None], rest - low, 0).astype(np.float32)
        roughness = float(grey(grain)[clean].std()) if clean.any() else 0.0
        if beside is not None or roughness < ROUGH:
            break
    if beside is None:
        # What is left of shade and stains at a floor's rim does not go on far.
        away = cv2.distanceTransform((~clean).astype(np.uint8), cv2.DIST_L2, 5)
        low *= np.exp(-away / np.float32(FADE * max(clean.shape)))[..., None]
    smooth = np.asarray(slow + profile + low, np.float32)
    if px_per_m is not None:
        smooth += rising_light(low, clean, known if beside is None else beside, hole, px_per_m, MOST_RISE)[..., None]
    filled = level + smooth
    if roughness <= most_rough:
        filled = filled + _copied_grain(grain, _calm(grain, clean), hole)
    out = values.copy()
    out[hole] = scale.light(filled[hole].astype(np.float32))
    return PlainFill(out, _confidence(clean, hole), profile, clean, roughness)


def _profile(rest: Floats, known: Flags, hole: Flags, usual: Floats | None) -> Floats:
    """Return (H, 1, 3): each row's median near the hole against the rows around it, as far as it is to be trusted.

    Of rows that are not seen near the hole, what is ``usual``."""
    columns = np.flatnonzero(hole.any(axis=0))
    reach = round(NEAR * rest.shape[1]) + 1
    near = slice(max(0, int(columns[0]) - reach), int(columns[-1]) + reach + 1) if len(columns) else slice(None)
    part, seen = rest[:, near], known[:, near]
    if not seen.any():
        part, seen = rest, known
    middle, trust = np.zeros((len(rest), rest.shape[2])), np.zeros(len(rest))
    for row in np.flatnonzero(seen.sum(axis=1) >= 3):
        values = part[row, seen[row]]
        at = np.median(values, axis=0)
        off = float(np.median(np.abs(grey(values) - grey(at.astype(np.float32)))))
        middle[row] = at
        # Of rows seen little, or with a window in them, little is to be learnt.
        trust[row] = len(values) / (len(values) + FEW * seen.shape[1]) / (1 + (off / UNEVEN) ** 2)
    weight = gaussian_filter1d(trust, SLOW_ROWS * len(rest))[:, None]
    slow = gaussian_filter1d(middle * trust[:, None], SLOW_ROWS * len(rest), axis=0) / np.maximum(weight, 1e-6)
    # Beside rows that nobody sees, nobody knows what is slow: no step where the seen ones end.
    inner = np.clip(2 * weight / max(float(weight.max()), 1e-6) - 1, 0, 1)
    found = (middle - slow) * trust[:, None] * inner
    if usual is not None:
        # The less a row of this wall is to be trusted, the more it is as on others.
        found += usual * np.clip(1 - trust / TRUSTED, 0, 1)[:, None]
        # Boards are alike along all walls, whatever stands before this one.
        boards = np.abs(usual).max(axis=1) > BOARD
        found[boards] = usual[boards]
    return np.asarray(found[:, None], np.float32)


def _other_colours(tone: Floats, known: Flags) -> Flags:
    """Return what has another colour than most of the surface, such as a picture on a painted wall, and its rim.

    However large it is; nothing where too much would be: then the surface has several colours. Rows that have it all
    along (skirting) are the surface's."""
    if not known.any():
        return np.zeros_like(known)
    mean, _ = known_mean(tone, known, GRAIN_PX)
    colour = mean - grey(mean)[..., None]
    off = largest_channel(np.abs(colour - np.median(colour[known], axis=0)))
    usual = OUTLIER * 1.4826 * float(np.median(off[known]))
    odd = known & (off > max(OTHER_COLOUR, usual))
    odd[odd.sum(axis=1) > MOST_OF_ROW * known.sum(axis=1)] = False
    if odd.sum() > MOST_OTHER * known.sum():
        return np.zeros_like(known)
    wide = 2 * round(GRAIN_PX) + 1
    return cv2.dilate(odd.astype(np.uint8), np.ones((wide, wide), np.uint8)).astype(bool) & known


def _outliers(rest: Floats, known: Flags) -> Flags:
    """Return what differs from its surface: sockets, pictures, cracks, and a few pixels around."""
    level = grey(rest)
    off = np.abs(level - known_mean(level, known, max(4.0, 0.06 * max(known.shape)))[0])
    spread_of = max(1.4826 * float(np.median(off[known])) if known.any() else 0.0, LEAST_SPREAD)
    odd = known & (off > OUTLIER * spread_of)
    return cv2.dilate(odd.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & known


def _calm(grain: Floats, clean: Flags) -> Flags:
    """Return the clean pixels around which nothing but grain is seen: no edges, cables, sockets."""
    if not clean.any():
        return clean
    energy, _ = known_mean(grey(grain) ** 2, clean, GRAIN_PX)
    lively = clean & (energy > CALM * float(np.median(energy[clean])) + 1e-8)
    out = clean & ~cv2.dilate(lively.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    return out if out.sum() > 0.05 * clean.sum() else clean


def _copied_grain(grain: Floats, clean: Flags, hole: Flags) -> Floats:
    """Return (H, W, 3): grain of known pixels of the same rows, else of others, blocks from different places."""
    out, (y, x), rng = np.zeros_like(grain), np.nonzero(hole), np.random.default_rng(11)
    rows = [(0, int(s * clean.shape[1] * r)) for r in np.arange(0.05, 0.9, 0.06) for s in (1, -1)]
    places = np.argwhere(clean)
    for turn in range(len(rows) + MOST_BLOCKS):
        if not len(y) or not len(places):
            break
        dy, dx = rows[turn] if turn < len(rows) else rng.choice(places) - rng.choice(np.column_stack([y, x]))
        i, j = y + dy, x + dx
        take = (i >= 0) & (i < clean.shape[0]) & (j >= 0) & (j < clean.shape[1])
        take[take] = clean[i[take], j[take]]
        out[y[take], x[take]] = grain[i[take], j[take]]
        y, x = y[~take], x[~take]
    return out


def _confidence(clean: Flags, hole: Flags) -> Floats:
    """Return 1 where known; in the hole less the further away what was seen is."""
    if not clean.any():
        return np.where(hole, 0, 1).astype(np.float32)
    away = cv2.distanceTransform((~clean).astype(np.uint8), cv2.DIST_L2, 3)
    return np.where(hole, 0.95 * np.exp(-away / (0.35 * max(clean.shape))), 1).astype(np.float32)


# Where a filling meets what is seen, both have one tone: what it is off by at the rim runs out into the hole.

RIM_TEXELS, LEAST_NEAR, ALONG_M = (1.5, 8.0), 0.02, 0.04
"""Neighbourhoods in which the tones of both sides are compared, across the rim and along it (chosen)."""
MOST_STEP, MOST_SHADE, MOST_COLOUR = 0.9, 0.4, 0.5
"""Tone, darker by tone, and colour, which no light makes, from which what is seen is another thing (by looking)."""
FADE_M = (0.5, 0.2)
"""On which the step runs out where what is seen is brighter (glow), and darker (shade, which is to go; chosen)."""


def seamless(values: Floats, fit: Flags, hole: Flags, px_per_m: float, most_rise: float) -> Floats:
    """Return a filled texture (H, W, 3), light, with its ``hole`` (H, W) in one tone with what is ``fit`` beside it."""
    scale = ToneScale.of(values, fit)
    tone = scale.tone(values)
    if most_rise:
        level = known_mean(tone, fit | hole, RISE_M / 2 * px_per_m)[0]
        tone = tone + rising_light(level, fit, fit, hole, px_per_m, most_rise)[..., None]
    # Texels between both show a bit of either; as wide as they are, as wide are the neighbourhoods.
    beside = hole & cv2.dilate((~hole).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    gap = cv2.distanceTransform((~fit).astype(np.uint8), cv2.DIST_L2, 5)[beside]
    reach = float(np.clip(0.7 * np.quantile(gap, 0.2), *RIM_TEXELS)) if len(gap) else RIM_TEXELS[0]
    (seen, near), (made, _) = (known_mean(tone, side, reach) for side in (fit, hole))
    step, rim = seen - made, np.zeros_like(hole)
    # What is seen is the surface where it is much as the filling, or as most of what is seen.
    for off in (step, seen - (np.median(tone[fit], axis=0) if fit.any() else made)):
        colour = largest_channel(np.abs(off - grey(off)[..., None]))
        rim |= hole & (near > LEAST_NEAR) & (colour < MOST_COLOUR) & (np.abs(grey(off)) < MOST_STEP)
    rim &= grey(step) > -MOST_SHADE
    away = cv2.distanceTransform((~rim).astype(np.uint8), cv2.DIST_L2, 5)
    step = known_mean(step, rim, max(ALONG_M * px_per_m, reach))[0]
    bright = np.maximum(step, 0)
    fading = [np.exp(-away / np.float32(fade_m * px_per_m))[..., None] for fade_m in FADE_M]
    more = spread(bright, rim) * fading[0] + spread(step - bright, rim) * fading[1]
    out = values.copy()
    out[hole] = scale.light(tone + more)[hole]
    return out
