"""Figures' uncertainties: both parts, by simulation, and what is said of bounds and of what is not known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from processing.calibration.scale import photometry
from processing.figures import glare
from processing.figures.figures import camera_figures, level_ratio, surface_figures
from processing.figures.foreign import light_figures, region_figures
from processing.figures.glare import glare_indices
from processing.figures.uncertainty import doubt_of
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from processing.pictures.modes import SharedMode, relative_error, widened
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions
from processing.sphere.area import projected_bands
from tests.conftest import LONG
from tests.processing.figures.test_glare import room

ROWS, DRAWS, SCALE = 40, 100, 0.02
MODES = (
    SharedMode("curve", "level", (0.0, 8.0, 14.0), (0.03, -0.01, 0.04)),
    SharedMode("light that changed", "whole", (0.0,), (0.02,)),
    SharedMode("stitching", "seam", (-1.0, 1.0), (-0.02, 0.02)),
)
SIZES = {"both": (1.0, 0.06), "pixels' noise": (0.0, 0.12)}
"""Of the modes and the scale, and of a pixel's own relative standard uncertainty."""
Figures = dict[str, dict[str, float]]


@pytest.fixture(scope="module", autouse=True)
def _geometry_once() -> Iterator[None]:
    """What cells weigh, and which bright pixels lie together, is the same in all draws: nine tenths of their time."""
    bands = cache(lambda geometry, normal: list(projected_bands(geometry, normal)))
    angles, groups, real = cache(glare.projected_solid_angles), dict[bytes, np.ndarray](), glare.linked

    def linked(rays: np.ndarray, reach_rad: float) -> np.ndarray:
        key = rays.tobytes() + str(reach_rad).encode()
        if key not in groups:
            groups[key] = real(rays, reach_rad)
        return groups[key]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(photometry, "projected_bands", lambda geometry, normal: bands(geometry, tuple(normal)))
        patched.setattr(glare, "projected_solid_angles", lambda geometry, normal: angles(geometry, tuple(normal)))
        patched.setattr(glare, "linked", linked)
        yield


def scene() -> LuminanceImage:
    image = room([(20, 10, 25, 15, 6000), (-50, 0, 10, 10, 9000)], rows=ROWS)
    slope = 1 + 0.3 * np.sin(np.arange(2 * ROWS) / 7)[None, :, None] * np.cos(np.arange(ROWS) / 5)[:, None, None]
    return replace(image, rgb=(image.rgb * slope).astype(np.float32), uncertainty=np.zeros_like(image.uncertainty))


def drawn(truth: LuminanceImage, sizes: tuple[float, float], rng: np.random.Generator) -> LuminanceImage:
    """Return the scene as a camera with these errors shows it, with what it states of them."""
    shared, own = sizes
    level, gain = luminance_cd_m2(truth.rgb), 1 + shared * SCALE * rng.normal()
    modes = [replace(mode, values=tuple(shared * value for value in mode.values)) for mode in MODES]
    for mode in modes:
        gain = gain * (1 + rng.normal() * relative_error(mode, truth, level))
    noisy = np.maximum(gain * (1 + own * rng.normal(size=level.shape)), 0)
    rgb = (truth.rgb * noisy[..., None]).astype(np.float32)
    stated = np.full(level.shape, own, np.float32)
    return widened(
        replace(truth, rgb=rgb, uncertainty=stated, scale_uncertainty=shared * SCALE), modes if shared else []
    )


def figures_of(image: LuminanceImage) -> Figures:
    (whole,) = surface_figures(image, None)
    found = {name: one for name, one in whole.items() if isinstance(one, dict)}
    one_surface = region_figures(image, [(30, 2, 50, 9)], ["region"])
    return found | light_figures(image) | glare_indices(image, [0.3])[0] | one_surface


@cache
def draws(name: str) -> list[Figures]:
    """Return the figures of pictures of the scene with errors of a size."""
    truth, rng = scene(), np.random.default_rng(20261129)
    return [figures_of(drawn(truth, SIZES[name], rng)) for _ in range(DRAWS)]


def coverage(name: str) -> dict[str, float]:
    """Return in which share of the draws each figure's 95 % interval holds the truth."""
    true, held = figures_of(scene()), dict[str, list[bool]]()
    for figures in draws(name):
        for key, one in figures.items():
            off = abs(one["value"] - true[key]["value"])
            held.setdefault(key, []).append(off <= 1.96 * one["uncertainty"] + 1e-6 * abs(one["value"]))
    return {key: float(np.mean(one)) for key, one in held.items()}


SUMS = ("illuminance-up_lx", "illuminance-ahead_lx", "illuminance-back_lx", "mean", "region-mean_cd_m2", "ev_lx")
INDICES = ("mean_cd_m2", "dgp", "dgi", "ugr", "cgi", "vcp_pct", "ugp", "lveil_cd_m2", "brightest_cd_m2")
RANKED = ("lowest", "p05", "p95", "highest", "region-median_cd_m2", "region-lowest_cd_m2", "region-highest_cd_m2")


@pytest.mark.sweep
@pytest.mark.parametrize("name", SIZES if LONG else ["both"])
def test_intervals_hold_the_truth_in_about_95_of_100(name: str) -> None:
    found = coverage(name)
    # Of 100 draws at 95 %: three standard deviations of a count are 6.5.
    assert {key: found[key] for key in (*SUMS, *INDICES) if found[key] < 0.885} == {}
    assert np.mean([found[key] for key in (*SUMS, *INDICES)]) == pytest.approx(0.95, abs=0.03), found


def test_intervals_of_quantiles_hold_the_truth_where_noise_is_as_cameras_have_it() -> None:
    """Noise of 12 % a pixel would bias medians by more than is stated (docs/reference/light-figures.md)."""
    found = coverage("both")
    assert {key: found[key] for key in RANKED if found[key] < 0.885} == {}


def test_intervals_are_not_too_wide() -> None:
    """By the spread of what is drawn."""
    seen = draws("both")
    for key in (*SUMS, *INDICES):
        spread = float(np.std([one[key]["value"] for one in seen]))
        stated = float(np.mean([one[key]["uncertainty"] for one in seen]))
        assert 0.7 * spread < stated < 1.5 * spread, (key, spread, stated)


def test_the_stage_s_figures_state_the_same() -> None:
    image = drawn(scene(), SIZES["both"], np.random.default_rng(3))
    camera = camera_figures(image, height_m=1.6, heading_rad=None)
    (look,) = glare_indices(image, [math.pi / 4])
    assert camera["directions"][1]["glare"]["dgp"] == look["dgp"]
    assert camera["directions"][1]["vertical"]["uncertainty"] == pytest.approx(look["ev_lx"]["uncertainty"], rel=0.02)
    upright = [one["vertical"] for one in camera["directions"]]
    assert camera["cylindrical"]["value"] == pytest.approx(np.mean([one["value"] for one in upright]))
    assert camera["cylindrical"]["uncertainty"] == pytest.approx(np.mean([one["uncertainty"] for one in upright]))


def test_noise_widens_indices() -> None:
    calm, noisy = (glare_indices(drawn(scene(), (1.0, own), np.random.default_rng(1)))[0] for own in (0.001, 0.9))
    for key in ("dgp", "ugr", "lveil_cd_m2"):
        assert noisy[key]["uncertainty"] > 1.1 * calm[key]["uncertainty"], key


def test_modes_are_placed_in_the_panorama_when_one_looks_aside() -> None:
    """What is stitched wrong ahead brightens who looks ahead and dims who looks back."""
    image = widened(scene(), [replace(MODES[2], values=(-0.1, 0.1))])
    doubt = doubt_of(image, lambda light: np.array([light[:, ROWS // 2 : -ROWS // 2].sum(), light[:, :4].sum()]))
    ahead, back = doubt.shifts[1]
    assert ahead > 0 > back
    pair = glare_indices(image, [0.0, math.pi])
    assert all(one["ev_lx"]["uncertainty"] > 0.03 * one["ev_lx"]["value"] for one in pair)


def test_clipped_parts_are_bounds() -> None:
    image = scene()
    validity = image.validity.copy()
    validity[luminance_cd_m2(image.rgb) > 8000] = Validity.CLIPPED
    (whole,) = surface_figures(replace(image, validity=validity), None)
    bounds = {name: one["bound"] for name, one in whole.items() if isinstance(one, dict)}
    assert bounds == dict.fromkeys(("lowest", "p05", "median", "p95")) | dict.fromkeys(("mean", "highest"), "lower")
    lights = light_figures(replace(image, validity=validity))
    assert lights["illuminance-ahead_lx"]["bound"] == "lower"
    assert lights["illuminance-back_lx"]["bound"] is None


def test_a_ratio_has_the_uncertainty_of_both_and_a_bound_of_one() -> None:
    inside = {"level_up": {"value": 500.0, "uncertainty": 15.0, "bound": None}}
    outside = {"level_up": {"value": 10_000.0, "uncertainty": 400.0, "bound": "lower"}}
    found = level_ratio(inside, outside)
    assert found is not None
    assert found["value"] == pytest.approx(0.05)
    assert found["uncertainty"] == pytest.approx(0.05 * math.hypot(0.03, 0.04))
    assert found["bound"] == "upper"
    for within, without, bound in ((None, None, None), ("lower", None, "lower"), ("lower", "lower", "unknown")):
        ratio = level_ratio(
            *(
                {"level_up": one["level_up"] | {"bound": b}}
                for one, b in zip((inside, outside), (within, without), strict=True)
            )
        )
        assert ratio is not None
        assert ratio["bound"] == bound


def test_means_are_by_solid_angle() -> None:
    """A panorama's poles and a fisheye's rim count as much as they are wide."""
    rays, _ = directions(Equirectangular(128, 64))
    bright = np.where(np.abs(rays[..., 2]) > 0.9, 5000.0, 500.0)
    image = replace(room([], rows=64), rgb=np.repeat(bright[..., None], 3, axis=-1).astype(np.float32))
    assert light_figures(image)["picture-mean_cd_m2"]["value"] == pytest.approx(500 + 0.1 * 4500, rel=0.02)
    lens = Fisheye(100, 100, LensMapping.EQUISOLID, 50)
    towards, seen = directions(lens)
    level = np.where(towards[..., 2] < 0.5, 1000.0, 200.0) * seen
    flat, validity = np.zeros((100, 100), np.float32), np.where(seen, 0, 3).astype(np.uint8)
    eye = LuminanceImage(np.repeat(level[..., None], 3, axis=-1).astype(np.float32), flat, validity, lens, 0.0)
    assert light_figures(eye)["picture-mean_cd_m2"]["value"] == pytest.approx(600, rel=0.02)
    assert light_figures(eye)["picture-median_cd_m2"]["value"] in (200.0, 1000.0)


def test_a_scale_of_unknown_uncertainty_leaves_none_known() -> None:
    image = replace(scene(), scale_uncertainty=math.inf)
    every = light_figures(image) | glare_indices(image)[0]
    assert {one["uncertainty"] for one in every.values()} == {None}
    assert all(math.isfinite(one["value"]) for one in every.values())
