"""What a stage is given and what it gives back: the whole of what stages and the runner know of each other."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, JsonValue

from processing.errors import ProcessingError
from processing.stages.parameters import StageParameters
from station.session.session import SafeText, SessionManifest


class Quality(StrEnum):
    """How much work is worth while."""

    DRAFT = "draft"
    STANDARD = "standard"
    REFERENCE = "reference"


class StageWarning(BaseModel):
    """Something worth knowing that does not stop the work; part of the result."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    code: SafeText
    message: SafeText


P = TypeVar("P", bound=StageParameters)
Fetch = Callable[[str, str], Any]
Progress = Callable[[float, str], None]


class KeepsParts(Protocol):
    """What keeps parts of a result from run to run."""

    def part(self, name: str, files: tuple[str, ...], own: Any, make: Callable[[], Any], apart: str = "") -> Any:
        """See `StageContext.part`."""

    def enough(self) -> bool:
        """See `StageContext.enough`."""


@dataclass(frozen=True)
class StageContext:
    """What a stage may use; nothing else may change its result.

    ``session`` holds only the fields that the stage's row names in ``reads`` (and the session's id, time of creation
    and bracket); other fields are as if nothing had been recorded.
    """

    session: SessionManifest
    session_path: Path
    folder: Path
    """Where the stage writes artifacts of kind "file", and nothing else."""
    parameters: StageParameters
    fetch: Fetch
    """``fetch(stage, artifact)``: use `artifact` and `optional_artifact`."""
    summary: Callable[[str], Mapping[str, Any]]
    """``summary(stage)``: metrics, warnings, left_out, honoured, skipped and given of a stage that this one needs."""
    quality: Quality = Quality.STANDARD
    max_error: float | None = None
    """Relative error asked for, where the stage's row trades it; None: none asked."""
    time_budget_s: float | None = None
    progress: Progress = lambda _fraction, _text: None
    """``progress(fraction 0..1, text)``; may be called often."""
    let_go: Callable[..., None] = lambda *_stages: None
    """``let_go(*stages)``: pictures of some stages (none named: of all) that are held in memory for later ones are let
    go, as this one needs much itself. Those that were read from the disk may then be written into."""
    parts: KeepsParts | None = None
    """Where the row says that the result has parts; use `part` and `enough`."""

    def parameters_of(self, model: type[P]) -> P:
        """Return the stage's parameters as what they are."""
        assert isinstance(self.parameters, model)
        return self.parameters

    def artifact(self, stage: str, name: str) -> Any:
        """Return what an earlier stage made, from memory or from disk; `ProcessingError` where it was left out."""
        found = self.fetch(stage, name)
        if found is None:
            text = f"{name} is needed and the stage {stage} has left it out"
            raise ProcessingError(text, where=self.session_path.name, advice=f"stages/{stage}/result.json says why")
        return found

    def has(self, stage: str, name: str) -> bool:
        """Return whether an earlier stage made what it may leave out, without reading it."""
        found = self.summary(stage)
        return not (found.get("skipped") or name in found["left_out"])

    def part(self, name: str, files: tuple[str, ...], own: Any, make: Callable[[], Any], apart: str = "") -> Any:
        """Return the facts (JSON) of a part of the result, made now or kept with its files from the result before.

        ``own``: JSON of what it depends on beside what the stage has read so far (but of the stage ``apart``).
        """
        return self.parts.part(name, files, own, make, apart) if self.parts else make()

    def enough(self) -> bool:
        """Return whether to stop after this part, as somebody waits for the first: the output is then unfinished."""
        return self.parts is not None and self.parts.enough()

    def optional_artifact(self, stage: str, name: str) -> Any | None:
        """Return what an earlier stage made, None where it was left out."""
        return self.fetch(stage, name)


@dataclass(frozen=True)
class StageOutput:
    """What a stage has made. The same inputs must give the same output: no times, paths or random numbers in it."""

    artifacts: Mapping[str, object] = field(default_factory=dict)
    """By name; of kind "file": anything but None once the file is in ``context.folder``."""
    metrics: Mapping[str, JsonValue] = field(default_factory=dict)
    warnings: tuple[StageWarning, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Artifacts and parts of the work that were not done, with the reason."""
    honoured: Mapping[str, str] = field(default_factory=dict)
    """What was done with "quality", "max_error" or "time_budget", in words."""
    unfinished: bool = False
    """There is more to make: the stage stopped because `StageContext.enough` said so."""
