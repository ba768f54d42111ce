"""What a user sees of a run: a bar with the time left on a terminal, a line a stage elsewhere, and the summary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Self

import click

if TYPE_CHECKING:
    from rich.progress import TaskID

    from processing.running.requests import RunRequest
    from processing.running.results import RunEvent, RunReport, StageReport


class SilentView:
    """Shows nothing: for --json."""

    def show(self, event: RunEvent) -> None:
        """Show one event."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None


class PlainView(SilentView):
    """A line when a stage starts: for logs."""

    def show(self, event: RunEvent) -> None:
        """Write a line for what takes time."""
        if event.kind == "started":
            click.echo(printable(f"{event.stage}: {event.text}{_left(event.left_s)}"))


class TerminalView(SilentView):
    """One bar, for the stage that runs."""

    def __init__(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        words = TextColumn("{task.fields[words]}", markup=False)
        self._bars = Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), words, transient=True)
        self._task: TaskID | None = None

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def show(self, event: RunEvent) -> None:
        """Update the bar."""
        words = printable(event.text + _left(event.left_s))
        if event.kind == "started":
            self._task = self._bars.add_task(event.stage, total=None, words=words)
        elif self._task is not None and event.kind == "progress":
            self._bars.update(self._task, total=1.0, completed=event.fraction, words=words)
        elif self._task is not None:
            self._bars.remove_task(self._task)
            self._task = None


def plain_or_terminal(is_terminal: bool) -> SilentView:
    """Return the view that fits."""
    return TerminalView() if is_terminal else PlainView()


def summary_lines(report: RunReport, request: RunRequest, *, explain: bool) -> Iterator[str]:
    """Yield what was done, what was not and why, warnings, seconds and memory."""
    for stage in report.stages:
        yield from map(printable, _stage_lines(stage, explain=explain))
    for flag, key, value in (
        ("--max-error", "max_error", request.max_error),
        ("--time-budget", "time_budget", request.time_budget_s),
    ):
        if value is not None:
            honoured = [s.stage for s in report.stages if key in s.summary.get("honoured", {})]
            yield f"{flag} {value:g}: honoured by {', '.join(honoured) or 'no stage'}; the others cannot trade it"
    done = [stage for stage in report.stages if stage.cost]
    cost = report.cost
    if not done:
        yield "nothing was run: --dry-run" if request.dry_run else f"nothing was done; {cost.seconds:.1f} s"
    else:
        spent = f"{cost.seconds:.1f} s ({cost.cpu_seconds:.1f} CPU s), peak memory {cost.peak_bytes / 1e9:.2f} GB"
        yield f"{len(done)} of {len(report.stages)} stages done in {spent}"


def _stage_lines(stage: StageReport, *, explain: bool) -> Iterator[str]:
    from processing.running.decision import change_line

    seconds = f"{stage.cost.seconds:8.1f} s" if stage.cost else " " * 10
    yield f"{stage.stage:<10} {stage.action.value:<13}{seconds}  {stage.reason}"
    if explain:
        for change in stage.changes:
            yield f"{'':10}   {change_line(change)}"
    for why, names in _by_reason(stage.summary.get("left_out", {})).items():
        yield f"{'':10} left out: {', '.join(names)}: {why}"
    for name, what in stage.summary.get("honoured", {}).items():
        yield f"{'':10} {name.replace('_', ' ')}: {what}"
    for warning in stage.summary.get("warnings", ()):
        yield f"{'':10} warning: {warning['message']} ({warning['code']})"


def _by_reason(left_out: Mapping[str, str]) -> dict[str, list[str]]:
    """Return what was left out by the reason; alternatives that nobody asked for are no news."""
    from processing.stages.parameters import NO_SUCH

    found: dict[str, list[str]] = {}
    for name, why in left_out.items():
        if why != NO_SUCH:
            found.setdefault(why, []).append(name)
    return found


def _left(seconds: float | None) -> str:
    """Return the time left in words; nothing where it is not known."""
    if seconds is None:
        return ""
    if seconds < 90:
        return f", about {max(1, round(seconds))} s left"
    return f", about {round(seconds / 60)} min left"


def printable(text: str) -> str:
    """Return the text without control characters (it may hold names from a file)."""
    return "".join(c if c.isprintable() else "?" for c in text)
