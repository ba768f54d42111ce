"""Rooms estimated from one panorama: 3D IoU, corners, windows, confidence, run time.

Simulated rooms of test seeds, furnished (as they stand) and emptied, 840 x 420; ZInD pictures of the scored half
against ``layout_raw`` (keys ``_zind_``) and ``layout_visible``, and both halves where the camera stands inside of it
(``_zind_inside_``, with the confidence's squared error and a constant's); ``seconds`` is the CPU time of one full-size
panorama (6720 x 3360) from levelling to openings. Corner errors are in % of a 1024 x 512 picture's diagonal. Keys
``level_``: test rooms tilted by up to 15 degrees; ``_given_room``: openings alone, on the true walls, ``_own_room``: on
estimated ones. Keys ``doubt_``: rooms drawn to be mistaken (`benchmarks.room.room_doubt`). A full run keeps its rows
(`benchmarks.kept_rows`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.memory import MemoryWatch
from benchmarks.plots import Point, save_figure, time_against_error
from benchmarks.room.detect_truth import picture_of, sun_of
from benchmarks.room.room_doubt import HOUSES, doubt_rows
from benchmarks.room.room_level import level_metrics
from benchmarks.room.room_openings import opening_metrics
from benchmarks.room.room_openings import score_room as score_openings
from benchmarks.room.room_real import RealRoom, camera_inside, labelled_rooms, real_rooms
from benchmarks.room.room_run import Estimated, estimated, rivals_of
from benchmarks.room.room_scores import RoomScore, score_room
from benchmarks.truth_rooms import LIGHT_TRUTH, kept_list, room_model_of, truth_of
from processing.ground.room_model import RoomModel

CODE = {
    "ours": (
        *("processing/room/*.py", "processing/segmentation/*", "processing/surfaces/*.py"),
        "benchmarks/room/room*.py",
    ),
}
QUICK_ROOMS, FULL_ROOMS = 3, 24
QUICK_HOUSES, PLOT_ROOMS = 2, 4
SURE = 0.7
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
    rows: list[dict[str, Any]] = field(default_factory=list)

    def all(self, name: str) -> list[float]:
        return [float(row[name]) for row in self.rows]

    def median(self, name: str) -> float:
        return float(np.median(self.all(name)))

    def mean(self, name: str) -> float:
        return float(np.mean(self.all(name)))

    @property
    def windows(self) -> list[float]:
        return [value for row in self.rows for value in row["windows"]]

    @property
    def rivals(self) -> dict[str, list[float]]:
        names = {name for row in self.rows for name in row["rivals"]}
        return {name: [row["rivals"][name] for row in self.rows if name in row["rivals"]] for name in sorted(names)}


def _row(found: Estimated, true: RoomModel) -> dict[str, Any]:
    """Return the figures of one picture."""
    score = score_room(found.estimate.room, true) if found.estimate else NONE
    row = {
        **asdict(score),
        "confidence": found.confidence,
        "refusal": found.refusal,
        "cpu_s": sum(found.cpu_s.values()),
    }
    row["rivals"] = {name: score_room(room, true).iou3d for name, room in rivals_of(found).items()}
    # Of a room that is refused all windows are missed.
    openings = score_openings(true, found.estimate.room if found.estimate else true, found.openings)
    return row | {"windows": openings["window"], "windows_false": openings["window_false"]}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    kept = Rows("room", seed, CODE, keep=not quick)
    rooms = kept_list("test", FULL_ROOMS, seed, **LIGHT_TRUTH)[: QUICK_ROOMS if quick else None]
    each = [kept.row(f"{number}", lambda one=(number, use): _simulated(*one)) for number, use in rooms]
    furnished, empty = (_Gathered([row[name] for row in each]) for name in ("furnished", "empty"))
    real, notes = _real(kept, quick=quick)
    metrics = _simulated_metrics(empty, furnished) | real.pop("metrics")
    metrics |= kept.row("level", lambda: level_metrics(quick=quick))
    metrics |= kept.row("openings", lambda: opening_metrics(quick=quick))
    metrics |= (full := kept.row("full size", lambda: _full_size(rooms[0])))["metrics"]
    bad = kept.row("bad cases", _bad_cases)
    metrics |= bad["metrics"] | _doubts(kept, seed, quick=quick)
    # A rival need not make something of each picture, and of a quick run's few perhaps of none.
    rivals: dict[str, dict[str, float]] = {}
    for kind, gathered in (("empty", empty), ("furnished", furnished)):
        for name, values in gathered.rivals.items():
            rivals.setdefault(name, {})[f"iou3d_{kind}_median"] = float(np.median(values))
    for name, figures in real["rivals"].items():
        rivals.setdefault(name, {}).update(figures)
    notes += [f"{len(rooms)} test rooms; parts at full size, CPU s: {full['parts']}", *bad["notes"]]
    if not quick:
        _plots(kept, rooms, [*empty.rows, *furnished.rows])
    return {"metrics": metrics, "rivals": rivals | PUBLISHED, "notes": notes}


def _simulated(number: int, use: Any) -> dict[str, Any]:
    room, truth = truth_of(number, use, **LIGHT_TRUTH)
    true = room_model_of(room)
    pictures = {"furnished": truth.luminance_rgb, "empty": truth.empty_rgb}
    return {name: _row(estimated(picture_of(rgb), sun=sun_of(room)), true) for name, rgb in pictures.items()}


def _simulated_metrics(empty: _Gathered, furnished: _Gathered) -> dict[str, float]:
    both = _Gathered([*empty.rows, *furnished.rows])
    right = np.array([iou >= RIGHT_IOU3D for iou in both.all("iou3d")], dtype=np.float64)
    return {
        "iou3d_empty_median": empty.median("iou3d"),
        "iou3d_furnished_median": furnished.median("iou3d"),
        "iou3d_empty_mean": empty.mean("iou3d"),
        "iou3d_furnished_mean": furnished.mean("iou3d"),
        "iou2d_empty_median": empty.median("iou2d"),
        "iou2d_furnished_median": furnished.median("iou2d"),
        "corner_err_pct": both.median("corner_err_pct"),
        "corner_empty_err_pct": empty.median("corner_err_pct"),
        "corner_furnished_err_pct": furnished.median("corner_err_pct"),
        "height_err_pct": both.median("height_err_pct"),
        "window_iou": float(np.mean(both.windows)) if both.windows else 0.0,
        "window_iou_median": float(np.median(both.windows)) if both.windows else 0.0,
        "windows_false": sum(both.all("windows_false")),
        "corners_right_share": float(np.mean([row["corners"] == row["true_corners"] for row in both.rows])),
        "confidence_brier": float(((np.array(both.all("confidence")) - right) ** 2).mean()),
        "confidence_mean": both.mean("confidence"),
        "right_share": float(right.mean()),
        "seconds_840": furnished.median("cpu_s"),
    }


def _doubts(kept: Rows, seed: int, *, quick: bool) -> dict[str, float]:
    """Return what confidence is worth in rooms drawn to be mistaken; the plot of a full run."""
    houses = range(QUICK_HOUSES if quick else HOUSES)
    rows = [row for k in houses for row in kept.row(f"doubt {k}", lambda k=k: doubt_rows(seed, k))]
    sure = np.array([row["confidence"] for row in rows])
    right = np.array([row["iou3d"] >= RIGHT_IOU3D for row in rows], dtype=np.float64)
    if not quick:
        reliability_plot(sure, right, Path("room-doubt.png"), f"{len(rows)} rooms drawn to be mistaken, test seeds", 8)
    found = {
        "doubt_pictures": float(len(rows)),
        "doubt_brier": float(((sure - right) ** 2).mean()),
        "doubt_constant_brier": float(right.mean() * (1 - right.mean())),
        "doubt_confidence_mean": float(sure.mean()),
        "doubt_right_share": float(right.mean()),
        "doubt_wrong_and_sure_share": float(((right == 0) & (sure > SURE)).mean()),
        "doubt_far_wrong_and_sure": float(sum(row["iou3d"] < 0.7 and row["confidence"] > SURE for row in rows)),
    }
    for kind in ("plain", "doorway", "tilted", "dark", "cropped"):
        mine = np.array([row["kind"] == kind for row in rows])
        if mine.any() and not quick:
            found[f"doubt_{kind}_confidence_mean"] = float(sure[mine].mean())
            found[f"doubt_{kind}_right_share"] = float(right[mine].mean())
    return found


def _real(kept: Rows, *, quick: bool) -> tuple[dict[str, Any], list[str]]:
    """Return the figures of the scored half of the real pictures."""
    rooms = real_rooms("scored")
    if not rooms:
        return {"metrics": {"iou3d_zind_median": 0.0}, "rivals": {}}, ["the shared panoramas are not here"]
    chosen = rooms[:3] if quick else rooms
    inside = [room for room in (*chosen, *(() if quick else real_rooms("looked at"))) if camera_inside(room.raw)]
    raw = _Gathered([kept.row(room.name, lambda room=room: _real_row(room)) for room in chosen])
    visible = [row["visible"] for row in raw.rows]
    metrics = {
        "iou3d_zind_median": raw.median("iou3d"),
        "iou3d_zind_mean": raw.mean("iou3d"),
        "iou2d_zind_median": raw.median("iou2d"),
        "iou2d_zind_mean": raw.mean("iou2d"),
        "iou3d_zind_visible_median": float(np.median(visible)),
        "iou3d_zind_visible_mean": float(np.mean(visible)),
        "iou3d_zind_better_median": float(np.median(np.maximum(visible, raw.all("iou3d")))),
        "zind_pictures": float(len(chosen)),
    }
    within = _Gathered([kept.row(room.name, lambda room=room: _real_row(room)) for room in inside])
    right = np.array([iou >= RIGHT_IOU3D for iou in within.all("iou3d")], dtype=np.float64)
    metrics |= {
        "zind_inside_pictures": float(len(inside)),
        "iou3d_zind_inside_mean": within.mean("iou3d"),
        "iou3d_zind_inside_median": within.median("iou3d"),
        "confidence_brier_zind_inside": float(((np.array(within.all("confidence")) - right) ** 2).mean()),
        "constant_brier_zind_inside": float(right.mean() * (1 - right.mean())),
    }
    for room in labelled_rooms("scored") if not quick else []:
        row = kept.row(room.name, lambda room=room: _real_row(room))
        metrics["iou3d_layout_gt"] = row["iou3d"]
        raw.rows.append(row)
    notes = [row["note"] for row in raw.rows]
    rivals = {
        name: {"iou3d_zind_median": float(np.median(values)), "iou3d_zind_mean": float(np.mean(values))}
        for name, values in _Gathered(raw.rows[: len(chosen)]).rivals.items()
    }
    return {"metrics": metrics, "rivals": rivals}, notes


def _real_row(room: RealRoom) -> dict[str, Any]:
    found = estimated(room.picture, with_openings=False)
    row = _row(found, room.raw)
    seen = _score(found, room.visible)
    visible_said = "" if seen is None else f", visible {seen:.3f}"
    note = (
        f"{room.name}: 3D IoU raw {row['iou3d']:.3f}{visible_said}, confidence {found.confidence:.2f} {found.refusal}"
    )
    return row | {"visible": row["iou3d"] if seen is None else seen, "note": note.strip()}


def _score(found: Estimated, true: RoomModel | None) -> float | None:
    if true is None:
        return None
    return score_room(found.estimate.room, true).iou3d if found.estimate else 0.0


def _full_size(room: tuple[int, Any]) -> dict[str, Any]:
    """Return CPU seconds and peak memory (MB) of one full-size panorama."""
    plan, truth = truth_of(*room, **LIGHT_TRUTH)
    image = picture_of(cv2.resize(truth.luminance_rgb, FULL_SIZE, interpolation=cv2.INTER_LINEAR))
    with MemoryWatch() as memory:
        found = estimated(image, sun=sun_of(plan))
    parts = ", ".join(f"{name} {value:.2f}" for name, value in found.cpu_s.items())
    return {
        "metrics": {"seconds": sum(found.cpu_s.values()) - memory.cpu_s, "peak_mb": memory.own_peak_mb},
        "parts": parts,
    }


def _bad_cases() -> dict[str, Any]:
    """Return how many bad pictures are refused or doubted, and what became of each."""
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
    found = {name: estimated(picture_of(rgb), with_openings=False) for name, rgb in cases.items()}
    doubted = sum(t.confidence < 0.5 for t in found.values())
    return {
        "metrics": {"bad_cases": float(len(found)), "bad_cases_doubted": float(doubted)},
        "notes": [f"{name}: {t.refusal or f'confidence {t.confidence:.2f}'}"[:200] for name, t in found.items()],
    }


def _plots(kept: Rows, rooms: list[tuple[int, Any]], every: list[dict[str, Any]]) -> None:
    """Draw reliability, and error against run time by resolution and quality (that is: by number of turns)."""
    reliability_plot(
        np.array([row["confidence"] for row in every]),
        np.array([row["iou3d"] >= RIGHT_IOU3D for row in every], dtype=np.float64),
        Path("room-reliability.png"),
        f"{len(every)} pictures of test rooms",
    )
    points = []
    for quality in ("draft", "standard", "reference"):
        for width in (420, 840):
            runs = [
                kept.row(f"{number} {quality} {width}", lambda a=(number, use, quality, width): _timed(*a))
                for number, use in rooms[:PLOT_ROOMS]
            ]
            seconds, error = (float(np.median([run[k] for run in runs])) for k in (0, 1))
            points.append(Point(quality, seconds, error, f"{width} px"))
    time_against_error(
        points,
        Path("room-time.png"),
        title="Furnished test rooms: run time against error",
        error_label="1 - 3D IoU, median",
    )


def _timed(number: int, use: Any, quality: str, width: int) -> list[float]:
    """Return CPU seconds and 1 - 3D IoU of a furnished room at a quality and a size."""
    room, truth = truth_of(number, use, **LIGHT_TRUTH)
    rgb = cv2.resize(truth.luminance_rgb, (width, width // 2), interpolation=cv2.INTER_AREA)
    found = estimated(picture_of(rgb), quality=quality, with_openings=False)
    return [sum(found.cpu_s.values()), 1 - (_score(found, room_model_of(room)) or 0.0)]


def reliability_plot(confidence: np.ndarray, right: np.ndarray, path: Path, title: str, groups: int = 4) -> Path:
    """Draw the share of right rooms over stated confidence, in groups of equal number, with binomial errors."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for group in np.array_split(np.argsort(confidence), min(groups, len(confidence))):
        share = float(right[group].mean())
        error = float(np.sqrt(max(share * (1 - share), 0.05) / len(group)))
        axes.errorbar(float(confidence[group].mean()), share, yerr=error, marker="o", color="#1864ab", capsize=3)
    axes.set(xlabel="stated confidence", ylabel="share with 3D IoU of 0.85 or more", xlim=(0, 1), ylim=(0, 1.05))
    axes.set_title(title, fontsize=10)
    return save_figure(figure, path)
