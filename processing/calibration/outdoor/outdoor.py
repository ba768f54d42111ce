"""The outdoor chain: vignetting, the filter's colour, geometry.

The order is the paper's (section 3): (1) vignetting, (2) colour of the ND filter, (3) from the lens's mapping to a
hemispherical picture for environment mapping; (3) keeps energy, so that a sun half a degree wide keeps its illuminance.
The density of the filter is not undone here: k2 holds it (`processing.calibration.outdoor.nd_filter`)."""

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
from processing.pictures.images import P, RelativeImage, Validity, luminance_cd_m2
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
    return _part(image, optics.lens.fisheye((width, height), top_azimuth_rad))


def _part(image: RelativeImage, lens: Fisheye, top: int = 0, left: int = 0) -> RelativeImage:
    """Return the part of a picture from a row and column on that ``lens`` is of, black where not wholly inside."""
    part = slice(top, top + lens.height_px), slice(left, left + lens.width_px)
    rgb, uncertainty, validity = image.rgb[part].copy(), image.uncertainty[part].copy(), image.validity[part].copy()
    across, down = lens.offsets_px()
    outside = across**2 + down**2 > ((1 - _EDGE_PX / lens.radius_px) * lens.radius_px) ** 2
    rgb[outside], uncertainty[outside], validity[outside] = 0, np.inf, Validity.OUTSIDE
    ghost = None if image.ghost is None else image.ghost[part]
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=lens, ghost=ghost)


LEAST_DRAFT_PX = 400  # of the image circle's radius, that a draft keeps: what is made of a sky has 2.8 pixels a degree


def draft_factor(lens: LensModel, size_px: tuple[int, int]) -> int:
    """Return by how much a draft's sky is smaller: 4, 2, or 1 where it is small already or has no such part."""
    sides, radius_px = math.gcd(*size_px), lens.fisheye(size_px).radius_px
    return next((n for n in (4, 2) if sides % n == 0 and radius_px >= n * LEAST_DRAFT_PX), 1)


def cut_to_circle(image: RelativeImage, lens: Fisheye, step_px: int = 1) -> RelativeImage:
    """Return the part that holds the lens's image circle, as `with_lens` does: a full frame's other 40 % cost time.

    ``step_px`` divides the picture's sides, and then the part's."""
    (x, y), reach = lens.axis_px, lens.radius_px + 2
    left, top = (max(math.floor((at - reach) / step_px) * step_px, 0) for at in (x, y))
    right, bottom = (math.ceil((at + reach) / step_px) * step_px for at in (x, y))
    right, bottom = min(right, lens.width_px), min(bottom, lens.height_px)
    own = replace(lens, width_px=right - left, height_px=bottom - top, centre_px=(x - left, y - top))
    return _part(image, own, top, left)


def correct_vignetting(image: RelativeImage, optics: OutdoorOptics) -> RelativeImage:
    """Return step (1): divided by the fall-off, whose uncertainty is added."""
    if optics.vignetting is None:
        return image
    if not isinstance(image.geometry, Fisheye):
        raise LensError("vignetting needs the original fisheye picture", advice="correct it before the geometry")
    rgb = optics.vignetting.correct(image.rgb, image.geometry)
    return replace(image, rgb=rgb, uncertainty=_plus(image.uncertainty, optics.vignetting.relative_uncertainty))


def correct_colour(image: RelativeImage, optics: OutdoorOptics) -> RelativeImage:
    """Return step (2): the filter's tint undone, noise raised by what the matrix does.

    A channel that becomes negative (colours that the filter's matrix does not hold for, and noise) is moved to 0 at the
    same luminance; their share of the field is the attribute ``nd_moved_share``."""
    if optics.filter is None:
        return image
    rgb, moved = without_negatives(optics.filter.correct(image.rgb))
    uncertainty = _plus(image.uncertainty * optics.filter.noise_gain(image.rgb), optics.filter.relative_uncertainty)
    inside = max(int((image.validity != Validity.OUTSIDE).sum()), 1)
    attributes = {**image.attributes, "nd_moved_share": float(moved.sum()) / inside}
    return replace(image, rgb=rgb, uncertainty=uncertainty, attributes=attributes)


def project(image: P, target: Geometry) -> P:
    """Return step (3), and its inverse with the first geometry as target: resampled by area, energy kept.

    The relative uncertainty of a target pixel is the light-weighted mean of its parts': their errors may be shared
    (response, scale), so averaging does not lower it. Clipped or repaired light anywhere in a pixel marks it.
    Overlaps are exact wherever light changes fast; where boxes in the rest change the illuminance, everywhere."""
    source, weights = image.geometry, (image.validity != Validity.OUTSIDE).astype(np.float32)
    light = luminance_cd_m2(image.rgb)
    near, planes = _uneven(light, image.validity), _planes(image, light)
    level = np.vdot(light * weights, projected_solid_angles(source, _UP)) if isinstance(target, Fisheye) else None
    ghost = None if image.ghost is None else resample_labels(image.ghost, source, target).astype(np.uint8)
    # So that what was given is let go while it is resampled, unless somebody else holds it.
    image = replace(image, rgb=weights[:0], uncertainty=weights[:0], validity=near[:0].view(np.uint8), ghost=ghost)
    del light
    done, coverage = resample(planes, source, target, method="area", weights=weights, near=near)
    if level is not None and not _same_level(level, done[..., :3], coverage, target):
        done, coverage = resample(planes, source, target, method="area", weights=weights)
    del planes
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
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, geometry=target)


def _planes(image: P, light: Floats) -> Floats:
    """Return all that goes along (H, W, 7): light, light times its uncertainty, and three marks."""
    planes = np.empty((*light.shape, 7), np.float32)
    planes[..., :3] = image.rgb
    np.multiply(light, np.minimum(image.uncertainty, _MOST_UNCERTAIN), out=planes[..., 3])
    for k, code in enumerate((Validity.CLIPPED, Validity.REPAIRED, Validity.DARK)):
        planes[..., 4 + k] = image.validity == code
    return planes


_STEEP = 1.25  # brightest over darkest of nine pixels, beside which overlaps are exact; chosen: a tenth of a percent
_AROUND = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)
_UP = (0.0, 0.0, 1.0)
_SAME_LX = 1e-4  # relative: by how much boxes may change the illuminance. Chosen.


def _uneven(light: Floats, validity: Bytes) -> Flags:
    """Return where (H, W) light changes fast, or pixels are not valid: cells there are cut exactly."""
    three, five = _AROUND
    steep = cv2.dilate(light, three) > np.float32(_STEEP) * cv2.erode(light, three)
    return np.asarray(cv2.dilate((steep | (validity != Validity.VALID)).astype(np.uint8), five) > 0)


def _same_level(before: float, rgb: Floats, coverage: Floats, target: Geometry) -> bool:
    """Return whether a level plane has the light that it had ``before``; ``rgb`` (h, w, 3)."""
    light = luminance_cd_m2(rgb)
    np.multiply(light, coverage > 0.5, out=light)
    after = np.vdot(light, projected_solid_angles(target, _UP))
    return bool(abs(after - before) <= _SAME_LX * before)


def _plus(uncertainty: Floats, sigma: float) -> Floats:
    return np.asarray(np.hypot(uncertainty, np.float32(sigma)), dtype=np.float32) if sigma else uncertainty
