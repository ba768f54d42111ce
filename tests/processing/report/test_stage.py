"""The page of a whole session, of sessions where stages were skipped, and of pictures without a scale."""

from __future__ import annotations

import base64
import io
import json
import math
import re
import weakref
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from processing.figures.figures import camera_figures, eye_view, surface_figures
from processing.pictures.display import Display
from processing.pictures.images import LuminanceImage
from processing.report import room_states, states
from processing.report.calibration_sections import light_figures_section
from processing.report.data import Cards, Comparison, Models, Viewer
from processing.report.page import client_facts
from processing.report.stage import report_data, run, session_facts
from processing.report.staging import relight_section
from processing.report.states import Look
from processing.report.stills import run as frame
from processing.sphere import Perspective
from processing.sphere.views import cut_view
from processing.stages.contract import StageContext
from processing.stages.parameters import StillsParameters
from station.session.session import FrameRecord
from tests.processing.figures.test_glare import room
from tests.processing.report.made_up import context, darker, picture, results, without
from tests.processing.report.test_stills import Kept

STAGED_XMP = b"compositeSynthetic"


@pytest.fixture(autouse=True)
def _small_views(monkeypatch: pytest.MonkeyPatch) -> None:
    """Views of the usual shape, and a fifth of the size: nobody looks at these."""
    monkeypatch.setattr(states, "VIEW_PX", (300, 200))


def widgets(data: object) -> dict[str, object]:
    sections = [data.lead, *data.sections] if data.lead else list(data.sections)  # type: ignore[attr-defined]
    return {widget.kind: widget for section in sections for widget in section.widgets}


def test_a_whole_session_has_all_its_parts(tmp_path: Path) -> None:
    given = context(tmp_path, results())
    data = report_data(given)
    found = widgets(data)
    slider, around = found["comparison"], found["viewer"]
    assert isinstance(slider, Comparison)
    assert isinstance(around, Viewer)
    assert isinstance(found["models"], Models)
    assert isinstance(found["cards"], Cards)
    names = ["Photograph", "Emptied", "Staged 1", "Staged 2"]
    assert [state.name for state in around.states] == names
    assert [shot.name for shot in slider.scenes[0].shots] == names
    assert (slider.first, slider.second) == ("Photograph", "Staged 1")
    titles = [section.title for section in data.sections]
    assert titles[:3] == ["Look around", "3D model", "Alternatives"]
    assert {"Materials", "Light and glare", "Emptied room", "Room shape"} <= set(titles)
    assert [line.name for line in data.stages][-2:] == ["stills", "day"]
    run(given)
    assert (given.folder / "lab.html").stat().st_size < 3_000_000


def test_the_emptied_room_is_put_together_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown, asked = room_states.emptied_as_shown, list[StageContext]()
    monkeypatch.setattr(room_states, "emptied_as_shown", lambda given: asked.append(given) or shown(given))
    report_data(context(tmp_path, results()))
    assert len(asked) == 1


def test_figures_have_uncertainties_and_say_which_are_bounds(tmp_path: Path) -> None:
    image = picture((1.0, 1.0, 1.0), 1)
    validity = np.where(image.rgb[..., 1] > np.quantile(image.rgb[..., 1], 0.9), 1, 0).astype(np.uint8)
    for seen, clipped in (
        (replace(image, validity=np.zeros_like(validity)), False),
        (replace(image, validity=validity), True),
    ):
        made = results()
        figures = dict(made["figures"]["light_figures"])
        figures |= {
            "camera": camera_figures(seen, height_m=1.6, heading_rad=0.5),
            "surfaces": surface_figures(seen, None),
            "level_ratio": {"value": 0.02, "uncertainty": 0.001, "bound": "lower" if clipped else None},
        }
        made["figures"]["light_figures"] = figures
        (section,) = (one for one in report_data(context(tmp_path, made)).sections if one.title == "Light and glare")
        notes = {one.name: one.note for one in section.quantities}
        assert all(one.uncertainty is not None for one in section.quantities)
        for name in ("Cylindrical illuminance", "Indoor to outdoor ratio", "Horizontal illuminance at the camera"):
            assert ("lower bound" in notes[name]) == clipped, name
        looks, whole = section.tables[0].rows, section.tables[-1].rows[0]
        assert any("or more" in row[1] for row in looks) == ("or more" in whole[1]) == clipped
        assert all("±" in cell for cell in (looks[0][1], looks[0][2], whole[1]))


def test_an_upper_bound_is_said_to_be_one() -> None:
    """A clipped source makes the other indices lower bounds, and VCP, which falls with glare, an upper one."""
    image = room([(0, 10, 20, 15, 5000)])
    view = eye_view(replace(image, validity=(image.rgb[..., 0] > 4000).astype(np.uint8)), 0.0, 200)
    figures = results()["figures"]["light_figures"]
    section = light_figures_section(figures | {"camera": camera_figures(view, height_m=1.6, heading_rad=None)})
    shown = dict(zip(section.tables[0].head, section.tables[0].rows[0], strict=True))
    assert shown["VCP (%)"].endswith(" or less")
    assert all(shown[name].endswith(" or more") for name in ("DGP", "DGI", "UGR", "CGI"))


def test_what_was_skipped_is_named_and_the_rest_stands(tmp_path: Path) -> None:
    bare = without(results(), "room", "figures", "detect", "light", "remove", "materials", "arrange", "render")
    data = report_data(context(tmp_path, bare))
    assert data.lead is None, "there is nothing to compare"
    assert list(widgets(data)) == ["viewer"]
    skipped = {line.name: line.reason for line in data.stages if line.state == "skipped"}
    later = ("room", "figures", "detect", "light", "remove", "materials", "arrange", "render", "stills", "day")
    assert skipped == dict.fromkeys(later, "not asked")


@pytest.mark.parametrize("labelled", [True, False])
def test_staged_pictures_say_what_they_are_and_the_photograph_does_not(tmp_path: Path, labelled: bool) -> None:
    data = report_data(context(tmp_path, results(), no_staged_label=not labelled))
    slider, around = widgets(data)["comparison"], widgets(data)["viewer"]
    assert isinstance(slider, Comparison)
    assert isinstance(around, Viewer)
    pictures = {shot.name: shot.data for shot in slider.scenes[2].shots} | {s.name + "!": s.jpeg for s in around.states}
    assert {name.partition(" ")[0].strip("!") for name in pictures} == {"Photograph", "Emptied", "Staged"}
    assert all((STAGED_XMP in data) != name.startswith("Photograph") for name, data in pictures.items())
    assert all((b"removed digitally" in data) != name.startswith("Photograph") for name, data in pictures.items())
    assert [bool(shot.tag) for shot in slider.scenes[0].shots] == [False, labelled, labelled, labelled]
    assert bool(around.label) == labelled


@pytest.mark.parametrize("made", [report_data, frame])
def test_few_pictures_are_in_memory_together(tmp_path: Path, made: Callable[[StageContext], object]) -> None:
    given = context(tmp_path, results())
    found: list[weakref.ref[np.ndarray]] = []
    together = []

    def fetch(stage: str, name: str) -> object:
        value = given.fetch(stage, name)
        if isinstance(value, LuminanceImage):
            value = replace(value, rgb=value.rgb.copy())
            found.append(weakref.ref(value.rgb))
            together.append(sum(one() is not None for one in found))
        return value

    made(replace(given, fetch=fetch, parameters=StillsParameters() if made is frame else given.parameters))
    assert len(together) > 3
    assert max(together) <= 2, "a session has five states and more"


def test_one_more_alternative_is_the_only_one_that_the_page_reads(tmp_path: Path) -> None:
    """What the page before shows of the others is kept; a page made anew is the same."""
    kept, read = Kept(), list[str]()

    def page(folder: Path, alternatives: int, parts: Kept | None) -> str:
        given = context(folder, results(alternatives=alternatives))
        inner = given.fetch

        def fetch(stage: str, name: str) -> object:
            value = inner(stage, name)
            read.extend([name] * isinstance(value, LuminanceImage))
            return value

        read.clear()
        made = run(replace(given, fetch=fetch, parts=parts))
        assert made.artifacts.keys() >= {"details", f"cuts-{2 + alternatives}"}
        assert f"cuts-{3 + alternatives}" in made.left_out
        return (given.folder / "lab.html").read_text("utf-8")

    page(tmp_path, 2, kept)
    assert {"indoor", "empty", "staged-1", "staged-2"} <= set(read)
    more = page(tmp_path, 3, kept)
    assert set(read) == {"indoor", "staged-3"}, "without stills, the photograph's exposure is asked for"
    (tmp_path / "anew").mkdir()
    assert page(tmp_path / "anew", 3, None) == more


def test_of_a_given_picture_nobody_says_when_it_was_taken(tmp_path: Path) -> None:
    session = context(tmp_path, results()).session
    given = session.model_copy(update={"bracket": session.bracket.model_copy(update={"mode": "panorama"})})
    assert [session_facts(one)[1][0] for one in (session, given)] == ["Taken", "Session made"]


def test_an_imported_session_was_taken_when_its_frames_were_and_not_when_it_was_imported(tmp_path: Path) -> None:
    session = context(tmp_path, results()).session
    assert session.created_utc.year == 2023
    made = session.model_copy(update={"bracket": session.bracket.model_copy(update={"mode": "imported"})})
    frame = {"side": "indoor", "stop": 0, "file": "indoor/0.jpg", "size_bytes": 1, "sha256": "0" * 64, "asked_s": 1.0}
    old = datetime(2019, 6, 1, 9, 30, tzinfo=UTC)
    dated = made.model_copy(update={"frames": (FrameRecord(**frame, camera_s=1.0, taken_utc=old),)})
    assert session_facts(dated)[1] == ("Taken", "2019-06-01 09:30 UTC")
    assert session_facts(made)[1] == ("Session made", "2023-05-19 15:54 UTC")
    facts = [client_facts(one)[0] for one in (dated, made)]
    assert facts == [("Photographed", "1 June 2019, 09:30 UTC"), ("Received", "19 May 2023, 15:54 UTC")]


def test_without_a_scale_units_are_relative(tmp_path: Path) -> None:
    data = report_data(context(tmp_path, results(absolute=False)))
    around = widgets(data)["viewer"]
    assert isinstance(around, Viewer)
    assert around.unit == data.unit == "relative units"
    text = json.dumps([section.text for section in data.sections])
    assert "not between rooms" in text
    assert "DGP" not in text
    assert not any("cd/m2" in file.what for file in data.files)
    assert b"relative" in around.states[0].jpeg


@pytest.mark.long
@pytest.mark.usefixtures("anew")
def test_the_same_results_give_the_same_page(tmp_path: Path) -> None:
    pages = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        given = context(folder, results(alternatives=1))
        run(given)
        pages.append((given.folder / "lab.html").read_bytes())
    assert pages[0] == pages[1]


def test_further_models_are_named_when_the_page_would_be_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = results()
    found["render"]["staged-2-model"] = b"x" * 10_000
    given = context(tmp_path, found)
    first = (tmp_path / "stages" / "render" / "staged-1.glb").stat().st_size
    monkeypatch.setattr(room_states, "LARGEST_MODELS", first + 9_999)
    section = room_states.model_section(given)
    assert section is not None
    models = section.widgets[0]
    assert isinstance(models, Models)
    assert [model.name for model in models.models] == ["Staged 1"]
    assert "staged-2.glb" in models.note
    assert base64.b64decode(models.models[0].text).startswith(b"glTF")
    monkeypatch.setattr(room_states, "LARGEST_MODELS", 100)
    section = room_states.model_section(given)
    assert section is not None
    assert section.widgets == (models,)  # one there always is, but for a monster
    monkeypatch.setattr(room_states, "LARGEST_MODEL", 100)
    section = room_states.model_section(given)
    assert section is not None
    assert not section.widgets
    assert "staged-1.glb, staged-2.glb" in section.text


def test_views_look_where_most_furniture_is_seen() -> None:
    bed, chair, lamp = (2.0, 2.0, 1.7), (2.5, 1.0, 0.5), (-2.0, -2.0, 0.3)
    first, second = np.degrees(room_states.towards_furniture([bed, chair, lamp]))
    assert 20 < first < 80
    assert -180 <= second < -90, "the second view is another one"
    at_hand = (0.0, -0.5, 2.0)
    assert room_states.towards_furniture([bed, at_hand])[0] > 0, "what hides the room is not looked at"


def test_without_an_arrangement_views_look_at_what_changed() -> None:
    before = picture((1.0, 1.0, 1.0), 1)
    after = darker(before, 1.0)
    after.rgb[70:90, 190:210] *= 5
    assert np.degrees(room_states.towards(before, after)) == pytest.approx(120, abs=8)
    assert room_states.towards(before, before) == 0.0


def test_page_names_no_address_of_the_net(tmp_path: Path) -> None:
    given = context(tmp_path, results(alternatives=1))
    run(given)
    page = (given.folder / "lab.html").read_text("utf-8")
    markup = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    markup = re.sub(r"<style>.*?</style>|data:[a-z+/]*;base64,[A-Za-z0-9+/=]*", "", markup, flags=re.DOTALL)
    assert "http" not in markup.replace("http-equiv", "")


def test_a_view_through_a_pane_is_lowered_in_a_cut_view_as_in_the_panorama() -> None:
    rgb, panes = np.full((256, 512, 3), 0.4, np.float32), np.zeros((256, 512), np.uint8)
    panes[100:150, 220:300], rgb[100:150, 220:300] = 2, 20.0
    panes[95:100, 220:300] = 1
    look = Look(Display((1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0), 0.05, "given"), panes)
    view = Perspective(200, 150, math.radians(60))
    whole, cut = look.light(rgb), look.light(cut_view(rgb, view), view)
    assert whole[125, 260, 1] == pytest.approx(1.0, abs=0.2)
    assert cut[75, 105, 1] == pytest.approx(whole[125, 260, 1], rel=0.05)


def relit(folder: Path, stem: str, tint: tuple[int, int, int]) -> None:
    folder.mkdir(exist_ok=True)
    Image.new("RGB", (240, 120), tint).save(folder / f"{stem}.jpg")


def test_other_times_of_day_stand_side_by_side(tmp_path: Path) -> None:
    folder = tmp_path / "relight"
    for hour in ("0900", "1500"):
        relit(folder, f"staged-1-2023-06-21T{hour}", (200, 150, 100))
    relit(folder, "empty-sky-dusk", (60, 60, 90))
    moments = [
        {"local_time": f"2023-06-21 {hour}:00", "global_horizontal_lx": 41234.5, "weather": "clear", "unit": "cd/m2"}
        for hour in ("09", "12", "15")
    ]
    (folder / "staged-1-2023-06-21.json").write_text(json.dumps({"staged": 1, "moments": moments}))
    (folder / "empty-sky-dusk.json").write_text(json.dumps({"staged": None, "moments": [{"median_luminance": 3.21}]}))
    (folder / "broken.json").write_text('{"moments": 3')
    (folder / "other.json").write_text('{"moments": [1, 2]}')
    section = relight_section(tmp_path, Look())
    assert section is not None
    cards = section.widgets[0]
    assert isinstance(cards, Cards)
    titles = [card.title for card in cards.cards]
    assert titles == ["another sky, emptied", "2023-06-21 09:00, staged 1", "2023-06-21 15:00, staged 1"]
    assert all(STAGED_XMP in card.data and b"another time" in card.data for card in cards.cards)
    assert [b'daylit:Staged="True"' in card.data for card in cards.cards] == [False, True, True]
    shown = np.asarray(Image.open(io.BytesIO(cards.cards[1].data)))
    assert shown[..., 1].std() > 3, "each staged view has its label"
    assert cards.cards[1].quantities[0].text == "41\u2009230"
    assert relight_section(tmp_path / "nothing", Look()) is None
    titles = [section.title for section in report_data(context(tmp_path, results(alternatives=1))).sections]
    assert "Times of day" in titles
