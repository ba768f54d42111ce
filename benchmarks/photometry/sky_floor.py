"""The sky with everything known: what noise and JPEG alone leave of its luminance, by pixel and by the meter's spot."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.sessions import Taken
from mocks.worlds.light import Site, luminance_cd_m2
from processing.calibration.merge.merge import merge
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.ground.arrays import Doubles, Flags, Floats
from processing.rig.camera_fit import CameraFit, SessionSide
from station.session.session import Side

SPOT_RAD = math.radians(1 / 3)
"""The meter's spot: the scale on which the paper measures luminance."""
_FINE = 16
_DISC_RAD = math.radians(1.5)


@dataclass(frozen=True)
class SkyErrors:
    """Relative errors of luminance: of pixels, and of means over the meter's spot."""

    median: float
    p95: float
    spot_p95: float


def sky_errors(shown: Doubles, truth: Doubles, use: Flags, rows: npt.NDArray[np.intp], pixel_sr: float) -> SkyErrors:
    """Return the errors of bands of rows (h, W) where ``use``; a spot counts where all of its pixels do."""
    error = np.abs(shown / np.maximum(truth, 1e-9) - 1)
    disc = _spot_kernel(math.sqrt(math.pi * (SPOT_RAD / 2) ** 2 / pixel_sr / math.pi))
    spots = []
    for band in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1):
        # A band's border is mirrored in both pictures alike: fewer pixels, so rather more error.
        inside = cv2.filter2D(use[band].astype(np.float64), -1, disc, borderType=cv2.BORDER_REFLECT) > 1 - 1e-6
        mean = [cv2.filter2D(p[band], -1, disc, borderType=cv2.BORDER_REFLECT) for p in (shown, truth)]
        spots.append(np.abs(mean[0][inside] / np.maximum(mean[1][inside], 1e-9) - 1))
    found = np.concatenate(spots)
    return SkyErrors(
        float(np.median(error[use])), float(np.quantile(error[use], 0.95)), float(np.quantile(found, 0.95))
    )


def sky_all_known(
    camera: CameraFit, taken: Taken, side: SessionSide, rows: npt.NDArray[np.intp], scene: Floats
) -> Doubles:
    """Return the luminance (h, W) of rows of the same frames, with true curve, noise, veil, tint, fall-off and scale.

    ``scene``: the radiance (h, W, 3) that these pixels truly average; it serves for the veil alone.
    """
    optics, size = taken.optics(Side.OUTDOOR), taken.size_px(Side.OUTDOOR)
    assert camera.lens is not None
    sensor, usual = optics.sensor, optics.usual_settings
    curve = taken.bodies[Side.OUTDOOR].log2_exposure()
    own = camera.response.curve
    known = replace(own, log2_exposure=curve, sigma_log2=np.zeros_like(curve), method="truth")
    electrons = sensor.full_well_e * 100 / usual.iso * np.array(sensor.native_balance)
    noise = _noise(1 / electrons, sensor.read_noise_e / electrons, camera)
    merged = _merged(side, camera, known, noise, size)[rows]
    gain = sensor.exposure_gain(usual) / sensor.true_shutter.seconds(usual.shutter_s) * 10**-optics.filter.density
    x, y = np.arange(size[0], dtype=np.float32) + 0.5, (rows[:, None] + 0.5).astype(np.float32)
    fall = np.broadcast_to(optics.lens.falloff(x, y, size), scene.shape[:2])[..., None]
    undense = np.float32(10**optics.filter.density)
    veil = _mean_image(taken, rows, scene) * undense
    light = (merged / np.float32(gain) - optics.glare * veil) / ((1 - optics.glare) * np.maximum(fall, 1e-6))
    return luminance_cd_m2((light @ np.linalg.inv(np.array(optics.filter.tint))).astype(np.float32)).astype(np.float64)


def _noise(photon: Doubles, read: Doubles, camera: CameraFit) -> NoiseModel:
    """Return the true sensor's noise; that of coding is as it was found, since no figure of it is known."""
    red, green, blue = (float(v) for v in photon)
    dark = tuple(float(v) for v in read)
    return NoiseModel((red, green, blue), (dark[0], dark[1], dark[2]), camera.response.noise.code_variance)


def _merged(
    side: SessionSide, camera: CameraFit, curve: ResponseCurve, noise: NoiseModel, size: tuple[int, int]
) -> Floats:
    assert camera.lens is not None
    times = side.true_times_s(camera.shutter)
    return merge(side.frames, times, curve, noise, geometry=camera.lens.fisheye(size)).image.rgb


def _mean_image(taken: Taken, rows: npt.NDArray[np.intp], scene: Floats) -> Doubles:
    """Return the mean light (3,) on the sensor's field: the bands' without the sun, and the sun's as it is known."""
    optics, size = taken.optics(Side.OUTDOOR), taken.size_px(Side.OUTDOOR)
    x, y = np.arange(size[0], dtype=np.float32) + 0.5, (rows[:, None] + 0.5).astype(np.float32)
    ways, seen = optics.lens.directions(x, y, size)
    light = optics.filter.apply(scene) * optics.lens.falloff(x, y, size)[..., None]
    clear = seen.copy()
    for disc in taken.world.discs(Site.OUTDOOR):
        clear &= ways @ np.array(disc.direction, dtype=np.float32) < math.cos(_DISC_RAD)
    cells = np.broadcast_to(optics.lens.solid_angle_sr(x, y, size), seen.shape)
    total = (light[clear] * cells[clear, None]).sum(axis=0, dtype=np.float64)
    total *= cells[seen].sum(dtype=np.float64) / cells[clear].sum(dtype=np.float64)
    field = float(cells[seen].sum(dtype=np.float64))
    mean = total / field
    for disc in taken.world.discs(Site.OUTDOOR):
        place = optics.lens.pixel_of(disc.direction, size)
        if place is not None:
            at = [np.array([v], dtype=np.float32) for v in place]
            shine = optics.filter.apply(np.array([disc.radiance_rgb], dtype=np.float32))[0]
            mean += shine * float(optics.lens.falloff(at[0], at[1], size)[0]) * disc.solid_angle_sr / (2 * math.pi)
    return np.asarray(mean)


def _spot_kernel(radius_px: float) -> Doubles:
    """Return a disc's share of each pixel around the middle one, summing to 1."""
    reach = math.ceil(radius_px)
    fine = (np.arange((2 * reach + 1) * _FINE) + 0.5) / _FINE - reach - 0.5
    inside = (np.hypot(fine[:, None], fine[None]) <= radius_px).astype(np.float64)
    shares = inside.reshape(2 * reach + 1, _FINE, 2 * reach + 1, _FINE).sum(axis=(1, 3))
    return np.asarray(shares / shares.sum())
