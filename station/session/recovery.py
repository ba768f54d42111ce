"""What opening a session for work does first: read both its memories, clear up, lose nothing."""

import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from pydantic import ValidationError

from station.errors import JournalError, ManifestError, SessionError, SessionNotFoundError
from station.session import durable
from station.session.folder import PART_PREFIX, Folder, free_name
from station.session.journal import JournalContent, JournalEntry, read_journal
from station.session.manifest import manifest_of, read_manifest
from station.session.session import (
    JOURNAL_NAME,
    MANIFEST_NAME,
    FrameRecord,
    Model,
    PanoramaRecord,
    ReadingRecord,
    RejectedFrame,
    SessionManifest,
    Side,
    SkippedStop,
    WarningRecord,
)

# The state of a session as its journal has it: a first manifest and what happened since.

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
REJECTED = "rejected"
SUBFOLDERS = (Side.INDOOR.value, Side.OUTDOOR.value, REJECTED)
_OUR_FRAME = re.compile(r"^(\d\d)_[0-9][A-Za-z0-9.-]*s(-\d+)?\.(jpg|cr2|dng)$")
_OUR_REJECT = re.compile(r"^(indoor|outdoor)_(\d\d)_[0-9][A-Za-z0-9.-]*s(-\d+)?\.(jpg|cr2|dng)$")
INTERRUPTED = "complete on disk but not acknowledged when the run was interrupted"


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
        return self._base.model_copy(update={name: tuple(found) for name, found in self._lists.items()}).assess()

    def check(self, record: Model) -> None:
        """Raise `ValueError` if a frame cannot be added: its place is taken, or is not in the bracket."""
        if not isinstance(record, FrameRecord):
            return
        if _key(record) in self._keys:
            raise ValueError(f"there is a {record.format} frame of {record.side}, stop {record.stop} already")
        if not record.file.startswith(f"{record.side}/"):
            raise ValueError(f"{record.file} is not a valid frame of {record.side}")
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
            text = f"line {entry.seq} ({entry.kind}) does not follow from the lines before it: {str(exc)[:300]}"
            raise JournalError(text, where=where) from exc
    if state is None:
        raise JournalError("the journal is empty", where=where)
    return state


@dataclass(frozen=True)
class Recovery:
    """What was found and done when a session was opened; all empty after a clean end."""

    torn_bytes: int = 0
    """Length of the half-written last journal line that was cut."""
    swept: tuple[str, ...] = ()
    """Temporary files that were removed."""
    set_aside: tuple[str, ...] = ()
    """Frames on disk that were never acknowledged, now under rejected/."""
    restored: tuple[str, ...] = ()
    """Records that the manifest has and the journal lost (kind and file)."""
    damaged: tuple[str, ...] = ()
    """Acknowledged frames whose file is missing or of another size: somebody else's doing."""
    manifest: str = ""
    """Why session.json could not be read (the journal was used)."""

    def to_dict(self) -> dict[str, Any]:
        """Return the facts as a JSON-able mapping."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self).items()}


@dataclass(frozen=True)
class Memory:
    """Both memories of a session, read and merged. Nothing on disk was changed."""

    state: SessionState
    journal: JournalContent | None
    manifest: SessionManifest | None
    manifest_problem: str
    unjournalled: tuple[tuple[str, Any], ...]
    """(kind, record) pairs that only the manifest has."""


def remember(root: Folder) -> Memory:
    """Read the journal and the manifest of a session.

    The journal is the truth; the manifest stands in where there is no journal, and gives back what a journal
    lost at its end. Raises `SessionNotFoundError`, `ManifestError`, `SchemaTooNewError`, `JournalError`.
    """
    journal = read_journal(root)
    if journal is not None and not journal.entries:
        journal = None
    problem, manifest = "", None
    try:
        manifest = read_manifest(root)
    except ManifestError as exc:
        if journal is None:
            raise
        problem = exc.message
    if journal is None:
        if manifest is None:
            raise SessionNotFoundError(f"no {MANIFEST_NAME} here", where=str(root.path), advice="name a session folder")
        return Memory(SessionState(manifest), None, manifest, "", ())
    state = replay(journal.entries, str(root.path / JOURNAL_NAME))
    if manifest is None:
        return Memory(state, journal, None, problem or "missing", ())
    if manifest.session_id != state.manifest.session_id:
        text = f"{MANIFEST_NAME} and {JOURNAL_NAME} belong to two sessions"
        raise SessionError(text, where=str(root.path), advice="restore the matching pair of files")
    return Memory(state, journal, manifest, "", _merge(state, manifest))


def _merge(state: SessionState, manifest: SessionManifest) -> tuple[tuple[str, Any], ...]:
    """Add to ``state`` the records that only the manifest has, and return them."""
    restored = []
    for kind, (field, _) in RECORDS.items():
        for record in getattr(manifest, field):
            if record not in state.known[field]:
                try:
                    state.check(record)
                except ValueError as exc:
                    raise SessionError(f"{MANIFEST_NAME}, {JOURNAL_NAME} disagree: {exc}", where=manifest.name) from exc
                state.add(kind, record)
                restored.append((kind, record))
    return tuple(restored)


def sweep(folder: Folder) -> list[str]:
    """Remove the temporary files that an interrupted run left in a folder; returns their names."""
    leftovers = [name for name in folder.names() if name.startswith(PART_PREFIX)]
    for name in leftovers:
        folder.remove(name)
    return leftovers


def set_orphans_aside(folder: Folder, rejected: Folder, files: set[str]) -> None:
    """Move frames of ours that no record names to rejected/; files of strangers stay where they are."""
    side = folder.path.name
    for name in folder.names():
        if f"{side}/{name}" not in files and _OUR_FRAME.match(name):
            folder.move(name, rejected, free_name(rejected, f"{side}_{name}"))


def unlisted_rejects(rejected: Folder, state: SessionState) -> list[RejectedFrame]:
    """Return records for the frames under rejected/ that no record names yet."""
    files, found = state.files, []
    for name in rejected.names():
        match, file = _OUR_REJECT.match(name), f"{REJECTED}/{name}"
        if match and file not in files:
            reason = state.reasons.get(file, INTERRUPTED)
            found.append(RejectedFrame(side=Side(match[1]), stop=int(match[2]), file=file, reason=reason[:500]))
    return found


class FileProblem(NamedTuple):
    """What is wrong with a file: ``missing``, ``irregular``, ``size``, ... and words that follow its name."""

    code: str
    message: str


def file_problem(folder: Folder, frame: FrameRecord | PanoramaRecord) -> FileProblem | None:
    """Say what is wrong with the file of a frame without reading it; None if nothing."""
    info = folder.lstat(frame.file.partition("/")[2])
    if info is None:
        return FileProblem("missing", "is missing")
    if reason := durable.irregular(info):
        return FileProblem("irregular", reason)
    if info.st_size != frame.size_bytes:
        return FileProblem("size", f"has {info.st_size} bytes in place of {frame.size_bytes}")
    return None


def keep_damaged_manifest(root: Folder, rejected: Folder) -> None:
    """Move an unreadable session.json to rejected/ before a new one is written.

    A link or a pipe in its place goes there unopened. A crash in between is no harm: the journal has it all.
    """
    if root.lstat(MANIFEST_NAME) is not None:
        root.move(MANIFEST_NAME, rejected, free_name(rejected, f"damaged-{MANIFEST_NAME}"))
