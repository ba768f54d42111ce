"""Exposure plans: which stops, in which order, and which of them a scene does not need."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

from station.errors import UsageError
from station.frames.rules import same_stop, seconds_text, stops_between
from station.session.session import FrameStatistics, Side

if TYPE_CHECKING:
    from station.capture.rig_file import RigFile

PAPER_STOPS_S = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
"""The nine stops of Ji, Sawyer, Narasimhan 2023, section 3, longest first, nominal seconds."""

SHORTEST_S, LONGEST_S = 1 / 25_000, 60.0
CLIPPED_LIMIT_FRAC = 2e-6  # chosen: 45 pixels of a Theta's picture, for glints
DARK_LIMIT_FRAC = 2e-6
"""Shares of a frame below which it holds "nothing clipped", "nothing dark": about 45 pixels of 22 million,
what hot pixels and JPEG ringing make."""

Mode = Literal["full", "adaptive"]
SUN_DEG_PER_MIN = 0.25
"""Of hour angle; across the sky it is that times the cosine of the declination, at least 0.917 of it."""
DRIFT_ALTITUDE_DEG = 30.0  # chosen: the sun's altitude that a drift is stated for where no day is known
HAURWITZ = 0.057
"""Clear sky: E = 1098 sin h exp(-0.057 / sin h), W/m2 on the horizontal (Haurwitz 1945, J. Meteorology 2)."""


@dataclass(frozen=True)
class BracketPlan:
    """Asked exposure times (longest first), the order in which they are taken, and who takes them."""

    stops_s: tuple[float, ...]
    order: tuple[int, ...]
    mode: Mode
    sides: tuple[Side, ...]
    reference: bool = False
    """Whether one stop is repeated at the end, to show what changed of the light."""
    noise_frac: float | None = None
    """What further stops are to bring the noise down to: see `station.capture.reference.further_time_s`."""

    def remaining(self, missing: Mapping[Side, Iterable[int]]) -> tuple[tuple[int, tuple[Side, ...]], ...]:
        """Return (stop, sides that still need it) in capture order."""
        wanted = {side: set(missing.get(side, ())) for side in self.sides}
        pairs = ((stop, tuple(s for s in self.sides if stop in wanted[s])) for stop in self.order)
        return tuple((stop, sides) for stop, sides in pairs if sides)


def plan_bracket(stops_s: Sequence[float], mode: Mode, sides: Sequence[Side]) -> BracketPlan:
    """Return the plan for ``stops_s`` (seconds, any order).

    A full bracket goes from short to long: the transfers of all earlier frames then hide behind the longest
    exposures. An adaptive one starts in the middle and works outwards in turn, so that the frame that decides about
    a stop is transferred and judged behind an exposure of the other direction.

    Raises `UsageError`: no stops, a repeated stop, or one outside 1/25000 .. 60 s.
    """
    stops = tuple(sorted((float(s) for s in stops_s), reverse=True))
    if not stops:
        raise UsageError("a bracket needs at least one exposure time", advice="give --stops or [bracket] stops")
    bad = [s for s in stops if not SHORTEST_S * 0.99 <= s <= LONGEST_S]
    if bad or len(set(stops)) != len(stops):
        text = f"exposure times {bad} s are out of range" if bad else "an exposure time is given twice"
        raise UsageError(text, where="bracket", advice=f"give different times between 1/25000 and {LONGEST_S:g} s")
    order = tuple(reversed(range(len(stops)))) if mode == "full" else _outwards(len(stops))
    return BracketPlan(stops, order, mode, tuple(sides))


def plan_of(
    file: RigFile, stops_s: Sequence[float], mode: Mode | None = None, noise_frac: float | None = None
) -> BracketPlan:
    """Return the plan of a rig's cameras, with other stops or another mode where they are given."""
    plan = plan_bracket(stops_s or file.bracket.stops_s(), mode or file.bracket.mode, tuple(file.cameras()))
    return replace(plan, reference=file.bracket.reference or noise_frac is not None, noise_frac=noise_frac)


def _outwards(n_stops: int) -> tuple[int, ...]:
    """Return 0..n-1 from the middle outwards, longer first: 4 3 5 2 6 ... for nine."""
    middle = n_stops // 2
    steps = [0] + [sign * step for step in range(1, n_stops) for sign in (-1, 1)]
    return tuple(middle + step for step in steps if 0 <= middle + step < n_stops)


def useless_because(stop: int, frames: Mapping[int, FrameStatistics], stops_s: Sequence[float]) -> str | None:
    """Say why ``stop`` would add nothing to the frames of one camera so far, or None if it may.

    A shorter frame is useless once a longer one shows nothing clipped; a longer one once a shorter one shows
    nothing dark. ``stops_s``: exposure time of each stop, seconds; further exposures come behind, longer than all.
    """
    whole = [i for i, of in frames.items() if of.clipped_frac <= CLIPPED_LIMIT_FRAC and stops_s[i] > stops_s[stop]]
    if whole:
        return f"already nothing clipped at stop {min(whole, key=stops_s.__getitem__)}"
    whole = [i for i, of in frames.items() if of.dark_frac <= DARK_LIMIT_FRAC and stops_s[i] < stops_s[stop]]
    return f"already nothing dark at stop {max(whole, key=stops_s.__getitem__)}" if whole else None


def unavailable_stops(stops_s: Sequence[float], offered_s: Sequence[float]) -> tuple[str, ...]:
    """Name the stops that a camera lacks, with the nearest it has, and those that would be one to it (seconds)."""
    found, taken = [], dict[float, float]()
    for stop_s in stops_s if offered_s else ():
        nearest_s = min(offered_s, key=lambda time_s: abs(stops_between(time_s, stop_s)))
        if not same_stop(stop_s, nearest_s):
            found.append(f"{seconds_text(stop_s)} (its nearest is {seconds_text(nearest_s)})")
        elif nearest_s in taken:
            found.append(f"{seconds_text(stop_s)} beside {seconds_text(taken[nearest_s])}: the same setting")
        taken[nearest_s] = stop_s
    return tuple(found)


def parse_shutter(text: str) -> float:
    """Return seconds for ``"4"``, ``"1/60"``, ``"0.25"``, ``'1"3'`` is not understood.

    Raises `UsageError`: anything else, or a time out of range.
    """
    try:
        numerator, _, denominator = text.strip().removesuffix("s").partition("/")
        value = float(numerator) / (float(denominator) if denominator else 1.0)
    except (ValueError, ZeroDivisionError):
        value = float("nan")
    if not 1e-6 < value < 3600:
        raise UsageError(f"{text!r} is not a valid exposure time", advice="write 4, 0.25 or 1/60 (seconds)")
    return value


def parse_shutters(text: str | None) -> tuple[float, ...]:
    """Return the seconds of exposure times with commas between; () for None and an empty text."""
    return tuple(map(parse_shutter, text.split(","))) if text else ()


# What a bracket will cost: seconds, megabytes, and how much of the transfers hides behind exposures.


@dataclass(frozen=True)
class CameraCost:
    """What one camera takes beside the exposure itself.

    ``overhead_s`` is everything between the wish to release and the next one but the exposure (release lag,
    readout, processing); ``frame_bytes`` what one exposure gives; ``overlaps`` whether transfers run behind exposures;
    ``least_s``: no exposure follows another sooner, however short.
    """

    overhead_s: float
    frame_bytes: int
    rate_bytes_s: float
    overlaps: bool = True
    least_s: float = 0.0

    @property
    def transfer_s(self) -> float:
        """Seconds to fetch what one exposure gives."""
        return self.frame_bytes / self.rate_bytes_s

    def span_s(self, exposure_s: float) -> float:
        """Return the seconds from one exposure of this length to the next."""
        return max(exposure_s + self.overhead_s, self.least_s)


TYPICAL_COST = {
    "theta_z1": CameraCost(overhead_s=2.75, frame_bytes=8_500_000, rate_bytes_s=25e6),
    "canon_5d2": CameraCost(overhead_s=0.80, frame_bytes=6_500_000, rate_bytes_s=18e6),
}
"""With a JPEG only. Theta: its file is there about 2.5 s after the shutter (theta-api-specs, issue 26); it may take
longer to be ready. The rest is assumed until measured on the instruments."""
RAW_CYCLE_S = {"theta_z1": 6.5, "canon_5d2": 0.0}
"""Theta with DNG: 6 to 7 s a frame whatever the shutter, 50 to 54 s for nine (EXIF of 14 brackets by the authors).
Multi-bracket and burst modes are faster and are not used: they cannot be released together with another camera."""
RAW_BYTES = {"theta_z1": 45_000_000, "canon_5d2": 26_000_000}
"""Of one DNG or CR2 (the 5D Mark II's: about 25.8 MB, Canon's manual)."""
TYPICAL_READING_S = 5.0  # chosen: aim, measure, read out


def typical_cost(kind: str, *, keep_raw: bool = False) -> CameraCost:
    """Return the typical cost of a camera, with a raw file beside each JPEG where it is kept."""
    cost = TYPICAL_COST[kind]
    if not keep_raw:
        return cost
    return replace(cost, frame_bytes=cost.frame_bytes + RAW_BYTES[kind], least_s=RAW_CYCLE_S[kind])


class LightDrift(NamedTuple):
    """How far sun and clear sky go during a bracket: an upper limit without clouds."""

    sun_deg: float
    sun_altitude_deg: float
    sky_frac_per_min: float
    """Relative change of the horizontal illuminance a minute."""
    sky_frac: float


def light_drift(duration_s: float, latitude_deg: float | None) -> LightDrift:
    """Return the drift during ``duration_s``: the sun by its hour angle, a clear sky by `HAURWITZ`.

    The altitude changes by at most 0.25 degrees a minute times the cosine of the latitude (None: the equator's).
    """
    minutes, h = duration_s / 60, math.radians(DRIFT_ALTITUDE_DEG)
    rise_rad_per_min = math.radians(SUN_DEG_PER_MIN) * math.cos(math.radians(latitude_deg or 0.0))
    per_min = rise_rad_per_min / math.tan(h) * (1 + HAURWITZ / math.sin(h))
    return LightDrift(SUN_DEG_PER_MIN * minutes, DRIFT_ALTITUDE_DEG, per_min, per_min * minutes)


@dataclass(frozen=True)
class StopRow:
    """One line of the dry-run table: a stop, its pair's duration, bytes, and transfer seconds hidden in it."""

    stop: int
    asked_s: float
    sides: tuple[Side, ...]
    pair_s: float
    bytes_expected: int
    hidden_transfer_s: float


@dataclass(frozen=True)
class Estimate:
    """The whole bracket: its rows and totals, in seconds and bytes."""

    rows: tuple[StopRow, ...]
    exposures_s: float
    unhidden_transfer_s: float
    readings_s: float
    total_s: float
    bytes_expected: int


def estimate_bracket(
    plan: BracketPlan,
    costs: Mapping[Side, CameraCost],
    *,
    reading_s: Sequence[float] = (),
    exposure_s: Mapping[tuple[Side, int], float] | None = None,
) -> Estimate:
    """Return the least time the plan can take at the given costs: the physical limit that `capture` is held to.

    Pairs follow one another, each as long as its slower camera; a camera's earlier frames are fetched while it
    exposes or waits for its partner; what is left comes after the last exposure, together with the second reading.

    ``reading_s``: duration of the meter readings (first before the bracket, second after).
    ``exposure_s``: true exposure time of (side, stop) where it differs from the nominal one.
    """
    exposure_s = exposure_s or {}
    backlog_s = dict.fromkeys(plan.sides, 0.0)
    rows = []
    for stop in (*plan.order, *plan.order[len(plan.order) // 2 :][: int(plan.reference)]):
        nominal_s = plan.stops_s[stop]
        spans_s = {s: costs[s].span_s(exposure_s.get((s, stop), nominal_s)) for s in plan.sides}
        pair_s = max(spans_s.values(), default=0.0)
        hidden_s = 0.0
        for side in plan.sides:
            window_s = pair_s if costs[side].overlaps else pair_s - spans_s[side]
            fetched_s = min(backlog_s[side], window_s)
            hidden_s += fetched_s
            backlog_s[side] += costs[side].transfer_s - fetched_s
        size = sum(costs[s].frame_bytes for s in plan.sides)
        rows.append(StopRow(stop, nominal_s, plan.sides, pair_s, size, hidden_s))
    exposures_s = sum(row.pair_s for row in rows)
    unhidden_s = max(backlog_s.values(), default=0.0)
    first_s, last_s = (*reading_s, 0.0, 0.0)[:2]
    return Estimate(
        rows=tuple(rows),
        exposures_s=exposures_s,
        unhidden_transfer_s=unhidden_s,
        readings_s=first_s + last_s,
        total_s=first_s + exposures_s + max(unhidden_s, last_s),
        bytes_expected=sum(row.bytes_expected for row in rows),
    )
