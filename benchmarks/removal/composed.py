"""Real rooms with rendered furniture (`composites`), emptied as the pipeline does; rivals on the same hole."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.removal.composites import Composite, composites
from benchmarks.removal.edges import smooth_error
from benchmarks.removal.real import encoded, image_of
from benchmarks.removal.rivals import SLOW, Rival, timed
from benchmarks.removal.scores import scored
from processing.ground.seam import grown
from processing.pictures.images import luminance_cd_m2
from processing.removal.fill import empty_room
from processing.removal.masks import MARGIN_RAD, Masks, find_masks
from processing.segmentation.embedded import scene_evidence

REAL_ROOMS = 4
TUNED = ("floor_01_partial_room_01_pano_14", "lebombo_1k")
"""Looked at while filling was made; the others were only scored."""
MIDDLE = 0.35
REAL_KEYS = ("median_err_pct", "p95_err_pct", "smooth_err_pct", "psnr_db", "ssim", "gradient", "texture", "s")


def composed_real(
    quick: bool, others: dict[str, Rival], rows: Rows, notes: list[str]
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return the means over the real rooms, and each rival's; nothing where they are not here."""
    used = {name: rival for name, rival in others.items() if name not in SLOW}
    names, mine, theirs = [], [], []
    for one in composites(1 if quick else REAL_ROOMS):
        case = Case(one)
        names.append(one.name)
        mine.append(rows.row(f"real {one.name} daylit", case.ours))
        theirs.append(
            {
                name: rows.row(f"real {one.name} {name}", partial(case.theirs, rival), "theirs")
                for name, rival in used.items()
            }
        )
    if not mine:
        notes.append("no real panoramas here: furniture in real rooms was not measured")
        return {}, {}
    figures = np.array(mine, np.float64)
    metrics = dict(zip([f"real_{key}" for key in REAL_KEYS], _rounded(figures.mean(axis=0)), strict=True))
    found: dict[str, dict[str, float]] = {}
    for name in used:
        rows_of = [one[name] for one in theirs]
        if all(not isinstance(row, str) for row in rows_of):
            mean = _rounded(np.mean(np.array(rows_of, np.float64), axis=0))
            found[name] = dict(zip([f"real_{key}" for key in REAL_KEYS[3:]], mean, strict=True))
    for room, rivals_row in zip(names, theirs, strict=True):
        failed = {name: row for name, row in rivals_row.items() if isinstance(row, str)}
        notes += [f"{name} failed on {room} and has no means: {row}" for name, row in failed.items()]
    best = max(one["real_psnr_db"] for one in found.values())
    unseen = [i for i, name in enumerate(names) if name not in TUNED]
    metrics |= {"real_gain_db": round(metrics["real_psnr_db"] - best, 2), "real_rooms": len(mine)}
    if unseen:
        ahead = [min(mine[i][3] - row[0] for row in theirs[i].values() if not isinstance(row, str)) for i in unseen]
        metrics["real_unseen_gain_db"] = round(float(np.mean(ahead)), 2)
    for name, row, rivals_row in zip(names, mine, theirs, strict=True):
        others_said = ", ".join(
            f"{k} {v[0]:.1f} dB/{v[2]:.2f}/{v[3]:.2f}" for k, v in rivals_row.items() if not isinstance(v, str)
        )
        notes.append(f"{name}: {row[3]:.1f} dB, gradient {row[5]:.2f}, texture {row[6]:.2f}; {others_said}")
    return metrics, found


def _rounded(values: Any) -> list[float]:
    return [round(float(value), 3) for value in values]


class Case:
    """One composite; its masks are found when first asked for."""

    def __init__(self, one: Composite) -> None:
        self.one = one
        self._told: Masks | None = None
        self.scale = MIDDLE / float(np.median(luminance_cd_m2(one.empty)))
        self.shown = encoded(one.empty * self.scale)

    def masks(self) -> Masks:
        """Return the masks that the pipeline would find in the picture."""
        if self._told is None:
            image = image_of(self.one.furnished)
            self._told = find_masks(image, scene_evidence(image), self.one.room)
        return self._told

    def hole(self) -> Any:
        """Return the target with the tripod, which real pictures have."""
        return self.one.target | grown(self.masks().tripod, MARGIN_RAD)

    def ours(self) -> list[float]:
        """Return our row."""
        one, hole = self.one, self.hole()
        start = time.process_time()
        found = empty_room(image_of(one.furnished), hole, one.room, sunlight=self.masks().sunlight).image.rgb
        spent = time.process_time() - start
        true = luminance_cd_m2(one.empty)
        off = (np.abs(luminance_cd_m2(found) - true) / np.maximum(true, 1e-6))[one.target]
        scores = scored(encoded(found * self.scale), self.shown, one.target, spent)
        smooth = smooth_error(found, one.empty, one.target)
        return [100 * float(np.median(off)), 100 * float(np.percentile(off, 95)), smooth, *scores]

    def theirs(self, rival: Rival) -> Any:
        """Return a rival's scores, or what went wrong."""
        before = np.ascontiguousarray(encoded(self.one.furnished * self.scale))
        try:
            filled, seconds = timed(rival, before, self.hole())
        except Exception as exc:  # noqa: BLE001 (a rival that fails is reported, ours goes on)
            return type(exc).__name__
        return list(scored(filled, self.shown, self.one.target, seconds))
