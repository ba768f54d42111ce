"""Refusals, wrong ids and broken exchanges: our PTP initiator and libgphoto2's virtual camera get out of every one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    OperationRefusedError,
    ProtocolViolationError,
    StoreFullError,
)
from drivers.ptp.codes import ContainerType, DataType, ObjectFormat, Operation, Prop, Response
from drivers.ptp.container import Container, decode, encode
from drivers.ptp.session import PtpSession
from drivers.usb_link import UsbLink
from tests.peers.camera_talk import (
    EXPOSURE_TIME,
    STORAGE,
    added_pictures,
    capture,
    get_object,
    handle_of,
    new_session,
)
from tests.peers.vcamera import NO_LIBRARY, VirtualCameraBackend, find_library

pytestmark = [pytest.mark.peer, pytest.mark.skipif(find_library() is None, reason=NO_LIBRARY)]
NO_OBJECT = 0x00ABCDEF
PACKET_BYTES = 512


@contextmanager
def refused(code: Response) -> Iterator[None]:
    kind = StoreFullError if code == Response.STORE_NOT_AVAILABLE else OperationRefusedError
    with pytest.raises(kind, match=rf"\({code:04X}\)") as caught:
        yield
    assert caught.value.details["response_code"] == code


REFUSALS = {
    "handle, info": (Operation.GET_OBJECT_INFO, (NO_OBJECT,), True, Response.INVALID_OBJECT_HANDLE),
    "handle, data": (Operation.GET_OBJECT, (NO_OBJECT,), True, Response.INVALID_OBJECT_HANDLE),
    "handle, delete": (Operation.DELETE_OBJECT, (NO_OBJECT, 0), False, Response.INVALID_OBJECT_HANDLE),
    "handle, folder": (Operation.GET_OBJECT_HANDLES, (STORAGE, 0, NO_OBJECT), True, Response.INVALID_OBJECT_HANDLE),
    "store, capture": (Operation.INITIATE_CAPTURE, (0x00090009, 0), False, Response.STORE_NOT_AVAILABLE),
    "store, info": (Operation.GET_STORAGE_INFO, (0x00090009,), True, Response.INVALID_STORAGE_ID),
    "store, handles": (Operation.GET_OBJECT_HANDLES, (0x00090009, 0, 0), True, Response.INVALID_STORAGE_ID),
    "format, capture": (Operation.INITIATE_CAPTURE, (0, ObjectFormat.DNG), False, Response.INVALID_OBJECT_FORMAT),
    "format, handles": (
        Operation.GET_OBJECT_HANDLES,
        (STORAGE, ObjectFormat.DNG, 0),
        True,
        Response.SPEC_BY_FORMAT_UNSUPPORTED,
    ),
    "property, description": (Operation.GET_DEVICE_PROP_DESC, (0x5FFF,), True, Response.DEVICE_PROP_NOT_SUPPORTED),
    "property, value": (Operation.GET_DEVICE_PROP_VALUE, (0x5FFF,), True, Response.DEVICE_PROP_NOT_SUPPORTED),
    "parameters": (Operation.GET_STORAGE_INFO, (), True, Response.GENERAL_ERROR),
    "session": (Operation.OPEN_SESSION, (2,), False, Response.SESSION_ALREADY_OPEN),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_refusals_leave_the_session_in_order(session: PtpSession, backend: VirtualCameraBackend, case: str) -> None:
    operation, params, data_in, code = REFUSALS[case]
    with refused(code):
        session.transact(operation, params, data_in=data_in)
    assert session.broken is None
    assert session.get_storage_ids() == (STORAGE,)
    assert backend.resets == 0


def test_a_deleted_picture_is_gone(session: PtpSession) -> None:
    (picture,) = added_pictures(session, capture(session))
    session.delete_object(picture)
    with refused(Response.INVALID_OBJECT_HANDLE):
        session.get_object_info(picture)
    assert picture not in session.get_object_handles()


def test_a_setting_that_cannot_be_made(session: PtpSession) -> None:
    with refused(Response.ACCESS_DENIED):
        session.set_prop_value(Prop.BATTERY_LEVEL, DataType.UINT8, 100)
    with refused(Response.INVALID_PROP_FORMAT):
        session.transact(Operation.SET_DEVICE_PROP_VALUE, (EXPOSURE_TIME,), data_out=b"\x01")
    assert session.get_prop_value(Prop.BATTERY_LEVEL, DataType.UINT8) == 50
    assert session.broken is None


def test_more_data_than_was_due_is_a_violation(session: PtpSession) -> None:
    handle = handle_of(session, "IMG_0002.DNG")
    with pytest.raises(ProtocolViolationError, match="1300001 bytes announced where at most 1000 are due"):
        session.transact(Operation.GET_OBJECT, (handle,), data_in=True, max_data_bytes=1000)
    session.resynchronise()
    assert session.last_remedy == "cancel"
    assert len(get_object(session, handle)) == 1_300_001


def test_ok_without_the_data_is_a_violation(session: PtpSession) -> None:
    """The camera answers operations that it does not know with OK."""
    handle = handle_of(session, "NOTE.TXT")
    with pytest.raises(ProtocolViolationError, match="OK without the data"):
        session.get_partial_object(handle, 0, 4)
    session.resynchronise()
    assert session.last_remedy == "cancel"
    assert get_object(session, handle).startswith(b"grey card")


# ---- sessions and ids


def test_closed_and_opened_again(session: PtpSession, link: UsbLink, backend: VirtualCameraBackend) -> None:
    session.set_prop_value(Prop.F_NUMBER, DataType.UINT16, 1600)
    session.close()
    with pytest.raises(DeviceLostError, match="closed"):
        session.device_info()
    backend.camera.call("restart")
    link.reopen()
    again = new_session(link)
    again.open(session_id=7)
    assert (again.generation, again.last_remedy, backend.resets) == (1, None, 0)
    assert again.get_prop_desc(Prop.F_NUMBER).current == 280, "switched off meanwhile"
    assert again.get_storage_ids() == (STORAGE,)


def test_a_closed_session_is_closed_in_the_camera(session: PtpSession, link: UsbLink) -> None:
    session.transact(Operation.CLOSE_SESSION)
    session.session_id = None
    number = session.last_transaction_id + 1
    link.write(encode(Container(ContainerType.COMMAND, Operation.GET_STORAGE_IDS, number, b"")), 1.0)
    assert decode(link.read(PACKET_BYTES, 1.0)).code == Response.SESSION_NOT_OPEN


@pytest.mark.parametrize("end", ["killed", "closed"])
def test_a_camera_that_goes_on_with_the_old_ids(
    session: PtpSession, link: UsbLink, backend: VirtualCameraBackend, end: str
) -> None:
    """It answers OpenSession with the next id rather than 0, against the standard: only restarting it helps."""
    if end == "killed":
        session.get_storage_ids()
        session.session_id = None
    else:
        session.close()
        link.reopen()
    heir = new_session(link)
    heir.open()
    assert (heir.last_remedy, backend.resets) == ("port reset", 1)
    assert heir.late_answers > 0
    assert heir.get_storage_ids() == (STORAGE,)


def test_the_camera_refuses_a_wrong_transaction_id(session: PtpSession, link: UsbLink) -> None:
    due = session.last_transaction_id + 1
    link.write(encode(Container(ContainerType.COMMAND, Operation.GET_STORAGE_IDS, due + 5, b"")), 1.0)
    answer = decode(link.read(PACKET_BYTES, 1.0))
    assert (answer.type, answer.code) == (ContainerType.RESPONSE, Response.GENERAL_ERROR)
    assert answer.transaction_id == due, "it answers with the id that was due"


def test_ids_out_of_step_are_noticed_and_cured(session: PtpSession, backend: VirtualCameraBackend) -> None:
    session._last_id += 5
    with pytest.raises(ProtocolViolationError, match="second answer came for a finished operation") as caught:
        session.get_storage_ids()
    assert caught.value.details["code"] == Response.GENERAL_ERROR
    with pytest.raises(ProtocolViolationError, match="resynchronise first"):
        session.get_storage_ids()
    session.resynchronise()
    assert (session.last_remedy, session.generation, backend.resets) == ("port reset", 2, 1)
    assert session.get_storage_ids() == (STORAGE,)


def test_an_answer_too_many_is_noticed_and_cured(session: PtpSession) -> None:
    """Asked to set an unknown property, the camera answers the command, and then the data with the next id."""
    with refused(Response.DEVICE_PROP_NOT_SUPPORTED):
        session.set_prop_value(0x5FFF, DataType.UINT8, 1)
    with refused(Response.GENERAL_ERROR):
        session.get_storage_ids()
    session.resynchronise()
    assert session.last_remedy == "port reset"
    assert session.get_storage_ids() == (STORAGE,)


def test_ids_stay_in_step_over_many_operations(session: PtpSession) -> None:
    for _ in range(300):
        session.get_storage_ids()
    assert session.last_transaction_id == 300
    assert session.late_answers == session._events._assembler.garbled == 0


def test_silence_is_a_timeout_that_breaks_nothing(session: PtpSession) -> None:
    """The camera waits for the data that belongs to the operation, and the id stays due."""
    with pytest.raises(DeviceTimeoutError):
        session.transact(Operation.SET_DEVICE_PROP_VALUE, (EXPOSURE_TIME,), timeout_s=0.5)
    assert session.broken is None
    session._last_id -= 1
    assert session.get_storage_ids() == (STORAGE,)
