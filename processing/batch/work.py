"""What a worker does for one session: run it in a process of its own, and say what became of it.

It returns an outcome whatever happens to the session; only the worker's own end is left to the cluster to notice. The
process is this module as a program, ``python -m processing.batch.work PARENT process SESSION --json``: what a session
can do to it (run out of memory, crash in a library, hang) so never reaches the worker, and it dies with the worker
that began it, so that it does not hold the session's lock.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from processing.errors import SessionKilledError, SessionTimeoutError

State = Literal["done", "failed"]
BROKEN = "internal"
"""Code of what is a fault of the program."""
_MOST_TEXT = 2000
_GRACE_S = 10.0


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
    environment: Mapping[str, str] = field(default_factory=dict)
    zone: str = "UTC"
    """For dates and times of the table."""


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

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)


def work(task: Task) -> Outcome:
    """Process a session and return what became of it. A process that was killed is tried once more."""
    from processing.batch.rows import session_row

    path = Path(task.session)
    begun_s = time.monotonic()
    outcome = _once(task)
    tries = 1
    if outcome.code == SessionKilledError.code:
        outcome, tries = _once(task), 2
    row: Mapping[str, str] = {}
    with suppress(Exception):  # the table's row must not spoil the outcome
        row = session_row(path, task.zone)
    seconds = round(time.monotonic() - begun_s, 3)
    return Outcome(**{**outcome.to_dict(), "tries": tries, "row": row, "seconds": seconds})


def _once(task: Task) -> Outcome:
    """Run the session's process once, killed after the time allowed."""
    name = task.name
    command = [sys.executable, "-m", "processing.batch.work", str(os.getpid())]
    command += ["process", task.session, "--json", *task.arguments]
    root = str(Path(__file__).resolve().parents[2])
    known = os.environ.get("PYTHONPATH", "")
    environment = {**os.environ, **task.environment, "PYTHONPATH": f"{root}{os.pathsep}{known}" if known else root}
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=task.timeout_s)
    except subprocess.TimeoutExpired:
        _end(process)
        message = f"not done after {task.timeout_s:g} s; what its stages made so far is kept"
        return Outcome(name, "failed", SessionTimeoutError.code, message)
    except BaseException:
        _end(process)
        raise
    return outcome_of(name, process.returncode, out.decode("utf-8", "replace"), err.decode("utf-8", "replace"))


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill a process with all that it began, and wait for it."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    with suppress(subprocess.TimeoutExpired):
        process.communicate(timeout=_GRACE_S)


def outcome_of(name: str, exit_code: int, out: str, err: str) -> Outcome:
    """Return what a finished process of `daylit process --json` says."""
    if exit_code < 0:
        message = f"its process was ended by signal {-exit_code}"
        why = " (9 is the system's answer to too little memory)" if exit_code == -signal.SIGKILL else ""
        return Outcome(name, "failed", SessionKilledError.code, message + why)
    try:
        said = json.loads(out.strip().splitlines()[-1])
        if not isinstance(said, dict):
            raise TypeError("no object")
    except (ValueError, IndexError, TypeError):
        message = _last_words(err) or f"its process ended with exit code {exit_code} and said nothing"
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


def _last_words(err: str) -> str:
    lines = [line.strip() for line in err.splitlines() if line.strip()]
    return lines[-1][:_MOST_TEXT] if lines else ""


_PR_SET_PDEATHSIG = 1
"""Of prctl(2)."""


def die_with_parent(parent: int) -> None:
    """Ask Linux to kill this process when its parent ends; elsewhere nothing is done."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it ended before it could be asked
        os.kill(os.getpid(), signal.SIGKILL)


def main(argv: list[str]) -> int:
    """Run `daylit` with these arguments, the first of them the parent's process id."""
    die_with_parent(int(argv[0]))
    import daylit

    return daylit.main(argv[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
