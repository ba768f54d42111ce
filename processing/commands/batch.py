"""``daylit batch``: many sessions, on all cores or on a cluster."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from processing.commands.process import ProcessCommand, given_now, run_request
from station.commands.views import SilentView, printable

if TYPE_CHECKING:
    from processing.batch.run import BatchReport
    from processing.batch.work import Outcome


class BarsView(SilentView):
    """A bar for all sessions with the time left, and a line for each; without a terminal lines alone."""

    def __init__(self, *, terminal: bool) -> None:
        if terminal:
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("sessions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self.bars = Progress(*columns, transient=True)
            self._task = self.bars.add_task("", total=None)

    def show(self, event: tuple[Outcome, int, int]) -> None:
        """Write a line and move the bar; the event: outcome of a session, how many are over, of how many."""
        outcome, over, total = event
        line = printable(f"{over}/{total}  {outcome_line(outcome)}")
        if self.bars is None:
            click.echo(line)
            return
        from rich.markup import escape

        self.bars.update(self._task, total=total, completed=over)
        self.bars.console.print(escape(line), highlight=False, style="red" if outcome.state == "failed" else None)


def summary_lines(report: BatchReport) -> Iterator[str]:
    """Yield the failures, then the totals."""
    for one in report.failed:
        yield printable(outcome_line(one))
    done = len(report.outcomes) - len(report.failed)
    spent = sum(one.cpu_seconds for one in report.outcomes)
    again = sum(1 for one in report.outcomes if one.tries > 1)
    retried = f", {again} of them tried twice" if again else ""
    yield (
        f"{done} of {len(report.outcomes)} sessions done{retried}, {len(report.failed)} failed, "
        f"in {report.seconds:.1f} s ({spent:.1f} CPU s, {report.cores_busy:.2f} cores busy)"
    )


@click.command(cls=ProcessCommand)
@click.argument("folder")
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
@click.option("--zone", metavar="NAME", help="Of dates and times in the table (default: each session's).")
@click.option(
    "--into", type=click.Path(path_type=Path, file_okay=False), help="For the table (default: FOLDER; of a URL: here)."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object at the end.")
def batch(folder: str, *, as_json: bool, **asked: Any) -> int:
    """Process every session in FOLDER (or URL), several at a time; takes the options of `daylit process`.

    Each session goes on with what was chosen for it; what is given here is chosen for all of them.

    A session that fails, hangs or kills its process is listed and stops no other. Run the same command again to go on
    where it was interrupted. At its end FOLDER holds batch.csv (a row a session) and batch.json.

    \b
    Examples:
      daylit batch sessions --workers 4
      daylit batch /data/rooms --cluster tcp://10.0.0.5:8786 --until calibrate --zone America/New_York
      daylit batch s3://rooms/2023 --into tables
    Exit code: 0 all done · 5 some failed (they are listed).
    """
    from processing.batch.cluster import usual_workers
    from processing.batch.rows import write_table
    from processing.batch.run import BatchRequest, run_batch
    from processing.batch.store import is_url
    from processing.calibration.outdoor.sun_place import zone_named

    if asked["cluster"] is not None and asked["workers"] is not None:
        from processing.errors import ParameterError

        raise ParameterError("--workers is of this computer's own cluster: leave it out with --cluster")
    request = BatchRequest(
        folder,
        _arguments(asked),
        asked["workers"] or usual_workers(),
        asked["cluster"],
        asked["session_timeout"],
        asked["zone"] and str(zone_named(asked["zone"])),
    )
    with SilentView() if as_json else BarsView(terminal=sys.stdout.isatty()) as view:
        report = run_batch(request, lambda *event: view.show(event))
    table, values = write_table(asked["into"] or Path("." if is_url(folder) else folder), report)
    if as_json:
        click.echo(json.dumps({**report.to_dict(), "files": [str(table), str(values)]}))
    else:
        for line in (*summary_lines(report), f"table: {table}"):
            click.echo(line)
    return 5 if report.failed else 0


def _arguments(asked: dict[str, Any]) -> tuple[str, ...]:
    """Return what is asked of each session as arguments of `daylit process`; files by their whole path.

    `ParameterError` now rather than once a session.
    """
    from processing.pipeline import STAGES, options
    from processing.running.choices import with_options
    from processing.running.requests import planned
    from processing.stages.parameters import WORDS

    request, given = run_request(asked), given_now(asked)
    planned(with_options(request, given), STAGES)
    found = ["--keep", asked["keep"]]
    for flag, values in (("--until", asked["until"] or ()), ("--force", asked["force"]), ("--forget", asked["forget"])):
        for value in (values,) if isinstance(values, str) else values:
            found += [flag, value]
    if request.recheck:
        found.append("--recheck")
    known = options()
    for name, value in given.items():
        option = known.get(flag := f"--{name}")
        if option is not None and option.type is bool and option.kind == "parameter":
            found += [flag] if value else []
        else:
            path = option is not None and option.kind != "parameter" and not (option.installed and str(value) in WORDS)
            found += [flag, str(Path(str(value)).resolve() if path else value)]
    return tuple(found)


def outcome_line(outcome: Outcome) -> str:
    """Return one line for what became of a session."""
    if outcome.state == "done":
        return f"done    {outcome.session}  {outcome.seconds:.1f} s"
    return f"failed  {outcome.session}  {outcome.code} {outcome.message}"
