"""``daylit process``: from a session to its results, only what has to be done; ``daylit choices``: what with."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import FILE, SilentView, answer, parameter, parameters, printable

if TYPE_CHECKING:
    from rich.progress import TaskID

    from processing.running.choices import Choices, GoingOn
    from processing.running.requests import RunRequest
    from processing.running.results import RunEvent, RunReport, StageReport
    from processing.stages.parameters import Option


_PREFIX = "of_stage_"
LINE_S = 15.0  # off a terminal, between lines on a stage that goes on (chosen: few in a log, soon enough for a person)


class ProcessCommand(click.Command):
    """A command that runs the pipeline: its options are its own, those of every run, and those of the stages."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the command's own options, those of every run, and what the stages of the table take."""
        from processing.ground.tables import table_of
        from processing.pipeline import STAGES, options, trades

        *own, as_json, help_option = super().get_params(ctx)
        table = table_of(__package__, "process")
        more = [parameter(f"--{name}", row) for name, row in table["run"].items()]
        for trade in sorted(trades()):
            row, users = table["trades"][trade], ", ".join(stage.name for stage in STAGES if trade in stage.trades)
            help_ = f"{row['help']} Stages: {users}."
            more.append(parameter(f"--{trade.replace('_', '-')}", {**row, "help": help_}))
        more += [_stage_option(option) for option in options().values()]
        return [*own, *more, as_json, help_option]

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the command's options, then those of each stage in the order in which stages run."""
        from processing.pipeline import STAGES

        params = {p.name or "": p for p in self.get_params(ctx) if isinstance(p, click.Option)}
        sections = {"Options": [p for name, p in params.items() if not name.startswith(_PREFIX)]}
        for stage in STAGES:  # an option that several stages share stands with the first
            names = [name for flag in stage.options if (name := _parameter_name(flag)) in params]
            sections[f"{stage.name}: {stage.title}"] = [params.pop(name) for name in names]
        for title, among in sections.items():
            records = [record for p in among if (record := p.get_help_record(ctx))]
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def _stage_option(option: Option) -> click.Option:
    """Return the option of a stage's parameter; where several stages have it, its help names them."""
    from processing.pipeline import STAGES

    users = [stage.name for stage in STAGES if option.flag in stage.options]
    shared = f" Stages: {', '.join(users)}." if len(users) > 1 else ""
    names, text = [option.flag, _parameter_name(option.flag)], option.help + shared
    kind = option.type if option.kind == "parameter" else FILE
    choices = f"[{'|'.join(option.choices)}]" if option.choices else None
    return click.Option(names, type=kind, is_flag=option.type is bool, metavar=choices, default=None, help=text)


def _parameter_name(flag: str) -> str:
    return _PREFIX + flag.removeprefix("--").replace("-", "_")


def run_request(asked: Mapping[str, Any]) -> RunRequest:
    """Return what the options of a `ProcessCommand` say of this run alone."""
    from processing.running.requests import RunRequest

    dry_run, recheck = asked.get("dry_run", False), asked["recheck"]
    first = sys.stdout.isatty() and not asked.get("as_json")
    return RunRequest(until=asked["until"], force=asked["force"], dry_run=dry_run, recheck=recheck, first_picture=first)


def given_now(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the options of a `ProcessCommand` choose for the session, by name, without what was not given."""
    from processing.pipeline import options, trades

    found = {flag[2:]: asked[_parameter_name(flag)] for flag in options()}
    found |= {trade.replace("_", "-"): asked[trade] for trade in trades()}
    return {name: value for name, value in found.items() if value is not None}


@click.command(cls=ProcessCommand, params=parameters(__package__, "process"))
def process(session: Path | None, *, explain: bool, as_json: bool, **asked: Any) -> int:
    """Process SESSION: check, merge, calibrate ... A stage runs only if something it depends on has changed.

    Results go to SESSION/stages, one folder per stage. A killed run leaves either the old result or the new one, and
    the next run continues from there. Options are saved with the session (`daylit choices`): an option you leave out
    keeps its saved value; one you give replaces it.

    \b
    Examples:
      daylit process sessions/2023-05-19T1554Z_coda-320
      daylit process --until merge --max-error 0.02 --explain sessions/2023-05-19T1554Z_coda-320
      daylit process --panorama bedroom.jpg
    """
    from processing.running.choices import going_on
    from processing.running.runner import clean
    from processing.running.runner import process as run

    request = run_request(asked)
    if request.dry_run and asked["panorama"] is not None and session is None:
        session = _would_make(asked["panorama"], asked["into"] or Path("sessions"), as_json=as_json)
        if session is None:
            return 0
    else:
        session = _session(session, asked["panorama"], asked["into"])
    request = request if request.until else replace(request, until=_end(session))
    with going_on(session, given_now(asked), request, by="daylit process", forgotten=asked["forget"]) as found:
        if not as_json:
            echo_choices(found)
        with SilentView() if as_json else stage_view() as view:
            report = run(session, request := found.request, on_event=view.show)
    if asked["keep"] == "results" and not request.dry_run:
        clean(session)
    if as_json:
        chosen = {"went_on_with": found.kept, "notes": found.notes}
        click.echo(json.dumps({"ok": True, "dry_run": request.dry_run, **report.to_dict(), "choices": chosen}))
        return 0
    for line in summary_lines(report, request, explain=explain):
        click.echo(line)
    # What a run until an earlier stage leaves of stills and report may be of other options.
    done = set[str]() if request.dry_run else {one.stage for one in report.stages}
    if "stills" in done:
        from processing.commands.results import still_paths

        for still in still_paths(session):
            click.echo(f"still:  {still}")
    page = session / "stages" / "report" / "index.html"
    if "report" in done and page.is_file():
        click.echo(f"report: {page}")
    return 0


def echo_choices(found: GoingOn) -> None:
    """Say what a run goes on with, and what was chosen and is not used."""
    if found.kept:
        words = ", ".join(f"--{name} {value}" for name, value in found.kept.items())
        click.echo(printable(f"saved options: {words}"))
    for note in found.notes:
        click.echo(printable(f"note: {note}"))


def _would_make(panorama: Path, into: Path, *, as_json: bool) -> Path | None:
    """Return the existing session of a panorama; without one check the picture, say what would be made, return None."""
    from processing.pictures.panorama import read_panorama
    from processing.running.panorama_session import existing_session

    if (session := existing_session(panorama, into)) is not None:
        return session
    units = read_panorama(panorama).image.unit
    line = f"would create a session from {panorama.name} in {into}, in {units}, and run every stage"
    answer({"ok": True, "dry_run": True, "session": None, "units": units, "stages": []}, (line,), as_json=as_json)
    return None


def _end(session: Path) -> str | None:
    """Return the stage that a run without --until ends after: of a sky alone its calibration, as there is no room."""
    from station.session.session import Side
    from station.session.store import load_manifest

    manifest = load_manifest(session)
    return None if manifest.panorama or Side.INDOOR in manifest.bracket.sides else "calibrate"


def _session(session: Path | None, panorama: Path | None, into: Path | None) -> Path:
    """Return the session that is named, or that of the panorama."""
    from station.errors import UsageError

    if (session is None) == (panorama is None):
        raise UsageError("give a session, or --panorama FILE", where="daylit process", advice="give one, not both")
    if panorama is None:
        if into is not None:
            raise UsageError("--into needs --panorama", where="daylit process", advice="leave it out")
        assert session is not None
        from processing.pictures.panorama import FORMATS

        if session.is_file() and session.suffix.lower() in (*FORMATS, ".bmp", ".gif"):
            advice = f"daylit process --panorama {quote(str(session))}"
            raise UsageError("is a picture; a session is a folder", where=str(session), advice=advice)
        return session
    from processing.running.panorama_session import panorama_session

    return panorama_session(panorama, into or Path("sessions"))


# What a user sees of a run: a bar with the time left on a terminal, a line per stage elsewhere, and the summary.


class _RunView(SilentView):
    """Where a stage fails, it says what those before warned of: that is often why."""

    _warned: tuple[str, ...] = ()

    def show(self, event: RunEvent) -> None:
        if event.report:
            lines = _stage_lines(event.report)
            self._warned += tuple(line for line in lines if line.lstrip().startswith("warning: "))
        for line in self._warned if event.kind == "failed" else ():
            click.echo(printable(line), err=True)
        if event.kind == "failed" and not event.text:  # as Ctrl-C comes
            click.echo(
                f"{event.stage}: stopped; finished stages are kept, the same command goes on from here", err=True
            )


class PlainView(_RunView):
    """A line when a stage starts, every `LINE_S` seconds while it works, and when it is done: for logs."""

    def __init__(self) -> None:
        self._said_s = time.monotonic()

    def show(self, event: RunEvent) -> None:
        """Write a line for what takes time."""
        super().show(event)
        cost = event.report.cost if event.report else None
        if event.kind == "finished" and cost:
            click.echo(printable(f"{event.stage}: done in {cost.seconds:.1f} s"))
        elif event.kind in ("started", "first"):
            click.echo(printable(f"{event.stage}: {event.text}{_left(event.left_s)}"))
        elif event.kind == "progress" and time.monotonic() - self._said_s >= LINE_S:
            click.echo(printable(f"{event.stage}: {event.fraction:.0%} {event.text}{_left(event.left_s)}"))
        else:
            return
        self._said_s = time.monotonic()


class TerminalView(_RunView):
    """One bar, for the stage that runs."""

    def __init__(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        words = TextColumn("{task.fields[words]}", markup=False)
        self.bars = self._stages = Progress(
            TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), words, transient=True
        )
        self._task: TaskID | None = None

    def show(self, event: RunEvent) -> None:
        """Update the bar."""
        super().show(event)
        words = printable(event.text + _left(event.left_s))
        if event.kind == "first":
            self._stages.console.print(words, markup=False, highlight=False)
        elif event.kind == "started":
            self._task = self._stages.add_task(event.stage, total=None, words=words)
        elif self._task is not None and event.kind == "progress":
            self._stages.update(self._task, total=1.0, completed=event.fraction, words=words)
        elif self._task is not None:
            self._stages.remove_task(self._task)
            self._task = None


def stage_view() -> SilentView:
    """Return the view of a run that fits standard output."""
    return TerminalView() if sys.stdout.isatty() else PlainView()


def summary_lines(report: RunReport, request: RunRequest, *, explain: bool) -> Iterator[str]:
    """Yield what was done, what was not and why, warnings, seconds and memory."""
    for stage in report.stages:
        yield from map(printable, _stage_lines(stage, explain=explain))
    trades = (("--max-error", "max_error", request.max_error), ("--time-budget", "time_budget", request.time_budget_s))
    for flag, key, value in trades:
        if value is not None:
            honoured = [s.stage for s in report.stages if key in s.summary.get("honoured", {})]
            yield f"{flag} {value:g}: used by {', '.join(honoured) or 'no stage'}; not supported by the others"
    done = [stage for stage in report.stages if stage.cost]
    cost = report.cost
    if not done:
        yield "--dry-run: nothing was run" if request.dry_run else f"nothing to do; {cost.seconds:.1f} s"
    else:
        spent = f"{cost.seconds:.1f} s ({cost.cpu_seconds:.1f} CPU s), peak memory {cost.peak_bytes / 1e9:.2f} GB"
        yield f"{len(done)} of {len(report.stages)} stages done in {spent}"


def _stage_lines(stage: StageReport, *, explain: bool = False) -> Iterator[str]:
    from processing.running.requests import change_line
    from processing.stages.parameters import NO_SUCH

    seconds = f"{stage.cost.seconds:8.1f} s" if stage.cost else " " * 10
    yield f"{stage.stage:<10} {stage.action.value:<13}{seconds}  {stage.reason}"
    if explain:
        for change in stage.changes:
            yield f"{'':10}   {change_line(change)}"
    # What was left out, by reason; alternatives that nobody requested are no news
    names_of: dict[str, list[str]] = {}
    for name, why in stage.summary.get("left_out", {}).items():
        if why != NO_SUCH:
            names_of.setdefault(why, []).append(name)
    for why, names in names_of.items():
        yield f"{'':10} left out: {', '.join(names)}: {why}"
    for name, what in stage.summary.get("honoured", {}).items():
        yield f"{'':10} {name.replace('_', ' ')}: {what}"
    for warning in stage.summary.get("warnings", ()):
        yield f"{'':10} warning: {warning['message']} ({warning['code']})"


def _left(seconds: float | None) -> str:
    """Return the time left in words; nothing where it is not known."""
    if seconds is None:
        return ""
    return f", about {max(1, round(seconds))} s left" if seconds < 90 else f", about {round(seconds / 60)} min left"


@click.command(params=parameters(__package__, "choices"))
def choices(session: Path, given: tuple[str, ...], *, forget: tuple[str, ...], past: bool, as_json: bool) -> int:
    """Show or change the saved options of SESSION, which process, batch, relight and view-from use.

    NAME=VALUE saves an option without running anything; names are those of `daylit process` options without the dashes.
    Files outside the session are copied into its folder choices, so that the session can be moved.

    \b
    Examples:
      daylit choices sessions/2023-05-19T1554Z_coda-320
      daylit choices sessions/2023-05-19T1554Z_coda-320 set=living quality=draft
      daylit choices sessions/2023-05-19T1554Z_coda-320 --forget mask
    """
    from processing.errors import ParameterError
    from processing.running import choices as kept

    pairs = dict(pair.partition("=")[::2] for pair in given)
    if wrong := [pair for pair in given if "=" not in pair]:
        raise ParameterError(f"{wrong[0][:60]!r} is not NAME=VALUE", advice="such as set=living")
    if forget:
        kept.forget(session, forget)
    if chosen := {name.removeprefix("--"): value for name, value in pairs.items()}:
        kept.check_values(session, chosen)
        kept.remember(session, chosen, by="daylit choices")
    found = kept.read_choices(session)
    facts = {"ok": True, "session": session.name, **found.model_dump(mode="json")}
    return answer(facts, _lines(session, found, past=past), as_json=as_json)


def _lines(session: Path, found: Choices, *, past: bool) -> list[str]:
    from processing.calibration.outdoor.sun_place import with_zone, zone_at
    from processing.running.choices import shown
    from station.session.store import load_manifest

    site = load_manifest(session).site
    zone = zone_at(site.latitude_deg, site.longitude_deg, found.value(session, "zone"))
    lines = [
        f"{name:<16} {shown(one):<28} {with_zone(one.at, zone)}  {one.by}{f'  ({one.file})' if one.file else ''}"
        for name, one in found.chosen.items()
    ]
    if past:
        lines += [f"until {with_zone(one.until, zone)}: {one.name} {shown(one)}  {one.by}" for one in found.past]
    return lines or ["no saved options: every option has its default"]
