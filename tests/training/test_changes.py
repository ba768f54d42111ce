"""The direction of a room's walls; furniture of chance form and of folders."""

from __future__ import annotations

import numpy as np
import pytest

from processing.errors import SceneError
from processing.ground.polygons import triangles
from processing.segmentation.evidence import SceneClass
from training.labels import boundary_latitudes, wall_direction_rad
from training.rooms.forms import bed, block, couch, heap, laden, shelf, wardrobe
from training.rooms.house import draw_house
from training.rooms.pieces import Piece, built_in_pieces, folder_pieces, joined
from training.rooms.props import furnish_house

ROWS, COLUMNS = 64, 128
BOX = np.array([(-2.0, -1.5), (1.5, -1.5), (1.5, 3.0), (-2.0, 3.0)])


def rotated(points: np.ndarray, turn: float) -> np.ndarray:
    # Azimuth grows from +y towards +x.
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([points[:, 0] * c + points[:, 1] * s, points[:, 1] * c - points[:, 0] * s], axis=1)


def columns_of(outline: np.ndarray) -> dict[str, np.ndarray]:
    up, down = boundary_latitudes(outline, (0.0, 0.0), 1.4, 2.6, COLUMNS)
    rows = (np.arange(ROWS)[:, None] + 0.5) / ROWS
    label = np.where(rows > 0.5 - down / np.pi, SceneClass.FLOOR, SceneClass.WALL)
    label = np.where(rows < 0.5 - up / np.pi, SceneClass.CEILING, label).astype(np.uint8)
    return {"label": label, "ceiling_rad": up, "floor_rad": down, "corner": np.zeros(COLUMNS, np.float32)}


@pytest.mark.parametrize("turn", [0.0, 0.35, -1.2])
def test_direction_of_walls_is_found(turn: float) -> None:
    found = wall_direction_rad(columns_of(rotated(BOX, turn))["floor_rad"])
    away = (found - turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
    assert abs(away) < np.radians(2.0)


@pytest.mark.parametrize("form", [bed, wardrobe, shelf, couch, block, heap])
def test_forms_stand_on_the_floor_within_their_size(form) -> None:  # type: ignore[no-untyped-def]
    for seed in range(6):
        piece = form(np.random.default_rng(seed))
        low, high = piece.triangles.min(axis=(0, 1)), piece.triangles.max(axis=(0, 1))
        assert low[2] > -0.02
        assert low[2] < 0.25
        assert (high - low)[:2].max() < 1.6 * max(piece.size_m[:2]) + 0.3
        assert piece.paint_of.max() < len(piece.colours)
        assert len(piece.paints) == len(piece.colours)


def test_things_lie_on_a_table() -> None:
    table = block(np.random.default_rng(3)).scaled((1.0, 1.0, 0.5))
    for seed in range(8):
        full = laden(np.random.default_rng(seed), table)
        assert len(full.triangles) >= len(table.triangles)
        assert full.triangles[len(table.triangles) :, :, 2].min(initial=table.size_m[2]) >= table.size_m[2] - 1e-5


def test_joined_pieces_keep_their_paints() -> None:
    one = Piece("box", (1, 1, 1), np.zeros((2, 3, 3), np.float32), np.array([0, 1], np.int16), ((1, 0, 0), (0, 1, 0)))
    both = joined("two", (1, 1, 2), [(one, np.zeros(3, np.float32)), (one, np.array([0, 0, 1], np.float32))])
    assert both.paint_of.tolist() == [0, 1, 2, 3]
    assert both.triangles[2:, :, 2].tolist() == np.ones((2, 3)).tolist()


def test_pieces_of_a_folder_stand_on_the_floor(tmp_path) -> None:  # type: ignore[no-untyped-def]
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (tmp_path / "chair.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    (tmp_path / "broken.obj").write_text("v 0 0\nf 1 2 9\n")
    (found,) = folder_pieces([tmp_path])
    assert found.triangles[..., 2].min() == pytest.approx(0.0, abs=1e-6)
    assert np.abs(found.triangles.min(axis=(0, 1)) + found.triangles.max(axis=(0, 1)))[:2] == pytest.approx(0, abs=1e-5)


def test_houses_are_furnished_with_pieces_given() -> None:
    pieces = built_in_pieces()[:4]
    stood = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        house = draw_house(rng, 1)
        before = len(house.soup.labels)
        furnish_house(rng, house, pieces)
        added = house.soup.labels[before:]
        assert all(set(np.unique(one)) <= {SceneClass.FURNITURE, SceneClass.FIXTURE} for one in added)
        stood += sum(int((one == SceneClass.FURNITURE).sum()) for one in added)
    assert stood > 50


def test_outline_without_triangles_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def refused_once(outline: np.ndarray) -> np.ndarray:
        asked.append(outline)
        if len(asked) == 1:
            raise SceneError("an outline that crosses itself")
        return triangles(outline)

    monkeypatch.setattr("training.rooms.house.triangles", refused_once)
    house = draw_house(np.random.default_rng(5), 1)
    assert len(asked) == 2
    assert np.array_equal(house.outline, asked[1])
