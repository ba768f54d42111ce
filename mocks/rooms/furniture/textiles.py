"""Cloth by itself: rugs, cushions, blankets."""

from __future__ import annotations

import math

import numpy as np

from mocks.rooms.furniture.build import Build
from mocks.rooms.mesh import Mesh
from mocks.rooms.shapes import cylinder, moved, rounded_box, turned
from mocks.rooms.soft_shapes import draped, pillow


def rug(b: Build) -> None:
    """Build a rug, round with the option ``round``."""
    w, d, h = b.size
    if b.option("round", 0.0):
        b.add(cylinder((0, 0, 0), w / 2, h, 0.004, 64), b.finish.rug)
    else:
        b.add(rounded_box((-w / 2, -d / 2, 0.0), (w / 2, d / 2, h), 0.004), b.finish.rug)


def cushion(b: Build) -> None:
    """Build a cushion that leans back towards +y by the option ``lean`` (radians from upright, pi/2 lying)."""
    w, _, h = b.size
    lean = b.option("lean", 0.35)
    side = min(w, (h - 0.10 * math.sin(lean)) / max(math.cos(lean), 0.25))
    thick = 0.15
    mesh = turned(pillow((w, side, thick)), (1, 0, 0), math.pi / 2 - lean)
    low = float(mesh.vertices[:, 2].min())
    middle = (mesh.vertices[:, 1].min() + mesh.vertices[:, 1].max()) / 2
    cloth = b.pick(b.finish.second_fabric, b.finish.rug, b.finish.curtain, b.finish.bedding)
    b.add(moved(mesh, (0.0, -float(middle), -low)), cloth)


def blanket(b: Build) -> None:
    """Build a folded blanket; with the option ``drop`` (metres) its front part hangs over an edge, below z = 0."""
    w, d, h = b.size
    cloth = b.pick(b.finish.second_fabric, b.finish.curtain, b.finish.rug)
    drop = b.option("drop", 0.0)
    if drop == 0.0:
        for k in range(3):
            z = h * k / 3
            inset = 0.006 * float(b.rng.random())
            b.add(
                rounded_box((-w / 2 + inset, -d / 2 + inset, z), (w / 2 - inset, d / 2, z + h / 3), 0.45 * h / 3, 2),
                cloth,
            )
        return
    b.add(_hanging(b, drop), cloth)


def _hanging(b: Build, drop: float) -> Mesh:
    """Return a band of cloth: flat from the rear edge to the front edge, then down."""
    w, d, _ = b.size
    bend, edge = 0.03, -d / 2 + 0.03
    flat = [(y, 0.012) for y in np.linspace(d / 2, edge, 8)]
    arc = [(edge - bend * math.sin(a), 0.012 - bend + bend * math.cos(a)) for a in np.linspace(0.2, math.pi / 2, 6)]
    down = [(edge - bend, z) for z in np.linspace(-bend - 0.01, -drop, 7)]
    folds = 0.005 * np.sin(np.linspace(0, 9, 25) + b.rng.uniform(0, 6)) + 0.004
    # Front to back reversed: the upper side must lie to the path's left.
    return draped([(y, z) for y, z in reversed([*flat, *arc, *down])], -w / 2, w / 2, 0.007, folds)
