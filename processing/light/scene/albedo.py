"""Albedo of a room's surfaces from its calibrated, emptied panorama: pi times radiance over irradiance.

Irradiance comes from the panorama itself (`room_light`), so no albedo is needed to find albedo. Where the sun falls is
known from geometry up to errors of the model and to what it leaves out, bars of a window for instance: near the
sun's patch every pixel is taken as sunlit or not by what fits its surface better. Pixels that cannot be measured
(clipped, nearly dark, in half shadow, hidden) take what their surface shows; what differs on one surface without an
edge is light that was estimated wrong, and goes (`painted`).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import maximum_filter

from processing.errors import AlbedoError
from processing.ground.arrays import Doubles, Flags, Floats, Vector, carried_on, weighted_median
from processing.ground.room_model import RoomModel
from processing.ground.seam import resized
from processing.light.scene import room_light, sources
from processing.light.scene.scene import REVEAL_M, Outdoors, Part, Scene, plain, shell_of
from processing.light.solver.irradiance import Effort
from processing.light.solver.kernels import FURNITURE
from processing.light.solver.sight import Sight, albedo_of, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.light.solver.upsample import upsampled
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.sphere import Equirectangular, solid_angles
from processing.sphere.resampling import resample
from processing.surfaces.maps import FLOOR, planes_of
from processing.surfaces.textures import Texture, unwrap

LEAST_ALBEDO, MOST_ALBEDO = 0.02, 0.95  # of real surfaces: soot 0.02 to 0.04, fresh white paint 0.9
DARK_SHARE = 0.01  # of the median irradiance, below which albedo is not measured
HALF_SHADOW = 0.35  # of log albedo from its surface's: a pixel near the sun's patch that fits neither is left out
PX_PER_M = 50.0  # texels of 2 cm; chosen, never swept
DARK = np.zeros((32, 64, 3), np.float32)
DARK.setflags(write=False)
"""Outdoors of which nothing is known."""


@dataclass(frozen=True)
class RoomAlbedo:
    """What a room's surfaces reflect, and the scene that they make."""

    picture: Floats
    """(H, W, 3): albedo of the panorama's pixels, 0 through windows; hidden ones filled."""
    uncertainty: Floats
    """(H, W): relative standard uncertainty; 1 where the value is filled in."""
    measured: np.ndarray
    """(H, W): whether the albedo was measured at the pixel itself."""
    irradiance: Floats
    """(H, W, 3) lx, sun included."""
    scene: Scene
    """The empty room with these albedos as textures, under the light it was pictured in."""
    transmittance: Mapping[int, Vector]
    """By opening."""
    gloss: float
    """How much of full varnish the floor mirrors, 0 to 1; it is taken out of its albedo."""
    lamps: tuple[sources.Lamp, ...]
    """What gives light by itself, the strongest first; its light is in the scene."""
    notes: tuple[str, ...]


@dataclass(frozen=True)
class KnownLight:
    """The empty room's light as it was estimated with its furniture still in it (`furnished`)."""

    scene: Scene
    """The bare room, its windows as they were measured."""
    irradiance_lx: Floats
    """(H, W, 3) without the sun's own disc, in the size of the albedo picture."""
    error: Floats
    """(H, W): relative standard uncertainty."""


def albedo_of_room(
    panorama: LuminanceImage,
    room: RoomModel,
    outdoors: Outdoors | KnownLight | None,
    *,
    reveal_m: float = REVEAL_M,
    filled: np.ndarray | None = None,
    rows: int = 512,
    effort: Effort | None = None,
    seed: int = 0,
) -> RoomAlbedo:
    """Return the albedo of a room's surfaces.

    ``panorama``: the emptied room, upright, equirectangular, in cd/m2.
    ``outdoors``: the light outside at the same moment; None: nobody knows, the windows light as they look from inside.
      Where the light in the room is known already, that: it is not gathered anew.
    ``filled`` (H, W): pixels that removal filled in; they light the room but show no albedo of their own.
    ``rows``: height of the albedo picture; the panorama is brought to it, keeping energy.
    Raises `AlbedoError`: a picture without light, or of no whole panorama; `RoomError`: the room cannot stand.
    """
    effort = effort or Effort(pixel_samples=32)
    rgb, valid = brought_to(panorama, rows, filled)
    known = outdoors if isinstance(outdoors, KnownLight) else None
    if isinstance(outdoors, KnownLight):
        notes: tuple[str, ...] = ("the light is as found with the furniture in the room",)
        stage = Stage.of(outdoors.scene, effort.texel_m)
        transmittance = {pane.opening: pane.transmittance for pane in outdoors.scene.panes}
    else:
        stage, transmittance, notes = lit_stage(room, outdoors, rgb, valid, reveal_m, effort.texel_m)
    eye = (0.0, 0.0, room.camera_height_m)
    sight = sight_of(stage, Equirectangular(2 * rows, rows), eye)
    gathered = _gathered(stage, rgb, sight, eye, effort, seed, known)
    flat, highlight, gloss = _without_gloss(stage, gathered, sight, rgb, valid.ravel(), effort, seed)
    if gloss and known is None:
        # What the floor mirrors towards the camera is not what it gives to the room.
        gathered = _gathered(stage, flat.reshape(rgb.shape).astype(np.float32), sight, eye, effort, seed)
    if stage.scene.outdoors.sun is not None and stage.scene.outdoors.sun.clipped:
        due = sun_of(stage, sight, effort.sun_samples, seed)
        stage, said = _sun_as_seen(stage, flat, gathered.sky, due, sight, valid.ravel() & ~highlight)
        notes += said
    sky, sun, error = gathered.sky, sun_of(stage, sight, effort.sun_samples, seed), gathered.error
    full = sources.open_sun(stage, sight)
    value, whole, measured = _values(
        flat, sky.astype(np.float64), sun.astype(np.float64), full, sight, valid.ravel() & ~highlight
    )
    made_up = np.zeros(sight.shape) if filled is None else resized(filled.astype(np.float32), sight.shape)
    # Where no light is known (slivers and reveals finer than the small picture), nothing is brighter than that.
    usable = ~sources.near_sun(stage, sight) & (made_up.ravel() == 0) & (sky > 0).any(axis=1)
    emission, lamps = sources.find_lamps(flat, whole, _usual(value, sight, measured), sight, usable)
    measured &= ~emission.any(axis=1)
    error_here = cv2.resize(error, (2 * rows, rows), interpolation=cv2.INTER_LINEAR).ravel()
    doubt = np.where(measured, np.hypot(error_here, 0.02), 1.0).astype(np.float32)
    scene, picture = _textured(stage.scene, room, sight, value, measured, (emission, gloss))
    notes += (f"{100 * measured[sight.solid].mean():.0f} % of pixels have a measured albedo",)
    notes += (f"floor: gloss {gloss:.2f} of full varnish" if gloss else "floor: no gloss measured, assumed matte",)
    shape = sight.shape
    maps = picture.reshape(*shape, 3), doubt.reshape(shape), measured.reshape(shape)
    irradiance = whole.reshape(*shape, 3).astype(np.float32)
    return RoomAlbedo(*maps, irradiance, scene, transmittance, gloss, tuple(lamps), notes)


def brought_to(panorama: LuminanceImage, rows: int, filled: Flags | None) -> tuple[Floats, Flags]:
    """Return a whole panorama at a height of ``rows``: its light (ROWS, 2 ROWS, 3) cd/m2, and where it is measured.

    Measured are pixels (ROWS, 2 ROWS) that are valid and not ``filled`` (H, W). Raises `AlbedoError` for a picture
    without light, or of no whole panorama.
    """
    source = panorama.geometry
    if not isinstance(source, Equirectangular) or source.yaw_rad != 0 or source.width_px != 2 * source.height_px:
        raise AlbedoError("not a whole panorama", where="panorama", advice="convert it to equirectangular, 2:1")
    if not np.isfinite(panorama.rgb).all() or not (panorama.rgb > 0).any():
        raise AlbedoError("no light in the picture", where="panorama", advice="check its calibration")
    gone = np.zeros_like(panorama.validity, bool) if filled is None else filled
    good = (panorama.validity == Validity.VALID) & ~gone
    if source.height_px == rows:
        return panorama.rgb, good
    target = Equirectangular(2 * rows, rows)
    rgb, _ = resample(panorama.rgb, source, target)
    share, _ = resample(good.astype(np.float32), source, target)
    return rgb, share > 0.99


def lit_stage(
    room: RoomModel,
    outdoors: Outdoors | None,
    rgb: Floats,
    valid: Flags,
    reveal_m: float,
    texel_m: float,
    parts: tuple[Part, ...] = (),
) -> tuple[Stage, dict[int, Vector], tuple[str, ...]]:
    """Return the room under its light with windows that let through what a picture (H, 2 H, 3), cd/m2, shows of them.

    Of use are pixels that are ``valid`` (H, 2 H); ``parts`` stand in the room, and before its windows. With the stage
    come the glass's transmittance by opening, where it could be measured, and notes.
    """
    surfaces, panes = shell_of(room, reveal_m=reveal_m)
    eye = (0.0, 0.0, room.camera_height_m)
    stage = Stage.of(Scene(surfaces, panes, outdoors or Outdoors(DARK), parts), texel_m)
    if outdoors is None:
        lit = stage.under(stage.scene.outdoors, sources.windows_from_inside(stage, rgb, eye))
        note = "no picture of the sky: window light is taken as seen from inside, and transmittance is unknown"
        return lit, {}, (note,) if panes else ()
    sight = sight_of(stage, Equirectangular(2 * rgb.shape[0], rgb.shape[0]), eye)
    clear, measured, known = sources.measured_windows(stage, sight, rgb, valid, eye)
    note = "the windows' transmittance cannot be measured: double glazing is assumed"
    notes = () if known or not panes else (note,)
    return stage.under(measured, clear), {pane.opening: pane.transmittance for pane in clear}, notes


@dataclass(frozen=True)
class _Gathered:
    """The light in the room as a picture of it shows."""

    light: room_light.MeasuredLight
    sky: Floats
    """(N, 3): irradiance of its pixels without the sun's own."""
    error: Floats
    """(H, W): relative, at the small size."""


def _gathered(
    stage: Stage, rgb: Floats, sight: Sight, eye: Vector, effort: Effort, seed: int, known: KnownLight | None = None
) -> _Gathered:
    """Return the light that a picture (H, W, 3) shows, which sees ``sight``; what is ``known`` is not gathered."""
    if known is not None:
        light = room_light.measured_light(stage, rgb, sight, eye, (seed, 60))
        return _Gathered(light, known.irradiance_lx.reshape(-1, 3), known.error)
    rows = min(effort.rows, len(rgb))
    small = sight_of(stage, Equirectangular(2 * rows, rows), eye)
    light = room_light.measured_light(stage, rgb, sight, eye, (seed, 60))
    base, error = room_light.irradiance_by_picture(stage, light, small, effort, seed)
    sky, _ = upsampled(base, small, sight, wraps=True)
    return _Gathered(light, sky, error)


def _without_gloss(
    stage: Stage, gathered: _Gathered, sight: Sight, picture: Floats, valid: np.ndarray, effort: Effort, seed: int
) -> tuple[Doubles, np.ndarray, float]:
    """Return radiance (N, 3) without what the floor mirrors, pixels (N,) that mirror too much, and how glossy it is."""
    rgb = picture.reshape(-1, 3).astype(np.float64)
    highlight = np.zeros(len(rgb), bool)
    irradiance = gathered.sky + sun_of(stage, sight, effort.sun_samples, seed)
    floor = np.flatnonzero((sight.label == FLOOR) & (irradiance > 0).all(axis=1))
    if not len(floor):
        return rgb, highlight, 0.0
    mirror, window = room_light.mirrored(stage, gathered.light, sight, floor)
    part = math.pi / irradiance[floor].astype(np.float64)
    sunny = sources.near_sun(stage, sight)[floor]
    gloss = room_light.gloss_factor(part * rgb[floor], part * mirror, valid[floor] & ~window & ~sunny)
    rgb[floor] = np.maximum(rgb[floor] - gloss * mirror, 0)
    highlight[floor] = (gloss * mirror > room_light.MOST_SHARE * picture.reshape(-1, 3)[floor]).any(axis=1)
    return rgb, highlight, gloss


def _sun_as_seen(
    stage: Stage, rgb: Doubles, sky: Floats, sun: Floats, sight: Sight, valid: np.ndarray
) -> tuple[Stage, tuple[str, ...]]:
    """Return the stage under the strength of its overexposed sun that its patches show, and notes (see `_values`)."""
    weights, near, seen = np.asarray(LUMINANCE_WEIGHTS), sources.near_sun(stage, sight), sight.solid & valid
    usual = _usual(math.pi * rgb / np.maximum(sky, 1e-9), sight, seen & ~near & (sky > 0).all(axis=1))
    area = solid_angles(Equirectangular(sight.shape[1], sight.shape[0])).ravel()
    parts = ((one @ weights * area)[seen & near] for one in (math.pi * rgb, usual * sky, usual * sun))
    share = sources.sun_strength(stage.scene.outdoors.sun, *parts)
    outdoors = sources.under_share(stage.scene.outdoors, share)
    return stage.under(outdoors, stage.scene.panes), sources.sun_note(stage.scene.outdoors.sun, share)


def _values(
    rgb: Doubles, sky: Doubles, sun: Doubles, full: Doubles, sight: Sight, valid: np.ndarray
) -> tuple[Doubles, Doubles, np.ndarray]:
    """Return albedo (N, 3), irradiance with the sun (N, 3), and which pixels are measured (see the module)."""
    weights = np.asarray(LUMINANCE_WEIGHTS)
    level = sky @ weights
    bright_enough = level > DARK_SHARE * np.median(level[sight.solid]) if sight.solid.any() else sight.solid
    measured = sight.solid & valid & bright_enough & (rgb @ weights > 0)
    doubtful = (full @ weights) > 0
    shade = math.pi * rgb / np.maximum(sky, 1e-9)
    whole = sky + sun
    usual = _usual(shade, sight, measured & ~doubtful)
    lit = math.pi * rgb / np.maximum(sky + full, 1e-9)
    with np.errstate(divide="ignore"):
        as_shade = np.abs(np.log(np.maximum(shade @ weights, 1e-9) / (usual @ weights)))
        as_lit = np.abs(np.log(np.maximum(lit @ weights, 1e-9) / (usual @ weights)))
    sunny = doubtful & (as_lit < as_shade)
    fits = np.minimum(as_lit, as_shade) < HALF_SHADOW * (1 + _spread(shade, usual, sight, measured & ~doubtful))
    value = np.where(sunny[:, None], lit, shade)
    whole = np.where(sunny[:, None], sky + full, np.where(doubtful[:, None], sky, whole))
    measured &= ~doubtful | fits
    return np.clip(value, LEAST_ALBEDO, MOST_ALBEDO), whole, measured


def _usual(value: Doubles, sight: Sight, among: np.ndarray) -> Doubles:
    """Return for each pixel the median (3,) of its surface's values; of all where its surface has none."""
    out = np.full(value.shape, 0.5)
    if among.any():
        out[:] = np.median(value[among], axis=0)
    for label in np.unique(sight.label[sight.solid]):
        mine = sight.label == label
        if (mine & among).sum() >= 8:
            out[mine] = np.median(value[mine & among], axis=0)
    return np.asarray(np.maximum(out, LEAST_ALBEDO))


def _spread(value: Doubles, usual: Doubles, sight: Sight, among: np.ndarray) -> Doubles:
    """Return for each pixel how many times its surface varies more than paint does (quartiles of log albedo)."""
    weights = np.asarray(LUMINANCE_WEIGHTS)
    ratio = np.abs(np.log(np.maximum(value @ weights, 1e-9) / (usual @ weights)))
    out = np.zeros(len(value))
    for label in np.unique(sight.label[sight.solid]):
        mine = sight.label == label
        if (mine & among).sum() >= 8:
            out[mine] = min(float(np.quantile(ratio[mine & among], 0.75)) / HALF_SHADOW, 2.0)
    return out


def _textured(
    scene: Scene, room: RoomModel, sight: Sight, value: Doubles, measured: np.ndarray, besides: tuple[Floats, float]
) -> tuple[Scene, Floats]:
    """Return the scene with albedo and lamps as textures, and the albedo picture with untold pixels taken from them.

    ``besides``: what pixels give off by themselves (N, 3), cd/m2, and how glossy the floor is."""
    emission, gloss = besides
    geometry = Equirectangular(sight.shape[1], sight.shape[0])
    usual = _usual(value, sight, measured)
    shaped = value.reshape(*sight.shape, 3).astype(np.float32)
    planes = planes_of(room)
    surfaces = []
    for number, surface in enumerate(scene.surfaces):
        mine = (sight.label == number) & measured
        # Pixels beside another surface, a window, a lamp or what was removed may show some of it.
        inner = cv2.erode(mine.reshape(sight.shape).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        whole = usual[measured].mean(axis=0) if measured.any() else np.full(3, 0.5)
        colour = np.median(value[mine], axis=0) if mine.sum() >= 8 else whole
        texture = plain(tuple(colour))
        if surface.plane >= 0 and mine.any():
            hidden = ~(inner if inner.any() else mine.reshape(sight.shape))
            found = unwrap(shaped, geometry, room, planes[surface.plane], PX_PER_M, mask=hidden)
            texture = painted(found) if found.known.any() else texture
        emits = plain(0.0)
        if surface.plane >= 0 and emission[sight.label == number].any():
            other = (sight.label != number).reshape(sight.shape)
            shining = emission.reshape(*sight.shape, 3)
            seen = unwrap(shining, geometry, room, planes[surface.plane], PX_PER_M, mask=other)
            emits = np.where(seen.known[..., None], seen.values, np.float32(0))
        shine = gloss if surface.plane == FLOOR else surface.gloss
        surfaces.append(replace(surface, albedo=texture, emission_cd_m2=emits, gloss=shine))
    textured = replace(scene, surfaces=tuple(surfaces))
    return textured, albedo_of(Stage.of(textured, 1.0), sight)


STEP, PLAIN, FINE_M, REACH_M, OTHER = 0.04, 0.025, 0.1, 0.5, 0.7
"""Natural logarithm: a texel's step that plain paint does not make, and how far plain paint is off its surroundings
within `FINE_M` (median; of 33 planes in five validation rooms 23 painted ones show 0.001 to 0.014, seven papered or of
wood 0.027 to 0.050, three floors 0.017 to 0.023). `REACH_M`: how far from an edge its step is believed; `OTHER`: what
is so far off the usual colour, twice as dark, is another thing and keeps its own (docs/measurements/albedo.md)."""


def painted(seen: Texture) -> Floats:
    """Return the albedo (H, W, 3) of a plane as it was measured: its usual colour, and what differs from it by edges.

    Errors of light are smooth, what is on a wall has edges: steps between texels are added up again (Retinex: Land and
    McCann 1971; Horn 1974) over a usual colour, to which they fall back within `REACH_M` (screened Poisson equation,
    Bhat and others 2008), or to their own where that is far off. On plain surfaces steps of noise count nothing; on
    others all do. The usual colour is the median weighted by certainty, the root of the pixels on a texel; texels that
    nobody saw take it too. ``seen.known`` has to hold some.
    """
    known, log = seen.known, np.log(np.maximum(seen.values, LEAST_ALBEDO))
    usual = weighted_median(log[known], np.sqrt(seen.density[known]))
    level, there = log @ np.asarray(LUMINANCE_WEIGHTS, np.float32), known.astype(np.float32)
    total, share = (cv2.GaussianBlur(one, (0, 0), FINE_M * PX_PER_M) for one in (level * there, there))
    least = STEP if np.median(np.abs(level - total / np.maximum(share, 1e-3))[known]) < PLAIN else 0.0
    pull = 1 / (REACH_M * PX_PER_M) ** 2
    other = known & (np.abs((log - usual) @ np.asarray(LUMINANCE_WEIGHTS)) > OTHER)
    bends, waves = pull * np.where(other[..., None], log - usual, 0.0), np.full(known.shape, pull)
    for axis, count in enumerate(known.shape):
        both = np.take(known, range(1, count), axis) & np.take(known, range(count - 1), axis)
        steps = np.where(both[..., None], np.diff(log, axis=axis), 0)
        steps *= (maximum_filter(np.abs(steps).max(axis=2), 3) > least)[..., None]
        pad = [(1, 1) if k == axis else (0, 0) for k in range(3)]
        bends -= np.diff(np.pad(steps, pad), axis=axis)
        waves += np.expand_dims(2 - 2 * np.cos(np.pi * np.arange(count) / count), 1 - axis)
    found = idctn(dctn(bends, axes=(0, 1)) / waves[..., None], axes=(0, 1))
    return np.asarray(np.clip(np.exp(usual + found), LEAST_ALBEDO, MOST_ALBEDO), np.float32)


def continued(values: Floats, known: Flags, colour: Doubles) -> Floats:
    """Return albedo (H, W, 3) whose texels that are not ``known`` (H, W) take the mean around them, ever farther.

    ``colour`` (3,) stands where nothing is known.
    """
    blurs = [partial(cv2.GaussianBlur, ksize=(0, 0), sigmaX=sigma) for sigma in (2.0, 8.0, 32.0)]
    return np.clip(carried_on(values, known, blurs, colour), LEAST_ALBEDO, MOST_ALBEDO)


def everywhere(stage: Stage, albedo: Doubles, known: Flags) -> Doubles:
    """Return albedo (P, 3) of all patches: hidden ones take that of their surface nearby, or of their own body."""
    out = np.clip(albedo, LEAST_ALBEDO, MOST_ALBEDO)
    p = stage.patches
    usual = np.median(out[known], axis=0) if known.any() else np.full(3, 0.5)
    for columns, rows, first in p.grids:
        mine = slice(first, first + columns * rows)
        texture = out[mine].reshape(rows, columns, 3).astype(np.float32)
        out[mine] = continued(texture, known[mine].reshape(rows, columns), usual).reshape(-1, 3)
    furniture = p.owner == FURNITURE
    body = np.full(p.count, -1)
    body[p.item[furniture]] = p.part[furniture]
    for number, part in enumerate(stage.scene.parts):
        mine = body == number
        shown = mine & known
        out[mine & ~known] = np.median(out[shown], axis=0) if shown.any() else part.material.colour
    return np.asarray(out)
