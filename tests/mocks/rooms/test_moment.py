"""Where the sun stands, against formulas of our own and published almanac values."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from mocks.rooms.sky.daylight import LOWEST_SUN_RAD, Moment, draw_moment, sun_distance_au, sun_of


def meeus_sun_deg(moment: Moment) -> tuple[float, float]:
    """Compass azimuth and true elevation by Meeus's low-accuracy series (Astronomical Algorithms, chapter 25)."""
    utc = moment.utc.astimezone(UTC)
    days = (utc - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds() / 86400
    t = (days + 69.2 / 86400) / 36525
    mean_long = 280.46646 + 36000.76983 * t + 0.0003032 * t * t
    anomaly = math.radians(357.52911 + 35999.05029 * t - 0.0001537 * t * t)
    centre = (1.914602 - 0.004817 * t) * math.sin(anomaly) + 0.019993 * math.sin(2 * anomaly)
    centre += 0.000289 * math.sin(3 * anomaly)
    node = math.radians(125.04 - 1934.136 * t)
    longitude = math.radians(mean_long + centre - 0.00569 - 0.00478 * math.sin(node))
    tilt = math.radians(23.439291 - 0.0130042 * t + 0.00256 * math.cos(node))
    right_ascension = math.atan2(math.cos(tilt) * math.sin(longitude), math.cos(longitude))
    declination = math.asin(math.sin(tilt) * math.sin(longitude))
    sidereal = 280.46061837 + 360.98564736629 * days - 0.00478 * math.sin(node) * math.cos(tilt)
    hour = math.radians(sidereal + moment.longitude_deg) - right_ascension
    latitude = math.radians(moment.latitude_deg)
    sine = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(hour)
    east = -math.cos(declination) * math.sin(hour)
    north = math.sin(declination) * math.cos(latitude) - math.cos(declination) * math.sin(latitude) * math.cos(hour)
    return math.degrees(math.atan2(east, north)) % 360, math.degrees(math.asin(sine))


def refraction_deg(true_elevation_deg: float) -> float:
    """Saemundsson's refraction at 1010 hPa and 10 degrees C."""
    return 1.02 / math.tan(math.radians(true_elevation_deg + 10.3 / (true_elevation_deg + 5.11))) / 60


@pytest.mark.parametrize("site", [(40.44, -79.99), (59.33, 18.07), (-33.87, 151.21), (1.35, 103.82)])
@pytest.mark.parametrize("month", [1, 3, 6, 9, 12])
def test_sun_is_where_independent_formulas_put_it(site: tuple[float, float], month: int) -> None:
    checked = 0
    for hour in range(0, 24, 2):
        moment = Moment(*site, datetime(2025, month, 20, hour, 17, tzinfo=UTC), 0.0)
        azimuth_deg, true_deg = meeus_sun_deg(moment)
        if true_deg < 5:
            continue
        azimuth_rad, elevation_rad = sun_of(moment)
        assert math.degrees(elevation_rad) == pytest.approx(true_deg + refraction_deg(true_deg), abs=0.02)
        off_deg = math.remainder(math.degrees(azimuth_rad) - azimuth_deg, 360) * math.cos(elevation_rad)
        assert abs(off_deg) < 0.02
        checked += 1
    assert checked >= 2


def test_nrel_report_example() -> None:
    """Reda and Andreas 2004, NREL/TP-560-34302, appendix A.5: zenith 50.11162, azimuth 194.34024 degrees.

    The report's site lies at 1830 m in thinner air, which moves the refraction by 0.004 degrees.
    """
    local = timezone(timedelta(hours=-7))
    moment = Moment(39.742476, -105.1786, datetime(2003, 10, 17, 12, 30, 30, tzinfo=local), 0.0)
    azimuth_rad, elevation_rad = sun_of(moment)
    assert math.degrees(azimuth_rad) % 360 == pytest.approx(194.34024, abs=0.005)
    assert 90 - math.degrees(elevation_rad) == pytest.approx(50.11162, abs=0.01)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 200.0, 359.0])
def test_heading_turns_the_sun_the_other_way(heading_deg: float) -> None:
    when = datetime(2025, 6, 21, 15, 0, tzinfo=UTC)
    compass_rad, elevation_rad = sun_of(Moment(40.44, -79.99, when, 0.0))
    turned_rad, same_rad = sun_of(Moment(40.44, -79.99, when, math.radians(heading_deg)))
    assert same_rad == elevation_rad
    assert math.remainder(turned_rad - (compass_rad - math.radians(heading_deg)), 2 * math.pi) == pytest.approx(
        0, abs=1e-9
    )
    assert -math.pi <= turned_rad <= math.pi


def test_morning_sun_of_a_room_that_looks_north_is_on_the_right() -> None:
    azimuth_rad, _ = sun_of(Moment(40.44, -79.99, datetime(2025, 3, 20, 12, 30, tzinfo=UTC), 0.0))
    assert math.radians(80) < azimuth_rad < math.radians(120)


def test_distance_to_the_sun() -> None:
    perihelion = sun_distance_au(Moment(0, 0, datetime(2025, 1, 4, tzinfo=UTC), 0))
    aphelion = sun_distance_au(Moment(0, 0, datetime(2025, 7, 3, tzinfo=UTC), 0))
    assert perihelion == pytest.approx(0.98333, abs=5e-4)
    assert aphelion == pytest.approx(1.01664, abs=5e-4)


def test_a_time_without_zone_is_refused() -> None:
    with pytest.raises(ValueError, match="zone"):
        Moment(0, 0, datetime(2025, 1, 1), 0)


def test_drawn_moments_are_by_day_repeat_and_differ() -> None:
    drawn = [draw_moment(np.random.default_rng([seed, 5])) for seed in range(40)]
    assert drawn[:3] == [draw_moment(np.random.default_rng([seed, 5])) for seed in range(3)]
    assert all(sun_of(m)[1] >= LOWEST_SUN_RAD for m in drawn)
    assert len({m.utc.month for m in drawn}) > 6
    assert len({round(m.latitude_deg / 5) for m in drawn}) > 4
    at_the_papers_site = sum(abs(m.latitude_deg - 40.44) < 0.3 and m.longitude_deg < -79 for m in drawn)
    assert 4 <= at_the_papers_site <= 22
    quarters = {int(m.heading_rad / (math.pi / 2)) for m in drawn}
    assert quarters == {0, 1, 2, 3}
