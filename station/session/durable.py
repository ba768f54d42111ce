"""Writing that survives a crash: every system call that changes a session goes through here; and one writer at a time.

Tests put another object in the place of `os_calls`, which fails, dies or keeps a log at the Nth call.
"""

from __future__ import annotations

import ctypes
import errno
import gzip
import json
import os
import socket
import stat
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, cast

from filelock import FileLock, Timeout

from station.errors import DiskError, DiskFullError, IntegrityError, ResourceError, SessionLockedError, UsageError

if TYPE_CHECKING:
    from station.session.folder import Folder

IS_FOLDER = "is a folder"
_RENAME_EXCHANGE = 2  # of Linux's renameat2(2)
FULL = {errno.ENOSPC, errno.EDQUOT}
WRITE_FAULTS = {*FULL, errno.EFBIG, errno.EIO}  # of writes whose `OSError` names no file, as Python's own
_EXHAUSTED = {errno.EMFILE, errno.ENFILE, errno.ENOMEM}
_UNSUPPORTED = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP}


class OsCalls:
    """The system calls themselves; tests put an object in its place that fails, dies or keeps a log.

    As ``os`` has them: `write` may write less than asked, `rename` replaces its target.
    """

    write = staticmethod(os.write)
    fsync = staticmethod(os.fsync)
    fdatasync = staticmethod(getattr(os, "fdatasync", os.fsync))  # where the system lacks it, the other
    fchmod = staticmethod(os.fchmod)
    rename = staticmethod(os.rename)
    unlink = staticmethod(os.unlink)
    mkdir = staticmethod(os.mkdir)
    rmdir = staticmethod(os.rmdir)

    def open(self, name: str, flags: int, mode: int = 0o644, *, dir_fd: int | None = None) -> int:
        """``os.open``, never inherited by child processes."""
        return os.open(name, flags | os.O_CLOEXEC, mode, dir_fd=dir_fd)

    def exchange(self, source: str, target: str, *, dir_fd: int) -> bool:
        """Swap two names of one folder in one step (also full folders); False where the system cannot."""
        call = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
        if call is None:
            return False
        if call(dir_fd, os.fsencode(source), dir_fd, os.fsencode(target), ctypes.c_uint(_RENAME_EXCHANGE)) == 0:
            return True
        number = ctypes.get_errno()
        if number in _UNSUPPORTED:
            return False
        raise OSError(number, os.strerror(number), target)


os_calls = OsCalls()


def disk_error(exc: OSError, path: Path, doing: str) -> ResourceError:
    """Return the typed error of ``exc`` while ``doing`` something with ``path``."""
    kind: type[ResourceError] = DiskError
    likely, advice = ("the disk is failing, read-only or unplugged", "check the disk and its cable, then resume")
    if exc.errno in FULL:
        kind = DiskFullError
        likely, advice = "no space or quota left", "free space on this disk, then resume"
    elif exc.errno in _EXHAUSTED:
        kind = ResourceError
        likely, advice = "the computer is out of file handles or memory", "close other programs, then resume"
    elif exc.errno in (errno.EACCES, errno.EPERM):
        likely, advice = "no permission to write here", "choose a folder you can write to"
    elif exc.errno in (errno.ENOENT, errno.ENOTDIR):
        likely, advice = "its folder does not exist", "create the folder, or check that its disk is mounted"
    elif exc.errno in (errno.ENAMETOOLONG, errno.ELOOP, errno.EISDIR, errno.EEXIST):
        likely, advice = "the name is too long, leads in a circle, or is taken", "choose another name or folder"
    elif exc.errno == errno.EFBIG:
        likely, advice = ("a limit on the size of files", "lift the limit (ulimit -f) or use another file system")
    reason = exc.strerror or str(exc)
    name = errno.errorcode.get(exc.errno or 0, "")
    return kind(f"{doing} failed: {reason}", where=str(path), likely=likely, advice=advice, errno=name)


@contextmanager
def disk_errors(path: Path, doing: str) -> Iterator[None]:
    """Turn `OSError` into `DiskFullError`, `DiskError` or `ResourceError` naming ``path``."""
    try:
        yield
    except OSError as exc:
        raise disk_error(exc, path, doing) from exc


@contextmanager
def where_possible() -> Iterator[None]:
    """Let pass that a file system has no such thing: shared folders and network disks may sync no folder."""
    try:
        yield
    except OSError as exc:
        if exc.errno not in _UNSUPPORTED:
            raise


def irregular(info: os.stat_result | None) -> str | None:
    """Say why a file is not an ordinary file of this session alone, or None if it is, or there is none."""
    if info is None:
        return None
    if stat.S_ISLNK(info.st_mode):
        return "is a symbolic link"
    if stat.S_ISDIR(info.st_mode):
        return IS_FOLDER
    if not stat.S_ISREG(info.st_mode):
        return "is not a regular file"
    return "is a hard link (it has a second name elsewhere)" if info.st_nlink > 1 else None


def write_all(fd: int, data: bytes | memoryview) -> None:
    """Write all of ``data``: a short write is not an error, so it is continued; no progress is `OSError`."""
    rest = memoryview(data)
    while rest:
        written = os_calls.write(fd, rest)
        if written <= 0:
            raise OSError(errno.EIO, "no progress")
        rest = rest[written:]


def new_file(path: Path) -> IO[str]:
    """Open a new text file (``.gz``: compressed); `UsageError`: it is there; `ResourceError`: it cannot be made."""
    with disk_errors(path, "creating"):
        try:
            return cast("IO[str]", (gzip.open if path.suffix == ".gz" else open)(path, "xt", encoding="utf-8"))
        except FileExistsError as exc:
            raise UsageError("is already there", where=str(path), advice="choose another name") from exc


def check_size(fd: int, size_bytes: int) -> None:
    """Raise `OSError` if the open file has not exactly ``size_bytes``."""
    found = os.fstat(fd).st_size
    if found != size_bytes:
        raise OSError(errno.EIO, f"{found} of {size_bytes} bytes are on disk")


# One writer for one session: an flock in its folder, which the system drops however the process ends.

LOCK_NAME = ".lock"
_INFO_BYTES = 200  # fixed, so that one write replaces it whole


def _holder(folder: Folder, name: str) -> str:
    """Return who holds the lock, as its file says; only digits and a host name's characters are repeated."""
    with suppress(OSError, ValueError, IntegrityError, AttributeError):
        info = json.loads(folder.read_file(name, 4 * _INFO_BYTES) or b"")
        host = "".join(c for c in str(info["host"])[:64] if c.isascii() and (c.isalnum() or c in ".-_"))
        return f"process {int(info['pid'])} on {host}"
    return "another process"


class SessionLock(AbstractContextManager["SessionLock"]):
    """The held lock of a session folder."""

    def __init__(self, folder: Folder, name: str = LOCK_NAME, *, wait_s: float = 0.0) -> None:
        """Take the lock, after ``wait_s`` at most, or raise `SessionLockedError` naming the holder."""
        if reason := irregular(folder.lstat(name)):
            raise IntegrityError(reason, where=str(folder.path / name), advice="remove it")
        # A soft lock (on file systems without flock) would outlive a crash; better to refuse.
        self._lock = FileLock(str(folder.path / name), thread_local=False, fallback_to_soft=False)
        try:
            self._lock.acquire(timeout=wait_s, poll_interval=0.01)
        except Timeout as exc:
            text = f"{_holder(folder, name)} is working on this session"
            raise SessionLockedError(text, where=str(folder.path), advice="wait until it finishes, or stop it") from exc
        except OSError as exc:
            raise disk_error(exc, folder.path / name, "locking") from exc
        self._sign(folder, name)

    def _sign(self, folder: Folder, name: str) -> None:
        """Write who we are, for the message of whoever comes second; the lock holds without it."""
        info = json.dumps({"pid": os.getpid(), "host": socket.gethostname()[:64]})
        with suppress(OSError):
            fd = os_calls.open(name, os.O_WRONLY | os.O_NOFOLLOW, dir_fd=folder.fd)
            try:
                write_all(fd, info.ljust(_INFO_BYTES).encode()[:_INFO_BYTES])
            finally:
                os.close(fd)

    def __exit__(self, *_error: object) -> None:
        self.release()

    def release(self) -> None:
        """Give the lock back; the file stays (removing it would let two processes hold two locks)."""
        self._lock.release()
