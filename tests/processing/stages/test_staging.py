"""The stages materials, arrange and render on a small room: what they make, keep, leave out and say."""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import ItemError, PinError, ProcessingError
from processing.ground.room_model import Opening, OpeningKind, RoomModel, geometry_problems
from processing.ground.threads import ASKED, threads
from processing.layout.assumed import fitting_choice, named_choice, with_door
from processing.layout.furniture.bench import STYLES
from processing.layout.items import KINDS, SETS
from processing.layout.rules import built_in_rules
from processing.light.picture.composite import MODELLED
from processing.light.picture.render import render
from processing.light.scene.room_light import EmptyRoom
from processing.light.scene.scene import Sun
from processing.light.scene.scene_file import read_scene
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.pictures.exr import read_exr, write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.modes import SHARED_OF_MODELLED
from processing.pictures.writing import handed_on
from processing.pipeline import stage_named
from processing.running.artifacts import load, save
from processing.sphere import Equirectangular
from processing.stages import arrange, materials
from processing.stages import render as rendering
from processing.stages.contract import Quality, StageContext
from processing.stages.parameters import (
    ArrangeParameters,
    MaterialsParameters,
    RenderParameters,
    StageParameters,
    options_of,
)
from processing.surfaces.hanging import Hanging
from tests.processing.light.rooms import EYE, box_room, scene_of, uniform_sky
from tests.processing.pictures.picture_strategies import luminance_image

ROWS = 48
LOOK = Effort(texel_m=0.3, patch_samples=32, rows=ROWS, pixel_samples=32, clean=False)
HARDLY = Effort(texel_m=1.0, patch_samples=1, rows=ROWS, pixel_samples=1, clean=False)
DOOR = Opening(kind=OpeningKind.DOOR, wall=2, start_m=0.2, end_m=1.1, sill_m=0.0, head_m=2.05)
ROOM = box_room().model_copy(update={"openings": (*box_room().openings, DOOR)})


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """Little work, no denoiser: these tests ask what is done, not how well."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "QUALITY", {"draft": LOOK})
        patch.setattr(materials, "ROWS", {"draft": ROWS})
        patch.setattr(materials, "EFFORT", LOOK)
        yield


@pytest.fixture(scope="module")
def photograph() -> LuminanceImage:
    scene = scene_of(ROOM, uniform_sky(4000.0), 0.5, reveal_m=0.2)
    rgb = render(scene, Equirectangular(2 * ROWS, ROWS), EYE, effort=LOOK).rgb
    shape = rgb.shape[:2]
    doubt = np.full(shape, 0.02, np.float32)
    return LuminanceImage(rgb, doubt, np.zeros(shape, np.uint8), Equirectangular(2 * ROWS, ROWS), 0.02)


def context(
    folder: Path,
    parameters: StageParameters,
    artifacts: Mapping[tuple[str, str], Any],
    *,
    name: str = "coda-320",
    **more: Any,
) -> StageContext:
    session: Any = SimpleNamespace(name=name, heading_rad=None)
    return StageContext(
        session=session,
        session_path=folder,
        folder=folder,
        parameters=parameters,
        fetch=lambda stage, what: artifacts.get((stage, what)),
        summary=lambda _stage: {"left_out": {}, "skipped": ""},
        quality=Quality.DRAFT,
        **more,
    )


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory, photograph: LuminanceImage) -> dict[tuple[str, str], Any]:
    """What the stages before render have made."""
    found: dict[tuple[str, str], Any] = {
        ("calibrate", "indoor"): photograph,
        ("room", "room"): ROOM,
    }
    folder = tmp_path_factory.mktemp("materials")
    made = materials.run(context(folder, MaterialsParameters(), found))
    found["materials", "scene"] = folder / "scene.npz"
    found["materials", "materials"] = made.artifacts["materials"]
    folder = tmp_path_factory.mktemp("arrange")
    laid = arrange.run(context(folder, ArrangeParameters(items="bed, nightstand, tv stand", alternatives=1), found))
    found["arrange", "arrangement"] = laid.artifacts["arrangement"]
    return found


def test_without_a_picture_of_the_sky_the_windows_light_the_room(known: dict[tuple[str, str], Any]) -> None:
    result = known["materials", "materials"]
    assert result["outdoors"] == "windows as they appear from inside"
    scene = read_scene(known["materials", "scene"])
    assert scene.outdoors.sun is None
    assert all(pane.veil_cd_m2.mean() > 100 for pane in scene.panes)
    walls = [s["albedo"] for s in result["surfaces"] if s["name"].startswith("wall")]
    assert np.median(walls) == pytest.approx(0.5, abs=0.12)
    assert result["units"] == "cd/m2"


def test_render_puts_furniture_in_and_keeps_the_rest(tmp_path: Path, known: dict[tuple[str, str], Any]) -> None:
    made = rendering.run(context(tmp_path, RenderParameters(style="mid-century"), known, max_error=0.5))
    staged = read_exr(tmp_path / "staged-1.exr")
    before = handed_on(known["calibrate", "indoor"])
    result = made.artifacts["staged"]["alternatives"][0]  # type: ignore[index]
    assert staged.attributes["staged"] is True
    assert set(result["items"]) == {"bed", "nightstand", "tv-stand"}
    assert 0.01 < result["furniture_share"] < 0.5
    same = (staged.rgb == before.rgb).all(axis=2)
    assert same.mean() == pytest.approx(1 - result["changed_share"], abs=1e-4)
    assert (staged.uncertainty[~same] > before.uncertainty[~same]).all()
    assert "reached" in made.honoured["max_error"]
    assert made.left_out["staged-2"]
    assert (tmp_path / "staged-1.glb").read_bytes()[:4] == b"glTF"


def test_what_hangs_on_the_ceiling_is_drawn_before_furniture(
    tmp_path: Path, known: dict[tuple[str, str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering, "QUALITY", {"draft": HARDLY})
    row, column = (one.ravel() for one in np.mgrid[16:40, 20:80])
    mount, before = (5, 50), handed_on(known["calibrate", "indoor"]).rgb

    def hangs(_room: RoomModel, _rgb: np.ndarray, places: list[Any] | None) -> Iterator[Hanging]:
        assert places == [[1.0, 1.0]]
        yield Hanging(row, column, np.ones(len(row), np.float32), mount, 0.01)

    monkeypatch.setattr(rendering, "hanging", hangs)
    facts = {"left_out": {}, "skipped": "", "metrics": {"on_ceiling": [[1.0, 1.0]]}}
    asked = replace(context(tmp_path, RenderParameters(styling="none"), known), summary=lambda _: facts)
    rendering.run(asked)
    staged = read_exr(tmp_path / "staged-1.exr").rgb
    shown = staged[row, column] / before[row, column]
    np.testing.assert_allclose(shown, np.broadcast_to(staged[mount] / before[mount], shown.shape), rtol=0.02)


def test_an_alternative_is_written_during_the_next_ones_light(
    tmp_path: Path, known: dict[tuple[str, str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And before the next one is drawn; however many threads there are, the files are the same bytes."""
    monkeypatch.setattr(rendering, "QUALITY", {"draft": HARDLY})
    arranged = known["arrange", "arrangement"]
    found = {
        **known,
        ("arrange", "arrangement"): arranged.model_copy(update={"arrangements": 2 * arranged.arrangements}),
    }
    order, second = list[str](), threading.Event()

    def noted(name: str) -> None:
        real = getattr(rendering, name)

        def call(*given: Any, **more: Any) -> Any:
            order.append(name)
            if name == "_write" and threads() > 1:
                assert second.wait(60), "the second one's light waits for the first one's file"
            made = real(*given, **more)
            order.append(f"{name} done")
            if order.count("changed done") == 2:
                second.set()
            return made

        monkeypatch.setattr(rendering, name, call)

    for name in ("changed", "draw", "_write"):
        noted(name)
    files = []
    for count in ("1", "2"):
        folder = tmp_path / count
        folder.mkdir()
        monkeypatch.setenv(ASKED, count)
        order.clear()
        second.clear()
        rendering.run(context(folder, RenderParameters(), found))
        files.append({path.name: path.read_bytes() for path in folder.iterdir()})
        drawn = [at for at, what in enumerate(order) if what == "draw"]
        assert order.index("_write done") < drawn[1]
    assert files[0] == files[1]
    assert len(files[0]) == 4


def test_a_room_that_was_corrected_since_is_styled_as_it_is_now(
    tmp_path: Path, known: dict[tuple[str, str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arrangement that was given holds the plan that it was made on: a picture would hang in the new window."""
    monkeypatch.setattr(rendering, "QUALITY", {"draft": HARDLY})
    window = Opening(kind=OpeningKind.WINDOW, wall=1, start_m=1.2, end_m=2.9, sill_m=0.9, head_m=2.1)
    corrected = ROOM.model_copy(update={"openings": (*ROOM.openings, window)})
    wider = ROOM.model_copy(update={"floor": tuple((1.2 * x, y) for x, y in ROOM.floor)})

    def added(room: RoomModel) -> list[dict[str, Any]]:
        asked = context(tmp_path, RenderParameters(style="mid-century"), {**known, ("room", "room"): room})
        return list(rendering.run(asked).artifacts["staged"]["alternatives"][0]["added"])  # type: ignore[index]

    def upon_glass(every: list[dict[str, Any]]) -> list[str]:
        beside = [one for one in every if one["t_m"][0] > 2.3 and one["category"] in ("art", "mirror")]
        return [one["id"] for one in beside if -0.8 < one["t_m"][1] < 0.9]

    assert upon_glass(added(ROOM))
    assert not upon_glass(now := added(corrected))
    assert any(one["category"].startswith("curtain") and one["t_m"][0] > 2.2 for one in now)
    assert max(one["t_m"][0] for one in added(wider) if one["category"] == "art") > 2.8, (
        "on the wall, where that is now"
    )


def test_a_relative_picture_is_staged_in_relative_units(tmp_path: Path, known: dict[tuple[str, str], Any]) -> None:
    relative = {**known, ("calibrate", "indoor"): replace(known["calibrate", "indoor"], absolute=False)}
    made = rendering.run(context(tmp_path, RenderParameters(), relative))
    assert not read_exr(tmp_path / "staged-1.exr").absolute  # type: ignore[union-attr]
    assert made.artifacts["staged"]["units"] == "relative units"  # type: ignore[index]


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ({"set": "bedrom"}, ValidationError),
        ({"rules": "tigth"}, ValidationError),
        ({"items": "bed, nightstnd"}, ItemError),
        ({"items": ""}, ItemError),
        ({"pin": "bed=1,2"}, PinError),
    ],
)
def test_a_misspelt_word_is_refused_before_any_stage_runs(words: dict[str, str], kind: type[Exception]) -> None:
    """A room was merged, emptied and lit, for minutes, before `--set bedrom` was found to be none."""
    with pytest.raises(kind):
        ArrangeParameters(**words)  # type: ignore[arg-type]


def test_the_words_offered_are_those_that_there_are() -> None:
    def offered(row: type[StageParameters], name: str) -> set[str]:
        return set(next(one.choices for one in options_of(row) if one.name == name))

    assert offered(ArrangeParameters, "set") == {*SETS, "auto", "none"}
    assert offered(ArrangeParameters, "rules") == set(built_in_rules().sets)
    assert offered(RenderParameters, "style") == set(STYLES)


def test_what_is_skipped_and_why(tmp_path: Path, known: dict[tuple[str, str], Any]) -> None:
    none = MaterialsParameters(set="none")
    assert "no staging requested" in str(materials.nothing_to_stage(context(tmp_path, none, known)))
    sunny = {**known, ("detect", "sunlight"): np.ones((ROWS, 2 * ROWS), bool)}
    assert "no staging requested" in str(materials.nothing_to_stage(context(tmp_path, none, sunny))), (
        "it is still there"
    )
    sunny["remove", "empty"] = known["calibrate", "indoor"]
    assert materials.nothing_to_stage(context(tmp_path, none, sunny)) is None, "an emptied room gets its sun back"
    sunny["detect", "sunlight"] = np.zeros((ROWS, 2 * ROWS), bool)
    assert "no sunlight" in str(materials.nothing_to_stage(context(tmp_path, none, sunny)))
    assert (
        arrange.nothing_to_arrange(context(tmp_path, ArrangeParameters(set="none"), known)) == "no furniture requested"
    )
    assert arrange.nothing_to_arrange(context(tmp_path, ArrangeParameters(set="none", items="bed"), known)) is None
    assert "no room" in str(materials.nothing_to_stage(context(tmp_path, MaterialsParameters(), {})))
    assert "no scene" in str(rendering.nothing_to_render(context(tmp_path, RenderParameters(), {})))
    bare = {key: value for key, value in known.items() if key[0] != "arrange"}
    assert "no arrangement" in str(rendering.nothing_to_render(context(tmp_path, RenderParameters(), bare)))
    assert rendering.nothing_to_render(context(tmp_path, RenderParameters(), known)) is None


def test_sunlight_stands_again_but_where_furniture_hid_it(photograph: LuminanceImage, tmp_path: Path) -> None:
    shape = photograph.rgb.shape[:2]
    sun, hidden = np.zeros(shape, bool), np.zeros(shape, bool)
    sun[30:34, 10:20], hidden[30:34, 16:26] = True, True
    empty = replace(photograph, rgb=np.where((sun | hidden)[..., None], np.float32(1.0), photograph.rgb))
    found = materials.emptied(
        context(
            tmp_path,
            MaterialsParameters(),
            {
                ("calibrate", "indoor"): photograph,
                ("remove", "empty"): empty,
                ("remove", "filled"): sun | hidden,
                ("detect", "sunlight"): sun,
                ("detect", "furniture"): hidden,
            },
        )
    )
    assert np.array_equal(found.image.rgb[sun & ~hidden], photograph.rgb[sun & ~hidden])
    assert (found.image.rgb[hidden] == 1.0).all()
    assert np.array_equal(found.sunless, hidden)


def test_small_patches_of_sun_and_wrong_ones_show_no_colour_of_it() -> None:
    light = np.ones((100, 3), np.float32)
    assert materials.share_of_sun(light * (0.9, 0.8, 0.7), light, 512) == pytest.approx((0.9, 0.8, 0.7))
    assert materials.share_of_sun(light[:3] * 0.7, light[:3], 512) == pytest.approx((1, 1, 1))
    assert materials.share_of_sun(light * 0.1, light, 512) == pytest.approx((1, 1, 1))
    assert materials.share_of_sun(light * 9, light, 512) == pytest.approx((1.5, 1.5, 1.5))
    assert materials.share_of_sun(light * 9, light, 512, most=30) == pytest.approx((9, 9, 9)), "of an overexposed sun"


def test_the_sun_falls_where_furniture_no_longer_stops_it() -> None:
    """Of a sunny room's picture its direct sun is taken away behind what stood there, and comes back as it was."""
    room = scene_of(ROOM, uniform_sky(4000.0), 0.5, reveal_m=0.2)
    out = max((1, -1), key=lambda sign: float(sign * room.panes[0].normal @ room.panes[0].corner_m))
    towards = out * room.panes[0].normal * np.cos(0.7) + np.array([0.0, 0.0, np.sin(0.7)])
    sun = Sun(tuple(towards), (60_000.0, 60_000.0, 60_000.0))
    room = replace(room, outdoors=replace(room.outdoors, sun=sun))
    geometry = Equirectangular(2 * ROWS, ROWS)
    whole = render(room, geometry, EYE, effort=LOOK).rgb
    direct = sun_of(Stage.of(room, 0.3), sight_of(Stage.of(room, 0.3), geometry, EYE), 32, 0).reshape(whole.shape)
    lit = direct.min(axis=2) > 0.9 * direct.max()
    assert 10 < lit.sum() < 0.25 * lit.size
    hidden = np.indices(lit.shape)[1] < np.median(np.nonzero(lit)[1])
    image = luminance_image(np.where(hidden[..., None], np.maximum(whole - 0.5 / np.pi * direct, 0), whole))
    found, _, _ = materials.in_its_sun(EmptyRoom(image, hidden, hidden), room, EYE, LOOK)
    assert isinstance(found, LuminanceImage)
    back = found.rgb / whole
    assert np.median(back[lit & hidden]) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_array_equal(
        found.rgb[~hidden & (direct.max(axis=2) == 0)], image.rgb[~hidden & (direct.max(axis=2) == 0)]
    )
    assert (found.uncertainty[lit & hidden] > 2 * image.uncertainty[lit & hidden]).all()
    # The sun that is seen beside it has another colour than the outdoor picture's: what comes back has it too.
    golden = np.array((0.9, 0.8, 0.6), np.float32)
    warm = image.rgb - (1 - golden) * (0.5 / np.pi) * np.where(hidden[..., None], 0, direct)
    shown = lit & ~hidden
    below = np.maximum(warm - golden * (0.5 / np.pi) * direct, 0)[shown]
    partly = EmptyRoom(replace(image, rgb=warm), hidden, hidden, shown, below)
    found, _, share = materials.in_its_sun(partly, room, EYE, LOOK)
    assert isinstance(found, LuminanceImage)
    assert share == pytest.approx(golden, abs=0.08)
    np.testing.assert_array_equal(found.rgb[shown], warm[shown])
    returned = (found.rgb - image.rgb)[lit & hidden] / (whole - image.rgb)[lit & hidden]
    assert np.median(returned, axis=0) == pytest.approx(golden, abs=0.1)
    dark = replace(room, outdoors=replace(room.outdoors, sun=None))
    assert "no sun" in str(materials.in_its_sun(EmptyRoom(image, hidden, hidden), dark, EYE, LOOK))
    away = hidden & (direct.max(axis=2) == 0) & (np.indices(lit.shape)[0] < ROWS // 3)
    assert "no direct sun" in str(materials.in_its_sun(EmptyRoom(image, away, away), room, EYE, LOOK))
    assert "nothing was removed" in str(materials.in_its_sun(EmptyRoom(image), room, EYE, LOOK))
    seen = EmptyRoom(image, away, away, lit & ~hidden)
    assert materials.in_its_sun(seen, room, EYE, LOOK)[0] is image, "the sun that was photographed stays"


def test_the_sun_falls_as_far_as_its_photographed_patches_reach() -> None:
    """Not where what is to go stands before their edges, nor without a patch."""
    light = uniform_sky(1000.0, Sun((0.0, -0.8, 0.6), (8e4, 8e4, 8e4)))
    geometry, shape = Equirectangular(1024, 512), (37, 50)
    scenes = [scene_of(box_room(window=(start, 3.5, 0.8, 2.28)), light) for start in (1.5, 1.7)]
    pane = replace(scenes[0].panes[0], clear=np.ones(shape, np.float32), veil_cd_m2=np.zeros((*shape, 3), np.float32))
    scene, stages = replace(scenes[0], panes=(pane,)), [Stage.of(one, 0.3) for one in scenes]
    masks = {"sunlight": sun_of(stages[1], sight_of(stages[1], geometry, EYE), 16, 0).any(axis=1).reshape(512, 1024)}
    context: Any = SimpleNamespace(optional_artifact=lambda _, name: masks.get(name))
    assert materials.as_it_fell(context, scene, EYE[2], 1024, None).panes[0].sun_rim == (5, 0, 0, 0)
    masks["furniture"] = np.indices((512, 1024))[0] > 256
    assert materials.as_it_fell(context, scene, EYE[2], 1024, None).panes[0].sun_rim == (0, 0, 0, 0)
    masks.clear()
    assert materials.as_it_fell(context, scene, EYE[2], 1024, None) is scene


def test_a_strip_between_parts_of_the_sun_gets_it_too_and_what_is_far_does_not() -> None:
    sunless, sunlit = np.zeros((2, 512, 1024), bool)
    sunless[300:340, 100:200], sunlit[300:340, 210:260] = True, True
    returned = np.zeros((256, 512), bool)
    returned[150:170, 135:140] = True
    found = materials._joined(sunless, sunlit, returned)
    assert found[312:328, 202:208].all(), "3.5 degrees between a removed thing and its sun"
    assert found[312:328, 262:278].all(), "and beyond it, as far as old furniture shaded it"
    assert not found[sunlit].any()
    assert not found[:, :90].any()
    assert not found[:, 290:].any()
    assert np.array_equal(found & sunless, sunless)


@pytest.mark.parametrize(
    ("name", "result"),
    [("1f-bed", "bedroom"), ("Living_Room 2", "living"), ("study", "office"), ("coda-320", None), ("abed", None)],
)
def test_the_sessions_name_decides_the_furniture(name: str, result: str | None) -> None:
    found = named_choice(name)
    assert (found.name if found else None) == result


def test_else_what_fits_decides(tmp_path: Path, known: dict[tuple[str, str], Any]) -> None:
    from processing.layout.plan import from_room_model

    found = fitting_choice(from_room_model(ROOM), "standard", 0)
    assert found.name in {"living", "bedroom"}
    assert "20.0 m2" in found.why


def test_a_room_without_a_door_gets_one_and_says_so(tmp_path: Path) -> None:
    room, text = with_door(box_room())
    assert "wall" in text
    door = room.openings[-1]
    assert door.kind is OpeningKind.PASSAGE
    assert door.wall in (1, 2, 3)
    assert with_door(ROOM) == (ROOM, "")
    found = {("room", "room"): box_room()}
    made = arrange.run(context(tmp_path, ArrangeParameters(items="bed", alternatives=1), found))
    assert made.warnings[0].message == text


def test_a_room_too_small_is_no_failure_of_the_session(tmp_path: Path) -> None:
    tiny = RoomModel.model_validate(box_room(1.2, 1.2, window=None).model_dump())
    found = {("room", "room"): tiny}
    made = arrange.run(context(tmp_path, ArrangeParameters(items="king bed"), found))
    assert "LAY-002" in made.left_out["arrangement"]
    with pytest.raises(ItemError):
        arrange.run(context(tmp_path, ArrangeParameters(items="throne"), found))


@pytest.mark.parametrize(
    ("sides_m", "bed", "rules"),
    [pytest.param((2.5, 3.2), "single bed", "", marks=pytest.mark.long), ((2.6, 2.8), "single bed", "tight")],
)
def test_a_bedroom_gets_a_bed_before_it_is_left_without(tmp_path: Path, sides_m, bed: str, rules: str) -> None:
    """The double has no place by the usual rules: a smaller one, or tighter rules, and the page says so."""
    x, y = sides_m[0] / 2, sides_m[1] / 2
    door = Opening(kind=OpeningKind.DOOR, wall=0, start_m=0.2, end_m=1.0, sill_m=0.0, head_m=2.0)
    window = Opening(kind=OpeningKind.WINDOW, wall=2, start_m=0.4, end_m=1.6, sill_m=0.5, head_m=2.0)
    corners = ((-x, -y), (x, -y), (x, y), (-x, y))
    room = ROOM.model_copy(update={"floor": corners, "openings": (door, window)})
    made = arrange.run(context(tmp_path, ArrangeParameters(set="bedroom", alternatives=1), {("room", "room"): room}))
    placed = [item.category for item in made.artifacts["arrangement"].arrangements[0].items]
    assert bed in placed
    said = f"the bed does not fit: {bed} used instead" + (f", by the rules '{rules}'" if rules else "")
    assert said in [one.message for one in made.warnings]
    asked = ArrangeParameters(items="bed, wardrobe", alternatives=1)
    result = arrange.run(context(tmp_path, asked, {("room", "room"): room}))
    assert not any("instead" in one.message for one in result.warnings), "a list of yours is taken as it is"


@pytest.mark.parametrize("width_m", [1.3, 1.75])
def test_a_bedroom_too_narrow_for_its_bed_is_not_left_empty(tmp_path: Path, width_m: float, monkeypatch) -> None:
    """By models of yours a bed may be wider: a single one stands where it has room, else the rest of the set does."""
    wide = {**KINDS, "bed": replace(KINDS["bed"], size_m=(1.8, 2.0, 0.5))}
    monkeypatch.setattr(arrange, "_kinds", lambda asked: wide)
    door = Opening(kind=OpeningKind.DOOR, wall=0, start_m=0.2, end_m=1.0, sill_m=0.0, head_m=2.0)
    corners = tuple((x * width_m / 2, y) for x, y in ((-1, -0.3), (1, -0.3), (1, 4.2), (-1, 4.2)))
    found = {("room", "room"): ROOM.model_copy(update={"floor": corners, "openings": (door,)})}
    made = arrange.run(context(tmp_path, ArrangeParameters(alternatives=1), found, name="kids bedroom"))
    placed = [item.category for item in made.artifacts["arrangement"].arrangements[0].items]
    said = [one.message for one in made.warnings]
    assert placed
    assert ("single bed" in placed) == any("single bed used instead" in text for text in said) == (width_m > 1.5)
    assert width_m > 1.5 or any("bed was not placed" in text for text in said), "what stands is the rest of the set"
    given = arrange.run(context(tmp_path, ArrangeParameters(items="bed"), found))
    assert "LAY-002" in given.left_out["arrangement"], "a list of yours is taken as it is"


def test_a_room_that_can_stand_without_a_plan_is_no_failure_of_the_session(tmp_path: Path) -> None:
    low = ROOM.model_copy(update={"camera_height_m": 0.8, "ceiling_height_m": 1.4, "openings": ()})
    assert geometry_problems(low) == []
    made = arrange.run(context(tmp_path, ArrangeParameters(), {("room", "room"): low}))
    assert "LAY-001" in made.left_out["arrangement"]
    assert "1.4 m high" in made.warnings[0].message


def test_a_slit_in_a_wall_is_no_opening_to_arrange_by(tmp_path: Path) -> None:
    slit = Opening(kind=OpeningKind.WINDOW, wall=1, start_m=0.5, end_m=0.54, sill_m=0.8, head_m=2.0)
    room = ROOM.model_copy(update={"openings": (*ROOM.openings, slit)})
    assert geometry_problems(room) == []
    found = {("room", "room"): room}
    made = arrange.run(context(tmp_path, ArrangeParameters(items="nightstand", alternatives=1), found))
    assert "a window on wall 2 is 0.04 m wide: left out" in [one.message for one in made.warnings]
    assert made.artifacts["arrangement"].arrangements


def test_what_is_no_arrangement_is_refused(tmp_path: Path, known: dict[tuple[str, str], Any]) -> None:
    artifact = next(a for a in stage_named("arrange").makes if a.name == "arrangement")
    assert save(artifact, known["arrange", "arrangement"], tmp_path) == known["arrange", "arrangement"]
    wrong = tmp_path / "mine.json"
    wrong.write_text('{"items": []}')
    with pytest.raises(ProcessingError, match="not a valid arrangement: plan"):
        load(artifact, wrong)


def test_what_changes_more_is_stated_less_sure_and_the_kept_photograph_as_before() -> None:
    flat = np.full((4, 8, 3), 100.0, np.float32)
    image = luminance_image(flat)
    after = flat.copy()
    after[0], after[1], after[2] = 95.0, 50.0, 0.0
    kept = np.zeros((4, 8), bool)
    kept[3] = True
    work = SimpleNamespace(empty=SimpleNamespace(image=image), asked=SimpleNamespace(method="differential"))
    staged = SimpleNamespace(rgb=after, kept=kept, furniture=np.zeros((4, 8), bool))
    found = rendering._picture(work, staged, SimpleNamespace(rank=1))  # type: ignore[arg-type]
    own = image.uncertainty[0, 0]
    little, much, black = found.uncertainty[:3, 0]
    assert little == pytest.approx(np.hypot(own, MODELLED), rel=0.05)
    assert much == pytest.approx(np.hypot(np.hypot(own, MODELLED), 0.5 * np.log(2)), rel=1e-3)
    assert black == pytest.approx(1.0, rel=0.05)
    np.testing.assert_array_equal(found.uncertainty[3], image.uncertainty[3])


def test_a_staged_pictures_illuminance_is_as_unsure_as_its_pixels_are_together(tmp_path: Path) -> None:
    """Errors of what is modelled mostly have one sign in a room: they do not average out over its pixels."""
    flat = np.full((64, 128, 3), 100.0, np.float32)
    image = luminance_image(flat)
    kept = np.zeros(flat.shape[:2], bool)
    kept[:, :64] = True
    work = SimpleNamespace(empty=SimpleNamespace(image=image), asked=SimpleNamespace(method="differential"))
    staged = SimpleNamespace(rgb=flat, kept=kept, furniture=~kept)
    picture = rendering._picture(work, staged, SimpleNamespace(rank=1))  # type: ignore[arg-type]
    write_exr(tmp_path / "staged.exr", picture)
    found = read_exr(tmp_path / "staged.exr")
    # To the right all is modelled, to the left nothing: what is kept is as certain as before.
    for plane, share in (((1.0, 0.0, 0.0), 1.0), ((-1.0, 0.0, 0.0), 0.0), ((0.0, 0.0, 1.0), 0.5)):
        before, after = illuminance_lx(image, plane), illuminance_lx(found, plane)
        grown = math.sqrt(max(after.uncertainty_lx**2 - before.uncertainty_lx**2, 0)) / after.value_lx
        assert grown == pytest.approx(share * SHARED_OF_MODELLED * MODELLED, rel=0.03, abs=0.002), plane
    assert (tmp_path / "staged.exr").stat().st_size < 200_000


@pytest.mark.parametrize("own", [False, True])
def test_the_sun_is_put_into_the_emptied_picture_itself_where_nobody_else_has_it(
    tmp_path: Path, photograph: LuminanceImage, own: bool
) -> None:
    """A copy of it is 0.4 GB at full size. The photograph is let go before it is asked for."""
    shape = photograph.validity.shape
    sun = np.zeros(shape, bool)
    sun[30:34, 40:50] = True
    empty = replace(
        photograph,
        rgb=np.where(sun[..., None], 0.5 * photograph.rgb, photograph.rgb),
        uncertainty=photograph.uncertainty.copy(),
        validity=photograph.validity.copy(),
    )
    for part in (empty.rgb, empty.uncertainty, empty.validity):
        part.setflags(write=own)
    taken = replace(photograph, rgb=photograph.rgb.copy())
    held: dict[tuple[str, str], Any] = {("calibrate", "indoor"): taken, ("detect", "sunlight"): sun}
    held |= {("remove", "filled"): sun, ("remove", "empty"): empty, ("room", "room"): ROOM}
    light, asked = weakref.ref(taken.rgb), list[bool]()
    del taken

    def fetch(stage: str, name: str) -> Any:
        asked.extend([light() is None] * ((stage, name) == ("remove", "empty")))
        return held.get((stage, name))

    def let_go(*stages: str) -> None:
        for name in [name for name in held if name[0] in stages and name != ("remove", "filled")]:
            held.pop(name)

    given = replace(context(tmp_path, MaterialsParameters(), held, let_go=let_go), fetch=fetch)
    found = materials.emptied(given)
    assert asked == [True]
    assert np.array_equal(found.image.rgb, photograph.rgb)
    assert (found.image.rgb is empty.rgb) == own


def test_materials_lets_go_of_what_the_emptied_room_was_made_of(
    tmp_path: Path, photograph: LuminanceImage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At full size the photograph and what removal left are 0.4 GB each; the second follows from the emptied room."""
    shape = photograph.validity.shape
    sun, filled = np.zeros(shape, bool), np.zeros(shape, bool)
    sun[30:34, 40:50] = filled[28:40, 36:70] = True
    held: dict[tuple[str, str], Any] = {
        ("calibrate", "indoor"): replace(photograph, rgb=photograph.rgb.copy()),
        ("remove", "empty"): replace(photograph, rgb=np.where(filled[..., None], 0.5 * photograph.rgb, photograph.rgb)),
        ("remove", "filled"): filled,
        ("detect", "sunlight"): sun,
        ("room", "room"): ROOM,
    }
    held["remove", "empty"].rgb.setflags(write=False)  # as a picture that is still being written is handed on
    room = materials.emptied(context(tmp_path, MaterialsParameters(), held))
    assert room.sunlit is not None
    assert room.sunlit.any()
    before = room.image.rgb.copy()
    with room.without(room.sunlit) as (below, _):
        assert np.array_equal(below, held["remove", "empty"].rgb)
    assert np.array_equal(room.image.rgb, before), "and it is as it was"
    large = ("calibrate", "indoor"), ("remove", "empty")
    pictures = [weakref.ref(held[name].rgb) for name in large]

    def let_go(*stages: str) -> None:
        for name in [name for name in large if not stages or name[0] in stages]:
            held.pop(name, None)

    def albedo(*_: object, **__: object) -> None:
        assert [one() for one in pictures] == [None, None]
        raise ProcessingError("far enough", where="here")

    monkeypatch.setattr(materials, "albedo_of_room", albedo)
    del room
    with pytest.raises(ProcessingError, match="far enough"):
        materials.run(context(tmp_path, MaterialsParameters(), held, let_go=let_go))
