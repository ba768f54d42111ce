"""stages/ of a session on disk: whoever looks sees the old result of a stage or the new one, whole.

A result is built in a temporary folder, every file and the folder synced, then swapped with the old one in one step
where the system can (Linux). Elsewhere the old folder is moved aside first; `recover` puts it back if nothing took
its place. The folder of a stage belongs to the stage: what else lies in it goes with the old result.
"""

import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from processing.ground.finished import CLEANED, RESULT_NAME
from processing.running import results
from processing.running.fingerprint import DigestMemory
from station.errors import IntegrityError
from station.session import durable
from station.session.folder import PART_PREFIX, Folder, write_file

STAGES = "stages"
_OLD_PREFIX = ".old-"


@dataclass(frozen=True)
class Stored:
    """What is on disk of a stage: nothing, a damaged result (``problem``), or a result whose files are intact."""

    result: results.StageResult | None = None
    problem: str = ""


@contextmanager
def stages_folder(session: Folder, *, create: bool) -> Iterator[Folder | None]:
    """Open stages/ of an open session; None where there is none and none is to be made."""
    if create:
        if session.make_sub(STAGES):
            session.sync()
    elif session.lstat(STAGES) is None:
        yield None
        return
    with session.sub(STAGES) as folder:
        yield folder


class Building:
    """A result that is being built."""

    def __init__(self, folder: Folder, stage: str) -> None:
        self.folder = folder
        self.stage = stage

    def sync_files(self, names: list[str], memory: DigestMemory) -> dict[str, results.FileRecord]:
        """Make the named files durable and return their records."""
        records = {}
        for name in names:
            with self.folder.opened(name) as fd, durable.disk_errors(self.folder.path / name, "syncing"):
                durable.os_calls.fsync(fd)
                size_bytes = os.fstat(fd).st_size
            sha256 = memory.sha256(self.folder, name, f"{STAGES}/{self.stage}/{name}")
            records[name] = results.FileRecord(size_bytes=size_bytes, sha256=sha256)
        return records


class ResultStore:
    """Reads and replaces the results of stages. For writing, the caller holds the session's lock."""

    def __init__(self, folder: Folder | None, memory: DigestMemory) -> None:
        """``folder``: stages/; None: nothing there yet, for reading only."""
        self._folder = folder
        self._memory = memory

    def recover(self) -> None:
        """Undo what a killed run left half done, and remove its temporary files and folders."""
        folder = self._open()
        for name in folder.names():
            if name.startswith(_OLD_PREFIX):
                stage = name.removeprefix(_OLD_PREFIX)
                if folder.lstat(stage) is None:
                    folder.move(name, folder, stage)
                else:
                    _clear(folder, name)
            elif name.startswith(PART_PREFIX):
                _clear(folder, name)

    def path(self, stage: str) -> Path:
        """Return the folder of a stage's result."""
        return self._open().path / stage

    def read(self, stage: str) -> Stored:
        """Return what is there of a stage, every file checked against its digest."""
        if self._folder is None or self._folder.lstat(stage) is None:
            return Stored()
        with self._folder.sub(stage) as folder:
            try:
                raw = folder.read_file(RESULT_NAME, results.MAX_RESULT_BYTES)
                if raw is None:
                    return Stored(problem=f"{RESULT_NAME} is missing")
                result = results.parse_result(raw)
                if result.stage != stage:
                    return Stored(problem=f"{RESULT_NAME} is of another stage")
                damaged = [name for name, file in result.files.items() if not self._intact(folder, stage, name, file)]
            except (IntegrityError, ValueError) as exc:
                return Stored(problem=f"{RESULT_NAME}: {exc}"[:400])
        return Stored(problem=f"damaged or missing: {', '.join(damaged)}"[:400]) if damaged else Stored(result)

    def _intact(self, folder: Folder, stage: str, name: str, record: results.FileRecord) -> bool:
        info = folder.lstat(name)
        if info is None or not stat.S_ISREG(info.st_mode) or info.st_size != record.size_bytes:
            return False
        return self._memory.sha256(folder, name, f"{STAGES}/{stage}/{name}") == record.sha256

    def drop(self, stage: str) -> int:
        """Remove a stage's result but for what it found (`CLEANED`); return how many bytes its files had."""
        parent = self._open()
        if parent.lstat(stage) is None:
            return 0
        size = sum(path.stat().st_size for path in self.path(stage).iterdir() if path.is_file())
        with parent.sub(stage) as folder:
            if folder.lstat(RESULT_NAME) is not None:
                folder.move(RESULT_NAME, parent, CLEANED.format(stage))
        # First out of its place, so that a kill leaves no half result.
        old = f"{_OLD_PREFIX}{stage}"
        _clear(parent, old)
        with durable.disk_errors(self.path(stage), "removing the result"):
            durable.os_calls.rename(stage, old, src_dir_fd=parent.fd, dst_dir_fd=parent.fd)
        _clear(parent, old)
        return size

    @contextmanager
    def building(self, stage: str) -> Iterator[Building]:
        """Give a new, empty folder for a result; what is not committed is removed at the end."""
        parent = self._open()
        name = f"{PART_PREFIX}{secrets.token_hex(4)}-{stage}"
        parent.make_sub(name)
        building = Building(parent.sub(name), stage)
        try:
            yield building
        except OSError as error:
            if error.filename is None:  # Python's own writing names no file
                raise durable.disk_error(error, building.folder.path, "writing") from error
            raise
        finally:
            building.folder.close()
            if parent.lstat(name) is not None:
                _clear(parent, name)

    def commit(self, building: Building, result: results.StageResult, run: results.RunRecord) -> results.StageResult:
        """Put a built result in the place of the old one; when this returns no crash loses it."""
        parent, stage = self._open(), building.stage
        name = building.folder.path.name
        write_file(building.folder, results.RUN_NAME, results.result_bytes(run))
        sealed = result.sealed()
        write_file(building.folder, RESULT_NAME, results.result_bytes(sealed))
        with durable.disk_errors(parent.path / stage, "putting the result in its place"):
            if parent.lstat(stage) is None:
                durable.os_calls.rename(name, stage, src_dir_fd=parent.fd, dst_dir_fd=parent.fd)
            elif not durable.os_calls.exchange(name, stage, dir_fd=parent.fd):
                old = f"{_OLD_PREFIX}{stage}"
                durable.os_calls.rename(stage, old, src_dir_fd=parent.fd, dst_dir_fd=parent.fd)
                durable.os_calls.rename(name, stage, src_dir_fd=parent.fd, dst_dir_fd=parent.fd)
        parent.sync()
        _clear(parent, f"{_OLD_PREFIX}{stage}")
        _clear(parent, CLEANED.format(stage))
        return sealed

    def known_again(self, stage: str, files: Mapping[str, results.FileRecord]) -> None:
        """Remember the digests of files that were taken over from the former result: their change times are new."""
        if files:
            with self._open().sub(stage) as folder:
                for name, record in files.items():
                    self._memory.renamed(folder, name, f"{STAGES}/{stage}/{name}", record.sha256)

    def _open(self) -> Folder:
        if self._folder is None:
            raise IntegrityError("no stages here to write to", where=STAGES)
        return self._folder


def _clear(parent: Folder, name: str) -> None:
    """Remove a file or folder of ours; what cannot be removed stays for the next run."""
    info = parent.lstat(name)
    if info is None:
        return
    if not stat.S_ISDIR(info.st_mode):
        parent.remove(name)
        return
    with suppress(IntegrityError, OSError):
        with parent.sub(name) as folder:
            for inside in folder.names():
                _clear(folder, inside)
        durable.os_calls.rmdir(name, dir_fd=parent.fd)
