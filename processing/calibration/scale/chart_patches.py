"""The 24-patch colour chart: its colours, where its patches lie in a picture, and what they show."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processing.calibration.scale.luminance import NEIGHBOURS
from processing.errors import ChartError
from processing.ground.arrays import Doubles, Flags, Indices
from processing.ground.colour import srgb_decoded
from processing.ground.tables import table_of
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2

COLUMNS, ROWS = 6, 4  # of the 24-patch chart
_SRGB: dict[str, int] = table_of(__package__, "chart")
PATCH_NAMES = tuple(_SRGB)
NEUTRALS = tuple(range(18, 24))  # its last row
WHITE = 18  # number of the white patch
WINDOW = 0.5  # of a patch's pitch: what is averaged; frames and the blur of edges stay outside
_GRID = 14  # samples across a patch; chosen
MAX_INVALID_FRAC = 0.1  # of a patch; chosen
MIN_PIXELS = 4  # across a patch; chosen


@dataclass(frozen=True)
class FoundChart:
    """A chart in a picture. Values are the picture's own (relative) ones, patches in the published order."""

    corners_px: Doubles
    """(4, 2): x, y of the grid's corners at dark skin, bluish green, black, white (as one reads the chart)."""
    rgb: Doubles
    """(24, 3): robust means."""
    uncertainty: Doubles
    """(24,): relative standard uncertainty of the luminances by noise; inf where a patch is clipped or dark."""
    n_pixels: Indices
    """(24,)."""
    mismatch: float
    """Relative rms by which the colours differ from a chart's under the best light; 0.1 and less is sure."""
    how: str
    """Who found it: "cv2.mcc" or "corners"."""

    @property
    def luminance(self) -> Doubles:
        """Return the patches' relative luminances, >= 0, of shape (24,)."""
        return luminance_cd_m2(self.rgb).astype(np.float64)

    @property
    def usable(self) -> Flags:
        """Return which patches are neither clipped nor dark, of shape (24,)."""
        return np.asarray(np.isfinite(self.uncertainty) & (self.luminance > 0))


def reflectances() -> Doubles:
    """Return the linear Rec. 709 reflectances, 0..1, of the published colours, of shape (24, 3)."""
    return srgb_decoded(np.array([[code >> 16, code >> 8 & 255, code & 255] for code in _SRGB.values()]) / 255)


def homography(corners_px: Doubles) -> Doubles:
    """Return the (3, 3) mapping from chart coordinates (x 0..6, y 0..4, dark skin first) to the picture.

    ``corners_px``: shape (4, 2), pixels, in order around the chart.
    """
    grid = ((0.0, 0.0), (COLUMNS, 0.0), (COLUMNS, ROWS), (0.0, ROWS))
    rows = []
    for (u, v), (x, y) in zip(grid, np.asarray(corners_px, dtype=np.float64), strict=True):
        rows += [[u, v, 1, 0, 0, 0, -u * x, -v * x, -x], [0, 0, 0, u, v, 1, -u * y, -v * y, -y]]
    _, sizes, ways = np.linalg.svd(np.array(rows))
    if sizes[-1] < 1e-9 * sizes[0]:
        raise ChartError("the four corners do not span a chart", where="corners", advice="give them in order around it")
    return np.asarray(ways[-1].reshape(3, 3))


def checked_corners(corners_px: npt.ArrayLike) -> Doubles:
    """Return four corners in pixels, of shape (4, 2); `ChartError` for anything else."""
    corners = np.asarray(corners_px, dtype=np.float64)
    if corners.shape != (4, 2) or not np.all(np.isfinite(corners)):
        raise ChartError("four corners of two numbers are needed", where="corners", advice="give X,Y four times")
    return corners


def check_corners(corners_px: npt.ArrayLike, size_px: tuple[int, int]) -> None:
    """Raise `ChartError` where four corners (4, 2) cannot be a chart's in a frame (width, height): nothing is read."""
    corners = checked_corners(corners_px)
    (x, y), (far_x, far_y) = corners.T, np.roll(corners, 1, axis=0).T
    patch_px = 0.5 * abs(float(x @ far_y - y @ far_x)) * WINDOW**2 / (COLUMNS * ROWS)
    if np.any(corners < 0) or np.any(corners > size_px):
        raise ChartError("a corner of the chart lies outside the frame", where="corners", advice=f"frames: {size_px}")
    if patch_px < MIN_PIXELS:
        text = f"the corners leave {patch_px:.1f} pixels per patch of the chart"
        raise ChartError(text, where="corners", advice="give them in order around the chart, in pixels of the frames")


def chart_points(mapping: Doubles, window: float, grid: int) -> Doubles:
    """Return picture points (24, grid * grid, 2) spread over the middles of all patches.

    ``mapping``: shape (3, 3), as `homography` gives it; ``window``: share of a patch's side.
    """
    step = ((np.arange(grid) + 0.5) / grid - 0.5) * window
    column, row = np.arange(24) % COLUMNS + 0.5, np.arange(24) // COLUMNS + 0.5
    u = column[:, None, None] + step[None, None, :] + 0 * step[None, :, None]
    v = row[:, None, None] + step[None, :, None] + 0 * step[None, None, :]
    return np.asarray(cv2.perspectiveTransform(np.stack([u.reshape(24, -1), v.reshape(24, -1)], axis=-1), mapping))


def read_chart(view: RelativeImage, corners_px: Doubles, how: str) -> FoundChart:
    """Return the chart at four corners, whichever way up they were given.

    ``corners_px``: shape (4, 2), pixels.

    Raises `ChartError`: the corners lie outside, patches are smaller than four pixels, or what is there is no such
    chart.
    """
    corners = checked_corners(corners_px)
    read = [_read(view, np.roll(corners, turn, axis=0), how) for turn in range(4)]
    best = min(read, key=lambda chart: chart.mismatch)
    if not np.any(best.usable):
        raise ChartError(
            "every patch is clipped or dark", where="the chart", advice="capture the chart with all nine stops"
        )
    return best


def _read(view: RelativeImage, corners_px: Doubles, how: str) -> FoundChart:
    high, wide = view.validity.shape
    points = np.floor(chart_points(homography(corners_px), WINDOW, _GRID)).astype(np.intp)
    if points.min() < 0 or points[..., 0].max() >= wide or points[..., 1].max() >= high:
        raise ChartError("the chart is not entirely in the picture", where="corners", advice="turn the view towards it")
    rgb, uncertainty, count = np.zeros((24, 3)), np.full(24, np.inf), np.zeros(24, dtype=np.intp)
    for number, patch in enumerate(points):
        place = np.unique(patch[:, 1] * wide + patch[:, 0])
        if place.size < MIN_PIXELS:
            raise ChartError(
                f"its patches are only {place.size} pixels large", where="the chart", advice="move the chart nearer"
            )
        rgb[number], uncertainty[number] = _mean(view, place // wide, place % wide)
        count[number] = place.size
    return FoundChart(corners_px, rgb, uncertainty, count, _mismatch(rgb, np.isfinite(uncertainty)), how)


def _mean(view: RelativeImage, row: Indices, column: Indices) -> tuple[Doubles, float]:
    """Return a patch's mean colour without its outermost tenths, and the relative uncertainty of its luminance."""
    values = view.rgb[row, column].astype(np.float64)
    level = luminance_cd_m2(values).astype(np.float64)
    order = np.argsort(level, kind="stable")
    cut = level.size // 10
    kept = order[cut : level.size - cut]
    mean = values[kept].mean(axis=0)
    claimed = view.uncertainty[row, column].astype(np.float64)[kept]
    invalid = float(np.mean(view.validity[row, column] != Validity.VALID))
    light = float(level[kept].mean())
    if invalid > MAX_INVALID_FRAC or not light > 0 or not np.all(np.isfinite(claimed)):
        return mean, float("inf")
    noise2 = max(float(np.mean(claimed**2)), float(np.mean((level[kept] / light - 1) ** 2)))
    return mean, float(np.sqrt(noise2 / max(kept.size / NEIGHBOURS, 1.0)))


def _mismatch(rgb: Doubles, usable: Flags) -> float:
    """Return the relative rms by which colours differ from ``reflectances @ M``, for the best 3x3 light M."""
    if np.count_nonzero(usable) < 8:
        return float("inf")
    known, seen = reflectances()[usable], rgb[usable]
    weight = 1 / luminance_cd_m2(known).astype(np.float64)[:, None]
    light, *_ = np.linalg.lstsq(known * weight, seen * weight, rcond=None)
    scale = float(np.mean(np.abs(light.sum(axis=0))))
    if not scale > 0:
        return float("inf")
    return float(np.sqrt(np.mean(((known @ light - seen) * weight) ** 2)) / scale)


# Finding the colour chart: OpenCV's detector on tone-mapped copies, then corners moved to where the chart fits best.
#
# Best is where each patch is even and the lines between patches, which are the chart's dark frame, are dark.


_WORK_PX = (480, 960)  # picture widths that the detector works at: patches of 15 to 100 pixels suit it
_WHITE_PERCENTILES = (99.0, 90.0, 99.9)  # exposures that are tried; chosen
_EVEN_WINDOW = 0.74  # of a patch's side; chosen
_EVEN_GRID = 9  # samples across a patch; chosen
_FRAME_WEIGHT = 0.3  # of dark frames beside even patches; chosen
_LINE_POINTS = 48  # samples along the frame; chosen


def candidates(view: RelativeImage) -> Iterator[Doubles]:
    """Yield corners in pixels, of shape (4, 2), of what may be the chart, the likeliest first."""
    for percentile in _WHITE_PERCENTILES:
        # An 8-bit copy with the percentile at white, a channel at a time (as white balance)
        whites = np.percentile(view.rgb.reshape(-1, 3), percentile, axis=0)
        if not np.all(whites > 0):
            return
        tones = np.asarray(255 * np.clip(view.rgb / whites.astype(np.float32), 0, 1) ** (1 / 2.2), dtype=np.uint8)
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
    """Return the corners moved by fractions of a patch to where patches are most even and the frame is darkest.

    ``corners_px`` and the result: shape (4, 2), pixels.
    """
    from scipy.optimize import minimize

    luminance = luminance_cd_m2(view.rgb)
    least = max(float(luminance.max()), 1e-30) * 1e-6  # keeps logarithms finite
    level = np.log2(np.maximum(luminance, np.float32(least))).astype(np.float64)
    pitch_px = float(np.linalg.norm(corners_px[1] - corners_px[0])) / 6

    def unfit(moves: Doubles) -> float:
        mapping = homography(corners_px + moves.reshape(4, 2) * pitch_px)
        patches = _sampled(level, chart_points(mapping, _EVEN_WINDOW, _EVEN_GRID))
        # Picture points along all lines between and around the patches
        along = np.linspace(0, 1, _LINE_POINTS)
        down = [np.stack([np.full_like(along, u), along * ROWS], axis=1) for u in range(COLUMNS + 1)]
        across = [np.stack([along * COLUMNS, np.full_like(along, v)], axis=1) for v in range(ROWS + 1)]
        frame = _sampled(level, np.asarray(cv2.perspectiveTransform(np.stack(down + across), mapping)))
        unevenness = float(np.minimum(patches.std(axis=1), 1.0).mean())
        return unevenness + _FRAME_WEIGHT * float(frame.mean() - patches.mean())

    start = np.zeros((9, 8))
    start[1:] += 0.15 * np.eye(8)
    found = minimize(
        unfit, start[0], method="Nelder-Mead", options={"initial_simplex": start, "maxfev": 400, "xatol": 0.005}
    )
    return np.asarray(corners_px + np.asarray(found.x).reshape(4, 2) * pitch_px)


def _sampled(plane: Doubles, points: Doubles) -> Doubles:
    """Return the plane at points, bilinearly between pixel centres; beyond the picture its nearest pixel."""
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(plane, [points[..., 1] - 0.5, points[..., 0] - 0.5], order=1, mode="nearest"))
