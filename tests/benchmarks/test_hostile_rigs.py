"""Hostile rigs: copies of lenses are what they say, draws repeat, and the truth knows what the frames are made of."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.hostile.rigs import FisheyeCopy, HostileBody, hostile_bodies
from benchmarks.sessions import BODIES, Taken, write_session
from mocks.optics.lenses import EquisolidFisheye
from mocks.worlds.light import UniformWorld
from processing.rig.camera_fit import read_side
from station.session.session import Side

LIGHT = np.linspace(0, 1, 256)
CURVES = (LIGHT, [np.stack([LIGHT ** (1 / g) for g in (2.0, 2.2, 2.4)])])
SIZE = (702, 468)
COPY = FisheyeCopy(bend=0.01, circle=(0.006, -0.004), axis=(-0.003, 0.005))


def middles() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    return x.astype(np.float32), y.astype(np.float32)


def test_a_copy_sees_each_direction_where_it_draws_it() -> None:
    for way in ((0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (-0.48, 0.6, 0.64), (0.0, -0.995, math.sqrt(1 - 0.995**2))):
        place = COPY.pixel_of(way, SIZE)
        assert place is not None
        found, seen = COPY.directions(*(np.array([v]) for v in place), SIZE)
        assert seen.all()
        assert np.allclose(found[0], way, atol=2e-4)
        assert int(place[1]) in COPY.rows_near(way, 0.01, SIZE)


def test_a_copy_s_pixels_are_the_half_sphere_and_differ_from_the_usual_lens() -> None:
    x, y = middles()
    whole = COPY.solid_angle_sr(x, y, SIZE).sum()
    assert whole == pytest.approx(2 * math.pi, rel=0.01)
    usual = EquisolidFisheye().pixel_of((0.6, 0.0, 0.8), SIZE)
    mine = COPY.pixel_of((0.6, 0.0, 0.8), SIZE)
    assert usual is not None
    assert mine is not None
    assert math.dist(usual, mine) > 1
    assert FisheyeCopy().pixel_of((0.6, 0.0, 0.8), SIZE) == pytest.approx(usual)


def test_a_copy_s_circle_is_round_about_its_own_middle() -> None:
    x, y = middles()
    lit = COPY.falloff(x, y, SIZE) > 0
    radius = math.sqrt(lit.sum() / math.pi)
    place = ((x[lit].min() + x[lit].max()) / 2 - SIZE[0] / 2, SIZE[1] / 2 - (y[lit].min() + y[lit].max()) / 2)
    assert place == pytest.approx((0.006 * radius, -0.004 * radius), abs=0.6)


def test_rigs_are_drawn_by_seed() -> None:
    one, again, other = (hostile_bodies(CURVES, seed) for seed in (800_001, 800_001, 800_002))
    for side in Side:
        assert one[side].optics == again[side].optics
        assert one[side].optics.lens not in (other[side].optics.lens, BODIES[side].optics.lens)
    assert one[Side.OUTDOOR].optics.filter != other[Side.OUTDOOR].optics.filter


def test_the_true_curve_is_that_of_the_frames(tmp_path: Path) -> None:
    """An even field: the merged value's green is the light, by the exposure and the curve that the body states."""
    body = hostile_bodies(CURVES, 800_001)[Side.OUTDOOR]
    assert isinstance(body, HostileBody)
    stops_s = (4.0, 2.0, 1.0, 0.5, 0.25)
    taken = Taken(UniformWorld(20_000.0), 24, (Side.OUTDOOR,), stops_s=stops_s, seed=1, bodies={Side.OUTDOOR: body})
    side = read_side(write_session(tmp_path / "flat", taken), Side.OUTDOOR)
    assert side is not None
    frames = side.bracket(stops_s).frames
    middle = tuple(n // 2 for n in frames[0].shape[:2])
    curve = body.log2_exposure()[1]
    sensor, usual = body.optics.sensor, body.optics.usual_settings
    for time_s, frame in zip(stops_s, frames, strict=True):
        code = float(np.asarray(frame)[middle[0] - 4 : middle[0] + 4, middle[1] - 4 : middle[1] + 4, 1].mean())
        if 30 < code < 220:
            shown = 2 ** float(np.interp(code, np.arange(256), curve))
            due = 20_000 * 10**-body.optics.filter.density * sensor.exposure_gain(usual) * time_s
            assert shown / due == pytest.approx(1, abs=0.25)
