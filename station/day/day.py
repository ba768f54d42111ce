"""A day of brackets in one process: by the hour from one tripod, or a queue of rooms, through what a day brings.

While no bracket runs, cameras are kept awake and found again, batteries and cards are watched.
"""

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from drivers.camera import CameraStatus
from drivers.clock import Clock
from drivers.errors import DeviceError
from station.capture.capture import Capture, CaptureRequest
from station.capture.events import CaptureEvent, EventKind
from station.capture.preflight import Check, Level, status_checks
from station.capture.rig import Rig
from station.errors import UsageError
from station.frames.check import FrameChecker
from station.session.session import SessionManifest, SessionStatus, Side
from station.session.store import SessionStore

LOOK_S = 5.0
"""Chosen: as often a camera is kept awake or looked for; EOS programs keep alive about every 10 s (libgphoto2)."""
TICK_S = 0.5  # chosen: how soon a pause or a camera that is back is noticed
PATIENCE_S = 600.0
"""Chosen: for so long a camera, a battery or a card is waited for once a bracket is due, or a broken one resumed."""
# Chosen: what breaks more often needs a person; a list longer than a day.
MAX_RESUMES = 3
MAX_ROOMS = 500  # as above
MAX_ROOMS_BYTES = 64 * 1024  # of a list of them: a hundred letters each


class Watch:
    """Looks after the cameras of a rig between two brackets; not while a capture has them."""

    def __init__(self, rig: Rig, clock: Clock) -> None:
        self._rig = rig
        self._clock = clock
        self._away: dict[Side, str] = {}
        self._looked_s = clock.monotonic_s() - LOOK_S
        self._charge: dict[Side, list[float]] = {side: [] for side in rig.cameras}
        """Battery after each bracket, 0 to 1."""

    def look(self) -> Iterator[str]:
        """Keep each camera awake, or look for it; yields, every `LOOK_S`, who went and who is back."""
        if self._clock.monotonic_s() - self._looked_s < LOOK_S:
            return
        self._looked_s = self._clock.monotonic_s()
        for side, camera in self._rig.cameras.items():
            try:
                if side in self._away:
                    camera.connect()
                    del self._away[side]
                    yield f"{side}: camera found"
                else:
                    camera.keep_alive()
            except DeviceError as error:
                if self._away.get(side) != error.message:
                    self._away[side] = error.message
                    yield f"{side}: {error.message}"
                camera.close()

    def forget(self) -> None:
        """Take every camera for unconnected: what used it has failed, or it was never there."""
        self._away = dict.fromkeys(self._rig.cameras, "")
        self._looked_s = self._clock.monotonic_s() - LOOK_S

    def wants(self, frames: int) -> list[Check]:
        """Return what forbids a bracket of ``frames`` pictures a camera now; empty: it may begin."""
        found = [Check(Level.FAIL, str(side), why or "not connected") for side, why in self._away.items()]
        for side, status in self._statuses():
            found += status_checks(side, status, None, self._rig.file.limits, frames)
        return [check for check in found if check.level is Level.FAIL]

    def outlook(self, frames: int, brackets: int) -> list[str]:
        """Return what will not last for ``brackets`` more of ``frames`` pictures a camera, after one has been taken."""
        found = []
        for side, status in self._statuses():
            if status.free_frames is not None and status.free_frames < brackets * frames:
                lasts = status.free_frames // max(frames, 1)
                found.append(f"{side}: the card has space for {lasts} of {brackets} brackets to come")
            if status.battery_frac is None:
                continue
            charge = self._charge[side]
            charge.append(status.battery_frac)
            used = max(charge[0] - charge[-1], 0.0) / max(len(charge) - 1, 1)
            left = status.battery_frac - self._rig.file.limits.min_battery_frac
            if used and left < brackets * used:
                lasts = max(int(left / used), 0)
                found.append(f"{side}: the battery will last for about {lasts} of {brackets} brackets to come")
            if len(charge) > 1 and charge[-1] > charge[-2]:
                charge[:] = charge[-1:]  # another battery
        return found

    def _statuses(self) -> Iterator[tuple[Side, CameraStatus]]:
        for side, camera in self._rig.cameras.items():
            if side not in self._away:
                with suppress(DeviceError):  # the next look finds it gone
                    yield side, camera.status()


@dataclass(frozen=True)
class DayPlan:
    """Rooms in order, each once; or one room every ``every_s`` seconds until ``until_utc``."""

    rooms: tuple[str, ...]
    every_s: float | None = None
    until_utc: datetime | None = None


@dataclass(frozen=True)
class Taken:
    """A session of the day."""

    path: Path
    manifest: SessionManifest


def parse_every(text: str) -> float:
    """Return seconds of ``60m``, ``1h30m``, ``90s``; `UsageError` for anything else, and below a minute."""
    match = re.fullmatch(r"(?:(\d{1,2})h)?(?:(\d{1,4})m)?(?:(\d{1,5})s)?", text.strip())
    hours, minutes, seconds = (int(part or 0) for part in match.groups()) if match else (0, 0, 0)
    total_s = 3600.0 * hours + 60 * minutes + seconds
    if total_s < 60:
        raise UsageError(f"{text!r} is not an interval", where="--every", advice="write 60m, 1h30m, at least 1m")
    return total_s


def parse_until(text: str, now_utc: datetime) -> datetime:
    """Return the next moment at which local clocks show ``HH:MM`` today; `UsageError` if that is past, or no time."""
    match = re.fullmatch(r"([01]?\d|2[0-3]):([0-5]\d)", text.strip())
    if match is None:
        raise UsageError(f"{text!r} is not a time of day", where="--until", advice="write HH:MM, e.g. 18:00")
    today = now_utc.astimezone().replace(tzinfo=None, second=0, microsecond=0)  # its offset may be another by then
    until = today.replace(hour=int(match[1]), minute=int(match[2])).astimezone(UTC)
    if until <= now_utc:
        raise UsageError(f"{text} is already past", where="--until", advice="give a later time of today")
    return until


def read_rooms(path: Path) -> tuple[str, ...]:
    """Return the rooms of a file, one a line; what follows # is a comment. `UsageError` where there are none."""
    try:
        if path.stat().st_size > MAX_ROOMS_BYTES:
            raise UsageError("too large for a list of rooms", where=str(path), advice="one room per line")
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot be read: {error}", where=str(path), advice="one room per line, in UTF-8") from error
    rooms = tuple(name for line in lines if (name := line.partition("#")[0].strip()))
    if not 0 < len(rooms) <= MAX_ROOMS:
        raise UsageError(f"{len(rooms)} rooms", where=str(path), advice=f"one room per line, 1 to {MAX_ROOMS}")
    return rooms


class Day:
    """Takes the brackets of a day; iterate `events`, then look at ``taken`` and ``missed``."""

    def __init__(self, rig: Rig, plan: DayPlan, request: CaptureRequest) -> None:
        self.taken: list[Taken] = []
        self.missed: list[str] = []
        self._rig = rig
        self._plan = plan
        self._request = request
        self._watch = Watch(rig, rig.clock)
        self._job: Capture | None = None
        self._stop_asked = self._paused = False
        rig.checkers = rig.checkers or {side: FrameChecker() for side in rig.cameras}
        # Refuses at once what no bracket could be, and names that no session can hold
        first, *_ = [Capture.new(rig, replace(request, room=room)) for room in plan.rooms]
        self.n_stops = first.n_stops
        self._frames = first.n_stops * (1 + any(t.keep_raw for t in rig.file.cameras().values()))

    def ask_stop(self) -> None:
        """End after the running pair, and with it the day. Safe in a signal handler."""
        self._stop_asked = True
        if self._job is not None:
            self._job.ask_stop()

    def ask_pause(self, *, paused: bool) -> None:
        """Pause at the next pair or bracket, or continue. Safe in a signal handler."""
        self._paused = paused
        if self._job is not None:
            self._job.ask_pause(paused=paused)

    def events(self) -> Iterator[CaptureEvent]:
        """Run the day. A bracket that cannot be taken is missed and named; errors that are no device's end the day."""
        self._watch.forget()
        for number, (room, due_s) in enumerate(self._slots()):
            if self._plan.every_s is None and number:
                self.ask_pause(paused=True)
                yield self._say(EventKind.WAITING, f"move the rig to {room}, then continue", room=room)
            yield from self._wait(due_s)
            if self._stop_asked:
                break
            yield from self._bracket(room)
            to_come = self._n_to_come(number)
            for text in self._watch.outlook(self._frames, to_come) if to_come else ():
                yield self._say(EventKind.WARNING, text)
        complete = sum(t.manifest.status is SessionStatus.COMPLETE for t in self.taken)
        text = f"day over: {complete} of {len(self.taken)} sessions complete, {len(self.missed)} brackets missed"
        yield self._say(EventKind.FINISHED, text, sessions=[str(t.path) for t in self.taken], missed=self.missed)

    def _slots(self) -> Iterator[tuple[str, float]]:
        """Yield rooms and when each is due, monotonic seconds; a slot that went by while one was taken is left out."""
        clock, every_s = self._rig.clock, self._plan.every_s
        start_s = clock.monotonic_s()
        if every_s is None:
            yield from ((room, start_s) for room in self._plan.rooms)
            return
        slot = 0
        while not self._stop_asked and not self._over(start_s + slot * every_s):
            yield self._plan.rooms[0], start_s + slot * every_s
            slot = max(slot + 1, math.ceil((clock.monotonic_s() - start_s) / every_s))

    def _over(self, due_s: float) -> bool:
        clock, until = self._rig.clock, self._plan.until_utc
        return until is not None and clock.utc_now() + timedelta(seconds=due_s - clock.monotonic_s()) > until

    def _n_to_come(self, number: int) -> int:
        if self._plan.every_s is None:
            return len(self._plan.rooms) - number - 1
        if self._plan.until_utc is None:
            return 1
        left_s = (self._plan.until_utc - self._rig.clock.utc_now()).total_seconds()
        return max(int(left_s // self._plan.every_s), 0)

    def _wait(self, due_s: float) -> Iterator[CaptureEvent]:
        """Keep the cameras awake until a bracket is due and nobody wants a pause."""
        paused = False
        while not self._stop_asked and (self._paused or self._rig.clock.monotonic_s() < due_s):
            if self._paused != paused:
                paused = self._paused
                yield self._say(EventKind.PAUSED, "paused") if paused else self._say(EventKind.CONTINUED, "continued")
            yield from self._look()
            self._rig.clock.sleep(TICK_S)
        if paused:
            yield self._say(EventKind.CONTINUED, "continued")

    def _look(self) -> Iterator[CaptureEvent]:
        for text in self._watch.look():
            yield self._say(EventKind.WAITING, text)

    def _ready(self, until_s: float) -> Iterator[CaptureEvent]:
        """Wait for cameras, batteries and cards, at most until ``until_s``."""
        said = ""
        while not self._stop_asked:
            yield from self._look()
            wants = self._watch.wants(self._frames)
            if not wants or self._rig.clock.monotonic_s() > until_s:
                return
            text = "; ".join(f"{check.name}: {check.text}" for check in wants)
            if text != said:
                said = text
                yield self._say(EventKind.WAITING, text, checks=[check.to_dict() for check in wants])
            self._rig.clock.sleep(TICK_S)

    def _bracket(self, room: str) -> Iterator[CaptureEvent]:
        """Take one bracket, resumed when an instrument is back, within `PATIENCE_S`."""
        until_s = self._rig.clock.monotonic_s() + PATIENCE_S
        path: Path | None = None
        why = "nothing was captured"
        for _ in range(1 + MAX_RESUMES):
            yield from self._ready(until_s)
            if self._stop_asked:
                break
            job = self._job = self._open(room, path)
            try:
                yield from job.events()
            except DeviceError as error:
                self._watch.forget()
                why = str(error)
                yield self._say(EventKind.WAITING, f"{room}: {error}", error=error.to_dict())
            finally:
                self._job = None
                if job.has_store:
                    path = job.store.path
                    job.store.close()
            whole = path and self._manifest(path).status is SessionStatus.COMPLETE
            if whole or self._stop_asked or self._rig.clock.monotonic_s() > until_s:
                break
        if path is not None:
            self.taken.append(Taken(path, self._manifest(path)))
            return
        at = f"{self._rig.clock.utc_now().astimezone():%H:%M}"
        self.missed.append(f"{room} {at}")
        yield self._say(EventKind.MISSED, f"{room} at {at} was missed: {why}", room=room)

    def _open(self, room: str, path: Path | None) -> Capture:
        if path is None:
            job = Capture.new(self._rig, replace(self._request, room=room))
        else:
            job = Capture.resume(self._rig, SessionStore.open(path, writable=True, clock=self._rig.clock))
        job.ask_pause(paused=self._paused)
        return job

    @staticmethod
    def _manifest(path: Path) -> SessionManifest:
        with SessionStore.open(path, writable=False) as store:
            return store.manifest

    def _say(self, kind: EventKind, text: str, /, **data: object) -> CaptureEvent:
        return CaptureEvent(kind, text, self._rig.clock.monotonic_s(), data)
