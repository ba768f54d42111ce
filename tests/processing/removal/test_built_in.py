"""What belongs to the building stays beside furniture that goes: below windows, at doors, in openings to other rooms;
what only looks like it does not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from processing.ground.arrays import Flags
from processing.ground.seam import grown, resized, summed
from processing.pictures.preview import preview_rgb8
from processing.removal.furniture import ajar, beyond, doors_in, fitted_below_windows, frames_seen, mostly_seen
from processing.removal.masks import Masks, _next_floor, find_masks
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import FIRST_WALL, FLOOR
from tests.processing.removal.painted_room import Painted, evidence_of, paint


def bare() -> Painted:
    return paint(rows=256, things=False, sun=False)


def none() -> Flags:
    return np.zeros(bare().maps.plane.shape, bool)


def below_pane() -> Flags:
    maps = bare().maps
    pane = maps.opening >= 0
    return np.asarray(np.maximum.accumulate(pane, axis=0) & ~pane & (maps.plane >= FIRST_WALL))


def found_with(furniture: Flags, other: Flags, shares: dict[SceneClass, float], *, networks: int) -> Masks:
    """Return the masks where furniture is seen, and something else, mostly of another colour, with these shares."""
    light = np.where(other[..., None], np.float32((0.9, 0.88, 0.2)), bare().image.rgb)
    light = np.where(furniture[..., None], np.float32((0.05, 0.12, 0.3)), light)
    classes = bare().evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    evidence = evidence_of(np.where(furniture, SceneClass.FURNITURE, classes))
    probabilities = evidence.probabilities.copy()
    small = resized(other.astype(np.float32), probabilities.shape[1:]) > 0.5
    probabilities[:, small] = 0
    for kind, share in shares.items():
        probabilities[kind, small] = share
    evidence = replace(evidence, probabilities=probabilities, networks=networks)
    return find_masks(replace(bare().image, rgb=light), evidence, bare().room, sun_possible=False)


def test_what_has_much_of_the_wall_below_a_window_and_is_hardly_furniture_is_fitted_there() -> None:
    maps, below = bare().maps, below_pane()
    likely = np.full(below.shape, 0.45, np.float32)
    niche = fitted_below_windows(below, likely, maps)
    assert niche[below & ~grown(maps.plane == FLOOR, math.radians(6))].all()
    sides = grown(below, math.radians(3)) & ~below & (maps.plane == maps.plane[below][0]) & (maps.opening < 0)
    sides &= np.maximum.accumulate(below, axis=0).any(axis=1)[:, None] & ~grown(maps.plane == FLOOR, math.radians(8))
    assert niche[sides & ~grown(maps.opening >= 0, math.radians(4))].all(), "a niche is wider than its pane"
    assert not niche[~grown(below, math.radians(6))].any()
    assert not niche[grown(maps.plane == FLOOR, math.radians(3))].any(), "skirting is drawn anew"
    assert not fitted_below_windows(below, likely + np.float32(0.2), maps).any(), "a chair"
    lamp = below.copy()
    lamp[:, np.flatnonzero(below.any(axis=0))[4:]] = False
    assert not fitted_below_windows(lamp, likely, maps).any()
    rack = below & grown(maps.plane == FLOOR, math.radians(6))
    assert not fitted_below_windows(rack, likely, maps).any(), "a low thing, as wide as the window"
    assert not fitted_below_windows(none(), likely, maps).any()


@pytest.mark.parametrize("networks", [1, 2])
def test_a_niche_below_a_window_stays_where_two_networks_are_not_sure_of_it(networks: int) -> None:
    niche = below_pane()
    inner = niche & ~grown(~niche, math.radians(1.5)) & ~grown(bare().maps.plane == FLOOR, math.radians(7))
    shares = {SceneClass.FURNITURE: 0.48, SceneClass.WALL: 0.36, SceneClass.FIXTURE: 0.16}
    found = found_with(none(), niche, shares, networks=networks)
    assert inner.sum() > 200
    assert found.target[inner].mean() == pytest.approx(float(networks == 1), abs=0.05)


def test_the_foot_of_an_open_door_before_the_floor_is_a_door() -> None:
    maps = bare().maps
    foot = none()
    foot[175:185, 250:270] = True
    assert (maps.plane[foot] == FLOOR).all()
    shares = np.zeros((len(SceneClass), *foot.shape), np.float32)
    for kind, share in {SceneClass.DOOR: 0.33, SceneClass.FURNITURE: 0.24, SceneClass.FLOOR: 0.1}.items():
        shares[kind, foot] = share
    np.testing.assert_array_equal(doors_in(shares, maps), foot)
    shares[SceneClass.FLOOR, foot] = 0.4
    assert not doors_in(shares, maps).any(), "floor with a door's reflection"


def test_a_door_that_furniture_has_most_of_is_a_wardrobes_and_specks_are_none() -> None:
    door, other, speck = none(), none(), none()
    door[100:160, 100:130], other[100:160, 300:330], speck[120:122, 200:203] = True, True, True
    wardrobe, sofa = none(), none()
    wardrobe[90:160, 90:128], sofa[140:170, 280:350] = True, True
    np.testing.assert_array_equal(mostly_seen(door | other | speck, wardrobe | sofa), other)


@pytest.mark.parametrize("white", [False, True])
def test_a_frame_seen_beside_a_wardrobe_stays_unless_the_wardrobe_is_as_white(white: bool) -> None:
    """The network's pixels are wider than a frame: it takes the frame for a part of the wardrobe."""
    maps = replace(bare().maps, opening=np.roll(bare().maps.opening, 256, axis=1))  # away from the seam
    pane = maps.opening == 0
    rows, columns = (np.flatnonzero(pane.any(axis=axis)) for axis in (1, 0))
    frame = pane.copy()
    frame[rows[3] : rows[-3], columns[3] : columns[-3]] = False
    wardrobe, mask = none(), none()
    wardrobe[rows[0] - 5 :, columns[-1] + 1 : columns[-1] + 20] = True
    mask[rows[0] - 5 :, columns[-5] : columns[-1] + 20] = True
    shown = np.full((*pane.shape, 3), (150, 130, 110), np.uint8)
    shown[pane], shown[frame], shown[wardrobe] = (110, 160, 230), 235, 235 if white else (70, 50, 40)
    seen = frames_seen(mask, wardrobe, maps, shown)
    assert not seen[~(mask & pane)].any()
    hidden = mask & frame & (np.arange(pane.shape[1]) > columns[-3])
    assert seen[hidden].mean() == pytest.approx(0.0 if white else 1.0, abs=0.3)
    assert not frames_seen(mask | (pane & (np.arange(pane.shape[1]) > columns[5])), wardrobe, maps, shown).any(), (
        "hidden"
    )


@pytest.mark.parametrize("to_floor", [False, True])
def test_the_edge_of_a_sofa_before_curtains_is_no_frame_of_theirs(to_floor: bool) -> None:
    """It has the colours of the curtains in the rest of the pane, not of the cushions beside it."""
    rows, columns = np.arange(256)[:, None], np.arange(512)
    across = (columns > 190) & (columns < 250)
    pane = (rows > 100) & (rows < 150) & across
    if to_floor:
        pane |= (rows >= 150) & (bare().maps.plane >= FIRST_WALL) & across
    maps = replace(bare().maps, opening=np.where(pane, 0, -1).astype(bare().maps.opening.dtype))
    sofa = (rows > (140 if to_floor else 125)) & (rows < 190) & (columns > 210) & (columns < 275)
    shown = np.full((*pane.shape, 3), (150, 130, 110), np.uint8)
    shown[pane], shown[sofa] = (110, 160, 230), (70, 50, 40)
    edge = sofa & pane & grown(~sofa, math.radians(2))
    shown[edge] = (110, 160, 225)
    seen = frames_seen(sofa, sofa, maps, shown)
    middle = (columns > 215) & (columns < 242)
    assert (edge & middle).sum() > 50
    assert not (seen & middle & (rows < 145 if not to_floor else rows > 0)).any()


def test_what_stands_before_the_middle_of_a_pane_is_no_frame_but_a_bar_is() -> None:
    """A table's top that is as bright as the view, and a bar that the network takes for a part of a sofa."""
    maps = replace(bare().maps, opening=np.roll(bare().maps.opening, 256, axis=1))
    pane = maps.opening == 0
    rows, columns = (np.flatnonzero(pane.any(axis=axis)) for axis in (1, 0))
    sofa, top, bar = none(), none(), none()
    sofa[rows[len(rows) // 2] : rows[-1] + 20, columns[-1] + 1 : columns[-1] + 20] = True
    top[rows[len(rows) // 3] :, columns[4] : columns[len(columns) // 2]] = True
    bar[rows[0] : rows[-1], columns[-len(columns) // 3] : columns[-len(columns) // 3] + 2] = True
    shown = np.full((*pane.shape, 3), (150, 130, 110), np.uint8)
    shown[pane], shown[sofa] = (110, 160, 230), (70, 50, 40)
    for thing, stays in ((top & pane, 0.0), (bar & pane, 1.0)):
        assert frames_seen(thing | sofa, sofa, maps, shown)[thing].mean() == stays


@pytest.mark.parametrize(("top", "kept"), [(135, True), (147, False)])
def test_a_low_strip_of_floor_before_a_wall_is_no_next_rooms(top: int, kept: bool) -> None:
    """The wall was estimated too near; a corridor is seen far above the wall's foot."""
    maps, strip = bare().maps, none()
    strip[top:151, 160:240] = True
    strip &= maps.plane >= FIRST_WALL
    shares = np.zeros((len(SceneClass), *strip.shape), np.float32)
    shares[SceneClass.WALL], shares[SceneClass.FLOOR, strip] = 0.9 - 0.6 * strip, 0.6
    assert strip.any()
    assert _next_floor(shares, maps, preview_rgb8(bare().image.rgb))[strip].all() == kept


@pytest.mark.parametrize("networks", [1, 2])
def test_what_is_far_likelier_fixed_than_furniture_stays_where_it_touches_furniture(networks: int) -> None:
    sofa, jamb = none(), none()
    sofa[135:175, 150:200], jamb[108:135, 170:176] = True, True
    found = found_with(
        sofa, jamb, {SceneClass.FIXTURE: 0.45, SceneClass.WALL: 0.5, SceneClass.FURNITURE: 0.05}, networks=networks
    )
    assert found.furniture[140:170, 155:195].all()
    assert found.target[112:126, 171:175].any() == (networks == 1)


def test_solid_angles_by_label() -> None:
    labels = np.zeros((64, 128), np.int32)
    labels[32:] = 1
    size, half = summed(labels, 1, np.arange(128) < 64)
    np.testing.assert_allclose(size, [2 * math.pi] * 2, rtol=1e-9)
    np.testing.assert_allclose(half, [math.pi] * 2, rtol=1e-9)


def test_the_leaf_of_an_open_door_stays_and_the_front_of_a_wardrobe_does_not() -> None:
    """Both have more of a door's probability at a known door than walls have; the wardrobe has a side, too."""
    doors, leaf, chest = none(), none(), none()
    doors[90:170, 200:220], leaf[88:180, 220:250], chest[140:190, 190:199] = True, True, True
    light = bare().image.rgb.copy()
    light[doors], light[leaf], light[chest] = 0.02, (0.2, 0.5, 0.2), (0.1, 0.1, 0.3)
    shown = preview_rgb8(light)
    chances = np.full((8, *leaf.shape), 0.02, np.float32)
    chances[SceneClass.DOOR, doors | leaf], chances[SceneClass.FURNITURE, doors | leaf] = 0.36, 0.46
    chances[SceneClass.FURNITURE, chest] = 0.9
    mask = doors | leaf | chest
    found = ajar(chances, doors, mask, shown)
    assert found[doors | leaf].mean() > 0.95, "but for pixels of mixed colour"
    assert not found[~grown(doors | leaf, math.radians(1))].any(), "neither the wall nor what stands before it"
    assert not ajar(chances, none(), mask, shown).any(), "the room has no door there"
    side = none()
    side[88:180, 180:200] = side[88:180, 250:270] = True
    light[side] = (0.2, 0.35, 0.2)
    assert not ajar(chances, doors, mask | side, preview_rgb8(light)).any()
    chances[SceneClass.DOOR, leaf] = 0.2
    assert not ajar(chances, doors, mask, shown)[leaf & ~grown(doors, math.radians(1))].any(), "furniture is likelier"


@pytest.mark.parametrize(("gap", "goes"), [(9, True), (40, False)])
def test_a_sliver_between_what_goes_goes_though_it_hangs_together_with_a_picture(gap: int, goes: bool) -> None:
    """A banner with a narrow tail between two pieces of furniture: in a slit the tail goes, in a wide gap it stays."""
    bare, rows = paint(rows=512, things=False, sun=False, window=False), np.arange(512)[:, None]
    hangs, furniture = np.zeros((2, 512, 1024), bool)
    middle = 490 + gap // 2
    hangs[150:216, 440:560] = hangs[215:380, middle - 2 : middle + 3] = True
    furniture[250:380, 430:490] = furniture[250:380, 490 + gap : 560 + gap] = True
    light = np.where(hangs[..., None], np.float32((0.9, 0.3, 0.05)), bare.image.rgb)
    light = np.where(furniture[..., None], np.float32((0.05, 0.12, 0.3)), light)
    classes = bare.evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    evidence = evidence_of(np.where(furniture, SceneClass.FURNITURE, classes))
    found = find_masks(replace(bare.image, rgb=light), evidence, bare.room, sun_possible=False)
    tail = hangs & (rows > 265) & (rows < 320)
    assert found.target[tail].mean() > 0.95 if goes else found.target[tail].mean() < 0.1
    assert not found.target[hangs & (rows < 238)].any(), "what is above stays"


def test_what_stands_in_the_next_room_is_left_whole() -> None:
    passage, inside, before, beside = none(), none(), none(), none()
    passage[100:160, 100:140] = True
    inside[120:158, 110:144] = True  # cut by the passage's side
    before[130:175, 200:230], beside[110:170, 60:102] = True, True
    assert np.array_equal(beyond(inside | before | beside, passage), inside)
    passage[100:160, 190:240] = True
    assert np.array_equal(beyond(inside | before | beside, passage), inside), "it stands before the other"
    assert not beyond(none(), passage).any()
