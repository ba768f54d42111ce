"""The paper's 137 sessions as small simulated ones: its names, times, headings and filters, in rooms that cost little.

Rooms are the built-in ones (analytic light), another for each of the paper's 19 scenes, not the generated ones: baking
those would take hours and a batch gains nothing. Pictures are a 24th of full size each way; noise differs in all.
"""

from __future__ import annotations

import csv
import math
import re
from datetime import UTC, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

from benchmarks.seeds import seeds
from benchmarks.sessions import Taken, write_session
from mocks.worlds.simple_room import SimpleRoom
from station.session.session import Site, folder_name

ZONE = "America/New_York"
PLACE = Site(name="Pittsburgh", latitude_deg=40.44, longitude_deg=-79.99)
SESSIONS = 137
DIVISOR = 24


def rows(conditions: Path | None) -> list[dict[str, str]]:
    """Return the conditions' rows; made-up ones where the table is not there."""
    if conditions is not None and conditions.is_file():
        with conditions.open(encoding="utf-8-sig", newline="") as file:
            return list(csv.DictReader(file))[:SESSIONS]
    return [
        {
            "date": f"2023{1 + k % 12:02d}{1 + k % 28:02d}",
            "scene_name": f"room-{k}",
            "theta_time": f"{9 + k % 8}:{k % 60:02d}",
            "orientation": f"{37 * k % 360}°",
            "nd_filter": "YES",
        }
        for k in range(SESSIONS)
    ]


def make_sessions(folder: Path, count: int, conditions: Path | None, seed: int, divisor: int = DIVISOR) -> list[Path]:
    """Write the first ``count`` sessions that are not there yet, and return the folders of all."""
    made = []
    chosen = rows(conditions)[:count]
    scenes = sorted({row["scene_name"] for row in rows(conditions)})
    rooms = dict(zip(scenes, seeds("test", len(scenes), seed), strict=True))
    for index, row in enumerate(chosen, 1):
        local = datetime.strptime(f"{row['date']} {row['theta_time']}", "%Y%m%d %H:%M").replace(tzinfo=ZoneInfo(ZONE))
        name = f"{folder_name(local.astimezone(UTC), row['scene_name'])}-{index}"
        path = folder / name
        made.append(path)
        if (path / "session.json").exists():
            continue
        heading = re.match(r"\d+", row["orientation"])
        taken = Taken(
            SimpleRoom(seed=rooms[row["scene_name"]]),
            divisor=divisor,
            nd=row["nd_filter"].strip().upper() == "YES",
            seed=index,
            begun=local.astimezone(UTC),
            place=PLACE,
            heading_rad=math.radians(float(heading[0])) if heading else None,
        )
        path.mkdir(parents=True, exist_ok=True)
        write_session(path, taken)
    return made
