"""``daylit view-from``: a processed session's room from any place and height inside it."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from processing.light.picture.viewpoint import Elsewhere
    from processing.relighting.session_room import SessionRoom

MOST_PX = 4096


@click.command("view-from")
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--eye", required=True, metavar="X,Y,Z", help="Metres from the floor below the camera: right, ahead, up.")
@click.option("--look", metavar="AZ,EL", help="Degrees to the right of ahead, and up.  [default: 0,0]")
@click.option("--fov", type=click.FloatRange(10, 150), help="Horizontal field of view, degrees.  [default: 70]")
@click.option("--panorama", is_flag=True, help="All around instead of a view.")
@click.option(
    "--width", type=click.IntRange(64, MOST_PX), default=1280, show_default=True, help="Of the picture, pixels."
)
@click.option("--staged", type=click.IntRange(min=1), metavar="N", help="The staged alternative N.")
@click.option(
    "--furniture", type=click.Path(path_type=Path), metavar="FOLDER", help="Your models that it was staged with."
)
@click.option("--empty", is_flag=True, help="The emptied room.  [default]")
@click.option("--quality", type=click.Choice(["draft", "standard"]), default="draft", show_default=True)
@click.option("--name", help="Of the files; default: from the place.")
@click.option("--into", "output", type=click.Path(path_type=Path, file_okay=False), help="Default: SESSION/views.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object at the end.")
def view_from(session: Path, *, as_json: bool, **asked: Any) -> int:
    """Show SESSION's room, empty or staged, from another place than the camera's.

    What the camera saw is shown as it saw it; what it did not see is rendered from the room's materials, and is white
    in NAME-rendered.png. Writes the picture in cd/m2 (EXR) and a JPEG. Needs a session processed with --set.

    \b
    Examples:
      daylit view-from sessions/2023-05-19T1554Z_coda-320 --eye 1.2,-0.5,1.2 --look -30,-5
      daylit view-from sessions/2023-05-19T1554Z_coda-320 --eye 0.5,1,1.6 --panorama --staged 1
    """
    _check(asked)
    from processing.light.picture.viewpoint import check_place, seen_from
    from processing.light.solver.irradiance import EFFORTS
    from processing.relighting.session_room import read_session_room
    from processing.running.choices import go_on_with, remember
    from station.commands.views import numbers

    eye = list(numbers("--eye", asked["eye"], 3, "metres to the right, ahead and up"))
    geometry = _geometry(asked)
    if asked["staged"] is not None:
        asked |= go_on_with(session, {"furniture": asked["furniture"]})
    room = read_session_room(session, asked["staged"], 2048, asked["furniture"])
    if asked["furniture"] is not None:
        remember(session, {"furniture": asked["furniture"]}, by="daylit view-from")
    check_place(room.scene, (eye[0], eye[1], eye[2]))
    effort = EFFORTS[asked["quality"]]
    found = seen_from(room.scene, room.picture.rgb, room.eye_m, geometry, (eye[0], eye[1], eye[2]), effort=effort)
    folder = asked["output"] or session / "views"
    folder.mkdir(parents=True, exist_ok=True)
    kind = "empty" if asked["staged"] is None else f"staged-{asked['staged']}"
    stem = asked["name"] or f"{kind}-from-{'_'.join(f'{v:g}' for v in eye)}"
    facts = _write(folder, stem, session, room, found, (geometry, eye))
    if as_json:
        click.echo(json.dumps({"ok": True, "folder": str(folder), **facts}))
        return 0
    click.echo(f"{100 * facts['seen_share']:.0f} % of what is not window was seen by the camera; the rest is rendered")
    click.echo(f"written to {folder}: {stem}.exr, {stem}.jpg, {stem}-rendered.png")
    return 0


def _check(asked: dict[str, Any]) -> None:
    if asked["empty"] and asked["staged"] is not None:
        raise click.UsageError("--empty and --staged exclude each other")
    if asked["furniture"] is not None and asked["staged"] is None:
        raise click.UsageError("--furniture goes with --staged")
    if asked["name"] is not None and not re.fullmatch(r"[\w][\w .-]{0,99}", asked["name"]):
        raise click.UsageError("--name is a file's name without its ending: letters, digits, blanks, dots, dashes")
    if asked["panorama"] and (asked["look"] is not None or asked["fov"] is not None):
        raise click.UsageError("--look and --fov do nothing beside --panorama")


def _geometry(asked: dict[str, Any]) -> Any:
    from processing.sphere import Equirectangular, Perspective
    from station.commands.views import numbers

    wide = asked["width"] // 2 * 2
    if asked["panorama"]:
        return Equirectangular(wide, wide // 2)
    azimuth, elevation = numbers("--look", asked["look"] or "0,0", 2, "degrees to the right and up")
    if not -89 <= elevation <= 89:
        raise click.UsageError("--look: up or down by 89 degrees at most")
    fov = math.radians(asked["fov"] or 70.0)
    return Perspective(wide, wide * 3 // 4, fov, yaw_rad=math.radians(azimuth), pitch_rad=math.radians(elevation))


def _write(
    folder: Path, stem: str, session: Path, room: SessionRoom, found: Elsewhere, seen: tuple[Any, list[float]]
) -> dict[str, Any]:
    """Write picture, JPEG and mask; return the facts."""
    from processing.pictures.exr import write_exr
    from processing.pictures.masks import write_mask

    solid, (geometry, eye) = ~found.glass, seen
    write_exr(folder / f"{stem}.exr", _picture(room, found, geometry, eye))
    write_mask(folder / f"{stem}-rendered.png", solid & ~found.seen)
    _jpeg(folder / f"{stem}.jpg", session, room, found, geometry)
    return {
        "eye_m": eye,
        "staged": room.staged,
        "seen_share": round(float(found.seen[solid].mean()), 4) if solid.any() else 1.0,
        "error": round(found.error, 4),
        "unit": room.picture.unit,
    }


def _picture(room: SessionRoom, found: Elsewhere, geometry: Any, eye: list[float]) -> Any:
    from dataclasses import replace

    import numpy as np

    from processing.pictures.images import Validity
    from processing.relighting.session_room import MODELLED

    return replace(
        room.picture,
        rgb=found.rgb,
        uncertainty=np.where(found.seen, np.float32(0.1), np.float32(2 * MODELLED)),
        validity=np.full(found.seen.shape, int(Validity.VALID), np.uint8),
        geometry=geometry,
        ghost=None,
        attributes={**room.picture.attributes, "seen_from_m": eye},
    )


def _jpeg(path: Path, session: Path, room: SessionRoom, found: Elsewhere, geometry: Any) -> None:
    from processing.exchange.jpeg_files import PanoramaTags, labelled, write_jpeg
    from processing.exchange.showing import session_shown
    from processing.sphere import Equirectangular

    whole = isinstance(geometry, Equirectangular)
    rgb8 = session_shown(session).display.shown(found.rgb, found.glass, around=whole)
    tags = None
    if whole:
        tags = PanoramaTags.whole(geometry.width_px, geometry.height_px, heading_rad=room.manifest.heading_rad)
    staged = room.staged is not None
    marked = labelled(rgb8, panorama=tags is not None) if staged else rgb8
    write_jpeg(path, marked, panorama=tags, staged=staged, relative=not room.picture.absolute)
