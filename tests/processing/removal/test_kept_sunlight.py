"""Sunlight that stays goes on in holes; pixels on edges of the room are mixed; soft shadows run out."""

from __future__ import annotations

import numpy as np
import pytest

from processing.ground.room_model import RoomModel
from processing.removal import illumination
from processing.removal.fill import SOFT_PX, soften_edges, sunlit
from processing.removal.illumination import meet_rims
from processing.sphere import Equirectangular
from processing.surfaces.maps import boundary_rows, plane_map

SHAPE = (60, 80)


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a floor with a patch of sun five times as bright, a hole half in it, and the patch."""
    sun = np.zeros(SHAPE, bool)
    sun[:, 40:] = True
    floor = np.full((*SHAPE, 3), 10.0, np.float32)
    floor[sun] = 50.0
    hole = np.zeros(SHAPE, bool)
    hole[20:40, 25:55] = True
    return floor, hole, sun


def test_a_hole_half_in_the_sun_is_half_lit() -> None:
    truth, hole, sun = scene()
    filled = truth.copy()
    filled[hole] = 10.0
    found, lit = sunlit(filled, ~hole, hole, sun & ~hole)
    assert np.array_equal(found[~hole], filled[~hole])
    assert not lit[~hole].any()
    assert abs(np.median(found[hole & sun]) - 50) < 5
    assert abs(np.median(found[hole & ~sun]) - 10) < 1
    off = np.abs(found - truth)[hole].max(axis=-1) > 10
    assert off.mean() < 0.15, "the edge goes straight on"


def test_without_sun_nothing_is_lit() -> None:
    truth, hole, sun = scene()
    found, lit = sunlit(truth, ~hole, hole, np.zeros_like(sun))
    assert found is truth
    assert not lit.any()
    dull = np.full_like(truth, 10.0)
    assert not sunlit(dull, ~hole, hole, sun & ~hole)[1].any(), "no brighter than the shade"


def test_edges_of_the_floor_are_mixed_by_their_share() -> None:
    room = RoomModel(
        source="given",
        floor=((-2.0, -3.0), (2.0, -3.0), (2.0, 3.0), (-2.0, 3.0)),
        camera_height_m=1.6,
        ceiling_height_m=2.7,
    )
    geometry = Equirectangular(128, 64)
    planes = plane_map(room, geometry)
    picture = np.where(planes[..., None] == 0, 10.0, 50.0).astype(np.float32).repeat(3, axis=-1)
    target = np.zeros(planes.shape, bool)
    target[:, :64] = True
    mixed = picture.copy()
    soften_edges(mixed, target, room, geometry)
    assert np.array_equal(mixed[:, 64:], picture[:, 64:])
    edge = boundary_rows(room, geometry)[1]
    slope = np.hypot(1, np.gradient(edge))
    for column in range(64):
        for row in (int(edge[column]) - 1, int(edge[column]), int(edge[column]) + 1):
            share = np.clip(0.5 + (row + 0.5 - edge[column]) / (2 * SOFT_PX * slope[column]), 0, 1)
            assert abs(mixed[row, column, 0] - (10 * share + 50 * (1 - share))) < 0.01
    assert 0 < (mixed != picture).any(axis=-1)[:, :64].sum() <= 64 * 4


@pytest.mark.parametrize("k", [1, 4])
def test_the_rim_of_a_filling_has_the_tone_of_what_is_beside_it(k: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a large picture, where it is worked out in a smaller one."""
    monkeypatch.setattr(illumination, "RIM_ROWS", 256)
    filled, planes = np.zeros((128 * k, 256 * k), bool), np.full((128 * k, 256 * k), 2, np.int16)
    filled[40 * k : 90 * k, 60 * k : 140 * k] = True
    planes[:, 100 * k :] = 3
    picture = np.full((128 * k, 256 * k, 3), 20.0, np.float32)
    picture[filled] *= 0.93
    picture[30 * k : 70 * k, 140 * k :] = 200  # another thing beside it
    met = picture.copy()
    meet_rims(met, filled, planes)
    assert np.array_equal(met[~filled], picture[~filled])
    assert np.allclose(met[40 * k, 70 * k : 95 * k], 20, rtol=0.01)
    assert np.allclose(met[55 * k : 75 * k, 80 * k : 90 * k], 20 * 0.93, rtol=0.01), "it runs out"
    assert np.allclose(met[50 * k : 60 * k, 140 * k - 1], 20 * 0.93, rtol=0.01)
