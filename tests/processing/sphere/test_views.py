import dataclasses
import math

import numpy as np
import pytest

from processing.errors import ParameterError
from processing.ground.threads import give_back
from processing.sphere import Equirectangular, Perspective
from processing.sphere.view_maps import KEPT, cut_map
from processing.sphere.views import Panorama, covering_views, cut_view, stitch_views, view_at, view_ring
from tests.processing.sphere.sphere_pictures import smooth

PANORAMA = Equirectangular(360, 180)
LOOKS = [(0.0, 0.0), (math.pi, 0.1), (0.4, math.pi / 2), (-2.0, -1.5), (3.0, 0.7)]


def look(theta, phi, size=90):
    return view_at(fov_rad=1.4, theta_rad=theta, phi_rad=phi, height_px=size, width_px=size + 10)


@pytest.mark.parametrize("at", LOOKS)
def test_views_show_the_truth_across_seam_and_poles(at):
    view = look(*at)
    found = cut_view(smooth(PANORAMA), view)
    assert found.dtype == np.float32
    assert np.abs(found - smooth(view)).max() < 7e-4


@pytest.mark.parametrize("at", LOOKS)
def test_eight_bits_follow_within_a_code(at):
    view = look(*at)
    codes = np.rint(smooth(PANORAMA) * 60).astype(np.uint8)
    colour = np.dstack([codes, codes, 255 - codes])
    found = cut_view(colour, view)
    assert found.dtype == np.uint8
    assert np.abs(found[..., 0] - smooth(view) * 60).max() < 1.6
    assert np.abs(found[..., 2] - (255 - smooth(view) * 60)).max() < 1.6


def test_a_turned_panorama_is_cut_as_if_it_were_not():
    turned = Equirectangular(360, 180, yaw_rad=1.0)
    view = look(0.3, 0.2)
    assert np.abs(cut_view(Panorama(smooth(turned), yaw_rad=1.0), view) - smooth(view)).max() < 7e-4


def test_coarse_views_do_not_alias():
    # Columns of one pixel, black and white: a coarse view must be grey.
    stripes = np.zeros((512, 1024), np.float32)
    stripes[:, ::2] = 1
    view = Perspective(24, 24, math.radians(90))
    assert np.abs(cut_view(stripes, view) - 0.5).max() < 0.12


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (5, 3), (4, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_tiny_panoramas(size, dtype):
    picture = np.full((size[1], size[0], 3), 200, dtype)
    for theta, phi in LOOKS[2:4]:
        assert (np.abs(cut_view(picture, look(theta, phi, 7)) - 200.0) < 1e-3).all()


def test_views_stitch_back_to_the_panorama():
    truth = smooth(PANORAMA, 6.0)
    views = covering_views(size_px=120, fov_rad=math.radians(90))
    back, coverage = stitch_views([cut_view(truth, v) for v in views], views, PANORAMA)
    assert coverage.min() == 1
    assert np.abs(back - truth).max() < 5e-3


@pytest.mark.parametrize("fov_deg", [30, 60, 90, 120])
@pytest.mark.parametrize("overlap", [0.2, 0.5])
def test_covering_views_leave_no_hole(fov_deg, overlap):
    views = covering_views(size_px=8, fov_rad=math.radians(fov_deg), overlap=overlap)
    back, coverage = stitch_views([np.ones((8, 8))] * len(views), views, Equirectangular(120, 60))
    assert coverage.min() == 1
    np.testing.assert_allclose(back, 1, rtol=1e-5)


def test_seams_between_views_of_unequal_brightness_are_feathered():
    ring = view_ring(4, size_px=64, fov_rad=math.radians(120))
    back, coverage = stitch_views([np.full((64, 64), 1 + k % 2) for k in range(4)], ring, PANORAMA)
    row = back[90]
    assert (coverage[90] == 1).all()
    assert np.abs(np.diff(np.append(row, row[0]))).max() < 0.08


def test_invalid_pixels_of_views_do_not_bleed():
    views = view_ring(6, size_px=60, fov_rad=math.radians(90))
    pictures = [np.full((60, 60, 2), 5.0) for _ in views]
    weights = [np.ones((60, 60)) for _ in views]
    pictures[0][20:30], weights[0][20:30] = 1e9, 0
    back, coverage = stitch_views(pictures, views, PANORAMA, weights=weights)
    np.testing.assert_allclose(back[coverage > 0], 5, rtol=1e-4)
    assert not back[coverage == 0].any()


def test_coarse_targets_take_halved_views():
    view = Perspective(257, 255, math.radians(80))
    picture = np.zeros((255, 257), np.float32)
    picture[:, ::2] = 1
    back, coverage = stitch_views([picture], [view], Equirectangular(36, 18))
    inner = back[8:10, 16:20]
    assert (coverage[8:10, 16:20] > 0.99).all()
    assert np.abs(inner - 0.5).max() < 0.12


def test_the_last_maps_are_kept_until_memory_is_given_back():
    view = Perspective(24, 16, math.radians(80))
    first = cut_map(PANORAMA, view, fixed=True)
    assert cut_map(PANORAMA, view, fixed=True) is first
    for turn in range(KEPT):
        cut_map(PANORAMA, dataclasses.replace(view, yaw_rad=0.1 + 0.1 * turn), fixed=True)
    assert cut_map(PANORAMA, view, fixed=True) is not first
    give_back()
    assert cut_map.cache_info().currsize == 0


@pytest.mark.parametrize(
    "call",
    [
        lambda p, v: cut_view(p.astype(np.float64), v),
        lambda p, v: cut_view(p[0], v),
        lambda p, v: stitch_views([], [], PANORAMA),
        lambda p, v: stitch_views([p], [v], PANORAMA),
        lambda p, v: stitch_views([np.full((20, 30), np.nan)], [v], PANORAMA),
        lambda p, v: stitch_views([np.ones((20, 30))], [v], PANORAMA, weights=[np.ones((2, 2))]),
        lambda p, v: view_ring(0, size_px=5, fov_rad=1.0),
        lambda p, v: covering_views(size_px=5, fov_rad=3.0),
    ],
)
def test_what_cannot_be_is_refused(call):
    with pytest.raises(ParameterError):
        call(np.ones((8, 16), np.float32), Perspective(30, 20, 1.0))
