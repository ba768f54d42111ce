"""One simulated room through the whole pipeline, compared with its truth stage by stage: a row of figures."""

from __future__ import annotations

import json
import math
import shutil
import tempfile
import time
from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.room.detect_truth import score, simulated_masks
from benchmarks.room.room_scores import score_room
from benchmarks.sessions import Taken, write_session
from benchmarks.truth_rooms import LIGHT_QUALITY, room_model_of, truth_of
from benchmarks.whole.end_to_end_room import staged_luminance, staged_room
from mocks.rooms.model import Use
from mocks.rooms.room import Room
from mocks.rooms.truth import TruthPictures
from mocks.rooms.world import RoomWorld
from processing.ground.arrays import Doubles, Flags
from processing.ground.room_model import RoomModel
from processing.ground.seam import grown
from processing.layout.arrangement import Arrangements
from processing.light.scene.scene_file import read_scene
from processing.light.solver.sight import GLASS, albedo_of, seen_outdoors, sight_of
from processing.light.solver.stage import Stage
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from processing.pictures.patch import read_shown
from processing.pictures.preview import read_mask
from processing.running.requests import RunRequest
from processing.running.runner import process
from processing.sphere import Equirectangular, solid_angles
from processing.stages.contract import Quality
from station.session.session import Site as Place

CHANGED = 0.02
"""Relative change of luminance by furniture from which a pixel counts as changed."""
PANORAMA_PX = 6720


def measured(
    number: int, use: Use, profile: Path, divisor: int, quality: str, options: Mapping[str, object]
) -> dict[str, Any]:
    """Return the figures of one room; what a stage left out has no key and is named under ``left_out``.

    ``options``: of `daylit process`, besides the benchmark's own.
    """
    rows = PANORAMA_PX // divisor // 2 * 2 // 2
    room, truth = truth_of(number, use, rows=rows, quality=LIGHT_QUALITY)
    folder = Path(tempfile.mkdtemp(prefix="end-to-end-"))
    try:
        session = write_session(folder / room.name, taken_of(room, divisor))
        return processed(session, room, truth, profile, quality, options)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def processed(
    session: Path,
    room: Room,
    truth: TruthPictures,
    profile: Path,
    quality: str,
    options: Mapping[str, object],
    *,
    until: str | None = None,
) -> dict[str, Any]:
    """Return the figures of a room's session, which is processed here, to a last stage or all; see `measured`."""
    start_s = time.process_time()
    request = RunRequest(
        until=until,
        quality=Quality(quality),
        options={"--calibration": str(profile), "--alternatives": 1, "--styling": "none", **options},
    )
    done = process(session, request)
    row: dict[str, Any] = {"room": room.name, "cpu_s": round(time.process_time() - start_s, 2)}
    row["stage_cpu_s"] = {s.stage: round(s.cost.cpu_seconds, 2) for s in done.stages if s.cost}
    row["peak_mb"] = round(done.cost.peak_bytes / 1e6)
    row["left_out"] = {s.stage: s.summary.get("skipped") for s in done.stages if s.summary.get("skipped")}
    return row | compared(session / "stages", room, truth)


def taken_of(room: Room, divisor: int) -> Taken:
    """Return the session of a room at its own place and time."""
    moment = room.moment
    return Taken(
        RoomWorld(room, LIGHT_QUALITY),
        divisor,
        seed=room.seed,
        # The brackets are taken some 20 s after the session has begun.
        begun=moment.utc - timedelta(seconds=20),
        place=Place(latitude_deg=moment.latitude_deg, longitude_deg=moment.longitude_deg),
        heading_rad=moment.heading_rad,
    )


def compared(stages: Path, room: Room, truth: TruthPictures) -> dict[str, Any]:
    """Return errors, stage by stage, of what is there."""
    found: dict[str, Any] = {}
    picture = _picture(stages / "calibrate" / "indoor.exr")
    valid = picture.validity == Validity.VALID
    found |= errors_of("luminance", picture.rgb, truth.luminance_rgb, valid)
    shape = stages / "room" / "room.json"
    if not shape.is_file():
        return found
    model = RoomModel.model_validate_json(shape.read_text("utf-8"))
    scored = score_room(model, room_model_of(room))
    found |= {"iou3d": round(scored.iou3d, 4), "corner_err_pct": round(scored.corner_err_pct, 3)}
    found |= _masks(stages / "detect", room, truth)
    empty = stages / "remove" / "empty.exr"
    if empty.is_file():
        filled = read_mask(stages / "remove" / "filled.png")
        found |= errors_of("empty", _picture(empty).rgb, truth.empty_rgb, filled)
        found |= errors_of("empty_all", _picture(empty).rgb, truth.empty_rgb, valid | filled)
        found |= _emptied(stages, _picture(empty), truth, filled, valid)
    if (stages / "materials" / "scene.npz").is_file():
        found |= _albedo(stages, model, truth) | _panes(stages, model, picture)
    if (stages / "render" / "staged-1.exr").is_file():
        found |= _staged(stages, room, truth)
    return found


def _picture(path: Path) -> LuminanceImage:
    image = read_shown(path)
    assert isinstance(image, LuminanceImage)
    return image


def errors_of(name: str, rgb: Any, true_rgb: Any, where: Flags) -> dict[str, float]:
    """Return median and 95th percentile (%) of the relative error of luminance, by solid angle; none of no pixels."""
    ours, true = luminance_cd_m2(rgb).astype(np.float64), luminance_cd_m2(true_rgb).astype(np.float64)
    return _quantiles(name, ours, true, where)


def _quantiles(name: str, ours: Doubles, true: Doubles, where: Flags) -> dict[str, float]:
    use = where & (true > 0)
    if not use.any():
        return {}
    off = np.abs(ours[use] / true[use] - 1)
    area = solid_angles(Equirectangular(ours.shape[1], ours.shape[0]))[use]
    order = np.argsort(off)
    upto = np.cumsum(area[order])
    median, high = (float(off[order][np.searchsorted(upto, q * upto[-1])]) for q in (0.5, 0.95))
    return {f"{name}_median_err_pct": round(100 * median, 3), f"{name}_p95_err_pct": round(100 * high, 3)}


def _masks(folder: Path, room: Room, truth: TruthPictures) -> dict[str, float]:
    true = simulated_masks(room, truth)
    none = np.zeros(true.furniture.shape, bool)
    masks = {
        name: read_mask(folder / f"{name}.png") if (folder / f"{name}.png").is_file() else none
        for name in ("furniture", "sunlight", "target")
    }
    found = {
        "furniture_iou": round(score(masks["furniture"], true.furniture, true.ignore).iou, 4),
        "target_recall": round(score(masks["target"], true.furniture | true.equipment, true.ignore).recall, 4),
    }
    if true.sunlight.mean() > 0.002:
        found["sunlight_iou"] = round(score(masks["sunlight"] & true.planar, true.sunlight).iou, 4)
    return found


NEAR_RAD = math.radians(4)
"""Around what was to be removed: where ghosts of it would be."""


def _emptied(
    stages: Path, empty: LuminanceImage, truth: TruthPictures, filled: Flags, valid: Flags
) -> dict[str, float]:
    """Return the bias of filled pixels, the error of seen ones beside them, and that of the stand-ins' distance."""
    ours, true = (luminance_cd_m2(rgb).astype(np.float64) for rgb in (empty.rgb, truth.empty_rgb))
    found = {"empty_bias_pct": bias_pct(ours, true, filled)} if filled.any() else {}
    near = grown(filled, NEAR_RAD) & ~filled & valid & ~(truth.furniture | truth.tripod)
    found |= {k: v for k, v in _quantiles("empty_near", ours, true, near).items() if "p95" in k}
    shade = stages / "light" / "shade.npz"
    if shade.is_file():
        with np.load(shade) as kept:
            standin_m = kept["standin_m"].astype(np.float32)
        size = (truth.depth_m.shape[1], truth.depth_m.shape[0])
        standin_m = cv2.resize(standin_m, size, interpolation=cv2.INTER_NEAREST)
        both = (standin_m > 0) & truth.furniture & (truth.depth_m > 0)
        if both.any():
            found["depth_err_pct"] = round(100 * float(np.median(np.abs(standin_m / truth.depth_m - 1)[both])), 2)
    return found


def bias_pct(ours: Doubles, true: Doubles, where: Flags) -> float:
    """Return by how much the median ratio of luminance is off, %."""
    use = where & (true > 0)
    middle = float(np.median(np.log(np.maximum(ours[use] / true[use], 1e-6))))
    return round(100 * math.expm1(middle), 2)


def _panes(stages: Path, model: RoomModel, picture: LuminanceImage) -> dict[str, float]:
    """Return the worst error of a pane's mean radiance towards the camera, against what the camera sees on it."""
    height, width = picture.rgb.shape[:2]
    stage = Stage.of(read_scene(stages / "materials" / "scene.npz"), 0.5)
    sight = sight_of(stage, Equirectangular(width, height), (0.0, 0.0, model.camera_height_m))
    given = luminance_cd_m2(seen_outdoors(stage, sight).reshape(height, width, 3)).ravel()
    seen, good = luminance_cd_m2(picture.rgb).ravel(), (picture.validity == Validity.VALID).ravel()
    area = solid_angles(Equirectangular(width, height)).ravel()
    off = []
    for number in range(len(stage.scene.panes)):
        mine = (sight.label == GLASS) & (sight.pane == number) & good
        if mine.sum() >= LEAST_PANE_PX:
            off.append(abs(float((given * area)[mine].sum() / max((seen * area)[mine].sum(), 1e-9)) - 1))
    return {"pane_worst_pct": round(100 * max(off), 2)} if off else {}


LEAST_PANE_PX = 20
"""A pane that the camera sees less of says nothing."""


def _albedo(stages: Path, model: RoomModel, truth: TruthPictures) -> dict[str, float]:
    """Return errors of the albedo that the camera sees, mean of the channels, where both have one."""
    height, width = truth.empty_albedo.shape[:2]
    stage = Stage.of(read_scene(stages / "materials" / "scene.npz"), 0.2)
    sight = sight_of(stage, Equirectangular(width, height), (0.0, 0.0, model.camera_height_m))
    ours = albedo_of(stage, sight).reshape(height, width, 3)
    both = (ours.max(axis=2) > 0) & (truth.empty_albedo.max(axis=2) > 0)
    if not both.any():
        return {}
    off = np.abs(ours - truth.empty_albedo).mean(axis=2)[both]
    return {
        "albedo_median_err": round(float(np.median(off)), 4),
        "albedo_p95_err": round(float(np.quantile(off, 0.95)), 4),
    }


def _staged(stages: Path, room: Room, truth: TruthPictures) -> dict[str, float]:
    """Return errors of the first staged picture where furniture, or its light and shadow, truly change the picture."""
    arranged = json.loads((stages / "arrange" / "arrangement.json").read_text("utf-8"))
    first = Arrangements.model_validate_json(json.dumps(arranged)).arrangements[0]
    staged = json.loads((stages / "render" / "staged.json").read_text("utf-8"))["alternatives"][0]
    image = _picture(stages / "render" / "staged-1.exr")
    ours = luminance_cd_m2(image.rgb).astype(np.float64)
    there = staged_room(room, first.items, staged["style"])
    true = staged_luminance(there, LIGHT_QUALITY, ours.shape[0]).astype(np.float64)
    bare = luminance_cd_m2(truth.empty_rgb).astype(np.float64)
    changed = np.abs(true / np.maximum(bare, 1e-9) - 1) > CHANGED
    found = _quantiles("staged", ours, true, changed)
    found["staged_changed_share"] = round(float(changed.mean()), 4)
    use, doubt = changed & (true > 0) & (image.validity == Validity.VALID), image.uncertainty
    inside = np.abs(ours / np.maximum(true, 1e-9) - 1) <= 1.96 * np.hypot(doubt, image.scale_uncertainty)
    found["staged_cover95_pct"] = round(100 * float(inside[use].mean()), 1) if use.any() else 0.0
    found["staged_bias_pct"] = bias_pct(ours, true, changed)
    return found
