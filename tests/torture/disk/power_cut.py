"""What a disk may hold after a power cut: a log of file operations, and the images that it allows.

The model follows the crash states of ALICE (Pillai et al., OSDI 2014). A file's bytes are certain only up to its
last fsync; later ones may be there, missing, cut anywhere, or zeros. A name (create, rename, unlink, mkdir) is certain
only after an fsync of its folder; later ones may each be there or not. A rename is atomic. Nothing else is promised:
in particular, fsync of a file does not make its name durable.
"""

from __future__ import annotations

import errno
import os
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from station.session import durable
from tests.torture.os_faults import Counting

SECTOR_BYTES = 512
NAMES = {"mkdir", "create", "rename", "unlink", "rmdir"}


@dataclass(frozen=True)
class Op:
    """One entry of the log: kind, the path and file number it is about, data, and the new path of a rename."""

    kind: str
    path: str
    inode: int = 0
    data: bytes = b""
    target: str = ""
    ack: dict[str, Any] = field(default_factory=dict)

    @property
    def folders(self) -> set[str]:
        """The folders whose fsync makes the name change certain."""
        return {os.path.dirname(path) for path in (self.path, self.target) if path}


class Recorder(Counting):
    """Carries the calls out and writes down, with paths below ``top``, what they did."""

    def __init__(self, top: Path, *, failing: int = 0) -> None:
        """``failing``: the number of a write or sync that fails (a write after half its bytes); 0: none."""
        super().__init__()
        self.failing = failing
        self.failed = ""
        self._may_fail = 0
        self.top = str(top)
        self.log: list[Op] = []
        self._paths: dict[int, str] = {}
        self._files: dict[str, int] = {}
        self._inodes = 0
        self._open_files: dict[int, int] = {}
        self._load(top)

    def _load(self, top: Path) -> None:
        """Take what is there at the start as certain."""
        for path in sorted(top.rglob("*")):
            name = self._relative(str(path))
            if path.is_dir():
                self.log.append(Op("mkdir", name))
            elif path.name != ".lock":
                inode = self._new_file(name)
                self.log += [Op("create", name, inode), Op("write", name, inode, path.read_bytes())]
                self.log.append(Op("fsync", name, inode))
        for path in (top, *top.rglob("*")):
            if path.is_dir():
                self.log.append(Op("sync", self._relative(str(path))))

    def _relative(self, path: str) -> str:
        return os.path.relpath(path, self.top) if path != self.top else ""

    def _path(self, name: str, dir_fd: int | None) -> str:
        return self._relative(name) if dir_fd is None else os.path.join(self._paths[dir_fd], name)

    def _new_file(self, path: str) -> int:
        self._inodes += 1
        self._files[path] = self._inodes
        return self._inodes

    def acknowledge(self, ack: dict[str, Any]) -> None:
        self.log.append(Op("ack", "", ack=ack))

    def open(self, name: str, flags: int, mode: int = 0o644, *, dir_fd: int | None = None) -> int:
        fd = durable.OsCalls.open(self, name, flags, mode, dir_fd=dir_fd)
        path = self._path(name, dir_fd)
        self._paths[fd] = path
        self._open_files.pop(fd, None)
        if flags & os.O_CREAT:
            self.log.append(Op("create", path, self._new_file(path)))
        if not flags & os.O_DIRECTORY and path in self._files:
            self._open_files[fd] = self._files[path]
        return fd

    def _fails(self, name: str) -> bool:
        self._may_fail += 1
        if self._may_fail == self.failing:
            self.failed = name
        return self._may_fail == self.failing

    def write(self, fd: int, data: bytes | memoryview) -> int:
        fails = self._fails("write")
        data = memoryview(data)[: len(data) // 2] if fails else data
        if fd in self._open_files:
            self.log.append(Op("write", self._paths[fd], self._open_files[fd], bytes(data)))
        written = os.write(fd, data)
        if fails:
            raise OSError(errno.ENOSPC, "No space left on device")
        return written

    def fsync(self, fd: int) -> None:
        if self._fails("fsync"):
            if fd in self._open_files:
                self.log.append(Op("failed fsync", self._paths[fd], self._open_files[fd]))
            raise OSError(errno.EIO, "Input/output error")
        os.fsync(fd)
        if fd in self._open_files:
            self.log.append(Op("fsync", self._paths[fd], self._open_files[fd]))
        else:
            self.log.append(Op("sync", self._paths[fd]))

    def fdatasync(self, fd: int) -> None:
        self.fsync(fd)

    def rename(self, source: str, target: str, *, src_dir_fd: int, dst_dir_fd: int) -> None:
        super().rename(source, target, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)
        old, new = self._path(source, src_dir_fd), self._path(target, dst_dir_fd)
        inode = self._files.pop(old)
        self._files[new] = inode
        self.log.append(Op("rename", old, inode, target=new))

    def unlink(self, name: str, *, dir_fd: int) -> None:
        super().unlink(name, dir_fd=dir_fd)
        path = self._path(name, dir_fd)
        self.log.append(Op("unlink", path, self._files.pop(path, 0)))

    def rmdir(self, name: str, *, dir_fd: int) -> None:
        super().rmdir(name, dir_fd=dir_fd)
        self.log.append(Op("rmdir", self._path(name, dir_fd)))

    def mkdir(self, name: str, *, dir_fd: int | None = None) -> None:
        super().mkdir(name, dir_fd=dir_fd)
        self.log.append(Op("mkdir", self._path(name, dir_fd)))


Choice = Callable[[random.Random], bool]
NAME_CHOICES: dict[str, Choice] = {
    "all": lambda _rng: True,
    "none": lambda _rng: False,
    "some": lambda rng: rng.random() < 0.5,
}
DATA_CHOICES = ("all", "none", "cut", "zeros", "sectors", "mixed")


def _surviving(pending: bytes, how: str, rng: random.Random) -> bytes:
    """Return what is left of bytes that were written and not synced."""
    if how == "mixed":
        how = rng.choice(DATA_CHOICES[:-1])
    if how == "cut":
        return pending[: rng.randrange(len(pending) + 1)]
    if how == "zeros":
        kept = rng.randrange(len(pending) + 1)
        return pending[:kept] + bytes(rng.randrange(len(pending) - kept + 1))
    if how == "sectors":
        pieces = [pending[i : i + SECTOR_BYTES] for i in range(0, len(pending), SECTOR_BYTES)]
        return b"".join(piece if rng.random() < 0.5 else bytes(len(piece)) for piece in pieces)
    return pending if how == "all" else b""


def _contents(log: list[Op], how: str, rng: random.Random) -> dict[int, bytes]:
    certain: dict[int, bytes] = {}
    pending: dict[int, bytes] = {}
    void: set[int] = set()  # after a failed fsync no later one proves anything about the file
    for op in log:
        if op.kind == "write":
            pending[op.inode] = pending.get(op.inode, b"") + op.data
        elif op.kind == "failed fsync":
            void.add(op.inode)
        elif op.kind == "fsync" and op.inode not in void:
            certain[op.inode] = certain.get(op.inode, b"") + pending.pop(op.inode, b"")
    return {
        inode: certain.get(inode, b"") + _surviving(pending.get(inode, b""), how, rng) for inode in {*certain, *pending}
    }


def _names(log: list[Op], survives: Choice, rng: random.Random) -> dict[str, int | None]:
    """Return path -> file number (None: folder) as the disk may have them."""
    last_sync: dict[str, int] = {op.path: i for i, op in enumerate(log) if op.kind == "sync"}
    names: dict[str, int | None] = {}
    for i, op in enumerate(log):
        if op.kind not in NAMES:
            continue
        certain = all(last_sync.get(folder, -1) > i for folder in op.folders)
        if not certain and not survives(rng):
            continue
        if op.kind in ("rename", "unlink", "rmdir") and names.get(op.path) == (op.inode or None):
            names.pop(op.path, None)
        if op.kind in ("create", "mkdir"):
            names[op.path] = op.inode or None
        elif op.kind == "rename":
            names[op.target] = op.inode
    return names


def build(log: list[Op], image: Path, names_how: str, data_how: str, rng: random.Random) -> None:
    """Make the folder ``image`` as a disk may hold it after a power cut at the end of ``log``."""
    contents = _contents(log, data_how, rng)
    names = _names(log, NAME_CHOICES[names_how], rng)
    for path, inode in sorted(names.items()):
        place = image / path
        if not place.parent.is_dir():
            continue  # the folder itself did not survive
        if inode is None:
            place.mkdir()
        else:
            place.write_bytes(contents.get(inode, b""))


def without_syncs(log: list[Op], kinds: set[str]) -> list[Op]:
    """Return the log of a program that forgot those syncs ("fsync": of files, "sync": of folders)."""
    return [op for op in log if op.kind not in kinds]
