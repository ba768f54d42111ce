"""Finding the colour chart: OpenCV's detector on tone-mapped copies, then corners moved to where the chart fits best.

Best is where each patch is even and the lines between patches, which are the chart's dark frame, are dark.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from processing.calibration.chart_patches import COLUMNS, ROWS, chart_points, homography
from processing.images import RelativeImage, luminance_cd_m2

_WORK_PX = (480, 960)
"""Picture widths that the detector works at: patches of 15 to 100 pixels suit it."""
_WHITE_PERCENTILES = (99.0, 90.0, 99.9)
_EVEN_WINDOW = 0.74
_EVEN_GRID = 9
_FRAME_WEIGHT = 0.3
_LINE_POINTS = 48


def candidates(view: RelativeImage) -> Iterator[Doubles]:
    """Yield corners (4, 2) in picture pixels of what may be the chart, the likeliest first."""
    import cv2

    for percentile in _WHITE_PERCENTILES:
        tones = _tone_mapped(view, percentile)
        if tones is None:
            return
        for width_px in _WORK_PX:
            scale = width_px / tones.shape[1]
            way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
            copy = cv2.resize(tones, None, fx=scale, fy=scale, interpolation=way)
            detector = cv2.mcc.CCheckerDetector.create()
            detector.setColorChartType(cv2.mcc.MCC24)
            if detector.process(np.ascontiguousarray(copy[..., ::-1]), 1):
                box = np.asarray(detector.getBestColorChecker().getBox(), dtype=np.float64)
                yield refined(view, box / scale)


def refined(view: RelativeImage, corners_px: Doubles) -> Doubles:
    """Return the corners moved by fractions of a patch to where patches are most even and the frame is darkest."""
    from scipy.optimize import minimize

    level = np.log2(np.maximum(luminance_cd_m2(view.rgb), _floor(view))).astype(np.float64)
    pitch_px = float(np.linalg.norm(corners_px[1] - corners_px[0])) / 6

    def unfit(moves: Doubles) -> float:
        mapping = homography(corners_px + moves.reshape(4, 2) * pitch_px)
        patches = _sampled(level, chart_points(mapping, _EVEN_WINDOW, _EVEN_GRID))
        frame = _sampled(level, _frame_points(mapping))
        unevenness = float(np.minimum(patches.std(axis=1), 1.0).mean())
        return unevenness + _FRAME_WEIGHT * float(frame.mean() - patches.mean())

    start = np.zeros((9, 8))
    start[1:] += 0.15 * np.eye(8)
    found = minimize(
        unfit, start[0], method="Nelder-Mead", options={"initial_simplex": start, "maxfev": 400, "xatol": 0.005}
    )
    return np.asarray(corners_px + np.asarray(found.x).reshape(4, 2) * pitch_px)


def _frame_points(mapping: Doubles) -> Doubles:
    """Return picture points along all lines between and around the patches."""
    along = np.linspace(0, 1, _LINE_POINTS)
    down = [np.stack([np.full_like(along, u), along * ROWS], axis=1) for u in range(COLUMNS + 1)]
    across = [np.stack([along * COLUMNS, np.full_like(along, v)], axis=1) for v in range(ROWS + 1)]
    points = np.concatenate(down + across)
    flat = np.column_stack([points, np.ones(len(points))]) @ mapping.T
    return np.asarray(flat[:, :2] / flat[:, 2:])


def _sampled(plane: Doubles, points: Doubles) -> Doubles:
    """Return the plane at points, bilinearly between pixel centres; beyond the picture its nearest pixel."""
    high, wide = plane.shape
    x = np.clip(points[..., 0] - 0.5, 0, wide - 1)
    y = np.clip(points[..., 1] - 0.5, 0, high - 1)
    left, top = np.minimum(x.astype(np.intp), max(wide - 2, 0)), np.minimum(y.astype(np.intp), max(high - 2, 0))
    right, low = np.minimum(left + 1, wide - 1), np.minimum(top + 1, high - 1)
    u, v = x - left, y - top
    above = plane[top, left] * (1 - u) + plane[top, right] * u
    below = plane[low, left] * (1 - u) + plane[low, right] * u
    return np.asarray(above * (1 - v) + below * v)


def _floor(view: RelativeImage) -> np.float32:
    """Return a small luminance that keeps logarithms finite."""
    return np.float32(max(float(luminance_cd_m2(view.rgb).max()), 1e-30) * 1e-6)


def _tone_mapped(view: RelativeImage, percentile: float) -> npt.NDArray[np.uint8] | None:
    """Return an 8-bit copy with the percentile at white, a channel at a time (as white balance); None if black."""
    whites = np.percentile(view.rgb.reshape(-1, 3), percentile, axis=0)
    if not np.all(whites > 0):
        return None
    return np.asarray(255 * np.clip(view.rgb / whites.astype(np.float32), 0, 1) ** (1 / 2.2), dtype=np.uint8)
