"""Frames of a room: where a photographer of interiors would aim from the camera's place.

Verticals are upright (the camera is level, the lens is shifted down), lenses are those of the trade (16 to 24 mm on
full frame), two walls meet in the picture and the far corner is in it, windows are in, main pieces are whole, and round
things stay round. Each rule is worth a number; frames are taken greedily, and what an earlier frame shows counts little
again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from processing.ground.arrays import Doubles
from processing.ground.polygons import inside
from processing.ground.room_model import RoomModel
from processing.layout.arrangement import PlacedItem
from processing.sphere import Perspective
from processing.surfaces.maps import wall_ranges

LENSES_MM = (24.0, 20.0, 18.0, 16.0)
SENSOR_MM = 36.0  # width of full frame, on which lenses are named
WIDE_WORTH = {24.0: 0.0, 20.0: -0.1, 18.0: -0.25, 16.0: -0.5}
"""A wider lens stretches what is at the edges: worth less. Chosen, as all worths below, by looking."""
DROPS = (0.0, 0.08, 0.16, 0.24)  # by how much of the picture's height the lens is shifted down
SIZE_PX = (1920, 1280)
FEWEST, MOST = 3, 6
APART_RAD = math.radians(30)  # between two frames' axes: nearer, they are one picture
MARGIN = 0.015  # of the picture's width, around a piece that counts as whole
PIECE, CUT, WINDOW, CUT_WINDOW, CORNER, BARE, PLAIN = 1.0, 0.6, 0.6, 0.2, 1.2, 1.0, 2.5
"""Worths and costs: whole and cut pieces, windows, the far corner, no whole piece, columns of plain wall."""
EMPTY, MOST_EMPTY = 3.0, 0.5  # cost of columns without a piece, beyond that share (chosen)
AGAIN = 0.3  # of the worth of what an earlier frame shows
ENOUGH = 0.55  # worth below which no frame more than the fewest is taken
NEAR_M = 1.1  # a piece nearer than this fills the picture's edge and is not wanted in it
DOOR, NEAR_DOOR_M = 0.8, 2.5  # cost of a door in sight that is nearer: large, and mostly open to a dark hall (chosen)
NEAR_WALL, NEAR_WALL_SHARE = 2.0, 0.3
"""Cost of columns with a wall nearer than this share of the farthest corner (chosen)."""
TALL_M, FILLS, TALL_SHARE, BACK_SHARE, MOST_FILLED = 1.4, 3.0, 0.06, 0.02, 0.2
"""Cost of what pieces so tall, and seats' backs, fill of a picture beyond these shares, up to the last (chosen)."""
CEILING, MOST_CEILING = 3.0, 0.14
"""Cost of the share of a picture that the ceiling fills beyond that: rooms are of what stands in them (chosen)."""
CUT_MAIN, ALONE = 0.6, 1.5  # what it costs more to cut a main piece; what it is worth more in the first frame (chosen)
MAIN, SEATS = ("bed", "single bed", "sofa", "dining table"), ("chair", "armchair", "sofa")
ROUND = ("table lamp", "floor lamp", "pendant", "vase", "bowl")
EGG, LEAST_EGG, ROUND_SHARE, MOST_EGG = 2.0, 1.1, 0.08, 0.3
"""Cost of round things stretched outwards beyond so much, of those that fill so much of the width or more, and the most
in all: a globe near the edge of a wide picture is an egg, but no picture goes without the table for its vase. Chosen by
looking."""
NEVER_WHOLE = 0.2  # of the cost to cut a main piece that no frame shows whole: the camera stands by it (chosen)
OPENINGS = ("window", "door")


@dataclass(frozen=True)
class Frame:
    """A frame: the camera's place is that of the panorama."""

    yaw_rad: float
    lens_mm: float
    drop: float
    """By how much of its height the picture looks lower than level."""
    shows: tuple[str, ...] = ()
    """Pieces that are whole in it."""

    def view(self, width_px: int = SIZE_PX[0]) -> Perspective:
        """Return the level view of which the lower `height_px` rows are the frame."""
        high, field = self.height_px(width_px), 2 * math.atan(SENSOR_MM / 2 / self.lens_mm)
        return Perspective(width_px, high + 2 * round(self.drop * high), field, yaw_rad=self.yaw_rad)

    @staticmethod
    def height_px(width_px: int = SIZE_PX[0]) -> int:
        """Return the height of a frame of this width."""
        return width_px * SIZE_PX[1] // SIZE_PX[0]


AROUND = tuple(Frame(2 * math.pi * k / 3, 20.0, 0.08) for k in (-1, 0, 1))  # where nothing is known of a room


@dataclass(frozen=True)
class _Thing:
    name: str
    corners_m: Doubles
    """(N, 3) from the floor below the camera."""
    worth: float
    cut: float
    """What it costs where the picture's edge cuts it."""
    most: float = 1.0
    """Share of the picture that it may fill."""
    main: bool = False


def frames_of(
    room: RoomModel,
    items: Sequence[PlacedItem],
    most: int = MOST,
    fewest: int = FEWEST,
    added: Sequence[PlacedItem] = (),
) -> tuple[Frame, ...]:
    """Return frames of a room with these pieces, the best first: ``fewest`` (whatever they are worth) to ``most``.

    ``added``: what dresses the room; of it, round things are kept out of the corners of wide pictures."""
    things = _in_sight([*_pieces(items), *_openings(room)], room)
    levels = [Frame(math.radians(yaw), mm, 0.0) for yaw in range(-180, 180, 4) for mm in LENSES_MM]
    frames = [replace(level, drop=drop) for level in levels for drop in DROPS]
    seen = np.array([_seen(frame, things, room) for frame in frames])
    pieces = np.array([thing.name not in OPENINGS for thing in things], bool)
    bare = pieces.any() & ~(seen[:, pieces] == 1).any(axis=1)
    filled = np.array([_overfilled(frame, things, room) for frame in frames])
    placed = [thing for thing in things if thing.name not in OPENINGS]
    empty = [EMPTY * max(0.0, _plain_share(one, placed, room) - MOST_EMPTY) if placed else 0.0 for one in levels]
    plain = [PLAIN * _plain_share(one, things, room) + cost for one, cost in zip(levels, empty, strict=True)]
    across = [cost + NEAR_WALL * _near_wall_share(one, room) for cost, one in zip(plain, levels, strict=True)]
    own = np.repeat([_composition(one, room) - cost for one, cost in zip(levels, across, strict=True)], len(DROPS))
    own -= BARE * bare + FILLS * filled + CEILING * np.maximum(_ceiling_share(frames, room) - MOST_CEILING, 0)
    spun = [one for one in (*items, *added) if one.category in ROUND]
    eggs = np.array([min(EGG * _stretched(frame, spun, room), MOST_EGG) for frame in frames])
    own -= np.where(bare & (len(spun) > 0), MOST_EGG, eggs)
    gain, cut = np.array([(one.worth, one.cut) for one in things]).reshape(-1, 2).T
    main = np.array([one.main for one in things], bool)
    cut = np.where(main & ~(seen == 1).any(axis=0), NEVER_WHOLE * cut, cut)
    chosen, shown = list[int](), np.zeros(len(things))
    while len(chosen) < most:
        again = gain * np.where(shown > 0, AGAIN, 1.0) if chosen else gain + ALONE * main
        worth = own + np.where(seen > 0, again, -cut * (seen < 0)).sum(axis=1)
        for k in chosen:
            turned = [abs(math.remainder(one.yaw_rad - frames[k].yaw_rad, 2 * math.pi)) for one in frames]
            worth[np.array(turned) < APART_RAD] = -np.inf
        best = int(np.argmax(worth))
        if not np.isfinite(worth[best]) or (len(chosen) >= fewest and worth[best] < ENOUGH):
            break
        chosen.append(best)
        shown = np.maximum(shown, seen[best] == 1)
    return tuple(replace(frames[k], shows=_whole_ones(seen[k], things)) for k in chosen)


def _in_sight(things: Sequence[_Thing], room: RoomModel) -> list[_Thing]:
    """Return what no wall hides from the camera: of a room with wings, not what stands in them."""
    way, floor = np.linspace(0.05, 0.95, 19)[:, None], np.array(room.floor)  # windows are on the floor's very edge
    return [one for one in things if inside(floor, way * one.corners_m[:, :2].mean(axis=0)).all()]


def _whole_ones(states: Doubles, things: Sequence[_Thing]) -> tuple[str, ...]:
    return tuple(one.name for one, state in zip(things, states, strict=True) if state == 1 and one.name not in OPENINGS)


def aimed(text: str | None, room: RoomModel | None, items: Sequence[PlacedItem]) -> tuple[Frame, ...]:
    """Return the frames that somebody aimed: "yaw,lens,drop;…", degrees to the right, mm, share of the height."""
    frames, things = [], _in_sight(_pieces(items), room) if room else []
    for one in filter(None, (text or "").split(";")):
        yaw_deg, lens_mm, drop = [*map(float, one.split(",")), 0.0][:3]
        frame = Frame(math.remainder(math.radians(yaw_deg), 2 * math.pi), lens_mm, drop)
        frames.append(replace(frame, shows=_whole_ones(_seen(frame, things, room) if room else np.empty(0), things)))
    return tuple(frames)


def with_aimed(own: Sequence[Frame], others: Sequence[Frame]) -> tuple[Frame, ...]:
    """Return frames that were aimed, then those of the others that look elsewhere: `MOST` at most."""
    turns = [[abs(math.remainder(one.yaw_rad - a.yaw_rad, 2 * math.pi)) for a in own] for one in others]
    return (*own, *(one for one, turn in zip(others, turns, strict=True) if min(turn, default=4) >= APART_RAD))[:MOST]


def _pieces(items: Sequence[PlacedItem]) -> list[_Thing]:
    found = []
    for item in items:
        if item.category == "rug":
            continue
        wide, deep, high = item.size_m
        signs = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
        cosine, sine = math.cos(item.theta_rad), math.sin(item.theta_rad)
        turned = signs * (wide, deep, high) @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
        size = math.sqrt(wide * deep * max(high, 0.3)) ** (2 / 3)
        worth = 0.0 if math.hypot(item.t_m[0], item.t_m[1]) < NEAR_M else PIECE * min(size, 1.5)
        away = item.t_m[1] * cosine - item.t_m[0] * sine > 0.5 * math.hypot(*item.t_m[:2])  # its front looks away
        back, main = away and item.category.split()[-1] in SEATS, item.category in MAIN
        share, cut = TALL_SHARE if high > TALL_M else 1.0, CUT * min(size, 1.5) + CUT_MAIN * main
        found.append(_Thing(item.id, turned + item.t_m, worth, cut, BACK_SHARE if back else share, main))
    return found


def _openings(room: RoomModel) -> list[_Thing]:
    found = []
    for one in room.openings:
        ends = (room.on_wall(one.wall, along_m) for along_m in (one.start_m, one.end_m))
        places = [(*end, z) for end in ends for z in (one.sill_m, one.head_m)]
        if one.kind.value != "door":
            found.append(_Thing("window", np.array(places), WINDOW, CUT_WINDOW))
        elif np.hypot(*np.array(places)[:, :2].T).min() < NEAR_DOOR_M:
            found.append(_Thing("door", np.array(places), -DOOR, DOOR))
    return found


def _projected(frame: Frame, points_m: Doubles, camera_m: float) -> tuple[Doubles, Doubles, Doubles]:
    """Return places in the frame, x and y in its half width from its middle (y up), and the distance ahead (m)."""
    sine, cosine = math.sin(frame.yaw_rad), math.cos(frame.yaw_rad)
    right, ahead = points_m[:, 0] * cosine - points_m[:, 1] * sine, points_m[:, 0] * sine + points_m[:, 1] * cosine
    scale = frame.lens_mm / (SENSOR_MM / 2) / np.maximum(ahead, 1e-3)
    # The lens is shifted: the horizon lies above the middle by `drop` of the height.
    up = (points_m[:, 2] - camera_m) * scale + 2 * frame.drop * SIZE_PX[1] / SIZE_PX[0]
    return right * scale, up, ahead


def _ends(frame: Frame, things: Sequence[_Thing], room: RoomModel) -> tuple[Doubles, ...]:
    """Return for each thing (N,) how near it comes (m), then where it begins and ends in x and y, of what is ahead."""
    x, y, ahead = _projected(frame, np.concatenate([one.corners_m for one in things]), room.camera_height_m)
    first = np.cumsum([0, *(len(one.corners_m) for one in things[:-1])])
    low = [np.minimum.reduceat(np.where(ahead > 0.05, v, np.inf), first) for v in (x, y)]
    high = [np.maximum.reduceat(np.where(ahead > 0.05, v, -np.inf), first) for v in (x, y)]
    return np.minimum.reduceat(ahead, first), low[0], high[0], low[1], high[1]


def _seen(frame: Frame, things: Sequence[_Thing], room: RoomModel) -> Doubles:
    """Return for each thing 1 where it is whole in the frame, -1 where it is cut, 0 where it is out of it."""
    high = SIZE_PX[1] / SIZE_PX[0]
    near, left, right, low, top = _ends(frame, things, room) if things else [np.zeros(0)] * 5
    inside_x = (left > MARGIN - 1) & (right < 1 - MARGIN)
    out = (left > 1) | (right < -1) | (top < -high) | (low > high)
    return np.where((near > 0.05) & inside_x & (top < high) & (low > MARGIN - high), 1.0, np.where(out, 0.0, -1.0))


def _overfilled(frame: Frame, things: Sequence[_Thing], room: RoomModel) -> float:
    """Return the share of the picture that things fill beyond what they may, `MOST_FILLED` at most."""
    high, large = SIZE_PX[1] / SIZE_PX[0], [one for one in things if one.most < 1]
    if not large:
        return 0.0
    _, left, right, low, top = _ends(frame, large, room)
    wide, tall = np.clip(right, -1, 1) - np.clip(left, -1, 1), np.clip(top, -high, high) - np.clip(low, -high, high)
    over = np.maximum(wide, 0) * np.maximum(tall, 0) / (4 * high) - [one.most for one in large]
    return min(float(np.maximum(over, 0).sum()), MOST_FILLED)


def _stretched(frame: Frame, turned: Sequence[PlacedItem], room: RoomModel) -> float:
    """Return by how much round things in the frame are drawn out beyond `LEAST_EGG`, in all.

    A sphere's picture on a plane is longer than wide by the secant of its angle from the axis, which a shift keeps."""
    if not turned:
        return 0.0
    middles = np.array([(*one.t_m[:2], one.t_m[2] + one.size_m[2] / 2) for one in turned])
    x, y, ahead = _projected(frame, middles, room.camera_height_m)
    lens = frame.lens_mm / (SENSOR_MM / 2)
    level = y - 2 * frame.drop * SIZE_PX[1] / SIZE_PX[0]
    drawn_out = np.sqrt(1 + (x**2 + level**2) / lens**2) - LEAST_EGG
    wide = np.array([one.size_m[0] for one in turned]) * lens / np.maximum(ahead, 1e-3) / 2
    there = (ahead > 0.05) & (np.abs(x) < 1) & (np.abs(y) < SIZE_PX[1] / SIZE_PX[0])
    return float((there * np.maximum(drawn_out, 0) * np.minimum(wide / ROUND_SHARE, 1)).sum())


def _plain_share(frame: Frame, things: Sequence[_Thing], room: RoomModel) -> float:
    """Return the share of the picture's columns in which neither a piece nor a window is seen."""
    columns, shown = np.linspace(-0.95, 0.95, 39)[:, None], [one for one in things if one.name != "door"]
    _, left, right, *_ = _ends(frame, shown, room) if shown else [np.zeros(0)] * 5
    return float(((columns < left) | (columns > right)).all(axis=1).mean())


def _near_wall_share(frame: Frame, room: RoomModel) -> float:
    """Return the share of the picture's columns that a wall near the camera fills, in a room with wings."""
    floor = np.array(room.floor)
    away = NEAR_WALL_SHARE * float(np.linalg.norm(floor, axis=1).max())
    azimuth = frame.yaw_rad + np.arctan(np.linspace(-0.95, 0.95, 39) * SENSOR_MM / 2 / frame.lens_mm)
    return 1 - float(inside(floor, away * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)).mean())


def _ceiling_share(frames: Sequence[Frame], room: RoomModel) -> Doubles:
    """Return the share of each frame (N,) that the ceiling fills."""
    yaw, lens, drop = np.array([(one.yaw_rad, one.lens_mm, one.drop) for one in frames])[:, :, None].transpose(1, 0, 2)
    aside, high = np.arctan(np.linspace(-0.95, 0.95, 39) * SENSOR_MM / 2 / lens), SIZE_PX[1] / SIZE_PX[0]
    away_m = wall_ranges(room.floor, (yaw + aside).ravel())[0].reshape(aside.shape) * np.cos(aside)
    edge = (room.ceiling_height_m - room.camera_height_m) * lens / (SENSOR_MM / 2) / away_m + 2 * drop * high
    return np.asarray((np.clip(high - edge, 0, None) / (2 * high)).mean(axis=1))


def _composition(frame: Frame, room: RoomModel) -> float:
    """Return what the picture's build is worth: a corner of the room in its inner part, depth, a natural lens."""
    corners = np.array([(x, y, 1.0) for x, y in room.floor])
    x, _, ahead = _projected(frame, corners, room.camera_height_m)
    far = np.linalg.norm(corners[:, :2], axis=1)
    inner = (ahead > 0.05) & (np.abs(x) < 0.75)
    reach = float(far[inner].max()) / max(float(far.max()), 1e-6) if inner.any() else 0.0
    return CORNER * (reach - 0.5) + WIDE_WORTH[frame.lens_mm]
