"""Geometries as JSON: what goes out comes back, and nothing else comes in."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import ParameterError
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, Perspective
from processing.sphere.geometry import geometry_from_json, geometry_to_json

ANGLES = st.floats(-3, 3)
SIZES = st.integers(4, 9000)
GEOMETRIES = st.one_of(
    st.builds(Equirectangular, SIZES, SIZES, ANGLES),
    st.builds(Perspective, SIZES, SIZES, st.floats(0.1, 2.5), ANGLES, st.floats(-1.5, 1.5), ANGLES),
    st.builds(
        Fisheye,
        SIZES,
        SIZES,
        st.sampled_from([m for m in LensMapping if m not in (LensMapping.POLYNOMIAL, LensMapping.ORTHOGRAPHIC)]),
        st.floats(1, 5000),
        st.floats(0.5, 1.57),
        st.none() | st.tuples(st.floats(1, 4), st.floats(1, 4)),
        ANGLES,
    ),
    st.builds(
        lambda a: Fisheye(80, 60, LensMapping.POLYNOMIAL, 20.5, math.radians(93), None, 0.0, (a, 1 - a)),
        st.floats(0.8, 1.0),
    ),
)


@settings(max_examples=60, deadline=None)
@given(GEOMETRIES)
def test_round_trip_through_text(geometry: Geometry) -> None:
    text = json.dumps(geometry_to_json(geometry), allow_nan=False)
    assert geometry_from_json(json.loads(text)) == geometry


@pytest.mark.parametrize(
    "wrong",
    [
        None,
        [],
        {"kind": "cube"},
        {"kind": "equirectangular"},
        {"kind": "equirectangular", "width_px": 2.5, "height_px": 8, "yaw_rad": 0.0},
        {"kind": "equirectangular", "width_px": True, "height_px": 8, "yaw_rad": 0.0},
        {"kind": "equirectangular", "width_px": 0, "height_px": 8, "yaw_rad": 0.0},
        {"kind": "equirectangular", "width_px": 16, "height_px": 8, "yaw_rad": math.nan},
        {"kind": "equirectangular", "width_px": 16, "height_px": 8, "yaw_rad": "0"},
        {"kind": "equirectangular", "width_px": 16, "height_px": 8, "yaw_rad": 0.0, "more": 1},
        geometry_to_json(Fisheye(8, 8, LensMapping.EQUISOLID, 4.0)) | {"mapping": "fish"},
        geometry_to_json(Fisheye(8, 8, LensMapping.EQUISOLID, 4.0)) | {"centre_px": [1.0]},
        geometry_to_json(Fisheye(8, 8, LensMapping.EQUISOLID, 4.0)) | {"centre_px": [1.0, None]},
        geometry_to_json(Fisheye(8, 8, LensMapping.EQUISOLID, 4.0)) | {"polynomial": None},
    ],
)
def test_anything_else_is_refused(wrong: object) -> None:
    with pytest.raises(ParameterError):
        geometry_from_json(wrong)
