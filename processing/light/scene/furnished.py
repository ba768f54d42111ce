"""The light in a room with its old furniture and without it: what removal has to change besides texture.

Furniture takes light from the whole room, not only from where it stands. Stand-ins of it (`standins`) are put into the
room as the picture shows it; what each surface gives off is read off the furnished picture, so that its reflectance
follows from the light that falls on it among the furniture. The same rays then give the light with and without the
stand-ins, and their ratio is how much brighter each place is in the empty room (differential rendering, Debevec 1998,
with the photograph as its own light probe).
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Int16s, Vector
from processing.ground.room_model import OpeningKind, RoomModel
from processing.ground.seam import resized, smoothed
from processing.ground.threads import side_by_side
from processing.light.scene import sources
from processing.light.scene.albedo import DARK, brought_to, everywhere, lit_stage
from processing.light.scene.room_light import LEAST_SHARE, measured_light
from processing.light.scene.scene import REVEAL_M, Outdoors, Part, Scene, Sun
from processing.light.solver.irradiance import Effort, cleaned, evened, gathered
from processing.light.solver.sight import FIRST_PART, GLASS, Sight, sight_of
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of, sunlight
from processing.light.solver.transport import BrightPatches, LightMap, bounced, light_map, links_of, patch_points
from processing.light.solver.upsample import upsampled
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage
from processing.sphere import Equirectangular
from processing.surfaces.maps import FLOOR, SurfaceMaps, surface_maps

ROUNDS = 6  # of reading albedo from light and light from albedo; hidden patches change, and settle in four (chosen)
HOLDS = 0.25  # of a reduced pixel, from which it counts as part of a mask; chosen
DARK_SHARE = 0.002  # of the median irradiance, below which a patch shows none; chosen
MOST_RATIO = 3.0  # by which a place may be brighter or darker without the furniture; chosen: under a table it is 2 to 4
MISFIT = -7  # label of pixels in which mask and stand-ins disagree: nobody knows which of both they show
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS, np.float32)
SAME_PLACE = 0.02  # of a place's distance and in metres: nearer to each other, both rooms show the same place
GUARD_RAD = 0.02  # over which reflectance is compared; chosen: contact shadows are wider, patterns finer
FAR_RATIO = 0.1  # of a plane's own ratio, within which a place counts as far from furniture; chosen
LEAST_FAR = 50  # pixels, fewer of which say nothing of a plane's reflectance
LEAST_LOCAL = 0.03  # natural logarithm: a local change below it is hardly weighed; chosen, 3 % is not seen
GUARD_WIDE = 4.0  # times as far, over which shares are brought together (chosen: 1 and 2 leave lines on plain walls)
SHINES = 3.0  # times what furniture shows in the median, from which it is in the sun; chosen
PRIOR, FLOOR_TIMES, SPREAD, DOUBT = 0.2, 2.0, 0.15, (0.05, 0.12)
"""Log change of a room's walls and ceiling, were as much furniture's surface as all others, as the root of its share;
times that, of its floor; by how much rooms differ from it, and what is found on a plane from the truth, with a picture
of the sky and without, where no sun falls on furniture (docs/measurements/emptying.md)."""
GROSS, GROSS_SPREAD = 0.1, 0.5  # of rooms, whose change is found so far from the truth besides; chosen, as DOUBT
SUNLIT, LEAST_DUE_M2, USUAL_SUN = 0.1, 0.1, 0.6
"""Of the full sun, from which a patch is in it; area facing the sun of such patches in sight, from which they are asked
how much falls in, and how much does else. Chosen on six rooms: docs/measurements/emptying.md."""


@dataclass(frozen=True)
class FurnishedLight:
    """Irradiance (lx) and radiance of the room's own surfaces, by a panorama's pixels (H, W)."""

    without_lx: Floats
    """(H, W, 3): in the empty room, without direct sun; 0 on glass."""
    log_change: Floats
    """(H, W, 3): natural logarithm of what the furniture's removal changes radiance by, guarded; 0 where unknown."""
    seen: Flags
    """(H, W): pixels that show the room's own surface, and its light among the furniture is known."""
    standin_m: Floats
    """(H, W): distance from the camera to the stand-in that a pixel sees; 0 where it sees none."""
    returned: Flags
    """(H, W): seen places from which the furniture keeps the sun away."""
    scene: Scene
    """The bare room, its windows as they were measured with the furniture in it, under as much sun as it shows."""
    parts: tuple[Part, ...]
    notes: tuple[str, ...]
    plane: Int16s
    """(H, W): of the room, that a pixel shows."""
    prior: float
    """Natural logarithm of what so much furniture changes a room's walls and ceiling by."""
    doubt: float
    """Standard uncertainty of each plane's log change."""

    def believed(self, again: Self | None = None) -> Self:
        """Return the light as it is believed: nearer to what furniture takes from rooms, the less was certain here.

        ``again``: another estimate, of any size: what was found is the mean of both, and as uncertain as they differ.
        """
        moved, trust = _moved(self, again)
        change = self.log_change + np.where(self.seen[..., None], moved, 0)
        said = f"change of light: {100 * trust:.0f} % as found, the rest as in rooms with so much furniture"
        notes, without_lx, doubt = (*self.notes, said), self.without_lx * np.exp(moved), SPREAD * math.sqrt(1 - trust)
        return replace(self, log_change=change, without_lx=without_lx, notes=notes, doubt=doubt)


class OldFurniture(NamedTuple):
    """What stands in the room and is to go."""

    mask: Flags
    """(H, W), of the panorama."""
    target: Flags
    """(H, W): all that is to be removed and shows no light of the room: furniture, shadows, equipment."""
    parts: tuple[Part, ...]
    """Stand-ins for it, in the world."""


def furnished_light(
    panorama: LuminanceImage,
    room: RoomModel,
    outdoors: Outdoors | None,
    old: OldFurniture,
    *,
    rows: int = 256,
    effort: Effort,
    seed: int = 0,
    known_sun: tuple[Vector, float] | None = None,
) -> FurnishedLight:
    """Return the light in a room with and without what stands in it.

    ``panorama``: the furnished room, upright, equirectangular, in cd/m2.
    ``outdoors``: the light outside at the same moment; None: windows as they look, scaled by the light they cast.
    ``rows``: height of the pictures returned.
    ``known_sun``: where ``outdoors`` is not known, the unit vector towards it, and how many times the light in the
      shade it adds on what faces it: the room gets what the furniture keeps from it.
    Raises `AlbedoError`: a picture without light, or of no whole panorama; `RoomError`: the room cannot stand.
    """
    rgb, valid = brought_to(panorama, rows, old.target & ~old.mask)
    mask, gone = (resized(one.astype(np.float32), (rows, 2 * rows)) > HOLDS for one in (old.mask, old.target))
    full, _, notes = lit_stage(room, outdoors, rgb, valid & ~mask, REVEAL_M, effort.texel_m, old.parts)
    eye = (0.0, 0.0, room.camera_height_m)
    geometry = Equirectangular(2 * rows, rows)
    bare = Stage.of(replace(full.scene, parts=()), effort.texel_m)
    everything = sight_of(full, geometry, eye)
    standin_m = np.where(everything.label >= FIRST_PART, everything.distance_m, 0).astype(np.float32)
    shown = _shown(full, rgb, everything, _consistent(everything, mask, gone), eye, seed)
    if outdoors is None and (everything.label == GLASS).any():
        full, strength = sources.brightened(full, shown.given, shown.known, effort.patch_samples, seed)
        bare, notes = bare.under(full.scene.outdoors, full.scene.panes), (*notes, strength)
    full, bare, measured = _measured(full, bare, shown, effort, seed)
    if known_sun is not None:
        full, bare = _with_sun_back(full, bare, shown, known_sun, effort.patch_samples, seed)
        measured += (f"sun: {known_sun[1]:.0f} times the light in the shade, by its patches in the room",)
    both = _both_lights(full, bare, shown, room, rows, effort, seed)
    large = sight_of(bare, geometry, eye)
    own = large.solid & both.known & ~gone.ravel()
    sun = sources.sunlit_pixels(bare, large, rgb, both.with_lx, own)
    hidden = [sun_of(stage, large, effort.sun_samples, seed) @ WEIGHTS for stage in (full, bare)]
    returned = own & (hidden[0] < hidden[1] / 2) & ~sun.any(axis=1)
    shape = (rows, 2 * rows, 3)
    maps = surface_maps(room, geometry)
    windows = [i for i, opening in enumerate(room.openings) if opening.kind is OpeningKind.WINDOW]
    seen = (own & valid.ravel()).reshape(shape[:2]) & ~np.isin(maps.opening, windows)  # doors are part of their wall
    with_lx, without_lx, sun = (one.reshape(shape) for one in (both.with_lx, both.without_lx, sun))
    among: Floats = evened(with_lx, without_lx, large, seen) + sun
    whole: Floats = without_lx + sun
    level = np.log(_ratio(among @ WEIGHTS, whole @ WEIGHTS))
    # A photograph without an outdoor picture has a tone of its own: its light changes, its colours stay.
    change = np.log(_ratio(among, whole)) if outdoors is not None else level[..., None]
    change = guarded(change, level, (rgb @ WEIGHTS, whole @ WEIGHTS), seen, maps)
    log_change = np.broadcast_to(np.where(seen[..., None], change, 0), shape).astype(np.float32)
    standin, back = standin_m.reshape(shape[:2]), returned.reshape(shape[:2]) & seen
    notes, beside = (*notes, f"{len(old.parts)} stand-ins", *measured), _known_beside(full, bare, shown)
    kept = (bare.scene, old.parts, notes, maps.plane)
    return FurnishedLight(without_lx, log_change, seen, standin, back, *kept, *beside)


def _consistent(sight: Sight, furniture: Flags, target: Flags) -> Sight:
    """Return what pixels see, `MISFIT` where a stand-in is not furniture by the mask, or something else is to go."""
    standin = sight.label >= FIRST_PART
    fits = np.where(standin, furniture.ravel(), ~furniture.ravel() & ~target.ravel())
    return replace(sight, label=np.where(fits | ~sight.solid, sight.label, MISFIT).astype(np.int32))


class _Shown(NamedTuple):
    """What the furnished picture shows of patches (P)."""

    given: Doubles
    """(P, 3): radiosity, lm/m2, whatever stands where."""
    seen: Flags
    reflects: Doubles
    """(P, 3): radiosity of pixels in which mask and stand-ins agree."""
    known: Flags


def _shown(full: Stage, rgb: Floats, everything: Sight, consistent: Sight, eye: Vector, seed: int) -> _Shown:
    """Return what patches give off. Light counts wherever it comes from; for albedo, only what is there for sure."""
    every, sure = (measured_light(full, rgb, sight, eye, (seed, 70)) for sight in (everything, consistent))
    known = (sure.seen >= LEAST_SHARE) & (sure.radiance @ WEIGHTS > 0)
    seen = (every.seen >= LEAST_SHARE) & (every.radiance @ WEIGHTS > 0)
    return _Shown(math.pi * every.radiance, seen, math.pi * sure.radiance, known)


def _measured(
    full: Stage, bare: Stage, shown: _Shown, effort: Effort, seed: int
) -> tuple[Stage, Stage, tuple[str, ...]]:
    """Return both rooms with the albedo, lamps and sun that the furnished picture shows, and notes on them."""
    samples, normals, area = effort.patch_samples, full.patches.normal, full.patches.area_m2
    few = max(1, samples // 4)
    points = patch_points(full, samples, (seed, 71))
    links = links_of(full, points, normals, samples, (seed, 72))
    sky = skylight(full, patch_points(full, few, (seed, 73)), normals, few, (seed, 74))
    sun = sunlight(full, patch_points(full, few, (seed, 75)), normals, few, (seed, 76))
    shell = np.arange(full.patches.count) < bare.patches.count
    zone = sources.places_near_sun(full, points[:, 0], normals) | (sun @ WEIGHTS > 0)
    albedo, share = np.full(sky.shape, 0.5), 1.0
    exitance, level = np.zeros(sky.shape), sky + share * sun + shown.given[shell].mean(axis=0)
    for _ in range(ROUNDS):
        # What is seen is taken as it is given; only what is hidden gives what it would reflect.
        radiosity = np.where(shown.seen[:, None], shown.given, albedo * level)
        shade = sky + bounced(full, links, radiosity, None, (points, normals), 1, (seed, 77))[0]
        level = shade + share * sun
        apparent = shown.reflects / np.maximum(shade, 1e-9)
        known = shown.known & ~zone & (shade @ WEIGHTS > DARK_SHARE * float(np.median(shade @ WEIGHTS)))
        usual = np.median(apparent[known & shell], axis=0) if (known & shell).any() else np.full(3, 0.5)
        shines = known & (apparent @ WEIGHTS > sources.LAMP_TIMES)
        albedo, shines = everywhere(full, apparent, known & ~shines), shines & shell
        exitance = np.where(shines[:, None], np.maximum(shown.reflects - usual * level, 0), 0)
        # As much sun as the picture shows, on whatever: what holds it back besides furniture (trees, slats, sashes) no
        # model knows; nor by how much its windows are too small.
        over, matte, due = (one @ WEIGHTS * area for one in (shown.given, albedo * shade, albedo * sun))
        share = sources.sun_strength(
            full.scene.outdoors.sun, *(np.where(shown.seen & zone, v, 0) for v in (over, matte, due))
        )
    count = bare.patches.count
    outdoors = sources.under_share(full.scene.outdoors, share)
    among = replace(full, albedo=albedo, exitance=exitance).under(outdoors, full.scene.panes)
    without = replace(bare, albedo=albedo[:count], exitance=exitance[:count]).under(outdoors, bare.scene.panes)
    return among, without, (f"{int(shines.sum())} patches of lamps", *sources.sun_note(full.scene.outdoors.sun, share))


def _with_sun_back(
    full: Stage, bare: Stage, shown: _Shown, sun: tuple[Vector, float], samples: int, seed: int
) -> tuple[Stage, Stage]:
    """Return both rooms with what the picture does not show of the sun: the bare one's own patches give back what falls
    on them without furniture alone, and among it do sides of the furniture that the camera does not see."""
    lit, outdoors = list[Doubles](), Outdoors(DARK, Sun(sun[0], (1.0, 1.0, 1.0)))
    for stage in (full, bare):
        clear = tuple(replace(pane, clear=np.ones_like(pane.clear)) for pane in stage.scene.panes)
        points, normals = patch_points(stage, samples, (seed, 78)), stage.patches.normal
        lit.append(sunlight(stage.under(outdoors, clear), points, normals, samples, (seed, 79)))
    count, (given, albedo, among) = len(lit[1]), (one @ WEIGHTS for one in (shown.given, full.albedo, lit[0]))
    floor = np.flatnonzero(shown.known[: math.prod(full.patches.grids[0][:2])])
    shade_lx = np.median(given[floor] / albedo[floor]) if len(floor) else 0.0
    # Windows and stand-ins are estimates, curtains and trees are not known: as much of the sun falls in as shines of
    # what they put in it.
    usual, shaded = albedo * max(shade_lx, 1e-9), count + np.flatnonzero(shown.seen[count:] & (among[count:] == 0))
    usual[count:] = np.median(given[shaded]) if len(shaded) else usual[count:]
    due, flux = shown.seen & (among > SUNLIT), full.patches.area_m2 * among
    for (columns, rows, first), surface in zip(full.patches.grids, full.scene.surfaces, strict=True):
        due[first : first + columns * rows] &= surface.plane >= 0  # reveals shine anyhow
    over = np.where(given > SHINES * usual, given / usual - 1, 0)[due]
    share = flux[due] @ np.minimum(over / (sun[1] * among[due]), 1) / max(flux[due].sum(), 1e-9)
    strength = (share if flux[due].sum() > LEAST_DUE_M2 else USUAL_SUN) * sun[1] * shade_lx
    hidden, back = np.where(shown.seen[:, None], 0, lit[0]), np.maximum(lit[1] - lit[0][:count], 0)
    hidden[:count] = 0
    full = replace(full, exitance=full.exitance + full.albedo * hidden * strength)
    return full, replace(bare, exitance=bare.exitance + bare.albedo * back * strength)


class _Both(NamedTuple):
    """Irradiance (N, 3), lx, of the room's own surfaces without the sun's disc."""

    with_lx: Floats
    without_lx: Floats
    known: Flags
    """(N,): pixels of which the light among the furniture is known."""


def _as_shown(full: Stage, bare: Stage, shown: _Shown, samples: int, seed: int) -> tuple[LightMap, LightMap]:
    """Return the light of both rooms, of which seen patches give what the picture shows.

    Without furniture a seen patch gives as many times more as the scenes say; the sun falls anew."""
    among, without = side_by_side(lambda stage: light_map(stage, samples, seed), (full, bare))
    model = full.albedo * among.rest
    smooth = np.minimum(shown.given, sources.LAMP_TIMES * model)
    gain = np.clip(smooth / np.maximum(model, 1e-9), 1 / MOST_RATIO, MOST_RATIO)
    usual = np.median(gain[shown.seen], axis=0) if shown.seen.any() else np.ones(3)
    gain = np.where(shown.seen[:, None], gain, usual)
    own = full.exitance + full.albedo * among.sun
    glow = np.where(shown.seen[:, None], np.maximum(shown.given - gain * model, 0), own)
    lit, count = replace(among, rest=gain * among.rest, bright=BrightPatches.of(full, glow)), bare.patches.count
    without = replace(without, rest=gain[:count] * without.rest)
    if full.scene.outdoors.sun is None:
        # No sun falls anew: what the room's own surfaces show beyond what they reflect, they show without it too.
        stays = np.where(shown.seen[:count, None], glow[:count] - full.exitance[:count], 0) + bare.exitance
        without = replace(without, bright=BrightPatches.of(bare, stays))
    return lit, without


def _both_lights(
    full: Stage, bare: Stage, shown: _Shown, room: RoomModel, rows: int, effort: Effort, seed: int
) -> _Both:
    """Gather both lights in a small picture by the same rays, and bring them to a height of ``rows``."""
    eye = (0.0, 0.0, room.camera_height_m)
    small_rows = min(effort.rows, rows)
    geometry = Equirectangular(2 * small_rows, small_rows)
    small, seen = sight_of(bare, geometry, eye), sight_of(full, geometry, eye)
    solid = np.flatnonzero(small.solid)
    lights = zip((full, bare), _as_shown(full, bare, shown, effort.patch_samples, seed), strict=True)

    def picture(lit: tuple[Stage, LightMap]) -> Floats:
        values = gathered(*lit, small.point[solid], small.normal[solid], effort.pixel_samples, seed)
        return small.picture(values, solid).reshape(-1, 3)

    with_lx, without_lx = side_by_side(picture, lights)
    own = small.solid & (seen.label == small.label)
    own &= np.abs(seen.distance_m - small.distance_m) < SAME_PLACE * (1 + small.distance_m)
    # For the denoiser, which knows no holes: behind furniture the light as it were with a middling shade.
    levels = np.maximum((with_lx @ WEIGHTS)[own], 1e-9) / np.maximum((without_lx @ WEIGHTS)[own], 1e-9)
    shade = float(np.median(levels)) if own.any() else 1.0
    whole = np.where(own[:, None], with_lx, without_lx * np.float32(shade))
    clean = [cleaned(one.reshape(*small.shape, 3), small, wraps=True) for one in (whole, without_lx)]
    large = sight_of(bare, Equirectangular(2 * rows, rows), eye)
    beside = replace(small, label=np.where(own, small.label, MISFIT).astype(np.int32))
    with_up, missed = upsampled(clean[0], beside, large, wraps=True)
    without_up, _ = upsampled(clean[1], small, large, wraps=True)
    return _Both(with_up, without_up, ~missed & (with_up @ WEIGHTS > 0))


def _ratio(with_lx: Floats, without_lx: Floats) -> Doubles:
    """Return how many times brighter places are without the furniture, within `MOST_RATIO`."""
    ratio = np.asarray(without_lx, np.float64) / np.maximum(with_lx, 1e-9)
    return np.asarray(np.clip(ratio, 1 / MOST_RATIO, MOST_RATIO))


def guarded(
    change: Doubles, log_ratio: Doubles, light: tuple[Floats, Floats], seen: Flags, maps: SurfaceMaps
) -> Doubles:
    """Return the log change (H, W, C) with its local part taken only as far as it makes reflectance even.

    Where stand-ins are wrong, the light among the furniture is wrong beside them, and would leave bright or dark ghosts
    there. Each plane keeps its own change; what a place differs from it by is multiplied by 0 to 1, whichever brings
    the place's reflectance nearest to that of the plane far from furniture. So no rug is bleached beyond what the light
    explains, and no colour is left of light that is not believed.

    ``log_ratio`` (H, W): of luminance, by which that is judged.
    ``light``: luminance of the furnished picture, cd/m2; illuminance in the empty room, lx, (H, W) each.
    ``seen`` (H, W) bool: pixels that count.
    ``maps``: of the room, of the same size.
    """
    luminance, without_lx = light
    shown = np.log(np.maximum(math.pi * luminance / np.maximum(without_lx, 1e-6), 1e-4))
    out = np.array(change, np.float64)
    for plane in np.unique(maps.plane[seen]):
        mine = (maps.plane == plane) & seen
        usual = float(np.median(log_ratio[mine]))
        local = log_ratio - usual
        far = mine & (np.abs(local) < FAR_RATIO)
        if far.sum() < LEAST_FAR:
            continue
        goal = float(np.median((shown + log_ratio)[far]))

        def around(values: Doubles, wide: float = 1, mine: Flags = mine) -> Doubles:
            both = np.stack([np.where(mine, values, 0), mine], axis=-1).astype(np.float32)
            total, count = cv2.split(smoothed(both, wide * GUARD_RAD))
            return np.asarray(total / np.maximum(count, 1e-6), np.float64)

        wanted, offered = goal - around(shown + usual), around(local)
        # The share that fits best about a place, and all of it where hardly anything is offered: no step anywhere.
        fits, much = (around(one * offered, GUARD_WIDE) + LEAST_LOCAL**2 for one in (wanted, offered))
        own, share = np.median(change[mine], axis=0), np.clip(fits / much, 0, 1)[mine, None]
        out[mine] = own + share * (change[mine] - own)
    return out


def _known_beside(full: Stage, bare: Stage, shown: _Shown) -> tuple[float, float]:
    """Return by what so much furniture changes rooms, and how uncertain this room's own change is, natural logarithms.

    What sunlit furniture gives off, and what the sun gives back without it, are the least certain."""
    count, area = bare.patches.count, full.patches.area_m2
    given, furniture = shown.given @ WEIGHTS, shown.seen & (np.arange(len(area)) >= count)
    sunlit = furniture & (given > SHINES * np.median(given[furniture])) if furniture.any() else furniture
    back = (area @ full.exitance + area[:count] @ (bare.exitance - 2 * full.exitance[:count])) @ WEIGHTS
    unsure = np.array([area[sunlit] @ given[sunlit], back]) / (area @ given)
    return PRIOR * math.sqrt(area[count:].sum() / area.sum()), math.hypot(
        DOUBT[full.scene.outdoors.rgb is DARK], *unsure
    )


def _moved(found: FurnishedLight, again: FurnishedLight | None) -> tuple[Floats, float]:
    """Return by what each plane's log change (H, W, C) moves towards that of rooms, and how far its own is trusted.

    It is the posterior's mean: both normally distributed, but for `GROSS` of rooms, whose model is of no use. Planes of
    which nothing is seen move as if they changed as all do."""
    seen, own = found.seen, found.log_change
    away, half, every = np.zeros_like(own), np.zeros_like(own), np.dstack([own, np.zeros_like(own[..., 0])])
    if again is not None:
        level, known = (resized(one.astype(np.float32), seen.shape) for one in (again.log_change.mean(-1), again.seen))
        every[..., 3] = np.where(known > 0.5, level / np.maximum(known, 0.5) - own.mean(axis=-1), 0) / 2
    for plane in np.unique(found.plane) if seen.any() else ():
        mine = found.plane == plane
        usual = np.median(every[mine & seen if (mine & seen).any() else seen], axis=0)
        half[mine] = usual[3]
        away[mine] = found.prior * (FLOOR_TIMES if plane == FLOOR else 1) - usual[:3] - usual[3]
    off, differs = (float(np.median(one[seen])) if seen.any() else 0.0 for one in (away, half))
    wide = math.hypot(SPREAD, found.doubt, differs)
    cases = ((1 - GROSS, wide), (GROSS, math.hypot(wide, GROSS_SPREAD)))
    good, bad = (share / width * math.exp(-0.5 * (off / width) ** 2) for share, width in cases)
    trust = (SPREAD / wide) ** 2 * good / (good + bad)
    return half + (1 - trust) * away, trust
