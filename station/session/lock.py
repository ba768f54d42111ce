"""One writer for one session: an flock in its folder, which the system drops however the process ends."""

from __future__ import annotations

import json
import os
import socket
from contextlib import suppress

from filelock import FileLock, Timeout

from station.errors import IntegrityError, SessionLockedError
from station.session import durable
from station.session.folder import Folder

LOCK_NAME = ".lock"
_INFO_BYTES = 200


def _holder(folder: Folder) -> str:
    """Return who holds the lock, as its file says; only digits and a host name's characters are repeated."""
    with suppress(OSError, ValueError, IntegrityError, AttributeError):
        raw = folder.read_file(LOCK_NAME, 4 * _INFO_BYTES) or b""
        info = json.loads(raw)
        host = "".join(c for c in str(info["host"])[:64] if c.isascii() and (c.isalnum() or c in ".-_"))
        return f"process {int(info['pid'])} on {host}"
    return "another process"


class SessionLock:
    """The held lock of a session folder."""

    def __init__(self, folder: Folder) -> None:
        """Take the lock at once or raise `SessionLockedError` naming the holder."""
        info = folder.lstat(LOCK_NAME)
        reason = durable.irregular(info) if info else None
        if reason:
            raise IntegrityError(reason, where=str(folder.path / LOCK_NAME), advice="remove it")
        # A soft lock (on file systems without flock) would outlive a crash; better to refuse.
        self._lock = FileLock(str(folder.path / LOCK_NAME), thread_local=False, fallback_to_soft=False)
        try:
            self._lock.acquire(blocking=False)
        except Timeout as exc:
            raise SessionLockedError(
                f"{_holder(folder)} works on this session",
                where=str(folder.path),
                advice="wait until it is done, or end it",
            ) from exc
        except OSError as exc:
            raise durable.disk_error(exc, folder.path / LOCK_NAME, "locking") from exc
        self._sign(folder)

    def _sign(self, folder: Folder) -> None:
        """Write who we are, for the message of whoever comes second; the lock holds without it."""
        info = json.dumps({"pid": os.getpid(), "host": socket.gethostname()[:64]})
        with suppress(OSError):
            fd = durable.os_calls.open(LOCK_NAME, os.O_WRONLY | os.O_NOFOLLOW, dir_fd=folder.fd)
            try:
                durable.write_all(fd, info.ljust(_INFO_BYTES).encode()[:_INFO_BYTES])
            finally:
                os.close(fd)

    def release(self) -> None:
        """Give the lock back; the file stays (removing it would let two processes hold two locks)."""
        self._lock.release()
