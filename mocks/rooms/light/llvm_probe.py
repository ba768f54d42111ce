"""Run as a program with the path of an LLVM library: exits 0 if Mitsuba can render with it on this processor.

Meant for a child process, because an unfit LLVM does not raise: it aborts the process.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from typing import Any

OLDEST = 16
"""LLVM 14 and 15 abort with 'Cannot select' on processors with AVX-512."""


def version(path: str) -> int:
    """Return the library's major version, 0 where it is older than 16 (which cannot say) or cannot be loaded."""
    try:
        ask = ctypes.CDLL(path).LLVMGetVersion
    except (OSError, AttributeError):
        return 0
    major, minor, patch = ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint()
    ask(ctypes.byref(major), ctypes.byref(minor), ctypes.byref(patch))
    return int(major.value)


def render() -> float:
    """Render a white square under a uniform sky of radiance 1 and return the picture's mean: 1 if all is well."""
    import numpy as np

    mi: Any = importlib.import_module("mitsuba")

    mi.set_variant("llvm_ad_rgb")
    sky = mi.Bitmap(np.ones((4, 8, 3), dtype=np.float32))
    sensor = {
        "type": "perspective",
        "fov": 30.0,
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
    }
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 8},
            "sensor": sensor,
            "sky": {"type": "envmap", "bitmap": sky},
            "square": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}},
        }
    )
    return float(mi.TensorXf(mi.render(scene, spp=16, seed=1)).numpy().mean())


if __name__ == "__main__":
    if version(sys.argv[1]) < OLDEST:
        sys.exit(f"LLVM is older than {OLDEST}")
    os.environ["DRJIT_LIBLLVM_PATH"] = sys.argv[1]
    sys.exit(abs(render() - 1.0) > 0.02)
