"""Emptying judged on rooms of another generator and another renderer: Infinigen Indoors, Cycles.

The rooms lie in ``shared/data/infinigen`` beside the checkout and in the folder that ``DAYLIT_INFINIGEN`` names; how to
make them: `benchmarks.removal.infinigen_rooms`. Each is shown furnished and truly emptied in one daylight or several,
as single panoramas in relative units without a picture of the sky. **Rooms of even seeds are never looked at**: only
their figures are printed (``infinigen_unseen_*``), and nothing is tuned on them.

``not_emptied``: pairs of which nothing was made, and which no median has. ``filled_*``, ``all_*``: the emptied picture,
where removal filled in and everywhere; ``seen_*``: the change of light of pixels that show the room in both states and
were not filled in. Where passes exist, ``mask_iou``, ``mask_recall``: what is to be removed against the things that
Infinigen put in; ``depth_err_pct``: distance of stand-ins; ``shape_*``: distance of the room's own surfaces, the
estimated room against the emptied one.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.removal.infinigen_rooms import FIRST_THING
from benchmarks.shared_data import DATA
from benchmarks.whole.end_to_end_run import bias_pct, errors_of
from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.pictures.exr import read_exr, read_exr_rgb
from processing.pictures.images import luminance_cd_m2
from processing.pictures.preview import read_mask
from processing.running.panorama_session import panorama_session
from processing.running.requests import RunRequest
from processing.running.runner import process
from processing.sphere import Equirectangular, solid_angles
from processing.stages.contract import Quality
from processing.surfaces.maps import surface_maps

FIGURES = ("filled_median_err_pct", "filled_bias_pct", "all_median_err_pct", "all_bias_pct", "seen_median_err_pct")
FIGURES += ("seen_bias_pct", "mask_iou", "mask_recall", "depth_err_pct", "shape_median_err_pct")
SHADES = ("lift", "keep")


def independent(*, quick: bool) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return metrics by ``--shade``, medians over pairs of pictures of each half of the rooms, and notes.

    A quick run takes the first pair of rooms that are looked at, and none of the others.
    """
    pairs = pairs_of(DATA / "infinigen", Path(os.environ.get("DAYLIT_INFINIGEN", os.devnull)))
    if not pairs:
        return {}, [f"infinigen: left out, no pairs of pictures in {DATA / 'infinigen'} or DAYLIT_INFINIGEN"]
    halves = {"infinigen": [pair for pair in pairs if not unseen(pair)], "infinigen_unseen": []}
    if quick:
        halves["infinigen"] = halves["infinigen"][:1]
    else:
        halves["infinigen_unseen"] = [pair for pair in pairs if unseen(pair)]
    metrics: dict[str, dict[str, float]] = {shade: {} for shade in SHADES}
    notes = []
    for half, mine in halves.items():
        for shade in SHADES:
            rows = [row_of(pair, shade) for pair in mine]
            metrics[shade] |= {f"{half}_{name}": value for name, value in medians(rows).items()}
            if mine:
                metrics[shade][f"{half}_not_emptied"] = sum(FIGURES[0] not in row for row in rows)
            if half == "infinigen":
                notes += [f"infinigen {row['room']}, {shade}: {row}" for row in rows]
        if mine:
            metrics["lift"][f"{half}_pairs"] = len(mine)
    return metrics, notes


class Pair(NamedTuple):
    """Two pictures of one room under one light."""

    folder: Path
    """Holds ``furnished.exr`` and ``empty.exr``."""
    room: Path
    """Folder of the room, which may hold ``passes.exr`` and ``empty_passes.exr``."""

    @property
    def name(self) -> str:
        """Return the room's name, and its light's."""
        return self.room.name if self.room == self.folder else f"{self.room.name}/{self.folder.name}"


def pairs_of(*roots: Path) -> list[Pair]:
    """Return the pairs in some folders, of ROOM/furnished.exr and ROOM/LIGHT/furnished.exr."""
    flat = [Pair(one.parent, one.parent) for root in roots for one in sorted(root.glob("*/furnished.exr"))]
    lit = [Pair(one.parent, one.parent.parent) for root in roots for one in sorted(root.glob("*/*/furnished.exr"))]
    return flat + lit


def unseen(pair: Pair) -> bool:
    """Return whether a room is one of those that are never looked at: its seed, which ends its name, is even."""
    return int(pair.room.name.rpartition("-")[2]) % 2 == 0


def medians(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the median of each figure that some row has."""
    some = [name for name in FIGURES if any(name in row for row in rows)]
    return {name: round(float(np.median([row[name] for row in rows if name in row])), 3) for name in some}


def row_of(pair: Pair, shade: str) -> dict[str, Any]:
    """Return the errors of one pair: its furnished picture emptied, against the empty one."""
    before, true = (read_exr_rgb(pair.folder / f"{name}.exr")[0] for name in ("furnished", "empty"))
    with tempfile.TemporaryDirectory() as folder:
        session = panorama_session(pair.folder / "furnished.exr", Path(folder) / pair.folder.name)
        asked: dict[str, object] = {"--shade": shade, "--doubtful-room": True}
        done = process(session, RunRequest(quality=Quality.STANDARD, until="remove", options=asked))
        row: dict[str, Any] = {
            "room": pair.name,
            "left_out": [s.stage for s in done.stages if s.summary.get("skipped")],
        }
        return row | emptied_errors(session / "stages", before, true) | _by_passes(session / "stages", pair)


def emptied_errors(stages: Path, before: Floats, true: Floats) -> dict[str, float]:
    """Return errors of a session's emptied picture; ``before``, ``true`` (H, W, 3): the room in both states."""
    if not (stages / "remove" / "empty.exr").is_file():
        return {}
    given = luminance_cd_m2(read_exr(stages / "calibrate" / "indoor.exr").rgb)
    scale = np.float32(np.median(luminance_cd_m2(before)) / np.median(given))
    rgb, filled = scale * read_exr(stages / "remove" / "empty.exr").rgb, read_mask(stages / "remove" / "filled.png")
    ours, whole = luminance_cd_m2(rgb).astype(np.float64), np.ones(filled.shape, bool)
    row: dict[str, float] = {}
    for name, where in (("filled", filled), ("all", whole), ("seen", ~filled)):
        row |= errors_of(name, rgb, true, where)
        row[f"{name}_bias_pct"] = bias_pct(ours, luminance_cd_m2(true).astype(np.float64), where)
    return row


def _by_passes(stages: Path, pair: Pair) -> dict[str, float]:
    """Return how right masks, distances and the room's shape are; nothing of a pair without passes."""
    if not (pair.room / "empty_passes.exr").is_file():
        return {}
    distance_m, index = read_passes(pair.room / "passes.exr")
    wall_m, _ = read_passes(pair.room / "empty_passes.exr")
    area = solid_angles(Equirectangular(index.shape[1], index.shape[0]))
    things, row = index >= FIRST_THING, {}
    if (stages / "detect" / "furniture.png").is_file():
        found = read_mask(stages / "detect" / "furniture.png")
        both = float(area[found & things].sum())
        row["mask_iou"] = round(both / float(area[found | things].sum()), 3)
        row["mask_recall"] = round(both / float(area[things].sum()), 3)
    if (stages / "light" / "shade.npz").is_file():
        with np.load(stages / "light" / "shade.npz") as kept:
            row |= _off("depth", kept["standin_m"].astype(np.float64), distance_m, things)
    if (stages / "room" / "room.json").is_file():
        room = RoomModel.model_validate(json.loads((stages / "room" / "room.json").read_text("utf-8")))
        model_m = surface_maps(room, Equirectangular(index.shape[1], index.shape[0])).depth_m
        row |= _off("shape_median", model_m.astype(np.float64), wall_m, np.ones(index.shape, bool))
    return row


def _off(name: str, ours_m: Any, true_m: Any, where: Flags) -> dict[str, float]:
    """Return the median error of distances (h, w) where both are known, %."""
    step = true_m.shape[0] // ours_m.shape[0]
    true_m, where = (one[step // 2 :: step, step // 2 :: step] for one in (true_m, where))
    area = solid_angles(Equirectangular(ours_m.shape[1], ours_m.shape[0]))
    use = where & (ours_m > 0) & (true_m < 100)
    if not use.any():
        return {}
    off = np.abs(ours_m[use] / true_m[use] - 1)
    order = np.argsort(off)
    upto = np.cumsum(area[use][order])
    return {f"{name}_err_pct": round(100 * float(off[order][np.searchsorted(upto, upto[-1] / 2)]), 2)}


def read_passes(path: Path) -> tuple[Any, Any]:
    """Return distance (H, W), m, and object index (H, W) of a file of passes."""
    import OpenEXR

    with OpenEXR.File(str(path)) as file:
        planes = {name.rpartition(".")[0].rpartition(".")[2]: c.pixels for name, c in file.channels().items()}
    return planes["Depth"].astype(np.float64), np.rint(planes["IndexOB"]).astype(int)
