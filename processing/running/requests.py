"""What a user asks of a run, checked against the table: nothing that is asked may do nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ValidationError

from processing.errors import ParameterError
from processing.pipeline import Stage, Trade, options, selected, stage_named
from processing.stages.contract import Quality
from processing.stages.parameters import Option, OptionKind, StageParameters


@dataclass(frozen=True)
class RunRequest:
    """One call of `daylit process`."""

    until: str | None = None
    force: tuple[str, ...] = ()
    dry_run: bool = False
    recheck: bool = False
    """Read every file again instead of trusting size and times."""
    first_picture: bool = False
    """Somebody waits: of a stage whose result has parts the first goes through all later stages before the rest."""
    quality: Quality = Quality.STANDARD
    max_error: float | None = None
    time_budget_s: float | None = None
    options: Mapping[str, object] = field(default_factory=dict)
    """Values of the stages' own options, by flag."""


def planned(request: RunRequest, stages: tuple[Stage, ...]) -> tuple[Stage, ...]:
    """Return the stages of the run; `ParameterError` for whatever is asked and cannot be had of them."""
    plan = selected(request.until, stages)
    reached = {stage.name for stage in plan}
    for name in request.force:
        stage_named(name, stages)
        if name not in reached:
            raise ParameterError(f"--force {name}: this run ends before that stage", advice="leave out --until")
    own = options(plan)
    for flag in request.options:
        if flag not in own:
            known = ", ".join(sorted(own)) or "none"
            raise ParameterError(f"{flag} belongs to no stage of this run", advice=f"options of this run: {known}")
    _check_together(request, own)
    _check_range("--max-error", request.max_error, 1e-6, 1.0)
    _check_range("--time-budget", request.time_budget_s, 0.1, 1e6)
    asked: dict[Trade, object] = {"max_error": request.max_error, "time_budget": request.time_budget_s}
    for trade, value in asked.items():
        if value is not None and not any(trade in stage.trades for stage in plan):
            raise ParameterError(f"--{trade.replace('_', '-')}: no stage of this run can trade it")
    for stage in plan:
        parameters(stage, request)
        given_files(stage, request)
        given_answers(stage, request)
    return plan


def _check_together(request: RunRequest, own: Mapping[str, Option]) -> None:
    """Refuse options that would do nothing: idle beside another (what --mask answers, no --segmenter can), or alone."""
    for flag in request.options:
        missing = [other for other in own[flag].beside if other not in request.options]
        if missing:
            raise ParameterError(
                f"{flag}: of no effect without {', '.join(missing)}", advice=f"give {', '.join(missing)} too"
            )
        idle = [other for other in own[flag].excludes if other in request.options]
        if idle:
            raise ParameterError(
                f"{', '.join(idle)}: of no effect beside {flag}",
                likely=f"{flag} gives what {', '.join(idle)} would help to find",
                advice=f"leave out {flag} or {', '.join(idle)}",
            )


def _check_range(flag: str, value: float | None, low: float, high: float) -> None:
    if value is not None and not low <= value <= high:
        raise ParameterError(f"{flag} {value:g} is out of range", advice=f"{low:g} to {high:g}")


def parameters(stage: Stage, request: RunRequest) -> StageParameters:
    """Return the parameters of a stage; `ParameterError` names the option and what is wrong with its value."""
    flags = {option.name: flag for flag, option in stage.options.items() if flag in request.options}
    try:
        return stage.model.model_validate({name: request.options[flag] for name, flag in flags.items()})
    except ValidationError as exc:
        first = exc.errors(include_url=False, include_context=False)[0]
        name = str(first["loc"][0]) if first["loc"] else ""
        raise ParameterError(f"{flags.get(name, name)}: {first['msg']}", where=stage.name) from exc


def given_files(stage: Stage, request: RunRequest) -> dict[str, Path]:
    """Return the files and folders given to a stage by option name; `ParameterError` where one is none."""
    files = {option.name: _file(option.flag, value) for option, value in _given(stage, request, "file")}
    for option in stage.options.values():
        if option.installed:
            files |= _installed(option, request)
    folders = {option.name: _folder(option.flag, value) for option, value in _given(stage, request, "folder")}
    return files | folders


def _installed(option: Option, request: RunRequest) -> dict[str, Path]:
    """Return the model's file that counts for a stage, asked for or not; none where only our own network counts."""
    from processing.segmentation.installed import segmenter_file

    asked = request.options.get(option.flag)
    found = segmenter_file(None if asked is None else Path(str(asked)))
    return {} if found is None else {option.name: _file(option.flag, found)}


def given_answers(stage: Stage, request: RunRequest) -> dict[str, Path]:
    """Return the files that take the place of artifacts of a stage."""
    answers = {option.artifact: _file(option.flag, value) for option, value in _given(stage, request, "answer")}
    missing = [a.name for a in stage.makes if not a.optional and a.name not in answers]
    if answers and missing:
        raise ParameterError(f"{stage.name}: give {', '.join(missing)} too", where=stage.name)
    return answers


def quality_of(stage: Stage, request: RunRequest) -> Quality:
    """Return the quality that a stage works at."""
    spared = stage.draft_is_standard and request.quality is Quality.DRAFT
    return Quality.STANDARD if spared or "quality" not in stage.trades else request.quality


def trade_values(stage: Stage, request: RunRequest) -> dict[Trade, object]:
    """Return what of quality, max_error and time_budget counts for a stage."""
    every: dict[Trade, object] = {
        "quality": quality_of(stage, request).value,
        "max_error": request.max_error,
        "time_budget": request.time_budget_s,
    }
    return {trade: every[trade] for trade in stage.trades}


def _given(stage: Stage, request: RunRequest, kind: OptionKind) -> list[tuple[Option, object]]:
    """Return the options of a kind that the request sets, with their values."""
    values = request.options
    own = stage.options.items()
    return [(o, values[flag]) for flag, o in own if o.kind == kind and flag in values and not o.installed]


def _file(flag: str, value: object) -> Path:
    path = Path(str(value))
    if not path.is_file():
        raise ParameterError(f"{flag}: there is no file {path.name}", where=str(path))
    return path


def _folder(flag: str, value: object) -> Path:
    path = Path(str(value))
    if not path.is_dir():
        raise ParameterError(f"{flag}: there is no folder {path.name}", where=str(path))
    return path
