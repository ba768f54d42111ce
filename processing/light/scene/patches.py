"""A scene cut into patches, the texels of its light map: squares on the surfaces, clusters of triangles on furniture.

Each patch has one irradiance and one albedo for what it passes on to others; pictures look closer (`sight`).

Surfaces and panes as triangles."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from processing.errors import ParameterError, SceneError
from processing.ground.arrays import Doubles, Floats, Int32s
from processing.ground.polygons import inside, triangles
from processing.light.scene.scene import Pane, Part, Scene, Surface
from processing.light.solver.kernels import FURNITURE, PANE, Key, Ownership, random

SUBCELLS = 8  # along each side of a texel that an outline cuts
MOST_PATCHES = 200_000  # the shell's texels grow beyond it; chosen, never swept


@dataclass(frozen=True)
class Elements:
    """What patches are made of: triangles and parallelograms, sorted by patch."""

    corner: Floats
    side_a: Floats
    side_b: Floats
    triangular: np.ndarray
    """(E,) bool."""
    upto_m2: Doubles
    """(E,): running sum of areas."""


@dataclass(frozen=True)
class Patches:
    """The patches (n) and the triangles (m) that stand for them where rays fall."""

    triangles: Floats
    """(M, 3, 3)."""
    normals: Floats
    """(M, 3): of triangles, unit."""
    owner: Int32s
    """(M,): the surface's number, or `FURNITURE`, or `PANE`."""
    item: Int32s
    """(M,): of furniture the patch, of panes the pane's number."""
    part: Int32s
    """(M,): of furniture the part's number, else -1."""
    face: Int32s
    """(M,): of furniture the face's number within its part before it was cut, else -1."""
    frames: Doubles
    """(surfaces, 3, 3): origin, u / texel width, v / texel height."""
    grids: Int32s
    """(surfaces, 3): columns, rows, first patch."""
    normal: Floats
    """(N, 3): of patches."""
    area_m2: Doubles
    """(N,): 0 for a texel outside its surface's outline."""
    first: Doubles
    """(N + 1,): where a patch's elements begin in ``elements.upto_m2``, in m2."""
    elements: Elements

    @property
    def count(self) -> int:
        """Return the number of patches."""
        return len(self.area_m2)

    @property
    def ownership(self) -> Ownership:
        """Return whose triangles and patches are, for compiled loops."""
        return Ownership(self.owner, self.item, self.normals, self.frames, self.grids)

    def places(self, patch: np.ndarray, key: Key) -> Floats:
        """Return a random place on each of some patches (K,), uniform over its area: (K, 3)."""
        low, high = self.first[patch], self.first[patch + 1]
        chance = random(key, len(patch), 3)
        goal = low + (high - low) * chance[:, 0]
        e = np.minimum(np.searchsorted(self.elements.upto_m2, goal, side="right"), len(self.elements.upto_m2) - 1)
        a, b = chance[:, 1].astype(np.float32), chance[:, 2].astype(np.float32)
        fold = self.elements.triangular[e] & (a + b > 1)
        a, b = np.where(fold, 1 - a, a)[:, None], np.where(fold, 1 - b, b)[:, None]
        found: Floats = self.elements.corner[e] + a * self.elements.side_a[e] + b * self.elements.side_b[e]
        return found


class _Builder:
    def __init__(self) -> None:
        self.triangles: list[Doubles] = []
        self.tags: list[Int32s] = []
        self.corner: list[Doubles] = []
        self.side_a: list[Doubles] = []
        self.side_b: list[Doubles] = []
        self.triangular: list[np.ndarray] = []
        self.element_patch: list[np.ndarray] = []
        self.normals: list[Doubles] = []
        self.count = 0

    def add_triangles(
        self, corners: Doubles, owner: int, item: npt.ArrayLike = -1, part: int = -1, face: npt.ArrayLike = -1
    ) -> None:
        self.triangles.append(corners)
        tags = np.empty((len(corners), 4), np.int32)
        tags[:, 0], tags[:, 1] = owner, np.asarray(item)
        tags[:, 2], tags[:, 3] = part, np.asarray(face)
        self.tags.append(tags)

    def add_elements(self, patch: np.ndarray, corner: Doubles, a: Doubles, b: Doubles, triangular: bool) -> None:
        self.element_patch.append(np.asarray(patch, np.int64))
        self.corner.append(corner)
        self.side_a.append(np.broadcast_to(a, corner.shape))
        self.side_b.append(np.broadcast_to(b, corner.shape))
        self.triangular.append(np.full(len(corner), triangular))


def patches_of(scene: Scene, texel_m: float = 0.1) -> Patches:
    """Return a scene cut into patches about ``texel_m`` wide; larger ones where there would be too many."""
    if not 0.005 <= texel_m <= 10:
        raise ParameterError(f"texels of {texel_m} m", advice="give 0.005 to 10", texel_m=True)
    whole_m2 = sum(s.width_m * s.height_m for s in scene.surfaces)
    texel_m = max(texel_m, math.sqrt(whole_m2 / MOST_PATCHES))
    build = _Builder()
    frames, grids = [], []
    for number, surface in enumerate(scene.surfaces):
        frame, grid = _add_surface(build, surface, number, texel_m)
        frames.append(frame)
        grids.append(grid)
    for number, pane in enumerate(scene.panes):
        build.add_triangles(pane_triangles(pane), PANE, number)
    for number, part in enumerate(scene.parts):
        _add_part(build, part, number, max(texel_m, 0.02))
    return _finished(build, frames, grids)


def _finished(build: _Builder, frames: list[Doubles], grids: list[list[int]]) -> Patches:
    patch = np.concatenate(build.element_patch)
    order = np.argsort(patch, kind="stable")
    a, b = np.concatenate(build.side_a)[order], np.concatenate(build.side_b)[order]
    triangular = np.concatenate(build.triangular)[order]
    corner = np.concatenate(build.corner)[order].astype(np.float32)
    area = np.linalg.norm(np.cross(a, b), axis=1) * np.where(triangular, 0.5, 1.0)
    upto = np.cumsum(area)
    bounds = np.searchsorted(patch[order], np.arange(build.count + 1))
    first = np.concatenate([[0.0], upto])[bounds]
    corners, tags = np.concatenate(build.triangles), np.concatenate(build.tags)
    return Patches(
        triangles=corners.astype(np.float32),
        normals=_unit_normals(corners).astype(np.float32),
        owner=np.ascontiguousarray(tags[:, 0]),
        item=np.ascontiguousarray(tags[:, 1]),
        part=np.ascontiguousarray(tags[:, 2]),
        face=np.ascontiguousarray(tags[:, 3]),
        frames=np.array(frames, np.float64).reshape(-1, 3, 3),
        grids=np.array(grids, np.int32).reshape(-1, 3),
        normal=np.concatenate(build.normals).astype(np.float32),
        area_m2=np.diff(first),
        first=first,
        elements=Elements(corner, a.astype(np.float32), b.astype(np.float32), triangular, upto),
    )


def _unit_normals(corners: Doubles) -> Doubles:
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30))


def _add_surface(build: _Builder, surface: Surface, number: int, texel_m: float) -> tuple[Doubles, list[int]]:
    columns, rows = max(1, round(surface.width_m / texel_m)), max(1, round(surface.height_m / texel_m))
    wide, high = surface.width_m / columns, surface.height_m / rows
    first = build.count
    build.add_triangles(surface_triangles(surface), number)
    row, column = (g.ravel() for g in np.mgrid[:rows, :columns])
    fine = (np.arange(SUBCELLS) + 0.5) / SUBCELLS
    within = np.stack(
        [_on(surface, (column + fx) * wide, (row + fy) * high) for fy in fine for fx in fine], axis=1
    )  # (texels, SUBCELLS²)
    full: np.ndarray = np.asarray(np.all(within, axis=1))
    patch = first + np.arange(len(row))
    u, v = surface.u_axis, surface.v_axis
    build.add_elements(patch[full], surface.world(column[full] * wide, row[full] * high), wide * u, high * v, False)
    texel, cell = np.nonzero(within & ~full[:, None])
    down, right = np.divmod(cell, SUBCELLS)
    corner = surface.world((column[texel] + right / SUBCELLS) * wide, (row[texel] + down / SUBCELLS) * high)
    build.add_elements(patch[texel], corner, wide / SUBCELLS * u, high / SUBCELLS * v, False)
    build.normals.append(np.broadcast_to(surface.normal, (len(row), 3)))
    build.count += len(row)
    return np.array([surface.origin_m, u / wide, v / high]), [columns, rows, first]


def _on(surface: Surface, u: Doubles, v: Doubles) -> np.ndarray:
    found = inside(surface.outline_m, np.stack([u, v], axis=-1))
    for u0, v0, u1, v1 in surface.holes_m:
        found &= ~((u > u0) & (u < u1) & (v > v0) & (v < v1))
    return found


def _add_part(build: _Builder, part: Part, number: int, cell_m: float) -> None:
    """Cut long triangles, then cluster them by place (a voxel) and by where they face (six sides)."""
    corners = part.vertices_m[part.faces]
    if (np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum() < 0 and _closed(part):
        # Inside out.
        corners = corners[:, ::-1]
    corners, face = _cut(corners, 2 * cell_m)
    normals = _unit_normals(corners)
    side = np.abs(normals).argmax(axis=1)
    side += 3 * (normals[np.arange(len(side)), side] < 0)
    voxel = np.floor(corners.mean(axis=1) / cell_m).astype(np.int64)
    voxel -= voxel.min(axis=0)
    x, y, z = voxel.T
    # One number a cluster, in the order of its parts: NumPy sorts rows of several many times more slowly.
    _, cluster = np.unique(((x * (y.max() + 1) + y) * (z.max() + 1) + z) * 6 + side, return_inverse=True)
    count = int(cluster.max()) + 1
    patch = build.count + cluster
    build.add_triangles(corners, FURNITURE, patch, number, face)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    build.add_elements(patch, corners[:, 0], a, b, True)
    mean = np.zeros((count, 3))
    np.add.at(mean, cluster, np.cross(a, b))
    build.normals.append(mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-30))
    build.count += count


def _closed(part: Part) -> bool:
    """Return whether every edge is shared by two faces that run along it in opposite ways, by place."""
    _, same = np.unique(part.vertices_m.round(6), axis=0, return_inverse=True)
    faces = same.ravel()[part.faces].astype(np.int64)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    return bool(np.array_equal(np.sort(start * len(same) + end), np.sort(end * len(same) + start)))


def _cut(corners: Doubles, longest_m: float) -> tuple[Doubles, Int32s]:
    """Halve the longest edges until none exceeds ``longest_m``; also return which triangle each piece comes from."""
    done, done_from = [], []
    todo, source = corners, np.arange(len(corners), dtype=np.int32)
    while len(todo):
        edges = np.linalg.norm(np.roll(todo, -1, axis=1) - todo, axis=2)
        longest = edges.max(axis=1)
        small, large = np.flatnonzero(longest <= longest_m), np.flatnonzero(longest > longest_m)
        done.append(todo[small])
        done_from.append(source[small])
        todo, source, edges = todo[large], source[large], edges[large]
        if len(todo) > MOST_PATCHES * 4:
            raise SceneError("furniture too large to be cut into patches", advice="check its units: metres")
        k, row = edges.argmax(axis=1), np.arange(len(todo))
        a, b, c = todo[row, k], todo[row, (k + 1) % 3], todo[row, (k + 2) % 3]
        middle = (a + b) / 2
        todo = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        source = np.concatenate([source, source])
    return np.concatenate(done), np.concatenate(done_from)


def surface_triangles(surface: Surface) -> Doubles:
    """Return (M, 3, 3) corners of a surface's triangles, turned so that they face where its normal does."""
    flat = _with_holes(surface) if surface.holes_m else triangles(surface.outline_m)
    corners = surface.world(flat[..., 0], flat[..., 1])
    flips = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ surface.normal < 0
    corners[flips] = corners[flips][:, ::-1]
    return corners


def pane_triangles(pane: Pane) -> Doubles:
    """Return the corners of a pane's two triangles, shape (2, 3, 3), m."""
    a, b = pane.corner_m, pane.corner_m + pane.across_m
    c, d = b + pane.up_m, a + pane.up_m
    return np.array([[a, b, c], [a, c, d]])


def _with_holes(surface: Surface) -> Doubles:
    """Cut a rectangle along all edges of its holes: cells share whole edges, so that no ray slips through."""
    us = np.unique([0.0, surface.width_m, *(h[0] for h in surface.holes_m), *(h[2] for h in surface.holes_m)])
    vs = np.unique([0.0, surface.height_m, *(h[1] for h in surface.holes_m), *(h[3] for h in surface.holes_m)])
    found = []
    for u0, u1 in pairwise(us):
        for v0, v1 in pairwise(vs):
            u, v = (u0 + u1) / 2, (v0 + v1) / 2
            if not any(h[0] < u < h[2] and h[1] < v < h[3] for h in surface.holes_m):
                found += [[(u0, v0), (u1, v0), (u1, v1)], [(u0, v0), (u1, v1), (u0, v1)]]
    # A wall that is all window has nothing left.
    return np.array(found, dtype=np.float64).reshape(-1, 3, 2)
