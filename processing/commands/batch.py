"""``daylit batch``: many sessions, on all cores or on a cluster; ``daylit dataset``: a data set of them for others."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from processing.commands.process import ProcessCommand, given_now, run_request
from station.commands.views import SilentView, answer, numbers, parameters, printable

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
    again = sum(1 for one in report.outcomes if one.tries > 1 and one.state == "done")
    retried = f", {again} of them after a second try" if again else ""
    yield (
        f"{done} of {len(report.outcomes)} sessions done{retried}, {len(report.failed)} failed, "
        f"in {report.seconds:.1f} s ({spent:.1f} CPU s, {report.cores_busy:.2f} cores busy)"
    )


@click.command(cls=ProcessCommand, params=parameters(__package__, "batch"))
def batch(folder: str, *, as_json: bool, **asked: Any) -> int:
    """Process every session in FOLDER (or URL), several at a time; takes the options of `daylit process`.

    Each session keeps its saved options; options given here are saved for all of them in a folder, and
    count for this run only at a URL.

    A session that fails, hangs or kills its process is listed and does not stop the others. Run the same command again
    to continue where it was interrupted. At the end FOLDER holds batch.csv (one row per session) and batch.json.

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

        raise ParameterError("--workers applies to this computer only: leave it out with --cluster")
    workers, zone = asked["workers"] or usual_workers(), asked["zone"] and str(zone_named(asked["zone"]))
    request = BatchRequest(folder, _arguments(asked), workers, asked["cluster"], asked["session_timeout"], zone)
    (asked["into"] or Path()).mkdir(parents=True, exist_ok=True)  # now rather than after hours
    with SilentView() if as_json else BarsView(terminal=sys.stdout.isatty()) as view:
        report = run_batch(request, lambda *event: view.show(event))
    table, values = write_table(asked["into"] or Path("." if is_url(folder) else folder), report)
    facts = {**report.to_dict(), "files": [str(table), str(values)]}
    lines = (*summary_lines(report), f"table: {table}")
    return answer(facts, lines, as_json=as_json, exit_code=5 if report.failed else 0)


def _arguments(asked: dict[str, Any]) -> tuple[str, ...]:
    """Return what is asked of each session as arguments of `daylit process`; files by their whole path.

    `ParameterError` now rather than once a session."""
    from processing.pipeline import STAGES, options
    from processing.running.choices import with_options
    from processing.running.requests import check_readable, planned
    from processing.stages.parameters import WORDS

    request, given = run_request(asked), given_now(asked)
    check_readable(planned(asked_of := with_options(request, given), STAGES), asked_of)
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


@click.group()
def dataset() -> None:
    """Build, check and summarise a data set of processed sessions.

    \b
    Examples:
      daylit dataset build rooms --name "Rooms of 2023" --licence CC-BY-4.0
      daylit dataset check rooms
    """


@dataset.command(params=parameters(__package__, "dataset build"))
def build(folder: Path, *, split: str, zone: str | None, as_json: bool, **about: str) -> int:
    """Write index.csv, croissant.json, LICENCE.txt and SHA256SUMS into FOLDER, beside its sessions.

    Splits are by room: all sessions of a room fall in one split, and stay there when sessions are added.

    \b
    Example: daylit dataset build rooms --name "Rooms of 2023" --licence CC-BY-4.0 --zone America/New_York
    """
    from processing.batch.dataset import Description
    from processing.batch.dataset import build as make
    from processing.batch.dataset import summary as sum_up
    from processing.calibration.outdoor.sun_place import zone_named

    description = Description(version=about.pop("release"), **about)
    train, validation, test = (part / 100 for part in numbers("--split", split, 3, "per cent, such as 70,15,15"))
    made = make(folder, description, shares=(train, validation, test), zone=zone and str(zone_named(zone)))
    files, found = [str(path) for path in made], sum_up(folder)
    return answer({"ok": True, "files": files, **found}, [*files, *_summary_lines(found)], as_json=as_json)


@dataset.command(params=parameters(__package__, "dataset check"))
def check(folder: Path, *, as_json: bool) -> int:
    """Compare FOLDER with its checksums, index and metadata.

    \b
    Example: daylit dataset check rooms
    Exit code: 0 unchanged since it was built · 1 something is missing, changed, extra or inconsistent.
    """
    from processing.batch.dataset import check as compare

    report = compare(folder)
    facts = {name: getattr(report, name) for name in ("files", "missing", "changed", "new", "problems")}
    lines = [f"{word}: {name}" for word in ("missing", "changed", "new") for name in facts[word]]
    lines += [*report.problems, f"{report.files} files compared: {'unchanged' if report.ok else 'not as built'}"]
    return answer({"ok": report.ok, **facts}, lines, as_json=as_json, exit_code=0 if report.ok else 1)


@dataset.command(params=parameters(__package__, "dataset summary"))
def summary(folder: Path, *, as_json: bool) -> int:
    """Summarise the data set in FOLDER in numbers.

    \b
    Example: daylit dataset summary rooms --json
    """
    from processing.batch.dataset import summary as sum_up

    found = sum_up(folder)
    return answer({"ok": True, **found}, _summary_lines(found), as_json=as_json)


def _summary_lines(found: dict[str, Any]) -> Iterator[str]:
    for name, value in found.items():
        text = value
        if isinstance(value, dict):
            parts = ((key, f"{one:g}" if isinstance(one, float) else one) for key, one in value.items())
            text = ", ".join(f"{key} {one}" for key, one in parts)
        elif isinstance(value, list):
            text = " to ".join(value)
        yield f"{name.replace('_', ' '):<18} {'-' if text is None else text}"
