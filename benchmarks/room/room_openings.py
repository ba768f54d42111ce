"""Windows and doors measured: found rectangles against true ones, on the true wall as the camera sees it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
import shapely

from benchmarks.room.detect import MODEL
from benchmarks.room.room_level import as_image
from benchmarks.seeds import Split
from benchmarks.shared_data import DATA
from benchmarks.truth_rooms import kept_list, room_model_of, truth_of
from mocks.rooms.truth import TruthPictures
from processing.ground.arrays import Doubles
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.pictures.images import RelativeImage
from processing.room.estimate import estimate_room
from processing.room.openings import find_openings
from processing.segmentation.around import fused
from processing.segmentation.embedded import scene_evidence
from processing.segmentation.evidence import SceneEvidence
from processing.segmentation.installed import open_installed

Source = Callable[[RelativeImage, TruthPictures], SceneEvidence]


def rectangle_m(room: RoomModel, opening: Opening) -> Doubles:
    """Return the corners (4, 3) of an opening, seen from the camera."""
    first, second = np.array(room.floor[opening.wall]), np.array(room.floor[(opening.wall + 1) % len(room.floor)])
    along = (second - first) / np.linalg.norm(second - first)
    at = [first + along * opening.start_m, first + along * opening.end_m]
    low, high = opening.sill_m - room.camera_height_m, opening.head_m - room.camera_height_m
    return np.array([[*at[0], low], [*at[1], low], [*at[1], high], [*at[0], high]])


def overlap(true_room: RoomModel, true: Opening, room: RoomModel, found: Opening) -> float:
    """Return the IoU of two openings where the camera sees them on the true wall."""
    mine, other = rectangle_m(true_room, true), rectangle_m(room, found)
    origin, u, v = mine[0], mine[1] - mine[0], mine[3] - mine[0]
    normal = np.cross(u, v)
    depth = other @ normal / (origin @ normal)
    if (depth < 0.05).any():
        return 0.0
    hit = other / depth[:, None] - origin
    there = shapely.Polygon(np.stack([hit @ u / np.linalg.norm(u), hit @ v / np.linalg.norm(v)], axis=1)).buffer(0)
    here = shapely.box(0, 0, float(np.linalg.norm(u)), float(np.linalg.norm(v)))
    union = here.union(there).area
    return float(here.intersection(there).area / union) if union > 0 else 0.0


def matched(
    true_room: RoomModel, true: Sequence[Opening], room: RoomModel, found: Sequence[Opening]
) -> tuple[list[float], int]:
    """Return the IoU of every true opening (0: missed) and how many found ones lie on none (IoU below 0.1)."""
    from scipy.optimize import linear_sum_assignment

    if not true or not found:
        return [0.0] * len(true), len(found)
    table = np.array([[overlap(true_room, a, room, b) for b in found] for a in true])
    rows, columns = linear_sum_assignment(-table)
    best = np.zeros(len(true))
    best[rows] = table[rows, columns]
    return [float(value) for value in best], int((table.max(axis=0) < 0.1).sum())


def score_room(true_room: RoomModel, room: RoomModel, found: Sequence[Opening]) -> dict[str, Any]:
    """Return IoUs of windows and of doors (passages count as doors), and false ones of each."""
    out: dict[str, Any] = {}
    for name, kinds in (("window", {OpeningKind.WINDOW}), ("door", {OpeningKind.DOOR, OpeningKind.PASSAGE})):
        true = [o for o in true_room.openings if o.kind in kinds]
        mine = [o for o in found if o.kind in kinds]
        out[name], out[f"{name}_false"] = matched(true_room, true, room, mine)
        out[f"{name}_found"] = len(mine)
    return out


def simulated(split: Split, count: int, source: Source, *, empty: bool = False) -> dict[str, list[Any]]:
    """Return for each room of a split its scores, with the true room given; ``source`` makes the evidence."""
    out: dict[str, list[Any]] = {"room": [], "score": [], "found": [], "cpu_s": []}
    for seed, use in kept_list(split, count):
        room, truth = truth_of(seed, use)
        if not np.isfinite(truth.luminance_rgb).all():
            continue
        true_room = room_model_of(room)
        image = as_image(truth.empty_rgb if empty else truth.luminance_rgb)
        evidence = source(image, truth)
        bare = true_room.model_copy(update={"openings": ()})
        start = time.process_time()
        found = find_openings(image, evidence, bare)
        out["cpu_s"].append(time.process_time() - start)
        out["room"].append((room.name, true_room))
        out["found"].append(found)
        out["score"].append(score_room(true_room, bare, found))
    return out


def on_real(
    half: str, source: Callable[[RelativeImage], SceneEvidence], most: int | None = None, *, own_room: bool = False
) -> dict[str, Any]:
    """Return the scores of a half of the ZInD pictures, reduced to 1024 pixels across; their true rooms are given.

    ``left_out``: pictures whose label is no room that a camera stands in. ``most``: of that half, so many; None: all.
    ``own_room``: on rooms as they are estimated instead.
    """
    from benchmarks.room.detect_truth import photograph
    from processing.errors import DaylitError
    from processing.room.readers import zind_pictures, zind_room

    folder = DATA / "panoramas" / "zind"
    out: dict[str, Any] = {"name": [], "score": [], "left_out": []}
    if not folder.is_dir():
        return out
    pictures = zind_pictures(json.loads((folder / "zind_data.json").read_text("utf-8")))
    for number, path in enumerate(sorted(folder.glob("*.jpg"))):
        if (number % 2 == 0) != (half == "looked at") or (most is not None and number // 2 >= most):
            continue
        try:
            true_room = zind_room(pictures[path.stem])
        except DaylitError as error:  # a camera in a doorway stands outside of the room as it is labelled
            out["left_out"].append(f"{path.stem}: {error.code}")
            continue
        image = as_image(cv2.resize(photograph(path).rgb, (1024, 512), interpolation=cv2.INTER_AREA))
        out["name"].append(path.stem)
        out["score"].append(_scored(image, true_room, source, own_room=own_room))
    return out


def _scored(
    image: RelativeImage, true_room: RoomModel, source: Callable[[RelativeImage], SceneEvidence], *, own_room: bool
) -> dict[str, Any]:
    """Return the scores of one picture; where it is refused, nothing is found and every opening missed."""
    from processing.errors import DaylitError

    bare = true_room.model_copy(update={"openings": ()})
    try:
        evidence = source(image)
        room = estimate_room(image, evidence).room if own_room else bare
        return score_room(true_room, room, find_openings(image, evidence, room)) | {"refused": 0}
    except DaylitError:
        return score_room(true_room, bare, ()) | {"refused": 1}


def opening_metrics(*, quick: bool) -> dict[str, float]:
    """Return the benchmark's figures of openings alone, the true room given: by the shipped network's evidence, and on
    ZInD's scored half by its mean with the model of `daylit models` too, where that is there; on that half also on our
    own rooms (``_own_room``)."""
    rooms = simulated("test", 3 if quick else 24, lambda image, _: scene_evidence(image))
    most = 2 if quick else None
    out: dict[str, float] = {"openings_cpu_s": float(np.median(rooms["cpu_s"]))}
    sources: dict[str, Callable[[RelativeImage], SceneEvidence]] = {"zind": scene_evidence}
    if MODEL.is_file():
        network = open_installed(MODEL)
        sources["zind_fused"] = lambda one: fused(scene_evidence(one), one, network)
    scored = {"sim_given_room": rooms["score"]}
    for name, source in sources.items():
        for whose, own_room in (("given", False), ("own", True)):
            scored[f"{name}_{whose}_room"] = on_real("scored", source, most, own_room=own_room)["score"]
    out["openings_refused"] = float(sum(score.get("refused", 0) for scores in scored.values() for score in scores))
    for name, scores in scored.items():
        for kind in ("window", "door"):
            values = [value for score in scores for value in score[kind]]
            found, right = (sum(score[f"{kind}_found"] for score in scores), sum(value >= RIGHT for value in values))
            if values:
                out[f"{kind}_iou_{name}"] = float(np.mean(values))
                out[f"{kind}s_recall_{name}"] = right / len(values)
            if scores:
                out[f"{kind}s_false_{name}"] = float(sum(score[f"{kind}_false"] for score in scores))
                out[f"{kind}s_precision_{name}"] = right / found if found else 1.0
    return out


RIGHT = 0.5  # IoU from which an opening counts as found (docs/measurements/room.md)
