"""``daylit furniture``: models of a catalogue, listed, shown, exported; ``daylit arrange``: furniture in a room."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import answer, numbers, parameters

if TYPE_CHECKING:
    from processing.layout.arrangement import Arrangement, Arrangements
    from processing.layout.furniture.model import FurnitureModel
    from processing.layout.items import Item
    from processing.layout.models.catalogue import Catalogue


@click.group()
def furniture() -> None:
    """List, show and export furniture: built-in, or from a folder of models.

    \b
    Examples:
      daylit furniture list
      daylit furniture show sofa/mid-century --into sofa.png
    """


@furniture.command("list", params=parameters(__package__, "furniture list"))
def list_(catalogue: Path | None, style: str | None, category: str | None, *, as_json: bool) -> int:
    """List models with category, size (width x depth x height), licence, and what was guessed or corrected.

    \b
    Examples:
      daylit furniture list --style scandinavian
      daylit furniture list --furniture models/ --category sofa
    Exit code: 0 all read · 1 some files rejected (each with its reason).
    """
    found = _catalogue(catalogue, style)
    entries = [e for e in found.entries if category is None or e.category == category]
    if category is not None and not entries:
        known = ", ".join(sorted({e.category for e in found.entries}))
        raise click.UsageError(f"--category {category}: one of {known}")
    named = ("model_id", "category", "size_m", "smallest_m", "largest_m", "licence", "file")
    rows = [
        {key: getattr(e, key) for key in named}
        | {"front": "+y", "notes": e.notes, "zones": [{"side": z.side, "rule": z.rule} for z in e.zones]}
        for e in entries
    ]
    refused = {name: error.to_dict() for name, error in found.refused.items()}
    lines = []
    for e in entries:
        size = " x ".join(f"{v:.2f}" for v in e.size_m)
        lines += [f"{e.model_id:26s} {e.category:13s} {size} m  {e.licence}", *(f"    {note}" for note in e.notes)]
    lines += [f"rejected: {name}: {error.code} {error}" for name, error in found.refused.items()]
    facts = {"ok": not refused, "models": rows, "refused": refused}
    return answer(facts, lines, as_json=as_json, exit_code=1 if refused else 0)


@furniture.command(params=parameters(__package__, "furniture show"))
def show(model: str | None, size: str | None, output: Path | None, *, as_json: bool, **where: Any) -> int:
    """Draw MODEL from the front and from behind, or a contact sheet of the whole catalogue.

    \b
    Examples:
      daylit furniture show "bookshelf/classic" --size 1.2,0.3,2.1
      daylit furniture show --style industrial --into industrial.png
    """
    from processing.pictures.writing import write_whole
    from processing.relighting.model_pictures import model_sheet, two_sides

    found = _catalogue(where["catalogue"], where["style"])
    if model is None and size is not None:
        raise click.UsageError("--size is a single model's: name one")
    if model is None:
        models = [found.mesh(entry.model_id) for entry in found.entries]
        picture, name = model_sheet(models, 260), "furniture"
    else:
        models = [found.mesh(model, _size(size))]
        picture, name = two_sides(models[0]), models[0].model_id.replace("/", "-").replace(" ", "-")
    path = output or Path(f"{name}.png")
    write_whole(path, lambda part: picture.save(part, "PNG"))
    return _report_written(path, models, as_json=as_json)


@furniture.command(params=parameters(__package__, "furniture export"))
def export(what: str, rank: int, size: str | None, output: Path | None, *, as_json: bool, **where: Any) -> int:
    """Export a model, or all furniture of an arrangement.json in place, as GLB (metres, y up).

    \b
    Examples:
      daylit furniture export armchair/classic --into armchair.glb
      daylit furniture export plan-layout/arrangement.json --rank 2 --style mid-century --into layout-2.glb
    """
    from processing.errors import CatalogueError
    from processing.layout.arrangement import read_arrangements
    from processing.layout.models.catalogue import write_arrangement, write_model

    found, arranged = _catalogue(where["catalogue"], where["style"]), what.endswith(".json")
    if size is not None if arranged else rank != 1:
        raise click.UsageError("--rank is an arrangement's, --size a single model's")
    if arranged:
        every = read_arrangements(Path(what)).arrangements
        if rank > len(every):
            raise CatalogueError(f"arrangement {rank} of {len(every)}", where=what)
        path = output or Path(what).with_suffix(".glb")
        models = write_arrangement(path, every[rank - 1], found)
    else:
        models = [found.mesh(what, _size(size))]
        path = output or Path(f"{models[0].model_id.replace('/', '-').replace(' ', '-')}.glb")
        write_model(path, models[0])
    return _report_written(path, models, as_json=as_json)


def _catalogue(folder: Path | None, style: str | None) -> Catalogue:
    from processing.errors import ParameterError
    from processing.layout.models.catalogue import Catalogue

    if folder is not None and style is not None:
        raise ParameterError("--style applies to built-in furniture: give it or --furniture")
    return Catalogue.at(folder) if folder is not None else Catalogue.builtin(style)


def _size(text: str | None) -> tuple[float, float, float] | None:
    if text is None:
        return None
    width, depth, height = numbers("--size", text, 3, "width, depth and height in metres")
    return width, depth, height


def _report_written(path: Path, models: list[FurnitureModel], *, as_json: bool) -> int:
    notes = {m.model_id: m.notes for m in models if m.notes}
    triangles = sum(m.triangles for m in models)
    names = [m.model_id for m in models]
    facts = {"ok": True, "file": str(path), "models": names, "triangles": triangles, "notes": notes}
    lines = [f"{name}: {'; '.join(said)}" for name, said in notes.items()]
    return answer(facts, [*lines, f"{path}: {len(models)} models, {triangles} triangles"], as_json=as_json)


@click.command(params=parameters(__package__, "arrange"))
def arrange(room: Path, *, as_json: bool, no_pictures: bool, output: Path | None, **options: Any) -> int:
    """Arrange furniture in ROOM (a plan.json, a room.json or a session) without breaking a hard rule.

    Writes arrangement.json, a floor plan of each arrangement (SVG and PNG) and contact-sheet.png into --into
    (default: ROOM's folder with -layout added). --place positions an item as the paper does: at floor edge EDGE (its
    number, wall or window), ALONG and AWAY from 0 to 1 over the permitted positions there, FACING in or wall.

    \b
    Examples:
      daylit arrange plan.json --set bedroom
      daylit arrange plan.json --items "bed, 2 nightstand, desk, desk chair" --rules tight --alternatives 3
      daylit arrange plan.json --set living --furniture models/
      daylit arrange room.json --set living --pin tv-stand=0.2,2.4,-90 --place sofa=window,0.5,0,in
    Exit code: 0 all items placed · 1 some could not be placed (each with its reason) · 2, 5 invalid input.
    """
    from station.session.durable import disk_errors

    result = _solve(room, **options)
    folder = output or room.with_name(f"{room.stem if room.is_file() else room.name}-layout")
    with disk_errors(folder, "writing"):
        folder.mkdir(parents=True, exist_ok=True)
        result.write(folder / "arrangement.json")
        if not no_pictures:
            from processing.layout.drawn.drawing import write_drawings

            write_drawings(result, folder, _book(options).named(options["rules"]))
    complete = bool(result.arrangements) and result.arrangements[0].complete
    facts = {"ok": complete, "folder": str(folder), **result.model_dump(mode="json")}
    return answer(facts, [*_lines(result), f"written to {folder}"], as_json=as_json, exit_code=0 if complete else 1)


def _book(options: dict[str, Any]) -> Any:
    from processing.layout.rules import built_in_rules, read_rules

    return read_rules(options["rules_file"]) if options["rules_file"] else built_in_rules()


def _solve(room: Path, **options: Any) -> Arrangements:
    from processing.api import floor_plan
    from processing.errors import ParameterError
    from processing.layout.arrange import arrange as solve
    from processing.layout.given_places import parse_pin, parse_place, placed_by_ratios

    if (options["items"] is None) == (options["set_name"] is None):
        raise ParameterError("give either --items or --set")
    items = _items(options)
    plan = floor_plan(room, keep_camera_free=options["keep_camera"])
    book = _book(options)
    rules = book.named(options["rules"])
    pins = dict(parse_pin(text) for text in options["pins"])
    pins = placed_by_ratios(plan, items, rules, [parse_place(text) for text in options["places"]], pins)
    return solve(plan, items, rules, n=options["count"], seed=options["seed"], pins=pins, book=book)


def _items(options: dict[str, Any]) -> list[Item]:
    """Return the items asked for; with a catalogue, in the sizes of its models (kinds that it lacks stay)."""
    from processing.layout.items import KINDS, parse_items, set_items, set_list
    from processing.layout.models.catalogue import Catalogue

    if options["catalogue"] is None:
        return parse_items(options["items"]) if options["items"] is not None else set_items(options["set_name"])
    kinds = {**KINDS, **Catalogue.at(options["catalogue"]).kinds(options["seed"])}
    return parse_items(options["items"] if options["items"] is not None else set_list(options["set_name"]), kinds)


def _lines(result: Arrangements) -> list[str]:
    lines = [f"note: {note}" for note in result.notes]
    if not result.arrangements:
        return [*lines, "no arrangement was found"]
    refused = (f"not placed: {one.id}: {one.rule}: {one.reason}" for one in result.arrangements[0].not_placed)
    return [*lines, *map(_line, result.arrangements), *refused]


def _line(one: Arrangement) -> str:
    parts = [f"{one.rank:2d}  score {one.score:.3f}  {len(one.items)} items  meets {', '.join(one.meets)}"]
    if one.not_placed:
        parts.append(f"without {', '.join(n.id for n in one.not_placed)}")
    if one.differs_by:
        parts.append(f"({one.differs_by})")
    return "  ".join(parts)
