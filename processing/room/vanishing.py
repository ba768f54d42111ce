"""The three axes of a room from its straight edges: where on the sphere parallel edges meet.

An edge parallel to an axis lies on a great circle that goes through the axis: its normal is square to it. The axes are
searched for (a vertical near the zenith from pairs of arcs, then an azimuth), judged by all arcs together, and refined
by weighted least squares on the rotation. What is left out sector by sector shows how far the answer may be off.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Doubles, Floats
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Perspective, point_directions, view_axes
from processing.sphere.views import Panorama, covering_views, cut_view

# Straight edges all around a panorama: line segments of perspective views, as arcs of great circles.
#
# A straight edge of the room is an arc of a great circle in the panorama, whatever its tilt, and a straight line in a
# perspective view. The views overlap; a segment counts in the view whose axis is nearest to its middle, and nowhere
# else.

WIDEST_PX = 2048
"""Larger panoramas are reduced to this width by area: lines of 1/600 of the picture's width are found there."""
VIEW_FOV_RAD = math.radians(75)
OVERLAP = 0.3  # of neighbouring views; chosen, never swept
CONTRAST_STOPS = 2.5  # of local contrast in the tone-mapped copy, from black to white
SURROUND_RAD = math.radians(12)
DARK_SHARE = 0.02  # of the median luminance: what is darker is noise, and is not stretched
SHORTEST_RAD = math.radians(1.2)
END_ERROR_PX = 0.5
"""Standard error of a segment's end across the segment, in pixels of the reduced picture (measured on flat edges)."""


@dataclass(frozen=True)
class Arcs:
    """Line segments on the sphere, in the axes of the panorama's world."""

    ends: Doubles
    """(N, 2, 3), unit directions."""
    normals: Doubles
    """(N, 3), unit: of the great circle through both ends."""
    length_rad: Doubles
    """(N,)."""
    sigma_rad: Doubles
    """(N,): standard error of the great circle's direction."""

    @property
    def middles(self) -> Doubles:
        """Return the unit directions (N, 3) of the arcs' middles."""
        total = self.ends.sum(axis=1)
        return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))


def tone_mapped(image: RelativeImage | LuminanceImage) -> Bytes:
    """Return an 8-bit grey copy (H, W) in which edges of sunny and of dim parts have like contrast.

    Log luminance against its surround, `CONTRAST_STOPS` from black to white. All black or constant: mid-grey. Raises
    `ParameterError`: values that are not finite.
    """
    grey = reduced(luminance_cd_m2(image.rgb))
    if not np.isfinite(grey).all():
        raise ParameterError("a picture with NaN or Inf", advice="set such pixels to 0 and mark them invalid")
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
    """Return the straight edges of an equirectangular picture but short ones; none where it is black or constant."""
    grey = tone_mapped(image)
    panorama = Panorama(grey, yaw_rad=getattr(image.geometry, "yaw_rad", 0.0))
    size_px = max(32, round(2 * math.tan(VIEW_FOV_RAD / 2) * grey.shape[1] / (2 * math.pi)))
    views = covering_views(size_px=size_px, fov_rad=VIEW_FOV_RAD, overlap=OVERLAP)
    axes = np.array([view_axes(view)[2] for view in views])
    found = [_of_view(panorama, view) for view in views]
    kept = [ends[(ends.sum(axis=1) @ axes.T).argmax(axis=1) == i] for i, ends in enumerate(found)]
    ends, pixel_rad = np.concatenate(kept), math.pi / grey.shape[0]
    normals = np.cross(ends[:, 0], ends[:, 1])
    sine = np.linalg.norm(normals, axis=1)
    length = np.arctan2(sine, (ends[:, 0] * ends[:, 1]).sum(axis=1))
    ok = length >= max(SHORTEST_RAD, 4 * pixel_rad)
    sigma = END_ERROR_PX * pixel_rad * math.sqrt(2) / np.maximum(np.sin(np.minimum(length, math.pi / 2)), 1e-9)
    return Arcs(ends[ok], normals[ok] / sine[ok, None], length[ok], sigma[ok])


def _of_view(panorama: Panorama, view: Perspective) -> Doubles:
    """Return the ends (N, 2, 3) of one view's segments."""
    picture = cut_view(panorama, view)
    even = picture.min() == picture.max()
    segments = None if even else cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(picture)[0]
    if segments is None or not len(segments):
        return np.empty((0, 2, 3))
    # OpenCV 5 gives (n, 4), earlier ones (n, 1, 4). Its coordinates count from the first pixel's centre.
    flat = np.asarray(segments, dtype=np.float64).reshape(-1, 4) + 0.5
    directions, _ = point_directions(view, flat[:, 0::2], flat[:, 1::2])
    return directions


MOST_TILT_RAD = math.radians(40)
"""Of the camera: beyond 45 degrees nothing distinguishes the vertical from the walls' horizontals."""
SEARCH_RAD, FINE_RAD = math.radians(1.2), math.radians(0.5)
"""How far edges of a real room may be off their axis: while searching, and at the end."""
LONGEST_RAD = math.radians(40)  # an arc counts by its length, up to this
PAIRS, KEPT, FEWEST = 1500, 8, 12  # pairs drawn for the vertical, candidates looked at closely, fewest arcs
AZIMUTH_STEPS = 120  # 0.75 degrees each; chosen, never swept
SECTORS = 12  # of 30 degrees, left out in turn (jackknife); chosen, never swept
APART_RAD = math.radians(1.5)
TILT_COST = 0.3  # of merit, for one radian of tilt, squared


@dataclass(frozen=True)
class Axes:
    """The axes that most edges obey."""

    rows: Doubles
    """(3, 3): right-handed, two horizontal axes and the vertical, in the panorama's world."""
    covariance: Doubles
    """(3, 3): of small turns (rad) about the three axes."""
    excess: Doubles
    """(3,): what share of the length of all arcs lies along each axis, beyond what would by chance."""
    length_rad: float
    """Of all arcs, those too short to show an axis discounted."""


def find_axes(arcs: Arcs, *, most_tilt_rad: float = MOST_TILT_RAD) -> Axes | None:
    """Return the three axes, or None where fewer than `FEWEST` arcs are there."""
    if len(arcs.length_rad) < FEWEST:
        return None
    worth = np.minimum(arcs.length_rad, LONGEST_RAD)
    candidates = _verticals(arcs, worth, most_tilt_rad)
    started = [_refined(arcs, worth, _with_azimuth(arcs, worth, one), SEARCH_RAD, 8) for one in candidates]
    rows = max(started, key=lambda one: _merit(arcs, worth, one))
    for spread in (0.8 * SEARCH_RAD, FINE_RAD):
        rows = _refined(arcs, worth, rows, spread, 8)
    rows = _canonical(rows)
    # The covariance of turns about the axes: all arcs of a sector around the vertical are left out in turn
    seen = arcs.middles @ rows.T
    around = np.arctan2(seen[:, 0], seen[:, 1]) / (2 * math.pi) + 0.5
    sector = np.minimum((around * SECTORS).astype(np.intp), SECTORS - 1)
    turns = []
    for left_out in range(SECTORS):
        kept = np.where(sector == left_out, 0.0, worth)
        turns.append(rows @ rotation_vector(_refined(arcs, kept, rows, FINE_RAD, 3).T @ rows))
    off = np.array(turns) - np.mean(turns, axis=0)
    return Axes(rows, np.asarray((SECTORS - 1) / SECTORS * off.T @ off), *_excess(arcs, worth, rows, FINE_RAD))


def _spread(arcs: Arcs, of_room_rad: float) -> Doubles:
    return np.hypot(arcs.sigma_rad, of_room_rad)


def _verticals(arcs: Arcs, worth: Doubles, most_tilt_rad: float) -> Doubles:
    """Return up to `KEPT` directions (K, 3) through which many arcs go, none near another, and the zenith itself."""
    steep = np.flatnonzero(np.abs(arcs.normals[:, 2]) < math.sin(most_tilt_rad))
    zenith = np.array([[0.0, 0.0, 1.0]])
    if steep.size < 2:
        return zenith
    one, other = np.random.default_rng(7).choice(steep, (2, PAIRS), p=worth[steep] / worth[steep].sum())
    crossing = np.cross(arcs.normals[one], arcs.normals[other])
    size = np.linalg.norm(crossing, axis=1)
    crossing = crossing[size > math.sin(math.radians(5))] / size[size > math.sin(math.radians(5)), None]
    crossing *= np.where(crossing[:, 2:] < 0, -1.0, 1.0)
    crossing = np.concatenate([zenith, crossing[crossing[:, 2] > math.cos(most_tilt_rad)]])
    off = (crossing @ arcs.normals[steep].T) / _spread(arcs, SEARCH_RAD)[steep]
    score = np.exp(-0.5 * off**2) @ worth[steep]
    kept: list[int] = []
    for index in np.argsort(-score):
        if all(crossing[index] @ crossing[k] < math.cos(APART_RAD) for k in kept):
            kept.append(int(index))
        if len(kept) == KEPT:
            break
    return np.asarray(crossing[kept])


def _with_azimuth(arcs: Arcs, worth: Doubles, vertical: Doubles) -> Doubles:
    """Return the best axes (3, 3) with a vertical."""
    first = np.cross([0.0, 1.0, 0.0], vertical)
    first /= np.linalg.norm(first)
    second = np.cross(vertical, first)
    spread = _spread(arcs, SEARCH_RAD)
    along = (arcs.normals @ np.stack([first, second, vertical]).T) / spread[:, None]
    angle = np.arange(AZIMUTH_STEPS) * (math.pi / 2 / AZIMUTH_STEPS)
    cosine, sine = np.cos(angle), np.sin(angle)
    x = np.outer(along[:, 0], cosine) + np.outer(along[:, 1], sine)
    y = np.outer(along[:, 1], cosine) - np.outer(along[:, 0], sine)
    nearest = np.minimum(np.minimum(x**2, y**2), along[:, 2:] ** 2)
    best = int((worth @ np.exp(-0.5 * nearest)).argmax())
    ahead = first * cosine[best] + second * sine[best]
    return np.stack([ahead, np.cross(vertical, ahead), vertical])


def _merit(arcs: Arcs, worth: Doubles, rows: Doubles) -> float:
    """Return how well axes explain the arcs, each axis by itself: planks, however many, are evidence of one axis only.

    Of nearly equal ones the less tilted wins."""
    excess, _ = _excess(arcs, worth, rows, SEARCH_RAD)
    return float(np.sqrt(np.maximum(excess, 0.0)).sum()) - TILT_COST * float(np.arccos(min(1.0, abs(rows[2, 2])))) ** 2


def _refined(arcs: Arcs, worth: Doubles, rows: Doubles, of_room_rad: float, steps: int) -> Doubles:
    """Return axes after a few steps of weighted least squares; each arc follows its nearest axis."""
    spread = _spread(arcs, of_room_rad)
    for _ in range(steps):
        off = arcs.normals @ rows.T
        axis = np.abs(off).argmin(axis=1)
        residual = off[np.arange(len(off)), axis]
        weight = worth / spread**2 * np.exp(-0.5 * (residual / spread) ** 2)
        slope = np.cross(rows[axis], arcs.normals)
        normal = (slope * weight[:, None]).T @ slope
        # What no arc constrains stays as it is.
        normal += np.eye(3) * 1e-6 * max(np.trace(normal), 1e-30)
        turn = -np.linalg.solve(normal, slope.T @ (weight * residual))
        rows = rows @ rotation_about(turn).T
        if np.linalg.norm(turn) < 1e-7:
            break
    return rows


def _excess(arcs: Arcs, worth: Doubles, rows: Doubles, of_room_rad: float) -> tuple[Doubles, float]:
    within = 2 * _spread(arcs, of_room_rad)
    chance = np.minimum(np.sin(np.minimum(within, math.pi / 2)), 1 / 3)
    telling = worth * (1 - 3 * chance)
    off = np.abs(arcs.normals @ rows.T)
    axis = np.where(off.min(axis=1) < within, off.argmin(axis=1), -1)
    total = float(telling.sum())
    along = np.array([telling[axis == k].sum() for k in range(3)]) - float((telling * chance).sum())
    return along / max(total, 1e-9), total


def _canonical(rows: Doubles) -> Doubles:
    """Return the same axes, the vertical up, the first within 45 degrees of +y's side, right-handed."""
    vertical = rows[2] * (1.0 if rows[2, 2] >= 0 else -1.0)
    first, second = rows[0], rows[1]
    ahead = max([first, -first, second, -second], key=lambda one: float(one[1]))
    return np.stack([np.cross(ahead, vertical), ahead, vertical])


def rotation_about(vector: Doubles) -> Doubles:
    """Return the matrix, of shape (3, 3), of a right-handed turn about an axis (3,) by its length (rad)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


def rotation_vector(matrix: Doubles) -> Doubles:
    """Return the axis times angle (rad), of shape (3,), of a rotation (3, 3) below pi."""
    twice = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine = float(np.linalg.norm(twice)) / 2
    angle = math.atan2(sine, (float(np.trace(matrix)) - 1) / 2)
    return np.asarray(twice / 2 * (angle / sine if sine > 1e-12 else 1.0))
