"""Where, when and facing whither a room was photographed, and where the sun then stood."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache

import numpy as np

LOWEST_SUN_RAD = math.radians(8)

# Latitude, longitude, weight: mostly the paper's Pittsburgh, else places all over the inhabited world.
SITES = (
    (40.44, -79.99, 0.30),
    (37.77, -122.42, 0.06),
    (51.51, -0.13, 0.08),
    (52.52, 13.40, 0.08),
    (59.33, 18.07, 0.05),
    (41.39, 2.17, 0.06),
    (30.04, 31.24, 0.04),
    (-1.29, 36.82, 0.04),
    (-33.92, 18.42, 0.04),
    (19.08, 72.88, 0.05),
    (35.68, 139.69, 0.06),
    (1.35, 103.82, 0.04),
    (-33.87, 151.21, 0.05),
    (-23.55, -46.63, 0.05),
)


@dataclass(frozen=True)
class Moment:
    """A site, an instant and a heading. ``heading_rad`` is the compass azimuth (clockwise from north) of +y."""

    latitude_deg: float
    longitude_deg: float
    utc: datetime
    heading_rad: float

    def __post_init__(self) -> None:
        if self.utc.tzinfo is None:
            raise ValueError("a moment needs a time with its zone")


@lru_cache(maxsize=256)
def sun_of(moment: Moment) -> tuple[float, float]:
    """Return the sun's azimuth (from +y towards +x, in -pi..pi) and apparent elevation in radians.

    By NREL's solar position algorithm as pvlib has it, with refraction at standard pressure.
    """
    import pandas as pd
    from pvlib.solarposition import spa_python

    times = pd.DatetimeIndex([moment.utc])
    found = spa_python(times, moment.latitude_deg, moment.longitude_deg)
    compass_rad = math.radians(float(found["azimuth"].iloc[0]))
    elevation_rad = math.radians(float(found["apparent_elevation"].iloc[0]))
    return math.remainder(compass_rad - moment.heading_rad, 2 * math.pi), elevation_rad


def sun_distance_au(moment: Moment) -> float:
    """Return the distance to the sun in astronomical units (Spencer 1971; right to 0.05 %)."""
    day_angle = 2 * math.pi * (moment.utc.astimezone(UTC).timetuple().tm_yday - 1) / 365.25
    closeness = 1.000110 + 0.034221 * math.cos(day_angle) + 0.001280 * math.sin(day_angle)
    closeness += 0.000719 * math.cos(2 * day_angle) + 0.000077 * math.sin(2 * day_angle)
    return 1 / math.sqrt(closeness)


def draw_moment(rng: np.random.Generator, lowest_sun_rad: float = LOWEST_SUN_RAD) -> Moment:
    """Return a moment of any date, any heading, in working daylight: the sun at least ``lowest_sun_rad`` high."""
    weights = np.array([weight for _, _, weight in SITES])
    while True:
        latitude_deg, longitude_deg, _ = SITES[int(rng.choice(len(SITES), p=weights / weights.sum()))]
        solar_noon = datetime(2025, 1, 1, 12, tzinfo=UTC) - timedelta(hours=longitude_deg / 15)
        minutes = int(rng.integers(365)) * 1440 + int(rng.integers(-420, 421))
        moment = Moment(
            latitude_deg + round(float(rng.uniform(-0.2, 0.2)), 3),
            longitude_deg + round(float(rng.uniform(-0.2, 0.2)), 3),
            (solar_noon + timedelta(minutes=minutes)).replace(second=0, microsecond=0),
            round(float(rng.uniform(0, 2 * math.pi)), 4),
        )
        if sun_of(moment)[1] >= lowest_sun_rad:
            return moment
