"""SHA256SUMS of a data set, as `sha256sum --check` reads it: every file of every session, and the index."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

from processing.errors import ParameterError

SUMS_NAME = "SHA256SUMS"
_LINE = re.compile(r"([0-9a-f]{64})  ([^\\\n]+)")
_LEFT_OUT = (".", "run.json")
"""Of a session: hidden files (locks, caches), and what differs from run to run."""


def session_files(session: Path) -> Iterator[Path]:
    """Yield a session's files that belong to the data set, sorted."""
    for path in sorted(session.rglob("*")):
        parts = path.relative_to(session).parts
        hidden = any(part.startswith(_LEFT_OUT[0]) for part in parts) or path.name == _LEFT_OUT[1]
        if not hidden and path.is_file() and not path.is_symlink():
            yield path


def sha256_of(path: Path) -> str:
    """Return a file's SHA-256."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sums_text(folder: Path, files: list[Path]) -> str:
    """Return SHA256SUMS of files within a folder; raise `ParameterError` for a name that it could not hold."""
    lines = []
    for path in files:
        name = path.relative_to(folder).as_posix()
        if "\n" in name or "\\" in name:
            raise ParameterError("a file's name has a line break or a backslash", where=repr(name))
        lines.append(f"{sha256_of(path)}  {name}\n")
    return "".join(lines)


def read_sums(folder: Path) -> dict[str, str]:
    """Return digest by file name; `ParameterError` where there are none, or a line leads out of the folder."""
    path = folder / SUMS_NAME
    try:
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f"no checksums that can be read: {error}", where=str(path)) from None
    found = {}
    for number, line in enumerate(lines, 1):
        match = _LINE.fullmatch(line)
        if match is None or Path(match[2]).is_absolute() or ".." in Path(match[2]).parts:
            raise ParameterError(f"line {number} is damaged", where=str(path), advice="build it again")
        found[match[2]] = match[1]
    return found
