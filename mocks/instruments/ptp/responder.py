"""A PTP responder (ISO 15740) as a state machine: sessions, transaction ids, parameters, conditions, events.

It knows nothing of USB or TCP: `mocks.instruments.usb.device` and `tests.peers.ptp_ip` carry its requests and
answers. It has no thread of its own; whoever touches it lets it catch up with the clock first (`advance`).
"""

import heapq
import itertools
import random
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol, Self, TypeVar

from drivers.clock import Clock
from drivers.ptp.codes import Operation, Response
from mocks.instruments.exposures import CameraTiming, ExposureRecord
from mocks.instruments.faults import CONDITIONS, Fault, FaultKind, FaultRunner, FaultSchedule, Moment
from mocks.instruments.ptp import wire

# What a simulated device has still to do, and when: no threads, the device catches up whenever it is looked at.


Action = Callable[[float], None]  # called with the moment it was due (clock seconds), not the moment it was run


class Agenda:
    """Actions in order of time; equal times run in the order they were planned."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Action]] = []
        self._sequence = itertools.count()

    def at(self, due_s: float, action: Action) -> None:
        """Plan ``action`` for clock time ``due_s``."""
        heapq.heappush(self._heap, (due_s, next(self._sequence), action))

    def run_until(self, now_s: float) -> None:
        """Run everything due by ``now_s``, also what those actions plan themselves."""
        while self._heap and self._heap[0][0] <= now_s:
            due_s, _, action = heapq.heappop(self._heap)
            action(due_s)

    def next_due_s(self) -> float | None:
        """Return when the next action is due, or None."""
        return self._heap[0][0] if self._heap else None

    def clear(self) -> None:
        """Forget everything planned."""
        self._heap.clear()


class FaultableEvent(Protocol):
    """An event that can be made wrong."""

    def elsewhere(self, offset: int) -> Self:
        """Return the event for another object or property."""

    def breaking(self, fault: Fault) -> Self:
        """Return the event with a fault of the link in it."""


EventT = TypeVar("EventT", bound=FaultableEvent)


class EventGate:
    """Lets events through one at a time."""

    def __init__(self, faults: FaultRunner, agenda: Agenda, clock: Clock) -> None:
        self._faults = faults
        self._agenda = agenda
        self._clock = clock
        self._held: list[Callable[[], None]] = []

    def deliver(self, code: int, event: EventT, put: Callable[[EventT], None]) -> None:
        """Hand ``event`` to ``put``, through whatever faults it triggers; then any event held back before it."""
        copies, hold_s = [event], 0.0
        for fault in self._faults.at(Moment.EVENT, code):
            if fault.kind not in (FaultKind.UNPLUG, FaultKind.STALL):
                self._faults.note(fault)
            if fault.kind is FaultKind.LOST_EVENT:
                copies = []
            elif fault.kind is FaultKind.DUPLICATE_EVENT:
                copies = copies * 2
            elif fault.kind is FaultKind.OTHER_OBJECT_EVENT:
                copies = [c.elsewhere(int(fault.number("offset"))) for c in copies]
            elif fault.kind is FaultKind.REORDERED_EVENT:
                hold_s = fault.number("hold_s")
            else:
                copies = [c.breaking(fault) for c in copies]

        def send() -> None:
            for copy in copies:
                put(copy)

        if hold_s:
            self._held.append(send)
            self._agenda.at(self._clock.monotonic_s() + hold_s, lambda _due_s: self._release_held())
        else:
            send()
            self._release_held()

    def _release_held(self) -> None:
        held, self._held = self._held, []
        for send in held:
            send()


STALE_SESSION = 0x0DD  # session that an earlier program left open, where a fault says so

MAX_OPERATION_LOG = 200_000  # chosen: a day's campaign; the rest is only counted


class PtpResponder:
    """What every simulated camera shares; a camera adds rules, properties and manners."""

    def __init__(
        self, identity: wire.DeviceIdentity, clock: Clock, timing: CameraTiming, faults: FaultSchedule | None, seed: int
    ) -> None:
        self.identity = identity
        self.clock = clock
        self.timing = timing
        self.faults = FaultRunner(faults)
        self.random = random.Random(seed)
        self.lock = threading.RLock()
        self.agenda = Agenda()
        self.stats = wire.ResponderStats()
        self.exposure_log: list[ExposureRecord] = []
        self.events: deque[wire.PendingEvent] = deque()
        self.rules: dict[int, wire.Rule] = self.standard_rules()
        self.attachment = 0
        self._away_until_s = 0.0
        self._session_id = 0
        self._last_transaction_id = 0
        self._any_transaction_id = False
        self._held_until_s = 0.0
        self.gate = EventGate(self.faults, self.agenda, clock)

    # ---- power and plug

    @property
    def plugged(self) -> bool:
        """Whether the camera is on and on the bus."""
        return self.clock.monotonic_s() >= self._away_until_s

    def unplug(self, replug_after_s: float | None = None) -> None:
        """Pull the cable; it comes back after ``replug_after_s`` seconds, if given, at a new address."""
        with self.lock:
            forever = replug_after_s is None or replug_after_s < 0
            self._away_until_s = float("inf") if forever else self.clock.monotonic_s() + float(replug_after_s or 0.0)
            self.attachment += 1
            self.link_reset()

    def replug(self) -> None:
        """Put the cable back."""
        self._away_until_s = 0.0

    def forget_session(self) -> None:
        """Close the session as a reset or a pulled cable does."""
        self._session_id = 0
        self._last_transaction_id = 0
        self._any_transaction_id = False
        self.events.clear()

    def link_reset(self) -> None:
        """Lose what a reset or a pulled cable makes a camera lose: the session, at least."""
        self.forget_session()

    def excuse_transaction_id(self) -> None:
        """Accept any transaction id once: a transaction was cut off and the two sides may count differently."""
        self._any_transaction_id = True

    # ---- time

    def advance(self) -> None:
        """Catch up with the clock."""
        with self.lock:
            self.agenda.run_until(self.clock.monotonic_s())

    # ---- transactions

    def standard_rules(self) -> dict[int, wire.Rule]:
        """Return the operations every responder has."""
        return {
            Operation.GET_DEVICE_INFO: wire.Rule(
                lambda _: wire.Answer(data=self.identity.device_info()), sessionless=True
            ),
            Operation.OPEN_SESSION: wire.Rule(self._open_session, 1, 1, sessionless=True),
            Operation.CLOSE_SESSION: wire.Rule(self._close_session),
        }

    def expects_data(self, operation: int) -> bool:
        """Whether the host sends a data phase with this operation."""
        rule = self.rules.get(operation)
        return rule is not None and rule.data_out

    def handle(self, request: wire.Request, faults: Sequence[Fault] = ()) -> wire.Answer:
        """Carry out a request; ``faults`` are those its arrival triggered."""
        with self.lock:
            self.advance()
            try:
                answer = self._carry_out(request, faults)
            except wire.Refusal as refusal:
                answer = wire.Answer(refusal.code, refusal.params)
            except wire.BadBytesError:
                answer = wire.Answer(Response.INVALID_DATASET)
            self._log(request, answer)
            return answer

    def _carry_out(self, request: wire.Request, faults: Sequence[Fault]) -> wire.Answer:
        for fault in faults:
            if fault.kind is FaultKind.SESSION_ALREADY_OPEN and request.operation == Operation.OPEN_SESSION:
                self.faults.note(fault)
                self._session_id = self._session_id or STALE_SESSION
                self.excuse_transaction_id()
            elif fault.kind is FaultKind.ASLEEP:
                self.faults.note(fault)
                self.fall_asleep()
            elif fault.kind in CONDITIONS:
                self.faults.begin(fault)
        rule = self._check(request)
        for fault in faults:
            if fault.kind is FaultKind.HELD_UP:
                self.faults.note(fault)
                self._held_until_s = self.clock.monotonic_s() + fault.number("delay_s")
            if fault.kind is FaultKind.BUSY:
                self.faults.note(fault)
                raise wire.Refusal(Response.DEVICE_BUSY)
            if fault.kind is FaultKind.ACCESS_DENIED:
                self.faults.note(fault)
                raise wire.Refusal(Response.ACCESS_DENIED)
        if self.clock.monotonic_s() < self._held_until_s:
            raise wire.Refusal(Response.DEVICE_BUSY)
        self.before(request)
        return rule.handler(request)

    def before(self, request: wire.Request) -> None:
        """Refuse what the camera's state forbids (asleep, busy); cameras override this."""

    def fall_asleep(self) -> None:
        """Go to sleep, in the camera's own way."""
        raise NotImplementedError

    def _check(self, request: wire.Request) -> wire.Rule:
        rule = self.rules.get(request.operation)
        if not self._session_id and (rule is None or not rule.sessionless):
            raise wire.Refusal(Response.SESSION_NOT_OPEN)
        self._check_transaction_id(request)
        if rule is None:
            raise wire.Refusal(Response.OPERATION_NOT_SUPPORTED)
        if len(request.params) < rule.least_params:
            raise wire.Refusal(Response.INVALID_PARAMETER)
        if any(request.params[rule.most_params :]):
            raise wire.Refusal(Response.PARAMETER_NOT_SUPPORTED)
        return rule

    def _check_transaction_id(self, request: wire.Request) -> None:
        got = request.transaction_id
        if not self._session_id or request.operation == Operation.OPEN_SESSION:
            expected = 0
        else:
            expected = self._last_transaction_id + 1
            if expected >= 0xFFFFFFFF:
                expected = 1
        if got != expected and not self._any_transaction_id:
            self.stats.violations.append(f"transaction id {got} instead of {expected} in {request.operation:04x}")
            raise wire.Refusal(Response.INVALID_TRANSACTION_ID)
        if request.operation != Operation.OPEN_SESSION:
            self._any_transaction_id = False
            self._last_transaction_id = got

    def _log(self, request: wire.Request, answer: wire.Answer) -> None:
        if len(self.stats.operations) < MAX_OPERATION_LOG:
            now_s, sent = self.clock.monotonic_s(), len(answer.data or b"")
            entry = wire.OperationRecord(
                now_s, request.operation, request.transaction_id, request.params, answer.code, len(request.data), sent
            )
            self.stats.operations.append(entry)

    def _open_session(self, request: wire.Request) -> wire.Answer:
        if request.params[0] == 0:
            raise wire.Refusal(Response.INVALID_PARAMETER)
        if self._session_id:
            raise wire.Refusal(Response.SESSION_ALREADY_OPEN, self._session_id)
        self._session_id = request.params[0]
        self._last_transaction_id = 0
        self._any_transaction_id = False
        return wire.Answer()

    def _close_session(self, _request: wire.Request) -> wire.Answer:
        self.forget_session()
        return wire.Answer()

    # ---- events

    def emit(self, code: int, *params: int, transaction_id: int = 0) -> None:
        """Send an event on the interrupt pipe of an open session, unless a fault says otherwise."""
        if not self._session_id:
            return
        self.gate.deliver(code, wire.PendingEvent(code, transaction_id, params), self.events.append)
