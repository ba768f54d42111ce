"""A frame on its way to disk: streamed to a temporary name, digested as it comes, renamed when whole."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from station.errors import FrameRejectedError, SessionError
from station.session import durable
from station.session.folder import Folder, part_name
from station.session.session import Side

FRAME_CAP_BYTES = 256 << 20
"""No frame of either camera comes near (a raw file of the Z1: about 45 MB)."""
SUFFIXES = {"jpeg": ".jpg", "cr2": ".cr2", "dng": ".dng"}


@dataclass(frozen=True)
class StoredFrame:
    """A frame that is durable under its name; `SessionStore.add_frame` makes it count."""

    file: str
    """Path inside the session, e.g. ``indoor/04_1-60s.jpg``."""
    size_bytes: int
    sha256: str


def frame_name(stop: int, asked_s: float, format_: str) -> str:
    """Return the file name of a frame, e.g. ``04_1-60s.jpg``: stop index, asked time, our suffix."""
    whole = round(1 / asked_s)
    reciprocal = asked_s < 1 and abs(1 / asked_s - whole) < 1e-3 * whole
    label = f"1-{whole}s" if reciprocal else f"{asked_s:g}s"
    return f"{stop:02d}_{label}{SUFFIXES[format_]}"


def free_name(folder: Folder, name: str) -> str:
    """Return ``name``, or with -2, -3, ... before its suffix if it is taken: nothing is ever overwritten."""
    stem, dot, suffix = name.rpartition(".")
    candidate, number = name, 1
    while folder.lstat(candidate) is not None:
        number += 1
        candidate = f"{stem}-{number}{dot}{suffix}"
    return candidate


class FramePart:
    """A frame under way. One thread uses it; ``path`` is where its bytes are (for checks before `commit`)."""

    def __init__(
        self,
        folder: Folder,
        side: Side,
        name: str,
        move: Callable[[str, str], str],
        set_aside: Callable[[str, str, str], str],
    ) -> None:
        """Open a new temporary file; the store gives ``move`` and ``set_aside``, which need its lock."""
        self._folder = folder
        self._side = side
        self._name = name
        self._move = move
        self._set_aside = set_aside
        self._temporary = part_name(name)
        self._digest = hashlib.sha256()
        self._fd = folder.create_file(self._temporary)
        self._state = "open"
        self.size_bytes = 0
        """Bytes written so far."""

    @property
    def path(self) -> Path:
        """The temporary file."""
        return self._folder.path / self._temporary

    def write(self, chunk: bytes) -> None:
        """Append bytes as the camera gave them.

        Raises `DiskFullError` or `DiskError` (the part is then of no use: `abort` it and begin anew) and
        `FrameRejectedError` beyond `FRAME_CAP_BYTES`.
        """
        self._need("open")
        if self.size_bytes + len(chunk) > FRAME_CAP_BYTES:
            raise FrameRejectedError(
                f"more than {FRAME_CAP_BYTES} bytes in one frame",
                where=str(self.path),
                likely="the camera announces one size and sends another",
                advice="restart the camera and take the frame again",
            )
        try:
            with durable.disk_errors(self.path, "writing"):
                durable.write_all(self._fd, chunk)
        except BaseException:
            self._state = "failed"
            raise
        self._digest.update(chunk)
        self.size_bytes += len(chunk)

    def commit(self) -> StoredFrame:
        """Make the frame durable under its final, read-only name; the caller then journals it (`add_frame`).

        Any error leaves a frame that does not count; `abort` and begin anew.
        """
        self._seal()
        file = self._move(self._temporary, self._name)
        self._state = "done"
        return StoredFrame(f"{self._side}/{file}", self.size_bytes, self._digest.hexdigest())

    def reject(self, reason: str) -> str:
        """Keep the frame aside, durable but not counted; returns its path ``rejected/...`` for the record."""
        self._seal()
        file = self._set_aside(self._temporary, f"{self._side}_{self._name}", reason)
        self._state = "done"
        return file

    def abort(self) -> None:
        """Drop the frame; its temporary file goes. Does nothing after `commit` or `reject`; never raises."""
        if self._state in ("done", "aborted"):
            return
        self._close()
        self._folder.remove(self._temporary)
        self._state = "aborted"

    def _seal(self) -> None:
        """Sync, check and close. Read-only from here on: raw frames are never modified, by nobody."""
        self._need("open")
        self._state = "failed"
        with durable.disk_errors(self.path, "syncing"):
            with suppress(PermissionError):  # some file systems have no modes; it is a courtesy, not a promise
                durable.os_calls.fchmod(self._fd, 0o444)
            durable.os_calls.fsync(self._fd)
            durable.check_size(self._fd, self.size_bytes)
        self._close()

    def _need(self, state: str) -> None:
        if self._state != state:
            raise SessionError(f"this frame is {self._state}", where=str(self.path), advice="begin the frame anew")

    def _close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
