"""Cloth that designs cannot say in their shapes: cushions, duvets and pillows; and the moulded back of a chair."""

import math
from collections.abc import Callable

import numpy as np

from mocks.rooms.furniture.build import SIZES, Build
from mocks.rooms.model import Material
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles
from processing.ground.mesh import moved, turned
from processing.ground.shapes import deformed, pillow, rounded_box, sheet


def leaning_cushion(b: Build, _role: str) -> None:
    """Add a cushion that leans back towards +y by the option ``lean`` (radians from upright, pi/2 lying)."""
    w, _, h = b.size
    lean = b.option("lean", 0.35)
    side = min(w, (h - 0.10 * math.sin(lean)) / max(math.cos(lean), 0.25))
    thick = 0.15
    mesh = turned(pillow((w, side, thick)), (1, 0, 0), math.pi / 2 - lean)
    low = float(mesh.vertices[:, 2].min())
    middle = (mesh.vertices[:, 1].min() + mesh.vertices[:, 1].max()) / 2
    cloth = b.pick(b.finish.second_fabric, b.finish.rug, b.finish.curtain, b.finish.bedding)
    b.add(moved(mesh, (0.0, -float(middle), -low)), cloth)


def duvet(b: Build, cloth: Material, mattress: float, front: float, long: float, top: float) -> None:
    """Add the duvet on a mattress of this width.

    It has soft folds on top, hangs over both sides and the foot, and is round at the corners.
    """
    hang, thick, edge = 0.19, 0.05, 0.03
    half, flat = mattress / 2 - edge, long - edge
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
        return np.stack([px, py + front + long, drop + top], axis=1)

    b.add(deformed(slab, lay), cloth)


def _over_edge(over: Doubles, z: Doubles, radius: float) -> tuple[Doubles, Doubles]:
    """Return height and way out of cloth points that lie ``over`` beyond a round edge and ``z`` above the bed."""
    angle = np.minimum(over / radius, math.pi / 2)
    rest = np.maximum(over - radius * math.pi / 2, 0.0)
    reach = radius + z
    return reach * np.cos(angle) - radius - rest, reach * np.sin(angle)


def pillows(b: Build, cloth: Material, mattress: float, head: float, top: float) -> None:
    """Add pillows at the head: one for each sleeper, on wide beds a second row leaning."""
    sleepers = 2 if mattress > 1.25 else 1
    wide = min(0.72, mattress / sleepers - 0.06)
    for k in range(sleepers):
        x = (k - (sleepers - 1) / 2) * (mattress / sleepers) + float(b.rng.normal(0, 0.012))
        soft = pillow((wide, 0.46, 0.16))
        lying: Vector = (x, head - 0.26, top + 0.065)
        b.add(moved(turned(soft, (0, 0, 1), float(b.rng.normal(0, 0.05))), lying), cloth, "pillow")
        if b.item.seed % 2:
            steep = turned(pillow((wide * 0.8, 0.42, 0.15)), (1, 0, 0), 1.0)
            b.add(moved(steep, (x + float(b.rng.normal(0, 0.02)), head - 0.28, top + 0.27)), b.finish.bedding, "pillow")


def moulded_back(b: Build, shell: Material) -> None:
    """Add the back of a chair, moulded in two directions."""
    w, d, h = b.size
    seat = SIZES["SEAT"]
    rows, columns = 9, 11
    t, s = np.meshgrid(np.linspace(0, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    narrow = 1 - 0.22 * t**3 * np.abs(s) ** 0.5
    x = s * (w / 2 - 0.01) * narrow
    z = seat - 0.012 + t * (h - seat) * (1 - 0.10 * s**4)
    y = d / 2 - 0.095 + 0.065 * t**1.3 - 0.055 * s**2 * (1 - 0.5 * t)
    b.add(sheet(np.stack([x, y, z], axis=-1).transpose(1, 0, 2), 0.010), shell)


VERBS: dict[str, Callable[..., None]] = {one.__name__: one for one in (leaning_cushion, duvet, pillows, moulded_back)}
