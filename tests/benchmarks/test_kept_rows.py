"""Rows of benchmarks are read again, and a run ends in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.kept_rows import Rows

CODE = {"ours": ("benchmarks/kept_rows.py",), "theirs": ()}


def test_a_row_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    monkeypatch.delenv("DAYLIT_BENCH_CPU_S", raising=False)
    first = Rows("room", 0, CODE, keep=True)
    assert first.row("one", lambda: {"iou": np.float64(0.5), "names": ("a", "b")}) == {"iou": 0.5, "names": ["a", "b"]}
    again = Rows("room", 0, CODE, keep=True)
    assert again.row("one", lambda: pytest.fail("made twice")) == {"iou": 0.5, "names": ["a", "b"]}
    assert Rows("room", 1, CODE, keep=True).row("one", lambda: 2) == 2


def test_time_that_is_up_ends_a_run_but_not_what_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    Rows("room", 0, CODE, keep=True).row("one", lambda: 1)
    monkeypatch.setenv("DAYLIT_BENCH_CPU_S", "-1")
    late = Rows("room", 0, CODE, keep=True)
    assert late.row("one", lambda: pytest.fail("made twice")) == 1
    with pytest.raises(TimeoutError, match="1 rows are kept"):
        late.row("two", lambda: 2)


def test_quick_runs_keep_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    monkeypatch.setenv("DAYLIT_BENCH_CPU_S", "-1")
    assert Rows("room", 0, CODE, keep=False).row("one", lambda: 1) == 1
    assert not list(tmp_path.glob("room-rows*"))


def test_rows_of_rivals_outlast_changes_of_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    first = Rows("room", 0, CODE, keep=True)
    assert (first.row("one", lambda: 1), first.row("one", lambda: 2, "theirs")) == (1, 2)
    changed = Rows("room", 0, {"ours": ("benchmarks/form.py",), "theirs": ()}, keep=True)
    assert not changed.knows("one")
    assert changed.row("one", lambda: 3) == 3
    assert changed.row("one", lambda: pytest.fail("made twice"), "theirs") == 2


def test_code_that_has_moved_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="gone"):
        Rows("room", 0, {"ours": ("benchmarks/kept_rows.py", "processing/gone*.py")}, keep=True)
