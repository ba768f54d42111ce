"""``daylit capture``: a room, a queue of rooms, or a day of brackets; each from preflight to a verified session."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import answer, parameters

if TYPE_CHECKING:
    from station.capture.bracket import BracketPlan, Estimate
    from station.capture.capture import Capture, CaptureRequest
    from station.capture.rig import Rig
    from station.capture.rig_file import RigFile
    from station.session.session import MeterTarget, SessionManifest


@click.command(params=parameters(__package__, "capture"))
def capture(**options: Any) -> int:
    """Capture ROOM: a meter reading, synchronised brackets from both cameras, a second reading.

    Several ROOMS make a queue: move the rig and continue. Pause: p and Enter, or SIGUSR1; continue: Enter, or SIGUSR2.

    \b
    Examples:
      daylit capture coda-320 --rig rig.toml
      daylit capture coda-320 --every 60m --until 18:00 --notify https://example.org/hook
      daylit capture hall kitchen attic --bracket adaptive --no-meter
      daylit capture --resume sessions/2023-05-19T1554Z_coda-320
      daylit capture test --simulate bedroom-7 --size quarter
    """
    from drivers.clock import SystemClock
    from station.capture.capture import Capture
    from station.capture.intake import check_typed
    from station.day.day import parse_every, parse_until

    _refuse_what_would_do_nothing(options)
    check_typed(options["readings"])
    if options["dry_run"]:
        return dry_run(_rig_file(options), options)
    if options["resume_path"]:
        return _resume(options)
    rooms = _rooms(options)  # before a room's light is computed: a minute
    request = _request(rooms[0], options)
    if options["every"]:
        parse_every(options["every"])
        parse_until(options["until"], SystemClock().utc_now())
    file = _rig_file(options)
    if not _is_replay(options):
        _plan(file, options)
    with closing(_open(file, options["simulate"], options)) as rig:
        if options["every"] or len(rooms) > 1:
            return _run_day(rig, rooms, request, options)
        return _follow(Capture.new(rig, request), rig, options)


def _refuse_what_would_do_nothing(options: dict[str, Any]) -> None:
    from station.errors import UsageError

    if _is_replay(options) and (given := [name for name in ("rig_path", "record") if options[name]]):
        names = ", ".join("--rig" if name == "rig_path" else f"--{name}" for name in given)
        raise UsageError(f"a transcript holds its own rig: {names}", where="--simulate", advice="leave it out")
    for name, usual in (("size", "full"), ("rate", 1.0)):
        simulated = options["simulate"] and not _is_replay(options)
        if options[name] != usual and not (simulated or (name == "rate" and options["resume_path"])):
            advice = "set size_px in the rig" if name == "size" else "leave it out"
            raise UsageError("only simulated cameras can change it", where=f"--{name}", advice=advice)
    if bool(options["every"]) != bool(options["until"]):
        raise UsageError("--every and --until belong together", where="capture", advice="--every 60m --until 18:00")
    if options["resume_path"] is None:
        if options["rooms"] and options["rooms_path"]:
            raise UsageError("rooms are given twice", where="--rooms", advice="give ROOM or --rooms, not both")
        return
    taken = ("rooms", "rooms_path", "into", "every", "stops", "bracket", "noise", "target", "address", "dry_run")
    given = [name for name in taken if options[name]]
    if given:
        names_given = ", ".join("ROOM" if n in ("rooms", "rooms_path") else f"--{n.replace('_', '-')}" for n in given)
        raise UsageError(f"--resume takes these from the session: {names_given}", where="capture", advice="omit them")


def _rooms(options: dict[str, Any]) -> tuple[str, ...]:
    from station.day.day import read_rooms
    from station.errors import UsageError

    rooms: tuple[str, ...] = options["rooms"] or (read_rooms(options["rooms_path"]) if options["rooms_path"] else ())
    if not rooms and options["simulate"]:
        rooms = (Path(options["simulate"]).stem,)
    if not (rooms and all(map(str.strip, rooms))):
        raise UsageError("which room?", where="capture", advice="daylit capture ROOM")
    if options["every"] and len(rooms) > 1:
        raise UsageError("--every works with one room", where="capture", advice="give one room, or no --every")
    if options["readings"] and (options["every"] or len(rooms) > 1):
        advice = "--no-meter, or the rig's meter"
        raise UsageError("a typed reading belongs to one bracket", where="--reading", advice=advice)
    return rooms


def _request(room: str, options: dict[str, Any]) -> CaptureRequest:
    from station.capture.bracket import parse_shutters
    from station.capture.capture import CaptureRequest

    return CaptureRequest(
        room=room,
        into=options["into"] or Path("sessions"),
        mode=options["bracket"],
        stops_s=parse_shutters(options["stops"]),
        typed_readings=options["readings"],
        target=parse_target(options["target"]),
        noise_frac=options["noise"] and options["noise"] / 100,
        address=options["address"],
    )


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
    from station.commands.following import follow, on_terminal, summarise
    from station.commands.views import JsonView, TerminalView

    view = TerminalView(tuple(map(str, rig.cameras)), job.n_stops) if on_terminal(options) else JsonView()
    interrupted = follow(job, view, notify=options["notify"])
    manifest, path = job.store.manifest, job.store.path
    job.store.close()
    return summarise(manifest, path, options, interrupted=interrupted)


def _run_day(rig: Rig, rooms: tuple[str, ...], request: CaptureRequest, options: dict[str, Any]) -> int:
    from station.commands.following import follow, on_terminal, summarise_day
    from station.commands.views import JsonView, TerminalView
    from station.day.day import Day, DayPlan, parse_every, parse_until

    every, until = options["every"], options["until"]
    plan = DayPlan(rooms, parse_every(every), parse_until(until, rig.clock.utc_now())) if every else DayPlan(rooms)
    day = Day(rig, plan, request)
    view = TerminalView(tuple(map(str, rig.cameras)), day.n_stops) if on_terminal(options) else JsonView()
    interrupted = follow(day, view, notify=options["notify"])
    return summarise_day(day, options, interrupted=interrupted)


def _changes(options: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of the rig file that the command line takes away."""
    changes: dict[str, Any] = {
        side: None for side in ("indoor", "outdoor") if options["only"] and side not in options["only"]
    }
    if options["no_meter"]:
        changes["meter"] = None
    return changes


def _rig_file(options: dict[str, Any]) -> RigFile:
    from station.capture.rig import find_rig_file
    from station.capture.rig_file import PAPER_RIG, load_rig
    from station.errors import RigError

    simulated = options["simulate"] and options["rig_path"] is None
    file = PAPER_RIG if simulated else load_rig(find_rig_file(options["rig_path"]))
    file = _typed(file.model_copy(update=_changes(options)), options)
    if not file.cameras():
        table = " or ".join(f"[{side}]" for side in options["only"] or ("indoor", "outdoor"))
        text, where = f"has no {table} table: no camera to capture with", str(options["rig_path"] or "rig.toml")
        raise RigError(text, where=where, advice="write an example: daylit doctor --write-rig FILE")
    return file


def _typed(file: RigFile, options: dict[str, Any]) -> RigFile:
    """Return the rig with a meter that is typed in, where a reading is; where it looks is still the rig's."""
    from station.capture.rig_file import TYPED

    if not (options["readings"] and file.meter):
        return file
    return file.model_copy(update={"meter": file.meter.model_copy(update={"dialect": TYPED})})


def _is_replay(options: dict[str, Any]) -> bool:
    return str(options["simulate"] or "").startswith("recorded:")


def _open(file: RigFile, world: str | None, options: dict[str, Any]) -> Rig:
    from station.capture.rig import open_named_rig

    if _is_replay(options):
        changes = _changes(options)
        if options["readings"]:
            changes["meter"] = file.meter
        return open_named_rig(None, world, **changes)
    if world is None:
        return open_named_rig(file, None, record=options["record"])
    from station.commands.views import Rendering

    size, rate, record, fresh = options["size"], options["rate"], options["record"], options["noise"] is not None
    with Rendering() as rendering:
        return open_named_rig(file, world, size=size, rate=rate, on_progress=rendering, record=record, fresh=fresh)


def _resume(options: dict[str, Any]) -> int:
    """Complete a session with the instruments that it still needs, and no others."""
    from station.capture.capture import Capture
    from station.commands.following import summarise
    from station.errors import UsageError
    from station.session.store import SessionStore

    path = options["resume_path"]
    with SessionStore.open(path, writable=False) as store:
        manifest = store.manifest
    if len(options["readings"]) > (wanted := len(manifest.missing_readings())):
        advice = "leave it out; a scale without a reading: `daylit process --k1`"
        raise UsageError(f"readings missing here: {wanted}", where="--reading", advice=advice)
    file, world = _needed(manifest, options)
    if not (file.cameras() or manifest.missing):
        with SessionStore.open(path, writable=True) as store:  # session.json may still be behind the journal
            return summarise(store.finish(), store.path, options)
    if world and not options["rig_path"]:
        options = {**options, "size": "full"}  # the record has the pictures' size
    with closing(_open(file, world, options)) as rig, SessionStore.open(path, writable=True, clock=rig.clock) as store:
        return _follow(Capture.resume(rig, store, typed_readings=options["readings"]), rig, options)


def _needed(manifest: SessionManifest, options: dict[str, Any]) -> tuple[RigFile, str | None]:
    """Return the rig that a session was begun with, by its own record or --rig, without what it needs no more."""
    from station.capture.rig_file import load_rig
    from station.errors import SessionError
    from station.session.verify import damaged_frames

    path = options["resume_path"]
    world = options["simulate"] or manifest.rig.get("simulate")
    if manifest.simulated and not world:
        raise SessionError("its instruments were simulated", where=str(path), advice="give --simulate WORLD as before")
    recorded = _recorded_rig(manifest, str(path))
    file = load_rig(options["rig_path"]) if options["rig_path"] else recorded
    changes = _changes(options)
    damaged = {frame.side for frame in damaged_frames(path, manifest)}
    for side in file.cameras():
        if not manifest.missing_stops(side) and side not in damaged:
            changes[str(side)] = None
    if recorded.meter is None:
        changes["meter"] = None
    return _typed(file.model_copy(update=changes), options), world


def _recorded_rig(manifest: SessionManifest, where: str) -> RigFile:
    from pydantic import ValidationError

    from station.capture.rig_file import RigFile
    from station.errors import SessionError

    try:
        return RigFile.model_validate({k: v for k, v in manifest.rig.items() if k != "simulate"})
    except ValidationError as error:
        raise SessionError("holds no rig to resume with", where=where, advice="give the rig file with --rig") from error


def dry_run(file: RigFile, options: dict[str, Any]) -> int:
    """Print the table; `UsageError` for a stop that a camera of the rig does not have."""
    from station.capture.bracket import TYPICAL_READING_S, estimate_bracket, light_drift, typical_cost
    from station.capture.reference import MOST_FURTHER, MOST_FURTHER_S

    tables = file.cameras()
    plan = _plan(file, options)
    costs = {side: typical_cost(table.kind, keep_raw=table.keep_raw) for side, table in tables.items()}
    reading_s = (TYPICAL_READING_S,) * 2 if file.meter and file.meter.is_read else ()
    estimate = estimate_bracket(plan, costs, reading_s=reading_s)
    drift = light_drift(estimate.total_s, file.site.latitude_deg)
    rows = [vars(row) | {"sides": list(row.sides)} for row in estimate.rows]
    totals = {k: v for k, v in vars(estimate).items() if k != "rows"}
    lines = [
        *_table(estimate),
        f"during the bracket the sun moves by up to {drift.sun_deg:.2f} degrees; a clear sky with the sun at "
        f"{drift.sun_altitude_deg:.0f} degrees changes by up to {100 * drift.sky_frac_per_min:.1f} % a minute, "
        f"{100 * drift.sky_frac:.1f} % in all (daylit plan: for your place and day)",
        "camera overheads and transfer rates are typical, not measured on your instruments",
    ]
    if plan.noise_frac is not None:
        lines.append(f"and up to {MOST_FURTHER} further exposures, {MOST_FURTHER_S:g} s in all, for the noise asked")
    if plan.mode == "adaptive":
        lines.append("adaptive: this is the maximum; stops that the frames show to be unnecessary are skipped")
    return answer({"mode": plan.mode, "rows": rows, **totals, **drift._asdict()}, lines, as_json=options["as_json"])


def _plan(file: RigFile, options: dict[str, Any]) -> BracketPlan:
    """Return the bracket asked for; `UsageError` for stops that are none, or that a camera of the rig lacks."""
    from station.capture.bracket import parse_shutters, plan_of, unavailable_stops
    from station.capture.rig import known_times_s
    from station.errors import UsageError

    plan = plan_of(file, parse_shutters(options["stops"]), options["bracket"], options["noise"])
    lacking = [
        f"{side} ({table.kind}): {', '.join(names)}"
        for side, table in file.cameras().items()
        if (names := unavailable_stops(plan.stops_s, known_times_s(table.kind)))
    ]
    if lacking:
        advice = "change --stops, or [bracket] stops of the rig"
        raise UsageError(f"stops that a camera does not have: {'; '.join(lacking)}", where="bracket", advice=advice)
    return plan


def _table(estimate: Estimate) -> Iterator[str]:
    from station.session.session import shutter_label

    yield f"{'order':>5} {'exposure':>9} {'cameras':<17} {'pair s':>7} {'MB':>6} {'transfer hidden s':>18}"
    for order, row in enumerate(estimate.rows, 1):
        yield (
            f"{order:>5} {shutter_label(row.asked_s):>9} {'+'.join(row.sides):<17} {row.pair_s:>7.2f} "
            f"{row.bytes_expected / 1e6:>6.1f} {row.hidden_transfer_s:>18.2f}"
        )
    yield (
        f"exposures {estimate.exposures_s:.1f} s, readings {estimate.readings_s:.1f} s, transfers left at the end "
        f"{estimate.unhidden_transfer_s:.1f} s: about {estimate.total_s:.0f} s "
        f"and {estimate.bytes_expected / 1e6:.0f} MB"
    )
