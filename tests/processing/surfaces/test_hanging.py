"""What hangs from the ceiling is parted from the wall behind it, as pale as it may be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.ground.arrays import Flags, Floats
from processing.sphere import Equirectangular
from processing.surfaces import hanging as hanging_module
from processing.surfaces.hanging import _before, hanging
from processing.surfaces.maps import CEILING, plane_map
from tests.processing.light.rooms import box_room

ROWS = 640
ROOM = box_room(6.0, 5.0, window=None)


def _shade(height_m: np.ndarray) -> np.ndarray:
    """Return the radius of a lamp at heights (H, W): a rod, and a shade from 1.9 to 2.1 m."""
    rod = np.where((height_m > 2.1) & (height_m < 2.7), 0.008, 0)
    return np.where((height_m > 1.9) & (height_m <= 2.1), 0.2 - 0.75 * (height_m - 1.9), rod)


def panorama(x: float, y: float, *, hung: bool = True, dark: float = 1.0) -> tuple[Floats, Flags]:
    """Return a room (H, W, 3) of slowly changing light with a pale lamp at (x, y), and where (H, W) its shade is."""
    latitude = ((0.5 - (np.arange(ROWS) + 0.5) / ROWS) * math.pi)[:, None]
    longitude = ((np.arange(2 * ROWS) + 0.5) / ROWS - 1)[None] * math.pi
    ceiling = plane_map(ROOM, Equirectangular(2 * ROWS, ROWS)) == CEILING
    light = 100 * (1 + 0.1 * np.sin(longitude) + 0.1 * latitude)
    rgb = light[..., None] * np.where(ceiling[..., None], (1.0, 0.95, 0.9), (0.8, 0.7, 0.55))
    turned = np.angle(np.exp(1j * (longitude - math.atan2(x, y))))
    beside_m = np.where(np.abs(turned) < 1, math.hypot(x, y) * np.tan(turned), 9.0)
    height_m = 1.6 + np.hypot(beside_m, math.hypot(x, y)) * np.tan(latitude)
    radius_m = _shade(height_m) if hung else np.where(np.abs(height_m - 2.68) < 0.02, 0.06, 0)
    lamp = np.abs(beside_m) < radius_m
    rgb = np.where(
        lamp[..., None],
        light[..., None] * np.where((height_m > 2.1)[..., None], 0.3, dark * np.array((0.75, 0.7, 0.62))),
        rgb,
    )
    noise = 1 + 0.01 * np.random.default_rng(3).standard_normal(rgb.shape)
    return np.asarray(rgb * noise, np.float32), lamp & (height_m < 2.1)


@pytest.mark.parametrize("place", [(1.6, 0.5), (0.1, -1.8)])  # the second across the seam
def test_a_pale_shade_is_found_whole(place: tuple[float, float]) -> None:
    rgb, shade = panorama(*place)
    (found,) = hanging(ROOM, rgb, [place])
    assert found.far_m == pytest.approx(math.hypot(*place))
    share = np.zeros(rgb.shape[:2], np.float32)
    share[found.row, found.column] = found.share
    low = share > 0.5
    low[: np.flatnonzero(shade.any(axis=1))[0]] = False
    assert (low & shade).sum() / (low | shade).sum() > 0.85
    assert share.max() <= 1
    assert (share > 0.5)[found.mount[0] + 6 : found.mount[0] + 12].any(), "its rod, too"


def test_a_dark_shade_has_no_rim_of_wall() -> None:
    """Blurred, what differs by twenty times the noise is wider by several pixels: a pale rim before a dark wardrobe."""
    rgb, shade = panorama(1.6, 0.5, dark=0.15)
    (found,) = hanging(ROOM, rgb, [(1.6, 0.5)])
    low = np.zeros(rgb.shape[:2], bool)
    low[found.row, found.column] = found.share > 0.5
    low[: np.flatnonzero(shade.any(axis=1))[0]] = False
    assert (low & ~shade).sum() < 0.06 * shade.sum()
    assert (low & shade).sum() > 0.95 * shade.sum()


def test_what_lies_on_the_ceiling_or_is_not_there_hangs_before_no_wall() -> None:
    rgb, _ = panorama(1.6, 0.5, hung=False)
    assert not list(hanging(ROOM, rgb, [(1.6, 0.5), (0.2, 0.1), (-2.0, 0.3)]))
    assert not list(hanging(ROOM, rgb, None))


def test_small_pictures_and_low_ceilings_are_no_trouble() -> None:
    rgb, _ = panorama(1.6, 0.5)
    low = ROOM.model_copy(update={"ceiling_height_m": 1.1, "camera_height_m": 0.6})
    assert len(list(hanging(low, rgb, [(1.6, 0.5)]))) <= 1
    for rows in (16, 64):
        small = rgb[:: ROWS // rows, :: ROWS // rows]
        assert all(one.share.max() <= 1 for one in hanging(ROOM, small, [(1.6, 0.5), (2.9, 2.4)]))


def test_an_uneven_wall_below_a_clear_shade_is_none_of_it_nor_is_the_wall_beside_its_rod(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    off = np.zeros((300, 201, 3))
    middle, shade, wall = np.abs(np.arange(-100, 101)), np.zeros((300, 201), bool), np.zeros((300, 201), bool)
    for row in range(100, 150):
        shade[row] = middle < 20 + row - 100
    wall[150:200, 97:104], wall[200:240, 80:121] = True, True
    off[20:100, 99:102], off[wall], off[shade] = 30.0, 1.9, 50.0
    monkeypatch.setattr(hanging_module, "_differs", lambda *_: off)
    found = _before(off.astype(np.float32), np.zeros((300, 201), np.int16), 20)
    assert found[shade].mean() > 0.97
    assert not found[160:].any()
    assert found[25:96, 100].all(), "its rod"
    assert found[90:96].sum(axis=1).max() < 10
