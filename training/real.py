"""Real pictures with truth, for figures only: nothing was trained on them. Layouts of ZInD and hand-drawn masks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Floats
from processing.ground.colour import linear_of_srgb
from processing.pictures.images import RelativeImage
from processing.segmentation.embedded import WIDTH_PX
from processing.sphere import Equirectangular
from training.labels import boundary_latitudes

SEEN = 6
"""Of the ZInD panoramas, in order of their names: these may be looked at, the others are only scored."""


@dataclass(frozen=True)
class Layout:
    """A real panorama and its room, in camera heights."""

    name: str
    image: RelativeImage
    ceiling_rad: Floats
    floor_rad: Floats


def read_image(path: Path) -> RelativeImage:
    """Return an ordinary picture file as linear light."""
    codes = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if codes is None:
        raise FileNotFoundError(path)
    rgb = linear_of_srgb(np.ascontiguousarray(codes[..., ::-1]))
    height, width = rgb.shape[:2]
    unknown = np.full((height, width), 0.1, np.float32)
    return RelativeImage(rgb, unknown, np.zeros((height, width), np.uint8), Equirectangular(width, height))


def zind_layouts(folder: Path, key: str = "layout_raw") -> Iterator[Layout]:
    """Yield the panoramas of a ZInD tour with one of their layouts, in order of their names."""
    tour = json.loads((folder / "zind_data.json").read_text("utf-8"))
    found = {}
    for room in (r for floor in tour["merger"].values() for complete in floor.values() for r in complete.values()):
        found.update({Path(p["image_path"]).name: p for p in room.values()})
    for path in sorted(folder.glob("*.jpg")):
        pano = found.get(path.name)
        if pano is None or key not in pano:
            continue
        # ZInD's longitude is atan2(-x, y) with the floor at -1; ours is atan2(x, y).
        outline = np.array(pano[key]["vertices"], np.float64) * (-1, 1)
        ceiling = float(pano["ceiling_height"]) / float(pano["camera_height"])
        up, down = boundary_latitudes(outline, (0.0, 0.0), 1.0, ceiling, WIDTH_PX)
        yield Layout(path.stem, read_image(path), up, down)


def furniture_masks(folder: Path) -> Iterator[tuple[str, RelativeImage, Bytes]]:
    """Yield pictures with hand-drawn masks (H, W) (255 furniture, 128 not judged, 64 tripod)."""
    for mask_path in sorted(folder.glob("*_mask.png")):
        mask = cv2.imread(str(mask_path), cv2.IMREAD_GRAYSCALE)
        if mask is not None:
            yield mask_path.stem, read_image(folder / mask_path.name.replace("_mask", "")), mask.astype(np.uint8)
