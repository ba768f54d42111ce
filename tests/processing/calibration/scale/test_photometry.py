"""Illuminance against closed forms, its uncertainty, and the comparison with a lux meter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.calibration.scale.photometry import compare_illuminance, illuminance_lx, luminance_map
from processing.errors import ParameterError
from processing.pictures.images import LuminanceImage, Validity
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, Perspective, directions, solid_angles
from tests.conftest import LONG
from tests.processing.pictures.picture_strategies import luminance_image

SIZE = 200
HEMISPHERES = [
    Equirectangular(2 * SIZE, SIZE),
    *(Fisheye(SIZE, SIZE, mapping, SIZE / 2) for mapping in LensMapping if mapping is not LensMapping.POLYNOMIAL),
]


def of_directions(geometry: Geometry, level: object) -> LuminanceImage:
    """Return a grey picture with luminance ``level(directions)``."""
    towards, seen = directions(geometry)
    values = np.where(seen, level(towards), 0.0)  # type: ignore[operator]
    rgb = np.repeat(values[..., None], 3, axis=2).astype(np.float32)
    return luminance_image(rgb, geometry, validity=np.where(seen, 0, Validity.OUTSIDE).astype(np.uint8))


@pytest.mark.parametrize("geometry", HEMISPHERES, ids=lambda g: f"{type(g).__name__}-{getattr(g, 'mapping', '')}")
@pytest.mark.parametrize(
    ("level", "truth"),
    [
        (lambda d: np.full(d.shape[:-1], 100.0), math.pi * 100),
        (lambda d: 900 * (1 + 2 * np.clip(d[..., 2], 0, 1)) / 3, 7 * math.pi / 9 * 900),
        (lambda d: 900 * np.clip(d[..., 2], 0, 1), 2 * math.pi / 3 * 900),
    ],
    ids=["even", "CIE overcast", "cosine"],
)
def test_skies_with_known_illuminance(geometry: Geometry, level: object, truth: float) -> None:
    found = illuminance_lx(of_directions(geometry, level))
    # The orthographic rim, where pixels with their centres outside are black here, are 0.2 % of the disc.
    orthographic = getattr(geometry, "mapping", None) is LensMapping.ORTHOGRAPHIC
    assert found.value_lx == pytest.approx(truth, rel=3e-3 if orthographic else 5e-4)
    assert found.unseen_share < 0.02
    assert found.invalid_shares == {"clipped": 0.0, "dark": 0.0, "repaired": 0.0}


@pytest.mark.parametrize("geometry", HEMISPHERES, ids=lambda g: f"{type(g).__name__}-{getattr(g, 'mapping', '')}")
def test_disc_at_an_angle(geometry: Geometry) -> None:
    """E = pi L sin2(a) cos(t) for a disc of angular radius a at angle t from the normal, whole in view."""
    radius, tilt = math.radians(10), math.radians(35)
    axis = (math.sin(tilt), 0.0, math.cos(tilt))
    image = of_directions(geometry, lambda d: 5000.0 * (d @ np.array(axis) > math.cos(radius)))
    truth = math.pi * 5000 * math.sin(radius) ** 2 * math.cos(tilt)
    assert illuminance_lx(image).value_lx == pytest.approx(truth, rel=0.015)


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -5, 0), (1, 2, -3)])
def test_an_even_sphere_lights_every_plane_alike(normal: tuple[float, ...]) -> None:
    found = illuminance_lx(of_directions(Equirectangular(128, 64), lambda d: np.full(d.shape[:-1], 10.0)), normal)
    assert found.value_lx == pytest.approx(math.pi * 10, rel=1e-3)


def test_colour_counts_by_the_papers_weights() -> None:
    rgb = np.zeros((32, 64, 3), np.float32)
    rgb[..., 2] = 1000
    assert illuminance_lx(luminance_image(rgb)).value_lx == pytest.approx(math.pi * 72.2, rel=1e-3)
    assert luminance_map(luminance_image(rgb)).max() == pytest.approx(72.2)


def test_uncertainty_by_parts() -> None:
    image = of_directions(Equirectangular(64, 32), lambda d: np.full(d.shape[:-1], 100.0))
    found = illuminance_lx(replace(image, scale_uncertainty=0.02))
    assert found.scale_lx == pytest.approx(0.02 * found.value_lx)
    assert found.pixels_lx < 0.001 * found.value_lx
    assert found.doubtful_lx == 0
    assert found.uncertainty_lx == pytest.approx(math.hypot(found.pixels_lx, found.scale_lx))


@pytest.mark.long
@pytest.mark.sweep
def test_pixel_part_is_that_of_independent_errors() -> None:
    """Against the spread of the illuminance over pictures with such errors drawn."""
    rng = np.random.default_rng(5)
    image = of_directions(Equirectangular(32, 16), lambda d: 50.0 + 40 * d[..., 0])
    image = replace(image, uncertainty=np.full((16, 32), 0.2, np.float32))
    drawn = [
        illuminance_lx(
            replace(image, rgb=(image.rgb * (1 + 0.2 * rng.standard_normal((16, 32, 1)))).clip(0).astype(np.float32))
        ).value_lx
        for _ in range(400 if LONG else 100)
    ]
    assert illuminance_lx(image).pixels_lx == pytest.approx(np.std(drawn), rel=0.12)


def test_errors_of_a_picture_without_a_scale_do_not_cancel() -> None:
    even = of_directions(Equirectangular(2 * SIZE, SIZE), lambda d: np.full(d.shape[:-1], 100.0))
    doubtful = replace(even, uncertainty=np.full(even.rgb.shape[:2], 0.2, np.float32), absolute=False)
    found = illuminance_lx(doubtful)
    assert found.pixels_lx == pytest.approx(0.2 * found.value_lx)


def test_doubtful_pixels_are_reported_and_add_up() -> None:
    image = of_directions(Equirectangular(64, 32), lambda d: np.full(d.shape[:-1], 100.0))
    validity, uncertainty = image.validity.copy(), image.uncertainty.copy()
    validity[:4], uncertainty[:4] = Validity.CLIPPED, np.inf
    validity[4:6], uncertainty[4:6] = Validity.DARK, 0.5
    validity[6:8] = Validity.REPAIRED
    found = illuminance_lx(replace(image, validity=validity, uncertainty=uncertainty))
    area = solid_angles(image.geometry)
    shares = [
        float((area[rows] * np.sin(np.linspace(math.pi / 2, -math.pi / 2, 65)[1::2][rows, None])).sum()) / math.pi
        for rows in (slice(0, 4), slice(4, 6), slice(6, 8))
    ]
    assert list(found.invalid_shares.values()) == pytest.approx(shares, rel=0.02)
    assert found.doubtful_lx == pytest.approx(
        found.value_lx * (shares[0] + 0.5 * shares[1] + 0.01 * shares[2]), rel=0.02
    )
    assert found.lower_bound
    assert math.isfinite(found.uncertainty_lx)


def test_what_a_picture_does_not_show_is_reported() -> None:
    view = Perspective(64, 64, math.radians(60))
    image = of_directions(view, lambda d: np.full(d.shape[:-1], 100.0))
    found = illuminance_lx(image, (0, 1, 0))
    assert found.value_lx == pytest.approx((1 - found.unseen_share) * math.pi * 100, rel=1e-3)
    assert 0.5 < found.unseen_share < 0.75
    assert found.lower_bound
    behind = illuminance_lx(image, (0, -1, 0))
    assert (behind.value_lx, behind.unseen_share) == (0.0, 1.0)
    assert behind.uncertainty_lx == 0


def test_black_picture_and_the_sun() -> None:
    black = illuminance_lx(luminance_image(np.zeros((16, 32, 3))))
    assert (black.value_lx, black.uncertainty_lx) == (0.0, 0.0)
    rgb = np.ones((360, 720, 3), np.float32)
    rgb[120, 300] = 1.6e9
    found = illuminance_lx(luminance_image(rgb))
    weight = solid_angles(Equirectangular(720, 360))[120, 300] * math.sin(math.radians(90 - 120.5 / 2))
    assert found.value_lx == pytest.approx(math.pi + 1.6e9 * weight, rel=1e-4)


@settings(max_examples=10, deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: math.hypot(*n) > 0.1), st.floats(0.1, 1e4))
def test_length_of_the_normal_and_scale_do_not_matter(normal: tuple[float, float, float], factor: float) -> None:
    image = of_directions(Equirectangular(16, 8), lambda d: 2 + d[..., 0] + 0.5 * d[..., 1])
    plain = illuminance_lx(image, normal)
    assert illuminance_lx(image, [factor * v for v in normal]).value_lx == pytest.approx(plain.value_lx, rel=1e-6)
    brighter = replace(image, rgb=image.rgb * np.float32(factor))
    assert illuminance_lx(brighter, normal).value_lx == pytest.approx(factor * plain.value_lx, rel=1e-5)


@pytest.mark.parametrize("normal", [(0, 0, 0), (0, 1), (math.nan, 0, 1), (math.inf, 0, 0)])
def test_normals_that_are_none(normal: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError):
        illuminance_lx(luminance_image(np.ones((8, 16, 3))), normal)


def test_comparison_with_a_lux_meter() -> None:
    image = replace(luminance_image(np.full((32, 64, 3), 100.0)), scale_uncertainty=0.03)
    found = illuminance_lx(image)
    difference, warning = compare_illuminance(found, 320.0)
    assert warning is None
    assert difference == pytest.approx(found.value_lx / 320 - 1)
    _, warning = compare_illuminance(found, 400.0)
    assert warning is not None
    assert "21." in warning
    assert "below the measured 400 lx" in warning
    clipped = replace(image, validity=np.full((32, 64), Validity.CLIPPED, np.uint8))
    assert "100% of it from clipped pixels" in str(compare_illuminance(illuminance_lx(clipped), 9000.0)[1])


@pytest.mark.parametrize("wrong", [0.0, -5.0, math.nan, math.inf])
def test_measured_values_that_are_none(wrong: float) -> None:
    with pytest.raises(ParameterError):
        compare_illuminance(illuminance_lx(luminance_image(np.ones((8, 16, 3)))), wrong)
