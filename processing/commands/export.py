"""``daylit export``: a session's results for other programs."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from processing.exchange.export import Exported


@click.command()
@click.argument("session", type=click.Path(path_type=Path))
@click.option(
    "--what",
    default="jpeg,hdr,gltf",
    show_default=True,
    metavar="KINDS",
    help="Some of jpeg, hdr, exr, gltf, glare, with commas between.",
)
@click.option("--into", type=click.Path(path_type=Path, file_okay=False), help="Default: SESSION's name + -export.")
@click.option("--no-label", is_flag=True, help="Staged JPEGs without the visible label (their metadata still say so).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def export(session: Path, what: str, into: Path | None, *, no_label: bool, as_json: bool) -> int:
    """Write the pictures and models of a processed SESSION as JPEG, Radiance HDR, EXR, glTF.

    jpeg has Google's panorama tags and opens in any 360-degree viewer; hdr is for Radiance's falsecolor and pvalue;
    gltf (GLB, metres, y up) holds the room and each staged room; glare makes eight views for evalglare, and asks it
    where it is installed.

    \b
    Examples:
      daylit export sessions/2023-05-19T1554Z_coda-320
      daylit export sessions/2023-05-19T1554Z_coda-320 --what glare --into glare
    """
    from processing.exchange.export import Exported
    from processing.exchange.export import export as write
    from station.store import load_manifest

    manifest = load_manifest(session)
    kinds = [one.strip() for one in what.split(",") if one.strip()]
    target = into or Path(f"{session.resolve().name}-export")
    plain = [one for one in kinds if one != "glare"]
    done, glare = Exported(), {}
    if plain or not kinds:
        done = write(session.resolve(), target, plain, heading_rad=manifest.heading_rad, label=not no_label)
    if "glare" in kinds:
        glare = _glare(session.resolve(), target, done)
    if as_json:
        files = [str(path) for path in done.files]
        click.echo(json.dumps({"ok": True, "files": files, "left_out": done.left_out, "evalglare": glare}))
        return 0
    for line in _lines(done, glare):
        click.echo("".join(c if c.isprintable() else "?" for c in line))
    return 0


def _glare(session: Path, target: Path, done: Exported) -> dict[str, Any]:
    """Write the views, and return evalglare's figures of each where it is installed."""
    from processing.errors import ParameterError
    from processing.exchange.export import ROOM, pictures_of
    from processing.exr_files import read_exr
    from processing.images import LuminanceImage
    from processing.light_figures.glare_views import evalglare, write_glare_views

    path = pictures_of(session).get(ROOM)
    image = None if path is None else read_exr(path)
    if not isinstance(image, LuminanceImage):
        raise ParameterError("has no calibrated room picture yet", where=str(session), advice="daylit process it first")
    target.mkdir(parents=True, exist_ok=True)
    views = write_glare_views(target, session.name, image)
    done.files += views
    tool = shutil.which("evalglare")
    if tool is None:
        done.left_out["evalglare"] = "it is not installed (part of Radiance); the figures stage has daylit's own values"
        return {}
    return {view.name: evalglare(Path(tool), view) for view in views}


def _lines(done: Exported, glare: dict[str, Any]) -> list[str]:
    found = [str(path) for path in done.files]
    found += [f"left out: {name}: {why}" for name, why in done.left_out.items()]
    found += [
        f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in one.items()) for name, one in glare.items()
    ]
    return found
