"""A small session made by hand whose room can be relit: a box with a window under a clear sky."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np

from processing.calibration.outdoor.sun_place import Place
from processing.ground.arrays import Floats
from processing.light.picture.render import render
from processing.light.scene.scene import Outdoors, Scene
from processing.light.scene.scene_file import write_scene
from processing.light.solver.irradiance import Effort
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage
from processing.relighting.weather import daylight_at, usual_weather
from processing.sphere import Equirectangular
from station.session.session import BracketRecord, SessionManifest, Side, Site
from tests.processing.light.rooms import EYE, box_room, scene_of

HERE = Place(40.44, -79.99)
CAPTURED = datetime(2023, 5, 19, 19, tzinfo=UTC)
LOOK = Effort(texel_m=0.3, patch_samples=48, rows=64, pixel_samples=48, sun_samples=16, clean=False)


@cache
def captured_scene() -> Scene:
    """Return the room under the light of the session's time."""
    light = daylight_at(
        CAPTURED, HERE, 0.0, usual_weather("clear"), Outdoors(np.zeros((16, 32, 3), np.float32)), rows=32
    )
    return scene_of(box_room(), light.outdoors, 0.5, reveal_m=0.2)


@cache
def photographed() -> Floats:
    """Return its panorama (64, 128, 3), to be left as it is."""
    return render(captured_scene(), Equirectangular(128, 64), EYE, effort=LOOK).rgb


def lit_session(folder: Path) -> Path:
    """Make it in a folder; its panorama has 128 x 64 pixels, emptied and as photographed."""
    stages = folder / "stages"
    for name in ("materials", "room", "remove", "calibrate"):
        (stages / name).mkdir(parents=True)
    manifest = SessionManifest(
        session_id="0" * 32,
        name="bedroom",
        created_utc=CAPTURED,
        site=Site(latitude_deg=HERE.latitude_deg, longitude_deg=HERE.longitude_deg),
        heading_rad=0.0,
        bracket=BracketRecord(mode="imported", stops_s=(1.0,), sides=(Side.INDOOR,)),
    )
    (folder / "session.json").write_text(manifest.model_dump_json(), "utf-8")
    write_scene(stages / "materials" / "scene.npz", captured_scene())
    (stages / "materials" / "materials.json").write_text('{"outdoors": "outdoor picture"}', "utf-8")
    (stages / "room" / "room.json").write_text(box_room().model_dump_json(), "utf-8")
    image = LuminanceImage(
        photographed(),
        np.full((64, 128), 0.05, np.float32),
        np.zeros((64, 128), np.uint8),
        Equirectangular(128, 64),
        0.03,
    )
    for name in ("remove/empty", "calibrate/indoor"):
        write_exr(stages / f"{name}.exr", image)
    return folder
