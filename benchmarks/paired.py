"""Ours against a rival, in turn on the same input: on a shared, noisy machine only ratios of neighbours count."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Cost:
    """What one run took: CPU seconds of this process and of its ended children, and wall time."""

    cpu_s: float
    wall_s: float


@dataclass(frozen=True)
class Comparison:
    """Ours over the rival's: below 1 we are cheaper. Ratios are of neighbours, the spread is robust."""

    cpu_ratio: float
    cpu_ratio_spread: float
    """1.4826 times the median absolute deviation of the pairs' ratios: a standard deviation without outliers."""
    wall_ratio: float
    wall_ratio_spread: float
    ours: Cost
    rival: Cost
    pairs: int

    def metrics(self, rival: str) -> dict[str, float]:
        """Return the figures with keys that name the rival."""
        return {
            f"cpu_ratio_{rival}": round(self.cpu_ratio, 4),
            f"cpu_ratio_{rival}_spread": round(self.cpu_ratio_spread, 4),
            f"wall_ratio_{rival}": round(self.wall_ratio, 4),
        }


def cost_of(work: Callable[[], object]) -> Cost:
    """Run once and return what it took."""
    before, start_s = os.times(), time.perf_counter()
    work()
    wall_s, after = time.perf_counter() - start_s, os.times()
    return Cost(sum(after[:4]) - sum(before[:4]), wall_s)


def compare(
    ours: Callable[[], object], rival: Callable[[], object], *, pairs: int = 5, warm: bool = True
) -> Comparison:
    """Run both ``pairs`` times in the order A B B A A B B A ..., after one run each that does not count.

    CPU seconds come in ticks of 10 ms: give work that takes 0.2 s at least, or repeat it within.
    """
    if warm:
        ours()
        rival()
    found: list[tuple[Cost, Cost]] = []
    for number in range(pairs):
        if number % 2:
            theirs = cost_of(rival)
            found.append((cost_of(ours), theirs))
        else:
            mine = cost_of(ours)
            found.append((mine, cost_of(rival)))
    cpu = [a.cpu_s / max(b.cpu_s, 1e-9) for a, b in found]
    wall = [a.wall_s / max(b.wall_s, 1e-9) for a, b in found]
    return Comparison(
        statistics.median(cpu),
        robust_spread(cpu),
        statistics.median(wall),
        robust_spread(wall),
        median_cost([a for a, _ in found]),
        median_cost([b for _, b in found]),
        pairs,
    )


def median_cost(costs: Sequence[Cost]) -> Cost:
    """Return the medians."""
    return Cost(statistics.median(c.cpu_s for c in costs), statistics.median(c.wall_s for c in costs))


def repeated(work: Callable[[], object], runs: int) -> Cost:
    """Return the medians of several runs, after one that does not count."""
    work()
    return median_cost([cost_of(work) for _ in range(runs)])


def robust_spread(values: Sequence[float]) -> float:
    """Return 1.4826 times the median absolute deviation: 0 for a single value."""
    middle = statistics.median(values)
    return 1.4826 * statistics.median(abs(value - middle) for value in values)
