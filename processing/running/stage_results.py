"""From what a stage gives back, or what the user gives instead, to a result in its folder."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from processing.errors import ProcessingError
from processing.pipeline import Artifact, Stage, resolve
from processing.running.artifacts import WRITTEN, file_name, load, save
from processing.running.fingerprint import DigestMemory, Ingredients, digest
from processing.running.progress import Cost
from processing.running.result_store import Building
from processing.running.results import RunRecord, StageResult
from processing.stages.contract import StageContext, StageOutput, StageWarning
from station.session import durable

GIVEN = "given by the user"


@dataclass(frozen=True)
class Made:
    """A result whose files are in its folder and durable, and its artifacts in memory."""

    result: StageResult
    in_memory: Mapping[str, object] = field(default_factory=dict)

    def run_record(self, cost: Cost, megapixels: float) -> RunRecord:
        """Return what run.json says."""
        return RunRecord(
            seconds=round(cost.seconds, 3),
            cpu_seconds=round(cost.cpu_seconds, 3),
            peak_bytes=cost.peak_bytes,
            megapixels=round(megapixels, 3),
        )


def make_result(
    stage: Stage, context: StageContext, ingredients: Ingredients, building: Building, memory: DigestMemory
) -> Made:
    """Run a stage's skip rule and function, and write what it made.

    Raises `ProcessingError` where the stage breaks its own row: an artifact neither made nor left out with a reason.
    """
    reason = resolve(stage.skip_rule)(context) if stage.skip_rule else None
    if reason:
        return Made(_result(stage, ingredients, skipped=reason))
    output: StageOutput = resolve(stage.function)(context)
    _check_output(stage, output)
    made = [artifact for artifact in stage.makes if output.artifacts.get(artifact.name) is not None]
    in_memory = _write(made, output.artifacts, building, context.folder)
    result = _result(
        stage,
        ingredients,
        artifacts={artifact.name: file_name(artifact) for artifact in made},
        files=building.sync_files(sorted(map(file_name, made)), memory),
        left_out=dict(output.left_out),
        metrics=dict(output.metrics),
        warnings=output.warnings,
        honoured=dict(output.honoured),
    )
    return Made(result, in_memory)


def answer_result(
    stage: Stage,
    answers: Mapping[str, Path],
    context: StageContext,
    ingredients: Ingredients,
    building: Building,
    memory: DigestMemory,
) -> Made:
    """Put what the user gave in the place of what the stage would have made, checked as strictly."""
    made = [artifact for artifact in stage.makes if artifact.name in answers]
    warnings: list[StageWarning] = []
    values = {artifact.name: _answer(artifact, answers[artifact.name], context, warnings) for artifact in made}
    in_memory = _write(made, values, building, context.folder)
    result = _result(
        stage,
        ingredients,
        given=tuple(artifact.name for artifact in made),
        artifacts={artifact.name: file_name(artifact) for artifact in made},
        files=building.sync_files(sorted(map(file_name, made)), memory),
        left_out={a.name: GIVEN + ": " + ", ".join(answers) for a in stage.makes if a.name not in answers},
        warnings=tuple(warnings),
    )
    return Made(result, in_memory)


def _answer(artifact: Artifact, path: Path, context: StageContext, warnings: list[StageWarning]) -> object:
    if artifact.kind == "file":
        value: object = context.folder / file_name(artifact)
        shutil.copyfile(path, context.folder / file_name(artifact))
    else:
        value = load(artifact, path)
    if artifact.fits:
        warnings += resolve(artifact.fits)(value, context) or ()
    return value


def _check_output(stage: Stage, output: StageOutput) -> None:
    known = {artifact.name: artifact for artifact in stage.makes}
    extra = set(output.artifacts) - set(known)
    if extra:
        raise ProcessingError(f"made {sorted(extra)}, which its row does not name", where=stage.name)
    for name, artifact in known.items():
        if output.artifacts.get(name) is None and not (artifact.optional and name in output.left_out):
            raise ProcessingError(f"has neither made {name} nor said why not", where=stage.name)


def _write(made: list[Artifact], values: Mapping[str, object], building: Building, folder: Path) -> dict[str, object]:
    """Write artifacts; a file's place in memory is taken by its path, which changes, so it is read from disk later."""
    in_memory = {}
    for artifact in made:
        with durable.disk_errors(building.folder.path / file_name(artifact), "writing"):
            value = save(artifact, values[artifact.name], folder)
        if artifact.kind != "file" and values[artifact.name] is not WRITTEN:
            in_memory[artifact.name] = value
    return in_memory


def _result(stage: Stage, ingredients: Ingredients, **fields: object) -> StageResult:
    data = {"stage": stage.name, "version": stage.version, "ingredients": ingredients, **fields}
    return StageResult.model_validate({**data, "fingerprint": digest(ingredients)})
