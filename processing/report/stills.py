"""The stage stills: the room's display, and framed pictures of it as people want to see it; cheap cuts of panoramas.

Three to six frames, where a photographer of interiors would aim from the camera's place. Verticals are upright (the
camera is level, the lens is shifted down), lenses are those of the trade (16 to 24 mm on full frame), two walls meet in
the picture and the far corner is in it, windows are in, and main pieces are whole. Each rule is worth a number; frames
are taken greedily, and what an earlier frame shows counts little again.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from processing.exchange.jpeg_files import Made, lit_by, removed_by, write_jpeg
from processing.exchange.showing import Shown, panes_of, shown_as
from processing.ground.arrays import Doubles
from processing.ground.polygons import inside
from processing.ground.room_model import RoomModel
from processing.layout.arrangement import Arrangements, PlacedItem
from processing.pictures.display import developed
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.writing import estimated
from processing.report.room_states import emptied_as_shown
from processing.sphere import Equirectangular, Perspective
from processing.sphere.resampling import resample_labels
from processing.sphere.views import Panorama, cut_view
from processing.stages.contract import StageContext, StageOutput
from processing.stages.parameters import MOST_STAGED, NO_SUCH, StillsParameters
from processing.stages.upright import in_size, upright_panorama

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
CUT_MAIN, ALONE = 0.6, 1.5  # what it costs more to cut a main piece; what it is worth more in an only frame (chosen)
MAIN, SEATS = ("bed", "single bed", "sofa", "dining table"), ("chair", "armchair", "sofa")
NEVER_WHOLE = 0.2  # of the cost to cut a main piece that no frame shows whole: the camera stands by it (chosen)
OPENINGS = ("window", "door")
MOST_STILLS = MOST + MOST_STAGED - 1  # of the first alternative up to `MOST`, of each further one the best
LIGHT_PX = 960  # chosen: 10 MB a still
MOST_ENLARGED, LEAST_PX = 1.5, 1280  # chosen: a draft's edges are stairs beyond; a plate's code is read from here on


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
    room: RoomModel, items: Sequence[PlacedItem], most: int = MOST, fewest: int = FEWEST
) -> tuple[Frame, ...]:
    """Return frames of a room with these pieces, the best first: ``fewest`` (whatever they are worth) to ``most``."""
    things = _in_sight([*_pieces(items), *_openings(room)], room)
    things = [replace(one, worth=one.worth + ALONE) if one.main and most == 1 else one for one in things]
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
    own -= BARE * bare + FILLS * filled
    gain, cut = np.array([(one.worth, one.cut) for one in things]).reshape(-1, 2).T
    near = np.array([one.main for one in things], bool) & ~(seen == 1).any(axis=0)
    cut = np.where(near, NEVER_WHOLE * cut, cut)
    chosen, shown = list[int](), np.zeros(len(things))
    while len(chosen) < most:
        again = gain * np.where(shown > 0, AGAIN, 1.0)
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


def _composition(frame: Frame, room: RoomModel) -> float:
    """Return what the picture's build is worth: a corner of the room in its inner part, depth, a natural lens."""
    corners = np.array([(x, y, 1.0) for x, y in room.floor])
    x, _, ahead = _projected(frame, corners, room.camera_height_m)
    far = np.linalg.norm(corners[:, :2], axis=1)
    inner = (ahead > 0.05) & (np.abs(x) < 0.75)
    reach = float(far[inner].max()) / max(float(far.max()), 1e-6) if inner.any() else 0.0
    return CORNER * (reach - 0.5) + WIDE_WORTH[frame.lens_mm]


def no_panorama(context: StageContext) -> str | None:
    """Return why there is nothing to frame: no whole panorama."""
    image = context.optional_artifact("calibrate", "indoor")
    if image is None:
        return "the session has no indoor picture"
    whole = isinstance(image.geometry, Equirectangular) and image.rgb.shape[1] == 2 * image.rgb.shape[0]
    return None if whole else "the indoor picture is not a whole panorama"


def run(context: StageContext) -> StageOutput:
    """Write display.json, stills.json and, for each still, its JPEG, its EXR and the unaltered original as JPEG."""
    asked = context.parameters_of(StillsParameters)
    room, facts = context.optional_artifact("room", "room"), context.artifact("calibrate", "calibration")["indoor"]
    indoor = context.artifact("calibrate", "indoor")
    shown = shown_as(upright_panorama(context), indoor, facts, room, context.session.bracket.mode)
    del indoor
    arranged: Arrangements | None = context.optional_artifact("arrange", "arrangement")
    every = () if arranged is None else arranged.arrangements
    originals, made = cache(lambda: _original(context, shown)), list[dict[str, Any]]()
    for number, one in enumerate(every[:MOST_STAGED] if room is not None else (), 1):
        name = f"staged-{number}"
        if not context.has("render", name):
            continue
        assert room is not None
        frames = _framed(context, room, one.items, number, len(every))
        if number == 1:
            frames = with_aimed(aimed(asked.aim, room, one.items), frames)
        make = partial(_stills, context, shown, frames, (name, None, originals), asked, len(made))
        made += _kept(context, name, frames, len(made), make)
    if not made:
        empty = emptied_as_shown(context) if context.has("remove", "empty") else None
        name, image = ("photograph", upright_panorama(context)) if empty is None else ("emptied", empty)
        frames = with_aimed(aimed(asked.aim, room, ()), frames_of(room, ()) if room is not None else AROUND)
        made += _stills(context, shown, frames, (name, image, originals), asked, 0)
    names = [f"still-{k}" for k in range(1, MOST_STILLS + 1)]
    left_out = dict.fromkeys([n for k in names[len(made) :] for n in (k, f"{k}-original", f"{k}-light")], NO_SUCH)
    files = {name: True for k in names[: len(made)] for name in (k, f"{k}-original", f"{k}-light")}
    facts_of_all = {"schema_version": 1, "white": shown.display.said, "stills": made}
    return StageOutput(
        artifacts={"display": shown.display.to_dict(), "stills": facts_of_all, **files},
        metrics={"stills": len(made), "white": shown.display.source, "pull_stops": -math.log2(shown.display.pull)},
        left_out=left_out,
    )


def _framed(
    context: StageContext, room: RoomModel, items: Sequence[PlacedItem], number: int, alternatives: int
) -> tuple[Frame, ...]:
    """Return an alternative's frames, looked for once: the first's good ones, the others' best; `FEWEST` in all."""
    most, fewest = (MOST, max(1, FEWEST + 1 - alternatives)) if number == 1 else (1, 1)
    own = [item.model_dump(mode="json") for item in items]

    def look() -> list[dict[str, Any]]:
        return [{**asdict(one), "shows": list(one.shows)} for one in frames_of(room, items, most, fewest)]

    found = context.part(f"frames-{number}", (), [most, fewest, own], look, apart="arrange")
    return tuple(Frame(**{**one, "shows": tuple(one["shows"])}) for one in found)


def _original(context: StageContext, shown: Shown) -> Panorama:
    """Return the photograph in the film's light, in the size of what was made of it: a draft's is smaller."""
    photograph, filled = upright_panorama(context), context.optional_artifact("remove", "filled")
    found = _whole(shown, photograph if filled is None else in_size(photograph, filled.shape[1]))
    context.let_go()  # of the measured one
    return found


def _whole(shown: Shown, image: LuminanceImage) -> Panorama:
    """Return a panorama in the film's light."""
    panes = panes_of(shown.room, image.geometry, shown.display.views)
    return Panorama(shown.display.light(np.ascontiguousarray(image.rgb), panes))


def _kept(
    context: StageContext, state: str, frames: Sequence[Frame], before: int, make: Callable[[], list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Return the facts of a state's stills, which stay as they are where nothing of them has changed."""
    names = [f"still-{before + k}" for k in range(1, len(frames) + 1)]
    files = tuple(f"{name}{kind}" for name in names for kind in (".jpg", "-original.jpg", "-light.exr"))
    asked = context.parameters_of(StillsParameters)
    own = [state, before, [asdict(one) for one in frames], context.session.name, asked.no_staged_label]
    return [dict(one) for one in context.part(state, files, [*own, asked.original_url], make, apart="arrange")]


def _stills(
    context: StageContext,
    shown: Shown,
    frames: Sequence[Frame],
    of: tuple[str, LuminanceImage | None, Callable[[], Panorama]],
    asked: StillsParameters,
    before: int,
) -> list[dict[str, Any]]:
    """Write a state's stills, numbered from ``before`` + 1, and return their facts."""
    state, originals, image = of[0], of[2](), of[1] or context.artifact("render", of[0])
    context.let_go()  # of the state before
    what = Made.of(state, removed=removed_by(context.summary("remove")), lit=lit_by(state, context.summary))
    panoramas, measured, found = [_whole(shown, image), originals], Panorama(np.ascontiguousarray(image.rgb)), []
    widths = [_width_px(image, frame, LEAST_PX, SIZE_PX[0], MOST_ENLARGED) for frame in frames]
    framed = [(frame, wide, frame.height_px(wide)) for frame, wide in zip(frames, widths, strict=True)]
    cuts = [[developed(cut_view(one, frame.view(wide))[-rows:]) for one in panoramas] for frame, wide, rows in framed]
    panoramas.clear()  # a quarter of a gigabyte
    for number, ((frame, wide, rows), (rgb8, original)) in enumerate(zip(framed, cuts, strict=True), before + 1):
        name = f"still-{number}"
        said = what._replace(original=asked.original_url or f"{name}-original.jpg")
        how: dict[str, Any] = {"relative": not image.absolute, "quality": 90}
        plain = rgb8 if asked.no_staged_label else said.on(rgb8, panorama=False)
        write_jpeg(context.folder / f"{name}.jpg", plain, made=said, title=f"{context.session.name}, {state}", **how)
        write_jpeg(context.folder / f"{name}-original.jpg", original, title=f"{context.session.name}, original", **how)
        cut = _light(image, measured, frame)
        write_exr(context.folder / f"{name}-light.exr", estimated(cut, np.full(cut.validity.shape, bool(said.plate))))
        files = {"file": f"{name}.jpg", "original": f"{name}-original.jpg", "light": f"{name}-light.exr"}
        taken = {"yaw_deg": round(math.degrees(frame.yaw_rad), 2), "lens_mm": frame.lens_mm, "drop": frame.drop}
        rest = {"size_px": [wide, rows], "shows": list(frame.shows), "statement": said.statement}
        found.append({**files, "state": state, **taken, **rest})
    return found


def _width_px(image: LuminanceImage, frame: Frame, least_px: int, most_px: int, enlarged: float = 1.0) -> int:
    """Return a frame's width at the panorama's own density in its middle, or so many times that."""
    own = enlarged * image.rgb.shape[1] / (2 * math.pi) * SENSOR_MM / frame.lens_mm
    return max(least_px, min(most_px, int(own) // 2 * 2))


def _light(image: LuminanceImage, measured: Panorama, frame: Frame) -> LuminanceImage:
    """Return a still's light in the picture's unit: the whole level view, of which the still is the lower part.

    It has the panorama's own resolution at most, and `LIGHT_PX` of width: light is not made up by enlarging."""
    view = frame.view(_width_px(image, frame, 64, LIGHT_PX))
    rgb = cut_view(measured, view)
    doubt = cut_view(np.minimum(image.uncertainty, np.float32(1e3)), view)
    return replace(
        image,
        rgb=np.maximum(rgb, 0),
        uncertainty=np.asarray(doubt, np.float32).reshape(rgb.shape[:2]),
        validity=np.asarray(resample_labels(image.validity, measured.geometry, view), np.uint8),
        geometry=view,
        ghost=None,
        attributes={**image.attributes, "still_lens_mm": frame.lens_mm, "still_rows": frame.height_px(view.width_px)},
    )
