"""The stage render: furniture in the calibrated picture, in cd/m2 (paper, section 6)."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np

from processing.images import LuminanceImage, Validity
from processing.layout.arrangement import Arrangement, Arrangements
from processing.layout.catalogue import Catalogue
from processing.layout.furniture.styles import STYLES
from processing.rendering.composite import Staged, differential, ibl
from processing.rendering.irradiance import EFFORTS, Effort
from processing.rendering.render import render
from processing.rendering.scene import Part, Scene, Vector
from processing.rendering.scene_file import read_scene
from processing.sphere import Equirectangular
from processing.stages.arrange_parameters import MOST_STAGED
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.furnishing import furniture_parts
from processing.stages.materials import emptied, room_model
from processing.stages.render_parameters import RenderParameters

MODELLED = 0.05
"""Relative standard uncertainty of a rendered pixel that is not measured: of furniture's colour and the light on it."""


def nothing_to_render(context: StageContext) -> str | None:
    """Return why there is nothing to do: no materials, or nothing arranged."""
    if context.optional_artifact("materials", "scene") is None:
        return f"no scene: {context.summary('materials').get('skipped') or 'left out by the stage materials'}"
    found = context.optional_artifact("arrange", "arrangement")
    if found is None:
        return f"no arrangement: {context.summary('arrange').get('skipped') or 'left out by the stage arrange'}"
    if not found["arrangements"]:
        return "no arrangement was found"
    return None


def run(context: StageContext) -> StageOutput:
    """Render each alternative."""
    asked = context.parameters
    assert isinstance(asked, RenderParameters)
    image, _ = emptied(context)
    scene = read_scene(context.artifact("materials", "scene"))
    eye = (0.0, 0.0, room_model(context).camera_height_m)
    every = Arrangements.model_validate_json(json.dumps(context.artifact("arrange", "arrangement"))).arrangements
    every = every[:MOST_STAGED]
    effort = _effort(context, len(every))
    artifacts: dict[str, object] = {}
    told: list[Any] = []
    for number, one in enumerate(every):
        context.progress(number / len(every), f"alternative {one.rank}")
        style = asked.style or list(STYLES)[(asked.seed + number) % len(STYLES)]
        parts = furniture_parts(one.items, Catalogue.builtin(style))
        staged = staged_picture(image.rgb, scene, parts, eye, asked.method, effort, asked.seed)
        artifacts[f"staged-{number + 1}"] = _picture(image, staged, one, asked.method)
        told.append(_told(one, style, staged, asked.method))
    artifacts["staged"] = {"schema_version": 1, "method": asked.method, "alternatives": told}
    missing = {f"staged-{k}": "no such alternative" for k in range(len(every) + 1, MOST_STAGED + 1)}
    return StageOutput(
        artifacts=artifacts,
        metrics={"method": asked.method, "alternatives": told},
        warnings=_warnings(context, told),
        left_out=missing,
        honoured=_honoured(context, told),
    )


def staged_picture(
    photograph: Any, scene: Scene, parts: tuple[Part, ...], eye: Vector, method: str, effort: Effort, seed: int
) -> Staged:
    """Return the photograph with furniture by one of the methods."""
    if method == "ibl":
        return ibl(photograph, parts, eye, scene, seed=seed)
    if method == "differential":
        return differential(photograph, scene, parts, eye, effort=effort, seed=seed)
    high, wide = photograph.shape[:2]
    found = render(scene.furnished(parts), Equirectangular(wide, high), eye, effort=effort, seed=seed)
    none = np.zeros((high, wide), bool)
    return Staged(found.rgb, none, none, np.ones((high, wide), np.float32), found.error)


def _effort(context: StageContext, alternatives: int) -> Effort:
    effort = EFFORTS[context.quality.value]
    budget = None if context.time_budget_s is None else context.time_budget_s / alternatives
    return replace(effort, max_error=context.max_error, budget_s=budget)


def _picture(image: LuminanceImage, staged: Staged, one: Arrangement, method: str) -> LuminanceImage:
    uncertainty = np.where(staged.kept, image.uncertainty, np.hypot(np.minimum(image.uncertainty, 1.0), MODELLED))
    validity = np.where(staged.furniture, np.uint8(Validity.VALID), image.validity).astype(np.uint8)
    attributes = {**image.attributes, "staged": True, "method": method, "arrangement": one.rank}
    return replace(
        image,
        rgb=staged.rgb,
        uncertainty=uncertainty.astype(np.float32),
        validity=validity,
        ghost=None,
        attributes=attributes,
    )


def _told(one: Arrangement, style: str, staged: Staged, method: str) -> dict[str, Any]:
    return {
        "rank": one.rank,
        "items": [item.id for item in one.items],
        "style": style,
        "furniture_share": round(float(staged.furniture.mean()), 5),
        "changed_share": round(float((~staged.kept).mean()), 5),
        "error": round(staged.error, 5),
        "method": method,
    }


def _honoured(context: StageContext, told: list[Any]) -> dict[str, str]:
    worst = max(one["error"] for one in told)
    found = {"quality": context.quality.value}
    if context.max_error is not None:
        found["max_error"] = f"worst error of irradiance {worst:.3f}, {context.max_error:g} asked"
    if context.time_budget_s is not None:
        found["time_budget"] = f"no round begun after {context.time_budget_s:g} CPU seconds"
    return found


def _warnings(context: StageContext, told: list[Any]) -> tuple[StageWarning, ...]:
    worst = max(one["error"] for one in told)
    if context.max_error is None or worst <= context.max_error:
        return ()
    text = f"an error of {context.max_error:g} was asked for, {worst:.3f} reached"
    return (StageWarning(code="error", message=text),)
