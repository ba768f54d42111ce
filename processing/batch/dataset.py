"""Making, checking and summing up a data set."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from processing.batch.croissant import (
    INDEX_NAME,
    METADATA_NAME,
    SPLITS,
    Description,
    Row,
    croissant,
    index_csv,
    index_rows,
    read_index,
)
from processing.errors import ParameterError
from processing.pictures.writing import write_bytes
from station.session.folder import file_sha256

# SHA256SUMS of a data set, as `sha256sum --check` reads it: every file of every session, and the index.


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


def sums_text(folder: Path, files: list[Path]) -> str:
    """Return SHA256SUMS of files within a folder; raise `ParameterError` for a name that it could not hold."""
    lines = []
    for path in files:
        name = path.relative_to(folder).as_posix()
        if "\n" in name or "\\" in name:
            raise ParameterError("a file's name has a line break or a backslash", where=repr(name))
        lines.append(f"{file_sha256(path)}  {name}\n")
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


# The index of a data set: a row a session, with its room and its split.
#
# Splits are by room, so that no room is in two of them: a room's part follows from a digest of its name, and so
# stays the same when sessions are added.


LICENCE_NAME = "LICENCE.txt"
USUAL_SHARES = (0.7, 0.15, 0.15)


def build(
    folder: Path, about: Description, *, shares: Sequence[float] = USUAL_SHARES, zone: str | None = None
) -> list[Path]:
    """Write index.csv, LICENCE.txt, croissant.json and, last, SHA256SUMS into a folder of sessions; return them.

    Sessions themselves are not touched. Raises `ParameterError` where there are none, or no licence is named.
    """
    if not about.licence.strip() or not about.name.strip():
        raise ParameterError("a data set needs a name and a licence", advice="--name NAME --licence CC-BY-4.0")
    rows = index_rows(folder, shares, zone)
    index = index_csv(rows).encode()
    made = [folder / name for name in (INDEX_NAME, LICENCE_NAME, METADATA_NAME, SUMS_NAME)]
    write_bytes(made[0], index)
    write_bytes(made[1], f"{about.name}\nLicence: {about.licence}\n{about.cite}\n".encode())
    values = croissant(about, len(index), file_sha256(made[0]))
    write_bytes(made[2], (json.dumps(values, indent=1, ensure_ascii=False) + "\n").encode())
    text = sums_text(folder, made[:3])
    for row in rows:
        text += sums_text(folder, list(session_files(folder / row["folder"])))
    write_bytes(made[3], text.encode())
    return made


@dataclass(frozen=True)
class CheckReport:
    """What is wrong with a data set; nothing, where all is well."""

    files: int
    missing: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    new: tuple[str, ...] = ()
    """In a session's folder, and not in SHA256SUMS."""
    problems: tuple[str, ...] = field(default=())

    @property
    def ok(self) -> bool:
        """Tell whether nothing is wrong."""
        return not (self.missing or self.changed or self.new or self.problems)


def check(folder: Path) -> CheckReport:
    """Compare a data set with its checksums, and its index and metadata with each other.

    Raises `ParameterError` where index or checksums cannot be read.
    """
    rows, sums = read_index(folder), read_sums(folder)
    missing, changed = [], []
    for name, digest in sums.items():
        path = folder / name
        if not path.is_file():
            missing.append(name)
        elif file_sha256(path) != digest:
            changed.append(name)
    there = {p.relative_to(folder).as_posix() for row in rows for p in _files(folder / row["folder"])}
    new = sorted(there - set(sums))
    return CheckReport(len(sums), tuple(missing), tuple(changed), tuple(new), tuple(_problems(folder, rows)))


def _files(session: Path) -> list[Path]:
    return list(session_files(session)) if session.is_dir() else []


def _problems(folder: Path, rows: Sequence[Row]) -> list[str]:
    found = []
    rooms: dict[str, set[str]] = {}
    for row in rows:
        rooms.setdefault(row["room"], set()).add(row["split"])
        if not (folder / row["folder"] / "session.json").is_file():
            found.append(f"{row['folder']}: in the index, and no session is there")
        if row["split"] not in SPLITS:
            found.append(f"{row['folder']}: an unknown split {row['split']!r}")
    found += [f"room {room} is in {' and '.join(sorted(s))}" for room, s in rooms.items() if len(s) > 1]
    try:
        values = json.loads((folder / METADATA_NAME).read_text("utf-8"))
        recorded = next(one["sha256"] for one in values["distribution"] if one["@id"] == "index")
        if recorded != file_sha256(folder / INDEX_NAME):
            found.append(f"{METADATA_NAME} describes another {INDEX_NAME}")
    except (OSError, ValueError, KeyError, TypeError, StopIteration):
        found.append(f"{METADATA_NAME} is missing or damaged")
    return found


def summary(folder: Path) -> dict[str, Any]:
    """Return what a data set holds, in numbers. Raises `ParameterError` without an index."""
    rows = read_index(folder)
    sizes = sum(path.stat().st_size for row in rows for path in _files(folder / row["folder"]))
    return {
        "sessions": len(rows),
        "rooms": len({row["room"] for row in rows}),
        "splits": {name: sum(1 for row in rows if row["split"] == name) for name in SPLITS},
        "bytes": sizes,
        "dates": _range([row["date"] for row in rows]),
        "simulated": sum(1 for row in rows if row["simulated"] == "YES"),
        "absolute": sum(1 for row in rows if row["units"] == "cd/m2"),
        "with_sky": sum(1 for row in rows if row["fisheye_time"]),
        "staged": sum(1 for row in rows if row["staged"] not in ("", "0")),
        "nd_filter": dict(Counter(row["nd_filter"] or "not known" for row in rows)),
        "winds": dict(Counter(row["orientation"].partition("°")[2] or "not known" for row in rows)),
        "luminance_cd_m2": _numbers(rows, "luminance_cd_m2"),
        "illuminance_lux": _numbers(rows, "illuminance_lux"),
        "highest_dgp": _numbers(rows, "highest_dgp"),
    }


def _range(values: list[str]) -> list[str]:
    known = sorted(value for value in values if value)
    return [known[0], known[-1]] if known else []


def _numbers(rows: Sequence[Row], column: str) -> dict[str, float] | None:
    values = sorted(float(row[column]) for row in rows if row[column])
    if not values:
        return None
    return {"count": len(values), "lowest": values[0], "median": values[len(values) // 2], "highest": values[-1]}
