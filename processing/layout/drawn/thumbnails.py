"""Pictures of furniture on a pale ground, by rays (Embree): one model, both its sides, a contact sheet."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from processing.errors import EngineError
from processing.ground.arrays import Doubles, Floats, Int32s
from processing.ground.colour import linear_of_srgb, srgb_of_linear
from processing.layout.furniture.model import FurnitureModel, Material, Part

# All constants of the look were chosen by eye.
PAPER, INK, GREY = "#e3e1de", "#2f3337", "#7a8087"
GROUND = np.array([0.86, 0.85, 0.835])
"""Linear colour of the ground."""
SUPER = 2  # pixels are drawn this much finer and averaged; each of the finer ones sees another share of the lights
EXPOSURE = 0.86  # chosen by eye, as said above
FIELD_RAD = math.radians(24.0)
MARGIN = 0.86  # share of the picture that the furniture's bounds fill at most
KEY = np.array([-0.62, 0.50, 0.72])
"""Towards the window, before it is turned with the camera (camera looks along -y)."""
KEY_SPREAD = 0.22  # tangent of half the window's angle
DOME_LIGHTS, KEY_LIGHTS = 48, 32
FROM_THE_RIGHT_RAD, ELEVATION_RAD = -0.62, 0.30
LIFT_M = 0.004  # shadow rays begin this far above a surface


class Surface(NamedTuple):
    """What the picture's rays meet, N points."""

    points: Doubles
    """(N, 3) metres."""
    normals: Doubles
    """(N, 3), unit length."""
    uv: Doubles
    """(N, 2), counting textures."""
    towards_eye: Doubles
    """(N, 3), unit length."""
    part: Int32s
    """(N,): number of the part."""


def preview(
    model: FurnitureModel | Sequence[Part], *, size_px: tuple[int, int] = (480, 480), azimuth_rad: float = 0.6
) -> Image.Image:
    """Return a picture seen from the front (+y), the camera going round to the left (-x) by `azimuth_rad`.

    Raises `EngineError` where Embree is not installed (Linux on ARM).
    """
    parts = model.parts if isinstance(model, FurnitureModel) else model
    triangles = np.concatenate([part.vertices[part.faces] for part in parts])
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    scene = _embree(triangles)
    columns, rows = size_px[0] * SUPER, size_px[1] * SUPER
    eye, rays, focal_px = _camera((low, high), (columns, rows), azimuth_rad, ELEVATION_RAD)
    found = scene.run(
        np.tile(eye.astype(np.float32), (len(rays), 1)), rays.astype(np.float32), query="INTERSECT", output=True
    )
    colour = np.tile(GROUND, (len(rays), 1))

    hit = np.flatnonzero(found["primID"] >= 0)
    surface = _surface(parts, {key: found[key][hit] for key in ("primID", "u", "v")}, rays[hit])
    y, x = np.divmod(np.arange(len(rays)), columns)
    share = (y % SUPER) * SUPER + x % SUPER
    light, openness, _ = _lit(scene, surface.points, surface.normals, share[hit], azimuth_rad)
    grain_m = float(np.linalg.norm(eye - (low + high) / 2)) / focal_px * SUPER
    colour[hit] = _reflected(parts, surface, light, openness, grain_m)

    # The ground is darker where it sees less of the lights; its shadow fades out away from the furniture.
    ground = np.flatnonzero((found["primID"] < 0) & (rays[:, 2] < -1e-6))
    points = eye - rays[ground] * (eye[2] / rays[ground, 2:])
    reach = 1.6 * float(np.linalg.norm(high - low))
    fade = np.clip((reach - np.linalg.norm(points[:, :2] - (low + high)[:2] / 2, axis=1)) / (0.4 * reach), 0, 1)
    near = np.flatnonzero(fade > 0)
    up = np.tile([0.0, 0.0, 1.0], (len(near), 1))
    light, _, most = _lit(scene, points[near], up, share[ground[near]], azimuth_rad)
    colour[ground[near]] *= (1 - 0.85 * fade[near] * (1 - light / most))[:, None]

    toned = EXPOSURE * colour.reshape(size_px[1], SUPER, size_px[0], SUPER, 3).mean(axis=(1, 3))
    shoulder = 0.7 + 0.3 * np.tanh((toned - 0.7) / 0.3)  # instead of clipping
    return Image.fromarray(srgb_of_linear(np.where(toned < 0.7, toned, shoulder)))


def _embree(triangles: Floats) -> Any:
    """Return an Embree scene of (F, 3, 3) triangles."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        raise EngineError(
            "pictures of furniture need embreex, which is not installed",
            likely="embreex is not available for this system",
            advice="furniture export writes GLB files, which any viewer shows",
        ) from None
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.ascontiguousarray(triangles, dtype=np.float32))
    return scene


def _camera(
    bounds: tuple[Floats, Floats], size: tuple[int, int], azimuth: float, elevation: float
) -> tuple[Doubles, Doubles, float]:
    """Return a pinhole camera's place (3,), rays (N, 3) with unit step forward, row by row, and focal length in px."""
    c, s = math.cos(elevation), math.sin(elevation)
    forward = np.array([math.sin(azimuth) * c, -math.cos(azimuth) * c, -s])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, forward), forward])
    focal = 0.5 * min(size) / math.tan(FIELD_RAD / 2)
    # Far enough that every corner of the bounds is inside the picture with a margin.
    corners = np.array(np.meshgrid(*zip(*bounds, strict=True))).reshape(3, -1).T
    centre = corners.mean(axis=0)
    local = (corners - centre) @ axes.T
    away = [abs(local[:, k]) * focal / (0.5 * size[k] * MARGIN) - local[:, 2] for k in (0, 1)]
    y, x = np.indices(size[::-1]) + 0.5
    steps = np.stack([(x - size[0] / 2) / focal, (size[1] / 2 - y) / focal, np.ones(size[::-1])], axis=-1)
    return centre - forward * float(np.max(away)), steps.reshape(-1, 3) @ axes, focal


def _surface(parts: Sequence[Part], hits: dict[str, Any], rays: Doubles) -> Surface:
    """Return the surface that rays (N, 3) meet, from Embree's triangle numbers and barycentric coordinates."""
    uvs = [p.texture_coordinates() for p in parts]
    corners = [
        np.concatenate([values[part.faces] for part, values in zip(parts, rows, strict=True)])[hits["primID"]]
        for rows in (
            [p.vertices for p in parts],
            [p.normals for p in parts],
            [np.zeros((len(p.vertices), 2)) if uv is None else uv for p, uv in zip(parts, uvs, strict=True)],
        )
    ]
    weights = np.stack([1 - hits["u"] - hits["v"], hits["u"], hits["v"]], axis=1).astype(np.float64)
    points, normals, uv = (np.einsum("ik,ikj->ij", weights, values) for values in corners)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    towards_eye = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    # Surfaces seen from behind (leaves, sheets) are turned to the eye.
    normals[np.einsum("ij,ij->i", normals, towards_eye) < -0.15] *= -1
    number = np.repeat(np.arange(len(parts), dtype=np.int32), [len(p.faces) for p in parts])
    return Surface(points, normals, uv, towards_eye, number[hits["primID"]])


def _lights(turn_rad: float) -> tuple[Doubles, Doubles]:
    """Return directions (L, 3) and powers (L,) of parallel lights: a dim room as a dome, and a bright window."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    key = np.array([KEY[0] * c - KEY[1] * s, KEY[0] * s + KEY[1] * c, KEY[2]]) / np.linalg.norm(KEY)
    golden = np.pi * (3 - np.sqrt(5))
    k = np.arange(DOME_LIGHTS)
    z = (k + 0.5) / DOME_LIGHTS
    r = np.sqrt(1 - z * z)
    dome = np.stack([r * np.cos(golden * k), r * np.sin(golden * k), z], axis=1)
    across = np.cross(key, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    k = np.arange(KEY_LIGHTS)
    r = KEY_SPREAD * np.sqrt((k + 0.5) / KEY_LIGHTS)
    window = key + np.outer(r * np.cos(golden * k), across) + np.outer(r * np.sin(golden * k), np.cross(across, key))
    window /= np.linalg.norm(window, axis=1, keepdims=True)
    powers = np.concatenate([(0.75 + 0.45 * dome @ key) * 2.0 / DOME_LIGHTS, np.full(KEY_LIGHTS, 1.25 / KEY_LIGHTS)])
    return np.concatenate([dome, window]), powers


def _lit(
    scene: Any, points: Doubles, normals: Doubles, share: Int32s, turn_rad: float
) -> tuple[Doubles, Doubles, Doubles]:
    """Return irradiance / pi, the share of the lights seen, and irradiance / pi with nothing in the way, each (N,).

    `points`, `normals` (N, 3); `share` (N,): which of the SUPER x SUPER shares of the lights each point looks at.
    """
    towards, powers = _lights(turn_rad)
    light, seen_lights, unshadowed = np.zeros(len(points)), np.zeros(len(points)), np.zeros(len(points))
    start = (points + LIFT_M * normals).astype(np.float32)
    shares = SUPER * SUPER
    for part in range(shares):
        mine = np.flatnonzero(share == part)
        for way, power in zip(towards[part::shares], powers[part::shares], strict=True):
            rays = np.tile(way.astype(np.float32), (len(mine), 1))
            seen = scene.run(start[mine], rays, query="OCCLUDED") < 0 if len(mine) else np.empty(0, bool)
            falling = shares * power * np.clip(normals[mine] @ way, 0.0, None)
            light[mine] += falling * seen
            unshadowed[mine] += falling
            seen_lights[mine] += seen * shares / len(towards)
    return light, seen_lights, unshadowed


def _reflected(parts: Sequence[Part], surface: Surface, light: Doubles, openness: Doubles, grain_m: float) -> Doubles:
    """Return the linear colours (N, 3): diffuse, a mirror of a plain studio by Schlick's Fresnel term, metal."""
    colour = np.empty((len(light), 3))
    normal, eye = surface.normals, surface.towards_eye
    facing = np.einsum("ij,ij->i", normal, eye)[:, None]
    mirror_z = 2 * facing[:, 0] * normal[:, 2] - eye[:, 2]
    facing = np.clip(facing, 0.0, 1.0)
    bounced = 0.16 * GROUND * (0.5 + 0.5 * openness * (0.6 - 0.4 * normal[:, 2]))[:, None]
    # The studio: light ground, darker walls, bright ceiling.
    studio = np.where(mirror_z < 0, 0.55 + 0.2 * mirror_z, 0.45 + 0.75 * np.clip(mirror_z, 0, 1) ** 1.5)
    around = (studio * openness)[:, None]
    for number, part in enumerate(parts):
        mine = np.flatnonzero(surface.part == number)
        if not len(mine):
            continue
        base = _base(part.material, surface.uv[mine], grain_m)
        smooth = (1 - part.material.roughness) ** 2
        fresnel = 0.04 + 0.96 * smooth * (1 - facing[mine]) ** 5
        diffuse = base * (light[mine, None] + bounced[mine])
        shine = around[mine] * (0.25 + 0.75 * smooth)
        metal = base * (0.75 * around[mine] + 0.25 * light[mine, None])
        metallic = part.material.metallic
        colour[mine] = metallic * metal + (1 - metallic) * (diffuse * (1 - fresnel) + fresnel * shine)
    return colour


def _base(material: Material, uv: Doubles, grain_m: float) -> Doubles:
    """Return the base colour (N, 3) at texture coordinates (N, 2); the texture is averaged to a pixel's size first."""
    factor = np.array(material.base_colour)
    if material.texture is None:
        return np.broadcast_to(factor, (len(uv), 3))
    texture = linear_of_srgb(material.texture)
    if material.texture_m is not None:
        texels = grain_m * texture.shape[1] / material.texture_m[0]
        step = 2 ** max(0, min(6, round(math.log2(max(texels, 1.0)))))
        tall, wide = (n // step for n in texture.shape[:2])
        if min(tall, wide) > 0:
            texture = texture[: tall * step, : wide * step].reshape(tall, step, wide, step, 3).mean(axis=(1, 3))
    tall, wide = texture.shape[:2]
    column = np.floor((uv[:, 0] % 1.0) * wide).astype(int) % wide
    row = np.floor(((1 - uv[:, 1]) % 1.0) * tall).astype(int) % tall
    colours: Doubles = factor * texture[row, column]
    return colours


def model_sheet(models: Sequence[FurnitureModel], *, cell_px: int = 300) -> Image.Image:
    """Return pictures of models in rows, each with its name and its size in centimetres."""
    columns = max(1, min(len(models), round(math.sqrt(1.6 * len(models)))))
    rows = math.ceil(len(models) / columns)
    text_px = round(0.15 * cell_px)
    sheet = Image.new("RGB", (columns * cell_px, rows * (cell_px + text_px)), PAPER)
    draw = ImageDraw.Draw(sheet)
    name_font, size_font = ImageFont.load_default(0.052 * cell_px), ImageFont.load_default(0.042 * cell_px)
    for number, model in enumerate(models):
        x, y = number % columns * cell_px, number // columns * (cell_px + text_px)
        sheet.paste(preview(model, size_px=(cell_px, cell_px), azimuth_rad=FROM_THE_RIGHT_RAD), (x, y))
        middle, base = x + cell_px // 2, y + cell_px
        draw.text((middle, base + 0.01 * cell_px), model.model_id, INK, name_font, anchor="mt")
        size = " x ".join(f"{100 * v:.0f}" for v in model.size_m) + " cm"
        draw.text((middle, base + 0.075 * cell_px), size, GREY, size_font, anchor="mt")
    return sheet


def two_sides(model: FurnitureModel) -> Image.Image:
    """Return a model seen from the front and from behind, side by side."""
    side_px = 640
    sheet = Image.new("RGB", (2 * side_px, side_px), PAPER)
    for number, azimuth_rad in enumerate((FROM_THE_RIGHT_RAD, 2.45)):
        sheet.paste(preview(model, size_px=(side_px, side_px), azimuth_rad=azimuth_rad), (number * side_px, 0))
    return sheet
