"""What a picture of the sphere may be: four geometries; the package states the convention that they share."""

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from processing.errors import LensError, ParameterError
from processing.ground.arrays import Doubles, Flags

SUM_TOLERANCE = 1e-6  # of a polynomial's coefficients from 1; chosen


class LensMapping(StrEnum):
    """How the angle theta from a fisheye's axis becomes the distance r from its centre (r = 1 at the edge)."""

    EQUIDISTANT = "equidistant"
    EQUISOLID = "equisolid"
    STEREOGRAPHIC = "stereographic"
    ORTHOGRAPHIC = "orthographic"
    POLYNOMIAL = "polynomial"
    """theta / half_field = c1 r + c2 r2 + ... (monotone in 0..1); coefficients as calibrated, sum 1."""


@dataclass(frozen=True)
class Equirectangular:
    """The whole sphere: longitude across, latitude down; its middle column sees longitude ``yaw_rad``."""

    width_px: int
    height_px: int
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        _check_size(self.width_px, self.height_px)
        _check_finite("yaw_rad", self.yaw_rad)


@dataclass(frozen=True)
class Perspective:
    """A pinhole view: horizontal field ``fov_x_rad``, square pixels, looking at (yaw, pitch), then rolled clockwise."""

    width_px: int
    height_px: int
    fov_x_rad: float
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    def __post_init__(self) -> None:
        _check_size(self.width_px, self.height_px)
        for name in ("fov_x_rad", "yaw_rad", "pitch_rad", "roll_rad"):
            _check_finite(name, getattr(self, name))
        if not 0 < self.fov_x_rad < math.pi:
            advice = "give a field between 0 and pi"
            raise ParameterError(f"a perspective view of {self.fov_x_rad} rad", advice=advice, fov_x_rad=True)

    @property
    def focal_px(self) -> float:
        """Return the distance of the picture's plane from the eye, in pixels."""
        return self.width_px / 2 / math.tan(self.fov_x_rad / 2)


@dataclass(frozen=True)
class Fisheye:
    """A circular picture that looks straight up.

    The picture's up is the compass-like angle ``top_azimuth_rad`` (from +y towards +x), and, as in any photograph of
    the sky from below with north at the top, east is on the left. ``radius_px`` is where ``half_field_rad`` falls.
    """

    width_px: int
    height_px: int
    mapping: LensMapping
    radius_px: float
    half_field_rad: float = math.pi / 2
    centre_px: tuple[float, float] | None = None
    """Column and row of the axis; None: the middle of the picture."""
    top_azimuth_rad: float = 0.0
    polynomial: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _check_size(self.width_px, self.height_px)
        for name in ("radius_px", "half_field_rad", "top_azimuth_rad"):
            _check_finite(name, getattr(self, name))
        for value in (*(self.centre_px or ()), *self.polynomial):
            _check_finite("centre_px and polynomial", value)
        if self.radius_px <= 0:
            raise LensError(f"an image circle of radius {self.radius_px} px", advice="give a radius above 0")
        _check_field(self.mapping, self.half_field_rad)
        _check_polynomial(self.mapping, self.polynomial)

    @property
    def axis_px(self) -> tuple[float, float]:
        """Return column and row of the axis."""
        return self.centre_px or (self.width_px / 2, self.height_px / 2)

    def offsets_px(self) -> tuple[Doubles, Doubles]:
        """Return how far pixels' middles are to the right of the axis (1, W), and below it (H, 1)."""
        x, y = self.axis_px
        across, down = (np.arange(n, dtype=np.float64) + 0.5 for n in (self.width_px, self.height_px))
        return (across - x)[None, :], (down - y)[:, None]


Geometry = Equirectangular | Perspective | Fisheye


def in_pixels(geometry: Geometry, width_px: int, height_px: int) -> Geometry:
    """Return the same field in a picture of another size, and, but for rounding of the width, of the same shape."""
    size: dict[str, Any] = {"width_px": width_px, "height_px": height_px}
    if isinstance(geometry, Fisheye):
        scale, (x, y) = height_px / geometry.height_px, geometry.axis_px
        size |= {"radius_px": geometry.radius_px * scale, "centre_px": (x * scale, y * scale)}
    return dataclasses.replace(geometry, **size)


def _check_size(width_px: int, height_px: int) -> None:
    if width_px < 1 or height_px < 1:
        raise ParameterError(f"a picture of {width_px} x {height_px} px", advice="give at least 1 x 1")


def _check_finite(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise ParameterError(f"{name} is {value}", advice="give a finite number")


def _check_field(mapping: LensMapping, half_field_rad: float) -> None:
    most = {LensMapping.ORTHOGRAPHIC: math.pi / 2, LensMapping.STEREOGRAPHIC: math.pi * 0.999}.get(mapping, math.pi)
    if not 0 < half_field_rad <= most:
        text = f"a fisheye, {mapping}, with a half field of {half_field_rad} rad"
        advice = f"give a half field above 0 and up to {most:.4f} rad"
        raise LensError(text, likely="degrees were given, or the full field", advice=advice)


def _check_polynomial(mapping: LensMapping, coefficients: tuple[float, ...]) -> None:
    if (mapping is LensMapping.POLYNOMIAL) != bool(coefficients):
        advice = "give coefficients to the polynomial mapping, and to no other"
        raise LensError(f"a fisheye, {mapping}, with the coefficients {list(coefficients)}", advice=advice)
    if not coefficients:
        return
    total = math.fsum(coefficients)
    if abs(total - 1) > SUM_TOLERANCE:
        text = f"the lens polynomial's coefficients sum to {total}, not 1"
        likely = "they belong to another radius or half field, or were rounded"
        raise LensError(text, likely=likely, advice="divide them by their sum and the half field by the same")
    slopes = sum(k * c * np.linspace(0, 1, 1001) ** (k - 1) for k, c in enumerate(coefficients, start=1))
    if np.min(slopes) <= 0:
        text = "the lens polynomial is not monotone between 0 and 1"
        likely = "it was fitted to too few points, or extrapolates"
        raise LensError(text, likely=likely, advice="fit it again with fewer terms, or to the whole field")


# Radial mappings of fisheyes: the polar angle of a radius and back, both ways to rounding error.
#
# Radii are relative (1 at ``half_field_rad``). Angles are handed on as sine and cosine, because an orthographic lens's
# angle near 90 degrees is known far worse than its sine.

FIELD_TOLERANCE_RAD = 1e-9  # a direction computed to lie on the field's edge is inside it
TABLE_SIZE = 257  # start of Newton's steps; chosen
NEWTON_STEPS = 4  # from a table of 257 points each step squares the error: three reach rounding, one is spare


def polar_of_radius(lens: Fisheye, radius: Doubles) -> tuple[Doubles, Doubles]:
    """Return sine and cosine of the angle from the axis at relative radii 0..1. All of one shape, float64."""
    half = lens.half_field_rad
    if lens.mapping is LensMapping.ORTHOGRAPHIC:
        sine = radius * math.sin(half)
        return sine, np.sqrt((1 - sine) * (1 + sine))
    if lens.mapping is LensMapping.EQUISOLID:
        s = radius * math.sin(half / 2)
        return 2 * s * np.sqrt((1 - s) * (1 + s)), 1 - 2 * s * s
    if lens.mapping is LensMapping.STEREOGRAPHIC:
        t = radius * math.tan(half / 2)
        return 2 * t / (1 + t * t), (1 - t) * (1 + t) / (1 + t * t)
    theta = half * (radius if lens.mapping is LensMapping.EQUIDISTANT else polynomial(lens, radius))
    return np.sin(theta), np.cos(theta)


def radius_of_polar(lens: Fisheye, flat: Doubles, height: Doubles) -> tuple[Doubles, Flags]:
    """Return relative radii, at most 1, of directions (``flat`` across, ``height`` along the axis), and who is seen.

    All of one shape; ``flat`` and ``height`` in any common unit.
    """
    half = lens.half_field_rad
    theta = np.arctan2(flat, height)
    seen = theta <= half + FIELD_TOLERANCE_RAD
    if lens.mapping is LensMapping.ORTHOGRAPHIC:
        radius = flat / np.maximum(np.hypot(flat, height), np.finfo(float).tiny) / math.sin(half)
        radius = np.where(seen, radius, 1.0)
    elif lens.mapping is LensMapping.EQUISOLID:
        radius = np.sin(theta / 2) / math.sin(half / 2)
    elif lens.mapping is LensMapping.STEREOGRAPHIC:
        radius = np.tan(np.minimum(theta, half) / 2) / math.tan(half / 2)
    elif lens.mapping is LensMapping.EQUIDISTANT:
        radius = theta / half
    else:
        radius = inverse_polynomial(lens, np.minimum(theta / half, 1.0))
    return np.minimum(radius, 1.0), seen


def radial_density(lens: Fisheye, radius: Doubles) -> Doubles:
    """Return the solid angle of a unit of relative area, sin(theta) theta'(r) / r, at relative radii 0..1 (steradians).

    At the edge of an orthographic hemisphere it has no bound; there a very large number is returned. Both of one shape.
    """
    half = lens.half_field_rad
    sine, cosine = polar_of_radius(lens, radius)
    if lens.mapping is LensMapping.ORTHOGRAPHIC:
        return math.sin(half) ** 2 / np.maximum(cosine, 1e-9)
    if lens.mapping is LensMapping.EQUISOLID:
        return np.full_like(radius, 4 * math.sin(half / 2) ** 2)
    if lens.mapping is LensMapping.STEREOGRAPHIC:
        return math.tan(half / 2) ** 2 * (1 + cosine) ** 2
    slope = np.ones_like(radius) if lens.mapping is LensMapping.EQUIDISTANT else polynomial_slope(lens, radius)
    steepness = half * slope
    return np.where(radius > 1e-9, sine / np.maximum(radius, 1e-9), steepness) * steepness


def polynomial(lens: Fisheye, radius: Doubles) -> Doubles:
    """Return theta / half_field of relative radii. Both of one shape."""
    return np.asarray(np.polyval([*reversed(lens.polynomial), 0.0], radius))


def polynomial_slope(lens: Fisheye, radius: Doubles) -> Doubles:
    """Return the derivative of `polynomial`. Both of one shape."""
    return np.asarray(np.polyval([k * c for k, c in enumerate(lens.polynomial, 1)][::-1], radius))


def inverse_polynomial(lens: Fisheye, share: Doubles) -> Doubles:
    """Return the radii 0..1 at which `polynomial` is ``share`` 0..1 (of one shape): a table's guess, then Newton."""
    knots = np.linspace(0, 1, TABLE_SIZE)
    radius = np.interp(share, polynomial(lens, knots), knots)
    for _ in range(NEWTON_STEPS):
        slope = np.maximum(polynomial_slope(lens, radius), 1e-6)
        radius = np.clip(radius - (polynomial(lens, radius) - share) / slope, 0.0, 1.0)
    return np.asarray(radius)


KINDS: dict[str, type[Geometry]] = {"equirectangular": Equirectangular, "perspective": Perspective, "fisheye": Fisheye}


def geometry_to_json(geometry: Geometry) -> dict[str, object]:
    """Return a geometry as JSON values: its kind and its fields; `geometry_from_json` gives an equal one back."""
    kind = next(name for name, cls in KINDS.items() if type(geometry) is cls)
    values = {field.name: getattr(geometry, field.name) for field in dataclasses.fields(geometry)}
    plain = {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}
    return {"kind": kind} | {k: str(v) if isinstance(v, LensMapping) else v for k, v in plain.items()}


def geometry_from_json(data: object) -> Geometry:
    """Return the geometry that `geometry_to_json` wrote.

    Raises `ParameterError` naming the field unless every field is there, of its type, finite, and sizes are positive.
    """
    if not isinstance(data, Mapping):
        raise ParameterError(f"a geometry is an object, not {type(data).__name__}")
    cls = KINDS.get(str(data.get("kind")))
    if cls is None:
        raise ParameterError(f"unknown kind of geometry {data.get('kind')!r}", advice=f"one of {', '.join(KINDS)}")
    hints = typing.get_type_hints(cls)
    if set(data) != {"kind", *hints}:
        raise ParameterError(f"{cls.__name__} has the fields {sorted(hints)}, not {sorted(set(data) - {'kind'})}")
    values: dict[str, Any] = {name: _value(name, data[name], hint) for name, hint in hints.items()}
    return cls(**values)


def _value(name: str, value: object, hint: object) -> object:
    """Return a field's value as its type; tuples of numbers were lists."""
    if hint is LensMapping:
        if value not in list(LensMapping):
            raise ParameterError(f"{name}: unknown lens mapping {value!r}", advice=f"one of {', '.join(LensMapping)}")
        return LensMapping(str(value))
    if hint is int:
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ParameterError(f"{name} is a positive whole number, not {value!r}")
        return value
    if hint is float:
        return _number(name, value)
    if value is None and isinstance(hint, types.UnionType):
        return None
    if not isinstance(value, list) or (isinstance(hint, types.UnionType) and len(value) != 2):
        raise ParameterError(f"{name} is a list of numbers, not {value!r}")
    return tuple(_number(name, one) for one in value)


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ParameterError(f"{name} is a finite number, not {value!r}")
    return float(value)
