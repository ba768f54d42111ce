"""The plan of a day, against almanac figures and what must hold of any day."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime, timedelta
from functools import cache

import pytest

import daylit
from processing.calibration.outdoor.sun_place import Place
from processing.commands.plan import Moment, day_moments, drift_frac_per_min, sun_hours

PITTSBURGH = Place(40.44, -79.99)
NOON = datetime(2023, 6, 21, 17, 22, tzinfo=UTC)
"""Local solar noon of that day there (NOAA solar calculator: 13:22 EDT)."""


@cache
def day() -> list[Moment]:
    return day_moments(NOON, PITTSBURGH)


def test_the_day_is_as_long_as_the_almanac_says() -> None:
    """15 h 4 min from sunrise to sunset (NOAA); the sun 73.0 degrees high at noon."""
    moments = day()
    assert (moments[-1].utc - moments[0].utc).total_seconds() / 3600 == pytest.approx(15.07, abs=0.5)
    assert math.degrees(max(m.elevation_rad for m in moments)) == pytest.approx(73.0, abs=0.1)


def test_a_south_wall_has_its_sun_around_noon_and_opposite_walls_share_the_day() -> None:
    moments = day()
    ((start, end),) = sun_hours(moments, 180.0)
    assert abs((start + (end - start) / 2 - NOON).total_seconds()) < 900
    behind = sun_hours(moments, 0.0)
    assert len(behind) == 2, "north walls have sun in the morning and in the evening of a summer's day"
    total = sum((b - a for a, b in [(start, end), *behind]), timedelta())
    assert total.total_seconds() == len(moments) * 600


def test_a_clear_sky_is_stillest_at_noon() -> None:
    drifts = drift_frac_per_min(day())
    best = min(drifts, key=lambda drift: drift[1])
    assert abs((best[0] - NOON).total_seconds()) <= 600
    assert best[1] < 1e-3 < drifts[0][1]


def test_the_command_says_it_in_local_time(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--site", "40.44,-79.99", "--heading", "180", "--date", "2023-06-21", "--zone", "-04:00"]
    assert daylit.main(["plan", *options, "--window", "90", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [row["wall"] for row in facts["sun"]] == ["ahead", "right", "behind", "left", "window 90"]
    assert facts["sun"][4]["hours"] == facts["sun"][3]["hours"], "left of somebody who looks south is east"
    assert facts["stillest"].startswith("13:")
    assert daylit.main(["plan", *options]) == 0
    assert "ahead        faces 180.0 degrees: sun 09:" in capsys.readouterr().out
    assert daylit.main(["plan", "--site", "far away", "--heading", "0"]) == 2


def test_a_polar_night_has_no_sun(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["plan", "--site", "78.2,15.6", "--heading", "0", "--date", "2023-12-21"]) == 0
    assert "does not rise" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [["nan"], ["0", "--window", "inf"], ["0", "--date", "9999-12-31"], ["0", "--date", "0001-01-01"]],
)
def test_what_no_day_and_no_direction_is_is_refused(words: list[str]) -> None:
    assert daylit.main(["plan", "--site", "40.44,-79.99", "--heading", *words]) == 2
