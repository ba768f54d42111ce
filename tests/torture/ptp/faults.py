"""The faults of a PTP sitting, swept over kind, operation or event, occurrence, phase and byte."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import cycle

from drivers.ptp.codes import HEADER_BYTES, Operation
from mocks.instruments.faults import Fault, FaultKind, Phase
from tests.torture.ptp.flavours import Flavour
from tests.torture.ptp.session import Sitting

PACKET_BYTES = 512
AWAY_S = (2.0, 20.0, -1.0)
"""A plug pushed back at once, one that is noticed later, and one that a person has to find."""


@dataclass(frozen=True)
class Point:
    """One operation of a fault-free sitting: the ``nth`` of its code, with the bytes of its data phase."""

    operation: int
    nth: int
    params: int
    out_bytes: int
    in_bytes: int


@dataclass(frozen=True)
class Course:
    """What happens in a fault-free sitting."""

    points: tuple[Point, ...]
    events: int
    settings: int


def course(flavour: Flavour) -> Course:
    """Run a sitting without faults and return what may go wrong in it."""
    # Faults of a moment far away make the camera count what happens.
    sitting = Sitting(flavour, ())
    counts: Counter[str] = Counter()
    at = sitting.device.faults.at

    def counting(moment: object, code: int = 0) -> tuple[Fault, ...]:
        counts[str(moment)] += 1
        found: tuple[Fault, ...] = at(moment, code)
        return found

    sitting.device.faults.at = counting
    verdict = sitting.run()
    assert not verdict.wrong, verdict.wrong
    seen: Counter[int] = Counter()
    points = []
    for record in sitting.device.stats.operations[: sitting.n_operations]:
        seen[record.operation] += 1
        nth = seen[record.operation]
        points.append(Point(record.operation, nth, len(record.params), record.out_bytes, record.in_bytes))
    return Course(tuple(points), counts["event"], counts["setting"])


def chosen_points(points: tuple[Point, ...]) -> list[Point]:
    """Return of each operation the first three occurrences, one in the middle, and the last two; and odd data sizes."""
    by_code: dict[int, list[Point]] = {}
    for point in points:
        by_code.setdefault(point.operation, []).append(point)
    chosen: set[Point] = set()
    for group in by_code.values():
        chosen.update(group[:3] + group[len(group) // 2 :][:1] + group[-2:])
        chosen.update({p.in_bytes: p for p in group}.values())
    return [p for p in points if p in chosen]


def single_faults(flavour: Flavour) -> list[Fault]:
    """Return every fault of the sweep."""
    plan = course(flavour)
    away, afterwards, until = cycle(AWAY_S), cycle(("resume", "drop")), cycle(("next", "reset"))
    faults: list[Fault] = []
    for point in chosen_points(plan.points):
        for phase, size in _phases(point):
            for byte in sorted({0, 1, 11, 12, 13, size // 2, size - 1, size} & set(range(size + 1))):
                where = {"code": point.operation, "nth": point.nth, "phase": phase, "byte": byte}
                faults.append(Fault(FaultKind.UNPLUG, **where, parameters={"replug_after_s": next(away)}))
                faults.append(Fault(FaultKind.STALL, **where, parameters={"afterwards": next(afterwards)}))
        faults += _answers(point, next(until))
    faults += _conditions(flavour, len(plan.points))
    faults += _events(plan.events)
    for nth in range(1, plan.settings + 1):
        faults += [Fault(FaultKind.SETTING_NOT_TAKEN, nth=nth, times=times) for times in (1, 2, 9)]
    return faults


def _phases(point: Point) -> Iterator[tuple[Phase, int]]:
    yield Phase.COMMAND, HEADER_BYTES + 4 * point.params
    data_bytes = point.out_bytes or point.in_bytes
    if data_bytes:
        yield Phase.DATA, HEADER_BYTES + data_bytes
    yield Phase.RESPONSE, HEADER_BYTES


def _answers(point: Point, until: str) -> Iterator[Fault]:
    """Yield every way to spoil the answer of an operation."""
    where = {"code": point.operation, "nth": point.nth}
    plain = (FaultKind.LATE_ANSWER, FaultKind.DUPLICATE_RESPONSE, FaultKind.ACCESS_DENIED)
    yield from (Fault(kind, **where) for kind in plain)
    yield Fault(FaultKind.NO_ANSWER, **where, parameters={"until": until})
    yield from (Fault(FaultKind.BUSY, **where, times=times) for times in (1, 3, 40))
    yield Fault(FaultKind.ASLEEP, **where)
    phases = [Phase.RESPONSE] + [Phase.DATA] * (point.in_bytes > 0)
    for phase in phases:
        for kind, name, values in _SPOILED:
            yield from (Fault(kind, **where, phase=phase, parameters={name: value}) for value in values)
        yield Fault(FaultKind.UNKNOWN_LENGTH, **where, phase=phase)
    if point.operation == Operation.OPEN_SESSION:
        yield Fault(FaultKind.SESSION_ALREADY_OPEN, **where)
    if not point.in_bytes:
        return
    missing = {1, 7, point.in_bytes // 2, point.in_bytes}
    yield from (Fault(FaultKind.SHORT_DATA, **where, parameters={"missing_bytes": m}) for m in sorted(missing) if m)
    yield Fault(FaultKind.RESPONSE_BEFORE_DATA, **where)
    yield Fault(FaultKind.SPLIT_HEADER, **where, phase=Phase.DATA)
    if (HEADER_BYTES + point.in_bytes) % PACKET_BYTES == 0:
        yield Fault(FaultKind.MISSING_ZLP, **where)


_SPOILED: tuple[tuple[FaultKind, str, tuple[int, ...]], ...] = (
    (FaultKind.OVERSIZE_LENGTH, "extra_bytes", (1, 64, 1 << 24, -1)),
    (FaultKind.WRONG_TRANSACTION_ID, "offset", (1, -1, 1000)),
    (FaultKind.WRONG_CODE, "code", (0x2FFF, 0x2019, 0x2001, 0x1002)),
    (FaultKind.WRONG_TYPE, "type", (0, 1, 2, 4)),
    (FaultKind.GARBAGE, "count", (1, 12, 16, 512, 600)),
)


def _conditions(flavour: Flavour, operations: int) -> Iterator[Fault]:
    """Yield what lasts: for some operations, or until a person mends it."""
    starts = sorted({1, operations // 8, operations // 4, operations // 2, 3 * operations // 4, operations - 5})
    kinds = [FaultKind.STORE_FULL, FaultKind.STORE_READ_ONLY, FaultKind.NO_STORAGE, FaultKind.BATTERY_LOW]
    kinds += [FaultKind.CLOCK_OFFSET, FaultKind.SLOW_TRANSFER]
    if flavour.kind == "canon_5d2":
        kinds.append(FaultKind.AUTOFOCUS)
    for kind in kinds:
        for start in starts:
            for length in (1, 25, 0):
                yield Fault(kind, nth=start, parameters={"for_operations": length})


def _events(events: int) -> Iterator[Fault]:
    away = cycle(AWAY_S)
    for nth in range(1, events + 1):
        yield from (Fault(kind, nth=nth) for kind in (FaultKind.LOST_EVENT, FaultKind.DUPLICATE_EVENT))
        yield Fault(FaultKind.LOST_EVENT, nth=nth, times=4)
        yield from (Fault(FaultKind.OTHER_OBJECT_EVENT, nth=nth, parameters={"offset": o}) for o in (1, 1000))
        yield from (Fault(FaultKind.REORDERED_EVENT, nth=nth, parameters={"hold_s": h}) for h in (0.5, 3.0, 30.0))
        for byte in (0, 1, 11, 12, 16):
            where = {"nth": nth, "phase": Phase.EVENT, "byte": byte}
            yield Fault(FaultKind.UNPLUG, **where, parameters={"replug_after_s": next(away)})
            yield Fault(FaultKind.STALL, **where)


def evenly(faults: list[Fault], count: int) -> Iterable[Fault]:
    """Return ``count`` of the faults, from end to end of the sweep."""
    step = max(1.0, len(faults) / count)
    return [faults[int(i * step)] for i in range(min(count, len(faults)))]
