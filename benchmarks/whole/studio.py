"""The studio in a real browser: corners dragged to the truth of generated rooms by the mouse, and how long one waits.

Each room's estimate has two corners in wrong places; a scripted user drags them to where they are. The picture is the
bare room, drawn here: nothing but pixels to draw is taken from it. Times are wall times of a browser without a graphics
processor.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import shapely
from PIL import Image

from benchmarks.memory import MemoryWatch
from benchmarks.seeds import seeds
from benchmarks.truth_rooms import room_model_of
from drivers.errors import DaylitError
from mocks.rooms.room import make_room
from processing.ground.room_model import RoomModel, geometry_problems, write_room
from processing.layout.arrange import arrange
from processing.layout.assumed import with_door
from processing.layout.items import parse_items
from processing.layout.plan import from_room_model
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.preview import write_mask
from processing.running.panorama_session import panorama_session
from processing.sphere import Equirectangular

SIZE_PX = (512, 256)
FULL = 13
"""Times `SIZE_PX`: 6656 x 3328, about a Theta Z1's."""
ROOMS, QUICK_ROOMS = 12, 2
WRONG_M = 0.45
"""By which two corners of an estimate are off."""
MOST_REAL = 12
"""Real pictures whose rooms are corrected, where the shared data are there."""
POLL_MS = 20
"""Between looks whether a page has got there."""
MOVES = 12
"""Of the mouse in a drag."""
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]
PATIENCE_MS, PATIENCE_LARGE_MS = 60_000, 300_000
ITEMS = "bed, nightstand, chest"
DARK = 3.0
"""Of the things in the room, where the floor has 18 to 24."""


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    from playwright.sync_api import sync_playwright

    from benchmarks.whole import studio_lit

    count = QUICK_ROOMS if quick else ROOMS
    real: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="daylit-studio-") as place, sync_playwright() as started:
        folder = Path(place)
        truths = {number: truth(number) for number in seeds("test", count, seed)}
        made = {number: make_session(folder, f"room {number}", wrong(room), room) for number, room in truths.items()}
        times = 2 if quick else FULL
        large = make_session(folder, "large", wrong(room := next(iter(truths.values()))), room, times)
        light = studio_lit.session(folder, next(iter(truths)), quick=quick)
        browser = started.chromium.launch(executable_path=CHROMIUM, args=OPTIONS, timeout=PATIENCE_MS)
        with served(folder) as (links, server):
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.set_default_timeout(PATIENCE_MS)
            begin_s = time.perf_counter()
            page.goto(links[0])
            page.wait_for_selector("#screen[data-ready]")
            first_page_s = time.perf_counter() - begin_s
            gains, drags = [], []
            for number, room in truths.items():
                before = iou(wrong(room), room)
                drags.append(corrected(page, made[number].name, room))
                after = RoomModel.model_validate_json((made[number] / "room.json").read_bytes())
                gains.append(iou(after, room) - before)
            first_preview_s, preview_s, preview_cpu_s = emptied(page, next(iter(made.values())).name, server.pid)
            relit_ms, relit_worst_ms = studio_lit.relit(page, light.name)
            begin_s = time.perf_counter()
            with MemoryWatch(pid=server.pid) as watch:
                screen(page, large.name, "results", limit_ms=PATIENCE_LARGE_MS)
                page.wait_for_selector(".viewer.ready", timeout=PATIENCE_LARGE_MS)
            full_size_s, tab_mb = time.perf_counter() - begin_s, renderer_mb()
        if not quick:
            real = _real_rooms(browser)
        browser.close()
    return {
        "metrics": real
        | {
            "corner_iou_gain": round(float(np.median(gains)), 4),
            "drag_ms": round(float(np.median(drags)), 2),
            "preview_s": round(preview_s, 2),
            "preview_cpu_s": round(preview_cpu_s, 2),
            "first_preview_s": round(first_preview_s, 2),
            "relit_ms": round(relit_ms),
            "relit_worst_ms": round(relit_worst_ms),
            "first_page_s": round(first_page_s, 3),
            "full_size_s": round(full_size_s, 2),
            "server_peak_mb": round(watch.own_peak_mb),
            "tab_mb": round(tab_mb),
            "rooms": count,
        },
        "units": {"corner_iou_gain": "IoU", "rooms": ""}
        | {key: "" for key in real if key.endswith(("rooms", "actions", "share"))},
        "notes": [
            "preview_s: of one object clicked away; first_preview_s: with the start of the program that makes it",
            "relit_ms: from a move of a dragged piece to its picture in the captured light; worst: the slowest piece",
            f"full_size_s: until a panorama of {times * SIZE_PX[0]} pixels across is on the screen with its numbers "
            "(of full size in full runs alone); server and tab meanwhile",
        ],
    }


def _real_rooms(browser: Any) -> dict[str, float]:
    """Return what rooms of real pictures take until they are acceptable: medians, of the studio and of a file."""
    from benchmarks.whole import studio_rooms

    with tempfile.TemporaryDirectory(prefix="daylit-studio-") as place:
        made = studio_rooms.sessions(Path(place), MOST_REAL)
        with served(Path(place)) as (links, _):
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.set_default_timeout(PATIENCE_MS)
            page.goto(links[0])
            page.wait_for_selector("#screen[data-ready]")
            found = [
                studio_rooms.corrected(page, session, truth, sys.modules[__name__]) for session, truth in made.values()
            ]
    if not found:
        return {"real_rooms": 0}
    actions, seconds, by_file, file_s, _, after = (np.array(column) for column in zip(*found, strict=True))
    return {
        "real_rooms": len(found),
        "real_room_actions": float(np.median(actions)),
        "real_room_s": round(float(np.median(seconds)), 1),
        "real_room_file_actions": float(np.median(by_file)),
        "real_room_file_s": round(float(np.median(file_s)), 1),
        "real_acceptable_share": round(float((after >= studio_rooms.LEAST_IOU).mean()), 3),
    }


def truth(number: int) -> RoomModel:
    """The shape of a generated room, as the estimate would be at best."""
    return room_model_of(make_room(number))


def wrong(room: RoomModel) -> RoomModel:
    """The room with its first and third corner moved away from the camera, openings left out that no longer fit."""
    floor = [np.array(corner) for corner in room.floor]
    for corner in (0, 2):
        floor[corner] = floor[corner] * (1 + WRONG_M / np.hypot(*floor[corner]))
    moved = tuple((round(float(x), 4), round(float(y), 4)) for x, y in floor)
    made = room.model_copy(update={"floor": moved, "source": "estimated", "confidence": 0.6, "openings": ()})
    assert not geometry_problems(made), geometry_problems(made)
    return made


def iou(one: RoomModel, other: RoomModel) -> float:
    """Of two floors."""
    a, b = shapely.Polygon(one.floor), shapely.Polygon(other.floor)
    return float(a.intersection(b).area / a.union(b).area)


def renderer_mb() -> float:
    """Memory of the browser's largest page."""
    every = psutil.Process().children(recursive=True)
    return max(MemoryWatch(pid=one.pid).sampled_mb for one in every if "--type=renderer" in one.cmdline())


def make_session(
    folder: Path, name: str, estimated: RoomModel, room: RoomModel, times: int = 1, seen: np.ndarray | None = None
) -> Path:
    """A session of one panorama whose room was estimated, with two detected things (dark) and an arrangement.

    ``times``: as wide as `SIZE_PX`; ``seen``: what the panorama shows in place of what is drawn and dark.
    """
    rgb = drawn(room)
    mask = np.zeros(rgb.shape[:2], bool)
    mask[150:190, 60:120] = mask[160:200, 300:380] = True
    rgb[mask] = DARK
    rgb, mask = (one.repeat(times, 0).repeat(times, 1) for one in (rgb, mask))
    rgb = rgb if seen is None else seen
    picture = folder / f"{name}.png"
    Image.fromarray((255 * np.clip(rgb / 100, 0, 1) ** (1 / 2.2)).astype(np.uint8)).save(picture)
    session = panorama_session(picture, folder)
    picture.unlink()
    results = {stage: session / "stages" / stage for stage in ("calibrate", "room", "detect")}
    for where in results.values():
        where.mkdir(parents=True)
        (where / "result.json").write_text("{}")
    height, width = rgb.shape[:2]
    zeros = np.zeros((height, width), np.float32)
    image = LuminanceImage(
        rgb, zeros + 0.02, zeros.astype(np.uint8), Equirectangular(width, height), 0.02, absolute=False
    )
    write_exr(results["calibrate"] / "indoor.exr", image)
    write_room(results["room"] / "room.json", estimated)
    write_mask(results["detect"] / "target.png", mask)
    furnished(session, estimated)
    return session


def furnished(session: Path, room: RoomModel) -> None:
    """Give a session an arrangement of three pieces, where its room takes them."""
    where = session / "stages" / "arrange"
    where.mkdir(exist_ok=True)
    (where / "result.json").write_text("{}")
    plan = from_room_model(with_door(room)[0], name="room", keep_camera_free=True)
    try:
        arrange(plan, parse_items(ITEMS), n=1).write(where / "arrangement.json")
    except DaylitError:
        shutil.rmtree(where)


def drawn(room: RoomModel) -> np.ndarray:
    """The room as its panorama shows it, (H, W, 3) float32, 1 to 100: walls grey, openings bright, floor of boards."""
    width, height = SIZE_PX
    longitude = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    slope = np.tan((0.5 - (np.arange(height) + 0.5) / height) * np.pi)[:, None]
    away = np.full(width, np.inf)
    shade, wall, place_m = np.zeros(width), np.zeros(width, int), np.zeros(width)
    corners = np.array(room.floor)
    for k, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
        ray, along = np.stack([np.sin(longitude), np.cos(longitude)]), b - a
        turn = ray[0] * along[1] - ray[1] * along[0]
        t = (a[0] * along[1] - a[1] * along[0]) / turn
        u = (a[0] * ray[1] - a[1] * ray[0]) / turn
        hit = (t > 0) & (u >= 0) & (u <= 1) & (t < away)
        away[hit], shade[hit] = t[hit], 35 + 9 * (k % 5)
        wall[hit], place_m[hit] = k, u[hit] * np.hypot(*along)
    z = room.camera_height_m + slope * away
    level = np.repeat(shade[None], height, axis=0)
    for one in room.openings:
        wide = (wall == one.wall) & (place_m > one.start_m) & (place_m < one.end_m)
        level[wide & (z > one.sill_m) & (z < one.head_m)] = 95
    level[z > room.ceiling_height_m] = 80
    below = z < 0
    reach = np.where(below, room.camera_height_m / np.maximum(-slope, 1e-6), 0)
    boards = 18 + 6 * (np.floor(4 * reach * np.sin(longitude)) % 2)
    level = np.where(below, boards, level)
    return np.repeat(level[..., None], 3, axis=2).astype(np.float32)


@contextmanager
def served(folder: Path, port: int = 0) -> Iterator[tuple[list[str], subprocess.Popen[str]]]:
    """The server as a program of its own; links to it, and the program."""
    process = start(folder, port)
    assert process.stdout is not None
    try:
        yield json.loads(process.stdout.readline())["links"], process
    finally:
        stop(process)


def start(folder: Path, port: int = 0) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "daylit", "studio", str(folder), "--port", str(port), "--no-open", "--json"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=dict(os.environ))


def stop(process: subprocess.Popen[str], by: int = signal.SIGKILL) -> None:
    process.send_signal(by)
    process.wait(timeout=30)
    if process.stdout:
        process.stdout.close()


def until(page: Any, script: str, arg: object = None, *, limit_ms: float = PATIENCE_MS) -> None:
    """Wait until a script says so; the page's policy forbids the browser driver's own way, which evaluates text."""
    end_s = time.monotonic() + limit_ms / 1000
    while not page.evaluate(script, arg):
        if time.monotonic() > end_s:
            raise TimeoutError(script)
        page.wait_for_timeout(POLL_MS)


def screen(page: Any, session: str, kind: str, *, limit_ms: float = PATIENCE_MS) -> None:
    """Open a screen of a session and wait until it stands."""
    page.evaluate(
        "([session, kind]) => { location.hash = `#/${encodeURIComponent(session)}/${kind}`; }", [session, kind]
    )
    until(page, "() => document.querySelector('#screen').dataset.ready === location.hash", limit_ms=limit_ms)


def corrected(page: Any, session: str, room: RoomModel) -> float:
    """Drag the wrong corners on the plan to where they are; return the median milliseconds of a move of the mouse."""
    screen(page, session, "room")
    page.evaluate(_WATCH)
    page.keyboard.down("Shift")
    for corner in (0, 2):
        drag(page, f"[data-corner='{corner}']", room.floor[corner])
    page.keyboard.up("Shift")
    return float(np.median(page.evaluate("() => window.moveTimes")))


def drag(page: Any, mark: str, to: Sequence[float], *, drop: bool = True) -> None:
    """Drag something on the plan to a place in metres by the mouse, and wait until it is saved."""
    box = box_of(page, f".plan {mark}")
    before = page.locator("[data-part=facts], [data-part=verdict]").first.get_attribute("data-saved")
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    place = page.evaluate(_TO_SCREEN, list(to))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(*place, steps=MOVES)
    if not drop:
        return
    page.mouse.up()
    changed = "(old) => (document.querySelector('[data-saved]')?.dataset.saved ?? null) !== old"
    until(page, changed, before)


def box_of(page: Any, mark: str) -> dict[str, float]:
    """Where a mark is, which may just be drawn anew."""
    end_s = time.monotonic() + PATIENCE_MS / 1000
    while (box := page.locator(mark).first.bounding_box()) is None:
        if time.monotonic() > end_s:
            raise TimeoutError(mark)
        page.wait_for_timeout(POLL_MS)
    return dict(box)


def emptied(page: Any, session: str, server: int) -> tuple[float, float, float]:
    """Return the seconds until the emptied room is previewed at first, and again after an object was clicked away.

    And, of the second, the CPU seconds of the program that makes it.
    """

    def cpu_s() -> float:
        return sum(sum(one.cpu_times()[:2]) for one in psutil.Process(server).children())

    screen(page, session, "remove")
    begin_s = time.perf_counter()
    page.get_by_label("Picture").select_option("Emptied: preview")
    page.wait_for_selector("canvas[data-shown='Emptied: preview']")
    first_s, begin_s = time.perf_counter() - begin_s, time.perf_counter()
    made, before_s = page.locator("main canvas").get_attribute("data-made"), cpu_s()
    page.get_by_role("checkbox", name="Object 2").uncheck()
    until(page, "(old) => document.querySelector('main canvas').dataset.made !== old", made)
    return first_s, time.perf_counter() - begin_s, cpu_s() - before_s


_TO_SCREEN = """([x, y]) => {
  const plan = document.querySelector(".plan");
  const place = new DOMPoint(x, -y).matrixTransform(plan.getScreenCTM());
  return [place.x, place.y];
}"""
_WATCH = """() => {
  window.moveTimes = [];
  window.addEventListener("pointermove", () => {
    const begin = performance.now();
    requestAnimationFrame(() => setTimeout(() => window.moveTimes.push(performance.now() - begin)));
  }, { capture: true });
}"""
