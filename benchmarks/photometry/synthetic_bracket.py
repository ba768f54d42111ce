"""A bracket of a picture that no room has: every luminance from 0.01 to 1,000,000 cd/m2 in equal shares.

It is the measuring stick of response curves and merging: smooth enough that JPEG coding does not drown the noise,
coloured, and exposed by `mocks.optics.sensor` with photon, read and quantisation noise and true shutter times.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from mocks.optics.sensor import Exposure, Sensor, ToneCurve, TrueShutter
from mocks.worlds.light import luminance_cd_m2
from processing.ground.arrays import Bytes, Floats

PAPER_TIMES_S = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
LOG10_RANGE_CD_M2 = (-2.0, 6.0)
REFERENCE_SENSOR = Sensor(
    full_well_e=15000.0,
    read_noise_e=4.0,
    native_balance=(1.0, 1.0, 1.0),
    tone=(ToneCurve(contrast=0.30), ToneCurve(contrast=0.35), ToneCurve(contrast=0.40)),
    true_shutter=TrueShutter.NOMINAL,
)
# Cells over the height, and weights: chosen, smooth enough for JPEG coding.
_OCTAVES = ((6, 1.0), (14, 0.35), (40, 0.08))
_TEXTURE = (6, 0.06)
"""Pixels a cell, and stops: what JPEG coding has to work on, at every size."""
_CHROMA = 0.12


@dataclass(frozen=True)
class SyntheticBracket:
    """Frames (uint8 RGB) with their nominal and true times, and the radiance behind them in cd/m2 units."""

    frames: tuple[Bytes, ...]
    nominal_s: tuple[float, ...]
    true_s: tuple[float, ...]
    radiance: Floats
    sensor: Sensor = field(default=REFERENCE_SENSOR)

    @property
    def luminance(self) -> Floats:
        """Return the true luminance (H, W) in cd/m2."""
        return luminance_cd_m2(self.radiance)


def reference_radiance(size: tuple[int, int], seed: int) -> Floats:
    """Return radiance (H, W, 3) whose luminance is log-uniform over `LOG10_RANGE_CD_M2`, smooth and mildly coloured."""
    rng = np.random.default_rng(seed)
    level = _smooth_field(size, rng)
    # Ranks make the distribution exactly uniform, whatever the field's own is; few bins keep it smooth.
    edges = np.quantile(level[:: max(1, size[1] // 512), :: max(1, size[0] // 512)], np.linspace(0, 1, 513))
    low, high = LOG10_RANGE_CD_M2
    log10_level = np.interp(level, edges, np.linspace(low, high, 513)).astype(np.float32)
    log10_level += _texture(size, rng)
    rgb = np.stack([np.exp(_CHROMA * _smooth_field(size, rng)) for _ in range(3)], axis=-1)
    rgb /= luminance_cd_m2(rgb)[..., None]
    rgb *= np.power(np.float32(10.0), log10_level)[..., None]
    return np.asarray(rgb, dtype=np.float32)


def synthetic_bracket(
    size: tuple[int, int],
    seed: int,
    *,
    sensor: Sensor = REFERENCE_SENSOR,
    nominal_s: tuple[float, ...] = PAPER_TIMES_S,
    jpeg_quality: int | None = None,
) -> SyntheticBracket:
    """Return a bracket of `reference_radiance` at f/5.6, ISO 100; ``jpeg_quality``: coded 4:2:0 and decoded again."""
    radiance = reference_radiance(size, seed)
    frames = tuple(
        expose(radiance, shutter_s, sensor, seed * 1000 + i, jpeg_quality) for i, shutter_s in enumerate(nominal_s)
    )
    true_s = tuple(sensor.true_shutter.seconds(t) for t in nominal_s)
    return SyntheticBracket(frames, nominal_s, true_s, radiance, sensor)


def expose(radiance: Floats, shutter_s: float, sensor: Sensor, seed: int, jpeg_quality: int | None = None) -> Bytes:
    """Return one frame (H, W, 3) of a radiance picture in cd/m2, in bands so that noise needs little memory."""
    exposure = Exposure(shutter_s, 100, 5.6)
    out = np.empty(radiance.shape, dtype=np.uint8)
    for first in range(0, radiance.shape[0], 256):
        band = radiance[first : first + 256]
        rng = np.random.default_rng((seed, first))
        out[first : first + 256] = sensor.develop(sensor.mosaic_signal(band, exposure, rng), exposure)
    return out if jpeg_quality is None else jpeg_coded(out, jpeg_quality)


def jpeg_coded(frame: Bytes, quality: int) -> Bytes:
    """Return the frame (H, W, 3), 8-bit sRGB codes, after JPEG coding (4:2:0) and decoding."""
    done, data = cv2.imencode(".jpg", frame[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    coded = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
    return np.ascontiguousarray(coded[..., ::-1])


def _smooth_field(size: tuple[int, int], rng: np.random.Generator) -> Floats:
    """Return noise of a few octaves, about -1..1; its cells are parts of the height, whatever the size."""
    width, height = size
    total = np.zeros((height, width), dtype=np.float32)
    for cells, weight in _OCTAVES:
        grid = rng.standard_normal((cells + 3, 2 * cells + 3)).astype(np.float32)
        total += np.float32(weight) * cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC)
    return total


def _texture(size: tuple[int, int], rng: np.random.Generator) -> Floats:
    """Return fine texture in decades."""
    width, height = size
    cell_px, stops = _TEXTURE
    grid = rng.standard_normal((height // cell_px + 2, width // cell_px + 2)).astype(np.float32)
    return cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) * np.float32(stops * np.log10(2))
