"""What goes beside removed furniture: slits, legs, cables, deep shade, shards of walls; and what stays."""

import math

import numpy as np
import pytest

from processing.ground.arrays import Flags, Floats
from processing.ground.seam import grown
from processing.pictures.images import luminance_cd_m2
from processing.removal.furniture import halves_on_walls
from processing.removal.rests import on_ceiling, rests_beside, torn_glare, whole_boards
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import CEILING, FLOOR
from tests.processing.removal.test_whole_things import MAPS, NONE, ROOM, ROWS, box, grey_room, shown

TABLE = box(150, 190, 240, 280)
FLOOR_BESIDE = box(195, 215, 280, 300)
CLASSES = len(SceneClass)


def evidence(**shares: tuple[Flags, float]) -> Floats:
    """Return probabilities (C, H, W): 0, but those that are given by class."""
    found = np.zeros((CLASSES, ROWS, 2 * ROWS), np.float32)
    for name, (where, share) in shares.items():
        found[SceneClass[name], where] = share
    return found


def rests(gone: Flags, probabilities: Floats, light: Floats | None = None, stays: Flags = NONE) -> Flags:
    return rests_beside(gone, probabilities, luminance_cd_m2(grey_room() if light is None else light), MAPS, stays)


def test_bare_floor_beside_furniture_stays() -> None:
    assert not rests(TABLE, evidence()).any()


def test_floor_that_the_network_half_takes_for_a_thing_goes_where_it_touches() -> None:
    cable, far = box(186, 200, 280, 300), box(186, 200, 330, 350)
    found = rests(TABLE, evidence(FURNITURE=(cable, 0.25), FIXTURE=(cable | far, 0.2)))
    assert found[cable].all()
    assert not found[~cable].any()
    assert not rests(TABLE, evidence(FURNITURE=(cable, 0.35))).any()


def test_nothing_on_walls_goes_for_being_half_a_thing() -> None:
    shelf = box(120, 135, 280, 300)
    assert not (MAPS.plane[shelf] == FLOOR).any()
    assert not rests(TABLE, evidence(FURNITURE=(shelf, 0.45))).any()


def test_what_stays_bars_the_floor_beside_it() -> None:
    cable, stays = box(186, 200, 280, 300), box(186, 200, 300, 320)
    found = rests(TABLE, evidence(FURNITURE=(cable, 0.45)), stays=stays)
    assert found[box(186, 200, 280, 297)].all()
    assert not found[box(186, 200, 299, 320)].any()


def test_a_large_part_of_the_floor_goes_in_deep_shade_and_stays_where_it_looks_like_floor() -> None:
    hall = box(180, 220, 280, 360) & (MAPS.plane == FLOOR)
    unsure = evidence(FURNITURE=(hall, 0.45))
    assert not rests(TABLE, unsure).any()
    shaded = grey_room()
    shaded[hall] *= 0.3
    assert rests(TABLE, unsure, shaded)[hall].all()
    littered = grey_room()
    littered[hall] *= np.random.default_rng(3).choice([0.4, 1.0, 2.5], hall.sum())[:, None].astype(np.float32)
    assert rests(TABLE, unsure, littered)[hall].all(), "floor does not vary so"


def test_a_small_shard_of_a_wall_on_the_floor_goes_and_a_wall_that_the_room_has_not_stays() -> None:
    shard, wall = box(186, 190, 280, 285), box(186, 196, 280, 300)
    assert rests(TABLE, evidence(WALL=(shard, 0.9)))[shard].all()
    assert not rests(TABLE, evidence(WALL=(wall, 0.9)))[wall].any()


def test_skirting_that_is_seen_on_the_floor_goes_mostly_or_stays() -> None:
    """The room's wall stands too far away: its skirting, dark wood, is seen before it. Half of it would be jagged."""
    light, board = grey_room(), box(180, 190, 240, 340)
    light[board] = (0.2, 0.08, 0.02)
    seen, most, less = (box(*rows, 245, 335) for rows in ((182, 186), (180, 187), (186, 188)))
    assert not whole_boards(less, NONE, seen, shown(light)).any()
    assert not whole_boards(less, NONE, NONE, shown(light))[~less].any(), "no skirting: as it is"
    assert whole_boards(less, NONE, NONE, shown(light))[less].all()
    for goes, gone in ((most, NONE), (NONE, most)):
        found = whole_boards(goes, gone, seen, shown(light))
        assert (found | gone)[box(180, 188, 247, 333)].all()
        assert not found[~board].any()


def test_slits_between_what_goes_go_and_frames_between_them_stay() -> None:
    both = box(120, 190, 240, 280) | box(120, 190, 282, 320)
    slit, gap = box(125, 185, 280, 282), box(120, 190, 240, 280) | box(120, 190, 290, 320)
    assert rests(both, evidence())[slit].all()
    assert rests(both, evidence(), stays=slit)[slit].all(), "as narrow as the slit itself"
    assert not rests(both, evidence(), stays=box(100, 200, 276, 284))[slit].any()
    assert not rests(gap, evidence()).any()


def test_legs_below_a_chair_go_and_what_is_no_leg_stays() -> None:
    seat = box(170, 180, 240, 262)
    leg, joint, shadow = box(180, 187, 242, 244), box(180, 187, 250, 252), box(180, 188, 255, 262)
    light = grey_room()
    light[leg] *= 0.6
    light[joint] *= 0.88  # between two boards
    light[shadow] *= 0.6  # as wide as it is high
    found = rests(seat, evidence(), light)
    assert found[leg].all()
    assert not found[joint | shadow].any()
    apart = grey_room()
    apart[box(184, 191, 242, 244)] *= 0.6
    assert not rests(seat, evidence(), apart).any(), "it does not reach the chair"


def test_ends_nothing_gone_all_gone_black_not_finite_and_the_sun() -> None:
    unsure = evidence(FURNITURE=(MAPS.plane == FLOOR, 0.45))
    assert not rests(NONE, unsure).any()
    assert not rests(~NONE, unsure).any()
    assert rests(TABLE, unsure, np.zeros((ROWS, 2 * ROWS, 3), np.float32))[FLOOR_BESIDE].all()
    for value in (np.nan, np.inf, 1.6e9):
        assert not rests(TABLE, evidence(), np.full((ROWS, 2 * ROWS, 3), value, np.float32)).any()
    cable, holes = box(186, 200, 280, 300), grey_room()
    holes[186:190, 280:285], holes[190:195, 285:290] = np.inf, np.nan
    assert rests(TABLE, evidence(FURNITURE=(cable, 0.45)), holes)[cable].all()


def test_a_windows_reflection_that_furniture_cuts_goes_whole() -> None:
    wood, floor = np.array((0.4, 0.2, 0.1), np.float32), MAPS.plane == FLOOR
    cut, whole = box(200, 214, 280, 300), box(200, 214, 340, 360)
    gone = box(190, 230, 240, 280) | box(214, 230, 240, 320) | box(190, 200, 240, 300)
    light = np.broadcast_to(wood, (ROWS, 2 * ROWS, 3)) * np.float32(1)
    light[cut | whole] = (0.8, 0.9, 1.2)
    found = torn_glare(gone, light, floor & ~gone)
    assert found[cut].mean() > 0.95
    assert not found[whole].any(), "nothing hides a part of it"
    assert not found[~np.roll(cut, 3, axis=1) & ~np.roll(cut, -3, axis=1) & ~box(196, 218, 276, 304)].any()
    light[cut] = 4 * wood
    assert not torn_glare(gone, light, floor & ~gone).any(), "a lighter board"
    light[cut] = (0.1, 0.11, 0.14)
    assert not torn_glare(gone, light, floor & ~gone).any(), "shade"
    light[np.isfinite(light)] = np.nan
    assert not torn_glare(gone, light, floor & ~gone).any()
    assert not torn_glare(gone, light, NONE).any()


def test_a_ceiling_is_bare_without_lamp_joints_or_detector_whatever_its_light() -> None:
    rows, columns = np.indices((ROWS, 2 * ROWS))
    light = grey_room() * np.exp(0.8 * np.cos(columns / ROWS * np.pi) * np.sin(rows / ROWS * np.pi))[..., None]
    assert on_ceiling(ROOM, light.astype(np.float32)) == []
    lamp = light.copy()
    lamp[40:48, 250:262] *= 0.6
    assert (MAPS.plane[40:48, 250:262] == CEILING).all()
    found = on_ceiling(ROOM, lamp.astype(np.float32))
    assert found is not None
    ((x, y),) = found
    columns_rad, lowest_rad = (np.array([250, 262]) / ROWS - 1) * np.pi, (0.5 - 40 / ROWS) * np.pi
    high_m = ROOM.ceiling_height_m - ROOM.camera_height_m
    assert columns_rad[0] < np.arctan2(x, y) < columns_rad[1]
    assert np.hypot(x, y) == pytest.approx(high_m / np.tan(lowest_rad), abs=0.06)
    cornice = light.copy()
    cornice[(MAPS.plane == CEILING) & grown(MAPS.plane != CEILING, 0.04)] *= 0.6
    assert on_ceiling(ROOM, cornice.astype(np.float32)) == []


@pytest.mark.parametrize(("cut", "goes"), [(0.7, True), (0.3, False)])
def test_the_rest_of_a_small_thing_on_a_wall_goes_with_most_of_it(cut: float, goes: bool) -> None:
    """A bracket below a shelf: of what is mostly seen, nobody says that it goes."""
    picture = np.full((512, 1024, 3), 200, np.uint8)
    bracket, gone = np.zeros((2, 512, 1024), bool)
    bracket[210:240, 300:306] = True
    picture[bracket] = (150, 90, 40)
    gone[190 : 210 + round(30 * cut), 250:360] = True
    tip, none = bracket & ~gone, np.zeros_like(gone)
    found = halves_on_walls(gone, picture, none)
    assert found[tip].mean() == pytest.approx(float(goes), abs=0.2)
    assert not found[~grown(bracket, math.radians(2))].any(), "the wall stays"
    assert not (halves_on_walls(gone, picture, bracket) & bracket).any(), "what stays, stays"
