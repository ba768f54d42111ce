"""Runs the stages of the table on a session: only what has to run, each result whole or not at all."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from processing.errors import ProcessingError
from processing.ground.threads import Later, behind, give_back, limit_libraries, watched
from processing.pipeline import STAGES, Stage, check_table, stage_named
from processing.running import requests
from processing.running.artifacts import Made, Shelf, Work, answer_result, file_name, load, make_result, remade
from processing.running.fingerprint import DigestMemory, visible_part
from processing.running.progress import Cost, Meter, Pace, PastSeconds, left_s, state_folder
from processing.running.reads import SUMMARY, Earlier, Parts, Reads, unread
from processing.running.requests import Decision, RunRequest, StageInputs
from processing.running.result_store import ResultStore, Stored, stages_folder
from processing.running.results import Action, OnEvent, RunEvent, RunEventKind, RunReport, StageReport, StageResult
from processing.stages.contract import Progress, StageContext
from station.session.durable import SessionLock
from station.session.folder import Folder
from station.session.store import load_manifest


def process(
    session: Path, request: RunRequest, *, stages: tuple[Stage, ...] = STAGES, on_event: OnEvent = lambda _event: None
) -> RunReport:
    """Bring the results of a session up to date and say what was done and why.

    Raises `ParameterError` for a request that cannot be met, `SessionLockedError` while another process works on the
    session, and what a stage raises; the results of the stages before it stand."""
    check_table(stages)
    plan = requests.planned(request, stages)
    requests.check_readable(plan, request)
    load_manifest(session)
    meter = Meter()
    write = not request.dry_run
    with _opened(session, write=write) as root, stages_folder(root, create=write) as folder:
        memory = DigestMemory(folder, trust=not request.recheck)
        store = ResultStore(folder, memory)
        if write:
            store.recover()
        run = PipelineRun(StageInputs(session, root, load_manifest(session), request, memory), plan, store, on_event)
        try:
            with watched(), behind() as run.later:
                reports = tuple(run.steps())
        finally:
            if write:
                store.recover()  # of what was not written because something before it could not be
                memory.save()
    costs = [report.cost.peak_bytes for report in reports if report.cost]
    total = meter.read()
    return RunReport(session.name, reports, Cost(total.seconds, total.cpu_seconds, max([total.peak_bytes, *costs])))


RESULTS = ("calibrate", "figures", "arrange", "render", "stills", "day", "report")
"""Stages whose results people look at; the others are steps on the way, made again when they are needed."""


def clean(session: Path, keep: tuple[str, ...] = RESULTS, *, stages: tuple[Stage, ...] = STAGES) -> dict[str, int]:
    """Remove the results of all stages but those to keep, and what killed runs left; return bytes freed by stage.

    Raises `ParameterError` for a stage that is none, `SessionLockedError` while another process works on the session.
    """
    for name in keep:
        stage_named(name, stages)
    load_manifest(session)
    with _opened(session, write=True) as root, stages_folder(root, create=True) as folder:
        store = ResultStore(folder, DigestMemory(None))
        store.recover()
        return {stage.name: size for stage in stages if stage.name not in keep and (size := store.drop(stage.name))}


@contextmanager
def _opened(session: Path, *, write: bool) -> Iterator[Folder]:
    """Open the session folder, locked where it is to be written to."""
    with Folder.open(session) as root, SessionLock(root) if write else nullcontext():
        yield root


def _listed(names: list[str]) -> str:
    """Return names as people list them; of many, the first ones."""
    if len(names) > 3:
        return f"{', '.join(names[:2])} and {len(names) - 2} others"
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


class PipelineRun:
    """One run over one session; `steps` yields a report a stage.

    A stage's pictures are written ``later`` (`behind`), while the next one works with those in memory; results get into
    their places in turn."""

    later: Later

    def __init__(self, inputs: StageInputs, plan: tuple[Stage, ...], store: ResultStore, on_event: OnEvent) -> None:
        self._unwritten: list[tuple[BaseException, str]] = []
        self._plan = plan
        self._request = inputs.request
        self._store = store
        self._memory = inputs.memory
        self._on_event = on_event
        self._inputs = inputs
        self._rows = {stage.name: stage for stage in plan}
        self._earlier = Earlier(store.path)
        self._unknown: dict[str, None] = {}
        self._unfinished: set[str] = set()
        self._shown: dict[str, StageReport] = {}
        made = self._earlier.results
        self._shelf = Shelf(self._read, lambda stage, name: made[stage].artifacts.get(name, "").endswith(".exr"))
        self._past = PastSeconds(state_folder())
        self._pace = Pace()
        self._megapixels = sum((f.width_px or 0) * (f.height_px or 0) for f in inputs.manifest.frames) / 1e6

    def steps(self) -> Iterator[StageReport]:
        """Bring one stage after the other up to date; what somebody waits for is shown before the rest is made."""
        for index, stage in enumerate(self._plan):
            later = self._plan[index + 1 :]
            report = self._reported(stage, later, first_only=self._request.first_picture)
            if stage.name in self._unfinished:
                shown = [self._reported(one, later[at + 1 :]) for at, one in enumerate(later)]
                where = self._store.path(later[-1].name if later else stage.name)
                self._on_event(RunEvent(RunEventKind.FIRST, stage.name, f"first picture ready: {where}"))
                report = self._reported(stage, later).after(report)
                self._shown = {one.stage: one for one in shown}
            self._shelf.drop_unneeded(later)
            give_back()
            yield report.after(self._shown[stage.name]) if stage.name in self._shown else report

    def _reported(self, stage: Stage, later: tuple[Stage, ...], *, first_only: bool = False) -> StageReport:
        try:
            report = self._predict(stage) if self._request.dry_run else self._step(stage, later, first_only=first_only)
        except BaseException as error:
            whose = [name for one, name in self._unwritten if one is error]
            self._on_event(RunEvent(RunEventKind.FAILED, [*whose, stage.name][0], str(error)))
            raise
        self._on_event(RunEvent(RunEventKind.FINISHED, stage.name, report.reason, 1.0, None, report))
        return report

    def _reads(self, stage: Stage) -> Reads:
        return Reads(self._earlier, requests.parameters(stage, self._request))

    def _decide(self, stage: Stage, stored: Stored) -> Decision:
        """Return whether what is stored stands: its ingredients are looked at as they are today."""
        static, reads = self._inputs.ingredients(stage), self._reads(stage)
        forced = stage.name in self._request.force and stage.name not in self._unfinished | self._shown.keys()
        return requests.decide(stored, lambda then: static | reads.again(then), forced=forced)

    def _predict(self, stage: Stage) -> StageReport:
        """Say what a run would do; later stages depend on results that are not there yet."""
        stored = self._store.read(stage.name)
        read: Any = stored.result.ingredients.get("reads", {}) if stored.result else stage.needs
        upstream = [name for name in self._unknown if any(one.partition("/")[0] == name for one in read)]
        decision = self._decide(stage, stored)
        if upstream and not [change for change in decision.changes if not change[0].startswith("reads ")]:
            self._unknown[stage.name] = None
            return StageReport(stage.name, Action.DEPENDS, f"on the new results of {_listed(upstream)}")
        if decision.result is None:
            self._unknown[stage.name] = None
            return StageReport(stage.name, Action.WOULD_RUN, decision.reason, decision.changes)
        return self._kept(stage, decision, decision.result)

    def _step(self, stage: Stage, later: tuple[Stage, ...], *, first_only: bool = False) -> StageReport:
        stored = self._store.read(stage.name)
        decision = self._decide(stage, stored)
        if decision.result is not None:
            return self._kept(stage, decision, decision.result)
        (expected,) = self._expected((stage,))
        left = left_s(self._expected(later), expected, 0.0, 0.0)
        self._on_event(RunEvent(RunEventKind.STARTED, stage.name, f"{stage.title} ({decision.reason})", 0.0, left))
        meter = Meter()
        forced = stage.name in self._request.force and stage.name not in self._unfinished
        result = self._make(stage, later, meter, None if forced else stored.result, first_only=first_only)
        cost = meter.read()
        action, reason = Action.RAN, decision.reason
        if result.skipped:
            action, reason = Action.NOTHING_TO_DO, result.skipped
        elif result.given:
            action, reason = Action.GIVEN, f"given by you: {', '.join(result.given)}"
        else:
            reason += unread(self._flags(stage), result)
            self._pace.add(cost.seconds, self._past.expected_s(self._key(stage), self._megapixels))
            self._past.add(self._key(stage), cost.seconds, self._megapixels)
            self._past.save()
        return StageReport(stage.name, action, reason, decision.changes, cost, result.summary())

    def _flags(self, stage: Stage) -> dict[str, str]:
        """Return the parameters of a stage that the request sets, by flag; files count by themselves."""
        given = {flag: option for flag, option in stage.options.items() if flag in self._request.options}
        return {flag: option.name for flag, option in given.items() if option.kind == "parameter"}

    def _make(
        self, stage: Stage, later: tuple[Stage, ...], meter: Meter, former: StageResult | None, *, first_only: bool
    ) -> StageResult:
        """Make a result, put it in its place and keep in memory what later stages want."""
        limit_libraries()
        answers = requests.given_answers(stage, self._request)
        static, reads = self._inputs.ingredients(stage), self._reads(stage)
        with ExitStack() as stack:
            building = stack.enter_context(self._store.building(stage.name))
            folder, common = building.folder.path, {key: static.get(key) for key in ("version", "files", "data")}
            parts = Parts(former, self._store.path(stage.name), folder, common, reads, first_only)
            context = self._context(stage, folder, reads, parts, self._progress(stage, later, meter))
            work = Work(static, reads, parts, building, self._memory)
            made = answer_result(stage, answers, context, work) if answers else make_result(stage, context, work)
            if made.unfinished:
                work = replace(work, static=static | {"unfinished": True})
                made = replace(made, result=remade(made.result, work))
            (self._unfinished.add if made.unfinished else self._unfinished.discard)(stage.name)
            tail = partial(self._written, stack.pop_all(), work, made, meter.read())
        whole = self.later(tail)
        if made.unfinished or not (made.pictures and later):
            whole.result()
        self._earlier.put(made.result, whole)
        if any(stage.name in other.needs for other in later):
            for name, value in made.in_memory.items():
                self._shelf.put(stage.name, name, value)
        return made.result

    def _written(self, stack: ExitStack, work: Work, made: Made, cost: Cost) -> StageResult:
        """Write what is left of a result and put it in its place."""
        stage = made.result.stage
        try:
            with stack:
                record = made.run_record(cost, self._megapixels)
                result = self._store.commit(work.building, made.whole(work), record)
            self._store.known_again(stage, work.parts.kept)
        except BaseException as error:
            self._unwritten.append((error, stage))
            raise
        return result

    def _context(self, stage: Stage, folder: Path, reads: Reads, parts: Parts, progress: Progress) -> StageContext:
        request = self._request
        trades = requests.trade_values(stage, request)
        return StageContext(
            session=visible_part(self._inputs.manifest, stage.reads),
            session_path=self._inputs.path,
            folder=folder,
            parameters=requests.parameters(stage, request).noting(reads.note_parameter),
            fetch=partial(self._fetch, stage, reads),
            summary=partial(self._summary, stage, reads),
            quality=requests.quality_of(stage, request),
            max_error=request.max_error if "max_error" in trades else None,
            time_budget_s=request.time_budget_s if "time_budget" in trades else None,
            progress=progress,
            parts=parts,
            let_go=self._shelf.let_go,
        )

    def _kept(self, stage: Stage, decision: Decision, result: StageResult) -> StageReport:
        self._earlier.put(result)
        self._unfinished.discard(stage.name)
        reason = decision.reason + ("" if result.skipped or result.given else unread(self._flags(stage), result))
        return StageReport(stage.name, Action.SKIPPED, reason, (), None, result.summary())

    def _read(self, stage: str, name: str) -> object | None:
        """Return an artifact from disk; None where it was left out."""
        result = self._earlier.written(stage)
        assert result is not None
        artifact = next((a for a in self._rows[stage].makes if a.name == name), None)
        if artifact is None:
            raise ProcessingError(f"the stage {stage} makes no {name}")
        return load(artifact, self._store.path(stage) / file_name(artifact)) if name in result.artifacts else None

    def _check_need(self, stage: Stage, other: str) -> None:
        if other not in stage.needs:
            raise ProcessingError(f"{stage.name} asks for {other}, which its row does not name among its needs")

    def _fetch(self, stage: Stage, reads: Reads, other: str, name: str) -> Any:
        self._check_need(stage, other)
        return reads.noted(self._shelf.get(other, name), other, name)

    def _summary(self, stage: Stage, reads: Reads, other: str) -> Any:
        self._check_need(stage, other)
        return reads.noted(self._earlier.results[other].summary(), other, SUMMARY)

    def _key(self, stage: Stage) -> str:
        quality = requests.quality_of(stage, self._request) if "quality" in stage.trades else ""
        return f"{stage.name} {stage.version} {quality}".strip()

    def _expected(self, later: tuple[Stage, ...]) -> list[float | None]:
        """Return what later stages may take; those that have never run are not known."""
        return [self._pace.of(self._past.expected_s(self._key(stage), self._megapixels)) for stage in later]

    def _progress(self, stage: Stage, later: tuple[Stage, ...], meter: Meter) -> Any:
        (expected,) = self._expected((stage,))

        def progress(fraction: float, text: str) -> None:
            done = min(max(fraction, 0.0), 1.0)
            left = left_s(self._expected(later), expected, meter.elapsed_s, done)
            self._on_event(RunEvent(RunEventKind.PROGRESS, stage.name, text, done, left))

        return progress
