"""Frames are read and decoded in a process of their own, whose death is no more than a refused frame.

The station's own process never decodes a stranger's bytes, so its memory and its interpreter lock stay free. What the
worker gives up before the first file is in `station.frames.worker`; what it answers is held against `FrameFacts`.
Waiting here is waiting for a process of the operating system, so it goes by the system's clock, not an injected one.
"""

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import IO, Any, Literal

from pydantic import ValidationError

from station.errors import FrameRejectedError, ResourceError
from station.frames.facts import ExpectedFrame, FrameFacts
from station.frames.problems import Reason
from station.frames.rules import check_order, judge, printable, rejection
from station.session.session import FrameRecord

# Limits of the worker, chosen: counting every pixel of 22 Mpx takes 0.4 s.
MEMORY_BYTES = 2 * 2**30
LIMIT_S = 20.0  # chosen: a hundred times what a good frame takes
CPU_S = 15  # chosen: the same, without the waiting
START_LIMIT_S = 30.0  # chosen: Python's start on a busy machine
MAX_ANSWER_BYTES = 100_000  # chosen: a few lines of JSON
RawFormat = Literal["cr2", "dng"]
PictureFormat = Literal["jpeg", "png", "tiff", "cr2", "dng"]
_FORMATS: dict[str, PictureFormat] = {".png": "png", ".tif": "tiff", ".tiff": "tiff", ".cr2": "cr2", ".dng": "dng"}
_KEPT_VARIABLES = ("PATH", "SYSTEMROOT", "TEMP", "TMP", "TMPDIR", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "PYTHONHOME")
__all__ = ["ExpectedFrame", "FrameChecker", "FrameFacts", "FrameRejectedError", "Reason", "check_order", "judge"]


def picture_format(path: Path) -> PictureFormat:
    """Return what a picture is by its name; whatever else it says: a JPEG."""
    return _FORMATS.get(path.suffix.lower(), "jpeg")


class _WorkerGoneError(Exception):
    """The worker ended, or answered nonsense, while it had a file in hand."""


class _WorkerSlowError(Exception):
    """The worker did not answer within the limit."""


class _Worker:
    """One worker process and the thread that waits for its answers."""

    def __init__(self, memory_bytes: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "station.frames.worker", str(memory_bytes)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=_environment(),
            start_new_session=True,  # Ctrl-C is for the station
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._requests: IO[bytes] = self._process.stdin
        self._answers: queue.Queue[bytes] = queue.Queue()
        self._reader = threading.Thread(
            target=_read_lines, args=(self._process.stdout, self._answers), daemon=True, name="frame-worker-reader"
        )
        self._reader.start()

    def receive(self, limit_s: float) -> dict[str, Any]:
        """Return the next answer."""
        try:
            line = self._answers.get(timeout=limit_s)
        except queue.Empty:
            raise _WorkerSlowError(f"no answer within {limit_s:g} s") from None
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError):
            answer = None
        if not isinstance(answer, dict):
            raise _WorkerGoneError(self.end())
        return answer

    def send(self, request: dict[str, Any]) -> None:
        """Send a request; a request is short, so a living worker's pipe always has room for it."""
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
        except OSError:
            raise _WorkerGoneError(self.end()) from None

    def end(self) -> str:
        """End the process, wait for it, and return how it ended."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(0.1)
        self._process.kill()
        code = self._process.wait(10)
        self._reader.join(10)
        with suppress(OSError):
            self._requests.close()
        return f"ended by signal {-code}" if code < 0 else f"ended with code {code}"


def _read_lines(answers: IO[bytes], into: queue.Queue[bytes]) -> None:
    """Pass bounded lines on until the worker ends; an empty line says that it has."""
    with answers:
        while line := answers.readline(MAX_ANSWER_BYTES):
            into.put(line)
    into.put(b"")


def _environment() -> dict[str, str]:
    """Return what the worker needs to start, and none of the user's other variables."""
    kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
    paths = [str(Path(__file__).resolve().parents[2]), *(str(Path(p).resolve()) for p in sys.path if p)]
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    return {**kept, **threads, "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)), "OPENCV_LOG_LEVEL": "OFF"}


class FrameChecker(AbstractContextManager["FrameChecker"]):
    """Checks frames in a worker process that is started when first needed, and anew when it had to be ended.

    Usable from several threads, one file at a time; close it, or use it in a ``with`` statement.

    ``limit_s``: longest wait for one file, seconds. At most twice as long passes, for a worker that died is given a
      second try.
    ``cpu_s``: processor time for one file, seconds.
    ``memory_bytes``: address space of the worker.
    """

    def __init__(self, *, limit_s: float = LIMIT_S, cpu_s: int = CPU_S, memory_bytes: int = MEMORY_BYTES) -> None:
        self.deaths = 0
        """How many workers died or had to be ended."""
        self.limits: tuple[str, ...] = ()
        """What the worker gave up, in words (for `daylit doctor`)."""
        self._limit_s = limit_s
        self._cpu_s = cpu_s
        self._memory_bytes = memory_bytes
        self._lock = threading.Lock()
        self._worker: _Worker | None = None

    def __exit__(self, *_error: object) -> None:
        self.close()

    def start(self) -> None:
        """Start the worker now, so that the first frame need not wait for it (about half a second)."""
        with self._lock:
            self._ready_worker()

    def close(self) -> None:
        """End the worker; a later check starts another."""
        with self._lock:
            self._drop_worker()

    def check(
        self, path: Path, due: ExpectedFrame, *, exact: bool = False, earlier: Sequence[FrameFacts] = (), name: str = ""
    ) -> FrameFacts:
        """Read a JPEG and hold it against what was asked and against ``earlier`` frames of the same camera.

        ``exact``: count every pixel (0.4 s for 22 Mpx); otherwise block means at 1/8 scale (0.08 s).
        ``name``: what messages call the file; its own name if empty (a temporary file has none worth telling).

        Raises `FrameRejectedError`: the file in ``where``, the name of the reason in ``details["reason"]``
        (`station.frames.facts.Reason`); `ResourceError`: the worker cannot be started.
        """
        facts = self.inspect(path, exact=exact, name=name, circle=due.image_circle)
        judge(facts, due, earlier)
        return facts

    def check_raw(self, path: Path, format_: RawFormat, *, name: str = "") -> FrameFacts:
        """Check magic, size and directories of a raw companion; raises as `check`."""
        return self._inspect(path, name, {"format": format_, "exact": False})

    def inspect(
        self, path: Path, *, exact: bool = False, name: str = "", circle: tuple[float, float, float] | None = None
    ) -> FrameFacts:
        """Return the facts of a picture that is whole; raises as `check`, but holds it against nothing.

        By its name it is a PNG, a TIFF, a raw file, or else a JPEG. ``circle``: see `ExpectedFrame.image_circle`.
        """
        format_ = picture_format(Path(name) if name else path)
        return self._inspect(path, name, {"format": format_, "exact": exact, "circle": circle, "pixels": True})

    def verify_frame(self, path: Path, record: FrameRecord) -> str | None:
        """Say what is wrong with a frame of a session, or None: a `station.session.verify.FrameCheck`.

        A decoder sees broken data, not every changed bit; that nothing changed since capture is what the
        SHA-256 in the manifest proves, which `station.session.verify` compares first.
        """
        asked = record.exif_s, record.iso, record.f_number, record.width_px, record.height_px
        expected = ExpectedFrame(*asked, require_exif=False, light_expected=False)
        try:
            if record.format == "cr2" or record.format == "dng":
                self.check_raw(path, record.format)
            else:
                self.check(path, expected)
        except FrameRejectedError as error:
            return error.message
        return None

    def _inspect(self, path: Path, name: str, request: dict[str, Any]) -> FrameFacts:
        name = printable(name or path.name)
        request = {**request, "path": str(path.absolute()), "cpu_s": self._cpu_s}
        with self._lock:
            answer = self._ask(name, request)
        return _facts(name, answer)

    def _ask(self, name: str, request: dict[str, Any]) -> dict[str, Any]:
        """Return the worker's answer; one that died is replaced and asked once more, a slow one is not."""
        how = ""
        for _ in range(2):
            worker = self._ready_worker()
            try:
                worker.send(request)
                answer = worker.receive(self._limit_s)
            except _WorkerSlowError as error:
                self._drop_worker(died=True)
                raise rejection(name, Reason.TOO_SLOW, f"reading it gave {error}") from None
            except _WorkerGoneError as error:
                how = str(error)
                self._drop_worker(died=True)
                continue
            if answer.get("reason") == Reason.TOO_MUCH_MEMORY:
                self._drop_worker(died=True)
            return answer
        raise rejection(name, Reason.DECODER_DIED, f"reading it crashes the decoder ({how})", "do not open it")

    def _ready_worker(self) -> _Worker:
        if self._worker is not None:
            return self._worker
        worker = _Worker(self._memory_bytes)
        try:
            hello = worker.receive(START_LIMIT_S)
        except (_WorkerSlowError, _WorkerGoneError) as error:
            how = worker.end()
            text = f"the process that checks frames does not start: {error}"
            likely = f"out of memory, or a broken installation (process {how})"
            raise ResourceError(text, where="frame checker", likely=likely, advice="run `daylit doctor`") from None
        self.limits = tuple(str(limit)[:200] for limit in hello.get("limits", ()))
        self._worker = worker
        return worker

    def _drop_worker(self, *, died: bool = False) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.end()
            self.deaths += died


def _facts(name: str, answer: dict[str, Any]) -> FrameFacts:
    """Turn an answer into facts or a refusal; nothing the worker says is taken unchecked."""
    if answer.get("ok") is not True:
        reason = {str(reason): reason for reason in Reason}.get(str(answer.get("reason")), Reason.DAMAGED)
        raise rejection(name, reason, str(answer.get("message", ""))[:500])
    try:
        return FrameFacts.model_validate({**answer.get("facts", {}), "name": name})
    except (ValidationError, TypeError) as error:
        raise rejection(name, Reason.DECODER_DIED, "the decoder gave an inconsistent answer") from error
