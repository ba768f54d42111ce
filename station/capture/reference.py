"""Frames beyond the stops of a bracket: further ones until its noise is as asked, and one repeated at the end, which
shows what changed of the light meanwhile, as a whole and here or there."""

import math
import statistics
from collections.abc import Collection, Mapping, Sequence

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
MOST_FURTHER, MOST_FURTHER_S, LONGEST_FURTHER_S = 6, 60.0, 30.0
"""Chosen: three times the light of a sky takes one to three exposures; the 5D Mark II's own longest time."""
Z95, SKY_LEAST = 1.96, 0.1  # of a normal distribution; chosen: what is darker than a tenth of the median is no sky


def best_stop(taken: Mapping[int, FrameStatistics]) -> int | None:
    """Return the stop of a side that shows most; None where there is none."""
    return min(taken, key=lambda stop: abs(taken[stop].mean_frac - BEST_MEAN_FRAC), default=None)


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
        found.append(f"light changed in {record.moved_patches} of {record.patches} parts of the picture (lamp or sun)")
    return f"{record.side}: {' and '.join(found)} within {record.after_s:.0f} s" if found else ""


def error_by_noise(side: Side, frames: Mapping[int, FrameFacts], stops_s: Sequence[float]) -> float:
    """Return what 95 % of a side's picture err by, relative, for the noise of single pixels alone; NaN: unknown.

    In the worst twentieth of its parts: outdoors of the sky, indoors of all, where those are the darkest. Frames count
    by the inverse variance of their light, as in the merge. ``frames``: by stop, measured on every pixel.
    """
    (low, high), light, weight = USABLE, dict[int, float](), dict[int, float]()
    shots = sorted(((stops_s[stop], facts) for stop, facts in frames.items()), key=lambda shot: shot[0])
    for time_s, facts in shots:
        for k, (at, noise) in enumerate(zip(facts.patches, facts.noise, strict=bool(facts.noise))):
            if noise and at < high:
                light[k], weight[k] = at / time_s, weight.get(k, 0.0) + (noise**-2 if at > low else 0.0)
    least = SKY_LEAST * statistics.median(light.values()) if light and side is Side.OUTDOOR else 0.0
    kept = sorted(weight[k] for k in light if light[k] >= least)
    worst = kept[len(kept) // 20] if kept else math.nan
    return Z95 / worst**0.5 if worst else math.inf


def further_time_s(error_frac: float, asked_frac: float, times_s: Collection[float]) -> float:
    """Return the exposure, seconds, that by itself brings an error down to what is asked, or helps most.

    Photons in proportion; and a longer one is better than repeats, for it rises above the rounding of codes and JPEG,
    which are the same each time. ``times_s``: what the cameras have, from the longest so far upwards.
    """
    wanted_s = min(times_s) * (error_frac / asked_frac) ** 2
    return min((time_s for time_s in times_s if time_s >= wanted_s), default=max(times_s))
