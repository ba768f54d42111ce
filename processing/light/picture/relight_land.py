"""What stands before the sky in a picture of the outdoors: trees and houses stay where they are under another sky."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats
from processing.light.scene.scene import Outdoors
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, directions, solid_angles

HIGHEST_RAD = math.radians(30)
"""Above which nothing is looked for: a tree seen as high from outdoors shades windows, and is left as it is."""
STEP = 0.3
"""Of log luminance or of log colour, from one row to the next below: within a degree the sky changes less."""
MEMORY = 0.7
"""Of the sky so far, when the next row of it is taken in."""
COMES_BACK = 4
"""Rows of 0.7 degrees that look like the sky above: what was above them is no land; through a tree fewer show."""
WHITE = 0.9
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)


def level_lx(outdoors: Outdoors) -> float:
    """Return the illuminance of level ground."""
    return on_plane(np.array([0.0, 0.0, 1.0]), outdoors)


def on_plane(normal: Doubles, outdoors: Outdoors) -> float:
    """Return the illuminance (lx) outdoors on a plane that faces along a unit normal."""
    rows = outdoors.rgb.shape[0]
    geometry = Equirectangular(2 * rows, rows)
    share = np.maximum(directions(geometry)[0] @ normal, 0) * solid_angles(geometry)
    light = np.tensordot(share, outdoors.rgb.astype(np.float64), axes=2)
    if outdoors.sun is not None:
        facing = max(float(np.asarray(outdoors.sun.direction) @ normal), 0.0)
        light = light + facing * np.asarray(outdoors.sun.normal_illuminance_lx)
    return float(light @ _WEIGHTS)


def land_of(outdoors: Outdoors) -> Flags:
    """Return what of a picture of the outdoors (h, 2 h, 3) is not sky: (h, 2 h).

    The lower half, and from the last step of brightness or colour below 30 degrees down to the horizon: under a cloud
    the sky comes back. What is brighter than any matte thing there can be is sky too. A cloud that reaches down to the
    land is taken for land; it is as much brighter later as the land is.
    """
    rgb = outdoors.rgb
    rows = rgb.shape[0]
    first = round(rows * (0.5 - HIGHEST_RAD / math.pi))
    logs = np.log(np.maximum(rgb[: rows // 2].astype(np.float64), 1e-6))
    seen = np.stack([logs @ _WEIGHTS, logs[..., 0] - logs[..., 2]], axis=-1)
    sky = seen[max(first - 3, 0) : first + 1].mean(axis=0)
    most = np.log(np.maximum(_brightest(outdoors), 1e-6))
    start = np.full(rgb.shape[1], rows // 2)
    back = np.zeros(rgb.shape[1], int)
    for row in range(first, rows // 2):
        other = (np.abs(seen[row] - sky) > STEP).any(axis=-1) & (seen[row, :, 0] < most)
        start = np.where(other, np.minimum(start, row), start)
        back = np.where(other, 0, back + 1)
        start = np.where(back >= COMES_BACK * rows / 256, rows // 2, start)
        sky = np.where((start <= row)[:, None], sky, MEMORY * sky + (1 - MEMORY) * seen[row])
    return np.asarray(np.arange(rows)[:, None] >= start)


def _brightest(outdoors: Outdoors) -> Doubles:
    """Return the luminance (2 h,) that a matte thing may have by azimuth: towards the sun it shows its shady side."""
    columns = outdoors.rgb.shape[1]
    sun = outdoors.sun
    sky_lx = level_lx(replace(outdoors, sun=None))
    most = np.full(columns, WHITE / math.pi * sky_lx)
    if sun is not None:
        azimuth = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * math.pi
        away = azimuth - math.atan2(sun.direction[0], sun.direction[1])
        lit = np.clip(0.8 - np.cos(away), 0, 1)
        most += WHITE / math.pi * lit * float(np.asarray(sun.normal_illuminance_lx) @ _WEIGHTS)
    return most


def bare_sky(rgb: Floats, land: Flags) -> Floats:
    """Return a panorama with the sky above land carried down behind it, and across the horizon."""
    rows, columns = land.shape
    out = rgb.copy()
    top = np.where(land.any(axis=0), land.argmax(axis=0), rows)
    for column in range(columns):
        out[max(top[column] - 1, 0) :, column] = out[max(top[column] - 2, 0), column]
    side = max(2, rows // 32)
    wide = np.concatenate([out[:, -side:], out, out[:, :side]], axis=1)
    smooth = cv2.blur(wide, (2 * side + 1, 3))[:, side:-side]
    edge = cv2.dilate(land.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(edge[..., None], smooth, out).astype(np.float32)


def with_captured_land(found: Outdoors, captured: Outdoors) -> Outdoors:
    """Return another light outdoors with the captured ground, trees and houses, as much brighter as more light falls.

    The size is that of the larger picture. A captured picture without any light is a place of which nothing is known:
    matte ground of 0.2.
    """
    before, now = level_lx(captured), level_lx(found)
    rows = max(found.rgb.shape[0], captured.rgb.shape[0])
    rgb, land = _sized(found.rgb, rows), _sized(captured.rgb, rows)
    if before <= 0:
        rgb[rows // 2 :] = 0.2 / math.pi * now
        return Outdoors(rgb, found.sun)
    where = land_of(replace(captured, rgb=land))
    return replace(found, rgb=np.where(where[..., None], land * np.float32(now / before), rgb))


def _sized(rgb: Floats, rows: int) -> Floats:
    if rgb.shape[0] == rows:
        return rgb.copy()
    wide = np.concatenate([rgb[:, -1:], rgb, rgb[:, :1]], axis=1)
    factor = rows / rgb.shape[0]
    x = (np.arange(2 * rows, dtype=np.float32) + 0.5) / factor + 0.5
    y = (np.arange(rows, dtype=np.float32) + 0.5) / factor - 0.5
    across = np.ascontiguousarray(np.broadcast_to(x, (rows, 2 * rows)))
    down = np.ascontiguousarray(np.broadcast_to(y[:, None], (rows, 2 * rows)))
    found = cv2.remap(wide, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, dtype=np.float32)
