"""Plots: they are pictures, the same numbers give the same bytes, other numbers give others, ends do not break them."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import pytest
from PIL import Image

from processing.errors import ParameterError
from processing.report import plots

CODES = np.arange(256)
CURVE = np.stack([np.log2(((CODES + 0.5) / 255) ** g) for g in (2.0, 2.2, 2.4)])
SIGMA = np.full((3, 256), 0.01)


def test_svg_plots_are_deterministic_and_show_their_numbers() -> None:
    first = plots.response_plot(CURVE, SIGMA, (3, 4, 5), (250, 251, 252))
    assert first.lstrip().startswith(b"<?xml")
    assert b"<svg" in first
    assert plots.response_plot(CURVE, SIGMA, (3, 4, 5), (250, 251, 252)) == first
    assert plots.response_plot(CURVE, 3 * SIGMA, (3, 4, 5), (250, 251, 252)) != first
    assert b"http://www.w3.org" in first
    assert b"<dc:date>" not in first


def test_residuals_with_codes_that_never_occur() -> None:
    residual = np.full((3, 256), 0.02)
    residual[:, :10] = np.nan
    assert b"<svg" in plots.residual_plot(np.arange(256.0), residual)
    assert b"<svg" in plots.residual_plot(np.arange(256.0), np.full((3, 256), np.nan))


def test_frames_that_were_left_out() -> None:
    some = plots.frame_usage_plot(["4 s", "1 s"], [0.3, 0.0], [False, True])
    assert some != plots.frame_usage_plot(["4 s", "1 s"], [0.3, 0.0], [False, False])
    with pytest.raises(ParameterError):
        plots.frame_usage_plot([], [], [])
    with pytest.raises(ParameterError):
        plots.frame_usage_plot(["4 s"], [0.3, 0.1], [False, True])


def size_of(data: bytes) -> tuple[int, int]:
    with Image.open(io.BytesIO(data)) as opened:
        return opened.size


def test_contact_sheet_has_room_for_all() -> None:
    frames = [np.full((20, 40, 3), level, np.uint8) for level in (0, 40, 255, 90)]
    sheet = plots.contact_sheet(frames, ["a", "b", "c", "d"])
    assert size_of(sheet) == (900, 510)
    assert sheet == plots.contact_sheet(frames, ["a", "b", "c", "d"])
    with pytest.raises(ParameterError):
        plots.contact_sheet(frames, ["a"])


@pytest.mark.parametrize("centre", [(0.2, 30.0), (127.9, 63.9), (64.5, 0.0), (60.0, 20.0)])
def test_spot_is_in_the_middle_of_its_circle(centre: tuple[float, float]) -> None:
    """The crop wraps around at the sides; the circle's middle keeps the marked pixel."""
    rgb = np.full((64, 128, 3), 0.2, np.float32)
    rgb[min(63, int(centre[1])), int(centre[0])] = (5.0, 0.0, 0.0)
    shown = np.asarray(Image.open(io.BytesIO(plots.spot_picture(rgb, centre, 1.0, size_px=480)))).astype(int)
    yellow = np.argwhere((shown[..., 0] > 240) & (shown[..., 1] > 200) & (shown[..., 2] < 60))
    red = np.argwhere((shown[..., 0] > 150) & (shown[..., 1] < 90))
    assert yellow.size
    assert red.size
    # A whole ring's middle; one cut by the picture's edge is not found this way.
    if 5 < centre[1] < 59:
        assert np.abs((yellow.min(axis=0) + yellow.max(axis=0)) / 2 - red.mean(axis=0)).max() < 480 / 32


def test_spot_outside_is_refused() -> None:
    for centre, radius in (((-1.0, 5.0), 2.0), ((5.0, 65.0), 2.0), ((5.0, 5.0), 0.0)):
        with pytest.raises(ParameterError):
            plots.spot_picture(np.ones((64, 128, 3), np.float32), centre, radius)


@pytest.mark.parametrize("make", [plots.luminance_picture, plots.uncertainty_map], ids=["luminance", "uncertainty"])
def test_maps_at_their_ends(make: Callable[..., bytes]) -> None:
    wide = np.geomspace(0.001, 1.6e9, 20 * 3000).reshape(20, 3000).astype(np.float32)
    width, height = size_of(make(wide))
    assert (width, height) == (1000 + 110, 80)
    assert size_of(make(np.zeros((4, 8), np.float32)))[1] == 80
    assert make(np.full((4, 8), np.inf, np.float32))


def test_colour_temperature_of_grey_is_that_of_the_white_point_and_black_has_none() -> None:
    import cv2

    rgb = np.full((60, 80, 3), 50.0, np.float32)
    rgb[:30] = 0
    png = cv2.imdecode(np.frombuffer(plots.cct_picture(rgb), np.uint8), cv2.IMREAD_COLOR)
    assert png.shape[1] > 80, "the scale stands beside"
    black, grey = png[5, 40].astype(int), png[50, 40].astype(int)
    assert np.ptp(black) < 20, "no meaningful CCT is grey"
    assert np.ptp(grey) > 60, "D65 has a colour on the scale"
