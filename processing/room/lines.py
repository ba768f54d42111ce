"""Straight edges all around a panorama: line segments of perspective views, as arcs of great circles.

A straight edge of the room is an arc of a great circle in the panorama, whatever its tilt, and a straight line in a
perspective view. The views overlap; a segment counts in the view whose axis is nearest to its middle, and nowhere else.
"""

from __future__ import annotations

from processing.ground.arrays import Bytes, Doubles, Floats

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processing.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Perspective, point_directions, view_axes
from processing.views import Panorama, covering_views, cut_view


WIDEST_PX = 2048
"""Larger panoramas are reduced to this width by area: lines of 1/600 of the picture's width are found there."""
VIEW_FOV_RAD = math.radians(75)
OVERLAP = 0.3
CONTRAST_STOPS = 2.5
"""Of local contrast in the tone-mapped copy, from black to white."""
SURROUND_RAD = math.radians(12)
DARK_SHARE = 0.02
"""Of the median luminance: what is darker is noise, and is not stretched."""
SHORTEST_RAD = math.radians(1.2)
END_ERROR_PX = 0.5
"""Standard error of a segment's end across the segment, in pixels of the reduced picture (measured on flat edges)."""


@dataclass(frozen=True)
class Arcs:
    """Line segments on the sphere, in the axes of the panorama's world."""

    ends: Doubles
    """(n, 2, 3), unit directions."""
    normals: Doubles
    """(n, 3), unit: of the great circle through both ends."""
    length_rad: Doubles
    """(n,)."""
    sigma_rad: Doubles
    """(n,): standard error of the great circle's direction."""

    @property
    def middles(self) -> Doubles:
        """Return the unit directions (n, 3) of the arcs' middles."""
        total = self.ends.sum(axis=1)
        return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))


def tone_mapped(image: RelativeImage | LuminanceImage) -> Bytes:
    """Return an 8-bit grey copy (h, w) in which edges of sunny and of dim parts have like contrast.

    Log luminance against its surround, `CONTRAST_STOPS` from black to white. All black or constant: mid-grey.
    """
    grey = reduced(luminance_cd_m2(image.rgb))
    height, width = grey.shape
    valid = image.validity != Validity.OUTSIDE
    shown = grey[grey > 0]
    floor = DARK_SHARE * float(np.median(shown)) if shown.size and valid.any() else 1.0
    log = np.log2(grey + np.float32(max(floor, 1e-30)))
    # A box along a row of the sphere grows towards the poles; the blur need not be the same everywhere.
    size = max(3, round(SURROUND_RAD / math.pi * height)) | 1
    wrapped = cv2.copyMakeBorder(log, 0, 0, size, size, cv2.BORDER_WRAP)
    surround = cv2.blur(wrapped, (size, size), borderType=cv2.BORDER_REFLECT)[:, size : size + width]
    stretched = 127.5 + (log - surround) * (255 / CONTRAST_STOPS)
    return np.asarray(np.clip(stretched, 0, 255), dtype=np.uint8)


def reduced(grey: Floats, widest_px: int = WIDEST_PX) -> Floats:
    """Return a picture (H, W) at most ``widest_px`` wide, by area."""
    height, width = grey.shape
    if width <= widest_px:
        return grey
    smaller = cv2.resize(grey, (widest_px, max(1, round(height * widest_px / width))), interpolation=cv2.INTER_AREA)
    return np.asarray(smaller, dtype=np.float32)


def find_arcs(image: RelativeImage | LuminanceImage) -> Arcs:
    """Return the straight edges of an equirectangular picture; none where it is black or constant."""
    grey = tone_mapped(image)
    panorama = Panorama(grey, yaw_rad=getattr(image.geometry, "yaw_rad", 0.0))
    size_px = max(32, round(2 * math.tan(VIEW_FOV_RAD / 2) * grey.shape[1] / (2 * math.pi)))
    views = covering_views(size_px=size_px, fov_rad=VIEW_FOV_RAD, overlap=OVERLAP)
    axes = np.array([view_axes(view)[2] for view in views])
    found = [_of_view(panorama, view) for view in views]
    kept = [ends[_nearest(ends, axes) == i] for i, ends in enumerate(found)]
    return arcs_of(np.concatenate(kept), math.pi / grey.shape[0])


def arcs_of(ends: Doubles, pixel_rad: float) -> Arcs:
    """Return arcs through pairs of directions (n, 2, 3), found with pixels of a size; too short ones are dropped."""
    normals = np.cross(ends[:, 0], ends[:, 1])
    sine = np.linalg.norm(normals, axis=1)
    length = np.arctan2(sine, (ends[:, 0] * ends[:, 1]).sum(axis=1))
    ok = length >= max(SHORTEST_RAD, 4 * pixel_rad)
    sigma = END_ERROR_PX * pixel_rad * math.sqrt(2) / np.maximum(np.sin(np.minimum(length, math.pi / 2)), 1e-9)
    return Arcs(ends[ok], normals[ok] / sine[ok, None], length[ok], sigma[ok])


def _of_view(panorama: Panorama, view: Perspective) -> Doubles:
    """Return the ends (n, 2, 3) of one view's segments."""
    picture = cut_view(panorama, view)
    if picture.min() == picture.max():
        return np.empty((0, 2, 3))
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    segments = detector.detect(picture)[0]
    if segments is None or not len(segments):
        return np.empty((0, 2, 3))
    # OpenCV 5 gives (n, 4), earlier ones (n, 1, 4). Its coordinates count from the first pixel's centre.
    flat = np.asarray(segments, dtype=np.float64).reshape(-1, 4) + 0.5
    directions, _ = point_directions(view, flat[:, 0::2], flat[:, 1::2])
    return directions


def _nearest(ends: Doubles, axes: Doubles) -> npt.NDArray[np.intp]:
    return np.asarray((ends.sum(axis=1) @ axes.T).argmax(axis=1))
