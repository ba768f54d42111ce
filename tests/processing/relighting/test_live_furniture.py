"""Furniture that is moved: its shade and its light, as the stage render would show them, from kept rays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from processing.ground.arrays import Vector
from processing.layout.arrangement import PlacedItem
from processing.layout.models.catalogue import Catalogue
from processing.light.picture.composite import differential
from processing.light.solver.irradiance import Effort
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.relighting.live_furniture import LiveFurniture
from processing.relighting.relit_session import read_session_room
from processing.stages.furnishing import furniture_parts
from tests.processing.relighting.lit_sessions import lit_session

STYLE = "classic"


def item(name: str, x: float, y: float, size: Vector, model: str = "") -> PlacedItem:
    return PlacedItem(id=name, category=name, model=model, size_m=size, theta_rad=0.3, t_m=(x, y, 0.0))


WARDROBE = item("wardrobe", 1.2, 1.0, (1.0, 0.5, 1.9))
DESK = item("desk", -1.0, -0.9, (1.2, 0.6, 0.74))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lit_session(tmp_path_factory.mktemp("lit"))


@pytest.fixture(scope="module")
def live(session: Path) -> LiveFurniture:
    return LiveFurniture(session)


def luminance(rgb: np.ndarray) -> np.ndarray:
    return rgb @ np.asarray(LUMINANCE_WEIGHTS)


def test_without_furniture_the_photograph_stays(live: LiveFurniture) -> None:
    assert np.array_equal(live.staged([], STYLE).rgb, live.photograph.rgb)


def test_what_was_moved_and_moved_back_is_as_it_was(live: LiveFurniture) -> None:
    """Only the rays near what moves are asked again: none may be left as they were elsewhere."""
    first = live.staged([WARDROBE, DESK], STYLE).rgb
    aside = WARDROBE.model_copy(update={"t_m": (0.9, 1.0, 0.0)})
    moved = live.staged([aside, DESK], STYLE).rgb
    assert (np.abs(moved - first) > 0.05 * first).any(axis=2).mean() > 0.01
    assert np.array_equal(live.staged([WARDROBE, DESK], STYLE).rgb, first)


@pytest.mark.long
def test_it_looks_as_it_is_rendered(session: Path, live: LiveFurniture) -> None:
    """Shade on the room, and light on furniture, of which the others' is counted once, as the stage has them."""
    room = read_session_room(session, None, 64)
    parts = furniture_parts([WARDROBE, DESK], Catalogue.builtin(STYLE))
    effort = Effort(texel_m=0.2, patch_samples=48, rows=64, pixel_samples=64, sun_samples=16, cleaning="fast")
    wanted = differential(room.picture.rgb, room.scene, parts, room.eye_m, effort=effort)
    found = live.staged([WARDROBE, DESK], STYLE).rgb
    solid = live.large.solid.reshape(wanted.furniture.shape)
    off = np.abs(np.log(np.maximum(luminance(found), 1e-3) / np.maximum(luminance(wanted.rgb), 1e-3)))
    for among, middle, most in ((solid & ~wanted.furniture, 0.05, 0.1), (wanted.furniture, 0.1, 0.2)):
        assert np.median(off[among]) < middle
        assert np.percentile(off[among], 80) < most
    shaded = solid & ~wanted.furniture & (luminance(wanted.rgb) < 0.8 * luminance(room.picture.rgb))
    assert shaded.sum() > 50
    assert np.median(luminance(found)[shaded] / luminance(room.picture.rgb)[shaded]) < 0.85


def test_a_piece_may_have_another_design(live: LiveFurniture) -> None:
    other = DESK.model_copy(update={"model": "desk/industrial"})
    alone = [live.staged([one], style).rgb for one, style in ((DESK, STYLE), (other, STYLE), (DESK, "industrial"))]
    assert not np.array_equal(alone[0], alone[1])
    assert np.array_equal(alone[1], alone[2])
