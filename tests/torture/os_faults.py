"""Stand-ins for `station.session.durable.os_calls` that die, fail or cut short at the Nth call."""

from __future__ import annotations

import errno
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from station.session import durable

CALLS = ("open", "write", "fsync", "fdatasync", "fchmod", "rename", "unlink", "mkdir", "rmdir")
CREATES_OR_CHANGES = {"open", "write", "fchmod", "rename", "unlink", "mkdir", "rmdir"}
APPLIES = {
    "ENOSPC": {"open", "write", "fsync", "fdatasync", "rename", "mkdir"},
    "EDQUOT": {"open", "write", "fsync", "fdatasync", "rename", "mkdir"},
    "EIO": set(CALLS),
    "EROFS": CREATES_OR_CHANGES,
    "EMFILE": {"open"},
    "EACCES": {"open", "rename", "unlink", "mkdir", "fchmod"},
    "SHORT": {"write"},
    "HALF_THEN_ENOSPC": {"write"},
}
"""Which calls an error can come from; SHORT is a short write without error, the last one with an error after it."""

Call = Callable[[], Any]


class Counting(durable.OsCalls):
    """Counts the calls; what happens at each is `at`'s business."""

    def __init__(self) -> None:
        self.n = 0
        self.names: list[str] = []

    def at(self, name: str, call: Call, data: bytes | memoryview = b"", fd: int = -1) -> Any:
        self.names.append(name)
        self.n += 1
        return call()

    def open(self, name: str, flags: int, mode: int = 0o644, *, dir_fd: int | None = None) -> int:
        return self.at("open", lambda: durable.OsCalls.open(self, name, flags, mode, dir_fd=dir_fd))

    def write(self, fd: int, data: bytes | memoryview) -> int:
        return self.at("write", lambda: os.write(fd, data), data, fd)

    def fsync(self, fd: int) -> None:
        self.at("fsync", lambda: os.fsync(fd))

    def fdatasync(self, fd: int) -> None:
        self.at("fdatasync", lambda: durable.OsCalls.fdatasync(fd))

    def fchmod(self, fd: int, mode: int) -> None:
        self.at("fchmod", lambda: os.fchmod(fd, mode))

    def rename(self, source: str, target: str, *, src_dir_fd: int, dst_dir_fd: int) -> None:
        self.at("rename", lambda: os.rename(source, target, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd))

    def unlink(self, name: str, *, dir_fd: int) -> None:
        self.at("unlink", lambda: os.unlink(name, dir_fd=dir_fd))

    def mkdir(self, name: str, *, dir_fd: int | None = None) -> None:
        self.at("mkdir", lambda: os.mkdir(name, dir_fd=dir_fd))

    def rmdir(self, name: str, *, dir_fd: int) -> None:
        self.at("rmdir", lambda: os.rmdir(name, dir_fd=dir_fd))


class KillAt(Counting):
    """Kills the own process before, in the middle of, or after the Nth call.

    In the middle of a write: half the bytes are out ("torn") or all but one ("nearly").
    """

    def __init__(self, nth: int, moment: str) -> None:
        super().__init__()
        self.nth = nth
        self.moment = moment

    def at(self, name: str, call: Call, data: bytes | memoryview = b"", fd: int = -1) -> Any:
        if self.n + 1 != self.nth:
            return super().at(name, call)
        if self.moment in ("torn", "nearly") and name == "write":
            os.write(fd, memoryview(data)[: len(data) // 2 if self.moment == "torn" else -1])
        if self.moment == "after":
            call()
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError("unreachable")


class FaultAt(Counting):
    """Fails the Nth call that ``kind`` applies to; a lasting fault stays for all later calls of its kinds."""

    def __init__(self, nth: int, kind: str, *, lasting: bool = False) -> None:
        super().__init__()
        self.nth = nth
        self.kind = kind
        self.lasting = lasting
        self.fired = ""

    def at(self, name: str, call: Call, data: bytes | memoryview = b"", fd: int = -1) -> Any:
        if name not in APPLIES[self.kind]:
            return call()
        self.n += 1
        if self.n < self.nth or (self.n > self.nth and not self.lasting):
            return call()
        self.fired = self.fired or name
        if self.kind == "SHORT":
            return os.write(fd, memoryview(data)[: max(1, len(data) // 2)])
        if self.kind == "HALF_THEN_ENOSPC":
            os.write(fd, memoryview(data)[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        number = getattr(errno, self.kind)
        raise OSError(number, os.strerror(number))


@contextmanager
def installed(calls: durable.OsCalls) -> Iterator[None]:
    """Put ``calls`` in the place of the system calls for a while."""
    before = durable.os_calls
    durable.os_calls = calls
    try:
        yield
    finally:
        durable.os_calls = before
