"""The blue sky of the demo, which the rig's chart brings to the indoor camera's colour, against the world's own."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mocks.worlds.light import Site
from mocks.worlds.world import open_world
from processing.pictures.exr import read_exr
from processing.sphere import directions

WITHIN_RAD = math.radians(5)
RAYS = 4096


def zenith_errors(session: Path, world: str) -> dict[str, float]:
    """Return by how much the zenith of a calibrated session is off (within 5 degrees): red and blue over green, the
    larger, and luminance; per cent.
    """
    image = read_exr(session / "stages" / "calibrate" / "outdoor.exr")
    ways, inside = directions(image.geometry)
    shown = image.rgb[inside & (ways[..., 2] > math.cos(WITHIN_RAD))].astype(np.float64).mean(axis=0)
    # Directions spread evenly over the cap, by the golden angle.
    number = np.arange(RAYS) + 0.5
    up, turn = 1 - number / RAYS * (1 - math.cos(WITHIN_RAD)), number * math.pi * (3 - math.sqrt(5))
    flat = np.sqrt(1 - up * up)
    rays = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1).astype(np.float32)
    true = open_world(world).radiance(Site.OUTDOOR, rays).astype(np.float64).mean(axis=0)
    colour = (shown / shown[1]) / (true / true[1]) - 1
    weights = np.array([0.2126, 0.7152, 0.0722])
    return {
        "zenith_colour_err_pct": 100 * float(np.abs(colour).max()),
        "zenith_luminance_err_pct": 100 * float(shown @ weights / (true @ weights) - 1),
    }
