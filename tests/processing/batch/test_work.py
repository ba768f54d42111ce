"""One session in a process of its own: what it says, how it ends, and what is made of that."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pytest

from processing.batch.work import Outcome, Task, Warm, outcome_of, work
from station.session.durable import SessionLock
from station.session.folder import Folder
from tests.station.session.sessions import complete_session


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return complete_session(tmp_path / "sessions")


def task(path: Path, *arguments: str, timeout_s: float = 300.0) -> Task:
    return Task(str(path), path.name, ("--until", "verify", *arguments), timeout_s)


def test_a_session_is_done_and_reported(session: Path) -> None:
    outcome = work(task(session))
    assert (outcome.state, outcome.code, outcome.tries) == ("done", "", 1)
    assert outcome.stages == {"verify": "ran"}
    assert outcome.row["scene_name"] == "coda 320"
    assert outcome.peak_bytes > 0
    assert json.loads(json.dumps(asdict(outcome))) == asdict(outcome)


def test_what_is_wrong_is_reported_by_code(session: Path, tmp_path: Path) -> None:
    assert work(task(tmp_path / "nothing")).code == "SES-001"
    opened = Folder.open(session)
    lock = SessionLock(opened)
    try:
        outcome = work(task(session))
        assert (outcome.state, outcome.code) == ("failed", "SES-002")
        assert outcome.row["session"] == session.name, "what is known of it is in the table all the same"
    finally:
        lock.release()
        opened.close()


def test_a_process_stays_warm_from_session_to_session_until_one_takes_too_long(session: Path, tmp_path: Path) -> None:
    def places() -> list[Warm]:
        return list(Warm._at_rest)

    work(task(session))
    (server,) = places()
    assert work(task(session)).stages == {"verify": "skipped"}
    assert places() == [server]
    assert work(task(tmp_path / "nothing")).code == "SES-001", "a failure leaves it as it was"
    assert places() == [server]
    os.kill(server._process.pid, signal.SIGKILL)
    server._process.wait(timeout=30)
    assert work(task(session)).state == "done", "a server that was killed is replaced"
    (other,) = places()
    outcome = work(task(session, timeout_s=0.01))
    assert (outcome.state, outcome.code) == ("failed", "BAT-003")
    assert places() == [], "what hung is gone with its server"
    other._process.wait(timeout=30)


@pytest.mark.parametrize(
    ("exit_code", "out", "err", "state", "code", "said"),
    [
        (0, 'a line\n{"ok": true, "stages": [{"stage": "verify", "action": "ran"}]}\n', "", "done", "", ""),
        (4, '{"ok": false, "error": {"code": "SES-001", "message": "none"}}', "", "failed", "SES-001", "none"),
        (70, '{"ok": false, "error": {"message": "boom"}}', "", "failed", "internal", "boom"),
        (1, "", "Traceback\nImportError: no numpy\n\n", "failed", "internal", "ImportError: no numpy"),
        (0, "", "", "failed", "internal", "without a message"),
        (0, "[1]", "", "failed", "internal", "without a message"),
        (0, '{"ok": false}', "", "failed", "internal", "no message"),
        (-9, "", "", "failed", "BAT-002", "memory"),
        (-11, "", "", "failed", "BAT-002", "signal 11"),
    ],
)
def test_how_a_process_ends(exit_code: int, out: str, err: str, state: str, code: str, said: str) -> None:
    outcome = outcome_of("one", exit_code, out, err)
    assert (outcome.state, outcome.code) == (state, code)
    assert said in outcome.message


def test_a_process_that_is_killed_is_tried_once_more(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import processing.batch.work as module

    result = [Outcome("a", "failed", "BAT-002", "killed"), Outcome("a", "done")]
    monkeypatch.setattr(module, "_once", lambda _task: result.pop(0))
    outcome = work(task(session))
    assert (outcome.state, outcome.tries) == ("done", 2)
    result += [Outcome("a", "failed", "BAT-002", "killed"), Outcome("a", "failed", "BAT-002", "again")]
    assert (work(task(session)).message, result) == ("again", [])


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a process with its parent")
def test_the_process_dies_with_its_worker() -> None:
    """The worker here begins a child that would wait for ever, and is killed."""
    lines = (
        "import os, signal, sys",
        "from processing.batch.work import die_with_parent",
        "die_with_parent(int(sys.argv[1]))",
        "print('ready', flush=True)",
        "signal.pause()",
    )
    begun = "subprocess.Popen([sys.executable, '-c', " + repr("; ".join(lines)) + ", str(os.getpid())])"
    worker = f"import os, signal, subprocess, sys; child = {begun}; signal.pause()"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[3])}
    command = [sys.executable, "-c", worker]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGKILL)
        # The child holds the other end of the pipe: only its end is the end of the file.
        assert process.stdout.read() == ""
