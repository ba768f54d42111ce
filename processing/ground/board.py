"""The meter's white board in a panorama: an even, neutral, four-cornered region that is brighter than around it.

`find_board` searches the whole panorama where nobody recorded where the meter looked: rules of thumb, each a measure
between 0 and 1, are multiplied into a confidence, and the result is a proposal. A board at a place that is known is
marked by `known_board`.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from processing.errors import ScaleError
from processing.ground.arrays import Doubles, Flags, Floats, Indices, Int32s
from processing.ground.seam import row_latitudes, wrapped

STEPS_STOPS = (0.03, 0.06, 0.10)
"""Between neighbouring pixels of one even surface, more is an edge: a dim board before a white wall needs the least.
Chosen on the simulated rooms."""
LEAST_SR, MOST_SR = 6e-4, 0.35
"""Solid angle of a board: from a sheet of A4 paper at 5 m to a square of half a metre at 0.9 m."""
MOST_LATITUDE_RAD = math.radians(60)  # chosen: a board on a stand is metered from about its own height
MIN_CONFIDENCE = 0.25  # chosen on the simulated rooms: below, a lamp or a picture is as likely
WORK_WIDTH_PX = 840  # width to which a panorama is reduced for the search: the smallest board is then 13 pixels large
LEAST_PX = 9  # pixels of a bright region; chosen, never swept
LEAST_AHEAD = 0.05  # cosine of the angle from the region's middle at which the tangent plane is cut off


@dataclass(frozen=True)
class Board:
    """A board: the direction of its middle (rad), and how likely it is one (0..1)."""

    longitude_rad: float
    latitude_rad: float
    confidence: float


@dataclass(frozen=True)
class _Scene:
    """A reduced panorama (H, W), continued to the right by a quarter so that the seam cuts no board."""

    level: Floats
    """log2 luminance."""
    chroma: Floats
    """Distance from neutral, in log2 of red and blue over green."""
    usable: Flags
    width_px: int
    """Without the continuation."""
    usual_level: float
    """Median level."""


def find_board(rgb: Floats, luminance: Floats, usable: Flags) -> Board:
    """Return the likeliest white board of a whole panorama, longitude 0 in its middle column.

    ``rgb`` (H, W, 3) and its ``luminance`` (H, W), linear, any scale, W = 2 H; only ``usable`` pixels (H, W) can belong
    to a board. Raises `ScaleError` where nothing looks like one.
    """
    scene = _reduced(rgb, luminance, usable)
    boards = [board for step in STEPS_STOPS for board in _boards(scene, step)]
    best = max(boards, key=lambda board: board.confidence, default=None)
    if best is None or best.confidence < MIN_CONFIDENCE:
        sure = "" if best is None else f" (the best guess has a confidence of {best.confidence:.0%})"
        likely = "no board, a small one, or one lit unevenly"
        advice = "give the meter's target: --target LON,LAT in degrees"
        raise ScaleError(f"no white board was found{sure}", where="the panorama", likely=likely, advice=advice)
    return best


def on_tangent_plane(longitude: Doubles, latitude: Doubles, centre_rad: float) -> tuple[Doubles, Doubles, Doubles]:
    """Return gnomonic coordinates u, v about (0, centre), in which straight edges are straight, and the cosine from it.

    ``longitude``, ``latitude`` (rad) broadcast, (N,) or (1, W) and (H, 1); results have their common shape.
    Snyder, Map Projections (1987), eq. 22-4 and 22-5. An area there is the solid angle over the cubed cosine.
    """
    sine, cosine = math.sin(centre_rad), math.cos(centre_rad)
    ahead = sine * np.sin(latitude) + cosine * np.cos(latitude) * np.cos(longitude)
    ahead = np.maximum(ahead, LEAST_AHEAD)
    u = np.cos(latitude) * np.sin(longitude) / ahead
    v = (cosine * np.sin(latitude) - sine * np.cos(latitude) * np.cos(longitude)) / ahead
    return u, v, ahead


def _reduced(rgb: Floats, luminance: Floats, usable: Flags) -> _Scene:
    high, wide = usable.shape
    step = max(1, math.ceil(wide / WORK_WIDTH_PX))
    size = (wide // step, high // step)
    small = np.maximum(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.float32(1e-12))
    light = np.maximum(cv2.resize(luminance, size, interpolation=cv2.INTER_AREA), np.float32(1e-12))
    good = cv2.resize(usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    extra = size[0] // 4
    small, light, good = (wrapped(one, extra)[:, extra:] for one in (small, light, good))
    logs, level = np.log2(small), np.log2(light)
    chroma = np.hypot(logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1])
    return _Scene(np.asarray(cv2.medianBlur(level, 3), np.float32), chroma, good, size[0], float(np.median(level)))


def _boards(scene: _Scene, step_stops: float) -> Iterator[Board]:
    """Yield each even region that can be a board at all, with the confidence that it is one."""
    # The pixels that differ from their right and lower neighbours by less than a step
    across = np.abs(np.diff(scene.level, axis=1, append=scene.level[:, -1:]))
    down = np.abs(np.diff(scene.level, axis=0, append=scene.level[-1:]))
    like = (np.maximum(across, down) < step_stops) & scene.usable
    even = cv2.erode(like.astype(np.uint8), np.ones((2, 2), np.uint8))
    _, labels, facts, _ = cv2.connectedComponentsWithStats(even, connectivity=4)
    for number in np.flatnonzero(facts[:, cv2.CC_STAT_AREA] >= LEAST_PX):
        board = _judged(scene, np.asarray(labels, np.int32), int(number)) if number else None
        if board is not None:
            yield board


def _judged(scene: _Scene, labels: Int32s, number: int) -> Board | None:
    """Return a region as a board with its confidence; None for what is far too small, too large, or too high.

    Widths of the measures (0.25 stop uneven, 0.9 from neutral, 2.5 stops above the median as a window is, 0.012 sr)
    are chosen on the simulated rooms."""
    rows, columns = np.nonzero(labels == number)
    if columns.min() >= scene.width_px or columns.max() == labels.shape[1] - 1:
        return None  # seen whole on the left, or cut off where the continuation ends
    high = labels.shape[0]
    latitude, longitude = row_latitudes(high)[rows], ((columns + 0.5) / scene.width_px - 0.5) * 2 * math.pi
    pixel_sr = np.cos(latitude) * (math.pi / high) * (2 * math.pi / scene.width_px)
    solid_sr = float(pixel_sr.sum())
    middle = (float(np.average(longitude, weights=pixel_sr)), float(np.average(latitude, weights=pixel_sr)))
    if not LEAST_SR < solid_sr < MOST_SR or abs(middle[1]) > MOST_LATITUDE_RAD:
        return None
    u, v, ahead = on_tangent_plane(longitude - middle[0], latitude, middle[1])
    level = scene.level[rows, columns]
    bright = float(np.median(level))
    measures = (
        _shape_measure(u, v, float((pixel_sr / ahead**3).sum())),
        math.exp(-((float(level.std()) / 0.25) ** 2)),
        math.exp(-((float(np.median(scene.chroma[rows, columns])) / 0.9) ** 2)),
        _brighter(scene, labels, number, rows, columns),
        1 / (1 + math.exp((bright - scene.usual_level - 2.5) / 0.4)),
        1 - math.exp(-solid_sr / 0.012),
    )
    return Board(math.remainder(middle[0], 2 * math.pi), middle[1], math.prod(measures))


def _shape_measure(u: Doubles, v: Doubles, area: float) -> float:
    """Return how full the region's hull is, times how nearly a quadrilateral and how nearly as wide as high it is."""
    points = np.stack([u, v], axis=1).astype(np.float32)
    hull = cv2.convexHull(points)
    hull_area = float(cv2.contourArea(hull))
    _, sides, _ = cv2.minAreaRect(points)
    if hull_area <= 0 or min(sides) <= 0:
        return 0.0
    corners = cv2.approxPolyDP(hull, 0.06 * float(cv2.arcLength(hull, closed=True)), closed=True)
    four = float(cv2.contourArea(corners)) / hull_area if len(corners) == 4 else 0.3
    square = math.exp(-((math.log(max(sides) / min(sides)) / 0.8) ** 2))
    return min(1.0, area / hull_area) ** 4 * min(four, 1 / max(four, 1e-9)) ** 2 * square


def _brighter(scene: _Scene, labels: Int32s, number: int, rows: Indices, columns: Indices) -> float:
    """Return how much brighter the region is than a ring around it, 0..1; half at 0.15 stop."""
    reach = max(2, round(0.35 * math.sqrt(rows.size)))
    top, left = max(rows.min() - reach, 0), max(columns.min() - reach, 0)
    part = (slice(top, rows.max() + reach + 1), slice(left, columns.max() + reach + 1))
    mine = (labels[part] == number).astype(np.uint8)
    close = cv2.dilate(mine, np.ones((5, 5), np.uint8))
    ring = (cv2.dilate(mine, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0) & (close == 0)
    if not ring.any():
        return 0.0
    gain = float(np.median(scene.level[rows, columns])) - float(np.median(scene.level[part][ring]))
    return 1 / (1 + math.exp(-(gain - 0.15) / 0.05))
