"""Frames that contradict each other: wrong times, wrong curves, things that moved, a tripod that was knocked."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.photometry.synthetic_bracket import REFERENCE_SENSOR, expose, synthetic_bracket
from mocks.optics.sensor import ToneCurve, TrueShutter
from processing.errors import BracketError
from tests.processing.calibration.merge.merge_cases import SIZE, bracket, errors, merged, true_curve

FEW = settings(max_examples=10, deadline=None)


@FEW
@given(place=st.integers(0, 8), stops=st.sampled_from([-2.0, -0.5, 0.4, 1.0]))
def test_a_wrong_time_is_refused_by_name(place: int, stops: float) -> None:
    shot = bracket()
    times = list(shot.true_s)
    times[place] *= 2**stops
    with pytest.raises(BracketError, match="contradict") as raised:
        merged(shot.frames, times)
    assert f"frame {place} is" in str(raised.value)


@FEW
@given(place=st.integers(0, 8), stops=st.sampled_from([-0.15, 0.1, 0.2]))
def test_a_slightly_wrong_time_is_warned_of_and_its_doubt_is_stated(place: int, stops: float) -> None:
    shot = bracket()
    times = list(shot.true_s)
    times[place] *= 2**stops
    result = merged(shot.frames, times)
    assert [w for w in result.report.warnings if w.startswith(f"frame {place} is")]
    assert errors(result, shot.luminance).covered(1.96) > 0.9


def test_a_bracket_is_refused_only_for_what_it_shows_much_of_and_with_its_own_curve_beyond_its_doubt() -> None:
    shot = bracket()
    times = list(shot.true_s)
    times[4] *= 2.0
    with pytest.raises(BracketError, match="contradict"):
        merged(shot.frames, times, own_curve=True)
    sigma = [0.15 if k == 4 else 0.0 for k in range(9)]
    doubted = merged(shot.frames, times, own_curve=True, quality="reference", time_sigma=sigma)
    assert any(w.startswith("frame 4 is") for w in doubted.report.warnings)
    unsure = replace(true_curve(), sigma_log2=np.full((3, 256), 0.3))
    assert merged(shot.frames, times, unsure, own_curve=True, quality="reference").report.warnings
    with pytest.raises(BracketError, match="contradict"):
        merged(shot.frames, times, unsure, quality="reference")
    # All but a small lamp is black in the last frame: what that says of its time may be the lamp's own.
    scene = np.full((180, 360, 3), 20, np.float32) * np.linspace(0.5, 2, 360, dtype=np.float32)[:, None]
    for rows, refused in ((5, False), (40, True)):
        scene[80 : 80 + rows, 100:160] = np.geomspace(5e3, 8e4, 60)[:, None]
        frames = [expose(scene, t, REFERENCE_SENSOR, k) for k, t in enumerate(shot.nominal_s)]
        times = [*shot.true_s[:8], 2 * shot.true_s[8]]
        for own in (True, False):
            if refused:
                with pytest.raises(BracketError, match="frame 8 is"):
                    merged(frames, times, own_curve=own, quality="reference")
            else:
                result = merged(frames, times, own_curve=own, quality="reference")
                assert any(w.startswith("frame 8 is") for w in result.report.warnings)


def test_nominal_times_of_a_camera_that_keeps_others_are_noticed() -> None:
    sensor = replace(REFERENCE_SENSOR, true_shutter=TrueShutter.THIRDS_OF_STOPS)
    shot = synthetic_bracket(SIZE, 900_005, sensor=sensor)
    assert any("a wrong time" in w for w in merged(shot.frames, shot.nominal_s).report.warnings)
    assert merged(shot.frames, shot.true_s).report.warnings == ()


@pytest.mark.parametrize(
    "tone", [ToneCurve(contrast=0.0), ToneCurve(gamma=1.8, contrast=0.35), ToneCurve(contrast=0.9)]
)
def test_another_cameras_curve_is_never_silent(tone: ToneCurve) -> None:
    shot = bracket()
    try:
        result = merged(shot.frames, shot.true_s, true_curve((tone,) * 3))
    except BracketError as error:
        reported = [str(error)]
    else:
        reported = list(result.report.warnings)
    assert any("curve does not fit" in one or "another camera's response curve" in one for one in reported)


def test_frames_of_two_cameras_mixed_up_are_never_silent() -> None:
    shot = bracket()
    other = replace(REFERENCE_SENSOR, tone=(ToneCurve(contrast=0.8),) * 3)
    frames = [expose(shot.radiance, t, other, i) if i % 2 else shot.frames[i] for i, t in enumerate(shot.nominal_s)]
    try:
        result = merged(frames, shot.true_s)
    except BracketError:
        return
    assert result.report.warnings


def moved_scene(share: float, seed: int, blob_px: int) -> tuple[list, np.ndarray, np.ndarray]:
    """Return frames of a scene in which blobs are 8 times brighter or darker in two of the frames that see them."""
    shot = bracket()
    rng = np.random.default_rng(seed)
    mask = np.zeros(shot.luminance.shape, dtype=np.uint8)
    while mask.mean() < share:
        y, x = rng.integers(0, mask.shape[0] - blob_px), rng.integers(0, mask.shape[1] - blob_px)
        mask[y : y + blob_px, x : x + blob_px] = 1
    moved = mask.astype(bool)
    radiance = shot.radiance.copy()
    radiance[moved] *= (
        np.where(rng.random(moved.sum()) < 0.5, 8.0, 0.125).astype(np.float32)[:, None] if blob_px == 1 else 8.0
    )
    frames = [
        expose(radiance, t, REFERENCE_SENSOR, 50 + i) if i % 3 == 1 else shot.frames[i]
        for i, t in enumerate(shot.nominal_s)
    ]
    return frames, moved, radiance


@pytest.mark.parametrize("blob_px", [1, 12])
def test_one_per_cent_moved_is_found_and_shown_by_one_frame(blob_px: int) -> None:
    frames, moved, radiance = moved_scene(0.01, 7, blob_px)
    shot = bracket()
    result = merged(frames, shot.true_s)
    image = result.image
    bright = (shot.luminance > 1) & (shot.luminance < 1e4)
    found = image.ghost > 0
    assert found[moved & bright].mean() > 0.9
    assert found[~moved].mean() < 0.01
    # Either moment is right: each pixel must be one of the two within its uncertainty, never a mixture.
    weights = np.array([0.2127, 0.7151, 0.0722])
    near = np.minimum(
        *(
            np.abs(np.log(image.rgb @ weights * 37.632 / (scene @ weights))) / image.uncertainty
            for scene in (shot.radiance, radiance)
        )
    )
    assert np.mean(near[moved & bright & (image.validity == 0)] < 2.5) > 0.93
    unmoved = errors(result, shot.luminance, ~cv2.dilate(moved.astype(np.uint8), np.ones((9, 9))).astype(bool))
    assert 0.66 <= unmoved.covered(1.0) <= 0.71
    named = set(np.unique(image.ghost)) - {0}
    assert named <= set(range(1, 10))


def test_the_ghost_map_names_frames_as_given() -> None:
    frames, _, _ = moved_scene(0.01, 8, 12)
    shot = bracket()
    plain = merged(frames, shot.true_s).image.ghost
    backwards = merged(frames[::-1], shot.true_s[::-1]).image.ghost
    assert plain.any()
    np.testing.assert_array_equal(np.where(plain > 0, 10 - plain.astype(int), 0), backwards)


def test_a_scene_that_changed_all_over_is_refused() -> None:
    shot, other = bracket(), bracket(900_009)
    frames = [*shot.frames[:4], *other.frames[4:]]
    with pytest.raises(BracketError):
        merged(frames, shot.true_s)


def test_a_knocked_tripod_is_named() -> None:
    rng = np.random.default_rng(3)
    blocks = np.exp2(rng.uniform(6, 11, (40, 80, 3))).astype(np.float32)
    scene = cv2.resize(blocks, (640, 320), interpolation=cv2.INTER_NEAREST)
    times = (1 / 15, 1 / 60, 1 / 250, 1 / 1000)
    still = [expose(scene, t, REFERENCE_SENSOR, i) for i, t in enumerate(times)]
    assert not [w for w in merged(still, times).report.warnings if "shifted" in w]
    knocked = [
        expose(np.roll(scene, (0, 3) if i >= 2 else 0, axis=(0, 1)), t, REFERENCE_SENSOR, i)
        for i, t in enumerate(times)
    ]
    reported = [w for w in merged(knocked, times, allow_contradiction=True).report.warnings if "shifted" in w]
    assert len(reported) == 1
    assert reported[0].startswith("frame 2 is shifted against frame 1 by +3.0 px across")
