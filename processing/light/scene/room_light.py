"""The light in a room as its calibrated panorama shows it: irradiance everywhere, without knowing any albedo.

Every patch's radiance is read off the panorama, so that the light that falls on a place is what the place sees of the
room, plus what comes through the windows from outdoors.

Gloss of the floor, coarsely: how much of the room it mirrors, from how its brightness grows at flat angles.

A varnished or tiled floor adds to its matte light what Fresnel's law (Schlick 1994, 4 % head on) mirrors of the room.
Both are known but for one factor: radiance is matte albedo x irradiance / pi + gloss x Fresnel x mirrored radiance. The
factor is the slope of apparent albedo over the mirrored part, over many pixels, so that patterns do not matter.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import cv2
import numpy as np

from processing.ground.arrays import AnyArray, Doubles, Flags, Floats, Vector
from processing.ground.seam import components, resized
from processing.light.solver.irradiance import PANE_SHARE, SHOT_SHARE, Effort, cleaned
from processing.light.solver.kernels import FURNITURE, PANE, STEP_OFF_M, Key
from processing.light.solver.sight import FIRST_PART, Sight, looked_up, own_pixels
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage
from processing.light.solver.transport import BrightPatches, bounced, links_of
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage

LOOKS = 8  # places on each patch that are looked up in the panorama
BRIGHT_TIMES = 6.0  # a patch this many times brighter than the median is shot at
SAME_PLACE_M = 0.02  # by which a hit may fall short of the place that is looked at; chosen, never swept
LEAST_SHARE = 0.5  # of `LOOKS`, below which a patch counts as unseen
HEAD_ON = 0.04  # reflectance of varnish, glaze and polish (n = 1.5) seen head on
LEAST_GLOSS = 0.5
"""A smaller slope is that of a matte floor under an irradiance in error: of 13 simulated rooms (validation seeds) the
four matte floors have -1.2 to 0.3, the nine glossy ones 0.7 and more."""
TAIL, LEAST_PIXELS, LEAST_SPAN = 0.05, 200, 0.004
"""Share of pixels at either end that counts no further; too few, or too alike in what they mirror, measure nothing."""
MOST_SHARE = 0.3  # of a pixel's light that may be mirrored; more, and its albedo is not measured (a window's highlight)


@dataclass(frozen=True)
class MeasuredLight:
    """Radiance of patches (N, 3) as the panorama shows them."""

    radiance: Doubles
    seen: np.ndarray
    """(N,) share of the patch that the camera sees."""


def measured_light(stage: Stage, panorama: Floats, sight: Sight, eye_m: Vector, key: Key) -> MeasuredLight:
    """Return what each patch gives off, by a panorama (H, 2 H, 3) and what its pixels see.

    Only pixels of the patch's own surface count: beside it may be a window, whose light is far stronger. Patches that
    the camera does not see take the mean of those like them.
    """
    patches = stage.patches
    which = np.repeat(np.arange(patches.count), LOOKS)
    places = patches.places(which, key)
    eye = np.asarray(eye_m, np.float32)
    way = places - eye
    far = np.linalg.norm(way, axis=1)
    way = (way / np.maximum(far, 1e-6)[:, None]).astype(np.float32)
    hits = stage.tracer.cast(np.broadcast_to(eye, way.shape), way)
    ahead = np.einsum("ij,ij->i", way, patches.normal[which]) < 0
    visible = np.flatnonzero(ahead & (hits.distance_m > far - SAME_PLACE_M) & (patches.area_m2[which] > 0))
    # Each patch's label in a `Sight` (P,): its surface, or its part of furniture
    p = stage.patches
    out = np.full(p.count, -1)
    furniture = p.owner == FURNITURE
    out[p.item[furniture]] = FIRST_PART + p.part[furniture]
    for number, (columns, rows, first) in enumerate(stage.patches.grids):
        out[first : first + columns * rows] = number
    value, weight = own_pixels(panorama, sight.label.reshape(sight.shape), way[visible], out[which[visible]])
    total, share = np.zeros((patches.count, 3)), np.zeros(patches.count)
    np.add.at(total, which[visible], value * weight[:, None])
    np.add.at(share, which[visible], weight)
    radiance = total / np.maximum(share, 1e-9)[:, None]
    radiance[share < LEAST_SHARE] = 0
    _fill_unseen(stage, radiance, share >= LEAST_SHARE)
    return MeasuredLight(radiance, share / LOOKS)


def _fill_unseen(stage: Stage, radiance: Doubles, seen: np.ndarray) -> None:
    """Give unseen patches the mean of their surface, or else of all that turn the same way, or of all."""
    normal, area = stage.patches.normal, stage.patches.area_m2
    for columns, rows, first in stage.patches.grids:
        mine = np.arange(first, first + columns * rows)
        missing = mine[~seen[mine]]
        if not len(missing):
            continue
        alike = (normal @ normal[missing[0]] > 0.9) & seen
        for among in (mine[seen[mine]], np.flatnonzero(alike), np.flatnonzero(seen)):
            if area[among].sum() > 0:
                radiance[missing] = np.average(radiance[among], axis=0, weights=area[among])
                break


def irradiance_by_picture(
    stage: Stage, light: MeasuredLight, sight: Sight, effort: Effort, seed: int
) -> tuple[Floats, Floats]:
    """Return irradiance (H, W, 3) of a panorama's pixels without the sun's own disc, and its relative error (H, W)."""
    solid = np.flatnonzero(sight.solid)
    bright = _bright(stage, light)
    smooth = np.pi * light.radiance if bright is None else np.pi * light.radiance - bright.radiosity
    points, normals = sight.point[solid][:, None, :], sight.normal[solid]
    samples = max(1, effort.pixel_samples // 2)
    shots, few = max(1, round(samples * SHOT_SHARE)), max(1, round(samples * PANE_SHARE))
    halves = []
    for half in range(2):
        key = 2 * seed + half
        links = links_of(stage, points, normals, samples, (key, 41))
        out, _ = bounced(stage, links, smooth, bright, (points, normals), shots, (key, 42))
        halves.append(sight.picture(skylight(stage, points, normals, few, (key, 40)) + out, solid))
    mean: Floats = (halves[0] + halves[1]) * np.float32(0.5)
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    apart, whole = (halves[0] - halves[1]) @ weights, np.maximum((halves[0] + halves[1]) @ weights, 1e-9)
    error = np.sqrt(np.maximum(cv2.blur((apart / whole) ** 2, (9, 9)), 0)) / 5
    return (cleaned(mean, sight, wraps=True) if effort.clean else mean), error.astype(np.float32)


def _bright(stage: Stage, light: MeasuredLight) -> BrightPatches | None:
    luminance = light.radiance @ np.asarray(LUMINANCE_WEIGHTS)
    there = stage.patches.area_m2 > 0
    limit = BRIGHT_TIMES * float(np.median(luminance[there]))
    over = (luminance > max(limit, 1e-9)) & there
    return BrightPatches.of(stage, np.where(over[:, None], np.pi * light.radiance, 0.0))


def mirrored(stage: Stage, light: MeasuredLight, sight: Sight, pixels: np.ndarray) -> tuple[Doubles, np.ndarray]:
    """Return Fresnel's share of the radiance (K, 3) that pixels (K,) mirror, and which of them mirror a window."""
    rays, normal = sight.rays[pixels], sight.normal[pixels]
    cosine = -np.einsum("ij,ij->i", rays, normal)
    back = (rays + 2 * cosine[:, None] * normal).astype(np.float32)
    start = sight.point[pixels] + np.float32(STEP_OFF_M) * normal
    hits = stage.tracer.cast(start, back)
    patch, _ = stage.met(start, back, hits)
    radiance = np.where((patch >= 0)[:, None], light.radiance[np.maximum(patch, 0)], 0)
    p = stage.patches
    glass = (hits.triangle >= 0) & (p.owner[hits.triangle] == PANE)
    for number, pane in enumerate(stage.scene.panes):
        mine = np.flatnonzero(glass & (p.item[hits.triangle] == number))
        row, column = pane.cells(start[mine] + hits.distance_m[mine, None] * back[mine])
        outside = looked_up(stage.scene.outdoors.rgb, back[mine]) * pane.through(back[mine])
        radiance[mine] = pane.clear[row, column, None] * outside + pane.veil_cd_m2[row, column]
    fresnel = HEAD_ON + (1 - HEAD_ON) * (1 - np.clip(cosine, 0, 1)) ** 5
    return np.asarray(fresnel[:, None] * radiance), glass


def gloss_factor(apparent: Doubles, mirror: Doubles, usable: np.ndarray) -> float:
    """Return how glossy a floor is, 0 to 1: the slope of apparent albedo (K, 3) over the mirrored part (K, 3).

    By least squares over all usable pixels, both held within their usual values, so that neither a rug nor a highlight
    decides. 0 where it cannot be measured: too few pixels, or all seen alike. A slope above 1 is taken as full varnish:
    then the irradiance is in error too.
    """
    weights = np.asarray(LUMINANCE_WEIGHTS)
    y, x = (apparent @ weights)[usable], (mirror @ weights)[usable]
    if len(x) < LEAST_PIXELS:
        return 0.0
    x, y = (np.clip(v, *np.quantile(v, (TAIL, 1 - TAIL))) for v in (x, y))
    if np.ptp(x) < LEAST_SPAN:
        return 0.0
    x = x - x.mean()
    slope = float(x @ y) / float(x @ x)
    return min(slope, 1.0) if slope >= LEAST_GLOSS else 0.0


# The emptied panorama with the room's own sunlight in its place: what materials and furniture are lit by.

SUN_RIM_RAD, FURNITURE_RIM_RAD = math.radians(1.5), math.radians(0.8)
"""By which sunlight stands again beyond its mask, and keeps away from what stood there (chosen: removal fills over the
masks' edges, half shadow beside the sun and rims of furniture)."""
SUNNY = 1.5  # times what removal left of a place, from which the photograph shows sun there; full sun is 4 to 20
LEAST_STANDS = 0.35  # of a patch, which is photographed; of less it falls anew as a whole (chosen)
HALF_SHADOW_RAD = math.radians(0.2)  # beside less sun, where a patch's rim is half in the shade (chosen)


@dataclass(frozen=True)
class EmptyRoom:
    """The panorama without furniture, its own sunlight in its place."""

    image: LuminanceImage
    filled: Flags | None = None
    """(H, W): what removal made up; None where nothing was removed."""
    sunless: Flags | None = None
    """(H, W): what is shown without the direct sun that may fall there."""
    sunlit: Flags | None = None
    """(H, W): where the sun stands again as it was photographed."""
    shaded: Floats | None = None
    """(K, 3): what removal left of those places, without that sun, row by row."""

    @contextmanager
    def without(self, patches: Flags | None) -> Iterator[tuple[Floats, Flags | None]]:
        """Give picture and ``sunless`` with some patches of sun (H, W), None for none, as removal left them.

        They are the room's own arrays, which are as they were when this ends: nobody else may use them meanwhile.
        """
        rgb = self.image.rgb
        if self.sunlit is None or self.shaded is None or self.sunless is None or patches is None:
            yield rgb, self.sunless
            return
        sun, sunless = rgb[patches], self.sunless[patches]
        rgb[patches], self.sunless[patches] = self.shaded[patches[self.sunlit]], True
        try:
            yield rgb, self.sunless
        finally:
            rgb[patches], self.sunless[patches] = sun, sunless


def near_sun(sun: Flags) -> slice:
    """Return rows of a panorama, one at least, within which its sunlight (H, W) can stand again and is kept away."""
    rows = np.flatnonzero(sun.any(axis=1))
    reach_px = round(2 * SUN_RIM_RAD / math.pi * len(sun))  # as far as hidden places take anything away
    return slice(max(rows[0] - reach_px, 0), rows[-1] + reach_px + 1) if len(rows) else slice(0, 1)


def with_sunlight(
    empty: LuminanceImage,
    before: Mapping[str, AnyArray],
    filled: Flags,
    sun: Flags,
    hidden: Flags,
    returned: Flags | None = None,
    *,
    own: bool = False,
) -> EmptyRoom:
    """Return the emptied panorama with the direct sunlight that removal took away, where nothing hid it.

    The sun's patch lights the room, and furniture is put into the room as it was photographed. ``before``: light,
    ``uncertainty`` and ``validity`` of the photograph's rows `near_sun`; ``filled``, ``sun``, ``hidden``: (H, W), what
    removal filled, direct sunlight, and what stood in the way (furniture, tripod, shadows); ``returned`` (h, w),
    smaller: seen places that old furniture shaded. Towards these the patch's rim shows their shade, which goes with the
    furniture. ``own``: ``empty`` may be written into, where its arrays can be.
    """
    back, near = np.zeros_like(sun), near_sun(sun)
    back[near] = _grown(sun[near], SUN_RIM_RAD, len(sun)) & ~_grown(hidden[near], FURNITURE_RIM_RAD, len(sun))
    if returned is not None:
        shaded = (resized((filled & ~back).astype(np.float32), returned.shape) > 0.5) | returned
        rim = back & (resized(_grown(shaded, 2 * SUN_RIM_RAD, len(shaded)).astype(np.float32), back.shape) > 0.5)
        weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
        rows = np.flatnonzero(rim.any(axis=1))
        some = slice(rows[0], rows[-1] + 1) if len(rows) else slice(near.start, near.start)
        lit = before["rgb"][some.start - near.start : some.stop - near.start]
        dim = lit @ weights <= SUNNY * (empty.rgb[some] @ weights)
        back[some] &= ~(rim[some] & _grown(dim, HALF_SHADOW_RAD, len(sun)))
    # What is left of a patch that was mostly hidden would stand out of the new one by the colour of the old light.
    mine, stood = sun[near], back[near]
    labels = components(mine | stood)[1]
    count = int(labels.max(initial=0)) + 1
    size, stands = (np.bincount(labels[mask], minlength=count) for mask in (mine, mine & stood))
    stood &= (stands > LEAST_STANDS * size)[labels]
    below, sunless = empty.rgb[back], filled & ~back
    parts = {name: getattr(empty, name) for name in before}
    parts = {name: np.require(values if own else values.copy(), requirements="W") for name, values in parts.items()}
    for name, values in parts.items():
        values[near][stood] = before[name][stood]
    return EmptyRoom(replace(empty, **parts), sunless, sunless, back, below)


def _grown(mask: Flags, by_rad: float, rows: int) -> Flags:
    """Return a mask (h, W), whole rows of a panorama that has so many, grown on all sides; columns wrap."""
    radius = round(by_rad / math.pi * rows)
    if radius == 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    wide = np.pad(mask.astype(np.uint8), ((0, 0), (radius, radius)), mode="wrap")
    return np.asarray(cv2.dilate(wide, disc)[:, radius:-radius] > 0)
