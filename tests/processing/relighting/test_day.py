"""The stage day: hours of the best still's frame without a sweep, or why there are none."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from processing.ground.room_model import read_room
from processing.light.scene.scene_file import read_scene, write_scene
from processing.pictures.display import AS_GIVEN
from processing.pictures.exr import read_exr, write_exr
from processing.pictures.images import LuminanceImage
from processing.relighting import day as stage
from processing.relighting.day import no_day, run
from processing.report.frames import Frame
from processing.sphere.views import Panorama, cut_view
from processing.stages.contract import Quality, StageContext
from processing.stages.parameters import DayParameters
from station.session.session import FrameRecord, Side, Site
from station.session.store import load_manifest
from tests.processing.relighting.lit_sessions import CAPTURED, lit_session

WIDE_PX = 480
"""Of the hours' pictures, here."""
STILL = {"state": "emptied", "yaw_deg": 180.0, "lens_mm": 18.0, "drop": 0.1, "original": "still-1-original.jpg"}
"""Towards the window, on whose sides the sun goes by."""


@pytest.fixture
def lit(tmp_path: Path) -> StageContext:
    """What the stage gets of a small session that was emptied and has one still."""
    session = lit_session(tmp_path / "bedroom")
    stages = session / "stages"
    made: Mapping[tuple[str, str], Callable[[], Any]] = {
        ("materials", "scene"): lambda: stages / "materials" / "scene.npz",
        ("materials", "materials"): lambda: json.loads((stages / "materials" / "materials.json").read_bytes()),
        ("room", "room"): lambda: read_room(stages / "room" / "room.json"),
        ("stills", "still-1-light"): lambda: stages / "still-1-light.exr",
        ("stills", "display"): lambda: AS_GIVEN.exposed(_empty(session).rgb).to_dict(),
        ("stills", "stills"): lambda: {"stills": [STILL]},
    }

    frame = Frame(np.radians(STILL["yaw_deg"]), STILL["lens_mm"], STILL["drop"]).view(480)
    light = cut_view(Panorama(_empty(session).rgb), frame)
    doubt = np.full(light.shape[:2], 0.1, np.float32)
    write_exr(stages / "still-1-light.exr", LuminanceImage(light, doubt, np.zeros_like(doubt, np.uint8), frame, 0.03))

    def fetch(stage: str, name: str) -> Any:
        return made[stage, name]() if (stage, name) in made else None

    (tmp_path / "day").mkdir()
    parameters, blank = DayParameters(), {"left_out": {}, "metrics": {}, "warnings": []}
    manifest = load_manifest(session).model_copy(update={"frames": (_frame(CAPTURED),)})
    return StageContext(manifest, session, tmp_path / "day", parameters, fetch, lambda _stage: blank)


def _frame(taken_utc: datetime | None) -> FrameRecord:
    where = {"side": Side.INDOOR, "stop": 0, "file": "indoor/00_1s.jpg", "size_bytes": 1, "sha256": "0" * 64}
    return FrameRecord(**where, asked_s=1.0, camera_s=1.0, taken_utc=taken_utc)


def _empty(session: Path) -> LuminanceImage:
    image = read_exr(session / "stages" / "remove" / "empty.exr")
    assert isinstance(image, LuminanceImage)
    return image


def _codes(path: Path) -> np.ndarray:
    with Image.open(io.BytesIO(path.read_bytes())) as picture:
        return np.asarray(picture.convert("RGB"), np.float64)


def test_the_day_of_capture_goes_by_and_at_its_own_hour_the_room_is_as_it_was(
    lit: StageContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage, "WIDE_PX", WIDE_PX)
    assert no_day(lit) is None
    made = run(lit)
    hours = made.artifacts["day"]["hours"]
    assert [one["local_time"] for one in hours] == [f"2023-05-19 {hour:02}:00" for hour in range(7, 21)]
    assert made.metrics["hours"] == len(hours) == 14
    assert set(made.artifacts) | set(made.left_out) == {"day", *(f"hour-{k}" for k in range(1, 25))}
    pictures = [_codes(lit.folder / f"hour-{k}.jpg") for k in range(1, 15)]
    assert pictures[0].shape == (Frame.height_px(WIDE_PX), WIDE_PX, 3)
    assert pictures[0].mean() < 0.5 * pictures[5].mean(), "dawn is darker than noon, as the exposure is one"
    # The session was captured at 15 o'clock: all but one exposure is as the emptied room's own cut.
    frame = Frame(np.radians(STILL["yaw_deg"]), STILL["lens_mm"], STILL["drop"])
    own = cut_view(Panorama(_empty(lit.session_path).rgb), frame.view(WIDE_PX))[-pictures[0].shape[0] :]
    order = np.argsort(own.mean(axis=2)[:250:3, ::3], axis=None)
    seen = pictures[8].mean(axis=2)[:250:3, ::3].ravel()[order]
    assert np.corrcoef(np.arange(len(seen)), np.argsort(np.argsort(seen)))[0, 1] > 0.98
    assert np.corrcoef(seen, pictures[1].mean(axis=2)[:250:3, ::3].ravel()[order])[0, 1] < 0.97
    data = (lit.folder / "hour-3.jpg").read_bytes()
    for words in (b"another time", b"removed digitally", b"Unaltered original: ../stills/still-1-original.jpg"):
        assert words in data


def test_why_there_is_no_day(lit: StageContext) -> None:
    def without(**fields: Any) -> str:
        return no_day(replace(lit, session=lit.session.model_copy(update=fields))) or ""

    assert "draft" in (no_day(replace(lit, quality=Quality.DRAFT)) or "")
    assert "site is unknown; give --site" in without(site=Site())
    assert "do not say when" in without(frames=(_frame(None),))
    night = _frame(datetime(2023, 12, 21, 12, tzinfo=UTC))
    assert "does not rise" in without(site=Site(latitude_deg=80.0, longitude_deg=20.0), frames=(night,))
    path = lit.session_path / "stages" / "materials" / "scene.npz"
    scene = read_scene(path)
    write_scene(path, replace(scene, outdoors=replace(scene.outdoors, sun=None)))
    assert "direction the panorama faces is unknown" in without(heading_rad=None)
    guessed = replace(lit, fetch=lambda s, n: {"outdoors": "windows"} if n == "materials" else lit.fetch(s, n))
    assert "no picture of the sky" in (no_day(guessed) or "")
    bare = replace(lit, summary=lambda _stage: {"skipped": "no staging requested", "left_out": {}})
    assert no_day(bare) == "no scene: no staging requested"
