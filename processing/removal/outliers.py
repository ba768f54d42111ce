"""How unlike the usual colours of a surface a place is: what stands before a plain wall or floor stands out."""

from __future__ import annotations

from processing.ground.arrays import Bytes, Flags, Floats

import cv2
import numpy as np
import numpy.typing as npt

from processing.segmentation.classes import SceneClass
from processing.surfaces.maps import SurfaceMaps
from processing.surfaces.plane import CEILING, FLOOR


CLUSTERS = 6
SAMPLES = 1500
LEAST_SHARE = 0.02
"""Of the sample that a cluster must hold to be a colour of the surface."""
SURE, LIKELY = 0.6, 0.4
"""Probability of its own class from which a place teaches a surface's colours; the second where the first is rare."""
RARE_PX, LEAST_PX = 100, 50
MOST = 5.0


def colour_distance(rgb8: Bytes, known: Flags) -> Floats:
    """Return (h, w): the squared distance, in standard deviations, of each pixel from the colours of known pixels.

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
        if len(part) < max(4, LEAST_SHARE * len(sample)) and len(part) * count < len(sample):
            continue
        # 8-bit steps and noise: no colour is known better than this.
        spread = np.cov(part.T) if len(part) > 3 else np.zeros((3, 3))
        inverse = np.linalg.inv(spread + np.diag([9.0, 4.0, 4.0])).astype(np.float32)
        off = colours - middle[index]
        nearest = np.minimum(nearest, ((off @ inverse) * off).sum(axis=2))
    return nearest


def surface_outliers(probabilities: Floats, maps: SurfaceMaps, rgb8: Bytes) -> Floats:
    """Return (H, W) in 0..`MOST`: ln(1 + squared distance) from the colours of the plane behind each pixel.

    ``probabilities`` (8, H, W) tell where a plane is seen; a plane that is hardly seen gives 0.
    """
    own = {FLOOR: SceneClass.FLOOR, CEILING: SceneClass.CEILING}
    found = np.zeros(maps.plane.shape, np.float32)
    for plane in np.unique(maps.plane):
        here = maps.plane == plane
        share = probabilities[own.get(int(plane), SceneClass.WALL)]
        known = here & (share > SURE) & (maps.opening < 0)
        if known.sum() < RARE_PX:
            known = here & (share > LIKELY) & (maps.opening < 0)
        if known.sum() >= LEAST_PX:
            found[here] = np.log1p(colour_distance(rgb8, known))[here]
    return np.clip(found, 0.0, MOST)
