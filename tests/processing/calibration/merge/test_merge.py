"""The merge against known truth: error, honest uncertainty, ends, order, and what it leaves out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from processing.calibration.merge import merge as merging
from processing.calibration.merge.bracket import shares
from processing.calibration.merge.merge import MergeOptions, merge
from processing.errors import BracketError, ParameterError
from processing.pictures.frames import array_frame
from processing.pictures.images import Validity
from processing.sphere import Equirectangular, Fisheye, LensMapping
from tests.processing.calibration.merge.merge_cases import NOISE, SIZE, bracket, errors, merged, true_curve

FEW = settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def promises(result) -> None:
    image = result.image
    assert np.isfinite(image.rgb).all()
    assert (image.rgb >= 0).all()
    assert not np.isnan(image.uncertainty).any()
    assert (image.uncertainty > 0).all()
    assert np.isinf(image.uncertainty[image.validity == Validity.CLIPPED]).all()


def test_error_bias_and_uncertainty_against_the_truth() -> None:
    shot = bracket()
    result = merged(shot.frames, shot.true_s)
    promises(result)
    found = errors(result, shot.luminance)
    assert np.median(np.abs(found.stops)) < 0.0095
    assert np.quantile(np.abs(found.stops), 0.95) < 0.045
    assert 0.66 <= found.covered(1.0) <= 0.71
    assert 0.93 <= found.covered(1.96) <= 0.97
    for decade in range(-1, 5):
        there = (shot.luminance > 10.0**decade) & (shot.luminance < 10.0 ** (decade + 1))
        assert abs(np.median(errors(result, shot.luminance, there).stops)) < 0.005, decade
    assert result.report.shares.ghost < 0.001
    assert result.report.warnings == ()


def test_what_a_fisheye_does_not_show_is_neither_dark_nor_clipped() -> None:
    validity = np.full((40, 60), Validity.DARK, np.uint8)
    down, across = np.ogrid[:40, :60]
    inside = np.hypot(down - 19.5, across - 29.5) < 20
    validity[inside] = Validity.VALID
    lens = Fisheye(60, 40, LensMapping.EQUIDISTANT, 20.0)
    assert shares(validity, None, Equirectangular(60, 30)).dark == pytest.approx(1 - inside.mean())
    assert shares(validity, None, lens).warnings() == []
    validity[inside & (down > 14)] = Validity.DARK
    assert shares(validity, None, lens).dark == pytest.approx((inside & (down > 14)).sum() / inside.sum())
    assert "dark in every frame" in shares(validity, None, lens).warnings()[0]


def test_jpeg_frames_keep_their_uncertainty_and_show_no_ghosts() -> None:
    shot = bracket(quality=95, size=(1120, 560))
    noise = replace(NOISE, code_variance=(0.5, 0.4, 0.9))
    result = merged(shot.frames, shot.true_s, noise=noise)
    promises(result)
    found = errors(result, shot.luminance)
    assert np.median(np.abs(found.stops)) < 0.013
    # This camera has no mosaic, and half of the local contrast is what one with a mosaic needs: above 68 %.
    assert 0.62 <= found.covered(1.0) <= 0.82
    assert found.covered(1.96) >= 0.92
    # Small pictures have steep colours, which chroma at half resolution smears.
    assert result.report.shares.ghost < 0.003


def test_noise_ten_times_the_model_is_noticed_and_stated() -> None:
    shot = bracket(noise=10.0)
    result = merged(shot.frames, shot.true_s)
    promises(result)
    found = errors(result, shot.luminance, shot.luminance > 10)
    assert found.covered(1.0) > 0.6
    assert found.covered(1.96) > 0.9
    assert result.report.shares.ghost < 0.001
    assert any("noise" in warning for warning in result.report.warnings)


def test_every_frame_used_or_only_what_adds_something_gives_the_same_within_the_bound() -> None:
    shot = bracket()
    whole = merged(shot.frames, shot.true_s, quality="reference")
    least = merged(shot.frames, shot.true_s, quality="draft")
    assert all(use.reason for use in least.report.frames)
    assert sum(use.used_share for use in least.report.frames) < sum(use.used_share for use in whole.report.frames)
    good = (whole.image.validity == 0) & (least.image.validity == 0)
    grown = least.image.uncertainty[good] / whole.image.uncertainty[good]
    assert np.quantile(grown, 0.99) <= 1.10 + 1e-3
    stated = errors(least, shot.luminance)
    assert 0.66 <= stated.covered(1.0) <= 0.71


def test_texture_is_judged_in_bands_as_in_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    shot = bracket(quality=95, size=(1120, 560))

    monkeypatch.setattr(merging._Job, "coded", property(lambda _job: True))
    parts = merged(shot.frames, shot.true_s)
    monkeypatch.setattr(merging, "_in_bands", lambda work, count, _band, _workers: work(0, count))
    whole = merged(shot.frames, shot.true_s)
    assert np.array_equal(parts.image.rgb, whole.image.rgb)
    assert np.allclose(parts.image.uncertainty, whole.image.uncertainty, rtol=1e-5)


@pytest.mark.long
@FEW
@given(order=st.permutations(range(9)), workers=st.integers(1, 3))
def test_order_and_threads_do_not_matter(order: list[int], workers: int) -> None:
    shot = bracket()
    plain = merged(shot.frames, shot.true_s, workers=1)
    shuffled = merged([shot.frames[i] for i in order], [shot.true_s[i] for i in order], workers=workers)
    np.testing.assert_array_equal(plain.image.rgb, shuffled.image.rgb)
    np.testing.assert_array_equal(plain.image.uncertainty, shuffled.image.uncertainty)
    assert [use.number for use in shuffled.report.frames] == list(range(9))


def test_duplicates_do_not_count_twice() -> None:
    shot = bracket()
    plain = merged(shot.frames, shot.true_s)
    twice = merged([*shot.frames, shot.frames[3].copy()], [*shot.true_s, shot.true_s[3]])
    np.testing.assert_array_equal(plain.image.uncertainty, twice.image.uncertainty)
    assert any("same picture as frame 3" in warning for warning in twice.report.warnings)
    with pytest.raises(BracketError, match="with another exposure time"):
        merged([*shot.frames, shot.frames[3].copy()], [*shot.true_s, 2 * shot.true_s[3]])


@FEW
@given(
    code=st.sampled_from([0, 1, 128, 253, 255]),
    count=st.integers(1, 4),
    size=st.sampled_from([(1, 1), (7, 5), (130, 3)]),
)
def test_flat_frames_at_any_size(code: int, count: int, size: tuple[int, int]) -> None:
    frames = [np.full((size[1], size[0], 3), code, dtype=np.uint8) for _ in range(count)]
    times = [4.0**-i for i in range(count)]
    if 2 < code < 250 and count > 1:
        with pytest.raises(BracketError):
            merged(frames, times)
        return
    result = merged(frames, times)
    promises(result)
    expected = {0: Validity.DARK, 1: Validity.DARK, 128: Validity.VALID}.get(code, Validity.CLIPPED)
    assert (result.image.validity == expected).all()
    if expected is Validity.CLIPPED:
        level = 2.0 ** true_curve().log2_exposure[:, 252] / times[-1]
        np.testing.assert_allclose(result.image.rgb[0, 0], level, rtol=0.02)


def test_one_frame_is_a_picture_with_ends() -> None:
    shot = bracket()
    result = merged(shot.frames[4:5], shot.true_s[4:5])
    promises(result)
    assert errors(result, shot.luminance).covered(1.0) == pytest.approx(0.68, abs=0.03)
    assert {0, 1, 2} == set(np.unique(result.image.validity))
    assert (result.image.validity[shot.luminance > 1e4] == Validity.CLIPPED).all()


def test_one_channel_clipped_everywhere_makes_no_valid_pixel() -> None:
    shot = bracket()
    frames = [frame.copy() for frame in shot.frames]
    for frame in frames:
        frame[:40, :60, 0] = 255
    result = merged(frames, shot.true_s, ghosts=False)
    promises(result)
    assert (result.image.validity[:40, :60] == Validity.CLIPPED).all()


def test_a_sun_beside_a_dim_wall() -> None:
    frames = [np.full((64, 200, 3), code, dtype=np.uint8) for code in (128, 75, 40)]
    curve = true_curve()
    x = np.exp2(curve.log2_exposure[:, 128])
    for i, frame in enumerate(frames):
        for c in range(3):
            frame[..., c] = np.argmin(np.abs(np.exp2(curve.log2_exposure[c]) - x[c] / 4**i))
        frame[20:30, 20:30] = 255
    result = merged(frames, [1.0, 0.25, 1 / 16])
    promises(result)
    assert (result.image.validity[20:30, 20:30] == Validity.CLIPPED).all()
    assert (result.image.validity == Validity.VALID).sum() == 64 * 200 - 100
    assert result.report.shares.ghost == 0


def test_sixteen_bits_go_the_same_way() -> None:
    rng = np.random.default_rng(900_002)
    truth = np.exp2(rng.uniform(-12, 3, (60, 90, 1))).astype(np.float64) * np.ones(3)
    times = (4.0, 1.0, 0.25, 1 / 16)
    frames = []
    for t in times:
        x = truth * t
        noisy = x + rng.standard_normal(x.shape) * np.sqrt(np.minimum(x, 2) / 15000 + (4 / 15000) ** 2)
        frames.append(np.clip(np.rint(noisy * 65535), 0, 65535).astype(np.uint16))
    result = merged(frames, times)
    promises(result)
    good = (result.image.validity == 0) & (truth[..., 0] > 0.002)
    ratio = np.log(result.image.rgb[..., 1] / truth[..., 1])[good]
    luminance = np.log(result.image.rgb @ np.array([0.2127, 0.7151, 0.0722]) / truth[..., 0])[good]
    assert abs(np.median(ratio)) < 0.002
    assert np.mean(np.abs(luminance / result.image.uncertainty[good]) < 1) == pytest.approx(0.68, abs=0.035)
    assert result.report.shares.ghost < 0.001


def test_parameters_that_cannot_be_right_are_named() -> None:
    shot = bracket()
    for times in ([1.0], [0.0, *shot.true_s[1:]], [np.nan, *shot.true_s[1:]]):
        with pytest.raises(ParameterError):
            merged(shot.frames, times)
    with pytest.raises(ParameterError, match="max_error"):
        merged(shot.frames, shot.true_s, max_error=-0.1)
    with pytest.raises(BracketError, match="frame 1"):
        merged([shot.frames[0], shot.frames[1][:-1]], shot.true_s[:2])
    source = [array_frame(shot.frames[0])]
    with pytest.raises(ParameterError, match="response curve"):
        merge(source, [1.0], None, NOISE, geometry=Equirectangular(*SIZE), options=MergeOptions())
    with pytest.raises(BracketError, match="geometry"):
        merge(source, [1.0], true_curve(), NOISE, geometry=Equirectangular(10, 5))
    falling = replace(true_curve(), log2_exposure=-true_curve().log2_exposure)
    with pytest.raises(ParameterError, match="rise strictly"):
        merged(shot.frames, shot.true_s, falling)
