"""The skirting of a room: what runs along the foot of its walls, told from all of them, for walls that hide theirs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.removal.regions import opening_regions
from processing.removal.smooth import ToneScale, grey
from processing.sphere import Equirectangular
from processing.surfaces.planes import FIRST_WALL, Plane, planes_of
from processing.surfaces.textures import Texture, unwrap

PX_PER_M = 80.0
HIGHEST_M = 0.25
TOP_M = 0.05
"""Below that height: what of the wall is just above the skirting, against which it is told."""
ABOVE_M = (0.3, 0.6)
"""Where the wall itself must be seen too."""
LEAST_COLUMNS = 12
MIXED_PX, FARTHER = 1.5, 1.2
"""Pixels beside the floor that show some of it; distance of what is seen of a wall over that of its plane."""
LEAST_TONE, MOST_SPREAD = 0.04, 0.35
"""Of the strongest row: a skirting is seen against its wall, and alike on all walls (of that tone)."""


@dataclass(frozen=True)
class Skirting:
    """Tone against the wall above, by height over the floor."""

    tone: Floats
    """(n, 3), from the floor up, ``1 / PX_PER_M`` a row; 0 where there is none."""

    def rows(self, height: int, px_per_m: float) -> Floats:
        """Return (height, 3): the same by rows of a wall's texture, from its ceiling down."""
        above_m = (height - 0.5 - np.arange(height)) / px_per_m
        places = (np.arange(len(self.tone)) + 0.5) / PX_PER_M
        parts = [np.interp(above_m, places, self.tone[:, k], right=0.0) for k in range(3)]
        return np.stack(parts, axis=-1).astype(np.float32)


def find_skirting(rgb: Floats, geometry: Equirectangular, room: RoomModel, masked: Flags) -> Skirting | None:
    """Return what runs along the foot of the walls, None where nothing does or walls differ.

    ``rgb`` (H, W, 3) is finite; nothing is taken from ``masked`` pixels (H, W).
    """
    found = []
    for plane in planes_of(room)[FIRST_WALL:]:
        texture = unwrap(rgb, geometry, room, plane, PX_PER_M, mask=masked)
        known = texture.known.copy()
        for opening in opening_regions(plane, room, known.shape, PX_PER_M):
            # What is seen through a window, and its reveal, is no wall to compare with.
            known[opening] = False
        profile = _profile(replace(texture, known=known), _mixed_rows(plane, room, geometry))
        if profile is not None:
            found.append(profile)
    if not found:
        return None
    profiles, columns = np.stack([tone for tone, _ in found]), np.array([count for _, count in found], np.float64)
    middle = _weighted_median(profiles, columns)
    strongest = int(np.abs(middle).mean(axis=1).argmax())
    height = float(np.abs(middle[strongest]).mean())
    off = np.abs(grey(profiles[:, strongest]) - float(grey(middle[strongest])))
    spread = float(_weighted_median(off[:, None], columns)[0])
    if height < LEAST_TONE or spread > MOST_SPREAD * height:
        return None
    return Skirting(middle.astype(np.float32))


def _mixed_rows(plane: Plane, room: RoomModel, geometry: Equirectangular) -> int:
    """Return how many of a wall's lowest rows hold some of the floor in the picture's pixels."""
    eye = np.array([0.0, 0.0, room.camera_height_m])
    away = FARTHER * max(abs(float((eye - plane.origin_m) @ plane.normal)), 0.3)
    pixel_m = math.pi / geometry.height_px * (away**2 + room.camera_height_m**2) / away
    return math.ceil(MIXED_PX * pixel_m * PX_PER_M)


def _profile(texture: Texture, mixed: int) -> tuple[Floats, int] | None:
    """Return the tone (n, 3) of the lowest rows, from the floor up, against the wall above; of how many columns."""
    rows = round(HIGHEST_M * PX_PER_M)
    foot = round(texture.plane.height_m * PX_PER_M)
    top, low = foot - round(ABOVE_M[1] * PX_PER_M), foot - round(ABOVE_M[0] * PX_PER_M)
    if top < 0 or foot > len(texture.values):
        return None
    whole = texture.known[foot - rows : foot].all(axis=0) & texture.known[top:low].all(axis=0)
    if whole.sum() < LEAST_COLUMNS:
        return None
    tone = ToneScale.of(texture.values, texture.known).tone(texture.values[:, whole])
    off = tone[foot - rows : foot][::-1] - np.median(tone[top:low], axis=0)
    found = np.asarray(np.median(off, axis=1), np.float32)
    # Walls grow darker towards the floor; that is light.
    found -= np.median(found[-round(TOP_M * PX_PER_M) :], axis=0)
    found[:mixed] = found[min(mixed, rows - 1)]
    return found, int(whole.sum())


def _weighted_median(values: Floats, weight: np.ndarray) -> Floats:
    """Return the weighted median along the first axis."""
    order = np.argsort(values, axis=0)
    share = np.cumsum(weight[order], axis=0) / weight.sum()
    place = (share >= 0.5 - 1e-12).argmax(axis=0)[None]
    return np.asarray(np.take_along_axis(np.take_along_axis(values, order, axis=0), place, axis=0)[0])
