"""A box room painted by hand: one window, a box of furniture, a patch of sun, a tripod; every mask is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Flags
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.ground.seam import resized, smoothed
from processing.pictures.images import RelativeImage
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular, directions
from processing.surfaces.maps import CEILING, FLOOR, SurfaceMaps, surface_maps
from processing.surfaces.sun import sun_vector, wall_between, window_depth

ROWS = 128
SUN = (math.pi, math.radians(35))
"""Behind the camera, where the window is; azimuth and elevation."""
GREY = {FLOOR: 0.25, CEILING: 0.8}
WALL_GREY = 0.6


def box_room(*, window: bool = True) -> RoomModel:
    """Return a room of 4 x 5 m with a window in its back wall (wall 0, from (-2, -2) to (2, -2))."""
    openings = (Opening(kind=OpeningKind.WINDOW, wall=0, start_m=1.2, end_m=2.8, sill_m=0.8, head_m=2.2),)
    return RoomModel(
        source="given",
        floor=((-2.0, -2.0), (2.0, -2.0), (2.0, 3.0), (-2.0, 3.0)),
        camera_height_m=1.6,
        ceiling_height_m=2.7,
        openings=openings if window else (),
    )


@dataclass(frozen=True)
class Painted:
    """The picture and what is in it."""

    room: RoomModel
    image: RelativeImage
    evidence: SceneEvidence
    maps: SurfaceMaps
    points_m: npt.NDArray[np.float64]
    furniture: Flags
    hung: Flags
    """A picture on the wall that the evidence takes for furniture."""
    tripod: Flags
    sunlit: Flags


def places(room: RoomModel, maps: SurfaceMaps) -> npt.NDArray[np.float64]:
    """Return what each pixel sees of the empty room (H, W, 3)."""
    rows, columns = maps.plane.shape
    d, _ = directions(Equirectangular(columns, rows))
    return np.asarray(d * maps.depth_m[..., None] + np.array([0.0, 0.0, room.camera_height_m]))


@lru_cache(maxsize=3)
def paint(
    *,
    rows: int = ROWS,
    sun: bool = True,
    sun_at: tuple[float, float] = SUN,
    sun_ratio: float = 8.0,
    things: bool = True,
    window: bool = True,
) -> Painted:
    """Return a painted room, to be left as it is; light of the sun is ``sun_ratio`` times that of the shade."""
    room = box_room()
    geometry = Equirectangular(2 * rows, rows)
    maps = surface_maps(room, geometry)
    points = places(room, maps)
    d, _ = directions(geometry)
    longitude, latitude = np.arctan2(d[..., 0], d[..., 1]), np.arcsin(d[..., 2])
    none = np.zeros(maps.plane.shape, bool)
    furniture = (np.abs(longitude + 0.9) < 0.45) & (np.abs(latitude + 0.45) < 0.28) if things else none
    hung = (np.abs(longitude - 0.1) < 0.2) & (np.abs(latitude - 0.12) < 0.12) if things else none
    tripod = latitude < -1.35 if things else none
    way = sun_vector(*sun_at)
    depth, _ = window_depth(room, points, way)
    lit = (depth > 0) & (maps.opening < 0) & (maps.plane != CEILING) & ~wall_between(room, points, way)
    lit &= ~furniture & ~tripod
    grey = np.where(maps.plane == FLOOR, GREY[FLOOR], np.where(maps.plane == CEILING, GREY[CEILING], WALL_GREY))
    # Texture, so that no surface is without detail.
    grey = grey * (1 + 0.06 * np.random.default_rng(5).standard_normal(grey.shape))
    light = np.repeat(grey[..., None], 3, axis=2) * np.array([1.0, 0.95, 0.85])
    light[furniture] = (0.05, 0.12, 0.3)
    light[hung] = (0.4, 0.05, 0.05)
    light[tripod] = 0.02
    light[maps.opening >= 0] = 6.0
    if sun:
        light[lit] *= sun_ratio
    shape = maps.plane.shape
    image = RelativeImage(
        np.maximum(light, 0.001).astype(np.float32),
        np.full(shape, 0.01, np.float32),
        np.zeros(shape, np.uint8),
        geometry,
    )
    classes = np.where(maps.plane == FLOOR, SceneClass.FLOOR, SceneClass.WALL)
    classes[maps.plane == CEILING] = SceneClass.CEILING
    classes[maps.opening >= 0] = SceneClass.WINDOW
    classes[furniture | hung] = SceneClass.FURNITURE
    classes[tripod] = SceneClass.TRIPOD
    shown = room if window else room.model_copy(update={"openings": ()})
    return Painted(shown, image, evidence_of(classes), maps, points, furniture, hung, tripod, lit if sun else none)


def evidence_of(classes: npt.NDArray[np.int_]) -> SceneEvidence:
    """Return evidence at half the size: blurred, as a network's."""
    one = np.eye(len(SceneClass), dtype=np.float32)[classes]
    small = smoothed(resized(one, (classes.shape[0] // 2, classes.shape[1] // 2)), 2 * math.pi / classes.shape[0])
    soft = 0.98 * small + 0.02 / len(SceneClass)
    return SceneEvidence(np.ascontiguousarray((soft / soft.sum(axis=2, keepdims=True)).transpose(2, 0, 1)), "painted")


def iou(found: Flags, true: Flags) -> float:
    """Return intersection over union by pixels (1 for two empty masks)."""
    union = (found | true).sum()
    return float((found & true).sum() / union) if union else 1.0
