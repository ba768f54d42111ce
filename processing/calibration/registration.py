"""Frames that shifted against their neighbours (somebody touched the tripod): phase correlation of small windows.

Both frames of a pair are turned into logarithms of radiance and clipped to the range that both can show: then they
are the same picture, whatever the exposures, and what differs is the place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processing.calibration.merge_tables import Samples
from processing.frames import Codes

WINDOW_PX = 256
WINDOWS = 3
MIN_PX = 32
MIN_DETAIL_STOPS = 0.15
MIN_RESPONSE = 0.12
MIN_SHIFT_PX = 0.75
AGREE_PX = 0.75
MIN_SNR2 = 50.0


@dataclass(frozen=True)
class Shift:
    """How far the picture of frame ``place`` lies from that of the frame before it, in pixels to the right and down."""

    place: int
    right_px: float
    down_px: float


def frame_shifts(frames: Sequence[Codes], tables: Samples) -> list[Shift]:
    """Return the shifts between neighbours that are surely there; too little detail to tell counts as none."""
    found = []
    for place in range(1, len(frames)):
        before, after = frames[place - 1], frames[place]
        seen = [s for s in (_shift(before[w], after[w], tables, place) for w in _windows(before, tables, place)) if s]
        if len(seen) < min(2, WINDOWS):
            continue
        middle = np.median(seen, axis=0)
        spread = np.median(np.abs(np.array(seen) - middle))
        if np.hypot(*middle) >= MIN_SHIFT_PX and spread <= AGREE_PX:
            found.append(Shift(place, float(middle[0]), float(middle[1])))
    return found


def _windows(frame: Codes, tables: Samples, place: int) -> list[tuple[slice, slice]]:
    """Return the windows of the longer frame with the most detail in the range that both frames show."""
    height, width = frame.shape[:2]
    tall, wide = min(WINDOW_PX, height // 2), min(WINDOW_PX, width // 2)
    if min(tall, wide) < MIN_PX:
        return []
    low, high = _range(tables, place)
    candidates = []
    for top in np.linspace(0, height - tall, min(6, height // tall)).astype(int):
        for left in np.linspace(0, width - wide, min(8, width // wide)).astype(int):
            window = (slice(top, top + tall), slice(left, left + wide))
            sparse = _log2(frame[window][::8, ::8], tables, place - 1, low, high)
            candidates.append((float(np.std(sparse)), top, left, window))
    candidates.sort(reverse=True, key=lambda one: one[:3])
    return [window for detail, _, _, window in candidates[:WINDOWS] if detail > MIN_DETAIL_STOPS]


def _range(tables: Samples, place: int) -> tuple[float, float]:
    """Return the log2 radiances between which both green channels measure."""
    v, w = tables.sample(place, tables.every)
    good = w[:, 1] * v[:, 1].astype(np.float64) ** 2 > MIN_SNR2
    low = float(np.log2(v[good, 1].min())) if good.any() else np.inf
    return low, float(np.log2(tables.saturation[place - 1, 1]))


def _log2(codes: Codes, tables: Samples, place: int, low: float, high: float) -> npt.NDArray[np.float32]:
    """Return log2 of the green radiance of codes (..., 3), within low..high."""
    radiance = tables.sample(place, codes)[0][..., 1]
    return np.asarray(np.clip(np.log2(np.maximum(radiance, 1e-30)), low, max(low, high)))


def _shift(before: Codes, after: Codes, tables: Samples, place: int) -> tuple[float, float] | None:
    """Return (right, down) between two windows, or None where they hold too little in common."""
    low, high = _range(tables, place)
    if not low < high:
        return None
    a, b = (_log2(w, tables, p, low, high) for w, p in ((before, place - 1), (after, place)))
    if min(np.std(a), np.std(b)) < MIN_DETAIL_STOPS:
        return None
    hanning = cv2.createHanningWindow((a.shape[1], a.shape[0]), cv2.CV_32F)
    (right, down), response = cv2.phaseCorrelate(a - a.mean(), b - b.mean(), hanning)
    return (float(right), float(down)) if response > MIN_RESPONSE else None
