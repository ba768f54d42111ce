"""k1: right on fields that are known by formula, and refused where the spot determines nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.calibration.scale.luminance import (
    LS160,
    ScaleFactor,
    Spot,
    combined,
    scale_from_reading,
    scaled,
    spot_luminance,
    spot_pixels,
)
from processing.errors import ScaleError
from processing.pictures.images import RelativeImage, Validity
from processing.pictures.modes import SharedMode, modes_of, together, with_modes
from processing.sphere import Equirectangular, Geometry, Perspective, directions
from station.session.session import FrameRecord, ReadingRecord, Side

BEGUN = datetime(2026, 6, 1, tzinfo=UTC)


def image(level: np.ndarray, geometry: Geometry, uncertainty: float = 0.01) -> RelativeImage:
    rgb = np.repeat(np.asarray(level, dtype=np.float32)[..., None], 3, axis=-1)
    known = np.full(level.shape, uncertainty, dtype=np.float32)
    return RelativeImage(rgb, known, np.zeros(level.shape, dtype=np.uint8), geometry)


def uniform(value: float = 2.0, wide: int = 720) -> RelativeImage:
    return image(np.full((wide // 2, wide), value), Equirectangular(wide, wide // 2))


def reading(value: float | None, when: str = "before", at_s: float = 0.0, status: str = "ok") -> ReadingRecord:
    return ReadingRecord(
        when=when,  # type: ignore[arg-type]
        status=status,
        luminance_cd_m2=value,
        taken_utc=BEGUN + timedelta(seconds=at_s),
        taken_monotonic_s=at_s,
        raw="" if value is None else f"{value}",
    )


def frame(at_s: float) -> FrameRecord:
    return FrameRecord(
        side=Side.INDOOR,
        stop=0,
        file="indoor/0.jpg",
        size_bytes=1,
        sha256="0" * 64,
        asked_s=1,
        camera_s=1,
        release_monotonic_s=at_s - 0.5,
    )


def test_monotonic_times_of_two_boots_are_not_mixed() -> None:
    """The computer lost power between two runs: its monotonic time began anew, and UTC alone orders the records."""
    readings = [reading(40.0, "before", 0.0), reading(60.0, "after", 100.0)]
    frames = [
        frame(at_s).model_copy(update={"taken_utc": BEGUN + timedelta(seconds=at_s - 0.5)}) for at_s in (20.0, 30.0)
    ]
    same = scale_from_reading(uniform(2.0), readings, 0.0, 0.0, frames=frames)
    assert same.value == pytest.approx((40 + 20 * 0.25) / 2)
    again = [readings[0], readings[1].model_copy(update={"taken_monotonic_s": -5000.0})]
    assert scale_from_reading(uniform(2.0), again, 0.0, 0.0, frames=frames).value == pytest.approx(same.value)


@settings(max_examples=25, deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(-math.pi / 2, math.pi / 2), st.sampled_from([2, 16, 360]))
def test_a_uniform_field_gives_its_scale_everywhere(longitude: float, latitude: float, wide: int) -> None:
    """Seam, poles, and pixels larger than the spot included."""
    found = scale_from_reading(uniform(2.0, wide), [reading(50.0)], longitude, latitude)
    assert found.value == pytest.approx(25.0 / 1.0, rel=1e-6)
    assert found.parts["spot"] == pytest.approx(0.0, abs=1e-6)
    assert math.isfinite(found.relative_uncertainty)


@pytest.mark.parametrize(("longitude", "latitude"), [(0.3, 0.2), (math.pi, 0.0), (-1.0, 1.4), (0.0, math.pi / 2)])
def test_shares_are_the_covered_solid_angles(longitude: float, latitude: float) -> None:
    """A field linear in a world axis has, over a cap, its middle's value times the cap's mean cosine."""
    geometry = Equirectangular(6720, 3360)
    spot = Spot(longitude, latitude, math.radians(2))
    found = spot_pixels(geometry, spot)
    assert found.share.sum() == pytest.approx(1)
    rows = np.arange(found.row.min(), found.row.max() + 1)
    ways, _ = directions(geometry, slice(int(rows[0]), int(rows[-1]) + 1))
    mean = found.share @ ways[found.row - rows[0], found.column]
    expected = spot.direction() * (1 + math.cos(math.radians(1))) / 2
    np.testing.assert_allclose(mean, expected, atol=3e-6)


def test_half_covered_spot_is_half() -> None:
    level = np.ones((1440, 2880), dtype=np.float32)
    level[:, 1440:] = 3.0
    rgb = image(level, Equirectangular(2880, 1440))
    assert spot_luminance(rgb, Spot(0.0, 0.0)) == pytest.approx(2.0, rel=2e-3)


def test_an_edge_in_the_spot_warns_and_is_uncertain() -> None:
    level = np.ones((1680, 3360), dtype=np.float32)
    level[:, 1680:] = 8.0  # a patch of sun
    found = scale_from_reading(image(level, Equirectangular(3360, 1680)), [reading(50.0)], 0.0, 0.0)
    assert found.parts["spot"] > 0.2
    assert any("patch of sun" in text for text in found.warnings)


def test_two_readings_are_interpolated_to_the_exposures() -> None:
    both = [reading(100.0), reading(110.0, "after", 40.0)]
    found = scale_from_reading(uniform(1.0), both, 0, 0, frames=[frame(5.0), frame(15.0)])
    assert found.measured == pytest.approx(102.5)
    assert found.drift_frac == pytest.approx(0.10)
    assert found.parts["drift"] == pytest.approx(0.10 / math.sqrt(12) / 2)
    assert any("+10.0%" in text for text in found.warnings)
    without = scale_from_reading(uniform(1.0), both, 0, 0)
    assert without.measured == pytest.approx(105.0)
    assert without.parts["drift"] == pytest.approx(0.10 / math.sqrt(12))


@pytest.mark.parametrize("off_s", [-3600.0, -40.0, 41.0, 14 * 86_400.0], ids=str)
def test_a_moment_outside_the_readings_says_nothing_of_the_light_between(off_s: float) -> None:
    """Another clock, or both readings before the bracket: their mean, with all of their difference as doubt."""
    both = [reading(100.0), reading(80.0, "after", 40.0)]
    found = scale_from_reading(uniform(1.0), both, 0, 0, frames=[frame(off_s)])
    assert found.measured == pytest.approx(90.0)
    assert found.parts["drift"] == pytest.approx(0.20 / math.sqrt(12))


def test_readings_typed_at_import_have_no_moments() -> None:
    typed = {"status": "typed", "taken_utc": BEGUN, "detail": "typed at import"}
    pairs = zip(("before", "after"), (100.0, 80.0), strict=True)
    both = [ReadingRecord.model_validate({"when": w, "luminance_cd_m2": v, **typed}) for w, v in pairs]
    taken = [frame(0.0).model_copy(update={"release_monotonic_s": None, "taken_utc": BEGUN - timedelta(days=14)})]
    for frames in (taken, []):
        found = scale_from_reading(uniform(1.0), both, 0, 0, frames=frames)
        assert found.measured == pytest.approx(90.0)
        assert found.parts["drift"] == pytest.approx(0.20 / math.sqrt(12))


def test_only_usable_readings_count() -> None:
    bad = [reading(None, status="over_range"), reading(60.0, "after", 40.0, "typed")]
    found = scale_from_reading(uniform(1.0), bad, 0, 0)
    assert found.measured == 60.0
    assert found.drift_frac is None
    with pytest.raises(ScaleError, match="over_range"):
        scale_from_reading(uniform(), bad[:1], 0, 0)
    with pytest.raises(ScaleError, match="no usable meter reading"):
        scale_from_reading(uniform(), [], 0, 0)
    with pytest.raises(ScaleError, match="reading of 0"):
        scale_from_reading(uniform(), [reading(0.0)], 0, 0)


def test_meter_uncertainty_is_its_class() -> None:
    bright = scale_from_reading(uniform(), [reading(1224.0)], 0, 0)
    assert bright.parts["meter"] == pytest.approx(math.hypot(0.02 / math.sqrt(3), LS160.spectral), rel=0.02)
    dim = scale_from_reading(uniform(), [reading(0.05)], 0, 0)
    assert dim.parts["meter"] > 0.2  # two digits of 0.01 in 0.05
    exact = scale_from_reading(uniform(), [reading(1224.0)], 0, 0, meter=replace(LS160, relative=0.0, digits=0.0))
    assert exact.parts["meter"] == LS160.spectral


@pytest.mark.parametrize(
    ("kind", "named"), [(Validity.CLIPPED, "clipped"), (Validity.DARK, "darker"), (Validity.OUTSIDE, "outside")]
)
def test_a_spot_without_a_value_is_refused(kind: Validity, named: str) -> None:
    bad = uniform()
    bad.validity[180, 360] = kind
    with pytest.raises(ScaleError, match=named):
        scale_from_reading(bad, [reading(50.0)], 0.001, -0.001)


def test_a_ghost_on_the_spot_is_refused_and_a_little_one_warns() -> None:
    moved = replace(uniform(wide=2880), ghost=np.zeros((1440, 2880), dtype=np.uint8))
    assert moved.ghost is not None
    moved.ghost[720, 1440] = 3
    assert "moved" in scale_from_reading(moved, [reading(50.0)], 0, 0).warnings[0]
    moved.ghost[:] = 1
    with pytest.raises(ScaleError, match="ghost"):
        scale_from_reading(moved, [reading(50.0)], 0, 0)


def test_black_target_and_spot_beside_the_picture_are_refused() -> None:
    with pytest.raises(ScaleError, match="black"):
        scale_from_reading(uniform(0.0), [reading(50.0)], 0, 0)
    view = image(np.ones((30, 40)), Perspective(40, 30, 1.0))
    with pytest.raises(ScaleError, match="outside the picture"):
        scale_from_reading(view, [reading(50.0)], math.pi, 0)


def test_scaled_and_combined() -> None:
    k1, k2 = ScaleFactor(10.0, 0.03), ScaleFactor(2.0, 0.04)
    both = combined(k1, k2)
    assert both.value == 20.0
    assert both.relative_uncertainty == pytest.approx(0.05)
    picture = scaled(uniform(1.5), both, k1=10.0)
    assert picture.rgb.dtype == np.float32
    np.testing.assert_allclose(picture.rgb, 30.0)
    assert picture.attributes["k1"] == 10.0
    assert picture.scale_uncertainty == pytest.approx(0.05)


def test_a_pixels_uncertainty_has_the_curves_error_against_the_level_that_was_metered() -> None:
    """Of the same level as the target it has none of it, an octave away what the mode is there from the target on."""
    mode = SharedMode("curve and times 1", "level", (-20.0, 0.0, 20.0), (0.3, 0.3, 0.7))
    merged = image(np.broadcast_to([1.0, 2.0, 0.5, 1e-30], (2, 4)), Equirectangular(4, 2), 0.004)
    level = merged.luminance()
    merged = replace(
        merged,
        uncertainty=np.hypot(merged.uncertainty, together([mode], level)),
        attributes=with_modes({}, [mode]),
    )
    merged.uncertainty[1, 3] = np.inf
    typed = scaled(merged, ScaleFactor(40.0, 0.02))
    assert typed.uncertainty is merged.uncertainty
    metered = scaled(merged, ScaleFactor(40.0, 0.02, measured=40.0))
    [left] = modes_of(metered)
    expected = np.hypot(0.004, together([left], metered.luminance_cd_m2()))
    np.testing.assert_allclose(metered.uncertainty[0], expected[0], atol=0.0005)
    assert metered.uncertainty[0, 0] == pytest.approx(0.004, abs=0.001)
    assert metered.uncertainty[0, 1] == pytest.approx(0.02, abs=0.003)
    assert np.isinf(metered.uncertainty[1, 3])
