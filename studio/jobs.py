"""Runs of ``daylit process`` in child processes: what the studio does not compute itself."""

from __future__ import annotations

import asyncio
import os
import shlex
import signal
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from processing.errors import ParameterError
from processing.pipeline import STAGES
from processing.stages.contract import Quality

MOST_LINES = 200
"""Of a run's output that a screen is given: the last ones (chosen)."""


@dataclass
class Job:
    """A run: the command line that it is, and what it has said so far."""

    command: list[str]
    log: IO[bytes]
    process: asyncio.subprocess.Process | None = field(default=None, repr=False)

    @property
    def state(self) -> dict[str, object]:
        """Return the run for the screen."""
        self.log.seek(0)
        lines = self.log.read().decode("utf-8", "replace").splitlines()[-MOST_LINES:]
        code = self.process.returncode if self.process else None
        return {"command": shlex.join(["daylit", *self.command]), "lines": lines, "running": code is None, "code": code}


class Jobs:
    """At most one run a session; a run outlives the server, and what it has finished stays."""

    def __init__(self) -> None:
        self._jobs: dict[Path, Job] = {}

    async def start(self, session: Path, until: str, quality: str) -> None:
        """Begin to process the session; raises `ParameterError` while it is being processed, and for other words."""
        if until not in {stage.name for stage in STAGES} or quality not in set(Quality):
            raise ParameterError("no such stage or quality", where="studio")
        if (job := self._jobs.get(session)) and job.state["running"]:
            raise ParameterError("this session is being processed", where=session.name, advice="wait, or stop the run")
        command = ["process", str(session), "--until", until, "--quality", quality]
        log = tempfile.TemporaryFile()  # noqa: SIM115 (it lives as long as the job)
        job = Job(command, log)
        self._jobs[session] = job
        job.process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "daylit", *command),
            stdout=log,
            stderr=log,
            stdin=asyncio.subprocess.DEVNULL,
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )

    def stop(self, session: Path) -> None:
        """End a run: the results of the stages before stand."""
        job = self._jobs.get(session)
        if job and job.process and job.process.returncode is None:
            os.killpg(job.process.pid, signal.SIGINT)

    def state(self, session: Path) -> dict[str, object] | None:
        """Return the last run of a session, None where there was none since the server started."""
        job = self._jobs.get(session)
        return job.state if job else None
