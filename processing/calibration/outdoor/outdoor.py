"""The outdoor chain: vignetting, the filter's colour, geometry.

The order is the paper's (section 3): (1) vignetting, (2) colour of the ND filter, (3) from the lens's mapping to a
hemispherical picture for environment mapping; (3) keeps energy, so that a sun half a degree wide keeps its illuminance.
The density of the filter is not undone here: k2 holds it (`processing.calibration.outdoor.nd_filter`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from processing.calibration.outdoor.lens import LensModel
from processing.calibration.outdoor.nd_filter import NdFilter, without_negatives
from processing.calibration.scale.vignetting import Vignetting
from processing.errors import LensError
from processing.ground.arrays import Bytes, Floats
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping
from processing.sphere.resampling import resample, resample_labels

_MOST_UNCERTAIN = np.float32(1e3)  # in place of infinity while averaging
_DARK_SHARE = 0.5  # of a pixel's light sources; chosen
_EDGE_PX = math.sqrt(0.5)
"""Pixels whose middle is this near the image circle's edge may lie partly outside: their light is not whole."""


class OutdoorView(StrEnum):
    """The geometries that an outdoor picture is wanted in."""

    HEMISPHERICAL = "hemispherical"
    """Orthographic: a point's distance from the middle is the sine of its angle from the zenith."""
    EQUIDISTANT = "equidistant"
    EQUIRECTANGULAR = "equirectangular"


@dataclass(frozen=True)
class OutdoorOptics:
    """What stands between the sky and the outdoor picture; None: nothing to correct."""

    lens: LensModel
    vignetting: Vignetting | None = None
    filter: NdFilter | None = None


def outdoor_view(view: OutdoorView, size_px: int, top_azimuth_rad: float = 0.0) -> Geometry:
    """Return a geometry of ``size_px`` rows: a square fisheye of the whole upper half, or a panorama twice as wide."""
    if view is OutdoorView.EQUIRECTANGULAR:
        return Equirectangular(2 * size_px, size_px, top_azimuth_rad)
    mapping = LensMapping.ORTHOGRAPHIC if view is OutdoorView.HEMISPHERICAL else LensMapping.EQUIDISTANT
    return Fisheye(size_px, size_px, mapping, size_px / 2, np.pi / 2, top_azimuth_rad=top_azimuth_rad)


def correct_outdoor(
    image: RelativeImage, optics: OutdoorOptics, target: Geometry | None = None, *, top_azimuth_rad: float | None = None
) -> RelativeImage:
    """Return the outdoor picture corrected and in another geometry.

    ``image`` is as merged: its size says where the lens's circle lies, its geometry only which azimuth the top has
    unless ``top_azimuth_rad`` (found from the sun) says it. ``target``: None is hemispherical, as many rows as the
    image circle has, azimuth 0 on top. Uncertainty and validity go along; any clipped light marks a pixel as clipped.
    """
    image = with_lens(image, optics, top_azimuth_rad)
    image = correct_colour(correct_vignetting(image, optics), optics)
    if target is None:
        lens = optics.lens.circle.scaled((image.rgb.shape[1], image.rgb.shape[0]))
        target = outdoor_view(OutdoorView.HEMISPHERICAL, max(2, round(2 * lens.radius_px)))
    return project(image, target)


def with_lens(image: RelativeImage, optics: OutdoorOptics, top_azimuth_rad: float | None = None) -> RelativeImage:
    """Return the picture with the lens's calibrated geometry; pixels not wholly inside its field are black."""
    height, width = image.rgb.shape[:2]
    if top_azimuth_rad is None:
        top_azimuth_rad = image.geometry.top_azimuth_rad if isinstance(image.geometry, Fisheye) else 0.0
    geometry = optics.lens.fisheye((width, height), top_azimuth_rad)
    outside = _beyond(geometry, 1 - _EDGE_PX / geometry.radius_px)
    rgb, uncertainty, validity = image.rgb.copy(), image.uncertainty.copy(), image.validity.copy()
    rgb[outside], uncertainty[outside], validity[outside] = 0, np.inf, Validity.OUTSIDE
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=geometry)


def correct_vignetting(image: RelativeImage, optics: OutdoorOptics) -> RelativeImage:
    """Return step (1): divided by the fall-off, whose uncertainty is added."""
    if optics.vignetting is None:
        return image
    rgb = optics.vignetting.correct(image.rgb, _fisheye(image))
    return replace(image, rgb=rgb, uncertainty=_plus(image.uncertainty, optics.vignetting.relative_uncertainty))


def correct_colour(image: RelativeImage, optics: OutdoorOptics) -> RelativeImage:
    """Return step (2): the filter's tint undone, noise raised by what the matrix does.

    A channel that becomes negative (colours that the filter's matrix does not hold for, and noise) is moved to 0 at the
    same luminance; their share of the field is the attribute ``nd_moved_share``.
    """
    if optics.filter is None:
        return image
    rgb, moved = without_negatives(optics.filter.correct(image.rgb))
    uncertainty = _plus(image.uncertainty * optics.filter.noise_gain(image.rgb), optics.filter.relative_uncertainty)
    inside = max(int((image.validity != Validity.OUTSIDE).sum()), 1)
    attributes = {**image.attributes, "nd_moved_share": float(moved.sum()) / inside}
    return replace(image, rgb=rgb, uncertainty=uncertainty, attributes=attributes)


def project(image: RelativeImage, target: Geometry) -> RelativeImage:
    """Return step (3), and its inverse with the first geometry as target: resampled by area, energy kept.

    The relative uncertainty of a target pixel is the light-weighted mean of its parts': their errors may be shared
    (response, scale), so averaging does not lower it. Clipped or repaired light anywhere in a pixel marks it.
    """
    source, weights = image.geometry, (image.validity != Validity.OUTSIDE).astype(np.float32)
    rgb, coverage = resample(image.rgb, source, target, method="area", weights=weights)
    light = luminance_cd_m2(image.rgb)
    marks = [image.validity == code for code in (Validity.CLIPPED, Validity.REPAIRED, Validity.DARK)]
    known = light * np.minimum(image.uncertainty, _MOST_UNCERTAIN)
    planes = np.stack([known, marks[0] | marks[1], marks[2]], axis=-1).astype(np.float32)
    carried, _ = resample(planes, source, target, method="area", weights=weights)
    rgb = np.maximum(rgb, 0)
    outside = coverage <= 0
    bright = luminance_cd_m2(rgb)
    with np.errstate(divide="ignore", invalid="ignore"):
        uncertainty = np.where(bright > 0, carried[..., 0] / bright, np.inf).astype(np.float32)
    validity = np.zeros(bright.shape, dtype=np.uint8)
    validity[carried[..., 2] > _DARK_SHARE] = Validity.DARK
    _mark_bright(validity, carried[..., 1], marks, (source, target, weights))
    rgb[outside], uncertainty[outside], validity[outside] = 0, np.inf, Validity.OUTSIDE
    np.maximum(uncertainty, np.float32(1e-6), out=uncertainty)
    ghost = None if image.ghost is None else resample_labels(image.ghost, source, target).astype(np.uint8)
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target, ghost=ghost)


def _mark_bright(
    validity: Bytes, share: Floats, marks: list[npt.NDArray[np.bool_]], way: tuple[Geometry, Geometry, Floats]
) -> None:
    """Mark target pixels that hold clipped or repaired light, clipped above repaired."""
    clipped, repaired, _ = marks
    if not repaired.any():
        validity[share > 0] = Validity.CLIPPED
        return
    validity[share > 0] = Validity.REPAIRED
    if clipped.any():
        plane = np.repeat(clipped[..., None].astype(np.float32), 3, axis=-1)
        held, _ = resample(plane, way[0], way[1], method="area", weights=way[2])
        validity[held[..., 0] > 0] = Validity.CLIPPED


def _beyond(geometry: Fisheye, r: float) -> npt.NDArray[np.bool_]:
    """Return which pixel centres (H, W) are farther than r radii from the axis."""
    x, y = geometry.axis_px
    across = (np.arange(geometry.width_px) + 0.5 - x) ** 2
    down = (np.arange(geometry.height_px) + 0.5 - y) ** 2
    return np.asarray(across[None, :] + down[:, None] > (r * geometry.radius_px) ** 2)


def _fisheye(image: RelativeImage) -> Fisheye:
    if not isinstance(image.geometry, Fisheye):
        raise LensError("fall-off belongs to a fisheye picture as taken", advice="correct it before the geometry")
    return image.geometry


def _plus(uncertainty: Floats, sigma: float) -> Floats:
    return np.asarray(np.hypot(uncertainty, np.float32(sigma)), dtype=np.float32) if sigma else uncertainty
