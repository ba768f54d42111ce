"""As a program with the name of a Mitsuba variant: exits 0 if it renders a grey square under a white sky rightly."""

from __future__ import annotations

import sys

ALBEDO, TOLERANCE = 0.5, 0.01


def error(variant: str) -> float:
    """Return how far the square's radiance is from its albedo."""
    import importlib
    from typing import Any

    import numpy as np

    mi: Any = importlib.import_module("mitsuba")
    mi.set_variant(variant)
    look = mi.ScalarTransform4f().look_at(origin=[0, 0, 3], target=[0, 0, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sky": {"type": "constant", "radiance": 1.0},
        "square": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": ALBEDO}},
        "camera": {"type": "perspective", "fov": 20.0, "to_world": look, "film": film},
    }
    picture = np.array(mi.render(mi.load_dict(scene), spp=64, seed=1))
    return float(abs(picture.mean() - ALBEDO))


if __name__ == "__main__":
    sys.exit(0 if error(sys.argv[1]) < TOLERANCE else 1)
