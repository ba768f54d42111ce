"""Runs the stages of the table on a session: only what has to run, each result whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from processing.errors import ProcessingError
from processing.pipeline import STAGES, Stage, check_table
from processing.running.artifacts import Shelf, answer_result, file_name, load, make_result
from processing.running.fingerprint import DigestMemory
from processing.running.progress import Cost, Meter, Pace, PastSeconds, left_s, state_folder
from processing.running.requests import RunRequest, planned
from processing.running.result_store import ResultStore, stages_folder
from processing.running.results import Action, OnEvent, RunEvent, RunEventKind, RunReport, StageReport, StageResult
from processing.running.stage_inputs import Decision, StageInputs, decide, make_context
from station.session.durable import SessionLock
from station.session.folder import Folder
from station.session.store import load_manifest


def _silent(_event: RunEvent) -> None:
    return None


def process(
    session: Path, request: RunRequest, *, stages: tuple[Stage, ...] = STAGES, on_event: OnEvent = _silent
) -> RunReport:
    """Bring the results of a session up to date and say what was done and why.

    Raises `ParameterError` for a request that cannot be met, `SessionLockedError` while another process works on the
    session, and what a stage raises; the results of the stages before it stand.
    """
    check_table(stages)
    plan = planned(request, stages)
    load_manifest(session)
    meter = Meter()
    write = not request.dry_run
    with _opened(session, write=write) as root, stages_folder(root, create=write) as folder:
        memory = DigestMemory(folder, trust=not request.recheck)
        store = ResultStore(folder, memory)
        if write:
            store.recover()
        inputs = StageInputs(session, root, load_manifest(session), request, memory)
        run = PipelineRun(inputs, plan, store, on_event)
        try:
            reports = tuple(run.steps())
        finally:
            if write:
                memory.save()
    costs = [report.cost.peak_bytes for report in reports if report.cost]
    total = meter.read()
    return RunReport(session.name, reports, Cost(total.seconds, total.cpu_seconds, max([total.peak_bytes, *costs])))


@contextmanager
def _opened(session: Path, *, write: bool) -> Iterator[Folder]:
    """Open the session folder, locked where it is to be written to."""
    root = Folder.open(session)
    lock = None
    try:
        lock = SessionLock(root) if write else None
        yield root
    finally:
        if lock:
            lock.release()
        root.close()


def _listed(names: list[str]) -> str:
    """Return names as people list them; of many, the first ones."""
    if len(names) > 3:
        return f"{', '.join(names[:2])} and {len(names) - 2} others"
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


class PipelineRun:
    """One run over one session; `steps` yields a report a stage."""

    def __init__(self, inputs: StageInputs, plan: tuple[Stage, ...], store: ResultStore, on_event: OnEvent) -> None:
        self._plan = plan
        self._request = inputs.request
        self._store = store
        self._memory = inputs.memory
        self._on_event = on_event
        self._inputs = inputs
        self._rows = {stage.name: stage for stage in plan}
        self._results: dict[str, StageResult] = {}
        self._unknown: set[str] = set()
        self._shelf = Shelf(self._read)
        self._past = PastSeconds(state_folder())
        self._pace = Pace()
        self._megapixels = sum((f.width_px or 0) * (f.height_px or 0) for f in inputs.manifest.frames) / 1e6

    def steps(self) -> Iterator[StageReport]:
        """Bring one stage after the other up to date."""
        for index, stage in enumerate(self._plan):
            later = self._plan[index + 1 :]
            try:
                report = self._predict(stage) if self._request.dry_run else self._step(stage, later)
            except BaseException as error:
                self._on_event(RunEvent(RunEventKind.FAILED, stage.name, str(error)))
                raise
            self._shelf.drop_unneeded(later)
            self._on_event(RunEvent(RunEventKind.FINISHED, stage.name, report.reason, 1.0, None, report))
            yield report

    def _decide(self, stage: Stage) -> Decision:
        ingredients = self._inputs.ingredients(stage, self._results)
        return decide(self._store.read(stage.name), ingredients, forced=stage.name in self._request.force)

    def _predict(self, stage: Stage) -> StageReport:
        """Say what a run would do; later stages depend on results that are not there yet."""
        upstream = [name for name in stage.needs if name in self._unknown]
        if upstream:
            self._unknown.add(stage.name)
            return StageReport(stage.name, Action.DEPENDS, f"on what {_listed(upstream)} will give")
        decision = self._decide(stage)
        if decision.result is None:
            self._unknown.add(stage.name)
            return StageReport(stage.name, Action.WOULD_RUN, decision.reason, decision.changes)
        return self._kept(stage, decision, decision.result)

    def _step(self, stage: Stage, later: tuple[Stage, ...]) -> StageReport:
        decision = self._decide(stage)
        if decision.result is not None:
            return self._kept(stage, decision, decision.result)
        self._on_event(self._started(stage, later, decision))
        meter = Meter()
        result = self._make(stage, later, meter)
        self._results[stage.name] = result
        cost = meter.read()
        action, reason = Action.RAN, decision.reason
        if result.skipped:
            action, reason = Action.NOTHING_TO_DO, result.skipped
        elif result.given:
            action, reason = Action.GIVEN, f"given by you: {', '.join(result.given)}"
        else:
            self._pace.add(cost.seconds, self._past.expected_s(self._key(stage), self._megapixels))
            self._past.add(self._key(stage), cost.seconds, self._megapixels)
            self._past.save()
        return StageReport(stage.name, action, reason, decision.changes, cost, result.summary())

    def _make(self, stage: Stage, later: tuple[Stage, ...], meter: Meter) -> StageResult:
        """Make a result, put it in its place and keep in memory what later stages want."""
        answers = self._inputs.answers(stage)
        ingredients = self._inputs.ingredients(stage, self._results)
        with self._store.building(stage.name) as building:
            context = make_context(
                self._inputs,
                stage,
                building.folder.path,
                fetch=self._fetcher(stage),
                summary=self._summaries(stage),
                progress=self._progress(stage, later, meter),
            )
            if answers:
                made = answer_result(stage, answers, context, ingredients, building, self._memory)
            else:
                made = make_result(stage, context, ingredients, building, self._memory)
            result = self._store.commit(building, made.result, made.run_record(meter.read(), self._megapixels))
        if any(stage.name in other.needs for other in later):
            for name, value in made.in_memory.items():
                self._shelf.put(stage.name, name, value)
        return result

    def _kept(self, stage: Stage, decision: Decision, result: StageResult) -> StageReport:
        self._results[stage.name] = result
        return StageReport(stage.name, Action.SKIPPED, decision.reason, (), None, result.summary())

    def _read(self, stage: str, name: str) -> object | None:
        """Return an artifact from disk; None where it was left out."""
        result = self._results[stage]
        artifact = next((a for a in self._rows[stage].makes if a.name == name), None)
        if artifact is None:
            raise ProcessingError(f"the stage {stage} makes no {name}")
        if name not in result.artifacts:
            return None
        return load(artifact, self._store.path(stage) / file_name(artifact))

    def _check_need(self, stage: Stage, other: str) -> None:
        if other not in stage.needs:
            raise ProcessingError(f"{stage.name} asks for {other}, which its row does not name among its needs")

    def _fetcher(self, stage: Stage) -> Any:
        def fetch(other: str, name: str) -> object | None:
            self._check_need(stage, other)
            return self._shelf.get(other, name)

        return fetch

    def _summaries(self, stage: Stage) -> Any:
        def summary(other: str) -> dict[str, Any]:
            self._check_need(stage, other)
            return self._results[other].summary()

        return summary

    def _key(self, stage: Stage) -> str:
        quality = self._request.quality if "quality" in stage.trades else ""
        return f"{stage.name} {stage.version} {quality}".strip()

    def _expected(self, later: tuple[Stage, ...]) -> list[float | None]:
        """Return what later stages may take; those that have never run are not known."""
        return [self._pace.of(self._past.expected_s(self._key(stage), self._megapixels)) for stage in later]

    def _started(self, stage: Stage, later: tuple[Stage, ...], decision: Decision) -> RunEvent:
        (expected,) = self._expected((stage,))
        left = left_s(self._expected(later), expected, 0.0, 0.0)
        return RunEvent(RunEventKind.STARTED, stage.name, f"{stage.title} ({decision.reason})", 0.0, left)

    def _progress(self, stage: Stage, later: tuple[Stage, ...], meter: Meter) -> Any:
        (expected,) = self._expected((stage,))

        def progress(fraction: float, text: str) -> None:
            done = min(max(fraction, 0.0), 1.0)
            left = left_s(self._expected(later), expected, meter.elapsed_s, done)
            self._on_event(RunEvent(RunEventKind.PROGRESS, stage.name, text, done, left))

        return progress
