"""``daylit room``: correct a room's model by hand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import answer, parameters

if TYPE_CHECKING:
    from processing.ground.room_model import RoomModel

ROOM_FILE = "room.json"


@click.command(params=parameters(__package__, "room"))
def room(
    session: Path,
    *,
    edit: bool,
    start: Path | None,
    imported: str | None,
    panorama: str | None,
    around: bool,
    check: Path | None,
    as_json: bool,
) -> int:
    """Correct SESSION's room by hand: floor corners, heights, windows and doors, in metres, as JSON.

    After --edit, `daylit process` uses SESSION/room.json (--forget room returns to the estimated one).

    Wall i runs from corner i to corner i + 1; corners run counter-clockwise seen from above; the camera stands at
    (0, 0), x is right and y ahead of the panorama's centre.

    \b
    Examples:
      daylit room sessions/2023-05-19T1554Z_coda-320 --edit
      daylit room sessions/2023-05-19T1554Z_coda-320 --edit --import zind --from zind_data.json --panorama pano_15
      daylit room sessions/2023-05-19T1554Z_coda-320 --around
      daylit room sessions/2023-05-19T1554Z_coda-320 --check room.json --json
    Exit code: 0 the room is valid · 1 it has faults.
    """
    from processing.errors import ParameterError
    from processing.running.choices import remember
    from station.session.store import load_manifest

    if (edit, around, check is not None).count(True) != 1 or (start and not edit):
        raise ParameterError("give either --edit (with --from if wanted), --around, or --check FILE")
    if (imported and not start) or (panorama and not imported):
        raise ParameterError("--import needs --from FILE, and --panorama needs --import")
    manifest = load_manifest(session)
    path = check or session / ROOM_FILE
    if edit:
        _prepare(path, start, _beginning(session, start, (imported, panorama), manifest.camera_height_m))
        if sys.stdin.isatty() and sys.stdout.isatty() and not as_json:
            click.edit(filename=str(path))
        remember(session, {"room": path}, by="daylit room --edit")
    if around:
        _estimate_around(session, path)
    return _show(path, as_json=as_json)


def _beginning(
    session: Path, start: Path | None, imported: tuple[str | None, str | None], camera_height_m: float
) -> RoomModel:
    """Return the room to begin with: the one given, the one that the stage room has estimated, or a rectangle."""
    from processing.ground.room_model import read_room, starter_room

    layout_format, panorama = imported
    if start and layout_format:
        from processing.room.readers import read_layout

        return read_layout(start, layout_format, camera_height_m=camera_height_m, panorama=panorama)  # type: ignore[arg-type]
    if start:
        return read_room(start)
    estimated = session / "stages" / "room" / ROOM_FILE
    return read_room(estimated) if estimated.exists() else starter_room(camera_height_m)


def _prepare(path: Path, start: Path | None, begin: RoomModel) -> None:
    """Put a room to edit in its place, unless there is one already."""
    from processing.errors import ParameterError
    from processing.ground.room_model import write_room

    if start and path.exists() and start.resolve() != path.resolve():
        raise ParameterError("--from: a room already exists", where=str(path), advice="move it, or leave out --from")
    if start or not path.exists():
        write_room(path, begin)


def _estimate_around(session: Path, path: Path) -> None:
    from processing.ground.room_model import read_room, write_room
    from processing.running.choices import remember
    from processing.running.room_anew import room_around

    if not path.exists():
        raise click.UsageError(f"--around: there is no {path} yet; make it with: daylit room SESSION --edit")
    write_room(path, room_around(session, read_room(path)).model_copy(update={"source": "given", "confidence": 1.0}))
    remember(session, {"room": path}, by="daylit room --around")


def _show(path: Path, *, as_json: bool) -> int:
    from processing.ground.room_model import read_json, room_problems

    found, problems = room_problems(read_json(path))
    facts = _facts(found)
    if problems:
        lines = [*problems, f"to correct in {path}: {len(problems)}; then: daylit room SESSION --check {path}"]
    else:
        size = f"{facts['walls']} walls, {facts['area_m2']:.2f} m2, openings: {facts['openings']}"
        lines = [f"{path}: {size}; valid"]
    facts = {"ok": not problems, "file": str(path), "problems": problems, **facts}
    return answer(facts, lines, as_json=as_json, exit_code=1 if problems else 0)


def _facts(room_: RoomModel | None) -> dict[str, Any]:
    """Return what helps to see whether it is the right room."""
    if room_ is None:
        return {}
    import numpy as np

    from processing.ground.polygons import signed_area

    area_m2 = round(signed_area(np.array(room_.floor)), 4)
    return {"walls": len(room_.floor), "area_m2": area_m2, "openings": len(room_.openings)}
