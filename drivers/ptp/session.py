"""A PTP session: opening, closing, recovering, and the standard operations with typed arguments and results.

One thread owns a session. Nothing here knows a camera model; see `drivers.theta_z1.camera` and
`drivers.canon_5d2.camera`.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from drivers.clock import Clock, Deadline
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError, LinkStallError, ProtocolViolationError
from drivers.ptp import datasets
from drivers.ptp.codes import Operation, Response
from drivers.ptp.container import violation
from drivers.ptp.datasets import DeviceInfo, DevicePropDesc, ObjectInfo, StorageInfo, Value
from drivers.ptp.pipes import MIN_CALL_S, PtpTransport
from drivers.ptp.resync import DRAIN_LIMIT_S, PROOF_LIMIT_S, Ladder
from drivers.ptp.transactions import USUAL_TIMEOUT_S, PtpEvent, Reply, Transactions, refusal

__all__ = ["PtpEvent", "PtpSession", "Reply"]

ANY_RESPONSE = range(0x2000, 0xB000)
OPEN_LIMIT_S = 8.0  # some cameras need as long to open a session after waking
ALL_STORAGES = 0xFFFFFFFF  # PIMA 15740, GetObjectHandles
# Chosen: one chunk takes 40 ms at 25 MB/s.
MAX_CHUNK_BYTES = 1024 * 1024
MAX_DATASET_BYTES = 256 * 1024
"""Largest DeviceInfo, ObjectInfo and the like; real ones stay below a few kilobytes, handle lists at 40."""

T = TypeVar("T")


class PtpSession(Transactions):
    """Everything a camera driver asks of PTP.

    ``generation`` counts opened sessions: when it has changed after `resynchronise`, the camera has forgotten modes
    that were set in the session before. ``last_remedy`` names the rung of the ladder that helped last.
    """

    def __init__(self, transport: PtpTransport, clock: Clock, *, name: str, timeout_s: float = USUAL_TIMEOUT_S) -> None:
        super().__init__(transport, clock, name=name, timeout_s=timeout_s)
        self.generation = 0
        self.last_remedy: str | None = None
        self._wanted_session_id = 1
        self._ladder = Ladder(transport, clock, self._bulk, self._events)

    def open(self, session_id: int = 1) -> None:
        """Open the session, whatever an earlier program left behind in the camera.

        Old bytes are drained, an old session is closed, reset or at last adopted; a camera out of step is
        resynchronised. Raises what is left.
        """
        self._wanted_session_id = session_id
        try:
            self._bulk.drain(DRAIN_LIMIT_S)
            self.open_anew(Deadline.after(self._clock, OPEN_LIMIT_S))
        except (DeviceTimeoutError, LinkStallError, ProtocolViolationError):
            self.resynchronise()

    def close(self) -> None:
        """Close the session where it is in step, then the link; never raises a device error."""
        if self.session_id is not None and self.broken is None:
            with suppress(DeviceError):  # the camera is gone or mute; there is nobody to take leave of
                self.transact(Operation.CLOSE_SESSION, timeout_s=PROOF_LIMIT_S, accept=ANY_RESPONSE)
        self.session_id = None
        self._transport.close()

    def resynchronise(self, *, from_port_reset: bool = False) -> None:
        """Bring the camera back into step, within `drivers.ptp.resync.RESYNC_LIMIT_S`.

        Cancel and drain, class reset, port reset and opening anew, in this order, until a transaction proves that the
        camera is in step; ``from_port_reset`` leaves out the milder ones. Raises the last remedy's error where none
        helps; the session then stays ``broken``.
        """
        self.broken = "resynchronisation was interrupted"
        self.last_remedy = None
        try:
            self.last_remedy = self._ladder.climb(self, self._last_id, lost=self._lost or from_port_reset)
        except DeviceError as error:
            self._lost = isinstance(error, DeviceLostError)
            self.broken = f"resynchronisation failed: {error.message}"
            raise
        self.broken, self._lost = None, False

    # The ladder's two proofs (`drivers.ptp.resync.Proof`).

    def prove(self, deadline: Deadline) -> None:
        """Show that the camera is in step by one whole transaction, opening a session where it has none."""
        if self.session_id is None:
            self.open_anew(deadline)
            return
        self.broken = None
        if self._probe(deadline) in (Response.SESSION_NOT_OPEN, Response.INVALID_TRANSACTION_ID):
            self.open_anew(deadline)

    def open_anew(self, deadline: Deadline) -> None:
        """Open a session; one that the camera already has is closed, reset away, or at last adopted."""
        if self._try_to_open(deadline):
            return
        self.session_id = self._wanted_session_id
        self.transact(Operation.CLOSE_SESSION, timeout_s=self._left(deadline), accept=ANY_RESPONSE)
        if self._try_to_open(deadline):
            return
        self._ladder.class_reset(deadline)
        if self._try_to_open(deadline):
            return
        self._start_session()
        code = self._probe(deadline)
        if code != Response.OK:
            self.session_id = None
            error = refusal(Operation.GET_DEVICE_INFO, code, where=self.name)
            error.likely = "the camera holds on to the session of a program that was killed"
            error.advice = "switch the camera off and on"
            raise error

    def _try_to_open(self, deadline: Deadline) -> bool:
        """Send OpenSession; return False where the camera says that a session is open already."""
        self.session_id = None
        self.broken = None
        self._last_id = 0
        reply = self.transact(
            Operation.OPEN_SESSION,
            (self._wanted_session_id,),
            timeout_s=self._left(deadline),
            accept=(Response.OK, Response.SESSION_ALREADY_OPEN),
        )
        if reply.code == Response.OK:
            self._start_session()
        return reply.code == Response.OK

    def _start_session(self) -> None:
        self.session_id = self._wanted_session_id
        self._last_id = 0
        self._unanswered.clear()
        self.generation += 1

    def _probe(self, deadline: Deadline) -> int:
        """Run a harmless transaction and return its response code."""
        limit_s = min(PROOF_LIMIT_S, self._left(deadline))
        return self.transact(
            Operation.GET_DEVICE_INFO,
            data_in=True,
            max_data_bytes=MAX_DATASET_BYTES,
            timeout_s=limit_s,
            accept=ANY_RESPONSE,
        ).code

    def _left(self, deadline: Deadline) -> float:
        return max(deadline.remaining_s, MIN_CALL_S)

    # Standard operations.

    def device_info(self) -> DeviceInfo:
        """Return what the camera says of itself; works with and without a session."""
        return self._ask(datasets.decode_device_info, Operation.GET_DEVICE_INFO)

    def get_storage_ids(self) -> tuple[int, ...]:
        """Return the ids of the camera's stores."""
        return self._ask(datasets.decode_ids, Operation.GET_STORAGE_IDS)

    def get_storage_info(self, storage_id: int) -> StorageInfo:
        """Return size and free space of a store."""
        return self._ask(datasets.decode_storage_info, Operation.GET_STORAGE_INFO, storage_id)

    def get_object_handles(
        self, storage_id: int = ALL_STORAGES, format_code: int = 0, parent: int = 0
    ) -> tuple[int, ...]:
        """Return the handles of objects; 0 means any format, any folder."""
        return self._ask(datasets.decode_ids, Operation.GET_OBJECT_HANDLES, storage_id, format_code, parent)

    def get_object_info(self, handle: int) -> ObjectInfo:
        """Return name, format, size and dates of an object."""
        return self._ask(datasets.decode_object_info, Operation.GET_OBJECT_INFO, handle)

    def get_partial_object(
        self, handle: int, offset: int, size: int, operation: int = Operation.GET_PARTIAL_OBJECT
    ) -> bytes:
        """Return up to ``size`` bytes of an object from ``offset``; at least one.

        ``size`` is 1 to `MAX_CHUNK_BYTES` bytes, ``offset`` below 4 GiB. Where the camera says how many bytes it sent
        (GetPartialObject's first response parameter) it must have sent as many.
        """
        if not 0 < size <= MAX_CHUNK_BYTES:
            raise ValueError(f"a chunk is 1 to {MAX_CHUNK_BYTES} bytes, not {size}")
        reply = self.transact(operation, (handle, offset, size), data_in=True, max_data_bytes=size)
        announced = reply.params[0] if operation == Operation.GET_PARTIAL_OBJECT and reply.params else len(reply.data)
        if announced != len(reply.data) or not reply.data:
            message = f"the camera sent {len(reply.data)} bytes of an object and says {announced}"
            raise self._named(violation(message, handle=handle, offset=offset, asked_bytes=size))
        return reply.data

    def delete_object(self, handle: int) -> None:
        """Delete an object from the camera's store."""
        self.transact(Operation.DELETE_OBJECT, (handle, 0))

    def get_prop_desc(self, prop: int) -> DevicePropDesc:
        """Return type, current value and allowed values of a property."""
        desc = self._ask(datasets.decode_device_prop_desc, Operation.GET_DEVICE_PROP_DESC, prop)
        if desc.code != prop:
            raise self._named(violation(f"asked for property {prop:04X}, got the description of {desc.code:04X}"))
        return desc

    def get_prop_value(self, prop: int, data_type: int) -> Value:
        """Return the current value of a property of the given `DataType`."""
        return self._ask(lambda data: datasets.decode_value(data, data_type), Operation.GET_DEVICE_PROP_VALUE, prop)

    def set_prop_value(self, prop: int, data_type: int, value: Value) -> None:
        """Set a property; `ValueError` where the value does not fit the type."""
        self.transact(Operation.SET_DEVICE_PROP_VALUE, (prop,), data_out=datasets.encode_value(value, data_type))

    def _ask(self, decode: Callable[[bytes], T], operation: int, *params: int) -> T:
        """Run an operation and decode its data; a dataset that is none leaves the exchange in step."""
        data = self.transact(operation, params, data_in=True, max_data_bytes=MAX_DATASET_BYTES).data
        try:
            return decode(data)
        except ProtocolViolationError as error:
            self._named(error)
            raise

    def _named(self, error: ProtocolViolationError) -> ProtocolViolationError:
        error.where = self.name
        return error
