"""``daylit conform``: does an instrument, real or simulated, do what daylit relies on?"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from station.conform import Outcome
    from station.rig import Rig


@click.command()
@click.option("--rig", "rig_path", type=click.Path(path_type=Path), help="Rig file (default: ./rig.toml).")
@click.option("--simulate", metavar="WORLD", help="Simulated instruments instead.")
@click.option("--only", type=click.Choice(["indoor", "outdoor", "meter"]), help="One instrument.")
@click.option("--delete", "may_delete", is_flag=True, help="May delete from the camera the pictures it took.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object (to send in).")
def conform(rig_path: Path | None, simulate: str | None, only: str | None, *, may_delete: bool, as_json: bool) -> int:
    """Run the conformance suite on the rig's instruments; it takes about eight pictures a camera.

    \b
    Examples:
      daylit conform --simulate room
      daylit conform --rig rig.toml --only meter
      daylit conform --rig rig.toml --json > conform.json
    Exit code: 0 all passed · 1 something failed.
    """
    from station.errors import UsageError
    from station.rig import open_named_rig

    rig = open_named_rig(rig_path, simulate, size="small")
    outcomes: list[Outcome] = []
    try:
        for outcome in _run(rig, only, may_delete=may_delete or rig.simulated):
            outcomes.append(outcome)
            if not as_json:
                click.echo(f"{_mark(outcome)}  {outcome.instrument} {outcome.name.replace('_', ' ')}: {outcome.detail}")
    finally:
        rig.close()
    if not outcomes:
        raise UsageError(f"the rig has no {only or 'instrument'}", where="conform", advice="name another instrument")
    passed = all(o.passed for o in outcomes)
    if as_json:
        click.echo(json.dumps({"ok": passed, "simulated": rig.simulated, "outcomes": [o.to_dict() for o in outcomes]}))
    return 0 if passed else 1


def _mark(outcome: Outcome) -> str:
    if not outcome.passed:
        return click.style("FAIL", fg="red")
    return click.style("skip", fg="yellow") if outcome.detail.startswith("skipped") else click.style("ok  ", fg="green")


def _while_there(outcomes: Iterator[Outcome]) -> Iterator[Outcome]:
    """End after the first outcome when the instrument is not there at all: the others would say nothing new."""
    for outcome in outcomes:
        yield outcome
        if outcome.detail.startswith("DeviceNotFoundError"):
            return


def _run(rig: Rig, only: str | None, *, may_delete: bool) -> Iterator[Outcome]:
    from station.conform import CameraBench, run_camera, run_meter

    for side, camera in rig.cameras.items():
        if only in (None, side.value):
            settings = rig.file.cameras()[side].settings()
            bench = CameraBench(camera, settings, rig.clock, may_delete=may_delete)
            yield from _while_there(run_camera(bench))
    if rig.meter is not None and only in (None, "meter"):
        yield from _while_there(run_meter(rig.meter, rig.clock))
