"""Opening what others left open, and coming back into step: the ladder, rung by rung, within its limits."""

from __future__ import annotations

import random
import struct
from collections import deque
from functools import partial

import pytest

from drivers.clock import Deadline
from drivers.errors import (
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
    LinkStallError,
    OperationRefusedError,
    ProtocolViolationError,
)
from drivers.ptp.pipes import DRAIN_QUIET_S, BulkPipe, EventPipe, Pipe
from drivers.ptp.resync import (
    CANCEL_LIMIT_S,
    CLASS_RESET_LIMIT_S,
    CONTROL_LIMIT_S,
    DRAIN_LIMIT_S,
    PORT_RESET_LIMIT_S,
    READY_PAUSE_S,
    RESYNC_LIMIT_S,
    STATUS_BYTES,
    Ladder,
)
from drivers.ptp.session import OPEN_LIMIT_S, PtpEvent, PtpSession
from tests.drivers.scripted import (
    Answer,
    ClearHalt,
    ControlIn,
    ControlOut,
    FakeClock,
    Reopen,
    Reset,
    ScriptedTransport,
    Step,
    command,
    data,
    event,
    response,
)

OK = 0x2001
OPENED = Step(command(0x1002, 0, 1), [response(OK, 0)])
READY = Step(ControlIn(0x67, STATUS_BYTES), [bytes.fromhex("0400 0120")])
HALTS = [Step(ClearHalt("in")), Step(ClearHalt("out")), Step(ClearHalt("event"))]
WAIT_MARGIN_S = 1.0
"""What a whole ladder may take beyond its limit: one control transfer and a few shortest waits."""


def session_on(*steps: Step) -> tuple[PtpSession, ScriptedTransport]:
    transport = ScriptedTransport(steps)
    return PtpSession(transport, transport.clock, name="camera"), transport


def cancel(tid: int) -> Step:
    return Step(ControlOut(0x64, struct.pack("<HI", 0x4001, tid)))


def probe(tid: int, *answers: Answer) -> Step:
    return Step(command(0x1001, tid), answers or [data(0x1001, tid, b"anything"), response(OK, tid)])


def broken_session(*steps: Step) -> tuple[PtpSession, ScriptedTransport]:
    """A session whose first operation ended in the middle of its data."""
    cut = Step(command(0x1009, 1, 5), [data(0x1009, 1, bytes(5000))[:1024]])
    session, transport = session_on(OPENED, cut, *steps)
    session.open()
    with pytest.raises(DeviceTimeoutError):
        session.transact(0x1009, (5,), data_in=True)
    assert session.broken is not None
    return session, transport


# Opening.


def test_opening_drains_what_an_earlier_program_left() -> None:
    session, transport = session_on(OPENED)
    transport.bulk_in.extend([bytes(100_000), bytes(700), response(OK, 77)])
    session.open()
    assert (session.session_id, session.generation, session.broken) == (1, 1, None)
    transport.assert_finished()


def test_opening_drops_stale_answers_that_come_late() -> None:
    stale = [data(0x1009, 41, bytes(3000)), response(OK, 41)]
    session, transport = session_on(Step(command(0x1002, 0, 1), [*stale, response(OK, 0)]))
    session.open()
    assert session.late_answers == 2
    transport.assert_finished()


def test_session_already_open_is_closed_and_opened_anew() -> None:
    session, transport = session_on(
        Step(command(0x1002, 0, 1), [response(0x201E, 0)]), Step(command(0x1003, 1), [response(OK, 1)]), OPENED
    )
    session.open()
    assert session.session_id == 1
    transport.assert_finished()


REFUSED = Step(command(0x1002, 0, 1), [response(0x201E, 0)])
NOT_CLOSED = Step(command(0x1003, 1), [response(0x2004, 1)])
CLASS_RESET = [Step(ControlOut(0x66)), READY, *HALTS]


def test_session_that_cannot_be_closed_is_reset_away() -> None:
    session, transport = session_on(REFUSED, NOT_CLOSED, REFUSED, *CLASS_RESET, OPENED)
    session.open()
    transport.assert_finished()


def test_session_that_survives_the_reset_is_adopted() -> None:
    session, transport = session_on(REFUSED, NOT_CLOSED, REFUSED, *CLASS_RESET, REFUSED, probe(1))
    session.open()
    assert session.session_id == 1
    transport.assert_finished()


def test_session_that_cannot_be_adopted_is_named() -> None:
    session, transport = session_on(REFUSED, NOT_CLOSED, REFUSED, *CLASS_RESET, REFUSED, probe(1, response(0x2004, 1)))
    with pytest.raises(OperationRefusedError, match="killed"):
        session.open()
    assert session.session_id is None
    transport.assert_finished()


def test_opening_a_mute_camera_climbs_the_ladder() -> None:
    session, transport = session_on(
        Step(command(0x1002, 0, 1)), cancel(0), READY, Step(command(0x1002, 0, 1), [response(OK, 0)])
    )
    session.open()
    assert session.last_remedy == "cancel"
    transport.assert_finished()


# The rungs.


def test_cancel_is_enough_for_a_transfer_cut_short() -> None:
    session, transport = broken_session(
        Step(ControlOut(0x64, bytes.fromhex("01400100 0000")), [bytes(512), bytes(300)]), READY, probe(2)
    )
    session.resynchronise()
    assert (session.last_remedy, session.broken, session.generation) == ("cancel", None, 1)
    transport.assert_finished()


def test_cancel_payload_to_the_byte() -> None:
    """devices.md 4.6: cancel of transaction 9."""
    cancelled = Step(ControlOut(0x64, bytes.fromhex("01 40 09 00 00 00")))
    session, transport = session_on(OPENED, cancelled, READY, probe(10))
    session.open()
    session._last_id = 9
    session.resynchronise()
    transport.assert_finished()


def test_camera_is_waited_for_and_its_halted_endpoints_cleared() -> None:
    busy = Step(ControlIn(0x67, STATUS_BYTES), [bytes.fromhex("0800 1920 81000000")])
    session, transport = broken_session(cancel(1), busy, busy, READY, *HALTS, probe(2))
    began_s = transport.clock.now_s
    session.resynchronise()
    assert 0.1 <= transport.clock.now_s - began_s < 1.0
    transport.assert_finished()


def test_camera_without_class_requests_is_drained_and_proved() -> None:
    stalled = LinkStallError("no such request")
    session, transport = broken_session(
        Step(cancel(1).sent, raises=stalled), Step(READY.sent, raises=stalled), probe(2)
    )
    session.resynchronise()
    transport.assert_finished()


def test_any_answer_in_step_is_proof() -> None:
    session, transport = broken_session(cancel(1), READY, probe(2, response(0x2019, 2)))
    session.resynchronise()
    assert session.broken is None
    transport.assert_finished()


@pytest.mark.parametrize("code", [0x2003, 0x2004])
def test_camera_that_has_forgotten_the_session_gets_a_new_one(code: int) -> None:
    session, transport = broken_session(cancel(1), READY, probe(2, response(code, 2)), OPENED)
    session.resynchronise()
    assert session.generation == 2
    transport.assert_finished()


def test_class_reset_is_the_second_rung() -> None:
    session, transport = broken_session(cancel(1), READY, probe(2, b"\xff" * 16), *CLASS_RESET, OPENED)
    session.resynchronise()
    assert (session.last_remedy, session.generation) == ("class reset", 2)
    transport.assert_finished()


def test_port_reset_is_the_last_rung() -> None:
    session, transport = broken_session(
        cancel(1),
        READY,
        Step(command(0x1001, 2)),
        Step(ControlOut(0x66), raises=LinkStallError("refused")),
        Step(Reset()),
        Step(Reopen(), raises=DeviceNotFoundError("not yet")),
        Step(Reopen()),
        OPENED,
    )
    session.resynchronise()
    assert session.last_remedy == "port reset"
    transport.assert_finished()


def test_events_are_rescued_before_a_remedy_throws_them_away() -> None:
    class Forgetful(ScriptedTransport):
        def control_out(self, request: int, data: bytes, timeout_s: float) -> None:
            super().control_out(request, data, timeout_s)
            self.interrupt.clear()

    transport = Forgetful([OPENED, Step(command(0x911D, 1), [b"\xff" * 16]), cancel(1), READY, probe(2)])
    session = PtpSession(transport, transport.clock, name="camera")
    session.open()
    with pytest.raises(ProtocolViolationError):
        session.transact(0x911D)
    transport.interrupt.extend([event(0x4002, 1, 7), event(0x400D, 1, 1)])
    session.resynchronise()
    assert session.poll_event(0.05) == PtpEvent(0x4002, 1, (7,))
    assert session.poll_event(0.05) == PtpEvent(0x400D, 1, (1,))


def test_step_of_a_rung_takes_no_more_than_the_rung_has_left() -> None:
    clock = FakeClock()
    camera = LateCamera(clock, late=False)
    camera.control_out = lambda request, payload, timeout_s: None  # type: ignore[method-assign]
    camera.control_in = lambda request, length, timeout_s: bytes.fromhex("0400 1920")  # type: ignore[method-assign]
    ladder = Ladder(camera, clock, BulkPipe(camera, clock), EventPipe(camera, clock))
    began_s = clock.now_s
    assert ladder.class_reset(Deadline.after(clock, 0.3))
    assert clock.now_s - began_s <= 0.3 + READY_PAUSE_S + DRAIN_QUIET_S


def test_lost_camera_goes_straight_to_opening_anew() -> None:
    session, transport = session_on(
        OPENED,
        Step(command(0x911D, 1), raises=DeviceLostError("unplugged")),
        Step(Reset(), raises=DeviceLostError("not there")),
        *[Step(Reopen(), raises=DeviceNotFoundError("not there"))] * 5,
        Step(Reopen()),
        OPENED,
    )
    session.open()
    with pytest.raises(DeviceLostError):
        session.transact(0x911D)
    session.resynchronise()
    assert (session.last_remedy, session.broken) == ("port reset", None)
    transport.assert_finished()


def test_camera_that_stays_away_is_named_with_what_was_tried() -> None:
    class Gone(ScriptedTransport):
        def reset(self) -> None:
            raise DeviceLostError("gone")

        def reopen(self) -> None:
            raise DeviceNotFoundError("not found on USB", where="camera")

    clock = FakeClock()
    transport = Gone([OPENED, Step(command(0x911D, 1), raises=DeviceLostError("unplugged"))], clock=clock)
    session = PtpSession(transport, clock, name="camera")
    session.open()
    with pytest.raises(DeviceLostError):
        session.transact(0x911D)
    began_s = clock.now_s
    with pytest.raises(DeviceNotFoundError, match="off and on") as caught:
        session.resynchronise()
    assert caught.value.details["tried"] == ["port reset: not found on USB"]
    assert clock.now_s - began_s <= PORT_RESET_LIMIT_S
    assert "resynchronisation failed" in str(session.broken)


# A camera that is one transaction late.


class LateCamera:
    """Answers each command with the answer to the one before, refuses the class reset; a port reset cures it.

    Field report: libgphoto2 pull request 1306, a Ricoh camera after a session was cut inside a data phase.
    """

    name = "late camera"
    max_packet_bytes = 512

    def __init__(self, clock: FakeClock, *, late: bool) -> None:
        self.clock = clock
        self.late = late
        self.session_open = late
        self.resets = 0
        self.usable = True
        self._held: list[bytes] = [data(0x1009, 40, bytes(10_000))[512:], response(OK, 40)] if late else []
        self._bulk_in: deque[bytes] = deque()

    def write(self, payload: bytes, timeout_s: float) -> None:
        assert self.usable
        _, _, code, tid = struct.unpack_from("<IHHI", payload)
        answer = self._answer(code, tid)
        if self.late:
            answer, self._held = self._held, answer
        self._bulk_in.extend(answer)

    def _answer(self, code: int, tid: int) -> list[bytes]:
        if code == 0x1002:
            opened, self.session_open = self.session_open, True
            return [response(0x201E if opened else OK, tid)]
        if code == 0x1001:
            return [data(0x1001, tid, b"info"), response(OK, tid)]
        return [response(OK, tid)]

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        if not self._bulk_in:
            self.clock.sleep(timeout_s)
            raise DeviceTimeoutError("no data")
        transfer = self._bulk_in.popleft()
        if len(transfer) > max_bytes:
            self._bulk_in.appendleft(transfer[max_bytes:])
        return transfer[:max_bytes]

    def read_event(self, timeout_s: float) -> bytes | None:
        self.clock.sleep(timeout_s)
        return None

    def control_out(self, request: int, payload: bytes, timeout_s: float) -> None:
        if request == 0x66:
            raise LinkStallError("class reset refused")

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        return bytes.fromhex("0400 0120")

    def clear_halt(self, pipe: Pipe) -> None:
        pass

    def reset(self) -> None:
        self.resets += 1
        self.usable = self.late = self.session_open = False
        self._bulk_in.clear()
        self._held = []

    def reopen(self) -> None:
        self.usable = True

    def close(self) -> None:
        pass


def test_camera_one_transaction_late_is_brought_back_when_opening() -> None:
    clock = FakeClock()
    camera = LateCamera(clock, late=True)
    session = PtpSession(camera, clock, name="camera")
    session.open()
    assert (session.last_remedy, camera.resets) == ("port reset", 1)
    assert clock.now_s - 1000.0 <= OPEN_LIMIT_S + DRAIN_LIMIT_S + RESYNC_LIMIT_S
    for _ in range(3):
        assert session.transact(0x1001, data_in=True).data == b"info"


def test_camera_that_falls_one_transaction_behind_is_brought_back() -> None:
    clock = FakeClock()
    camera = LateCamera(clock, late=False)
    session = PtpSession(camera, clock, name="camera", timeout_s=2.0)
    session.open()
    camera.late, camera._held = True, [data(0x1009, 0, bytes(900))[512:]]
    with pytest.raises((ProtocolViolationError, DeviceTimeoutError)):
        session.transact(0x1001, data_in=True)
    began_s = clock.now_s
    session.resynchronise()
    assert clock.now_s - began_s <= RESYNC_LIMIT_S
    assert camera.resets == 1
    assert session.transact(0x1001, data_in=True).data == b"info"


# Limits.


class Adversary(LateCamera):
    """Takes as long as it is allowed to for everything, then answers in a way drawn at random."""

    def __init__(self, clock: FakeClock, seed: int) -> None:
        super().__init__(clock, late=False)
        self.random = random.Random(seed)

    def _spend(self, limit_s: float) -> None:
        assert limit_s > 0
        self.clock.sleep(limit_s * self.random.choice([0.0, 0.1, 0.9, 0.99]))

    def _fail_at_times(self, limit_s: float) -> None:
        self._spend(limit_s)
        drawn = self.random.random()
        if drawn < 0.1:
            raise LinkStallError("halted")
        if drawn < 0.15:
            self.clock.sleep(limit_s * 0.01)
            raise DeviceTimeoutError("slow")
        if drawn < 0.16:
            raise DeviceLostError("gone")

    def write(self, payload: bytes, timeout_s: float) -> None:
        self._fail_at_times(timeout_s)
        self.usable = True
        super().write(payload, timeout_s)

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        self._fail_at_times(timeout_s)
        drawn = self.random.random()
        if drawn < 0.1:
            return self.random.randbytes(self.random.randrange(0, 600))
        if drawn < 0.2:
            return response(self.random.choice([OK, 0x2003, 0x2004, 0x201E]), self.random.randrange(0, 5))
        return super().read(max_bytes, timeout_s)

    def control_out(self, request: int, payload: bytes, timeout_s: float) -> None:
        self._fail_at_times(timeout_s)

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        self._fail_at_times(timeout_s)
        return struct.pack("<HH", 4, self.random.choice([OK, 0x2019, 0x201F]))

    def reopen(self) -> None:
        if self.random.random() < 0.6:
            raise DeviceNotFoundError("not yet")
        self.usable = True


def cancel_alone(session: PtpSession, clock: FakeClock) -> None:
    session._ladder.cancel(7, Deadline.after(clock, CANCEL_LIMIT_S))


def test_no_ladder_is_longer_than_its_limit() -> None:
    """Cameras that fail at random and use up every limit: opening and resynchronising end in time, in step or not."""
    in_step = out_of_step = 0
    for seed in range(400):
        clock = FakeClock()
        session = PtpSession(Adversary(clock, seed), clock, name="camera", timeout_s=5.0)
        for call, limit_s in (
            (session.open, DRAIN_LIMIT_S + OPEN_LIMIT_S + RESYNC_LIMIT_S),
            (session.resynchronise, RESYNC_LIMIT_S),
            (partial(cancel_alone, session, clock), CANCEL_LIMIT_S),
        ):
            began_s = clock.now_s
            try:
                call()
            except DeviceError:
                out_of_step += 1
            else:
                in_step += 1
            assert clock.now_s - began_s <= limit_s + WAIT_MARGIN_S, (seed, limit_s)
    assert in_step > 50
    assert out_of_step > 50


def test_limits_add_up() -> None:
    assert RESYNC_LIMIT_S == CANCEL_LIMIT_S + CLASS_RESET_LIMIT_S + PORT_RESET_LIMIT_S <= 30.0
    assert CONTROL_LIMIT_S < WAIT_MARGIN_S


def test_closing_a_camera_that_is_gone_is_quiet() -> None:
    session, transport = session_on(OPENED, Step(command(0x1003, 1), raises=DeviceLostError("gone")))
    session.open()
    session.close()
    assert transport.closed


def test_closing_a_broken_session_only_closes_the_link() -> None:
    session, transport = broken_session()
    session.close()
    assert transport.closed
    transport.assert_finished()
