"""Veiling glare: light that the lens scatters over the picture, as a kernel over angle that the picture itself shows.

No bracket removes it (McCann and Rizzi 2007). Outside a fisheye's image circle no ray of the scene arrives: what is
there is scattered in lens and body, more beside bright places and in ways that show how far it scatters (`glare_fit`).
Glare is smooth, so that it is worked out in cells of four degrees. Indoors the darkest place bounds the glare from
above, unless lamps in the dark have shown the kernel (`lamp_glare`). The index is that of ISO 9358: glare over mean
light.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from scipy.linalg import block_diag

from processing.calibration.scale import glare_fit
from processing.calibration.scale.luminance import ScaleFactor, Spot, sighted, spot_pixels
from processing.errors import LensError, ParameterError
from processing.ground.arrays import Bytes, Doubles, Flags, Floats, bands
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import ROWS_AT_ONCE, SharedMode, between, blueness
from processing.sphere import Fisheye, Geometry, directions, in_pixels, solid_angles

Picture = TypeVar("Picture", RelativeImage, LuminanceImage)

STRAY_ROWS = 16  # of the map of stray light, and twice as many columns; chosen: 11 degrees, for it is smooth
RIM_GAP = 1.06  # in radii: nearer to the image circle the lens's own blur and its bright rim reach out
MIN_SURROUND_PX = 400  # chosen
MAX_DARK_SHARE = 0.25
"""Of the surround: where more of it is too dark to measure, what is left are the brightest by chance, not the veil."""
_DARKEST_SHARE = 0.001  # of the field; chosen
_ENOUGH_PX = 400  # of a radius, at least; chosen
_CELLS_A_RADIUS = 24  # chosen: 3.75 degrees, half the narrowest part's width at half its height
_TARGETS = 512  # cells worked out at once: 15 MB. Chosen.
_UNMEASURED = 6  # modes; chosen: with more, coverage in three real scenes is the same
UNEVEN = 1.0
"""Relative standard deviation by which stray light of an unmeasured lens is stronger towards one side. A kernel misses
half of what the surround of a Canon's image circle shows; chosen on hostile halos, with 0.5 fewer are covered."""


class Cells(NamedTuple):
    """A picture in cells: places (N, 2) of the sensor's plane in radians or (N, 3) directions, their areas (N,)."""

    shape: tuple[int, int]
    places: Doubles
    area: Doubles
    inside: Flags
    """(N,): whose middles are in the field."""
    side: Flags | None = None
    """(N,): of two lenses, that of the panorama's middle; light stays in the lens that it came through. None: one."""

    def scattered(self, light: Doubles) -> Doubles:
        """Return what a share of 1 of each part gives, (parts, N, C), of light (N, C) per area."""
        sent = light * self.area[:, None]
        near = np.flatnonzero(sent.any(axis=1))
        sources, sent = self.places[near], sent[near]
        found = np.empty((len(glare_fit.WIDTHS_RAD) + 1, *light.shape))
        for start in range(0, len(light), _TARGETS):
            targets = self.places[start : start + _TARGETS]
            apart = (targets**2).sum(1)[:, None] + (sources**2).sum(1) - 2 * targets @ sources.T
            apart = np.maximum(apart, 0)
            if sources.shape[1] == 3:
                apart = (2 * np.arcsin(np.minimum(np.sqrt(apart) / 2, 1))) ** 2
            if self.side is not None:
                apart[self.side[start : start + _TARGETS, None] != self.side[near]] = np.inf
            for k, width in enumerate(glare_fit.WIDTHS_RAD):
                far = apart + width**2
                found[k, start : start + _TARGETS] = (width / (2 * math.pi) / (far * np.sqrt(far))) @ sent
        for mine in [slice(None)] if self.side is None else [self.side, ~self.side]:
            within = np.zeros(len(light), bool)
            within[mine] = True
            total = sent[within[near]].sum(axis=0)
            found[-1, within] = total / max(float(self.area[within] @ self.inside[within]), 1e-30)
        return found


def kernel_from_surround(rgb: Floats, validity: Bytes, lens: Fisheye) -> glare_fit.GlareKernel:
    """Return the kernel by the frame around the image circle of an uncropped fisheye picture (H, W, 3), linear.

    ``validity``: clipped pixels of the surround are left out. Dark ones count with their values, so that the rest
    is not of the bright ones alone. Shares that the surround leaves open stay near 0, with the uncertainty of a
    lens that was not measured (where light is clipped: their means over all that it may hide); how much sectors of
    the surround disagree adds to it. Raises `LensError` where less than 400 pixels are valid, which is no surround,
    and where more than a quarter is dark: then the glare is less than the longest frame shows.
    """
    # Glare is smooth: large pictures are reduced.
    step = max(int(lens.radius_px / _ENOUGH_PX), 1)
    height, width = (size // step for size in validity.shape)
    whole = rgb[: height * step, : width * step]
    clipped = _means(validity[: height * step, : width * step] == Validity.CLIPPED, (height, width))
    rgb = _means(whole, (height, width))
    validity = validity[step // 2 :: step, step // 2 :: step][:height, :width]
    centre = (lens.axis_px[0] / step, lens.axis_px[1] / step)
    lens = replace(lens, width_px=width, height_px=height, radius_px=lens.radius_px / step, centre_px=centre)
    # How many radii of the image circle each pixel's middle is from its axis
    radius = np.asarray(np.hypot(*lens.offsets_px()) / lens.radius_px, dtype=np.float32)
    luminance = luminance_cd_m2(rgb)
    surround = (radius > RIM_GAP) & (validity != Validity.CLIPPED)
    _check_surround(surround, surround & (validity != Validity.DARK), radius < 1)
    cells = _plane(lens)
    # Noise about 0 averages out within cells.
    if not np.isfinite(luminance).all() or in_cells(luminance * (radius < 1), cells.shape).min(initial=0.0) < 0:
        raise ParameterError("the picture holds values that light cannot have (negative or not finite)")
    light = in_cells(np.stack([luminance, luminance * clipped], axis=-1) * (radius < 1)[..., None], cells.shape)
    parts = np.moveaxis(cells.scattered(light), -1, 0)
    seen = in_cells(surround.astype(np.float32), cells.shape)[:, 0]
    level = in_cells(np.where(surround, luminance, 0), cells.shape)[:, 0]
    use = seen > 0.5
    found, x, y = level[use] / seen[use], *cells.places[use].T
    sector = np.floor((np.arctan2(y, x) / (2 * math.pi) + 0.5) * glare_fit.SECTORS).astype(int)
    fit = glare_fit.fit_kernel(parts[..., use], found, sector, glare_fit.hidden_factors(light))
    field = float(light[:, 0] @ cells.area / (cells.area @ cells.inside))
    return replace(fit, index=min(1.0, float(np.median(found)) / field) if field > 0 else 0.0)


def _check_surround(surround: Flags, usable: Flags, inside: Flags) -> None:
    if int(usable.sum()) < MIN_SURROUND_PX or not inside.any():
        text = f"{int(usable.sum())} usable pixels around the image circle; {MIN_SURROUND_PX} are needed"
        likely = "a cropped picture, or stops too short to see the surround"
        raise LensError(text, likely=likely, advice="give the uncropped frames, or the veil itself")
    dark = 1 - float(usable.sum()) / float(surround.sum())
    if dark > MAX_DARK_SHARE:
        text = f"{100 * dark:.0f} % of the surround of the image circle is too dark to measure"
        likely = "veiling glare too weak for the longest frame"
        raise LensError(text, likely=likely, advice="add a longer frame, or do not subtract the veil")


def without_glare(image: Picture, kernel: glare_fit.GlareKernel) -> Picture:
    """Return the picture less what the kernel scatters; the rest is raised so that the mean over the field stays.

    Arrays keep their shape and unit. What falls to 0 or below becomes 0, `Validity.DARK`, with infinite uncertainty;
    pixels outside the field stay. The kernel's own doubt is in `kernel_modes`.
    """
    if min(kernel.shares + kernel.hidden) < 0 or not math.isfinite(sum(kernel.shares + kernel.hidden)):
        raise ParameterError(f"a kernel's shares are finite and not negative, not {kernel.shares}")
    geometry, validity = image.geometry, image.validity.copy()
    if isinstance(geometry, Fisheye):
        cells = _plane(geometry)
    else:
        cells = cells_around(geometry, 2 * STRAY_ROWS, kernel.two_lenses)
    light = in_cells(image.rgb, cells.shape)
    if not np.isfinite(light).all():
        raise ParameterError("the picture holds values that light cannot have (not finite)")
    light *= cells.inside[:, None]
    glare = np.tensordot(np.array(kernel.shares), cells.scattered(light), 1)
    total, scattered = (float((cells.area * cells.inside) @ one.sum(axis=1)) for one in (light, glare))
    if any(kernel.hidden):
        clipped = in_cells(image.rgb * (validity == Validity.CLIPPED)[..., None], cells.shape) * cells.inside[:, None]
        glare += np.tensordot(np.array(kernel.hidden), cells.scattered(clipped), 1)
    gain = np.float32(total / (total - scattered) if scattered < 0.5 * total else 1.0)
    rgb, uncertainty = np.empty_like(image.rgb), image.uncertainty.copy()
    height, width = validity.shape
    down, grid = between(height, cells.shape[0]).astype(np.float32), glare.reshape(*cells.shape, 3).astype(np.float32)
    for rows in bands(height, ROWS_AT_ONCE):
        across = np.tensordot(down[rows], grid, 1)
        clean = cv2.resize(across, (width, across.shape[0]), interpolation=cv2.INTER_LINEAR)
        np.maximum(np.subtract(image.rgb[rows], clean, out=clean), 0, out=clean)
        here = validity[rows] != Validity.OUTSIDE
        before, after = luminance_cd_m2(image.rgb[rows]), luminance_cd_m2(clean)
        lit = here & (after > 0)
        more = np.divide(before, after, out=np.full_like(after, np.inf), where=lit)
        np.multiply(uncertainty[rows], more, out=uncertainty[rows], where=here)
        validity[rows][here & ~lit & (validity[rows] != Validity.CLIPPED)] = Validity.DARK
        np.multiply(clean, gain, out=rgb[rows])
        rgb[rows][~here] = image.rgb[rows][~here]
    attributes = {**image.attributes, "glare_shares": list(kernel.shares), "glare_index": kernel.index}
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity, attributes=attributes)


Metered = tuple[float, float, float]
"""Luminance in cd/m2, longitude and latitude in radians of the spot that set a picture's scale."""


def metered(image: LuminanceImage, scale: ScaleFactor, target: Mapping[str, Any]) -> tuple[Metered | None, float]:
    """Return which spot of an indoor picture set its scale, and its blueness; None, and daylight's: none did."""
    if not scale.measured:
        return None, 0.0
    place = sighted(image.geometry, math.radians(target["longitude_deg"]), math.radians(target["latitude_deg"]))
    spot = spot_pixels(image.geometry, Spot(*place))
    light = np.asarray(spot.share @ image.rgb[spot.row, spot.column], np.float32)
    return (scale.measured, *place), float(blueness(light))


def kernel_modes(
    image: LuminanceImage, kernel: glare_fit.GlareKernel, measured: Metered | None = None
) -> list[SharedMode]:
    """Return what is left uncertain of a kernel's glare in a picture: a mode for each axis of its covariance."""
    cells, light = _shown_and_clipped(image, kernel.two_lenses)
    covariance, (total, clipped) = np.array(kernel.covariance), cells.area @ light
    if len(covariance) == len(kernel.shares) and clipped > 0:
        # Of a lamp's measurement: what this picture's clipped light scatters beyond what it shows is not in it.
        covariance = block_diag(covariance, _hidden(total, clipped) * np.outer(kernel.shares, kernel.shares))
    parts = np.concatenate(np.moveaxis(cells.scattered(light), -1, 0))[: len(covariance)]
    variances, axes = np.linalg.eigh(covariance)
    left = np.sqrt(np.maximum(variances, 0))[:, None] * (axes.T @ parts)
    # What no kernel gives, as far as this one misses the places measured, may be on any side.
    uneven = kernel.misfit * (np.array(kernel.shares) @ parts[: len(kernel.shares)]) * cells.places.T
    left = np.concatenate([left, uneven])
    return _scatter("stray light, measured", cells, left, np.clip(_known(cells, left, measured), -2, 2))


def _known(cells: Cells, glare: Doubles, measured: Metered | None) -> Doubles:
    """Return the relative error (K,) that each glare (K, N) makes where the scale was measured."""
    if measured is None:
        return np.zeros(len(glare))
    (x, y, z), (level, longitude, latitude) = cells.places.T, measured
    near = math.cos(latitude) * (x * math.sin(longitude) + y * math.cos(longitude)) + z * math.sin(latitude)
    return np.asarray(glare[:, int(np.argmax(near))] / level)


def _scatter(name: str, cells: Cells, glare: Doubles, known: Doubles) -> list[SharedMode]:
    return [
        SharedMode(f"{name} {number}", "scatter", (*map(float, cells.shape), float(own)), tuple(one.tolist()))
        for number, (one, own) in enumerate(zip(glare, known, strict=True), start=1)
    ]


def unmeasured_modes(image: LuminanceImage, measured: Metered | None = None) -> list[SharedMode]:
    """Return what a lens may scatter whose glare was not measured: the parts of a kernel, each by itself.

    Shares are the prior's, not alike on all sides; clipped light is a factor of what it shows, as likely at any size.
    """
    cells, light = _shown_and_clipped(image)
    parts = glare_fit.PRIOR_SHARE * np.moveaxis(cells.scattered(light), -1, 0)
    total, clipped = cells.area @ light
    if clipped > 0:
        parts[1] *= math.sqrt(_hidden(total, clipped))
    left = parts[: 2 if clipped > 0 else 1]
    uneven = UNEVEN * np.sqrt(np.square(left).sum(axis=1, keepdims=True)) * cells.places.T
    left = np.concatenate([left, uneven], axis=1).reshape(-1, len(light))
    known = _known(cells, left, measured)
    # A few sums of the parts make nearly all of the relative error, and are as independent. Where glare is more than
    # twice the light (chosen), nothing is known of it either way.
    relative = np.clip(left / np.maximum(light[:, 0], 1e-30) - known[:, None], -2, 2) * np.sqrt(cells.area)
    turn = np.linalg.svd(relative, full_matrices=False)[0].T[:_UNMEASURED]
    return _scatter("stray light", cells, turn @ left, turn @ known)


def _hidden(total: float, clipped: float) -> float:
    """Return the mean square of clipped light over what it shows, up to what the scene with the most of it hides."""
    most = max(glare_fit.MOST_CLIPPED / 3 * total / clipped, 2 * glare_fit.LEAST_FACTOR)
    return (most**2 - glare_fit.LEAST_FACTOR**2) / (2 * math.log(most / glare_fit.LEAST_FACTOR))


def _shown_and_clipped(image: LuminanceImage, two_lenses: bool = False) -> tuple[Cells, Doubles]:
    """Return cells around and their light (N, 2): what is shown, and what of it is clipped."""
    cells, luminance = cells_around(image.geometry, STRAY_ROWS, two_lenses), luminance_cd_m2(image.rgb)
    masks = [image.validity != Validity.OUTSIDE, image.validity == Validity.CLIPPED]
    return cells, in_cells(np.stack([luminance * mask for mask in masks], axis=-1), cells.shape)


def _plane(lens: Fisheye) -> Cells:
    """Return the cells of the whole sensor's plane. Angles are as in its middle."""
    size = max(lens.radius_px / _CELLS_A_RADIUS, 1.0)
    rows, columns = max(round(lens.height_px / size), 1), max(round(lens.width_px / size), 1)
    wide, high = lens.width_px / columns, lens.height_px / rows
    unit = lens.half_field_rad / lens.radius_px
    x = ((np.arange(columns) + 0.5) * wide - lens.axis_px[0]) * unit
    y = ((np.arange(rows) + 0.5) * high - lens.axis_px[1]) * unit
    places = np.stack(np.broadcast_arrays(x[None], y[:, None]), axis=-1).reshape(-1, 2)
    area = np.full(len(places), wide * high * unit**2)
    return Cells((rows, columns), places, area, np.hypot(*places.T) < lens.half_field_rad)


def cells_around(geometry: Geometry, rows: int, two_lenses: bool = False) -> Cells:
    """Return cells of a picture by direction: as many rows, and columns as it is wide; apart by lens if asked."""
    columns = max(round(rows * geometry.width_px / geometry.height_px), 1)
    small = in_pixels(geometry, columns, rows)
    rays, seen = directions(small)
    area = np.where(seen, solid_angles(small), 0)
    places, side = rays.reshape(-1, 3).astype(np.float64), rays.reshape(-1, 3)[:, 1] > 0 if two_lenses else None
    return Cells((rows, columns), places, area.reshape(-1), seen.reshape(-1), side)


def _means(picture: Floats | Flags, shape: tuple[int, int]) -> Floats:
    return np.asarray(cv2.resize(np.asarray(picture, np.float32), shape[::-1], interpolation=cv2.INTER_AREA))


def in_cells(picture: Floats, shape: tuple[int, int]) -> Doubles:
    """Return means (N, C) of a picture (H, W) or (H, W, C) over its cells."""
    small = cv2.resize(np.asarray(picture, np.float32), shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(small.reshape(shape[0] * shape[1], -1), dtype=np.float64)


def bound_from_darkest(image: LuminanceImage) -> tuple[float, float]:
    """Return an upper bound of the glare, cd/m2 and index: the median of the darkest thousandth of what is shown.

    Valid and dark pixels count. Raises `LensError` for a picture in which nothing is valid.
    """
    usable = (image.validity == Validity.VALID) | (image.validity == Validity.DARK)
    if not usable.any():
        raise LensError("the picture has no valid pixels")
    luminance = luminance_cd_m2(image.rgb)
    if not (np.isfinite(luminance.sum(dtype=np.float64)) and luminance.min() >= 0):
        raise ParameterError("the picture holds values that light cannot have (negative or not finite)")
    count = max(1, int(_DARKEST_SHARE * int(usable.sum())))
    limit = np.partition(luminance[usable], count - 1)[count - 1]
    veil = float(np.median(luminance[usable & (luminance <= limit)]))
    field = float(luminance[usable].mean(dtype=np.float64))
    return veil, min(1.0, veil / field) if field > 0 else 0.0
