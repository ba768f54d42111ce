"""Finding out what an unknown meter speaks: harmless questions of every dialect, and a transcript to send in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.meter.dialect import Dialect
from drivers.serial_link import ByteLine, PortSettings

ANSWER_LIMIT_S = 3.0
AFTER_S = 0.3
"""How long a further line of one answer is waited for."""
QUIET_S = 0.05
MAX_LINE_BYTES = 256
MAX_ANSWER_BYTES = 1024
HARMLESS = ("RMT,1", "IDDR", "MDS,04", "RMT,0")
"""Enter remote mode, ask for identity, set absolute mode, leave remote mode: nothing is measured, stored or erased."""


@dataclass(frozen=True)
class Exchange:
    """One question of a probe, all that came back, and the seconds to the end of its last whole line."""

    settings: PortSettings
    sent: bytes
    received: bytes
    seconds: float
    note: str = ""


def probe(
    open_line: Callable[[PortSettings], ByteLine], dialects: tuple[Dialect, ...], clock: Clock
) -> Iterator[Exchange]:
    """Ask the harmless questions at the port settings of each dialect; yields every exchange as it happens."""
    for settings in dict.fromkeys(d.port.settings() for d in dialects):
        try:
            line = open_line(settings)
        except DeviceError as error:
            yield Exchange(settings, b"", b"", 0.0, note=str(error))
            continue
        try:
            for question in HARMLESS:
                yield _exchange(line, settings, (question + "\r\n").encode(), clock)
        except DeviceError as error:
            yield Exchange(settings, b"", b"", 0.0, note=str(error))
        finally:
            line.close()


def _exchange(line: ByteLine, settings: PortSettings, question: bytes, clock: Clock) -> Exchange:
    """Ask, and take down all that comes until the line falls silent."""
    unasked = line.drain(QUIET_S, 0.5)
    start_s = clock.monotonic_s()
    line.write(question, 2.0)
    received, limit_s, took_s, note = b"", ANSWER_LIMIT_S, ANSWER_LIMIT_S, f"{unasked} bytes before" if unasked else ""
    while len(received) < MAX_ANSWER_BYTES:
        try:
            received += line.read_line(b"\n", MAX_LINE_BYTES, limit_s) + b"\n"
        except DeviceTimeoutError as error:
            partial = bytes.fromhex(str(error.details.get("partial", "")))
            received += partial
            note += ", no end of line" if partial else ""
            break
        took_s, limit_s = clock.monotonic_s() - start_s, AFTER_S
    return Exchange(settings, question, received, took_s, note.strip(", "))


def transcript_lines(exchanges: Iterator[Exchange], port: str) -> Iterator[str]:
    """Return the transcript, line by line: times, hex and ASCII; it holds no names of people or computers."""
    yield f"daylit meter transcript, port {port}"
    settings: PortSettings | None = None
    for exchange in exchanges:
        if exchange.settings != settings:
            settings = exchange.settings
            yield f"# {settings.baud} baud, {settings.data_bits} {settings.parity} {settings.stop_bits}"
        yield f"> {exchange.sent.hex(' ')}  {_ascii(exchange.sent)}"
        answer = f"< {exchange.received.hex(' ')}  {_ascii(exchange.received)}" if exchange.received else "< (nothing)"
        yield f"{answer}  after {exchange.seconds:.3f} s {exchange.note}".rstrip()


def _ascii(data: bytes) -> str:
    return "".join(chr(b) if 32 <= b < 127 else "." for b in data)
