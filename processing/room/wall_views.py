"""What the camera sees of one wall, rectified: light, its gradients, and the evidence of what is there.

Places on a wall are (u, v) in metres of its `Plane`: u to the right, v down from the ceiling.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from processing.ground.arrays import Flags, Floats, Vector
from processing.ground.room_model import RoomModel
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.segmentation.evidence import SceneEvidence
from processing.sphere import Equirectangular, Geometry
from processing.surfaces.maps import FIRST_WALL, Plane, planes_of
from processing.surfaces.textures import unwrap

MOST_PX_PER_M, LEAST_PX_PER_M = 120.0, 30.0
LARGEST_TEXELS = 2_000_000  # chosen: 24 MB of float32 RGB
WIDEST_PX = 3360
"""Of the panorama that walls are taken from: all that `MOST_PX_PER_M` asks for where they are 4.5 m away or nearer."""
EDGE_STOPS = 0.25
"""A step in log2 luminance, over one texel, at which an edge counts half: faint and strong edges count nearly alike."""
LEAST_SEEN = 0.02  # share of a wall that must be seen


@dataclass(frozen=True)
class WallView:
    """One wall as a texture."""

    plane: Plane
    px_per_m: float
    log_luminance: Floats
    """(H, W): log2 of luminance over the room's median."""
    known: Flags
    """(H, W)."""
    share: Floats
    """(len(SceneClass), h, w): probabilities."""
    eye: Vector
    """The camera's (u, v) and its distance from the wall, m."""

    @property
    def wall(self) -> int:
        """Return the number of the wall in the room."""
        return self.plane.index - FIRST_WALL

    @cached_property
    def edges(self) -> tuple[Floats, Floats]:
        """Return how clearly brightness rises at each texel (H, W), -1..1, from left to right and downwards."""
        soft = cv2.GaussianBlur(self.log_luminance, (0, 0), 0.8)
        out = []
        for dx, dy in ((1, 0), (0, 1)):
            step = cv2.Sobel(soft, cv2.CV_32F, dx, dy, ksize=3, scale=0.25, borderType=cv2.BORDER_REPLICATE)
            strength = step / (np.abs(step) + EDGE_STOPS)
            # The border of what is seen is no edge of the room.
            inside = cv2.erode(self.known.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            out.append(np.where(inside, strength, 0.0).astype(np.float32))
        return out[0], out[1]


def wall_views(image: RelativeImage | LuminanceImage, evidence: SceneEvidence, room: RoomModel) -> tuple[WallView, ...]:
    """Return the walls that the camera sees, of an upright equirectangular picture."""
    geometry = image.geometry
    assert isinstance(geometry, Equirectangular)
    luminance, outside = luminance_cd_m2(image.rgb), (image.validity == Validity.OUTSIDE).view(np.uint8)
    if luminance.shape[1] > WIDEST_PX:
        smaller = cv2.resize(luminance, (WIDEST_PX, WIDEST_PX // 2), interpolation=cv2.INTER_AREA)
        luminance = smaller.astype(np.float32, copy=False)
        outside = np.asarray(cv2.resize(outside, (WIDEST_PX, WIDEST_PX // 2), interpolation=cv2.INTER_AREA), np.uint8)
        geometry = replace(geometry, width_px=WIDEST_PX, height_px=WIDEST_PX // 2)
    shown = luminance[luminance > 0]
    middle = float(np.median(shown)) if shown.size else 1.0
    log = np.log2(luminance + np.float32(0.01 * middle)) - np.float32(math.log2(middle))
    hidden = outside > 0 if outside.any() else None
    found = (_wall_view(log, hidden, geometry, room, plane) for plane in planes_of(room)[FIRST_WALL:])
    return shown_by(evidence.probabilities, geometry, room, [view for view in found if view is not None])


def shown_by(shares: Floats, geometry: Geometry, room: RoomModel, views: Sequence[WallView]) -> tuple[WallView, ...]:
    """Return views of a picture of this geometry with these probabilities (len(SceneClass), h, w) of all it shows."""
    assert isinstance(geometry, Equirectangular)
    share = np.ascontiguousarray(np.moveaxis(shares, 0, -1), dtype=np.float32)
    coarse = Equirectangular(share.shape[1], share.shape[0], geometry.yaw_rad)
    classes = (unwrap(share, coarse, room, view.plane, view.px_per_m).values for view in views)
    return tuple(replace(view, share=np.moveaxis(one, -1, 0)) for view, one in zip(views, classes, strict=True))


def _wall_view(
    log: Floats, hidden: Flags | None, geometry: Equirectangular, room: RoomModel, plane: Plane
) -> WallView | None:
    to_eye = np.array([0.0, 0.0, room.camera_height_m]) - plane.origin_m
    eye = (float(to_eye @ plane.u_axis), float(to_eye @ plane.v_axis), float(to_eye @ plane.normal))
    if eye[2] <= 0.02:
        return None
    px_per_m = _px_per_m(geometry, eye, plane)
    light = unwrap(log, geometry, room, plane, px_per_m, mask=hidden)
    if light.known.mean() < LEAST_SEEN:
        return None
    return WallView(plane, px_per_m, light.values, light.known, np.empty((0, 0, 0), np.float32), eye)


def _px_per_m(geometry: Equirectangular, eye: Vector, plane: Plane) -> float:
    """Return the density at which the wall's best seen place has a texel for each pixel."""
    nearest = math.hypot(eye[2], max(0.0, -eye[0], eye[0] - plane.width_m))
    most = math.sqrt(LARGEST_TEXELS / max(plane.width_m * plane.height_m, 1e-6))
    best = geometry.width_px / (2 * math.pi) / max(nearest, 0.1)
    return float(np.clip(best, min(LEAST_PX_PER_M, most), min(MOST_PX_PER_M, most)))
