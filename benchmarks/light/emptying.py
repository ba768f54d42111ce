"""Emptied rooms in their own light: what the stages light and remove make, against the truly emptied room.

Rows are those of `end_to_end`: simulated rooms of test seeds through the whole pipeline, nothing given. ``filled_*``:
where removal filled in; ``all_*``: all valid pixels; ``near_holes_*``: seen pixels within 4 degrees of what was filled,
where ghosts would be; ``staged_*``: the first staged picture where furniture changes it, ``staged_above_15`` the number
of rooms of which it is more than 15 % off; ``pane_worst_pct``: the worst pane's mean radiance towards the camera, of
what the camera sees on it; ``pane_median_pct`` the median of the rooms' worst; ``depth_err_pct``: distance of the old
furniture's stand-ins. Medians over the rooms that were emptied, but for the worst pane; ``rooms_not_emptied`` of all
``rooms`` were refused, or nothing was found to remove. ``cpu_s``: the stages light and remove together,
``full_size_cpu_s``: the same of the first room at the rig's full size (not in a quick run). Rival: ``keep``, the same
rooms with the shade kept (what every other tool does), in a quick run only on the first room.

``clipped_windows_*``: the same rooms as single photographs without a picture of the sky, each clipped at `CLIPPED_AT`
times its median: how far the windows' strength (`sources.brightened`) is off, stops, median and worst, and how often
its interval holds the true one, over the ``clipped_windows`` cases whose windows clip at all. True is what the room's
panes show the camera over what the clipped picture does; rooms, masks and distances are the true ones.

``clipped_sun_*``: the same rooms with an outdoor picture whose sun is cut at `SUN_SHOWN` of its light: how far its
strength by the patches that it lights in the room (`sources.sun_strength`) is off, stops, median and worst, and how
often its interval holds the true one, over the ``clipped_sun`` rooms that show such a patch.

``infinigen_*``: rooms of another generator and another renderer (Infinigen Indoors, Cycles), furnished and emptied
under the same daylight (`benchmarks.light.independent`; made by `benchmarks.removal.infinigen_rooms`);
``infinigen_unseen_*``: the half of them that nobody looks at. A quick run takes one pair of pictures of the first half.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.light.albedo import outdoors_of_room, picture
from benchmarks.light.independent import independent
from benchmarks.sessions import write_session
from benchmarks.truth_rooms import LIGHT_QUALITY, room_model_of, truth_list, truth_of
from benchmarks.whole.end_to_end import FULL_DIVISOR, FULL_ROOMS, QUICK_DIVISOR, QUICK_ROOMS, rig_profile, rows_of
from benchmarks.whole.end_to_end_run import PANORAMA_PX, taken_of
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.truth import TruthPictures
from processing.ground.room_model import RoomModel
from processing.light.scene.albedo import DARK
from processing.light.scene.furnished import OldFurniture, furnished_light
from processing.light.scene.scene import Outdoors, Scene, shell_of
from processing.light.scene.standins import standins_of
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import GLASS, sight_of
from processing.light.solver.stage import Stage
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from processing.running.requests import RunRequest
from processing.running.runner import process
from processing.sphere import Equirectangular, solid_angles
from processing.stages.contract import Quality

KEYS = {
    "filled_median_err_pct": "empty_median_err_pct",
    "filled_bias_pct": "empty_bias_pct",
    "all_median_err_pct": "empty_all_median_err_pct",
    "near_holes_p95_err_pct": "empty_near_p95_err_pct",
    "staged_median_err_pct": "staged_median_err_pct",
    "staged_bias_pct": "staged_bias_pct",
    "depth_err_pct": "depth_err_pct",
}
"""Key of this benchmark: key of an end-to-end row."""
STAGES = ("light", "remove")


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    profile = rig_profile(seed)
    rows = rows_of(profile, seed, quick=quick)
    kept = rows_of(profile, seed, quick=quick, rooms=1 if quick else None, options={"--shade": "keep"})
    lifted, others = _metrics(rows), _metrics(kept)
    count, divisor = (QUICK_ROOMS, QUICK_DIVISOR) if quick else (FULL_ROOMS, FULL_DIVISOR)
    rooms = truth_list("test", count, seed)
    if not quick:
        lifted["full_size_cpu_s"] = round(spent_s(*rooms[0], profile, 1), 1)
    clipped = [one for number, use in rooms for one in clipped_windows(number, use, PANORAMA_PX // divisor // 2)]
    lifted |= clipped_metrics("windows", clipped)
    lifted |= clipped_metrics("sun", [sun for one in rooms if (sun := clipped_sun(*one, PANORAMA_PX // divisor // 2))])
    found, notes = independent(quick=quick)
    lifted |= found.get("lift", {})
    others |= found.get("keep", {})
    return {"metrics": lifted, "rivals": {"keep": others}, "notes": [*(_line(row) for row in rows), *notes]}


def spent_s(number: int, use: Use, profile: Path, divisor: int) -> float:
    """Return what light and remove take of a room in pictures ``divisor`` times smaller than the rig's, CPU s."""
    room = make_room(number, use)
    with tempfile.TemporaryDirectory() as folder:
        session = write_session(Path(folder) / room.name, taken_of(room, divisor))
        asked: dict[str, object] = {"--calibration": str(profile)}
        done = process(session, RunRequest(quality=Quality.STANDARD, until="remove", options=asked))
        return float(sum(one.cost.cpu_seconds for one in done.stages if one.stage in STAGES and one.cost))


CLIPPED_AT = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)
"""Times a picture's median luminance: exposures for the room, and for what stands before its windows."""
LEAST_STRENGTH = 1.1  # of windows that clip; chosen
LOOK = Effort(texel_m=0.15, rows=32, patch_samples=64, pixel_samples=4, sun_samples=4, clean=False)
"""The strength is found by the patches alone, as many samples each as the stage light takes at standard quality."""
STRENGTH = re.compile(r": ([\d.]+) times .*\(([\d.]+) to ([\d.]+)\)")
SUN_SHOWN = 0.03  # a disc of 1.6e9 cd/m2, cut at 5e7: the shortest stop behind ND 3.0


def clipped_windows(
    number: int, use: Use, rows: int, quality: str = LIGHT_QUALITY, size: int = 128
) -> list[tuple[str, float, float, float, float]]:
    """Return of a room, for each level at which its windows clip: name and level, true strength, found, low, high.

    ``rows``, ``quality``: of its kept truth; the pictures are looked at in ``size`` rows.
    """
    room, truth, model, old = _known(number, use, rows, quality)
    geometry = Equirectangular(2 * rows, rows)
    surfaces, panes = shell_of(model)
    glass = sight_of(Stage.of(Scene(surfaces, panes, Outdoors(DARK)), 0.5), geometry, room.eye).label == GLASS
    seen = glass.reshape(old.target.shape) & ~old.target
    area, luminance = solid_angles(geometry)[seen], luminance_cd_m2(truth.luminance_rgb)
    found = []
    for times in CLIPPED_AT:
        rgb = np.minimum(truth.luminance_rgb, np.float32(times * np.median(luminance)))
        true = float(area @ luminance[seen] / (area @ luminance_cd_m2(rgb)[seen])) if seen.any() else 1.0
        if true < LEAST_STRENGTH:
            continue
        validity = np.where((rgb < truth.luminance_rgb).any(axis=2), Validity.CLIPPED, Validity.VALID).astype(np.uint8)
        photograph = LuminanceImage(
            rgb, np.full(seen.shape, 0.02, np.float32), validity, geometry, 0.02, absolute=False
        )
        light = furnished_light(photograph, model, None, old, rows=size, effort=LOOK)
        found.append((f"{room.name} at {times:g}", true, *_said("windows", light.notes)))
    return found


def _known(number: int, use: Use, rows: int, quality: str) -> tuple[Room, TruthPictures, RoomModel, OldFurniture]:
    """Return a room, its truth and model, and its furniture with the true masks and distances."""
    room, truth = truth_of(number, use, rows=rows, quality=quality)
    model = room_model_of(room)
    parts = standins_of(model, truth.furniture, np.where(np.isfinite(truth.depth_m), truth.depth_m, 0))
    return room, truth, model, OldFurniture(truth.furniture, truth.furniture | truth.tripod, parts)


def _said(what: str, notes: Sequence[str]) -> tuple[float, float, float]:
    """Return the strength that a note states, and its interval."""
    match = next(match for note in notes if note.startswith(what) and (match := STRENGTH.search(note)))
    strength, low, high = (float(value) for value in match.groups())
    return strength, low, high


def clipped_sun(
    number: int, use: Use, rows: int, quality: str = LIGHT_QUALITY, size: int = 128
) -> tuple[str, float, float, float, float] | None:
    """Return of a room under a cut sun: name, true strength, found, low, high; None where no patch of it is seen."""
    if make_room(number, use).sky.disc() is None:
        return None
    room, truth, model, old = _known(number, use, rows, quality)
    outdoors = outdoors_of_room(room)
    if outdoors.sun is None:
        return None
    red, green, blue = (SUN_SHOWN * one for one in outdoors.sun.normal_illuminance_lx)
    cut = replace(outdoors, sun=replace(outdoors.sun, normal_illuminance_lx=(red, green, blue), clipped=True))
    light = furnished_light(picture(truth.luminance_rgb), model, cut, old, rows=size, effort=LOOK)
    if any("lower bound" in note or "sun: 0.0 " in note for note in light.notes):
        return None
    return (room.name, 1 / SUN_SHOWN, *_said("sun", light.notes))


def clipped_metrics(kind: str, found: Sequence[tuple[str, float, float, float, float]]) -> dict[str, float]:
    """Return metrics of what `clipped_windows` and `clipped_sun` found; none of no case."""
    if not found:
        return {}
    off = [abs(math.log2(strength / true)) for _, true, strength, _, _ in found]
    inside = [low - 0.05 <= true <= high + 0.05 for _, true, _, low, high in found]  # the note has one decimal
    return {
        f"clipped_{kind}": len(found),
        f"clipped_{kind}_err_stops": round(float(np.median(off)), 3),
        f"clipped_{kind}_worst_stops": round(max(off), 2),
        f"clipped_{kind}_cover90_pct": round(100 * float(np.mean(inside)), 1),
    }


def _metrics(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    found = {name: _median(rows, key) for name, key in KEYS.items() if any(key in row for row in rows)}
    found |= {"rooms": len(rows), "rooms_not_emptied": sum(KEYS["filled_median_err_pct"] not in row for row in rows)}
    panes = [row["pane_worst_pct"] for row in rows if "pane_worst_pct" in row]
    spent = [sum(row["stage_cpu_s"].get(stage, 0.0) for stage in STAGES) for row in rows if "stage_cpu_s" in row]
    found |= {"pane_worst_pct": max(panes, default=0.0), "cpu_s": round(float(np.median(spent)), 2)}
    found["staged_above_15"] = sum(row.get("staged_median_err_pct", 0.0) > 15 for row in rows)
    return found | ({"pane_median_pct": round(float(np.median(panes)), 2)} if panes else {})


def _median(rows: Sequence[dict[str, Any]], key: str) -> float:
    return round(float(np.median([row[key] for row in rows if key in row])), 3)


def _line(row: dict[str, Any]) -> str:
    figures = ", ".join(f"{name} {row[key]:.3g}" for name, key in KEYS.items() if key in row)
    return f"{row['room']}: {row.get('refused') or figures or row.get('left_out')}"
