"""Back into step with a camera after an exchange broke: a ladder of remedies, each bounded, mildest first.

A session that was cut inside a data phase can leave a camera that answers every command one transaction late and
refuses the class's own reset; only resetting its port helps then (seen with Ricoh cameras, libgphoto2 pull request
1306). So each rung is proved by a fresh, complete transaction before it counts.
"""

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from drivers.clock import Clock, Deadline
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError, LinkStallError
from drivers.ptp.codes import ClassRequest, Event, Response
from drivers.ptp.pipes import MIN_CALL_S, BulkPipe, EventPipe, PtpTransport

# Limits of the rungs: chosen so that all together stay under half a minute.
CANCEL_LIMIT_S = 7.0
CLASS_RESET_LIMIT_S = 6.0  # chosen: its steps below and 1 s
PORT_RESET_LIMIT_S = 13.0  # chosen: the same, with opening the port again
RESYNC_LIMIT_S = CANCEL_LIMIT_S + CLASS_RESET_LIMIT_S + PORT_RESET_LIMIT_S
"""All rungs together; beyond it only the kernel's own waits (resetting a port, clearing a halted endpoint)."""
# Limits of their steps: chosen.
DRAIN_LIMIT_S = 1.0
CONTROL_LIMIT_S = 0.5  # a device's limit for a control request (USB 2.0, 9.2.6.4)
READY_LIMIT_S = 1.5  # chosen
READY_PAUSE_S = 0.05  # chosen: 20 questions a second
PROOF_LIMIT_S = 2.0  # chosen: the answer to the question that proves the line
REOPEN_LIMIT_S = 8.0  # chosen: for the body to come back on the bus
REOPEN_PAUSE_S = 0.25  # chosen
STATUS_BYTES = 32  # chosen: a status has 4 bytes and a few endpoints'


class Proof(Protocol):
    """Ways to show that the camera is in step again."""

    def prove(self, deadline: Deadline) -> None:
        """Run a harmless transaction in the session there is; open a session where there is none."""

    def open_anew(self, deadline: Deadline) -> None:
        """Open a new session."""


class Ladder:
    """The remedies, over the pipes of one session."""

    def __init__(self, transport: PtpTransport, clock: Clock, bulk: BulkPipe, events: EventPipe) -> None:
        self._transport = transport
        self._clock = clock
        self._bulk = bulk
        self._events = events

    def climb(self, proof: Proof, transaction_id: int, *, lost: bool) -> str:
        """Try rung after rung and return the name of the one that helped.

        ``lost`` skips to opening the link anew. Raises the last rung's error, with what was tried, where none helps.
        """
        rungs: list[tuple[str, float, Callable[[Deadline], None]]] = [
            ("cancel", CANCEL_LIMIT_S, lambda deadline: self._cancel_and_prove(proof, transaction_id, deadline)),
            ("class reset", CLASS_RESET_LIMIT_S, lambda deadline: self._class_reset_and_prove(proof, deadline)),
            ("port reset", PORT_RESET_LIMIT_S, lambda deadline: self._port_reset_and_prove(proof, deadline)),
        ]
        tried: list[str] = []
        last: DeviceError | None = None
        for name, limit_s, rung in rungs:
            if lost and name != "port reset":
                continue
            try:
                rung(Deadline.after(self._clock, limit_s))
            except DeviceError as error:
                tried.append(f"{name}: {error.message}")
                last = error
                lost = isinstance(error, DeviceLostError)
            else:
                return name
        assert last is not None
        last.where = last.where or self._transport.name
        last.advice = "switch the camera off and on, check its cable, then resume"
        last.details["tried"] = tried
        raise last

    def cancel(self, transaction_id: int, deadline: Deadline) -> None:
        """Ask the camera to give up a transaction, wait until it has, and drop what it still had to say.

        `DeviceTimeoutError` where it goes on sending; a camera that does not know the request is only drained.
        """
        self._events.rescue(_at_most(CONTROL_LIMIT_S, deadline))
        self._request(ClassRequest.CANCEL, struct.pack("<HI", Event.CANCEL_TRANSACTION, transaction_id), deadline)
        halted = self._wait_until_ready(deadline)
        self._bulk.drain(_at_most(DRAIN_LIMIT_S, deadline))
        if halted:
            self._bulk.clear_halts()

    def class_reset(self, deadline: Deadline) -> bool:
        """Send the class's reset and wait until the camera is ready; return whether it took the request."""
        taken = self._request(ClassRequest.DEVICE_RESET, b"", deadline)
        if taken:
            self._wait_until_ready(deadline)
            self._bulk.drain(_at_most(DRAIN_LIMIT_S, deadline))
            self._bulk.clear_halts()
        return taken

    def _cancel_and_prove(self, proof: Proof, transaction_id: int, deadline: Deadline) -> None:
        self.cancel(transaction_id, deadline)
        proof.prove(deadline)

    def _class_reset_and_prove(self, proof: Proof, deadline: Deadline) -> None:
        if not self.class_reset(deadline):
            raise LinkStallError("the camera refused the class reset", where=self._transport.name)
        proof.open_anew(deadline)

    def _port_reset_and_prove(self, proof: Proof, deadline: Deadline) -> None:
        # Opening anew finds out whether the camera is there; a reset is impossible on one that left and came back.
        with suppress(DeviceError):
            self._transport.reset()
        self._bulk.forget()
        self._reopen(Deadline.after(self._clock, _at_most(REOPEN_LIMIT_S, deadline)))
        self._bulk.drain(_at_most(DRAIN_LIMIT_S, deadline))
        proof.open_anew(deadline)

    def _reopen(self, deadline: Deadline) -> None:
        """Open the link until it opens: a camera needs a moment to come back, and udev another to give access."""
        while True:
            try:
                self._transport.reopen()
            except DeviceError:
                if deadline.expired:
                    raise
            else:
                return
            self._clock.sleep(min(REOPEN_PAUSE_S, deadline.remaining_s))

    def _request(self, request: ClassRequest, data: bytes, deadline: Deadline) -> bool:
        with suppress(LinkStallError, DeviceTimeoutError):
            self._transport.control_out(request, data, _at_most(CONTROL_LIMIT_S, deadline))
            return True
        return False

    def _wait_until_ready(self, rung: Deadline) -> bool:
        """Poll the camera's status until it is ready or the limit is over; return whether it names halted endpoints.

        The layout (length, code, endpoints) is from general knowledge of the class; a camera without it is not waited
        for.
        """
        deadline = Deadline.after(self._clock, _at_most(READY_LIMIT_S, rung))
        halted = False
        while not deadline.expired:
            try:
                limit_s = _at_most(CONTROL_LIMIT_S, deadline)
                status = self._transport.control_in(ClassRequest.GET_DEVICE_STATUS, STATUS_BYTES, limit_s)
            except (LinkStallError, DeviceTimeoutError):
                break
            if len(status) < 4:
                break
            halted = halted or len(status) > 4
            if int.from_bytes(status[2:4], "little") == Response.OK:
                break
            self._clock.sleep(READY_PAUSE_S)
        return halted


def _at_most(limit_s: float, deadline: Deadline) -> float:
    """Return a step's own limit, or what is left of its rung where that is less."""
    return max(MIN_CALL_S, min(limit_s, deadline.remaining_s))
