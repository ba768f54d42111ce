import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings

from processing.errors import ParameterError
from processing.sphere import (
    Equirectangular,
    LensMapping,
    Perspective,
    directions,
    projected_solid_angles,
    resampling,
    resampling_area,
    solid_angles,
)
from processing.sphere.resampling import padded_sphere, resample, resample_labels, resample_uncertainty
from tests.conftest import LONG
from tests.processing.sphere.sphere_pictures import fisheye, geometries, one_of_each, smooth

NAMES = list(one_of_each())
PAIRS = list(itertools.permutations(NAMES, 2))
if not LONG:  # each as a source and as a target, once
    PAIRS = [(a, b) for a, b in PAIRS if (NAMES.index(b) - NAMES.index(a)) % len(NAMES) == 1]
ROOM = one_of_each(96)
SUN = np.array([math.sin(0.55) * math.cos(0.9), math.cos(0.55) * math.cos(0.9), math.sin(0.9)])


def sun(geometry):
    """A sun as a camera shows it: a few very bright pixels in a world of 1."""
    d, seen = directions(geometry)
    near = np.arccos(np.clip(d @ SUN, -1, 1))
    return np.where(seen, np.where(near < 0.04, 1.6e9, 1.0), 0.0).astype(np.float32)


@pytest.mark.sweep
@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_the_sun_keeps_its_illuminance(source, target):
    there, back = ROOM[source], ROOM[target]
    picture = sun(there)
    moved, _ = resample(picture, there, back)
    before = (picture * projected_solid_angles(there, SUN)).sum(dtype=float)
    after = (moved * projected_solid_angles(back, SUN)).sum(dtype=float)
    assert after == pytest.approx(before, rel=2e-3)
    assert moved.min() >= 0
    assert moved.max() <= 1.6e9


@pytest.mark.sweep
@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_a_constant_stays_that_constant(source, target):
    there, back = one_of_each(40)[source], one_of_each(55)[target]
    for method in ("area", "bilinear"):
        moved, coverage = resample(np.full((there.height_px, there.width_px), 7.5), there, back, method=method)
        np.testing.assert_allclose(moved[coverage > 0], 7.5, rtol=1e-5)
        assert coverage.min() >= 0
        assert coverage.max() <= 1


def test_shrinking_keeps_all_energy():
    big = Equirectangular(300, 150)
    picture = np.random.default_rng(1).lognormal(0, 3, (150, 300, 3)).astype(np.float32)
    for target in (Equirectangular(17, 9, 1.0), Equirectangular(1, 1)):
        moved, coverage = resample(picture, big, target)
        kept = (moved * solid_angles(target)[..., None]).sum(axis=(0, 1))
        np.testing.assert_allclose(kept, (picture * solid_angles(big)[..., None]).sum(axis=(0, 1)), rtol=1e-5)
        np.testing.assert_allclose(coverage, 1, atol=1e-6)
    half = fisheye(LensMapping.EQUIDISTANT, 9)
    moved, _ = resample(picture, big, half)
    kept = (moved * solid_angles(half)[..., None]).sum(axis=(0, 1))
    upper = (picture * solid_angles(big)[..., None])[:75].sum(axis=(0, 1))
    np.testing.assert_allclose(kept, upper, rtol=1e-3)


@pytest.mark.parametrize("method", ["area", "bilinear"])
def test_smooth_pictures_arrive_where_they_belong(method):
    limit = {"area": 0.04, "bilinear": 8e-3}[method]
    for source, target in PAIRS[::5] if method == "area" else PAIRS[::2]:
        there, back = one_of_each(100)[source], one_of_each(80)[target]
        moved, coverage = resample(smooth(there), there, back, method=method)
        if method != "area" and isinstance(there, Perspective):
            continue  # Its outermost half pixel repeats the last one.
        inside = coverage > 0.999
        assert inside.any()
        edge = inside & (np.abs(directions(back)[0][..., 2]) > 0.4)
        assert np.abs(moved - smooth(back))[edge].max() < limit, (source, target)


@pytest.mark.parametrize("method", ["area", "bilinear"])
def test_invalid_pixels_do_not_bleed(method):
    there = Equirectangular(80, 40)
    picture = np.ones((40, 80, 3), np.float32)
    weights = np.ones((40, 80), np.float32)
    picture[10:20, 30:50], weights[10:20, 30:50] = 1e9, 0
    for target in one_of_each(48).values():
        moved, coverage = resample(picture, there, target, method=method, weights=weights)
        assert (coverage > 0).mean() > 0.1
        assert moved.max() <= 1.0001
        np.testing.assert_allclose(moved[coverage > 0], 1, rtol=1e-4)
        assert (moved[coverage == 0] == 0).all()


def test_nothing_valid_gives_nothing():
    moved, coverage = resample(
        np.ones((8, 16)), Equirectangular(16, 8), fisheye(LensMapping.EQUISOLID, 8), weights=np.zeros((8, 16))
    )
    assert not moved.any()
    assert not coverage.any()


@pytest.mark.long
@settings(max_examples=15, deadline=None)
@given(geometries, geometries)
def test_any_pair_at_any_size_is_finite_and_in_range(source, target):
    picture = np.random.default_rng(0).lognormal(0, 4, (source.height_px, source.width_px, 2)).astype(np.float32)
    for method in ("area", "bilinear"):
        moved, coverage = resample(picture, source, target, method=method)
        assert moved.dtype == coverage.dtype == np.float32
        assert np.isfinite(moved).all()
        assert moved.min() >= 0
        assert moved.max() <= picture.max() * 1.001
        assert ((coverage >= 0) & (coverage <= 1)).all()


def test_a_quarter_turn_by_whole_columns_is_exact():
    there, back = Equirectangular(32, 16), Equirectangular(32, 16, math.pi / 2)
    picture = np.random.default_rng(2).random((16, 32)).astype(np.float32)
    np.testing.assert_allclose(resample(picture, there, back)[0], np.roll(picture, -8, axis=1), rtol=1e-5)


def test_what_cannot_be_seen_of_the_result_is_not_worked_out(monkeypatch):
    """Cells of a square beyond a fisheye's circle take no light; labels that are all what lies outside stay it."""
    there, back = fisheye(LensMapping.EQUIDISTANT, 64), fisheye(LensMapping.ORTHOGRAPHIC, 32)
    found = []
    monkeypatch.setenv("DAYLIT_THREADS", "1")  # one band after the other
    monkeypatch.setattr(resampling_area, "finish", lambda light, weight, *_: found.append((light, weight)))
    resample(np.ones((64, 64, 1), np.float32), there, back)
    light, weight = (np.concatenate(each) for each in zip(*found, strict=True))
    beyond = solid_angles(back) == 0
    assert not weight[beyond].any()
    assert not light[beyond].any()
    assert (weight[~beyond] > 0).all()
    monkeypatch.setattr(resampling, "_centres", None)
    assert not resample_labels(np.zeros((64, 64), np.uint8), there, back).any()


def test_labels_and_uncertainty_follow():
    there, back = Equirectangular(90, 45), Perspective(30, 20, 1.2, yaw_rad=math.pi, pitch_rad=0.4)
    d, _ = directions(there)
    labels = (d[..., 2] > 0.2).astype(np.uint8) + 1
    found = resample_labels(labels, there, back)
    truth = (directions(back)[0][..., 2] > 0.2) + 1
    assert (found == truth).mean() > 0.95
    assert set(np.unique(resample_labels(labels, there, fisheye(LensMapping.EQUISOLID, 20)))) == {0, 1, 2}
    u = np.full((45, 90), 0.03)
    u[:20] = np.inf
    moved = resample_uncertainty(u, there, Equirectangular(45, 22))
    assert np.isinf(moved[:9]).all()
    np.testing.assert_allclose(moved[11:], 0.03, rtol=1e-5)


@pytest.mark.parametrize("width", [8, 9])
def test_padding_goes_round_and_over(width):
    d, _ = directions(Equirectangular(width, 6))
    padded = padded_sphere(np.ascontiguousarray(d.astype(np.float32)))
    assert padded.shape == (10, width + 4, 3)
    # Over the pole come the directions on the other side; between two columns they are shorter.
    over = padded[1, 2:-2] / np.linalg.norm(padded[1, 2:-2], axis=-1, keepdims=True)
    np.testing.assert_allclose(
        over[:, :2] / np.linalg.norm(over[:, :2], axis=1)[:, None],
        -d[0, :, :2] / np.linalg.norm(d[0, :, :2], axis=1)[:, None],
        atol=1e-5,
    )
    np.testing.assert_allclose(padded[2:-2, :2], d[:, -2:], atol=1e-6)


@pytest.mark.parametrize(
    "call",
    [
        lambda p, g: resample(np.full((4, 8), np.nan), g, g),
        lambda p, g: resample(p[:3], g, g),
        lambda p, g: resample(p, g, g, method="magic"),
        lambda p, g: resample(p, g, g, weights=p * 2),
        lambda p, g: resample(p, g, g, weights=p[:2]),
        lambda p, g: resample_labels(p[:2], g, g),
        lambda p, g: resample_uncertainty(-p, g, g),
    ],
)
def test_what_cannot_be_is_refused(call):
    with pytest.raises(ParameterError):
        call(np.ones((4, 8)), Equirectangular(8, 4))


def test_beyond_a_fisheyes_field_nothing_is_covered():
    sky, target = fisheye(LensMapping.EQUISOLID, 96), fisheye(LensMapping.EQUIDISTANT, 96)
    _, coverage = resample(np.ones((96, 96), np.float32), sky, target)
    outside = solid_angles(target) == 0
    assert outside.any()
    assert coverage[outside].max() == 0
