"""The recipe of the training views, without torch: what it draws and whether its labels are right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from processing.segmentation.evidence import SceneClass
from training.labels import SKIRTING, boundary_latitudes
from training.rooms.beyond import build_beyond
from training.rooms.house import draw_cameras, draw_house, draw_outline
from training.rooms.paints import plain_tile
from training.rooms.props import furnish_house
from training.rooms.render import Stage, Standpoint, View, see
from training.rooms.soup import WORLD, Soup
from training.shards import read_shard, write_shard

ROWS = 256


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


def check_structure(view: View, slack_px: float = 1.0) -> None:
    """Floor lies below the floor's edge, ceiling above the ceiling's."""
    rows = np.arange(ROWS)[:, None] + 0.5
    floor, ceiling = edge_rows(view.floor_rad), edge_rows(view.ceiling_rad)
    assert not ((view.label == SceneClass.FLOOR) & (rows < floor - slack_px)).any()
    assert not ((view.label == SceneClass.CEILING) & (rows > ceiling + slack_px)).any()
    assert (view.ceiling_rad > 0).all()
    assert (view.floor_rad < 0).all()


def tiles() -> list:  # type: ignore[type-arg]
    return [plain_tile(np.random.default_rng(k)) for k in range(3)]


def box_view() -> View:
    stage, outline = box_stage()
    view = see(np.random.default_rng(0), stage, Standpoint(outline, 2.6, (0.2, 0.1), 1.4), tiles())
    assert view is not None
    return view


def test_classes_of_a_box_room_change_at_its_boundaries() -> None:
    view, (_, outline) = box_view(), box_stage()
    up, down = boundary_latitudes(outline, (0.2, 0.1), 1.4, 2.6, 2 * ROWS)
    ceiling = (view.label == SceneClass.CEILING).sum(axis=0)
    floor = ROWS - (view.label == SceneClass.FLOOR).sum(axis=0)
    assert np.abs(ceiling - edge_rows(up)).max() <= 1.0
    assert np.abs(floor - edge_rows(down)).max() <= 1.0
    assert set(np.unique(view.label)) == {SceneClass.FLOOR, SceneClass.WALL, SceneClass.CEILING}
    assert float(view.reach_m[-1].astype(np.float64).mean()) == pytest.approx(1.4, abs=0.01)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_drawn_house_has_right_labels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    house = draw_house(rng, 1)
    furnish_house(rng, house, [])
    before = len(house.soup.labels)
    build_beyond(rng, house, [])
    assert all((labels == SceneClass.DOOR).all() for labels in house.soup.labels[before:])
    stage = Stage(house.soup, house.panes, house.portals, house.mirrors, house.lamps)
    view = see(rng, stage, Standpoint(house.outline, house.ceiling_m, house.cameras[0], house.eyes_m[0]), tiles())
    assert view is not None
    check_structure(view)
    assert np.isin(view.label, (SceneClass.WALL, SKIRTING)).mean() > 0.03
    assert np.abs(np.linalg.norm(view.normal[view.paint >= 0], axis=1) - 127).max() < 2


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


def test_views_are_kept(tmp_path: Path) -> None:
    view = box_view()
    assert write_shard(tmp_path, 20, [view, view]) == 2
    views = read_shard(tmp_path / "000020.npz")
    assert len(views["label"]) == 2
    assert (views["label"][1] == view.label).all()
