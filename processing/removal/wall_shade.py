"""What removed furniture leaves on the plain walls behind it: its soft shade, and the rim of things that masks miss.

A plain wall is one colour in light that changes slowly. What differs from that beside what is removed, and hangs
together with it, is replaced with it: a plain wall's continuation is surer than a shadow's strength.
"""

from __future__ import annotations

import cv2
import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.removal.illumination import ToneScale, fit_illumination, grey, known_mean
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, Plane, planes_of
from processing.surfaces.textures import unwrap, wrap

# Chosen by looking at five furnished real rooms (docs/measurements/real.md), unless said otherwise.
PX_PER_M = 32.0
"""Of a wall's texture (chosen)."""
AWAY_M = 0.3
"""From what is removed, where a wall shows its light undisturbed (chosen)."""
FOOT_M, TOP_M = 0.22, 0.12
"""Skirting and cornice: nothing there is judged (chosen)."""
BEND, LOCAL_M, PASSES = 0.1, 0.35, 4
"""Stiffness of the slow light (`fit_illumination`); over how much of the wall what it leaves is averaged, and how
often, without what was odd (chosen)."""
PLAIN = 0.1
"""Tone: robust deviation about the slow light from which a wall has a pattern, in which nothing is odd (chosen)."""
ODD, ODD_TIMES, ODD_REACH_M = 0.16, 4.0, 0.3
"""Tone, and times that deviation, from which a place is no part of the wall; how far it is so (chosen)."""
SHADE, SHADE_TIMES, SHADE_COLOUR, SHADE_REACH_M = 0.06, 2.0, 0.5, 0.9
"""The same for shade; its colour may be off by so much of its depth (chosen)."""
SHADE_STEEP = 0.25
"""Tone by which it changes within 0.1 m at most: it runs out, things end (chosen)."""
TOUCH_M, LEAST_TEXELS = 0.1, 200
"""From what is removed, where shade begins; of a wall that must be seen (chosen)."""
FRAME = np.ones((2 * round(0.12 * PX_PER_M) + 1,) * 2, np.uint8)
"""Around windows and doors, their frames (chosen)."""


def find_wall_shade(rgb: Floats, room: RoomModel, geometry: Equirectangular, removed: Flags, barred: Flags) -> Flags:
    """Return what is replaced with the ``removed`` (H, W) on the walls of a panorama (H, W, 3), linear light.

    ``barred`` (H, W): openings, and what is known for a fixture of the room.
    """
    found = np.zeros(removed.shape, bool)
    layers = np.concatenate([rgb, np.stack([removed, barred], axis=-1).astype(np.float32)], axis=-1)
    for plane in planes_of(room)[FIRST_WALL:]:
        texture = unwrap(layers, geometry, room, plane, PX_PER_M)
        gone = texture.known & (texture.values[..., 3] > 0.5)
        never = cv2.dilate((texture.values[..., 4] > 0.1).astype(np.uint8), FRAME).astype(bool)
        if gone.any():
            marks = _on_wall(texture.values[..., :3], texture.known & ~never & ~gone, gone, plane)
            values, where = wrap(marks.astype(np.float32), plane, PX_PER_M, room, geometry, ~(removed | barred))
            found[where] |= values.ravel() > 0.5
    return found


def _on_wall(light: Floats, known: Flags, gone: Flags, plane: Plane) -> Flags:
    """Return what is replaced on a wall's texture (H, W); nothing where it is not plain, or hardly seen."""
    known[: round(TOP_M * PX_PER_M)] = False
    known[round((plane.height_m - FOOT_M) * PX_PER_M) :] = False
    away = cv2.distanceTransform((~gone).astype(np.uint8), cv2.DIST_L2, 5) / np.float32(PX_PER_M)
    clean = known & (away > AWAY_M)
    if clean.sum() < LEAST_TEXELS:
        return np.zeros_like(known)
    tone = known_mean(ToneScale.of(light, clean).tone(light), known, 1.0)[0]
    rest, spread = _about_light(tone, clean)
    if spread > PLAIN:
        return np.zeros_like(known)
    dark = grey(rest)
    colour = np.abs(rest - dark[..., None]).max(axis=-1)
    marks = (np.abs(rest).max(axis=-1) > max(ODD, ODD_TIMES * spread)) & (away < ODD_REACH_M)
    soft = (dark < -max(SHADE, SHADE_TIMES * spread)) & (colour < SHADE_COLOUR * np.abs(dark) + 0.03)
    high, low = (np.where(known, dark, far).astype(np.float32) for far in (-9, 9))
    brush = np.ones((3, 3), np.uint8)
    soft &= cv2.dilate(high, brush) - cv2.erode(low, brush) < SHADE_STEEP
    marks = known & (marks | (soft & (away < SHADE_REACH_M)))
    _, labels = cv2.connectedComponents(marks.astype(np.uint8), connectivity=8)
    touching = np.unique(labels[marks & (away <= TOUCH_M)])
    return np.asarray(np.isin(labels, touching[touching > 0]) & marks)


def _about_light(tone: Floats, clean: Flags) -> tuple[Floats, float]:
    """Return tones (H, W, 3) about the wall's slow light, and their robust deviation where ``clean`` (H, W)."""
    usual, level = clean, np.median(tone[clean], axis=0)
    slow = level + fit_illumination(np.where(clean[..., None], tone - level, 0), clean, ~clean, None, bend=BEND)
    base = np.asarray(tone - slow, np.float32)
    rest, spread = base, 0.0
    for _ in range(PASSES):
        rest = np.asarray(base - known_mean(base, usual, LOCAL_M * PX_PER_M)[0], np.float32)
        off = np.abs(rest).max(axis=-1)
        spread = 1.4826 * float(np.median(off[usual]))
        usual = clean & (off < max(ODD, 2 * spread)) & (grey(rest) > -max(SHADE, SHADE_TIMES * spread))
    return rest, spread
