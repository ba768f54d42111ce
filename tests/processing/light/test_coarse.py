"""Large pictures: filled from a coarse grid where light is smooth, looked at where it is not, whatever the threads."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from processing.ground.threads import ASKED
from processing.light.picture import change
from processing.light.picture.coarse import furniture_blocks
from processing.light.picture.composite import differential
from processing.light.scene.scene import Sun
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import FIRST_PART, sight_of
from processing.light.solver.stage import Stage
from processing.sphere import Equirectangular
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky

ROWS = 160
LOOK = Effort(texel_m=0.25, patch_samples=32, rows=48, pixel_samples=16, sun_samples=16, clean=False)
POLE = box((1.0, 1.2, 0.9), (0.02, 0.02, 1.8), name="pole")
TABLE = box((1.2, -0.8, 0.4), (0.8, 0.8, 0.8))


def staged(monkeypatch: pytest.MonkeyPatch, step: int, sun: Sun | None):
    monkeypatch.setattr(change, "block_px", lambda _apart: step)
    room = scene_of(box_room(), uniform_sky(4000.0, sun), 0.5, reveal_m=0.2)
    photograph = np.random.default_rng(4).uniform(20, 90, (ROWS, 2 * ROWS, 3)).astype(np.float32)
    return photograph, differential(photograph, room, (TABLE, POLE), EYE, effort=LOOK, seed=2)


@pytest.mark.parametrize("sun", [None, Sun((0.0, -0.8, 0.6), (6e4, 6e4, 6e4))], ids=["clouds", "sun"])
def test_a_coarse_grid_says_what_every_pixel_says(monkeypatch: pytest.MonkeyPatch, sun: Sun | None) -> None:
    photograph, fine = staged(monkeypatch, 1, sun)
    _, coarse = staged(monkeypatch, 2, sun)
    assert np.array_equal(coarse.furniture, fine.furniture)
    assert np.array_equal(coarse.rgb[coarse.kept], photograph[coarse.kept])
    off = np.abs(coarse.rgb / fine.rgb - 1).max(axis=-1)[~fine.furniture]
    assert np.median(off) < 1e-3
    # At the edge of sunlight chance decides a few pixels: rays to the sun's disc are others in other bands.
    assert np.quantile(off, 0.99) < 0.02
    assert coarse.rgb.sum(dtype=float) == pytest.approx(fine.rgb.sum(dtype=float), rel=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_no_furniture_is_outside_its_blocks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = tuple(
        box(rng.uniform((-2, -1.5, 0.1), (2, 1.5, 2.2)), rng.uniform(0.01, 1.2, 3), name=str(k)) for k in range(5)
    )
    stage = Stage.of(scene_of(box_room(), uniform_sky()).furnished(parts), 0.5)
    geometry = Equirectangular(400, 200)
    for step in (3, 4, 8):
        blocks = furniture_blocks(stage, (200, 400), step, EYE)
        seen = (sight_of(stage, geometry, EYE).label >= FIRST_PART).reshape(200, 400)
        near = np.repeat(np.repeat(blocks, step, axis=0), step, axis=1)[:200, :400]
        assert not (seen & ~near).any()


@pytest.mark.long
def test_threads_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(change, "ROWS_AT_ONCE_PX", 1 << 15)
    found = []
    for count in ("1", "3"):
        monkeypatch.setenv(ASKED, count)
        found.append(staged(monkeypatch, 4, None)[1])
    assert np.array_equal(found[0].rgb, found[1].rgb)
    assert np.array_equal(found[0].kept, found[1].kept)


def test_grain_of_gathered_light_is_evened_out_over_a_side_of_a_thing_alone() -> None:
    rng = np.random.default_rng(3)
    point = np.column_stack([rng.uniform(0, 0.0299, 400), np.zeros(400), np.repeat([0.01, 0.04], 200)])
    normal = np.tile([0.0, 1.0, 0.0], (400, 1))
    normal[:100] = (1.0, 0.0, 0.0)
    label = np.full(400, FIRST_PART, np.int32)
    label[300:] += 1
    sight: Any = SimpleNamespace(point=point, normal=normal, label=label)
    light = rng.exponential(np.repeat([10.0, 20.0, 30.0, 40.0], 100)[:, None], (400, 3)).astype(np.float32)
    sides = light.reshape(4, 100, 3).mean(axis=1)
    kept = light[399].copy()
    change._even_out(sight, np.arange(399), light)
    np.testing.assert_allclose(light[:300], np.repeat(sides[:3], 100, axis=0), rtol=1e-5)
    assert np.ptp(light[300:399], axis=0).max() < 1e-4
    np.testing.assert_array_equal(light[399], kept)


def test_a_wall_behind_a_slit_is_not_grainy() -> None:
    """No small pixel shows the wall between two cupboards 3 cm apart: few rays a pixel gather its light."""
    room = scene_of(box_room(), uniform_sky(4000.0), 0.5, reveal_m=0.2)
    pair = [box((side * 0.415, 1.6, 0.7), (0.8, 0.4, 1.4), name=str(side)) for side in (-1, 1)]
    photograph = np.full((720, 1440, 3), 50, np.float32)
    shown = differential(photograph, room, tuple(pair), EYE, effort=LOOK, seed=2)
    slit = shown.rgb[380:440, 716:724, 1][:, ~shown.furniture[380:440, 716:724].any(axis=0)]
    assert slit.shape[1] > 1
    assert np.abs(np.diff(np.log(slit), axis=0)).mean() < 0.08  # 0.18 where each pixel has its own rays alone
