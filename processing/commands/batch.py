"""``daylit batch``: many sessions, on all cores or on a cluster."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

from processing.commands.process import ProcessCommand

if TYPE_CHECKING:
    from processing.batch.run import BatchReport
    from processing.batch.work import Outcome
    from processing.running.requests import RunRequest


# What a user sees of a batch: a bar and the failures on a terminal, a line a session elsewhere, and the summary.


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


@click.command(cls=ProcessCommand)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--workers", type=click.IntRange(1, 1024), metavar="N", help="Sessions at once on this computer.")
@click.option("--cluster", metavar="ADDRESS", help="A Dask scheduler elsewhere, such as tcp://10.0.0.5:8786.")
@click.option(
    "--session-timeout",
    type=click.FloatRange(1, 1e6),
    default=7200.0,
    show_default=True,
    metavar="SECONDS",
    help="A session that takes longer is ended and listed.",
)
@click.option("--zone", default="UTC", show_default=True, metavar="NAME", help="Of dates and times in the table.")
@click.option("--into", type=click.Path(path_type=Path, file_okay=False), help="For the table (default: FOLDER).")
@click.option("--until", metavar="STAGE", help="Run this stage and what it needs, no more.")
@click.option("--force", metavar="STAGE", multiple=True, help="Run this stage though nothing has changed (repeatable).")
@click.option("--recheck", is_flag=True, help="Read every file again instead of trusting size and times.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object at the end.")
def batch(folder: Path, *, as_json: bool, **asked: Any) -> int:
    """Process every session in FOLDER, several at a time; takes the options of `daylit process`.

    A session that fails, hangs or kills its process is listed and stops no other. Run the same command again to go on
    where it was interrupted. At its end FOLDER holds batch.csv (a row a session) and batch.json.

    \b
    Examples:
      daylit batch sessions --workers 4
      daylit batch /data/rooms --cluster tcp://10.0.0.5:8786 --until calibrate --zone America/New_York
    Exit code: 0 all done · 5 some failed (they are listed).
    """
    from processing.batch.cluster import usual_workers
    from processing.batch.rows import write_table
    from processing.batch.run import BatchRequest, run_batch

    if asked["cluster"] is not None and asked["workers"] is not None:
        from processing.errors import ParameterError

        raise ParameterError("--workers is of this computer's own cluster: leave it out with --cluster")
    request = BatchRequest(
        folder,
        _arguments(_checked(asked)),
        asked["workers"] or usual_workers(),
        asked["cluster"],
        asked["session_timeout"],
        known_zone(asked["zone"]),
    )
    with QuietView() if as_json else BarsView(terminal=sys.stdout.isatty()) as view:
        report = run_batch(request, view.show)
    table, values = write_table(asked["into"] or folder, report)
    _tell(report, summary_lines, (table, values), as_json=as_json)
    return 5 if report.failed else 0


def _tell(report: BatchReport, lines: Any, files: tuple[Path, Path], *, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps({**report.to_dict(), "files": [str(path) for path in files]}))
        return
    for line in lines(report):
        click.echo(line)
    click.echo(f"table: {files[0]}")


def _checked(asked: dict[str, Any]) -> RunRequest:
    """Return what is asked of each session; `ParameterError` now rather than once a session."""
    from processing.commands.process import run_request
    from processing.pipeline import STAGES
    from processing.running.requests import planned

    request = run_request({**asked, "dry_run": False})
    planned(request, STAGES)
    return request


def _arguments(request: RunRequest) -> tuple[str, ...]:
    """Return a request as arguments of `daylit process`; files by their whole path."""
    from processing.pipeline import options

    found = ["--quality", request.quality.value]
    if request.until is not None:
        found += ["--until", request.until]
    for name in request.force:
        found += ["--force", name]
    if request.recheck:
        found.append("--recheck")
    if request.max_error is not None:
        found += ["--max-error", repr(request.max_error)]
    if request.time_budget_s is not None:
        found += ["--time-budget", repr(request.time_budget_s)]
    kinds = options()
    for flag, value in request.options.items():
        if kinds[flag].type == "flag" and kinds[flag].kind == "parameter":
            found += [flag] if value else []
        else:
            found += [flag, str(value if kinds[flag].kind == "parameter" else Path(str(value)).resolve())]
    return tuple(found)


def known_zone(name: str) -> str:
    """Return the name of a time zone; raise `ParameterError` where there is none."""
    from zoneinfo import ZoneInfo

    from processing.errors import ParameterError

    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise ParameterError(f"--zone {name[:60]}: no such time zone", advice="such as America/New_York") from None
    return name


def outcome_line(outcome: Outcome) -> str:
    """Return one line for what became of a session."""
    if outcome.state == "done":
        return f"done    {outcome.session}  {outcome.seconds:.1f} s"
    return f"failed  {outcome.session}  {outcome.code} {outcome.message}"
