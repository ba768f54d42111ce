"""Glare: the formula by hand, sources, and Radiance's evalglare on the same light."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processing.errors import ParameterError
from processing.figures.figures import camera_figures, eye_view
from processing.figures.glare import Task, glare_indices, linked, position_index, probability
from processing.pictures.images import LuminanceImage, Validity
from processing.pictures.radiance import write_radiance_hdr
from processing.sphere import Equirectangular, Fisheye, Perspective, directions
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


def glare(image: LuminanceImage, azimuth: float = 0.0, task: Task | None = None) -> dict[str, float]:
    return {name: one["value"] for name, one in glare_indices(image, [azimuth], task=task)[0].items()}


def test_formula_by_hand() -> None:
    index = float(position_index(np.array([[0.0, math.cos(0.3), math.sin(0.3)]]))[0])
    total = 5000.0**2 * 0.1 / index**2
    expected = 5.87e-5 * 2000 + 0.0918 * math.log10(1 + total / 2000**1.87) + 0.16
    assert probability(2000.0, total) == pytest.approx(expected, rel=1e-12)
    assert probability(0.0, 0.0) == 0.0
    assert probability(1e6, 1e12) == 1.0


def test_position_index_grows_away_from_where_one_looks() -> None:
    up = np.radians([0, 10, 20, 30, 40, 50])
    above = position_index(np.column_stack([0 * up, np.cos(up), np.sin(up)]))
    below = position_index(np.column_stack([0 * up, np.cos(up), -np.sin(up)]))
    assert above[0] == pytest.approx(1, abs=1e-9)
    assert (np.diff(above) > 0).all()
    assert (np.diff(below) > 0).all()
    assert below[3] == pytest.approx(1 + 0.8 * math.tan(math.radians(30)))
    assert position_index(np.array([[0.0, 0.02, -0.9998]]))[0] == pytest.approx(1 + 1.2 * 3)


@pytest.mark.parametrize(
    ("degrees", "groups"),
    [(((0, 0), (8, 0)), 1), (((0, 0), (20, 0)), 2), (((-179, 5), (179, 5)), 1), (((0, 86), (180, 86)), 1), ((), 0)],
)
def test_what_lies_near_is_one_source(degrees: tuple, groups: int) -> None:
    lon, lat = np.radians(np.array(degrees, np.float64).reshape(-1, 2)).T
    rays = np.column_stack([np.cos(lat) * np.sin(lon), np.cos(lat) * np.cos(lon), np.sin(lat)])
    assert len(set(linked(rays, 0.2).tolist())) == groups


def test_windows_the_sun_and_none() -> None:
    none = glare(room([]))
    assert none["sources"] == none["brightest_cd_m2"] == 0
    two = room([(-40, 5, 10, 15, 5000), (40, 5, 10, 15, 4000)])
    ahead, aside, away = (glare(two, azimuth) for azimuth in (0.0, math.pi / 2, math.pi))
    assert ahead["sources"] == 2
    assert ahead["brightest_cd_m2"] == pytest.approx(5000, rel=1e-3)
    assert away["sources"] == 0
    assert ahead["dgp"] > aside["dgp"] > away["dgp"]
    sunny = room([(-40, 5, 10, 15, 5000)], sun=True)
    seen = glare(sunny)
    assert seen["sources"] == 2
    assert seen["brightest_cd_m2"] > 1e5
    look = camera_figures(sunny, height_m=1.6, heading_rad=None)["directions"][0]["glare"]
    assert look["rating"] == "perceptible"
    assert not look["faint"]
    dim = camera_figures(room([], around=10.0), height_m=1.6, heading_rad=None)["directions"][0]
    assert dim["glare"]["faint"]


@pytest.mark.long
def test_a_panorama_and_the_eyes_view_of_it_say_the_same() -> None:
    image = room([(30, 10, 20, 15, 5000)], rows=512)
    for azimuth in (0.0, 0.7, 3.0):
        views = glare(image, azimuth), glare(eye_view(image, azimuth, 500))
        for name, value in views[0].items():
            assert views[1][name] == pytest.approx(value, rel=0.01, abs=0.02), name


@pytest.mark.long
def test_where_north_is_in_a_fisheye_at_the_eye_does_not_matter() -> None:
    """The picture's up is the observer's, however a VIEW line or a calibrated sky has turned the axes under it."""
    view = eye_view(room([(30, 10, 20, 15, 5000)]), 0.0, 250)
    assert isinstance(view.geometry, Fisheye)
    turned = replace(view, geometry=replace(view.geometry, top_azimuth_rad=2.0))
    assert glare(turned) == pytest.approx(glare(view), rel=1e-9)


def test_black_and_blinding_pictures_give_a_number() -> None:
    assert glare(panorama(np.zeros((32, 64))))["dgp"] == 0.0
    blinding = np.full((32, 64), 1.0)
    blinding[5, 30] = 1.6e9
    assert 0 < glare(panorama(blinding))["dgp"] <= 1
    with pytest.raises(ParameterError):
        glare_indices(replace(panorama(np.zeros((32, 64))), geometry=Perspective(64, 32, 32.0)))


def test_a_clipped_source_makes_bounds() -> None:
    """However little of the light it shows: it may be the sun."""
    image = room([(0, 10, 20, 15, 5000)])
    assert {one["bound"] for one in glare_indices(image)[0].values()} == {None}
    validity = image.validity.copy()
    validity[115, 256] = Validity.CLIPPED
    found = glare_indices(replace(image, validity=validity))[0]
    lower = {"dgp", "dgi", "ugr", "cgi", "ugp", "lveil_cd_m2", "brightest_cd_m2"}
    bounds = dict.fromkeys(found) | dict.fromkeys(lower, "lower") | {"vcp_pct": "upper"}
    assert {name: one["bound"] for name, one in found.items()} == bounds
    behind = glare_indices(replace(image, validity=validity), [math.pi])[0]
    assert {one["bound"] for one in behind.values()} == {None}
    look = camera_figures(replace(image, validity=validity), height_m=1.6, heading_rad=None)["directions"]
    assert [one["glare"]["dgp"]["bound"] for one in look[::4]] == ["lower", None]


def test_what_may_be_a_source_or_not_is_uncertain() -> None:
    near, far = (glare_indices(room([(0, 10, 20, 15, level)]))[0] for level in (2040, 2600))
    assert near["dgp"]["uncertainty"] > 3 * far["dgp"]["uncertainty"]
    assert near["sources"]["uncertainty"] == 1
    assert far["sources"]["uncertainty"] == 0


CASES = {
    "one window": (room([(10, 10, 20, 15, 5000)], rows=256), 0.0),
    "from the side": (room([(10, 10, 20, 15, 5000)], rows=256), -0.7),
    "two windows": (room([(-40, 5, 10, 15, 3000), (35, -5, 8, 12, 8000)], 50.0, rows=256), 0.1),
    "below": (room([(0, -25, 10, 8, 9000)], rows=256), 0.0),
    "a dim room": (room([(30, 10, 4, 6, 2500)], 10.0, rows=256), 0.0),
    "the sun": (room([(-30, 10, 15, 20, 6000)], rows=256, sun=True), 0.0),
}


TASKS = {"ahead and below": (0.0, -20.0, 30.0), "to the left": (-15.0, -10.0, 40.0)}
VIEW_PX = 240


@pytest.fixture(scope="module")
def evalglare(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., dict[str, float]]:
    """Return what evalglare says of a view, with further words of its command line."""
    pyradiance = pytest.importorskip("pyradiance", reason="an oracle of the bench extra")
    tool, path = Path(pyradiance.__file__).parent / "bin" / "evalglare", tmp_path_factory.mktemp("views") / "view.hdr"

    def said(image: LuminanceImage, *words: str) -> dict[str, float]:
        write_radiance_hdr(path, image)
        done = subprocess.run([str(tool), "-d", *words, str(path)], capture_output=True, text=True, check=False).stdout
        names, _, values = done.strip().splitlines()[-1].partition(":")
        return dict(zip(names.split(","), map(float, values.split()), strict=False))

    return said


@pytest.mark.sweep
@pytest.mark.parametrize("name", CASES if LONG else ["the sun"])
def test_evalglare_finds_the_same(evalglare: Callable[..., dict[str, float]], name: str) -> None:
    image, azimuth = CASES[name]
    view = eye_view(image, azimuth, VIEW_PX)
    theirs, ours, indices = evalglare(view), glare(image, azimuth), glare(view)
    assert theirs["dgp"] == pytest.approx(ours["dgp"], abs=0.015)
    assert theirs["E_v"] == pytest.approx(ours["ev_lx"], rel=0.01)
    for key, off in {"dgi": 0.35, "ugr": 0.35, "cgi": 0.35, "ugp": 0.015}.items():
        assert indices[key] == pytest.approx(theirs[key], abs=off), (key, theirs)
    assert indices["vcp_pct"] == pytest.approx(theirs["vcp"], abs=1.5)


def test_veiling_luminance_is_what_evalglare_calls_lveil_cie(evalglare: Callable[..., dict[str, float]]) -> None:
    """It takes for a source's direction its mean pixel, cut off to whole ones; near the sight that is much of it."""
    for name in CASES if LONG else ["two windows", "below"]:
        view = eye_view(*CASES[name], VIEW_PX)
        theirs, ours = evalglare(view), glare(view)["lveil_cd_m2"]
        assert ours == pytest.approx(theirs["Lveil_cie"], rel=0.15 if name == "one window" else 0.055), name
        # Poynter's, 5 E / angle, is another.
        assert theirs["Lveil"] > 5 * ours


@pytest.mark.sweep
@pytest.mark.parametrize("name", TASKS if LONG else list(TASKS)[:1])
def test_evalglare_finds_the_same_with_a_task(evalglare: Callable[..., dict[str, float]], name: str) -> None:
    """What is between 5 times the zone's luminance and 2000 cd/m2 glares with the task, and does not without.

    The dimmer of the two would not with a zone as far above the line of sight.
    """
    view = eye_view(room([(25, 15, 12, 10, 1500), (-60, 5, 10, 10, 420)], rows=256), 0.0, VIEW_PX)
    right, up, across = TASKS[name]
    towards = np.array([math.sin(math.radians(right)) * math.cos(math.radians(up)), math.sin(math.radians(up))])
    off = math.degrees(math.acos(math.cos(math.radians(right)) * math.cos(math.radians(up))))
    column, row = VIEW_PX / 2 + towards / np.hypot(*towards) * off / 90 * VIEW_PX / 2
    theirs = evalglare(view, "-T", f"{column:.0f}", f"{row:.0f}", f"{math.radians(across):.6f}")
    ours = glare(view, task=TASKS[name])
    assert ours["dgp"] == pytest.approx(theirs["dgp"], abs=0.003)
    assert ours["ugr"] == pytest.approx(theirs["ugr"], abs=0.35)
    assert ours["sources"] == 2
    assert glare(view, task=(right, -up, across))["sources"] == 1
    assert ours["dgp"] > glare(view)["dgp"] + 0.02
