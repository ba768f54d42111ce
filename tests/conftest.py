"""For all tests: Hypothesis draws the same examples in every run, new ones where DAYLIT_TORTURE=1; one cache of worlds.

A run that fails by chance says nothing to a user about what he changed; the long runs look for new ones, and for more.
"""

from __future__ import annotations

import gc
import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.internal.conjecture import providers
from platformdirs import user_cache_path

from benchmarks.shared_data import DATA
from processing.ground.threads import limit_libraries

ROOT = Path(__file__).resolve().parents[1]
MEMORY = Path("/dev/shm")
"""A disk in memory, where there is such."""
ROOM_BYTES = 4 << 30
"""Free there for the workers' folders; chosen: six times what a run leaves."""
KEPT_S = 7 * 86_400
"""Worlds of other sources (chosen: somebody who goes back to yesterday's branch finds them)."""

TOGETHER = ("tests/processing/commands/test_rig_", "tests/architecture/test_")
"""How names of files begin that share what is made once: simulated cameras of rigs; the parsed sources."""
os.environ["DAYLIT_MODELS"] = os.devnull
"""No network of others, whatever is installed here."""
LONG = os.environ.get("DAYLIT_TORTURE") == "1"
"""Whether sweeps go over everything."""

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""For small matrices a second thread waits more than it works, and workers of the tests are side by side as it is."""

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
"""Byte code is kept: each of the many programs that tests start would else compile all that it imports."""

gc.set_threshold(100_000, 20, 100)
"""Chosen: at Python's own 700 a quarter of the collection and half of reading sources goes into looking for garbage."""

SLOW = [HealthCheck.too_slow]  # a busy machine, not a test's fault
settings.register_profile("same", derandomize=True, max_examples=20, suppress_health_check=SLOW, deadline=None)
settings.register_profile("new", print_blob=True, deadline=None)
settings.load_profile("new" if LONG else "same")
if not LONG:
    # It would read all sources that are loaded for numbers to try (4 s a worker), and the same examples in every run
    # would hang on what a worker has run before.
    providers._get_local_constants = providers.Constants


def pytest_configure(config: pytest.Config) -> None:
    """Give all workers, and later runs, one folder for simulated worlds: what one has made, none makes again.

    Worlds are what tests start from, not what they test: they are kept by the content of what makes them, and those of
    another content go when they were not used for a week. The long runs make all of them anew.
    """
    if hasattr(config, "workerinput"):
        limit_libraries()  # as `daylit process` begins: malloc else zeroes the pages of each large array anew
        return
    if LONG:
        folder = Path(tempfile.mkdtemp(prefix="daylit-test-worlds-"))
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
    else:
        kept = user_cache_path("daylit") / "tests"
        folder = kept / sources_digest()
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for other in kept.iterdir():
            if time.time() - other.stat().st_mtime > KEPT_S:
                shutil.rmtree(other, ignore_errors=True)
        in_memory(config)
    os.environ["DAYLIT_CACHE"] = str(folder)


def in_memory(config: pytest.Config) -> None:
    """Have workers' temporary folders in memory: sessions are synchronised file by file, which a disk is waited for.

    They go with the run. Without workers, or with ``--basetemp``, they stay as ever, to be looked at.
    """
    several = getattr(config.option, "numprocesses", None) and config.option.basetemp is None
    if not several or not MEMORY.is_dir() or shutil.disk_usage(MEMORY).free < ROOM_BYTES:
        return
    for killed in MEMORY.glob("daylit-tests-*"):
        if time.time() - killed.stat().st_mtime > 86_400:  # a day: no run is as long
            shutil.rmtree(killed, ignore_errors=True)
    folder = tempfile.mkdtemp(prefix="daylit-tests-", dir=MEMORY)
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
    os.environ["PYTEST_DEBUG_TEMPROOT"] = folder


@given(st.none())
def first_example(_nothing: None) -> None:
    """At its first one Hypothesis searches all objects there are."""


def pytest_collection() -> None:
    """Have that done while they are few."""
    first_example()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave to the long runs what is marked for them: a dearer test of what another one finds, too.

    A test that is marked `shared`, with what it reads of the shared data, is left out where that is missing.
    """
    if not LONG and item.get_closest_marker("long"):
        pytest.skip("dearer than what it adds: make torture")
    needed = [path for mark in item.iter_markers("shared") for path in mark.args]
    if missing := [path for path in needed if not (DATA / path).exists()]:
        pytest.skip(f"no shared data {', '.join(missing)} beside the checkout, or where DAYLIT_SHARED says")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With ``--dist loadfile`` keep `TOGETHER` on one worker, too."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Files(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return next((begin for begin in TOGETHER if file.startswith(begin)), file)

    return Files(config, log)


def pytest_collection_finish() -> None:
    """Collect garbage once, with its warnings, and hide what lives from collectors: pytest ends with five searches."""
    gc.collect()
    gc.freeze()


pytest_sessionfinish = pytest_collection_finish


@pytest.fixture
def parent() -> Iterator[Path]:
    """A folder in memory, where there is such: faults of disks are tried by the hundred."""
    folder = Path(tempfile.mkdtemp(prefix="daylit-", dir=MEMORY if MEMORY.is_dir() else None))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def sources_digest() -> str:
    """Return the digest of all that simulated worlds are made by."""
    digest = hashlib.sha256()
    for folder in ("mocks", "processing/ground", "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*.*")):
            if path.suffix in (".py", ".toml", ".light"):
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]
