"""``daylit arrange``: furniture arrangements of a room, with floor plans."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import printable

if TYPE_CHECKING:
    from processing.layout.arrangement import Arrangement, Arrangements
    from processing.layout.items import Item


@click.command()
@click.argument("room", type=click.Path(path_type=Path))
@click.option("--items", metavar="LIST", help='Such as "bed, 2 nightstand, desk".')
@click.option("--set", "set_name", metavar="NAME", help="bedroom, living, dining or office instead of a list.")
@click.option(
    "--rules", default="standard", show_default=True, help="comfort, standard, tight, accessible, or your own."
)
@click.option("--rules-file", type=click.Path(path_type=Path), help="Your edited copy of the rules.")
@click.option(
    "--alternatives",
    "-n",
    "count",
    type=click.IntRange(1, 50),
    default=7,
    show_default=True,
    help="How many alternatives.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Another draw.")
@click.option("--pin", "pins", multiple=True, metavar="ITEM=X,Y,DEG", help="A piece that stands already.")
@click.option(
    "--place", "places", multiple=True, metavar="ITEM=EDGE,ALONG,AWAY,FACING", help="The paper's form; see below."
)
@click.option(
    "--furniture", "catalogue", type=click.Path(path_type=Path), metavar="FOLDER", help="Take models and sizes from it."
)
@click.option("--keep-camera", is_flag=True, help="Keep the floor at the camera free (rooms and sessions).")
@click.option("--into", "output", type=click.Path(path_type=Path, file_okay=False), help="Folder for the results.")
@click.option("--no-pictures", is_flag=True, help="Write arrangement.json only.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object: the arrangements.")
def arrange(room: Path, *, as_json: bool, no_pictures: bool, output: Path | None, **options: Any) -> int:
    """Arrange furniture in ROOM (a plan.json, a room.json or a session) so that no hard rule is broken.

    Writes arrangement.json, a floor plan of each arrangement (SVG and PNG) and contact-sheet.png into --into
    (default: ROOM's folder with -layout added). --place puts an item as the paper does: beside floor edge EDGE (its
    number, wall or window), ALONG and AWAY in 0 to 1 over all places that are legal there, FACING in or wall.

    \b
    Examples:
      daylit arrange plan.json --set bedroom
      daylit arrange plan.json --items "bed, 2 nightstand, desk, desk chair" --rules tight --alternatives 3
      daylit arrange plan.json --set living --furniture models/
      daylit arrange room.json --set living --pin tv-stand=0.2,2.4,-90 --place sofa=window,0.5,0,in
    Exit code: 0 all items placed · 1 some have no place (each with its reason) · 2, 5 refused.
    """
    result = _solve(room, **options)
    folder = output or room.with_name(f"{room.stem if room.is_file() else room.name}-layout")
    folder.mkdir(parents=True, exist_ok=True)
    result.write(folder / "arrangement.json")
    if not no_pictures:
        from processing.layout.drawn.drawing import write_drawings

        write_drawings(result, folder, _rule_set(options))
    complete = bool(result.arrangements) and result.arrangements[0].complete
    if as_json:
        click.echo(json.dumps({"ok": complete, "folder": str(folder), **result.model_dump(mode="json")}))
        return 0 if complete else 1
    for line in _lines(result):
        click.echo(printable(line))
    click.echo(f"written to {folder}")
    return 0 if complete else 1


def _book(options: dict[str, Any]) -> Any:
    from processing.layout.rules import built_in_rules, read_rules

    return read_rules(options["rules_file"]) if options["rules_file"] else built_in_rules()


def _rule_set(options: dict[str, Any]) -> Any:
    return _book(options).named(options["rules"])


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
    for one in result.arrangements:
        lines.append(_line(one))
    for refused in result.arrangements[0].not_placed:
        lines.append(f"not placed: {refused.id}: {refused.rule}: {refused.reason}")
    return lines


def _line(one: Arrangement) -> str:
    parts = [f"{one.rank:2d}  score {one.score:.3f}  {len(one.items)} items  meets {', '.join(one.meets)}"]
    if one.not_placed:
        parts.append(f"without {', '.join(n.id for n in one.not_placed)}")
    if one.differs_by:
        parts.append(f"({one.differs_by})")
    return "  ".join(parts)
