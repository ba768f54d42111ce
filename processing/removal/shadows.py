"""Contact and soft shadows of furniture, plane by plane: found, and relit.

The light far from all furniture shows what the light would be without it: a smooth surface, fitted robustly to
logarithms. Places near furniture that are clearly darker and hang together with it are its shadow. A narrow band
along its foot always counts: contact shadow, and light that bounced off it. The band is replaced, the rest relit.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.ground.seam import components, grown, resized, summed
from processing.removal.illumination import ToneScale, fit_illumination, grey, known_mean, spread
from processing.sphere import Equirectangular, directions
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR, Plane, planes_of, surface_maps
from processing.surfaces.textures import texel_places, unwrap, wrap

PX_PER_M = 20.0  # texels of 5 cm; chosen, never swept
CONTACT_M = 0.10  # chosen, never swept
FAR_M = 0.7  # from furniture, where its shadow no longer counts as seen
REACH_M = 0.8  # how far a shadow is followed
LEAST_STOPS = 0.3  # darker than without furniture
NOISE_FACTOR = 2.0  # times the spread (robust standard deviation) of the light far from furniture
MOST_TINT = 0.15  # stops by which a channel is lifted more or less than the mean (chosen on nine furnished real rooms)
MOST_LIFT = 1.5  # stops by which a soft shadow is lifted at most: what is darker is no shadow of furniture
LEAST_FAR, LEAST_FAR_SHARE = 60, 0.4
"""Texels far from furniture that a fit needs; of all that are seen, that relighting needs (chosen: a real room with a
third of its floor seen became a bright shard)."""
LEAST_M2 = 0.01  # 10 by 10 cm; chosen, never swept
RELIT_ROWS = 1024  # of the size at which soft shadows are relit: their light is smooth
LAMP, CLIPPED = 3.0, 0.2
"""Stops above the median of what stays, or below the brightest of all: what goes there was a lit lamp (chosen)."""
MOST_LAMP_SR, MOSTLY = 0.1, 0.5  # chosen: larger things are no lamps, nor what is bright and mostly wall
GLOW_M, GLOW_CORE_M, LEAST_GLOW = 1.3, 0.6, 0.3
"""Reach of a lamp's glow; how near, and by how many stops, a quarter of that must be brighter (chosen)."""
MOST_GLOW = 4.0  # stops that are taken off at most (chosen: a clipped wall)
OWN_RAD = math.radians(2)  # chosen: what is bright so near to what is removed is its own rim
FAR_AWAY = np.full((1, 3), 1e6)  # where lamps are that there are not


@dataclass(frozen=True)
class ShadowFound:
    """Shadows at working size."""

    mask: Flags
    contact: Flags
    """Of it, the narrow band along the foot: what cannot be relit, and is replaced."""
    planes_without_fit: int
    """Planes too full to estimate the light without furniture: only contact bands there."""


def find_shadows(
    luminance: Floats, room: RoomModel, geometry: Equirectangular, furniture: Flags, other: Flags
) -> ShadowFound:
    """Return shadow and contact of furniture on floor and walls.

    ``luminance`` (H, W), linear; ``furniture`` (H, W); ``other`` (H, W): what else hides a plane or is no part of it
    (openings, pictures, direct sun, tripod).
    """
    found, band = np.zeros(furniture.shape, bool), np.zeros(furniture.shape, bool)
    without = 0
    log2 = np.log2(np.maximum(luminance, 1e-6)).astype(np.float32)
    hidden = furniture | other
    for plane in planes_of(room):
        if plane.index == CEILING:
            continue
        texture = unwrap(log2, geometry, room, plane, PX_PER_M, mask=hidden)
        cover = unwrap(furniture.astype(np.float32), geometry, room, plane, PX_PER_M)
        object_here = cover.known & (cover.values > 0.5)
        if not object_here.any() or not texture.known.any():
            continue
        if plane.index == FLOOR:
            shadow, whole = _on_plane(texture.values, texture.known, object_here)
            without += not whole
        else:
            shadow = _by(object_here, CONTACT_M)
        layers = np.stack([shadow, _by(object_here, CONTACT_M)], axis=-1).astype(np.float32)
        values, where = wrap(layers, texture, room, geometry, ~hidden)
        found[where] |= values[:, 0] > 0.5
        band[where] |= values[:, 1] > 0.5
    return ShadowFound((found | band) & ~hidden, band & ~hidden, without)


def relit(rgb: Floats, shadow: Flags | None, hidden: tuple[Flags, Flags | None], room: RoomModel) -> Floats:
    """Return factors (h, 2 h, 3) float32, h <= `RELIT_ROWS`, that take soft shadows and lamps' glow off a panorama
    (H, W, 3), linear, but where something is removed.

    ``shadow`` (H, W); ``hidden``: what is removed (1 there), and what else seems no part of its surface, (H, W): that
    teaches nothing, but for shadow (the dark under a bed is taken for the bed); light falls on it as beside it.
    """
    shape, removed = (rgb.shape[0], rgb.shape[1]), hidden[0]
    small = (min(shape[0], RELIT_ROWS), min(shape[1], 2 * RELIT_ROWS))
    shade, others = (np.zeros(shape, bool) if one is None else one for one in (shadow, hidden[1]))
    light = resized(rgb, small)
    less, gone, thing = (resized(mask.astype(np.float32), small) > 0.5 for mask in (shade, removed, others))
    gain = unglowed(light, gone, thing, room)
    if (less & ~gone).any():
        gain *= relit_gain(light, less, gone | (thing & ~less), room)
    return gain


def unglowed(rgb: Floats, removed: Flags, things: Flags, room: RoomModel) -> Floats:
    """Return factors (H, W, 3) that take the glow of ``removed`` lamps (H, W) off walls and ceiling, linear light.

    As for shade, a smooth surface through what is far from them says what light is left. ``things`` (H, W): what else
    is no part of a surface; such lamps that stay keep the glow that is nearer to them.
    """
    geometry, gain = Equirectangular(rgb.shape[1], rgb.shape[0]), np.ones_like(rgb)
    log2 = np.log2(np.maximum(rgb, 1e-6)).astype(np.float32)
    maps = surface_maps(room, geometry)
    glass = maps.opening >= 0
    level = log2.max(axis=-1)
    bright = (level > min(np.median(np.append(level[~removed & ~glass], 0)) + LAMP, level.max() - CLIPPED)) & ~glass
    lamps = _small(bright & removed, removed)
    if not lamps.any():
        return gain
    # Where lamps are seen on walls: those that go, and those that stay.
    away = directions(geometry)[0] * maps.depth_m[..., None] + np.array([0.0, 0.0, room.camera_height_m])
    stay = _small(bright & ~grown(removed, OWN_RAD), things)
    trees = [cKDTree(away[mask][::3] if mask.any() else FAR_AWAY) for mask in (lamps, stay)]
    for plane in planes_of(room)[CEILING:]:
        texture = unwrap(log2, geometry, room, plane, PX_PER_M, mask=removed | things | glass)
        near, other = (tree.query(texel_places(plane, PX_PER_M))[0] for tree in trees)
        far, core = texture.known & (near > GLOW_M), texture.known & (near < GLOW_CORE_M)
        if far.sum() < LEAST_FAR or not core.any():
            continue
        # Of two lamps each lights a place by the inverse square of its distance.
        fade = np.clip(2 * (1 - near / GLOW_M), 0, 1) * other**2 / (near**2 + other**2)
        glow = [_smooth_fit(texture.values[..., k], far)[0] for k in range(3)]
        more = np.clip(texture.values - np.stack(glow, axis=-1), 0, MOST_GLOW)
        if float(np.quantile(more[core].mean(axis=-1), 0.75)) < LEAST_GLOW:
            continue
        # It goes on to what is removed, and under things that are not.
        more = (spread(more.astype(np.float32), texture.known) * fade[..., None]).astype(np.float32)
        # Also where it is removed: at a finer size the factors of its rim lie between both.
        values, where = wrap(more, texture, room, geometry, ~glass)
        gain[where] = np.exp2(-values)
    return gain


def _small(bright: Flags, things: Flags) -> Flags:
    """Return the parts of what is ``bright`` that are no larger than lamps are and mostly ``things``, (H, W) each: the
    rest is a wall that they light."""
    _, labels = components(bright)
    size, of_things = summed(labels, bright, bright & things)
    return np.asarray((labels > 0) & ((size < MOST_LAMP_SR) & (of_things > MOSTLY * size))[labels])


def relit_gain(rgb: Floats, shadow: Flags, hidden: Flags, room: RoomModel) -> Floats:
    """Return factors (H, W, 3) that make the soft ``shadow`` (H, W) of a panorama (H, W, 3), linear, as around it.

    ``hidden`` (H, W): what else lies before a surface. Light is smooth: a quadratic surface through the logarithms
    outside the shadow says what the places would have had (as in `find_shadows`), in each channel: what stands in the
    shade colours it, but little (far from what is seen, the channels' surfaces drift apart).
    """
    geometry = Equirectangular(rgb.shape[1], rgb.shape[0])
    gain, floor = np.ones(rgb.shape, np.float32), planes_of(room)[FLOOR]
    shade = unwrap(shadow.astype(np.float32), geometry, room, floor, PX_PER_M).values > 0.5
    log2 = np.log2(np.maximum(rgb, 1e-6)).astype(np.float32)
    texture = unwrap(log2, geometry, room, floor, PX_PER_M, mask=hidden)
    far = texture.known & ~_by(shade, 2 * CONTACT_M)
    # Where most of a floor lies in what may be shade, nobody knows its light without.
    if not shade.any() or far.sum() < max(LEAST_FAR, LEAST_FAR_SHARE * texture.known.sum()):
        return gain
    spread = cv2.GaussianBlur((shade | ~texture.known).astype(np.float32), (0, 0), CONTACT_M * PX_PER_M)
    lifts = [_lift(texture.values[..., channel], texture.known, far) * spread for channel in range(3)]
    lift = np.stack(lifts, axis=-1)
    grey = lift.mean(axis=-1, keepdims=True)
    lift = grey + np.clip(lift - grey, -MOST_TINT, MOST_TINT)
    values, where = wrap(lift, texture, room, geometry, np.ones_like(hidden))
    gain[where] = np.exp2(values)
    return gain


def _lift(log2: Floats, known: Flags, far: Flags) -> Floats:
    """Return by how many stops a texture (H, W) is darker than the smooth light of its ``far`` texels (H, W)."""
    smooth = known_mean(log2, known, 0.06 * PX_PER_M)[0]
    lift = np.clip(_smooth_fit(smooth, far)[0] - smooth, 0, MOST_LIFT).astype(np.float32)
    # It goes on under what is removed, so that it does not fade towards the rim.
    return known_mean(lift, known, CONTACT_M * PX_PER_M)[0]


def _on_plane(log2: Floats, known: Flags, thing: Flags) -> tuple[Flags, bool]:
    """Return shadow on a plane's texture, and whether the light without furniture could be estimated."""
    # Texels that furniture hides in part belong to the band: the picture's finer pixels beside it fall into them.
    band = _by(thing, CONTACT_M)
    contact = known & band
    smooth = known_mean(log2, known, 0.06 * PX_PER_M)[0]
    far = known & ~_by(thing, FAR_M)
    if far.sum() < LEAST_FAR:
        return band, False
    expected, spread = _smooth_fit(smooth, far)
    dark = known & (smooth < expected - max(LEAST_STOPS, NOISE_FACTOR * spread)) & _by(thing, REACH_M)
    count, labels = cv2.connectedComponents((dark | contact).astype(np.uint8), connectivity=8)
    areas = np.bincount(labels.ravel(), minlength=count) / PX_PER_M**2
    kept = np.zeros(count, bool)
    kept[np.unique(labels[contact])] = True
    kept &= areas >= LEAST_M2
    kept[0] = False
    return kept[labels] | band, True


def _by(mask: Flags, distance_m: float) -> Flags:
    """Return what lies within a distance of a mask on a texture."""
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(away <= max(distance_m * PX_PER_M, 1.0), bool) & mask.any()


def _smooth_fit(values: Floats, far: Flags) -> tuple[Floats, float]:
    """Return a quadratic surface through the far texels (robust), held within their range, and the spread around it."""
    rows, columns = np.indices(values.shape)
    y, x = rows / values.shape[0] - 0.5, columns / values.shape[1] - 0.5
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    a, b = terms[far], values[far].astype(np.float64)
    weight = np.ones(len(b))
    ridge = 1e-3 * len(b) * np.diag([0, 1, 1, 4, 4, 4])
    spread = 0.0
    for _ in range(4):
        solution = np.linalg.solve(a.T @ (a * weight[:, None]) + ridge, a.T @ (b * weight))
        off = b - a @ solution
        spread = float(1.4826 * np.median(np.abs(off)))
        weight = 1 / np.maximum(1.0, np.abs(off) / max(1.5 * spread, 1e-3))
    low, high = np.quantile(b, [0.02, 0.98])
    return np.clip(terms @ solution, low, high).astype(np.float32), spread


# What removed furniture leaves on plain walls and floors: its soft shade, and the rim of things that masks miss.
#
# A plain surface is one colour in light that changes slowly. What differs from that beside what is removed, and hangs
# together with it, is replaced with it: its continuation is surer than a shadow's strength.

# Chosen by looking at five furnished real rooms (docs/measurements/real.md), unless said otherwise.
WALL_PX_PER_M = 32.0  # of a wall's texture (chosen)
AWAY_M = 0.3  # from what is removed, where a wall shows its light undisturbed (chosen)
FOOT_M, TOP_M = 0.22, 0.12  # skirting and cornice: nothing there is judged (chosen)
BEND, LOCAL_M, PASSES = 0.1, 0.35, 4
"""Stiffness of the slow light (`fit_illumination`); over how much of the wall what it leaves is averaged, and how
often, without what was odd (chosen)."""
PLAIN = 0.1
"""Tone: robust deviation about the slow light from which a wall has a pattern, in which nothing is odd (chosen)."""
ODD, ODD_TIMES, ODD_REACH_M, ODD_NEAR = 0.16, 4.0, 0.3, 0.5
"""Tone, and times that deviation, from which a place is no part of the wall; how far it is so; how much of what hangs
together must be within that (chosen)."""
SHADE, SHADE_TIMES, SHADE_COLOUR, SHADE_REACH_M = 0.06, 2.0, 0.5, 0.9
"""The same for shade; its colour may be off by so much of its depth (chosen)."""
SHADE_STEEP = 0.25  # tone by which it changes within 0.1 m at most: it runs out, things end (chosen)
SHADE_WIDE = np.ones((round(0.16 * WALL_PX_PER_M),) * 2, np.uint8)  # narrower is a picture's frame (chosen)
MOUNT = np.ones((round(0.12 * WALL_PX_PER_M),) * 2, np.uint8)  # between a frame and its picture (chosen)
TOUCH_M, LEAST_TEXELS = 0.1, 200  # from what is removed, where shade begins; of a wall that must be seen (chosen)
FRAME = np.ones((2 * round(0.12 * WALL_PX_PER_M) + 1,) * 2, np.uint8)  # around windows and doors, their frames (chosen)


def find_plain_shade(
    rgb: Floats, room: RoomModel, geometry: Equirectangular, removed: Flags, barred: Flags
) -> tuple[Flags, Flags]:
    """Return what is replaced with the ``removed`` on walls and floor, and what is there by itself, (H, W) each.

    ``rgb`` (H, W, 3), linear light. ``barred``: openings, and what is known for a fixture of the room.
    """
    found, hangs = np.zeros((2, *removed.shape), bool)
    layers = np.concatenate([rgb, np.stack([removed, barred], axis=-1).astype(np.float32)], axis=-1)
    for plane in (plane for plane in planes_of(room) if plane.index != CEILING):
        texture = unwrap(layers, geometry, room, plane, WALL_PX_PER_M)
        gone = texture.known & (texture.values[..., 3] > 0.5)
        # Skirting shows on the floor's rim where the room is taken for wider than it is.
        never = (texture.values[..., 4] > 0.1) | ((rim := plane.index == FLOOR) & ~texture.known)
        never = cv2.dilate(never.astype(np.uint8), FRAME, borderType=cv2.BORDER_CONSTANT, borderValue=rim).astype(bool)
        if gone.any():
            marks = _left_on(texture.values[..., :3], texture.known & ~never & ~gone, gone, plane)
            values, where = wrap(marks, texture, room, geometry, ~(removed | barred))
            found[where] |= values[:, 0] > 0.5
            hangs[where] |= (not rim) & (values[:, 1] > 0.5)  # furniture may hide the rest of a rug
    return found, hangs


def _left_on(light: Floats, known: Flags, gone: Flags, plane: Plane) -> Floats:
    """Return what is replaced on a wall or floor, and what stays (H, W, 2): nothing if it is not plain, or unseen."""
    if plane.index >= FIRST_WALL:
        known[: round(TOP_M * WALL_PX_PER_M)] = False
        known[round((plane.height_m - FOOT_M) * WALL_PX_PER_M) :] = False
    away = cv2.distanceTransform((~gone).astype(np.uint8), cv2.DIST_L2, 5) / np.float32(WALL_PX_PER_M)
    clean = known & (away > AWAY_M)
    nothing = np.zeros((*known.shape, 2), np.float32)
    if clean.sum() < LEAST_TEXELS:
        return nothing
    rest, spread = _about_light(known_mean(ToneScale.of(light, clean).tone(light), known, 1.0)[0], clean)
    if spread > PLAIN:
        return nothing
    dark = grey(rest)
    colour = np.abs(rest - dark[..., None]).max(axis=-1)
    odd = known & (np.abs(rest).max(axis=-1) > max(ODD, ODD_TIMES * spread))
    soft = (dark < -max(SHADE, SHADE_TIMES * spread)) & (colour < SHADE_COLOUR * np.abs(dark) + 0.03)
    high, low = (np.where(known, dark, far).astype(np.float32) for far in (-9, 9))
    brush = np.ones((3, 3), np.uint8)
    soft &= cv2.dilate(high, brush) - cv2.erode(low, brush) < SHADE_STEEP
    soft &= cv2.morphologyEx((soft | gone).astype(np.uint8), cv2.MORPH_OPEN, SHADE_WIDE).astype(bool)
    # A picture that what is removed comes near to stays whole, with its frame around its mount.
    things = odd & ~soft
    mount = MOUNT if plane.index >= FIRST_WALL else brush[:1, :1]
    joined = cv2.morphologyEx(things.astype(np.uint8), cv2.MORPH_CLOSE, mount)
    _, labels = cv2.connectedComponents(joined, connectivity=8)
    near, whole = (np.bincount(labels.ravel(), part.ravel()) for part in (things & (away < ODD_REACH_M), things))
    stays = things & (near < ODD_NEAR * whole)[labels]
    marks = known & ~stays & ((odd & (away < ODD_REACH_M)) | (soft & (away < SHADE_REACH_M)))
    _, labels = cv2.connectedComponents(marks.astype(np.uint8), connectivity=8)
    touching = np.unique(labels[marks & (away <= TOUCH_M)])
    return np.stack([np.isin(labels, touching[touching > 0]) & marks, stays], axis=-1).astype(np.float32)


def _about_light(tone: Floats, clean: Flags) -> tuple[Floats, float]:
    """Return tones (H, W, 3) about the wall's slow light, and their robust deviation where ``clean`` (H, W)."""
    usual, level = clean, np.median(tone[clean], axis=0)
    slow = level + fit_illumination(np.where(clean[..., None], tone - level, 0), clean, ~clean, None, bend=BEND)
    base = np.asarray(tone - slow, np.float32)
    rest, spread = base, 0.0
    for _ in range(PASSES):
        rest = np.asarray(base - known_mean(base, usual, LOCAL_M * WALL_PX_PER_M)[0], np.float32)
        off = np.abs(rest).max(axis=-1)
        spread = 1.4826 * float(np.median(off[usual]))
        usual = clean & (off < max(ODD, 2 * spread)) & (grey(rest) > -max(SHADE, SHADE_TIMES * spread))
    return rest, spread
