"""Peak memory as proportional set size: pages shared by processes count once among them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


class MemoryWatch:
    """Samples the memory (MB) of this process and its children while the block runs."""

    def __init__(self, every_s: float = 0.05) -> None:
        import psutil

        self._process = psutil.Process()
        self._every_s = every_s
        self._over = threading.Event()
        self.peak_mb = self.own_peak_mb = 0.0
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> MemoryWatch:
        self._sample()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._sample()

    def _watch(self) -> None:
        while not self._over.wait(self._every_s):
            self._sample()

    def _sample(self) -> None:
        import psutil

        own = _pss_mb(self._process)
        total = own
        for child in self._process.children(recursive=True):
            try:
                total += _pss_mb(child)
            except psutil.Error:
                continue
        self.own_peak_mb, self.peak_mb = max(own, self.own_peak_mb), max(total, self.peak_mb)


def peak_mb(work: Callable[..., Any], *args: Any) -> float:
    """Return the peak memory of a fresh process that does ``work`` (a module's function) and nothing else."""
    import multiprocessing

    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_watched, (work, args))


def _watched(work: Callable[..., Any], args: tuple[Any, ...]) -> float:
    with MemoryWatch(0.01) as memory:
        work(*args)
    return memory.peak_mb


def _pss_mb(process: Any) -> float:
    """Return the proportional set size, or where the system does not tell it, the resident one."""
    facts = process.memory_full_info()
    return float(getattr(facts, "pss", facts.rss)) / 1e6
