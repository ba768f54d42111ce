"""Walls of a training room: what is let into them and hung on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from processing.segmentation.evidence import SceneClass
from training.rooms.house import House
from training.rooms.openings import Gap, Look, fill_gap
from training.rooms.soup import Frame

_KINDS = ("none", "window", "french window", "door", "open door", "passage", "closet", "mirror", "picture", "fitted")
_FURNISHED = (0.30, 0.24, 0.05, 0.08, 0.07, 0.06, 0.04, 0.03, 0.10, 0.03)
_UNFURNISHED = (0.18, 0.17, 0.06, 0.14, 0.15, 0.14, 0.08, 0.03, 0.02, 0.03)
_SIZES = {
    "window": (0.5, 2.4), "french window": (0.8, 2.6), "door": (0.65, 1.0), "open door": (0.65, 1.0),
    "passage": (0.8, 4.0), "closet": (0.9, 2.4), "mirror": (0.4, 1.6), "picture": (0.25, 1.4), "fitted": (0.8, 3.5),
}  # fmt: skip


@dataclass(frozen=True)
class _Slot:
    kind: str
    start: float
    width: float


def build_walls(rng: np.random.Generator, house: House) -> None:
    """Add all walls with their openings and skirting."""
    soup = house.soup
    wooden = rng.random() < 0.5
    wall = soup.paint("wall")
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
    chances = _FURNISHED if rng.random() < 0.75 else _UNFURNISHED
    accent = soup.paint("accent wall") if rng.random() < 0.25 else wall
    chosen = int(rng.integers(len(house.outline)))
    for number in range(len(house.outline)):
        _, length = house.wall(number)
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
                house.soup.box(frame, low, high, SceneClass.WALL, paints[1])
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
