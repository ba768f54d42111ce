"""Accuracy that is held: both halves of real brackets, and hostile worlds, at a small size, each with its threshold.

Figures at full size are in docs/measurements/merge.md; thresholds lie a bit below them, and below those of this size.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import daylit
from benchmarks.hostile import dorf, film, hostile, odd_even
from benchmarks.hostile.rigs import hostile_bodies, rig_errors
from benchmarks.hostile.worlds import ENCODERS, HostileCamera, HostileWorld, hostile_bracket, hostile_worlds
from benchmarks.seeds import seeds
from processing.calibration.response import response
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from tests.conftest import LONG

needs_curves = pytest.mark.shared("curves", *hostile.SCENES)
SIZE = (256, 128)
SEED = 800_001
MAKERS_WORN, MAKERS_JITTER, HALO = 7, 10, 15


@pytest.fixture(scope="module")
def halves() -> dict[str, float]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(odd_even, "LEAST_PX", 400)
        return odd_even.odd_even_figures(hostile.SMOOTH, hostile.TEXTURED)


@pytest.mark.shared(*(f"brackets/{folder}" for folder, _ in odd_even.BRACKETS.values()))
@pytest.mark.parametrize(
    ("key", "least_pct"),
    [("canon", 98.5), ("canon_textured", 98), ("room", 98.5), ("room_smooth", 99), ("room_textured", 94)],
)
def test_odd_and_even_frames_of_real_brackets_agree_as_they_state(
    halves: dict[str, float], key: str, least_pct: float
) -> None:
    assert halves[f"odd_even_{key}_cover95_pct"] >= least_pct


@needs_curves
@pytest.mark.sweep
@pytest.mark.parametrize("number", [MAKERS_WORN, MAKERS_JITTER] if LONG else [MAKERS_WORN])
def test_hostile_worlds_lie_within_their_intervals(number: int) -> None:
    world = hostile_worlds(hostile.published_cameras(), SEED)[number]
    score = hostile.scored(world, hostile.scene_of(hostile.SCENES[0], SIZE), SEED + 1000 * number)
    assert not score.refused
    assert score.cover >= 0.88
    assert score.smooth >= 0.88
    assert score.textured >= 0.92
    assert score.lux
    assert all(score.lux)
    assert score.ghost is not None
    assert score.ghost <= 0.003
    assert score.median < score.rival
    # Its lens has no fault, so that the light that it draws is the truth; knowing that narrows the intervals.
    assert (score.drawn, score.drawn_rival, score.drawn_err) == (score.median, score.rival, 0)
    assert score.cover68 < score.lens_known < score.cover


@needs_curves
@pytest.mark.long
def test_of_a_lens_with_a_halo_the_merge_is_closer_than_opencv_to_the_light_that_it_draws() -> None:
    """What of it is halo no frame shows: a perfect merge has nearly all of our error against the light itself."""
    world = hostile_worlds(hostile.published_cameras(), SEED)[HALO]
    score = hostile.scored(world, hostile.scene_of(hostile.SCENES[1], SIZE), SEED + 1000 * HALO + 1)
    assert score.drawn < score.drawn_rival
    assert score.drawn < 0.3 * score.drawn_err
    assert score.median < 1.2 * score.drawn_err


def in_this_process(*asked: object) -> None:
    assert daylit.main([*map(str, asked), "--json"]) in (0, None)


@needs_curves
@pytest.mark.long
def test_hard_films_are_merged_by_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its commands in this process, which has imported what they need."""
    monkeypatch.setattr(film, "_daylit", in_this_process)
    found = film.film_figures(hostile.published_cameras(), hostile.scene_of(hostile.SCENES[0], SIZE), SEED)
    assert found["film_cover95_pct"] >= 95
    assert found["film_err_stops"] < 0.1


@needs_curves
@pytest.mark.long
def test_published_curves_are_recovered_from_lossless_frames_and_from_jpeg(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dorf, "MOST", 4)
    monkeypatch.setattr(dorf, "SIZE", (420, 210))
    found = dorf.dorf_figures(0, quick=True)
    assert found["dorf_median_stops"] < 0.02
    assert found["dorf_jpeg_median_stops"] < 0.04
    assert found["dorf_cover2_pct"] > 85


@needs_curves
@pytest.mark.parametrize(
    ("film", "scene", "held", "off_stops"),
    [pytest.param(20, 1, False, 0.1, marks=pytest.mark.long), (28, 0, False, 0.3), (28, 0, True, 0.5)],
)
def test_hard_films_state_what_few_codes_leave_open_of_their_curves(
    monkeypatch: pytest.MonkeyPatch, film: int, scene: int, held: bool, off_stops: float
) -> None:
    """They were taken for cameras that mix their channels: 0.22 and 0.18 stop off. Where channels are ``held`` to one,
    63 % of the second's codes were within two standard deviations, for that one's own doubt was not theirs."""
    if held:
        monkeypatch.setattr(response, "clip_together", lambda samples, fit: True)
    irradiance, shown = hostile.published_cameras()
    seed = 811_111 + 1000 * film + scene
    camera = HostileCamera(irradiance, shown[film], seed=811_111 + film, jpeg=ENCODERS[film % len(ENCODERS)])
    light = hostile.scene_of(hostile.SCENES[scene], (384, 192))
    bracket = hostile_bracket(HostileWorld("film", camera), light, 5.0, seed)
    curve = recover_response([Bracket8(bracket.frames, bracket.nominal_s)], estimate_times=True).curve
    codes = np.arange(5, 251)
    rising = shown[film] + 1e-9 * np.arange(len(irradiance))
    truth = np.log2([np.interp(np.append(codes, 128) / 255, one, irradiance) for one in rising])
    off = curve.log2_exposure[:, codes] - curve.log2_exposure[:, [128]] - truth[:, :-1] + truth[:, [-1]]
    assert curve.clip_together is held
    assert (np.abs(off) < 2 * curve.sigma_log2[:, codes]).mean() > 0.85
    assert np.sqrt(np.mean(np.square(off))) < off_stops


@needs_curves
@pytest.mark.sweep
@pytest.mark.skipif(not LONG, reason="20 s of CPU time: with DAYLIT_TORTURE=1, or make torture")
def test_a_rig_of_hostile_cameras_is_calibrated(tmp_path: Path) -> None:
    """Measured at this seed: k1 0.4, k2 2.9 % (1.6 sigmas), indoor luminance 2.2 %, sky's median 6.2 %.

    Of the sky 1.9 % when k2 was 4.7 % off (3.9 of its sigmas) and blue 15 %: errors of opposite sign. Why the rest is
    left was not traced.
    """
    seed = seeds("validation", 3)[2]
    found = rig_errors(tmp_path, hostile_bodies(hostile.published_cameras(), seed), hostile.RIG_DIVISOR, seed)
    assert found["k1_err_pct"] < 3
    assert found["k2_err_pct"] < 5
    assert found["k2_sigmas"] < 2
    assert found["indoor_median_err_pct"] < 3
    assert found["indoor_p95_err_pct"] < 9
    assert found["sky_median_err_pct"] < 8


def test_each_figure_of_the_worlds_is_given_as_worst_and_median() -> None:
    def one(name: str, **values: Any) -> hostile.Score:
        return hostile.Score(name, **values)

    groups = [
        [one("a", smooth=0.9, textured=0.8), one("a", smooth=0.8, textured=0.6)],
        [one("b", smooth=0.99, textured=0.95)],
        [one("c", smooth=1.0, textured=float("nan"))],
        [one("d", smooth=0.1, textured=0.1, refused="no curve")],
    ]
    found = hostile.by_contrast(groups)
    assert found["smooth_worst_cover95_pct"] == pytest.approx(85)
    assert found["smooth_median_cover95_pct"] == pytest.approx(99)
    assert found["textured_worst_cover95_pct"] == pytest.approx(70)
    assert np.isclose(found["textured_median_cover95_pct"], 82.5)
