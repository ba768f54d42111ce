"""The chart is found whichever way it hangs, and k2 is the ratio of the cameras, not of their stray light."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mocks.optics.chart import ChartRoom
from mocks.worlds.light import Site
from processing.calibration.scale.chart import find_chart, scale_from_charts, spectral_mismatch
from processing.calibration.scale.chart_patches import WHITE, reflectances
from processing.errors import ChartError
from processing.pictures.images import Validity, luminance_cd_m2
from processing.pictures.modes import SharedMode
from processing.sphere import pixels
from tests.conftest import LONG
from tests.processing.calibration.scale.chart_scenes import chart_view

TRUE = ChartRoom(0).patch_luminances_cd_m2


WAYS: tuple[dict[str, float | Site], ...] = (
    {"roll_rad": math.pi, "gain": 1e-6},
    {"roll_rad": 0.4, "fov_deg": 80},
    {"site": Site.OUTDOOR, "seed": 1},
    {"width_px": 110},
    {"roll_rad": math.pi / 2},
    {"yaw_rad": 0.15, "gain": 1e6},
)


@pytest.mark.sweep
@pytest.mark.parametrize("how", WAYS if LONG else WAYS[:3])
def test_chart_is_found_and_read_in_its_order(how: dict[str, float | Site]) -> None:
    found = find_chart(chart_view(**how))  # type: ignore[arg-type]
    assert found.how == "cv2.mcc"
    assert found.mismatch < 0.1
    true = ChartRoom(int(how.get("seed", 0))).patch_luminances_cd_m2
    ratio = found.luminance / true / how.get("gain", 1.0)
    np.testing.assert_allclose(ratio[found.usable], 1.0, atol=0.06)
    assert ratio[WHITE] == pytest.approx(1.0, abs=0.015)


@pytest.mark.sweep
def test_corners_by_hand_in_any_turn() -> None:
    view = chart_view()
    middles = ChartRoom(0).patch_directions(Site.INDOOR)
    x, y, _ = pixels(view.geometry, middles)
    right, down = (x[1] - x[0]) / 2, (y[6] - y[0]) / 2
    corners = np.array(
        [(x[i] + sx * right, y[i] + sy * down) for i, sx, sy in ((0, -1, -1), (5, 1, -1), (23, 1, 1), (18, -1, 1))]
    )
    for turn in range(4) if LONG else (1, 2):
        found = find_chart(view, np.roll(corners, turn, axis=0) + 1.0)
        assert found.how == "corners"
        assert found.luminance[WHITE] == pytest.approx(TRUE[WHITE], rel=0.01)


def test_no_chart_is_reported() -> None:
    view = chart_view(yaw_rad=math.pi)
    with pytest.raises(ChartError, match="chart"):
        find_chart(view)
    with pytest.raises(ChartError):
        find_chart(view, [(50, 50), (200, 50), (200, 150), (50, 150)])
    black = replace(view, rgb=np.zeros_like(view.rgb))
    with pytest.raises(ChartError):
        find_chart(black)


@pytest.mark.parametrize(
    "corners",
    [
        [(0, 0)] * 4,
        [(1, 1), (2, 2), (3, 3), (4, 4)],
        [(-9, -9), (400, 0), (400, 300), (0, 300)],
        [(1, 2)],
        [(np.nan, 0)] * 4,
    ],
)
def test_impossible_corners_are_reported(corners: list[tuple[float, float]]) -> None:
    with pytest.raises(ChartError):
        find_chart(chart_view(), corners)


def test_patches_of_a_few_pixels_are_refused() -> None:
    view = chart_view(width_px=24, noise=0.0)
    with pytest.raises(ChartError):
        find_chart(view, [(5.1, 4.3), (18.9, 4.3), (18.9, 13.6), (5.1, 13.6)])


def test_k2_is_the_ratio_of_the_cameras() -> None:
    indoor, outdoor = find_chart(chart_view()), find_chart(chart_view(site=Site.OUTDOOR, gain=1 / 2.117, width_px=260))
    found = scale_from_charts(indoor, outdoor)
    assert found.scale.value == pytest.approx(2.117, rel=0.006)
    assert found.white_ratio == pytest.approx(2.117, rel=0.01)
    assert found.scale.value == pytest.approx(2.117, rel=3 * found.scale.relative_uncertainty)
    assert found.scale.warnings == ()
    assert max(p.color_difference for p in found.patches) < 2


def test_k2_is_as_unsure_as_curves_times_and_the_channels_balance() -> None:
    indoor, outdoor = find_chart(chart_view()), find_chart(chart_view(site=Site.OUTDOOR))
    plain = scale_from_charts(indoor, outdoor).scale
    places = tuple(np.linspace(-10, 20, 40).tolist())
    off = SharedMode("curve and times 1", "level", places, (0.03,) * 40)
    shaken = scale_from_charts(indoor, outdoor, shared=((off,), (off,)), colour_frac=0.02).scale
    assert plain.relative_uncertainty < 0.01
    assert shaken.parts["curves"] == pytest.approx(0.03 * 2**0.5, rel=0.05)
    assert shaken.parts["colour"] == pytest.approx(0.02, rel=0.1)
    assert shaken.value == plain.value
    # Outdoor blue of half the gain: neutral light shows less there than the lamp's white by blue's part of luminance.
    dim = replace(outdoor, rgb=outdoor.rgb * (1, 1, 0.5))
    assert scale_from_charts(indoor, dim).scale.parts["colour"] > plain.parts["colour"]


def test_stray_light_moves_the_white_patch_and_not_k2() -> None:
    indoor, outdoor = find_chart(chart_view(veil=60.0)), find_chart(chart_view(site=Site.OUTDOOR))
    found = scale_from_charts(indoor, outdoor)
    assert found.white_ratio > 1.04
    assert found.scale.value == pytest.approx(1.0, rel=0.008)
    assert "stray light" in found.scale.warnings[0]


def test_clipped_white_is_replaced_and_reported_and_too_few_neutrals_refused() -> None:
    indoor, view = find_chart(chart_view()), chart_view(site=Site.OUTDOOR)
    view.validity[luminance_cd_m2(view.rgb) > 0.93 * TRUE[WHITE]] = Validity.CLIPPED
    found = scale_from_charts(indoor, find_chart(view))
    assert found.scale.value == pytest.approx(1.0, rel=0.01)
    assert "clipped" in found.scale.warnings[0]
    view.validity[luminance_cd_m2(view.rgb) > 0.2 * TRUE[WHITE]] = Validity.CLIPPED
    with pytest.raises(ChartError, match=r"neutral patches .*\(indoor 6, outdoor [0-2]\)"):
        scale_from_charts(indoor, find_chart(view))


def test_reflectances_are_the_published_ones() -> None:
    white = reflectances()[WHITE]
    assert white[0] == pytest.approx(((243 / 255 + 0.055) / 1.055) ** 2.4)
    assert np.all(np.diff(luminance_cd_m2(reflectances())[18:]) < 0)


def test_a_camera_of_other_spectra_shows_in_the_coloured_patches() -> None:
    true, all_seen = luminance_cd_m2(reflectances()).astype(np.float64), np.ones(24, dtype=bool)
    assert spectral_mismatch(300 * true + 2.0, all_seen) == pytest.approx(0.0, abs=1e-5)
    # Luminance by equal weights in place of V(lambda)'s; and by a lamp's colour, which is known
    equal = reflectances().mean(axis=1)
    assert spectral_mismatch(equal, all_seen) == pytest.approx(np.sqrt(np.mean((equal / true - 1)[:18] ** 2)), rel=0.1)
    lamp = luminance_cd_m2(reflectances() * (2.0, 1.0, 0.28)).astype(np.float64)
    assert spectral_mismatch(lamp, all_seen, math.log(0.28)) < 0.02 < spectral_mismatch(lamp, all_seen)
    assert spectral_mismatch(true, np.arange(24) > 12) is None
    assert spectral_mismatch(true, np.arange(24) < 20) is None
