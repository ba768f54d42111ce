"""The sessions that a data set is to have: each a generated room at a moment, from conditions or by seed."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from station.errors import ConditionsError, SessionError, SessionExistsError
from station.session.folder import Folder, write_file
from station.session.session import SessionManifest, Site, folder_name
from station.simulate.conditions import COLUMNS, DAYLIGHT_ONLY, WITH_LAMPS, Condition, load_conditions, orientation

if TYPE_CHECKING:
    from mocks.rooms.room import Room
    from mocks.rooms.sky.daylight import Moment
    from mocks.rooms.world import RoomWorld
    from station.capture.rig_file import RigFile

# dataset.csv: what a data set of simulated sessions holds, a row a session, in the columns of the conditions.

LEDGER_NAME = "dataset.csv"
MADE_WITH = ("size", "quality", "clouds", "seed")  # options that are the same for all sessions of one data set
LEDGER_COLUMNS = (*COLUMNS, "utc", "latitude_deg", "longitude_deg", "room_seed", "room", "sky", *MADE_WITH, "session")

Row = dict[str, str]
SITE_DEG = (40.44, -79.99)  # Pittsburgh, where the paper's sessions were taken
ZONE = "America/New_York"
SESSIONS = 137  # as many as the paper has
CLOCK_RATE = 10.0
"""How much faster than life a session runs: faster, and the computer's own scheduling opens shutters apart."""


class Ledger:
    """The rows of dataset.csv by session folder; every change is on disk when it returns."""

    def __init__(self, folder: Path) -> None:
        """Read what is there; raises `SessionError` for a dataset.csv that is not ours or is damaged."""
        self.path = folder / LEDGER_NAME
        self.rows: dict[str, Row] = {}
        try:
            text = self.path.read_text("utf-8-sig")
        except FileNotFoundError:
            return
        except (OSError, UnicodeDecodeError) as error:
            raise SessionError(f"cannot be read: {error}", where=str(self.path)) from error
        reader = csv.DictReader(io.StringIO(text, newline=""), restkey="")
        if tuple(reader.fieldnames or ()) != LEDGER_COLUMNS:
            raise SessionError("has other columns than daylit's", where=str(self.path), advice="choose another folder")
        for row in reader:
            if None in row.values() or "" in row:
                raise SessionError(f"line {reader.line_num} is damaged", where=str(self.path), advice="delete it")
            self.rows[row["session"]] = dict(row)

    def require_same(self, made_with: Mapping[str, str]) -> None:
        """Refuse to mix sessions made with other options (`SessionExistsError`)."""
        for row in self.rows.values():
            for key in MADE_WITH:
                if row[key] != made_with[key]:
                    text = f"holds sessions made with {key} {row[key]}, not {made_with[key]}"
                    advice = "use the same options as before, or another folder"
                    raise SessionExistsError(text, where=str(self.path.parent), advice=advice)

    def put(self, row: Row) -> None:
        """Add or replace the row of a session."""
        self.rows[row["session"]] = row
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, LEDGER_COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(sorted(self.rows.values(), key=lambda r: (int(r["index"]), r["session"])))
        with Folder.open(self.path.parent) as folder:
            write_file(folder, LEDGER_NAME, text.getvalue().encode())


@dataclass(frozen=True)
class DatasetRequest:
    """What to make. Without ``conditions`` rooms are drawn by seed, from ``seed`` upwards.

    ``sessions`` None makes one of each condition, or `SESSIONS`. ``size`` and ``quality`` are keys of
    `station.capture.rig.SIZE_STEPS` and `mocks.rooms.light.light.QUALITIES`.
    """

    into: Path
    conditions: Path | None = None
    sessions: int | None = None
    use: str | None = None
    size: str = "full"
    quality: str = "standard"
    seed: int = 0
    clouds: bool = False
    truth: bool = True
    truth_rows: int = 512
    clock_rate: float = CLOCK_RATE

    @property
    def made_with(self) -> dict[str, str]:
        """Return the options that all sessions of a data set share."""
        clouds = "yes" if self.clouds else "no"
        return {"size": self.size, "quality": self.quality, "clouds": clouds, "seed": str(self.seed)}


@dataclass(frozen=True)
class Planned:
    """A session that is to be: its room under the sky of its moment, and what is photographed."""

    index: int
    name: str
    folder: str
    local: datetime
    """The start, in local time."""
    room: Room
    outdoor_local: datetime | None
    nd_filter: bool

    @property
    def heading_deg(self) -> float:
        """Return the compass azimuth of the panorama's centre."""
        return math.degrees(self.room.moment.heading_rad)


@dataclass(frozen=True)
class Draft:
    """A session by a name for messages, and how to make its room (a second or two)."""

    name: str
    build: Callable[[], Planned]


def plan_sessions(request: DatasetRequest) -> list[Draft]:
    """Return the sessions that there will be; their rooms are made one by one, when they are wanted.

    Raises `ConditionsError`: conditions that cannot be right.
    """
    if request.conditions is None:
        count = SESSIONS if request.sessions is None else request.sessions
        seeds = range(request.seed, request.seed + count)
        return [Draft(f"room {seed}", partial(_drawn, request, seed)) for seed in seeds]
    conditions = load_conditions(request.conditions)[: request.sessions]
    _require_daylight(conditions, request.conditions)
    taken: Counter[str] = Counter()
    drafts = []
    for condition in conditions:
        folder = folder_name(_moment(condition).utc, condition.scene)
        taken[folder] += 1
        number = f"-{taken[folder]}" if taken[folder] > 1 else ""
        drafts.append(Draft(folder + number, partial(_conditioned, request, condition, folder + number)))
    return drafts


def _drawn(request: DatasetRequest, seed: int) -> Planned:
    from mocks.rooms.room import make_room

    room = make_room(seed, request.use)
    # The zone that ships keep; laws do not matter here.
    local = room.moment.utc.astimezone(timezone(timedelta(hours=round(room.moment.longitude_deg / 15))))
    folder = folder_name(room.moment.utc, room.name)
    return Planned(seed + 1, room.name, folder, local, room, outdoor_local=local, nd_filter=True)


def _conditioned(request: DatasetRequest, condition: Condition, folder: str) -> Planned:
    from mocks.rooms.room import scene_room

    room = scene_room(
        condition.scene,
        _moment(condition),
        use=request.use,
        seed=request.seed,
        lamps_on=condition.lamps_on,
        illuminance_lux=condition.illuminance_lux,
    )
    outdoor = _zoned(condition.outdoor_local) if condition.outdoor_local else None
    index, name, local = condition.index, condition.scene, _zoned(condition.local)
    return Planned(index, name, folder, local, room, outdoor_local=outdoor, nd_filter=condition.nd_filter)


def _zoned(local: datetime) -> datetime:
    return local.replace(tzinfo=ZoneInfo(ZONE))


def _moment(condition: Condition) -> Moment:
    from mocks.rooms.sky.daylight import Moment

    return Moment(*SITE_DEG, _zoned(condition.local).astimezone(UTC), math.radians(condition.heading_deg))


def _require_daylight(conditions: list[Condition], path: Path) -> None:
    from mocks.rooms.sky.daylight import sun_of

    night = [c for c in conditions if sun_of(_moment(c))[1] <= 0]
    if night:
        faults = [f"line {c.line}, column theta_time: the sun is down at {c.local:%Y-%m-%d %H:%M}" for c in night]
        raise ConditionsError("; ".join(faults[:8]), where=str(path), advice="remove these rows", faults=faults)


def rig_file(plan: Planned) -> RigFile:
    """Return the paper's rig as it stood there."""
    from station.capture.rig_file import PAPER_OUTDOOR, PAPER_RIG

    moment = plan.room.moment
    site = Site(latitude_deg=moment.latitude_deg, longitude_deg=moment.longitude_deg)
    outdoor = PAPER_OUTDOOR if plan.nd_filter else PAPER_OUTDOOR.model_copy(update={"nd_filter": ""})
    return PAPER_RIG.model_copy(
        update={
            "site": site,
            "heading_deg": round(plan.heading_deg, 4),
            "camera_height_m": plan.room.plan.camera_height_m,
            "outdoor": outdoor if plan.outdoor_local else None,
        }
    )


def room_world(plan: Planned, request: DatasetRequest) -> RoomWorld:
    """Return the room as the instruments see it."""
    from mocks.rooms.room import clouds_of
    from mocks.rooms.world import RoomWorld

    clouds = (clouds_of(plan.room),) if request.clouds else ()
    return RoomWorld(plan.room, request.quality, *clouds)


def row_of(plan: Planned, manifest: SessionManifest, request: DatasetRequest) -> Row:
    """Return the session's row of dataset.csv: what was measured and what is true, not what was asked for."""
    room, outdoor = plan.room, plan.outdoor_local
    reading = next((r.luminance_cd_m2 for r in manifest.readings if r.luminance_cd_m2 is not None), None)
    return {
        "index": str(plan.index),
        "date": f"{plan.local:%Y%m%d}",
        "scene_name": plan.name,
        "theta_time": f"{plan.local.hour}:{plan.local:%M}",
        "luminance_cd_m2": "" if reading is None else f"{reading:.2f}",
        "fisheye_time": f"{outdoor.hour}:{outdoor:%M}" if outdoor else "",
        "illuminance_lux": f"{sum(room.sky.horizontal_illuminance_lx()):.0f}" if outdoor else "",
        "orientation": orientation(plan.heading_deg),
        "nd_filter": ("YES" if plan.nd_filter else "NO") if outdoor else "",
        "natural_light": WITH_LAMPS if room.lamps_on else DAYLIGHT_ONLY,
        "utc": f"{room.moment.utc:%Y-%m-%dT%H:%MZ}",
        "latitude_deg": f"{room.moment.latitude_deg:g}",
        "longitude_deg": f"{room.moment.longitude_deg:g}",
        "room_seed": str(room.seed),
        "room": room.name,
        "sky": room.sky.kind,
        **request.made_with,
        "session": plan.folder,
    }
