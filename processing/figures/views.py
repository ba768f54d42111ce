"""Pictures as an observer's eye meets them, for Radiance's evalglare; and smaller ones that keep all light."""

import math
from dataclasses import replace

import numpy as np

from processing.errors import ParameterError
from processing.pictures.images import LuminanceImage, Validity
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions
from processing.sphere.resampling import resample, resample_uncertainty

_FINE = 3  # samples along each side of a pixel of a view


def reduced(image: LuminanceImage, width_px: int) -> LuminanceImage:
    """Return a panorama of at most this width; light is kept, and a pixel of which any part is clipped is clipped.

    Raises `ParameterError` for another kind of picture.
    """
    source = panorama_of(image)
    if source.width_px <= width_px:
        return image
    target = Equirectangular(width_px, width_px // 2, source.yaw_rad)
    rgb, _ = resample(image.rgb, source, target)
    uncertainty = resample_uncertainty(image.uncertainty, source, target)
    validity = np.zeros(rgb.shape[:2], np.uint8)
    shares = ((Validity.DARK, 0.5), (Validity.REPAIRED, 0.0), (Validity.CLIPPED, 0.0), (Validity.OUTSIDE, 0.5))
    for code, share in shares:
        there = image.validity == code
        if there.any():
            validity[resample(there.astype(np.float32), source, target)[0] > share] = code
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target, ghost=None)


def panorama_of(image: LuminanceImage) -> Equirectangular:
    """Return the geometry of a whole panorama; raise `ParameterError` for another kind of picture."""
    if not isinstance(image.geometry, Equirectangular):
        raise ParameterError("light at the camera needs a whole panorama", advice="give an equirectangular one")
    return image.geometry


def eye_view(image: LuminanceImage, azimuth_rad: float, size_px: int = 1000) -> LuminanceImage:
    """Return the half space before someone who looks level towards an azimuth: an equidistant fisheye of 180 degrees.

    Its axis is where the observer looks and the picture's up is the room's up, left is left. The geometry's axes are
    the observer's: its "zenith" is straight ahead, its +y the room's up.
    """
    source = reduced(image, 2 * _FINE * size_px)
    panorama = panorama_of(source)
    target = Fisheye(size_px, size_px, LensMapping.EQUIDISTANT, size_px / 2)
    _, seen = directions(target)
    total = np.zeros((size_px, size_px, 3))
    for k in range(_FINE**2):
        row, column = _nearest(_turned(_shifted(target, k), azimuth_rad), panorama)
        total += source.rgb[row, column]
    if not (np.isfinite(total).all() and total.min() >= 0):
        raise ParameterError("the picture holds values that light cannot have (negative, or not finite)")
    row, column = _nearest(_turned(target, azimuth_rad), panorama)
    rgb = np.where(seen[..., None], total / _FINE**2, 0).astype(np.float32)
    uncertainty = np.where(seen, source.uncertainty[row, column], np.inf).astype(np.float32)
    validity = np.where(seen, source.validity[row, column], Validity.OUTSIDE).astype(np.uint8)
    return replace(source, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target, ghost=None)


def _shifted(target: Fisheye, k: int) -> Fisheye:
    """Return the view whose pixel middles are the k-th part of each of the target's pixels."""
    down, right = ((part + 0.5) / _FINE - 0.5 for part in divmod(k, _FINE))
    # Its circle is a little wider than half the picture, so that shifted middles are still in its field.
    reach = 1 + 2 / target.width_px
    centre = (target.width_px / 2 - right, target.height_px / 2 - down)
    half = target.half_field_rad * reach
    return replace(target, centre_px=centre, radius_px=target.radius_px * reach, half_field_rad=half)


def _turned(view: Fisheye, azimuth_rad: float) -> np.ndarray:
    """Return what a view's pixels see (H, W, 3) when its axis is level and its up is the room's."""
    rays, _ = directions(view)
    sine, cosine = math.sin(azimuth_rad), math.cos(azimuth_rad)
    # A fisheye that looks up has +x on its left.
    ahead, left, up = rays[..., 2:], rays[..., :1], rays[..., 1:2]
    return np.asarray(ahead * [sine, cosine, 0.0] + left * [-cosine, sine, 0.0] + up * [0.0, 0.0, 1.0])


def _nearest(rays: np.ndarray, panorama: Equirectangular) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of the pixel that each direction falls into: bright edges stay sharp."""
    latitude = np.arcsin(np.clip(rays[..., 2], -1, 1))
    longitude = np.arctan2(rays[..., 0], rays[..., 1]) - panorama.yaw_rad
    row = np.floor((0.5 - latitude / math.pi) * panorama.height_px).astype(np.intp)
    column = np.floor((longitude / (2 * math.pi) + 0.5) * panorama.width_px).astype(np.intp)
    return row.clip(0, panorama.height_px - 1), column % panorama.width_px


# What an observer's eye meets, as files that Radiance's evalglare takes; and what evalglare says of them.
