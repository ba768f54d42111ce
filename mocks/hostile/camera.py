"""A camera as cameras are: a mosaic of coloured wells with faults, and a maker's processing to JPEG.

Nothing here is what `processing` assumes. Tone curves come as tables (measured ones), noise passes through demosaicing,
a median filter and sharpening, colours through a camera matrix, codes through one of several JPEG encoders.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Bytes, Floats

_LIMIT = 16383  # 14 bits, as raw converters hand them to demosaicing
_BAYER = {0: (0, 0), 1: (0, 1), 2: (1, 1)}
"""Channel: row and column of its place in a cell of two by two; green has the other diagonal too."""
MATRIX_5D2 = ((0.61, 0.29, 0.10), (0.17, 0.86, -0.03), (0.02, 0.24, 0.74))
"""Camera RGB of linear sRGB under daylight, rows to 1: about what raw converters state for a Canon EOS 5D Mark II."""


@dataclass(frozen=True)
class HostileCamera:
    """One camera; all of it may be drawn at random."""

    irradiance: npt.NDArray[np.float64]
    """(N,) 0..1, rising: where the tone curves are tabulated."""
    brightness: npt.NDArray[np.float64]
    """(3, N) 0..1, not falling."""
    full_well_e: float = 30_000.0
    read_e: float = 6.0
    prnu: float = 0.0
    """Relative standard deviation of the wells' gains."""
    hot_share: float = 0.0
    """Of the wells, that leak."""
    matrix: tuple[tuple[float, float, float], ...] | None = None
    """Camera RGB of scene RGB; None: the camera sees the scene's own primaries."""
    mosaic: bool = False
    denoise: bool = False
    sharpen: float = 0.0
    tone_mapping_stops: float = 0.0
    """By how much a frame's shadows are lifted where most of it is dark, and lowered where most is bright."""
    jpeg: tuple[str, int, str] | None = None
    """Encoder ("opencv", "pillow" or "progressive"), quality, chroma ("4:4:4", "4:2:2", "4:2:0"); None: lossless."""
    seed: int = 0

    def frame(self, light: Floats, moment: int) -> Bytes:
        """Return the picture (H, W, 3) of ``light`` (H, W, 3), 1 at saturation; ``moment``: number of the frame."""
        fixed, rng = np.random.default_rng((self.seed, 1)), np.random.default_rng((self.seed, 2, moment))
        height, width = light.shape[:2]
        seen = light if self.matrix is None else np.maximum(light @ np.array(self.matrix, np.float32).T, 0)
        gain = 1 + self.prnu * fixed.standard_normal(seen.shape, dtype=np.float32)
        leak = np.where(fixed.random((height, width, 1)) < self.hot_share, fixed.random((height, width, 1)), 0)
        signal = np.minimum(seen, 8) * gain + (0.3 * leak).astype(np.float32)
        spread = np.sqrt(np.maximum(signal, 0) / self.full_well_e + (self.read_e / self.full_well_e) ** 2)
        signal = signal + spread * rng.standard_normal(signal.shape, dtype=np.float32)
        signal = np.clip(signal, 0, 1).astype(np.float32)
        if self.mosaic:
            signal = _demosaiced(signal)
        if self.matrix is not None:
            signal = np.clip(signal @ np.linalg.inv(np.array(self.matrix)).T.astype(np.float32), 0, 1)
        return self._developed(signal)

    def _developed(self, signal: Floats) -> Bytes:
        """Return 8-bit codes: filter, tone, sharpening, coding."""
        if self.denoise:
            signal = np.asarray(cv2.bilateralFilter(np.sqrt(signal), 5, 0.03, 1.2) ** 2, dtype=np.float32)
        if self.tone_mapping_stops:
            lift = self.tone_mapping_stops * (0.5 - float(np.mean(np.sqrt(signal))))
            signal = np.asarray(signal * np.exp2(lift * (1 - signal) ** 2), dtype=np.float32)
        shown = np.stack([np.interp(signal[..., c], self.irradiance, self.brightness[c]) for c in range(3)], axis=-1)
        if self.sharpen:
            shown = shown + self.sharpen * (shown - cv2.GaussianBlur(shown, (0, 0), 1.0))
        return coded(np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8), self.jpeg)


def _demosaiced(signal: Floats) -> Floats:
    """Return full colour of the one channel that each place of a Bayer mosaic (RGGB) keeps."""
    raw = signal[..., 1].copy()
    for channel in (0, 2):
        row, column = _BAYER[channel]
        raw[row::2, column::2] = signal[row::2, column::2, channel]
    code = np.rint(raw * _LIMIT).astype(np.uint16)
    # OpenCV names a mosaic by its second row's second and third place: RGGB is its BayerBG.
    return np.asarray(cv2.cvtColor(code, cv2.COLOR_BayerBG2RGB).astype(np.float32) / _LIMIT)


def coded(frame: Bytes, jpeg: tuple[str, int, str] | None) -> Bytes:
    """Return a frame (H, W, 3) of sRGB codes after JPEG coding and decoding."""
    if jpeg is None:
        return frame
    encoder, quality, chroma = jpeg
    if encoder == "opencv":
        sampling = {"4:4:4": 0x111111, "4:2:2": 0x211111, "4:2:0": 0x221111}[chroma]
        options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
        done, data = cv2.imencode(".jpg", frame[..., ::-1], options)
        assert done
    else:
        from PIL import Image

        buffer = io.BytesIO()
        plain = encoder == "pillow"
        Image.fromarray(frame).save(
            buffer, "JPEG", quality=quality, subsampling=chroma, progressive=not plain, optimize=not plain
        )
        data = np.frombuffer(buffer.getvalue(), np.uint8)
    shown = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
    return np.ascontiguousarray(shown[..., ::-1])
