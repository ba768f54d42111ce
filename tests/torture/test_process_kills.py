"""kill -9 of `daylit process` at random instants: every result stands whole, and a rerun gives the same bytes."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from processing.running.fingerprint import DigestMemory
from processing.running.result_store import ResultStore
from station.session.folder import Folder
from tests.processing.running.toy_stages import contents
from tests.station.session.sessions import complete_session
from tests.torture.ledger import record

LONG = os.environ.get("DAYLIT_TORTURE") == "1"
ROOT = Path(__file__).resolve().parents[2]
SEED = 20
TOY_NAMES = ("frames", "total", "half")
Ask = Callable[..., dict[str, Any]]


@pytest.fixture
def ask(tmp_path: Path) -> Iterator[Ask]:
    """Send a case to the warm process and return its answer."""
    environment = {**os.environ, "DAYLIT_STATE": str(tmp_path / "state")}
    command = [sys.executable, "-m", "tests.torture.killed_process"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, env=environment, text=True
    ) as server:
        assert server.stdin
        assert server.stdout

        def answer(**case: object) -> dict[str, Any]:
            server.stdin.write(json.dumps(case) + "\n")  # type: ignore[union-attr]
            server.stdin.flush()  # type: ignore[union-attr]
            return dict(json.loads(server.stdout.readline()))  # type: ignore[union-attr]

        yield answer
        server.stdin.close()


def differences(got: dict[str, bytes], want: dict[str, bytes]) -> list[str]:
    """Return the files that are more, missing or other than they should be."""
    return sorted(name for name in got.keys() | want.keys() if got.get(name) != want.get(name))


def not_whole(session: Path, names: tuple[str, ...]) -> list[str]:
    """Return which results on disk are neither absent nor intact."""
    if not (session / "stages").exists():
        return []
    folder = Folder.open(session / "stages")
    try:
        store = ResultStore(folder, DigestMemory(None))
        return [f"{name}: {store.read(name).problem}" for name in names if store.read(name).problem]
    finally:
        folder.close()


@pytest.mark.torture
@pytest.mark.timeout(1800)
def test_toy_stages_killed_at_random_instants(ask: Ask, tmp_path: Path) -> None:
    """Each kill meets a session whose results are of other parameters, so that every stage replaces one."""
    start, rng, count = time.monotonic(), random.Random(SEED), 100 if LONG else 4
    session = complete_session(tmp_path / "sessions")
    want = {}
    for scale in (2.0, 1.0):
        assert ask(session=str(session), scale=scale)["code"] == 0
        want[scale] = contents(session)
    typical_s = ask(session=str(session), scale=2.0)["seconds"]
    problems, tries, killed, scale = [], 0, 0, 1.0
    while killed < count:
        tries += 1
        assert tries <= 10 * count, "the runs end before they are killed"
        result = ask(session=str(session), scale=scale, delay_s=rng.uniform(0, typical_s))
        if not result["killed"]:
            typical_s = max(0.9 * typical_s, 0.02)
        killed += result["killed"]
        problems += [f"kill {killed}: {problem}" for problem in not_whole(session, TOY_NAMES)]
        assert ask(session=str(session), scale=scale)["code"] == 0
        if differing := differences(contents(session), want[scale]):
            problems.append(f"kill {killed}: not the same: {differing}")
        scale = 3.0 - scale
    record(
        "kill -9 of daylit process, toy stages",
        injected=count,
        observed=killed,
        lost=len(problems),
        seconds=time.monotonic() - start,
        seed=SEED,
        notes="random instants; every result old or new and whole; the rerun's bytes compared",
    )
    assert problems == []


def daylit(session: Path, state: Path, *arguments: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "DAYLIT_STATE": str(state)}
    command = [sys.executable, "-m", "daylit", "process", str(session), *arguments]
    return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def finished(process: subprocess.Popen[bytes]) -> None:
    _, result = process.communicate(timeout=600)
    assert process.returncode == 0, result.decode()


@pytest.mark.torture
@pytest.mark.timeout(7200)
@pytest.mark.skipif(not LONG, reason="a full run a kill: make torture")
def test_real_stages_killed_at_random_instants(tmp_path: Path) -> None:
    """A small simulated session, the table as it is."""
    start, rng, count = time.monotonic(), random.Random(SEED), 100
    environment = {**os.environ, "DAYLIT_CACHE": str(tmp_path / "cache")}
    demo = [
        sys.executable,
        "-m",
        "daylit",
        "demo",
        "--world",
        "room",
        "--capture-only",
        "--size",
        "small",
        "--into",
        str(tmp_path / "demo"),
    ]
    subprocess.run(demo, cwd=ROOT, env=environment, check=True, stdout=subprocess.DEVNULL, timeout=300)
    (fresh,) = (tmp_path / "demo").iterdir()
    whole = shutil.copytree(fresh, tmp_path / "whole" / "session")
    finished(daylit(whole, tmp_path / "state"))
    begin = time.monotonic()
    finished(daylit(shutil.copytree(fresh, tmp_path / "timed" / "session"), tmp_path / "state"))
    typical_s = time.monotonic() - begin
    want, names = contents(whole), tuple(p.name for p in (whole / "stages").iterdir() if p.is_dir())
    problems, killed = [], 0
    for index in range(count):
        session = shutil.copytree(fresh, tmp_path / f"{index}" / "session")
        process = daylit(session, tmp_path / "state")
        time.sleep(rng.uniform(0, 1.05 * typical_s))
        process.kill()
        process.communicate()
        killed += process.returncode == -signal.SIGKILL
        problems += [f"kill {index}: {problem}" for problem in not_whole(session, names)]
        finished(daylit(session, tmp_path / "state"))
        if differing := differences(contents(session), want):
            problems.append(f"kill {index}: not the same: {differing}")
        shutil.rmtree(session.parent)
    record(
        "kill -9 of daylit process, real stages",
        injected=count,
        observed=killed,
        lost=len(problems),
        seconds=time.monotonic() - start,
        seed=SEED,
        notes="random instants of a run over a small simulated session; the rerun's bytes compared",
    )
    assert problems == []
