"""A scene made ready for rays: its patches, their albedo and emission, and a tracer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from processing.ground.arrays import Doubles, Floats, Int32s
from processing.light.scene.patches import FURNITURE, PANE, Patches, patches_of
from processing.light.scene.scene import Part, Scene
from processing.light.scene.tracer import Hits, Tracer, tracer_of
from processing.light.solver.kernels import met_patches
from processing.sphere.resampling import linear_samples

RAYS_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class Stage:
    """A scene with what rays need; costly to make, cheap to use."""

    scene: Scene
    patches: Patches
    tracer: Tracer

    @classmethod
    def of(cls, scene: Scene, texel_m: float = 0.1) -> Stage:
        """Return a scene made ready; ``texel_m`` is the width of its patches."""
        patches = patches_of(scene, texel_m)
        return cls(scene, patches, tracer_of(patches.triangles))

    @cached_property
    def albedo(self) -> Doubles:
        """(patches, 3): mean albedo of each patch."""
        return self._means("albedo")

    @cached_property
    def exitance(self) -> Doubles:
        """(patches, 3): pi times emitted radiance, of lamps."""
        return np.pi * self._means("emission_cd_m2")

    def met(self, origins: Floats, directions: Floats, hits: Hits) -> tuple[Int32s, Floats]:
        """Return which patch each ray (n, 3) met (-1 for panes, backs and nothing) and the cosine there."""
        patch, facing = np.empty(len(directions), np.int32), np.empty(len(directions), np.float32)
        p = self.patches
        met_patches(
            *(origins, directions, hits.triangle, hits.distance_m),
            *(p.owner, p.item, p.normals, p.frames, p.grids, patch, facing),
        )
        return patch, facing

    def _means(self, name: str) -> Doubles:
        found = np.zeros((self.patches.count, 3))
        for surface, (columns, rows, first) in zip(self.scene.surfaces, self.patches.grids, strict=True):
            texture = getattr(surface, name)
            found[first : first + columns * rows] = area_means(texture, int(rows), int(columns)).reshape(-1, 3)
        mine = np.flatnonzero(self.patches.owner == FURNITURE)
        if len(mine):
            self._furniture_means(found, mine, name)
        return found

    def _furniture_means(self, found: Doubles, mine: np.ndarray, name: str) -> None:
        """Average furniture's colour over each patch, by area, from the middle of each triangle."""
        p = self.patches
        corners = p.triangles[mine].astype(np.float64)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        value = np.zeros((len(mine), 3))
        for number, part in enumerate(self.scene.parts):
            chosen = p.part[mine] == number
            if name == "albedo":
                middle = corners[chosen].mean(axis=1)
                value[chosen] = part_albedo(part, p.face[mine][chosen], middle)
            else:
                value[chosen] = part.material.emission_cd_m2
        total = np.zeros(len(found))
        np.add.at(total, p.item[mine], area)
        np.add.at(found, p.item[mine], value * area[:, None])
        seen = total > 0
        found[seen] /= total[seen, None]


def area_means(texture: Floats, rows: int, columns: int) -> Doubles:
    """Return a texture's means over a grid of rows x columns cells that cover it, exact for any sizes."""
    down, across = _shares(texture.shape[0], rows), _shares(texture.shape[1], columns)
    return np.asarray(np.tensordot(across, np.tensordot(down, texture, (1, 0)), (1, 1)).swapaxes(0, 1))


def _shares(fine: int, coarse: int) -> Doubles:
    """Return (coarse, fine): what share of each coarse cell each fine cell is."""
    low, high = np.arange(fine) / fine, (np.arange(fine) + 1) / fine
    start, end = np.arange(coarse)[:, None] / coarse, (np.arange(coarse)[:, None] + 1) / coarse
    return np.asarray(np.maximum(np.minimum(high, end) - np.maximum(low, start), 0) * coarse)


def part_albedo(part: Part, face: Int32s, places: Doubles) -> Doubles:
    """Return the albedo (n, 3) of places (n, 3) on a part's faces (n,); metals count as matte of their base colour."""
    colour = np.broadcast_to(np.asarray(part.material.colour, np.float64), (len(face), 3))
    texture = part.material.texture
    if texture is None or part.uv is None:
        return colour
    s, t = part_shares(part, face, places)
    uv = part.uv[part.faces[face]].astype(np.float64)
    at = uv[:, 0] + s[:, None] * (uv[:, 1] - uv[:, 0]) + t[:, None] * (uv[:, 2] - uv[:, 0])
    high, wide = texture.shape[:2]
    x = np.floor((at[:, 0] % 1.0) * wide).astype(int).clip(0, wide - 1)
    y = np.floor((1 - at[:, 1] % 1.0) * high).astype(int).clip(0, high - 1)
    return np.asarray(colour * texture[y, x])


def part_shares(part: Part, face: Int32s, places: Doubles) -> tuple[Doubles, Doubles]:
    """Return the shares (n,), (n,) that a face's second and third corner have in places (n, 3) on it, 0 to 1."""
    corners = part.vertices_m[part.faces[face]]
    a, b, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], places - corners[:, 0]
    aa, ab, bb = (a * a).sum(1), (a * b).sum(1), (b * b).sum(1)
    wa, wb = (w * a).sum(1), (w * b).sum(1)
    scale = 1 / np.maximum(aa * bb - ab * ab, 1e-30)
    return np.clip((bb * wa - ab * wb) * scale, 0, 1), np.clip((aa * wb - ab * wa) * scale, 0, 1)


def part_normals(part: Part, face: Int32s, places: Doubles) -> Floats | None:
    """Return the smooth normals (n, 3) of places on a part's faces; None for a part whose faces are flat."""
    if part.normals is None:
        return None
    s, t = part_shares(part, face, places)
    three = part.normals[part.faces[face]].astype(np.float64)
    mixed = three[:, 0] + s[:, None] * (three[:, 1] - three[:, 0]) + t[:, None] * (three[:, 2] - three[:, 0])
    return np.asarray(mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-12), dtype=np.float32)


def surface_values(texture: Floats, u: Doubles, v: Doubles) -> Floats:
    """Return a texture's values (n, 3) at places given as shares of its surface's width and height, bilinear."""
    high, wide = texture.shape[:2]
    if high == wide == 1:
        return np.broadcast_to(texture[0, 0], (len(u), 3))
    x = np.clip(u * wide - 0.5, 0, wide - 1).astype(np.float32)
    y = np.clip(v * high - 0.5, 0, high - 1).astype(np.float32)
    # OpenCV's remap takes at most 32,767 columns.
    found = np.empty((len(u), 3), np.float32)
    for start in range(0, len(u), 1 << 14):
        part = slice(start, start + (1 << 14))
        found[part] = linear_samples(np.ascontiguousarray(texture), x[None, part], y[None, part])[0]
    return found


__all__ = ["PANE", "Stage", "area_means", "part_albedo", "part_normals", "part_shares", "surface_values"]
