"""``daylit view``: open a session's report."""

from __future__ import annotations

import json
from pathlib import Path

import click

REPORT = Path("stages", "report", "index.html")


@click.command()
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--no-open", is_flag=True, help="Only say where it is.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object; opens nothing.")
def view(session: Path, *, no_open: bool, as_json: bool) -> int:
    """Open the report of SESSION in the browser, and print where it is.

    The report is one file that needs no network: it can be copied and sent.

    \b
    Examples:
      daylit view sessions/2023-05-19T1554Z_coda-320
      daylit view --no-open sessions/2023-05-19T1554Z_coda-320
    """
    page = _page(session)
    if as_json:
        size = page.stat().st_size
        click.echo(json.dumps({"ok": True, "report": str(page), "uri": page.resolve().as_uri(), "bytes": size}))
        return 0
    click.echo(str(page))
    if not no_open:
        import webbrowser

        if not webbrowser.open(page.resolve().as_uri()):
            click.echo("no browser could be started: open the file by hand", err=True)
    return 0


def _page(session: Path) -> Path:
    """Return the report; a session's folder, its stages' folder or the page itself may be named."""
    from processing.errors import ProcessingError

    for page in (session / REPORT, session / REPORT.name, session):
        if page.is_file() and page.name == REPORT.name:
            return page
    raise ProcessingError("there is no report yet", where=str(session), advice=f"daylit process {session}")
