"""What a worker does for one session: run it in a process of its own, and say what became of it.

It returns an outcome whatever happens to the session; only the worker's own end is left to the cluster to notice. The
process is a child of this module as a program, ``python -m processing.batch.work PARENT``: what a session can do to it
(run out of memory, crash in a library, hang) so never reaches the worker, and it dies with the worker that began it, so
that it does not hold the session's lock.
"""

import ctypes
import gc
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

from processing.batch.cluster import here_among, thread_settings, threads_each
from processing.errors import SessionKilledError, SessionTimeoutError

State = Literal["done", "failed"]
BROKEN = "internal"  # code of what is a fault of the program
_MOST_TEXT = 2000  # characters of a message in a table; chosen
_GRACE_S = 10.0  # chosen: a killed process is gone sooner
_PR_SET_PDEATHSIG = 1  # of prctl(2)


@dataclass(frozen=True)
class Task:
    """One session and what is asked of it; plain values, to be sent to a worker."""

    session: str
    """Its folder, as the workers see it."""
    name: str
    """For people: its folder within the batch's."""
    arguments: tuple[str, ...]
    """Of `daylit process`, without the session."""
    timeout_s: float
    machines: Mapping[str, int] = field(default_factory=dict)
    """Sessions at once on each machine of the cluster: they share its cores."""
    zone: str | None = None
    """For dates and times of the table; None: each session's own."""


@dataclass(frozen=True)
class Outcome:
    """What became of a session."""

    session: str
    """Its folder within the batch's."""
    state: State
    code: str = ""
    """Of the error, empty where it is done."""
    message: str = ""
    stages: Mapping[str, str] = field(default_factory=dict)
    """What became of each stage, in words of `daylit process`."""
    warnings: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_bytes: int = 0
    tries: int = 1
    row: Mapping[str, str] = field(default_factory=dict)
    """Of the table: what is known of the session (`processing.batch.rows`)."""


def work(task: Task) -> Outcome:
    """Process a session and return what became of it. A process that was killed is tried once more."""
    from processing.batch.rows import session_row

    path = Path(task.session)
    begun_s = time.monotonic()
    outcome = _once(task)
    if outcome.code == SessionKilledError.code:
        outcome = replace(_once(task), tries=2)
    with suppress(Exception):  # the table's row must not spoil the outcome
        outcome = replace(outcome, row=session_row(path, task.zone))
    return replace(outcome, seconds=round(time.monotonic() - begun_s, 3))


def _once(task: Task) -> Outcome:
    """Run the session's process once, killed after the time allowed."""
    limits = thread_settings(threads_each(here_among(task.machines)))
    with tempfile.TemporaryDirectory(prefix="daylit-said-") as place:
        server = Warm.idle(limits)
        try:
            code = server.run(["process", task.session, "--json", *task.arguments], Path(place), task.timeout_s)
        except TimeoutError:
            message = f"not done after {task.timeout_s:g} s; results of finished stages are kept"
            return Outcome(task.name, "failed", SessionTimeoutError.code, message)
        out, err = ((Path(place) / name).read_text("utf-8", "replace") for name in ("out", "err"))
    return outcome_of(task.name, code, out, err)


class Warm:
    """A process with everything imported, which forks one child a session: start-up is paid once a worker.

    Whatever a session does to its child (a crash, all memory, a hang) ends with it; the server itself computes nothing.
    """

    _at_rest: ClassVar[list["Warm"]] = []
    _lock: ClassVar[threading.Lock] = threading.Lock()

    def __init__(self, limits: Mapping[str, str]) -> None:
        root, known = str(Path(__file__).resolve().parents[2]), os.environ.get("PYTHONPATH", "")
        path = f"{root}{os.pathsep}{known}" if known else root
        self.limits = dict(limits)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "processing.batch.work", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **limits, "PYTHONPATH": path},
            start_new_session=True,
        )
        self._child = 0

    @classmethod
    def idle(cls, limits: Mapping[str, str]) -> "Warm":
        """Return a server of these limits that has nothing to do; those of other limits end."""
        with cls._lock:
            while cls._at_rest:
                server = cls._at_rest.pop()
                if server.limits == limits and server._process.poll() is None:  # noqa: SLF001
                    return server
                server.end()
        return cls(limits)

    def run(self, arguments: list[str], place: Path, timeout_s: float) -> int:
        """Return the exit code of `daylit` with these arguments, negative: a signal; out and err are in ``place``.

        Raises `TimeoutError` once it has been ended with all that it began.
        """
        for name in ("out", "err"):
            (place / name).touch()
        end_s = time.monotonic() + timeout_s
        try:
            self._send({"arguments": arguments, "place": str(place)})
            self._child = int(self._answer(end_s))
            code = int(self._answer(end_s))
        except (BrokenPipeError, EOFError, ValueError):  # the server itself was killed
            self.end()
            return -signal.SIGKILL
        except BaseException:
            self.end()
            raise
        with self._lock:
            self._at_rest.append(self)
        return code

    def _send(self, job: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(job).encode() + b"\n")
        self._process.stdin.flush()

    def _answer(self, end_s: float) -> bytes:
        assert self._process.stdout is not None
        stream, found = self._process.stdout.fileno(), b""
        while not found.endswith(b"\n"):
            if not select.select([stream], [], [], max(0.0, end_s - time.monotonic()))[0]:
                raise TimeoutError
            found += (byte := os.read(stream, 1))
            if not byte:
                raise EOFError
        return found

    def end(self) -> None:
        """Kill the server and the child that it has, with all that they began, and wait for it."""
        for pid in (self._child, self._process.pid):
            with suppress(ProcessLookupError, PermissionError):
                if pid:
                    os.killpg(pid, signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):
            self._process.communicate(timeout=_GRACE_S)


def serve() -> int:
    """Fork a child for each line on standard input; answer with its process id, and its exit code once it is over."""
    import daylit
    from processing.pipeline import STAGES, resolve

    for stage in STAGES:
        resolve(stage.function)
    gc.freeze()
    server = os.getpid()
    while line := sys.stdin.buffer.readline():
        job = json.loads(line)
        child = os.fork()
        if child == 0:
            os.setsid()
            die_with_parent(server)
            for number, name, how in ((0, os.devnull, os.O_RDONLY), (1, "out", os.O_WRONLY), (2, "err", os.O_WRONLY)):
                os.dup2(os.open(Path(job["place"]) / name, how), number)
            code = daylit.main(job["arguments"])
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        print(child, flush=True)  # noqa: T201 (the answer)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)  # noqa: T201
    return 0


def outcome_of(name: str, exit_code: int, out: str, err: str) -> Outcome:
    """Return what a finished process of `daylit process --json` says."""
    if exit_code < 0:
        message = f"its process was ended by signal {-exit_code}"
        why = " (9: usually out of memory)" if exit_code == -signal.SIGKILL else ""
        return Outcome(name, "failed", SessionKilledError.code, message + why)
    try:
        said = json.loads(out.strip().splitlines()[-1])
        if not isinstance(said, dict):
            raise TypeError("no object")
    except (ValueError, IndexError, TypeError):
        nothing = f"its process ended with exit code {exit_code} without a message"
        message = (err.strip().splitlines() or [nothing])[-1].strip()[:_MOST_TEXT]
        return Outcome(name, "failed", BROKEN, message)
    if exit_code != 0 or not said.get("ok"):
        error = said.get("error", {})
        code, message = str(error.get("code", BROKEN)), str(error.get("message", "no message"))
        return Outcome(name, "failed", code, message[:_MOST_TEXT])
    stages = said.get("stages", [])
    return Outcome(
        name,
        "done",
        stages={one["stage"]: one["action"] for one in stages},
        warnings=sum(len(one.get("summary", {}).get("warnings", ())) for one in stages),
        cpu_seconds=float(said.get("cpu_seconds", 0.0)),
        peak_bytes=int(said.get("peak_bytes", 0)),
    )


def die_with_parent(parent: int) -> None:
    """Ask Linux to kill this process when its parent ends; elsewhere nothing is done."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it ended before it could be asked
        os.kill(os.getpid(), signal.SIGKILL)


def main(argv: list[str]) -> int:
    """Serve the worker whose process id is given."""
    die_with_parent(int(argv[0]))
    return serve()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
