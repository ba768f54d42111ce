"""The report as one HTML file that needs nothing else: no fonts, no requests; to look around in, print and send.

Scripts are those of the widgets that the page has, each named in the page's policy by its digest: nothing else may run,
and nothing may be fetched but what is in the page itself.
"""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from processing.pictures.writing import write_bytes
from processing.report.client import ClientData
from processing.report.data import ReportData, Widget, size_text

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
VIEWER = Path(__file__).parent / "static" / "viewer.js"
"""Of panoramas and models: built at set-up from ``studio/web``; without it pages say so, and stand."""


def build_page(data: ReportData) -> str:
    """Return the laboratory's page. Text is escaped, so that names from instruments and files stay text."""
    sections = [section for section in (data.lead, *data.sections) if section]
    widgets = [widget for section in sections for widget in section.widgets]
    return _rendered("report.html.j2", data, widgets, ("report.css", "widgets.css"))


def build_client_page(data: ClientData) -> str:
    """Return the client's page, likewise."""
    widgets = [widget for widget in (data.compared, data.tour, data.day) if widget is not None]
    return _rendered("client.html.j2", data, widgets, ("report.css", "widgets.css", "client.css"))


def _rendered(template: str, data: ReportData | ClientData, widgets: Sequence[Widget], styles: Sequence[str]) -> str:
    environment = _environment()
    environment.filters |= {"size": size_text, "place": _place, "short": _short}
    environment.globals["viewer_built"] = VIEWER.exists()
    names = dict.fromkeys(name for widget in widgets for name in widget.scripts)
    scripts = [_source(name) for name in names if name != VIEWER.name or VIEWER.exists()]
    style = "\n".join(_source(name) for name in styles)
    return environment.get_template(template).render(data=data, style=style, scripts=scripts, policy=_policy(scripts))


def build_certificate(title: str, facts: Sequence[tuple[str, str]], data: Mapping[str, Any]) -> str:
    """Return the page of a certificate (`processing.figures.certificate`); ``facts``: label and text."""
    page = _environment().get_template("certificate.html.j2")
    return page.render(title=title, facts=facts, data=data, style=_source("report.css"), policy=_policy([]))


def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def write_page(path: Path, page: str) -> None:
    """Write a page durably."""
    write_bytes(path, page.encode("utf-8"))


def _source(name: str) -> str:
    # Browsers read an ended line as "\n" before they take the digest.
    return (VIEWER if name == VIEWER.name else TEMPLATES / name).read_text("utf-8")


def _policy(scripts: list[str]) -> str:
    digests = [base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii") for text in scripts]
    rules = {
        "default-src": "'none'",
        "script-src": " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'",
        "img-src": "data: blob:",
        "connect-src": "data: blob:",
        "style-src": "'unsafe-inline'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _place(value: float, ends: tuple[float, float]) -> str:
    """Return where a value stands on a logarithmic scale, per cent."""
    return f"{100 * math.log(value / ends[0]) / math.log(ends[1] / ends[0]):.2f}"


def _short(value: float) -> str:
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    power = math.floor(math.log10(value) + 1e-9)
    return f"{value / 10.0**power:g} × 10{str(power).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
