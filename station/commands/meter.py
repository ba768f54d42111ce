"""``daylit meter``: one reading, or a transcript of an unknown meter."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import click


@click.group()
def meter() -> None:
    """Read a luminance meter, or find out what it speaks."""


@meter.command()
@click.option("--port", default="auto", show_default=True, help="Serial port, e.g. /dev/ttyUSB0 or COM3.")
@click.option("--dialect", default="ls160", show_default=True, help="ls160 (assumed), ls100, cs100a, or a file.")
@click.option("--samples", type=click.IntRange(1, 50), default=3, show_default=True)
@click.option(
    "--timeout", "timeout_s", type=click.FloatRange(0.1, 120), default=20.0, show_default=True, help="Seconds."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def read(port: str, dialect: str, samples: int, timeout_s: float, *, as_json: bool) -> int:
    """Take one reading (mean of some samples, with their spread).

    \b
    Example: daylit meter read --port /dev/ttyUSB0 --dialect ls100
    Exit code: 0 a number · 3 a status without a number, or no meter.
    """
    from drivers.clock import SystemClock
    from station.readings import record_reading
    from station.rig import meter_on_port

    instrument = meter_on_port(dialect, port, SystemClock())
    try:
        identity = instrument.connect()
        record = record_reading("extra", instrument.measure(n_samples=samples, timeout_s=timeout_s))
    finally:
        instrument.close()
    ok = record.luminance_cd_m2 is not None
    if as_json:
        click.echo(json.dumps({"ok": ok, "port": identity.port, **record.model_dump(mode="json")}))
    elif ok:
        assumed = "" if record.dialect_verified else f"  (dialect {record.dialect} is ASSUMED)"
        click.echo(f"{record.luminance_cd_m2:g} cd/m2, spread {record.spread_frac:.2%} of {record.n_samples}{assumed}")
    else:
        click.echo(f"{record.status}: {record.detail}")
    return 0 if ok else 3


@meter.command()
@click.argument("transcript", type=click.Path(path_type=Path))
@click.option("--port", required=True, help="Serial port, e.g. /dev/ttyACM0 or COM3.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of lines on the screen.")
def probe(transcript: Path, port: str, *, as_json: bool) -> int:
    """Ask a meter harmless questions in every dialect and write TRANSCRIPT, to be sent in.

    \b
    Example: daylit meter probe transcript.txt --port /dev/ttyACM0
    Exit code: 0 something answered · 3 nothing did.
    """
    from drivers.clock import SystemClock
    from drivers.meter_dialect import SHIPPED, load_dialect
    from drivers.meter_probe import Exchange, transcript_lines
    from drivers.meter_probe import probe as ask
    from drivers.serial_link import PortSettings, SerialLink
    from station.errors import UsageError

    clock = SystemClock()
    dialects = tuple(load_dialect(name) for name in SHIPPED)
    answered: list[Exchange] = []

    def open_line(settings: PortSettings) -> SerialLink:
        return SerialLink.open(port, settings, clock=clock)

    def watched() -> Iterator[Exchange]:
        for exchange in ask(open_line, dialects, clock):
            if exchange.received:
                answered.append(exchange)
            yield exchange

    if transcript.exists():
        raise UsageError("is already there", where=str(transcript), advice="choose another name")
    with transcript.open("x", encoding="utf-8") as file:
        for line in transcript_lines(watched(), port):
            file.write(line + "\n")
            if not as_json:
                click.echo(line)
    if as_json:
        click.echo(json.dumps({"ok": bool(answered), "answers": len(answered), "transcript": str(transcript)}))
    else:
        click.echo(f"{len(answered)} answers; please send {transcript} in")
    return 0 if answered else 3
