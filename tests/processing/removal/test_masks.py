"""All masks of a painted room, each against what was painted; what is missing is said."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from processing.errors import ParameterError, RoomError
from processing.ground.seam import grown, resized, share_of_sphere
from processing.pictures.images import RelativeImage
from processing.pictures.preview import preview_rgb8
from processing.removal import masks
from processing.removal.edges import at_full_size, snapped
from processing.removal.furniture import FurnitureFound, attached, completed, islands_in
from processing.removal.masks import Masks, target_of, with_islands
from processing.removal.tripod import find_tripod, painted_disc
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR
from tests.conftest import LONG
from tests.once import once
from tests.processing.removal.painted_room import SUN, Painted, evidence_of, iou, paint

find_masks = once(masks.find_masks)
"""Several tests compare with the painted room as it is."""


@pytest.fixture(scope="module")
def painted() -> Painted:
    return paint(rows=256)


@pytest.fixture(scope="module")
def lit(painted: Painted) -> Masks:
    return find_masks(painted.image, painted.evidence, painted.room, sun_direction=SUN)


@pytest.fixture(scope="module")
def shaded(painted: Painted) -> Masks:
    return find_masks(painted.image, painted.evidence, painted.room, sun_possible=False)


def test_each_mask_is_what_was_painted(painted: Painted, lit: Masks) -> None:
    assert iou(lit.furniture, painted.furniture) > 0.95
    assert iou(lit.tripod, painted.tripod) > 0.9
    assert iou(lit.sunlight, painted.sunlit) > 0.88
    assert not (lit.furniture & painted.hung).any(), "what hangs on the wall is not attached to the floor"
    assert any("do not reach the floor" in note for note in lit.notes)
    united = lit.furniture | lit.tripod | lit.sunlight | lit.shadow
    assert (lit.target >= united).all()
    assert lit.shares["target"] == pytest.approx(share_of_sphere(lit.target))
    assert not (lit.shadow & (lit.furniture | lit.tripod)).any()


def test_a_contact_band_lies_around_the_foot(painted: Painted, lit: Masks) -> None:
    below = np.roll(lit.furniture, 1, axis=0) & ~lit.furniture & (painted.maps.plane == FLOOR)
    assert lit.shadow[below & ~lit.sunlight].mean() > 0.8
    assert lit.shadow.sum() < 3 * painted.furniture.sum()


def test_a_frame_beside_a_wardrobe_is_none_of_its_contact_shadow() -> None:
    bare = paint(rows=256, things=False, sun=False)
    pane, wardrobe = bare.maps.opening >= 0, np.zeros(bare.maps.plane.shape, bool)
    wardrobe[95:200, 35:70] = True  # the pane ends at column 31, its frame at 32; at 2 m, 10 cm are four columns
    light = np.where(wardrobe[..., None], np.float32(0.05), bare.image.rgb)
    classes = bare.evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    evidence = evidence_of(np.where(wardrobe, SceneClass.FURNITURE, classes))
    found = find_masks(replace(bare.image, rgb=light), evidence, bare.room, sun_possible=False)
    assert found.furniture[110:190, 40:68].all()
    frame = grown(pane, math.radians(1)) & ~pane
    assert not found.target[frame].any()
    assert found.target[165:185, 33:35].all(), "below the window its contact shadow goes with it"


@pytest.mark.parametrize("door", [0.25, pytest.param(0.05, marks=pytest.mark.long)])
def test_a_dark_doorway_that_is_no_known_opening_stays_beside_furniture(door: float) -> None:
    """Unlike its wall, and touching what is removed: it stays by a door's small probability alone."""
    bare = paint(rows=256, things=False, sun=False)
    doorway, chest = (np.zeros(bare.maps.plane.shape, bool) for _ in range(2))
    doorway[105:160, 160:176], chest[140:170, 150:190] = True, True
    doorway &= ~chest
    light = np.where(doorway[..., None], bare.image.rgb / 5, bare.image.rgb)
    light = np.where(chest[..., None], np.float32(0.4) * light, light)
    classes = bare.evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    evidence = evidence_of(np.where(chest, SceneClass.FURNITURE, classes))
    small = doorway[::2, ::2]
    probabilities = evidence.probabilities.astype(np.float32)
    for kind, value in zip(
        (SceneClass.WALL, SceneClass.DOOR, SceneClass.FURNITURE), (0.85 - door, door, 0.15), strict=True
    ):
        probabilities[kind, small] = value
    evidence = replace(evidence, probabilities=probabilities, networks=2)
    found = find_masks(replace(bare.image, rgb=light), evidence, bare.room, sun_possible=False)
    assert found.furniture[145:165, 155:185].all()
    assert found.target[110:135, 162:174].any() == (door < 0.15)


@pytest.mark.parametrize("share", [pytest.param(0.6, marks=pytest.mark.long), 0.48])
def test_floor_of_the_next_room_before_a_wall_stays_beside_furniture(share: float) -> None:
    """Also where it is only likelier than furniture, in one colour with floor that surely is."""
    bare = paint(rows=256, things=False, sun=False)
    hall, chest = (np.zeros(bare.maps.plane.shape, bool) for _ in range(2))
    hall[140:150, 190:210], chest[140:170, 150:190] = True, True
    assert (bare.maps.plane[hall] >= FIRST_WALL).all()
    light = np.where(hall[..., None], bare.image.rgb / 5, bare.image.rgb)
    light = np.where(chest[..., None], np.float32(0.4) * light, light)
    classes = bare.evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    evidence = evidence_of(np.where(chest, SceneClass.FURNITURE, np.where(hall, SceneClass.FLOOR, classes)))
    shares = evidence.probabilities.copy()
    half = resized(hall.astype(np.float32), shares.shape[1:]) > 0.5
    shares[:, half] = 0
    shares[SceneClass.FLOOR, half], shares[SceneClass.FURNITURE, half] = share, 0.4
    shares[SceneClass.WALL, half] = 0.6 - share
    shares[SceneClass.FLOOR, 72:75, 95:105] = 0.6
    evidence = replace(evidence, probabilities=shares)
    found = find_masks(replace(bare.image, rgb=light), evidence, bare.room, sun_possible=False)
    assert found.furniture[145:165, 155:185].all()
    assert not found.target[142:149, 193:208].any()


def test_floor_that_is_half_a_thing_goes_with_the_furniture_that_it_touches(painted: Painted, shaded: Masks) -> None:
    unsure = np.zeros_like(shaded.target)
    unsure[176:186, 222:236] = True  # to the right of the furniture's foot
    assert (painted.maps.plane[unsure] == FLOOR).all()
    unsure &= ~shaded.target
    assert unsure.sum() > 80
    shares = painted.evidence.probabilities.copy()
    small = resized(grown(unsure, math.radians(1.5)).astype(np.float32), shares.shape[1:]) > 0.5
    small &= shares[SceneClass.FURNITURE] < 0.44
    shares[:, small] = 0
    shares[SceneClass.FURNITURE, small], shares[SceneClass.FLOOR, small] = 0.44, 0.56
    after = find_masks(painted.image, replace(painted.evidence, probabilities=shares), painted.room, sun_possible=False)
    assert after.target[unsure].mean() > 0.8
    assert not (after.target & ~shaded.target & ~grown(unsure, math.radians(2))).any()


def test_the_margin_is_kept(painted: Painted) -> None:
    none = find_masks(painted.image, painted.evidence, painted.room, sun_possible=False, margin_rad=0.0)
    wide = find_masks(painted.image, painted.evidence, painted.room, sun_possible=False, margin_rad=0.05)
    things = grown(none.furniture | none.tripod, 0.05)
    assert wide.target[things].all()
    around = with_islands(things | none.target, painted.maps.opening >= 0)
    assert not (wide.target & ~around).any(), "contact shadow is a margin already"
    assert not none.sunlight.any()
    assert any("no sun" in note for note in none.notes)


def test_skirting_that_the_network_sees_stays(painted: Painted, shaded: Masks) -> None:
    # Left of the furniture, where its contact shadow and margin are.
    beside = grown(shaded.furniture, 0.06) & ~grown(shaded.furniture, 0.025) & (painted.maps.plane >= 2)
    beside &= painted.points_m[..., 2] < 0.25
    assert (shaded.target & beside).sum() > 15
    evidence = replace(painted.evidence, skirting=beside.astype(np.float32))
    after = find_masks(painted.image, evidence, painted.room, sun_possible=False)
    assert not (after.target & beside).any()
    assert (after.furniture == shaded.furniture).mean() > 0.999


def test_a_fixture_above_furniture_is_not_cut_by_its_margin(painted: Painted) -> None:
    """A picture that the network sees hangs on whole; furniture's contact shadow does not reach it."""
    middle = int(np.flatnonzero(painted.furniture.any(axis=0))[-1]) - 6
    top = int(painted.furniture[:, middle - 6 : middle + 1].any(axis=1).argmax())
    fixture = np.zeros_like(painted.furniture)
    fixture[top - 30 : top, middle - 6 : middle + 40] = True
    fixture &= ~painted.furniture
    probabilities = painted.evidence.probabilities.copy()
    seen = fixture[::2, ::2]
    probabilities[:, seen] = 0.01
    probabilities[SceneClass.FIXTURE, seen] = 0.93
    rgb = painted.image.rgb.copy()
    rgb[fixture] = (0.9, 0.2, 0.6)
    evidence = replace(painted.evidence, probabilities=probabilities)
    before = find_masks(painted.image, painted.evidence, painted.room, sun_possible=False, margin_rad=0.05)
    found = find_masks(replace(painted.image, rgb=rgb), evidence, painted.room, sun_possible=False, margin_rad=0.05)
    assert (before.target & fixture).any(), "the margin would reach it"
    assert not (found.target & fixture & ~found.furniture).any()
    assert (found.furniture & fixture).sum() < 0.1 * fixture.sum()


@pytest.mark.parametrize("furniture", [0.19, 0.4])
def test_a_mirrors_lower_edge_that_the_cut_took_stays(monkeypatch: pytest.MonkeyPatch, furniture: float) -> None:
    """Of one colour with the mirror, and hardly furniture: a shelf below it does not bite into it."""
    bare = paint(rows=256, things=False, sun=False)
    mirror, low, shelf = (np.zeros(bare.maps.plane.shape, bool) for _ in range(3))
    mirror[90:130, 150:190], low[124:130, 150:190], shelf[130:170, 140:215] = True, True, True
    light = np.where(mirror[..., None], np.float32((0.05, 0.08, 0.25)), bare.image.rgb)
    light = np.where(shelf[..., None], np.float32((0.5, 0.25, 0.12)), light)
    classes = bare.evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    kinds = np.where(shelf, SceneClass.FURNITURE, np.where(mirror, SceneClass.FIXTURE, classes))
    shares, half = evidence_of(kinds).probabilities.astype(np.float32), low[::2, ::2]
    shares[:, half] = 0
    shares[SceneClass.FIXTURE, half], shares[SceneClass.FURNITURE, half] = 0.42, furniture
    shares[SceneClass.WALL, half] = 0.58 - furniture
    taken = shelf | low
    found = FurnitureFound(taken, taken.astype(np.float32), np.zeros_like(taken), 0, 0.0)
    monkeypatch.setattr(masks.pieces, "find_furniture", lambda *_, **__: found)
    evidence = replace(evidence_of(kinds), probabilities=shares, networks=2)
    target = masks.find_masks(replace(bare.image, rgb=light), evidence, bare.room, sun_possible=False).target
    assert target[shelf].all()
    assert target[low].mean() < 0.2 if furniture < 0.25 else target[low].mean() > 0.9


FIXED = {
    "radiator": ((150, 185), (380, 430)),
    "air conditioner": ((100, 116), (300, 340)),
    "kitchen": ((115, 190), (120, 260)),
}
"""By name, between which rows and columns."""


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("name", "networks"),
    list(itertools.product(FIXED, (1, 2))) if LONG else [("radiator", 2)],
)
def test_what_is_fixed_to_the_building_stays(painted: Painted, name: str, networks: int) -> None:
    """A radiator before a wall, an air conditioner on it, a kitchen along it down to the floor: fixtures all."""
    rows, columns = FIXED[name]
    fixed = np.zeros_like(painted.furniture)
    fixed[slice(*rows), slice(*columns)] = True
    fixed &= ~grown(painted.furniture, math.radians(3))
    assert fixed.sum() > 400
    classes = painted.evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    light = np.where(fixed[..., None], np.float32((0.9, 0.85, 0.8)), painted.image.rgb)

    def target(kind: SceneClass) -> np.ndarray:
        evidence = replace(evidence_of(np.where(fixed, kind, classes)), networks=networks)
        image = replace(painted.image, rgb=light)
        return find_masks(image, evidence, painted.room, sun_possible=False).target

    inner = fixed & ~grown(~fixed, math.radians(1.5))
    assert target(SceneClass.FIXTURE)[inner].mean() < 0.02
    if rows[1] > 180:
        assert target(SceneClass.FURNITURE)[inner].mean() > 0.9, "were it furniture, it would go"


def test_an_empty_room_has_nothing_to_remove() -> None:
    bare = paint(sun=False, things=False)
    found = find_masks(bare.image, bare.evidence, bare.room)
    assert not found.target.any()
    assert any("furniture: none" in note for note in found.notes)
    assert any("nadir" in note for note in found.notes)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_pictures_of_one_tone_give_no_nonsense(painted: Painted, value: float) -> None:
    flat = replace(painted.image, rgb=np.full_like(painted.image.rgb, value))
    unknown = SceneEvidence(np.full((8, 16, 32), 1 / 8, np.float32), "nothing")
    found = find_masks(flat, unknown, painted.room)
    assert not found.target.any()
    assert found.notes


@pytest.mark.long
def test_the_sun_itself_in_the_picture_does_no_harm(painted: Painted) -> None:
    rgb = painted.image.rgb.copy()
    rgb[painted.maps.opening >= 0] = 1.6e9
    found = find_masks(replace(painted.image, rgb=rgb), painted.evidence, painted.room, sun_direction=SUN)
    assert iou(found.sunlight, painted.sunlit) > 0.85
    assert iou(found.furniture, painted.furniture) > 0.8


@pytest.mark.long
def test_a_large_picture_keeps_its_own_edges_and_has_no_crumbs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A crumb is what the working size does not see: in a picture 1.25 times as high, up to 25 pixels."""
    large = paint(rows=640)
    planted = np.zeros((640, 1280), bool)
    planted[300:400, 300:400] = True
    planted[320:325, 320:325] = planted[350:356, 350:356] = False
    monkeypatch.setattr(masks, "with_islands", lambda *_: planted.copy())
    found = masks.find_masks(large.image, large.evidence, large.room, sun_possible=False)
    assert found.furniture.shape == (640, 1280)
    assert iou(found.furniture, large.furniture) > 0.95
    assert found.target[320:325, 320:325].all()
    assert not found.target[350:356, 350:356].any()


def test_evidence_of_any_size_and_odd_pictures() -> None:
    small = paint(rows=17)
    evidence = SceneEvidence(np.full((8, 3, 7), 1 / 8, np.float32), "coarse")
    assert find_masks(small.image, evidence, small.room).target.shape == (17, 34)


def test_what_cannot_be_is_refused(painted: Painted) -> None:
    with pytest.raises(ParameterError, match="margin"):
        find_masks(painted.image, painted.evidence, painted.room, margin_rad=1.0)
    bad = SceneEvidence(np.full((8, 4, 8), np.nan, np.float32), "broken")
    with pytest.raises(ParameterError, match="evidence"):
        find_masks(painted.image, bad, painted.room)
    tiny = RelativeImage(
        np.ones((4, 8, 3), np.float32), np.ones((4, 8), np.float32), np.zeros((4, 8), np.uint8), Equirectangular(8, 4)
    )
    with pytest.raises(ParameterError, match="rows"):
        find_masks(tiny, painted.evidence, painted.room)
    outside = painted.room.model_copy(update={"floor": ((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0))})
    with pytest.raises(RoomError):
        find_masks(painted.image, painted.evidence, outside)


def test_components_by_the_floor() -> None:
    """One stands on the floor, one hangs, one stands far away with its foot at the floor's edge."""
    floor = np.zeros((90, 180), bool)
    floor[60:] = True
    mask = np.zeros_like(floor)
    mask[40:64, 20:30] = mask[20:35, 60:80] = mask[30:60, 100:110] = True
    kept, dropped, dropped_sr = attached(mask, floor)
    assert kept[50, 25]
    assert kept[40, 105]
    assert not kept[25, 70]
    assert (dropped, dropped_sr > 0) == (1, True)


def test_what_furniture_encloses_goes_with_it_unless_large_or_a_window() -> None:
    mask = np.zeros((64, 128), bool)
    mask[30:40, 120:] = mask[30:40, :8] = True
    mask[33:36, :2] = mask[33:36, 127:] = False
    found = islands_in(mask, np.zeros_like(mask))
    assert found.sum() == 3 * 3
    assert found[33:36, :2].all()
    assert not islands_in(mask, found).any()
    mask[10:60, 20:80] = True
    mask[12:58, 22:78] = False
    assert islands_in(mask, np.zeros_like(mask)).sum() == 3 * 3
    assert not islands_in(np.ones_like(mask), mask).any()
    assert not islands_in(np.zeros_like(mask), mask).any()


def test_the_target_leaves_no_small_islands() -> None:
    target = np.zeros((128, 256), bool)
    target[50:90, 60:120] = True
    target[64:70, 80:86] = False
    none = np.zeros((64, 128), bool)
    whole = with_islands(target, none)
    assert whole[50:90, 60:120].all()
    assert whole.sum() == 40 * 60
    window = none.copy()
    window[32:35, 40:43] = True
    assert np.array_equal(with_islands(target, window), target)
    assert not with_islands(np.zeros_like(target), none).any()


def test_what_sunlight_encloses_is_no_island() -> None:
    ring, none = np.zeros((128, 256), bool), np.zeros((128, 256), bool)
    ring[50:90, 60:120] = True
    ring[64:70, 80:86] = False
    openings = np.zeros((64, 128), bool)
    assert np.array_equal(target_of((none, none), ring, openings, 0.0), ring)
    assert target_of((ring, none), none, openings, 0.0)[50:90, 60:120].all()
    # Half of the ring is a thing's: then it is not closed by things, and stays open.
    half = ring.copy()
    half[:, 83:] = False
    assert np.array_equal(target_of((half, none), ring & ~half, openings, 0.0), ring)


def test_edges_are_found_in_the_picture() -> None:
    """A blurred, shifted probability snaps onto the disc that the picture shows."""
    rows = 128
    y, x = np.indices((rows, 2 * rows))
    disc = np.hypot(x - 3, y - 70) < 18
    disc |= np.hypot(x - 259, y - 70) < 18
    shown = np.where(disc[..., None], np.array([180, 40, 40]), np.array([90, 110, 90])).astype(np.float64)
    shown = np.clip(shown + np.random.default_rng(1).normal(0, 6, shown.shape), 0, 255).astype(np.uint8)
    away = np.minimum(np.hypot(x - 5, y - 72), np.hypot(x - 261, y - 72))
    blurred = (1 / (1 + np.exp((away - 16) / 3.0))).astype(np.float32)
    assert iou(blurred > 0.5, disc) < 0.8
    assert iou(snapped(blurred, shown) > 0.5, disc) > 0.97


def test_full_size_edges_follow_the_large_picture() -> None:
    y, x = np.indices((256, 512))
    disc = np.hypot(x - 200, y - 128) < 50
    shown = np.where(disc[..., None], 200, 60).astype(np.uint8) * np.ones(3, np.uint8)
    small = np.asarray(disc[2::4, 2::4], np.float32)
    small = np.roll(small, 1, axis=1)
    assert iou(at_full_size(small, shown) > 0.5, disc) > iou(np.kron(small, np.ones((4, 4))) > 0.5, disc) + 0.02


def test_a_painted_over_nadir_is_found_without_evidence() -> None:
    bare = paint(rows=256, sun=False, things=False)
    shown = preview_rgb8(bare.image.rgb)
    assert painted_disc(shown) == 0.0
    over = shown.copy()
    latitude = 0.5 - (np.arange(256) + 0.5) / 256
    over[latitude * 180 < -78] = (120, 118, 110)
    assert math.degrees(painted_disc(over)) == pytest.approx(11, abs=2)
    nothing = np.full((8, 256, 512), 1 / 8, np.float32)
    nothing[SceneClass.TRIPOD] = 0.0
    found = find_tripod(nothing, over, bare.maps.plane == FLOOR)
    assert found.at_nadir
    assert share_of_sphere(found.mask) == pytest.approx((1 - math.cos(math.radians(12))) / 2, rel=0.3)


def test_a_dark_tripod_is_found_by_its_colours() -> None:
    painted = paint(rows=256, sun=False)
    nothing = np.full((8, 256, 512), 1 / 8, np.float32)
    nothing[SceneClass.TRIPOD] = 0.0
    found = find_tripod(nothing, preview_rgb8(painted.image.rgb), painted.maps.plane == FLOOR)
    assert iou(found.mask, painted.tripod) > 0.85
    bare = paint(rows=256, sun=False, things=False)
    assert not find_tripod(nothing, preview_rgb8(bare.image.rgb), bare.maps.plane == FLOOR).mask.any()


def test_a_patch_of_sun_that_the_network_takes_for_furniture_is_sunlight(painted: Painted) -> None:
    patch = painted.sunlit & (painted.maps.plane == FLOOR)
    classes = np.where(painted.maps.plane == FLOOR, SceneClass.FLOOR, SceneClass.WALL)
    classes[painted.maps.plane == CEILING] = SceneClass.CEILING
    classes[painted.maps.opening >= 0] = SceneClass.WINDOW
    classes[painted.furniture | patch] = SceneClass.FURNITURE
    found = find_masks(painted.image, evidence_of(classes), painted.room, sun_direction=SUN)
    assert (found.sunlight & patch).sum() > 0.8 * patch.sum()
    assert (found.furniture & patch).sum() < 0.2 * patch.sum()
    assert iou(found.furniture, painted.furniture) > 0.85
    assert found.target[patch].all()


def test_what_is_doubtful_within_one_colour_goes_with_the_rest_and_no_further() -> None:
    """Half of a red bed is surely furniture, the other half perhaps; a floor beside it is as doubtful."""
    rgb8 = np.full((128, 256, 3), (150, 110, 70), np.uint8)
    rgb8[60:100, 60:140] = (180, 30, 30)
    probability = np.full((128, 256), 0.4, np.float32)
    probability[:50] = 0.1
    mask = np.zeros((128, 256), bool)
    mask[62:98, 62:100] = True
    found = completed(mask, probability, rgb8)
    assert found[64:96, 64:136].mean() > 0.98
    assert found[:, :50].mean() < 0.02
    assert (found & mask).sum() == mask.sum()
