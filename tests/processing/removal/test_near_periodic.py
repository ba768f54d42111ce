"""Completion of textures that repeat: lattice, light, copies; and of those that do not."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.ground.arrays import Floats
from processing.removal.illumination import fit_illumination, spread
from processing.removal.near_periodic import Repeat, analyse, complete
from processing.removal.near_periodic_lattice import reduced


def tiled(shape: tuple[int, int] = (120, 140), step: tuple[float, float] = (24, 20)) -> Floats:
    """Return tiles with dark joints, a bright spot in each, and a little noise."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    u, v = x % step[0], y % step[1]
    tone = np.where((u < 2) | (v < 2), 0.15, 0.5) + 0.3 * np.exp(-((u - 9) ** 2 + (v - 12) ** 2) / 8)
    noise = np.random.default_rng(1).normal(0, 0.004, (*shape, 3))
    return np.maximum(tone[..., None] * [1.0, 0.9, 0.8] + noise, 0).astype(np.float32)


def hole_in(shape: tuple[int, ...], rows: slice, columns: slice) -> npt.NDArray[np.bool_]:
    hole = np.zeros(shape[:2], bool)
    hole[rows, columns] = True
    return hole


def test_tiles_are_continued_in_phase_under_a_gradient_of_light() -> None:
    plain = tiled()
    light = np.exp(np.linspace(-0.5, 0.5, plain.shape[1]))[None, :, None].astype(np.float32)
    truth = plain * light
    hole = hole_in(truth.shape, slice(40, 80), slice(50, 95))
    torn = truth.copy()
    torn[hole] = 7.0
    found = complete(torn, ~hole, hole)
    assert found.repeat is Repeat.LATTICE
    assert found.lattice is not None
    steps = sorted([abs(found.lattice.a_px).round(1).tolist(), abs(found.lattice.b_px).round(1).tolist()])
    assert np.allclose(steps, [[0, 20], [24, 0]], atol=0.3)
    assert np.array_equal(found.values[~hole], torn[~hole])
    error = np.abs(found.values - truth)[hole] / truth[hole]
    assert np.median(error) < 0.03
    assert found.confidence[hole].mean() > 0.6


def test_noise_has_no_lattice_and_keeps_its_roughness() -> None:
    noise = np.random.default_rng(2).normal(0.5, 0.05, (100, 110, 1)).repeat(3, axis=2).astype(np.float32)
    hole = hole_in(noise.shape, slice(30, 70), slice(40, 80))
    found = complete(noise, ~hole, hole)
    assert found.repeat is Repeat.NONE
    assert 0.75 < found.values[hole].std() / noise[~hole].std() < 1.25


def test_noise_of_some_texels_is_no_lattice_and_fills_large_holes_all_over() -> None:
    """Next to nothing repeats with itself: a mean of such copies is a blur. Grain comes from as far as it must."""
    rough = cv2.GaussianBlur(np.random.default_rng(961331).normal(0, 1, (240, 260, 1)), (0, 0), 1.2)
    carpet = np.repeat(0.3 * np.exp(0.1 * rough / rough.std()), 3).reshape(240, 260, 3).astype(np.float32)
    hole = hole_in(carpet.shape, slice(0, 200), slice(60, 260))
    found = complete(carpet, ~hole, hole)
    assert found.repeat is Repeat.NONE
    for part in (np.s_[:60, 200:], np.s_[100:160, 120:180]):
        assert 0.6 < found.values[part].std() / carpet[~hole].std() < 1.4


def test_a_mosaic_is_found_where_a_small_picture_shows_none() -> None:
    """Its sheets lie never quite straight: no large step repeats, as small ones in a small picture would have to."""
    rng, size = np.random.default_rng(4), 640
    y, x = np.mgrid[:size, :size].astype(np.float32)
    for place in (x, y):
        shifts = rng.normal(0, 4, (9, 9)).astype(np.float32)
        place += cv2.resize(shifts, (size, size), interpolation=cv2.INTER_CUBIC)
    tone = np.where(((x % 9) < 1.8) | ((y % 10.4) < 1.8), 0.25, 0.5) + rng.normal(0, 0.03, x.shape)
    mosaic = np.repeat(tone[..., None], 3, axis=-1).astype(np.float32)
    hole = hole_in(mosaic.shape, slice(250, 350), slice(250, 380))
    found = complete(mosaic, ~hole, hole)
    assert found.lattice is not None
    assert abs(found.lattice.cell_px - np.sqrt(9 * 10.4)) < 0.5


def test_planks_run_on() -> None:
    rng = np.random.default_rng(3)
    tones = rng.uniform(0.3, 0.6, 12).repeat(10)
    truth = (tones[None, :, None] * np.ones((130, 1, 3)) + rng.normal(0, 0.003, (130, 120, 3))).astype(np.float32)
    hole = hole_in(truth.shape, slice(45, 85), slice(35, 75))
    assert analyse(truth, ~hole).repeat is not Repeat.NONE
    found = complete(truth, ~hole, hole)
    assert np.median(np.abs(found.values - truth)[hole] / truth[hole]) < 0.07


def test_a_lattice_that_is_too_weak_gives_way_to_the_grain() -> None:
    """Of a floor that is hardly seen: boards in two tones by turns, with faint joints across, are both."""
    tones, joints = np.tile([0.3, 0.6], 6).repeat(10), 1 - 0.3 * (np.arange(130) % 26 < 3)
    floor = tones[None, :, None] * joints[:, None, None] * np.ones(3)
    floor = (floor + np.random.default_rng(3).normal(0, 0.003, floor.shape)).astype(np.float32)
    known = ~hole_in(floor.shape, slice(45, 85), slice(35, 75))
    found = analyse(floor, known)
    assert found.lattice is not None
    assert analyse(floor, known, found.lattice.strength + 0.01).repeat is Repeat.LINE


@pytest.mark.parametrize("known_pixels", [0, 3])
def test_nothing_known(known_pixels: int) -> None:
    values = np.full((20, 20, 3), 2.0, np.float32)
    hole = np.ones((20, 20), bool)
    hole.ravel()[:known_pixels] = False
    found = complete(values, ~hole, hole)
    assert np.isfinite(found.values).all()
    assert (found.confidence[hole] == 0).all()


def test_a_hole_of_one_pixel_and_none() -> None:
    values = tiled((40, 40))
    hole = hole_in(values.shape, slice(20, 21), slice(20, 21))
    assert np.isfinite(complete(values, ~hole, hole).values).all()
    nothing = np.zeros_like(hole)
    assert np.array_equal(complete(values, ~nothing, nothing).values, values)


def test_a_lamp_of_1e9_beside_the_hole_does_not_bleed() -> None:
    values = tiled()
    values[:10, :10] = 1.6e9
    hole = hole_in(values.shape, slice(5, 60), slice(30, 90))
    found = complete(values, ~hole, hole)
    assert np.isfinite(found.values).all()
    assert np.median(found.values[hole]) < 1.0


@settings(max_examples=30, deadline=None)
@given(st.tuples(st.integers(-40, 40), st.integers(-40, 40)), st.tuples(st.integers(-40, 40), st.integers(-40, 40)))
def test_reduction_keeps_the_lattice_and_shortens_it(a: tuple[int, int], b: tuple[int, int]) -> None:
    area = abs(a[0] * b[1] - a[1] * b[0])
    if not area:
        return
    p, q = reduced(np.array(a, float), np.array(b, float))
    assert abs(abs(p[0] * q[1] - p[1] * q[0]) - area) < 1e-6 * area + 1e-6
    assert p @ p <= q @ q + 1e-9
    assert abs(p @ q) <= 0.5 * (p @ p) + 1e-9


def test_a_membrane_keeps_what_is_given_and_has_no_peaks() -> None:
    rng = np.random.default_rng(4)
    values = rng.uniform(-1, 1, (37, 53)).astype(np.float32)
    given_ = rng.random((37, 53)) < 0.1
    out = spread(values, given_)
    assert np.array_equal(out[given_], values[given_])
    assert out.min() >= values[given_].min() - 1e-5
    assert out.max() <= values[given_].max() + 1e-5
    assert not spread(values, np.zeros_like(given_)).any()


def test_light_is_distinguished_from_a_pattern_by_pairs() -> None:
    tone = np.log(tiled() + 0.01)
    slope = np.linspace(-0.4, 0.4, tone.shape[0])[:, None, None].astype(np.float32)
    known = np.ones(tone.shape[:2], bool)
    hole = ~known
    lattice = analyse(np.exp(tone), known).lattice
    assert lattice is not None
    slow = fit_illumination((tone + slope).astype(np.float32), known, hole, lattice.basis_px)
    assert np.abs(slow - slope)[10:-10, 10:-10].mean() < 0.08
