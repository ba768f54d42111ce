"""Poses of pieces from the search's choices, in the canonical frame and back in the room."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from processing.ground.arrays import Doubles
from processing.layout.items import Item
from processing.layout.rules import RuleSet
from processing.layout.solver.canonical import Frame, wrapped
from processing.layout.solver.grouping import ROLES, Packing
from processing.layout.solver.soft import ROLE
from processing.layout.solver.states import Choice, Found
from processing.layout.solver.units import Rect, zone_choices, zone_rect
from processing.layout.verify import Judge, Piece


@dataclass(frozen=True)
class Stand:
    """A piece in a frame: where it stands, with whom, at which edge, and the use zones kept for it."""

    item: Item
    x_m: float
    y_m: float
    theta_rad: float
    group: str
    edge: int | None
    zones: tuple[Rect, ...] = ()
    pinned: bool = False

    def facing(self) -> tuple[float, float]:
        """Return the unit vector of its front."""
        return -math.sin(self.theta_rad), math.cos(self.theta_rad)

    def corners(self, rect: Rect | None = None) -> list[tuple[float, float]]:
        """Return the corners of a rectangle of its frame; of its footprint by default."""
        if rect is None:
            w, d = self.item.spec.size_m[0] / 2, self.item.spec.size_m[1] / 2
            rect = (-w, w, -d, d)
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        x0, x1, y0, y1 = rect
        return [
            (self.x_m + x * c - y * s, self.y_m + x * s + y * c) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        ]


def anchor(stand: Stand) -> Doubles:
    """Return a piece as an anchor row of the search's score (`soft`)."""
    role = ROLE[ROLES.get(stand.item.spec.category, "small")]
    half_w, half_d = (v / 2 for v in stand.item.spec.size_m[:2])
    return np.array([stand.x_m, stand.y_m, *stand.facing(), float(role), half_w, half_d])


def stands(found: Found, packing: Packing) -> list[Stand]:
    """Return the pieces of a state, in the canonical frame."""
    return [stand for choice in found.choices for stand in _unit(choice, packing)]


def _unit(choice: Choice, packing: Packing) -> list[Stand]:
    variant = packing.units[choice.unit].variants[choice.variant]
    ox, oy, ux, uy, _, edge = choice.line
    angle = math.atan2(uy, ux)
    group = variant.members[0].item.id
    placed = []
    for member in variant.members:
        x, y = choice.s_m + member.x_m, member.y_m
        placed.append(
            Stand(
                member.item,
                ox + x * ux - y * uy,
                oy + x * uy + y * ux,
                wrapped(angle + member.quarters * math.pi / 2),
                group,
                int(edge) if edge >= 0 else None,
                member.zones,
            )
        )
    return placed


def in_room(stand: Stand, frame: Frame) -> Stand:
    """Return a piece in the room's frame, rounded to 1 um and 1 nrad."""
    x, y, theta = frame.back((stand.x_m, stand.y_m, stand.theta_rad))
    zones = tuple((-x1, -x0, y0, y1) for x0, x1, y0, y1 in stand.zones) if frame.mirrored else stand.zones
    edge = None if stand.edge is None else frame.edge_back(stand.edge)
    return Stand(
        stand.item, round(x, 6) + 0.0, round(y, 6) + 0.0, round(theta, 9) + 0.0, stand.group, edge, zones, stand.pinned
    )


# Which sides of a bed are told as its use zones: those that can be walked to.


def with_reached_sides(placed: Sequence[Stand], judge: Judge, rules: RuleSet) -> tuple[Stand, ...]:
    """Return pieces in the room whose side zones are free and reached.

    The search keeps a side free and the judge is content with any that serves, so the one that was kept need not be the
    one that a path leads to. The judge must pass the pieces as they are; the side kept goes first.
    """
    told = list(placed)
    known = [Piece(s.item.id, s.item.spec, s.x_m, s.y_m, s.theta_rad, s.group) for s in placed]
    for n, stand in enumerate(told):
        if not stand.item.spec.sides_rule:
            continue
        for zones in (stand.zones, *zone_choices(stand.item, rules)):
            asked = [*known[:n], _all_needed(known[n], stand, zones, rules), *known[n + 1 :]]
            if judge.passes(asked, fits=True):
                told[n], known = replace(stand, zones=zones), asked
                break
    return tuple(told)


def _all_needed(piece: Piece, stand: Stand, zones: Sequence[Rect], rules: RuleSet) -> Piece:
    """Return a piece that needs just these zones."""
    item = stand.item
    kept = tuple(zone for zone in item.spec.zones if zone_rect(item, zone, rules) in zones)
    return replace(piece, spec=replace(piece.spec, zones=kept, sides_rule=""))
