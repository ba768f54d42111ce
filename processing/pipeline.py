"""The table of stages, ``pipeline.toml``: what is done with a session, in which order, and from what.

Adding a stage is adding a row there, a class in `processing.stages.parameters` and a module in `processing.stages`
(docs/reference/pipeline.md shows one). Functions and models are named as "module:name" and imported only when they are
used, so that this table costs nothing. The options of the command line follow from a stage's parameters.
Whatever can change a stage's result is in its row: the runner makes the fingerprint of it, and lets the stage see no
more of the session than that.
"""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from processing.errors import ParameterError

if TYPE_CHECKING:
    from processing.stages.parameters import Option, StageParameters

ArtifactKind = Literal["picture", "mask", "json", "file"]
Trade = Literal["quality", "max_error", "time_budget"]


@dataclass(frozen=True)
class Artifact:
    """One thing that a stage makes: a picture (EXR), a mask (bool (H, W), PNG), JSON, or a file of its own."""

    name: str
    kind: ArtifactKind
    optional: bool = False
    """Whether the stage may leave it out, saying why."""
    file_name: str = ""
    """Of kind "file"; the others are NAME.exr, NAME.png and NAME.json."""
    model: str = ""
    """Of kind "json": "module:name" of the pydantic model that stages exchange; none: they exchange plain values."""
    fits: str = ""
    """Of what users may give: "module:function" that takes the value and the stage's context and raises a typed error
    where it does not fit what earlier stages made; may return warnings."""


@dataclass(frozen=True)
class Stage:
    """A row of the table."""

    name: str
    version: int
    """Raised whenever the same inputs give another result."""
    title: str
    function: str
    """``run(context: StageContext) -> StageOutput``."""
    needs: tuple[str, ...] = ()
    """Earlier stages whose artifacts it reads."""
    data: tuple[str, ...] = ()
    """Files of the program (within `processing/`) that its result depends on: the shipped network."""
    reads: tuple[str, ...] = ()
    """Fields of the session's manifest that it may see, and "folder": the session's files as they are on disk.
    "relight": what `daylit relight` made of it."""
    makes: tuple[Artifact, ...] = ()
    parameters: str = "processing.stages.parameters:StageParameters"
    skip_rule: str = ""
    """``reason(context) -> str | None``: why there is nothing to do."""
    trades: tuple[Trade, ...] = ()
    """Which of --quality, --max-error and --time-budget change what it does."""
    draft_is_standard: bool = False
    """Whether --quality draft leaves it as it is: what a draft must share with the standard (measure, room)."""

    @property
    def model(self) -> type[StageParameters]:
        """Return the class of its parameters."""
        found: type[StageParameters] = resolve(self.parameters)
        return found

    @property
    def options(self) -> dict[str, Option]:
        """Return its command line options by flag, as its parameters say."""
        from processing.stages.parameters import options_of

        return {option.flag: option for option in options_of(self.model)}


def _artifacts(row: dict[str, Any]) -> Iterator[Artifact]:
    """Yield the artifact of a row, or the ``count`` ones that it stands for."""
    numbered = row.pop("count", 0)
    for number in range(1, numbered + 1) if numbered else ("",):
        fields: dict[str, Any] = {key: v.format(number) if isinstance(v, str) else v for key, v in row.items()}
        yield Artifact(**fields)


def _stage(row: dict[str, Any]) -> Stage:
    makes = tuple(artifact for one in row.pop("makes", ()) for artifact in _artifacts(one))
    fields: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in row.items()}
    return Stage(**fields, makes=makes)


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
STAGES: tuple[Stage, ...] = tuple(map(_stage, _TABLE["stage"]))


def resolve(reference: str) -> Any:
    """Import what "module:name" names."""
    module, _, name = reference.partition(":")
    return getattr(importlib.import_module(module), name)


def check_table(stages: tuple[Stage, ...]) -> None:
    """Raise `ValueError` unless names are unique, each stage needs only earlier ones, options name what is."""
    seen: set[str] = set()
    for stage in stages:
        if stage.name in seen:
            raise ValueError(f"two stages are called {stage.name}")
        unknown = set(stage.needs) - seen
        if unknown:
            raise ValueError(f"{stage.name} needs {sorted(unknown)}, which no earlier stage is")
        makes = {artifact.name for artifact in stage.makes}
        answers = {option.artifact for option in stage.options.values() if option.kind == "answer"}
        if answers - makes:
            raise ValueError(f"{stage.name} does not make {sorted(answers - makes)}")
        seen.add(stage.name)
    flags = options(stages)
    for flag, option in flags.items():
        strange = {*option.excludes, *option.beside} - set(flags)
        if strange:
            raise ValueError(f"{flag} excludes or asks for {sorted(strange)}, which no stage has")


def stage_named(name: str, stages: tuple[Stage, ...] = STAGES) -> Stage:
    """Return a row; `ParameterError` lists the names there are."""
    for stage in stages:
        if stage.name == name:
            return stage
    raise ParameterError(f"no such stage: {name!r}", advice=f"one of {', '.join(one.name for one in stages)}")


def selected(until: str | None, stages: tuple[Stage, ...] = STAGES) -> tuple[Stage, ...]:
    """Return the stages of a run in order: all, or ``until`` and what it needs."""
    if until is None:
        return stages
    wanted = {stage_named(until, stages).name}
    for stage in reversed(stages):
        if stage.name in wanted:
            wanted |= set(stage.needs)
    return tuple(stage for stage in stages if stage.name in wanted)


def options(stages: tuple[Stage, ...] = STAGES) -> dict[str, Option]:
    """Return each option of the stages by its flag (stages may share one)."""
    return {flag: option for stage in stages for flag, option in stage.options.items()}


def trades(stages: tuple[Stage, ...] = STAGES) -> frozenset[Trade]:
    """Return what any of the stages can trade."""
    return frozenset(trade for stage in stages for trade in stage.trades)
