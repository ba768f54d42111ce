"""An open folder, and files that appear in it whole or not at all.

The order is always the same: temporary name in the same folder, write until done, fsync, size check,
rename, fsync of the folder. Only then may anyone say "it is there". After a failed fsync the file is void: the
kernel may have dropped its pages, and a second fsync would claim success. The data go to a new name.
"""

from __future__ import annotations

import errno
import os
import secrets
from contextlib import suppress
from pathlib import Path

from station.errors import IntegrityError
from station.session import durable

PART_PREFIX = ".part-"
READ_BYTES = 1 << 20


class Folder:
    """An open folder. Names in it go with its descriptor, so no link put in its way leads elsewhere."""

    def __init__(self, fd: int, path: Path) -> None:
        self.fd = fd
        self.path = path

    @classmethod
    def open(cls, path: Path) -> Folder:
        """Open a folder the user named (links on the way are the user's own); raises `OSError`."""
        return cls(durable.os_calls.open(str(path), os.O_RDONLY | os.O_DIRECTORY), path)

    def sub(self, name: str) -> Folder:
        """Open a folder inside; a link in its place is `IntegrityError`."""
        path = self.path / name
        try:
            flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW
            return Folder(durable.os_calls.open(name, flags, dir_fd=self.fd), path)
        except OSError as exc:
            if exc.errno in (errno.ELOOP, errno.ENOTDIR):
                raise IntegrityError("is not a folder but a link or a file", where=str(path)) from exc
            if exc.errno == errno.ENOENT:
                raise IntegrityError("the folder is missing", where=str(path)) from exc
            raise durable.disk_error(exc, path, "opening") from exc

    def make_sub(self, name: str) -> bool:
        """Create a folder inside unless it is there; the caller syncs. Returns whether it is new."""
        try:
            durable.os_calls.mkdir(name, dir_fd=self.fd)
        except FileExistsError:
            return False
        except OSError as exc:
            raise durable.disk_error(exc, self.path / name, "creating the folder") from exc
        return True

    def names(self) -> list[str]:
        """Return the sorted names in the folder."""
        with durable.disk_errors(self.path, "listing"):
            return sorted(os.listdir(self.fd))

    def lstat(self, name: str) -> os.stat_result | None:
        """Return the status of a name, not following links; None if there is none."""
        try:
            return os.stat(name, dir_fd=self.fd, follow_symlinks=False)
        except FileNotFoundError:
            return None
        except OSError as exc:
            raise durable.disk_error(exc, self.path / name, "looking up") from exc

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
        reason = durable.irregular(os.fstat(fd))
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
            with durable.disk_errors(path, "reading"):
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
        with durable.disk_errors(self.path, "syncing the folder"):
            durable.os_calls.fsync(self.fd)

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
    missing = [p for p in (path, *path.parents) if not p.exists()]
    for new in reversed(missing):
        with durable.disk_errors(new, "creating the folder"):
            with suppress(FileExistsError):
                durable.os_calls.mkdir(str(new))
            parent = Folder.open(new.parent)
            try:
                durable.os_calls.fsync(parent.fd)
            finally:
                parent.close()
