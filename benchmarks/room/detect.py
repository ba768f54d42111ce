"""Masks of what is to be removed: against simulated truth and hand-drawn masks, with rivals on the same pictures.

All scores are by solid angle. Simulated rooms: furniture is what stands on the floor and what stands on that (rugs and
what hangs on walls are fixtures, shelves on walls are left out); sunlight is scored where direct sun covers at least
0.2 % of the sphere on floor and walls (``sunlight_iou_sim``), and the false share elsewhere is given. Masks without
"true_room" are found with the estimated room; where it is refused, nothing is (``refused_rooms``). Of the two real
rooms with hand-drawn masks, bedroom_hn was looked at while this was made; hotel_visualizer was only scored. ``target``
recall counts the mask that is removed, margin and shadows included. ``full_`` keys: one room at 6720 x 3360; ``penn_``
and ``coda_``: the paper's rooms (`benchmarks.room.detect_paper`). A full run keeps its rows (`benchmarks.kept_rows`).
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.memory import MemoryWatch
from benchmarks.plots import Point, time_against_error
from benchmarks.real.real import HELD, TUNED, picture_file
from benchmarks.room import detect_rivals as rivals
from benchmarks.room.detect_paper import paper_figures
from benchmarks.room.detect_truth import (
    DATA,
    FURNITURE,
    LOOKED_AT,
    SCORED_ONLY,
    TRIPOD,
    Score,
    hand_mask,
    photograph,
    picture_of,
    score,
    score_by_hand,
    share,
    simulated_masks,
    sun_enters,
    sun_of,
)
from benchmarks.truth_rooms import LIGHT_TRUTH, QUALITY, kept_list, room_model_of, truth_list, truth_of
from mocks.rooms.model import Use
from mocks.rooms.room import Room, make_room
from mocks.rooms.world import RoomWorld
from processing.errors import ProcessingError
from processing.ground.room_model import RoomModel
from processing.pictures.images import RelativeImage
from processing.removal.masks import Masks, find_masks
from processing.room.estimate import estimate_room
from processing.room.opening_sun import find_openings_in_sun
from processing.segmentation.around import ViewPlan, fused
from processing.segmentation.embedded import scene_evidence
from processing.segmentation.evidence import SceneEvidence
from processing.segmentation.installed import ADE20K_DEEPLAB, open_installed

MASKS = ("masks", "furniture", "edges", "tripod", "sunlight", "shadows")
CODE = {
    "ours": (
        *("processing/room/*.py", "processing/segmentation/*", "processing/surfaces/*.py"),
        "benchmarks/room/detect*.py",
        *("processing/ground/board.py", "processing/ground/seam.py"),
        *(f"processing/removal/{name}.py" for name in MASKS),
    ),
}
QUICK_ROOMS, FULL_ROOMS, LISTED = 1, 24, 48
REAL = (LOOKED_AT, SCORED_ONLY)
QUICK_SUN = ("panodr_s3d_1",)
FURNISHED = (*TUNED, *HELD, *QUICK_SUN)
MODEL = DATA / "weights" / ADE20K_DEEPLAB.file
SUNNY_SHARE = 0.002
FULL_SIZE = (6720, 3360)
SCORES = (
    "ours",
    "fused",
    "true_room",
    "target",
    "tripod",
    "equipment",
    "sun",
    "sun_true_room",
    "raw",
    "colours",
    "voc",
)


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics, rivals and notes."""
    notes: list[str] = []
    kept = Rows("detect", seed, CODE, keep=not quick)
    rooms = chosen_rooms(QUICK_ROOMS if quick else FULL_ROOMS, seed)
    each = [_kept(kept, f"{number}", lambda one=(number, use): _simulated(*one)) for number, use in rooms]
    found = [one for one in each if "seconds" in one]
    found += _one_sunny(kept, found, seed)
    real = {name: _kept(kept, name, lambda name=name: _real(name)) for name in REAL} if _has_real(notes) else {}
    metrics = _simulated_metrics(found) | _real_metrics(real, notes)
    if real:
        sunny = {
            name: kept.row(f"sun {name}", lambda name=name: _false_sun(name))
            for name in (QUICK_SUN if quick else FURNISHED)
        }
        metrics["false_sun_pictures"] = sum(share > 0 for share in sunny.values())
        metrics["false_sun_refused"] = sum(share < 0 for share in sunny.values())
        said = (f"{name} {'refused' if share < 0 else f'{share:.2%}'}" for name, share in sunny.items())
        notes.append("direct sun in pictures without any: " + ", ".join(said))
    metrics["seconds"] = round(max(one["seconds"] for one in (*found, *real.values())), 2)
    if not quick:
        metrics |= kept.row("full size", lambda: _full(*rooms[0]))
        metrics |= kept.row("paper", paper_figures)
        notes += kept.row("plot", trade_plot)
    notes += [note for one in (*each, *real.values()) for note in one.get("notes", [])]
    if not metrics["sunny_rooms"]:
        notes.append("no room of the list is sunny: sunlight was not measured")
    notes.append(
        f"{len(found)} simulated rooms of test seeds, {len(real)} real ones; seconds: CPU, the slowest picture"
    )
    return {"metrics": metrics, "rivals": _rivals(found, real, notes), "notes": notes}


def _kept(kept: Rows, key: str, make: Any) -> dict[str, Any]:
    """Return a picture's figures with its scores as such."""
    row = dict(kept.row(key, lambda: {k: asdict(v) if isinstance(v, Score) else v for k, v in make().items()}))
    return row | {key: Score(**row[key]) for key in SCORES if row.get(key)}


def _full(number: int, use: Use) -> dict[str, float]:
    """Return CPU seconds and peak memory of the masks of one full-size panorama, from its evidence and room on; and,
    where the model of `daylit models` is there, CPU seconds of all with it, from both networks to the masks."""
    room, truth = truth_of(number, use, **LIGHT_TRUTH)
    image = picture_of(cv2.resize(truth.luminance_rgb, FULL_SIZE, interpolation=cv2.INTER_LINEAR))
    evidence, true = scene_evidence(image), room_model_of(room)
    with MemoryWatch() as memory:
        start_s = time.process_time()
        _masks(image, evidence, true, room)
        seconds = time.process_time() - start_s
    out = {"full_seconds": round(seconds - memory.cpu_s, 2), "full_peak_mb": round(memory.own_peak_mb, 1)}
    if MODEL.is_file():
        start_s = time.process_time()
        both = fused(scene_evidence(image), image, open_installed(MODEL))
        _masks(image, both, estimated(image, both, sun_of(room)), room)
        out["full_seconds_fused"] = round(time.process_time() - start_s, 2)
    return out


def chosen_rooms(count: int, seed: int) -> list[tuple[int, Use]]:
    """Return test rooms whose truth is kept: the first ones of the list, and after them sunny ones, half as many."""
    first = kept_list("test", count, seed, **LIGHT_TRUTH)
    later = [one for one in kept_list("test", LISTED, seed, **LIGHT_TRUTH) if one not in first]
    return first + [one for one in later if sun_enters(make_room(*one))][: (count + 1) // 2]


def _one_sunny(kept: Rows, found: list[dict[str, Any]], seed: int) -> list[dict[str, Any]]:
    """Return one more room, with the sun on its floor or walls, where none of those drawn has it; made if need be."""
    if any(one["sunlit"] >= SUNNY_SHARE for one in found):
        return []
    seen = {one["name"] for one in found}
    one = _kept(kept, "sunny", lambda: _sunny(seen, seed))
    return [one] if "seconds" in one else []


def _sunny(seen: set[str], seed: int) -> dict[str, Any]:
    """Return the first room of the list that is sunny and not among those seen; empty where none is."""
    for number, use in truth_list("test", LISTED, seed):
        plan = make_room(number, use)
        if plan.name in seen or not sun_enters(plan):
            continue
        room, truth = truth_of(number, use, **LIGHT_TRUTH)
        if share(simulated_masks(room, truth).sunlight) >= SUNNY_SHARE:
            return _simulated(number, use)
    return {}


def estimated(image: RelativeImage, evidence: SceneEvidence, sun: tuple[float, float] | None = None) -> RoomModel:
    """Return the room as the pipeline estimates it, openings included; raises `ProcessingError` where it refuses."""
    room = estimate_room(image, evidence).room
    return room.model_copy(update={"openings": find_openings_in_sun(image, evidence, room, sun)})


def _simulated(number: int, use: Use) -> dict[str, Any]:
    room, truth = truth_of(number, use, **LIGHT_TRUTH)
    if not np.isfinite(truth.luminance_rgb).all():
        return {"notes": [f"{room.name}: its truth holds values that are not finite; left out"]}
    notes: list[str] = []
    image, true = picture_of(truth.luminance_rgb), room_model_of(room)
    masks = simulated_masks(room, truth)
    start_s = time.process_time()
    evidence = scene_evidence(image)
    middle_s = time.process_time()
    try:
        ours = estimated(image, evidence, sun_of(room))
    except ProcessingError as error:
        notes.append(f"{room.name}: no room ({error.message}), so that nothing is detected")
        ours = None
    end_s = time.process_time()
    none = np.zeros(masks.furniture.shape, bool)
    found = Masks(none, none, none, none, none) if ours is None else _masks(image, evidence, ours, room)
    seconds = time.process_time() - end_s + middle_s - start_s
    known = _masks(image, evidence, true, room)
    sunlit = share(masks.sunlight)
    result: dict[str, Any] = {"name": room.name, "seconds": seconds, "sunlit": sunlit, "notes": notes}
    result["refused"] = ours is None
    result["ours"] = score(found.furniture, masks.furniture, masks.ignore)
    result["true_room"] = score(known.furniture, masks.furniture, masks.ignore)
    result["target"] = score(found.target, masks.furniture | masks.equipment, masks.ignore)
    # The board's stand, which is marked too, is neither right nor wrong here.
    stand = masks.equipment & ~masks.tripod
    result["tripod"] = score(found.tripod & _below(found.tripod), masks.tripod, stand)
    result["equipment"] = score(found.tripod, masks.equipment)
    result["equipment_left"] = share(masks.equipment & ~found.target) / max(share(masks.equipment), 1e-9)
    result["sun"] = score(found.sunlight & masks.planar, masks.sunlight)
    result["sun_true_room"] = score(known.sunlight & masks.planar, masks.sunlight)
    result["false_sun"] = share(found.sunlight) if sunlit < SUNNY_SHARE else 0.0
    result["raw"] = score(rivals.raw_network(evidence, image.rgb.shape[:2]), masks.furniture, masks.ignore)
    result["colours"] = score(rivals.appearance_outliers(image, true), masks.furniture, masks.ignore)
    voc = rivals.voc_furniture(image)
    result["voc"] = score(voc, masks.furniture, masks.ignore) if voc is not None else None
    return result


def _masks(image: RelativeImage, evidence: SceneEvidence, room: RoomModel, truth: Room) -> Masks:
    """Return the masks as the pipeline finds them: it knows where the meter looked, the sun's place, and of a sun."""
    sun = sun_of(truth)
    x, y, z = RoomWorld(truth, QUALITY).board_direction
    meter = (math.atan2(x, y), math.asin(z))
    return find_masks(image, evidence, room, sun_direction=sun, sun_possible=sun is not None, meter_target=meter)


def _below(mask: Any) -> Any:
    """Return the lower part of the sphere, below 35 degrees under the horizon."""
    return (np.arange(mask.shape[0]) > mask.shape[0] * (90 + 35) / 180)[:, None] & np.ones(mask.shape, bool)


def _real(name: str) -> dict[str, Any]:
    image = photograph(DATA / "panoramas" / "furnished" / f"{name}.png")
    start_s = time.process_time()
    evidence = scene_evidence(image)
    middle_s = time.process_time()
    room = estimated(image, evidence)
    end_s = time.process_time()
    found = find_masks(image, evidence, room)
    seconds = time.process_time() - end_s + middle_s - start_s
    drawn = hand_mask(name)
    result: dict[str, Any] = {"seconds": seconds, "ours": score_by_hand(found.furniture, name)}
    result["target"] = score_by_hand(found.target, name)
    result["target_ratio"] = share(found.target) / share((drawn == FURNITURE) | (drawn == TRIPOD))
    result |= _fused(image, evidence, name)
    result["raw"] = score_by_hand(rivals.raw_network(evidence, drawn.shape), name)
    result["colours"] = score_by_hand(rivals.appearance_outliers(image, room), name)
    voc = rivals.voc_furniture(image)
    result["voc"] = score_by_hand(voc, name) if voc is not None else None
    return result


def _fused(image: RelativeImage, own: SceneEvidence, name: str) -> dict[str, Any]:
    """Return the scores with the model of `daylit models`; empty without it."""
    if not MODEL.is_file():
        return {}
    evidence = fused(own, image, open_installed(MODEL))
    found = find_masks(image, evidence, estimated(image, evidence))
    drawn = hand_mask(name)
    ratio = share(found.target) / share((drawn == FURNITURE) | (drawn == TRIPOD))
    return {"fused": score_by_hand(found.furniture, name), "fused_target_ratio": ratio}


def _false_sun(name: str) -> float:
    """Return the share of the sphere that is taken for direct sun in a furnished picture without any; -1: refused."""
    image = photograph(picture_file(name))
    own = scene_evidence(image)
    evidence = fused(own, image, open_installed(MODEL)) if MODEL.is_file() else own
    try:
        return share(find_masks(image, evidence, estimated(image, evidence)).sunlight)
    except ProcessingError:
        return -1.0


def _simulated_metrics(found: list[dict[str, Any]]) -> dict[str, float]:
    sunny = [one for one in found if one["sunlit"] >= SUNNY_SHARE]
    return {
        "furniture_iou_sim": _mean(one["ours"].iou for one in found),
        "furniture_iou_sim_median": round(statistics.median(one["ours"].iou for one in found), 4),
        "furniture_precision_sim": _mean(one["ours"].precision for one in found),
        "furniture_recall_sim": _mean(one["ours"].recall for one in found),
        "furniture_iou_sim_true_room": _mean(one["true_room"].iou for one in found),
        "target_recall_sim": _mean(one["target"].recall for one in found),
        "tripod_iou_sim": _mean(one["tripod"].iou for one in found),
        "equipment_iou_sim": _mean(one["equipment"].iou for one in found),
        "equipment_left_sim": round(max(one["equipment_left"] for one in found), 4),
        "sunlight_false_share_pct": round(100 * max(one["false_sun"] for one in found), 3),
        "sunny_rooms": len(sunny),
        "refused_rooms": sum(one["refused"] for one in found),
    } | _sun_metrics(sunny)


def _sun_metrics(sunny: list[dict[str, Any]]) -> dict[str, float]:
    if not sunny:
        return {}
    return {
        "sunlight_iou_sim": _mean(one["sun"].iou for one in sunny),
        "sunlight_iou_sim_true_room": _mean(one["sun_true_room"].iou for one in sunny),
    }


def _real_metrics(real: dict[str, dict[str, Any]], notes: list[str]) -> dict[str, float]:
    if not real:
        return {}
    metrics = {
        "furniture_iou_real": _mean(one["ours"].iou for one in real.values()),
        "furniture_recall_real": _mean(one["ours"].recall for one in real.values()),
        "furniture_precision_real": _mean(one["ours"].precision for one in real.values()),
        "target_recall_real": _mean(one["target"].recall for one in real.values()),
    }
    fused_ones = [one for one in real.values() if one.get("fused")]
    metrics["target_share_ratio"] = _mean(one.get("fused_target_ratio", one["target_ratio"]) for one in real.values())
    if fused_ones:
        metrics["furniture_iou_real_fused"] = _mean(one["fused"].iou for one in fused_ones)
        metrics["furniture_recall_real_fused"] = _mean(one["fused"].recall for one in fused_ones)
    for name, one in real.items():
        metrics[f"{name}_iou"] = round(one["ours"].iou, 4)
        metrics[f"{name}_recall"] = round(one["ours"].recall, 4)
    notes.append(f"{LOOKED_AT} was looked at while this was made, {SCORED_ONLY} was only scored")
    return metrics


def _rivals(
    found: list[dict[str, Any]], real: dict[str, dict[str, Any]], notes: list[str]
) -> dict[str, dict[str, float]]:
    figures = {}
    for rival, key in (("voc_through_views", "voc"), ("colour_outliers", "colours"), ("network_alone", "raw")):
        simulated = [one[key] for one in found if one[key]]
        drawn = [one[key] for one in real.values() if one[key]]
        if not simulated:
            notes.append(f"{rival} was not measured: network or runtime are not there")
            continue
        figures[rival] = _scores("sim", simulated) | (_scores("real", drawn) if drawn else {})
    return figures


def _scores(where: str, scores: list[Score]) -> dict[str, float]:
    return {
        f"furniture_iou_{where}": _mean(one.iou for one in scores),
        f"furniture_recall_{where}": _mean(one.recall for one in scores),
        f"furniture_precision_{where}": _mean(one.precision for one in scores),
    }


def _has_real(notes: list[str]) -> bool:
    there = (DATA / "panoramas" / "furnished").is_dir()
    if not there:
        notes.append("the hand-drawn masks are not there: no figures of real rooms")
    return there


def _mean(values: Iterable[float]) -> float:
    return round(statistics.fmean(values), 4)


RINGS = {
    "4": ((4, 0.0),),
    "8": ((4, 0.0), (4, math.radians(-35))),
    "14": ((8, 0.0), (6, math.radians(-35))),
    "28": ((14, 0.0), (14, math.radians(-35))),
}


def trade_plot(path: Path = Path("detect-time.png")) -> list[str]:
    """Draw 1 - IoU of furniture on the real rooms against CPU seconds; return what was not drawn."""
    names = (LOOKED_AT, SCORED_ONLY)
    if not (DATA / "panoramas" / "furnished").is_dir():
        return ["no plot: the hand-drawn masks are not there"]
    pictures = {name: photograph(DATA / "panoramas" / "furnished" / f"{name}.png") for name in names}
    points = []
    for label, rings in RINGS.items():
        if rivals.voc_segmenter() is None:
            break
        start_s, total = time.process_time(), 0.0
        for name, image in pictures.items():
            found = rivals.voc_furniture(image, ViewPlan(rings=rings, skip=False))
            assert found is not None
            total += score_by_hand(found, name).iou
        seconds = (time.process_time() - start_s) / len(names)
        points.append(Point("Pascal VOC through views", seconds, 1 - total / len(names), f"{label} views"))
    for quality in ("draft", "standard", "reference"):
        seconds, total = 0.0, 0.0
        for name, image in pictures.items():
            room = estimate_room(image, scene_evidence(image)).room
            start_s = time.process_time()
            found_masks = find_masks(image, scene_evidence(image, quality=quality), room)
            seconds += time.process_time() - start_s
            total += score_by_hand(found_masks.furniture, name).iou
        points.append(Point("daylit", seconds / len(names), 1 - total / len(names), quality))
    time_against_error(points, path, title="Furniture of two real rooms", error_label="1 - IoU by solid angle")
    return []
