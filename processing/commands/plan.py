"""``daylit plan``: when the sun looks into which window, and when a clear sky holds stillest for a bracket."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from datetime import datetime, timedelta, tzinfo
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from station.commands.views import answer, numbers, parameters

if TYPE_CHECKING:
    from processing.calibration.outdoor.sun_place import Place

STEP_MIN = 10  # chosen: the sun moves by 2.5 degrees
LEAST_SUN_RAD = math.radians(1.0)  # chosen: lower suns are behind something
STILL_FRAC_PER_MIN = 0.005
"""Chosen: a bracket of a minute then drifts by half a percent, a tenth of what `max_drift_frac` allows."""
WALLS = (("ahead", 0.0), ("right", 90.0), ("behind", 180.0), ("left", 270.0))


class Moment(NamedTuple):
    """A time of the day: the sun, radians, and what a clear sky gives level ground, lux."""

    utc: datetime
    azimuth_rad: float
    elevation_rad: float
    global_lx: float


@click.command(params=parameters(__package__, "plan"))
def plan(*, as_json: bool, **asked: Any) -> int:
    """Plan a day: hours of sun on each wall of a room, and how fast a clear sky's light changes.

    Walls are named as the indoor camera sees them. The sun is on a wall while it is above the horizon and within 90
    degrees of the direction the wall faces outdoors. Clouds and surrounding buildings are ignored.

    \b
    Example:
      daylit plan --site 40.44,-79.99 --heading 200 --date 2023-06-21
    """
    from processing.calibration.outdoor.sun_place import Place, zone_at
    from processing.relighting.weather import parse_time

    latitude, longitude = numbers("--site", asked["site"], 2, "LAT,LON in degrees")
    place = Place(latitude, longitude)
    local = zone_at(latitude, longitude, asked["zone"])
    today = datetime.now().astimezone().strftime("%Y-%m-%d")  # as a user's calendar shows it
    moments = day_moments(parse_time(f"{asked['date'] or today} 12:00", local), place)
    walls = [(name, (asked["heading"] + turn) % 360) for name, turn in WALLS]
    walls += [(f"window {azimuth:g}", azimuth % 360) for azimuth in asked["windows"]]
    facts = {
        "zone": str(local),
        "sun": [{"wall": w, "faces_deg": deg, "hours": _clock(sun_hours(moments, deg), local)} for w, deg in walls],
        **_sky(moments, local),
    }
    return answer(facts, _lines(facts), as_json=as_json)


def day_moments(noon_utc: datetime, place: Place) -> list[Moment]:
    """Return the moments of the day around a local noon at which the sun is up, every `STEP_MIN` minutes."""
    from processing.calibration.outdoor.sun_place import clear_beam, sun_place

    turbidity, found = clear_beam(noon_utc, place).linke_turbidity, []
    for step in range(-720 // STEP_MIN, 720 // STEP_MIN):
        utc = noon_utc + timedelta(minutes=STEP_MIN * step)
        sun = sun_place(utc, place)
        if sun.elevation_rad < LEAST_SUN_RAD:
            continue
        beam = clear_beam(utc, place, turbidity)
        level_lx = beam.normal_lx * math.sin(sun.elevation_rad) + beam.diffuse_lx
        found.append(Moment(utc, sun.azimuth_rad, sun.elevation_rad, level_lx))
    return found


def sun_hours(moments: list[Moment], faces_deg: float) -> list[tuple[datetime, datetime]]:
    """Return the spans in which the sun stands before a wall that faces this compass azimuth."""
    return _spans(one.utc for one in moments if math.cos(one.azimuth_rad - math.radians(faces_deg)) > 0)


def _spans(begins: Iterable[datetime]) -> list[tuple[datetime, datetime]]:
    """Return what steps of `STEP_MIN` make together that begin at these times."""
    found: list[tuple[datetime, datetime]] = []
    for begin in begins:
        first = found.pop()[0] if found and found[-1][1] == begin else begin
        found.append((first, begin + timedelta(minutes=STEP_MIN)))
    return found


def drift_frac_per_min(moments: list[Moment]) -> list[tuple[datetime, float]]:
    """Return, between moments, how much a clear sky's light on level ground changes a minute, as a fraction of it."""
    pairs = itertools.pairwise(moments)
    return [(a.utc + (b.utc - a.utc) / 2, abs(math.log(b.global_lx / a.global_lx)) / STEP_MIN) for a, b in pairs]


def _sky(moments: list[Moment], local: tzinfo) -> dict[str, Any]:
    drifts = drift_frac_per_min(moments)
    if not drifts:
        return {"stillest": None, "sky_frac_per_min": None, "still": []}
    best, least = min(drifts, key=lambda drift: drift[1])
    half = timedelta(minutes=STEP_MIN / 2)
    spans = _spans(utc - half for utc, frac in drifts if frac <= STILL_FRAC_PER_MIN)
    stillest = f"{best.astimezone(local):%H:%M}"
    return {"stillest": stillest, "sky_frac_per_min": round(least, 6), "still": _clock(spans, local)}


def _clock(spans: list[tuple[datetime, datetime]], local: tzinfo) -> list[list[str]]:
    return [[f"{t.astimezone(local):%H:%M}" for t in span] for span in spans]


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    def words(spans: list[list[str]]) -> str:
        return ", ".join(f"{a} to {b}" for a, b in spans) or "never"

    for wall in facts["sun"]:
        yield f"{wall['wall']:<12} faces {wall['faces_deg']:>5.1f} degrees: sun {words(wall['hours'])}"
    if facts["stillest"] is None:
        yield "the sun does not rise"
    else:
        yield (
            f"a clear sky is steadiest at {facts['stillest']} ({100 * facts['sky_frac_per_min']:.2f} % per minute); "
            f"under {100 * STILL_FRAC_PER_MIN:g} % per minute: {words(facts['still'])}"
        )
    yield f"times are in {facts['zone']}; the sun moves one degree in 4 minutes; clouds are ignored"
