"""The stage materials: what the emptied room's surfaces reflect, and the room as a scene under its light."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Vector
from processing.ground.seam import grown, resized
from processing.light.picture.composite import Bare, differential, widen_doubt
from processing.light.scene.albedo import KnownLight, RoomAlbedo, albedo_of_room
from processing.light.scene.room_light import EmptyRoom, near_sun, with_sunlight
from processing.light.scene.scene import REVEAL_M, Outdoors, Scene, Surface
from processing.light.scene.scene_file import read_scene, write_scene
from processing.light.scene.sources import MOST_SUN, most_sun, sun_note, under_share
from processing.light.solver.irradiance import EFFORTS, Effort
from processing.light.solver.sight import sight_of
from processing.light.solver.sun import sun_of, sun_rim
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.pictures.patch import write_patch
from processing.pictures.writing import estimated
from processing.removal.lift import Shade, light_without
from processing.sphere import Equirectangular
from processing.stages.contract import StageContext, StageOutput, StageWarning
from processing.stages.light import light_outdoors, read_shade
from processing.stages.parameters import MaterialsParameters
from processing.stages.upright import detected, known_room, things, why_unfit, working_panorama

ROWS = {"draft": 256, "standard": 512, "reference": 1024}  # height of the albedo picture
EFFORT = Effort(pixel_samples=32)
SUN_EFFORT = replace(EFFORTS["draft"], sun_samples=64)  # chosen: the sun is many times the light that it is added to
SAME = 0.5  # of a pixel, from which it is one of a mask's
SUN_ROWS, SUN_GAP_RAD = 1024, math.radians(1.0)
"""Of the picture in which photographed patches of sun are compared with the model's; from what hides them (chosen)."""
GAP_RAD = math.radians(2.0)
"""Half as wide as the widest gap between parts of a patch of sun that is closed; chosen: 7 cm of a floor at 2 m."""
LEAST_SUN = 0.3  # of the computed sunlight, that a pixel shows which is not in half shadow; chosen
LEAST_SUNNY, LEAST_SHARE = 2e-5, 0.5
"""Pixels over a panorama's squared height, from which patches show the sun's colour, and its least share; chosen."""
MOST_LAMPS = 100  # that are listed one by one; the light of all is in the scene


def nothing_to_stage(context: StageContext) -> str | None:
    """Return why there is nothing to do: no staging asked and no sun taken from an emptied room, or no room."""
    asked, sunlight = context.parameters_of(MaterialsParameters), context.optional_artifact("detect", "sunlight")
    sun_gone = sunlight is not None and np.asarray(sunlight).any()
    if not asked.wanted and (not sun_gone or context.optional_artifact("remove", "empty") is None):
        return "no staging requested, and no sunlight to restore in the emptied room"
    return why_unfit(context, asked=asked.doubtful_room)


def run(context: StageContext) -> StageOutput:
    """Estimate albedo, windows and lamps."""
    asked, empty = context.parameters_of(MaterialsParameters), emptied(context)
    context.let_go()  # of the photograph and of what removal left, each as large as what was made of them
    image, room, rows = empty.image, known_room(context), min(ROWS[context.quality.value], len(empty.image.rgb))
    context.progress(0.0, "outdoor light")
    shade, warnings = read_shade(context), list[str]()
    outdoors: Outdoors | KnownLight | None
    if shade is not None and asked.reveal_m is None:
        scene, source = read_scene(context.artifact("light", "scene")), context.summary("light")["metrics"]["outdoors"]
        outdoors = KnownLight(scene, *light_without(shade, room, rows))
    else:
        outdoors, source, warnings = light_outdoors(context, image, room)
    context.progress(0.1, "albedo")
    reveal_m = REVEAL_M if asked.reveal_m is None else asked.reveal_m
    found = albedo_of_room(image, room, outdoors, reveal_m=reveal_m, filled=empty.filled, rows=rows, effort=EFFORT)
    context.progress(0.7, "sunlight that furniture no longer blocks")
    found = replace(found, scene=as_it_fell(context, found.scene, room.camera_height_m, image.rgb.shape[1], shade))
    sunlit, why, share = in_its_sun(empty, found.scene, (0.0, 0.0, room.camera_height_m))
    found = _under_share(found, share)
    if sunlit is not None:
        shown = replace(image, rgb=image.rgb.copy()) if sunlit is image else sunlit
        with empty.without(empty.sunlit) as (below, _):
            write_patch(context.folder / "sun.npz", shown, replace(image, rgb=below))
    write_scene(context.folder / "scene.npz", found.scene)
    facts = _facts(found, source, absolute=image.absolute)
    return StageOutput(
        artifacts={"materials": facts, "scene": True, "sun": None if sunlit is None else True},
        left_out={"sun": why} if sunlit is None else {},
        metrics={
            "measured_share": round(float(found.measured.mean()), 4),
            "floor_gloss": round(found.gloss, 3),
            "outdoors": source,
            "lamps": len(found.lamps),
            "sun_share": [round(float(one), 3) for one in share],
            "units": "cd/m2" if image.absolute else "relative units",
            "notes": list(found.notes),
        },
        warnings=tuple(StageWarning(code="materials", message=text[:500]) for text in warnings),
        honoured={"quality": f"albedo of {2 * rows} x {rows} directions"},
    )


def as_it_fell(context: StageContext, scene: Scene, eye_m: float, wide: int, shade: Shade | None) -> Scene:
    """Return a scene through whose panes the sun falls no farther than its patches reach in a panorama ``wide`` px,
    taken ``eye_m`` above the floor."""
    sun, shown, step = scene.outdoors.sun, detected(context, "sunlight", wide), max(1, wide // (2 * SUN_ROWS))
    if sun is None or shown is None:
        return scene
    bar = [one for name in ("furniture", "tripod") if (one := detected(context, name, wide)) is not None]
    hidden, shown = (one[::step, ::step] for one in (np.logical_or.reduce([np.zeros_like(shown), *bar]), shown))
    if shade is not None and shade.returned is not None:
        hidden = hidden | (resized(shade.returned.astype(np.float32), hidden.shape) > 0)
    stage = Bare.of(scene, SUN_EFFORT).stage
    sight = sight_of(stage, Equirectangular(*hidden.shape[::-1]), (0.0, 0.0, eye_m))
    due = sun_of(stage, sight, SUN_EFFORT.sun_samples, 0).any(axis=1) & ~grown(hidden, SUN_GAP_RAD).ravel()
    rims = [sun_rim(pane, sun, sight.point[due], shown.ravel()[due]) for pane in scene.panes]
    return replace(scene, panes=tuple(replace(pane, sun_rim=rim) for pane, rim in zip(scene.panes, rims, strict=True)))


def in_its_sun(
    empty: EmptyRoom, scene: Scene, eye_m: Vector, effort: Effort = SUN_EFFORT
) -> tuple[LuminanceImage | None, str, Doubles]:
    """Return the emptied panorama with direct sun where nothing stops it any more; None, and why it gets none; and the
    share, shape (3,), of the sun's light that its photographed patches show."""
    image, whole = empty.image, np.ones(3)
    as_seen = image if empty.sunlit is not None and empty.sunlit.any() else None
    if scene.outdoors.sun is None:
        return None, "no sun is known in the outdoor picture", whole
    if empty.sunless is None or not empty.sunless.any():
        return as_seen, "nothing was removed where the sun may fall", whole
    bare, rows = Bare.of(scene, effort), min(effort.rows, empty.sunless.shape[0])
    sight = sight_of(bare.stage, Equirectangular(2 * rows, rows), eye_m)
    lit = sun_of(bare.stage, sight, effort.sun_samples, 0).any(axis=1).reshape(rows, 2 * rows)
    reached = resized(grown(lit, 2 * math.pi / rows).astype(np.float32), empty.sunless.shape) > 0
    if not (empty.sunless & reached).any():
        return as_seen, "no direct sun falls on what was removed or shaded", whole
    with empty.without(empty.sunlit) as (below, sunless):
        assert sunless is not None
        found = differential(below, bare, (), eye_m, effort=effort, sunless=sunless & reached)
        rgb, kept, doubt = found.rgb, found.kept, image.uncertainty.copy()
        rgb -= below
    if empty.sunlit is not None and empty.shaded is not None:
        seen = image.rgb[empty.sunlit] - empty.shaded
        valid = image.validity[empty.sunlit] == Validity.VALID
        whole = share_of_sun(seen[valid], rgb[empty.sunlit][valid], len(rgb), most_sun(scene.outdoors.sun))
        kept |= empty.sunlit
    rgb *= whole.astype(np.float32)
    with empty.without(empty.sunlit) as (below, _):
        rgb += below
    np.copyto(rgb, image.rgb, where=kept[..., None])
    widen_doubt(rgb, image.rgb, kept, np.asarray(LUMINANCE_WEIGHTS, np.float32), doubt)
    return estimated(replace(image, rgb=rgb, uncertainty=doubt), ~kept, own=True), "", whole


def share_of_sun(seen: Floats, computed: Floats, rows: int, most: float = MOST_SUN) -> Doubles:
    """Return what patches show of the sun's light, over what was computed for them, (3,), `LEAST_SHARE` to ``most``.

    1 where they are small. ``seen``, ``computed`` (N, 3): light that the sun adds to a panorama of ``rows``.

    The sun's disc is clipped outdoors, air, trees and glass colour its light, and the surface's albedo is an estimate.
    """
    level = computed.min(axis=-1)
    sure = (level > 0) & (seen.min(axis=-1) > LEAST_SUN * level)
    if np.count_nonzero(sure) < LEAST_SUNNY * rows * rows:
        return np.ones(3)
    return np.asarray(np.clip(np.median(seen[sure].astype(np.float64) / computed[sure], axis=0), LEAST_SHARE, most))


def _under_share(found: RoomAlbedo, share: Doubles) -> RoomAlbedo:
    """Return a room under a share (3,) of its sun, which keeps its colour: the floor's may be as wrong."""
    outdoors = found.scene.outdoors
    if outdoors.sun is None or (share == 1).all():
        return found
    sun, weights = np.array(outdoors.sun.normal_illuminance_lx), np.asarray(LUMINANCE_WEIGHTS)
    whole = float((share * sun) @ weights / max(float(sun @ weights), 1e-30))
    scene = replace(found.scene, outdoors=under_share(outdoors, whole))
    return replace(found, scene=scene, notes=found.notes + sun_note(outdoors.sun, whole))


def emptied(context: StageContext) -> EmptyRoom:
    """Return the emptied panorama, or the upright one where nothing was removed; the photograph is let go."""
    before, optional = working_panorama(context), context.optional_artifact
    if optional("remove", "filled") is None and optional("remove", "empty") is None:
        return EmptyRoom(before)
    filled = np.asarray(context.artifact("remove", "filled"), bool)
    sunlit = detected(context, "sunlight", filled.shape[1])
    if sunlit is None or filled.shape != before.rgb.shape[:2]:
        return EmptyRoom(context.artifact("remove", "empty"), filled, filled)
    hidden, shade, rows = things(context, filled.shape), read_shade(context), near_sun(sunlit)
    returned = None if shade is None else shade.returned
    near = {name: getattr(before, name)[rows].copy() for name in ("rgb", "uncertainty", "validity")}
    del before
    context.let_go("calibrate", "room")
    empty: LuminanceImage = context.artifact("remove", "empty")
    context.let_go("remove")
    found = with_sunlight(empty, near, filled, sunlit, hidden, returned, own=True)
    if returned is None or found.sunless is None or found.sunlit is None:
        return found
    return replace(found, sunless=_joined(found.sunless, found.sunlit, returned))


def _joined(sunless: Flags, sunlit: Flags, returned: Flags) -> Flags:
    """Return where the sun may fall anew (H, W): without gaps, for stand-ins, whose shade ends there, are not exact.

    ``sunless``, ``sunlit`` (H, W): what removal left without sun, and where it stands as photographed; ``returned``
    (h, w), smaller: seen places that old furniture shaded."""
    light = (resized((sunless | sunlit).astype(np.float32), returned.shape) > SAME) | returned
    closed = ~grown(~grown(light, GAP_RAD), GAP_RAD)
    return sunless | ((resized(closed.astype(np.float32), sunless.shape) > SAME) & ~sunlit)


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
        "uncertainty": round(float(np.median(found.uncertainty[found.measured])), 4) if found.measured.any() else 1.0,
        "notes": list(found.notes),
    }


def _surface(one: Surface, weights: Doubles) -> dict[str, Any]:
    rgb = one.albedo.mean(axis=(0, 1), dtype=np.float64)
    return {"name": one.name, "albedo_rgb": [round(float(v), 4) for v in rgb], "albedo": round(float(rgb @ weights), 4)}
