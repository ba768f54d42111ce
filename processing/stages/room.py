"""The stage room: the upright panorama, what its pixels show, and the room's shape with its windows and doors."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from processing.errors import NoRoomError
from processing.ground.room_model import RoomModel, read_room
from processing.ground.seam import resized
from processing.pictures.images import LuminanceImage
from processing.pictures.preview import preview_rgb8
from processing.removal.furniture import with_seen_floor
from processing.removal.masks import WORKING_ROWS
from processing.room.confidence import check_picture
from processing.room.estimate import RoomEstimate, estimate_room
from processing.room.layout_networks import layout_boundary, load_layout_network
from processing.room.level import Upright, find_upright, make_upright
from processing.room.opening_sun import find_openings_in_sun
from processing.segmentation.around import fused, segment_around
from processing.segmentation.embedded import scene_evidence
from processing.segmentation.evidence import SceneEvidence, write_evidence
from processing.segmentation.installed import open_installed, segmenter_file
from processing.segmentation.segmenters import open_segmenter
from processing.sphere import Fisheye
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.parameters import RoomParameters
from processing.stages.upright import sky_shows_sun, sun_direction

EVIDENCE_FILE = "evidence.npz"
LEAST_SQUARE = 0.3  # support of the walls' azimuth below which it is taken from the boundaries instead


@dataclass
class _Gathered:
    artifacts: dict[str, object] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)


def fisheye_at_the_eye(context: StageContext) -> str | None:
    """Return why no room is looked for: a fisheye at the eye sees a half of it."""
    image = context.optional_artifact("calibrate", "indoor")
    looks = image is not None and isinstance(image.geometry, Fisheye)
    return "a fisheye at the eye shows no whole room: its light is measured, and no more" if looks else None


def run(context: StageContext) -> StageOutput:
    """Level the panorama, run the network, and estimate the room; a given room (--room) is only checked.

    A picture that shows no room is no failure of the session: the room is left out with the reason.
    """
    asked = context.parameters_of(RoomParameters)
    given = None if asked.room is None else read_room(asked.room)
    image: LuminanceImage = context.artifact("calibrate", "indoor")
    gathered = _Gathered()
    try:
        check_picture(image)
        context.progress(0.0, "levelling")
        upright, turned = _levelled(image, asked, gathered)
        context.progress(0.3, "what the pixels show")
        evidence = _evidence(context, upright, turned, asked.layout_model)
        context.progress(0.4, "furniture and windows by another network")
        seen = _seen(evidence, upright, asked)
        write_evidence(context.folder / EVIDENCE_FILE, seen)
        gathered.artifacts["evidence"] = True
        context.progress(0.6, "the room")
        _estimate(context, upright, (evidence, seen), (given, turned), gathered)
    except NoRoomError as error:
        _refused(error, given, gathered)
    return StageOutput(
        artifacts=gathered.artifacts,
        metrics=gathered.metrics,
        warnings=tuple(StageWarning(code="room", message=text[:500]) for text in gathered.warnings),
        left_out=gathered.left_out,
        honoured={"quality": context.quality.value},
    )


def _levelled(image: LuminanceImage, asked: RoomParameters, gathered: _Gathered) -> tuple[LuminanceImage, Upright]:
    found = find_upright(image, turn=asked.level == "auto")
    gathered.metrics |= {
        "tilt_deg": round(math.degrees(found.tilt_rad), 3),
        "tilt_sigma_deg": round(math.degrees(found.sigma_rad), 3) if math.isfinite(found.sigma_rad) else None,
        "walls_azimuth_deg": round(math.degrees(found.manhattan_rad), 2),
        "walls_square": round(found.manhattan_support, 3),
    }
    upright = make_upright(image, found.rotation)
    if upright is image:
        gathered.left_out["panorama"] = f"the calibrated picture is used unchanged: {found.note}"
    else:
        gathered.artifacts["panorama"] = upright
    return upright, found


def _evidence(context: StageContext, image: LuminanceImage, turned: Upright, model: Path | None) -> SceneEvidence:
    evidence = scene_evidence(image, quality=context.quality.value)
    if model is None:
        return evidence
    network = load_layout_network(model)
    boundary = layout_boundary(image, network, turn_rad=turned.manhattan_rad)
    return replace(evidence, boundary=boundary, source=f"{evidence.source}; boundaries: {network.kind} {network.name}")


def _seen(own: SceneEvidence, image: LuminanceImage, asked: RoomParameters) -> SceneEvidence:
    """Return our evidence fused with the installed model's, or a user's network's in its place; or alone, with the
    floor that it hardly sees."""
    network, contract = segmenter_file(asked.segmenter), asked.segmenter_contract
    if network is None:
        if own.boundary is None:
            return own
        shown = preview_rgb8(resized(image.rgb, (WORKING_ROWS, 2 * WORKING_ROWS)))
        return replace(own, probabilities=with_seen_floor(own.probabilities, own.boundary.floor_rad, shown))
    if contract is None:
        return fused(own, image, open_installed(network))
    return segment_around(image, open_segmenter(network, contract), first=own)


def _estimate(
    context: StageContext,
    image: LuminanceImage,
    evidences: tuple[SceneEvidence, SceneEvidence],
    known: tuple[RoomModel | None, Upright],
    gathered: _Gathered,
) -> None:
    given, turned = known
    evidence, seen = evidences
    asked = context.parameters_of(RoomParameters)
    if given is not None:
        gathered.left_out["estimate"] = "the room is given"
        gathered.metrics |= {"source": evidence.source, "confidence": given.confidence, "walls": len(given.floor)}
        gathered.artifacts["room"] = given
        return
    if evidence.boundary is None:
        raise NoRoomError("the network shows no boundaries", likely="; ".join(evidence.notes) or "an unusual picture")
    found = estimate_room(
        image,
        evidence,
        camera_height_m=asked.camera_height_m or context.session.camera_height_m,
        manhattan_rad=turned.manhattan_rad if turned.manhattan_support >= LEAST_SQUARE else None,
        quality=context.quality.value,
    )
    context.progress(0.8, "windows and doors")
    sky = context.optional_artifact("calibrate", "outdoor")
    shone = sky_shows_sun(context.optional_artifact("calibrate", "calibration"))
    sun = None if shone is False else sun_direction(context.session)
    openings = find_openings_in_sun(image, evidence if asked.segmenter_contract else seen, found.room, sun, outdoor=sky)
    gathered.artifacts["room"] = found.room.model_copy(update={"openings": openings})
    gathered.metrics |= _metrics(found, evidence) | {"openings": len(openings)}
    gathered.warnings += found.warnings
    gathered.left_out |= {f"part {k}": text for k, text in enumerate(found.skipped)}


def _metrics(found: RoomEstimate, evidence: SceneEvidence) -> dict[str, Any]:
    return {
        "source": evidence.source,
        "confidence": found.room.confidence,
        "ceiling_confidence": found.ceiling,
        "wall_confidences": list(found.walls),
        "walls": len(found.room.floor),
        "alternatives": list(found.alternatives),
        "diagnostics": found.diagnostics.values(),
    }


def _refused(error: NoRoomError, given: RoomModel | None, gathered: _Gathered) -> None:
    """Record why there is no room; one that is given stands all the same."""
    reason = f"{error.code}: {error}"
    for name in ("panorama", "room", "evidence"):
        if name not in gathered.artifacts:
            gathered.left_out.setdefault(name, reason)
    if given is not None:
        gathered.artifacts["room"] = given
        gathered.left_out.pop("room", None)
    gathered.warnings.append(f"no room was estimated from the panorama: {reason}")
