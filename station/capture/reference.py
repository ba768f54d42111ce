"""A frame repeated at the end of a bracket: what changed of the light meanwhile, as a whole and here or there."""

from __future__ import annotations

import statistics
from collections.abc import Mapping

from station.capture.events import Shot
from station.frames.facts import FrameFacts
from station.session.session import FrameStatistics, ReferenceRecord, Side

BEST_MEAN_FRAC = 0.4
"""Chosen: the stop that is repeated has its 8-bit mean nearest to this; most of it is then neither dark nor clipped."""
USABLE = (0.005, 0.8)  # chosen: linear patches outside are in the foot or the shoulder of a camera's curve
MOVED_FRAC = 0.25
"""Chosen: a patch that changed by more, against all others, shows a lamp or a patch of sun that moved; a sixteenth of a
panorama's width in which the noise of one frame is below 1 %."""
LEAST_MOVED = 2  # chosen: one may be a person


def best_stop(taken: Mapping[Side, Mapping[int, FrameStatistics]]) -> int | None:
    """Return the stop that all sides have and that shows most; None where they have none in common."""
    common = set.intersection(*(set(stops) for stops in taken.values())) if taken else set()
    return min(common, key=lambda i: sum(abs(s[i].mean_frac - BEST_MEAN_FRAC) for s in taken.values()), default=None)


def compare(shot: Shot, before: FrameFacts, after: FrameFacts, file: str | None, after_s: float) -> ReferenceRecord:
    """Return the ratio of two frames of one stop: the median of their patches, and how many parted from it.

    Linear brightness is by the sRGB curve, which is near enough to a camera's for the ratio of two alike frames.
    """
    low, high = USABLE
    ratios = [b / a for a, b in zip(before.patches, after.patches, strict=True) if low < a < high and low < b < high]
    ratio = statistics.median(ratios) if ratios else None
    moved = sum(abs(r / ratio - 1) > MOVED_FRAC for r in ratios) if ratio else 0
    return ReferenceRecord(
        side=shot.side,
        stop=shot.stop,
        file=file,
        taken_utc=shot.released_utc,
        after_s=after_s,
        ratio=ratio,
        patches=len(ratios),
        moved_patches=moved,
    )


def in_words(record: ReferenceRecord, limit_frac: float) -> str:
    """Return what a repeated frame shows beyond ``limit_frac``; "" where the light stood still, or nothing shows."""
    if record.ratio is None:
        return ""
    found = []
    if abs(record.ratio - 1) > limit_frac:
        found.append(f"the light changed by {record.ratio - 1:+.1%}")
    if record.moved_patches >= LEAST_MOVED:
        found.append(
            f"light moved in {record.moved_patches} of {record.patches} parts of the picture (a lamp, or the sun)"
        )
    return f"{record.side}: {' and '.join(found)} within {record.after_s:.0f} s" if found else ""
