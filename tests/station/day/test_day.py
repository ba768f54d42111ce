"""A day of brackets with cameras that follow the contract: slots, queues, what is waited for, and who is notified."""

from __future__ import annotations

import itertools
import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

import station.day.day
from drivers.camera import CameraStatus
from drivers.clock import SteadyClock, SystemClock
from drivers.errors import DeviceLostError, DeviceNotFoundError
from station.capture.capture import CaptureRequest
from station.capture.events import CaptureEvent, EventKind
from station.day.day import Day, DayPlan, Watch, parse_every, parse_until, read_rooms
from station.day.notify import Notifier
from station.errors import UsageError
from station.session.session import SessionStatus
from tests.station.capture.fake_camera import FakeCamera
from tests.station.capture.test_capture import STOPS_S, make_rig
from tests.virtual_clock import VirtualClock

NOON = datetime(2023, 5, 19, 12, 0, tzinfo=UTC)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look and tick often: these days last a second or two."""
    monkeypatch.setattr("station.day.day.LOOK_S", 0.05)
    monkeypatch.setattr("station.day.day.TICK_S", 0.02)


class Powered(FakeCamera):
    """Has a battery, and may be away."""

    battery = 0.9
    away = 0
    """Connections that fail before it is back."""

    def connect(self):
        if self.away:
            self.away -= 1
            raise DeviceNotFoundError("not found on USB")
        return super().connect()

    def status(self) -> CameraStatus:
        self.calls["status"] += 1
        return replace(super().status(), battery_frac=self.battery)


def take(day: Day) -> list[CaptureEvent]:
    events = list(day.events())
    assert day._rig.checkers
    for checker in day._rig.checkers.values():
        checker.close()
    return events


def day_of(tmp_path: Path, camera: FakeCamera, plan: DayPlan) -> Day:
    return Day(make_rig(camera), plan, CaptureRequest(room="x", into=tmp_path, stops_s=STOPS_S[2:]))


@pytest.mark.parametrize(("text", "seconds"), [("60m", 3600), ("1h30m", 5400), ("90s", 90), ("2h", 7200)])
def test_intervals(text: str, seconds: float) -> None:
    assert parse_every(text) == seconds


@pytest.mark.parametrize("text", ["", "60", "30s", "m", "1d", "-5m", "60m later"])
def test_what_is_no_interval(text: str) -> None:
    with pytest.raises(UsageError):
        parse_every(text)


def test_until_is_a_time_of_today() -> None:
    now = NOON.astimezone()
    late = (now + timedelta(hours=1)).strftime("%H:%M")
    assert timedelta(0) < parse_until(late, NOON) - NOON <= timedelta(hours=1)
    for text in ((now - timedelta(minutes=2)).strftime("%H:%M"), "24:00", "6 pm"):
        with pytest.raises(UsageError):
            parse_until(text, NOON)


def test_until_is_what_clocks_show_after_they_were_put_forward(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "America/New_York")
    time.tzset()
    try:
        midnight = datetime(2023, 3, 12, 5, 0, tzinfo=UTC)  # clocks go forward two hours later
        assert parse_until("18:00", midnight) == datetime(2023, 3, 12, 22, 0, tzinfo=UTC)
    finally:
        monkeypatch.undo()
        time.tzset()


def test_rooms_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "rooms.txt"
    for encoding in ("utf-8", "utf-8-sig"):  # as Windows' editor saves it
        path.write_text("hall  # first\n\n# later: cellar\nkitchen\n", encoding)
        assert read_rooms(path) == ("hall", "kitchen")
    path.write_text("# nothing\n")
    with pytest.raises(UsageError, match="0 rooms"):
        read_rooms(path)


def test_a_room_by_the_hour(tmp_path: Path) -> None:
    until = datetime.now(UTC) + timedelta(seconds=5)
    day = day_of(tmp_path, Powered(SystemClock()), DayPlan(("hall",), 2.0, until))
    events = take(day)
    assert [t.manifest.status for t in day.taken] == [SessionStatus.COMPLETE] * len(day.taken)
    assert 2 <= len(day.taken) <= 3
    assert not day.missed
    assert events[-1].kind is EventKind.FINISHED
    starts = [t.manifest.created_utc for t in day.taken]
    assert all(
        abs((b - a).total_seconds() - 2 * round((b - a).total_seconds() / 2)) < 1 for a, b in itertools.pairwise(starts)
    )


def test_a_slot_that_passes_during_a_bracket_is_left_out_and_not_taken_late(tmp_path: Path) -> None:
    clock = VirtualClock()
    rig = make_rig(Powered(clock))
    rig.clock = SteadyClock(clock)
    day = Day(rig, DayPlan(("hall",), 60.0, clock.utc_now() + timedelta(hours=1)), CaptureRequest("", tmp_path))
    slots, start_s = day._slots(), clock.monotonic_s()
    due = []
    for took_s in (20.0, 75.0, 130.0, 60.0, 20.0):
        due.append(next(slots)[1] - start_s)
        clock.sleep(max(0.0, due[-1] + start_s - clock.monotonic_s()) + took_s)
    assert due == [0.0, 60.0, 180.0, 360.0, 420.0]


def test_a_name_that_no_session_can_hold_is_refused_wherever_it_stands_in_the_queue(tmp_path: Path) -> None:
    request = CaptureRequest(room="hall", into=tmp_path, stops_s=STOPS_S)
    with pytest.raises(UsageError, match="too long"):
        Day(make_rig(FakeCamera(SystemClock())), DayPlan(("hall", "x" * 600)), request)


def test_a_queue_of_rooms_waits_for_somebody_to_move_the_rig(tmp_path: Path) -> None:
    camera = Powered(SystemClock())
    day = day_of(tmp_path, camera, DayPlan(("hall", "kitchen")))
    kept: list[int] = []
    for event in day.events():
        if event.kind is EventKind.PAUSED:
            threading.Timer(0.4, lambda: day.ask_pause(paused=False)).start()
        if event.kind is EventKind.CONTINUED:
            kept.append(camera.calls["keep_alive"])
    day._rig.close()
    assert [t.manifest.name for t in day.taken] == ["hall", "kitchen"]
    assert kept[0] >= 2, "kept awake while it waited"


def test_a_camera_that_goes_in_mid_bracket_is_waited_for_and_its_session_completed(tmp_path: Path) -> None:
    gone = {("release", 2): DeviceLostError("unplugged"), ("recover", 1): DeviceLostError("still")}
    camera = Powered(SystemClock(), failures=gone)

    def away(_shot: int, _shutter_s: float, data: bytes) -> bytes:
        camera.away = 3
        return data

    camera.spoil = away
    day = day_of(tmp_path, camera, DayPlan(("hall",)))
    events = take(day)
    (taken,) = day.taken
    assert taken.manifest.status is SessionStatus.COMPLETE
    assert "resumed" in {w.code for w in taken.manifest.warnings}
    waits = [e.text for e in events if e.kind is EventKind.WAITING]
    assert any("not found" in text for text in waits)
    assert "indoor: camera found" in waits


def test_an_empty_battery_is_waited_for_before_a_bracket_begins(tmp_path: Path) -> None:
    camera = Powered(SystemClock())
    camera.battery = 0.05
    day = day_of(tmp_path, camera, DayPlan(("hall",)))
    for event in day.events():
        if event.kind is EventKind.WAITING and "battery" in event.text:
            assert not camera.opened_s
            camera.battery = 0.8
    day._rig.close()
    assert day.taken[0].manifest.status is SessionStatus.COMPLETE


def test_what_does_not_come_back_is_missed_and_the_day_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station.day.day, "PATIENCE_S", 0.3)
    camera = Powered(SystemClock())
    camera.away = 10_000
    day = day_of(tmp_path, camera, DayPlan(("hall", "kitchen")))
    for event in day.events():
        if event.kind is EventKind.MISSED:
            camera.away = 0
        if event.kind is EventKind.PAUSED:
            day.ask_pause(paused=False)
    day._rig.close()
    assert len(day.missed) == 1
    assert day.missed[0].startswith("hall")
    assert [t.manifest.name for t in day.taken] == ["kitchen"]


def test_a_battery_that_will_not_last_is_reported_in_time() -> None:
    camera = Powered(SystemClock())
    rig = make_rig(camera)
    watch = Watch(rig, rig.clock)
    camera.battery = 0.9
    assert watch.outlook(9, 5) == []
    camera.battery = 0.6
    assert watch.outlook(9, 5) == ["indoor: the battery will last for about 1 of 5 brackets to come"]
    camera.battery = 1.0  # another one
    assert watch.outlook(9, 5) == []


class Hook(BaseHTTPRequestHandler):
    """Keeps what is posted."""

    got: list[dict[str, object]]
    redirect = False

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        type(self).got.append(json.loads(body))
        self.send_response(302 if self.redirect else 204)
        if self.redirect:
            self.send_header("Location", "http://127.0.0.1:9/elsewhere")
        self.end_headers()

    def log_message(self, *_args: object) -> None:
        return None


@pytest.fixture
def hook() -> Iterator[tuple[str, type[Hook]]]:
    handler = type("ThisHook", (Hook,), {"got": []})
    server = HTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/hook", handler
    server.shutdown()
    server.server_close()
    thread.join(5)


WARNED = CaptureEvent(EventKind.WARNING, "the light changed", 1.0, {"code": "drift"})


def test_a_url_is_notified_and_no_redirect_followed(hook: tuple[str, type[Hook]]) -> None:
    url, handler = hook
    notifier = Notifier(url)
    notifier.send(WARNED, {"pid": 7})
    notifier.send(CaptureEvent(EventKind.PROGRESS, "", 2.0), {})
    notifier.close()
    assert handler.got == [{"pid": 7, "event": "warning", "text": "the light changed", "at_s": 1.0, "code": "drift"}]
    assert (notifier.sent, notifier.failed) == (1, 0)
    handler.redirect = True
    again = Notifier(url)
    again.send(WARNED, {})
    again.close()
    assert (again.sent, again.failed) == (0, 1)
    assert "302" in again.problem


def test_a_server_that_answers_rubbish_costs_one_notification_and_not_the_rest() -> None:
    """As a hotel's network does until somebody has logged in."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        notifier = Notifier(f"http://127.0.0.1:{server.getsockname()[1]}/hook")
        for _ in range(2):
            notifier.send(WARNED, {})
        for answer in (b"no HTTP at all\r\n\r\n", b"HTTP/1.1 204 No Content\r\n\r\n"):
            server.settimeout(5.0)
            connection, _ = server.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(answer)
        notifier.close()
    assert (notifier.sent, notifier.failed) == (1, 1)
    assert "BadStatusLine" in notifier.problem


def test_a_command_is_notified_on_its_standard_input(tmp_path: Path) -> None:
    script = tmp_path / "reported.py"
    script.write_text(f"import sys; open({str(tmp_path / 'out')!r}, 'a').write(sys.stdin.read())")
    notifier = Notifier(f"{sys.executable} {script}")
    notifier.send(WARNED, {})
    notifier.close()
    assert json.loads((tmp_path / "out").read_text())["code"] == "drift"
    broken = Notifier("/nonexistent/command")
    broken.send(WARNED, {})
    broken.close()
    assert broken.failed == 1


@pytest.mark.parametrize("target", ["ftp://example.org/x", "file:///etc/passwd", "", "echo 'open"])
def test_what_cannot_be_notified(target: str) -> None:
    with pytest.raises(UsageError):
        Notifier(target)
