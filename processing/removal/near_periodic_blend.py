"""The filled hole at full size: the copies' weighted mean, with the fine detail of the best one, met to the rim."""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

import cv2
import numpy as np

from processing.removal.blurs import blurred
from processing.removal.membrane import spread
from processing.removal.near_periodic_fill import Manner, Weights, shifted

MIN_SHARE = 0.01
LARGEST_STEP = 0.3
"""Tone by which the rim may pull a filling."""


def blend(
    tone: Floats, known: Flags, weights: Weights, window: tuple[slice, slice], scale: float, manner: Manner
) -> tuple[Floats, Flags]:
    """Return the window's copies blended (h, w, c), and where any copy offers something.

    ``weights`` are those of a picture ``scale`` (<= 1) times as large. The best copy's seams are feathered.
    """
    # Cubic interpolation takes two pixels all round.
    inner = cv2.erode(known.astype(np.uint8), np.ones((5, 5), np.uint8), borderType=cv2.BORDER_REPLICATE).astype(bool)
    rows, columns = window
    size = (columns.stop - columns.start, rows.stop - rows.start)
    mean = np.zeros((size[1], size[0], tone.shape[2]), np.float32)
    sharp = np.zeros_like(mean)
    total, sharp_total = np.zeros(mean.shape[:2], np.float32), np.zeros(mean.shape[:2], np.float32)
    for index, offset in enumerate(weights.offsets):
        chosen = (weights.best == index).astype(np.float32)
        share = _enlarged(weights.share[index], size)
        hard = cv2.GaussianBlur(_enlarged(chosen, size), (0, 0), 1.0)
        part = _box((share > MIN_SHARE) | (hard > MIN_SHARE))
        if part is None:
            continue
        place = (
            slice(rows.start + part[0].start, rows.start + part[0].stop),
            slice(columns.start + part[1].start, columns.start + part[1].stop),
        )
        copy, some = shifted(tone, inner, offset / scale, place, cubic=True)
        w = share[part] * some
        h = hard[part] * some
        mean[part] += copy * w[..., None]
        total[part] += w
        sharp[part] += copy * h[..., None]
        sharp_total[part] += h
    offered = total > 1e-3
    mean /= np.maximum(total, 1e-6)[..., None]
    sharp = np.where((sharp_total > 1e-3)[..., None], sharp / np.maximum(sharp_total, 1e-6)[..., None], mean)
    # Where nothing is offered there is no change either: its blur would reach over.
    change = np.where(offered[..., None], sharp - mean, 0).astype(np.float32)
    detail = change - blurred(change, manner.detail_px)
    return np.asarray(mean + np.float32(manner.lively) * detail, np.float32), offered


def _enlarged(small: Floats, size: tuple[int, int]) -> Floats:
    if small.shape == (size[1], size[0]):
        return small
    return np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _box(flags: Flags) -> tuple[slice, slice] | None:
    """Return the bounding box of what is set."""
    rows, columns = np.flatnonzero(flags.any(axis=1)), np.flatnonzero(flags.any(axis=0))
    if not len(rows):
        return None
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def met_to_rim(filled: Floats, offered: Flags, tone: Floats, known: Flags, hole: Flags, rim_px: float) -> Floats:
    """Return the filling (h, w, c) moved by a membrane so that it meets the tones around the hole without a step."""
    width = max(1, round(rim_px))
    near = cv2.dilate(hole.astype(np.uint8), np.ones((2 * width + 1,) * 2, np.uint8)).astype(bool)
    ring = near & known & offered
    if not ring.any():
        return filled
    weight = ring.astype(np.float32)
    sigma = max(rim_px / 2, 0.5)
    share = blurred(weight, sigma)
    step = blurred(np.where(ring[..., None], tone - filled, 0).astype(np.float32), sigma)
    mean = step / np.maximum(share, 1e-6)[..., None]
    bounded = np.clip(mean, -LARGEST_STEP, LARGEST_STEP).astype(np.float32)
    return np.asarray(filled + spread(bounded, ring & (share > 1e-3)), np.float32)
