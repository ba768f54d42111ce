"""What people look at first: before and after, viewer, models, alternatives, materials, other times of day."""

import gzip
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ConfigDict, TypeAdapter

from processing.exchange.jpeg_files import Made, jpeg_bytes
from processing.exchange.showing import made_of, standing_sha256
from processing.ground.tables import table_of
from processing.ground.threads import give_back
from processing.layout.arrangement import Arrangement, Arrangements
from processing.report.data import Card, Cards, Quantity, Section, Table
from processing.report.room_states import lead_section, look_of, model_section, room_states, viewer_section, views_of
from processing.report.states import VIEWER_WIDTHS_PX, Cuts, Look, State, cuts_of, small_direction, small_height_px
from processing.sphere.views import Panorama, cut_view
from processing.stages.contract import StageContext
from processing.stages.parameters import MOST_STAGED
from processing.stages.upright import upright_panorama
from station.session import strict_json

METHODS: dict[str, str] = table_of(__package__, "words")["methods"]
T = TypeVar("T")
_AS_JSON = ConfigDict(ser_json_bytes="base64", val_json_bytes="base64", ser_json_inf_nan="constants")
FOLDER = "relight"
MOST = 24  # moments that the page shows
WIDTH_PX = 640  # chosen: the picture of a card
_WEATHER = {"captured": "the captured weather", "clear": "clear", "overcast": "overcast"}


def alternatives_section(
    arranged: Arrangements | None, staged: Mapping[str, Any] | None, cuts: Sequence[Cuts], plans: Mapping[int, bytes]
) -> Section | None:
    """Return the alternatives side by side: staged views, plans, figures; None where nothing was arranged.

    ``staged`` is the JSON of the stage render; ``plans``: SVG by number from 1.
    """
    if arranged is None or not arranged.arrangements:
        return None
    every = arranged.arrangements
    facts: dict[int, Mapping[str, Any]] = dict(enumerate((staged or {}).get("alternatives", []), 1))
    pictures = {one.name: one.small for one in cuts if one.staged}
    views, drawn = list[Card](), list[Card]()
    for number, one in enumerate(every, 1):
        what, made = f"alternative {number}", facts.get(number, {})
        if (view := pictures.get(f"Staged {number}")) is not None:
            alt = f"virtually staged room, {what}"
            views.append(Card(what.capitalize(), view, alt, _pieces_text(made), _figures(made)))
        if number in plans:
            score = (Quantity("Score", round(one.score, 2), "of 1"),)
            drawn.append(Card(f"Plan {number}", plans[number], f"floor plan of {what}", one.differs_by, score))
    method = (staged or {}).get("method", "")
    text = f"Rules: {every[0].rule_set}."
    if method:
        text += f" Method {method}: {METHODS.get(method, 'see the documentation')}."
    widgets = tuple(Cards(tuple(cards)) for cards in (views, drawn) if cards)
    return Section("Alternatives", text, tables=_tables(every), widgets=widgets)


def materials_section(materials: Mapping[str, Any], metrics: Mapping[str, Any]) -> Section:
    """Return what surfaces reflect and windows let through."""
    quantities = []
    if "measured_share" in metrics:
        note = "the rest is extrapolated from neighbouring surfaces"
        measured_pct = round(100 * metrics["measured_share"], 1)
        quantities.append(Quantity("Surfaces with measured albedo", measured_pct, "%", note=note))
    if "floor_gloss" in materials:
        quantities.append(Quantity("Gloss of the floor", materials["floor_gloss"], "", note="0 matte, 1 full varnish"))
    surfaces = materials.get("surfaces", [])
    large = tuple(_surface_row(one) for one in surfaces if not str(one["name"]).startswith("reveal"))
    small = tuple(_surface_row(one) for one in surfaces if str(one["name"]).startswith("reveal"))
    head = ("surface", "albedo", "red, green, blue")
    tables = [Table("Mean albedo", head, large)] if large else []
    if small:
        tables.append(Table("Albedo of the window reveals", head, small, folded=True))
    if windows := materials.get("windows", []):
        shown = tuple(_window_row(one) for one in windows)
        tables.append(Table("Windows", ("opening", "transmittance (r, g, b)", "covered"), shown))
    if notes := [*materials.get("notes", [])]:
        tables.append(Table("Notes", ("note",), tuple((str(note),) for note in notes)))
    text = f"Outdoor light from: {materials.get('outdoors', 'unknown')}."
    return Section("Materials", text, tuple(quantities), (), tuple(tables))


def _pieces_text(facts: Mapping[str, Any]) -> str:
    parts = [f"{len(facts['items']) + len(facts.get('added', ()))} pieces"] if facts.get("items") else []
    if facts.get("style"):
        parts.append(str(facts["style"]))
    if facts.get("designs_differ"):
        parts.append(f"{facts['designs_differ']:.0%} of its designs differ from the first alternative's")
    return ", ".join(parts)


def _figures(facts: Mapping[str, Any]) -> tuple[Quantity, ...]:
    rows = (("changed_share", "Changed", "% of the picture"), ("error", "Error of irradiance", "%"))
    return tuple(Quantity(name, round(100 * float(facts[key]), 1), unit) for key, name, unit in rows if key in facts)


def _tables(every: Sequence[Arrangement]) -> tuple[Table, ...]:
    """Return the pieces of the alternatives, those of the same pieces in one table; and what found no place."""
    groups: dict[tuple[tuple[str, str, str], ...], list[int]] = {}
    for number, one in enumerate(every, 1):
        sized = ((item, " × ".join(f"{length:.2f}" for length in item.size_m)) for item in one.items)
        groups.setdefault(tuple((i.id, i.model or i.category, f"{size} m") for i, size in sized), []).append(number)
    found = []
    for rows, numbers in groups.items():
        which = f"alternative{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
        head = ("piece", "model", "width × depth × height")
        found.append(Table(f"{len(rows)} pieces of {which}", head, rows, folded=True))
    if refused := every[0].not_placed:
        not_placed = tuple((item.id, item.rule, item.reason) for item in refused)
        found.append(Table("Not placed", ("piece", "rule", "why"), not_placed))
    return tuple(found)


def _surface_row(one: Mapping[str, Any]) -> tuple[str, str, str]:
    colour = ", ".join(f"{float(v):.3f}" for v in one.get("albedo_rgb", []))
    uncertainty = one.get("uncertainty")
    margin = "" if uncertainty is None else f" ± {float(uncertainty):.3f}"
    return str(one["name"]), f"{float(one['albedo']):.3f}{margin}", colour


def _window_row(one: Mapping[str, Any]) -> tuple[str, str, str]:
    share = ", ".join(f"{float(v):.2f}" for v in one["transmittance"])
    return f"opening-{one['opening']}", share, f"{100 * float(one['covered_share']):.0f} %"


def kept(context: StageContext, name: str, own: Any, kind: type[T], make: Callable[[], tuple[T, ...]]) -> tuple[T, ...]:
    """Return pieces of the page: the former page's where nothing that they are made of has changed; kept as a file.

    ``own``: JSON of what they depend on beside what was read so far; arrangements are left to it.
    """
    path, form = context.folder / f"{name}.json.gz", TypeAdapter(tuple[kind, ...], config=_AS_JSON)  # type: ignore[valid-type]

    def write() -> int:
        return path.write_bytes(gzip.compress(form.dump_json(make()), 1, mtime=0))  # the same bytes at any time

    context.part(name, (path.name,), own, write, apart="arrange")
    return form.validate_json(gzip.decompress(path.read_bytes()))


def _cuts(context: StageContext, look: Callable[[State], Look], views: Sequence[float]) -> list[Cuts]:
    """Return what is shown of the states, one picture at a time; those that stand are not read."""
    least, found = 3 if context.has("render", "staged-1") else 1, list[Cuts]()
    give_back()  # what other sections were drawn with
    own = [views, *(getattr(context.parameters, name, None) for name in ("no_staged_label", "original_url"))]
    for number, state in enumerate(room_states(context), 1):
        wide = next(width for most, width in VIEWER_WIDTHS_PX if max(number, least) <= most)
        shown = [*own, wide, state.name, state.file]
        found += kept(context, f"cuts-{number}", shown, Cuts, partial(_cut, state, look, wide))
        context.let_go(Path(state.file).parts[1])  # not of the emptied room, that follows the photograph
    return found


def _cut(state: State, look: Callable[[State], Look], wide: int) -> tuple[Cuts, ...]:
    image = state.read()
    state = replace(state, read=lambda: image)
    return (cuts_of(state, look(state), wide),)


def staging_sections(context: StageContext, *, whole: bool) -> tuple[Section | None, list[Section]]:
    """Return the section that leads the page, if there is one, and those that follow the summary.

    ``whole``: whether the room was seen all around.
    """
    lead: Section | None = None
    found: list[Section | None] = []
    if whole:
        views = views_of(context)
        cuts = _cuts(context, lambda state: look_of(context, views, state.read()), views)
        lead = lead_section(cuts)
        found += [viewer_section(cuts), model_section(context)]
        arranged = context.optional_artifact("arrange", "arrangement")
        staged = context.optional_artifact("render", "staged")
        paths = {k: context.optional_artifact("arrange", f"plan-{k}") for k in range(1, MOST_STAGED + 1)}
        plans = {k: path.read_bytes() for k, path in paths.items() if isinstance(path, Path)}
        found.append(alternatives_section(arranged, staged, cuts, plans))
        swept = (context.session_path / FOLDER).is_dir()
        look = look_of(context, views, upright_panorama(context)) if swept else Look()
        found.append(relight_section(context.session_path, look, _hours(context)))
    materials = context.optional_artifact("materials", "materials")
    if materials is not None:
        found.append(materials_section(materials, context.summary("materials").get("metrics", {})))
    return lead, [section for section in found if section is not None]


def _hours(context: StageContext) -> tuple[Card, ...]:
    """Return the hours of the day that a run makes; none where it has none."""
    day = context.optional_artifact("day", "day")
    if day is None:
        return ()
    state, found = day["state"].replace("-", " "), list[Card]()
    for number, facts in enumerate(day["hours"], 1):
        jpeg = context.artifact("day", f"hour-{number}").read_bytes()
        found.append(_card(f"{facts['local_time']}, {state}", facts, jpeg))
    return tuple(found)


def relight_section(session: Path, look: Look, hours: tuple[Card, ...] = ()) -> Section | None:
    """Return what `daylit relight` wrote, in one exposure each sweep, and ``hours`` side by side; None: nothing."""
    moments = list(relit_moments(session))
    if not moments and not hours:
        return None
    cards = tuple(_card(title, facts, _view(path, title, made, look)) for path, title, facts, made in moments[:MOST])
    tables: tuple[Table, ...] = ()
    if len(moments) > MOST:
        row = (f"{len(moments) - MOST} more moments are in the folder {FOLDER}",)
        tables = (Table("Not shown", ("what",), (row,)),)
    text = (
        "The room through the day, computed from its materials and the sky; not photographs. Exposure is the same all "
        "day, so evening is darker than noon."
    )
    return Section("Times of day", text, tables=tables, widgets=tuple(Cards(one) for one in (cards, hours) if one))


def relit_moments(session: Path) -> Iterator[tuple[Path, str, Mapping[str, Any], Made]]:
    """Yield the moments that a session's summaries name and have a picture of.

    Left out are damaged files, and moments of a room that has changed since.

    A title is when it is, and what is shown: "2023-06-21 09:00, staged 1".
    """
    seen, folder = set[Path](), session / FOLDER
    for summary in sorted(folder.glob("*.json")):
        data = _read(summary)
        staged = data.get("staged")
        name = "empty" if staged is None else f"staged-{staged}"
        now = standing_sha256(session, name)
        if data.get("of_sha256", now) != now:
            continue
        made = made_of(session, name, further="relit")
        shown = made.state if staged is None else f"staged {staged}"
        for facts in data.get("moments", []):
            at = str(facts.get("local_time", "")).replace(" ", "T").replace(":", "")
            stems = (f"{name}-{at}-{facts.get('weather')}", f"{name}-{at}") if at else (summary.stem,)
            path = next((one for stem in stems if (one := folder / f"{stem}.jpg").is_file()), None)
            if path is not None and path not in seen:
                seen.add(path)
                yield path, f"{facts.get('local_time', 'another sky')}, {shown}", facts, made


def _read(path: Path) -> dict[str, Any]:
    try:
        data = strict_json.loads(path.read_bytes())
    except (OSError, strict_json.StrictJsonError):
        return {}
    known = isinstance(data, dict) and isinstance(data.get("moments"), list)
    return data if known and all(isinstance(one, dict) for one in data["moments"]) else {}


def _card(title: str, facts: Mapping[str, Any], jpeg: bytes) -> Card:
    figures = []
    if isinstance(facts.get("global_horizontal_lx"), int | float):
        figures.append(Quantity("Outdoors", round(float(facts["global_horizontal_lx"]), -1), "lx"))
    if isinstance(facts.get("median_luminance"), int | float):
        figures.append(Quantity("Room, median", float(f"{facts['median_luminance']:.3g}"), str(facts.get("unit", ""))))
    if isinstance(facts.get("sun_elevation_deg"), int | float):
        figures.append(Quantity("Solar elevation", round(float(facts["sun_elevation_deg"]), 1), "°"))
    weather = _WEATHER.get(str(facts.get("weather", "")), "")
    return Card(title, jpeg, f"the room relit, {title}", weather, tuple(figures))


def _view(path: Path, title: str, made: Made, look: Look) -> bytes:
    from PIL import Image

    with Image.open(io.BytesIO(path.read_bytes())) as picture:
        panorama = np.asarray(picture.convert("RGB"), np.uint8)
    seen = cut_view(Panorama(panorama), small_direction(look, WIDTH_PX))[-small_height_px(WIDTH_PX) :]
    made = made._replace(original=look.original)
    shown = made.on(seen, panorama=False) if look.label else np.ascontiguousarray(seen)
    return jpeg_bytes(shown, made=made, title=title, quality=84)
