"""Writing that survives a crash: every system call that changes a session goes through here.

The order is always the same: temporary name in the same folder, write until done, fsync, size check, rename,
fsync of the folder. Only then may anyone say "it is there". After a failed fsync a file never counts: the
kernel may have dropped the pages, and a second fsync would claim success. The data are written anew elsewhere.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from station.errors import DiskError, DiskFullError, IntegrityError, ResourceError

PART_PREFIX = ".part-"
READ_BYTES = 1 << 20
_FULL = {errno.ENOSPC, errno.EDQUOT}
_EXHAUSTED = {errno.EMFILE, errno.ENFILE, errno.ENOMEM}


class OsCalls:
    """The system calls themselves; tests put an object in its place that fails, dies or keeps a log."""

    def open(self, name: str, flags: int, mode: int = 0o644, *, dir_fd: int | None = None) -> int:
        """``os.open``, never inherited by child processes."""
        return os.open(name, flags | os.O_CLOEXEC, mode, dir_fd=dir_fd)

    def write(self, fd: int, data: bytes | memoryview) -> int:
        """``os.write``: may write less than asked."""
        return os.write(fd, data)

    def fsync(self, fd: int) -> None:
        """``os.fsync``."""
        os.fsync(fd)

    def fdatasync(self, fd: int) -> None:
        """``os.fdatasync``, or ``os.fsync`` where the system lacks it."""
        getattr(os, "fdatasync", os.fsync)(fd)

    def fchmod(self, fd: int, mode: int) -> None:
        """``os.fchmod``."""
        os.fchmod(fd, mode)

    def rename(self, source: str, target: str, *, src_dir_fd: int, dst_dir_fd: int) -> None:
        """``os.rename``; replaces ``target``."""
        os.rename(source, target, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)

    def unlink(self, name: str, *, dir_fd: int) -> None:
        """``os.unlink``."""
        os.unlink(name, dir_fd=dir_fd)

    def mkdir(self, name: str, *, dir_fd: int | None = None) -> None:
        """``os.mkdir``."""
        os.mkdir(name, dir_fd=dir_fd)

    def rmdir(self, name: str, *, dir_fd: int) -> None:
        """``os.rmdir``."""
        os.rmdir(name, dir_fd=dir_fd)


os_calls = OsCalls()


def disk_error(exc: OSError, path: Path, doing: str) -> ResourceError:
    """Return the typed error of ``exc`` while ``doing`` something with ``path``."""
    kind: type[ResourceError] = DiskError
    likely, advice = (
        "the disk is failing, read-only or unplugged",
        "check the disk and its cable, then resume",
    )
    if exc.errno in _FULL:
        kind = DiskFullError
        likely, advice = "no space or quota left", "free space on this disk, then resume"
    elif exc.errno in _EXHAUSTED:
        kind = ResourceError
        likely, advice = "the computer is out of file handles or memory", "close other programs, then resume"
    elif exc.errno in (errno.EACCES, errno.EPERM):
        likely, advice = "no permission to write here", "choose a folder you may write to"
    elif exc.errno == errno.EFBIG:
        likely, advice = (
            "a limit on the size of files",
            "lift the limit (ulimit -f) or use another file system",
        )
    reason = os.strerror(exc.errno) if exc.errno else str(exc)
    name = errno.errorcode.get(exc.errno or 0, "")
    return kind(f"{doing} failed: {reason}", where=str(path), likely=likely, advice=advice, errno=name)


@contextmanager
def disk_errors(path: Path, doing: str) -> Iterator[None]:
    """Turn `OSError` into `DiskFullError`, `DiskError` or `ResourceError` naming ``path``."""
    try:
        yield
    except OSError as exc:
        raise disk_error(exc, path, doing) from exc


def irregular(info: os.stat_result) -> str | None:
    """Say why a file is not an ordinary file of this session alone, or None if it is."""
    if stat.S_ISLNK(info.st_mode):
        return "is a symbolic link"
    if stat.S_ISDIR(info.st_mode):
        return "is a folder"
    if not stat.S_ISREG(info.st_mode):
        return "is not a regular file"
    if info.st_nlink > 1:
        return "is a hard link (it has a second name elsewhere)"
    return None


def write_all(fd: int, data: bytes | memoryview) -> None:
    """Write all of ``data``: a short write is not an error, so it is continued; no progress is `OSError`."""
    rest = memoryview(data)
    while rest:
        written = os_calls.write(fd, rest)
        if written <= 0:
            raise OSError(errno.EIO, "no progress")
        rest = rest[written:]


def check_size(fd: int, size_bytes: int) -> None:
    """Raise `OSError` if the open file has not exactly ``size_bytes``."""
    found = os.fstat(fd).st_size
    if found != size_bytes:
        raise OSError(errno.EIO, f"{found} of {size_bytes} bytes are on disk")


class Folder:
    """An open folder. Names in it go with its descriptor, so no link put in its way leads elsewhere."""

    def __init__(self, fd: int, path: Path) -> None:
        self.fd = fd
        self.path = path

    @classmethod
    def open(cls, path: Path) -> Folder:
        """Open a folder the user named (links on the way are the user's own); raises `OSError`."""
        return cls(os_calls.open(str(path), os.O_RDONLY | os.O_DIRECTORY), path)

    def sub(self, name: str) -> Folder:
        """Open a folder inside; a link in its place is `IntegrityError`."""
        path = self.path / name
        try:
            flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW
            return Folder(os_calls.open(name, flags, dir_fd=self.fd), path)
        except OSError as exc:
            if exc.errno in (errno.ELOOP, errno.ENOTDIR):
                raise IntegrityError("is not a folder but a link or a file", where=str(path)) from exc
            if exc.errno == errno.ENOENT:
                raise IntegrityError("the folder is missing", where=str(path)) from exc
            raise disk_error(exc, path, "opening") from exc

    def make_sub(self, name: str) -> bool:
        """Create a folder inside unless it is there; the caller syncs. Returns whether it is new."""
        try:
            os_calls.mkdir(name, dir_fd=self.fd)
        except FileExistsError:
            return False
        except OSError as exc:
            raise disk_error(exc, self.path / name, "creating the folder") from exc
        return True

    def names(self) -> list[str]:
        """Return the sorted names in the folder."""
        with disk_errors(self.path, "listing"):
            return sorted(os.listdir(self.fd))

    def lstat(self, name: str) -> os.stat_result | None:
        """Return the status of a name, not following links; None if there is none."""
        try:
            return os.stat(name, dir_fd=self.fd, follow_symlinks=False)
        except FileNotFoundError:
            return None
        except OSError as exc:
            raise disk_error(exc, self.path / name, "looking up") from exc

    def create_file(self, name: str) -> int:
        """Create a new file for writing and return its descriptor."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
        with disk_errors(self.path / name, "creating"):
            return os_calls.open(name, flags, dir_fd=self.fd)

    def open_file(self, name: str, flags: int = os.O_RDONLY) -> int:
        """Open an existing ordinary file; links, pipes and devices are `IntegrityError`.

        Raises `FileNotFoundError` when there is none.
        """
        path = self.path / name
        try:
            # O_NONBLOCK: opening a pipe without a writer would wait for ever.
            fd = os_calls.open(name, flags | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=self.fd)
        except FileNotFoundError:
            raise
        except OSError as exc:
            if exc.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
                raise IntegrityError("is a link, a folder or a device, not a file", where=str(path)) from exc
            raise disk_error(exc, path, "opening") from exc
        reason = irregular(os.fstat(fd))
        if reason:
            os.close(fd)
            raise IntegrityError(reason, where=str(path))
        return fd

    def read_file(self, name: str, limit_bytes: int) -> bytes | None:
        """Return the content of an ordinary file, None if there is none.

        Raises `IntegrityError` for more than ``limit_bytes`` and for anything but an ordinary file.
        """
        try:
            fd = self.open_file(name)
        except FileNotFoundError:
            return None
        path = self.path / name
        try:
            with disk_errors(path, "reading"):
                blocks, total = [], 0
                while block := os.read(fd, READ_BYTES):
                    total += len(block)
                    if total > limit_bytes:
                        raise IntegrityError(f"is larger than {limit_bytes} bytes", where=str(path))
                    blocks.append(block)
                return b"".join(blocks)
        finally:
            os.close(fd)

    def move(self, name: str, target: Folder, new_name: str) -> None:
        """Rename durably, also between folders of one session (both folders are synced)."""
        with disk_errors(self.path / name, "renaming"):
            os_calls.rename(name, new_name, src_dir_fd=self.fd, dst_dir_fd=target.fd)
        target.sync()
        if target.fd != self.fd:
            self.sync()

    def remove(self, name: str) -> None:
        """Remove a leftover; failing to do so is no harm (the next start tries again)."""
        with suppress(OSError):
            os_calls.unlink(name, dir_fd=self.fd)

    def sync(self) -> None:
        """Make the names in the folder durable."""
        with disk_errors(self.path, "syncing the folder"):
            os_calls.fsync(self.fd)

    def close(self) -> None:
        """Close the descriptor."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1


def part_name(name: str) -> str:
    """Return a temporary name for ``name`` that no earlier run can have used."""
    return f"{PART_PREFIX}{secrets.token_hex(4)}-{name}"


def write_file(folder: Folder, name: str, data: bytes) -> None:
    """Put ``data`` under ``name`` durably and at once: whoever looks sees the old content or the new."""
    temporary = part_name(name)
    fd = folder.create_file(temporary)
    try:
        with disk_errors(folder.path / name, "writing"):
            try:
                write_all(fd, data)
                os_calls.fsync(fd)
                check_size(fd, len(data))
            finally:
                os.close(fd)
            os_calls.rename(temporary, name, src_dir_fd=folder.fd, dst_dir_fd=folder.fd)
    except BaseException:
        folder.remove(temporary)
        raise
    folder.sync()


def make_folders(path: Path) -> None:
    """Create a folder and its missing parents durably (each new name is synced in its parent)."""
    missing = [p for p in (path, *path.parents) if not p.exists()]
    for new in reversed(missing):
        with disk_errors(new, "creating the folder"):
            with suppress(FileExistsError):
                os_calls.mkdir(str(new))
            parent = Folder.open(new.parent)
            try:
                os_calls.fsync(parent.fd)
            finally:
                parent.close()
