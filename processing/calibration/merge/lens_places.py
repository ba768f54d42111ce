"""Where the two lenses of a panorama camera look: its raw files show them side by side, unstitched.

The camera's own JPEG panorama of the same moment shows where each lens looks: it is drawn into each lens's picture,
what does not fit is found by optical flow (Kroeger et al. 2016), and the lens is fitted to that, from coarse to fine.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from processing.calibration.merge import lens_pair
from processing.errors import BracketError, LensError
from processing.ground.arrays import Bytes, Doubles, Floats, UInt16s
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.mosaic import FULL, PEDESTAL, CameraColours
from processing.sphere import Fisheye, LensMapping

SIZES_PX = (96, 192, 384, 768, 1536)
"""Of a lens's picture, coarse to fine: the fit begins at the first and ends at the last that the file has; chosen."""
POWERS = (1, 3, 5)
"""Of the distance from the centre, in the angle from the axis: a lens that is alike all around has odd ones."""
COARSE = 3  # windows of the patterns by which a lens is looked for: what is wide is found from afar; chosen
TURNS_RAD = (0.2, 0.1, 0.05)  # of a lens, that are tried next; chosen
SCALES = (1.0, 1.1, 1.2, 1.3, 1.45)  # half turns across a lens's picture, tried first; chosen
RING_RAD = math.radians(0.75)  # in which the edge of the image circle is looked for; chosen
PATTERN_RAD = math.radians(94)  # from the axis, in which lens and panorama are compared; chosen
MOST_RADIUS = 1.15  # of an image circle, in half sides: some are cut by the sensor's border; chosen
USABLE_RAD = math.radians(1.5)  # within the circle's edge; chosen: clear of its blur
LEAST_LIKENESS = 0.25
"""Correlation of lens and panorama at first, below which no fit is tried; chosen: five real rooms have 0.85 to 0.92,
tilted ones less. Another room's panorama may have 0.45: it is refused by its fit, to 3 degrees and more."""
MOST_OFF_RAD = math.radians(0.4)  # median distance of lens and panorama, above which there is no fit; chosen
UNUSUAL = (0.05, 0.05, 0.5, 0.5)  # of a centre in half sides, and of the higher factors: standard deviations; chosen
ROUNDS = 3  # at each size; chosen
LEAST_POINTS = 40  # of a lens, of the 1800 tried, that show where they are; chosen
GRID = 48  # points across a lens's picture, in the fit; chosen
LEAST_SPREAD = 6  # standard deviation of a pattern around a pixel that shows where it is; chosen


def place_lenses(raw: UInt16s, colours: CameraColours, panorama: Bytes) -> lens_pair.LensPair:
    """Return both lenses of a raw frame (H, 2 H, 3) of `mosaic.camera_rgb`, by the camera's JPEG (h, 2 h, 3) of it.

    Raises `BracketError` where the two do not show the same.
    """
    height, width = raw.shape[:2]
    if abs(width / height - 2) > 0.02 or width % 2:
        raise BracketError(f"its raw pictures of {width} x {height} wells are not two round pictures side by side")
    weights = (np.array(LUMINANCE_WEIGHTS) @ colours.matrix).astype(np.float32)
    light = (raw.astype(np.float32) - np.float32(PEDESTAL)) @ weights / np.float32(FULL - PEDESTAL)
    light[(raw >= FULL).any(axis=2)] = np.inf
    halves: list[Floats] = [np.ascontiguousarray(half, dtype=np.float32) for half in np.split(light, 2, axis=1)]
    luma = np.asarray(cv2.cvtColor(panorama, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    fits = [_fitted(half, luma, start) for half, start in zip(halves, _facing(halves, luma), strict=True)]
    off = max(off_rad for _, off_rad in fits)
    if not off <= MOST_OFF_RAD:
        text = f"its raw pictures fit its panorama to {math.degrees(off):.2f} degrees only"
        likely = "dynamic stitching, a rotated panorama, or a room without edges"
        raise BracketError(text, likely=likely, advice="set the camera to static stitching")
    try:
        lenses = [_lens(numbers, halves[k], k) for k, (numbers, _) in enumerate(fits)]
    except LensError as error:
        raise BracketError(f"its raw pictures show no lens: {error.message}") from error
    return replace(lens_pair.tied(lenses, halves, panorama), off_rad=off)


def clearest(raws: Sequence[UInt16s], panoramas: Sequence[Bytes]) -> int:
    """Return the frame, (H, W, 3) of each, of which most is neither clipped nor black; panoramas of any size."""
    good = []
    for raw, panorama in zip(raws, panoramas, strict=True):
        well, code = raw[::16, ::16, 1], panorama[::4, ::4, 1]
        good.append(
            np.mean((well > 2 * PEDESTAL) & (well < FULL))
            * np.mean((code > lens_pair.CODES[0]) & (code < lens_pair.CODES[1]))
        )
    return int(np.argmax(good))


# A lens as numbers: its centre (x, y) from the middle of its half, in half sides; factors of `POWERS` of the distance
# from there, in half sides, that make the angle from its axis; and the rotation vector of its axes.


def _seen(numbers: Doubles, x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
    """Return what a lens sees at points of its half, (..., 3) in the panorama's axes, and the angle from its axis."""
    left, up = numbers[0] - x, numbers[1] - y
    radius = np.hypot(left, up)
    angle = lens_pair.powers(radius, POWERS) @ numbers[2:5]
    scale = np.sin(angle) / np.maximum(radius, 1e-9)
    rays = np.stack([left * scale, up * scale, np.cos(angle)], axis=-1)
    return rays @ Rotation.from_rotvec(numbers[5:]).as_matrix(), angle


def _plane(size_px: int) -> tuple[Doubles, Doubles]:
    """Return x and y of a half's pixels (S, S), in half sides from its middle."""
    middles = (np.arange(size_px) + 0.5) / (size_px / 2) - 1
    x, y = np.meshgrid(middles, middles)
    return x, y


def _pattern(light: Floats, angle_rad: Doubles, windows: int = 16) -> Bytes:
    """Return what a lens's picture (S, S) of 0..1 shows beside its light and contrast; 128 where it is even.

    ``angle_rad`` (S, S): from its axis; what lies beyond `PATTERN_RAD`, black perhaps, is left out. Means are
    over 2 / ``windows`` of the side."""
    inside = (angle_rad < PATTERN_RAD).astype(np.float32)
    log = np.log(np.clip(light, 0, 1) + np.float32(0.003)) * inside
    side = 2 * (len(light) // windows) + 1
    share = np.maximum(cv2.blur(inside, (side, side)), np.float32(0.01))
    mean = cv2.blur(log, (side, side)) / share
    sigma = np.sqrt(np.maximum(cv2.blur(log * log, (side, side)) / share - mean * mean, 0)) + 0.05
    return np.asarray(np.clip(128 + 50 * inside * (log - mean) / sigma, 0, 255), dtype=np.uint8)


def _likeness(one: Bytes, other: Bytes) -> float:
    """Return the correlation of two patterns of one shape; 0 where one is even."""
    a, b = one - one.mean(), other - other.mean()
    return float((a * b).sum() / max(math.sqrt(float((a * a).sum() * (b * b).sum())), 1e-9))


def _facing(halves: Sequence[Floats], luma: Bytes) -> list[Doubles]:
    """Return each lens at first: one looks along the panorama's middle, one against it, in eighths of a turn.

    Raises `BracketError` where neither order resembles the panorama."""
    best = {}
    for k, half in enumerate(halves):
        own = lens_pair.reduced(np.minimum(half, 1), SIZES_PX[0])
        for ahead in (1, -1):
            level = Rotation.from_matrix([[-ahead, 0, 0], [0, 0, 1], [0, ahead, 0]])
            turns = [(Rotation.from_euler("z", 45 * n, degrees=True) * level).as_rotvec() for n in range(8)]
            tries = [np.array([0, 0, scale * math.pi / 2, 0, 0, *turn]) for turn in turns for scale in SCALES]
            best[k, ahead] = _turned(own, luma, max(tries, key=partial(_alike, own, luma)))
    chosen = max([(best[0, ahead], best[1, -ahead]) for ahead in (1, -1)], key=lambda two: two[0][0] + two[1][0])
    if not min(alike for alike, _ in chosen) > LEAST_LIKENESS:
        raise BracketError(
            "its raw pictures do not match its panorama", likely="files from different moments, or a rotated panorama"
        )
    return [numbers for _, numbers in chosen]


def _alike(own: Floats, luma: Bytes, numbers: Doubles) -> float:
    """Return how much a lens's picture (S, S) resembles what the panorama shows where the lens would look."""
    rays, angle = _seen(numbers, *_plane(len(own)))
    near = angle < lens_pair.SEEN_RAD
    shown = _pattern(np.square(lens_pair.drawn(luma, rays) / np.float32(255)), angle, COARSE)
    return _likeness(_pattern(own, angle, COARSE)[near], shown[near])


def _turned(own: Floats, luma: Bytes, numbers: Doubles) -> tuple[float, Doubles]:
    """Return the greatest likeness that small turns lead to, one after the other, and the lens so turned."""
    alike = _alike(own, luma, numbers)
    for step_rad in TURNS_RAD:
        before = -math.inf
        while alike > before:
            before, axes = alike, Rotation.from_rotvec(numbers[5:])
            small = [Rotation.from_rotvec(turn) * axes for turn in np.vstack([np.eye(3), -np.eye(3)]) * step_rad]
            tries = [np.append(numbers[:5], one.as_rotvec()) for one in small]
            alike, numbers = max(
                [(alike, numbers), *((_alike(own, luma, one), one) for one in tries)], key=itemgetter(0)
            )
    return alike, numbers


def _fitted(half: Floats, luma: Bytes, numbers: Doubles) -> tuple[Doubles, float]:
    """Return a lens, from coarse to fine, and the median angle between what it and the panorama see (inf: no edges)."""
    off_rad = math.inf
    for size_px in [size for size in SIZES_PX if size <= max(len(half), SIZES_PX[1])]:
        own = lens_pair.reduced(np.minimum(half, 1), size_px)
        for _ in range(ROUNDS):
            points = _points(own, luma, numbers)
            if len(points[0]) < LEAST_POINTS:
                return numbers, math.inf
            numbers = least_squares(_off, numbers, loss="soft_l1", f_scale=0.5, args=(*points, size_px / math.pi)).x
            off_rad = float(np.median(np.linalg.norm(_seen(numbers, *points[:2])[0] - points[2], axis=-1)))
    return numbers, off_rad


def _off(numbers: Doubles, x: Doubles, y: Doubles, rays: Doubles, pixels_a_rad: float) -> Doubles:
    """Return by how much a lens misses what its points (N,) show, (3 N,) in pixels; and how unusual it is."""
    unusual = numbers[[0, 1, 3, 4]] / UNUSUAL
    return np.append(pixels_a_rad * (_seen(numbers, x, y)[0] - rays).ravel(), unusual)


def _points(own: Floats, luma: Bytes, numbers: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return points of a lens's picture (S, S), x and y (N,), and where the panorama shows the same, (N, 3)."""
    size_px = len(own)
    x, y = _plane(size_px)
    rays, angle = _seen(numbers, x, y)
    shown = _pattern(np.square(lens_pair.drawn(luma, rays) / np.float32(255)), angle)
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    still = np.zeros((size_px, size_px, 2), np.float32)
    moved = np.asarray(flow.calc(shown, _pattern(own, angle), still)) * (2 / size_px)
    step = max(size_px // GRID, 1)
    row, column = np.mgrid[:size_px, :size_px] % step == step // 2
    grey = shown.astype(np.float32)
    spread = cv2.blur(grey * grey, (5, 5)) - cv2.blur(grey, (5, 5)) ** 2
    use = row & column & (angle < lens_pair.SEEN_RAD) & (spread > LEAST_SPREAD**2) & (np.hypot(x, y) < 1)
    return x[use] + moved[use, 0], y[use] + moved[use, 1], rays[use]


def _lens(numbers: Doubles, half: Floats, number: int) -> lens_pair.PlacedLens:
    """Return a fitted lens with its field, to where light falls to half of that at a right angle; its seam is whole."""
    side, small = len(half) / 2, np.minimum(lens_pair.reduced(half, lens_pair.TIE_PX), 1)
    x, y = _plane(lens_pair.TIE_PX)
    _, angle = _seen(numbers, x, y)
    rings = np.rint(angle / RING_RAD).astype(int)
    radii, border = np.linspace(0, MOST_RADIUS, 1000), 1 - float(np.abs(numbers[:2]).max())
    angles = lens_pair.powers(radii, POWERS) @ numbers[2:5]
    right = round(math.pi / 2 / RING_RAD)
    level = [float(np.quantile(small[rings == k], 0.75)) for k in range(right - 2, int(angles.max() / RING_RAD))]
    last = next((k for k, light in enumerate(level) if light < max(level[:3]) / 2), len(level))
    field = (right - 2 + last) * RING_RAD - USABLE_RAD
    whole = min(field, float(np.interp(border, radii, angles)))
    if not whole > math.pi / 2 + lens_pair.BLEND_RAD:
        raise LensError(f"{math.degrees(whole):.1f} degrees from the axis are less than two lenses need to meet")
    reach = float(np.interp(field, angles, radii))
    factors = np.zeros(max(POWERS))
    factors[np.array(POWERS) - 1] = numbers[2:5] * reach ** np.array(POWERS) / field
    centre = ((1 + 2 * number + numbers[0]) * side, (1 + numbers[1]) * side)
    size = 2 * len(half), len(half)
    shape = tuple((factors / factors.sum()).tolist())
    lens = Fisheye(*size, LensMapping.POLYNOMIAL, reach * side, field, centre, polynomial=shape)
    return lens_pair.PlacedLens(lens, Rotation.from_rotvec(numbers[5:]).as_matrix(), 1.0)
