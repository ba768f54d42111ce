"""Loaded triangles made sound: values that are numbers, faces with an area, winding outward where it can be told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from processing.ground.arrays import Doubles, Flags, Int64s
from processing.ground.mesh import crosses
from processing.layout.models.mesh_files import RawPart


@dataclass(frozen=True, eq=False)
class Sound:
    """A part after repair: vertices that coincide are one."""

    vertices: Doubles
    faces: Int64s
    uv: Doubles | None
    """(m, 3, 2), a corner."""
    closed: bool
    dropped_nan: int
    dropped_flat: int
    turned: int
    """Faces whose winding was turned."""


def repaired(part: RawPart, scale: float) -> Sound | None:
    """Return a sound copy of a part, or None where nothing is left; `scale` is the whole model's extent."""
    finite: Flags = np.all(np.isfinite(part.vertices) & (np.abs(part.vertices) < 1e12), axis=1)
    keep: Flags = np.all(finite[part.faces], axis=1)
    faces, uv = part.faces[keep], None if part.uv is None else part.uv[part.faces[keep]]
    vertices = np.where(finite[:, None], part.vertices, 0.0)
    lost = int((~keep).sum())
    if not len(faces):
        return None
    vertices, place = _merged(vertices, 1e-6 * scale)
    faces = place[faces]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
    solid = distinct & (np.linalg.norm(crosses(vertices, faces), axis=1) > 1e-14 * scale**2)
    flat = int((~solid).sum())
    faces, uv = faces[solid], None if uv is None else uv[solid]
    if not len(faces):
        return None
    used, inverse = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], inverse.reshape(-1, 3)
    turn, closed = _winding(vertices, faces)
    faces = np.where(turn[:, None], faces[:, ::-1], faces)
    if uv is not None:
        uv = np.where(turn[:, None, None], uv[:, ::-1], uv)
    return Sound(vertices, faces, uv, closed, lost, flat, int(turn.sum()))


def _merged(vertices: Doubles, step: float) -> tuple[Doubles, Int64s]:
    key = np.rint(vertices / max(step, 1e-300)).astype(np.int64)
    _, first, place = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return vertices[first], place.ravel()


def _winding(vertices: Doubles, faces: Int64s) -> tuple[Flags, bool]:
    """Return which faces to turn so that neighbours agree and closed bodies wind outward, and if all are closed."""
    count = len(faces)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(count), 3)
    forward = edges[:, 0] < edges[:, 1]
    code = edges.min(axis=1) * len(vertices) + edges.max(axis=1)
    order = np.argsort(code, kind="stable")
    code, owner, forward = code[order], owner[order], forward[order]
    starts = np.flatnonzero(np.concatenate([[True], code[1:] != code[:-1]]))
    uses = np.diff(np.concatenate([starts, [len(code)]]))
    pair = starts[uses == 2]
    a, b, alike = owner[pair], owner[pair + 1], forward[pair] == forward[pair + 1]
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count)).tocsr()
    pieces, piece = connected_components(graph, directed=False)
    turn = _agreeing(graph, pieces, piece, a, b, alike)
    odd = np.zeros(pieces, dtype=bool)
    np.logical_or.at(odd, piece[owner], np.repeat(uses != 2, uses))
    wrong = alike ^ turn[a] ^ turn[b]
    np.logical_or.at(odd, piece[a[wrong]], True)
    oriented = np.where(turn[:, None], faces[:, ::-1], faces)
    p, q, r = (vertices[oriented[:, k]] for k in range(3))
    middle = vertices.mean(axis=0)
    part = np.einsum("ij,ij->i", p - middle, np.cross(q - middle, r - middle))
    volume = np.bincount(piece, part, minlength=pieces)
    mostly = np.bincount(piece, turn, minlength=pieces) > 0.5 * np.bincount(piece, minlength=pieces)
    # Open pieces keep the winding that most of their faces have; closed ones are told by their volume.
    flip = np.where(odd, mostly, volume < 0)
    return turn ^ flip[piece], not odd.any()


def _agreeing(graph: object, pieces: int, piece: Int64s, a: Int64s, b: Int64s, alike: Flags) -> Flags:
    """Return the faces to turn so that each agrees with the face it is reached from."""
    turn = np.zeros(len(piece), dtype=bool)
    mixed = np.zeros(pieces, dtype=bool)
    mixed[piece[a[alike]]] = True
    if not mixed.any():
        return turn
    same = {(int(i), int(j)): bool(s) for i, j, s in zip(a, b, alike, strict=True)}
    first = np.full(pieces, -1)
    first[piece[::-1]] = np.arange(len(piece))[::-1]
    for start in first[mixed]:
        nodes, before = breadth_first_order(graph, int(start), directed=False)
        for node in nodes[1:]:
            i, j = int(before[node]), int(node)
            turn[j] = turn[i] ^ (same[i, j] if (i, j) in same else same[j, i])
    return turn
