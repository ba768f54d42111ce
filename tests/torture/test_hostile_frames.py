"""Thousands of mutated frames against the checker: bounded time, no crash of the station, nothing misjudged.

What a decoder cannot see (a flipped bit that still decodes to a plausible picture) is not for this gate: the SHA-256 in
the manifest finds every one of them in `verify`, as is counted here too.
"""

from __future__ import annotations

import hashlib
import io
import os
import resource
import time
import warnings
from collections import Counter
from datetime import UTC, timedelta
from pathlib import Path

import pytest
from PIL import Image

from station.errors import FrameRejectedError
from station.frames.check import ExpectedFrame, FrameChecker, FrameFacts, Reason
from tests.station.frames.pictures import TAKEN
from tests.torture.hostile_frames import SIZE, TIME_S, cases, good_frames
from tests.torture.ledger import record

LONG = os.environ.get("DAYLIT_TORTURE") == "1"
COUNT = 33_000 if LONG else 330
SEED = 20_230_519
LIMIT_S = 5.0
ASKED = ExpectedFrame(
    exposure_s=TIME_S,
    iso=100,
    f_number=5.6,
    width_px=SIZE[0],
    height_px=SIZE[1],
    taken_after_utc=TAKEN.replace(tzinfo=UTC) - timedelta(seconds=1),
    taken_before_utc=TAKEN.replace(tzinfo=UTC) + timedelta(seconds=9),
    clock_offset_s=0.0,
)


def judged(checker: FrameChecker, path: Path) -> FrameFacts | str:
    """Return the facts of an accepted file, or the name of the reason; any other exception fails the test."""
    try:
        return checker.check(path, ASKED)
    except FrameRejectedError as error:
        return str(error.details["reason"])


def misjudged(facts: FrameFacts, data: bytes) -> str:
    """Say what is wrong with an acceptance, looking at the file without our code."""
    if facts.sha256 != hashlib.sha256(data).hexdigest():
        return "another digest"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow follows directories that the station never visits
        picture = Image.open(io.BytesIO(data))
        picture.load()
        said = picture.getexif().get_ifd(0x8769)
    if picture.size != SIZE:
        return f"size {picture.size}"
    asked = {0x829A: TIME_S, 0x829D: 5.6, 0x8827: 100}
    if not said:  # Pillow gives up at a broken tag that the station has no interest in: nothing to compare with
        return ""
    wrong = [f"{tag:#x} is {said.get(tag)}" for tag, value in asked.items() if not close(said.get(tag, 0), value)]
    return ", ".join(wrong)


def close(said: object, asked: float) -> bool:
    """Return whether a value (of several, the first: EXIF allows any number of sensitivities) is the asked one."""
    first = said[0] if isinstance(said, tuple) else said
    return abs(float(first) / asked - 1) <= 0.09


@pytest.mark.torture
@pytest.mark.timeout(900)
def test_mutated_frames_are_refused_by_name_or_indistinguishable(tmp_path: Path) -> None:
    began = time.monotonic()
    path = tmp_path / "frame.jpg"
    reasons: Counter[str] = Counter()
    lost: list[str] = []
    slowest_s = 0.0
    originals = {hashlib.sha256(data).hexdigest() for data in good_frames()}
    with FrameChecker(limit_s=LIMIT_S) as checker:
        checker.start()
        memory_before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number, case in enumerate(cases(COUNT, SEED)):
            path.write_bytes(case.data)
            start = time.monotonic()
            found = judged(checker, path)
            slowest_s = max(slowest_s, time.monotonic() - start)
            reasons[found if isinstance(found, str) else "left to SHA-256"] += 1
            if isinstance(found, str):
                continue
            problem = "accepted" if case.must_refuse else misjudged(found, case.data)
            if problem or found.sha256 in originals:
                lost.append(f"case {number} ({case.kind}): {problem or 'the digest does not show it'}")
        deaths = checker.deaths
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory_before_kb
    left = reasons["left to SHA-256"]
    record(
        "hostile frames",
        injected=COUNT,
        observed=COUNT - left,
        lost=len(lost),
        seconds=time.monotonic() - began,
        seed=SEED,
        notes=f"{left} decode and say what was asked: SHA-256 shows them in verify; "
        f"worker deaths {deaths}; slowest {slowest_s * 1000:.0f} ms",
    )
    assert not lost
    assert set(reasons) <= set(Reason) | {"left to SHA-256"}
    assert slowest_s <= 2 * LIMIT_S
    assert deaths <= COUNT // 100
    assert grown_kb < 100_000, "the station's own memory stays as it was"


@pytest.mark.torture
def test_good_frames_pass_the_same_gate(tmp_path: Path) -> None:
    """The negative control: a gate that refuses everything would pass the test above."""
    path = tmp_path / "frame.jpg"
    with FrameChecker() as checker:
        frames = good_frames()
        assert len(frames) == 4
        for data in frames:
            path.write_bytes(data)
            assert isinstance(judged(checker, path), FrameFacts)
