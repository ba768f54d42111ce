"""Rows of benchmarks are read again, and a run ends in time."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.hostile import hostile, rigs
from benchmarks.kept_rows import Rows
from processing.errors import ScaleError

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


def test_a_hostile_run_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Brackets, refusals too, and rigs are read again by a second run, and no figure of theirs is lost."""
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    monkeypatch.delenv("DAYLIT_BENCH_CPU_S", raising=False)
    score = hostile.Score("world", cover=0.5, lux=[np.True_, False], refused="no light")  # type: ignore[list-item]
    world, scene = SimpleNamespace(name="world"), np.zeros((2, 4, 3), np.float32)
    measured: list[object] = []

    def scored(*case: object, **kind: bool) -> hostile.Score:
        measured.append((case[0].name, case[2], kind))  # type: ignore[attr-defined]
        return score

    def rig_errors(_folder: Path, _bodies: object, _divisor: int, seed: int) -> dict[str, float]:
        measured.append(seed)
        if seed == 1:
            raise ScaleError("too dark")
        return {"k1_err_pct": seed, "lux_sigmas": 1.0}

    monkeypatch.setattr(hostile, "scored", scored)
    monkeypatch.setattr(rigs, "rig_errors", rig_errors)
    monkeypatch.setattr(rigs, "hostile_bodies", lambda *_: {})
    found = []
    for _ in range(2):
        kept = Rows("hostile", 0, hostile.CODE, keep=True).row
        brackets = [hostile._kept_score(kept, world, scene, 7, **kind) for kind in ({}, {"raw": True})]  # type: ignore[arg-type]
        found.append((brackets, rigs.rig_figures((np.zeros(1), []), (1, 2), 8, 1, kept)))
    assert measured == [("world", 7, {}), ("world", 7, {"raw": True}), 1, 2]
    assert found[0] == found[1]
    assert found[1][0][0] == score
    assert found[1][1][0]["hostile_rigs_refused"] == 1
