"""Small rooms for tests of rendering: plain boxes with a window, skies that can be calculated."""

from __future__ import annotations

import numpy as np

from benchmarks.light.render_scenes import sky_outdoors
from processing.ground.arrays import Vector
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.light.scene.scene import Material, Outdoors, Part, Scene, Sun, plain, shell_of

EYE: Vector = (0.0, 0.0, 1.6)


def box_room(width_m=5.0, depth_m=4.0, height_m=2.7, *, window=(1.5, 3.5, 0.8, 2.3)) -> RoomModel:
    """A box around the camera; wall 0 (behind, at -y) has the window (start, end, sill, head)."""
    x, y = width_m / 2, depth_m / 2
    openings = ()
    if window:
        start, end, sill, head = window
        openings = (Opening(kind=OpeningKind.WINDOW, wall=0, start_m=start, end_m=end, sill_m=sill, head_m=head),)
    return RoomModel(
        source="given",
        floor=((-x, -y), (x, -y), (x, y), (-x, y)),
        camera_height_m=1.6,
        ceiling_height_m=height_m,
        openings=openings,
    )


def uniform_sky(level: float = 1000.0, sun: Sun | None = None, ground: float = 0.2) -> Outdoors:
    return sky_outdoors(lambda rays: np.full(rays.shape, level), rows=32, ground_albedo=ground, sun=sun)


def overcast(zenith: float = 1.0, rows: int = 256) -> Outdoors:
    return sky_outdoors(
        lambda rays: zenith * np.repeat((1 + 2 * rays[..., 2:]) / 3, 3, axis=-1), rows=rows, ground_albedo=0.0
    )


def scene_of(room: RoomModel, outdoors: Outdoors, albedo=0.5, reveal_m: float = 0.0, **more) -> Scene:
    colours = albedo if callable(albedo) else lambda _: plain(albedo)
    surfaces, panes = shell_of(room, reveal_m=reveal_m, albedo=colours, **more)
    return Scene(surfaces, panes, outdoors)


def box(centre, size, colour=(0.5, 0.3, 0.2), name="box", **material) -> Part:
    """A closed box, faces outwards."""
    low, high = np.array(centre) - np.array(size) / 2, np.array(centre) + np.array(size) / 2
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], np.int32)
    return Part(name, corners, faces, Material(name, colour, **material))
