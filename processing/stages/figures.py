"""The stage figures: illuminance, glare and luminance statistics at the camera, from the calibrated pictures."""

from functools import partial
from typing import Any

from processing.figures.figures import (
    WIDTH_PX,
    camera_figures,
    level_ratio,
    meter_figures,
    outdoor_figures,
    reduced,
    surface_figures,
)
from processing.ground.room_model import RoomModel
from processing.ground.threads import together
from processing.stages.contract import StageContext, StageOutput
from processing.stages.upright import upright_panorama


def run(context: StageContext) -> StageOutput:
    """Write light_figures.json (docs/reference/light-figures.md)."""
    image = upright_panorama(context)
    facts = context.artifact("calibrate", "calibration")
    room: RoomModel | None = context.optional_artifact("room", "room")
    left_out = {} if room else {"surfaces": "the room is unknown: statistics are for the whole picture only"}
    context.progress(0.0, "light at the camera")
    small = reduced(image, WIDTH_PX)
    height_m = room.camera_height_m if room else context.session.camera_height_m
    camera, outdoor = together(
        partial(camera_figures, small, height_m=height_m, heading_rad=context.session.heading_rad),
        partial(outdoor_figures, context.optional_artifact("calibrate", "outdoor"), facts),
    )
    context.progress(0.7, "surfaces")
    readings = [r.luminance_cd_m2 for r in context.session.readings if r.luminance_cd_m2 is not None]
    figures: dict[str, Any] = {
        "version": 2,
        "absolute": image.absolute,
        "units": {"luminance": image.unit, "illuminance": "lx" if image.absolute else image.unit},
        "camera": camera,
        "outdoor": outdoor,
        "level_ratio": level_ratio(camera, outdoor),
        "meter": meter_figures(context.artifact("calibrate", "indoor"), facts["indoor"], readings),
        "surfaces": surface_figures(small, room),
    }
    if not image.absolute:
        left_out["glare"] = "the picture has no absolute scale, which glare needs"
    if outdoor is None:
        left_out["outdoor"] = "no outdoor picture in cd/m2"
    return StageOutput(artifacts={"light_figures": figures}, metrics=_metrics(figures), left_out=left_out)


def _metrics(figures: dict[str, Any]) -> dict[str, Any]:
    camera = figures["camera"]
    brightest = camera["directions"][camera["brightest"]]
    ratio = figures["level_ratio"]
    glare = [look["glare"]["dgp"]["value"] for look in camera["directions"] if "glare" in look]
    return {
        "level_up": camera["level_up"] and camera["level_up"]["value"],
        "brightest_vertical": brightest["vertical"]["value"],
        "highest_dgp": max(glare) if glare else None,
        "level_ratio": ratio and ratio["value"],
    }
