"""Lens models: mappings both ways, and the simulated camera's own lens."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.optics.camera import CANON_5D2
from processing.calibration.outdoor.lens import ImageCircle, LensModel
from processing.errors import LensError
from processing.sphere import LensMapping, directions
from processing.sphere.geometry import polar_of_radius, radius_of_polar

CIRCLE = ImageCircle((240.0, 160.0), 150.86, (480, 320))
BENT = (1.1, -0.2, 0.1)


def lens(mapping: LensMapping, half_field_rad: float = math.pi / 2) -> LensModel:
    return LensModel(mapping, CIRCLE, half_field_rad, BENT if mapping is LensMapping.POLYNOMIAL else ())


@settings(max_examples=30, deadline=None)
@given(mapping=st.sampled_from(list(LensMapping)), r=st.floats(0, 1), half=st.floats(0.3, math.pi / 2))
def test_angle_and_radius_are_inverse(mapping: LensMapping, r: float, half: float) -> None:
    model = lens(mapping, half).fisheye()
    back, _ = radius_of_polar(model, *polar_of_radius(model, np.array(r)))
    assert float(back) == pytest.approx(r, abs=1e-9)
    assert float(np.arctan2(*polar_of_radius(model, np.array(1.0)))) == pytest.approx(half, abs=1e-7)


def test_the_simulated_cameras_lens_is_an_equisolid_one() -> None:
    """The simulation's projection was written apart from ours."""
    model = LensModel(LensMapping.EQUISOLID, ImageCircle((240, 160), 480 * 16 / 36 * math.sin(math.pi / 4), (480, 320)))
    ours, seen = directions(model.fisheye(top_azimuth_rad=0.0))
    x, y = np.arange(480) + 0.5, np.arange(320)[:, None] + 0.5
    theirs, their_seen = CANON_5D2.lens.directions(x, y, (480, 320))
    assert (seen == their_seen).mean() > 0.9999
    both = seen & their_seen
    assert np.abs(ours[both] - theirs[both]).max() < 1e-6


@pytest.mark.parametrize(
    ("mapping", "half", "polynomial"),
    [
        (LensMapping.ORTHOGRAPHIC, 1.7, ()),
        (LensMapping.EQUISOLID, 0.0, ()),
        (LensMapping.POLYNOMIAL, 1.5, ()),
        (LensMapping.POLYNOMIAL, 1.5, (2.0, -1.0, 0.5)),
        (LensMapping.POLYNOMIAL, 1.5, (4.0, -3.0)),
    ],
)
def test_lenses_that_cannot_be_are_refused(mapping: LensMapping, half: float, polynomial: tuple[float, ...]) -> None:
    with pytest.raises(LensError):
        LensModel(mapping, CIRCLE, half, polynomial)
