"""What shell and fixtures are put together from: flat faces with holes, mouldings, places on a wall."""

import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import box as rectangle
from shapely import union_all
from shapely.geometry import Polygon

from mocks.rooms.model import ADE20K, Door, Finish, Material, Part, Plan, Role, Window
from mocks.rooms.plan.forms import inner_angle_rad, openings_of
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles
from processing.ground.mesh import Mesh, merge


def part_of(
    meshes: Mesh | Iterable[Mesh], material: Material, surface: str, ade: str = "wall", role: Role = Role.SHELL
) -> Part:
    """Return one part of the meshes; ``ade`` is the name of its class."""
    return Part(meshes if isinstance(meshes, Mesh) else merge(meshes), material, surface, ADE20K[ade], role)


def on_wall(plan: Plan, wall: int, parts: Iterable[Part]) -> list[Part]:
    """Return parts made in a wall's own frame (x along it, y into the room, z up) in their place in the room."""
    (x, y), _ = plan.wall_ends(wall)
    along, _ = plan.wall_axes(wall)
    turn = math.atan2(along[1], along[0])
    return [part.placed((x, y, 0.0), turn) for part in parts]


def flat(area: Polygon, origin: Vector, u: Vector, v: Vector, back: bool = False) -> Mesh:
    """Return a polygon of the plane (u, v) at ``origin``; its normal is u x v, or against it for the ``back``.

    Texture coordinates are the polygon's own.
    """
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    corners = np.array([shapely.get_coordinates(piece)[:3] for piece in pieces])
    flat_corners, index = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    a, b, c = (corners[:, k] for k in range(3))
    left = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]) > 0
    faces = np.where((left != back)[:, None], faces, faces[:, ::-1])
    axes = np.array([u, v], dtype=np.float64)
    normal = np.cross(axes[0], axes[1]) * (-1.0 if back else 1.0)
    vertices = flat_corners @ axes + np.array(origin)
    return Mesh(vertices, np.tile(normal, (len(vertices), 1)), flat_corners, np.asarray(faces, dtype=np.int32))


def swept(profile: Sequence[tuple[float, float]], start_m: float, end_m: float, cut: tuple[float, float]) -> Mesh:
    """Return a moulding along a wall: its profile of (y, z) swept along x, both ends closed.

    The profile runs so that the body lies to its left when seen against x. ``cut`` is how far each end gives way per
    metre from the wall, the cotangent of half the corner's angle for a mitre.
    """
    line = np.array(profile, dtype=np.float64)
    ends = np.stack([start_m + cut[0] * line[:, 0], end_m - cut[1] * line[:, 0]], axis=1)
    faces = []
    for k in range(len(line)):
        n = (k + 1) % len(line)
        step = line[n] - line[k]
        length = float(np.linalg.norm(step))
        normal = np.array([0.0, step[1], -step[0]]) / length
        low, high = (np.array([[ends[j, e], *line[j]] for e in (0, 1)]) for j in (k, n))
        vertices = np.array([low[0], low[1], high[1], high[0]])
        uv = np.stack([vertices[:, 0], np.array([0.0, 0.0, length, length])], axis=1)
        faces.append(_facing(Mesh(vertices, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]], np.int32))))
    section = Polygon(profile)
    for end, way, slope in ((start_m, -1.0, cut[0]), (end_m, 1.0, -cut[1])):
        cap = flat(section, (end, 0.0, 0.0), (slope, 1.0, 0.0), (0.0, 0.0, 1.0))
        normal = np.array([1.0, -slope, 0.0]) * way / math.hypot(1.0, slope)
        faces.append(_facing(replace(cap, normals=np.tile(normal, (len(cap.vertices), 1)))))
    return merge(faces)


def repeated(mesh: Mesh, moves: Doubles) -> Mesh:
    """Return one mesh of copies of a mesh, each moved by a row of ``moves`` (N, 3)."""
    count, size = len(moves), len(mesh.vertices)
    vertices = (mesh.vertices[None] + np.asarray(moves)[:, None]).reshape(-1, 3)
    faces = (mesh.faces[None] + size * np.arange(count)[:, None, None]).reshape(-1, 3)
    return Mesh(vertices, np.tile(mesh.normals, (count, 1)), np.tile(mesh.uv, (count, 1)), faces.astype(np.int32))


def mirrored(mesh: Mesh, axis: int) -> Mesh:
    """Return the mesh mirrored at the plane through the origin across an axis (0 is x)."""
    way = np.ones(3)
    way[axis] = -1.0
    return replace(
        mesh, vertices=mesh.vertices * way, normals=mesh.normals * way, faces=np.ascontiguousarray(mesh.faces[:, ::-1])
    )


def _facing(mesh: Mesh) -> Mesh:
    """Return the mesh with every face turned the way of its normals."""
    corners: Doubles = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    against = np.einsum("nc,nc->n", across, mesh.normals[mesh.faces[:, 0]]) < 0
    return replace(mesh, faces=np.where(against[:, None], mesh.faces[:, ::-1], mesh.faces).astype(np.int32))


def plan_rng(plan: Plan, number: int) -> np.random.Generator:
    """Return a generator for details that the plan leaves open; equal plans give equal details."""
    return np.random.default_rng([zlib.crc32(repr((plan.polygon, plan.height_m, plan.skirting_m)).encode()), number])


# Floor, ceiling, walls with their holes, skirting and cornice.

LAP_M = 0.002  # how far floor and ceiling reach under the walls, so that no light passes between
ARCHITRAVE_M = 0.065  # chosen: beside a door the skirting ends there
TO_FLOOR_M = 0.15  # a window with a lower sill interrupts the skirting
CORNICE_FROM_M = 2.85  # chosen: lower rooms have none


def floor_and_ceiling(plan: Plan, finish: Finish) -> list[Part]:
    """Return floor and ceiling; texture u runs along the longest wall."""
    (ux, uy), (vx, vy) = plan.wall_axes(max(range(len(plan.polygon)), key=plan.wall_length_m))
    area = Polygon([(x * ux + y * uy, x * vx + y * vy) for x, y in plan.polygon]).buffer(LAP_M, join_style="mitre")
    u, v = (ux, uy, 0.0), (vx, vy, 0.0)
    return [
        part_of(flat(area, (0.0, 0.0, 0.0), u, v), finish.floor, "floor", "floor"),
        part_of(flat(area, (0.0, 0.0, plan.height_m), u, v, back=True), finish.ceiling, "ceiling", "ceiling"),
    ]


def walls(plan: Plan, finish: Finish) -> list[Part]:
    """Return one part per wall, with holes for its windows and doors; texture u runs along the wall from its start."""
    return [_wall(plan, finish, wall) for wall in range(len(plan.polygon))]


def _wall(plan: Plan, finish: Finish, wall: int) -> Part:
    length = plan.wall_length_m(wall)
    holes = union_all([_hole(o) for o in openings_of(plan, wall)])
    area = rectangle(0.0, 0.0, length, plan.height_m).difference(holes)
    face = flat(area, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), back=True)
    part = on_wall(plan, wall, [part_of(face, finish.wall_material(wall), "wall")])[0]
    # Walls share the polygon's very corners: rounding along an edge must leave no gap.
    vertices = part.mesh.vertices.copy()
    for end, corner in zip((0.0, length), plan.wall_ends(wall), strict=True):
        vertices[np.isclose(face.vertices[:, 0], end, atol=1e-9), :2] = corner
    return replace(part, mesh=replace(part.mesh, vertices=vertices), wall=wall)


def _hole(opening: Window | Door) -> Polygon:
    low, height = (opening.sill_m, opening.height_m) if isinstance(opening, Window) else (0.0, opening.height_m)
    return rectangle(opening.start_m, low, opening.start_m + opening.width_m, low + height)


def mouldings(plan: Plan, finish: Finish) -> list[Part]:
    """Return the skirting, and the cornice of some high rooms."""
    rng = plan_rng(plan, 1)
    thick, high = 0.014, plan.skirting_m
    plain = [(0.0, 0.0), (thick, 0.0), (thick, high - 0.006), (thick - 0.005, high), (0.0, high)]
    old = [(0.0, 0.0), (0.018, 0.0), (0.018, high - 0.035), (0.012, high - 0.028), (0.011, high - 0.012)]
    old += [(0.006, high), (0.0, high)]
    profile = old if high > 0.1 else plain
    with_cornice = plan.height_m > CORNICE_FROM_M and rng.random() < 0.6
    top, drop = plan.height_m, float(rng.uniform(0.07, 0.1))
    out = [(0.0, top - drop), (0.012, top - drop), (0.016, top - 0.75 * drop)]
    turns, start = (0.3, 0.7, 1.1, 1.5), top - 0.1 * drop
    bow = [(0.016 + 0.7 * drop * math.sin(a), start - 0.65 * drop * math.cos(a)) for a in turns]
    crown = [*out, *bow, (0.8 * drop + 0.016, top), (0.0, top)]
    found: list[Part] = []
    for wall in range(len(plan.polygon)):
        skirts = [swept(profile, a, b, cut) for a, b, cut in _runs(plan, wall)]
        if skirts:
            found += on_wall(plan, wall, [part_of(skirts, finish.trim, "skirting", role=Role.FIXTURE)])
        if with_cornice:
            run = swept(crown, 0.0, plan.wall_length_m(wall), _mitres(plan, wall))
            found += on_wall(plan, wall, [part_of(run, finish.ceiling, "cornice", "ceiling")])
    return found


def _mitres(plan: Plan, wall: int) -> tuple[float, float]:
    corners = (wall, (wall + 1) % len(plan.polygon))
    a, b = (1.0 / math.tan(inner_angle_rad(plan.polygon, corner) / 2) for corner in corners)
    return a, b


def _runs(plan: Plan, wall: int) -> list[tuple[float, float, tuple[float, float]]]:
    """Return the stretches of a wall that have skirting, with the cuts of their ends."""
    gaps = []
    for o in openings_of(plan, wall):
        if isinstance(o, Door) or o.sill_m < TO_FLOOR_M:
            beside = ARCHITRAVE_M if isinstance(o, Door) else 0.0
            gaps.append((o.start_m - beside, o.start_m + o.width_m + beside))
    first, last = _mitres(plan, wall)
    length = plan.wall_length_m(wall)
    at, cut, runs = 0.0, first, []
    for start, end in sorted(gaps):
        runs.append((at, start, (cut, 0.0)))
        at, cut = end, 0.0
    runs.append((at, length, (cut, last)))
    return [run for run in runs if run[1] - run[0] > 0.02]
