"""What hangs at windows: curtains on their rods, roller and venetian blinds."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math

import numpy as np

from mocks.rooms.mesh import Mesh, Part, box
from mocks.rooms.model import Finish, Fixture, Role
from mocks.rooms.shapes import ball, cylinder, rounded_box, tube, turned
from mocks.rooms.shell_faces import part_of, repeated
from mocks.rooms.soft_shapes import sheet

ROD_AWAY_M = 0.075
BLIND_AWAY_M = 0.05
"""How deep in the reveal a blind hangs."""
SLAT_M = 0.025
SLAT_PITCH_M = 0.0215
STACK_PITCH_M = 0.0035
STACKED_BELOW_M = 0.3
"""A venetian blind no longer than this is drawn up."""


def curtain(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return cloth in folds that widen downwards, gathered at the top, hanging from the rod."""
    rng = np.random.default_rng([fixture.seed, 11])
    pitch = float(rng.uniform(0.065, 0.095))
    folds = max(3, round(fixture.width_m / pitch))
    columns, rows = 10 * folds + 1, 16
    across = np.linspace(0.0, 1.0, columns)
    phase = 2 * math.pi * np.interp(across, np.linspace(0, 1, folds + 1), _uneven(rng, folds) * folds)
    second = phase + np.interp(across, np.linspace(0, 1, folds + 1), rng.uniform(-1.2, 1.2, folds + 1))
    down = np.linspace(0.0, 1.0, rows)[:, None]
    turn = phase + (second - phase) * down**1.5
    deep = 0.017 + 0.02 * np.sqrt(down)
    y = ROD_AWAY_M - 0.002 + deep * np.sin(turn) + 0.006 * down * np.sin(0.5 * turn + rng.uniform(0, 6))
    inner = fixture.width_m - 0.02
    x = fixture.start_m + 0.01 + inner * across[None, :] + 0.006 * np.cos(turn) * np.sqrt(down)
    sway = 0.012 * down * np.sin(math.pi * across)[None, :] * float(rng.uniform(-1, 1))
    z = fixture.bottom_m + fixture.height_m * (1.0 - down) + 0.0 * across
    grid = np.stack([x + sway, y, z], axis=-1)
    cloth = sheet(_facing_room(grid), 0.0025)
    return [part_of(cloth, finish.curtain, "curtain", "curtain", Role.FIXTURE)]


def _uneven(rng: np.random.Generator, folds: int) -> Doubles:
    """Return where each fold ends, 0..1, of somewhat different widths."""
    widths = rng.uniform(0.75, 1.25, folds)
    return np.concatenate([[0.0], np.cumsum(widths) / widths.sum()])


def _facing_room(grid: Doubles) -> Doubles:
    """Return the grid of points ordered so that its first normal looks along +y."""
    return grid if np.cross(grid[1, 0] - grid[0, 0], grid[0, -1] - grid[0, 0])[1] > 0 else grid[:, ::-1]


def curtain_rod(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return the rod with a finial at each end and its brackets."""
    x0, x1, z = fixture.start_m, fixture.start_m + fixture.width_m, fixture.bottom_m + fixture.height_m / 2
    meshes = [tube([(x0 + 0.02, ROD_AWAY_M, z), (x1 - 0.02, ROD_AWAY_M, z)], 0.0125, 14)]
    for x in (x0 + 0.02, x1 - 0.02):
        meshes.append(ball((x, ROD_AWAY_M, z), 0.021))
    for x in (x0 + 0.05, x1 - 0.05):
        meshes.append(tube([(x, 0.0, z), (x, ROD_AWAY_M, z)], 0.007))
        meshes.append(turned(cylinder((x, 0.0, z), 0.022, 0.006, 0.002), (1.0, 0.0, 0.0), -math.pi / 2, (x, 0.0, z)))
    return [part_of(meshes, finish.metal, "curtain", "curtain", Role.FIXTURE)]


def roller_blind(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return the roll under the head of the window, its cloth and the bar at the end."""
    x0, x1 = fixture.start_m + 0.008, fixture.start_m + fixture.width_m - 0.008
    top, bottom, y = fixture.bottom_m + fixture.height_m, fixture.bottom_m, -BLIND_AWAY_M
    roll = tube([(x0, y, top - 0.024), (x1, y, top - 0.024)], 0.022, 18)
    cloth = box((x0 + 0.01, y + 0.0205, bottom), (x1 - 0.01, y + 0.022, top - 0.024))
    bar = rounded_box((x0 + 0.008, y + 0.014, bottom - 0.002), (x1 - 0.008, y + 0.028, bottom + 0.022), 0.005, 2)
    ends = [box((x - 0.006, y - 0.025, top - 0.05), (x + 0.006, y + 0.025, top)) for x in (x0, x1)]
    return [
        part_of([roll, cloth, bar], finish.curtain, "blind", "blind", Role.FIXTURE),
        part_of(ends, finish.metal, "blind", "blind", Role.FIXTURE),
    ]


def venetian_blind(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return head rail, slats (tilted, or stacked where the blind is drawn up), cords and bottom rail."""
    rng = np.random.default_rng([fixture.seed, 12])
    x0, x1 = fixture.start_m + 0.006, fixture.start_m + fixture.width_m - 0.006
    top, bottom, y = fixture.bottom_m + fixture.height_m, fixture.bottom_m, -BLIND_AWAY_M
    tilt = math.radians(float(rng.uniform(10.0, 55.0)))
    stacked = fixture.height_m < STACKED_BELOW_M
    pitch = STACK_PITCH_M if stacked else SLAT_PITCH_M
    rails = [
        rounded_box((x0, y - 0.014, top - 0.03), (x1, y + 0.014, top), 0.002),
        rounded_box((x0, y - 0.012, bottom), (x1, y + 0.012, bottom + 0.012), 0.004),
    ]
    places = np.arange(bottom + 0.012 + pitch, top - 0.03 - SLAT_M / 3, pitch)
    moves = np.stack([np.zeros_like(places), np.zeros_like(places), places], axis=1)
    slats = [repeated(_slat(x0 + 0.004, x1 - 0.004, y, 0.0 if stacked else tilt), moves)] if len(places) else []
    cords = [tube([(x, y, bottom), (x, y, top - 0.02)], 0.001, 6) for x in (x0 + 0.12, x1 - 0.12)]
    return [part_of([*rails, *slats, *cords], finish.window_frame, "blind", "blind", Role.FIXTURE)]


def _slat(x0: float, x1: float, y: float, tilt_rad: float) -> Mesh:
    slat = box((x0, y - SLAT_M / 2, -0.0004), (x1, y + SLAT_M / 2, 0.0004))
    return turned(slat, (1.0, 0.0, 0.0), tilt_rad, (x0, y, 0.0))
