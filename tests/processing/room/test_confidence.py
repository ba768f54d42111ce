"""What is said of a room that may be wrong: doubts lower the confidence, and bad pictures never give a sure room."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.room.confidence import LEAST, MOST, Diagnostics, confidence_of, doubts
from processing.room.estimate import estimate_room
from processing.room.hypotheses import class_entropy
from processing.segmentation.evidence import BoundaryEvidence, SceneClass, SceneEvidence
from tests.processing.room.evidence import BOX, COLUMNS, boundary_of, classes_of, evidence_of, painted, room_of

SURE = Diagnostics(0.6, 0.0, 1.0, 0.01, 0.0, 0.01, 0.2, 1.0, 0.0, 0.9, 0.5, 4.0)
DOUBTS = {
    "sigma_deg": (0.3, 30.0),
    "ratio_spread": (0.0, 0.5),
    "rival": (0.0, 1.0),
    "loss": (0.0, 1.0),
    "entropy": (0.0, 2.08),
    "blank": (0.0, 0.3),
}


def test_a_room_without_any_doubt_is_sure_and_nothing_is_said() -> None:
    assert confidence_of(SURE) > 0.9
    assert doubts(SURE, confidence_of(SURE)) == ()


@given(st.sampled_from(sorted(DOUBTS)), st.floats(0, 1), st.floats(0, 1))
@settings(max_examples=60)
def test_more_doubt_is_never_more_confidence(name: str, one: float, other: float) -> None:
    low, high = DOUBTS[name]
    less, more = sorted((one, other))
    surer = confidence_of(replace(SURE, **{name: low + less * (high - low)}))
    assert LEAST <= confidence_of(replace(SURE, **{name: low + more * (high - low)})) <= surer <= MOST


@pytest.mark.parametrize(("name", "value"), [("rival", 0.6), ("overhead", 0.1), ("nearest", 0.01)])
def test_one_grave_doubt_is_enough(name: str, value: float) -> None:
    assert confidence_of(replace(SURE, **{name: value})) < 0.5


def test_entropy_is_that_of_the_classes() -> None:
    count = len(SceneClass)
    even = np.full((count, 16, 32), 1 / count, np.float32)
    assert class_entropy(SceneEvidence(even, "")) == pytest.approx(math.log(count), rel=1e-5)
    certain = np.zeros((count, 16, 32), np.float32)
    certain[0] = 1
    assert class_entropy(SceneEvidence(certain, "")) == 0


def seen_through(room, stretch: slice, factor: float, *, sigma_deg: float) -> BoundaryEvidence:
    """Return a room's boundaries where a stretch of columns shows something farther away, less surely."""
    true = boundary_of(room, noise_deg=0.5)
    floor, ceiling, spread = true.floor_rad.copy(), true.ceiling_rad.copy(), true.floor_sigma_rad.copy()
    floor[stretch] = np.arctan(np.tan(floor[stretch]) / factor)
    ceiling[stretch] = np.arctan(np.tan(ceiling[stretch]) / factor)
    spread[stretch] = math.radians(sigma_deg)
    return replace(true, floor_rad=floor, ceiling_rad=ceiling, floor_sigma_rad=spread, ceiling_sigma_rad=spread.copy())


def unsure(classes: np.ndarray, share: float) -> np.ndarray:
    """Return classes mixed with an even share of all: a network that does not know."""
    return ((1 - share) * classes + share / len(classes)).astype(np.float32)


@pytest.mark.parametrize("case", ["mirror", pytest.param("doorway", marks=pytest.mark.long)])
def test_a_room_that_goes_on_behind_a_wall_is_not_presented_as_certain(case: str) -> None:
    """A wall of mirrors, and a camera in a doorway: in half of the turn the boundaries are those of another room."""
    room = room_of(BOX)
    stretch = slice(0, COLUMNS // 2) if case == "doorway" else slice(40, 120)
    boundary = seen_through(room, stretch, 3.0 if case == "doorway" else 2.0, sigma_deg=12.0)
    result = estimate_room(
        painted(room, 256), SceneEvidence(unsure(classes_of(room), 0.4), "", boundary), manhattan_rad=0.0
    )
    plain = estimate_room(painted(room, 256), evidence_of(room, noise_deg=0.5), manhattan_rad=0.0)
    assert plain.room.confidence > 0.7
    assert result.room.confidence < 0.5
    assert any("doubtful" in line for line in result.warnings)


def test_a_tilted_picture_that_is_not_levelled_is_doubted() -> None:
    """Ten degrees of roll: floor and ceiling disagree about every distance."""
    room = room_of(BOX)
    true = boundary_of(room, noise_deg=0.5)
    azimuth = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * 2 * math.pi
    roll = math.radians(10) * np.sin(azimuth)
    boundary = replace(
        true, floor_rad=np.minimum(true.floor_rad + roll, -0.05), ceiling_rad=np.maximum(true.ceiling_rad + roll, 0.05)
    )
    result = estimate_room(painted(room, 256), SceneEvidence(classes_of(room), "", boundary), manhattan_rad=0.0)
    assert result.room.confidence < 0.5
    assert any("level" in line for line in result.warnings)
