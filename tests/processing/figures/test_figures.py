"""Light figures of worlds whose light is known, and the stage that writes them."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processing.calibration.scale.photometry import READING_KEY, illuminance_lx
from processing.errors import ParameterError
from processing.figures.figures import (
    camera_figures,
    eye_view,
    level_ratio,
    meter_figures,
    outdoor_figures,
    reduced,
    surface_figures,
)
from processing.pictures.images import LuminanceImage, Validity
from processing.sphere import Fisheye, LensMapping
from processing.stages.contract import StageContext
from processing.stages.figures import run
from processing.stages.parameters import StageParameters
from tests.processing.figures.test_glare import panorama, room
from tests.processing.room.evidence import BOX, room_of
from tests.station.session.sessions import manifest


def even(level: float = 100.0, rows: int = 64) -> LuminanceImage:
    return panorama(np.full((rows, 2 * rows), level))


def test_even_light_gives_pi_times_luminance_everywhere() -> None:
    found = camera_figures(even(), height_m=1.6, heading_rad=math.radians(350))
    for light in (found["level_up"], found["level_down"], *(look["vertical"] for look in found["directions"])):
        assert light["value"] == pytest.approx(100 * math.pi, rel=1e-5)
        assert light["uncertainty"] == pytest.approx(5 * math.pi, rel=0.1)
        assert light["bound"] is None
    assert found["cylindrical"]["value"] == pytest.approx(100 * math.pi, rel=1e-5)
    assert [look["compass_deg"] for look in found["directions"]][:2] == [350, 35]


def test_a_window_to_the_right_is_where_the_light_is() -> None:
    found = camera_figures(room([(90, 10, 20, 15, 5000)]), height_m=1.6, heading_rad=None)
    assert found["directions"][found["brightest"]]["azimuth_deg"] == 90
    assert found["directions"][0]["compass_deg"] is None
    assert found["directions"][2]["glare"]["dgp"]["value"] > found["directions"][6]["glare"]["dgp"]["value"]
    indices = [look["indices"] for look in found["directions"]]
    assert all({"dgi", "ugr", "cgi", "vcp_pct", "ugp", "lveil_cd_m2"} <= one.keys() for one in indices)
    assert indices[2]["ugr"]["value"] > indices[6]["ugr"]["value"]
    assert indices[2]["dgp"] == found["directions"][2]["glare"]["dgp"]


def test_clipped_light_makes_a_lower_bound_and_no_scale_no_glare() -> None:
    image = room([(0, 10, 20, 15, 5000)])
    validity = np.where(image.rgb[..., 0] > 4000, Validity.CLIPPED, Validity.VALID).astype(np.uint8)
    found = camera_figures(replace(image, validity=validity, absolute=False), height_m=1.6, heading_rad=None)
    assert found["directions"][0]["vertical"]["bound"] == found["cylindrical"]["bound"] == "lower"
    assert not any("glare" in look for look in found["directions"])
    assert surface_figures(replace(image, validity=validity), None)[0]["clipped_share"] > 0.01


def test_statistics_by_solid_angle() -> None:
    image = room([(0, 0, 45, 90, 1000)], around=100.0)
    whole = surface_figures(image, None)
    assert [one["name"] for one in whole] == ["whole"]
    assert whole[0]["solid_angle_sr"] == pytest.approx(4 * math.pi, rel=1e-5)
    assert whole[0]["mean"]["value"] == pytest.approx((1000 * 0.25 + 75 * 0.75), rel=0.01)
    assert whole[0]["highest"]["value"] == 1000
    parts = surface_figures(image, room_of(BOX))
    assert {"floor", "ceiling", "wall", "whole"} <= {one["kind"] for one in parts}
    assert sum(one["solid_angle_sr"] for one in parts[1:]) == pytest.approx(4 * math.pi, rel=1e-4)
    floor = next(one for one in parts if one["name"] == "floor")
    ranked = [floor[name]["value"] for name in ("lowest", "p05", "median", "p95", "highest")]
    assert ranked == sorted(ranked)


def test_smaller_pictures_keep_light_and_what_is_clipped() -> None:
    image = room([(0, 10, 20, 15, 5000)], rows=128)
    validity = np.zeros((128, 256), np.uint8)
    validity[40, 60], validity[100:] = Validity.CLIPPED, Validity.OUTSIDE
    small = reduced(replace(image, validity=validity), 64)
    assert small.rgb.shape == (32, 64, 3)
    assert small.rgb.mean() == pytest.approx(image.rgb.mean(), rel=0.02)
    assert small.validity[10, 15] == Validity.CLIPPED
    assert (small.validity[26:] == Validity.OUTSIDE).all()
    assert reduced(small, 64) is small
    fisheye = Fisheye(32, 32, LensMapping.EQUIDISTANT, 16)
    with pytest.raises(ParameterError):
        reduced(replace(even(rows=16), geometry=fisheye), 16)


def test_the_eyes_view_has_left_on_the_left() -> None:
    image = room([(-40, 20, 10, 10, 5000)], rows=256)
    rows, columns = np.nonzero(eye_view(image, 0.0, 200).rgb[..., 0] > 4000)
    assert columns.mean() < 70
    assert rows.mean() < 90
    turned = np.nonzero(eye_view(image, math.radians(-40), 200).rgb[..., 0] > 4000)
    assert turned[1].mean() == pytest.approx(99.5, abs=1)


def test_the_meter_beside_the_picture() -> None:
    facts = {"target": {"longitude_deg": 10.0, "latitude_deg": -5.0}, "k1_parts": {"meter": 0.02}}
    found = meter_figures(even(), facts, [98.0, 102.0])
    assert found is not None
    assert found["difference_frac"] == pytest.approx(0, abs=1e-6)
    assert found["sets_scale"]
    assert meter_figures(even(), {"target": {"source": "none"}}, [1.0]) is None
    assert meter_figures(even(), facts, []) is None
    assert meter_figures(even(), facts | {"k1_parts": {"given": 0.0}}, [50.0])["sets_scale"] is False


def test_a_clipped_sun_makes_the_outdoor_illuminance_a_lower_bound_however_little_of_it_is_shown() -> None:
    """Without a density filter a clipped sun shows less than a hundredth of the sky's light, and has five times it."""
    sky = even()
    validity = sky.validity.copy()
    validity[20, 30] = Validity.CLIPPED
    sunny = replace(sky, validity=validity)
    found = outdoor_figures(sunny, {})
    assert found is not None
    assert found["level_up"]["clipped_share"] < 0.01
    assert found["level_up"]["bound"] == "lower"
    open_sky = outdoor_figures(sky, {})
    assert open_sky is not None
    assert open_sky["level_up"]["bound"] is None
    # A lux meter's reading has all of the light, whatever its picture lacks.
    reading = illuminance_lx(sky).value_lx
    read = outdoor_figures(replace(sunny, attributes={READING_KEY: (reading, 0.05)}), {})
    assert read is not None
    assert (read["level_up"]["bound"], read["level_up"]["clipped_share"]) == (None, 0.0)
    assert read["level_up"]["uncertainty"] == pytest.approx(0.05 * reading)


def test_ratio_needs_light_outdoors() -> None:
    camera = {"level_up": {"value": 500.0, "uncertainty": 5.0, "bound": None}}
    assert level_ratio(camera, None) is None
    assert level_ratio(camera, {"level_up": {"value": 0.0}}) is None


def context(made: dict, folder: Path) -> StageContext:
    return StageContext(
        session=manifest(),
        session_path=folder,
        folder=folder,
        parameters=StageParameters(),
        fetch=lambda stage, name: made.get((stage, name)),
        summary=lambda _: {},
    )


def test_the_stage_writes_plain_json_with_and_without_a_room(tmp_path: Path) -> None:
    image = room([(90, 10, 20, 15, 5000)])
    made = {("calibrate", "indoor"): image, ("calibrate", "calibration"): {"indoor": {}}}
    bare = run(context(made, tmp_path))
    assert set(bare.left_out) == {"surfaces", "outdoor"}
    full = run(context(made | {("room", "room"): room_of(BOX)}, tmp_path))
    figures = full.artifacts["light_figures"]
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
    assert len(figures["surfaces"]) > 5
    assert full.metrics["highest_dgp"] > 0.2
    relative = run(context(made | {("calibrate", "indoor"): replace(image, absolute=False)}, tmp_path))
    assert "glare" in relative.left_out
    assert relative.artifacts["light_figures"]["units"]["illuminance"] == "relative units"
