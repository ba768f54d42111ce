"""Noise taken out of irradiance pictures by Open Image Denoise, with normals as guides; never out of a photograph."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from processing.ground.arrays import Floats

WRAP = 0.125
"""Share of a panorama's width that is repeated beyond its seam."""


def available() -> bool:
    """Return whether the denoiser is installed."""
    return find_spec("pyoidn") is not None


def denoised(irradiance: Floats, normal: Floats, nearness: Floats, *, wraps: bool, quality: str = "high") -> Floats:
    """Return irradiance (H, W, 3) without its noise and with its mean kept; as it is where the denoiser is missing.

    Parameters
    ----------
    normal
        (H, W, 3), zero where nothing is rendered.
    nearness
        (H, W), 0..1: 0 where nothing is rendered, larger for nearer surfaces; parts corners of equal normals.
    wraps
        The picture is a panorama whose left and right edges meet.
    quality
        high, balanced (0.4 of its time) or fast (0.2).
    """
    if not available() or min(irradiance.shape[:2]) < 16:
        return irradiance
    import pyoidn

    side = round(WRAP * irradiance.shape[1]) if wraps else 0
    padding = ((0, 0), (side, side), (0, 0))

    def padded(picture: Floats) -> Floats:
        return np.ascontiguousarray(np.pad(picture, padding, mode="wrap") if side else picture, dtype=np.float32)

    guide = np.repeat(nearness[..., None], 3, axis=2).astype(np.float32)
    # The denoiser expects values about 1.
    scale = np.float32(max(float(irradiance.mean()), 1e-20))
    clean = pyoidn.denoise(
        padded(irradiance / scale),
        albedo=padded(guide),
        normal=padded(normal),
        hdr=True,
        clean_aux=True,
        quality=quality,
    )
    clean = np.maximum(np.asarray(clean)[:, side : side + irradiance.shape[1]], 0) * scale
    there = nearness > 0
    kept = clean[there].mean(axis=0, dtype=np.float64)
    whole = irradiance[there].mean(axis=0, dtype=np.float64)
    gain = np.where(kept > 0, whole / np.maximum(kept, 1e-30), 1.0)
    return np.asarray(clean * gain, dtype=np.float32)
