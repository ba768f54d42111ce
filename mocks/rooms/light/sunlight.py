"""Direct sunlight in a room: which points see the sun's disc through a pane, and how much of it."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mocks.rooms.light.geometry import Geometry
from mocks.rooms.shell.openings import Pane
from mocks.worlds.light import BrightDisc, Vector
from processing.ground.arrays import Doubles, Flags, Floats
from processing.ground.mesh import Mesh

_RIM, _FILL = 6, 32
_LIFT_M = 1e-3  # chosen: rays leave their own surface


def sun_share(geometry: Geometry, panes: Sequence[Pane], sun: BrightDisc, points: Floats, normals: Floats) -> Floats:
    """Return how much of the sun's disc each point (N, 3) on a surface sees, 0..1; 0 where it faces away.

    Points whose rays to the disc's rim and middle agree are done; only those in a penumbra get 32 rays.
    """
    share = np.zeros(len(points), np.float32)
    direction = np.array(sun.direction, np.float32)
    rays = _disc_rays(sun, _RIM)
    facing = np.flatnonzero(normals @ direction > 1e-4)
    near = facing[_may_see(panes, sun, points[facing])]
    if near.size == 0:
        return share
    start = points[near] + normals[near] * np.float32(_LIFT_M)
    coarse = _visible(geometry, start, rays)
    share[near] = coarse
    edge = np.flatnonzero((coarse > 0) & (coarse < 1))
    if edge.size:
        share[near[edge]] = _visible(geometry, start[edge], _disc_rays(sun, _FILL))
    return share


def enters(panes: Sequence[Pane], sun: BrightDisc | None) -> bool:
    """Return whether the sun shines on any pane from outside."""
    return sun is not None and any(float(np.dot(outward(pane), sun.direction)) > 1e-3 for pane in panes)


def outward(pane: Pane) -> Doubles:
    """Return the unit normal, shape (3,), of a pane, outwards."""
    normal = np.cross(np.array(pane.u), np.array(pane.v))
    return np.asarray(normal / np.linalg.norm(normal))


def _may_see(panes: Sequence[Pane], sun: BrightDisc, points: Floats) -> Flags:
    """Return which points' rays to the sun pass near a window: cheap, and true for all that see the sun."""
    beam = np.array(sun.direction)
    out = np.zeros(len(points), bool)
    for corner, u, v in windows_of(panes):
        width, height = np.linalg.norm(u), np.linalg.norm(v)
        normal = np.cross(u, v) / (width * height)
        steep = float(beam @ normal)
        if abs(steep) < 1e-6:
            continue
        to_pane = (points @ (-normal / steep).astype(np.float32)) + np.float32(corner @ normal / steep)
        # Along u and v, where the ray from a point meets the window's plane: linear in the point.
        ahead = to_pane > 0
        margin = np.float32(2.0 * sun.radius_rad / abs(steep)) * to_pane + np.float32(0.01)
        for side, length in ((u / width, width), (v / height, height)):
            place = points @ side.astype(np.float32) + to_pane * np.float32(beam @ side) - np.float32(corner @ side)
            ahead &= (place > -margin) & (place < np.float32(length) + margin)
        out |= ahead
    return out


def windows_of(panes: Sequence[Pane]) -> Iterator[tuple[Doubles, Doubles, Doubles]]:
    """Yield corner and sides u, v (metres, shape (3,)) of the rectangle of each window's panes; u x v looks outside."""
    groups: dict[int, list[Pane]] = {}
    for pane in panes:
        groups.setdefault(pane.window, []).append(pane)
    for group in groups.values():
        first = np.array(group[0].corner, np.float64)
        u, v = (np.array(side, np.float64) for side in (group[0].u, group[0].v))
        u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
        corners = np.array(
            [np.array(p.corner) + a * np.array(p.u) + b * np.array(p.v) for p in group for a in (0, 1) for b in (0, 1)]
        )
        along, up = (corners - first) @ u, (corners - first) @ v
        yield first + along.min() * u + up.min() * v, np.ptp(along) * u, np.ptp(up) * v


def _visible(geometry: Geometry, points: Floats, rays: Floats) -> Floats:
    seen = np.zeros(len(points), np.float32)
    for ray in rays:
        seen += ~geometry.blocked(points, np.broadcast_to(ray, points.shape))
    return seen / np.float32(len(rays))


def _disc_rays(sun: BrightDisc, count: int) -> Floats:
    """Return directions spread evenly over the disc; few lie on its rim and in its middle."""
    middle = np.array(sun.direction)
    aside = np.cross(middle, (0.0, 0.0, 1.0) if abs(middle[2]) < 0.9 else (1.0, 0.0, 0.0))
    aside /= np.linalg.norm(aside)
    above = np.cross(middle, aside)
    index = np.arange(count)
    if count == _RIM:
        radius = np.where(index == 0, 0.0, sun.radius_rad * 0.98)
        turn = index * (2 * math.pi / (count - 1))
    else:
        radius = sun.radius_rad * np.sqrt((index + 0.5) / count)
        turn = index * (math.pi * (3 - math.sqrt(5)))
    rays = middle + np.tan(radius)[:, None] * (np.cos(turn)[:, None] * aside + np.sin(turn)[:, None] * above)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), dtype=np.float32)


# Sunlight's first bounce: the patches that the sun paints in a room, as small lamps for the renderer. A path tracer
# finds a small bright patch by chance, and so noisily. The patches are known: parallel rays through a grid of cells on
# each window give, cell by cell, the parallelogram that it lights; together they tile the sunlit surfaces.

CELL_M = 0.03  # chosen: of the grid of beams through a window
_BEAM_LIFT_M = 5e-4  # chosen: the same, for the beam
_GRAZING = 0.03  # chosen: cosine below which a beam's patch gets too long


@dataclass(frozen=True)
class SunPatch:
    """What the sun lights of one part at one slope: a lamp of even radiance, matte with the part's albedo."""

    mesh: Mesh
    albedo: Vector
    radiance_rgb: Vector

    @property
    def power(self) -> float:
        """Area times radiance: the patch's share of the light."""
        corners = self.mesh.vertices[self.mesh.faces]
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(np.linalg.norm(sides, axis=1).sum() / 2 * sum(self.radiance_rgb))


def sun_patches(
    geometry: Geometry, panes: Sequence[Pane], direction: Vector, normal_illuminance_rgb: Vector
) -> tuple[SunPatch, ...]:
    """Return what the sun lights, given the direction to it and the illuminance (lx, RGB) on a plane facing it."""
    sun = np.array(direction)
    found = [_lit(geometry, window, sun) for window in windows_of(panes) if np.cross(window[1], window[2]) @ sun > 0]
    if not found:
        return ()
    part, normal, corners = (np.concatenate(pieces) for pieces in zip(*found, strict=True))
    kinds, kind_of = np.unique(np.column_stack([part, np.round(normal, 2) + 0.0]), axis=0, return_inverse=True)
    patches = []
    for number, kind in enumerate(kinds):
        mine = kind_of.ravel() == number
        albedo = geometry.parts[int(kind[0])].material.colour
        slope = float((normal[mine] @ sun).mean())
        light = [a * e * slope / math.pi for a, e in zip(albedo, normal_illuminance_rgb, strict=True)]
        patches.append(SunPatch(_tiles(corners[mine], normal[mine]), albedo, (light[0], light[1], light[2])))
    return tuple(patches)


def _lit(
    geometry: Geometry, window: tuple[Doubles, Doubles, Doubles], towards: Doubles
) -> tuple[Doubles, Doubles, Doubles]:
    """Cast a ray of the sun through every cell of a window and lay the cell's shadow where it ends.

    Returns of the lit cells the part (N,), the surface's normal (N, 3), and the cell's corners (N, 4, 3)."""
    corner, u, v = window
    across, up = (max(1, round(float(np.linalg.norm(side)) / CELL_M)) for side in (u, v))
    a, b = np.meshgrid((np.arange(across) + 0.5) / across, (np.arange(up) + 0.5) / up)
    start = corner + a.reshape(-1, 1) * u + b.reshape(-1, 1) * v
    hits = geometry.cast(start.astype(np.float32), np.broadcast_to(-towards.astype(np.float32), start.shape))
    normal = geometry.face_normals[hits.face].astype(np.float64)
    normal *= np.where(normal @ towards < 0, -1, 1)[:, None]
    slope = normal @ towards
    good = np.flatnonzero((hits.face >= 0) & (slope > _GRAZING))
    normal, slope = normal[good], slope[good]
    middle = start[good] - towards * hits.distance_m[good, None] + normal * _BEAM_LIFT_M
    half_u, half_v = ((side - towards * ((normal @ side) / slope)[:, None]) / 2 for side in (u / across, v / up))
    ring = [middle - half_u - half_v, middle + half_u - half_v, middle + half_u + half_v, middle - half_u + half_v]
    return geometry.part_of[hits.face[good]].astype(np.float64), normal, np.stack(ring, axis=1)


def _tiles(corners: Doubles, normal: Doubles) -> Mesh:
    """Return parallelograms as a mesh that shows its front to where the normals point."""
    count = len(corners)
    turn = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    backwards = np.einsum("ij,ij->i", turn, normal) < 0
    corners = np.where(backwards[:, None, None], corners[:, ::-1], corners)
    halves = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    faces = (4 * np.arange(count, dtype=np.int32)[:, None, None] + halves).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), np.repeat(normal, 4, axis=0), np.zeros((4 * count, 2)), faces)
