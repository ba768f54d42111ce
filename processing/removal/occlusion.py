"""What furniture takes from the light of the wall beside it: it does not go on where the furniture is removed.

Beside what stands before a wall, the wall gets less light than further away. Continued through the hole, that draws
the shadow of what is no longer there. So a wall's light is told from further away, and in the hole it rises from what
it is at the rim, which stays as it is, to what it is around. What furniture takes from the whole room nobody can put
back without changing what is seen.
"""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

import cv2
import numpy as np

from processing.removal.blurs import blurred
from processing.removal.tone import grey

NEAR_M = 0.5
"""From the hole, as far as what is removed is taken to darken the wall."""
AROUND_M = (1.0, 4.0)
"""Neighbourhoods that tell the light further away; the wide one where the near one sees nothing."""
WIDE_SHARE = 0.02
"""Of the wide neighbourhood's weight against the near one's."""
RISE_M = 0.2
"""From the rim into the hole, on which the light rises."""
MOST_RISE = 0.4
"""Tone by which it rises at most."""
LEAST_FAR = 0.3
"""Of the known texels that must be far from the hole."""


def away_from(known: Flags, hole: Flags, px_per_m: float) -> Flags:
    """Return the ``known`` texels (h, w) further than `NEAR_M` from the hole; all of them where those are too few."""
    far = known & (_away_px(hole) > NEAR_M * px_per_m)
    return far if far.sum() > LEAST_FAR * known.sum() else known


def rising_light(light: Floats, clean: Flags, seen: Flags, hole: Flags, px_per_m: float) -> Floats:
    """Return (h, w), >= 0: the tone by which light in the hole is above its membrane; 0 elsewhere, and at the rim.

    ``light`` (h, w, 3): tones where ``clean`` (h, w), and in the hole their membrane. It rises away from all that is
    ``seen``. It never falls: a wall's place behind furniture is not darker than its surroundings for that.
    """
    if not hole.any() or not clean.any():
        return np.zeros(hole.shape, np.float32)
    away = _away_px(hole) / np.float32(NEAR_M * px_per_m)
    weight = np.where(clean, 1 - np.exp(-(away**2)), 0).astype(np.float32)
    total, share = np.zeros(hole.shape, np.float32), np.full(hole.shape, 1e-9, np.float32)
    level = grey(light)
    for around_m, part in zip(AROUND_M, (1.0, WIDE_SHARE), strict=True):
        total += np.float32(part) * blurred(level * weight, around_m * px_per_m)
        share += np.float32(part) * blurred(weight, around_m * px_per_m)
    rise = np.clip(total / share - level, 0, MOST_RISE)
    inward = cv2.distanceTransform((hole | ~seen).astype(np.uint8), cv2.DIST_L2, 5)
    rise *= 1 - np.exp(-((inward / np.float32(RISE_M * px_per_m)) ** 2))
    # Where nothing is far enough to tell, nothing rises.
    return np.where(hole & (share > 1e-5), rise, 0).astype(np.float32)


def _away_px(hole: Flags) -> Floats:
    """Return each texel's distance to the hole; beyond the texture where there is none."""
    if not hole.any():
        return np.full(hole.shape, 2.0 * max(hole.shape), np.float32)
    return np.asarray(cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, 5), np.float32)
