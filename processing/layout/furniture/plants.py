"""The potted plant: a rubber fig with curved stems and broad folded leaves."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Colour, Material
from processing.layout.furniture.soft import sheets
from processing.layout.furniture.solids import circle, curve, loft, tube, turned_piece
from processing.layout.furniture.surface import Solid

SOIL = Material("soil", (0.05, 0.035, 0.025), 0.95)
BARK = Material("bark", (0.16, 0.12, 0.075), 0.85)
GREENS: tuple[Colour, ...] = ((0.045, 0.115, 0.035), (0.06, 0.15, 0.045), (0.085, 0.19, 0.06))
LEAVES = tuple(Material(f"leaf {k}", colour, 0.38) for k, colour in enumerate(GREENS))


def plant(b: Bench) -> None:
    """Build a pot with soil, stems and leaves; the size is that of the crown and the whole height."""
    w, d, h = b.size
    reach = min(w, d) / 2
    tall = float(np.clip(0.30 * h, 0.10, 0.34))
    r = min(0.62 * reach, 0.62 * tall)
    _pot(b, r, tall)
    stems = 3 if h < 1.2 else 4
    base = tall - 0.05
    long = min(0.60 * reach, 0.30, 0.34 * (h - base))
    lean = max(reach - 1.22 * long, 0.05 * reach)
    highest = h - 1.02 * long
    for k in range(stems):
        a = 2 * math.pi * (k + 0.2) / stems
        top = base + (highest - base) * (0.72, 1.0, 0.50, 0.86)[k % 4]
        line = curve(
            [
                (0.22 * r * math.cos(a), 0.22 * r * math.sin(a), base - 0.02),
                (0.5 * lean * math.cos(a + 0.3), 0.5 * lean * math.sin(a + 0.3), base + 0.5 * (top - base)),
                (lean * math.cos(a), lean * math.sin(a), top),
            ],
            9,
        )
        b.add(tube(line, list(np.linspace(0.0085, 0.004, len(line)) * min(1.6, max(h, 0.5))), 8), BARK)
        _leaves(b, line, a, long)


def _pot(b: Bench, r: float, tall: float) -> None:
    wall = 0.011
    soil = 0.88 * tall
    profile = [(0, 0), (0.72 * r, 0), (0.76 * r, 0.012), (r - 0.004, tall - 0.03), (r, tall - 0.028), (r, tall - 0.004),
               (r - 0.004, tall), (r - wall + 0.003, tall), (r - wall, tall - 0.004), (r - 1.6 * wall, soil - 0.02),
                (0, soil - 0.02)]  # fmt: skip
    b.add(turned_piece(profile, 48), b.style.pot)
    inner = r - 1.7 * wall
    heap = [circle(inner, 32, soil - 0.03), circle(inner, 32, soil - 0.004), circle(0.6 * inner, 32, soil + 0.006)]
    heap.append(circle(0.2 * inner, 32, soil + 0.012))
    b.add(loft(np.stack(heap)), SOIL)


def _leaves(b: Bench, line: Doubles, azimuth: float, longest: float) -> None:
    """Add leaves around a stem, lower ones hanging, the last one pointing up."""
    count = 15
    golden = math.pi * (3 - math.sqrt(5))
    for k in range(count):
        t = 0.24 + 0.76 * k / (count - 1)
        at = line[min(int(t * (len(line) - 1)), len(line) - 1)]
        turn = azimuth + golden * k + float(b.rng.normal(0, 0.12))
        rise = math.radians(8 + 58 * t**2 + float(b.rng.normal(0, 6)))
        long = (1.0 - 0.30 * t**3) * longest * float(b.rng.uniform(0.86, 1.0))
        leaf = _leaf(long, 0.56 * long, float(b.rng.uniform(0.25, 0.5)))
        stalk = tube([(0, 0, 0), (0, 0.12 * long, 0.02 * long), (0, 0.26 * long, 0.0)], 0.0028, 5)
        for body, material in ((leaf.moved(0, 0.22 * long, 0), LEAVES[k % 3]), (stalk, LEAVES[2])):
            b.add(body.turned("x", rise).turned("z", turn).moved(*at), material, crease_rad=math.radians(80))


def _leaf(long: float, wide: float, droop: float) -> Solid:
    """Return a leaf along +y: pointed oval, folded along its midrib, drooping to its tip, 1 mm thick."""
    m, n = 7, 9
    u, t = np.meshgrid(np.linspace(-1, 1, m), np.linspace(0, 1, n), indexing="ij")
    half = wide / 2 * np.sin(math.pi * t**0.82) ** 0.75
    x = u * half
    y = long * t
    z = 0.22 * np.abs(x) * (1 - 0.5 * t) - droop * long * t**2 * 0.55 + 0.012 * long * np.sin(9 * t) * np.abs(u)
    inner = (1 - np.abs(u)) * np.sin(math.pi * np.clip(t, 0, 1)) ** 0.5
    thick = 0.0012 * inner
    return sheets(np.stack([x, y, z + thick], -1), np.stack([x, y, z - thick], -1))
