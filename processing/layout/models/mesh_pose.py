"""Units, the upward axis and the front of loaded furniture: given, or guessed from what furniture is like, and said."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from processing.errors import CatalogueError
from processing.ground.arrays import Doubles, Flags, Int64s
from processing.ground.mesh import crosses
from processing.ground.tables import table_of
from processing.layout.furniture.model import Size
from processing.layout.items import KINDS
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
    # Vertices that agree to a millionth of the extent are one.
    key = np.rint(vertices / max(1e-6 * scale, 1e-300)).astype(np.int64)
    _, first, place = np.unique(key, axis=0, return_index=True, return_inverse=True)
    vertices, faces = vertices[first], place.ravel()[faces]
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
    # Open pieces keep the winding that most of their faces have; closed ones that of a positive volume.
    return turn ^ np.where(odd, mostly, volume < 0)[piece], not odd.any()


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


UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
FRONTS = ("+z", "-z", "+x", "-x")
_SIZES = table_of("processing.layout", "items")["usual_size"]
_USUAL: dict[str, Size] = {name: (width, depth, height) for name, (width, depth, height) in _SIZES.items()}
ANY: Size = (0.7, 0.6, 0.8)
FAR = 1.3  # mean difference of the sizes' logarithms to the usual ones from which a unit is not believed (3.7 times)
MOST_UNEVEN = 1.6  # chosen, as `MOST_DISTORTION`
OFTEN_WIDE = ("sofa", "tv", "tv stand", "desk", "wardrobe", "bookshelf", "chest")
LONG = ("single bed", "bed")
BACKED = ("sofa", "armchair", "dining chair", "desk chair", "bed", "single bed", "king bed")
"""Kinds whose upper part stands at their back."""


@dataclass(frozen=True)
class Given:
    """What is known of a model beside its file; None where it is not."""

    unit: str | None = None
    up: str | None = None
    front: str | None = None
    """The horizontal axis of the file (its height along y) that the front looks to."""
    size_m: Size | None = None
    """Width, depth, height."""

    def checked(self, where: str) -> Self:
        """Return itself; raise `CatalogueError` where a value is none of those there are."""
        for got, known, key in ((self.unit, UNITS, "unit"), (self.front, FRONTS, "front"), (self.up, ("y", "z"), "up")):
            if got is not None and got not in known:
                raise CatalogueError(f"{key} '{got[:20]}'; there are: {', '.join(known)}", where=where)
        return self


def usual_size(category: str) -> Size:
    """Return a category's usual size in metres."""
    return KINDS[category].size_m if category in KINDS else _USUAL.get(category, ANY)


def posed(points: Doubles, category: str, given: Given, *, y_up: bool) -> tuple[Doubles, tuple[str, ...]]:
    """Return a transform (4, 4) of points (N, 3), a file's axes to an item's, and what was guessed or corrected.

    `points` are all of its vertices; `y_up` says that the format itself has y upwards (glTF).
    """
    notes: list[str] = []
    up = given.up or ("y" if y_up else _up(np.ptp(points, axis=0), category, given, notes))
    turn = _STAND if up == "y" else np.diag([-1.0, -1.0, 1.0])
    standing = points @ turn.T
    turn = _front_turn(standing, category, given, notes) @ turn
    standing = points @ turn.T
    scale = _scale(np.ptp(standing, axis=0), category, given, notes)
    low, high = standing.min(axis=0) * scale, standing.max(axis=0) * scale
    matrix = np.eye(4)
    matrix[:3, :3] = turn * scale[:, None]
    matrix[:3, 3] = [-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]]
    return matrix, tuple(notes)


_STAND = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
"""From y up with the front at +z (glTF's and 3D-FUTURE's way) to z up with the front at +y."""


def _misfit(extent: Doubles, size: Size) -> float:
    """Return how unlike two boxes' proportions are, 0 for alike."""
    return float(np.ptp(np.log(np.maximum(extent, 1e-3 * extent.max()) / np.array(size))))


def _up(extent: Doubles, category: str, given: Given, notes: list[str]) -> str:
    """Return y, or z where the proportions say so clearly."""
    size = given.size_m or usual_size(category)
    as_y = min(_misfit(extent[[0, 2, 1]], size), _misfit(extent[[2, 0, 1]], size) + 0.1)
    as_z = min(_misfit(extent[[0, 1, 2]], size), _misfit(extent[[1, 0, 2]], size) + 0.1)
    if as_z + (0.1 if given.size_m else 0.6) < as_y:
        notes.append("z is taken to point up, from its proportions")
        return "z"
    return "y"


def _front_turn(standing: Doubles, category: str, given: Given, notes: list[str]) -> Doubles:
    """Return the turn about z (quarter steps) that brings the front to +y."""
    if given.front is not None:
        return _quarter({"+z": 0, "-x": 1, "-z": 2, "+x": 3}[given.front])
    across = _across(np.ptp(standing, axis=0), category, given)
    back = _backward(standing) if category in BACKED else None
    if back is not None and (across is None or (back % 2 == 1) == across):
        steps = back
    else:
        steps = 1 if across else 0
    if steps:
        notes.append(f"turned by {90 * steps} degrees: its front was guessed from its shape")
    elif back is None:
        notes.append("its front is assumed to be the format's default")
    return _quarter(steps)


def _across(extent: Doubles, category: str, given: Given) -> bool | None:
    """Return whether its width lies along y, from its proportions; None where they leave it open."""
    if given.size_m is not None:
        turned, straight = _misfit(extent[[1, 0, 2]], given.size_m), _misfit(extent, given.size_m)
        return None if abs(turned - straight) < 0.05 else turned < straight
    wide = category in OFTEN_WIDE
    if not wide and category not in LONG:
        return None
    ratio = extent[0] / max(extent[1], 1e-12) if wide else extent[1] / max(extent[0], 1e-12)
    return None if 0.75 < ratio < 1.3 else bool(ratio <= 0.75)


def _backward(standing: Doubles) -> int | None:
    """Return how many quarter turns bring the side without a back to +y; None where no side is clearly the back."""
    low, high = standing.min(axis=0), standing.max(axis=0)
    upper = standing[standing[:, 2] > low[2] + 0.72 * (high[2] - low[2])]
    if len(upper) < 3:
        return None
    lean = ((upper.min(axis=0) + upper.max(axis=0)) / 2 - (low + high) / 2)[:2] / np.maximum((high - low)[:2], 1e-12)
    axis = int(np.argmax(np.abs(lean)))
    if abs(lean[axis]) < 0.12:
        return None
    # The back is at `lean`: -y already right; +y half a turn; +x and -x a quarter.
    if axis == 1:
        return 0 if lean[1] < 0 else 2
    return 3 if lean[0] > 0 else 1


def _quarter(steps: int) -> Doubles:
    """Return a turn by quarters about z, counter-clockwise."""
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[steps % 4]
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _scale(extent: Doubles, category: str, given: Given, notes: list[str]) -> Doubles:
    """Return (3,): metres per unit."""
    each = np.ones(3)
    if given.size_m is not None:
        ratio = np.array(given.size_m) / np.maximum(extent, 1e-12)
        mean = float(np.exp(np.mean(np.log(ratio))))
        near = min(UNITS.values(), key=lambda unit: abs(np.log(mean / unit)))
        if np.abs(np.log(ratio / near)).max() < 0.03:
            return each * near
        if ratio.max() / ratio.min() < MOST_UNEVEN:
            notes.append("stretched to its stated size")
            return np.asarray(ratio, dtype=np.float64)
        notes.append(f"scaled by {mean:.4g} to about its stated size")
        return each * mean
    if given.unit is not None:
        return each * UNITS[given.unit]
    thick = extent > 1e-3 * extent.max()
    ratio = np.log(extent[thick] / np.array(usual_size(category))[thick])
    off = {name: float(np.abs(ratio + np.log(unit)).mean()) for name, unit in UNITS.items()}
    best = min(("m", "cm", "mm", "in"), key=lambda name: off[name])
    best = "m" if off["m"] < FAR else best
    if off[best] < FAR:
        if best != "m":
            notes.append(f"taken to be in {best}, from its size")
        return each * UNITS[best]
    scale = float(np.exp(-ratio.mean()))
    usual = category if category != "other" else "size"
    notes.append(f"its unit is unknown: scaled by {scale:.4g} to a usual {usual}")
    return each * scale
