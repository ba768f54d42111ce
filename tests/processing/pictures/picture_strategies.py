"""Hypothesis strategies of small pictures with every field, and what makes one from arrays."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from processing.pictures.images import LuminanceImage, RelativeImage
from processing.sphere import Equirectangular, Fisheye, LensMapping

LIGHT = st.floats(0, 1.6e9, width=32, allow_subnormal=True)
KNOWN = st.floats(2.0**-20, 10, width=32) | st.just(np.float32(np.inf))
JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**60), 2**60)
    | st.floats(allow_nan=False, allow_infinity=False)
    # Any text but half surrogate pairs.
    | st.text(st.characters(exclude_categories=("Cs",)), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abcü", max_size=4), inner, max_size=3),
    max_leaves=6,
)


@st.composite
def images(draw: st.DrawFn, kind: str | None = None) -> RelativeImage | LuminanceImage:
    """Draw a picture of either type, 1 to 9 rows high."""
    height, width = draw(st.integers(4, 9)), draw(st.integers(4, 12))
    shape = (height, width)
    rgb = draw(hnp.arrays(np.float32, (*shape, 3), elements=LIGHT))
    uncertainty = draw(hnp.arrays(np.float32, shape, elements=KNOWN))
    validity = draw(hnp.arrays(np.uint8, shape, elements=st.integers(0, 4)))
    ghost = draw(st.none() | hnp.arrays(np.uint8, shape, elements=st.integers(0, 255)))
    geometry = draw(
        st.sampled_from(
            [Equirectangular(width, height, 0.1), Fisheye(width, height, LensMapping.EQUISOLID, 1.7, 1.6, (1.5, 2.25))]
        )
    )
    attributes = draw(st.dictionaries(st.text("klmß_", max_size=5), JSON_VALUES, max_size=3))
    if (kind or draw(st.sampled_from(["relative", "luminance"]))) == "relative":
        return RelativeImage(rgb, uncertainty, validity, geometry, ghost, attributes)
    scale = draw(st.floats(0, 0.5))
    return LuminanceImage(rgb, uncertainty, validity, geometry, scale, ghost, attributes, draw(st.booleans()))


def luminance_image(rgb: np.ndarray, geometry: object = None, **fields: object) -> LuminanceImage:
    """Return a valid picture of an array, 1 % uncertain and of no scale uncertainty unless stated otherwise."""
    height, width = rgb.shape[:2]
    values = {
        "uncertainty": np.full((height, width), 0.01, np.float32),
        "validity": np.zeros((height, width), np.uint8),
        "scale_uncertainty": 0.0,
    } | fields
    return LuminanceImage(np.asarray(rgb, np.float32), geometry=geometry or Equirectangular(width, height), **values)
