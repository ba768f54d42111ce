"""How many threads work side by side, one number for everything: our own, and those of the libraries.

``DAYLIT_THREADS``, else ``OMP_NUM_THREADS`` (what clusters set), else the cores that this process may use. Results do
not depend on it. Bands and planes are shared among threads by `side_by_side`; `limit_libraries` gives the libraries
that have threads of their own the same number."""

import ctypes
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar, cast

from processing.errors import ParameterError

ASKED = "DAYLIT_THREADS"
MOST = 64  # chosen: more have nothing left to do in a picture
T = TypeVar("T")
R = TypeVar("R")


def threads() -> int:
    """Return how many threads may work; `ParameterError` for a ``DAYLIT_THREADS`` that is no number from 1 up."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    asked = os.environ.get(ASKED, "")
    if asked:
        if not asked.isdecimal() or int(asked) < 1:
            raise ParameterError(f"{ASKED} is {asked!r}", advice=f"give a whole number from 1 to {MOST}, or unset it")
        return min(int(asked), MOST)
    if given.isdecimal() and int(given) > 0:
        return min(int(given), MOST)
    return min(cores_here(), MOST)


def cores_here() -> int:
    """Return how many cores this process may use: a job of a queue often has a part of the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def limit_libraries() -> None:
    """Give OpenCV, and libraries that are loaded later, as many threads as we take; those that are `SPINNING` one."""
    count = threads()
    for name in (*SPINNING, "NUMBA_NUM_THREADS", "OIDN_NUM_THREADS"):
        os.environ.setdefault(name, "1" if name in SPINNING else str(count))
    import cv2

    cv2.setNumThreads(count)
    with suppress(AttributeError, OSError):
        malloc = ctypes.CDLL(None)
        for parameter, value in _POOLS:
            malloc.mallopt(parameter, value)


SPINNING = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Libraries whose idle threads spin (5 % of all CPU time, docs/measurements/pipeline.md); our matrices are small."""
_POOLS = ((-8, 2), (-3, 32 << 20), (-1, 512 << 20))
"""``M_ARENA_MAX``, ``M_MMAP_THRESHOLD``, ``M_TRIM_THRESHOLD`` of glibc's malloc.h. Each of its pools keeps what its
threads once needed: two are enough. A panorama's light goes back to the system as soon as it is freed; smaller arrays,
masks too, stay in the pools until `give_back`, or until more than 512 MiB are free at their end: else their pages are
zeroed anew, again and again."""

FORGET: list[Callable[[], object]] = []
"""What lets go of large things that are kept for their next use: `give_back` calls all of these."""

KEPT_BYTES = 1_200_000_000
"""Of a process, up to which it keeps what it has freed (docs/measurements/pipeline.md: from 2 GB on peaks grow): pages
given back are zeroed anew, and a virtual machine's are taken by its host meanwhile."""


def give_back(kept_bytes: int = KEPT_BYTES) -> None:
    """Let go of what `FORGET` has, and, above ``kept_bytes``, of memory that malloc keeps for its next use (glibc)."""
    for forget in FORGET:
        forget()
    with suppress(AttributeError, OSError):
        if _held_bytes() > kept_bytes:
            ctypes.CDLL(None).malloc_trim(0)


def _held_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


FULL_BYTES, LOOK_S, STEP_BYTES = 1_850_000_000, 0.05, 96 << 20
"""Of a process, from which it is watched, how often, and by how much more it may hold before it gives back again;
chosen: a stage of a full-size session is to hold 2 GB, of which malloc had 0.2 to 0.5 free."""


@contextmanager
def watched() -> Iterator[None]:
    """Give back what malloc has free (glibc) whenever the process holds more than `FULL_BYTES` while the block runs."""
    over = threading.Event()

    def watch() -> None:
        last = 0
        with suppress(AttributeError, OSError):
            while not over.wait(LOOK_S):
                held = _held_bytes()
                if held > max(FULL_BYTES, last + STEP_BYTES):
                    ctypes.CDLL(None).malloc_trim(0)
                    last = held = _held_bytes()
                last = min(last, held)

    with ThreadPoolExecutor(1) as pool:
        pool.submit(watch)
        try:
            yield
        finally:
            over.set()


def together(one: Callable[[], T], other: Callable[[], R]) -> tuple[T, R]:
    """Return the results of two independent calls, made side by side."""
    return cast(tuple[T, R], tuple(side_by_side(at_once, (one, other))))


Later = Callable[[Callable[[], Any]], Any]  # takes a piece of work, to do it some time


def at_once(work: Callable[[], T]) -> T:
    """Do it, where others put it off."""
    return work()


@contextmanager
def behind() -> Iterator[Later]:
    """Give what does work, in order, behind its caller, who gets a `Future`; at once where only one thread may work.

    What a piece of work raises is raised again in place of all that come after it, when one is given, and at the end.
    """
    last: list[Future[Any]] = []
    with ThreadPoolExecutor(1) as pool:

        def later(work: Callable[[], Any]) -> Future[Any]:
            former = last[:]
            if former and former[0].done():
                former[0].result()
            last[:] = [pool.submit(lambda: ([one.result() for one in former], work())[1])]
            wait(last if threads() == 1 else [])
            return last[0]

        yield later
        for one in last:
            one.result()


def side_by_side(work: Callable[[T], R], items: Iterable[T], most: int = MOST) -> list[R]:
    """Return ``work`` of each item, in order, done by as many threads as `threads` says but ``most``.

    What a thread raises is raised here when those before it are done."""
    every, count = list(items), min(threads(), most)
    if count == 1 or len(every) < 2:
        return [work(item) for item in every]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, every))
