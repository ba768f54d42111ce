"""Direct sunlight: beams of windows, with the sun known, searched, or absent."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from processing.ground.room_model import RoomModel
from processing.ground.seam import row_solid_angles
from processing.pictures.images import luminance_cd_m2
from processing.removal.sunlight import Scene, SunFound, _times, find_sunlight, unmistakable
from processing.surfaces.maps import CEILING, FLOOR
from processing.surfaces.sun import (
    AZIMUTH_SLACK_RAD,
    ELEVATION_SLACK_RAD,
    OUTSIDE,
    sun_vector,
    wall_between,
    window_depth,
)
from tests.processing.removal.painted_room import SUN, Painted, box_room, iou, paint


def test_a_window_s_beam_by_hand() -> None:
    """The sun straight behind at 45 degrees: the window's edges land where the ray's slope of 1 puts them."""
    room, sun = box_room(), sun_vector(math.pi, math.radians(45))
    # Sill 0.8 m and head 2.2 m at y = -2: on the floor, light from y = -1.2 to 0.2.
    at = np.array([[0.0, y, 0.0] for y in (-1.3, -1.1, -0.5, 0.1, 0.3)])
    depth, which = window_depth(room, at, sun)
    assert ((depth > 0) == [False, True, True, True, False]).all()
    assert which[2] == 0
    slope = math.sqrt(0.5)
    assert depth[1] == pytest.approx(0.1, abs=1e-6), "0.1 m of window above the sill"
    assert slope > 0
    assert (window_depth(room, at, sun_vector(0.0, 0.5))[0] == OUTSIDE).all(), "the sun ahead, the window behind"


def test_another_wing_s_wall_hides_a_window() -> None:
    room = box_room().model_copy(
        update={"floor": ((-2.0, -2.0), (2.0, -2.0), (2.0, 3.0), (1.0, 3.0), (1.0, 0.0), (-2.0, 0.0))}
    )
    across, straight = np.array([[1.5, 2.5, 0.0]]), np.array([[1.5, -1.0, 0.0]])
    towards = sun_vector(math.radians(-150), 0.3)
    assert wall_between(room, across, towards).all()
    assert not wall_between(room, straight, towards).any()


def sunlight(painted: Painted, sun: tuple[float, float] | None) -> SunFound:
    usable = (painted.maps.opening < 0) & (painted.maps.plane != CEILING) & ~painted.furniture & ~painted.tripod
    usable &= ~painted.hung
    weight = np.broadcast_to(row_solid_angles(painted.maps.plane.shape), painted.maps.plane.shape)
    luminance = luminance_cd_m2(painted.image.rgb)
    return find_sunlight(luminance, painted.points_m, painted.maps.plane, usable, weight, painted.room, sun)


@pytest.mark.parametrize("sun", [SUN, (SUN[0] + 0.08, SUN[1] - 0.03)])
@pytest.mark.parametrize("ratio", [3.0, 30.0, 1.6e5])
def test_a_beam_is_found_with_the_sun_known_and_roughly_known(sun: tuple[float, float], ratio: float) -> None:
    painted = paint(sun_ratio=ratio)
    found = sunlight(painted, sun)
    assert painted.sunlit.sum() > 100
    assert iou(found.mask, painted.sunlit) > 0.9
    assert "confirm it" in found.reason
    assert found.sun is not None


def test_a_patch_at_the_camera_s_feet_is_found() -> None:
    """Of the bare floor 16 % is in the sun, a third of its directions, and more than half of its pixels."""
    painted = paint(things=False)
    assert painted.sunlit[painted.maps.plane == FLOOR].mean() > 0.5
    assert iou(sunlight(painted, SUN).mask, painted.sunlit) > 0.9


@pytest.mark.parametrize("off", [(0.3, 0.0), (0.0, 0.25), (-0.2, -0.2), (0.12, 0.0)])
def test_a_given_sun_is_not_left_by_more_than_it_may_be_off(off: tuple[float, float]) -> None:
    """The true sun stands 7 to 17 degrees beside the given one: the search does not drift there."""
    given = (SUN[0] + off[0], SUN[1] + off[1])
    found = sunlight(paint(sun_ratio=8.0), given)
    assert found.sun is not None
    moved = abs(found.sun[0] - given[0]), abs(found.sun[1] - given[1])
    assert moved[0] <= AZIMUTH_SLACK_RAD + 1e-6
    assert moved[1] <= ELEVATION_SLACK_RAD + 1e-6
    assert max(moved[0] / AZIMUTH_SLACK_RAD, moved[1] / ELEVATION_SLACK_RAD) > 0.99, "it goes as far as it may"


def test_a_given_sun_low_over_the_horizon_stays_above_it(monkeypatch: pytest.MonkeyPatch) -> None:
    heights: list[float] = []

    def as_good_as_any(_scene: Scene, _room: RoomModel, sun: np.ndarray) -> float:
        heights.append(float(sun[2]))
        return 1.0 - float(sun[2])

    monkeypatch.setattr("processing.removal.sunlight.explained", as_good_as_any)
    sunlight(paint(sun_ratio=8.0), (SUN[0], math.radians(1)))
    assert len(heights) > 20
    assert min(heights) > 0


@pytest.mark.parametrize("rises", [1.0, -1.0])
def test_no_height_beyond_what_the_given_sun_may_be_off_is_tried(monkeypatch: pytest.MonkeyPatch, rises: float) -> None:
    tried: list[float] = []

    def the_farther_the_better(_scene: Scene, _room: RoomModel, sun: np.ndarray) -> float:
        tried.append(math.asin(float(sun[2])) - SUN[1])
        return 10.0 + rises * tried[-1]

    monkeypatch.setattr("processing.removal.sunlight.explained", the_farther_the_better)
    sunlight(paint(sun_ratio=8.0), SUN)
    assert max(rises * one for one in tried) == pytest.approx(ELEVATION_SLACK_RAD, abs=1e-6)
    assert max(map(abs, tried)) <= ELEVATION_SLACK_RAD + 1e-6


def test_no_sun_is_said() -> None:
    overcast = sunlight(paint(sun=False), SUN)
    assert not overcast.mask.any()
    assert "overcast" in overcast.reason
    night = sunlight(paint(sun=False), (0.0, -0.1))
    assert "horizon" in night.reason


def test_a_bright_spot_that_no_window_explains_is_no_sunlight() -> None:
    painted = paint(sun=False)
    lamp = (np.abs(painted.points_m[..., 0] - 1.7) < 0.25) & (np.abs(painted.points_m[..., 1] - 2.6) < 0.25)
    painted.image.rgb[lamp & (painted.maps.plane == 0)] *= 20
    assert not sunlight(painted, SUN).mask.any()


@pytest.mark.parametrize("case", ["a patch", "dim", "soft", "hollow", "cut off"])
def test_without_knowledge_of_a_sun_only_what_nothing_else_can_be_is_its_light(case: str) -> None:
    """A square of 8 times the floor's luminance; the same as a reflection, a lamp's ring, a pane behind furniture."""
    y, x = np.indices((256, 512))
    points = np.stack([x / 64, y / 64, np.zeros_like(x)], axis=-1)
    patch = (np.abs(x - 250) < 40) & (np.abs(y - 180) < 30)
    if case == "hollow":
        patch &= ~((np.abs(x - 250) < 30) & (y > 160))
    relative = np.where(patch, 1.5 if case == "dim" else 3.0, 0.0).astype(np.float32)
    if case == "soft":
        relative = cv2.GaussianBlur(relative, (0, 0), 8)
    bare = np.zeros((256, 512), np.int16)
    if case == "cut off":
        bare[(x > 260) | (y < 165)] = -1
    found = unmistakable(patch, relative, points, bare)
    assert (found == patch).all() if case == "a patch" else not found.any()


@pytest.mark.parametrize("ratio", [3.0, pytest.param(30.0, marks=pytest.mark.long), 300.0])
def test_a_sun_far_brighter_than_any_white_in_the_shade_is_known_by_its_patches(ratio: float) -> None:
    """Where no patch is certain enough to be removed; what white paint could show as well says nothing of a sun."""
    found = sunlight(paint(sun_ratio=ratio), None)
    assert not found.mask.any()
    if ratio < 20:
        assert found.sun is None
    else:
        assert found.sun is not None
        assert float(sun_vector(*found.sun[:2]) @ sun_vector(*SUN)) > math.cos(math.radians(4))
        assert found.sun[2] == pytest.approx((ratio - 1) / math.sin(SUN[1]), rel=0.1)


@pytest.mark.parametrize("others", [60, 140])
def test_as_bright_places_that_no_beam_explains_leave_the_sun_unknown(others: int) -> None:
    """Pools of lamps on the floor: few do not matter."""
    luminance = np.ones(2000, np.float32)
    luminance[: 100 + others] = 51
    lit, floor = np.arange(2000) < 100, np.zeros(2000, np.int16)
    scene = Scene(np.zeros((2000, 3)), floor, np.log2(luminance), np.ones(2000))
    assert _times(scene, luminance, lit, math.radians(30)) == pytest.approx(100 if others < 100 else 0)
    window = np.where(lit, np.int16(2), floor)
    assert _times(replace(scene, plane=window), luminance, lit, math.radians(30)) == 0, "not on a wall"


def test_without_windows_luminance_alone_decides_and_says_so() -> None:
    painted = paint(window=False)
    assert "no sunlight assumed" in sunlight(painted, None).reason
    found = sunlight(painted, SUN)
    assert iou(found.mask, painted.sunlit) > 0.9
    assert "luminance alone" in found.reason
