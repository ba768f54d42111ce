"""The potted plant: a rubber fig with curved stems and broad folded leaves."""

from __future__ import annotations

import math

import numpy as np

from processing.ground.arrays import Bytes, Doubles
from processing.ground.colour import srgb_of_linear
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Colour, Material
from processing.layout.furniture.soft import sheets
from processing.layout.furniture.solids import circle, curve, loft, rounded_rectangle, slab, tube, turned_piece
from processing.layout.furniture.styles import noise
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


# The rug: a woven pattern and fringes.


FRINGE_M = 0.05


def rug(b: Bench) -> None:
    """Build a rug with a woven pattern and, where it is long enough, fringes at both ends."""
    w, d, h = b.size
    fringe = FRINGE_M if w > 0.8 else 0.0
    picture = rug_pattern(b.style.rug, w - 2 * fringe, d)
    body = slab(w - 2 * fringe, d, 0.0, h, corner_m=0.02, edge_m=min(0.004, 0.4 * h), steps=3)
    uv = (body.rest[body.faces][..., :2] + np.array([w / 2 - fringe, d / 2])) / np.array([w - 2 * fringe, d])
    b.add(body, Material("rug", (1.0, 1.0, 1.0), 0.95, texture=picture), uv=uv)
    if not fringe:
        return
    yarn = Material("fringe", tuple(0.95 * c for c in b.style.rug[0]), 0.95)  # type: ignore[arg-type]
    count = round(d / 0.018)
    thick = min(0.006, 0.6 * h)
    for side in (-1, 1):
        for k in range(count):
            y = -d / 2 + (k + 0.5) * d / count
            sway, long = b.rng.normal(0, 0.003), fringe * (1.0 if k % 7 == 3 else b.rng.uniform(0.82, 1.0))
            rows = []
            for t, s in ((-0.05, 0.8), (0.12, 0.6), (0.3, 0.8), (1.0, 0.55)):
                ring = rounded_rectangle(0.010 * s, thick * s, 0.002, steps=0)
                x = w / 2 - fringe + long * t
                rows.append(
                    np.column_stack([np.full(len(ring), x), ring[:, 0] + y + sway * t * 3, ring[:, 1] + thick / 2])
                )
            one = loft(np.stack(rows))
            b.add(one if side > 0 else one.mirrored(), yarn)


def rug_pattern(colours: tuple[Colour, Colour, Colour], width_m: float, depth_m: float) -> Bytes:
    """Return a rug's picture: a bordered field of lozenges between lines, in uneven wool."""
    scale = min(400.0, 900.0 / max(width_m, depth_m))
    cols, rows = max(16, round(width_m * scale)), max(16, round(depth_m * scale))
    y, x = np.meshgrid((np.arange(rows) + 0.5) / scale, (np.arange(cols) + 0.5) / scale, indexing="ij")
    wobble = 0.004 * noise((rows, cols), (40, 40), 2)
    edge = np.minimum(np.minimum(x, width_m - x), np.minimum(y, depth_m - y)) + wobble
    nx, ny = max(2, round((width_m - 0.3) / 0.34)), max(2, round((depth_m - 0.3) / 0.34))
    u = (x - 0.15) / max(width_m - 0.3, 0.1) * nx + wobble * 2
    v = (y - 0.15) / max(depth_m - 0.3, 0.1) * ny + wobble * 2
    lozenge = np.abs(u % 1 - 0.5) + np.abs(v % 1 - 0.5)
    ground, figure, line = (np.array(c) for c in colours)
    picture = np.broadcast_to(ground, (rows, cols, 3)).copy()
    inside = edge > 0.15
    picture[inside & (np.abs(lozenge - 0.5) < 0.045)] = line
    picture[inside & (lozenge < 0.20)] = figure
    picture[inside & (lozenge < 0.09)] = ground
    picture[(edge > 0.06) & (edge < 0.115)] = figure
    picture[(np.abs(edge - 0.045) < 0.006) | (np.abs(edge - 0.13) < 0.006)] = line
    wool = 1 + 0.05 * noise((rows, cols), (3, 9), 4) + 0.04 * noise((rows, cols), (60, 60), 5)
    return srgb_of_linear(picture * np.clip(wool, 0.6, 1.4)[..., None])[::-1]
