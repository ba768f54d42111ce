"""A session's room under the light of any moment, as somebody turns the hours: relit, and seen from a seat.

`Outside` is where the room is, how it faces and what the weather is like; `daylit relight` and the studio share it.
"""

import math
from dataclasses import dataclass, replace
from datetime import datetime, tzinfo
from pathlib import Path
from typing import Any, Self

import numpy as np

from processing.calibration.outdoor.sun_place import Place, zone_at
from processing.errors import ParameterError
from processing.exchange.showing import made_of, session_shown
from processing.figures.glare import CLASSES, FAINT_LX, glare_indices
from processing.ground.arrays import Vector
from processing.light.picture.relight_photo import veil_gains
from processing.light.picture.viewpoint import seen_from
from processing.light.scene.scene import Outdoors
from processing.light.solver.basis import BASIS_EFFORTS
from processing.light.solver.irradiance import EFFORTS
from processing.light.solver.sight import GLASS, sight_along
from processing.pictures.images import LuminanceImage
from processing.relighting import relit_session as sessions
from processing.relighting import weather as weathers
from processing.relighting.relit_session import Relighting, RelitRoom, SessionRoom
from processing.relighting.weather import Sky, Weather
from processing.report.states import Look, State, viewer
from processing.sphere import Equirectangular
from station.commands.views import numbers

ROWS = 512  # of live pictures (chosen: as many as the viewer's map of numbers has; another hour then takes 0.8 CPU s)
SEATED_M = 1.2  # height of a sitting observer's eyes, as EN 12464-1 and EN 17037 take it


@dataclass(frozen=True)
class Outside:
    """What makes the light outdoors at any time."""

    captured: Outdoors
    place: Place
    heading_rad: float
    zone: tzinfo
    weather: Weather
    notes: tuple[str, ...]

    @classmethod
    def of(cls, room: SessionRoom, kind: Sky, asked: dict[str, Any]) -> Self:
        """Return a room's; ``asked``: "site" ("LAT,LON"), "heading" (degrees) and "zone"; None: as the session says.

        Raises `DaylightError` where the place or the heading is not known.
        """
        site = asked["site"] and numbers("--site", asked["site"], 2, "LATITUDE,LONGITUDE in degrees, say 40.44,-79.94")
        place = sessions.place_of(room, site)
        given = None if asked["heading"] is None else math.radians(asked["heading"])
        heading, source = sessions.heading_of(room, given, place)
        zone = zone_at(place.latitude_deg, place.longitude_deg, asked["zone"])
        weather = _weather(room, kind, place)
        first = f"heading {math.degrees(heading) % 360:.1f} degrees ({source}); local time is that of {zone}"
        untimed = "no frame says when it was taken: the captured sun and weather are read as of the session's making"
        notes = (first, *[untimed] * (room.manifest.taken_utc is None), *weather.notes)
        return cls(room.scene.outdoors, place, heading, zone, weather, notes)

    def at(self, time_utc: datetime) -> tuple[Outdoors, dict[str, Any]]:
        """Return the light outdoors at a time, and its facts; `DaylightError` while the sun is down."""
        found = weathers.daylight_at(time_utc, self.place, self.heading_rad, self.weather, self.captured)
        said = {"local_time": f"{time_utc.astimezone(self.zone):%Y-%m-%d %H:%M}", "weather": self.weather.kind}
        return found.outdoors, said | weathers.daylight_facts(found, time_utc)


def _weather(room: SessionRoom, kind: Sky, place: Place) -> Weather:
    if kind == "captured":
        return weathers.captured_weather(room.scene.outdoors, room.time_utc, place)
    panes = room.scene.panes
    return weathers.usual_weather(kind, panes[0].transmittance if panes else (1.0, 1.0, 1.0))


class LiveRoom:
    """A session's room, emptied or staged, ready for any moment; its basis is the one that `daylit relight` keeps."""

    def __init__(self, session: Path, staged: int | None, asked: dict[str, Any]) -> None:
        """``asked``: see `Outside.of`, and "furniture"."""
        self.room = sessions.read_session_room(session, staged, ROWS, None if staged is None else asked["furniture"])
        sessions.check_sky(self.room)
        self._asked, self._outside = asked, dict[str, Outside]()
        self._ready = Relighting(self.room, session / sessions.FOLDER, BASIS_EFFORTS["draft"])
        look = Look(session_shown(session).display, label="" if staged is None else Look.label)
        sight = self._ready.view.full
        self._look = replace(look, panes=np.uint8(2) * (sight.label == GLASS).reshape(sight.shape))
        name = "empty" if staged is None else f"staged-{staged}"
        made = made_of(session, name, further="relit")
        self._state = State("Light", lambda: self.room.picture, made, name)
        self._page = viewer(self._state, self._look)
        self._now: tuple[RelitRoom, Outdoors] | None = None
        self._moment: tuple[str, str] | None = None

    @property
    def captured(self) -> datetime:
        """Return when the room was captured, by its clocks."""
        return self.room.time_utc.astimezone(self.outside("captured").zone)

    def outside(self, kind: Sky) -> Outside:
        """Return the room's place and weather."""
        if kind not in self._outside:
            self._outside[kind] = Outside.of(self.room, kind, self._asked)
        return self._outside[kind]

    def under(self, at: str, kind: Sky) -> RelitRoom:
        """Relight by a local time such as "2023-06-21 16:00"; glare is then that of this light."""
        if (at, kind) != self._moment:
            outside = self.outside(kind)
            outdoors, facts = outside.at(weathers.parse_time(at, outside.zone))
            self._now = self._ready.under(outdoors, facts), outdoors
            self._moment = at, kind
        assert self._now is not None
        return self._now[0]

    def page(self, relit: RelitRoom, *, exposed: bool) -> str:
        """Return what the viewer shows, exposed by itself or as the captured light; its false colours stay the same."""
        display = self._look.display.exposed(relit.picture.rgb) if exposed else self._look.display
        state = replace(self._state, read=lambda: relit.picture)
        return replace(self._page, states=viewer(state, replace(self._look, display=display)).states).json

    def glare(self, seat_m: tuple[float, float] | None, azimuth_deg: float) -> dict[str, Any]:
        """Return glare under the light shown for who sits on the floor's place (m; None: the camera) and looks level.

        ``azimuth_deg``: from ahead (+y) to the right. What the camera did not see from there is rendered.
        """
        assert self._now is not None
        (relit, outdoors), eye, seen = self._now, self.room.eye_m, 1.0
        # Sky and surfaces are models: that doubt is one that all pixels share.
        shared = math.hypot(relit.picture.scale_uncertainty, relit.facts["uncertainty"])
        image = replace(relit.picture, scale_uncertainty=shared)
        if not image.absolute:
            raise ParameterError("glare needs cd/m2, which this session lacks", advice="calibrate it: meter or --k1")
        if seat_m is not None:
            eye = (seat_m[0], seat_m[1], SEATED_M)
            image, seen = self._seen_from(eye, image, outdoors)
        (found,) = glare_indices(image, [math.radians(azimuth_deg)])
        dgp = found["dgp"]["value"]
        return {
            "figures": found,
            "rating": next(name for limit, name in CLASSES if dgp < limit),
            "faint": found["ev_lx"]["value"] < FAINT_LX,
            "seen_share": round(seen, 3),
            "sun_in_view": self._sun_in_view(eye, outdoors, math.radians(azimuth_deg)),
            "eye_m": list(eye),
        }

    def _seen_from(self, eye_m: Vector, relit: LuminanceImage, outdoors: Outdoors) -> tuple[LuminanceImage, float]:
        """Return the panorama from another place under the same light, and the share that the camera saw."""
        scene, veils = self.room.scene, veil_gains(self.room.scene, self.room.scene.outdoors, outdoors)
        panes = [replace(p, veil_cd_m2=p.veil_cd_m2 * v) for p, v in zip(scene.panes, veils, strict=True)]
        lit = replace(scene, outdoors=outdoors, panes=tuple(panes))
        geometry = Equirectangular(relit.rgb.shape[1], relit.rgb.shape[0])
        found = seen_from(lit, relit.rgb, self.room.eye_m, geometry, eye_m, effort=EFFORTS["draft"])
        solid = ~found.glass
        share = float(found.seen[solid].mean()) if solid.any() else 1.0
        return sessions.seen_picture(relit, found, geometry, eye_m), share

    def _sun_in_view(self, eye_m: Vector, outdoors: Outdoors, azimuth_rad: float) -> bool:
        """Return whether the sun's disc, which pictures leave out, stands in a window ahead: glare is then worse."""
        sun = outdoors.sun
        if sun is None or sun.direction[0] * math.sin(azimuth_rad) + sun.direction[1] * math.cos(azimuth_rad) <= 0:
            return False
        towards = np.asarray([sun.direction], np.float32)
        return bool((sight_along(self._ready.view.stage, towards, eye_m, (1, 1)).label == GLASS).any())
