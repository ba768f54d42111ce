"""What a user asks of a run, checked against the table (nothing that is asked may do nothing), and a stage's inputs."""

import hashlib
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from processing.errors import ParameterError
from processing.ground.finished import digest
from processing.pipeline import Stage, Trade, options, resolve, selected, stage_named
from processing.running import fingerprint
from processing.running.artifacts import load
from processing.running.fingerprint import DigestMemory, Ingredients
from processing.running.result_store import Stored
from processing.running.results import Change, StageResult
from processing.stages.contract import Quality
from processing.stages.parameters import Option, OptionKind, StageParameters
from station.errors import IntegrityError
from station.session.folder import Folder, file_sha256
from station.session.session import JOURNAL_NAME, MANIFEST_NAME, SessionManifest, Side


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
            raise ParameterError(f"--force {name}: this run stops before that stage", advice="leave out --until")
    own = options(plan)
    for flag in request.options:
        if flag not in own:
            known = ", ".join(sorted(own)) or "none"
            raise ParameterError(f"{flag} does not apply to any stage of this run", advice=f"options: {known}")
    _check_together(request, own)
    _check_range("--max-error", request.max_error, 1e-6, 1.0)
    _check_range("--time-budget", request.time_budget_s, 0.1, 1e6)
    asked: dict[Trade, object] = {"max_error": request.max_error, "time_budget": request.time_budget_s}
    for trade, value in asked.items():
        if value is not None and not any(trade in stage.trades for stage in plan):
            raise ParameterError(f"--{trade.replace('_', '-')}: no stage of this run supports it")
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
            raise ParameterError(f"{flag}: no effect without {', '.join(missing)}", advice="give that as well")
        idle = [other for other in own[flag].excludes if other in request.options]
        if idle:
            likely = f"{flag} makes {', '.join(idle)} pointless"
            advice = f"leave out {flag} or {', '.join(idle)}"
            raise ParameterError(f"{', '.join(idle)}: no effect with {flag}", likely=likely, advice=advice)


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
        name, text = str(first["loc"][0]) if first["loc"] else "", first["msg"].removeprefix("Value error, ")
        if first["type"] == "string_pattern_mismatch":
            text = f"{first['input']!r} is not of its form: {stage.model.model_fields[name].description}"
        raise ParameterError(": ".join(filter(None, (flags.get(name, name), text))), where=stage.name) from exc


def given_files(stage: Stage, request: RunRequest) -> dict[str, Path]:
    """Return the files and folders given to a stage by option name; `ParameterError` where one is none."""
    files = {option.name: _there(option.flag, value) for option, value in _given(stage, request, "file")}
    for option in stage.options.values():
        if option.installed:
            # The model's file that counts for a stage, asked for or not; none where only our own network counts
            from processing.segmentation.installed import segmenter_file

            asked = request.options.get(option.flag)
            found = segmenter_file(None if asked is None else Path(str(asked)))
            files |= {} if found is None else {option.name: _there(option.flag, found)}
    folders = {option.name: _there(option.flag, value, "folder") for option, value in _given(stage, request, "folder")}
    return files | folders


def given_answers(stage: Stage, request: RunRequest) -> dict[str, Path]:
    """Return the files that take the place of artifacts of a stage."""
    answers = {option.artifact: _there(option.flag, value) for option, value in _given(stage, request, "answer")}
    missing = [a.name for a in stage.makes if not a.optional and a.name not in answers]
    if answers and missing:
        raise ParameterError(f"{stage.name}: give {', '.join(missing)} too", where=stage.name)
    return answers


_MASK = "processing.pictures.preview:read_mask"
_READERS = {
    "room": "processing.ground.room_model:read_room",
    "calibration": "processing.calibration.profile:load_profile",
    **dict.fromkeys(("mask_add", "mask_keep", "mask_sunlight"), _MASK),
}
"""What reads a file that is given and raises a typed error, by the option's name."""


def check_readable(plan: tuple[Stage, ...], request: RunRequest) -> None:
    """Read what is given to stages as they will: what cannot be used ends a run before its first stage."""
    for stage in plan:
        for option, value in _given(stage, request, "file"):
            if option.name in _READERS:
                resolve(_READERS[option.name])(Path(str(value)))
        answers = given_answers(stage, request)
        for artifact in stage.makes:
            if artifact.name in answers:
                load(artifact, answers[artifact.name])


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
    own = ((o, request.options[flag]) for flag, o in stage.options.items() if flag in request.options)
    return [(option, value) for option, value in own if option.kind == kind and not option.installed]


def _there(flag: str, value: object, what: Literal["file", "folder"] = "file") -> Path:
    path = Path(str(value))
    if not (path.is_file() if what == "file" else path.is_dir()):
        raise ParameterError(f"{flag}: there is no {what} {path.name}", where=str(path))
    return path


# What goes into a stage, as its row says: ingredients for the fingerprint, a context, and whether it has to run.

READ_FOLDER_BYTES = 1 << 30
"""Of a folder that the user gives, up to which all of it is read; a larger one counts by names and sizes."""
_PROGRAM = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class StageInputs:
    """The session, the request and the digests of files, as a stage's row lets them count."""

    path: Path
    root: Folder
    manifest: SessionManifest
    request: RunRequest
    memory: DigestMemory

    def ingredients(self, stage: Stage) -> Ingredients:
        """Return what the stage's result depends on, whatever the stage reads of parameters and earlier results."""
        if answers := given_answers(stage, self.request):
            return {"stage": stage.name, "version": stage.version, "answers": digests(answers)}
        seen = fingerprint.visible_part(self.manifest, stage.reads)
        found: Ingredients = {
            "stage": stage.name,
            "version": stage.version,
            "trades": trade_values(stage, self.request),
            "session": fingerprint.session_ingredients(seen, stage.reads),
            "files": digests(given_files(stage, self.request)),
        }
        if stage.data:
            found["data"] = digests({name: _PROGRAM / name for name in stage.data if (_PROGRAM / name).exists()})
        if fingerprint.FOLDER in stage.reads:
            # The digest of each file of the session on disk; "" where it is missing
            names = {MANIFEST_NAME, JOURNAL_NAME} | {frame.file for frame in self.manifest.frames}
            names |= {self.manifest.panorama.file} if self.manifest.panorama else set()
            for side in Side:
                if self.root.lstat(side.value) is not None:
                    with self.root.sub(side.value) as folder:
                        names |= {f"{side.value}/{name}" for name in folder.names()}
            found[fingerprint.FOLDER] = {name: self._digest(name) for name in sorted(names)}
        if fingerprint.RELIGHT in stage.reads and (relit := self._relight_digests()):
            found[fingerprint.RELIGHT] = relit
        return found

    def _relight_digests(self) -> dict[str, str]:
        """Return the digests of what was relit: summaries and pictures, not the basis of the light."""
        if self.root.lstat(fingerprint.RELIGHT) is None:
            return {}
        with self.root.sub(fingerprint.RELIGHT) as folder:
            names = [name for name in folder.names() if name.endswith((".json", ".jpg"))]
        return {name: self._digest(f"{fingerprint.RELIGHT}/{name}") for name in sorted(names)}

    def _digest(self, name: str) -> str:
        parent, _, leaf = name.rpartition("/")
        if parent and self.root.lstat(parent) is None:
            return ""
        with self.root.sub(parent) if parent else nullcontext(self.root) as folder:
            try:
                return self.memory.sha256(folder, leaf, name)
            except IntegrityError as error:
                return error.message


def digests(files: Mapping[str, Path]) -> dict[str, str]:
    """Return the SHA-256 of files, and of folders by what is in them, by name."""
    return {name: _folder_digest(path) if path.is_dir() else file_sha256(path) for name, path in files.items()}


def _folder_digest(folder: Path) -> str:
    """Return a digest of a folder's files: of their bytes, or of their sizes where there is too much to read."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    sizes = [path.stat().st_size for path in files]
    whole = sum(sizes) <= READ_FOLDER_BYTES
    digest = hashlib.sha256()
    for path, size in zip(files, sizes, strict=True):
        what = file_sha256(path) if whole else str(size)
        digest.update(f"{path.relative_to(folder).as_posix()}\0{what}\0".encode())
    return digest.hexdigest()


MAX_SHOWN = 60  # characters; chosen: half a terminal's line


@dataclass(frozen=True)
class Decision:
    """``result`` is the one to keep; None: the stage has to run."""

    result: StageResult | None
    reason: str
    changes: tuple[Change, ...] = ()


def decide(stored: Stored, now: Callable[[Ingredients], Ingredients], *, forced: bool) -> Decision:
    """Return whether what is on disk still stands; ``now(ingredients)``: what it was made of, as it is today."""
    if stored.problem:
        return Decision(None, f"its result cannot be used: {stored.problem}")
    result = stored.result
    if result is None:
        return Decision(None, "no result yet")
    if forced:
        return Decision(None, "forced by --force")
    ingredients = now(result.ingredients)
    if result.fingerprint == digest(ingredients):
        return Decision(result, _why_kept(result))
    found = tuple(fingerprint.changes(result.ingredients, ingredients))
    if not found:
        return Decision(None, "changed: made by another version of daylit")
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return Decision(None, f"changed: {change_line(found[0])}{more}", found)


def _why_kept(result: StageResult) -> str:
    if result.skipped:
        return f"nothing to do: {result.skipped}"
    kept = f"{len(result.files)} file{'' if len(result.files) == 1 else 's'} intact"
    given = f"given by you ({', '.join(result.given)}); " if result.given else ""
    return f"{given}no input has changed, {kept}"


def change_line(change: Change) -> str:
    """Return a change in words: ``parameters k1: 0.5 -> 0.6``."""
    path, old, new = change
    return f"{path}: {shown(old)} -> {shown(new)}"


def shown(value: Any) -> str:
    """Return a JSON value in at most `MAX_SHOWN` characters; digests are cut to 12."""
    if value is None:
        return "none"
    text = str(value)
    if len(text) == 64 and all(c in "0123456789abcdef" for c in text):
        return text[:12]
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."
