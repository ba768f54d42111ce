"""The responder's state machine: sessions, ids, parameters, events; without any cable."""

from __future__ import annotations

import pytest

from drivers.ptp.codes import Event, Operation, Response
from mocks.instruments.ptp.wire import Answer, Request
from tests.mocks.instruments.echo import GIVE, KEEP, SIGNAL, Echo
from tests.virtual_clock import VirtualClock


@pytest.fixture
def camera() -> Echo:
    return Echo(VirtualClock())


def ask(camera: Echo, operation: int, transaction_id: int, *params: int, data: bytes = b"") -> Answer:
    return camera.handle(Request(operation, transaction_id, params, data))


def test_nothing_but_device_info_without_a_session(camera: Echo) -> None:
    assert ask(camera, Operation.GET_DEVICE_INFO, 0).code == Response.OK
    assert ask(camera, GIVE, 0).code == Response.SESSION_NOT_OPEN
    assert ask(camera, Operation.CLOSE_SESSION, 0).code == Response.SESSION_NOT_OPEN
    assert ask(camera, 0x9FFF, 0).code == Response.SESSION_NOT_OPEN


def test_a_session_counts_transactions_from_one(camera: Echo) -> None:
    assert ask(camera, Operation.OPEN_SESSION, 0, 5).code == Response.OK
    assert [ask(camera, GIVE, n).code for n in (1, 2, 3)] == [Response.OK] * 3
    assert ask(camera, Operation.CLOSE_SESSION, 4).code == Response.OK
    assert ask(camera, Operation.OPEN_SESSION, 0, 6).code == Response.OK
    assert ask(camera, GIVE, 1).code == Response.OK
    assert camera.stats.violations == []


@pytest.mark.parametrize("wrong", [0, 1, 3, 0xFFFFFFFF])
def test_a_wrong_transaction_id_is_refused_and_noted(camera: Echo, wrong: int) -> None:
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    ask(camera, GIVE, 1)
    assert ask(camera, GIVE, wrong).code == Response.INVALID_TRANSACTION_ID
    assert len(camera.stats.violations) == 1
    assert ask(camera, GIVE, 2).code == Response.OK


def test_the_transaction_id_wraps_past_the_two_forbidden_values(camera: Echo) -> None:
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    camera._last_transaction_id = 0xFFFFFFFD
    assert ask(camera, GIVE, 0xFFFFFFFE).code == Response.OK
    assert ask(camera, GIVE, 1).code == Response.OK


def test_a_second_open_session_names_the_first(camera: Echo) -> None:
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    answer = ask(camera, Operation.OPEN_SESSION, 0, 6)
    assert (answer.code, answer.params) == (Response.SESSION_ALREADY_OPEN, (5,))


def test_session_zero_and_missing_parameters_are_refused(camera: Echo) -> None:
    assert ask(camera, Operation.OPEN_SESSION, 0, 0).code == Response.INVALID_PARAMETER
    assert ask(camera, Operation.OPEN_SESSION, 0).code == Response.INVALID_PARAMETER
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    assert ask(camera, GIVE, 1, 8, 1).code == Response.PARAMETER_NOT_SUPPORTED
    assert ask(camera, GIVE, 2, 8, 0, 0).code == Response.OK, "unused parameters may be sent as zero"
    assert ask(camera, 0x9FFF, 3).code == Response.OPERATION_NOT_SUPPORTED


def test_data_is_expected_where_the_rule_says(camera: Echo) -> None:
    assert camera.expects_data(KEEP)
    assert not camera.expects_data(GIVE)
    assert not camera.expects_data(0x9FFF)
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    assert ask(camera, KEEP, 1, data=b"abc").params == (3,)
    assert ask(camera, GIVE, 2).data == b"abc"


def test_events_carry_code_transaction_and_parameters(camera: Echo) -> None:
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    ask(camera, SIGNAL, 1, Event.OBJECT_ADDED, 0x64)
    event = camera.events.popleft()
    assert event.encode() == bytes.fromhex("10 00 00 00 04 00 02 40 01 00 00 00 64 00 00 00")


def test_the_log_has_every_transaction(camera: Echo) -> None:
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    camera.clock.sleep(2)
    ask(camera, GIVE, 1, 100)
    ask(camera, GIVE, 3)
    last = camera.stats.operations[-2]
    assert (last.at_s, last.operation, last.params, last.code, last.in_bytes) == (2, GIVE, (100,), Response.OK, 100)
    assert camera.stats.count(GIVE) == 2
    assert camera.stats.count(GIVE, Response.OK) == 1


def test_a_pulled_cable_ends_the_session_and_forgets_events(camera: Echo) -> None:
    ask(camera, Operation.OPEN_SESSION, 0, 5)
    ask(camera, SIGNAL, 1, Event.OBJECT_ADDED, 0x64)
    camera.unplug()
    assert not camera.plugged
    camera.clock.sleep(1e6)
    assert not camera.plugged
    camera.replug()
    assert camera.plugged
    assert not camera.events
    assert ask(camera, GIVE, 0).code == Response.SESSION_NOT_OPEN
