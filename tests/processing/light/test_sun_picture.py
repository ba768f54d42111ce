"""The sun in large pictures: blocks whose corners agree, and every pixel along the edges of light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from processing.light.scene.scene import Scene, Sun
from processing.light.solver import sun
from processing.light.solver.sight import FIRST_PART, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of, sun_rim, within_rim
from processing.sphere import Equirectangular, Perspective
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky

SUN = Sun((0.0, -0.8, 0.6), (80_000.0, 70_000.0, 60_000.0))
VIEW = Perspective(320, 240, 0.4, pitch_rad=-1.2)
MIDDLE = Perspective(112, 84, 0.2, pitch_rad=-1.2)


def sunny(*parts, bars: bool = False) -> Scene:
    scene = scene_of(box_room(), uniform_sky(0.0, SUN, ground=0.0), transmittance={0: (0.8, 0.7, 0.6)})
    if bars:
        clear = np.ones((40, 50), np.float32)
        clear[::8], clear[:, ::10] = 0, 0
        panes = tuple(replace(p, clear=clear, veil_cd_m2=np.zeros((40, 50, 3), np.float32)) for p in scene.panes)
        scene = replace(scene, panes=panes)
    return scene.furnished(parts)


LEGS = tuple(box((x, 0.3, 0.3), (0.03, 0.03, 0.6)) for x in (-0.15, -0.05, 0.05, 0.15))


@pytest.mark.parametrize("scene", [sunny(), sunny(*LEGS), sunny(bars=True)], ids=["bare", "legs", "bars"])
def test_blocks_give_the_light_that_every_pixel_gives(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage.of(scene, 0.5)
    sight = sight_of(stage, MIDDLE, EYE)
    assert sun._block_px(sight) > 1
    quick = sun_of(stage, sight, 16, 0)
    monkeypatch.setattr(sun, "MOST_STEP", 1)
    whole = sun_of(stage, sight, 16, 0)
    assert whole.max() > 1000
    assert quick == pytest.approx(whole, rel=1e-4, abs=1)


def test_blocks_look_at_far_fewer_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage.of(sunny(), 0.5)
    sight, looked = sight_of(stage, VIEW, EYE), []

    def counted(stage, disc, points, *more):
        looked.append(len(points))
        return tint(stage, disc, points, *more)

    tint = sun.sun_tint
    monkeypatch.setattr(sun, "sun_tint", counted)
    sun_of(stage, sight, 16, 0)
    few = sum(looked)
    looked.clear()
    monkeypatch.setattr(sun, "MOST_STEP", 1)
    sun_of(stage, sight, 16, 0)
    assert few < 0.4 * sum(looked)


def test_only_what_is_asked_for_is_lit() -> None:
    stage = Stage.of(sunny(*LEGS), 0.5)
    sight = sight_of(stage, VIEW, EYE)
    furniture = sight.label >= FIRST_PART
    found = sun_of(stage, sight, 16, 0, furniture)
    assert found[furniture].any()
    assert not found[~furniture].any()
    assert np.array_equal(found, np.where(furniture[:, None], sun_of(stage, sight, 16, 0), 0))


def test_no_sun_no_pane_and_one_pixel() -> None:
    dark = Stage.of(scene_of(box_room(), uniform_sky()), 0.5)
    assert not sun_of(dark, sight_of(dark, VIEW, EYE), 16, 0).any()
    closed = Stage.of(scene_of(box_room(window=None), uniform_sky(sun=SUN)), 0.5)
    assert not sun_of(closed, sight_of(closed, VIEW, EYE), 16, 0).any()
    stage = Stage.of(sunny(), 0.5)
    one = sight_of(stage, VIEW, EYE).some(np.array([5]))
    assert sun_of(stage, one, 16, 0).shape == (1, 3)


def test_the_sun_falls_through_a_pane_no_farther_than_its_photographed_patch_reaches() -> None:
    """A casing was taken for glass: new patches ended beside the photographed ones, ragged, as removal's mask does."""
    light = uniform_sky(1000.0, SUN)
    geometry, cells = Equirectangular(640, 320), np.ones((37, 50), np.float32)
    stages = [
        Stage.of(scene_of(box_room(window=window), light), 0.2)
        for window in ((1.5, 3.5, 0.8, 2.28), (1.7, 3.5, 0.8, 2.08))
    ]
    sight = sight_of(stages[0], geometry, EYE)
    due, shown = (sun_of(stage, sight, 16, 0).any(axis=1) for stage in stages)
    pane = replace(stages[0].scene.panes[0], clear=cells, veil_cd_m2=np.zeros((37, 50, 3), np.float32))
    rim = sun_rim(pane, SUN, sight.point[due], shown[due])
    assert rim == (5, 0, 5, 0)
    assert within_rim(replace(pane, sun_rim=rim)).sum() == 45 * 32
    room = replace(stages[0].scene, panes=(replace(pane, sun_rim=rim),))
    now = sun_of(Stage.of(room, 0.2), sight, 16, 0).any(axis=1)
    assert (now ^ shown).sum() < 0.02 * shown.sum(), "it falls as it was photographed"
    assert (room.panes[0].clear == 1).all(), "what is seen through it is glass"
    # The shade of what stood in the beam is no rim, nor is anything known of a sun that shows no patch.
    half = shown & (sight.point[:, 0] > np.median(sight.point[shown, 0]))
    assert sun_rim(pane, SUN, sight.point[due], half[due]) in ((0, 0, 5, 0), (5, 0, 5, 0))
    assert sun_rim(pane, SUN, sight.point[due], np.zeros(due.sum(), bool)) == (0, 0, 0, 0)
