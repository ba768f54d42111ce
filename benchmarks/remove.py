"""Removal: near-periodic textures, generated floors, simulated rooms against the truly emptied ones; rivals beside.

Textures: the two public ones of NPP-Net's samples, each with its own hole and blobs of 15 and 40 % (both were looked at
while the method was made). Floors: test seeds, lit and in perspective, laid flat, blobs of 15 % (and 40 %). Rooms: test
seeds, furnished against emptied under the same sky; the mask is the true one, 2 pixels wider, with the near shadows.
`room_median_err_pct` holds also what furniture takes from the light of the whole room, which no filling may put back
without changing what is seen; `room_consistent_err_pct` is against the emptied room scaled by what the *unmasked*
pixels of each half lost. `composed_...` has the exact truth: the same masks on the emptied rooms themselves, as if
furniture had been put into their pictures and covered with the mask. `room_seamless_err_pct` is the error of the truth
itself, made to join the darker surroundings: what no filling gets below. `room_edge_sharpness`: steepest step across
filled edges of the room over the true one. `real_...`: furniture rendered into real pictures (`_remove_composites`);
`real_smooth_err_pct` of means over some pixels, as the loops of a carpet are nobody's to guess.
Published figures are quoted in docs/removal.md.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks._remove_composites import composites, near_shadow
from benchmarks._remove_edges import edge_sharpness, joined_truth, smooth_error
from benchmarks._remove_floors import SORTS, blob, flat_floor
from benchmarks._remove_plot import Case as PlotCase
from benchmarks._remove_plot import remove_plot
from benchmarks._remove_real import DATA, encoded, image_of, linear
from benchmarks._remove_rivals import Bytes, Flags, Rival, rivals, timed
from benchmarks._truth_rooms import kept_list, room_model_of, truth_of
from benchmarks.seeds import seeds
from mocks.rooms.truth import WINDOWPANE, TruthPictures
from processing.images import luminance_cd_m2
from processing.removal.fill import empty_room
from processing.removal.masks import MARGIN_RAD, find_masks
from processing.removal.near_periodic import complete
from processing.removal.round_masks import grown
from processing.segmentation.embedded import scene_evidence
from processing.surfaces.maps import plane_map

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int16]

Case = tuple[str, Bytes, Flags, Flags]
"""Name, picture (sRGB, OpenCV's order), what is valid, the hole."""
TEXTURES = ("completion_20150911134723-104840a8", "completion_20150911134910-5dcfbc24")
FULL = (6720, 3360)
PLOTTED = 2
UNITS = {"npp_ssim": "SSIM in the hole", "npp_gradient": "gradient energy / truth", "seconds_full": "CPU s"}


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics and rivals; see the module's docstring."""
    cv2.setNumThreads(1)
    others = rivals(slow=not quick)
    notes: list[str] = []
    if not any("xphoto" in name for name in others):
        notes.append("opencv-contrib (shift-map, FSR) absent: DAYLIT_RIVALS_PYTHON names no interpreter")
    textures = list(_textures(quick))
    if not textures:
        notes.append("no public textures here: near-periodic figures are those of generated tiles")
        textures = list(_floors(("tile", "chequered"), (0.15,), seed, 1))
    ours, theirs = _scored(textures, others)
    best = max(np.mean([s[0] for s in figures]) for figures in theirs.values())
    mean = np.mean(ours, axis=0)
    metrics = {
        "npp_psnr_db": round(float(mean[0]), 2),
        "npp_ssim": round(float(mean[1]), 4),
        "npp_gradient": round(float(mean[2]), 3),
        "npp_cpu_s": round(float(mean[3]), 2),
        "npp_gain_db": round(float(mean[0] - best), 2),
    }
    metrics |= _floor_metrics(quick, seed)
    room, room_rivals = _rooms(quick, seed, others)
    metrics |= room | _composed_real(quick, others, notes)
    metrics["seconds_full"] = _full(quick, seed, notes)
    if not quick:
        both = {name: others[name] for name in ("opencv_telea", "opencv_ns")}
        remove_plot(plot_cases(seed), both, Path("removal-time.png"))
    found = {
        name: {
            "npp_psnr_db": round(float(np.mean([s[0] for s in scores])), 2),
            "npp_ssim": round(float(np.mean([s[1] for s in scores])), 4),
            "npp_gradient": round(float(np.mean([s[2] for s in scores])), 3),
            "npp_s": round(float(np.mean([s[3] for s in scores])), 2),
        }
        | room_rivals.get(name, {})
        for name, scores in theirs.items()
    }
    return {"metrics": metrics, "rivals": found, "units": UNITS, "notes": notes}


def _textures(quick: bool) -> Iterator[Case]:
    for name in TEXTURES:
        folder = DATA / "textures" / name
        if not folder.exists():
            continue
        picture = cv2.imread(str(folder / "gt_img.png"))
        valid = cv2.imread(str(folder / "valid_mask.png"), 0) > 127
        own = (cv2.imread(str(folder / "unknown_mask.png"), 0) < 128) & valid
        yield f"{name[-8:]} own", picture, valid, own
        if not quick:
            yield f"{name[-8:]} 15 %", picture, valid, blob(valid, 0.15, 1)
            yield f"{name[-8:]} 40 %", picture, valid, blob(valid, 0.40, 2)


def _floors(sorts: tuple[str, ...], shares: tuple[float, ...], seed: int, count: int) -> Iterator[Case]:
    for sort in sorts:
        for number in seeds("test", count, seed):
            floor = flat_floor(sort, number)
            for share in shares:
                hole = blob(floor.seen, share, number + int(100 * share))
                yield f"{sort} {share:.0%}", encoded(floor.flat), floor.seen, hole


def _scored(cases: list[Case], others: dict[str, Rival]) -> tuple[list[Any], dict[str, list[Any]]]:
    """Return PSNR, SSIM, gradient ratio and seconds of ours and of each rival on the same holes."""
    ours: list[Any] = []
    theirs: dict[str, list[Any]] = {name: [] for name in others}
    for _, picture, valid, hole in cases:
        ours.append(_our_score(picture, valid, hole))
        torn = picture.copy()
        torn[hole] = 0
        for name, rival in others.items():
            try:
                filled, seconds = timed(rival, torn, hole | ~valid)
            except Exception as exc:  # noqa: BLE001 (a rival that fails is told, ours goes on)
                print(f"{name}: {type(exc).__name__}")
                continue
            theirs[name].append((*_scores(filled, picture, hole), seconds))
    return ours, {name: figures for name, figures in theirs.items() if figures}


def _our_score(picture: Bytes, valid: Flags, hole: Flags) -> tuple[float, float, float, float]:
    light = linear(picture)
    light[hole] = 0
    start = time.process_time()
    found = complete(light, valid & ~hole, hole)
    spent = time.process_time() - start
    return (*_scores(encoded(found.values), picture, hole), spent)


def _scores(found: Bytes, truth: Bytes, hole: Flags) -> tuple[float, float, float]:
    """Return PSNR (dB), SSIM and the share of the true gradient energy, in the hole."""
    from skimage.metrics import structural_similarity

    off = (found.astype(np.float64) - truth)[hole]
    psnr = 10 * np.log10(255**2 / max(float(np.mean(off**2)), 1e-9))
    similar = structural_similarity(found, truth, channel_axis=2, full=True)[1].mean(axis=2)[hole].mean()
    return float(psnr), float(similar), _energy(found, hole) / max(_energy(truth, hole), 1e-9)


def _energy(picture: Bytes, hole: Flags) -> float:
    grey = cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_BGR2GRAY).astype(np.float64)
    steps = np.diff(grey, axis=0)[:, :-1] ** 2 + np.diff(grey, axis=1)[:-1] ** 2
    return float(steps[hole[:-1, :-1]].mean())


def _floor_metrics(quick: bool, seed: int) -> dict[str, float]:
    found = {}
    for sort in SORTS:
        for share in (0.15,) if quick else (0.15, 0.40):
            cases = list(_floors((sort,), (share,), seed, 1 if quick else 3))
            scores = np.mean([_our_score(*case[1:]) for case in cases], axis=0)
            key = f"{sort}_{round(100 * share)}"
            found[f"{key}_psnr_db"] = round(float(scores[0]), 2)
            found[f"{key}_gradient"] = round(float(scores[2]), 3)
    return found


def _target(truth: TruthPictures) -> Flags:
    """Return what is to be removed: true furniture and tripod, two pixels more, and the dark beside it."""
    ratio = luminance_cd_m2(truth.luminance_rgb) / np.maximum(luminance_cd_m2(truth.empty_rgb), 1e-6)
    return near_shadow(truth.furniture | truth.tripod | (truth.ade == -1), ratio)


def _kept_light(truth: TruthPictures, target: Flags) -> npt.NDArray[np.float32]:
    """Return, for each row, the share of the emptied room's light that the furnished one has where it is seen."""
    ratio = luminance_cd_m2(truth.luminance_rgb) / np.maximum(luminance_cd_m2(truth.empty_rgb), 1e-6)
    rows = len(ratio)
    share = np.ones((rows, 1), np.float32)
    for half in (slice(0, rows // 2), slice(rows // 2, rows)):
        seen = ~target[half] & (truth.ade[half] != WINDOWPANE)
        share[half] = np.median(ratio[half][seen])
    return share


def _edges_of(found: Floats, truth: TruthPictures, target: Flags, planes: Integers) -> tuple[float, float]:
    """Return the sharpness of filled edges over the true one, and the error (%) of a seamless perfect filling."""
    ones = np.ones((len(truth.ade), 1), np.float32)
    joined = joined_truth(truth.luminance_rgb, truth.empty_rgb, planes, target)
    sharp = edge_sharpness(found, truth.empty_rgb, planes, target)
    return (sharp[0] / sharp[1] if sharp else math.nan), _errors(joined, truth, target, ones)[0]


def _composed_real(quick: bool, others: dict[str, Rival], notes: list[str]) -> dict[str, float]:
    """Return the figures of real rooms with rendered furniture; nothing where they are not here."""
    rows: list[tuple[float, ...]] = []
    theirs: list[tuple[float, ...]] = []
    for one in composites(1 if quick else REAL_ROOMS):
        image = image_of(one.furnished)
        # As the pipeline does: what is not to be copied from is told from the picture.
        told = find_masks(image, scene_evidence(image), one.room)
        hole = one.target | grown(told.tripod, MARGIN_RAD)
        found = empty_room(image, hole, one.room, sunlight=told.sunlight).image.rgb
        off = np.abs(luminance_cd_m2(found) - luminance_cd_m2(one.empty)) / np.maximum(luminance_cd_m2(one.empty), 1e-6)
        scale = 0.35 / float(np.median(luminance_cd_m2(one.empty)))
        shown, before = encoded(one.empty * scale), np.ascontiguousarray(encoded(one.furnished * scale))
        scores = _scores(encoded(found * scale), shown, one.target)
        errors = off[one.target]
        smooth = smooth_error(found, one.empty, one.target)
        rows.append((100 * float(np.median(errors)), 100 * float(np.percentile(errors, 95)), *scores[:2], smooth))
        fills = [timed(others[name], before, hole)[0] for name in ("opencv_telea", "opencv_ns")]
        theirs.append(tuple(_scores(fill, shown, one.target)[0] for fill in fills))
        notes.append(
            f"{one.name}: median error {rows[-1][0]:.1f} %, {scores[0]:.1f} dB, rivals {max(theirs[-1]):.1f} dB"
        )
    if not rows:
        notes.append("no real panoramas here: furniture in real rooms was not measured")
        return {}
    mean = np.mean(rows, axis=0)
    found_metrics = {name: round(float(value), 3) for name, value in zip(REAL_KEYS, mean, strict=True)}
    gain = float(mean[2]) - float(np.mean(theirs, axis=0).max())
    return found_metrics | {"real_gain_db": round(gain, 2), "real_rooms": len(rows)}


REAL_ROOMS = 4
REAL_KEYS = ("real_median_err_pct", "real_p95_err_pct", "real_psnr_db", "real_ssim", "real_smooth_err_pct")


def _rooms(quick: bool, seed: int, others: dict[str, Rival]) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    used = {name: rival for name, rival in others.items() if not name.startswith(("skimage", "xphoto_fsr"))}
    rows = []
    theirs: dict[str, list[tuple[float, float]]] = {name: [] for name in used}
    for number, use in kept_list("test", 16, seed)[: 2 if quick else 8]:
        room, truth = truth_of(number, use)
        target, model = _target(truth), room_model_of(room)
        share, ones = _kept_light(truth, target), np.ones((len(truth.ade), 1), np.float32)
        start = time.process_time()
        found = empty_room(image_of(truth.luminance_rgb), target, model).image.rgb
        spent = time.process_time() - start
        composed = empty_room(image_of(truth.empty_rgb), target, model).image.rgb
        scale = 0.35 / float(np.median(luminance_cd_m2(truth.empty_rgb)))
        shown = encoded(truth.empty_rgb * scale)
        mine = _scores(encoded(found * scale), shown, target)
        exact = _scores(encoded(composed * scale), shown, target)
        median, p95 = _errors(found, truth, target, ones)
        same, _ = _errors(found, truth, target, share)
        composed_median, composed_p95 = _errors(composed, truth, target, ones)
        sharp, floor = _edges_of(found, truth, target, plane_map(model, image_of(truth.empty_rgb).geometry))
        rows.append((median, p95, same, *mine[:2], spent, composed_median, composed_p95, *exact, sharp, floor))
        print(f"{room.name}: {dict(zip(ROOM_KEYS, np.round(rows[-1], 3), strict=True))}", file=sys.stderr, flush=True)
        before = np.ascontiguousarray(encoded(truth.luminance_rgb * scale))
        for name, rival in used.items():
            try:
                pair = tuple(
                    _scores(timed(rival, picture, target)[0], shown, target)[0]
                    for picture in (before, np.ascontiguousarray(shown))
                )
            except Exception as exc:  # noqa: BLE001 (a rival that fails is told, ours goes on)
                print(f"{name} on a room: {type(exc).__name__}")
                continue
            theirs[name].append((pair[0], pair[1]))
    return _room_metrics(rows, theirs)


ROOM_KEYS = (
    *("room_median_err_pct", "room_p95_err_pct", "room_consistent_err_pct", "room_psnr_db", "room_ssim", "room_cpu_s"),
    *("composed_median_err_pct", "composed_p95_err_pct", "composed_psnr_db", "composed_ssim", "composed_gradient"),
    *("room_edge_sharpness", "room_seamless_err_pct"),
)


def _room_metrics(
    rows: list[Any], theirs: dict[str, list[tuple[float, float]]]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    mean = np.nanmean(rows, axis=0)
    metrics = {k: round(float(v), 3) for k, v in zip(ROOM_KEYS, mean, strict=True) if np.isfinite(v)}
    metrics["rooms"] = len(rows)
    found = {}
    for name, pairs in theirs.items():
        if len(pairs) == len(rows):
            room, composed = np.mean(pairs, axis=0)
            found[name] = {"room_psnr_db": round(float(room), 2), "composed_psnr_db": round(float(composed), 2)}
    for kind in ("room", "composed"):
        best = max(figures[f"{kind}_psnr_db"] for figures in found.values())
        metrics[f"{kind}_gain_db"] = round(metrics[f"{kind}_psnr_db"] - best, 2)
    return metrics, found


def _errors(
    found: npt.NDArray[np.float32], truth: TruthPictures, target: Flags, share: npt.NDArray[np.float32]
) -> tuple[float, float]:
    """Return median and 95th percentile of the luminance error (%) in the target but for windows."""
    judged = target & (truth.ade != WINDOWPANE)
    emptied = luminance_cd_m2(truth.empty_rgb)
    off = (np.abs(luminance_cd_m2(found) / share - emptied) / np.maximum(emptied, 1e-6))[judged]
    return 100 * float(np.median(off)), 100 * float(np.percentile(off, 95))


def plot_cases(seed: int) -> Iterator[PlotCase]:
    """Yield the emptied rooms on which run time is drawn against error."""
    for number, use in kept_list("test", 16, seed)[:PLOTTED]:
        room, truth = truth_of(number, use)
        target = _target(truth)
        yield truth.empty_rgb, room_model_of(room), target, target & (truth.ade != WINDOWPANE)


def _full(quick: bool, seed: int, notes: list[str]) -> float:
    """Return the CPU seconds of one room at 6720 x 3360; quick: of half that size each way, and says so."""
    number, use = kept_list("test", 16, seed)[0]
    room, truth = truth_of(number, use)
    size = (FULL[0] // 2, FULL[1] // 2) if quick else FULL
    if quick:
        notes.append(f"seconds_full measured at {size[0]} x {size[1]} (quick)")
    picture = cv2.resize(truth.luminance_rgb, size, interpolation=cv2.INTER_LINEAR)
    target = cv2.resize(_target(truth).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST).astype(bool)
    start = time.process_time()
    empty_room(image_of(picture), target, room_model_of(room))
    return round(time.process_time() - start, 1)
