"""``daylit meter``: one reading, or a transcript of an unknown meter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.commands.views import answer, parameters, printable

if TYPE_CHECKING:
    from drivers.clock import Clock
    from drivers.serial_link import ByteLine, PortSettings
    from drivers.transcript import Transcript
    from station.capture.conform import Outcome
    from station.capture.preflight import Check
    from station.capture.rig import Rig

# ``daylit doctor``: is everything ready for a day on site?

_MARKS = {"ok": click.style("ok  ", "green"), "warn": click.style("warn", "yellow"), "fail": click.style("FAIL", "red")}


@click.command(params=parameters(__package__, "doctor"))
def doctor(rig_path: Path | None, simulate: str | None, into: Path, write_rig: Path | None, *, as_json: bool) -> int:
    """Check the computer and its connections and, with --rig, the instruments themselves.

    \b
    Examples:
      daylit doctor
      daylit doctor --write-rig rig.toml
      daylit doctor --rig rig.toml
    Exit code: 0 ready to capture · 1 something prevents a capture.
    """
    if write_rig is not None:
        from station.capture.rig_file import example_text
        from station.session import durable

        with durable.disk_errors(write_rig, "writing"):
            try:
                with durable.new_file(write_rig) as file:
                    file.write(example_text())
            except OSError:
                write_rig.unlink()
                raise
        line = f"wrote {write_rig}: edit it, then run daylit doctor --rig {write_rig}"
        return answer({"ok": True, "file": str(write_rig)}, [line], as_json=as_json)
    from station.capture.preflight import check_computer, list_instruments

    plugged = list_instruments() if simulate is None else ()
    checks = [*check_computer(into), *plugged, *_check_rig(rig_path, simulate, into)]
    failed = any(c.level == "fail" for c in checks)
    for check in () if as_json else checks:
        click.echo("\n".join(_lines(check)))
    facts = {"ok": not failed, "checks": [c.to_dict() for c in checks]}
    return answer(facts, (), as_json=as_json, exit_code=int(failed))


def _check_rig(rig_path: Path | None, simulate: str | None, into: Path) -> list[Check]:
    if rig_path is None and simulate is None:
        return []
    from station.capture.preflight import check_rig
    from station.capture.rig import open_named_rig

    with closing(open_named_rig(rig_path, simulate, size="small")) as rig:
        return list(check_rig(rig, into, bytes_needed=0).checks)


def _lines(check: Check) -> Iterator[str]:
    yield f"{_MARKS[check.level]}  {check.name}: {printable(check.text)}"
    if check.advice and check.level != "ok":
        yield f"      what to do: {printable(check.advice)}"


# ``daylit conform``: does an instrument, real or simulated, do what daylit relies on?


@click.command(params=parameters(__package__, "conform"))
def conform(
    given: Path | None,
    simulate: str | None,
    only: tuple[str, ...],
    record: Path | None,
    *,
    may_delete: bool,
    as_json: bool,
) -> int:
    """Run the conformance tests on the rig's instruments; takes about eight pictures per camera.

    \b
    Examples:
      daylit conform --simulate room
      daylit conform --rig rig.toml --only meter
      daylit conform --rig rig.toml --record conform.jsonl.gz
      daylit conform --simulate recorded:conform.jsonl.gz
    Exit code: 0 all passed · 1 something failed.
    """
    from station.capture.rig import open_named_rig
    from station.errors import UsageError

    outcomes: list[Outcome] = []
    with closing(open_named_rig(given, simulate, size="small", record=record)) as rig:
        for outcome in _run(rig, only, may_delete=may_delete or rig.simulated):
            outcomes.append(outcome)
            if not as_json:
                said = printable(f"{outcome.instrument} {outcome.name.replace('_', ' ')}: {outcome.detail}")
                click.echo(f"{_mark(outcome)}  {said}")
    if not outcomes:
        raise UsageError(
            f"the rig has no {' or '.join(only) or 'instrument'}", where="conform", advice="choose another instrument"
        )
    passed = all(o.passed for o in outcomes)
    facts = {"ok": passed, "simulated": rig.simulated, "outcomes": [asdict(o) for o in outcomes]}
    return answer(facts, (), as_json=as_json, exit_code=int(not passed))


def _mark(outcome: Outcome) -> str:
    if not outcome.passed:
        return _MARKS["fail"]
    return click.style("skip", fg="yellow") if outcome.detail.startswith("skipped") else _MARKS["ok"]


def _while_there(outcomes: Iterator[Outcome]) -> Iterator[Outcome]:
    """End after the first outcome when the instrument is not there at all: the others would say nothing new."""
    for outcome in outcomes:
        yield outcome
        if outcome.detail.startswith("DeviceNotFoundError"):
            return


def _run(rig: Rig, only: tuple[str, ...], *, may_delete: bool) -> Iterator[Outcome]:
    from station.capture.conform import CameraBench, run_camera, run_meter

    for side, camera in rig.cameras.items():
        if not only or side.value in only:
            settings = rig.file.cameras()[side].settings()
            yield from _while_there(run_camera(CameraBench(camera, settings, rig.clock, may_delete=may_delete)))
    if rig.meter is not None and (not only or "meter" in only):
        yield from _while_there(run_meter(rig.meter, rig.clock))


@click.group()
def meter() -> None:
    """Read a luminance meter, or identify its protocol."""


@meter.command(params=parameters(__package__, "meter read"))
def read(port: str, dialect: str, samples: int, timeout_s: float, *, as_json: bool) -> int:
    """Take one reading: the mean of several samples, with their spread.

    \b
    Example: daylit meter read --port /dev/ttyUSB0 --dialect ls100
    Exit code: 0 a reading · 3 a status without a number, or no meter.
    """
    from drivers.clock import SystemClock
    from station.capture.intake import record_reading
    from station.capture.rig import meter_on_port

    with closing(meter_on_port(dialect, port, SystemClock())) as instrument:
        identity = instrument.connect()
        record = record_reading("extra", instrument.measure(n_samples=samples, timeout_s=timeout_s))
    ok = record.luminance_cd_m2 is not None
    line = f"{record.status}: {record.detail}"
    if ok:
        assumed = "" if record.dialect_verified else f"  (dialect {record.dialect} is ASSUMED)"
        line = f"{record.luminance_cd_m2:g} cd/m2, spread {record.spread_frac:.2%} of {record.n_samples}{assumed}"
    facts = {"ok": ok, "port": identity.port, **record.model_dump(mode="json")}
    return answer(facts, [line], as_json=as_json, exit_code=0 if ok else 3)


@meter.command(params=parameters(__package__, "meter probe"))
def probe(transcript: Path, port: str, *, as_json: bool) -> int:
    """Try every known protocol on a meter, record the exchange in TRANSCRIPT and report which dialect fits.

    Takes one to four minutes. It triggers measurements but changes no lasting setting of the meter.

    \b
    Example: daylit meter probe transcript.jsonl --port /dev/ttyACM0
    Exit code: 0 the meter answered · 3 no answer.
    """
    from drivers.clock import SystemClock
    from drivers.meter.dialect import SHIPPED, load_dialect
    from drivers.meter.probe import Exchange, try_dialects
    from drivers.meter.probe import probe as ask
    from drivers.serial_link import find_port
    from drivers.transcript import Transcript
    from station.session import durable

    clock = SystemClock()
    dialects = tuple(load_dialect(name) for name in SHIPPED)
    where = find_port({ids for d in dialects for ids in d.usb_ids}) if port == "auto" else port
    exchanges: list[Exchange] = []
    with durable.disk_errors(transcript, "recording"), durable.new_file(transcript) as file:
        open_line = _recorded_port(where, Transcript(file, clock), clock)
        for exchange in ask(open_line, clock):
            exchanges.append(exchange)
            if not as_json and (exchange.received or exchange.note):
                click.echo(str(exchange))
        trials = list(try_dialects(open_line, dialects, exchanges, clock))
    answers = sum(bool(e.received) for e in exchanges)
    fits = [{"dialect": t.dialect.name, "luminance_cd_m2": t.luminance_cd_m2, "detail": t.detail} for t in trials]
    lines = []
    for trial in trials:
        number = f"{trial.luminance_cd_m2:g} cd/m2" if trial.luminance_cd_m2 is not None else trial.detail
        lines.append(f'match: [meter] dialect = "{trial.dialect.name}" gives {number}; does the display agree?')
    lines.append(f"{answers} answers, {len(trials)} dialects match; please send us {transcript}")
    facts = {"ok": answers > 0, "answers": answers, "fits": fits, "transcript": str(transcript)}
    return answer(facts, lines, as_json=as_json, exit_code=0 if answers else 3)


def _recorded_port(port: str, record: Transcript, clock: Clock) -> Callable[[PortSettings], ByteLine]:
    """Return what opens the port so that all that passes is written down, its USB descriptors first."""
    from drivers.serial_link import SerialLink, list_ports
    from drivers.transcript import RecordedLine

    for info in list_ports():
        if port in (info.device, info.stable_name):
            record.write("meter", "note", info={k: v for k, v in vars(info).items() if v not in ("", None)})

    def open_line(settings: PortSettings) -> ByteLine:
        words = f"{settings.baud} {settings.data_bits}{settings.parity[0].upper()}{settings.stop_bits}"
        return RecordedLine(SerialLink.open(port, settings, clock=clock), record, "meter", words)

    return open_line
