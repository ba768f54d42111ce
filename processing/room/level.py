"""Levelling: how far a panorama is tilted, which way the walls run, and the upright panorama.

The vertical is the axis near the zenith to which most edges run, the walls' direction that of the horizontal axes
(`processing.room.vanishing`). Nothing is turned where the edges are not those of an upright room, or where the tilt
found is no larger than its own uncertainty.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import cv2
import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Doubles, bands
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.room.vanishing import find_arcs, find_axes, rotation_about, rotation_vector
from processing.sphere import Equirectangular, directions, pixels
from processing.sphere.resampling import PAD_PX, cubic_samples, linear_samples, padded_sphere

Image = TypeVar("Image", RelativeImage, LuminanceImage)

LEAST_TILT_RAD = math.radians(0.2)  # a smaller tilt is left: to turn the picture costs more sharpness than it gains
LEAST_SUPPORT = 0.5  # chosen, never swept
MODEL_SIGMA_RAD = math.radians(0.05)  # what walls and door frames are out of plumb together; edges cannot show it
ROWS_AT_ONCE = 1 << 19  # pixels of a band


@dataclass(frozen=True)
class Upright:
    """How to make a panorama upright, and what the walls' direction is then."""

    rotation: Doubles
    """(3, 3): directions of the picture to those of the upright one; identity where it is left as it is."""
    tilt_rad: float
    """Found, whether it is undone or not; 0 where no edges show it."""
    manhattan_rad: float
    """Longitude, modulo a quarter turn, at which walls are seen straight on, in (-pi/4, pi/4], once upright."""
    sigma_rad: float
    """Standard uncertainty of the vertical's direction; inf where no edges show it."""
    support: float
    """0..1: how surely the edges are those of an upright room."""
    manhattan_support: float
    """0..1: how surely the walls run along two directions square to each other."""
    note: str
    """Why it is turned or not."""


def find_upright(image: RelativeImage | LuminanceImage, *, turn: bool = True) -> Upright:
    """Return how an equirectangular picture must be turned to be upright (up to 40 degrees), and its walls' direction.

    ``turn`` False: the picture is taken as upright; its tilt and its walls' direction are reported all the same.

    Raises `ParameterError` for a picture that is not equirectangular.
    """
    _check(image)
    axes = find_axes(find_arcs(image))
    if axes is None:
        return Upright(np.eye(3), 0.0, 0.0, math.inf, 0.0, 0.0, "not levelled: too few straight edges")
    vertical = axes.rows[2]
    tilt = math.atan2(math.hypot(vertical[0], vertical[1]), vertical[2])
    sigma = math.hypot(math.sqrt(axes.covariance[0, 0] + axes.covariance[1, 1]), MODEL_SIGMA_RAD)
    # How surely the axes are a room's: rooms have 0.4 to 0.85 of their edges' length along them, trees 0.2.
    enough = _ramp(axes.length_rad, 3.0, 12.0)
    together = _ramp(float(axes.excess.sum()), 0.2, 0.4)
    support = enough * together * _ramp(axes.excess[2], 0.01, 0.07)
    rotation, note = _decided(vertical, tilt, sigma, support) if turn else (np.eye(3), "not levelled: switched off")
    ahead = rotation @ axes.rows[1]
    return Upright(
        rotation=rotation,
        tilt_rad=tilt,
        manhattan_rad=_quarter(math.atan2(ahead[0], ahead[1])),
        sigma_rad=sigma,
        support=support,
        manhattan_support=enough * _ramp(axes.excess[:2].sum(), 0.1, 0.25),
        note=note,
    )


def _decided(vertical: Doubles, tilt: float, sigma: float, support: float) -> tuple[Doubles, str]:
    tilted = f"tilt {math.degrees(tilt):.2f} ± {math.degrees(sigma):.2f} degrees"
    if support < LEAST_SUPPORT:
        return np.eye(3), f"not levelled: the edges are not those of a room (support {support:.2f})"
    if tilt < max(LEAST_TILT_RAD, sigma):
        return np.eye(3), f"not levelled: {tilted}"
    axis = np.cross(vertical, [0.0, 0.0, 1.0])
    return rotation_about(axis / np.linalg.norm(axis) * tilt), f"turned: {tilted}"


def _ramp(value: float, none: float, full: float) -> float:
    return float(np.clip((value - none) / (full - none), 0.0, 1.0))


def _quarter(angle: float) -> float:
    """Return an angle modulo a quarter turn, in (-pi/4, pi/4]."""
    found = math.remainder(angle, math.pi / 2)
    return found + math.pi / 2 if found <= -math.pi / 4 else found


def make_upright(image: Image, rotation: Doubles) -> Image:
    """Return a picture turned by a rotation of shape (3, 3), twice as wide as high; the same object where it is both.

    Light is sampled cubic, held within the 16 pixels around (linear beside what lies outside the picture, of the rest
    alone); validity, uncertainty and ghosts are those of the nearest pixel. The turn is kept in the attributes
    (``level_rotation``).

    Raises `ParameterError` for a picture that is not equirectangular or a matrix that is no rotation.
    """
    geometry = _check(image)
    turn = np.asarray(rotation, dtype=np.float64)
    if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) or np.linalg.det(turn) < 0:
        raise ParameterError("a matrix that is no rotation", where="levelling", advice="give Upright.rotation")
    rows = round(geometry.width_px / 2)
    target = replace(geometry, width_px=2 * rows, height_px=rows)  # of one that has lost rows
    if np.array_equal(turn, np.eye(3)) and target == geometry:
        return image
    rgb, row, column = _turned(image, geometry, target, turn)
    attributes = {**image.attributes, "level_rotation": [[float(v) for v in line] for line in turn]}
    carried: dict[str, Any] = {
        "rgb": rgb,
        "geometry": target,
        "uncertainty": image.uncertainty[row, column],
        "validity": image.validity[row, column],
        "ghost": None if image.ghost is None else image.ghost[row, column],
        "attributes": attributes | {"level_tilt_deg": round(math.degrees(np.linalg.norm(rotation_vector(turn))), 4)},
    }
    return replace(image, **carried)


def _turned(image: Image, geometry: Equirectangular, target: Equirectangular, turn: Doubles) -> tuple[Any, Any, Any]:
    """Return the light (H, W, 3) and the row and column (H, W) of the nearest pixel of the tilted picture."""
    light = padded_sphere(np.ascontiguousarray(image.rgb, dtype=np.float32))
    seen = padded_sphere((image.validity != Validity.OUTSIDE).astype(np.float32))
    some = not seen.all()
    # Cubic sampling looks a pixel farther than linear.
    far = np.asarray(cv2.erode(seen, np.ones((3, 3), np.uint8)), np.float32) if some else seen
    shown = np.where(seen[..., None] > 0, light, np.float32(0)) if some else light
    shape: tuple[int, int] = (target.height_px, target.width_px)
    rgb = np.empty((*shape, 3), dtype=np.float32)
    rows, columns = np.empty(shape, dtype=np.int32), np.empty(shape, dtype=np.int32)
    for part in bands(target.height_px, max(1, ROWS_AT_ONCE // target.width_px)):
        # Rows of a matrix product: d @ turn is the inverse turn of each d.
        x, y, _ = pixels(geometry, directions(target, part)[0] @ turn)
        at_x, at_y = (x + (PAD_PX - 0.5)).astype(np.float32), (y + (PAD_PX - 0.5)).astype(np.float32)
        sampled = cubic_samples(light, at_x, at_y)
        if some:
            # Elsewhere linear samples of what the picture holds, whatever lies outside it; 0 where it holds nothing
            whole = linear_samples(far, at_x, at_y) == 1
            share = linear_samples(seen, at_x, at_y)[..., None]
            held = linear_samples(shown, at_x, at_y) / np.maximum(share, 1e-6)
            sampled = np.where(whole[..., None], sampled, np.where(share > 0, held, np.float32(0)))
        rgb[part] = sampled
        rows[part] = np.minimum(y.astype(np.int32), geometry.height_px - 1)
        columns[part] = np.minimum(x.astype(np.int32), geometry.width_px - 1)
    return rgb, rows, columns


def _check(image: RelativeImage | LuminanceImage) -> Equirectangular:
    if not isinstance(image.geometry, Equirectangular):
        text = f"a {type(image.geometry).__name__.lower()} picture cannot be levelled"
        raise ParameterError(text, where="levelling", advice="give the equirectangular panorama")
    return image.geometry
