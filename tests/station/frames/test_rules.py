"""The rules from facts to refusal: every reason by name, and nothing refused that a real bracket holds."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.errors import FrameRejectedError
from station.frames.facts import ExifRecord, ExpectedFrame, FrameFacts
from station.frames.problems import Reason
from station.frames.rules import check_not_too_dark, check_order, judge, same_stop, seconds_text

NOMINAL = (
    "30 25 20 15 13 10 8 6 5 4 3.2 2.5 2 1.6 1.3 1 0.8 0.6 0.5 0.4 0.3 1/4 1/5 1/6 1/8 1/10 1/13 1/15 1/20 1/25 1/30 "
    "1/40 1/50 1/60 1/80 1/100 1/125 1/160 1/200 1/250 1/320 1/400 1/500 1/640 1/800 1/1000 1/1250 1/1600 1/2000 "
    "1/2500 1/3200 1/4000 1/5000 1/6400 1/8000"
)
"""Times as cameras in thirds of a stop label them, from 2^(15/3) s downwards."""
PAPER_S = (4, 1, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
DAY = datetime(2023, 5, 19, 19, 54, 0, tzinfo=UTC)


def thirds() -> list[tuple[float, float]]:
    """Return (nominal, exact) of every stop from 30 s to 1/8000 s."""
    nominal = [float(Fraction(label)) for label in NOMINAL.split()]
    return [(time_s, 2 ** ((15 - i) / 3)) for i, time_s in enumerate(nominal)]


def facts(name: str = "b.jpg", time_s: float | None = 1 / 60, mean: float = 0.4, **changes: Any) -> FrameFacts:
    exif = {"exposure_s": time_s, "iso": 100, "f_number": 5.6, "width_px": 6720, "height_px": 3360}
    exif.update(
        {k: changes.pop(k) for k in list(changes) if k in ExifRecord.model_fields and k[:5] not in ("width", "heigh")}
    )
    values: dict[str, Any] = {
        "name": name,
        "size_bytes": 1000,
        "sha256": f"{abs(hash((name, time_s, mean))):064x}",
        "width_px": 6720,
        "height_px": 3360,
        "exif": ExifRecord(**exif),
        "mean_frac": mean,
        "dark_frac": 1.0 if mean < 0.005 else 0.0,
        "picture_sha256": f"{abs(hash((name, mean))):064x}",
    }
    return FrameFacts(**{**values, **changes})


ASKED = ExpectedFrame(exposure_s=1 / 60, iso=100, f_number=5.6, width_px=6720, height_px=3360)


def reason(frame: FrameFacts, expected: ExpectedFrame = ASKED, earlier: tuple[FrameFacts, ...] = ()) -> str:
    with pytest.raises(FrameRejectedError) as caught:
        judge(frame, expected, earlier)
    assert caught.value.where == frame.name
    return caught.value.details["reason"]


def test_all_nominal_times_are_their_exact_stop_and_no_other():
    stops = thirds()
    assert len(stops) == 55
    for i, (nominal, exact) in enumerate(stops):
        assert same_stop(nominal, exact)
        assert same_stop(exact, nominal)
        for other, other_exact in stops[:i] + stops[i + 1 :]:
            assert not same_stop(nominal, other)
            assert not same_stop(nominal, other_exact)


def test_real_forms_of_one_stop():
    assert same_stop(13, 12.699)
    assert same_stop(1 / 15, 1 / 16)
    assert same_stop(0.3, 1 / 3)
    assert same_stop(1 / 8000, 0.000125)
    assert not same_stop(1 / 60, 1 / 50)


@given(st.floats(1e-5, 3600), st.floats(1 / 3, 20))
def test_times_a_third_of_a_stop_apart_are_two_stops(a_s, stops):
    assert not same_stop(a_s, a_s * 2**stops)
    assert not same_stop(a_s * 2**stops, a_s)


@given(st.floats(1e-5, 3600), st.floats(-0.11, 0.11))
def test_times_close_together_are_one_stop(a_s, stops):
    assert same_stop(a_s, a_s * 2**stops)
    assert same_stop(a_s * 2**stops, a_s)


@pytest.mark.parametrize(
    ("time_s", "text"),
    [
        (4, "4 s"),
        (1, "1 s"),
        (0.5, "1/2 s"),
        (1 / 60, "1/60 s"),
        (0.8, "0.8 s"),
        (1 / 8000, "1/8000 s"),
        (12.699, "12.7 s"),
    ],
)
def test_times_as_photographers_write_them(time_s, text):
    assert seconds_text(time_s) == text


def test_what_was_asked_passes():
    judge(facts(), ASKED)
    judge(facts(time_s=1 / 64, f_number=5.657), ASKED)


def test_wrong_settings_are_named_with_both_values_and_the_difference():
    with pytest.raises(FrameRejectedError, match=r"1/15 s, asked 1/60 s, 2\.00 stops longer") as caught:
        judge(facts(time_s=1 / 15), ASKED)
    assert caught.value.details["reason"] == Reason.WRONG_EXPOSURE
    assert reason(facts(time_s=1 / 125)) == Reason.WRONG_EXPOSURE
    assert reason(facts(iso=200)) == Reason.WRONG_ISO
    assert reason(facts(f_number=6.3)) == Reason.WRONG_F_NUMBER
    assert reason(facts(width_px=3360)) == Reason.WRONG_SIZE
    assert reason(facts(exif=ExifRecord(exposure_s=1 / 60, iso=100, f_number=5.6, width_px=640))) == Reason.WRONG_SIZE


def test_missing_and_damaged_exif_matter_where_exif_is_required():
    bare = facts(exif=ExifRecord(), exif_problem="no EXIF")
    lenient = ExpectedFrame(exposure_s=1 / 60, iso=100, require_exif=False)
    assert reason(bare) == Reason.EXIF_MISSING
    assert reason(facts(exif=ExifRecord(), exif_problem="a loop")) == Reason.EXIF_DAMAGED
    assert reason(facts(time_s=None)) == Reason.EXIF_MISSING
    assert reason(facts(iso=None)) == Reason.EXIF_MISSING
    judge(bare, lenient)
    assert reason(facts(time_s=4), lenient) == Reason.WRONG_EXPOSURE


def test_repeated_frames_by_bytes_and_by_pixels():
    first = facts("a.jpg")
    assert reason(facts(sha256=first.sha256), earlier=(first,)) == Reason.REPEATED
    assert reason(facts(picture_sha256=first.picture_sha256), earlier=(first,)) == Reason.REPEATED
    judge(facts(picture_sha256=None), ASKED, [facts("a.jpg", picture_sha256=None)])


def dated(local: datetime, offset_s: float | None = 0.0) -> tuple[FrameFacts, ExpectedFrame]:
    expected = ExpectedFrame(
        exposure_s=1 / 60,
        taken_after_utc=DAY,
        taken_before_utc=DAY + timedelta(seconds=8),
        clock_offset_s=offset_s,
        require_exif=False,
    )
    return facts(taken_local=local), expected


@pytest.mark.parametrize("zone_h", [-14, -9.5, -4, 0, 2, 5.75, 14])
@pytest.mark.parametrize("late_s", [-2.9, 0, 4, 10.9])
def test_dates_inside_the_capture_in_any_zone(zone_h, late_s):
    local = (DAY + timedelta(hours=zone_h, seconds=late_s)).replace(tzinfo=None)
    judge(*dated(local))
    judge(*dated(local + timedelta(seconds=37), offset_s=37))


@pytest.mark.parametrize("late_s", [-60, -4, 12, 300, 86_400 + 4, -86_400 * 30])
def test_dates_outside_the_capture(late_s):
    local = (DAY + timedelta(seconds=late_s)).replace(tzinfo=None)
    assert reason(*dated(local)) == Reason.WRONG_DATE
    judge(*dated(local, offset_s=None))


def test_black_frames_where_black_cannot_be():
    def at(time_s: float, **changes: Any) -> ExpectedFrame:
        return ExpectedFrame(exposure_s=time_s, iso=100, f_number=5.6, require_exif=False, **changes)

    for time_s in (4, 1, 1 / 4, 1 / 15):
        assert reason(facts(time_s=time_s, mean=0.001), at(time_s)) == Reason.BLACK
        judge(facts(time_s=time_s, mean=0.001), at(time_s, light_expected=False))
    for time_s in (1 / 60, 1 / 1000, 1 / 8000):
        judge(facts(time_s=time_s, mean=0.0), at(time_s))


def test_a_frame_too_dark_for_its_neighbours():
    longer = facts("4s.jpg", 4, 0.6)
    expected = ExpectedFrame(exposure_s=1, require_exif=False)
    assert reason(facts(time_s=1, mean=0.01), expected, (longer,)) == Reason.TOO_DARK
    judge(facts(time_s=1, mean=0.25), expected, [longer])
    judge(facts(time_s=1 / 8000, mean=0.0), ExpectedFrame(exposure_s=1 / 8000, require_exif=False), [longer])
    shorter = facts("short.jpg", 1 / 60, 0.5)
    assert reason(facts(time_s=1, mean=0.05), expected, (shorter,)) == Reason.TOO_DARK


def bracket(means: list[float]) -> dict[int, FrameFacts]:
    return {i: facts(f"{i}.jpg", PAPER_S[i], mean) for i, mean in enumerate(means)}


REAL = [0.965, 0.806, 0.603, 0.428, 0.249, 0.110, 0.042, 0.016, 0.005]


def test_real_and_saturated_and_dark_brackets_are_in_order():
    check_order(bracket(REAL), PAPER_S)
    flat = {i: f.model_copy(update={"clipped_frac": 0.6}) for i, f in bracket([0.99, 0.99, 0.985, 0.99]).items()}
    check_order(flat, PAPER_S)
    check_order(bracket([0.003, 0.002, 0.0, 0.001, 0.0]), PAPER_S)
    check_order({}, PAPER_S)


@pytest.mark.parametrize("odd", range(9))
def test_the_one_frame_out_of_order_is_named(odd):
    means = list(REAL)
    means[odd] = 0.0 if odd < 4 else 0.99
    with pytest.raises(FrameRejectedError) as caught:
        check_order(bracket(means), PAPER_S)
    assert caught.value.details == {"reason": "out_of_order", "stops": [odd]}
    assert f"{odd}.jpg" in caught.value.where


def test_a_shutter_that_did_not_move_is_named():
    with pytest.raises(FrameRejectedError, match=r"as bright as 3\.jpg, though 1\.9 stops longer") as caught:
        check_order(bracket([0.8, 0.6, 0.41, 0.409]), PAPER_S)
    assert caught.value.details["stops"] == [2]


@pytest.mark.parametrize("black", range(1, 7))
def test_a_black_frame_before_a_bright_one_is_named(black):
    check_not_too_dark(bracket(REAL), PAPER_S)
    means = list(REAL)
    means[black] = 0.0
    with pytest.raises(FrameRejectedError, match="cannot be below") as caught:
        check_not_too_dark(bracket(means), PAPER_S)
    assert caught.value.details == {"reason": "too_dark", "stops": [black]}


@settings(max_examples=100)
@given(st.lists(st.floats(0, 0.9), min_size=2, max_size=9), st.floats(0.2, 3))
def test_growing_brightness_is_never_refused(steps, gamma):
    """Any scene under any monotone response: the mean grows with exposure, by what is not clipped or dark."""
    means = [sum(min(1, (e * t * 40) ** (1 / gamma)) for e in steps) / len(steps) for t in PAPER_S]
    dark = [sum((e * t * 40) ** (1 / gamma) <= 8 / 255 for e in steps) / len(steps) for t in PAPER_S]
    clip = [sum((e * t * 40) ** (1 / gamma) >= 250 / 255 for e in steps) / len(steps) for t in PAPER_S]
    frames = {
        i: facts(f"{i}.jpg", PAPER_S[i], m).model_copy(update={"dark_frac": d, "clipped_frac": c})
        for i, (m, d, c) in enumerate(zip(means, dark, clip, strict=True))
    }
    check_order(frames, PAPER_S)
