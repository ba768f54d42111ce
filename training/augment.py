"""What is done to a training picture when it is read: turned, mirrored, and given another exposure and colour."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Floats
from training.rooms.recoat import recoated
from training.shards import Examples
from training.stretch import stretched, wall_direction_rad

COLUMNS = ("label", "ceiling_rad", "floor_rad", "corner")
STRETCHED, RECOATED = 0.6, 0.6
"""Shares of pictures."""


Arrays = dict[str, npt.NDArray[Any]]


def turned(arrays: Arrays, columns: int, mirror: bool) -> Arrays:
    """Return picture (H, W, 3), label (H, W) and columns (W,) rolled to the right, then mirrored left to right."""
    out = {}
    for name, values in arrays.items():
        axis = 1 if name in ("picture", "label") else 0
        moved = np.roll(values, columns, axis=axis)
        out[name] = np.flip(moved, axis=axis) if mirror else moved
    return out


def recoloured(rng: np.random.Generator, picture: Floats) -> Floats:
    """Return a picture (H, W, 3) of 0..1 with a chance exposure, contrast, colour, light and noise."""
    out = np.clip(picture, 0, 1) ** np.float32(np.exp(rng.normal(0, 0.25)))
    if rng.random() < 0.5:
        out = out @ _mixing(rng)
    grey = out.mean(axis=2, keepdims=True)
    out = grey + (out - grey) * np.float32(rng.uniform(0.4, 1.7))
    out = out * (1 + 0.06 * rng.normal(size=3)).astype(np.float32)
    if rng.random() < 0.5:
        middle = np.float32(out.mean())
        out = middle + (out - middle) * np.float32(rng.uniform(0.7, 1.4))
    if rng.random() < 0.4:
        out = out * _dapple(rng, out.shape[:2])[..., None]
    if rng.random() < 0.2:
        out = cv2.GaussianBlur(out, (0, 0), float(rng.uniform(0.3, 0.9)))
    if rng.random() < 0.5:
        out = out + rng.normal(0, rng.uniform(0, 0.025), out.shape).astype(np.float32)
    return np.asarray(np.clip(out, 0, 1), dtype=np.float32)


def _mixing(rng: np.random.Generator) -> Floats:
    """Return a matrix that turns hues a little and keeps grey grey."""
    mix = np.eye(3) + rng.normal(0, 0.15, (3, 3))
    return np.asarray(mix / mix.sum(axis=0), dtype=np.float32)


def _dapple(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    """Return uneven light about 1, as through leaves and blinds or from lamps: floors and walls are not of one tone."""
    rows = int(rng.choice([4, 4, 8, 8, 16, 32]))
    field = rng.normal(0, rng.uniform(0.02, 0.13), (rows, 2 * rows)).astype(np.float32)
    field[:, -1] = field[:, 0]
    wide = cv2.resize(field, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.exp(wide), dtype=np.float32)


def drawn_batch(rng: np.random.Generator, examples: Examples, chosen: npt.NDArray[np.intp]) -> Arrays:
    """Return the examples ``chosen`` (N,) augmented, stacked, pictures channel first (N, 3, H, W)."""
    found: dict[str, list[npt.NDArray[Any]]] = {}
    for index in chosen:
        one = {"picture": examples.picture[index], **{name: getattr(examples, name)[index] for name in COLUMNS}}
        moved = turned(one, int(rng.integers(examples.picture.shape[2])), bool(rng.random() < 0.5))
        if rng.random() < STRETCHED:
            along, across = np.exp(np.clip(rng.normal(0, 0.22, 2), -0.5, 0.5))
            moved = stretched(moved, along, across, wall_direction_rad(moved["floor_rad"]))
        shown = np.asarray(moved["picture"], dtype=np.float32) / np.float32(255)
        if rng.random() < RECOATED:
            shown = recoated(rng, shown, moved["label"])
        moved["picture"] = recoloured(rng, shown).transpose(2, 0, 1)
        for name, values in moved.items():
            found.setdefault(name, []).append(values)
    return {name: np.stack(values) for name, values in found.items()}
