"""``daylit choices``: what a session goes on with, when it was chosen and by which command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.commands.views import FILE, answer

if TYPE_CHECKING:
    from processing.running.choices import Choices


@click.command()
@click.argument("session", type=FILE)
@click.argument("given", nargs=-1, metavar="[NAME=VALUE]...")
@click.option("--forget", metavar="NAME", multiple=True, help="Choose it no longer (repeatable); all: nothing is.")
@click.option("--past", is_flag=True, help="What was chosen before that, too.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def choices(session: Path, given: tuple[str, ...], *, forget: tuple[str, ...], past: bool, as_json: bool) -> int:
    """Show what was chosen for SESSION: options that process, batch, relight and view-from go on with.

    NAME=VALUE chooses without running anything; names are those of the options of `daylit process`, without dashes.
    Files outside of the session are copied into its folder choices, so that it can be moved.

    \b
    Examples:
      daylit choices sessions/2023-05-19T1554Z_coda-320
      daylit choices sessions/2023-05-19T1554Z_coda-320 set=living quality=draft
      daylit choices sessions/2023-05-19T1554Z_coda-320 --forget mask
    """
    from processing.errors import ParameterError
    from processing.running.choices import forget as drop
    from processing.running.choices import read_choices, remember

    pairs = dict(pair.partition("=")[::2] for pair in given)
    if wrong := [pair for pair in given if "=" not in pair]:
        raise ParameterError(f"{wrong[0][:60]!r} is not NAME=VALUE", advice="such as set=living")
    if forget:
        drop(session, forget)
    if pairs:
        remember(session, {name.removeprefix("--"): value for name, value in pairs.items()}, by="daylit choices")
    found = read_choices(session)
    facts = {"ok": True, "session": session.name, **found.model_dump(mode="json")}
    return answer(facts, _lines(found, past=past), as_json=as_json)


def _lines(found: Choices, *, past: bool) -> list[str]:
    from processing.running.choices import shown

    lines = [
        f"{name:<16} {shown(one):<28} {one.at:%Y-%m-%d %H:%M} UTC  {one.by}{f'  ({one.file})' if one.file else ''}"
        for name, one in found.chosen.items()
    ]
    if past:
        lines += [f"until {one.until:%Y-%m-%d %H:%M} UTC: {one.name} {shown(one)}  {one.by}" for one in found.past]
    return lines or ["nothing was chosen: every option has its default"]
