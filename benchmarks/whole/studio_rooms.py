"""Rooms of real pictures corrected in the studio by a scripted user who knows the true layout, against editing JSON.

The user drags corners on the plan to where they are, adds and deletes corners where the estimate has another number,
and drags the ceiling in the panorama, until the room is acceptable: floor within `LEAST_IOU`, ceiling within `MOST_M`.
How long people take is modelled (Card, Moran, Newell 1983, keystroke-level model), what the studio takes is measured.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.room.room_real import labelled_rooms, real_rooms
from processing.api import process
from processing.ground.room_model import RoomModel, geometry_problems
from processing.running.panorama_session import panorama_session

LEAST_IOU, MOST_M = 0.95, 0.05
"""Of an acceptable room; chosen: walls are then within a hand's breadth."""
NEAR_M = 0.05
"""Of a corner that stays where it is."""
THINK_S, POINT_S, PRESS_S, KEY_S = 1.35, 1.1, 0.1, 0.28
"""Keystroke-level model: mental preparation, pointing, a button's press or release, a key of an average typist."""
DRAG_S = THINK_S + 2 * POINT_S + 2 * PRESS_S
CLICK_S = THINK_S + POINT_S + 2 * PRESS_S
NUMBER_S = CLICK_S + THINK_S + 6 * KEY_S
"""A number of a file found, marked and typed."""
OPEN_S = THINK_S + 50 * KEY_S
"""`daylit room SESSION --edit`, and saving; the same again to check the file."""


class Corrected(NamedTuple):
    """What a room took: actions and seconds, in the studio and in a file; and how good it was and is."""

    actions: int
    seconds: float
    json_actions: int
    json_s: float
    before: float
    after: float


def sessions(folder: Path, most: int) -> dict[str, tuple[Path, RoomModel]]:
    """Make sessions of the real pictures whose layout is known, their rooms estimated; by name with the truth."""
    every = [*real_rooms("looked at"), *real_rooms("scored"), *labelled_rooms("looked at"), *labelled_rooms("scored")]
    found: dict[str, tuple[Path, RoomModel]] = {}
    for one in every:
        truth = next((r for r in (one.raw, one.visible) if r is not None and not geometry_problems(r)), None)
        if truth is None or len(found) == most:
            continue
        session = panorama_session(one.path, folder)
        process(session, until="room")
        if (session / "stages" / "room" / "room.json").is_file():
            found[one.name] = session, truth
    return found


def corrected(page: Any, session: Path, truth: RoomModel, browser: Any) -> Corrected:
    """Correct a room by the mouse until it is acceptable; ``browser``: the module with what drives the page."""
    browser.screen(page, session.name, "room")
    before = _room(session)
    user = _User(page, session, truth, browser)
    if abs(before.ceiling_height_m - truth.ceiling_height_m) > MOST_M:
        user.ceiling()
    user.floor()
    changed = {corner for corner in _room(session).floor if corner not in before.floor}
    gone = max(0, len(before.floor) - len(truth.floor))
    numbers = 2 * (len(changed) + gone) + (user.raised > 0)
    return Corrected(
        user.actions,
        user.seconds,
        numbers + 2 if numbers else 0,
        numbers * NUMBER_S + 2 * OPEN_S if numbers else 0.0,
        browser.iou(before, truth),
        browser.iou(_room(session), truth),
    )


def _room(session: Path) -> RoomModel:
    own = session / "room.json"
    path = own if own.exists() else session / "stages" / "room" / "room.json"
    return RoomModel.model_validate_json(path.read_bytes())


class _User:
    """Somebody at the mouse, who counts."""

    def __init__(self, page: Any, session: Path, truth: RoomModel, browser: Any) -> None:
        self.page, self.session, self.truth, self.browser = page, session, truth, browser
        self.actions, self.seconds, self.raised = 0, 0.0, 0

    def floor(self) -> None:
        """Bring the corners to the truth: their number first, then the farthest first, until it is acceptable."""
        while len(self._floor()) > len(self.truth.floor):
            self._did(2, CLICK_S + KEY_S, lambda: self._key(self._spare(), "Delete"))
        while len(self._floor()) < len(self.truth.floor):
            wall = self._floor_wall()
            self._did(2, DRAG_S + CLICK_S, lambda wall=wall: self._add(wall))
        order = _matched(self._floor(), np.array(self.truth.floor))
        for corner in sorted(range(len(order)), key=lambda k: -self._off(k, order)):
            if self.browser.iou(self._shown(), self.truth) >= LEAST_IOU and self._saved():
                break
            if self._off(corner, order) > NEAR_M:
                goal = self.truth.floor[order[corner]]
                self._did(1, DRAG_S, lambda corner=corner, goal=goal: self._drag(corner, goal))

    def ceiling(self) -> None:
        """Look at a corner, and drag it to the true height."""
        page, mark = self.page, self.page.locator("[data-name$='at the ceiling: height']").first
        page.locator(".stage").focus()
        begin_s = time.perf_counter()
        for key in ("ArrowRight", "ArrowUp"):
            for _ in range(60):
                box = mark.bounding_box() if mark.count() else None
                if box and (key == "ArrowRight" or box["y"] > 160) and 60 < box["x"] < 760:
                    break
                page.keyboard.press(key)
                page.wait_for_timeout(20)
        box = mark.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        slope = -120.0  # pixels a metre, found while dragging
        for _ in range(6):
            off = self.truth.ceiling_height_m - self._shown().ceiling_height_m
            if abs(off) < 0.01:
                break
            height = self._shown().ceiling_height_m
            y += slope * off
            page.mouse.move(x, y)
            page.wait_for_timeout(60)
            moved = self._shown().ceiling_height_m - height
            slope = slope * off / moved if abs(moved) > 1e-3 else slope
        page.mouse.up()
        page.wait_for_timeout(400)
        self.raised, self.actions = 1, self.actions + 2
        self.seconds += 2 * DRAG_S + time.perf_counter() - begin_s

    def _did(self, actions: int, human_s: float, act: Any) -> None:
        begin_s = time.perf_counter()
        act()
        self.page.wait_for_timeout(150)
        self.actions += actions
        self.seconds += human_s + time.perf_counter() - begin_s

    def _shown(self) -> RoomModel:
        """The room as the page has it, saved or not: the browser keeps what was not."""
        text = self.page.evaluate("(name) => localStorage.getItem(name)", f"room {self.session.name}")
        return RoomModel.model_validate_json(text) if text else _room(self.session)

    def _saved(self) -> bool:
        return self.page.evaluate("(name) => !localStorage.getItem(name)", f"room {self.session.name}") is True

    def _floor(self) -> np.ndarray:
        return np.array(self._shown().floor)

    def _off(self, corner: int, order: list[int]) -> float:
        return float(np.hypot(*(self._floor()[corner] - self.truth.floor[order[corner]])))

    def _spare(self) -> int:
        """The corner without which the room is best."""
        floor = self._floor()
        return max(range(len(floor)), key=lambda k: _worth(np.delete(floor, k, axis=0), self.truth, self.browser))

    def _floor_wall(self) -> int:
        """The wall that is farthest from any two true corners: it lacks one."""
        floor, truth = self._floor(), np.array(self.truth.floor)
        middle = (floor + np.roll(floor, -1, axis=0)) / 2
        missing = max(truth, key=lambda p: np.hypot(*(floor - p).T).min())
        return int(np.hypot(*(middle - missing).T).argmin())

    def _key(self, corner: int, key: str) -> None:
        self.page.locator(f"[data-corner='{corner}']").focus()
        self.page.keyboard.press(key)

    def _add(self, wall: int) -> None:
        """Turn to a wall's middle, and add a corner there."""
        floor = self._floor()
        x, y = (floor[wall] + floor[(wall + 1) % len(floor)]) / 2
        goal = np.degrees(np.arctan2(x, y))
        self.page.locator(".stage").focus()
        turns = round(((goal - self.page.evaluate("() => window.lastYaw ?? 0") + 540) % 360 - 180) / 4.63)
        for _ in range(abs(turns)):
            self.page.keyboard.press("ArrowRight" if turns > 0 else "ArrowLeft")
        self.page.evaluate("(yaw) => { window.lastYaw = yaw; }", float(goal))
        self.page.get_by_role("button", name="Add corner").click()
        self.page.wait_for_timeout(200)

    def _drag(self, corner: int, goal: Any) -> None:
        page = self.page
        box = self.browser.box_of(page, f"[data-corner='{corner}']")
        place = page.evaluate(self.browser._TO_SCREEN, list(goal))  # noqa: SLF001 (the same benchmark)
        page.keyboard.down("Shift")
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        page.mouse.move(*place, steps=4)
        page.mouse.up()
        page.keyboard.up("Shift")


def _matched(floor: np.ndarray, truth: np.ndarray) -> list[int]:
    """Return which true corner each corner is: both run the same way round."""
    turns = [np.roll(np.arange(len(truth)), -k) for k in range(len(truth))]
    best = min(turns, key=lambda order: float(np.hypot(*(floor - truth[order]).T).sum()))
    return [int(k) for k in best]


def _worth(floor: np.ndarray, truth: RoomModel, browser: Any) -> float:
    import shapely

    shape = shapely.Polygon(floor)
    return (
        float(browser.iou(truth.model_copy(update={"floor": tuple(map(tuple, floor))}), truth)) if shape.is_valid else 0
    )
