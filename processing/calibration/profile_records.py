"""What a calibration profile holds, as plain strict records: curve, noise, shutter, lens, filter."""

import hashlib
from itertools import pairwise
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from processing.calibration.outdoor.lens import ImageCircle, LensModel
from processing.calibration.outdoor.nd_filter import NdFilter
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.shutter import RULE_SIGMA_STOPS, ShutterRule, true_time_s
from processing.calibration.scale.glare_fit import WIDTHS_RAD, GlareKernel
from processing.calibration.scale.vignetting import Vignetting
from processing.ground.arrays import Rgb
from processing.sphere import LensMapping
from station.session.session import Model, SafeText

NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
_UNKNOWN_STOPS = 99.0  # written for an uncertainty without bound: JSON has no infinity
_SAME_TIME_FRAC = 0.01  # chosen: dials differ by more
_MODE_DIGITS = 6  # of stops; chosen: a hundredth of a mode that counts, in a third of the file
_CODES = Annotated[tuple[float, ...], Field(min_length=2, max_length=65_536)]


class _Record(Model):
    @classmethod
    def of(cls, found: ResponseCurve | NoiseModel | Vignetting | NdFilter | GlareKernel) -> Self:
        """Return the record of what has fields of the same names."""
        every = {name: getattr(found, name) for name in cls.model_fields}
        if "sigma_log2" in every:
            every["sigma_log2"] = np.nan_to_num(every["sigma_log2"], nan=_UNKNOWN_STOPS, posinf=_UNKNOWN_STOPS)
        if every.get("modes") is not None:
            every["modes"] = np.round(every["modes"], _MODE_DIGITS)
        return cls(**{name: _plain(value) for name, value in every.items()})


def _plain(value: Any) -> Any:
    """Return arrays, tuples and NumPy's numbers as plain ones."""
    return np.asarray(value).tolist() if isinstance(value, np.ndarray | tuple | np.generic) else value


class ResponseRecord(_Record):
    """A response curve (`ResponseCurve`): stops by code, a row a channel."""

    log2_exposure: tuple[_CODES, _CODES, _CODES]
    sigma_log2: tuple[_CODES, _CODES, _CODES]
    low: tuple[int, int, int]
    high: tuple[int, int, int]
    gauge_code: Annotated[int, Field(ge=0)] = 128
    sigma_code: Annotated[int, Field(ge=0)] = 128
    balance_sigma: tuple[NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0)
    method: SafeText = "daylit"
    n_samples: Annotated[int, Field(ge=0)] = 0
    residual_stops: NonNegative = 0.0
    clip_together: bool = False
    held_out: tuple[NonNegative, ...] = ()
    prior_strength: tuple[tuple[float, float], ...] = ()
    modes: tuple[tuple[_CODES, _CODES, _CODES], ...] | None = None
    """None: older profiles have only `sigma_log2`."""

    @model_validator(mode="after")
    def _is_a_curve(self) -> Self:
        n = len(self.log2_exposure[0])
        if any(len(row) != n for rows in (self.log2_exposure, self.sigma_log2, *(self.modes or ())) for row in rows):
            raise ValueError("all rows of a response curve have the same number of codes")
        if any(b <= a for row in self.log2_exposure for a, b in pairwise(row)):
            raise ValueError("a response curve increases from code to code")
        if min(map(min, self.sigma_log2)) < 0:
            raise ValueError("an uncertainty is not negative")
        ends_ok = all(0 <= a < b < n for a, b in zip(self.low, self.high, strict=True))
        if not ends_ok or max(self.gauge_code, self.sigma_code) >= n:
            raise ValueError(f"low, high, gauge_code and sigma_code are codes of 0..{n - 1}, low below high")
        return self

    def curve(self) -> ResponseCurve:
        """Return the curve; the same numbers that were recorded."""
        tables = {name: np.array(getattr(self, name)) for name in ("log2_exposure", "sigma_log2")}
        tables |= {"modes": np.array(self.modes)} if self.modes else {}
        return ResponseCurve(**{**self.model_dump(), **tables})

    def digest(self) -> str:
        """Return the SHA-256 of the curve's numbers: which curve a scale factor was measured with."""
        return hashlib.sha256(np.array(self.log2_exposure).tobytes()).hexdigest()


class NoiseRecord(_Record):
    """A camera's noise (`NoiseModel`)."""

    photon: tuple[NonNegative, NonNegative, NonNegative]
    read: tuple[NonNegative, NonNegative, NonNegative]
    code_variance: tuple[NonNegative, NonNegative, NonNegative] = (1 / 12, 1 / 12, 1 / 12)

    def model(self) -> NoiseModel:
        """Return the noise model."""
        return NoiseModel(**self.model_dump())


class ShutterTime(Model):
    """One shutter time as it was found: nominal, true, and the true one's uncertainty in stops."""

    nominal_s: Positive
    true_s: Positive
    sigma_stops: NonNegative = 0.0


class ShutterRecord(Model):
    """How nominal times become true ones: by the rule, or as measured."""

    rule: ShutterRule = ShutterRule.NOMINAL
    times: tuple[ShutterTime, ...] = ()
    scatter_stops: NonNegative = RULE_SIGMA_STOPS
    """Standard deviation of single exposures about the rule."""

    def true_s(self, nominal_s: float) -> float:
        """Return the true time of a nominal one: the measured one within 1 % of it, else the rule's."""
        return next((t.true_s for t in self._measured(nominal_s)), true_time_s(nominal_s, self.rule))

    def sigma_stops(self, nominal_s: float) -> float:
        """Return the uncertainty of `true_s`."""
        return next((t.sigma_stops for t in self._measured(nominal_s)), self.scatter_stops)

    def _measured(self, nominal_s: float) -> list[ShutterTime]:
        return [t for t in self.times if abs(t.nominal_s / nominal_s - 1) < _SAME_TIME_FRAC]


class VignettingRecord(_Record):
    """A fall-off (`Vignetting`): 1 + c1 r^p1 + c2 r^p2 + ..."""

    powers: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(max_length=16)]
    coefficients: Annotated[tuple[float, ...], Field(max_length=16)]
    relative_uncertainty: NonNegative = 0.0
    f_number: Positive | None = None
    in_angle: bool = False
    source: SafeText = ""

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if len(self.powers) != len(self.coefficients):
            raise ValueError("as many powers as coefficients")
        return self

    def vignetting(self) -> Vignetting:
        """Return the fall-off."""
        return Vignetting(**self.model_dump())


_SHARES = Annotated[tuple[float, ...], Field(min_length=len(WIDTHS_RAD) + 1, max_length=len(WIDTHS_RAD) + 1)]


class GlareRecord(_Record):
    """A lens's stray light (`GlareKernel`), as lamps in the dark have shown it."""

    shares: _SHARES
    covariance: Annotated[tuple[_SHARES, ...], Field(min_length=len(WIDTHS_RAD) + 1, max_length=len(WIDTHS_RAD) + 1)]
    misfit: NonNegative
    index: NonNegative
    two_lenses: bool = False

    def kernel(self) -> GlareKernel:
        """Return the kernel."""
        return GlareKernel(**self.model_dump())


class LensRecord(Model):
    """A fisheye (`LensModel`); the circle in fractions of the width, its centre's row of the height."""

    mapping: LensMapping
    half_field_rad: Annotated[float, Field(gt=0, le=np.pi)]
    polynomial: Annotated[tuple[float, ...], Field(max_length=16)] = ()
    centre_x: Annotated[float, Field(gt=-1, lt=2)]
    centre_y: Annotated[float, Field(gt=-1, lt=2)]
    radius: Annotated[float, Field(gt=0, le=2)]
    size_px: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]
    """Of the pictures that the circle was found in: others of the camera have the same shape."""
    sigma: NonNegative = 0.0
    source: SafeText = ""

    @classmethod
    def of(cls, lens: LensModel) -> Self:
        """Return the record of a lens."""
        wide, high = lens.circle.size_px
        return cls(
            mapping=lens.mapping,
            half_field_rad=lens.half_field_rad,
            polynomial=lens.polynomial,
            centre_x=lens.circle.centre_px[0] / wide,
            centre_y=lens.circle.centre_px[1] / high,
            radius=lens.circle.radius_px / wide,
            size_px=(wide, high),
            sigma=lens.circle.sigma_px / wide,
            source=lens.source,
        )

    def lens(self) -> LensModel:
        """Return the lens."""
        wide, high = self.size_px
        centre_px = (self.centre_x * wide, self.centre_y * high)
        circle = ImageCircle(centre_px, self.radius * wide, self.size_px, self.sigma * wide)
        return LensModel(self.mapping, circle, self.half_field_rad, self.polynomial, self.source)


class NdRecord(_Record):
    """An ND filter (`NdFilter`): what it does to linear RGB is ``rgb @ tint * 10 ** -density``."""

    tint: tuple[Rgb, Rgb, Rgb]
    density: float = 0.0
    relative_uncertainty: NonNegative = 0.0
    colour_uncertainty: NonNegative = 0.0
    source: SafeText = ""

    def nd_filter(self) -> NdFilter:
        """Return the filter."""
        return NdFilter(**self.model_dump())
