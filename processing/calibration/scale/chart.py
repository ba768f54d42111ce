"""k2: the constant between the two cameras, from one chart in both pictures (Ji et al. 2023, section 3, eq. 2).

Outdoor luminance is ``k1 * k2 * Y_outdoor`` and indoor luminance ``k1 * Y_indoor``, so k2 is the indoor value of a
patch over the outdoor one. The paper takes the white patch. Stray light in either lens adds about the same to every
patch, so that the ratio of the white patch is wrong by it; a straight line through all neutral patches has k2 as its
slope and the difference of both veils as its offset. The chart is looked for in perspective views all around.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
import numpy.typing as npt

from processing.calibration.scale import chart_patches
from processing.calibration.scale.chart_patches import FoundChart
from processing.calibration.scale.luminance import CURVE_FRAC, ScaleFactor
from processing.errors import ChartError
from processing.ground.arrays import Doubles, Flags
from processing.ground.colour import lab_of_linear
from processing.pictures.images import LUMINANCE_WEIGHTS, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import SharedMode
from processing.sphere import Equirectangular, Fisheye, Geometry, Perspective, directions, pixels, point_directions

MAX_MISMATCH = 0.25  # right charts come to 0.02 .. 0.12; turned by half a circle the same ones to more than 0.5.
WHITE_WARNING_FRAC = 0.02  # chosen: the patches' own uncertainty
_MIN_SIGMA = 0.003  # relative, of any patch: paint and angle differ that much between cameras that stand side by side
_RED_BY_BLUE = -0.56
"""Log of red over green by that of blue over green (linear Rec. 709): slope of black bodies from 2856 to 6500 K."""
_HUBER = 1.5  # standard deviations (Huber 1964); chosen


@dataclass(frozen=True)
class PatchPair:
    """A patch in both pictures, the outdoor one scaled by k2."""

    name: str
    indoor: float
    outdoor: float
    residual_stops: float
    """log2 of indoor over the fit's prediction; 0 for patches that are clipped or dark somewhere."""
    color_difference: float
    """CIE 1976 L*a*b*, relative to the white patch."""
    fitted: bool


@dataclass(frozen=True)
class ChartScale:
    """k2 and what it comes from."""

    scale: ScaleFactor
    white_ratio: float
    residual_stops: float
    """Robust rms of the neutral patches about the fit."""
    patches: tuple[PatchPair, ...]


def find_chart(view: RelativeImage, corners_px: npt.ArrayLike | None = None) -> FoundChart:
    """Return the 24-patch chart in a view: found by itself, or at four corners (x, y; in order around the chart).

    ``corners_px``: shape (4, 2), pixels.

    Raises `ChartError`: no chart was found, or what lies at the corners is none; also patches under four pixels.
    """
    if corners_px is not None:
        chart = chart_patches.read_chart(
            view, chart_patches.refined(view, chart_patches.checked_corners(corners_px)), "corners"
        )
        return _sure(chart, "the corners do not enclose the 24-patch chart")
    best: FoundChart | None = None
    for corners in islice(chart_patches.candidates(view), 8):
        try:
            chart = chart_patches.read_chart(view, corners, "cv2.mcc")
        except ChartError:
            continue
        if best is None or chart.mismatch < best.mismatch:
            best = chart
        if best.mismatch < MAX_MISMATCH / 2:
            break
    if best is None:
        text = "no 24-patch chart was found"
        likely = "it is too small, cut off, or glare covers it"
        raise ChartError(text, where="the view", likely=likely, advice="give its four corners: --corners")
    return _sure(best, "what was found does not have the chart's colours")


def scale_from_charts(
    indoor: FoundChart,
    outdoor: FoundChart,
    *,
    shared: tuple[Sequence[SharedMode], Sequence[SharedMode]] = ((), ()),
    colour_frac: float = 0.0,
) -> ChartScale:
    """Return k2 from the same chart in both pictures.

    ``shared``: modes by level of both pictures, beside the least uncertainty by each response curve (`CURVE_FRAC`);
    ``colour_frac``: relative uncertainty of the outdoor luminance by a filter's tint.

    Raises `ChartError`: fewer than three neutral patches are neither clipped nor dark in both.
    """
    numbers = [n for n in chart_patches.NEUTRALS if indoor.usable[n] and outdoor.usable[n]]
    if len(numbers) < 3:
        each = "indoor {}, outdoor {}".format(*(one.usable[chart_patches.WHITE :].sum() for one in (indoor, outdoor)))
        text = f"only {len(numbers)} of 6 neutral patches are neither clipped nor dark in both pictures ({each})"
        advice = "use a white lamp (a warm one clips red where blue is black), nine stops or closer ones"
        raise ChartError(text, where="the chart", advice=advice)
    y_in, y_out = indoor.luminance, outdoor.luminance
    doubt = np.hypot(indoor.uncertainty, outdoor.uncertainty)[numbers]
    fit = _line(y_out[numbers], y_in[numbers], doubt)
    white = chart_patches.WHITE if chart_patches.WHITE in numbers else numbers[0]
    ratio = float(y_in[white] / y_out[white])
    patches = _pairs(indoor, outdoor, fit, white)
    spread = 1.4826 * float(np.median(np.abs(np.array([p.residual_stops for p in patches if p.fitted]))))
    # What a mode adds to all patches of one picture moves the line as a whole.
    moved = [
        _line(y_out[numbers] * (1 + off * (side is outdoor)), y_in[numbers] * (1 + off * (side is indoor)), doubt)
        for side, modes in zip((indoor, outdoor), shared, strict=True)
        for mode in modes
        for off in [mode.of_levels(side.luminance[numbers].astype(np.float32)).astype(np.float64)]
    ]
    # Channels that are balanced differently in both cameras give neutral light another k2 than the lamp.
    balance = outdoor.rgb[numbers].sum(axis=0) / indoor.rgb[numbers].sum(axis=0) * fit.slope
    parts = {
        "fit": fit.sigma,
        "curves": max(math.hypot(*(one.slope / fit.slope - 1 for one in moved)), math.sqrt(2) * CURVE_FRAC),
        "colour": math.hypot(colour_frac, float(balance @ LUMINANCE_WEIGHTS) / sum(LUMINANCE_WEIGHTS) - 1),
    }
    scale = ScaleFactor(
        value=fit.slope,
        relative_uncertainty=math.hypot(*parts.values()),
        parts=parts,
        n_pixels=float(min(indoor.n_pixels[white], outdoor.n_pixels[white])),
        displayed=float(y_out[white]),
        measured=float(y_in[white]),
        warnings=_warnings(ratio, fit, white),
    )
    return ChartScale(scale, ratio, spread, patches)


def spectral_mismatch(luminance: Doubles, usable: Flags, light: float = 0.0) -> float | None:
    """Return by how much a camera's luminances of coloured patches differ from the published ones: relative rms.

    The neutral patches set level and veil. What differs is the camera's match to V(lambda), and some of the chart:
    paint, uneven light. A lamp of few bands adds to it. Not f1' of ISO/CIE 19476, which needs the camera's spectral
    response. None: fewer than three neutral or six coloured patches.

    ``luminance``, ``usable``: shape (24,), of all patches in the published order, in any unit. ``light``: blueness of
    the light on the chart.
    """
    white = np.exp(light * np.array((_RED_BY_BLUE, 0.0, 1.0)))
    known = luminance_cd_m2(chart_patches.reflectances() * white).astype(np.float64)
    neutral = np.isin(np.arange(known.size), chart_patches.NEUTRALS)
    grey, coloured = usable & neutral, usable & ~neutral
    if np.count_nonzero(grey) < 3 or np.count_nonzero(coloured) < 6:
        return None
    fit = _line(known[grey], luminance[grey], np.zeros(int(grey.sum())))
    off = luminance[coloured] / (fit.slope * known[coloured] + fit.offset) - 1
    return float(np.sqrt(np.mean(off**2)))


@dataclass(frozen=True)
class _Line:
    slope: float
    offset: float
    sigma: float
    """Relative standard uncertainty of the slope, from the fit."""


def _line(x: Doubles, y: Doubles, sigma: Doubles) -> _Line:
    """Return the robust line ``y = slope x + offset`` for relative errors; through 0 for three points."""
    relative = np.maximum(sigma, _MIN_SIGMA)
    columns = np.stack([x, np.ones_like(x)], axis=1) if x.size > 3 else x[:, None]
    error, huber = relative * y, np.ones_like(y)
    for _ in range(30):
        weight = np.sqrt(huber) / error
        found, *_ = np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=None)
        pull = np.abs(columns @ found - y) / error
        huber = np.minimum(1, _HUBER / np.maximum(pull, 1e-12))
    covariance = np.linalg.inv((columns * weight[:, None]).T @ (columns * weight[:, None]))
    excess = max(1.0, float(np.sum(huber * pull**2)) / max(x.size - columns.shape[1], 1))
    slope, offset = float(found[0]), float(found[1]) if columns.shape[1] > 1 else 0.0
    if not slope > 0:
        raise ChartError("the two pictures of the chart disagree", where="the neutral patches")
    return _Line(slope, offset, math.sqrt(float(covariance[0, 0]) * excess) / slope)


def _pairs(indoor: FoundChart, outdoor: FoundChart, fit: _Line, white: int) -> tuple[PatchPair, ...]:
    y_in, y_out = indoor.luminance, outdoor.luminance * fit.slope
    residual = np.log2(np.maximum(y_in, 1e-30) / np.maximum(y_out + fit.offset, 1e-30))
    lab_in, lab_out = (lab_of_linear(chart.rgb, chart.rgb[white]) for chart in (indoor, outdoor))
    differences = np.linalg.norm(lab_in - lab_out, axis=1)
    both = indoor.usable & outdoor.usable
    return tuple(
        PatchPair(
            name,
            max(float(y_in[n]), 0.0),
            max(float(y_out[n]), 0.0),
            float(residual[n]) if both[n] else 0.0,
            float(differences[n]),
            bool(n in chart_patches.NEUTRALS and both[n]),
        )
        for n, name in enumerate(chart_patches.PATCH_NAMES)
    )


def _warnings(ratio: float, fit: _Line, white: int) -> tuple[str, ...]:
    found = []
    if white != chart_patches.WHITE:
        found.append(f"the white patch is clipped or dark: {chart_patches.PATCH_NAMES[white]} stands for it")
    if abs(ratio / fit.slope - 1) > WHITE_WARNING_FRAC:
        found.append(
            f"white patch {ratio:.4g} and fit of all neutral patches {fit.slope:.4g} differ by "
            f"{ratio / fit.slope - 1:+.1%}: stray light, glare on the chart, or a wrong response curve"
        )
    return tuple(found)


def _sure(chart: FoundChart, message: str) -> FoundChart:
    if chart.mismatch > MAX_MISMATCH:
        text = f"{message} (they differ by {chart.mismatch:.0%})"
        raise ChartError(text, where="the view", advice="give the chart's four corners in order around it: --corners")
    return chart


_FOV_RAD = math.radians(75)  # chosen
_MAX_PX = 1800  # chosen, for time
_SURE_MISMATCH = 0.12  # right charts come to less: see `MAX_MISMATCH`


@dataclass(frozen=True)
class ChartView:
    """A view with the chart in it."""

    view: RelativeImage
    chart: FoundChart


def cut(image: RelativeImage, view: Perspective) -> RelativeImage:
    """Return a perspective view of a picture: colours between pixels bilinearly, the rest of the nearest pixel."""
    import cv2

    ways, _ = directions(view)
    x, y, seen = pixels(image.geometry, ways)
    high, wide = image.validity.shape
    column, row = np.floor(np.where(seen, x, 0)).astype(np.intp), np.floor(np.where(seen, y, 0)).astype(np.intp)
    column, row = np.clip(column, 0, wide - 1), np.clip(row, 0, high - 1)
    border = cv2.BORDER_WRAP if isinstance(image.geometry, Equirectangular) else cv2.BORDER_REPLICATE
    at = ((np.where(seen, x, 0) - 0.5).astype(np.float32), (np.where(seen, y, 0) - 0.5).astype(np.float32))
    rgb = np.asarray(cv2.remap(image.rgb, *at, cv2.INTER_LINEAR, borderMode=border), dtype=np.float32)
    rgb[~seen] = 0
    return RelativeImage(
        rgb=rgb,
        uncertainty=np.where(seen, image.uncertainty[row, column], np.float32(np.inf)),
        validity=np.where(seen, image.validity[row, column], np.uint8(Validity.OUTSIDE)).astype(np.uint8),
        geometry=view,
        attributes=image.attributes,
    )


def find_chart_around(image: RelativeImage, towards: Doubles | None = None) -> ChartView:
    """Return the chart, looked for towards a direction first (where one is given), then all around.

    ``towards``: direction of shape (3,), any length.

    Raises `ChartError`: no view shows a chart.
    """
    best: ChartView | None = None
    for view in _views(image.geometry, towards):
        picture = cut(image, view)
        try:
            found = ChartView(picture, find_chart(picture))
        except ChartError:
            continue
        if best is None or found.chart.mismatch < best.chart.mismatch:
            best = found
        if best.chart.mismatch < _SURE_MISMATCH:
            return best
    if best is None:
        text = "no 24-patch chart was found in the picture"
        advice = "give its four corners: --corners SIDE:X,Y,X,Y,X,Y,X,Y in pixels of the frames"
        raise ChartError(text, likely="it is too small, cut off, or glare covers it", advice=advice)
    return best


def chart_at(image: RelativeImage, corners_px: npt.ArrayLike) -> ChartView:
    """Return the chart whose corners are at four points (x, y) of the picture itself.

    ``corners_px``: shape (4, 2), pixels.

    Raises `ChartError`: a corner outside the picture's field, or no chart there.
    """
    corners = np.asarray(corners_px, dtype=np.float64).reshape(-1, 2)
    ways, seen = point_directions(image.geometry, corners[:, 0], corners[:, 1])
    if len(corners) != 4 or not np.all(seen):
        raise ChartError("four corners inside the picture are needed", where="corners", advice="X,Y four times")
    middle = ways.mean(axis=0)
    reach = float(np.max(np.arccos(np.clip(ways @ (middle / np.linalg.norm(middle)), -1, 1))))
    view = _view(image.geometry, middle, min(2.6 * reach, math.radians(120)))
    x, y, _ = pixels(view, ways)
    picture = cut(image, view)
    return ChartView(picture, find_chart(picture, np.stack([x, y], axis=1)))


def _views(geometry: Geometry, towards: Doubles | None) -> Iterator[Perspective]:
    if towards is not None:
        yield _view(geometry, towards, _FOV_RAD)
        yield _view(geometry, towards, _FOV_RAD / 2)
    if isinstance(geometry, Perspective):
        yield geometry
        return
    rings = ((90, 1), (45, 6)) if isinstance(geometry, Fisheye) else ((0, 8), (40, 6), (-40, 6))
    for height_deg, count in rings:
        for turn in range(count):
            angle, height = 2 * math.pi * turn / count, math.radians(height_deg)
            flat = math.cos(height)
            ahead = np.array((flat * math.sin(angle), flat * math.cos(angle), math.sin(height)))
            yield _view(geometry, ahead, _FOV_RAD)


def _view(geometry: Geometry, towards: Doubles, fov_rad: float) -> Perspective:
    """Return a view as fine as the picture is, of 4:3."""
    if isinstance(geometry, Fisheye):
        pixel_rad = geometry.half_field_rad / geometry.radius_px / 1.1
    elif isinstance(geometry, Equirectangular):
        pixel_rad = 2 * math.pi / geometry.width_px
    else:
        pixel_rad = geometry.fov_x_rad / geometry.width_px
    wide = int(min(max(2 * math.tan(fov_rad / 2) / pixel_rad, 120), _MAX_PX))
    x, y, z = np.asarray(towards, dtype=np.float64) / np.linalg.norm(towards)
    return Perspective(wide, wide * 3 // 4, fov_rad, math.atan2(x, y), math.asin(float(np.clip(z, -1, 1))))
