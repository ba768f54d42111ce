"""``daylit import``: sessions from folders of JPEGs, one or a tree; ``daylit verify``: is a session whole?"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import click

from station.commands.views import answer, parameters

if TYPE_CHECKING:
    from station.frames.dataset import Pair
    from station.frames.dataset_import import DatasetPlan, DatasetRequest, Outcome
    from station.frames.importer import ImportReport, Zone
    from station.session.session import Site

NOT_OF_A_TREE = ("room", "indoor", "outdoor", "readings", "target", "heading", "address")
"""Options that say something of one room only."""


@click.command(params=parameters(__package__, "import"))
def import_session(**options: Any) -> int:
    """Build a session of ROOM from folders of JPEGs, one per camera; the folders are not changed.

    ROOM may be a zip file: of a session, which is unpacked into --into, or of folders named indoor and outdoor.

    \b
    Examples:
      daylit import coda-320 --indoor theta --outdoor canon --reading 34.63
      daylit import attic --indoor attic --shutter 4,1,1/4,1/15 --site 40.44,-79.99 --heading 120
      daylit import kitchen.zip
      daylit import --dataset Cali-HDR --table summary.csv --zone America/New_York --site 40.44,-79.99
    """
    from station.capture.bracket import parse_shutters
    from station.commands.capture import parse_target
    from station.errors import UsageError
    from station.frames.importer import ImportRequest
    from station.frames.importer import import_session as run_import
    from station.frames.packed import take_packed
    from station.session.session import Side

    if options["dataset"] is not None:
        return import_tree(options)
    if options["room"] is None:
        raise UsageError("which room?", where="import", advice="daylit import ROOM --indoor FOLDER")
    if given := [name for name in ("table", "only", "dry_run") if options[name]]:
        raise UsageError(f"--{given[0].replace('_', '-')} needs --dataset", where="import", advice="leave it out")
    folders = {Side.INDOOR: options["indoor"], Side.OUTDOOR: options["outdoor"]}
    if options["indoor"] is not None and options["indoor"] == options["outdoor"]:
        raise UsageError("it is the room's folder, too", where="--outdoor", advice="name the folder of each camera")
    heading_deg, archive = options["heading"], Path(options["room"])
    packed = archive.suffix.lower() == ".zip"
    request = ImportRequest(
        room=archive.stem if packed else options["room"],
        folders={side: folder for side, folder in folders.items() if folder is not None},
        into=options["into"],
        shutter_s=parse_shutters(options["shutter"]),
        readings_cd_m2=options["readings"],
        site=parse_site(options["site"], options["address"]),
        heading_rad=None if heading_deg is None else math.radians(heading_deg % 360),
        target=parse_target(options["target"]),
        camera_zone=parse_zone(options["zone"]),
        strict=options["strict"],
        raw=options["raw"],
    )
    session, report = take_packed(archive, request) if packed else (None, run_import(request))
    if report is not None:
        return _show(report, as_json=options["as_json"])
    return answer({"ok": True, "session": str(session)}, [str(session)], as_json=options["as_json"])


def parse_site(text: str | None, address: str | None = None) -> Site:
    """Return the place given as ``LAT,LON`` in degrees (None: not known) and its address; UsageError for others."""
    from station.errors import UsageError
    from station.session.session import Site

    try:
        latitude_deg, longitude_deg = (None, None) if text is None else (float(v) for v in text.split(","))
        return Site(name=address or "", latitude_deg=latitude_deg, longitude_deg=longitude_deg)
    except ValueError as error:
        advice = "write LAT,LON in degrees, e.g. 40.44,-79.99"
        raise UsageError(f"{text or address!r} is not a location", where="--site", advice=advice) from error


def parse_zone(text: str | None) -> Zone | None:
    """Return minutes east of UTC of ``+HH:MM``, or a named zone (None for None); UsageError for anything else."""
    from station.errors import UsageError
    from station.frames.exif import parse_offset

    minutes = parse_offset(text or "")
    if text is None or minutes is not None:
        return minutes
    try:
        return ZoneInfo(text)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise UsageError(f"{text!r} is not a zone", where="--zone", advice="+HH:MM, or America/New_York") from error


def summary(report: ImportReport) -> dict[str, Any]:
    """Return the JSON object of an import."""
    manifest = report.manifest
    refused = [{"side": str(r.side), "file": r.name, "reason": r.reason, "message": r.message} for r in report.refused]
    return {
        "ok": not manifest.missing,
        "session": str(report.session),
        "status": str(manifest.status),
        "frames": len(manifest.frames),
        "stops_s": list(manifest.bracket.stops_s),
        "refused": refused,
        "ignored": list(report.ignored),
        "missing": list(manifest.missing),
        "warnings": [w.message for w in manifest.warnings],
        "drift_frac": manifest.drift_frac,
    }


def _show(report: ImportReport, *, as_json: bool) -> int:
    from station.frames.rules import seconds_text

    manifest = report.manifest
    if as_json:
        return answer(summary(report), (), as_json=True, exit_code=4 if manifest.missing else 0)
    for frame in manifest.frames:
        click.echo(f"  {frame.side:<8} {seconds_text(frame.camera_s):>9}  {frame.camera_name}")
    for refused in report.refused:
        click.echo(f"  {refused.side:<8} {click.style('  rejected', fg='yellow')}  {refused.name}: {refused.message}")
    for warning in manifest.warnings:
        click.echo(f"  note: {warning.message}")
    click.echo(f"{len(manifest.frames)} frames in {report.session}: {manifest.status}")
    if manifest.missing:
        click.echo("missing: " + "; ".join(manifest.missing))
    return 4 if manifest.missing else 0


@click.command(params=parameters(__package__, "verify"))
def verify(session: Path, *, fast: bool, look: bool, repair: bool, as_json: bool) -> int:
    """Check every file of SESSION (size and SHA-256), that none is extra, and that journal and manifest agree.

    \b
    Examples:
      daylit verify sessions/2023-05-19T1554Z_coda-320
      daylit verify --look --json sessions/2023-05-19T1554Z_coda-320
    Exit code: 0 intact and complete · 4 damaged, or something is missing.
    """
    from station.frames.check import FrameChecker
    from station.session.verify import repair_session, verify_session

    if fast and look:
        raise click.UsageError("--fast reads no frame: leave it out, or --look")
    if repair:
        repair_session(session)
    with FrameChecker() as checker:  # its process starts at the first frame
        report = verify_session(session, fast=fast, frame_check=checker.verify_frame if look else None)
    whole = report.intact and report.status == "complete"
    advice = report.advice()
    lines = [f"note: {note}" for note in report.notes]
    if not report.cut_short:
        problems = [f"{problem.file}: {problem.message} ({problem.code})" for problem in report.problems]
        lines = [*problems, *lines, *(f"missing: {missing}" for missing in report.missing)]
    if report.cut_short:
        verdict = f"interrupted; nothing saved was lost: {report.frames_safe} of {report.frames_planned} frames safe"
    elif report.intact:
        verdict = f"intact, {report.status}; {report.frames_checked} frames checked"
    else:
        verdict = f"NOT intact, problems: {len(report.problems)}; {report.frames_checked} frames checked"
    lines += [f"{verdict} in {session}", *(f"  what to do: {line}" for line in advice)]
    facts = {"ok": whole, **report.to_dict(), "advice": advice}
    return answer(facts, lines, as_json=as_json, exit_code=0 if whole else 4)


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
    whole = all(o.error is None and (o.report is None or not o.report.manifest.missing) for o in outcomes)
    ok = whole and not plan.doubts
    if options["as_json"]:
        click.echo(json.dumps({"ok": ok, **_facts(plan), "brackets": [_dict(o) for o in outcomes]}))
    else:
        _show_doubts(plan)
        made = sum(o.report is not None for o in outcomes)
        there = sum(o.report is None and o.error is None for o in outcomes)
        failed = sum(o.error is not None for o in outcomes)
        click.echo(f"{made} sessions made, {there} were there, {failed} failed, {len(plan.doubts)} not decided")
    return 0 if ok else 4


def _request(options: dict[str, Any]) -> DatasetRequest:
    from station.capture.bracket import parse_shutters
    from station.errors import UsageError
    from station.frames.dataset_import import DatasetRequest

    if given := [name for name in NOT_OF_A_TREE if options[name] not in (None, ())]:
        text = f"{given[0].replace('_', '-')} applies to a single room only"
        raise UsageError(text, where="--dataset", advice="leave it out, or import one room")
    return DatasetRequest(
        root=options["dataset"],
        into=options["into"],
        table=options["table"],
        lost_s=parse_shutters(options["shutter"]),
        site=parse_site(options["site"]),
        zone=parse_zone(options["zone"]),
        only=options["only"],
        raw=options["raw"],
        strict=options["strict"],
    )


def _facts(plan: DatasetPlan) -> dict[str, Any]:
    doubts = [{"message": d.message, "paths": list(d.paths)} for d in plan.doubts]
    return {"doubts": doubts, "table_lines_unused": list(plan.unused_lines)}


def _dict(outcome: Outcome) -> dict[str, Any]:
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
            both = [one for one in (pair.indoor, pair.outdoor) if one is not None]
            sides = " + ".join(f"{one.side} {one.folder.name} ({len(one.files)} files)" for one in both)
            click.echo(f"  {pair.main.name}: {sides}{reading}")
        _show_doubts(plan)
        click.echo(f"{len(plan.pairs)} sessions, {len(plan.doubts)} not decided; nothing was made")
    return 4 if plan.doubts else 0


def _show_doubts(plan: DatasetPlan) -> None:
    for doubt in plan.doubts:
        click.echo(click.style(f"  not decided: {doubt.message}: {', '.join(doubt.paths)}", fg="yellow"))
    if plan.unused_lines:
        click.echo(f"  lines of the table without a bracket: {', '.join(map(str, plan.unused_lines))}")
