"""Peak memory as proportional set size: pages shared by processes count once among them."""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any


class MemoryWatch:
    """Samples the memory (MB) of this process, or of another, and its children while the block runs."""

    def __init__(self, every_s: float = 0.05, pid: int | None = None) -> None:
        import psutil

        self._process = psutil.Process(pid)
        self._every_s = every_s
        self._over = threading.Event()
        self.peak_mb = self.own_peak_mb = 0.0
        self.cpu_s = 0.0
        """What watching itself took: to sum up a large process takes some ten milliseconds, not the work's."""
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> MemoryWatch:
        self._sample()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._sample()

    @property
    def sampled_mb(self) -> float:
        """The memory of the process alone, now."""
        self._sample()
        return self.own_peak_mb

    def _watch(self) -> None:
        while not self._over.wait(self._every_s):
            self._sample()
        self.cpu_s = time.thread_time()

    def _sample(self) -> None:
        import psutil

        try:
            own, total = _tree_mb(self._process)
        except psutil.Error:  # it has ended
            return
        self.own_peak_mb, self.peak_mb = max(own, self.own_peak_mb), max(total, self.peak_mb)


def peak_mb(work: Callable[..., Any], *args: Any, every_s: float = 0.01) -> float:
    """Return the peak memory of a fresh process that does ``work`` (a module's function) and nothing else.

    It is watched from outside, since a long call in C lets no other thread of its process look.
    """
    import psutil

    child = multiprocessing.get_context("spawn").Process(target=work, args=args)
    child.start()
    process, peak = psutil.Process(child.pid), 0.0
    while child.is_alive():
        with suppress(psutil.Error):
            peak = max(peak, _tree_mb(process)[1])
        child.join(every_s)
    if child.exitcode != 0:
        raise RuntimeError(f"the work to be watched ended with {child.exitcode}")
    return peak


def _tree_mb(process: Any) -> tuple[float, float]:
    """Return the memory of a process, and of it with all its children."""
    import psutil

    own = total = _pss_mb(process)
    for child in process.children(recursive=True):
        with suppress(psutil.Error):
            total += _pss_mb(child)
    return own, total


def _pss_mb(process: Any) -> float:
    """Return the proportional set size, or where the system does not state it, the resident one."""
    facts = process.memory_full_info()
    return float(getattr(facts, "pss", facts.rss)) / 1e6
