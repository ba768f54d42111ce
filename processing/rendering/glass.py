"""How much light clear glass lets through at an angle, told from what it lets through head on.

Fresnel's equations for unpolarised light on both faces of each sheet, all reflections between faces counted, and
Bouguer's law within (Duffie and Beckman, Solar Engineering of Thermal Processes, 4th edition, chapter 5): N sheets
pass (1 - r) / (1 + (2 N - 1) r) of each polarisation, times what is not absorbed on the way, which the given
transmittance head on tells.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Vector: TypeAlias = tuple[float, float, float]

INDEX = 1.526
"""Of refraction: window glass."""
TABLE = 257
"""Angles (even in their cosine) of `transmittance_table`; linear between them to 0.05 %."""


def transmittance_at(cosine: Doubles, head_on: Vector, sheets: int) -> Doubles:
    """Return the transmittance (n, 3) of panes of clear glass at cosines (n,) of incidence, 0 to 1.

    ``head_on`` is that at a cosine of 1, of all ``sheets`` together; more than bare reflection leaves is taken as glass
    that absorbs nothing.
    """
    cos_out = np.clip(np.asarray(cosine, np.float64), 0, 1)
    cos_in = np.sqrt(1 - (1 - cos_out**2) / INDEX**2)
    open_share = _unabsorbed(cos_out, cos_in, sheets)
    most = float(_unabsorbed(np.ones(1), np.ones(1), sheets)[0])
    level = np.asarray(head_on, np.float64)
    left = np.minimum(level / most, 1.0)
    # Relative to head on, so that what was given comes back there.
    return np.asarray(level * (open_share / most)[:, None] * left ** (1 / cos_in[:, None] - 1))


def _unabsorbed(cos_out: Doubles, cos_in: Doubles, sheets: int) -> Doubles:
    """Return what reflection alone leaves (n,), the mean of both polarisations."""
    across = ((cos_out - INDEX * cos_in) / (cos_out + INDEX * cos_in)) ** 2
    along = ((INDEX * cos_out - cos_in) / (INDEX * cos_out + cos_in)) ** 2
    passed = [(1 - r) / (1 + (2 * sheets - 1) * r) for r in (across, along)]
    return np.asarray((passed[0] + passed[1]) / 2)


def transmittance_table(head_on: Vector, sheets: int) -> Doubles:
    """Return transmittance (`TABLE`, 3) at cosines evenly from 0 to 1; one row for no sheets: alike at all angles."""
    if sheets == 0:
        return np.asarray(head_on, np.float64).reshape(1, 3)
    return transmittance_at(np.linspace(0, 1, TABLE), head_on, sheets)
