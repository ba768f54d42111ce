"""Real rooms for removal: the paper authors' own example, with their layout, their target mask and their result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.shared_data import DATA
from processing.ground.arrays import Flags, Floats
from processing.ground.colour import linear_of_srgb, srgb_of_linear
from processing.ground.room_model import RoomModel
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular

WHITE_CD_M2 = 200.0
"""What 255 in an ordinary picture is taken for."""


def linear(srgb: npt.NDArray[Any]) -> Floats:
    """Return the light of an sRGB picture (h, w, 3) in OpenCV's order, as RGB; 1 is white."""
    return linear_of_srgb(srgb[..., ::-1])


def encoded(light: Floats) -> npt.NDArray[np.uint8]:
    """Return the sRGB picture (h, w, 3) in OpenCV's order of light where 1 is white."""
    return srgb_of_linear(light)[..., ::-1]


def image_of(rgb: Floats) -> LuminanceImage:
    """Return a panorama (h, 2h, 3) as a calibrated picture."""
    height, width = rgb.shape[:2]
    return LuminanceImage(
        rgb,
        np.full((height, width), 0.02, np.float32),
        np.zeros((height, width), np.uint8),
        Equirectangular(width, height),
        0.02,
    )


def annotated_room(path: Path) -> RoomModel:
    """Return the room of a PanoAnnotator layout; walls are those of its points in order."""
    data = json.loads(path.read_text("utf-8"))
    points = [p["xyz"] for p in data["layoutPoints"]["points"]]
    corners = [(round(float(p[0]), 6), round(-float(p[2]), 6)) for p in points]
    x, y = np.array(corners).T
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0:
        corners.reverse()
    return RoomModel(
        source="given",
        floor=tuple(corners),
        camera_height_m=data["cameraHeight"],
        ceiling_height_m=data["layoutHeight"],
    )


def penn_bed() -> tuple[LuminanceImage, RoomModel, Flags, npt.NDArray[np.uint8]]:
    """Return the example room, its layout, the authors' target mask and their emptied room (sRGB, same size)."""
    folder = DATA / "paper" / "penn_bed"
    panorama = cv2.imread(str(folder / "panorama.jpg"))
    size = panorama.shape[1::-1]
    target = cv2.resize(cv2.imread(str(folder / "authors_target_mask.jpg"), 0), size) > 100
    theirs = cv2.resize(cv2.imread(str(folder / "authors_empty_room.jpg")), size, interpolation=cv2.INTER_CUBIC)
    room = annotated_room(folder / "authors_layout.json")
    return image_of(linear(panorama) * WHITE_CD_M2), room, target, theirs
