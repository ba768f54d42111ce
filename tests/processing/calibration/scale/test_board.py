"""The white board of the simulated rooms is found, and a room without one is told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mocks.worlds.light import Site
from mocks.worlds.simple_room import SimpleRoom
from processing.calibration.scale.board import find_board
from processing.errors import ScaleError
from processing.pictures.images import RelativeImage
from processing.sphere import Equirectangular, Perspective, directions
from tests.processing.calibration.scale.chart_scenes import chart_view

SIZE = (840, 420)


def panorama(rgb: np.ndarray, yaw_rad: float = 0.0) -> RelativeImage:
    shape = rgb.shape[:2]
    known = np.full(shape, 0.01, dtype=np.float32)
    geometry = Equirectangular(shape[1], shape[0], yaw_rad)
    return RelativeImage(rgb.astype(np.float32), known, np.zeros(shape, dtype=np.uint8), geometry)


@pytest.mark.parametrize(("seed", "yaw_rad"), [(11, 0.0), (12, 0.0), (11, -2.61)])
def test_the_simple_rooms_board_is_found(seed: int, yaw_rad: float) -> None:
    """The last one lies on the picture's seam."""
    world = SimpleRoom(seed)
    ways, _ = directions(Equirectangular(*SIZE, yaw_rad + math.pi if yaw_rad else 0.0))
    rgb = world.radiance(Site.INDOOR, ways.astype(np.float32))
    rgb = rgb * (1 + 0.01 * np.random.default_rng(seed).standard_normal(rgb.shape))
    found = find_board(panorama(rgb, yaw_rad + math.pi if yaw_rad else 0.0))
    x, y, z = world.board_direction
    apart = math.remainder(found.longitude_rad - math.atan2(x, y), 2 * math.pi)
    assert math.degrees(abs(apart)) < 3
    assert math.degrees(abs(found.latitude_rad - math.asin(z))) < 3
    assert found.confidence > 0.5


def test_a_recorded_direction_decides_between_two() -> None:
    rgb = np.full((*SIZE[::-1], 3), 1.0)
    rgb[180:220, 100:140] = rgb[180:220, 600:640] = 3.0
    for column in (120, 620):
        near = (column / SIZE[0] - 0.5) * 2 * math.pi
        assert find_board(panorama(rgb), (near, 0.05)).longitude_rad == pytest.approx(near, abs=0.03)


def test_no_board_is_told() -> None:
    for rgb in (np.ones((*SIZE[::-1], 3)), np.zeros((*SIZE[::-1], 3)), np.ones((2, 4, 3))):
        with pytest.raises(ScaleError, match="no white board"):
            find_board(panorama(rgb))
    assert isinstance(chart_view(width_px=40).geometry, Perspective)
    with pytest.raises(ScaleError, match="panoramas only"):
        find_board(chart_view(width_px=40))
