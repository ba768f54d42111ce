"""Lens models: mappings both ways, the simulated camera's own lens, and mappings fitted to known directions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.optics.camera import CANON_5D2
from processing.calibration.outdoor.lens import ImageCircle, LensModel, fit_mapping
from processing.errors import LensError
from processing.sphere import LensMapping, directions

CIRCLE = ImageCircle((240.0, 160.0), 150.86, (480, 320))
BENT = (1.1, -0.2, 0.1)


def lens(mapping: LensMapping, half_field_rad: float = math.pi / 2) -> LensModel:
    return LensModel(mapping, CIRCLE, half_field_rad, BENT if mapping is LensMapping.POLYNOMIAL else ())


@settings(max_examples=30, deadline=None)
@given(mapping=st.sampled_from(list(LensMapping)), r=st.floats(0, 1), half=st.floats(0.3, math.pi / 2))
def test_angle_and_radius_are_inverse(mapping: LensMapping, r: float, half: float) -> None:
    model = lens(mapping, half)
    assert float(model.radius(model.angle(r))) == pytest.approx(r, abs=1e-9)
    assert float(model.angle(1.0)) == pytest.approx(half, abs=1e-7)


def test_the_simulated_cameras_lens_is_an_equisolid_one() -> None:
    """The simulation's projection was written apart from ours."""
    model = LensModel(LensMapping.EQUISOLID, ImageCircle((240, 160), 480 * 16 / 36 * math.sin(math.pi / 4), (480, 320)))
    ours, seen = directions(model.fisheye(top_azimuth_rad=0.0))
    x, y = np.arange(480) + 0.5, np.arange(320)[:, None] + 0.5
    theirs, their_seen = CANON_5D2.lens.directions(x, y, (480, 320))
    assert (seen == their_seen).mean() > 0.9999
    both = seen & their_seen
    assert np.abs(ours[both] - theirs[both]).max() < 1e-6


@pytest.mark.parametrize("field_deg", [180, 186])
@pytest.mark.parametrize("noise_px", [0.0, 0.3])
def test_a_mapping_is_fitted_to_stars(field_deg: float, noise_px: float) -> None:
    rng = np.random.default_rng(7)
    half = math.radians(field_deg / 2)
    theta = np.arccos(rng.uniform(math.cos(half), 1, 90))
    azimuth = rng.uniform(0, 2 * math.pi, 90)
    r = np.sin(theta / 2) / math.sin(half / 2) * CIRCLE.radius_px
    points = np.stack([241.2 + r * np.cos(azimuth), 159.1 + r * np.sin(azimuth)], axis=-1)
    points += rng.normal(0, noise_px, points.shape)
    flat = np.sin(theta)
    ways = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.cos(theta)], axis=-1)
    found = fit_mapping(points, ways, CIRCLE)
    pixel_rad = half / CIRCLE.radius_px
    assert math.dist(found.lens.circle.centre_px, (241.2, 159.1)) < 0.05 + noise_px
    assert found.lens.half_field_rad == pytest.approx(half, abs=2e-3 + noise_px * pixel_rad)
    knots = np.linspace(0, 1, 50)
    truth = 2 * np.arcsin(knots * math.sin(half / 2))
    assert np.abs(found.lens.angle(knots) - truth).max() < 1e-3 + noise_px * pixel_rad


def test_too_little_to_fit_is_refused() -> None:
    near = np.full((40, 2), 240.0) + np.random.default_rng(0).normal(0, 5, (40, 2))
    up = np.tile([0.0, 0.0, 1.0], (40, 1))
    with pytest.raises(LensError, match="of the radius"):
        fit_mapping(near, up, CIRCLE)
    with pytest.raises(LensError, match="3 points"):
        fit_mapping(near[:3], up[:3], CIRCLE)


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
