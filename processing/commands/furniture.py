"""``daylit furniture``: list, show and export the furniture of a catalogue."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from processing.layout.furniture.model import FurnitureModel
    from processing.layout.models.catalogue import Catalogue

_FOLDER = click.option(
    "--furniture",
    "catalogue",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Of glTF, GLB or OBJ files, or 3D-FUTURE's.",
)
_STYLE = click.option(
    "--style", metavar="NAME", help="scandinavian, mid-century, classic or industrial (built-in furniture)."
)


@click.group()
def furniture() -> None:
    """List, show and export furniture: built in, or of a folder of models.

    \b
    Examples:
      daylit furniture list
      daylit furniture show sofa/mid-century --into sofa.png
    """


@furniture.command("list")
@_FOLDER
@_STYLE
@click.option("--category", metavar="NAME", help="Only these, such as sofa.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def list_(catalogue: Path | None, style: str | None, category: str | None, *, as_json: bool) -> int:
    """List the models with category, size (width x depth x height), licence, and what was guessed or corrected.

    \b
    Examples:
      daylit furniture list --style scandinavian
      daylit furniture list --furniture models/ --category sofa
    Exit code: 0 all read · 1 some files are refused (each with its reason).
    """
    found = _catalogue(catalogue, style)
    entries = [e for e in found.entries if category is None or e.category == category]
    if as_json:
        rows = [
            {
                **{key: getattr(e, key) for key in ("model_id", "category", "size_m", "smallest_m", "largest_m")},
                "licence": e.licence,
                "file": e.file,
                "front": "+y",
                "notes": e.notes,
                "zones": [{"side": z.side, "rule": z.rule} for z in e.zones],
            }
            for e in entries
        ]
        refused = {name: error.to_dict() for name, error in found.refused.items()}
        click.echo(json.dumps({"ok": not refused, "models": rows, "refused": refused}))
        return 1 if refused else 0
    for e in entries:
        size = " x ".join(f"{v:.2f}" for v in e.size_m)
        _say(f"{e.model_id:26s} {e.category:13s} {size} m  {e.licence}" + "".join(f"\n    {note}" for note in e.notes))
    for name, error in found.refused.items():
        _say(f"refused: {name}: {error.code} {error}")
    return 1 if found.refused else 0


@furniture.command()
@click.argument("model", required=False)
@_FOLDER
@_STYLE
@click.option("--size", metavar="W,D,H", help="Metres; the model's own size where it is not given.")
@click.option(
    "--into", "output", type=click.Path(path_type=Path, dir_okay=False), help="PNG; default: the model's name."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def show(model: str | None, size: str | None, output: Path | None, *, as_json: bool, **where: Any) -> int:
    """Draw MODEL from the front and from behind, or a contact sheet of the whole catalogue.

    \b
    Examples:
      daylit furniture show "bookshelf/classic" --size 1.2,0.3,2.1
      daylit furniture show --style industrial --into industrial.png
    """
    from processing.layout.drawn.thumbnails import model_sheet, two_sides

    found = _catalogue(where["catalogue"], where["style"])
    if model is None:
        models = [found.mesh(entry.model_id) for entry in found.entries]
        picture, name = model_sheet(models, cell_px=260), "furniture"
    else:
        models = [found.mesh(model, _size(size))]
        picture, name = two_sides(models[0]), models[0].model_id.replace("/", "-").replace(" ", "-")
    path = output or Path(f"{name}.png")
    picture.save(path)
    _report_written(path, models, as_json=as_json)
    return 0


@furniture.command()
@click.argument("what")
@_FOLDER
@_STYLE
@click.option("--rank", type=click.IntRange(min=1), default=1, show_default=True, help="Which arrangement of the file.")
@click.option("--size", metavar="W,D,H", help="Of one model, in metres.")
@click.option(
    "--into", "output", type=click.Path(path_type=Path, dir_okay=False), help="GLB; default: the model's name."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def export(what: str, rank: int, size: str | None, output: Path | None, *, as_json: bool, **where: Any) -> int:
    """Write a model, or all furniture of an arrangement.json where it stands, as GLB (metres, y up).

    \b
    Examples:
      daylit furniture export armchair/classic --into armchair.glb
      daylit furniture export plan-layout/arrangement.json --rank 2 --style mid-century --into layout-2.glb
    """
    from processing.errors import CatalogueError
    from processing.layout.arrangement import read_arrangements
    from processing.layout.models.scene_files import write_arrangement, write_model

    found = _catalogue(where["catalogue"], where["style"])
    if what.endswith(".json"):
        every = read_arrangements(Path(what)).arrangements
        if rank > len(every):
            raise CatalogueError(f"arrangement {rank} of {len(every)}", where=what)
        path = output or Path(what).with_suffix(".glb")
        models = write_arrangement(path, every[rank - 1], found)
    else:
        models = [found.mesh(what, _size(size))]
        path = output or Path(f"{models[0].model_id.replace('/', '-').replace(' ', '-')}.glb")
        write_model(path, models[0])
    _report_written(path, models, as_json=as_json)
    return 0


def _catalogue(folder: Path | None, style: str | None) -> Catalogue:
    from processing.errors import ParameterError
    from processing.layout.models.catalogue import Catalogue

    if folder is not None and style is not None:
        raise ParameterError("--style is of the built-in furniture: give it or --furniture")
    return Catalogue.at(folder) if folder is not None else Catalogue.builtin(style)


def _size(text: str | None) -> tuple[float, float, float] | None:
    from station.commands.views import numbers

    if text is None:
        return None
    width, depth, height = numbers("--size", text, 3, "width, depth and height in metres")
    return width, depth, height


def _report_written(path: Path, models: list[FurnitureModel], *, as_json: bool) -> None:
    notes = {m.model_id: m.notes for m in models if m.notes}
    triangles = sum(m.triangles for m in models)
    if as_json:
        names = [m.model_id for m in models]
        click.echo(json.dumps({"ok": True, "file": str(path), "models": names, "triangles": triangles, "notes": notes}))
        return
    for name, said in notes.items():
        _say(f"{name}: {'; '.join(said)}")
    _say(f"{path}: {len(models)} models, {triangles} triangles")


def _say(text: str) -> None:
    click.echo("".join(c if c.isprintable() or c == "\n" else "?" for c in text))
