"""Patches of direct sunlight on floor and walls.

The sun adds several times what the room's own light gives, a step that hardly any pattern of a floor has. With the
sun's direction, windows are projected along it (as Zhi et al. 2022 do in a search); without, the direction that
explains the bright places best is looked for. Each window's beam has its own threshold, half-way (in logarithms)
between its light and the shade beside it. A glossy floor's reflections and lamps lie in no beam.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Int16s, weighted_median
from processing.ground.room_model import RoomModel
from processing.ground.seam import components
from processing.surfaces import sun as beams
from processing.surfaces.maps import FLOOR

SURE_RATIO = 2.5  # the same, where no window is known that could confirm it
# Without time and site nothing says that there is a sun. Only what looks like nothing else is then taken for its light.
UNKNOWN_RATIO = 4.0
"""Times its plane's median that such a patch must have (white in an ordinary picture is clipped there)."""
SHARP_STOPS, SHARP_SHARE, SHARP_RAD = 1.0, 0.6, math.radians(1)
"""Step across its border, along which share of it, within which angle: reflections and lamps fade."""
FULL_SHARE = 0.75  # of its convex outline on the plane that it fills, as what falls through a window does
FREE_SHARE = 0.7
"""Of its border that runs over one bare surface: what ends where a wall, a door or furniture begins has its colour."""
CORE_M, RING_M, SLACK_M = 0.12, 0.35, 0.15
"""Depth in a beam that is sure to be in it; width of the shade beside it; by how much edges of beams may be wrong."""
LEAST_PX = 40  # chosen, never swept
SEARCH_AZIMUTHS, SEARCH_ELEVATIONS = 72, 12
LOWEST_RAD, HIGHEST_RAD = math.radians(8), math.radians(75)
FINE_STEPS_RAD = (math.radians(2.0), math.radians(0.7))
SUNNY_RATIO, SUNNY_SHARE = 5.0, 0.5
"""Times the brightest plane's median from which a place on the floor is lit by the sun for sure, whatever it reflects;
share of such places that beams have to explain. Chosen: a clipped photograph has no such place."""
LEAST_SR = 1e-4  # 5 by 5 cm at 5 m; chosen, never swept


@dataclass(frozen=True)
class Scene:
    """What the search looks at: the places of floor and walls that no furniture hides, as a list of pixels."""

    points_m: Doubles
    """(N, 3)."""
    plane: Int16s
    """(N,)."""
    log2_luminance: Floats
    """(N,), relative to the median of its plane."""
    weight: Doubles
    """(N,): solid angle."""


@dataclass(frozen=True)
class SunFound:
    """Direct sunlight at working size, and why there is none."""

    mask: Flags
    sun: tuple[float, float, float] | None
    """Azimuth (from +y towards +x) and elevation (rad) that explain it, and how many times the light in the shade it
    adds on what faces it; 0: not known."""
    reason: str
    """What was done, or why nothing was found."""


def find_sunlight(
    luminance: Floats,
    points_m: Doubles,
    plane: Int16s,
    usable: Flags,
    weight: Doubles,
    room: RoomModel,
    sun: tuple[float, float] | None,
    seen: bool = False,
) -> SunFound:
    """Return direct sunlight on a room's planes.

    ``luminance`` (H, W), linear, any unit.
    ``points_m``, ``plane`` (H, W, 3) and (H, W): what each pixel sees of the empty room.
    ``usable`` (H, W): floor and walls, nothing before them, no opening.
    ``weight`` (H, W): solid angles.
    ``sun``: azimuth (from +y towards +x) and elevation in rad, or None: not known; then only what is unmistakable is
      taken.
    ``seen``: whether the sky was seen to have a sun: then patches need not be unmistakable.
    """
    none = np.zeros(luminance.shape, bool)
    if sun is not None and sun[1] <= 0:
        return SunFound(none, None, "the sun is below the horizon")
    if usable.sum() < LEAST_PX:
        return SunFound(none, None, "hardly any floor or wall is visible")
    relative = relative_log2(luminance, plane, usable, weight)
    if not beams.glazed(room) and sun is None:
        return SunFound(none, None, "neither a window nor the sun's position is known: no sunlight assumed")
    if not beams.glazed(room):
        bright = usable & (relative > math.log2(SURE_RATIO))
        reason = "the room has no window to confirm it: bright areas found by luminance alone"
        return SunFound(bright, None, reason if bright.any() else "no area is bright enough for direct sun")
    if not (usable & (relative > math.log2(beams.LEAST_RATIO))).any():
        return SunFound(none, None, "no area is bright enough for direct sun: overcast, or the sun is elsewhere")
    scene = Scene(points_m[usable], plane[usable], relative[usable], weight[usable])
    direction, score = best_direction(thinned(scene), room, sun)
    if direction is None or score <= 0:
        return SunFound(none, None, "no window's beam explains the bright areas: overcast, or the sun is elsewhere")
    lit = _in_beams(scene, room, beams.sun_vector(*direction))
    mask, times = none.copy(), _times(scene, luminance[usable], lit, direction[1])
    mask[usable] = lit
    if sun is None and not seen:
        mask = unmistakable(mask, relative, points_m, np.where(usable, plane, np.int16(-1)))
        if not mask.any():
            why = "time and site are unknown, and no patch is certain to be sunlight"
            return SunFound(none, (*direction, times) if times else None, why)
    if float(weight[mask].sum()) < LEAST_SR:
        return SunFound(none, None, "no window's beam is brighter than the shade beside it")
    how = "given" if sun is not None else "searched"
    where = f"azimuth {math.degrees(direction[0]):.0f}, elevation {math.degrees(direction[1]):.0f} degrees"
    return SunFound(mask, (*direction, times), f"windows along the sun's {how} direction ({where}) confirm it")


def _times(scene: Scene, luminance: Floats, lit: Flags, elevation_rad: float) -> float:
    """Return how many times the floor's light in the shade the sun adds on what faces it; 0 where it is not certain."""
    middle = {int(one): float(np.median(luminance[scene.plane == one])) for one in np.unique(scene.plane)}
    bright = (scene.plane == FLOOR) & (luminance > SUNNY_RATIO * max(middle.values()))  # on walls it may be a window
    if (bright & lit).sum() < LEAST_PX or scene.weight[bright & lit].sum() < SUNNY_SHARE * scene.weight[bright].sum():
        return 0.0
    return (float(np.median(luminance[bright & lit])) / max(middle[FLOOR], 1e-9) - 1) / math.sin(elevation_rad)


def unmistakable(mask: Flags, relative: Floats, points_m: Doubles, bare: Int16s) -> Flags:
    """Return the patches of a mask (H, W) that hardly anything but the sun makes: bright, sharp, full, all seen.

    ``relative`` (H, W): log2 of luminance over the plane's median; ``points_m`` (H, W, 3); ``bare`` (H, W): the
    plane of what nothing hides, -1 elsewhere.
    """
    side = np.ones((2 * max(1, round(SHARP_RAD / math.pi * len(mask))) + 1,) * 2, np.uint8)
    step = np.asarray(cv2.dilate(relative, side) - cv2.erode(relative, side), np.float32)
    kept = np.zeros_like(mask)
    for index in np.unique(bare[mask & (bare >= 0)]):
        free = cv2.erode((bare == index).astype(np.uint8), side).astype(bool)
        count, labels = components(mask & (bare == index))
        for label in range(1, count + 1):
            here = labels == label
            border = here & (cv2.erode(here.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
            if here.sum() < LEAST_PX or free[border].mean() < FREE_SHARE:
                continue
            bright = float(np.median(relative[here])) > math.log2(UNKNOWN_RATIO)
            sharp = float((step[border] > SHARP_STOPS).mean()) > SHARP_SHARE
            if bright and sharp and _fullness(points_m, here) > FULL_SHARE:
                kept |= here
    return kept


def _fullness(points_m: Doubles, here: Flags) -> float:
    """Return the share of its convex outline that a part of a plane fills."""
    points = points_m[here]
    middle = points - points.mean(axis=0)
    axes = np.linalg.svd(middle[:: max(1, len(middle) // 500)], full_matrices=False)[2][:2]
    flat = (middle @ axes.T).astype(np.float32)
    fine = max(float(np.ptp(flat, axis=0).max()), 1e-6) / 64
    cells = ((flat - flat.min(axis=0)) / fine).astype(np.int32)
    drawn = np.zeros((cells[:, 1].max() + 1, cells[:, 0].max() + 1), np.uint8)
    drawn[cells[:, 1], cells[:, 0]] = 1
    # Far pixels are farther apart than cells.
    drawn = cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    outline = np.zeros_like(drawn)
    cv2.fillConvexPoly(outline, cv2.convexHull(cells), 1)
    return float(drawn.sum() / max(1, outline.sum()))


def relative_log2(luminance: Floats, plane: Int16s, usable: Flags, weight: Doubles) -> Floats:
    """Return (H, W): log2 of the luminance over the median of its plane's ``usable`` directions; -20 at least.

    ``weight`` (H, W): solid angles. By count, a patch of sun below the camera would be the median of all the floor.
    """
    found = np.full(luminance.shape, -20.0, np.float32)
    for index in np.unique(plane[usable]):
        here = usable & (plane == index)
        middle = float(weighted_median(luminance[here], weight[here]))
        if middle > 0:
            found[here] = np.log2(np.maximum(luminance[here] / middle, 2.0**-20))
    return found


def thinned(scene: Scene, most: int = 12_000) -> Scene:
    """Return the scene with at most so many pixels, those of more solid angle more often; the same ones each time."""
    if len(scene.weight) <= most:
        return scene
    share = scene.weight / scene.weight.sum()
    kept = np.random.default_rng(0).choice(len(share), size=most, replace=True, p=share)
    even = np.full(most, scene.weight.sum() / most)
    return Scene(scene.points_m[kept], scene.plane[kept], scene.log2_luminance[kept], even)


def best_direction(
    scene: Scene, room: RoomModel, sun: tuple[float, float] | None
) -> tuple[tuple[float, float] | None, float]:
    """Return the sun's direction that explains the bright places best, and its score (above 0: it explains some)."""
    if sun is None:
        azimuths = np.linspace(-math.pi, math.pi, SEARCH_AZIMUTHS, endpoint=False)
        ways = [(float(a), float(e)) for a in azimuths for e in np.linspace(LOWEST_RAD, HIGHEST_RAD, SEARCH_ELEVATIONS)]
    else:
        azimuths = sun[0] + np.linspace(-beams.AZIMUTH_SLACK_RAD, beams.AZIMUTH_SLACK_RAD, 7)
        heights = sun[1] + np.linspace(-beams.ELEVATION_SLACK_RAD, beams.ELEVATION_SLACK_RAD, 3)
        ways = [(float(a), max(0.01, float(e))) for a in azimuths for e in heights]
    best: tuple[float, float] | None = None
    score = 0.0
    for direction in ways:
        value = explained(scene, room, beams.sun_vector(*direction))
        if value > score:
            best, score = direction, value
    for step in FINE_STEPS_RAD:
        if best is None:
            break
        around = [(best[0] + i * step, max(0.01, best[1] + j * step)) for i in range(-2, 3) for j in range(-2, 3)]
        around = [one for one in around if _within_slack(one, sun)]
        values = [explained(scene, room, beams.sun_vector(*one)) for one in around]
        best, score = around[int(np.argmax(values))], max(values)
    return best, score


def _within_slack(direction: tuple[float, float], given: tuple[float, float] | None) -> bool:
    """Return whether a direction is as near to the given one as that may be off; any is where none is given."""
    if given is None:
        return True
    turned = abs((direction[0] - given[0] + math.pi) % (2 * math.pi) - math.pi)
    risen = abs(direction[1] - max(0.01, given[1]))
    return turned <= beams.AZIMUTH_SLACK_RAD + 1e-9 and risen <= beams.ELEVATION_SLACK_RAD + 1e-9


def explained(scene: Scene, room: RoomModel, sun: Doubles) -> float:
    """Return how well beams along ``sun`` (unit, of shape (3,)) fit: brightness inside less bright places outside."""
    depth, _ = beams.window_depth(room, scene.points_m, sun)
    inside = depth > 0
    if not inside.any():
        return 0.0
    inside[inside] &= ~beams.wall_between(room, scene.points_m[inside], sun)
    bright = np.clip(scene.log2_luminance - math.log2(beams.LEAST_RATIO), -1.0, 2.0)
    return float((scene.weight * np.where(inside, bright, -np.maximum(bright, 0.0))).sum()) + float(
        (scene.weight * np.maximum(bright, 0.0)).sum()
    )


def _in_beams(scene: Scene, room: RoomModel, sun: Doubles) -> Flags:
    """Return which pixels are sunlit, window by window: brighter than half-way to the shade beside the beam."""
    depth, which = beams.window_depth(room, scene.points_m, sun)
    near = depth > -SLACK_M
    hidden = np.zeros(near.shape, bool)
    hidden[near] = beams.wall_between(room, scene.points_m[near], sun)
    lit = np.zeros(near.shape, bool)
    for window in np.unique(which[near]):
        for plane in np.unique(scene.plane[near & (which == window)]):
            here = (which == window) & (scene.plane == plane) & ~hidden
            lit |= _one_beam(scene.log2_luminance, depth, here)
    return lit


def _one_beam(log2_luminance: Floats, depth: Floats, here: Flags) -> Flags:
    core = here & (depth > CORE_M)
    ring = here & (depth < -SLACK_M) & (depth > -SLACK_M - RING_M)
    beam = here & (depth > -SLACK_M)
    if core.sum() < LEAST_PX // 4:
        core = beam
    shade = 0.0 if ring.sum() < LEAST_PX // 4 else float(np.median(log2_luminance[ring]))
    bright = log2_luminance[core & (log2_luminance > shade + math.log2(beams.LEAST_RATIO))]
    if bright.size < LEAST_PX // 8:
        return np.zeros(here.shape, bool)
    threshold = (shade + float(np.median(bright))) / 2
    return beam & (log2_luminance > max(threshold, shade + math.log2(beams.LEAST_RATIO) / 2))
