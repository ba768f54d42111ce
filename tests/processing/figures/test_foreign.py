"""Pictures and calibration files of other programs, and glare indices with their uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import BracketError, ParameterError, PictureFileError
from processing.figures.foreign import (
    _TURNS,
    Taken,
    by_reading,
    light_figures,
    merged_bracket,
    read_rsp,
    view_geometry,
)
from processing.figures.glare import glare_indices
from processing.ground.colour import srgb_of_linear
from processing.pictures.images import LuminanceImage
from processing.pictures.modes import SharedMode, modes_of, widened
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions
from tests.conftest import LONG

AXIS = (0.0, 0.0, 1.0)


def eye(level: float = 500.0, size: int = 200) -> LuminanceImage:
    geometry = Fisheye(size, size, LensMapping.EQUIDISTANT, size / 2)
    _, seen = directions(geometry)
    rgb = np.where(seen[..., None], level, 0).astype(np.float32) * np.ones(3, np.float32)
    validity = np.where(seen, 0, 3).astype(np.uint8)
    return LuminanceImage(rgb, np.full((size, size), 0.05, np.float32), validity, geometry, 0.02)


@pytest.mark.parametrize(
    "text", ["", "ro=ri(1);", "1 2 3", "3 0.9 0.05 0.001\n" * 3, "2 -1 -1 -1\n" * 3, "2 0 0 1\n" * 3, "2 nan 0 0\n" * 3]
)
def test_what_is_no_response_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x.rsp"
    path.write_text(text)
    with pytest.raises(PictureFileError):
        read_rsp(path)


def test_a_response_polynomial_is_read(tmp_path: Path) -> None:
    path = tmp_path / "camera.rsp"
    path.write_text("2 0.9 0.05 0.001\n2 0.9 0.05 0.001\n2 0.9 0.05 0.001\n")
    found = read_rsp(path)
    assert found[:, 255] == pytest.approx(0)
    assert np.all(np.diff(found, axis=1) > 0)


def test_views_are_checked() -> None:
    assert isinstance(view_geometry("panorama", 64, 32), Equirectangular)
    found = view_geometry("fisheye,equisolid,180", 64, 64)
    assert isinstance(found, Fisheye)
    assert found.half_field_rad == pytest.approx(math.pi / 2)
    for wrong in (
        "fisheye",
        "fisheye,round,180",
        "fisheye,equisolid,x",
        "eye,equisolid,180",
        "fisheye,equisolid,180,2",
        "fisheye,equisolid,400",
        "fisheye,orthographic,200",
        "fisheye,equidistant,nan",
        "fisheye,polynomial,180",
    ):
        with pytest.raises(ParameterError, match="--view"):
            view_geometry(wrong, 64, 64)


def finer(codes: np.ndarray) -> np.ndarray:
    """Return 16-bit codes that round to these."""
    off = np.random.default_rng(6).integers(-100, 101, codes.shape)
    return np.clip(codes.astype(int) * 257 + off, 0, 65535).astype(np.uint16)


@pytest.mark.parametrize("deep", [False, True], ids=["8 bits", "16 bits"])
def test_a_bracket_without_a_response_is_scaled_by_its_speed(tmp_path: Path, deep: bool) -> None:
    rng = np.random.default_rng(5)
    image, inside = eye(1.0, 240), directions(eye(1.0, 240).geometry)[1]
    light = np.repeat(np.repeat(2 ** rng.uniform(0, 9, (20, 20)), 12, axis=0), 12, axis=1) * inside
    taken = []
    for k in range(7):
        time_s, path = 4.0**-k, tmp_path / f"{k}.png"
        shown = srgb_of_linear(np.minimum(light * time_s * 100 / (120 * 5.6**2), 1)[..., None].repeat(3, axis=2))
        codes = np.pad(shown, ((4, 4), (60, 60), (0, 0)))
        assert cv2.imwrite(str(path), finer(codes) if deep else codes)
        taken.append(Taken(path, time_s, 5.6, 100, ""))
    found = merged_bracket(taken, None, "equidistant", 180.0)
    truth = replace(image, rgb=light[..., None].repeat(3, axis=2).astype(np.float32))
    assert illuminance_lx(found, AXIS).value_lx == pytest.approx(illuminance_lx(truth, AXIS).value_lx, rel=0.03)
    assert illuminance_lx(found, AXIS).uncertainty_lx == pytest.approx(
        0.13 * illuminance_lx(found, AXIS).value_lx, rel=0.2
    )


def test_a_frame_of_another_view_is_named(tmp_path: Path) -> None:
    rng, taken = np.random.default_rng(5), []
    scenes = [np.repeat(np.repeat(2 ** rng.uniform(0, 4, (12, 20)), 12, axis=0), 12, axis=1) for _ in range(2)]
    for k in range(5):
        shown = srgb_of_linear(np.minimum(scenes[k == 2] * 2.0 ** (-k - 2), 1)[..., None].repeat(3, axis=2))
        path = tmp_path / f"{9 - k}.png"
        assert cv2.imwrite(str(path), shown)
        taken.insert(0, Taken(path, 2.0**-k, 5.6, 100, ""))
    with pytest.raises(BracketError, match=r"^7\.png: another view"):
        merged_bracket(taken, None, "equidistant", 180.0)


def test_a_reading_sets_the_scale() -> None:
    found = by_reading(eye(5.0), 800.0, (100, 100), 0.02)
    light = light_figures(found)
    assert light["illuminance_lx"]["value"] == pytest.approx(800 * math.pi, rel=0.01)
    assert light["illuminance_lx"]["uncertainty"] == pytest.approx(0.02 * 800 * math.pi, rel=0.05)


def test_indices_of_one_source_follow_their_formulas() -> None:
    image = eye(500.0)
    rgb = image.rgb.copy()
    rgb[40:60, 95:105] = 20_000
    (found,) = glare_indices(replace(image, rgb=rgb))
    assert found["sources"]["value"] == 1
    assert 10 < found["ugr"]["value"] < 40
    # A scale of 2 % more adds 8 log10(1.02) to UGR.
    assert found["ugr"]["uncertainty"] == pytest.approx(8 * math.log10(1.02), rel=0.1)
    assert glare_indices(image)[0]["ugr"]["value"] == 0


def test_the_task_sets_the_threshold_and_must_be_seen() -> None:
    image = eye(100.0)
    rgb = image.rgb.copy()
    rgb[40:60, 95:105] = 900
    bright = replace(image, rgb=rgb)
    assert glare_indices(bright)[0]["sources"]["value"] == 0
    assert glare_indices(bright, task=(0.0, -20.0, 30.0))[0]["sources"]["value"] == 1
    with pytest.raises(ParameterError):
        glare_indices(bright, task=(180.0, 0.0, 10.0))


def test_shared_errors_do_not_average_out() -> None:
    image = eye(100.0)
    whole = SharedMode("all", "level", (-10.0, 20.0), (0.03, 0.03))
    both = widened(image, [whole])
    assert modes_of(both) == (whole,)
    assert illuminance_lx(both).shared_lx == pytest.approx(0.03 * 100 * math.pi, rel=0.02)
    rim = SharedMode("rim", "axis", (0.0, 1.0), (0.0, 0.06))
    # Of the light of a uniform hemisphere on its plane, the mean of the sine is 2/3.
    assert illuminance_lx(widened(image, [rim])).shared_lx == pytest.approx(0.04 * 100 * math.pi, rel=0.02)
    assert float(both.uncertainty[100, 100]) == pytest.approx(math.hypot(0.05, 0.03), rel=1e-3)
    anchored = whole.moved(1.0, anchor=5.0)
    assert np.allclose(anchored.values, 0)


@pytest.mark.sweep
@pytest.mark.parametrize(("orientation", "quarters"), [(6, 3), (3, 2), (8, 1)] if LONG else [(6, 3)])
def test_a_bracket_is_turned_as_its_first_frame_says(tmp_path: Path, orientation: int, quarters: int) -> None:
    """A camera held upright: without the turn, what is above would lie beside."""
    rng, inside = np.random.default_rng(5), directions(eye(1.0, 240).geometry)[1]
    light = np.repeat(np.repeat(2 ** rng.uniform(0, 9, (20, 20)), 12, axis=0), 12, axis=1) * inside
    found = []
    for name, turned in (("upright", 0), ("turned", quarters)):
        taken = []
        for k in range(7):
            time_s, path = 4.0**-k, tmp_path / f"{name}{k}.png"
            shown = srgb_of_linear(np.minimum(light * time_s * 100 / (120 * 5.6**2), 1)[..., None].repeat(3, axis=2))
            assert cv2.imwrite(str(path), np.rot90(np.pad(shown, ((4, 4), (60, 60), (0, 0))), -turned))
            taken.append(Taken(path, time_s, 5.6, 100, "", turned))
        found.append(merged_bracket(taken, None, "equidistant", 180.0))
    assert _TURNS[orientation] == quarters
    assert found[0].rgb.shape == found[1].rgb.shape
    both = (found[0].validity == 0) & (found[1].validity == 0)
    assert np.median(np.abs(found[1].rgb / np.maximum(found[0].rgb, 1e-9) - 1)[both]) < 0.02
