"""Rooms full of furniture: what is seen of the floor is found, and shows none of the shade between the pieces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from processing.ground.arrays import Flags, Floats
from processing.ground.seam import grown
from processing.pictures.images import LuminanceImage
from processing.removal.fill import Emptied, FilledPlane, Others, empty_room
from processing.removal.furniture import FurnitureFound, with_seen_floor
from processing.removal.lift import evened
from processing.removal.masks import _with_things
from processing.removal.plane_fill import fill_plane
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import FIRST_WALL, planes_of
from processing.surfaces.textures import Texture
from tests.processing.removal.test_whole_things import GEOMETRY, MAPS, NONE, ROOM, ROWS, box, grey_room, shown

FLOOR_HERE, RUG = box(190, 256, 0, 512), box(190, 220, 60, 200)


def shares(**classes: Floats) -> Floats:
    """Return probabilities (8, ROWS, 2 ROWS); the rest is a wall."""
    found = np.zeros((len(SceneClass), ROWS, 2 * ROWS), np.float32)
    for name, share in classes.items():
        found[SceneClass[name]] = share
    found[SceneClass.WALL] = 1 - found.sum(axis=0)
    return found


@pytest.mark.parametrize("best", [0.4, 0.8])
def test_a_floor_that_is_hardly_seen_is_likelier_where_it_is_bare(best: float) -> None:
    """A floor of which nothing is sure is found by its colour; one that is seen elsewhere is left as it is."""
    light = grey_room()
    light[RUG] = (0.5, 0.05, 0.05)
    floor = np.where(RUG, 0.1, best) * FLOOR_HERE
    given = shares(FLOOR=floor, FURNITURE=(0.95 - floor) * FLOOR_HERE)
    found = with_seen_floor(given, np.full(64, -math.radians(43)), shown(light))
    assert np.allclose(found.sum(axis=0), 1, atol=1e-5)
    if best > 0.5:
        assert np.array_equal(found, given)
    else:
        assert found[SceneClass.FLOOR][FLOOR_HERE & ~RUG].min() > 0.7
        assert found[SceneClass.FLOOR][RUG].mean() < 0.2
        assert np.array_equal(found[:, ~FLOOR_HERE], given[:, ~FLOOR_HERE])


def emptied(light: Floats, target: Flags) -> Emptied:
    shape = target.shape
    image = LuminanceImage(light, np.full(shape, 0.02, np.float32), np.zeros(shape, np.uint8), GEOMETRY, 0.02)
    return empty_room(image, target, ROOM)


def test_shade_between_pieces_of_furniture_is_no_stain_on_the_emptied_floor() -> None:
    """It is evened out in one colour with its surroundings; what is far, another thing or sunlight stays."""
    hole, shade, far = box(185, 215, 200, 300), box(190, 205, 225, 275), box(190, 205, 20, 50)
    light = grey_room()
    light[shade] *= (0.75, 0.7, 0.65)
    light[far] *= 0.7
    done = emptied(light, hole & ~shade)
    gain = evened(done, hole & ~shade, ROOM, Others(), None)
    beside = hole & ~shade & box(187, 213, 210, 290)
    before, after = (np.log(done.image.rgb * np.exp(one)) for one in (0 * gain, gain))
    step, left = (np.abs(one[shade].mean(axis=0) - one[beside].mean(axis=0)) for one in (before, after))
    assert (left < 0.5 * step).all()
    assert np.abs(gain[far]).max() < 0.01
    assert not gain[MAPS.plane >= FIRST_WALL][:, 0].max() > 0.12
    assert not evened(done, hole & ~shade, ROOM, Others(), shade)[shade].any(), "sunlight that is kept"
    assert not evened(done, hole & ~shade, ROOM, Others(foreign=shade), None)[shade].any(), "what stands there"


def test_shade_and_colour_that_things_left_on_a_wall_run_out_beside_its_filling() -> None:
    """On one paint: a picture, a panel of another colour, what is far, and openings stay."""
    wall = (MAPS.plane >= FIRST_WALL) & (MAPS.opening < 0)
    hole, shade = box(140, 185, 230, 280) & wall, box(128, 140, 225, 285) & wall
    far, panel = box(128, 140, 20, 40) & wall, box(100, 160, 288, 300) & wall
    light = grey_room()
    light[shade] *= (0.85, 0.8, 0.7)
    light[far] *= 0.8
    light[panel] *= (1, 0.3, 0.3)
    done = emptied(light, hole)
    gain = evened(done, hole, ROOM, Others(), None)
    before, after = (np.log(done.image.rgb * np.exp(one)) for one in (0 * gain, gain))
    inner, clean = box(131, 137, 235, 275) & wall, box(100, 115, 235, 275) & wall
    step, left = (np.abs(one[inner].mean(axis=0) - one[clean].mean(axis=0)) for one in (before, after))
    assert left.mean() < 0.65 * step.mean(), "a tenth of tone may be the wall's own light"
    assert np.ptp(left) < 0.4 * np.ptp(step), "colour"
    assert np.abs(gain[far]).max() < 0.02
    assert np.ptp(gain[panel], axis=-1).max() < 0.2, "lit as the wall beside it, and as red as it was (1.2)"


def test_a_lit_shade_goes_with_its_pole_and_a_dark_plate_over_a_plant_stays() -> None:
    chair, pole, shade = box(150, 180, 240, 280), box(128, 150, 258, 260), box(115, 126, 252, 266)
    light = grey_room()
    light[chair], light[pole], light[shade] = 0.1, 0.2, 0.95
    found = FurnitureFound(chair | pole, (chair | pole).astype(np.float32), np.zeros_like(chair | pole), 0, 0.0)
    things = shade.astype(np.float32), shade.astype(np.float32)
    assert _with_things(found, shown(light), MAPS, NONE, things, NONE)[0].mask[shade].all()
    light[shade] = 0.3
    assert not _with_things(found, shown(light), MAPS, NONE, things, NONE)[0].mask[shade].any()


def test_a_shade_of_which_a_part_is_found_before_a_picture_goes_whole() -> None:
    chest, shade, picture = box(150, 180, 240, 280), box(132, 150, 254, 263), box(110, 140, 220, 263)
    light = grey_room()
    light[chest], light[picture], light[shade] = 0.1, (0.1, 0.4, 0.3), 0.7
    taken = chest | (shade & ~box(132, 136, 254, 258))
    found = FurnitureFound(taken, taken.astype(np.float32), np.zeros_like(taken), 0, 0.0)
    hung, likely = (picture & ~shade).astype(np.float32), np.where(shade | picture, np.float32(0.6), 0)
    whole = _with_things(found, shown(light), MAPS, NONE, (hung, likely), NONE)[0].mask
    assert whole[shade].mean() > 0.95, "but for pixels of mixed colour"
    assert not (whole & picture & ~grown(shade, math.radians(1))).any()
    unlikely = np.where(shade, np.float32(0.3), likely)
    rest = _with_things(found, shown(light), MAPS, NONE, (hung, unlikely), NONE)[0].mask & shade & ~taken
    assert not rest.any(), "it may be the wall's"


def test_a_wall_of_which_only_a_dark_border_is_seen_has_the_other_walls_paint() -> None:
    plane = planes_of(ROOM)[FIRST_WALL]
    border = np.arange(100)[:, None] * np.ones((1, 160), int) < 4
    values = np.where(border[..., None], np.float32(0.05), np.zeros(3, np.float32))
    texture = Texture(plane, 40.0, values, border, np.ones(border.shape, np.float32))
    filled: list[FilledPlane] = [
        fill_plane(one, ~one.known, (np.zeros_like(border), np.zeros_like(border)), ROOM, np.full(3, 0.6, np.float32))
        for one in (texture, replace(texture, values=values * 8))
    ]
    assert np.allclose(filled[0].values[50:], 0.6), "the border's own colour is no wall's"
    assert np.allclose(filled[1].values[50:], 0.4, atol=0.02), "a paint that is much as the others' is its own"
