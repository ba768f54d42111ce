"""The indoor half of the stage calibrate: what it says of odd shapes, and what is certain where the meter looked."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.sessions import Taken, write_session
from mocks.worlds.simple_room import SimpleRoom
from processing.calibration.outdoor.lens import ImageCircle, LensModel
from processing.calibration.outdoor.outdoor import OutdoorOptics
from processing.calibration.outdoor.session_sky import with_shared_modes
from processing.calibration.scale.glare_fit import VEIL_INDEX
from processing.calibration.scale.luminance import Spot, sighted, spot_pixels
from processing.calibration.scale.vignetting import COPY_SIGMA, published_vignetting
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import ROOM_SPECTRAL_SIGMA, modes_of, relative_error
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions
from processing.stages.calibrate import calibrate_indoor, not_a_panorama
from processing.stages.parameters import CalibrateParameters
from station.session.session import Side
from station.session.store import load_manifest


@pytest.mark.parametrize(("width", "height", "result"), [(40, 20, 0), (6720, 3360, 0), (60, 40, 1), (20, 20, 1)])
def test_a_picture_that_is_not_twice_as_wide_as_high_is_reported(width: int, height: int, result: int) -> None:
    shape = (height // 20, width // 20) if width > 1000 else (height, width)
    image = LuminanceImage(
        rgb=np.ones((*shape, 3), np.float32),
        uncertainty=np.full(shape, 0.01, np.float32),
        validity=np.zeros(shape, np.uint8),
        geometry=Equirectangular(shape[1], shape[0]),
        scale_uncertainty=0.01,
    )
    assert len(not_a_panorama(image)) == result


def lit_room(spot_blue: float) -> RelativeImage:
    """A panorama whose left half is daylight and whose right half is twice as blue; the spot lies in the middle."""
    rgb = np.ones((40, 80, 3), np.float32)
    rgb[:, 41:, 2] = 2
    rgb[:, 38:41, 2] = spot_blue
    shape = rgb.shape[:2]
    return RelativeImage(rgb, np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), Equirectangular(80, 40))


@pytest.mark.parametrize("spot_blue", [1.0, 2.0])
def test_light_of_another_colour_than_the_meters_spot_is_less_certain(tmp_path: Path, spot_blue: float) -> None:
    write_session(tmp_path / "room", Taken(SimpleRoom(3), 32, (Side.INDOOR,)))
    asked = CalibrateParameters(target="0,0")
    picture = calibrate_indoor(lit_room(spot_blue), load_manifest(tmp_path / "room"), asked, None).image
    (spectra,) = (mode for mode in modes_of(picture) if mode.name == "spectra")
    error = relative_error(spectra, picture, luminance_cd_m2(picture.rgb))
    assert error[20, 39] == pytest.approx(0, abs=1e-6)
    assert error[20, 60] - error[20, 10] == pytest.approx(ROOM_SPECTRAL_SIGMA * np.log(2), rel=1e-4)
    assert error[20, 10 if spot_blue == 1 else 60] == pytest.approx(0, abs=1e-6)


def test_k1_is_less_certain_for_another_camera_by_what_the_lens_did_to_the_boards_light(tmp_path: Path) -> None:
    """Near the stitch, with stray light and fall-off not measured; the panorama itself is right there."""
    write_session(tmp_path / "room", Taken(SimpleRoom(3), 32, (Side.INDOOR,)))
    room, added = load_manifest(tmp_path / "room"), {}
    for falloff in ("auto", "off"):
        asked = CalibrateParameters(target="85,0", falloff=falloff)
        found = calibrate_indoor(lit_room(1.0), room, asked, None)
        own, sky = found.scale.relative_uncertainty, found.of_camera.relative_uncertainty
        added[falloff] = math.sqrt(sky**2 - own**2)
    assert VEIL_INDEX / 2 < added["off"] < 2 * VEIL_INDEX
    assert math.sqrt(added["auto"] ** 2 - added["off"] ** 2) == pytest.approx(COPY_SIGMA, rel=0.1)


def test_fall_off_and_stray_light_of_an_eye_are_0_where_the_meter_looked() -> None:
    geometry = Fisheye(60, 60, LensMapping.EQUIDISTANT, 30.0)
    _, seen = directions(geometry)
    light = np.where(seen, np.linspace(10, 300, 60)[:, None], 0)[..., None].repeat(3, axis=2).astype(np.float32)
    validity = np.where(seen, Validity.VALID, Validity.OUTSIDE).astype(np.uint8)
    picture = LuminanceImage(light, np.full((60, 60), 0.02, np.float32), validity, geometry, 0.01)
    lens = LensModel(LensMapping.EQUIDISTANT, ImageCircle((30, 30), 30, (60, 60)))
    optics = OutdoorOptics(lens, published_vignetting("canon_8mm_f5_6"))
    towards = sighted(geometry, math.radians(40), math.radians(10))
    spot = spot_pixels(geometry, Spot(*towards))
    level = luminance_cd_m2(picture.rgb)
    found = with_shared_modes(picture, optics, None, ((spot.mean(level), *towards), 0.0))
    assert {"fall-off", "stray light 1", "spectra"} <= {mode.name for mode in modes_of(found)}
    errors = {mode.name: relative_error(mode, found, level) for mode in modes_of(found)}
    for name, error in errors.items():
        assert spot.mean(error) == pytest.approx(0, abs=2e-3 if "stray" in name else 3e-4), name
    assert all(np.abs(errors[name][seen]).max() > 3e-3 for name in ("fall-off", "stray light 1"))
