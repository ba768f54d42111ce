"""The emptied room in its own light: holes are filled in reflectance, and what stays is lifted out of the old shade.

A filling that copies seen pixels copies the shade in which they lie; reflectance has none. So holes are filled in the
picture of pi x radiance over irradiance among the furniture, and then lit as the empty room is. Pixels that stay change
by the same ratio of lights, guarded against ghosts (`light.scene.furnished`)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from processing.ground.arrays import Flags, Floats, Int16s, bands, carried_on
from processing.ground.colour import largest_channel
from processing.ground.kernels import compiled
from processing.ground.room_model import OpeningKind, RoomModel
from processing.ground.seam import resized, smoothed, wrapped
from processing.ground.threads import side_by_side
from processing.pictures.images import LuminanceImage, Validity
from processing.removal.fill import Emptied, Others, PlaneFiller, Quick, empty_room, soften_edges
from processing.removal.illumination import grey, known_mean, spread
from processing.removal.plane_fill import LEAST_OPEN
from processing.removal.shadows import PX_PER_M, relit
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, FLOOR, Plane, opening_map, plane_map, planes_of
from processing.surfaces.textures import opening_regions, unwrap, wrap

BAND_ROWS, MOST_BANDS = 128, 4  # rows lifted at once, and so many times side by side; chosen, 20 MB each at full size
LIFT_DOUBT = 0.25  # share of a log ratio that is its standard uncertainty (measured: docs/measurements/emptying.md)
LIGHT_DOUBT = 0.05
"""Of the light in a room, relative, standard (measured with the truth given: docs/measurements/emptying.md)."""
SHOULDER = 1.5  # stops below clipping from which less is lifted (chosen): clipped places stay, and steps are seen
DEEP = math.log(4)
"""Log change from which shade is replaced in place of lifted: what a picture still shows there is noise, in colours of
its own (chosen on one real room of eight; the others have next to none)."""
BURNT = math.log(1.25)  # log change of a lamp's glow that is taken off, from which what is clipped is replaced (chosen)
SHOULDER_RAD = 3 * math.pi / 256  # its smoothness: three pixels of standard quality (chosen)
REACHES_RAD = tuple(times * math.pi / 256 for times in (1, 4, 16, 64))
"""Over which light goes on where a plane's own is not known: so many pixels of standard quality (chosen)."""


class Shade(NamedTuple):
    """What furniture takes from the light of a room, at a working size (h, w)."""

    log_change: Floats
    """(h, w, 3): natural logarithm of what its removal changes radiance by."""
    without_lx: Floats
    """(h, w, 3): irradiance in the empty room without direct sun; 0 where unknown."""
    seen: Flags
    """(h, w): where the change is known."""
    returned: Flags | None = None
    """(h, w): seen places from which the furniture keeps the sun away."""
    shadow: Flags | None = None
    """(H, W), of the picture: soft shadows of furniture as they were found."""
    doubt: float = 0.0
    """Standard uncertainty of each plane's log change."""


def lifted(
    image: LuminanceImage,
    target: Flags,
    room: RoomModel,
    shade: Shade,
    *,
    sunlight: Flags | None = None,
    others: Others | None = None,
    quality: str | Quick = "standard",
    filler: PlaneFiller | None = None,
) -> tuple[Emptied, Floats]:
    """Return the room emptied and lit as it is without its furniture, and the log change (H, W) of luminance.

    What stand-ins do not explain of the shadows, such as the dark under a seat on legs, is relit as around it, and
    replaced where it is deep.

    Parameters are those of `removal.fill.empty_room`, which fills the holes. Outside the target, pixels change by the
    shade that is lifted off them, and state that in their uncertainty; windows, and what lies outside the picture or is
    clipped, stay as they are, bit for bit. The textures of the result are reflectances."""
    geometry = image.geometry
    assert isinstance(geometry, Equirectangular)
    plane, opening = plane_map(room, geometry), opening_map(room, geometry)
    others = others or Others()
    foreign, no_surface = others.foreign, others.no_surface(target)
    glass = _seen_windows(opening, target, room) | (no_surface & ~target & (plane == FLOOR))
    planes = _by_plane(shade, room, _put_on(image, len(shade.seen)))
    reflectance, change = image.rgb.copy(), np.zeros(target.shape, np.float32)
    _in_bands(partial(_multiplied, reflectance, change), planes, plane, glass, UNLIT)
    gain, burnt = relit(reflectance, shade.shadow, (no_surface, foreign), room), np.zeros_like(target)
    shaded = change.copy()
    if np.subtract(gain, 1, out=gain).any():
        _in_bands(partial(_taken_off, reflectance, change), [np.pad(wrapped(gain, 1), ALONE)], None, no_surface, PLAIN)
        # What a lamp's glow has clipped shows no more than that it was lit.
        burnt = (change - shaded < -BURNT) & (image.validity == Validity.CLIPPED)
    target, shade = target | (change > DEEP) | burnt, shade._replace(shadow=None)
    del gain, shaded, burnt, opening, no_surface, plane  # which are large, before planes are filled
    stays = ~target & (image.validity == Validity.VALID)
    same = ~(target | (stays & (change != 0)))
    image, seen = replace(image, rgb=reflectance), image.rgb[same]  # so that the photograph is not held meanwhile
    packed = [np.packbits(flags) for flags in (glass, stays, same)]
    del glass, stays, same
    done = empty_room(image, target, room, sunlight=sunlight, others=others, quality=quality, filler=filler, own=True)
    rgb, plane = done.image.rgb, plane_map(room, geometry)
    unpacked = (np.unpackbits(flags, count=target.size).reshape(target.shape).view(np.bool_) for flags in packed)
    glass, stays, same = unpacked
    _in_bands(partial(_multiplied, rgb, change), planes, plane, glass, LIT)
    rgb[same] = seen
    # Each plane has its own light: their edges are mixed again.
    soften_edges(rgb, target, room, geometry)
    even = np.pad(wrapped(evened(done, target, room, others, sunlight), 1), ALONE)
    apart = glass | ~(target | (stays & (change != 0)))
    _in_bands(partial(_multiplied, rgb, change), [even], None, apart, GAIN)
    change[~stays] = 0
    uncertainty = np.float32(LIFT_DOUBT) * change
    np.hypot(uncertainty, np.float32(shade.doubt) * (change != 0), out=uncertainty)
    np.hypot(done.image.uncertainty, uncertainty, out=uncertainty)
    return replace(done, image=replace(done.image, uncertainty=uncertainty)), change


def _seen_windows(opening: Int16s, target: Flags, room: RoomModel) -> Flags:
    """Return the windows (H, W), but those that are hidden altogether: these are filled as wall, and lit as one."""
    found = np.zeros_like(target)
    for number, one in enumerate(room.openings):
        mine = opening == number
        if one.kind is OpeningKind.WINDOW and (mine & ~target).sum() >= LEAST_OPEN * mine.sum():
            found |= mine
    return found


def _multiplied(rgb: Floats, change: Floats, rows: slice, power: Floats, lift: Floats) -> None:
    """Multiply a band of a picture (H, W, 3), and add to its log change (H, W) of luminance."""
    rgb[rows] *= np.exp(power, out=power)
    change[rows] += lift


def _taken_off(rgb: Floats, change: Floats, rows: slice, gain: Floats, _: Floats) -> None:
    """Do the same by a factor that is no logarithm."""
    rgb[rows] *= gain
    change[rows] += np.log(gain, out=gain).mean(axis=-1)


ROWS, HALO_THING = 512, 0.25  # working size; natural logarithm from which a place is no wall (chosen on real rooms)
GRAIN_M, BROAD_M, NEAR_SHARE = (0.25, 0.1), 0.6, 1 / 3
LEAST_BLOTCH, MOST_BLOTCH, OTHER_BLOTCH = 0.03, 0.6, 1.0
"""Of floors with boards or tiles, and of plain ones: what is finer is their grain; what is broader is light; share of
what is around that is filled, from which blotches go altogether. Natural logarithm that nobody sees, that is taken off
at most, and from which a place is another thing: dark skirting (chosen by looking at eight real rooms)."""
LINE_RAD = math.radians(0.5), math.radians(3.0), math.radians(2.0)
"""From and up to how wide a line beside a filling is no detail and no light of the room; how far from the filling's rim
it may lie (as the next chosen by looking at five real rooms)."""
MOST_LINE = 0.12  # natural logarithm by which a line is taken away at most, twice which it is none
STAIN_M, LEAST_STAIN, LOCAL_M, FINE_PX, UNLIKE, PAINT = 0.5, 0.1, 0.3, 1.0, (0.8, 0.4), 0.4
"""How far from the rim of what was filled, on both sides, a wall has light of its own; how much of its tone that may be
(with 0.03 clean rooms were 5 % worse where they are filled); over what that is taken to see what hangs on it; finer is
grain; tone and colour by which light may differ on a wall; colour that changes so within 0.15 m is paint (chosen by
looking at eight real rooms)."""
TOP_M, FOOT_M = 0.12, 0.2  # cornice and skirting: as they are (chosen)
FRAME = np.ones((2 * round(0.17 * PX_PER_M) + 1,) * 2, np.uint8)  # beside a window's frame: its reveal (chosen)


def evened(done: Emptied, target: Flags, room: RoomModel, others: Others, sunlight: Flags | None) -> Floats:
    """Return log gains (h, 2 h, 3) that take lines off walls beside the target (H, W), and blotches off the floor.

    A wall's own rim stays somewhat darker or brighter than what is further away, however well shade is lifted, and its
    filling is neither: where both meet there is a line along the outline of what was there. On floors, shade between
    pieces of furniture stays where it is seen, and goes on into their filling. ``sunlight`` (H, W).
    """
    rows = min(ROWS, len(target))
    foreign = np.zeros_like(target) if others.foreign is None else others.foreign
    never = (others.no_surface(np.zeros_like(target)) | (False if sunlight is None else sunlight)) & ~target
    parts = (resized(one.astype(np.float32), (rows, 2 * rows)) > 0.5 for one in (target, foreign & ~target, never))
    gone, thing, never = parts
    light = np.nan_to_num(resized(done.image.rgb, (rows, 2 * rows)), posinf=0)
    gain = _stains(light, gone, thing | never, room, [one.texture.plane for one in done.textures])
    glass = opening_map(room, Equirectangular(2 * rows, rows)) >= 0
    gain += _lines(light * np.exp(gain), gone, thing | never | glass, room)
    for plain in (one.how == "plain" for one in done.textures if one.texture.plane.index == FLOOR):
        gain += _blotches(light, gone, thing | never, room, GRAIN_M[plain])
    gain[never] = 0
    return gain


def _blotches(rgb: Floats, target: Flags, apart: Flags, room: RoomModel, grain_m: float) -> Floats:
    """Return log gains (H, W, 3) for the floor of a picture (H, W, 3); ``apart`` (H, W): what is no part of it."""
    geometry, layers = Equirectangular(rgb.shape[1], rgb.shape[0]), (np.log(np.maximum(rgb, 1e-6)), target[..., None])
    picture = np.concatenate(layers, axis=-1).astype(np.float32)
    texture = unwrap(picture, geometry, room, planes_of(room)[FLOOR], PX_PER_M, mask=apart)
    fit, tone = texture.known, texture.values[..., :3]
    near = known_mean(texture.values[..., 3], texture.known, BROAD_M * PX_PER_M)[0]
    for _ in range(3):
        broad = known_mean(tone, fit, BROAD_M * PX_PER_M)[0]
        own = texture.known & (np.abs(tone - broad).max(axis=-1) < OTHER_BLOTCH)
        off = broad - known_mean(tone, own, grain_m * PX_PER_M)[0]
        size = np.abs(off).max(axis=-1)
        fit = own & (size < MOST_BLOTCH / 2)
    # All channels by one factor, so that no colour comes out that is not there.
    share = np.clip(size - LEAST_BLOTCH, 0, MOST_BLOTCH) / np.maximum(size, 1e-6) * own
    off *= (share * np.clip(near / NEAR_SHARE, 0, 1))[..., None]
    gain, (values, where) = np.zeros_like(rgb), wrap(off, texture, room, geometry, ~apart)
    gain[where] = values
    return gain


def _lines(rgb: Floats, target: Flags, apart: Flags, room: RoomModel) -> Floats:
    """Return log gains (H, W, 3) for the walls of a picture (H, W, 3); ``apart`` (H, W): what is no part of them."""
    rows = len(rgb)
    narrow, wide, reach = (angle / math.pi * rows for angle in LINE_RAD)
    pad_px = math.ceil(3 * wide)
    tone, plane = wrapped(np.log(np.maximum(rgb, 1e-6)), pad_px), plane_map(room, Equirectangular(2 * rows, rows))
    gone, other, plane = wrapped(target, pad_px), wrapped(apart, pad_px), wrapped(plane, pad_px)
    rim = cv2.morphologyEx(gone.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    away = np.minimum(cv2.distanceTransform(1 - rim, cv2.DIST_L2, 5), rows)  # no rim: as far as can be
    near = np.exp(-((away / np.float32(reach)) ** 2))
    gain = np.zeros_like(tone)
    for number in np.unique(plane[(plane >= FIRST_WALL) & (rim > 0)]):
        fit = (plane == number) & ~other
        for _ in range(2):
            slow = known_mean(tone, fit, wide)[0]
            fit &= np.abs(grey(tone - slow)) < HALO_THING
        off = slow - known_mean(tone, fit, narrow)[0]
        off = np.clip(off, -MOST_LINE, MOST_LINE) * np.clip(2 - np.abs(off) / MOST_LINE, 0, 1)
        gain[fit] = off[fit]
    gain = np.asarray(cv2.GaussianBlur(gain, (0, 0), narrow) * near[..., None], np.float32)
    return gain[:, pad_px : pad_px + 2 * rows]


def _stains(rgb: Floats, gone: Flags, thing: Flags, room: RoomModel, planes: list[Plane]) -> Floats:
    """Return log gains (H, W, 3) for walls of a picture (H, W, 3), by which shade, glow and colour of what is
    ``gone`` leave no edge beside its filling; ``thing`` (H, W): what seems no wall."""
    geometry, gain = Equirectangular(rgb.shape[1], rgb.shape[0]), np.zeros_like(rgb)
    layers = (np.log(np.maximum(rgb, 1e-6)), np.stack([gone, thing], axis=-1))
    picture, glass = np.concatenate(layers, axis=-1).astype(np.float32), opening_map(room, geometry) >= 0
    for plane in (one for one in planes if one.index >= FIRST_WALL):
        texture = unwrap(picture, geometry, room, plane, PX_PER_M, mask=glass)
        known, frames = texture.known.copy(), np.zeros_like(texture.known)
        known[: round(TOP_M * PX_PER_M)] = known[round((plane.height_m - FOOT_M) * PX_PER_M) :] = False
        for frame in opening_regions(plane, room, known.shape, PX_PER_M):
            known, frames = known & (cv2.dilate(frame.astype(np.uint8), FRAME) == 0), frames | frame
        parts = (one & texture.known for one in (texture.values[..., 3] > 0.5, texture.values[..., 4] > 0.5, frames))
        values, where = wrap(_stain(texture.values[..., :3], known, *parts), texture, room, geometry, ~glass)
        gain[where] = values
    return gain


def _stain(tone: Floats, known: Flags, gone: Flags, thing: Flags, frames: Flags) -> Floats:
    """Return what `_stains` does for one wall's texture (H, W, 3): 0 where too little of it is seen."""
    odd, brush, off = known & thing & ~gone, np.ones((3, 3), np.uint8), np.zeros_like(tone)
    for _ in range(3):
        rest = tone - known_mean(tone, known & ~odd, LOCAL_M * PX_PER_M)[0]
        odd |= known & ~gone & (np.abs(rest).max(axis=-1) > HALO_THING)
    colour = tone - grey(tone)[..., None]
    paint = (cv2.dilate(colour, brush) - cv2.erode(colour, brush)).max(axis=-1) > PAINT
    own = known & ~odd & (cv2.dilate(paint.astype(np.uint8), brush) == 0)
    out, inside = (cv2.distanceTransform(one.astype(np.uint8), cv2.DIST_L2, 5) for one in (~gone, gone))
    for _ in range(3):
        seen, both = (own & (away > STAIN_M * PX_PER_M) for away in (out, out + inside))
        if not seen.any() or not gone.any():
            return np.zeros_like(tone)
        light = known_mean(tone, own, FINE_PX)[0]
        # Of a wall of several paints the one that most of it has; light goes on from both sides of the rim, colour
        # only from what is seen.
        usual = _unlike(light - np.median(light[own], axis=0)) < 1
        off, hue = (spread(light, far & usual) - light for far in (both, seen))
        off = hue + (grey(off) - grey(hue))[..., None]
        own &= usual & (_unlike(off) < 1)
    level, share = grey(off)[..., None], (np.clip(2 - 2 * _unlike(off), 0, 1) * ~frames)[..., None]
    hue = off - level
    size = np.abs(hue).max(axis=-1, keepdims=True)
    hue *= np.maximum(size - LEAST_BLOTCH, 0) / np.maximum(size, 1e-6)
    level = np.sign(level) * np.maximum(np.abs(level) - LEAST_STAIN, 0)
    return spread(np.asarray(share * (hue + level), np.float32), own | frames)


def _unlike(off: Floats) -> Floats:
    """Return how far tones (H, W, 3) are from one paint in another light: from 1 on it is not."""
    hue = np.abs(off - grey(off)[..., None]).max(axis=-1)
    return np.asarray(np.maximum(np.abs(grey(off)) / UNLIKE[0], hue / UNLIKE[1]), np.float32)


def _put_on(image: LuminanceImage, rows: int) -> Floats:
    """Return (rows, 2 rows), 0..1: how much of the lift is put on, less within `SHOULDER` stops below clipping."""
    clipped = image.validity == Validity.CLIPPED
    if not clipped.any():
        return np.ones((rows, 2 * rows), np.float32)
    level = largest_channel(image.rgb)
    stops = np.log2(float(np.median(level[clipped])) / np.maximum(level, 1e-6))
    much = resized(np.clip(stops / SHOULDER, 0, 1).astype(np.float32), (rows, 2 * rows))
    return smoothed(much, SHOULDER_RAD)


def light_without(shade: Shade, room: RoomModel, rows: int) -> tuple[Floats, Floats]:
    """Return the empty room's irradiance (H, 2 H, 3), lx, without direct sun, and its relative standard uncertainty
    (H, 2 H), for a panorama of ``rows``."""
    plane, planes = plane_map(room, Equirectangular(2 * rows, rows)), _by_plane(shade, room, np.ones_like(shade.seen))
    light, doubt = np.ones((rows, 2 * rows, 3), np.float32), np.zeros((rows, 2 * rows), np.float32)
    for into, parts in (((light, np.zeros_like(doubt)), LIGHT), ((np.ones_like(light), doubt), GAIN)):
        _in_bands(partial(_multiplied, *into), planes, plane, np.zeros(plane.shape, bool), parts)
    return light, np.hypot(np.float32(LIFT_DOUBT) * np.abs(doubt), np.float32(LIGHT_DOUBT))


def _by_plane(shade: Shade, room: RoomModel, much: Floats) -> list[Floats]:
    """Return, for each plane of the room, log change, how ``much`` (h, w) of it is put on, and log light (h, w + 2, 7),
    continued beyond it, a column round the seam.

    Of a wall that the picture shows as a sliver this size may have no pixel: it is lit as what is around."""
    high, wide = shade.seen.shape
    plane = plane_map(room, Equirectangular(wide, high))
    light = np.log(np.maximum(shade.without_lx, 1e-6))
    lit = shade.without_lx.max(axis=-1) > 0
    found, around = [], _continued(light, lit)
    for number in range(len(planes_of(room))):
        mine = plane == number
        usual = _continued(light, mine & lit) if (mine & lit).any() else around
        lift = _continued(np.concatenate([shade.log_change, much[..., None]], axis=-1), mine & shade.seen)
        both = np.concatenate([lift, usual], axis=-1)
        found.append(np.concatenate([both[:, -1:], both, both[:, :1]], axis=1))
    return found


def _continued(values: Floats, known: Flags) -> Floats:
    """Return values (h, w, C) that go on smoothly, round the seam, where not ``known`` (h, w); 0 where none is."""
    usual = np.median(values[known], axis=0) if known.any() else np.zeros(values.shape[2])
    return carried_on(values, known, [partial(smoothed, angle_rad=reach_rad) for reach_rad in REACHES_RAD], usual)


Work = Callable[[slice, Floats, Floats], None]
UNLIT, LIT, LIGHT = (1, 0, -1, math.log(math.pi)), (-1, 1, 1, -math.log(math.pi)), (0, 0, 1, 0)
GAIN, PLAIN, ALONE = (1, 0, 0, 0), (1, 0, 0, 1), ((0, 0), (0, 0), (0, 4))
"""Weights by which a factor's logarithm is summed: of the log change, of the part of it that is put on, of the log of
light, and a constant. PLAIN gives the factor itself, of gains less 1. ALONE pads such gains to a layer's channels."""


def _in_bands(work: Work, planes: list[Floats], plane: Int16s | None, glass: Flags, parts: Sequence[float]) -> None:
    """Do ``work``, side by side, on bands of rows of the whole picture: with factors' logarithms (h, W, 3), by
    ``parts``, and what the log change of luminance has in them (h, W), 0 on ``glass`` (H, W), of the ``planes`` by
    index; None: the only one."""
    (high, wide), (small_high, small_wide) = glass.shape, planes[0].shape[:2]
    x = ((np.arange(wide) + 0.5) * (small_wide - 2) / wide + 0.5).astype(np.float32)
    layers, usual = np.stack(planes), np.mean([light[..., 4:].mean(axis=(0, 1)) for light in planes], axis=0)
    usual = np.append(np.zeros(4), usual).astype(np.float32)

    def band(rows: slice) -> None:
        y = ((np.arange(rows.start, rows.stop) + 0.5) * small_high / high - 0.5).astype(np.float32)
        power, lift = np.empty((len(y), wide, 3), np.float32), np.empty((len(y), wide), np.float32)
        which = np.zeros(lift.shape, np.int16) if plane is None else plane[rows]
        _sampled(layers, which, glass[rows], (x, y), usual, np.array(parts, np.float32), power, lift)
        work(rows, power, lift)

    side_by_side(band, bands(high, BAND_ROWS), MOST_BANDS)


@compiled
def _sampled(layers: Any, which: Any, glass: Any, at: Any, usual: Any, parts: Any, power: Any, lift: Any) -> None:
    """Fill what `_in_bands` gives, ``power`` (H, W, 3) and ``lift`` (H, W), from layer ``which`` (H, W) of ``layers``
    (P, h, w, 7), linear between pixels. What is seen through ``glass`` (H, W) is not lit by the room: it goes on as it
    is, in one light, ``usual`` (7,)."""
    (_, height, width, channels), (x, y) = layers.shape, at
    found = np.zeros(channels, np.float32)
    channels = channels if parts[2] != 0 else 4 if parts[1] != 0 else 3  # that have a weight
    for i in range(which.shape[0]):
        up = min(max(int(np.floor(y[i])), 0), height - 1)
        down, lower = min(max(int(np.floor(y[i])) + 1, 0), height - 1), y[i] - np.floor(y[i])
        for j in range(which.shape[1]):
            left, of = int(x[j]), which[i, j]
            right, more = min(left + 1, width - 1), x[j] - np.floor(x[j])
            for c in range(channels):
                above = layers[of, up, left, c] + more * (layers[of, up, right, c] - layers[of, up, left, c])
                below = layers[of, down, left, c] + more * (layers[of, down, right, c] - layers[of, down, left, c])
                found[c] = usual[c] if glass[i, j] else above + lower * (below - above)
            times = parts[0] + parts[1] * found[3]
            lift[i, j] = times * ((found[0] + found[1] + found[2]) / np.float32(3))
            for c in range(3):
                power[i, j, c] = times * found[c] + parts[2] * found[4 + c] + parts[3]
