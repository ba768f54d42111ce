"""Stills: framed by the rules, in the room's display, with original, light and a statement."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.layout.arrangement import PlacedItem
from processing.pictures.display import Display
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage, Validity
from processing.report import frames as framing
from processing.report.frames import (
    DROPS,
    FEWEST,
    LEAST_EGG,
    LENSES_MM,
    MOST,
    NEAR_M,
    Frame,
    _ceiling_share,
    _near_wall_share,
    _openings,
    _overfilled,
    _pieces,
    _plain_share,
    _seen,
    _stretched,
    aimed,
    with_aimed,
)
from processing.report.stills import _width_px, run
from processing.sphere import directions
from processing.stages.parameters import StillsParameters
from processing.surfaces.maps import wall_ranges
from tests.once import all_anew, once
from tests.processing.report.made_up import context, results

frames_of = once(framing.frames_of)
"""Several tests look at the frames of one room."""

ROOM = RoomModel(
    source="given",
    floor=((-4.0, -1.5), (1.5, -1.5), (1.5, 2.5), (-4.0, 2.5)),
    camera_height_m=1.5,
    ceiling_height_m=2.6,
    openings=(Opening(kind=OpeningKind.WINDOW, wall=3, start_m=1.0, end_m=2.6, sill_m=0.9, head_m=2.1),),
)


def piece(name: str, x: float, y: float, size: tuple[float, float, float]) -> PlacedItem:
    return PlacedItem(id=name, category=name, size_m=size, t_m=(x, y, 0.0), theta_rad=0.3)


ITEMS = (
    piece("bed", -2.8, 1.2, (1.6, 2.0, 0.9)),
    piece("chair", -2.5, -0.8, (0.6, 0.6, 0.9)),
    piece("wardrobe", 0.4, 0.5, (1.0, 0.6, 2.1)),
)


def test_frames_are_level_of_the_trades_lenses_apart_and_show_main_pieces_whole() -> None:
    frames = frames_of(ROOM, ITEMS)
    assert FEWEST <= len(frames) <= MOST
    assert {frame.lens_mm for frame in frames} <= set(LENSES_MM)
    assert all(frame.view().pitch_rad == 0 for frame in frames)
    yaws = [frame.yaw_rad for frame in frames]
    apart = [abs(math.remainder(a - b, math.tau)) for k, a in enumerate(yaws) for b in yaws[:k]]
    assert min(apart) > math.radians(29)
    assert "bed" in frames[0].shows
    assert "chair" in {name for frame in frames for name in frame.shows}
    with all_anew():
        assert frames_of(ROOM, ITEMS) == frames
    # Where others follow, frames that are worth little are not taken to make up a number.
    alone = frames_of(ROOM, ITEMS, fewest=1)
    assert alone == frames[: len(alone)]
    assert 1 <= len(alone) <= len(frames)
    assert len(frames_of(ROOM, (), fewest=1)) < FEWEST == len(frames_of(ROOM, ()))


def test_a_door_near_the_camera_is_kept_out_of_frames() -> None:
    """It fills a picture's edge, mostly open to a dark hall; a far one costs nothing."""

    def with_door(wall: int, start_m: float) -> RoomModel:
        door = Opening(kind=OpeningKind.DOOR, wall=wall, start_m=start_m, end_m=start_m + 0.9, sill_m=0.0, head_m=2.0)
        return ROOM.model_copy(update={"openings": (*ROOM.openings, door)})

    near, far = with_door(0, 1.8), with_door(3, 2.8)
    seen = [_seen(frame, _openings(near), near) for frame in frames_of(ROOM, ITEMS, FEWEST)]
    assert any(states[1] != 0 for states in seen), "a frame would show it"
    assert not any(_seen(frame, _openings(near), near)[1] for frame in frames_of(near, ITEMS, FEWEST))
    assert [thing.name for thing in _openings(far)] == ["window"]


def test_columns_of_plain_wall_count_against_a_frame() -> None:
    """Pieces and the window are to the left: to the right there is bare wall; the wardrobe's side comes before it."""
    things = [*_pieces(ITEMS), *_openings(ROOM)]
    assert _plain_share(Frame(math.radians(150), 24.0, 0.0), things, ROOM) == 1.0
    shares = [_plain_share(frame, things, ROOM) for frame in frames_of(ROOM, ITEMS)]
    assert shares[0] < 0.35
    assert sorted(shares)[1] < 0.35


def test_a_staged_frame_shows_what_was_staged_though_it_is_near_and_cut() -> None:
    """A small dining room: the table is too near to be whole; without it the frame is of the window, behind."""
    small = ROOM.model_copy(
        update={
            "floor": ((-0.9, -1.5), (2.3, -1.5), (2.3, 2.1), (-0.9, 2.1)),
            "openings": (Opening(kind=OpeningKind.WINDOW, wall=0, start_m=0.8, end_m=2.4, sill_m=0.9, head_m=2.1),),
        }
    )
    table = piece("dining table", 1.5, 0.3, (1.4, 0.8, 0.74)), piece("chair", 1.8, 1.0, (0.45, 0.5, 0.85))
    best = frames_of(small, table, 1, 1)[0]
    assert _plain_share(best, _pieces(table), small) < 0.5
    assert _plain_share(frames_of(small, (), 1, 1)[0], _pieces(table), small) > 0.6


def test_the_ceiling_does_not_fill_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a large low room frames were a third ceiling and more; the share by the sphere's rays."""
    floor = tuple((2 * x, 2 * y) for x, y in ROOM.floor)
    low = ROOM.model_copy(update={"ceiling_height_m": 2.4, "camera_height_m": 1.6, "floor": floor})
    apart = [one.model_copy(update={"t_m": (2 * one.t_m[0], 2 * one.t_m[1], 0.0)}) for one in ITEMS]
    frames = framing.frames_of(low, apart)
    for frame in frames:
        view = frame.view(300)
        rays = directions(view)[0][-frame.height_px(300) :]
        away_m = wall_ranges(low.floor, np.arctan2(rays[..., 0], rays[..., 1]).ravel())[0].reshape(rays.shape[:2])
        seen = rays[..., 2] / np.hypot(rays[..., 0], rays[..., 1]) * away_m > 0.8
        assert _ceiling_share([frame], low)[0] == pytest.approx(seen.mean(), abs=0.01)
        assert seen.mean() < 0.16
    monkeypatch.setattr(framing, "CEILING", 0.0)
    assert _ceiling_share(framing.frames_of(low, apart), low).min() > 0.3


def test_a_table_that_the_camera_stands_by_is_cut_rather_than_left_out() -> None:
    """No frame shows it whole; by the cost to cut a main piece, the frame was of the window, with no piece in it."""
    small = ROOM.model_copy(
        update={
            "floor": ((2.3, -1.5), (2.15, 2.1), (-1.0, 1.95), (-0.9, -1.6)),
            "camera_height_m": 1.6,
            "openings": (
                Opening(kind=OpeningKind.WINDOW, wall=3, start_m=1.05, end_m=2.5, sill_m=0.9, head_m=2.1),
                Opening(kind=OpeningKind.DOOR, wall=0, start_m=0.19, end_m=0.81, sill_m=0.0, head_m=2.0),
            ),
        }
    )
    chair, case = (0.45, 0.5, 0.85), (0.85, 0.35, 1.8)
    items = [piece("dining table", 1.16, 0.37, (1.4, 0.8, 0.74)), piece("bookshelf", -0.85, 1.56, case)]
    items += [piece("dining chair", x, y, chair) for x, y in ((1.48, 1.03), (0.78, 1.0), (1.54, -0.27), (0.84, -0.3))]
    turns = {"dining table": -3.1, "bookshelf": -1.53, "dining chair": -3.1}
    turned = [one.model_copy(update={"theta_rad": turns[one.category]}) for one in items]
    best = frames_of(small, tuple(turned), 1, 1)[0]
    assert _seen(best, _pieces(turned), small)[0] == -1, "the table, cut"
    assert abs(math.remainder(best.yaw_rad - math.atan2(1.16, 0.37), 2 * math.pi)) < math.radians(30)


def test_a_tall_piece_or_a_seat_s_back_does_not_fill_a_frame() -> None:
    """Without their cost the frame would look 36 degrees further to the right, where they fill a third of it."""
    away = piece("desk chair", -0.5, 1.5, (0.6, 0.6, 0.95)).model_copy(update={"theta_rad": 0.32})
    for large in (piece("wardrobe", -0.8, 2.0, (1.0, 0.6, 2.1)), away):
        best = frames_of(ROOM, (ITEMS[0], large), 1, 1)[0]
        assert best.shows == ("bed",)
        assert _overfilled(best, _pieces([large]), ROOM) == 0
        assert _overfilled(Frame(math.radians(-48), 18.0, 0.0), _pieces([large]), ROOM) > 0.05
    towards = away.model_copy(update={"theta_rad": 0.32 + math.pi})
    assert _overfilled(Frame(math.radians(-20), 18.0, 0.0), _pieces([towards]), ROOM) == 0


def test_an_alternatives_first_frame_shows_its_main_piece_whole() -> None:
    bed = piece("bed", -1.0, 2.1, (1.6, 2.0, 0.9)).model_copy(update={"theta_rad": -1.3})
    small = (piece("desk", -2.8, 0.5, (1.2, 0.6, 0.74)), piece("chest", -3.0, -0.9, (0.9, 0.45, 0.85)))
    for most in (1, MOST):
        assert "bed" in frames_of(ROOM, (bed, *small), most, 1)[0].shows


def test_a_near_wall_does_not_fill_a_frame_of_a_room_with_wings() -> None:
    """What it hides is not counted as seen, and a third frame finds something else than half a picture of wall."""
    winged = ROOM.model_copy(
        update={"floor": ((-4.0, -1.5), (3.0, -1.5), (3.0, 4.0), (0.6, 4.0), (0.6, 1.0), (-4.0, 1.0))}
    )
    near, far = Frame(math.radians(10), 20.0, 0.08), Frame(math.radians(-100), 20.0, 0.08)
    assert _near_wall_share(near, winged) > 0.4
    assert _near_wall_share(far, winged) == 0.0
    # Seen past the wall's edge, with the wall before half of it: without the rule, one of the frames.
    items = (*ITEMS[:2], piece("cupboard", 1.6, 3.4, (1.6, 0.5, 0.9)), piece("sofa", 2.2, 1.2, (0.9, 1.8, 0.8)))
    assert max(_near_wall_share(frame, winged) for frame in frames_of(winged, items)) < 0.3


def test_what_stands_in_a_wing_behind_a_wall_is_not_counted_as_seen() -> None:
    winged = ROOM.model_copy(
        update={"floor": ((-4.0, -1.5), (1.5, -1.5), (1.5, 2.5), (-1.0, 2.5), (-1.0, 6.0), (-4.0, 6.0))}
    )
    hidden, seen = piece("sofa", -1.5, 5.5, (1.8, 0.9, 0.8)), piece("shelf", -3.5, 5.0, (0.6, 0.4, 1.2))
    shown = {name for one in frames_of(winged, (*ITEMS, hidden, seen)) for name in one.shows}
    assert {"bed", "shelf"} <= shown
    assert "sofa" not in shown
    assert not aimed(f"{math.degrees(math.atan2(-1.5, 5.5))},16", winged, (hidden,))[0].shows


def test_frames_that_were_aimed_come_first_and_others_look_elsewhere() -> None:
    own = aimed(StillsParameters(aim="-60,20,.08;120.5,24").aim, ROOM, ITEMS)
    assert [(round(math.degrees(one.yaw_rad), 6), one.lens_mm, one.drop) for one in own] == [
        (-60, 20, 0.08),
        (120.5, 24, 0),
    ]
    best = frames_of(ROOM, ITEMS)[0]
    again = aimed(f"{math.degrees(best.yaw_rad)},{best.lens_mm},{best.drop}", ROOM, ITEMS)
    assert again[0].shows == best.shows
    frames = with_aimed(own, frames_of(ROOM, ITEMS))
    assert frames[:2] == own
    assert 2 < len(frames) <= MOST
    apart = [abs(math.remainder(a.yaw_rad - b.yaw_rad, math.tau)) for a in frames[2:] for b in own]
    assert min(apart) > math.radians(29)
    for wrong in ("10", "10,20,0.1,3", "a,b", "1.2.3,20"):
        with pytest.raises(ValueError, match="aim"):
            StillsParameters(aim=wrong)
    for impossible in ("0,5", "0,20;0,51", "0,20,0.31"):
        with pytest.raises(ValueError, match=r"a lens has 12 to 50 mm, a drop is 0 to 0\.3"):
            StillsParameters(aim=impossible)


def test_a_piece_said_to_be_whole_is_within_the_frame_by_the_spheres_geometry() -> None:
    shown = [name for frame in frames_of(ROOM, ITEMS) for name in frame.shows]
    assert shown
    for frame in frames_of(ROOM, ITEMS):
        view = frame.view(300)
        rays, _ = directions(view)
        rays = rays[-frame.height_px(300) :].reshape(-1, 3)
        for item in ITEMS:
            if item.id not in frame.shows:
                continue
            x, y, z = item.size_m
            c, s = math.cos(item.theta_rad), math.sin(item.theta_rad)
            for sx, sy, sz in ((a, b, h) for a in (-0.5, 0.5) for b in (-0.5, 0.5) for h in (0, 1)):
                px, py = sx * x * c - sy * y * s + item.t_m[0], sx * x * s + sy * y * c + item.t_m[1]
                ray = np.array([px, py, sz * z - ROOM.camera_height_m])
                nearest = float((rays @ (ray / np.linalg.norm(ray))).max())
                assert nearest > math.cos(math.radians(0.6)), (item.id, frame)


def test_what_stands_at_the_camera_is_no_main_piece_and_a_bare_room_has_frames() -> None:
    near = (piece("wardrobe", 0.4, 0.5, (1.0, 0.6, 2.1)), ITEMS[1])
    assert math.hypot(0.4, 0.5) < NEAR_M
    assert "chair" in frames_of(ROOM, near)[0].shows
    assert len(frames_of(ROOM, ())) >= FEWEST


def test_a_still_has_no_more_pixels_than_its_panorama_shows() -> None:
    """A draft's stills were enlarged up to four times, and their edges were stairs."""
    wide = {}
    for panorama in (1680, 3360, 6720, 8192):
        image = SimpleNamespace(rgb=np.empty((0, panorama, 3)))
        wide[panorama] = [_width_px(image, Frame(0.0, mm, 0.0), 1280, 1920, 1.5) for mm in (24.0, 16.0)]
    assert wide == {1680: [1280, 1280], 3360: [1280, 1804], 6720: [1920, 1920], 8192: [1920, 1920]}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    given = context(tmp_path_factory.mktemp("session"), results())
    long = given.session.model_copy(update={"name": ('"Büro" <b>🛋</b> & مكتب ' * 25)[:500]})  # as long as names can be
    given = replace(given, session=long, parameters=StillsParameters(original_url="https://example.org/7"))
    return given.folder, dict(run(given).artifacts)


def test_each_still_has_its_original_its_light_and_says_what_was_changed(made: tuple[Path, dict[str, object]]) -> None:
    folder, artifacts = made
    facts = artifacts["stills"]
    assert isinstance(facts, dict)
    stills = facts["stills"]
    assert [one["state"] for one in stills].count("staged-1") >= 2
    assert len(stills) >= FEWEST
    assert [one["state"] for one in stills].count("staged-2") == 1
    for one in stills:
        data = (folder / one["file"]).read_bytes()
        with Image.open(io.BytesIO(data)) as opened:
            assert opened.size == (1280, 853) == tuple(one["size_px"]), "of a small panorama"
        assert b"compositeSynthetic" in data
        for element in ("virtual", "removed digitally", "Unaltered original: https://example.org/7"):
            assert element in one["statement"]
            assert element.encode() in data
        original = (folder / one["original"]).read_bytes()
        assert b"compositeSynthetic" not in original
        light = read_exr(folder / one["light"])
        assert isinstance(light, LuminanceImage)
        assert light.rgb.shape[1] <= 960
    assert Display.read(artifacts["display"]).source  # type: ignore[arg-type]


def test_emptied_stills_have_the_plate_with_the_code_and_the_statement(tmp_path: Path) -> None:
    """California AB 723's four elements: a statement; on the picture; a link; the original, named and unaltered."""
    emptied = {name: part for name, part in results().items() if name not in ("arrange", "render")}
    for url, folder in (("https://example.org/7", "a"), (None, "b")):
        (tmp_path / folder).mkdir()
        given = context(tmp_path / folder, emptied)
        stills = run(replace(given, parameters=StillsParameters(original_url=url))).artifacts["stills"]["stills"]  # type: ignore[index]
        assert {one["state"] for one in stills} == {"emptied"}
        for one in stills:
            data = (given.folder / one["file"]).read_bytes()
            assert f"Unaltered original: {url or one['original']}".encode() in data
            assert b"removed digitally" in data
            assert b'daylit:Staged="True"' not in data
            corner = np.asarray(Image.open(io.BytesIO(data)))[-400:, :500]
            original = np.asarray(Image.open(given.folder / one["original"]))[-400:, :500]
            code = cv2.QRCodeDetector().detectAndDecode(np.ascontiguousarray(corner))[0]
            assert code == (url or "")
            assert np.abs(corner.astype(int) - original)[-80:].max() > 60
            unaltered = (given.folder / one["original"]).read_bytes()
            assert b"compositeSynthetic" not in unaltered
            assert b"removed digitally" not in unaltered


def test_without_furniture_or_room_the_photograph_is_framed_and_says_nothing(tmp_path: Path) -> None:
    bare = {name: part for name, part in results().items() if name in ("merge", "calibrate")}
    given = context(tmp_path, bare)
    found = run(replace(given, parameters=StillsParameters()))
    stills = found.artifacts["stills"]["stills"]  # type: ignore[index]
    assert [one["state"] for one in stills] == ["photograph"] * 3
    assert not any(one["statement"] for one in stills)
    assert b"compositeSynthetic" not in (given.folder / "still-1.jpg").read_bytes()


def test_light_that_was_clipped_is_clipped_in_the_still(tmp_path: Path) -> None:
    bare = {name: dict(part) for name, part in results().items() if name in ("merge", "calibrate")}
    indoor = bare["calibrate"]["indoor"]
    validity = np.zeros(indoor.rgb.shape[:2], np.uint8)
    validity[: len(validity) // 2] = Validity.CLIPPED  # all above the horizon
    bare["calibrate"]["indoor"] = replace(indoor, validity=validity)
    given = context(tmp_path, bare)
    run(replace(given, parameters=StillsParameters()))
    light = read_exr(given.folder / "still-1-light.exr")
    middle = len(light.validity) // 2
    assert (light.validity[: middle - 2] == Validity.CLIPPED).all()
    assert (light.validity[middle + 2 :] == Validity.VALID).all()


class Kept:
    """Parts of a result as a run keeps them for the next: by what they depend on."""

    def __init__(self) -> None:
        self.facts: dict[str, Any] = {}

    def part(self, name: str, files: tuple[str, ...], own: Any, make: Callable[[], Any], apart: str = "") -> Any:
        key = json.dumps([name, files, own])
        if key not in self.facts:
            self.facts[key] = make()
        return self.facts[key]

    def enough(self) -> bool:
        return False


def test_stills_of_an_alternative_that_has_not_changed_are_kept_and_its_picture_is_not_read(tmp_path: Path) -> None:
    kept, read = Kept(), list[str]()
    given = context(tmp_path, results())

    def fetch(stage: str, name: str) -> Any:
        read.append(name)
        return given.fetch(stage, name)

    given = replace(given, parameters=StillsParameters(), parts=kept)
    first = run(replace(given, fetch=fetch)).artifacts["stills"]
    assert {"staged-1", "staged-2"} <= set(read)
    read.clear()
    assert run(replace(given, fetch=fetch)).artifacts["stills"] == first
    assert not any(name.startswith("staged-") for name in read)
    unlabelled = StillsParameters(no_staged_label=True)
    run(replace(given, fetch=fetch, parameters=unlabelled))
    assert "staged-1" in read


def test_a_piece_near_the_camera_is_whole_where_the_lens_is_shifted_further_down() -> None:
    """A low bench 2.5 m away: at 24 mm only the largest shift has its feet in the picture."""
    bench = piece("bench", 0.0, 2.5, (0.9, 0.4, 0.5))
    whole = [_seen(Frame(0.0, 24.0, drop), _pieces((bench,)), ROOM)[0] == 1 for drop in DROPS]
    assert whole == [False, False, False, True]


def test_round_things_are_kept_out_of_the_corners_of_wide_pictures() -> None:
    """A globe lamp near the edge of a picture of 18 mm was an egg."""
    ahead, aside = (piece("table lamp", x, 2.0, (0.4, 0.4, 0.45)) for x in (0.0, 1.7))
    wide, long = Frame(0.0, 16.0, 0.0), Frame(0.0, 24.0, 0.0)
    assert _stretched(wide, [ahead], ROOM) < 0.3 * _stretched(wide, [aside], ROOM)
    assert _stretched(wide, [aside], ROOM) == pytest.approx(math.hypot(2.0, 1.7, 1.275) / 2.0 - LEAST_EGG, rel=0.01)
    assert _stretched(long, [aside], ROOM) == 0.0, "it is out of the picture"
    assert _stretched(Frame(math.radians(40), 16.0, 0.0), [aside], ROOM) < 0.5 * _stretched(wide, [aside], ROOM)
    lamps = [replace_place(lamp, x) for lamp, x in ((aside, -3.2), (aside, -1.4))]
    drawn_out = [
        sum(_stretched(frame, lamps, ROOM) for frame in framing.frames_of(ROOM, ITEMS, 1, 1, added))
        for added in ((), lamps)
    ]
    assert drawn_out[1] <= drawn_out[0]


def replace_place(lamp: PlacedItem, x: float) -> PlacedItem:
    return lamp.model_copy(update={"t_m": (x, 2.0, 0.5)})
