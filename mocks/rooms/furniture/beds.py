"""Beds: frame, headboard, mattress, duvet, pillows, now and then a throw."""

from __future__ import annotations

import math

import numpy as np

from mocks.rooms.furniture.build import Build
from mocks.rooms.model import Material
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles
from processing.ground.mesh import Mesh, moved, turned
from processing.ground.shapes import beam, cylinder, deformed, pad, pillow, rounded_box

# Cloth by itself: rugs, cushions, blankets.


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
    """Build a blanket folded in three."""
    w, d, h = b.size
    cloth = b.pick(b.finish.second_fabric, b.finish.curtain, b.finish.rug)
    for k in range(3):
        z, inset = h * k / 3, 0.006 * float(b.rng.random())
        low, high = (-w / 2 + inset, -d / 2 + inset, z), (w / 2 - inset, d / 2, z + h / 3)
        b.add(rounded_box(low, high, 0.45 * h / 3, 2), cloth)


SHEET = Material("bed sheet", (0.80, 0.79, 0.76))


def bed(b: Build) -> None:
    """Build a bed, its head at +y; size is the whole bed's, the height the headboard's."""
    w, d, h = b.size
    timber, upholstered = b.timber(), b.item.seed % 3 == 0
    rail_top, board = 0.34, 0.05 if not upholstered else 0.09
    _frame(b, timber, rail_top, board)
    if upholstered:
        b.add(pad((-w / 2, d / 2 - board, 0.02), (w / 2, d / 2, h), 0.03, 0.012), b.finish.second_fabric)
    elif b.item.seed % 3 == 1:
        b.block((-w / 2, d / 2 - board, 0.15), (w / 2, d / 2, h), timber, 0.006)
    else:
        _slatted_head(b, timber, h)
    mattress = (w - 0.15, d - board - 0.12, 0.20)
    low = rail_top - 0.06
    front = -d / 2 + 0.10
    b.add(pad((-mattress[0] / 2, front, low), (mattress[0] / 2, front + mattress[1], low + 0.20), 0.04, 0.006), SHEET)
    top = low + 0.195
    b.add(_duvet(b, mattress[0], front, mattress[1] * float(b.rng.uniform(0.70, 0.78)), top), b.finish.bedding)
    _pillows(b, mattress[0], front + mattress[1], top)


def _frame(b: Build, timber: Material, rail_top: float, board: float) -> None:
    w, d, _ = b.size
    for side in (-1, 1):
        x = side * (w / 2 - 0.015)
        b.block((x - 0.015, -d / 2 + 0.01, 0.17), (x + 0.015, d / 2 - board, rail_top), timber)
        for y in (-d / 2 + 0.04, d / 2 - board - 0.04):
            b.bar((x * 0.97, y, 0.0), (x * 0.97, y, 0.18), 0.05, 0.05, timber)
    b.block((-w / 2, -d / 2, 0.17), (w / 2, -d / 2 + 0.03, rail_top), timber)


def _slatted_head(b: Build, timber: Material, height: float) -> None:
    """Add a headboard of posts, two rails and upright slats."""
    w, d, _ = b.size
    y = d / 2 - 0.025
    for side in (-1, 1):
        b.bar((side * (w / 2 - 0.03), y, 0.0), (side * (w / 2 - 0.03), y, height), 0.05, 0.05, timber)
    for z in (0.5, height - 0.04):
        b.bar((-w / 2 + 0.05, y, z), (w / 2 - 0.05, y, z), 0.03, 0.06, timber)
    for x in np.linspace(-w / 2 + 0.12, w / 2 - 0.12, max(5, int(w / 0.13))):
        b.add(beam((float(x), y, 0.52), (float(x), y, height - 0.06), 0.03, 0.018), timber)


def _duvet(b: Build, mattress_w: float, front: float, length: float, top: float) -> Mesh:
    """Return the duvet: soft folds on top, hanging over both sides and the foot, round at the corners."""
    hang, thick, edge = 0.19, 0.05, 0.03
    half, flat = mattress_w / 2 - edge, length - edge
    slab = rounded_box((-half - hang, -flat - hang, 0.0), (half + hang, 0.0, thick), 0.02, 2, (18, 16, 1))
    waves = [
        (b.rng.normal(0.0, 4.0, 2), float(b.rng.uniform(0, 6.3)), float(b.rng.uniform(0.003, 0.006))) for _ in range(6)
    ]

    def lay(v: Doubles) -> Doubles:
        x, y, z = v.T
        folds = sum((a * np.sin(x * k[0] + y * k[1] + p) for k, p, a in waves), np.zeros(len(v)))
        over_x, over_y = np.maximum(np.abs(x) - half, 0.0), np.maximum(-y - flat, 0.0)
        over, reach = (over_x**6 + over_y**6) ** (1 / 6), np.maximum(np.hypot(over_x, over_y), 1e-9)
        folds = 0.015 * np.tanh(folds / 0.015)
        z = z + np.where(z > thick / 2, (folds + 0.012) * (1 - 0.6 * np.minimum(over / 0.06, 1.0)), 0.0)
        drop, out = _over_edge(over, z, edge)
        ripple = 0.010 * np.sin(15.0 * (y - x) + waves[0][1]) * np.clip(np.abs(over_x - over_y) / 0.15, 0.0, 1.0) ** 2
        out = out + ripple
        px = np.sign(x) * (np.minimum(np.abs(x), half) + out * over_x / reach)
        py = np.maximum(y, -flat) - out * over_y / reach
        return np.stack([px, py + front + length, drop + top], axis=1)

    return deformed(slab, lay)


def _over_edge(over: Doubles, z: Doubles, radius: float) -> tuple[Doubles, Doubles]:
    """Return height and way out of cloth points that lie ``over`` beyond a round edge and ``z`` above the bed."""
    angle = np.minimum(over / radius, math.pi / 2)
    rest = np.maximum(over - radius * math.pi / 2, 0.0)
    reach = radius + z
    return reach * np.cos(angle) - radius - rest, reach * np.sin(angle)


def _pillows(b: Build, mattress_w: float, head: float, top: float) -> None:
    """Add pillows at the head: one for each sleeper, on wide beds a second row leaning."""
    sleepers = 2 if mattress_w > 1.25 else 1
    wide = min(0.72, mattress_w / sleepers - 0.06)
    for k in range(sleepers):
        x = (k - (sleepers - 1) / 2) * (mattress_w / sleepers) + float(b.rng.normal(0, 0.012))
        soft = pillow((wide, 0.46, 0.16))
        lying: Vector = (x, head - 0.26, top + 0.065)
        b.add(moved(turned(soft, (0, 0, 1), float(b.rng.normal(0, 0.05))), lying), SHEET, "pillow")
        if b.item.seed % 2:
            leaning = turned(pillow((wide * 0.8, 0.42, 0.15)), (1, 0, 0), 1.0)
            b.add(
                moved(leaning, (x + float(b.rng.normal(0, 0.02)), head - 0.28, top + 0.27)), b.finish.bedding, "pillow"
            )
