"""Rooms of another generator: which are found, which half is never looked at, and what their passes say."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from benchmarks.light import emptying, independent
from benchmarks.removal import infinigen_rooms
from benchmarks.shared_data import DATA


def test_rooms_are_found_in_both_folders_and_even_seeds_are_never_looked_at(tmp_path: Path) -> None:
    for name in ("given/bedroom-1", "made/living-room-12/light-1", "made/living-room-12/light-2"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "furnished.exr").touch()
    pairs = independent.pairs_of(tmp_path / "given", tmp_path / "made", tmp_path / "nowhere")
    assert [pair.name for pair in pairs] == ["bedroom-1", "living-room-12/light-1", "living-room-12/light-2"]
    assert [independent.unseen(pair) for pair in pairs] == [False, True, True]


def test_each_half_has_its_medians_and_of_the_unseen_half_nothing_else_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("bedroom-1", "bedroom-3", "bedroom-2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "furnished.exr").touch()
    monkeypatch.setattr(independent, "DATA", tmp_path / "none")
    monkeypatch.setenv("DAYLIT_INFINIGEN", str(tmp_path))
    monkeypatch.setattr(
        independent,
        "row_of",
        lambda pair, shade: (
            {"room": pair.name, "mask_iou": len(shade) * 0.1, "all_bias_pct": float(pair.name[-1])}
            | ({"filled_median_err_pct": 5.0} if pair.name == "bedroom-1" else {})
        ),
    )
    metrics, notes = independent.independent(quick=False)
    assert metrics["lift"] == {
        "infinigen_all_bias_pct": 2.0,
        "infinigen_filled_median_err_pct": 5.0,
        "infinigen_mask_iou": 0.4,
        "infinigen_not_emptied": 1,
        "infinigen_pairs": 2,
        "infinigen_unseen_all_bias_pct": 2.0,
        "infinigen_unseen_mask_iou": 0.4,
        "infinigen_unseen_not_emptied": 1,
        "infinigen_unseen_pairs": 1,
    }
    assert len(notes) == 4
    assert not any("bedroom-2" in note for note in notes)
    quick, _ = independent.independent(quick=True)
    found = {"infinigen_all_bias_pct": 1.0, "infinigen_filled_median_err_pct": 5.0, "infinigen_mask_iou": 0.4}
    assert quick["keep"] == found | {"infinigen_not_emptied": 0}


def test_without_rooms_they_are_named_as_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(independent, "DATA", tmp_path)
    monkeypatch.delenv("DAYLIT_INFINIGEN", raising=False)
    metrics, notes = independent.independent(quick=False)
    assert metrics == {}
    assert "left out" in notes[0]


def test_passes_are_read_by_their_names(tmp_path: Path) -> None:
    far, index = np.full((4, 8), 2.5, np.float32), np.zeros((4, 8), np.float32)
    index[2, 3] = infinigen_rooms.FIRST_THING
    channels = {"ViewLayer.Depth.Z": far, "ViewLayer.IndexOB.X": index, "ViewLayer.Combined.R": far}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(tmp_path / "passes.exr"))
    distance_m, read = independent.read_passes(tmp_path / "passes.exr")
    assert (distance_m == 2.5).all()
    assert np.argwhere(read >= infinigen_rooms.FIRST_THING).tolist() == [[2, 3]]


def test_distances_count_by_solid_angle_where_both_are_known() -> None:
    true_m = np.full((8, 16), 2.0)
    ours_m = np.full((4, 8), 2.2)
    ours_m[:, :2] = 0
    assert independent._off("depth", ours_m, true_m, np.ones((8, 16), bool)) == {"depth_err_pct": 10.0}
    assert independent._off("depth", ours_m, true_m, np.zeros((8, 16), bool)) == {}


def test_a_place_is_inside_a_floor_or_not() -> None:
    corner = [(0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)]
    assert infinigen_rooms._within(0.5, 2.5, corner)
    assert not infinigen_rooms._within(2.0, 2.0, corner)


def test_the_script_runs_without_blender_as_far_as_its_help() -> None:
    asked = [sys.executable, "-I", infinigen_rooms.__file__, "--help"]
    said = subprocess.run(asked, capture_output=True, text=True, check=True)
    assert "--rooms" in said.stdout
    assert "bpy==4.2.0" in said.stdout


@pytest.mark.shared("infinigen")
def test_emptying_takes_the_rooms_beside_the_checkout() -> None:
    assert emptying.independent is independent.independent
    assert [pair.name for pair in independent.pairs_of(DATA / "infinigen")]
