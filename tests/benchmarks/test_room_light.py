"""The rooms' light measured: figures of made-up runs, the rooms chosen, and what is kept on disk."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.light import room_light as _room_light
from benchmarks.light.room_light import Run, cost_ratio, summary, sunny_rooms
from benchmarks.paired import Cost
from benchmarks.seeds import TEST
from mocks.rooms.light.sunlight import enters
from mocks.rooms.model import Use


def run(method: str, cpu_s: float, errors: list[float], bias: float = 0.0) -> Run:
    return Run(method, "x", Cost(cpu_s, cpu_s / 2), np.array(errors), bias)


def test_costs_are_of_one_room_and_errors_of_all_points() -> None:
    found = summary([run("ours", 2.0, [0.01, -0.03], 0.02), run("ours", 4.0, [0.05, -0.2], -0.04)])
    assert found.figures() == {
        "cpu_s": 3.0,
        "wall_s": 1.5,
        "median_err_pct": 4.0,
        "p95_err_pct": pytest.approx(17.75),
        "bias_pct": -1.0,
    }
    assert "ours x: 3.0 CPU s" in str(found)


def test_a_rival_three_times_as_wrong_needs_nine_times_its_time() -> None:
    ours, rival = summary([run("ours", 2.0, [0.1])]), summary([run("path", 1.0, [0.3])])
    assert cost_ratio(ours, rival) == pytest.approx(2 / 9)
    assert cost_ratio(ours, ours) == pytest.approx(1.0)


def test_rooms_are_furnished_test_rooms_with_sun_in_them() -> None:
    (room,) = sunny_rooms(1, 0)
    assert room.seed in TEST
    assert room.plan.use is not Use.EMPTY
    assert room.sky.kind == "clear"
    assert enters(room.panes, room.sky.disc())
    assert not room.lamps_on


def test_the_measure_is_kept_by_what_it_depends_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[tuple[int, int]] = []

    def meter(scene: Any, places: Any, number: int, samples: int, batch: int) -> float:
        asked.append((samples, batch))
        return number + batch / 10

    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    monkeypatch.setattr(_room_light, "_meter", meter)
    monkeypatch.setattr(_room_light, "_whole", lambda room: None)
    monkeypatch.setattr(_room_light, "load_scene", lambda *parts, glossy: None)
    geometry, places = SimpleNamespace(parts=[]), SimpleNamespace(point=np.ones((40, 3), np.float32))

    def measured(room: str, samples: int) -> Any:
        return _room_light._metered(SimpleNamespace(key=room), geometry, places, samples)  # type: ignore[arg-type]

    first = measured("a", 64)
    assert first.shape == (_room_light.POINTS, _room_light.BATCHES)
    assert asked[:4] == [(16, 0), (16, 1), (16, 2), (16, 3)]
    count = len(asked)
    np.testing.assert_array_equal(measured("a", 64), first)
    assert len(asked) == count
    measured("b", 64)
    measured("a", 128)
    assert len(asked) == 3 * count
