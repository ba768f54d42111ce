"""The kernel of stray light from a lamp seen and hidden, by lenses whose halo is in no family of the kernel's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from processing.calibration.scale.lamp_glare import kernel_from_lamps
from processing.calibration.scale.veiling_glare import kernel_modes, without_glare
from processing.errors import LensError, ParameterError
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import relative_error, widened
from processing.sphere import Equirectangular

HEIGHT = 96
PANORAMA = Equirectangular(2 * HEIGHT, HEIGHT)


def rays() -> np.ndarray:
    latitude = (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT) * math.pi
    longitude = ((np.arange(2 * HEIGHT) + 0.5) / (2 * HEIGHT) - 0.5) * 2 * math.pi
    flat = np.cos(latitude)[:, None]
    parts = np.broadcast_arrays(flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude)[:, None])
    return np.stack(parts, axis=-1)


def scattered(light: np.ndarray, *, near: float = 0.006, even: float = 0.004, lenses: int = 2) -> np.ndarray:
    """Return light (H, W) through lenses that scatter exponentially over 20 degrees, and evenly within each."""
    ways = rays().reshape(-1, 3)
    area = np.repeat(np.cos((0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT) * math.pi), 2 * HEIGHT)
    area *= 4 * math.pi / area.sum()
    flat = light.ravel().astype(float)
    bright = flat > 20 * np.median(flat)
    # What is not bright scatters onto its like: as much is gained as lost.
    out = (1 - even) * flat - near * flat * bright
    for mine in [ways[:, 1] > 0, ways[:, 1] <= 0] if lenses == 2 else [np.ones(len(ways), bool)]:
        halo = np.zeros(flat.size)
        for k in np.flatnonzero(bright & mine):
            shape = np.exp(-np.arccos(np.clip(ways @ ways[k], -1, 1)) / 0.35) / 0.769
            halo += flat[k] * area[k] * shape
        total = (flat * area)[mine].sum() / area[mine].sum()
        out[mine] += near * halo[mine] + even * total
    return out.reshape(light.shape)


def picture(light: np.ndarray) -> RelativeImage:
    rgb = np.repeat(light[..., None], 3, axis=2).astype(np.float32)
    return RelativeImage(rgb, np.full(light.shape, 0.01, np.float32), np.zeros(light.shape, np.uint8), PANORAMA)


def room(level: float = 1.0, seed: int = 1) -> np.ndarray:
    return level * np.exp(np.random.default_rng(seed).normal(0, 0.3, (HEIGHT, 2 * HEIGHT)))


def lamp_pair(longitude_deg: float = 10.0, lenses: int = 2, light: float = 3e5) -> tuple[RelativeImage, RelativeImage]:
    """The lamp seen, and hidden by a card that is dark; its light on the room is in both."""
    column = round((longitude_deg / 360 + 0.5) * 2 * HEIGHT)
    bare, hidden = room(), room()
    bare[46:49, column : column + 3] += light
    hidden[42:53, column - 4 : column + 7] = 0.2
    return picture(scattered(bare, lenses=lenses)), picture(scattered(hidden, lenses=lenses))


@pytest.fixture(scope="module")
def kernel():
    return kernel_from_lamps([lamp_pair(10.0), lamp_pair(-50.0), lamp_pair(170.0)], two_lenses=True)


def test_the_index_is_that_of_the_lens(kernel) -> None:
    assert kernel.index == pytest.approx(0.01, rel=0.25)
    assert kernel.two_lenses
    assert kernel.hidden == (0.0,) * 4
    assert np.shape(kernel.covariance) == (4, 4)


def test_a_room_with_a_window_loses_its_glare(kernel) -> None:
    truth = room(20.0, seed=3)
    truth[30:50, 80:100] = 6000.0
    truth[60:70, 110:130] = 3.0
    seen = picture(scattered(truth))
    clean = without_glare(seen, kernel)
    ways = rays()
    front = ways[..., 1] > 0
    beside = front & (truth < 1000)
    before, after = (
        np.median(np.abs(luminance_cd_m2(image.rgb)[beside] / truth[beside] - 1)) for image in (seen, clean)
    )
    assert after < 0.25 * before
    dark = np.zeros_like(front)
    dark[61:69, 111:129] = True
    assert luminance_cd_m2(clean.rgb)[dark].mean() == pytest.approx(3.0, rel=0.35)
    assert luminance_cd_m2(seen.rgb)[dark].mean() > 1.5 * 3.0
    # What is left is within what is said to be left.
    measured = LuminanceImage(clean.rgb, clean.uncertainty, clean.validity, PANORAMA, 0.01)
    measured = widened(measured, kernel_modes(measured, kernel))
    off = np.abs(luminance_cd_m2(clean.rgb) / truth - 1)
    assert np.mean((off < 1.96 * np.hypot(measured.uncertainty, 0.01))[beside]) > 0.9
    # The lens behind has none of the window's light.
    assert np.median(np.abs(luminance_cd_m2(clean.rgb)[~front] / truth[~front] - 1)) < 0.02


def test_a_lens_without_stray_light_has_a_kernel_near_nothing() -> None:
    bare, hidden = room(), room()
    bare[46:49, 100:103] += 3e5
    hidden[42:53, 96:107] = 0.2
    found = kernel_from_lamps([(picture(bare), picture(hidden))], two_lenses=False)
    assert found.index < 0.0005


def test_one_lens_scatters_over_the_whole() -> None:
    found = kernel_from_lamps([lamp_pair(10.0, lenses=1), lamp_pair(120.0, lenses=1)], two_lenses=False)
    assert not found.two_lenses
    assert found.index == pytest.approx(0.01, rel=0.25)


def test_a_clipped_lamp_is_refused() -> None:
    """What clipping hides of it may be many times what is seen, and so would stray light be."""
    bare, hidden = lamp_pair()
    for most in (2e4, 20.0):
        clipped = luminance_cd_m2(bare.rgb) > most
        bare.rgb[clipped] = most
        bare.validity[clipped] = Validity.CLIPPED
        with pytest.raises(LensError, match="lamp is clipped in every frame"):
            kernel_from_lamps([(bare, hidden)], two_lenses=True)


def test_clipped_windows_widen_what_a_measured_kernel_leaves(kernel) -> None:
    truth = room(20.0)
    truth[30:50, 80:100] = 3000.0
    image = LuminanceImage(
        *(getattr(picture(truth), name) for name in ("rgb", "uncertainty", "validity")), PANORAMA, 0.01
    )
    whole = widened(image, kernel_modes(image, kernel))
    cut = replace(image, validity=np.where(truth > 1000, Validity.CLIPPED, Validity.VALID).astype(np.uint8))
    more, less = (
        np.median(np.square(one.uncertainty)) - 1e-4 for one in (widened(cut, kernel_modes(cut, kernel)), whole)
    )
    assert more > 3 * less


def test_what_a_measured_kernel_leaves_is_in_the_scale_where_that_was_measured(kernel) -> None:
    """It was the mean over the picture's cells: of a spot beside a window far too little, of one far away too much."""
    truth = room(20.0)
    truth[30:50, 80:100] = 3000.0
    image = LuminanceImage(
        *(getattr(picture(truth), name) for name in ("rgb", "uncertainty", "validity")), PANORAMA, 0.01
    )
    height, width = truth.shape
    for row, column in ((40, 104), (40, 10)):
        place = ((column + 0.5) / width * 2 * np.pi - np.pi, np.pi / 2 - (row + 0.5) / height * np.pi)
        left, whole = (
            np.linalg.norm([relative_error(mode, image, truth)[row, column] for mode in modes])
            for modes in (kernel_modes(image, kernel, (float(truth[row, column]), *place)), kernel_modes(image, kernel))
        )
        assert left < 0.5 * whole


def test_no_lamp_and_other_light_are_refused() -> None:
    bare, hidden = lamp_pair()
    with pytest.raises(LensError, match="the same lamps"):
        kernel_from_lamps([(hidden, hidden)], two_lenses=True)
    brighter = replace(hidden, rgb=hidden.rgb * np.float32(0.7))
    with pytest.raises(LensError, match="light changed by"):
        kernel_from_lamps([(bare, brighter)], two_lenses=True)
    everywhere = replace(hidden, validity=np.full_like(bare.validity, Validity.CLIPPED))
    with pytest.raises(LensError, match="clipped nearly everywhere"):
        kernel_from_lamps([(bare, everywhere)], two_lenses=True)
    with pytest.raises(ParameterError, match="differ in camera"):
        kernel_from_lamps([(bare, replace(hidden, geometry=Equirectangular(4, 2)))], two_lenses=True)
