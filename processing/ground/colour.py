"""Colour, written once: luminance weights, the sRGB curve, CIE XYZ and L*a*b* of linear Rec. 709, colour temperature.

Light is linear RGB with Rec. 709 primaries and a D65 white. What runs for every pixel of a picture is a few lines of
numpy, and so are the two formulas for which importing colour-science would take over a second.
"""

from functools import cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Bytes, Doubles, Flags, Floats
from processing.ground.tables import table_of

LUMINANCE_WEIGHTS = (0.2127, 0.7151, 0.0722)
"""Of R, G and B in luminance (Ji et al. 2023, eq. 1; ITU-R BT.709 rounds them to 0.2126, 0.7152, 0.0722)."""
XYZ_OF_RGB = (
    (0.4123907993, 0.3575843394, 0.1804807884),
    (0.2126390059, 0.7151686788, 0.0721923154),
    (0.0193308187, 0.1191947798, 0.9505321522),
)
"""CIE 1931 XYZ of linear RGB: from the primaries of ITU-R BT.709 and D65 at x, y = 0.3127, 0.3290."""
RGB_OF_XYZ = tuple(tuple(float(v) for v in row) for row in np.linalg.inv(np.array(XYZ_OF_RGB)))

_ENCODE_KNEE, _DECODE_KNEE = 0.0031308, 0.04045
"""IEC 61966-2-1: the curve is straight, of slope 12.92, below these values of light and of signal."""
_ENCODED_LEVELS = 65536  # of light, in the table of `srgb_of_linear`: at most 0.05 code apart. Chosen
CCT_RANGE_K = (1700.0, 40_000.0)
"""Robertson's isotherms begin at 1667 K, below a candle's 1900 K; the upper end is chosen: a clear northern sky."""
_AT_ONCE = 1 << 14  # chromaticities, for the processor's cache
MAX_DUV = 0.05
"""Farther than this from the Planckian locus, in u, v of 1960, a colour temperature means nothing (CIE 15:2018)."""

Reals = TypeVar("Reals", Floats, Doubles)


def luminance_cd_m2(rgb: npt.ArrayLike) -> Floats:
    """Return 0.2127 R + 0.7151 G + 0.0722 B (Ji et al. 2023, eq. 1) of linear RGB (..., 3), in the unit of ``rgb``.

    Float32 of shape (...).
    """
    return np.asarray(np.asarray(rgb) @ np.array(LUMINANCE_WEIGHTS, dtype=np.float32), dtype=np.float32)


def largest_channel(rgb: Floats) -> Floats:
    """Return the largest value (H, W) of each pixel (H, W, 3); NumPy's ``max(axis=-1)`` is several times slower."""
    return np.maximum(np.maximum(rgb[..., 0], rgb[..., 1]), rgb[..., 2])


def srgb_encoded(light: Reals) -> Reals:
    """Return the sRGB signal (IEC 61966-2-1) of linear light of any shape, 0..1 both, float32 or float64 as given."""
    curved = 1.055 * np.maximum(light, _ENCODE_KNEE) ** (1 / 2.4) - 0.055
    return np.where(light <= _ENCODE_KNEE, 12.92 * light, curved)


def srgb_decoded(signal: Reals) -> Reals:
    """Return the linear light of an sRGB signal (IEC 61966-2-1), any shape, 0..1 both, float32 or float64 as given."""
    return np.where(signal <= _DECODE_KNEE, signal / 12.92, ((signal + 0.055) / 1.055) ** 2.4)


def srgb_of_linear(light: npt.ArrayLike) -> Bytes:
    """Return sRGB codes of linear light of any shape, clipped to 0..1, by a table of 65,536 levels.

    One code in a thousand is off by one from exact rounding; it takes a seventh of the curve's time.
    """
    clipped = np.clip(np.asarray(light, dtype=np.float32), 0.0, 1.0)
    # Rounding by adding a half: numpy's rint before the cast would take as long as all the rest.
    return _srgb_codes()[(clipped * np.float32(_ENCODED_LEVELS - 1) + np.float32(0.5)).astype(np.uint16)]


def linear_of_srgb(codes: npt.NDArray[np.unsignedinteger]) -> Floats:
    """Return linear light, 0..1, of sRGB codes of any shape, uint8 or uint16, whose largest code is 1."""
    light: Floats = _linear_of_code(int(np.iinfo(codes.dtype).max))[codes]
    return light


@cache
def _srgb_codes() -> Bytes:
    return np.rint(255 * srgb_encoded(np.arange(_ENCODED_LEVELS) / (_ENCODED_LEVELS - 1))).astype(np.uint8)


@cache
def _linear_of_code(top: int) -> Floats:
    return srgb_decoded(np.arange(top + 1, dtype=np.float64) / top).astype(np.float32)


def lab_of_linear(rgb: Doubles, white_rgb: Doubles) -> Doubles:
    """Return CIE 1976 L*a*b* (N, 3) of linear RGB (N, 3) relative to a white (3,) in the same unit (CIE 15:2018)."""
    xyz, white = np.maximum(rgb, 0) @ np.array(XYZ_OF_RGB).T, np.array(XYZ_OF_RGB) @ np.maximum(white_rgb, 1e-30)
    share, knee = xyz / white, 6 / 29
    x, y, z = np.where(share > knee**3, np.cbrt(share), share / (3 * knee**2) + 4 / 29).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def colour_temperature_k(rgb: npt.ArrayLike) -> tuple[Floats, Flags]:
    """Return the correlated colour temperature of linear RGB (..., 3), and where it means something, shape (...).

    Robertson's isotherms (1968), right to 0.1 % between 2000 K and 20,000 K. 0 K where there is no light, farther than
    `MAX_DUV` from the Planckian locus, and outside `CCT_RANGE_K`.
    """
    xyz = np.asarray(rgb, dtype=np.float64) @ np.array(XYZ_OF_RGB).T
    lit = np.asarray(xyz.sum(axis=-1) > 0)
    kelvin = np.zeros(lit.shape, np.float32)
    seen = xyz[lit]
    uv = seen[:, :2] * (4, 6) / (seen @ (1, 15, 3))[:, None]
    found, duv = np.concatenate([_robertson(part) for part in np.array_split(uv, len(uv) // _AT_ONCE + 1)], axis=1)
    low, high = CCT_RANGE_K
    kelvin[lit] = np.where((np.abs(duv) <= MAX_DUV) & (found > low) & (found < high), found, 0)
    return kelvin, kelvin > 0


def _robertson(uv: Doubles) -> Doubles:
    """Return colour temperature, K, and distance from the Planckian locus, (2, N), of u, v of 1960 (N, 2)."""
    mired, *middle, slope = map(np.array, table_of(__package__, "robertson").values())
    place, along = np.stack(middle, axis=1), np.stack([np.ones_like(slope), slope], axis=1)
    along /= np.hypot(1, slope)[:, None]
    # The first isotherm that lies above, and its share against the one before
    above = (uv[:, 1:] - place[1:, 1]) * along[1:, 0] - (uv[:, :1] - place[1:, 0]) * along[1:, 1]
    i = np.where((above <= 0).any(axis=1), (above <= 0).argmax(axis=1) + 1, len(mired) - 1)
    now, before = (above[np.arange(len(i)), at] for at in (i - 1, i - 2))
    share = np.where(i == 1, 0.0, -np.minimum(now, 0) / (before - np.minimum(now, 0)))
    here, way = (one[i] * (1 - share[:, None]) + one[i - 1] * share[:, None] for one in (place, along))
    off = ((uv - here) * way).sum(axis=1) / np.hypot(*way.T)
    return np.stack([1e6 / (mired[i - 1] * share + mired[i] * (1 - share)), off])
