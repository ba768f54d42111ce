from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocks.instruments.faults import CONDITIONS, Fault, FaultKind, FaultRunner, FaultSchedule, Moment, Phase
from tests.mocks.instruments.fault_dicts import dict_of, fault_of

faults = st.builds(
    Fault,
    kind=st.sampled_from(FaultKind),
    code=st.integers(0, 0xFFFF),
    nth=st.integers(1, 50),
    times=st.integers(1, 5),
    phase=st.sampled_from(Phase),
    byte=st.integers(0, 1000),
)


@given(st.lists(faults, max_size=5))
def test_a_schedule_survives_json(items: list[Fault]) -> None:
    schedule = FaultSchedule(tuple(items))
    written = json.loads(json.dumps([dict_of(f) for f in schedule.faults]))
    assert FaultSchedule(tuple(map(fault_of, written))) == schedule


def test_a_fault_as_a_person_writes_it() -> None:
    written = {"kind": "unplug", "operation": 0x101B, "nth": 2, "phase": "data", "byte": 700, "replug_after_s": 2.0}
    fault = fault_of(written)
    assert fault == Fault(FaultKind.UNPLUG, 0x101B, 2, 1, Phase.DATA, 700, {"replug_after_s": 2.0})
    assert fault.number("replug_after_s") == 2.0


@pytest.mark.parametrize(
    ("written", "complaint"),
    [
        ({"kind": "sharks"}, "sharks"),
        ({"kind": "busy", "replug_after_s": 1}, "no parameter replug_after_s"),
        ({"kind": "busy", "nth": 0}, "count from 1"),
        ({"kind": "busy", "operation": 0x10000}, "16 bits"),
        ({"kind": "lost_event", "operation": 0x1001}, "triggered by event"),
        ({"kind": "busy", "operation": 1, "event": 2}, "more than one"),
        ({"kind": "stall", "operation": 0x1009, "phase": "event"}, "triggered by event"),
    ],
)
def test_nonsense_is_named(written: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        fault_of(written)


def test_each_fault_counts_its_own_occurrences() -> None:
    every = Fault(FaultKind.BUSY, nth=2)
    one = Fault(FaultKind.ACCESS_DENIED, 0x1009, nth=2, times=2)
    runner = FaultRunner(FaultSchedule.of(every, one))
    seen = [runner.at(Moment.OPERATION, code) for code in (0x1009, 0x1001, 0x1009, 0x1009, 0x1009)]
    assert seen == [(), (every,), (one,), (one,), ()]


@pytest.mark.parametrize("kind", sorted(CONDITIONS))
def test_a_condition_lasts_as_many_operations_as_it_says(kind: FaultKind) -> None:
    short, endless = Fault(kind, parameters={"for_operations": 2}), Fault(kind)
    for fault, expected in ((short, [True, True, False]), (endless, [True, True, True])):
        runner = FaultRunner(FaultSchedule.of(fault))
        runner.at(Moment.OPERATION)
        runner.begin(fault)
        held = []
        for _ in range(3):
            held.append(runner.condition(kind) is not None)
            runner.at(Moment.OPERATION)
        assert held == expected
