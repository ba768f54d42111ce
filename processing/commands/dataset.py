"""``daylit dataset``: processed sessions as a data set for others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from station.commands.views import printable


@click.group()
def dataset() -> None:
    """Build, check and sum up a data set of processed sessions.

    \b
    Examples:
      daylit dataset build rooms --name "Rooms of 2023" --licence CC-BY-4.0
      daylit dataset check rooms
    """


@dataset.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--name", required=True, help="What the data set is called.")
@click.option("--licence", required=True, help="SPDX identifier (CC-BY-4.0) or address.")
@click.option("--creator", default="", help="Who made it.")
@click.option("--cite", default="", help="How to cite it.")
@click.option("--url", default="", help="Where it can be found.")
@click.option("--release", default="1.0.0", show_default=True, help="Version of the data set.")
@click.option("--date", default="", metavar="YYYY-MM-DD", help="Of publication.")
@click.option(
    "--split",
    default="70,15,15",
    show_default=True,
    metavar="A,B,C",
    help="Per cent of rooms to train, validate, test.",
)
@click.option("--zone", metavar="NAME", help="Of dates and times in the index (default: each session's).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def build(folder: Path, *, split: str, zone: str | None, as_json: bool, **about: str) -> int:
    """Write index.csv, croissant.json, LICENCE.txt and SHA256SUMS into FOLDER, beside its sessions.

    Splits are by room: all sessions of a room are in one, and stay in it when sessions are added.

    \b
    Example: daylit dataset build rooms --name "Rooms of 2023" --licence CC-BY-4.0 --zone America/New_York
    """
    from processing.batch.croissant import Description
    from processing.batch.dataset import build as make
    from processing.batch.dataset import summary as sum_up
    from processing.calibration.outdoor.sun_place import zone_named
    from station.commands.views import numbers

    description = Description(version=about.pop("release"), **about)
    train, validation, test = (part / 100 for part in numbers("--split", split, 3, "per cent, such as 70,15,15"))
    made = make(folder, description, shares=(train, validation, test), zone=zone and str(zone_named(zone)))
    if as_json:
        click.echo(json.dumps({"ok": True, "files": [str(path) for path in made], **sum_up(folder)}))
        return 0
    for path in made:
        click.echo(str(path))
    _show(sum_up(folder))
    return 0


@dataset.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def check(folder: Path, *, as_json: bool) -> int:
    """Compare FOLDER with its checksums, index and metadata.

    \b
    Example: daylit dataset check rooms
    Exit code: 0 all as it was built · 1 something is missing, changed, new or contradicts itself.
    """
    from processing.batch.dataset import check as compare

    report = compare(folder)
    if as_json:
        values = {name: getattr(report, name) for name in ("files", "missing", "changed", "new", "problems")}
        click.echo(json.dumps({"ok": report.ok, **values}))
        return 0 if report.ok else 1
    for word in ("missing", "changed", "new"):
        for name in getattr(report, word):
            click.echo(printable(f"{word}: {name}"))
    for problem in report.problems:
        click.echo(printable(problem))
    click.echo(f"{report.files} files compared: {'all as it was built' if report.ok else 'not as it was built'}")
    return 0 if report.ok else 1


@dataset.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def summary(folder: Path, *, as_json: bool) -> int:
    """Say what the data set in FOLDER holds, in numbers.

    \b
    Example: daylit dataset summary rooms --json
    """
    from processing.batch.dataset import summary as sum_up

    found = sum_up(folder)
    if as_json:
        click.echo(json.dumps({"ok": True, **found}))
    else:
        _show(found)
    return 0


def _show(found: dict[str, Any]) -> None:
    for name, value in found.items():
        text = value
        if isinstance(value, dict):
            parts = ((key, f"{one:g}" if isinstance(one, float) else one) for key, one in value.items())
            text = ", ".join(f"{key} {one}" for key, one in parts)
        elif isinstance(value, list):
            text = " to ".join(value)
        click.echo(printable(f"{name.replace('_', ' '):<18} {'-' if text is None else text}"))
