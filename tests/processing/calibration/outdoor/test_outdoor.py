"""The outdoor chain on simulated skies: light kept, colours and sky right, each step undone by its inverse."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocks.worlds.light import luminance_cd_m2 as true_luminance
from mocks.worlds.sky import SimpleSky
from processing.calibration.outdoor import outdoor
from processing.calibration.outdoor.outdoor import (
    OutdoorOptics,
    OutdoorView,
    outdoor_view,
)
from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import LensError
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, directions, solid_angles
from tests.conftest import LONG
from tests.processing.calibration.outdoor.sky_pictures import (
    correct_outdoor,
    in_cd_m2,
    optics_of,
    sky_picture,
    true_horizontal_lx,
)

WIDTH = 240
SKY = SimpleSky(sun_azimuth_rad=0.7, sun_elevation_rad=math.radians(48))


@pytest.fixture(scope="module")
def seen() -> RelativeImage:
    return sky_picture(SKY, WIDTH)


@pytest.mark.sweep
@pytest.mark.parametrize("view", list(OutdoorView) if LONG else [OutdoorView.HEMISPHERICAL])
def test_light_and_sky_are_the_worlds(seen: RelativeImage, view: OutdoorView) -> None:
    target = outdoor_view(view, 150)
    out = correct_outdoor(seen, optics_of(WIDTH), target)
    sky_lx, sun_lx = true_horizontal_lx(SKY)
    assert illuminance_lx(in_cd_m2(out)).value_lx == pytest.approx(sky_lx + sun_lx, rel=0.01)
    ways, _ = directions(target)
    away = np.arccos(np.clip(ways @ np.array(SKY.sun_direction), -1, 1)) > math.radians(3)
    open_sky = (out.validity == Validity.VALID) & (ways[..., 2] > 0.12) & away
    off = luminance_cd_m2(out.rgb)[open_sky] / true_luminance(SKY.radiance(ways.astype(np.float32)))[open_sky] - 1
    assert np.percentile(np.abs(off), 95) < 0.02
    colour = out.rgb[open_sky] / luminance_cd_m2(out.rgb)[open_sky][:, None]
    true = SKY.radiance(ways.astype(np.float32))[open_sky]
    assert np.percentile(np.abs(colour / (true / true_luminance(true)[:, None]) - 1), 95) < 0.03


@pytest.mark.sweep
@pytest.mark.parametrize("view", list(OutdoorView))
@pytest.mark.parametrize("elevation_deg", [20.0, 89.0] if LONG else [20.0])
def test_the_suns_energy_passes_the_projection(view: OutdoorView, elevation_deg: float) -> None:
    """Radiance times solid angle of all pixels is the same before and after, to 0.2 %; its middle stays."""
    sky = SimpleSky(0.4, math.radians(elevation_deg), zenith_luminance_cd_m2=1e-3, ground_luminance_cd_m2=1e-3)
    image = outdoor.with_lens(sky_picture(sky, WIDTH), optics_of(WIDTH))
    out = outdoor.project(image, outdoor_view(view, 150))
    before = luminance_cd_m2(image.rgb) * solid_angles(image.geometry)
    after = luminance_cd_m2(out.rgb) * solid_angles(out.geometry)
    assert after.sum() == pytest.approx(before.sum(), rel=2e-3)


@pytest.mark.long
@pytest.mark.sweep
@pytest.mark.parametrize("seed", range(3 if LONG else 1))
def test_boxes_stand_for_cells_where_light_is_even(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Against exact overlaps everywhere: the same marks, and light within the stated error."""
    rng = np.random.default_rng(seed)
    geometry = optics_of(600).lens.fisheye()
    ways, inside = directions(geometry)
    hills = sum(a * np.sin(7 * (ways @ rng.normal(size=3)) + k) for k, a in enumerate(rng.uniform(100, 400, 4)))
    light = np.where(ways @ rng.normal(size=3) > 1.2, 300.0, 2000.0 + hills) * rng.normal(1, 0.01, inside.shape)
    light[ways @ SKY.sun_direction > math.cos(math.radians(0.6))] = 1e6
    validity = np.where(inside, Validity.VALID, Validity.OUTSIDE).astype(np.uint8)
    validity[inside & (light > 1e5)] = Validity.CLIPPED
    rgb = np.where(inside[..., None], light[..., None] * [0.9, 1.0, 1.2], 0).astype(np.float32)
    image = RelativeImage(rgb, np.full(inside.shape, 0.01, np.float32), validity, geometry)
    target = outdoor_view(OutdoorView.HEMISPHERICAL, 400, 0.4)
    assert not outdoor._uneven(luminance_cd_m2(rgb), validity)[inside].mean() > 0.5
    found = outdoor.project(image, target)
    monkeypatch.setattr(outdoor, "_uneven", lambda light, _validity: np.ones(light.shape, bool))
    exact = outdoor.project(image, target)
    assert np.array_equal(found.validity, exact.validity)
    shown = exact.validity != Validity.OUTSIDE
    off = np.abs(luminance_cd_m2(found.rgb)[shown] / luminance_cd_m2(exact.rgb)[shown] - 1)
    assert 0 < np.median(off) < 1e-3
    assert off.max() < 0.02
    level = [illuminance_lx(in_cd_m2(one)).value_lx for one in (found, exact)]
    assert level[0] == pytest.approx(level[1], rel=1e-5)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 99), level=st.floats(-3, 8), spread=st.floats(0, 0.3))
def test_vignetting_and_colour_are_undone(seed: int, level: float, spread: float) -> None:
    optics = optics_of(60)
    rng = np.random.default_rng(seed)
    rgb = (10**level * (1 + spread * rng.uniform(-1, 1, (40, 60, 3)))).astype(np.float32)
    flat = np.full((40, 60), 0.02, dtype=np.float32)
    image = RelativeImage(rgb, flat, np.zeros((40, 60), np.uint8), optics.lens.fisheye())
    assert optics.filter is not None
    assert optics.vignetting is not None
    falloff = optics.vignetting.map(optics.lens.fisheye())[..., None]
    dimmed = replace(image, rgb=(rgb @ np.array(optics.filter.tint, np.float32)) * falloff)
    there = outdoor.correct_colour(outdoor.correct_vignetting(dimmed, optics), optics)
    assert there.attributes["nd_moved_share"] == 0
    assert np.abs(there.rgb / rgb - 1).max() < 1e-5


def test_the_projection_is_undone(seen: RelativeImage) -> None:
    """Back in the lens's geometry smooth sky is what it was; the sun's light is all there."""
    optics = optics_of(WIDTH)
    target = outdoor_view(OutdoorView.EQUIDISTANT, 300)
    placed = outdoor.with_lens(seen, optics)
    straight = outdoor.correct_colour(outdoor.correct_vignetting(placed, optics), optics)
    back = outdoor.project(correct_outdoor(seen, optics, target), placed.geometry)
    ways, _ = directions(seen.geometry)
    away = np.arccos(np.clip(ways @ np.array(SKY.sun_direction), -1, 1)) > math.radians(3)
    sky = (back.validity == Validity.VALID) & (ways[..., 2] > 0.15) & away
    assert np.percentile(np.abs(back.rgb[sky] / straight.rgb[sky] - 1), 95) < 0.01
    omega = solid_angles(back.geometry) * (back.validity != Validity.OUTSIDE)
    light = [(luminance_cd_m2(picture.rgb) * omega).sum() for picture in (back, straight)]
    assert light[0] == pytest.approx(light[1], rel=5e-3)


def test_uncertainty_and_validity_go_along() -> None:
    image = sky_picture(SKY, WIDTH, clip=1e6)
    image.validity[70:74, 110:120] = Validity.DARK
    image.rgb[70:74, 110:120] = 0
    image.uncertainty[70:74, 110:120] = np.inf
    image = replace(image, ghost=np.where(image.validity == Validity.DARK, 3, 0).astype(np.uint8))
    optics = optics_of(WIDTH)
    out = correct_outdoor(image, optics, outdoor_view(OutdoorView.EQUIDISTANT, 150))
    counts = {code: int((out.validity == code).sum()) for code in Validity}
    assert min(counts[Validity.CLIPPED], counts[Validity.DARK], counts[Validity.OUTSIDE]) > 0
    assert out.ghost is not None
    assert (out.ghost[out.validity == Validity.DARK] == 3).mean() > 0.8
    assert np.isfinite(out.rgb).all()
    assert out.rgb.min() >= 0
    valid = out.validity == Validity.VALID
    assert (out.uncertainty > 0).all()
    assert not np.isnan(out.uncertainty).any()
    assert np.median(out.uncertainty[valid]) == pytest.approx(0.012, abs=0.004)


def test_all_clipped_all_dark_and_nothing_to_correct() -> None:
    optics = OutdoorOptics(optics_of(60).lens)
    for code, value in ((Validity.CLIPPED, 5.0), (Validity.DARK, 0.0)):
        rgb = np.full((40, 60, 3), value, dtype=np.float32)
        u = np.full((40, 60), np.inf, dtype=np.float32)
        image = RelativeImage(rgb, u, np.full((40, 60), code, np.uint8), optics.lens.fisheye())
        out = correct_outdoor(image, optics)
        inside = out.validity != Validity.OUTSIDE
        assert (out.validity[inside] == code).all()
        assert np.allclose(out.rgb[inside], value)
        assert not np.isnan(out.uncertainty).any()


def test_north_on_top_turns_the_picture(seen: RelativeImage) -> None:
    """The top of the picture said to face another way moves the sun by as much."""
    optics = optics_of(WIDTH)
    target = outdoor_view(OutdoorView.EQUIRECTANGULAR, 90)
    for top in (0.0, -2.0):
        out = correct_outdoor(seen, optics, target, top_azimuth_rad=top)
        _, column = np.unravel_index(luminance_cd_m2(out.rgb).argmax(), out.rgb.shape[:2])
        longitude = (column + 0.5) / 180 * 2 * math.pi - math.pi
        assert math.remainder(longitude - SKY.sun_azimuth_rad - top, 2 * math.pi) == pytest.approx(0, abs=0.04)


def test_steps_in_the_wrong_order_are_refused(seen: RelativeImage) -> None:
    out = correct_outdoor(seen, optics_of(WIDTH), Equirectangular(64, 32))
    with pytest.raises(LensError, match="original fisheye"):
        outdoor.correct_vignetting(out, optics_of(WIDTH))
    with pytest.raises(LensError, match="picture in one of"):
        correct_outdoor(replace(seen, rgb=seen.rgb[:100], uncertainty=seen.uncertainty[:100]), optics_of(WIDTH))
