"""Frames that shifted against their neighbours (somebody touched the tripod): phase correlation of small windows.

Both frames of a pair are turned into logarithms of radiance and clipped to the range that both can show: then they
are the same picture, whatever the exposures, and what differs is the place.
"""

from __future__ import annotations

from processing.ground.arrays import Floats

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.calibration.merge_tables import Samples
from processing.frames import Codes

WINDOW_PX = 256
WINDOWS = 3
MIN_AGREEING = 2
SPARSE = 16
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


@dataclass(frozen=True)
class _Range:
    """The range of log2 radiance that two frames of a pair both show, and where their codes lie in it."""

    low: float
    high: float
    codes: npt.NDArray[np.int64]
    longer: Floats
    shorter: Floats
    """log2 radiance of green of ``codes``, cut to the range."""

    def longer_log2(self, window: Codes) -> Floats:
        """Return log2 of the green radiance of a window (..., 3) of the longer frame."""
        return _looked_up(window[..., 1], self.codes, self.longer)

    def shorter_log2(self, window: Codes) -> Floats:
        """Return log2 of the green radiance of a window (..., 3) of the shorter frame."""
        return _looked_up(window[..., 1], self.codes, self.shorter)


def frame_shifts(frames: Sequence[Codes], tables: Samples) -> list[Shift]:
    """Return the shifts between neighbours that are surely there; too little detail to tell counts as none."""
    found = []
    for place in range(1, len(frames)):
        before, after = frames[place - 1], frames[place]
        both = _range(tables, place)
        if both is None:
            continue
        seen = [s for s in (_shift(before[w], after[w], both) for w in _windows(before, both)) if s]
        if len(seen) < MIN_AGREEING:
            continue
        middle = np.median(seen, axis=0)
        spread = np.median(np.abs(np.array(seen) - middle))
        if np.hypot(*middle) >= MIN_SHIFT_PX and spread <= AGREE_PX:
            found.append(Shift(place, float(middle[0]), float(middle[1])))
    return found


def _windows(frame: Codes, both: _Range) -> list[tuple[slice, slice]]:
    """Return the windows of the longer frame with the most detail in the range that both frames show."""
    height, width = frame.shape[:2]
    tall, wide = min(WINDOW_PX, height // 2), min(WINDOW_PX, width // 2)
    if min(tall, wide) < MIN_PX:
        return []
    candidates = []
    for top in np.linspace(0, height - tall, min(4, height // tall)).astype(int):
        for left in np.linspace(0, width - wide, min(6, width // wide)).astype(int):
            window = (slice(top, top + tall), slice(left, left + wide))
            sparse = both.longer_log2(frame[window][::SPARSE, ::SPARSE])
            candidates.append((float(np.std(sparse)), top, left, window))
    candidates.sort(reverse=True, key=lambda one: one[:3])
    return [window for detail, _, _, window in candidates[:WINDOWS] if detail > MIN_DETAIL_STOPS]


def _range(tables: Samples, place: int) -> _Range | None:
    """Return the range that the frames before ``place`` and at it share; None where they share none."""
    (longer, _), (shorter, weight) = tables.sample(place - 1, tables.every), tables.sample(place, tables.every)
    good = weight[:, 1] * shorter[:, 1].astype(np.float64) ** 2 > MIN_SNR2
    low = float(np.log2(shorter[good, 1].min())) if good.any() else np.inf
    high = float(np.log2(tables.saturation[place - 1, 1]))
    if not low < high:
        return None
    cut = [np.clip(np.log2(np.maximum(v[:, 1], 1e-30)), low, high).astype(np.float32) for v in (longer, shorter)]
    return _Range(low, high, tables.every[:, 1], cut[0], cut[1])


def _looked_up(codes: npt.NDArray[np.unsignedinteger[Any]], known: npt.NDArray[np.int64], values: Floats) -> Floats:
    if codes.dtype == np.uint8 and len(known) == 256:
        return np.asarray(values[codes])
    return np.asarray(np.interp(codes, known, values), dtype=np.float32)


def _shift(before: Codes, after: Codes, both: _Range) -> tuple[float, float] | None:
    """Return (right, down) between two windows, or None where they hold too little in common."""
    a, b = both.longer_log2(before), both.shorter_log2(after)
    if min(np.std(a), np.std(b)) < MIN_DETAIL_STOPS:
        return None
    hanning = cv2.createHanningWindow((a.shape[1], a.shape[0]), cv2.CV_32F)
    (right, down), response = cv2.phaseCorrelate(a - a.mean(), b - b.mean(), hanning)
    return (float(right), float(down)) if response > MIN_RESPONSE else None
