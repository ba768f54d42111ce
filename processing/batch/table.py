"""The table of a batch: batch.csv, a row a session in the paper's columns and more, and batch.json with all of it."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path

from processing.batch.rows import FOUND_COLUMNS, PAPER_COLUMNS
from processing.batch.run import BatchReport
from processing.batch.work import Outcome
from processing.picture_writing import write_bytes

CSV_NAME, JSON_NAME = "batch.csv", "batch.json"
RUN_COLUMNS = ("state", "code", "message", "ran", "kept", "warnings", "tries", "seconds", "cpu_s", "peak_mb")
COLUMNS = (*PAPER_COLUMNS, *FOUND_COLUMNS, *RUN_COLUMNS)


def batch_csv(outcomes: Iterable[Outcome]) -> str:
    """Return the table as CSV, numbered from 1 in the order given."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n", restval="")
    writer.writeheader()
    for index, one in enumerate(outcomes, 1):
        writer.writerow({name: guarded(value) for name, value in table_row(index, one).items()})
    return text.getvalue()


def table_row(index: int, one: Outcome) -> dict[str, str]:
    """Return a row of the table."""
    ran = sum(1 for action in one.stages.values() if action == "ran")
    found = {name: value for name, value in one.row.items() if name in COLUMNS}
    return {
        **found,
        "index": str(index),
        "session": one.session,
        "state": one.state,
        "code": one.code,
        "message": one.message,
        "ran": str(ran),
        "kept": str(sum(1 for action in one.stages.values() if action == "skipped")),
        "warnings": str(one.warnings),
        "tries": str(one.tries),
        "seconds": f"{one.seconds:.2f}",
        "cpu_s": f"{one.cpu_seconds:.2f}",
        "peak_mb": f"{one.peak_bytes / 1e6:.0f}",
    }


def guarded(text: str) -> str:
    """Return text that no spreadsheet takes for a formula, and that stays on one line."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    number = plain.lstrip("+-").replace(".", "", 1).replace("e-", "", 1).replace("e+", "", 1).isdigit()
    return f"'{plain}" if plain[:1] in ("=", "+", "-", "@") and not number else plain


def write_table(folder: Path, report: BatchReport) -> tuple[Path, Path]:
    """Write batch.csv and batch.json into a folder, each whole or not at all, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    table, values = folder / CSV_NAME, folder / JSON_NAME
    write_bytes(table, batch_csv(report.outcomes).encode())
    write_bytes(values, (json.dumps(report.to_dict(), indent=1, allow_nan=False) + "\n").encode())
    return table, values
