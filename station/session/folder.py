"""An open folder, and files that appear in it whole or not at all.

The order is always the same: temporary name in the same folder, write until done, fsync, size check,
rename, fsync of the folder. Only then may anyone say "it is there". After a failed fsync the file is void: the
kernel may have dropped its pages, and a second fsync would claim success. The data go to a new name.
"""

import errno
import hashlib
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from station.errors import FrameRejectedError, IntegrityError, SessionError, SessionNotFoundError
from station.session import durable
from station.session.session import Side

PART_PREFIX = ".part-"
READ_BYTES = 1 << 20
FRAME_CAP_BYTES = 256 << 20  # no frame of either camera comes near (a raw file of the Z1: about 45 MB)
SUFFIXES = {"jpeg": ".jpg", "png": ".png", "tiff": ".tif", "cr2": ".cr2", "dng": ".dng"}


class Folder(AbstractContextManager["Folder"]):
    """An open folder. Names in it go with its descriptor, so no link put in its way leads elsewhere."""

    def __init__(self, fd: int, path: Path) -> None:
        self.fd = fd
        self.path = path

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open a folder the user named (links on the way are the user's own); raises `OSError`."""
        return cls(durable.os_calls.open(str(path), os.O_RDONLY | os.O_DIRECTORY), path)

    def sub(self, name: str) -> Self:
        """Open a folder inside; a link in its place is `IntegrityError`."""
        path = self.path / name
        try:
            flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW
            return type(self)(durable.os_calls.open(name, flags, dir_fd=self.fd), path)
        except OSError as exc:
            if exc.errno in (errno.ELOOP, errno.ENOTDIR):
                raise IntegrityError("is not a folder but a link or a file", where=str(path)) from exc
            if exc.errno == errno.ENOENT:
                raise IntegrityError("the folder is missing", where=str(path)) from exc
            raise durable.disk_error(exc, path, "opening") from exc

    def make_sub(self, name: str) -> bool:
        """Create a folder inside unless it is there; the caller syncs. Returns whether it is new."""
        with durable.disk_errors(self.path / name, "creating the folder"), suppress(FileExistsError):
            durable.os_calls.mkdir(name, dir_fd=self.fd)
            return True
        return False

    def names(self) -> list[str]:
        """Return the sorted names in the folder."""
        with durable.disk_errors(self.path, "listing"):
            return sorted(os.listdir(self.fd))

    def lstat(self, name: str) -> os.stat_result | None:
        """Return the status of a name, not following links; None if there is none."""
        with durable.disk_errors(self.path / name, "looking up"), suppress(FileNotFoundError):
            return os.stat(name, dir_fd=self.fd, follow_symlinks=False)
        return None

    def create_file(self, name: str) -> int:
        """Create a new file for writing and return its descriptor."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
        with durable.disk_errors(self.path / name, "creating"):
            return durable.os_calls.open(name, flags, dir_fd=self.fd)

    def open_file(self, name: str, flags: int = os.O_RDONLY) -> int:
        """Open an existing ordinary file; links, pipes and devices are `IntegrityError`.

        Raises `FileNotFoundError` when there is none.
        """
        path = self.path / name
        try:
            # O_NONBLOCK: opening a pipe without a writer would wait for ever.
            fd = durable.os_calls.open(name, flags | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=self.fd)
        except FileNotFoundError:
            raise
        except OSError as exc:
            if exc.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
                raise IntegrityError("is a link, a folder or a device, not a file", where=str(path)) from exc
            raise durable.disk_error(exc, path, "opening") from exc
        if reason := durable.irregular(os.fstat(fd)):
            os.close(fd)
            raise IntegrityError(reason, where=str(path))
        return fd

    @contextmanager
    def opened(self, name: str) -> Iterator[int]:
        """Give the descriptor of an existing ordinary file (see `open_file`), and close it."""
        fd = self.open_file(name)
        try:
            yield fd
        finally:
            os.close(fd)

    def read_file(self, name: str, limit_bytes: int) -> bytes | None:
        """Return the content of an ordinary file, None if there is none.

        Raises `IntegrityError` for more than ``limit_bytes`` and for anything but an ordinary file.
        """
        path, blocks, total = self.path / name, list[bytes](), 0
        try:
            with self.opened(name) as fd, durable.disk_errors(path, "reading"):
                while block := os.read(fd, READ_BYTES):
                    total += len(block)
                    if total > limit_bytes:
                        raise IntegrityError(f"is larger than {limit_bytes} bytes", where=str(path))
                    blocks.append(block)
                return b"".join(blocks)
        except FileNotFoundError:
            return None

    def move(self, name: str, target: Self, new_name: str) -> None:
        """Rename durably, also between folders of one session (both folders are synced)."""
        with durable.disk_errors(self.path / name, "renaming"):
            durable.os_calls.rename(name, new_name, src_dir_fd=self.fd, dst_dir_fd=target.fd)
        target.sync()
        if target.fd != self.fd:
            self.sync()

    def remove(self, name: str) -> None:
        """Remove a leftover; failing to do so is no harm (the next start tries again)."""
        with suppress(OSError):
            durable.os_calls.unlink(name, dir_fd=self.fd)

    def sync(self) -> None:
        """Make the names in the folder durable."""
        with durable.disk_errors(self.path, "syncing the folder"), durable.where_possible():
            durable.os_calls.fsync(self.fd)

    def close(self) -> None:
        """Close the descriptor."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1

    def __exit__(self, *_error: object) -> None:
        self.close()


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def open_session(path: Path) -> Folder:
    """Open a session folder that the user named; `SessionNotFoundError` where that cannot be."""
    try:
        return Folder.open(path)
    except (OSError, ValueError) as exc:
        reason = getattr(exc, "strerror", None) or exc
        raise SessionNotFoundError(f"cannot open: {reason}", where=str(path), advice="name a session folder") from exc


def part_name(name: str) -> str:
    """Return a temporary name for ``name`` that no earlier run can have used."""
    return f"{PART_PREFIX}{secrets.token_hex(4)}-{name}"


def write_file(folder: Folder, name: str, data: bytes) -> None:
    """Put ``data`` under ``name`` durably and at once: whoever looks sees the old content or the new."""
    temporary = part_name(name)
    fd = folder.create_file(temporary)
    try:
        with durable.disk_errors(folder.path / name, "writing"):
            try:
                durable.write_all(fd, data)
                durable.os_calls.fsync(fd)
                durable.check_size(fd, len(data))
            finally:
                os.close(fd)
            durable.os_calls.rename(temporary, name, src_dir_fd=folder.fd, dst_dir_fd=folder.fd)
    except BaseException:
        folder.remove(temporary)
        raise
    folder.sync()


def make_folders(path: Path) -> None:
    """Create a folder and its missing parents durably (each new name is synced in its parent)."""
    for new in reversed([p for p in (path, *path.parents) if not os.path.exists(p)]):  # noqa: PTH110 (Path.exists raises)
        with durable.disk_errors(new, "creating the folder"):
            with suppress(FileExistsError):
                durable.os_calls.mkdir(str(new))
            with Folder.open(new.parent) as parent:
                parent.sync()


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
            text = f"more than {FRAME_CAP_BYTES} bytes in one frame"
            advice = "restart the camera and take the frame again"
            likely = "the camera announces one size and sends another"
            raise FrameRejectedError(text, where=str(self.path), likely=likely, advice=advice)
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
            with suppress(PermissionError), durable.where_possible():  # it is a courtesy, not a promise
                durable.os_calls.fchmod(self._fd, 0o444)
            durable.os_calls.fsync(self._fd)
            durable.check_size(self._fd, self.size_bytes)
        self._close()

    def _need(self, state: str) -> None:
        if self._state != state:
            raise SessionError(f"this frame is {self._state}", where=str(self.path), advice="start the frame again")

    def _close(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
