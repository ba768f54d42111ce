"""The light of a preview: a bright window to one side and a dim room around, as many parallel lights with shadows."""

from __future__ import annotations

from processing.ground.arrays import Doubles, Int32s

from dataclasses import dataclass

import numpy as np

from processing.layout.preview.raster import nearest_faces, seen_share

MAP_PX = 360
KEY = np.array([-0.62, 0.50, 0.72])
"""Towards the window, before it is turned with the camera (camera looks along -y)."""


@dataclass(frozen=True)
class Light:
    """One of the parallel lights."""

    towards: Doubles
    power: float


def lights(turn_rad: float, dome: int = 48, key: int = 32) -> list[Light]:
    """Return lights over the upper half of directions: a dome, and a window that is 25 degrees wide."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    middle = np.array([KEY[0] * c - KEY[1] * s, KEY[0] * s + KEY[1] * c, KEY[2]])
    middle /= np.linalg.norm(middle)
    golden = np.pi * (3 - np.sqrt(5))
    made = []
    for k in range(dome):
        z = (k + 0.5) / dome
        r, a = np.sqrt(1 - z * z), golden * k
        towards = np.array([r * np.cos(a), r * np.sin(a), z])
        made.append(Light(towards, (0.75 + 0.45 * float(towards @ middle)) * 2.0 / dome))
    across = np.cross(middle, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    up = np.cross(across, middle)
    for k in range(key):
        r, a = 0.22 * np.sqrt((k + 0.5) / key), golden * k
        towards = middle + r * (np.cos(a) * across + np.sin(a) * up)
        made.append(Light(towards / np.linalg.norm(towards), 1.25 / key))
    return made


def lit(points: Doubles, normals: Doubles, vertices: Doubles, faces: Int32s, turn_rad: float) -> tuple[Doubles, Doubles]:
    """Return irradiance / pi at (n, 3) points with normals, and the share of the lights they see past the triangles."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 * 1.02
    total, open_share = np.zeros(len(points)), np.zeros(len(points))
    every = lights(turn_rad)
    scale = MAP_PX / (2 * radius)
    lifted = np.ascontiguousarray(points + 0.004 * normals)
    for light in every:
        frame = _frame(light.towards, centre, scale)
        depth, _ = nearest_faces(vertices @ frame[:, :3].T + frame[:, 3], faces, MAP_PX, MAP_PX)
        seen = seen_share(lifted, frame, depth, 1.2 / scale)
        total += light.power * np.clip(normals @ light.towards, 0.0, None) * seen
        open_share += seen
    return total, open_share / len(every)


def _frame(towards: Doubles, centre: Doubles, scale: float) -> Doubles:
    """Return (3, 4): what takes a place to x and y in pixels and depth in metres, seen along a light's rays."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(helper, towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right * scale, np.cross(towards, right) * scale, -towards])
    return np.column_stack([axes, np.array([MAP_PX / 2, MAP_PX / 2, 0.0]) - axes @ centre])
