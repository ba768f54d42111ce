"""One plane's texture without its holes: which way of filling suits it, region by region."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from processing.ground.arrays import Flags, Floats, Indices
from processing.ground.room_model import RoomModel
from processing.pictures.images import luminance_cd_m2
from processing.removal.illumination import ToneScale, grey, known_mean, spread
from processing.removal.near_periodic import SEARCH_PX, Repeat, analyse, complete, plane_sources
from processing.removal.near_periodic_fill import window_around
from processing.removal.plain import fill_plain
from processing.removal.skirting import Skirting
from processing.removal.upright_parts import MOSTLY_THING, UNLIKE, Part, torn_pictures, upright_parts
from processing.surfaces.maps import FIRST_WALL, FLOOR
from processing.surfaces.textures import FRAME_M, Texture, opening_regions

PATTERN = 0.012  # roughness about light and profile from which a wall or ceiling is no plain paint but a pattern
MOST_GRAIN = 0.06  # roughness above which no wall's grain is seen but curtains and things, not copied (chosen)
WALL_NCC = 0.72  # of a wall's lattice: what hangs on it imitates one more easily than on a floor
LITTLE = 0.15  # share of a floor seen under which a lattice must be as strong as on walls (chosen on two real rooms)
LEAST_OPEN = 0.05  # share of an opening that is seen, from which it is there (chosen)
LEAST_BARE = 0.1  # of what is seen of a wall, that must be bare for things on it to be left out (chosen)
BORDER, OTHER_BORDER = 0.06, 1.0
"""Share of a wall that is seen, up to which that may be a border, and natural logarithm by which its light then differs
from other walls' (chosen on one real room of nine)."""
LEAST_TEXELS = 30  # known texels of a surface, under which it gets one colour
SEEN, CONTINUED, SYNTHESISED = 0, 1, 2
SURE = 0.35  # confidence under which what was filled is called synthesised


LAG = 6  # of the columns of a frame, by which two are apart that are compared (chosen)
BESIDE_WINDOW_M = 0.25  # where edges are its frame's and its reveal's (chosen by looking at two real rooms)
STRIP_M, STRIP_PX = 0.25, 3.0  # beside the hole, of which a column's tone is the mean; at least (chosen)
RIM_M, RIM_PX = 0.06, 2  # beside what hid it, as wide as masks err (two pixels at five metres); at least (chosen)
COLUMNS_SEEN = 0.1  # of those of a row and the one above it, from which they say how columns change there (chosen)
ENOUGH = 0.2  # of that change (squared), which a column must be seen in to say whether it goes with the others (chosen)
RAIL_SEEN = 0.25  # of a row of a frame's head or sill, or of a column of its side, from which it is seen (chosen)
PANE_SEEN = 0.5  # of a column near a frame's hidden side, up to which what is seen in it is continued level (chosen)


def too_bright(luminance: Floats, known: Flags, factor: float = 6.0) -> Flags:
    """Return the known pixels (H, W) ``factor`` times as bright as their surroundings (H, W): lamps, glints."""
    if not known.any():
        return np.zeros_like(known)
    level = np.log(np.maximum(luminance, 1e-9))
    local, _ = known_mean(level, known, max(3.0, 0.08 * max(known.shape)))
    return known & (level > local + math.log(factor))


def hanging(
    values: Floats, known: Flags, hole: Flags, px_per_m: float, *, even: bool = False, strip_m: float = STRIP_M
) -> Floats:
    """Return a texture (H, W, 3), linear light, whose columns go on in the ``hole`` (H, W) as what is ``known`` ends.

    They become darker or brighter from row to row as those do that are seen there, as far as they do so where they are
    seen themselves: a curtain's hem runs on, a frame beside a pane does not change. ``even``: nothing does. A column of
    which nothing is known is as those beside it. Nothing is learnt from the hole's rim, where masks end too early."""
    scale, rows = ToneScale.of(values, known), np.arange(len(known))[:, None]
    tall = 2 * round(max(strip_m * px_per_m, STRIP_PX) / 2) + 1
    seen_tone = scale.tone(values)
    profile = np.zeros_like(seen_tone) if even else _downwards(seen_tone, known, (known | hole).any(axis=0).sum())
    rim = np.ones((2 * max(RIM_PX, round(RIM_M * px_per_m)) + 1, 1), np.uint8)
    clear = known & (cv2.dilate(hole.astype(np.uint8), rim) == 0)
    known = clear | (known & ~clear.any(axis=0))
    share = cv2.blur(known.astype(np.float32), (1, tall))[..., None]
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
    the room, for walls that hide their own."""
    unfit, things = apart
    known = texture.known & ~hole
    sources = known & ~unfit & ~too_bright(luminance_cd_m2(texture.values), known)
    values = np.where((known | hole)[..., None], texture.values, 0).astype(np.float32)
    if (only := _only_colour(values, sources, known | hole, elsewhere, texture.plane.index >= FIRST_WALL)) is not None:
        values[hole] = only
        confidence = np.where(hole, 0.05, 1).astype(np.float32)
        return FilledPlane(texture, values, hole, confidence, ~hole, "nothing of it is seen: one colour")
    confidence = np.ones(hole.shape, np.float32)
    rest, upright, walls = np.ones((3, *hole.shape), bool)
    for around in filter(np.any, opening_regions(texture.plane, room, hole.shape, texture.px_per_m)):
        region = _seen_of_frame(around, known, texture)
        inside = hole & region
        if (sources & region).sum() < LEAST_OPEN * region.sum():
            # Of an opening that is hidden altogether nobody knows that it is there: the wall goes on.
            continue
        rest, walls, sources = rest & ~region, walls & ~around, sources & ~(around & ~region)
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
        shown = replace(texture, known=known & walls)
        values, sure, goes_on, how = _with_pictures(shown, values, (own, own & upright, things), inside, skirting)
        confidence[inside], continued[inside] = sure[inside], goes_on[inside]
    return FilledPlane(texture, values, hole, confidence, continued, how)


def _seen_of_frame(region: Flags, known: Flags, texture: Texture) -> Flags:
    """Return the ``region`` (H, W) of an opening without sill and sides of which little is ``known`` (H, W): below and
    beside the pane the wall goes on, not what is seen through it. Of two sides one is enough: the other is as wide."""
    wide, found = max(1, math.ceil(FRAME_M * texture.px_per_m)), region.copy()
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    ends = np.minimum(np.arange(len(columns)), np.arange(len(columns))[::-1])
    hidden = (known & region)[:, columns].sum(axis=0) <= RAIL_SEEN * region[:, columns].sum(axis=0)
    if not region[-1].any():
        seen = (known & region)[rows[-wide:]].sum(axis=1) > RAIL_SEEN * region[rows[-wide:]].sum(axis=1)
        found[rows[-wide:][~seen]] = False
    tone = np.log(np.maximum(grey(texture.values[..., :3]), 1e-6))
    wall = [_wall_beside(tone, known, rows, one, wide) for one in (columns, columns[::-1])]
    found[rows[: _wall_beside(tone.T, known.T, columns, rows, wide)]] = False
    first, last = (max(wall) if hidden[-end] else wall[end] for end in (0, 1))
    beside = (np.arange(len(columns)) < first) | (np.arange(len(columns))[::-1] < last)
    found[:, columns[beside | (hidden & hidden[::-1] & (ends < wide))]] = False
    return found


def _wall_beside(tone: Floats, known: Flags, rows: Indices, columns: Indices, wide: int) -> int:
    """Return how many of a region's columns, up to so many, are seen as the wall before the first one, row by row.

    ``tone``, ``known`` (H, W); ``columns`` (n,) from the wall on. Walls get brighter towards a bright pane, step by
    step, so a column is compared with one a little before it."""
    step, lag = int(columns[-1] > columns[0]) * 2 - 1, max(1, wide // LAG)
    at = columns[0] + step * np.arange(-lag, min(wide, len(columns)))
    if at.min() < 0 or at.max() >= tone.shape[1]:
        return 0
    shown, seen = tone[np.ix_(rows, at)], known[np.ix_(rows, at)]
    both = seen[:, lag:] & seen[:, :-lag]
    apart = (np.abs(shown[:, lag:] - shown[:, :-lag]) * both).sum(axis=0) / np.maximum(both.sum(axis=0), 1)
    alike = (apart < UNLIKE / 2) & (both.sum(axis=0) > RAIL_SEEN * len(rows))
    return int(np.append(~alike, True).argmax())


def _opening(values: Floats, known: Flags, hole: Flags, region: Flags, px_per_m: float) -> Floats:
    """Return a texture (H, W, 3) whose ``hole`` (H, W) in the ``region`` (H, W) of an opening and its frame is filled.

    Linear light; ``known`` (H, W): what is seen of the region. Head and sill run level: so do their rows, as far as no
    side of the frame, or wall beside it, is seen to come down. Leaves, panes and curtains run upright: each column goes
    on. A frame's side that is hidden is as the other one."""
    out, part = values.copy(), window_around(region, round(max(STRIP_M * px_per_m, STRIP_PX)) + 1)
    values, (known, hole, region) = values[part], (each[part] for each in (known, hole, region))
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    rail, wide = np.zeros_like(hole), max(1, math.ceil(FRAME_M * px_per_m))
    hidden = known[:, columns].sum(axis=0) <= RAIL_SEEN * region[:, columns].sum(axis=0)
    rail[rows[:wide]] = True
    if not region[-1].any():
        rail[rows[-wide:]] = True
    rail &= (known.sum(axis=1) > RAIL_SEEN * region.sum(axis=1))[:, None]
    for end in (columns[:wide], columns[::-1][:wide]):
        rail[:, end[: _as_the_first(values, known, end)]] = False
    rail &= _in_one_tone(values, known & rail)[:, None]
    level = hanging(values.swapaxes(0, 1), (known & rail).T, (hole & rail).T, px_per_m, even=True).swapaxes(0, 1)
    found = np.where(rail[..., None], level, hanging(values, known, hole, px_per_m, strip_m=FRAME_M / 2))
    low = np.flatnonzero(rail.any(axis=1))
    if len(low) and low[-1] >= rows[-wide:][0]:
        ends = slice(low[-1] + 1, rows[-1] + 1)  # where a sill is seen at a few places only
        found[ends] = np.where((hole[ends] & rail[low[-1]])[..., None], found[low[-1]], found[ends])
    inwards = np.arange(len(columns))
    hidden = known[:, columns].sum(axis=0) <= PANE_SEEN * region[:, columns].sum(axis=0)
    alike = hidden & ~hidden[::-1] & (np.minimum(inwards, inwards[::-1]) < 3 * wide)
    own = np.array([_median(values, known, np.array([one])) for one in columns])
    if region[-1].any():  # what is seen of a door's side that is unlike the other, a doorway by an open leaf, goes on
        alike &= ~np.isfinite(own) | (abs(np.subtract(own, own[::-1], where=alike, out=np.zeros(len(own)))) < UNLIKE)
    if alike.any() and not hidden.all():
        # A frame whose inner edge is seen, darker or brighter than the view, is only wider.
        inner = columns[~hidden][-1 if alike[-1] else 0]
        frame, here = (_median(values, known, np.array([one])) for one in (columns[0 if alike[-1] else -1], inner))
        seen = abs(here - frame) < abs(here - _median(values, known, columns))
        # Of the other side only what is frame: what is seen through the pane goes on from what is seen beside it.
        tones = own[::-1][alike]
        ends, framed = np.minimum(inwards, inwards[::-1])[alike], np.abs(tones - frame) < np.abs(tones - here)
        mirrored = (not seen) & (ends < ends[~framed].min(initial=len(columns)))
        side = np.ix_(np.arange(len(hole)), columns[alike])
        others = found[:, np.where(mirrored, columns[::-1][alike], inner)]
        found[side] = np.where(hole[side][..., None], others, found[side])
    out[part] = found
    return out


def _as_the_first(values: Floats, known: Flags, columns: Indices) -> int:
    """Return how many of a texture's ``columns`` (n,) are seen to have the tone of the first one: none if it is not."""
    usual = [_median(values, known, np.array([one])) for one in columns]
    return int(np.append(~(np.abs(np.subtract(usual, usual[0])) < UNLIKE), True).argmax()) if usual[0] < math.inf else 0


def _median(values: Floats, known: Flags, columns: Indices) -> float:
    """Return the median tone of what is ``known`` (H, W) of a texture's ``columns`` (n,); infinite if nothing is."""
    light = grey(values[:, columns])[known[:, columns]]
    return math.log(max(float(np.median(light)), 1e-6)) if light.size else math.inf


def _in_one_tone(values: Floats, known: Flags) -> Flags:
    """Return the rows (H,) of which most that is ``known`` (H, W) has one tone: rails, and no view."""
    tone = np.ma.masked_array(np.log(np.maximum(grey(values), 1e-6)), ~known)
    apart = np.ma.median(np.abs(tone - np.ma.median(tone, axis=1, keepdims=True)), axis=1)  # type: ignore[no-untyped-call]
    return np.asarray(np.ma.filled(apart, math.inf) < UNLIKE)


def _only_colour(values: Floats, known: Flags, whole: Flags, elsewhere: Floats, wall: bool) -> Floats | None:
    """Return the colour of a surface (H, W, 3) of which next to nothing is ``known`` (H, W), or of a wall but a border
    unlike the other walls; None: more is."""
    own, share = _colour(values, known, elsewhere), known.sum() / max(int(whole.sum()), 1)
    if wall and share < BORDER and abs(math.log(max(own.mean(), 1e-6) / max(elsewhere.mean(), 1e-6))) > OTHER_BORDER:
        return elsewhere
    return own if share < 0.002 or known.sum() < LEAST_TEXELS else None


def _colour(values: Floats, known: Flags, elsewhere: Floats) -> Floats:
    return elsewhere if known.sum() < LEAST_TEXELS else np.asarray(np.median(values[known], axis=0), np.float32)


def _with_pictures(
    texture: Texture, values: Floats, seen: tuple[Flags, Flags, Flags], hole: Flags, skirting: Skirting | None
) -> tuple[Floats, Floats, Flags, str]:
    """Return what `_by_parts` does, and on a wall what the ``hole`` takes from its pictures."""
    values, sure, continued, how = _by_parts(texture, values, seen, hole, skirting)
    known, things = texture.known & ~hole, seen[2]
    if texture.plane.index >= FIRST_WALL:
        for region, closed in torn_pictures(values, known, things, hole, texture.px_per_m):
            torn, rows = hole & region, np.flatnonzero(region.any(axis=1))
            drawn = _opening(values, known & region, torn, region, texture.px_per_m)
            drawn[rows[len(rows) - closed :]] = drawn[rows[:closed][::-1]]
            values[torn] = drawn[torn]
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
