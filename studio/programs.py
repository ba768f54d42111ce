"""Programs beside the server: a session's run, which outlives it, and the one that previews what is looked at."""

import asyncio
import json
import os
import re
import shlex
import signal
import sys
import tempfile
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from processing.errors import ParameterError
from processing.pipeline import STAGES
from processing.stages.contract import Quality

MOST_LINES = 200  # of a run's output that a screen is given: the last ones (chosen)
WORLD = re.compile(r"[a-z]+([-:]\d{1,6})?")  # of simulated instruments
LOOK_S, LOOK_AGAIN_S = 60.0, 20.0  # for which instruments are waited for, and for which what they said counts (chosen)
PREVIEW_S = 120.0  # chosen: a basis of the light of a large room takes a quarter of it


@dataclass
class Job:
    """A run: the command line that it is, and what it has said so far."""

    command: list[str]
    log: IO[bytes]
    process: asyncio.subprocess.Process | None = field(default=None, repr=False)

    @property
    def state(self) -> dict[str, object]:
        """Return the run for the screen."""
        # The run writes where the file's own position is: it stays.
        said = os.pread(self.log.fileno(), os.fstat(self.log.fileno()).st_size, 0)
        lines = said.decode("utf-8", "replace").splitlines()[-MOST_LINES:]
        code = self.process.returncode if self.process else None
        return {"command": shlex.join(["daylit", *self.command]), "lines": lines, "running": code is None, "code": code}


def command_of(session: Path, asked: Mapping[str, Any]) -> list[str]:
    """Return the command line of a run: a process until a stage, a light that is kept, stills that were aimed.

    Or a capture into the folder that stands for ``session``: by this computer's rig, or of a simulated world.
    """
    match asked:
        case {"until": until, "quality": quality} if until in {s.name for s in STAGES} and quality in set(Quality):
            return ["process", str(session), "--until", until, "--quality", quality]
        case {"at": str(at), "weather": str(weather), "staged": int() | None as staged}:
            state = [] if staged is None else [f"--staged={staged}"]
            return ["relight", str(session), f"--at={at}", f"--weather={weather}", *state]
        case {"aim": [str(), *_] as frames}:
            return ["stills", str(session), *(f"--aim={frame}" for frame in frames)]
        case {"proof": True}:
            return ["proof", str(session), f"--into={session.parent / f'{session.name}-proof'}"]
        case {"room": str(room), "simulate": str() | None as world} if re.fullmatch(r"\w[\w .-]{0,79}", room):
            if world is None:
                return ["capture", room, f"--into={session}"]
            if WORLD.fullmatch(world):
                return ["capture", room, f"--into={session}", f"--simulate={world}", "--size=quarter", "--rate=4"]
    raise ParameterError("no such run", where="studio", advice="start a room's name with a letter or digit")


class Jobs:
    """At most one run a session; a run outlives the server, and what it has finished stays."""

    def __init__(self) -> None:
        self._jobs: dict[Path, Job] = {}

    async def start(self, session: Path, asked: Mapping[str, Any]) -> None:
        """Begin what a screen asks for; raises `ParameterError` while the session has a run, and for other words."""
        command = command_of(session, asked)
        if (job := self._jobs.get(session)) and job.state["running"]:
            raise ParameterError("this session is being processed", where=session.name, advice="wait, or stop the run")
        log = tempfile.TemporaryFile()  # noqa: SIM115 (it lives as long as the job)
        job = self._jobs[session] = Job(command, log)
        job.process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "daylit", *command),
            stdout=log,
            stderr=log,
            stdin=DEVNULL,
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
        return job.state if (job := self._jobs.get(session)) else None


class Instruments:
    """What `daylit doctor` finds of the rig; nobody is disturbed: whoever captures takes ``turn`` to begin."""

    def __init__(self, folder: Path) -> None:
        self._folder, self.turn = folder, asyncio.Lock()
        self._found: dict[str, tuple[float, dict[str, Any]]] = {}

    async def state(self, world: str, *, capturing: Callable[[], bool]) -> dict[str, Any]:
        """Return the checks, or the error, of this computer's rig or of simulated instruments (``world``).

        While a capture works with them, what was found last.
        """
        async with self.turn:
            now_s, busy = asyncio.get_running_loop().time(), await asyncio.to_thread(capturing)
            at_s, found = self._found.get(world, (-LOOK_AGAIN_S, {"checks": []}))
            if not busy and now_s - at_s >= LOOK_AGAIN_S:
                self._found[world] = now_s, (found := await self._asked(world))
            return found | {"capturing": busy}

    async def _asked(self, world: str) -> dict[str, Any]:
        which = [f"--simulate={world}"] if WORLD.fullmatch(world) else _own_rig()
        command = (sys.executable, "-m", "daylit", "doctor", "--json", f"--into={self._folder}", *which)
        process = await asyncio.create_subprocess_exec(*command, stdin=DEVNULL, stdout=PIPE, stderr=DEVNULL)
        try:
            found: dict[str, Any] = json.loads((await asyncio.wait_for(process.communicate(), LOOK_S))[0])
        except (TimeoutError, ValueError):
            raise ParameterError("the instruments do not respond", where="daylit doctor", advice="try again") from None
        finally:  # whoever asked may have gone, and then somebody else's turn begins
            if process.returncode is None:
                process.kill()
        return found


def _own_rig() -> list[str]:
    """Return the option that names this computer's rig file; without one doctor lists what is connected."""
    from station.capture.rig import find_rig_file
    from station.errors import RigError

    try:
        return [f"--rig={find_rig_file(None)}"]
    except RigError:
        return []


class Warm:
    """The program that previews the session that is looked at (processing/running/worker.py), one after the other."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()

    async def ask(self, session: Path, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Return a preview's facts and its bytes; raises `ParameterError` where none comes in `PREVIEW_S`."""
        async with self._turn:
            try:
                return await asyncio.wait_for(self._asked(session, request), PREVIEW_S)
            except (TimeoutError, OSError, asyncio.IncompleteReadError, ValueError) as error:
                self.stop()
                raise ParameterError("no preview arrived", where=session.name, advice="try again") from error

    async def _asked(self, session: Path, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        if self._process is None or self._process.returncode is not None:
            command = (sys.executable, "-m", "processing.running.worker", str(session.parent))
            self._process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE)
        to, back = self._process.stdin, self._process.stdout
        assert to
        assert back
        to.write(json.dumps({**request, "session": session.name}).encode() + b"\n")
        await to.drain()
        facts = json.loads(await back.readline())
        return facts, await back.readexactly(facts.pop("bytes"))

    def stop(self) -> None:
        """End the program: what it held is read again by the next."""
        if self._process and self._process.returncode is None:
            self._process.kill()
        self._process = None
