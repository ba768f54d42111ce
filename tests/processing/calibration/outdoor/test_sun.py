"""The sun found in simulated skies, clipped and cut; north from it; its repair, which is never silent."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from mocks.rooms.sky.daylight import Moment, sun_of
from mocks.worlds.sky import SimpleSky
from processing.calibration.outdoor import outdoor
from processing.calibration.outdoor.lens import LensModel
from processing.calibration.outdoor.sun_disc import find_sun
from processing.calibration.outdoor.sun_place import (
    Place,
    clear_beam,
    efficacies_lm_w,
    north_from_heading,
    north_from_sun,
    oriented,
    sun_place,
)
from processing.calibration.outdoor.sun_repair import repair_sun
from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import ParameterError, SunError
from processing.ground.colour import RGB_OF_XYZ, XYZ_OF_RGB
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.sphere import LensMapping
from tests.processing.calibration.outdoor.sky_pictures import in_cd_m2, optics_of, sky_picture, true_horizontal_lx

WIDTH = 420
PIXEL_RAD = 36 / 8 / WIDTH
PITTSBURGH = Place(40.44, -79.99, 300.0)
NOON = datetime(2023, 5, 19, 16, 30, tzinfo=UTC)


def corrected(sky: SimpleSky, width: int = WIDTH, clip: float | None = None) -> RelativeImage:
    optics = optics_of(width)
    image = outdoor.with_lens(sky_picture(sky, width, clip=clip), optics)
    return outdoor.correct_colour(outdoor.correct_vignetting(image, optics), optics)


def angle_to(sky: SimpleSky, direction: tuple[float, float, float]) -> float:
    return 2 * math.asin(min(1.0, math.dist(sky.sun_direction, direction) / 2))


@pytest.mark.parametrize(("azimuth", "elevation_deg"), [(0.3, 12.0), (-2.6, 41.0), (1.9, 89.5)])
def test_found_to_a_part_of_a_pixel(azimuth: float, elevation_deg: float) -> None:
    sky = SimpleSky(azimuth, math.radians(elevation_deg))
    found = find_sun(corrected(sky))
    assert angle_to(sky, found.direction) < min(0.25 * PIXEL_RAD, 4 * found.sigma_rad)
    assert not found.clipped
    assert not found.cut


def test_clipped_is_reported_and_its_middle_found() -> None:
    sky = SimpleSky(1.2, math.radians(37))
    found = find_sun(corrected(sky, clip=3e5))
    assert found.clipped
    assert angle_to(sky, found.direction) < min(0.6 * PIXEL_RAD, 3 * found.sigma_rad)


@pytest.mark.parametrize("clip", [None, 3e5])
@pytest.mark.parametrize("inside_deg", [0.45])
def test_cut_by_the_edge_of_the_field(inside_deg: float, clip: float | None) -> None:
    """A field of 2 x 60 degrees whose outermost whole pixels hold a part of the sun."""
    sky = SimpleSky(-0.5, math.radians(30 + inside_deg))
    whole = optics_of(640).lens
    half = math.pi / 3
    circle = replace(whole.circle, radius_px=whole.circle.radius_px * math.sin(half / 2) / math.sin(math.pi / 4))
    optics = replace(optics_of(640), lens=LensModel(LensMapping.EQUISOLID, circle, half))
    found = find_sun(outdoor.with_lens(sky_picture(sky, 640, clip=clip), optics))
    assert found.cut
    assert found.clipped == (clip is not None)
    assert angle_to(sky, found.direction) < min(3.5 * found.sigma_rad, math.radians(0.8))


@pytest.mark.parametrize("kind", ["uniform", "dark", "bright cloud", "all clipped", "outside"])
def test_no_sun_is_a_named_refusal(kind: str) -> None:
    geometry = optics_of(120).lens.fisheye()
    rgb = np.full((80, 120, 3), 0.0 if kind == "dark" else 2000.0, dtype=np.float32)
    validity = np.zeros((80, 120), dtype=np.uint8)
    if kind == "bright cloud":
        rgb[30:45, 50:75] = 12_000.0
    validity[:] = {"all clipped": Validity.CLIPPED, "outside": Validity.OUTSIDE}.get(kind, Validity.VALID)
    with pytest.raises(SunError, match="no sun"):
        find_sun(RelativeImage(rgb, np.full((80, 120), 0.01, np.float32), validity, geometry))


@pytest.mark.parametrize("heading", [0.0, 2.1])
def test_north_to_a_tenth_of_a_degree(heading: float) -> None:
    """The picture's top faces azimuth 0 of the world, whose +y has the compass azimuth ``heading``."""
    azimuth, elevation = sun_of(Moment(PITTSBURGH.latitude_deg, PITTSBURGH.longitude_deg, NOON, heading))
    image = corrected(SimpleSky(azimuth, elevation))
    north = north_from_sun(image, NOON, PITTSBURGH)
    off = math.remainder(north.top_azimuth_rad - heading, 2 * math.pi)
    assert abs(off) < max(math.radians(0.1), 3 * north.sigma_rad)
    assert abs(off) < math.radians(0.25)
    assert north.source == "sun"
    assert not north.warnings
    assert north.elevation_off_rad == pytest.approx(0, abs=math.radians(0.1))
    turned = oriented(image.geometry, north, heading)  # type: ignore[arg-type]
    assert turned.top_azimuth_rad == pytest.approx(off, abs=1e-9)


def test_a_wrong_clock_is_named() -> None:
    azimuth, elevation = sun_of(Moment(PITTSBURGH.latitude_deg, PITTSBURGH.longitude_deg, NOON, 0.0))
    image = corrected(SimpleSky(azimuth, elevation), 240)
    with pytest.raises(SunError, match="degrees high in the picture"):
        north_from_sun(image, datetime(2023, 5, 19, 21, 30, tzinfo=UTC), PITTSBURGH)
    late = north_from_sun(image, datetime(2023, 5, 19, 15, 55, tzinfo=UTC), PITTSBURGH)
    assert any("than time and site predict" in warning for warning in late.warnings)
    with pytest.raises(ParameterError, match="zone"):
        north_from_sun(image, datetime(2023, 5, 19, 16, 30), PITTSBURGH)
    assert north_from_heading(-1.0).top_azimuth_rad == pytest.approx(2 * math.pi - 1.0)
    with pytest.raises(ParameterError, match="not on Earth"):
        Place(95.0, 0.0)


def test_positions_are_those_of_the_almanac() -> None:
    """At an equinox's true noon on the equator the sun is overhead; the pole sees it on the horizon, refracted."""
    equinox = datetime(2024, 3, 20, 3, 6, tzinfo=UTC)
    pole = sun_place(equinox, Place(90.0, 0.0))
    assert math.degrees(pole.elevation_rad) == pytest.approx(0.5, abs=0.15)
    overhead = max(
        sun_place(datetime(2024, 3, 20, 12, minute, tzinfo=UTC), Place(0.0, 0.0)).elevation_rad
        for minute in range(4, 11)
    )
    assert math.degrees(overhead) > 89.6


def clipped_sky() -> tuple[SimpleSky, LuminanceImage, float]:
    sky = SimpleSky(0.8, math.radians(40))
    return sky, in_cd_m2(corrected(sky, clip=3e5)), sum(true_horizontal_lx(sky))


def test_repaired_from_a_reading() -> None:
    sky, image, lux = clipped_sky()
    assert illuminance_lx(image).value_lx < 0.6 * lux
    done, note = repair_sun(image, horizontal_lx=lux)
    assert illuminance_lx(done).value_lx == pytest.approx(lux, rel=0.01)
    (said_cd_m2,) = re.findall(r"reading: ([\d.e+]+) cd/m2", note)
    assert float(said_cd_m2) == pytest.approx(sky.sun_luminance_cd_m2, rel=0.05)
    assert done.attributes["sun_repaired"] == note
    repaired = done.uncertainty[done.validity == Validity.REPAIRED]
    assert repaired.size > 0
    assert (np.abs(repaired / 0.055 - 1) < 0.8).all()
    assert (image.validity != Validity.REPAIRED).all(), "the picture given is left as it was"
    assert find_sun(done).direction == pytest.approx(sky.sun_direction, abs=0.01)


def test_repaired_from_a_clear_sky() -> None:
    azimuth, elevation = sun_of(Moment(PITTSBURGH.latitude_deg, PITTSBURGH.longitude_deg, NOON, 0.0))
    image = in_cd_m2(corrected(SimpleSky(azimuth, elevation), clip=3e5))
    beam = clear_beam(NOON, PITTSBURGH)
    assert 7e4 < beam.normal_lx < 1.1e5
    done, note = repair_sun(image, beam=beam)
    sun_lx, rest_lx = map(float, re.findall(r"([\d.e+]+) lx (?:horizontal|from the rest)", note))
    assert sun_lx == pytest.approx(beam.normal_lx * math.sin(elevation), rel=0.01)
    assert illuminance_lx(done).value_lx == pytest.approx(sun_lx + rest_lx, rel=0.01)
    assert "clear-sky" in note


@pytest.mark.parametrize(("elevation_deg", "low_k", "high_k"), [(60, 5200, 5800), (25, 4600, 5300), (10, 3500, 4300)])
def test_a_repaired_sun_has_the_colour_of_its_height(elevation_deg: float, low_k: float, high_k: float) -> None:
    """Colour temperatures of direct sun in clear air, as handbooks of lighting have them."""
    import colour

    image = in_cd_m2(corrected(SimpleSky(0.8, math.radians(elevation_deg)), clip=3e5))
    done, _ = repair_sun(image, beam=clear_beam(NOON, PITTSBURGH))
    rgb = done.rgb[np.unravel_index(done.rgb[..., 1].argmax(), done.rgb.shape[:2])]
    xyz = np.asarray(XYZ_OF_RGB) @ rgb
    found_k = float(colour.temperature.xy_to_CCT(xyz[:2] / xyz.sum(), method="McCamy 1992"))
    assert low_k < found_k < high_k


def test_a_repaired_sun_at_an_air_mass_of_1_5_has_the_colour_of_the_reference_spectrum() -> None:
    """ASTM G173-03, direct, by the CIE 1931 observer: the sun 41.8 degrees high."""
    import colour
    import pvlib

    image = in_cd_m2(corrected(SimpleSky(0.8, math.radians(41.8)), clip=3e5))
    done, _ = repair_sun(image, beam=clear_beam(NOON, PITTSBURGH))
    found = done.rgb[np.unravel_index(done.rgb[..., 1].argmax(), done.rgb.shape[:2])]
    spectrum, waves_nm = pvlib.spectrum.get_reference_spectra()["direct"], np.arange(380, 781)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy()
    observer = observer.align(colour.SpectralShape(380, 780, 1)).values
    rgb = np.asarray(RGB_OF_XYZ) @ (np.interp(waves_nm, spectrum.index, spectrum) @ observer)
    np.testing.assert_allclose(found / found[1], rgb / rgb[1], rtol=0.03)


def test_what_cannot_be_repaired_is_refused() -> None:
    sky, image, lux = clipped_sky()
    with pytest.raises(SunError, match="leaves"):
        repair_sun(image, horizontal_lx=0.2 * lux)
    with pytest.raises(SunError, match="cd/m2"):
        repair_sun(image, horizontal_lx=40 * lux)
    with pytest.raises(SunError, match="not clipped"):
        repair_sun(in_cd_m2(corrected(sky)), horizontal_lx=lux)
    with pytest.raises(ParameterError, match="give one"):
        repair_sun(image)
    with pytest.raises(ParameterError):
        repair_sun(image, horizontal_lx=math.nan)


def test_the_clear_skys_beam() -> None:
    """Night gives none; haze takes light; the efficacy of a high clear sun is near 100 lm/W."""
    night = clear_beam(datetime(2023, 5, 20, 4, 0, tzinfo=UTC), PITTSBURGH)
    assert night.normal_lx == 0
    clean, hazy = (clear_beam(NOON, PITTSBURGH, turbidity).normal_lx for turbidity in (2.0, 6.0))
    assert hazy < 0.8 * clean
    assert 95 < efficacies_lm_w(math.radians(25), 900.0, 90.0, 0.07)[0] < 112
    with pytest.raises(ParameterError, match="turbidity"):
        clear_beam(NOON, PITTSBURGH, 0.1)
