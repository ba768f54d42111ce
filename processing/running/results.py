"""result.json: what a stage made, of what, and what was left out. It holds no times and no paths.

The same inputs give the same bytes, so results can be compared; seconds and memory are in run.json beside it.
"""

import html
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue, StringConstraints, ValidationError

from processing.ground.finished import PLAIN_NAME, digest
from processing.running.progress import Cost
from processing.stages.contract import StageWarning
from station.session import strict_json
from station.session.session import SafeText

RUN_NAME = "run.json"
MAX_RESULT_BYTES = 8 << 20
FileName = Annotated[str, StringConstraints(pattern=PLAIN_NAME)]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Change = tuple[str, Any, Any]  # path of an ingredient, old value, new value (None: absent)


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class FileRecord(_Record):
    """A file of a result."""

    size_bytes: Annotated[int, Field(ge=0)]
    sha256: Sha256


class PartRecord(_Record):
    """A part of a result that can be kept without the others."""

    own: Sha256
    """Of what it alone depends on."""
    reads: dict[str, JsonValue]
    files: tuple[FileName, ...]
    facts: JsonValue


class StageResult(_Record):
    """result.json."""

    schema_version: Literal[1] = 1
    stage: SafeText
    version: int
    fingerprint: Sha256
    """SHA-256 of ``ingredients``."""
    ingredients: dict[str, JsonValue]
    """All that the result depends on: parameters, digests of files, what was read of the session."""
    given: tuple[SafeText, ...] = ()
    """Artifacts that the user gave instead of the stage making them."""
    skipped: SafeText = ""
    """Why the stage had nothing to do; empty: it ran."""
    artifacts: dict[SafeText, FileName] = {}
    """File of each artifact that was made."""
    files: dict[FileName, FileRecord] = {}
    parts: dict[SafeText, PartRecord] = {}
    left_out: dict[SafeText, SafeText] = {}
    """Artifacts and parts of the work that were not done, with the reason."""
    metrics: dict[str, JsonValue] = {}
    warnings: tuple[StageWarning, ...] = ()
    honoured: dict[SafeText, SafeText] = {}
    """What was done with --quality, --max-error or --time-budget."""
    seal: str = ""
    """SHA-256 of all the rest: shows a damaged result.json."""

    def summary(self) -> dict[str, Any]:
        """Return what later stages may read beside the artifacts, as JSON values."""
        return self.model_dump(mode="json", include={"given", "skipped", "left_out", "metrics", "warnings", "honoured"})

    def sealed(self) -> Self:
        """Return the result with its seal."""
        return self.model_copy(update={"seal": self._seal()})

    def _seal(self) -> str:
        return digest(self.model_dump(mode="json", exclude={"seal"}))

    def problem(self) -> str:
        """Say why this cannot be a result as it was written; empty: it can."""
        if self.seal != self._seal():
            return "has changed since it was written"
        if digest(self.ingredients) != self.fingerprint:
            return "has a fingerprint that is not that of its ingredients"
        if not set(self.artifacts.values()) <= set(self.files):
            return "lists an artifact without its file"
        return ""


class RunRecord(_Record):
    """run.json: what the last run of a stage cost; differs from run to run."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int
    megapixels: float = 0.0


def result_bytes(record: BaseModel) -> bytes:
    """Return the JSON of a record, indented, with a newline at the end."""
    return (json.dumps(record.model_dump(mode="json"), indent=1, ensure_ascii=False) + "\n").encode("utf-8")


def parse_result(raw: bytes) -> StageResult:
    """Return the result in the bytes of a result.json.

    Raises `ValueError` saying why for anything that is not one: not JSON, not of the schema, changed by hand.
    """
    data = strict_json.loads(raw)
    try:
        result = StageResult.model_validate(data)
    except ValidationError as exc:
        raise ValueError(strict_json.faults_of(exc)[0]) from exc
    problem = result.problem() or ("" if result_bytes(result) == raw else "has changed since it was written")
    if problem:
        raise ValueError(problem)
    return result


# What a run says while it goes and at its end: small types for terminals, logs, programs and tests alike.


class Action(StrEnum):
    """What became of a stage."""

    RAN = "ran"
    SKIPPED = "skipped"
    """Same ingredients, intact files."""
    NOTHING_TO_DO = "nothing to do"
    """Its own skip rule said so."""
    GIVEN = "given"
    """The user gave the answer."""
    WOULD_RUN = "would run"
    DEPENDS = "depends"
    """Dry run: known only when an earlier stage has run."""


@dataclass(frozen=True)
class StageReport:
    """One line of the summary."""

    stage: str
    action: Action
    reason: str
    changes: tuple[Change, ...] = ()
    cost: Cost | None = None
    """Of this run; None where nothing ran."""
    summary: dict[str, Any] = field(default_factory=dict)
    """Metrics, warnings, left_out, honoured, skipped and given of the result."""

    def after(self, first: Self) -> Self:
        """Return the report of a stage that ran in two goes as one: why it first ran, and the cost of both."""
        costs = [cost for cost in (first.cost, self.cost) if cost]
        if len(costs) < 2:
            return self
        seconds, cpu = sum(c.seconds for c in costs), sum(c.cpu_seconds for c in costs)
        both = Cost(seconds, cpu, max(c.peak_bytes for c in costs))
        return replace(self, reason=first.reason, changes=first.changes, cost=both)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON-able values."""
        changes = [{"what": path, "old": old, "new": new} for path, old, new in self.changes]
        return {**asdict(self), "action": self.action.value, "changes": changes}


@dataclass(frozen=True)
class RunReport:
    """The whole run."""

    session: str
    stages: tuple[StageReport, ...]
    cost: Cost

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON-able values."""
        return {"session": self.session, "stages": [s.to_dict() for s in self.stages], **asdict(self.cost)}

    def _repr_html_(self) -> str:
        """Return the table of stages for a notebook."""
        cells = ((s.stage, s.action.value, f"{s.cost.seconds:.1f}" if s.cost else "", s.reason) for s in self.stages)
        rows = "".join(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in cells)
        head = "<tr><th>stage</th><th>action</th><th>seconds</th><th>reason</th></tr>"
        return f"<table><caption>{html.escape(self.session)}</caption>{head}{rows}</table>"


class RunEventKind(StrEnum):
    """What is going on."""

    STARTED = "started"
    PROGRESS = "progress"
    FINISHED = "finished"
    FIRST = "first"
    """The first part of a result has gone through all later stages; the rest is being made."""
    FAILED = "failed"


@dataclass(frozen=True)
class RunEvent:
    """One event of a run."""

    kind: RunEventKind
    stage: str
    text: str
    fraction: float = 0.0
    left_s: float | None = None
    """Of the whole run; None: not known."""
    report: StageReport | None = None
    """With FINISHED."""


OnEvent = Callable[[RunEvent], None]
