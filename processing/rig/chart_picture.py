"""The found chart as a picture, so that a person can check that it is the chart and the right way up."""

from __future__ import annotations

from processing.ground.arrays import Bytes

import numpy as np

from processing.calibration.chart_patches import WHITE, WINDOW, chart_points, homography
from processing.calibration.chart_views import ChartView

_CORNER = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1))) * WINDOW / 2


def chart_png(found: ChartView) -> bytes:
    """Return a PNG: the view with white at 90 %, the windows that were averaged, the white patch's in red."""
    import cv2

    picture = _shown(found)
    mapping = homography(found.chart.corners_px)
    width = max(1, picture.shape[1] // 600)
    middles = chart_points(mapping, 0.0, 1)[:, 0]
    for number in range(24):
        window = np.array((number % 6 + 0.5, number // 6 + 0.5)) + _CORNER
        flat = np.column_stack([window, np.ones(4)]) @ mapping.T
        outline = np.rint(flat[:, :2] / flat[:, 2:]).astype(np.int32)
        colour = (0, 0, 255) if number == WHITE else (0, 255, 0)
        cv2.polylines(picture, [outline[:, None]], True, colour, width, cv2.LINE_AA)
    x, y = middles[WHITE]
    cv2.putText(picture, "white", (int(x), int(y)), cv2.FONT_HERSHEY_SIMPLEX, 0.4 * width, (0, 0, 255), width)
    done, data = cv2.imencode(".png", picture)
    assert done
    return bytes(data)


def _shown(found: ChartView) -> Bytes:
    """Return the view in 8 bits, blue first as cv2 wants it."""
    white = max(float(found.chart.rgb[WHITE].mean()), 1e-30)
    values = 0.9 * np.clip(found.view.rgb / np.float32(white), 0, 1 / 0.9)
    return np.ascontiguousarray((255 * values ** (1 / 2.2))[..., ::-1].astype(np.uint8))
