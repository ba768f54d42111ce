"""Levelling measured: rooms of known tilt, and the walls' azimuth on real panoramas."""

from __future__ import annotations

import math
import time
from typing import Any

import cv2
import numpy as np

from benchmarks.seeds import Split
from benchmarks.truth_rooms import kept_list, truth_of
from processing.ground.arrays import Doubles, Floats
from processing.pictures.images import RelativeImage, Validity
from processing.room.level import Upright, find_upright
from processing.room.vanishing import rotation_about
from processing.sphere import Equirectangular

MOST_TILT_RAD = math.radians(15)


def as_image(rgb: Floats) -> RelativeImage:
    """Return a picture as what a merge would give of it: every pixel valid, 1 % uncertain."""
    height, width = rgb.shape[:2]
    return RelativeImage(
        rgb=np.ascontiguousarray(rgb, dtype=np.float32),
        uncertainty=np.full((height, width), 0.01, np.float32),
        validity=np.full((height, width), Validity.VALID, np.uint8),
        geometry=Equirectangular(width, height),
    )


def tilted(rgb: Floats, turn: Doubles) -> Floats:
    """Return the panorama of a camera turned so that what it calls d is ``turn @ d`` in the room."""
    height, width = rgb.shape[:2]
    longitude = ((np.arange(width) + 0.5) / width - 0.5) * 2 * math.pi
    latitude = (0.5 - (np.arange(height) + 0.5) / height) * math.pi
    flat = np.cos(latitude)[:, None]
    d = np.stack([flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude)[:, None] + 0 * longitude], -1)
    d = d @ turn.T
    x = (np.arctan2(d[..., 0], d[..., 1]) / (2 * math.pi) + 0.5) * width - 0.5
    y = (0.5 - np.arcsin(np.clip(d[..., 2], -1, 1)) / math.pi) * height - 0.5
    wide = cv2.copyMakeBorder(rgb, 2, 2, 2, 2, cv2.BORDER_REPLICATE)
    wide[:, :2], wide[:, -2:] = wide[:, -4:-2], wide[:, 2:4]
    found = cv2.remap(wide, (x + 2).astype(np.float32), (y + 2).astype(np.float32), cv2.INTER_LINEAR)
    return np.asarray(found, dtype=np.float32)


def random_turn(rng: np.random.Generator, most_tilt_rad: float = MOST_TILT_RAD) -> Doubles:
    """Return a turn about all three axes whose tilt is at most so large."""
    side = rng.uniform(0, 2 * math.pi)
    lean = rotation_about(np.array([math.cos(side), math.sin(side), 0.0]) * rng.uniform(0, most_tilt_rad))
    return np.asarray(lean @ rotation_about(np.array([0.0, 0.0, rng.uniform(-math.pi, math.pi)])))


def tilt_error_rad(found: Upright, turn: Doubles) -> float:
    """Return the angle between the true vertical and the one found (whether it was undone or not)."""
    true_up = turn.T @ np.array([0.0, 0.0, 1.0])
    if found.note.startswith("turned"):
        return float(np.arccos(np.clip(found.rotation.T[:, 2] @ true_up, -1, 1)))
    return float(np.arccos(np.clip(true_up[2], -1, 1)))


def azimuth_error_rad(found: Upright, turn: Doubles, floor: tuple[tuple[float, float], ...]) -> float:
    """Return how far the walls' direction is off the walls that are longest together, once upright."""
    corners = np.array(floor)
    edges = np.roll(corners, -1, axis=0) - corners
    longitude = np.arctan2(edges[:, 0], edges[:, 1])
    true = np.angle((np.hypot(*edges.T) * np.exp(4j * longitude)).sum()) / 4
    ahead = found.rotation @ turn.T @ np.array([math.sin(true), math.cos(true), 0.0])
    return abs(math.remainder(math.atan2(ahead[0], ahead[1]) - found.manhattan_rad, math.pi / 2))


def simulated(split: Split, count: int, *, tilts: int = 2, empty: bool = False) -> dict[str, Any]:
    """Return figures of rooms of a split, each tilted ``tilts`` times by up to 15 degrees about random axes.

    Errors in degrees; ``z``: error over the stated uncertainty (two axes: its rms is 1 where that is right).
    """
    rng = np.random.default_rng(5)
    tilt_err, azimuth_err, ratio, support, seconds = [], [], [], [], []
    for seed, use in kept_list(split, count):
        room, truth = truth_of(seed, use)
        for _ in range(tilts):
            turn = random_turn(rng)
            image = as_image(tilted(truth.empty_rgb if empty else truth.luminance_rgb, turn))
            start = time.process_time()
            found = find_upright(image)
            seconds.append(time.process_time() - start)
            tilt_err.append(math.degrees(tilt_error_rad(found, turn)))
            azimuth_err.append(math.degrees(azimuth_error_rad(found, turn, room.plan.polygon)))
            ratio.append(tilt_err[-1] / math.degrees(found.sigma_rad) if found.note.startswith("turned") else math.nan)
            support.append(found.support)
    return {
        "count": len(tilt_err),
        "tilt_err": tilt_err,
        "azimuth_err": azimuth_err,
        "z": ratio,
        "support": support,
        "cpu_s": seconds,
    }


def level_metrics(*, quick: bool) -> dict[str, float]:
    """Return the benchmark's figures: test rooms with furniture, tilted by up to 15 degrees."""
    found = simulated("test", 3 if quick else 16, tilts=1 if quick else 3)
    return {
        "level_tilt_err_median_deg": float(np.median(found["tilt_err"])),
        "level_tilt_err_p95_deg": float(np.percentile(found["tilt_err"], 95)),
        "level_azimuth_err_median_deg": float(np.median(found["azimuth_err"])),
        "level_azimuth_err_p95_deg": float(np.percentile(found["azimuth_err"], 95)),
        "level_error_over_sigma": float(np.sqrt(np.nanmean(np.square(found["z"])))),
        "level_cpu_s": float(np.median(found["cpu_s"])),
    }
