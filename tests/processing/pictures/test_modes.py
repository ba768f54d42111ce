"""What all pixels share: stray light by place and the two lenses of one body, from the spot that set the scale."""

from __future__ import annotations

import numpy as np
import pytest

from processing.calibration.scale import veiling_glare
from processing.calibration.scale.glare_fit import VEIL_INDEX
from processing.calibration.scale.photometry import illuminance_lx
from processing.calibration.scale.veiling_glare import UNEVEN, unmeasured_modes
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2
from processing.pictures.modes import (
    SEAM_SIGMA,
    SharedMode,
    colour_mode,
    falloff_mode,
    less_by_sum,
    relative_error,
    seam_mode,
    widened,
)
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions

WIDTH, HEIGHT = 192, 96


def room(lamp: float = 0.0) -> LuminanceImage:
    """Everything 100 cd/m2, but for a lamp of 20 degrees on the left of the middle."""
    rgb = np.full((HEIGHT, WIDTH, 3), 100.0, np.float32)
    rgb[40:52, 30:42] += lamp
    zeros = np.zeros((HEIGHT, WIDTH), np.float32)
    return LuminanceImage(rgb, zeros + 1e-6, zeros.astype(np.uint8), Equirectangular(WIDTH, HEIGHT), 0.0)


def of(image: LuminanceImage, mode: SharedMode) -> np.ndarray:
    return relative_error(mode, image, luminance_cd_m2(image.rgb))


def together(image: LuminanceImage, modes: list[SharedMode]) -> np.ndarray:
    return np.sqrt(np.sum([of(image, mode) ** 2 for mode in modes], axis=0))


def test_stray_light_of_an_even_room_is_as_unsure_everywhere_and_the_scale_has_its_even_part(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    image = room()
    found = together(image, unmeasured_modes(image))
    assert np.ptp(found) < 0.06 * found.mean()
    # What the kernel's wide parts send is not all of it on the sphere; a side may have as much again.
    assert 0.7 * VEIL_INDEX < found.mean() / np.hypot(1, UNEVEN) < VEIL_INDEX
    scaled = together(image, unmeasured_modes(image, (100.0, 0.3, -0.2)))
    row, column = round((0.5 + 0.2 / np.pi) * HEIGHT), round((0.5 + 0.3 / (2 * np.pi)) * WIDTH)
    assert scaled[row, column] < 0.15 * found.mean()
    assert scaled[HEIGHT - row, (column + WIDTH // 2) % WIDTH] > 1.2 * found.mean()
    monkeypatch.setattr(veiling_glare, "UNEVEN", 0.0)
    assert together(image, unmeasured_modes(image, (100.0, 0.3, -0.2))).max() < 0.06 * VEIL_INDEX


def test_stray_light_is_stronger_near_a_lamp_and_weak_against_the_lamp_itself() -> None:
    image = room(lamp=50_000)
    modes = unmeasured_modes(image)
    found = together(image, modes)
    assert found[46, 48] > 3 * found[46, 132]
    assert found[46, 36] < 0.1 * found[46, 48]
    # Rows by themselves are the same.
    part = slice(40, 50)
    luminance = luminance_cd_m2(image.rgb)
    assert np.array_equal(relative_error(modes[0], image, luminance[part], part), of(image, modes[0])[part])
    brighter = LuminanceImage(4 * image.rgb, image.uncertainty, image.validity, image.geometry, 0.0)
    assert together(brighter, [mode.moved(2.0) for mode in modes]) == pytest.approx(found, rel=1e-5)


def test_a_fisheyes_fall_off_goes_by_its_pixels_own_angles_and_bands_of_a_picture_are_widened_alike(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for mapping in LensMapping:
        polynomial = (0.8, 0.0, 0.2) if mapping is LensMapping.POLYNOMIAL else ()
        lens = Fisheye(60, 50, mapping, 24.0, 1.4, centre_px=(31.0, 24.0), top_azimuth_rad=0.7, polynomial=polynomial)
        rgb = np.random.default_rng(0).random((50, 60, 3)).astype(np.float32)
        image = LuminanceImage(rgb, rgb[..., 0] + np.float32(0.1), np.zeros((50, 60), np.uint8), lens, 0.0)
        mode = falloff_mode(0.03)
        rays, _ = directions(lens)
        assert of(image, mode) == pytest.approx(0.03 * np.hypot(rays[..., 0], rays[..., 1]), rel=1e-6)
        whole = np.hypot(image.uncertainty, together(image, [mode, colour_mode(0.1)]))
        monkeypatch.setattr("processing.pictures.modes.ROWS_AT_ONCE", 7)
        assert widened(image, [mode, colour_mode(0.1)]).uncertainty == pytest.approx(whole, rel=1e-6)


def test_the_scale_has_the_stray_light_of_the_place_that_was_measured() -> None:
    image = room(lamp=50_000)
    beside = ((51 / WIDTH - 0.5) * 2 * np.pi, (0.5 - 45 / HEIGHT) * np.pi)  # the middle of a cell
    found, unscaled = (
        together(image, unmeasured_modes(image, (100.0, *beside))),
        together(image, unmeasured_modes(image)),
    )
    assert found[45, 51] < 0.2 * unscaled[45, 51]
    assert found[46, 132] > 2 * unscaled[46, 132]


def test_a_clipped_lamp_may_scatter_more_than_it_shows() -> None:
    image = room(lamp=50_000)
    usual = together(image, unmeasured_modes(image))[46, 132]
    image.validity[40:52, 30:42] = Validity.CLIPPED
    assert together(image, unmeasured_modes(image))[46, 132] > 1.3 * usual


def test_the_lens_that_saw_the_spot_is_sure_and_the_other_is_not() -> None:
    image = room()
    seam = seam_mode(np.pi)
    found = of(image, seam)
    assert np.abs(found[48, 2]) < 1e-6
    assert found[48, WIDTH // 2] == pytest.approx(2 * SEAM_SIGMA, rel=1e-3)
    light = illuminance_lx(widened(image, [seam]))
    assert light.shared_lx / light.value_lx == pytest.approx(SEAM_SIGMA, rel=0.05)


def test_what_a_picture_was_scaled_by_is_known_and_no_mode_moves_it() -> None:
    """A sum over the picture, as a lux meter takes it: each kind of mode then adds nothing to it, and still something
    to single pixels."""
    image = room(lamp=2_000)
    image.rgb[:, ::3, 2] *= 2  # of other colours here and there
    weights = np.random.default_rng(3).random((HEIGHT, WIDTH))
    weights[:, WIDTH // 4 : 3 * WIDTH // 4] *= 2  # more of what is ahead
    weights[: HEIGHT // 2, : WIDTH // 2] *= 2  # and of what is above on the left
    modes = [*unmeasured_modes(image), seam_mode(None), falloff_mode(0.02), falloff_mode(0.02, 1.0)]
    modes += [colour_mode(0.4), SharedMode("curve", "level", (0.0, 8.0, 12.0), (0.01, -0.02, 0.03))]
    modes.append(SharedMode("filter colour", "whole", (0.0,), (0.02,)))
    parts = weights * luminance_cd_m2(image.rgb)
    assert min(abs(np.vdot(parts, of(image, mode))) / parts.sum() for mode in modes) > 2e-5
    for mode in less_by_sum(modes, image, weights):
        assert abs(np.vdot(parts, of(image, mode))) / parts.sum() < 1e-6
        assert (np.abs(of(image, mode)).max() > 1e-3) == (mode.kind != "whole")


def test_a_published_falloff_is_less_sure_towards_the_stitch_and_known_at_the_meters_spot() -> None:
    found = of(room(), falloff_mode(0.01, 1.0))[HEIGHT // 2]
    assert abs(found[WIDTH // 2]) < 1e-3
    assert found[WIDTH // 4] == pytest.approx(0.01, rel=0.01)
    assert abs(found[0]) < 1e-3
    spot = of(room(), falloff_mode(0.01, np.cos(0.5)))[HEIGHT // 2]
    assert abs(spot[round(WIDTH * (0.5 + 0.5 / (2 * np.pi)))]) < 3e-4
