"""The end-to-end benchmark's parts: furniture truly placed in a simulated room, rows kept, medians."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.light import emptying
from benchmarks.whole import end_to_end
from benchmarks.whole.end_to_end_plot import spread_lines, table_lines, worst_of, write_plot
from benchmarks.whole.end_to_end_room import staged_room
from benchmarks.whole.end_to_end_run import _quantiles
from mocks.rooms.room import make_room
from processing.errors import BracketError
from processing.layout.arrange import arrange
from processing.layout.arrangement import PlacedItem
from processing.layout.items import parse_items
from processing.layout.plan_files import read_plan


def placed(folder: Path) -> tuple[PlacedItem, ...]:
    corners = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.5], [-2.0, 2.5]]
    door = {"kind": "door", "edge": 0, "t0": 0.3, "t1": 1.2}
    (folder / "plan.json").write_text(json.dumps({"polygon": corners, "openings": [door]}))
    return arrange(read_plan(folder / "plan.json"), parse_items("desk"), "tight", n=1).arrangements[0].items


def test_medians_are_over_what_rooms_have() -> None:
    spent: list[dict[str, Any]] = [
        {"cpu_s": s, "peak_mb": mb, "stage_cpu_s": {"merge": m}} for s, mb, m in ((3.0, 5, 1), (9.0, 7, 3))
    ]
    rows: list[dict[str, Any]] = [
        {"room": "a", "iou3d": 0.9, "luminance_median_err_pct": 2.0, **spent[0]},
        {"room": "b", "iou3d": 0.5, "luminance_median_err_pct": 1.0, **spent[1]},
        {"room": "c", "refused": "CAL-002: nothing"},
    ]
    found = end_to_end.metrics_of(rows)
    assert found["rooms"] == 3
    assert found["refused"] == 1
    assert found["iou3d_median"] == pytest.approx(0.7)
    assert found["iou3d_rooms"] == 2
    assert found["luminance_median_err_pct"] == 1.5
    assert (found["seconds"], found["peak_mb"], found["merge_cpu_s"]) == (6.0, 7, 2.0)
    assert (found["q25_iou3d"], found["q75_iou3d"], found["worst_iou3d"]) == (0.6, 0.8, 0.5)
    assert found["worst_luminance_median_err_pct"] == 2.0
    assert table_lines(rows)[2] == "c: CAL-002: nothing"
    result = "iou3d: median 0.7, quartiles 0.6 and 0.8, worst 0.5 (b), 2 rooms"
    assert spread_lines(rows, ["iou3d"]) == [result]


def test_emptying_counts_rooms_and_clipped_windows() -> None:
    rows: list[dict[str, Any]] = [
        {
            "room": "a",
            "staged_median_err_pct": 16.0,
            "pane_worst_pct": 1.0,
            "stage_cpu_s": {"light": 2.0, "remove": 1.0},
        },
        {"room": "b", "staged_median_err_pct": 9.0, "pane_worst_pct": 4.0, "stage_cpu_s": {"light": 4.0, "merge": 9.0}},
        {"room": "c", "pane_worst_pct": 3.0, "stage_cpu_s": {}},
    ]
    found = emptying._metrics(rows)
    assert (found["staged_above_15"], found["pane_worst_pct"], found["pane_median_pct"]) == (1, 4.0, 3.0)
    assert found["cpu_s"] == 3.0
    clipped = [("a at 2", 4.0, 2.0, 1.0, 3.9), ("a at 3", 2.0, 2.0, 1.0, 4.0), ("b at 2", 2.0, 8.0, 2.1, 9.0)]
    assert emptying.clipped_metrics("windows", clipped) == {
        "clipped_windows": 3,
        "clipped_windows_err_stops": 1.0,
        "clipped_windows_worst_stops": 2.0,
        "clipped_windows_cover90_pct": 33.3,
    }
    assert emptying.clipped_metrics("windows", []) == {}


def test_of_a_bias_the_farthest_from_nothing_is_the_worst() -> None:
    rows: list[dict[str, object]] = [{"room": "a", "staged_bias_pct": 3.0}, {"room": "b", "staged_bias_pct": -9.0}]
    assert worst_of(rows, "staged_bias_pct")["room"] == "b"


def test_the_plot_takes_one_room_and_none(tmp_path: Path) -> None:
    path = tmp_path / "plot.png"
    write_plot([{"room": "c", "refused": "CAL-002: nothing"}], path)
    assert not path.exists()
    write_plot([{"room": "a", "iou3d": 0.9, "cpu_s": 3.0, "stage_cpu_s": {"merge": 1.0}}], path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_errors_count_by_solid_angle() -> None:
    true = np.ones((64, 128))
    ours = true.copy()
    ours[:8] = 2.0  # a polar cap: an eighth of the rows, 1.9 % of the sphere
    found = _quantiles("x", ours, true, np.ones(true.shape, bool))
    assert found == {"x_median_err_pct": 0.0, "x_p95_err_pct": 0.0}
    assert _quantiles("x", ours, true, np.zeros(true.shape, bool)) == {}


def test_rows_are_kept_and_a_refused_room_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    monkeypatch.setenv("DAYLIT_BENCH_ROWS", "test")
    monkeypatch.setattr(end_to_end, "FULL_ROOMS", 2)
    asked: list[int] = []

    def measured(number: int, *_: object) -> dict[str, object]:
        asked.append(number)
        if len(asked) == 2:
            raise BracketError("nothing to merge")
        return {"room": f"room-{number}", "iou3d": 0.8}

    monkeypatch.setattr(end_to_end, "measured", measured)
    first = end_to_end.rows_of(tmp_path / "rig.json", 0, quick=False)
    again = end_to_end.rows_of(tmp_path / "rig.json", 0, quick=False)
    assert first == again
    assert len(asked) == 2
    assert first[1]["refused"] == "CAL-002: nothing to merge"
    (kept,) = (tmp_path).glob("end-to-end-rows-*.jsonl")
    assert [json.loads(line) for line in kept.read_text().splitlines()] == first


def test_furniture_is_truly_placed(tmp_path: Path) -> None:
    room = make_room(900_001, "bedroom")
    items = placed(tmp_path)
    staged = staged_room(room, items, "scandinavian")
    assert staged.items == ()
    assert staged.key != room.emptied().key
    assert staged_room(room, items, "mid-century").key != staged.key
    assert len(staged.parts()) == len(room.emptied().parts()) + len(staged.extra)
    corners = np.concatenate([part.mesh.vertices for part in staged.extra])
    (desk,) = items
    wide = np.hypot(*desk.size_m[:2]) / 2 + 0.01
    assert (np.abs(corners[:, :2] - np.array(desk.t_m[:2])) <= wide).all()
    assert corners[:, 2].min() >= 0
    for part in staged.extra:
        np.testing.assert_allclose(np.linalg.norm(part.mesh.normals, axis=1), 1, atol=1e-6)
        assert all(0 <= v <= 1 for v in part.material.colour)
