"""What people look at first, from the stages: before and after, viewer, models, alternatives, materials."""

from __future__ import annotations

from pathlib import Path

from processing.report.data import Section
from processing.report.relight_section import relight_section
from processing.report.room_states import (
    MOST_STAGED,
    lead_section,
    look_of,
    model_section,
    room_states,
    viewer_section,
)
from processing.report.staging_sections import alternatives_section, materials_section
from processing.stages.contract import StageContext


def staging_sections(context: StageContext) -> tuple[Section | None, list[Section]]:
    """Return the section that leads the page, if there is one, and those that follow the summary."""
    states = room_states(context)
    lead: Section | None = None
    found: list[Section | None] = []
    if states:
        look = look_of(context, states)
        lead = lead_section(states, look)
        found += [viewer_section(states, look), model_section(context)]
        arrangement = context.optional_artifact("arrange", "arrangement")
        staged = context.optional_artifact("render", "staged")
        found.append(alternatives_section(arrangement, staged, states, _plans(context), look))
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
