"""What workers do in tests: small functions that a worker process can import."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from processing.batch.work import Outcome, Task

JOINED = 4
"""Workers that `together` waits for."""


def as_named(task: Task) -> Outcome:
    """Do what the session's name says: die once, die always, raise, or be done."""
    path = Path(task.session)
    if "mortal" in path.name or "cursed" in path.name:
        marks = len(list(path.glob("tried-*")))
        (path / f"tried-{marks}").touch()
        if "cursed" in path.name or marks == 0:
            os.kill(os.getpid(), signal.SIGKILL)
    if "broken" in path.name:
        raise ValueError("a fault of the worker")
    return Outcome(task.name, "done", row={"scene_name": path.name})


def together(task: Task) -> Outcome:
    """Be done once as many sessions as there are workers are under way at the same moment, or fail after a minute."""
    folder, end_s = Path(task.session).parent, time.monotonic() + 60
    (folder / f"here-{task.name}").touch()
    while len(list(folder.glob("here-*"))) < JOINED:
        if time.monotonic() > end_s:
            return Outcome(task.name, "failed", "alone")
        time.sleep(0.02)
    return Outcome(task.name, "done", row={"machines": str(dict(task.machines))})
