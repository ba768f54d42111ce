"""Perspective views of a panorama: the mapping S of Ji et al. 2023, eq. 3, I = S(panorama; FOV, theta, phi, h, w).

Views are cut fast: the maps are kept, OpenCV's remap does the work on all cores, the seam costs nothing and the few
pixels at a pole are set right after it. Where light must be kept, use method ``area``. The inverse is in
`processing.views_stitch`.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.resampling import LARGEST_PX, resample
from processing.resampling_linear import linear_samples
from processing.sphere import Equirectangular, Perspective
from processing.views_maps import CutMap, cut_map

Picture = npt.NDArray[Any]
"""Of one of `DEPTHS`."""
ViewMethod = Literal["linear", "cubic", "area"]

DEPTHS = (np.uint8, np.uint16, np.float32)
HALVE_ABOVE = 2.5
"""Panorama pixels to a view's pixel from which a halved panorama is sampled; linear sampling spans two pixels."""


class Panorama:
    """An equirectangular picture (H, W) or (H, W, C), uint8, uint16 or float32, with halved copies made when needed.

    Wrap a picture of which many views are cut, so that it is halved once.
    """

    def __init__(self, picture: Picture, *, yaw_rad: float = 0.0) -> None:
        if picture.ndim not in (2, 3) or picture.dtype not in DEPTHS or not picture.size:
            raise ParameterError(
                f"a panorama of shape {picture.shape} and type {picture.dtype}",
                advice="give (H, W) or (H, W, C) of uint8, uint16 or float32",
            )
        if max(picture.shape[:2]) > LARGEST_PX:
            raise ParameterError(f"a panorama of {picture.shape[1]} px", advice=f"give at most {LARGEST_PX}")
        self.picture = picture
        self.geometry = Equirectangular(picture.shape[1], picture.shape[0], yaw_rad)

    @cached_property
    def half(self) -> Panorama:
        """Return this picture at half the size, by area."""
        size = max(1, self.geometry.width_px // 2), max(1, self.geometry.height_px // 2)
        smaller: Picture = cv2.resize(self.picture, size, interpolation=cv2.INTER_AREA)
        return Panorama(smaller, yaw_rad=self.geometry.yaw_rad)

    def for_view(self, view: Perspective) -> Panorama:
        """Return the copy whose pixels fit a view's: at most `HALVE_ABOVE` of them to one in its middle."""
        ratio = self.geometry.height_px / math.pi / view.focal_px
        return self if ratio < HALVE_ABOVE or min(self.picture.shape[:2]) < 4 else self.half.for_view(view)


def view_at(*, fov_rad: float, theta_rad: float, phi_rad: float, height_px: int, width_px: int) -> Perspective:
    """Return the view of eq. 3: horizontal field, longitude theta, latitude phi, height and width."""
    return Perspective(width_px, height_px, fov_rad, yaw_rad=theta_rad, pitch_rad=phi_rad)


def cut_view(panorama: Panorama | Picture, view: Perspective, *, method: ViewMethod = "linear") -> Picture:
    """Return what a view sees of a panorama, (h, w) or (h, w, C), of the panorama's type.

    ``linear``: fast; positions are exact for float32 and good to 1/64 pixel for the others. ``cubic``: smoother, float
    arithmetic. ``area``: keeps energy (`processing.resampling`). A picture without `Panorama` has its middle at
    longitude 0.
    """
    whole = panorama if isinstance(panorama, Panorama) else Panorama(panorama)
    if method == "linear":
        level = whole.for_view(view)
        fixed = level.picture.dtype != np.float32
        return _remapped(level.picture, cut_map(level.geometry, view, fixed=fixed))
    if method not in ("cubic", "area"):
        raise ParameterError(f"no view method {method!r}", advice="choose linear, cubic or area")
    level = whole.for_view(view) if method == "cubic" else whole
    found, _ = resample(level.picture, level.geometry, view, method=method)
    if whole.picture.dtype == np.float32:
        return found
    most = np.iinfo(whole.picture.dtype).max
    rounded: Picture = np.clip(np.rint(found), 0, most).astype(whole.picture.dtype)
    return rounded


def _remapped(picture: Picture, maps: CutMap) -> Picture:
    if picture.dtype == np.float32:
        view: Picture = linear_samples(picture, maps.first, maps.second, cv2.BORDER_WRAP)
    else:
        view = cv2.remap(picture, maps.first, maps.second, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        view = view.reshape(*view.shape[:2], *picture.shape[2:])
    polar = maps.polar
    if polar is not None:
        corners = picture[polar.rows, polar.columns].astype(np.float64)
        weights = polar.weights if picture.ndim == 2 else polar.weights[..., None]
        value = (corners * weights).sum(axis=1)
        view[polar.view_rows, polar.view_columns] = value if picture.dtype == np.float32 else np.rint(value)
    return view


def view_ring(
    count: int, *, size_px: int, fov_rad: float, pitch_rad: float = 0.0, yaw_rad: float = 0.0
) -> tuple[Perspective, ...]:
    """Return ``count`` square views at one pitch, evenly around from ``yaw_rad`` to the right."""
    if count < 1:
        raise ParameterError(f"a ring of {count} views", advice="give at least 1")
    yaws = (yaw_rad + 2 * math.pi * k / count for k in range(count))
    return tuple(
        Perspective(size_px, size_px, fov_rad, yaw_rad=math.remainder(yaw, 2 * math.pi), pitch_rad=pitch_rad)
        for yaw in yaws
    )


def covering_views(*, size_px: int, fov_rad: float, overlap: float = 0.25) -> tuple[Perspective, ...]:
    """Return square views in rings from nadir to zenith that together see everything, neighbours overlapping.

    ``fov_rad`` from 30 to 120 degrees; ``overlap`` 0.2..0.7 is the share of a view's field that a neighbour repeats.
    """
    if not (math.radians(30) <= fov_rad <= math.radians(120) + 1e-9 and 0.2 <= overlap <= 0.7):
        raise ParameterError(
            f"a covering of {math.degrees(fov_rad):.1f} degrees with overlap {overlap}",
            advice="give a field of 30 to 120 degrees and an overlap of 0.2 to 0.7",
        )
    step = fov_rad * (1 - overlap)
    rings = max(2, math.ceil(math.pi / step)) + 1
    views: list[Perspective] = []
    for pitch in np.linspace(-math.pi / 2, math.pi / 2, rings):
        # The ring's widest circle that this ring must cover lies half a step towards the equator.
        circle = math.cos(max(abs(pitch) - math.pi / (rings - 1) / 2, 0.0))
        alone = abs(pitch) > math.pi / 2 - 1e-9
        count = 1 if alone else max(3, math.ceil(2 * math.pi * circle / step))
        views += view_ring(count, size_px=size_px, fov_rad=fov_rad, pitch_rad=float(pitch))
    return tuple(views)
