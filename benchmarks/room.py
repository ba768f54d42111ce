"""Rooms told from one panorama: 3D IoU, corners, windows, confidence, run time.

Simulated rooms of test seeds, furnished (as they stand) and emptied, 1024 x 512; ZInD pictures of the scored half
against ``layout_raw`` (keys ``_zind_``) and ``layout_visible``; ``seconds`` is the CPU time of one full-size panorama
(6720 x 3360) from levelling to openings. Corner errors are in % of a 1024 x 512 picture's diagonal. Keys ``level_``:
test rooms tilted by up to 15 degrees; ``_given_room``: openings alone, on the true walls.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks._detect_truth import picture_of
from benchmarks._memory import MemoryWatch
from benchmarks._plots import Point, time_against_error
from benchmarks._room_level import level_metrics
from benchmarks._room_openings import opening_metrics
from benchmarks._room_openings import score_room as score_openings
from benchmarks._room_plots import reliability_plot
from benchmarks._room_real import RealRoom, labelled_rooms, real_rooms
from benchmarks._room_run import Told, rivals_of, told
from benchmarks._room_scores import RoomScore, score_room
from benchmarks._truth_rooms import kept_list, room_model_of, truth_of
from processing.room.model import RoomModel

QUICK_ROOMS, FULL_ROOMS = 3, 24
FULL_SIZE = (6720, 3360)
RIGHT_IOU3D = 0.85
PUBLISHED = {
    "published_horizonnet_zind": {"iou2d_zind_mean": 0.898, "iou3d_zind_mean": 0.885},
    "published_lgt_net_zind": {"iou2d_zind_mean": 0.918, "iou3d_zind_mean": 0.900},
    "published_hand_made_box_zind12": {"iou2d_zind_mean": 0.52, "iou3d_zind_mean": 0.51},
}
NONE = RoomScore(0.0, 0.0, 100.0, 100.0, 0, 0)


@dataclass
class _Gathered:
    scores: list[RoomScore] = field(default_factory=list)
    rivals: dict[str, list[float]] = field(default_factory=dict)
    windows: list[float] = field(default_factory=list)
    false_windows: int = 0
    told: list[Told] = field(default_factory=list)

    def add(self, found: Told, true: RoomModel) -> None:
        self.told.append(found)
        self.scores.append(score_room(found.estimate.room, true) if found.estimate else NONE)
        for name, room in rivals_of(found).items():
            self.rivals.setdefault(name, []).append(score_room(room, true).iou3d)
        if found.estimate:
            of_openings = score_openings(true, found.estimate.room, found.openings)
            self.windows += of_openings["window"]
            self.false_windows += of_openings["window_false"]

    def median(self, name: str) -> float:
        return float(np.median([getattr(score, name) for score in self.scores]))


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    rooms = kept_list("test", FULL_ROOMS, seed)[: QUICK_ROOMS if quick else None]
    empty, furnished = _Gathered(), _Gathered()
    for number, use in rooms:
        room, truth = truth_of(number, use)
        true = room_model_of(room)
        furnished.add(told(picture_of(truth.luminance_rgb)), true)
        empty.add(told(picture_of(truth.empty_rgb)), true)
    real, notes = _real(quick=quick)
    metrics = _simulated_metrics(empty, furnished) | real.pop("metrics")
    metrics |= level_metrics(quick=quick) | opening_metrics(quick=quick)
    full, parts = _full_size(rooms[0])
    metrics |= full
    rivals = {
        name: {
            "iou3d_empty_median": float(np.median(empty.rivals[name])),
            "iou3d_furnished_median": float(np.median(v)),
        }
        for name, v in furnished.rivals.items()
    }
    for name, figures in real["rivals"].items():
        rivals.setdefault(name, {}).update(figures)
    notes += [f"{len(rooms)} test rooms; parts at full size, CPU s: {parts}", *_bad_cases(metrics)]
    if not quick:
        _plots(rooms, empty, furnished)
    return {"metrics": metrics, "rivals": rivals | PUBLISHED, "notes": notes}


def _simulated_metrics(empty: _Gathered, furnished: _Gathered) -> dict[str, float]:
    both = [*empty.scores, *furnished.scores]
    sure = np.array([t.confidence for t in (*empty.told, *furnished.told)])
    right = np.array([s.iou3d >= RIGHT_IOU3D for s in both], dtype=np.float64)
    windows = [*empty.windows, *furnished.windows]
    return {
        "iou3d_empty_median": empty.median("iou3d"),
        "iou3d_furnished_median": furnished.median("iou3d"),
        "iou3d_empty_mean": float(np.mean([s.iou3d for s in empty.scores])),
        "iou3d_furnished_mean": float(np.mean([s.iou3d for s in furnished.scores])),
        "iou2d_empty_median": empty.median("iou2d"),
        "iou2d_furnished_median": furnished.median("iou2d"),
        "corner_err_pct": float(np.median([s.corner_err_pct for s in both])),
        "corner_empty_err_pct": empty.median("corner_err_pct"),
        "corner_furnished_err_pct": furnished.median("corner_err_pct"),
        "height_err_pct": float(np.median([s.height_err_pct for s in both])),
        "window_iou": float(np.mean(windows)) if windows else 0.0,
        "window_iou_median": float(np.median(windows)) if windows else 0.0,
        "windows_false": float(empty.false_windows + furnished.false_windows),
        "corners_right_share": float(np.mean([s.corners == s.true_corners for s in both])),
        "confidence_brier": float(((sure - right) ** 2).mean()),
        "confidence_mean": float(sure.mean()),
        "right_share": float(right.mean()),
        "seconds_1024": float(np.median([sum(t.cpu_s.values()) for t in furnished.told])),
    }


def _real(*, quick: bool) -> tuple[dict[str, Any], list[str]]:
    """Return the figures of the scored half of the real pictures."""
    rooms, labelled = real_rooms("scored"), labelled_rooms("scored")
    if not rooms:
        return {"metrics": {"iou3d_zind_median": 0.0}, "rivals": {}}, ["the shared panoramas are not here"]
    chosen = rooms[:3] if quick else rooms
    raw, against_visible, notes = _Gathered(), [], []
    for room in chosen:
        found = told(room.picture, with_openings=False)
        raw.add(found, room.raw)
        seen = _score(found, room.visible)
        against_visible.append(raw.scores[-1].iou3d if seen is None else seen)
        notes.append(_line(room, found, raw.scores[-1].iou3d, seen))
    metrics = {
        "iou3d_zind_median": raw.median("iou3d"),
        "iou3d_zind_mean": float(np.mean([s.iou3d for s in raw.scores])),
        "iou2d_zind_median": raw.median("iou2d"),
        "iou3d_zind_visible_median": float(np.median(against_visible)),
        "iou3d_zind_better_median": float(np.median(np.maximum(against_visible, [s.iou3d for s in raw.scores]))),
        "zind_pictures": float(len(chosen)),
    }
    for room in labelled if not quick else []:
        found = told(room.picture, with_openings=False)
        metrics["iou3d_layout_gt"] = _score(found, room.raw) or 0.0
        notes.append(_line(room, found, metrics["iou3d_layout_gt"], None))
    rivals = {
        name: {"iou3d_zind_median": float(np.median(values)), "iou3d_zind_mean": float(np.mean(values))}
        for name, values in raw.rivals.items()
    }
    return {"metrics": metrics, "rivals": rivals}, notes


def _score(found: Told, true: RoomModel | None) -> float | None:
    if true is None:
        return None
    return score_room(found.estimate.room, true).iou3d if found.estimate else 0.0


def _line(room: RealRoom, found: Told, raw: float, visible: float | None) -> str:
    seen = "" if visible is None else f", visible {visible:.3f}"
    return f"{room.name}: 3D IoU raw {raw:.3f}{seen}, confidence {found.confidence:.2f} {found.refusal}".strip()


def _full_size(room: tuple[int, Any]) -> tuple[dict[str, float], str]:
    """Return CPU seconds and peak memory (MB) of one full-size panorama."""
    _, truth = truth_of(*room)
    image = picture_of(cv2.resize(truth.luminance_rgb, FULL_SIZE, interpolation=cv2.INTER_LINEAR))
    with MemoryWatch() as memory:
        found = told(image)
    parts = ", ".join(f"{name} {value:.2f}" for name, value in found.cpu_s.items())
    return {"seconds": sum(found.cpu_s.values()), "peak_mb": memory.own_peak_mb}, parts


def _bad_cases(metrics: dict[str, float]) -> list[str]:
    """Add how many bad pictures are refused or doubted; return what became of each."""
    rng = np.random.default_rng(5)
    sky = np.linspace(4.0, 0.3, 256)[:, None, None] * np.ones((256, 512, 3))
    outdoors = (sky * rng.uniform(0.9, 1.1, sky.shape)).astype(np.float32)
    outdoors[128:] *= rng.uniform(0.05, 0.4, (128, 512, 1)).astype(np.float32)
    cropped = rng.uniform(0.1, 1, (256, 512, 3)).astype(np.float32)
    cropped[:60] = cropped[-70:] = 0
    cases = {
        "black": np.zeros((256, 512, 3), np.float32),
        "noise": rng.uniform(0, 1, (256, 512, 3)).astype(np.float32),
        "outdoors": outdoors,
        "cropped, padded": cropped,
        "cropped": rng.uniform(0, 1, (200, 512, 3)).astype(np.float32),
    }
    found = {name: told(picture_of(rgb), with_openings=False) for name, rgb in cases.items()}
    metrics["bad_cases"] = float(len(found))
    metrics["bad_cases_doubted"] = float(sum(t.confidence < 0.5 for t in found.values()))
    return [f"{name}: {t.refusal or f'confidence {t.confidence:.2f}'}"[:200] for name, t in found.items()]


def _plots(rooms: list[tuple[int, Any]], empty: _Gathered, furnished: _Gathered) -> None:
    """Draw reliability, and error against run time by resolution and quality."""
    every = [*zip(empty.told, empty.scores, strict=True), *zip(furnished.told, furnished.scores, strict=True)]
    reliability_plot(
        np.array([t.confidence for t, _ in every]),
        np.array([s.iou3d >= RIGHT_IOU3D for _, s in every], dtype=np.float64),
        Path("room-reliability.png"),
    )
    points = []
    for quality in ("draft", "standard", "reference"):
        for width in (512, 1024):
            errors, seconds = [], []
            for number, use in rooms[:8]:
                room, truth = truth_of(number, use)
                rgb = cv2.resize(truth.luminance_rgb, (width, width // 2), interpolation=cv2.INTER_AREA)
                found = told(picture_of(rgb), quality=quality, with_openings=False)
                errors.append(1 - (_score(found, room_model_of(room)) or 0.0))
                seconds.append(sum(found.cpu_s.values()))
            points.append(Point(quality, float(np.median(seconds)), float(np.median(errors)), f"{width} px"))
    time_against_error(
        points,
        Path("room-time.png"),
        title="Furnished test rooms: run time against error",
        error_label="1 - 3D IoU, median",
    )
