"""The stage light: what old furniture takes from the room's light, and what that is without it."""

import math
from functools import partial

import numpy as np

from processing.errors import SceneError
from processing.ground.arrays import Flags, Floats, Vector
from processing.ground.room_model import OpeningKind, RoomModel
from processing.ground.seam import share_of_sphere
from processing.ground.threads import together
from processing.light.scene.facing import facing_without_heading
from processing.light.scene.furnished import FurnishedLight, OldFurniture, furnished_light
from processing.light.scene.outdoor import outdoors_of
from processing.light.scene.scene import Outdoors
from processing.light.scene.scene_file import write_scene
from processing.light.scene.standins import standins_of
from processing.light.solver.irradiance import Effort
from processing.pictures.images import LuminanceImage
from processing.removal.lift import Shade
from processing.segmentation.evidence import read_evidence
from processing.stages.contract import Quality, StageContext, StageOutput, StageWarning
from processing.stages.parameters import LightParameters
from processing.stages.upright import check_mask_size, known_room, upright_panorama, why_no_room, why_unfit
from processing.surfaces.sun import sun_vector

LEAST_SHARE = 0.005  # of the sphere: furniture below it takes less than the light's own error from the room; chosen
UNKNOWN_LX = 1e-5  # chosen: ten times what is written for a place of unknown light
HEADING_ADVICE = "(heading_deg in the rig file, --heading of daylit import)"
EFFORT = partial(Effort, 0.15, sun_samples=32, cleaning="fast")
WORK = {
    Quality.DRAFT: (256, EFFORT(rows=96, patch_samples=48, pixel_samples=32)),
    Quality.STANDARD: (256, EFFORT(rows=128, patch_samples=64, pixel_samples=48)),
    Quality.REFERENCE: (512, EFFORT(rows=256, patch_samples=256, pixel_samples=128)),
}
"""Rows of what is kept, and the work: the same chance with and without furniture leaves 1 % of noise in the ratio at 48
rays, and light is smooth."""
AGAIN = Effort(0.4, patch_samples=48, rows=24, pixel_samples=8, sun_samples=4, clean=False)
"""Of a second estimate, without sun and sky, by windows as they look from inside, in 64 rows (level within 0.02 of that
of `WORK` in seven rooms, median): how much of both furniture holds back is what is estimated worst."""


def nothing_to_lift(context: StageContext) -> str | None:
    """Return why there is nothing to do: not asked, nothing to remove, no room, or no light known in it."""
    asked = context.parameters_of(LightParameters)
    if asked.shade == "keep":
        return "the furniture's shading is kept (--shade keep)"
    target = context.optional_artifact("detect", "target")
    if target is None or not np.asarray(target).any():
        return "nothing to remove"
    room = context.optional_artifact("room", "room")
    if room is None:
        return why_no_room(context)
    if share_of_sphere(furniture_of(context)) < LEAST_SHARE:
        return f"furniture covers less than {100 * LEAST_SHARE:.1f} % of the picture: its shading is negligible"
    if not any(opening.kind is OpeningKind.WINDOW for opening in room.openings):
        return "no window is known, so the room's light cannot be estimated"
    return why_unfit(context, asked=asked.doubtful_room)


def run(context: StageContext) -> StageOutput:
    """Estimate the light with and without the furniture."""
    image, room = upright_panorama(context), known_room(context)
    target = np.asarray(context.artifact("detect", "target"), bool)
    check_mask_size(target, context)
    context.progress(0.0, "outdoor light and stand-ins for the furniture")
    (most_rows, effort), furniture, reach_m = WORK[context.quality], furniture_of(context), _reach_m(context, room)
    (outdoors, source, warnings), parts = together(
        partial(light_outdoors, context, image, room), partial(standins_of, room, furniture, reach_m)
    )
    sunlight = context.optional_artifact("detect", "sunlight")
    if sunlight is not None:
        # What the sun falls on is to go, but gives light to the room as it is seen.
        target = target & (furniture | ~np.asarray(sunlight, bool))
    context.progress(0.3, "light with and without furniture")
    rows = min(most_rows, image.rgb.shape[0])
    old, sun = OldFurniture(furniture, target, parts), _sun_by_patches(context) if outdoors is None else None
    again = furnished_light(image, room, None, old, rows=min(64, rows), effort=AGAIN) if outdoors is not None else None
    both = furnished_light(image, room, outdoors, old, rows=rows, effort=effort, known_sun=sun).believed(again)
    _write(context, both)
    return _output(both, source, warnings)


def _reach_m(context: StageContext, room: RoomModel) -> Floats | None:
    """Return the distance of what is seen (H, W), m, as the room network estimates it; None without its evidence."""
    kept = context.optional_artifact("room", "evidence")
    reach = None if kept is None else read_evidence(kept).reach
    return None if reach is None else reach * np.float32(room.camera_height_m)


def _sun_by_patches(context: StageContext) -> tuple[Vector, float] | None:
    """Return the unit vector towards the sun whose patches the room shows, and how strong they say that it is."""
    metrics = context.summary("detect")["metrics"]
    x, y, z = sun_vector(*(math.radians(metrics.get(f"sun_{name}_deg", 0)) for name in ("azimuth", "elevation")))
    return ((float(x), float(y), float(z)), metrics["sun_times"]) if metrics.get("sun_times") else None


def furniture_of(context: StageContext) -> Flags:
    """Return what is furniture (H, W): the mask of it, or all of a given target."""
    furniture = context.optional_artifact("detect", "furniture")
    if furniture is not None:
        return np.asarray(furniture, bool)
    target = np.asarray(context.artifact("detect", "target"), bool)
    # Where none was found there is none: the rest of that target is the rim of equipment and of sunlight.
    return target & ("target" in context.summary("detect").get("given", ()))


def _write(context: StageContext, found: FurnishedLight) -> None:
    """Write shade.npz, what removal needs, in half precision, and scene.npz, the bare room under its light."""
    with (context.folder / "shade.npz").open("wb") as file:
        np.savez_compressed(
            file,
            log_change=found.log_change.astype(np.float16),
            log_without_lx=np.log(np.maximum(found.without_lx, 1e-6)).astype(np.float16),
            seen=found.seen,
            standin_m=found.standin_m.astype(np.float16),
            returned=found.returned,
            doubt=found.doubt,
        )
    write_scene(context.folder / "scene.npz", found.scene)


def read_shade(context: StageContext) -> Shade | None:
    """Return what the stage light made for removal; None where it was skipped."""
    path = context.optional_artifact("light", "shade")
    if path is None:
        return None
    with np.load(path) as kept:
        light = np.exp(kept["log_without_lx"].astype(np.float32))
        # 1e-6 lx stands for a place whose light is unknown.
        light = np.where(light.max(axis=-1, keepdims=True) > UNKNOWN_LX, light, np.float32(0))
        change, doubt = kept["log_change"].astype(np.float32), float(kept["doubt"])
        return Shade(change, light, kept["seen"], kept["returned"], doubt=doubt)


def _output(found: FurnishedLight, source: str, warnings: list[str]) -> StageOutput:
    change = found.log_change.mean(axis=-1)[found.seen]
    low, middle, high = np.exp(np.quantile(change, (0.05, 0.5, 0.95))) if len(change) else (1.0, 1.0, 1.0)
    return StageOutput(
        artifacts={"shade": True, "scene": True},
        metrics={
            "standins": len(found.parts),
            "outdoors": source,
            "brighter_median": round(float(middle), 4),
            "brighter_p5": round(float(low), 4),
            "brighter_p95": round(float(high), 4),
            "notes": list(found.notes),
        },
        warnings=tuple(StageWarning(code="light", message=text[:500]) for text in warnings),
        honoured={"quality": f"light in {2 * found.seen.shape[0]} x {found.seen.shape[0]} directions"},
    )


def light_outdoors(
    context: StageContext, image: LuminanceImage, room: RoomModel
) -> tuple[Outdoors | None, str, list[str]]:
    """Return the light outside, with which light and materials begin, what it was taken from, and warnings."""
    inside = "windows as they appear from inside"
    picture = context.optional_artifact("calibrate", "outdoor")
    if picture is None:
        why = context.summary("calibrate")["left_out"].get("outdoor", "the session has no outdoor picture")
        return None, inside, [f"window light is taken as it appears from inside, without direct sun: {why}"]
    try:
        found = outdoors_of(picture)
    except SceneError as error:
        return None, inside, [f"window light is taken as it appears from inside: {str(error).split(' | ')[0]}"]
    if context.session.heading_rad is not None:
        return found, "outdoor picture", []
    metrics, sun = context.summary("detect")["metrics"], None
    if "sun_azimuth_deg" in metrics:  # its light in the room shows where it stands
        sun = math.radians(metrics["sun_azimuth_deg"]), math.radians(metrics["sun_elevation_deg"])
    facing, how = facing_without_heading(found, image, room, sun)
    return facing, "outdoor picture", [f"the panorama's heading is not recorded: {how} {HEADING_ADVICE}"]
