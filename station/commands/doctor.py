"""``daylit doctor``: is everything ready for a day on site?"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from station.preflight import Check

_MARKS = {"ok": ("ok  ", "green"), "warn": ("warn", "yellow"), "fail": ("FAIL", "red")}


@click.command()
@click.option(
    "--rig",
    "rig_path",
    type=click.Path(path_type=Path),
    help="Connect to, set and check every instrument of this rig file.",
)
@click.option("--simulate", metavar="WORLD", help="Check simulated instruments instead, e.g. room.")
@click.option(
    "--into", type=click.Path(path_type=Path, file_okay=False), default=Path("sessions"), help="Folder of sessions."
)
@click.option("--write-rig", type=click.Path(path_type=Path), metavar="FILE", help="Write an example rig file and end.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def doctor(rig_path: Path | None, simulate: str | None, into: Path, write_rig: Path | None, *, as_json: bool) -> int:
    """Check the computer, the links and, with --rig, the instruments themselves.

    \b
    Examples:
      daylit doctor
      daylit doctor --write-rig rig.toml
      daylit doctor --rig rig.toml
    Exit code: 0 nothing forbids a capture · 1 something does.
    """
    if write_rig is not None:
        return _write_example(write_rig)
    from station.doctor import check_computer, list_instruments

    checks = list(check_computer(into))
    if simulate is None:
        checks += list_instruments()
    checks += _check_rig(rig_path, simulate, into)
    failed = any(c.level == "fail" for c in checks)
    if as_json:
        click.echo(json.dumps({"ok": not failed, "checks": [c.to_dict() for c in checks]}))
    else:
        for check in checks:
            _print(check)
    return 1 if failed else 0


def _check_rig(rig_path: Path | None, simulate: str | None, into: Path) -> list[Check]:
    if rig_path is None and simulate is None:
        return []
    from station.preflight import check_rig
    from station.rig import open_named_rig

    rig = open_named_rig(rig_path, simulate, size="small")
    try:
        return list(check_rig(rig, into, bytes_needed=0).checks)
    finally:
        rig.close()


def _write_example(path: Path) -> int:
    from station.errors import ResourceError, UsageError
    from station.rig_file import EXAMPLE

    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(EXAMPLE)
    except FileExistsError as error:
        raise UsageError("is already there", where=str(path), advice="choose another name") from error
    except OSError as error:
        raise ResourceError(
            f"cannot be written: {error.strerror}", where=str(path), advice="choose a folder you may write to"
        ) from error
    click.echo(f"wrote {path}: look through it, then daylit doctor --rig {path}")
    return 0


def _print(check: Check) -> None:
    from station.commands.views import printable

    mark, colour = _MARKS[str(check.level)]
    click.echo(f"{click.style(mark, fg=colour)}  {check.name}: {printable(check.text)}")
    if check.advice and check.level != "ok":
        click.echo(f"      do: {printable(check.advice)}")
