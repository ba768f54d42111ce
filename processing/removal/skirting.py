"""A room's skirting: what runs along the foot of its walls, learned from all of them for walls that hide theirs."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, weighted_median
from processing.ground.room_model import RoomModel
from processing.ground.seam import components, grown, resized, spanned
from processing.removal.furniture import SKIRTING_LONG_RAD, lower_ends
from processing.removal.illumination import ToneScale, grey
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, planes_of
from processing.surfaces.textures import Texture, opening_regions, unwrap

SKIRTING_PX_PER_M = 80.0  # rows of 12 mm; chosen, never swept
HIGHEST_M = 0.25  # of a skirting; chosen, never swept
TOP_M = 0.05  # below that height: what of the wall is just above the skirting, against which it is measured
ABOVE_M = (0.3, 0.6)  # where the wall itself must be seen too
LEAST_COLUMNS, LEAST_SEEN_RAD = 12, math.radians(2)
"""Of a wall's texture that show its skirting, 15 cm; of the panorama, where the network sees it (chosen)."""
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

SAME_PAINT = 0.3  # tone by which a channel of two walls may differ, lightness apart, if their paint is one (chosen)

LEAST_DOWN_RAD, STANDS_OUT, SUREST = 0.1, 1.5, 0.75
"""Below the horizon where feet of walls are; how much more what the network sees must stand out than the profile of
walls where the room has them; of the surest place, how sure others must be (chosen)."""


@dataclass(frozen=True)
class Skirting:
    """Tone against the wall above, by height over the floor."""

    tone: Floats
    """(N, 3), from the floor up, ``1 / SKIRTING_PX_PER_M`` a row; 0 where there is none."""
    own: tuple[Floats, Floats, Floats, Doubles] | None = None
    """Where its own light is alike on walls of different paint: that (3,), as a logarithm, and what walls that show it
    have: tone (M, N, 3), log light of the wall (M, 3), how much each counts (M,)."""

    def rows(self, height: int, px_per_m: float, paint: Floats | None = None) -> Floats:
        """Return (H, 3): the same by rows of a wall's texture, from its ceiling down; ``paint`` (3,): its log light."""
        above_m = (height - 0.5 - np.arange(height)) / px_per_m
        places, tone = (np.arange(len(self.tone)) + 0.5) / SKIRTING_PX_PER_M, self.tone
        if self.own is not None and paint is not None:
            # Light differs from wall to wall; of one paint, boards differ from it alike.
            light, profiles, paints, weight = self.own
            off, much = paints - paint, np.abs(tone).mean(axis=1, keepdims=True)
            alike = np.abs(off - off.mean(axis=1, keepdims=True)).max(axis=1) < SAME_PAINT
            tone = much / much.max() * (light - paint)
            tone = weighted_median(profiles[alike], weight[alike]) if alike.any() else tone
        parts = [np.interp(above_m, places, tone[:, k], right=0.0) for k in range(3)]
        return np.stack(parts, axis=-1).astype(np.float32)


def find_skirting(
    rgb: Floats, geometry: Equirectangular, room: RoomModel, masked: Flags, share: Floats | None = None
) -> Skirting | None:
    """Return what runs along the foot of the walls, None where nothing does or walls differ.

    ``rgb`` (H, W, 3) is finite; nothing is taken from ``masked`` pixels (H, W). ``share`` (h, w): how much of what is
    seen is skirting; None: unknown.
    """
    found = _profiles(rgb, geometry, room, masked, share)
    by_network = None if share is None else _boards_seen(rgb, room, masked, share)
    if not found:
        return by_network
    profiles, paint = np.stack([tone for tone, _, _ in found]), np.stack([level for _, _, level in found])
    # Skirting ends within `EDGE_ROWS`; shade, which walls without a seen skirting have there, does not.
    edge = np.abs(profiles[:, EDGE_ROWS:] - profiles[:, :-EDGE_ROWS]).mean(axis=2).max(axis=1)
    seen = np.array([count for _, count, _ in found], np.float64)
    columns = seen * edge.clip(LEAST_EDGE)
    middle = weighted_median(profiles, columns)
    strongest = int(np.abs(middle).mean(axis=1).argmax())
    height = float(np.abs(middle[strongest]).mean())
    relative = profiles[:, strongest]
    # Skirting's own tone, where that is more alike on walls than that against them. White boards before white and red
    # walls are white before both: so much lighter than each they are not.
    both = relative, relative + paint
    apart = [np.average(np.abs(one - weighted_median(one, seen)).mean(axis=1), weights=seen) for one in both]
    tones = both[1] if apart[1] < ALIKE * apart[0] else relative
    usual = weighted_median(tones, columns)
    spread = float(weighted_median(np.abs(grey(tones) - float(grey(usual)))[:, None], columns)[0])
    if by_network is not None and np.abs(by_network.tone).mean(axis=1).max() > STANDS_OUT * height:
        return by_network
    if height < LEAST_TONE or spread > MOST_SPREAD * height:
        return None
    # How high it is shows best where it differs most from its wall.
    boards = profiles[int(columns.argmax())].astype(np.float32)
    own = Skirting(boards, (usual.astype(np.float32), profiles, paint, columns))
    return Skirting(middle.astype(np.float32)) if tones is relative else own


def _profiles(
    rgb: Floats, geometry: Equirectangular, room: RoomModel, masked: Flags, share: Floats | None
) -> list[tuple[Floats, int, Floats]]:
    """Return what `_profile` gives of each wall that shows its foot; arrays as for `find_skirting`."""
    found, eye = [], np.array([0.0, 0.0, room.camera_height_m])
    for plane in planes_of(room)[FIRST_WALL:]:
        texture = unwrap(rgb, geometry, room, plane, SKIRTING_PX_PER_M, mask=masked)
        known = texture.known.copy()
        for opening in opening_regions(plane, room, known.shape, SKIRTING_PX_PER_M):
            # What is seen through a window, and its reveal, is no wall to compare with.
            known[opening] = False
        # How many of a wall's lowest rows hold some of the floor in the picture's pixels
        away = FARTHER * max(abs(float((eye - plane.origin_m) @ plane.normal)), 0.3)
        pixel_m = math.pi / geometry.height_px * (away**2 + room.camera_height_m**2) / away
        if share is not None:
            rough = Equirectangular(share.shape[1], share.shape[0])
            known &= unwrap(share, rough, room, plane, SKIRTING_PX_PER_M).values.max(axis=0) > SEEN_SHARE
        profile = _profile(replace(texture, known=known), math.ceil(MIXED_PX * pixel_m * SKIRTING_PX_PER_M))
        if profile is not None:
            found.append(profile)
    return found


def _boards_seen(rgb: Floats, room: RoomModel, masked: Flags, share: Floats) -> Skirting | None:
    """Return skirting where the network sees it, as even boards: also where walls are taken for too near or too far.

    ``rgb`` (H, W, 3), ``masked`` (H, W) and ``share`` (h, w) are as for `find_skirting`. Tone is taken from ``masked``
    boards only where there are no others, the wall's never."""
    height, width = masked.shape
    seen, px_rad = resized(share, (height, width)), math.pi / height
    row, surest, columns = seen.argmax(axis=0), seen.max(axis=0), np.arange(width)
    least = math.ceil(LEAST_SEEN_RAD / px_rad)  # columns, however fine the picture
    down = (row + 0.5) * px_rad - math.pi / 2
    likely = (surest > SEEN_SHARE) & (down > LEAST_DOWN_RAD)
    bare = likely & ~masked[row, columns]
    # Where all are torn pieces that go with furniture: the surest of these.
    columns = columns[bare if bare.sum() >= least else likely & (surest > SUREST * surest.max())]
    # The board's own tone against the wall's above it, in the same column
    away_m = room.camera_height_m / np.tan(down[columns])
    falls = np.arctan((room.camera_height_m - np.linspace(*ABOVE_M, 4)[:, None]) / away_m)
    above = np.clip(falls / px_rad + height / 2, 0, height - 1).astype(np.intp)
    some = (~masked[above, columns]).any(axis=0)
    columns, away_m, above = columns[some], away_m[some], above[:, some]
    if len(columns) < least:
        return None
    wall = np.where(masked[above, columns][..., None], np.nan, np.log(np.maximum(rgb[above, columns], 1e-6)))
    beside = np.clip(row[columns] + np.array([[0], [-1], [1]]), 0, height - 1)
    offs = np.log(np.maximum(rgb[beside, columns], 1e-6)) - np.nanmedian(wall, axis=0)
    # A board of a pixel or two shows itself where it is most unlike its wall; what differs much beside it is the floor.
    most = (grey(offs) * np.sign(np.median(grey(offs[0])))).argmax(axis=0)
    row_m = away_m * px_rad / np.cos(down[columns]) ** 2
    for off in (offs[0], offs[most, np.arange(len(columns))]):
        usual = np.median(off, axis=0)
        contrast, spread = np.abs(usual).mean(), float(np.median(np.abs(grey(off) - grey(usual))))
        if contrast < LEAST_TONE or spread > MOST_SPREAD_SEEN * contrast:
            return None
    # As high as the network's shares of a column come to
    high_m = float(np.median(seen[:, columns].sum(axis=0) * row_m))
    cover = np.clip(high_m * SKIRTING_PX_PER_M - np.arange(round(HIGHEST_M * SKIRTING_PX_PER_M)), 0, 1)
    return Skirting((cover[:, None] * usual).astype(np.float32))


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


# Boards that furniture hides in part would be left torn where others are drawn anew: such pieces go with it.

TORN, TORN_RIM_RAD, TORN_END_RAD, MOST_TORN_RAD = 0.4, math.radians(0.6), math.radians(4), math.radians(25)
"""Share of the foot of a piece of skirting that furniture hides; how much too small the network sees it; how near to
what is removed both of its ends are: the network sees it too short; longer pieces show how skirting looks, and stay
(chosen)."""


def torn_boards(boards: Flags, removed: Flags, below_rad: float) -> Flags:
    """Return pieces of skirting (H, W), with their rim, that have most of their foot on or just above what is
    ``removed`` (H, W): they would be left torn where others are drawn anew."""
    down = np.ones((math.ceil(below_rad / math.pi * len(boards)) + 1, 1), np.uint8)
    below = cv2.dilate(removed.astype(np.uint8), down, anchor=(0, 0)).astype(bool)
    count, labels = components(boards)
    near, ends = lower_ends(labels, below, count)
    return grown(boards & (near > TORN * ends)[labels], TORN_RIM_RAD)


def boards_between(boards: Flags, removed: Flags) -> Flags:
    """Return short pieces of skirting (H, W), with their rim, with what is ``removed`` (H, W) at both ends."""
    count, labels = components(boards)
    beside, between = grown(removed, TORN_END_RAD), np.zeros(count + 1, bool)
    for label in range(1, count + 1):
        part = labels == label
        columns = spanned(part)[1]
        first, last = (beside[:, end][part[:, end]].any() for end in (columns[0], columns[-1]))
        long_rad = np.ptp(columns) * 2 * math.pi / part.shape[1]
        between[label] = first and last and SKIRTING_LONG_RAD < long_rad < MOST_TORN_RAD
    return grown(boards & between[labels], TORN_RIM_RAD)
