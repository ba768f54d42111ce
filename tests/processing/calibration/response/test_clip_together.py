"""Cameras whose colour matrix comes after saturation: a channel's codes mislead where another channel is clipped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hostile.worlds import (
    ENCODERS,
    MATRIX_5D2,
    TIMES_S,
    HostileBracket,
    HostileCamera,
    HostileWorld,
    hostile_bracket,
)
from processing.calibration.merge.merge import MergeOptions, merge
from processing.calibration.response import response
from processing.calibration.response.curve import ResponseCurve
from processing.calibration.response.response import ResponseFit, recover_response
from processing.calibration.response.samples import Bracket8
from processing.pictures.frames import array_frame
from processing.sphere import Equirectangular

WIDTH, HEIGHT = 256, 128


def sky_and_walls() -> np.ndarray:
    """Blue above, grey below, both from 1 to 20,000 across (H, W, 3)."""
    level = np.geomspace(1, 20_000, WIDTH)[None, :, None]
    tint = np.where(np.arange(HEIGHT)[:, None, None] < HEIGHT // 2, (0.55, 0.8, 1.6), (1.0, 1.0, 1.0))
    return np.asarray(level * tint, dtype=np.float32)


def taken(*, matrix: bool) -> tuple[HostileBracket, ResponseFit]:
    codes = np.linspace(0, 1, 256)
    camera = HostileCamera(
        codes, np.stack([codes ** (1 / g) for g in (2.0, 2.2, 2.3)]), matrix=MATRIX_5D2 if matrix else None, seed=3
    )
    bracket = hostile_bracket(HostileWorld("sky", camera), sky_and_walls(), 20.0, 800_003)
    return bracket, recover_response([Bracket8(bracket.frames, bracket.nominal_s)])


def red_off(bracket: HostileBracket, fit: ResponseFit, curve: ResponseCurve) -> np.ndarray:
    """Return by how many stops red is off where pixels are valid, free of its median."""
    frames = [array_frame(frame, f"frame {k}") for k, frame in enumerate(bracket.frames)]
    options = MergeOptions(own_curve=True, ghosts=False, allow_contradiction=True)
    image = merge(frames, TIMES_S, curve, fit.noise, geometry=Equirectangular(WIDTH, HEIGHT), options=options).image
    off = np.log2(image.rgb[..., 0] / bracket.radiance[..., 0])[image.validity == 0]
    return np.abs(off - np.median(off))


@pytest.mark.long
def test_a_colour_matrix_is_noticed_and_what_is_clipped_with_others_is_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bracket, fit = taken(matrix=True)
    assert fit.curve.clip_together
    off = red_off(bracket, fit, fit.curve)
    assert np.quantile(off, 0.95) < 0.8 * np.quantile(
        red_off(bracket, fit, replace(fit.curve, clip_together=False)), 0.95
    )
    monkeypatch.setattr(response, "clip_together", lambda samples, fit: False)
    _, mixed = taken(matrix=True)
    assert np.median(off) < 0.5 * np.median(red_off(bracket, mixed, mixed.curve))


def test_a_camera_without_one_keeps_all_its_samples() -> None:
    bracket, fit = taken(matrix=False)
    assert not fit.curve.clip_together
    assert np.median(red_off(bracket, fit, fit.curve)) < 0.01


def test_a_channel_that_warm_light_shows_only_beside_clipped_ones_is_held_to_the_others() -> None:
    """Where all samples count, blue's upper codes are 0.9 stop off, with 0.02 stated."""
    codes = np.linspace(0, 1, 256)
    camera = HostileCamera(
        codes, np.stack([codes ** (1 / g) for g in (2.0, 2.2, 2.3)]), matrix=MATRIX_5D2, jpeg=ENCODERS[0], seed=3
    )
    level = np.geomspace(1, 20_000, WIDTH)[None, :, None] * np.linspace(1, 0.3, HEIGHT)[:, None, None]
    warm = np.asarray(level * (1.9, 0.85, 0.17), dtype=np.float32)
    bracket = hostile_bracket(HostileWorld("warm", camera), warm, 20.0, 800_003)
    curve = recover_response([Bracket8(bracket.frames, bracket.nominal_s)]).curve
    seen = np.arange(32, 241)
    off = curve.log2_exposure[:, seen] - np.array([2.0, 2.2, 2.3])[:, None] * np.log2(seen / 255)
    off -= off[:, 128 - 32, None]
    assert curve.clip_together
    assert np.abs(off).max() < 0.4
    assert (np.abs(off) < 2 * curve.sigma_log2[:, seen] + 0.02).mean() > 0.95
    assert curve.sigma_log2[2, 224] > 3 * curve.sigma_log2[0, 224]
    assert min(curve.high) > 235
