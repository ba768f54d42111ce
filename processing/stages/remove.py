"""The stage remove: the panorama without furniture, tripod and direct sunlight (paper, section 4)."""

import math
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Flags, Floats, Halves
from processing.ground.colour import largest_channel
from processing.ground.room_model import RoomModel
from processing.ground.seam import components, grown, resized, share_of_sphere
from processing.pictures.images import LuminanceImage
from processing.pictures.writing import estimated
from processing.removal.fill import Emptied, Others, Quick, empty_room
from processing.removal.illumination import meet_rims
from processing.removal.learned import LamaFiller
from processing.removal.lift import evened, lifted
from processing.removal.shadows import relit
from processing.segmentation.evidence import SceneClass, read_evidence
from processing.sphere import Equirectangular
from processing.stages import upright
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.light import furniture_of, read_shade
from processing.stages.parameters import RemoveParameters
from processing.surfaces.maps import FIRST_WALL, FLOOR, plane_map

FOREIGN, ANYTHING, OTHER = 0.4, 0.7, 0.1
"""Probability of furniture, fixtures or equipment, and of these with walls and what is in them, from which a floor is
not filled from a place (chosen; the second by looking at eight real rooms: at .4, three floors were streaky);
by how much that of another plane's classes is more than of its own, from which a place is no part of it (chosen)."""
LEAST_GAIN = 1.02  # from which a place counts as relit, and is (chosen: what the eye sees)
CONFIDENCE_STEPS = 128  # as kept, of 0 to 1 (chosen)
LIFT_STEP = 2.0**-10  # of log luminance as kept: a thousandth, where shade is known to a tenth (chosen)
LITTLE = 0.3  # mean confidence of the filled pixels below which there is a warning (chosen)


def nothing_to_remove(context: StageContext) -> str | None:
    """Return why there is nothing to do: no target, an empty one, or no room to fill it by."""
    target = context.optional_artifact("detect", "target")
    if target is None:
        return upright.why_no_room(context, "the detect stage made no target mask; give one (--mask)")
    mask = np.asarray(target, bool)
    if not mask.any():
        return "nothing to remove"
    why = upright.why_unfit(context, asked=context.parameters_of(RemoveParameters).doubtful_room)
    if not _in_part(context):
        return why
    some, _ = _on_trusted(context, mask, upright.detected(context, "shadow", mask.shape[1]))
    return None if some.any() else f"{why}; nothing to remove touches only these"


def run(context: StageContext) -> StageOutput:
    """Fill the target plane by plane."""
    found, change, share = emptied(context)
    filled = found.provenance > 0
    if change is not None:
        _write_packed(context.folder / "lift.npz", {"log_luminance": _in_steps(change, LIFT_STEP)})
        filled |= change != 0
    assert isinstance(found.image, LuminanceImage)
    found = replace(found, image=estimated(found.image, filled, own=True))
    context.progress(0.95, "writing")
    _write_details(context.folder / "surfaces.npz", found)
    return _output(found, change, share, context)


def emptied(context: StageContext, quick: Quick | None = None) -> tuple[Emptied, Floats | None, float]:
    """Return the emptied room, the log change (H, W) of luminance where shade is lifted, and the share relit else.

    ``quick``: in place of the context's quality."""
    asked = context.parameters_of(RemoveParameters)
    image = upright.working_panorama(context)
    width_px = image.rgb.shape[1]
    target = np.asarray(context.artifact("detect", "target"), bool)
    upright.check_mask_size(target, context)
    target = upright.mask_in_size(target, width_px)
    sunlight, shadow = (upright.detected(context, name, width_px) for name in ("sunlight", "shadow"))
    if _in_part(context):
        target, shadow = _on_trusted(context, target, shadow)
    if asked.keep_sunlight and sunlight is not None:
        target, sunlight = _without_sunlight(context, target, sunlight)
    filler = None if asked.filler is None else LamaFiller(asked.filler, bgr=asked.filler_channels == "bgr")
    context.progress(0.05, "surfaces")
    shade, room = read_shade(context), upright.known_room(context)
    others, how = _others(context, room, target.shape), quick or context.quality.value
    geometry = Equirectangular(target.shape[1], target.shape[0])
    context.let_go()  # of the outdoor picture and masks that later stages read again
    if shade is not None:
        given: list[Any] = [shade._replace(shadow=shadow), target, image]
        del image, target, shade, shadow  # so that nobody holds them but what lifts, which lets them go
        found, change = lifted(
            given.pop(), given.pop(), room, given.pop(), sunlight=sunlight, others=others, quality=how, filler=filler
        )
        meet_rims(found.image.rgb, found.provenance > 0, plane_map(room, geometry))
        return found, change, 0.0
    gain = resized(relit(image.rgb, shadow, (others.no_surface(target), others.foreign), room), target.shape)
    gain[others.no_surface(target)] = 1
    bright = replace(image, rgb=image.rgb * gain)
    done = empty_room(bright, target, room, sunlight=sunlight, others=others, quality=how, filler=filler)
    even = evened(done, target, room, others, sunlight)
    even *= np.maximum(1 - math.log(LEAST_GAIN) / np.maximum(np.abs(even).max(axis=-1, keepdims=True), 1e-6), 0)
    even = np.exp(resized(even, target.shape))
    done.image.rgb[...] *= even
    gain[~target] *= even[~target]
    meet_rims(done.image.rgb, done.provenance > 0, plane_map(room, geometry))
    return done, None, share_of_sphere(largest_channel(gain) > LEAST_GAIN)


def _in_part(context: StageContext) -> bool:
    """Return whether only the part of a doubtful room is emptied that can be trusted."""
    asked = context.parameters_of(RemoveParameters)
    return asked.trusted_walls and upright.why_unfit(context, asked=asked.doubtful_room) is not None


def _on_trusted(context: StageContext, target: Flags, shadow: Flags | None) -> tuple[Flags, Flags | None]:
    """Return what of a target and of soft shadow (H, W) hangs together and touches only surfaces that can be trusted:
    a thing goes with its shadow, and whole or not at all."""
    planes = plane_map(upright.known_room(context), Equirectangular(target.shape[1], target.shape[0]))
    _, labels = components(target if shadow is None else target | shadow)
    stays = np.isin(labels, np.unique(labels[~np.isin(planes, upright.trusted_planes(context))]))
    return target & ~stays, None if shadow is None else shadow & ~stays


def _others(context: StageContext, room: RoomModel, shape: tuple[int, ...]) -> Others:
    """Return what the network takes for furniture, fixtures (rugs) or equipment, in the target or not, or on the floor
    for anything but floor (an open door's leaf), the share (h, w) of skirting, and what it sees of other planes."""
    kept = context.optional_artifact("room", "evidence")
    if kept is None:
        return Others()
    evidence = read_evidence(kept)
    things = evidence.share(SceneClass.FURNITURE, SceneClass.FIXTURE, SceneClass.TRIPOD)
    floor = plane_map(room, Equirectangular(things.shape[1], things.shape[0])) == FLOOR
    upright = evidence.share(SceneClass.WALL, SceneClass.WINDOW, SceneClass.DOOR)
    shares = ((things, FOREIGN), (floor * (things + upright), ANYTHING))
    foreign = [resized(share, (shape[0], shape[1])) > p for share, p in shares]
    plane = plane_map(room, Equirectangular(shape[1], shape[0]))
    more = resized(upright - evidence.share(SceneClass.FLOOR), (shape[0], shape[1]))
    unlike = ((plane == FLOOR) & (more > OTHER)) | ((plane >= FIRST_WALL) & (more < -OTHER))
    return Others(np.asarray(foreign[0] | foreign[1]), evidence.skirting, np.asarray(unlike))


def _without_sunlight(context: StageContext, target: Flags, sunlight: Flags) -> tuple[Flags, Flags]:
    """Return the target as it were without direct sunlight, and the sunlight with its rim.

    The target was grown over what was found; so its part around a patch of sunlight goes too, where nothing else is."""
    margin_rad = math.radians(float(context.summary("detect")["metrics"]["margin_deg"]))
    return target & grown(upright.things(context, target.shape), margin_rad) & ~sunlight, grown(sunlight, margin_rad)


def _write_details(path: Path, found: Emptied) -> None:
    """Write provenance, confidence and the filled textures: what materials and a careful user need."""
    arrays: dict[str, npt.NDArray[Any]] = {
        "provenance": found.provenance,
        "confidence": _in_steps(found.confidence, 1 / CONFIDENCE_STEPS),
    }
    for filled in found.textures:
        name = filled.texture.plane.name
        # Channels apart: they pack a tenth smaller. Halves have `ESTIMATED_BITS`, but end at 65504.
        kind = np.float16 if filled.values.max(initial=0) < np.finfo(np.float16).max else np.float32
        arrays[f"{name}_rgb"] = np.asfortranarray(filled.values, kind)
        arrays[f"{name}_hole"] = filled.hole
        arrays[f"{name}_px_per_m"] = np.array(filled.texture.px_per_m)
    _write_packed(path, arrays)


def _in_steps(values: Floats, step: float) -> Halves:
    """Return values (H, W) rounded to whole steps, a power of two."""
    whole = np.divide(values, step, dtype=np.float32)
    np.round(whole, out=whole)
    return np.multiply(whole, step, out=whole).astype(np.float16)


def _write_packed(path: Path, arrays: dict[str, npt.NDArray[Any]]) -> None:
    # As NumPy packs them, but by the fastest level: a sixth of the time for a few percent more bytes.
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        for name, values in arrays.items():
            with packed.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asanyarray(values), allow_pickle=False)


def _output(found: Emptied, change: Floats | None, relit_share: float, context: StageContext) -> StageOutput:
    filled = found.provenance > 0
    sure = float(found.confidence[filled].mean()) if filled.any() else 1.0
    warnings = []
    if sure < LITTLE:
        text = f"mean confidence of the fill is {sure:.2f}: too little of the surfaces is visible"
        warnings.append(StageWarning(code="confidence", message=text))
    warnings += [StageWarning(code="hidden", message=note) for note in found.notes if "hidden altogether" in note]
    left_out = {} if change is not None else {"lift": context.summary("light").get("skipped") or "shading is kept"}
    if _in_part(context):
        left_out[upright.UNTRUSTED] = f"only {upright.trusted_parts(context)} of the room's shape can be trusted"
    finest = max((one.hole.size for one in found.textures), default=0)
    changed = np.zeros(0) if change is None else change[change != 0]
    brighter_pct = round(100 * math.expm1(float(np.median(changed))), 2) if len(changed) else 0.0
    return StageOutput(
        artifacts={"empty": found.image, "filled": filled, "surfaces": True, "lift": None if change is None else True},
        metrics={
            "filled_share": round(float(filled.mean()), 5),
            "furniture": bool((upright.mask_in_size(furniture_of(context), filled.shape[1]) & filled).any()),
            "relit_share": round(relit_share, 5),
            "synthesised_share": round(float((found.provenance == 2).mean()), 5),
            "mean_confidence": round(sure, 4),
            "notes": list(found.notes),
            **({} if change is None else {"lifted_median_pct": brighter_pct}),
        },
        warnings=tuple(warnings),
        left_out=left_out,
        honoured={"quality": f"textures of up to {finest} pixels ({context.quality.value})"},
    )
