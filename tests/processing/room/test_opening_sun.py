"""Patches of sun on walls are no windows, where the sun's place is known; windows stay windows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from processing.ground.room_model import OpeningKind
from processing.room.opening_sun import find_openings_in_sun, sun_patches
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR
from tests.processing.removal.painted_room import Painted, evidence_of, paint

LOW = (math.pi, math.radians(8))
"""Through the window in wall 0 onto wall 2, 0.1 to 1.5 m high."""


@pytest.fixture(scope="module")
def painted() -> Painted:
    return paint(rows=256, sun_at=LOW, things=False)


def evidence(painted: Painted, window: npt.NDArray[np.bool_]) -> SceneEvidence:
    """Return evidence that takes a place for a window besides the true one."""
    classes = np.where(painted.maps.plane == FLOOR, SceneClass.FLOOR, SceneClass.WALL)
    classes[painted.maps.plane == CEILING] = SceneClass.CEILING
    classes[(painted.maps.opening >= 0) | window] = SceneClass.WINDOW
    return evidence_of(classes)


def walls(painted: Painted, light: npt.NDArray[np.float32], sun: tuple[float, float] | None) -> list[int]:
    patch = painted.sunlit & (painted.maps.plane >= FIRST_WALL)
    image = replace(painted.image, rgb=light)
    room = painted.room.model_copy(update={"openings": ()})
    found = find_openings_in_sun(image, evidence(painted, patch), room, sun)
    return sorted(one.wall for one in found if one.kind is OpeningKind.WINDOW)


def test_a_patch_of_sun_is_no_window(painted: Painted) -> None:
    assert walls(painted, painted.image.rgb, None) == [0, 2], "unknown sun: the patch looks like a window"
    assert walls(painted, painted.image.rgb, LOW) == [0]
    assert walls(painted, painted.image.rgb, (LOW[0] + 0.08, LOW[1] + 0.03)) == [0], "the heading is a little off"


@pytest.mark.parametrize("sun", [(LOW[0] + 0.5, LOW[1]), (LOW[0], math.radians(40)), (LOW[0], -0.1), (0.0, 0.2)])
def test_what_the_sun_cannot_reach_stays_a_window(painted: Painted, sun: tuple[float, float]) -> None:
    assert walls(painted, painted.image.rgb, sun) == [0, 2]


def test_a_window_that_shows_the_outdoors_stays_though_the_sun_reaches_it(painted: Painted) -> None:
    patch = painted.sunlit & (painted.maps.plane >= FIRST_WALL)
    light = painted.image.rgb.copy()
    blue = light * np.array([0.5, 0.9, 2.5], np.float32)
    assert walls(painted, np.where(patch[..., None], blue, light).astype(np.float32), LOW) == [0, 2], "sky"
    trees = np.exp2(np.random.default_rng(3).normal(0, 1.0, patch.shape)).astype(np.float32)[..., None]
    assert walls(painted, np.where(patch[..., None], light * trees, light).astype(np.float32), LOW) == [0, 2], "trees"


def test_black_and_not_finite_places_are_no_patches(painted: Painted) -> None:
    light = painted.image.rgb.copy()
    light[: len(light) // 2] = np.nan
    light[len(light) // 2 :] = 0
    patches, _ = sun_patches(replace(painted.image, rgb=light), painted.room, LOW)
    assert not patches.any()
