"""The room, emptied: each plane's hole is filled in its rectified texture and drawn back into the panorama.

Fills never cross an edge between planes: those edges are the layout's. Pixels outside the target stay bit for bit
(Ji et al. 2023, section 4, there with NPP-Net and LaMa)."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import cv2
import numpy as np

from processing.errors import ParameterError, RemovalError
from processing.ground.arrays import Bytes, Flags, Floats, Int16s
from processing.ground.room_model import RoomModel
from processing.ground.seam import wrapped
from processing.ground.threads import give_back, side_by_side
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.removal.illumination import ToneScale, grey, known_mean, spread
from processing.removal.plain import MOST_RISE_FLOOR, seamless
from processing.removal.plane_fill import CONTINUED, SEEN, SURE, SYNTHESISED, FilledPlane, fill_plane
from processing.removal.skirting import Skirting, find_skirting
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, FLOOR, Plane, boundary_rows, plane_map, planes_of
from processing.surfaces.textures import Texture, unwrap, wrap

# Direct sunlight that stays in the picture and runs into a hole goes on in it: what stood in the sun leaves sun.
#
# Filling is done from the shade. Then each texel of the hole is lit as far as the membrane through what is seen around
# (1 in the sun, 0 in the shade) lies above one half, and brighter by as much as the sunlit rim is brighter than the
# filling beside it.

RIM_PX = 6  # chosen, never swept
SOFT = 0.12  # of the membrane about one half, in which the edge of the light lies
LEAST_GAIN = 0.25  # natural logarithm: less is no sunlight
BRIGHT = 1.8  # times the shade's median luminance: sunlight, where it touches what is known as such
LEAST_RIM = 8  # sunlit texels at the hole's rim
PlaneFiller = Callable[[FilledPlane], FilledPlane]  # what may improve a filled plane (`removal.learned`)

MIXED_SHARE = 0.1  # of what is removed in a texel that still counts as known; chosen, never swept
MIXED_PX = 1  # panorama pixels beside the target that hold some of what is removed: seen, but not to be copied
UNSURE_SUN = 0.4  # of the confidence that sunlight continued into a hole costs
PLANES_AT_ONCE = 4  # chosen, for memory: each has some 200 MB of textures
FILLED_UNCERTAINTY = 0.05  # relative standard uncertainty of the surest filled pixel
TEXELS = {"draft": 400_000, "standard": 1_600_000, "reference": 4_000_000}  # of the largest texture
QUICK_TEXELS, MOST_KEPT = 12_000, 60
"""Of a preview's largest texture (chosen: a floor's boards are still seen), and how many fillings it remembers."""
FINER = 1.25  # texels to a panorama's pixel where the plane is nearest, so that copying costs no sharpness


def sunlit(values: Floats, known: Flags, hole: Flags, sun: Flags) -> tuple[Floats, Floats]:
    """Return the texture (H, W, 3) with sunlight in its filled ``hole``, and how far each texel is lit (H, W), 0..1.

    ``sun`` (H, W): known texels in direct sunlight; ``known`` all known ones. Outside the hole nothing changes."""
    nothing = np.zeros(hole.shape, np.float32)
    near = cv2.dilate(hole.astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)).astype(bool)
    sun = _whole(values, known, sun & known) if sun.any() else sun
    rim = near & sun
    if rim.sum() < LEAST_RIM:
        return values, nothing
    scale = ToneScale.of(values, known)
    tone = scale.tone(values)
    beside = hole & cv2.dilate((~hole).astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)).astype(bool)
    gain = known_mean(tone, rim, RIM_PX)[0] - known_mean(tone, beside, RIM_PX)[0]
    # The rim of a patch is half in the shade; what is hardly brighter is no sun.
    bright = rim & (grey(gain) > LEAST_GAIN)
    if bright.sum() < LEAST_RIM:
        return values, nothing
    more = spread(gain, bright)
    share = spread(sun.astype(np.float32), known & near)
    lit = np.where(hole, np.clip((share - 0.5) / SOFT + 0.5, 0, 1), 0).astype(np.float32)
    out = values.copy()
    out[hole] = scale.light(tone + more * lit[..., None])[hole]
    return out, lit


def _whole(values: Floats, known: Flags, sun: Flags) -> Flags:
    """Return the sunlit texels with the bright ones that hang together with them: masks of sunlight end early."""
    shade = known & ~sun
    if not shade.any():
        return sun
    luminance = luminance_cd_m2(values)
    bright = known & (luminance > BRIGHT * float(np.median(luminance[shade])))
    _, labels = cv2.connectedComponents((bright | sun).astype(np.uint8))
    lit = np.unique(labels[sun])
    return np.asarray(np.isin(labels, lit[lit > 0]))


@dataclass(frozen=True)
class Emptied:
    """A panorama without what the target covered."""

    image: LuminanceImage | RelativeImage
    """Of the given type; pixels outside the target are the given ones, filled ones have validity REPAIRED."""
    provenance: Bytes
    """(H, W): 0 seen, 1 continued from what is seen around, 2 synthesised."""
    confidence: Floats
    """(H, W), 0..1: 1 where seen."""
    textures: tuple[FilledPlane, ...]
    """Of the planes that had a hole, in their order."""
    notes: tuple[str, ...]


class Quick:
    """A preview's way of filling: few texels, and planes of which nothing has changed (but others) as they were."""

    def __init__(self) -> None:
        self._kept: dict[bytes, FilledPlane] = {}

    def fill(self, texture: Texture, masks: Sequence[Flags], own: str, work: Callable[[], FilledPlane]) -> FilledPlane:
        """Return the `fill_plane` of a texture (H, W) with its ``masks``, and what its plane has of its ``own``, by
        ``work`` or remembered."""
        parts = [part.tobytes() for part in (texture.values, texture.known, *masks)]
        key = hashlib.sha256(b"".join([*parts, own.encode()])).digest()
        found = self._kept.pop(key, None) or work()
        self._kept = {**dict([*self._kept.items()][1 - MOST_KEPT :]), key: found}
        return found


@dataclass(frozen=True)
class _Seen:
    """What the panorama shows of the room."""

    light: Floats
    """(H, W, 3): finite."""
    marks: Bytes
    """(H, W), bits: what is seen but not to be copied; direct sunlight that stays; what is no part of its plane."""
    geometry: Equirectangular
    room: RoomModel
    masked: Flags
    """(H, W): nothing of the room is seen here."""
    planes: Int16s
    """(H, W): index of the plane behind each pixel."""

    @cached_property
    def usual(self) -> tuple[Floats, Floats]:
        """Median light (3,) of what is seen, and of walls if any are. A few thousand pixels are enough for it."""
        every = ~self.masked
        some = [each if each.any() else every for each in (every, every & (self.planes >= FIRST_WALL))]
        among = (np.flatnonzero(each)[:: max(1, int(each.sum()) // 10_000)] for each in some)
        one, other = (np.median(self.light.reshape(-1, 3)[at], axis=0).astype(np.float32) for at in among)
        return one, other


class Others(NamedTuple):
    """What else is known of what is seen."""

    foreign: Flags | None = None
    """(H, W): what is probably no part of its plane (rugs, pictures, rests of furniture): it stays as it is, and floors
    are not filled from it."""
    boards: Floats | None = None
    """(h, w), 0..1: how much of what is seen is skirting; None: unknown."""
    unlike: Flags | None = None
    """(H, W): what surely belongs to another plane (floor seen before a wall, a door's leaf before the floor): nothing
    is learnt from it; what stands before the floor keeps its light, too."""

    def no_surface(self, target: Flags) -> Flags:
        """Return a ``target`` (H, W) with what is `unlike`."""
        return target if self.unlike is None else target | self.unlike


def empty_room(
    image: LuminanceImage | RelativeImage,
    target: Flags,
    room: RoomModel,
    *,
    sunlight: Flags | None = None,
    others: Others | None = None,
    quality: str | Quick = "standard",
    filler: PlaneFiller | None = None,
    own: bool = False,
) -> Emptied:
    """Return the panorama with the target filled.

    ``image``: equirectangular and upright.
    ``target`` (H, W): what is to be removed, with its shadow.
    ``sunlight`` (H, W): direct sunlight with its rim, from which nothing is copied; it is filled only where ``target``
      says so, and goes on in holes that it runs into elsewhere.
    ``others``: what else is known of what is seen.
    ``quality``: draft, standard or reference: how fine textures may be; `Quick`: of a preview.
    ``own``: the light of ``image`` may be drawn in.
    Raises `ParameterError`: sizes that do not fit; a picture that is not equirectangular; an unknown quality;
    `RoomError`: the room cannot stand; `RemovalError`: a target that covers all that is seen."""
    others = others or Others()
    foreign, boards, _ = others
    geometry = _checked(image, target, sunlight, foreign, quality)
    if not target.any():
        return Emptied(image, *_blank(target.shape), (), ("nothing to remove",))
    rgb, blind = _finite(image)
    if (target | blind).all():
        likely = "the mask is all white, or inverted"
        advice = "leave part of floor, walls and ceiling out of the mask"
        raise RemovalError("no part of the room is left to fill from", where="target", likely=likely, advice=advice)
    shown = plane_map(room, geometry)
    unfit = _unfit(target, sunlight) | (others.no_surface(target) & ~target)
    foreign = np.zeros_like(target) if foreign is None else foreign
    kept = np.zeros_like(target) if sunlight is None else sunlight & ~target
    walls = ((shown >= FIRST_WALL) & target).any()
    # Boards in front of the floor's plane are no surface; where they are all that is seen, they count.
    masks = (target | blind | one for one in (unfit, _unfit(target, sunlight)) if walls)
    skirting = next((one for mask in masks if (one := find_skirting(rgb, geometry, room, mask, boards))), None)
    hidden = [plane for plane in planes_of(room) if (target & (shown == plane.index)).any()]
    marks = unfit | kept * np.uint8(2) | foreign * np.uint8(4)
    seen = _Seen(rgb, marks, geometry, room, target | blind, shown)
    del unfit, foreign, kept, blind, marks, masks  # which are large, before planes are filled
    filled = _filled(seen, hidden, quality, skirting, filler)
    provenance, confidence = _blank(target.shape)
    out = image.rgb if own else image.rgb.copy()

    def drawn(done: FilledPlane) -> list[str]:
        plane = done.texture.plane
        where = target & (shown == plane.index)
        _draw(done, seen, where, (out, provenance, confidence))
        guess = done.hole.any() and (done.confidence[done.hole] < 0.06).all()  # no hole: thinner than a texel
        more = [f"{plane.name}: hidden altogether, its colour is a guess"] if guess else []
        return [f"{plane.name}: {where.sum()} px, {done.how}", *more]

    notes = [note for some in side_by_side(drawn, filled, PLANES_AT_ONCE) for note in some]
    soften_edges(out, target, room, geometry)
    return Emptied(_image(image, out, provenance, confidence), provenance, confidence, tuple(filled), tuple(notes))


def _blank(shape: tuple[int, ...]) -> tuple[Bytes, Floats]:
    """Return provenance and confidence (H, W) of what is all seen."""
    return np.zeros(shape, np.uint8), np.ones(shape, np.float32)


def _filled(
    seen: _Seen, hidden: list[Plane], quality: str | Quick, skirting: Skirting | None, filler: PlaneFiller | None
) -> list[FilledPlane]:
    """Return the filled textures of planes, in their order; the floor alone takes nothing from what is foreign."""

    def fill(plane: Plane) -> FilledPlane:
        done = _plane(seen, plane, quality, skirting)
        done = done if filler is None else filler(done)
        give_back()  # what it was filled with
        return replace(done, texture=replace(done.texture, values=done.values))  # what was seen stands there, too

    give_back()
    # Those of which most is hidden first, so that no thread has a long one left when the others are done.
    order = sorted(hidden, key=lambda plane: -np.count_nonzero(seen.masked & (seen.planes == plane.index)))
    filled = side_by_side(fill, order, PLANES_AT_ONCE)
    return sorted(filled, key=lambda done: done.texture.plane.index)


def _checked(
    image: LuminanceImage | RelativeImage, target: Flags, sun: Flags | None, foreign: Flags | None, quality: str | Quick
) -> Equirectangular:
    if not isinstance(image.geometry, Equirectangular):
        raise ParameterError("not a whole panorama", advice="give an equirectangular one")
    for name, mask in (("target", target), ("sun", sun), ("foreign", foreign)):
        if mask is not None and (mask.shape != image.rgb.shape[:2] or mask.dtype != np.bool_):
            advice = f"give booleans of shape {image.rgb.shape[:2]}"
            raise ParameterError(f"a {name} mask of shape {mask.shape} and type {mask.dtype}", advice=advice)
    if isinstance(quality, str) and quality not in TEXELS:
        raise ParameterError(f"quality {quality!r}", advice=f"give one of {', '.join(TEXELS)}")
    return image.geometry


def _finite(image: LuminanceImage | RelativeImage) -> tuple[Floats, Flags]:
    """Return the light with 0 where there is none, and where that is: from there nothing is taken."""
    broken = np.asarray(~np.isfinite(image.rgb).all(axis=-1))
    blind = broken | (image.validity == Validity.OUTSIDE)
    rgb = np.where(broken[..., None], 0, image.rgb).astype(np.float32) if broken.any() else image.rgb
    return rgb, blind


def _unfit(target: Flags, sunlight: Flags | None) -> Flags:
    """Return pixels that are seen but show more than their plane: beside the target, and in the sun."""
    wide = wrapped(target, MIXED_PX).astype(np.uint8)
    beside = cv2.dilate(wide, np.ones((2 * MIXED_PX + 1,) * 2, np.uint8))[:, MIXED_PX:-MIXED_PX].astype(bool) & ~target
    return beside if sunlight is None else beside | (sunlight & ~target)


def _plane(seen: _Seen, plane: Plane, quality: str | Quick, skirting: Skirting | None) -> FilledPlane:
    geometry, room = seen.geometry, seen.room
    px_per_m = texture_density(plane, room, geometry, quality)
    marks = seen.marks if plane.index != FLOOR else seen.marks | (seen.marks >> np.uint8(2) & np.uint8(1))
    texture = unwrap(seen.light, geometry, room, plane, px_per_m, mask=seen.masked, marks=(marks, 3))
    del marks
    limits = (MIXED_SHARE, 0.5, 0.5)
    mixed, sunny, other = (texture.known & (texture.values[..., 3 + k] > limit) for k, limit in enumerate(limits))
    texture = replace(texture, values=np.ascontiguousarray(texture.values[..., :3]))
    # Texels that the camera sees and that are not known lie under the mask.
    hole = (texture.density > 0) & ~texture.known
    given = texture, hole, (mixed, other)
    work = partial(fill_plane, *given, room, seen.usual[plane.index >= FIRST_WALL], skirting)
    own = f"{plane.index} {[one for one in room.openings if one.wall + FIRST_WALL == plane.index]}"
    done = work() if isinstance(quality, str) else quality.fill(texture, (hole, mixed, other), own, work)
    most = MOST_RISE_FLOOR if plane.index == FLOOR else 0.0
    done = replace(done, values=seamless(done.values, texture.known & ~mixed, hole, px_per_m, most))
    values, lit = sunlit(done.values, texture.known, hole, sunny)
    return replace(done, values=values, confidence=done.confidence * (1 - UNSURE_SUN * lit)) if lit.any() else done


def _draw(done: FilledPlane, seen: _Seen, where: Flags, into: tuple[Floats, Bytes, Floats]) -> None:
    """Draw a plane's filling into the panorama, its provenance and its confidence."""
    out, provenance, confidence = into
    layers = np.concatenate([done.values, done.confidence[..., None], done.continued[..., None].astype(np.float32)], -1)
    values, mask = wrap(layers, done.texture, seen.room, seen.geometry, where, seen.planes)
    out[mask] = np.maximum(values[:, :3], 0)
    sure = np.clip(values[:, 3], 0, 1)
    confidence[mask] = sure
    provenance[mask] = np.where((sure >= SURE) & (values[:, 4] > 0.99), CONTINUED, SYNTHESISED)


def _image(
    image: LuminanceImage | RelativeImage, rgb: Floats, provenance: Bytes, confidence: Floats
) -> LuminanceImage | RelativeImage:
    filled = provenance != SEEN
    uncertainty, validity = image.uncertainty.copy(), image.validity.copy()
    uncertainty[filled] = FILLED_UNCERTAINTY + (1 - confidence[filled])
    validity[filled] = Validity.REPAIRED
    return replace(image, rgb=rgb, uncertainty=uncertainty, validity=validity)


def texture_density(plane: Plane, room: RoomModel, geometry: Equirectangular, quality: str | Quick) -> float:
    """Return pixels a metre that do justice to the panorama where it sees the plane best, within the limit."""
    px_rad = geometry.height_px / math.pi
    offset = np.array([0.0, 0.0, room.camera_height_m]) - plane.origin_m
    nearest_m = max(abs(float(offset @ plane.normal)), 0.3)
    texels = TEXELS[quality] if isinstance(quality, str) else QUICK_TEXELS
    return min(FINER * px_rad / nearest_m, math.sqrt(texels / max(plane.width_m * plane.height_m, 1e-6)))


# Pixels on the edges of floor and ceiling show two planes: filled ones are mixed as a lens would, not in steps.

SOFT_PX, STEEPEST = 1.0, 4.0  # half the width of an edge in a picture; rows a column up to which it counts (chosen)


def soften_edges(out: Floats, target: Flags, room: RoomModel, geometry: Equirectangular) -> None:
    """Mix, in place, the target's pixels of a panorama (H, W, 3) that lie on an edge of floor or ceiling.

    Within `SOFT_PX` of it they show what is above and below by their shares. Nothing outside the target changes. Edges
    between walls are upright in the picture, and have no steps."""
    for rows in boundary_rows(room, geometry):
        reach = SOFT_PX * np.minimum(np.hypot(1, np.gradient(rows)), STEEPEST)
        above, below = np.floor(rows - reach - 0.5).astype(np.intp), np.ceil(rows + reach - 0.5).astype(np.intp)
        columns = np.flatnonzero((above >= 0) & (below < len(out)))
        upper, lower = out[above[columns], columns], out[below[columns], columns]
        for step in range(1, int((below - above)[columns].max(initial=1))):
            row = np.minimum(above + step, below)[columns]
            share = np.clip(0.5 + (row + 0.5 - rows[columns]) / (2 * reach[columns]), 0, 1)[:, None]
            chosen = target[row, columns] & (row < below[columns])
            out[row[chosen], columns[chosen]] = (share * lower + (1 - share) * upper)[chosen]
