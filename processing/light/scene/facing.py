"""Which way the outdoor picture faces, found from what the windows show of it, where nobody recorded a heading.

Where they show too little, direct sunlight in the room shows it: the sun must stand where that comes from.

Through the glass the panorama sees a part of what the outdoor picture sees. Turned the right way, dark trees and bright
sky fall together; turned otherwise they do not. It is believed only where one way fits clearly better than all others.
"""

import math
from dataclasses import replace

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats
from processing.ground.room_model import RoomModel
from processing.light.scene.scene import Outdoors, Scene, shell_of
from processing.light.scene.sources import ABOVE_HORIZON
from processing.light.solver.sight import GLASS, Sight, looked_up, sight_of
from processing.light.solver.stage import Stage
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.sphere import Equirectangular

ROWS, COARSE_M, HALF = 256, 0.5, 0.5
STEP_RAD = math.radians(3.0)
LEAST_PIXELS = 150  # of a window's view that can be compared; chosen, never swept
LEAST_LIKENESS, LEAST_LEAD = 0.35, 0.12
"""Correlation of log luminance and of colour that the best way must have, and by how much it must lead the others."""
BESIDE_RAD = math.radians(30.0)  # around the best way, within which others are no rivals

SAME_SUN_RAD = math.radians(7.0)
"""By which the heights of the sun outdoors and of the sunlight in the room may differ; that in the room is searched."""


def outdoors_facing(
    outdoors: Outdoors, panorama: LuminanceImage, room: RoomModel
) -> tuple[Outdoors, tuple[float, float] | None]:
    """Return the light outdoors as it is before the room's windows, and by how much it was turned (`estimated_turn`).

    As it is, and None, where that cannot be found.
    """
    size = (2 * ROWS, ROWS)
    small = np.asarray(cv2.resize(panorama.rgb, size, interpolation=cv2.INTER_AREA), np.float32)
    clipped = (panorama.validity != Validity.VALID).astype(np.float32)
    valid = cv2.resize(clipped, size, interpolation=cv2.INTER_AREA) < HALF
    surfaces, panes = shell_of(room)
    stage = Stage.of(Scene(surfaces, panes, outdoors), COARSE_M)
    sight = sight_of(stage, Equirectangular(*size), (0.0, 0.0, room.camera_height_m))
    turn = estimated_turn(outdoors, sight, small, valid)
    return (outdoors, None) if turn is None else (turned(outdoors, turn[0]), turn)


def facing_sunlight(outdoors: Outdoors, seen: tuple[float, float] | None) -> tuple[Outdoors, float | None]:
    """Return the light outdoors turned so that its sun stands where the room says, and the turn (rad).

    ``seen``: azimuth (from +y towards +x) and elevation (rad) of the sun as sunlight in the room shows it; None: it
    shows nothing. Where that cannot be this sun, the light is returned without sun, and None: a sun before the wrong
    window is worse than none. Light without sun is returned as it is.
    """
    sun = outdoors.sun
    if sun is None:
        return outdoors, None
    x, y, z = sun.direction
    if seen is None or abs(seen[1] - math.asin(min(max(z, -1.0), 1.0))) > SAME_SUN_RAD:
        return replace(outdoors, sun=None), None
    turn = math.remainder(seen[0] - math.atan2(x, y), 2 * math.pi)
    return turned(outdoors, turn), turn


def estimated_turn(outdoors: Outdoors, sight: Sight, panorama: Floats, valid: np.ndarray) -> tuple[float, float] | None:
    """Return by how much the outdoor picture is to be turned (rad, as the compass turns) and how well it then fits.

    None where it cannot be found. ``panorama`` (H, 2 H, 3) and what its pixels see; ``valid`` (H, 2 H).
    """
    mine = np.flatnonzero((sight.label == GLASS) & (sight.rays[:, 2] > ABOVE_HORIZON) & valid.ravel())
    if len(mine) < LEAST_PIXELS:
        return None
    rays, inside = sight.rays[mine].astype(np.float64), _features(panorama.reshape(-1, 3)[mine])
    turns = np.arange(0, 2 * math.pi - 1e-9, STEP_RAD)
    likeness = np.array(
        [_likeness(inside, _features(looked_up(outdoors.rgb, _turned(rays, -t).astype(np.float32)))) for t in turns]
    )
    best = int(likeness.argmax())
    apart = np.abs(np.angle(np.exp(1j * (turns - turns[best]))))
    rivals = likeness[apart > BESIDE_RAD]
    if likeness[best] < LEAST_LIKENESS or likeness[best] - rivals.max() < LEAST_LEAD:
        return None
    return math.remainder(float(turns[best]), 2 * math.pi), float(likeness[best])


def turned(outdoors: Outdoors, turn_rad: float) -> Outdoors:
    """Return the light outdoors turned about the zenith, clockwise seen from above, to the nearest column."""
    columns = outdoors.rgb.shape[1]
    steps = round(turn_rad / (2 * math.pi) * columns)
    exact = steps * 2 * math.pi / columns
    sun = outdoors.sun
    if sun is not None:
        x, y, z = (float(v) for v in _turned(np.asarray(sun.direction, np.float64)[None], exact)[0])
        sun = replace(sun, direction=(x, y, z))
    return Outdoors(np.roll(outdoors.rgb, steps, axis=1), sun)


def _turned(rays: Doubles, turn_rad: float) -> Doubles:
    """Return directions (N, 3) turned clockwise seen from above."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return np.column_stack([c * rays[:, 0] + s * rays[:, 1], c * rays[:, 1] - s * rays[:, 0], rays[:, 2]])


def _features(rgb: Floats) -> Doubles:
    """Return log luminance and how blue it is (N, 2)."""
    light = np.maximum(rgb.astype(np.float64), 1e-6)
    return np.column_stack([np.log(light @ np.asarray(LUMINANCE_WEIGHTS)), np.log(light[:, 2] / light[:, 0])])


def _likeness(one: Doubles, other: Doubles) -> float:
    """Return the mean correlation of two sets of features (N, 2)."""
    a, b = one - one.mean(axis=0), other - other.mean(axis=0)
    spread = np.sqrt((a**2).mean(axis=0) * (b**2).mean(axis=0))
    return float(np.where(spread > 1e-6, (a * b).mean(axis=0) / np.maximum(spread, 1e-6), 0).mean())


def facing_without_heading(
    found: Outdoors, image: LuminanceImage, room: RoomModel, seen: tuple[float, float] | None
) -> tuple[Outdoors, str]:
    """Return the light outdoors as it is likely to stand before the windows, and what that rests on."""
    facing, turn = outdoors_facing(found, image, room)
    if turn is not None:
        return facing, (
            f"the outdoor picture is turned by {math.degrees(turn[0]):.0f} degrees, as the windows show it "
            f"(likeness {turn[1]:.2f})"
        )
    facing, by = facing_sunlight(found, seen)
    if by is not None:
        return facing, (
            f"the outdoor picture is turned by {math.degrees(by):.0f} degrees, so that its sun stands where the "
            "sunlight in the room comes from"
        )
    if found.sun is None:
        return facing, "the sky may be outside the wrong windows"
    height = math.degrees(math.asin(min(max(found.sun.direction[2], -1.0), 1.0)))
    why = "no sunlight in the room shows its direction"
    if seen is not None:
        why = f"it is {height:.0f} degrees high, the sunlight in the room comes from {math.degrees(seen[1]):.0f}"
    return facing, f"the sun outdoors is left out ({why}), and the sky may be outside the wrong windows"
