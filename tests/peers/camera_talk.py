"""What tests say to a camera through our session, and what they wait for."""

from __future__ import annotations

from drivers.clock import Deadline, SystemClock
from drivers.ptp.codes import Event, ObjectFormat, Operation
from drivers.ptp.session import PtpEvent, PtpSession
from drivers.usb_link import UsbLink

STORAGE = 0x00010001
EXPOSURE_TIME = 0x500D
EVENT_LIMIT_S = 20.0


def new_session(link: UsbLink) -> PtpSession:
    return PtpSession(link, SystemClock(), name="virtual camera")


def handle_of(session: PtpSession, name: str) -> int:
    (handle,) = [h for h in session.get_object_handles() if session.get_object_info(h).filename == name]
    return handle


def get_object(session: PtpSession, handle: int) -> bytes:
    return session.transact(Operation.GET_OBJECT, (handle,), data_in=True).data


def events_until(session: PtpSession, last_code: int) -> list[PtpEvent]:
    """Return the events up to the first with this code."""
    deadline = Deadline.after(SystemClock(), EVENT_LIMIT_S)
    found: list[PtpEvent] = []
    while not found or found[-1].code != last_code:
        deadline.check(f"event {last_code:04X}; there were {found}")
        event = session.poll_event(1.0)
        found += [event] if event else []
    return found


def capture(session: PtpSession) -> list[PtpEvent]:
    session.transact(Operation.INITIATE_CAPTURE, (0, 0))
    return events_until(session, Event.CAPTURE_COMPLETE)


def added_pictures(session: PtpSession, events: list[PtpEvent]) -> list[int]:
    added = [e.params[0] for e in events if e.code == Event.OBJECT_ADDED]
    return [h for h in added if session.get_object_info(h).format_code != ObjectFormat.ASSOCIATION]
