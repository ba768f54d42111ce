"""Glare: the formula by hand, sources, and Radiance's evalglare on the same light."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import numpy as np
import pytest

from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import ParameterError
from processing.figures.figures import eye_view
from processing.figures.glare import bright_spots, glare_indices, glare_of, linked, position_index, probability
from processing.pictures.images import LuminanceImage
from processing.pictures.radiance import write_radiance_hdr
from processing.sphere import Equirectangular, directions, solid_angles
from tests.conftest import LONG


def panorama(level: np.ndarray) -> LuminanceImage:
    rgb = np.repeat(level[..., None], 3, axis=-1).astype(np.float32)
    geometry = Equirectangular(level.shape[1], level.shape[0])
    return LuminanceImage(rgb, np.full(level.shape, 0.05, np.float32), np.zeros(level.shape, np.uint8), geometry, 0.05)


def patch(rays: np.ndarray, lon: float, lat: float, wide: float, high: float) -> np.ndarray:
    """Return which directions lie in a window, degrees from its middle."""
    longitude, latitude = np.degrees(np.arctan2(rays[..., 0], rays[..., 1])), np.degrees(np.arcsin(rays[..., 2]))
    return (np.abs((longitude - lon + 180) % 360 - 180) < wide) & (np.abs(latitude - lat) < high)


def room(windows: list[tuple[float, ...]], around: float = 100.0, rows: int = 256, sun: bool = False) -> LuminanceImage:
    rays, _ = directions(Equirectangular(2 * rows, rows))
    level = np.where(rays[..., 2] < 0, around / 2, around)
    for lon, lat, wide, high, luminance in windows:
        level = np.where(patch(rays, lon, lat, wide, high), luminance, level)
    if sun:
        towards = np.array([0.3, 0.8, 0.5]) / math.sqrt(0.98)
        level = np.where(rays @ towards > math.cos(math.radians(1.2)), 3e5, level)
    return panorama(level)


def glare(image: LuminanceImage, azimuth: float = 0.0):
    rays, _ = directions(image.geometry)
    spots = bright_spots(rays, image.rgb[..., 0], solid_angles(image.geometry))
    light = illuminance_lx(image, (math.sin(azimuth), math.cos(azimuth), 0.0)).value_lx
    return glare_of(spots, light, azimuth)


def test_formula_by_hand() -> None:
    index = float(position_index(np.array([[0.0, math.cos(0.3), math.sin(0.3)]]), 0.0)[0])
    total = 5000.0**2 * 0.1 / index**2
    expected = 5.87e-5 * 2000 + 0.0918 * math.log10(1 + total / 2000**1.87) + 0.16
    assert probability(2000.0, total) == pytest.approx(expected, rel=1e-12)
    assert probability(0.0, 0.0) == 0.0
    assert probability(1e6, 1e12) == 1.0


def test_position_index_grows_away_from_where_one_looks() -> None:
    up = np.radians([0, 10, 20, 30, 40, 50])
    above = position_index(np.column_stack([0 * up, np.cos(up), np.sin(up)]), 0.0)
    below = position_index(np.column_stack([0 * up, np.cos(up), -np.sin(up)]), 0.0)
    assert above[0] == pytest.approx(1, abs=1e-9)
    assert (np.diff(above) > 0).all()
    assert (np.diff(below) > 0).all()
    assert below[3] == pytest.approx(1 + 0.8 * math.tan(math.radians(30)))
    assert position_index(np.array([[0.0, 0.02, -0.9998]]), 0.0)[0] == pytest.approx(1 + 1.2 * 3)
    turned = position_index(np.array([[math.sin(1.0), math.cos(1.0), 0.0]]), 1.0)
    assert turned[0] == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    ("degrees", "groups"),
    [(((0, 0), (8, 0)), 1), (((0, 0), (20, 0)), 2), (((-179, 5), (179, 5)), 1), (((0, 86), (180, 86)), 1), ((), 0)],
)
def test_what_lies_near_is_one_source(degrees: tuple, groups: int) -> None:
    lon, lat = np.radians(np.array(degrees, np.float64).reshape(-1, 2)).T
    rays = np.column_stack([np.cos(lat) * np.sin(lon), np.cos(lat) * np.cos(lon), np.sin(lat)])
    assert len(set(linked(rays, 0.2).tolist())) == groups


def test_windows_the_sun_and_none() -> None:
    assert glare(room([])).sources == 0
    assert glare(room([])).brightest_cd_m2 == 0
    two = room([(-40, 5, 10, 15, 5000), (40, 5, 10, 15, 4000)])
    assert glare(two).sources == 2
    assert glare(two).brightest_cd_m2 == pytest.approx(5000, rel=1e-3)
    assert glare(two, math.pi).sources == 0
    assert glare(two).dgp > glare(two, math.pi / 2).dgp > glare(two, math.pi).dgp
    sunny = glare(room([(-40, 5, 10, 15, 5000)], sun=True))
    assert sunny.sources == 2
    assert sunny.brightest_cd_m2 > 1e5
    assert sunny.rating == "perceptible"
    assert not sunny.faint
    assert glare(room([], around=10.0)).faint


def test_black_and_blinding_pictures_give_a_number() -> None:
    assert glare(panorama(np.zeros((32, 64)))).dgp == 0.0
    blinding = np.full((32, 64), 1.0)
    blinding[5, 30] = 1.6e9
    found = glare(panorama(blinding))
    assert 0 < found.dgp <= 1
    with pytest.raises(ParameterError):
        glare_of(bright_spots(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0))), math.nan, 0.0)


CASES = {
    "one window": (room([(10, 10, 20, 15, 5000)], rows=256), 0.0),
    "from the side": (room([(10, 10, 20, 15, 5000)], rows=256), -0.7),
    "two windows": (room([(-40, 5, 10, 15, 3000), (35, -5, 8, 12, 8000)], 50.0, rows=256), 0.1),
    "below": (room([(0, -25, 10, 8, 9000)], rows=256), 0.0),
    "a dim room": (room([(30, 10, 4, 6, 2500)], 10.0, rows=256), 0.0),
    "the sun": (room([(-30, 10, 15, 20, 6000)], rows=256, sun=True), 0.0),
}


@pytest.mark.sweep
@pytest.mark.parametrize("name", CASES if LONG else ["from the side", "the sun"])
def test_evalglare_finds_the_same(tmp_path: Path, name: str) -> None:
    pyradiance = pytest.importorskip("pyradiance", reason="an oracle of the bench extra")
    tool = Path(pyradiance.__file__).parent / "bin" / "evalglare"
    image, azimuth = CASES[name]
    path = tmp_path / "view.hdr"
    write_radiance_hdr(path, eye_view(image, azimuth, 240))
    result = subprocess.run([str(tool), str(path)], capture_output=True, text=True, check=False).stdout
    ours = glare(image, azimuth)
    assert float(result.partition(":")[2].split()[0]) == pytest.approx(ours.dgp, abs=0.015), result
    light = subprocess.run([str(tool), "-V", str(path)], capture_output=True, text=True, check=False).stdout
    assert float(light.split()[0]) == pytest.approx(ours.vertical_lx, rel=0.01)
    lines = subprocess.run([str(tool), "-d", str(path)], capture_output=True, text=True, check=False).stdout
    names, _, values = lines.strip().splitlines()[-1].partition(":")
    theirs = dict(zip(names.split(","), map(float, values.split()), strict=False))
    indices = {key: one["value"] for key, one in glare_indices(eye_view(image, azimuth, 240)).items()}
    for key, off in {"dgi": 0.35, "ugr": 0.35, "cgi": 0.35, "ugp": 0.015}.items():
        assert indices[key] == pytest.approx(theirs[key], abs=off), (key, lines)
    assert indices["vcp_pct"] == pytest.approx(theirs["vcp"], abs=1.5)
