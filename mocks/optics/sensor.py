"""The sensor and the camera's own processing: light to electrons, noise, white balance, tone curve, 8 bits."""

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mocks.worlds.light import Vector
from processing.ground.arrays import Bytes, Doubles, Floats
from processing.ground.colour import RGB_OF_XYZ

_LUT_SIZE = 65536  # 16 bits: finer than any step of 8-bit output


@dataclass(frozen=True)
class ToneCurve:
    """A camera-like response: a power with a linear toe (as sRGB's), then an S-curve.

    ``contrast`` (0..0.9) mixes in 3 y2 - 2 y3; the curve is smooth and strictly monotone from 0 to 1.
    """

    gamma: float = 2.4
    toe: float = 0.055
    contrast: float = 0.35

    def encode(self, linear: npt.ArrayLike) -> Doubles:
        """Return the picture value (0..1) of linear exposure (clipped to 0..1), of the same shape."""
        x = np.clip(np.asarray(linear, dtype=np.float64), 0, 1)
        y0 = self.toe / (self.gamma - 1)
        x0 = ((y0 + self.toe) / (1 + self.toe)) ** self.gamma
        power = (1 + self.toe) * np.maximum(x, x0) ** (1 / self.gamma) - self.toe
        y = np.where(x < x0, x * (y0 / x0), power)
        return np.asarray(y + self.contrast * (y * y * (3 - 2 * y) - y), dtype=np.float64)

    def decode(self, value: npt.ArrayLike) -> Doubles:
        """Return the linear exposure (0..1) of a picture value (0..1), of the same shape: inverse of `encode`."""
        grid = np.linspace(0, 1, 20001) ** 3
        return np.interp(np.asarray(value, dtype=np.float64), self.encode(grid), grid)

    def table(self) -> Bytes:
        """Return the 8-bit value, shape (65536,), of equally spaced exposures."""
        return _table(self)


@lru_cache(maxsize=32)
def _table(curve: ToneCurve) -> Bytes:
    return np.rint(255 * curve.encode((np.arange(_LUT_SIZE) + 0.5) / _LUT_SIZE)).astype(np.uint8)


def _times(picture: Floats, factors: npt.ArrayLike) -> Floats:
    """Return picture (..., 3) times a factor for each channel; NumPy is slow over a last axis of three."""
    row = picture.reshape(-1, picture.shape[-2] * 3)
    tiled = np.tile(np.asarray(factors, dtype=np.float32), picture.shape[-2])
    return np.asarray((row * tiled).reshape(picture.shape))


class TrueShutter(StrEnum):
    """How long the shutter really opens for a nominal time."""

    NOMINAL = "nominal"
    THIRDS_OF_STOPS = "thirds of stops"
    """The power 2^(k/3) s behind the nominal time: 1/60 is 1/64, 13 s is 12.7 s."""

    def seconds(self, nominal_s: float) -> float:
        """Return the true exposure time of a nominal one."""
        return nominal_s if self is TrueShutter.NOMINAL else float(2.0 ** (round(3 * math.log2(nominal_s)) / 3))


@dataclass(frozen=True)
class Exposure:
    """What one exposure is made with; ``shutter_s`` is nominal."""

    shutter_s: float
    iso: int
    f_number: float
    color_temperature_k: int = 6500


@dataclass(frozen=True)
class Sensor:
    """Sensor and development.

    The exposure (1 saturates the green channel) is L t S / (c N2), with L in cd/m2, true time t, speed S and
    f-number N; c is ``saturation_constant``: 78 / 0.65 = 120 by ISO 12232 (saturation-based speed, lens constant
    q = 0.65). ``native_balance`` is how much signal red, green and blue give for white of 6500 K: the white
    balance lifts it to (1, 1, 1), noise included. ``full_well_e`` are electrons at saturation and ISO 100.
    """

    saturation_constant: float = 120.0
    full_well_e: float = 24000.0
    read_noise_e: float = 5.0
    native_balance: Vector = (0.52, 1.0, 0.68)
    tone: tuple[ToneCurve, ToneCurve, ToneCurve] = (ToneCurve(), ToneCurve(), ToneCurve())
    true_shutter: TrueShutter = TrueShutter.THIRDS_OF_STOPS
    raw_bits: int = 14
    raw_black: int = 512

    def exposure_gain(self, exposure: Exposure) -> float:
        """Return linear exposure (0..1) per cd/m2."""
        light_s = self.true_shutter.seconds(exposure.shutter_s) * exposure.iso
        return light_s / (self.saturation_constant * exposure.f_number**2)

    def mosaic_signal(self, radiance: Floats, exposure: Exposure, rng: np.random.Generator) -> Floats:
        """Return the noisy signal of the shape of ``radiance`` (H, W, 3), 1 at saturation, clipped, not balanced."""
        signal = _times(radiance, np.array(self.native_balance) * self.exposure_gain(exposure))
        np.minimum(signal, 4, out=signal)
        electrons = np.float32(self.full_well_e * 100 / exposure.iso)
        noise = rng.standard_normal(signal.shape, dtype=np.float32)
        noise *= np.sqrt(signal / electrons + np.float32((self.read_noise_e / electrons) ** 2))
        signal += noise
        return np.minimum(signal, 1, out=signal)

    def develop(self, signal: Floats, exposure: Exposure) -> Bytes:
        """Return 8-bit RGB of the shape of ``signal`` (H, W, 3), 0..1: white balance, clip, tone curve."""
        gains = white_balance_gains(exposure.color_temperature_k) / np.array(self.native_balance)
        # All gains are 1 or more at 6500 K, so a saturated sensor ends white, never pink.
        scaled = _times(signal, gains * _LUT_SIZE)
        index = np.clip(scaled, 0, _LUT_SIZE - 1, out=scaled).astype(np.uint16)
        out = np.empty(signal.shape, dtype=np.uint8)
        for channel, curve in enumerate(self.tone):
            out[..., channel] = curve.table()[index[..., channel]]
        return out


def white_balance_gains(color_temperature_k: int) -> Doubles:
    """Return gains of shape (3,), green 1, that make daylight of a colour temperature neutral; (1, 1, 1) at 6500 K.

    CIE daylight locus (4000 to 25000 K; nearer temperatures are clamped), Rec. 709 primaries.
    """
    wanted = 1 / _daylight_rgb(color_temperature_k) * _daylight_rgb(6500)
    return np.asarray(wanted / wanted[1])


def _daylight_rgb(color_temperature_k: float) -> Doubles:
    t = min(max(color_temperature_k, 4000), 25000)
    if t <= 7000:
        x = -4.6070e9 / t**3 + 2.9678e6 / t**2 + 0.09911e3 / t + 0.244063
    else:
        x = -2.0064e9 / t**3 + 1.9018e6 / t**2 + 0.24748e3 / t + 0.237040
    y = -3.0 * x * x + 2.870 * x - 0.275
    rgb: Doubles = np.array(RGB_OF_XYZ) @ np.array([x / y, 1.0, (1 - x - y) / y])
    return rgb
