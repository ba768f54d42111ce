"""``daylit simulate``: whole data sets of simulated sessions, with the truth beside them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import SilentView, answer, parameters, printable

if TYPE_CHECKING:
    from station.simulate.run import DatasetEvent


_PASSING = ("begun", "rendering", "capturing")


@click.command(params=parameters(__package__, "simulate"))
def simulate(folder: Path, *, as_json: bool, **options: Any) -> int:
    """Generate a data set of simulated rooms in FOLDER: sessions, their ground truth in FOLDER/truth, dataset.csv.

    Complete sessions are kept: run the same command again to continue where it was interrupted.

    \b
    Examples:
      daylit simulate rooms --sessions 20 --size quarter
      daylit simulate paper --conditions cali_hdr_summary.csv --size half
    """
    from station.simulate.plan import DatasetRequest
    from station.simulate.run import simulate as make

    kind = SilentView if as_json else _Bars if sys.stdout.isatty() else _Lines
    with kind() as view:
        summary = make(DatasetRequest(folder, **options), view.show)
    lines = [f"failed: {name}: {error['message']}" for name, error in summary.failed.items()]
    parts = f"{len(summary.made)} made, {len(summary.kept)} kept, {len(summary.failed)} failed"
    lines.append(f"{summary.planned} sessions in {summary.into}: {parts}, in {summary.seconds:.0f} s")
    return answer(summary.to_dict(), lines, as_json=as_json, exit_code=4 if summary.failed else 0)


class _Lines(SilentView):
    """Writes a line for what has become of each session: for logs."""

    def show(self, event: DatasetEvent) -> None:
        """Write the line."""
        if event.kind not in _PASSING:
            click.echo(_line(event))


class _Bars(SilentView):
    """A bar for the session at work, and a line for each that is done."""

    def __init__(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[doing]}"))
        self.bars = self._progress = Progress(*columns, TimeElapsedColumn(), transient=True)
        self._task = self._progress.add_task("", total=None, doing="")

    def show(self, event: DatasetEvent) -> None:
        """Move the bar or print a line."""
        from rich.markup import escape

        if event.kind == "begun":
            self._progress.reset(self._task, description=escape(event.session), total=None, doing="")
        elif event.kind in _PASSING:
            doing = f"{event.kind} {event.text}".rstrip()
            total = event.total if event.total > 1 else None
            self._progress.update(self._task, completed=event.done, total=total, doing=doing)
        else:
            style = "red" if event.kind == "failed" else ""
            line = escape(_line(event))
            self._progress.console.print(f"[{style}]{line}[/]" if style else line, highlight=False)


def _line(event: DatasetEvent) -> str:
    return printable(f"{event.kind:>6}  {event.session}" + (f"  ({event.text})" if event.text else ""))
