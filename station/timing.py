"""What a bracket will cost: seconds, megabytes, and how much of the transfers hides behind exposures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from station.bracket import BracketPlan
from station.session import Side


@dataclass(frozen=True)
class CameraCost:
    """What one camera takes beside the exposure itself.

    ``overhead_s`` is everything between the wish to release and the next one but the exposure (release lag,
    readout, processing); ``frame_bytes`` what one exposure gives; ``overlaps`` whether transfers run behind exposures.
    """

    overhead_s: float
    frame_bytes: int
    rate_bytes_s: float
    overlaps: bool = True

    @property
    def transfer_s(self) -> float:
        """Seconds to fetch what one exposure gives."""
        return self.frame_bytes / self.rate_bytes_s


TYPICAL_COST = {
    "theta_z1": CameraCost(overhead_s=1.15, frame_bytes=8_500_000, rate_bytes_s=25e6),
    "canon_5d2": CameraCost(overhead_s=0.80, frame_bytes=6_500_000, rate_bytes_s=18e6),
}
"""With a JPEG only. For the dry run; assumed until measured on the instruments (no figures are published)."""
RAW_BYTES = {"theta_z1": 45_000_000, "canon_5d2": 26_000_000}
"""Of one DNG or CR2 (the 5D Mark II's: about 25.8 MB, Canon's manual)."""
TYPICAL_READING_S = 5.0


def typical_cost(kind: str, *, keep_raw: bool = False) -> CameraCost:
    """Return the typical cost of a camera, with a raw file beside each JPEG where it is kept."""
    cost = TYPICAL_COST[kind]
    return replace(cost, frame_bytes=cost.frame_bytes + RAW_BYTES[kind]) if keep_raw else cost


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

    Parameters
    ----------
    plan
        Stops, order and sides.
    costs
        Cost of each camera.
    reading_s
        Duration of the meter readings (first before the bracket, second after).
    exposure_s
        True exposure time of (side, stop) where it differs from the nominal one.
    """
    exposure_s = exposure_s or {}
    backlog_s = dict.fromkeys(plan.sides, 0.0)
    rows = []
    for stop in plan.order:
        nominal_s = plan.stops_s[stop]
        spans_s = {s: exposure_s.get((s, stop), nominal_s) + costs[s].overhead_s for s in plan.sides}
        pair_s = max(spans_s.values())
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
    total_s = first_s + exposures_s + max(unhidden_s, last_s)
    return Estimate(
        rows=tuple(rows),
        exposures_s=exposures_s,
        unhidden_transfer_s=unhidden_s,
        readings_s=first_s + last_s,
        total_s=total_s,
        bytes_expected=sum(row.bytes_expected for row in rows),
    )
