"""Sends events elsewhere as JSON: to a command's standard input, or to a URL by HTTP POST; never in a capture's way."""

import json
import queue
import shlex
import subprocess
import threading
import urllib.request
from collections.abc import Mapping
from http.client import HTTPException
from typing import Any
from urllib.parse import urlsplit

from station.capture.events import CaptureEvent, EventKind
from station.errors import UsageError

WORTH_SENDING = (
    *(EventKind.STARTED, EventKind.FINISHED, EventKind.WARNING, EventKind.RECOVERING, EventKind.FAILED),
    *(EventKind.WAITING, EventKind.PAUSED, EventKind.CONTINUED, EventKind.MISSED),
)
# Chosen: a telephone's network on site; what is not taken by then is dropped.
SEND_LIMIT_S = 10.0
CLOSE_LIMIT_S = 12.0  # as above
MAX_QUEUED = 200  # as above


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_args: Any, **_kwargs: Any) -> None:
        """Refuse: an event goes where it was asked to go, and nowhere else."""


class Notifier:
    """Notifies a command or URL, in a thread of its own; ``failed`` counts what did not arrive, ``problem`` is why."""

    def __init__(self, target: str) -> None:
        """Raises `UsageError`: neither an http(s) URL nor a command."""
        self._url = target if urlsplit(target).scheme in ("http", "https") else ""
        try:
            self._command = [] if self._url else shlex.split(target)
        except ValueError as error:
            raise UsageError(f"{target!r}: {error}", where="--notify", advice="give a URL or a command") from error
        if not self._url and (not self._command or "://" in self._command[0]):
            raise UsageError(f"{target!r} is neither http(s) nor a command", where="--notify", advice="correct it")
        self.sent = self.failed = 0
        self.problem = ""
        self._queue: queue.Queue[bytes | None] = queue.Queue(MAX_QUEUED)
        self._opener = urllib.request.build_opener(_NoRedirects())
        self._thread = threading.Thread(target=self._run, name="notify", daemon=True)
        self._thread.start()

    def send(self, event: CaptureEvent, facts: Mapping[str, Any]) -> None:
        """Queue an event that is worth it, with ``facts`` beside; a full queue drops it."""
        if event.kind not in WORTH_SENDING:
            return
        try:
            self._queue.put_nowait(json.dumps({**facts, **event.to_dict()}, default=str).encode())
        except queue.Full:
            self.failed += 1

    def close(self) -> None:
        """Send what is queued, within `CLOSE_LIMIT_S`."""
        try:
            self._queue.put(None, timeout=CLOSE_LIMIT_S)
        except queue.Full:
            return
        self._thread.join(CLOSE_LIMIT_S)

    def _run(self) -> None:
        while (body := self._queue.get()) is not None:
            try:
                self._send(body)
                self.sent += 1
            except (OSError, ValueError, subprocess.SubprocessError, HTTPException) as error:
                self.failed += 1
                self.problem = f"{type(error).__name__}: {error}"

    def _send(self, body: bytes) -> None:
        if not self._url:
            subprocess.run(
                self._command,
                input=body + b"\n",
                timeout=SEND_LIMIT_S,
                check=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            return
        request = urllib.request.Request(self._url, body, {"Content-Type": "application/json"})  # noqa: S310
        with self._opener.open(request, timeout=SEND_LIMIT_S):
            pass
