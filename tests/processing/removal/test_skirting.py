"""Skirting: estimated from the walls that show theirs, put where furniture hides it, and not invented."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from processing.ground.room_model import Opening, OpeningKind
from processing.pictures.images import RelativeImage
from processing.removal.fill import Others, empty_room
from processing.removal.skirting import _boards_seen, find_skirting
from processing.sphere import Equirectangular
from processing.surfaces.maps import FLOOR, plane_map
from tests.processing.removal.painted_room import Painted, box_room, paint

ROWS = 256
GEOMETRY = Equirectangular(2 * ROWS, ROWS)
HEIGHT_M = 0.15


@pytest.fixture(scope="module")
def bare() -> Painted:
    return paint(rows=ROWS, sun=False, things=False)


def with_skirting(bare: Painted) -> RelativeImage:
    """Return the room with boards of 15 cm, twice as bright as the walls."""
    rgb = bare.image.rgb.copy()
    rgb[(bare.maps.plane >= 2) & (bare.points_m[..., 2] < HEIGHT_M)] *= 2
    return replace(bare.image, rgb=rgb)


def test_it_is_estimated_from_the_walls_that_show_it(bare: Painted) -> None:
    lit, hidden = with_skirting(bare), bare.maps.plane == 3
    found = find_skirting(lit.rgb, GEOMETRY, box_room(), hidden)
    assert found is not None
    rows = found.rows(270, 100.0)
    assert rows[-10].mean() > 0.4, "twice as bright, 10 cm above the floor"
    assert abs(rows[:230]).max() < 0.05
    assert find_skirting(bare.image.rgb, GEOMETRY, box_room(), hidden) is None, "no dark foot where the floor mixes in"
    assert find_skirting(lit.rgb, GEOMETRY, box_room(), np.ones_like(hidden)) is None


def test_a_wall_with_shade_at_its_foot_does_not_outvote_a_seen_skirting(bare: Painted) -> None:
    lit, high = with_skirting(bare), bare.points_m[..., 2]
    others = bare.maps.plane > 3
    rgb = np.where(((bare.maps.plane > 3) & (high < HEIGHT_M))[..., None], bare.image.rgb, lit.rgb)
    shade = 1 - 0.2 * np.exp(-np.maximum(high, 0) / 0.1)
    rgb = np.where(others[..., None], rgb * shade[..., None], rgb).astype(np.float32)
    found = find_skirting(rgb, GEOMETRY, box_room(), np.zeros(others.shape, bool))
    assert found is not None
    assert found.rows(270, 100.0)[-10].mean() > 0.4


def test_a_wall_that_hides_its_own_gets_it(bare: Painted) -> None:
    """The foot of one wall is hidden from end to end."""
    lit, high = with_skirting(bare), bare.points_m[..., 2]
    target = (bare.maps.plane == 3) & (high < 0.7)
    spoilt = lit.rgb.copy()
    spoilt[target] = 0.01
    found = empty_room(replace(lit, rgb=spoilt), target, box_room(), quality="draft").image.rgb
    board, above = target & (high < 0.1), target & (high > 0.25)
    assert 1.5 < np.median(found[board]) / np.median(found[above]) < 2.5
    np.testing.assert_allclose(np.median(found[board]), np.median(lit.rgb[board]), rtol=0.25)


def test_white_boards_are_white_before_walls_of_any_paint(bare: Painted) -> None:
    lit, board = with_skirting(bare), (bare.maps.plane >= 2) & (bare.points_m[..., 2] < HEIGHT_M)
    red = np.array([1.0, 0.3, 0.1], np.float32)
    rgb = np.where(((bare.maps.plane > 3) & ~board)[..., None], bare.image.rgb * red, lit.rgb)
    found = find_skirting(rgb, GEOMETRY, box_room(), bare.maps.plane == 5)
    assert found is not None
    assert found.own is not None
    paint_of_red = np.log(np.median(bare.image.rgb[bare.maps.plane == 5], axis=0) * red)
    drawn = np.exp(found.rows(270, 100.0, paint_of_red)[-10] + paint_of_red)
    np.testing.assert_allclose(drawn, np.median(lit.rgb[board], axis=0), rtol=0.15)
    paint = np.log(np.median(bare.image.rgb[bare.maps.plane == 2], axis=0))
    bright, dark = (found.rows(270, 100.0, level)[-10] for level in (paint, paint - 1))
    assert bright.mean() > 0.5
    np.testing.assert_allclose(dark, bright, atol=0.05, err_msg="a wall of the same paint in the dark")


def test_what_is_seen_through_a_low_window_is_no_wall_to_compare_with(bare: Painted) -> None:
    """The wall under a bright window is no dark skirting."""
    rgb, high = bare.image.rgb.copy(), bare.points_m[..., 2]
    low = Opening(kind=OpeningKind.WINDOW, wall=0, start_m=0.1, end_m=3.9, sill_m=0.28, head_m=2.2)
    rgb[(bare.maps.plane == 2) & (high > 0.2)] = 40.0
    others = bare.maps.plane > 2
    assert find_skirting(rgb, GEOMETRY, box_room(window=False), others) is not None
    assert find_skirting(rgb, GEOMETRY, box_room().model_copy(update={"openings": (low,)}), others) is None


def test_boards_that_the_network_sees_are_found_where_walls_are_taken_for_too_far(bare: Painted) -> None:
    """Their lower half is then taken for floor."""
    lit, high = with_skirting(bare), bare.points_m[..., 2]
    seen = ((bare.maps.plane >= 2) & (high < HEIGHT_M)).astype(np.float32)
    room, nothing = box_room(), np.zeros(seen.shape, bool)
    wrong = room.model_copy(update={"camera_height_m": room.camera_height_m - 0.08})
    without = find_skirting(lit.rgb, GEOMETRY, wrong, nothing)
    found = find_skirting(lit.rgb, GEOMETRY, wrong, nothing, seen)
    assert found is not None
    assert found.rows(270, 100.0)[-8].mean() > 0.5
    assert without is None or without.rows(270, 100.0)[-8].mean() < 0.35
    assert abs(found.rows(270, 100.0)[:-22]).max() == 0
    below = bare.maps.plane == 0
    assert find_skirting(lit.rgb, GEOMETRY, wrong, seen.astype(bool) | below, seen) is not None, "all of it goes"
    assert find_skirting(bare.image.rgb, GEOMETRY, wrong, nothing, seen) is None, "there are none"


def uneven(share: npt.NDArray[np.bool_], least: float, most: float) -> npt.NDArray[np.float32]:
    """Return by how much (H, W, 3) light of boards (H, W) differs, column by column: ``least`` to ``most`` times."""
    columns = np.random.default_rng(3).uniform(np.log(least), np.log(most), share.shape[1])
    return np.where(share, np.exp(columns), 1.0).astype(np.float32)[..., None]


@pytest.mark.parametrize(("least", "most", "even"), [(2.0, 2.6, True), (1.0, 5.0, False)])
def test_boards_whose_tone_differs_from_place_to_place_are_none(
    bare: Painted, least: float, most: float, even: bool
) -> None:
    board = (bare.maps.plane >= 2) & (bare.points_m[..., 2] < HEIGHT_M)
    rgb, nothing = bare.image.rgb * uneven(board, least, most), np.zeros(board.shape, bool)
    assert (_boards_seen(rgb, bare.room, nothing, board.astype(np.float32)) is not None) == even


def test_boards_that_go_with_furniture_count_only_where_no_others_are_seen_and_then_the_surest(bare: Painted) -> None:
    """A dark thing before most of the boards; white ones are seen beside it, or are surer than it."""
    board = (bare.maps.plane >= 2) & (bare.points_m[..., 2] < HEIGHT_M)
    dark = board & (np.arange(board.shape[1]) % 128 < 96)
    rgb = np.where(dark[..., None], bare.image.rgb / 4, with_skirting(bare).rgb)
    white = np.log(2)
    for masked, sure in ((dark, 0.6), (board, 1.0)):
        share = np.where(dark, 1.6 - sure, np.where(board, sure, 0)).astype(np.float32)
        found = _boards_seen(rgb, bare.room, masked, share)
        assert found is not None
        np.testing.assert_allclose(found.tone.max(axis=0), white, atol=0.1)


def test_a_board_of_one_pixel_has_the_tone_of_where_it_is_most_unlike_its_wall(bare: Painted) -> None:
    """The network is surest of the row above, of which a fifth shows the board."""
    rows = np.arange(ROWS)[:, None]
    foot = np.where((bare.maps.plane >= 2) & (rows > ROWS // 2), rows, 0).argmax(axis=0)
    columns, rgb = np.arange(2 * ROWS), bare.image.rgb.copy()
    rgb[foot, columns] *= 2
    rgb[foot - 1, columns] *= 1.2
    share = np.zeros((ROWS, 2 * ROWS), np.float32)
    share[foot, columns], share[foot - 1, columns] = 0.4, 0.6
    found = _boards_seen(rgb, bare.room, np.zeros(share.shape, bool), share)
    assert found is not None
    assert found.tone.max() > 0.55, "log 2 is 0.69, log 1.2 is 0.18"


@pytest.mark.parametrize("others", ["uneven", "white"])
def test_boards_in_front_of_the_floor_count_where_no_others_are_seen(bare: Painted, others: str) -> None:
    """Walls are taken for too far, so that boards seem to stand on the floor: they are no surface, but all there is.

    Of a sixth of the boards that is not so: uneven things that the network takes for boards, or white ones, beside
    which dark ones before the floor do not count."""
    board = (bare.maps.plane >= 2) & (bare.points_m[..., 2] < HEIGHT_M)
    few = board & (np.arange(board.shape[1]) % 96 < 16)
    if others == "uneven":
        rgb = np.where(few[..., None], bare.image.rgb * uneven(few, 0.5, 3.0), with_skirting(bare).rgb)
    else:
        rgb = np.where((board & ~few)[..., None], bare.image.rgb / 4, with_skirting(bare).rgb)
    room = box_room().model_copy(update={"camera_height_m": box_room().camera_height_m - 0.14})
    shown = plane_map(room, GEOMETRY)
    assert (shown[board] == FLOOR).mean() > 0.9
    rows = np.arange(ROWS)[:, None]
    foot = np.where(shown == 3, rows, 0).max(axis=0)
    target = (shown == 3) & (rows > foot - 30)
    image = replace(bare.image, rgb=np.where(target[..., None], np.float32(0.01), rgb).astype(np.float32))
    seen = Others(boards=board.astype(np.float32), unlike=board & ~few & ~target)
    found = empty_room(image, target, room, others=seen, quality="draft").image.rgb
    lowest, above = target & (rows > foot - 4), target & (rows < foot - 15)
    assert 1.5 < np.median(found[lowest]) / np.median(found[above]) < 2.5


@pytest.mark.parametrize(("wide_deg", "enough"), [(1.2, False), (5.0, True)])
def test_how_much_of_a_board_is_enough_does_not_depend_on_the_pictures_size(wide_deg: float, enough: bool) -> None:
    for rows in (256, 512):
        painted = paint(rows=rows, things=False, sun=False, window=False)
        low = (painted.maps.plane >= 2) & (painted.points_m[..., 2] < HEIGHT_M)
        low &= np.abs(np.arange(2 * rows) + 0.5 - rows) < wide_deg / 360 * rows
        nothing = np.zeros(low.shape, bool)
        found = _boards_seen(with_skirting(painted).rgb, painted.room, nothing, low.astype(np.float32))
        assert (found is not None) == enough
