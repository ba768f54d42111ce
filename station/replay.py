"""The state of a session as its journal tells it: a first manifest and what happened since."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic import ValidationError

from station.errors import JournalError
from station.journal import JournalEntry
from station.manifest import manifest_of
from station.session import (
    FrameRecord,
    Model,
    ReadingRecord,
    RejectedFrame,
    SessionManifest,
    Side,
    SkippedStop,
    WarningRecord,
)

RECORDS: dict[str, tuple[str, type[Model]]] = {
    "frame": ("frames", FrameRecord),
    "rejected": ("rejected", RejectedFrame),
    "skipped": ("skipped", SkippedStop),
    "reading": ("readings", ReadingRecord),
    "warning": ("warnings", WarningRecord),
}
"""Kind of journal line -> list of the manifest it adds to."""

FIXED_FIELDS = {"schema_version", "session_id", "created_utc", "status", "missing"}
UPDATABLE = set(SessionManifest.model_fields) - FIXED_FIELDS - {name for name, _ in RECORDS.values()}
CREATED, UPDATE, WITHDRAWN, REJECTING = "created", "update", "withdrawn", "rejecting"
RESERVED = {CREATED, UPDATE, WITHDRAWN, REJECTING, *RECORDS}


class SessionState:
    """A manifest under way: a change is checked here, journalled by the store, then applied here."""

    def __init__(self, base: SessionManifest) -> None:
        self._base = base
        self._lists: dict[str, list[Any]] = {name: list(getattr(base, name)) for name, _ in RECORDS.values()}
        self._keys = {_key(f) for f in base.frames}
        self.files = {f.file for f in base.frames} | {r.file for r in base.rejected if r.file}
        """Paths of all files that a record names."""
        self.known: dict[str, set[Model]] = {name: set(found) for name, found in self._lists.items()}
        """Every record there ever was, withdrawn ones too."""
        self.reasons: dict[str, str] = {}
        """Why a file under rejected/ was about to be put there."""

    @property
    def manifest(self) -> SessionManifest:
        """The manifest of this moment, with ``status`` and ``missing`` as its contents say."""
        lists = {name: tuple(found) for name, found in self._lists.items()}
        return self._base.model_copy(update=lists).assess()

    def check(self, record: Model) -> None:
        """Raise `ValueError` if a frame cannot be added: its place is taken, or is not in the bracket."""
        if not isinstance(record, FrameRecord):
            return
        if _key(record) in self._keys:
            raise ValueError(f"there is a {record.format} frame of {record.side}, stop {record.stop} already")
        if not record.file.startswith(f"{record.side}/"):
            raise ValueError(f"{record.file} cannot be a frame of {record.side}")
        if record.file in self.files:
            raise ValueError(f"{record.file} belongs to another record")
        if record.stop >= len(self._base.bracket.stops_s):
            raise ValueError(f"the bracket has no stop {record.stop}")

    def add(self, kind: str, record: Model) -> None:
        """Add a checked record."""
        name = RECORDS[kind][0]
        self._lists[name].append(record)
        self.known[name].add(record)
        if isinstance(record, FrameRecord):
            self._keys.add(_key(record))
        if isinstance(record, FrameRecord | RejectedFrame) and record.file:
            self.files.add(record.file)

    def withdraw(self, side: Side, stop: int, format_: str) -> FrameRecord:
        """Take a frame out again and return its record; `ValueError` if there is none."""
        for record in self._lists["frames"]:
            if _key(record) == (side, stop, format_):
                self._lists["frames"].remove(record)
                self._keys.discard(_key(record))
                self.files.discard(record.file)
                return record  # type: ignore[no-any-return]
        raise ValueError(f"no {format_} frame of {side}, stop {stop}")

    def updated(self, fields: dict[str, Any]) -> SessionManifest:
        """Return the base manifest with other fields, validated; `ValueError` for fields that are fixed."""
        refused = set(fields) - UPDATABLE
        if refused:
            raise ValueError(f"not to be updated: {', '.join(sorted(refused))}")
        now = {name: getattr(self._base, name) for name in SessionManifest.model_fields}
        return SessionManifest.model_validate({**now, **fields})

    def rebase(self, base: SessionManifest) -> None:
        """Take the scalar fields of ``base``."""
        self._base = base

    def apply(self, entry: JournalEntry) -> None:
        """Replay a line; raises `ValueError` (also pydantic's) if it does not fit."""
        data = entry.data
        if entry.kind in RECORDS:
            record = RECORDS[entry.kind][1].model_validate(data)
            self.check(record)
            self.add(entry.kind, record)
        elif entry.kind == UPDATE:
            self.rebase(self.updated(data))
        elif entry.kind == WITHDRAWN:
            self.withdraw(Side(data["side"]), data["stop"], data["format"])
        elif entry.kind == REJECTING:
            self.reasons[str(data["file"])] = str(data["reason"])


def _key(frame: FrameRecord) -> tuple[str, int, str]:
    return frame.side, frame.stop, frame.format


def replay(entries: Iterable[JournalEntry], where: str) -> SessionState:
    """Return the state after ``entries``; raises `JournalError` naming the line that cannot be."""
    state: SessionState | None = None
    for entry in entries:
        if (entry.kind == CREATED) != (state is None):
            raise JournalError(f"line {entry.seq}: the journal begins with its manifest, once", where=where)
        if state is None:
            state = SessionState(manifest_of(entry.data, f"{where}, line 1"))
            continue
        try:
            state.apply(entry)
        except (ValidationError, ValueError, KeyError) as exc:
            raise JournalError(
                f"line {entry.seq} ({entry.kind}) does not fit what was before: {str(exc)[:300]}", where=where
            ) from exc
    if state is None:
        raise JournalError("the journal is empty", where=where)
    return state
