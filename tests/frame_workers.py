"""Processes that check frames, kept from one capture or import of a test to the next.

Each capture starts two or three of them, 0.16 CPU seconds each, most of what a test of a small capture takes. One that
has answered all it was asked is as good for the next: that is how a capture itself uses it. One that died or had to be
ended is gone as ever; tests of these processes themselves (tests/station/frames/test_check.py, tests/torture) and whole
commands in processes of their own start theirs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import pytest

from station.frames.check import FrameChecker

_at_rest: defaultdict[int, list[tuple[Any, tuple[str, ...]]]] = defaultdict(list)
"""Workers and what they gave up, by their memory in bytes."""
_ready_worker = FrameChecker._ready_worker


def _one_at_rest(checker: FrameChecker) -> Any:
    if checker._worker is None and _at_rest[checker._memory_bytes]:
        checker._worker, checker.limits = _at_rest[checker._memory_bytes].pop()
    return _ready_worker(checker)


def _put_to_rest(checker: FrameChecker) -> None:
    with checker._lock:
        worker, checker._worker = checker._worker, None
        if worker is not None:
            _at_rest[checker._memory_bytes].append((worker, checker.limits))


def _end_all() -> None:
    for workers in _at_rest.values():
        while workers:
            workers.pop()[0].end()


@pytest.fixture(scope="module", autouse=True)
def kept_workers(request: pytest.FixtureRequest) -> Iterator[None]:
    """For the tests of a package whose conftest takes it in."""
    request.config.add_cleanup(_end_all)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(FrameChecker, "_ready_worker", _one_at_rest)
        patched.setattr(FrameChecker, "close", _put_to_rest)
        yield
