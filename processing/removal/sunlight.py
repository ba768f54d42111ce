"""Direct sunlight on floor and walls: far brighter than the same surface in shade, and where a window lets it fall.

The sun adds several times what the room's own light gives, a step that hardly any pattern of a floor has. With the
sun's direction, windows are projected along it (as Zhi et al. 2022 do in a search); without, the direction that
explains the bright places best is looked for. Each window's beam has its own threshold, half-way (in logarithms)
between its light and the shade beside it. A glossy floor's reflections and lamps lie in no beam.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Flags, Floats
from processing.ground.room_model import RoomModel
from processing.surfaces.sun import (
    AZIMUTH_SLACK_RAD,
    ELEVATION_SLACK_RAD,
    LEAST_RATIO,
    glazed,
    sun_vector,
    wall_between,
    window_depth,
)

SURE_RATIO = 2.5
"""The same, where no window is known that could confirm it."""
CORE_M, RING_M, SLACK_M = 0.12, 0.35, 0.15
"""Depth in a beam that is sure to be in it; width of the shade beside it; by how much edges of beams may be wrong."""
LEAST_PX = 40
SEARCH_AZIMUTHS, SEARCH_ELEVATIONS = 72, 12
LOWEST_RAD, HIGHEST_RAD = math.radians(8), math.radians(75)
FINE_STEPS_RAD = (math.radians(2.0), math.radians(0.7))
LEAST_SR = 1e-4


@dataclass(frozen=True)
class Scene:
    """What the search looks at: the places of floor and walls that no furniture hides, as a list of pixels."""

    points_m: Doubles
    """(n, 3)."""
    plane: npt.NDArray[np.int16]
    """(n,)."""
    log2_luminance: Floats
    """(n,), relative to the median of its plane."""
    weight: Doubles
    """(n,): solid angle."""


@dataclass(frozen=True)
class SunFound:
    """Direct sunlight at working size, and why there is none."""

    mask: Flags
    direction: tuple[float, float] | None
    """Azimuth (from +y towards +x) and elevation (rad) that explain it."""
    confirmed: bool
    """Whether windows explain it."""
    reason: str
    """What was done, or why nothing was found."""


def find_sunlight(
    luminance: Floats,
    points_m: Doubles,
    plane: npt.NDArray[np.int16],
    usable: Flags,
    weight: Doubles,
    room: RoomModel,
    sun: tuple[float, float] | None,
) -> SunFound:
    """Return direct sunlight on a room's planes.

    Parameters
    ----------
    luminance
        (H, W), linear, any unit.
    points_m, plane
        (H, W, 3) and (H, W): what each pixel sees of the empty room.
    usable
        (H, W): floor and walls, nothing before them, no opening.
    weight
        (H, W): solid angles.
    sun
        Azimuth (from +y towards +x) and elevation in rad, or None: not known.
    """
    none = np.zeros(luminance.shape, bool)
    if sun is not None and sun[1] <= 0:
        return SunFound(none, None, False, "the sun is below the horizon")
    if usable.sum() < LEAST_PX:
        return SunFound(none, None, False, "hardly any floor or wall is seen")
    relative = relative_log2(luminance, plane, usable)
    if not glazed(room):
        bright = usable & (relative > math.log2(SURE_RATIO))
        reason = "the room has no window that could confirm it: bright places by luminance alone"
        return SunFound(bright, None, False, reason if bright.any() else "no place is bright enough for direct sun")
    if not (usable & (relative > math.log2(LEAST_RATIO))).any():
        return SunFound(none, None, False, "no place is bright enough for direct sun: overcast, or the sun elsewhere")
    scene = Scene(points_m[usable], plane[usable], relative[usable], weight[usable])
    direction, score = best_direction(thinned(scene), room, sun)
    if direction is None or score <= 0:
        return SunFound(
            none, None, False, "no window's beam explains the bright places: overcast, or the sun elsewhere"
        )
    lit = _in_beams(scene, room, sun_vector(*direction))
    mask = none.copy()
    mask[usable] = lit
    if float(weight[mask].sum()) < LEAST_SR:
        return SunFound(none, None, False, "no window's beam is brighter than the shade beside it")
    how = "given" if sun is not None else "searched"
    where = f"azimuth {math.degrees(direction[0]):.0f}, elevation {math.degrees(direction[1]):.0f} degrees"
    return SunFound(mask, direction, True, f"windows along the sun's {how} direction ({where}) confirm it")


def relative_log2(luminance: Floats, plane: npt.NDArray[np.int16], usable: Flags) -> Floats:
    """Return log2 of the luminance over the median of its plane's usable pixels; -20 at least."""
    found = np.full(luminance.shape, -20.0, np.float32)
    for index in np.unique(plane[usable]):
        here = usable & (plane == index)
        middle = float(np.median(luminance[here]))
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
        asked = [
            (float(a), float(e)) for a in azimuths for e in np.linspace(LOWEST_RAD, HIGHEST_RAD, SEARCH_ELEVATIONS)
        ]
    else:
        azimuths = sun[0] + np.linspace(-AZIMUTH_SLACK_RAD, AZIMUTH_SLACK_RAD, 7)
        heights = sun[1] + np.linspace(-ELEVATION_SLACK_RAD, ELEVATION_SLACK_RAD, 3)
        asked = [(float(a), max(0.01, float(e))) for a in azimuths for e in heights]
    best: tuple[float, float] | None = None
    score = 0.0
    for direction in asked:
        value = explained(scene, room, sun_vector(*direction))
        if value > score:
            best, score = direction, value
    for step in FINE_STEPS_RAD:
        if best is None:
            break
        around = [
            (best[0] + i * step, max(0.01, best[1] + j * step)) for i in (-2, -1, 0, 1, 2) for j in (-2, -1, 0, 1, 2)
        ]
        around = [one for one in around if _within_slack(one, sun)]
        values = [explained(scene, room, sun_vector(*one)) for one in around]
        best, score = around[int(np.argmax(values))], max(values)
    return best, score


def _within_slack(direction: tuple[float, float], given: tuple[float, float] | None) -> bool:
    """Return whether a direction is as near to the given one as that may be off; any is where none is given."""
    if given is None:
        return True
    turned = abs((direction[0] - given[0] + math.pi) % (2 * math.pi) - math.pi)
    risen = abs(direction[1] - max(0.01, given[1]))
    return turned <= AZIMUTH_SLACK_RAD + 1e-9 and risen <= ELEVATION_SLACK_RAD + 1e-9


def explained(scene: Scene, room: RoomModel, sun: Doubles) -> float:
    """Return how well beams along a direction fit: brightness inside them less that of bright places outside."""
    depth, _ = window_depth(room, scene.points_m, sun)
    inside = depth > 0
    if not inside.any():
        return 0.0
    inside[inside] &= ~wall_between(room, scene.points_m[inside], sun)
    bright = np.clip(scene.log2_luminance - math.log2(LEAST_RATIO), -1.0, 2.0)
    return float((scene.weight * np.where(inside, bright, -np.maximum(bright, 0.0))).sum()) + float(
        (scene.weight * np.maximum(bright, 0.0)).sum()
    )


def _in_beams(scene: Scene, room: RoomModel, sun: Doubles) -> Flags:
    """Return which pixels are sunlit, window by window: brighter than half-way to the shade beside the beam."""
    depth, which = window_depth(room, scene.points_m, sun)
    near = depth > -SLACK_M
    hidden = np.zeros(near.shape, bool)
    hidden[near] = wall_between(room, scene.points_m[near], sun)
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
    if ring.sum() < LEAST_PX // 4:
        shade = 0.0
    else:
        shade = float(np.median(log2_luminance[ring]))
    bright = log2_luminance[core & (log2_luminance > shade + math.log2(LEAST_RATIO))]
    if bright.size < LEAST_PX // 8:
        return np.zeros(here.shape, bool)
    threshold = (shade + float(np.median(bright))) / 2
    return beam & (log2_luminance > max(threshold, shade + math.log2(LEAST_RATIO) / 2))
