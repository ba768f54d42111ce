"""What is mirrored in a staged picture, at a small size: on furniture, and in a glossy floor with and without it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats
from processing.light.picture.highlights import (
    FLOOR_WIDTH,
    HEAD_ON,
    Surroundings,
    furniture_highlights,
    is_glossy,
    mirrored_light,
)
from processing.light.picture.render import small_geometry
from processing.light.scene.scene import Vector
from processing.light.solver.denoise import denoised
from processing.light.solver.sight import FIRST_PART, Sight, sight_of
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.light.solver.transport import LightMap
from processing.sphere import Equirectangular

MOST_ROWS = 512
FLOOR_BLUR_PX = 1.5
"""About the width of a varnished floor's mirror images at `MOST_ROWS` rows; it takes the noise of few rays away too."""
MOST_GAIN = 4.0
FURNITURE_RAYS, FLOOR_RAYS, FEW_RAYS = 48, 24, 12
"""From each small pixel; of what no small pixel sees, from each large one."""


@dataclass(frozen=True)
class Mirrors:
    """Mirrored light of a small picture's pixels."""

    sight: Sight
    around: Surroundings
    furniture: Floats
    """(h, w, 3) cd/m2."""
    floor_before: Floats
    """(h, w, 3): what the floor mirrors without furniture, 0 where it is matte."""
    floor_after: Floats

    floors: tuple[int, ...]
    """Numbers of the surfaces that mirror."""

    @cached_property
    def all_three(self) -> Floats:
        """(h, w, 9): the floor's before and after and furniture's, brought to a large picture in one go."""
        return np.concatenate([self.floor_before, self.floor_after, self.furniture], axis=2)


def mirrors_of(
    bare: Stage,
    full: Stage,
    lights: tuple[LightMap, LightMap],
    photograph: Floats,
    eye_m: Vector,
    *,
    seed: int,
    clean: bool,
) -> Mirrors | None:
    """Return what furniture and floor mirror; None where nothing does.

    Parameters
    ----------
    bare, full
        The room without and with furniture; of its light maps (``lights``) likewise.
    photograph
        (H, 2 H, 3): of the room without furniture.
    """
    floors = [k for k, surface in enumerate(bare.scene.surfaces) if surface.gloss > 0]
    if not floors and not any(is_glossy(part.material) for part in full.scene.parts):
        return None
    geometry = small_geometry(Equirectangular(photograph.shape[1], photograph.shape[0]), MOST_ROWS)
    assert isinstance(geometry, Equirectangular)
    size = (geometry.width_px, geometry.height_px)
    shown = photograph
    if shown.shape[:2] != size[::-1]:
        shown = np.asarray(cv2.resize(photograph, size, interpolation=cv2.INTER_AREA), np.float32)
    sight, empty = sight_of(full, geometry, eye_m), sight_of(bare, geometry, eye_m)
    one = np.ones((bare.patches.count, 3))
    before = Surroundings(bare, lights[0], shown, empty, one, eye_m)
    after = Surroundings(full, lights[1], shown, empty, _gain(full, lights), eye_m)
    found = furniture_highlights(
        after, sight, sun_of(full, sight, 16, seed, sight.label >= FIRST_PART), FURNITURE_RAYS, (seed, 90)
    )
    old, new = np.zeros_like(found), np.zeros_like(found)
    for floor in floors:
        mine = np.flatnonzero(sight.label == floor)
        gloss = np.float32(bare.scene.surfaces[floor].gloss)
        for out, around in ((old, before), (new, after)):
            light, _ = mirrored_light(around, sight, mine, FLOOR_WIDTH, np.full(3, HEAD_ON), FLOOR_RAYS, (seed, 91))
            out[mine] = gloss * light
    there = np.isin(sight.label, floors).reshape(sight.shape)
    old, new = (_blurred(light.reshape(*sight.shape, 3), there) for light in (old, new))
    picture = found.reshape(*sight.shape, 3)
    if clean:
        picture = _cleaned(picture, sight)
    return Mirrors(sight, after, picture, old, new, tuple(floors))


def few_highlights(mirrors: Mirrors, sight: Sight, chosen: np.ndarray, sun: Floats, seed: int) -> Floats:
    """Return what pixels (k,) of a large picture mirror of which no small pixel tells, by a few rays of their own."""
    return furniture_highlights(mirrors.around, sight.some(chosen), sun[chosen], FEW_RAYS, (seed, 92))


def _gain(full: Stage, lights: tuple[LightMap, LightMap]) -> Doubles:
    """Return by how much furniture changes the light of the room's patches (patches, 3); 1 for its own."""
    out = np.ones((full.patches.count, 3))
    before, after = lights[0].total, lights[1].total
    shared = len(before)
    known = before > 0
    ratio = np.where(known, after[:shared] / np.where(known, before, 1), 1)
    out[:shared] = np.clip(ratio, 0, MOST_GAIN)
    return out


def _blurred(picture: Floats, there: np.ndarray) -> Floats:
    """Return a floor's mirrored light blurred as its roughness blurs it: alike in both pictures, so that what furniture
    leaves alone stays alike.
    """
    side = 4 * round(FLOOR_BLUR_PX)
    padding = ((0, 0), (side, side))
    weight = cv2.GaussianBlur(np.pad(there.astype(np.float32), padding, mode="wrap"), (0, 0), FLOOR_BLUR_PX)
    light = np.pad(picture * there[..., None], (*padding, (0, 0)), mode="wrap")
    mean = cv2.GaussianBlur(light, (0, 0), FLOOR_BLUR_PX) / np.maximum(weight, 1e-6)[..., None]
    return np.where(there[..., None], mean[:, side : side + picture.shape[1]], 0).astype(np.float32)


def _cleaned(picture: Floats, sight: Sight) -> Floats:
    there = (sight.label >= FIRST_PART).reshape(sight.shape)
    if not (picture > 0).any():
        return picture
    distance = np.where(there, np.where(np.isfinite(sight.distance_m), sight.distance_m, 0).reshape(sight.shape), 0)
    near = np.where(there, 1 / (1 + distance), 0).astype(np.float32)
    normal = sight.normal.reshape(*sight.shape, 3) * there[..., None]
    return denoised(picture, normal.astype(np.float32), near, wraps=True, quality="fast") * there[..., None]
