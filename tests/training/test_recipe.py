"""The recipe of the training pictures, without torch: what it draws and whether its labels are right."""

from __future__ import annotations

import numpy as np
import pytest

from processing.segmentation.evidence import SceneClass
from training.augment import drawn_batch, recoloured, turned
from training.labels import boundary_latitudes
from training.recipe import Example, Standpoint, looks_of
from training.rooms.camera import add_foot, small_labels
from training.rooms.house import draw_cameras, draw_house, draw_outline
from training.rooms.paints import plain_tile
from training.rooms.props import furnish_house
from training.rooms.render import Stage, see
from training.rooms.soup import WORLD, Soup
from training.shards import read_shards, write_shard

ROWS = 128


def edge_rows(latitude_rad: np.ndarray) -> np.ndarray:
    return (0.5 - latitude_rad / np.pi) * ROWS


def box_stage() -> tuple[Stage, np.ndarray]:
    soup = Soup()
    soup.box(WORLD, (-2.0, -1.5, 0.0), (1.5, 3.0, 0.0), SceneClass.FLOOR, soup.paint("floor"))
    soup.box(WORLD, (-2.0, -1.5, 2.6), (1.5, 3.0, 2.6), SceneClass.CEILING, soup.paint("ceiling"))
    wall = soup.paint("wall")
    for low, high in (((-2, -1.5), (1.5, -1.5)), ((1.5, -1.5), (1.5, 3)), ((-2, 3), (1.5, 3)), ((-2, -1.5), (-2, 3))):
        soup.box(WORLD, (*low, 0.0), (*high, 2.6), SceneClass.WALL, wall)
    return Stage(soup, []), np.array([(-2.0, -1.5), (1.5, -1.5), (1.5, 3.0), (-2.0, 3.0)])


def check_structure(example: Example, slack_px: float = 1.0) -> None:
    """Floor lies below the floor's edge, ceiling above the ceiling's."""
    rows = np.arange(ROWS)[:, None] + 0.5
    floor, ceiling = edge_rows(example.floor_rad), edge_rows(example.ceiling_rad)
    assert not ((example.label == SceneClass.FLOOR) & (rows < floor - slack_px)).any()
    assert not ((example.label == SceneClass.CEILING) & (rows > ceiling + slack_px)).any()
    assert (example.ceiling_rad > 0).all()
    assert (example.floor_rad < 0).all()


def test_classes_of_a_box_room_change_at_its_boundaries() -> None:
    stage, outline = box_stage()
    seen = see(np.random.default_rng(0), stage, (0.2, 0.1), 1.4)
    label = small_labels(seen.label)
    up, down = boundary_latitudes(outline, (0.2, 0.1), 1.4, 2.6, 2 * ROWS)
    ceiling = (label == SceneClass.CEILING).sum(axis=0)
    floor = ROWS - (label == SceneClass.FLOOR).sum(axis=0)
    assert np.abs(ceiling - edge_rows(up)).max() <= 1.0
    assert np.abs(floor - edge_rows(down)).max() <= 1.0
    assert set(np.unique(label)) == {SceneClass.FLOOR, SceneClass.WALL, SceneClass.CEILING}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_drawn_house_has_right_labels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    house = draw_house(rng, 1)
    furnish_house(rng, house, [])
    stage = Stage(house.soup, house.panes, house.portals, house.mirrors, house.lamps)
    tiles = [plain_tile(np.random.default_rng(k)) for k in range(3)]
    view = Standpoint(house.outline, house.ceiling_m, house.cameras[0], house.eyes_m[0])
    examples = list(looks_of(rng, stage, view, tiles, 1, foot=True))
    assert len(examples) == 1
    check_structure(examples[0])
    assert examples[0].picture.std() > 2
    assert (examples[0].label == SceneClass.WALL).mean() > 0.03


def test_outlines_hold_their_cameras() -> None:
    from shapely.geometry import Point, Polygon

    for seed in range(30):
        rng = np.random.default_rng(seed)
        outline = draw_outline(rng)
        room = Polygon(outline)
        assert room.is_valid
        assert room.exterior.is_ccw
        for place in draw_cameras(rng, outline, 2):
            assert room.contains(Point(place))


def test_the_foot_is_labelled_where_it_is_drawn() -> None:
    light = np.ones((256, 512, 3), np.float32)
    label = np.zeros((256, 512), np.int8)
    out, named = add_foot(np.random.default_rng(5), light, label, 1.5)
    changed = (out != light).any(axis=2)
    assert changed.any()
    assert (named[changed] == SceneClass.TRIPOD).all()
    assert not changed[:128].any()


def drawn_example(rng: np.random.Generator) -> Example:
    stage, outline = box_stage()
    return next(looks_of(rng, stage, Standpoint(outline, 2.6, (0.2, 0.1), 1.4), [plain_tile(rng)], 1, foot=False))


def test_turning_and_mirroring_move_picture_and_labels_alike() -> None:
    arrays = {
        "picture": np.tile(np.arange(8)[None, :, None], (4, 1, 3)),
        "label": np.tile(np.arange(8)[None], (4, 1)),
        "floor_rad": np.arange(8.0),
    }
    moved = turned(arrays, 3, True)
    assert (moved["picture"][..., 0] == moved["label"]).all()
    assert (moved["label"][0] == moved["floor_rad"]).all()
    assert moved["floor_rad"].tolist() == [4, 3, 2, 1, 0, 7, 6, 5]


def test_examples_are_kept_and_augmented_with_their_labels(tmp_path) -> None:
    example = drawn_example(np.random.default_rng(4))
    assert write_shard(tmp_path, 20, [example, example]) == 2
    examples = read_shards(tmp_path)
    assert len(examples) == 2
    assert (examples.picture[1] == example.picture).all()
    batch = drawn_batch(np.random.default_rng(1), examples, np.array([0, 1, 0]))
    assert batch["picture"].shape == (3, 3, 128, 256)
    for label, floor, ceiling in zip(batch["label"], batch["floor_rad"], batch["ceiling_rad"], strict=True):
        check_structure(Example(example.picture, label, ceiling, floor, example.corner))


def test_colours_stay_in_range() -> None:
    rng = np.random.default_rng(0)
    picture = rng.random((8, 16, 3)).astype(np.float32)
    for _ in range(20):
        out = recoloured(rng, picture)
        assert out.min() >= 0
        assert out.max() <= 1
