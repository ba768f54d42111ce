"""The masks of what is to be taken out of a panorama, each by itself and united (Ji et al. 2023, section 4, fig. 3c).

All is found at a working size and brought to full size, where furniture's edges are laid on the picture's own.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Flags, Floats, Int32s
from processing.ground.room_model import OpeningKind, RoomModel
from processing.ground.seam import components, grown, resized, row_solid_angles, share_of_sphere, smoothed, summed
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.pictures.preview import preview_rgb8
from processing.removal import furniture as pieces
from processing.removal.edges import at_full_size
from processing.removal.furniture import FurnitureFound
from processing.removal.rests import SLIT_RAD, crumbs_on_walls, rests_beside, torn_glare, whole_boards, with_things
from processing.removal.shadows import ShadowFound, find_plain_shade, find_shadows
from processing.removal.skirting import SEEN_SHARE, boards_between, torn_boards
from processing.removal.sunlight import LEAST_PX, SURE_RATIO, SunFound, find_sunlight
from processing.removal.tripod import TripodFound, find_tripod, meter_board
from processing.segmentation.evidence import BEYOND, SceneClass, SceneEvidence
from processing.sphere import Equirectangular, directions
from processing.surfaces.maps import CEILING, FIRST_WALL, FLOOR, SurfaceMaps, surface_maps
from processing.surfaces.sun import coloured_as_behind

WORKING_ROWS = 512  # 0.35 degrees a row: 1 cm at 1.6 m; chosen, never swept
MARGIN_RAD = math.radians(0.6)
LEAST_ROWS = 16  # 11 degrees a row; chosen, never swept
CURTAIN_RAD = math.radians(1.5)  # from a window, where fixtures are its curtains (chosen)
FLAT = 0.75  # of the floor's distance, and of a fixture: what is that far, and so much of what is, is a rug (chosen)
BELOW_RAD, MOST_ENDS, STANDING_SR, FRAME_RAD = math.radians(2.5), 0.4, 0.15, math.radians(1.2)
"""Fixtures of at most that size stand on furniture that is so near below so much of their lower edge; the network sees
them by so much too small (chosen by looking at furnished real rooms)."""
CRUMB_SR, CRUMB_PX = 2e-3, 16
"""Of what stays on a wall that is removed all around: larger is a picture; pixels that this size misses (chosen)."""
LIT, CENTRED, SHADE_SR = 20.0, 0.15, 0.03
"""Of 8-bit sRGB, by which a lamp's shade outshines what is around; of its width, how far from its middle its pole is;
largest size (chosen by looking as those above)."""
HALL_RAD = math.radians(4)  # above a wall's foot, as far as the next room's floor is seen; less is this one's (chosen)
SURE = 0.8
"""Probability of furniture from which it is no sun on what is behind, though it has that colour (chosen on a validation
room: 3 % of its furniture in the sun are taken for sunlit floor, not 10; with 0.7 patches are missed)."""
HUNG, SURELY = 0.35, 3.0  # probability of fixtures, and times that of furniture, from which they are there (chosen)
STEP_PX, STEP_SHARE = 0.7, 0.45
"""Working pixels by which an enlarged mask is smoothed, and share from which it is one: lines stay (chosen)."""
BLOCKED = 0.5  # probability of doors, windows and fixtures from which a place is no bare floor or wall


@dataclass(frozen=True)
class Masks:
    """What is to be removed, (H, W) of the picture; ``target`` is all of it with a margin."""

    furniture: Flags
    """What stands on the floor, and what stands on that."""
    tripod: Flags
    """Tripod, painted-over nadir, meter board."""
    sunlight: Flags
    """Direct sunlight on floor and walls."""
    shadow: Flags
    """Of furniture, on floor and walls: of it only the contact with furniture is in the target, the rest is relit."""
    target: Flags
    notes: tuple[str, ...] = ()
    """What was skipped, dropped or not found, and why."""
    sun: tuple[float, float, float] | None = None
    """Azimuth, elevation (rad) and strength of the sun that the sunlight fits, as in `SunFound`."""
    shares: dict[str, float] = field(default_factory=dict)
    """Of the sphere, 0..1, by mask."""


def find_masks(
    image: LuminanceImage | RelativeImage,
    evidence: SceneEvidence,
    room: RoomModel,
    *,
    sun_direction: tuple[float, float] | None = None,
    sun_possible: bool = True,
    sun_seen: bool = False,
    meter_target: tuple[float, float] | None = None,
    margin_rad: float = MARGIN_RAD,
) -> Masks:
    """Return the masks of an upright, equirectangular panorama.

    ``evidence``: of any size.
    ``sun_direction``: azimuth (from +y towards +x) and elevation in rad; None: looked for.
    ``sun_possible``: False: no direct sun is looked for (an overcast sky, as the outdoor picture shows).
    ``sun_seen``: the outdoor picture shows the sun; without it, and without its direction, only unmistakable patches
      count.
    ``meter_target``: where the meter looked: longitude and latitude in rad in this picture; the board there goes with
      its stand.
    ``margin_rad``: by which the target reaches over what was found, 0 to 0.2.
    Raises `ParameterError`: another geometry, a picture below 16 rows, a margin out of range; `RoomError`: the room
    cannot stand.
    """
    geometry = _checked(image, evidence, margin_rad)
    rows = min(WORKING_ROWS, geometry.height_px)
    shape = (rows, round(rows * geometry.width_px / geometry.height_px))
    rgb = resized(np.asarray(image.rgb, np.float32), shape)
    if not (rgb > 0).any():
        return _nothing((geometry.height_px, geometry.width_px), "the picture is black: nothing can be found in it")
    maps = surface_maps(room, Equirectangular(shape[1], shape[0]))
    sun = sun_direction if sun_possible else None
    known = _Known(sun, sun_possible, sun_seen, meter_target, evidence.networks > 1)
    reach_m = None if evidence.reach is None else resized(evidence.reach, shape) * np.float32(room.camera_height_m)
    seen = resized(np.ascontiguousarray(evidence.probabilities.transpose(1, 2, 0)), shape)
    boards = np.zeros(shape, bool) if evidence.skirting is None else resized(evidence.skirting, shape) > SEEN_SHARE
    found = _find(rgb, np.ascontiguousarray(seen.transpose(2, 0, 1)), room, maps, known, (reach_m, boards))
    return _united(found, image, geometry, margin_rad)


@dataclass(frozen=True)
class _Known:
    """What the session says of this picture."""

    sun: tuple[float, float] | None
    sun_possible: bool
    sun_seen: bool
    meter_target: tuple[float, float] | None
    two_networks: bool

    @property
    def hung(self) -> float:
        """Return the least probability of fixtures."""
        return HUNG if self.two_networks else BLOCKED


@dataclass(frozen=True)
class _Found:
    furniture: FurnitureFound
    tripod: TripodFound
    sunlight: SunFound
    shadow: ShadowFound
    openings: Flags
    hangs: Flags
    """What hangs on plain walls by itself, and stays."""
    notes: tuple[str, ...]


def _find(
    rgb: Floats, chances: Floats, room: RoomModel, maps: SurfaceMaps, known: _Known, seen: tuple[Floats | None, Flags]
) -> _Found:
    """Find all masks; ``seen``: the distances (m) of what is seen, if known, and where skirting is, (H, W) each."""
    shown, geometry, luminance = preview_rgb8(rgb), Equirectangular(rgb.shape[1], rgb.shape[0]), luminance_cd_m2(rgb)
    meter, doors = _board(rgb, known.meter_target, room, maps), _openings(room, maps, OpeningKind.DOOR)
    tripod = replace(alone := find_tripod(chances, shown, maps.plane == FLOOR), mask=alone.mask | meter[0])
    furniture = pieces.find_furniture(chances, maps, shown, doors=doors, whole=known.two_networks, reach_m=seen[0])
    furniture = _without(furniture, pieces.beyond(furniture.mask, _openings(room, maps, OpeningKind.PASSAGE)))
    others = chances[[SceneClass.WINDOW, SceneClass.DOOR]].sum(axis=0) > BLOCKED
    fixtures = chances[SceneClass.FIXTURE] > np.clip(SURELY * chances[SceneClass.FURNITURE], known.hung, BLOCKED)
    fitted = known.two_networks & pieces.fitted_below_windows(furniture.mask, chances[SceneClass.FURNITURE], maps)
    hall = _next_floor(chances, maps, shown) | fitted
    likely = others | (known.two_networks & pieces.doors_in(chances, maps))
    panes, likely = (pieces.mostly_seen(ones, furniture.mask) for ones in (maps.opening >= 0, likely))
    openings = panes | likely | hall | (furniture.stays & ~furniture.mask)
    flat = (maps.plane == FLOOR) & (seen[0] is not None and seen[0] > FLAT * maps.depth_m)
    things = fixtures * chances[SceneClass.FIXTURE], chances[[SceneClass.FURNITURE, SceneClass.FIXTURE]].sum(axis=0)
    furniture, barred = _with_things(furniture, shown, maps, openings, things, flat)
    furniture, boards = _beside_boards(furniture, seen[1], openings)
    sunlight = _sun(rgb, luminance, room, maps, known, (furniture.mask, tripod.mask, chances), others | fixtures)
    hung = known.two_networks & _hung(fixtures & ~furniture.mask, chances, shown)
    furniture = _without(furniture, sunlight.mask | meter[0] | hall | hung)
    hidden, other = furniture.mask | tripod.mask, tripod.mask | sunlight.mask | openings | fixtures
    shadow = find_shadows(luminance, room, geometry, furniture.mask, other & ~furniture.mask)
    plain, hangs = find_plain_shade(rgb, room, geometry, hidden, other & ~hidden)
    slivers = hangs & ~(fixtures | grown(~grown(hidden | plain | shadow.contact, SLIT_RAD), SLIT_RAD))  # of what goes
    hangs |= (boards | grown(openings, pieces.SILL_RAD)) & ~grown(furniture.mask, 2 * MARGIN_RAD)  # else crumbs stay
    hangs |= pieces.completed(fixtures & ~hidden, chances[SceneClass.FIXTURE], shown)
    hangs &= ~(torn := boards_between(boards, furniture.mask | plain) & ~openings)
    stays = hangs | tripod.mask | sunlight.mask | (seen[0] is not None and seen[0] > BEYOND * maps.depth_m)
    kept = barred | stays | grown(fixtures & ~hidden, 1.5 * pieces.TOUCH_RAD)  # a curtain's edge is no thing
    plain |= _rests(furniture.mask, (shadow.contact & ~hangs) | plain, torn, shown, maps, kept)
    gone, bar = furniture.mask | plain | (shadow.contact & ~hangs), stays | openings | fixtures
    rests = whole_boards(rests_beside(gone, chances, luminance, maps, bar), gone, seen[1], shown) & ~bar
    rests |= torn_glare(gone | rests, rgb, (maps.plane == FLOOR) & ~(gone | rests | bar))
    no_wall = boards | (other & ~fitted) | grown(openings & ~fitted, 2 * pieces.SILL_RAD)
    rests |= crumbs_on_walls(gone | rests, rgb, maps, no_wall, fitted)
    rests |= pieces.halves_on_walls(gone | rests, shown, no_wall | (maps.plane < FIRST_WALL))
    rests |= (grown(rests, MARGIN_RAD) & ~bar) | (grown(rests, 2 * MARGIN_RAD) & fitted) | (slivers & ~no_wall)
    plain, hangs = plain | rests, hangs & ~rests
    shadow = replace(shadow, mask=(shadow.mask & ~hangs) | plain, contact=(shadow.contact & ~hangs) | plain)
    return _Found(furniture, tripod, sunlight, shadow, panes, hangs, _notes(furniture, tripod, sunlight, shadow, meter))


def _hung(fixtures: Flags, chances: Floats, shown: Bytes) -> Flags:
    """Return ``fixtures`` (H, W) with what has one colour with them and is hardly furniture: a mirror's frame."""
    found = pieces.completed(fixtures, chances[SceneClass.FIXTURE], shown)
    return np.asarray(found & (chances[SceneClass.FURNITURE] < pieces.MOST_FURNITURE))


def _next_floor(chances: Floats, maps: SurfaceMaps, shown: Bytes) -> Flags:
    """Return where (H, W) the next room's floor is seen, as far as it is likelier than furniture there."""
    floor = chances[SceneClass.FLOOR] * (maps.plane >= FIRST_WALL)
    found = pieces.completed(floor > BLOCKED, floor * (floor > chances[SceneClass.FURNITURE]), shown)
    return np.asarray(found & (found.sum(axis=0) * math.pi / len(found) > HALL_RAD))


def _sun(
    rgb: Floats,
    light: Floats,
    room: RoomModel,
    maps: SurfaceMaps,
    known: _Known,
    gone: tuple[Flags, Flags, Floats],
    bar: Flags,
) -> SunFound:
    """Return direct sunlight; ``gone``: furniture, tripod, and the probabilities (8, H, W); ``bar``: doors, windows,
    fixtures, (H, W) each."""
    if not known.sun_possible:
        return SunFound(np.zeros(bar.shape, bool), None, "the sky has no sun")
    furniture, tripod, chances = gone
    hidden, surface = furniture | tripod, (maps.opening < 0) & (maps.plane != CEILING)
    bare = surface & ~grown(hidden, math.pi / rgb.shape[0])
    # The network takes patches of sun for furniture: what has the colour of the surface behind it may be one, unless
    # it is sure of it in a room where it knows sun on the floor.
    floor = bare & (maps.plane == FLOOR)
    known_sun = floor.any() and (light[floor] > SURE_RATIO * np.median(light[floor])).sum() > LEAST_PX
    sure = known_sun & (chances[SceneClass.FURNITURE] > SURE)
    unsure = surface & furniture & ~tripod & ~sure
    bare |= coloured_as_behind(rgb, maps.plane, unsure, hidden | (maps.opening >= 0))
    if known.sun is None:
        bare &= ~bar
    d, _ = directions(Equirectangular(rgb.shape[1], rgb.shape[0]))
    points = d * maps.depth_m[..., None] + np.array([0.0, 0.0, room.camera_height_m])
    weight = np.broadcast_to(row_solid_angles((rgb.shape[0], rgb.shape[1])), light.shape)
    return find_sunlight(light, points, maps.plane, bare, weight, room, known.sun, known.sun_seen)


def _rests(furniture: Flags, contact: Flags, torn: Flags, shown: Bytes, maps: SurfaceMaps, stays: Flags) -> Flags:
    """Return the ``torn`` boards (H, W), and what touches these, furniture, or the shade that goes with it: the tip of
    a lamp or of a cage, a bracket, would hang in the air."""
    goes = grown(furniture, MARGIN_RAD) | contact | torn
    rests = torn | (with_things(goes, shown, maps.plane == FLOOR, stays) & ~goes)
    return np.asarray(grown(rests, MARGIN_RAD) & ~stays, bool)


def _beside_boards(found: FurnitureFound, boards: Flags, openings: Flags) -> tuple[FurnitureFound, Flags]:
    """Return furniture without the ``boards`` of skirting (H, W), but with torn ones; and the boards that stay."""
    torn = torn_boards(boards, found.mask & ~boards, BELOW_RAD) & ~openings
    stays = boards & ~torn
    return _with(_without(found, stays), torn), stays


def _without(found: FurnitureFound, stays: Flags) -> FurnitureFound:
    """Return furniture without what ``stays`` (H, W)."""
    return replace(found, mask=found.mask & ~stays, probability=np.where(stays, np.float32(0), found.probability))


def _with(found: FurnitureFound, goes: Flags) -> FurnitureFound:
    """Return furniture with what ``goes`` too (H, W)."""
    return replace(found, mask=found.mask | goes, probability=np.where(goes, np.float32(1), found.probability))


def _with_things(
    found: FurnitureFound, shown: Bytes, maps: SurfaceMaps, openings: Flags, things: tuple[Floats, Floats], flat: Flags
) -> tuple[FurnitureFound, Flags]:
    """Return furniture with what stands on it and whole rugs below, and what stays: curtains are a window's, pictures a
    wall's.

    ``things``: the probability of fixtures, 0 where none are (up to `BLOCKED` they stay), and of things, (H, W) each.
    ``flat`` (H, W): where the floor, or what lies flat on it, is seen by the network's distances."""
    count, labels = components(things[0] > 0)
    numbers, beside = np.arange(count + 1), grown(openings, CURTAIN_RAD)
    parts = grown(found.mask, pieces.TOUCH_RAD), things[0] > BLOCKED, beside
    touches, sure, curtains = (np.isin(numbers, np.unique(labels[part])) for part in parts)
    lies = np.bincount(labels.ravel(), flat.ravel()) > FLAT * np.bincount(labels.ravel())
    size = summed(labels, 1)[0]
    # What hangs on a wall stays, unless it is small and touches furniture itself (a framed photograph on a chest).
    stays = ~(touches & sure & ((size < STANDING_SR) | lies))
    rugs = (~stays & lies)[labels] & (labels > 0)
    free = sure & ~curtains & (numbers > 0)
    mask, goes = found.mask, found.mask
    for most_sr, likely in ((STANDING_SR, things[1]), (0.0, None)):
        # What stands on furniture, such as a picture on a chest, goes whole with it; a shade, with the pole found next.
        near, ends = pieces.lower_ends(labels, below := grown(mask, BELOW_RAD), count)
        stands = free & (near > MOST_ENDS * ends) & (size < most_sr)
        stands |= free & (size < SHADE_SR) & _lit_over(labels, below, shown)
        stays = (stays | ~free) & ~stands
        stays[0] = False
        barred = beside | stays[labels] | (maps.plane == CEILING)
        goes = goes | grown(stands[labels] & ~rugs & ~mask, FRAME_RAD)
        mask = mask | with_things(goes, shown, maps.plane == FLOOR, barred, likely)
        goes = np.zeros_like(mask)
    mask |= pieces.halved(mask, things[1], shown) & ~beside
    return _with(found, (mask | (rugs & ~beside)) & ~found.mask), barred


def _lit_over(labels: Int32s, below: Flags, shown: Bytes) -> Flags:
    """Return which of the components (H, W) are lit shades: brighter than what is around, with the middle over what
    ends ``below`` (H, W) them, a pole or their own rim; ``shown`` (H, W, 3): sRGB."""
    found, level = np.zeros(labels.max() + 1, bool), shown.mean(axis=-1)
    for label in np.unique(labels[below & (labels > 0)]):
        part = labels == label
        feet, around = (part & below).any(axis=0)[part.any(axis=0)], grown(part, 3 * FRAME_RAD) & ~part
        centred = abs(float(np.flatnonzero(feet).mean()) / len(feet) - 0.5) < CENTRED
        found[label] = centred and level[part].mean() > np.median(level[around]) + LIT
    return found


def _board(rgb: Floats, target: tuple[float, float] | None, room: RoomModel, maps: SurfaceMaps) -> tuple[Flags, bool]:
    """Return board and stand, and whether there is a stand; a pane that the meter looked at is no board."""
    none = np.zeros(maps.plane.shape, bool)
    if target is None:
        return none, False
    red, _, blue = np.moveaxis(np.maximum(rgb, 1e-6), -1, 0)
    board, stand = meter_board(luminance_cd_m2(rgb), target, np.log2(blue / red).astype(np.float32))
    panes = _openings(room, maps, OpeningKind.WINDOW)
    return (none, False) if (board & panes).sum() > 0.5 * board.sum() else (board, stand)


def _openings(room: RoomModel, maps: SurfaceMaps, kind: OpeningKind) -> Flags:
    """Return where (H, W) the room has openings of a kind."""
    return np.isin(maps.opening, [k for k, one in enumerate(room.openings) if one.kind is kind])


def _notes(
    furniture: FurnitureFound, tripod: TripodFound, sun: SunFound, shadow: ShadowFound, meter: tuple[Flags, bool]
) -> tuple[str, ...]:
    share, stand = furniture.dropped_sr / (4 * math.pi), "with its" if meter[1] else "without a"
    lost = f"furniture: {furniture.dropped} parts ({share:.1%} of the sphere) do not reach the floor and were dropped"
    disc = f"tripod: the nadir is painted over, {math.degrees(tripod.disc_rad):.0f} degrees around it"
    bands = f"shadow: {shadow.planes_without_fit} surfaces show too little around furniture: contact bands"
    every = (
        (furniture.dropped, lost),
        (not furniture.mask.any(), "furniture: none found"),
        (tripod.disc_rad, disc),
        (not (tripod.disc_rad or tripod.at_nadir), "tripod: none found at the nadir"),
        (tripod.boards, f"tripod: {tripod.boards} parts of equipment away from the nadir"),
        (True, f"sunlight: {sun.reason}"),
        (shadow.planes_without_fit, bands),
        (meter[0].any(), f"tripod: the meter's board where the meter looked, {stand} stand"),
    )
    return tuple(text for said, text in every if said)


def _united(found: _Found, image: LuminanceImage | RelativeImage, sphere: Equirectangular, margin_rad: float) -> Masks:
    shape = (sphere.height_px, sphere.width_px)
    soft = found.furniture.probability * grown(found.furniture.mask, math.radians(0.5))
    if shape[0] > soft.shape[0]:
        furniture = at_full_size(soft, preview_rgb8(image.rgb)) > 0.5
    else:
        furniture = found.furniture.mask
    tripod, sunlight, shadow, contact = (
        _at(mask, shape) for mask in (found.tripod.mask, found.sunlight.mask, found.shadow.mask, found.shadow.contact)
    )
    sunlight &= ~furniture & ~tripod
    shadow &= ~furniture & ~tripod
    target = target_of((furniture | tripod, contact), sunlight, found.openings, margin_rad)
    target &= furniture | tripod | sunlight | ~_at(found.hangs, shape)
    target = with_islands(target, found.openings, CRUMB_SR)
    labels = components(~target)[1]
    target |= (np.bincount(labels.ravel()) <= CRUMB_PX * max(1.0, shape[0] / len(found.openings)) ** 2)[labels]
    named = {"furniture": furniture, "tripod": tripod, "sunlight": sunlight, "shadow": shadow, "target": target}
    shares = {name: share_of_sphere(mask) for name, mask in named.items()}
    return Masks(**named, notes=found.notes, sun=found.sunlight.sun, shares=shares)


def _at(mask: Flags, shape: tuple[int, int]) -> Flags:
    """Return a mask at another size, without the steps of its pixels if larger; an empty one without work."""
    if not mask.any():
        return np.zeros(shape, bool)
    larger = shape[0] > len(mask)
    soft = smoothed(mask.astype(np.float32), STEP_PX * math.pi / len(mask) if larger else 0.0)
    return resized(soft, shape) > (STEP_SHARE if larger else 0.5)


def target_of(things: tuple[Flags, Flags], sunlight: Flags, openings: Flags, margin_rad: float) -> Flags:
    """Return what is to be removed (H, W): things with a margin, their contact shadow, what both enclose, and sunlight.

    ``things``: they themselves, and their contact shadow, which is a margin already, (H, W) each.
    What lies within a patch of sunlight is no island: it may be kept with the patch (--keep-sunlight).
    """
    return with_islands(grown(things[0], margin_rad) | things[1], openings) | grown(sunlight, margin_rad)


def with_islands(target: Flags, openings: Flags, most_sr: float = pieces.ISLAND_SR) -> Flags:
    """Return a target (H, W) with the small parts that it goes all round, but for windows and doors (h, w)."""
    islands = pieces.islands_in(_at(target, (len(openings), openings.shape[1])), openings, most_sr)
    # One pixel more, as the edge of the smaller mask is that coarse.
    return target | _at(grown(islands, math.pi / len(islands)), (len(target), target.shape[1]))


def _nothing(shape: tuple[int, int], why: str) -> Masks:
    none = {name: np.zeros(shape, bool) for name in ("furniture", "tripod", "sunlight", "shadow", "target")}
    return Masks(**none, notes=(why,), sun=None, shares=dict.fromkeys(none, 0.0))


def _checked(image: LuminanceImage | RelativeImage, evidence: SceneEvidence, margin_rad: float) -> Equirectangular:
    geometry = image.geometry
    if not isinstance(geometry, Equirectangular) or geometry.height_px < LEAST_ROWS or geometry.yaw_rad:
        text = f"masks are found on whole panoramas of at least {LEAST_ROWS} rows, longitude 0 in the middle"
        raise ParameterError(text, where=str(geometry))
    if not 0 <= margin_rad <= 0.2:
        raise ParameterError(f"a margin of {margin_rad} rad", advice="give 0 to 0.2 (11 degrees)")
    p = evidence.probabilities
    if p.ndim != 3 or len(p) != len(SceneClass) or not np.isfinite(p).all():
        raise ParameterError(f"evidence of shape {p.shape}", advice="give (8, H, W) of finite probabilities")
    return geometry
