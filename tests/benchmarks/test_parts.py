"""Paired ratios, memory, plots and seeds of the measuring bench."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from benchmarks import paired as _paired
from benchmarks.memory import MemoryWatch, peak_mb
from benchmarks.paired import Cost, compare, robust_spread
from benchmarks.plots import Point, time_against_error
from benchmarks.seeds import TEST, TRAIN, VALIDATION, Split, seeds


def test_pairs_run_in_the_order_abba(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    found = compare(lambda: order.append("A"), lambda: order.append("B"), pairs=4, warm=True)
    assert "".join(order) == "AB" + "ABBAABBA"
    assert found.pairs == 4


def test_ratio_is_of_neighbours_and_ignores_an_outlier(monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine slows down fourfold on the way, and one run is disturbed: ours still takes half."""
    slowness = [1.0, 1.5, 2.0, 3.0, 4.0]
    ours, rival = [0.5 * s for s in slowness], list(slowness)
    ours[2] *= 30

    def cost_of(work: str) -> Cost:
        seconds = (ours if work == "ours" else rival).pop(0)
        return Cost(seconds, 2 * seconds)

    monkeypatch.setattr(_paired, "cost_of", cost_of)
    found = compare("ours", "rival", pairs=5, warm=False)  # type: ignore[arg-type]
    assert found.cpu_ratio == pytest.approx(0.5)
    assert found.wall_ratio == pytest.approx(0.5)
    assert found.cpu_ratio_spread == pytest.approx(0.0)
    assert found.metrics("robertson")["cpu_ratio_robertson"] == 0.5


def test_synthetic_pair_is_distinguished() -> None:
    def work(rounds: int) -> int:
        return sum(i * i for i in range(rounds))

    found = compare(lambda: work(600_000), lambda: work(2_400_000), pairs=3)
    assert 0.1 < found.cpu_ratio < 0.6
    assert found.ours.cpu_s < found.rival.cpu_s


def test_spread_is_a_standard_deviation_without_outliers() -> None:
    assert robust_spread([1.0]) == 0.0
    assert robust_spread([1.0, 2.0, 3.0, 4.0, 1000.0]) == pytest.approx(1.4826)


def fill(size_mb: int) -> None:
    held = bytearray(b"x") * (size_mb * 1_000_000)
    time.sleep(0.2)
    assert len(held) == size_mb * 1_000_000


@pytest.mark.long
def test_peak_memory_of_a_child_is_seen() -> None:
    small, large = peak_mb(fill, 1), peak_mb(fill, 200)
    assert 150 < large - small < 300
    with MemoryWatch() as watch:
        pass
    assert watch.peak_mb >= watch.own_peak_mb > 5


def test_what_watching_took_is_known_and_not_the_works() -> None:
    start_s = time.process_time()
    with MemoryWatch(0.001) as watch:
        time.sleep(0.3)
    assert 0 < watch.cpu_s < time.process_time() - start_s


@pytest.mark.parametrize("name", ["plot.svg", "plot.png"])
def test_plot_is_small_and_the_same_each_time(tmp_path: Path, name: str) -> None:
    points = [Point("ours", 0.1, 3.0, "4"), Point("ours", 1.0, 1.0, "64"), Point("path", 10.0, 2.0, "256 spp")]
    path = time_against_error(points, tmp_path / name, title="Time against error", error_label="median error, %")
    first = path.read_bytes()
    assert 3_000 < len(first) < 150_000
    assert time_against_error(points, path, title="Time against error", error_label="median error, %").samefile(path)
    assert path.read_bytes() == first


def test_splits_share_no_seed() -> None:
    assert (TRAIN.start, TRAIN.stop, VALIDATION.stop, TEST.stop) == (0, 800_000, 900_000, 1_000_000)
    assert (TRAIN.stop, VALIDATION.stop) == (VALIDATION.start, TEST.start)


@pytest.mark.parametrize(("split", "among"), [("train", TRAIN), ("validation", VALIDATION), ("test", TEST)])
def test_seeds_are_drawn_reproducibly_without_repetition(split: Split, among: range) -> None:
    drawn = seeds(split, 200, 5)
    assert drawn == seeds(split, 200, 5)
    assert drawn[:40] == seeds(split, 40, 5)
    assert drawn != seeds(split, 200, 6)
    assert len(set(drawn)) == 200
    assert set(drawn) <= set(among)


def test_seeds_stay_the_ones_that_figures_were_taken_with() -> None:
    assert seeds("test", 3) == [927023, 926152, 961331]


def test_more_seeds_than_there_are_is_refused() -> None:
    with pytest.raises(ValueError, match="100000 seeds"):
        seeds("test", 100_001)
