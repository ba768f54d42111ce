"""Furniture put into the calibrated photograph, in cd/m2.

``differential``: the photograph is kept; furniture is rendered, and what it changes of the light on the room (shade,
bounced light, shadows in the sun) is the ratio of two renders of the same places with the same random numbers, with and
without it. Pixels whose light does not change are kept bit by bit.
``ibl``: furniture lit by the panorama alone, as if all of it lay infinitely far away; it changes nothing in the room.
``inverse_tone_curve`` makes such a panorama from an ordinary 8-bit one, the baseline of calibrated pictures.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from processing.errors import ParameterError
from processing.images import LUMINANCE_WEIGHTS
from processing.rendering.chance import random
from processing.rendering.denoise import denoised
from processing.rendering.irradiance import EFFORTS, Effort, Irradiance, irradiance_of
from processing.rendering.kernels import cosine_rays
from processing.rendering.render import shaded, small_geometry, sun_of
from processing.rendering.scene import Floats, Part, Scene, Vector
from processing.rendering.sight import FIRST_PART, Sight, albedo_of, emission_of, looked_up, sight_of
from processing.rendering.stage import RAYS_AT_ONCE, Stage
from processing.rendering.upsample import upsampled
from processing.sphere import Equirectangular

LEAST_CHANGE = 0.004
"""Relative: a smaller change of light is within the noise, and the photograph's pixel is kept as it is."""
MOST_GAIN = 4.0
"""By which new furniture may brighten a place of the room."""
MISFIT = 0.5
"""Of log luminance between photograph and model, beyond which the model's sun is not believed."""


@dataclass(frozen=True)
class Staged:
    """A photograph with furniture in it."""

    rgb: Floats
    """(H, W, 3) cd/m2."""
    furniture: np.ndarray
    """(H, W): where furniture is seen."""
    kept: np.ndarray
    """(H, W): where the photograph is kept bit by bit."""
    ratio: Floats
    """(H, W): the change of luminance in the rest."""
    error: float
    """Relative standard error of the furnished room's irradiance."""


def differential(
    photograph: Floats,
    room: Scene,
    parts: tuple[Part, ...],
    eye_m: Vector,
    *,
    effort: Effort = EFFORTS["standard"],
    seed: int = 0,
) -> Staged:
    """Return the photograph (H, 2 H, 3) of a room with furniture added.

    ``room`` is the empty room with its albedo, under the light of the photograph (`albedo.RoomAlbedo.scene`).
    """
    geometry = _panorama(photograph)
    if not parts:
        none = np.zeros(photograph.shape[:2], bool)
        return Staged(photograph.copy(), none, ~none, np.ones(photograph.shape[:2], np.float32), 0.0)
    bare, full = Stage.of(room, effort.texel_m), Stage.of(room.furnished(parts), effort.texel_m)
    small = sight_of(full, small_geometry(geometry, effort.rows), eye_m)
    after = irradiance_of(full, small, effort, seed, wraps=True)
    # The same places, on furniture too, so that both meet the same chance.
    same = replace(effort, max_error=1e-12, budget_s=None, most_rounds=after.rounds)
    before = irradiance_of(bare, small, same, seed, wraps=True)
    large = sight_of(full, geometry, eye_m)
    furniture = large.label >= FIRST_PART
    ratio = _change(bare, full, before, after, small, large, photograph, effort, seed)
    kept = ~furniture & ((np.abs(ratio - 1) < LEAST_CHANGE).all(axis=1) | ~large.solid)
    rendered = shaded(full, small, after, geometry, eye_m, effort=effort, seed=seed).reshape(-1, 3)
    flat = photograph.reshape(-1, 3)
    out = np.where(kept[:, None], flat, np.where(furniture[:, None], rendered, flat * ratio)).astype(np.float32)
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    shape = photograph.shape[:2]
    return Staged(
        out.reshape(photograph.shape),
        furniture.reshape(shape),
        kept.reshape(shape),
        np.where(kept, 1, ratio @ weights).reshape(shape).astype(np.float32),
        after.error,
    )


def _panorama(photograph: Floats) -> Equirectangular:
    if photograph.ndim != 3 or photograph.shape[1:] != (2 * photograph.shape[0], 3):
        raise ParameterError(f"a photograph of shape {photograph.shape}", advice="give a whole panorama (H, 2 H, 3)")
    if not np.isfinite(photograph).all() or (photograph < 0).any():
        raise ParameterError("a photograph with values that light cannot have", advice="give finite values from 0")
    return Equirectangular(photograph.shape[1], photograph.shape[0])


def _without_furniture(sight: Sight) -> Sight:
    """Return the same places, of which those on furniture count as nothing."""
    hidden = sight.label >= FIRST_PART
    return replace(sight, label=np.where(hidden, -1, sight.label).astype(np.int32))


def _change(
    bare: Stage,
    full: Stage,
    before: Irradiance,
    after: Irradiance,
    small: Sight,
    large: Sight,
    photograph: Floats,
    effort: Effort,
    seed: int,
) -> Floats:
    """Return by what (n, 3) the light changes on the room's own surfaces; 1 elsewhere."""
    shell = _without_furniture(large)
    old, _ = upsampled(before.picture, small, shell, wraps=True)
    new, missed = upsampled(after.picture, small, shell, wraps=True)
    old_sun = sun_of(bare, shell, effort.sun_samples, seed)
    new_sun = sun_of(full, shell, effort.sun_samples, seed)
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    modelled = (albedo_of(bare, shell) * (old + old_sun) / np.float32(np.pi)) @ weights
    shown = photograph.reshape(-1, 3) @ weights
    fits = np.abs(np.log(np.maximum(modelled, 1e-6) / np.maximum(shown, 1e-6))) < MISFIT
    sunny = (old_sun @ weights > 0) & fits
    # Where the photograph does not show the sun that the model expects, only the rest of the light is compared.
    above = new + np.where(sunny[:, None], new_sun, 0)
    below = old + np.where(sunny[:, None], old_sun, 0)
    usable = shell.solid & ~missed & (below > 0).all(axis=1)
    ratio = np.where(usable[:, None], above / np.where(usable[:, None], below, 1), 1)
    return np.clip(ratio, 0, MOST_GAIN).astype(np.float32)


def ibl(
    photograph: Floats,
    parts: tuple[Part, ...],
    eye_m: Vector,
    room: Scene,
    *,
    samples: int = 64,
    clean: bool = True,
    seed: int = 0,
) -> Staged:
    """Return the photograph with furniture lit by the photograph alone; ``room`` only hides what is behind walls."""
    geometry = _panorama(photograph)
    full = Stage.of(room.furnished(parts), 0.2)
    sight = sight_of(full, geometry, eye_m)
    furniture = np.flatnonzero(sight.label >= FIRST_PART)
    alone = Stage.of(Scene((), (), room.outdoors, parts), 0.2) if parts else None
    light = np.zeros((len(sight.label), 3), np.float32)
    if alone is not None and len(furniture):
        light[furniture] = _from_afar(alone, photograph, sight.point[furniture], sight.normal[furniture], samples, seed)
    shaped = light.reshape(photograph.shape)
    if clean:
        there = (sight.label >= FIRST_PART).reshape(sight.shape)
        near = np.where(there, 1 / (1 + sight.distance_m.reshape(sight.shape)), 0).astype(np.float32)
        shaped = denoised(shaped, sight.normal.reshape(photograph.shape) * there[..., None], near, wraps=True)
    rendered = albedo_of(full, sight) * shaped.reshape(-1, 3) / np.float32(np.pi) + emission_of(full, sight)
    mask = (sight.label >= FIRST_PART).reshape(sight.shape)
    rgb = np.where(mask[..., None], rendered.reshape(photograph.shape), photograph).astype(np.float32)
    return Staged(rgb, mask, ~mask, np.ones(sight.shape, np.float32), 0.0)


def _from_afar(stage: Stage, panorama: Floats, points: Floats, normals: Floats, samples: int, seed: int) -> Floats:
    """Return the irradiance (n, 3) of places lit by a panorama at infinity; what furniture hides gives no light."""
    out = np.zeros((len(points), 3), np.float32)
    shifts = random((seed, 70), len(points), 2)
    at_once = max(1, RAYS_AT_ONCE // samples)
    for start in range(0, len(points), at_once):
        part = slice(start, start + at_once)
        count = len(points[part])
        origins, rays = np.empty((2, count, samples, 3), np.float32)
        cosine_rays(points[part][:, None, :], normals[part], shifts[part], 0, samples, origins, rays)
        flat = rays.reshape(-1, 3)
        hits = stage.tracer.cast(origins.reshape(-1, 3), flat)
        seen = np.where((hits.triangle < 0)[:, None], looked_up(panorama, flat), 0)
        out[part] = np.pi * seen.reshape(count, samples, 3).mean(axis=1)
    return out


def inverse_tone_curve(picture: np.ndarray, white_cd_m2: float, *, gamma: float = 2.2) -> Floats:
    """Return an 8-bit panorama (H, W, 3) as radiance by a plain inverse power law, full white at ``white_cd_m2``."""
    if picture.dtype != np.uint8 or not white_cd_m2 > 0:
        raise ParameterError("an inverse tone curve takes 8-bit pictures and a white above 0 cd/m2")
    return ((picture.astype(np.float32) / 255) ** gamma * white_cd_m2).astype(np.float32)
