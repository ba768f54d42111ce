"""The page: everything stated is there, text stays text, nothing is fetched."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.pictures.preview import png_bytes
from processing.report import page as pages
from processing.report.data import (
    Card,
    Cards,
    Comparison,
    FileLine,
    Model,
    Models,
    Picture,
    Quantity,
    ReportData,
    Scene,
    Section,
    Shot,
    StageLine,
    Table,
    Viewer,
    ViewerState,
    WarningLine,
    number_text,
    safe_json,
    size_text,
)
from processing.report.page import build_page
from processing.report.sections import _tables

PIXEL = png_bytes(np.zeros((1, 1, 3), np.uint8))
DATA = ReportData(
    title="coda-320",
    facts=(("Session", "2023-05-19T1554Z_coda-320"),),
    summary=(Quantity("k1", 0.033981, "", 0.00042, "at 12°"), Quantity("Outdoor illuminance", 45_210.0, "lx", 820.0)),
    stages=(StageLine("merge", "ran", "stop 9 left out"), StageLine("remove", "skipped", "nothing to remove")),
    warnings=(WarningLine("12 % below the meter", "outdoor", "X-1"),),
    sections=(
        Section(
            "Indoor",
            "Nine frames.",
            (Quantity("Median", 82.1, "cd/m²"),),
            (Picture("Luminance", PIXEL, "a room", "log scale", wide=True), Picture("Curve", b"<svg/>", "a curve")),
            (Table("Noise", ("channel", "photon"), (("red", "1e-4"),)),),
        ),
    ),
    files=(FileLine("stages/calibrate/indoor.exr", 271_000_000, "the picture"),),
    made_with="daylit 0.1.0",
)


class Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.ids: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("src", "href", "data", "action", "srcset")]
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in ("meta", "img", "link", "br", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_all_is_there() -> None:
    page = build_page(DATA)
    for text in (
        "coda-320",
        "0.03398 ± 0.00042",
        "45\u2009210 ± 820",
        "stop 9 left out",
        "nothing to remove",
        "12 % below the meter",
        "Nine frames.",
        "82.1",
        "log scale",
        "1e-4",
        "271 MB",
        "daylit 0.1.0",
    ):
        assert text in page, text
    assert base64.b64encode(PIXEL).decode() in page
    assert "data:image/svg+xml;base64," in page
    assert page == build_page(DATA)


def test_nothing_is_fetched_and_tags_close() -> None:
    links = Links()
    page = build_page(DATA)
    links.feed(page)
    assert not links.open
    assert all(link.startswith(("#", "data:image/")) for link in links.found), links.found
    assert {link[1:] for link in links.found if link.startswith("#")} <= set(links.ids)
    assert "default-src &#39;none&#39;; script-src &#39;none&#39;" in page
    style = page.split("<style>")[1].split("</style>")[0]
    assert not re.search(r"url\(|@import", style)
    assert "<script" not in page


def test_every_script_is_named_by_its_digest_and_nothing_is_fetched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = tmp_path / "viewer.js"
    built.write_text("var daylit = {};")
    monkeypatch.setattr(pages, "VIEWER", built)
    shot = Shot("Photograph", PIXEL, "a room")
    scene = Scene("View", (shot, replace(shot, name="Staged 1")), 1, 1)
    state = ViewerState("Photograph", PIXEL, "", "", "", (1, 1), (1, 1))
    viewer = Viewer((state,), 0.5, (1.0, 100.0), (1.0, 10.0), bytes(768), "cd/m2")
    widgets = (
        Comparison((scene,), "Photograph", "Staged 1"),
        viewer,
        Models((Model("Staged 1", b"glTF", "a room"),)),
        Cards((Card("One", PIXEL, "a room", "oak", (Quantity("Score", 0.9),)),)),
    )
    page = build_page(replace(DATA, sections=(Section("Look", widgets=widgets),)))
    policy = html.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1))  # type: ignore[union-attr]
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(scripts) == 2
    for script in scripts:
        assert f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'" in policy
    assert "connect-src data: blob:" in policy
    assert "unsafe-inline" not in policy.split("style-src")[0]
    links = Links()
    links.feed(page)
    assert not links.open
    assert all(link.startswith(("#", "data:image/")) for link in links.found), links.found
    built.unlink()
    page = build_page(replace(DATA, sections=(Section("Look", widgets=widgets),)))
    assert page.count("make web") == 2, "what is missing is named, and how to build it"


def test_what_is_built_can_stand_in_a_page() -> None:
    if not pages.VIEWER.exists():
        pytest.skip("the viewer is not built: make web")
    text = pages.VIEWER.read_text("utf-8")
    assert "MIT" in text[:200], "three.js's licence goes with it"
    assert not re.search(r"</script|<!--|\r|https?://(?!www\.w3\.org)[\w.]+\.\w+/\w+\.js", text)


def test_data_of_a_viewer_cannot_end_its_element() -> None:
    evil = "</script><script>alert(1)</script><!--"
    assert "<" not in safe_json({"name": evil})
    assert json.loads(safe_json({"name": evil})) == {"name": evil}


def test_text_stays_text() -> None:
    evil = '<script>alert("1")</script>'
    data = replace(
        DATA,
        title=evil,
        facts=((evil, evil),),
        warnings=(WarningLine(evil, evil, evil),),
        stages=(StageLine(evil, "ran", evil),),
        files=(FileLine(evil, 1, evil),),
        sections=(Section(evil, evil, (Quantity(evil, 1, evil, None, evil),), (Picture(evil, PIXEL, evil, evil),)),),
    )
    page = build_page(data)
    assert "<script" not in page
    assert "&lt;script&gt;" in page


def test_tables_number_walls_and_openings_from_1_as_the_room_does() -> None:
    """Files count from 0; the page showed both, so that wall-1 of one table was wall 2 of another."""
    rows = (("wall-0", "wall-12: 5 px"), ("reveal-0-sill", "nightstand-1, still-1.jpg"), ("opening-3", "drywall-2"))
    page = build_page(replace(DATA, sections=(Section("s", tables=(Table("t", ("a", "b"), rows),)),)))
    for shown in ("wall 1<", "wall 13: 5 px", "reveal 1-sill", "opening 4", "nightstand-1, still-1.jpg", "drywall-2"):
        assert shown in page, shown
    room = RoomModel(
        source="given",
        floor=((-2.0, -2.0), (2.0, -2.0), (2.0, 3.0), (-2.0, 3.0)),
        camera_height_m=1.6,
        ceiling_height_m=2.7,
        openings=(
            Opening(kind=OpeningKind.DOOR, wall=1, start_m=0.5, end_m=1.4, sill_m=0.0, head_m=2.0),
            Opening(kind=OpeningKind.WINDOW, wall=2, start_m=1.0, end_m=3.0, sill_m=0.9, head_m=2.1),
        ),
    )
    (_, openings) = _tables(room, {}, {})
    page = build_page(replace(DATA, sections=(Section("s", tables=(openings,)),)))
    assert "door 1" in page
    assert "window 2" in page


def test_an_empty_report_is_a_page() -> None:
    page = build_page(ReportData("empty", (), (), (), (), (), (), "daylit"))
    assert "No warnings." in page
    assert 'id="files"' not in page


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (31.4159, 0.57, "31.42 ± 0.57"),
        (31.4159, 12.0, "31 ± 12"),
        (45_213.7, 823.0, "45\u2009210 ± 820"),
        (0.0339813, 0.00042, "0.03398 ± 0.00042"),
        (2.0e9, 3.1e7, "2.000 × 10^9 ± 3.1 × 10^7"),
        (100.0, None, "100"),
        (0.92, None, "0.92"),
        (1234567.0, None, "1\u2009235\u2009000"),
        (1.6e9, None, "1.600 × 10^9"),
        (1.5e-6, None, "1.500 × 10^-6"),
        (0.0, None, "0"),
        (0.0, 0.5, "0.00 ± 0.50"),
        (5.0, 0.0, "5"),
        (5.0, float("inf"), "5"),
        (float("nan"), 1.0, "unknown"),
        (-3.14159, 0.01, "-3.142 ± 0.010"),
    ],
)
def test_numbers_for_people(value: float, uncertainty: float | None, text: str) -> None:
    assert number_text(value, uncertainty) == text


@settings(max_examples=150, deadline=None)
@given(st.floats(allow_nan=True, allow_infinity=True), st.none() | st.floats(0, 1e300))
def test_any_number_can_be_reported(value: float, uncertainty: float | None) -> None:
    assert number_text(value, uncertainty)


def test_sizes_for_people() -> None:
    assert [size_text(n) for n in (0, 999, 1000, 271_000_000, 4_200_000_000)] == [
        "0 B",
        "999 B",
        "1 kB",
        "271 MB",
        "4.2 GB",
    ]
