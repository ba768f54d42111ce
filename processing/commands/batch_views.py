"""What a user sees of a batch: a bar and the failures on a terminal, a line a session elsewhere, and the summary."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

if TYPE_CHECKING:
    from processing.batch.run import BatchReport
    from processing.batch.work import Outcome


class QuietView:
    """Shows nothing: for --json."""

    def show(self, outcome: Outcome, over: int, total: int) -> None:
        """Show what became of a session."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None


class BarsView(QuietView):
    """A bar for all sessions with the time left, and a line for each; without a terminal lines alone."""

    def __init__(self, *, terminal: bool) -> None:
        self._bars: Any = None
        self._task: Any = None
        if terminal:
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("sessions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._bars = Progress(*columns, transient=True)
            self._task = self._bars.add_task("", total=None)

    def show(self, outcome: Outcome, over: int, total: int) -> None:
        """Write a line and move the bar."""
        from processing.commands.batch import outcome_line
        from processing.commands.process_views import printable

        line = printable(f"{over}/{total}  {outcome_line(outcome)}")
        if self._bars is None:
            click.echo(line)
            return
        from rich.markup import escape

        self._bars.update(self._task, total=total, completed=over)
        self._bars.console.print(escape(line), highlight=False, style="red" if outcome.state == "failed" else None)

    def __enter__(self) -> Self:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.stop()


def summary_lines(report: BatchReport) -> Iterator[str]:
    """Yield the failures, then the totals."""
    from processing.commands.batch import outcome_line
    from processing.commands.process_views import printable

    for one in report.failed:
        yield printable(outcome_line(one))
    done = len(report.outcomes) - len(report.failed)
    spent = sum(one.cpu_seconds for one in report.outcomes)
    again = sum(1 for one in report.outcomes if one.tries > 1)
    retried = f", {again} of them tried twice" if again else ""
    yield (
        f"{done} of {len(report.outcomes)} sessions done{retried}, {len(report.failed)} failed, "
        f"in {report.seconds:.1f} s ({spent:.1f} CPU s)"
    )
