"""Pictures of numbers: luminance in false colours on a logarithmic scale, uncertainty, and what pixels are worth.

All take and give arrays; colours are 8-bit sRGB (H, W, 3). The same input gives the same bytes.
"""

import math

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Floats
from processing.pictures.images import Validity

NO_DATA = (64, 64, 68)  # grey of pixels that have no value (0, not finite)
VALIDITY_COLOURS: dict[Validity, tuple[int, int, int]] = {
    Validity.CLIPPED: (230, 30, 30),
    Validity.DARK: (50, 90, 235),
    Validity.OUTSIDE: NO_DATA,
    Validity.REPAIRED: (255, 160, 0),
}
GHOST_COLOUR = (0, 200, 120)  # RGB
UNCERTAINTY_RANGE = (0.001, 1.0)  # relative; chosen

_STEPS = (1.0, 3.0)  # of a decade: ends of scales
_TICKS = (1.0, 2.0, 5.0)  # of a decade
_LEVELS = 256  # colours of a scale
_ROWS = 256  # at a time, for memory
_PAPER, _INK = (255, 255, 255), (20, 20, 24)  # RGB


def false_colour(luminance: npt.ArrayLike, low: float, high: float, *, colours: str = "turbo") -> Bytes:
    """Return luminance (H, W) in the colours ``turbo`` or ``viridis``, logarithmic from ``low`` to ``high``.

    Outside the range the end's colour; grey where there is no value (0 or less, not finite). Raises `ParameterError`
    unless 0 < low < high.
    """
    _check_range(low, high)
    values = np.asarray(luminance)
    table = _table(colours)
    out = np.empty((*values.shape, 3), dtype=np.uint8)
    for top in range(0, values.shape[0], _ROWS):
        rows = values[top : top + _ROWS]
        shown = np.isfinite(rows) & (rows > 0)
        share = np.log(np.where(shown, rows, low) / low) / math.log(high / low)
        out[top : top + _ROWS] = table[np.clip(share * _LEVELS, 0, _LEVELS - 1).astype(np.intp)]
        out[top : top + _ROWS][~shown] = NO_DATA
    return out


def display_range(luminance: npt.ArrayLike) -> tuple[float, float]:
    """Return a scale's ends, 1 or 3 times a power of ten, that hold 99.8 % of the values above 0; 1 to 10 of none.

    ``luminance``: any shape and unit.
    """
    values = np.asarray(luminance, dtype=np.float64)
    values = values[np.isfinite(values) & (values > 0)]
    if not values.size:
        return 1.0, 10.0
    ends = np.quantile(values, (0.001, 0.999), method="nearest")
    low, high = _step(float(ends[0]), up=False), _step(float(ends[1]), up=True)
    return low, high if high >= 3 * low else _step(1.01 * low, up=True)


def uncertainty_picture(uncertainty: Floats) -> Bytes:
    """Return relative standard uncertainty (H, W), 0.1 % to 100 %, logarithmic in ``viridis``; grey: nothing known."""
    return false_colour(np.where(np.isfinite(uncertainty), uncertainty, 0), *UNCERTAINTY_RANGE, colours="viridis")


def validity_overlay(rgb8: Bytes, validity: Bytes, ghost: Bytes | None = None) -> Bytes:
    """Return a picture, greyed, with pixels that are not valid in their colours, and edges of what moved in green.

    ``rgb8``: (H, W, 3); ``validity``, ``ghost``: (H, W).
    """
    import cv2

    grey = rgb8.mean(axis=2, dtype=np.float32) * np.float32(0.8)
    out = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
    for code, colour in VALIDITY_COLOURS.items():
        out[validity == code] = colour
    if ghost is not None:
        moved = (ghost > 0).astype(np.uint8)
        out[moved > 0] = out[moved > 0] // 2 + np.array(GHOST_COLOUR, dtype=np.uint8) // 2
        out[(moved > 0) & (cv2.erode(moved, np.ones((3, 3), np.uint8)) == 0)] = GHOST_COLOUR
    return out


def legend(low: float, high: float, unit: str, height: int, *, colours: str = "turbo") -> Bytes:
    """Return the scale beside a picture of this height: colours, ticks at 1, 2, 5 and their decades, and the unit.

    Decades alone where there is no room for all. Raises `ParameterError` unless 0 < low < high. The result is (H, W, 3)
    uint8 RGB, H the height asked for.
    """
    import cv2

    _check_range(low, high)
    width, top, bar = 110, 30, 22
    out = np.full((max(height, 80), width, 3), _PAPER, dtype=np.uint8)
    length = out.shape[0] - 2 * top
    ramp = np.geomspace(high, low, length)[:, None]
    out[top : top + length, 8 : 8 + bar] = false_colour(np.repeat(ramp, bar, axis=1), low, high, colours=colours)
    for value in legend_ticks(low, high, length // 18):
        y = top + round(math.log(high / value) / math.log(high / low) * (length - 1))
        cv2.line(out, (8 + bar, y), (8 + bar + 5, y), _INK, 1)
        cv2.putText(out, _label(value), (8 + bar + 9, y + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
    cv2.putText(out, unit, (8, top - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
    return out


def legend_ticks(low: float, high: float, at_most: int) -> list[float]:
    """Return round values from ``low`` to ``high``: 1, 2, 5 of each decade, or fewer where there is no room."""
    first, last = math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1
    for steps in (_TICKS, _STEPS, (1.0,)):
        values = [step * 10.0**power for power in range(first, last) for step in steps]
        ticks = [value for value in values if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
        if len(ticks) <= max(at_most, 2):
            return ticks
    return ticks[:: math.ceil(len(ticks) / max(at_most, 2))]


def with_legend(picture: Bytes, scale: Bytes) -> Bytes:
    """Return a picture with a legend of the same height, or higher, at its right. Both (H, W, 3) uint8 RGB."""
    height = max(picture.shape[0], scale.shape[0])
    padded = [np.full((height, part.shape[1], 3), _PAPER, dtype=np.uint8) for part in (picture, scale)]
    for whole, part in zip(padded, (picture, scale), strict=True):
        whole[: part.shape[0]] = part
    return np.concatenate(padded, axis=1)


def _check_range(low: float, high: float) -> None:
    if not (math.isfinite(low) and math.isfinite(high) and 0 < low < high):
        raise ParameterError(f"a logarithmic scale goes from above 0 to more, not from {low} to {high}")


def _table(colours: str) -> Bytes:
    import cv2

    names = {"turbo": cv2.COLORMAP_TURBO, "viridis": cv2.COLORMAP_VIRIDIS}
    if colours not in names:
        raise ParameterError(f"unknown colours {colours!r}", advice=f"one of {', '.join(names)}")
    levels = np.arange(_LEVELS, dtype=np.uint8)[:, None]
    return np.ascontiguousarray(cv2.applyColorMap(levels, names[colours])[:, 0, ::-1])


def _step(value: float, *, up: bool) -> float:
    """Return the nearest 1 or 3 times a power of ten above (or below) a value."""
    power = math.floor(math.log10(value))
    around = [step * 10.0**exponent for exponent in (power - 1, power, power + 1) for step in _STEPS]
    beyond = [one for one in around if (one >= value * (1 - 1e-9) if up else one <= value * (1 + 1e-9))]
    return min(beyond) if up else max(beyond)


def _label(value: float) -> str:
    return f"{value:g}" if 1e-3 <= value < 1e5 else f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
