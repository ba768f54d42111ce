"""Which pixels show furniture: evidence joined with the room, cut at edges, filtered by the floor (paper, fig. 3b)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Flags, Floats, Indices, Int32s
from processing.ground.seam import components, grown, row_solid_angles, smoothed
from processing.removal.edges import snapped, surface_outliers
from processing.segmentation.evidence import SceneClass
from processing.surfaces.maps import SurfaceMaps
from processing.surfaces.planes import CEILING, FLOOR

FLOOR_SLACK_RAD = math.radians(2.5)
"""Errors of the floor's boundary."""
ON_FLOOR_SHARE = 0.05
"""Of a component's solid angle that lies before the floor, from which it stands on it ..."""
FOOT_SHARE = 0.10
"""... or of the columns it is seen in, those whose lowest pixel does."""
LEAST_SR = 2e-5
"""Smaller components are noise: about 1.5 x 1.5 pixels of 1024 x 512."""
EVIDENCE_WEIGHT = 1.03
"""Of the network's log odds."""
HERE_WEIGHT, AROUND_WEIGHT = 0.16, 0.40
"""Of the colours' distance from the surface's own, at the place and within `AROUND_RAD` of it."""
AROUND_RAD = math.radians(1.0)
BIAS = -1.1
"""On validation rooms 0.80 of what is taken is furniture, and 0.88 of the furniture is taken."""
CUT_SHARE = 0.4
"""Of the graph cut's vote beside the probability's: a cut alone loses whole pieces that have the wall's colour."""
TAKEN = 0.45
"""From which of both together a place is furniture."""
SHARPNESS = 4.0
"""Of the soft mask about that."""
ISLAND_SR = 0.08
"""What furniture goes all round is taken with it up to this size (16 degrees square): it would be left hanging."""
SEGMENTS = (150.0, 300.0)
"""Thresholds of the graph segmentation (Felzenszwalb, Huttenlocher 2004): colour segments at two scales ..."""
SEGMENT_BLUR, SEGMENT_PX = 0.6, 40
DOUBTFUL, SEED_SHARE = 0.3, 0.3
"""... whose parts of more than the first probability are furniture where so much of them already is. Chosen on one real
room (bedroom_hn): recall 0.91 -> 0.95 at the same IoU, by fused evidence; by our network alone IoU falls by 0.03."""
CEILING_DOUBT, OPENING_DOUBT = 0.7, 0.65
"""Natural logarithm of odds taken off before the ceiling, and before windows and doors."""


@dataclass(frozen=True)
class FurnitureFound:
    """Furniture of a panorama at working size."""

    mask: Flags
    probability: Floats
    """(H, W): before filtering by the floor, with edges; furniture is above one half."""
    dropped: int
    """Components that are not attached to the floor."""
    dropped_sr: float


def find_furniture(
    probabilities: Floats, maps: SurfaceMaps, rgb8: Bytes, *, floor_filter: bool = True, whole: bool = False
) -> FurnitureFound:
    """Return the furniture of an upright panorama.

    Parameters
    ----------
    probabilities
        (8, H, W).
    maps
        Of the room, at the same size.
    rgb8
        (H, W, 3), sRGB.
    floor_filter
        False: keep what hangs on walls too.
    whole
        Complete things to the borders of their colours: for evidence that two networks share.
    """
    prior = furniture_prior(probabilities, maps, rgb8)
    vote = CUT_SHARE * snapped(prior, rgb8) + (1 - CUT_SHARE) * prior
    soft = np.clip(0.5 + SHARPNESS * (vote - TAKEN), 0, 1).astype(np.float32)
    if whole:
        soft = np.where(completed(soft > 0.5, prior, rgb8), np.maximum(soft, np.float32(0.75)), soft)
    mask = soft > 0.5
    if not floor_filter:
        return FurnitureFound(mask, soft, 0, 0.0)
    kept, dropped, dropped_sr = attached(mask, maps.plane == FLOOR)
    islands = islands_in(kept, maps.opening >= 0)
    return FurnitureFound(kept | islands, np.where(islands, np.float32(1), soft), dropped, dropped_sr)


def furniture_prior(probabilities: Floats, maps: SurfaceMaps, rgb8: Bytes) -> Floats:
    """Return the probability (H, W) of furniture: the network's, what the room says, and unusual colours.

    Weights are a logistic regression on simulated rooms of validation seeds and real rooms that may be looked at
    (docs/reference/detection.md), rounded.
    """
    share = np.clip(probabilities[SceneClass.FURNITURE], 1e-3, 1 - 1e-3)
    unusual = surface_outliers(probabilities, maps, rgb8)
    odds = EVIDENCE_WEIGHT * np.log(share / (1 - share)) + BIAS
    odds += HERE_WEIGHT * unusual + AROUND_WEIGHT * smoothed(unusual, AROUND_RAD)
    odds -= CEILING_DOUBT * (maps.plane == CEILING) + OPENING_DOUBT * (maps.opening >= 0)
    return np.asarray(1 / (1 + np.exp(-odds)), dtype=np.float32)


def completed(mask: Flags, probability: Floats, rgb8: Bytes) -> Flags:
    """Return a mask (H, W) grown to doubtful places (``probability``, (H, W)) within one connected segment of colour.

    Half a bed is worse than none: what has the colour of its other half, and may be furniture, goes with it.
    """
    doubtful = probability > DOUBTFUL
    weight = np.broadcast_to(row_solid_angles((mask.shape[0], mask.shape[1])), mask.shape)
    grown_to = mask.copy()
    for scale in SEGMENTS:
        cutter = cv2.ximgproc.segmentation.createGraphSegmentation(SEGMENT_BLUR, scale, SEGMENT_PX)
        labels = cutter.processImage(rgb8).ravel()
        seeds = np.bincount(labels, (weight * mask).ravel())
        parts = np.bincount(labels, (weight * doubtful).ravel())
        grown_to |= (seeds > SEED_SHARE * np.maximum(parts, 1e-9))[labels].reshape(mask.shape) & doubtful
    return grown_to


def attached(mask: Flags, floor: Flags) -> tuple[Flags, int, float]:
    """Return the components of a mask (H, W) attached to the ``floor`` (H, W), and count and sr of the others.

    A component is attached where enough of it, or of its lower contour, lies before the floor's region (widened by
    `FLOOR_SLACK_RAD`). Clutter on furniture stays, as it hangs together with what it stands on.
    """
    count, labels = components(mask)
    if not count:
        return mask.copy(), 0, 0.0
    near_floor = grown(floor, FLOOR_SLACK_RAD)
    weight = np.broadcast_to(row_solid_angles((mask.shape[0], mask.shape[1])), mask.shape)
    size = np.bincount(labels.ravel(), weight.ravel(), count + 1)
    before = np.bincount(labels.ravel(), (weight * near_floor).ravel(), count + 1)
    foot, feet = _feet(labels, near_floor, count)
    stands = (before >= ON_FLOOR_SHARE * size) | (foot >= FOOT_SHARE * np.maximum(feet, 1))
    stands &= (before > 0) & (size >= LEAST_SR)
    stands[0] = False
    gone = ~stands
    gone[0] = False
    return stands[labels], int((gone & (size >= LEAST_SR)).sum()), float(size[gone].sum())


def islands_in(mask: Flags, never: Flags) -> Flags:
    """Return the small components that a mask (H, W) encloses, but for those mostly in ``never`` (H, W)."""
    count, labels = components(~mask)
    weight = np.broadcast_to(row_solid_angles((mask.shape[0], mask.shape[1])), mask.shape)
    size = np.bincount(labels.ravel(), weight.ravel(), count + 1)
    barred = np.bincount(labels.ravel(), (weight * never).ravel(), count + 1)
    small = (size < ISLAND_SR) & (barred < size / 2)
    small[0] = False
    return np.asarray(small[labels], bool)


def _feet(labels: Int32s, near_floor: Flags, count: int) -> tuple[Indices, Indices]:
    """Return, for each component, how many columns' lowest pixels lie before the floor, and how many columns it has."""
    below = np.vstack([labels[1:], np.zeros((1, labels.shape[1]), labels.dtype)])
    contour = (labels > 0) & (below != labels)
    feet = np.bincount(labels[contour], minlength=count + 1)
    return np.bincount(labels[contour & near_floor], minlength=count + 1), feet
