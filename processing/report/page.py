"""The report as one HTML file that needs nothing else: no scripts, no fonts, no requests; to read, print and send."""

from __future__ import annotations

from pathlib import Path

from processing.picture_writing import write_bytes
from processing.report.data import ReportData, size_text

TEMPLATES = Path(__file__).parent / "templates"


def build_page(data: ReportData) -> str:
    """Return the whole page. Text is escaped, so that names from instruments and files stay text."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["size"] = size_text
    style = (TEMPLATES / "report.css").read_text("utf-8")
    return environment.get_template("report.html.j2").render(data=data, style=style)


def write_page(path: Path, data: ReportData) -> None:
    """Write the page durably."""
    write_bytes(path, build_page(data).encode("utf-8"))
