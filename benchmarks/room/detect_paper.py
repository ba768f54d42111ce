"""The paper's own rooms: our layout and masks beside the authors', who have no truth either.

penn_bed is furnished, coda_320 empty but for a patch of sun, a meter board and a tripod. All shares by solid angle.
"""

from __future__ import annotations

import json

import numpy as np

from benchmarks.room.detect_truth import DATA, photograph, picture_of, score, share
from benchmarks.room.room_run import estimated
from benchmarks.room.room_scores import score_room
from processing.ground.arrays import Flags
from processing.ground.room_model import OpeningKind, RoomModel
from processing.ground.seam import resized
from processing.removal.masks import Masks, find_masks
from processing.room.readers import panoannotator_room
from processing.sphere import Equirectangular
from processing.surfaces.maps import FLOOR, surface_maps

PAPER = DATA / "paper"
SHAPE = (512, 1024)


def paper_figures() -> dict[str, float]:
    """Return how far both agree in penn_bed (IoU), and what is found in coda_320 (shares of the sphere, %)."""
    if not PAPER.is_dir():
        return {}
    room, masks, confidence = _found("penn_bed")
    theirs = panoannotator_room(json.loads((PAPER / "penn_bed" / "authors_layout.json").read_text("utf-8")))
    layout = score_room(room, theirs)
    maps = surface_maps(room, Equirectangular(SHAPE[1], SHAPE[0]))
    windows = [k for k, one in enumerate(room.openings) if one.kind is OpeningKind.WINDOW]
    figures = {
        "penn_layout_iou2d": layout.iou2d,
        "penn_layout_iou3d": layout.iou3d,
        "penn_layout_corner_err_pct": layout.corner_err_pct,
        "penn_layout_height_err_pct": layout.height_err_pct,
        "penn_corners": float(layout.corners),
        "penn_corners_authors": float(layout.true_corners),
        "penn_confidence": confidence,
        "penn_floor_iou": score(maps.plane == FLOOR, _drawn("authors_floor_mask.png")).iou,
        "penn_window_iou": score(np.isin(maps.opening, windows), _drawn("authors_window_mask.png")).iou,
        "penn_tripod_iou": score(masks.tripod, _drawn("authors_tripod_mask.png")).iou,
    }
    target = _drawn("authors_target_mask.jpg")
    together = score(masks.target, target)
    figures |= {"penn_target_iou": together.iou, "penn_target_of_theirs_in_ours": together.recall}
    figures |= {"penn_target_pct": 100 * share(masks.target), "penn_target_authors_pct": 100 * share(target)}
    _, masks, confidence = _found("coda_320")
    figures["coda_confidence"] = confidence
    for name in ("furniture", "tripod", "sunlight", "target"):
        figures[f"coda_{name}_pct"] = 100 * share(getattr(masks, name))
    return figures


def _found(name: str) -> tuple[RoomModel, Masks, float]:
    image = picture_of(resized(np.asarray(photograph(PAPER / name / "panorama.jpg").rgb), SHAPE))
    found = estimated(image)
    if found.estimate is None or found.evidence is None:
        raise RuntimeError(f"{name}: {found.refusal}")
    room = found.estimate.room.model_copy(update={"openings": found.openings})
    return room, find_masks(image, found.evidence, room), found.confidence


def _drawn(name: str) -> Flags:
    """Return one of the authors' masks at our size."""
    from PIL import Image

    with Image.open(PAPER / "penn_bed" / name) as file:
        values = np.asarray(file.convert("L").resize((SHAPE[1], SHAPE[0])), np.float32)
    return np.asarray(values > 127)
