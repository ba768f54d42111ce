"""The stage remove: the panorama without furniture, tripod and direct sunlight (paper, section 4)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError
from processing.images import LuminanceImage
from processing.removal.fill import Emptied, empty_room
from processing.removal.learned import LamaFiller
from processing.room.model import RoomModel
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.remove_parameters import RemoveParameters

LITTLE = 0.3
"""Mean confidence of the filled pixels under which it is told."""


def nothing_to_remove(context: StageContext) -> str | None:
    """Return why there is nothing to do: no target, an empty one, or no room to fill it by."""
    target = context.optional_artifact("detect", "target")
    if target is None:
        return "the stage detect told no target; give one (--mask)"
    if not np.asarray(target).any():
        return "nothing to remove"
    if context.optional_artifact("room", "room") is None:
        return "the stage room told no room; give one (--room)"
    return None


def run(context: StageContext) -> StageOutput:
    """Fill the target plane by plane."""
    asked = context.parameters
    assert isinstance(asked, RemoveParameters)
    image = _panorama(context)
    target = np.asarray(context.artifact("detect", "target"), bool)
    if target.shape != image.rgb.shape[:2]:
        raise ParameterError(
            f"the target is {target.shape[1]} x {target.shape[0]}, the panorama "
            f"{image.rgb.shape[1]} x {image.rgb.shape[0]}",
            advice="give a mask of the panorama's size",
        )
    room = RoomModel.model_validate_json(json.dumps(context.artifact("room", "room")))
    network = context.files.get("filler")
    filler = None if network is None else LamaFiller(network, bgr=asked.filler_channels == "bgr")
    context.progress(0.05, "surfaces")
    found = empty_room(
        image,
        target,
        room,
        keep_sunlight=asked.keep_sunlight,
        sunlight=_sunlight(context, target.shape),
        quality=context.quality.value,
        filler=filler,
    )
    context.progress(0.95, "writing")
    _write_details(context.folder / "surfaces.npz", found)
    return _output(found, context)


def _panorama(context: StageContext) -> LuminanceImage:
    image = context.optional_artifact("room", "panorama") or context.artifact("calibrate", "indoor")
    assert isinstance(image, LuminanceImage)
    return image


def _sunlight(context: StageContext, shape: tuple[int, ...]) -> npt.NDArray[np.bool_] | None:
    mask = context.optional_artifact("detect", "sunlight")
    if mask is None or np.asarray(mask).shape != shape:
        return None
    return np.asarray(mask, bool)


def _write_details(path: Path, found: Emptied) -> None:
    """Write provenance, confidence and the filled textures: what materials and a careful user need."""
    arrays: dict[str, npt.NDArray[Any]] = {
        "provenance": found.provenance,
        "confidence": found.confidence.astype(np.float16),
    }
    for filled in found.textures:
        name = filled.texture.plane.name
        arrays[f"{name}_rgb"] = filled.values
        arrays[f"{name}_hole"] = filled.hole
        arrays[f"{name}_px_per_m"] = np.array(filled.texture.px_per_m)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def _output(found: Emptied, context: StageContext) -> StageOutput:
    filled = found.provenance > 0
    sure = float(found.confidence[filled].mean()) if filled.any() else 1.0
    warnings = []
    if sure < LITTLE:
        text = f"mean confidence of what was filled: {sure:.2f}; too little of the surfaces is seen"
        warnings.append(StageWarning(code="confidence", message=text))
    warnings += [StageWarning(code="hidden", message=note) for note in found.notes if "hidden altogether" in note]
    assert isinstance(found.image, LuminanceImage)
    return StageOutput(
        artifacts={"empty": found.image, "filled": filled, "surfaces": True},
        metrics={
            "filled_share": round(float(filled.mean()), 5),
            "synthesised_share": round(float((found.provenance == 2).mean()), 5),
            "mean_confidence": round(sure, 4),
            "notes": list(found.notes),
        },
        warnings=tuple(warnings),
        honoured={"quality": f"textures of up to {_finest(found)} pixels ({context.quality.value})"},
    )


def _finest(found: Emptied) -> int:
    return max((filled.hole.size for filled in found.textures), default=0)
