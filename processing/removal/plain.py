"""Plain surfaces: walls and ceilings of one colour, with light that falls across them, skirting, and grain.

A hole is filled with the continued light, the profile of the rows beside it (skirting and cornice run level along a
wall) and grain copied from along the same rows, so that the result is neither smooth nor smeared.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from processing.removal.illumination import fit_illumination
from processing.removal.membrane import spread
from processing.removal.near_periodic_correlation import Flags, Floats
from processing.removal.tone import ToneScale, grey

OUTLIER = 4.0
"""Robust standard deviations from its row's profile beyond which a pixel is a socket, a picture, a switch."""
LEAST_SPREAD = 0.01
GRAIN_PX = 3.0
NEAR = 0.25
"""Of the texture's width: how far from the hole rows are still looked at for their profile."""


@dataclass(frozen=True)
class PlainFill:
    """A plain texture without its hole."""

    values: Floats
    """(h, w, 3): the given values, bit for bit, but in the hole."""
    confidence: Floats
    roughness: float
    """Standard deviation of the known tones about light and profile: 0.01 paint, above 0.1 a pattern."""


def fill_plain(values: Floats, known: Flags, hole: Flags, *, level_rows: bool) -> PlainFill:
    """Fill ``hole`` of a texture (h, w, 3), linear light, from ``known``; ``level_rows``: rows have a profile (walls)."""
    known = known & ~hole
    scale = ToneScale.of(values, known)
    tone = np.where(known[..., None], scale.tone(values), 0).astype(np.float32)
    slow = fit_illumination(tone, known, hole, None, bend=0.1)
    rest = np.where(known[..., None], tone - slow, 0).astype(np.float32)
    profile = _profile(rest, known, hole) if level_rows else np.zeros((len(rest), 1, 3), np.float32)
    rest = np.where(known[..., None], rest - profile, 0).astype(np.float32)
    clean = known & ~_outliers(rest, known)
    low = _low(rest, clean)
    grain = np.where(clean[..., None], rest - low, 0).astype(np.float32)
    filled = slow + profile + low + _copied_grain(grain, clean, hole)
    out = values.copy()
    out[hole] = scale.light(filled[hole])
    roughness = float(grey(grain)[clean].std()) if clean.any() else 0.0
    return PlainFill(out, _confidence(clean, hole), roughness)


def _profile(rest: Floats, known: Flags, hole: Flags) -> Floats:
    """Return (h, 1, 3): each row's median over the known pixels near the hole; rows without any take their neighbours'."""
    columns = np.flatnonzero(hole.any(axis=0))
    reach = round(NEAR * rest.shape[1]) + 1
    near = slice(max(0, int(columns[0]) - reach), int(columns[-1]) + reach + 1) if len(columns) else slice(None)
    part, seen = rest[:, near], known[:, near]
    if not seen.any():
        part, seen = rest, known
    with np.errstate(all="ignore"):
        masked = np.ma.masked_array(part, ~np.repeat(seen[..., None], part.shape[2], axis=2))
        middle = np.ma.median(masked, axis=1)
    given = seen.sum(axis=1) >= 3
    rows = np.where(given[:, None], np.ma.filled(middle, 0.0), 0).astype(np.float32)
    if not given.any():
        return np.zeros((len(rest), 1, rest.shape[2]), np.float32)
    at = np.arange(len(rest))
    return np.stack([np.interp(at, at[given], rows[given, c]) for c in range(rest.shape[2])], -1)[:, None].astype(np.float32)


def _outliers(rest: Floats, known: Flags) -> Flags:
    """Return what differs from its surface: sockets, pictures, cracks, and a few pixels around."""
    level = grey(rest)
    if not known.any():
        return np.zeros_like(known)
    wide = max(4.0, 0.06 * max(known.shape))
    share = cv2.GaussianBlur(known.astype(np.float32), (0, 0), wide)
    local = cv2.GaussianBlur(np.where(known, level, 0).astype(np.float32), (0, 0), wide) / np.maximum(share, 1e-4)
    off = np.abs(level - local)
    spread_of = max(1.4826 * float(np.median(off[known])), LEAST_SPREAD)
    odd = known & (off > OUTLIER * spread_of)
    return cv2.dilate(odd.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & known


def _low(rest: Floats, clean: Flags) -> Floats:
    """Return (h, w, 3) what is left of the light, smooth, and its membrane through holes."""
    share = cv2.GaussianBlur(clean.astype(np.float32), (0, 0), GRAIN_PX)
    low = cv2.GaussianBlur(np.where(clean[..., None], rest, 0).astype(np.float32), (0, 0), GRAIN_PX)
    low = low / np.maximum(share, 1e-4)[..., None]
    return spread(low.astype(np.float32), clean & (share > 0.3))


def _copied_grain(grain: Floats, clean: Flags, hole: Flags) -> Floats:
    """Return (h, w, 3): grain of known pixels of the same rows, else of others, blocks from different places."""
    height, width = clean.shape
    out, left = np.zeros_like(grain), hole.copy()
    rng = np.random.default_rng(11)
    near = np.arange(0.05, 0.9, 0.06)
    shifts = [(0, int(s * width * r)) for r in near for s in (1, -1)]
    shifts += [(int(rng.integers(-height // 2, height // 2 + 1)), int(rng.integers(-width, width))) for _ in range(24)]
    for dy, dx in shifts:
        if not left.any():
            break
        move = np.array([[1, 0, dx], [0, 1, dy]], np.float64)
        there = cv2.warpAffine(
            clean.astype(np.uint8), move, (width, height), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        ).astype(bool)
        take = left & there
        if take.any():
            copy = cv2.warpAffine(grain, move, (width, height), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
            out[take] = copy[take]
            left &= ~take
    return out


def _confidence(clean: Flags, hole: Flags) -> Floats:
    """Return 1 where known; in the hole less the further away what was seen is."""
    if not clean.any():
        return np.where(hole, 0, 1).astype(np.float32)
    away = cv2.distanceTransform((~clean).astype(np.uint8), cv2.DIST_L2, 3)
    return np.where(hole, 0.95 * np.exp(-away / (0.35 * max(clean.shape))), 1).astype(np.float32)
