"""Transactions: command, data phase, response, with ids that no late or doubled answer gets past."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

from drivers import errors
from drivers.clock import Clock, Deadline
from drivers.ptp.codes import HEADER_BYTES, ContainerType, Operation, Response
from drivers.ptp.container import MAX_RESPONSE_BYTES, Container, Header, pack_params, violation
from drivers.ptp.pipes import BulkPipe, EventPipe, PtpTransport

# What a camera's refusal means, in words: response codes to typed errors.


BUSY_CODES = frozenset({Response.DEVICE_BUSY, 0xA102, 0xA106})
"""And an EOS's "object not ready" (libgphoto2 waits as for a busy camera) and "memory status not ready"."""
STORE_CODES = frozenset({Response.STORE_FULL, Response.STORE_READ_ONLY, Response.STORE_NOT_AVAILABLE})

_LIKELY: dict[int, tuple[str, str]] = {
    Response.STORE_FULL: ("the card is full", "empty or replace the card, then resume"),
    Response.STORE_READ_ONLY: ("the card is write-protected", "unlock the card, then resume"),
    Response.STORE_NOT_AVAILABLE: ("there is no card, or its door is open", "insert a card and close the door"),
    Response.DEVICE_BUSY: ("it is saving a picture, asleep, or in a menu", "wait, or wake it"),
    Response.ACCESS_DENIED: ("another program or the camera's own menu is using it", "close other photo programs"),
    Response.SESSION_NOT_OPEN: ("the camera was switched off and on", "resynchronise"),
    Response.INVALID_TRANSACTION_ID: ("an earlier command never reached the camera", "resynchronise"),
}


def operation_name(operation: int) -> str:
    """Return ``GetObject 1009`` style names for standard operations, hex for others."""
    words = Operation(operation).name.title().replace("_", "") if operation in set(Operation) else "operation"
    return f"{words} {operation:04X}"


def response_name(code: int) -> str:
    """Return the name of a response code in words, with the code in hex."""
    known = code in set(Response)
    return f"{Response(code).name.lower().replace('_', ' ')} ({code:04X})" if known else f"response {code:04X}"


def refusal(operation: int, code: int, params: tuple[int, ...] = (), *, where: str = "") -> errors.DeviceError:
    """Return the error for a response that the caller did not want."""
    likely, advice = _LIKELY.get(code, ("", ""))
    message = f"{operation_name(operation)} was answered with: {response_name(code)}"
    facts: dict[str, Any] = {"response_code": code, "operation": operation, "params": list(params)}
    busy, store = code in BUSY_CODES, code in STORE_CODES
    kind = errors.DeviceBusyError if busy else errors.StoreFullError if store else errors.OperationRefusedError
    return kind(message, where=where, likely=likely, advice=advice, **facts)


# Bounds of one transaction: chosen.
USUAL_TIMEOUT_S = 20.0
MAX_DATA_BYTES = 4 * 1024 * 1024
MAX_UNANSWERED = 8  # chosen: late answers that are still recognised
LAST_TRANSACTION_ID = 0xFFFFFFFE  # PIMA 15740: 0xFFFFFFFF is reserved
RESPONSE_GROUPS = (0x2, 0xA)  # first hex digit of a response code: standard, vendor
FIRST_BUSY_WAIT_S, MAX_BUSY_WAIT_S = 0.05, 0.2  # chosen: pauses double from the one to the other

T = TypeVar("T")


@dataclass(frozen=True)
class Reply:
    """What an operation gave: its response code and parameters, and the data of its data phase."""

    code: int
    params: tuple[int, ...] = ()
    data: bytes = b""


@dataclass(frozen=True)
class PtpEvent:
    """One event; what the parameters mean depends on the code."""

    code: int
    transaction_id: int
    params: tuple[int, ...] = ()


@dataclass(frozen=True)
class _Ask:
    """One operation while it runs."""

    operation: int
    transaction_id: int
    data_in: bool
    max_data_bytes: int
    deadline: Deadline


def next_transaction_id(current: int) -> int:
    """Return the id after ``current``; 0 and FFFFFFFF are never used for an operation of a session."""
    return 1 if current >= LAST_TRANSACTION_ID else current + 1


class Transactions:
    """Runs one operation at a time over a transport.

    After a violation, a lost device or a container that stopped in the middle, ``broken`` says why and every
    operation is refused until the session is resynchronised. A plain time-out leaves the session usable: should the
    answer come after all, its id gives it away and it is dropped.
    """

    def __init__(self, transport: PtpTransport, clock: Clock, *, name: str, timeout_s: float = USUAL_TIMEOUT_S) -> None:
        self.name = name
        self.timeout_s = timeout_s
        self.broken: str | None = None
        self.session_id: int | None = None
        self.late_answers = 0
        """Containers of given-up transactions that came late and were dropped."""
        self._transport = transport
        self._clock = clock
        self._bulk = BulkPipe(transport, clock)
        self._events = EventPipe(transport, clock)
        self._last_id = 0
        self._lost = False
        self._sent = False
        self._unanswered: set[int] = set()

    def transact(
        self,
        operation: int,
        params: Sequence[int] = (),
        *,
        data_out: bytes | None = None,
        data_in: bool = False,
        max_data_bytes: int = MAX_DATA_BYTES,
        timeout_s: float | None = None,
        accept: Collection[int] = (Response.OK,),
    ) -> Reply:
        """Run one operation and return its reply.

        ``operation``, ``params``: operation code and up to five 32-bit parameters.
        ``data_out``, ``data_in``: bytes to send, or whether data is to come; at most one of them.
        ``max_data_bytes``: largest data to accept; more is a violation, before anything is allocated.
        ``timeout_s``: limit for the whole operation; the session's own where None.
        ``accept``: response codes to return rather than raise.

        Raises `DeviceBusyError, StoreFullError, OperationRefusedError`: the camera answered with a code that is not in
        ``accept``; the session is in order; `ProtocolViolationError`: id, code, type or length of an answer is wrong;
        the session is ``broken``; `DeviceTimeoutError, LinkStallError, DeviceLostError`: from the link; see
        ``broken``.
        """
        if data_in and data_out is not None:
            raise ValueError("PTP has one data phase an operation: data_in or data_out")
        if self.broken is not None:
            text = f"{operation_name(operation)} refused: the exchange is out of step ({self.broken})"
            raise errors.ProtocolViolationError(text, where=self.name, advice="resynchronise first")
        packed = pack_params(params)
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        ask = _Ask(operation, self._take_id(), data_in, max_data_bytes, Deadline.after(self._clock, limit_s))
        self.broken = f"{operation_name(operation)} was interrupted"
        try:
            reply = self._exchange(ask, packed, data_out)
        except errors.DeviceError as error:
            error.where = self.name
            error.details.update(operation=operation, transaction_id=ask.transaction_id)
            # Nothing is broken where only whole containers, or nothing, had come so far.
            whole = isinstance(error, errors.DeviceTimeoutError) and self._sent and not self._bulk.in_pieces
            harmless = whole and len(self._unanswered) < MAX_UNANSWERED
            self.broken = None if harmless else f"{operation_name(operation)}: {error.message}"
            self._lost = isinstance(error, errors.DeviceLostError)
            raise
        self.broken = None
        if reply.code not in accept:
            raise refusal(operation, reply.code, reply.params, where=self.name)
        return reply

    @property
    def last_transaction_id(self) -> int:
        """Id of the last operation; a capture's events carry that of its command."""
        return self._last_id

    def _take_id(self) -> int:
        """Return the id of the next operation: 0 outside a session, then 1, 2, ..."""
        if self.session_id is None:
            return 0
        self._last_id = next_transaction_id(self._last_id)
        return self._last_id

    def _exchange(self, ask: _Ask, params: bytes, data_out: bytes | None) -> Reply:
        self._sent = False
        self._unanswered.add(ask.transaction_id)
        self._bulk.send(Container(ContainerType.COMMAND, ask.operation, ask.transaction_id, params), ask.deadline)
        if data_out is not None:
            self._bulk.send(Container(ContainerType.DATA, ask.operation, ask.transaction_id, data_out), ask.deadline)
        self._sent = True
        data: bytes | None = None
        answer = self._bulk.receive(partial(self._admit, ask), ask.deadline)
        if answer.type is ContainerType.DATA:
            data = answer.payload
            answer = self._bulk.receive(partial(self._admit, replace(ask, data_in=False)), ask.deadline)
        self._unanswered.discard(ask.transaction_id)
        if ask.data_in and data is None and answer.code == Response.OK:
            raise violation("the camera answered OK without the data that was asked for")
        return Reply(answer.code, answer.params, data or b"")

    def _admit(self, ask: _Ask, header: Header) -> int | None:
        """Judge the header of a container: the payload it may have, or None for a late one that is to be skipped."""
        if header.transaction_id != ask.transaction_id:
            self._admit_stranger(ask, header)
            return None
        if header.type is ContainerType.RESPONSE:
            if header.code >> 12 not in RESPONSE_GROUPS:
                raise violation(f"{header.code:04X} is no response code", code=header.code)
            return MAX_RESPONSE_BYTES - HEADER_BYTES
        if not ask.data_in:
            raise violation("data came where none is due", code=header.code)
        if header.code != ask.operation:
            raise violation(f"data for operation {header.code:04X} came", expected=ask.operation, got=header.code)
        return ask.max_data_bytes

    def _admit_stranger(self, ask: _Ask, header: Header) -> None:
        """Skip a container of another transaction where that was given up; refuse it otherwise.

        Outside a session (id 0) anything else is left over from an earlier session or program.
        """
        if ask.transaction_id != 0 and header.transaction_id not in self._unanswered:
            behind = (ask.transaction_id - header.transaction_id) & 0xFFFFFFFF < 0x80000000
            raise violation(
                "a second answer came for a finished operation" if behind else "an answer came ahead of its operation",
                expected=ask.transaction_id,
                got=header.transaction_id,
                code=header.code,
            )
        if header.type is ContainerType.RESPONSE:
            self._unanswered.discard(header.transaction_id)
        self.late_answers += 1

    def poll_event(self, timeout_s: float) -> PtpEvent | None:
        """Return the next event, or None where none came within ``timeout_s``.

        Events wait in the camera, or here, while operations run; none is lost to them.
        """
        try:
            event = self._events.poll(timeout_s)
        except errors.DeviceLostError as error:
            self.broken, self._lost = error.message, True
            raise
        return None if event is None else PtpEvent(event.code, event.transaction_id, event.params)

    def retry_busy(self, call: Callable[[], T], limit_s: float) -> T:
        """Return what ``call`` returns, asking again while the camera is busy.

        Waits `FIRST_BUSY_WAIT_S`, then twice as long each time up to 0.2 s; raises the last `DeviceBusyError` where the
        camera is still busy after ``limit_s``.
        """
        deadline = Deadline.after(self._clock, limit_s)
        wait_s = FIRST_BUSY_WAIT_S
        while True:
            try:
                return call()
            except errors.DeviceBusyError as error:
                if deadline.expired:
                    error.details["limit_s"] = limit_s
                    raise
            self._clock.sleep(min(wait_s, deadline.remaining_s))
            wait_s = min(2 * wait_s, MAX_BUSY_WAIT_S)
