"""What a report shows, as plain values: a stage gathers them, `processing.report.page` makes the page.

A report is a summary and a row of sections. A section holds text, numbers, pictures, tables, and what moves:
comparisons with a slider, a viewer with a luminance probe, models, cards side by side. These are shown by
``templates/widgets.html.j2`` with the scripts beside it. A later stage adds sections and changes nothing here.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

StageState = Literal["ran", "skipped", "reused", "failed", "not reached"]

_SIGNATURES = {b"\x89PNG": "image/png", b"\xff\xd8": "image/jpeg"}


@dataclass(frozen=True)
class Quantity:
    """A number with unit and, where it is known, its standard uncertainty."""

    name: str
    value: float
    unit: str = ""
    uncertainty: float | None = None
    note: str = ""

    @property
    def text(self) -> str:
        """The number as people read it: rounded to two digits of its uncertainty."""
        return number_text(self.value, self.uncertainty)


class Embedded:
    """A picture (PNG, JPEG or SVG) that stands in the page itself."""

    data: bytes

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        kind = next((kind for start, kind in _SIGNATURES.items() if self.data.startswith(start)), "image/svg+xml")
        return f"data:{kind};base64,{base64.b64encode(self.data).decode('ascii')}"


@dataclass(frozen=True)
class Picture(Embedded):
    """A plot or picture that stands in the page itself."""

    title: str
    data: bytes
    """PNG, JPEG or SVG."""
    alt: str
    """What it shows, for those who cannot see it."""
    caption: str = ""
    wide: bool = False
    """Whether it takes the page's whole width (panoramas)."""


@dataclass(frozen=True)
class Table:
    """A small table of text."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    folded: bool = False
    """Whether it opens on request only: what few readers want."""


@dataclass(frozen=True)
class Section:
    """One part of the report."""

    title: str
    text: str = ""
    quantities: tuple[Quantity, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    widgets: tuple[Widget, ...] = ()
    """What moves; above the rest."""


@dataclass(frozen=True)
class StageLine:
    """What became of one stage."""

    name: str
    state: StageState
    reason: str = ""
    """Why it was skipped or failed, or what it left out."""


@dataclass(frozen=True)
class WarningLine:
    """Something the reader must know before using a number."""

    text: str
    where: str = ""
    code: str = ""


@dataclass(frozen=True)
class FileLine:
    """A file that the results are in."""

    path: str
    """Relative to the session's folder."""
    size_bytes: int
    what: str


@dataclass(frozen=True)
class ReportData:
    """All that the page shows."""

    title: str
    facts: tuple[tuple[str, str], ...]
    """Session, place, time, instruments: label and text."""
    summary: tuple[Quantity, ...]
    stages: tuple[StageLine, ...]
    warnings: tuple[WarningLine, ...]
    sections: tuple[Section, ...]
    files: tuple[FileLine, ...]
    made_with: str
    """Program and version."""
    lead: Section | None = None
    """What stands above the summary: the picture that people came for."""
    unit: str = "cd/m2"
    """Of luminance: another where its scale is not known."""


def number_text(value: float, uncertainty: float | None = None) -> str:
    """Return a number for people: to two digits of its uncertainty ('31.42 ± 0.57'), else to four of its own.

    Thin spaces part thousands; very large and very small numbers become powers of ten.
    """
    if not math.isfinite(value):
        return "unknown"
    if uncertainty is None or not math.isfinite(uncertainty) or uncertainty <= 0:
        return _plain(value)
    decimals = _decimals(uncertainty, 2)
    if max(abs(value), uncertainty) >= 1e7 or uncertainty < 1e-6:
        digits = max(1, math.floor(math.log10(max(abs(value), uncertainty))) + decimals + 1)
        return f"{_scientific(value, digits)} ± {_scientific(uncertainty, 2)}"
    return f"{_fixed(value, decimals)} ± {_fixed(uncertainty, decimals)}"


def size_text(size_bytes: int) -> str:
    """Return a file's size for people, in decimal units."""
    for limit, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size_bytes >= limit:
            return f"{size_bytes / limit:.3g} {unit}"
    return f"{size_bytes} B"


def _decimals(value: float, digits: int) -> int:
    return digits - 1 - math.floor(math.log10(abs(value))) if value else 0


def _plain(value: float) -> str:
    """Return four digits at most, without zeros that say nothing."""
    if value and not 1e-4 <= abs(value) < 1e7:
        return _scientific(value, 4)
    text = _fixed(value, _decimals(value, 4))
    return text.rstrip("0").rstrip(".") if "." in text else text


def _fixed(value: float, decimals: int) -> str:
    return f"{round(value, decimals):,.{max(decimals, 0)}f}".replace(",", "\u2009")


def _scientific(value: float, digits: int) -> str:
    mantissa, _, power = f"{value:.{max(digits - 1, 0)}e}".partition("e")
    return f"{mantissa} × 10^{int(power)}"


@dataclass(frozen=True)
class Shot(Embedded):
    """One state of the room in one picture."""

    name: str
    data: bytes
    """JPEG."""
    alt: str
    tag: str = ""
    """What stands on it under the slider, where that is not its name."""


@dataclass(frozen=True)
class Scene:
    """One view of the room in several states, all of one size."""

    name: str
    shots: tuple[Shot, ...]
    width_px: int
    height_px: int


@dataclass(frozen=True)
class Comparison:
    """States of the room under a slider."""

    kind: ClassVar[str] = "comparison"
    scripts: ClassVar[tuple[str, ...]] = ("slider.js",)
    scenes: tuple[Scene, ...]
    first: str
    second: str
    """Names of the shots that are compared at first."""


@dataclass(frozen=True)
class ViewerState:
    """One state of the room in the 360-degree viewer, and its numbers."""

    name: str
    jpeg: bytes
    """Codes of `encoding.picture_codes`, 2 : 1."""
    luminance: str
    uncertainty: str
    validity: str
    """Packed maps (`encoding.packed`) of the size ``map_px``."""
    map_px: tuple[int, int]
    """Width and height."""
    picture_px: tuple[int, int]
    """Of the picture on disk, of which each place of the map is one pixel."""
    file: str = ""
    """Where that is, relative to the session's folder."""
    staged: bool = False


@dataclass(frozen=True)
class Viewer:
    """A panorama to look around in, with exposure, false colours and a probe."""

    kind: ClassVar[str] = "viewer"
    scripts: ClassVar[tuple[str, ...]] = ("viewer.js",)
    states: tuple[ViewerState, ...]
    middle: float
    """On the tone curve, of the middle code of `encoding.picture_codes`."""
    range: tuple[float, float]
    """Ends of the false colours."""
    ticks: tuple[float, ...]
    colours: bytes
    """(256, 3) sRGB from low to high."""
    unit: str
    yaw_deg: float = 0.0
    label: str = ""
    """Shown on staged states."""
    room: Mapping[str, object] | None = None
    """What a ruler measures in: floor, camera_m, ceiling_m."""

    @property
    def ramp(self) -> str:
        """The colours as a CSS gradient, from the bottom upwards."""
        stops = [tuple(self.colours[3 * i : 3 * i + 3]) for i in range(0, 256, 15)]
        return f"linear-gradient(to top, {', '.join(f'rgb({r} {g} {b})' for r, g, b in stops)})"

    @property
    def json(self) -> str:
        """All of it for the script, safe within HTML."""
        states = [{**vars(one), "jpeg": base64.b64encode(one.jpeg).decode("ascii")} for one in self.states]
        colours = base64.b64encode(self.colours).decode("ascii")
        return safe_json({**vars(self), "colours": colours, "states": states})


@dataclass(frozen=True)
class Model:
    """A scene in three dimensions."""

    name: str
    glb: bytes
    alt: str

    @property
    def text(self) -> str:
        """The file in base64."""
        return base64.b64encode(self.glb).decode("ascii")


@dataclass(frozen=True)
class Models:
    """Scenes to turn around, one at a time."""

    kind: ClassVar[str] = "models"
    scripts: ClassVar[tuple[str, ...]] = ("viewer.js",)
    models: tuple[Model, ...]
    note: str = ""


@dataclass(frozen=True)
class Card(Embedded):
    """A picture with a few figures."""

    title: str
    data: bytes
    alt: str
    text: str = ""
    quantities: tuple[Quantity, ...] = ()


@dataclass(frozen=True)
class Cards:
    """Pictures side by side: alternatives, times of day."""

    kind: ClassVar[str] = "cards"
    cards: tuple[Card, ...]
    scripts: tuple[str, ...] = ()
    first: int = 0
    """The one that a slider begins with."""


Widget = Comparison | Viewer | Models | Cards


def safe_json(value: object) -> str:
    """Return JSON that cannot end a script element or begin a comment."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
