"""A filter's colour from the sky behind it: skies of published spectra, through filters."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from processing.calibration.outdoor.lens import ImageCircle
from processing.calibration.outdoor.nd_filter import NdFilter
from processing.calibration.outdoor.sky_colour import tint_of_sky
from processing.errors import LensError
from processing.pictures.images import RelativeImage, Validity
from processing.sphere import Fisheye, LensMapping

SIDE = 120
CIRCLE = ImageCircle((SIDE / 2, SIDE / 2), SIDE / 2, (SIDE, SIDE))
GEOMETRY = Fisheye(SIDE, SIDE, LensMapping.EQUISOLID, SIDE / 2, math.pi / 2)


def daylight(kelvin: np.ndarray) -> np.ndarray:
    """Return linear Rec. 709 (N, 3) of daylight by its spectrum, not by the locus."""
    import colour  # a second: every worker collects this file, one runs it

    shape = colour.SpectralShape(380, 780, 5)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    xyz = []
    for one in kelvin:
        light = colour.sd_CIE_illuminant_D_series(colour.temperature.CCT_to_xy_CIE_D(one)).align(shape)
        xyz.append(light.values @ cmfs.values)
    return np.array(xyz) @ np.linalg.inv(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ).T


def sky(low: float, high: float, tint: NdFilter | None = None) -> RelativeImage:
    """A sky whose colour temperature goes from one side to the other, with a little noise and trees at its foot."""
    rng = np.random.default_rng(4)
    rgb = np.repeat(daylight(np.linspace(low, high, SIDE))[None], SIDE, axis=0)
    rgb = rgb / rgb[..., 1:2] * rng.lognormal(0, 0.2, (SIDE, SIDE, 1)) * rng.lognormal(0, 0.01, (SIDE, SIDE, 3))
    rgb[int(0.9 * SIDE) :] *= (0.3, 0.8, 0.1)
    seen = rgb if tint is None else rgb @ np.array(tint.tint)
    shape = (SIDE, SIDE)
    return RelativeImage(seen.astype(np.float32), np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), GEOMETRY)


@pytest.mark.parametrize(("low", "high"), [(9000, 20_000), (6200, 7500), (7000, 14_000)])
def test_a_tinted_sky_comes_back_to_daylight(low: float, high: float) -> None:
    tint = NdFilter.of_matrix(np.diag((1.15, 1.0, 0.45)))
    seen = sky(low, high, tint)
    found = tint_of_sky(seen, CIRCLE)
    assert found is not None
    red, blue = (int(good) / 100 for good in re.findall(r"to (\d+)%", found.source))
    back = found.correct(seen.rgb)[40:80, 40:80].mean(axis=(0, 1))
    true = sky(low, high).rgb[40:80, 40:80].mean(axis=(0, 1))
    off = (back / back[1]) / (true / true[1])
    assert abs(math.log(off[0])) < 2.5 * red
    assert abs(math.log(off[2])) < 2.5 * blue
    assert abs(math.log(off[2])) < 0.5 * abs(math.log(0.45))
    assert 0 < found.relative_uncertainty < 0.05


def test_a_plain_sky_shows_no_filter() -> None:
    assert tint_of_sky(sky(8000, 13_000), CIRCLE) is None


def test_too_little_sky_is_refused() -> None:
    image = sky(8000, 13_000)
    image.validity[:] = Validity.CLIPPED
    with pytest.raises(LensError, match="too little sky"):
        tint_of_sky(image, CIRCLE)
