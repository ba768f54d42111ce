"""The display of pictures: is white white, is the view outside kept, are before and after comparable; by true rooms.

In each simulated room of test seeds the true panorama is shown as `processing.pictures.display` shows a session: white
by the board where it truly stands, windows where they truly are. ``ceiling_ab_err`` and ``wall_ab_err``: distance in
a*b* between what is shown of these surfaces and what their true albedo is under the screen's own white at the same
lightness, median over the room's pixels, then over rooms (``_p90``: nine rooms in ten). ``clipped_window_share``: of
what one sees through panes, how much has a code of 254 or more, mean over rooms. ``before_after_moved_pct``: of the
pixels whose light differs by less than 0.2 % between the furnished and the emptied room, those 3 or more codes apart.
Beside them, the stills of whole rooms: `benchmarks.whole.stills_rooms`.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from benchmarks.truth_rooms import truth_list, truth_of
from benchmarks.whole.stills_rooms import judged
from mocks.rooms.model import Use
from mocks.rooms.truth import WINDOWPANE, TruthPictures
from mocks.rooms.world import RoomWorld
from processing.ground.arrays import Bytes, Flags, Floats
from processing.ground.colour import lab_of_linear, linear_of_srgb, luminance_cd_m2
from processing.pictures.display import AS_GIVEN, Display, display_of, spot_colour
from processing.pictures.preview import preview_rgb8

QUICK_ROOMS, FULL_ROOMS = 3, 24
ROWS = 256
CLIPPED = 254
SAME_LIGHT, SAME_CODES = 0.002, 2


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    rooms = truth_list("test", QUICK_ROOMS if quick else FULL_ROOMS, seed)
    rows = [room_row(number, use) for number, use in rooms]
    rivals = {name: _figures([row[name] for row in rows]) for name in ("as_measured", "neutral_surfaces", "windows")}
    ours = [row["ours"] for row in rows]
    notes = [f"{row['room']}: {row['white']}; " + _note(row["ours"]) for row in rows]
    metrics = {
        "rooms": len(rows),
        **_figures(ours),
        "before_after_moved_pct": round(100 * float(np.mean([row["before_after"] for row in rows])), 3),
        "cpu_ms_mpx": round(float(np.median([row["cpu_ms_mpx"] for row in rows])), 1),
    }
    whole = judged(seed, quick=quick)
    return {
        "metrics": metrics | whole["metrics"],
        "rivals": rivals | whole["rivals"],
        "notes": [*notes, *whole["notes"]],
    }


def room_row(number: int, use: Use) -> dict[str, Any]:
    """Return one room's figures, of ours and of others."""
    room, truth = truth_of(number, use, ROWS)
    rgb = truth.luminance_rgb
    panes = truth.ade == WINDOWPANE
    x, y, z = RoomWorld(room, "sketch").board_direction
    board = None if room.board() is None else spot_colour(rgb, math.atan2(x, y), math.asin(z))
    display = display_of(rgb, board_rgb=board, panes=panes)
    start_s = time.process_time()
    shown = display.shown(rgb, panes)
    cpu_s = time.process_time() - start_s
    same = (np.abs(truth.empty_rgb / np.maximum(rgb, 1e-6) - 1) < SAME_LIGHT).all(axis=2)
    apart = np.abs(display.shown(truth.empty_rgb, panes).astype(int) - shown).max(axis=2)[same]
    others: dict[str, Display] = {
        "neutral_surfaces": display_of(rgb),
        "windows": display_of(rgb, panes=panes),
    }
    return {
        "room": room.name,
        "white": display.said,
        "ours": _judged(shown, display.light(rgb, panes), truth, panes),
        "before_after": float((apart > SAME_CODES).mean()) if apart.size else 0.0,
        "cpu_ms_mpx": 1e9 * cpu_s / panes.size,
        "as_measured": _judged(preview_rgb8(rgb), AS_GIVEN.light(rgb), truth, panes),
        **{name: _judged(one.shown(rgb, panes), one.light(rgb, panes), truth, panes) for name, one in others.items()},
    }


def _judged(shown: Bytes, light: Floats, truth: TruthPictures, panes: Flags) -> dict[str, float | None]:
    """Return a picture's figures: errors of colour by kind of surface, and the clipped share of the panes."""
    names = np.array([*truth.surface_names, ""])[truth.surface]
    found: dict[str, float | None] = {}
    for kind in ("ceiling", "wall"):
        where = np.char.startswith(names, kind) & (truth.albedo.min(axis=2) > 0.02) & ~truth.furniture
        found[kind] = _colour_error(shown, light, truth.albedo, where) if where.any() else None
    found["clipped"] = float((shown[panes].max(axis=1) >= CLIPPED).mean()) if panes.any() else None
    return found


def _colour_error(shown: Bytes, light: Floats, albedo: Floats, where: Flags) -> float:
    """Return the median distance in a*b*, at the lightness that is shown, before the film bends highlights."""
    level = luminance_cd_m2(linear_of_srgb(shown[where])).astype(np.float64)[:, None]
    seen, actual = (np.asarray(one[where], np.float64) for one in (light, albedo))
    lab = [lab_of_linear(one / luminance_cd_m2(one)[:, None] * level, np.ones(3)) for one in (seen, actual)]
    return float(np.median(np.hypot(*(lab[0] - lab[1])[:, 1:].T)))


def _figures(rows: list[dict[str, float | None]]) -> dict[str, float]:
    found = {}
    for kind in ("ceiling", "wall"):
        values = [row[kind] for row in rows if row[kind] is not None]
        found[f"{kind}_ab_err"] = round(float(np.median(values)), 2)
        found[f"{kind}_ab_err_p90"] = round(float(np.quantile(values, 0.9)), 2)
    clipped = [row["clipped"] for row in rows if row["clipped"] is not None]
    return {**found, "clipped_window_share": round(float(np.mean(clipped)), 4)}


def _note(row: dict[str, float | None]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in row.items() if value is not None)
