"""A sky behind the glass: a panorama taken from inside shows it where the window is, on the room's own scale."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest

from mocks.worlds.sky import SimpleSky
from processing.calibration.outdoor.glass_view import not_one_camera, only_the_view
from processing.calibration.outdoor.session_sky import calibrate_outdoor, why_no_scale
from processing.calibration.outdoor.sun_place import Place, sun_place
from processing.calibration.scale.luminance import ScaleFactor
from processing.errors import LensError
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, Fisheye, directions, solid_angles
from processing.stages.brackets import merge_geometry
from processing.stages.parameters import CalibrateParameters
from station.session.session import DeviceRecord, FrameRecord, Side, Site
from tests.station.session.sessions import manifest

PANORAMA = Equirectangular(720, 360)
NOON = datetime(2024, 3, 26, 17, 0, tzinfo=UTC)
PLACE = Place(40.44, -79.99)
CLIPPED_CD_M2 = 60_000.0
"""What a Theta's shortest stop still shows, about."""


def panorama(window_azimuth_rad: float, room_cd_m2: float = 60.0) -> tuple[RelativeImage, np.ndarray]:
    """Return a room with one wide window, taken at the glass, and where the window is; the sun stands in the window."""
    ways, _ = directions(PANORAMA, slice(0, PANORAMA.height_px))
    azimuth, height = np.arctan2(ways[..., 0], ways[..., 1]), np.arcsin(ways[..., 2])
    window = (np.abs(np.arctan2(np.sin(azimuth - window_azimuth_rad), np.cos(azimuth - window_azimuth_rad))) < 1.2) & (
        np.abs(height - 0.35) < 0.85
    )
    sky = SimpleSky(sun_azimuth_rad=window_azimuth_rad + 0.3, sun_elevation_rad=sun_place(NOON, PLACE).elevation_rad)
    rng = np.random.default_rng(7)
    room = room_cd_m2 * rng.lognormal(0, 0.6, window.shape)[..., None] * np.array([1.0, 0.95, 0.85])
    room[(np.abs(height) < 0.1) & (np.abs(azimuth + 1.5) < 0.05)] = 4_000.0  # a lamp
    rgb = np.where(window[..., None], sky.radiance(ways.astype(np.float32)), room).astype(np.float32)
    sun = np.einsum("hwc,c->hw", ways, np.array(sky.sun_direction)) > math.cos(math.radians(1.0))
    rgb[sun & window] = CLIPPED_CD_M2
    validity = np.where(sun & window, Validity.CLIPPED, Validity.VALID).astype(np.uint8)
    uncertainty = np.full(window.shape, 0.01, dtype=np.float32)
    return RelativeImage(rgb, uncertainty, validity, PANORAMA), window


def one_camera(**sky: object):
    """Return a session whose two brackets are one Theta's."""
    frames = tuple(
        FrameRecord.model_validate(
            {
                "side": side,
                "stop": 0,
                "file": f"{side}/00_4s.jpg",
                "size_bytes": 1,
                "sha256": "0" * 64,
                "asked_s": 4.0,
                "camera_s": 4.0,
                "iso": 100,
                "f_number": 5.6,
                "taken_utc": NOON,
                **(sky if side == "outdoor" else {}),
            }
        )
        for side in ("indoor", "outdoor")
    )
    devices = tuple(DeviceRecord(role=side, kind="theta_z1", model="RICOH THETA Z1") for side in ("indoor", "outdoor"))
    site = Site(latitude_deg=PLACE.latitude_deg, longitude_deg=PLACE.longitude_deg)
    return manifest(devices=devices, frames=frames, site=site, heading_rad=0.0)


@pytest.mark.parametrize("azimuth_rad", [0.0, math.pi])  # in the middle, and across the seam
def test_the_window_is_distinguished_from_room_and_lamp(azimuth_rad: float) -> None:
    picture, window = panorama(azimuth_rad)
    found, share = only_the_view(picture)
    kept = found.validity != Validity.OUTSIDE
    area = solid_angles(PANORAMA)
    assert area[kept & ~window].sum() < 0.002 * area[window].sum(), "neither lamp nor wall"
    assert area[kept & window].sum() > 0.995 * area[window].sum()
    assert share == pytest.approx(area[window].sum() / area.sum(), rel=0.01)
    assert np.isinf(found.uncertainty[~kept]).all()


def test_a_room_as_bright_as_its_window_is_no_sky() -> None:
    picture, _ = panorama(0.0, room_cd_m2=1500.0)
    with pytest.raises(LensError, match="stops brighter"):
        only_the_view(picture)


def test_the_sky_has_the_rooms_scale_and_its_north_from_the_sun() -> None:
    picture, _ = panorama(0.5)
    asked = CalibrateParameters(falloff="off", outdoor_view="equirectangular")
    assert why_no_scale(one_camera(), asked, None, picture) is None
    found = calibrate_outdoor(
        replace(picture, rgb=picture.rgb / 50), one_camera(), asked, None, ScaleFactor(50.0, 0.02)
    )
    assert found.scale.value == pytest.approx(50.0)
    assert found.scale.relative_uncertainty == pytest.approx(math.hypot(0.02, 0.03))
    true = sun_place(NOON, PLACE).azimuth_rad
    top = math.radians(found.facts["north"]["top_azimuth_deg"])
    assert math.remainder(top + 0.8 - true, 2 * math.pi) == pytest.approx(0.0, abs=math.radians(1.0))
    ways, _ = directions(found.image.geometry, slice(0, found.image.rgb.shape[0]))
    seen = found.image.validity == Validity.VALID
    turned = np.arctan2(ways[..., 0], ways[..., 1]) - top  # back into the camera's own directions
    flat = np.hypot(ways[..., 0], ways[..., 1])
    back = np.stack([flat * np.sin(turned), flat * np.cos(turned), ways[..., 2]], axis=-1).astype(np.float32)
    sky = SimpleSky(sun_azimuth_rad=0.8, sun_elevation_rad=sun_place(NOON, PLACE).elevation_rad)
    ratio = luminance_cd_m2(found.image.rgb)[seen] / luminance_cd_m2(sky.radiance(back))[seen]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.01)
    assert np.quantile(np.abs(ratio - 1), 0.9) < 0.1
    assert "behind the glass" in found.warnings[0]


@pytest.mark.parametrize("change", [{"iso": 200}, {"f_number": 2.1}])
def test_another_setting_needs_k2(change: dict[str, float]) -> None:
    session, (picture, _) = one_camera(**change), panorama(0.0)
    assert not_one_camera(session)
    assert "give --k2" in str(why_no_scale(session, CalibrateParameters(), None, picture))
    asked = CalibrateParameters(k2=0.5)
    assert why_no_scale(session, asked, None, picture) is None
    assert calibrate_outdoor(picture, session, asked, None, ScaleFactor(2.0, 0.02)).scale.value == pytest.approx(1.0)


def test_an_outdoor_panorama_is_merged_as_one() -> None:
    theta, canon = (DeviceRecord(role="outdoor", kind="imported", model=m) for m in ("RICOH THETA Z1", "Canon EOS"))
    bracket = SimpleNamespace(side=Side.OUTDOOR, size_px=(160, 80), device=theta)
    assert merge_geometry(bracket, {}) == Equirectangular(160, 80)  # type: ignore[arg-type]
    for other in (
        SimpleNamespace(side=Side.OUTDOOR, size_px=(160, 80), device=canon),
        SimpleNamespace(side=Side.OUTDOOR, size_px=(160, 100), device=theta),
    ):
        assert isinstance(merge_geometry(other, {}), Fisheye)  # type: ignore[arg-type]
