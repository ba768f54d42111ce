"""Generated floors under a window's light, seen in perspective and laid flat again: what filling is judged by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from mocks.rooms.model import Texture
from mocks.rooms.textures.catalogue import tile
from processing.ground.arrays import Flags, Floats

PICTURE_PX = (480, 640)
FLAT_PX = 440
FLAT_M = 2.2
"""Less than a generated texture takes to repeat."""
NEAR_M = 1.1
CAMERA_M = 1.6
PITCH_RAD = 0.62
FOCAL_PX = 420.0
NOISE = 0.008

SORTS = ("tile", "herringbone", "planks", "chequered", "laminate", "carpet")


@dataclass(frozen=True)
class FlatFloor:
    """A floor as a picture shows it, laid flat: linear light, 1 is near white."""

    sort: str
    picture: Floats
    """(h, w, 3) as the camera sees it."""
    flat: Floats
    seen: Flags
    to_picture: npt.NDArray[np.float64]
    """(3, 3): pixel centres of the flat floor to those of the picture."""


def texture_of(sort: str, seed: int) -> Texture:
    """Return a texture drawn at random within a sort."""
    rng = np.random.default_rng([seed, SORTS.index(sort)])
    shade = float(rng.uniform(0.8, 1.2))
    wood: Any = tuple(shade * c for c in (0.42, 0.27, 0.16))
    light: Any = tuple(shade * c for c in (0.55, 0.50, 0.44))
    grout: Any = tuple(shade * c for c in (0.22, 0.21, 0.2))
    dark: Any = tuple(shade * c for c in (0.12, 0.11, 0.1))
    side = float(rng.uniform(0.25, 0.45))
    return {
        "tile": lambda: Texture(
            "tiles",
            seed,
            (light, grout),
            (("tile_u_m", side), ("tile_v_m", side), ("gap_m", 0.008), ("variation", 0.04), ("clouding", 0.03)),
        ),
        "chequered": lambda: Texture(
            "tiles", seed, (light, grout, dark), (("tile_u_m", side), ("tile_v_m", side), ("chequered", 1.0))
        ),
        "herringbone": lambda: Texture(
            "herringbone",
            seed,
            (wood, dark),
            (("block_m", float(rng.uniform(0.07, 0.11))), ("ratio", 5.0), ("variation", 0.07)),
        ),
        "planks": lambda: Texture(
            "planks",
            seed,
            (wood, dark),
            (("board_m", float(rng.uniform(0.1, 0.16))), ("length_m", 1.4), ("gap_m", 0.003), ("variation", 0.09)),
        ),
        "laminate": lambda: Texture("laminate", seed, (wood, dark), (("strips", 3.0), ("board_m", 0.2))),
        "carpet": lambda: Texture("carpet loop", seed, (light,)),
    }[sort]()


def _homography() -> npt.NDArray[np.float64]:
    """Return the map from floor places (x to the right, y ahead, m, 1) to the picture's pixels."""
    s, c = np.sin(PITCH_RAD), np.cos(PITCH_RAD)
    height, width = PICTURE_PX
    camera = np.array([[FOCAL_PX, 0, width / 2], [0, FOCAL_PX, height / 2], [0, 0, 1]])
    # Camera axes: right, down, ahead; the camera looks down by the pitch.
    down, ahead = (0.0, -s, -c), (0.0, c, -s)
    rows = []
    for axis in ((1.0, 0.0, 0.0), down, ahead):
        rows.append([axis[0], axis[1], -axis[2] * CAMERA_M])
    return np.asarray(camera @ np.array(rows))


def flat_floor(sort: str, seed: int) -> FlatFloor:
    """Return a floor seen by a camera 1.6 m high, lit by a window at one side."""
    made = tile(texture_of(sort, seed))
    rng = np.random.default_rng([seed, 17])
    to_pixels = _homography()
    height, width = PICTURE_PX
    fine = 2
    y, x = np.mgrid[: height * fine, : width * fine].astype(np.float64)
    place = np.linalg.inv(to_pixels) @ np.stack([(x.ravel() + 0.5) / fine, (y.ravel() + 0.5) / fine, np.ones(x.size)])
    east, north = (place[:2] / place[2]).reshape(2, *x.shape)
    down = place[2].reshape(x.shape)
    ahead = (down * np.sign(down[-1, 0]) > 0) & (north < 12)
    rows, columns = made.albedo.shape[:2]
    u = (np.where(ahead, east, 0) / made.size_m[0] % 1) * columns
    v = (np.where(ahead, north, 0) / made.size_m[1] % 1) * rows
    wrapped = cv2.copyMakeBorder(made.albedo, 2, 2, 2, 2, cv2.BORDER_WRAP)
    shown = cv2.remap(wrapped, (u + 1.5).astype(np.float32), (v + 1.5).astype(np.float32), cv2.INTER_LINEAR)
    side, reach = float(rng.uniform(-1, 1)), float(rng.uniform(1.2, 2.2))
    glow = 0.45 + 0.9 / (1 + ((east - 2.5 * np.sign(side)) ** 2 + (north - 2.5 - side) ** 2) / reach**2)
    lit = shown * glow[..., None].astype(np.float32)
    small = cv2.resize(lit, (width, height), interpolation=cv2.INTER_AREA)
    picture = np.clip(small + rng.normal(0, NOISE, small.shape) * np.sqrt(np.maximum(small, 0.02)), 0, 1)
    picture = picture.astype(np.float32)
    step = FLAT_M / FLAT_PX
    to_floor = np.array(
        [[step, 0, 0.5 * step - FLAT_M / 2], [0, -step, NEAR_M + FLAT_M - 0.5 * step], [0, 0, 1]], np.float64
    )
    centres = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    to_picture = centres @ to_pixels @ to_floor
    flat, seen = laid_flat(picture, to_picture)
    return FlatFloor(sort, picture, flat, seen, to_picture)


def laid_flat(picture: Floats, to_picture: npt.NDArray[np.float64]) -> tuple[Floats, Flags]:
    """Return a picture's floor seen from above, and where it is in the picture."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    flat = cv2.warpPerspective(picture, to_picture, (FLAT_PX, FLAT_PX), flags=flags)
    ones = np.ones(picture.shape[:2], np.float32)
    return flat, cv2.warpPerspective(ones, to_picture, (FLAT_PX, FLAT_PX), flags=flags) > 0.999


def blob(among: Flags, share: float, seed: int) -> Flags:
    """Return a smooth-edged blob near the middle that covers a share of ``among``."""
    rng = np.random.default_rng(seed)
    height, width = among.shape
    y, x = np.mgrid[:height, :width]
    away_x, away_y = (x - width * rng.uniform(0.35, 0.65)) * height / width, y - height * rng.uniform(0.35, 0.65)
    angle = np.arctan2(away_y, away_x)
    form = 1 + sum(rng.uniform(-0.12, 0.12) * np.cos(k * angle + rng.uniform(0, 6.28)) for k in (2, 3, 4, 5))
    distance = np.hypot(away_x, away_y) / form
    return np.asarray((distance < np.quantile(distance[among], share)) & among)
