"""A disk that fails at the Nth call, for every N until a run ends clean: typed error, nothing lost, resume works."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import pytest

from station.errors import DiskError, DiskFullError, ResourceError
from station.session.store import load_manifest
from station.session.verify import verify_session
from tests.torture import small_capture
from tests.torture.ledger import record
from tests.torture.os_faults import APPLIES, FaultAt, installed
from tests.torture.small_capture import Ack

LONG = os.environ.get("DAYLIT_TORTURE") == "1"
FULL = {"ENOSPC", "EDQUOT", "HALF_THEN_ENOSPC"}
PATIENCE = 2


def expected_error(kind: str) -> type[ResourceError]:
    if kind in FULL:
        return DiskFullError
    return ResourceError if kind == "EMFILE" else DiskError


def attempt(folder: Path, calls: FaultAt, patience: int) -> tuple[list[Ack], Exception | None]:
    """Run the capture on the failing disk; return what it acknowledged and how it ended."""
    acks: list[Ack] = []
    try:
        with installed(calls):
            small_capture.run(folder, acks.append, patience)
    except Exception as exc:
        return acks, exc
    return acks, None


def after(folder: Path, acks: list[Ack]) -> list[str]:
    """Resume on a healthy disk; return what was lost, misfiled, or is not complete."""
    small_capture.run(folder, acks.append)
    (path,) = small_capture.sessions(folder)
    report = verify_session(path)
    manifest = load_manifest(path)
    problems = small_capture.lost(manifest, acks, path) + [f"{p.file} {p.message}" for p in report.problems]
    return problems + list(report.missing) + report.notes


def judge(calls: FaultAt, error: Exception | None, patience: int) -> list[str]:
    """Say what is wrong with how a run ended: an error of another type, or one where none may be."""
    if error is not None and type(error) is not expected_error(calls.kind):
        return [f"ended with {error!r}"]
    harmless = calls.kind == "SHORT" or (patience and not calls.lasting)
    if error is not None and harmless:
        return [f"ended with {error!r} though it could go on"]
    if error is not None and not (error.where and error.advice):  # type: ignore[attr-defined]
        return [f"does not say where and what to do: {error}"]
    return []


@pytest.mark.torture
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("patience", [0, PATIENCE], ids=["ends", "goes on"])
@pytest.mark.parametrize("lasting", [False, True], ids=["once", "lasting"])
@pytest.mark.parametrize("kind", list(APPLIES))
def test_fault_at_every_call(parent: Path, kind: str, lasting: bool, patience: int) -> None:
    start, injected, raised, problems = time.monotonic(), 0, 0, []
    stride = 1 if LONG else 13
    nth = 1
    while True:
        folder = parent / str(nth)
        folder.mkdir()
        calls = FaultAt(nth, kind, lasting=lasting)
        acks, error = attempt(folder, calls, patience)
        if not calls.fired:
            break
        injected += 1
        raised += error is not None
        label = f"{kind} at {nth} ({calls.fired})"
        problems += [f"{label}: {p}" for p in judge(calls, error, patience) + after(folder, acks)]
        shutil.rmtree(folder)
        nth += stride
    record(
        f"{kind} at the Nth call, {'lasting' if lasting else 'once'}, {'tried again' if patience else 'run ends'}",
        injected=injected,
        observed=injected,
        lost=len(problems),
        seconds=time.monotonic() - start,
        seed=0,
        notes=f"{raised} ended with a typed error, the others went on",
    )
    assert problems == []
    assert injected >= 1
    if not patience and kind != "SHORT":
        assert raised > injected // 2
