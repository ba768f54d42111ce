"""Which stop of a bracket is best repeated at its end, to see what the light did meanwhile.

``python -m benchmarks.photometry.repeated_stop``: `SimpleRoom` and its sky under passing clouds (`LightDrift`), nine
stops from short to long as `daylit capture` times them. Repeated are the first frame, the mid-grey one (of the room, or
of each camera: what the station does), and the earliest that shows half as many usable parts as any; each is compared
as the station compares it. The error bar that calibration makes of it, |ratio - 1| / sqrt(12), plain and widened by the
bracket's time over the repeat's span, is held against how far the light of each stop was from the bracket's mean.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mocks.optics.camera import CANON_5D2, THETA_Z1, CameraOptics
from mocks.optics.picture_jobs import ImageJob, PictureJob, bands, expose, finish_image, render_band
from mocks.optics.sensor import Exposure
from mocks.worlds.light import LightDrift
from mocks.worlds.simple_room import SimpleRoom
from station.capture.bracket import PAPER_STOPS_S, estimate_bracket, plan_bracket, typical_cost
from station.capture.reference import USABLE, best_stop
from station.frames.check import FrameChecker
from station.frames.facts import FrameFacts
from station.session.session import Side

SIZES_PX = {Side.INDOOR: (840, 420), Side.OUTDOOR: (702, 468)}
OPTICS = {Side.INDOOR: THETA_Z1, Side.OUTDOOR: CANON_5D2}
CIRCLES = {Side.INDOOR: None, Side.OUTDOOR: (0.5, 0.5, 0.314)}
BRACKETS, AMPLITUDES = 24, (0.0, 0.1, 0.3)
Frames = Mapping[Side, Mapping[int, FrameFacts]]


class Row(NamedTuple):
    """One repeat: its ratio, usable parts, how far each stop's light was from the mean, the change, the span (s)."""

    ratio: float | None
    parts: int
    away: list[float]
    change: float
    span_s: float


def moments_s() -> tuple[list[float], float]:
    """Return when each stop begins (by stop), and when the repeat does, seconds."""
    plan = plan_bracket(PAPER_STOPS_S, "full", tuple(Side))
    costs = {Side.INDOOR: typical_cost("theta_z1"), Side.OUTDOOR: typical_cost("canon_5d2")}
    begun, now_s = [0.0] * len(PAPER_STOPS_S), 0.0
    for row in estimate_bracket(plan, costs).rows:
        begun[row.stop] = now_s
        now_s += row.pair_s
    return begun, now_s


def usable(facts: FrameFacts) -> int:
    """Return how many parts of a frame can be compared."""
    return sum(USABLE[0] < part < USABLE[1] for part in facts.patches)


def ratio_of(before: FrameFacts, after: FrameFacts) -> tuple[float | None, int]:
    """Return the median ratio of usable parts, and how many there are, as `station.capture.reference.compare` does."""
    low, high = USABLE
    pairs = zip(before.patches, after.patches, strict=True)
    found = [b / a for a, b in pairs if low < a < high and low < b < high]
    return (float(np.median(found)), len(found)) if found else (None, 0)


def choices(taken: Frames) -> dict[str, dict[Side, int]]:
    """Return the stops that may be repeated; stops count from the longest, which is taken last."""
    own = {side: best_stop({k: f.statistics for k, f in of.items()}) or 0 for side, of in taken.items()}
    early = {
        s: max(k for k, f in of.items() if usable(f) >= max(map(usable, of.values())) / 2) for s, of in taken.items()
    }
    return {
        "first": dict.fromkeys(Side, len(PAPER_STOPS_S) - 1),
        "the room's mid-grey": dict.fromkeys(Side, own[Side.INDOOR]),
        "own mid-grey": dict(own),
        "own earliest of half the parts": early,
    }


class Camera:
    """One camera before the room, at light of any strength."""

    def __init__(self, side: Side, folder: Path) -> None:
        self.optics: CameraOptics = OPTICS[side]
        self.side, self.size, self.path, self.folder = side, SIZES_PX[side], folder / side, folder
        job = ImageJob(SimpleRoom(), self.optics, self.size, self.path)
        self.path.touch()
        finish_image(job, [render_band(job, rows) for rows in bands(self.size)])

    def facts(self, checker: FrameChecker, stop: int, light: float, seed: int) -> FrameFacts:
        """Return what the station knows of a frame."""
        usual = self.optics.usual_settings
        exposure = Exposure(PAPER_STOPS_S[stop], usual.iso, usual.f_number)
        frame = self.folder / "frame.jpg"
        frame.write_bytes(expose(PictureJob(self.optics, self.size, self.path, exposure, (light,), seed)))
        return checker.inspect(frame, circle=CIRCLES[self.side])


def repeats(amplitude: float) -> Iterator[tuple[Side, str, int, Row]]:
    """Yield each repeat of each bracket: side, choice and stop."""
    begun, end_s = moments_s()
    with tempfile.TemporaryDirectory() as folder, FrameChecker() as checker:
        cameras = {side: Camera(side, Path(folder)) for side in Side}
        for seed in range(BRACKETS):
            drift = LightDrift(amplitude, seed=seed)
            light = [drift.factor(at) for at in begun]
            taken = {
                side: {k: camera.facts(checker, k, light[k], 100 * seed + k) for k in range(len(begun))}
                for side, camera in cameras.items()
            }
            away = [one / float(np.mean(light)) - 1 for one in light]
            for name, stops in choices(taken).items():
                for side, camera in cameras.items():
                    stop = stops[side]
                    again = camera.facts(checker, stop, drift.factor(end_s), 100 * seed + 50 + stop)
                    found = ratio_of(taken[side][stop], again)
                    yield (
                        side,
                        name,
                        stop,
                        Row(*found, away, drift.factor(end_s) / light[stop] - 1, end_s - begun[stop]),
                    )


def line(runs: list[Row], *, spread: bool) -> str:
    """Return what the repeats show; ``spread``: bars widened by the whole bracket's time over the repeat's span."""
    _, end_s = moments_s()
    read = [(run.ratio - 1 - run.change) for run in runs if run.ratio is not None]
    wrong = math.sqrt(float(np.mean(np.square(read)))) if read else math.nan
    bars = [abs((run.ratio or 1) - 1) / math.sqrt(12) * (end_s / run.span_s if spread else 1) for run in runs]
    off = [abs(one) for run in runs for one in run.away]
    wide = [bar for bar, run in zip(bars, runs, strict=True) for _ in run.away]
    outside = float(np.mean([a > 2 * b for a, b in zip(off, wide, strict=True)]))
    parts, span_s = np.mean([run.parts for run in runs]), np.mean([run.span_s for run in runs])
    away, bar = (float(np.sqrt(np.mean(np.square(some)))) for some in (off, bars))
    shown = f"{len(read)}/{len(runs)} | {parts:.0f} | {span_s:.0f} s"
    return f"{shown} | {wrong:.2%} | {away:.2%} | {bar:.2%} | {outside:.0%}"


def main() -> None:
    """Print a row for each amplitude, side and choice."""
    head = "clouds | side | repeated | compared | parts | span | error of ratio | light off the mean | bar"
    sys.stdout.write(f"| {head} | outside 2 bars |\n{'| --- ' * 10}|\n")
    for amplitude in AMPLITUDES:
        found = defaultdict[tuple[Side, str], list[Row]](list)
        for side, name, _, row in repeats(amplitude):
            found[side, name].append(row)
        for (side, name), runs in sorted(found.items()):
            for spread in (False, True):
                which = f"{name}, widened" if spread else name
                sys.stdout.write(f"| {amplitude:g} | {side} | {which} | {line(runs, spread=spread)} |\n")


if __name__ == "__main__":
    main()
