"""Triangles with a class and a paint each: what training pictures are cast from, and rooms of `mocks.rooms` as such."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from mocks.rooms.model import Part, Role
from mocks.rooms.room import Room
from mocks.rooms.truth import TruthPictures
from processing.ground.arrays import Bytes, Doubles, Floats, Int8s, Int16s
from processing.segmentation.embedded import HEIGHT_PX, WIDTH_PX
from processing.segmentation.evidence import SceneClass
from training.labels import SKIRTING

Vec = tuple[float, float, float]

_TWO = np.array([[0, 1, 2], [0, 2, 3]])


@dataclass(frozen=True)
class Paint:
    """What a surface is painted with: ``kind`` says from which colours it is drawn, ``rgb`` where it is known."""

    kind: str
    rgb: Vec | None = None
    emission: float = 0.0
    """Relative to the light of lamps, 0 for all else."""


@dataclass(frozen=True)
class Frame:
    """Axes of a wall: ``origin`` on the floor, x ``along`` it, y into the room, z up."""

    origin: tuple[float, float]
    along: tuple[float, float]

    def world(self, points: npt.ArrayLike) -> Doubles:
        """Return points, shape (..., 3), of this frame in world coordinates."""
        p = np.asarray(points, dtype=np.float64)
        (ax, ay), (ox, oy) = self.along, self.origin
        x = ox + p[..., 0] * ax - p[..., 1] * ay
        y = oy + p[..., 0] * ay + p[..., 1] * ax
        return np.stack([x, y, p[..., 2]], axis=-1)


WORLD = Frame((0.0, 0.0), (1.0, 0.0))


@dataclass
class Soup:
    """A growing list of triangles."""

    triangles: list[Floats] = field(default_factory=list)
    labels: list[Int8s] = field(default_factory=list)
    paint_of: list[Int16s] = field(default_factory=list)
    paints: list[Paint] = field(default_factory=list)

    def paint(self, kind: str, rgb: Vec | None = None, emission: float = 0.0) -> int:
        """Return the number of a new paint."""
        self.paints.append(Paint(kind, rgb, emission))
        return len(self.paints) - 1

    def add(self, triangles: npt.ArrayLike, label: int, paint: int) -> None:
        """Add triangles (N, 3, 3) in world coordinates."""
        t = np.asarray(triangles, dtype=np.float32).reshape(-1, 3, 3)
        self.triangles.append(t)
        self.labels.append(np.full(len(t), int(label), np.int8))
        self.paint_of.append(np.full(len(t), paint, np.int16))

    def quad(self, frame: Frame, corners: npt.ArrayLike, label: int, paint: int) -> None:
        """Add a quadrilateral, shape (4, 3), metres in the frame."""
        self.add(frame.world(corners)[_TWO], label, paint)

    def upright(self, frame: Frame, rect: Vec | tuple[float, float, float, float], away: float, *what: Any) -> None:
        """Add a rectangle (x0, z0, x1, z1) parallel to the wall, ``away`` metres into the room."""
        x0, z0, x1, z1 = rect  # type: ignore[misc]
        self.quad(frame, [(x0, away, z0), (x1, away, z0), (x1, away, z1), (x0, away, z1)], *what)

    def box(self, frame: Frame, low: Vec, high: Vec, label: int, paint: int) -> None:
        """Add a block."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        p = np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])
        sides = ((0, 4, 5, 1), (2, 3, 7, 6), (0, 1, 3, 2), (4, 6, 7, 5), (1, 5, 7, 3), (0, 2, 6, 4))
        corners = frame.world(p)
        self.add(np.concatenate([corners[list(s)][_TWO] for s in sides]), label, paint)

    def take(self, other: Soup, label: int) -> None:
        """Add all of another soup under one label."""
        shift = len(self.paints)
        self.paints += other.paints
        for triangles, paint_of in zip(other.triangles, other.paint_of, strict=True):
            self.triangles.append(triangles)
            self.labels.append(np.full(len(triangles), label, np.int8))
            self.paint_of.append((paint_of + shift).astype(np.int16))

    def joined(self) -> tuple[Floats, Int8s, Int16s]:
        """Return all triangles (N, 3, 3), their labels and paints (N,)."""
        return np.concatenate(self.triangles), np.concatenate(self.labels), np.concatenate(self.paint_of)


_BY_SURFACE = {
    "floor": SceneClass.FLOOR,
    "ceiling": SceneClass.CEILING,
    "cornice": SceneClass.CEILING,
    "wall": SceneClass.WALL,
    "skirting": SceneClass.WALL,
    "reveal": SceneClass.WALL,
    "window sill": SceneClass.WALL,
    "window frame": SceneClass.WINDOW,
    "door": SceneClass.DOOR,
    "door frame": SceneClass.DOOR,
    "hallway": SceneClass.DOOR,
    "rug": SceneClass.FIXTURE,
    "picture": SceneClass.FIXTURE,
    "wall clock": SceneClass.FIXTURE,
    "wall shelf": SceneClass.FIXTURE,
    "tripod": SceneClass.TRIPOD,
    "meter board": SceneClass.TRIPOD,
}
_KIND = {
    "floor": "floor",
    "ceiling": "ceiling",
    "cornice": "ceiling",
    "wall": "wall",
    "reveal": "wall",
    "skirting": "trim",
    "window sill": "trim",
    "door frame": "trim",
    "window frame": "window frame",
    "door": "door",
    "rug": "rug",
    "curtain": "curtain",
    "radiator": "radiator",
    "picture": "picture",
    "tripod": "dark",
    "meter board": "board",
    "blind": "blind",
    "socket": "trim",
    "switch": "trim",
}


def class_of(part: Part) -> SceneClass:
    """Return the class of a part: furniture is what stands on the floor and the clutter on it."""
    if part.surface in _BY_SURFACE:
        return _BY_SURFACE[part.surface]
    return SceneClass.FIXTURE if part.role in (Role.SHELL, Role.FIXTURE) else SceneClass.FURNITURE


def room_soup(room: Room, parts: list[Part]) -> Soup:
    """Return a room's parts as a soup; each material keeps its colour as a proposal."""
    soup, paints = Soup(), {}
    for part in parts:
        kind = _KIND.get(part.surface, "furniture" if class_of(part) is SceneClass.FURNITURE else "fixture")
        key = (part.material, kind, part.surface == "hallway")
        if key not in paints:
            lit = float(any(part.material.emission_cd_m2))
            paints[key] = soup.paint("hallway" if part.surface == "hallway" else kind, part.material.colour, lit)
        mesh = part.mesh
        label = SKIRTING if part.surface == "skirting" else class_of(part)
        soup.add(mesh.vertices[mesh.faces].astype(np.float32), label, paints[key])
    return soup


def class_picture(pictures: TruthPictures) -> Int8s:
    """Return the class of every pixel (H, W) of a truth."""
    out = np.where(pictures.furniture, np.int8(SceneClass.FURNITURE), np.int8(SceneClass.FIXTURE))
    for number, name in enumerate(pictures.surface_names):
        if name in _BY_SURFACE:
            out[pictures.surface == number] = _BY_SURFACE[name]
    out[pictures.surface < 0] = SceneClass.WINDOW
    return out


def small_labels(label: Int8s) -> Bytes:
    """Return the commonest class of labels (H, W) in each of the network's pixels, uint8."""
    fine = label.reshape(HEIGHT_PX, label.shape[0] // HEIGHT_PX, WIDTH_PX, label.shape[1] // WIDTH_PX)
    votes = np.stack([(fine == k).sum(axis=(1, 3)) for k in range(len(SceneClass))])
    return np.asarray(votes.argmax(axis=0), dtype=np.uint8)
