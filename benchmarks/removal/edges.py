"""How sharp filled edges of the room are, and how near a filling that joins its surroundings can come."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Flags, Floats, Int16s
from processing.pictures.images import luminance_cd_m2
from processing.removal.illumination import spread

REACH_PX = 3
LEAST_STEP = 0.2
"""Natural logarithm of luminance: edges of the room fainter than this are not judged."""
RIM_PX = 3
SMOOTH_PX = 4.0


def edge_sharpness(found: Floats, truth: Floats, planes: Int16s, target: Flags) -> tuple[float, float] | None:
    """Return the median of the steepest step of one pixel across the room's edges in the target, over the true step.

    Of what was found and of the truth itself (a perfectly sharp edge has 0.5 to 1); None where no edge can be judged.
    """
    pairs = [_steps(found, truth, planes, target), _steps(*(_turned(one) for one in (found, truth, planes, target)))]
    ours, true = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
    return (float(np.median(ours)), float(np.median(true))) if len(ours) else None


def _turned(picture: npt.NDArray) -> npt.NDArray:  # type: ignore[type-arg]
    return np.swapaxes(picture, 0, 1)


def _steps(found: Floats, truth: Floats, planes: Int16s, target: Flags) -> tuple[Floats, Floats]:
    """Return, for each edge met going down, the steepest step found and the true one, over the whole true step."""
    ours, true = (np.log(np.maximum(luminance_cd_m2(np.ascontiguousarray(p)), 1e-6)) for p in (found, truth))
    rows = len(planes) - 2 * REACH_PX
    at = [slice(k, k + rows) for k in range(2 * REACH_PX + 1)]
    above, below = planes[at[REACH_PX - 1]], planes[at[REACH_PX + 1]]
    edge = (above != below) & np.all([target[s] for s in at], axis=0)
    for k in range(REACH_PX):
        edge &= (planes[at[k]] == above) & (planes[at[-1 - k]] == below)
    whole = true[at[-1]] - true[at[0]]
    edge &= np.abs(whole) > LEAST_STEP
    sign, size = np.sign(whole[edge]), np.abs(whole[edge])
    middle = range(REACH_PX - 2, REACH_PX + 2)
    steepest = [np.max([sign * (p[at[k + 1]] - p[at[k]])[edge] for k in middle], axis=0) / size for p in (ours, true)]
    return np.asarray(steepest[0], np.float32), np.asarray(steepest[1], np.float32)


def joined_truth(furnished: Floats, empty: Floats, planes: Int16s, target: Flags) -> Floats:
    """Return the emptied room as a perfect filling that meets what is seen would draw it.

    It is the truth, plane by plane as dark as its surroundings: times the membrane of what the pixels beside the target
    lost. What it is off the truth no filling gets below without a seam, as nothing outside the target may change.
    """
    lost = np.log(np.maximum(luminance_cd_m2(furnished), 1e-6) / np.maximum(luminance_cd_m2(empty), 1e-6))
    out = furnished.copy()
    for plane in np.unique(planes[target]):
        here = planes == plane
        rim = here & ~target & _near(target)
        given = rim if rim.any() else here & ~target
        if not given.any():
            out[here & target] = empty[here & target]
            continue
        change = np.exp(spread(lost.astype(np.float32), given))
        out[here & target] = (empty * change[..., None])[here & target]
    return out


def smooth_error(found: Floats, truth: Floats, target: Flags, sigma_px: float = SMOOTH_PX) -> float:
    """Return the median luminance error (%) in the target of both pictures' means over some pixels of it."""
    import cv2

    share = cv2.GaussianBlur(target.astype(np.float32), (0, 0), sigma_px)
    ours, true = (
        cv2.GaussianBlur(np.where(target, luminance_cd_m2(np.ascontiguousarray(p)), 0), (0, 0), sigma_px)
        for p in (found, truth)
    )
    off = np.abs(ours - true)[target] / np.maximum(true[target], 1e-6 * np.maximum(share[target], 1e-6))
    return 100 * float(np.median(off))


def _near(target: Flags) -> Flags:
    import cv2

    kernel = np.ones((2 * RIM_PX + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(target.astype(np.uint8), kernel) > 0)
