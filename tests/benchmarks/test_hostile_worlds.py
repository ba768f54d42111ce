"""Hostile worlds: each does what its name says, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.hostile.worlds import TIMES_S, hostile_bracket, hostile_worlds

LIGHT = np.linspace(0, 1, 64)
CURVES = (LIGHT, [np.stack([LIGHT ** (1 / g) for g in (2.0, 2.2, 2.4)])])
SCENE = (np.random.default_rng(1).uniform(0.5, 2, (48, 96, 3)) * 100).astype(np.float32)


@pytest.mark.parametrize("number", range(20))
def test_worlds_give_frames_that_grow_darker_and_repeat(number: int) -> None:
    world = hostile_worlds(CURVES, 5)[number]
    found = hostile_bracket(world, SCENE, 5.0, 7)
    again = hostile_bracket(world, SCENE, 5.0, 7)
    means = [float(frame.mean()) for frame in found.frames]
    assert len(found.frames) == len(TIMES_S)
    assert means[0] > 200
    assert means[-1] < 60
    assert all(np.array_equal(a, b) for a, b in zip(found.frames, again.frames, strict=True))
    assert found.radiance.shape == SCENE.shape


def test_there_are_twenty_different_worlds() -> None:
    names = [world.name for world in hostile_worlds(CURVES, 5)]
    assert len(names) == len(set(names)) == 20
