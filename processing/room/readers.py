"""Room layouts of others: ZInD, PanoAnnotator and LED2-Net, HorizonNet; into our world and metres.

Each format has its own axes, and a mirrored room looks right at first sight. In all of them the panorama's middle
column looks along our +y and what is right of it lies towards +x:

=============  ====================================================================================================
ZInD           vertices (x, y) in camera heights; longitude atan2(-x, y): our x is -x, our y is y
PanoAnnotator  xyz metres, y up (or the camera's height throughout); longitude atan2(x, -z): our x is x, our y is -z
HorizonNet     pixels of a 1024 x 512 picture, for each corner one row of the ceiling's and one of the floor's place
=============  ====================================================================================================

ZInD counts u over W - 1 pixels (the first column's middle is longitude -pi), which matters only to its pictures: its
vertices are geometry already. HorizonNet's pixel middles are integers.
"""

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from processing.errors import LayoutFileError, RoomError
from processing.ground.arrays import Doubles
from processing.ground.polygons import signed_area
from processing.ground.room_model import Opening, OpeningKind, RoomModel, geometry_problems, read_json
from station.session.strict_json import StrictJsonError, faults_of, loads

# Openings given by two places of the plan: which wall they are in, and where along it.
OFF_WALL_M = 0.15
SHORTEST_M = 0.05  # chosen: less is an error of drawing


def opening_on_wall(
    floor: Doubles, ends: Doubles, heights_m: Doubles, kind: OpeningKind, ceiling_m: float
) -> list[Opening]:
    """Return the opening between two places (2, 2) of the plan on the wall they lie on; nothing where that is none.

    ``floor`` (N, 2) counter-clockwise; ``heights_m`` (2,) of its lower and upper edge, held within the wall.
    """
    start, following = floor, np.roll(floor, -1, axis=0)
    length = np.hypot(*(following - start).T)
    along = (following - start) / np.maximum(length, 1e-9)[:, None]
    offset = ends[:, None] - start
    off = np.abs(offset[..., 0] * along[:, 1] - offset[..., 1] * along[:, 0]).max(axis=0)
    place = (offset * along).sum(axis=-1)
    beyond = np.maximum(np.maximum(-place, place - length), 0).max(axis=0)
    wall = int(np.argmin(off + beyond))
    if off[wall] + beyond[wall] > OFF_WALL_M:
        return []
    low, high = np.clip(np.sort(place[:, wall]), 0, length[wall])
    sill, head = np.clip(np.sort(heights_m), 0, ceiling_m)
    if kind is not OpeningKind.WINDOW and sill < SHORTEST_M:
        sill = 0.0
    if high - low < SHORTEST_M or head - sill < SHORTEST_M:
        return []
    start_m, end_m, sill_m, head_m = (round(float(v), 5) for v in (low, high, sill, head))
    return [Opening(kind=kind, wall=wall, start_m=start_m, end_m=end_m, sill_m=sill_m, head_m=head_m)]


LayoutFormat = Literal["zind", "led2net", "horizonnet"]

MOST_BYTES = 64 << 20
WIDTH_PX, HEIGHT_PX = 1024, 512
LARGEST = 1e4  # metres, or pixels of a corner; chosen: beyond any room's
_ZIND_KINDS = {"windows": OpeningKind.WINDOW, "doors": OpeningKind.DOOR, "openings": OpeningKind.PASSAGE}


def read_layout(
    path: Path, layout_format: LayoutFormat, *, camera_height_m: float | None = None, panorama: str | None = None
) -> RoomModel:
    """Return the room in another program's file.

    ``camera_height_m``: sets the scale; None: the file's own (PanoAnnotator), else 1.6 m.
    ``panorama``: of a ZInD file, which picture's room: its name or a part of it that only one has.
    Raises `LayoutFileError`: cannot be read, is damaged, or is no room; names the key, the line or what is wrong with
    the room.
    """
    try:
        if layout_format == "horizonnet":
            return horizonnet_room(_text(path), camera_height_m=camera_height_m or 1.6)
        data = loads(_text(path).encode("utf-8")) if layout_format == "zind" else read_json(path)
        if layout_format == "zind":
            return zind_room(zind_picture(data, panorama), camera_height_m=camera_height_m or 1.6)
        return panoannotator_room(data, camera_height_m=camera_height_m)
    except LayoutFileError as error:
        raise LayoutFileError(
            error.message, where=f"{path} {error.where}".strip(), likely=error.likely, advice=error.advice
        ) from error
    except (RoomError, StrictJsonError) as error:
        raise LayoutFileError(str(error)[:300], where=str(path)) from error


def zind_pictures(data: Any) -> dict[str, dict[str, Any]]:
    """Return the pictures of a ZInD file's floors by name (floor_01_partial_room_01_pano_14)."""
    found: dict[str, dict[str, Any]] = {}
    for floor, rooms in _entry(data, "merger", dict).items():
        for _, complete in _items(rooms, f"merger.{floor}"):
            for partial_name, partial in _items(complete, f"merger.{floor}"):
                for name, picture in _items(partial, partial_name):
                    found[f"{floor}_{partial_name}_{name}"] = picture
    return found


def zind_picture(data: Any, panorama: str | None) -> dict[str, Any]:
    """Return one picture of a ZInD file; `LayoutFileError` lists the names where the one asked for is not there."""
    pictures = zind_pictures(data)
    chosen = [name for name in pictures if panorama is None or panorama in name]
    if panorama is not None and panorama in pictures:
        chosen = [panorama]
    exact = [name for name in chosen if panorama is not None and name.endswith(panorama)]
    chosen = exact if len(exact) == 1 else chosen
    if len(chosen) != 1:
        names = ", ".join(sorted(pictures)[:12])
        raise LayoutFileError(f"{len(chosen)} pictures fit {panorama!r}", advice=f"choose with --panorama: {names}")
    return pictures[chosen[0]]


def zind_room(picture: Any, *, camera_height_m: float = 1.6, layout: str = "layout_raw") -> RoomModel:
    """Return a ZInD picture's room; ``layout`` layout_raw, layout_visible or layout_complete."""
    found = _entry(picture, layout, dict)
    vertices = _pairs(_entry(found, "vertices", list), f"{layout}.vertices")
    ceiling = _number(_entry(picture, "ceiling_height", (int, float)), "ceiling_height")
    camera = _number(_entry(picture, "camera_height", (int, float)), "camera_height")
    if camera <= 0 or ceiling <= camera:
        raise LayoutFileError(f"a ceiling of {ceiling:g} over a camera at {camera:g}", where="ceiling_height")
    if len(vertices) < 3:
        raise LayoutFileError(f"{len(vertices)} corners", where=f"{layout}.vertices")
    scale = camera_height_m / camera
    floor = vertices * np.array([-1.0, 1.0]) * scale
    openings: list[Opening] = []
    for key, kind in _ZIND_KINDS.items():
        listed = found.get(key, [])
        if not isinstance(listed, list) or len(listed) % 3:
            raise LayoutFileError("not triples of two corners and two heights", where=f"{layout}.{key}")
        places = _pairs(listed, f"{layout}.{key}")
        for k in range(0, len(places), 3):
            ends = places[k : k + 2] * np.array([-1.0, 1.0]) * scale
            heights = (places[k + 2] + camera) * scale
            openings += opening_on_wall(_clockwise_to_counter(floor), ends, heights, kind, ceiling * scale)
    return _room(floor, camera_height_m, ceiling * scale, tuple(openings), "ZInD")


def panoannotator_room(data: Any, *, camera_height_m: float | None = None) -> RoomModel:
    """Return the room of a PanoAnnotator or LED2-Net file (``layoutPoints.points[].xyz`` in wall order)."""
    camera = _number(_entry(data, "cameraHeight", (int, float)), "cameraHeight")
    height = _number(_entry(data, "layoutHeight", (int, float)), "layoutHeight")
    points = _entry(_entry(data, "layoutPoints", dict), "points", list)
    places = []
    for k, point in enumerate(points):
        xyz = _entry(point, "xyz", list, f"layoutPoints.points.{k}")
        if len(xyz) != 3:
            raise LayoutFileError(f"{len(xyz)} numbers, not 3", where=f"layoutPoints.points.{k}.xyz")
        x, _, z = (_number(v, f"layoutPoints.points.{k}.xyz") for v in xyz)
        places.append((x, -z))
    if not 0 < camera < height:
        raise LayoutFileError(f"a room {height:g} high with the camera at {camera:g}", where="layoutHeight")
    scale = 1.0 if camera_height_m is None else camera_height_m / camera
    return _room(np.array(places).reshape(-1, 2) * scale, camera * scale, height * scale, (), "PanoAnnotator")


def horizonnet_room(text: str, *, camera_height_m: float = 1.6) -> RoomModel:
    """Return the room of a HorizonNet label: lines "x y", ceiling and floor of each corner in turn, by columns."""
    rows = []
    for number, line in enumerate((part for part in text.splitlines() if part.strip()), start=1):
        try:
            x, y = (float(v) for v in line.split())
        except ValueError as exc:
            raise LayoutFileError("not two numbers", where=f"line {number}") from exc
        if not (math.isfinite(x) and math.isfinite(y) and -1 <= x <= WIDTH_PX and -1 <= y <= HEIGHT_PX):
            raise LayoutFileError(f"({x:g}, {y:g}) is outside a 1024 x 512 picture", where=f"line {number}")
        rows.append((x, y))
    if len(rows) < 6 or len(rows) % 2:
        raise LayoutFileError(f"{len(rows)} lines; each corner has two, and a room three corners or more")
    places = np.array(rows)
    ceiling, floor = places[0::2], places[1::2]
    up = (0.5 - (ceiling[:, 1] + 0.5) / HEIGHT_PX) * math.pi
    down = (0.5 - (floor[:, 1] + 0.5) / HEIGHT_PX) * math.pi
    if (up <= 0).any() or (down >= 0).any():
        wrong = int(np.argmax((up <= 0) | (down >= 0)))
        why = "a ceiling corner below or a floor corner above the horizon"
        raise LayoutFileError(why, where=f"line {2 * wrong + 1}", likely="the lines are not in turn ceiling, floor")
    reach = camera_height_m / np.tan(-down)
    longitude = ((places[1::2, 0] + 0.5) / WIDTH_PX - 0.5) * 2 * math.pi
    corners = np.stack([reach * np.sin(longitude), reach * np.cos(longitude)], axis=-1)
    height = camera_height_m + float(np.median(reach * np.tan(up)))
    return _room(corners, camera_height_m, height, (), "HorizonNet")


def _room(floor: Doubles, camera_m: float, ceiling_m: float, openings: tuple[Opening, ...], source: str) -> RoomModel:
    corners = _clockwise_to_counter(floor)
    try:
        room = RoomModel(
            source="given",
            floor=tuple((round(float(x), 5), round(float(y), 5)) for x, y in corners),
            camera_height_m=camera_m,
            ceiling_height_m=round(ceiling_m, 5),
            openings=openings,
            note=f"read from a {source} layout",
        )
    except ValidationError as exc:
        raise LayoutFileError(faults_of(exc)[0]) from exc
    problems = geometry_problems(room)
    if problems:
        raise LayoutFileError("; ".join(problems[:3]), likely="corners out of order, or another scale")
    return room


def _clockwise_to_counter(floor: Doubles) -> Doubles:
    """Return corners counter-clockwise, without a repeated last one."""
    corners = floor[:-1] if len(floor) > 3 and np.allclose(floor[0], floor[-1]) else floor
    return corners if signed_area(corners) > 0 else corners[::-1]


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
        if len(raw) > MOST_BYTES:
            raise LayoutFileError(f"larger than {MOST_BYTES} bytes")
        return raw.decode("utf-8-sig")
    except OSError as exc:
        raise LayoutFileError(f"cannot be read: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise LayoutFileError("is not text") from exc


def _entry(data: Any, key: str, kind: Any, where: str = "") -> Any:
    place = f"{where}.{key}" if where else key
    if not isinstance(data, dict) or key not in data:
        raise LayoutFileError("is missing", where=place)
    value = data[key]
    if not isinstance(value, kind) or isinstance(value, bool):
        raise LayoutFileError(f"is of type {type(value).__name__}", where=place)
    return value


def _items(data: Any, where: str) -> list[tuple[str, Any]]:
    if not isinstance(data, dict):
        raise LayoutFileError(f"is of type {type(data).__name__}, not an object", where=where)
    return list(data.items())


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise LayoutFileError("is not a finite number", where=where)
    if abs(value) > LARGEST:
        raise LayoutFileError(f"is {value:g}, larger than any room", where=where)
    return float(value)


def _pairs(values: list[Any], where: str) -> Doubles:
    rows = []
    for k, row in enumerate(values):
        if not isinstance(row, list) or len(row) != 2:
            raise LayoutFileError("is not a pair of numbers", where=f"{where}.{k}")
        rows.append([_number(v, f"{where}.{k}") for v in row])
    return np.array(rows, dtype=np.float64).reshape(-1, 2)
