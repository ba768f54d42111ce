"""Veiling glare: light that the lens scatters over the picture, as a kernel over angle that the picture itself shows.

No bracket removes it (McCann and Rizzi 2007). Outside a fisheye's image circle no ray of the scene arrives: what is
there is scattered in lens and body, more beside bright places and in ways that show how far it scatters. The kernel is
a sum of scatter that falls off as the cube of the angle beyond one of three widths (Cauchy's distribution in the
plane), and of light that is spread evenly; shares are not negative. Glare is smooth, so that it is worked out in cells
of four degrees. A clipped light has an unknown factor of what it shows, as likely at every size, which the surround
shows together with the shares. Indoors the darkest place bounds the glare from above. The index is that of ISO 9358:
glare over mean light.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtr, ndtri

from processing.errors import LensError, ParameterError
from processing.ground.arrays import Bytes, Doubles, Flags, Floats, Indices
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import ROWS_AT_ONCE, SharedMode, between
from processing.sphere import Fisheye, Geometry, directions, solid_angles

Picture = TypeVar("Picture", RelativeImage, LuminanceImage)

WIDTHS_RAD = (0.1, 0.3, 0.9)
"""Of the three parts of a kernel; chosen: from a cell to half the field, each three times the one before."""
VEIL_INDEX = 0.0125
"""Stray light over the mean luminance where none was measured; chosen: the root mean square of the 0.003 to 0.02 that
good lenses have (ISO 9358)."""
STRAY_ROWS = 16  # of the map of stray light, and twice as many columns; chosen: 11 degrees, for it is smooth
PRIOR_SHARE = VEIL_INDEX / math.sqrt(len(WIDTHS_RAD) + 1)
"""Standard deviation about 0 of each part's share before anything is measured: together a lens's usual index."""
RIM_GAP = 1.06  # in radii: nearer to the image circle the lens's own blur and its bright rim reach out
MIN_SURROUND_PX = 400  # chosen
MAX_DARK_SHARE = 0.25
"""Of the surround: where more of it is too dark to measure, what is left are the brightest by chance, not the veil."""
_DARKEST_SHARE = 0.001  # of the field; chosen
_ENOUGH_PX = 400  # of a radius, at least; chosen
_CELLS_A_RADIUS = 24  # chosen: 3.75 degrees, half the narrowest part's width at half its height
_SECTORS = 8  # of the surround, left out in turn (jackknife); chosen
_ALIKE = 4  # parts of a sector whose cells err together; chosen, by halos out of the family on validation seeds
_LEAST_MISFIT = 0.02  # relative, of a cell: no glare is smoother than that. Chosen.
_FAINT = 0.2  # of the surround's mean: below it errors are alike. Chosen.
_TARGETS = 512  # cells worked out at once: 15 MB. Chosen.
MOST_CLIPPED = 10.0
"""Light that clipping may hide, over all that is shown. Chosen: thrice the most of seven real scenes with their sun."""
_FACTORS, _LEAST_FACTOR = 48, 0.03  # of the clipped light, between which it is log-uniform; chosen
_UNMEASURED = 3  # modes; chosen: 98 % of the variance in three real scenes
_DRAWS, _SWEEPS = 256, 60  # draws, and steps to each; chosen


@dataclass(frozen=True)
class GlareKernel:
    """What a lens does with light: shares that go to each of `WIDTHS_RAD`, and last everywhere alike."""

    shares: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    misfit: float
    """Root mean square of the measured places' departure from what the kernel gives, over that of their light."""
    index: float
    """Luminance of the glare over the mean luminance of the field (veiling glare index, ISO 9358), where measured."""
    hidden: tuple[float, ...] = (0.0,) * 4
    """Shares times how much more light clipped pixels have than they show; the covariance is of both."""


class _Cells(NamedTuple):
    """A picture in cells: places (N, 2) of the sensor's plane in radians or (N, 3) directions, their areas (N,)."""

    shape: tuple[int, int]
    places: Doubles
    area: Doubles
    inside: Flags
    """(N,): whose middles are in the field."""

    def scattered(self, light: Doubles) -> Doubles:
        """Return what a share of 1 of each part gives, (parts, N, C), of light (N, C) per area."""
        sent = light * self.area[:, None]
        near = np.flatnonzero(sent.any(axis=1))
        sources, sent = self.places[near], sent[near]
        found = np.empty((len(WIDTHS_RAD) + 1, *light.shape))
        for start in range(0, len(light), _TARGETS):
            targets = self.places[start : start + _TARGETS]
            apart = (targets**2).sum(1)[:, None] + (sources**2).sum(1) - 2 * targets @ sources.T
            apart = np.maximum(apart, 0)
            if sources.shape[1] == 3:
                apart = (2 * np.arcsin(np.minimum(np.sqrt(apart) / 2, 1))) ** 2
            for k, width in enumerate(WIDTHS_RAD):
                far = apart + width**2
                found[k, start : start + _TARGETS] = (width / (2 * math.pi) / (far * np.sqrt(far))) @ sent
        found[-1] = sent.sum(axis=0) / max(float(self.area @ self.inside), 1e-30)
        return found


def kernel_from_surround(rgb: Floats, validity: Bytes, lens: Fisheye) -> GlareKernel:
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
    across, down = np.arange(width) + 0.5 - lens.axis_px[0], np.arange(height) + 0.5 - lens.axis_px[1]
    radius = np.asarray(np.hypot(across[None], down[:, None]) / lens.radius_px, dtype=np.float32)
    luminance = luminance_cd_m2(rgb)
    surround = (radius > RIM_GAP) & (validity != Validity.CLIPPED)
    _check_surround(surround, surround & (validity != Validity.DARK), radius < 1)
    cells = _plane(lens)
    # Noise about 0 averages out within cells.
    if not np.isfinite(luminance).all() or _in_cells(luminance * (radius < 1), cells.shape).min(initial=0.0) < 0:
        raise ParameterError("the picture holds values that light cannot have (negative or not finite)")
    light = _in_cells(np.stack([luminance, luminance * clipped], axis=-1) * (radius < 1)[..., None], cells.shape)
    parts = np.moveaxis(cells.scattered(light), -1, 0)
    seen = _in_cells(surround.astype(np.float32), cells.shape)[:, 0]
    level = _in_cells(np.where(surround, luminance, 0), cells.shape)[:, 0]
    use = seen > 0.5
    found, x, y = level[use] / seen[use], *cells.places[use].T
    sector = np.floor((np.arctan2(y, x) / (2 * math.pi) + 0.5) * _SECTORS).astype(int)
    most = MOST_CLIPPED * light[:, 0].sum() / max(light[:, 1].sum(), 1e-30)
    factors = np.geomspace(_LEAST_FACTOR, max(most, _LEAST_FACTOR), _FACTORS) if light[:, 1].any() else np.zeros(1)
    fit = _fit(parts[..., use], found, sector, factors)
    field = float(light[:, 0] @ cells.area / (cells.area @ cells.inside))
    index = min(1.0, float(np.median(found)) / field) if field > 0 else 0.0
    return replace(fit, index=index)


def _check_surround(surround: Flags, usable: Flags, inside: Flags) -> None:
    if int(usable.sum()) < MIN_SURROUND_PX or not inside.any():
        raise LensError(
            f"{int(usable.sum())} usable pixels around the image circle; {MIN_SURROUND_PX} are needed",
            likely="a cropped picture, or stops too short to see the surround",
            advice="give the uncropped frames, or the veil itself",
        )
    dark = 1 - float(usable.sum()) / float(surround.sum())
    if dark > MAX_DARK_SHARE:
        raise LensError(
            f"{100 * dark:.0f} % of the surround of the image circle is too dark to measure",
            likely="a veil weaker than the longest frame shows",
            advice="add a longer frame, or leave the veil on",
        )


def _fit(parts: Doubles, found: Doubles, sector: Indices, factors: Doubles) -> GlareKernel:
    """Return the kernel of places' light ``found`` (N,), of parts (2, P, N) of the light shown and of the clipped.

    Least squares with the prior's as further rows. Errors go by the root of the light, are as large as what the fit
    leaves, and alike in parts of a ``sector`` (N,). ``factors`` (H,): what clipped light may hide, over what it shows.
    """
    mean = max(float(np.mean(found)), 1e-30)
    level = np.sqrt(np.maximum(found, _FAINT * mean) * mean)
    both = parts.reshape(-1, len(found))
    table = np.vstack([both, found[None]]) / level
    # A few rows have the sums of squares of all.
    sectors = [_short(table[:, sector == k].T) for k in np.unique(sector)]
    rows = _short(np.vstack(sectors))
    alike, relative = math.sqrt(max(len(found) / (_ALIKE * _SECTORS), 1)), 0.1
    for _ in range(4):
        likeliest = _likeliest(rows / (relative * alike), factors)
        left = float(np.linalg.norm(rows @ np.append(likeliest, -1)))
        relative = max(left / math.sqrt(len(found)), _LEAST_MISFIT)
    misfit = float(np.linalg.norm(found - likeliest @ both) / max(float(np.linalg.norm(found)), 1e-30))
    scale, count = relative * alike, len(parts[0])
    shares, covariance = _posterior(rows / scale, factors, likeliest)
    others = [np.vstack(sectors[:k] + sectors[k + 1 :]) / scale for k in range(len(sectors))]
    without = np.array([_likeliest(one, factors) for one in others if len(others) > 1])
    if len(without):
        spread = without - without.mean(axis=0)
        covariance += (len(without) - 1) / len(without) * spread.T @ spread
    # A kernel that fits badly shows as little as none. Of clipped light, the spread is the geometric mean of what this
    # kernel hides and of what the prior allows.
    power = np.square(shares)
    known = float(power[count:].sum() / max(power[:count].sum(), 1e-30))
    own = np.repeat([1.0, math.sqrt(known * float(np.mean(factors**2)))], count)
    covariance += misfit * PRIOR_SHARE**2 * np.diag(own)
    rounded = tuple(map(tuple, covariance.tolist()))
    return GlareKernel(tuple(shares[:count].tolist()), rounded, misfit, 0.0, tuple(shares[count:].tolist()))


def _short(rows: Doubles) -> Doubles:
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _at(rows: Doubles, factor: float) -> tuple[Doubles, Doubles]:
    """Return the P columns of light shown plus ``factor`` times the clipped, and what they make."""
    count = rows.shape[1] // 2
    return rows[:, :count] + factor * rows[:, count:-1], rows[:, -1]


def _shares(rows: Doubles, factor: float) -> tuple[Doubles, float]:
    """Return the likeliest shares (P,) >= 0 for a factor, and their sum of squares with the prior's."""
    some, goal = _at(rows, factor)
    unit = np.eye(some.shape[1]) / PRIOR_SHARE
    shares, norm = nnls(np.vstack([some, unit]), np.append(goal, np.zeros(len(unit))))
    return np.asarray(shares), float(norm) ** 2


def _likeliest(rows: Doubles, factors: Doubles) -> Doubles:
    """Return the shares of light shown and of clipped light, (2 P,), of the factor that fits best."""
    tries = [_shares(rows, factor) for factor in factors]
    best = int(np.argmin([squares for _, squares in tries]))
    return np.concatenate([tries[best][0], factors[best] * tries[best][0]])


def _posterior(rows: Doubles, factors: Doubles, likeliest: Doubles) -> tuple[Doubles, Doubles]:
    """Return the shares (2 P,) and their covariance: where light is clipped, over all that it may hide (Gibbs).

    Given the factor, shares are Gaussian, cut off at 0; given shares, the factors' likelihoods are known. It starts
    from factors drawn by the volume of their shares (Laplace).
    """
    rng, count = np.random.default_rng(0), rows.shape[1] // 2
    tables = [_at(rows, factor) for factor in factors]
    squares = np.array([some.T @ some for some, _ in tables]) + np.eye(count) / PRIOR_SHARE**2
    if len(factors) == 1:
        covariance = np.zeros((2 * count, 2 * count))
        covariance[:count, :count] = np.linalg.inv(squares[0])
        return likeliest, covariance
    goals = np.array([some.T @ goal for some, goal in tables])
    tries = [_shares(rows, factor) for factor in factors]
    log = -0.5 * (np.array([one[1] for one in tries]) + np.linalg.slogdet(squares)[1])
    weights = np.exp(log - log.max())
    which = rng.choice(len(factors), _DRAWS, p=weights / weights.sum())
    shares = np.array([one[0] for one in tries])[which]
    for _ in range(_SWEEPS):
        square, goal = squares[which], goals[which]
        for k in range(count):
            sigma = 1 / np.sqrt(square[:, k, k])
            middle = shares[:, k] + (goal[:, k] - (square[:, k] * shares).sum(axis=1)) * sigma**2
            below = ndtr(-middle / sigma)
            drawn = ndtri(np.minimum(below + rng.random(_DRAWS) * (1 - below), 1 - 1e-12))
            shares[:, k] = np.maximum(middle + sigma * drawn, 0)
        log = shares @ goals.T - 0.5 * np.einsum("dj,hjk,dk->dh", shares, squares, shares)
        which = np.argmax(log + rng.gumbel(size=log.shape), axis=1)
    draws = np.hstack([shares, factors[which][:, None] * shares])
    return draws.mean(axis=0), np.asarray(np.cov(draws.T))


def without_glare(image: Picture, kernel: GlareKernel) -> Picture:
    """Return the picture less what the kernel scatters; the rest is raised so that the mean over the field stays.

    Arrays keep their shape and unit. What falls to 0 or below becomes 0, `Validity.DARK`, with infinite uncertainty;
    pixels outside the field stay. The kernel's own doubt is in `kernel_modes`.
    """
    if min(kernel.shares + kernel.hidden) < 0 or not math.isfinite(sum(kernel.shares + kernel.hidden)):
        raise ParameterError(f"a kernel's shares are finite and not negative, not {kernel.shares}")
    geometry, validity = image.geometry, image.validity.copy()
    cells = _plane(geometry) if isinstance(geometry, Fisheye) else _around(geometry, 2 * STRAY_ROWS)
    light = _in_cells(image.rgb, cells.shape)
    if not np.isfinite(light).all():
        raise ParameterError("the picture holds values that light cannot have (not finite)")
    light *= cells.inside[:, None]
    glare = np.tensordot(np.array(kernel.shares), cells.scattered(light), 1)
    total, scattered = (float((cells.area * cells.inside) @ one.sum(axis=1)) for one in (light, glare))
    if any(kernel.hidden):
        clipped = _in_cells(image.rgb * (validity == Validity.CLIPPED)[..., None], cells.shape) * cells.inside[:, None]
        glare += np.tensordot(np.array(kernel.hidden), cells.scattered(clipped), 1)
    gain = np.float32(total / (total - scattered) if scattered < 0.5 * total else 1.0)
    rgb, uncertainty = np.empty_like(image.rgb), image.uncertainty.copy()
    height, width = validity.shape
    down, grid = between(height, cells.shape[0]).astype(np.float32), glare.reshape(*cells.shape, 3).astype(np.float32)
    for start in range(0, height, ROWS_AT_ONCE):
        rows = slice(start, min(start + ROWS_AT_ONCE, height))
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


def kernel_modes(image: LuminanceImage, kernel: GlareKernel, *, measured: float | None = None) -> list[SharedMode]:
    """Return what is left uncertain of a kernel's glare in a picture: a mode for each axis of its covariance.

    ``measured``: luminance by which the picture was scaled, cd/m2: what is wrong there is in the scale.
    """
    cells, light = _shown_and_clipped(image)
    parts = np.concatenate(np.moveaxis(cells.scattered(light), -1, 0))[: len(kernel.covariance)]
    variances, axes = np.linalg.eigh(np.array(kernel.covariance))
    left = np.sqrt(np.maximum(variances, 0))[:, None] * (axes.T @ parts)
    found = []
    for number, glare in enumerate(left, start=1):
        known = 0.0 if measured is None else float(np.clip(glare.mean() / measured, -2, 2))
        size = (*map(float, cells.shape), known)
        found.append(SharedMode(f"stray light, measured {number}", "scatter", size, tuple(glare.tolist())))
    return found


def unmeasured_modes(image: LuminanceImage, measured: tuple[float, float, float] | None = None) -> list[SharedMode]:
    """Return what a lens may scatter whose glare was not measured: the parts of a kernel, each by itself.

    Shares are the prior's; clipped light is a factor of what it shows, as likely at every size. ``measured``: luminance
    in cd/m2, longitude and latitude in radians of the spot that set the picture's scale, which has what scatters there.
    """
    cells, light = _shown_and_clipped(image)
    parts = PRIOR_SHARE * np.moveaxis(cells.scattered(light), -1, 0)
    total, clipped = cells.area @ light
    if clipped > 0:  # up to what the scene with the most of it hides
        most = max(MOST_CLIPPED / 3 * total / clipped, 2 * _LEAST_FACTOR)
        parts[1] *= math.sqrt((most**2 - _LEAST_FACTOR**2) / (2 * math.log(most / _LEAST_FACTOR)))
    left = parts[: 2 if clipped > 0 else 1].reshape(-1, len(light))
    known = np.zeros(len(left))
    if measured is not None:
        (x, y, z), (level, longitude, latitude) = cells.places.T, measured
        near = math.cos(latitude) * (x * math.sin(longitude) + y * math.cos(longitude)) + z * math.sin(latitude)
        known = left[:, int(np.argmax(near))] / level
    # A few sums of the parts make nearly all of the relative error, and are as independent. Where glare is more than
    # twice the light (chosen), nothing is known of it either way.
    relative = np.clip(left / np.maximum(light[:, 0], 1e-30) - known[:, None], -2, 2) * np.sqrt(cells.area)
    turn = np.linalg.svd(relative, full_matrices=False)[0].T[:_UNMEASURED]
    return [
        SharedMode(f"stray light {number}", "scatter", (*map(float, cells.shape), float(own)), tuple(glare.tolist()))
        for number, (glare, own) in enumerate(zip(turn @ left, turn @ known, strict=True), start=1)
    ]


def _shown_and_clipped(image: LuminanceImage) -> tuple[_Cells, Doubles]:
    """Return cells around and their light (N, 2): what is shown, and what of it is clipped."""
    cells, luminance = _around(image.geometry, STRAY_ROWS), luminance_cd_m2(image.rgb)
    masks = [image.validity != Validity.OUTSIDE, image.validity == Validity.CLIPPED]
    return cells, _in_cells(np.stack([luminance * mask for mask in masks], axis=-1), cells.shape)


def _plane(lens: Fisheye) -> _Cells:
    """Return the cells of the whole sensor's plane. Angles are as in its middle."""
    size = max(lens.radius_px / _CELLS_A_RADIUS, 1.0)
    rows, columns = max(round(lens.height_px / size), 1), max(round(lens.width_px / size), 1)
    wide, high = lens.width_px / columns, lens.height_px / rows
    unit = lens.half_field_rad / lens.radius_px
    x = ((np.arange(columns) + 0.5) * wide - lens.axis_px[0]) * unit
    y = ((np.arange(rows) + 0.5) * high - lens.axis_px[1]) * unit
    places = np.stack(np.broadcast_arrays(x[None], y[:, None]), axis=-1).reshape(-1, 2)
    area = np.full(len(places), wide * high * unit**2)
    return _Cells((rows, columns), places, area, np.hypot(*places.T) < lens.half_field_rad)


def _around(geometry: Geometry, rows: int) -> _Cells:
    """Return cells of a picture by direction: as many rows, and columns as it is wide."""
    columns, scale = max(round(rows * geometry.width_px / geometry.height_px), 1), rows / geometry.height_px
    small: Geometry
    if isinstance(geometry, Fisheye):
        centre, radius = (geometry.axis_px[0] * scale, geometry.axis_px[1] * scale), geometry.radius_px * scale
        small = replace(geometry, width_px=columns, height_px=rows, radius_px=radius, centre_px=centre)
    else:
        small = replace(geometry, width_px=columns, height_px=rows)
    rays, seen = directions(small)
    area = np.where(seen, solid_angles(small), 0)
    return _Cells((rows, columns), rays.reshape(-1, 3).astype(np.float64), area.reshape(-1), seen.reshape(-1))


def _means(picture: Floats | Flags, shape: tuple[int, int]) -> Floats:
    return np.asarray(cv2.resize(np.asarray(picture, np.float32), shape[::-1], interpolation=cv2.INTER_AREA))


def _in_cells(picture: Floats, shape: tuple[int, int]) -> Doubles:
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
