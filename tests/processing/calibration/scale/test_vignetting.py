"""Fall-off: published polynomials, both ways, and fitted to flat fields."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.optics.camera import CANON_5D2, THETA_Z1, CameraOptics
from mocks.optics.lenses import EquirectangularLens
from mocks.worlds.light import Site
from mocks.worlds.simple_room import SimpleRoom
from processing.calibration.scale.vignetting import (
    TURNED_SIGMA,
    Vignetting,
    fit_flat,
    fit_turned,
    published_vignetting,
)
from processing.errors import LensError
from processing.pictures.images import RelativeImage
from processing.sphere import Equirectangular, Fisheye, LensMapping

SIZE = (240, 160)
RADIUS = 240 * 16 / 36 * math.sin(math.pi / 4)
GEOMETRY = Fisheye(*SIZE, LensMapping.EQUISOLID, RADIUS)
TRUE = Vignetting((2, 4, 6, 8), (0.11, -0.92, 1.38, -0.82))


@pytest.fixture
def simulated() -> npt.NDArray[np.float32]:
    """An evenly lit field through the simulated fisheye, (H, W, 3)."""
    x, y = np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1])[:, None] + 0.5
    return np.repeat(CANON_5D2.lens.falloff(x, y, SIZE)[..., None], 3, axis=-1)


@pytest.mark.parametrize(
    ("name", "edge"),
    [("canon_8mm_f5_6", 0.647), ("canon_8mm_f8", 0.699), ("canon_8mm_f11", 0.726), ("theta_z1", 0.901)],
)
def test_published_falloff(name: str, edge: float) -> None:
    found = published_vignetting(name)
    assert float(found.evaluate(0.0)) == pytest.approx(1.0, abs=5e-4)
    assert float(found.evaluate(1.0)) == pytest.approx(edge, abs=1e-3)
    assert found.source
    with pytest.raises(LensError, match="no such published vignetting"):
        published_vignetting("pinhole")


@pytest.mark.parametrize(
    ("optics", "name", "apart"), [(THETA_Z1, "theta_z1", 0.015), (CANON_5D2, "canon_8mm_f11", 0.06)]
)
def test_simulated_lenses_are_copies_not_the_published_lens(optics: CameraOptics, name: str, apart: float) -> None:
    """On the way from the axis to the edge: near the published fall-off, but no copy of its numbers."""
    size = (4000, 2000)
    middle, edge = size[0] / 2, size[0] / 4
    if optics is CANON_5D2:
        edge = size[0] * 16 / 36 * math.sin(math.pi / 4) * 0.9999
    x = middle + np.linspace(0, edge, 200)
    theirs = optics.lens.falloff(x, np.full(200, size[1] / 2), size)
    r = (x - middle) / edge if optics is CANON_5D2 else np.sqrt(1 - np.cos((x - middle) / edge * math.pi / 2))
    off = np.abs(theirs / published_vignetting(name).evaluate(r) - 1)
    assert 0.01 < off.max() < apart


def test_a_flat_field_gives_the_simulated_fisheye(simulated: npt.NDArray[np.float32]) -> None:
    """Its fall-off is none that a polynomial can have: the fit is right to 0.3 %."""
    found = fit_flat([simulated], GEOMETRY)
    inside = simulated[..., 0] > 0
    off = np.abs(found.map(GEOMETRY)[inside] / simulated[..., 0][inside] - 1)
    assert off.max() < 0.003


def test_measured_in_angle() -> None:
    """f/5.6 is published by angle: at half the field's angle the picture is at r = 0.541."""
    found = published_vignetting("canon_8mm_f5_6")
    assert found.in_angle
    half = math.sin(math.pi / 8) / math.sin(math.pi / 4)
    row = found.map(Fisheye(2001, 3, LensMapping.EQUISOLID, 1000.0))[1]
    assert row[round(1000 + 1000 * half)] == pytest.approx(float(found.evaluate(0.5)), abs=1e-4)


@settings(max_examples=25, deadline=None)
@given(
    coefficients=st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.1)),
    level=st.floats(-6, 9),
    seed=st.integers(0, 99),
)
def test_correct_and_apply_are_inverse(coefficients: tuple[float, float], level: float, seed: int) -> None:
    falloff = Vignetting((2, 4), coefficients)
    picture = (10**level * np.random.default_rng(seed).random((*SIZE[::-1], 3))).astype(np.float32)
    back = falloff.correct(picture, GEOMETRY) * falloff.map(GEOMETRY)[..., None]
    assert np.abs(back - picture).max() <= 1e-6 * picture.max()


def test_fitted_to_flat_fields() -> None:
    rng = np.random.default_rng(2)
    flat = TRUE.map(GEOMETRY)[..., None] * np.array([0.5, 1.0, 0.7], dtype=np.float32)
    frames = [(level * flat * rng.normal(1, 0.02, flat.shape)).astype(np.float32) for level in (3.0, 400.0)]
    frames[0][50:60, 40:60] = 0.0
    found = fit_flat(frames, GEOMETRY)
    r = np.linspace(0, 1, 50)
    assert np.abs(found.evaluate(r) / TRUE.evaluate(r) - 1).max() < 0.01
    assert found.relative_uncertainty < 0.01


def test_dark_frames_and_wrong_coefficients_are_refused() -> None:
    with pytest.raises(LensError, match="usable samples"):
        fit_flat([np.zeros((*SIZE[::-1], 3), np.float32)], GEOMETRY)
    with pytest.raises(LensError, match="another radius unit"):
        Vignetting((2,), (-1.5,))
    with pytest.raises(LensError, match="as many coefficients"):
        Vignetting((2, 4), (0.1,))
    with pytest.raises(LensError):
        Vignetting((2,), (math.nan,))


PANORAMA = (360, 180)


def seen(yaw_rad: float, room: int = 3, gain: float = 1.0) -> RelativeImage:
    """A panorama of a simulated room, as its lenses draw it, the camera turned."""
    lens = EquirectangularLens(yaw_rad)
    x, y = np.arange(PANORAMA[0]) + 0.5, np.arange(PANORAMA[1])[:, None] + 0.5
    ways, _ = lens.directions(x, y, PANORAMA)
    light = SimpleRoom(room).radiance(Site.INDOOR, ways.reshape(-1, 3)).reshape(ways.shape)
    rgb = np.asarray(gain * light * lens.falloff(x, y, PANORAMA)[..., None], np.float32)
    shape = rgb.shape[:2]
    return RelativeImage(rgb, np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), Equirectangular(*PANORAMA))


@pytest.mark.parametrize("turn_deg", [90.0, -37.0])
def test_turning_the_camera_gives_the_panoramas_falloff(turn_deg: float) -> None:
    found = fit_turned([seen(0.0), seen(math.radians(turn_deg), gain=1.1)])
    angles = np.linspace(0, math.pi / 2, 90)
    middle, size = PANORAMA[0] / 2, PANORAMA[0]
    true = EquirectangularLens().falloff(middle + angles / (2 * math.pi) * size, np.full(90, PANORAMA[1] / 2), PANORAMA)
    off = found.evaluate(np.sqrt(1 - np.cos(angles))) / true - 1
    published = published_vignetting("theta_z1").evaluate(np.sqrt(1 - np.cos(angles))) / true - 1
    assert np.abs(off).max() < 0.003 < 0.01 < np.abs(published).max()
    assert TURNED_SIGMA <= found.relative_uncertainty < 1.2 * TURNED_SIGMA


@pytest.mark.parametrize(
    ("turn_deg", "room", "why"), [(0.0, 3, "separate"), (180.0, 3, "separate"), (90.0, 5, "one room")]
)
def test_pictures_that_show_no_falloff_are_refused(turn_deg: float, room: int, why: str) -> None:
    with pytest.raises(LensError, match=why):
        fit_turned([seen(0.0), seen(math.radians(turn_deg), room)])
