"""What is done to a training picture when it is read: turned, mirrored, stretched, recoated, exposed and coloured anew.

A room stretched along its walls' directions is seen, from the stretched camera place, along directions that are known
for every pixel, and its boundaries stay exact (the augmentation that HorizonNet, Sun et al. 2019, introduced). Coats
change over the light that is there: shapes and shadows stay, so that a network learns forms.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Bytes, Doubles, Floats, Indices
from processing.segmentation.evidence import SceneClass
from training.labels import column_longitudes
from training.shards import Examples


def wall_direction_rad(floor_rad: npt.ArrayLike) -> float:
    """Return the azimuth (0 to pi/2) of most of a room's walls, parallel or at right angles, from its boundary (N,)."""
    down = np.minimum(np.asarray(floor_rad, np.float64), -0.03)
    longitude = column_longitudes(len(down))
    reach = 1 / np.tan(-down)
    place = reach * np.exp(1j * longitude)
    step = np.roll(place, -1) - place
    # Leaps from a near wall to a far one behind it run along the line of sight, not along a wall.
    step[np.abs(np.roll(reach, -1) - reach) > 0.35 * reach] = 0
    length = np.abs(step)
    four = (length * np.exp(4j * np.angle(step))).sum()
    return float(np.angle(four) / 4 % (np.pi / 2))


def stretched(arrays: Arrays, along: float, across: float, direction_rad: float) -> Arrays:
    """Return picture (H, W, 3), label (H, W) and columns (W,) of the room stretched by two factors.

    ``along`` is the factor along azimuth ``direction_rad``, ``across`` the one at right angles to it; heights stay.
    """
    rows, columns = arrays["label"].shape
    longitude = column_longitudes(columns) - direction_rad
    source = np.arctan2(np.sin(longitude) / across, np.cos(longitude) / along)
    shrunk = np.hypot(np.sin(longitude) / across, np.cos(longitude) / along)
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows) * np.pi
    from_row = np.arctan2(np.sin(latitude)[:, None], np.cos(latitude)[:, None] * shrunk[None])
    at_row = np.clip((0.5 - from_row / np.pi) * rows - 0.5, 0, rows - 1)
    at_column = ((source + direction_rad) / (2 * np.pi) + 0.5) * columns - 0.5
    map_x = np.broadcast_to(at_column % columns, (rows, columns)).astype(np.float32)
    map_y = at_row.astype(np.float32)
    out: Arrays = {}
    for name, values in arrays.items():
        if values.ndim == 1:
            out[name] = _columns(values, at_column, name, 1 / shrunk)
            continue
        # One column more at either side, so that interpolation meets the seam's other side.
        wide = np.concatenate([values[:, -1:], values, values[:, :1]], axis=1)
        how = cv2.INTER_NEAREST if name == "label" else cv2.INTER_LINEAR
        out[name] = cv2.remap(wide, map_x + 1, map_y, how, borderMode=cv2.BORDER_REPLICATE)
    return out


def _columns(values: npt.NDArray[Any], at: Doubles, name: str, factor: Doubles) -> Floats:
    count = len(values)
    found = np.interp(at % count, np.arange(-1, count + 1), np.concatenate([values[-1:], values, values[:1]]))
    if name.endswith("_rad"):
        # Walls are farther away by the factor, their edges as high as before.
        found = np.arctan2(np.sin(found), np.cos(found) * factor)
    return np.asarray(found, dtype=np.float32)


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


def recoated(rng: np.random.Generator, picture: Floats, label: Bytes) -> Floats:
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


def drawn_batch(rng: np.random.Generator, examples: Examples, chosen: Indices) -> Arrays:
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
