"""What a picture's pixels see: place, normal, colour; from any point, in any geometry."""

import math
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from typing import Any, Self

import numpy as np

from processing.ground.arrays import Doubles, Floats, Indices, Int32s, Reals, Vector
from processing.ground.kernels import compiled
from processing.light.solver.kernels import PANE
from processing.light.solver.stage import Stage, in_parts, on_faces, part_albedo, surface_values
from processing.sphere import Geometry, directions

NOTHING, GLASS, FIRST_PART = -1, -2, 1_000_000
"""Labels of pixels that see nothing, a pane, furniture (FIRST_PART + its part); else the surface's number."""

SHARP = 0.7  # of a pixel's width is averaged: halves are blurred by their sampling already (chosen by looking)
LEAST_FACING = 0.1  # cosine, below which a pixel counts as wide as there: more would blur what is still seen along it
LEAST_AGREEMENT = 0.3
"""Cosine between a smooth normal and its face's, below which the mesh is wrong about it and the face's is taken."""
CELLS, PERIOD_M = 64, 0.8  # of the field of creases, which repeats: cells of 12.5 mm, three pixels of a still at 2 m
CREASE_BANDS = ((0.26, 0.10, 1.0), (0.10, 0.05, 0.35))
"""Longest and shortest wavelength (m) and share of height: folds as of a hand, and small ones (chosen by looking)."""
CREASE_ROUND = 0.25  # of a fold's usual height, within which its edge is round (chosen by looking)


@dataclass(frozen=True)
class Sight:
    """What pixels (n = H x W, row by row) see."""

    shape: tuple[int, int]
    rays: Floats
    """(N, 3), unit."""
    label: Int32s
    pane: Int32s
    """(N,): number of the pane, -1 elsewhere."""
    distance_m: Floats
    point: Floats
    """(N, 3); the eye where nothing is met."""
    normal: Floats
    """(N, 3), towards the eye; 0 where nothing or glass is seen."""
    triangle: Int32s

    @cached_property
    def pixels(self) -> dict[int, Indices]:
        """By label the pixels (K,), ascending, that have it."""
        return by_label(self.label)

    @property
    def solid(self) -> np.ndarray:
        """(N,) whether a surface or furniture is seen."""
        return self.label >= 0

    @property
    def faces(self) -> Self:
        """Return it with label, point and normal alone: two thirds, and all that `upsampled` asks for."""
        none: Any = np.empty(0, np.float32)
        return replace(self, rays=none, pane=none, distance_m=none, triangle=none)

    def some(self, pixels: np.ndarray) -> Self:
        """Return what some pixels (K,) see, as one row."""
        taken = {field.name: getattr(self, field.name)[pixels] for field in fields(self)[1:]}
        return replace(self, shape=(1, len(pixels)), **taken)

    def picture(self, values: Reals, pixels: Indices) -> Floats:
        """Return values (K, 3) of some pixels (K,) as a picture (H, W, 3), 0 elsewhere."""
        out = np.zeros((len(self.label), 3), np.float32)
        out[pixels] = values
        return out.reshape(*self.shape, 3)


def sight_of(stage: Stage, geometry: Geometry, eye_m: Vector) -> Sight:
    """Return what the middle of each pixel sees from ``eye_m``."""
    rays, _ = directions(geometry)
    shape = (rays.shape[0], rays.shape[1])
    return sight_along(stage, np.ascontiguousarray(rays.reshape(-1, 3), dtype=np.float32), eye_m, shape)


def sight_along(stage: Stage, rays: Floats, eye_m: Vector, shape: tuple[int, int]) -> Sight:
    """Return what rays (N, 3) from a point see."""
    eye = np.asarray(eye_m, np.float32)
    triangle, distance = np.empty(len(rays), np.int32), np.empty(len(rays), np.float32)
    for part in in_parts(len(rays)):
        hits = stage.tracer.cast(np.broadcast_to(eye, rays[part].shape), rays[part])
        triangle[part], distance[part] = hits.triangle, hits.distance_m
    p, count = stage.patches, len(rays)
    label, pane = np.empty(count, np.int32), np.empty(count, np.int32)
    point, normal = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    _see(rays, triangle, distance, eye, (p.owner, p.item, p.part, p.normals), (label, pane), point, normal)
    # Normals of round furniture turn as its shape does, never beyond the edge of what faces the eye.
    for number, chosen in by_label(label, FIRST_PART).items():
        shown = stage.scene.parts[number - FIRST_PART]
        if shown.normals is not None:
            face, places = stage.patches.face[triangle[chosen]], point[chosen].astype(np.float64)
            _turn(on_faces(shown, np.asarray(shown.normals, np.float64), face, places), chosen, normal)
        if shown.material.creases > 0:
            crease(point, rays, shown.material.creases, crease_slopes(), chosen, normal)
    return Sight(shape, rays, label, pane, distance, point, normal, triangle)


@compiled
def _see(rays, triangle, distance, eye, whose, names, point, normal):  # type: ignore[no-untyped-def]
    """Fill what rays (N, 3) from ``eye`` see, by the triangles that they met; ``whose``: owner, item, part, normals."""
    (owner, item, part, normals), (label, pane) = whose, names
    for i in range(rays.shape[0]):
        t = triangle[i]
        label[i], pane[i] = NOTHING, -1
        if t >= 0 and owner[t] == PANE:
            label[i], pane[i] = GLASS, item[t]
        elif t >= 0:
            label[i] = owner[t] if owner[t] >= 0 else FIRST_PART + part[t]
        turned = np.float32(0)
        for c in range(3):
            point[i, c] = eye[c] + (rays[i, c] * distance[i] if t >= 0 else np.float32(0))
            normal[i, c] = normals[t, c] if label[i] >= 0 else np.float32(0)
            turned += normal[i, c] * rays[i, c]
        if turned > 0:
            for c in range(3):
                normal[i, c] = -normal[i, c]


def by_label(label: Int32s, least: int | None = None) -> dict[int, Indices]:
    """Return by label (N,) the places (K,), ascending, that have it; of labels from ``least`` on alone."""
    chosen = np.arange(len(label)) if least is None else np.flatnonzero(label >= least)
    order = chosen[np.argsort(label[chosen], kind="stable")]
    first = np.flatnonzero(np.diff(label[order], prepend=np.iinfo(np.int32).min))
    return {int(label[part[0]]): part for part in np.split(order, first[1:]) if len(part)}


@compiled
def _turn(smooth, chosen, normal):  # type: ignore[no-untyped-def]
    """Put smooth normals (K, 3), of any length, in place of those of pixels chosen (K,) where the two agree."""
    for i in range(chosen.shape[0]):
        n, length, agree = chosen[i], 0.0, 0.0
        for c in range(3):
            length += smooth[i, c] * smooth[i, c]
            agree += smooth[i, c] * normal[n, c]
        length = max(math.sqrt(length), 1e-12) * (-1.0 if agree < 0 else 1.0)
        if agree / length > LEAST_AGREEMENT:
            for c in range(3):
                normal[n, c] = smooth[i, c] / length


@cache
def crease_slopes() -> Floats:
    """Return the gradient (CELLS, CELLS, CELLS, 3) of the field's height, of root mean square 1, cells along x, y, z.

    Cloth is flat between sharp folds, where a smooth field changes its sign: height is the size of that field."""
    rng, at = np.random.default_rng(2207), np.fft.fftfreq(CELLS, PERIOD_M / CELLS)
    waves = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1)
    per_m, height = np.linalg.norm(waves, axis=-1), np.zeros((CELLS,) * 3)
    for longest_m, shortest_m, share in CREASE_BANDS:
        band = (per_m > 1 / longest_m) & (per_m < 1 / shortest_m)
        field = np.fft.ifftn(np.fft.fftn(rng.normal(size=height.shape)) * band).real
        height += share * shortest_m * np.hypot(field / field.std(), CREASE_ROUND)
    turned = np.fft.fftn(height)[..., None] * 2j * math.pi * waves
    slope = np.fft.ifftn(turned, axes=(0, 1, 2)).real
    return np.ascontiguousarray(slope / np.sqrt((slope**2).sum(axis=-1).mean()), np.float32)


@compiled
def crease(point, rays, amount, slope, chosen, normal):  # type: ignore[no-untyped-def]
    """Lean the unit normals (N, 3) of pixels ``chosen`` (K,), seen at ``point`` (N, 3), m, along ``rays`` (N, 3).

    By bump mapping (Blinn 1978); never away from the eye. ``amount``: root mean square of the slopes in space, of which
    a surface cuts two thirds of the square. ``slope``: `crease_slopes`."""
    cells, lean, turned = slope.shape[0], np.empty(3), np.empty(3)
    for n in chosen:
        x, y, z = (point[n, 0] / PERIOD_M) * cells, (point[n, 1] / PERIOD_M) * cells, (point[n, 2] / PERIOD_M) * cells
        i, j, k = math.floor(x), math.floor(y), math.floor(z)
        lean[:] = 0
        for corner in range(8):
            a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
            share = (x - i if a else i + 1 - x) * (y - j if b else j + 1 - y) * (z - k if c else k + 1 - z)
            for v in range(3):
                lean[v] += share * slope[(i + a) % cells, (j + b) % cells, (k + c) % cells, v]
        along = lean[0] * normal[n, 0] + lean[1] * normal[n, 1] + lean[2] * normal[n, 2]
        length, facing = 0.0, 0.0
        for v in range(3):
            turned[v] = normal[n, v] - amount * (lean[v] - along * normal[n, v])
            length += turned[v] * turned[v]
            facing += turned[v] * rays[n, v]
        if facing < 0:
            for v in range(3):
                normal[n, v] = turned[v] / math.sqrt(length)


def albedo_of(stage: Stage, sight: Sight, pixel_rad: float = 0.0) -> Floats:
    """Return the albedo (N, 3) that pixels see, 0 for glass and nothing; textures are sampled bilinearly.

    ``pixel_rad``: how wide a pixel is; furniture has its textures averaged over that, as cloth is finer; 0: points."""
    return _colours(stage, sight, "albedo", pixel_rad)


def emission_of(stage: Stage, sight: Sight) -> Floats:
    """Return the radiance (N, 3) that seen surfaces give off by themselves."""
    return _colours(stage, sight, "emission_cd_m2")


def _colours(stage: Stage, sight: Sight, name: str, pixel_rad: float = 0.0) -> Floats:
    out = np.zeros((len(sight.label), 3), np.float32)
    for number, chosen in sight.pixels.items():
        if number < 0:
            continue
        one = _one_colour(stage, number, name)
        if one is not None:
            if one.any():
                out[chosen] = one
            continue
        if number >= FIRST_PART:
            part = stage.scene.parts[number - FIRST_PART]
            face = stage.patches.face[sight.triangle[chosen]]
            facing = np.abs(np.einsum("ij,ij->i", sight.normal[chosen], sight.rays[chosen], dtype=np.float64))
            wide_m = SHARP * pixel_rad * sight.distance_m[chosen] / np.sqrt(np.maximum(facing, LEAST_FACING))
            out[chosen] = part_albedo(part, face, sight.point[chosen].astype(np.float64), wide_m)
        else:
            surface = stage.scene.surfaces[number]
            offset = sight.point[chosen].astype(np.float64) - surface.origin_m
            u, v = offset @ surface.u_axis / surface.width_m, offset @ surface.v_axis / surface.height_m
            out[chosen] = surface_values(getattr(surface, name), u, v)
    return out


def _one_colour(stage: Stage, number: int, name: str) -> Floats | None:
    """Return the one colour (3,) of a surface or part, or None where it has a texture."""
    if number < FIRST_PART:
        texture = getattr(stage.scene.surfaces[number], name)
        return np.asarray(texture[0, 0], np.float32) if texture.shape[:2] == (1, 1) else None
    part = stage.scene.parts[number - FIRST_PART]
    if name != "albedo":
        return np.asarray(part.material.emission_cd_m2, np.float32)
    textured = part.material.texture is not None and part.uv is not None
    return None if textured else np.asarray(part.material.colour, np.float32)


def seen_outdoors(stage: Stage, sight: Sight) -> Floats:
    """Return the radiance (N, 3) seen through glass, 0 elsewhere; the sun's disc is not drawn."""
    out = np.zeros((len(sight.label), 3), np.float32)
    for number, pane in enumerate(stage.scene.panes):
        mine = np.flatnonzero((sight.label == GLASS) & (sight.pane == number))
        outside = looked_up(stage.scene.outdoors.rgb, sight.rays[mine]) * pane.through(sight.rays[mine])
        # Between cells, which are far larger than pixels, cover and veil change evenly: a window would look tiled.
        cells = np.repeat(pane.clear[..., None], 3, axis=2), pane.veil_cd_m2
        clear, veil = (surface_values(one, *pane.shares(sight.point[mine])) for one in cells)
        out[mine] = clear * outside + veil
    return out


def looked_up(panorama: Floats, rays: Floats) -> Floats:
    """Return a panorama's values (N, 3) along rays (N, 3), bilinear."""
    rows, columns = panorama.shape[:2]
    x = (np.arctan2(rays[:, 0], rays[:, 1]) / (2 * np.pi) + 0.5) % 1.0
    y = 0.5 - np.arcsin(np.clip(rays[:, 2], -1, 1)) / np.pi
    wrapped = np.concatenate([panorama[:, -1:], panorama, panorama[:, :1]], axis=1)
    u: Doubles = (x.astype(np.float64) * columns + 1) / (columns + 2)
    return surface_values(wrapped, u, np.clip(y.astype(np.float64), 0.5 / rows, 1 - 0.5 / rows))


def own_pixels(
    panorama: Floats, labels: Int32s, rays: Floats, label: Int32s, *, least: float = 0.0
) -> tuple[Doubles, Doubles]:
    """Return a panorama's values (N, 3) along rays from the four pixels around, and what share of them could be used.

    Of use are pixels whose label, of ``labels`` (H, W), is the ray's own (N,); ``least`` is added to each one's share.
    """
    rows, columns = labels.shape
    x = (np.arctan2(rays[:, 0], rays[:, 1]) / (2 * np.pi) + 0.5) * columns - 0.5
    y = (0.5 - np.arcsin(np.clip(rays[:, 2], -1, 1)) / np.pi) * rows - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    value, weight = np.zeros((len(rays), 3)), np.zeros(len(rays))
    for right in (0, 1):
        for down in (0, 1):
            column, row = (left + right) % columns, np.clip(top + down, 0, rows - 1)
            share = np.abs(1 - right - (x - left)) * np.abs(1 - down - (y - top))
            share = np.where(labels[row, column] == label, share + least, 0)
            value += share[:, None] * panorama[row, column]
            weight += share
    return value / np.maximum(weight, 1e-9)[:, None], weight
