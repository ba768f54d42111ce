"""A picture of furniture on a pale ground: pinhole camera, shading, tone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from PIL import Image

from processing.ground.arrays import Doubles, Int32s
from processing.ground.colour import linear_of_srgb, srgb_of_linear
from processing.layout.furniture.model import FurnitureModel, Material, Part

# Depth buffers: triangles into pixels, and how much of a set of lights points see.


@numba.njit(cache=True)
def nearest_faces(
    points: Doubles, faces: Int32s, rows: int, columns: int
) -> tuple[Doubles, Int32s]:  # pragma: no cover (compiled)
    """Return (rows, columns) depth (inf: none) and face (-1: none) of triangles; points are (x, y, depth) in pixels.

    Depth is interpolated linearly in the picture, which is right where it is a distance along parallel rays or the
    negative inverse of one along a pinhole's axis.
    """
    depth = np.full((rows, columns), np.inf)
    face_of = np.full((rows, columns), -1, dtype=np.int32)
    for f in range(faces.shape[0]):
        ax, ay, az = points[faces[f, 0]]
        bx, by, bz = points[faces[f, 1]]
        cx, cy, cz = points[faces[f, 2]]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        inverse = 1.0 / area
        x0, x1 = max(int(np.floor(min(ax, bx, cx))), 0), min(int(np.ceil(max(ax, bx, cx))), columns - 1)
        y0, y1 = max(int(np.floor(min(ay, by, cy))), 0), min(int(np.ceil(max(ay, by, cy))), rows - 1)
        for y in range(y0, y1 + 1):
            py = y + 0.5
            for x in range(x0, x1 + 1):
                px = x + 0.5
                u = ((bx - px) * (cy - py) - (by - py) * (cx - px)) * inverse
                v = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) * inverse
                w = 1.0 - u - v
                if u >= -1e-9 and v >= -1e-9 and w >= -1e-9:
                    z = u * az + v * bz + w * cz
                    if z < depth[y, x]:
                        depth[y, x] = z
                        face_of[y, x] = f
    return depth, face_of


@numba.njit(cache=True)
def seen_share(points: Doubles, frame: Doubles, depth: Doubles, bias: float) -> Doubles:  # pragma: no cover (compiled)
    """Return how much (0 to 1) of a light each place sees: the bilinear share of depths that do not lie before it.

    `frame` (3, 4) takes a place to (x, y, depth) in the light's picture.
    """
    rows, columns = depth.shape
    share = np.ones(points.shape[0])
    at = np.empty(3)
    for k in range(points.shape[0]):
        for i in range(3):
            at[i] = frame[i, 3]
            for j in range(3):
                at[i] += frame[i, j] * points[k, j]
        fx, fy = at[0] - 0.5, at[1] - 0.5
        ix, iy = int(np.floor(fx)), int(np.floor(fy))
        if ix < 0 or iy < 0 or ix >= columns - 1 or iy >= rows - 1:
            continue
        u, v, near = fx - ix, fy - iy, at[2] - bias
        total = 0.0
        if depth[iy, ix] > near:
            total += (1 - u) * (1 - v)
        if depth[iy, ix + 1] > near:
            total += u * (1 - v)
        if depth[iy + 1, ix] > near:
            total += (1 - u) * v
        if depth[iy + 1, ix + 1] > near:
            total += u * v
        share[k] = total
    return share


# The light of a preview: a bright window to one side and a dim room around, as many parallel lights with shadows.


MAP_PX = 360
KEY = np.array([-0.62, 0.50, 0.72])
"""Towards the window, before it is turned with the camera (camera looks along -y)."""


@dataclass(frozen=True)
class Light:
    """One of the parallel lights."""

    towards: Doubles
    power: float


def lights(turn_rad: float, dome: int = 48, key: int = 32) -> list[Light]:
    """Return lights over the upper half of directions: a dome, and a window that is 25 degrees wide."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    middle = np.array([KEY[0] * c - KEY[1] * s, KEY[0] * s + KEY[1] * c, KEY[2]])
    middle /= np.linalg.norm(middle)
    golden = np.pi * (3 - np.sqrt(5))
    made = []
    for k in range(dome):
        z = (k + 0.5) / dome
        r, a = np.sqrt(1 - z * z), golden * k
        towards = np.array([r * np.cos(a), r * np.sin(a), z])
        made.append(Light(towards, (0.75 + 0.45 * float(towards @ middle)) * 2.0 / dome))
    across = np.cross(middle, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    up = np.cross(across, middle)
    for k in range(key):
        r, a = 0.22 * np.sqrt((k + 0.5) / key), golden * k
        towards = middle + r * (np.cos(a) * across + np.sin(a) * up)
        made.append(Light(towards / np.linalg.norm(towards), 1.25 / key))
    return made


def lit(
    points: Doubles, normals: Doubles, vertices: Doubles, faces: Int32s, turn_rad: float
) -> tuple[Doubles, Doubles]:
    """Return irradiance / pi at (n, 3) points with normals, and the share of the lights they see past the triangles."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 * 1.02
    total, open_share = np.zeros(len(points)), np.zeros(len(points))
    every = lights(turn_rad)
    scale = MAP_PX / (2 * radius)
    lifted = np.ascontiguousarray(points + 0.004 * normals)
    for light in every:
        frame = _frame(light.towards, centre, scale)
        depth, _ = nearest_faces(vertices @ frame[:, :3].T + frame[:, 3], faces, MAP_PX, MAP_PX)
        seen = seen_share(lifted, frame, depth, 1.2 / scale)
        total += light.power * np.clip(normals @ light.towards, 0.0, None) * seen
        open_share += seen
    return total, open_share / len(every)


def _frame(towards: Doubles, centre: Doubles, scale: float) -> Doubles:
    """Return (3, 4): what takes a place to x and y in pixels and depth in metres, seen along a light's rays."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(helper, towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right * scale, np.cross(towards, right) * scale, -towards])
    return np.column_stack([axes, np.array([MAP_PX / 2, MAP_PX / 2, 0.0]) - axes @ centre])


GROUND = np.array([0.86, 0.85, 0.835])
SUPER = 2
GRID = 240
"""Places along each side of the grid on which the ground's shadow is found."""
EXPOSURE = 0.86
FIELD_RAD = math.radians(24.0)


@dataclass(frozen=True)
class Scene:
    """All triangles, and which part and place each comes from."""

    vertices: Doubles
    normals: Doubles
    uv: Doubles
    faces: Int32s
    material: Int32s
    materials: tuple[Material, ...]


@dataclass(frozen=True)
class Eye:
    """A pinhole camera."""

    at: Doubles
    axes: Doubles
    """Rows: right, up, forward."""
    focal_px: float
    columns: int
    rows: int

    def onto(self, points: Doubles) -> Doubles:
        """Return (x, y, -1/distance) in pixels."""
        local = (points - self.at) @ self.axes.T
        away = np.maximum(local[:, 2], 1e-3)
        x = self.focal_px * local[:, 0] / away + self.columns / 2
        y = -self.focal_px * local[:, 1] / away + self.rows / 2
        return np.column_stack([x, y, -1 / away])

    def rays(self) -> Doubles:
        """Return (rows x columns, 3) directions, with unit step forward."""
        y, x = np.meshgrid(np.arange(self.rows) + 0.5, np.arange(self.columns) + 0.5, indexing="ij")
        local = np.stack(
            [(x - self.columns / 2) / self.focal_px, -(y - self.rows / 2) / self.focal_px, np.ones_like(x)], -1
        )
        return np.asarray(local.reshape(-1, 3) @ self.axes)


def preview(
    model: FurnitureModel | Sequence[Part], *, size_px: tuple[int, int] = (480, 480), azimuth_rad: float = 0.6,
    elevation_rad: float = 0.30,
) -> Image.Image:  # fmt: skip
    """Return a picture seen from the front (+y), the camera going round to the left (-x) by `azimuth_rad`."""
    scene = _scene(model.parts if isinstance(model, FurnitureModel) else model)
    eye = _eye(scene, size_px, azimuth_rad, elevation_rad)
    points = eye.onto(scene.vertices)
    _, face = nearest_faces(points, scene.faces, eye.rows, eye.columns)
    colour = _shaded(scene, eye, face.ravel(), azimuth_rad)
    colour = colour.reshape(size_px[1], SUPER, size_px[0], SUPER, 3).mean(axis=(1, 3))
    return Image.fromarray(srgb_of_linear(_tone(colour)))


def _tone(colour: Doubles) -> Doubles:
    """Return colours with a soft shoulder instead of clipping."""
    c = EXPOSURE * colour
    return np.asarray(np.where(c < 0.7, c, 0.7 + 0.3 * np.tanh((c - 0.7) / 0.3)), dtype=np.float64)


def _scene(parts: Sequence[Part]) -> Scene:
    starts = np.cumsum([0, *(len(p.vertices) for p in parts[:-1])])
    return Scene(
        np.concatenate([p.vertices for p in parts]).astype(np.float64),
        np.concatenate([p.normals for p in parts]).astype(np.float64),
        np.concatenate([_uv(p) for p in parts]),
        np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=True)]).astype(np.int32),
        np.concatenate([np.full(len(p.faces), k, dtype=np.int32) for k, p in enumerate(parts)]),
        tuple(p.material for p in parts),
    )


def _uv(part: Part) -> Doubles:
    uv = part.texture_coordinates()
    return np.zeros((len(part.vertices), 2)) if uv is None else uv.astype(np.float64)


def _eye(scene: Scene, size_px: tuple[int, int], azimuth: float, elevation: float) -> Eye:
    low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
    centre = (low + high) / 2
    c, s = math.cos(elevation), math.sin(elevation)
    forward = np.array([math.sin(azimuth) * c, -math.cos(azimuth) * c, -s])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, forward), forward])
    columns, rows = size_px[0] * SUPER, size_px[1] * SUPER
    focal = 0.5 * min(columns, rows) / math.tan(FIELD_RAD / 2)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    local = (corners - centre) @ axes.T
    # Far enough that every corner of the bounds is inside the picture with a margin.
    need = [abs(local[:, k]) * focal / (0.5 * extent * 0.86) - local[:, 2] for k, extent in ((0, columns), (1, rows))]
    return Eye(centre - forward * float(np.max(need)), axes, focal, columns, rows)


def _shaded(scene: Scene, eye: Eye, face: Int32s, azimuth: float) -> Doubles:
    rays = eye.rays()
    colour = np.empty((len(face), 3))
    hit = np.flatnonzero(face >= 0)
    point, normal, uv = _surface(scene, eye, rays[hit], face[hit])
    material = scene.material[face[hit]]
    towards_eye = -rays[hit] / np.linalg.norm(rays[hit], axis=1, keepdims=True)
    normal = np.where(np.einsum("ij,ij->i", normal, towards_eye)[:, None] < -0.15, -normal, normal)
    grain_m = float(np.linalg.norm(eye.at - scene.vertices.mean(axis=0))) / eye.focal_px
    spots = _ground_spots(scene)
    every = np.concatenate([normal, np.tile([0.0, 0.0, 1.0], (len(spots), 1))])
    light, openness = lit(np.concatenate([point, spots]), every, scene.vertices, scene.faces, azimuth)
    shade = light[len(hit) :]
    light, openness = light[: len(hit)], openness[: len(hit)]
    colour[hit] = _material_colours(scene, material, uv, normal, towards_eye, light, openness, grain_m)
    rest = np.flatnonzero(face < 0)
    colour[rest] = _ground(scene, eye, rays[rest], shade)
    return colour


def _surface(scene: Scene, eye: Eye, rays: Doubles, face: Int32s) -> tuple[Doubles, Doubles, Doubles]:
    corner = scene.faces[face]
    a, b, c = (scene.vertices[corner[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    p = np.cross(rays, e2)
    det = np.einsum("ij,ij->i", e1, p)
    det = np.where(np.abs(det) < 1e-18, 1e-18, det)
    t = eye.at - a
    q = np.cross(t, e1)
    u, v = np.einsum("ij,ij->i", t, p) / det, np.einsum("ij,ij->i", rays, q) / det
    weight = np.clip(np.stack([1 - u - v, u, v], axis=1), 0.0, 1.0)
    weight /= weight.sum(axis=1, keepdims=True)
    point, normal, uv = (
        np.einsum("ik,ikj->ij", weight, values[corner]) for values in (scene.vertices, scene.normals, scene.uv)
    )
    return point, normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9), uv


def _material_colours(
    scene: Scene,
    material: Int32s,
    uv: Doubles,
    normal: Doubles,
    eye: Doubles,
    light: Doubles,
    openness: Doubles,
    grain_m: float,
) -> Doubles:
    colour = np.empty((len(material), 3))
    mirror = 2 * np.einsum("ij,ij->i", normal, eye)[:, None] * normal - eye
    facing = np.clip(np.einsum("ij,ij->i", normal, eye), 0.0, 1.0)
    bounced = 0.16 * GROUND * (0.5 + 0.5 * openness * (0.6 - 0.4 * normal[:, 2]))[:, None]
    around = _surroundings(mirror)[:, None] * openness[:, None]
    for k, m in enumerate(scene.materials):
        mine = np.flatnonzero(material == k)
        if not len(mine):
            continue
        base = _base(m, uv[mine], grain_m)
        smooth = (1 - m.roughness) ** 2
        fresnel = 0.04 + 0.96 * smooth * (1 - facing[mine, None]) ** 5
        diffuse = base * (light[mine, None] + bounced[mine])
        shine = around[mine] * (0.25 + 0.75 * smooth)
        metal = base * (0.75 * around[mine] + 0.25 * light[mine, None])
        colour[mine] = m.metallic * metal + (1 - m.metallic) * (diffuse * (1 - fresnel) + fresnel * shine)
    return colour


def _surroundings(direction: Doubles) -> Doubles:
    """Return the luminance of a plain studio: light ground, darker walls, bright ceiling."""
    z = direction[:, 2]
    return np.asarray(np.where(z < 0, 0.55 + 0.2 * z, 0.45 + 0.75 * np.clip(z, 0, 1) ** 1.5), dtype=np.float64)


def _base(material: Material, uv: Doubles, grain_m: float) -> Doubles:
    """Return the base colour at texture coordinates; the texture is first averaged to about a pixel's size."""
    factor = np.array(material.base_colour)
    if material.texture is None:
        return np.broadcast_to(factor, (len(uv), 3))
    texture = linear_of_srgb(material.texture)
    if material.texture_m is not None:
        texture = _coarser(texture, grain_m * SUPER * texture.shape[1] / material.texture_m[0])
    tall, wide = texture.shape[:2]
    column = np.floor((uv[:, 0] % 1.0) * wide).astype(int) % wide
    row = np.floor(((1 - uv[:, 1]) % 1.0) * tall).astype(int) % tall
    return np.asarray(factor * texture[row, column])


def _coarser(texture: npt.NDArray[np.float32], cell: float) -> npt.NDArray[np.float32]:
    """Return a texture averaged over blocks of about `cell` texels, a power of two."""
    step = 2 ** max(0, min(6, round(math.log2(max(cell, 1.0)))))
    tall, wide = (n // step * step for n in texture.shape[:2])
    if min(tall, wide) < step:
        return texture
    return np.asarray(texture[:tall, :wide].reshape(tall // step, step, wide // step, step, 3).mean(axis=(1, 3)))


def _ground_grid(scene: Scene) -> tuple[Doubles, float]:
    """Return the middle of the ground around the furniture, and half its side in metres."""
    low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
    return (low + high)[:2] / 2, 1.6 * float(np.linalg.norm(high - low))


def _ground_spots(scene: Scene) -> Doubles:
    middle, reach = _ground_grid(scene)
    line = np.linspace(-reach, reach, GRID)
    gx, gy = np.meshgrid(line, line, indexing="ij")
    return np.column_stack([gx.ravel() + middle[0], gy.ravel() + middle[1], np.zeros(GRID * GRID)])


def _ground(scene: Scene, eye: Eye, rays: Doubles, light: Doubles) -> Doubles:
    """Return the ground's colour, its shadow interpolated in a coarse grid and fading out away from the furniture."""
    middle, reach = _ground_grid(scene)
    gx, gy = np.meshgrid(*[np.linspace(-reach, reach, GRID)] * 2, indexing="ij")
    fade = np.clip((reach - np.hypot(gx, gy)) / (0.4 * reach), 0, 1)
    shade = 1 - fade * (1 - np.clip(light / light.max(), 0, 1).reshape(GRID, GRID)) * 0.85
    colour = np.tile(GROUND, (len(rays), 1))
    down = np.flatnonzero(rays[:, 2] < -1e-6)
    t = -eye.at[2] / rays[down, 2]
    at = (eye.at[:2] + t[:, None] * rays[down, :2] - middle + reach) * (GRID - 1) / (2 * reach)
    near = np.flatnonzero(((at >= 0) & (at < GRID - 1)).all(axis=1))
    cell = np.floor(at[near]).astype(int)
    u, v = (at[near] - cell).T
    i, j = cell.T
    value = (1 - u) * ((1 - v) * shade[i, j] + v * shade[i, j + 1]) + u * (
        (1 - v) * shade[i + 1, j] + v * shade[i + 1, j + 1]
    )
    colour[down[near]] *= value[:, None]
    return colour
