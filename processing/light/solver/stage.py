"""A scene made ready for rays: its patches, their albedo and emission, and a tracer."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats, Int32s, bands
from processing.ground.kernels import compiled
from processing.light.scene.patches import Patches, patches_of
from processing.light.scene.scene import Outdoors, Pane, Part, Scene
from processing.light.scene.tracer import Hits, Tracer, tracer_of
from processing.light.solver.kernels import FURNITURE, met_patches
from processing.sphere.resampling import linear_samples

RAYS_AT_ONCE = 1 << 19


def in_parts(count: int, rays: int = 1) -> Iterator[slice]:
    """Return parts of ``count`` places, of `RAYS_AT_ONCE` at most with so many ``rays`` each."""
    return bands(count, max(1, RAYS_AT_ONCE // rays))


@dataclass(frozen=True)
class Stage:
    """A scene with what rays need; costly to make, cheap to use."""

    scene: Scene
    patches: Patches
    tracer: Tracer
    albedo: Doubles
    """(P, 3): mean albedo of each patch."""
    exitance: Doubles
    """(P, 3) lm/m2: pi times emitted radiance, of lamps."""

    @classmethod
    def of(cls, scene: Scene, texel_m: float = 0.1) -> Self:
        """Return a scene made ready; ``texel_m`` is the width of its patches."""
        patches = patches_of(scene, texel_m)
        albedo = _patch_means(scene, patches, "albedo")
        exitance = np.pi * _patch_means(scene, patches, "emission_cd_m2")
        return cls(scene, patches, tracer_of(patches.triangles), albedo, exitance)

    def under(self, outdoors: Outdoors, panes: tuple[Pane, ...]) -> Self:
        """Return the same room in another light, seen through these panes of the same size."""
        return replace(self, scene=replace(self.scene, outdoors=outdoors, panes=panes))

    def met(self, origins: Floats, directions: Floats, hits: Hits) -> tuple[Int32s, Floats]:
        """Return which patch each ray met (N,) (-1 for panes, backs and nothing) and the cosine there (N,).

        ``origins`` (N, 3), m; ``directions`` (N, 3), unit."""
        patch, facing = np.empty(len(directions), np.int32), np.empty(len(directions), np.float32)
        met_patches(origins, directions, hits.triangle, hits.distance_m, self.patches.ownership, patch, facing)
        return patch, facing


def _patch_means(scene: Scene, patches: Patches, name: str) -> Doubles:
    """Return the means (P, 3) of a texture of surfaces and parts over each patch."""
    means = np.zeros((patches.count, 3))
    for surface, (columns, rows, first) in zip(scene.surfaces, patches.grids, strict=True):
        texture = getattr(surface, name)
        means[first : first + columns * rows] = area_means(texture, int(rows), int(columns)).reshape(-1, 3)
    mine = np.flatnonzero(patches.owner == FURNITURE)
    if not len(mine):
        return means
    # Furniture's colour by area, from the middle of each triangle.
    corners = patches.triangles[mine].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    value = np.zeros((len(mine), 3))
    for number, part in enumerate(scene.parts):
        chosen = patches.part[mine] == number
        if name == "albedo":
            value[chosen] = part_albedo(part, patches.face[mine][chosen], corners[chosen].mean(axis=1))
        else:
            value[chosen] = part.material.emission_cd_m2
    total = np.zeros(len(means))
    np.add.at(total, patches.item[mine], area)
    np.add.at(means, patches.item[mine], value * area[:, None])
    seen = total > 0
    means[seen] /= total[seen, None]
    return means


def area_means(texture: Floats, rows: int, columns: int) -> Doubles:
    """Return the means of a texture (H, W, K) over a grid of cells that covers it: (rows, columns, K), exact."""
    down, across = _shares(texture.shape[0], rows), _shares(texture.shape[1], columns)
    return np.asarray(np.tensordot(across, np.tensordot(down, texture, (1, 0)), (1, 1)).swapaxes(0, 1))


def _shares(fine: int, coarse: int) -> Doubles:
    """Return (coarse, fine): what share of each coarse cell each fine cell is."""
    low, high = np.arange(fine) / fine, (np.arange(fine) + 1) / fine
    start, end = np.arange(coarse)[:, None] / coarse, (np.arange(coarse)[:, None] + 1) / coarse
    return np.asarray(np.maximum(np.minimum(high, end) - np.maximum(low, start), 0) * coarse)


def part_albedo(part: Part, face: Int32s, places: Doubles, wide_m: Doubles | float = 0.0) -> Doubles:
    """Return the albedo (N, 3) of places (N, 3), m, on a part's faces (N,); metals count as matte, of their own colour.

    ``wide_m`` (N,): of what a pixel shows of each place; a texture is averaged over it (trilinear); 0: points."""
    colour = np.array(part.material.colour, np.float64)
    texture = part.material.texture
    if texture is None or part.uv is None:
        return np.broadcast_to(colour, (len(face), 3))
    uv = on_faces(part, np.asarray(part.uv, np.float64), face, places)
    u, v = uv[:, 0] % 1.0, 1 - uv[:, 1] % 1.0
    level, found = np.log2(np.maximum(wide_m * part.texels_per_m, np.ones(len(face)))), np.zeros((len(face), 3))
    level = np.minimum(level, len(part.levels) - 1)
    for number, smaller in enumerate(part.levels[: int(level.max(initial=0)) + 2]):
        share = np.maximum(1 - np.abs(level - number), 0)
        mine = np.flatnonzero(share)
        found[mine] += share[mine, None] * _sampled(smaller, u[mine], v[mine], cv2.BORDER_WRAP)
    return colour * found


def on_faces(part: Part, values: Doubles, face: Int32s, places: Doubles) -> Doubles:
    """Return values (V, K) of a part's corners, mixed to (N, K) at places (N, 3), m, on its faces (N,)."""
    out = np.empty((len(face), values.shape[1]))
    _mix_corners(np.ascontiguousarray(part.vertices_m), np.ascontiguousarray(part.faces), values, face, places, out)
    return out


@compiled
def _mix_corners(vertices, faces, values, face, places, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` (N, K); see `on_faces`. Shares of a face's second and third corner are held to 0 to 1."""
    for i in range(face.shape[0]):
        p, q, r = faces[face[i], 0], faces[face[i], 1], faces[face[i], 2]
        aa = ab = bb = wa = wb = 0.0
        for c in range(3):
            a, b = vertices[q, c] - vertices[p, c], vertices[r, c] - vertices[p, c]
            w = places[i, c] - vertices[p, c]
            aa, ab, bb, wa, wb = aa + a * a, ab + a * b, bb + b * b, wa + w * a, wb + w * b
        scale = 1 / max(aa * bb - ab * ab, 1e-30)
        s = min(max((bb * wa - ab * wb) * scale, 0.0), 1.0)
        t = min(max((aa * wb - ab * wa) * scale, 0.0), 1.0)
        for k in range(values.shape[1]):
            first = values[p, k]
            out[i, k] = first + s * (values[q, k] - first) + t * (values[r, k] - first)


def surface_values(texture: Floats, u: Doubles, v: Doubles) -> Floats:
    """Return values (N, 3) of a texture (H, W, 3) at ``u``, ``v`` (N,), shares of its width and height, bilinear."""
    if texture.shape[:2] == (1, 1):
        return np.broadcast_to(texture[0, 0], (len(u), 3))
    return _sampled(texture, u, v, cv2.BORDER_REPLICATE)


def _sampled(texture: Floats, u: Doubles, v: Doubles, border: int) -> Floats:
    x = (u * texture.shape[1] - 0.5).astype(np.float32)
    y = (v * texture.shape[0] - 0.5).astype(np.float32)
    # OpenCV's remap takes at most 32,767 columns.
    found, texels = np.empty((len(u), 3), np.float32), np.ascontiguousarray(texture, np.float32)
    for part in bands(len(u), 1 << 14):
        found[part] = linear_samples(texels, x[None, part], y[None, part], border)[0]
    return found
