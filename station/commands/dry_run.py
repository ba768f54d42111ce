"""``daylit capture --dry-run``: the exposures as a table, what they take, and how far the light moves meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from station.commands.views import answer

if TYPE_CHECKING:
    from station.capture.bracket import BracketPlan, Estimate
    from station.capture.rig_file import RigFile


def dry_run(file: RigFile, options: dict[str, Any]) -> int:
    """Print the table; `UsageError` for a stop that a camera of the rig does not have."""
    from station.capture.bracket import TYPICAL_READING_S, estimate_bracket, light_drift, plan_of, typical_cost

    tables = file.cameras()
    plan = plan_of(file, options["stops"], options["bracket"])
    _require_stops(file, plan)
    costs = {side: typical_cost(table.kind, keep_raw=table.keep_raw) for side, table in tables.items()}
    estimate = estimate_bracket(
        plan, costs, reading_s=(TYPICAL_READING_S,) * 2 if file.meter and file.meter.is_read else ()
    )
    drift = light_drift(estimate.total_s, file.site.latitude_deg)
    rows = [vars(row) | {"sides": list(row.sides)} for row in estimate.rows]
    totals = {k: v for k, v in vars(estimate).items() if k != "rows"}
    lines = [
        *_table(estimate),
        f"meanwhile the sun moves by up to {drift.sun_deg:.2f} degrees; a clear sky with the sun at "
        f"{drift.sun_altitude_deg:.0f} degrees changes by up to {100 * drift.sky_frac_per_min:.1f} % a minute, "
        f"{100 * drift.sky_frac:.1f} % in all (daylit plan: for your place and day)",
        "camera overheads and rates are typical figures, not measured on your instruments",
    ]
    if plan.mode == "adaptive":
        lines.append("adaptive: the most it can take; stops that the frames prove useless are left out")
    facts = {"mode": plan.mode, "rows": rows, **totals, **drift._asdict()}
    return answer(facts, lines, as_json=options["as_json"])


def _require_stops(file: RigFile, plan: BracketPlan) -> None:
    from station.capture.bracket import unavailable_stops
    from station.capture.rig import known_times_s
    from station.errors import UsageError

    lacking = [
        f"{side} ({table.kind}): {', '.join(names)}"
        for side, table in file.cameras().items()
        if (names := unavailable_stops(plan.stops_s, known_times_s(table.kind)))
    ]
    if lacking:
        raise UsageError(
            f"stops that a camera does not have: {'; '.join(lacking)}",
            where="bracket",
            advice="change --stops, or [bracket] stops of the rig",
        )


def _table(estimate: Estimate) -> Iterator[str]:
    from station.session.session import shutter_label

    yield f"{'order':>5} {'exposure':>9} {'cameras':<17} {'pair s':>7} {'MB':>6} {'transfer hidden s':>18}"
    for order, row in enumerate(estimate.rows, 1):
        yield (
            f"{order:>5} {shutter_label(row.asked_s):>9} {'+'.join(row.sides):<17} {row.pair_s:>7.2f} "
            f"{row.bytes_expected / 1e6:>6.1f} {row.hidden_transfer_s:>18.2f}"
        )
    yield (
        f"exposures {estimate.exposures_s:.1f} s, readings {estimate.readings_s:.1f} s, transfers left at the end "
        f"{estimate.unhidden_transfer_s:.1f} s: about {estimate.total_s:.0f} s "
        f"and {estimate.bytes_expected / 1e6:.0f} MB"
    )
