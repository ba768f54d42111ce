"""Light on a plane from a picture in cd/m2, with its uncertainty, and the comparison with a measured value.

Illuminance is the sum over pixel centres of luminance x cos(angle to the normal) x solid angle: exact solid angles,
float64 sums. Of a uniform hemisphere it is pi L, of a CIE overcast sky 7 pi / 9 of its zenith's luminance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, Floats, Vector
from processing.ground.kernels import compiled
from processing.ground.threads import at_once, side_by_side
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity, luminance_cd_m2
from processing.pictures.modes import LEVEL_SHIFT, LEVELS, ROWS_AT_ONCE, level_error, placed_parts
from processing.sphere import Equirectangular
from processing.sphere.area import projected_bands

UP = (0.0, 0.0, 1.0)  # a level plane's normal
READING_KEY = "level_lux_reading"
"""Attribute of a picture scaled by a lux meter: what it read on a level plane, lx, and its relative uncertainty."""
SAME_LIGHT = 1e-4  # relative: a picture that was changed since has another illuminance than the reading
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


def luminance_map(image: LuminanceImage) -> Floats:
    """Return luminance in cd/m2, float32 (H, W)."""
    return luminance_cd_m2(image.rgb)


def illuminance_lx(image: LuminanceImage, normal: Sequence[float] = UP) -> Illuminance:
    """Return the illuminance on a plane with this normal (world axes, any length) from what the picture shows.

    Raises `ParameterError` for a normal that is no direction.
    """
    return illuminances_lx(image, [normal])[0]


def illuminances_lx(image: LuminanceImage, normals: Sequence[Sequence[float]]) -> list[Illuminance]:
    """Return `illuminance_lx` of several planes; of a panorama, whose rows come in bands, in one pass."""
    directions, whole = [_unit(normal) for normal in normals], isinstance(image.geometry, Equirectangular)
    found = list[Illuminance]()
    for some in [directions] if whole else [[one] for one in directions]:
        sums, levels, off = np.zeros((len(some), 5 + len(Validity))), np.zeros((len(some), LEVELS)), np.zeros(())
        planes = [iter(projected_bands(image.geometry, one)) for one in some]
        while bands := [band for band in side_by_side(lambda plane: next(plane, None), planes) if band]:
            rows, weights = bands[0][0], [each for _, each in bands]
            picture = image.rgb[rows], image.uncertainty[rows], image.validity[rows]
            lit = zip(weights, [np.array(LUMINANCE_WEIGHTS)] * len(some), sums, levels, strict=True)
            side_by_side(at_once, [partial(_add_light, *picture, *each) for each in lit])
            for start in range(rows.start, rows.stop, ROWS_AT_ONCE):
                band = slice(start, min(start + ROWS_AT_ONCE, rows.stop))
                part = slice(band.start - rows.start, band.stop - rows.start)
                within = np.stack([each[part].astype(np.float32).ravel() for each in weights])
                off = off + np.reshape([within @ own.ravel() for own in placed_parts(image, band)], (-1, len(some))).T
        found += [_illuminance(image, *each) for each in zip(some, sums, levels, off, strict=True)]
    return found


def level_lx(images: Sequence[LuminanceImage]) -> list[float]:
    """Return the illuminances on a level plane by pictures of one geometry, without their uncertainties: a fifth of
    the time of `illuminance_lx`.
    """
    sums, levels = np.zeros((len(images), 5 + len(Validity))), np.zeros(LEVELS)
    for rows, weights in projected_bands(images[0].geometry, UP):
        for image, own in zip(images, sums, strict=True):
            picture = image.rgb[rows], image.uncertainty[rows], image.validity[rows]
            _add_light(*picture, weights, np.array(LUMINANCE_WEIGHTS), own, levels)
    return [_checked(float(own[0])) for own in sums]


def _checked(value_lx: float) -> float:
    if not (math.isfinite(value_lx) and value_lx >= 0):
        raise ParameterError("the picture holds values that light cannot have (negative, or not finite)")
    return value_lx


def _illuminance(image: LuminanceImage, normal: Vector, sums: Doubles, levels: Doubles, off: Doubles) -> Illuminance:
    """Return what `_add_light` and, by modes (M,), `placed_parts` found of a plane."""
    value, squares, straight, doubtful, seen = sums[:5].tolist()
    _checked(value)
    # A picture without a scale is a photograph through a supposed tone curve: its pixels are wrong together.
    pixels = math.sqrt(squares) if image.absolute else straight
    shared = math.hypot(level_error(image, levels), *off.tolist())
    scale = value * image.scale_uncertainty
    reading: Any = image.attributes.get(READING_KEY, (0.0, 0.0))
    if read := normal == UP and abs(value - reading[0]) <= SAME_LIGHT * reading[0]:
        # Whatever its pixels are wrong by, clipped or unseen, their sum is what the meter read.
        pixels, shared, doubtful, scale, seen = 0.0, 0.0, 0.0, value * reading[1], math.pi
    shares = {
        code.name.lower(): float(sums[5 + code]) / value if value > 0 and not read else 0.0
        for code in (Validity.CLIPPED, Validity.DARK, Validity.REPAIRED)
    }
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


@compiled
def _add_light(rgb: Any, uncertainty: Any, validity: Any, weights: Any, luminance: Any, sums: Any, levels: Any) -> None:
    """Add light to ``sums``: all, valid pixels' errors squared and straight, the others' errors, solid angle seen, and
    light by `Validity`; to ``levels`` valid light by the upper bits of its luminance (`level_error`). ``weights``
    (H, W): projected solid angles; ``luminance`` (3,): of R, G and B."""
    part = np.empty_like(sums)
    for y in range(rgb.shape[0]):
        part[:] = 0.0
        for x in range(rgb.shape[1]):
            weight = weights[y, x]
            if weight == 0.0:
                continue
            light = luminance[0] * rgb[y, x, 0] + luminance[1] * rgb[y, x, 1] + luminance[2] * rgb[y, x, 2]
            level = np.float32(light).view(np.int32) >> LEVEL_SHIFT
            light *= weight
            # Where nothing is known the value may be wrong by all of itself; by more only where it is clipped.
            error = light * min(uncertainty[y, x], 1.0)
            code = validity[y, x]
            part[0] += light
            part[5 + code] += light
            if code == 0:
                part[1] += error * error
                part[2] += error
                levels[max(level, 0)] += light
            else:
                part[3] += error
            if code != 3:
                part[4] += weight
        for k in range(sums.shape[0]):
            sums[k] += part[k]


def compare_illuminance(computed: Illuminance, measured_lx: float) -> tuple[float, str | None]:
    """Return computed / measured - 1, and one sentence where that is above the limit; measured: a lux meter's value.

    Raises `ParameterError` for a measured value that is not above 0.
    """
    if not (math.isfinite(measured_lx) and measured_lx > 0):
        raise ParameterError(f"a measured illuminance is above 0 lx, not {measured_lx}")
    difference = computed.value_lx / measured_lx - 1
    return difference, _warning(computed, measured_lx, difference) if abs(difference) > DEFAULT_LIMIT else None


def _warning(computed: Illuminance, measured_lx: float, difference: float) -> str:
    where = "above" if difference > 0 else "below"
    invalid = computed.invalid_shares.items()
    reasons = [f"{share:.0%} of it from {name} pixels" for name, share in invalid if share > 0.01]
    if computed.unseen_share > 0.01:
        reasons.append(f"{computed.unseen_share:.0%} of the hemisphere unseen")
    causes = f" ({', '.join(reasons)})" if reasons else ""
    return (
        f"the picture gives {_lux(computed.value_lx)}{causes}, "
        f"{abs(difference):.1%} {where} the measured {_lux(measured_lx)}"
    )


def _lux(value: float) -> str:
    return f"{value:.0f} lx" if value >= 1000 else f"{value:.4g} lx"


def _unit(normal: Sequence[float]) -> Vector:
    values = [float(value) for value in normal]
    length = math.hypot(*values)
    if len(values) != 3 or not (math.isfinite(length) and length > 0):
        raise ParameterError(f"a normal is three numbers, not all 0, not {values}")
    x, y, z = (value / length for value in values)
    return x, y, z


CLIPPED_SHARE = 0.01  # of an illuminance, from clipped pixels: more is worth a warning
PLANES = {
    "up": (0.0, 0.0, 1.0),
    "ahead": (0.0, 1.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "back": (0.0, -1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
}


def illuminances(image: LuminanceImage, planes: dict[str, Vector]) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return value, standard uncertainty (lx) and share from clipped pixels for each plane through the camera.

    Warnings name the planes on which so much is clipped that the value is a lower bound.
    """
    found = dict(zip(planes, illuminances_lx(image, list(planes.values())), strict=True))
    facts = {
        name: {"value": e.value_lx, "uncertainty": e.uncertainty_lx, "clipped_share": e.invalid_shares["clipped"]}
        for name, e in found.items()
    }
    low = [f"{name} ({e['clipped_share']:.0%})" for name, e in facts.items() if e["clipped_share"] > CLIPPED_SHARE]
    warning = f"illuminance is a lower bound because part comes from pixels clipped in every frame: {', '.join(low)}"
    return facts, [warning] if low else []
