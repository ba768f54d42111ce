"""Exposure plans: which stops, in which order, and which of them a scene does not need."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from station.errors import UsageError
from station.session import FrameStatistics, Side

PAPER_STOPS_S = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
"""The nine stops of Ji, Sawyer, Narasimhan 2023, section 3, longest first, nominal seconds."""

SHORTEST_S, LONGEST_S = 1 / 25_000, 60.0
CLIPPED_LIMIT_FRAC = 2e-6
DARK_LIMIT_FRAC = 2e-6
"""Shares of a frame below which it holds "nothing clipped", "nothing dark": about 45 pixels of 22 million,
what hot pixels and JPEG ringing make."""

Mode = Literal["full", "adaptive"]


@dataclass(frozen=True)
class BracketPlan:
    """Asked exposure times (longest first), the order in which they are taken, and who takes them."""

    stops_s: tuple[float, ...]
    order: tuple[int, ...]
    mode: Mode
    sides: tuple[Side, ...]

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

    Raises
    ------
    UsageError
        No stops, a repeated stop, or one outside 1/25000 .. 60 s.
    """
    stops = tuple(sorted((float(s) for s in stops_s), reverse=True))
    if not stops:
        raise UsageError("a bracket needs at least one exposure time", advice="give --stops or [bracket] stops")
    bad = [s for s in stops if not SHORTEST_S * 0.99 <= s <= LONGEST_S]
    if bad or len(set(stops)) != len(stops):
        raise UsageError(
            f"exposure times {bad} s are out of range" if bad else "an exposure time is given twice",
            where="bracket",
            advice=f"give different times between 1/25000 and {LONGEST_S:g} s",
        )
    order = tuple(reversed(range(len(stops)))) if mode == "full" else _outwards(len(stops))
    return BracketPlan(stops, order, mode, tuple(sides))


def _outwards(n_stops: int) -> tuple[int, ...]:
    """Return 0..n-1 from the middle outwards, longer first: 4 3 5 2 6 ... for nine."""
    middle = n_stops // 2
    steps = [0] + [sign * step for step in range(1, n_stops) for sign in (-1, 1)]
    return tuple(middle + step for step in steps if 0 <= middle + step < n_stops)


def useless_because(stop: int, frames: Mapping[int, FrameStatistics]) -> str | None:
    """Say why ``stop`` would add nothing to the frames of one camera so far, or None if it may.

    A shorter frame is useless once a longer one shows nothing clipped; a longer one once a shorter one shows
    nothing dark (stop indices grow towards shorter times).
    """
    longer = [i for i in frames if i < stop and frames[i].clipped_frac <= CLIPPED_LIMIT_FRAC]
    if longer:
        return f"nothing is clipped any more at stop {max(longer)}"
    shorter = [i for i in frames if i > stop and frames[i].dark_frac <= DARK_LIMIT_FRAC]
    if shorter:
        return f"nothing is dark any more at stop {min(shorter)}"
    return None


def parse_shutter(text: str) -> float:
    """Return seconds for ``"4"``, ``"1/60"``, ``"0.25"``, ``'1"3'`` is not understood.

    Raises
    ------
    UsageError
        Anything else, or a time out of range.
    """
    try:
        numerator, _, denominator = text.strip().removesuffix("s").partition("/")
        value = float(numerator) / (float(denominator) if denominator else 1.0)
    except (ValueError, ZeroDivisionError):
        value = float("nan")
    if not 1e-6 < value < 3600:
        raise UsageError(f"{text!r} is not an exposure time", advice="write 4, 0.25 or 1/60 (seconds)")
    return value
