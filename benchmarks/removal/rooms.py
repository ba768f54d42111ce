"""Simulated rooms of test seeds, furnished against truly emptied under the same sky; rivals on the panorama."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.kept_rows import Rows
from benchmarks.removal.composites import near_shadow
from benchmarks.removal.edges import edge_sharpness, joined_truth
from benchmarks.removal.plot import Case as PlotCase
from benchmarks.removal.real import encoded, image_of
from benchmarks.removal.rivals import SLOW, Rival, timed
from benchmarks.removal.scores import scored
from benchmarks.truth_rooms import ROWS, is_kept, kept_list, room_model_of, truth_of
from mocks.rooms.model import Use
from mocks.rooms.truth import WINDOWPANE, TruthPictures
from processing.ground.arrays import Flags, Floats
from processing.pictures.images import luminance_cd_m2
from processing.removal.fill import empty_room
from processing.surfaces.maps import plane_map

LISTED = 16
QUICK_ROOMS, FULL_ROOMS, SLOW_ROOMS = 2, 8, 1
LARGE_ROWS, LARGE_ROOMS = 1024, 4
FULL = (6720, 3360)
PLOTTED = 2
MIDDLE = 0.35
"""Of display white: where the emptied room's median luminance is shown."""
ROOM_KEYS = (
    *("median_err_pct", "p95_err_pct", "consistent_err_pct", "psnr_db", "ssim", "gradient", "texture", "cpu_s"),
    *("exact_median_err_pct", "exact_p95_err_pct", "exact_psnr_db", "exact_ssim", "exact_gradient", "exact_texture"),
    *("edge_sharpness", "seamless_err_pct"),
)
"""Of a room; ``exact``: the same mask on the emptied room itself, whose truth is exact."""


def rooms(
    quick: bool, seed: int, others: dict[str, Rival], rows: Rows, large: bool = False
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return the means over the rooms and those of each rival; ``large``: 2048 x 1024, the rooms kept at that size."""
    listed = kept_list("test", LISTED, seed)[: QUICK_ROOMS if quick else FULL_ROOMS]
    size = LARGE_ROWS if large else ROWS
    if large:
        listed = [one for one in listed if is_kept(*one, rows=size)][:LARGE_ROOMS]
        if not listed:
            return {}, {}
    prefix = "large" if large else "room"
    mine = [rows.row(f"room {use}-{n} {size} daylit", partial(_ours, n, use, size)) for n, use in listed]
    mean = np.nanmean(np.array(mine, np.float64), axis=0)
    named = zip(ROOM_KEYS, mean, strict=True)
    metrics = {_name(prefix, key): round(float(value), 3) for key, value in named if np.isfinite(value)}
    metrics["large_rooms" if large else "rooms"] = len(mine)
    found = {}
    for name, rival in others.items():
        if name in SLOW and large:
            continue
        chosen = listed[:SLOW_ROOMS] if name in SLOW else listed
        made = [
            rows.row(f"room {use}-{n} {size} {name}", partial(_theirs, n, use, size, rival), "theirs")
            for n, use in chosen
        ]
        if any(isinstance(one, str) for one in made):
            print(f"{name} on rooms: {[one for one in made if isinstance(one, str)]}")
            continue
        found[name] = _rival_metrics(prefix, np.array(made, np.float64), np.array(mine[: len(made)], np.float64))
    for kind in (prefix, _name(prefix, "exact")):
        ahead = [figures[f"{kind}_ahead_db"] for figures in found.values()]
        metrics[f"{kind}_gain_db"] = round(min(ahead), 2)
    return metrics, found


def _name(prefix: str, key: str) -> str:
    return f"composed{'_large' if prefix == 'large' else ''}{key[5:]}" if key.startswith("exact") else f"{prefix}_{key}"


def _rival_metrics(prefix: str, made: Any, mine: Any) -> dict[str, float]:
    """Return a rival's means, and by how much ours is ahead on the same rooms."""
    found: dict[str, float] = {}
    kinds = ((prefix, 0, ROOM_KEYS.index("psnr_db")), (_name(prefix, "exact"), 5, ROOM_KEYS.index("exact_psnr_db")))
    for kind, first, ours in kinds:
        for offset, name in enumerate(("psnr_db", "ssim", "gradient", "texture", "s")):
            found[f"{kind}_{name}"] = round(float(made[:, first + offset].mean()), 3)
        found[f"{kind}_ahead_db"] = round(float((mine[:, ours] - made[:, first]).mean()), 2)
    found[f"{prefix}_count"] = len(made)
    return found


def _ours(number: int, use: Use, size: int) -> list[float]:
    room, truth = truth_of(number, use, rows=size)
    target, model = target_of(truth), room_model_of(room)
    ones = np.ones((len(truth.ade), 1), np.float32)
    start = time.process_time()
    found = empty_room(image_of(truth.luminance_rgb), target, model).image.rgb
    spent = time.process_time() - start
    composed = empty_room(image_of(truth.empty_rgb), target, model).image.rgb
    scale, shown = _shown(truth)
    mine = scored(encoded(found * scale), shown, target, spent)
    exact = scored(encoded(composed * scale), shown, target, spent)
    median, p95 = errors(found, truth, target, ones)
    same, _ = errors(found, truth, target, _kept_light(truth, target))
    planes = plane_map(model, image_of(truth.empty_rgb).geometry)
    joined = joined_truth(truth.luminance_rgb, truth.empty_rgb, planes, target)
    sharp = edge_sharpness(found, truth.empty_rgb, planes, target)
    return [
        *(median, p95, same, *mine, *errors(composed, truth, target, ones), *exact[:4]),
        *(sharp[0] / sharp[1] if sharp else math.nan, errors(joined, truth, target, ones)[0]),
    ]


def _theirs(number: int, use: Use, size: int, rival: Rival) -> Any:
    """Return a rival's scores on the furnished and on the emptied room, one after the other; what went wrong."""
    _, truth = truth_of(number, use, rows=size)
    target = target_of(truth)
    scale, shown = _shown(truth)
    made: list[float] = []
    for picture in (np.ascontiguousarray(encoded(truth.luminance_rgb * scale)), np.ascontiguousarray(shown)):
        try:
            filled, seconds = timed(rival, picture, target)
        except Exception as exc:  # noqa: BLE001 (a rival that fails is reported, ours goes on)
            return type(exc).__name__
        made += scored(filled, shown, target, seconds)
    return made


def _shown(truth: TruthPictures) -> tuple[float, npt.NDArray[np.uint8]]:
    scale = MIDDLE / float(np.median(luminance_cd_m2(truth.empty_rgb)))
    return scale, encoded(truth.empty_rgb * scale)


def target_of(truth: TruthPictures) -> Flags:
    """Return what is to be removed: true furniture and tripod, two pixels more, and the dark beside it."""
    ratio = luminance_cd_m2(truth.luminance_rgb) / np.maximum(luminance_cd_m2(truth.empty_rgb), 1e-6)
    return near_shadow(truth.furniture | truth.tripod | (truth.ade == -1), ratio)


def _kept_light(truth: TruthPictures, target: Flags) -> Floats:
    """Return, for each row, the share of the emptied room's light that the furnished one has where it is seen."""
    ratio = luminance_cd_m2(truth.luminance_rgb) / np.maximum(luminance_cd_m2(truth.empty_rgb), 1e-6)
    rows = len(ratio)
    share = np.ones((rows, 1), np.float32)
    for half in (slice(0, rows // 2), slice(rows // 2, rows)):
        seen = ~target[half] & (truth.ade[half] != WINDOWPANE)
        share[half] = np.median(ratio[half][seen])
    return share


def errors(found: Floats, truth: TruthPictures, target: Flags, share: Floats) -> tuple[float, float]:
    """Return median and 95th percentile of the luminance error (%) in the target but for windows."""
    judged = target & (truth.ade != WINDOWPANE)
    emptied = luminance_cd_m2(truth.empty_rgb)
    off = (np.abs(luminance_cd_m2(found) / share - emptied) / np.maximum(emptied, 1e-6))[judged]
    return 100 * float(np.median(off)), 100 * float(np.percentile(off, 95))


def plot_cases(seed: int) -> Iterator[PlotCase]:
    """Yield the emptied rooms on which run time is drawn against error."""
    for number, use in kept_list("test", LISTED, seed)[:PLOTTED]:
        room, truth = truth_of(number, use)
        target = target_of(truth)
        yield truth.empty_rgb, room_model_of(room), target, target & (truth.ade != WINDOWPANE)


def full_size_s(quick: bool, seed: int, notes: list[str]) -> float:
    """Return the CPU seconds of one room at 6720 x 3360; quick: of half that size each way, and says so."""
    number, use = kept_list("test", LISTED, seed)[0]
    room, truth = truth_of(number, use)
    size = (FULL[0] // 2, FULL[1] // 2) if quick else FULL
    if quick:
        notes.append(f"seconds_full measured at {size[0]} x {size[1]} (quick)")
    picture = cv2.resize(truth.luminance_rgb, size, interpolation=cv2.INTER_LINEAR)
    target = cv2.resize(target_of(truth).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST).astype(bool)
    start = time.process_time()
    empty_room(image_of(picture), target, room_model_of(room))
    return round(time.process_time() - start, 1)
