"""The chart in a panorama or a fisheye picture: perspective views towards where it may be (paper, section 3)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.calibration.scale.chart import find_chart
from processing.calibration.scale.chart_patches import FoundChart
from processing.errors import ChartError
from processing.ground.arrays import Doubles
from processing.pictures.images import RelativeImage, Validity
from processing.sphere import Equirectangular, Fisheye, Geometry, Perspective, directions, pixels, point_directions

_FOV_RAD = math.radians(75)
_MAX_PX = 1800
_SURE_MISMATCH = 0.12


@dataclass(frozen=True)
class ChartView:
    """A view with the chart in it."""

    view: RelativeImage
    chart: FoundChart


def cut(image: RelativeImage, view: Perspective) -> RelativeImage:
    """Return a perspective view of a picture: colours between pixels bilinearly, the rest of the nearest pixel."""
    import cv2

    ways, _ = directions(view)
    x, y, seen = pixels(image.geometry, ways)
    high, wide = image.validity.shape
    column, row = np.floor(np.where(seen, x, 0)).astype(np.intp), np.floor(np.where(seen, y, 0)).astype(np.intp)
    column, row = np.clip(column, 0, wide - 1), np.clip(row, 0, high - 1)
    border = cv2.BORDER_WRAP if isinstance(image.geometry, Equirectangular) else cv2.BORDER_REPLICATE
    at = ((np.where(seen, x, 0) - 0.5).astype(np.float32), (np.where(seen, y, 0) - 0.5).astype(np.float32))
    rgb = np.asarray(cv2.remap(image.rgb, *at, cv2.INTER_LINEAR, borderMode=border), dtype=np.float32)
    rgb[~seen] = 0
    return RelativeImage(
        rgb=rgb,
        uncertainty=np.where(seen, image.uncertainty[row, column], np.float32(np.inf)),
        validity=np.where(seen, image.validity[row, column], np.uint8(Validity.OUTSIDE)).astype(np.uint8),
        geometry=view,
    )


def find_chart_around(image: RelativeImage, towards: Doubles | None = None) -> ChartView:
    """Return the chart, looked for towards a direction first (where one is given), then all around.

    Raises
    ------
    ChartError
        No view shows a chart.
    """
    best: ChartView | None = None
    for view in _views(image.geometry, towards):
        picture = cut(image, view)
        try:
            found = ChartView(picture, find_chart(picture))
        except ChartError:
            continue
        if best is None or found.chart.mismatch < best.chart.mismatch:
            best = found
        if best.chart.mismatch < _SURE_MISMATCH:
            return best
    if best is None:
        raise ChartError(
            "no 24-patch chart was found anywhere in the picture",
            likely="it is too small, cut off, or in a strong reflection",
            advice="give its four corners: --corners SIDE:X,Y,X,Y,X,Y,X,Y in pixels of the frames",
        )
    return best


def chart_at(image: RelativeImage, corners_px: npt.ArrayLike) -> ChartView:
    """Return the chart whose corners are at four points (x, y) of the picture itself.

    Raises
    ------
    ChartError
        A corner outside the picture's field, or no chart there.
    """
    corners = np.asarray(corners_px, dtype=np.float64).reshape(-1, 2)
    ways, seen = point_directions(image.geometry, corners[:, 0], corners[:, 1])
    if len(corners) != 4 or not np.all(seen):
        raise ChartError("four corners inside the picture are needed", where="corners", advice="X,Y four times")
    middle = ways.mean(axis=0)
    reach = float(np.max(np.arccos(np.clip(ways @ (middle / np.linalg.norm(middle)), -1, 1))))
    view = _view(image.geometry, middle, min(2.6 * reach, math.radians(120)))
    x, y, _ = pixels(view, ways)
    picture = cut(image, view)
    return ChartView(picture, find_chart(picture, np.stack([x, y], axis=1)))


def _views(geometry: Geometry, towards: Doubles | None) -> Iterator[Perspective]:
    if towards is not None:
        yield _view(geometry, towards, _FOV_RAD)
        yield _view(geometry, towards, _FOV_RAD / 2)
    if isinstance(geometry, Perspective):
        yield geometry
        return
    rings = ((90, 1), (45, 6)) if isinstance(geometry, Fisheye) else ((0, 8), (40, 6), (-40, 6))
    for height_deg, count in rings:
        for turn in range(count):
            angle, height = 2 * math.pi * turn / count, math.radians(height_deg)
            flat = math.cos(height)
            yield _view(
                geometry, np.array((flat * math.sin(angle), flat * math.cos(angle), math.sin(height))), _FOV_RAD
            )


def _view(geometry: Geometry, towards: Doubles, fov_rad: float) -> Perspective:
    """Return a view as fine as the picture is, of 4:3."""
    if isinstance(geometry, Fisheye):
        pixel_rad = geometry.half_field_rad / geometry.radius_px / 1.1
    elif isinstance(geometry, Equirectangular):
        pixel_rad = 2 * math.pi / geometry.width_px
    else:
        pixel_rad = geometry.fov_x_rad / geometry.width_px
    wide = int(min(max(2 * math.tan(fov_rad / 2) / pixel_rad, 120), _MAX_PX))
    x, y, z = np.asarray(towards, dtype=np.float64) / np.linalg.norm(towards)
    return Perspective(wide, wide * 3 // 4, fov_rad, math.atan2(x, y), math.asin(float(np.clip(z, -1, 1))))
