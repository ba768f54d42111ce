"""The client's page in a real browser: from disk, without a network, on desktop and phone, in the dark and on paper."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from processing.report.stage import run
from processing.report.staging import FOLDER
from tests.browser.test_report import (
    CHROMIUM,
    COARSE,
    OPTIONS,
    PATIENCE_MS,
    Opened,
    listen,
    pixels,
    playwright,
    violations,
)
from tests.browser.test_report import pytestmark as pytestmark  # what this machine needs for it
from tests.conftest import LONG
from tests.processing.report.made_up import results
from tests.processing.report.test_client import MOST_BYTES, with_stills

HOURS = ("08", "12", "16")
PAINT_MS = 10_000
"""A ceiling, for machines that do other things; `python -m benchmarks pages` measures it."""


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    folder = tmp_path_factory.mktemp("session")
    given = with_stills(folder, results(alternatives=1))
    relit(folder / FOLDER)
    run(given)
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=OPTIONS, timeout=PATIENCE_MS)
        size: dict[str, Any] = {"viewport": {"width": 1200, "height": 800}, "device_scale_factor": COARSE}
        tab = browser.new_context(offline=True, reduced_motion="reduce", **size)
        found = Opened(tab.new_page(), given.folder / "index.html")
        found.page.set_default_timeout(PATIENCE_MS)
        listen(found)
        found.page.goto(found.folder.as_uri(), timeout=PATIENCE_MS)
        found.page.locator(".viewer").scroll_into_view_if_needed()
        found.page.wait_for_selector(".viewer.ready")
        yield found
        browser.close()


def relit(folder: Path) -> None:
    """Three hours of the staged room, each brighter, and one of the emptied room."""
    folder.mkdir()
    for name, hours in (("staged-1", HOURS), ("empty", HOURS[:1])):
        for number, hour in enumerate(hours):
            shade = np.full((120, 240, 3), 60 + 80 * number, np.uint8)
            Image.fromarray(shade).save(folder / f"{name}-2025-06-21T{hour}00.jpg")
        moments = [{"local_time": f"2025-06-21 {hour}:00", "weather": "clear", "unit": "cd/m2"} for hour in hours]
        staged = None if name == "empty" else 1
        (folder / f"{name}-2025-06-21.json").write_text(json.dumps({"staged": staged, "moments": moments}))


def test_it_is_small_and_paints(opened: Opened) -> None:
    assert opened.folder.stat().st_size < MOST_BYTES
    painted = opened.page.evaluate("() => performance.getEntriesByType('paint').map((one) => one.startTime)")
    assert painted
    assert max(painted) < PAINT_MS


def test_the_hours_of_the_staged_day_turn_by_the_keyboard(opened: Opened) -> None:
    """One hour is on the screen, another one after a key; the emptied room's lone hour is left to the laboratory."""
    slider, cards = opened.page.locator("[data-part=hour]"), opened.page.locator(".day .card")
    assert cards.count() == len(HOURS)
    slider.focus()
    seen = []
    for key in ("Home", "ArrowRight", "End"):
        slider.press(key)
        assert sum(cards.nth(k).is_visible() for k in range(len(HOURS))) == 1
        said = opened.page.locator("[data-part=said]").inner_text()
        assert slider.get_attribute("aria-valuetext") == said
        seen.append((said, pixels(opened, ".day .card.chosen img")[:40].mean()))
    assert [said for said, _ in seen] == [f"2025-06-21 {hour}:00, staged 1" for hour in HOURS]
    shades = [shade for _, shade in seen]
    assert shades[0] + 40 < shades[1] < shades[2] - 40, shades


def test_the_divider_compares_with_the_original(opened: Opened) -> None:
    reds = []
    for place in ("5", "95"):
        opened.page.locator("[data-part=divide]").fill(place)
        middle = pixels(opened, ".comparison .frame")[100:300, 400:430]
        reds.append((middle[..., 0] - middle[..., 2]).mean())
    assert reds[0] > reds[1] + 20, "the staged picture is the reddish one"


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("width", "scheme"),
    [(1200, "light"), (390, "dark"), (1200, "dark"), (390, "light")] if LONG else [(1200, "light"), (390, "dark")],
)
def test_it_fits_and_can_be_read_by_everybody(opened: Opened, width: int, scheme: str) -> None:
    opened.page.set_viewport_size({"width": width, "height": 844})
    opened.page.emulate_media(color_scheme=scheme)
    assert opened.page.evaluate("() => document.documentElement.scrollWidth") <= width
    ground = opened.page.evaluate("() => getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)")
    assert (max(ground) < 60) == (scheme == "dark"), ground
    assert violations(opened.page) == []
    opened.page.set_viewport_size({"width": 1200, "height": 800})
    opened.page.emulate_media(color_scheme="light")


def test_the_judge_sees_a_picture_without_words(opened: Opened) -> None:
    words = opened.page.evaluate("() => document.images[0].alt")
    opened.page.evaluate("() => document.images[0].removeAttribute('alt')")
    assert [rule for rule, _ in violations(opened.page)] == ["image-alt"]
    opened.page.evaluate("(words) => { document.images[0].alt = words; }", words)


def test_on_paper_every_hour_and_every_picture_stands_and_nothing_that_moves(opened: Opened) -> None:
    opened.page.emulate_media(media="print")
    for shown in (".day .card", ".still", ".comparison .shot"):
        every = opened.page.locator(shown)
        assert every.count()
        assert all(every.nth(k).is_visible() for k in range(every.count())), shown
    for hidden in (".hours", ".viewer", ".comparison .divide"):
        assert not opened.page.locator(hidden).first.is_visible(), hidden
    opened.page.emulate_media(media="screen")


def test_nothing_was_asked_of_the_net_and_nothing_failed(opened: Opened) -> None:
    """Last: of all that was done above."""
    assert opened.complaints == []
