"""Faults as data: what goes wrong, and at which moment.

A fault belongs to one of four moments, by its kind (an ``unplug`` or ``stall`` of phase ``event`` to the second):
the nth **operation** (any, or of one code), the nth **event** (any, or of one code; records of Canon's GetEvent count
as events), the nth **shot**, or the nth **setting** written (any, or of one property).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Self

from processing.ground.tables import table_of


class Phase(StrEnum):
    """Part of a transaction a fault sits in."""

    COMMAND = "command"
    DATA = "data"
    RESPONSE = "response"
    EVENT = "event"


class Moment(StrEnum):
    """What a trigger counts."""

    OPERATION = "operation"
    EVENT = "event"
    SHOT = "shot"
    SETTING = "setting"


class FaultKind(StrEnum):
    """Everything that can go wrong."""

    UNPLUG = "unplug"
    STALL = "stall"
    NO_ANSWER = "no_answer"
    LATE_ANSWER = "late_answer"
    SHORT_DATA = "short_data"
    OVERSIZE_LENGTH = "oversize_length"
    UNKNOWN_LENGTH = "unknown_length"
    WRONG_TRANSACTION_ID = "wrong_transaction_id"
    WRONG_CODE = "wrong_code"
    WRONG_TYPE = "wrong_type"
    DUPLICATE_RESPONSE = "duplicate_response"
    RESPONSE_BEFORE_DATA = "response_before_data"
    MISSING_ZLP = "missing_zlp"
    SPLIT_HEADER = "split_header"
    GARBAGE = "garbage"
    BUSY = "busy"
    HELD_UP = "held_up"
    ACCESS_DENIED = "access_denied"
    SESSION_ALREADY_OPEN = "session_already_open"
    STORE_FULL = "store_full"
    STORE_READ_ONLY = "store_read_only"
    NO_STORAGE = "no_storage"
    BATTERY_LOW = "battery_low"
    CLOCK_OFFSET = "clock_offset"
    ASLEEP = "asleep"
    AUTOFOCUS = "autofocus"
    SLOW_TRANSFER = "slow_transfer"
    LOST_EVENT = "lost_event"
    DUPLICATE_EVENT = "duplicate_event"
    OTHER_OBJECT_EVENT = "other_object_event"
    REORDERED_EVENT = "reordered_event"
    SETTING_NOT_TAKEN = "setting_not_taken"
    WRONG_EXPOSURE = "wrong_exposure"
    BLACK_FRAME = "black_frame"
    REPEATED_FRAME = "repeated_frame"
    TRUNCATED_JPEG = "truncated_jpeg"
    LATE_PICTURE = "late_picture"


_KINDS: dict[FaultKind, tuple[Moment, dict[str, float | str]]] = {
    FaultKind(kind): (Moment(row["moment"]), {name: value for name, value in row.items() if name != "moment"})
    for kind, row in table_of(__package__, "faults").items()
}
CONDITIONS = frozenset(kind for kind, (_, defaults) in _KINDS.items() if "for_operations" in defaults)
"""Kinds that last (``for_operations`` operations, 0 = for ever) instead of happening once."""


@dataclass(frozen=True)
class Fault:
    """One fault and its trigger.

    ``code`` 0 means any operation, event or property; it fires on occurrences ``nth`` to ``nth + times - 1`` (from 1).
    ``phase`` and ``byte`` place faults of the link: bytes of that phase that still pass. ``parameters`` are the kind's
    own.
    """

    kind: FaultKind
    code: int = 0
    nth: int = 1
    times: int = 1
    phase: Phase = Phase.RESPONSE
    byte: int = 0
    parameters: Mapping[str, float | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = set(self.parameters) - set(_KINDS[self.kind][1])
        if unknown:
            raise ValueError(f"fault {self.kind} has no parameter {', '.join(sorted(unknown))}")
        if self.nth < 1 or self.times < 1 or self.byte < 0 or not 0 <= self.code <= 0xFFFF:
            raise ValueError(f"fault {self.kind}: nth and times count from 1, byte from 0, code is 16 bits")

    @property
    def moment(self) -> Moment:
        """What this fault's trigger counts."""
        if self.kind in (FaultKind.UNPLUG, FaultKind.STALL) and self.phase is Phase.EVENT:
            return Moment.EVENT
        return _KINDS[self.kind][0]

    def number(self, name: str) -> float:
        """Return a numeric parameter, or its default."""
        return float(self.parameters.get(name, _KINDS[self.kind][1][name]))

    def word(self, name: str) -> str:
        """Return a parameter that is a word, or its default."""
        return str(self.parameters.get(name, _KINDS[self.kind][1][name]))

    def matches(self, code: int, occurrence: int) -> bool:
        """Whether it fires on the ``occurrence``-th thing of its kind, which has ``code``."""
        return self.code in (0, code) and self.nth <= occurrence < self.nth + self.times


@dataclass(frozen=True)
class FaultSchedule:
    """Every fault of one simulated device."""

    faults: tuple[Fault, ...] = ()

    @classmethod
    def of(cls, *faults: Fault) -> Self:
        """Return a schedule of these faults."""
        return cls(faults)


class FaultRunner:
    """A schedule while it runs: counts occurrences, keeps conditions, remembers what fired."""

    def __init__(self, schedule: FaultSchedule | None) -> None:
        self.schedule = schedule or FaultSchedule()
        self.fired: list[Fault] = []
        self._counts = [0] * len(self.schedule.faults)
        self._operations = 0
        self._conditions: dict[FaultKind, tuple[Fault, float]] = {}

    def at(self, moment: Moment, code: int = 0) -> tuple[Fault, ...]:
        """Count one occurrence and return the faults that it triggers."""
        if moment is Moment.OPERATION:
            self._operations += 1
        found = []
        for index, fault in enumerate(self.schedule.faults):
            if fault.moment is moment and fault.code in (0, code):
                self._counts[index] += 1
                if fault.matches(code, self._counts[index]):
                    found.append(fault)
        return tuple(found)

    def note(self, fault: Fault) -> None:
        """Record that ``fault`` has had its effect."""
        self.fired.append(fault)

    def begin(self, fault: Fault) -> None:
        """Let a condition hold from now on."""
        length = fault.number("for_operations")
        self._conditions[fault.kind] = (fault, self._operations + length if length else float("inf"))
        self.note(fault)

    def condition(self, kind: FaultKind) -> Fault | None:
        """Return the fault of this kind that holds now, if any."""
        found = self._conditions.get(kind)
        return found[0] if found and self._operations < found[1] else None
