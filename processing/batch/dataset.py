"""Making, checking and summing up a data set."""

import csv
import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processing.batch.rows import FOUND_COLUMNS, PAPER_COLUMNS, csv_text, session_row
from processing.batch.run import find_sessions
from processing.errors import ParameterError
from processing.ground.tables import table_of
from processing.pictures.writing import write_bytes
from station.session.folder import file_sha256

# Croissant 1.0 metadata (mlcommons.org/croissant): what a data set's files are and what the index's columns mean.

INDEX_NAME = "index.csv"
SPLITS = ("train", "validation", "test")
COLUMNS = (*PAPER_COLUMNS, "folder", "room", "split", *FOUND_COLUMNS)
_LEDGER = "dataset.csv"  # table of `daylit simulate`, which knows what no session records: lamps, and the room's seed

Row = dict[str, str]
METADATA_NAME = "croissant.json"
_TABLE = table_of("processing.batch", "croissant")
_NUMBERS, _WHOLE, _CONTEXT = frozenset(_TABLE["numbers"]), frozenset(_TABLE["whole"]), _TABLE["context"]
MEANING: Mapping[str, str] = _TABLE["meaning"]


def split_of(room: str, shares: Sequence[float], salt: str = "daylit") -> str:
    """Return the split of a room: ``shares`` (train, validation, test) sum to 1."""
    if len(shares) != len(SPLITS) or min(shares) < 0 or abs(sum(shares) - 1) > 1e-9:
        raise ParameterError(f"shares {list(shares)} of the splits", advice="give three numbers from 0 that sum to 1")
    place = int.from_bytes(hashlib.sha256(f"{salt}/{room}".encode()).digest()[:8], "big") / 2**64
    upto = 0.0
    for name, share in zip(SPLITS, shares, strict=True):
        upto += share
        if place < upto:
            return name
    return SPLITS[max(k for k, share in enumerate(shares) if share > 0)]


def index_rows(folder: Path, shares: Sequence[float], zone: str | None = None) -> list[Row]:
    """Return the rows of all sessions in a folder, numbered from 1. Raises `ParameterError` where there is none."""
    ledger: dict[str, Row] = {}  # by session folder
    with suppress(OSError, UnicodeDecodeError, csv.Error):
        reader = csv.DictReader(io.StringIO((folder / _LEDGER).read_text("utf-8-sig"), newline=""))
        ledger = {row["session"]: row for row in reader if row.get("session")}
    rows = []
    for index, path in enumerate(find_sessions(folder), 1):
        row, known = session_row(path, zone), ledger.get(path.name, {})
        room = known.get("room", "") or row["scene_name"]
        place = {"index": str(index), "folder": path.relative_to(folder).as_posix()}
        said = {"natural_light": known.get("natural_light", ""), "room": room, "split": split_of(room, shares)}
        rows.append({**dict.fromkeys(COLUMNS, ""), **row, **place, **said})
    return rows


def read_index(folder: Path) -> list[Row]:
    """Return the rows of a data set's index; raise `ParameterError` where there is none that can be read."""
    path = folder / INDEX_NAME
    try:
        reader = csv.DictReader(io.StringIO(path.read_text("utf-8-sig"), newline=""))
        rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        advice = "create it with daylit dataset build"
        raise ParameterError(f"the index cannot be read: {error}", where=str(path), advice=advice) from None
    if tuple(reader.fieldnames or ()) != COLUMNS or any(None in row.values() for row in rows):
        raise ParameterError("the index has other columns, or a damaged row", where=str(path), advice="rebuild it")
    return rows


@dataclass(frozen=True)
class Description:
    """What people say of a data set."""

    name: str
    licence: str
    """SPDX identifier or address."""
    description: str = "Rooms and their skies in absolute luminance, captured and processed with daylit."
    creator: str = ""
    cite: str = ""
    url: str = ""
    version: str = "1.0.0"
    date: str | None = None
    """Of publication, yyyy-mm-dd."""


def croissant(about: Description, index_bytes: int, index_sha256: str) -> dict[str, Any]:
    """Return the metadata as JSON-LD."""
    licence = about.licence if "://" in about.licence else f"https://spdx.org/licenses/{about.licence}.html"
    index = {**_TABLE["index"], "contentSize": f"{index_bytes} B", "sha256": index_sha256}
    found: dict[str, Any] = {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": about.name,
        "description": about.description,
        "license": licence,
        "url": about.url or f"urn:daylit:dataset:{about.name.replace(' ', '-')}",
        "version": about.version,
        "distribution": [index, *_TABLE["pictures"]],
        "recordSet": [{**_TABLE["sessions"], "field": [_field(column) for column in COLUMNS]}],
    }
    if about.date:
        found["datePublished"] = about.date
    if about.creator:
        found["creator"] = {"@type": "sc:Organization", "name": about.creator}
    if about.cite:
        found["citeAs"] = about.cite
    return found


def _field(column: str) -> dict[str, Any]:
    kind = "sc:Float" if column in _NUMBERS else "sc:Integer" if column in _WHOLE else "sc:Text"
    return {
        "@type": "cr:Field",
        "@id": f"sessions/{column}",
        "name": column,
        "description": MEANING.get(column, column.replace("_", " ")),
        "dataType": kind,
        "source": {"fileObject": {"@id": "index"}, "extract": {"column": column}},
    }


# SHA256SUMS of a data set, as `sha256sum --check` reads it: every file of every session, and the index.

SUMS_NAME = "SHA256SUMS"
_LINE = re.compile(r"([0-9a-f]{64})  ([^\\\n]+)")
_LEFT_OUT = (".", "run.json")  # of a session: hidden files (locks, caches), and what differs from run to run


def session_files(session: Path) -> Iterator[Path]:
    """Yield a session's files that belong to the data set, sorted; none of a folder that is not there."""
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
        raise ParameterError(f"the checksums cannot be read: {error}", where=str(path)) from None
    found = {}
    for number, line in enumerate(lines, 1):
        match = _LINE.fullmatch(line)
        if match is None or Path(match[2]).is_absolute() or ".." in Path(match[2]).parts:
            raise ParameterError(f"line {number} is damaged", where=str(path), advice="rebuild it")
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
    index = csv_text(COLUMNS, rows).encode()
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
    problems: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
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
    there = {p.relative_to(folder).as_posix() for row in rows for p in session_files(folder / row["folder"])}
    new = sorted(there - set(sums))
    return CheckReport(len(sums), tuple(missing), tuple(changed), tuple(new), tuple(_problems(folder, rows)))


def _problems(folder: Path, rows: Sequence[Row]) -> list[str]:
    found = []
    rooms: dict[str, set[str]] = {}
    for row in rows:
        rooms.setdefault(row["room"], set()).add(row["split"])
        if not (folder / row["folder"] / "session.json").is_file():
            found.append(f"{row['folder']}: listed in the index, but there is no session")
        if row["split"] not in SPLITS:
            found.append(f"{row['folder']}: unknown split {row['split']!r}")
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
    dates = sorted(row["date"] for row in rows if row["date"])
    sizes = sum(path.stat().st_size for row in rows for path in session_files(folder / row["folder"]))
    return {
        "sessions": len(rows),
        "rooms": len({row["room"] for row in rows}),
        "splits": {name: sum(1 for row in rows if row["split"] == name) for name in SPLITS},
        "bytes": sizes,
        "dates": [dates[0], dates[-1]] if dates else [],
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


def _numbers(rows: Sequence[Row], column: str) -> dict[str, float] | None:
    values = sorted(float(row[column]) for row in rows if row[column])
    if not values:
        return None
    return {"count": len(values), "lowest": values[0], "median": values[len(values) // 2], "highest": values[-1]}
