"""How many threads work: as asked, or as the machine has cores; results in order, errors raised."""

from __future__ import annotations

import os
import sys
import threading
from types import SimpleNamespace

import cv2
import pytest

from processing.errors import ParameterError
from processing.ground import threads as module
from processing.ground.threads import (
    ASKED,
    MOST,
    STEP_BYTES,
    behind,
    give_back,
    limit_libraries,
    side_by_side,
    threads,
    together,
    watched,
)


def test_as_many_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ASKED, "3")
    assert threads() == 3
    monkeypatch.setenv(ASKED, "1000")
    assert threads() == MOST
    monkeypatch.delenv(ASKED)
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    assert threads() == 5
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert threads() >= 1


def test_libraries_take_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    before = cv2.getNumThreads()
    monkeypatch.setenv(ASKED, "2")
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OIDN_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    limit_libraries()
    assert cv2.getNumThreads() == 2
    assert os.environ["OIDN_NUM_THREADS"] == "2"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1", "its threads wait by spinning"
    cv2.setNumThreads(before)


@pytest.mark.parametrize("asked", ["0", "-1", "two", "1.5"])
def test_no_number_is_a_named_error(monkeypatch: pytest.MonkeyPatch, asked: str) -> None:
    monkeypatch.setenv(ASKED, asked)
    with pytest.raises(ParameterError, match=ASKED):
        threads()


def test_work_is_side_by_side_and_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ASKED, "2")
    both = threading.Barrier(2, timeout=30)

    def work(number: int) -> int:
        if number < 2:
            both.wait()
        return 2 * number

    assert side_by_side(work, range(5)) == [0, 2, 4, 6, 8]


def test_two_calls_together_give_both_and_raise_the_first_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ASKED, "2")
    both = threading.Barrier(2, timeout=30)
    assert together(lambda: (both.wait(), "one")[1], lambda: (both.wait(), 2)[1]) == ("one", 2)
    with pytest.raises(ZeroDivisionError):
        together(lambda: 1 // 0, lambda: 2)


def test_what_a_thread_raises_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ASKED, "2")

    def work(number: int) -> int:
        if number == 3:
            raise ValueError("three")
        return number

    with pytest.raises(ValueError, match="three"):
        side_by_side(work, range(5))


def test_work_behind_is_done_in_order_while_its_caller_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ASKED, "2")
    gate, done = threading.Event(), list[int]()
    with behind() as later:
        later(lambda: gate.wait(30) and done.append(1))
        two = later(lambda: done.append(2) or "two")
        assert done == [], "the caller goes on"
        gate.set()
        assert two.result() == "two"
        later(lambda: done.append(3))
    assert done == [1, 2, 3]
    monkeypatch.setenv(ASKED, "1")
    with behind() as later:
        later(lambda: done.append(4))
        assert done == [1, 2, 3, 4], "at once where one thread may work"


@pytest.mark.parametrize("further", [0, 1])
def test_what_work_behind_raises_is_raised_at_the_next_and_at_the_end(further: int) -> None:
    went_on = []

    def caller() -> None:
        with behind() as later:
            later(lambda: 1 // 0).exception(timeout=30)
            for _ in range(further):
                later(lambda: None)
            went_on.append(1)

    with pytest.raises(ZeroDivisionError):
        caller()
    assert len(went_on) == 1 - further


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's malloc")
def test_memory_goes_back_only_above_what_a_process_may_keep(monkeypatch: pytest.MonkeyPatch) -> None:
    trimmed, forgotten = list[int](), list[int]()
    monkeypatch.setattr(module.ctypes, "CDLL", lambda _: SimpleNamespace(malloc_trim=trimmed.append))
    monkeypatch.setattr(module, "FORGET", [lambda: forgotten.append(1)])
    give_back(1 << 50)
    assert (trimmed, forgotten) == ([], [1])
    give_back(1 << 20)
    assert (trimmed, forgotten) == ([0], [1, 1])


def test_free_memory_is_given_back_when_much_is_held_and_again_when_more_is(monkeypatch: pytest.MonkeyPatch) -> None:
    full, looks, given = module.FULL_BYTES, threading.Semaphore(0), list[int]()
    held = [full]

    def look() -> int:
        looks.release()
        return held[0]

    def trim(_: int) -> None:
        given.append(held[0])
        held[0] -= STEP_BYTES

    def looked_at(held_bytes: int) -> list[int]:
        held[0] = held_bytes
        while looks.acquire(blocking=False):
            pass
        assert all(looks.acquire(timeout=30) for _ in range(4))
        return given

    monkeypatch.setattr(module, "LOOK_S", 0.001)
    monkeypatch.setattr(module, "_held_bytes", look)
    monkeypatch.setattr(module.ctypes, "CDLL", lambda _: SimpleNamespace(malloc_trim=trim))
    with watched():
        assert looked_at(full) == []
        assert looked_at(full + 3 * STEP_BYTES) == [full + 3 * STEP_BYTES]
        assert len(looked_at(full + 3 * STEP_BYTES)) == 1, "hardly more than what was left"
        assert len(looked_at(full + 4 * STEP_BYTES)) == 2
        looked_at(full - STEP_BYTES)
        assert len(looked_at(full + 1)) == 3, "what was left before no longer counts"
    while looks.acquire(blocking=False):
        pass
    assert not looks.acquire(timeout=0.05), "when the block has ended, nobody looks"
