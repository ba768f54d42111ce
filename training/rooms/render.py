"""What a camera sees in a training room, before any colours are chosen: shapes, paints, and light by its source.

A view costs rays; the pictures made from it (`training.looks`) cost none, so that every step of training sees new ones.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mocks.rooms.light.geometry import Geometry
from mocks.rooms.model import ADE20K, Material, Part, Role
from mocks.rooms.truth import equirectangular
from processing.ground.arrays import Bytes, Doubles, Flags, Floats, Int8s, Int16s
from processing.ground.mesh import Mesh
from processing.segmentation.embedded import WIDTH_PX
from processing.segmentation.evidence import SceneClass
from training.labels import boundary_latitudes, corner_likelihood, wall_direction_rad
from training.rooms.house import Portal
from training.rooms.light import Points, coarse, gather, sunlit
from training.rooms.paints import Tile, draw_coats
from training.rooms.soup import Soup

ROWS = 256
"""Of a view: those of the network's input."""
SUNS, COATS = 2, 6
"""Directions of the sun, and sets of coats, drawn for each view."""
MOST_PAINTS = 640
LEAST_REACH_M = 0.25


@dataclass
class Stage:
    """A room ready for rays."""

    soup: Soup
    panes: list[tuple[Doubles, Doubles, Doubles]]
    portals: list[Portal] = field(default_factory=list)
    mirrors: list[int] = field(default_factory=list)
    lamps: list[tuple[float, float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        triangles, self.labels, self.paint_of = self.soup.joined()
        count = len(triangles)
        vertices = triangles.reshape(-1, 3).astype(np.float64)
        faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
        mesh = Mesh(vertices, np.zeros_like(vertices), np.zeros((3 * count, 2)), faces)
        self.geometry = Geometry([Part(mesh, Material("any", (0.5, 0.5, 0.5)), "any", ADE20K["wall"], Role.SHELL)])


class Standpoint(NamedTuple):
    """A room's outline and height, and where the camera stands in it, metres."""

    outline: Doubles
    """Corners (N, 2), counter-clockwise."""
    ceiling_m: float
    place: tuple[float, float]
    eye_m: float


class View(NamedTuple):
    """What one camera sees, (H, W, ...) of 256 x 512; coarse arrays (h, w, ...) of every fourth pixel each way."""

    label: Bytes
    """`SceneClass`, or `training.labels.SKIRTING`."""
    paint: Int16s
    """-1 where the outdoors is seen."""
    reach_m: np.ndarray
    """(H, W) half precision: length of the path, by way of a mirror too; 0 outdoors."""
    normal: Int8s
    """(H, W, 3): times 127, towards the camera; 0 outdoors."""
    sun: Bytes
    """Bit k: seen by sun k."""
    mirrored: Int16s
    """(H/2, W/2): paint that a glossy surface would mirror, -1 outdoors, -2 not looked for."""
    sky: np.ndarray
    """(h, w) half precision: light through the panes; ``lamps`` likewise."""
    lamps: np.ndarray
    openness: np.ndarray
    """(h, w) half precision, 0..1: how far away the surroundings are."""
    bounce: Int16s
    """(h, w, 8): paints that light comes from, -1 none."""
    suns: Floats
    """(SUNS, 3): directions."""
    coats: np.ndarray
    """(COATS, MOST_PAINTS, 9) half precision: albedo (3), tile, scale, turn, contrast, gloss, emission."""
    ceiling_rad: Floats
    """(2 * WIDTH_PX,) of the network's columns, as ``floor_rad`` and ``corner``."""
    floor_rad: Floats
    corner: Floats
    eye_m: Floats
    """(1,)"""
    direction_rad: Floats
    """(1,): azimuth of most walls."""


def see(rng: np.random.Generator, stage: Stage, stand: Standpoint, tiles: list[Tile]) -> View | None:
    """Return what a camera sees; None in front of a face, or where the paints are too many."""
    if len(stage.soup.paints) > MOST_PAINTS:
        return None
    eye = np.array([*stand.place, stand.eye_m])
    rays = equirectangular(ROWS)
    shape = rays.shape[:2]
    flat = rays.reshape(-1, 3).copy()
    start = np.broadcast_to(eye.astype(np.float32), flat.shape).copy()
    hits = stage.geometry.cast(start, flat)
    face, reach = hits.face.copy(), hits.distance_m.copy()
    if np.median(reach[np.isfinite(reach)]) < LEAST_REACH_M:
        return None
    label = np.where(face < 0, np.int8(SceneClass.WINDOW), stage.labels[face])
    label[_beyond(stage, eye, flat, face < 0)] = SceneClass.DOOR
    paint = np.where(face < 0, np.int16(-1), stage.paint_of[face])
    before = np.zeros_like(reach)
    mirrored = np.flatnonzero(np.isin(paint, stage.mirrors))
    if mirrored.size:
        normal = stage.geometry.face_normals[face[mirrored]]
        into = flat[mirrored]
        start[mirrored] += into * reach[mirrored, None] - into * np.float32(1e-3)
        flat[mirrored] = into - 2 * np.einsum("ij,ij->i", into, normal)[:, None] * normal
        again = stage.geometry.cast(start[mirrored], flat[mirrored])
        before[mirrored] = reach[mirrored]
        face[mirrored], reach[mirrored] = again.face, again.distance_m
        paint[mirrored] = np.where(again.face < 0, np.int16(-1), stage.paint_of[again.face])
    normal = stage.geometry.face_normals[face].copy()
    normal *= -np.sign(np.einsum("ij,ij->i", normal, flat))[:, None]
    solid = face >= 0
    normal[~solid] = 0
    distance = np.where(solid, reach, 0)
    points = Points(
        (start + flat * distance[:, None]).reshape(*shape, 3), normal.reshape(*shape, 3), solid.reshape(shape)
    )
    light = gather(rng, stage.geometry, coarse(points), stage.panes, stage.lamps)
    suns, sun = _suns(rng, stage, points)
    bounce = np.where(light.bounce_face < 0, np.int16(-1), stage.paint_of[light.bounce_face])
    up, down = boundary_latitudes(stand.outline, stand.place, stand.eye_m, stand.ceiling_m, 2 * WIDTH_PX)
    half = np.float16
    return View(
        label.reshape(shape).astype(np.uint8),
        paint.reshape(shape).astype(np.int16),
        (distance + before * solid).reshape(shape).astype(half),
        np.round(points.normal * 127).astype(np.int8),
        sun,
        _mirrored(stage, points, flat.reshape(*shape, 3), label.reshape(shape)),
        _halves(light.sky),
        _halves(light.lamps),
        _halves(light.open_share),
        bounce.astype(np.int16),
        suns,
        _coats(rng, stage, tiles),
        up,
        down,
        corner_likelihood(stand.outline, stand.place, 2 * WIDTH_PX),
        np.array([stand.eye_m], np.float32),
        np.array([wall_direction_rad(down)], np.float32),
    )


def _beyond(stage: Stage, eye: Doubles, rays: Floats, away: Flags) -> Flags:
    """Return which rays (N, 3) that go outdoors (``away``) do so by way of an opening: windows of the next room."""
    out = np.zeros(len(rays), bool)
    for frame, (x0, _, x1, top), _ in stage.portals:
        (ax, ay), (ox, oy) = frame.along, frame.origin
        across, into = rays[:, 0] * ax + rays[:, 1] * ay, rays[:, 1] * ax - rays[:, 0] * ay
        x, y = (eye[0] - ox) * ax + (eye[1] - oy) * ay, (eye[1] - oy) * ax - (eye[0] - ox) * ay
        far = np.where(into < -1e-6, y / np.maximum(-into, 1e-6), -1.0)
        at, high = x + far * across, eye[2] + far * rays[:, 2]
        out |= (far > 0) & (at > x0) & (at < x1) & (high > 0) & (high < top)
    return out & away


def _halves(values: Floats) -> np.ndarray:
    return np.minimum(values, 6e4).astype(np.float16)


def _suns(rng: np.random.Generator, stage: Stage, points: Points) -> tuple[Floats, Bytes]:
    """Return directions of suns that shine through a pane, and which pixels see them."""
    suns, seen = np.zeros((SUNS, 3), np.float32), np.zeros(points.solid.shape, np.uint8)
    for number in range(SUNS if stage.panes else 0):
        _, u, v = stage.panes[int(rng.integers(len(stage.panes)))]
        outward = np.cross(u, v)
        azimuth = np.arctan2(outward[0], outward[1]) + rng.uniform(-1.2, 1.2)
        high = rng.uniform(0.12, 1.0)
        ray = np.array([np.sin(azimuth) * np.cos(high), np.cos(azimuth) * np.cos(high), np.sin(high)], np.float32)
        suns[number] = ray
        seen |= (sunlit(stage.geometry, points, ray) > 0).astype(np.uint8) << number
    return suns, seen


_GLOSSY = (SceneClass.FLOOR, SceneClass.FURNITURE, SceneClass.FIXTURE, SceneClass.DOOR)


def _mirrored(stage: Stage, points: Points, rays: Floats, label: Int8s) -> Int16s:
    """Return the paints that every second pixel each way would mirror."""
    normal, into = points.normal[::2, ::2].reshape(-1, 3), rays[::2, ::2].reshape(-1, 3)
    out = np.full(len(into), -2, np.int16)
    mine = np.flatnonzero(points.solid[::2, ::2].reshape(-1) & np.isin(label[::2, ::2].reshape(-1), _GLOSSY))
    away = into[mine] - 2 * np.einsum("ij,ij->i", into[mine], normal[mine])[:, None] * normal[mine]
    start = points.place[::2, ::2].reshape(-1, 3)[mine] + normal[mine] * np.float32(2e-3)
    hits = stage.geometry.cast(start, away.astype(np.float32))
    out[mine] = np.where(hits.face < 0, np.int16(-1), stage.paint_of[hits.face])
    return out.reshape(label[::2, ::2].shape)


def _coats(rng: np.random.Generator, stage: Stage, tiles: list[Tile]) -> np.ndarray:
    out = np.zeros((COATS, MOST_PAINTS, 9), np.float16)
    for one in out:
        c = draw_coats(rng, stage.soup.paints, tiles)
        parts = (c.tile, c.scale, c.turn, c.contrast, c.gloss, c.emission)
        one[: len(c.albedo)] = np.column_stack([c.albedo, *parts])
    return out
