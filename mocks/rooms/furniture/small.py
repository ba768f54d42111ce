"""Small things: what lies on tables and shelves, pictures and mirrors on walls, pot plants."""

import itertools
import math

import numpy as np

from mocks.rooms.furniture.build import BLACK_PLASTIC, CERAMIC, FOLIAGE, PAPER, SOIL, WHITE_PLASTIC, Build
from mocks.rooms.model import Material
from mocks.worlds.light import Vector
from processing.ground.mesh import Mesh, box, moved, turned
from processing.ground.shapes import ball, beam, cylinder, disc, lathe, rounded_box, sheet, tube


def _vessel(outside: list[tuple[float, float]], wall: float) -> Mesh:
    """Return an open vessel from its outer profile (foot to rim) and the thickness of its wall."""
    inside = [(max(r - wall, 0.001), max(z, wall)) for r, z in reversed(outside)]
    return lathe([(0.0, 0.0), *outside, *inside, (0.0, wall)], 28)


def vase(b: Build) -> None:
    """Build a vase, some with dry stalks."""
    w, _, h = b.size
    r = w / 2
    stalks = h > 0.4
    tall = 0.5 * h if stalks else h
    shapes: tuple[tuple[float, ...], ...] = (
        (0.55, 0.8, 0.97, 1.0, 0.9, 0.65, 0.42, 0.40, 0.48),
        (0.6, 0.7, 0.8, 0.88, 0.94, 0.98, 1.0, 1.0, 0.98),
        (0.75, 0.95, 1.0, 0.9, 0.65, 0.42, 0.34, 0.34, 0.40),
    )
    shape = shapes[b.item.seed % 3]
    radius = r if not stalks else min(r, 0.09)
    outline = [(radius * s, tall * k / (len(shape) - 1)) for k, s in enumerate(shape)]
    b.add(_vessel(outline, 0.005), b.plain("ceramic", CERAMIC, None if b.item.seed % 2 else 0.2))
    if stalks:
        straw = Material("dry grass", (0.46, 0.35, 0.20))
        for _ in range(11):
            a, reach = b.rng.uniform(0, 2 * math.pi), b.rng.uniform(0.2, 0.9) * (r - 0.015)
            top = h * float(b.rng.uniform(0.8, 0.97))
            x, y = float(reach * math.cos(a)), float(reach * math.sin(a))
            neck = 0.25 * radius / max(reach, 1e-3)
            b.add(tube([(0, 0, 0.02), (x * neck, y * neck, tall), (x, y, top)], 0.0015, 5), straw)
            ear = [(x * 0.93, y * 0.93, top * 0.88), (x * 0.97, y * 0.97, top * 0.94), (x, y, top)]
            b.add(tube(ear, (0.003, 0.009, 0.001), 7), straw)


def bottle(b: Build) -> None:
    """Build a bottle."""
    w, _, h = b.size
    r = w / 2
    outline = [(0.0, 0.0), (0.95 * r, 0.0), (r, 0.05 * h), (r, 0.58 * h), (0.85 * r, 0.66 * h), (0.42 * r, 0.76 * h)]
    glass = b.plain("bottle glass", ((0.03, 0.06, 0.03), (0.05, 0.03, 0.02), (0.35, 0.42, 0.42)), 0.08)
    b.add(lathe([*outline, (0.36 * r, 0.80 * h), (0.36 * r, h), (0.0, h)], 24), glass)
    label = [(r + 0.0005, 0.18 * h), (r + 0.001, 0.19 * h), (r + 0.001, 0.45 * h), (r + 0.0005, 0.46 * h)]
    b.add(lathe(label, 24), b.plain("label", PAPER))


def bowl(b: Build) -> None:
    """Build a bowl, on tables with fruit."""
    w, _, h = b.size
    r = w / 2
    outline = [(0.35 * r, 0.0), (0.40 * r, 0.03 * h), (0.7 * r, 0.22 * h), (0.9 * r, 0.55 * h), (r, h)]
    b.add(_vessel(outline, 0.006), b.plain("ceramic", CERAMIC, 0.2))
    if w > 0.2 and b.item.seed % 2:
        peel = b.plain("fruit", ((0.55, 0.22, 0.04), (0.42, 0.48, 0.08), (0.50, 0.08, 0.05)), 0.4)
        for k in range(4):
            a = math.pi / 2 * k
            b.add(ball((0.4 * r * math.cos(a), 0.4 * r * math.sin(a), 0.22 * h + 0.036), 0.036, 16), peel)


def mug(b: Build) -> None:
    """Build a mug with its handle."""
    w, _, h = b.size
    r = 0.38 * w
    clay = b.plain("ceramic", CERAMIC, 0.2)
    b.add(moved(_vessel([(0.9 * r, 0.0), (r, 0.06 * h), (r, h)], 0.004), (-0.1 * w, 0, 0)), clay)
    arc: list[Vector] = [
        (r - 0.1 * w + 0.2 * w * math.sin(t), 0.0, h * (0.5 - 0.32 * math.cos(t)))
        for t in np.linspace(0.1, math.pi - 0.1, 8)
    ]
    b.add(tube(arc, 0.005, 8), clay)


def carton(b: Build) -> None:
    """Build a box: cardboard with a taped lid, or a lidded storage box."""
    w, d, h = b.size
    if b.item.seed % 2:
        card = Material("cardboard", (0.42, 0.30, 0.19))
        b.block((-w / 2, -d / 2, 0.0), (w / 2, d / 2, h - 0.001), card, 0.003)
        tape = Material("tape", (0.55, 0.42, 0.26), roughness=0.2)
        b.block((-0.025, -d / 2 - 0.0005, h * 0.7), (0.025, d / 2 + 0.0005, h), tape, 0.0004)
        return
    skin = b.plain("box", PAPER)
    b.block((-w / 2 + 0.004, -d / 2 + 0.004, 0.0), (w / 2 - 0.004, d / 2 - 0.004, h - 0.01), skin, 0.003)
    b.block((-w / 2, -d / 2, h - 0.07), (w / 2, d / 2, h), skin, 0.003)


def basket(b: Build) -> None:
    """Build a wicker basket of stacked strands, open above."""
    w, _, h = b.size
    wicker = b.plain("wicker", ((0.42, 0.29, 0.16), (0.55, 0.44, 0.28), (0.20, 0.15, 0.11)))
    r, rings = w / 2, max(6, round(h / 0.028))
    outside: list[tuple[float, float]] = []
    for k in range(rings):
        base = r * (0.80 + 0.20 * math.sin(math.pi / 2 * (k + 0.5) / rings))
        z0, z1 = h * k / rings, h * (k + 1) / rings
        outside += [(base - 0.004, z0 + 1e-4), (base, z0 + 0.25 * (z1 - z0)), (base, z0 + 0.75 * (z1 - z0))]
    outside.append((0.99 * r, h))
    b.add(_vessel(outside, 0.012), wicker)
    b.add(cylinder((0, 0, 0.02), 0.8 * r - 0.02, 0.55 * h, 0.03, 20), b.finish.second_fabric)


def toy_blocks(b: Build) -> None:
    """Build a scatter of toy blocks with a small tower."""
    w, d, _ = b.size
    side = 0.04
    across, along = (np.arange(-long / 2 + side, long / 2 - side, 0.065) for long in (w, d))
    cells = list(itertools.product(across, along))
    chosen = b.rng.permutation(len(cells))[: max(4, len(cells) // 3)]
    for n, k in enumerate(chosen):
        levels = 2 if n == 0 else 1
        for level in range(levels):
            cube = rounded_box((-side / 2, -side / 2, 0), (side / 2, side / 2, side), 0.003)
            spot = (float(cells[k][0]), float(cells[k][1]), level * side)
            b.add(moved(turned(cube, (0, 0, 1), float(b.rng.uniform(0, 1.57))), spot), b.plain("toy", PAPER, 0.35))


def toy_ball(b: Build) -> None:
    """Build a ball."""
    r = b.size[0] / 2
    b.add(ball((0, 0, r), r, 24), b.plain("toy", PAPER, 0.3))


MOUNT = Material("passe-partout", (0.80, 0.79, 0.76))
PAINTS: tuple[tuple[Vector, ...], ...] = (
    ((0.62, 0.60, 0.52), (0.20, 0.30, 0.36), (0.55, 0.33, 0.18), (0.10, 0.13, 0.16)),
    ((0.72, 0.66, 0.55), (0.50, 0.20, 0.12), (0.64, 0.45, 0.16), (0.12, 0.20, 0.18)),
    ((0.70, 0.72, 0.70), (0.30, 0.42, 0.46), (0.16, 0.28, 0.20), (0.66, 0.62, 0.44)),
)
"""Colours that go together: ground first."""


def picture(b: Build) -> None:
    """Build a framed picture: hills, discs or blocks of colour, some behind a mount."""
    w, d, h = b.size
    frame = b.pick(b.finish.wood, BLACK_PLASTIC, WHITE_PLASTIC, b.finish.second_wood)
    bar, x, back = 0.02 + 0.01 * (b.item.seed % 2), w / 2, d / 2
    for side in (-1, 1):
        low, high = sorted((side * x, side * (x - bar)))
        b.block((low, -d / 2, 0.0), (high, back, h), frame, 0.002)
        bottom = 0.0 if side < 0 else h - bar
        b.block((-x + bar, -d / 2, bottom), (x - bar, back, bottom + bar), frame, 0.002)
    border = 0.0 if b.item.seed % 3 == 0 else 0.16 * min(w, h)
    paints = [Material("paint", c) for c in PAINTS[int(b.rng.integers(len(PAINTS)))]]
    b.add(box((-x + bar, 0.0, bar), (x - bar, back, h - bar)), MOUNT if border else paints[0])
    left_low, right_high = (-x + bar + border, bar + border), (x - bar - border, h - bar - border)
    b.add(box((left_low[0], -0.001, left_low[1]), (right_high[0], 0.0, right_high[1])), paints[0])
    (_hills, _discs, _blocks)[int(b.rng.integers(3))](b, left_low, right_high, paints)


def _hills(b: Build, low: tuple[float, float], high: tuple[float, float], paints: list[Material]) -> None:
    """Paint three ranges of hills, the nearest last and darkest."""
    wide, tall = high[0] - low[0], high[1] - low[1]
    for k, paint in enumerate(paints[1:]):
        crest = (0.62 - 0.2 * k) * tall
        phase, waves = b.rng.uniform(0, 2 * math.pi), b.rng.uniform(0.6, 1.6)
        t = np.linspace(0.0, 1.0, 25)
        z = crest + 0.09 * tall * np.sin(2 * math.pi * waves * t + phase) + 0.03 * tall * np.sin(11 * t + 2 * phase)
        x = low[0] + wide * t
        y = -0.0015 - 0.0005 * k
        for a in range(24):
            corners = np.array(
                [(x[a], y, low[1]), (x[a + 1], y, low[1]), (x[a + 1], y, low[1] + z[a + 1]), (x[a], y, low[1] + z[a])]
            )
            b.add(disc(corners, np.array([0.0, -1.0, 0.0])), paint)


def _discs(b: Build, low: tuple[float, float], high: tuple[float, float], paints: list[Material]) -> None:
    wide, tall = high[0] - low[0], high[1] - low[1]
    for k, paint in enumerate(paints[1:]):
        r = float(b.rng.uniform(0.12, 0.26)) * min(wide, tall)
        x = float(b.rng.uniform(low[0] + r, high[0] - r))
        z = float(b.rng.uniform(low[1] + r, high[1] - r))
        b.add(_dot(x, -0.0015 - 0.0005 * k, z, r), paint)


def _dot(x: float, y: float, z: float, radius: float) -> Mesh:
    """Return a flat disc that looks towards -y."""
    a = np.linspace(0.0, 2 * math.pi, 41)[:-1]
    rim = np.stack([x + radius * np.cos(a), np.full(40, y), z + radius * np.sin(a)], axis=1)
    return disc(rim, np.array([0.0, -1.0, 0.0]))


def _blocks(b: Build, low: tuple[float, float], high: tuple[float, float], paints: list[Material]) -> None:
    wide, tall = high[0] - low[0], high[1] - low[1]
    for k, paint in enumerate(paints[1:]):
        x0 = low[0] + wide * float(b.rng.uniform(0.05, 0.45))
        z0 = low[1] + tall * (0.08 + 0.28 * k)
        x1, z1 = x0 + wide * float(b.rng.uniform(0.25, 0.5)), z0 + tall * float(b.rng.uniform(0.18, 0.3))
        y = -0.0015 - 0.0005 * k
        b.add(box((x0, y, z0), (x1, y + 0.0005, z1)), paint)


def wall_clock(b: Build) -> None:
    """Build a round clock; its hands show a time drawn by chance."""
    w, d, h = b.size
    r, z = w / 2, h / 2
    rim = b.pick(BLACK_PLASTIC, b.finish.wood, b.finish.metal)
    b.add(tube([(0, d / 2, z), (0, -d / 2 + 0.008, z)], r, 40), rim)
    face = -d / 2 + 0.006
    b.add(tube([(0, -d / 2 + 0.009, z), (0, face, z)], 0.93 * r, 40), WHITE_PLASTIC)
    for k in range(12):
        mark = beam((0, face - 0.001, 0.76 * r), (0, face - 0.001, 0.87 * r), 0.03 * r, 0.001, 0.0002)
        b.add(moved(turned(mark, (0, 1, 0), 2 * math.pi * k / 12), (0, 0, z)), BLACK_PLASTIC)
    minutes = float(b.rng.uniform(0, 720))
    for long, thick, angle, y in (
        (0.5, 0.05, 2 * math.pi * minutes / 720, face - 0.002),
        (0.72, 0.035, 2 * math.pi * minutes / 60, face - 0.004),
    ):
        hand = beam((0, y, -0.12 * r), (0, y, long * r), thick * r, 0.001, 0.0002)
        b.add(moved(turned(hand, (0, 1, 0), angle), (0, 0, z)), BLACK_PLASTIC)


BARK = Material("bark", (0.16, 0.115, 0.075))


def plant(b: Build) -> None:
    """Build a plant in its pot; tall ones may be small trees."""
    designs = (_bush, _swords, _tree) if b.size[2] > 0.8 else (_bush, _swords, _bush)
    # The pot with its soil; the plant grows from within its radius, at the height of the soil
    w, _, h = b.size
    tall = float(np.clip(0.26 * h, 0.08, 0.34))
    r = min(0.36 * w, 0.62 * tall)
    wall = 0.06 * r
    outline = [(0.0, 0.0), (0.74 * r, 0.0), (0.80 * r, 0.02), (r, tall), (r - wall, tall), (r - 1.6 * wall, 0.8 * tall)]
    b.add(lathe([*outline, (0.0, 0.8 * tall)], 28), b.plain("pot", CERAMIC, None if b.item.seed % 2 else 0.25))
    b.add(cylinder((0, 0, 0.8 * tall), r - 1.6 * wall - 0.002, 0.1 * tall, 0.0, 20), SOIL)
    designs[b.item.seed % 3](b, r, 0.9 * tall)


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


def leaf(length_m: float, width_m: float, bend_rad: float, fold: float = 0.25) -> Mesh:
    """Return a leaf that grows from the origin along y, rising first and drooping by ``bend_rad`` over its length."""
    t = np.linspace(0.0, 1.0, 6)
    angle = -bend_rad * t
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (length_m / 5)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    half = width_m / 2 * np.maximum(np.sin(math.pi * np.clip(t, 0.02, 0.985) ** 0.75), 0.03)
    across = np.array([-1.0, 0.0, 1.0])
    x = half[:, None] * across
    y = np.broadcast_to(line[:, :1], x.shape)
    z = line[:, 1:] + fold * half[:, None] * np.abs(across)
    return sheet(np.stack([x, y, z], axis=-1).transpose(1, 0, 2), 0.0012)


def blade(length_m: float, width_m: float, lean_rad: float, bend_rad: float) -> Mesh:
    """Return an upright sword leaf: wide in the middle, pointed, leaning and bending towards y."""
    t = np.linspace(0.0, 1.0, 7)
    angle = math.pi / 2 - lean_rad - bend_rad * t
    step = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (length_m / 6)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    half = width_m / 2 * np.clip(np.minimum(0.55 + t, (1.0 - t) * 2.2), 0.03, 1.0)
    x = half[:, None] * np.array([-1.0, 0.0, 1.0])
    surface = np.stack([x, np.broadcast_to(line[:, :1], x.shape), np.broadcast_to(line[:, 1:], x.shape)], axis=-1)
    return sheet(surface.transpose(1, 0, 2), 0.002)
