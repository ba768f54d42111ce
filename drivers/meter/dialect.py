"""Dialects: what a luminance meter says on its serial line, as data. Shipped ones in ``drivers/dialects``.

A dialect file (TOML) names the port settings, what to send and what must come back. Replies are full-match regular
expressions over the whole line; named groups carry meaning: ``value`` (the number), ``unit``, ``mode``,
``calibration``, ``wait_s``. What a group's text means is a table: only what the table calls "ok" lets a number pass.
"""

import re
import tomllib
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from drivers.errors import DaylitError
from drivers.meter.interface import ReadingStatus
from drivers.serial_link import PortSettings

SHIPPED = ("ls100", "cs100a", "ls160", "cs2000", "ca410")
MAX_DIALECT_BYTES = 64 * 1024
JUDGED = ("unit", "mode", "calibration", "state")
"""Groups that can turn a number into no luminance: whoever reads them must say what they mean."""
GROUPS = {"value", "unit", "mode", "calibration", "state", "wait_s", "model", "serial", "tail"}

Meaning = Literal["ok", "over_range", "under_range", "wrong_unit", "wrong_mode", "battery_low", "error_code", "garbled"]


class DialectError(DaylitError, code="DIA-001", exit_code=2):
    """A dialect file that cannot be used; names the file and every wrong key."""


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Step(_Table):
    """One question and the form of its answer."""

    send: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[ -~]+$")]
    expect: str
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 5.0
    done: str = ""
    """A further line that comes by itself when the work is done (regular expression); it may be missing."""

    @field_validator("expect", "done")
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
    port: PortSettings
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
    busy: tuple[str, ...] = ()
    """Error lines that say "still measuring": the question is put again after a pause, for so long at most."""
    busy_pause_s: Annotated[float, Field(ge=0.05, le=5)] = 0.3
    busy_limit_s: Annotated[float, Field(gt=0, le=120)] = 30.0
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
        named = (*self.ask_again, *self.busy)
        if unknown := [text for text in named if not any(p.fullmatch(text) for p, _ in self.error_patterns)]:
            raise ValueError(f"ask_again and busy name {unknown}, which errors does not know")
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
        return Dialect.model_validate(tomllib.loads(path.read_text("utf-8-sig")))
    except FileNotFoundError as error:
        advice = f"shipped: {', '.join(SHIPPED)}"
        raise DialectError("no dialect of that name and no such file", where=name_or_path, advice=advice) from error
    except ValidationError as error:
        keys = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'file'}: {e['msg']}" for e in error.errors())
        raise DialectError(keys, where=name_or_path, advice="its form: docs/reference/meter-dialects.md") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise DialectError(f"cannot be read: {error}", where=name_or_path) from error
