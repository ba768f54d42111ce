"""Many sessions through the cluster: found, handed out a few at a time, every one accounted for at the end."""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from processing.batch.cluster import connected, threads_by_machine
from processing.batch.store import is_url, remote_sessions, work_by_url
from processing.batch.work import Outcome, Task, work
from processing.errors import ParameterError, WorkerLostError
from station.session.session import MANIFEST_NAME

LOOK_S = 2.0  # between looks at how many workers there are
NO_WORKERS_S = 600.0
"""Without any worker, after which what is under way is listed as lost: begun anew, they take seconds to a minute."""
DEPTH = 3  # folders below the one that is named, in which sessions are looked for


@dataclass(frozen=True)
class BatchRequest:
    """What to do with a folder of sessions."""

    folder: Path | str
    """Or a URL (fsspec)."""
    arguments: tuple[str, ...] = ()
    """Of `daylit process`, but for the session."""
    workers: int = 1
    """On this computer; not used with a cluster elsewhere."""
    cluster: str | None = None
    timeout_s: float = 7200.0
    zone: str | None = None


@dataclass
class BatchReport:
    """What became of all sessions, in the order of their names."""

    folder: Path | str
    outcomes: list[Outcome] = field(default_factory=list)
    workers: int = 0
    """How many worked at the end."""
    seconds: float = 0.0
    at_once: int = 0
    """Most sessions that were with the cluster at a time."""

    @property
    def cores_busy(self) -> float:
        """Return how many cores worked on sessions, on average."""
        return sum(one.cpu_seconds for one in self.outcomes) / self.seconds if self.seconds else 0.0

    @property
    def failed(self) -> list[Outcome]:
        """Return those that are not done."""
        return [one for one in self.outcomes if one.state == "failed"]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "ok": not self.failed,
            "sessions": len(self.outcomes),
            "done": len(self.outcomes) - len(self.failed),
            "failed": len(self.failed),
            "workers": self.workers,
            "at_once": self.at_once,
            "seconds": round(self.seconds, 3),
            "cpu_seconds": round(sum(one.cpu_seconds for one in self.outcomes), 3),
            "cores_busy": round(self.cores_busy, 3),
            "outcomes": [asdict(one) for one in self.outcomes],
        }


OnOutcome = Callable[[Outcome, int, int], None]  # (outcome, how many are over, of how many)


def find_sessions(folder: Path) -> list[Path]:
    """Return the sessions in a folder and the folders in it, sorted; raise `ParameterError` where there are none."""
    if not folder.is_dir():
        raise ParameterError("not a folder", where=str(folder))
    found = sorted(_below(folder, DEPTH))
    if not found:
        raise ParameterError("no sessions here", where=str(folder), advice=f"sessions are folders with {MANIFEST_NAME}")
    return found


def _below(folder: Path, depth: int) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.name.startswith(".") or path.is_symlink() or not path.is_dir():
            continue
        if (path / MANIFEST_NAME).exists():
            yield path
        elif depth > 1:
            yield from _below(path, depth - 1)


def run_batch(
    request: BatchRequest, on_outcome: OnOutcome = lambda *_: None, *, do: Callable[[Task], Outcome] | None = None
) -> BatchReport:
    """Process all sessions of a folder; one that fails, hangs or kills its worker is listed and stops no other.

    ``do`` is what a worker does (tests give their own). Raises `ParameterError` where there are no sessions and
    `ClusterError` where the cluster cannot be reached.
    """
    begun_s = time.monotonic()
    place = str(request.folder)
    if is_url(place):
        named = {url: url.removeprefix(place.rstrip("/") + "/") for url in remote_sessions(place, DEPTH)}
        do = do or work_by_url
    else:
        named = {str(path.resolve()): str(path.relative_to(place)) for path in find_sessions(Path(place))}
        do = do or work
    tasks = [Task(at, name, request.arguments, request.timeout_s, zone=request.zone) for at, name in named.items()]
    report = BatchReport(request.folder)
    with tempfile.TemporaryDirectory(prefix="daylit-batch-", ignore_cleanup_errors=True) as scratch:
        workers = max(1, min(request.workers, len(tasks)))
        with connected(request.cluster, workers, Path(scratch)) as client:

            def widest(width: int) -> None:
                report.at_once = max(report.at_once, width)

            for outcome in handed_out(client, tasks, do, widest):
                report.outcomes.append(outcome)
                on_outcome(outcome, len(report.outcomes), len(tasks))
            report.workers = len(client.scheduler_info(n_workers=-1)["workers"])
    report.outcomes.sort(key=lambda one: one.session)
    report.seconds = time.monotonic() - begun_s
    return report


def handed_out(
    client: Any, tasks: Sequence[Task], do: Callable[[Task], Outcome], on_width: Callable[[int], None] = lambda _: None
) -> Iterator[Outcome]:
    """Yield the outcome of every task as it comes, with one for each thread of a Dask client's workers under way.

    When a worker dies, the cluster blames all tasks that it had, and a task that kills workers may take others with
    it. Those that are lost are therefore tried again at the end, one by one: then only the guilty are. ``on_width`` is
    given how many are under way, whenever that grows or shrinks: workers come and go while the batch runs.
    """
    suspects: list[Task] = []
    for task, outcome in _through(client, tasks, do, on_width=on_width):
        if outcome.code == WorkerLostError.code:
            suspects.append(task)
        else:
            yield outcome
    for _, outcome in _through(client, suspects, do, most=1):
        yield replace(outcome, tries=outcome.tries + 1)


def _through(
    client: Any,
    tasks: Sequence[Task],
    do: Callable[[Task], Outcome],
    *,
    most: int | None = None,
    on_width: Callable[[int], None] = lambda _: None,
) -> Iterator[tuple[Task, Outcome]]:
    """Yield each task with its outcome as it comes; as many are with the cluster as it has threads in that round."""
    left = list(reversed(tasks))
    of: dict[Any, Task] = {}
    idle_s = 0.0
    while left or of:
        machines = threads_by_machine(client)
        threads = sum(machines.values())
        while left and len(of) < (most or max(1, threads)):
            task = left.pop()
            of[client.submit(do, replace(task, machines=machines), pure=False)] = task
        on_width(len(of))
        over = _first_over(list(of))
        idle_s = 0.0 if over or threads else idle_s + LOOK_S
        if idle_s >= NO_WORKERS_S:
            why = f"no worker was available for {NO_WORKERS_S:g} s"
            yield from ((task, _lost(task, why)) for task in (*of.values(), *reversed(left)))
            return
        for future in over:
            task = of.pop(future)
            yield task, _outcome(future, task)
            future.release()


def _first_over(futures: list[Any]) -> list[Any]:
    """Wait a while for the first of some futures, and return those that are over."""
    import distributed

    wait: Any = distributed.wait
    try:
        return list(wait(futures, timeout=LOOK_S, return_when="FIRST_COMPLETED").done)
    except TimeoutError:
        return []


def _lost(task: Task, why: str) -> Outcome:
    return Outcome(task.name, "failed", WorkerLostError.code, why[:500])


def _outcome(future: Any, task: Task) -> Outcome:
    """Return what a task gave, or what is known where its worker died first."""
    try:
        found = future.result(timeout=LOOK_S)
    except Exception as error:  # noqa: BLE001 (whatever it is, it is this session's and is listed)
        kind = type(error).__name__
        if kind == "KilledWorker":
            return _lost(task, "its workers ended repeatedly while processing it; check for lack of memory")
        return _lost(task, f"its worker failed: {kind}: {error}")
    assert isinstance(found, Outcome)
    return found
