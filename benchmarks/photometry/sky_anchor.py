"""Outdoor horizontal illuminance of the simulated clear sky, as rendered, against pvlib's clear-sky model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta

import numpy as np

from benchmarks.photometry.outdoor import linke_of, pvlib_clear_sky_lx
from mocks.rooms.light.engine import environment_emitter, irradiance_at, mesh_shape, mitsuba, sun_emitter
from mocks.rooms.sky.daylight import Moment, sun_distance_au, sun_of
from mocks.rooms.sky.sky import Sky
from mocks.worlds.light import LUMINANCE_WEIGHTS
from processing.ground.mesh import quad

SITES = {"Pittsburgh": (40.44, -79.94), "Lisbon": (38.7, -9.1), "Oslo": (59.9, 10.7), "Singapore": (1.3, 103.8)}
DAYS = ((3, 21), (6, 21), (9, 23), (12, 21))
QUICK_DAYS = ((3, 21), (12, 21))
TURBIDITIES = (1.8, 2.7)
LOWEST_SUN_RAD, LOW_SUN_RAD = math.radians(10), math.radians(20)
SPP, ROWS = 2**14, 32


def outdoor_errors(days: Sequence[tuple[int, int]] = DAYS) -> dict[str, dict[str, float]]:
    """Return errors in per cent of sky and sun together, at noon and three hours later, by figure and case.

    ``outdoor_lux`` where the sun stands over 20 degrees, ``outdoor_lux_default_ineichen`` the same against pvlib's
    model without the enhancement term, ``outdoor_low_sun`` where the sun stands at 10 to 20 degrees.
    """
    high: dict[str, float] = {}
    default: dict[str, float] = {}
    low: dict[str, float] = {}
    for name, moment in _moments(days):
        for turbidity in TURBIDITIES:
            found, linke = rendered_lx(moment, turbidity), linke_of(turbidity)
            case = f"{name}, turbidity {turbidity}"
            error = 100 * (found / pvlib_clear_sky_lx(moment, linke) - 1)
            if sun_of(moment)[1] < LOW_SUN_RAD:
                low[case] = error
            else:
                high[case] = error
                default[case] = 100 * (found / pvlib_clear_sky_lx(moment, linke, enhanced=False) - 1)
    return {"outdoor_lux": high, "outdoor_lux_default_ineichen": default, "outdoor_low_sun": low}


def _moments(days: Sequence[tuple[int, int]]) -> Iterator[tuple[str, Moment]]:
    """Yield the moments at which the sun is high enough for the models, with their names."""
    for name, (latitude, longitude) in SITES.items():
        noon = timedelta(hours=12 - longitude / 15)
        for month, day in days:
            for later_h in (0, 3):
                utc = datetime(2023, month, day, tzinfo=UTC) + noon + timedelta(hours=later_h)
                moment = Moment(latitude, longitude, utc, 0.0)
                if sun_of(moment)[1] >= LOWEST_SUN_RAD:
                    yield f"{name} {month}/{day} +{later_h} h", moment


def rendered_lx(moment: Moment, turbidity: float) -> float:
    """Return the illuminance of open ground, read by looking at a white sheet lit by the sky's map and the sun."""
    azimuth, elevation = sun_of(moment)
    sky = Sky(
        sun_azimuth_rad=azimuth,
        sun_elevation_rad=elevation,
        turbidity=turbidity,
        sun_distance_au=sun_distance_au(moment),
        skyline=False,
    )
    red, green, blue = (float(v) for v in sky.sun_normal_illuminance_rgb)
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    scene = mitsuba().load_dict(
        {
            "type": "scene",
            "sheet": mesh_shape(quad((-2, -2, 0), (4, 0, 0), (0, 4, 0)), white),
            "sky": environment_emitter(sky.environment(ROWS)),
            "sun": sun_emitter(sky.sun_direction, (red, green, blue)),
        }
    )
    # A meter close above the sheet, looking down, sees nothing but the sheet, which gives back all it gets.
    return float(irradiance_at(scene, (0.0, 0.0, 0.002), (0.0, 0.0, -1.0), SPP) @ np.asarray(LUMINANCE_WEIGHTS))
