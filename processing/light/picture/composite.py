"""Furniture put into the calibrated photograph, in cd/m2.

``differential``: the photograph is kept; furniture is rendered, and what it changes of the light on the room (shade,
bounced light, shadows in the sun) is the ratio of two renders of the same places with the same random numbers, with and
without it. Pixels whose light does not change are kept bit by bit."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Flags, Floats, Indices, Vector
from processing.ground.kernels import compiled
from processing.ground.seam import components
from processing.ground.threads import give_back
from processing.light.picture.change import Change, in_bands, rays_of
from processing.light.picture.highlights import mirrors_of
from processing.light.picture.render import finer, small_geometry
from processing.light.scene.scene import Part, Scene
from processing.light.scene.tracer import tracer_of
from processing.light.solver.irradiance import EFFORTS, Effort, Lights, evened, irradiance_of
from processing.light.solver.sight import sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.upsample import Places
from processing.sphere import Equirectangular
from processing.surfaces.hanging import Hanging

PARTED, PARTED_PX = 0.1, 400
"""Of a patch of sun, from which furniture shades it and it falls anew as a whole: its photographed edge is not the
model's to the pixel, and a bright rim stayed round the shadow. And pixels of a patch that are tried. Chosen."""
MODELLED = 0.18
"""Relative standard uncertainty of what is not measured: furniture's colour, and the change of light around it. Of two
validation rooms, photographed at 1/16, it covers 95 % of the changed pixels; their errors have mostly one sign."""
CHANGE, MOST_CHANGE = 0.5, 2.0
"""The same for each e-fold by which furniture or shadow changes a pixel, up to so many; chosen: of a validation bedroom
those that change by more than 0.4 err by 0.44 to 0.73 (rms), and were covered at 77 %."""


@dataclass(frozen=True)
class Staged:
    """A photograph with furniture in it."""

    rgb: Floats
    """(H, W, 3) cd/m2."""
    furniture: np.ndarray
    """(H, W): where furniture is seen."""
    kept: np.ndarray
    """(H, W): where the photograph is kept bit by bit."""
    error: float
    """Relative standard error of the furnished room's irradiance."""


@dataclass(frozen=True)
class Bare:
    """A room without furniture made ready, for all that is put into it."""

    stage: Stage
    lights: Lights = field(default_factory=dict)

    @classmethod
    def of(cls, room: Scene, effort: Effort) -> Self:
        """Return a room made ready for pictures of this effort."""
        return cls(Stage.of(room, effort.texel_m))


def differential(
    photograph: Floats,
    room: Scene | Bare,
    parts: tuple[Part, ...],
    eye_m: Vector,
    *,
    effort: Effort = EFFORTS["standard"],
    seed: int = 0,
    sunless: np.ndarray | None = None,
) -> Staged:
    """Return the photograph (H, 2 H, 3) of a room with furniture added.

    ``room``: the empty room with its albedo, under the light of the photograph (`albedo.RoomAlbedo.scene`); made ready
      once (`Bare.of`) it serves several pictures.
    ``sunless`` (H, 2 H): pixels of which direct sunlight was taken away; they get it back where it falls now."""
    _panorama(photograph)
    if not parts and (sunless is None or not sunless.any()):
        return _untouched(photograph)
    bare = room if isinstance(room, Bare) else Bare.of(room, effort)
    return draw(changed(photograph, bare, parts, eye_m, effort=effort, seed=seed), photograph, sunless)


def changed(
    photograph: Floats, bare: Bare, parts: tuple[Part, ...], eye_m: Vector, *, effort: Effort, seed: int
) -> Change:
    """Return the light on a room without and with furniture, for `draw`; of ``photograph`` (H, 2 H, 3) its size."""
    geometry = _panorama(photograph)
    full = Stage.of(bare.stage.scene.furnished(parts), effort.texel_m) if parts else bare.stage
    small = sight_of(full, small_geometry(geometry, effort.rows), eye_m)
    lights: Lights = {}
    fine = finer(full, geometry, eye_m, effort)
    after = irradiance_of(full, small, effort, seed, wraps=True, lights=lights, fine=fine)
    # The same places, on furniture too, so that both meet the same chance.
    same = replace(effort, max_error=1e-12, budget_s=None, most_rounds=after.rounds)
    before = irradiance_of(bare.stage, small, same, seed, wraps=True, lights=bare.lights)
    if effort.clean:
        lit = np.asarray((before.picture > 0).all(axis=2), bool)
        after = replace(after, picture=evened(after.picture, before.picture, small, lit))
    first = min(lights)
    pair = (bare.lights[first], lights[first])
    return Change(bare.stage, full, small, before, after, pair, None, effort, seed, eye_m)


def draw(change: Change, photograph: Floats, sunless: Flags | None, hanging: Iterable[Hanging] = ()) -> Staged:
    """Return a photograph (H, 2 H, 3) under changed light, with furniture; ``sunless`` (H, 2 H): see `differential`.

    What is ``hanging`` from the ceiling is whole before what stands farther away; as it is in the room's middle, its
    light changes as that of the ceiling above it, not of the wall that it is seen before."""
    give_back()  # what light was made with
    seed, clean = change.seed, change.effort.clean
    mirrors = mirrors_of(change.bare, change.full, change.lights, photograph, change.eye_m, seed=seed, clean=clean)
    rgb, furniture, kept = in_bands(replace(change, mirrors=mirrors), photograph, sunless)
    for one in hanging:
        rays = rays_of(Places(one.row.astype(np.int32), one.column.astype(np.int32), *photograph.shape[:2]))
        eyes = np.broadcast_to(np.asarray(change.eye_m, np.float32), rays.shape)
        seen = change.full.tracer.cast(eyes, rays).distance_m * np.hypot(rays[:, 0], rays[:, 1]) > one.far_m
        at, share, gain = (one.row[seen], one.column[seen]), one.share[seen], np.ones(3, np.float32)
        if not furniture[one.mount]:
            gain = rgb[one.mount] / np.maximum(photograph[one.mount], np.float32(1e-6))
        rgb[at] += share[:, None] * (photograph[at] * gain - rgb[at])
        furniture[at] &= share < 0.5
        kept[at] = (rgb[at] == photograph[at]).all(axis=1)
    give_back()  # what it was drawn with
    return Staged(rgb, furniture, kept, change.after.error)


def _untouched(photograph: Floats) -> Staged:
    none = np.zeros(photograph.shape[:2], bool)
    return Staged(photograph.copy(), none, ~none, 0.0)


def _panorama(photograph: Floats) -> Equirectangular:
    if photograph.ndim != 3 or photograph.shape[1:] != (2 * photograph.shape[0], 3):
        raise ParameterError(f"a photograph of shape {photograph.shape}", advice="give a whole panorama (H, 2 H, 3)")
    if not (photograph.min(initial=0) >= 0 and photograph.max(initial=0) < np.inf):  # nor NaN, which both pass on
        raise ParameterError("a photograph with values that light cannot have", advice="give finite values from 0")
    return Equirectangular(photograph.shape[1], photograph.shape[0])


def patches_of_sun(sunlit: Flags | None) -> list[Indices]:
    """Return the flat pixels (N,) of each patch of sun (H, W) of a panorama; None: there are none."""
    labels = np.zeros(0, np.int32) if sunlit is None else components(sunlit)[1].ravel()
    pixels = np.flatnonzero(labels)
    pixels = pixels[np.argsort(labels[pixels], kind="stable")]
    return np.split(pixels, np.flatnonzero(np.diff(labels[pixels])) + 1)


def parted_sun(
    patches: list[Indices], shape: tuple[int, ...], bare: Bare, parts: tuple[Part, ...], eye_m: Vector
) -> Flags | None:
    """Return of patches of sun (`patches_of_sun`) of a panorama (H, W) those of which furniture shades a share; None:
    the sun does not shine, or there is no furniture."""
    outdoors, (high, wide) = bare.stage.scene.outdoors, shape[:2]
    if outdoors.sun is None or not parts:
        return None
    furniture = tracer_of(np.concatenate([part.vertices_m[part.faces] for part in parts]).astype(np.float32))
    out = np.zeros(high * wide, bool)
    for patch in patches:
        row, column = np.divmod(patch[:: max(1, len(patch) // PARTED_PX)].astype(np.int32), wide)
        rays = rays_of(Places(row, column, high, wide))
        eye = np.broadcast_to(np.asarray(eye_m, np.float32), rays.shape)
        far = bare.stage.tracer.cast(eye, rays).distance_m[:, None]
        towards = np.broadcast_to(np.asarray(outdoors.sun.direction, np.float32), rays.shape)
        shaded = furniture.cast(eye + far * rays, towards).triangle >= 0
        out[patch] = len(shaded) > 0 and shaded.mean() > PARTED
    return out.reshape(high, wide)


@compiled
def widen_doubt(shown, before, kept, weights, uncertainty):  # type: ignore[no-untyped-def]
    """Widen ``uncertainty`` (H, W) where a picture (H, W, 3) is not ``kept`` (H, W) as it was ``before``."""
    for i in range(kept.shape[0]):
        for j in range(kept.shape[1]):
            if kept[i, j]:
                continue
            new = old = np.float32(0)
            for c in range(3):
                new += weights[c] * shown[i, j, c]
                old += weights[c] * before[i, j, c]
            change = abs(math.log(max(new, np.float32(1e-6)) / max(old, np.float32(1e-6))))
            before_it, modelled = min(uncertainty[i, j], 1.0), CHANGE * min(change, MOST_CHANGE)
            uncertainty[i, j] = math.sqrt(before_it**2 + MODELLED**2 + modelled**2)
