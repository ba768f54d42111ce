"""The outdoor chain: vignetting, the filter's colour, geometry.

The order is the paper's (section 3): (1) vignetting, (2) colour of the ND filter, (3) from the lens's mapping to a
hemispherical picture for environment mapping; (3) keeps energy, so that a sun half a degree wide keeps its illuminance.
The density of the filter is not undone here: k2 holds it (`processing.calibration.outdoor.nd_filter`).
"""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import cv2
import numpy as np

from processing.calibration.outdoor.lens import LensModel
from processing.calibration.outdoor.nd_filter import NdFilter, without_negatives
from processing.calibration.scale.vignetting import Vignetting
from processing.errors import LensError
from processing.ground.arrays import Bytes, Flags, Floats
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, projected_solid_angles
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


def cut_to_circle(image: RelativeImage) -> RelativeImage:
    """Return the part of a fisheye picture that holds its image circle: a full frame's other 40 % only cost time."""
    lens = _fisheye(image)
    (x, y), reach = lens.axis_px, lens.radius_px + 2
    left, right = max(math.floor(x - reach), 0), min(math.ceil(x + reach), lens.width_px)
    top, bottom = max(math.floor(y - reach), 0), min(math.ceil(y + reach), lens.height_px)
    part = slice(top, bottom), slice(left, right)
    geometry = replace(lens, width_px=right - left, height_px=bottom - top, centre_px=(x - left, y - top))
    planes = {name: getattr(image, name)[part] for name in ("rgb", "uncertainty", "validity")}
    return replace(image, **planes, ghost=None if image.ghost is None else image.ghost[part], geometry=geometry)


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
    Overlaps are exact wherever light changes fast; where boxes in the rest change the illuminance, everywhere.
    """
    source, weights = image.geometry, (image.validity != Validity.OUTSIDE).astype(np.float32)
    light = luminance_cd_m2(image.rgb)
    planes = _planes(image, light)
    near = _uneven(light, image.validity)
    done, coverage = resample(planes, source, target, method="area", weights=weights, near=near)
    if isinstance(target, Fisheye) and not _same_level(light * weights, source, done[..., :3], coverage, target):
        done, coverage = resample(planes, source, target, method="area", weights=weights)
    rgb = np.maximum(done[..., :3], 0)
    outside = coverage <= 0
    bright = luminance_cd_m2(rgb)
    with np.errstate(divide="ignore", invalid="ignore"):
        uncertainty = np.where(bright > 0, done[..., 3] / bright, np.inf).astype(np.float32)
    validity = np.zeros(bright.shape, dtype=np.uint8)
    validity[done[..., 6] > _DARK_SHARE] = Validity.DARK
    validity[done[..., 5] > 0] = Validity.REPAIRED
    validity[done[..., 4] > 0] = Validity.CLIPPED
    rgb[outside], uncertainty[outside], validity[outside] = 0, np.inf, Validity.OUTSIDE
    np.maximum(uncertainty, np.float32(1e-6), out=uncertainty)
    ghost = None if image.ghost is None else resample_labels(image.ghost, source, target).astype(np.uint8)
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target, ghost=ghost)


def _planes(image: RelativeImage, light: Floats) -> Floats:
    """Return all that goes along (H, W, 7): light, light times its uncertainty, and three marks."""
    planes = np.empty((*light.shape, 7), np.float32)
    planes[..., :3] = image.rgb
    np.multiply(light, np.minimum(image.uncertainty, _MOST_UNCERTAIN), out=planes[..., 3])
    for k, code in enumerate((Validity.CLIPPED, Validity.REPAIRED, Validity.DARK)):
        planes[..., 4 + k] = image.validity == code
    return planes


_STEEP = 1.25
"""Brightest over darkest of nine pixels, beside which overlaps are exact; chosen: a tenth of a percent at most."""
_AROUND = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)
_SAME_LX = 1e-4  # relative: by how much boxes may change the illuminance. Chosen.


def _uneven(light: Floats, validity: Bytes) -> Flags:
    """Return where (H, W) light changes fast, or pixels are not valid: cells there are cut exactly."""
    three, five = _AROUND
    steep = cv2.dilate(light, three) > np.float32(_STEEP) * cv2.erode(light, three)
    return np.asarray(cv2.dilate((steep | (validity != Validity.VALID)).astype(np.uint8), five) > 0)


def _same_level(light: Floats, source: Geometry, rgb: Floats, coverage: Floats, target: Geometry) -> bool:
    """Return whether a level plane has the same light by both pictures; ``light`` (H, W), ``rgb`` (h, w, 3)."""
    up = (0.0, 0.0, 1.0)
    before = np.vdot(light, projected_solid_angles(source, up))
    after = np.vdot(luminance_cd_m2(rgb) * (coverage > 0.5), projected_solid_angles(target, up))
    return bool(abs(after - before) <= _SAME_LX * before)


def _beyond(geometry: Fisheye, r: float) -> Flags:
    """Return which pixel centres (H, W) are farther than r radii from the axis."""
    across, down = geometry.offsets_px()
    return np.asarray(across**2 + down**2 > (r * geometry.radius_px) ** 2)


def _fisheye(image: RelativeImage) -> Fisheye:
    if not isinstance(image.geometry, Fisheye):
        raise LensError("vignetting needs the original fisheye picture", advice="correct it before the geometry")
    return image.geometry


def _plus(uncertainty: Floats, sigma: float) -> Floats:
    return np.asarray(np.hypot(uncertainty, np.float32(sigma)), dtype=np.float32) if sigma else uncertainty
