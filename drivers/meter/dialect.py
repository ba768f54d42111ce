"""Dialects: what a luminance meter says on its serial line, as data. Shipped ones in ``drivers/dialects``.

A dialect file (TOML) names the port settings, what to send and what must come back. Replies are full-match regular
expressions over the whole line; named groups carry meaning: ``value`` (the number), ``unit``, ``mode``,
``calibration``, ``wait_s``. What a group's text means is a table: only what the table calls "ok" lets a number pass.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from drivers.clock import Clock
from drivers.errors import DaylitError, DeviceError, DeviceTimeoutError
from drivers.meter.interface import ReadingStatus
from drivers.serial_link import ByteLine, PortSettings

SHIPPED = ("ls100", "cs100a", "ls160")
MAX_DIALECT_BYTES = 64 * 1024
JUDGED = ("unit", "mode", "calibration", "state")
"""Groups that can turn a number into no luminance: whoever reads them must say what they mean."""
GROUPS = {"value", "unit", "mode", "calibration", "state", "wait_s", "model", "serial", "tail"}

Meaning = Literal["ok", "over_range", "under_range", "wrong_unit", "wrong_mode", "battery_low", "error_code", "garbled"]


class DialectError(DaylitError):
    """A dialect file that cannot be used; names the file and every wrong key."""

    code = "DIA-001"
    exit_code = 2


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Port(_Table):
    """``[port]``: line settings."""

    baud: Annotated[int, Field(ge=300, le=3_000_000)]
    data_bits: Literal[7, 8] = 8
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Literal[1, 2] = 1
    rts_handshake: bool = False

    def settings(self) -> PortSettings:
        """Return what the link is opened with."""
        return PortSettings(**self.model_dump())


class Step(_Table):
    """One question and the form of its answer."""

    send: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[ -~]+$")]
    expect: str
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 5.0

    @field_validator("expect")
    @classmethod
    def _compiles(cls, expect: str) -> str:
        try:
            groups = set(re.compile(expect).groupindex)
        except re.error as error:
            raise ValueError(f"not a regular expression: {error}") from error
        if unknown := groups - GROUPS:
            raise ValueError(f"unknown groups {sorted(unknown)}; known: {sorted(GROUPS)}")
        return expect

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """The compiled form of ``expect``."""
        return re.compile(self.expect, re.ASCII)


class Dialect(_Table):
    """A whole dialect file."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9_-]{1,40}$")]
    title: Annotated[str, Field(max_length=100)]
    verified: bool
    source: Annotated[str, Field(max_length=500)]
    usb_ids: tuple[tuple[int, int], ...] = ()
    port: Port
    line_end: Literal["\r\n", "\n", "\r"] = "\r\n"
    max_line_bytes: Annotated[int, Field(ge=8, le=4096)] = 64
    pause_s: Annotated[float, Field(ge=0, le=5)] = 0.1
    """Before each question."""
    connect: Annotated[tuple[Step, ...], Field(min_length=1)]
    """The greeting. The first step is harmless and its answer looks like no reading: it also brings a dialogue in step
    again. A group ``tail`` marks text that a late reading could have too."""
    measure: Annotated[tuple[Step, ...], Field(min_length=1)]
    confirm: Step | None = None
    """Asks for the held value once more; the digits must be the same as in the last step of ``measure``."""
    goodbye: tuple[Step, ...] = ()
    meanings: dict[str, dict[str, Meaning]] = {}
    """Group name -> its text -> what that means; text that is not listed is garbled."""
    errors: dict[str, Meaning] = {}
    """Whole error lines (regular expressions) -> what they mean."""
    ask_again: tuple[str, ...] = ()
    """Error lines that say that the question did not arrive well: it is put again."""
    range_cd_m2: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]]

    @field_validator("measure")
    @classmethod
    def _last_step_gives_the_value(cls, measure: tuple[Step, ...]) -> tuple[Step, ...]:
        if "value" not in measure[-1].pattern.groupindex:
            raise ValueError("the last step of measure must have a group 'value'")
        return measure

    @field_validator("errors")
    @classmethod
    def _errors_compile(cls, errors: dict[str, Meaning]) -> dict[str, Meaning]:
        for pattern in errors:
            try:
                re.compile(pattern)
            except re.error as error:
                raise ValueError(f"{pattern!r} is not a regular expression: {error}") from error
        return errors

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        steps = (*self.measure, *((self.confirm,) if self.confirm else ()))
        silent = {g for step in steps for g in step.pattern.groupindex if g in JUDGED} - set(self.meanings)
        if silent:
            raise ValueError(f"meanings of {sorted(silent)} are missing")
        if self.confirm and "value" not in self.confirm.pattern.groupindex:
            raise ValueError("confirm must have a group 'value'")
        if unknown := [text for text in self.ask_again if not any(p.fullmatch(text) for p, _ in self.error_patterns)]:
            raise ValueError(f"ask_again names {unknown}, which errors does not know")
        if self.range_cd_m2[0] >= self.range_cd_m2[1]:
            raise ValueError("range_cd_m2 is upside down")
        return self

    @cached_property
    def error_patterns(self) -> tuple[tuple[re.Pattern[str], ReadingStatus], ...]:
        """The error lines, compiled."""
        return tuple((re.compile(p, re.ASCII), ReadingStatus(m)) for p, m in self.errors.items())


def load_dialect(name_or_path: str) -> Dialect:
    """Return a shipped dialect by name, or a user's own by path.

    Raises `DialectError`: not there, too large, not TOML, or not of the form; names the file and every wrong key.
    """
    if name_or_path in SHIPPED:
        text = resources.files("drivers.meter").joinpath("dialects", f"{name_or_path}.toml").read_text("utf-8")
        return Dialect.model_validate(tomllib.loads(text))
    path = Path(name_or_path)
    try:
        if path.stat().st_size > MAX_DIALECT_BYTES:
            raise DialectError("too large to be a dialect", where=name_or_path)
        return Dialect.model_validate(tomllib.loads(path.read_text("utf-8")))
    except FileNotFoundError as error:
        raise DialectError(
            "no dialect of that name and no such file", where=name_or_path, advice=f"shipped: {', '.join(SHIPPED)}"
        ) from error
    except ValidationError as error:
        keys = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'file'}: {e['msg']}" for e in error.errors())
        raise DialectError(
            keys, where=name_or_path, advice="docs/reference/meter-dialects.md describes the form"
        ) from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise DialectError(f"cannot be read: {error}", where=name_or_path) from error


# Bounds of a probe: chosen, far above what a meter of this family needs.
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
