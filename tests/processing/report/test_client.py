"""The client's page: pictures with their originals, no sentence that the run does not warrant, nothing fetched."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from processing.layout.drawn.canvas import Area, symbol
from processing.report import plots, states
from processing.report import stills as framing
from processing.report.data import Card, Cards, Section
from processing.report.frames import FEWEST
from processing.report.page import DOUBTFUL, build_client_page, client_data
from processing.report.stage import report_data
from processing.report.stills import run as frame
from processing.stages.contract import StageContext
from processing.stages.parameters import StillsParameters
from processing.stages.upright import UNTRUSTED
from tests.processing.report.made_up import Results, context, results, without

MOST_BYTES = 8_000_000


def with_stills(folder: Path, found: Results) -> StageContext:
    """A session whose stills were framed, as the report meets it."""
    first = context(folder, found)
    stills = folder / "stages" / "stills"
    stills.mkdir(parents=True)
    made = frame(replace(first, folder=stills, parameters=StillsParameters())).artifacts
    (stills / "stills.json").write_text(json.dumps(made["stills"]))
    files = {Path(one[key]).stem: stills / one[key] for one in made["stills"]["stills"] for key in ("file", "original")}
    return context(folder, {**found, "stills": {"display": made["display"], "stills": made["stills"], **files}})


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Views and stills of a fifth of the size and plots not drawn, where nobody looks: two thirds of a page's time."""
    monkeypatch.setattr(framing, "LEAST_PX", 256)
    monkeypatch.setattr(states, "VIEW_PX", (300, 200))
    monkeypatch.setattr(plots, "svg_bytes", lambda _figure: b'<svg xmlns="http://www.w3.org/2000/svg"/>')


@pytest.fixture(scope="module")
def staged(tmp_path_factory: pytest.TempPathFactory) -> StageContext:
    return with_stills(tmp_path_factory.mktemp("session"), results())


@pytest.mark.usefixtures("small")
def test_every_picture_and_model_within_the_pages_counts_for_them(tmp_path: Path) -> None:
    """What a page embeds is fetched, so that a run notices where it was made anew and nothing else has changed."""
    given, read = with_stills(tmp_path, results(alternatives=1)), set[tuple[str, str]]()

    def fetch(stage: str, name: str) -> object:
        read.add((stage, name))
        return given.fetch(stage, name)

    page = replace(given, fetch=fetch)
    stills = client_data(page, report_data(page)).stills
    assert stills
    assert ("render", "staged-1-model") in read
    assert read >= {("stills", f"still-{k}{kind}") for k in range(1, len(stills) + 1) for kind in ("", "-original")}


def test_pictures_come_with_statement_original_and_full_size(staged: StageContext) -> None:
    data = client_data(staged, report_data(staged))
    assert len(data.stills) >= FEWEST
    for still in data.stills:
        assert "virtual" in still.statement
        for link in (still.original, still.file):
            assert (staged.session_path / "stages" / "report" / link).resolve().is_file(), link
    assert data.compared is not None
    assert [shot.name for shot in data.compared.scenes[0].shots] == ["Original", "Staged 1"]
    assert data.tour is not None
    assert [state.staged for state in data.tour.states] == sorted((s.staged for s in data.tour.states), reverse=True)
    page = build_client_page(data)
    assert len(page) < MOST_BYTES
    outside = re.findall(r'(?:src|href)="(?!data:)([^"]+)"', page)
    assert outside
    assert all(link in {"lab.html", "plan.svg"} or link.startswith("../") for link in outside)
    plan = (staged.folder / "plan.svg").read_text()
    assert "bed" in plan
    rug = next(shape.fill for shape in symbol("rug", 2.0, 1.4) if isinstance(shape, Area))
    assert rug in plan, "what dresses the floor is drawn too"
    assert "score" not in plan
    assert "default-src 'none'" in html.unescape(page)
    assert page.index("<img") < page.index("<script")
    assert build_client_page(data) == page


@pytest.mark.usefixtures("small")
def test_time_is_the_places_own_and_fields_hold_numbers_that_browsers_read(staged: StageContext) -> None:
    noon = datetime(2026, 7, 1, 16, 30, tzinfo=UTC)
    there = staged.session.site.model_copy(update={"latitude_deg": 40.44, "longitude_deg": -79.99})
    session = staged.session.model_copy(update={"site": there, "created_utc": noon, "frames": ()})
    page = replace(staged, session=session)
    data = client_data(page, report_data(page))
    assert dict(data.facts)["Photographed"] == "1 July 2026, 12:30 EDT"
    assert data.tour is not None
    bright = build_client_page(replace(data, tour=replace(data.tour, range=(2e-5, 3e4))))
    assert re.findall(r'type="number"[^>]*value="([^"]*)"', bright) == ["2e-05", "30000"]


@pytest.mark.usefixtures("small")
def test_a_doubtful_room_is_called_so_and_a_bare_one_claims_nothing(tmp_path: Path) -> None:
    found = results(alternatives=1)
    room = found["room"]["room"]
    sure = client_data(*_both(with_stills(tmp_path / "sure", _with_room(found, room, DOUBTFUL + 0.3))))
    doubtful = client_data(*_both(with_stills(tmp_path / "doubtful", _with_room(found, room, 0.07))))
    assert not any("doubtful" in text for text in sure.notices)
    assert any("doubtful (confidence 7 %)" in text.replace("%", " %").replace("  ", " ") for text in doubtful.notices)
    bare = with_stills(tmp_path / "bare", without(found, "remove", "render", "arrange", "materials", "detect", "light"))
    plain = client_data(*_both(bare))
    assert plain.notices == ()
    assert plain.compared is None
    assert {still.original for still in plain.stills} == {""}
    assert not any(still.statement for still in plain.stills)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("skipped", "left_out", "said"),
    [
        ({"remove", "materials"}, {}, "it was neither emptied nor staged: walls 1, 3 can be trusted"),
        pytest.param(
            *({"materials"}, {UNTRUSTED: "why"}, "it was neither emptied as a whole nor staged: walls 1, 3"),
            marks=pytest.mark.long,
        ),
        ({"materials"}, {}, "it was not staged: walls 1, 3"),
        (set(), {}, "(confidence 7%): measurements and the positions of furniture may be wrong."),
    ],
)
def test_of_a_doubtful_room_the_page_says_what_was_left_undone_and_which_part_stands(
    tmp_path: Path, skipped: set[str], left_out: dict[str, str], said: str
) -> None:
    made = results(alternatives=1)
    found = _with_room(made, made["room"]["room"], 0.07)
    gone = {"materials": ("materials", "arrange", "render"), "remove": ("remove",)}
    given = with_stills(tmp_path, without(found, *(stage for one in skipped for stage in gone[one])))

    def summary(stage: str) -> dict[str, object]:
        facts = {"wall_confidences": [0.9, 0.2, 0.8, 0.1]} if stage == "room" else {"furniture": bool(left_out)}
        why = {"skipped": "the room's shape is doubtful (confidence 0.07)"} if stage in skipped else {}
        own = dict(given.summary(stage))
        mine = {**own["left_out"], **(left_out if stage == "remove" else {})}
        return own | {"metrics": {**own["metrics"], **facts}, "left_out": mine} | why

    page = replace(given, summary=summary)
    lab = report_data(page)
    notices = client_data(page, lab).notices
    assert any(said in text for text in notices), notices
    walls = [row[0] for s in lab.sections for t in s.tables if t.title == "Walls" for row in t.rows]
    assert walls[0] == "wall 1", "the laboratory's page counts them alike"
    removed = [text for text in notices if "removed digitally" in text]
    assert len(removed) == ("remove" not in skipped), "its sentences depend on what was done"
    assert not removed or ("own furniture" in removed[0]) == bool(left_out)


@pytest.mark.usefixtures("small")
def test_without_any_still_the_page_stands(tmp_path: Path) -> None:
    given = context(tmp_path, without(results(), "render", "arrange", "materials"))
    page = build_client_page(client_data(*_both(given)))
    assert "lab.html" in page


def _both(given: StageContext) -> tuple[StageContext, object]:
    return given, report_data(given)


def _with_room(found: Results, room: object, confidence: float) -> Results:
    changed = room.model_copy(update={"source": "estimated", "confidence": confidence})  # type: ignore[attr-defined]
    return {**found, "room": {**found["room"], "room": changed}}


@pytest.mark.usefixtures("small")
def test_the_slider_shows_one_states_day_and_no_lone_hour_has_one(staged: StageContext) -> None:
    lab = report_data(staged)
    data = client_data(staged, lab)
    assert data.day is None
    assert "data-part=hour" not in build_client_page(data)
    hours = ("2025-06-21 09:00, staged 1", "2025-06-21 15:00, staged 1", "2025-06-21 09:00, emptied")
    cards = tuple(Card(title, b"\xff\xd8", title) for title in hours)
    day = replace(lab, sections=(*lab.sections, Section("Times of day", widgets=(Cards(cards),))))
    found = client_data(staged, day).day
    assert found is not None
    assert [card.title for card in found.cards] == list(hours[:2])
    assert 'max="1"' in (page := build_client_page(replace(data, day=found)))
    assert page.count('class="card"') == 2
    for hour, first in ((8, 0), (14, 1)):
        then = staged.session.model_copy(update={"created_utc": datetime(2025, 6, 21, hour, tzinfo=UTC), "frames": ()})
        taken = client_data(replace(staged, session=then), day).day
        assert taken is not None
        assert taken.first == first, "nearest to the photograph's hour"
        assert f'value="{first}"' in build_client_page(replace(data, day=taken))
    assert 'data-part="hour"' not in build_client_page(replace(data, day=Cards(cards[:1], ("day.js",))))


@pytest.mark.usefixtures("small")
def test_the_hours_that_a_run_makes_are_under_the_slider_until_somebody_sweeps_a_day(staged: StageContext) -> None:
    hours = [{"local_time": f"2025-06-21 {hour}:00", "global_horizontal_lx": 5e4} for hour in ("09", "12", "15")]
    jpeg = staged.session_path / "hour.jpg"
    jpeg.write_bytes(b"\xff\xd8")
    made = {"day": {"state": "staged-1", "hours": hours}}

    def fetch(stage: str, name: str) -> object:
        return (made.get(name) or jpeg) if stage == "day" else staged.fetch(stage, name)

    with_day = replace(staged, fetch=fetch)
    lab = report_data(with_day)
    titles = [f"2025-06-21 {hour}:00, staged 1" for hour in ("09", "12", "15")]
    day = client_data(with_day, lab).day
    assert day is not None
    assert [card.title for card in day.cards] == titles
    assert 'max="2"' in build_client_page(client_data(with_day, lab))
    own = next(section for section in lab.sections if section.title == "Times of day")
    # Neither do other skies, which are no hours of a day; a day is of one weather, in the order of its hours.
    skies = Cards((Card("another sky, emptied", b"", ""),) * 4)
    sunny = [Card(f"2025-06-21 {hour}:00, emptied", b"", "", "clear") for hour in ("09", "12", "10")]
    mixed = Cards((*sunny, Card("2025-06-21 11:00, emptied", b"", "", "overcast")))
    sections = [one for one in lab.sections if one is not own]
    for first, shown in ((skies, titles), (mixed, [sunny[k].title for k in (0, 2, 1)])):
        page = replace(lab, sections=(*sections, replace(own, widgets=(first, *own.widgets))))
        found = client_data(with_day, page).day
        assert found is not None
        assert [card.title for card in found.cards] == shown
    # A moment that was asked for does not push the day aside; a swept day does.
    for count, shown in ((1, titles), (2, ["2025-12-01 09:00, emptied", "2025-12-01 10:00, emptied"])):
        swept = Cards(tuple(Card(f"2025-12-01 {9 + k:02}:00, emptied", b"", "") for k in range(count)))
        both = replace(own, widgets=(swept, *own.widgets))
        found = client_data(with_day, replace(lab, sections=(*(s for s in lab.sections if s is not own), both))).day
        assert found is not None
        assert [card.title for card in found.cards] == shown
