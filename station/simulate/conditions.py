"""Conditions of a data set: a CSV with a row a session, as the paper's cali_hdr_summary.csv, read strictly.

Columns: index, date, scene_name, theta_time, luminance_cd_m2, fisheye_time, illuminance_lux, orientation, nd_filter,
natural_light; further ones are ignored. Times are local.
"""

import csv
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import date, datetime, time
from pathlib import Path
from typing import TypeVar

from station.errors import ConditionsError

COLUMNS = (
    *("index", "date", "scene_name", "theta_time", "luminance_cd_m2"),
    *("fisheye_time", "illuminance_lux", "orientation", "nd_filter", "natural_light"),
)
DAYLIGHT_ONLY, WITH_LAMPS = "YES", "With electrical light"
POINTS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
# Chosen: far above the paper's list of 137 sessions.
MAX_BYTES = 4 * 1024 * 1024
_MAX_FAULTS_SHOWN = 8  # chosen: what fits a terminal
_FILTER = {"YES": True, "NO": False, "": False}
_LAMPS = {DAYLIGHT_ONLY: False, "NO": True, WITH_LAMPS: True}

T = TypeVar("T")


@dataclass(frozen=True)
class Condition:
    """One session: where the camera looked, when (local time), and what the light was.

    ``outdoor_local`` is None where the sky was not photographed; a number that was not taken is None too.
    """

    line: int
    index: int
    scene: str
    local: datetime
    outdoor_local: datetime | None
    luminance_cd_m2: float | None
    illuminance_lux: float | None
    heading_deg: float
    nd_filter: bool
    lamps_on: bool


def load_conditions(path: Path) -> list[Condition]:
    """Read and check a CSV of conditions.

    Raises `ConditionsError`: missing, not such a CSV, or rows that cannot be right; names the file, and line and
    column of each fault.
    """
    found: list[Condition] = []
    faults: list[str] = []
    for line, row in _rows(path):
        condition = _read_row(line, row, faults)
        if condition is not None:
            found.append(condition)
    faults += _twice(found)
    if not found and not faults:
        faults.append("it lists no sessions")
    if faults:
        more = f"; and {len(faults) - _MAX_FAULTS_SHOWN} more" if len(faults) > _MAX_FAULTS_SHOWN else ""
        text = "; ".join(faults[:_MAX_FAULTS_SHOWN]) + more
        advice = "correct these cells; docs/reference/files.md describes the columns"
        raise ConditionsError(text, where=str(path), advice=advice, faults=faults)
    return found


def orientation(heading_deg: float) -> str:
    """Return a heading as the CSV has it, such as 328°NW."""
    whole = round(heading_deg) % 360
    return f"{whole}°{POINTS[round(whole / 45) % 8]}"


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ConditionsError("too large to be a list of sessions", where=str(path))
        text = path.read_text("utf-8-sig")
    except FileNotFoundError as error:
        raise ConditionsError("no such file", where=str(path), advice="give --conditions FILE.csv") from error
    except (OSError, UnicodeDecodeError) as error:
        raise ConditionsError(f"cannot be read: {error}", where=str(path), advice="save it as UTF-8 CSV") from error
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = next(reader, [])
        if wrong := [c for c in COLUMNS if header.count(c) != 1]:
            raise ConditionsError(f"line 1: needs each of these columns once: {', '.join(wrong)}", where=str(path))
        for cells in reader:
            if not cells:
                continue
            if len(cells) != len(header):
                text = f"line {reader.line_num}: {len(cells)} cells under {len(header)} columns"
                raise ConditionsError(text, where=str(path), advice="put cells that hold a comma in quotes")
            yield reader.line_num, dict(zip(header, (c.strip() for c in cells), strict=True))
    except csv.Error as error:
        raise ConditionsError(f"line {reader.line_num}: {error}", where=str(path)) from error


def _read_row(line: int, row: dict[str, str], faults: list[str]) -> Condition | None:
    def cell(column: str, read: Callable[[str], T]) -> T | None:
        try:
            return read(row[column])
        except ValueError as error:
            faults.append(f"line {line}, column {column}: {error}")
            return None

    before = len(faults)
    index, day, scene = cell("index", _index), cell("date", _date), cell("scene_name", _scene)
    indoor, outdoor = cell("theta_time", _time), cell("fisheye_time", lambda text: _time(text) if text else None)
    luminance, illuminance = cell("luminance_cd_m2", _number), cell("illuminance_lux", _number)
    heading = cell("orientation", _heading)
    filtered, lamps = cell("nd_filter", _one_of(_FILTER)), cell("natural_light", _one_of(_LAMPS))
    if outdoor is not None and not row["nd_filter"]:
        faults.append(f"line {line}, column nd_filter: empty, though the sky was photographed (YES or NO)")
    if len(faults) > before or index is None or day is None or scene is None or indoor is None or heading is None:
        return None
    return Condition(
        line=line,
        index=index,
        scene=scene,
        local=datetime.combine(day, indoor),
        outdoor_local=datetime.combine(day, outdoor) if outdoor is not None else None,
        luminance_cd_m2=luminance,
        illuminance_lux=illuminance,
        heading_deg=heading,
        nd_filter=bool(filtered),
        lamps_on=bool(lamps),
    )


def _twice(found: list[Condition]) -> list[str]:
    seen: dict[int, int] = {}
    faults = []
    for condition in found:
        first = seen.setdefault(condition.index, condition.line)
        if first != condition.line:
            faults.append(f"line {condition.line}, column index: {condition.index} is on line {first} too")
    return faults


def _index(cell: str) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", cell):
        raise ValueError(f"{cell!r} is not a number")
    return int(cell)


def _date(cell: str) -> date:
    if not re.fullmatch(r"[0-9]{8}", cell):
        raise ValueError(f"{cell!r} is not a date such as 20230519")
    try:
        return date(int(cell[:4]), int(cell[4:6]), int(cell[6:]))
    except ValueError as error:
        raise ValueError(f"{cell!r} is not a date: {error}") from error


def _time(cell: str) -> time:
    match = re.fullmatch(r"([0-9]{1,2}):([0-9]{2})", cell)
    if match is None or int(match[1]) > 23 or int(match[2]) > 59:
        raise ValueError(f"{cell!r} is not a time such as 9:23")
    return time(int(match[1]), int(match[2]))


def _scene(cell: str) -> str:
    if not cell or len(cell) > 60 or not cell.isprintable():
        raise ValueError(f"{cell!r} is not a name of 1 to 60 letters")
    if not any(c.isascii() and c.isalnum() for c in cell):
        raise ValueError(f"{cell!r} holds no letter or digit for a folder's name")
    return cell


def _number(cell: str) -> float | None:
    if not cell:
        return None
    if not re.fullmatch(r"[0-9]+(\.[0-9]+)?", cell) or not 0 < float(cell) < 1e9:
        raise ValueError(f"{cell!r} is not a number above 0")
    return float(cell)


def _heading(cell: str) -> float:
    match = re.fullmatch(r"([0-9]{1,3}(?:\.[0-9]+)?)\s*°\s*([NESW]{1,2})", cell)
    if match is None or float(match[1]) > 360:
        raise ValueError(f"{cell!r} is not a direction such as 328°NW")
    heading_deg = float(match[1]) % 360
    if match[2] not in POINTS:
        raise ValueError(f"{match[2]!r} is not a point of the compass")
    off_deg = (heading_deg - 45 * POINTS.index(match[2]) + 180) % 360 - 180
    if abs(off_deg) > 45 / 2:
        raise ValueError(f"{match[1]}° is not {match[2]} but {orientation(heading_deg)}")
    return heading_deg


def _one_of(choices: dict[str, bool]) -> Callable[[str], bool]:
    def read(cell: str) -> bool:
        if cell not in choices:
            raise ValueError(f"{cell!r} is none of {', '.join(repr(c) for c in choices)}")
        return choices[cell]

    return read
