"""The meter's board and its stand from where the meter looked: found, and nothing where no board is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from processing.ground.seam import share_of_sphere
from processing.pictures.images import luminance_cd_m2
from processing.removal.masks import find_masks
from processing.removal.tripod import meter_board
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import FLOOR
from tests.conftest import LONG
from tests.processing.removal.painted_room import evidence_of, paint
from tests.processing.room.evidence import picture_of

HEIGHT = 256
PIXEL = math.pi / HEIGHT


def picture(longitude_deg: float, latitude_deg: float, *, stand: bool = True, edges: float = 1.3) -> tuple:
    """A plain wall over a wooden floor with noise; a board of 18 x 14 degrees, and a pole with two legs."""
    rng = np.random.default_rng(3)
    level = np.full((HEIGHT, 2 * HEIGHT), 100.0)
    level[int(0.62 * HEIGHT) :] = 40.0
    level[int(0.62 * HEIGHT) :: 9] *= 0.85
    board, pole = np.zeros(level.shape, bool), np.zeros(level.shape, bool)
    column, row = HEIGHT, round((0.5 - latitude_deg / 180) * HEIGHT)
    board[row - 10 : row + 10, column - 13 : column + 13] = True
    if stand:
        foot = row + 45
        pole[row + 10 : foot, column - 1 : column + 1] = True
        for k in range(12):
            pole[foot - 6 + k // 2, [column - k - 1, column + k]] = True
    level[board] = 100.0 * edges
    level[pole] = 12.0
    level *= 1 + 0.004 * rng.standard_normal(level.shape)
    shift = round(longitude_deg / 360 * 2 * HEIGHT)
    turned = [np.roll(values, shift, axis=1) for values in (level.astype(np.float32), board, pole)]
    target = math.remainder((shift + 0.5) * PIXEL, 2 * math.pi), (0.5 - (row + 0.5) / HEIGHT) * math.pi
    return (*turned, target)


@pytest.mark.parametrize("longitude_deg", [0.0, -97.0, 180.0])
@pytest.mark.parametrize("edges", [1.3, 0.8])
def test_board_and_stand_are_found_also_across_the_seam(longitude_deg: float, edges: float) -> None:
    level, board, pole, target = picture(longitude_deg, -12.0, edges=edges)
    mask, stand = meter_board(level, target)
    assert stand
    assert (mask & board).sum() == board.sum()
    assert (mask & pole).sum() > 0.9 * pole.sum()
    assert mask.sum() < 1.9 * (board | pole).sum()


def test_a_board_before_something_as_bright_is_detected_by_its_colour() -> None:
    level, board, pole, target = picture(0.0, -12.0)
    rows, columns = np.nonzero(board)
    orange = np.zeros_like(board)
    orange[rows.min() - 12 : rows.max() + 8, columns.min() - 14 : columns.max() + 14] = True
    orange &= ~board & ~pole
    level[orange] = 130.0
    blind, _ = meter_board(level, target)
    assert not blind.any() or (blind & orange).any(), "grey alone cannot part them"
    tint = np.where(orange, np.float32(-3.0), np.float32(0.0))
    mask, stand = meter_board(level, target, tint)
    assert stand
    assert mask[board].all()
    assert (mask & orange).sum() < 0.3 * orange.sum()


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_light_across_the_board_and_noise_do_not_hide_it(noise: float) -> None:
    """Half as bright at one side as at the other, where it is as bright as the wall behind it."""
    level, board, pole, target = picture(30.0, -12.0, edges=1.6)
    columns = np.nonzero(board)[1]
    across = np.clip((np.arange(level.shape[1]) - columns.min()) / np.ptp(columns), 0, 1)
    level = np.where(board, level * 2 ** (across - 1), level)
    level *= np.exp(np.random.default_rng(5).normal(0, noise, level.shape))
    mask, _ = meter_board(level.astype(np.float32), target)
    assert mask.sum() < 2.1 * (board | pole).sum()
    assert (mask & board).sum() > 0.97 * board.sum()


@pytest.mark.parametrize("lean", [-0.25, 0.25])
def test_a_turned_board_is_found(lean: float) -> None:
    """Its upper and lower edges run up and down, and it looks narrower."""
    level, board, _, target = picture(0.0, -12.0)
    rows, columns = np.nonzero(board)
    ours = np.zeros_like(board)
    for column in range(columns.min(), columns.max() + 1):
        shift = round(lean * (column - columns.mean()))
        ours[rows.min() + shift : rows.max() + 1 + shift, column] = True
    level = np.where(ours, 130.0, np.where(board, 100.0, level)).astype(np.float32)
    mask, _ = meter_board(level, target)
    assert (mask & ours).sum() > 0.85 * ours.sum()


def test_legs_are_followed_to_tips_that_are_fainter() -> None:
    level, board, pole, target = picture(0.0, -12.0)
    columns = np.arange(level.shape[1])
    tips = pole & (np.abs(columns - HEIGHT + 0.5) > 7)
    level[tips] = 40.0 * 2**-0.3
    mask, _ = meter_board(level, target)
    assert (mask & tips).sum() > 0.9 * tips.sum()
    assert mask.sum() < 1.9 * (board | pole).sum()


def test_the_texture_of_a_carpet_is_no_stand() -> None:
    """What hangs together with the stand's foot, thin and dark, but no more than the carpet beside it."""
    level, board, pole, target = picture(0.0, -12.0)
    carpet = np.zeros(level.shape, bool)
    carpet[int(0.62 * HEIGHT) :] = True
    noise = np.exp2(np.random.default_rng(8).normal(0, 0.2, level.shape)).astype(np.float32)
    mask, stand = meter_board(np.where(carpet & ~pole & ~board, level * noise, level), target)
    assert stand
    assert (mask & pole).sum() > 0.9 * pole.sum()
    assert mask.sum() < 1.9 * (board | pole).sum()


def test_a_sheet_on_the_wall_has_no_stand() -> None:
    level, board, _, target = picture(40.0, -5.0, stand=False)
    mask, stand = meter_board(level, target)
    assert not stand
    assert (mask & board).sum() == board.sum()
    assert share_of_sphere(mask) < 1.6 * share_of_sphere(board)


def test_nothing_where_no_board_is() -> None:
    level, board, _, target = picture(0.0, -10.0)
    away = target[0] + 1.5, 0.2
    assert not meter_board(level, away)[0].any(), "a bare wall"
    assert not meter_board(np.full_like(level, 7.0), target)[0].any(), "one even surface"
    assert not meter_board(np.zeros_like(level), target)[0].any(), "black"
    assert not meter_board(np.full_like(level, np.nan), target)[0].any(), "nothing known"
    for bad in ((math.nan, 0.0), (0.0, 1.4), (0.0, math.inf)):
        assert not meter_board(level, bad)[0].any()
    noisy = level * np.exp(np.random.default_rng(0).normal(0, 0.5, level.shape)).astype(np.float32)
    assert not meter_board(noisy, target)[0].any()
    assert board.any()


def test_holes_and_a_sun_beside_it_change_nothing_else() -> None:
    level, board, _, target = picture(0.0, -12.0)
    level[20:24, 40:44] = 1.6e9
    level[200:, 100:110] = np.nan
    mask, stand = meter_board(level, target)
    assert stand
    assert (mask & board).sum() == board.sum()
    assert not mask[:100, :60].any()


def test_masks_take_the_board_with_the_tripod_and_say_so() -> None:
    painted = paint()
    rgb = np.array(painted.image.rgb)
    height, width = rgb.shape[:2]
    row, column = round(0.55 * height), round(0.3 * width)
    half = round(0.05 * height)
    rgb[row - half : row + half, column - half : column + half] = 1.6 * float(np.median(rgb))
    image = replace(painted.image, rgb=rgb)
    target = ((column / width - 0.5) * 2 * math.pi, (0.5 - row / height) * math.pi)
    without = find_masks(image, painted.evidence, painted.room, sun_possible=False)
    found = find_masks(image, painted.evidence, painted.room, sun_possible=False, meter_target=target)
    assert luminance_cd_m2(rgb).max() > 0
    assert found.tripod[row, column]
    assert not without.tripod[row, column]
    assert found.target[row, column]
    assert any("meter's board" in note for note in found.notes)


@pytest.mark.sweep
@pytest.mark.parametrize("times", [1, 2, 4, 8] if LONG else [2])
def test_board_and_stand_are_one_object_whatever_the_pictures_size(times: int) -> None:
    """The same wall, board and stand in panoramas of 256 to 2048 rows, with noise of each size's own pixels."""
    level, board, pole, target = picture(40.0, -12.0)
    large = np.kron(level, np.ones((times, times), np.float32))
    large *= (1 + 0.004 * np.random.default_rng(4).standard_normal(large.shape)).astype(np.float32)
    image, empty = picture_of(large), paint(rows=HEIGHT, things=False, sun=False, window=False)
    nothing = evidence_of(np.where(empty.maps.plane == FLOOR, SceneClass.FLOOR, SceneClass.WALL))
    found = find_masks(image, nothing, empty.room, sun_possible=False, meter_target=target)
    mask = found.tripod.reshape(HEIGHT, times, 2 * HEIGHT, times).mean(axis=(1, 3)) > 0.5
    assert any("with its stand" in note for note in found.notes)
    assert (mask & board).sum() > 0.95 * board.sum()
    assert (mask & pole).sum() > 0.8 * pole.sum()
    assert mask[: int(0.9 * HEIGHT)].sum() < 2 * (board | pole).sum()
