"""What is known of a response curve before any frame is seen: how the published ones differ from one another.

A curve is the mean of many cameras' and films' curves, plus their principal differences with free amplitude, plus a
smooth rest. The table `response_prior.toml` is our own fit (`python -m training.response_prior`) to the Database of
Response Functions (Grossberg and Nayar 2004) and to digital standards. Frames two stops apart leave ripples of that
period free, which only this holds down.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from processing.calibration.response.fit import spline_basis, srgb_log2_exposure
from processing.ground.arrays import Doubles
from processing.ground.tables import table_of

AMPLITUDES = (0.5, 1.0, 2.0)  # of the published curves' own spread; chosen on curves left out
LOG_STRENGTHS = tuple(np.arange(3.5, 6.1, 0.5))
"""Of 1 / stops2, of the smooth rest: curves that were left out of the fit are most probable from 3.5 to 6."""
DRIFT_LOG_STRENGTHS = tuple(np.arange(3.5, 5.1, 0.25))
"""Of a change of a known curve: second differences between knots of 0.018 to 0.003 stop."""
TIED_AMPLITUDES = (0.1, 0.3, 1.0)
"""Of the published curves' spread, of the difference of one camera's channels: digital cameras' are at most at the
first, films' at the last; chosen on their published curves."""
_FREE2, _TIED_FREE2 = 100.0, 0.1  # squared stops: what a line over the root of the code may be
LEAST_CODES, FEW_CODES = 24, 8
"""Of 256, that a fit needs, and one beside a channel that is known; chosen: with 42 and 47 two brackets of a hard film
keep their intervals."""


class Candidate(NamedTuple):
    """One strength of the prior."""

    amplitude: float
    """Of the principal differences, 1: as among the published curves; 0: none."""
    log_strength: float
    precision: Doubles
    """(K, K): inverse covariance of the spline's coefficients."""
    log_determinant: float


@dataclass(frozen=True)
class CurvePrior:
    """Where a curve is looked for."""

    start: Doubles
    """(256,) stops: the most probable curve."""
    candidates: tuple[Candidate, ...]
    least_codes: int = LEAST_CODES


@dataclass(frozen=True)
class PrincipalCurves:
    """Mean and principal differences of many curves, as coefficients of the spline added to sRGB's curve."""

    mean: Doubles
    """(K,)."""
    components: Doubles
    """(P, K): one standard deviation each."""

    def prior(self) -> CurvePrior:
        """Return the prior that they make."""
        start = srgb_log2_exposure() + spline_basis().codes @ self.mean
        return CurvePrior(start - start[255], _candidates(self.spread, AMPLITUDES, LOG_STRENGTHS))

    @property
    def spread(self) -> Doubles:
        """Return the coefficients' covariance, of shape (K, K)."""
        return np.asarray(self.components.T @ self.components)


@lru_cache(maxsize=1)
def _published() -> PrincipalCurves:
    table = table_of("processing.calibration", "response_prior")
    return PrincipalCurves(np.array(table["mean"]), np.array(table["components"]))


@lru_cache(maxsize=1)
def published_prior() -> CurvePrior:
    """Return the prior of any camera, from the table."""
    return _published().prior()


def tied_prior(other: Doubles) -> CurvePrior:
    """Return the prior of a channel that shows few codes: about as another one. ``other``: of shape (256,), stops."""
    candidates = _candidates(_published().spread, TIED_AMPLITUDES, LOG_STRENGTHS, _TIED_FREE2)
    return CurvePrior(other, candidates, FEW_CODES)


def drift_prior(known: Doubles) -> CurvePrior:
    """Return the prior of a camera whose curve is known: a smooth change of it. ``known``: of shape (256,), stops."""
    return CurvePrior(known, _candidates(np.zeros_like(spline_basis().penalty), (0.0,), DRIFT_LOG_STRENGTHS))


def _candidates(
    spread: Doubles, amplitudes: Sequence[float], log_strengths: Sequence[float], free2: float = _FREE2
) -> tuple[Candidate, ...]:
    penalty = spline_basis().penalty
    found = []
    for strength in log_strengths:
        rest = np.linalg.inv(10.0**strength * penalty + np.eye(len(penalty)) / free2)
        for amplitude in amplitudes:
            precision = np.asarray(np.linalg.inv(amplitude**2 * spread + rest), dtype=np.float64)
            found.append(Candidate(amplitude, float(strength), precision, float(np.linalg.slogdet(precision)[1])))
    return tuple(found)
