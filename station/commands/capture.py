"""``daylit capture``: one room, from preflight to a verified session."""

from __future__ import annotations

import json
import math
import shlex
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

if TYPE_CHECKING:
    from station.capture.capture import Capture
    from station.capture.rig import Rig
    from station.capture.rig_file import RigFile
    from station.session.session import MeterTarget, SessionManifest


@click.command()
@click.argument("room", required=False)
@click.option("--rig", "rig_path", type=click.Path(path_type=Path), help="Rig file (default: ./rig.toml).")
@click.option(
    "--into",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("sessions"),
    show_default=True,
    help="Folder of sessions.",
)
@click.option(
    "--simulate",
    metavar="WORLD",
    help="Simulated instruments looking at: room, bedroom-7 (living, dining, office, empty; any seed), chart, "
    "uniform:100, INDOOR.hdr,OUTDOOR.hdr; or recorded:FILE, replayed from --record.",
)
@click.option(
    "--size",
    type=click.Choice(["full", "half", "quarter", "small"]),
    default="full",
    show_default=True,
    help="Picture size of simulated cameras.",
)
@click.option("--bracket", type=click.Choice(["full", "adaptive"]), help="Nine stops, or only those the scene needs.")
@click.option("--stops", metavar="S,S,...", help="Exposure times, e.g. 4,1,1/4 (default: the rig's).")
@click.option("--only", type=click.Choice(["indoor", "outdoor"]), help="One camera only.")
@click.option(
    "--reading",
    "readings",
    type=float,
    multiple=True,
    metavar="CD_M2",
    help="Luminance typed from the display; twice: before, after.",
)
@click.option("--no-meter", is_flag=True, help="Without a meter; the session is marked so.")
@click.option("--target", metavar="LON,LAT", help="Where the meter looks in the panorama, degrees.")
@click.option(
    "--resume",
    "resume_path",
    type=click.Path(path_type=Path),
    metavar="SESSION",
    help="Complete a partial session; repeat its --rig or --simulate, --only, --no-meter.",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write every byte of the links there (to send in).",
)
@click.option("--dry-run", is_flag=True, help="Print the bracket table and end.")
@click.option("--json", "as_json", is_flag=True, help="JSON events, one a line (always so when not on a terminal).")
def capture(**options: Any) -> int:
    """Capture ROOM: meter reading, synchronised brackets of both cameras, meter reading.

    \b
    Examples:
      daylit capture coda-320 --rig rig.toml
      daylit capture attic --bracket adaptive --reading 34.63
      daylit capture --resume sessions/2023-05-19T1554Z_coda-320
      daylit capture test --simulate bedroom-7 --size quarter
    """
    from station.capture.intake import check_typed

    _refuse_what_would_do_nothing(options)
    for reading in options["readings"]:
        check_typed(reading)
    if options["dry_run"]:
        return _dry_run(options)
    rig = _open_rig(options)
    try:
        return _run(rig, options)
    finally:
        rig.close()


def _refuse_what_would_do_nothing(options: dict[str, Any]) -> None:
    from station.errors import UsageError

    if _is_replay(options) and (given := [name for name in ("rig_path", "record") if options[name]]):
        names = ", ".join("--rig" if name == "rig_path" else f"--{name}" for name in given)
        raise UsageError(
            f"a transcript has its own rig, and is one: {names}", where="--simulate", advice="leave it out"
        )
    if options["size"] != "full" and (not options["simulate"] or _is_replay(options)):
        raise UsageError("only simulated cameras have other sizes", where="--size", advice="set size_px in the rig")
    if options["resume_path"] is None:
        return
    given = [name for name in ("room", "stops", "bracket", "target", "dry_run") if options[name]]
    if given:
        names = ", ".join("ROOM" if name == "room" else f"--{name.replace('_', '-')}" for name in given)
        raise UsageError(f"--resume takes them from the session: {names}", where="capture", advice="leave them out")


def _run(rig: Rig, options: dict[str, Any]) -> int:
    from station.session.store import SessionStore

    if options["resume_path"] is None:
        job = _new_capture(rig, options)
        return _follow(job, rig, options)
    with SessionStore.open(options["resume_path"], writable=True, clock=rig.clock) as store:
        from station.capture.capture import Capture

        if store.manifest.status == "complete" and not store.recovery.damaged:
            # Nothing to take; session.json may still be behind the journal.
            return _summarise(store.finish(), store.path, options)
        return _follow(Capture.resume(rig, store, typed_readings=options["readings"]), rig, options)


def _new_capture(rig: Rig, options: dict[str, Any]) -> Capture:
    from station.capture.bracket import parse_shutter
    from station.capture.capture import Capture, CaptureRequest
    from station.errors import UsageError

    room = options["room"] or options["simulate"]
    if not room:
        raise UsageError("which room?", where="capture", advice="daylit capture ROOM")
    stops = tuple(parse_shutter(s) for s in options["stops"].split(",")) if options["stops"] else ()
    request = CaptureRequest(
        room=Path(room).stem if options["room"] is None else room,
        into=options["into"],
        mode=options["bracket"],
        stops_s=stops,
        typed_readings=options["readings"],
        target=parse_target(options["target"]),
    )
    return Capture.new(rig, request)


def parse_target(text: str | None) -> MeterTarget | None:
    """Return the point given as ``LON,LAT`` in degrees (None for None); UsageError for anything else."""
    from station.errors import UsageError
    from station.session.session import MeterTarget

    if text is None:
        return None
    try:
        longitude_deg, latitude_deg = (float(v) for v in text.split(","))
        return MeterTarget(longitude_rad=math.radians(longitude_deg), latitude_rad=math.radians(latitude_deg))
    except ValueError as error:
        raise UsageError(f"{text!r} is not a direction", where="--target", advice="write LON,LAT in degrees") from error


def _follow(job: Capture, rig: Rig, options: dict[str, Any]) -> int:
    """Show the events; the first Ctrl-C ends after the running pair, the second at once."""
    from station.commands.views import JsonView, TerminalView

    on_terminal = _on_terminal(options)
    view = TerminalView(tuple(map(str, rig.cameras)), job.n_stops) if on_terminal else JsonView()
    interrupted = False

    def on_signal(number: int, _frame: object) -> None:
        nonlocal interrupted
        interrupted = True
        job.ask_stop()
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)

    before = {n: signal.signal(n, on_signal) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        with view:
            for event in job.events():
                view.show(event)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    manifest, path = job.store.manifest, job.store.path
    job.store.close()
    return _summarise(manifest, path, options, interrupted=interrupted)


def _on_terminal(options: dict[str, Any]) -> bool:
    return sys.stdout.isatty() and not options["as_json"]


def _summarise(manifest: SessionManifest, path: Path, options: dict[str, Any], *, interrupted: bool = False) -> int:
    """Say what is there and what is missing; returns the exit code."""
    complete = manifest.status == "complete"
    summary = {
        "ok": complete,
        "session": str(path),
        "status": str(manifest.status),
        "frames": len(manifest.frames),
        "skipped": len(manifest.skipped),
        "missing": list(manifest.missing),
        "warnings": [w.message for w in manifest.warnings],
        "drift_frac": manifest.drift_frac,
    }
    if _on_terminal(options):
        click.echo(f"{len(manifest.frames)} frames in {path}")
        if not complete:
            for missing in manifest.missing:
                click.echo(f"missing: {missing}")
            click.echo(f"complete it: {_resume_command(path, options)}")
    else:
        click.echo(json.dumps(summary))
    return 0 if complete else 130 if interrupted else 4


def _resume_command(path: Path, options: dict[str, Any]) -> str:
    """Return the command that completes the session on the same instruments."""
    words = ["daylit", "capture", "--resume", str(path)]
    for option, name in (("--rig", "rig_path"), ("--simulate", "simulate"), ("--only", "only")):
        if options[name]:
            words += [option, str(options[name])]
    if options["simulate"]:
        words += ["--size", options["size"]]
    if options["no_meter"] or options["readings"]:
        words.append("--no-meter")
    return shlex.join(words)


def _changes(options: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of the rig file that the command line takes away."""
    changes: dict[str, Any] = {}
    if options["only"]:
        changes["outdoor" if options["only"] == "indoor" else "indoor"] = None
    if options["no_meter"]:
        changes["meter"] = None
    return changes


def _rig_file(options: dict[str, Any]) -> RigFile:
    from station.capture.rig import find_rig_file
    from station.capture.rig_file import PAPER_RIG, TYPED, load_rig

    simulated = options["simulate"] and options["rig_path"] is None
    file = PAPER_RIG if simulated else load_rig(find_rig_file(options["rig_path"]))
    file = file.model_copy(update=_changes(options))
    if options["readings"] and file.meter:  # where it looks is still the rig's
        file = file.model_copy(update={"meter": file.meter.model_copy(update={"dialect": TYPED})})
    _need_camera(file, options)
    return file


def _need_camera(file: RigFile, options: dict[str, Any]) -> None:
    from station.errors import RigError

    if not file.cameras():
        table = f"[{options['only']}]" if options["only"] else "[indoor] or [outdoor]"
        raise RigError(
            f"has no table {table}: no camera to capture with",
            where=str(options["rig_path"] or "rig.toml"),
            advice="an example: daylit doctor --write-rig FILE",
        )


def _is_replay(options: dict[str, Any]) -> bool:
    return str(options["simulate"] or "").startswith("recorded:")


def _open_rig(options: dict[str, Any]) -> Rig:
    from station.capture.rig import open_named_rig

    file = _rig_file(options)  # refuses a rig without a camera
    changes = _changes(options) | ({"meter": file.meter} if options["readings"] else {})
    path, world = options["rig_path"], options["simulate"]
    if world is None or _is_replay(options):
        return open_named_rig(path, world, record=options["record"], **changes)
    from station.commands.views import Rendering

    with Rendering() as rendering:
        return open_named_rig(
            path, world, size=options["size"], on_progress=rendering, record=options["record"], **changes
        )


def _dry_run(options: dict[str, Any]) -> int:
    from station.capture.bracket import TYPICAL_READING_S, estimate_bracket, parse_shutter, plan_bracket, typical_cost
    from station.session.session import shutter_label

    file = _rig_file(options)
    tables = file.cameras()
    stops = tuple(parse_shutter(s) for s in options["stops"].split(",")) if options["stops"] else file.bracket.stops_s()
    mode: Literal["full", "adaptive"] = options["bracket"] or file.bracket.mode
    plan = plan_bracket(stops, mode, tuple(tables))
    costs = {side: typical_cost(table.kind, keep_raw=table.keep_raw) for side, table in tables.items()}
    estimate = estimate_bracket(
        plan, costs, reading_s=(TYPICAL_READING_S,) * 2 if file.meter and file.meter.is_read else ()
    )
    if options["as_json"]:
        rows = [vars(row) | {"sides": list(row.sides)} for row in estimate.rows]
        totals = {k: v for k, v in vars(estimate).items() if k != "rows"}
        click.echo(json.dumps({"mode": mode, "rows": rows, **totals}))
        return 0
    click.echo(f"{'order':>5} {'exposure':>9} {'cameras':<17} {'pair s':>7} {'MB':>6} {'transfer hidden s':>18}")
    for order, row in enumerate(estimate.rows, 1):
        sides = "+".join(row.sides)
        label = shutter_label(row.asked_s)
        click.echo(
            f"{order:>5} {label:>9} {sides:<17} {row.pair_s:>7.2f} "
            f"{row.bytes_expected / 1e6:>6.1f} {row.hidden_transfer_s:>18.2f}"
        )
    click.echo(
        f"exposures {estimate.exposures_s:.1f} s, readings {estimate.readings_s:.1f} s, transfers left at the end "
        f"{estimate.unhidden_transfer_s:.1f} s: about {estimate.total_s:.0f} s "
        f"and {estimate.bytes_expected / 1e6:.0f} MB"
    )
    click.echo("camera overheads and rates are typical figures, not measured on your instruments")
    if mode == "adaptive":
        click.echo("adaptive: the most it can take; stops that the frames prove useless are left out")
    return 0
