"""Power cuts at every operation of a capture and of a resume, with every kind of loss that file systems allow."""

from __future__ import annotations

import itertools
import os
import random
import shutil
import time
from pathlib import Path

import pytest

from station.errors import DaylitError
from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.torture import small_capture
from tests.torture.disk.power_cut import DATA_CHOICES, NAME_CHOICES, Op, Recorder, build, without_syncs
from tests.torture.ledger import record
from tests.torture.os_faults import FaultAt, installed
from tests.torture.small_capture import Ack

LONG = os.environ.get("DAYLIT_TORTURE") == "1"
SEED = 20230519
HOWS = list(itertools.product(NAME_CHOICES, DATA_CHOICES))


def recorded_run(folder: Path, failing: int = 0) -> tuple[list[Op], int]:
    """Run the capture; return its operations and how many of them stand for what was there before."""
    recorder = Recorder(folder, failing=failing)
    given = len(recorder.log)
    with installed(recorder):
        small_capture.run(folder, recorder.acknowledge, patience=1 if failing else 0)
    assert bool(recorder.failed) == bool(failing)
    return recorder.log, given


def interrupted(folder: Path, nth: int) -> None:
    """Leave what a capture leaves that ends at its Nth call."""
    folder.mkdir()
    with installed(FaultAt(nth, "EIO", lasting=True)), pytest.raises(DaylitError):
        small_capture.run(folder, lambda _ack: None)


def recovered(image: Path, acks: list[Ack], *, resume: bool) -> list[str]:
    """Recover an image; return what is lost or wrong."""
    found = small_capture.sessions(image)
    if not found:
        return [f"lost {ack}" for ack in acks]
    try:
        with SessionStore.open(found[0], writable=True) as store:
            problems = small_capture.lost(store.manifest, acks, store.path)
        if resume:
            small_capture.run(image, acks.append)
            report = verify_session(found[0])
            problems += [f"{p.file} {p.message}" for p in report.problems] + list(report.missing)
    except DaylitError as exc:
        return [repr(exc)]
    return problems


def bad_images(
    log: list[Op], parent: Path, per_cut: int, *, given: int = 0, resume_every: int = 0
) -> tuple[int, list[str]]:
    """Cut after every operation, ``per_cut`` images each; return how many there were and what was bad."""
    rng = random.Random(SEED)
    injected, bad = 0, []
    for cut in range(given, len(log) + 1):
        if cut < len(log) and log[cut].kind == "ack":
            continue  # the same disk as one operation later
        acks = [op.ack for op in log[:cut] if op.kind == "ack"]
        for names_how, data_how in rng.choices(HOWS, k=per_cut):
            image = parent / "image"
            image.mkdir()
            build(log[:cut], image, names_how, data_how, rng)
            injected += 1
            resume = bool(resume_every) and injected % resume_every == 0
            problems = recovered(image, list(acks), resume=resume)
            if problems:
                bad.append(f"cut {cut}, names {names_how}, data {data_how}: {problems}")
            shutil.rmtree(image)
    return injected, bad


@pytest.mark.torture
@pytest.mark.timeout(1800)
def test_power_cut_in_a_capture(parent: Path) -> None:
    start = time.monotonic()
    (parent / "run").mkdir()
    log, _ = recorded_run(parent / "run")
    injected, bad = bad_images(log, parent, 22 if LONG else 2, resume_every=5)
    record(
        "power cut at every operation of a capture",
        injected=injected,
        observed=injected,
        lost=len(bad),
        seconds=time.monotonic() - start,
        seed=SEED,
        notes="unsynced data kept, lost, cut, zeroed; unsynced names kept or lost; one in five resumed to the end",
    )
    assert bad == []
    assert injected >= (2000 if LONG else 200)


@pytest.mark.torture
@pytest.mark.timeout(1800)
def test_power_cut_in_a_resume(parent: Path) -> None:
    start, injected, bad = time.monotonic(), 0, []
    for nth in (40, 60, 70, 80, 90, 100) if LONG else (76,):
        folder = parent / f"run-{nth}"
        interrupted(folder, nth)
        log, given = recorded_run(folder)
        more, worse = bad_images(log, parent, 5 if LONG else 1, given=given, resume_every=5)
        injected += more
        bad += worse
    record(
        "power cut at every operation of a resume",
        injected=injected,
        observed=injected,
        lost=len(bad),
        seconds=time.monotonic() - start,
        seed=SEED,
    )
    assert bad == []
    assert injected >= (1000 if LONG else 30)


@pytest.mark.torture
@pytest.mark.timeout(1800)
def test_power_cut_after_a_failing_write_or_sync(parent: Path) -> None:
    """The disk fails once, the station goes on in the same session, and then the power goes."""
    start, injected, bad = time.monotonic(), 0, []
    for failing in range(1, 79) if LONG else (29, 41):
        folder = parent / f"run-{failing}"
        folder.mkdir()
        log, _ = recorded_run(folder, failing)
        more, worse = bad_images(log, parent, 1, resume_every=5)
        injected += more
        bad += worse
        shutil.rmtree(folder)
    record(
        "power cut after a failing write or sync",
        injected=injected,
        observed=injected,
        lost=len(bad),
        seconds=time.monotonic() - start,
        seed=SEED,
        notes="the step is tried again in the same open session",
    )
    assert bad == []
    assert injected >= (5000 if LONG else 130)


@pytest.mark.torture
@pytest.mark.parametrize("forgotten", [{"fsync", "sync"}, {"fsync"}, {"sync"}], ids=lambda s: "+".join(sorted(s)))
def test_the_model_sees_forgotten_syncs(parent: Path, forgotten: set[str]) -> None:
    """The negative control: a program without these syncs must fail, or the images prove nothing."""
    start = time.monotonic()
    (parent / "run").mkdir()
    log, _ = recorded_run(parent / "run")
    log = without_syncs(log, forgotten)
    injected, bad = bad_images(log, parent, 6 if LONG else 1)
    record(
        f"negative control: power cut without {' and '.join(sorted(forgotten))}",
        injected=injected,
        observed=len(bad),
        lost=0,
        seconds=time.monotonic() - start,
        seed=SEED,
        notes="bad images are what is wanted here",
    )
    assert len(bad) >= 0.2 * injected
