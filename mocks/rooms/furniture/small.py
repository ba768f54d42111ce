"""Small things that designs cannot say in their shapes: books, toys, pictures, pot plants."""

import itertools
import math
from collections.abc import Callable

import numpy as np

from mocks.rooms.furniture.build import BLACK_PLASTIC, CERAMIC, FOLIAGE, PAPER, WHITE_PLASTIC, Build, vessel
from mocks.rooms.model import Material
from mocks.worlds.light import Vector, vector_of
from processing.ground.mesh import Mesh, box, merge, moved, turned
from processing.ground.shapes import cylinder, disc, lathe, rounded_box, sheet, tube
from processing.ground.tables import table_of


def volume(wide_m: float, deep_m: float, thick_m: float) -> tuple[Mesh, Mesh]:
    """Return cover and pages of a book lying on its back cover, its spine at -y, the middle of its base at the origin.

    The cover is 2.5 mm thick and stands 3 mm over the pages.
    """
    w, d, t, c = wide_m / 2, deep_m / 2, thick_m, 0.0025
    cover = merge([box((-w, -d, 0), (w, d, c)), box((-w, -d, t - c), (w, d, t)), box((-w, -d, c), (w, -d + c, t - c))])
    return cover, box((-w + 0.003, -d + c, c), (w - 0.003, d - 0.003, t - c))


def books(
    b: Build, paper: Material, x: tuple[float, float], front: float, z: float, limits: tuple[float, float]
) -> None:
    """Add upright books between two places along x, spines at ``front``; limits are height and depth."""
    at, tallest, deepest = x[0], limits[0], limits[1]
    usual = float(b.rng.uniform(0.18, 0.26))
    while at < x[1] - 0.012:
        thick = min(float(b.rng.gamma(4.0, 0.007)) + 0.009, x[1] - at)
        tall = float(np.clip(b.rng.normal(usual, 0.025), 0.15, tallest))
        deep = float(np.clip(0.7 * tall, 0.10, deepest))
        cover, pages = volume(tall, deep, thick - 0.001)
        place = (at + thick - 0.0005, front + deep / 2 + float(b.rng.uniform(0.0, 0.01)), z + tall / 2)
        tilt = float(b.rng.uniform(0.0, 0.05)) if at + thick > x[1] - 0.015 else 0.0
        for mesh, material in ((cover, b.plain("book", PAPER, 0.4)), (pages, paper)):
            b.add(moved(turned(mesh, (0, 1, 0), -np.pi / 2 - tilt), place), material, "book")
        at += thick


def pile(b: Build, paper: Material) -> None:
    """Add a pile of books, the larger below, none quite straight."""
    w, d, h = b.size
    count = max(1, round(h / 0.025))
    thick = h / count
    for k in range(count):
        shrink = 1.0 - 0.28 * k / max(1, count)
        cover, pages = volume(w * 0.9 * shrink, d * 0.86 * shrink, thick)
        angle = float(b.rng.normal(0.0, 0.08))
        for mesh, material in ((cover, b.plain("book", PAPER, 0.4)), (pages, paper)):
            b.add(moved(turned(mesh, (0, 0, 1), float(np.clip(angle, -0.12, 0.12))), (0, 0, k * thick)), material)


def filled(b: Build, paper: Material, x: tuple[float, float], z: float, tall: float) -> None:
    """Fill one shelf: mostly books from one side, then a box, a vase or nothing."""
    deep, (x0, x1) = b.size[1], x
    fullness = float(b.rng.uniform(0.25, 1.0)) * b.option("fullness", 0.85)
    if fullness < 0.22:
        return
    end = x0 + fullness * (x1 - x0)
    books(b, paper, (x0, end), -deep / 2 + 0.03, z, (tall - 0.03, deep - 0.05))
    room = x1 - end
    if room > 0.26 and b.rng.random() < 0.5:
        side = min(0.26, room - 0.05)
        box = rounded_box((x1 - side - 0.01, -deep / 2 + 0.02, z), (x1 - 0.01, deep / 2 - 0.03, z + 0.6 * tall), 0.006)
        b.add(box, b.plain("box", ((0.55, 0.50, 0.42), (0.30, 0.32, 0.34), (0.70, 0.68, 0.64))), "box")
    elif room > 0.16:
        b.add(cylinder((x1 - 0.08, 0.0, z), 0.05, min(0.18, tall - 0.05), 0.012), b.plain("pot", CERAMIC, 0.3), "vase")


def strands(b: Build, wicker: Material) -> None:
    """Add a basket of stacked strands, open above."""
    w, _, h = b.size
    r, rings = w / 2, max(6, round(h / 0.028))
    outside: list[tuple[float, float]] = []
    for k in range(rings):
        base = r * (0.80 + 0.20 * math.sin(math.pi / 2 * (k + 0.5) / rings))
        z0, z1 = h * k / rings, h * (k + 1) / rings
        outside += [(base - 0.004, z0 + 1e-4), (base, z0 + 0.25 * (z1 - z0)), (base, z0 + 0.75 * (z1 - z0))]
    outside.append((0.99 * r, h))
    b.add(vessel(outside, 0.012), wicker)


def scattered_blocks(b: Build, _role: str) -> None:
    """Add a scatter of toy blocks with a small tower."""
    w, d, _ = b.size
    side = 0.04
    across, along = (np.arange(-long / 2 + side, long / 2 - side, 0.065) for long in (w, d))
    cells = list(itertools.product(across, along))
    for n, k in enumerate(b.rng.permutation(len(cells))[: max(4, len(cells) // 3)]):
        for level in range(2 if n == 0 else 1):
            cube = rounded_box((-side / 2, -side / 2, 0), (side / 2, side / 2, side), 0.003)
            spot = (float(cells[k][0]), float(cells[k][1]), level * side)
            b.add(moved(turned(cube, (0, 0, 1), float(b.rng.uniform(0, 1.57))), spot), b.plain("toy", PAPER, 0.35))


MOUNT = Material("passe-partout", (0.80, 0.79, 0.76))
PAINTS = [[Material("paint", vector_of(rgb)) for rgb in row] for row in table_of(__package__, "materials")["paintings"]]
"""Colours that go together: ground first."""


def framed(b: Build, _role: str) -> None:
    """Add a framed picture: hills, discs or blocks of colour, some behind a mount."""
    w, d, h = b.size
    frame = b.pick(b.finish.wood, BLACK_PLASTIC, WHITE_PLASTIC, b.finish.second_wood)
    bar, x, back = 0.02 + 0.01 * (b.item.seed % 2), w / 2, d / 2
    for side in (-1, 1):
        low, high = sorted((side * x, side * (x - bar)))
        b.shape("block", frame, x=(low, high), y=(-d / 2, back), z=(0.0, h), r=0.002)
        bottom = 0.0 if side < 0 else h - bar
        b.shape("block", frame, x=(-x + bar, x - bar), y=(-d / 2, back), z=(bottom, bottom + bar), r=0.002)
    border = 0.0 if b.item.seed % 3 == 0 else 0.16 * min(w, h)
    paints = PAINTS[int(b.rng.integers(len(PAINTS)))]
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
    a = np.linspace(0.0, 2 * math.pi, 41)[:-1]
    for k, paint in enumerate(paints[1:]):
        r = float(b.rng.uniform(0.12, 0.26)) * min(wide, tall)
        x = float(b.rng.uniform(low[0] + r, high[0] - r))
        z = float(b.rng.uniform(low[1] + r, high[1] - r))
        rim = np.stack([x + r * np.cos(a), np.full(40, -0.0015 - 0.0005 * k), z + r * np.sin(a)], axis=1)
        b.add(disc(rim, np.array([0.0, -1.0, 0.0])), paint)


def _blocks(b: Build, low: tuple[float, float], high: tuple[float, float], paints: list[Material]) -> None:
    wide, tall = high[0] - low[0], high[1] - low[1]
    for k, paint in enumerate(paints[1:]):
        x0 = low[0] + wide * float(b.rng.uniform(0.05, 0.45))
        z0 = low[1] + tall * (0.08 + 0.28 * k)
        x1, z1 = x0 + wide * float(b.rng.uniform(0.25, 0.5)), z0 + tall * float(b.rng.uniform(0.18, 0.3))
        y = -0.0015 - 0.0005 * k
        b.add(box((x0, y, z0), (x1, y + 0.0005, z1)), paint)


SOIL = Material("soil", (0.055, 0.038, 0.025))
BARK = Material("bark", (0.16, 0.115, 0.075))


def grown(b: Build, _role: str) -> None:
    """Add a plant in its pot; tall ones may be small trees."""
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
            base = vector_of(p + s * (q - p) for p, q in zip(low, high, strict=True))
            long = min(0.36 * w, 0.24) * float(b.rng.uniform(0.75, 1.0))
            mesh = leaf(long, long * 0.5, float(b.rng.uniform(0.4, 0.9)), 0.2)
            b.add(_aimed(mesh, 0.25 + 0.6 * t, k * 2.39996 + stem, base), green)


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


VERBS: dict[str, Callable[..., None]] = {
    one.__name__: one for one in (books, pile, filled, strands, scattered_blocks, framed, grown)
}
