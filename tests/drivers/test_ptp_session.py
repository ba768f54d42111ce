"""Dialogues of a session, to the byte; answers that are wrong, late or doubled; every wait within its limit."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import (
    DeviceBusyError,
    DeviceError,
    DeviceLostError,
    DeviceTimeoutError,
    LinkStallError,
    OperationRefusedError,
    ProtocolViolationError,
    StoreFullError,
)
from drivers.ptp.codes import DataType
from drivers.ptp.datasets import encode_string
from drivers.ptp.session import MAX_CHUNK_BYTES, PtpSession, Reply
from drivers.ptp.transactions import LAST_TRANSACTION_ID, PtpEvent, next_transaction_id
from tests.drivers.scripted import (
    ClearHalt,
    OnEvent,
    ScriptedTransport,
    Step,
    command,
    container,
    data,
    event,
    response,
)

OPEN = Step(bytes.fromhex("10000000 0100 0210 00000000 01000000"), [bytes.fromhex("0c000000 0300 0120 00000000")])
OK, BUSY = 0x2001, 0x2019
LIMIT_S = 20.0
WAIT_MARGIN_S = 0.05
"""What a call may take beyond its limit: the shortest limit a link takes, a few times over."""


def session_on(*steps: Step, packet: int = 512) -> tuple[PtpSession, ScriptedTransport]:
    """A session opened as the script's first step."""
    transport = ScriptedTransport([OPEN, *steps], max_packet_bytes=packet)
    session = PtpSession(transport, transport.clock, name="camera", timeout_s=LIMIT_S)
    session.open()
    return session, transport


def ask(tid: int, *params: int) -> bytes:
    return command(0x1015, tid, *params)


def value(tid: int, payload: bytes = b"\x07\0") -> bytes:
    return data(0x1015, tid, payload)


# The documented dialogue.


def test_theta_exposure_to_the_byte() -> None:
    """Vectors of devices.md 4.6: set the shutter (tid 9), release (tid 10), wait for both events."""
    before = [Step(command(0x1015, tid, 0xD808), [data(0x1015, tid, b"\0") + response(OK, tid)]) for tid in range(1, 9)]
    session, transport = session_on(
        *before,
        Step(bytes.fromhex("10000000 0100 1610 09000000 0fd00000")),
        Step(
            bytes.fromhex("14000000 0200 1610 09000000 01000000 3c000000"),
            [bytes.fromhex("0c000000 0300 0120 09000000")],
        ),
        Step(
            bytes.fromhex("14000000 0100 0e10 0a000000 00000000 00000000"),
            [
                bytes.fromhex("0c000000 0300 0120 0a000000"),
                OnEvent(bytes.fromhex("10000000 0400 0240 0a000000 64000000")),
                OnEvent(bytes.fromhex("10000000 0400 0d40 0a000000 0a000000")),
            ],
        ),
        Step(bytes.fromhex("0c000000 0100 0310 0b000000"), [bytes.fromhex("0c000000 0300 0120 0b000000")]),
    )
    for _ in before:
        assert session.get_prop_value(0xD808, DataType.UINT8) == 0
    session.set_prop_value(0xD00F, DataType.UINT64, 60 << 32 | 1)
    assert session.transact(0x100E, (0, 0)) == Reply(OK)
    assert session.poll_event(1.0) == PtpEvent(0x4002, 10, (0x64,))
    assert session.poll_event(1.0) == PtpEvent(0x400D, 10, (10,))
    session.close()
    transport.assert_finished()
    assert transport.closed


def test_device_info_outside_a_session_has_id_zero() -> None:
    info = bytes(8) + b"\0" + bytes(2) + bytes(20) + encode_string("Ricoh") + encode_string("Z1") + b"\0\0"
    sent = bytes.fromhex("0c000000 0100 0110 00000000")
    transport = ScriptedTransport([Step(sent, [data(0x1001, 0, info), response(OK, 0)])])
    session = PtpSession(transport, transport.clock, name="camera")
    assert session.device_info().manufacturer == "Ricoh"
    transport.assert_finished()


def test_transaction_ids_wrap_past_zero_and_all_ones() -> None:
    session, transport = session_on(
        Step(command(0x911D, LAST_TRANSACTION_ID), [response(OK, LAST_TRANSACTION_ID)]),
        Step(command(0x911D, 1), [response(OK, 1)]),
    )
    session._last_id = LAST_TRANSACTION_ID - 1
    session.transact(0x911D)
    session.transact(0x911D)
    transport.assert_finished()
    assert next_transaction_id(0xFFFFFFFE) == next_transaction_id(0xFFFFFFFF) == 1


@pytest.mark.parametrize(("size", "closed_by_zlp"), [(499, False), (500, True), (501, False), (1012, True)])
def test_data_that_fills_its_last_packet_is_closed_by_an_empty_one(size: int, closed_by_zlp: bool) -> None:
    payload = bytes(size)
    sent = [Step(data(0x1016, 1, payload)), *([Step(b"")] if closed_by_zlp else [])]
    sent[-1] = Step(sent[-1].sent, [response(OK, 1)])
    session, transport = session_on(Step(command(0x1016, 1, 0x5003)), *sent)
    session.transact(0x1016, (0x5003,), data_out=payload)
    transport.assert_finished()


def test_early_response_instead_of_data() -> None:
    session, transport = session_on(
        Step(ask(1, 0xD999), [response(0x200A, 1)]), Step(ask(2), [value(2), response(OK, 2)])
    )
    with pytest.raises(OperationRefusedError, match=r"device prop not supported \(200A\)") as caught:
        session.transact(0x1015, (0xD999,), data_in=True)
    assert caught.value.response_code == 0x200A
    assert session.transact(0x1015, data_in=True).data == b"\x07\0"
    transport.assert_finished()


def test_early_response_to_data_that_the_camera_halts() -> None:
    session, transport = session_on(
        Step(command(0x1016, 1, 0x5003)),
        Step(data(0x1016, 1, b"\0\0"), raises=LinkStallError("halted")),
        Step(ClearHalt("out"), [response(0x200F, 1)]),
    )
    with pytest.raises(OperationRefusedError, match="access denied"):
        session.set_prop_value(0x5003, DataType.UINT16, 0)
    assert session.broken is None
    transport.assert_finished()


def test_halted_in_endpoint_is_cleared_and_read_once_more() -> None:
    session, transport = session_on(
        Step(ask(1), [LinkStallError("halted")]), Step(ClearHalt("in"), [value(1), response(OK, 1)])
    )
    assert session.transact(0x1015, data_in=True).data == b"\x07\0"
    transport.assert_finished()


def test_endpoint_that_halts_again_is_given_up() -> None:
    session, transport = session_on(
        Step(ask(1), [LinkStallError("halted")]), Step(ClearHalt("in"), [LinkStallError("halted again")])
    )
    with pytest.raises(LinkStallError, match="again"):
        session.transact(0x1015, data_in=True)
    assert session.broken is not None
    transport.assert_finished()


def test_halted_command_is_sent_once_more() -> None:
    session, transport = session_on(
        Step(ask(1), raises=LinkStallError("halted")),
        Step(ClearHalt("out")),
        Step(ask(1), [value(1), response(OK, 1)]),
    )
    session.transact(0x1015, data_in=True)
    transport.assert_finished()


# Refusals.


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (0x2019, DeviceBusyError),
        (0x200C, StoreFullError),
        (0x200E, StoreFullError),
        (0x2013, StoreFullError),
        (0x200F, OperationRefusedError),
        (0x2003, OperationRefusedError),
        (0xA005, OperationRefusedError),
        (0xA102, DeviceBusyError),
    ],
)
def test_refusals_are_typed_and_leave_the_session_in_step(code: int, kind: type[DeviceError]) -> None:
    session, transport = session_on(
        Step(command(0x100E, 1, 0, 0), [response(code, 1, 5)]), Step(command(0x100E, 2, 0, 0), [response(code, 2, 5)])
    )
    with pytest.raises(kind) as caught:
        session.transact(0x100E, (0, 0))
    assert caught.value.details["response_code"] == code
    assert caught.value.where == "camera"
    assert session.transact(0x100E, (0, 0), accept=(OK, code)) == Reply(code, (5,))
    transport.assert_finished()


def test_busy_is_asked_again_with_growing_waits() -> None:
    steps = [Step(command(0x911D, tid), [response(BUSY, tid)]) for tid in range(1, 6)]
    session, transport = session_on(*steps, Step(command(0x911D, 6), [response(OK, 6)]))
    began_s = transport.clock.now_s
    assert session.retry_busy(lambda: session.transact(0x911D), limit_s=5.0).code == OK
    assert transport.clock.now_s - began_s == pytest.approx(0.05 + 0.1 + 3 * 0.2)
    transport.assert_finished()


def test_busy_for_too_long_is_raised_at_the_limit() -> None:
    transport = ScriptedTransport([])
    session = PtpSession(transport, transport.clock, name="camera")
    calls: list[float] = []

    def busy() -> None:
        calls.append(transport.clock.now_s)
        raise DeviceBusyError("busy")

    with pytest.raises(DeviceBusyError) as caught:
        session.retry_busy(busy, limit_s=1.0)
    assert calls[-1] - calls[0] == pytest.approx(1.0)
    assert caught.value.details["limit_s"] == 1.0


# Answers that are wrong.

WRONG_ANSWERS: dict[str, tuple[list[bytes], str]] = {
    "future id": ([value(2), response(OK, 2)], "ahead of its operation"),
    "id of a finished operation": ([response(OK, 0)], "second answer"),
    "data of another operation": ([data(0x1014, 1, b"\0\0"), response(OK, 1)], "operation 1014"),
    "data twice": ([value(1), value(1), response(OK, 1)], "none is due"),
    "response before data": ([response(OK, 1), value(1)], "without the data"),
    "no response code": ([container(3, 0x4002, 1)], "no response code"),
    "command": ([ask(1)], "cannot come from bulk-in"),
    "event": ([event(0x4002, 1)], "cannot come from bulk-in"),
    "length zero": ([container(2, 0x1015, 1, b"ab", length=0)], "shorter than its own header"),
    "length too small": ([container(2, 0x1015, 1, b"abcdefghijklmnop", length=13), response(OK, 1)], "does not exist"),
    "length over the limit": ([container(2, 0x1015, 1, b"ab", length=0x7FFFFFFF)], "at most 4194304 are due"),
    "six parameters": ([container(3, OK, 1, bytes(24))], "cannot be 36 bytes"),
    "response shorter than its length": ([container(2, 0x1015, 1, b"ab", length=600), response(OK, 1)], "ended before"),
    "type 9": ([container(9, 0x1015, 1)], "type 9"),
}


@pytest.mark.parametrize("name", WRONG_ANSWERS)
def test_wrong_answers_break_the_session(name: str) -> None:
    answers, said = WRONG_ANSWERS[name]
    session, transport = session_on(Step(ask(1), answers))
    with pytest.raises(ProtocolViolationError, match=said) as caught:
        session.transact(0x1015, data_in=True)
    assert caught.value.details["operation"] == 0x1015
    assert session.broken is not None
    with pytest.raises(ProtocolViolationError, match="out of step"):
        session.transact(0x1015, data_in=True)
    assert not transport.steps


def test_data_where_none_was_asked_for() -> None:
    session, _ = session_on(Step(command(0x100E, 1), [data(0x100E, 1, b"x"), response(OK, 1)]))
    with pytest.raises(ProtocolViolationError, match="none is due"):
        session.transact(0x100E)


def test_late_answer_is_dropped_by_its_id() -> None:
    session, transport = session_on(Step(ask(1)), Step(ask(2), [value(1), response(OK, 1), value(2), response(OK, 2)]))
    with pytest.raises(DeviceTimeoutError):
        session.transact(0x1015, data_in=True)
    assert session.broken is None
    assert session.transact(0x1015, data_in=True).data == b"\x07\0"
    assert session.late_answers == 2
    transport.assert_finished()


def test_late_answer_comes_once_only() -> None:
    session, _ = session_on(Step(ask(1)), Step(ask(2), [response(OK, 1), response(OK, 1), value(2), response(OK, 2)]))
    with pytest.raises(DeviceTimeoutError):
        session.transact(0x1015, data_in=True)
    with pytest.raises(ProtocolViolationError, match="second answer"):
        session.transact(0x1015, data_in=True)


def test_doubled_response_is_found_by_the_next_operation() -> None:
    session, _ = session_on(Step(ask(1), [value(1), response(OK, 1) * 2]), Step(ask(2)))
    assert session.transact(0x1015, data_in=True).code == OK
    with pytest.raises(ProtocolViolationError, match="second answer"):
        session.transact(0x1015, data_in=True)


def test_time_out_in_the_middle_of_data_breaks_the_session() -> None:
    session, _ = session_on(Step(ask(1), [value(1, bytes(2000))[:512]]))
    with pytest.raises(DeviceTimeoutError):
        session.transact(0x1015, data_in=True)
    assert session.broken is not None


def test_interrupted_operation_breaks_the_session() -> None:
    session, transport = session_on(Step(ask(1)))

    def interrupted(max_bytes: int, timeout_s: float) -> bytes:
        raise KeyboardInterrupt

    transport.read = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        session.transact(0x1015, data_in=True)
    assert session.broken == "GetDevicePropValue 1015 was interrupted"


@given(st.lists(st.integers(0, 700), max_size=40), st.integers(0, 1500))
def test_any_cutting_of_the_answers_gives_the_same_replies(sizes: list[int], payload_bytes: int) -> None:
    payload = bytes(i % 251 for i in range(payload_bytes))
    stream, transfers, at = value(1, payload) + response(OK, 1, 7), [], 0
    for size in [s for s in sizes if s]:
        transfers += [stream[at : at + size]] if at < len(stream) else []
        at += size
    transfers += [stream[at:]] if at < len(stream) else []
    session, transport = session_on(Step(ask(1), transfers))
    assert session.transact(0x1015, data_in=True) == Reply(OK, (7,), payload)
    transport.assert_finished()


@given(st.lists(st.binary(max_size=64), max_size=6))
def test_any_answer_gives_a_reply_or_a_typed_error(answers: list[bytes]) -> None:
    session, transport = session_on(Step(ask(1), answers))
    began_s = transport.clock.now_s
    try:
        session.transact(0x1015, data_in=True, timeout_s=3.0)
    except (ProtocolViolationError, DeviceTimeoutError, OperationRefusedError):
        pass
    assert transport.clock.now_s - began_s <= 3.0 + WAIT_MARGIN_S


# Chunks of objects.


def test_chunk_of_an_object() -> None:
    chunk = bytes(range(256)) * 4096
    session, transport = session_on(
        Step(
            command(0x101B, 1, 0x64, 0, MAX_CHUNK_BYTES),
            [data(0x101B, 1, chunk), b"", response(OK, 1, MAX_CHUNK_BYTES)],
        ),
        Step(command(0x9107, 2, 0x64, MAX_CHUNK_BYTES, 10), [data(0x9107, 2, b"tail") + response(OK, 2, 0)]),
    )
    assert session.get_partial_object(0x64, 0, MAX_CHUNK_BYTES) == chunk
    assert session.get_partial_object(0x64, MAX_CHUNK_BYTES, 10, operation=0x9107) == b"tail"
    transport.assert_finished()


@pytest.mark.parametrize(
    ("payload", "result", "said"),
    [(b"abcd", 5, "4 bytes of an object and says 5"), (b"", 0, "0 bytes"), (bytes(11), 11, "at most 10")],
)
def test_chunk_of_another_size_than_announced_or_asked(payload: bytes, result: int, said: str) -> None:
    session, _ = session_on(Step(command(0x101B, 1, 0x64, 0, 10), [data(0x101B, 1, payload), response(OK, 1, result)]))
    with pytest.raises(ProtocolViolationError, match=said):
        session.get_partial_object(0x64, 0, 10)


@pytest.mark.parametrize("size", [0, -1, MAX_CHUNK_BYTES + 1])
def test_chunks_stay_small(size: int) -> None:
    session, _ = session_on()
    with pytest.raises(ValueError, match="chunk"):
        session.get_partial_object(1, 0, size)


# Typed operations.


def test_typed_operations_to_the_byte() -> None:
    def with_data(code: int, tid: int, payload: str, *params: int) -> Step:
        return Step(command(code, tid, *params), [data(code, tid, bytes.fromhex(payload)), response(OK, tid)])

    session, transport = session_on(
        with_data(0x1004, 1, "01000000 01000200"),
        with_data(0x1007, 2, "02000000 64000000 65000000", 0xFFFFFFFF, 0x3801, 0),
        with_data(0x1014, 3, "0750 0400 01 0000 3002 00", 0x5007),
        with_data(0x1005, 4, "0300 0300 0000" + "00" * 8 + "0010000000000000" + "05000000 00 00", 0x00020001),
        Step(command(0x100B, 5, 0x64, 0), [response(OK, 5)]),
    )
    assert session.get_storage_ids() == (0x00020001,)
    assert session.get_object_handles(format_code=0x3801) == (0x64, 0x65)
    assert session.get_prop_desc(0x5007).current == 560
    assert session.get_storage_info(0x00020001).free_bytes == 4096
    session.delete_object(0x64)
    transport.assert_finished()


def test_description_of_another_property_is_a_violation() -> None:
    desc = data(0x1014, 1, bytes.fromhex("0850 0400 01 0000 3002 00"))
    session, _ = session_on(Step(command(0x1014, 1, 0x5007), [desc, response(OK, 1)]))
    with pytest.raises(ProtocolViolationError, match="5007, got the description of 5008") as caught:
        session.get_prop_desc(0x5007)
    assert caught.value.where == "camera"
    assert session.broken is None, "the exchange itself is in step"


# Events.


@pytest.mark.parametrize("packet", [8, 12, 16, 64])
def test_events_in_small_packets(packet: int) -> None:
    wire = event(0x4002, 10, 0x64)
    session, transport = session_on(
        Step(ask(1), [*(OnEvent(wire[i : i + packet]) for i in range(0, 16, packet)), value(1), response(OK, 1)])
    )
    session.transact(0x1015, data_in=True)
    assert session.poll_event(0.05) == PtpEvent(0x4002, 10, (0x64,))
    assert session.poll_event(0.05) is None
    transport.assert_finished()


def test_several_events_in_one_packet_wait_their_turn() -> None:
    session, transport = session_on()
    transport.interrupt.append(event(0x4002, 1, 1) + event(0x4002, 1, 2) + event(0x400D, 1, 1))
    assert [session.poll_event(0.05) for _ in range(4)] == [
        PtpEvent(0x4002, 1, (1,)),
        PtpEvent(0x4002, 1, (2,)),
        PtpEvent(0x400D, 1, (1,)),
        None,
    ]


def test_garbled_event_is_dropped_and_counted() -> None:
    session, transport = session_on()
    transport.interrupt.extend([b"\xff" * 16, event(0x4002, 1, 1)])
    assert session.poll_event(0.05) == PtpEvent(0x4002, 1, (1,))
    assert session._events._assembler.garbled == 1


def test_halted_event_endpoint_is_cleared_and_read_once_more() -> None:
    session, transport = session_on(Step(ClearHalt("event"), [OnEvent(event(0x4002, 1, 1))]))
    transport.interrupt.append(LinkStallError("halted"))
    assert session.poll_event(0.05) == PtpEvent(0x4002, 1, (1,))
    transport.assert_finished()


def test_lost_camera_found_by_polling_breaks_the_session() -> None:
    session, transport = session_on()
    transport.interrupt.append(DeviceLostError("unplugged"))
    with pytest.raises(DeviceLostError):
        session.poll_event(0.05)
    assert session.broken == "unplugged"


# Every wait has its limit.


def test_no_wait_is_longer_than_its_limit() -> None:
    """All kinds of fault, in every place of an operation: the error comes within the limit, plus a margin."""
    answers: dict[str, list[bytes | Exception]] = {
        "silence": [],
        "data only": [value(1)],
        "half a container": [value(1, bytes(2000))[:700]],
        "halt": [LinkStallError("halted")],
        "lost": [DeviceLostError("unplugged")],
        "data, then lost": [value(1), DeviceLostError("unplugged")],
        "data, then halt": [value(1), LinkStallError("halted")],
        "empty packets": [b""] * 20,
        **{name: list(wrong) for name, (wrong, _) in WRONG_ANSWERS.items()},
    }
    for name, answer in answers.items():
        for limit_s in (0.5, 8.0, 20.0):
            session, transport = session_on(Step(ask(1), answer), Step(ClearHalt("in")), Step(ClearHalt("in")))
            began_s = transport.clock.now_s
            with pytest.raises(DeviceError):
                session.transact(0x1015, data_in=True, timeout_s=limit_s)
            assert transport.clock.now_s - began_s <= limit_s + WAIT_MARGIN_S, name


def test_late_answer_without_end_keeps_the_limit() -> None:
    session, transport = session_on(Step(ask(1)), Step(ask(2)))
    with pytest.raises(DeviceTimeoutError):
        session.transact(0x1015, data_in=True)
    pieces = [container(2, 0x1015, 1, length=0xFFFFFFFE)]

    def trickle(max_bytes: int, timeout_s: float) -> bytes:
        transport.clock.sleep(0.3)
        return pieces.pop() if pieces else bytes(512)

    transport.read = trickle  # type: ignore[method-assign]
    began_s = transport.clock.now_s
    with pytest.raises(DeviceTimeoutError):
        session.transact(0x1015, data_in=True, timeout_s=6.0)
    assert transport.clock.now_s - began_s <= 6.0 + 0.3
    assert session.broken is not None


@pytest.mark.parametrize("sent", ["command", "data"])
def test_sending_has_the_same_limit(sent: str) -> None:
    session, transport = session_on()
    spent: list[float] = []

    def slow(payload: bytes, timeout_s: float) -> None:
        if sent == "data" and not spent:
            transport.clock.sleep(4.0)
        else:
            transport.clock.sleep(timeout_s)
            raise DeviceTimeoutError("not taken")
        spent.append(timeout_s)

    transport.write = slow  # type: ignore[method-assign]
    began_s = transport.clock.now_s
    with pytest.raises(DeviceTimeoutError):
        session.transact(0x1016, (0x5003,), data_out=b"xx", timeout_s=5.0)
    assert transport.clock.now_s - began_s <= 5.0 + WAIT_MARGIN_S
    assert session.broken is not None


@pytest.mark.parametrize("pieces", [[], [b"\x10\0\0\0\4\0\2\x40"], [b"\xff" * 8] * 50, [b""] * 50])
def test_polling_for_events_keeps_its_limit(pieces: list[bytes]) -> None:
    session, transport = session_on()
    transport.interrupt.extend(pieces)
    began_s = transport.clock.now_s
    assert session.poll_event(0.15) is None
    assert transport.clock.now_s - began_s <= 0.15 + WAIT_MARGIN_S


def test_only_one_data_phase() -> None:
    session, _ = session_on()
    with pytest.raises(ValueError, match="one data phase"):
        session.transact(0x1016, data_in=True, data_out=b"")


def test_wrong_parameters_do_not_break_the_session() -> None:
    session, transport = session_on(Step(command(0x911D, 1), [response(OK, 1)]))
    with pytest.raises(ValueError, match="parameters"):
        session.transact(0x1015, (-1,))
    session.transact(0x911D)
    transport.assert_finished()
