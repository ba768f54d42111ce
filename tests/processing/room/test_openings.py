"""Windows and doors on drawn rooms with evidence made by hand."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from processing.ground.room_model import Opening, OpeningKind, RoomModel, geometry_problems
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.room.opening_fit import WINDOW as KIND
from processing.room.opening_fit import Candidate, Field, brighter_inside
from processing.room.openings import find_openings, uncovered
from processing.room.wall_views import WallView, wall_views
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.surfaces.maps import planes_of, surface_maps
from tests.processing.room.drawn_rooms import Drawn, Patch, as_image, draw

ROWS = 256
LOW, HIGH = (-2.0, -1.5), (1.6, 2.4)
ROOM = RoomModel(
    source="given",
    floor=((LOW[0], LOW[1]), (HIGH[0], LOW[1]), (HIGH[0], HIGH[1]), (LOW[0], HIGH[1])),
    camera_height_m=1.6,
    ceiling_height_m=2.6,
)
WINDOW = Patch("front", -0.9, 0.4, 0.9, 2.1, 20.0, 0.2)
SECOND = Patch("front", 0.8, 1.4, 0.9, 2.1, 20.0, 0.2)
DOOR = Patch("left", -1.0, -0.2, 0.0, 2.0, 0.3)


def evidence_of(drawn: Drawn, classes: tuple[SceneClass, ...]) -> SceneEvidence:
    """Return what a coarse network says: the classes of patches, blurred to 128 rows or fewer."""
    of_face = (SceneClass.WALL,) * 4 + (SceneClass.FLOOR, SceneClass.CEILING)
    label = np.array(of_face)[drawn.face]
    for index, each in enumerate(classes):
        label = np.where(drawn.patch == index + 1, each, label)
    shares = [cv2.resize((label == c).astype(np.float32), (256, 128), interpolation=cv2.INTER_AREA) for c in SceneClass]
    soft = np.stack([cv2.GaussianBlur(share, (0, 0), 1.0) for share in shares]) + 0.01
    return SceneEvidence((soft / soft.sum(axis=0)).astype(np.float32), source="drawn")


def result(patches: tuple[Patch, ...], classes: tuple[SceneClass, ...]) -> tuple[RelativeImage, SceneEvidence]:
    drawn = draw(ROWS, low=LOW, high=HIGH, patches=patches)
    return as_image(drawn.luminance), evidence_of(drawn, classes)


def iou(found: Opening, wall: int, start: float, end: float, sill: float, head: float) -> float:
    if found.wall != wall:
        return 0.0
    across = max(0.0, min(found.end_m, end) - max(found.start_m, start))
    up = max(0.0, min(found.head_m, head) - max(found.sill_m, sill))
    both = (found.end_m - found.start_m) * (found.head_m - found.sill_m) + (end - start) * (head - sill)
    return across * up / (both - across * up)


@pytest.mark.parametrize(("reveal", "least"), [(2.0, 0.85), (0.65, 0.7)])
def test_windows_in_a_reveal_and_a_door_are_found_whole(reveal: float, least: float) -> None:
    """Reveals lit through the window, as by day; and ones of the wall's tone, whose outer edge hardly shows."""
    lit = tuple(replace(one, reveal=reveal) for one in (WINDOW, SECOND))
    image, evidence = result((*lit, DOOR), (SceneClass.WINDOW, SceneClass.WINDOW, SceneClass.DOOR))
    found = find_openings(image, evidence, ROOM)
    assert sorted(o.kind for o in found) == [OpeningKind.DOOR, OpeningKind.WINDOW, OpeningKind.WINDOW]
    assert not geometry_problems(ROOM.model_copy(update={"openings": found}))
    # The front wall is wall 2 and runs from x = 1.6 to -2.0; the left one is wall 3, from y = 2.4 to -1.5.
    windows = [o for o in found if o.kind is OpeningKind.WINDOW]
    assert max(iou(o, 2, 1.2, 2.5, 0.9, 2.1) for o in windows) > 0.85
    assert max(iou(o, 2, 0.2, 0.8, 0.9, 2.1) for o in windows) > least
    door = next(o for o in found if o.kind is OpeningKind.DOOR)
    assert door.sill_m == 0
    assert iou(door, 3, 2.6, 3.4, 0.0, 2.0) > 0.8
    assert all(0.2 < o.confidence <= 1 for o in found)


def test_a_door_of_which_our_network_alone_is_sure_is_found_in_a_mean_with_another() -> None:
    image, sure = result((WINDOW, DOOR), (SceneClass.WINDOW, SceneClass.DOOR))
    other = result((WINDOW, DOOR), (SceneClass.WINDOW, SceneClass.WALL))[1].probabilities
    mean = replace(sure, probabilities=0.3 * sure.probabilities + 0.7 * other)
    assert [o.kind for o in find_openings(image, mean, ROOM)] == [OpeningKind.WINDOW]
    by_ours = find_openings(image, replace(mean, own=sure.probabilities), ROOM)
    (door,) = (one for one in by_ours if one.kind is OpeningKind.DOOR)
    assert iou(door, 3, 2.6, 3.4, 0.0, 2.0) > 0.8
    assert len(find_openings(image, replace(sure, own=sure.probabilities), ROOM)) == 2, "seen by both, it is one door"


def test_plain_wall_between_and_beside_windows_is_no_window_whatever_the_network_says() -> None:
    wall = [Patch("front", x0, x1, 0.9, 2.1, 0.5) for x0, x1 in ((0.4, 0.8), (-1.6, -0.9))]
    image, evidence = result((WINDOW, SECOND, *wall), (SceneClass.WINDOW,) * 4)
    found = find_openings(image, evidence, ROOM)
    assert len(found) == 2
    assert max(iou(o, 2, 1.2, 2.5, 0.9, 2.1) for o in found) > 0.85
    assert max(iou(o, 2, 0.2, 0.8, 0.9, 2.1) for o in found) > 0.7
    curtain = Patch("front", -1.6, -0.9, 0.9, 2.1, 0.45, 0.0)
    beside = Patch("front", -2.0, -1.6, 0.0, 2.6, 0.3)
    image, evidence = result((WINDOW, curtain, beside), (SceneClass.WINDOW, SceneClass.WINDOW, SceneClass.WALL))
    (whole,) = find_openings(image, evidence, ROOM)
    assert whole.end_m > 2.9, "an edge ends the window: a curtain may have the brightness of the wall"


def test_a_glass_door_is_a_window_down_to_the_floor() -> None:
    image, evidence = result((Patch("front", -0.9, 0.4, 0.0, 2.2, 20.0, 0.1),), (SceneClass.WINDOW,))
    (found,) = find_openings(image, evidence, ROOM)
    assert found.kind is OpeningKind.WINDOW
    assert found.sill_m == 0


def test_a_wide_opening_to_another_room_is_a_passage() -> None:
    image, evidence = result((Patch("left", -1.4, 0.6, 0.0, 2.1, 0.2),), (SceneClass.DOOR,))
    assert [o.kind for o in find_openings(image, evidence, ROOM)] == [OpeningKind.PASSAGE]


def test_a_window_of_the_next_room_seen_through_a_passage_is_not_this_rooms() -> None:
    """The passage shows the next room's wall with a window in it, at twice the distance of this room's wall."""
    patches = (WINDOW, Patch("left", -1.4, 0.9, 0.0, 2.2, 0.45), Patch("left", -0.6, 0.3, 0.9, 1.8, 20.0))
    drawn = draw(ROWS, low=LOW, high=HIGH, patches=patches)
    image = as_image(drawn.luminance)
    evidence = evidence_of(drawn, (SceneClass.WINDOW, SceneClass.WALL, SceneClass.WINDOW))
    geometry = Equirectangular(256, 128)
    wall = surface_maps(ROOM, geometry).depth_m / np.float32(ROOM.camera_height_m)
    through = cv2.resize((drawn.patch >= 2).astype(np.float32), (256, 128), interpolation=cv2.INTER_AREA)
    seen = replace(evidence, reach=np.where(through > 0.5, 2 * wall, wall))
    (mine,) = find_openings(image, seen, ROOM)
    assert iou(mine, 2, 1.2, 2.5, 0.9, 2.1) > 0.85
    near = find_openings(image, replace(evidence, reach=wall), ROOM)
    assert len(near) == 2, "in a recess of its own wall it would be this room's"
    assert len(find_openings(image, evidence, ROOM)) == 2, "without distances nothing is dropped"


def test_nothing_is_found_where_nothing_is_and_where_nothing_is_known() -> None:
    image, evidence = result((), ())
    assert find_openings(image, evidence, ROOM) == ()
    unknown = SceneEvidence(np.full((8, 64, 128), 1 / 8, np.float32), source="none")
    assert find_openings(image, unknown, ROOM) == ()


@pytest.mark.parametrize("value", [0.0, 1.6e9])
def test_black_and_blinding_pictures_do_not_break_it(value: float) -> None:
    image, evidence = result((WINDOW,), (SceneClass.WINDOW,))
    flat = replace(image, rgb=np.full_like(image.rgb, value))
    found = find_openings(flat, evidence, ROOM)
    assert not geometry_problems(ROOM.model_copy(update={"openings": found}))


def test_a_blind_belongs_to_its_window() -> None:
    blind = Patch("front", -0.9, 0.4, 1.5, 2.1, 1.5, 0.2)
    image, evidence = result((WINDOW, blind), (SceneClass.WINDOW, SceneClass.FIXTURE))
    (found,) = find_openings(image, evidence, ROOM)
    assert found.head_m > 1.95


def blind_over_a_window(*, blind_m: float, edge: float) -> Candidate:
    """A wall 3 m wide, 2.6 m high, 50 texels a metre: a window from 1.0 m down, a blind from ``blind_m`` to it."""
    share = np.full((len(SceneClass), 130, 150), 0.0, np.float32)
    light = np.zeros((130, 150), np.float32)
    rows, across = slice(round(blind_m * 50), 50), slice(50, 100)
    share[SceneClass.WALL] = 1.0
    share[:, rows, across], share[SceneClass.FIXTURE, rows, across] = 0.0, 1.0
    share[:, 50:100, across], share[SceneClass.WINDOW, 50:100, across] = 0.0, 1.0
    light[rows, across] = edge
    plane = planes_of(ROOM)[2]
    view = WallView(replace(plane, width_m=3.0, height_m=2.6), 50.0, light, np.ones_like(light, bool), share, (1, 1, 2))
    return Candidate(Field(view, KIND), (1.0, 1.0, 2.0, 2.0), 0.0, 1.0)


@pytest.mark.parametrize("edge", [0.0, 0.05, 2.0])
@pytest.mark.parametrize("blind_m", [0.1, 0.3])
def test_a_blind_that_ends_below_the_ceiling_does_not_lift_its_window_to_it(blind_m: float, edge: float) -> None:
    """However faint the blind's upper edge is: the ceiling is 0.1 m above it, and no edge of it counts."""
    (found,) = uncovered([blind_over_a_window(blind_m=blind_m, edge=edge)])
    assert found.box[1] == pytest.approx(blind_m, abs=0.03)
    assert found.box[3] == 2.0


def test_a_window_darker_than_the_sky_allows_is_doubted() -> None:
    image, evidence = result((WINDOW,), (SceneClass.WINDOW,))

    def cd_m2(one: RelativeImage, scale: float) -> LuminanceImage:
        return LuminanceImage(one.rgb * np.float32(scale), one.uncertainty, one.validity, one.geometry, 0.02)

    (plain,) = find_openings(cd_m2(image, 1.0), evidence, ROOM)
    (day,) = find_openings(cd_m2(image, 1.0), evidence, ROOM, outdoor=cd_m2(image, 100.0))
    (never,) = find_openings(cd_m2(image, 1.0), evidence, ROOM, outdoor=cd_m2(image, 1e5))
    assert day.confidence == plain.confidence
    assert never.confidence == pytest.approx(plain.confidence / 2)


def test_a_window_is_brighter_than_its_wall_by_day_and_darker_by_night() -> None:
    """At night the light inside shows nothing of the edges, and the window is found all the same."""
    for luminance, brighter in ((20.0, True), (0.02, False)):
        patch = replace(WINDOW, luminance=luminance)
        image, evidence = result((patch,), (SceneClass.WINDOW,))
        (found,) = find_openings(image, evidence, ROOM)
        assert iou(found, 2, 1.2, 2.5, 0.9, 2.1) > 0.8
        view = next(each for each in wall_views(image, evidence, ROOM) if each.wall == 2)
        assert (brighter_inside(Candidate(Field(view, KIND), (1.1, 0.5, 2.4, 1.7), 0.2, 1.0)) > 0) is brighter


def test_a_board_under_the_window_is_not_the_window() -> None:
    """The lower edge that is seen is taken for a sill board's; a glass door has none."""
    (found,) = find_openings(*result((WINDOW,), (SceneClass.WINDOW,)), ROOM)
    (glass_door,) = find_openings(
        *result((Patch("front", -0.9, 0.4, 0.0, 2.2, 20.0, 0.1),), (SceneClass.WINDOW,)), ROOM
    )
    assert found.sill_m > 0.9
    assert glass_door.sill_m == 0


def test_walls_of_a_large_panorama_are_taken_from_a_smaller_one(monkeypatch: pytest.MonkeyPatch) -> None:
    image, evidence = result((replace(WINDOW, reveal=2.0),), (SceneClass.WINDOW,))
    (fine,) = find_openings(image, evidence, ROOM)
    monkeypatch.setattr("processing.room.wall_views.WIDEST_PX", ROWS)
    (coarse,) = find_openings(image, evidence, ROOM)
    assert coarse != fine
    assert iou(coarse, fine.wall, fine.start_m, fine.end_m, fine.sill_m, fine.head_m) > 0.85


def test_the_border_of_a_cropped_panorama_is_no_edge_of_a_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is known above it, at full size and where walls are taken from a smaller picture."""
    image, evidence = result((), ())
    rgb, validity = image.rgb.copy(), image.validity.copy()
    rgb[: ROWS * 7 // 16], validity[: ROWS * 7 // 16] = 0, Validity.OUTSIDE
    for widest in (2 * ROWS, ROWS):
        monkeypatch.setattr("processing.room.wall_views.WIDEST_PX", widest)
        views = wall_views(replace(image, rgb=rgb, validity=validity), evidence, ROOM)
        assert len(views) == len(ROOM.floor)
        for view in views:
            assert 0.3 < view.known.mean() < 0.9
            inner = np.s_[8 : -len(view.known) // 8]  # without the foot, which is an edge
            assert np.abs(view.edges[1][inner]).max() < 0.5
