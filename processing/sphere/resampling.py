"""From one picture of the sphere to another: keeping energy, or fast.

``area`` is for light: it keeps sums of radiance times solid angle (`processing.sphere.resampling_area`). ``bilinear``
samples the source at the target's pixel centres: smoother where pixels grow, wrong where they shrink.
"""

import math
from collections.abc import Iterator
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Flags, Floats, bands
from processing.ground.kernels import compiled, inner
from processing.sphere import Equirectangular, Fisheye, Geometry, directions, pixels
from processing.sphere.resampling_area import area_resample

# Linear interpolation of float32 pictures with exact positions, whatever the number of channels.


def linear_samples(picture: Floats, x: Floats, y: Floats, border: int = cv2.BORDER_REPLICATE) -> Floats:
    """Return samples (h, w) or (h, w, C) of a picture; ``x``, ``y`` (h, w) count from the first pixel's centre.

    OpenCV's remap keeps float positions for 1, 3 and 4 channels and rounds them to 1/32 pixel for other numbers (5.0),
    so the channels are taken in such groups. ``picture``: (H, W) or (H, W, C) float32; ``border``: OpenCV's border
    mode.
    """
    if picture.ndim == 2 or picture.shape[2] in (1, 3, 4):
        found = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=border)
        return np.asarray(found, dtype=np.float32).reshape(*x.shape, *picture.shape[2:])
    out = np.empty((*x.shape, picture.shape[2]), dtype=np.float32)
    start = 0
    while start < picture.shape[2]:
        left = picture.shape[2] - start
        count = 4 if left >= 4 else 3 if left == 3 else 1
        group = np.ascontiguousarray(picture[..., start : start + count])
        out[..., start : start + count] = linear_samples(group, x, y, border)
        start += count
    return out


# Cubic interpolation (Keys 1981, a = -1/2: exact for quadratics), exact weights, held within its 16 pixels (compiled).
#
# OpenCV's cubic has a = -3/4 and rounds positions to 1/32 pixel: 0.05 of a pixel's step of error, more than linear.


def cubic_samples(picture: Floats, x: Floats, y: Floats) -> Floats:
    """Return (h, w, C) samples of a float32 picture (H, W, C); ``x``, ``y`` (h, w) count from the first pixel's centre.

    Beyond the borders the last pixel is repeated. No sample is outside the range of the 16 pixels it is made of.
    """
    out = np.empty((*x.shape, picture.shape[2]), dtype=np.float32)
    _sample(np.ascontiguousarray(picture), x, y, out)
    return out


@inner
def _weights(t: float, into: Any) -> None:
    into[0] = t * (-0.5 + t * (1.0 - 0.5 * t))
    into[1] = 1.0 + t * t * (-2.5 + 1.5 * t)
    into[2] = t * (0.5 + t * (2.0 - 1.5 * t))
    into[3] = t * t * (-0.5 + 0.5 * t)


@compiled
def _sample(picture: Any, x: Any, y: Any, out: Any) -> None:
    height, width, channels = picture.shape
    across, down = np.empty(4), np.empty(4)
    column, row = np.empty(4, np.int64), np.empty(4, np.int64)
    for j in range(x.shape[0]):
        for i in range(x.shape[1]):
            fx, fy = np.floor(x[j, i]), np.floor(y[j, i])
            _weights(x[j, i] - fx, across)
            _weights(y[j, i] - fy, down)
            for k in range(4):
                column[k] = min(max(int(fx) + k - 1, 0), width - 1)
                row[k] = min(max(int(fy) + k - 1, 0), height - 1)
            for c in range(channels):
                total, low, high = 0.0, np.inf, -np.inf
                for v in range(4):
                    line = 0.0
                    for u in range(4):
                        value = picture[row[v], column[u], c]
                        line += across[u] * value
                        low, high = min(low, value), max(high, value)
                    total += down[v] * line
                out[j, i, c] = min(max(total, low), high)


Method = Literal["area", "bilinear"]

PAD_PX = 2  # pixels beyond seam and poles that cubic interpolation may ask for
LARGEST_PX = 32_000  # of a picture's sides: OpenCV's limit, less the padding
PIXELS_AT_ONCE = 1 << 20  # for memory
LEAST_WEIGHT = 1e-3  # of what is known around a sample, below which it is taken as unknown


def resample(
    rgb: npt.ArrayLike,
    source: Geometry,
    target: Geometry,
    *,
    method: Method = "area",
    weights: npt.ArrayLike | None = None,
    near: Flags | None = None,
) -> tuple[Floats, Floats]:
    """Return a picture in another geometry and how much of each pixel is covered.

    ``rgb`` (H, W) or (H, W, C) of the source's size; finite.
    ``method``: ``area``: exact overlaps, keeps energy, never rings. ``bilinear``: samples at pixel centres.
    ``weights`` (H, W), 0..1: what each source pixel is worth (0: invalid, its value is not used). None: all that lies
      in the field counts, pixels cut by a fisheye's edge too.
    ``near`` (H, W), of ``area``: where overlaps must be exact; None: everywhere. Elsewhere weights must be 1, and cells
      are taken for boxes of the same widths, which is exact where light changes evenly.

    Returns the picture, float32 (h, w) or (h, w, C), 0 where nothing is known, and the coverage, float32 (h, w) in
    0..1: the share of the pixel that valid source pixels cover (``area``), or the weight found at its centre. Raises
    `ParameterError`: sizes that do not fit, values that are not finite, weights outside 0..1, an unknown method.
    """
    picture, flat = _checked(rgb, source)
    known = _checked_weights(weights, source)
    if method == "area":
        values, coverage = area_resample(picture, source, target, known, near)
    elif method == "bilinear":
        values, coverage = _sampled(picture, source, target, known)
    else:
        raise ParameterError(f"no resampling method {method!r}", advice="choose area or bilinear")
    return (values[..., 0] if flat else values), coverage


def resample_labels(labels: npt.NDArray[np.generic], source: Geometry, target: Geometry) -> npt.NDArray[np.generic]:
    """Return a mask or class map (H, W) in another geometry, by the nearest pixel; 0 where none is seen."""
    if labels.shape != (source.height_px, source.width_px):
        raise ParameterError(f"a mask of shape {labels.shape} for {source}", advice="give (H, W) of the source's size")
    out = np.zeros((target.height_px, target.width_px), dtype=labels.dtype)
    for rows, x, y, seen in _centres(source, target) if np.any(labels) else ():
        column = np.clip(x.astype(np.intp), 0, source.width_px - 1)
        row = np.clip(y.astype(np.intp), 0, source.height_px - 1)
        out[rows] = np.where(seen, labels[row, column], out[rows])
    return out


def resample_uncertainty(uncertainty: npt.ArrayLike, source: Geometry, target: Geometry) -> Floats:
    """Return relative standard uncertainties (H, W) in another geometry; inf where less than half is known.

    Neighbours are taken to err together (demosaicing and JPEG make it so): variances are averaged, not reduced.
    """
    u = np.asarray(uncertainty, dtype=np.float32)
    if np.isnan(u).any() or (u < 0).any():
        raise ParameterError("uncertainties that are NaN or negative", advice="give inf where nothing is known")
    known = np.isfinite(u)
    # Squares of finite float32 may overflow; beyond 1e9 nothing is known anyway.
    squares = np.minimum(np.where(known, u, 0.0), 1e9) ** 2
    variance, share = resample(squares, source, target, weights=known.astype(np.float32))
    return np.where(share >= 0.5, np.sqrt(variance), np.float32(np.inf)).astype(np.float32)


def padded_sphere(picture: Floats, pad_px: int = PAD_PX) -> Floats:
    """Return an equirectangular picture with what lies beyond its borders: round the seam, and over the poles.

    ``picture``: (H, W) or (H, W, C); the result is 2 ``pad_px`` larger each way.
    """
    width = picture.shape[1]
    half, rows = width // 2, min(pad_px, picture.shape[0])

    def beyond(part: Floats) -> Floats:
        turned = np.roll(part[::-1], half, axis=1)
        if width % 2:
            # The other side lies between two columns.
            turned = np.asarray((turned + np.roll(turned, 1, axis=1)) / 2, dtype=np.float32)
        return turned if rows == pad_px else np.repeat(turned, pad_px, axis=0)[:pad_px]

    tall = np.concatenate([beyond(picture[:rows]), picture, beyond(picture[picture.shape[0] - rows :])])
    return tall[:, np.arange(-pad_px, width + pad_px) % width]


def _sampled(picture: Floats, source: Geometry, target: Geometry, weights: Floats) -> tuple[Floats, Floats]:
    if max(source.width_px, source.height_px) > LARGEST_PX:
        raise ParameterError(f"a picture of {source.width_px} x {source.height_px} px", advice="use method='area'")
    known = weights * _in_field(source)
    whole = bool(known.all()) and float(known.min()) == 1.0
    # Infinitely bright beside dark: products of value and weight keep invalid pixels out of the sums.
    light = picture if whole else picture * known[..., None]
    around = isinstance(source, Equirectangular)
    pad = PAD_PX if around else 0
    if around:
        light, known = padded_sphere(light), padded_sphere(known)
    out = np.zeros((target.height_px, target.width_px, picture.shape[2]), dtype=np.float32)
    coverage = np.zeros(out.shape[:2], dtype=np.float32)
    for rows, x, y, seen in _centres(source, target):
        at_x, at_y = (x + (pad - 0.5)).astype(np.float32), (y + (pad - 0.5)).astype(np.float32)
        weight = np.ones(seen.shape, np.float32) if whole else linear_samples(known, at_x, at_y)
        value = linear_samples(light, at_x, at_y)
        ok = seen & (weight > LEAST_WEIGHT)
        if not whole:
            # The values were multiplied by their weights.
            value /= np.maximum(weight, LEAST_WEIGHT)[..., None]
        out[rows] = np.where(ok[..., None], value, 0.0)
        coverage[rows] = np.where(ok, np.clip(weight, 0.0, 1.0), 0.0)
    return out, coverage


def _centres(source: Geometry, target: Geometry) -> Iterator[tuple[slice, Doubles, Doubles, Flags]]:
    """Yield bands of the target: rows, columns and rows of its pixel centres in the source, and which are seen."""
    for rows in bands(target.height_px, max(1, PIXELS_AT_ONCE // target.width_px)):
        d, seen = directions(target, rows)
        x, y, there = pixels(source, d)
        yield rows, x, y, seen & there


def _in_field(source: Geometry) -> Floats:
    """Return 1 where a pixel's cell touches the field (H, W), else 0."""
    if not isinstance(source, Fisheye):
        return np.ones((source.height_px, source.width_px), dtype=np.float32)
    return np.asarray(np.hypot(*source.offsets_px()) <= source.radius_px + math.sqrt(0.5), dtype=np.float32)


def _checked(rgb: npt.ArrayLike, source: Geometry) -> tuple[Floats, bool]:
    picture = np.asarray(rgb, dtype=np.float32)
    flat = picture.ndim == 2
    picture = np.ascontiguousarray(picture[..., None] if flat else picture)
    if picture.ndim != 3 or picture.shape[:2] != (source.height_px, source.width_px) or not picture.shape[2]:
        advice = "give (H, W) or (H, W, C) of the source's size"
        raise ParameterError(f"a picture of shape {np.shape(rgb)} for {source}", advice=advice)
    if not np.isfinite(picture).all():
        raise ParameterError("a picture with NaN or Inf", advice="mark these invalid by weights, and set them to 0")
    return picture, flat


def _checked_weights(weights: npt.ArrayLike | None, source: Geometry) -> Floats:
    shape = (source.height_px, source.width_px)
    if weights is None:
        return np.ones(shape, dtype=np.float32)
    found = np.ascontiguousarray(weights, dtype=np.float32)
    if found.shape != shape or not ((found >= 0) & (found <= 1)).all():
        raise ParameterError(f"weights of shape {found.shape}", advice=f"give {shape} of values from 0 to 1")
    return found
