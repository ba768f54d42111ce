"""kill -9 before, within and after every system call of a capture, and of the resume after it."""

from __future__ import annotations

import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.torture import small_capture
from tests.torture.fork_server import ForkServer
from tests.torture.ledger import record
from tests.torture.small_capture import Ack

LONG = os.environ.get("DAYLIT_TORTURE") == "1"
MOMENTS = ("before", "torn", "nearly", "after")
WRITES_ONLY = ("torn", "nearly")
NEVER = 1_000_000


@pytest.fixture
def fast_folder(tmp_path: Path):
    """A folder in memory where there is one: a kill loses no page cache, so the disk need not be real."""
    memory = Path("/dev/shm")
    parent = memory / f"daylit-{os.getpid()}-{tmp_path.name}" if memory.is_dir() else tmp_path / "sweep"
    parent.mkdir(parents=True)
    yield parent
    shutil.rmtree(parent, ignore_errors=True)


def facts(acks: list[Ack]) -> list[Ack]:
    return [ack for ack in acks if ack["what"] != "calls"]


def check_reopened(parent: Path, acks: list[Ack]) -> list[str]:
    """Open what a killed run left and return what is lost or wrong; opening is recovery."""
    found = small_capture.sessions(parent)
    if not found:
        return [f"lost {ack}" for ack in acks]
    with SessionStore.open(found[0], writable=True) as store:
        return small_capture.lost(store.manifest, acks, store.path)


def check_complete(parent: Path) -> list[str]:
    """Return what keeps a resumed session from being complete and intact."""
    (path,) = small_capture.sessions(parent)
    report = verify_session(path)
    problems = [f"{p.file} {p.message}" for p in report.problems]
    return problems + [f"missing {m}" for m in report.missing] + [f"note {n}" for n in report.notes]


class Sweep:
    """Counts points, deaths and losses of a sweep."""

    def __init__(self, server: ForkServer, parent: Path) -> None:
        self.server = server
        self.parent = parent
        self.injected = self.killed = 0
        self.problems: list[str] = []

    def kill(self, folder: Path, nth: int, moment: str) -> list[Ack]:
        """Run to the Nth call; return what was acknowledged."""
        result = self.server.run(folder, nth, moment)
        self.injected += 1
        self.killed += result["signal"] == signal.SIGKILL
        if result["signal"] not in (0, signal.SIGKILL) or result["code"] > 0:
            self.problems.append(f"{nth} {moment}: ended with {result['signal']}, {result['code']}")
        return facts(result["acks"])

    def note(self, label: str, problems: list[str]) -> None:
        self.problems += [f"{label}: {p}" for p in problems]

    def complete(self, folder: Path, label: str, acks: list[Ack]) -> None:
        """Run to the end and check."""
        result = self.server.run(folder, NEVER, "before")
        if result["code"] != 0:
            self.problems.append(f"{label}: the resume ended with {result['code']}")
            return
        self.note(label, check_reopened(folder, acks + facts(result["acks"])) + check_complete(folder))

    def fresh(self, name: str) -> Path:
        folder = self.parent / name
        folder.mkdir()
        return folder


def call_names(server: ForkServer, folder: Path) -> list[str]:
    result = server.run(folder, NEVER, "before")
    assert result["code"] == 0, result
    return list(result["acks"][-1]["names"])


def points(names: list[str], stride: int, offset: int = 0) -> list[tuple[int, str]]:
    every = [(n, m) for n, name in enumerate(names, 1) for m in MOMENTS if m not in WRITES_ONLY or name == "write"]
    return every[offset::stride]


@pytest.mark.torture
@pytest.mark.timeout(1800)
def test_kill_at_every_call(fast_folder: Path) -> None:
    start = time.monotonic()
    with ForkServer() as server:
        sweep = Sweep(server, fast_folder)
        names = call_names(server, sweep.fresh("whole"))
        assert check_complete(fast_folder / "whole") == []
        for nth, moment in points(names, 1 if LONG else 16):
            folder = sweep.fresh(f"{nth}-{moment}")
            acks = sweep.kill(folder, nth, moment)
            copy = fast_folder / "reopened"
            shutil.copytree(folder, copy)
            sweep.note(f"{nth} {moment}", check_reopened(copy, acks))
            shutil.rmtree(copy)
            sweep.complete(folder, f"{nth} {moment}, resumed", acks)
            shutil.rmtree(folder)
    record(
        "kill -9 at every call of a capture",
        injected=sweep.injected,
        observed=sweep.killed,
        lost=len(sweep.problems),
        seconds=time.monotonic() - start,
        seed=0,
        notes=f"{len(names)} calls; before, torn write, after; each reopened and resumed",
    )
    assert sweep.problems == []
    assert sweep.killed == sweep.injected >= (300 if LONG else 17)


@pytest.mark.torture
@pytest.mark.timeout(3600)
def test_kill_at_every_call_of_the_resume(fast_folder: Path) -> None:
    start = time.monotonic()
    with ForkServer() as server:
        sweep = Sweep(server, fast_folder)
        names = call_names(server, sweep.fresh("whole"))
        for first, moment in points(names, 19 if LONG else 151, offset=5):
            state = sweep.fresh("state")
            acks = sweep.kill(state, first, moment)
            probe = fast_folder / "probe"
            shutil.copytree(state, probe)
            resume_names = call_names(server, probe)
            shutil.rmtree(probe)
            for nth, second in points(resume_names, 2 if LONG else 18, offset=first % 2):
                folder = fast_folder / "again"
                shutil.copytree(state, folder)
                more = acks + sweep.kill(folder, nth, second)
                sweep.complete(folder, f"{first} {moment}, then {nth} {second}", more)
                shutil.rmtree(folder)
            shutil.rmtree(state)
    record(
        "kill -9 at every call of the resume",
        injected=sweep.injected,
        observed=sweep.killed,
        lost=len(sweep.problems),
        seconds=time.monotonic() - start,
        seed=0,
        notes="capture killed, resume killed, resumed again",
    )
    assert sweep.problems == []
    assert sweep.killed == sweep.injected >= (300 if LONG else 10)
