"""An independent witness: strace kills or fails a real run at the Nth system call, whoever makes it (Python's too)."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.torture import small_capture
from tests.torture.ledger import record
from tests.torture.os_faults import Counting, installed
from tests.torture.small_capture import Ack

LONG = os.environ.get("DAYLIT_TORTURE") == "1"
ROOT = Path(__file__).resolve().parents[2]
STRACE = shutil.which("strace")
KILLED = ("fsync", "fdatasync", "rename", "mkdir")
FAULTS = {"fsync": "EIO", "fdatasync": "ENOSPC", "rename": "EROFS"}


def can_trace() -> bool:
    if STRACE is None:
        return False
    probe = subprocess.run([STRACE, "-qq", "-o", os.devnull, "true"], capture_output=True, check=False)
    return probe.returncode == 0


pytestmark = [pytest.mark.torture, pytest.mark.skipif(not can_trace(), reason="strace is not here or may not trace")]


@pytest.fixture
def parent() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="daylit-"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def traced(folder: Path, inject: str) -> tuple[list[Ack], int]:
    """Run the capture under strace; return the acknowledgements and how it ended."""
    calls = inject.split(":")[0]
    command = [str(STRACE), "-f", "-qq", "-o", os.devnull, "-e", f"trace={calls}", "-e", f"inject={inject}"]
    command += [sys.executable, "-m", "tests.torture.small_capture", str(folder)]
    done = subprocess.run(command, capture_output=True, cwd=ROOT, timeout=60, check=False)
    return [json.loads(line) for line in done.stdout.splitlines()], done.returncode


def aftermath(folder: Path, acks: list[Ack]) -> list[str]:
    """Reopen, check, resume, check."""
    found = small_capture.sessions(folder)
    if not found:
        return [f"lost {ack}" for ack in acks]
    with SessionStore.open(found[0], writable=True) as store:
        problems = small_capture.lost(store.manifest, acks, store.path)
    small_capture.run(folder, acks.append)
    report = verify_session(found[0])
    return problems + [f"{p.file} {p.message}" for p in report.problems] + list(report.missing)


def cases(parent: Path) -> list[str]:
    """Every call of these kinds that a whole run makes, or a sample of them."""
    counting = Counting()
    with installed(counting):
        small_capture.run(parent, lambda _ack: None)
    count = counting.names.count
    kills = [f"{call}:signal=KILL:when={n}" for call in KILLED for n in range(1, count(call) + 1)]
    faults = [f"{call}:error={code}:when={n}" for call, code in FAULTS.items() for n in range(1, count(call) + 1)]
    return kills + faults if LONG else kills[3::36] + faults[1::50]


@pytest.mark.timeout(600)
def test_strace_kills_and_faults(parent: Path) -> None:
    start, hit, problems = time.monotonic(), 0, []
    (parent / "count").mkdir()
    every = cases(parent / "count")
    for number, case in enumerate(every):
        folder = parent / str(number)
        folder.mkdir()
        # dir_fd makes renameat of rename, and mkdirat of mkdir.
        spelled = case.replace("rename:", "rename,renameat,renameat2:").replace("mkdir:", "mkdir,mkdirat:")
        acks, code = traced(folder, spelled)
        hit += code != 0
        problems += [f"{case}: {p}" for p in aftermath(folder, acks)]
    record(
        "strace: kill or error at the Nth system call of a real process",
        injected=len(every),
        observed=hit,
        lost=len(problems),
        seconds=time.monotonic() - start,
        seed=0,
        notes="independent of the store's own hook",
    )
    assert problems == []
    assert hit == len(every) > 0
