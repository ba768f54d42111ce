"""One plane's texture without its holes: which way of filling suits it, region by region."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.ground.seam import resized
from processing.pictures.images import luminance_cd_m2
from processing.removal.illumination import ToneScale, grey, known_mean, spread
from processing.removal.near_periodic import Repeat, analyse, complete
from processing.removal.plain import fill_plain
from processing.removal.sources import plane_sources
from processing.removal.upright_parts import Part, upright_parts
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, FLOOR, Plane, planes_of
from processing.surfaces.textures import Texture, unwrap

PATTERN = 0.012  # roughness about light and profile from which a wall or ceiling is no plain paint but a pattern
MOST_GRAIN = 0.06  # roughness above which no wall's grain is seen but curtains and things, not copied (chosen)
WALL_NCC = 0.72  # of a wall's lattice: what hangs on it imitates one more easily than on a floor
LITTLE = 0.15  # share of a floor seen under which a lattice must be as strong as on walls (chosen on two real rooms)
LEAST_TEXELS = 30  # known texels of a surface, under which it gets one colour
SEEN, CONTINUED, SYNTHESISED = 0, 1, 2
SURE = 0.35  # confidence under which what was filled is called synthesised


MOSTLY_THING = 0.5  # of what is seen of a wall's part, from which it is a curtain and no wall (chosen)
FRAME_M = 0.08  # around an opening: its frame belongs to it
BESIDE_WINDOW_M = 0.25  # where edges are its frame's and its reveal's (chosen by looking at two real rooms)


def opening_regions(plane: Plane, room: RoomModel, shape: tuple[int, int], px_per_m: float) -> Iterator[Flags]:
    """Yield (H, W) for each opening of a wall: its rectangle with its frame."""
    v, u = ((np.arange(n) + 0.5) / px_per_m for n in shape)
    for opening in room.openings:
        if opening.wall + FIRST_WALL != plane.index:
            continue
        right, left = plane.width_m - opening.start_m + FRAME_M, plane.width_m - opening.end_m - FRAME_M
        top = plane.height_m - opening.head_m - FRAME_M
        low = plane.height_m - opening.sill_m + (FRAME_M if opening.sill_m > 0 else 0.0)
        yield ((v >= top) & (v <= low))[:, None] & ((u >= left) & (u <= right))[None, :]


def too_bright(luminance: Floats, known: Flags, factor: float = 6.0) -> Flags:
    """Return the known pixels (H, W) ``factor`` times as bright as their surroundings (H, W): lamps, glints."""
    if not known.any():
        return np.zeros_like(known)
    level = np.log(np.maximum(luminance, 1e-9))
    local, _ = known_mean(level, known, max(3.0, 0.08 * max(known.shape)))
    return known & (level > local + math.log(factor))


STRIP_M, STRIP_PX = 0.25, 3.0
"""Beside the hole, of which a column's tone is the mean; at least (chosen)."""


def hanging(values: Floats, known: Flags, hole: Flags, px_per_m: float) -> Floats:
    """Return a texture (H, W, 3), linear light, whose columns go on in the ``hole`` (H, W) as what is ``known`` ends.

    A column of which nothing is known is as those beside it.
    """
    scale, rows = ToneScale.of(values, known), np.arange(len(known))[:, None]
    tall = 2 * round(max(STRIP_M * px_per_m, STRIP_PX) / 2) + 1
    share = cv2.blur(known.astype(np.float32), (1, tall))[..., None]
    tone = cv2.blur(np.where(known[..., None], scale.tone(values), 0).astype(np.float32), (1, tall))
    above = np.maximum.accumulate(np.where(known, rows, -len(rows)), axis=0)
    below = np.minimum.accumulate(np.where(known, rows, 2 * len(rows))[::-1], axis=0)[::-1]
    nearest = np.where(rows - above <= below - rows, above, below)
    seen = (nearest >= 0) & (nearest < len(rows))
    ends = np.take_along_axis(tone / np.maximum(share, 1e-6), np.where(seen, nearest, 0)[..., None], axis=0)
    return np.where(hole[..., None], scale.light(spread(ends.astype(np.float32), seen)), values)


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
        colour = _colour(values, sources, elsewhere)
        values[hole] = colour
        confidence = np.where(hole, 0.05, 1).astype(np.float32)
        return FilledPlane(texture, values, hole, confidence, ~hole, "nothing of it is seen: one colour")
    confidence = np.ones(hole.shape, np.float32)
    rest, upright = np.ones_like(hole), np.ones_like(hole)
    for region in opening_regions(texture.plane, room, hole.shape, texture.px_per_m):
        inside = hole & region
        if (sources & region).sum() < 0.05 * region.sum():
            # Of an opening that is hidden altogether nobody knows that it is there: the wall goes on.
            continue
        rest &= ~region
        if not region[-1].any():
            # A window's frame and reveal end at its sill: the wall below is one.
            reach = np.ones((1, 2 * round(BESIDE_WINDOW_M * texture.px_per_m) + 1), np.uint8)
            upright &= cv2.dilate(region.astype(np.uint8), reach) == 0
        if inside.any():
            # Leaves, panes and curtains run upright: each column goes on.
            values[inside] = hanging(values, known & region, inside, texture.px_per_m)[inside]
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
        values, sure, goes_on, how = _by_parts(texture, values, (own, own & upright, things), inside, skirting)
        confidence[inside], continued[inside] = sure[inside], goes_on[inside]
    return FilledPlane(texture, values, hole, confidence, continued, how)


def _colour(values: Floats, known: Flags, elsewhere: Floats) -> Floats:
    return elsewhere if known.sum() < LEAST_TEXELS else np.asarray(np.median(values[known], axis=0), np.float32)


def _by_parts(
    texture: Texture, values: Floats, seen: tuple[Flags, Flags, Flags], hole: Flags, skirting: Skirting | None
) -> tuple[Floats, Floats, Flags, str]:
    """Return values, confidence, where it is a continuation, and how it was filled: walls between upright edges.

    ``seen``: what may be learnt from; of it, where such edges are; what is probably no part of the wall, (H, W) each.
    """
    wall, (sources, upright, things) = texture.plane.index >= FIRST_WALL, seen
    parts = upright_parts(values, (upright, things), hole, texture.px_per_m) if wall else [Part(slice(None), 0)]
    if len(parts) == 1:
        values, sure, goes_on, how = _surface(texture, values, sources, hole, skirting)
        return values, sure, np.full_like(hole, goes_on), how
    out, sure, continued = values.copy(), np.ones(hole.shape, np.float32), np.ones_like(hole)
    for columns, top in parts:
        part = np.s_[:, columns]
        inside = hole[part]
        fit = sources[part] & (np.arange(len(hole)) >= top)[:, None]
        hangs = fit.any() and things[part][fit].mean() > MOSTLY_THING
        if inside.any() and fit.sum() >= LEAST_TEXELS and not hangs:
            own = replace(texture, density=texture.density[part])
            out[part], sure[part], continued[part], _ = _surface(own, values[part], fit, inside, skirting)
        elif inside.any():
            out[part] = hanging(values[part], sources[part], inside, texture.px_per_m)
            sure[part], continued[part] = np.where(inside, SURE, 1), False
    return out, sure, continued, f"{len(parts)} parts between upright edges"


def _surface(
    texture: Texture, values: Floats, sources: Flags, hole: Flags, skirting: Skirting | None
) -> tuple[Floats, Floats, bool, str]:
    """Return values, confidence, whether it is a continuation, and how it was filled."""
    if texture.plane.index == FLOOR:
        found = analyse(values, sources)
        little = sources.sum() < LITTLE * (sources | hole).sum()
        weak = little and found.lattice is not None and found.lattice.strength < WALL_NCC
        if weak or (little and found.repeat is Repeat.NONE):
            plain = fill_plain(values, sources, hole, level_rows=False)
            return plain.values, plain.confidence, True, f"plain (roughness {plain.roughness:.3f})"
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
            return plain.values, plain.confidence, True, said
        # Skirting runs along the wall and is no part of its pattern.
        rows = np.exp(plain.profile)
        level = np.asarray(values / rows, np.float32)
        found = analyse(level, plain.clean)
        if found.repeat is Repeat.NONE or (found.lattice is not None and found.lattice.strength < WALL_NCC):
            return plain.values, plain.confidence, True, said + ", no pattern"
        done = complete(level, plain.clean, hole, density=texture.density, found=found)
        done = replace(done, values=np.where(hole[..., None], done.values * rows, values))
    kind = "" if done.lattice is None else f", NCC {done.lattice.strength:.2f}"
    return done.values, done.confidence, done.repeat is not Repeat.NONE, f"{done.repeat.value}{kind}"


# The skirting of a room: what runs along the foot of its walls, learned from all of them for walls that hide theirs.

SKIRTING_PX_PER_M = 80.0  # rows of 12 mm; chosen, never swept
HIGHEST_M = 0.25  # of a skirting; chosen, never swept
TOP_M = 0.05  # below that height: what of the wall is just above the skirting, against which it is measured
ABOVE_M = (0.3, 0.6)  # where the wall itself must be seen too
LEAST_COLUMNS = 12  # of wall that show their skirting; chosen, never swept
MIXED_PX, FARTHER = 1.5, 1.2
"""Pixels beside the floor that show some of it; distance of what is seen of a wall over that of its plane."""
EDGE_ROWS, LEAST_EDGE = 3, 0.01
"""In which the upper edge of a skirting lies, and the tone that counts for none (chosen)."""
LEAST_TONE, MOST_SPREAD, MOST_SPREAD_SEEN = 0.04, 0.35, 0.4
"""Of the strongest row: a skirting is seen against its wall, and alike on all walls (of that tone); the same where the
network sees it, in another light on each wall (chosen: 0.37 where it is right in a real room, 0.44 where it is not)."""


SEEN_SHARE, ALIKE = 0.25, 0.6
"""Of a pixel, as the network sees it, from which it shows skirting (chosen on three rooms: up to 0.5 to 0.8); how much
more alike its own tone must be on all walls than that against them (chosen)."""

LEAST_DOWN_RAD, STANDS_OUT, SUREST = 0.1, 1.5, 0.75
"""Below the horizon where feet of walls are; how much more what the network sees must stand out than the profile of
walls where the room has them; of the surest place, how sure others must be (chosen)."""


@dataclass(frozen=True)
class Skirting:
    """Tone against the wall above, by height over the floor."""

    tone: Floats
    """(N, 3), from the floor up, ``1 / SKIRTING_PX_PER_M`` a row; 0 where there is none."""
    own: Floats | None = None
    """(3,): its own logarithm of light, where that is alike on walls of different paint."""

    def rows(self, height: int, px_per_m: float, paint: Floats | None = None) -> Floats:
        """Return (H, 3): the same by rows of a wall's texture, from its ceiling down; ``paint`` (3,): log light of the
        wall."""
        above_m = (height - 0.5 - np.arange(height)) / px_per_m
        places, tone = (np.arange(len(self.tone)) + 0.5) / SKIRTING_PX_PER_M, self.tone
        if self.own is not None and paint is not None:
            much = np.abs(tone).mean(axis=1, keepdims=True)
            tone = much / much.max() * (self.own - paint)
        parts = [np.interp(above_m, places, tone[:, k], right=0.0) for k in range(3)]
        return np.stack(parts, axis=-1).astype(np.float32)


def find_skirting(
    rgb: Floats, geometry: Equirectangular, room: RoomModel, masked: Flags, share: Floats | None = None
) -> Skirting | None:
    """Return what runs along the foot of the walls, None where nothing does or walls differ.

    ``rgb`` (H, W, 3) is finite; nothing is taken from ``masked`` pixels (H, W). ``share`` (h, w): how much of what is
    seen is skirting; None: unknown.
    """
    found = []
    for plane in planes_of(room)[FIRST_WALL:]:
        texture = unwrap(rgb, geometry, room, plane, SKIRTING_PX_PER_M, mask=masked)
        known = texture.known.copy()
        for opening in opening_regions(plane, room, known.shape, SKIRTING_PX_PER_M):
            # What is seen through a window, and its reveal, is no wall to compare with.
            known[opening] = False
        # How many of a wall's lowest rows hold some of the floor in the picture's pixels
        eye = np.array([0.0, 0.0, room.camera_height_m])
        away = FARTHER * max(abs(float((eye - plane.origin_m) @ plane.normal)), 0.3)
        pixel_m = math.pi / geometry.height_px * (away**2 + room.camera_height_m**2) / away
        if share is not None:
            rough = Equirectangular(share.shape[1], share.shape[0])
            known &= unwrap(share, rough, room, plane, SKIRTING_PX_PER_M).values.max(axis=0) > SEEN_SHARE
        profile = _profile(replace(texture, known=known), math.ceil(MIXED_PX * pixel_m * SKIRTING_PX_PER_M))
        if profile is not None:
            found.append(profile)
    by_network = None if share is None else _boards_seen(rgb, room, masked, share)
    if not found:
        return by_network
    profiles, paint = np.stack([tone for tone, _, _ in found]), np.stack([level for _, _, level in found])
    # Skirting ends within `EDGE_ROWS`; shade, which walls without a seen skirting have there, does not.
    edge = np.abs(profiles[:, EDGE_ROWS:] - profiles[:, :-EDGE_ROWS]).mean(axis=2).max(axis=1)
    seen = np.array([count for _, count, _ in found], np.float64)
    columns = seen * edge.clip(LEAST_EDGE)
    middle = _weighted_median(profiles, columns)
    strongest = int(np.abs(middle).mean(axis=1).argmax())
    height = float(np.abs(middle[strongest]).mean())
    relative = profiles[:, strongest]
    tones = relative + paint if _own_alike(relative, paint, seen) else relative
    usual = _weighted_median(tones, columns)
    spread = float(_weighted_median(np.abs(grey(tones) - float(grey(usual)))[:, None], columns)[0])
    if by_network is not None and np.abs(by_network.tone).mean(axis=1).max() > STANDS_OUT * height:
        return by_network
    if height < LEAST_TONE or spread > MOST_SPREAD * height:
        return None
    # How high it is shows best where it differs most from its wall.
    own = Skirting(profiles[int(columns.argmax())].astype(np.float32), usual.astype(np.float32))
    return Skirting(middle.astype(np.float32)) if tones is relative else own


def _boards_seen(rgb: Floats, room: RoomModel, masked: Flags, share: Floats) -> Skirting | None:
    """Return skirting where the network sees it, as even boards: also where walls are taken for too near or too far.

    ``rgb`` (H, W, 3), ``masked`` (H, W) and ``share`` (h, w) are as for `find_skirting`. Tone is taken from ``masked``
    boards only where there are no others, the wall's never.
    """
    height, width = masked.shape
    seen, px_rad = resized(share, (height, width)), math.pi / height
    row, surest, columns = seen.argmax(axis=0), seen.max(axis=0), np.arange(width)
    down = (row + 0.5) * px_rad - math.pi / 2
    likely = (surest > SEEN_SHARE) & (down > LEAST_DOWN_RAD)
    bare = likely & ~masked[row, columns]
    # Where all are torn pieces that go with furniture: the surest of these.
    columns = columns[bare if bare.sum() >= LEAST_COLUMNS else likely & (surest > SUREST * surest.max())]
    # The board's own tone against the wall's above it, in the same column
    away_m = room.camera_height_m / np.tan(down[columns])
    falls = np.arctan((room.camera_height_m - np.linspace(*ABOVE_M, 4)[:, None]) / away_m)
    above = np.clip(falls / px_rad + height / 2, 0, height - 1).astype(np.intp)
    some = (~masked[above, columns]).any(axis=0)
    columns, away_m, above = columns[some], away_m[some], above[:, some]
    if len(columns) < LEAST_COLUMNS:
        return None
    wall = np.where(masked[above, columns][..., None], np.nan, np.log(np.maximum(rgb[above, columns], 1e-6)))
    off = np.log(np.maximum(rgb[row[columns], columns], 1e-6)) - np.nanmedian(wall, axis=0)
    usual, row_m = np.median(off, axis=0), away_m * px_rad / np.cos(down[columns]) ** 2
    contrast, spread = np.abs(usual).mean(), float(np.median(np.abs(grey(off) - grey(usual))))
    if contrast < LEAST_TONE or spread > MOST_SPREAD_SEEN * contrast:
        return None
    # As high as the network's shares of a column come to
    high_m = float(np.median(seen[:, columns].sum(axis=0) * row_m))
    cover = np.clip(high_m * SKIRTING_PX_PER_M - np.arange(round(HIGHEST_M * SKIRTING_PX_PER_M)), 0, 1)
    return Skirting((cover[:, None] * usual).astype(np.float32))


def _own_alike(tones: Floats, paint: Floats, seen: np.ndarray) -> bool:
    """Return whether skirting's own tone is more alike on walls than that against them (N, 3); ``paint`` (N, 3).

    White boards before white and red walls are white before both: so much lighter than each they are not.
    """
    both = tones, tones + paint
    apart = [np.average(np.abs(one - _weighted_median(one, seen)).mean(axis=1), weights=seen) for one in both]
    return bool(apart[1] < ALIKE * apart[0])


def _profile(texture: Texture, mixed: int) -> tuple[Floats, int, Floats] | None:
    """Return the tone (N, 3) of the lowest rows, from the floor up, against the wall above; of how many columns; the
    wall's log light (3,)."""
    rows = round(HIGHEST_M * SKIRTING_PX_PER_M)
    foot = round(texture.plane.height_m * SKIRTING_PX_PER_M)
    top, low = foot - round(ABOVE_M[1] * SKIRTING_PX_PER_M), foot - round(ABOVE_M[0] * SKIRTING_PX_PER_M)
    if top < 0 or foot > len(texture.values):
        return None
    whole = texture.known[foot - rows : foot].all(axis=0) & texture.known[top:low].all(axis=0)
    if whole.sum() < LEAST_COLUMNS:
        return None
    tone = ToneScale.of(texture.values, texture.known).tone(texture.values[:, whole])
    off = tone[foot - rows : foot][::-1] - np.median(tone[top:low], axis=0)
    found = np.asarray(np.median(off, axis=1), np.float32)
    # Walls grow darker towards the floor; that is light.
    found -= np.median(found[-round(TOP_M * SKIRTING_PX_PER_M) :], axis=0)
    found[:mixed] = found[min(mixed, rows - 1)]
    paint = np.log(np.maximum(np.median(texture.values[top:low, whole], axis=(0, 1)), 1e-6))
    return found, int(whole.sum()), paint.astype(np.float32)


def _weighted_median(values: Floats, weight: np.ndarray) -> Floats:
    """Return the weighted median along the first axis."""
    order = np.argsort(values, axis=0)
    share = np.cumsum(weight[order], axis=0) / weight.sum()
    place = (share >= 0.5 - 1e-12).argmax(axis=0)[None]
    return np.asarray(np.take_along_axis(np.take_along_axis(values, order, axis=0), place, axis=0)[0])
