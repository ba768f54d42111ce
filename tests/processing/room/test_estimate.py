from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import NoRoomError, ParameterError
from processing.ground.room_model import geometry_problems
from processing.room import estimate
from processing.room.columns import columns_of
from processing.room.confidence import diagnose, part_confidences
from processing.room.estimate import estimate_room, tidied, walls_azimuth
from processing.room.hypotheses import hypotheses
from processing.room.outline import ALONG_X, ALONG_Y, Outline, Wall, corners_of, polygon_of, values_of, with_values
from processing.room.refine import Refined
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.surfaces.maps import wall_ranges
from tests.conftest import LONG
from tests.processing.room.evidence import (
    BOX,
    COLUMNS,
    ELL,
    SLANTED,
    azimuths,
    boundary_of,
    classes_of,
    evidence_of,
    painted,
    picture_of,
    room_of,
    turned,
)


def iou(floor, other) -> float:
    one, two = shapely.Polygon(floor), shapely.Polygon(other)
    return one.intersection(two).area / one.union(two).area


@pytest.mark.parametrize("floor", [BOX, ELL, SLANTED], ids=["box", "L", "slanted"])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_exact_boundaries_give_the_exact_room(floor, angle: float) -> None:
    room = room_of(turned(floor, angle))
    best = hypotheses(columns_of(boundary_of(room)), -angle)[0]
    assert iou(best.fit.polygon * 1.6, room.floor) > 0.99
    assert 1.6 * (1 + best.fit.outline.ratio) == pytest.approx(2.55, rel=0.005)
    assert len(best.fit.polygon) == len(floor)


HALL = ((-4.5, -6.0), (3.5, -6.0), (3.5, 4.0), (-4.5, 4.0))


@pytest.mark.parametrize(
    ("floor", "camera_m", "ceiling_m"),
    [(HALL, 1.6, 12.0), pytest.param(BOX, 0.5, 2.7, marks=pytest.mark.long), (BOX, 0.3, 2.6)],
)
def test_halls_and_rooms_seen_from_near_the_floor_have_their_height_and_size(floor, camera_m, ceiling_m) -> None:
    room = room_of(floor, camera=camera_m, ceiling=ceiling_m)
    for noise_deg, least in ((0.0, 0.999), (1.0, 0.985)):
        best = hypotheses(columns_of(boundary_of(room, noise_deg=noise_deg)), 0.0)[0]
        assert camera_m * (1 + best.fit.outline.ratio) == pytest.approx(ceiling_m, rel=0.01)
        assert iou(best.fit.polygon * camera_m, floor) > least


def test_a_doorway_that_shows_another_room_does_not_move_the_wall() -> None:
    room = room_of(BOX)
    true = boundary_of(room, noise_deg=0.4)
    floor = true.floor_rad.copy()
    floor[120:138] = np.arctan(np.tan(floor[120:138]) / 2)
    best = hypotheses(columns_of(replace(true, floor_rad=floor)), 0.0)[0]
    assert iou(best.fit.polygon * 1.6, BOX) > 0.97
    assert len(best.fit.polygon) == 4


@pytest.mark.sweep
@given(st.integers(0, 1000))
@settings(max_examples=20 if LONG else 3, deadline=None)
def test_whatever_the_boundaries_say_the_room_can_stand(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = boundary_of(room_of(ELL), noise_deg=2.0, seed=seed)
    wild = rng.random(COLUMNS) < 0.4
    floor = np.where(wild, -rng.uniform(0.02, 1.5, COLUMNS), np.minimum(true.floor_rad, -0.01))
    evidence = SceneEvidence(classes_of(room_of(ELL)), "", replace(true, floor_rad=floor))
    try:
        found = estimate_room(painted(room_of(ELL), 128), evidence, quality="draft")
    except NoRoomError:
        return
    assert geometry_problems(found.room) == []
    assert 0.02 <= found.room.confidence <= 0.98
    assert len(found.walls) == len(found.room.floor)


def test_edges_of_the_picture_correct_boundaries_that_are_off() -> None:
    room = room_of(turned(BOX, 0.2))
    image, evidence = painted(room, 1024), evidence_of(room, noise_deg=0.3, bias_deg=0.6)
    rough = estimate_room(image, evidence, manhattan_rad=-0.2, quality="draft")
    fine = estimate_room(image, evidence, manhattan_rad=-0.2)
    assert iou(fine.room.floor, room.floor) > 0.99 > 0.985 > iou(rough.room.floor, room.floor)
    assert fine.diagnostics.edges > 0.7
    assert rough.diagnostics.edges == 0
    assert any("draft" in text for text in rough.skipped)


@pytest.mark.parametrize("side", [None, 1], ids=["all walls", "one wall"])
def test_walls_end_where_the_floor_is_seen_to_end_rather_than_where_it_is_guessed(
    side: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Furniture hides the floor's end in five columns of eight, where it is taken 14 % too far; no edges help."""
    room = room_of(BOX)
    true, classes = boundary_of(room, noise_deg=1.0), classes_of(room)
    hidden = ((wall_ranges(room.floor, azimuths())[1] == side) | (side is None)) & (np.arange(COLUMNS) % 16 < 10)
    floor = np.where(hidden, np.arctan(np.tan(true.floor_rad) / 1.14), true.floor_rad)
    classes[:, COLUMNS // 4 :, hidden] = 0.01
    classes[SceneClass.FURNITURE, COLUMNS // 4 :, hidden] = 0.93
    evidence = SceneEvidence(classes, "", replace(true, floor_rad=floor))

    def off() -> float:
        found = estimate_room(painted(room, 256), evidence, manhattan_rad=0.0, quality="draft").room
        return max(x for x, _ in found.floor) / 2.3 - 1

    by_the_seen = off()
    monkeypatch.setattr(estimate, "GUESSED", 1.0)
    assert abs(by_the_seen) < 0.06
    assert abs(by_the_seen) < 0.6 * off(), "were all columns heard alike, the wall would end beyond its floor"


def test_without_edges_the_networks_boundary_stands_and_that_is_said() -> None:
    room = room_of(BOX)
    # Brightness runs along the azimuth only: floor, walls and ceiling look alike.
    even = picture_of(
        np.tile(2 + np.sin(np.arange(256) / 256 * 2 * math.pi), (128, 1)) * np.linspace(1, 1.2, 128)[:, None]
    )
    found = estimate_room(even, evidence_of(room, noise_deg=0.2), manhattan_rad=0.0)
    assert iou(found.room.floor, BOX) > 0.97
    assert found.diagnostics.edges < 0.1
    assert any("walls in sight" in text for text in found.skipped)


def test_scale_is_the_cameras_height() -> None:
    room = room_of(BOX)
    small, large = (
        estimate_room(painted(room, 256), evidence_of(room), camera_height_m=h, quality="draft") for h in (0.8, 3.2)
    )
    np.testing.assert_allclose(np.array(large.room.floor), 4 * np.array(small.room.floor), atol=2e-3)
    assert large.room.ceiling_height_m == pytest.approx(4 * small.room.ceiling_height_m, abs=1e-3)


@pytest.mark.parametrize("angle", [-0.7, -0.2, 0.0, 0.5])
def test_the_walls_azimuth_is_estimated_from_boundaries_alone(angle: float) -> None:
    found = walls_azimuth(columns_of(boundary_of(room_of(turned(BOX, angle)), noise_deg=0.3)))
    off = (found + angle + math.pi / 4) % (math.pi / 2) - math.pi / 4
    assert abs(off) < math.radians(1.5)


@pytest.mark.long
def test_less_agreement_means_less_confidence() -> None:
    room = room_of(BOX)
    image = painted(room, 512)
    sure = estimate_room(image, evidence_of(room, noise_deg=0.5), manhattan_rad=0.0).room.confidence
    wild = boundary_of(room, noise_deg=8.0)
    wild = replace(wild, floor_rad=np.minimum(wild.floor_rad, -0.02), ceiling_rad=np.maximum(wild.ceiling_rad, 0.02))
    unsure = estimate_room(image, SceneEvidence(classes_of(room_of(SLANTED)), "", wild), manhattan_rad=0.0)
    assert sure > 0.7
    assert unsure.room.confidence < min(0.5, sure)
    assert unsure.warnings


def test_pictures_that_show_no_room_are_refused_by_name() -> None:
    room = room_of(BOX)
    evidence = evidence_of(room)
    with pytest.raises(NoRoomError, match="black"):
        estimate_room(picture_of(np.zeros((128, 256))), evidence)
    with pytest.raises(NoRoomError, match="twice as wide"):
        estimate_room(picture_of(np.random.default_rng(0).uniform(0, 1, (100, 256))), evidence)
    padded = painted(room, 256).rgb[..., 0].copy()
    padded[:45] = padded[-45:] = 0
    with pytest.raises(NoRoomError, match="cropped"):
        estimate_room(picture_of(padded), evidence)
    outdoors = evidence.probabilities.copy()
    outdoors[:, :64] = 0.002
    outdoors[3, :64] = 0.986
    with pytest.raises(NoRoomError, match="outdoors"):
        estimate_room(painted(room, 256), replace(evidence, probabilities=outdoors))


def test_a_picture_that_looks_another_way_is_refused() -> None:
    image = painted(room_of(BOX), 256)
    aside = replace(image, geometry=replace(image.geometry, yaw_rad=0.3))
    with pytest.raises(ParameterError, match=r"looks 17\.2 degrees to the side"):
        estimate_room(aside, evidence_of(room_of(BOX)))


def test_a_wall_that_is_not_seen_has_three_tenths_of_the_rooms_confidence() -> None:
    """The short wall of a recess that points away from the camera."""
    hidden = ((-1.5, -1.4), (2.2, -1.4), (2.2, 1.2), (1.1, 1.2), (1.1, 3.4), (-1.5, 3.4))
    behind = ((-1.5, -1.4), (2.2, -1.4), (2.2, 2.4), (0.4, 2.4), (0.4, 1.2), (-1.5, 1.2))
    room = room_of(behind)
    sure, _ = part_confidences(room, columns_of(boundary_of(room)), 0.8)
    unseen = [i for i, one in enumerate(sure) if one == pytest.approx(0.8 * 0.3)]
    assert len(unseen) == 1
    assert max(sure) > 0.9, "a wall that is seen clearly does not depend on the others"
    seen, _ = part_confidences(room_of(hidden), columns_of(boundary_of(room_of(hidden))), 0.8)
    assert min(seen) > 0.24


def test_in_a_doubtful_room_the_walls_that_are_seen_clearly_stand_and_the_others_do_not() -> None:
    room = room_of(BOX)
    true = boundary_of(room)
    wall = wall_ranges(room.floor, azimuths())[1]
    spread = np.where(wall == 1, math.radians(8.0), true.floor_sigma_rad)
    columns = columns_of(replace(true, floor_sigma_rad=spread, ceiling_sigma_rad=spread))
    walls, ceiling = part_confidences(room, columns, 0.1)
    assert walls[1] < 0.3 < 0.9 < min(walls[k] for k in (0, 2, 3))
    assert 0.5 < ceiling < 0.9
    assert part_confidences(room, replace(columns, ratio_spread=0.4), 0.1)[1] < 0.3


def test_rivals_are_rooms_that_cost_no_more_than_the_chosen_one() -> None:
    """Where edges chose the dearer of two rooms, the cheaper one still speaks against it."""
    columns = columns_of(boundary_of(room_of(BOX)))
    first = hypotheses(columns, 0.0)[0]
    small = replace(first, fit=replace(first.fit, polygon=first.fit.polygon * 0.7), price=first.price + 100)
    kept = Refined(small.fit.polygon, small.fit.outline)
    facts = {"overhead": 1.0, "blank": 0.0, "loss": 0.0, "entropy": 0.1}
    dearer = diagnose(columns, ([first, small], small), kept, **facts)
    assert dearer.rival == pytest.approx(1 - 0.49, abs=0.01)
    cheaper = diagnose(columns, ([first, small], first), Refined(first.fit.polygon, first.fit.outline), **facts)
    assert cheaper.rival == pytest.approx(0, abs=1e-6)


def test_evidence_that_cannot_be_is_refused() -> None:
    room = room_of(BOX)
    image, boundary = painted(room, 256), boundary_of(room)
    bad = [
        None,
        replace(boundary, floor_rad=np.full(COLUMNS, np.nan)),
        replace(boundary, floor_rad=boundary.ceiling_rad, ceiling_rad=boundary.floor_rad),
        replace(boundary, floor_sigma_rad=np.zeros(COLUMNS)),
        replace(boundary, corner=boundary.corner[:-1]),
    ]
    for one in bad:
        with pytest.raises(ParameterError):
            estimate_room(image, SceneEvidence(classes_of(room), "", one))
    for height in (0.0, float("nan"), 25.0):
        with pytest.raises(ParameterError):
            estimate_room(image, evidence_of(room), camera_height_m=height)


def test_a_ceiling_higher_than_rooms_have_is_no_room() -> None:
    """`--camera-height 19` ended in an internal error, and so would a high hypothesis at any height."""
    room = room_of(BOX)
    with pytest.raises(NoRoomError, match="no room shape"):
        estimate_room(painted(room, 256), evidence_of(room), camera_height_m=19.0, quality="draft")


def test_columns_of_which_nothing_is_known_do_not_count() -> None:
    room = room_of(BOX)
    true = boundary_of(room)
    floor, sigma = true.floor_rad.copy(), true.floor_sigma_rad.copy()
    floor[40:70], sigma[40:70] = -1.4, np.inf
    best = hypotheses(columns_of(replace(true, floor_rad=floor, floor_sigma_rad=sigma)), 0.0)[0]
    assert iou(best.fit.polygon * 1.6, BOX) > 0.98


def box_outline(turned_rad: float, ratio: float, distances: tuple[float, ...]) -> Outline:
    """A rectangle: distances of the walls ahead, right, behind, left in the turned axes."""
    kinds = (ALONG_Y, ALONG_X, ALONG_Y, ALONG_X)
    walls = (Wall(kind, k * math.pi / 2, d) for k, (kind, d) in enumerate(zip(kinds, distances, strict=True)))
    return Outline(tuple(walls), turned_rad, ratio)


def test_outlines_make_polygons_and_take_parameters() -> None:
    box = box_outline(0.3, 0.6, (1.0, 2.0, 1.5, 0.5))
    floor = polygon_of(box)
    assert floor is not None
    assert shapely.Polygon(floor).area == pytest.approx(2.5 * 2.5)
    moved = with_values(box, values_of(box) + np.array([0, 0, 0.5, 0, 0, 0]))
    assert shapely.Polygon(polygon_of(moved)).area == pytest.approx(3.0 * 2.5)
    assert np.isfinite(corners_of(box)).all()
    assert polygon_of(box_outline(0.0, 0.6, (1.0, 2.0, -1.5, 0.5))) is None


def test_polygons_are_tidied() -> None:
    floor = np.array([(0, 0), (2, 0), (4, 0), (4, 3), (3.98, 3.02), (0, 3)], float)
    assert len(tidied(floor)) == 4
    assert shapely.Polygon(tidied(floor)).area == pytest.approx(12, rel=0.01)
