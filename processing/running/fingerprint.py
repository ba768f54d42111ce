"""What a result depends on, as plain JSON values, and the digest of it.

The ingredients are kept beside the result, so that a later run can say what changed, not only that something did.
"""

import hashlib
import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from typing import Any

from drivers.errors import DaylitError
from station.session import strict_json
from station.session.folder import READ_BYTES, Folder, write_file
from station.session.session import SessionManifest

# SHA-256 of files, remembered as long as size, times and inode are the same.
#
# The memory is a cache beside the results (stages/.digests.json): losing it costs one reading of the files, and a copy
# of the session starts anew (other inodes). A file changed in place gets a new change time (ctime), which no program
# can set back; a disk that corrupts a file silently changes no time: `--recheck` reads everything.

MEMORY_NAME = ".digests.json"
MAX_MEMORY_BYTES = 4 << 20
TICK_NS = 20_000_000
"""Times of files have the grain of the kernel's clock; a digest counts only when the file is older than that."""

Signature = str  # size, time of change of the content and of the file, inode


class DigestMemory:
    """Digests by the file's name inside the session."""

    def __init__(self, folder: Folder | None, *, trust: bool = True) -> None:
        """``folder``: where the memory is kept; None: nowhere. ``trust`` False: every file is read once more."""
        self._folder = folder
        self._known: dict[str, tuple[Signature, str]] = {}
        self._changed = False
        if folder and trust:
            self._known = _load(folder)

    def sha256(self, folder: Folder, name: str, key: str) -> str:
        """Return the digest of an ordinary file, "" if there is none; links and devices are `IntegrityError`."""
        try:
            with folder.opened(name) as fd:
                signature = _signature(fd)
                known = self._known.get(key)
                if known and known[0] == signature:
                    return known[1]
                # Wait until a later change of the file would show in its times (at most one tick; new files only)
                age_ns = time.time_ns() - os.fstat(fd).st_ctime_ns
                if 0 <= age_ns < TICK_NS:
                    time.sleep((TICK_NS - age_ns) / 1e9)
                digest = hashlib.sha256()
                while block := os.read(fd, READ_BYTES):
                    digest.update(block)
                if _signature(fd) == signature:
                    self._known[key] = (signature, digest.hexdigest())
                    self._changed = True
                return digest.hexdigest()
        except FileNotFoundError:
            return ""

    def renamed(self, folder: Folder, name: str, key: str, sha256: str) -> None:
        """Keep the digest of a file that has just got another name or link, and no other content."""
        with folder.opened(name) as fd:
            self._known[key] = (_signature(fd), sha256)
            self._changed = True

    def save(self) -> None:
        """Keep what is known for the next run; failing to do so is no harm."""
        if self._folder and self._changed:
            with suppress(DaylitError):
                write_file(self._folder, MEMORY_NAME, json.dumps(self._known, sort_keys=True).encode())
                self._changed = False


def _signature(fd: int) -> Signature:
    info = os.fstat(fd)
    return f"{info.st_size} {info.st_mtime_ns} {info.st_ctime_ns} {info.st_ino}"


def _load(folder: Folder) -> dict[str, tuple[Signature, str]]:
    """Return what an earlier run kept; anything odd about it and it is forgotten."""
    try:
        data = strict_json.loads(folder.read_file(MEMORY_NAME, MAX_MEMORY_BYTES) or b"{}")
        return {str(key): (str(signature), str(digest)) for key, (signature, digest) in data.items()}
    except (DaylitError, ValueError, TypeError, AttributeError):
        return {}


ALWAYS = ("schema_version", "session_id", "created_utc", "bracket", "simulated")
"""Fields of the manifest that every stage sees."""
_BLANK = {"name": "session"}  # required fields that no result depends on
FOLDER = "folder"
RELIGHT = "relight"  # what `daylit relight` wrote: in a row's ``reads``, its summaries and pictures count
_NO_FIELDS = {FOLDER, RELIGHT}

Json = Any
Ingredients = dict[str, Json]


def visible_part(manifest: SessionManifest, reads: tuple[str, ...]) -> SessionManifest:
    """Return the manifest with only the named fields; the rest is as if it had not been recorded.

    Raises `ValueError` for a name that is no field.
    """
    fields = SessionManifest.model_fields
    unknown = set(reads) - set(fields) - _NO_FIELDS
    if unknown:
        raise ValueError(f"session.json has no {sorted(unknown)}")
    if FOLDER in reads:
        return manifest
    hidden = set(fields) - set(reads) - set(ALWAYS)
    blank = {name: _BLANK.get(name, fields[name].get_default(call_default_factory=True)) for name in hidden}
    return manifest.model_copy(update=blank)


def session_ingredients(part: SessionManifest, reads: tuple[str, ...]) -> Json:
    """Return what a stage sees of the session: frames by file name, the other fields as they are."""
    data = part.model_dump(mode="json", include=(set(ALWAYS) | set(reads)) - _NO_FIELDS)
    if "frames" in data:
        data["frames"] = {frame.pop("file"): frame for frame in data["frames"]}
    return data


def changes(old: Mapping[str, Json], new: Mapping[str, Json]) -> list[tuple[str, Json, Json]]:
    """Return (path, old, new) of every leaf that differs, in order of path; what is absent is None.

    Where one side has something inside what the other has empty, only the leaves inside are named.
    """
    before, after = dict(_leaves(old)), dict(_leaves(new))
    paths = sorted(set(before) | set(after))
    leaves = [path for path, following in pairwise([*paths, ""]) if not following.startswith(f"{path} ")]
    return [(path, before.get(path), after.get(path)) for path in leaves if before.get(path) != after.get(path)]


def _leaves(value: Json, path: str = "") -> list[tuple[str, Json]]:
    """Return (path, value) of every leaf; empty objects and lists are leaves."""
    if isinstance(value, Mapping) and value:
        items = [(str(key), inner) for key, inner in value.items()]
    elif isinstance(value, list) and value:
        items = [(str(index), inner) for index, inner in enumerate(value)]
    else:
        return [(path, value)]
    return [leaf for key, inner in items for leaf in _leaves(inner, f"{path} {key}" if path else key)]
