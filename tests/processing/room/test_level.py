"""Levelling: known tilts are found and undone, and nothing is invented where there is no room."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.shared_data import DATA
from processing.errors import ParameterError
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.room.level import Upright, find_upright, make_upright
from processing.room.vanishing import find_arcs, rotation_about, rotation_vector, tone_mapped
from processing.sphere import Equirectangular, Fisheye, LensMapping, solid_angles
from tests.processing.room.drawn_rooms import Patch, as_image, directions, draw

PATCHES = (
    Patch("front", -0.9, 0.4, 0.9, 2.1, 20.0, 0.2),
    Patch("left", -1.0, -0.2, 0.0, 2.0, 0.3),
    Patch("right", -0.5, 0.6, 1.2, 1.9, 0.2),
    Patch("back", -0.4, 1.2, 0.0, 1.1, 0.25),
)
ANGLE = st.floats(-1, 1)


def tilted(x_rad: float, y_rad: float, z_rad: float, rows: int = 192) -> tuple[RelativeImage, np.ndarray]:
    turn = rotation_about(np.array([x_rad, y_rad, 0.0])) @ rotation_about(np.array([0.0, 0.0, z_rad]))
    return as_image(draw(rows, patches=PATCHES, turn=turn).luminance), turn


def up_error_deg(found: Upright, turn: np.ndarray) -> float:
    up = found.rotation @ turn.T @ [0.0, 0.0, 1.0]
    return math.degrees(math.atan2(math.hypot(up[0], up[1]), up[2]))


@settings(max_examples=12, deadline=None)
@given(ANGLE, ANGLE, ANGLE)
def test_any_turn_about_three_axes_is_found(x: float, y: float, z: float) -> None:
    image, turn = tilted(0.3 * x, 0.3 * y, math.pi * z)
    tilt = math.acos(turn[2, 2])
    found = find_upright(image)
    assert found.support > 0.5
    assert abs(found.tilt_rad - tilt) < math.radians(0.6)
    if found.note.startswith("turned"):
        assert up_error_deg(found, turn) < 0.6
    else:
        assert tilt < max(math.radians(0.8), 3 * found.sigma_rad)
    ahead = found.rotation @ turn.T @ [0.0, 1.0, 0.0]
    off = math.remainder(math.atan2(ahead[0], ahead[1]) - found.manhattan_rad, math.pi / 2)
    assert abs(off) < math.radians(0.8 if found.note.startswith("turned") else 2.0)
    assert -math.pi / 4 < found.manhattan_rad <= math.pi / 4


def test_an_upright_room_is_left_as_it_is() -> None:
    image, _ = tilted(0.0, 0.0, 0.4)
    found = find_upright(image)
    assert not found.note.startswith("turned")
    assert "not levelled" in found.note
    assert found.tilt_rad < math.radians(0.5)
    assert found.sigma_rad < math.radians(1)
    assert make_upright(image, found.rotation) is image


def test_the_levelled_picture_is_the_upright_room() -> None:
    image, turn = tilted(0.2, -0.1, 0.0, rows=256)
    upright = make_upright(image, turn)
    wanted = draw(256, patches=PATCHES).luminance
    seen = upright.rgb[..., 0]
    # Beside edges the two sample them differently.
    assert np.mean(np.abs(np.log(seen / wanted)) < 0.05) > 0.96
    assert upright.attributes["level_tilt_deg"] == pytest.approx(
        math.degrees(np.linalg.norm(rotation_vector(turn))), abs=1e-3
    )
    assert not find_upright(upright).note.startswith("turned")


@pytest.mark.parametrize("rows", [63, 65])
def test_a_picture_of_a_row_too_many_or_too_few_is_twice_as_wide_as_high(rows: int) -> None:
    drawn = draw(256, patches=PATCHES).luminance
    light = cv2.resize(drawn, (128, rows), interpolation=cv2.INTER_AREA)
    flat = np.full(light.shape, 0.02, np.float32)
    image = LuminanceImage(
        np.repeat(light[..., None], 3, 2), flat, np.zeros(light.shape, np.uint8), Equirectangular(128, rows), 0.03
    )
    whole = make_upright(image, np.eye(3))
    assert whole.geometry == Equirectangular(128, 64)
    wanted = cv2.resize(drawn, (128, 64), interpolation=cv2.INTER_AREA)
    assert np.median(np.abs(np.log(whole.rgb[..., 0] / wanted))) < 0.01
    assert whole.validity.shape == whole.uncertainty.shape == (64, 128)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_no_light_is_is_refused(bad: float) -> None:
    image, _ = tilted(0.1, 0.0, 0.0, rows=64)
    image.rgb[30, 40] = bad
    with pytest.raises(ParameterError, match="NaN or Inf"):
        find_upright(image)


def test_light_is_kept() -> None:
    d = directions(128)
    wave = 1 + 0.5 * np.sin(9 * d[..., 0]) * np.cos(7 * d[..., 2]) + 40 * (d @ [0.6, 0.0, 0.8] > 0.99)
    soft = np.asarray(cv2.GaussianBlur(wave, (0, 0), 1.0), np.float32)
    upright = make_upright(as_image(soft, noise=0), rotation_about(np.array([0.2, -0.1, 0.3])))
    solid = solid_angles(Equirectangular(256, 128))
    assert (upright.rgb[..., 0] * solid).sum() == pytest.approx((soft * solid).sum(), rel=1e-3)


def test_validity_uncertainty_and_scale_are_carried() -> None:
    image, turn = tilted(0.25, 0.0, 0.0, rows=64)
    validity, uncertainty = image.validity.copy(), image.uncertainty.copy()
    validity[50:] = Validity.OUTSIDE
    uncertainty[:10] = np.inf
    rgb = image.rgb.copy()
    rgb[50:] = 0
    carried = LuminanceImage(rgb, uncertainty, validity, image.geometry, scale_uncertainty=0.03, ghost=validity)
    upright = make_upright(carried, turn)
    assert upright.scale_uncertainty == 0.03
    assert upright.ghost is not None
    assert upright.rgb.dtype == np.float32
    assert upright.validity.dtype == np.uint8
    assert 0.1 < np.mean(upright.validity == Validity.OUTSIDE) < 0.25
    assert np.isinf(upright.uncertainty).any()
    assert np.isfinite(upright.rgb).all()
    assert upright.rgb.min() >= 0
    assert np.array_equal(upright.ghost, upright.validity)


def test_what_lies_outside_the_picture_darkens_nothing_beside_it() -> None:
    """A lens that sees the upper part only: the zeros below are no light of the rows above them."""
    image = as_image(np.full((64, 128), 5.0, np.float32), noise=0)
    rgb, validity = image.rgb.copy(), image.validity.copy()
    rgb[40:], validity[40:] = 0.0, Validity.OUTSIDE
    upright = make_upright(replace(image, rgb=rgb, validity=validity), rotation_about(np.array([0.2, 0.1, 0.0])))
    seen = upright.validity != Validity.OUTSIDE
    assert 0.4 < seen.mean() < 0.8
    np.testing.assert_allclose(upright.rgb[seen], 5.0, rtol=1e-5)
    assert np.isfinite(upright.rgb).all()


def test_a_picture_that_is_not_to_be_turned_still_gives_its_walls_azimuth() -> None:
    image, turn = tilted(0.15, 0.0, 0.4)
    found = find_upright(image, turn=False)
    assert not found.note.startswith("turned")
    assert "switched off" in found.note
    assert found.tilt_rad == pytest.approx(0.15, abs=math.radians(0.6))
    ahead = turn.T @ [0.0, 1.0, 0.0]
    off = math.remainder(math.atan2(ahead[0], ahead[1]) - found.manhattan_rad, math.pi / 2)
    assert abs(off) < math.radians(2)


def test_the_sun_beside_darkness_rings_nowhere() -> None:
    luminance = np.full((64, 128), 1.0, np.float32)
    luminance[20, 30] = 1.6e9
    upright = make_upright(as_image(luminance, noise=0), rotation_about(np.array([0.1, 0.05, 0.0])))
    assert upright.rgb.min() >= 1.0
    assert upright.rgb.max() <= 1.6e9


@pytest.mark.parametrize("value", [0.0, 1.0, 1.6e9])
def test_black_and_constant_pictures_give_nothing(value: float) -> None:
    image = as_image(np.full((32, 64), value, np.float32), noise=0)
    found = find_upright(image)
    assert found.support == 0
    assert not found.note.startswith("turned")
    assert math.isinf(found.sigma_rad)
    assert tone_mapped(image).std() == 0


@pytest.mark.parametrize("shape", [(1, 2), (2, 4), (8, 16)])
def test_tiny_pictures_give_nothing(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    found = find_upright(as_image(rng.random(shape).astype(np.float32)))
    assert found.support == 0
    assert not found.note.startswith("turned")


def test_open_country_is_not_turned() -> None:
    """Blobs without straight edges, and a bright sky over a wavy horizon."""
    rng = np.random.default_rng(3)
    blobs = cv2.GaussianBlur(rng.random((192, 384)), (0, 0), 4) > 0.5
    horizon = (
        100 + 6 * np.sin(np.arange(384) / 384 * 2 * math.pi * 5) + 3 * np.sin(np.arange(384) / 384 * 2 * math.pi * 13)
    )
    land = np.arange(192)[:, None] > horizon
    picture = np.where(land, 0.1 + 0.2 * blobs, 5.0).astype(np.float32)
    found = find_upright(as_image(picture))
    assert found.support < 0.5
    assert not found.note.startswith("turned")


def test_what_is_outside_the_picture_makes_no_lines_for_black() -> None:
    image = as_image(np.zeros((32, 64), np.float32), noise=0)
    assert len(find_arcs(replace(image, validity=np.full((32, 64), Validity.OUTSIDE, np.uint8))).length_rad) == 0


def test_wrong_input_is_refused() -> None:
    image = as_image(np.ones((32, 64), np.float32))
    with pytest.raises(ParameterError, match="no rotation"):
        make_upright(image, np.diag([1.0, 1.0, -1.0]))
    lens = Fisheye(64, 32, LensMapping.EQUIDISTANT, radius_px=16)
    with pytest.raises(ParameterError, match="cannot be levelled"):
        find_upright(replace(image, geometry=lens))


@pytest.mark.shared("panoramas/furnished")
@pytest.mark.parametrize("name", ["attic_layoutnet_tilted.png", "bedroom_hn_tilted.png"])
def test_real_tilted_rooms_become_upright(name: str) -> None:
    raw = cv2.imread(str(DATA / "panoramas" / "furnished" / name))[..., 1].astype(np.float32) / 255
    image = as_image(cv2.resize(raw, (768, 384), interpolation=cv2.INTER_AREA) ** 2.2, noise=0)
    found = find_upright(image)
    assert found.note.startswith("turned")
    assert math.radians(28) < found.tilt_rad < math.radians(33)
    again = find_upright(make_upright(image, found.rotation))
    assert again.tilt_rad < math.radians(1.0)
    assert again.support > 0.5
