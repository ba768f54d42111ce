"""A room as JSON that people read and correct: one corner a line, one opening a line, errors that name the key."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from processing.errors import RoomError
from processing.room.model import RoomModel, geometry_problems
from station import strict_json
from station.folder import Folder, write_file

MAX_ROOM_BYTES = 1 << 20
STARTER = 'source: "starter": nobody has corrected it yet; set it to "given" when the rest is right'


def room_problems(data: Any) -> tuple[RoomModel | None, list[str]]:
    """Return the room in JSON data and all that is wrong with it, each with its key first."""
    if not isinstance(data, dict):
        return None, ["not a JSON object"]
    try:
        room = RoomModel.model_validate_json(json.dumps(data))
    except ValidationError as exc:
        errors = exc.errors(include_url=False, include_input=False, include_context=False)
        return None, [f"{'.'.join(str(part)[:60] for part in e['loc'])}: {e['msg']}" for e in errors]
    return room, [*geometry_problems(room), *([STARTER] if room.source == "starter" else [])]


def check_room(data: Any) -> None:
    """Raise `RoomError` listing all that is wrong with a room in JSON data."""
    _, problems = room_problems(data)
    if problems:
        raise RoomError(
            "; ".join(problems[:5]) + (f"; and {len(problems) - 5} more" if len(problems) > 5 else ""),
            where="room model",
            advice="correct these keys; daylit room SESSION --check FILE lists them all",
            problems=problems,
        )


def read_json(path: Path) -> Any:
    """Return the JSON value in a file; `RoomError` where there is none or it is not JSON."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_ROOM_BYTES + 1)
    except OSError as exc:
        raise RoomError(f"cannot be read: {exc.strerror}", where=str(path)) from exc
    if len(raw) > MAX_ROOM_BYTES:
        raise RoomError(f"larger than {MAX_ROOM_BYTES} bytes", where=str(path))
    try:
        return strict_json.loads(raw)
    except strict_json.StrictJsonError as exc:
        raise RoomError(str(exc), where=str(path), advice="correct the file") from exc


def read_room(path: Path) -> RoomModel:
    """Return the room in a file; `RoomError` lists all that is wrong with it."""
    data = read_json(path)
    check_room(data)
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
    folder = Folder.open(path.parent)
    try:
        write_file(folder, path.name, room_text(room).encode("utf-8"))
    finally:
        folder.close()
