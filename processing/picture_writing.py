"""Putting a picture file in its place whole or not at all, whatever library writes it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from station import durable
from station.folder import Folder, part_name, write_file


def write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Let ``write`` fill a file of a temporary name in the same folder, then make it durable under its own name.

    Raises `DiskFullError` or `DiskError` (also for the `RuntimeError` by which libraries report a failed write).
    Whoever looks at ``path`` sees the old content or the new.
    """
    with durable.disk_errors(path, "writing"):
        folder = Folder.open(path.parent)
    temporary = part_name(path.name)
    try:
        with durable.disk_errors(path, "writing"):
            try:
                write(path.with_name(temporary))
            except RuntimeError as error:
                raise OSError(5, str(error)) from error
            fd = durable.os_calls.open(temporary, os.O_RDONLY, dir_fd=folder.fd)
            try:
                durable.os_calls.fsync(fd)
            finally:
                os.close(fd)
            durable.os_calls.rename(temporary, path.name, src_dir_fd=folder.fd, dst_dir_fd=folder.fd)
        folder.sync()
    except BaseException:
        folder.remove(temporary)
        raise
    finally:
        folder.close()


def write_bytes(path: Path, data: bytes) -> None:
    """Write a small file in the same way."""
    with durable.disk_errors(path, "writing"):
        folder = Folder.open(path.parent)
    try:
        write_file(folder, path.name, data)
    finally:
        folder.close()
