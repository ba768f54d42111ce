"""What workers do in tests: small functions that a worker process can import."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from processing.batch.work import Outcome, Task


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
