"""Section of the report on the room in other light: what `daylit relight` wrote beside the session's stages."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from processing.exchange.jpeg_files import TIMES, jpeg_bytes, labelled
from processing.report.data import Quantity, Section, Table
from processing.report.states import small_direction, small_height_px
from processing.report.tone import Look
from processing.report.widgets import Card, Cards
from processing.sphere.views import Panorama, cut_view
from station.session import strict_json

FOLDER = "relight"
MOST = 24
"""Moments that the page shows."""
WIDTH_PX = 640
_LABEL_SEEN_RAD = math.radians(38)
_WEATHER = {"captured": "the captured weather", "clear": "clear", "overcast": "overcast"}


@dataclass(frozen=True)
class Moment:
    """The room at one moment or under one sky."""

    path: Path
    staged: int | None
    facts: Mapping[str, Any]

    @property
    def title(self) -> str:
        """When it is, and what is shown."""
        when = str(self.facts.get("local_time", "another sky"))
        return f"{when}, {'emptied' if self.staged is None else f'staged {self.staged}'}"


def relight_section(session: Path, look: Look) -> Section | None:
    """Return the moments side by side, in one exposure each sweep; None where nothing was relit."""
    moments = list(relit_moments(session / FOLDER))
    if not moments:
        return None
    cards = tuple(_card(moment, look) for moment in moments[:MOST])
    tables: tuple[Table, ...] = ()
    if len(moments) > MOST:
        row = (f"{len(moments) - MOST} more moments are in the folder {FOLDER}",)
        tables = (Table("Not shown", ("what",), (row,)),)
    text = (
        "The room by day, computed from its materials and the sky: not photographs. Exposure is common to a day's "
        "pictures, so that evening is darker than noon."
    )
    return Section("Times of day", text, tables=tables, widgets=(Cards(cards),))


def relit_moments(folder: Path) -> Iterator[Moment]:
    """Return what the folder's summaries tell and has a picture, in order of their names; what is damaged is left."""
    seen: set[Path] = set()
    for summary in sorted(folder.glob("*.json")):
        data = _read(summary)
        staged = data.get("staged")
        name = "empty" if staged is None else f"staged-{staged}"
        for facts in data.get("moments", []):
            stem = str(facts.get("local_time", "")).replace(" ", "T").replace(":", "")
            path = folder / (f"{name}-{stem}.jpg" if stem else f"{summary.stem}.jpg")
            if path.is_file() and path not in seen:
                seen.add(path)
                yield Moment(path, staged, facts)


def _read(path: Path) -> dict[str, Any]:
    try:
        data = strict_json.loads(path.read_bytes())
    except (OSError, strict_json.StrictJsonError):
        return {}
    known = isinstance(data, dict) and isinstance(data.get("moments"), list)
    return data if known and all(isinstance(one, dict) for one in data["moments"]) else {}


def _card(moment: Moment, look: Look) -> Card:
    facts = moment.facts
    figures = []
    if isinstance(facts.get("global_horizontal_lx"), int | float):
        figures.append(Quantity("Outdoors", round(float(facts["global_horizontal_lx"]), -1), "lx"))
    if isinstance(facts.get("median_luminance"), int | float):
        unit = str(facts.get("unit", ""))
        figures.append(Quantity("Room, median", float(f"{facts['median_luminance']:.3g}"), unit))
    if isinstance(facts.get("sun_elevation_deg"), int | float):
        figures.append(Quantity("Sun's height", round(float(facts["sun_elevation_deg"]), 1), "°"))
    weather = _WEATHER.get(str(facts.get("weather", "")), "")
    return Card(moment.title, _view(moment, look), f"the room relit, {moment.title}", weather, tuple(figures))


def _view(moment: Moment, look: Look) -> bytes:
    from PIL import Image

    with Image.open(io.BytesIO(moment.path.read_bytes())) as picture:
        panorama = np.asarray(picture.convert("RGB"), np.uint8)
    seen = cut_view(Panorama(panorama), small_direction(look, WIDTH_PX))[-small_height_px(WIDTH_PX) :]
    staged = moment.staged is not None
    bare = staged and bool(look.label) and not _label_in_view(look.yaw_rad)
    shown = labelled(seen, look.label, panorama=False) if bare else np.ascontiguousarray(seen)
    return jpeg_bytes(shown, staged=staged, title=moment.title, quality=84)


def _label_in_view(yaw_rad: float) -> bool:
    """Tell whether a view shows one of the labels that stand in the panorama itself, evenly around from the middle."""
    return abs(math.remainder(yaw_rad, 2 * math.pi / TIMES)) < _LABEL_SEEN_RAD
