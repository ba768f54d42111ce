"""The stage day: the first still's frame through the hours of the day of capture, which the pages have under a slider.

What `daylit relight --sweep day` makes of a whole panorama, for one frame: rays of a draft's effort, stored once, give
the light of each hour; the detail is that of the picture itself (`relight_photo`).
"""

import math
from datetime import datetime, timedelta

import cv2
import numpy as np

from processing.errors import DaylightError, RelightError
from processing.exchange.jpeg_files import Made, removed_by, write_jpeg
from processing.exchange.showing import panes_of
from processing.light.picture.relight_photo import photograph_under
from processing.light.scene.scene_file import read_scene
from processing.light.solver.basis import BASIS_EFFORTS, basis_of
from processing.light.solver.relight import RelightView
from processing.light.solver.stage import Stage
from processing.pictures.display import Display
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage
from processing.relighting.live import Outside
from processing.relighting.relit_session import MEASURED, SessionRoom, check_sky, display_of_day, furnished
from processing.relighting.weather import day_times
from processing.report.frames import Frame
from processing.report.states import Look, shown
from processing.sphere import Equirectangular
from processing.stages.contract import Quality, StageContext, StageOutput
from processing.stages.parameters import NO_SUCH, DayParameters
from processing.stages.render import why_none
from processing.stages.upright import known_room

WIDE_PX = 800  # chosen: more than the page shows; sixteen hours in 2 MB
MOST_HOURS = 24  # as the stage's row has them
EFFORT = BASIS_EFFORTS["draft"]


def no_day(context: StageContext) -> str | None:
    """Return why there is nothing to do: a draft, no scene or still; light outdoors, time, place or heading unknown."""
    if context.quality is Quality.DRAFT:
        return "a draft has no day: process with --quality standard"
    for stage, name in (("materials", "scene"), ("stills", "still-1")):
        if not context.has(stage, name):
            return f"no {name}: {why_none(context, stage, name)}"
    if not any(one.taken_utc for one in context.session.frames):
        return "the frames do not say when they were taken"
    try:
        _hours(context)
    except (DaylightError, RelightError) as error:
        return f"{error.message}; {error.advice}"
    return None


def _hours(context: StageContext) -> tuple[SessionRoom, Outside, list[datetime]]:
    """Return the empty room with the still's light: its whole level view, in its own size; and the day's hours."""
    measured = context.artifact("materials", "materials").get("outdoors", MEASURED) == MEASURED
    scene, light = read_scene(context.artifact("materials", "scene")), context.artifact("stills", "still-1-light")
    image, eye_m = read_exr(light), (0.0, 0.0, known_room(context).camera_height_m)
    assert isinstance(image, LuminanceImage)  # as the stage stills writes it
    room = SessionRoom(context.session, scene, image, eye_m, None, measured)
    check_sky(room)
    outside = Outside.of(room, "captured", dict.fromkeys(("site", "heading", "zone")))
    return room, outside, day_times(room.time_utc, outside.place, outside.zone, timedelta(hours=1))


def run(context: StageContext) -> StageOutput:
    """Write a JPEG an hour, in one exposure, and day.json: when each is, with the light outdoors."""
    room, outside, times = _hours(context)
    still, asked = context.artifact("stills", "stills")["stills"][0], context.parameters_of(DayParameters)
    frame = Frame(math.radians(still["yaw_deg"]), still["lens_mm"], still["drop"])
    view, rows = frame.view(WIDE_PX), frame.height_px(WIDE_PX)
    scene, lights = room.scene, [outside.at(time_utc) for time_utc in times]
    if still["state"].startswith("staged"):
        index = int(still["state"].removeprefix("staged-")) - 1
        one, made = context.artifact("arrange", "arrangement"), context.artifact("render", "staged")
        scene = furnished(scene, one.arrangements[index], made["alternatives"][index], asked.furniture)
    cut = np.asarray(cv2.resize(room.picture.rgb, (view.width_px, view.height_px)), np.float32)
    stage = Stage.of(scene, EFFORT.texel_m)
    ready = RelightView(stage, basis_of(stage, room.eye_m, effort=EFFORT), view)
    before = ready.relit(scene.outdoors)
    lit = [photograph_under(cut, ready, before, outdoors)[0].rgb[-rows:] for outdoors, _ in lights]
    display = Display.read(context.artifact("stills", "display"))
    panes = panes_of(known_room(context), Equirectangular(4 * WIDE_PX, 2 * WIDE_PX), display.views)
    look = Look(display_of_day(display, lit), panes)
    original = asked.original_url or f"../stills/{still['original']}"
    what = Made.of(still["state"], removed=removed_by(context.summary("remove")), further="relit", original=original)
    for number, (rgb, (_, facts)) in enumerate(zip(lit, lights, strict=True), 1):
        rgb8 = shown(rgb, look, view)
        title = f"{context.session.name}, {facts['local_time']}"
        path = context.folder / f"hour-{number}.jpg"
        write_jpeg(path, rgb8 if asked.no_staged_label else what.on(rgb8, panorama=False), made=what, title=title)
    names = [f"hour-{number}" for number in range(1, MOST_HOURS + 1)]
    found = {"schema_version": 1, "state": still["state"], "hours": [facts for _, facts in lights]}
    artifacts = {"day": found, **dict.fromkeys(names[: len(lit)], True)}
    return StageOutput(artifacts, {"hours": len(lit)}, left_out=dict.fromkeys(names[len(lit) :], NO_SUCH))
