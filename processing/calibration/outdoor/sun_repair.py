"""A clipped sun replaced on request, from an illuminance reading or from a clear-sky model; never silently.

The sun becomes a uniform disc 0.533 degrees wide. Its pixels are marked `Validity.REPAIRED`; clipped pixels beside the
disc (the lens's glare) keep their lower bound and their mark.
"""

import math
from dataclasses import replace

import numpy as np

from processing.calibration.outdoor.sun_disc import SUN_RADIUS_RAD, SUN_SOLID_ANGLE_SR, Window, find_sun, window_at
from processing.calibration.outdoor.sun_place import RAYLEIGH, Beam
from processing.calibration.scale.photometry import level_lx
from processing.errors import ParameterError, SunError
from processing.ground.arrays import Doubles
from processing.pictures.images import LuminanceImage, Validity, luminance_cd_m2

_GRID = 9  # samples a side of each pixel on the disc
TOP_RGB = (1.09, 1.0, 0.96)
"""Colour of the sun above the atmosphere, Rec. 709; through 1.5 air masses that of ASTM G173-03, direct, to 2 %."""
AEROSOL = (0.09, 0.10, 0.12)
"""Optical depth for red, green and blue light of usual clear air: 0.1 at 550 nm, Angstrom exponent 1.3 (Iqbal 1983)."""
BRIGHTEST_CD_M2 = 2.1e9  # above the atmosphere: no sun is brighter (133 klx over 6.8e-5 sr, with margin)


READING_SIGMA = 0.05  # relative standard uncertainty of a lux meter's reading in the field (chosen)


def repair_sun(
    image: LuminanceImage, *, horizontal_lx: float | None = None, beam: Beam | None = None
) -> tuple[LuminanceImage, str]:
    """Return the picture with its clipped sun replaced, and one sentence on what was done.

    ``horizontal_lx``: the outdoor meter's reading; the sun gives what the rest of the picture does not. ``beam``: a
    clear sky's sun (`clear_beam`). Exactly one is given. Raises `SunError` for a sun that is not clipped, a reading
    below what the sky alone gives, or one that no sun can give.
    """
    if (horizontal_lx is None) == (beam is None):
        raise ParameterError("a clipped sun is repaired from an illuminance or from a clear sky: give one")
    sun = find_sun(image)
    if not sun.clipped:
        raise SunError("the sun is not clipped: there is nothing to repair", advice="leave the picture as it is")
    row, column = ((s.start + s.stop - 1) // 2 for s in (sun.rows, sun.columns))
    window = window_at(image, row, column)
    cover = _coverage(window, np.array(sun.direction))
    sine = math.sin(sun.elevation_rad)
    seen = min(1.0, float((cover * window.pixel_sr).sum()) / SUN_SOLID_ANGLE_SR) if sun.cut else 1.0
    empty = _without_sun(image, window, cover)
    rest_lx, before_lx = level_lx([empty, image])
    if horizontal_lx is not None:
        normal, sigma = _normal_of_reading(horizontal_lx, rest_lx, sine * seen, image)
    else:
        assert beam is not None
        normal, sigma = beam.normal_lx, beam.relative_uncertainty
    luminance = normal / SUN_SOLID_ANGLE_SR
    if not 0 < luminance < BRIGHTEST_CD_M2:
        text = f"the sun would be {luminance:.3g} cd/m2"
        likely = "the reading, k1 or k2 is wrong, or the sun was behind a cloud"
        raise SunError(text, likely=likely, advice="check the illuminance reading and its time")
    done = _painted(empty, window, cover, luminance * _colour(sun.elevation_rad), sigma)
    note = (
        f"the clipped sun was restored from {'a clear-sky model' if beam else 'the illuminance reading'}: "
        f"{luminance:.3g} cd/m2 (standard uncertainty {sigma:.0%}), {normal * sine * seen:.4g} lx horizontal, plus "
        f"{rest_lx:.4g} lx from the rest of the sky; the picture alone gave at least {before_lx:.4g} lx in total"
    )
    return replace(done, attributes={**image.attributes, "sun_repaired": note}), note


def _normal_of_reading(horizontal_lx: float, rest_lx: float, sine: float, image: LuminanceImage) -> tuple[float, float]:
    """Return the sun's normal illuminance that a reading leaves for it, and its relative uncertainty."""
    if not (math.isfinite(horizontal_lx) and horizontal_lx > 0):
        raise ParameterError(f"an illuminance of {horizontal_lx} lx")
    left = horizontal_lx - rest_lx
    if sine < math.sin(SUN_RADIUS_RAD) or left <= 0:
        raise SunError(
            f"the reading of {horizontal_lx:.4g} lx leaves {left:.4g} lx for the sun beside the sky's {rest_lx:.4g} lx",
            likely="a reading from another moment, a sun at the horizon, or a wrong k1 or k2",
            advice="repair it from the clear sky, or leave it clipped",
        )
    sigma = math.hypot(READING_SIGMA * horizontal_lx, image.scale_uncertainty * rest_lx) / left
    return left / sine, sigma


def _coverage(window: Window, centre: Doubles) -> Doubles:
    """Return how much of each pixel (h, w) the disc covers, scaled so that all of it is covered once."""
    across, down = np.gradient(window.ways, axis=1), np.gradient(window.ways, axis=0)
    near = window.angle_from(centre) < SUN_RADIUS_RAD + 2 * np.sqrt(window.pixel_sr.max())
    rows, columns = np.nonzero(near & window.inside)
    offsets = (np.arange(_GRID) + 0.5) / _GRID - 0.5
    cover = np.zeros(window.luminance.shape)
    for dy in offsets:
        for dx in offsets:
            way = window.ways[rows, columns] + dx * across[rows, columns] + dy * down[rows, columns]
            way = way / np.linalg.norm(way, axis=1, keepdims=True)
            chord = np.linalg.norm(way - centre, axis=1)
            cover[rows, columns] += chord < 2 * math.sin(SUN_RADIUS_RAD / 2)
    cover /= _GRID**2
    held = float((cover * window.pixel_sr).sum())
    if held == 0:  # a disc that falls between the samples of one large pixel
        nearest = np.unravel_index(np.where(window.inside, window.angle_from(centre), np.inf).argmin(), cover.shape)
        cover[nearest] = 1.0
        held = float(window.pixel_sr[nearest])
    # Where the disc is whole its pixels hold exactly its solid angle; where it is cut they hold what they hold.
    whole = not (near & ~window.inside).any()
    return cover * (SUN_SOLID_ANGLE_SR / held) if whole else cover


def _without_sun(image: LuminanceImage, window: Window, cover: Doubles) -> LuminanceImage:
    """Return the picture with the disc's pixels at the sky's level beside them."""
    ring = window.inside & ~window.clipped & (cover == 0)
    middle = np.einsum("hw,hwc->c", cover, window.ways)
    near = ring & (window.angle_from(np.asarray(middle / np.linalg.norm(middle))) < 6 * SUN_RADIUS_RAD)
    chosen = near if near.any() else ring
    rgb = image.rgb.copy()
    part = rgb[window.rows, window.columns]
    part[cover > 0] = np.median(part[chosen], axis=0) if chosen.any() else np.zeros(3, dtype=np.float32)
    return replace(image, rgb=rgb)


def _colour(elevation_rad: float) -> Doubles:
    """Return the RGB (3,) of luminance 1 that air leaves of the sun: what clipped pixels do not show."""
    import pvlib

    mass = float(pvlib.atmosphere.get_relative_airmass(90 - math.degrees(max(elevation_rad, 0.0))))
    rgb = np.array(TOP_RGB) * np.exp(-mass * (np.array(RAYLEIGH) + AEROSOL))
    return np.asarray(rgb / luminance_cd_m2(rgb))


def _painted(image: LuminanceImage, window: Window, cover: Doubles, disc_rgb: Doubles, sigma: float) -> LuminanceImage:
    """Return the picture with a disc of RGB (3,) added, its pixels marked, their uncertainty set."""
    rgb, uncertainty, validity = image.rgb, image.uncertainty.copy(), image.validity.copy()
    disc = cover > 0
    part = (window.rows, window.columns)
    rgb[part] += (cover[..., None] * disc_rgb).astype(np.float32)
    uncertainty[part][disc] = np.float32(max(sigma, 1e-6))
    validity[part][disc] = Validity.REPAIRED
    return replace(image, uncertainty=uncertainty, validity=validity)
