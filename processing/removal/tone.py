"""Tones: the logarithm of light, in which illumination and reflectance add up and every error is a relative one."""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.images import luminance_cd_m2


TOE = 0.03
"""Of the median luminance: what is added before the logarithm, so that noise near black stays small."""
TONE_WEIGHTS = np.array([0.2127, 0.7151, 0.0722], np.float32)


@dataclass(frozen=True)
class ToneScale:
    """The light added before the logarithm, in the picture's unit."""

    toe: float

    @classmethod
    def of(cls, rgb: Floats, known: Flags) -> ToneScale:
        """Return the scale that suits the known pixels of (h, w, 3); 1e-6 where nothing is known or all is black."""
        seen = luminance_cd_m2(rgb[known]) if known.any() else np.zeros(1, np.float32)
        return cls(max(TOE * float(np.median(seen)), 1e-6))

    def tone(self, rgb: Floats) -> Floats:
        """Return log(rgb + toe)."""
        return np.asarray(np.log(np.maximum(rgb, 0) + np.float32(self.toe)), np.float32)

    def light(self, tone: Floats) -> Floats:
        """Return the light of tones; never negative."""
        return np.asarray(np.maximum(np.exp(np.minimum(tone, 80.0)) - np.float32(self.toe), 0), np.float32)


def grey(tone: Floats) -> Floats:
    """Return (h, w): the tone's weighted mean over the channels."""
    return np.asarray(tone @ TONE_WEIGHTS, np.float32)
