"""The rules of emptied photographs, on a painted room that keeps them and on one fault of each kind."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.real.rules import SEAM, Emptying, checked, seam_share, skirting_by_wall
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.ground.seam import grown
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, FLOOR, surface_maps

ROWS = 512
SPHERE = Equirectangular(2 * ROWS, ROWS)
DOOR = Opening(kind=OpeningKind.DOOR, wall=1, start_m=2.0, end_m=2.9, sill_m=0.0, head_m=2.0)
ROOM = RoomModel(
    source="given",
    floor=((-2.0, -2.0), (2.0, -2.0), (2.0, 3.0), (-2.0, 3.0)),
    camera_height_m=1.6,
    ceiling_height_m=2.7,
    openings=(DOOR,),
)
MAPS = surface_maps(ROOM, SPHERE)
BACK = FIRST_WALL + 2


@pytest.fixture(scope="module")
def kept() -> Emptying:
    """An empty room with boards on the floor and white skirting, of which furniture before the back wall was filled."""
    way = np.arctan2(*np.meshgrid(np.arange(2 * ROWS), np.arange(ROWS))) * 0
    latitude = (0.5 - (np.arange(ROWS) + 0.5) / ROWS)[:, None] * math.pi + way
    longitude = ((np.arange(2 * ROWS) + 0.5) / (2 * ROWS) - 0.5)[None] * 2 * math.pi + way
    x = MAPS.depth_m * np.cos(latitude) * np.sin(longitude)
    height_m = 1.6 + MAPS.depth_m * np.sin(latitude)
    light = np.where(MAPS.plane == FLOOR, np.where(x % 0.2 < 0.02, 15.0, 25.0), 60.0)
    light = np.where((MAPS.plane >= FIRST_WALL) & (height_m < 0.1) & (MAPS.opening < 0), 95.0, light)
    light *= 1 + 0.01 * np.random.default_rng(2).standard_normal(light.shape)
    rgb = np.repeat(light[..., None], 3, axis=2).astype(np.float32)
    target = np.zeros(light.shape, bool)
    target[250:345, 460:570] = True
    nothing = np.zeros((len(SceneClass), 64, 128), np.float32)
    nothing[SceneClass.WALL] = 1
    return Emptying(rgb, rgb, target, ROOM, SceneEvidence(nothing, "painted"))


def test_a_room_without_faults_has_none(kept: Emptying) -> None:
    found = checked(kept)
    assert found["rests"] < 0.01
    assert found["planes"] == 2
    assert found["skirting_walls"] == 1
    for fault in ("two_tone_planes", "seam_planes", "halved_doors", "skirting_lost"):
        assert found[fault] == 0, fault
    assert found["floor_turned_deg"] < 5


@pytest.mark.long
def test_each_fault_is_counted_by_its_own_rule(kept: Emptying) -> None:
    tone = np.where(kept.target[..., None] & (MAPS.plane == BACK)[..., None], 0.6 * kept.after, kept.after)
    assert checked(replace(kept, after=tone))["two_tone_planes"] == 1
    wall = kept.target & (MAPS.plane == BACK)
    rim = grown(wall, math.radians(0.4)) & grown(~wall, math.radians(0.4)) & (MAPS.plane == BACK)
    line = np.where(rim[..., None], 0.8 * kept.after, kept.after)
    found = checked(replace(kept, after=line))
    assert found["seam_planes"] == 1
    assert found["two_tone_planes"] == 0, "tones on either side are alike: only the rim is seen"
    bare = np.where(kept.target[..., None] & (kept.after > 80), np.float32(60), kept.after)
    assert checked(replace(kept, after=bare))["skirting_lost"] == 1
    door = (MAPS.opening == 0) & (np.arange(2 * ROWS) > np.median(np.nonzero(MAPS.opening == 0)[1]))
    assert checked(replace(kept, target=kept.target | door))["halved_doors"] == 1


def test_a_surface_as_busy_as_its_rim_shows_no_seam(kept: Emptying) -> None:
    wall, nothing = MAPS.plane == BACK, np.zeros_like(kept.target)
    noise = np.exp(0.25 * np.random.default_rng(3).standard_normal(kept.target.shape)).astype(np.float32)
    clean, busy = kept.after, kept.after * noise[..., None]
    step = np.where(kept.target[..., None], np.float32(0.85), np.float32(1))
    assert seam_share(clean * step, kept.target, wall, nothing) > SEAM
    assert seam_share(busy * step, kept.target, wall, nothing) < SEAM
    assert seam_share(clean, kept.target, wall, nothing) < 0.2
    assert seam_share(clean, nothing, wall, nothing) is None


def test_skirting_is_judged_wall_by_wall(kept: Emptying) -> None:
    """Two walls' feet are filled, and of one the skirting is gone."""
    target = kept.target.copy()
    target[250:385, 220:300] = True
    gone = np.where((kept.target & (kept.after[..., 0] > 80))[..., None], np.float32(60), kept.after)
    assert skirting_by_wall(kept.before, kept.after, target, ROOM).count((True, True)) == 2
    assert sorted(skirting_by_wall(kept.before, gone, target, ROOM)) == [(True, False), (True, True)]
