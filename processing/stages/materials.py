"""The stage materials: what the emptied room's surfaces reflect, and the room as a scene under its light."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.errors import SceneError
from processing.ground.room_model import RoomModel
from processing.light.scene.albedo import RoomAlbedo, albedo_of_room
from processing.light.scene.facing import facing_sunlight, outdoors_facing
from processing.light.scene.outdoor import outdoors_of
from processing.light.scene.scene import Outdoors, Surface
from processing.light.scene.scene_file import write_scene
from processing.light.scene.shell import REVEAL_M
from processing.light.solver.irradiance import Effort
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import MaterialsParameters
from processing.stages.upright import known_room, upright_panorama

ROWS = {"draft": 256, "standard": 512, "reference": 1024}
"""Height of the albedo picture."""
EFFORT = Effort(pixel_samples=32)
SUN_RIM_RAD, FURNITURE_RIM_RAD = math.radians(1.5), math.radians(0.8)
"""By which sunlight stands again beyond its mask, and keeps away from what stood there."""
HEADING_ADVICE = "(heading_deg in the rig file, --heading of daylit import)"
MOST_LAMPS = 100
"""That are listed one by one; the light of all is in the scene."""


def nothing_to_stage(context: StageContext) -> str | None:
    """Return why there is nothing to do: no staging asked, or no room."""
    asked = context.parameters_of(MaterialsParameters)
    if not asked.wanted:
        return "staging not asked"
    if context.optional_artifact("room", "room") is None:
        return "the stage room found no room; give one (--room)"
    return None


def run(context: StageContext) -> StageOutput:
    """Estimate albedo, windows and lamps."""
    asked = context.parameters_of(MaterialsParameters)
    empty = emptied(context)
    image = empty.image
    room = known_room(context)
    context.progress(0.0, "the light outdoors")
    outdoors, source, warnings = _outdoors(context, image, room)
    context.progress(0.1, "albedo")
    rows = min(ROWS[context.quality.value], image.rgb.shape[0])
    found = albedo_of_room(
        image,
        room,
        outdoors,
        reveal_m=REVEAL_M if asked.reveal_m is None else asked.reveal_m,
        filled=empty.filled,
        rows=rows,
        effort=EFFORT,
    )
    context.progress(0.95, "writing")
    write_scene(context.folder / "scene.npz", found.scene)
    return StageOutput(
        artifacts={"materials": _facts(found, source, absolute=image.absolute), "scene": True},
        metrics={
            "told_share": round(float(found.told.mean()), 4),
            "floor_gloss": round(found.gloss, 3),
            "outdoors": source,
            "lamps": len(found.lamps),
            "units": "cd/m2" if image.absolute else "relative units",
            "notes": list(found.notes),
        },
        warnings=tuple(StageWarning(code="materials", message=text[:500]) for text in warnings),
        honoured={"quality": f"albedo of {2 * rows} x {rows} directions"},
    )


@dataclass(frozen=True)
class EmptyRoom:
    """The panorama without furniture, its own sunlight in its place."""

    image: LuminanceImage
    filled: npt.NDArray[np.bool_] | None
    """(H, W): what removal made up; None where nothing was removed."""
    sunless: npt.NDArray[np.bool_] | None
    """(H, W): what is shown without the direct sun that may fall there."""


def emptied(context: StageContext) -> EmptyRoom:
    """Return the emptied panorama; direct sunlight that removal took away stands again where nothing hid it.

    The sun's patch lights the room, and furniture is put into the room as it was photographed.
    """
    image = context.optional_artifact("remove", "empty")
    if image is None:
        return EmptyRoom(upright_panorama(context), None, None)
    assert isinstance(image, LuminanceImage)
    filled = np.asarray(context.artifact("remove", "filled"), bool)
    before = upright_panorama(context)
    mask = context.optional_artifact("detect", "sunlight")
    if mask is None or np.shape(mask) != filled.shape:
        return EmptyRoom(image, filled, filled)
    masks = [context.optional_artifact("detect", name) for name in ("furniture", "tripod", "shadow")]
    hidden = np.any([np.asarray(one, bool) for one in masks if one is not None] or [~filled & filled], axis=0)
    # What was filled reaches over the masks' edges: half shadow beside the sun, rims of furniture.
    back = _grown(np.asarray(mask, bool), SUN_RIM_RAD) & ~_grown(hidden, FURNITURE_RIM_RAD)
    image = replace(
        image,
        rgb=np.where(back[..., None], before.rgb, image.rgb),
        validity=np.where(back, before.validity, image.validity),
        uncertainty=np.where(back, before.uncertainty, image.uncertainty),
    )
    return EmptyRoom(image, filled & ~back, filled & ~back)


def _grown(mask: npt.NDArray[np.bool_], by_rad: float) -> npt.NDArray[np.bool_]:
    """Return a mask of a panorama grown on all sides; columns wrap."""
    radius = round(by_rad / math.pi * mask.shape[0])
    if radius == 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    wide = np.pad(mask.astype(np.uint8), ((0, 0), (radius, radius)), mode="wrap")
    return np.asarray(cv2.dilate(wide, disc)[:, radius:-radius] > 0)


def _outdoors(context: StageContext, image: LuminanceImage, room: RoomModel) -> tuple[Outdoors | None, str, list[str]]:
    """Return the light outside, what it was taken from, and warnings."""
    inside = "windows as seen from inside"
    picture = context.optional_artifact("calibrate", "outdoor")
    if picture is None:
        why = context.summary("calibrate")["left_out"].get("outdoor", "the session has no outdoor picture")
        text = f"the windows light as they look from inside, without direct sun: {why}"
        return None, inside, [text]
    try:
        found = outdoors_of(picture)
    except SceneError as error:
        return None, inside, [f"the windows light as they look from inside: {str(error).split(' | ')[0]}"]
    if context.session.heading_rad is not None:
        return found, "outdoor picture", []
    facing, how = _without_heading(found, image, room, _sun_seen(context))
    return facing, "outdoor picture", [f"the panorama's heading is not recorded: {how} {HEADING_ADVICE}"]


def _sun_seen(context: StageContext) -> tuple[float, float] | None:
    """Return azimuth and elevation (rad) of the sun as its light in the room shows it; None where it does not."""
    metrics = context.summary("detect")["metrics"]
    if "sun_azimuth_deg" not in metrics:
        return None
    return math.radians(metrics["sun_azimuth_deg"]), math.radians(metrics["sun_elevation_deg"])


def _without_heading(
    found: Outdoors, image: LuminanceImage, room: RoomModel, seen: tuple[float, float] | None
) -> tuple[Outdoors, str]:
    """Return the light outdoors as it is likely to stand before the windows, and what that rests on."""
    facing, turn = outdoors_facing(found, image, room)
    if turn is not None:
        return facing, (
            f"the outdoor picture is turned by {math.degrees(turn[0]):.0f} degrees, as the windows show it "
            f"(likeness {turn[1]:.2f})"
        )
    facing, by = facing_sunlight(found, seen)
    if by is not None:
        return facing, (
            f"the outdoor picture is turned by {math.degrees(by):.0f} degrees, so that its sun stands where the "
            "sunlight in the room comes from"
        )
    if found.sun is None:
        return facing, "the sky may stand before the wrong windows"
    height = math.degrees(math.asin(min(max(found.sun.direction[2], -1.0), 1.0)))
    why = "no sunlight in the room shows where it stands"
    if seen is not None:
        why = f"it is {height:.0f} degrees high, the sunlight in the room comes from {math.degrees(seen[1]):.0f}"
    return facing, f"the sun outdoors is left out ({why}), and the sky may stand before the wrong windows"


def _facts(found: RoomAlbedo, source: str, *, absolute: bool) -> dict[str, Any]:
    weights = np.asarray(LUMINANCE_WEIGHTS)
    return {
        "schema_version": 1,
        "outdoors": source,
        "surfaces": [_surface(s, weights) for s in found.scene.surfaces],
        "windows": [
            {
                "opening": pane.opening,
                "transmittance": [round(float(v), 4) for v in pane.transmittance],
                "covered_share": round(float(1 - pane.clear.mean()), 4),
            }
            for pane in found.scene.panes
        ],
        "lamps": [
            {
                "surface": found.scene.surfaces[lamp.label].name,
                "luminance_cd_m2": round(lamp.luminance_cd_m2, 1),
                "solid_angle_sr": float(f"{lamp.solid_angle_sr:.3g}"),
                "towards": [round(v, 4) for v in lamp.towards],
            }
            for lamp in found.lamps[:MOST_LAMPS]
        ],
        "floor_gloss": round(found.gloss, 3),
        "units": "cd/m2" if absolute else "relative units",
        "uncertainty": round(float(np.median(found.uncertainty[found.told])), 4) if found.told.any() else 1.0,
        "notes": list(found.notes),
    }


def _surface(surface: Surface, weights: npt.NDArray[np.float64]) -> dict[str, Any]:
    mean = surface.albedo.mean(axis=(0, 1), dtype=np.float64)
    return {
        "name": surface.name,
        "albedo_rgb": [round(float(v), 4) for v in mean],
        "albedo": round(float(mean @ weights), 4),
    }
