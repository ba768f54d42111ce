from __future__ import annotations

import numpy as np
import pytest

from processing.errors import ParameterError, RoomError
from processing.sphere import Equirectangular
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR, plane_map, planes_of, surface_maps
from processing.surfaces.textures import outline_mask, texel_places, unwrap, wrap
from tests.processing.surfaces.rooms import BOX, ELL, model, pattern, points

GEOMETRY = Equirectangular(512, 256)


@pytest.mark.parametrize("floor", [BOX, ELL], ids=["box", "L"])
@pytest.mark.parametrize("yaw", [0.0, -1.0])
def test_a_pattern_of_positions_comes_out_in_its_place_and_goes_back(floor, yaw: float) -> None:
    geometry, room = Equirectangular(512, 256, yaw), model(floor)
    picture = pattern(points(room, geometry))
    everywhere = np.ones(picture.shape[:2], bool)
    back, covered = np.zeros_like(picture), np.zeros(picture.shape[:2], int)
    for plane in planes_of(room):
        texture = unwrap(picture, geometry, room, plane, 25.0)
        true = pattern(texel_places(plane, 25.0))
        assert texture.known.any()
        # Only beside edges do pixels mix planes.
        assert np.quantile(np.abs(texture.values - true)[texture.known], 0.97) < 0.02
        assert np.median(np.abs(texture.values - true)[texture.known]) < 2e-3
        assert (texture.values[~texture.known] == 0).all()
        values, seen = wrap(true, texture, room, geometry, everywhere)
        back[seen] = values
        covered += seen
    assert (covered == 1).all()
    assert np.quantile(np.abs(back - picture), 0.995) < 0.02
    assert np.median(np.abs(back - picture)) < 1e-3


def test_textures_are_not_mirrored() -> None:
    room = model(BOX)
    places = points(room, GEOMETRY)
    right = places[..., 0].astype(np.float32)
    ahead, up = places[..., 1].astype(np.float32), places[..., 2].astype(np.float32)
    floor, ceiling, *_, wall_ahead, wall_left = planes_of(room)

    def slopes(picture: np.ndarray, plane) -> tuple[float, float]:
        """How the picture grows to the right and down the texture, a metre."""
        texture = unwrap(picture, GEOMETRY, room, plane, 20.0)
        rows, columns = np.nonzero(texture.known)
        ones = np.ones(len(rows))
        fit, *_ = np.linalg.lstsq(
            np.stack([columns, rows, ones], axis=-1) / 20.0, texture.values[rows, columns], rcond=None
        )
        return float(fit[0]), float(fit[1])

    assert slopes(right, floor) == pytest.approx((1, 0), abs=0.02)
    assert slopes(ahead, floor) == pytest.approx((0, -1), abs=0.02)
    assert slopes(right, ceiling) == pytest.approx((1, 0), abs=0.02)
    assert slopes(ahead, ceiling) == pytest.approx((0, 1), abs=0.02)
    assert slopes(right, wall_ahead) == pytest.approx((1, 0), abs=0.02)
    assert slopes(up, wall_ahead) == pytest.approx((0, -1), abs=0.02)
    # To the left, what is ahead is on the right.
    assert slopes(ahead, wall_left) == pytest.approx((1, 0), abs=0.02)


def test_the_wall_across_the_seam_has_none() -> None:
    room = model(BOX)
    behind = planes_of(room)[FIRST_WALL]
    texture = unwrap(points(room, GEOMETRY)[..., 0].astype(np.float32), GEOMETRY, room, behind, 30.0)
    assert texture.known.all()
    # x shrinks to the right, evenly.
    steps = np.diff(texture.values[5:-5, 5:-5], axis=1)
    np.testing.assert_allclose(steps, -1 / 30, atol=4e-3)


def test_what_is_hidden_stays_unknown() -> None:
    room = model(ELL)
    planes = planes_of(room)
    picture = pattern(points(room, GEOMETRY))
    floor = unwrap(picture, GEOMETRY, room, planes[FLOOR], 20.0)
    assert (floor.known <= outline_mask(planes[FLOOR], 20.0)).all()
    places = texel_places(planes[FLOOR], 20.0)
    # Behind the inner corner (1, 1): the arm ahead is seen only left of the line from the camera through it.
    hidden = (places[..., 0] > places[..., 1]) & (places[..., 1] > 1)
    assert not floor.known[hidden].any()
    assert np.array_equal(floor.known, floor.density > 0)
    # Wall 3, from (1, 1) to (1, 5), shows its inner side; wall 2, from (4, 1) to (1, 1), too.
    assert unwrap(picture, GEOMETRY, room, planes[FIRST_WALL + 3], 20.0).known.all()


def test_a_wall_that_turns_its_back_is_unknown_throughout() -> None:
    # From the camera in its foot, a T's further shoulder shows nothing of the walls towards it.
    floor = ((-1.0, -2.0), (1.0, -2.0), (1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (-1.0, 3.0))
    room = model(floor)
    planes = planes_of(room)
    away = planes[FIRST_WALL + 2]
    found = unwrap(pattern(points(room, GEOMETRY)), GEOMETRY, room, away, 10.0)
    assert not found.known.any()
    assert not found.density.any()
    values, mask = wrap(found.values, found, room, GEOMETRY, np.ones((256, 512), bool))
    assert values.shape == (0, 3)
    assert not mask.any()


def test_masked_pixels_give_nothing() -> None:
    room = model(BOX)
    picture = np.ones((256, 512), np.float32)
    mask = np.zeros((256, 512), bool)
    mask[200:, 100:200] = True
    picture[mask] = 1000.0
    floor = unwrap(picture, GEOMETRY, room, planes_of(room)[FLOOR], 15.0, mask=mask)
    assert floor.values.max() <= 1.0 + 1e-6
    assert 0.5 < floor.known.sum() / outline_mask(floor.plane, 15.0).sum() < 0.95


def test_marks_are_shares_of_a_texel_beside_its_light() -> None:
    room, rng = model(BOX), np.random.default_rng(1)
    picture = rng.random((256, 512, 2)).astype(np.float32)
    masks = rng.random((256, 512, 3)) < (0.5, 0.0, 0.1)
    bits = (masks * np.array([1, 2, 4])).sum(axis=-1).astype(np.uint8)
    for plane in planes_of(room)[:3]:
        found = unwrap(picture, GEOMETRY, room, plane, 25.0, marks=(bits, 3))
        light = unwrap(picture, GEOMETRY, room, plane, 25.0)
        shares = unwrap(masks.astype(np.float32), GEOMETRY, room, plane, 25.0)
        np.testing.assert_array_equal(found.values[..., :2], light.values)
        np.testing.assert_allclose(found.values[..., 2:], shares.values, atol=1e-6)


def test_coarse_texels_are_means_and_density_counts_their_pixels() -> None:
    room = model(BOX)
    rng = np.random.default_rng(3)
    picture = rng.uniform(0, 2, (256, 512)).astype(np.float32)
    ceiling = unwrap(picture, GEOMETRY, room, planes_of(room)[CEILING], 2.0)
    assert ceiling.values[ceiling.known].std() < 0.35
    finer = unwrap(picture, GEOMETRY, room, ceiling.plane, 20.0)
    seen = plane_map(room, GEOMETRY) == CEILING
    assert finer.density.sum() == pytest.approx(seen.sum(), rel=0.03)


def test_pixels_of_fine_textures_are_means_and_use_no_texel_outside_the_outline() -> None:
    room = model(ELL)
    plane = planes_of(room)[FLOOR]
    inside = outline_mask(plane, 60.0)
    rng = np.random.default_rng(4)
    texture = np.where(inside, rng.uniform(0, 2, inside.shape), 1e6).astype(np.float32)
    layout = unwrap(np.ones((256, 512), np.float32), GEOMETRY, room, plane, 60.0)
    values, mask = wrap(texture, layout, room, GEOMETRY, np.ones((256, 512), bool))
    assert mask.sum() == (surface_maps(room, GEOMETRY).plane == FLOOR).sum()
    assert values.max() <= 2.0
    far = np.nonzero(mask)[0] < 170
    assert values[far].std() < 0.25


def test_beside_a_corner_that_hides_some_of_a_plane_pixels_take_only_texels_that_are_seen() -> None:
    room, everywhere = model(ELL), np.ones((256, 512), bool)
    for plane in planes_of(room):
        texture = unwrap(np.full((256, 512), 3, np.float32), GEOMETRY, room, plane, 30.0)
        assert (texture.values[~texture.known] == 0).all()
        values, _ = wrap(texture.values, texture, room, GEOMETRY, everywhere)
        np.testing.assert_allclose(values, 3.0, rtol=1e-5, err_msg=plane.name)


def test_only_the_pixels_asked_for_are_given() -> None:
    room = model(BOX)
    plane = planes_of(room)[FLOOR]
    where = np.zeros((256, 512), bool)
    where[250:253, 7:11] = True
    where[10, 10] = True
    texture = unwrap(np.ones((256, 512), np.float32), GEOMETRY, room, plane, 10.0)
    values, mask = wrap(texture.values, texture, room, GEOMETRY, where)
    assert mask.sum() == 12
    np.testing.assert_allclose(values, np.ones(12), rtol=1e-6)


def test_close_to_a_wall_and_tiny_pictures() -> None:
    floor = ((-0.06, -2.0), (3.0, -2.0), (3.0, 2.0), (-0.06, 2.0))
    room, geometry = model(floor), Equirectangular(4, 2)
    covered, known = np.zeros((2, 4), int), 0
    for plane in planes_of(room):
        texture = unwrap(np.ones((2, 4), np.float32), geometry, room, plane, 3.0)
        np.testing.assert_allclose(texture.values[texture.known], 1.0, rtol=1e-6)
        values, seen = wrap(texture.values, texture, room, geometry, np.ones((2, 4), bool))
        assert np.isfinite(values).all()
        covered, known = covered + seen, known + int(texture.known.sum())
    assert (covered == 1).all()
    assert known > 100


def test_what_cannot_be_is_refused() -> None:
    room = model(BOX)
    plane = planes_of(room)[FLOOR]
    good = np.ones((256, 512), np.float32)
    with pytest.raises(ParameterError):
        unwrap(good[:100], GEOMETRY, room, plane, 10.0)
    with pytest.raises(ParameterError):
        unwrap(np.full_like(good, np.nan), GEOMETRY, room, plane, 10.0)
    for bad in (0.0, -1.0, float("nan"), float("inf"), 1e6):
        with pytest.raises(ParameterError):
            unwrap(good, GEOMETRY, room, plane, bad)
    with pytest.raises(ParameterError):
        unwrap(good, GEOMETRY, room, plane, 10.0, mask=np.zeros((3, 3), bool))
    with pytest.raises(ParameterError):
        wrap(np.ones((3, 3), np.float32), unwrap(good, GEOMETRY, room, plane, 10.0), room, GEOMETRY, good > 0)
    with pytest.raises(RoomError):
        unwrap(good, GEOMETRY, model(BOX[::-1]), plane, 10.0)
