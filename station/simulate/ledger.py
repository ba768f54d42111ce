"""dataset.csv: what a data set of simulated sessions holds, a row a session, in the columns of the conditions."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from station.errors import SessionError, SessionExistsError
from station.folder import Folder, write_file
from station.simulate.conditions import COLUMNS

LEDGER_NAME = "dataset.csv"
MADE_WITH = ("size", "quality", "clouds", "seed")
"""Options that are the same for all sessions of one data set."""
LEDGER_COLUMNS = (*COLUMNS, "utc", "latitude_deg", "longitude_deg", "room_seed", "room", "sky", *MADE_WITH, "session")

Row = dict[str, str]


class Ledger:
    """The rows of dataset.csv by session folder; every change is on disk when it returns."""

    def __init__(self, folder: Path) -> None:
        """Read what is there.

        Raises
        ------
        SessionError
            A dataset.csv that is not ours or is damaged.
        """
        self.path = folder / LEDGER_NAME
        self.rows: dict[str, Row] = {}
        try:
            text = self.path.read_text("utf-8")
        except FileNotFoundError:
            return
        except (OSError, UnicodeDecodeError) as error:
            raise SessionError(f"cannot be read: {error}", where=str(self.path)) from error
        reader = csv.DictReader(io.StringIO(text, newline=""), restkey="")
        if tuple(reader.fieldnames or ()) != LEDGER_COLUMNS:
            raise SessionError("has other columns than ours", where=str(self.path), advice="choose another folder")
        for row in reader:
            if None in row.values() or "" in row:
                raise SessionError(f"line {reader.line_num} is damaged", where=str(self.path), advice="delete it")
            self.rows[row["session"]] = dict(row)

    def require_same(self, made_with: Mapping[str, str]) -> None:
        """Refuse to mix sessions made with other options (`SessionExistsError`)."""
        for row in self.rows.values():
            for key in MADE_WITH:
                if row[key] != made_with[key]:
                    raise SessionExistsError(
                        f"holds sessions made with {key} {row[key]}, not {made_with[key]}",
                        where=str(self.path.parent),
                        advice="use the same options as before, or another folder",
                    )

    def put(self, row: Row) -> None:
        """Add or replace the row of a session."""
        self.rows[row["session"]] = row
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, LEDGER_COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(sorted(self.rows.values(), key=lambda r: (int(r["index"]), r["session"])))
        folder = Folder.open(self.path.parent)
        try:
            write_file(folder, LEDGER_NAME, text.getvalue().encode())
        finally:
            folder.close()
