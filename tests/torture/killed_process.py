"""A warm process that forks one child a case: the child processes a session with toy stages and is killed in time.

Speaks JSON lines, as `fork_server` does: {"session", "scale", "delay_s"} in; {"killed", "seconds"} out. Without a
delay the child ends by itself.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from processing.running.requests import RunRequest
from processing.running.runner import process
from tests.processing.running.toy_stages import TOYS


def _child(case: dict[str, Any]) -> None:
    signal.alarm(60)
    options = {"--scale": case["scale"], "--rounds": int(3 + case["scale"])}
    process(Path(case["session"]), RunRequest(options=options), stages=TOYS)


def serve_case(case: dict[str, Any]) -> dict[str, Any]:
    """Fork, run, kill; return what became of the child."""
    start = time.monotonic()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            _child(case)
            code = 0
        finally:
            os._exit(code)
    if case.get("delay_s") is not None:
        time.sleep(case["delay_s"])
        os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    seconds = time.monotonic() - start
    return {"killed": os.WIFSIGNALED(status), "code": os.waitstatus_to_exitcode(status), "seconds": seconds}


if __name__ == "__main__":
    for line in sys.stdin:
        sys.stdout.write(json.dumps(serve_case(json.loads(line))) + "\n")
        sys.stdout.flush()
