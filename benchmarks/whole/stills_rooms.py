"""Stills of whole simulated rooms, beside the photograph and two plainer ways in the same frames; the contact sheet.

Rooms of test seeds go through capture (both cameras, the meter) and the whole pipeline; sessions are kept in the cache
(DAYLIT_BENCH_CPU_S ends the making of rooms after so much CPU time). Each still is judged by NIQE (Mittal et al. 2013:
distance from the statistics of natural photographs, lower is better; a package gives it), beside the photograph in its
frame and two rivals: ``pasted``, the same furniture upon the emptied picture whose light it does not
change, and ``clipped``, the same light as measured, at one exposure, cut at white. Grades of realism (1 to 5) were
given by looking and stand with reasons and date in ``stills_grades.toml``.
``python -m benchmarks.whole.stills_rooms SHEET.jpg [SESSION ...]`` draws the sheet: sessions named, then rooms.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import statistics
import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.truth_rooms import LIGHT_QUALITY, truth_list
from benchmarks.whole.end_to_end import rig_profile
from benchmarks.whole.end_to_end_run import taken_of, write_session
from mocks.optics.picture_cache import content_key, default_folder
from mocks.rooms.room import make_room
from mocks.rooms.world import RoomWorld
from processing.exchange.showing import panes_of
from processing.ground.arrays import Bytes, Flags
from processing.ground.room_model import read_room
from processing.layout.arrangement import Arrangements, PlacedItem
from processing.layout.models.catalogue import Catalogue
from processing.light.scene.tracer import tracer_of
from processing.pictures.display import Display
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.preview import preview_rgb8
from processing.report.frames import Frame
from processing.running.requests import RunRequest
from processing.running.runner import process
from processing.sphere import directions
from processing.sphere.views import Panorama, cut_view
from processing.stages.contract import Quality
from processing.stages.furnishing import furniture_parts
from station.session import strict_json

QUICK_ROOMS, FULL_ROOMS = 2, 12
QUICK_DIVISOR, FULL_DIVISOR = 16, 4
WIDE_PX = 960
"""Width in which stills are judged: 60 of NIQE's patches. Chosen."""
GRADES = Path(__file__).with_name("stills_grades.toml")
SHOWABLE = 4
"""Grade from which a picture may be shown."""
SHEET_PX = 300
WAYS = ("captured", "staged", "pasted", "clipped")


@dataclass(frozen=True)
class Judged:
    """One still: sRGB codes (H, W, 3) in `WIDE_PX` by way."""

    name: str
    pictures: dict[str, Bytes]


def judged(seed: int, *, quick: bool) -> dict[str, Any]:
    """Return metrics, rivals and notes."""
    start_s, limit_s = time.process_time(), float(os.environ.get("DAYLIT_BENCH_CPU_S", "inf"))
    rooms = truth_list("test", QUICK_ROOMS if quick else FULL_ROOMS, seed)
    shots: dict[str, list[Judged]] = {}
    not_staged: list[str] = []
    for number, use in rooms:
        if shots and time.process_time() - start_s > limit_s:
            break
        session = room_session(number, use, seed, quick=quick)
        if (session / "stages" / "render" / "staged-1.exr").is_file():
            shots[f"{use}-{number}"] = stills_of(session)
        else:
            not_staged.append(f"{use}-{number}: not staged")
    niqe = {
        room: {way: statistics.fmean(naturalness(one.pictures[way]) for one in found) for way in WAYS}
        for room, found in shots.items()
    }
    mean = {way: round(statistics.fmean(row[way] for row in niqe.values()), 3) for way in WAYS}
    grades = [statistics.fmean(one["grades"].values()) for one in tomllib.loads(GRADES.read_text("utf-8")).values()]
    metrics = {
        "stills_rooms": len(shots),
        "stills_rooms_not_staged": len(not_staged),
        "stills": sum(map(len, shots.values())),
        "niqe_captured": mean["captured"],
        "niqe_staged": mean["staged"],
        "realism_mean": round(statistics.fmean(grades), 2),
        "realism_share_at_4": round(sum(one >= SHOWABLE for one in grades) / len(grades), 3),
    }
    notes = [f"{room}: NIQE " + ", ".join(f"{way} {row[way]:.2f}" for way in WAYS) for room, row in niqe.items()]
    rivals = {k: {"niqe_staged": mean[k]} for k in WAYS[2:]}
    return {"metrics": metrics, "rivals": rivals, "notes": [*notes, *not_staged]}


def room_session(number: int, use: Any, seed: int, *, quick: bool) -> Path:
    """Return a room's session, staged; made anew only where something has changed."""
    divisor = QUICK_DIVISOR if quick else FULL_DIVISOR
    room = make_room(number, use)
    key = content_key("stills", RoomWorld(room, LIGHT_QUALITY).key, divisor)
    session = default_folder().parent / "stills-rooms" / f"{room.name}-{divisor}-{key[:12]}"
    if not (session / "session.json").is_file():
        shutil.rmtree(session, ignore_errors=True)  # what was broken off
        write_session(session, taken_of(room, divisor))
    options = {"--calibration": str(rig_profile(seed)), "--alternatives": 1}
    process(session, RunRequest(until="stills", quality=Quality("draft" if quick else "standard"), options=options))
    return session


def stills_of(session: Path) -> list[Judged]:
    """Return the stills of a session's first alternative, by the display of today."""
    stages = session / "stages"
    facts = strict_json.loads((stages / "stills" / "stills.json").read_bytes())["stills"]
    display = Display.read(strict_json.loads((stages / "stills" / "display.json").read_bytes()))
    staged, room = _picture(stages / "render" / "staged-1.exr"), read_room(stages / "room" / "room.json")
    empty = _picture(stages / "remove" / "empty.exr")
    panes = panes_of(room, staged.geometry)
    pasted = np.where(furniture_seen(session, staged, room.camera_height_m)[..., None], staged.rgb, empty.rgb)
    turned = stages / "room" / "panorama.exr"
    photo = _picture(turned if turned.is_file() else stages / "calibrate" / "indoor.exr")
    whole = {
        "captured": Panorama(display.shown(np.ascontiguousarray(photo.rgb), panes_of(room, photo.geometry))),
        "staged": Panorama(display.shown(np.ascontiguousarray(staged.rgb), panes)),
        "pasted": Panorama(display.shown(np.ascontiguousarray(pasted), panes)),
        "clipped": Panorama(preview_rgb8(staged.rgb)),
    }
    found = []
    for one in (one for one in facts if one["state"] == "staged-1"):
        frame = Frame(math.radians(one["yaw_deg"]), one["lens_mm"], one["drop"])
        view, rows = frame.view(WIDE_PX), frame.height_px(WIDE_PX)
        pictures = {way: cut_view(panorama, view)[-rows:] for way, panorama in whole.items()}
        found.append(Judged(one["file"], pictures))
    return found


def _picture(path: Path) -> LuminanceImage:
    image = read_exr(path)
    assert isinstance(image, LuminanceImage)
    return image


def furniture_seen(session: Path, staged: LuminanceImage, camera_m: float) -> Flags:
    """Return where (H, W) the camera sees the first alternative's pieces: nothing of the room stands before them."""
    arranged = (session / "stages" / "arrange" / "arrangement.json").read_text("utf-8")
    facts = strict_json.loads((session / "stages" / "render" / "staged.json").read_bytes())["alternatives"][0]
    added = [PlacedItem.model_validate_json(json.dumps(one)) for one in facts["added"]]
    items = [*Arrangements.model_validate_json(arranged).arrangements[0].items, *added]
    parts = furniture_parts(items, Catalogue.builtin(facts["style"]))
    triangles = np.concatenate([np.asarray(part.vertices_m, np.float32)[part.faces] for part in parts])
    ways = np.asarray(directions(staged.geometry)[0], np.float32).reshape(-1, 3)
    origins = np.broadcast_to(np.array([0, 0, camera_m], np.float32), ways.shape)
    return np.asarray(tracer_of(triangles).cast(origins, ways).triangle >= 0).reshape(staged.rgb.shape[:2])


def naturalness(rgb8: Bytes) -> float:
    """Return NIQE of a picture (H, W, 3) in sRGB codes: 0 is a natural photograph, 10 far from one."""
    from skvideo.measure import niqe

    return float(niqe(cv2.cvtColor(rgb8, cv2.COLOR_RGB2GRAY)[None].astype(np.float32))[0])


def sheet(path: Path, sessions: list[Path]) -> None:
    """Write the contact sheet: the first still of each session, by way."""
    rows = []
    for session in sessions:
        one = stills_of(session)[0]
        row = [
            cv2.resize(one.pictures[way], (SHEET_PX, SHEET_PX * 2 // 3), interpolation=cv2.INTER_AREA) for way in WAYS
        ]
        rows.append(np.hstack(row))
    head = np.full((24, SHEET_PX * len(WAYS), 3), 255, np.uint8)
    for k, way in enumerate(WAYS):
        cv2.putText(head, way, (SHEET_PX * k + 6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA)
    cv2.imwrite(str(path), np.vstack([head, *rows])[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])


if __name__ == "__main__":
    given = [Path(name) for name in sys.argv[2:]]
    kept = sorted((default_folder().parent / "stills-rooms").glob(f"*-{FULL_DIVISOR}-*/stages/stills/stills.json"))
    sheet(Path(sys.argv[1]), [*given, *(path.parents[2] for path in kept)])
