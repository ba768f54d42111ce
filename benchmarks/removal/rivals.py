"""Other ways of filling holes in 8-bit pictures: OpenCV, scikit-image, PatchMatch, opencv-contrib beside."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from processing.ground.arrays import Bytes, Flags

Rival = Callable[[Bytes, Flags], Bytes]

PYTHON = "DAYLIT_RIVALS_PYTHON"
"""Environment variable that names an interpreter with opencv-contrib."""
CONTRIB_LIMIT_S = 240
SLOW = ("skimage_biharmonic", "xphoto_fsr")
"""Tens of seconds to minutes a picture of 1024 x 512."""
_CHILD = """
import sys, cv2, numpy as np
cv2.setNumThreads(1)
given = np.load(sys.argv[1])
picture, hole = given["picture"], given["hole"]
known = np.where(hole, 0, 255).astype(np.uint8)
if sys.argv[3] == "shiftmap":
    out = np.zeros_like(picture)
    lab = cv2.cvtColor(picture, cv2.COLOR_BGR2Lab)
    cv2.xphoto.inpaint(lab, known, out, cv2.xphoto.INPAINT_SHIFTMAP)
    out = cv2.cvtColor(out, cv2.COLOR_Lab2BGR)
else:
    out = np.zeros_like(picture)
    cv2.xphoto.inpaint(picture, known, out, cv2.xphoto.INPAINT_FSR_FAST)
np.save(sys.argv[2], out)
"""


def rivals(*, slow: bool) -> dict[str, Rival]:
    """Return what can be run here; ``slow`` adds those that take tens of seconds a picture."""
    found: dict[str, Rival] = {"opencv_telea": _telea, "opencv_ns": _navier_stokes}
    if slow:
        found["skimage_biharmonic"] = _biharmonic
    try:
        import patchmatch  # noqa: F401

        found["pypatchmatch"] = _patchmatch
    except Exception as exc:  # noqa: BLE001 (a library that will not load is no rival)
        print(f"pypatchmatch: {exc}")
    if os.environ.get(PYTHON):
        found["xphoto_shiftmap"] = _contrib("shiftmap")
        if slow:
            found["xphoto_fsr"] = _contrib("fsr")
    return found


def timed(rival: Rival, picture: Bytes, hole: Flags) -> tuple[Bytes, float]:
    """Return the filled picture and the CPU seconds it took, a child's included."""
    mine, beside = time.process_time(), os.times()
    found = rival(picture, hole)
    children = os.times().children_user - beside.children_user
    return found, time.process_time() - mine + children


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


def _contrib(method: str) -> Rival:
    def run(picture: Bytes, hole: Flags) -> Bytes:
        with tempfile.TemporaryDirectory() as folder:
            given, made = Path(folder) / "in.npz", Path(folder) / "out.npy"
            np.savez(given, picture=picture, hole=hole)
            subprocess.run(
                [os.environ[PYTHON], "-c", _CHILD, str(given), str(made), method],
                check=True,
                timeout=CONTRIB_LIMIT_S,
                capture_output=True,
            )
            return np.asarray(np.load(made), np.uint8)

    return run
