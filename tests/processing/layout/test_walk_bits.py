"""Grids of one bit a cell against a plain flood: the same cells blocked, the same answers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from processing.layout.solver.walk_grid import (
    Grid,
    Walk,
    connected,
    count_bits,
    lowest,
    packed,
    rect_distance2,
    spread,
    stamp,
    touches,
)

CELL_M = 0.07
GRID = Grid(0.0, 0.0, CELL_M)


def unpacked(words: np.ndarray, columns: int) -> np.ndarray:
    bits = (words[:, :, None] >> np.arange(64, dtype=np.uint64)) & np.uint64(1)
    return bits.reshape(len(words), -1)[:, :columns].astype(bool)


def rectangle(rng: np.random.Generator) -> np.ndarray:
    w, d = rng.uniform(0.05, 1.5, 2)
    a = float(rng.choice([0.0, np.pi / 2, rng.uniform(0, 6)]))
    c, s = np.cos(a), np.sin(a)
    ring = np.array([[-w, -d], [w, -d], [w, d], [-w, d]]) / 2 @ np.array([[c, s], [-s, c]])
    ring = ring if rng.random() < 0.5 else ring[::-1]
    return np.ascontiguousarray(ring + rng.uniform(0, 6, 2))


def near(corners: np.ndarray, shape: tuple[int, int], radius: float) -> np.ndarray:
    return np.array(
        [
            [rect_distance2(corners, (j + 0.5) * CELL_M, (i + 0.5) * CELL_M) < radius * radius for j in range(shape[1])]
            for i in range(shape[0])
        ]
    )


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(1, 140))
def test_floods_are_those_of_a_plain_labelling(seed: int, rows: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    blocked = rng.random((rows, columns)) < rng.uniform(0.1, 0.6)
    labels = ndimage.label(~blocked)[0]
    i, j = int(rng.integers(rows)), int(rng.integers(columns))
    if blocked[i, j]:
        return
    free = ~packed(blocked)
    reached = np.zeros_like(free)
    reached[i, j // 64] = np.uint64(1) << np.uint64(j % 64)
    spread(reached, free, i)
    assert np.array_equal(unpacked(reached, columns), labels == labels[i, j])
    assert sum(count_bits(word) for word in reached.ravel()) == np.count_nonzero(labels == labels[i, j])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 0.6))
def test_stamps_and_paths_are_those_of_distances(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(5, 90)), int(rng.integers(5, 90)))
    plain = rng.random(shape) < 0.04
    words = packed(plain)
    for corners in (rectangle(rng), rectangle(rng)):
        stamp(words, corners, GRID, radius)
        plain |= near(corners, shape, radius)
    assert np.array_equal(unpacked(words, shape[1]), plain)
    doors = np.array([rectangle(rng) for _ in range(int(rng.integers(1, 3)))])
    zones = np.array([rectangle(rng) for _ in range(2)])
    labels = ndimage.label(~plain)[0]
    served = [set(np.unique(labels[near(d, shape, 1e-9)])) - {0} for d in doors]
    served += [set(np.unique(labels[near(z, shape, radius)])) - {0} for z in zones]
    work = np.empty((2, *words.shape), dtype=np.uint64)
    found = connected(Walk(GRID, words, doors, radius, radius), words, zones, work)
    if found:
        assert set.intersection(*served), "one patch serves all"
    elif len(served[0]) <= 4:  # a door's floor in more patches than that is given up
        assert not set.intersection(*served)


def test_words_at_their_ends() -> None:
    assert lowest(np.uint64(0b1011000)) == np.uint64(0b1000)
    row = np.zeros((1, 130), dtype=bool)
    words = packed(row)
    assert words.shape == (1, 3)
    assert words[0, 2] == np.uint64(2**64 - 4), "what is past the last column is blocked"
    reached, free = np.zeros_like(words), ~words
    reached[0, 1] = np.uint64(1)
    spread(reached, free, 0)
    assert np.array_equal(reached, free), "over both borders of a word"


@pytest.mark.parametrize("reach", [0.0, 0.2])
def test_nothing_is_touched_outside_the_grid(reach: float) -> None:
    reached = np.full((4, 1), np.uint64(0xF))
    far = np.array([[9.0, 9.0], [9.5, 9.0], [9.5, 9.5], [9.0, 9.5]])
    assert not touches(reached, far, GRID, reach)
    assert not touches(reached, far - 12, GRID, reach)
    assert touches(reached, far - 8.9, GRID, reach)
