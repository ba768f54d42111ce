"""Windows, doors and passages of a room, as rectangles on its walls.

Class evidence says where there is one, the light says where its edges run (`processing.room.opening_fit`). The depth of
the reveals is that of the whole room: the one under which all windows together are explained best.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.room import opening_fit
from processing.room.opening_fit import Box, Candidate, Field, Kind
from processing.room.wall_views import WallView, shown_by, wall_views
from processing.segmentation.evidence import BEYOND, SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.surfaces.maps import surface_maps
from processing.surfaces.textures import unwrap

# What curtains, blinds and furniture hide of a window, by what rooms have in common.
#
# Windows of a room mostly share head and sill; a pair of curtains hangs evenly about its window; a blind that hangs
# from above hides the window's upper part and is as wide as the window.
CLOTH_SHARE = 0.5
STRIP_M = 0.06  # how far from the window cloth must begin
FURTHEST_M = 1.2  # of cloth beside an opening; chosen, never swept
LEAST_BLIND_M, MOST_BLIND_M = 0.08, 2.0
HEAD_REACH_M, SHARED_REACH_M = 0.12, 0.35  # chosen, never swept
SHARED_COST = 0.8  # of the score, that a common head or sill may cost


def uncovered(windows: Sequence[Candidate]) -> list[Candidate]:
    """Return windows with what cloth hides of them added, and with common heads and sills."""
    whole = [_behind_blind(_between_curtains(one)) for one in windows]
    done: list[Candidate] = []
    # Heads and sills are those of the surest one, where that costs little.
    for one in sorted(whole, key=lambda each: -each.score):
        done.append(_aligned(_aligned(one, done, 1), done, 3))
    return done


def _cloth(one: Candidate, rows: tuple[float, float], columns: tuple[float, float], axis: int) -> Doubles:
    """Return the mean share of cloth in a part of the wall, along one axis (0: per row, 1: per column)."""
    view = one.field.view
    p, share = view.px_per_m, view.share[SceneClass.FIXTURE]
    y0, y1 = (int(np.clip(round(v * p), 0, share.shape[0])) for v in rows)
    x0, x1 = (int(np.clip(round(u * p), 0, share.shape[1])) for u in columns)
    return np.asarray(share[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)].mean(axis=1 - axis), dtype=np.float64)


def _run(cloth: Doubles, px_per_m: float) -> float:
    """Return how far cloth reaches from the beginning (m); it may begin within `STRIP_M`."""
    there = cloth > CLOTH_SHARE
    begin = np.flatnonzero(there[: max(1, round(STRIP_M * px_per_m) + 1)])
    if not begin.size:
        return 0.0
    end = np.flatnonzero(~there[begin[0] :])
    return float((begin[0] + end[0]) if end.size else len(there)) / px_per_m


def _between_curtains(one: Candidate) -> Candidate:
    """Return a window widened, under a curtain, to be even about the middle of both curtains."""
    u0, v0, u1, v1 = one.box
    p, width = one.field.view.px_per_m, one.field.view.plane.width_m
    rows = (v0 + 0.25 * (v1 - v0), v0 + 0.75 * (v1 - v0))
    left = _run(_cloth(one, rows, (max(0.0, u0 - FURTHEST_M), u0), 1)[::-1], p)
    right = _run(_cloth(one, rows, (u1, min(width, u1 + FURTHEST_M)), 1), p)
    if min(left, right) <= 0.0:
        return one
    middle = ((u0 - left) + (u1 + right)) / 2
    half = max(middle - u0, u1 - middle)
    return replace(one, box=(max(u0 - left, middle - half), v0, min(u1 + right, middle + half), v1))


def _behind_blind(one: Candidate) -> Candidate:
    """Return a window raised to the upper end of a blind that hangs over it."""
    u0, v0, u1, v1 = one.box
    view = one.field.view
    above = _run(_cloth(one, (max(0.0, v0 - MOST_BLIND_M), v0), (u0 + 0.1, u1 - 0.1), 0)[::-1], view.px_per_m)
    if above < LEAST_BLIND_M:
        return one
    rows = (v0 - above, v0)
    beside = [
        float(_cloth(one, rows, columns, 1).mean())
        for columns in ((u0 - 0.3, u0 - 0.12), (u1 + 0.12, u1 + 0.3))
        if columns[0] >= 0 and columns[1] <= view.plane.width_m
    ]
    if beside and max(beside) > CLOTH_SHARE:
        return one
    # The edge near the upper end of a blind; that end itself where there is none. The outermost texels are left out:
    # the wall's own edge with the ceiling runs there, and none is counted.
    above_m = max(0.0, v0 - above)
    p = one.field.view.px_per_m
    tried = np.arange(max(1.5 / p, above_m - HEAD_REACH_M), above_m + HEAD_REACH_M, 0.5 / p)
    edge = np.array([one.field.level_edge(float(v), one.box[0], one.box[2]) for v in tried])
    return replace(one, box=(u0, float(tried[int(edge.argmax())]) if edge.size and edge.max() > 0 else above_m, u1, v1))


def _aligned(one: Candidate, surer: list[Candidate], side: int) -> Candidate:
    """Return a window with the head (side 1) or sill (3) of the first of surer ones under which it is as good."""
    least = opening_fit.score_of(one.field, one.recess_m, one.box) - SHARED_COST
    for other in surer:
        theirs = other.box[side]
        if abs(theirs - one.box[side]) > SHARED_REACH_M:
            continue
        u0, v0, u1, v1 = one.box
        box = (u0, theirs, u1, v1) if side == 1 else (u0, v0, u1, theirs)
        if opening_fit.score_of(one.field, one.recess_m, box) >= least:
            return replace(one, box=box)
    return one


LEAST_SHARE = 0.5  # more likely than not
LEAST_AREA_M2 = 0.08  # 28 by 28 cm; chosen, never swept
LEAST_SCORE = {SceneClass.WINDOW: 2.5, SceneClass.DOOR: 4.0}
LEAST_BLIND_SCORE = 8.0  # below, too little speaks for an opening
WIDEST_DOOR_M = 1.5  # what is wider is taken for a passage
FULL_SCORE = 10.0  # chosen, never swept
DIMMEST_PANE_STOPS = 6.0
"""By which the brightest tenth of a window may be darker than the sky's median: glass, trees, houses."""
GAP_M = 0.1  # narrower bars across an opening do not divide it
BLIND_GAP_M = 0.05  # between slats that count as one cloth; chosen, never swept
GLIMPSE, LEAST_GLIMPSE, GLIMPSED_SHARE, FULL_SHARE, BLIND_SHARE = 0.15, 0.4, 0.7, 0.8, 0.3
"""Behind a blind a window is glimpsed, somewhere clearly; in what share of the columns; how full the rectangle of both
is; how much of it is cloth."""
DAY_STOPS, WALL_STOPS, PLAIN_STOPS, PIER_M = 1.5, 0.5, 0.6, 0.2
"""By which panes are brighter than the wall by day; within which, across and down, columns of a window are like the
wall beside it and plain; and least width of what is taken for wall then (chosen)."""
FLOOR_M = 0.16  # a window whose lower edge is lower is a glass door
BOARD_M = 0.025  # a window's lower edge is that of its sill board, which is so thick


def find_openings(
    image: RelativeImage | LuminanceImage,
    evidence: SceneEvidence,
    room: RoomModel,
    *,
    outdoor: LuminanceImage | None = None,
) -> tuple[Opening, ...]:
    """Return the openings of a room (its own are not looked at) in an upright equirectangular picture.

    Where the evidence is a mean of two networks', doors are looked for in ours alone too: the mean misses many.
    ``outdoor``: the sky's picture of the same moment; windows in a picture in cd/m2 must then be as bright as what it
    shows, through glass, or their confidence is halved. Openings never overlap; those too small are left out.

    Raises `RoomError` where the room cannot stand.
    """
    seen = wall_views(image, evidence, room)
    views = tuple(_plain_is_wall(view) for view in seen)
    windows = [one for one in uncovered(_of_kind(views, opening_fit.WINDOW)) if not _beyond(one, evidence, room)]
    found = [*windows, *_of_kind(views, opening_fit.DOOR)]
    if evidence.own is not None:
        found += _of_kind(shown_by(evidence.own, image.geometry, room, seen), opening_fit.DOOR)
    outside = luminance_outside(image, outdoor)
    return tuple(_opening(one, room, outside) for one in _apart(found))


def _beyond(window: Candidate, evidence: SceneEvidence, room: RoomModel) -> bool:
    """Return whether a window is the next room's: by the network's distances what is around it lies far behind it."""
    if evidence.reach is None:
        return False
    view, sphere = window.field.view, Equirectangular(*evidence.reach.shape[::-1])
    times = evidence.reach * np.float32(room.camera_height_m) / surface_maps(room, sphere).depth_m
    seen = unwrap(times, sphere, room, view.plane, view.px_per_m).values.reshape(view.known.shape)
    around = opening_fit.inside_around(window)[1] & (window.field.shown < LEAST_SHARE)
    return bool(around.any() and np.median(seen[around]) > BEYOND)


def luminance_outside(image: RelativeImage | LuminanceImage, outdoor: LuminanceImage | None) -> float | None:
    """Return the log2 of the median outdoor luminance over the panorama's median, None where it is unknown."""
    if outdoor is None or not isinstance(image, LuminanceImage):
        return None
    sky, room = (luminance_cd_m2(one.rgb)[one.validity != Validity.OUTSIDE] for one in (outdoor, image))
    sky, room = sky[sky > 0], room[room > 0]
    return float(np.log2(np.median(sky) / np.median(room))) if sky.size and room.size else None


def _of_kind(views: tuple[WallView, ...], kind: Kind) -> list[Candidate]:
    """Return the fitted openings of a kind on all walls, at the recess that suits all of them."""
    fields = [Field(view, kind) for view in views]
    if kind is opening_fit.WINDOW:
        fields += [Field(view, kind, cloth=True) for view in views]
    starts = [(field, box) for field in fields for box in proposals(field)]
    if not starts:
        return []
    best: tuple[float, list[Candidate]] = (-math.inf, [])
    for recess in kind.recesses_m:
        tried = [_fit(field, recess, shown) for field, shown in starts]
        unusual = 0.5 * ((recess - kind.usual_recess_m[0]) / kind.usual_recess_m[1]) ** 2
        total = sum(one.score - unusual for one in tried)
        best = max(best, (total, tried), key=lambda entry: entry[0])
    sure = [one for one in best[1] if one.score > (LEAST_BLIND_SCORE if one.field.cloth else LEAST_SCORE[kind.shown])]
    return [opening_fit.fitted_last(one) for one in sure]


def _fit(field: Field, recess: float, shown: Box) -> Candidate:
    value, box = opening_fit.fitted(field, recess, opening_fit.box_of_shown(field.view, recess, shown))
    return Candidate(field, box, recess, value)


def _plain_is_wall(view: WallView) -> WallView:
    """Return a view in which no column of a window is plain and as bright as the wall beside the window, by day.

    Networks see little of what stands or hangs before a wall near windows, and take the wall between for window."""
    share, p, panes = view.share, view.px_per_m, proposals(Field(view, opening_fit.WINDOW))
    rows = np.where(view.known, view.log_luminance, np.nan)
    wide, narrow = max(1, round(opening_fit.AROUND_M * p)), np.ones((1, max(1, round(PIER_M * p))), np.uint8)
    for u0, v0, u1, v1 in (tuple(round(side * p) for side in box) for box in panes):
        seen = rows[v0:v1]
        low, middle, high = np.nanpercentile(np.where(np.isnan(seen).all(axis=0), 0, seen), [25, 50, 75], axis=0)
        like, pane = np.zeros(len(middle), bool), float(np.percentile(high[u0:u1], 75))
        for beside in (middle[max(0, u0 - wide) : u0], middle[u1 : u1 + wide]):
            if beside.size and pane - np.median(beside) > DAY_STOPS:
                like[u0:u1] |= np.abs(middle - np.median(beside))[u0:u1] < WALL_STOPS
        like &= high - low < PLAIN_STOPS
        wall = cv2.morphologyEx(like[None].astype(np.uint8), cv2.MORPH_OPEN, narrow).ravel().astype(bool)
        upright = np.abs(view.edges[0])[v0:v1].mean(axis=0)
        for end, inwards in ((u0, slice(u0, u1)), (u1, slice(u1 - 1, u0 - 1 if u0 else None, -1))):
            # Where an edge ends the window, what has the wall's brightness behind it is a curtain.
            if upright[max(0, end - wide // 2) : end + wide // 2].max(initial=0) > opening_fit.COMMON_EDGE:
                other = np.flatnonzero(~wall[inwards])
                wall[inwards][: int(other[0]) if other.size else None] = False
        if wall.any():
            share = share.copy() if share is view.share else share
            part = share[:, max(0, v0 - wide) : v1 + wide, wall]
            part[SceneClass.WALL] += part[SceneClass.WINDOW]
            part[SceneClass.WINDOW] = 0
            share[:, max(0, v0 - wide) : v1 + wide, wall] = part
    return view if share is view.share else replace(view, share=share)


def proposals(field: Field) -> list[Box]:
    """Return boxes (u0, v0, u1, v1) around what is surely of the kind: what is seen of it, not the opening itself."""
    view, p = field.view, field.view.px_per_m
    there = ((field.shown > LEAST_SHARE) & view.known).astype(np.uint8)
    size = max(1, round((BLIND_GAP_M if field.cloth else GAP_M) * p)) | 1
    closed = cv2.morphologyEx(there, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
    found = []
    for label in range(1, count):
        if stats[label, cv2.CC_STAT_AREA] < LEAST_AREA_M2 * p**2:
            continue
        rows, columns = np.nonzero(labels == label)
        # Its sides lie where most of its rows and columns end, not where a spur reaches to.
        u0, u1 = (int(value) for value in np.percentile(columns, [2, 98]))
        v0, v1 = (int(value) for value in np.percentile(rows, [2, 98]))
        if field.cloth:
            # What hangs below the lowest glimpse of a window is a radiator or a curtain's end.
            glimpsed = np.flatnonzero(field.share[field.kind.shown][v0 : v1 + 1, u0 : u1 + 1].max(axis=1) > GLIMPSE)
            v1 = v0 + (int(glimpsed[-1]) if glimpsed.size else 0)
            if not _is_blind(field, labels == label, (u0, v0, u1 + 1, v1 + 1)):
                continue
        bottom = view.plane.height_m if field.kind.to_floor else (v1 + 1) / p
        found.append((u0 / p, v0 / p, (u1 + 1) / p, bottom))
    return found


def _is_blind(field: Field, there: Flags, texels: tuple[int, int, int, int]) -> bool:
    """Return whether cloth and window form one rectangle, and cloth hangs before the window rather than beside it."""
    u0, v0, u1, v1 = texels
    window = field.share[field.kind.shown][v0:v1, u0:u1]
    cloth = field.share[SceneClass.FIXTURE][v0:v1, u0:u1]
    if not window.size or window.max() < LEAST_GLIMPSE or there[v0:v1, u0:u1].mean() < FULL_SHARE:
        return False
    glimpsed = window.max(axis=0) > GLIMPSE
    return bool(glimpsed.mean() > GLIMPSED_SHARE and np.median(cloth[:, glimpsed].mean(axis=0)) > BLIND_SHARE)


def _apart(found: list[Candidate]) -> list[Candidate]:
    """Return candidates that do not overlap: of two, the one with less to say for it gives way."""
    kept: list[Candidate] = []
    for one in sorted(found, key=lambda c: -c.score):
        beside = [other for other in kept if other.field.view.wall == one.field.view.wall]
        u0, v0, u1, v1 = one.box
        if min(u1 - u0, v1 - v0) >= opening_fit.LEAST_SIDE_M and not any(_overlap(one, other) for other in beside):
            kept.append(one)
    return kept


def _overlap(one: Candidate, other: Candidate) -> bool:
    a, b = _to_floor(one), _to_floor(other)
    return min(a[2], b[2]) - max(a[0], b[0]) > 0 and min(a[3], b[3]) - max(a[1], b[1]) > 0


def _to_floor(one: Candidate) -> Box:
    """Return a candidate's rectangle, down to the floor where it nearly reaches it."""
    height = one.field.view.plane.height_m
    u0, v0, u1, v1 = one.box
    return u0, v0, u1, height if one.field.kind.to_floor or height - v1 < FLOOR_M else v1


def _opening(one: Candidate, room: RoomModel, outside: float | None) -> Opening:
    view = one.field.view
    u0, v0, u1, v1 = _to_floor(one)
    length, height = view.plane.width_m, view.plane.height_m
    kind = OpeningKind.WINDOW if one.field.kind is opening_fit.WINDOW else OpeningKind.DOOR
    if kind is OpeningKind.DOOR and u1 - u0 > WIDEST_DOOR_M:
        kind = OpeningKind.PASSAGE
    return Opening(
        kind=kind,
        wall=view.wall,
        start_m=max(0.0, length - u1),
        end_m=min(length, length - u0),
        sill_m=max(0.0, height - v1 + (BOARD_M if v1 < height and not one.field.kind.to_floor else 0.0)),
        head_m=min(height - v0, room.ceiling_height_m),
        confidence=_confidence(one, outside),
    )


def _confidence(one: Candidate, outside: float | None) -> float:
    """Return how surely the opening is there: how clearly its inside is of its class, and how much speaks for it."""
    shown = opening_fit.shown_box(one.field.view, one.recess_m, one.box)
    area = max((shown[2] - shown[0]) * (shown[3] - shown[1]), 1e-6)
    inside = float(np.clip(one.field.region(shown) / area, 0.0, 1.0))
    surely = math.sqrt(inside) * float(np.clip(one.score / FULL_SCORE, 0.0, 1.0))
    if outside is not None and one.field.kind is opening_fit.WINDOW and _brightest(one) < outside - DIMMEST_PANE_STOPS:
        surely /= 2
    return surely


def _brightest(one: Candidate) -> float:
    """Return the log2 luminance, over the panorama's median, that a tenth of the window exceeds."""
    view, p = one.field.view, one.field.view.px_per_m
    u0, v0, u1, v1 = (round(side * p) for side in one.box)
    part, known = view.log_luminance[v0:v1, u0:u1], view.known[v0:v1, u0:u1]
    return float(np.percentile(part[known], 90)) if known.any() else -math.inf
