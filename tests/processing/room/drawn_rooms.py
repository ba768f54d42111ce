"""A box-shaped room drawn ray by ray, without any code of the program: plain faces, rectangles painted on walls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Floats
from processing.pictures.images import RelativeImage, Validity
from processing.sphere import Equirectangular

FACES = {"floor": 0.25, "ceiling": 0.8, "front": 0.5, "right": 0.42, "back": 0.55, "left": 0.47}


@dataclass(frozen=True)
class Patch:
    """A rectangle on a wall: from x0 to x1 to the right as seen from inside, from z0 to z1 up, of a luminance.

    ``behind_m``: it lies so far behind the wall, seen through a hole whose sides have the luminance ``reveal``.
    """

    wall: str
    x0: float
    x1: float
    z0: float
    z1: float
    luminance: float
    behind_m: float = 0.0
    reveal: float = 0.65


@dataclass(frozen=True)
class Drawn:
    """Luminance and, per pixel, the patch (index + 1) or 0, and the face's number."""

    luminance: Floats
    patch: npt.NDArray[np.int16]
    face: npt.NDArray[np.int16]


def directions(rows: int) -> Doubles:
    longitude = ((np.arange(2 * rows) + 0.5) / (2 * rows) - 0.5) * 2 * math.pi
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows) * math.pi
    flat = np.cos(latitude)[:, None]
    up = np.broadcast_to(np.sin(latitude)[:, None], (rows, 2 * rows))
    return np.stack([flat * np.sin(longitude), flat * np.cos(longitude), up], axis=-1)


def draw(
    rows: int,
    *,
    low: tuple[float, float] = (-2.0, -1.5),
    high: tuple[float, float] = (1.6, 2.4),
    height_m: float = 2.6,
    camera_m: float = 1.6,
    patches: tuple[Patch, ...] = (),
    turn: Doubles | None = None,
) -> Drawn:
    """Return the panorama (rows, 2 rows) of a room from low to high; ``turn @ d`` is the room's direction of d."""
    d = directions(rows) if turn is None else directions(rows) @ turn.T
    sides = [
        ("left", 0, low[0]),
        ("right", 0, high[0]),
        ("back", 1, low[1]),
        ("front", 1, high[1]),
        ("floor", 2, -camera_m),
        ("ceiling", 2, height_m - camera_m),
    ]
    nearest = np.full(d.shape[:2], np.inf)
    luminance, face = np.zeros(d.shape[:2]), np.zeros(d.shape[:2], np.int16)
    patch = np.zeros(d.shape[:2], np.int16)
    for number, (name, axis, at) in enumerate(sides):
        with np.errstate(divide="ignore", invalid="ignore"):
            far = at / d[..., axis]
        hit = (far > 0) & (far < nearest)
        nearest[hit] = far[hit]
        luminance[hit], face[hit], patch[hit] = FACES[name], number, 0
        for index, one in enumerate(patches):
            if one.wall == name:
                _paint(one, index, d, far, hit, camera_m, luminance, patch)
    return Drawn(luminance.astype(np.float32), patch, face)


def _paint(
    one: Patch,
    index: int,
    d: Doubles,
    far: Doubles,
    hit: npt.NDArray[np.bool_],
    camera_m: float,
    luminance: Doubles,
    patch: npt.NDArray[np.int16],
) -> None:
    away = abs(np.median(far[hit] * np.abs(d[hit][:, 0 if one.wall in ("left", "right") else 1])))
    axis, sign = {"front": (0, 1), "back": (0, -1), "right": (1, -1), "left": (1, 1)}[one.wall]
    reach = np.where(hit, far, 1.0)
    inside = hit & _within(one, sign * d[..., axis] * reach, d[..., 2] * reach + camera_m)
    luminance[inside] = one.reveal
    deep = reach * (1 + one.behind_m / away)
    seen = inside & _within(one, sign * d[..., axis] * deep, d[..., 2] * deep + camera_m)
    luminance[seen], patch[seen] = one.luminance, index + 1


def _within(one: Patch, x: Doubles, z: Doubles) -> npt.NDArray[np.bool_]:
    return np.asarray((x >= one.x0) & (x <= one.x1) & (z >= one.z0) & (z <= one.z1))


def as_image(luminance: Floats, *, noise: float = 0.01, seed: int = 0) -> RelativeImage:
    """Return a grey picture with a little relative noise."""
    rng = np.random.default_rng(seed)
    height, width = luminance.shape
    grey = np.maximum(luminance * (1 + noise * rng.standard_normal(luminance.shape)), 0)
    return RelativeImage(
        rgb=np.repeat(grey[..., None], 3, axis=2).astype(np.float32),
        uncertainty=np.full((height, width), 0.01, np.float32),
        validity=np.full((height, width), Validity.VALID, np.uint8),
        geometry=Equirectangular(width, height),
    )
