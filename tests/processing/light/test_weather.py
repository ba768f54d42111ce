"""The sun and the sky at another time: places, energies, what the captured picture says, and what is refused."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.calibration.outdoor.sun_place import Place, clear_beam, sun_place, with_zone, zone_at, zone_named
from processing.errors import DaylightError, ParameterError
from processing.light.scene.scene import Outdoors
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.relighting.weather import (
    captured_weather,
    day_times,
    daylight_at,
    level_illuminance,
    parse_time,
    sun_direction,
    usual_weather,
)

PITTSBURGH = Place(40.44, -79.99)
NOON = datetime(2023, 6, 21, 17, 20, tzinfo=UTC)
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)
DARK = Outdoors(np.zeros((16, 32, 3), np.float32))


def meeus(time_utc: datetime, place: Place) -> tuple[float, float]:
    """Azimuth and true elevation (radians) by Meeus's chapter 25, right to 0.01 degrees: another way than ours."""
    days = (time_utc - datetime(2000, 1, 1, 12, tzinfo=UTC)) / timedelta(days=1) + 69e-5
    t = days / 36525
    anomaly = math.radians(357.52911 + 35999.05029 * t)
    centre = (1.914602 - 0.004817 * t) * math.sin(anomaly) + 0.019993 * math.sin(2 * anomaly)
    node = math.radians(125.04 - 1934.136 * t)
    longitude = math.radians(280.46646 + 36000.76983 * t + centre - 0.00569 - 0.00478 * math.sin(node))
    tilt = math.radians(23.4392911 - 0.0130042 * t + 0.00256 * math.cos(node))
    right = math.atan2(math.cos(tilt) * math.sin(longitude), math.cos(longitude))
    declination = math.asin(math.sin(tilt) * math.sin(longitude))
    universal = days - 69e-5
    hour = math.radians(280.46061837 + 360.98564736629 * universal + place.longitude_deg) - right
    latitude = math.radians(place.latitude_deg)
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(hour)
    east = -math.cos(declination) * math.sin(hour)
    north = math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(declination) * math.cos(hour)
    return math.atan2(east, north), math.asin(up)


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 50 * 525_960),
    st.floats(-60, 60),
    st.floats(-180, 180),
    st.floats(0, 2 * math.pi),
)
def test_the_sun_stands_where_another_formula_says(minutes, latitude, longitude, heading) -> None:
    place, time_utc = Place(latitude, longitude), datetime(2000, 1, 1, tzinfo=UTC) + timedelta(minutes=minutes)
    azimuth, elevation = meeus(time_utc, place)
    found = sun_place(time_utc, place)
    if elevation < math.radians(5):  # below, refraction lifts it by more than 0.15 degrees
        return
    lifted = elevation + math.radians(1.02 / 60) / math.tan(elevation + 0.00314 / (elevation + 0.0892))
    x, y, z = sun_direction(found, heading)
    level = math.cos(lifted)
    goal = (math.sin(azimuth - heading) * level, math.cos(azimuth - heading) * level, math.sin(lifted))
    assert math.degrees(math.dist((x, y, z), goal)) < 0.03


def test_headings() -> None:
    east = sun_place(datetime(2023, 3, 20, 11, 40, tzinfo=UTC), PITTSBURGH)
    assert math.degrees(east.azimuth_rad) == pytest.approx(93, abs=4)
    # Facing north, east is to the right; facing east, it is ahead.
    assert sun_direction(east, 0.0)[0] > 0.9
    assert sun_direction(east, math.pi / 2)[1] > 0.9


@pytest.mark.parametrize("kind", ["clear", "overcast"])
def test_light_on_level_ground_is_what_is_said(kind) -> None:
    found = daylight_at(NOON, PITTSBURGH, 0.3, usual_weather(kind), DARK, rows=64)
    sky, sun = (float(v @ WEIGHTS) for v in level_illuminance(found.outdoors))
    assert sky == pytest.approx(found.diffuse_lx, rel=1e-3)
    assert sky + sun == pytest.approx(found.global_lx, rel=1e-3)
    clear = clear_beam(NOON, PITTSBURGH)
    whole = clear.diffuse_lx + clear.normal_lx * math.sin(found.place.elevation_rad)
    assert found.global_lx == pytest.approx(whole if kind == "clear" else 0.25 * whole, rel=1e-3)
    assert (found.clearness > 3) == (kind == "clear")
    assert (found.outdoors.rgb > 0).all()
    if kind == "clear":
        # As textbooks have it for a high sun: 90 to 130 klx, of which the sky gives 10 to 25 %.
        assert 9e4 < found.global_lx < 1.3e5
        assert 0.08 < found.diffuse_lx / found.global_lx < 0.3
    else:
        assert found.outdoors.sun is None


def test_the_captured_weather_gives_the_captured_light_at_the_captured_time() -> None:
    place, heading = Place(45.0, 8.0), 1.0
    time_utc = datetime(2022, 9, 1, 9, tzinfo=UTC)
    hazy = daylight_at(time_utc, place, heading, usual_weather("clear"), DARK)
    assert hazy.outdoors.sun is not None
    captured = Outdoors(hazy.outdoors.rgb * 1.5, hazy.outdoors.sun)
    weather = captured_weather(captured, time_utc, place)
    assert weather.beam == pytest.approx(1.0, rel=0.01)
    assert weather.diffuse == pytest.approx(1.5, rel=0.01)
    again = daylight_at(time_utc, place, heading, weather, captured)
    assert again.diffuse_lx == pytest.approx(1.5 * hazy.diffuse_lx, rel=0.01)
    assert again.outdoors.sun is not None
    assert again.outdoors.sun.normal_illuminance_lx == pytest.approx(hazy.outdoors.sun.normal_illuminance_lx, rel=0.01)
    assert again.outdoors.rgb[-1] == pytest.approx(captured.rgb[-1], rel=0.1)
    evening = daylight_at(time_utc + timedelta(hours=8), place, heading, weather, captured)
    assert evening.outdoors.sun is not None
    red, _, blue = evening.outdoors.sun.normal_illuminance_lx
    noon_red, _, noon_blue = again.outdoors.sun.normal_illuminance_lx
    assert red / blue > noon_red / noon_blue


def test_strange_captures_are_held_and_reported() -> None:
    time_utc = datetime(2022, 9, 1, 9, tzinfo=UTC)
    place = Place(45.0, 8.0)
    bright = Outdoors(np.full((16, 32, 3), 1e9, np.float32))
    weather = captured_weather(bright, time_utc, place)
    assert weather.diffuse == 6
    assert weather.beam == 0
    assert any("limited" in note for note in weather.notes)
    black = captured_weather(DARK, time_utc, place)
    assert np.isfinite(daylight_at(time_utc, place, 0.0, black, DARK).outdoors.rgb).all()
    moved = daylight_at(time_utc + timedelta(hours=7), place, 0.0, usual_weather("clear"), DARK).outdoors
    assert any("off its computed position" in note for note in captured_weather(moved, time_utc, place).notes)


def test_night_is_refused_and_days_end_where_the_sun_does() -> None:
    with pytest.raises(DaylightError, match="below the horizon"):
        daylight_at(datetime(2023, 6, 21, 4, tzinfo=UTC), PITTSBURGH, 0.0, usual_weather("clear"), DARK)
    zone = zone_at(PITTSBURGH.latitude_deg, PITTSBURGH.longitude_deg)
    assert str(zone) == "America/New_York"
    times = day_times(NOON, PITTSBURGH, zone, timedelta(hours=1))
    assert 13 <= len(times) <= 15
    assert all(sun_place(t, PITTSBURGH).elevation_rad > 0 for t in times)
    assert {t.astimezone(zone).date() for t in times} == {datetime(2023, 6, 21).date()}
    with pytest.raises(DaylightError, match="does not rise"):
        day_times(datetime(2023, 12, 21, 12, tzinfo=UTC), Place(78.2, 15.6), UTC, timedelta(hours=1))
    with pytest.raises(DaylightError, match="does not rise") as dark:
        day_times(datetime(2023, 6, 20, 20, tzinfo=UTC), Place(-77.8, 166.7), zone_at(-77.8, 166.7), timedelta(hours=1))
    assert dark.value.where == "2023-06-21", "the day that was asked for, by the place's clocks"
    with pytest.raises(ParameterError, match="a step"):
        day_times(NOON, PITTSBURGH, zone, timedelta(seconds=1))


def test_times() -> None:
    assert parse_time("2023-06-21 16:00", zone_named("America/New_York")) == datetime(2023, 6, 21, 20, tzinfo=UTC)
    assert parse_time("2023-06-21T16:00+02:00", UTC) == datetime(2023, 6, 21, 14, tzinfo=UTC)
    assert parse_time("2023-06-21T16:00Z", zone_named("-04:00")) == datetime(2023, 6, 21, 16, tzinfo=UTC)
    for wrong, words in (("at noon", "not a time"), ("9999-06-21", "'9999-06-21' is too far")):
        with pytest.raises(ParameterError, match=words):
            parse_time(wrong, UTC)
    assert parse_time("2023-12-21 16:00", zone_at(40.44, -79.99)) == datetime(2023, 12, 21, 21, tzinfo=UTC)
    assert zone_at(None, None) is UTC
    assert with_zone(datetime(2023, 6, 21, 20, tzinfo=UTC), zone_at(40.44, -79.99)) == "2023-06-21 16:00 EDT"
    for wrong in ("Mars/Olympus", "+99:00", "-4", ""):
        with pytest.raises(ParameterError, match="no such time zone"):
            zone_named(wrong)


def test_light_of_clouds_goes_with_sun_and_sky_together() -> None:
    later = NOON + timedelta(hours=5)
    captured = daylight_at(NOON, PITTSBURGH, 0.0, usual_weather("overcast"), DARK).outdoors
    weather = captured_weather(captured, NOON, PITTSBURGH)
    assert weather.beam == 0
    assert weather.diffuse == pytest.approx(0.25, rel=0.01)
    found = daylight_at(later, PITTSBURGH, 0.0, weather, captured)
    clear = clear_beam(later, PITTSBURGH)
    whole = clear.diffuse_lx + clear.normal_lx * math.sin(found.place.elevation_rad)
    assert found.global_lx == pytest.approx(0.25 * whole, rel=0.01)


def test_a_clear_sky_has_its_own_colour_behind_glass_that_stands_for_two_cameras() -> None:
    glass = (0.5, 0.6, 0.8)
    plain, turned = (daylight_at(NOON, PITTSBURGH, 0.0, usual_weather("clear", g), DARK) for g in ((1, 1, 1), glass))
    indoors = turned.outdoors.rgb[:60] * np.asarray(glass)
    ratio = indoors / plain.outdoors.rgb[:60]
    assert ratio == pytest.approx(np.broadcast_to(ratio.mean(), ratio.shape), rel=1e-3)
