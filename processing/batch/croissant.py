"""Croissant 1.0 metadata (mlcommons.org/croissant): what a data set's files are and what the index's columns mean."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processing.batch.rows import FOUND_COLUMNS, PAPER_COLUMNS, guarded, session_row
from processing.batch.run import find_sessions
from processing.errors import ParameterError
from processing.ground.tables import table_of

INDEX_NAME = "index.csv"
SPLITS = ("train", "validation", "test")
COLUMNS = (*PAPER_COLUMNS, "folder", "room", "split", *FOUND_COLUMNS)
_LEDGERS = ("dataset.csv",)
"""Tables of `daylit simulate`, which know what no session records: lamps, and the room's seed."""

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


def index_rows(folder: Path, shares: Sequence[float], zone: str | None = None) -> list[Row]:
    """Return the rows of all sessions in a folder, numbered from 1. Raises `ParameterError` where there is none."""
    # What tables of simulated data sets know of sessions, by session folder
    ledger: dict[str, Row] = {}
    for name in _LEDGERS:
        try:
            reader = csv.DictReader(io.StringIO((folder / name).read_text("utf-8"), newline=""))
            ledger |= {row["session"]: row for row in reader if row.get("session")}
        except (OSError, UnicodeDecodeError, csv.Error):
            continue
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


METADATA_NAME = "croissant.json"
_TABLE = table_of("processing.batch", "croissant")
_NUMBERS, _WHOLE, _CONTEXT = frozenset(_TABLE["numbers"]), frozenset(_TABLE["whole"]), _TABLE["context"]
MEANING: Mapping[str, str] = _TABLE["meaning"]


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
    date: str = ""
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
