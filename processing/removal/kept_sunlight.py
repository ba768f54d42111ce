"""Direct sunlight that stays in the picture and runs into a hole goes on in it: what stood in the sun leaves sun.

Filling is done from the shade. Then each texel of the hole is lit as far as the membrane through what is seen around
(1 in the sun, 0 in the shade) lies above one half, and brighter by as much as the sunlit rim is brighter than the
filling beside it.
"""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

import cv2
import numpy as np

from processing.images import luminance_cd_m2
from processing.removal.blurs import blurred
from processing.removal.membrane import spread
from processing.removal.tone import ToneScale, grey

RIM_PX = 6
SOFT = 0.12
"""Of the membrane about one half, in which the edge of the light lies."""
LEAST_GAIN = 0.25
"""Natural logarithm: less is no sunlight."""
BRIGHT = 1.8
"""Times the shade's median luminance: sunlight, where it touches what is known as such."""
LEAST_RIM = 8
"""Sunlit texels at the hole's rim."""


def sunlit(values: Floats, known: Flags, hole: Flags, sun: Flags) -> tuple[Floats, Floats]:
    """Return the texture (h, w, 3) with sunlight in its filled ``hole``, and how far each texel is lit (h, w), 0..1.

    ``sun`` (h, w): known texels in direct sunlight; ``known`` all known ones. Outside the hole nothing changes.
    """
    nothing = np.zeros(hole.shape, np.float32)
    near = cv2.dilate(hole.astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)).astype(bool)
    sun = _whole(values, known, sun & known) if sun.any() else sun
    rim = near & sun
    if rim.sum() < LEAST_RIM:
        return values, nothing
    scale = ToneScale.of(values, known)
    tone = scale.tone(values)
    beside = hole & cv2.dilate((~hole).astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)).astype(bool)
    gain = _local(tone, rim) - _local(tone, beside)
    # The rim of a patch is half in the shade; what is hardly brighter is no sun.
    bright = rim & (grey(np.asarray(gain, np.float32)) > LEAST_GAIN)
    if bright.sum() < LEAST_RIM:
        return values, nothing
    more = spread(np.asarray(gain, np.float32), bright)
    share = spread(sun.astype(np.float32), known & near)
    lit = np.where(hole, np.clip((share - 0.5) / SOFT + 0.5, 0, 1), 0).astype(np.float32)
    out = values.copy()
    out[hole] = scale.light(tone + more * lit[..., None])[hole]
    return out, lit


def _whole(values: Floats, known: Flags, sun: Flags) -> Flags:
    """Return the sunlit texels with the bright ones that hang together with them: masks of sunlight end early."""
    shade = known & ~sun
    if not shade.any():
        return sun
    luminance = luminance_cd_m2(values)
    bright = known & (luminance > BRIGHT * float(np.median(luminance[shade])))
    _, labels = cv2.connectedComponents((bright | sun).astype(np.uint8))
    lit = np.unique(labels[sun])
    return np.asarray(np.isin(labels, lit[lit > 0]))


def _local(tone: Floats, where: Flags) -> Floats:
    weight = where.astype(np.float32)
    share = blurred(weight, RIM_PX)
    return np.asarray(blurred(tone * weight[..., None], RIM_PX) / np.maximum(share, 1e-4)[..., None], np.float32)
