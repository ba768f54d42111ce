"""Rules that an emptied photograph keeps, checked without a truth: rests, tones, seams, doors, skirting, the floor's
grain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.room.detect_truth import picture_of, share
from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import OpeningKind, RoomModel
from processing.ground.seam import grown, resized
from processing.pictures.images import luminance_cd_m2
from processing.removal.skirting import find_skirting
from processing.segmentation.embedded import scene_evidence
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, FLOOR, plane_map, planes_of, surface_maps
from processing.surfaces.textures import unwrap

ROWS = 512
THING = 0.5
"""Probability from which our network sees furniture in the emptied picture: a rest."""
BESIDE_RAD = math.radians(4)
"""Width of the filled and of the seen strip whose tones are compared along the rim."""
TWO_TONE = 0.3
"""Natural logarithm, in any channel, by which they differ where a surface has two tones (chosen: plain to the eye)."""
LEAST_PX = 300
RIM_RAD, APART_RAD, NEARBY_RAD = math.radians(0.4), math.radians(2), math.radians(6)
"""Half the width of the rim, and between which distances from it gradients are nearby ones."""
STEEP, SEAM = 0.9, 0.4
"""Quantile of the nearby gradients that the rim's are held against, and share of a surface's rim above it from which it
shows a seam: four times what is there by chance (chosen)."""
FAINTEST = 0.04
"""Natural logarithm over two pixels, below which no gradient is seen (chosen)."""
FOOT_RAD, LEAST_FOOT_PX = math.radians(2), 40
"""Height of a wall's foot, and filled pixels of it from which its skirting can be lost."""
HALVED = (0.1, 0.9)
"""Share of a door within the target between which it is cut in two."""
FLOOR_PX_PER_M = 60.0
LEAST_COHERENCE = 0.25
"""Of the structure tensor, from which a floor has one direction: boards have, carpets and square tiles have not."""


@dataclass(frozen=True)
class Emptying:
    """A photograph before and after, linear light, (H, W, 3)."""

    before: Floats
    after: Floats
    target: Flags
    room: RoomModel
    evidence: SceneEvidence
    """Of the photograph."""


def checked(one: Emptying) -> dict[str, float]:
    """Return the figures of one emptied photograph."""
    shape = (ROWS, 2 * ROWS)
    before, after = (resized(rgb, shape) for rgb in (one.before, one.after))
    target = resized(one.target.astype(np.float32), shape) > 0.5
    geometry = Equirectangular(shape[1], shape[0])
    maps = surface_maps(one.room, geometry)
    seen = resized(scene_evidence(picture_of(after)).share(SceneClass.FURNITURE), shape) > THING
    things = resized(one.evidence.share(SceneClass.FURNITURE, SceneClass.FIXTURE, SceneClass.TRIPOD), shape) > THING / 2
    surfaces = [(maps.plane == plane) & (maps.opening < 0) for plane in np.unique(maps.plane)]
    tones = [_step(after, target, one, things) for one in surfaces]
    seams = [seam for one in surfaces if (seam := seam_share(after, target, one, things)) is not None]
    doors = [k for k, o in enumerate(one.room.openings) if o.kind is OpeningKind.DOOR and (maps.opening == k).any()]
    cut = [float(target[maps.opening == k].mean()) for k in doors]
    boards = [had and not has for had, has in skirting_by_wall(before, after, target, one.room)]
    return {
        "rests": share(seen & (maps.opening < 0)),
        "two_tone_planes": sum(tone is not None and tone > TWO_TONE for tone in tones),
        "planes": sum(tone is not None for tone in tones),
        "halved_doors": sum(HALVED[0] < part < HALVED[1] for part in cut),
        "seam_planes": sum(seam > SEAM for seam in seams),
        "skirting_lost": sum(boards),
        "skirting_walls": len(boards),
        "floor_turned_deg": _floor_turned_deg(after, target, one.room),
    }


def _step(after: Floats, target: Flags, plane: Flags, things: Flags) -> float | None:
    """Return the largest difference of median tone between both sides of the rim on a plane; None: hardly a rim."""
    inside = target & plane & grown(~target & plane, BESIDE_RAD)
    outside = ~target & plane & grown(target & plane, BESIDE_RAD) & ~things
    if min(inside.sum(), outside.sum()) < LEAST_PX:
        return None
    level = np.log(np.maximum(after, 1e-4))
    return float(np.abs(np.median(level[inside], axis=0) - np.median(level[outside], axis=0)).max())


def seam_share(after: Floats, target: Flags, plane: Flags, things: Flags) -> float | None:
    """Return the share of the rim on a plane at which light changes more than it does nearby; None: hardly a rim.

    ``after`` (H, W, 3); the others (H, W). By chance it is 1 - `STEEP`.
    """
    level = cv2.GaussianBlur(np.log(np.maximum(luminance_cd_m2(after), 1e-4)).astype(np.float32), (0, 0), 0.8)
    size = np.hypot(*(cv2.Sobel(level, cv2.CV_32F, *way, scale=0.25) for way in ((1, 0), (0, 1))))
    # A line has its steps beside the rim, and the masks of two sizes differ by a pixel: the largest around counts.
    size = cv2.dilate(size, np.ones((5, 5), np.uint8))
    inner = plane & ~grown(~plane, RIM_RAD)
    rim = grown(target, RIM_RAD) & grown(~target, RIM_RAD) & inner & ~things
    nearby = grown(rim, NEARBY_RAD) & inner & ~things & ~grown(rim, APART_RAD)
    if min(rim.sum(), nearby.sum()) < LEAST_PX:
        return None
    return float((size[rim] > max(float(np.quantile(size[nearby], STEEP)), FAINTEST)).mean())


def skirting_by_wall(before: Floats, after: Floats, target: Flags, room: RoomModel) -> list[tuple[bool, bool]]:
    """Return for each wall whose foot is filled in part whether skirting was seen on it, and is where it was filled.

    ``before`` and ``after`` (H, W, 3), ``target`` (H, W). Walls that never showed any are left out.
    """
    geometry = Equirectangular(target.shape[1], target.shape[0])
    planes, found = plane_map(room, geometry), []
    for wall in range(FIRST_WALL, FIRST_WALL + len(room.floor)):
        foot = (planes == wall) & grown(planes == FLOOR, FOOT_RAD)
        others = (planes >= FIRST_WALL) & (planes != wall)
        if (foot & target).sum() < LEAST_FOOT_PX or find_skirting(before, geometry, room, target | others) is None:
            continue
        found.append((True, find_skirting(after, geometry, room, ~target | others) is not None))
    return found


def _floor_turned_deg(after: Floats, target: Flags, room: RoomModel) -> float:
    """Return by how much the floor's main direction differs between what was filled and what is seen (degrees)."""
    geometry, plane = Equirectangular(after.shape[1], after.shape[0]), planes_of(room)[FLOOR]
    level = np.log(np.maximum(luminance_cd_m2(after), 1e-4)).astype(np.float32)
    layers = np.stack([level, target.astype(np.float32)], axis=-1)
    floor = unwrap(layers, geometry, room, plane, FLOOR_PX_PER_M)
    filled = floor.values[..., 1] > 0.5
    angles = [_direction(floor.values[..., 0], floor.known & part) for part in (filled, ~filled)]
    if angles[0] is None or angles[1] is None:
        return 0.0
    return abs((angles[0] - angles[1] + 90) % 180 - 90)


def _direction(level: Floats, where: Flags) -> float | None:
    """Return the main direction of gradients (degrees, 0 to 180); None where there is none to speak of."""
    fine = np.ascontiguousarray(level - cv2.GaussianBlur(level, (0, 0), 8))
    gx, gy = cv2.Sobel(fine, cv2.CV_32F, 1, 0), cv2.Sobel(fine, cv2.CV_32F, 0, 1)
    inner = cv2.erode(where.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    if inner.sum() < LEAST_PX:
        return None
    xx, yy, xy = (float((a * b)[inner].sum()) for a, b in ((gx, gx), (gy, gy), (gx, gy)))
    coherence = math.hypot(xx - yy, 2 * xy) / max(xx + yy, 1e-9)
    return math.degrees(0.5 * math.atan2(2 * xy, xx - yy)) % 180 if coherence > LEAST_COHERENCE else None
