"""What a report shows, as plain values: a stage gathers them, `processing.report.page` makes the page.

A report is a summary and a row of sections; a later stage adds sections of its own and changes nothing here.
"""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from processing.report.widgets import Widget

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


@dataclass(frozen=True)
class Picture:
    """A plot or picture that stands in the page itself."""

    title: str
    data: bytes
    """PNG, JPEG or SVG."""
    alt: str
    """What it shows, for those who cannot see it."""
    caption: str = ""
    wide: bool = False
    """Whether it takes the page's whole width (panoramas)."""

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return data_uri(self.data)


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


def data_uri(data: bytes) -> str:
    """Return a picture (PNG, JPEG or SVG) as a data URI."""
    kind = next((kind for start, kind in _SIGNATURES.items() if data.startswith(start)), "image/svg+xml")
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


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
