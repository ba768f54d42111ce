"""A session on disk that survives anything: what `add_frame` has returned for is there, come what may.

Order of a frame: bytes under a temporary name, fsync, size check, rename, fsync of the folder, journal line, fdatasync;
then it is acknowledged. The manifest is a snapshot, replaced at checkpoints; the journal is the truth.
"""

import threading
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any, Self

from drivers.clock import Clock, SystemClock
from station.errors import SessionError, SessionExistsError, SessionNotFoundError
from station.session import durable, recovery
from station.session.durable import LOCK_NAME, SessionLock
from station.session.folder import (
    FRAME_CAP_BYTES,
    Folder,
    FramePart,
    StoredFrame,
    frame_name,
    free_name,
    make_folders,
    write_file,
)
from station.session.journal import Journal
from station.session.manifest import load_manifest, manifest_bytes
from station.session.recovery import Recovery, SessionState
from station.session.session import (
    JOURNAL_NAME,
    MANIFEST_NAME,
    FrameRecord,
    Model,
    ReadingRecord,
    RejectedFrame,
    SessionManifest,
    Side,
    SkippedStop,
    WarningRecord,
    folder_name,
)

__all__ = ["FRAME_CAP_BYTES", "FramePart", "Recovery", "SessionStore", "StoredFrame", "frame_name", "load_manifest"]
_MAX_NAMESAKES = 999  # chosen: one scene within one minute


class SessionStore(AbstractContextManager["SessionStore"]):
    """A session folder open for reading or for work. Thread-safe; get one by `create` or `open`."""

    def __init__(self, root: Folder, clock: Clock) -> None:
        """Internal: use `create` or `open`."""
        self._root = root
        self._clock = clock
        self._mutex = threading.RLock()
        self._lock: SessionLock | None = None
        self._journal: Journal | None = None
        self._folders: dict[str, Folder] = {}
        self._state: SessionState
        self.recovery = Recovery()
        """What opening found and repaired."""

    @classmethod
    def create(cls, parent: Path, manifest: SessionManifest, *, clock: Clock | None = None) -> Self:
        """Make a new session folder in ``parent`` (made if missing), named by time and ``manifest.name``.

        Its manifest is durable on return. After `DiskFullError` or `DiskError` nothing is left behind.
        """
        make_folders(Path(parent))
        with durable.disk_errors(Path(parent), "opening"):
            folder = Folder.open(Path(parent))
        with folder:
            root = _new_root(folder, folder_name(manifest.created_utc, manifest.name))
            store = cls(root, clock or SystemClock())
            try:
                store._start(manifest)
            except BaseException:
                store.close()
                _remove_unborn(folder, root.path.name)
                raise
        return store

    @classmethod
    def open(cls, path: Path, *, writable: bool, clock: Clock | None = None) -> Self:
        """Open an existing session.

        Writable: takes the lock (`SessionLockedError`), cuts a torn journal line, removes temporary files,
        sets frames aside that were never acknowledged; `recovery` says what was done. Not writable: changes nothing.
        """
        try:
            root = Folder.open(Path(path))
        except (FileNotFoundError, NotADirectoryError) as exc:
            raise SessionNotFoundError("no such folder", where=str(path)) from exc
        except OSError as exc:
            raise durable.disk_error(exc, Path(path), "opening") from exc
        store = cls(root, clock or SystemClock())
        try:
            if writable:
                store._resume()
            else:
                store._state = recovery.remember(root).state
        except BaseException:
            store.close()
            raise
        return store

    @property
    def path(self) -> Path:
        """The session folder."""
        return self._root.path

    @property
    def manifest(self) -> SessionManifest:
        """The manifest of this moment: status and missing parts as they are now."""
        with self._mutex:
            return self._state.manifest

    def begin_frame(self, side: Side, stop: int, asked_s: float, format_: str = "jpeg") -> FramePart:
        """Open a temporary file for a frame; its final name is made from these facts alone."""
        side, format_ = Side(side), str(format_)
        name = frame_name(stop, asked_s, format_)
        with self._mutex:
            self._need_journal()
            folder = self._folders[side]
        return FramePart(
            folder,
            side,
            name,
            move=lambda temporary, final: self._commit(folder, temporary, final),
            set_aside=lambda temporary, final, reason: self._reject(folder, temporary, final, reason),
        )

    def add_frame(self, record: FrameRecord) -> None:
        """Acknowledge a committed frame: when this returns, no crash loses it.

        Raises `SessionError` if the file is not there as recorded, or the frame's place is taken.
        """
        with self._mutex:
            self._need_journal()
            problem = recovery.file_problem(self._folders[record.side], record)
            if problem:
                raise SessionError(f"cannot be recorded: it {problem.message}", where=str(self.path / record.file))
            self._add(record)

    def add(self, record: ReadingRecord | RejectedFrame | SkippedStop | WarningRecord) -> None:
        """Record, durably, a meter reading, a frame that does not count, a stop left out on purpose, or a warning."""
        self._add(record)

    def withdraw_frame(self, side: Side, stop: int, format_: str, reason: str) -> RejectedFrame:
        """Take an acknowledged frame back (damaged later, or to be retaken); its file goes to rejected/."""
        with self._mutex:
            journal = self._need_journal()
            frame = self._state.manifest.frame(side, stop, format_)
            if frame is None:
                raise SessionError(f"no {format_} frame of {side}, stop {stop}", where=str(self.path))
            journal.append(recovery.WITHDRAWN, {"side": side, "stop": stop, "format": format_, "reason": reason[:500]})
            self._state.withdraw(Side(side), stop, format_)
            name, folder = frame.file.partition("/")[2], self._folders[frame.side]
            file = self._reject(folder, name, f"{side}_{name}", reason) if folder.lstat(name) else None
            record = RejectedFrame(side=frame.side, stop=stop, file=file, reason=reason[:500])
            self._add(record)
            return record

    def update(self, **fields: Any) -> None:
        """Change fields of the manifest that are not lists of records (devices, drift_frac, ...), durably.

        Raises `SessionError` for unknown or fixed fields and values outside the schema.
        """
        with self._mutex:
            journal = self._need_journal()
            try:
                base = self._state.updated(fields)
            except ValueError as exc:
                raise SessionError(f"cannot be updated: {str(exc)[:500]}", where=str(self.path)) from exc
            journal.append(recovery.UPDATE, base.model_dump(mode="json", include=set(fields)))
            self._state.rebase(base)

    def event(self, kind: str, **data: Any) -> None:
        """Write a plain journal line, durably; ``data``: JSON values (anything else is written as text)."""
        if kind in recovery.RESERVED:
            raise SessionError(f"the journal kind {kind!r} is the store's own", where=str(self.path))
        with self._mutex:
            self._need_journal().append(kind, data)

    def save_manifest(self) -> None:
        """Replace session.json by the manifest of this moment; at any instant the old or the new stands."""
        with self._mutex:
            self._need_journal()
            write_file(self._root, MANIFEST_NAME, manifest_bytes(self._state.manifest))

    def finish(self) -> SessionManifest:
        """Save the manifest as assessed, journal it, and return it; the session stays open until `close`."""
        with self._mutex:
            self.save_manifest()
            manifest = self._state.manifest
            self.event("finished", status=manifest.status, missing=list(manifest.missing))
            return manifest

    def close(self) -> None:
        """Close all files and give the lock back; nothing is written. May be called twice."""
        with self._mutex:
            if self._journal:
                self._journal.close()
                self._journal = None
            if self._lock:
                self._lock.release()
                self._lock = None
            for folder in (*self._folders.values(), self._root):
                folder.close()
            self._folders = {}

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _start(self, manifest: SessionManifest) -> None:
        """Fill a new folder: manifest first, then the folders, then the journal."""
        self._lock = SessionLock(self._root)
        self._state = SessionState(manifest)
        write_file(self._root, MANIFEST_NAME, manifest_bytes(self._state.manifest))
        self._open_folders()
        journal = Journal(self._root, self._clock, None)
        journal.append(recovery.CREATED, manifest.model_dump(mode="json"))
        self._journal = journal

    def _resume(self) -> None:
        """Open for work: lock, read both memories, clear up, and journal what was done."""
        if not any(self._root.lstat(name) for name in (MANIFEST_NAME, JOURNAL_NAME)):
            advice = "name a session folder"
            raise SessionNotFoundError("neither a manifest nor a journal here", where=str(self.path), advice=advice)
        self._lock = SessionLock(self._root)
        memory = recovery.remember(self._root)
        self._state = memory.state
        self._open_folders()
        swept = [name for folder in (self._root, *self._folders.values()) for name in recovery.sweep(folder)]
        journal = Journal(self._root, self._clock, memory.journal)
        if memory.journal is None:
            journal.append(recovery.CREATED, memory.state.manifest.model_dump(mode="json"))
        self._journal = journal
        for kind, record in memory.unjournalled:
            journal.append(kind, record.model_dump(mode="json"))
        aside = self._set_aside_orphans()
        self.recovery = Recovery(
            torn_bytes=len(memory.journal.torn) if memory.journal else 0,
            swept=tuple(swept),
            set_aside=aside,
            restored=tuple(f"{kind} {getattr(r, 'file', '') or ''}".strip() for kind, r in memory.unjournalled),
            damaged=self._damaged(),
            manifest=memory.manifest_problem,
        )
        if memory.manifest_problem:
            recovery.keep_damaged_manifest(self._root, self._folders[recovery.REJECTED])
            self.save_manifest()
        journal.append("opened", {"recovery": self.recovery.to_dict()})

    def _open_folders(self) -> None:
        new = [self._root.make_sub(name) for name in recovery.SUBFOLDERS]
        if any(new):
            self._root.sync()
        for name in recovery.SUBFOLDERS:
            self._folders[name] = self._root.sub(name)

    def _set_aside_orphans(self) -> tuple[str, ...]:
        rejected = self._folders[recovery.REJECTED]
        for side in Side:
            recovery.set_orphans_aside(self._folders[side], rejected, self._state.files)
        records = recovery.unlisted_rejects(rejected, self._state)
        for record in records:
            self._add(record)
        return tuple(record.file or "" for record in records)

    def _damaged(self) -> tuple[str, ...]:
        problems = ((f.file, recovery.file_problem(self._folders[f.side], f)) for f in self._state.manifest.frames)
        return tuple(f"{file} {problem.message}" for file, problem in problems if problem)

    def _add(self, record: Model) -> None:
        """Check, journal, apply; a failure at the journal leaves the state as it was."""
        kind = next(kind for kind, (_, model) in recovery.RECORDS.items() if isinstance(record, model))
        with self._mutex:
            journal = self._need_journal()
            try:
                self._state.check(record)
            except ValueError as exc:
                raise SessionError(str(exc), where=str(self.path)) from exc
            journal.append(kind, record.model_dump(mode="json"))
            self._state.add(kind, record)

    def _commit(self, folder: Folder, temporary: str, final: str) -> str:
        with self._mutex:
            self._need_journal()
            name = free_name(folder, final)
            folder.move(temporary, folder, name)
            return name

    def _reject(self, folder: Folder, temporary: str, final: str, reason: str) -> str:
        with self._mutex:
            journal, rejected = self._need_journal(), self._folders[recovery.REJECTED]
            name = free_name(rejected, final)
            # Journalled first, so that a crash between here and the record does not lose the reason.
            journal.append(recovery.REJECTING, {"file": f"{recovery.REJECTED}/{name}", "reason": reason[:500]})
            folder.move(temporary, rejected, name)
            return f"{recovery.REJECTED}/{name}"

    def _need_journal(self) -> Journal:
        if self._journal is None:
            raise SessionError("the session is not open for writing", where=str(self.path))
        return self._journal


def _new_root(parent: Folder, name: str) -> Folder:
    """Create a folder ``name``, ``name-2``, ... that was not there, durably, and open it."""
    for number in range(1, _MAX_NAMESAKES + 1):
        candidate = name if number == 1 else f"{name}-{number}"
        if parent.make_sub(candidate):
            try:
                parent.sync()
                return parent.sub(candidate)
            except BaseException:
                _remove_unborn(parent, candidate)
                raise
    text = f"{_MAX_NAMESAKES} sessions of this name already exist"
    raise SessionExistsError(text, where=str(parent.path / name), advice="give the room another name")


def _remove_unborn(parent: Folder, name: str) -> None:
    """Remove a session folder whose creation failed, as far as the disk allows."""
    with suppress(OSError, SessionError):
        root = parent.sub(name)
        for file in (MANIFEST_NAME, JOURNAL_NAME, LOCK_NAME):
            root.remove(file)
        recovery.sweep(root)
        for sub in recovery.SUBFOLDERS:
            with suppress(OSError):
                durable.os_calls.rmdir(sub, dir_fd=root.fd)
        root.close()
        durable.os_calls.rmdir(name, dir_fd=parent.fd)
