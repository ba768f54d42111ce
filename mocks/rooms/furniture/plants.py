"""Pot plants: a bush of arching leaves, a sword plant, a small tree."""

from __future__ import annotations

import math

import numpy as np

from mocks.rooms.furniture.build import CERAMIC, FOLIAGE, SOIL, Build
from mocks.rooms.model import Material
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh, moved, turned
from processing.ground.shapes import cylinder, lathe, sheet, tube

BARK = Material("bark", (0.16, 0.115, 0.075))


def plant(b: Build) -> None:
    """Build a plant in its pot; tall ones may be small trees."""
    designs = (_bush, _swords, _tree) if b.size[2] > 0.8 else (_bush, _swords, _bush)
    designs[b.item.seed % 3](b, *_pot(b))


def _pot(b: Build) -> tuple[float, float]:
    """Add the pot with its soil; return its radius and the height of the soil."""
    w, _, h = b.size
    tall = float(np.clip(0.26 * h, 0.08, 0.34))
    r = min(0.36 * w, 0.62 * tall)
    wall = 0.06 * r
    outline = [(0.0, 0.0), (0.74 * r, 0.0), (0.80 * r, 0.02), (r, tall), (r - wall, tall), (r - 1.6 * wall, 0.8 * tall)]
    b.add(lathe([*outline, (0.0, 0.8 * tall)], 28), b.plain("pot", CERAMIC, None if b.item.seed % 2 else 0.25))
    b.add(cylinder((0, 0, 0.8 * tall), r - 1.6 * wall - 0.002, 0.1 * tall, 0.0, 20), SOIL)
    return r, 0.9 * tall


def _aimed(mesh: Mesh, rise_rad: float, azimuth_rad: float, base: Vector) -> Mesh:
    """Return a leaf that starts at a place, rising, in a direction."""
    return moved(turned(turned(mesh, (1, 0, 0), rise_rad), (0, 0, 1), azimuth_rad), base)


def _bush(b: Build, radius: float, soil: float) -> None:
    w, _, h = b.size
    green = b.plain("leaf", FOLIAGE, 0.45)
    stem = b.plain("leaf stem", FOLIAGE)
    count = 26 if h > 0.5 else 16
    for k in range(count):
        azimuth = k * 2.39996 + float(b.rng.normal(0, 0.2))
        level = (k + 0.5) / count
        reach = (w / 2) * (0.35 + 0.45 * (1 - level)) * float(b.rng.uniform(0.8, 1.0))
        top = soil + (h - soil) * (0.25 + 0.62 * level) * float(b.rng.uniform(0.9, 1.0))
        # A leaf turned by the azimuth about z points to (-sin, cos).
        out = np.array([-math.sin(azimuth), math.cos(azimuth)])
        tip = (float(out[0] * reach * 0.55), float(out[1] * reach * 0.55), top)
        foot = (float(out[0] * radius * 0.25), float(out[1] * radius * 0.25), soil - 0.01)
        middle = (0.35 * tip[0] + 0.65 * foot[0], 0.35 * tip[1] + 0.65 * foot[1], soil + 0.62 * (top - soil))
        b.add(tube([foot, middle, tip], (0.004, 0.003, 0.002), 5), stem)
        long = min(0.38 * w, 0.27 * h) * float(b.rng.uniform(0.75, 1.0))
        blade_mesh = leaf(long, long * 0.48, float(b.rng.uniform(0.7, 1.3)), 0.25)
        b.add(_aimed(blade_mesh, 0.75 * level + 0.05, azimuth, tip), green)


def _swords(b: Build, radius: float, soil: float) -> None:
    w, _, h = b.size
    green = b.plain("leaf", FOLIAGE, 0.4)
    for k in range(15):
        azimuth = k * 2.39996
        long = (h - soil) * float(b.rng.uniform(0.55, 0.98))
        lean = float(b.rng.uniform(0.02, 0.12)) * min(1.0, w / 0.4)
        mesh = blade(long, min(0.07, 0.13 * w), lean, float(b.rng.uniform(0.0, 0.2)))
        spread = radius * 0.55 * math.sqrt((k + 0.5) / 15)
        base = (-math.sin(azimuth) * spread, math.cos(azimuth) * spread, soil - 0.01)
        b.add(_aimed(mesh, 0.0, azimuth + float(b.rng.normal(0, 0.5)), base), green)


def _tree(b: Build, radius: float, soil: float) -> None:
    """Build a rubber-tree-like plant: a few stems with leaves all along their upper part."""
    w, _, h = b.size
    green = b.plain("leaf", FOLIAGE, 0.3)
    for stem in range(3):
        a = 2.1 * stem + 0.4
        top = h * (0.92 - 0.16 * stem) - 0.06
        lean = 0.13 * w * (1 + 0.5 * stem)
        foot = (0.3 * radius * math.cos(a), 0.3 * radius * math.sin(a), soil - 0.01)
        head = (foot[0] + lean * math.cos(a), foot[1] + lean * math.sin(a), top)
        bow = (0.6 * foot[0] + 0.4 * head[0], 0.6 * foot[1] + 0.4 * head[1], 0.5 * (soil + top))
        b.add(tube([foot, bow, head], (0.012, 0.010, 0.006), 8), BARK)
        count = 14 - 2 * stem
        for k in range(count):
            t = (k + 0.5) / count
            low, high = (bow, head) if t > 0.3 else (foot, bow)
            s = (t - 0.3) / 0.7 if t > 0.3 else 0.5 + t
            base = tuple(p + s * (q - p) for p, q in zip(low, high, strict=True))
            long = min(0.36 * w, 0.24) * float(b.rng.uniform(0.75, 1.0))
            mesh = leaf(long, long * 0.5, float(b.rng.uniform(0.4, 0.9)), 0.2)
            place: Vector = (base[0], base[1], base[2])
            b.add(_aimed(mesh, 0.25 + 0.6 * t, k * 2.39996 + stem, place), green)


def leaf(length_m: float, width_m: float, bend_rad: float, fold: float = 0.25, cells: int = 5) -> Mesh:
    """Return a leaf that grows from the origin along y, rising first and drooping by ``bend_rad`` over its length."""
    t = np.linspace(0.0, 1.0, cells + 1)
    angle = -bend_rad * t
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (length_m / cells)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    half = width_m / 2 * np.maximum(np.sin(math.pi * np.clip(t, 0.02, 0.985) ** 0.75), 0.03)
    across = np.array([-1.0, 0.0, 1.0])
    x = half[:, None] * across
    y = np.broadcast_to(line[:, :1], x.shape)
    z = line[:, 1:] + fold * half[:, None] * np.abs(across)
    surface = np.stack([x, y, z], axis=-1).transpose(1, 0, 2)
    return sheet(surface, 0.0012)


def blade(length_m: float, width_m: float, lean_rad: float, bend_rad: float, cells: int = 6) -> Mesh:
    """Return an upright sword leaf: wide in the middle, pointed, leaning and bending towards y."""
    t = np.linspace(0.0, 1.0, cells + 1)
    angle = math.pi / 2 - lean_rad - bend_rad * t
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (length_m / cells)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    half = width_m / 2 * np.clip(np.minimum(0.55 + t, (1.0 - t) * 2.2), 0.03, 1.0)
    x = half[:, None] * np.array([-1.0, 0.0, 1.0])
    surface = np.stack([x, np.broadcast_to(line[:, :1], x.shape), np.broadcast_to(line[:, 1:], x.shape)], axis=-1)
    return sheet(surface.transpose(1, 0, 2), 0.002)
