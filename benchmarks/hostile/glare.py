"""Stray light taken off by the kernel that the surround of the image circle gives, in and out of its family.

Uncropped fisheye frames of 720 x 480 of three real HDR scenes, facing the brightest window (the zenith outdoors), nine
JPEG frames a bracket by a hostile camera with a published real curve: curve and kernel are estimated from these frames.
Lenses: `even`, the simulated rig's own family, an even veil of 0.5 % and another part of 1 % that is in the kernel's;
`halo`, hostile: 2 % in a Gaussian of about 28 degrees and a mirrored ghost, which no sum of the kernel's parts gives.
Errors, medians of |measured / true - 1| after a common scale (the median over the middle half of the luminances):
`near`, within 3 to 12 degrees of the brightest thousandth; `dark`, the darkest twentieth of the field.
`lamps`: a panorama camera of two lenses, each of which scatters within its own half: 0.8 % exponentially over 17
degrees, 0.4 % evenly and 0.2 % as a mirrored ghost, which no sum of the kernel's parts gives. Three lamps in a dark
room, seen and hidden, show the kernel; the same three scenes lose it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from benchmarks.hostile.merging import merged_pictures
from benchmarks.hostile.worlds import Curves, HostileCamera, HostileWorld, hostile_bracket
from benchmarks.kept_rows import Row, fresh
from processing.calibration.optics import glare_taken_off
from processing.calibration.response.response import ResponseFit, recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.scale.glare_fit import GlareKernel
from processing.calibration.scale.lamp_glare import kernel_from_lamps
from processing.calibration.scale.veiling_glare import kernel_modes, unmeasured_modes, without_glare
from processing.errors import LensError, ProcessingError
from processing.ground.arrays import Flags, Floats
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.pictures.modes import widened
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions, pixels, solid_angles

FRAME = (720, 480)
RADIUS = 0.48  # of the frame's height
LENSES = {"in_family": 0.0, "hostile": 0.02}
EVEN, NEAR_SHARE, NEAR_RAD = 0.005, 0.01, 0.15
CLOSE_RAD = (math.radians(3), math.radians(12))
BRIGHT_PCT, DARK_PCT = 99.9, 5.0
LAMPS = ((0.2, 0.9, 0.1), (-0.8, 0.5, 0.3), (0.4, -0.8, 0.0))
LAMP, WEAKER = 3e4, 4  # its light, 0.75 of what saturates the shortest frame; lamps tried, each half as bright
WHITE_S = 5.0


def stray_light_figures(curves: Curves, scenes: list[Floats], seed: int, kept: Row = fresh) -> dict[str, float]:
    """Return errors near bright places and in dark corners, as taken and with the kernel taken off, and coverage.

    ``kept``: where rows of a lens and a scene are kept.
    """
    irradiance, shown = curves
    rows: dict[str, list[float]] = {}
    for family, halo in LENSES.items():
        for k, scene in enumerate(scenes):
            camera = HostileCamera(irradiance, shown[(seed + k) % len(shown)], jpeg=("opencv", 95, "4:2:2"), seed=seed)
            world = HostileWorld(family, camera, halo=halo)
            found = kept(f"glare {family} {k}", partial(_one, world, scene, not halo, seed + k))
            for key, value in found.items():
                rows.setdefault(f"glare_{family}_{key}", []).append(value)
    for k, scene in enumerate(scenes):
        camera = HostileCamera(irradiance, shown[(seed + k + 3) % len(shown)], jpeg=("opencv", 95, "4:2:2"), seed=seed)
        found = kept(f"glare lamps {k}", partial(_by_lamps, HostileWorld("lamps", camera), scene, seed + k))
        for key, value in found.items():
            rows.setdefault(f"glare_lamps_{key}", []).append(value)
    return {key: float(np.median(values)) for key, values in rows.items()}


def _by_lamps(world: HostileWorld, scene: Floats, seed: int) -> dict[str, float]:
    height, width = scene.shape[:2]
    geometry = Equirectangular(width, height)
    bracket = hostile_bracket(world, _two_lens_glare(scene), WHITE_S, seed)
    fit = recover_response([Bracket8(bracket.frames, bracket.nominal_s)])

    kernel = lamp_kernel(world, geometry, fit, seed, _two_lens_glare)
    image = merged_pictures(bracket.frames, geometry, fit)
    truth = luminance_cd_m2(cv2.GaussianBlur(scene, (0, 0), 0.7))
    bright = truth >= np.percentile(truth, BRIGHT_PCT)
    apart = cv2.distanceTransform((~bright).astype(np.uint8), cv2.DIST_L2, 5) * math.pi / height
    places = {
        "near": (apart > CLOSE_RAD[0]) & (apart < CLOSE_RAD[1]),
        "dark": (truth <= np.percentile(truth, DARK_PCT)) & (truth > 0),
    }
    before, after = _errors(image, truth, places, None), _errors(without_glare(image, kernel), truth, places, kernel)
    return (
        {"index_pct": 100 * kernel.index}
        | {f"{k}_kept_pct": v for k, v in before.items()}
        | {f"{k}_pct": v for k, v in after.items()}
    )


def lamp_kernel(
    world: HostileWorld,
    geometry: Equirectangular,
    fit: ResponseFit,
    seed: int,
    scattering: Callable[[Floats], Floats] | None = None,
) -> GlareKernel:
    """Return the kernel by three lamps, seen and hidden by a world's camera, whose curve is ``fit``'s.

    ``scattering``: of two lenses, on the light; None: the world's own, of one. Lamps clipped in all frames are refused;
    then weaker ones are taken, as the refusal advises.
    """
    for weaker in range(WEAKER):
        try:
            return _by_three_lamps(world, geometry, fit, seed, scattering, LAMP / 2**weaker)
        except LensError as error:
            if weaker == WEAKER - 1 or "weaker lamp" not in error.advice:
                raise
    raise AssertionError


def _by_three_lamps(
    world: HostileWorld,
    geometry: Equirectangular,
    fit: ResponseFit,
    seed: int,
    scattering: Callable[[Floats], Floats] | None,
    lamp: float,
) -> GlareKernel:
    rays, _ = directions(geometry)
    pairs = []
    for ahead in LAMPS:
        near = rays @ (np.array(ahead) / np.linalg.norm(ahead))
        dark = np.repeat((0.3 + 0.1 * rays[..., :1]).astype(np.float32), 3, axis=2)
        seen, hidden = dark.copy(), dark.copy()
        seen[near > math.cos(math.radians(3))] = lamp
        hidden[near > math.cos(math.radians(7))] = 0.01
        both = [scattering(light) if scattering else light for light in (seen, hidden)]
        frames = [hostile_bracket(world, light, WHITE_S, seed + 50).frames for light in both]
        pairs.append((merged_pictures(frames[0], geometry, fit), merged_pictures(frames[1], geometry, fit)))
    return kernel_from_lamps(pairs, two_lenses=scattering is not None)


def _two_lens_glare(light: Floats) -> Floats:
    """Return a panorama's light through two lenses that scatter: worked out in cells of four degrees."""
    height, width = light.shape[:2]
    small = Equirectangular(96, 48)
    rays = directions(small)[0].reshape(-1, 3)
    area = solid_angles(small).reshape(-1, 1)
    sent = cv2.resize(light, (96, 48), interpolation=cv2.INTER_AREA).reshape(-1, 3) * area
    same = (rays[:, None, 1] > 0) == (rays[None, :, 1] > 0)
    angle = np.arccos(np.clip(rays @ rays.T, -1, 1))
    halo = np.where(same, np.exp(-angle / 0.3), 0)
    halo /= (halo * area[:, 0]).sum(axis=1, keepdims=True)
    # A ghost stands mirrored about the lens's axis.
    ghost = np.where(same, np.exp(-0.5 * (np.arccos(np.clip((rays * (-1, 1, -1)) @ rays.T, -1, 1)) / 0.12) ** 2), 0)
    ghost /= (ghost * area[:, 0]).sum(axis=1, keepdims=True)
    glare = (0.008 * halo + 0.004 * same / (2 * math.pi) + 0.002 * ghost) @ sent
    wide = np.pad(glare.reshape(48, 96, 3).astype(np.float32), ((0, 0), (1, 1), (0, 0)), mode="wrap")
    smooth = cv2.resize(wide, (round(width * 98 / 96), height), interpolation=cv2.INTER_LINEAR)
    off = (smooth.shape[1] - width) // 2
    return np.asarray(0.986 * light + smooth[:, off : off + width], dtype=np.float32)


def _one(world: HostileWorld, scene: Floats, even: bool, seed: int) -> dict[str, float]:
    lens = Fisheye(*FRAME, LensMapping.EQUISOLID, RADIUS * FRAME[1], math.pi / 2)
    light = _seen(scene, lens)
    lit = _even_glare(light, lens) if even else light
    bracket = hostile_bracket(world, lit, 5.0, seed)
    fit = recover_response([Bracket8(bracket.frames, bracket.nominal_s)])
    merged = merged_pictures(bracket.frames, lens, fit)
    truth = luminance_cd_m2(cv2.GaussianBlur(light, (0, 0), 0.7))
    clean, kernel, found = glare_taken_off(merged, lens)
    if kernel is None:
        raise ProcessingError(f"{world.name}: {found['why']}")
    places = _places(truth, lens)
    before, after = _errors(merged, truth, places, None), _errors(clean, truth, places, kernel)
    return {f"{k}_kept_pct": v for k, v in before.items()} | {f"{k}_pct": v for k, v in after.items()}


def _seen(scene: Floats, lens: Fisheye) -> Floats:
    """Return the fisheye's picture (H, W, 3) of a panorama, black around its circle; towards its brightest window."""
    height, width = scene.shape[:2]
    rays, seen = directions(lens)
    blurred = cv2.GaussianBlur(luminance_cd_m2(scene), (0, 0), width / 40)
    row, column = np.unravel_index(np.argmax(blurred), blurred.shape)
    upright = (0.5 - (row + 0.5) / height) * math.pi < math.radians(20)
    turn = (column + 0.5) / width * 2 * math.pi - math.pi
    x, y, z = np.moveaxis(rays[..., [0, 2, 1]] if upright else rays, -1, 0)
    ways = np.stack([x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn), z], axis=-1)
    across, down, _ = pixels(Equirectangular(width, height), ways.astype(np.float32))
    maps = ((across - 0.5).astype(np.float32), (down - 0.5).astype(np.float32))
    found = cv2.remap(scene, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(np.where(seen[..., None], found, 0), dtype=np.float32)


def _even_glare(light: Floats, lens: Fisheye) -> Floats:
    """Return the picture with an even veil, and with scatter whose tail is the cube's, by a kernel of pixels."""
    unit = lens.half_field_rad / lens.radius_px
    y, x = np.mgrid[-FRAME[1] : FRAME[1] + 1, -FRAME[0] : FRAME[0] + 1] * unit
    kernel = NEAR_RAD / (2 * math.pi) * unit**2 / (x**2 + y**2 + NEAR_RAD**2) ** 1.5
    from scipy.signal import fftconvolve

    near = np.stack([fftconvolve(light[..., c], kernel, "same") for c in range(3)], axis=-1)
    inside = directions(lens)[1]
    mean = light[inside].mean(axis=0)
    return np.asarray((1 - EVEN - NEAR_SHARE) * light + NEAR_SHARE * np.maximum(near, 0) + EVEN * mean, np.float32)


def _places(truth: Floats, lens: Fisheye) -> dict[str, Flags]:
    inside = directions(lens)[1]
    bright = inside & (truth >= np.percentile(truth[inside], BRIGHT_PCT))
    apart = cv2.distanceTransform((~bright).astype(np.uint8), cv2.DIST_L2, 5) * lens.half_field_rad / lens.radius_px
    close = inside & (apart > CLOSE_RAD[0]) & (apart < CLOSE_RAD[1])
    return {"near": close, "dark": inside & (truth <= np.percentile(truth[inside], DARK_PCT)) & (truth > 0)}


def _errors(
    image: RelativeImage, truth: Floats, places: dict[str, Flags], kernel: GlareKernel | None
) -> dict[str, float]:
    """Return median errors and coverage of the 95 % interval, per cent; without a kernel as where none is measured."""
    shown, good = luminance_cd_m2(image.rgb), (image.validity == 0) & (truth > 0)
    low, high = np.percentile(truth[good], (25, 75))
    middle = good & (truth > low) & (truth < high)
    scale = np.float32(np.median(truth[middle] / shown[middle]))
    picture = LuminanceImage(image.rgb * scale, image.uncertainty, image.validity, image.geometry, 0.01)
    picture = widened(picture, kernel_modes(picture, kernel) if kernel else unmeasured_modes(picture))
    off, sigma = np.abs(shown * scale / np.maximum(truth, 1e-9) - 1), np.hypot(picture.uncertainty, 0.01)
    figures = {name: 100 * float(np.median(off[place & good])) for name, place in places.items()}
    return figures | {
        f"{name}_cover95": 100 * float(np.mean((off <= 1.96 * sigma)[p & good])) for name, p in places.items()
    }
