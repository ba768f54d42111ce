"""Other colours and patterns on what a training picture shows: on every piece of furniture, floors, walls, fixtures.

Done in the picture, over the light that is there. Shapes and shadows stay, so a network learns forms, not coats.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Floats
from processing.segmentation.evidence import SceneClass

HALF_LEVEL = np.float32(0.35)
"""Of the network's picture: the linear level that it shows as the root of one half."""
CHANCES = {
    SceneClass.FURNITURE: 0.55,
    SceneClass.FIXTURE: 0.3,
    SceneClass.FLOOR: 0.3,
    SceneClass.WALL: 0.25,
    SceneClass.DOOR: 0.3,
    SceneClass.CEILING: 0.08,
}
_PIECES = (SceneClass.FURNITURE, SceneClass.FIXTURE)


def recoated(rng: np.random.Generator, picture: Floats, label: npt.NDArray[np.uint8]) -> Floats:
    """Return a picture (H, W, 3) of 0..1 with other coats on some of its surfaces."""
    factor = np.ones_like(picture)
    changed = False
    for kind, chance in CHANCES.items():
        where = label == kind
        if not where.any():
            continue
        count, number = (2, where) if kind not in _PIECES else cv2.connectedComponents(where.astype(np.uint8))
        for piece in range(1, min(count, 12)):
            if rng.random() < chance:
                mine = number == piece
                factor[mine] = _coat(rng, picture.shape[:2], strong=kind in _PIECES)[mine]
                changed = True
    if not changed:
        return picture
    shown = np.minimum(picture, np.float32(0.995)) ** 2
    light = HALF_LEVEL * shown / (1 - shown) * factor
    return np.asarray(np.sqrt(light / (light + HALF_LEVEL)), dtype=np.float32)


def _coat(rng: np.random.Generator, shape: tuple[int, int], *, strong: bool) -> Floats:
    """Return factors (H, W, 3): a tone, and now and then a pattern in two tones."""
    tone = _tone(rng, 0.75 if strong else 0.3)
    if rng.random() < 0.45:
        return np.broadcast_to(tone, (*shape, 3))
    other = tone * _tone(rng, 0.9 if strong else 0.35)
    share = _pattern(rng, shape)[..., None]
    return np.asarray(tone * (1 - share) + other * share, dtype=np.float32)


def _tone(rng: np.random.Generator, spread: float) -> Floats:
    hue = rng.normal(0.6, 0.7) if rng.random() < 0.5 else rng.uniform(0, 2 * np.pi)
    tint = 1 + rng.uniform(0, 0.7) * np.cos(hue - np.array([0.0, 2.094, 4.189]))
    return np.asarray(np.exp(rng.normal(0, spread)) * np.maximum(tint, 0.1), dtype=np.float32)


def _pattern(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    """Return shares (H, W) of 0..1: stripes, checks, spots or clouds of any size."""
    rows, columns = shape
    kind = int(rng.integers(4))
    if kind < 2:
        y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
        turn, size = rng.uniform(0, np.pi), rng.uniform(1.5, 12)
        first = np.sin((x * np.cos(turn) + y * np.sin(turn)) * np.float32(np.pi / size))
        second = np.sin((y * np.cos(turn) - x * np.sin(turn)) * np.float32(np.pi / size))
        wave = first if kind == 0 else first * second
        return np.asarray(wave > rng.uniform(-0.6, 0.6), dtype=np.float32)
    coarse = int(rng.choice([1, 2, 3, 5, 9]))
    field = rng.normal(size=(max(2, rows // coarse), max(4, columns // coarse))).astype(np.float32)
    wide = cv2.resize(field, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide > rng.uniform(-1, 1) if kind == 2 else np.clip(wide * 0.5 + 0.5, 0, 1), dtype=np.float32)
