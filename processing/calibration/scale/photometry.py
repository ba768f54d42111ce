"""Light on a plane from a picture in cd/m2, with its uncertainty, and the comparison with a measured value.

Illuminance is the sum over pixel centres of luminance x cos(angle to the normal) x solid angle: exact solid angles,
float64 sums. Of a uniform hemisphere it is pi L, of a CIE overcast sky 7 pi / 9 of its zenith's luminance.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Floats
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from processing.pictures.modes import shared_error
from processing.sphere import Geometry, projected_solid_angles

UP = (0.0, 0.0, 1.0)  # a level plane's normal
DEFAULT_LIMIT = 0.10
"""Relative difference from a lux meter above which a warning is given (a good meter's own error is 3 to 5 %)."""


@dataclass(frozen=True)
class Illuminance:
    """Illuminance on a plane, and what is to be known about it."""

    value_lx: float
    uncertainty_lx: float
    """Standard uncertainty: the root of the squares of the four parts below."""
    pixels_lx: float
    """Part of the valid pixels' own, independent uncertainties."""
    shared_lx: float
    """Part of what all pixels share, but for the scale: curve, times, stray light, lenses (`SharedMode`)."""
    doubtful_lx: float
    """Part of the pixels that are not valid, which may all be wrong in one direction: their sum, not its root."""
    scale_lx: float
    """Part of the factor that all pixels share."""
    invalid_shares: dict[str, float]
    """How much of the value comes from clipped, dark and repaired pixels, 0 to 1 each."""
    unseen_share: float
    """How much of the half space over the plane, by cosine, the picture does not show (counted as black)."""

    @property
    def lower_bound(self) -> bool:
        """Whether the true value may be far above: light was clipped, or the picture shows only a part."""
        return self.invalid_shares["clipped"] > 0 or self.unseen_share > 0.01


@dataclass(frozen=True)
class IlluminanceComparison:
    """A computed illuminance beside a measured one."""

    computed_lx: float
    measured_lx: float
    difference: float
    """computed / measured - 1."""
    sigmas: float
    """The difference in units of its standard uncertainty; infinite where both uncertainties are 0 and they differ."""
    limit: float
    warning: str | None
    """One sentence, where the difference is above the limit."""


def luminance_map(image: LuminanceImage) -> Floats:
    """Return luminance in cd/m2, float32 (H, W)."""
    return luminance_cd_m2(image.rgb)


def illuminance_lx(image: LuminanceImage, normal: Sequence[float] = UP) -> Illuminance:
    """Return the illuminance on a plane with this normal (world axes, any length) from what the picture shows.

    Raises `ParameterError` for a normal that is no direction.
    """
    direction = _unit(normal)
    weights = _weights(image.geometry, direction)
    with np.errstate(invalid="ignore"):
        parts = weights * luminance_cd_m2(image.rgb)
    value = float(parts.sum())
    if not (math.isfinite(value) and value >= 0):
        raise ParameterError("the picture holds values that light cannot have (negative, or not finite)")
    # Where nothing is known the value may be wrong by all of itself; by more only where it is clipped.
    errors = parts * np.minimum(image.uncertainty, 1.0)
    valid = image.validity == Validity.VALID
    # A picture without a scale is a photograph through a supposed tone curve: its pixels are wrong together.
    pixels = math.sqrt(float(np.square(errors[valid]).sum())) if image.absolute else float(errors[valid].sum())
    shared = shared_error(image, weights * valid)
    doubtful = float(errors[~valid].sum())
    scale = value * image.scale_uncertainty
    shares = {
        code.name.lower(): float(parts[image.validity == code].sum()) / value if value > 0 else 0.0
        for code in (Validity.CLIPPED, Validity.DARK, Validity.REPAIRED)
    }
    seen = float(weights[image.validity != Validity.OUTSIDE].sum())
    return Illuminance(
        value_lx=value,
        uncertainty_lx=math.hypot(pixels, shared, doubtful, scale),
        pixels_lx=pixels,
        shared_lx=shared,
        doubtful_lx=doubtful,
        scale_lx=scale,
        invalid_shares=shares,
        unseen_share=min(1.0, max(0.0, 1 - seen / math.pi)),
    )


def compare_illuminance(
    computed: Illuminance, measured_lx: float, *, measured_uncertainty: float = 0.0, limit: float = DEFAULT_LIMIT
) -> IlluminanceComparison:
    """Compare with a lux meter's value (its relative standard uncertainty); a warning says when it is off by more.

    Raises `ParameterError` for a measured value that is not above 0, and for a negative uncertainty or limit.
    """
    if not (math.isfinite(measured_lx) and measured_lx > 0):
        raise ParameterError(f"a measured illuminance is above 0 lx, not {measured_lx}")
    if not (measured_uncertainty >= 0 and limit > 0):
        raise ParameterError("an uncertainty is not negative, and a limit is above 0")
    off_lx = computed.value_lx - measured_lx
    difference = off_lx / measured_lx
    sigma_lx = math.hypot(computed.uncertainty_lx, measured_uncertainty * measured_lx)
    sigmas = abs(off_lx) / sigma_lx if sigma_lx > 0 else (math.inf if off_lx else 0.0)
    warning = _warning(computed, measured_lx, difference) if abs(difference) > limit else None
    return IlluminanceComparison(computed.value_lx, measured_lx, difference, sigmas, limit, warning)


def _warning(computed: Illuminance, measured_lx: float, difference: float) -> str:
    where = "above" if difference > 0 else "below"
    reasons = [
        f"{share:.0%} of it from {name} pixels" for name, share in computed.invalid_shares.items() if share > 0.01
    ]
    if computed.unseen_share > 0.01:
        reasons.append(f"{computed.unseen_share:.0%} of the half space not shown")
    causes = f" ({', '.join(reasons)})" if reasons else ""
    return (
        f"the picture gives {_lux(computed.value_lx)}{causes}, "
        f"{abs(difference):.1%} {where} the measured {_lux(measured_lx)}"
    )


def _lux(value: float) -> str:
    return f"{value:.0f} lx" if value >= 1000 else f"{value:.4g} lx"


def _unit(normal: Sequence[float]) -> tuple[float, float, float]:
    values = [float(value) for value in normal]
    length = math.hypot(*values)
    if len(values) != 3 or not (math.isfinite(length) and length > 0):
        raise ParameterError(f"a normal is three numbers, not all 0, not {values}")
    x, y, z = (value / length for value in values)
    return x, y, z


@functools.lru_cache(maxsize=2)
def _weights(geometry: Geometry, normal: tuple[float, float, float]) -> Doubles:
    """Return projected solid angles; the last two are kept (a full-size one is 180 MB)."""
    weights = projected_solid_angles(geometry, normal)
    weights.flags.writeable = False
    return weights


CLIPPED_SHARE = 0.01
"""Of an illuminance, from clipped pixels: more is worth a warning."""
PLANES = {
    "up": (0.0, 0.0, 1.0),
    "ahead": (0.0, 1.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "back": (0.0, -1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
}


def illuminances(
    image: LuminanceImage, planes: dict[str, tuple[float, float, float]]
) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return value, standard uncertainty (lx) and share from clipped pixels for each plane through the camera.

    Warnings name the planes on which so much is clipped that the value is a lower bound.
    """
    found = {name: illuminance_lx(image, normal) for name, normal in planes.items()}
    facts = {
        name: {"value": e.value_lx, "uncertainty": e.uncertainty_lx, "clipped_share": e.invalid_shares["clipped"]}
        for name, e in found.items()
    }
    low = [f"{name} ({e['clipped_share']:.0%})" for name, e in facts.items() if e["clipped_share"] > CLIPPED_SHARE]
    warning = f"illuminance is a lower bound, as part of it comes from pixels clipped in every frame: {', '.join(low)}"
    return facts, [warning] if low else []
