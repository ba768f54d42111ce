"""The four methods of putting furniture in, beside the simulated room in which the same furniture truly stands.

The photograph is the emptied room's true panorama; windows, albedo and lamps are estimated from it and from the outdoor
picture as in `daylit process`. LDR-to-HDR starts from what an ordinary camera gives of it: 8 bits, exposed so that
`LDR_WHITE` of its pixels are white, brought back by an inverse power law. Its furniture is lit by that panorama, and
its pixels are those that count, as it is all that is known without a calibrated bracket.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR

from benchmarks.light.albedo import REVEAL_M, outdoors_of_room, picture
from benchmarks.light.render_scenes import emissions_of, triangles_of
from benchmarks.light.render_time import BPY
from benchmarks.paired import cost_of
from benchmarks.plots import IMAGES
from benchmarks.truth_rooms import QUALITY, room_model_of, truth_list, truth_of
from benchmarks.whole.end_to_end_room import MATTE, StagedRoom, staged_room
from mocks.rooms.model import Use
from mocks.rooms.truth import equirectangular
from mocks.rooms.world import RoomWorld
from mocks.worlds.light import Site
from processing.errors import ParameterError
from processing.ground.arrays import Floats, Vector, bands
from processing.layout.arrange import arrange
from processing.layout.items import set_items
from processing.layout.models.catalogue import Catalogue
from processing.layout.plan import from_room_model
from processing.light.picture.change import rays_of
from processing.light.picture.composite import Staged, differential
from processing.light.picture.render import ROWS_AT_ONCE_PX, render, small_geometry
from processing.light.scene.albedo import albedo_of_room
from processing.light.scene.patches import pane_triangles
from processing.light.scene.scene import Material, Part, Scene
from processing.light.solver.irradiance import EFFORTS, Effort, denoised
from processing.light.solver.kernels import cosine_rays, random
from processing.light.solver.sight import FIRST_PART, albedo_of, emission_of, looked_up, sight_along, sight_of
from processing.light.solver.stage import Stage, in_parts
from processing.light.solver.upsample import Places, upsampled
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, solid_angles
from processing.stages.furnishing import furniture_parts

ROWS, STYLE, CHANGED = 192, "scandinavian", 0.02
SETS = {Use.BEDROOM: "bedroom", Use.LIVING: "living", Use.OFFICE: "office", Use.DINING: "dining"}
METHODS = ("inverse_tone_curve", "ibl", "global", "differential")
CATCHER = "shadow_catcher"
"""The rival in Cycles, where `DAYLIT_BPY` names a Python that has ``bpy``."""
CATCHER_SPP = 64
LDR_WHITE, GAMMA = 0.02, 2.2
WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)


IBL_ROWS = 512  # height of the picture in which furniture's light by the panorama is gathered


def ibl(
    photograph: Floats,
    parts: tuple[Part, ...],
    eye_m: Vector,
    room: Scene,
    *,
    samples: int = 64,
    clean: bool = True,
    seed: int = 0,
) -> Staged:
    """Return a photograph (H, 2 H, 3), cd/m2, with furniture lit by it alone, as if all of it lay infinitely far away.

    It changes nothing in the room; ``room`` hides what is behind walls.
    """
    geometry = Equirectangular(photograph.shape[1], photograph.shape[0])
    full = Stage.of(room.furnished(parts), 0.2)
    sight = sight_of(full, small_geometry(geometry, IBL_ROWS), eye_m)
    furniture = np.flatnonzero(sight.label >= FIRST_PART)
    alone = Stage.of(Scene((), (), room.outdoors, parts), 0.2)
    light = np.zeros((len(sight.label), 3), np.float32)
    if len(furniture):
        light[furniture] = _from_afar(alone, photograph, sight.point[furniture], sight.normal[furniture], samples, seed)
    shaped = light.reshape(*sight.shape, 3)
    if clean:
        there = (sight.label >= FIRST_PART).reshape(sight.shape)
        near = np.where(there, 1 / (1 + sight.distance_m.reshape(sight.shape)), 0).astype(np.float32)
        shaped = denoised(shaped, sight.normal.reshape(shaped.shape) * there[..., None], near, wraps=True)
    rgb, mask = photograph.copy(), np.zeros(photograph.shape[:2], bool)
    high, wide = photograph.shape[:2]
    for rows in bands(high, max(1, ROWS_AT_ONCE_PX // wide)):
        places = Places.whole((rows.stop - rows.start, wide), rows.start, high)
        large = sight_along(full, rays_of(places), eye_m, (rows.stop - rows.start, wide))
        lit, _ = upsampled(shaped, sight, large, wraps=True, places=places)
        there = large.label >= FIRST_PART
        shown = albedo_of(full, large) * lit / np.float32(np.pi) + emission_of(full, large)
        band = rgb[rows].reshape(-1, 3)
        band[there] = shown[there]
        rgb[rows], mask[rows] = band.reshape(rgb[rows].shape), there.reshape(large.shape)
    return Staged(rgb, mask, ~mask, 0.0)


def _from_afar(stage: Stage, panorama: Floats, points: Floats, normals: Floats, samples: int, seed: int) -> Floats:
    """Return the irradiance (N, 3) of places lit by a panorama at infinity; what furniture hides gives no light."""
    out = np.zeros((len(points), 3), np.float32)
    shifts = random((seed, 70), len(points), 2)
    for part in in_parts(len(points), samples):
        count = len(points[part])
        origins, rays = np.empty((2, count, samples, 3), np.float32)
        cosine_rays(points[part][:, None, :], normals[part], shifts[part], origins, rays)
        flat = rays.reshape(-1, 3)
        hits = stage.tracer.cast(origins.reshape(-1, 3), flat)
        seen = np.where((hits.triangle < 0)[:, None], looked_up(panorama, flat), 0)
        out[part] = np.pi * seen.reshape(count, samples, 3).mean(axis=1)
    return out


def methods_row(number: int, use: Use, sheet: Path) -> dict[str, Any]:
    """Return each method's errors in one room; pictures of them go to ``sheet`` (.npz)."""
    start_s = time.process_time()
    room, truth = truth_of(number, use)
    model = room_model_of(room)
    found = arrange(from_room_model(model, keep_camera_free=True), set_items(SETS[use]), n=1, seed=0)
    items = found.arrangements[0].items
    parts = furniture_parts(items, Catalogue.builtin(STYLE))
    photograph = np.asarray(cv2.resize(truth.empty_rgb, (2 * ROWS, ROWS), interpolation=cv2.INTER_AREA), np.float32)
    true = _true_picture(staged_room(room, items, STYLE))
    known = albedo_of_room(
        picture(photograph),
        model,
        outdoors_of_room(room),
        reveal_m=REVEAL_M,
        rows=ROWS,
        effort=Effort(pixel_samples=32),
    )
    made = _pictures(photograph, known.scene, parts, room.eye)
    furniture = made.pop("furniture")[..., 0] > 0
    changed = np.abs((true @ WEIGHTS) / np.maximum(photograph @ WEIGHTS, 1e-9) - 1) > CHANGED
    row: dict[str, Any] = {"room": room.name, "items": len(items), "changed": float(changed.mean())}
    costs: dict[str, float] = {}
    if os.environ.get(BPY):
        made[CATCHER], costs[CATCHER] = shadow_catcher(photograph, known.scene, parts, room.eye)
        costs["differential"] = cost_of(lambda: differential(photograph, known.scene, parts, room.eye)).cpu_s
    for name in [name for name in (*METHODS, CATCHER) if name in made]:
        row[name] = _errors(made[name] @ WEIGHTS, true @ WEIGHTS, changed) | {
            f"furniture_{k}": v for k, v in _errors(made[name] @ WEIGHTS, true @ WEIGHTS, changed & furniture).items()
        }
        row[name] |= {"cpu_s": costs[name]} if name in costs else {}
    np.savez_compressed(sheet, ldr=_ldr(photograph)[0], truth=true, **made)  # type: ignore[arg-type]
    return row | {"cpu_s": time.process_time() - start_s}


def inverse_tone_curve(picture: np.ndarray, white_cd_m2: float, *, gamma: float = 2.2) -> Floats:
    """Return an 8-bit panorama (H, W, 3) as radiance by a plain inverse power law, full white at ``white_cd_m2``."""
    if picture.dtype != np.uint8 or not white_cd_m2 > 0:
        raise ParameterError("an inverse tone curve takes 8-bit pictures and a white above 0 cd/m2")
    return ((picture.astype(np.float32) / 255) ** gamma * white_cd_m2).astype(np.float32)


def shadow_catcher(
    photograph: Floats, scene: Scene, parts: tuple[Part, ...], eye: Vector, samples: int = CATCHER_SPP
) -> tuple[Floats, float]:
    """Return the photograph (H, 2 H, 3) with furniture by Cycles' shadow catcher, cd/m2, and the CPU seconds of that.

    The room gives off the photograph's light from where its surfaces are, the floor catches shadows, the sun comes in
    through the panes; the composite is furniture over the photograph times what is caught.
    """
    with tempfile.TemporaryDirectory() as name:
        source, target = Path(name, "room.npz"), Path(name, "out.npz")
        np.savez(source, photograph=photograph, eye=np.array(eye), **_catcher_arrays(scene, parts))
        script, rows = Path(__file__).with_name("render_cycles.py"), len(photograph)
        subprocess.run(
            [os.environ[BPY], script, source, target, str(samples), str(rows)], check=True, capture_output=True
        )
        cpu_s = float(np.load(target)["cpu_s"])
        layers = _layers(target.with_suffix(".exr"))
    front, noisy = layers["Combined"], layers["Noisy Shadow Catcher"]
    caught = np.where(noisy == 1, noisy, layers["Shadow Catcher"])  # cleaning must not touch what nothing shades
    return np.asarray(front[..., :3] + (1 - front[..., 3:]) * caught * photograph, np.float32), cpu_s


def _catcher_arrays(scene: Scene, parts: tuple[Part, ...]) -> dict[str, Any]:
    """Return a room and its furniture as `render_cycles` takes them."""
    furnished = scene.furnished(parts)
    every, count = triangles_of(furnished), len(scene.surfaces) + len(scene.parts)
    looks = [part.material for part in parts]
    matte = [look.roughness >= MATTE and look.metallic == 0 for look in looks]
    sun, glass = scene.outdoors.sun, [pane_triangles(pane) for pane in scene.panes]
    dimmed = np.mean([np.multiply(p.transmittance, p.clear_for_sun.mean()) for p in scene.panes] or [[1.0] * 3], axis=0)
    return {
        "triangles": np.concatenate([t for t, _ in every]).astype(np.float32),
        "part": np.concatenate([np.full(len(t), k) for k, (t, _) in enumerate(every)]),
        "colour": np.array([*(colour for _, colour in every[:count]), *(_mean_colour(look) for look in looks)]),
        "emission": np.array(emissions_of(furnished)),
        "rough": np.array([1.0] * count + [1.0 if m else k.roughness for m, k in zip(matte, looks, strict=True)]),
        "metal": np.array([0.0] * count + [look.metallic for look in looks]),
        "shell": count,
        "floor": [surface.name for surface in scene.surfaces].index("floor"),
        "glass": np.concatenate(glass) if glass else np.zeros((0, 3, 3)),
        "sun": np.array([] if sun is None else [*sun.direction, *np.multiply(sun.normal_illuminance_lx, dimmed)]),
    }


def _mean_colour(look: Material) -> Any:
    """Return a material's albedo (3,), its texture's mean included, as the simulated room has it."""
    if look.texture is None:
        return look.colour
    return np.multiply(look.colour, look.texture.reshape(-1, look.texture.shape[-1])[:, :3].mean(axis=0))


def _layers(path: Path) -> dict[str, Any]:
    """Return the passes (H, W, channels) of a multi-layer file by name."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        every = [part.channels.items() for part in file.parts]
        channels = {name: np.array(channel.pixels) for part in every for name, channel in part}
    found = {}
    for name in {key.split(".")[1] for key in channels if key.count(".") == 2}:
        found[name] = np.stack([v for c in "RGBA" for k, v in channels.items() if k.split(".")[1:] == [name, c]], -1)
    return found


def _pictures(photograph: Floats, scene: Any, parts: Any, eye: Any) -> dict[str, Floats]:
    picture8, white = _ldr(photograph)
    guessed = inverse_tone_curve(picture8, white, gamma=GAMMA)
    ours = differential(photograph, scene, parts, eye)
    geometry = Equirectangular(2 * ROWS, ROWS)
    whole = render(scene.furnished(parts), geometry, eye, effort=replace(EFFORTS["standard"], cleaning="fast"))
    return {
        "inverse_tone_curve": ibl(guessed, parts, eye, scene).rgb,
        "ibl": ibl(photograph, parts, eye, scene).rgb,
        "global": whole.rgb,
        "differential": ours.rgb,
        "furniture": np.repeat(ours.furniture[..., None], 3, axis=2).astype(np.float32),
    }


def _ldr(photograph: Floats) -> tuple[np.ndarray, float]:
    """Return an ordinary 8-bit picture, and the radiance of its white."""
    white = float(np.quantile(photograph.max(axis=2), 1 - LDR_WHITE))
    return np.rint(255 * np.clip(photograph / white, 0, 1) ** (1 / GAMMA)).astype(np.uint8), white


def _true_picture(room: StagedRoom) -> Floats:
    """Return the panorama (ROWS, 2 ROWS, 3) of a truly furnished room, mean of 2 x 2 rays a pixel."""
    fine = equirectangular(2 * ROWS)
    world = RoomWorld(room, QUALITY)
    found = world.radiance(Site.INDOOR, fine.reshape(-1, 3), math.pi / (2 * ROWS)).reshape(fine.shape)
    return np.asarray(found.reshape(ROWS, 2, 2 * ROWS, 2, 3).mean(axis=(1, 3)), np.float32)


def _errors(ours: np.ndarray, true: np.ndarray, where: np.ndarray) -> dict[str, float]:
    """Return median, 95th percentile and bias of luminance's relative error by solid angle."""
    use = where & (true > 0)
    area = solid_angles(Equirectangular(true.shape[1], true.shape[0]))[use]
    ratio = ours[use] / true[use]
    off = np.abs(ratio - 1)
    order = np.argsort(off)
    upto = np.cumsum(area[order]) / area.sum()
    median, high = (float(off[order][np.searchsorted(upto, q)]) for q in (0.5, 0.95))
    return {"median": median, "p95": high, "bias": float(np.median(ratio)) - 1}


def contact_sheet(sheets: list[Path], names: list[str], path: Path = IMAGES / "render-methods.jpg") -> Path:
    """Draw rooms side by side and methods below one another, each room at one exposure; the last row is the truth."""
    rows = (("ldr", "8 bits"), *((m, m.replace("_", " ")) for m in METHODS), ("truth", "truly furnished"))
    tiles = []
    for sheet, name in zip(sheets, names, strict=True):
        kept = np.load(sheet)
        level = 0.22 / float(np.median(kept["truth"] @ WEIGHTS))
        column = []
        for key, text in rows:
            shown = kept[key] if key == "ldr" else _toned(kept[key] * level)
            shown = np.ascontiguousarray(shown[ROWS // 6 : -ROWS // 6])
            label = f"{name}: {text}" if key == "ldr" else text
            cv2.putText(shown, label, (5, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)
            column.append(shown)
        tiles.append(np.concatenate(column))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.concatenate(tiles, axis=1)[..., ::-1])
    return path


def _toned(rgb: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(rgb / (1 + 0.35 * rgb), 0, 1) ** (1 / 2.2)).astype(np.uint8)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        for seed_, use_ in truth_list("test", int(sys.argv[1])):
            print(methods_row(seed_, use_, Path(os.environ.get("DAYLIT_SHEET", Path(place) / "sheet.npz"))), flush=True)
