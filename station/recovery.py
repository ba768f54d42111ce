"""What opening a session for work does first: read both its memories, clear up, lose nothing."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from station import durable
from station.errors import ManifestError, SessionError, SessionNotFoundError
from station.folder import PART_PREFIX, Folder
from station.frame_part import free_name
from station.journal import JournalContent, read_journal
from station.manifest import read_manifest
from station.replay import RECORDS, SessionState, replay
from station.session import (
    JOURNAL_NAME,
    MANIFEST_NAME,
    FrameRecord,
    PanoramaRecord,
    RejectedFrame,
    SessionManifest,
    Side,
)

REJECTED = "rejected"
SUBFOLDERS = (Side.INDOOR.value, Side.OUTDOOR.value, REJECTED)
_OUR_FRAME = re.compile(r"^(\d\d)_[0-9][A-Za-z0-9.-]*s(-\d+)?\.(jpg|cr2|dng)$")
_OUR_REJECT = re.compile(r"^(indoor|outdoor)_(\d\d)_[0-9][A-Za-z0-9.-]*s(-\d+)?\.(jpg|cr2|dng)$")
INTERRUPTED = "whole on disk but not acknowledged when the work was interrupted"


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

    @property
    def clean(self) -> bool:
        """Whether there was nothing to do."""
        return self == Recovery()

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
        raise SessionError(
            f"{MANIFEST_NAME} and {JOURNAL_NAME} belong to two sessions",
            where=str(root.path),
            advice="put the right files together again",
        )
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
                    raise SessionError(
                        f"{MANIFEST_NAME} and {JOURNAL_NAME} disagree: {exc}", where=manifest.name
                    ) from exc
                state.add(kind, record)
                restored.append((kind, record))
    return tuple(restored)


def sweep(folder: Folder) -> list[str]:
    """Remove the temporary files that an interrupted run left in a folder; returns their names."""
    leftovers = [name for name in folder.names() if name.startswith(PART_PREFIX)]
    for name in leftovers:
        folder.remove(name)
    return leftovers


def set_orphans_aside(folder: Folder, rejected: Folder, files: set[str]) -> list[str]:
    """Move frames of ours that no record names to rejected/; files of strangers stay where they are."""
    side, moved = folder.path.name, []
    for name in folder.names():
        if f"{side}/{name}" in files or not _OUR_FRAME.match(name):
            continue
        new_name = free_name(rejected, f"{side}_{name}")
        folder.move(name, rejected, new_name)
        moved.append(new_name)
    return moved


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
    reason = durable.irregular(info)
    if reason:
        return FileProblem("irregular", reason)
    if info.st_size != frame.size_bytes:
        return FileProblem("size", f"has {info.st_size} bytes in place of {frame.size_bytes}")
    return None


def keep_damaged_manifest(root: Folder, rejected: Folder) -> str | None:
    """Move an unreadable session.json to rejected/ before a new one is written; returns its new name.

    A link or a pipe in its place goes there unopened. A crash in between is no harm: the journal has it all.
    """
    info = root.lstat(MANIFEST_NAME)
    if info is None:
        return None
    name = free_name(rejected, f"damaged-{MANIFEST_NAME}")
    root.move(MANIFEST_NAME, rejected, name)
    return name
