"""The white board of the simulated rooms is found, and a room without one is reported as such."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mocks.worlds.light import Site
from mocks.worlds.simple_room import SimpleRoom
from processing.errors import ScaleError
from processing.ground.board import Board, find_board
from processing.pictures.images import luminance_cd_m2
from processing.sphere import Equirectangular, directions
from processing.stages.calibrate import _target
from tests.processing.calibration.scale.chart_scenes import chart_view

SIZE = (840, 420)


def found_in(rgb: np.ndarray) -> Board:
    return find_board(rgb.astype(np.float32), luminance_cd_m2(rgb), np.ones(rgb.shape[:2], bool))


@pytest.mark.parametrize(
    ("seed", "yaw_rad"),
    [pytest.param(12, 0.0, marks=pytest.mark.long), pytest.param(11, 0.0, marks=pytest.mark.long), (11, 0.53)],
)
def test_the_simple_rooms_board_is_found(seed: int, yaw_rad: float) -> None:
    """The last one lies on the picture's seam."""
    world = SimpleRoom(seed)
    ways, _ = directions(Equirectangular(*SIZE, yaw_rad))
    rgb = world.radiance(Site.INDOOR, ways.astype(np.float32))
    rgb = rgb * (1 + 0.01 * np.random.default_rng(seed).standard_normal(rgb.shape))
    found = found_in(rgb)
    x, y, z = world.board_direction
    apart = math.remainder(found.longitude_rad + yaw_rad - math.atan2(x, y), 2 * math.pi)
    assert math.degrees(abs(apart)) < 3
    assert math.degrees(abs(found.latitude_rad - math.asin(z))) < 3
    assert found.confidence > 0.5


def test_no_board_is_reported() -> None:
    for rgb in (np.ones((*SIZE[::-1], 3)), np.zeros((*SIZE[::-1], 3)), np.ones((2, 4, 3))):
        with pytest.raises(ScaleError, match="no white board"):
            found_in(rgb)


def test_a_board_is_looked_for_in_panoramas_only() -> None:
    session, asked = SimpleNamespace(target=None), SimpleNamespace(target=None)
    with pytest.raises(ScaleError, match="panoramas only"):
        _target(chart_view(width_px=40), session, asked)  # type: ignore[arg-type]
