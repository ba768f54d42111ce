"""Which sides of a bed are told as its use zones: those that can be walked to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from processing.layout.poses import Stand
from processing.layout.rules import RuleSet
from processing.layout.units import Rect, zone_choices, zone_rect
from processing.layout.verify import Judge, Piece


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
