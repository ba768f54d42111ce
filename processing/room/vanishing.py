"""The three axes of a room from its straight edges: where on the sphere parallel edges meet.

An edge parallel to an axis lies on a great circle that goes through the axis: its normal is square to it. The axes are
searched for (a vertical near the zenith from pairs of arcs, then an azimuth), judged by all arcs together, and refined
by weighted least squares on the rotation. What is left out sector by sector tells how far the answer may be off.
"""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.room.lines import Arcs


MOST_TILT_RAD = math.radians(40)
"""Of the camera: beyond 45 degrees no one can tell the vertical from the walls' horizontals."""
SEARCH_RAD, FINE_RAD = math.radians(1.2), math.radians(0.5)
"""How far edges of a real room may be off their axis: while searching, and at the end."""
LONGEST_RAD = math.radians(40)
"""An arc counts by its length, up to this."""
PAIRS, KEPT, FEWEST = 1500, 8, 12
"""Pairs drawn for the vertical, candidates that are looked at closely, and fewest arcs."""
AZIMUTH_STEPS = 120
SECTORS = 12
APART_RAD = math.radians(1.5)
TILT_COST = 0.3
"""Of merit, for one radian of tilt, squared."""


@dataclass(frozen=True)
class Axes:
    """The axes that most edges obey."""

    rows: Doubles
    """(3, 3): right-handed, two horizontal axes and the vertical, in the panorama's world."""
    covariance: Doubles
    """(3, 3): of small turns (rad) about the three axes."""
    excess: Doubles
    """(3,): what share of the length of all arcs lies along each axis, beyond what would by chance."""
    length_rad: float
    """Of all arcs, those too short to tell an axis discounted."""


def find_axes(arcs: Arcs, *, most_tilt_rad: float = MOST_TILT_RAD) -> Axes | None:
    """Return the three axes, or None where fewer than `FEWEST` arcs are there to tell."""
    if len(arcs.length_rad) < FEWEST:
        return None
    worth = np.minimum(arcs.length_rad, LONGEST_RAD)
    candidates = _verticals(arcs, worth, most_tilt_rad)
    started = [_refined(arcs, worth, _with_azimuth(arcs, worth, one), SEARCH_RAD, 8) for one in candidates]
    rows = max(started, key=lambda one: _merit(arcs, worth, one))
    for spread in (0.8 * SEARCH_RAD, FINE_RAD):
        rows = _refined(arcs, worth, rows, spread, 8)
    rows = _canonical(rows)
    return Axes(rows, _jackknife(arcs, worth, rows), *_excess(arcs, worth, rows, FINE_RAD))


def _spread(arcs: Arcs, of_room_rad: float) -> Doubles:
    return np.hypot(arcs.sigma_rad, of_room_rad)


def _verticals(arcs: Arcs, worth: Doubles, most_tilt_rad: float) -> Doubles:
    """Return up to `KEPT` directions (k, 3) through which many arcs go, none near another, and the zenith itself."""
    steep = np.flatnonzero(np.abs(arcs.normals[:, 2]) < math.sin(most_tilt_rad))
    zenith = np.array([[0.0, 0.0, 1.0]])
    if steep.size < 2:
        return zenith
    rng = np.random.default_rng(7)
    one, other = rng.choice(steep, (2, PAIRS), p=worth[steep] / worth[steep].sum())
    crossing = np.cross(arcs.normals[one], arcs.normals[other])
    size = np.linalg.norm(crossing, axis=1)
    crossing = crossing[size > math.sin(math.radians(5))] / size[size > math.sin(math.radians(5)), None]
    crossing *= np.where(crossing[:, 2:] < 0, -1.0, 1.0)
    crossing = np.concatenate([zenith, crossing[crossing[:, 2] > math.cos(most_tilt_rad)]])
    off = (crossing @ arcs.normals[steep].T) / _spread(arcs, SEARCH_RAD)[steep]
    score = np.exp(-0.5 * off**2) @ worth[steep]
    kept: list[int] = []
    for index in np.argsort(-score):
        if all(crossing[index] @ crossing[k] < math.cos(APART_RAD) for k in kept):
            kept.append(int(index))
        if len(kept) == KEPT:
            break
    return np.asarray(crossing[kept])


def _with_azimuth(arcs: Arcs, worth: Doubles, vertical: Doubles) -> Doubles:
    """Return the best axes (3, 3) with a vertical."""
    first = np.cross([0.0, 1.0, 0.0], vertical)
    first /= np.linalg.norm(first)
    second = np.cross(vertical, first)
    spread = _spread(arcs, SEARCH_RAD)
    along = (arcs.normals @ np.stack([first, second, vertical]).T) / spread[:, None]
    angle = np.arange(AZIMUTH_STEPS) * (math.pi / 2 / AZIMUTH_STEPS)
    cosine, sine = np.cos(angle), np.sin(angle)
    x = np.outer(along[:, 0], cosine) + np.outer(along[:, 1], sine)
    y = np.outer(along[:, 1], cosine) - np.outer(along[:, 0], sine)
    nearest = np.minimum(np.minimum(x**2, y**2), along[:, 2:] ** 2)
    best = int((worth @ np.exp(-0.5 * nearest)).argmax())
    ahead = first * cosine[best] + second * sine[best]
    return np.stack([ahead, np.cross(vertical, ahead), vertical])


def _merit(arcs: Arcs, worth: Doubles, rows: Doubles) -> float:
    """Return how well axes explain the arcs, each axis by itself: planks, however many, are evidence of one axis only.

    Of nearly equal ones the less tilted wins.
    """
    excess, _ = _excess(arcs, worth, rows, SEARCH_RAD)
    return float(np.sqrt(np.maximum(excess, 0.0)).sum()) - TILT_COST * float(np.arccos(min(1.0, abs(rows[2, 2])))) ** 2


def _refined(arcs: Arcs, worth: Doubles, rows: Doubles, of_room_rad: float, steps: int) -> Doubles:
    """Return axes after a few steps of weighted least squares; each arc follows its nearest axis."""
    spread = _spread(arcs, of_room_rad)
    for _ in range(steps):
        off = arcs.normals @ rows.T
        axis = np.abs(off).argmin(axis=1)
        residual = off[np.arange(len(off)), axis]
        weight = worth / spread**2 * np.exp(-0.5 * (residual / spread) ** 2)
        slope = np.cross(rows[axis], arcs.normals)
        normal = (slope * weight[:, None]).T @ slope
        # What no arc tells stays as it is.
        normal += np.eye(3) * 1e-6 * max(np.trace(normal), 1e-30)
        turn = -np.linalg.solve(normal, slope.T @ (weight * residual))
        rows = rows @ rotation_about(turn).T
        if np.linalg.norm(turn) < 1e-7:
            break
    return rows


def _jackknife(arcs: Arcs, worth: Doubles, rows: Doubles) -> Doubles:
    """Return the covariance of turns about the axes: all arcs of a sector around the vertical are left out in turn."""
    sector = _sector(arcs, rows)
    turns = []
    for left_out in range(SECTORS):
        kept = np.where(sector == left_out, 0.0, worth)
        turn = rotation_vector(_refined(arcs, kept, rows, FINE_RAD, 3).T @ rows)
        turns.append(rows @ turn)
    off = np.array(turns) - np.mean(turns, axis=0)
    return np.asarray((SECTORS - 1) / SECTORS * off.T @ off)


def _sector(arcs: Arcs, rows: Doubles) -> npt.NDArray[np.intp]:
    seen = arcs.middles @ rows.T
    turn = np.arctan2(seen[:, 0], seen[:, 1]) / (2 * math.pi) + 0.5
    return np.asarray(np.minimum((turn * SECTORS).astype(np.intp), SECTORS - 1))


def _excess(arcs: Arcs, worth: Doubles, rows: Doubles, of_room_rad: float) -> tuple[Doubles, float]:
    within = 2 * _spread(arcs, of_room_rad)
    chance = np.minimum(np.sin(np.minimum(within, math.pi / 2)), 1 / 3)
    telling = worth * (1 - 3 * chance)
    off = np.abs(arcs.normals @ rows.T)
    axis = np.where(off.min(axis=1) < within, off.argmin(axis=1), -1)
    total = float(telling.sum())
    along = np.array([telling[axis == k].sum() for k in range(3)]) - float((telling * chance).sum())
    return along / max(total, 1e-9), total


def _canonical(rows: Doubles) -> Doubles:
    """Return the same axes, the vertical up, the first within 45 degrees of +y's side, right-handed."""
    vertical = rows[2] * (1.0 if rows[2, 2] >= 0 else -1.0)
    first, second = rows[0], rows[1]
    choices = [first, -first, second, -second]
    ahead = max(choices, key=lambda one: float(one[1]))
    return np.stack([np.cross(ahead, vertical), ahead, vertical])


def rotation_about(vector: Doubles) -> Doubles:
    """Return the matrix (3, 3) of a turn about an axis by its length (rad), right-handed."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


def rotation_vector(matrix: Doubles) -> Doubles:
    """Return the axis times angle (rad) of a rotation below pi."""
    twice = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine = float(np.linalg.norm(twice)) / 2
    angle = math.atan2(sine, (float(np.trace(matrix)) - 1) / 2)
    return np.asarray(twice / 2 * (angle / sine if sine > 1e-12 else 1.0))
