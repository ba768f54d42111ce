"""From a panorama to its room as the pipeline does it, timed by part, and the rivals on the same evidence."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from processing.errors import DaylitError, NoRoomError
from processing.ground.room_model import Opening, RoomModel
from processing.pictures.images import RelativeImage
from processing.room.columns import columns_of
from processing.room.estimate import RoomEstimate, estimate_room
from processing.room.hypotheses import hypotheses
from processing.room.level import find_upright, make_upright
from processing.room.opening_sun import find_openings_in_sun
from processing.segmentation.embedded import scene_evidence
from processing.segmentation.evidence import SceneEvidence

FIXED_BOX = 1.1
"""Half the sides of the fixed box, in camera heights."""


@dataclass(frozen=True)
class Estimated:
    """What was estimated of a panorama; ``estimate`` None: refused, with the reason."""

    estimate: RoomEstimate | None
    openings: tuple[Opening, ...]
    refusal: str
    cpu_s: dict[str, float]
    manhattan_rad: float
    evidence: SceneEvidence | None

    @property
    def confidence(self) -> float:
        """Return the room's confidence; 0 where there is none."""
        return self.estimate.room.confidence if self.estimate else 0.0


def estimated(
    image: RelativeImage,
    *,
    quality: str = "standard",
    with_openings: bool = True,
    sun: tuple[float, float] | None = None,
) -> Estimated:
    """Return the room of a panorama, level or not; ``sun``: its azimuth and elevation (rad), if a session knows."""
    cpu_s: dict[str, float] = {}
    evidence, manhattan = None, 0.0
    try:
        with _timed(cpu_s, "level"):
            found = find_upright(image)
            upright = make_upright(image, found.rotation)
        manhattan = found.manhattan_rad
        with _timed(cpu_s, "evidence"):
            evidence = scene_evidence(upright, quality=quality)
        if evidence.boundary is None:
            raise NoRoomError("no boundaries")
        with _timed(cpu_s, "room"):
            square = found.manhattan_support >= 0.3
            estimate = estimate_room(upright, evidence, manhattan_rad=manhattan if square else None, quality=quality)
        openings: tuple[Opening, ...] = ()
        if with_openings:
            with _timed(cpu_s, "openings"):
                openings = find_openings_in_sun(upright, evidence, estimate.room, sun)
    except DaylitError as error:
        return Estimated(None, (), f"{error.code}: {error}", cpu_s, manhattan, evidence)
    return Estimated(estimate, openings, "", cpu_s, manhattan, evidence)


@contextmanager
def _timed(cpu_s: dict[str, float], part: str) -> Iterator[None]:
    start = time.process_time()
    try:
        yield
    finally:
        cpu_s[part] = time.process_time() - start


def rivals_of(found: Estimated) -> dict[str, RoomModel]:
    """Return rooms that need less: a fixed box, the network's bare polygon, and the best box of its boundaries."""
    box = _box(found.manhattan_rad, FIXED_BOX)
    rivals = {"fixed_box": _room(box, 0.7)}
    if found.evidence is None or found.evidence.boundary is None:
        return rivals
    columns = columns_of(found.evidence.boundary)
    inverse = (columns.floor + columns.ceiling / columns.ratio) / 2
    points = np.stack([np.sin(columns.azimuth_rad), np.cos(columns.azimuth_rad)], axis=-1)
    rivals["network_polygon"] = _room((points / np.maximum(inverse, 0.05)[:, None])[::-1], columns.ratio)
    boxes = [h for h in hypotheses(columns, found.manhattan_rad, slanted=False) if len(h.fit.polygon) == 4]
    if boxes:
        rivals["network_box"] = _room(boxes[0].fit.polygon, boxes[0].fit.outline.ratio)
    return rivals


def _box(turned_rad: float, half: float) -> np.ndarray:
    angle = -turned_rad + math.pi / 4 + np.arange(4) * (math.pi / 2)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1) * (half * math.sqrt(2))


def _room(polygon: np.ndarray, ratio: float) -> RoomModel:
    """Return a room as it comes, unchecked: only its volume is compared."""
    return RoomModel.model_construct(
        floor=tuple((float(x) * 1.6, float(y) * 1.6) for x, y in polygon),
        camera_height_m=1.6,
        ceiling_height_m=1.6 * (1 + ratio),
        openings=(),
    )
