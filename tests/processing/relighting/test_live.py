"""A lit room by hand: what the studio's sliders, boxes and seats ask for."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import DaylightError, ViewpointError
from processing.pictures.modes import SHARED_OF_MODELLED, modelled, modes_of
from processing.relighting.live import LiveRoom
from tests.processing.relighting.lit_sessions import lit_session

NOTHING = dict.fromkeys(("site", "heading", "zone", "furniture"))
NOON = "2023-05-19 13:00"


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> LiveRoom:
    return LiveRoom(lit_session(tmp_path_factory.mktemp("sessions") / "bedroom"), None, NOTHING)


def test_the_captured_moment_looks_as_it_was_taken_and_evening_is_darker(room, tmp_path_factory) -> None:
    at = f"{room.captured:%Y-%m-%d %H:%M}"
    assert at == "2023-05-19 15:00", "clocks of the place"
    relit = room.under(at, "captured")
    ratio = relit.picture.rgb.sum(axis=2) / np.maximum(room.room.picture.rgb.sum(axis=2), 1e-6)
    assert np.median(ratio) == pytest.approx(1, abs=0.03)
    evening = room.under("2023-05-19 19:30", "captured")
    assert evening.facts["median_luminance"] < 0.7 * relit.facts["median_luminance"]
    assert room.under("2023-05-19 19:30", "captured") is evening, "not worked out twice"
    with pytest.raises(DaylightError, match="below the horizon"):
        room.under("2023-05-19 23:00", "captured")


def test_what_is_modelled_of_another_light_is_an_error_of_the_whole_picture(room) -> None:
    """Its illuminance is about seven tenths as unsure as its pixels are: their errors do not all average out."""
    ready = room._ready
    relit = ready.under(room.room.scene.outdoors, {}, modelled_sky=False).picture
    light = illuminance_lx(relit, (0.0, 1.0, 0.0))
    own = math.sqrt(light.uncertainty_lx**2 - light.scale_lx**2) / light.value_lx
    assert own == pytest.approx(SHARED_OF_MODELLED * np.median(relit.uncertainty), rel=0.25)
    assert [mode.name for mode in modes_of(modelled(relit, 0.0))].count("modelled light") == 1


def test_the_page_keeps_its_colours_and_exposes_only_where_that_is_asked(room) -> None:
    noon, evening = (room.under(at, "clear") for at in (NOON, "2023-05-19 19:30"))
    pages = [json.loads(room.page(one, exposed=False)) for one in (noon, evening)]
    assert pages[0]["range"] == pages[1]["range"]
    assert pages[0]["states"][0]["jpeg"] != json.loads(room.page(evening, exposed=True))["states"][0]["jpeg"]


def test_glare_is_of_the_window_and_of_the_seat(room, monkeypatch) -> None:
    """The window is behind the camera: who faces it meets more light, and nearer to it even more."""
    monkeypatch.setattr("processing.light.solver.irradiance.denoiser_available", lambda: False)
    room.under(NOON, "clear")
    away, towards = (room.glare(None, azimuth) for azimuth in (0.0, 180.0))
    assert towards["figures"]["ev_lx"]["value"] > 3 * away["figures"]["ev_lx"]["value"]
    near = room.glare((0.0, -1.0), 180.0)
    assert near["figures"]["ev_lx"]["value"] > towards["figures"]["ev_lx"]["value"]
    assert near["eye_m"] == [0.0, -1.0, 1.2]
    assert near["seen_share"] > 0.9
    assert near["figures"]["dgp"]["value"] > away["figures"]["dgp"]["value"]
    with pytest.raises(ViewpointError, match="outside the room"):
        room.glare((9.0, 0.0), 0.0)


def test_the_sun_in_a_window_is_said(room) -> None:
    """At one place on the line from the window's middle away from the sun, and not beside it."""
    room.under("2023-12-21 12:20", "clear")
    sun = room.room.scene.outdoors.sun
    assert sun is not None
    outdoors = room._now[1]
    x, y, z = outdoors.sun.direction
    assert y < 0, "it is before the window's wall"
    t = (2.0 - 0.6) / -y  # from the pane back into the room
    seat = (0.0 - t * x, -2.0 + t * -y)
    height = 1.55 - t * z
    azimuth = math.atan2(x, y)
    assert room._sun_in_view((*seat, height), outdoors, azimuth)
    assert not room._sun_in_view((*seat, height), outdoors, azimuth + math.pi)
    assert not room._sun_in_view((2.2, 1.5, height), outdoors, azimuth)
