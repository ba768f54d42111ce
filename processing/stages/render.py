"""The stage render: furniture in the calibrated picture, in cd/m2 (paper, section 6)."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from processing.errors import ParameterError
from processing.exchange.gltf import finely, write_scene_glb
from processing.ground.arrays import Flags, Floats, Indices, Vector
from processing.ground.threads import Later, behind, together
from processing.layout.arrangement import Arrangement, Arrangements, PlacedItem
from processing.layout.assumed import session_plan
from processing.layout.furniture.bench import STYLES, differing, style_named
from processing.layout.models.catalogue import Catalogue
from processing.layout.plan_files import plan_from_mapping
from processing.layout.styling import styled
from processing.light.picture.composite import Bare, Staged, changed, draw, parted_sun, patches_of_sun, widen_doubt
from processing.light.picture.render import render
from processing.light.scene.room_light import EmptyRoom
from processing.light.scene.scene import Part, Scene
from processing.light.scene.scene_file import read_scene
from processing.light.solver.irradiance import EFFORTS, Effort
from processing.pictures.exr import write_stage_exr
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.pictures.modes import modelled
from processing.sphere import Equirectangular
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.furnishing import furniture_parts
from processing.stages.materials import emptied
from processing.stages.parameters import MOST_STAGED, NO_SUCH, RenderParameters
from processing.stages.upright import known_room
from processing.surfaces.hanging import Hanging, hanging

QUALITY = {
    "draft": EFFORTS["draft"],
    "standard": EFFORTS["standard"],
    "reference": Effort(texel_m=0.07, patch_samples=128, rows=512, pixel_samples=32, sun_samples=256),
}
_PLACED: Any = {"id", "category", "model", "size_m", "theta_rad", "t_m"}
_SHOWN: Any = {"rank": True, "items": {"__all__": _PLACED}, "not_placed": True}
"""Of an arrangement, what its picture and facts depend on."""


def nothing_to_render(context: StageContext) -> str | None:
    """Return why there is nothing to do: no materials, or nothing arranged."""
    if context.optional_artifact("materials", "scene") is None:
        return f"no scene: {why_none(context, 'materials', 'scene')}"
    found = context.optional_artifact("arrange", "arrangement")
    if found is None:
        return f"no arrangement: {why_none(context, 'arrange', 'arrangement')}"
    return None if found.arrangements else "no arrangement was found"


def why_none(context: StageContext, stage: str, name: str) -> str:
    """Return why an earlier stage has not made something."""
    summary = context.summary(stage)
    return str(summary.get("skipped") or summary["left_out"].get(name, "left out"))[:400]


@dataclass(frozen=True)
class _Work:
    """What all alternatives have in common."""

    empty: EmptyRoom
    base: Floats
    """(H, 2 H, 3): the picture that furniture is put into."""
    bare: Bare
    patches: list[Indices]
    """Of sun in it (`patches_of_sun`)."""
    hanging: list[Hanging]
    eye_m: Vector
    effort: Effort
    asked: RenderParameters
    own: Catalogue | None
    model: Future[Scene]
    """For the models: with finer albedo."""
    later: Later


def run(context: StageContext) -> StageOutput:
    """Render each alternative, of which those that stand are kept; each is written during the next one's light."""
    with behind() as later:
        return _rendered(context, later)


def _rendered(context: StageContext, later: Later) -> StageOutput:
    asked = context.parameters_of(RenderParameters)
    if asked.style is not None:
        style_named(asked.style)
    arranged: Arrangements = context.artifact("arrange", "arrangement")
    every = arranged.arrangements[:MOST_STAGED]
    effort = replace(QUALITY[context.quality.value], max_error=context.max_error)
    if context.time_budget_s is not None:
        effort = replace(effort, budget_s=context.time_budget_s / len(every))
    work = cache(partial(_work, context, asked, effort, later))
    was, (plan, _) = plan_from_mapping(arranged.plan, where="arrangement"), session_plan(known_room(context))
    if np.array_equal(np.round(was.corners, 3), np.round(plan.corners, 3)):  # else it was given for another shape
        plan = replace(plan, hung=was.hung)
    lamps = _lamps(context)
    alternatives, units = list[Any](), ""
    for number, one in enumerate(every):
        context.progress(number / len(every), f"alternative {one.rank} of {len(every)}")
        style = asked.style or STYLES[(asked.seed + number) % len(STYLES)]
        added = styled(one, plan, style, asked.styling, asked.seed, lamps)
        name = f"staged-{number + 1}"
        own: dict[str, Any] = {"style": style, "effort": repr(effort), "quality": context.quality}
        own |= {"method": asked.method, "seed": asked.seed, "of": one.model_dump(mode="json", include=_SHOWN)}
        own |= {"lamps": asked.lamps, "added": [item.model_dump(mode="json", include=_PLACED) for item in added]}
        make = partial(_alternative, context.folder / name, work, style, one, added)
        facts = dict(context.part(name, (f"{name}.exr", f"{name}.glb"), own, make, apart="arrange"))
        units = facts.pop("units")
        apart = {"designs_differ": round(differing(alternatives[0]["style"], style), 2)} if alternatives else {}
        alternatives.append({"rank": one.rank, **facts, **apart, "differs_by": one.differs_by})
        if context.enough() and number + 1 < len(every):
            break
    names = [f"staged-{k}{kind}" for k in range(1, MOST_STAGED + 1) for kind in ("", "-model")]
    staged = {"schema_version": 1, "method": asked.method, "units": units, "alternatives": alternatives}
    return StageOutput(
        artifacts={"staged": staged} | dict.fromkeys(names[: 2 * len(alternatives)], True),
        metrics={"method": asked.method, "alternatives": alternatives},
        warnings=_warnings(context, alternatives),
        left_out=dict.fromkeys(names[2 * len(alternatives) :], NO_SUCH),
        honoured=_honoured(context, effort, alternatives),
        unfinished=len(alternatives) < len(every),
    )


def _lamps(context: StageContext) -> list[Any] | None:
    return context.summary("detect").get("metrics", {}).get("on_ceiling")  # type: ignore[no-any-return]


def _work(context: StageContext, asked: RenderParameters, effort: Effort, later: Later) -> _Work:
    scene = context.artifact("materials", "scene")
    empty, bare = together(partial(emptied, context), lambda: Bare.of(read_scene(scene), effort))
    context.let_go()  # three quarters of a gigabyte
    empty = replace(empty, image=replace(empty.image, ghost=None), filled=None)
    room = known_room(context)
    eye: Vector = (0.0, 0.0, room.camera_height_m)
    base = empty.image.rgb
    if base.shape[1] != 2 * base.shape[0]:
        raise ParameterError("furniture can be rendered into whole panoramas only", where="render")
    if asked.method == "global":
        geometry = Equirectangular(base.shape[1], base.shape[0])
        base = render(bare.stage, geometry, eye, effort=effort, seed=asked.seed).rgb
    folder = asked.furniture
    model = later(partial(finely, bare.stage.scene, empty.image, room))
    patches, own = patches_of_sun(empty.sunlit), None if folder is None else Catalogue.at(folder)
    hung = list(hanging(room, base, _lamps(context)))
    return _Work(empty, base, bare, patches, hung, eye, effort, asked, own, model, later)


def _alternative(
    path: Path, common: Callable[[], _Work], style: str, one: Arrangement, added: tuple[PlacedItem, ...]
) -> dict[str, Any]:
    """Render one alternative, have its picture and its model written (``path`` without an ending), return its facts."""
    work = common()
    parts = furniture_parts((*one.items, *added), Catalogue.builtin(style), work.own, lit=work.asked.lamps == "on")
    staged = _staged(work, parts)
    work.later(partial(_write, path, work, staged, one, parts))
    return {
        "units": "cd/m2" if work.empty.image.absolute else "relative units",
        "items": [item.id for item in one.items],
        "added": [item.model_dump(mode="json", include=_PLACED) for item in added],
        "lamps": work.asked.lamps,
        "not_placed": [item.id for item in one.not_placed],
        "style": style,
        "triangles": sum(len(part.faces) for part in parts),
        "furniture_share": round(float(staged.furniture.mean()), 5),
        "changed_share": round(float((~staged.kept).mean()), 5),
        "error": round(staged.error, 5),
        "method": work.asked.method,
    }


def _write(path: Path, work: _Work, staged: Staged, one: Arrangement, parts: tuple[Part, ...]) -> None:
    write_stage_exr(path.with_suffix(".exr"), _picture(work, staged, one), ~_kept(work, staged), own=True)
    write_scene_glb(path.with_suffix(".glb"), work.model.result().furnished(parts), work.eye_m)


def _staged(work: _Work, parts: tuple[Part, ...]) -> Staged:
    """Return the picture with furniture by the method asked for.

    ``global`` is the rendered room with the rendered change of light: the same light transport as one render of the
    furnished room, less the noise that the two have in common."""
    base, seed = work.base, work.asked.seed
    if work.effort.budget_s is not None:
        work.later(lambda: None).result()  # writing would spend of the budget
    change = changed(base, work.bare, parts, work.eye_m, effort=work.effort, seed=seed)
    work.later(lambda: None).result()  # before anything as large is made, or the emptied picture is changed
    if work.asked.method == "global":
        return draw(change, base, None)
    with work.empty.without(parted_sun(work.patches, base.shape, work.bare, parts, work.eye_m)) as (below, sunless):
        return draw(change, below, sunless, work.hanging)


def _picture(work: _Work, staged: Staged, one: Arrangement) -> LuminanceImage:
    image, method, uncertainty = work.empty.image, work.asked.method, work.empty.image.uncertainty.copy()
    widen_doubt(staged.rgb, image.rgb, _kept(work, staged), np.array(LUMINANCE_WEIGHTS, np.float32), uncertainty)
    picture = replace(
        image,
        rgb=staged.rgb,
        uncertainty=uncertainty,
        validity=np.where(staged.furniture, np.uint8(Validity.VALID), image.validity).astype(np.uint8),
        ghost=None,
        attributes={**image.attributes, "staged": True, "method": method, "arrangement": one.rank},
    )
    return modelled(picture, image.uncertainty)


def _kept(work: _Work, staged: Staged) -> Flags:
    """Return (H, W): where the photograph is kept; nowhere in one that is all rendered."""
    return staged.kept if work.asked.method != "global" else np.zeros_like(staged.kept)


def _honoured(context: StageContext, effort: Effort, staged: list[Any]) -> dict[str, str]:
    worst = max(one["error"] for one in staged)
    found = {"quality": f"{context.quality.value}: light at {effort.rows} rows"}
    if context.max_error is not None:
        found["max_error"] = f"{context.max_error:g} requested, {worst:.3f} reached (error of irradiance)"
    if context.time_budget_s is not None:
        found["time_budget"] = f"no sampling pass started after {context.time_budget_s:g} CPU seconds of gathering"
    return found


def _warnings(context: StageContext, alternatives: list[Any]) -> tuple[StageWarning, ...]:
    worst = max(one["error"] for one in alternatives)
    if context.max_error is None or worst <= context.max_error:
        return ()
    return (
        StageWarning(code="error", message=f"an error of {context.max_error:g} was requested, {worst:.3f} reached"),
    )
