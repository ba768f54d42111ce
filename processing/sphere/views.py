"""Perspective views of a panorama: the mapping S of Ji et al. 2023, eq. 3, I = S(panorama; FOV, theta, phi, h, w).

Views are cut fast: the last maps are kept, OpenCV's remap does the work on all cores, the seam costs nothing and the
few pixels at a pole are set right after it. Where light must be kept, use `processing.sphere.resampling`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.ground.arrays import AnyArray, Floats
from processing.sphere import Equirectangular, Perspective
from processing.sphere.resampling import LARGEST_PX, linear_samples
from processing.sphere.view_maps import StitchMap, cut_map, stitch_map

DEPTHS = (np.uint8, np.uint16, np.float32)
HALVE_ABOVE = 2.5  # panorama pixels to a view's pixel from which a halved one is sampled; linear sampling spans two


class Panorama:
    """An equirectangular picture (H, W) or (H, W, C), uint8, uint16 or float32, with halved copies made when needed.

    Wrap a picture of which many views are cut, so that it is halved once.
    """

    def __init__(self, picture: AnyArray, *, yaw_rad: float = 0.0) -> None:
        if picture.ndim not in (2, 3) or picture.dtype not in DEPTHS or not picture.size:
            advice = "give (H, W) or (H, W, C) of uint8, uint16 or float32"
            raise ParameterError(f"a panorama of shape {picture.shape} and type {picture.dtype}", advice=advice)
        if max(picture.shape[:2]) > LARGEST_PX:
            raise ParameterError(f"a panorama of {picture.shape[1]} px", advice=f"give at most {LARGEST_PX}")
        self.picture = picture
        self.geometry = Equirectangular(picture.shape[1], picture.shape[0], yaw_rad)

    @cached_property
    def half(self) -> Self:
        """Return this picture at half the size, by area."""
        size = max(1, self.geometry.width_px // 2), max(1, self.geometry.height_px // 2)
        smaller: AnyArray = cv2.resize(self.picture, size, interpolation=cv2.INTER_AREA)
        return type(self)(smaller, yaw_rad=self.geometry.yaw_rad)

    def for_view(self, view: Perspective) -> Self:
        """Return the copy whose pixels fit a view's: at most `HALVE_ABOVE` of them to one in its middle."""
        ratio = self.geometry.height_px / math.pi / view.focal_px
        return self if ratio < HALVE_ABOVE or min(self.picture.shape[:2]) < 4 else self.half.for_view(view)


def view_at(*, fov_rad: float, theta_rad: float, phi_rad: float, height_px: int, width_px: int) -> Perspective:
    """Return the view of eq. 3: horizontal field, longitude theta, latitude phi, height and width."""
    return Perspective(width_px, height_px, fov_rad, yaw_rad=theta_rad, pitch_rad=phi_rad)


def cut_view(panorama: Panorama | AnyArray, view: Perspective) -> AnyArray:
    """Return what a view sees of a panorama, (h, w) or (h, w, C), of the panorama's type, by linear interpolation.

    Positions are exact for float32 and good to 1/64 pixel for the others. A picture without `Panorama` has its middle
    at longitude 0. ``panorama``: (H, W) or (H, W, C), of one of `DEPTHS`.
    """
    level = (panorama if isinstance(panorama, Panorama) else Panorama(panorama)).for_view(view)
    picture, maps = level.picture, cut_map(level.geometry, view, fixed=level.picture.dtype != np.float32)
    if picture.dtype == np.float32:
        seen: AnyArray = linear_samples(picture, maps.first, maps.second, cv2.BORDER_WRAP)
    else:
        seen = cv2.remap(picture, maps.first, maps.second, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        seen = seen.reshape(*seen.shape[:2], *picture.shape[2:])
    polar = maps.polar
    if polar is not None:
        corners = picture[polar.rows, polar.columns].astype(np.float64)
        weights = polar.weights if picture.ndim == 2 else polar.weights[..., None]
        value = (corners * weights).sum(axis=1)
        seen[polar.view_rows, polar.view_columns] = value if picture.dtype == np.float32 else np.rint(value)
    return seen


def view_ring(count: int, *, size_px: int, fov_rad: float, pitch_rad: float = 0.0) -> tuple[Perspective, ...]:
    """Return ``count`` square views at one pitch, evenly around from straight ahead to the right."""
    if count < 1:
        raise ParameterError(f"a ring of {count} views", advice="give at least 1")
    yaws = (math.remainder(2 * math.pi * k / count, 2 * math.pi) for k in range(count))
    return tuple(Perspective(size_px, size_px, fov_rad, yaw_rad=yaw, pitch_rad=pitch_rad) for yaw in yaws)


def covering_views(*, size_px: int, fov_rad: float, overlap: float = 0.25) -> tuple[Perspective, ...]:
    """Return square views in rings from nadir to zenith that together see everything, neighbours overlapping.

    ``fov_rad`` from 30 to 120 degrees; ``overlap`` 0.2..0.7 is the share of a view's field that a neighbour repeats.
    """
    if not (math.radians(30) <= fov_rad <= math.radians(120) + 1e-9 and 0.2 <= overlap <= 0.7):
        advice = "give a field of 30 to 120 degrees and an overlap of 0.2 to 0.7"
        raise ParameterError(f"a covering of {math.degrees(fov_rad):.1f} degrees with overlap {overlap}", advice=advice)
    step = fov_rad * (1 - overlap)
    rings = max(2, math.ceil(math.pi / step)) + 1
    views: list[Perspective] = []
    for pitch in np.linspace(-math.pi / 2, math.pi / 2, rings):
        # The ring's widest circle that this ring must cover lies half a step towards the equator.
        circle = math.cos(max(abs(pitch) - math.pi / (rings - 1) / 2, 0.0))
        alone = abs(pitch) > math.pi / 2 - 1e-9
        count = 1 if alone else max(3, math.ceil(2 * math.pi * circle / step))
        views += view_ring(count, size_px=size_px, fov_rad=fov_rad, pitch_rad=float(pitch))
    return tuple(views)


# Views back into one panorama: the inverse of eq. 3 of Ji et al. 2023, with weights that let no seam be seen. Each view
# counts most in its middle and fades to its edges; where several see a pixel they are averaged.


def stitch_views(
    pictures: Sequence[npt.ArrayLike],
    views: Sequence[Perspective],
    target: Equirectangular,
    *,
    weights: Sequence[npt.ArrayLike] | None = None,
) -> tuple[Floats, Floats]:
    """Return the panorama (H, W) or (H, W, C) that views show together, and its coverage (H, W).

    ``pictures``: one a view, (h, w) or (h, w, C) with the same C: light, masks or class probabilities; finite.
    ``weights`` (h, w) a view, 0..1: what its pixels are worth (0: not used).

    The coverage is 1 where views see, less where their pixels are worth less, and 0, as the picture, where none sees.
    """
    light = _checked_pictures(pictures, views)
    worth = _checked_weights(weights, light)
    flat = light[0].ndim == 2
    total = np.zeros((target.height_px, target.width_px, 1 if flat else light[0].shape[2]), dtype=np.float32)
    known, seen = np.zeros(total.shape[:2], dtype=np.float32), np.zeros(total.shape[:2], dtype=np.float32)
    for picture, valid, view in zip(light, worth, views, strict=True):
        found, mixed, share = _view_part(picture, valid, view, target)
        for rows, columns, part in _pieces(found, target):
            total[rows, columns] += mixed[:, part]
            known[rows, columns] += share[:, part]
            seen[rows, columns] += found.weight[:, part]
    # Less than that of known pixels around is no basis for a value.
    some = known > 1e-3 * seen
    total /= np.where(some, known, 1.0)[..., None]
    total[~some] = 0.0
    return (total[..., 0] if flat else total), np.where(some, known / np.maximum(seen, 1e-30), 0.0).astype(np.float32)


def _view_part(
    picture: Floats, valid: Floats | None, view: Perspective, target: Equirectangular
) -> tuple[StitchMap, Floats, Floats]:
    """Return where a view lies, its values times their weights (h, w, C), and the weights (h, w)."""
    if valid is not None:
        picture = picture * (valid if picture.ndim == 2 else valid[..., None])
    while target.height_px / math.pi * HALVE_ABOVE < view.focal_px and min(view.width_px, view.height_px) >= 4:
        size = view.width_px // 2, view.height_px // 2
        # An odd side loses no field: the halved pixels are a little larger or smaller than two.
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        if valid is not None:
            valid = np.asarray(cv2.resize(valid, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        view = replace(view, width_px=size[0], height_px=size[1])
    found = stitch_map(view, target)
    mixed = linear_samples(picture, found.x, found.y).reshape(*found.weight.shape, -1) * found.weight[..., None]
    share = found.weight if valid is None else found.weight * linear_samples(valid, found.x, found.y)
    return found, mixed, share


def _pieces(found: StitchMap, target: Equirectangular) -> Iterator[tuple[slice, slice, slice]]:
    """Yield rows and columns of the target, and columns of the map, of a block that may pass the seam."""
    rows = slice(found.first_row, found.first_row + found.weight.shape[0])
    done, count = 0, found.weight.shape[1]
    while done < count:
        start = (found.first_column + done) % target.width_px
        step = min(count - done, target.width_px - start)
        yield rows, slice(start, start + step), slice(done, done + step)
        done += step


def _checked_pictures(pictures: Sequence[npt.ArrayLike], views: Sequence[Perspective]) -> list[Floats]:
    light = [np.ascontiguousarray(picture, dtype=np.float32) for picture in pictures]
    if not light or len(light) != len(views):
        raise ParameterError(f"{len(light)} pictures for {len(views)} views", advice="give one a view")
    for picture, view in zip(light, views, strict=True):
        if picture.shape[:2] != (view.height_px, view.width_px) or picture.shape[2:] != light[0].shape[2:]:
            advice = "give (h, w) or (h, w, C) of the view's size"
            raise ParameterError(f"a picture of shape {picture.shape} for {view}", advice=advice)
        if picture.ndim > 3 or not np.isfinite(picture).all():
            raise ParameterError("a view with NaN or Inf, or over 3 axes", advice="mark invalid pixels by weights")
    return light


def _checked_weights(weights: Sequence[npt.ArrayLike] | None, light: list[Floats]) -> list[Floats | None]:
    if weights is None:
        return [None] * len(light)
    worth = [np.ascontiguousarray(one, dtype=np.float32) for one in weights]
    if [one.shape for one in worth] != [picture.shape[:2] for picture in light]:
        raise ParameterError("weights that do not fit the pictures", advice="give one (h, w) a picture")
    if not all(((one >= 0) & (one <= 1)).all() for one in worth):
        raise ParameterError("weights outside 0..1", advice="give 0 for pixels that are not to be used")
    return list(worth)
