"""What a stager adds to a solved plan: curtains, rugs, art, lamps, plants, small things; by rows of `styling.toml`.

No piece of the plan moves, no hard rule that held is broken by what stands on the floor (the judge is asked), and
nothing covers an opening or what hangs on a wall. The same arguments give the same pieces.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from processing.ground.arrays import Doubles
from processing.ground.tables import table_of
from processing.layout.arrangement import Arrangement, PlacedItem
from processing.layout.furniture.bench import STYLES
from processing.layout.furniture.builtin import BUILT_IN
from processing.layout.plan import HUNG_DOOR, FloorPlan, Hung, Window
from processing.layout.rules import built_in_rules
from processing.layout.verify import Judge, Piece

LEVELS = ("none", "light", "full")
AIR_M = 0.06  # between things on a wall, and round a rug (chosen by eye, as all lengths of this file without a word)
BEFORE_M = 0.3  # of a pane above its sill, before which a lamp or a vase may stand
NEAR_WALL_M = 0.30  # what stands nearer than this to a wall is before it
ABOVE_M, EYE_M = 0.18, 1.5
"""Art hangs this much above its host, its middle at eye height where it has none (museums: 1.45 to 1.55 m)."""
OVER_TABLE_M, OVER_HEADS_M = 0.75, 2.05
"""Lamps hang this high above a table (usual: 0.7 to 0.8 m), and above the floor at least."""
OVER_CAMERA_M = 1.0  # from the camera: what hangs nearer above it covers the top of the panorama
LOOMS_M = 1.5  # from the camera: a vase or lamp nearer stands before half the room
OVER_HEAD_M = 0.14  # a curtain's rod above its window
OVER_PANE_M, BLIND_M, BLIND_DEEP_M, BLIND_OVER_M = 0.09, 0.18, 0.06, 0.06
"""A blind, drawn up: above its window, of the pane, off the wall; beyond the sides of the window, where glass would be
seen from aside (chosen)."""
MOST_DRESSED = 0.5  # share of the windows, of a row and of the room, below which none is dressed (chosen)
PIER_M, PANEL_M = 0.8, 0.25  # windows as near as this share a rod, and a pier as wide as that has a curtain of its own
BEFORE_IT_M = 0.9  # from a wall, within which a leaf may stand open and a lamp hides a picture (chosen: a door's width)
LAMP_M = 0.3  # from a ceiling lamp's middle: nothing new hangs where it is seen before the wall, down to the eye
APART_M = 0.5  # new pictures keep this far from those that hang there already, which look larger than they were seen
VARIED = ("plant",)  # of these no two in a room are of one design, as far as there are styles
Wall = tuple[int, float, float, float, float]  # an edge, start and end along it, bottom and top, metres
_TABLE = table_of(__package__, "styling")
Groups = Iterator[list[PlacedItem]]


def styled(
    one: Arrangement, plan: FloorPlan, style: str, level: str, seed: int, lamps: Sequence[Sequence[float]] | None = None
) -> tuple[PlacedItem, ...]:
    """Return what dresses an arrangement in its room, at most `styling.toml`'s `most` with the furniture itself.

    ``lamps``: x and y, metres, of what hangs on the ceiling (`removal.rests.on_ceiling`); None: not known.
    """
    room = _Room(one, plan, np.random.default_rng([seed, one.rank]), lamps, style)
    for row in _TABLE["rows"] if level != "none" else ():
        wanted = LEVELS.index(row["level"]) <= LEVELS.index(level) and style not in row.get("but", ())
        if wanted and len(one.items) + len(room.added) < _TABLE["most"]:
            for _, group in zip(range(row.get("most", 9)), _WAYS[row["where"]](room, row), strict=False):
                room.added += group
    return tuple(room.added[: max(0, _TABLE["most"] - len(one.items))])


@dataclass
class _Room:
    """The arrangement being dressed."""

    one: Arrangement
    plan: FloorPlan
    rng: np.random.Generator
    lamps: Sequence[Sequence[float]] | None
    style: str
    added: list[PlacedItem] = field(default_factory=list)

    def __post_init__(self) -> None:
        rules = built_in_rules().sets
        self.judge = Judge(self.plan, rules.get(self.one.rule_set, rules["standard"]))
        self.floor = shapely.Polygon(self.plan.corners, list(self.plan.holes))
        self.broken = len(self.judge.judge(self._pieces()))
        self.behind_lamps = list(_behind_lamps(self.plan, self.lamps or ()))

    def hosts(self, row: Mapping[str, Any]) -> list[PlacedItem]:
        """Return the pieces that a row may belong to, by the order of its categories."""
        return [item for name in row["host"] for item in self.one.items if item.category == name]

    def piece(self, what: str, size: Sequence[float], x: float, y: float, base: float, theta: float) -> PlacedItem:
        """Return a new piece, its size kept within what it is made in."""
        kind = BUILT_IN[what]
        w, d, h = (float(np.clip(v, a, b)) for v, a, b in zip(size, kind.smallest_m, kind.largest_m, strict=True))
        name = what.replace(" ", "-")
        taken = {item.id for item in (*self.one.items, *self.added)}
        free = next(n for n in range(1, 99) if f"{name}-s{n}" not in taken)
        alike = sum(item.category == what for item in (*self.one.items, *self.added)) if what in VARIED else 0
        other = STYLES[(STYLES.index(self.style) + alike) % len(STYLES)]
        named = {"id": f"{name}-s{free}", "category": what, "model": f"{what}/{other}/{self.style}" if alike else ""}
        at = (round(x, 6), round(y, 6), round(base, 6))
        return PlacedItem(**named, size_m=(w, d, h), base_m=at[2], theta_rad=theta, t_m=at)

    def _pieces(self, *more: PlacedItem) -> list[Piece]:
        standing = (a for a in self.added if a.base_m == 0 and a.category != "curtain")
        return [Piece.of(item) for item in (*self.one.items, *standing, *more)]

    def stands(self, piece: PlacedItem) -> bool:
        """Return whether a piece on the floor breaks no rule that holds without it, and hides no door that stays and
        nothing else that hangs, new pictures among it."""
        art = ((self.behind(item), item) for item in self.added if item.category in ("art", "mirror"))
        new = [Hung(edge, *_ends(self.along(edge, item)[0]), item.base_m) for edge, item in art if edge is not None]
        for hung in (*self.plan.hung, *new):
            along, away = self.along(hung.edge, piece)
            before = away.min() < BEFORE_IT_M and (hung.name == "door" or piece.size_m[2] > hung.sill_m)
            if before and along.min() < hung.end_m and along.max() > hung.start_m:
                return False
        return len(self.judge.judge(self._pieces(piece))) <= self.broken

    def free(self, wall: Wall, also: Sequence[Wall] = ()) -> bool:
        """Return whether a rectangle of a wall, with air round it, is free of openings, things and what is ``also``."""
        edge, start, end, low, high = wall
        if start < AIR_M or end > self.plan.edge(edge)[2] - AIR_M or high > self.plan.ceiling_height_m - AIR_M:
            return False
        return not any(
            e == edge and a < end + AIR_M and b > start - AIR_M and c < high + AIR_M and d > low - AIR_M
            for e, a, b, c, d in (*self._taken(), *also)
        )

    def _taken(self) -> Iterator[Wall]:
        for door in self.plan.doors:
            yield door.edge, door.start_m, door.end_m, 0.0, 2.2
        for thing in (*self.plan.windows, *self.plan.hung):
            yield thing.edge, thing.start_m, thing.end_m, thing.sill_m, thing.head_m
        for item in (*self.one.items, *self.added):
            for edge in range(len(self.plan.corners)) if item.category != "rug" else ():
                along, away = self.along(edge, item)
                if -0.05 < away.min() < NEAR_WALL_M:
                    yield edge, along.min(), along.max(), item.base_m, item.base_m + item.size_m[2]

    def along(self, edge: int, item: PlacedItem) -> tuple[Doubles, Doubles]:
        """Return places (4,) along an edge and distances (4,) from it of a piece's corners, metres."""
        corner, u, _ = self.plan.edge(edge)
        return (outline(item) - corner) @ u, (outline(item) - corner) @ np.array([-u[1], u[0]])

    def behind(self, item: PlacedItem) -> int | None:
        """Return the wall at which a piece has its back, wherever it was arranged; None where it stands free."""
        for edge in range(len(self.plan.corners)):
            along, away = self.along(edge, item)
            back_m, middle_m = away[:2], along.mean()
            if back_m.min() > -0.05 and back_m.max() < NEAR_WALL_M and 0 < middle_m < self.plan.edge(edge)[2]:
                return edge
        return None

    def at_wall(self, what: str, wall: Wall, deep: float, gap: float = 0.001) -> PlacedItem:
        """Return a piece that hangs in a rectangle of a wall, its front to the room."""
        edge, start, end, low, high = wall
        corner, u, _ = self.plan.edge(edge)
        x, y = corner + u * (start + end) / 2 + np.array([-u[1], u[0]]) * (deep / 2 + gap)
        return self.piece(what, (end - start, deep, high - low), x, y, low, math.atan2(u[1], u[0]))


def _behind_lamps(plan: FloorPlan, lamps: Sequence[Sequence[float]]) -> Iterator[Wall]:
    """Yield what ceiling lamps, but those above a camera, hide of walls from it, as if they hung down to the eye."""
    for eye, lamp in ((np.array(a), b) for a in plan.keep_free for b in lamps if math.dist(a, b) >= OVER_CAMERA_M):
        side = (lamp - eye)[::-1] * (-1, 1) / math.dist(lamp, eye) * LAMP_M
        ends = [eye + far * (lamp - eye + sign * side) for far, sign in ((1, 1), (1, -1), (99, -1), (99, 1))]
        for edge in range(len(plan.corners)):
            corner, u, length = plan.edge(edge)
            hidden = shapely.Polygon(ends).intersection(shapely.LineString([corner, corner + u * length]))
            if len(along := (shapely.get_coordinates(hidden) - corner) @ u):
                yield edge, float(along.min()), float(along.max()), EYE_M, plan.ceiling_height_m


def _ends(along: Doubles) -> tuple[float, float]:
    return float(along.min()), float(along.max())


def outline(item: PlacedItem, grow_m: float = 0.0) -> Doubles:
    """Return the corners, shape (4, 2), of a piece's footprint in the room, metres, grown on all sides."""
    w, d = item.size_m[0] / 2 + grow_m, item.size_m[1] / 2 + grow_m
    return np.array([item.place(x, y) for x, y in ((-w, -d), (w, -d), (w, d), (-w, d))])


def _windows(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield what dresses the windows; nothing where most of them would stay bare: one blind of four looks forgotten."""
    before, dressed, every = len(room.added), 0, 0
    for run in _runs(room.plan):
        covered = _covered(room.plan, run[0].edge)
        made, count = ([], len(run)) if covered else _curtains(room, row, run) or _blinds(room, run)
        room.added += made  # the next wall's have to be clear of these
        dressed, every = dressed + count, every + len(run)
    room.added, made = room.added[:before], room.added[before:]
    if dressed >= MOST_DRESSED * every:
        yield made


def _curtains(room: _Room, row: Mapping[str, Any], run: Sequence[Window]) -> tuple[list[PlacedItem], int] | None:
    """Return curtains of one length and their rod, if there is room on both sides, and how many windows they dress.

    A single curtain looks forgotten, and a rod across a blind or a picture wrong."""
    wide, deep, _ = row["size"]
    edge, start, end = run[0].edge, run[0].start_m, run[-1].end_m
    head, sill = max(w.head_m for w in run), min(w.sill_m for w in run)
    top, near = min(head + OVER_HEAD_M, room.plan.ceiling_height_m - 2 * AIR_M), AIR_M + 0.001
    if top < head + 0.03:
        return None
    for low, share in ((a, b) for a in (0.02, max(0.02, sill - 0.15), sill) for b in (1.0, 0.8, 0.6)):
        ends = [(start - near - share * wide, start - near), (end + near, end + near + share * wide)]
        pair = [(edge, *span, low, top) for span in ends]
        if all(map(room.free, pair)):
            piers = [(edge, a.end_m + near, b.start_m - near, low, top) for a, b in pairwise(run)]
            walls = [*pair, *(wall for wall in piers if wall[2] - wall[1] > PANEL_M and room.free(wall))]
            rod = (edge, ends[0][0] - 0.04, ends[1][1] + 0.04, top - 0.012, top + 0.028)
            made = _numbered([room.at_wall("curtain", wall, deep, 0.03) for wall in walls])
            return [*made, room.at_wall("curtain rod", rod, 0.03 + deep / 2 + 0.012)], len(run)
    return None


def _blinds(room: _Room, run: Sequence[Window]) -> tuple[list[PlacedItem], int]:
    """Return blinds, drawn up, before the tops of windows, and their number; none where most have no room for one."""
    pier = min((b.start_m - a.end_m for a, b in pairwise(run)), default=1.0)
    found = [_blind(room, window, min(BLIND_OVER_M, max(pier / 2 - 0.01, 0.0))) for window in run]
    walls = [wall for wall in found if wall is not None and len(found) - found.count(None) >= MOST_DRESSED * len(run)]
    return _numbered([room.at_wall("blind", wall, BLIND_DEEP_M, 0.005) for wall in walls]), len(walls)


def _numbered(made: Sequence[PlacedItem]) -> list[PlacedItem]:
    """Return pieces made at once, which have one id, with a number each."""
    return [a.model_copy(update={"id": f"{a.id}-{n}"}) for n, a in enumerate(made, start=1)]


def _blind(room: _Room, window: Window, over: float) -> Wall | None:
    """Return where a window's blind hangs, so far over its sides if there is room, else on its frame; None: no room."""
    edge, top = window.edge, window.head_m + OVER_PANE_M
    for a, b in ((window.start_m - by, window.end_m + by) for by in (over, 0.0, -BLIND_OVER_M)):
        if room.free((edge, a + AIR_M, b - AIR_M, window.head_m + AIR_M + 0.001, top)):
            return edge, a, b, window.head_m - BLIND_M, top
    return None


def _runs(plan: FloorPlan) -> Iterator[list[Window]]:
    """Yield the windows of each wall that stand side by side."""
    run: list[Window] = []
    for window in sorted(plan.windows, key=lambda w: (w.edge, w.start_m)):
        if run and (run[-1].edge != window.edge or window.start_m > run[-1].end_m + PIER_M):
            yield run
            run = []
        run.append(window)
    if run:
        yield run


def _covered(plan: FloorPlan, edge: int) -> bool:
    """Return whether something hangs at a window of a wall above its sill: curtains, or a blind."""
    at = [w for w in plan.windows if w.edge == edge]
    for h in plan.hung:
        before = any(h.start_m < w.end_m and h.end_m > w.start_m and h.head_m > w.sill_m for w in at)
        if h.edge == edge and (h.name == "curtain" or (before and h.name != HUNG_DOOR)):
            return True
    return False


def _under(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield a rug below a group: before and half under a sofa or bed, all round a table with its chairs."""
    if any(i.category == "rug" for i in room.one.items):
        return
    for host in room.hosts(row):
        w, d, _ = host.size_m
        if host.category == "dining table":
            size, ahead = (w + 1.3, d + 1.3), 0.0
        elif host.category == "sofa":
            size, ahead = (w + 0.5, 1.9), d / 2 + 0.62
        elif host.category == "desk":
            size, ahead = (w + 0.3, 1.3), d / 2 + 0.35
        else:
            size, ahead = (w + 1.3, 1.7), 0.20 * d
        for share in (1.0, 0.86, 0.74):
            x, y = host.place(0.0, ahead * (0.4 + 0.6 * share))
            rug = room.piece(row["what"], (size[0] * share, size[1] * share, 0.012), x, y, 0.0, host.theta_rad)
            if room.floor.covers(shapely.Polygon(outline(rug, AIR_M))):
                yield [rug]
                break


def _on(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield something on top of each host, where nothing stands yet."""
    for host in room.hosts(row):
        side = 1.0 if room.rng.random() < 0.5 else -1.0
        (w, d, h), wall = row["size"], room.behind(host)
        free = [max(0.0, (a - b) / 2 - 0.02) for a, b in zip(host.size_m, (w, d), strict=False)]
        top = host.base_m + host.size_m[2]
        for sign in (side, -side):
            x, y = (f * v for f, v in zip(free, row["at"], strict=True))
            new = room.piece(row["what"], (w, d, h), *host.place(sign * x, y), top, host.theta_rad)
            others = (i for i in (*room.one.items, *room.added) if i.base_m > 0 and abs(i.base_m - top) < 0.3)
            shape = shapely.Polygon(outline(new, 0.01))
            hides = h > 0.2 and any(p.edge == wall and top + h > p.sill_m + BEFORE_M for p in room.plan.windows)
            hides |= h > 0.3 and any(math.dist(new.t_m[:2], eye) < LOOMS_M for eye in room.plan.keep_free)
            clash = any(shape.intersects(shapely.Polygon(outline(i))) for i in others)
            if min(host.size_m[:2]) > min(w, d) and not hides and not clash:
                yield [new]
                break


def _above(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield art on the wall over a host: one broad picture, a pair, or a single upright one, as the wall allows."""
    for host in room.hosts(row):
        if (edge := room.behind(host)) is None:
            continue
        along, _ = room.along(edge, host)
        screens = [i for i in room.one.items if i.category == "tv" and i.group == host.id]
        low = max([host.size_m[2], *(i.base_m + i.size_m[2] for i in screens)]) + ABOVE_M
        middle, wide = float(along.mean()), float(np.clip(0.62 * np.ptp(along), 0.40, 1.3))
        high = min(0.72, 0.8 * wide, room.plan.ceiling_height_m - 0.2 - low)
        low = max(low, min(EYE_M + 0.1 - high / 2, low + 0.25))
        pairs = [(-wide / 2, -0.03), (0.03, wide / 2 + 0.002)]  # of another size, so that it is another print
        tries = [pairs, [(-wide / 2, wide / 2)]] if room.rng.random() < 0.6 else [[(-wide / 2, wide / 2)], pairs]
        for spans in (*tries, [(-0.2, 0.2)]) if high > 0.3 else ():
            walls = [(edge, middle + a, middle + b, low, low + high) for a, b in spans]
            beside = (h for h in room.plan.hung if h.edge == edge and h.head_m > low)
            alone = all(
                h.start_m > middle + spans[-1][1] + APART_M or h.end_m < middle + spans[0][0] - APART_M for h in beside
            )
            if alone and all(room.free(wall, room.behind_lamps) for wall in walls):
                made = [room.at_wall(row["what"], wall, 0.03) for wall in walls]
                yield [a.model_copy(update={"id": a.id + "b" * n}) for n, a in enumerate(made)]
                break


def _beside(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield something on the floor at a host's left or right."""
    if any(i.category == row["what"] for i in room.one.items):
        return
    w, d, _ = row["size"]
    for host in room.hosts(row):
        side = 1.0 if room.rng.random() < 0.5 else -1.0
        for sign, back in ((side, 0.04), (-side, 0.04), (side, 0.3), (-side, 0.3)):
            x = sign * (host.size_m[0] / 2 + w / 2 + 0.05)
            spot = host.place(x, -host.size_m[1] / 2 + d / 2 + back)
            new = room.piece(row["what"], row["size"], *spot, 0.0, host.theta_rad)
            if room.stands(new):
                yield [new]
                return


def _corner(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield something in corners of the room, those at windows first: plants want light."""
    n = len(room.plan.corners)
    lit = {w.edge for w in room.plan.windows}
    w = row["size"][0]
    for k in sorted(range(n), key=lambda k: (not lit & {k, (k - 1) % n}, room.rng.random())):
        corner, u, _ = room.plan.edge(k)
        _, before, _ = room.plan.edge((k - 1) % n)
        if u @ np.array([-before[1], before[0]]) < 0.5:  # an outward corner, or nearly straight
            continue
        x, y = corner + (u - before) * (w / 2 + 0.08)
        new = room.piece(row["what"], row["size"], x, y, 0.0, math.atan2(u[1], u[0]))
        if room.stands(new):
            yield [new]


def _wall(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield something on walls where nothing hangs yet, in the middle of what is free, the longest first."""
    usual, d, h = row["size"]
    hung = {one.edge for one in room.plan.hung if one.head_m > EYE_M - 0.3}
    for edge in sorted(set(range(len(room.plan.corners))) - hung, key=lambda k: -room.plan.edge(k)[2]):
        length, w = room.plan.edge(edge)[2], usual
        if row["what"] == "art":
            w = usual * float(room.rng.choice((0.8, 1.0, 1.3)))
        starts = np.arange(0.4, length - w - 0.4, 0.1)
        low, also = EYE_M - h / 2, room.behind_lamps
        # Air on both sides: a picture squeezed between a door and a wardrobe is none.
        free = [s for s in starts.tolist() if room.free((edge, s - 0.25, s + w + 0.25, low, low + h), also)]
        if free:
            s = free[len(free) // 2]
            yield [room.at_wall(row["what"], (edge, s, s + w, low, low + h), d)]


def _ceiling(room: _Room, row: Mapping[str, Any]) -> Groups:
    """Yield a lamp on a bare ceiling: low over a table, else above heads in the middle of the floor."""
    (w, d, h), high, middle = row["size"], room.plan.ceiling_height_m, room.floor.centroid
    spots = [(*host.t_m[:2], host.size_m[2] + OVER_TABLE_M) for host in room.hosts(row)]
    for x, y, low in spots or [(middle.x, middle.y, max(OVER_HEADS_M, high - h))]:
        if any(math.dist((x, y), eye) < OVER_CAMERA_M for eye in room.plan.keep_free):
            continue
        new = room.piece(row["what"], (w, d, high - low), x, y, low, 0.0)
        new = room.piece(row["what"], (w, d, high - low), x, y, high - new.size_m[2] - 0.002, 0.0)
        if room.lamps == [] and new.base_m > low - 0.01 and room.floor.covers(shapely.Polygon(outline(new, AIR_M))):
            yield [new]


_WAYS = {
    "windows": _windows,
    "under": _under,
    "on": _on,
    "above": _above,
    "beside": _beside,
    "corner": _corner,
    "wall": _wall,
    "ceiling": _ceiling,
}
