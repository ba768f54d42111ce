"""Rooms as pictures and evidence made by hand: a painted room, its classes, its boundaries with chosen errors."""

from __future__ import annotations

import math

import numpy as np

from processing.ground.room_model import RoomModel
from processing.pictures.images import RelativeImage
from processing.segmentation.evidence import BoundaryEvidence, SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.surfaces.maps import boundary_latitudes, in_sight, plane_map

COLUMNS = 256
BOX = ((-1.6, -2.2), (2.3, -2.2), (2.3, 1.7), (-1.6, 1.7))
ELL = ((-1.5, -1.4), (3.2, -1.4), (3.2, 1.2), (1.1, 1.2), (1.1, 3.4), (-1.5, 3.4))
SLANTED = ((-2.0, -1.5), (2.0, -1.5), (2.0, 1.2), (-2.0, 2.6))


def turned(floor, angle: float):
    c, s = math.cos(angle), math.sin(angle)
    return tuple((c * x - s * y, s * x + c * y) for x, y in floor)


def room_of(floor, *, ceiling: float = 2.55, camera: float = 1.6) -> RoomModel:
    return RoomModel(source="given", floor=floor, camera_height_m=camera, ceiling_height_m=ceiling)


def azimuths(count: int = COLUMNS) -> np.ndarray:
    return ((np.arange(count) + 0.5) / count - 0.5) * 2 * math.pi


def boundary_of(room: RoomModel, *, noise_deg: float = 0.0, seed: int = 0, bias_deg: float = 0.0) -> BoundaryEvidence:
    azimuth = azimuths()
    ceiling, floor = boundary_latitudes(room, azimuth)
    rng = np.random.default_rng(seed)
    sigma = math.radians(max(noise_deg, 0.5))
    ceiling = ceiling + rng.normal(0, math.radians(noise_deg), COLUMNS) + math.radians(bias_deg)
    floor = floor + rng.normal(0, math.radians(noise_deg), COLUMNS) - math.radians(bias_deg)
    corner = np.zeros(COLUMNS)
    corners = np.array(room.floor)
    for x, y in corners[in_sight(room.floor, corners * (1 - 1e-6))]:
        off = np.angle(np.exp(1j * (azimuth - math.atan2(x, y))))
        corner = np.maximum(corner, 0.8 * np.exp(-0.5 * (off / 0.04) ** 2))
    spread = np.full(COLUMNS, sigma)
    return BoundaryEvidence(ceiling, floor, spread, spread.copy(), corner.astype(np.float32))


def classes_of(room: RoomModel) -> np.ndarray:
    planes = plane_map(room, Equirectangular(COLUMNS, COLUMNS // 2))
    index = np.where(planes == 0, SceneClass.FLOOR, np.where(planes == 1, SceneClass.CEILING, SceneClass.WALL))
    found = np.full((len(SceneClass), *planes.shape), 0.01, np.float32)
    np.put_along_axis(found, index[None].astype(np.intp), 0.93, axis=0)
    return found


def evidence_of(room: RoomModel, **errors: float) -> SceneEvidence:
    return SceneEvidence(classes_of(room), "made by hand", boundary_of(room, **errors))


def picture_of(values: np.ndarray) -> RelativeImage:
    shape = values.shape[:2]
    rgb = np.repeat(values[..., None], 3, axis=2).astype(np.float32)
    geometry = Equirectangular(shape[1], shape[0])
    return RelativeImage(rgb, np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), geometry)


def painted(room: RoomModel, width: int = 512) -> RelativeImage:
    """The room with every plane of another brightness, four samples a pixel."""
    fine = Equirectangular(2 * width, width)
    planes = plane_map(room, fine)
    tones = np.array([20.0, 90.0, *(45.0 + 8.0 * (k % 3) for k in range(len(room.floor)))])
    values = tones[planes].reshape(width // 2, 2, width, 2).mean(axis=(1, 3))
    return picture_of(values)
