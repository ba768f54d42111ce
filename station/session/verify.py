"""Whether a session is what its manifest says: every file, size and digest, and the journal agrees."""

import hashlib
import os
import re
import shlex
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from station.errors import IntegrityError, JournalError, ResourceError, SessionError, SessionNotFoundError
from station.session import durable, recovery
from station.session.durable import LOCK_NAME, SessionLock
from station.session.folder import PART_PREFIX, Folder, open_session, write_file
from station.session.journal import read_journal
from station.session.manifest import manifest_bytes, read_manifest
from station.session.recovery import RECORDS, REJECTED, SUBFOLDERS, FileProblem, replay
from station.session.session import (
    JOURNAL_NAME,
    MANIFEST_NAME,
    FrameRecord,
    Model,
    PanoramaRecord,
    SessionManifest,
    SessionStatus,
)

__all__ = ["FrameCheck", "Problem", "VerifyReport", "damaged_frames", "repair_session", "verify_session"]

JUNK = re.compile(r"(^|/)(__MACOSX/|\.DS_Store$|Thumbs\.db$|desktop\.ini$|\._)")
"""What file browsers leave behind in folders."""
WORTH_NOTING = ("moving_light", "clock_step", "paused")
"""Codes of warnings about the light or the times of a session, which no file shows."""
DAMAGE = {"missing", "irregular", "size", "digest", "unreadable"}
CUT_SHORT = {"manifest-behind", "manifest-differs", "journal-torn", "manifest-status"}
FrameCheck = Callable[[Path, FrameRecord], str | None]
"""Looks into a frame whose digest is right; returns what is wrong with it, or None."""

_CAPTURED = ("indoor", "outdoor")


def printable(text: str) -> str:
    """Return the text with everything unprintable spelled as an escape."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@dataclass(frozen=True)
class Problem:
    """One thing that is not as it should be: a code to sort by, the file inside the session, and words."""

    code: str
    file: str
    message: str


@dataclass
class VerifyReport:
    """All that was found; without ``problems`` the session is intact (but maybe partial: ``status``)."""

    path: str
    fast: bool
    status: str = "unknown"
    missing: tuple[str, ...] = ()
    frames_checked: int = 0
    frames_safe: int = 0
    """Of those, on disk as they were acknowledged."""
    frames_planned: int = 0
    imported: bool = False
    bytes_read: int = 0
    problems: list[Problem] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def intact(self) -> bool:
        """Whether there is no problem."""
        return not self.problems

    @property
    def cut_short(self) -> bool:
        """Whether nothing is wrong but that session.json is behind the journal: a capture runs, or was interrupted."""
        return bool(self.problems) and {problem.code for problem in self.problems} <= CUT_SHORT

    def add(self, code: str, file: str, message: str) -> None:
        """Note a problem; text from a hostile session cannot reach a terminal as control characters."""
        self.problems.append(Problem(code, printable(file), printable(message)))

    def to_dict(self) -> dict[str, Any]:
        """Return the report as a JSON-able mapping."""
        return {"intact": self.intact, **asdict(self)}

    def advice(self) -> list[str]:
        """Return what to do about the problems, the first thing first."""
        codes = {problem.code for problem in self.problems}
        path = shlex.quote(self.path)
        resume = "import it again" if self.imported else f"daylit capture --resume {path}"
        lines = []
        if any("this version of daylit supports up to" in problem.message for problem in self.problems):
            lines.append("update daylit; do not change the session with this version")
        elif "manifest" in codes:
            lines.append(f"daylit verify --repair {path} rebuilds session.json from the journal (none: from a backup)")
        if codes & CUT_SHORT:
            lines.append("a capture is running or was interrupted; nothing saved is lost. If none runs: " + resume)
        if "journal" in codes:
            lines.append("restore journal.jsonl from a backup; the frames and session.json may still be intact")
        if codes & {"missing", "size"}:
            lines.append("restore the files from a backup, or take them again: " + resume)
        if codes & {"digest", "content", "unreadable"}:
            lines.append("restore the files from a backup; without one, move them out and take them again: " + resume)
        if codes & {"extra", "irregular"}:
            lines.append("move files that do not belong to the session out of its folder")
        if self.missing and not codes:
            lines.append("complete it: " + resume)
        return lines

    def raise_for_problems(self) -> None:
        """Raise `IntegrityError` listing every problem, if there is one."""
        if self.problems:
            listed = "; ".join(f"{p.file}: {p.message}" for p in self.problems[:5])
            more = f"; and {len(self.problems) - 5} more" if len(self.problems) > 5 else ""
            text = f"{len(self.problems)} problem{'s'[: len(self.problems) - 1]}: {listed}{more}"
            files = [p.file for p in self.problems]
            raise IntegrityError(text, where=self.path, advice="; ".join(self.advice()), files=files)


def verify_session(path: Path, *, fast: bool = False, frame_check: FrameCheck | None = None) -> VerifyReport:
    """Check a session without changing anything (works on a read-only folder and takes no lock).

    ``fast`` looks at names and sizes alone and reads no frame. All problems are listed at once; the only
    error raised is `SessionNotFoundError` where there is no session.
    """
    report = VerifyReport(str(path), fast)
    with open_session(Path(path)) as root:
        if not any(root.lstat(name) for name in (MANIFEST_NAME, JOURNAL_NAME)):
            raise SessionNotFoundError(f"no {MANIFEST_NAME} here", where=str(path), advice="name a session folder")
        manifest = _check_manifest(root, report)
        journalled = _check_journal(root, manifest, report)
        _check_root(root, report)
        behind = journalled is not None and all(p.code != "not-journalled" for p in report.problems)
        best = journalled if behind else manifest or journalled  # the journal is ahead of a manifest, not beside it
        if best:
            # How many frames the bracket is to have, raw files too; of a given panorama, the one
            bracket = best.bracket
            sides = [*bracket.sides, *bracket.raw_sides]
            skipped = sum(sides.count(s.side) for s in best.skipped)
            report.frames_planned = len(bracket.stops_s) * len(sides) - skipped + (best.panorama is not None)
            report.status, report.missing = best.status.value, best.missing
            report.imported = bracket.mode not in ("full", "adaptive")
            listed = {
                r.file for m in (manifest, journalled) if m for many in (m.frames, m.rejected) for r in many if r.file
            }
            report.notes += [w.message for w in best.warnings if w.code in WORTH_NOTING]
            for name in SUBFOLDERS:
                _check_folder(root, name, listed, report)
            for record in (*best.frames, *((best.panorama,) if best.panorama else ())):
                _check_file(root, record, report, frame_check)
    return report


def damaged_frames(path: Path, manifest: SessionManifest) -> tuple[FrameRecord, ...]:
    """Return the frames whose files are gone or changed; a stray file, or a manifest behind its journal, is no harm."""
    found = {problem.file for problem in verify_session(path).problems if problem.code in DAMAGE}
    return tuple(frame for frame in manifest.frames if frame.file in found)


def repair_session(path: Path) -> VerifyReport:
    """Write session.json anew from the journal, then verify; a damaged one goes to rejected/.

    Raises `SessionLockedError` while somebody works on the session, `JournalError` if the journal is no help.
    """
    with open_session(Path(path)) as root:
        if root.lstat(JOURNAL_NAME) is None:
            advice = "restore it from a backup; daylit verify shows whether the session is intact without it"
            where = str(Path(path) / JOURNAL_NAME)
            raise JournalError("there is no journal to restore from", where=where, advice=advice)
        with SessionLock(root):
            memory = recovery.remember(root)
            manifest = memory.state.manifest
            if memory.manifest != manifest:
                if memory.manifest_problem:
                    root.make_sub(REJECTED)
                    with root.sub(REJECTED) as rejected:
                        recovery.keep_damaged_manifest(root, rejected)
                write_file(root, MANIFEST_NAME, manifest_bytes(manifest))
    return verify_session(path)


def _check_manifest(root: Folder, report: VerifyReport) -> SessionManifest | None:
    try:
        manifest = read_manifest(root)
    except (SessionError, ResourceError) as exc:
        report.add("manifest", MANIFEST_NAME, exc.message)
        return None
    if manifest is None:
        report.add("manifest", MANIFEST_NAME, "is missing")
        return None
    if manifest.status is SessionStatus.COMPLETE and manifest.assess().missing:
        report.add("manifest-status", MANIFEST_NAME, "is marked complete, but frames are missing")
    return manifest


def _check_journal(root: Folder, manifest: SessionManifest | None, report: VerifyReport) -> SessionManifest | None:
    """Compare journal and manifest; returns the manifest as the journal has it."""
    journalled = None
    try:
        content = read_journal(root)
        if content is None or not (content.entries or content.torn):
            report.notes.append("no journal: the manifest alone vouches for the files")
            return None
        if content.torn:
            report.add("journal-torn", JOURNAL_NAME, f"ends in a damaged line of {len(content.torn)} bytes")
        if content.entries:
            journalled = replay(content.entries, JOURNAL_NAME).manifest
            if manifest:
                _compare(journalled, manifest, report)
    except (SessionError, ResourceError) as exc:
        report.add("journal", JOURNAL_NAME, exc.message)
    return journalled


def _compare(journalled: SessionManifest, manifest: SessionManifest, report: VerifyReport) -> None:
    """Say where journal and manifest disagree, record by record."""
    for kind, (name, _) in RECORDS.items():
        ours, theirs = getattr(manifest, name), getattr(journalled, name)
        for record in _lacking(theirs, ours):
            file = getattr(record, "file", None) or MANIFEST_NAME
            report.add("manifest-behind", file, f"a {kind} of the journal is not in the manifest")
        for record in _lacking(ours, theirs):
            file = getattr(record, "file", None) or JOURNAL_NAME
            report.add("not-journalled", file, f"a {kind} of the manifest is not in the journal")
    for name in set(SessionManifest.model_fields) - ({name for name, _ in RECORDS.values()} | {"status", "missing"}):
        if getattr(manifest, name) != getattr(journalled, name):
            report.add("manifest-differs", MANIFEST_NAME, f"{name} differs from the journal")


def _lacking(records: tuple[Model, ...], others: tuple[Model, ...]) -> list[Model]:
    have = set(others)
    return [record for record in records if record not in have]


def _check_root(root: Folder, report: VerifyReport) -> None:
    """Beside our own files the root may hold results (folders); links, pipes and leftovers are reported."""
    for name in root.names():
        if name in SUBFOLDERS or name in (MANIFEST_NAME, JOURNAL_NAME, LOCK_NAME):
            continue
        reason = durable.irregular(root.lstat(name))
        if name.startswith(PART_PREFIX):
            report.notes.append(f"{name!r} was left by an interrupted run; it is harmless")
        elif reason and reason != durable.IS_FOLDER:
            report.add("irregular", name, reason)


def _check_folder(root: Folder, name: str, listed: set[str], report: VerifyReport) -> None:
    """Report what is in a folder and in no record."""
    if root.lstat(name) is None:
        return
    try:
        folder = root.sub(name)
    except SessionError as exc:
        report.add("irregular", name, exc.message)
        return
    for inside in folder.names():
        file = f"{name}/{inside}"
        if file in listed:
            continue
        reason = durable.irregular(folder.lstat(inside))
        if reason:
            report.add("irregular", file, reason)
        elif inside.startswith(PART_PREFIX):
            report.notes.append(f"{file!r} was left by an interrupted run; it is harmless")
        elif JUNK.search(file):
            report.notes.append(f"{file!r} was left by a file browser; it is harmless")
        elif name in _CAPTURED:
            report.add("extra", file, "is not recorded in the manifest")
    folder.close()


def _check_file(
    root: Folder, record: FrameRecord | PanoramaRecord, report: VerifyReport, frame_check: FrameCheck | None
) -> None:
    """Check the file of a frame or of the given panorama; ``frame_check`` looks into frames alone."""
    folder_name, _, name = record.file.partition("/")
    try:
        folder = root.sub(folder_name)
    except SessionError as exc:
        report.add("missing", record.file, exc.message)
        return
    try:
        with folder:
            problem = recovery.file_problem(folder, record)
            if problem is None and not report.fast:
                problem = _digest_problem(folder, record, report)
            if problem is None and frame_check and isinstance(record, FrameRecord):
                reason = frame_check(folder.path / name, record)
                problem = FileProblem("content", reason) if reason else None
    except (SessionError, ResourceError) as exc:
        problem = FileProblem("unreadable", exc.message)
    report.frames_checked += 1
    if problem:
        report.add(problem.code, record.file, problem.message)
    else:
        report.frames_safe += 1


def _digest_problem(folder: Folder, frame: FrameRecord | PanoramaRecord, report: VerifyReport) -> FileProblem | None:
    name = frame.file.partition("/")[2]
    with os.fdopen(folder.open_file(name), "rb") as file, durable.disk_errors(folder.path / name, "reading"):
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        report.bytes_read += os.fstat(file.fileno()).st_size
    return None if digest == frame.sha256 else FileProblem("digest", "its SHA-256 does not match the record")
