"""What commands share: the table of their parameters, and what a user sees of them at work."""

from __future__ import annotations

import json
import math
import os
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import date
from functools import cache
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

from station.capture.events import CaptureEvent, EventKind


class _Place(click.Path):
    """A path, but of a pipe or a device: what is read may never come or end, what is written would take its place."""

    suffixes: Sequence[str] = ()  # what a name must end in, where there are any

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        with suppress(OSError):
            if (path := Path(value)).exists() and not (path.is_file() or path.is_dir()):
                self.fail(f"{str(path)!r} is a {'pipe' if path.is_fifo() else 'device'}: give a file", param, ctx)
        if self.suffixes and Path(value).suffix.lower() not in self.suffixes:
            self.fail(f"{os.fspath(value)!r}: the name must end in {' or '.join(self.suffixes)}", param, ctx)
        return super().convert(value, param, ctx)


FILE = _Place(path_type=Path)  # a file that is read or written, or a session
_KINDS = {
    "file": FILE,
    "folder": _Place(path_type=Path, file_okay=False),
    "no folder": _Place(path_type=Path, dir_okay=False),
    "there": _Place(path_type=Path, exists=True),
    "folder there": _Place(path_type=Path, exists=True, file_okay=False),
    "float": click.FLOAT,
    "day": lambda text: date.fromisoformat(text).isoformat(),
}
_OF_A_SESSION = ("indoor", "outdoor", "given", "rejected", "choices", "stages")
_RENDERED = {"light": "the room's light", "indoor": "the room's pictures", "outdoor": "the sky's pictures"}
_STYLE = {
    EventKind.WARNING: "yellow",
    EventKind.REJECTED: "yellow",
    EventKind.RECOVERING: "yellow",
    EventKind.SKIPPED: "cyan",
    EventKind.FAILED: "red",
    EventKind.FINISHED: "bold green",
}
_LEVEL_STYLE: dict[object, str] = {"warn": "yellow", "fail": "red"}
_SILENT = (EventKind.RELEASED, EventKind.EXPOSED)


class Number(click.FloatRange):
    """A finite number, within ends where they are given."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number; what click takes for one but has no ends, such as nan, is refused."""
        found = super().convert(value, param, ctx)
        return found if math.isfinite(found) else self.fail(f"{value!r} is not a finite number.", param, ctx)

    def _describe_range(self) -> str:
        return "any" if self.min is None and self.max is None else super()._describe_range()


def _for_results(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
    """Return where results go: not among a session's own files, where they count as damage or are replaced."""
    real = Path(os.path.realpath(path or "/"))
    for folder in (real, *real.parents):
        if folder.name in _OF_A_SESSION and (folder.parent / "session.json").exists():
            raise click.BadParameter(f"{folder} belongs to a session; choose another folder.", ctx, param)
    return path


def parameter(flags: str, row: Mapping[str, Any]) -> click.Parameter:
    """Return what a row says: an option, or without dashes an argument, of a ``kind`` (or suffixes), or ``choices``."""
    kind, choices, ends = row.get("kind"), row.get("choices"), ("min", "max", "min_open")
    given = {key: value for key, value in row.items() if key not in ("kind", "choices", *ends)}
    given |= {"callback": _for_results} if flags.startswith("--into") else {}
    if choices:
        given["type"] = click.Choice(choices)
    elif kind in ("number", "whole number"):
        found = {end: row[end] for end in ends if end in row}
        given["type"] = (Number if kind == "number" else click.IntRange)(**found)
    elif isinstance(kind, list):
        given["type"] = named = _Place(path_type=Path, dir_okay=False)
        named.suffixes = kind
    elif kind:
        given["type"] = _KINDS[kind]
    return (click.Option if flags.startswith("-") else click.Argument)(flags.split(), **given)


@cache
def _tables(package: str) -> dict[str, dict[str, dict[str, Any]]]:
    return tomllib.loads((files(package) / "options.toml").read_text("utf-8"))


def parameters(package: str, command: str) -> list[click.Parameter]:
    """Return the arguments and options of a command, from `options.toml` beside it."""
    return [parameter(flags, row) for flags, row in _tables(package)[command].items()]


def numbers(flag: str, text: str, count: int, what: str) -> tuple[float, ...]:
    """Return the numbers of an option's text; `click.UsageError` says how many it takes, and of ``what``."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        wanted = "one finite number" if count == 1 else f"{count} comma-separated numbers"
        raise click.UsageError(f"{flag} {text[:40]!r}: {wanted}, {what}")
    return values


def answer(facts: Mapping[str, Any], lines: Iterable[str], *, as_json: bool, exit_code: int = 0) -> int:
    """Write what a command found, as one JSON object (null: no finite number) or as lines; return its exit code."""
    found = json.loads(json.dumps(facts), parse_constant=lambda _: None) if as_json else None
    for line in [json.dumps(found)] if as_json else map(printable, lines):
        click.echo(line)
    return exit_code


if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


class SilentView:
    """Shows nothing: for one JSON object at the end, and the base of all views.

    A view is used as a context, which starts its bars, where it has some, and stops them.
    """

    bars: Progress | None = None

    def __enter__(self) -> Self:
        if self.bars is not None:
            self.bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.bars is not None:
            self.bars.stop()

    def show(self, event: Any) -> None:
        """Show one event of what the view is for."""


class JsonView(SilentView):
    """Writes each event as one JSON object a line (transfer progress is left out)."""

    def show(self, event: CaptureEvent) -> None:
        """Write the event."""
        if event.kind is not EventKind.PROGRESS:
            click.echo(json.dumps(event.to_dict()))


class PlainView(SilentView):
    """Writes a line for each event that people want to read, without bars: for logs."""

    def show(self, event: CaptureEvent) -> None:
        """Write the line."""
        if event.kind not in (EventKind.PROGRESS, *_SILENT):
            click.echo(printable(_line(event)))


class Rendering(SilentView):
    """Shows on standard error what is rendered for simulated instruments: a bar on a terminal, else a line each.

    What is there already (done at once) is not mentioned. Use as a context; call it with what, steps done, steps in
    all.
    """

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        console = Console(stderr=True)
        times = TimeElapsedColumn(), TimeRemainingColumn(), TextColumn("left")
        columns = (TextColumn("rendering {task.description}"), BarColumn(), *times)
        self.bars = Progress(*columns, console=console, transient=True) if console.is_terminal else None
        self._tasks: dict[str, TaskID] = {}
        self._mentioned: set[str] = set()

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show a step."""
        words = _RENDERED.get(what, what)
        if self.bars is None:
            if what not in self._mentioned:
                click.echo(f"rendering {words} (cached for next time) ...", err=True)
            self._mentioned.add(what)
            return
        if what not in self._tasks:
            self._tasks[what] = self.bars.add_task(words)
        self.bars.update(self._tasks[what], completed=done, total=total if total > 1 or done else None)


class TerminalView(SilentView):
    """A bar a camera with the bytes of its frames, and a line for everything else."""

    def __init__(self, sides: tuple[str, ...], n_stops: int) -> None:
        from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

        columns = TextColumn("{task.description:>8}"), BarColumn(), TextColumn("{task.fields[frames]}")
        self.bars = self._progress = Progress(*columns, DownloadColumn(), TransferSpeedColumn(), transient=True)
        self._n_stops = n_stops
        self._saved: dict[str, set[object]] = {side: set() for side in sides}
        self._tasks = {s: self._progress.add_task(s, total=None, frames=f"0/{n_stops}") for s in sides}

    def show(self, event: CaptureEvent) -> None:
        """Update the bars or print a line."""
        side = str(event.data.get("side", ""))
        if event.kind is EventKind.PROGRESS:
            done, total = event.data["done_bytes"], event.data["total_bytes"]
            self._progress.update(self._tasks[side], completed=done, total=total)
        elif event.kind is EventKind.SAVED:
            self._saved[side].add(event.data["stop"])
            self._progress.update(self._tasks[side], frames=f"{len(self._saved[side])}/{self._n_stops}")
        elif event.kind not in _SILENT:
            from rich.markup import escape

            style = _LEVEL_STYLE.get(event.data.get("level")) or _STYLE.get(event.kind, "")
            line = escape(printable(_line(event)))
            self._progress.console.print(f"[{style}]{line}[/]" if style else line, highlight=False)


def _line(event: CaptureEvent) -> str:
    """Return the text of an event as a terminal shows it, where no field beside it says the kind."""
    return {EventKind.STOP: "exposing ", EventKind.WARNING: "warning: "}.get(event.kind, "") + event.text


def printable(text: str) -> str:
    """Return the text without terminal control characters (it may hold names from a device)."""
    return "".join(c if c.isprintable() else "?" for c in text)
