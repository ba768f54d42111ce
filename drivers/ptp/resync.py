"""Back into step with a camera after an exchange broke: a ladder of remedies, each bounded, mildest first.

A session that was cut inside a data phase can leave a camera that answers every command one transaction late and
refuses the class's own reset; only resetting its port helps then (seen with Ricoh cameras, libgphoto2 pull request
1306). So each rung is proved by a fresh, complete transaction before it counts.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Protocol

from drivers.clock import Clock, Deadline
from drivers.errors import (
    DeviceError,
    DeviceLostError,
    DeviceTimeoutError,
    LinkStallError,
)
from drivers.links import PtpTransport
from drivers.ptp.codes import ClassRequest, Event, Response
from drivers.ptp.pipes import BulkPipe, EventPipe

DRAIN_LIMIT_S = 1.0
CONTROL_LIMIT_S = 0.5
READY_LIMIT_S = 1.5
READY_PAUSE_S = 0.05
PROOF_LIMIT_S = 2.0
REOPEN_LIMIT_S = 8.0
REOPEN_PAUSE_S = 0.25
RESYNC_LIMIT_S = 30.0
"""No resynchronisation takes longer than this; the rungs' own limits add up to less."""
STATUS_BYTES = 32


class Proof(Protocol):
    """Ways to show that the camera is in step again; each takes at most about twice its limit."""

    def prove(self, limit_s: float) -> None:
        """Run a harmless transaction in the session there is; open a session where there is none."""
        ...

    def open_anew(self, limit_s: float) -> None:
        """Open a new session."""
        ...


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
        rungs: list[tuple[str, Callable[[], None]]] = [
            ("cancel", lambda: self._cancel_and_prove(proof, transaction_id)),
            ("class reset", lambda: self._class_reset(proof)),
            ("port reset", lambda: self._port_reset(proof)),
        ]
        tried: list[str] = []
        if lost:
            rungs = rungs[-1:]
        last: DeviceError | None = None
        for name, rung in rungs:
            if isinstance(last, DeviceLostError) and name != rungs[-1][0]:
                continue
            try:
                rung()
            except DeviceError as error:
                tried.append(f"{name}: {error.message}")
                last = error
            else:
                return name
        assert last is not None
        last.where = last.where or self._transport.name
        last.advice = "switch the camera off and on, check its cable, then resume"
        last.details["tried"] = tried
        raise last

    def cancel(self, transaction_id: int) -> None:
        """Ask the camera to give up a transaction, wait until it has, and drop what it still had to say.

        `DeviceTimeoutError` where it goes on sending; a camera that does not know the request is only drained.
        """
        self._events.rescue(CONTROL_LIMIT_S)
        self._request(ClassRequest.CANCEL, struct.pack("<HI", Event.CANCEL_TRANSACTION, transaction_id))
        halted = self._wait_until_ready()
        self._bulk.drain(DRAIN_LIMIT_S)
        if halted:
            self._bulk.clear_halts(("in", "out", "event"))

    def class_reset(self) -> bool:
        """Send the class's reset and wait until the camera is ready; return whether it took the request."""
        taken = self._request(ClassRequest.DEVICE_RESET)
        if taken:
            self._wait_until_ready()
            self._bulk.drain(DRAIN_LIMIT_S)
            self._bulk.clear_halts(("in", "out", "event"))
        return taken

    def _cancel_and_prove(self, proof: Proof, transaction_id: int) -> None:
        self.cancel(transaction_id)
        proof.prove(PROOF_LIMIT_S)

    def _class_reset(self, proof: Proof) -> None:
        if not self.class_reset():
            raise LinkStallError("the camera refused the class reset", where=self._transport.name)
        proof.open_anew(PROOF_LIMIT_S)

    def _port_reset(self, proof: Proof) -> None:
        try:
            self._transport.reset()
        except DeviceError:
            # Opening anew finds out whether the camera is there; a reset is impossible on one that left and came back.
            pass
        self._bulk.forget()
        deadline = Deadline.after(self._clock, REOPEN_LIMIT_S)
        while True:
            try:
                self._transport.reopen()
                break
            except DeviceError:
                if deadline.expired:
                    raise
            self._clock.sleep(REOPEN_PAUSE_S)
        self._bulk.drain(DRAIN_LIMIT_S)
        proof.open_anew(PROOF_LIMIT_S)

    def _request(self, request: ClassRequest, data: bytes = b"") -> bool:
        try:
            self._transport.control_out(request, data, CONTROL_LIMIT_S)
        except (LinkStallError, DeviceTimeoutError):
            return False
        return True

    def _wait_until_ready(self) -> bool:
        """Poll the camera's status until it is ready or the limit is over; return whether it names halted endpoints.

        The layout (length, code, endpoints) is from general knowledge of the class; a camera without it is not waited
        for.
        """
        deadline = Deadline.after(self._clock, READY_LIMIT_S)
        halted = False
        while not deadline.expired:
            try:
                status = self._transport.control_in(ClassRequest.GET_DEVICE_STATUS, STATUS_BYTES, CONTROL_LIMIT_S)
            except (LinkStallError, DeviceTimeoutError):
                break
            if len(status) < 4:
                break
            halted = halted or len(status) > 4
            if int.from_bytes(status[2:4], "little") == Response.OK:
                break
            self._clock.sleep(READY_PAUSE_S)
        return halted
