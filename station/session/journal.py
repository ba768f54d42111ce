"""The journal of a session: one durable line an event.

A line is ``<bytes of the JSON, 8 digits> <CRC-32, 8 hex digits> <JSON>\\n`` with the JSON object ``{"seq", "utc",
"monotonic_s", "kind", "data"}``; ``seq`` counts from 1 without gaps. A line counts once fdatasync has returned. Only
the last line can be torn by a crash, so a bad last line is cut and a bad earlier one is damage.
"""

import json
import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from station.errors import DiskError, JournalError
from station.session import durable, strict_json
from station.session.folder import Folder, write_file
from station.session.session import JOURNAL_NAME

# Chosen: far above what a capture writes.
MAX_JOURNAL_BYTES = 128 << 20
MAX_LINE_BYTES = 16 << 20
_HEAD_BYTES = 18  # sequence number, space, checksum, space
_FIELDS = {"seq": int, "utc": str, "monotonic_s": float, "kind": str, "data": dict}


@dataclass(frozen=True)
class JournalEntry:
    """One line: sequence number, wall clock (ISO 8601, UTC), monotonic time in seconds, what happened."""

    seq: int
    utc: str
    monotonic_s: float
    kind: str
    data: dict[str, Any]


@dataclass(frozen=True)
class JournalContent:
    """What a journal file says: its good lines, their length in bytes, and the torn end (usually empty)."""

    entries: tuple[JournalEntry, ...]
    good_bytes: int
    torn: bytes


def encode_line(entry: JournalEntry) -> bytes:
    """Return the line of ``entry``; raises `ValueError` for NaN, infinity, or a line beyond the cap."""
    body = json.dumps(vars(entry), allow_nan=False, separators=(",", ":"), default=str).encode()
    if len(body) > MAX_LINE_BYTES:
        raise ValueError(f"a journal line of {len(body)} bytes")
    return b"%08d %08x %s\n" % (len(body), zlib.crc32(body), body)


def decode_line(line: bytes) -> JournalEntry:
    """Return the entry of a line without its newline; raises `ValueError` saying what is wrong with it."""
    head, body = line[:_HEAD_BYTES], line[_HEAD_BYTES:]
    if len(head) < _HEAD_BYTES or head[8:9] != b" " or head[17:18] != b" " or not head[:8].isdigit():
        raise ValueError("its head is not a length and a checksum")
    if int(head[:8]) != len(body):
        raise ValueError(f"{len(body)} bytes where {int(head[:8])} are announced")
    if head[9:17] != b"%08x" % zlib.crc32(body):
        raise ValueError("its checksum does not match")
    found = strict_json.loads(body)
    types = {key: type(value) for key, value in found.items()} if isinstance(found, dict) else {}
    if types not in (_FIELDS, {**_FIELDS, "monotonic_s": int}):
        raise ValueError("it is not a journal entry")
    return JournalEntry(**found)


def parse_journal(raw: bytes, where: str) -> JournalContent:
    """Read a journal; raises `JournalError` naming the line where anything but the last line is damaged."""
    entries: list[JournalEntry] = []
    position = 0
    while position < len(raw):
        end = raw.find(b"\n", position)
        line = raw[position : end if end >= 0 else len(raw)]
        try:
            if end < 0:
                raise ValueError("it has no end")
            entry = decode_line(line)
            if entry.seq != len(entries) + 1:
                raise ValueError(f"it has number {entry.seq} in place of {len(entries) + 1}")
        except ValueError as exc:
            if end < 0 or end == len(raw) - 1:
                return JournalContent(tuple(entries), position, raw[position:])
            text = f"line {len(entries) + 1} is damaged: {exc}"
            likely = "a failing disk, or the file was edited"
            advice = "keep the folder as it is and restore journal.jsonl from a copy"
            raise JournalError(text, where=where, likely=likely, advice=advice, line=len(entries) + 1) from exc
        entries.append(entry)
        position = end + 1
    return JournalContent(tuple(entries), position, b"")


def read_journal(folder: Folder) -> JournalContent | None:
    """Return the journal of an open session folder; None where there is none."""
    raw = folder.read_file(JOURNAL_NAME, MAX_JOURNAL_BYTES)
    return None if raw is None else parse_journal(raw, str(folder.path / JOURNAL_NAME))


class Journal:
    """An open journal. Not thread-safe: the store serialises its callers."""

    def __init__(self, folder: Folder, clock: Clock, content: JournalContent | None) -> None:
        """Continue after the good lines of ``content`` (None: a new journal); a torn end is cut."""
        self._folder = folder
        self._clock = clock
        self._size_bytes = content.good_bytes if content else 0
        self._seq = len(content.entries) if content else 0
        self._fd = -1
        self._suspect = bool(content and content.torn)
        if self._suspect:
            self._rewrite()

    @property
    def path(self) -> Path:
        """The journal's file."""
        return self._folder.path / JOURNAL_NAME

    def append(self, kind: str, data: dict[str, Any]) -> JournalEntry:
        """Add a line and return once it is durable.

        After `DiskFullError` or `DiskError` the line does not count; the next call first writes the good
        lines to a new file, since neither a half-written line nor a file that failed to sync can be trusted.
        """
        utc, monotonic_s = self._clock.utc_now().isoformat(), self._clock.monotonic_s()
        entry = JournalEntry(self._seq + 1, utc, monotonic_s, kind, data)
        line = encode_line(entry)
        if self._seq == 0:
            write_file(self._folder, JOURNAL_NAME, line)
        else:
            self._append(line)
        self._size_bytes += len(line)
        self._seq += 1
        return entry

    def _append(self, line: bytes) -> None:
        if self._fd < 0:
            self._reopen()
        try:
            with durable.disk_errors(self.path, "writing"):
                durable.write_all(self._fd, line)
                durable.os_calls.fdatasync(self._fd)
                durable.check_size(self._fd, self._size_bytes + len(line))
        except BaseException:
            self._suspect = True
            self.close()
            raise

    def _reopen(self) -> None:
        """Open for appending; after a failure the good lines go to a new file first."""
        if self._suspect:
            self._rewrite()
        try:
            self._fd = self._folder.open_file(JOURNAL_NAME, os.O_WRONLY | os.O_APPEND)
        except FileNotFoundError as exc:
            raise DiskError("vanished while in use", where=str(self.path)) from exc

    def _rewrite(self) -> None:
        """Write the good lines to a new file and put it in the journal's place."""
        good = (self._folder.read_file(JOURNAL_NAME, MAX_JOURNAL_BYTES) or b"")[: self._size_bytes]
        if len(parse_journal(good, str(self.path)).entries) != self._seq:
            raise JournalError("lines that were there are gone", where=str(self.path))
        write_file(self._folder, JOURNAL_NAME, good)
        self._suspect = False

    def close(self) -> None:
        """Close the file; a later append opens it again."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
