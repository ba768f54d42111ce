"""How far off figures of a picture may be: by what all its pixels share, and by each pixel's own noise (GUM 5).

Figures are functions of sums over pixels. A shared cause moves all sums together; noise is independent from pixel to
pixel, and averages out in sums. Quantiles and extremes of noisy pixels lie too far out besides: more noise of the kind
shows by how much.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.calibration.scale.photometry import CLIPPED_SHARE, Illuminance, luminance_map
from processing.ground.arrays import Doubles, Flags, Floats, Indices
from processing.pictures.images import LuminanceImage, Validity
from processing.pictures.modes import modes_of, relative_error

QUANTILES = {"lowest": 0.0, "p05": 0.05, "median": 0.5, "p95": 0.95, "highest": 1.0}  # of solid angle
AGAIN = 2.0  # times the noise, put on once more to see what it does to quantiles; chosen
MOVED = 1 / (math.sqrt(1 + AGAIN**2) - 1)
"""Of what noise moved a quantile by, over what more of it moves it by then: of pixels of one luminance, by spreads."""
REACH = math.sqrt(math.pi) / 2
"""Standard deviations within which pixels' mean varies as their quantile does, where luminances are evenly spread."""
Figure = dict[str, Any]
"""``value``; ``uncertainty``: standard, None where it is not known; ``bound``: "lower", "upper",
"unknown" (a ratio of two lower bounds) or None."""
Part = tuple[str, str, Flags]  # name, kind and pixels (H, W)


@dataclass(frozen=True)
class Doubt:
    """What sums over a picture's luminance may be off by, for one standard deviation of each cause."""

    shifts: Doubles
    """(C, K): of K sums by each cause that pixels share, the common scale last; in the sums' units."""
    variance: Doubles
    """(H, W): of each pixel's luminance by itself, squared units of the picture."""
    known: bool
    """False: the uncertainty of the common scale is not known, so that none is."""

    def figure(self, value: float, parts: Iterable[float], bound: str | None = None) -> Figure:
        """Return a figure whose causes change it by ``parts``, in its unit."""
        return {"value": value, "uncertainty": math.hypot(*parts) if self.known else None, "bound": bound}


def doubt_of(image: LuminanceImage, sums: Callable[[npt.NDArray[np.floating]], Doubles]) -> Doubt:
    """Return what linear sums may be off by; ``sums`` makes them (K,) of a map (H, W) in the picture's unit.

    A pixel's own part is what its uncertainty holds beyond the shared modes. Pixels that are not valid may all be wrong
    in one direction, and so may those of a picture without scale: a photograph through a supposed tone curve.
    """
    level, valid = luminance_map(image), image.validity == Validity.VALID
    error = level * np.minimum(image.uncertainty, np.float32(1))
    variance, rows = np.square(error * valid, dtype=np.float64), [sums(error * ~valid)]
    for mode in modes_of(image):
        off = level * relative_error(mode, image, level) * valid
        rows.append(sums(off))
        variance -= np.square(off, dtype=np.float64)
    np.maximum(variance, 0, out=variance)
    if not image.absolute:
        rows.append(sums(np.sqrt(variance)))
        variance[:] = 0
    known = math.isfinite(image.scale_uncertainty)
    rows.append(sums(level) * (image.scale_uncertainty if known else 0.0))
    return Doubt(np.stack(rows), variance, known)


def light_figure(light: Illuminance) -> Figure:
    """Return an illuminance as plain values, with the share of it that is clipped."""
    clipped = light.invalid_shares["clipped"]
    bound = "lower" if max(clipped, light.unseen_share) > CLIPPED_SHARE else None
    off = light.uncertainty_lx if math.isfinite(light.scale_lx) else None
    return {"value": light.value_lx, "uncertainty": off, "bound": bound, "clipped_share": clipped}


def statistics(image: LuminanceImage, area_sr: Doubles, parts: Sequence[Part]) -> list[dict[str, Any]]:
    """Return statistics of a picture's parts as plain values, without those of which it shows nothing.

    Of each ``name``, ``kind``, ``solid_angle_sr``, ``clipped_share`` of it, where values are lower bounds, and by solid
    angle ``mean`` and `QUANTILES`. Dark pixels count too. ``area_sr`` (H, W): solid angles, steradians.
    """
    level, area = luminance_map(image).ravel(), area_sr.ravel()
    error, clipped = level * np.minimum(image.uncertainty.ravel(), np.float32(1)), image.validity == Validity.CLIPPED
    seen = (image.validity != Validity.OUTSIDE) & (area_sr > 0)
    there = [(name, kind, np.flatnonzero(mask & seen)) for name, kind, mask in parts if np.any(mask & seen)]
    if not there:
        return []
    sums = [one for _, _, where in there for one in _sums(where, level[where], area[where], error[where])]
    doubt = doubt_of(image, lambda light: np.array([weights @ light.ravel()[at] for at, weights in sums]))
    own = [math.sqrt(weights**2 @ doubt.variance.ravel()[at]) for at, weights in sums]
    off = np.vstack([doubt.shifts, own]).T.reshape(len(there), 1 + len(QUANTILES), -1)
    noise = np.random.default_rng(0).standard_normal(len(level), np.float32)
    noisy, found = np.maximum(level + AGAIN * noise * np.sqrt(doubt.variance.ravel()), 0), []
    for (name, kind, where), causes in zip(there, off, strict=True):
        values, again, weights, lost = level[where], noisy[where], area[where], clipped.ravel()[where]
        light, rank = values * weights, _ranked(values, weights)
        shown = np.append(light.sum() / weights.sum(), values[rank])
        further = np.append(0.0, MOVED * (again[_ranked(again, weights)] - values[rank]))
        low = np.append(
            light[lost].sum() > CLIPPED_SHARE * light.sum(), values[rank] >= values[lost].min(initial=np.inf)
        )
        facts = {"name": name, "kind": kind, "solid_angle_sr": float(weights.sum())}
        facts["clipped_share"] = float(weights[lost].sum() / weights.sum())
        every = zip(("mean", *QUANTILES), shown.tolist(), causes, further, low, strict=True)
        found.append(facts | {k: doubt.figure(v, [*c, more], "lower" if b else None) for k, v, c, more, b in every})
    return found


def _sums(where: Indices, values: Floats, weights: Doubles, error: Floats) -> list[tuple[Indices, Doubles]]:
    """Return which pixels, with which weights, make a part's mean and, near them, `QUANTILES`: all of the part (N,)."""
    found = [(where, weights / weights.sum())]
    for share, k in zip(QUANTILES.values(), _ranked(values, weights), strict=True):
        # Where a quantile lies is decided by the pixels that noise can carry over it; an extreme is one pixel.
        near = np.flatnonzero(np.abs(values - values[k]) <= REACH * error) if 0 < share < 1 else np.array([k])
        found.append((where[near], weights[near] / weights[near].sum()))
    return found


def _ranked(values: Floats | Doubles, weights: Doubles) -> Indices:
    """Return which of the values (N,) are `QUANTILES` by their weights."""
    order = np.argsort(values)
    upto = np.cumsum(weights[order])
    at = np.searchsorted(upto, np.array(list(QUANTILES.values())) * upto[-1])
    at[-1] = len(order) - 1
    return np.asarray(order[np.minimum(at, len(order) - 1)])
