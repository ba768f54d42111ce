"""What furniture changes in a photograph, band by band of whole rows, so that a large picture needs little memory.

In a large picture most of the room is filled from a coarse grid (`processing.light.picture.coarse`); what is looked at
pixel by pixel is furniture, sunlight, and where one surface ends.
"""

import math
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from processing.ground.arrays import Flags, Floats, Indices, Int32s, Vector, bands
from processing.ground.kernels import compiled, inlined
from processing.ground.threads import side_by_side
from processing.light.picture.coarse import Band, Nodes, add_mirrored, fill_plain, furniture_blocks, much
from processing.light.picture.edges import MOST_GAIN, Lens, bounded, crossed_pixels, smooth_edges
from processing.light.picture.highlights import FEW_RAYS, Mirrors, furniture_highlights, matte_share
from processing.light.picture.render import ROWS_AT_ONCE_PX
from processing.light.solver.irradiance import Effort, Irradiance, gathered
from processing.light.solver.sight import FIRST_PART, NOTHING, Sight, albedo_of, emission_of, sight_along
from processing.light.solver.stage import Stage
from processing.light.solver.sun import RIM_RAYS, block_px, sun_of
from processing.light.solver.transport import LightMap
from processing.light.solver.upsample import Places, upsampled
from processing.pictures.images import LUMINANCE_WEIGHTS

MISFIT = 0.5  # of log luminance between photograph and model, beyond which the model's sun is not believed
LARGE_ROWS = 1024  # taller pictures take a quarter of the sun's samples; chosen, never swept
MOST_SAMPLES = 128  # rays to the sun from a node in half shadow
EVEN_M = 0.03  # chosen: light on furniture hardly changes over that
MOST_BANDS = 4  # at once, each of some 60 MB; chosen
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS, np.float32)


@dataclass(frozen=True)
class Change:
    """A room without and with furniture, and the light of both at a small size."""

    bare: Stage
    full: Stage
    small: Sight
    before: Irradiance
    after: Irradiance
    lights: tuple[LightMap, LightMap]
    mirrors: Mirrors | None
    effort: Effort
    seed: int
    eye_m: Vector


def rays_of(places: Places) -> Floats:
    """Return the directions (N, 3) of the middles of a panorama's pixels."""
    out = np.empty((len(places.row), 3), np.float32)
    _rays_of(places, out)
    return out


@compiled
def _rays_of(places, out):  # type: ignore[no-untyped-def]
    for i in range(out.shape[0]):
        latitude = (0.5 - (places.row[i] + 0.5) / places.high) * math.pi
        longitude = ((places.column[i] + 0.5) / places.wide - 0.5) * 2 * math.pi
        level = math.cos(latitude)
        out[i, 0], out[i, 1], out[i, 2] = math.sin(longitude) * level, math.cos(longitude) * level, math.sin(latitude)


def in_bands(change: Change, photograph: Floats, sunless: np.ndarray | None) -> tuple[Floats, np.ndarray, np.ndarray]:
    """Return the picture (H, W, 3), where furniture is seen, and which pixels are kept."""
    high, wide = photograph.shape[:2]
    step = block_px(math.pi / high)
    near = furniture_blocks(change.full, (high, wide), step, change.eye_m)
    crossed = crossed_pixels(change.full, (high, wide), change.eye_m)
    lens = Lens(change.full, change.eye_m, crossed, partial(_of, change))
    job = _Job(change, photograph, sunless, near, step, lens)
    rgb, furniture, kept = np.empty_like(photograph), np.zeros((high, wide), bool), np.ones((high, wide), bool)

    def work(rows: slice) -> None:
        if change.full is change.bare and not (sunless is not None and sunless[rows].any()):
            rgb[rows] = photograph[rows]  # nothing was put in, and no sun comes back
            return
        rgb[rows], furniture[rows], kept[rows] = _band(job, rows)

    side_by_side(work, bands(high, max(1, ROWS_AT_ONCE_PX // wide // step) * step), MOST_BANDS)
    return rgb, furniture, kept


@dataclass(frozen=True)
class _Job:
    """What all bands have in common."""

    change: Change
    photograph: Floats
    sunless: np.ndarray | None
    near: Flags
    """(blocks): where furniture may be seen."""
    step: int
    """Pixels a block."""
    lens: Lens


def _band(job: _Job, rows: slice) -> tuple[Floats, np.ndarray, np.ndarray]:
    """Return a band's picture, where furniture is seen, and which pixels are kept."""
    high, wide, step = *job.photograph.shape[:2], job.step
    # A block more above and below, of furniture alone: its edges look at their neighbours.
    top, bottom = max(0, rows.start - step), min(high, rows.stop + step)
    inner = slice(rows.start - top, rows.stop - top)
    near = job.near[top // step : -(-bottom // step)]
    todo = np.repeat(np.repeat(near, step, axis=0), step, axis=1)[: bottom - top, :wide]
    photo = job.photograph[top:bottom]
    band = Band(photo.copy(), np.ones(todo.shape, bool), np.array(todo))
    if step > 1:
        own = Band(band.shown[inner], band.kept[inner], band.todo[inner])
        blocks = job.near[rows.start // step : -(-rows.stop // step)]
        fill_plain(_nodes(job, rows), step, blocks, photo[inner], _WEIGHTS, own)
    else:
        band.todo[inner] = True
    seen = _looked_at(job, top, photo, band)
    smooth = smooth_edges(job.lens, seen, top, photo, band.shown)[inner]
    kept = band.kept[inner] & _all_three(smooth == photo[inner])
    return smooth, (seen.label >= FIRST_PART).reshape(seen.shape)[inner], kept


def _nodes(job: _Job, rows: slice) -> Nodes:
    """Return the corners of a band's blocks; the last column's right ones are the first column."""
    high, wide, step = *job.photograph.shape[:2], job.step
    last = min(rows.stop, high - 1)
    row = np.append(np.arange(rows.start, rows.stop, step, dtype=np.int32), np.int32(last))
    column = np.arange(0, wide, step, dtype=np.int32)
    shape = len(row), len(column)
    places = Places(np.repeat(row, shape[1]), np.tile(column, shape[0]), high, wide)
    sight = sight_along(job.change.full, rays_of(places), job.change.eye_m, shape)
    light, missed, mirror, _ = _upsampled(job.change, sight, places)
    room = sight.label < FIRST_PART
    sun = sun_of(job.change.bare, sight, MOST_SAMPLES // 4, job.change.seed + rows.start, room)
    old, new = light[:, :3], light[:, 3:]
    usable = sight.solid & _all_three(old > 0)
    gain = bounded(np.where(usable[:, None], new / np.where(usable[:, None], old, 1), np.float32(1)))
    lamps = emission_of(job.change.full, sight)
    plain = room & (~sight.solid | (~missed & usable & _all_three(sun == 0) & _all_three(lamps == 0)))
    label, plain, gain = sight.label.reshape(shape), plain.reshape(shape), gain.astype(np.float32).reshape(*shape, 3)
    return Nodes(label, gain, mirror[:, :6].reshape(*shape, -1), plain, last - rows.start)


def _upsampled(change: Change, sight: Sight, places: Places) -> tuple[Floats, Flags, Floats, Flags]:
    """Return what small pixels say of pixels (N): irradiance before and after (N, 6), mirrored light (N, 9 or 0), and
    for each which (N,) no small pixel shows."""
    light, missed = change.after.enlarged(change.small, sight, places, wraps=True, before=change.before.picture)
    mirrors = change.mirrors
    if mirrors is None:
        return light, missed, np.empty((len(light), 0), np.float32), np.zeros(len(light), bool)
    among = (sight.label >= FIRST_PART) | np.isin(sight.label, mirrors.floors)
    return light, missed, *upsampled(mirrors.all_three, mirrors.sight, sight, wraps=True, places=places, among=among)


def _looked_at(job: _Job, top: int, photo: Floats, band: Band) -> Sight:
    """Fill the pixels that are still to be done, and return what they see; others see nothing there.

    ``top``: the band's first row in the picture."""
    change, (high, wide) = job.change, job.photograph.shape[:2]
    index = np.flatnonzero(band.todo)
    row, column = np.divmod(index.astype(np.int32), np.int32(wide))
    places = Places(row + np.int32(top), column, high, wide)
    sight = sight_along(change.full, rays_of(places), change.eye_m, (1, len(index)))
    whole = _spread(sight, index, band.todo.shape)
    if not len(index):
        return whole
    sun, rays = _sunlight(change, whole, index, change.seed + top, high), (change.effort.pixel_samples, FEW_RAYS)
    lit, mirror = _lit(change, sight, places, sun, rays)
    sunless = None if job.sunless is None else job.sunless[top : top + len(photo)].ravel()[index]
    _shade(change, (sight, lit, mirror, sunless), index, photo, band, high)
    return whole


class _Lit(NamedTuple):
    """Irradiance (K, 3) of pixels without and with furniture, the sun's own apart."""

    old: Floats
    new: Floats
    old_sun: Floats
    new_sun: Floats


def _of(change: Change, sight: Sight, places: Places) -> Floats:
    """Return the radiance (N, 3) of furniture along rays, several of a pixel: each has a share of its own rays."""
    shown, rays = np.zeros((1, len(sight.label), 3), np.float32), (1 + change.effort.pixel_samples // 4, FEW_RAYS // 4)
    sun = sun_of(change.full, sight, RIM_RAYS, change.seed + int(places.row[0]), None, 1)
    lit, mirror = _lit(change, sight, places, (sun, sun), rays)
    band = Band(shown, *np.zeros((2, *shown.shape[:2]), bool))
    _shade(change, (sight, lit, mirror, None), np.arange(len(sun)), shown, band, places.high)
    return np.asarray(shown[0])


def _lit(
    change: Change, sight: Sight, places: Places, sun: tuple[Floats, Floats], rays: tuple[int, int]
) -> tuple[_Lit, Floats]:
    """Return the light of pixels (K), in ``sun`` without and with furniture, and what they mirror (K, 9 or 0).

    ``rays``: from what no small pixel shows, for its light and for what it mirrors."""
    light, missed, mirror, unmirrored = _upsampled(change, sight, places)
    seed, furniture = change.seed + int(places.row[0]), sight.label >= FIRST_PART
    lit = _Lit(light[:, :3], light[:, 3:], *sun)
    alone = np.flatnonzero(missed & sight.solid)
    alone = alone[np.argsort(furniture[alone], kind="stable")]  # the room's first: they meet the same chance in both
    pairs = (change.bare, alone[~furniture[alone]], lit.old), (change.full, alone, lit.new)
    for (stage, mine, light), known in zip(pairs, change.lights, strict=True):
        if len(mine):
            where = sight.point[mine], sight.normal[mine], rays[0], seed
            light[mine] = gathered(stage, known, *where)
            _even_out(sight, mine, light)
    if change.mirrors is not None:
        chosen = np.flatnonzero(furniture & (unmirrored | np.isin(sight.label, change.mirrors.metals)))
        seen = sight.some(chosen), lit.new_sun[chosen]
        mirror[chosen, 6:9] = furniture_highlights(change.mirrors.around, *seen, rays[1], (seed, 92), 0.0)
    return lit, mirror


def _even_out(sight: Sight, pixels: Indices, light: Floats) -> None:
    """Replace the light (N, 3) of pixels (K,) by the mean over those of a thing that face alike within `EVEN_M`.

    What no small pixel shows (a curtain's folds, a wall behind a slit) is gathered by few rays a pixel: it was grainy.
    """
    cell = np.concatenate([sight.point[pixels] / EVEN_M, 4 * sight.normal[pixels]], axis=1)
    keys = np.floor(cell).astype(np.int64) @ (1, 1 << 12, 1 << 24, 1 << 36, 1 << 40, 1 << 44)
    keys += sight.label[pixels].astype(np.int64) << 48
    _, group, count = np.unique(keys, return_inverse=True, return_counts=True)
    for k in range(3):
        light[pixels, k] = (np.bincount(group, light[pixels, k]) / count)[group]


def _spread(sight: Sight, index: Indices, shape: tuple[int, int]) -> Sight:
    """Return a band's sight of which some pixels (K,) were looked at."""

    def over(values: np.ndarray, empty: float) -> np.ndarray:
        out = np.full((shape[0] * shape[1], *values.shape[1:]), empty, values.dtype)
        out[index] = values
        return out

    rays = np.zeros((shape[0] * shape[1], 0), np.float32)
    label, far = over(sight.label, NOTHING), over(sight.distance_m, np.inf)
    return Sight(shape, rays, label, label, far, over(sight.point, 0), over(sight.normal, 0), np.empty(0, np.int32))


def _sunlight(change: Change, whole: Sight, index: Indices, seed: int, high: int) -> tuple[Floats, Floats]:
    """Return the sun's irradiance (K, 3) without and with furniture of a band's pixels."""
    # Of a large picture several pixels share the width of a half shadow.
    samples = max(change.effort.sun_samples // (4 if high > LARGE_ROWS else 1), 8)
    block, among = block_px(math.pi / high), np.zeros(len(whole.label), bool)
    furniture = whole.label[index] >= FIRST_PART
    among[index] = ~furniture
    old = sun_of(change.bare, whole, samples, seed, among, block)[index]
    # Furniture brings no new sun to the room: only where it fell before it can fall now.
    among[index] = furniture | ~_all_three(old == 0)
    return old, sun_of(change.full, whole, samples, seed, among, block)[index]


def _all_three(flags: Flags) -> Flags:
    """Return whether all of three channels (..., 3) are set; NumPy's own reduction over three is slow."""
    return flags[..., 0] & flags[..., 1] & flags[..., 2]


def _shade(
    change: Change, seen: tuple[Sight, _Lit, Floats, Flags | None], mine: Indices, photo: Floats, band: Band, high: int
) -> None:
    """Fill pixels of the band that were looked at."""
    sight, lit, mirror, sunless = seen
    full = change.full
    albedo, emission = albedo_of(full, sight, math.pi / high), emission_of(full, sight)
    matte = matte_share(full, sight)[:, 0]
    empty = np.zeros(len(mine), bool) if sunless is None else sunless
    given = _Given(mine, sight.label, *lit, albedo, emission, matte, mirror, empty)
    shape = photo.shape
    _shade_all(given, _WEIGHTS, photo, Band(band.shown.reshape(shape), band.kept, band.todo))


class _Given(NamedTuple):
    """What is known of pixels (K), for compiled loops."""

    at: Indices
    label: Int32s
    old: Floats
    new: Floats
    old_sun: Floats
    new_sun: Floats
    albedo: Floats
    emission: Floats
    matte: Floats
    mirror: Floats
    sunless: Flags


@compiled
def _shade_all(given, weights, photo, band):  # type: ignore[no-untyped-def]
    """Fill a band's looked-at pixels: furniture with its own light, the room with the photograph times its change."""
    gain, wide = np.empty(3, np.float32), photo.shape[1]
    for n in range(given.at.shape[0]):
        i, j = given.at[n] // wide, given.at[n] % wide
        furniture, solid = given.label[n] >= FIRST_PART, given.label[n] >= 0
        band.kept[i, j] = False
        if furniture:
            for c in range(3):
                light = given.albedo[n, c] * given.matte[n] * (given.new[n, c] + given.new_sun[n, c])
                own = light / np.float32(math.pi) + given.emission[n, c]
                band.shown[i, j, c] = own + (given.mirror[n, 6 + c] if given.mirror.shape[1] > 0 else np.float32(0))
            continue
        _gain(given, weights, photo[i, j], n, gain)
        for c in range(3):
            band.shown[i, j, c] = photo[i, j, c] * gain[c]
        if solid and given.mirror.shape[1] > 0:
            add_mirrored(given.mirror[n, :3], given.mirror[n, 3:6], gain, weights, photo, i, j, band.shown)
        changed = False
        for c in range(3):
            changed |= much(band.shown[i, j, c], photo[i, j, c])
        if not solid or not changed:
            band.kept[i, j] = True
            for c in range(3):
                band.shown[i, j, c] = photo[i, j, c]


@inlined
def _gain(given, weights, photo, n, gain):  # type: ignore[no-untyped-def]
    """Fill by how much furniture changes (3,) what a pixel of the room shows, ``photo`` (3,)."""
    gain[:] = np.float32(1)
    modelled = dark = shown = sun = np.float32(0)
    for c in range(3):
        part = given.albedo[n, c] / np.float32(math.pi)
        dark += weights[c] * (part * given.old[n, c] + given.emission[n, c])
        modelled += weights[c] * part * given.old_sun[n, c]
        shown += weights[c] * photo[c]
        sun += weights[c] * given.old_sun[n, c]
    modelled, shown = max(modelled + dark, np.float32(1e-6)), max(shown, np.float32(1e-6))
    # Where the photograph does not show the sun that the model expects, only the rest of the light is compared; but
    # where removal took it away, or filled what furniture had shaded, it falls now, unless nothing but it explains what
    # is shown: of a half shadow's rim both are as likely, and a patch that falls elsewhere now left a dark hair line.
    without = given.sunless[n] and abs(math.log(max(dark, np.float32(1e-6)) / shown)) < MISFIT
    sunny = sun > 0 and not without and abs(math.log(modelled / shown)) < MISFIT
    returns = given.sunless[n] and not sunny
    if given.label[n] < 0:
        return
    for c in range(3):
        part = given.albedo[n, c] / np.float32(math.pi)
        if part * (given.old[n, c] + (given.old_sun[n, c] if sunny else np.float32(0))) + given.emission[n, c] <= 0:
            return
    most = new_sun = np.float32(0)
    for c in range(3):
        part = given.albedo[n, c] / np.float32(math.pi)
        above = given.new[n, c] + (given.new_sun[n, c] if sunny or returns else np.float32(0))
        below = given.old[n, c] + (given.old_sun[n, c] if sunny else np.float32(0))
        gain[c] = max((part * above + given.emission[n, c]) / (part * below + given.emission[n, c]), np.float32(0))
        most, new_sun = max(most, gain[c]), new_sun + given.new_sun[n, c]
    if most > MOST_GAIN and not (returns and new_sun > 0):
        gain *= np.float32(MOST_GAIN) / most
