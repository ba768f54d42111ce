"""The report in a real browser: from disk, without a network, everything moves and every number is the picture's."""

from __future__ import annotations

import io
import math
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from processing.pictures.exr import read_exr
from processing.pictures.images import luminance_cd_m2
from processing.report.page import VIEWER
from processing.report.stage import run
from processing.report.states import LARGEST_ERROR, luminance_codes, map_pixels, packed, uncertainty_codes
from processing.sphere import Perspective, directions
from tests.conftest import LONG
from tests.processing.report.made_up import SIZE_PX, context, results

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
    pytest.mark.skipif(not VIEWER.exists(), reason="the viewer is not built: make web"),
    pytest.mark.timeout(900),
]
AXE = Path(__file__).parents[2] / "studio" / "web" / "node_modules" / "axe-core" / "axe.min.js"
PATIENCE_MS = 60_000
"""A ceiling on a wait, for slow machines; nothing is timed."""
COARSE = 0.5
"""Pixels of the screen for each of the page, both ways: without a graphics processor the CPU draws each."""
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]
OPTIONS.append("--disable-gpu")
"""Without a graphics processor the page is put together as the CPU does it best; WebGL is SwiftShader's either way."""


@dataclass
class Opened:
    """The page, and what went wrong in it."""

    page: Any
    folder: Path
    complaints: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    folder = tmp_path_factory.mktemp("session")
    given = context(folder, results(alternatives=1))
    run(given)
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=OPTIONS, timeout=PATIENCE_MS)
        size: dict[str, Any] = {"viewport": {"width": 900, "height": 700}, "device_scale_factor": COARSE}
        tab = browser.new_context(offline=True, reduced_motion="reduce", **size)
        found = Opened(tab.new_page(), folder)
        found.page.set_default_timeout(PATIENCE_MS)
        listen(found)
        found.page.goto((given.folder / "lab.html").as_uri(), timeout=PATIENCE_MS)
        found.page.locator(".viewer").scroll_into_view_if_needed()
        found.page.wait_for_selector(".viewer.ready")
        yield found
        browser.close()


def listen(found: Opened) -> None:
    page, result = found.page, found.complaints
    page.on("console", lambda line: result.append(line.text) if line.type == "error" else None)
    page.on("pageerror", lambda error: result.append(str(error)))
    page.on("requestfailed", lambda asked: result.append(f"failed: {asked.url[:80]}"))
    local = ("file:", "data:", "blob:")
    page.on("request", lambda asked: None if asked.url.startswith(local) else result.append(f"asked: {asked.url[:80]}"))


def pixels(opened: Opened, selector: str) -> np.ndarray:
    """What the screen shows of an element, float (H, W, 3)."""
    png = opened.page.locator(selector).first.screenshot(timeout=PATIENCE_MS, scale="css")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=float)


def shown(opened: Opened, wanted: str) -> None:
    """Wait until the viewer has drawn a state in a mode."""
    opened.page.wait_for_selector(f'.viewer[data-shown="{wanted}"]')


def look(opened: Opened, longitude: float, latitude: float) -> None:
    opened.page.evaluate("([yaw, pitch]) => daylit.panoramas[0].look(yaw, pitch)", [longitude, latitude])


def reading(opened: Opened) -> dict[str, str]:
    found = opened.page.locator("[data-part=reading]").evaluate("(one) => ({ ...one.dataset })")
    assert isinstance(found, dict)
    return found


@pytest.mark.sweep
def test_probe_shows_the_pixels_of_the_picture_on_disk(opened: Opened) -> None:
    """Places under the pointer: the right pixel by our own projection, and its value by the EXR."""
    image = read_exr(opened.folder / "stages" / "calibrate" / "indoor.exr")
    luminance = luminance_cd_m2(image.rgb)
    width, height = SIZE_PX
    opened.page.locator(".viewer .stage").scroll_into_view_if_needed()
    box = opened.page.locator(".viewer canvas").bounding_box()
    rng = np.random.default_rng(5)
    for k in range(20 if LONG else 6):
        look(opened, float(rng.uniform(-180, 180)), float(rng.uniform(-60, 60)))
        x, y = (round(float(rng.uniform(0.2, 0.8)) * box[side]) for side in ("width", "height"))
        opened.page.mouse.move(box["x"] + x - 3, box["y"] + y - 3)
        opened.page.mouse.move(box["x"] + x, box["y"] + y)
        view = view_of(opened)
        found = reading(opened)
        longitude, latitude = direction_at(view, (x, y), (box["width"], box["height"]))
        column = int((longitude / 360 + 0.5) % 1 * width)
        row = int((0.5 - latitude / 180) * height)
        apart = abs(int(found["x"]) - column)
        assert min(apart, width - apart) <= 1, k
        assert abs(int(found["y"]) - row) <= 1, k
        exact = float(luminance[int(found["y"]), int(found["x"])])
        assert float(found["luminance"]) == pytest.approx(exact, rel=LARGEST_ERROR * 1.01), k
    assert "under the pointer" in opened.page.locator("[data-part=detail]").inner_text()


def direction_at(view: list[float], place: tuple[int, int], size: tuple[float, float]) -> tuple[float, float]:
    """Longitude and latitude, degrees, that a view (yaw, pitch, field) shows at a place, by our own geometry."""
    yaw, pitch, field_rad = (math.radians(angle) for angle in view)
    yaw = math.remainder(yaw, math.tau)
    geometry = Perspective(round(size[0]), round(size[1]), field_rad, yaw_rad=yaw, pitch_rad=pitch)
    ray = directions(geometry)[0][min(place[1], geometry.height_px - 1), min(place[0], geometry.width_px - 1)]
    return math.degrees(math.atan2(ray[0], ray[1])), math.degrees(math.asin(ray[2]))


def test_a_region_is_measured_by_dragging_and_a_ruler_by_the_rooms_surfaces(opened: Opened) -> None:
    luminance = luminance_cd_m2(read_exr(opened.folder / "stages" / "calibrate" / "indoor.exr").rgb)
    height, width = luminance.shape
    opened.page.locator(".viewer .stage").scroll_into_view_if_needed()
    look(opened, 40.0, 0.0)
    opened.page.locator(".viewer .segments", has_text="Region").get_by_text("Region").click()
    box = opened.page.locator(".viewer canvas").bounding_box()
    ends = [(round(x * box["width"]), round(y * box["height"])) for x, y in ((0.35, 0.35), (0.6, 0.7))]
    opened.page.mouse.move(box["x"] + ends[0][0], box["y"] + ends[0][1])
    opened.page.mouse.down()
    opened.page.mouse.move(box["x"] + ends[1][0], box["y"] + ends[1][1], steps=3)
    opened.page.mouse.up()
    assert view_of(opened)[0] == pytest.approx(40.0), "the view stands still"
    (left, top), (right, low) = (direction_at(view_of(opened), one, (box["width"], box["height"])) for one in ends)
    rows = (0.5 - (np.arange(height) + 0.5) / height) * 180
    columns = ((np.arange(width) + 0.5) / width - 0.5) * 360
    part = luminance[np.ix_((rows < top) & (rows > low), (columns > left) & (columns < right))].astype(np.float64)
    weight = np.broadcast_to(np.cos(np.radians(rows[(rows < top) & (rows > low)]))[:, None], part.shape)
    known = part > 0
    mean = float((part * weight)[known].sum() / weight[known].sum())
    assert float(reading(opened)["mean"]) == pytest.approx(mean, rel=0.1)
    assert "standard deviation" in opened.page.locator("[data-part=detail]").inner_text()
    assert len(opened.page.locator("[data-part=drawn]").get_attribute("points").split()) > 10
    opened.page.locator(".viewer .segments", has_text="Look").get_by_text("Look").click()
    room = {"floor": [[-2, -1], [2, -1], [2, 3], [-2, 3]], "camera_m": 1.5, "ceiling_m": 2.5}
    result = opened.page.evaluate("(room) => daylit.rulerText(room, [0, 0], [90, 0])", room)
    assert result["value"] == f"{math.hypot(2, 3):.2f} m"
    below = opened.page.evaluate("(room) => daylit.placeIn(room, [10, -80])", room)
    assert below[2] == pytest.approx(-1.5)
    assert math.hypot(*below[:2]) == pytest.approx(1.5 * math.tan(math.radians(10)))


def maps_of(luminance: np.ndarray, validity: np.ndarray) -> dict[str, Any]:
    """The page's maps of a panorama (H, 2 H) that is 5 % uncertain; on disk it is ten times as large."""
    height, width = luminance.shape
    return {
        "luminance": packed(luminance_codes(luminance)),
        "uncertainty": packed(uncertainty_codes(np.full(luminance.shape, 0.05))),
        "validity": packed(validity.astype(np.uint8)),
        "map_px": [width, height],
        "picture_px": [10 * width, 10 * height],
    }


def test_regions_count_by_solid_angle_and_say_what_is_clipped(opened: Opened) -> None:
    """A cap of 5 cd/m2 from 40 degrees up in a room of 1: by pixels it is more than half of the upper half, by solid
    angle 1 - sin 40.
    """
    height, cap = 36, 1 - math.sin(math.radians(40))
    luminance = np.ones((height, 2 * height))
    luminance[:10] = 5
    validity = np.zeros_like(luminance)
    validity[:10, 36:54] = 1
    maps = maps_of(luminance, validity)
    ask = """async (maps) => {
        const probe = await daylit.openProbe(maps);
        const [whole, edge] = [probe.within([80, 90], [-80, 0]), probe.within([170, 10], [-170.1, -10])];
        return [whole, edge, daylit.regionText(whole, "cd/m2").detail];
    }"""
    whole, edge, said = opened.page.evaluate(ask, maps)
    assert whole["mean"] == pytest.approx(1 + 4 * cap, rel=3e-3)
    assert (whole["median"], whole["lowest"], whole["highest"]) == pytest.approx((1, 1, 5), rel=LARGEST_ERROR)
    assert whole["deviation"] == pytest.approx(4 * math.sqrt(cap * (1 - cap)), rel=3e-3)
    assert whole["relativeUncertainty"] == pytest.approx(0.05, rel=0.024)
    assert (whole["steradians"], whole["clipped"], whole["unknown"]) == pytest.approx(
        (math.radians(160), cap / 2, 0), abs=1e-9
    )
    assert whole["box_px"] == [200, 0, 520, 180]
    assert "18 % clipped" in said
    assert edge["mean"] == pytest.approx(1, rel=LARGEST_ERROR)
    assert edge["steradians"] == pytest.approx(math.radians(20) * 2 * math.sin(math.radians(10)))
    assert edge["box_px"] is None


def test_false_colours_take_another_scale(opened: Opened) -> None:
    opened.page.locator(".viewer .segments", has_text="Luminance").get_by_text("Luminance").click()
    shown(opened, "0 colours")
    before = pixels(opened, ".viewer .stage")
    high = opened.page.locator("[data-part=high]")
    usual = high.input_value()
    high.fill(str(30 * float(usual)))
    high.dispatch_event("change")
    opened.page.wait_for_function("() => document.querySelectorAll('[data-part=ticks] .tick').length > 1")
    opened.page.wait_for_timeout(300)
    assert np.abs(pixels(opened, ".viewer .stage") - before).mean() > 2
    high.fill("-1")
    high.dispatch_event("change")
    assert float(high.input_value()) == pytest.approx(30 * float(usual)), "a scale that cannot be stays as it was"
    high.fill(usual)
    high.dispatch_event("change")
    opened.page.locator(".viewer .segments", has_text="Picture").get_by_text("Picture").click()
    shown(opened, "0 0")


def test_probe_says_what_a_value_is_worth(opened: Opened) -> None:
    """The sun beside the room, clipped; a pixel of which nothing is known."""
    width, height = SIZE_PX
    opened.page.mouse.move(1, 1)
    for (x, y), value, words in (((20, 10), "1.600 × 10^9", "clipped"), ((21, 11), "no value", "too dark")):
        longitude, latitude = ((x + 0.5) / width - 0.5) * 360, (0.5 - (y + 0.5) / height) * 180
        result = opened.page.evaluate(
            """async ([longitude, latitude]) => {
              const data = JSON.parse(document.querySelector(".viewer-data").textContent);
              const probe = await daylit.openProbe(data.states[0]);
              return daylit.readingText(probe.at(longitude, latitude), longitude, latitude, data.unit);
            }""",
            [longitude, latitude],
        )
        assert value in result["value"]
        assert words in result["detail"]
        assert f"pixel {x}, {y}" in result["detail"]
    assert len(map_pixels(width, 1024)) == width


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (164.03, 4.02, "164.0 ± 4.0"),
        (45213.7, 823.0, "45\u2009210 ± 820"),
        (0.5, 0.013, "0.500 ± 0.013"),
        (100.0, None, "100.0"),
        (1.6e9, 3.2e7, "1.600 × 10^9 ± 2.0 %"),
    ],
)
def test_readings_are_rounded_by_their_uncertainty(
    opened: Opened, value: float, uncertainty: float | None, text: str
) -> None:
    script = "([value, uncertainty]) => daylit.quantityText(value, uncertainty === null ? NaN : uncertainty)"
    assert opened.page.evaluate(script, [value, uncertainty]) == text


def test_exposure_makes_brighter_and_darker(opened: Opened) -> None:
    look(opened, 0.0, 0.0)
    opened.page.mouse.move(1, 1)
    means = []
    for stops in ("-3", "0", "3"):
        opened.page.locator("[data-part=exposure]").fill(stops)
        shown(opened, f"0 {stops}")
        means.append(pixels(opened, ".viewer .stage")[150:300, 300:600].mean())
    opened.page.locator("[data-part=exposure]").fill("0")
    shown(opened, "0 0")
    assert means[0] + 20 < means[1] < means[2] - 20, means


def test_false_colours_are_those_of_the_scale(opened: Opened) -> None:
    """Dark to the left is blue, bright to the right is red; the scale stands beside, with the unit."""
    opened.page.get_by_text("Luminance", exact=True).first.click()
    shown(opened, "0 colours")
    found = []
    for longitude in (-150.0, 150.0):
        look(opened, longitude, 0.0)
        found.append(pixels(opened, ".viewer .stage")[200:300, 400:500].reshape(-1, 3).mean(axis=0))
    dark, bright = found
    assert dark[2] > dark[0] + 30, dark
    assert bright[0] > bright[2] + 60, bright
    assert opened.page.locator(".scale .unit").inner_text() == "cd/m2"
    assert opened.page.locator(".scale .tick").count() >= 3
    opened.page.get_by_text("Picture", exact=True).first.click()
    shown(opened, "0 0")


def test_another_state_is_another_picture_with_other_numbers(opened: Opened) -> None:
    look(opened, 30.0, 0.0)
    before, result = pixels(opened, ".viewer .stage")[150:300, 300:600].reshape(-1, 3).mean(axis=0), reading(opened)
    opened.page.locator("[data-part=state]").select_option(label="Staged 1")
    shown(opened, "2 0")
    after = pixels(opened, ".viewer .stage")[150:300, 300:600].reshape(-1, 3).mean(axis=0)
    assert after[0] - after[2] > before[0] - before[2] + 30, "the staged picture is the reddish one"
    assert float(reading(opened)["luminance"]) != float(result["luminance"])
    opened.page.locator("[data-part=state]").select_option(label="Photograph")
    shown(opened, "0 0")


def test_slider_divides_two_states(opened: Opened) -> None:
    page = opened.page
    page.get_by_text("Panorama", exact=True).click()
    page.locator("[data-part=left]").select_option("Emptied")
    page.locator("[data-part=right]").select_option("Staged 1")
    reds = []
    for place in ("5", "95"):
        page.locator("[data-part=divide]").fill(place)
        middle = pixels(opened, ".comparison .frame")[100:300, 400:430]
        reds.append((middle[..., 0] - middle[..., 2]).mean())
    assert reds[0] > 20 > -20 > reds[1], "the staged picture is reddish, the emptied one bluish"
    assert page.locator(".at-right").inner_text() == "Staged 1 · virtually staged"
    slider = page.locator("[data-part=divide]")
    slider.press("ArrowLeft")
    assert float(slider.input_value()) < 95, "the keyboard moves it, too"
    assert "Emptied" in slider.get_attribute("aria-valuetext")


def test_mouse_wheel_and_keys_turn_the_panorama(opened: Opened) -> None:
    """What lay under the pointer stays under it in a drag, near the middle; keys turn and zoom; the wheel scrolls."""
    opened.page.locator(".viewer .stage").scroll_into_view_if_needed()
    look(opened, 0.0, 0.0)
    box = opened.page.locator(".viewer canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    opened.page.mouse.move(x, y)
    opened.page.mouse.down()
    opened.page.mouse.move(x + 90, y, steps=3)
    opened.page.mouse.up()
    assert view_of(opened)[0] == pytest.approx(-90 * 95 / box["width"], abs=0.5)
    opened.page.locator(".viewer .stage").focus()
    before = view_of(opened)
    for key in ("ArrowUp", "ArrowRight", "+"):
        opened.page.keyboard.press(key)
    yaw, pitch, field_deg = view_of(opened)
    assert yaw > before[0]
    assert pitch > before[1]
    assert field_deg < before[2]
    opened.page.mouse.wheel(0, 10)
    assert view_of(opened)[2] == field_deg, "it scrolls the page"
    opened.page.evaluate("() => daylit.panoramas[0].look(0, 0, 95)")
    opened.page.mouse.move(1, 1)


def view_of(opened: Opened) -> list[float]:
    found = opened.page.evaluate("() => ['yaw', 'pitch', 'field'].map((name) => daylit.panoramas[0][name])")
    assert isinstance(found, list)
    return found


def test_model_is_shown_and_turns(opened: Opened) -> None:
    opened.page.locator(".models").scroll_into_view_if_needed()
    opened.page.wait_for_selector(".models.ready")
    stage = opened.page.locator(".models .stage")
    opened.page.wait_for_timeout(200)
    before = pixels(opened, ".models .stage")
    assert before.std() > 3, "nothing stands in the model's view"
    stage.focus()
    for _ in range(6):
        opened.page.keyboard.press("ArrowLeft")
    opened.page.wait_for_timeout(200)
    assert np.abs(pixels(opened, ".models .stage") - before).mean() > 1
    assert stage.locator("canvas").get_attribute("aria-label")


def test_on_paper_all_states_are_there_and_nothing_moves(opened: Opened) -> None:
    opened.page.emulate_media(media="print")
    assert not opened.page.locator(".viewer").is_visible()
    shots = opened.page.locator(".shot")
    assert all(shots.nth(k).is_visible() for k in range(shots.count()))
    opened.page.emulate_media(media="screen")


def test_fits_a_phone(opened: Opened) -> None:
    opened.page.set_viewport_size({"width": 390, "height": 844})
    assert opened.page.evaluate("() => document.documentElement.scrollWidth") <= 390
    assert opened.page.locator(".viewer .stage").bounding_box()["width"] >= 340
    opened.page.set_viewport_size({"width": 900, "height": 700})


def test_every_picture_has_words_and_every_control_a_name(opened: Opened) -> None:
    assert opened.page.evaluate("() => [...document.images].every((one) => one.alt.trim())")
    named = """() => [...document.querySelectorAll("input, select")].filter(
        (one) => !(one.labels && one.labels.length) && !one.getAttribute("aria-label")).length"""
    assert opened.page.evaluate(named) == 0
    for width in (390, 900):
        opened.page.set_viewport_size({"width": width, "height": 700})
        assert violations(opened.page) == []


def violations(page: Any) -> list[Any]:
    """What axe-core finds in a page: rule and first element."""
    if page.evaluate("() => typeof axe === 'undefined'"):
        page.evaluate(AXE.read_text("utf-8"))
    asked = "axe.run({ resultTypes: ['violations'] })"  # of what passes, nothing is put together
    found = page.evaluate(f"async () => (await {asked}).violations.map((v) => [v.id, v.nodes[0].html])")
    assert isinstance(found, list)
    return found


def test_nothing_was_asked_of_the_net_and_nothing_failed(opened: Opened) -> None:
    """Last: of all that was done above."""
    assert opened.complaints == []
