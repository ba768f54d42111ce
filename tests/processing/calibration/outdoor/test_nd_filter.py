"""ND filters: tint and density apart, both ways, and fitted to the chart of the simulated room."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.optics.camera import CANON_5D2, ND3_TINT
from mocks.optics.chart import ChartRoom
from mocks.worlds.light import Site, luminance_cd_m2
from processing.calibration.outdoor.nd_filter import NdFilter, fit_nd_filter, without_negatives
from processing.errors import LensError

AUTHORS_CCM = (
    (0.8231062763960264, -0.009380978128196818, 0.028053498683342944),
    (0.05770939940134331, 1.044068294475107, -0.08135607274422213),
    (-0.30403935326915676, -0.38305971490838997, 2.081816623296674),
)
"""As the paper's authors publish it: picture @ matrix is the light before the filter."""


def through(nd: NdFilter, rgb: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Light (..., 3) as seen through a filter's tint."""
    return np.asarray(rgb @ np.array(nd.tint, np.float32), np.float32)


@settings(max_examples=40, deadline=None)
@given(
    rgb=st.tuples(*[st.floats(2**-10, 2**20, width=32)] * 3),
    off=st.lists(st.floats(-0.12, 0.12), min_size=9, max_size=9),
    density=st.floats(0, 5),
)
def test_what_a_filter_does_is_undone(rgb: tuple[float, float, float], off: list[float], density: float) -> None:
    nd = NdFilter.of_matrix((np.eye(3) + np.array(off).reshape(3, 3)) * 10**-density)
    picture = np.array([[rgb]], dtype=np.float32)
    assert np.abs(nd.correct(through(nd, picture)) - picture).max() < 3e-5 * picture.max()


def test_the_tint_leaves_white_as_bright_as_it_was() -> None:
    nd = NdFilter.of_matrix(np.linalg.inv(AUTHORS_CCM))
    white = np.ones((1, 3), dtype=np.float32)
    assert luminance_cd_m2(through(nd, white))[0] == pytest.approx(1.0, abs=1e-6)
    # Applied as published, the matrix takes a quarter of white's luminance: that goes into the density.
    assert nd.transmittance == pytest.approx(1 / 0.8739, rel=1e-3)
    assert np.allclose(nd.tint, ND3_TINT, atol=1e-5)


def chart(noise: float, seed: int = 0) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    room = ChartRoom()
    patches = room.radiance(Site.INDOOR, room.patch_directions(Site.INDOOR))
    filtered = CANON_5D2.filter.apply(patches)
    rng = np.random.default_rng(seed)
    noises = rng.normal(1, noise, (2, *patches.shape)) if noise else np.ones((2, *patches.shape))
    return patches * noises[0], filtered * noises[1]


def test_the_filter_is_fitted_to_the_chart() -> None:
    plain, filtered = chart(0.0)
    nd = fit_nd_filter(filtered, plain)
    assert nd.density == pytest.approx(3.0, abs=1e-5)
    assert np.abs(np.array(nd.tint) - ND3_TINT).max() < 1e-4


def test_the_fit_states_its_uncertainty() -> None:
    plain, filtered = chart(0.01, seed=3)
    nd = fit_nd_filter(filtered, plain)
    assert nd.density == pytest.approx(3.0, abs=0.004)
    assert np.abs(np.array(nd.tint) - ND3_TINT).max() < 0.03
    assert 0.003 < nd.relative_uncertainty < 0.03
    clean, seen = chart(0.0)
    restored = luminance_cd_m2(nd.correct(seen.astype(np.float32) / np.float32(nd.transmittance)))
    assert np.abs(restored / luminance_cd_m2(clean.astype(np.float32)) - 1).max() < 4 * nd.relative_uncertainty


def test_noisy_patches_weigh_less() -> None:
    plain, filtered = chart(0.0)
    unsure = np.where(np.arange(24) % 3 == 0, 0.3, 0.003)
    noisy = filtered * np.random.default_rng(5).normal(1, unsure[:, None], filtered.shape)
    errors = [np.abs(np.array(fit_nd_filter(noisy, plain, u).tint) - ND3_TINT).max() for u in (0.0, unsure)]
    assert errors[1] < 0.05 < errors[0]


def test_a_channel_that_the_gamut_cuts_decides_nothing() -> None:
    """What a camera's matrix makes negative is cut at next to nothing, which no tint explains."""
    plain, filtered = chart(0.0)
    share = filtered / luminance_cd_m2(filtered.astype(np.float32))[:, None]
    cut = np.where(share < 0.02, 1e-9 * filtered.max(), filtered)
    assert np.count_nonzero(cut != filtered) == 4
    assert np.abs(np.array(fit_nd_filter(cut, plain, np.full(24, 0.005)).tint) - ND3_TINT).max() < 0.006


def test_black_patches_are_left_out_and_few_are_refused() -> None:
    plain, filtered = chart(0.0)
    filtered[5] = 0.0
    plain[7] = np.nan
    assert fit_nd_filter(filtered, plain).density == pytest.approx(3.0, abs=1e-4)
    with pytest.raises(LensError, match="patches above 0"):
        fit_nd_filter(filtered[:5], plain[:5])
    with pytest.raises(LensError, match="same patches"):
        fit_nd_filter(filtered[:5], plain[:6])


def test_negative_channels_move_to_zero_at_the_same_luminance() -> None:
    rgb = np.array([[2.0, 1.0, -0.4], [1.0, 1.0, 1.0], [-1.0, -2.0, -3.0], [0.0, 0.0, 0.0]], dtype=np.float32)
    out, moved = without_negatives(rgb)
    assert moved.tolist() == [True, False, True, False]
    assert out.min() >= 0
    assert luminance_cd_m2(out)[0] == pytest.approx(float(luminance_cd_m2(rgb)[0]), rel=1e-5)
    assert out[2].tolist() == [0.0, 0.0, 0.0]


def test_noise_grows_where_the_matrix_subtracts() -> None:
    nd = NdFilter.of_matrix(np.linalg.inv(AUTHORS_CCM))
    gain = nd.noise_gain(through(nd, np.array([[1, 1, 1], [0.2, 0.2, 3.0], [0, 0, 0]], dtype=np.float32)))
    assert gain[0] == pytest.approx(1.185, abs=0.01)
    assert gain[1] > gain[0]
    assert np.isfinite(gain).all()


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.ones((3, 3)), np.eye(2), -np.eye(3)])
def test_matrices_that_no_filter_has_are_refused(matrix: npt.NDArray[np.float64]) -> None:
    with pytest.raises(LensError):
        NdFilter.of_matrix(matrix)


def test_little_blue_makes_a_tint_uncertain_by_as_much_as_is_stated() -> None:
    """A chart under a lamp of 2700 K, blue off by 12 % a patch, the rest by 0.5 %; and under 6500 K, all by 0.5 %."""
    rng, sky, stated = np.random.default_rng(11), np.array((0.824, 1.012, 1.403)), {}
    for seed, doubts in ((3, (0.005, 0.005, 0.12)), (2, (0.005, 0.005, 0.005))):
        room = ChartRoom(seed)
        plain = room.radiance(Site.INDOOR, room.patch_directions(Site.INDOOR))
        dim = CANON_5D2.filter.apply(plain)
        found = [fit_nd_filter(dim * rng.normal(1, doubts, (24, 3)), plain, [doubts] * 24) for _ in range(60)]
        seen, white = (light @ np.array(ND3_TINT) for light in (sky, plain.mean(axis=0)))
        shown = np.array([(seen @ nd.correction, white @ nd.correction) for nd in found])
        colours = shown[:, 0, ::2] / shown[:, 0, 1:2] / (sky[::2] / sky[1]) - 1
        levels = luminance_cd_m2(shown.astype(np.float32))
        off = (levels[:, 0] / levels[:, 1]).std() / (levels[:, 0] / levels[:, 1]).mean(), colours.std(axis=0).max()
        stated[seed] = np.mean([(nd.relative_uncertainty, nd.colour_uncertainty) for nd in found], axis=0)
        assert (0.3 * stated[seed] < off).all() or seed == 2  # paint is never surer than 1 %
        assert (off < 1.3 * stated[seed]).all()
        assert np.mean([bool(nd.doubt) for nd in found]) == (seed == 3)
    assert (stated[3] > 2 * stated[2]).all()
