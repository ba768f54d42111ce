"""Make a data set: each session captured by the station itself, on simulated instruments in a generated room.

A session is taken in a folder aside and moved to its name when it is complete, so that an interrupted run is simply
begun again.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.errors import DaylitError, DeviceError
from station.errors import ResourceError, SessionError, SessionExistsError
from station.session.durable import SessionLock
from station.session.folder import Folder
from station.session.session import SessionManifest, SessionStatus
from station.simulate.plan import DatasetRequest, Draft, Ledger, Planned, plan_sessions, rig_file, room_world, row_of

if TYPE_CHECKING:
    from station.capture.rig import Rig

TRUTH_FOLDER = "truth"
_UNFINISHED = ".unfinished"
# Chosen: shares of the clock's rate that are tried in turn.
_SLOWER = (1.0, 0.5, 0.2)


@dataclass(frozen=True)
class DatasetEvent:
    """What happens to a session: begun, rendering, capturing, kept, made, truth, failed."""

    kind: str
    session: str
    text: str = ""
    done: int = 0
    total: int = 0


Listener = Callable[[DatasetEvent], None]


@dataclass
class Summary:
    """What became of the sessions, by folder name."""

    into: Path
    planned: int
    made: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    failed: dict[str, dict[str, object]] = field(default_factory=dict)
    seconds: float = 0.0

    def to_dict(self) -> dict[str, object]:
        """Return the summary as plain values."""
        failed = [{"session": name, **error} for name, error in self.failed.items()]
        return {"ok": not self.failed, **vars(self), "into": str(self.into), "failed": failed}


def simulate(request: DatasetRequest, report: Listener = lambda _event: None) -> Summary:
    """Make the sessions of a data set that are not there yet, and their truths.

    A session that fails is reported and left out; the next run tries it again.

    Raises `ConditionsError`: conditions that cannot be right; `SessionExistsError`: the folder holds a data set made
    with other options; `ResourceError`: the disk is full, or refuses.
    """
    begun_s = time.monotonic()
    drafts = plan_sessions(request)
    request.into.mkdir(parents=True, exist_ok=True)
    summary = Summary(request.into, len(drafts))
    with Folder.open(request.into) as opened, SessionLock(opened):  # one process at a time
        ledger = Ledger(request.into)
        ledger.require_same(request.made_with)
        for draft in drafts:
            _attempt(draft, request, ledger, summary, report)
    summary.seconds = round(time.monotonic() - begun_s, 1)
    return summary


def _attempt(draft: Draft, request: DatasetRequest, ledger: Ledger, summary: Summary, report: Listener) -> None:
    """Make a session, or note why not: one must not end a night's work. A disk that refuses does."""
    unfinished, name = request.into / _UNFINISHED, draft.name
    shutil.rmtree(unfinished, ignore_errors=True)
    try:
        plan = draft.build()
        name = plan.folder
        (summary.made if _make(plan, request, ledger, report) else summary.kept).append(name)
    except ResourceError:
        raise
    except Exception as error:  # noqa: BLE001 (reported, with its trace)
        summary.failed[name] = _failure(error)
        report(DatasetEvent("failed", name, str(summary.failed[name]["message"])))
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _make(plan: Planned, request: DatasetRequest, ledger: Ledger, report: Listener) -> bool:
    """Make what is missing of a session; returns whether the session itself is new."""
    path = request.into / plan.folder
    report(DatasetEvent("begun", plan.folder))
    manifest = _kept(plan, path, request, ledger)
    new = manifest is None
    if manifest is None:
        manifest = _capture(plan, request, report)
    ledger.put(row_of(plan, manifest, request))
    report(DatasetEvent("made" if new else "kept", plan.folder, "" if new else "complete from an earlier run"))
    truth = request.into / TRUTH_FOLDER / plan.folder
    if request.truth and not truth.is_dir():
        from mocks.rooms.truth import point_lights, save_truth, truth_pictures

        report(DatasetEvent("rendering", plan.folder, "truth"))
        unfinished = request.into / _UNFINISHED / TRUTH_FOLDER
        world = room_world(plan, request)
        save_truth(unfinished, world.room, truth_pictures(world, request.truth_rows), point_lights(world.room))
        truth.parent.mkdir(exist_ok=True)
        unfinished.rename(truth)
        report(DatasetEvent("truth", plan.folder))
    return new


def _kept(plan: Planned, path: Path, request: DatasetRequest, ledger: Ledger) -> SessionManifest | None:
    """Return the manifest of a session that an earlier run completed, None where there is none."""
    from station.capture.rig import simulated_rig_file
    from station.session.manifest import load_manifest

    if not path.exists():
        return None
    manifest = load_manifest(path)
    before = ledger.rows.get(plan.folder)
    sizes = simulated_rig_file(rig_file(plan), request.size).model_dump(mode="json")["indoor"]["size_px"]
    other = (
        manifest.status is not SessionStatus.COMPLETE
        or manifest.name != plan.name
        or manifest.rig.get("indoor", {}).get("size_px") != sizes
        or (before is not None and before != row_of(plan, manifest, request))
    )
    if other:
        advice = "move it away, or use another folder"
        raise SessionExistsError("a different session of that name exists", where=str(path), advice=advice)
    return manifest


def _capture(plan: Planned, request: DatasetRequest, report: Listener) -> SessionManifest:
    """Capture a session aside, then give it its name.

    What a busy computer spoils (time-outs, shutters that open apart) is taken anew on a slower clock.
    """
    for share in _SLOWER:
        try:
            manifest, path = _take(plan, request, request.clock_rate * share, report)
        except DeviceError:
            if share == _SLOWER[-1]:
                raise
            continue
        complete = manifest.status is SessionStatus.COMPLETE
        in_step = all(warning.code != "start_skew" for warning in manifest.warnings)
        if complete and (in_step or share == _SLOWER[-1]):
            path.rename(request.into / plan.folder)
            return manifest
    raise SessionError(f"missing: {', '.join(manifest.missing)}", where=plan.folder, advice="run it again")


def _take(plan: Planned, request: DatasetRequest, rate: float, report: Listener) -> tuple[SessionManifest, Path]:
    """Run the station's own capture; returns the session's manifest and where it is."""
    from station.capture.capture import Capture, CaptureRequest
    from station.capture.events import EventKind

    with closing(_rig(plan, request, rate, report)) as rig:
        job = Capture.new(rig, CaptureRequest(room=plan.name, into=request.into / _UNFINISHED))
        total, done = job.n_stops * len(rig.cameras), 0
        for event in job.events():
            if event.kind is EventKind.SAVED:
                done += 1
                report(DatasetEvent("capturing", plan.folder, "", done, total))
        job.store.close()
        return job.store.manifest, job.store.path


def _rig(plan: Planned, request: DatasetRequest, rate: float, report: Listener) -> Rig:
    """Return simulated instruments in the room; their time begins when all pictures are there."""
    from mocks.instruments.bench import BenchOptions, make_bench, render_shots
    from mocks.instruments.clock import ScaledClock
    from station.capture.rig import open_simulated_rig, planned_times_s, simulated_rig_file, wanted_cameras

    def on_progress(what: str, done: int, total: int) -> None:
        report(DatasetEvent("rendering", plan.folder, what, done, total))

    file = simulated_rig_file(rig_file(plan), request.size)
    cameras, stops_s, times_s = wanted_cameras(file), file.bracket.stops_s(), planned_times_s(file)
    world, seed = room_world(plan, request), plan.room.seed + plan.index
    shots = render_shots(world, cameras, stops_s, BenchOptions(seed=seed, on_progress=on_progress, times_s=times_s))
    clock = ScaledClock(rate, plan.room.moment.utc)
    return open_simulated_rig(file, make_bench(world, cameras, stops_s, BenchOptions(seed, clock, shots=shots)))


def _failure(error: Exception) -> dict[str, object]:
    """Return an error for the summary; one that is not ours leaves a report."""
    if isinstance(error, DaylitError):
        return {"code": error.code, "message": str(error)}
    from station.errors import write_crash_report

    trace = ""
    with suppress(OSError):
        trace = str(write_crash_report(error, ["simulate"]))
    return {"code": "internal", "message": repr(error), "report": trace}
