"""What of a floor may be copied from: rests of things are left out, patterns and light are not."""

from __future__ import annotations

import numpy as np
import pytest

from processing.ground.arrays import Flags, Floats
from processing.removal.near_periodic import complete, plane_sources

PX_PER_M = 40.0
SHAPE = (160, 200)
"""4 x 5 m."""


def boards(seed: int = 1) -> Floats:
    """Return a floor of boards of different tones, darker away from the window."""
    rng = np.random.default_rng(seed)
    tones = rng.uniform(0.75, 1.25, (SHAPE[0] // 5, 8))
    grain = rng.normal(1, 0.03, SHAPE)
    offsets = rng.integers(0, 25, SHAPE[0] // 5)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    tone = tones[rows // 5, ((columns + offsets[rows // 5]) // 29) % 8] * grain
    light = np.exp(-columns / 150)
    return (20 * (tone * light)[..., None] * [1.0, 0.62, 0.36]).astype(np.float32)


def chequered() -> Floats:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    dark = (rows // 16 + columns // 16) % 2 > 0
    noise = np.random.default_rng(2).normal(1, 0.02, SHAPE)
    return (np.where(dark, 4.0, 25.0) * noise)[..., None].repeat(3, axis=-1).astype(np.float32)


def rug() -> Flags:
    """Return where the rest of a rug lies: beside the hole, half a metre wide."""
    where = np.zeros(SHAPE, bool)
    where[60:84, 92:112] = True
    return where


@pytest.mark.parametrize("floor", [boards(), chequered()])
def test_a_floor_alone_is_wholly_a_source(floor: Floats) -> None:
    known = np.ones(SHAPE, bool)
    known[50:110, 110:170] = False
    kept = plane_sources(floor, known, PX_PER_M)
    assert kept[known].mean() > 0.95
    assert not kept[~known].any()


def test_the_rest_of_a_rug_is_no_source() -> None:
    floor = boards()
    floor[rug()] = [30.0, 30.0, 29.0]
    known = np.ones(SHAPE, bool)
    known[50:110, 112:170] = False
    kept = plane_sources(floor, known, PX_PER_M)
    assert not kept[rug()].any()
    assert kept[known & ~rug()].mean() > 0.85


def test_a_shadow_that_runs_out_stays_a_source() -> None:
    floor = boards()
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    away = np.hypot(rows - 80, columns - 100)
    floor *= (1 - 0.6 * np.exp(-((away / 30) ** 2)))[..., None].astype(np.float32)
    known = np.ones(SHAPE, bool)
    known[60:100, 100:150] = False
    assert plane_sources(floor, known, PX_PER_M)[known].mean() > 0.9


FINE_PX_PER_M = 80.0


def fine_boards() -> tuple[Floats, Flags]:
    """Return a floor of 3.8 x 5 m at `FINE_PX_PER_M` with light that turns from daylight to a lamp's, and what is
    seen of it."""
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[:300, :400]
    tone = rng.uniform(0.9, 1.1, 20)[rows // 15] * rng.normal(1, 0.03, rows.shape)
    warm = np.stack([columns / 400, np.zeros(rows.shape), -columns / 400], axis=-1)
    floor = 20 * tone[..., None] * np.exp(0.5 * warm) * [1.0, 0.8, 0.6]
    known = np.ones(rows.shape, bool)
    known[100:200, 150:260] = False
    return floor.astype(np.float32), known


def test_the_leg_of_a_stool_is_no_source_of_a_floor_in_mixed_light() -> None:
    floor, known = fine_boards()
    leg = np.zeros(known.shape, bool)
    leg[110:130, 290:294] = True
    floor[leg] *= np.float32((0.8, 0.5, 0.35))
    kept = plane_sources(floor, known, FINE_PX_PER_M)
    assert not kept[leg].any()
    assert kept[known & ~leg].mean() > 0.9
    bare, _ = fine_boards()
    assert plane_sources(bare, known, FINE_PX_PER_M)[known].mean() > 0.97


def test_a_mat_a_little_bluer_than_the_floor_is_no_source() -> None:
    """A bath mat lies on small tiles: much of their colour, and 0.75 m wide."""
    floor, known = fine_boards()
    mat = np.zeros(known.shape, bool)
    mat[200:270, 290:350] = True
    floor[mat] *= np.float32((0.78, 0.97, 1.25))
    assert plane_sources(floor, known, FINE_PX_PER_M)[mat].mean() < 0.1


def test_small_islands_between_holes_are_no_sources() -> None:
    floor = boards()
    known = np.zeros(SHAPE, bool)
    known[:, :90] = True
    known[70:84, 130:146] = True
    kept = plane_sources(floor, known, PX_PER_M)
    assert not kept[:, 100:].any()
    assert kept[:, :80].mean() > 0.9


def test_with_little_seen_all_of_it_is_a_source() -> None:
    known = np.zeros(SHAPE, bool)
    known[:12, :12] = True
    assert np.array_equal(plane_sources(boards(), known, PX_PER_M), known)
    nothing = np.zeros(SHAPE, bool)
    assert not plane_sources(boards(), nothing, PX_PER_M).any()


def test_half_a_rug_leaves_no_shards_in_the_floor() -> None:
    """The furniture's mask took half a white rug: the other half is not copied into the hole."""
    floor = boards()
    floor[55:105, 90:150] = [34.0, 34.0, 33.0]
    hole = np.zeros(SHAPE, bool)
    hole[40:120, 105:180] = True
    known = ~hole
    white = floor[..., 2] > 0.8 * floor[..., 0]
    careless = complete(floor, known, hole).values
    careful = complete(floor, plane_sources(floor, known, PX_PER_M), hole).values
    shards = [float((picture[..., 2] > 0.7 * picture[..., 0])[hole].mean()) for picture in (careless, careful)]
    assert (white & known).any()
    assert shards[1] < 0.01
    assert shards[1] <= shards[0]


def test_copies_that_run_out_leave_no_dark_rim() -> None:
    """Texels left out as a hole in the sources repeat over the lattice: what fills them joins what is around."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    joint = (rows % 20 < 2) | (columns % 20 < 2)
    floor = (np.where(joint, 60.0, 100.0) * np.random.default_rng(3).normal(1, 0.01, SHAPE))[..., None]
    floor = floor.repeat(3, axis=-1).astype(np.float32)
    hole = np.zeros(SHAPE, bool)
    hole[:110] = True
    known = ~hole
    known[120:150, 60:140] = False
    found = complete(floor, known, hole).values[hole]
    assert found.min() > 45
    assert np.median(np.abs(found - floor[hole]) / floor[hole]) < 0.05
