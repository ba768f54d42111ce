"""A warm, single-threaded process that forks one child a case: the child runs the capture and dies as asked.

Speaks JSON lines: a case in, what became of it out. Forking a test process that has threads is not safe, and
starting Python anew for each of thousands of cases is too slow.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

from tests.torture import small_capture
from tests.torture.os_faults import KillAt, installed

CASE_LIMIT_S = 20
ROOT = Path(__file__).resolve().parents[2]


def _child(case: dict[str, Any], acks: int) -> None:
    signal.alarm(CASE_LIMIT_S)
    calls = KillAt(case["nth"], case["moment"])
    with installed(calls):
        small_capture.run(Path(case["parent"]), lambda ack: os.write(acks, json.dumps(ack).encode() + b"\n") and None)
    os.write(acks, json.dumps({"what": "calls", "names": calls.names}).encode() + b"\n")


def _serve_case(case: dict[str, Any]) -> dict[str, Any]:
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            os.close(reading)
            _child(case, writing)
            code = 0
        finally:
            os._exit(code)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        acks = [json.loads(line) for line in pipe]
    _, status = os.waitpid(pid, 0)
    signal_number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    return {"signal": signal_number, "code": os.waitstatus_to_exitcode(status), "acks": acks}


def serve() -> None:
    """Answer cases from standard input until it ends."""
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_serve_case(json.loads(line))) + "\n")
        sys.stdout.flush()


class ForkServer:
    """The server as its user sees it."""

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.torture.fork_server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=ROOT,
            text=True,
        )
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.close()
        self._process.wait(CASE_LIMIT_S)
        self._process.stdout.close()

    def run(self, parent: Path, nth: int, moment: str) -> dict[str, Any]:
        """Run the capture in ``parent`` in a child that dies at its Nth call; return signal, code and acks."""
        assert self._process.stdin
        assert self._process.stdout
        case = {"parent": str(parent), "nth": nth, "moment": moment}
        self._process.stdin.write(json.dumps(case) + "\n")
        self._process.stdin.flush()
        return dict(json.loads(self._process.stdout.readline()))


if __name__ == "__main__":
    serve()
