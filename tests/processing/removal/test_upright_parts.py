"""Walls of more than one colour: an upright edge above a hole divides what is filled; what hangs does not."""

import numpy as np
import pytest

from processing.ground.room_model import Opening, OpeningKind
from processing.removal.plane_fill import fill_plane
from processing.removal.upright_parts import Part, upright_parts
from processing.surfaces.maps import FIRST_WALL, planes_of
from processing.surfaces.textures import Texture, texture_shape
from tests.processing.removal.painted_room import box_room

PX_PER_M = 50.0
HEIGHT, WIDTH = 130, 200
GREY, RED = (0.5, 0.5, 0.5), (0.4, 0.08, 0.08)


@pytest.fixture
def wall():
    """A grey wall, 2.6 by 4 m, its lower 0.8 m hidden."""
    values = np.full((HEIGHT, WIDTH, 3), GREY, np.float32)
    hole = np.zeros((HEIGHT, WIDTH), bool)
    hole[90:] = True
    return values, hole


def parts_of(values, hole, things=None):
    """Return the parts of what is seen of a wall."""
    none = np.zeros_like(hole)
    return upright_parts(values, (~hole, none if things is None else things), hole, PX_PER_M)


def test_one_colour_is_one_part(wall):
    assert parts_of(*wall) == [Part(slice(0, WIDTH), 0)]


def test_post_and_door_divide(wall):
    values, hole = wall
    values[:, 60:70] = RED
    values[25:, 120:165] = RED  # a door's lintel is 2.1 m high
    found = parts_of(values, hole)
    borders = [part.columns.start for part in found[1:]]
    np.testing.assert_allclose(borders, [60, 70, 120, 165], atol=1)
    assert found[1].top <= 2
    assert 23 <= found[3].top <= 27  # above it is wall


def test_what_hangs_does_not_divide(wall):
    values, hole = wall
    values[30:75, 40:80] = RED  # a picture's lower edge is 0.3 m above the hole
    values[45:90, 120:160] = RED  # a board of 0.9 m stands on what is removed
    assert len(parts_of(values, hole)) == 1


def test_mirrors_do_not_divide_where_the_network_sees_them_and_curtains_do(wall):
    values, hole = wall
    values[30:, 40:80] = RED
    things = np.zeros_like(hole)
    things[30:, 40:80] = True
    assert len(parts_of(values, hole)) == 3
    assert len(parts_of(values, hole, things)) == 1
    values[5:, 40:80] = RED
    things[5:, 40:80] = True
    assert len(parts_of(values, hole, things)) == 3


@pytest.mark.parametrize("frame", [True, False])
def test_a_picture_of_which_one_edge_is_hidden_does_not_divide(wall, frame):
    """A lamp before its other edge: its colour would go on down to the floor. Without a lower frame it is a curtain."""
    values, hole = wall
    values[30:, 40:80] = RED
    if frame:
        values[80:, 40:80] = 0.1
    things = np.zeros_like(hole)
    things[32:90, 42:78] = True
    hole[20:, 78:86] = True
    values[:, 100:] = RED
    found = parts_of(values, hole, things)
    assert [part.columns.start for part in found[1:]] == pytest.approx([100] if frame else [40, 82, 100], abs=2)


@pytest.mark.parametrize(("wide", "divides"), [(10, True), (40, False)])
def test_an_edge_that_runs_behind_a_pole_divides_in_its_middle(wall, wide, divides):
    """Above a wide thing too little of it is seen."""
    values, hole = wall
    values[:, 120:] = RED
    hole[20:, 120 - wide // 2 : 120 + wide // 2] = True
    values[hole] = 0
    assert [part.columns.start for part in parts_of(values, hole)[1:]] == pytest.approx([120] * divides, abs=2)


def test_only_holes_that_reach_the_foot_count(wall):
    values, hole = wall
    values[:, 60:70] = RED
    hole[110:] = False
    assert len(parts_of(values, hole)) == 1


def test_soft_light_is_no_edge(wall):
    values, hole = wall
    values *= np.linspace(0.3, 1.0, WIDTH, dtype=np.float32)[:, None]
    assert len(parts_of(values, hole)) == 1


def test_everything_hidden_or_black(wall):
    values, hole = wall
    assert len(parts_of(values, np.ones_like(hole))) == 1
    assert len(parts_of(np.zeros_like(values), hole)) == 1


def test_posts_and_curtains_go_on_to_the_floor():
    room = box_room(window=False)
    plane = planes_of(room)[FIRST_WALL]
    height, width = texture_shape(plane, PX_PER_M)
    values = np.full((height, width, 3), GREY, np.float32)
    values[:, 20:30] = RED
    things = np.zeros((height, width), bool)
    things[4:, 50:90] = True
    folds = 0.3 + 0.2 * np.sin(np.arange(40) * 0.8)
    values[4:, 50:90] = folds[:, None] * np.float32([1.0, 0.3, 0.3])
    hole = np.zeros((height, width), bool)
    hole[-40:] = True
    seen = np.where(hole[..., None], 0, values).astype(np.float32)
    texture = Texture(plane, PX_PER_M, seen, ~hole, np.ones((height, width), np.float32))
    done = fill_plane(texture, hole, (np.zeros_like(hole), things), room, np.float32(GREY))
    inner = np.ones(width, bool)
    inner[[*range(17, 33), *range(47, 53), *range(87, 93)]] = False  # edges are found to a texel or two
    inner[22:28] = True
    off = np.abs(np.log(done.values[-30:, inner] / values[-30:, inner]))
    assert np.quantile(off, 0.95) < 0.1
    assert "parts between upright edges" in done.how


def test_a_half_hidden_door_is_finished_not_painted_over():
    """Furniture hides a red door's lower right part and the wall beside it: leaf and panels go on to the floor."""
    door = Opening(kind=OpeningKind.DOOR, wall=0, start_m=1.5, end_m=2.4, sill_m=0.0, head_m=2.0)
    room = box_room(window=False).model_copy(update={"openings": (door,)})
    plane = planes_of(room)[FIRST_WALL]
    height, width = texture_shape(plane, PX_PER_M)
    values, leaf = np.full((height, width, 3), GREY, np.float32), np.zeros((height, width), bool)
    left, right = (round((plane.width_m - u) * PX_PER_M) for u in (door.end_m, door.start_m))
    leaf[height - round(door.head_m * PX_PER_M) :, left:right] = True
    values[leaf] = RED
    values[leaf & (np.arange(width) % 12 < 2)] = np.float32(RED) / 2
    hole = np.zeros((height, width), bool)
    hole[-60:, (left + right) // 2 :] = True
    seen = np.where(hole[..., None], 0, values).astype(np.float32)
    texture = Texture(plane, PX_PER_M, seen, ~hole, np.ones((height, width), np.float32))
    done = fill_plane(texture, hole, (np.zeros_like(hole), np.zeros_like(hole)), room, np.float32(GREY))
    off = np.abs(np.log(np.maximum(done.values, 1e-3) / values)).max(axis=2)
    assert np.quantile(off[hole & leaf], 0.9) < 0.1, "leaf and panels go on"
    away = hole & (np.arange(width) > right + 8)
    assert np.quantile(off[away], 0.95) < 0.1, "the wall beside stays grey"


def test_the_wall_below_a_window_is_one():
    """The frame's edges come down to the sill, which furniture below hides."""
    room = box_room()
    plane = planes_of(room)[FIRST_WALL + room.openings[0].wall]
    height, width = texture_shape(plane, PX_PER_M)
    values, frame = np.full((height, width, 3), GREY, np.float32), np.zeros((height, width), bool)
    opening = room.openings[0]
    left, right = (round((plane.width_m - u) * PX_PER_M) for u in (opening.end_m + 0.15, opening.start_m - 0.15))
    sill = height - round(opening.sill_m * PX_PER_M)
    frame[:sill, left:right] = True
    values[frame] = RED
    hole = np.zeros((height, width), bool)
    hole[sill - 3 :] = True
    seen = np.where(hole[..., None], 0, values).astype(np.float32)
    texture = Texture(plane, PX_PER_M, seen, ~hole, np.ones((height, width), np.float32))
    done = fill_plane(texture, hole, (np.zeros_like(hole), np.zeros_like(hole)), room, np.float32(GREY))
    assert "parts between" not in done.how
    steps = np.abs(np.diff(np.log(done.values[-10:].mean(axis=(0, 2)))))
    assert steps.max() < 0.05, "no seam runs down to the floor"


def test_no_wall_is_made_of_the_curtain_beside_it():
    """Folds of a curtain repeat as patterns of walls do: on the plain wall beside it they do not go on."""
    room = box_room(window=False)
    plane = planes_of(room)[FIRST_WALL]
    height, width = texture_shape(plane, PX_PER_M)
    values, things = np.full((height, width, 3), GREY, np.float32), np.zeros((height, width), bool)
    things[4:, 60:] = True
    folds = 0.5 + 0.1 * np.sin(np.arange(width) * 2 * np.pi / 10) * np.ones((height, 1))
    values[things] = (folds[..., None] * np.float32([1.0, 0.9, 0.8]))[things]
    values = np.float32(values * np.random.default_rng(3).normal(1, 0.01, (height, width, 1)))
    hole = np.zeros((height, width), bool)
    hole[50:, 12:54] = True
    seen = np.where(hole[..., None], 0, values).astype(np.float32)
    texture = Texture(plane, PX_PER_M, seen, ~hole, np.ones((height, width), np.float32))
    unfit = np.zeros_like(hole)
    done, bare = (fill_plane(texture, hole, (unfit, which), room, np.float32(GREY)) for which in (things, unfit))
    off = [np.abs(np.log(np.maximum(one.values[hole], 1e-3) / GREY)).max(axis=1) for one in (done, bare)]
    assert np.quantile(off[0], 0.98) < 0.05
    assert np.quantile(off[1], 0.98) > 0.2, "where nobody says that it is a curtain"
