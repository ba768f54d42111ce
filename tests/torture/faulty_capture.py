"""A whole capture on simulated instruments under faults, resumed with sound ones until complete, and judged."""

from __future__ import annotations

import gc
import hashlib
import io
import os
import random
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import psutil
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from drivers.clock import Clock
from drivers.errors import DaylitError
from mocks.instruments.bench import BenchOptions, make_bench
from mocks.instruments.clock import ScaledClock
from mocks.instruments.exposures import ShotRequest
from mocks.instruments.faults import Fault, FaultKind, FaultSchedule
from mocks.instruments.ls160 import MeterFault, MeterFaultKind
from mocks.instruments.theta_z1 import THETA_TIMING
from station.capture.capture import Capture, CaptureRequest
from station.capture.conductor import LAST_TRANSFERS_LIMIT_S, SET_UP_LIMIT_S
from station.capture.events import EventKind
from station.capture.rig import Rig, open_simulated_rig, wanted_cameras
from station.capture.rig_file import CameraTable, LimitsTable, MeterTable, RigFile
from station.session.session import FrameRecord, SessionManifest, SessionStatus, Side
from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.mocks.instruments.fault_dicts import dict_of

STOPS_S = (1 / 4, 1 / 15, 1 / 60, 1 / 250)
RIG = RigFile(
    indoor=CameraTable(kind="theta_z1", iso=100, f_number=5.6, size_px=(96, 48)),
    outdoor=CameraTable(kind="canon_5d2", iso=200, f_number=16, size_px=(96, 64), nd_filter="ND 3.0"),
    meter=MeterTable(dialect="ls160", samples=1),
    limits=LimitsTable(min_free_disk_mb=0, max_start_skew_s=1.0),
)
KINDS = {Side.INDOOR: "theta_z1", Side.OUTDOOR: "canon_5d2"}
RATE = 20.0
"""Times faster than life: the shortest limit of the drivers (1 s) is 50 ms then, more than a busy machine is late."""
QUICK_THETA = replace(THETA_TIMING, processing_s=0.9, dated_after_s=0.9)
"""Three times faster than life: its true times would only make the campaigns longer."""
MAX_RESUMES = 4
SILENCE_LIMIT_S = SET_UP_LIMIT_S + 2 * max(STOPS_S) + 90.0
"""Longest time without an event: a camera made ready, an exposure with its grace, one recovery."""
RUN_LIMIT_S = 4 * SILENCE_LIMIT_S + LAST_TRANSFERS_LIMIT_S
LEAVE_LIMIT_S = 20.0
"""Wall time for threads and processes to be gone after the end."""
SHOT_FAULTS = (FaultKind.WRONG_EXPOSURE, FaultKind.BLACK_FRAME, FaultKind.REPEATED_FRAME, FaultKind.TRUNCATED_JPEG)


class RampShots:
    """Small pictures of a ramp of light, as bright as the exposure makes them; each kept by its digest."""

    def __init__(self) -> None:
        self.made: dict[str, ShotRequest] = {}

    def jpeg(self, request: ShotRequest) -> bytes:
        width, height = request.width_px, request.height_px
        light = np.geomspace(1e-3, 1e3, width)[None, :] * np.ones((height, 1))
        values = np.clip(255 * (light * request.shutter_s * 30) ** (1 / 2.2), 0, 255)
        noise = np.random.default_rng(len(self.made)).normal(0, 2, values.shape)
        pixels = np.clip(values + noise * (values > 3), 0, 255).astype(np.uint8)
        buffer = io.BytesIO()
        picture = Image.fromarray(np.repeat(pixels[..., None], 3, axis=2))
        picture.save(buffer, "JPEG", quality=92, exif=_exif(request))
        data = buffer.getvalue()
        self.made[hashlib.sha256(data).hexdigest()] = request
        return data

    def raw(self, request: ShotRequest) -> bytes:
        raise AssertionError("no raw frame was asked for")


def _exif(request: ShotRequest) -> Image.Exif:
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = request.manufacturer, request.model
    details = exif.get_ifd(0x8769)
    details[0x829A] = IFDRational(round(request.shutter_s * 1_000_000), 1_000_000)
    details[0x829D] = IFDRational(round(request.f_number * 10), 10)
    details[0x8827] = request.iso
    details[0x9003] = request.taken_local.strftime("%Y:%m:%d %H:%M:%S")
    exif[0x8769] = details
    return exif


class SteppedClock:
    """A computer's clock whose wall time somebody sets; its monotonic time is that of the simulation."""

    def __init__(self, base: Clock) -> None:
        self.base = base
        self.step_s = 0.0

    def monotonic_s(self) -> float:
        return self.base.monotonic_s()

    def utc_now(self) -> datetime:
        return self.base.utc_now() + timedelta(seconds=self.step_s)

    def sleep(self, duration_s: float) -> None:
        self.base.sleep(duration_s)


@dataclass(frozen=True)
class Trouble:
    """What goes wrong in one capture; ``abandoned_at`` is the number of the event after which nobody listens.

    ``step``: at which pair of exposures, from 1, the computer's clock is set, and by how many seconds.
    """

    cameras: dict[str, FaultSchedule]
    meter: tuple[MeterFault, ...]
    abandoned_at: int | None
    step: tuple[int, float] = (0, 0.0)

    def words(self) -> str:
        """Return it for a report."""
        cameras = {kind: [dict_of(f) for f in schedule.faults] for kind, schedule in self.cameras.items()}
        return f"{cameras}, meter {[f.kind for f in self.meter]}, abandoned at {self.abandoned_at}"


def draw_trouble(rng: random.Random, pools: dict[str, list[Fault]]) -> Trouble:
    """Return one to three faults, of cameras and meter, and sometimes an abandoned capture."""
    faults: dict[str, list[Fault]] = {kind: [] for kind in pools}
    meter: list[MeterFault] = []
    for _ in range(rng.randint(1, 3)):
        where = rng.choice([*pools, *pools, "shot", "meter"])
        if where == "meter":
            first = rng.randint(1, 2)
            meter.append(MeterFault(rng.choice(list(MeterFaultKind)), first, rng.choice((first, 9))))
        elif where == "shot":
            faults[rng.choice(list(pools))].append(Fault(rng.choice(SHOT_FAULTS), nth=rng.randint(1, len(STOPS_S))))
        else:
            faults[where].append(rng.choice(pools[where]))
    abandoned_at = rng.randint(1, 60) if rng.random() < 0.3 else None
    return Trouble({k: FaultSchedule(tuple(f)) for k, f in faults.items()}, tuple(meter), abandoned_at)


@dataclass
class Outcome:
    """What a faulty capture and its resumes showed; ``wrong`` must be empty."""

    wrong: list[str] = field(default_factory=list)
    fired: int = 0
    resumes: int = 0
    acknowledged: dict[str, str] = field(default_factory=dict)
    """File -> digest, of every frame that was called saved."""
    errors: list[str] = field(default_factory=list)
    longest_silence_s: float = 0.0


class FaultyCapture:
    """One capture under trouble, then resumed."""

    def __init__(self, trouble: Trouble, into: Path) -> None:
        self.trouble, self.into = trouble, into
        self.shots = {kind: RampShots() for kind in KINDS.values()}
        self.outcome = Outcome()

    def run(self) -> Outcome:
        """Run it, resume it until complete, and judge what is on disk."""
        with nothing_left_behind(self.outcome, self.into):
            self._attempt(self.trouble)
            while self.outcome.resumes < MAX_RESUMES and not self._complete():
                self.outcome.resumes += 1
                self._attempt(None)
        self._judge()
        return self.outcome

    @contextmanager
    def _rig(self, trouble: Trouble | None) -> Iterator[Rig]:
        clock = ScaledClock(RATE)
        options = BenchOptions(
            clock=clock,
            timing={"theta_z1": QUICK_THETA},
            shots=self.shots,
            faults=trouble.cameras if trouble else {},
            meter_faults=trouble.meter if trouble else (),
            measuring_s=0.5,
        )
        bench = self.bench = make_bench("uniform:100", wanted_cameras(RIG), STOPS_S, options)
        self.wall = SteppedClock(clock)
        rig = open_simulated_rig(RIG, bench, clock=self.wall)
        try:
            yield rig
        finally:
            self.outcome.fired += sum(len(camera.faults.fired) for camera in bench.cameras.values())
            if trouble and trouble.meter and bench.meter.n_measured >= trouble.meter[0].first:
                self.outcome.fired += 1
            rig.close()

    def _attempt(self, trouble: Trouble | None) -> None:
        """Capture, or go on with what is there; `DaylitError` kinds may end it, and nothing else."""
        with self._rig(trouble) as rig:
            try:
                self._listen(rig, trouble or Trouble({}, (), None))
            except DaylitError as error:
                self.outcome.errors.append(f"{type(error).__name__}: {error}")
            except Exception as error:
                self.outcome.wrong.append(f"escaped: {type(error).__name__}: {error}")

    def _listen(self, rig: Rig, trouble: Trouble) -> None:
        sessions = list(self.into.iterdir())
        store = SessionStore.open(sessions[0], writable=True) if sessions else None
        if store is None:
            job = Capture.new(rig, CaptureRequest(room="Room", into=self.into, stops_s=STOPS_S))
        else:
            job = Capture.resume(rig, store)
        begun_s = before_s = rig.clock.monotonic_s()
        events, stops = job.events(), 0
        for number, event in enumerate(events, 1):
            now_s = rig.clock.monotonic_s()
            self.outcome.longest_silence_s = max(self.outcome.longest_silence_s, now_s - before_s)
            before_s = now_s
            if event.kind is EventKind.SAVED:
                file = str(event.data["file"])
                self.outcome.acknowledged[file] = _digest(job.store.path / file)
            stops += event.kind is EventKind.STOP
            if event.kind is EventKind.STOP and stops == trouble.step[0]:
                self.outcome.fired += 1
                self.wall.step_s = trouble.step[1]
            if number == trouble.abandoned_at:
                self.outcome.fired += 1
                events.close()
                break
        else:
            job.store.close()
        if rig.clock.monotonic_s() - begun_s > RUN_LIMIT_S:
            self.outcome.wrong.append(f"a run took {rig.clock.monotonic_s() - begun_s:.0f} s")

    def _manifest(self) -> tuple[Path, SessionManifest] | None:
        sessions = list(self.into.iterdir())
        if not sessions:
            return None
        with SessionStore.open(sessions[0], writable=False) as store:
            return sessions[0], store.manifest

    def _complete(self) -> bool:
        """Whether nothing is missing, and the manifest has caught up with the journal."""
        found = self._manifest()
        return found is not None and found[1].status is SessionStatus.COMPLETE and verify_session(found[0]).intact

    def _judge(self) -> None:
        wrong = self.outcome.wrong
        found = self._manifest()
        if found is None:
            wrong.append("there is no session in the end")
            return
        path, manifest = found
        if manifest.status is not SessionStatus.COMPLETE:
            wrong.append(
                f"not complete after {self.outcome.resumes} resumes: {manifest.missing}; {self.outcome.errors}"
            )
        if self.outcome.longest_silence_s > SILENCE_LIMIT_S:
            wrong.append(f"silent for {self.outcome.longest_silence_s:.0f} s")
        report = verify_session(path)
        if not report.intact:
            wrong.append(f"verify: {report.problems}")
        for file, digest in self.outcome.acknowledged.items():
            in_place = (path / file).exists() and _digest(path / file) == digest
            if not in_place and not _black_and_replaced(file, digest, path, manifest):
                wrong.append(f"acknowledged frame lost: {file}")
        wrong += [text for frame in manifest.frames if (text := self._wrong_with(frame, path, manifest))]

    def _wrong_with(self, frame: FrameRecord, path: Path, manifest: SessionManifest) -> str:
        """Hold a frame of the session against what its camera made for which shutter."""
        made = self.shots[KINDS[frame.side]].made.get(_digest(path / frame.file))
        if made is None:
            named = _black_and_named(path / frame.file, manifest)
            return "" if named else f"{frame.file}: bytes that the camera never made"
        asked_s = manifest.bracket.stops_s[frame.stop]
        if max(abs(time_s / asked_s - 1) for time_s in (made.shutter_s, frame.exif_s or 0.0)) > 0.01:
            return f"misfiled: {frame.file} is of {made.shutter_s:g} s"
        return ""


def _black_and_replaced(file: str, digest: str, path: Path, manifest: SessionManifest) -> bool:
    """Whether a frame was black and made room for a better one of its stop: its bytes are kept, and it is listed."""
    for record in manifest.rejected:
        if record.file is None or _digest(path / record.file) != digest:
            continue
        better = manifest.frame(record.side, record.stop)
        return better is not None and file.startswith(record.side) and _is_black(path / record.file)
    return False


def _black_and_named(path: Path, manifest: SessionManifest) -> bool:
    """Whether a black frame, which could be right while nothing brighter was known, is named in the end."""
    side = path.parent.name
    named = any(w.code == "brightness_order" and w.message.startswith(side) for w in manifest.warnings)
    return named and _is_black(path)


def _is_black(path: Path) -> bool:
    with Image.open(path) as picture:
        return max(high for _, high in picture.getextrema()) == 0


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextmanager
def nothing_left_behind(outcome: Outcome, folder: Path) -> Iterator[None]:
    """Note threads, processes and open files that are still there some seconds after.

    Ordinary files elsewhere than in ``folder`` do not count: what libraries keep open of their own.
    """

    def held() -> Counter[str]:
        names = [f"thread {thread.name}" for thread in threading.enumerate()]
        names += [f"process {child.pid}" for child in psutil.Process().children()]
        return Counter(names + _open_files(folder))

    before = held()
    yield
    deadline_s = time.monotonic() + LEAVE_LIMIT_S
    while (left := held() - before) and time.monotonic() < deadline_s:
        time.sleep(0.02)
        gc.collect()
    if left:
        outcome.wrong.append(f"left behind: {sorted(left)}")


def _open_files(folder: Path) -> list[str]:
    """Return what this process has open: sockets, pipes and devices by kind, and files in a folder by name."""
    found = []
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            target = os.readlink(f"/proc/self/fd/{number}")
            if not target.startswith("/"):
                found.append(target.partition(":[")[0])
            elif target.startswith((str(folder), "/dev/")):
                found.append(target)
    return found
