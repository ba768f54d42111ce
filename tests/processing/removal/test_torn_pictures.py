"""Pictures that lose a part to what is removed before them are whole again; what is none stays a wall."""

import numpy as np
import pytest

from processing.removal.plane_fill import fill_plane
from processing.removal.upright_parts import torn_pictures
from processing.surfaces.maps import FIRST_WALL, planes_of
from processing.surfaces.textures import Texture, texture_shape
from tests.processing.removal.painted_room import box_room

PX_PER_M = 50.0
WALL, FRAME, CANVAS = (0.5, 0.3, 0.15), (0.2, 0.15, 0.1), (0.7, 0.7, 0.6)
TOP, LOW, LEFT, RIGHT = 35, 80, 60, 120
"""Of a picture of 1.2 x 0.9 m."""


def hung(canvas=CANVAS):
    """Return the plane, its texture with a framed picture, and where the network sees it."""
    room = box_room(window=False)
    plane = planes_of(room)[FIRST_WALL]
    height, width = texture_shape(plane, PX_PER_M)
    values = np.full((height, width, 3), WALL, np.float32)
    values *= np.linspace(1.1, 0.9, width, dtype=np.float32)[None, :, None]
    values[TOP:LOW, LEFT:RIGHT] = FRAME
    values[TOP + 3 : LOW - 3, LEFT + 3 : RIGHT - 3] = canvas
    things = np.zeros((height, width), bool)
    things[TOP + 4 : LOW - 4, LEFT + 5 : RIGHT - 5] = True
    return room, plane, values, things


def with_lamp(shape):
    """Return a hole: a chest below the picture, and a lamp on it before its lower right corner."""
    hole = np.zeros(shape, bool)
    hole[85:, 30:170] = True
    hole[65:, RIGHT - 15 : RIGHT + 10] = True
    return hole


def regions_of(values, things, hole):
    """Return the rectangles of torn pictures."""
    seen = np.where(hole[..., None], 0, values).astype(np.float32)
    return [region for region, _ in torn_pictures(seen, ~hole, things, hole, PX_PER_M)]


def test_a_corner_behind_a_lamp_is_drawn():
    room, plane, values, things = hung()
    hole = with_lamp(things.shape)
    (region,) = regions_of(values, things, hole)
    rows, columns = np.nonzero(region)
    found = [rows.min(), rows.max() + 1, columns.min(), columns.max() + 1]
    np.testing.assert_allclose(found, [TOP, LOW, LEFT, RIGHT], atol=1)
    seen = np.where(hole[..., None], 0, values).astype(np.float32)
    texture = Texture(plane, PX_PER_M, seen, ~hole, np.ones(hole.shape, np.float32))
    done = fill_plane(texture, hole, (np.zeros_like(hole), things & ~hole), room, np.float32(WALL))
    off = np.abs(np.log(done.values / values))[hole & region]
    assert np.median(off) < 0.1
    assert np.quantile(off.max(axis=-1), 0.85) < 0.35
    below = np.abs(np.log(done.values / values))[90:, 40:160]
    assert np.quantile(below, 0.95) < 0.1, "the wall below is the wall's"
    assert not done.continued[hole & region].any()


def test_one_that_is_cut_all_along_ends_there_in_a_frame_like_the_upper_one():
    """Furniture below hides its lower edge from one side to the other: nobody knows how far down it went."""
    room, plane, values, things = hung()
    values, things = (np.roll(one, 4, axis=0) for one in (values, things))  # its upper edge 1.92 m above the floor
    row, column = np.indices(things.shape)
    hole = with_lamp(things.shape) | (row >= LOW - 4 + column % 3)
    seen = np.where(hole[..., None], 0, values).astype(np.float32)
    texture = Texture(plane, PX_PER_M, seen, ~hole, np.ones(hole.shape, np.float32))
    done = fill_plane(texture, hole, (np.zeros_like(hole), things & ~hole), room, np.float32(WALL))
    off = np.abs(np.log(done.values / values))
    assert np.quantile(off[LOW + 9 :], 0.95) < 0.1, "below it is wall, not the picture's colours down to the floor"
    frame = np.abs(np.log(done.values[LOW - 3 : LOW + 1, LEFT : RIGHT - 16] / FRAME)).mean(axis=(1, 2))
    assert frame.min() < 0.15, "closed by a frame"
    assert regions_of(values, things & ~hole, hole)
    higher = [np.roll(one, -4, axis=0) for one in (values, things)]  # as high as a door
    assert not regions_of(higher[0], higher[1] & ~hole, hole)


@pytest.mark.parametrize("why", ["whole", "mostly hidden", "a curtain", "two things"])
def test_what_is_none_is_left_alone(why):
    _, _, values, things = hung()
    hole = with_lamp(things.shape)
    if why == "whole":
        hole[:85] = False
    elif why == "mostly hidden":
        hole[TOP - 5 :, LEFT + 20 : RIGHT + 10] = True
    elif why == "a curtain":
        values[2:, LEFT:RIGHT], things[2:, LEFT:RIGHT] = CANVAS, True
    else:
        values[TOP : TOP + 30, LEFT + 10 : RIGHT] = WALL
        things[TOP : TOP + 30, LEFT + 10 : RIGHT] = False
    assert not regions_of(values, things & ~hole, hole)


def test_nothing_known_or_no_things():
    _, _, values, things = hung()
    everything = np.ones_like(things)
    assert not regions_of(values, things, everything)
    assert not regions_of(values, np.zeros_like(things), with_lamp(things.shape))
    assert not regions_of(np.zeros_like(values), things, with_lamp(things.shape))
