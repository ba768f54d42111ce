"""``daylit relight``: a processed room at another time, under another sky; ``daylit view-from``: from another place."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import answer, numbers, parameters

if TYPE_CHECKING:
    from processing.exchange.jpeg_files import Made
    from processing.light.picture.viewpoint import Elsewhere
    from processing.relighting.relit_session import Relighting, SessionRoom


SHEET_ROWS, ANIMATION_ROWS = 192, 384
KEPT = ("furniture", "site", "heading", "zone")  # options that the session remembers


@click.command(params=parameters(__package__, "relight"))
def relight(session: Path, *, as_json: bool, **asked: Any) -> int:
    """Relight SESSION's room, emptied or staged: for another time, another sky or a whole day.

    Needs a session processed with furniture (--set). The captured weather follows the sun: sky clearness and colour are
    kept. Writes pictures in cd/m2 (EXR) and as JPEG; a sweep writes JPEGs, a contact sheet and an animation (WebP). The
    light basis is cached in SESSION/relight. --furniture, --site, --heading and --zone are saved with the session.

    \b
    Examples:
      daylit relight sessions/2023-05-19T1554Z_coda-320 --at "2023-06-21 16:00"
      daylit relight sessions/2023-05-19T1554Z_coda-320 --sweep day --staged 1 --step 30m
      daylit relight sessions/2023-05-19T1554Z_coda-320 --sky other/stages/calibrate/outdoor.exr
    """
    from processing.exchange.showing import session_shown, standing_sha256
    from processing.light.solver.basis import BASIS_EFFORTS
    from processing.relighting.relit_session import FOLDER, Relighting, check_sky, read_session_room
    from processing.running.choices import go_on_with, remember

    _check(asked)
    given = {name: asked[name] for name in KEPT}
    asked |= go_on_with(session, given)
    own = None if asked["staged"] is None else asked["furniture"]
    room = read_session_room(session, asked["staged"], asked["rows"], own)
    if asked["heading"] is not None:  # the pictures name it, too
        room = replace(room, manifest=room.manifest.model_copy(update={"heading_rad": math.radians(asked["heading"])}))
    check_sky(room)
    folder = asked["output"] or session / FOLDER
    moments = _moments(room, asked) | {"shown": session_shown(session)}
    remember(session, given, by="daylit relight")
    ready = Relighting(room, session / FOLDER, BASIS_EFFORTS[asked["quality"]])
    folder.mkdir(parents=True, exist_ok=True)
    name = _name(room)
    moments |= {"made": _made(session, room, "relit", folder), "of": standing_sha256(session, name)}
    found = (_sweep if asked["sweep"] else _one)(ready, moments, folder, name)
    then = "" if asked["output"] else f"; to add it to the report: daylit process {session}"
    lines = (*(f"note: {note}" for note in found["notes"]), *map(_line, found["moments"]), f"written to {folder}{then}")
    return answer({"ok": True, "folder": str(folder), **found}, lines, as_json=as_json)


def _check(asked: dict[str, Any]) -> None:
    if sum(asked[name] is not None for name in ("at", "sky", "sweep")) != 1:
        raise click.UsageError("give one of --at TIME, --sky FILE and --sweep day")
    _check_staged(asked)
    for name in ("date", "step"):
        if asked[name] is not None and not asked["sweep"]:
            raise click.UsageError(f"--{name} needs --sweep")
    if asked["sky"] is not None:
        for name in ("site", "heading", "zone"):
            if asked[name] is not None:
                raise click.UsageError(f"--{name.replace('_', '-')} has no effect with --sky")
        if asked["weather"] != "captured":
            raise click.UsageError("--weather has no effect with --sky")


def _check_staged(asked: dict[str, Any]) -> None:
    if asked["empty"] and asked["staged"] is not None:
        raise click.UsageError("--empty and --staged cannot be combined")
    if asked["furniture"] is not None and asked["staged"] is None:
        raise click.UsageError("--furniture needs --staged")


def _moments(room: SessionRoom, asked: dict[str, Any]) -> dict[str, Any]:
    """Return the lights to show: notes, and for each a name, a caption, the light outdoors and its facts."""
    from processing.light.picture.relight_photo import with_captured_land
    from processing.relighting.live import Outside
    from processing.relighting.relit_session import other_sky
    from processing.relighting.weather import day_times, parse_time, sky_facts

    if asked["sky"] is not None:
        outdoors = with_captured_land(other_sky(asked["sky"]), room.scene.outdoors)
        stem = re.sub(r"[^\w-]+", "-", asked["sky"].stem)
        note = "the sky's +y is aligned with the room's; ground, trees and houses are as captured"
        lights = [(f"sky-{stem}", stem, outdoors, sky_facts(outdoors))]
        return {"modelled": False, "notes": [note], "lights": lights}
    outside = Outside.of(room, asked["weather"], asked)
    if asked["at"]:
        times = [parse_time(asked["at"], outside.zone)]
    else:
        day = parse_time(asked["date"], outside.zone) if asked["date"] else room.time_utc
        times = day_times(day, outside.place, outside.zone, _step(asked["step"] or "1h"))
    lights, other = [], "" if asked["weather"] == "captured" else f"-{asked['weather']}"
    for time_utc in times:
        outdoors, facts = outside.at(time_utc)
        local = time_utc.astimezone(outside.zone)
        elevation_deg, klx = facts["sun_elevation_deg"], facts["global_horizontal_lx"] / 1000
        caption = f"{local:%H:%M}  sun {elevation_deg:.0f}°  {klx:.0f} klx outdoors"
        lights.append((f"{local:%Y-%m-%dT%H%M}{other}", caption, outdoors, facts))
    return {"modelled": True, "notes": list(outside.notes), "lights": lights}


def _step(text: str) -> Any:
    from datetime import timedelta

    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(h|m|min)?", text.strip())
    if not found:
        raise click.UsageError("--step is a time such as 30m or 1h")
    return timedelta(**{"hours" if (found[2] or "h") == "h" else "minutes": float(found[1])})


def _one(ready: Relighting, moments: dict[str, Any], folder: Path, name: str) -> dict[str, Any]:
    from processing.pictures.exr import write_exr

    stem, _, outdoors, said = moments["lights"][0]
    relit = ready.under(outdoors, said, modelled_sky=moments["modelled"])
    picture = relit.picture
    write_exr(folder / f"{name}-{stem}.exr", picture)
    shown = moments["shown"]
    rgb8 = replace(shown, display=shown.display.exposed(picture.rgb)).rgb8(picture.rgb, ready.room.picture.geometry)
    _jpeg(folder / f"{name}-{stem}.jpg", rgb8, ready.room, moments["made"])
    return _summary(ready, moments, [relit.facts], folder / f"{name}-{stem}.json")


def _sweep(ready: Relighting, moments: dict[str, Any], folder: Path, name: str) -> dict[str, Any]:
    from processing.relighting.relit_session import display_of_day, shrunk, write_animation, write_sheet

    relits = [ready.under(outdoors, said) for _, _, outdoors, said in moments["lights"]]
    shown = moments["shown"]
    shown = replace(shown, display=display_of_day(shown.display, [r.picture.rgb for r in relits]))
    whole = [shown.rgb8(r.picture.rgb, ready.room.picture.geometry) for r in relits]
    for (stem, _, _, _), rgb8 in zip(moments["lights"], whole, strict=True):
        _jpeg(folder / f"{name}-{stem}.jpg", rgb8, ready.room, moments["made"])
    made: Made = moments["made"]
    small, sheet = ([made.on(shrunk(rgb8, rows)) for rgb8 in whole] for rows in (ANIMATION_ROWS, SHEET_ROWS))
    first, captions = moments["lights"][0][0], [caption for _, caption, _, _ in moments["lights"]]
    day = re.sub(r"T\d{4}", "", first)  # 2023-06-21, 2023-06-21-overcast
    write_animation(folder / f"{name}-{day}.webp", small, made)
    write_sheet(folder / f"{name}-{day}-sheet.png", sheet, captions, made)
    return _summary(ready, moments, [r.facts for r in relits], folder / f"{name}-{day}.json")


def _summary(ready: Relighting, moments: dict[str, Any], facts: list[dict[str, Any]], path: Path) -> dict[str, Any]:
    """Return what was relit, and write it as JSON."""
    from processing.pictures.writing import write_bytes

    basis = "kept" if ready.basis_kept else "made"
    of_room = {"session": ready.room.manifest.name, "staged": ready.room.staged, "basis": basis}
    found = {"schema_version": 1, **of_room, "of_sha256": moments["of"], "notes": moments["notes"], "moments": facts}
    write_bytes(path, (json.dumps(found, indent=1, ensure_ascii=False) + "\n").encode())
    return found


def _name(room: SessionRoom) -> str:
    return "empty" if room.staged is None else f"staged-{room.staged}"


def _made(session: Path, room: SessionRoom, further: str, folder: Path) -> Made:
    """Return what pictures of the room are; the original is where the session says, else written beside them."""
    from processing.exchange.export import write_original
    from processing.exchange.showing import made_of, session_shown
    from processing.running.choices import read_choices

    url = read_choices(session).value(session, "original-url")
    original = url or write_original(session, folder, session_shown(session))
    return made_of(session, _name(room), further=further, original=original)


def _jpeg(path: Path, rgb8: Any, room: SessionRoom, made: Made) -> None:
    """Write a picture of the room with its label; one twice as wide as high is a whole panorama."""
    from processing.exchange.jpeg_files import PanoramaTags, write_jpeg

    high, wide = rgb8.shape[:2]
    tags = PanoramaTags.whole(wide, high, heading_rad=room.manifest.heading_rad) if wide == 2 * high else None
    how: dict[str, Any] = {"relative": not room.picture.absolute, "title": f"{room.manifest.name}, {made.further}"}
    write_jpeg(path, made.on(rgb8), panorama=tags, made=made, **how)


def _line(one: dict[str, Any]) -> str:
    when = one.get("local_time", "other sky")
    sun = f"sun {one['sun_elevation_deg']:.1f} degrees high" if "sun_elevation_deg" in one else "no sun"
    light = f"outdoors {one['global_horizontal_lx']:.0f} lx, room {one['median_luminance']:.4g} {one['unit']}"
    return f"{when}  {sun}, {light}, {100 * one['sunny_share']:.1f} % in the sun"


@click.command("view-from", params=parameters(__package__, "view-from"))
def view_from(session: Path, *, as_json: bool, **asked: Any) -> int:
    """Render SESSION's room, emptied or staged, from another viewpoint.

    What the camera saw comes from the photograph; what it did not see is rendered from the room's materials and is
    white in NAME-rendered.png. Writes the picture in cd/m2 (EXR) and a JPEG. Needs a session processed with --set.

    \b
    Examples:
      daylit view-from sessions/2023-05-19T1554Z_coda-320 --eye 1.2,-0.5,1.2 --look -30,-5
      daylit view-from sessions/2023-05-19T1554Z_coda-320 --eye 0.5,1,1.6 --panorama --staged 1
    """
    _check_staged(asked)
    if asked["name"] is not None and not re.fullmatch(r"[\w][\w .-]{0,99}", asked["name"]):
        raise click.UsageError("--name is a file name without extension: letters, digits, spaces, dots, dashes")
    if asked["panorama"] and (asked["look"] is not None or asked["fov"] is not None):
        raise click.UsageError("--look and --fov have no effect with --panorama")
    from processing.light.picture.viewpoint import check_place, seen_from
    from processing.light.solver.irradiance import EFFORTS
    from processing.relighting.relit_session import read_session_room
    from processing.running.choices import go_on_with, remember

    eye = list(numbers("--eye", asked["eye"], 3, "metres to the right, ahead and up"))
    geometry = _geometry(asked)
    if asked["staged"] is not None:
        asked |= go_on_with(session, {"furniture": asked["furniture"]})
    room = read_session_room(session, asked["staged"], 2048, asked["furniture"])
    if asked["furniture"] is not None:
        remember(session, {"furniture": asked["furniture"]}, by="daylit view-from")
    place = eye[0], eye[1], eye[2]
    check_place(room.scene, place)
    found = seen_from(room.scene, room.picture.rgb, room.eye_m, geometry, place, effort=EFFORTS[asked["quality"]])
    folder = asked["output"] or session / "views"
    folder.mkdir(parents=True, exist_ok=True)
    view = "panorama" if asked["panorama"] else (asked["look"] or "0,0").replace(" ", "").replace(",", "_")
    stem = asked["name"] or f"{_name(room)}-from-{'_'.join(f'{v:g}' for v in eye)}-{view}"
    facts = _write(folder, stem, session, room, found, (geometry, eye))
    lines = (
        f"{100 * facts['seen_share']:.0f} % of what is not window was seen by the camera; the rest is rendered",
        f"written to {folder}: {stem}.exr, {stem}.jpg, {stem}-rendered.png",
    )
    return answer({"ok": True, "folder": str(folder), **facts}, lines, as_json=as_json)


def _geometry(asked: dict[str, Any]) -> Any:
    from processing.sphere import Equirectangular, Perspective

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
    from processing.exchange.showing import session_shown
    from processing.pictures.exr import write_exr
    from processing.pictures.preview import write_mask
    from processing.relighting.relit_session import seen_picture
    from processing.sphere import Equirectangular

    solid, (geometry, eye) = ~found.glass, seen
    write_exr(folder / f"{stem}.exr", seen_picture(room.picture, found, geometry, (eye[0], eye[1], eye[2])))
    write_mask(folder / f"{stem}-rendered.png", solid & ~found.seen)
    rgb8 = session_shown(session).display.shown(found.rgb, found.glass, around=isinstance(geometry, Equirectangular))
    _jpeg(folder / f"{stem}.jpg", rgb8, room, _made(session, room, "computed view", folder))
    share = round(float(found.seen[solid].mean()), 4) if solid.any() else 1.0
    errors = {"seen_share": share, "error": round(found.error, 4)}
    return {"eye_m": eye, "staged": room.staged, **errors, "unit": room.picture.unit}
