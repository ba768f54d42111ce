"""A table of toy stages: quick, exact, and counting how often each has run."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from processing.errors import ProcessingError
from processing.pipeline import Artifact, Stage
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import StageParameters, path_field

calls: list[str] = []
"""Names of the stages whose function ran, in order; tests empty it."""


class DigestParameters(StageParameters):
    rounds: Annotated[int, Field(description="Rounds")] = 3
    grain: Annotated[int, Field(description="Grain")] = 1


class SumParameters(StageParameters):
    scale: Annotated[float, Field(description="Scale")] = 1.0
    factor: Annotated[Path | None, path_field("file", "A number in a file.")] = None
    total: Annotated[
        Path | None,
        path_field("answer", "The total itself.", artifact="total", excludes=["--scale", "--factor"]),
    ] = None


class Total(BaseModel):
    """What the stage total makes."""

    model_config = ConfigDict(frozen=True)

    total: float


def frames(context: StageContext) -> StageOutput:
    """One number a frame, coarse enough that a small change of ``rounds`` may give the same."""
    calls.append("frames")
    parameters = context.parameters
    assert isinstance(parameters, DigestParameters)
    values = {}
    for done, frame in enumerate(context.session.frames, 1):
        data = (context.session_path / frame.file).read_bytes()
        for _ in range(parameters.rounds):
            data = hashlib.sha256(data).digest()
        values[frame.file] = data[0] // parameters.grain
        context.progress(done / len(context.session.frames), frame.file)
    (context.folder / "notes.txt").write_text(" ".join(map(str, values.values())))
    return StageOutput(
        artifacts={"values": values, "notes": True},
        metrics={"frames": len(values)},
        warnings=(StageWarning(code="toy", message="a toy"),),
        honoured={"quality": context.quality.value},
    )


def total(context: StageContext) -> StageOutput:
    calls.append("total")
    parameters = context.parameters
    assert isinstance(parameters, SumParameters)
    values = context.artifact("frames", "values")
    factor = 1.0 if parameters.factor is None else float(parameters.factor.read_text())
    return StageOutput(
        artifacts={"total": Total(total=parameters.scale * factor * sum(values.values()))},
        left_out={"extra": "nobody asked"},
    )


def nothing_to_halve(context: StageContext) -> str | None:
    return "the total is zero" if context.artifact("total", "total").total == 0 else None


def half(context: StageContext) -> StageOutput:
    calls.append("half")
    return StageOutput(artifacts={"half": context.artifact("total", "total").total / 2})


def fit_total(value: Total, context: StageContext) -> None:
    if value.total > 256 * len(context.artifact("frames", "values")):
        raise ProcessingError("more than the frames can give", where="total")


def broken(_context: StageContext) -> StageOutput:
    raise ProcessingError("cannot", where="broken")


FRAMES = Stage(
    name="frames",
    version=1,
    title="a number a frame",
    function="tests.processing.running.toy_stages:frames",
    reads=("frames",),
    makes=(Artifact("values", "json"), Artifact("notes", "file", file_name="notes.txt")),
    parameters="tests.processing.running.toy_stages:DigestParameters",
    trades=("quality",),
)
TOTAL = Stage(
    name="total",
    version=1,
    title="their sum",
    function="tests.processing.running.toy_stages:total",
    needs=("frames",),
    makes=(
        Artifact(
            "total",
            "json",
            model="tests.processing.running.toy_stages:Total",
            fits="tests.processing.running.toy_stages:fit_total",
        ),
        Artifact("extra", "json", optional=True),
    ),
    parameters="tests.processing.running.toy_stages:SumParameters",
)
HALF = Stage(
    name="half",
    version=1,
    title="half of it",
    function="tests.processing.running.toy_stages:half",
    needs=("total",),
    makes=(Artifact("half", "json", optional=True),),
    skip_rule="tests.processing.running.toy_stages:nothing_to_halve",
    trades=("max_error", "time_budget"),
)
TOYS = (FRAMES, TOTAL, HALF)
BROKEN_LAST = (FRAMES, TOTAL, replace(HALF, function="tests.processing.running.toy_stages:broken"))


def contents(session: Path) -> dict[str, bytes]:
    """Every file of the results but run.json and the digest memory."""
    folder = session / "stages"
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name not in ("run.json", ".digests.json")]
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}
