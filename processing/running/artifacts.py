"""What stages hand on: in memory within a run, in files between runs; and the results made of it.

Either way a stage sees the same: pictures are rounded before they are handed on, then written without loss, masks are
bits in a PNG, JSON is handed on as it reads back, as the model that the artifact's row names. What the user gives
instead is checked as strictly.
"""

import copy
import dataclasses
import json
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from processing.errors import ProcessingError
from processing.ground.finished import digest
from processing.ground.room_model import read_json
from processing.ground.threads import Later, at_once, give_back, side_by_side
from processing.pipeline import Artifact, Stage, resolve
from processing.running.fingerprint import DigestMemory, Ingredients
from processing.running.progress import Cost
from processing.running.reads import Parts, Reads
from processing.running.result_store import Building
from processing.running.results import FileRecord, RunRecord, StageResult
from processing.stages.contract import StageContext, StageOutput, StageWarning
from station.session import durable, strict_json

MAX_JSON_BYTES = 64 << 20
WRITTEN = True  # instead of an artifact's value: the stage has written the file
_SUFFIX = {"picture": ".exr", "mask": ".png", "json": ".json"}
_READERS = {"picture": "processing.pictures.exr:read_exr", "mask": "processing.pictures.preview:read_mask"}
_WRITE_PICTURE = "processing.pictures.exr:write_stage_exr"
_WRITE_MASK = "processing.pictures.preview:write_mask"
HELD_BYTES = 800 << 20
"""Of pictures in memory between stages, the room's and the sky's; those unused longest are let go, and read again where
they are wanted."""
GIVEN = "given by the user"
Write = Callable[[], None]


def file_name(artifact: Artifact) -> str:
    """Return the name of an artifact's file in the stage's folder."""
    return artifact.file_name or artifact.name + _SUFFIX[artifact.kind]


def save(artifact: Artifact, value: object, folder: Path, later: Later = at_once) -> object:
    """Write an artifact into ``folder``, a picture ``later``, and return what later stages are handed.

    A picture may be `WRITTEN` by the stage itself, so that large ones need not be in memory together. Raises
    `ProcessingError` for a "file" that the stage has not written, and what the writers raise.
    """
    path = folder / file_name(artifact)
    if artifact.kind == "picture" and value is not WRITTEN:
        handed_on: object = resolve(_WRITE_PICTURE)(path, value, own=True, later=later)
        return handed_on
    if artifact.kind == "mask":
        resolve(_WRITE_MASK)(path, value)
        return value
    if artifact.kind == "json":
        plain = value.model_dump(mode="json") if isinstance(value, BaseModel) else value
        path.write_bytes((json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode("utf-8"))
        return load(artifact, path)
    if not path.is_file():
        raise ProcessingError(f"the stage has not written {path.name}", where=folder.name)
    return path


def load(artifact: Artifact, path: Path) -> object:
    """Read an artifact; raises `PictureFileError` or `ProcessingError` naming the file."""
    if artifact.kind in _READERS:
        return resolve(_READERS[artifact.kind])(path)
    if artifact.kind == "json":
        value = read_json(path, ProcessingError, MAX_JSON_BYTES)
        return _typed(artifact, value, path) if artifact.model else value
    return path


def _typed(artifact: Artifact, value: object, path: Path) -> BaseModel:
    """Return a JSON value as the model that its artifact names; `ProcessingError` says where it does not fit."""
    model: type[BaseModel] = resolve(artifact.model)
    try:
        return model.model_validate_json(json.dumps(value), strict=True)
    except ValidationError as exc:
        text = f"not a valid {artifact.name}: {strict_json.faults_of(exc)[0]}"
        raise ProcessingError(text, where=str(path), advice="correct the file") from exc


def _read_only(value: object, read_only: bool = True) -> object:
    """Return a picture or mask whose arrays refuse writing: what one stage was handed, the next one gets unchanged."""
    for part in vars(value).values() if dataclasses.is_dataclass(value) else (value,):
        set_flags = getattr(part, "setflags", None)
        if set_flags:
            set_flags(write=not read_only)
    return value


def _bytes(value: object) -> int:
    """Return what a picture's arrays take; 0 for anything else."""
    parts = vars(value).values() if dataclasses.is_dataclass(value) else ()
    return sum(getattr(part, "nbytes", 0) for part in parts)


class Shelf:
    """Artifacts in memory, by stage and name; what is not there is read from disk, and kept while there is room."""

    def __init__(
        self, read: Callable[[str, str], object | None], large: Callable[[str, str], bool] = lambda *_: True
    ) -> None:
        """``read(stage, artifact)``: from disk; None where the stage left it out; ``large``: whether that is a picture,
        for which room is made before it is read."""
        self._read, self._large = read, large
        self._held: dict[tuple[str, str], object] = {}
        self._made: set[tuple[str, str]] = set()

    def put(self, stage: str, name: str, value: object) -> None:
        """Hand on what was just made."""
        self._held[stage, name] = _read_only(value)
        self._made.add((stage, name))
        self._make_room()

    def _make_room(self, more: int = 0) -> None:
        """``more``: pictures as large as the largest that are to be read."""
        sizes = {key: _bytes(value) for key, value in self._held.items()}
        pictures = [key for key, size in sizes.items() if size]
        room = HELD_BYTES - more * max(sizes.values(), default=0)
        while len(pictures) + more > 1 and pictures and sum(sizes[key] for key in pictures) > room:
            del self._held[pictures.pop(0)]

    def let_go(self, *stages: str) -> None:
        """Hold nothing (of ``stages``, if any are named) any more: what is wanted again is read again.

        What was read belongs to who has it now; what was made may still be being written.
        """
        for key in [key for key in self._held if not stages or key[0] in stages]:
            value = self._held.pop(key)
            _read_only(value, key in self._made or not _bytes(value))
        give_back()

    def get(self, stage: str, name: str) -> object | None:
        """Return an artifact; None where the stage left it out."""
        key = (stage, name)
        if key not in self._held:
            self._make_room(more=int(self._large(stage, name)))
            value = self._read(stage, name)
            if value is None:
                return None
            self._held[key] = _read_only(value)
            self._made.discard(key)
            self._make_room()
        held = self._held[key] = self._held.pop(key)
        return copy.deepcopy(held) if isinstance(held, dict | list) else held

    def drop_unneeded(self, later: tuple[Stage, ...]) -> None:
        """Let go of what none of the ``later`` stages needs."""
        needed = {name for stage in later for name in stage.needs}
        self._held = {key: value for key, value in self._held.items() if key[0] in needed}

    @property
    def held(self) -> tuple[str, ...]:
        """Names of what is in memory, as stage/artifact."""
        return tuple(sorted("/".join(key) for key in self._held))


@dataclass(frozen=True)
class Made:
    """A result without the records of its files, and its artifacts in memory."""

    result: StageResult
    in_memory: Mapping[str, object] = field(default_factory=dict)
    unfinished: bool = False
    pictures: tuple[Write, ...] = ()
    """What writes them, whoever has time: later stages can work with those in memory."""

    def whole(self, work: "Work") -> StageResult:
        """Return the result when all its files are in its folder and durable; raises what the writers raise."""
        side_by_side(at_once, self.pictures, 2)
        return self.result.model_copy(update={"files": work.records(self.result)})

    def run_record(self, cost: Cost, megapixels: float) -> RunRecord:
        """Return what run.json says."""
        spent = {name: round(value, 3) for name, value in dataclasses.asdict(cost).items()}
        return RunRecord(**spent, megapixels=round(megapixels, 3))


@dataclass(frozen=True)
class Work:
    """What a result is made with."""

    static: Ingredients
    """All that it depends on, but what the stage reads."""
    reads: Reads
    parts: Parts
    building: Building
    memory: DigestMemory

    def records(self, made: StageResult) -> dict[str, FileRecord]:
        """Return the records of the files, which are then durable; those taken over are known."""
        names = sorted(set(made.artifacts.values()) - set(self.parts.kept))
        return dict(sorted((self.building.sync_files(names, self.memory) | self.parts.kept).items()))


def make_result(stage: Stage, context: StageContext, work: Work) -> Made:
    """Run a stage's skip rule and function, and write what it made.

    Raises `ProcessingError` where the stage breaks its own row: an artifact neither made nor left out with a reason.
    """
    reason = resolve(stage.skip_rule)(context) if stage.skip_rule else None
    if reason:
        return Made(_result(stage, work, skipped=reason))
    output: StageOutput = resolve(stage.function)(context)
    known = {artifact.name: artifact for artifact in stage.makes}
    extra = set(output.artifacts) - set(known)
    if extra:
        raise ProcessingError(f"made {sorted(extra)}, which the pipeline table does not name", where=stage.name)
    for name, artifact in known.items():
        if output.artifacts.get(name) is None and not (artifact.optional and name in output.left_out):
            raise ProcessingError(f"has neither made {name} nor said why not", where=stage.name)
    made = [artifact for artifact in stage.makes if output.artifacts.get(artifact.name) is not None]
    give_back()  # a gigabyte of what the stage worked with
    said = {name: dict(getattr(output, name)) for name in ("left_out", "metrics", "honoured")}
    facts = {**said, "parts": work.parts.records, "warnings": output.warnings}
    return replace(_made(stage, work, made, output.artifacts, facts), unfinished=output.unfinished)


def answer_result(stage: Stage, answers: Mapping[str, Path], context: StageContext, work: Work) -> Made:
    """Put what the user gave in the place of what the stage would have made, checked as strictly."""
    made = [artifact for artifact in stage.makes if artifact.name in answers]
    warnings: list[StageWarning] = []
    values = {artifact.name: _answer(artifact, answers[artifact.name], context, warnings) for artifact in made}
    given = tuple(artifact.name for artifact in made)
    left_out = {a.name: GIVEN + ": " + ", ".join(answers) for a in stage.makes if a.name not in answers}
    return _made(stage, work, made, values, {"given": given, "left_out": left_out, "warnings": tuple(warnings)})


def _answer(artifact: Artifact, path: Path, context: StageContext, warnings: list[StageWarning]) -> object:
    if artifact.kind == "file":
        value: object = context.folder / file_name(artifact)
        shutil.copyfile(path, context.folder / file_name(artifact))
    else:
        value = load(artifact, path)
    if artifact.fits:
        warnings += resolve(artifact.fits)(value, context) or ()
    return value


def _made(
    stage: Stage, work: Work, made: list[Artifact], values: Mapping[str, object], facts: Mapping[str, object]
) -> Made:
    """Write artifacts but pictures, two at a time; files do not stay in memory, as their folder is still to move."""
    folder, pictures = work.building.folder.path, list[Write]()

    def durably(path: Path, write: Callable[[], object]) -> Any:
        with durable.disk_errors(path, "writing"):
            return write()

    def written(artifact: Artifact) -> object:
        path, value = folder / file_name(artifact), values[artifact.name]

        def later(write: Write) -> None:
            pictures.append(partial(durably, path, write))

        return durably(path, partial(save, artifact, value, folder, later))

    saved = zip(made, side_by_side(written, made, 2), strict=True)
    in_memory = {one.name: value for one, value in saved if one.kind != "file" and values[one.name] is not WRITTEN}
    files = {artifact.name: file_name(artifact) for artifact in made}
    return Made(_result(stage, work, artifacts=files, **facts), in_memory, pictures=tuple(pictures))


def remade(result: StageResult, work: Work) -> StageResult:
    """Return a result as one of what it now depends on."""
    ingredients = work.static | work.reads.ingredients()
    return result.model_copy(update={"ingredients": ingredients, "fingerprint": digest(ingredients)})


def _result(stage: Stage, work: Work, **fields: object) -> StageResult:
    ingredients = work.static | work.reads.ingredients()
    data = {"stage": stage.name, "version": stage.version, "ingredients": ingredients, **fields}
    return StageResult.model_validate({**data, "fingerprint": digest(ingredients)})
