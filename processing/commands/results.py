"""A session's results: ``daylit inspect``, ``export``, ``view``, ``clean``, ``stills`` and ``proof``."""

from __future__ import annotations

import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import answer, numbers, parameters

if TYPE_CHECKING:
    from processing.exchange.export import Exported


# ``daylit inspect``: what a picture says, as a whole and at a place.


@click.command(params=parameters(__package__, "inspect"))
def inspect(file: Path, at: tuple[str, ...], radius: float, *, as_json: bool) -> int:
    """Show unit, range and metadata of FILE (EXR, Radiance HDR, JPEG, PNG); with --at, the value at a point.

    \b
    Examples:
      daylit inspect sessions/2023-05-19T1554Z_coda-320/stages/calibrate/indoor.exr --at 30,-10
      daylit inspect sky.hdr --at 0,90 --radius 5 --json
    """
    from processing.exchange.inspection import open_picture, picture_facts, place_facts

    picture = open_picture(file)
    directions = [numbers("--at", one, 2, "longitude and latitude in degrees") for one in at]
    places = [place_facts(picture, lon, lat, radius) for lon, lat in directions]
    facts = picture_facts(picture)
    lines = (*_lines(facts), *(line for place in places for line in _place_lines(place)))
    return answer({"ok": True, "file": file.name, **facts, "places": places}, lines, as_json=as_json)


def _lines(facts: dict[str, Any]) -> list[str]:
    found = [f"{facts['kind']}, {facts['width_px']} x {facts['height_px']}, {facts['geometry']}"]
    values = {name: value for name, value in facts["range"].items() if value is not None}
    found.append(f"{facts['unit']}: " + ", ".join(f"{name} {value:.4g}" for name, value in values.items()))
    if facts["scale_uncertainty"]:
        found.append(f"uncertainty of the scale: {facts['scale_uncertainty']:.1%}")
    if pixels := facts.get("pixels"):
        found.append("pixels: " + ", ".join(f"{name} {share:.2%}" for name, share in pixels.items() if share))
    for name, value in facts["attributes"].items():
        text = value if isinstance(value, str) else json.dumps(value)
        found.append(f"  {name}: {text if len(text) < 200 else text[:200] + ' ...'}")
    return found


def _place_lines(place: dict[str, Any]) -> list[str]:
    own = place.get("relative_uncertainty")
    sure = "" if own is None else f" ± {own:.1%}"
    state = f", {place['pixel']}" if place.get("pixel", "valid") != "valid" else ""
    where = f"at {place['longitude_deg']:g}, {place['latitude_deg']:g} (column {place['column']}, row {place['row']})"
    found = [f"{where}: {place['value']:.5g}{sure} {place['unit']}{state}"]
    if around := place["around"]:
        found.append(
            f"  within {around['radius_deg']:g} degrees: mean {around['mean']:.5g}, "
            f"standard deviation {around['standard_deviation']:.3g}, "
            f"{around['lowest']:.5g} to {around['highest']:.5g}, {around['pixels']} pixels"
        )
    return found


@click.command(params=parameters(__package__, "export"))
def export(session: Path, what: str, into: Path | None, *, no_label: bool, as_json: bool) -> int:
    """Export the pictures and models of a processed SESSION as JPEG, Radiance HDR, EXR and glTF.

    jpeg: with Google's panorama tags, for any 360-degree viewer; emptied and staged ones state what was altered and
    where the original is (beside it, or at `process --original-url`). hdr: for Radiance's falsecolor and pvalue.
    gltf: the room and each staged room (GLB, metres, y up). glare: eight views for evalglare (for a fisheye at the eye,
    one), and its results if it is installed.

    \b
    Examples:
      daylit export sessions/2023-05-19T1554Z_coda-320
      daylit export sessions/2023-05-19T1554Z_coda-320 --what glare --into glare
    """
    from processing.exchange.export import Exported
    from processing.exchange.export import export as write
    from processing.running.choices import read_choices

    url = read_choices(session).value(session, "original-url") or ""
    kinds = [*dict.fromkeys(one.strip() for one in what.split(",") if one.strip())]
    target = into or Path(f"{session.resolve().name}-export")
    plain = [one for one in kinds if one != "glare"]
    done, glare = Exported(), {}
    if plain or not kinds:
        done = write(session.resolve(), target, plain, label=not no_label, url=url)
    if "glare" in kinds:
        glare = _glare(session.resolve(), target, done)
    files = [str(path) for path in done.files]
    lines = [*files, *(f"left out: {name}: {why}" for name, why in done.left_out.items())]
    lines += [f"{view}: " + ", ".join(f"{name} {v:.4g}" for name, v in one.items()) for view, one in glare.items()]
    return answer({"ok": True, "files": files, "left_out": done.left_out, "evalglare": glare}, lines, as_json=as_json)


def _glare(session: Path, target: Path, done: Exported) -> dict[str, Any]:
    """Write the views, and return evalglare's figures of each where it is installed."""
    from processing.errors import ParameterError
    from processing.exchange.export import ROOM, pictures_of
    from processing.figures.figures import evalglare, write_glare_views
    from processing.pictures.exr import read_exr
    from processing.pictures.images import LuminanceImage

    path = pictures_of(session, done.left_out).get(ROOM)
    image = None if path is None else read_exr(path)
    if not isinstance(image, LuminanceImage):
        raise ParameterError("no calibrated room picture yet", where=str(session), advice="run daylit process first")
    target.mkdir(parents=True, exist_ok=True)
    views = write_glare_views(target, session.name, image)
    done.files += views
    tool = shutil.which("evalglare") if image.absolute else None
    if tool is None:
        absent = "it is not installed (part of Radiance); the figures stage has daylit's own values"
        unscaled = "the picture has no absolute scale, which glare needs"
        done.left_out["evalglare"] = absent if image.absolute else unscaled
        return {}
    return {view.name: evalglare(Path(tool), view) for view in views}


# ``daylit view``: open a session's report.

REPORT = Path("stages", "report", "index.html")


@click.command(params=parameters(__package__, "view"))
def view(session: Path, *, no_open: bool, as_json: bool) -> int:
    """Open the report of SESSION in the browser and print its path.

    It shows everything by itself; its links to full-size files need the session's folder beside it.

    \b
    Examples:
      daylit view sessions/2023-05-19T1554Z_coda-320
      daylit view --no-open sessions/2023-05-19T1554Z_coda-320
    """
    page = _page(session)
    facts = {"ok": True, "report": str(page), "uri": page.resolve().as_uri(), "bytes": page.stat().st_size}
    answer(facts, (str(page),), as_json=as_json)
    if not (no_open or as_json):
        import webbrowser

        if not webbrowser.open(page.resolve().as_uri()):
            click.echo("no browser could be started: open the file yourself", err=True)
    return 0


def _page(session: Path) -> Path:
    """Return the report; a session's folder, its stages' folder or the page itself may be named."""
    from processing.errors import ProcessingError

    for page in (session / REPORT, session / REPORT.name, session):
        if page.is_file() and page.name == REPORT.name:
            return page
    from station.session.store import load_manifest

    load_manifest(session)
    raise ProcessingError("no report yet", where=str(session), advice=f"daylit process {session}")


# ``daylit clean``: what only the stages need goes, results stay.


@click.command(params=parameters(__package__, "clean"))
def clean(session: Path, keep: tuple[str, ...], *, as_json: bool) -> int:
    """Delete SESSION's intermediate files; keep frames, calibrated and staged pictures, and the report.

    Kept are the stages calibrate, figures, arrange, render, stills, day and report. The next `daylit process` rebuilds
    only the others, with the same results.

    \b
    Examples:
      daylit clean sessions/2023-05-19T1554Z_coda-320
      daylit clean sessions/2023-05-19T1554Z_coda-320 --keep materials --keep remove
    """
    from processing.running.runner import RESULTS
    from processing.running.runner import clean as remove

    freed = remove(session, (*RESULTS, *keep))
    lines = [f"{stage:<10} {size_bytes / 1e6:8.1f} MB" for stage, size_bytes in freed.items()]
    lines.append(f"{sum(freed.values()) / 1e6:.1f} MB freed")
    return answer({"ok": True, "session": session.name, "freed_bytes": freed}, lines, as_json=as_json)


def still_paths(session: Path) -> list[Path]:
    """Return a session's stills, the first the best; none where they are damaged: they are made anew when asked for."""
    from processing.errors import ResultFileError
    from processing.exchange.proof import STILLS, stills_of

    with suppress(ResultFileError):
        return [session / STILLS / one["file"] for one in stills_of(session)]
    return []


@click.command(params=parameters(__package__, "stills"))
def stills(session: Path, aim: tuple[str, ...], into: Path | None, *, as_json: bool) -> int:
    """List the framed stills of SESSION: JPEGs up to 1920 x 1280, each with its unaltered original and luminance (EXR).

    `daylit process` frames them: corner to corner, upright, at 16 to 24 mm, with main pieces uncut and windows in view.
    --aim adds framings of your own before these and saves them with the session: degrees right of the panorama's
    centre, full-frame focal length, and downward shift as a fraction of the height. --into copies JPEGs and originals
    to a folder for sending.

    \b
    Examples:
      daylit stills sessions/2023-05-19T1554Z_coda-320
      daylit stills sessions/2023-05-19T1554Z_coda-320 --aim=-35,20,0.08 --aim=120,24
      daylit stills sessions/2023-05-19T1554Z_coda-320 --into pictures
    """
    from processing.errors import ProcessingError
    from processing.exchange.proof import STILLS, stills_of
    from processing.pictures.writing import write_bytes

    if aim:
        from processing.running.choices import going_on
        from processing.running.requests import RunRequest
        from processing.running.runner import process

        with going_on(session, {"aim": ";".join(aim)}, RunRequest(until="stills"), by="daylit stills --aim") as found:
            process(session, found.request)
    facts = stills_of(session)
    if not facts:
        raise ProcessingError("no stills yet", where=str(session), advice=f"daylit process {session}")
    folder = session / STILLS
    names = [name for one in facts for name in (one["file"], one["original"])]
    if into is not None:
        into.mkdir(parents=True, exist_ok=True)
        for name in names:
            write_bytes(into / name, (folder / name).read_bytes())
        folder = into
    lines = []
    for one in facts:
        shows = f": {', '.join(one['shows'])}" if one["shows"] else ""
        lines.append(f"{folder / one['file']}  {one['state']}, {one['lens_mm']:g} mm{shows}")
        lines += [f"  {one['statement']}"] if one["statement"] else []
    return answer({"ok": True, "folder": str(folder), "stills": facts}, lines, as_json=as_json)


@click.command(params=parameters(__package__, "proof"))
def proof(
    session: Path, into: Path | None, *, checked: bool, digest: str | None, sign: str | None, as_json: bool
) -> int:
    """Write the proof pack of SESSION's stills: originals, results, what was altered, digests chained to frames.

    Keep the printed digest: with it, --check finds any changed byte of pictures, frames and proof pack.

    \b
    Examples:
      daylit proof sessions/2023-05-19T1554Z_coda-320
      daylit proof sessions/2023-05-19T1554Z_coda-320 --sign self
      daylit proof sessions/2023-05-19T1554Z_coda-320 --check
    """
    from drivers.clock import SystemClock
    from processing.exchange.proof import check_proof, read_signer, self_made_signer, write_proof

    if sign is not None if checked else digest is not None:
        raise click.UsageError("--digest needs --check; --sign cannot be combined with it")
    folder = into or Path(f"{session.resolve().name}-proof")
    if not checked:
        signer = None
        if sign is not None:
            signer = self_made_signer(SystemClock().utc_now()) if sign == "self" else read_signer(Path(sign))
        path, own = write_proof(session.resolve(), folder, signer)
        return answer({"ok": True, "file": str(path), "sha256": own}, (str(path), f"sha256 {own}"), as_json=as_json)
    wrong = check_proof(folder, session=session.resolve(), digest=digest)
    lines = wrong or ["every byte is unchanged"]
    return answer({"ok": not wrong, "problems": wrong}, lines, as_json=as_json, exit_code=1 if wrong else 0)
