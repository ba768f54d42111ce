"""What belongs together goes together: things on furniture, its shade on walls; skirting is the room's and stays."""

from __future__ import annotations

import math

import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import Opening, OpeningKind
from processing.removal.furniture import FurnitureFound, find_furniture, without_skirting
from processing.removal.masks import CRUMB_SR, _at, _rests, _with_things, with_islands
from processing.removal.plane_fill import _opening, _seen_of_frame, fill_plane, hanging
from processing.removal.rests import crumbs_on_walls, with_things
from processing.removal.shadows import find_plain_shade, unglowed
from processing.removal.skirting import boards_between, torn_boards
from processing.segmentation.evidence import SceneClass
from processing.sphere import Equirectangular
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR, planes_of, surface_maps
from processing.surfaces.textures import Texture, opening_regions
from tests.processing.removal.painted_room import box_room

ROWS = 256
GEOMETRY = Equirectangular(2 * ROWS, ROWS)
ROOM = box_room(window=False)
MAPS = surface_maps(ROOM, GEOMETRY)
NONE = np.zeros((ROWS, 2 * ROWS), bool)


def box(top: int, bottom: int, left: int, right: int) -> Flags:
    found = NONE.copy()
    found[top:bottom, left:right] = True
    return found


def grey_room() -> Floats:
    light = np.full((ROWS, 2 * ROWS, 3), 0.6, np.float32)
    light[MAPS.plane == FLOOR] = 0.25
    return light * np.linspace(1.2, 0.8, ROWS, dtype=np.float32)[:, None, None]


def shown(light: Floats) -> np.ndarray:
    return (255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def test_a_lamp_on_a_table_goes_with_it_and_a_picture_apart_stays() -> None:
    table, lamp, picture = box(150, 175, 240, 280), box(128, 150, 256, 264), box(90, 110, 300, 330)
    light = grey_room()
    light[table], light[lamp], light[picture] = 0.1, (0.9, 0.5, 0.05), (0.05, 0.3, 0.6)
    found = with_things(table, shown(light), MAPS.plane == FLOOR, MAPS.plane == CEILING, NONE)
    assert found[lamp].all()
    assert not found[picture].any()
    assert (found & ~(table | lamp)).sum() < 0.02 * table.sum(), "the wall around stays"
    assert not (with_things(table, shown(light), NONE, lamp, NONE) & ~table).any(), "what is barred stays"


def test_a_pile_of_books_on_the_floor_goes_and_shade_and_patterns_stay() -> None:
    light, floor = grey_room(), MAPS.plane == FLOOR
    pages, cover, shade = box(190, 196, 100, 112), box(186, 190, 100, 112), box(190, 198, 400, 414)
    light[pages], light[cover] = 0.7, (0.05, 0.06, 0.1)
    light[shade] *= 0.4
    found = with_things(NONE, shown(light), floor, NONE, floor)
    assert found[pages].all()
    assert found[cover].mean() > 0.9, "its dark side too"
    assert not found[shade].any()
    assert not with_things(NONE, shown(light), floor, NONE, NONE).any(), "nothing speaks for a thing there"
    for column in range(0, 512, 32):
        light[box(200, 206, column, column + 12)] = 0.7
    assert not with_things(NONE, shown(light), floor, NONE, floor).any(), "so many are a pattern"


def test_the_rest_of_a_long_board_goes_where_most_of_it_goes() -> None:
    """White skirting on a brown floor, seen too low: of a board longer than any thing a sliver would stay."""
    light, board = grey_room(), box(180, 186, 200, 300)
    light[MAPS.plane == FLOOR], light[board] = (0.12, 0.06, 0.02), 0.7
    sliver = box(184, 186, 240, 256)
    found = with_things(board & ~sliver, shown(light), MAPS.plane == FLOOR, NONE)
    assert found[sliver].all()
    assert (found & ~board).sum() < 0.02 * board.sum()
    long = box(184, 186, 200, 300)
    assert not (with_things(board & ~long, shown(light), MAPS.plane == FLOOR, NONE) & long).any(), "it is no sliver"


def test_an_enlarged_mask_has_no_steps_and_keeps_its_lines() -> None:
    rows, columns = np.mgrid[:64, :128]
    slope = rows > 20 + 0.18 * columns
    fine_rows, fine_columns = (np.mgrid[:512, :1024] + 0.5) / 8 - 0.5
    off = _at(slope, (512, 1024)) ^ (fine_rows > 20 + 0.18 * fine_columns)
    inner = np.s_[:, 80:-80]
    assert off[inner].sum(axis=0).mean() < 2.6, "eighths of a pixel"
    line = np.zeros((64, 128), bool)
    line[30] = True
    assert _at(line, (512, 1024))[:, 100].sum() >= 4


def test_a_rug_that_furniture_stands_on_goes_whole_and_an_island_stays() -> None:
    bed, rug, island, far = (
        box(150, 190, 240, 280),
        box(185, 215, 270, 330),
        box(180, 215, 200, 242),
        box(190, 215, 30, 60),
    )
    floor = MAPS.plane == FLOOR
    assert all(floor[part].all() for part in (rug, island, far))
    found = FurnitureFound(bed, bed.astype(np.float32), np.zeros_like(bed), 0, 0.0)
    whole = _with_things(found, shown(grey_room()), MAPS, NONE, (rug | island | far, NONE), floor & ~island)[0].mask
    assert whole[rug].all()
    assert not (whole & island & ~bed).any(), "it stands higher than the floor"
    assert not whole[far].any(), "nothing stands on it"


def test_a_picture_on_a_chest_goes_whole_and_a_mirror_or_a_curtain_beside_stays() -> None:
    chest, picture, mirror = box(150, 175, 240, 280), box(130, 148, 250, 262), box(100, 148, 276, 300)
    found = FurnitureFound(chest, chest.astype(np.float32), np.zeros_like(chest), 0, 0.0)
    whole = _with_things(found, shown(grey_room()), MAPS, NONE, (picture | mirror, NONE), NONE)[0].mask
    assert whole[picture].all()
    assert not (whole & mirror).any(), "most of its lower edge hangs free"
    beside = _with_things(found, shown(grey_room()), MAPS, box(120, 170, 262, 300), (picture, NONE), NONE)[0].mask
    assert not (beside & picture).any(), "what hangs at a window is its curtain"


def test_a_large_mirror_that_furniture_touches_stays() -> None:
    chest, mirror = box(150, 175, 240, 280), box(60, 151, 200, 330)
    light = grey_room()
    light[box(130, 151, 250, 262)] = (0.05, 0.05, 0.6)  # what it shows
    found = FurnitureFound(chest, chest.astype(np.float32), np.zeros_like(chest), 0, 0.0)
    whole = _with_things(found, shown(light), MAPS, NONE, (mirror & ~chest, mirror.astype(np.float32)), NONE)[0].mask
    assert not (whole & mirror & ~chest).any()


def test_what_is_large_is_the_building_and_stays() -> None:
    table, pillar = box(150, 175, 240, 280), box(80, 150, 256, 270)
    light = grey_room()
    light[table], light[pillar] = 0.1, (0.7, 0.05, 0.05)
    assert not (with_things(table, shown(light), NONE, NONE, NONE) & pillar).any()


def test_skirting_along_a_wall_is_no_furniture_and_a_chair_before_it_is() -> None:
    foot = ROWS - (MAPS.plane == FLOOR).sum(axis=0)
    rows = np.arange(ROWS)[:, None]
    strip = (rows >= foot - 5) & (rows <= foot)
    chair = box(int(foot[256]) - 30, int(foot[256]) + 12, 250, 262)
    found = without_skirting(strip | chair, MAPS)
    assert found[chair].all()
    assert found[strip & ~chair].mean() < 0.03
    crate = strip & (np.abs(np.arange(2 * ROWS) - 256) < 2)[None]
    assert without_skirting(crate, MAPS)[crate].all(), "too short for skirting"


def test_soft_shade_beside_furniture_is_replaced() -> None:
    chest = box(140, 176, 240, 280)
    light, columns = grey_room(), np.arange(2 * ROWS, dtype=np.float32)[None]
    away = np.maximum(np.maximum(240 - columns, columns - 279), 0)
    fall = 1 - 0.3 * np.exp(-away / 10)
    wall = (MAPS.plane != FLOOR) & (MAPS.plane != CEILING)
    rows = np.arange(ROWS)[:, None]
    band = wall & (rows > 120) & (rows < 160)
    light = np.where(band[..., None], light * fall[..., None], light).astype(np.float32)
    found, hangs = find_plain_shade(light, ROOM, GEOMETRY, chest, NONE)
    assert not (found & ~wall).any()
    near = band & (away > 0) & (away < 5) & (rows > 135) & (rows < 150)
    far = wall & (away > 60)
    assert found[near].mean() > 0.8
    assert not (hangs & near).any()
    assert not found[far].any()
    assert not np.any(find_plain_shade(light, ROOM, GEOMETRY, chest, wall & ~chest)), "openings and fixtures stay"
    assert not np.any(find_plain_shade(light, ROOM, GEOMETRY, NONE, NONE))


def test_a_picture_that_furniture_comes_near_to_hangs_by_itself_and_a_rest_of_furniture_does_not() -> None:
    chest, picture, rest = box(140, 176, 240, 280), box(105, 139, 245, 275), box(150, 158, 281, 286)
    light = grey_room()
    light[chest], light[picture], light[rest] = 0.1, (0.1, 0.3, 0.5), (0.5, 0.1, 0.1)
    found, hangs = find_plain_shade(light, ROOM, GEOMETRY, chest, NONE)
    assert hangs[box(107, 137, 247, 273)].all()
    assert not (found & hangs).any()
    assert not found[picture].any()
    assert found[rest].mean() > 0.7


def test_what_masks_miss_on_a_plain_floor_is_replaced_and_boards_are_kept() -> None:
    stool, leg, far = box(176, 200, 240, 280), box(200, 204, 244, 247), box(215, 220, 400, 405)
    light, floor = grey_room(), MAPS.plane == FLOOR
    boards = floor & (np.arange(2 * ROWS)[None] // 8 % 2 == 0)
    cable = box(202, 204, 272, 360)
    light[leg | far | cable] = (0.02, 0.02, 0.05)
    found, _ = find_plain_shade(light, ROOM, GEOMETRY, stool, NONE)
    assert found[leg].all()
    assert not found[far | cable].any(), "what is apart, or runs on, is no part of it"
    assert (found & floor).sum() < 4 * leg.sum()
    light[boards] *= 0.6
    assert not (find_plain_shade(light, ROOM, GEOMETRY, stool, NONE)[0] & floor).any()


def test_a_patterned_wall_has_no_shade_to_find() -> None:
    chest, light = box(140, 176, 240, 280), grey_room()
    checks = (np.arange(ROWS)[:, None] // 6 + np.arange(2 * ROWS)[None] // 6) % 2 == 0
    light[checks & ~chest] *= 0.5
    assert not np.any(find_plain_shade(light, ROOM, GEOMETRY, chest, NONE))


def test_a_door_of_a_strange_colour_stays_and_a_wardrobe_with_doors_goes() -> None:
    door, wardrobe = box(100, 150, 230, 250), box(100, 160, 300, 330)
    light = grey_room()
    light[door | wardrobe] = (0.25, 0.06, 0.02)
    probabilities = np.zeros((len(SceneClass), *NONE.shape), np.float32)
    probabilities[SceneClass.WALL], probabilities[SceneClass.FLOOR] = MAPS.plane != FLOOR, MAPS.plane == FLOOR
    probabilities[:, door | wardrobe] = 0
    for where, furniture in ((door, 0.2), (wardrobe, 0.45)):
        probabilities[SceneClass.DOOR, where] = 1 - furniture
        probabilities[SceneClass.FURNITURE, where] = furniture
    found = find_furniture(probabilities, MAPS, shown(light), whole=True).mask
    assert not (found & door).any()
    assert found[wardrobe].mean() > 0.9


def test_a_windows_frame_of_a_wardrobes_colour_stays_where_little_speaks_for_furniture() -> None:
    pane, wardrobe = box(100, 140, 300, 340), box(95, 200, 352, 400)
    frame = box(96, 146, 296, 352) & ~pane
    light = grey_room()
    light[wardrobe | frame], light[pane] = (0.3, 0.22, 0.15), 0.95
    for likely_frame, goes in ((0.25, False), (0.45, True)):
        probabilities = np.zeros((len(SceneClass), *NONE.shape), np.float32)
        probabilities[SceneClass.WALL], probabilities[SceneClass.FLOOR] = MAPS.plane != FLOOR, MAPS.plane == FLOOR
        kinds = ((pane, SceneClass.WINDOW, 0.95), (wardrobe, SceneClass.FURNITURE, 0.97))
        for where, kind, likely in (*kinds, (frame, SceneClass.FURNITURE, likely_frame)):
            probabilities[:, where] = 0
            probabilities[SceneClass.WALL, where], probabilities[kind, where] = 1 - likely, likely
        found = find_furniture(probabilities, MAPS, shown(light)).mask
        assert found[wardrobe].all()
        assert abs(found[frame].mean() - goes) < 0.1


def test_glow_of_a_lamp_that_goes_is_taken_off_the_wall_and_that_of_one_that_stays_is_kept() -> None:
    glow = np.hypot(*np.meshgrid(np.arange(2 * ROWS) - 260, np.arange(ROWS) - 110))
    lamp, light = glow < 5, np.full((ROWS, 2 * ROWS, 3), 0.5, np.float32)
    light *= 1 + 1.5 * np.exp(-((glow / 14) ** 2))[..., None]
    light[lamp] = 8
    wall = MAPS.plane == MAPS.plane[110, 260]
    around = wall & (glow > 7) & (glow < 10)
    gone = unglowed(light, lamp, NONE, ROOM)
    assert np.median((light * gone)[around]) < 0.6 < 0.9 < np.median(light[around])
    assert np.all(gone[wall & (glow > 60)] > 0.97)
    assert np.all(unglowed(light, NONE, lamp, ROOM) == 1), "it stays, and so does its light"
    assert np.allclose(gone[lamp], np.median(gone[wall & (glow > 5) & (glow < 7)], axis=0), atol=0.1), "no seam"
    half = np.indices(lamp.shape)[1] > 274
    lit = np.where(half & wall & (glow < 18), np.float32(8), 0)[..., None] + light
    off = unglowed(lit, lamp, half & (glow < 16) & (np.indices(lamp.shape)[0] < 104), ROOM)
    assert np.median(off[half & (glow < 18)]) < 0.5, (
        "a wall that it lights, a part of it a thing, is no lamp that stays"
    )


def test_a_sill_goes_on_level_and_what_is_below_it_is_wall() -> None:
    region, hole = np.zeros((2, 100, 160), bool)
    region[20:80, 20:140] = True  # at 100 px/m: a pane of 44 rows, and 8 rows of frame above and below
    hole[66:, 60:90] = True  # a vase before it
    seen = np.full((100, 160, 3), 0.4, np.float32)
    seen[28:72, 28:132], seen[72:75, 20:140] = 2.0, 0.8
    done = _opening(np.where(hole[..., None], 0, seen).astype(np.float32), region & ~hole, hole & region, region, 100.0)
    np.testing.assert_allclose(done[region], seen[region], rtol=0.02)
    hidden = hole | (region & (np.arange(100) >= 70)[:, None])
    done = _opening(
        np.where(hidden[..., None], 0, seen).astype(np.float32), region & ~hidden, hole & region, region, 100.0
    )
    np.testing.assert_allclose(done[72:80, 60:90], 2.0, rtol=0.02, err_msg="what is above a hidden rail goes on")


def test_below_a_pane_whose_sill_is_hidden_the_wall_goes_on() -> None:
    region, known = np.zeros((2, 100, 160), bool)
    region[20:80, 20:140] = known[:76, :60] = True  # at 100 px/m: 8 rows of sill, of which four are seen in a third
    dense = known.astype(np.float32)
    values = np.repeat(np.where(region, 1.0, 0.4).astype(np.float32)[..., None], 3, axis=2)
    texture = Texture(planes_of(ROOM)[FIRST_WALL], 100.0, values, known, dense)
    found = _seen_of_frame(region, known, texture)
    assert np.array_equal(found[:76], region[:76])
    assert not found[76:].any()
    door = region | (np.arange(100) >= 80)[:, None] & region[50]
    assert np.array_equal(_seen_of_frame(door, known, texture), door), "it has no sill"


def test_a_window_whose_lower_frame_a_mask_cuts_raggedly_keeps_its_frame_and_nothing_beside_it() -> None:
    """The frame lies 5 cm within the region of the opening; the mask takes its lower edge, and its right end."""
    region, hole = np.zeros((2, 140, 200), bool)
    region[20:100, 30:170] = True  # at 100 px/m: 8 rows and columns of what may be its frame
    seen = np.full((140, 200, 3), 0.4, np.float32)
    seen[25:88, 35:165] = 0.9
    seen[29:84, 39:161] = np.linspace(2, 20, 122)[:, None]  # a view, dark to bright
    hole[86 + np.arange(200) % 2, np.arange(200)] = hole[88:] = hole[:, 168:] = hole[70:, 120:] = True
    known, texels = ~hole, np.where(hole[..., None], 0, seen).astype(np.float32)
    texture = Texture(planes_of(ROOM)[FIRST_WALL], 100.0, texels, known, known * 1.0)
    found = _seen_of_frame(region, known, texture)
    assert np.flatnonzero(found.any(axis=0)).tolist() == list(range(35, 165)), "beside it is wall, on both sides"
    assert np.flatnonzero(found.any(axis=1))[-1] == 91, "the opening's own lower edge"
    done = _opening(texels, known & found, hole & found, found, 100.0)
    np.testing.assert_allclose(done[84:92, 35:165], 0.9, rtol=0.02, err_msg="the rail goes on, in its own colour")
    np.testing.assert_allclose(done[found].min(), 0.9, rtol=0.02, err_msg="no wall in it")
    np.testing.assert_allclose(done[70:84, 121:160], np.broadcast_to(seen[69, 121:160], (14, 39, 3)), rtol=0.05)


def test_a_wall_that_gets_brighter_towards_a_pane_is_no_frame() -> None:
    region, known = np.zeros((100, 160), bool), np.ones((100, 160), bool)
    region[20:80, 20:140] = True  # at 100 px/m: its frame begins 6 columns within it
    known[:, 120:] = False  # a wardrobe before its end
    wall = 0.4 * np.exp(0.15 * np.clip((np.arange(160) - 12) / 14, 0, 1))  # as bright as half an edge, over 14 cm
    values = np.repeat(np.where(region & (np.abs(np.arange(160) - 79.5) < 54), 1.0, wall)[..., None], 3, axis=2)
    texture = Texture(planes_of(ROOM)[FIRST_WALL], 100.0, values.astype(np.float32), known, known * 1.0)
    found = _seen_of_frame(region, known, texture)
    assert np.flatnonzero(found.any(axis=0)).tolist() == list(range(26, 134)), "the hidden side is as wide"


def test_an_opening_narrower_than_a_texel_is_wall() -> None:
    """A texture of a far wall may have no texel whose middle lies in it."""
    slit = Opening(kind=OpeningKind.WINDOW, wall=0, start_m=1.45, end_m=1.5, sill_m=1.0, head_m=1.05)
    room = ROOM.model_copy(update={"openings": (slit,)})
    plane, hole = planes_of(room)[FIRST_WALL], np.zeros((6, 9), bool)
    hole[3:, 3:6] = True
    values = np.where(hole[..., None], 0, np.ones((6, 9, 3))).astype(np.float32)
    texture = Texture(plane, 2.0, values, ~hole, np.ones(hole.shape, np.float32))
    assert not next(opening_regions(plane, room, hole.shape, 2.0)).any()
    nothing = np.zeros_like(hole)
    done = fill_plane(texture, hole, (nothing, nothing), room, np.ones(3, np.float32))
    np.testing.assert_allclose(done.values, 1, rtol=0.02)


def test_a_hidden_side_of_a_frame_is_as_the_other() -> None:
    region = np.zeros((100, 160), bool)
    region[20:80, 20:140] = True  # at 100 px/m: 8 columns of casing to either side, then 6 of the sash
    seen = np.full((100, 160, 3), 0.4, np.float32)
    seen[28:72, 28:132] = 0.8
    seen[34:66, 34:126] = 20.0
    hole = np.zeros_like(region)
    hole[30:, 118:] = True  # a wardrobe before its end
    known = region & ~hole
    done = _opening(np.where(hole[..., None], 0, seen).astype(np.float32), known, hole & region, region, 100.0)
    np.testing.assert_allclose(done[34:66, 124:140], seen[34:66, 20:36][:, ::-1], rtol=0.05)
    assert (done[34:66, 118:124] > 10).all(), "glass up to there"
    # What is seen at the other side through the glass is not seen twice.
    seen[34:66, 34:37] = (12.0, 60.0, 12.0)
    done = _opening(np.where(hole[..., None], 0, seen).astype(np.float32), known, hole & region, region, 100.0)
    np.testing.assert_allclose(done[34:66, 118:126], 20.0, rtol=0.05)
    np.testing.assert_allclose(done[34:66, 126:140], seen[34:66, 20:34][:, ::-1], rtol=0.05)


def test_a_half_hidden_doorway_beside_an_open_leaf_stays_dark() -> None:
    region = np.zeros((200, 160), bool)
    region[10:, 30:130] = True
    seen = np.full((200, 160, 3), 0.5, np.float32)  # the wall, and the leaf's tone
    seen[10:, 30:80] = 0.02
    hole = np.zeros_like(region)
    hole[80:, 20:70] = True  # a plant
    done = _opening(np.where(hole[..., None], 0, seen), region & ~hole, hole & region, region, 100.0)
    np.testing.assert_allclose(done[80:, 30:70], 0.02, rtol=0.1)


def test_beside_a_pane_whose_sides_are_hidden_the_wall_goes_on() -> None:
    region, known = np.zeros((2, 100, 160), bool)
    region[20:80, 20:140] = known[20:80, 40:100] = True
    texture = Texture(planes_of(ROOM)[FIRST_WALL], 100.0, np.zeros((100, 160, 3), np.float32), known, known * 1.0)
    found = _seen_of_frame(region, known, texture)
    assert np.array_equal(np.flatnonzero(found.any(axis=0)), np.arange(28, 132))
    known[20:80, 20:40] = True
    found = _seen_of_frame(region, known, texture)
    assert np.array_equal(found, region), "one side is seen, the other is like it"


def test_a_curtain_goes_on_as_it_hangs() -> None:
    folds = np.linspace(0.2, 0.9, 40, dtype=np.float32)
    curtain = np.broadcast_to(folds[None, :, None], (60, 40, 3)).copy()
    hole = np.zeros((60, 40), bool)
    hole[35:, 5:30] = hole[10:, 20] = True
    done = hanging(np.where(hole[..., None], 0, curtain).astype(np.float32), ~hole, hole, 40.0)
    np.testing.assert_allclose(done, curtain, rtol=0.02)
    np.testing.assert_array_equal(done[~hole], curtain[~hole])
    # It is darker from its middle on, and has a hem; a quarter of its width is seen down there.
    rows = np.arange(60)
    curtain *= np.where(rows > 56, 0.3, 1 - 0.01 * np.maximum(rows - 30, 0)).astype(np.float32)[:, None, None]
    hole[35:, 5:35] = True
    done = hanging(np.where(hole[..., None], 0, curtain).astype(np.float32), ~hole, hole, 40.0)
    np.testing.assert_allclose(done, curtain, rtol=0.05)


def test_what_hangs_does_not_go_on_as_the_rim_of_what_hid_it() -> None:
    """A mask ends a few centimetres too low: the sofa's edge is still seen there."""
    folds = np.where(np.arange(40) % 8 < 4, np.float32(0.6), np.float32(0.3))
    curtain = np.broadcast_to(folds[:, None], (120, 40, 3)).astype(np.float32)
    hole = np.zeros((120, 40), bool)
    hole[60:] = True
    seen = np.where(hole[..., None], 0, curtain).astype(np.float32)
    seen[57:60] = (0.05, 0.25, 0.1)
    done = hanging(seen, ~hole, hole, 100.0, even=True, strip_m=0.05)
    np.testing.assert_allclose(done[hole], curtain[hole], rtol=0.02)
    np.testing.assert_array_equal(done[~hole], seen[~hole])


def test_a_piece_of_skirting_that_stands_on_furniture_goes_and_one_on_the_floor_stays() -> None:
    boards, bed = np.zeros((2, 180, 360), bool)
    boards[110:114, 40:80] = boards[110:114, 140:240] = True
    bed[116:150, 30:160] = True
    found = torn_boards(boards, bed, math.radians(2.5))
    assert found[110:114, 40:80].all()
    assert not found[:, 120:].any(), "a fifth of its foot is hidden"
    assert not torn_boards(boards, np.roll(bed, -60, axis=0), math.radians(2.5)).any(), "what hangs above hides none"


def test_a_short_piece_of_skirting_between_removed_things_goes() -> None:
    boards, chests = np.zeros((2, 180, 360), bool)
    boards[110:114, 100:120] = boards[110:114, 151:210] = boards[110:114, 350:] = boards[110:114, :20] = True
    chests[90:112, 60:99] = chests[90:112, 121:150] = chests[90:112, 211:230] = chests[90:112, 320:349] = True
    found = boards_between(boards, chests)
    assert found[110:114, 100:120].all()
    assert not found[:, 140:220].any(), "a wall's length shows how skirting looks"
    assert not found[:, :90].any(), "one end is free, and it lies across the seam"
    assert not found[:, 345:].any()


def test_what_touches_the_shade_of_removed_things_goes_and_what_is_apart_stays() -> None:
    table, shade = box(150, 175, 240, 280), box(120, 150, 236, 284)
    bracket, picture = box(108, 120, 256, 264), box(80, 95, 256, 270)
    light = grey_room()
    light[table], light[bracket], light[picture] = 0.1, (0.9, 0.5, 0.05), (0.05, 0.3, 0.6)
    without = _rests(table, NONE, NONE, shown(light), MAPS, NONE)
    whole = _rests(table, shade, NONE, shown(light), MAPS, NONE)
    assert not without[bracket].any()
    assert whole[bracket].all()
    assert not whole[picture].any()
    assert not _rests(table, shade, NONE, shown(light), MAPS, bracket)[bracket].any(), "what stays stays"


def test_crumbs_within_what_is_removed_go_and_a_picture_stays() -> None:
    target = box(60, 200, 100, 400)
    crumb, picture = box(120, 123, 150, 153), box(100, 125, 250, 285)
    found = with_islands(target & ~crumb & ~picture, NONE, CRUMB_SR)
    assert found[crumb].all()
    assert not found[box(102, 123, 252, 283)].any()


def test_crumbs_on_a_wall_near_what_goes_go_and_plates_patterns_and_what_is_far_stay() -> None:
    light, vase = np.full((ROWS, 2 * ROWS, 3), 0.5, np.float32), box(125, 150, 240, 272)
    specks, stem = [box(119, 122, 242, 245), box(128, 131, 274, 277)], NONE.copy()
    plate, far, frame = box(118, 123, 262, 267), box(110, 113, 320, 323), box(130, 133, 234, 237)
    for k in range(7):
        stem[116 + k, 248 + k] = stem[122 - k, 250 + k] = True
    for one in (*specks, plate, far, frame, stem):
        light[one] = (0.2, 0.1, 0.3)
    found = crumbs_on_walls(vase, light, MAPS, frame, NONE)
    assert all(found[one].all() for one in specks)
    assert found[stem].mean() > 0.9, "thin, and larger than a speck"
    assert not found[plate | far | frame].any()
    light[specks[1]] = 0.9
    assert not crumbs_on_walls(vase, light, MAPS, frame, NONE)[specks[1]].any(), "a socket"
    assert not crumbs_on_walls(vase, np.zeros_like(light), MAPS, frame, NONE).any()
    light[200:210, 100:120], light[60, 10] = np.nan, np.inf
    assert crumbs_on_walls(vase, light, MAPS, frame, NONE)[specks[0]].all(), "what the lens did not see changes nothing"
    light[::10, ::10] = 0.05
    light[1::10, ::10] = 0.05
    light[2::10, ::10] = 0.05
    assert not crumbs_on_walls(vase, light, MAPS, frame, NONE).any(), "a pattern"


def test_the_rest_of_a_thing_before_a_wall_that_stays_goes_and_what_is_fitted_there_stays() -> None:
    light, gone, niche = np.full((ROWS, 2 * ROWS, 3), 0.5, np.float32), box(125, 150, 200, 312), box(100, 125, 200, 312)
    leaf, grille, apart = box(121, 125, 250, 257), box(104, 125, 204, 236), box(117, 121, 270, 277)
    for one in (leaf, grille, apart):
        light[one] = (0.1, 0.2, 0.1)
    found = crumbs_on_walls(gone, light, MAPS, NONE, niche)
    assert found[leaf].all()
    assert not found[grille | apart].any(), "larger, and not touching"
    assert not crumbs_on_walls(gone, light, MAPS, NONE, NONE)[leaf].any(), "too large for a crumb of another wall"
