"""The rooms behind open doors and passages: as this one, with walls, windows and furniture, all labelled as door."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from shapely.geometry import Polygon

from processing.ground.arrays import Doubles
from processing.segmentation.evidence import SceneClass
from training.rooms.house import House, Portal, ceiling_things
from training.rooms.paints import OTHER
from training.rooms.pieces import Piece
from training.rooms.props import furnish_house
from training.rooms.soup import Soup
from training.rooms.walls import Gap, build_walls

_TRIES = 6


def build_beyond(rng: np.random.Generator, house: House, bank: list[Piece]) -> None:
    """Add a room behind each of a house's portals: it shines, hides and casts shadows as the room itself does."""
    for portal in house.portals:
        ring, gap = _place(rng, house, portal)
        high = house.ceiling_m if rng.random() < 0.7 else float(max(portal.rect[3] + 0.02, rng.uniform(2.2, 3.0)))
        other = House(ring, high, Soup(), [], [])
        before = "" if rng.random() < 0.65 else OTHER
        flat = np.array([[ring[0], ring[1], ring[2]], [ring[0], ring[2], ring[3]]])
        for z, kind in ((0.0, before + "floor"), (high, "ceiling")):
            level = np.concatenate([flat, np.full((2, 3, 1), z)], axis=2)
            other.soup.add(level, SceneClass.DOOR, other.soup.paint(kind))
        build_walls(rng, other, hole=(2, gap), wall_kind=before + "wall")
        ceiling_things(rng, other)
        with suppress(ValueError):
            furnish_house(rng, other, bank, most=int(rng.integers(0, 7)))
        _close(other)
        shift = len(house.soup.paints)
        house.soup.take(other.soup, SceneClass.DOOR)
        house.panes += other.panes
        house.lamps += other.lamps
        house.mirrors += [paint + shift for paint in other.mirrors]


def _place(rng: np.random.Generator, house: House, portal: Portal) -> tuple[Doubles, Gap]:
    """Return corners (4, 2) of the room behind a portal, beside the house, and the gap in its third wall."""
    room = Polygon(house.outline)
    x0, _, x1, top = portal.rect
    for number in range(_TRIES):
        share = 1 - number / _TRIES
        left, right = share * rng.uniform(0.05, 3.0, 2) if rng.random() < 0.7 else rng.uniform(0.02, 0.4, 2)
        deep = rng.uniform(0.9, 0.9 + 5.1 * share)
        low, high, near = x0 - left, x1 + right, -portal.depth_m
        local = [(low, near - deep, 0), (high, near - deep, 0), (high, near, 0), (low, near, 0)]
        ring = portal.frame.world(local)[:, :2]
        if Polygon(ring).intersection(room).area < 0.02:
            break
    return ring, Gap(high - x1, high - x0, 0.0, top)


def _close(other: House) -> None:
    """Put a pale wall behind the other room's own openings."""
    for frame, rect, depth_m in other.portals:
        other.soup.upright(frame, rect, -depth_m, SceneClass.DOOR, other.soup.paint("hallway"))
