"""Geometries and pictures that the tests of the sphere share."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st

from processing.sphere import Equirectangular, Fisheye, LensMapping, Perspective, directions

POLYNOMIAL = (1.08, 0.0, -0.08)


def fisheye(mapping: LensMapping, size: int = 64, **changes) -> Fisheye:
    polynomial = POLYNOMIAL if mapping is LensMapping.POLYNOMIAL else ()
    return Fisheye(
        **{"width_px": size, "height_px": size, "mapping": mapping, "radius_px": size / 2, "polynomial": polynomial}
        | changes
    )


def one_of_each(size: int = 64) -> dict:
    return {
        "equirectangular": Equirectangular(2 * size, size, 0.3),
        **{mapping.value: fisheye(mapping, size, top_azimuth_rad=0.4) for mapping in LensMapping},
        "perspective": Perspective(size, size, math.radians(90), yaw_rad=0.6, pitch_rad=0.9, roll_rad=0.2),
    }


def smooth(geometry, scale=3.0):
    """A picture that is known in every direction and has neither seam nor pole."""
    d, _ = directions(geometry)
    return (2 + np.sin(scale * d[..., 0] + 1) * np.cos(scale * d[..., 1]) + 0.5 * np.sin(scale * d[..., 2])).astype(
        "f4"
    )


angles = st.floats(-7, 7)
sizes = st.integers(1, 40)
equirectangulars = st.builds(Equirectangular, sizes, sizes, angles)
perspectives = st.builds(Perspective, sizes, sizes, st.floats(0.01, 2.9), angles, st.floats(-1.57, 1.57), angles)


@st.composite
def fisheyes(draw):
    mapping = draw(st.sampled_from(list(LensMapping)))
    return Fisheye(
        draw(sizes),
        draw(sizes),
        mapping,
        draw(st.floats(0.3, 60)),
        draw(st.floats(0.2, 1.5)),
        draw(st.one_of(st.none(), st.tuples(st.floats(-5, 45), st.floats(-5, 45)))),
        draw(angles),
        POLYNOMIAL if mapping is LensMapping.POLYNOMIAL else (),
    )


geometries = st.one_of(equirectangulars, perspectives, fisheyes())
