"""What a room is: a floor polygon with walls, a ceiling, windows and doors; small enough to be corrected by hand.

World axes (docs/reference/coordinates.md): metres, origin on the floor below the camera, x right and y ahead of the
panorama's centre, z up. Wall i runs from corner i to corner i + 1; along it, distances are measured from corner i.
"""

import json
import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from processing.errors import ProcessingError, RoomError
from station.session import strict_json
from station.session.folder import Folder, write_file
from station.session.session import SafeText

Length = Annotated[float, Field(ge=-100, le=100)]
HIGHEST_M = 30.0  # chosen: of a ceiling
Height = Annotated[float, Field(gt=0, le=HIGHEST_M)]
Share = Annotated[float, Field(ge=0, le=1)]

CEILING = "ceiling"
Part = Annotated[str, Field(pattern=rf"^({CEILING}|(wall|corner) \d\d?)$")]

MIN_WALL_M = 0.02  # chosen: shorter ones are slips of an editor
MIN_AREA_M2 = 1.0  # chosen: less is no room
MIN_CAMERA_GAP_M = 0.05  # of the camera from every wall
SLACK_M = 0.002  # by which rounding may put an opening beyond its wall


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class OpeningKind(StrEnum):
    """What an opening is."""

    WINDOW = "window"
    DOOR = "door"
    PASSAGE = "passage"
    """Open to another room."""


class Opening(_Part):
    """A rectangle in a wall."""

    kind: OpeningKind
    wall: Annotated[int, Field(ge=0, le=99)]
    start_m: Annotated[float, Field(ge=-SLACK_M, le=200)]
    """Along the wall, from its first corner."""
    end_m: Annotated[float, Field(gt=0, le=200)]
    sill_m: Annotated[float, Field(ge=0, le=30)]
    """Height of the lower edge; 0 for doors."""
    head_m: Height
    """Height of the upper edge."""
    confidence: Share = 1.0


class RoomModel(_Part):
    """A room. Valid by itself as data; `geometry_problems` says whether it can stand."""

    schema_version: Literal[1] = 1
    source: Literal["starter", "estimated", "given"]
    """Where it comes from: "starter" is a placeholder that nobody has corrected yet and is never used."""
    floor: Annotated[tuple[tuple[Length, Length], ...], Field(min_length=3, max_length=100)]
    """Corners, counter-clockwise seen from above."""
    camera_height_m: Annotated[float, Field(gt=0, lt=20)]
    ceiling_height_m: Height
    openings: Annotated[tuple[Opening, ...], Field(max_length=200)] = ()
    confidence: Share = 1.0
    """Of floor and ceiling."""
    note: SafeText = ""
    held: Annotated[tuple[Part, ...], Field(max_length=101, exclude_if=lambda value: not value)] = ()
    """What somebody has placed, and a new estimate keeps: "ceiling", "wall 2", "corner 0"."""

    def wall_length_m(self, wall: int) -> float:
        """Return the length of a wall."""
        return math.dist(self.floor[wall], self.floor[(wall + 1) % len(self.floor)])

    def on_wall(self, wall: int, along_m: float) -> tuple[float, float]:
        """Return x and y, m, of a place so far along a wall from its first corner."""
        (x0, y0), (x1, y1) = self.floor[wall], self.floor[(wall + 1) % len(self.floor)]
        share = along_m / max(self.wall_length_m(wall), 1e-9)
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


def geometry_problems(room: RoomModel) -> list[str]:
    """Say all that is wrong with a room's geometry, each with its key first; empty: it can stand."""
    found = [
        f"floor.{i}: wall {i} is {room.wall_length_m(i):.3f} m long; at least {MIN_WALL_M} m"
        for i in range(len(room.floor))
        if room.wall_length_m(i) < MIN_WALL_M
    ]
    found += _floor_problems(room)
    if room.ceiling_height_m <= room.camera_height_m:
        found.append(f"ceiling_height_m: {room.ceiling_height_m:g} m is not above the camera")
    for index, opening in enumerate(room.openings):
        found += [f"openings.{index}.{problem}" for problem in _opening_problems(room, opening)]
    return found + _overlaps(room)


def _floor_problems(room: RoomModel) -> list[str]:
    from shapely import LinearRing, Point, Polygon
    from shapely.validation import explain_validity

    polygon = Polygon(room.floor)
    if not polygon.is_valid:
        return [f"floor: walls cross or touch each other ({explain_validity(polygon)})"]
    found = []
    if not LinearRing(room.floor).is_ccw:
        found.append("floor: corners run clockwise; list them counter-clockwise seen from above")
    if polygon.area < MIN_AREA_M2:
        found.append(f"floor: {polygon.area:.2f} m2; at least {MIN_AREA_M2:g} m2")
    camera = Point(0.0, 0.0)
    if not polygon.contains(camera):
        found.append("floor: the camera (0, 0) stands outside")
    elif polygon.exterior.distance(camera) < MIN_CAMERA_GAP_M:
        found.append(f"floor: the camera (0, 0) is less than {MIN_CAMERA_GAP_M} m from a wall")
    return found


def _opening_problems(room: RoomModel, opening: Opening) -> list[str]:
    if opening.wall >= len(room.floor):
        return [f"wall: there is no wall {opening.wall}; walls are 0 to {len(room.floor) - 1}"]
    found = []
    length_m = room.wall_length_m(opening.wall)
    if opening.end_m > length_m + SLACK_M:
        found.append(f"end_m: {opening.end_m:g} m is beyond the end of wall {opening.wall} ({length_m:.3f} m)")
    if opening.start_m >= opening.end_m:
        found.append(f"start_m: {opening.start_m:g} m is not before end_m ({opening.end_m:g} m)")
    if opening.sill_m >= opening.head_m:
        found.append(f"sill_m: {opening.sill_m:g} m is not below head_m ({opening.head_m:g} m)")
    if opening.head_m > room.ceiling_height_m + SLACK_M:
        found.append(f"head_m: {opening.head_m:g} m is above the ceiling ({room.ceiling_height_m:g} m)")
    return found


def _overlaps(room: RoomModel) -> list[str]:
    found = []
    for index, one in enumerate(room.openings):
        for other_index, other in enumerate(room.openings[:index]):
            along = min(one.end_m, other.end_m) - max(one.start_m, other.start_m)
            upwards = min(one.head_m, other.head_m) - max(one.sill_m, other.sill_m)
            if one.wall == other.wall and min(along, upwards) > SLACK_M:
                found.append(f"openings.{index}: overlaps openings.{other_index} on wall {one.wall}")
    return found


def starter_room(camera_height_m: float) -> RoomModel:
    """Return a rectangle to correct: 4 m by 5 m, 2.7 m high, one window and one door."""
    return RoomModel(
        source="starter",
        floor=((-2.0, -2.0), (2.0, -2.0), (2.0, 3.0), (-2.0, 3.0)),
        camera_height_m=camera_height_m,
        ceiling_height_m=max(2.7, camera_height_m + 0.5),
        openings=(
            Opening(kind=OpeningKind.WINDOW, wall=2, start_m=1.0, end_m=3.0, sill_m=0.9, head_m=2.1, confidence=0.0),
            Opening(kind=OpeningKind.DOOR, wall=0, start_m=0.5, end_m=1.4, sill_m=0.0, head_m=2.05, confidence=0.0),
        ),
        confidence=0.0,
        note="a placeholder: correct corners, heights and openings, then set source to given",
    )


# A room as JSON that people read and correct: one corner a line, one opening a line, errors that name the key.

MAX_ROOM_BYTES = 1 << 20
STARTER = 'source: "starter": not corrected yet; set it to "given" when the rest is right'


def room_problems(data: Any) -> tuple[RoomModel | None, list[str]]:
    """Return the room in JSON data and all that is wrong with it, each with its key first."""
    if not isinstance(data, dict):
        return None, ["not a JSON object"]
    try:
        room = RoomModel.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as exc:
        return None, strict_json.faults_of(exc)
    return room, [*geometry_problems(room), *([STARTER] if room.source == "starter" else [])]


def check_room(data: Any, where: str = "room model") -> None:
    """Raise `RoomError` listing all that is wrong with a room in JSON data."""
    _, problems = room_problems(data)
    if problems:
        text = "; ".join(problems[:5]) + (f"; and {len(problems) - 5} more" if len(problems) > 5 else "")
        advice = "correct these keys; daylit room SESSION --check FILE lists them all"
        raise RoomError(text, where=where, advice=advice, problems=problems)


def read_json(path: Path, refused: type[ProcessingError] = RoomError, most_bytes: int = MAX_ROOM_BYTES) -> Any:
    """Return the JSON value in a file of at most ``most_bytes``; ``refused`` says what is wrong with it."""
    try:
        with path.open("rb") as file:
            raw = file.read(most_bytes + 1)
        if len(raw) > most_bytes:
            raise strict_json.StrictJsonError(f"larger than {most_bytes} bytes")
        return strict_json.loads(raw)
    except OSError as exc:
        raise refused(f"cannot be read: {exc.strerror}", where=str(path)) from exc
    except strict_json.StrictJsonError as exc:
        raise refused(str(exc), where=str(path), advice="correct the file") from exc


def read_room(path: Path) -> RoomModel:
    """Return the room in a file; `RoomError` lists all that is wrong with it."""
    data = read_json(path)
    check_room(data, str(path))
    return RoomModel.model_validate_json(json.dumps(data))


def room_text(room: RoomModel) -> str:
    """Return a room as JSON text: a corner a line, an opening a line."""
    data = room.model_dump(mode="json")
    lines = []
    for key, value in data.items():
        if isinstance(value, list) and value:
            rows = ",\n".join(f"    {json.dumps(row, ensure_ascii=False)}" for row in value)
            lines.append(f'  "{key}": [\n{rows}\n  ]')
        else:
            lines.append(f'  "{key}": {json.dumps(value, ensure_ascii=False)}')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def write_room(path: Path, room: RoomModel) -> None:
    """Write a room durably; at any instant the old file or the new one stands."""
    with Folder.open(path.parent) as folder:
        write_file(folder, path.name, room_text(room).encode("utf-8"))
