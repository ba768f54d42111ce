"""Where light leaves a room: rays that meet nothing, and the panes they may leave through."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from shapely.geometry import Polygon

from mocks.rooms.model import Part, Plan
from mocks.rooms.shell.openings import Pane


def missed(parts: tuple[Part, ...], origins: npt.NDArray[np.float64], ways: npt.NDArray[np.float64]) -> npt.NDArray:
    """Which rays meet no triangle."""
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.concatenate([p.mesh.vertices[p.mesh.faces] for p in parts]).astype(np.float32))
    return np.asarray(scene.run(origins.astype(np.float32), ways.astype(np.float32), query="INTERSECT") < 0)


def through(pane: Pane, origins: npt.NDArray[np.float64], ways: npt.NDArray[np.float64]) -> npt.NDArray:
    """Which rays leave through a pane."""
    u, v = np.array(pane.u), np.array(pane.v)
    outward = np.cross(u, v)
    away = ((np.array(pane.corner) - origins) @ outward) / (ways @ outward)
    place = origins + away[:, None] * ways - np.array(pane.corner)
    a, b = place @ u / (u @ u), place @ v / (v @ v)
    return (away > 0) & (ways @ outward > 0) & (np.abs(a - 0.5) < 0.5 + 1e-4) & (np.abs(b - 0.5) < 0.5 + 1e-4)


def rays_inside(plan: Plan, seed: int, count: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    rng = np.random.default_rng([seed, 3])
    room = Polygon(plan.polygon).buffer(-0.2)
    x0, y0, x1, y1 = room.bounds
    spots = rng.uniform((x0, y0), (x1, y1), (4 * count, 2))
    spots = spots[shapely.contains_xy(room, spots[:, 0], spots[:, 1])][:count]
    ways = rng.normal(size=(len(spots), 3))
    heights = rng.uniform(0.05, plan.height_m - 0.05, len(spots))
    return np.column_stack([spots, heights]), ways / np.linalg.norm(ways, axis=1, keepdims=True)
