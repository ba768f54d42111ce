"""The measures of removal: what is sharp counts as sharp, and a perfect filling is not better than it can be."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.removal.composites import near_shadow
from benchmarks.removal.edges import edge_sharpness, joined_truth, smooth_error

SHAPE = (40, 60)


def room() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return light, planes and target: a wall over a floor, and a hole over their edge."""
    planes = np.zeros(SHAPE, np.int16)
    planes[:20] = 2
    light = np.where(planes[..., None] == 2, 50.0, 10.0).astype(np.float32) * np.ones(3, np.float32)
    target = np.zeros(SHAPE, bool)
    target[10:30, 20:40] = True
    return light, planes, target


def test_a_blurred_edge_is_less_sharp_than_the_true_one() -> None:
    light, planes, target = room()
    sharp = edge_sharpness(light, light, planes, target)
    assert sharp == pytest.approx((1.0, 1.0))
    for turn in (lambda p: p, lambda p: np.ascontiguousarray(np.swapaxes(p, 0, 1))):
        blurred = turn(cv2.GaussianBlur(light, (0, 0), 2.0))
        soft = edge_sharpness(blurred, turn(light), turn(planes), turn(target))
        assert soft is not None
        assert soft[0] < 0.5 * soft[1]
    flat = np.full_like(light, 20.0)
    assert edge_sharpness(flat, flat, planes, target) is None, "no edge is seen"
    assert edge_sharpness(light, light, planes, np.zeros_like(target)) is None


def test_a_perfect_filling_joins_what_is_seen() -> None:
    """Furniture takes a fifth of the light on the wall and half on the floor: so does a filling that shows no seam."""
    light, planes, target = room()
    furnished = light * np.where(planes == 2, 0.8, 0.5)[..., None].astype(np.float32)
    furnished[target] = 1.0
    found = joined_truth(furnished, light, planes, target)
    np.testing.assert_array_equal(found[~target], furnished[~target])
    np.testing.assert_allclose(found[target & (planes == 2)], 40.0, rtol=1e-3)
    np.testing.assert_allclose(found[target & (planes == 0)], 5.0, rtol=1e-3)


def test_smooth_errors_know_no_grain() -> None:
    light, _, target = room()
    grain = np.random.default_rng(0).uniform(0.5, 1.5, (*SHAPE, 1)).astype(np.float32)
    assert smooth_error(light, light, target) == 0
    assert smooth_error(light * grain, light, target) < 8
    assert smooth_error(light * np.float32(1.2), light, target) == pytest.approx(20, rel=1e-3)


def test_the_target_holds_the_dark_beside_things() -> None:
    things = np.zeros(SHAPE, bool)
    things[20:24, 20:30] = True
    ratio = np.ones(SHAPE, np.float32)
    ratio[22:30, 18:34] = 0.4
    target = near_shadow(things, ratio)
    assert target[18:26, 18:32].all(), "two pixels more"
    assert target[27, 22], "its shadow"
    assert not target[5:10].any()
