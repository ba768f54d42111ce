"""Hostile worlds: each does what its name says, the same for the same seed."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from benchmarks.hostile.worlds import (
    ENCODERS,
    TIMES_S,
    HostileCamera,
    coded,
    hostile_bracket,
    hostile_worlds,
    jpeg_file,
)

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


def test_encoders_differ_in_what_makers_differ_in() -> None:
    """Tables, chroma, order of the data, and the transform; all give the picture back."""
    frame = np.clip(SCENE / 2 + np.arange(96)[None, :, None], 0, 255).astype(np.uint8)
    files = [jpeg_file(frame, jpeg) for jpeg in ENCODERS]
    shown = [Image.open(io.BytesIO(data)) for data in files]
    assert len({str(picture.quantization) for picture in shown}) == len(ENCODERS)
    assert {picture.layer[0][1:3] for picture in shown} == {(1, 1), (2, 1), (2, 2)}  # type: ignore[attr-defined]
    assert sum("progressive" in picture.info for picture in shown) == 1
    assert jpeg_file(frame, ("fast", 94, "4:2:0")) != jpeg_file(frame, ("opencv", 94, "4:2:0"))
    for jpeg in ENCODERS:
        assert 0 < np.abs(coded(frame, jpeg).astype(int) - frame).mean() < 40


def test_hot_wells_leak_less_in_short_exposures() -> None:
    camera = HostileCamera(*(LIGHT, CURVES[1][0]), hot_share=0.01, seed=1)
    dark = np.zeros((48, 96, 3), np.float32)
    whole, tenth, none = (camera.developed(dark, 1, leak).max() for leak in (1.0, 0.1, 0.0))
    assert whole > tenth > none
