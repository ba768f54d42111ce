"""What a session means for arrangements: assumed furniture and doors, things on walls, a given arrangement judged."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import shapely

from processing.errors import LayoutError, RoomTooSmallError
from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.ground.seam import components, resized, row_latitudes
from processing.ground.tables import table_of
from processing.layout.arrange import arrange
from processing.layout.arrangement import Arrangement
from processing.layout.items import KINDS, set_items
from processing.layout.plan import FloorPlan, Hung, from_room_model
from processing.layout.rules import built_in_rules
from processing.layout.verify import Judge, Piece
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, in_sight, planes_of, surface_maps


def broken_rules(arrangement: Arrangement, plan: FloorPlan) -> str:
    """Return the hard rules of its rule set that an arrangement breaks in a room, with the pieces; empty: none.

    Raises `LayoutError` where furniture stands outside of the room, or is of a kind that does not exist: it was made
    for another room.
    """
    known = built_in_rules()
    rules = known.named(arrangement.rule_set if arrangement.rule_set in known.sets else "standard")
    where = f"--arrangement, alternative {arrangement.rank}"
    unknown = sorted({item.category for item in arrangement.items} - set(KINDS))
    if unknown:
        raise LayoutError(f"no such furniture: {', '.join(unknown)}", where=where, advice="see `daylit furniture`")
    places = np.array([item.t_m[:2] for item in arrangement.items], np.float64).reshape(-1, 2)
    within = shapely.contains_xy(shapely.Polygon(plan.corners), places[:, 0], places[:, 1])
    outside = [item.id for item, fits in zip(arrangement.items, within, strict=True) if not fits]
    if outside:
        text = f"{', '.join(outside)} would be outside the room"
        likely = "it was made for another room, or with another origin (it must be below the camera)"
        advice = "make one for this room: daylit arrange SESSION --keep-camera"
        raise LayoutError(text, where=where, likely=likely, advice=advice)
    return "; ".join(map(str, Judge(plan, rules).judge([Piece.of(item) for item in arrangement.items])))


LIVING_FROM_M2 = 16.0
"""Floor area from which a room that holds both sets is taken for a living room (chosen: bedrooms are smaller)."""
DOOR_M, FROM_CORNER_M = 0.9, 0.15
"""Of the assumed doorway: width, and distance of its frame from the corner (chosen: common in housing)."""


@dataclass(frozen=True)
class Choice:
    """A set of furniture, and why."""

    name: str
    why: str


def named_choice(session_name: str) -> Choice | None:
    """Return the set of furniture that a session's name suggests, None where it suggests none."""
    words = [w for w in re.split(r"[^a-z]+", session_name.lower()) if w]
    for name, known in table_of(__package__, "items")["rooms"].items():
        word = next((w for w in words if w in known), None)
        if word:
            return Choice(name, f"the session's name contains '{word}'")
    return None


def fitting_choice(plan: FloorPlan, rules: str, seed: int) -> Choice:
    """Return the set of which most pieces fit; of equals the one that rooms of this size are usually for."""
    order = ("living", "bedroom", "dining", "office")
    if plan.area_m2 < LIVING_FROM_M2:
        order = ("bedroom", "office", "dining", "living")
    fits: list[tuple[float, int, str, str]] = []
    for place, name in enumerate(order):
        items = set_items(name)
        try:
            made = arrange(plan, items, rules, n=1, seed=seed).arrangements
        except RoomTooSmallError:
            continue
        held = len(made[0].items) if made else 0
        fits.append((-held / len(items), place, name, f"{held} of {len(items)} pieces fit"))
        if held == len(items):
            break
    if not fits:
        return Choice(order[0], f"the session's name suggests no furniture set, and none fits {plan.area_m2:.1f} m2")
    _, _, name, held_text = min(fits)
    return Choice(name, f"the session's name suggests no furniture set; {plan.area_m2:.1f} m2 of floor, {held_text}")


def with_door(room: RoomModel) -> tuple[RoomModel, str]:
    """Return the room with a doorway where it has none, and what was assumed: people have to get in.

    It is put beside a corner of the longest wall without windows, or of the longest wall.
    """
    if any(o.kind is not OpeningKind.WINDOW for o in room.openings):
        return room, ""
    windows = {o.wall for o in room.openings}
    wall = max(range(len(room.floor)), key=lambda k: (k not in windows, room.wall_length_m(k), -k))
    end_m = min(room.wall_length_m(wall), FROM_CORNER_M + DOOR_M)
    if any(o.wall == wall and o.start_m < end_m for o in room.openings):
        return room, ""
    start_m, head_m = max(0.0, end_m - DOOR_M), min(2.0, room.ceiling_height_m)
    door = Opening(
        kind=OpeningKind.PASSAGE, wall=wall, start_m=start_m, end_m=end_m, sill_m=0.0, head_m=head_m, confidence=0.0
    )
    text = f"no door was found here: one is assumed at the start of wall {wall + 1} (to correct it: daylit room --edit)"
    return room.model_copy(update={"openings": (*room.openings, door)}), text


def session_plan(room: RoomModel, hung: Sequence[Hung] = (), name: str = "room") -> tuple[FloorPlan, str]:
    """Return the plan that a session's furniture is arranged on, and what was assumed in it (`with_door`).

    The camera's place stays free: furniture around it would hide the room from the picture.
    """
    room, assumed = with_door(room)
    return from_room_model(room, keep_camera_free=True, name=name, hung=hung), assumed


# What hangs on a room's walls, from what a network saw: pictures, mirrors, radiators, curtains as rectangles.

CELL_M = 0.04  # of the grid on a wall (chosen: finer than a pixel of the evidence, 0.7 degrees, beyond 3 m)
SURE = 0.5  # probability from which a place shows a fixture (chosen: more likely than all else)
LEAST_M, LEAST_M2 = 0.16, 0.04
"""Side and area of the least that counts (chosen: sockets, switches and frames of doors are none)."""
CORNICE_M = 0.12  # what lies this near to the ceiling or, as skirting, to the floor is the wall's own
BESIDE_M = 0.35  # a curtain begins at most this far from its window


def hung_things(room: RoomModel, fixtures: Floats, doors: Floats) -> tuple[Hung, ...]:
    """Return what hangs on the walls, and doors that are no openings of the room, largest first.

    ``fixtures``, ``doors`` (H, 2 H): probability, in an upright panorama from the room's camera, of what stays that is
    neither wall nor opening (`SceneClass.FIXTURE`), and of doors.
    """
    height, width = fixtures.shape
    either = fixtures + doors
    found: list[Hung] = []
    for wall, plane in enumerate(planes_of(room)[FIRST_WALL:]):
        columns, rows = (max(1, round(size / CELL_M)) for size in (plane.width_m, plane.height_m))
        u, v = (np.arange(columns) + 0.5) * CELL_M, (np.arange(rows) + 0.5) * CELL_M
        places = plane.world(u[None, :], v[:, None])
        way = places - (0.0, 0.0, room.camera_height_m)
        far = np.linalg.norm(way, axis=-1)
        x = ((np.arctan2(way[..., 0], way[..., 1]) / (2 * np.pi) + 0.5) * width).astype(int) % width
        y = ((0.5 - np.arcsin(way[..., 2] / far) / np.pi) * height).astype(int).clip(0, height - 1)
        there = (either[y, x] > SURE) & in_sight(room.floor, places[..., :2])
        there &= (v[:, None] > CORNICE_M) & (v[:, None] < plane.height_m - CORNICE_M)
        for opening in (o for o in room.openings if o.wall == wall):
            u0, u1 = plane.width_m - opening.end_m, plane.width_m - opening.start_m
            v0, v1 = plane.height_m - opening.head_m, plane.height_m - opening.sill_m
            there &= ~((u > u0) & (u < u1) & (v[:, None] > v0) & (v[:, None] < v1))
        closed = cv2.morphologyEx(there.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
        for number, (left, top, wide, high, cells) in enumerate(boxes[1:].tolist(), 1):
            if min(wide, high) * CELL_M < LEAST_M or cells * CELL_M**2 < LEAST_M2:
                continue
            end = plane.width_m - left * CELL_M
            sides = max(0.0, end - wide * CELL_M), end
            levels = plane.height_m - (top + high) * CELL_M, plane.height_m - top * CELL_M
            is_door = (doors > fixtures)[y, x][labels == number].mean() > 0.5
            found.append(Hung(wall, *sides, *levels, "door" if is_door else _kind(room, wall, sides, levels)))
    return tuple(sorted(found, key=lambda h: -h.width_m * (h.head_m - h.sill_m)))


NEARER, LEAF_DOUBT, LEAF_M = 0.87, 0.1, (0.8, 1.6)
"""Of the wall's distance, within which something stands before it; probability of doors, on average, from which that is
an open leaf, and heights that it spans at least. Chosen on nine simulated and eight real rooms: of a leaf that stands
open networks are seldom sure."""


def open_doors(room: RoomModel, evidence: SceneEvidence, removed: Flags) -> Flags:
    """Return where (h, w) of the evidence's distances a door stands open: its leaf before a wall, and the doorway.

    ``removed`` (H, W): what is taken out of the picture, which is furniture and no leaf.
    """
    if evidence.reach is None:
        return np.zeros(evidence.probabilities.shape[1:], bool)
    shape = evidence.reach.shape
    geometry = Equirectangular(shape[1], shape[0])
    maps, far_m = surface_maps(room, geometry), evidence.reach * room.camera_height_m
    door = resized(evidence.share(SceneClass.DOOR), shape)
    wall = (maps.plane >= FIRST_WALL) & (maps.opening < 0) & (resized(removed.astype(np.float32), shape) < 0.5)
    near = wall & (far_m < NEARER * maps.depth_m)
    near = cv2.morphologyEx(near.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    level_m = room.camera_height_m + far_m * np.sin(row_latitudes(geometry.height_px))[:, None]
    leaves, (count, labels) = np.zeros(shape, bool), components(near)
    for one in (labels == k for k in range(1, count + 1)):
        low, high = np.percentile(level_m[one], [3, 97])
        if low < LEAF_M[0] and high > LEAF_M[1] and door[one].mean() > LEAF_DOUBT:
            leaves |= one
    _, labels = components(wall & ((door > LEAF_DOUBT) | leaves))
    return np.asarray(np.isin(labels, np.unique(labels[leaves])))


def _kind(room: RoomModel, wall: int, sides: tuple[float, float], levels: tuple[float, float]) -> str:
    """Return what a rectangle on a wall is, by where it hangs and how tall it is."""
    windows = [o for o in room.openings if o.wall == wall and o.kind is OpeningKind.WINDOW]
    gaps = [max(o.start_m - sides[1], sides[0] - o.end_m) for o in windows]
    if min(gaps, default=math.inf) < BESIDE_M and levels[1] - levels[0] > 1.0:
        return "curtain"
    return "radiator" if levels[0] < 0.4 and levels[1] < 1.1 else "picture"
