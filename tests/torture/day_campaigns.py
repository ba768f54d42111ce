"""What a day on site brings, case by case: late partners, set clocks, a closed terminal, and a thousand captures.

`python -m benchmarks instruments` counts them, `make torture` runs all of them, `make test` some. Each function returns
what went wrong, in words; an empty list is what must be.
"""

from __future__ import annotations

import gc
import os
import random
import signal
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import timedelta
from pathlib import Path

import psutil

from drivers.canon_5d2.codes import CanonOperation, CanonProp
from drivers.errors import DaylitError
from drivers.ptp.codes import Operation
from mocks.instruments.bench import BenchOptions, make_bench
from mocks.instruments.clock import ScaledClock
from mocks.instruments.faults import Fault, FaultKind, FaultSchedule
from mocks.instruments.theta_z1 import SimulatedThetaZ1
from station.capture.capture import Capture, CaptureRequest
from station.capture.events import CaptureEvent, EventKind
from station.capture.rig import Rig, open_simulated_rig, wanted_cameras
from station.commands.following import follow
from station.commands.views import SilentView
from station.day.day import Day, DayPlan
from station.frames.check import FrameChecker
from station.session.session import SessionStatus
from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.torture.faulty_capture import (
    QUICK_THETA,
    RATE,
    RIG,
    STOPS_S,
    FaultyCapture,
    RampShots,
    SteppedClock,
    Trouble,
)

DELAYS_S = (10.0, 30.0, 58.0, 75.0, 90.0, 120.0)
STEPS_S = (-86_400.0, -3600.0, -47.0, -20.0, 20.0, 47.0, 3600.0, 86_400.0)
RELEASES = {"theta_z1": Operation.INITIATE_CAPTURE, "canon_5d2": CanonOperation.REMOTE_RELEASE_ON}
PICTURE = 0
"""In the place of an operation: the picture itself is late."""


def bracket_operations(into: Path) -> dict[str, dict[int, int]]:
    """Return, by camera kind, each operation of a bracket and which of its occurrences falls into the second stop."""
    capture = FaultyCapture(Trouble({}, (), None), into)
    assert not capture.run().wrong
    found = {}
    for kind, camera in capture.bench.cameras.items():
        codes = [record.operation for record in camera.stats.operations]
        first = codes.index(RELEASES[kind])
        before, after = Counter(codes[:first]), Counter(codes[first:])
        found[kind] = {code: before[code] + 2 for code, n in after.items() if n > 2} | {PICTURE: 2}
    return found


def late_partner(kind: str, operation: int, nth: int, delay_s: float, into: Path) -> list[str]:
    """Take a bracket in which a camera is late at an operation (answers busy to all for so long), or with a picture."""
    how = FaultKind.LATE_PICTURE if operation == PICTURE else FaultKind.HELD_UP
    fault = Fault(how, operation, nth, parameters={"delay_s": delay_s})
    for attempt in range(3):  # how often a camera is asked depends on how long it takes
        folder = into / str(attempt)
        folder.mkdir()
        outcome = FaultyCapture(Trouble({kind: FaultSchedule.of(fault)}, (), None), folder).run()
        if outcome.fired:
            return outcome.wrong
    return ["the camera was not late"]


def clock_step(at_pair: int, step_s: float, into: Path) -> list[str]:
    """Take a bracket during which the computer's clock is set: no frame may be rejected, and no time disturbed."""
    capture = FaultyCapture(Trouble({}, (), None, (at_pair, step_s)), into)
    outcome = capture.run()
    wrong = list(outcome.wrong)
    (path,) = into.iterdir()
    with SessionStore.open(path, writable=False) as store:
        manifest = store.manifest
    wrong += [f"rejected: {record.reason}" for record in manifest.rejected]
    if outcome.fired and "clock_step" not in {warning.code for warning in manifest.warnings}:
        wrong.append("the step was not noticed")
    apart = {
        round(frame.taken_utc.timestamp() - (frame.release_monotonic_s or 0.0), 1)
        for frame in manifest.frames
        if frame.taken_utc
    }
    # A resume, for something else, begins with the clock as it is then.
    several = not outcome.resumes and max(apart) - min(apart) > 0.2
    return wrong + [f"times by {len(apart)} clocks"] * several


class _Terminal(SilentView):
    """A terminal that is closed at some event: SIGHUP, twice as they come, and no output from then on."""

    def __init__(self, at_event: int, acknowledged: dict[str, int]) -> None:
        self._at, self._n = at_event, 0
        self._acknowledged = acknowledged

    def show(self, event: CaptureEvent) -> None:
        self._n += 1
        if event.kind is EventKind.SAVED:
            self._acknowledged[str(event.data["file"])] = int(event.data["size_bytes"])
        if self._n >= self._at:
            if self._n == self._at:
                os.kill(os.getpid(), signal.SIGHUP)
                os.kill(os.getpid(), signal.SIGHUP)
            raise OSError(5, "Input/output error")


def closed_terminal(at_event: int, into: Path) -> list[str]:
    """Close the terminal of a capture at an event; all cameras must be free, and the session complete when resumed."""
    capture, acknowledged = FaultyCapture(Trouble({}, (), None), into), dict[str, int]()
    wrong: list[str] = []
    with capture._rig(None) as rig:
        job = Capture.new(rig, CaptureRequest(room="Room", into=into, stops_s=STOPS_S))
        with suppress(DaylitError):  # a busy computer is late for simulated limits, too: then there was no terminal
            if not follow(job, _Terminal(at_event, acknowledged)):
                wrong.append("SIGHUP was not taken for an end")
        if job.has_store:
            job.store.close()
    canon = capture.bench.cameras["canon_5d2"]
    if canon.half_pressed or canon.remote_mode:
        wrong.append("the 5D Mark II is left in remote mode, or half pressed")
    outcome = capture.run()
    (path,) = into.iterdir()
    wrong += [f"lost: {file}" for file, size in acknowledged.items() if (path / file).stat().st_size != size]
    return wrong + [text for text in outcome.wrong if "never made" not in text]


@dataclass
class Soak:
    """What a thousand captures in one process showed."""

    captures: int = 0
    faults: int = 0
    resumes: int = 0
    lost: int = 0
    growth_pct: float = 0.0
    wrong: list[str] = field(default_factory=list)


def soak(captures: int, into: Path, *, fault_frac: float = 0.01, seed: int = 20230519) -> Soak:
    """Take captures on one rig, with faults in a share of their frames; memory is compared after the first tenth."""
    result, stops_s = Soak(), STOPS_S[2:]
    n_frames = captures * 2 * len(stops_s)
    rng = random.Random(seed)
    faults = {kind: FaultSchedule(_faults(kind, n_frames // 2, fault_frac, rng)) for kind in RELEASES}
    file = RIG.model_copy(
        update={side: getattr(RIG, side).model_copy(update={"delete_after": True}) for side in ("indoor", "outdoor")}
    )
    shots = {kind: RampShots() for kind in RELEASES}
    options = BenchOptions(
        clock=ScaledClock(RATE), timing={"theta_z1": QUICK_THETA}, shots=shots, faults=faults, measuring_s=0.5
    )
    bench = make_bench("uniform:100", wanted_cameras(file), stops_s, options)
    rig = open_simulated_rig(file, bench)
    rig.checkers = {side: FrameChecker() for side in rig.cameras}
    # Off, as docs/guides/hardware.md asks: a minute of simulated time is less than a busy computer takes for a process.
    bench.cameras["canon_5d2"].settings.values[CanonProp.AUTO_POWER_OFF] = 0
    held: list[tuple[float, int, int]] = []
    for number in range(captures):
        _soak_one(rig, into, stops_s, result)
        for camera in bench.cameras.values():  # what the simulation remembers is not the station's
            camera.stats.operations.clear()
            camera.exposure_log.clear()
        for source in shots.values():
            source.made.clear()
        if number in (captures // 10, captures - 1):
            held.append(_held())
    result.faults = sum(len(camera.faults.fired) for camera in bench.cameras.values())
    rig.close()
    (first_mb, first_fds, first_threads), (last_mb, last_fds, last_threads) = held
    result.growth_pct = 100 * (last_mb / first_mb - 1)
    if (last_fds, last_threads) != (first_fds, first_threads):
        result.wrong.append(f"{first_fds} files and {first_threads} threads became {last_fds} and {last_threads}")
    return result


def _faults(kind: str, n_frames: int, fault_frac: float, rng: random.Random) -> tuple[Fault, ...]:
    """Draw faults of pictures, of transfers and of releases, spread over the captures."""
    drawn = []
    for _ in range(round(n_frames * fault_frac)):
        nth = rng.randint(3, n_frames)
        drawn.append(
            rng.choice(
                (
                    Fault(FaultKind.TRUNCATED_JPEG, nth=nth),
                    Fault(FaultKind.WRONG_EXPOSURE, nth=nth),
                    Fault(FaultKind.NO_ANSWER, Operation.GET_PARTIAL_OBJECT, nth),
                    Fault(FaultKind.UNPLUG, Operation.GET_PARTIAL_OBJECT, nth, parameters={"replug_after_s": 2.0}),
                    Fault(FaultKind.BUSY, RELEASES[kind], nth, times=2),
                    Fault(FaultKind.HELD_UP, Operation.GET_PARTIAL_OBJECT, nth, parameters={"delay_s": 3.0}),
                )
            )
        )
    return tuple(drawn)


def _soak_one(rig: Rig, into: Path, stops_s: tuple[float, ...], result: Soak) -> None:
    """Take one capture, resumed until it is complete, and verify it."""
    acknowledged: set[str] = set()
    result.captures += 1
    path: Path | None = None
    for attempt in range(3):
        result.resumes += attempt > 0
        if path is None:
            job = Capture.new(rig, CaptureRequest(room=f"Room {result.captures}", into=into, stops_s=stops_s))
        else:
            job = Capture.resume(rig, SessionStore.open(path, writable=True, clock=rig.clock))
        try:
            acknowledged |= {str(e.data["file"]) for e in job.events() if e.kind is EventKind.SAVED}
        except DaylitError as error:
            result.wrong += [f"capture {result.captures}: {error}"] * (attempt == 2)
        path = job.store.path if job.has_store else path
        complete = job.has_store and job.store.manifest.status is SessionStatus.COMPLETE
        if job.has_store:
            job.store.close()
        if complete:
            break
    report = verify_session(path) if path else None
    if report is None or not report.intact or report.status != "complete":
        result.lost += 1
        why = report.problems or report.missing if report else "no session"
        result.wrong.append(f"capture {result.captures}: {why}")
        return
    result.lost += sum(not ((path or into) / file).exists() for file in acknowledged)


def _held() -> tuple[float, int, int]:
    """Return resident megabytes, open files and threads of this process."""
    gc.collect()
    process = psutil.Process()
    return process.memory_info().rss / 1e6, process.num_fds(), threading.active_count()


def late_cases(
    operations: dict[str, dict[int, int]], delays_s: tuple[float, ...]
) -> Iterator[tuple[str, int, int, float]]:
    """Yield camera kind, operation, occurrence and delay: either camera, every state, every delay."""
    for kind, occurrences in operations.items():
        for operation, nth in sorted(occurrences.items()):
            yield from ((kind, operation, nth, delay_s) for delay_s in delays_s)


EVERY_S = 150.0


def day(into: Path, brackets: int = 9) -> tuple[list[str], Counter[EventKind]]:
    """Take brackets by the hour (here 150 s) on one rig, with a camera unplugged, a battery changed and the clock set.

    The 5D Mark II switches itself off after a minute unless somebody keeps it awake. Returns what went wrong, and how
    many events of each kind there were.
    """
    base = ScaledClock(RATE)
    wall, stops_s = SteppedClock(base), STOPS_S[2:]
    shots = {kind: RampShots() for kind in RELEASES}
    options = BenchOptions(clock=base, timing={"theta_z1": QUICK_THETA}, shots=shots, measuring_s=0.5)
    bench = make_bench("uniform:100", wanted_cameras(RIG), stops_s, options)
    rig = open_simulated_rig(RIG, bench, clock=wall)
    theta, canon = bench.cameras["theta_z1"], bench.cameras["canon_5d2"]
    assert isinstance(theta, SimulatedThetaZ1)
    until = rig.clock.utc_now() + timedelta(seconds=(brackets - 0.5) * EVERY_S)
    job = Day(rig, DayPlan(("Room",), EVERY_S, until), CaptureRequest(room="Room", into=into, stops_s=stops_s))
    kinds: Counter[EventKind] = Counter()
    for event in job.events():
        kinds[event.kind] += 1
        if event.kind is EventKind.FINISHED and kinds[event.kind] == 2:
            canon.unplug()
        if event.kind is EventKind.WAITING and "outdoor: not found" in event.text:
            canon.replug()
        if event.kind is EventKind.FINISHED and kinds[event.kind] == 3:
            theta.options = replace(theta.options, battery_percent=3)
        if event.kind is EventKind.WAITING and "battery" in event.text:
            theta.unplug(10.0)
            theta.options = replace(theta.options, battery_percent=95)
        if event.kind is EventKind.FINISHED and kinds[event.kind] == 4:
            wall.step_s = -20.0
    rig.close()
    wrong = [f"missed: {missed}" for missed in job.missed]
    wrong += [f"{t.path.name}: {t.manifest.missing}" for t in job.taken if t.manifest.status is SessionStatus.PARTIAL]
    wrong += [f"{t.path.name}: {p}" for t in job.taken for p in verify_session(t.path).problems]
    wrong += [f"{t.path.name}: rejected {r.reason}" for t in job.taken for r in t.manifest.rejected]
    if len(job.taken) != brackets:
        wrong.append(f"{len(job.taken)} sessions, not {brackets}")
    return wrong, kinds
