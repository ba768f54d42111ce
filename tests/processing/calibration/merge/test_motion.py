"""Regions that moved, on masks made by hand; and which frame shows them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR, expose
from processing.calibration.merge.motion import Planes, check_view, ghost_regions, settle_ghosts
from processing.calibration.merge.tables import merge_tables
from processing.errors import BracketError
from processing.pictures.frames import array_frame
from tests.processing.calibration.merge.merge_cases import NOISE, true_curve

TABLES = merge_tables(true_curve(), NOISE, np.array([4.0, 1.0, 0.25]), np.zeros(3), 0.02)


def planes(suspect: np.ndarray) -> Planes:
    shape = suspect.shape
    return Planes(
        np.ones((*shape, 3), np.float32), np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), suspect
    )


def test_scattered_odd_pixels_are_noise_and_sure_ones_are_not() -> None:
    suspect = np.zeros((40, 60), np.uint8)
    suspect[5::10, 5::10] = 1
    assert not ghost_regions(suspect).any()
    suspect[20, 33] = 2
    assert ghost_regions(suspect)[20, 33]
    assert ghost_regions(suspect).sum() == 1


def test_a_spot_as_small_as_a_hot_pixel_is_no_region_where_a_larger_one_is_asked_for() -> None:
    suspect = np.zeros((40, 60), np.uint8)
    suspect[3:6, 3:6] = 2
    suspect[20:27, 20:27] = 2
    region = ghost_regions(suspect, 5)
    assert region[20:27, 20:27].all()
    assert region.sum() == 49


def test_crowded_odd_pixels_are_a_region_without_holes() -> None:
    suspect = np.zeros((40, 60), np.uint8)
    suspect[10:20, 10:30] = np.random.default_rng(0).random((10, 20)) < 0.7
    region = ghost_regions(suspect)
    assert region[11:19, 11:29].mean() > 0.95
    assert region[25:].sum() == 0


def test_a_region_is_shown_by_the_frame_that_exposes_it_best_and_the_rest_stays() -> None:
    suspect = np.zeros((20, 30), np.uint8)
    suspect[4:10, 4:12] = 2
    frames = [np.full((20, 30, 3), code, np.uint8) for code in (255, 200, 90)]
    merged = planes(suspect)
    ghost = settle_ghosts(frames, TABLES, merged)
    assert set(np.unique(ghost)) == {0, 2}
    np.testing.assert_array_equal(ghost > 0, suspect > 0)
    np.testing.assert_allclose(merged.rgb[6, 6], 2.0 ** true_curve().log2_exposure[:, 200], rtol=1e-5)
    assert merged.uncertainty[6, 6] > 0
    assert merged.rgb[0, 0, 0] == 1


def test_pixels_that_the_reference_cannot_show_take_the_nearest_frame_that_can() -> None:
    suspect = np.zeros((20, 30), np.uint8)
    suspect[4:10, 4:12] = 2
    frames = [np.full((20, 30, 3), code, np.uint8) for code in (255, 200, 90)]
    frames[1][5, 5] = 255
    merged = planes(suspect)
    ghost = settle_ghosts(frames, TABLES, merged)
    assert ghost[5, 5] == 3
    for frame in frames:
        frame[6, 6] = 255
    merged = planes(suspect)
    merged.rgb[6, 6], merged.validity[6, 6], merged.uncertainty[6, 6] = 123.0, 1, np.inf
    ghost = settle_ghosts(frames, TABLES, merged)
    assert ghost[6, 6] == 0, "no frame shows it"
    assert merged.validity[6, 6] == 1
    assert (merged.rgb[6, 6] == 123.0).all(), "the merged bound stays"
    assert np.isinf(merged.uncertainty[6, 6])
    assert np.isfinite(merged.rgb).all()


def view(seed: int, moved_px: int = 0) -> list[np.ndarray]:
    """Return five exposures, two stops apart, of patches of light."""
    blocks = np.exp2(np.random.default_rng(seed).uniform(6, 11, (20, 40, 3))).astype(np.float32)
    scene = np.roll(cv2.resize(blocks, (640, 320), interpolation=cv2.INTER_NEAREST), moved_px, axis=1)
    return [expose(scene, 4.0 ** (-k - 1), REFERENCE_SENSOR, k) for k in range(5)]


def refused(frames: list[np.ndarray]) -> BracketError:
    with pytest.raises(BracketError) as caught:
        check_view([array_frame(frame, f"{k}.jpg") for k, frame in enumerate(frames)], frames)
    return caught.value


def test_the_frame_with_another_view_is_named() -> None:
    right, other, moved = view(3), view(4), view(3, moved_px=64)
    check_view([array_frame(frame, f"{k}.jpg") for k, frame in enumerate(right)], right)
    for foreign in (other, moved):
        error = refused([*right[:2], foreign[2], *right[3:]])
        assert (error.where, error.message) == ("2.jpg", "another view than the frames before and after it")
        assert "leave that frame out" in error.advice
    linear = [frame.astype(np.uint16) * 257 for frame in [*right[:2], other[2], *right[3:]]]
    assert refused(linear).where == "2.jpg"


def test_a_camera_that_was_moved_between_two_frames_is_named_by_both() -> None:
    error = refused([*view(3)[:3], *view(3, moved_px=64)[3:]])
    assert (error.where, error.message) == ("2.jpg and 3.jpg", "show different views")


def test_a_black_and_a_white_frame_are_of_any_view() -> None:
    right = view(3)
    right[0], right[-1] = np.full_like(right[0], 255), np.zeros_like(right[0])
    check_view([array_frame(frame, f"{k}.jpg") for k, frame in enumerate(right)], right)
