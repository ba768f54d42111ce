"""``daylit process``: from a session to its results, only what has to be done."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from processing.pipeline import Option
    from processing.running.requests import RunRequest

_PREFIX = "of_stage_"
_TRADES = {
    "quality": {"type": click.Choice(["draft", "standard", "reference"]), "help": "How much work is worth while."},
    "max_error": {"type": float, "help": "Relative error that is good enough (0.02 is 2 %)."},
    "time_budget": {"type": float, "help": "Seconds that may be spent."},
}


class ProcessCommand(click.Command):
    """Takes the options of the stages from the table, so that what no stage does is not offered."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return our own options and those of the stages."""
        from processing.pipeline import options, trades

        found: list[click.Parameter] = list(super().get_params(ctx))
        at = len(found) - 2
        more = [_trade_option(trade) for trade in sorted(trades())]
        more += [_stage_option(flag, option) for flag, option in options().items()]
        return [*found[:at], *more, *found[at:]]

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write our own options, then those of each stage in the order in which stages run."""
        from processing.pipeline import STAGES

        params = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        sections: dict[str, list[click.Option]] = {
            "Options": [p for p in params if not (p.name or "").startswith(_PREFIX)]
        }
        for stage in STAGES:
            names = {_parameter_name(option.flag) for option in stage.options}
            told = {p.name for section in sections.values() for p in section}
            sections[f"{stage.name}: {stage.title}"] = [p for p in params if p.name in names - told]
        for title, among in sections.items():
            records = [record for p in among if (record := p.get_help_record(ctx))]
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def _trade_option(trade: str) -> click.Option:
    from processing.pipeline import STAGES

    honoured = ", ".join(stage.name for stage in STAGES if trade in stage.trades)
    given: dict[str, Any] = dict(_TRADES[trade])
    given["help"] += f" Stages: {honoured}."
    return click.Option([f"--{trade.replace('_', '-')}"], **given)


def _stage_option(flag: str, option: Option) -> click.Option:
    """Return an option of one stage; where several have it, its help names them."""
    from processing.pipeline import STAGES

    users = [stage.name for stage in STAGES if option in stage.options]
    shared = f" Stages: {', '.join(users)}." if len(users) > 1 else ""
    kind = {"type": _type(option.kind, option.type), "is_flag": option.type == "flag", "default": None}
    return click.Option([flag, _parameter_name(flag)], help=f"{option.help}{shared}", **kind)


def _parameter_name(flag: str) -> str:
    return _PREFIX + flag.removeprefix("--").replace("-", "_")


def _type(kind: str, value: str) -> Any:
    if kind != "parameter":
        return click.Path(path_type=Path)
    return {"float": float, "int": int, "str": str, "flag": bool}[value]


@click.command(cls=ProcessCommand)
@click.argument("session", type=click.Path(path_type=Path), required=False)
@click.option(
    "--panorama",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Instead of SESSION: one panorama (JPEG, PNG, EXR, HDR; equirectangular). Without a meter, in relative units.",
)
@click.option(
    "--into",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="With --panorama: where its session is made (default: sessions).",
)
@click.option("--until", metavar="STAGE", help="Run this stage and what it needs, no more.")
@click.option("--force", metavar="STAGE", multiple=True, help="Run this stage though nothing has changed (repeatable).")
@click.option("--recheck", is_flag=True, help="Read every file again instead of trusting size and times.")
@click.option("--dry-run", is_flag=True, help="Say what would run and why; change nothing.")
@click.option("--explain", is_flag=True, help="Say of every stage which input or parameter changed, old and new.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object at the end.")
def process(session: Path | None, *, explain: bool, as_json: bool, **asked: Any) -> int:
    """Process SESSION: check, merge, calibrate ...: each stage only if something it depends on has changed.

    Results are in SESSION/stages, one folder a stage. A run that is killed leaves the old result or the new one; the
    next run goes on from there. Options are not remembered: give them again, or the stage runs without them.

    \b
    Examples:
      daylit process sessions/2023-05-19T1554Z_coda-320
      daylit process --until merge --max-error 0.02 --explain sessions/2023-05-19T1554Z_coda-320
      daylit process --panorama bedroom.jpg
    """
    from processing.commands.process_views import SilentView, plain_or_terminal, summary_lines
    from processing.running.runner import process as run

    request = run_request(asked)
    if request.dry_run and asked["panorama"] is not None and session is None:
        session = _would_make(asked["panorama"], asked["into"] or Path("sessions"), as_json=as_json)
        if session is None:
            return 0
    else:
        session = _session(session, asked["panorama"], asked["into"])
    with SilentView() if as_json else plain_or_terminal(sys.stdout.isatty()) as view:
        report = run(session, request, on_event=view.show)
    if as_json:
        click.echo(json.dumps({"ok": True, "dry_run": request.dry_run, **report.to_dict()}))
        return 0
    for line in summary_lines(report, request, explain=explain):
        click.echo(line)
    page = session / "stages" / "report" / "index.html"
    if page.is_file() and not request.dry_run:
        click.echo(f"report: {page}")
    return 0


def _would_make(panorama: Path, into: Path, *, as_json: bool) -> Path | None:
    """Return the session that is there of a panorama; else check the picture, say what would be made, return None."""
    from processing.pictures.panorama import read_panorama
    from processing.running.panorama_session import existing_session

    found = existing_session(panorama, into)
    if found is not None:
        return found
    units = read_panorama(panorama).image.unit
    if as_json:
        click.echo(json.dumps({"ok": True, "dry_run": True, "session": None, "units": units, "stages": []}))
    else:
        click.echo(f"would make a session of {panorama.name} in {into}, in {units}, and run every stage on it")
    return None


def _session(session: Path | None, panorama: Path | None, into: Path | None) -> Path:
    """Return the session that is named, or that of the panorama."""
    from station.errors import UsageError

    if (session is None) == (panorama is None):
        raise UsageError("give a session, or --panorama FILE", where="daylit process", advice="one of them, not both")
    if panorama is None:
        if into is not None:
            raise UsageError("--into goes with --panorama", where="daylit process", advice="leave it out")
        assert session is not None
        return session
    from processing.running.panorama_session import panorama_session

    return panorama_session(panorama, into or Path("sessions"))


def run_request(asked: dict[str, Any]) -> RunRequest:
    """Return what is asked, without what is not."""
    from processing.pipeline import options
    from processing.running.requests import RunRequest
    from processing.stages.contract import Quality

    values = {flag: asked[_parameter_name(flag)] for flag in options()}
    return RunRequest(
        until=asked["until"],
        force=asked["force"],
        dry_run=asked["dry_run"],
        recheck=asked["recheck"],
        quality=Quality(asked.get("quality") or "standard"),
        max_error=asked.get("max_error"),
        time_budget_s=asked.get("time_budget"),
        options={flag: value for flag, value in values.items() if value is not None},
    )
