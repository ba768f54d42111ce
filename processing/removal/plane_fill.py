"""One plane's texture without its holes: which way of filling suits it, region by region."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage

from processing.ground.arrays import Flags, Floats, Indices
from processing.ground.room_model import RoomModel
from processing.pictures.images import luminance_cd_m2
from processing.removal.illumination import ToneScale, grey, known_mean, spread
from processing.removal.near_periodic import SEARCH_PX, Repeat, analyse, complete, plane_sources
from processing.removal.near_periodic_fill import window_around
from processing.removal.plain import fill_plain
from processing.removal.skirting import Skirting
from processing.removal.upright_parts import MOSTLY_THING, Part, ends_level, level_edges, side_px, upright_parts
from processing.surfaces.maps import FIRST_WALL, FLOOR
from processing.surfaces.textures import FRAME_M, Texture, opening_regions

PATTERN = 0.012  # roughness about light and profile from which a wall or ceiling is no plain paint but a pattern
MOST_GRAIN = 0.06  # roughness above which no wall's grain is seen but curtains and things, not copied (chosen)
WALL_NCC = 0.72  # of a wall's lattice: what hangs on it imitates one more easily than on a floor
LITTLE = 0.15  # share of a floor seen under which a lattice must be as strong as on walls (chosen on two real rooms)
LEAST_OPEN = 0.05  # share of an opening that is seen, from which it is there (chosen)
LEAST_BARE = 0.1  # of what is seen of a wall, that must be bare for things on it to be left out (chosen)
LEAST_TEXELS = 30  # known texels of a surface, under which it gets one colour
SEEN, CONTINUED, SYNTHESISED = 0, 1, 2
SURE = 0.35  # confidence under which what was filled is called synthesised


BESIDE_WINDOW_M = 0.25  # where edges are its frame's and its reveal's (chosen by looking at two real rooms)
STRIP_M, STRIP_PX = 0.25, 3.0
"""Beside the hole, of which a column's tone is the mean; at least (chosen)."""
COLUMNS_SEEN = 0.1  # of those of a row and the one above it, from which they say how columns change there (chosen)
ENOUGH = 0.2  # of that change (squared), which a column must be seen in to say whether it goes with the others (chosen)
RAIL_SEEN = 0.25  # of a row of a frame's head or sill, or of a column of its side, from which it is seen (chosen)


def too_bright(luminance: Floats, known: Flags, factor: float = 6.0) -> Flags:
    """Return the known pixels (H, W) ``factor`` times as bright as their surroundings (H, W): lamps, glints."""
    if not known.any():
        return np.zeros_like(known)
    level = np.log(np.maximum(luminance, 1e-9))
    local, _ = known_mean(level, known, max(3.0, 0.08 * max(known.shape)))
    return known & (level > local + math.log(factor))


def hanging(values: Floats, known: Flags, hole: Flags, px_per_m: float, *, even: bool = False) -> Floats:
    """Return a texture (H, W, 3), linear light, whose columns go on in the ``hole`` (H, W) as what is ``known`` ends.

    They become darker or brighter from row to row as those do that are seen there, as far as they do so where they are
    seen themselves: a curtain's hem runs on, a frame beside a pane does not change. ``even``: nothing does. A column of
    which nothing is known is as those beside it.
    """
    scale, rows = ToneScale.of(values, known), np.arange(len(known))[:, None]
    tall = 2 * round(max(STRIP_M * px_per_m, STRIP_PX) / 2) + 1
    share = cv2.blur(known.astype(np.float32), (1, tall))[..., None]
    seen_tone = scale.tone(values)
    profile = np.zeros_like(seen_tone) if even else _downwards(seen_tone, known, (known | hole).any(axis=0).sum())
    tone = cv2.blur(np.where(known[..., None], seen_tone - profile, 0).astype(np.float32), (1, tall))
    above = np.maximum.accumulate(np.where(known, rows, -len(rows)), axis=0)
    below = np.minimum.accumulate(np.where(known, rows, 2 * len(rows))[::-1], axis=0)[::-1]
    nearest = np.where(rows - above <= below - rows, above, below)
    seen = (nearest >= 0) & (nearest < len(rows))
    ends = np.take_along_axis(tone / np.maximum(share, 1e-6), np.where(seen, nearest, 0)[..., None], axis=0)
    return np.where(hole[..., None], scale.light(spread(ends.astype(np.float32), seen) + profile), values)


def _downwards(tone: Floats, known: Flags, columns: int) -> Floats:
    """Return (H, W, 3): by how much the tones (H, W, 3) of each of so many columns change from the first row on."""
    step, both, usual = np.diff(tone, axis=0), known[1:] & known[:-1], np.zeros((len(known), 1, 3), np.float32)
    for row in np.flatnonzero(both.sum(axis=1) > COLUMNS_SEEN * columns):
        usual[row + 1] = np.median(step[row, both[row]], axis=0)
    change = grey(usual[1:])
    alike, much = (change * grey(step) * both).sum(axis=0), (change**2 * both).sum(axis=0)
    sure = np.flatnonzero(much > ENOUGH * much.max())
    if not len(sure):
        return np.zeros_like(tone)
    share = np.interp(np.arange(known.shape[1]), sure, np.clip(alike[sure] / much[sure], 0, 1))
    return np.asarray(np.cumsum(usual, axis=0) * share[:, None], np.float32)


@dataclass(frozen=True)
class FilledPlane:
    """A plane's texture, whole."""

    texture: Texture
    """As seen, holes left out."""
    values: Floats
    """(H, W, 3): as seen where seen, else filled; 0 outside the plane."""
    hole: Flags
    confidence: Floats
    """(H, W)."""
    continued: Flags
    """(H, W): where the surface repeats or is plain, so that its continuation is no invention."""
    how: str


def fill_plane(
    texture: Texture,
    hole: Flags,
    apart: tuple[Flags, Flags],
    room: RoomModel,
    elsewhere: Floats,
    skirting: Skirting | None = None,
) -> FilledPlane:
    """Fill a texture's ``hole`` (H, W).

    ``apart``: texels (H, W) that are known but not copied (sunlight, mixed pixels); what is probably no part of a wall
    (pictures, mirrors, curtains).
    ``elsewhere`` (3,) is the colour of like planes, taken where too little of this one is known; ``skirting`` that of
    the room, for walls that hide their own.
    """
    unfit, things = apart
    known = texture.known & ~hole
    sources = known & ~unfit & ~too_bright(luminance_cd_m2(texture.values), known)
    values = np.where((known | hole)[..., None], texture.values, 0).astype(np.float32)
    if sources.sum() < 0.002 * max(int((known | hole).sum()), 1) or sources.sum() < LEAST_TEXELS:
        values[hole] = _colour(values, sources, elsewhere)
        confidence = np.where(hole, 0.05, 1).astype(np.float32)
        return FilledPlane(texture, values, hole, confidence, ~hole, "nothing of it is seen: one colour")
    confidence = np.ones(hole.shape, np.float32)
    rest, upright = np.ones_like(hole), np.ones_like(hole)
    for region in _with_seen_frames(opening_regions(texture.plane, room, hole.shape, texture.px_per_m), known, texture):
        inside = hole & region
        if (sources & region).sum() < LEAST_OPEN * region.sum():
            # Of an opening that is hidden altogether nobody knows that it is there: the wall goes on.
            continue
        rest &= ~region
        if not region[-1].any():
            # A window's frame and reveal end at its sill: the wall below is one.
            reach = np.ones((1, 2 * round(BESIDE_WINDOW_M * texture.px_per_m) + 1), np.uint8)
            upright &= cv2.dilate(region.astype(np.uint8), reach) == 0
        if inside.any():
            values[inside] = _opening(values, known & region, inside, region, texture.px_per_m)[inside]
            away = cv2.distanceTransform((~(known & region)).astype(np.uint8), cv2.DIST_L2, 5)
            confidence[inside] = 0.66 * np.exp(-away[inside] / (0.35 * max(region.shape)))
    inside = hole & rest
    continued, how = np.ones_like(hole), "openings only"
    if inside.any() and (sources & rest).sum() < LEAST_TEXELS:
        # All that is seen of it is openings, and a wall does not look like what is behind its windows.
        values[inside] = _colour(values, sources & rest, elsewhere)
        confidence[inside], continued[inside], how = 0.05, False, "nothing of it is seen: one colour"
    elif inside.any():
        own = sources & rest
        # Pictures, sockets and the like on walls are left out where these are filled.
        own = plane_sources(values, own, texture.px_per_m) if texture.plane.index == FLOOR else own
        values, sure, goes_on, how = _with_pictures(texture, values, (own, own & upright, things), inside, skirting)
        confidence[inside], continued[inside] = sure[inside], goes_on[inside]
    return FilledPlane(texture, values, hole, confidence, continued, how)


def _with_seen_frames(regions: Iterator[Flags], known: Flags, texture: Texture) -> Iterator[Flags]:
    """Yield the ``regions`` (H, W) of openings without sills and sides of which little is ``known`` (H, W): below and
    beside the pane the wall goes on, not what is seen through it. Of two sides it is enough to see one."""
    wide = max(1, math.ceil(FRAME_M * texture.px_per_m))
    for region in regions:
        sill, columns = np.flatnonzero(region.any(axis=1))[-wide:], np.flatnonzero(region.any(axis=0))
        hidden = _hidden_columns(known & region, region, columns)
        if not region[-1].any():
            region[sill[(known & region)[sill].sum(axis=1) <= RAIL_SEEN * region[sill].sum(axis=1)]] = False
        region[:, columns[hidden & hidden[::-1] & _near_ends(len(columns), wide)]] = False
        yield region


def _hidden_columns(known: Flags, region: Flags, columns: Indices) -> Flags:
    return np.asarray(known[:, columns].sum(axis=0) <= RAIL_SEEN * region[:, columns].sum(axis=0))


def _near_ends(count: int, wide: int) -> Flags:
    return np.minimum(np.arange(count), np.arange(count)[::-1]) < wide


def _opening(values: Floats, known: Flags, hole: Flags, region: Flags, px_per_m: float) -> Floats:
    """Return a texture (H, W, 3) whose ``hole`` (H, W) in the ``region`` (H, W) of an opening and its frame is filled.

    Linear light; ``known`` (H, W): what is seen of the region. Leaves, panes and curtains run upright: each column goes
    on. Head and sill run level: so do their rows. A frame's side that is hidden is as the other one.
    """
    out, part = values.copy(), window_around(region, round(max(STRIP_M * px_per_m, STRIP_PX)) + 1)
    values, (known, hole, region) = values[part], (each[part] for each in (known, hole, region))
    found, rows = hanging(values, known, hole, px_per_m), np.flatnonzero(region.any(axis=1))
    rail, wide = np.zeros_like(hole), max(1, math.ceil(FRAME_M * px_per_m))
    columns = np.flatnonzero(region.any(axis=0))
    hidden = _hidden_columns(known, region, columns)
    alike = hidden & ~hidden[::-1] & _near_ends(len(columns), 2 * wide)
    side = np.ix_(np.arange(len(hole)), columns[alike])
    found[side] = np.where(hole[side][..., None], found[:, columns[::-1][alike]], found[side])
    rail[rows[:wide]] = True
    if not region[-1].any():
        rail[rows[-wide:]] = True
    rail &= (known.sum(axis=1) > RAIL_SEEN * region.sum(axis=1))[:, None]
    level = hanging(values.swapaxes(0, 1), (known & rail).T, (hole & rail).T, px_per_m, even=True).swapaxes(0, 1)
    out[part] = np.where(rail[..., None], level, found)
    return out


def _colour(values: Floats, known: Flags, elsewhere: Floats) -> Floats:
    return elsewhere if known.sum() < LEAST_TEXELS else np.asarray(np.median(values[known], axis=0), np.float32)


def _with_pictures(
    texture: Texture, values: Floats, seen: tuple[Flags, Flags, Flags], hole: Flags, skirting: Skirting | None
) -> tuple[Floats, Floats, Flags, str]:
    """Return what `_by_parts` does, and on a wall what the ``hole`` takes from its pictures."""
    values, sure, continued, how = _by_parts(texture, values, seen, hole, skirting)
    known, things = texture.known & ~hole, seen[2]
    if texture.plane.index >= FIRST_WALL:
        for region in torn_pictures(values, known, things, hole, texture.px_per_m):
            torn = hole & region
            values[torn] = _opening(values, known & region, torn, region, texture.px_per_m)[torn]
            sure[torn], continued[torn] = SURE, False
    return values, sure, continued, how


def _by_parts(
    texture: Texture, values: Floats, seen: tuple[Flags, Flags, Flags], hole: Flags, skirting: Skirting | None
) -> tuple[Floats, Floats, Flags, str]:
    """Return values, confidence, where it is a continuation, and how it was filled: walls between upright edges.

    ``seen``: what may be learnt from; of it, where such edges are; what is probably no part of the wall, (H, W) each.
    """
    wall, (sources, upright, things) = texture.plane.index >= FIRST_WALL, seen
    parts = upright_parts(values, (upright, things), hole, texture.px_per_m) if wall else [Part(slice(None), 0)]
    if len(parts) == 1:
        values, sure, how = _surface(texture, values, _bare(sources, things & wall), hole, skirting)
        return values, sure, np.ones_like(hole), how
    out, sure, continued = values.copy(), np.ones(hole.shape, np.float32), np.ones_like(hole)
    for columns, top in parts:
        part = np.s_[:, columns]
        inside = hole[part]
        fit = sources[part] & (np.arange(len(hole)) >= top)[:, None]
        hangs = fit.any() and things[part][fit].mean() > MOSTLY_THING
        if inside.any() and fit.sum() >= LEAST_TEXELS and not hangs:
            own, fit = replace(texture, density=texture.density[part]), _bare(fit, things[part])
            out[part], sure[part], _ = _surface(own, values[part], fit, inside, skirting)
        elif inside.any():
            out[part] = hanging(values[part], sources[part], inside, texture.px_per_m)
            sure[part], continued[part] = np.where(inside, SURE, 1), False
    return out, sure, continued, f"{len(parts)} parts between upright edges"


def _bare(sources: Flags, things: Flags) -> Flags:
    """Return what a wall is learnt from (H, W) without curtains and other ``things`` (H, W); all if little is left."""
    bare = sources & ~things
    return bare if bare.sum() >= max(LEAST_TEXELS, LEAST_BARE * sources.sum()) else sources


def _surface(
    texture: Texture, values: Floats, sources: Flags, hole: Flags, skirting: Skirting | None
) -> tuple[Floats, Floats, str]:
    """Return values, confidence, and how it was filled: as the surface repeats, or plain."""
    if texture.plane.index == FLOOR:
        little = sources.sum() < LITTLE * (sources | hole).sum()
        found = analyse(values, sources, WALL_NCC if little else 0.0)
        done = complete(values, sources, hole, density=texture.density, found=found)
    else:
        wall = texture.plane.index >= FIRST_WALL
        usual = None
        if wall and skirting is not None:
            paint = np.log(np.maximum(np.median(values[sources], axis=0), 1e-6))
            usual = skirting.rows(len(hole), texture.px_per_m, paint)
        plain = fill_plain(
            values,
            sources,
            hole,
            level_rows=wall,
            usual_rows=usual,
            beside=sources,
            most_rough=MOST_GRAIN,
            px_per_m=texture.px_per_m,
        )
        said = f"plain (roughness {plain.roughness:.3f})"
        if plain.roughness < PATTERN:
            return plain.values, plain.confidence, said
        # Skirting runs along the wall and is no part of its pattern.
        rows = np.exp(plain.profile)
        level = np.asarray(values / rows, np.float32)
        found = analyse(level, plain.clean, sizes=SEARCH_PX[:1])
        if found.repeat is Repeat.NONE or (found.lattice is not None and found.lattice.strength < WALL_NCC):
            return plain.values, plain.confidence, said + ", no pattern"
        done = complete(level, plain.clean, hole, density=texture.density, found=found)
        done = replace(done, values=np.where(hole[..., None], done.values * rows, values))
    kind = "" if done.lattice is None else f", NCC {done.lattice.strength:.2f}"
    return done.values, done.confidence, f"{done.repeat.value}{kind}"


# Pictures and mirrors on walls that lose a part to what is removed before them: a rectangle is seen to go on.
#
# Chosen by the demo's room and eight furnished real ones (docs/measurements/real.md).
AROUND_M = 0.25  # of a thing as the network sees it: where its frame may end, and whose median is the wall's paint
UNLIKE = 0.12  # tone by which a picture or its frame differs from the paint around it
LEAST_M, MOST_M = 0.15, 2.5  # sides of a picture
LOST = (0.005, 0.35)  # share of its rectangle that is removed: less is its rim, of more nobody knows what it was
FULL = 0.95  # of its rectangle as far as that is seen, that it fills: others are several things, or have no corners
ROW_SEEN = 0.25  # of the highest and the lowest row of a picture
RIM_M = 0.3  # below the ceiling and above the floor, within which what ends is a curtain or stands


def torn_pictures(values: Floats, known: Flags, things: Flags, hole: Flags, px_per_m: float) -> Iterator[Flags]:
    """Yield the rectangle (H, W) of each picture on a wall of which a part is in the ``hole`` (H, W).

    ``values`` (H, W, 3): the wall's texture, linear light, where ``known`` (H, W); ``things`` (H, W): what is probably
    no part of it.
    """
    if not (known & things).any() or not (known & ~things).any():
        return
    tone = ToneScale.of(values, known).tone(values)
    around, least = round(AROUND_M * px_per_m), LEAST_M * px_per_m
    labels, _ = ndimage.label(known & things)
    for number, box in enumerate(ndimage.find_objects(labels), 1):
        if min(side.stop - side.start for side in box) < least:
            continue
        rows, columns = (slice(max(0, side.start - around), side.stop + around) for side in box)
        part = np.s_[rows, columns]
        mine, paint = labels[part] == number, known[part] & ~things[part]
        if not paint.any():
            continue
        off = np.abs(tone[part] - np.median(tone[part][paint], axis=0)).max(axis=-1)
        unlike = known[part] & (off > UNLIKE)
        unlike = cv2.morphologyEx(unlike.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        found = _rectangle(unlike.astype(bool), mine, hole[part])
        if found is None:
            continue
        whole, side, low = np.zeros_like(hole), side_px(px_per_m), found[0].stop
        whole[part][found] = True
        # Glass doors and curtains show no lower edge: they go on down.
        level = level_edges(tone[part], known[part], side)[: low + side, found[1]]
        if _is_picture(whole, px_per_m) and ends_level(level, low, px_per_m):
            yield whole


def _rectangle(unlike: Flags, thing: Flags, hole: Flags) -> tuple[slice, slice] | None:
    """Return the box of what is ``unlike`` the wall and hangs together with a thing, (H, W) each; None where it is none
    that the ``hole`` (H, W) cuts."""
    labels, count = ndimage.label(unlike)
    if not count:
        return None
    sizes = np.bincount(labels[thing], minlength=count + 1)
    sizes[0] = 0
    if not sizes.any():
        return None
    own = labels == sizes.argmax()
    box: tuple[slice, slice] = ndimage.find_objects(own.astype(np.int32))[0]
    # Shade below it is narrower than its frame.
    wide = np.flatnonzero(own[box].mean(axis=1) > ROW_SEEN)
    if not wide.size:
        return None
    box = (slice(box[0].start + int(wide[0]), box[0].start + int(wide[-1]) + 1), box[1])
    seen, lost = ~hole[box], float(hole[box].mean())
    if not LOST[0] < lost < LOST[1]:
        return None
    return box if (ndimage.binary_fill_holes(own | hole)[box] & seen).sum() > FULL * seen.sum() else None


def _is_picture(whole: Flags, px_per_m: float) -> bool:
    """Return whether a rectangle (H, W) of a wall is as large as a picture, and hangs."""
    rows, columns = (np.flatnonzero(whole.any(axis=axis)) for axis in (1, 0))
    sides = [len(one) / px_per_m for one in (rows, columns)]
    hangs = rows[0] > RIM_M * px_per_m and rows[-1] < len(whole) - RIM_M * px_per_m
    return bool(hangs and min(sides) >= LEAST_M and max(sides) <= MOST_M)
