"""Lamps, screens, plants and rugs."""

from __future__ import annotations

import math

import numpy as np

from processing.ground.arrays import Bytes, Doubles
from processing.ground.colour import srgb_of_linear
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Colour, Material, noise
from processing.layout.furniture.soft import sheets
from processing.layout.furniture.solids import (
    Solid,
    circle,
    curve,
    leg,
    loft,
    rounded_rectangle,
    slab,
    solid,
    tube,
    turned_piece,
)

SHADE = Material("lampshade", (0.78, 0.74, 0.65), 0.9)
BULB = Material("bulb", (0.85, 0.84, 0.80), 0.3)


def floor_lamp(b: Bench) -> None:
    """Build a floor lamp: a foot and a pole, or three wooden legs, below a shade of cloth."""
    w, d, h = b.size
    r = min(w, d) / 2
    stretch = (w / (2 * r), d / (2 * r), 1.0)
    shade = min(0.28, 0.22 * h)
    low = h - shade
    if b.style.legs == "round":
        for k in range(3):
            a = math.radians(90 + 120 * k)
            foot = (0.86 * r * math.cos(a), 0.86 * r * math.sin(a), 0.0)
            b.add(leg(foot, (0.022 * math.cos(a), 0.022 * math.sin(a), low - 0.06), 0.010, 0.014), b.style.timber)
        b.add(
            turned_piece(
                [(0, low - 0.10), (0.035, low - 0.10), (0.042, low - 0.08), (0.035, low - 0.05), (0, low - 0.05)]
            ),
            b.style.metal,
        )
        start = low - 0.06
    else:
        foot_r = 0.80 * r
        b.add(turned_piece([(0, 0), (foot_r - 0.004, 0), (foot_r, 0.004), (foot_r, 0.016), (foot_r - 0.006, 0.022),
                            (0.03, 0.026), (0.016, 0.05), (0, 0.05)], 48), b.style.metal)  # fmt: skip
        start = 0.03
    b.rod([(0, 0, start), (0, 0, low + 0.02)], 0.0105, b.style.metal)
    b.rod([(0, 0, low + 0.01), (0, 0, low + 0.07)], 0.017, b.style.metal, 16)
    _bulb(b, low, h)
    top, wall = (0.72 if b.style.legs != "metal" else 1.0) * r, 0.003
    cone = [(r - wall, low), (r, low), (top, h), (top - wall, h)]
    b.add(_band(cone).scaled(*stretch), SHADE)
    for k in range(3):
        a = math.radians(30 + 120 * k)
        end = ((top - wall) * math.cos(a) * stretch[0], (top - wall) * math.sin(a) * stretch[1], h - 0.030)
        b.rod([(0, 0, h - 0.030), end], 0.0022, b.style.metal, 6)


def _bulb(b: Bench, low: float, h: float) -> None:
    """Add a bulb above a height, and the rod that carries the shade."""
    b.rod([(0, 0, low + 0.06), (0, 0, h - 0.028)], 0.004, b.style.metal, 8)
    bulb = [
        (0, 0.07),
        (0.014, 0.07),
        (0.016, 0.09),
        (0.032, 0.125),
        (0.034, 0.145),
        (0.026, 0.17),
        (0.012, 0.182),
        (0, 0.184),
    ]
    b.add(turned_piece([(q, z + low - 0.005) for q, z in bulb], 20), BULB)


def _band(profile: list[tuple[float, float]], sides: int = 48) -> Solid:
    """Return the ring of a closed profile of (radius, height), given counter-clockwise with the axis to its left."""
    rings = np.stack([circle(r, sides, z) for r, z in profile])
    m, n = rings.shape[:2]
    i, j = np.meshgrid(np.arange(m), np.arange(n), indexing="ij")
    a, c = i * n + j, i * n + (j + 1) % n
    b, d = (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n
    faces = np.concatenate([np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)])
    return solid(rings.reshape(-1, 3), faces)


BEZEL = Material("black housing", (0.018, 0.018, 0.019), 0.4)
SCREEN = Material("screen", (0.008, 0.008, 0.009), 0.08)


def television(b: Bench) -> None:
    """Build a flat screen on two feet."""
    w, d, h = b.size
    low = min(0.055, 0.1 * h)
    thin = min(0.022, 0.4 * d)
    b.block((-w / 2, -thin / 2, low), (w / 2, thin / 2, h), BEZEL, bevel_m=0.005, steps=2)
    rim = 0.008
    b.block(
        (-w / 2 + rim, thin / 2 - 0.004, low + 2 * rim),
        (w / 2 - rim, thin / 2 + 0.0006, h - rim),
        SCREEN,
        bevel_m=0.0005,
    )
    b.block((-0.32 * w, -0.46 * d, low + 0.08 * h), (0.32 * w, 0, low + 0.55 * h), BEZEL, bevel_m=0.012, steps=2)
    for side in (-1, 1):
        x = side * 0.36 * w
        rows = []
        for y, z in ((-d / 2, 0.005), (-d / 4, 0.012), (0.0, low + 0.004), (d / 4, 0.012), (d / 2, 0.005)):
            ring = rounded_rectangle(0.026, 0.010, 0.003, steps=1)
            rows.append(np.column_stack([ring[:, 0] + x, np.full(len(ring), y), ring[:, 1] + z])[::-1])
        b.add(loft(np.stack(rows)), BEZEL)


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
    """Return a rug's picture (H, W, 3), sRGB: a bordered field of lozenges between lines, in uneven wool."""
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
