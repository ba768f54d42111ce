"""Rooms of `mocks.rooms` as labelled triangles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mocks.rooms.model import Part, Role
from mocks.rooms.room import Room
from mocks.rooms.truth import TruthPictures
from processing.segmentation.evidence import SceneClass
from training.rooms.soup import Soup

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
    "floor": "floor", "ceiling": "ceiling", "cornice": "ceiling", "wall": "wall", "reveal": "wall",
    "skirting": "trim", "window sill": "trim", "door frame": "trim", "window frame": "window frame",
    "door": "door", "rug": "rug", "curtain": "curtain", "radiator": "radiator", "picture": "picture",
    "tripod": "dark", "meter board": "board", "blind": "blind", "socket": "trim", "switch": "trim",
}  # fmt: skip


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
        soup.add(mesh.vertices[mesh.faces].astype(np.float32), class_of(part), paints[key])
    return soup


def class_picture(pictures: TruthPictures) -> npt.NDArray[np.int8]:
    """Return the class of every pixel (H, W) of a truth."""
    out = np.where(pictures.furniture, np.int8(SceneClass.FURNITURE), np.int8(SceneClass.FIXTURE))
    for number, name in enumerate(pictures.surface_names):
        if name in _BY_SURFACE:
            out[pictures.surface == number] = _BY_SURFACE[name]
    out[pictures.surface < 0] = SceneClass.WINDOW
    return out
