"""The seam is a place like any other: a panorama turned about the camera has its masks turned alike."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from processing.ground.arrays import Bytes, Flags
from processing.ground.room_model import RoomModel
from processing.ground.seam import spanned
from processing.removal.furniture import completed, segments, staying
from processing.removal.masks import Masks, find_masks
from processing.removal.rests import crumbs_on_walls, with_things
from processing.removal.skirting import boards_between
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import CEILING, FLOOR, SurfaceMaps
from tests.processing.removal.painted_room import Painted, evidence_of, iou, paint
from tests.processing.removal.test_whole_things import MAPS, NONE, ROWS, box, grey_room, shown

HALF = ROWS  # columns: what is in the middle comes to the seam


def turned(picture: np.ndarray, columns: int = HALF) -> np.ndarray:
    return np.ascontiguousarray(np.roll(picture, columns, axis=-1 if picture.ndim == 2 else 1))


def bed() -> tuple[Bytes, Flags]:
    """Return a picture with a red bed across its middle, and the bed; beside it is a wall of noise."""
    whole, light = box(140, 190, 200, 320), grey_room()
    light[whole] = (0.5, 0.05, 0.05)
    light *= 1 + 0.02 * np.random.default_rng(2).standard_normal(light.shape).astype(np.float32)
    return shown(light), whole


def test_a_segment_of_colour_goes_on_round_the_seam() -> None:
    picture, whole = bed()
    picture = turned(picture)
    labels = segments(picture.tobytes(), picture.shape, 150.0, 40)
    inner = labels[160, [0, -1]]
    assert inner[0] == inner[1], "one bed"
    assert (labels == inner[0]).sum() > 0.9 * whole.sum()
    assert labels[20, 0] == labels[20, -1] != inner[0]


def test_a_bed_across_the_seam_is_completed_as_elsewhere() -> None:
    picture, whole = bed()
    half = whole & box(0, ROWS, 0, HALF)
    likely = np.where(whole, np.float32(0.35), np.float32(0))
    found = completed(half, likely, picture)
    assert found[whole].mean() > 0.95, "its other half goes with it"
    over = completed(turned(half), turned(likely), turned(picture))
    assert iou(over, turned(found)) > 0.97


def test_a_curtain_across_the_seam_stays_whole_as_elsewhere() -> None:
    picture, whole = bed()
    chances = np.zeros((len(SceneClass), ROWS, 2 * ROWS), np.float32)
    chances[SceneClass.FIXTURE] = np.where(whole & box(0, ROWS, 0, HALF + 10), 0.7, 0.35 * whole)
    found = staying(chances, picture, NONE)
    assert found[whole].mean() > 0.95
    over = staying(np.roll(chances, HALF, axis=2), turned(picture), NONE)
    assert iou(over, turned(found)) > 0.97


@pytest.mark.parametrize("alone", [False, True])
def test_a_thing_across_the_seam_goes_as_elsewhere(alone: bool) -> None:
    """On a table (a lamp), or by itself on the floor (a pile of books)."""
    light, table = grey_room(), box(150, 175, 240, 280)
    thing = box(190, 200, 250, 262) if alone else box(128, 150, 252, 260)
    light[table], light[thing] = 0.1, (0.9, 0.5, 0.05)
    flat, start = MAPS.plane == FLOOR, NONE if alone else table
    found = with_things(start, shown(light), flat, MAPS.plane == CEILING, flat if alone else NONE)
    assert found[thing].mean() > 0.9
    given = (turned(one) for one in (start, shown(light), flat, MAPS.plane == CEILING, flat if alone else NONE))
    assert iou(with_things(*given), turned(found)) > 0.97


def test_a_plate_on_a_wall_across_the_seam_stays_as_elsewhere_and_a_dark_crumb_goes() -> None:
    gone, plate, crumb = box(125, 150, 240, 272), box(118, 121, 263, 266), box(119, 122, 250, 253)
    light = np.full((ROWS, 2 * ROWS, 3), 0.5, np.float32)
    light[plate], light[crumb] = 0.9, 0.2
    for columns in (0, HALF - 8, HALF + 5):
        maps = SurfaceMaps(*(np.roll(part, columns, axis=1) for part in vars(MAPS).values()))
        found = crumbs_on_walls(turned(gone, columns), turned(light, columns), maps, turned(NONE), turned(NONE))
        assert not found[turned(plate, columns)].any()
        assert found[turned(crumb, columns)].all()


def test_a_short_board_across_the_seam_goes_between_what_is_removed() -> None:
    board, ends = box(170, 173, 244, 268), box(150, 180, 210, 244) | box(150, 180, 268, 300)
    whole = boards_between(board, ends)
    assert whole[board].all()
    assert (boards_between(turned(board), turned(ends)) == turned(whole)).all()


def test_columns_run_on_round_the_seam() -> None:
    part = box(3, 5, 0, 4) | box(3, 5, 505, 512)
    rows, columns = spanned(part)
    assert rows.tolist() == [3, 4]
    assert columns.tolist() == [*range(-7, 4)]
    assert spanned(box(0, 1, 7, 9))[1].tolist() == [7, 8]


def about(room: RoomModel, angle_rad: float) -> RoomModel:
    """Return a room turned to the right about the camera."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return room.model_copy(
        update={"floor": tuple((cosine * x + sine * y, cosine * y - sine * x) for x, y in room.floor)}
    )


def turned_masks(painted: Painted, columns: int) -> Masks:
    probabilities = np.roll(painted.evidence.probabilities, columns // 2, axis=2)
    return find_masks(
        replace(painted.image, rgb=turned(painted.image.rgb, columns)),
        replace(painted.evidence, probabilities=probabilities, networks=2),
        about(painted.room, columns / painted.maps.plane.shape[1] * 2 * math.pi),
        sun_possible=False,
    )


def test_masks_of_a_room_turn_with_its_picture() -> None:
    """A chest that the network half sees, with a vase on it, comes to the seam."""
    bare = paint(rows=256, things=False, sun=False)
    chest, vase = (np.zeros(bare.maps.plane.shape, bool) for _ in range(2))
    chest[140:175, 150:200], vase[122:140, 172:180] = True, True
    light = np.where(chest[..., None], np.float32([0.3, 0.1, 0.05]), bare.image.rgb)
    light = np.where(vase[..., None], np.float32([0.05, 0.2, 0.5]), light).astype(np.float32)
    classes = bare.evidence.probabilities.argmax(axis=0).repeat(2, 0).repeat(2, 1)
    evidence = evidence_of(np.where(chest, SceneClass.FURNITURE, classes))
    doubtful = chest[::2, ::2] & (np.arange(256) >= 88)
    evidence.probabilities[:, doubtful] = 0
    evidence.probabilities[SceneClass.FURNITURE, doubtful], evidence.probabilities[SceneClass.WALL, doubtful] = 0.2, 0.8
    painted = replace(bare, image=replace(bare.image, rgb=light), evidence=evidence)
    here = turned_masks(painted, 0)
    assert here.target[chest].mean() > 0.95
    assert here.target[vase].all()
    over = turned_masks(painted, 512 - 176)
    for name in ("furniture", "shadow", "target"):
        assert iou(getattr(over, name), turned(getattr(here, name), 512 - 176)) > 0.95, name
