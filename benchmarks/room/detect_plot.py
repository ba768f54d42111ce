"""The plot of detection: error against run time, by number of views and by quality."""

from __future__ import annotations

import math
import time
from pathlib import Path

from benchmarks.plots import Point, time_against_error
from benchmarks.room import detect_rivals as rivals
from benchmarks.room.detect_truth import DATA, LOOKED_AT, SCORED_ONLY, photograph, score_by_hand
from processing.removal.masks import find_masks
from processing.room.estimate import estimate_room
from processing.segmentation.around import ViewPlan
from processing.segmentation.embedded import scene_evidence

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
        points.append(
            Point("Pascal VOC through views", _each(start_s, names), 1 - total / len(names), f"{label} views")
        )
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


def _each(start_s: float, names: tuple[str, ...]) -> float:
    return (time.process_time() - start_s) / len(names)
