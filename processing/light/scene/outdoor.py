"""The light outdoors from a measured picture of the sky, or from a sky of one's own; the sun is taken out of it.

A fisheye sees no ground: below the horizon the picture is filled with ground of a given albedo under its own light.
"""

import math

import numpy as np

from processing.errors import SceneError
from processing.ground.arrays import Doubles, Flags, Floats
from processing.light.scene.scene import SUN_RADIUS_RAD, Outdoors, Sun
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, directions, point_directions, solid_angles
from processing.sphere.resampling import resample

GROUND_ALBEDO = 0.2  # grass, soil and asphalt lie between 0.1 and 0.3
SUN_SEARCH_RAD = math.radians(2.5)  # around the brightest place: the disc as lenses and merging blur it
SUN_TIMES_SKY = 20.0  # the sun is what exceeds the sky beside it this many times; a cloud's edge does not
SPACE_SUN = np.array([1.09, 0.98, 0.96])  # colour of the sun above the air: x 0.322, y 0.331 (ASTM E490)
AIR_DEPTH = np.array([0.147, 0.2, 0.324])
"""Optical depth for red, green and blue of clean air (0.06, 0.10, 0.20) and usual haze (Angstrom's 1.3 and 0.1)."""
MOST_TINT = 0.35  # natural logarithm: by which two channels may differ from that colour; chosen, twice what haze does
LEAST_SUN_LX = 500.0
"""Of an excess that is called the sun; a veiled sun below is left in the sky, where it neither flickers nor matters."""

ROWS = 256  # of the panorama that outdoor pictures are brought to: 0.7 degrees; chosen, never swept


def outdoors_of(image: LuminanceImage) -> Outdoors:
    """Return the light of a calibrated outdoor picture (a fisheye that looks up, or a panorama), the sun kept apart.

    Raises `SceneError`: nothing of the sky is seen.
    """
    weights = (image.validity != Validity.OUTSIDE).astype(np.float32)
    rgb, found = _sun_apart(image, weights)
    panorama, coverage = resample(rgb, image.geometry, Equirectangular(2 * ROWS, ROWS), weights=weights)
    known = coverage > 0.5
    if not known[: ROWS // 2].any():
        raise SceneError("no part of the sky is seen", where="outdoor picture", advice="check its geometry")
    panorama = _filled_sky(panorama, known)
    return Outdoors(with_ground(panorama, known, found, GROUND_ALBEDO), found)


_COARSE_PX = 16  # between the directions by which the sun's neighbourhood is found


def _sun_apart(image: LuminanceImage, weights: Floats) -> tuple[Floats, Sun | None]:
    """Return a picture (H, W, 3) without its sun, and the sun, from the part of it about its brightest pixel.

    ``weights`` (H, W): 0 outside the field."""
    light = luminance_cd_m2(image.rgb) * (weights > 0)
    row, column = np.unravel_index(int(light.argmax()), light.shape)
    high, wide = light.shape
    y, x = np.arange(0, high, _COARSE_PX), np.arange(0, wide, _COARSE_PX)
    ways, _ = point_directions(image.geometry, x + 0.5, y[:, None] + 0.5)
    brightest, _ = point_directions(image.geometry, np.array([column + 0.5]), np.array([row + 0.5]))
    near = np.arccos(np.clip(ways @ brightest[0], -1, 1)) < 3 * SUN_SEARCH_RAD
    y, x = y[near.any(axis=1)], x[near.any(axis=0)]
    if not len(y):
        return image.rgb, None
    rows = slice(max(y[0] - _COARSE_PX, 0), y[-1] + 2 * _COARSE_PX)
    part = rows, slice(max(x[0] - _COARSE_PX, 0), x[-1] + 2 * _COARSE_PX)
    area = solid_angles(image.geometry)[part] * weights[part]
    rays, clipped = directions(image.geometry, rows)[0][:, part[1]], image.validity[part] == Validity.CLIPPED
    rest, found = without_sun(image.rgb[part].astype(np.float64), rays, area, clipped)
    if found is None:
        return image.rgb, None
    rgb = image.rgb.copy()
    rgb[part] = rest
    return rgb, found


def with_ground(panorama: Floats, known: np.ndarray, sun: Sun | None, albedo: float) -> Floats:
    """Return a panorama (H, 2 H, 3) with matte ground below the horizon where it is not ``known`` (H, 2 H)."""
    if not 0 <= albedo <= 1:
        raise SceneError(f"a ground albedo of {albedo}", advice="give 0 to 1")
    geometry = Equirectangular(panorama.shape[1], panorama.shape[0])
    rays, _ = directions(geometry)
    light = np.maximum(rays[..., 2], 0) * solid_angles(geometry)
    level_lx = np.tensordot(light, panorama.astype(np.float64), axes=2)
    if sun is not None:
        level_lx = level_lx + np.asarray(sun.normal_illuminance_lx) * max(sun.direction[2], 0.0)
    ground = (albedo / math.pi * level_lx).astype(np.float32)
    below = ~known & (rays[..., 2] < 0)
    return np.where(below[..., None], ground, panorama)


def without_sun(
    rgb: Doubles, rays: Doubles, area_sr: Doubles, clipped: Flags | None = None
) -> tuple[Doubles, Sun | None]:
    """Return a picture (H, W, 3) without its sun, and the sun; all its excess over the sky beside it is kept.

    The excess's illuminance on a plane facing it becomes the sun's; its middle is weighted by light. ``clipped``
    (H, W): pixels that are lower bounds; what little an overexposed disc shows is a sun's, too.
    """
    luminance = rgb @ np.asarray(LUMINANCE_WEIGHTS) * (area_sr > 0)
    peak = np.unravel_index(int(luminance.argmax()), luminance.shape)
    away = np.arccos(np.clip(rays @ rays[peak], -1, 1))
    near, ring = away < SUN_SEARCH_RAD, (away >= SUN_SEARCH_RAD) & (away < 2 * SUN_SEARCH_RAD) & (area_sr > 0)
    if luminance[peak] <= 0 or not ring.any():
        return rgb, None
    beside = np.median(rgb[ring], axis=0)
    over = near & (luminance > SUN_TIMES_SKY * max(float(beside @ np.asarray(LUMINANCE_WEIGHTS)), 1e-6))
    excess = np.where(over[..., None], np.maximum(rgb - beside, 0), 0.0) * area_sr[..., None]
    light = excess.sum(axis=(0, 1))
    cut = clipped is not None and bool((clipped & over).any())
    if not over.any() or (light @ np.asarray(LUMINANCE_WEIGHTS) < LEAST_SUN_LX and not cut):
        return rgb, None
    middle = np.tensordot(excess @ np.asarray(LUMINANCE_WEIGHTS), rays, axes=2)
    x, y, z = (float(v) for v in middle / np.linalg.norm(middle))
    red, green, blue = (float(v) for v in _credible(light, z))
    rest = np.where(over[..., None], np.minimum(rgb, beside), rgb)
    return rest, Sun((x, y, z), (red, green, blue), SUN_RADIUS_RAD, cut)


def _credible(light: Doubles, sine: float) -> Doubles:
    """Return the sun's light (3,) in the colour that air leaves it at this height, if its own is none of the sun's.

    A disc of few pixels shows the colours of single filters of a camera's mosaic, an overexposed one that of clipping.
    """
    height_deg = math.degrees(math.asin(max(sine, 0.0)))
    mass = 1 / (max(sine, 0.0) + 0.50572 * (height_deg + 6.07995) ** -1.6364)  # Kasten and Young 1989
    colour, weights = SPACE_SUN * np.exp(-AIR_DEPTH * mass), np.asarray(LUMINANCE_WEIGHTS)
    level = float(light @ weights)
    apart = np.log(np.maximum(light, 1e-9) / level) - np.log(colour / float(colour @ weights))
    return light if np.ptp(apart) < MOST_TINT else colour * (level / float(colour @ weights))


def _filled_sky(panorama: Floats, known: np.ndarray) -> Floats:
    """Give unknown pixels above the horizon the mean of what is known in their row, or in the nearest known row."""
    out = panorama.copy()
    rows = np.flatnonzero(known[: len(known) // 2].any(axis=1))
    for row in range(len(known) // 2):
        unknown = ~known[row]
        if unknown.any():
            nearest = rows[np.abs(rows - row).argmin()]
            out[row, unknown] = panorama[nearest, known[nearest]].mean(axis=0)
    return out
