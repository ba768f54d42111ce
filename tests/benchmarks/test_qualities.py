"""Run time against error of the whole pipeline: which runs are made, which are kept, and what is said of them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.whole import qualities
from processing.errors import ScaleError


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Return the runs (size, quality) that are made; each costs its size and errs by a tenth of its divisor."""
    runs: list[tuple[str, str]] = []

    def processed(session: Path, *given: Any, until: str | None = None) -> dict[str, Any]:
        quality = given[3]
        assert until in (None, "render")
        divisor = int((session / "divisor").read_text())
        assert not (session / "stages").exists(), "a session of another quality's results"
        (session / "stages").mkdir()
        runs.append((f"1/{divisor}", quality))
        if divisor == 16 and quality == "reference":
            raise ScaleError("no board")
        errors = dict.fromkeys(qualities.ERRORS, divisor / 10) | {"iou3d": 1 - divisor / 1000}
        return {"room": "bedroom-1", "cpu_s": 100 / divisor, "peak_mb": 5, **errors}

    def written(path: Path, taken: int) -> Path:
        path.mkdir(parents=True)
        (path / "divisor").write_text(str(taken))
        return path

    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("DAYLIT_BENCH_CPU_S", raising=False)
    monkeypatch.setattr(qualities, "processed", processed)
    monkeypatch.setattr(qualities, "write_session", written)
    monkeypatch.setattr(qualities, "taken_of", lambda _room, divisor: divisor)
    monkeypatch.setattr(qualities, "truth_of", lambda *_, **__: (SimpleNamespace(name="bedroom-1"), None))
    monkeypatch.setattr(qualities, "rig_profile", lambda _seed: tmp_path)
    monkeypatch.setattr(qualities, "PLOT", tmp_path / "plot.png")
    monkeypatch.setattr(qualities, "_warm", [])
    return runs


def test_every_quality_at_every_size_but_reference_at_the_small_ones(
    made: list[tuple[str, str]], tmp_path: Path
) -> None:
    found = qualities.run(quick=False, seed=0)
    assert made[:2] == [("1/24", "draft")] * 2  # the first run loads libraries
    assert made[2:] == [
        *(("1/24", quality) for quality in ("standard", "reference")),
        *(("1/16", quality) for quality in ("draft", "standard", "reference")),
        *((size, quality) for size in ("1/8", "1/4") for quality in ("draft", "standard")),
    ]
    metrics = found["metrics"]
    assert (metrics["runs"], metrics["refused"]) == (10, 1)
    assert (metrics["standard_cpu_s"], metrics["standard_room_err_pct"]) == (25.0, 0.4)  # of 1/4, the largest
    assert metrics["reference_cpu_s"] == pytest.approx(100 / 24)  # 1/16 was refused
    assert any("reference 1/16: " in line and "no board" in line for line in found["notes"])
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_a_run_goes_on_where_it_ended(made: list[tuple[str, str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qualities, "draw", lambda *_: None)
    monkeypatch.setattr(qualities, "FULL_DIVISORS", (24,))
    first = qualities.run(quick=False, seed=0)
    count = len(made)
    monkeypatch.setattr(qualities, "FULL_DIVISORS", (24, 8))
    second = qualities.run(quick=False, seed=0)
    assert made[count:] == [("1/8", "draft"), ("1/8", "standard")]
    assert second["notes"][:3] == first["notes"]
    monkeypatch.setenv("DAYLIT_BENCH_CPU_S", "-1")
    monkeypatch.setattr(qualities, "FULL_DIVISORS", (24, 8, 4))
    assert qualities.run(quick=False, seed=0)["notes"] == second["notes"]  # what is kept, and no more


def test_quick_runs_all_qualities_once_and_keeps_none(made: list[tuple[str, str]], tmp_path: Path) -> None:
    found = qualities.run(quick=True, seed=0)
    assert made == [("1/24", quality) for quality in qualities.QUALITIES]
    assert {f"{quality}_cpu_s" for quality in qualities.QUALITIES} <= set(found["metrics"])
    assert not (tmp_path / "plot.png").exists()
