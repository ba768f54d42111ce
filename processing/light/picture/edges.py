"""Furniture's edges in a large picture: smooth, as a lens shows them, not stairs.

A pixel that an edge of furniture crosses, as its mesh has it or as the pixels around show it, is looked at by several
rays: a groove, a slat or a rod narrower than a pixel would else be broken into dashes. Each ray takes the colour that
the nearest pixel shows of the same face, and is shaded itself where none does; room that appears beside an edge is the
photograph's own pixel, with the change of light of its neighbours."""

from collections.abc import Callable
from typing import NamedTuple, Self

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats, Int32s, UInt16s, Vector
from processing.ground.kernels import compiled, inlined
from processing.light.scene.scene import Part
from processing.light.solver.kernels import FIRST, SECOND
from processing.light.solver.sight import FIRST_PART, Sight, sight_along
from processing.light.solver.stage import Stage, in_parts
from processing.light.solver.upsample import Places
from processing.sphere import Equirectangular, pixels

MOST_GAIN = 4.0  # by which new furniture may brighten a place of the room where no sun comes back; chosen
RAYS = 8  # in each pixel of an edge
STEP_M, SAME_M, TURNED = 0.01, 0.002, 0.9
"""Height of a step, and cosine between normals, from which two pixels of one part are an edge; height up to which a ray
meets the face that a pixel shows."""
NONE_MM = np.iinfo(np.uint16).max  # where no edge is: as far as no room is long


def bounded(gain: Floats, most: Floats | float = MOST_GAIN) -> Floats:
    """Return gains (N, 3) or (H, W, 3), no channel above ``most`` (N, 1), in their own colour: by channels it
    would be another one."""
    return np.asarray(gain * np.minimum(most / np.maximum(gain.max(axis=-1, keepdims=True), 1e-9), 1), np.float32)


class Lens(NamedTuple):
    """How a whole panorama is looked at."""

    stage: Stage
    eye_m: Vector
    crossed_mm: UInt16s
    """(H, W): how far the nearest edge is that crosses a pixel (`crossed_pixels`), `NONE_MM` without one."""
    shade: Callable[[Sight, Places], Floats]
    """Gives the radiance (N, 3) of what rays see of furniture, and in which pixels they lie."""


def crossed_pixels(stage: Stage, shape: tuple[int, int], eye_m: Vector) -> UInt16s:
    """Return how far, mm, the nearest edge of furniture is that crosses each pixel of a panorama (H, W).

    Edges are where a mesh ends, turns away from the eye, or is creased; hidden ones are among them."""
    out, geometry = np.full(shape[0] * shape[1], NONE_MM, np.uint16), Equirectangular(shape[1], shape[0])
    for part in stage.scene.parts:
        ends = _edges_of(part, eye_m)
        far = np.maximum(np.linalg.norm(ends, axis=2), 1e-6)
        # Steps are even along the edge: nearer parts of it look longer, and columns narrow towards the poles.
        turn = np.linalg.norm(np.diff(ends / far[..., None], axis=1)[:, 0], axis=1)
        level = np.clip((np.linalg.norm(ends[..., :2], axis=2) / far).min(axis=1), 0.1, 1)
        longer = np.minimum(far.max(axis=1) / far.min(axis=1), 4.0) / level
        steps = np.ceil(2 * turn * shape[0] / np.pi * longer).astype(np.int64) + 1
        edge = np.repeat(np.arange(len(ends)), steps)
        share = (np.arange(len(edge)) - np.repeat(np.cumsum(steps) - steps, steps) + 0.5) / steps[edge]
        places = ends[edge, 0] + share[:, None] * (ends[edge, 1] - ends[edge, 0])
        x, y, _ = pixels(geometry, places)
        at = y.astype(np.int64).clip(0, shape[0] - 1) * shape[1] + x.astype(np.int64) % shape[1]
        np.minimum.at(out, at, np.minimum(1000 * np.linalg.norm(places, axis=1), NONE_MM - 1).astype(np.uint16))
    return out.reshape(shape)


def _edges_of(part: Part, eye_m: Vector) -> Doubles:
    """Return a part's edges (E, 2, 3) that are seen as such, from the eye; corners at one place are one."""
    import trimesh

    mesh = trimesh.Trimesh(part.vertices_m - np.asarray(eye_m), part.faces, process=False)
    mesh.merge_vertices(digits_vertex=4)
    facing = (np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0]) < 0)[mesh.face_adjacency]
    creased = np.cos(mesh.face_adjacency_angles) < TURNED
    seen = mesh.face_adjacency_edges[facing.any(axis=1) & (creased | ~facing.all(axis=1))]
    rims = mesh.edges_sorted[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]  # type: ignore[no-untyped-call]
    return np.asarray(mesh.vertices[np.concatenate([seen, rims])])


def edge_pixels(sight: Sight, crossed_mm: UInt16s) -> np.ndarray:
    """Return which pixels (H, W) of a band lie at an edge of furniture; columns wrap, rows do not.

    ``crossed_mm`` (H, W): the band's, of `crossed_pixels`."""
    # What edges cross that are no farther than what is seen about them; beside them nothing else is looked for.
    shape, most = sight.shape, cv2.dilate(sight.distance_m.reshape(sight.shape), np.ones((3, 3), np.uint8))
    normal, point = (each.reshape(*shape, 3) for each in (sight.normal, sight.point))
    crossed = (crossed_mm < NONE_MM) & (crossed_mm < 1000 * most + 5)
    edge = crossed.copy()
    _edges(sight.label.reshape(shape), normal, point, crossed, edge)
    return edge


@compiled
def _edges(label, normal, point, crossed, edge):  # type: ignore[no-untyped-def]
    for y in range(label.shape[0]):
        for x in range(label.shape[1]):
            for down in range(2):
                r, k = y - down, (x - 1 + down) % label.shape[1]
                if r < 0 or (label[y, x] < FIRST_PART and label[r, k] < FIRST_PART) or crossed[y, x] or crossed[r, k]:
                    continue
                turned = lift = np.float32(0)
                for c in range(3):
                    turned += normal[y, x, c] * normal[r, k, c]
                    lift += (point[y, x, c] - point[r, k, c]) * normal[y, x, c]
                if label[y, x] != label[r, k] or turned < TURNED or abs(lift) > STEP_M:
                    edge[y, x] = edge[r, k] = True


def smooth_edges(lens: Lens, sight: Sight, first_row: int, photograph: Floats, shown: Floats) -> Floats:
    """Return a band's picture (H, W, 3) with smooth edges of furniture.

    ``sight``: what the band's pixels see; its first row is row ``first_row`` of the panorama.
    ``photograph``, ``shown`` (H, W, 3): the band without furniture, and with it, stairs and all."""
    high, wide = lens.crossed_mm.shape
    row, column = np.nonzero(edge_pixels(sight, lens.crossed_mm[first_row : first_row + len(shown)]))
    out = shown.copy()
    for part in in_parts(len(row), RAYS):
        r, c = row[part].astype(np.int64), column[part].astype(np.int64)
        # The directions (n x `RAYS`, 3) of places spread over pixels of a panorama
        k = np.arange(RAYS) + 0.5
        down, across = (k * FIRST) % 1.0, (k * SECOND) % 1.0
        latitude = (0.5 - ((r + first_row)[:, None] + down) / high) * np.pi
        longitude = ((c[:, None] + across) / wide - 0.5) * 2 * np.pi
        level = np.cos(latitude)
        found = np.stack([np.sin(longitude) * level, np.cos(longitude) * level, np.sin(latitude)], axis=-1)
        rays = np.ascontiguousarray(found.reshape(-1, 3), dtype=np.float32)
        seen, at = sight_along(lens.stage, rays, lens.eye_m, (len(r), RAYS)), np.empty((len(r), RAYS), np.int64)
        _match(np.stack([r, c]), _Seen.of(seen), _Seen.of(sight), at)
        alone, own = np.flatnonzero(at < 0), np.empty((at.size, 3), np.float32)
        if len(alone):
            of = alone // RAYS
            places = Places((r[of] + first_row).astype(np.int32), c[of].astype(np.int32), high, wide)
            own[alone] = lens.shade(seen.some(alone), places)
        _mix(np.stack([r, c]), at, own, sight.label.reshape(sight.shape), photograph, shown, out)
    return out


class _Seen(NamedTuple):
    """What pixels, or the rays through them, see, for compiled loops: arrays (A, B, ...)."""

    label: Int32s
    normal: Floats
    point: Floats

    @classmethod
    def of(cls, sight: Sight) -> Self:
        shape = sight.shape
        return cls(sight.label.reshape(shape), sight.normal.reshape(*shape, 3), sight.point.reshape(*shape, 3))


@inlined
def _likest(rays, i, s, y, x, pixels):  # type: ignore[no-untyped-def]
    """Return the pixel (flat) around (y, x) that shows what ray (i, s) meets; -1: no pixel shows that face."""
    rows, columns = pixels.label.shape
    best, at = 0.0, -1 if rays.label[i, s] >= FIRST_PART else y * columns + x
    for r in range(max(y - 1, 0), min(y + 2, rows)):
        for dc in range(-1, 2):
            c = (x + dc) % columns
            if pixels.label[r, c] != rays.label[i, s]:
                continue
            turned = lift = 0.0
            for k in range(3):
                turned += rays.normal[i, s, k] * pixels.normal[r, c, k]
                lift += (rays.point[i, s, k] - pixels.point[r, c, k]) * rays.normal[i, s, k]
            if rays.label[i, s] >= FIRST_PART and (turned < TURNED or abs(lift) > SAME_M):
                continue
            score = 10.0 + 4.0 * turned - min(50.0 * abs(lift), 4.0) - 0.01 * (abs(r - y) + abs(dc))
            if score > best:
                best, at = score, r * columns + c
    return at


@compiled
def _match(places, rays, pixels, at):  # type: ignore[no-untyped-def]
    """Fill ``at`` (N, S): what pixel shows what each ray of `_Seen` meets, of those around ``places`` (2, N)."""
    for i in range(at.shape[0]):
        for s in range(at.shape[1]):
            at[i, s] = _likest(rays, i, s, places[0, i], places[1, i], pixels)


@compiled
def _mix(places, at, own, label, photograph, shown, out):  # type: ignore[no-untyped-def]
    """Fill pixels of ``out`` (H, W, 3) at ``places`` (2, N: row, column) with the mean of their rays.

    ``at`` (N, S): the pixel that shows what a ray meets; -1: it is the ray's ``own`` (N x S, 3). ``photograph`` and
    ``shown`` (H, W, 3), cd/m2, without and with furniture."""
    samples, columns = at.shape[1], label.shape[1]
    for i in range(places.shape[1]):
        y, x = places[0, i], places[1, i]
        for k in range(3):
            total = 0.0
            for s in range(samples):
                r, c = at[i, s] // columns, at[i, s] % columns
                value = own[i * samples + s, k] if at[i, s] < 0 else shown[r, c, k]
                # The room itself: the photograph's own pixel, with the change of light beside it.
                if at[i, s] >= 0 and label[r, c] < FIRST_PART:
                    value = photograph[y, x, k]
                    if photograph[r, c, k] > 0:
                        value *= min(shown[r, c, k] / photograph[r, c, k], MOST_GAIN)
                total += value
            out[y, x, k] = total / samples
