"""What a merge's curve and times leave uncertain in all pixels together, and what texture hides.

For neutral light of each level: by how much the merged luminance moves with a mode of the curve's uncertainty, and with
each frame's time. Their covariance over levels is what counts, so that its largest principal modes are kept.
"""

import math

import cv2
import numpy as np

from processing.calibration.merge.linear import LinearSamples
from processing.calibration.merge.tables import MergeTables
from processing.calibration.response.curve import ResponseCurve
from processing.ground.arrays import Doubles, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.modes import SharedMode
from processing.pictures.mosaic import FULL

LEVELS = 64  # of luminance, over what the frames show; chosen
KEPT, LEAST = 8, 2e-4  # modes, and relative luminance below which one does not count; chosen
CONTRAST_SHARE = 0.5
"""Of the local standard deviation of log luminance: what coding, demosaicing and sharpening leave wrong at texture.
Most of it is alike in all frames, so that no bracket shows it: odd against even frames of real ones show 0.15.
Simulated cameras with a mosaic, which every real one has, need 0.5 to 0.9, others 0.15 to 0.25 (validation seeds)."""
CONTRAST_PX = 3  # chosen
NEAR_PX = 9  # chosen: half a block of chroma at half resolution
CONTRAST_REACH_PX = CONTRAST_PX // 2 + NEAR_PX // 2


def merge_modes(tables: MergeTables, curve: ResponseCurve, times_s: Doubles, time_sigma: Doubles) -> list[SharedMode]:
    """Return the shared modes of a merge, over log2 of the merged luminance.

    ``times_s``: (F,) s, falling; ``time_sigma``: (F,) relative.
    """
    low = np.log2(curve.exposure[:, 1].min() / times_s[0])
    levels = np.linspace(low, np.log2(curve.exposure.max() / times_s[-1]), LEVELS)
    share = np.zeros((len(times_s), 3, LEVELS))
    codes = np.zeros((len(times_s), 3, LEVELS))
    for f, time_s in enumerate(times_s):
        for c, log2 in enumerate(curve.log2_exposure):
            codes[f, c] = np.interp(levels + math.log2(time_s), log2, np.arange(256))
            share[f, c] = tables.lanes[f, c, np.rint(codes[f, c]).astype(np.intp), 1]
    share /= np.maximum(share.sum(axis=0), 1e-30)
    weights = np.array(LUMINANCE_WEIGHTS)
    rows = []
    for mode in curve_modes(curve):
        every = np.arange(256)
        moved = np.array([[np.interp(z, every, one) for z, one in zip(row, mode, strict=True)] for row in codes])
        rows.append(weights @ (math.log(2) * np.sum(share * moved, axis=0)))
    rows += [time_sigma[f] * weights @ share[f] for f in range(len(times_s)) if time_sigma[f] > 0]
    return _principal(np.array(rows), levels)


def linear_modes(samples: LinearSamples) -> list[SharedMode]:
    """Return the shared modes of a merge of linear frames: their times'."""
    low, high = -15.0 - np.log2(samples.times_s[0]), -np.log2(samples.times_s[-1])
    levels = np.linspace(low, high, LEVELS)
    light = np.repeat(np.exp2(levels)[:, None], 3, axis=1)
    share = np.stack(
        [samples.sample(f, FULL * (light * t + samples.noise[:, 3]))[1] for f, t in enumerate(samples.times_s)]
    )
    share = share @ np.array(LUMINANCE_WEIGHTS)
    share /= np.maximum(share.sum(axis=0), 1e-30)
    return _principal(samples.time_sigma[:, None] * share, levels)


def curve_modes(curve: ResponseCurve) -> Doubles:
    """Return the curve's modes, of shape (M, 3, 256) in stops: those of the fit, else tilts about the sure code."""
    if curve.modes is not None:
        return curve.modes
    side = np.sign(np.arange(256) - curve.sigma_code)
    return np.asarray(np.eye(3)[:, :, None] * (side * curve.sigma_log2)[None])


def _principal(rows: Doubles, levels: Doubles) -> list[SharedMode]:
    _, size, ways = np.linalg.svd(rows, full_matrices=False)
    found = [s * way for s, way in zip(size[:KEPT], ways, strict=False)]
    return [
        SharedMode(f"curve and times {number + 1}", "level", tuple(levels.tolist()), tuple(one.tolist()))
        for number, one in enumerate(found)
        if np.abs(one).max() > LEAST
    ]


def local_contrast(luminance: Floats) -> Floats:
    """Return the standard deviation of log luminance over 3 x 3 pixels, of shape (H, W) like ``luminance``."""
    log = cv2.log(np.maximum(luminance, np.float32(1e-20)))
    size = (CONTRAST_PX, CONTRAST_PX)
    square = cv2.sqrBoxFilter(log - cv2.blur(log, size), -1, size)
    # Running sums leave a trace below zero where nothing varies.
    return np.sqrt(np.maximum(square, 0), dtype=np.float32)
