"""The rules a frame must pass once its facts are known: pure functions from facts to a named refusal."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

from station.errors import FrameRejectedError
from station.frames.facts import ExpectedFrame, FrameFacts
from station.frames.problems import Reason

SAME_STOP = 0.12
"""Nominal times lie up to 0.107 stop beside 2^(k/3) s (1/15 for 1/16, 30 for 32); the next is 0.33 away."""
F_NUMBER_TOLERANCE = 0.04  # f/22 is marked for 22.63 and f/3.5 for 3.56; the next third of a stop is 12 % away
DATE_TOLERANCE_S = 3.0
"""EXIF counts whole seconds, the clocks' offset is known to one, and some cameras date the exposure's end."""
ZONE_STEP_S = 900.0  # time zones lie quarters of an hour apart
# Chosen: one step of 255, a dim room, and what rounding and JPEG coding change.
BLACK_MEAN = 1 / 255
DIM_ROOM_CD_M2 = 1.0  # chosen: the mean of a room at dusk
ORDER_TOLERANCE = 0.01  # chosen: of full scale, what coding changes
LEAST_RISE = 1.02  # chosen: a stop doubles midtones


def rejection(facts_name: str, reason: Reason, message: str, advice: str = "", **details: Any) -> FrameRejectedError:
    """Return the error that refuses a file, with the reason and what else is given in ``details``."""
    return FrameRejectedError(message, where=facts_name, advice=advice, reason=str(reason), **details)


def printable(text: str, limit: int = 200) -> str:
    """Return a file name or other foreign text, shortened, with whatever does not print as "?"."""
    return "".join(c if c.isprintable() else "?" for c in text[:limit])


def stops_between(a_s: float, b_s: float) -> float:
    """Return how many stops ``a_s`` is longer than ``b_s`` (negative: shorter)."""
    return math.log2(a_s / b_s)


def same_stop(a_s: float, b_s: float) -> bool:
    """Return whether two times are forms of one stop: 1/15 and 1/16 s, 13 and 12.699 s, 0.3 and 1/3 s."""
    if abs(stops_between(a_s, b_s)) <= SAME_STOP:
        return True
    third = 2 ** (round(3 * math.log2(a_s)) / 3)
    return abs(stops_between(a_s, third)) <= SAME_STOP and abs(stops_between(b_s, third)) <= SAME_STOP


def seconds_text(time_s: float) -> str:
    """Return an exposure time as photographers write it: 4 s, 1/60 s."""
    whole = round(1 / time_s)
    is_fraction = time_s < 0.6 and abs(1 / time_s - whole) < 0.01 * whole
    return f"1/{whole} s" if is_fraction and whole > 1 else f"{time_s:.4g} s"


def judge(facts: FrameFacts, expected: ExpectedFrame, earlier: Sequence[FrameFacts] = ()) -> None:
    """Refuse a frame that is not what was asked, or that repeats an ``earlier`` frame of the same camera.

    Raises `FrameRejectedError`: with the file in ``where`` and the name of the reason in ``details["reason"]``.
    """
    for other in earlier:
        same_picture = facts.picture_sha256 is not None and facts.picture_sha256 == other.picture_sha256
        if facts.sha256 == other.sha256 or same_picture:
            what = "bytes" if facts.sha256 == other.sha256 else "pixels"
            raise rejection(facts.name, Reason.REPEATED, f"the same {what} as {other.name}", "take the frame again")
    _judge_size(facts, expected)
    if expected.require_exif and facts.exif_problem:
        reason = Reason.EXIF_MISSING if facts.exif_problem == "no EXIF" else Reason.EXIF_DAMAGED
        raise rejection(facts.name, reason, f"EXIF: {facts.exif_problem}")
    _judge_value(facts, expected, "exposure_s", Reason.WRONG_EXPOSURE, same_stop, seconds_text)
    _judge_value(facts, expected, "iso", Reason.WRONG_ISO, lambda a, b: a == b, "ISO {:g}".format)
    same_f = partial(math.isclose, rel_tol=F_NUMBER_TOLERANCE)
    _judge_value(facts, expected, "f_number", Reason.WRONG_F_NUMBER, same_f, "f/{:.3g}".format)
    _judge_date(facts, expected)
    _judge_black(facts, expected, earlier)


def _judge_size(facts: FrameFacts, expected: ExpectedFrame) -> None:
    size = (facts.width_px, facts.height_px)
    asked = (expected.width_px or facts.width_px, expected.height_px or facts.height_px)
    if size != asked:
        text = f"{size[0]}x{size[1]} pixels, asked {asked[0]}x{asked[1]}"
        raise rejection(facts.name, Reason.WRONG_SIZE, text, "set the camera's picture size")
    said = (facts.exif.width_px or facts.width_px, facts.exif.height_px or facts.height_px)
    if expected.require_exif and said != size:
        raise rejection(facts.name, Reason.WRONG_SIZE, f"{size[0]}x{size[1]} pixels; its EXIF says {said[0]}x{said[1]}")


def _judge_value(
    facts: FrameFacts,
    expected: ExpectedFrame,
    name: str,
    reason: Reason,
    same: Callable[[float, float], bool],
    text: Callable[[float], str],
) -> None:
    """Compare one value of the EXIF with what was asked, and say by how much it differs."""
    got, asked = getattr(facts.exif, name), getattr(expected, name)
    if asked is None:
        return
    if got is None:
        if expected.require_exif:
            raise rejection(facts.name, Reason.EXIF_MISSING, f"its EXIF has no {name.split('_s')[0].replace('_', '-')}")
        return
    if not same(got, asked):
        by = ""
        if reason is Reason.WRONG_EXPOSURE:
            stops = stops_between(got, asked)
            by = f", {abs(stops):.2f} stops {'longer' if stops > 0 else 'shorter'}"
        advice = "check that the camera is in manual mode, then take the frame again"
        raise rejection(facts.name, reason, f"its EXIF says {text(got)}, asked {text(asked)}{by}", advice)


def _judge_date(facts: FrameFacts, expected: ExpectedFrame) -> None:
    """Refuse a frame dated outside its capture.

    The camera's clock shows local time, and its zone is not always known; so whole quarters of an hour (all
    zones are multiples of one) are left out of the comparison, within the 14 hours that zones reach.
    """
    taken, offset_s = facts.exif.taken_local, expected.clock_offset_s
    after, before = expected.taken_after_utc, expected.taken_before_utc
    if taken is None or offset_s is None or after is None or before is None:
        return
    moment = taken.replace(tzinfo=UTC) - timedelta(seconds=offset_s)
    late_s = (moment - after).total_seconds() + DATE_TOLERANCE_S
    window_s = (before - after).total_seconds() + 2 * DATE_TOLERANCE_S
    if abs(late_s) <= 14 * 3600 + window_s and late_s % ZONE_STEP_S <= window_s:
        return
    window = f"between {_clock(after)} and {_clock(before)} UTC"
    text = f"dated {taken:%Y-%m-%d %H:%M:%S} by the camera's clock, taken {window}"
    advice = "the camera sent an older frame, or its clock was changed: take the frame again"
    raise rejection(facts.name, Reason.WRONG_DATE, text, advice)


def _clock(moment: datetime) -> str:
    return f"{moment.astimezone(UTC):%Y-%m-%d %H:%M:%S}"


def _judge_black(facts: FrameFacts, expected: ExpectedFrame, earlier: Sequence[FrameFacts]) -> None:
    """Refuse a black frame where black cannot be; at short stops a dim room may well be black."""
    time_s = expected.exposure_s or facts.exif.exposure_s
    if time_s is None:
        return
    is_black = facts.mean_frac <= BLACK_MEAN and facts.dark_frac >= 0.9999
    if is_black and expected.light_expected and _shows_dim_room(time_s, expected, facts):
        text = f"black, at {seconds_text(time_s)}, where even a dim room shows"
        raise rejection(facts.name, Reason.BLACK, text, "check for a lens cap, then take the frame again")
    for other in earlier:
        least = _least_mean(other, time_s)
        if facts.mean_frac < least:
            seen = f"brightness {facts.mean_frac:.4f} at {seconds_text(time_s)}"
            text = f"{seen}, which cannot be below {least:.4f} after {other.name}"
            raise rejection(facts.name, Reason.TOO_DARK, text, "take the frame again")


def _shows_dim_room(time_s: float, expected: ExpectedFrame, facts: FrameFacts) -> bool:
    """Return whether 1 cd/m2 would read above 8/255; a meter with K = 12.5 (ISO 2720) puts it at 0.18."""
    iso = expected.iso or facts.exif.iso or 100
    f_number = expected.f_number or facts.exif.f_number or 5.6
    return 0.18 * DIM_ROOM_CD_M2 * time_s * iso / (12.5 * f_number**2) >= 8 / 255 / 12.92


def _least_mean(other: FrameFacts, time_s: float) -> float:
    """Return the least brightness that an exposure can have after another one of the same scene.

    A longer one is no darker; for a shorter one, a response that rises no faster than light keeps at least
    the ratio of the times. A quarter of that is allowed for the foot of real curves and for a cloud, and one
    step of 255 for rounding.
    """
    if other.exif.exposure_s is None:
        return 0.0
    return 0.25 * other.mean_frac * min(1.0, time_s / other.exif.exposure_s) - 1 / 255


def check_not_too_dark(facts_by_stop: Mapping[int, FrameFacts], stops_s: Sequence[float]) -> None:
    """Refuse a frame that a longer one, taken after it, shows to be too dark: black, though its EXIF is right.

    A bracket that runs from short to long begins with frames that nothing can be held against yet.

    ``facts_by_stop``: facts of one side's frames by stop.
    ``stops_s``: exposure time of each stop, seconds.

    Raises `FrameRejectedError`: names the frame (``details["stops"]``).
    """
    for shorter, longer in itertools.pairwise(sorted(facts_by_stop, key=lambda stop: stops_s[stop])):
        frame, other = facts_by_stop[shorter], facts_by_stop[longer]
        least = _least_mean(other, stops_s[shorter])
        if frame.mean_frac < least:
            message = f"brightness {frame.mean_frac:.4f}, which cannot be below {least:.4f} before {other.name}"
            raise rejection(frame.name, Reason.TOO_DARK, message, "take it again", stops=[shorter])


def check_order(facts_by_stop: Mapping[int, FrameFacts], stops_s: Sequence[float]) -> None:
    """Refuse a bracket whose brightness falls as exposure grows, or stays while the scene has midtones.

    ``facts_by_stop``: facts of one side's frames by stop.
    ``stops_s``: exposure time of each stop, seconds.

    Raises `FrameRejectedError`: names the frames that do not fit the others (``details["stops"]``).
    """
    stops = sorted(facts_by_stop, key=lambda stop: stops_s[stop])
    # The indices outside the longest sequence that never falls by more than the tolerance
    means = [facts_by_stop[stop].mean_frac for stop in stops]
    best: list[list[int]] = []
    for i, mean in enumerate(means):
        before = [chain for chain in best if means[chain[-1]] <= mean * 1.02 + ORDER_TOLERANCE]
        best.append([*max(before, key=len, default=[]), i])
    longest = max(best, key=len, default=[])
    odd = [i for i in range(len(means)) if i not in longest]
    if odd:
        names = ", ".join(f"{facts_by_stop[stops[i]].name} ({seconds_text(stops_s[stops[i]])})" for i in odd)
        text = "brightness falls although the exposure is longer"
        raise rejection(names, Reason.OUT_OF_ORDER, text, "take it again", stops=[stops[i] for i in odd])
    for shorter, longer in itertools.pairwise(stops):
        _check_rise(facts_by_stop[shorter], facts_by_stop[longer], stops_s[shorter], stops_s[longer], longer)


def _check_rise(shorter: FrameFacts, longer: FrameFacts, shorter_s: float, longer_s: float, stop: int) -> None:
    """Refuse two mostly midtone frames, a stop or more apart, that are equally bright: the shutter stuck."""
    midtones = min(1 - f.clipped_frac - f.dark_frac for f in (shorter, longer))
    if midtones < 0.5 or stops_between(longer_s, shorter_s) < 0.9:
        return
    if longer.mean_frac < shorter.mean_frac * LEAST_RISE:
        text = f"as bright as {shorter.name}, though {stops_between(longer_s, shorter_s):.1f} stops longer"
        advice = "check that the camera is in manual mode, then take the frame again"
        raise rejection(longer.name, Reason.OUT_OF_ORDER, text, advice, stops=[stop])
