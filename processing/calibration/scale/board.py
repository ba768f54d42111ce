"""Finding the white meter board in a panorama: an even, neutral, four-cornered region that is brighter than around it.

A rule of thumb made of measures, each between 0 and 1 and multiplied: what it finds is a proposal with a confidence,
taken where nobody recorded where the meter looked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.errors import ScaleError
from processing.ground.arrays import Doubles, Flags, Floats, Int32s
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular

MIN_CONFIDENCE = 0.25  # chosen
_WORK_WIDTH_PX = 840  # chosen
_STEPS_STOPS = (0.03, 0.06, 0.10)
"""Between neighbours of one even surface, more is an edge: a dim board before a white wall needs the least."""
_MIN_SR, _MAX_SR = 6e-4, 0.35
"""From a sheet of paper at 5 m to half a metre at 0.9 m."""
_MAX_LATITUDE_RAD = math.radians(60)  # chosen: nobody puts it on floor or ceiling
_MIN_PX = 9  # chosen
_NEAR_RAD = math.radians(12)  # chosen


@dataclass(frozen=True)
class Board:
    """A board that was found: the direction of its middle, its solid angle, and how sure it is."""

    longitude_rad: float
    latitude_rad: float
    solid_angle_sr: float
    confidence: float
    """0 .. 1: product of the measures."""
    measures: dict[str, float]


@dataclass(frozen=True)
class _Scene:
    """A reduced panorama, extended to the right by a quarter so that the seam cuts no board."""

    level: Floats
    """log2 luminance."""
    chroma: Floats
    """Distance from neutral, in log2 of red and blue over green."""
    usable: Flags
    width_px: int
    usual_level: float
    """Median level."""


def find_board(image: RelativeImage, near: tuple[float, float] | None = None) -> Board:
    """Return the likeliest white board of an equirectangular picture; ``near`` (longitude, latitude) favours a place.

    Raises
    ------
    ScaleError
        Nothing looks like a board, or the picture is no panorama.
    """
    if not isinstance(image.geometry, Equirectangular):
        raise ScaleError("the board is looked for in panoramas only", advice="give the target's direction")
    scene = _reduced(image)
    boards = [board for step in _STEPS_STOPS for board in _boards(scene, step, image.geometry, near)]
    best = max(boards, key=lambda board: board.confidence, default=None)
    if best is None or best.confidence < MIN_CONFIDENCE:
        sure = "" if best is None else f" (the best guess has a confidence of {best.confidence:.0%})"
        raise ScaleError(
            f"no white board was found{sure}",
            where="the panorama",
            likely="no board, a small one, or one that is lit unevenly",
            advice="say where the meter looked: --target LON,LAT in degrees",
        )
    return best


def _boards(
    scene: _Scene, step_stops: float, geometry: Equirectangular, near: tuple[float, float] | None
) -> Iterator[Board]:
    """Yield every even region that can be a board at all."""
    labels, areas = _even_regions(scene, step_stops)
    for number in np.flatnonzero(areas >= _MIN_PX):
        board = _judged(scene, labels, int(number), geometry, near) if number else None
        if board is not None:
            yield board


def _reduced(image: RelativeImage) -> _Scene:
    import cv2

    high, wide = image.validity.shape
    step = max(1, math.ceil(wide / _WORK_WIDTH_PX))
    size = (wide // step, high // step)
    rgb = np.maximum(cv2.resize(image.rgb, size, interpolation=cv2.INTER_AREA), np.float32(1e-12))
    good = cv2.resize((image.validity == Validity.VALID).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    extra = size[0] // 4
    rgb = np.concatenate([rgb, rgb[:, :extra]], axis=1)
    logs = np.log2(rgb)
    red, blue = logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]
    return _Scene(
        level=np.asarray(cv2.medianBlur(np.log2(luminance_cd_m2(rgb)), 3), dtype=np.float32),
        chroma=np.hypot(red, blue).astype(np.float32),
        usable=np.concatenate([good, good[:, :extra]], axis=1),
        width_px=size[0],
        usual_level=float(np.median(np.log2(luminance_cd_m2(rgb)))),
    )


def _even_regions(scene: _Scene, step_stops: float) -> tuple[Int32s, Int32s]:
    """Return the connected regions without edges in them, numbered from 1, and their pixels."""
    import cv2

    across = np.abs(np.diff(scene.level, axis=1, append=scene.level[:, -1:]))
    down = np.abs(np.diff(scene.level, axis=0, append=scene.level[-1:]))
    even = ((np.maximum(across, down) < step_stops) & scene.usable).astype(np.uint8)
    whole = cv2.erode(even, np.ones((2, 2), np.uint8))
    _, labels, facts, _ = cv2.connectedComponentsWithStats(whole, connectivity=4)
    return np.asarray(labels, dtype=np.int32), np.asarray(facts[:, cv2.CC_STAT_AREA], dtype=np.int32)


def _judged(
    scene: _Scene, labels: Int32s, number: int, geometry: Equirectangular, near: tuple[float, float] | None
) -> Board | None:
    """Return the region as a board with its measures, None for what is far too small, too large, or too high."""
    rows, columns = np.nonzero(labels == number)
    if columns.min() >= scene.width_px or columns.max() == labels.shape[1] - 1:
        return None  # seen whole on the left, or cut off by the extension's end
    high = labels.shape[0]
    latitude = (0.5 - (rows + 0.5) / high) * math.pi
    longitude = ((columns + 0.5) / scene.width_px - 0.5) * 2 * math.pi
    pixel_sr = np.cos(latitude) * (math.pi / high) * (2 * math.pi / scene.width_px)
    solid_sr = float(pixel_sr.sum())
    middle = (float(np.average(longitude, weights=pixel_sr)), float(np.average(latitude, weights=pixel_sr)))
    if not _MIN_SR < solid_sr < _MAX_SR or abs(middle[1]) > _MAX_LATITUDE_RAD:
        return None
    u, v, area = _flattened(longitude - middle[0], latitude, middle[1], pixel_sr)
    measures = {
        **_shape_measures(u, v, float(area.sum())),
        "even": math.exp(-((float(scene.level[rows, columns].std()) / 0.25) ** 2)),
        "neutral": math.exp(-((float(np.median(scene.chroma[rows, columns])) / 0.9) ** 2)),
        "brighter": _brighter(scene, labels, number, rows, columns),
        "no window": 1 / (1 + math.exp((float(np.median(scene.level[rows, columns])) - scene.usual_level - 2.5) / 0.4)),
        "large": 1 - math.exp(-solid_sr / 0.012),
    }
    if near is not None:
        apart = math.hypot(math.remainder(middle[0] - near[0], 2 * math.pi) * math.cos(near[1]), middle[1] - near[1])
        measures["near"] = math.exp(-((apart / _NEAR_RAD) ** 2))
    way = math.remainder(middle[0] + geometry.yaw_rad, 2 * math.pi)
    return Board(way, middle[1], solid_sr, math.prod(measures.values()), measures)


def _flattened(
    longitude: Doubles, latitude: Doubles, centre_rad: float, pixel_sr: Doubles
) -> tuple[Doubles, Doubles, Doubles]:
    """Return gnomonic coordinates about (0, centre_rad), in which straight edges are straight, and pixel areas."""
    sine, cosine = math.sin(centre_rad), math.cos(centre_rad)
    ahead = np.maximum(sine * np.sin(latitude) + cosine * np.cos(latitude) * np.cos(longitude), 0.05)
    u = np.cos(latitude) * np.sin(longitude) / ahead
    v = (cosine * np.sin(latitude) - sine * np.cos(latitude) * np.cos(longitude)) / ahead
    return u, v, pixel_sr / ahead**3


def _shape_measures(u: Doubles, v: Doubles, area: float) -> dict[str, float]:
    """Return how full the region's hull is, how nearly that is a quadrilateral, and how nearly a square's shape."""
    import cv2

    points = np.stack([u, v], axis=1).astype(np.float32)
    hull = cv2.convexHull(points)
    hull_area = float(cv2.contourArea(hull))
    (_, _), sides, _ = cv2.minAreaRect(points)
    long_side, short_side = max(sides), min(sides)
    if hull_area <= 0 or short_side <= 0:
        return {"full": 0.0}
    outline = float(cv2.arcLength(hull, closed=True))
    corners = cv2.approxPolyDP(hull, 0.06 * outline, closed=True)
    four = float(cv2.contourArea(corners)) / hull_area if len(corners) == 4 else 0.3
    return {
        "full": min(1.0, area / hull_area) ** 4,
        "four corners": min(four, 1 / max(four, 1e-9)) ** 2,
        "square": math.exp(-((math.log(long_side / short_side) / 0.8) ** 2)),
    }


def _brighter(
    scene: _Scene, labels: Int32s, number: int, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]
) -> float:
    """Return how much brighter the region is than a ring around it; half at 0.15 stop."""
    import cv2

    reach = max(2, round(0.35 * math.sqrt(rows.size)))
    top, left = max(rows.min() - reach, 0), max(columns.min() - reach, 0)
    part = (slice(top, rows.max() + reach + 1), slice(left, columns.max() + reach + 1))
    mine = (labels[part] == number).astype(np.uint8)
    close = cv2.dilate(mine, np.ones((5, 5), np.uint8))
    ring = (cv2.dilate(mine, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0) & (close == 0)
    if not ring.any():
        return 0.0
    inside = float(np.median(scene.level[rows, columns]))
    gain = inside - float(np.median(scene.level[part][ring]))
    return 1 / (1 + math.exp(-(gain - 0.15) / 0.05))
