"""Walls of a training room: what is let into them (windows, doors, passages, closets) and hung on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from processing.segmentation.evidence import SceneClass
from training.labels import SKIRTING
from training.rooms.house import House, Portal
from training.rooms.soup import Frame


@dataclass(frozen=True)
class Gap:
    """A hole in a wall."""

    x0: float
    x1: float
    z0: float
    z1: float


@dataclass(frozen=True)
class Look:
    """What the openings of one room have in common."""

    door: int
    frame: int
    window: int
    casing_m: float
    door_m: float
    sill_m: float
    head_m: float


def fill_gap(
    rng: np.random.Generator, house: House, frame: Frame, kind: str, start: float, width: float, look: Look
) -> Gap | None:
    """Build one thing of a wall; return the hole that it needs."""
    end, top = start + width, house.ceiling_m - 0.06
    if kind in ("window", "french window"):
        sill = 0.0 if kind == "french window" else look.sill_m
        gap = Gap(start, end, sill, min(look.head_m, top))
        _window(rng, house, frame, gap, look)
        return gap
    if kind in ("door", "closet"):
        gap = Gap(start, end, 0.0, min(look.door_m, top))
        _shut(rng, house, frame, gap, look, leaves=1 if kind == "door" else max(2, round(width / 0.6)))
        return gap
    if kind in ("open door", "passage"):
        tall = kind == "passage" and rng.random() < 0.6
        gap = Gap(start, end, 0.0, house.ceiling_m if tall and rng.random() < 0.5 else min(look.door_m, top))
        _open(rng, house, frame, gap, look, leaf=kind == "open door")
        return gap
    if kind == "fitted":
        _fitted(rng, house, frame, start, end)
    else:
        _hung(rng, house, frame, start, end, mirror=kind == "mirror")
    return None


def _lining(house: House, frame: Frame, gap: Gap, depth: float, label: SceneClass, paint: int) -> None:
    x0, x1, z0, z1 = gap.x0, gap.x1, gap.z0, gap.z1
    for x in (x0, x1):
        house.soup.quad(frame, [(x, 0, z0), (x, -depth, z0), (x, -depth, z1), (x, 0, z1)], label, paint)
    for z in (z0, z1):
        if z > 0:
            house.soup.quad(frame, [(x0, 0, z), (x1, 0, z), (x1, -depth, z), (x0, -depth, z)], label, paint)
        else:
            floor = [(x0, 0, 0.001), (x1, 0, 0.001), (x1, -depth, 0.001), (x0, -depth, 0.001)]
            house.soup.quad(frame, floor, label, paint)


def _casing(house: House, frame: Frame, gap: Gap, width: float, label: SceneClass, paint: int) -> None:
    if width <= 0:
        return
    x0, x1, z0, z1 = gap.x0, gap.x1, gap.z0, min(gap.z1 + width, house.ceiling_m)
    low = z0 - (width if z0 > 0.1 else 0)
    house.soup.box(frame, (x0 - width, 0.0, low), (x0, 0.018, z1), label, paint)
    house.soup.box(frame, (x1, 0.0, low), (x1 + width, 0.018, z1), label, paint)
    house.soup.box(frame, (x0, 0.0, gap.z1), (x1, 0.018, z1), label, paint)
    if z0 > 0.1:
        house.soup.box(frame, (x0, 0.0, low), (x1, 0.025, z0), label, paint)


def _window(rng: np.random.Generator, house: House, frame: Frame, gap: Gap, look: Look) -> None:
    depth = float(rng.uniform(0.03, 0.3))
    soup = house.soup
    _lining(house, frame, gap, depth, SceneClass.WALL, soup.paint("trim"))
    if rng.random() < 0.55:
        _casing(house, frame, gap, look.casing_m, SceneClass.WINDOW, look.window)
    x0, x1, z0, z1 = gap.x0, gap.x1, gap.z0, gap.z1
    bar, away = rng.uniform(0.03, 0.09), -depth
    across, up = 1 + int(rng.integers(0, max(1, round((x1 - x0) / 0.6)) + 1)), int(rng.choice([1, 1, 2, 3]))
    inner = [x0 + (x1 - x0) * k / across for k in range(1, across)]
    for x in (x0 + bar / 2, *inner, x1 - bar / 2):
        soup.upright(frame, (x - bar / 2, z0, x + bar / 2, z1), away, SceneClass.WINDOW, look.window)
    for z in (z0 + bar / 2, *(z0 + (z1 - z0) * k / up for k in range(1, up)), z1 - bar / 2):
        soup.upright(frame, (x0, z - bar / 2, x1, z + bar / 2), away, SceneClass.WINDOW, look.window)
    corner, u, v = frame.world([(x0, away, z0), (x1, away, z0), (x0, away, z1)])
    house.panes.append((corner, u - corner, v - corner))
    chance = rng.random()
    if chance < 0.12:
        _curtains(rng, house, frame, gap, "sheer")
    if chance < 0.05 or 0.12 <= chance < 0.32:
        _curtains(rng, house, frame, gap, "curtain")
    elif 0.32 <= chance < 0.45:
        low = z1 - (z1 - z0) * rng.uniform(0.1, 0.95)
        paint = soup.paint("blind", emission=float(rng.uniform(0.02, 0.3)))
        soup.upright(frame, (x0, low, x1, z1), away * 0.6, SceneClass.FIXTURE, paint)


def _curtains(rng: np.random.Generator, house: House, frame: Frame, gap: Gap, kind: str) -> None:
    """Hang a pair of curtains, drawn aside or closed; sheer ones are closed and glow with the light behind them."""
    sheer = kind == "sheer"
    paint = house.soup.paint(kind, emission=float(rng.uniform(0.04, 0.4)) if sheer else 0.0)
    closed = sheer or rng.random() < 0.15
    top = min(gap.z1 + rng.uniform(0.05, 0.35), house.ceiling_m - 0.01)
    low = 0.01 if rng.random() < 0.7 else max(0.02, gap.z0 - 0.15)
    for side in (0, 1):
        wide = 0.5 * (gap.x1 - gap.x0) + 0.15 if closed else rng.uniform(0.1, 0.55) * (gap.x1 - gap.x0)
        x0 = gap.x0 - 0.15 if side == 0 else gap.x1 + 0.15 - wide
        folds = max(3, round(wide / 0.08))
        x = x0 + np.linspace(0, wide, folds + 1)
        y = (0.03 if sheer else 0.06) + 0.05 * (np.arange(folds + 1) % 2)
        for k in range(folds):
            a, b = (x[k], y[k]), (x[k + 1], y[k + 1])
            house.soup.quad(frame, [(*a, low), (*b, low), (*b, top), (*a, top)], SceneClass.FIXTURE, paint)


def _shut(rng: np.random.Generator, house: House, frame: Frame, gap: Gap, look: Look, leaves: int) -> None:
    soup, depth = house.soup, float(rng.uniform(0.0, 0.1))
    mirror = leaves > 1 and rng.random() < 0.25
    _lining(house, frame, gap, depth + 0.01, SceneClass.DOOR, look.frame)
    _casing(house, frame, gap, look.casing_m, SceneClass.DOOR, look.frame)
    step = (gap.x1 - gap.x0) / leaves
    for k in range(leaves):
        paint, label = look.door, SceneClass.DOOR
        if mirror:
            paint, label = soup.paint("mirror"), SceneClass.FIXTURE
            house.mirrors.append(paint)
        leaf = (gap.x0 + k * step + 0.006, 0.01, gap.x0 + (k + 1) * step - 0.006, gap.z1 - 0.006)
        soup.upright(frame, (gap.x0, 0.0, gap.x1, gap.z1), -depth - 0.008, SceneClass.DOOR, soup.paint("gap"))
        soup.upright(frame, leaf, -depth, label, paint)
        if not mirror and rng.random() < 0.5:
            dark = soup.paint("door shade")
            for low, high in ((0.12, 0.45), (0.52, 0.93)):
                inset = 0.16 * step
                field = (leaf[0] + inset, low * gap.z1, leaf[2] - inset, high * gap.z1)
                soup.upright(frame, field, -depth + 0.004, SceneClass.DOOR, dark)
        elif not mirror and leaves == 1 and rng.random() < 0.3:
            glass = soup.paint("frosted", emission=float(rng.uniform(0.0, 0.25)))
            low = float(rng.choice([0.1, 0.5])) * gap.z1
            field = (leaf[0] + 0.14 * step, low, leaf[2] - 0.14 * step, 0.93 * gap.z1)
            soup.upright(frame, field, -depth + 0.004, SceneClass.DOOR, glass)
    handle = (gap.x1 - 0.1, 0.98, gap.x1 - 0.03, 1.05)
    soup.upright(frame, handle, -depth + 0.05, SceneClass.DOOR, soup.paint("metal"))


def _open(rng: np.random.Generator, house: House, frame: Frame, gap: Gap, look: Look, *, leaf: bool) -> None:
    soup, depth = house.soup, float(rng.uniform(0.09, 0.25))
    full = gap.z1 >= house.ceiling_m - 1e-6
    framed = leaf or rng.random() < 0.4
    label = SceneClass.DOOR if framed else SceneClass.WALL
    paint = look.frame if framed else soup.paint("wall")
    _lining(house, frame, gap, depth, label, paint)
    if framed and not full:
        _casing(house, frame, gap, look.casing_m, SceneClass.DOOR, look.frame)
    house.portals.append(Portal(frame, (gap.x0, 0.0, gap.x1, gap.z1), depth))
    if leaf and rng.random() < 0.65:
        turn, width = rng.uniform(0.6, 2.8), gap.x1 - gap.x0 - 0.02
        at_end = rng.random() < 0.5
        hinge = gap.x1 if at_end else gap.x0
        way = (-np.cos(turn) if at_end else np.cos(turn), np.sin(turn))
        sight = (hinge + width * way[0], 0.02 + width * way[1])
        corners = [(hinge, 0.02, 0.01), (*sight, 0.01), (*sight, gap.z1 - 0.01), (hinge, 0.02, gap.z1 - 0.01)]
        soup.quad(frame, corners, SceneClass.DOOR, look.door)


def _hung(rng: np.random.Generator, house: House, frame: Frame, start: float, end: float, *, mirror: bool) -> None:
    soup = house.soup
    high = rng.uniform(0.3, 1.2) if not mirror or rng.random() < 0.6 else rng.uniform(1.3, 2.0)
    low = max(0.05, min(rng.uniform(1.0, 1.5) - high / 2 + 0.3, house.ceiling_m - high - 0.1))
    paint = soup.paint("mirror" if mirror else "picture")
    if mirror:
        house.mirrors.append(paint)
    border = rng.uniform(0.0, 0.06)
    outer = (start - border, low - border, end + border, low + high + border)
    soup.upright(frame, outer, 0.015, SceneClass.FIXTURE, soup.paint("frame"))
    soup.upright(frame, (start, low, end, low + high), 0.02, SceneClass.FIXTURE, paint)


def _fitted(rng: np.random.Generator, house: House, frame: Frame, start: float, end: float) -> None:
    """Add kitchen units: cupboards under a worktop with oven, hob, sink; others at head height; a tall one."""
    soup, deep = house.soup, rng.uniform(0.35, 0.62)
    front, top = soup.paint("fitted"), soup.paint("worktop")
    if end - start > 1.6 and rng.random() < 0.5:
        high = min(house.ceiling_m, float(rng.uniform(1.9, 2.3)))
        tall = soup.paint("metal") if rng.random() < 0.35 else front
        soup.box(frame, (start, 0.0, 0.06), (start + 0.6, deep + 0.02, high), SceneClass.FIXTURE, tall)
        soup.upright(
            frame,
            (start, high * 0.45, start + 0.6, high * 0.45 + 0.012),
            deep + 0.023,
            SceneClass.FIXTURE,
            soup.paint("gap"),
        )
        start += 0.62
    _appliances(rng, house, frame, (start, end), deep)
    soup.box(frame, (start, 0.0, 0.08), (end, deep, 0.87), SceneClass.FIXTURE, front)
    soup.box(frame, (start, 0.0, 0.0), (end, deep - 0.06, 0.08), SceneClass.FIXTURE, soup.paint("gap"))
    soup.box(frame, (start - 0.01, 0.0, 0.87), (end + 0.01, deep + 0.02, 0.91), SceneClass.FIXTURE, top)
    line = soup.paint("door shade")
    for x in np.arange(start + 0.45, end - 0.1, 0.45):
        soup.upright(frame, (x, 0.1, x + 0.012, 0.85), deep + 0.003, SceneClass.FIXTURE, line)
    if rng.random() < 0.5:
        soup.upright(frame, (start, 0.91, end, rng.uniform(1.1, 1.45)), 0.006, SceneClass.WALL, soup.paint("splash"))
    if rng.random() < 0.7:
        high = min(house.ceiling_m, rng.uniform(1.95, 2.3))
        stretch = (start, end) if rng.random() < 0.6 else (start, start + (end - start) * rng.uniform(0.3, 0.8))
        soup.box(frame, (stretch[0], 0.0, 1.4), (stretch[1], 0.34, high), SceneClass.FIXTURE, front)
        for x in np.arange(stretch[0] + 0.45, stretch[1] - 0.1, 0.45):
            soup.upright(frame, (x, 1.41, x + 0.012, high - 0.01), 0.343, SceneClass.FIXTURE, line)


def _appliances(rng: np.random.Generator, house: House, frame: Frame, span: tuple[float, float], deep: float) -> None:
    """Add an oven's front, a hob with a hood, a sink with a tap, and handles."""
    soup, (start, end) = house.soup, span
    dark, steel, fixture = soup.paint("dark"), soup.paint("metal"), SceneClass.FIXTURE
    if end - start > 0.9 and rng.random() < 0.6:
        x = rng.uniform(start + 0.02, end - 0.62)
        soup.upright(frame, (x, 0.25, x + 0.58, 0.82), deep + 0.006, fixture, dark if rng.random() < 0.6 else steel)
        soup.upright(frame, (x + 0.05, 0.72, x + 0.53, 0.75), deep + 0.03, fixture, steel)
        soup.box(frame, (x, 0.06, 0.91), (x + 0.56, deep - 0.06, 0.917), fixture, dark)
        if rng.random() < 0.5:
            soup.box(frame, (x, 0.0, 1.5), (x + 0.58, 0.42, rng.uniform(1.58, 1.9)), fixture, steel)
    if end - start > 1.2 and rng.random() < 0.6:
        x = rng.uniform(start + 0.02, end - 0.55)
        soup.box(frame, (x, 0.1, 0.91), (x + 0.5, deep - 0.1, 0.914), fixture, steel)
        soup.box(frame, (x + 0.24, 0.05, 0.91), (x + 0.26, 0.08, 1.15), fixture, steel)
    if rng.random() < 0.5:
        for x in np.arange(start + 0.2, end - 0.25, 0.45):
            soup.box(frame, (x, deep, 0.74), (x + 0.14, deep + 0.025, 0.76), fixture, steel)


_KINDS = ("none", "window", "french window", "door", "open door", "passage", "closet", "mirror", "picture", "fitted")
_FURNISHED = (0.30, 0.24, 0.05, 0.08, 0.07, 0.06, 0.04, 0.03, 0.10, 0.03)
_UNFURNISHED = (0.18, 0.17, 0.06, 0.14, 0.15, 0.14, 0.08, 0.03, 0.02, 0.03)
_KITCHEN = (0.10, 0.14, 0.05, 0.06, 0.06, 0.10, 0.03, 0.01, 0.05, 0.40)
_SIZES = {
    "window": (0.5, 2.4),
    "french window": (0.8, 2.6),
    "door": (0.65, 1.0),
    "open door": (0.65, 1.0),
    "passage": (0.8, 5.0),
    "closet": (0.9, 2.4),
    "mirror": (0.4, 1.6),
    "picture": (0.25, 1.4),
    "fitted": (0.8, 4.2),
}


@dataclass(frozen=True)
class _Slot:
    kind: str
    start: float
    width: float


def build_walls(
    rng: np.random.Generator, house: House, *, hole: tuple[int, Gap] | None = None, wall_kind: str = "wall"
) -> None:
    """Add all walls with their openings and skirting; the wall of ``hole`` (its number) has that gap and no other."""
    soup = house.soup
    wooden = rng.random() < 0.5
    wall = soup.paint(wall_kind)
    trim = soup.paint("wood door" if wooden and rng.random() < 0.5 else "trim")
    look = Look(
        door=soup.paint("wood door" if wooden else "door"),
        frame=soup.paint("wood door" if wooden and rng.random() < 0.8 else "trim"),
        window=soup.paint("wood door" if wooden and rng.random() < 0.4 else "window frame"),
        casing_m=float(rng.uniform(0.05, 0.13)) if rng.random() < 0.8 else 0.0,
        door_m=float(rng.uniform(1.95, 2.12)),
        sill_m=float(rng.choice([rng.uniform(0.2, 0.6), rng.uniform(0.7, 1.2)])),
        head_m=float(rng.uniform(1.95, min(2.5, house.ceiling_m - 0.08))),
    )
    skirting = rng.uniform(0.05, 0.16) if rng.random() < 0.85 else 0.0
    chances = (_FURNISHED, _UNFURNISHED, _KITCHEN)[int(rng.choice(3, p=(0.66, 0.2, 0.14)))]
    accent = soup.paint("accent wall") if rng.random() < 0.25 else wall
    chosen = int(rng.integers(len(house.outline)))
    for number in range(len(house.outline)):
        frame, length = house.wall(number)
        if hole is not None and number == hole[0]:
            _faces(house, frame, length, [hole[1]], wall)
            continue
        slots = _draw_slots(rng, length, chances)
        mine = accent if number == chosen else wall
        base = trim if skirting else -1
        _build_wall(rng, house, number, slots, look, (mine, base), skirting)


def _draw_slots(rng: np.random.Generator, length: float, chances: tuple[float, ...]) -> list[_Slot]:
    slots: list[_Slot] = []
    at = rng.uniform(0.05, 0.35)
    while at < length - 0.5:
        kind = str(rng.choice(_KINDS, p=chances))
        if kind == "none":
            at += rng.uniform(0.4, 2.2)
            continue
        low, high = _SIZES[kind]
        width = rng.uniform(low, min(high, max(low + 0.05, length * 0.85)))
        if at + width > length - 0.12:
            at += rng.uniform(0.3, 0.8)
            continue
        slots.append(_Slot(kind, float(at), float(width)))
        # Windows come in rows, a narrow pier between them.
        while kind == "window" and rng.random() < 0.4 and at + 2 * width + 0.4 < length:
            at += width + rng.uniform(0.06, 0.3)
            slots.append(_Slot(kind, float(at), float(width)))
        at += width + (rng.uniform(0.15, 0.4) if rng.random() < 0.5 else rng.uniform(0.4, 1.6))
    return slots


def _build_wall(
    rng: np.random.Generator,
    house: House,
    number: int,
    slots: list[_Slot],
    look: Look,
    paints: tuple[int, int],
    skirting: float,
) -> None:
    frame, length = house.wall(number)
    gaps: list[Gap] = []
    for slot in slots:
        gap = fill_gap(rng, house, frame, slot.kind, slot.start, slot.width, look)
        if gap is not None:
            gaps.append(gap)
        if slot.kind not in ("window", "picture", "mirror"):
            house.blocked.append((number, slot.start - 0.1, slot.start + slot.width + 0.1))
    _faces(house, frame, length, gaps, paints[0])
    if skirting:
        at = 0.0
        for gap in [*(g for g in gaps if g.z0 < 0.1), Gap(length, length, 0.0, 0.0)]:
            if gap.x0 - at > 0.03:
                low, high = (at, 0.0, 0.0), (gap.x0, 0.012, skirting)
                house.soup.box(frame, low, high, SKIRTING, paints[1])
            at = gap.x1
    _small_things(rng, house, frame, length, gaps)


def _faces(house: House, frame: Frame, length: float, gaps: list[Gap], paint: int) -> None:
    """Add the wall around its gaps."""
    at, top = 0.0, house.ceiling_m
    for gap in sorted(gaps, key=lambda g: g.x0):
        if gap.x0 > at:
            house.soup.upright(frame, (at, 0.0, gap.x0, top), 0.0, SceneClass.WALL, paint)
        if gap.z0 > 0:
            house.soup.upright(frame, (gap.x0, 0.0, gap.x1, gap.z0), 0.0, SceneClass.WALL, paint)
        if gap.z1 < top:
            house.soup.upright(frame, (gap.x0, gap.z1, gap.x1, top), 0.0, SceneClass.WALL, paint)
        at = gap.x1
    house.soup.upright(frame, (at, 0.0, length, top), 0.0, SceneClass.WALL, paint)


def _small_things(rng: np.random.Generator, house: House, frame: Frame, length: float, gaps: list[Gap]) -> None:
    """Add radiators under windows, now and then, and plates on the wall."""
    for gap in gaps:
        if gap.z0 > 0.5 and rng.random() < 0.3:
            low = (gap.x0 + 0.05, 0.03, 0.1)
            high = (gap.x1 - 0.05, rng.uniform(0.08, 0.16), gap.z0 - rng.uniform(0.06, 0.15))
            house.soup.box(frame, low, high, SceneClass.FIXTURE, house.soup.paint("radiator"))
    if rng.random() < 0.3 and length > 0.8:
        x, z = rng.uniform(0.2, length - 0.3), rng.choice([0.3, 1.2])
        free = all(x > g.x1 + 0.05 or x + 0.12 < g.x0 for g in gaps)
        if free:
            plate = (x, z, x + 0.1, z + rng.uniform(0.08, 0.2))
            house.soup.upright(frame, plate, 0.01, SceneClass.FIXTURE, house.soup.paint("trim"))
