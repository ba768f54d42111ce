from __future__ import annotations

import pytest

from mocks.instruments.clock import NOMINAL_START, ScaledClock
from tests.virtual_clock import VirtualClock


def test_virtual_time_passes_only_in_sleep() -> None:
    clock = VirtualClock()
    clock.sleep(86400)
    clock.sleep(-1)
    assert clock.monotonic_s() == 86400
    assert (clock.utc_now() - NOMINAL_START).days == 1


def test_scaled_time_runs_faster() -> None:
    clock = ScaledClock(1000)
    before_s = clock.monotonic_s()
    clock.sleep(10)
    clock.sleep(-5)
    assert clock.monotonic_s() - before_s >= 10
    assert (clock.utc_now() - NOMINAL_START).total_seconds() >= 10


def test_a_rate_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="rate"):
        ScaledClock(0)
