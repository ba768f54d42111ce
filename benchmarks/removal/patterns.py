"""Holes in patterns: public textures and generated floors, filled by us and by every rival."""

from __future__ import annotations

import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.removal.floors import SORTS, blob, flat_floor
from benchmarks.removal.real import DATA, encoded, linear
from benchmarks.removal.rivals import Rival, timed
from benchmarks.removal.scores import Scores, scored
from benchmarks.seeds import seeds
from processing.ground.arrays import Bytes, Flags
from processing.removal.near_periodic import complete

Case = tuple[str, Bytes, Flags, Flags]
"""Name, picture (sRGB, OpenCV's order), what is valid, the hole."""

TEXTURES = ("completion_20150911134723-104840a8", "completion_20150911134910-5dcfbc24")
"""NPP-Net's public samples; both were looked at while the method was made."""
PERIODIC, APERIODIC = ("brick",), ("gravel", "grass")
"""CC0 pictures that scikit-image brings: never looked at for tuning."""
PHOTO_PX = 360
SHARES = (0.15, 0.40)
FLOORS = 2


def textures(quick: bool) -> Iterator[Case]:
    """Yield the public textures with their own hole and blobs."""
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


def photographs(names: tuple[str, ...], quick: bool) -> Iterator[Case]:
    """Yield scikit-image's pictures with blobs; three places for the smaller one."""
    found = find_spec("skimage")
    if found is None or found.origin is None:
        return
    for name in names:
        picture = cv2.imread(str(Path(found.origin).parent / "data" / f"{name}.png"))
        if picture is None:
            continue
        small = np.asarray(cv2.resize(picture, (PHOTO_PX, PHOTO_PX), interpolation=cv2.INTER_AREA), np.uint8)
        valid = np.ones(small.shape[:2], bool)
        for place in range(1 if quick else 3):
            yield f"{name} 15 % {place}", small, valid, blob(valid, 0.15, 31 + place)
        if not quick:
            yield f"{name} 40 %", small, valid, blob(valid, 0.40, 35)


def floors(sorts: tuple[str, ...], shares: tuple[float, ...], seed: int, count: int) -> Iterator[Case]:
    """Yield generated floors of test seeds, lit and in perspective, laid flat again."""
    for sort in sorts:
        for number in seeds("test", count, seed):
            floor = flat_floor(sort, number)
            for share in shares:
                hole = blob(floor.seen, share, number + int(100 * share))
                yield f"{sort} {share:.0%} {number}", encoded(floor.flat), floor.seen, hole


def ours_on(case: Case, rows: Rows) -> Scores:
    """Return our scores."""
    name, picture, valid, hole = case
    return Scores(*rows.row(f"pattern {name} daylit", lambda: _ours(picture, valid, hole), "patterns"))


def _ours(picture: Bytes, valid: Flags, hole: Flags) -> Scores:
    light = linear(picture)
    light[hole] = 0
    start = time.process_time()
    found = complete(light, valid & ~hole, hole)
    spent = time.process_time() - start
    return scored(encoded(found.values), picture, hole, spent)


def theirs_on(case: Case, name: str, rival: Rival, rows: Rows) -> Scores | None:
    """Return a rival's scores on the same hole; None where it failed."""
    title, picture, valid, hole = case

    def make() -> Any:
        torn = picture.copy()
        torn[hole] = 0
        try:
            filled, seconds = timed(rival, torn, hole | ~valid)
        except Exception as exc:  # noqa: BLE001 (a rival that fails is reported, ours goes on)
            return type(exc).__name__
        return scored(filled, picture, hole, seconds)

    found = rows.row(f"pattern {title} {name}", make, "theirs")
    if isinstance(found, str):
        print(f"{name} on {title}: {found}")
        return None
    return Scores(*found)


def means(prefix: str, scores: list[Scores]) -> dict[str, float]:
    """Return the means over cases as metrics."""
    mean = np.mean(scores, axis=0)
    names = ("psnr_db", "ssim", "gradient", "texture", "cpu_s")
    return {f"{prefix}_{name}": round(float(value), 3) for name, value in zip(names, mean, strict=True)}


def compared(
    prefix: str, cases: list[Case], others: dict[str, Rival], rows: Rows
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return our means over the cases with the gain over the best rival, and each rival's means."""
    mine = means(prefix, [ours_on(case, rows) for case in cases])
    found = {}
    for name, rival in others.items():
        scores = [one for case in cases if (one := theirs_on(case, name, rival, rows)) is not None]
        if len(scores) == len(cases):
            found[name] = means(prefix, scores)
        elif scores:
            found[name] = {f"{prefix}_failed": float(len(cases) - len(scores))}
    best = max(figures.get(f"{prefix}_psnr_db", -np.inf) for figures in found.values())
    mine[f"{prefix}_gain_db"] = round(mine[f"{prefix}_psnr_db"] - float(best), 2)
    return mine, found


def floor_metrics(quick: bool, seed: int, rows: Rows) -> dict[str, float]:
    """Return PSNR and gradient energy of each sort of floor and size of hole."""
    found = {}
    for sort in SORTS:
        for share in SHARES[:1] if quick else SHARES:
            cases = floors((sort,), (share,), seed, 1 if quick else FLOORS)
            mean = np.mean([ours_on(case, rows) for case in cases], axis=0)
            key = f"{sort}_{round(100 * share)}"
            found[f"{key}_psnr_db"] = round(float(mean[0]), 2)
            found[f"{key}_gradient"] = round(float(mean[2]), 3)
            found[f"{key}_texture"] = round(float(mean[3]), 3)
    return found
