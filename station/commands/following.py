"""A capture or a day at work: signals, keys, views, notifications, and the summary at the end."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol

import click

from station.capture.events import CaptureEvent

if TYPE_CHECKING:
    from station.commands.views import SilentView
    from station.day.day import Day
    from station.session.session import SessionManifest

KEY_WAIT_S = 0.3  # chosen: how soon the keyboard's thread ends


class Job(Protocol):
    """What can be followed: a capture, or a day of them."""

    def events(self) -> Iterator[CaptureEvent]:
        """Run it."""

    def ask_stop(self) -> None:
        """End after the running pair."""

    def ask_pause(self, *, paused: bool) -> None:
        """Pause before the next pair, or continue."""


def follow(job: Job, view: SilentView, *, notify: str | None = None) -> bool:
    """Show the events until the end; returns whether somebody asked for an earlier one.

    Ctrl-C, SIGTERM and SIGHUP (a closed terminal) end it after the running pair; a second one of the first two at once.
    SIGUSR1 pauses, SIGUSR2 continues; on a terminal so do the keys p and c, each with Enter, and q ends.
    """
    from station.day.notify import Notifier

    stopped = threading.Event()

    def stop() -> None:
        stopped.set()
        job.ask_stop()

    notifier = Notifier(notify) if notify else None
    shows = True
    try:
        with _signals(job, stop), _keys(job, stop), view:
            for event in job.events():
                if notifier is not None:
                    notifier.send(event, {"pid": os.getpid()})
                try:
                    if shows:
                        view.show(event)
                except OSError:  # the terminal is gone, or the reader of the pipe
                    shows = False
                    stop()
    finally:
        if notifier is not None:
            notifier.close()
            if notifier.failed:
                with suppress(OSError):
                    click.echo(f"{notifier.failed} notifications failed: {notifier.problem}", err=True)
    return stopped.is_set()


@contextmanager
def _signals(job: Job, stop: Callable[[], None]) -> Iterator[None]:
    def on_end(number: int, _frame: FrameType | None) -> None:
        stop()
        if number == signal.SIGINT:
            signal.signal(number, signal.default_int_handler)
        elif number == signal.SIGTERM:
            signal.signal(number, signal.SIG_DFL)
        # A closing terminal sends SIGHUP more than once, by its shell and by the kernel.

    def on_pause(number: int, _frame: FrameType | None) -> None:
        job.ask_pause(paused=number == signal.SIGUSR1)

    handlers = {"SIGINT": on_end, "SIGTERM": on_end, "SIGHUP": on_end, "SIGUSR1": on_pause, "SIGUSR2": on_pause}
    known = {getattr(signal, name): handler for name, handler in handlers.items() if hasattr(signal, name)}
    before = {number: signal.signal(number, handler) for number, handler in known.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _keys(job: Job, stop: Callable[[], None]) -> Iterator[None]:
    """Listen to the keyboard while a terminal is there."""
    over = threading.Event()

    def listen() -> None:
        while not over.is_set():
            if not select.select([0], [], [], KEY_WAIT_S)[0]:
                continue
            line = os.read(0, 200)
            key = line.strip().lower()
            if key == b"q":
                stop()
            elif line:
                job.ask_pause(paused=key == b"p")
            else:
                return  # end of input

    listener = threading.Thread(target=listen, name="keys", daemon=True)
    if sys.stdin is not None and sys.stdin.isatty() and os.isatty(0):
        listener.start()
    try:
        yield
    finally:
        over.set()
        if listener.ident is not None:
            listener.join(2 * KEY_WAIT_S)


def on_terminal(options: dict[str, Any]) -> bool:
    """Whether to show bars and words: standard output is a terminal and no JSON is asked for."""
    return sys.stdout.isatty() and not options["as_json"]


def summarise(manifest: SessionManifest, path: Path, options: dict[str, Any], *, interrupted: bool = False) -> int:
    """Say what is there and what is missing; returns the exit code."""
    complete = manifest.status == "complete"
    summary = {
        "ok": complete,
        "session": str(path),
        "status": str(manifest.status),
        "frames": len(manifest.frames),
        "skipped": len(manifest.skipped),
        "missing": list(manifest.missing),
        "warnings": [w.message for w in manifest.warnings],
        "drift_frac": manifest.drift_frac,
    }
    lines = [f"{len(manifest.frames)} frames in {path}", *verdict(manifest)]
    if complete:
        lines.append(f"next: daylit process {click.format_filename(path)}")
    else:
        lines += [f"missing: {missing}" for missing in manifest.missing]
        lines.append(f"complete it: daylit capture --resume {click.format_filename(path)}")
    _print(lines, summary, options)
    return 0 if complete else 130 if interrupted else 4


def verdict(manifest: SessionManifest) -> list[str]:
    """Return what to look at before leaving: both ends of the brackets, shutters apart, drift of the light."""
    found, opened = [], defaultdict[int, list[float]](list)
    for side in manifest.bracket.sides:
        frames = sorted(manifest.pictures(side), key=lambda f: f.camera_s)
        lag_s = (manifest.rig.get(side.value) or {}).get("release_lag_s") or 0.0
        for frame in frames:
            if frame.taken_utc is not None and frame.release_monotonic_s is not None:  # that one ends with a restart
                opened[frame.stop].append(frame.taken_utc.timestamp() + lag_s)
        if frames and (first := frames[0].statistics) and (last := frames[-1].statistics):
            clipped = f"{first.clipped_frac:.2%} clipped in the shortest frame"
            found.append(f"{side}: {clipped}, {last.dark_frac:.2%} dark in the longest")
    apart = [max(times) - min(times) for times in opened.values() if len(times) > 1]
    found += [f"shutters opened at most {1000 * max(apart):.0f} ms apart"] if apart else []
    if manifest.drift_frac is not None:
        found.append(f"the light changed by {manifest.drift_frac:+.1%} from the first reading to the last")
    return found


def summarise_day(day: Day, options: dict[str, Any], *, interrupted: bool) -> int:
    """Say what a day brought; returns the exit code."""
    partial = [taken for taken in day.taken if taken.manifest.status != "complete"]
    complete = not (partial or day.missed or interrupted)
    summary = {
        "ok": complete,
        "sessions": [{"session": str(t.path), "status": str(t.manifest.status)} for t in day.taken],
        "missed": day.missed,
    }
    lines = [f"{len(day.taken)} sessions, {len(partial)} of them partial, {len(day.missed)} brackets missed"]
    lines += [f"complete it: daylit capture --resume {click.format_filename(taken.path)}" for taken in partial]
    _print(lines, summary, options)
    return 0 if complete else 130 if interrupted else 4


def _print(lines: list[str], summary: dict[str, Any], options: dict[str, Any]) -> None:
    with suppress(OSError):  # nobody listens any more; the session says it all
        for line in lines if on_terminal(options) else [json.dumps(summary)]:
            click.echo(line)
