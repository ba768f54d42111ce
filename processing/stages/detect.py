"""The stage detect: furniture, tripod, direct sunlight and shadows as masks, and the target (paper, section 4)."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from processing.ground.arrays import Flags
from processing.ground.seam import share_of_sphere
from processing.pictures.images import LuminanceImage
from processing.pictures.preview import read_mask
from processing.removal.masks import Masks, find_masks
from processing.removal.rests import on_ceiling
from processing.segmentation.embedded import scene_evidence
from processing.segmentation.evidence import SceneEvidence, read_evidence
from processing.stages import upright
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import DetectParameters

MASKS = ("furniture", "tripod", "sunlight", "shadow")
CALIBRATION = ("calibrate", "calibration")
LAYERS = ("mask_add", "mask_keep", "mask_sunlight")  # parameters: what a user draws over the masks
MUCH = 0.5  # share of the sphere from which a target is worth a warning (chosen)


def nothing_to_go_by(context: StageContext) -> str | None:
    """Return why no masks can be found: no room."""
    if context.optional_artifact("room", "room") is not None:
        return None
    return upright.why_no_room(context, f"{upright.NO_ROOM}, or a mask (--mask)")


def run(context: StageContext) -> StageOutput:
    """Find the masks on the upright panorama, with the room and the sun's place as far as they are known."""
    asked = context.parameters_of(DetectParameters)
    image = upright.upright_panorama(context)
    room = upright.known_room(context)
    context.progress(0.0, "segmentation")
    kept = context.optional_artifact("room", "evidence")  # none: of a given room in a picture that shows none
    evidence = scene_evidence(image, quality=context.quality.value) if kept is None else read_evidence(kept)
    context.progress(0.4, "masks")
    sun, shone = upright.sun_direction(context.session), upright.sky_shows_sun(context.optional_artifact(*CALIBRATION))
    possible, why = _sun_possible(shone, sun, asked)
    found = find_masks(
        image,
        evidence,
        room,
        sun_direction=sun if possible else None,
        sun_possible=possible,
        sun_seen=shone is True,
        meter_target=_meter_target(context, image),
        margin_rad=math.radians(asked.margin_deg),
    )
    made = _output(_corrected(found, asked, context), evidence, why, asked.margin_deg)
    return replace(made, metrics={**made.metrics, "on_ceiling": on_ceiling(room, image.rgb)})


def _corrected(found: Masks, asked: DetectParameters, context: StageContext) -> Masks:
    given = [getattr(asked, name) for name in LAYERS]
    layers = [np.False_ if path is None else _drawn(path, context) for path in given]
    masks: dict[str, Any] = {name: drawn_over(name, getattr(found, name), layers) for name in (*MASKS, "target")}
    return replace(found, **masks, shares={name: share_of_sphere(mask) for name, mask in masks.items()})


def drawn_over(name: str, mask: Flags, layers: Sequence[Flags | np.bool]) -> Flags:
    """Return a mask (H, W) with the `LAYERS` over it: what goes as well, what stays, what is direct sunlight."""
    add, keep, sun = layers
    changed = {"target": mask | add | sun, "sunlight": mask & ~add | sun, "furniture": (mask | add) & ~sun}
    return np.asarray(changed.get(name, mask & ~sun) & ~keep)


def _drawn(path: Path, context: StageContext) -> Flags:
    mask = read_mask(path)
    upright.check_mask_size(mask, context)
    return mask


def _meter_target(context: StageContext, image: LuminanceImage) -> tuple[float, float] | None:
    """Return where the meter looked in the upright panorama (rad); None where that is not known."""
    facts: dict[str, Any] = context.artifact(*CALIBRATION)
    target = facts.get("indoor", {}).get("target") or {}
    if "longitude_deg" not in target:
        return None
    longitude, latitude = (math.radians(target[f"{name}_deg"]) for name in ("longitude", "latitude"))
    rotation = image.attributes.get("level_rotation")
    if rotation is None:
        return longitude, latitude
    level = math.cos(latitude)
    x, y, z = np.asarray(rotation) @ (level * math.sin(longitude), level * math.cos(longitude), math.sin(latitude))
    return math.atan2(x, y), math.atan2(z, math.hypot(x, y))


def _sun_possible(shone: bool | None, sun: tuple[float, float] | None, asked: DetectParameters) -> tuple[bool, str]:
    """Return whether direct sun is to be looked for, and why not."""
    if asked.sunlight == "off":
        return False, "detection switched off"
    if sun is not None and sun[1] <= 0:
        return False, "the sun was below the horizon"
    if shone is False:
        return False, "the outdoor picture shows no sun"
    return True, ""


def _output(found: Masks, evidence: SceneEvidence, why_no_sun: str, margin_deg: float) -> StageOutput:
    masks = {name: getattr(found, name) for name in MASKS}
    left_out = {name: "nothing found" for name, mask in masks.items() if not mask.any()}
    if why_no_sun and "sunlight" in left_out:
        left_out["sunlight"] = why_no_sun
    warnings = []
    if found.shares["target"] > MUCH:
        text = f"{found.shares['target']:.0%} of all directions are to be removed: check the masks"
        warnings.append(StageWarning(code="target", message=text))
    metrics: dict[str, Any] = {
        "evidence": evidence.source,
        "margin_deg": margin_deg,
        "views_used": evidence.views_used,
        "views_skipped": evidence.views_skipped,
        "shares": {name: round(share, 5) for name, share in found.shares.items()},
        "notes": [*evidence.notes, *found.notes],
    }
    if found.sun is not None:
        metrics["sun_azimuth_deg"], metrics["sun_elevation_deg"] = (round(math.degrees(a), 2) for a in found.sun[:2])
        metrics["sun_times"] = round(found.sun[2], 2)
    return StageOutput(
        artifacts={name: mask for name, mask in masks.items() if name not in left_out} | {"target": found.target},
        metrics=metrics,
        warnings=tuple(warnings),
        left_out=left_out,
        honoured={"quality": f"segmented by the {evidence.source}"},
    )
