"""What a calibration profile holds, as plain strict records: curve, noise, shutter, lens, filter."""

from __future__ import annotations

import hashlib
from itertools import pairwise
from typing import Annotated, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from processing.calibration.noise import NoiseModel
from processing.calibration.response_curve import ResponseCurve
from processing.sphere import LensMapping
from station.session import Model, SafeText

Channels = tuple[float, float, float]
Reals = npt.NDArray[np.float64]
NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
_UNKNOWN_STOPS = 99.0
"""Written for an uncertainty without bound: JSON has no infinity."""
_CODES = Annotated[tuple[float, ...], Field(min_length=2, max_length=65_536)]


class ResponseRecord(Model):
    """A response curve (`ResponseCurve`): stops by code, a row a channel."""

    log2_exposure: tuple[_CODES, _CODES, _CODES]
    sigma_log2: tuple[_CODES, _CODES, _CODES]
    low: tuple[int, int, int]
    high: tuple[int, int, int]
    gauge_code: Annotated[int, Field(ge=0)] = 128
    method: SafeText = "daylit"
    n_samples: Annotated[int, Field(ge=0)] = 0
    residual_stops: NonNegative = 0.0

    @model_validator(mode="after")
    def _is_a_curve(self) -> Self:
        n = len(self.log2_exposure[0])
        if any(len(row) != n for row in (*self.log2_exposure, *self.sigma_log2)):
            raise ValueError("all rows of a response curve have the same number of codes")
        if any(b <= a for row in self.log2_exposure for a, b in pairwise(row)):
            raise ValueError("a response curve increases from code to code")
        if min(map(min, self.sigma_log2)) < 0:
            raise ValueError("an uncertainty is not negative")
        ends_ok = all(0 <= a < b < n for a, b in zip(self.low, self.high, strict=True))
        if not ends_ok or self.gauge_code >= n:
            raise ValueError(f"low, high and gauge_code are codes of 0..{n - 1}, low below high")
        return self

    @classmethod
    def of(cls, curve: ResponseCurve) -> Self:
        """Return the record of a curve."""
        return cls(
            log2_exposure=_rows(curve.log2_exposure),
            sigma_log2=_rows(np.nan_to_num(curve.sigma_log2, nan=_UNKNOWN_STOPS, posinf=_UNKNOWN_STOPS)),
            low=tuple(map(int, curve.low)),
            high=tuple(map(int, curve.high)),
            gauge_code=int(curve.gauge_code),
            method=curve.method,
            n_samples=int(curve.n_samples),
            residual_stops=float(curve.residual_stops),
        )

    def curve(self) -> ResponseCurve:
        """Return the curve; the same numbers that were recorded."""
        return ResponseCurve(
            np.array(self.log2_exposure),
            np.array(self.sigma_log2),
            self.low,
            self.high,
            self.gauge_code,
            self.method,
            self.n_samples,
            self.residual_stops,
        )

    def digest(self) -> str:
        """Return the SHA-256 of the curve's numbers: which curve a scale factor was measured with."""
        return hashlib.sha256(np.array(self.log2_exposure).tobytes()).hexdigest()


class NoiseRecord(Model):
    """A camera's noise (`NoiseModel`)."""

    photon: tuple[NonNegative, NonNegative, NonNegative]
    read: tuple[NonNegative, NonNegative, NonNegative]
    code_variance: tuple[NonNegative, NonNegative, NonNegative] = (1 / 12, 1 / 12, 1 / 12)

    @classmethod
    def of(cls, noise: NoiseModel) -> Self:
        """Return the record of a noise model."""
        return cls(photon=noise.photon, read=noise.read, code_variance=noise.code_variance)

    def model(self) -> NoiseModel:
        """Return the noise model."""
        return NoiseModel(self.photon, self.read, self.code_variance)


class ShutterTime(Model):
    """One shutter time as it was found: nominal, true, and the true one's uncertainty in stops."""

    nominal_s: Positive
    true_s: Positive
    sigma_stops: NonNegative = 0.0


class ShutterRecord(Model):
    """How nominal times become true ones: a rule's name (`processing.calibration.shutter`) or measured times."""

    rule: SafeText = "thirds"
    times: tuple[ShutterTime, ...] = ()


class VignettingRecord(Model):
    """Fall-off 1 + c1 r^p1 + c2 r^p2 + ..., r from 0 in the middle to 1 at the edge of the field."""

    powers: Annotated[tuple[int, ...], Field(max_length=16)]
    coefficients: Annotated[tuple[float, ...], Field(max_length=16)]
    relative_uncertainty: NonNegative = 0.0
    f_number: Positive | None = None
    source: SafeText = ""

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if len(self.powers) != len(self.coefficients):
            raise ValueError("as many powers as coefficients")
        return self


class LensRecord(Model):
    """A fisheye's mapping; the polynomial's coefficients only with ``polynomial``."""

    mapping: LensMapping
    polynomial: Annotated[tuple[float, ...], Field(max_length=16)] = ()
    half_field_rad: Annotated[float, Field(gt=0, le=np.pi)]
    source: SafeText = ""


class CircleRecord(Model):
    """The image circle, as fractions of width, height and width, so that it holds at every picture size."""

    centre_x: Annotated[float, Field(gt=-1, lt=2)]
    centre_y: Annotated[float, Field(gt=-1, lt=2)]
    radius: Annotated[float, Field(gt=0, le=2)]


class NdRecord(Model):
    """An ND filter's correction: picture times ``matrix`` (row vectors: rgb @ matrix) gives the light before it."""

    matrix: tuple[Channels, Channels, Channels]
    factor: Positive = 1.0
    """What the matrix does not hold: by how much the filter weakens (1 where k2 was measured through it)."""
    relative_uncertainty: NonNegative = 0.0
    method: SafeText = ""


def _rows(table: Reals) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    first, second, third = (tuple(map(float, row)) for row in table)
    return first, second, third
