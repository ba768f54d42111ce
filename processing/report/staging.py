"""What people look at first, from the stages: before and after, viewer, models, alternatives, materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from processing.layout.arrangement import Arrangement, Arrangements, PlacedItem
from processing.report.data import Quantity, Section, Table
from processing.report.relight_section import relight_section
from processing.report.room_states import (
    lead_section,
    look_of,
    model_section,
    room_states,
    viewer_section,
)
from processing.report.states import State, small_view
from processing.report.tone import Look
from processing.report.widgets import Card, Cards
from processing.stages.contract import StageContext
from processing.stages.parameters import MOST_STAGED

# Sections of the report on what stands where, and what the room's surfaces reflect.


METHODS = {
    "differential": "the photograph is kept, and changed only where the furniture changes its light",
    "global": "the whole room is rendered",
    "ibl": "furniture is lit by the panorama alone; it casts no light or shade into the room",
}


def alternatives_section(
    arranged: Arrangements | None,
    staged: Mapping[str, Any] | None,
    states: Sequence[State],
    plans: Mapping[int, bytes],
    look: Look,
) -> Section | None:
    """Return the alternatives side by side: staged views, plans, figures; None where nothing was arranged.

    ``staged`` is the JSON of the stage render; ``plans``: SVG by number from 1.
    """
    if arranged is None or not arranged.arrangements:
        return None
    every = arranged.arrangements
    told: dict[int, Mapping[str, Any]] = dict(enumerate((staged or {}).get("alternatives", []), 1))
    pictures = {state.name: state for state in states if state.staged}
    views = [
        Card(
            f"Alternative {number}",
            small_view(pictures[f"Staged {number}"], look),
            f"virtually staged room, alternative {number}",
            _told_text(told.get(number, {})),
            _figures(told.get(number, {})),
        )
        for number in range(1, len(every) + 1)
        if f"Staged {number}" in pictures
    ]
    drawn = [
        Card(f"Plan {number}", plans[number], f"floor plan of alternative {number}", one.differs_by,
             (Quantity("Score", round(one.score, 2), "of 1"),))
        for number, one in enumerate(every, 1)
        if number in plans
    ]  # fmt: skip
    method = (staged or {}).get("method", "")
    text = f"Rules: {every[0].rule_set}."
    if method:
        text += f" Method {method}: {METHODS.get(method, 'see the documentation')}."
    widgets = tuple(Cards(tuple(cards)) for cards in (views, drawn) if cards)
    return Section("Alternatives", text, tables=_tables(every), widgets=widgets)


def materials_section(materials: Mapping[str, Any], metrics: Mapping[str, Any]) -> Section:
    """Return what surfaces reflect and windows let through."""
    quantities = []
    if "told_share" in metrics:
        note = "the rest is taken from its neighbours"
        quantities.append(Quantity("Surfaces told from light", round(100 * metrics["told_share"], 1), "%", note=note))
    if "floor_gloss" in materials:
        quantities.append(Quantity("Gloss of the floor", materials["floor_gloss"], "", note="0 matte, 1 full varnish"))
    surfaces = materials.get("surfaces", [])
    large = tuple(_surface_row(one) for one in surfaces if not str(one["name"]).startswith("reveal"))
    small = tuple(_surface_row(one) for one in surfaces if str(one["name"]).startswith("reveal"))
    head = ("surface", "albedo", "red, green, blue")
    tables = [Table("Mean albedo", head, large)] if large else []
    if small:
        tables.append(Table("Albedo of the windows' niches", head, small, folded=True))
    if windows := materials.get("windows", []):
        shown = tuple(_window_row(one) for one in windows)
        tables.append(Table("Windows", ("opening", "transmittance (r, g, b)", "covered"), shown))
    if notes := [*materials.get("notes", [])]:
        tables.append(Table("Notes", ("note",), tuple((str(note),) for note in notes)))
    text = f"Light outdoors taken from: {materials.get('outdoors', 'unknown')}."
    return Section("Materials", text, tuple(quantities), (), tuple(tables))


def _told_text(told: Mapping[str, Any]) -> str:
    parts = [f"{len(told['items'])} pieces"] if told.get("items") else []
    if told.get("style"):
        parts.append(str(told["style"]))
    return ", ".join(parts)


def _figures(told: Mapping[str, Any]) -> tuple[Quantity, ...]:
    found = []
    if "changed_share" in told:
        found.append(Quantity("Changed", round(100 * float(told["changed_share"]), 1), "% of the picture"))
    if "error" in told:
        found.append(Quantity("Error of the light", round(100 * float(told["error"]), 1), "%"))
    return tuple(found)


def _tables(every: Sequence[Arrangement]) -> tuple[Table, ...]:
    """Return the pieces of the alternatives, those of the same pieces in one table; and what found no place."""
    groups: dict[tuple[tuple[str, str, str], ...], list[int]] = {}
    for number, one in enumerate(every, 1):
        groups.setdefault(tuple(_item_row(item) for item in one.items), []).append(number)
    found = []
    for rows, numbers in groups.items():
        which = f"alternative{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
        head = ("piece", "model", "width × depth × height")
        found.append(Table(f"{len(rows)} pieces of {which}", head, rows, folded=True))
    if refused := every[0].not_placed:
        not_placed = tuple((item.id, item.rule, item.reason) for item in refused)
        found.append(Table("Not placed", ("piece", "rule", "why"), not_placed))
    return tuple(found)


def _item_row(item: PlacedItem) -> tuple[str, str, str]:
    size = " × ".join(f"{length:.2f}" for length in item.size_m)
    return item.id, item.model or item.category, f"{size} m"


def _surface_row(one: Mapping[str, Any]) -> tuple[str, str, str]:
    colour = ", ".join(f"{float(v):.3f}" for v in one.get("albedo_rgb", []))
    uncertainty = one.get("uncertainty")
    margin = "" if uncertainty is None else f" ± {float(uncertainty):.3f}"
    return str(one["name"]), f"{float(one['albedo']):.3f}{margin}", colour


def _window_row(one: Mapping[str, Any]) -> tuple[str, str, str]:
    share = ", ".join(f"{float(v):.2f}" for v in one["transmittance"])
    return f"opening {one['opening']}", share, f"{100 * float(one['covered_share']):.0f} %"


def staging_sections(context: StageContext) -> tuple[Section | None, list[Section]]:
    """Return the section that leads the page, if there is one, and those that follow the summary."""
    states = room_states(context)
    lead: Section | None = None
    found: list[Section | None] = []
    if states:
        look = look_of(context, states)
        lead = lead_section(states, look)
        found += [viewer_section(states, look), model_section(context)]
        arranged = context.optional_artifact("arrange", "arrangement")
        staged = context.optional_artifact("render", "staged")
        found.append(alternatives_section(arranged, staged, states, _plans(context), look))
        found.append(relight_section(context.session_path, look))
    materials = context.optional_artifact("materials", "materials")
    if materials is not None:
        found.append(materials_section(materials, context.summary("materials").get("metrics", {})))
    return lead, [section for section in found if section is not None]


def _plans(context: StageContext) -> dict[int, bytes]:
    """Return the drawn floor plans by number."""
    found = {}
    for number in range(1, MOST_STAGED + 1):
        path = context.optional_artifact("arrange", f"plan-{number}")
        if isinstance(path, Path):
            found[number] = path.read_bytes()
    return found
