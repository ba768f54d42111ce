"""``daylit import --dataset``: many sessions from a tree of bracket folders."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import click

if TYPE_CHECKING:
    from station.frames.dataset import Pair
    from station.frames.dataset_import import DatasetPlan, DatasetRequest, Outcome

NOT_OF_A_TREE = ("room", "indoor", "outdoor", "readings", "target", "heading")
"""Options that say something of one room only."""


def import_tree(options: dict[str, Any]) -> int:
    """Import a tree; returns 0 when every bracket is a complete session, else 4."""
    from station.frames.check import FrameChecker
    from station.frames.dataset_import import doubt_error, import_dataset, plan_dataset

    request = _request(options)
    with FrameChecker() as checker:
        plan = plan_dataset(request, checker)
        if not plan.pairs and plan.doubts:
            raise doubt_error(plan.doubts)
        if options["dry_run"]:
            return _show_plan(plan, as_json=options["as_json"])
        outcomes = []
        for outcome in import_dataset(request, plan, checker):
            outcomes.append(outcome)
            if not options["as_json"]:
                click.echo(_line(outcome))
    return _show_end(plan, outcomes, as_json=options["as_json"])


def _request(options: dict[str, Any]) -> DatasetRequest:
    from station.capture.bracket import parse_shutter
    from station.commands.sessions import parse_site
    from station.errors import UsageError
    from station.frames.dataset_import import DatasetRequest

    if given := [name for name in NOT_OF_A_TREE if options[name] not in (None, ())]:
        text = f"{given[0].replace('_', '-')} says something of one room only"
        raise UsageError(text, where="--dataset", advice="leave it out, or import one room")
    return DatasetRequest(
        root=options["dataset"],
        into=options["into"],
        table=options["table"],
        lost_s=tuple(parse_shutter(s) for s in options["shutter"].split(",")) if options["shutter"] else (),
        site=parse_site(options["site"]),
        zone=_zone(options["zone"]),
        only=options["only"],
        raw=options["raw"],
        strict=options["strict"],
    )


def _show_end(plan: DatasetPlan, outcomes: list[Outcome], *, as_json: bool) -> int:
    whole = all(o.error is None and (o.report is None or not o.report.manifest.missing) for o in outcomes)
    ok = whole and not plan.doubts
    if as_json:
        click.echo(json.dumps({"ok": ok, **_facts(plan), "brackets": [_dict(o) for o in outcomes]}))
    else:
        _show_doubts(plan)
        made = sum(o.report is not None for o in outcomes)
        there = sum(o.report is None and o.error is None for o in outcomes)
        failed = sum(o.error is not None for o in outcomes)
        click.echo(f"{made} sessions made, {there} were there, {failed} failed, {len(plan.doubts)} not decided")
    return 0 if ok else 4


def _zone(text: str | None) -> ZoneInfo | int | None:
    from station.commands.sessions import parse_zone
    from station.errors import UsageError

    if text is None or text[:1] in "+-":
        return parse_zone(text)
    try:
        return ZoneInfo(text)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        advice = "write +HH:MM or a name such as America/New_York"
        raise UsageError(f"{text!r} is not a zone", where="--zone", advice=advice) from error


def _facts(plan: DatasetPlan) -> dict[str, Any]:
    doubts = [{"message": d.message, "paths": list(d.paths)} for d in plan.doubts]
    return {"doubts": doubts, "table_lines_unused": list(plan.unused_lines)}


def _sides(pair: Pair) -> str:
    both = (pair.indoor, pair.outdoor)
    return " + ".join(f"{b.side} {b.folder.name} ({len(b.files)} files)" for b in both if b is not None)


def _dict(outcome: Outcome) -> dict[str, Any]:
    from station.commands.sessions import summary

    found: dict[str, Any] = {"name": outcome.pair.main.name, "folders": _folders(outcome.pair)}
    if outcome.report is not None:
        return found | summary(outcome.report)
    return found | ({"ok": False, "error": outcome.error.to_dict()} if outcome.error else {"ok": True, "there": True})


def _folders(pair: Pair) -> list[str]:
    return [str(b.folder) for b in (pair.indoor, pair.outdoor) if b is not None]


def _line(outcome: Outcome) -> str:
    name = outcome.pair.main.name
    if outcome.error is not None:
        return click.style(f"  failed  {name}: {outcome.error}", fg="red")
    if outcome.report is None:
        return f"  there   {name}"
    manifest = outcome.report.manifest
    missing = f"; missing: {'; '.join(manifest.missing)}" if manifest.missing else ""
    return f"  made    {name}: {len(manifest.frames)} frames, {manifest.status}{missing}"


def _show_plan(plan: DatasetPlan, *, as_json: bool) -> int:
    if as_json:
        pairs = [{"name": p.main.name, "folders": _folders(p), "in_table": p.indoor in plan.rows} for p in plan.pairs]
        click.echo(json.dumps({"ok": not plan.doubts, **_facts(plan), "brackets": pairs}))
    else:
        for pair in plan.pairs:
            row = plan.rows.get(pair.indoor) if pair.indoor else None
            reading = "" if row is None or row.luminance_cd_m2 is None else f", {row.luminance_cd_m2:g} cd/m2"
            click.echo(f"  {pair.main.name}: {_sides(pair)}{reading}")
        _show_doubts(plan)
        click.echo(f"{len(plan.pairs)} sessions, {len(plan.doubts)} not decided; nothing was made")
    return 4 if plan.doubts else 0


def _show_doubts(plan: DatasetPlan) -> None:
    for doubt in plan.doubts:
        click.echo(click.style(f"  not decided: {doubt.message}: {', '.join(doubt.paths)}", fg="yellow"))
    if plan.unused_lines:
        click.echo(f"  lines of the table without a bracket: {', '.join(map(str, plan.unused_lines))}")
