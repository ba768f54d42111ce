"""The room's sources of light as its pictures show them: windows, what covers them, and lamps.

The indoor panorama sees through each window what the outdoor picture sees directly: where their ratio is that of clear
glass, the window is clear; where less arrives, bars, curtains, a blind or trees stand in the way, and what the camera
sees there is light that the window gives by itself.

Light that surfaces give by themselves: electric lamps that are on, measured in the calibrated panorama.

No surface reflects more than all that falls on it. Where a pixel shows clearly more than that (apparent albedo above
`LAMP_TIMES`), and neither the sun nor a window explains it, it gives light: the excess over what its surface reflects
is the lamp's radiance, measured. A window that the room's model lacks is such a place too: its light is as real.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from processing.ground.arrays import Doubles, Floats, Rgb, Vector
from processing.ground.seam import components, resized, smoothed
from processing.light.scene.scene import Outdoors, Pane, Sun
from processing.light.solver.kernels import towards_panes
from processing.light.solver.sight import GLASS, Sight, looked_up, seen_outdoors
from processing.light.solver.sky import skylight
from processing.light.solver.stage import Stage
from processing.light.solver.sun import clear_of_sun
from processing.light.solver.transport import bounced, links_of, patch_points
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, solid_angles

USUAL: Rgb = (0.75, 0.77, 0.75)  # transmittance of double glazing, where it cannot be measured
LEAST_GLASS, MOST_GLASS = 0.4, 0.95
"""Between which a transmittance is believed: coated triple glazing has 0.5 and more, single glass 0.9."""
GLASS_WIDTH, GLASS_STEPS = 0.05, 80
"""Natural logarithm: over which ratios indoors to outdoors count as alike, and at how many levels they are counted."""
LEAST_CLEAR = 0.08
"""Of the window, below which what is like clear glass may be chance: bars and curtains often leave little clear."""
LEAST_PIXELS = 24  # of sky seen through windows, for their transmittance to be measured
ABOVE_HORIZON = 0.02  # sine of the elevation above which the outdoor picture is compared
CELL_M = 0.04  # of a pane; chosen, as wide as sashes are
CLEAR_FROM, CLEAR_TO, CLEAR_COLOUR = 0.8, 1.25, 0.25
"""Of what clear glass would show, between which a cell before the sky is clear, and by how much (natural logarithm) its
colour may differ: sunlit slats and curtains are brighter than the sky, others are not of its colour (measured in three
simulated rooms: docs/measurements/albedo.md)."""
GROUND_FROM = 0.4  # of what clear glass would show of the ground, from which a cell is clear, to its inverse; chosen
GROUND_RAD, GROUND_PRIOR = math.radians(15), 0.01
"""Within which ground is alike, and how much that of all counts besides; chosen: a window is wider, a garden is not."""
GROUND_QUANTILE = 0.5  # of the brighter half the median is taken; chosen, never swept
MOST_GROUND = 8.0  # by which the ground may be brighter or darker than its usual albedo makes it
LAMP_TIMES = 1.6  # of all the light that falls on a place: less may be an error of the irradiance, or a highlight
LEAST_SR = 5e-5  # of a lamp as the camera sees it: 0.4 degrees wide. Smaller spots are noise, or do not matter.
SUN_MARGIN_M = 0.25  # around the sun's patch, where the model's edges may be wrong
SUN_TIMES = 2.0  # what its surface gives in the shade, from which a place near the sun's patch may be lit by it; chosen
MOST_SUN = 1.5  # times the model's: its strength, glass and transmittance are uncertain; chosen on ten sunny rooms
ABOVE_AIR_LX = 133e3  # the sun's normal illuminance outside the atmosphere (IES): no overexposed disc hides more
SUN_SURE = (0.75, 1.75)
"""Times a strength that was found, within which the true one lies; chosen on five rooms, all of which it holds for
(docs/measurements/emptying.md)."""
STRENGTHS = np.exp2(np.arange(0, 6.01, 0.125))
"""Times what a clipped picture shows of its windows, that are tried: to six stops, a sunlit lawn behind a dim room."""
LEAST_PATCHES = 12  # of a surface, fewer of which say nothing of how even it is; chosen
AS_GOOD = 0.1  # by which an unevenness may exceed the least; chosen by coverage: docs/measurements/emptying.md
DIM = 0.4
"""Mean albedo of a room's surfaces, half of which is as unlikely as that: with windows too strong, all of it is black
(chosen: nine rooms have 0.21 to 0.97)."""


def measured_windows(
    stage: Stage, sight: Sight, panorama: Floats, valid: np.ndarray, eye_m: Vector
) -> tuple[tuple[Pane, ...], Outdoors, bool]:
    """Return panes with transmittance, clear share and veil, the outdoors with the ground as seen, and a flag.

    ``panorama`` (H, 2 H, 3) and what its pixels see; ``valid`` (H, 2 H): pixels that are not clipped. The last is
    whether the glass's transmittance could be measured; if not, it is that of double glazing.
    """
    rgb, good, outdoors = panorama.reshape(-1, 3), valid.ravel(), stage.scene.outdoors
    glass = np.flatnonzero((sight.label == GLASS) & (sight.rays[:, 2] > ABOVE_HORIZON) & good)
    outside = looked_up(outdoors.rgb, sight.rays[glass]).astype(np.float64)
    share, measured = _clear_glass(rgb[glass].astype(np.float64), outside)
    gain = _seen_ground(stage, sight, rgb, good, share)
    if gain is not None:
        outdoors = replace(outdoors, rgb=outdoors.rgb * resized(gain, outdoors.rgb.shape[:2]))
    glazed = [replace(pane, transmittance=share) for pane in stage.scene.panes]
    panes = tuple(_covered(stage, pane, outdoors, panorama, eye_m) for pane in glazed)
    return _as_seen(stage.under(outdoors, panes), sight, rgb, good, eye_m), outdoors, measured


def _as_seen(stage: Stage, sight: Sight, rgb: Floats, valid: np.ndarray, eye_m: Vector) -> tuple[Pane, ...]:
    """Return panes that give the camera what pixels (N, 3) show on them, in the mean above the horizon and below it.

    What they give too little comes as a veil, what is too much they hold back."""
    given, panes = seen_outdoors(stage, sight), []
    area = solid_angles(Equirectangular(sight.shape[1], sight.shape[0])).ravel()
    for number, pane in enumerate(stage.scene.panes):
        clear, veil = pane.clear.copy(), pane.veil_cd_m2.copy()
        low = _cells(stage, pane, eye_m)[0][:, 2].reshape(clear.shape) <= ABOVE_HORIZON
        for cells, pixels in ((low, sight.rays[:, 2] <= ABOVE_HORIZON), (~low, sight.rays[:, 2] > ABOVE_HORIZON)):
            mine = np.flatnonzero((sight.label == GLASS) & (sight.pane == number) & valid & pixels)
            if len(mine) >= LEAST_PIXELS:
                has, due = (np.average(one[mine], axis=0, weights=area[mine]) for one in (given, rgb))
                kept = np.float32(min(1.0, (due / np.maximum(has, 1e-9)).min()))
                clear[cells], veil[cells] = kept * clear[cells], kept * veil[cells] + np.maximum(due - kept * has, 0)
        panes.append(replace(pane, clear=clear, veil_cd_m2=veil.astype(np.float32)))
    return tuple(panes)


def windows_from_inside(stage: Stage, panorama: Floats, eye_m: Vector) -> tuple[Pane, ...]:
    """Return panes that give the light that a panorama (H, 2 H, 3) shows on them, as bright from everywhere: no sky.

    A place on the floor sees the sky where the camera sees the horizon: without an outdoor picture this is not known.
    """
    found = []
    for pane in stage.scene.panes:
        way, seen, shape = _cells(stage, pane, eye_m)
        veil = looked_up(panorama, way).astype(np.float64)
        if seen.any():
            veil[~seen] = veil[seen].mean(axis=0)
        covered = np.zeros(shape, np.float32)
        found.append(replace(pane, clear=covered, veil_cd_m2=veil.reshape(*shape, 3).astype(np.float32)))
    return tuple(found)


def _cells(stage: Stage, pane: Pane, eye_m: Vector) -> tuple[Floats, np.ndarray, tuple[int, int]]:
    """Return the directions (N, 3) from a point to a pane's cells, which of them it sees, and rows and columns."""
    rows = max(1, round(float(np.linalg.norm(pane.up_m)) / CELL_M))
    columns = max(1, round(float(np.linalg.norm(pane.across_m)) / CELL_M))
    v, u = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij")
    places = pane.corner_m + u[..., None] * pane.across_m + (1 - v)[..., None] * pane.up_m
    way = places.reshape(-1, 3) - np.asarray(eye_m)
    far = np.linalg.norm(way, axis=1)
    way = (way / far[:, None]).astype(np.float32)
    hits = stage.tracer.cast(np.broadcast_to(np.asarray(eye_m, np.float32), way.shape), way)
    return way, hits.distance_m > far - 0.02, (rows, columns)


def _clear_glass(inside: Doubles, outside: Doubles) -> tuple[Rgb, bool]:
    """Return the transmittance of the clear parts of all windows (glazed alike), and whether it was measured."""
    weights = np.asarray(LUMINANCE_WEIGHTS)
    usable = outside @ weights > 0
    if usable.sum() < LEAST_PIXELS:
        return USUAL, False
    ratio = (inside[usable] @ weights) / (outside[usable] @ weights)
    believed = np.log(ratio[(ratio > LEAST_GLASS) & (ratio < MOST_GLASS)])
    if len(believed) < max(LEAST_PIXELS, LEAST_CLEAR * len(ratio)):
        return USUAL, False
    # The most frequent ratio: glass is one, what covers it is many.
    levels = np.linspace(math.log(LEAST_GLASS), math.log(MOST_GLASS), GLASS_STEPS)
    alike = np.exp(-0.5 * ((levels[:, None] - believed) / GLASS_WIDTH) ** 2).sum(axis=1)
    level = math.exp(levels[alike.argmax()])
    clear = np.abs(ratio / level - 1) < 0.1
    colour = np.median(inside[usable][clear] / np.maximum(outside[usable][clear], 1e-9), axis=0)
    red, green, blue = (float(v) for v in np.clip(colour, 0.8 * level, min(1.2 * level, 1.0)))
    return (red, green, blue), True


def _covered(stage: Stage, pane: Pane, outdoors: Outdoors, panorama: Floats, eye_m: Vector) -> Pane:
    """Return a pane with clear share and veil as the camera sees them; what it does not see is like the rest.

    A cell is clear or not, by ``outdoors`` with the ground as it is seen. What covers the rest is as bright from
    everywhere as for the camera."""
    way, seen, (rows, columns) = _cells(stage, pane, eye_m)
    shown = looked_up(panorama, way).astype(np.float64)
    through = looked_up(outdoors.rgb, way) * np.asarray(pane.transmittance)
    weights = np.asarray(LUMINANCE_WEIGHTS)
    ratio = (shown @ weights) / np.maximum(through @ weights, 1e-9)
    down = way[:, 2] <= ABOVE_HORIZON
    tint = np.log(np.maximum(shown, 1e-6) / np.maximum(through, 1e-6)) - np.log(np.maximum(ratio, 1e-9))[:, None]
    like_sky = (ratio > CLEAR_FROM) & (ratio < CLEAR_TO) & (np.abs(tint).max(axis=1) < CLEAR_COLOUR)
    like_ground = (ratio > GROUND_FROM) & (ratio < 1 / GROUND_FROM)
    clear = np.where(down, like_ground, like_sky).astype(np.float64)
    veil = np.where((clear == 1)[:, None], 0, shown)
    if seen.any():
        clear[~seen], veil[~seen] = clear[seen].mean(), veil[seen].mean(axis=0)
    found = replace(
        pane,
        clear=clear.reshape(rows, columns).astype(np.float32),
        veil_cd_m2=veil.reshape(rows, columns, 3).astype(np.float32),
    )
    return replace(found, sun_clear=clear_of_sun(found, eye_m[2]))


def _seen_ground(stage: Stage, sight: Sight, rgb: Floats, valid: np.ndarray, transmittance: Rgb) -> Floats | None:
    """Return (H, W, 3) how bright the ground is against its guess, 1 above the horizon; None where it is not seen.

    It is that of the clear places seen within `GROUND_RAD`; elsewhere, of all."""
    mine = np.flatnonzero((sight.label == GLASS) & (sight.rays[:, 2] < -ABOVE_HORIZON) & valid)
    through = looked_up(stage.scene.outdoors.rgb, sight.rays[mine]) * np.asarray(transmittance)
    if len(mine) < LEAST_PIXELS or not (through > 0).all():
        return None
    ratio = np.clip(rgb[mine] / through, 1 / MOST_GROUND, MOST_GROUND)
    level = ratio @ np.asarray(LUMINANCE_WEIGHTS)
    usual = np.median(level[level >= np.quantile(level, GROUND_QUANTILE)])
    clear = (level > GROUND_FROM * usual) & (level < usual / GROUND_FROM)
    sums = np.zeros((*sight.shape, 4), np.float32)
    sums.reshape(-1, 4)[mine[clear]] = np.column_stack([ratio[clear], np.ones(clear.sum())])
    near = smoothed(sums, GROUND_RAD) + np.float32(GROUND_PRIOR) * np.append(ratio[clear].mean(axis=0), 1)
    below = (np.arange(sight.shape[0]) >= sight.shape[0] // 2)[:, None, None]
    return np.where(below, near[..., :3] / near[..., 3:], 1).astype(np.float32)


@dataclass(frozen=True)
class Lamp:
    """A shining spot as the camera sees it."""

    solid_angle_sr: float
    luminance_cd_m2: float
    """Mean."""
    label: int
    """Number of the surface that it is seen on."""
    towards: Vector
    """Its middle's direction from the camera."""


def find_lamps(
    rgb: Doubles, irradiance: Doubles, usual: Doubles, sight: Sight, usable: np.ndarray
) -> tuple[Floats, list[Lamp]]:
    """Return what pixels give off by themselves (N, 3) cd/m2, and the lamps.

    ``rgb``, ``irradiance`` (N, 3): radiance and irradiance of the pixels of a panorama.
    ``usual`` (N, 3): the usual albedo of each pixel's surface.
    ``usable`` (N,): pixels that the sun does not reach, seen and not filled in.
    """
    weights = np.asarray(LUMINANCE_WEIGHTS)
    apparent = math.pi * (rgb @ weights) / np.maximum(irradiance @ weights, 1e-9)
    shining = (sight.solid & usable & (apparent > LAMP_TIMES)).reshape(sight.shape)
    own = np.maximum(rgb - usual * irradiance / math.pi, 0)
    emission = np.zeros(rgb.shape, np.float32)
    area = solid_angles(Equirectangular(sight.shape[1], sight.shape[0])).ravel()
    lamps = []
    count, spots = components(shining)
    for spot in range(1, count + 1):
        mine = np.flatnonzero(spots.ravel() == spot)
        size = float(area[mine].sum())
        if size < LEAST_SR:
            continue
        emission[mine] = own[mine]
        middle = (sight.rays[mine] * area[mine, None]).sum(axis=0)
        x, y, z = (float(v) for v in middle / np.linalg.norm(middle))
        labels, times = np.unique(sight.label[mine], return_counts=True)
        level = float(np.average(own[mine] @ weights, weights=area[mine]))
        lamps.append(Lamp(size, level, int(labels[times.argmax()]), (x, y, z)))
    return emission, sorted(lamps, key=lambda lamp: -lamp.solid_angle_sr * lamp.luminance_cd_m2)


def open_sun(stage: Stage, sight: Sight) -> Doubles:
    """Return the sun's irradiance (N, 3) where nothing were in its way but glass; 0 far from where it can fall."""
    sun, panes = stage.scene.outdoors.sun, stage.scene.panes
    out = np.zeros((len(sight.label), 3))
    if sun is None or not panes:
        return out
    near = near_sun(stage, sight)
    cosine = np.maximum(sight.normal @ np.asarray(sun.direction), 0)[near, None]
    glass = np.mean([pane.transmittance for pane in panes], axis=0)
    out[near] = cosine * np.asarray(sun.normal_illuminance_lx) * glass
    return out


def near_sun(stage: Stage, sight: Sight) -> np.ndarray:
    """Return which pixels (N,) see a place within `SUN_MARGIN_M` of the sun's patch."""
    return np.asarray(sight.solid & places_near_sun(stage, sight.point, sight.normal))


def sunlit_pixels(bare: Stage, large: Sight, rgb: Floats, light_lx: Floats, own: np.ndarray) -> Floats:
    """Return the direct sun (N, 3), lx, of pixels that show it: whether they do is what fits their surface better."""
    near, weights = near_sun(bare, large), np.asarray(LUMINANCE_WEIGHTS)
    if not near.any():
        return np.zeros((len(near), 3), np.float32)
    full = open_sun(bare, large)
    luminance, level = rgb.reshape(-1, 3) @ weights, np.maximum(light_lx @ weights, 1e-9)
    shaded = math.pi * luminance / level
    usual = np.full(len(near), 0.5)
    for label in np.unique(large.label[near]):
        mine = large.label == label
        among = mine & own & ~near
        usual[mine] = np.median(shaded[among]) if among.any() else 0.5
    lit = math.pi * luminance / (level + full @ weights)
    away = [np.abs(np.log(np.maximum(one, 1e-6) / np.maximum(usual, 1e-6))) for one in (lit, shaded)]
    return np.where((near & (away[0] < away[1]))[:, None], full, 0).astype(np.float32)


def places_near_sun(stage: Stage, points: Floats, normals: Floats) -> np.ndarray:
    """Return which places (N, 3) of a room without furniture lie within `SUN_MARGIN_M` of the sun's patch."""
    sun, panes = stage.scene.outdoors.sun, stage.scene.panes
    near = np.zeros(len(points), bool)
    if sun is None or not panes:
        return near
    corner, across, up = (np.array([getattr(pane, f"{one}_m") for pane in panes]) for one in ("corner", "across", "up"))
    a, b = (np.array([SUN_MARGIN_M * one / np.linalg.norm(one) for one in side]) for side in (across, up))
    towards_panes(points, np.asarray(sun.direction, np.float64), corner - a - b, across + 2 * a, up + 2 * b, near)
    return np.asarray(near & (normals @ np.asarray(sun.direction, np.float32) > 0))


def most_sun(sun: Sun | None) -> float:
    """Return how many times as strong as its picture a sun may be; overexposed, as strong as `ABOVE_AIR_LX`."""
    if sun is None or not sun.clipped:
        return MOST_SUN
    return max(MOST_SUN, ABOVE_AIR_LX / float(np.asarray(sun.normal_illuminance_lx) @ np.asarray(LUMINANCE_WEIGHTS)))


def sun_strength(sun: Sun | None, given: Doubles, matte: Doubles, due: Doubles) -> float:
    """Return how many times as strong as its picture a sun is by the patches that it lights, 0 to `most_sun`.

    ``given``, ``matte``, ``due`` (N,): what places near its patches give off, weighted by their size, what they would
    without direct sun, and what the sun adds by the model; 1 where none is due. A least-squares strength: over all of
    the sun's patch, what trees and slats hold back of it included; of an overexposed sun over what it does light.
    """
    lit = given > SUN_TIMES * matte
    if sun is not None and sun.clipped:
        lit, due = lit & (due > 0), np.where(lit, due, 0)
    return float(np.clip((given - matte)[lit].sum() / due.sum(), 0, most_sun(sun))) if due.sum() > 0 else 1.0


def under_share(outdoors: Outdoors, share: float) -> Outdoors:
    """Return the light outside under a share of its sun, in the sun's own colour."""
    if outdoors.sun is None:
        return outdoors
    red, green, blue = (share * value for value in outdoors.sun.normal_illuminance_lx)
    clipped = outdoors.sun.clipped and share == 1
    return replace(outdoors, sun=replace(outdoors.sun, normal_illuminance_lx=(red, green, blue), clipped=clipped))


def sun_note(sun: Sun | None, share: float) -> tuple[str, ...]:
    """Return what is to be said of an overexposed sun; nothing of others."""
    if sun is None or not sun.clipped:
        return ()
    if share == 1:
        return ("sun: overexposed outdoors, and no sunlit patch is seen indoors: a lower bound",)
    low, high = (share * one for one in SUN_SURE)
    said = f"sun: {share:.1f} times as strong as the overexposed disc, by its patches indoors ({low:.1f} to {high:.1f})"
    return (said,)


def window_strength(
    radiosity: Doubles, windows_lx: Doubles, rest_lx: Doubles, area_m2: Doubles, groups: list[np.ndarray]
) -> tuple[float, float, float]:
    """Return how many times brighter windows are than a clipped picture shows them: the best value, lowest and highest.

    Light from the windows falls off through the room, albedo does not: the strength is that by which the albedo of each
    surface is most even (least absolute deviations of its logarithm), and the room not darker than rooms are.

    ``radiosity``, ``windows_lx``, ``rest_lx`` (P,): what patches give off, lm/m2; irradiance by windows as bright as
      they are shown, and by all else, lx.
    ``groups``: indices of the patches of one surface each.
    """
    cost, level, whole_m2 = np.zeros(len(STRENGTHS)), np.zeros(len(STRENGTHS)), 1e-9
    for mine in groups:
        light = STRENGTHS[:, None] * windows_lx[mine] + rest_lx[mine]
        albedo = np.log(np.maximum(radiosity[mine], 1e-9)) - np.log(np.maximum(light, 1e-9))
        usual = np.median(albedo, axis=1)
        cost += np.abs(albedo - usual[:, None]) @ area_m2[mine]
        level, whole_m2 = level + usual * area_m2[mine].sum(), whole_m2 + area_m2[mine].sum()
    cost *= 1 + AS_GOOD * np.maximum(math.log2(DIM) - level / whole_m2 / math.log(2), 0) ** 2
    good = STRENGTHS[cost <= cost.min() * (1 + AS_GOOD)]
    return float(STRENGTHS[cost.argmin()]), float(good[0]), float(good[-1])


def brightened(stage: Stage, radiosity: Doubles, known: np.ndarray, samples: int, seed: int) -> tuple[Stage, str]:
    """Return a stage whose windows are as bright as the light says that they cast, and a note with the interval.

    ``radiosity`` (P, 3), lm/m2: what the patches give off, of which those ``known`` (P,) show their own surface.
    """
    weights, patches = np.asarray(LUMINANCE_WEIGHTS), stage.patches
    points, few = patch_points(stage, samples, (seed, 81)), max(1, samples // 4)
    windows = skylight(stage, patch_points(stage, few, (seed, 82)), patches.normal, few, (seed, 83))
    links = links_of(stage, points, patches.normal, samples, (seed, 84))
    rest, _ = bounced(stage, links, radiosity, None, (points, patches.normal), 1, (seed, 85))
    groups = []
    for (columns, rows, first), surface in zip(patches.grids, stage.scene.surfaces, strict=True):
        mine = first + np.flatnonzero((known & (patches.area_m2 > 0))[first : first + columns * rows])
        if surface.plane >= 0 and len(mine) >= LEAST_PATCHES:
            groups.append(mine)
    best, low, high = window_strength(radiosity @ weights, windows @ weights, rest @ weights, patches.area_m2, groups)
    panes = tuple(replace(pane, veil_cd_m2=pane.veil_cd_m2 * np.float32(best)) for pane in stage.scene.panes)
    note = f"windows: {best:.1f} times as bright as they appear, from the light they cast ({low:.1f} to {high:.1f})"
    return stage.under(stage.scene.outdoors, panes), note
