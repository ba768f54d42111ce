"""From a blurred probability to a mask that ends where things end in the picture.

Graph cuts with colour models of inside and outside (GrabCut; Rother, Kolmogorov, Blake 2004) in windows around the
sphere: models of one window know its few colours, which those of a whole room would drown. Windows overlap and vote.
What is nearly certain is kept out of question, so that only uncertain bands can move. On full-size pictures, the
edge is then laid on full-size pixels by a guided filter (He, Sun, Tang 2013), in tiles that hold an edge and nowhere
else.
"""

import math

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Flags, Floats, Reals, bands
from processing.ground.seam import resized
from processing.ground.threads import side_by_side
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import CEILING, FLOOR, SurfaceMaps

WINDOWS_RAD = (math.radians(56), math.radians(90))
"""Widths of windows along the equator; each overlaps the next by half."""
SURE = 0.95  # probability from which a place is inside for good; 1 - SURE: outside
ROUNDS = 2  # of OpenCV's GrabCut; chosen, never swept
MARGIN_PX = 24  # of colours around a piece that the cut sees; chosen, never swept
LEAST_PX = 30  # of likely inside, below which a window has nothing to learn colours from
SEED = 1  # any, as long as it is the same each time
TILE_PX = 256  # side of what is cut at once; chosen, never swept
GUIDE_RADIUS_PX = 8  # of the guided filter; half of it in pixels of the working size; chosen, never swept
GUIDE_EPS = 1e-4  # variance of display values (0..1) below which the guide is flat


def snapped(probability: Floats, rgb8: Bytes) -> Floats:
    """Return (H, W) in 0..1: the share of graph cuts that take a pixel for inside.

    ``probability`` (H, W), of a whole panorama.
    ``rgb8`` (H, W, 3), sRGB.

    Where no window has enough of it, what is above one half stays as it is.
    """
    found = np.zeros(probability.shape, np.float32)
    for width_rad in WINDOWS_RAD:
        height, width = probability.shape
        window = min(width, max(8, round(width_rad / (2 * math.pi) * width)))
        count = math.ceil(width / max(window // 2, 1))
        tent = (1 - np.abs(2 * (np.arange(window) + 0.5) / window - 1) + 0.02).astype(np.float32)
        votes, weights = np.zeros((height, width), np.float32), np.zeros(width, np.float32)
        for step in range(count):
            columns = (round(step * width / count) + np.arange(window)) % width
            votes[:, columns] += cut_picture(probability[:, columns], rgb8[:, columns]) * tent
            weights[columns] += tent
        found += votes / weights
    return found / np.float32(len(WINDOWS_RAD))


def cut_picture(probability: Floats, rgb8: Bytes) -> Floats:
    """Return 1 where the graph cut of one picture (H, W, 3) says inside, from probabilities (H, W)."""
    inside = probability > 0.5
    asked = (probability > 1 - SURE) & (probability < SURE)
    if inside.sum() < LEAST_PX or not asked.any() or (probability > 1 - SURE).all():
        return inside.astype(np.float32)
    rows = np.flatnonzero((probability > 1 - SURE).any(axis=1))
    first, last = max(0, int(rows[0]) - MARGIN_PX), min(len(probability), int(rows[-1]) + 1 + MARGIN_PX)
    part = probability[first:last]
    state = np.full(part.shape, cv2.GC_PR_BGD, np.uint8)
    state[part > 0.5] = cv2.GC_PR_FGD
    state[part >= SURE] = cv2.GC_FGD
    state[part <= 1 - SURE] = cv2.GC_BGD
    if not (state % 2 == 0).any():
        return inside.astype(np.float32)
    # Its colour clusters start from random numbers: the same ones each time.
    cv2.setRNGSeed(SEED)
    outside, within = np.zeros((1, 65)), np.zeros((1, 65))
    whole = (0, 0, part.shape[1], part.shape[0])
    picture = np.ascontiguousarray(rgb8[first:last, :, ::-1])
    cv2.grabCut(picture, state, whole, outside, within, ROUNDS, cv2.GC_INIT_WITH_MASK)
    found = inside.astype(np.float32)
    found[first:last] = state % 2
    return found


def at_full_size(share: Floats, rgb8: Bytes) -> Floats:
    """Return a soft mask (h, w) at a larger picture's size (H, W), its edges laid on that picture's edges."""
    shape = (rgb8.shape[0], rgb8.shape[1])
    large = resized(share, shape)
    if shape[0] <= share.shape[0]:
        return large
    radius = max(2, round(GUIDE_RADIUS_PX * shape[0] / share.shape[0] / 2))
    out = large.copy()

    def lay(tile: tuple[slice, slice]) -> None:
        rows, columns = tile
        part = large[rows, columns]
        if part.min() > 0.9 or part.max() < 0.1:
            return
        top, bottom = max(0, rows.start - 2 * radius), min(shape[0], rows.stop + 2 * radius)
        around = np.arange(columns.start - 2 * radius, columns.stop + 2 * radius) % shape[1]
        guide = np.asarray(rgb8[top:bottom][:, around], np.float32) / np.float32(255)
        fine = guided(np.asarray(large[top:bottom][:, around], np.float32), guide, radius)
        inner = fine[rows.start - top : rows.stop - top, 2 * radius : 2 * radius + part.shape[1]]
        out[rows, columns] = np.clip(inner, 0, 1)

    side_by_side(lay, ((rows, columns) for rows in bands(shape[0], TILE_PX) for columns in bands(shape[1], TILE_PX)))
    return out


def guided(values: Floats, guide: Floats, radius_px: int, eps: float = GUIDE_EPS) -> Floats:
    """Return ``values`` (H, W) smoothed along a colour guide (H, W, 3): linear in its colours within each window.

    He, Sun, Tang 2013, eq. 14 to 16; ``guide`` in 0..1.
    """

    def _mean(picture: Reals) -> Floats:
        flat, side = np.asarray(picture, np.float32), (2 * radius_px + 1,) * 2
        return np.asarray(cv2.boxFilter(flat, -1, side, borderType=cv2.BORDER_REFLECT), np.float32)

    colour, value = _mean(guide), _mean(values)
    covariance = [_mean(guide[..., i] * values) - colour[..., i] * value for i in range(3)]
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    spread = [_mean(guide[..., i] * guide[..., j]) - colour[..., i] * colour[..., j] for i, j in pairs]
    for k in (0, 3, 5):
        spread[k] = spread[k] + np.float32(eps)
    slope = np.stack(_solved(spread, covariance), axis=-1)
    offset = value - (slope * colour).sum(axis=2)
    return np.asarray((_mean(slope) * guide).sum(axis=2) + _mean(offset), dtype=np.float32)


def _solved(matrix: list[Floats], right: list[Floats]) -> list[Floats]:
    """Solve symmetric, positive 3 x 3 systems, one a pixel, in double precision: LAPACK takes twice as long."""
    a, b, c, d, e, f = (one.astype(np.float64) for one in matrix)
    x, y, z = right
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    dd, ee, ff = a * f - c * c, b * c - a * e, a * d - b * b
    scale = 1 / (a * aa + b * bb + c * cc)
    solved = (aa * x + bb * y + cc * z, bb * x + dd * y + ee * z, cc * x + ee * y + ff * z)
    return [np.asarray(one * scale, np.float32) for one in solved]


# How unlike the usual colours of a surface a place is: what stands before a plain wall or floor stands out.

CLUSTERS, SAMPLES = 6, 1500  # chosen, never swept
LEAST_CLUSTER_SHARE = 0.02  # of the sample that a cluster must hold to be a colour of the surface
OWN_SURE, OWN_LIKELY = 0.6, 0.4
"""Probability of its own class from which a place teaches a surface's colours; the second where the first is rare."""
RARE_OWN_PX, LEAST_OWN_PX = 100, 50
MOST_OUTLYING = 5.0  # 12 standard deviations; chosen, never swept


def colour_distance(rgb8: Bytes, known: Flags) -> Floats:
    """Return (H, W): the squared distance, in standard deviations, of each pixel from the colours of known pixels.

    Up to `CLUSTERS` colours with their spread in CIE L*a*b*; deterministic. ``known`` must hold some pixels.
    """
    colours = cv2.cvtColor(cv2.GaussianBlur(rgb8, (0, 0), 1.0), cv2.COLOR_RGB2Lab).astype(np.float32)
    sample = colours[known]
    sample = sample[:: max(1, len(sample) // SAMPLES)]
    cv2.setRNGSeed(1)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.5)
    count = min(CLUSTERS, len(sample))
    _, member, middle = cv2.kmeans(sample, count, np.empty(0, np.int32), stop, 1, cv2.KMEANS_PP_CENTERS)
    nearest = np.full(colours.shape[:2], np.inf, np.float32)
    for index in range(count):
        part = sample[member[:, 0] == index]
        # The largest cluster always counts, so that there is one.
        if len(part) < max(4, LEAST_CLUSTER_SHARE * len(sample)) and len(part) * count < len(sample):
            continue
        # 8-bit steps and noise: no colour is known better than this.
        spread = np.cov(part.T) if len(part) > 3 else np.zeros((3, 3))
        inverse = np.linalg.inv(spread + np.diag([9.0, 4.0, 4.0])).astype(np.float32)
        off = colours - middle[index]
        nearest = np.minimum(nearest, ((off @ inverse) * off).sum(axis=2))
    return nearest


def surface_outliers(probabilities: Floats, maps: SurfaceMaps, rgb8: Bytes) -> Floats:
    """Return (H, W) in 0..`MOST_OUTLYING`: ln(1 + squared distance) from the colours of the plane behind each pixel.

    ``probabilities`` (8, H, W) say where a plane is seen; a plane that is hardly seen gives 0.
    """
    own = {FLOOR: SceneClass.FLOOR, CEILING: SceneClass.CEILING}
    found = np.zeros(maps.plane.shape, np.float32)
    for plane in np.unique(maps.plane):
        here = maps.plane == plane
        share = probabilities[own.get(int(plane), SceneClass.WALL)]
        known = here & (share > OWN_SURE) & (maps.opening < 0)
        if known.sum() < RARE_OWN_PX:
            known = here & (share > OWN_LIKELY) & (maps.opening < 0)
        if known.sum() >= LEAST_OWN_PX:
            found[here] = np.log1p(colour_distance(rgb8, known))[here]
    return np.clip(found, 0.0, MOST_OUTLYING)
