"""Completion of a rectified texture by its own repeats: floors of tiles, parquet, planks (the paper's near-periodic
patterns, without minutes of optimisation).

The known part tells its lattice (`near_periodic_lattice`); light is taken out (`illumination`), the hole is filled with
copies one or more lattice steps away (`near_periodic_fill`), and light is put back. Where the pattern repeats in one
direction only, copies come from along that direction; where it does not repeat, `complete` says so and gives copies
that fit their surroundings.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from processing.removal.illumination import fit_illumination
from processing.removal.near_periodic_blend import blend, met_to_rim
from processing.removal.near_periodic_correlation import (
    Doubles,
    Flags,
    Floats,
    SelfCorrelation,
    high_passed,
    self_correlation,
)
from processing.removal.near_periodic_fill import Weights, solve_weights
from processing.removal.near_periodic_lattice import Lattice, find_lattice
from processing.removal.near_periodic_offsets import Line, find_line, lattice_offsets, line_offsets, loose_offsets
from processing.removal.tone import ToneScale, grey

SEARCH_PX = 400
"""Of the longer side of the picture on which the lattice is sought."""
SOLVE_PX = 100_000
"""Pixels of the window on which copies are chosen."""
RIM_PX = 6.0
PASSES = 3


class Repeat(StrEnum):
    """How a texture repeats."""

    LATTICE = "lattice"
    LINE = "line"
    """Along one direction: planks."""
    NONE = "none"


@dataclass(frozen=True)
class Completion:
    """A texture without its hole."""

    values: Floats
    """(h, w, 3): the given values, bit for bit, but in the hole."""
    confidence: Floats
    """(h, w), 0..1: in the hole how well the copies agree with their surroundings; 1 where known."""
    repeat: Repeat
    lattice: Lattice | None
    """In the texture's pixels."""
    illumination: Floats
    """(h, w, 3): the factor by which the light differs from its mean."""


def complete(values: Floats, known: Flags, hole: Flags, *, lively: float = 0.6) -> Completion:
    """Fill ``hole`` of a texture (h, w, 3), linear light >= 0, from the ``known`` pixels; both masks (h, w).

    Pixels in neither mask are left as they are. Nothing known: the hole stays 0 with confidence 0.
    """
    known = known & ~hole
    if not hole.any() or known.sum() < 4:
        confidence = np.where(hole, 0, 1).astype(np.float32)
        out = np.where(hole[..., None], 0 if not known.any() else values[known].mean(axis=0), values)
        return Completion(out.astype(np.float32), confidence, Repeat.NONE, None, np.ones_like(values))
    scale = ToneScale.of(values, known)
    tone = np.where(known[..., None], scale.tone(values), 0).astype(np.float32)
    lattice, line, correlation, factor = analysed(grey(tone), known)
    slow = fit_illumination(tone, known, hole, lattice)
    flat = np.where(known[..., None], tone - slow, 0).astype(np.float32)
    repeat = Repeat.LATTICE if lattice else Repeat.LINE if line else Repeat.NONE
    offsets, cell = _offsets(lattice, line, correlation, factor, known, hole)
    filled, confidence = _filled(flat, known, hole, offsets, cell, lively if repeat is not Repeat.NONE else 1.0)
    out = values.copy()
    out[hole] = scale.light((filled + slow)[hole])
    return Completion(out, confidence, repeat, lattice, np.exp(slow).astype(np.float32))


def analysed(tone: Floats, known: Flags) -> tuple[Lattice | None, Line | None, SelfCorrelation, float]:
    """Return lattice, else line (both in the texture's pixels), and the correlation of a picture ``factor`` as large."""
    factor = min(1.0, SEARCH_PX / max(tone.shape))
    small, share = _smaller(tone[..., None], known, factor)
    seen = share > 0.5
    correlation = self_correlation(high_passed(small[..., 0], seen, 0.1 * min(small.shape[:2])), seen)
    lattice = find_lattice(correlation)
    if lattice is not None:
        scaled = Lattice(lattice.a_px / factor, lattice.b_px / factor, lattice.strength)
        return scaled, None, correlation, factor
    return None, find_line(correlation), correlation, factor


def _smaller(tone: Floats, known: Flags, factor: float) -> tuple[Floats, Floats]:
    """Return the known pixels' mean (h, w, c) in a picture ``factor`` as large, and the share that is known."""
    if factor >= 1.0:
        return tone, known.astype(np.float32)
    size = tuple(max(2, round(n * factor)) for n in tone.shape[1::-1])
    weight = known.astype(np.float32)
    share = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    total = cv2.resize(tone * weight[..., None], size, interpolation=cv2.INTER_AREA).reshape(*share.shape, -1)
    return np.asarray(total / np.maximum(share, 1e-6)[..., None], np.float32), share


def _offsets(
    lattice: Lattice | None, line: Line | None, correlation: SelfCorrelation, factor: float, known: Flags, hole: Flags
) -> tuple[Doubles, float]:
    """Return the shifts to try, in the texture's pixels, and how large a neighbourhood tells whether one fits."""
    if lattice is not None:
        cell = float(np.sqrt(abs(np.linalg.det(np.stack([lattice.a_px, lattice.b_px])))))
        return lattice_offsets(lattice, known, hole), cell
    cell = 0.12 * max(known.shape)
    if line is not None:
        return line_offsets(line, correlation) / factor, cell
    return loose_offsets(correlation) / factor, cell


def _filled(
    flat: Floats, known: Flags, hole: Flags, offsets: Doubles, cell: float, lively: float
) -> tuple[Floats, Floats]:
    """Return tone and confidence; what no copy reaches is filled from what was filled before."""
    tone, seen, left = flat.copy(), known.copy(), hole.copy()
    confidence = known.astype(np.float32)
    for turn in range(PASSES):
        done, tone_now, sure = _one_pass(tone, seen, left, offsets, cell, lively)
        if not done.any():
            break
        tone[done] = tone_now[done]
        confidence[done] = sure[done] * 0.7**turn
        seen, left = seen | done, left & ~done
        if not left.any():
            break
    if left.any():
        from processing.removal.membrane import spread

        tone = np.where(left[..., None], spread(tone, seen), tone)
    return tone, confidence


def _one_pass(
    tone: Floats, known: Flags, hole: Flags, offsets: Doubles, cell: float, lively: float
) -> tuple[Flags, Floats, Floats]:
    margin = round(max(0.6 * cell, 2 * RIM_PX)) + 2
    window = _window(hole, margin)
    area = (window[0].stop - window[0].start) * (window[1].stop - window[1].start)
    scale = min(1.0, float(np.sqrt(SOLVE_PX / area)))
    weights, small_window = _solved(tone, known, hole, offsets, window, scale, cell)
    mean, offered = blend(tone, known, weights, window, scale, lively=lively)
    met = met_to_rim(mean, offered, tone[window], known[window], hole[window], RIM_PX)
    done, filled, sure = np.zeros_like(hole), np.zeros_like(tone), np.zeros(hole.shape, np.float32)
    done[window] = hole[window] & offered
    filled[window] = met
    size = met.shape[1::-1]
    cost = cv2.resize(weights.cost, size, interpolation=cv2.INTER_LINEAR)
    sure[window] = np.exp(-1.5 * np.sqrt(np.maximum(cost, 0)))
    return done, filled, sure


def _solved(
    tone: Floats, known: Flags, hole: Flags, offsets: Doubles, window: tuple[slice, slice], scale: float, cell: float
) -> tuple[Weights, tuple[slice, slice]]:
    small, share = _smaller(tone, known, scale)
    seen = share > 0.99
    lack = ~seen if scale >= 1.0 else _smaller(hole[..., None].astype(np.float32), np.ones_like(hole), scale)[0][..., 0] > 0
    lack = (lack & hole) if scale >= 1.0 else lack & ~seen
    small = np.where(seen[..., None], small, 0).astype(np.float32)
    rows, columns = (slice(int(s.start * scale), max(int(s.start * scale) + 2, int(np.ceil(s.stop * scale)))) for s in window)
    rows = slice(rows.start, min(rows.stop, small.shape[0]))
    columns = slice(columns.start, min(columns.stop, small.shape[1]))
    box = max(7, round(0.35 * cell * scale))
    found = solve_weights(small, seen, lack, offsets * scale, (rows, columns), box_px=box)
    return found, (rows, columns)


def _window(hole: Flags, margin: int) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(hole.any(axis=1)), np.flatnonzero(hole.any(axis=0))
    return (
        slice(max(0, int(rows[0]) - margin), min(hole.shape[0], int(rows[-1]) + margin + 1)),
        slice(max(0, int(columns[0]) - margin), min(hole.shape[1], int(columns[-1]) + margin + 1)),
    )
