"""Views back into one panorama: the inverse of eq. 3 of Ji et al. 2023, with weights that let no seam be seen.

Each view counts most in its middle and fades to its edges; where several see a pixel they are averaged. Class maps are
not averaged: the class with the most weight wins.
"""

from __future__ import annotations

from processing.ground.arrays import Floats

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.resampling_linear import linear_samples
from processing.sphere import Equirectangular, Perspective
from processing.sphere_cubic import cubic_samples
from processing.views_maps import StitchMap, stitch_map

Labels = npt.NDArray[np.integer]

HALVE_ABOVE = 2.5
"""A view's pixels to one of the target, in the view's middle, from which a halved view is sampled."""
MOST_LABELS = 4096


def stitch_views(
    pictures: Sequence[npt.ArrayLike],
    views: Sequence[Perspective],
    target: Equirectangular,
    *,
    weights: Sequence[npt.ArrayLike] | None = None,
    cubic: bool = False,
) -> tuple[Floats, Floats]:
    """Return the panorama (H, W) or (H, W, C) that views show together, and its coverage (H, W).

    Parameters
    ----------
    pictures
        One a view, (h, w) or (h, w, C) with the same C: light, masks or class probabilities; finite.
    weights
        (h, w) a view, 0..1: what its pixels are worth (0: not used).
    cubic
        Cubic instead of linear interpolation, held within the pixels around; only without ``weights``.

    The coverage is 1 where views see, less where their pixels are worth less, and 0, as the picture, where none sees.
    """
    light = _checked_pictures(pictures, views)
    worth = _checked_weights(weights, light)
    if cubic and weights is not None:
        raise ParameterError("cubic stitching with weights", advice="leave out one of the two")
    flat = light[0].ndim == 2
    total = np.zeros((target.height_px, target.width_px, 1 if flat else light[0].shape[2]), dtype=np.float32)
    known, seen = np.zeros(total.shape[:2], dtype=np.float32), np.zeros(total.shape[:2], dtype=np.float32)
    for picture, valid, view in zip(light, worth, views, strict=True):
        found, mixed, share = _view_part(picture, valid, view, target, cubic=cubic)
        for rows, columns, part in _pieces(found, target):
            total[rows, columns] += mixed[:, part]
            known[rows, columns] += share[:, part]
            seen[rows, columns] += found.weight[:, part]
    # Less than that of known pixels around is no basis for a value.
    some = known > 1e-3 * seen
    total /= np.where(some, known, 1.0)[..., None]
    total[~some] = 0.0
    return (total[..., 0] if flat else total), np.where(some, known / np.maximum(seen, 1e-30), 0.0).astype(np.float32)


def stitch_labels(
    labels: Sequence[Labels], views: Sequence[Perspective], target: Equirectangular, *, outside: int = 0
) -> Labels:
    """Return the class map (H, W) of views' class maps (h, w): the class with the most weight.

    Of equal classes the smaller wins; ``outside`` stands where none sees.
    """
    if not labels or len(labels) != len(views):
        raise ParameterError(f"{len(labels)} class maps for {len(views)} views", advice="give one a view")
    for one, view in zip(labels, views, strict=True):
        if one.shape != (view.height_px, view.width_px) or not np.issubdtype(one.dtype, np.integer):
            raise ParameterError(f"a class map of {one.shape}, {one.dtype} for {view}", advice="give integers (h, w)")
    classes = np.unique(np.concatenate([np.unique(one) for one in labels]))
    if classes.size > MOST_LABELS:
        raise ParameterError(f"{classes.size} classes", likely="a picture was given", advice="give a class map")
    best = np.zeros((target.height_px, target.width_px), dtype=np.float32)
    out = np.full(best.shape, outside, dtype=labels[0].dtype)
    for label in classes:
        votes = np.zeros_like(best)
        for one, view in zip(labels, views, strict=True):
            if not (one == label).any():
                continue
            found = stitch_map(view, target)
            there = _linear((one == label).astype(np.float32), found) * found.weight
            for rows, columns, part in _pieces(found, target):
                votes[rows, columns] += there[:, part]
        wins = votes > best
        out[wins] = label
        best[wins] = votes[wins]
    return out


def _view_part(
    picture: Floats, valid: Floats | None, view: Perspective, target: Equirectangular, *, cubic: bool
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
    if cubic:
        value = cubic_samples(picture[..., None] if picture.ndim == 2 else picture, found.x, found.y)
    else:
        value = _linear(picture, found)
    mixed = value.reshape(*found.weight.shape, -1) * found.weight[..., None]
    share = found.weight if valid is None else found.weight * _linear(valid, found)
    return found, mixed, share


def _linear(picture: Floats, found: StitchMap) -> Floats:
    return linear_samples(picture, found.x, found.y)


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
            raise ParameterError(
                f"a picture of shape {picture.shape} for {view}", advice="give (h, w) or (h, w, C) of the view's size"
            )
        if picture.ndim > 3 or not np.isfinite(picture).all():
            raise ParameterError(
                "a view with NaN or Inf, or of more than 3 axes", advice="mark invalid pixels by weights"
            )
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
