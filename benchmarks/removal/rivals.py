"""Other ways of filling holes in 8-bit pictures: OpenCV with its contributed modules, scikit-image, PatchMatch."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Flags

Rival = Callable[[Bytes, Flags], Bytes]

SLOW = ("skimage_biharmonic", "xphoto_fsr")
"""Tens of seconds to minutes a picture of 1024 x 512."""


def rivals(*, slow: bool) -> dict[str, Rival]:
    """Return what can be run here; ``slow`` adds those that take tens of seconds a picture."""
    found: dict[str, Rival] = {"opencv_telea": _telea, "opencv_ns": _navier_stokes}
    if slow:
        found |= {"skimage_biharmonic": _biharmonic, "xphoto_shiftmap": _shift_map, "xphoto_fsr": _fsr}
    try:
        import patchmatch  # noqa: F401

        found["pypatchmatch"] = _patchmatch
    except Exception as exc:  # noqa: BLE001 (a library that will not load is no rival)
        print(f"pypatchmatch: {exc}")
    return found


def timed(rival: Rival, picture: Bytes, hole: Flags) -> tuple[Bytes, float]:
    """Return the filled picture (H, W, 3) and the CPU seconds that it took."""
    start_s = time.process_time()
    found = rival(picture, hole)
    return found, time.process_time() - start_s


def _telea(picture: Bytes, hole: Flags) -> Bytes:
    return np.asarray(cv2.inpaint(picture, hole.astype(np.uint8), 5, cv2.INPAINT_TELEA), np.uint8)


def _navier_stokes(picture: Bytes, hole: Flags) -> Bytes:
    return np.asarray(cv2.inpaint(picture, hole.astype(np.uint8), 5, cv2.INPAINT_NS), np.uint8)


def _biharmonic(picture: Bytes, hole: Flags) -> Bytes:
    from skimage.restoration import inpaint_biharmonic

    found = inpaint_biharmonic(picture, hole, channel_axis=-1)
    return np.rint(255 * np.clip(found, 0, 1)).astype(np.uint8)


def _patchmatch(picture: Bytes, hole: Flags) -> Bytes:
    from patchmatch import patch_match

    found: Any = patch_match.inpaint(np.ascontiguousarray(picture), hole.astype(np.uint8) * 255, patch_size=7)
    return np.asarray(found, np.uint8)


def _shift_map(picture: Bytes, hole: Flags) -> Bytes:
    """He and Sun 2012, by opencv-contrib, which asks for L*a*b*."""
    filled = np.zeros_like(picture)
    cv2.xphoto.inpaint(cv2.cvtColor(picture, cv2.COLOR_BGR2Lab), _known(hole), filled, cv2.xphoto.INPAINT_SHIFTMAP)
    return np.asarray(cv2.cvtColor(filled, cv2.COLOR_Lab2BGR), np.uint8)


def _fsr(picture: Bytes, hole: Flags) -> Bytes:
    """Frequency selective reconstruction (Genser et al. 2018), by opencv-contrib."""
    filled = np.zeros_like(picture)
    cv2.xphoto.inpaint(picture, _known(hole), filled, cv2.xphoto.INPAINT_FSR_FAST)
    return filled


def _known(hole: Flags) -> Bytes:
    return np.where(hole, 0, 255).astype(np.uint8)
