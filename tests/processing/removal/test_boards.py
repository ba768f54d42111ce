"""Floors of boards: laid in whole boards from what is seen, in its direction, without glare, and even of little."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from processing.ground.arrays import Flags, Floats
from processing.removal.boards import lay_boards
from processing.removal.illumination import grey
from processing.removal.near_periodic import Repeat, analyse, complete
from processing.removal.near_periodic_lattice import find_joints

WIDTH, ALONG = 16, np.array([1.0, 0.0])


def boards(height: int = 320, width: int = 480, seed: int = 4) -> Floats:
    """Return a floor whose boards of `WIDTH` texels run along the rows, each with its joints, tones and grain."""
    rng = np.random.default_rng(seed)
    tone = np.zeros((height, width))
    for top in range(0, height, WIDTH):
        ends = [0, *np.sort(rng.integers(60, width - 60, 3)).tolist(), width]
        for start, end in pairwise(ends):
            grain = rng.normal(0, 0.02, (WIDTH, 1)) + rng.normal(0, 0.01, (WIDTH, end - start))
            tone[top : top + WIDTH, start:end] = rng.normal(0, 0.12) + grain
        tone[top] -= 0.25
    return np.asarray(0.4 * np.exp(tone)[..., None] * np.array([1.0, 0.8, 0.6]), np.float32)


def hole_of(shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    hole = np.zeros(shape[:2], bool)
    hole[90:250, 170:400] = True
    return hole


def roughness(values: Floats, part: Flags, axis: int) -> float:
    """Return the root mean square of changes from texel to texel along an axis."""
    step = np.diff(grey(np.log(np.maximum(values, 1e-6)).astype(np.float32)), axis=axis)
    return float(np.sqrt((step[part[: step.shape[0], : step.shape[1]]] ** 2).mean()))


def test_boards_go_on_whole_and_as_lively_as_they_are_seen() -> None:
    floor = boards()
    hole = hole_of(floor.shape)
    assert analyse(floor, ~hole).repeat is Repeat.LINE
    found = complete(floor, ~hole, hole)
    assert np.array_equal(found.values[~hole], floor[~hole])
    for axis in (0, 1):
        assert 0.7 < roughness(found.values, hole, axis) / roughness(floor, hole, axis) < 1.3
    # Each gap between boards that is seen runs on through the hole.
    tone = grey(np.log(found.values))[:, 190:380].mean(axis=1)
    gaps = np.arange(96, 250, WIDTH)
    darker = np.minimum(tone[gaps - 4], tone[gaps + 4]) - tone[gaps]
    assert darker.min() > 0
    assert darker.mean() > 0.12
    assert found.confidence[hole].min() > 0


def test_what_the_sun_or_a_lamp_draws_across_boards_is_not_laid_again() -> None:
    floor = boards()
    floor[:, 40:50] *= 3
    hole = hole_of(floor.shape)
    found = complete(floor, ~hole, hole)
    assert found.repeat is Repeat.LINE
    assert np.quantile(found.values[hole], 0.999) < 0.6 * np.quantile(floor[:, 40:50], 0.5) * 2


def test_of_a_piece_that_is_laid_again_and_again_marks_are_left_out() -> None:
    tone = np.log(boards()).astype(np.float32)
    tone -= tone.mean(axis=(0, 1))
    known = np.zeros(tone.shape[:2], bool)
    known[144:176, 60:150] = True
    tone[152:156, 100:104] -= 1.0
    hole = ~known
    found, sure, left = lay_boards(np.where(known[..., None], tone, 0), known, hole, ALONG)
    assert not left[20:-20].any()
    assert (sure[hole & ~left] > 0).all()
    assert np.median(found[152:156, 100:104]) < -0.7, "what is seen stays"
    assert found[hole & ~left].min() > -0.7


def test_where_no_board_is_seen_whole_the_floor_is_plain() -> None:
    floor = boards()
    hole = np.ones(floor.shape[:2], bool)
    hole[:, 200:206] = False
    flat = np.where(hole[..., None], 0, np.log(floor)).astype(np.float32)
    assert np.array_equal(lay_boards(flat, ~hole, hole, ALONG)[2], hole)
    assert np.isfinite(complete(floor, ~hole, hole).values).all()


def test_of_single_texels_and_of_next_to_nothing_no_boards_are_laid() -> None:
    tone = np.log(boards()[:60, :80]).astype(np.float32)
    y, x = np.mgrid[:60, :80]
    slanted = np.array([np.cos(0.4), np.sin(0.4)])
    for known in ((x + y) % 2 == 0, (x == 40) & (y == 30)):
        found, _, left = lay_boards(np.where(known[..., None], tone, 0), known, ~known, slanted)
        assert np.array_equal(left, ~known)
        assert np.isfinite(found).all()


def soft_floor(seed: int, joints: bool) -> tuple[Floats, Flags]:
    """Return a floor in blotchy light, seen in an L; boards, if any, run up, and across at its end: the next room."""
    rng = np.random.default_rng(seed)
    light, grain = (rng.normal(0, 1, (640, 640)).astype(np.float32) for _ in range(2))
    tone = 3.0 * cv2.GaussianBlur(light, (0, 0), 14) + 0.12 * cv2.GaussianBlur(grain, (0, 0), 1.2)
    for start in range(3, 640, 21) if joints else ():
        for board in (tone[160:, start : start + 21], tone[:160].T[:, start : start + 21]):
            board += rng.normal(0, 0.02)
            board[:, :2] -= 0.09
    known = np.zeros(tone.shape, bool)
    known[:420, :260] = known[260:420] = True
    return np.asarray(0.4 * np.exp(tone)[..., None] * np.array([1.0, 0.8, 0.6]), np.float32), known


@pytest.mark.parametrize("seed", [1, 2])
def test_faint_joints_in_blotchy_light_are_boards(seed: int) -> None:
    floor, known = soft_floor(seed, joints=True)
    found = analyse(floor, known)
    assert found.repeat is Repeat.LINE
    assert abs(found.line.direction[0]) < np.sin(np.radians(3))
    hole = ~known
    assert complete(floor, known, hole, found=found).repeat is Repeat.LINE


def test_without_joints_or_with_one_cable_or_with_joints_both_ways_there_are_no_boards() -> None:
    for seed in (1, 2):
        floor, known = soft_floor(seed, joints=False)
        tone = grey(np.log(floor))
        assert find_joints(tone, known) is None
        cabled = tone.copy()
        cabled[:, 100:104] -= 1.0
        assert find_joints(cabled, known) is None
        both = tone.copy()
        both[::64] -= 0.3
        both[:, ::64] -= 0.3
        assert find_joints(both, known) is None
    assert find_joints(tone, np.zeros_like(known)) is None
    assert find_joints(np.zeros((1, 1), np.float32), np.ones((1, 1), bool)) is None
