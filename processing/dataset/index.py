"""The index of a data set: a row a session, with its room and its split.

Splits are by room, so that no room is in two of them: a room's part is told by a digest of its name, and so stays the
same when sessions are added.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from processing.batch.rows import FOUND_COLUMNS, PAPER_COLUMNS, session_row
from processing.batch.run import find_sessions
from processing.batch.table import guarded
from processing.errors import ParameterError

INDEX_NAME = "index.csv"
SPLITS = ("train", "validation", "test")
COLUMNS = (*PAPER_COLUMNS, "folder", "room", "split", *FOUND_COLUMNS)
_LEDGERS = ("dataset.csv",)
"""Tables of `daylit simulate`, which know what no session tells: lamps, and the room's seed."""

Row = dict[str, str]


def split_of(room: str, shares: Sequence[float], salt: str = "daylit") -> str:
    """Return the split of a room: ``shares`` (train, validation, test) sum to 1."""
    if len(shares) != len(SPLITS) or min(shares) < 0 or abs(sum(shares) - 1) > 1e-9:
        raise ParameterError(f"shares {list(shares)} of the splits", advice="three, from 0, that sum to 1")
    place = int.from_bytes(hashlib.sha256(f"{salt}/{room}".encode()).digest()[:8], "big") / 2**64
    upto = 0.0
    for name, share in zip(SPLITS, shares, strict=True):
        upto += share
        if place < upto:
            return name
    return SPLITS[max(k for k, share in enumerate(shares) if share > 0)]


def index_rows(folder: Path, shares: Sequence[float], zone: str = "UTC") -> list[Row]:
    """Return the rows of all sessions in a folder, numbered from 1. Raises `ParameterError` where there is none."""
    ledger = _ledger(folder)
    rows = []
    for index, path in enumerate(find_sessions(folder), 1):
        row, known = session_row(path, zone), ledger.get(path.name, {})
        room = known.get("room", "") or row["scene_name"]
        rows.append(
            {
                **dict.fromkeys(COLUMNS, ""),
                **row,
                "index": str(index),
                "folder": path.relative_to(folder).as_posix(),
                "natural_light": known.get("natural_light", ""),
                "room": room,
                "split": split_of(room, shares),
            }
        )
    return rows


def index_csv(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the index as CSV."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: guarded(row[name]) for name in COLUMNS} for row in rows)
    return text.getvalue()


def read_index(folder: Path) -> list[Row]:
    """Return the rows of a data set's index; raise `ParameterError` where there is none that can be read."""
    path = folder / INDEX_NAME
    try:
        reader = csv.DictReader(io.StringIO(path.read_text("utf-8"), newline=""))
        rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(
            f"no index that can be read: {error}", where=str(path), advice="daylit dataset build makes it"
        ) from None
    if tuple(reader.fieldnames or ()) != COLUMNS or any(None in row.values() for row in rows):
        raise ParameterError("the index has other columns, or a damaged row", where=str(path), advice="build it again")
    return rows


def _ledger(folder: Path) -> dict[str, Row]:
    """Return what tables of simulated data sets know of sessions, by session folder."""
    found: dict[str, Row] = {}
    for name in _LEDGERS:
        try:
            reader = csv.DictReader(io.StringIO((folder / name).read_text("utf-8"), newline=""))
            found |= {row["session"]: row for row in reader if row.get("session")}
        except (OSError, UnicodeDecodeError, csv.Error):
            continue
    return found
