"""What the built-in room's surfaces are made of: paint, planks, skirting, door, picture, rug and cabinet fronts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from mocks.worlds.light import Vector
from mocks.worlds.room_plan import RoomPlan, WallRect, plan_room
from mocks.worlds.room_rays import CEILING, DOOR_WALL, FLOOR, PICTURE_WALL, Hits
from mocks.worlds.textures import MipTexture, PlankFloor
from processing.ground.arrays import Floats, Indices, Int32s

_WALL: Vector = (0.62, 0.595, 0.54)
_ACCENT: Vector = (0.30, 0.39, 0.375)
_CEILING: Vector = (0.78, 0.78, 0.76)
_TRIM: Vector = (0.82, 0.81, 0.78)
_DOOR: Vector = (0.62, 0.57, 0.48)
_BRASS: Vector = (0.45, 0.34, 0.12)
_GAP: Vector = (0.05, 0.045, 0.04)
_FLOOR: Vector = (0.45, 0.325, 0.215)
_SKIRTING_M = 0.09


@dataclass(frozen=True)
class Surfaces:
    """Reflectance of every point; patterns are finer than the light maps and looked up per ray."""

    plan: RoomPlan
    mean_albedo: Floats
    floor: PlankFloor

    @cached_property
    def planks(self) -> MipTexture:
        """The floor's pattern: some 40 MB, made when a ray first meets the floor."""
        return MipTexture.tiled(self.floor.tile())

    def albedo(self, hits: Hits, directions: Floats, pixel_rad: float) -> Floats:
        """Return the albedo (N, 3) at each hit, averaged over what a pixel covers where that matters."""
        out = self.mean_albedo[hits.face]
        floor = np.flatnonzero(hits.face == FLOOR)
        if floor.size:
            out[floor] = self._floor(hits.point[floor], directions[floor], hits.distance_m[floor] * pixel_rad)
        for wall in range(4):
            rays = np.flatnonzero(hits.face == wall)
            if rays.size:
                self._wall(out, rays, wall, hits.point[rays])
        self._fronts(out, hits)
        return out

    def _floor(self, point: Floats, direction: Floats, across_m: Floats) -> Floats:
        tile_m, pixels = self.floor.tile_m, self.planks.shape[0]
        column = (point[:, 0] / tile_m % 1.0) * pixels - 0.5
        row = (point[:, 1] / tile_m % 1.0) * pixels - 0.5
        # Along the view a pixel covers more floor than across it; the geometric mean blurs neither too much.
        footprint_px = across_m / np.sqrt(np.maximum(-direction[:, 2], 0.02)) * (pixels / tile_m)
        depth = np.clip(np.log2(np.maximum(footprint_px, 1.0)), 0, len(self.planks.levels) - 1.001)
        level = depth.astype(np.int32)
        out = np.empty_like(point)
        for one in np.unique(level):
            rays = np.flatnonzero(level == one)
            blend = (depth[rays] - one)[:, None].astype(np.float32)
            sharp = self.planks.sample(column[rays], row[rays], int(one))
            soft = self.planks.sample(column[rays], row[rays], int(one) + 1)
            out[rays] = sharp * (1 - blend) + soft * blend
        self._rug(out, point)
        return out

    def _rug(self, out: Floats, point: Floats) -> None:
        x0, x1, y0, y1 = self.plan.rug
        x, y = point[:, 0], point[:, 1]
        inset = np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y))
        stripe = (inset > 0.08) & (inset < 0.14)
        out[inset > 0] = (0.42, 0.15, 0.12)
        out[stripe] = (0.62, 0.55, 0.42)

    def _wall(self, out: Floats, rays: Indices, wall: int, point: Floats) -> None:
        along = point[:, 1] if wall < 2 else point[:, 0]
        z = point[:, 2]
        out[rays[z < _SKIRTING_M]] = _TRIM
        out[rays[(z >= _SKIRTING_M) & (z < _SKIRTING_M + 0.006)]] = np.array(_TRIM, np.float32) * 0.45
        if wall == DOOR_WALL:
            _paint_door(out, rays, self.plan.door, (along, z))
        elif wall == PICTURE_WALL:
            _paint_picture(out, rays, self.plan.picture, (along, z))

    def _fronts(self, out: Floats, hits: Hits) -> None:
        """Draw the gaps between cabinet doors."""
        for index, box in enumerate(self.plan.solids):
            if not box.doors:
                continue
            first = 6 * (index + 1)
            rays = np.flatnonzero((hits.face >= first) & (hits.face < first + 4))
            if rays.size == 0:
                continue
            face: Int32s = hits.face[rays]
            axis = np.where(face < first + 2, 1, 0)
            low, high = np.array(box.low, np.float32), np.array(box.high, np.float32)
            length = (high - low)[axis]
            along = hits.point[rays, axis] - low[axis]
            leaf = length / box.doors
            beside = np.minimum(along % leaf, -along % leaf)
            out[rays[(beside < 0.004) & (along > 0.01) & (along < length - 0.01)]] = _GAP
            handle = (np.abs(beside - 0.05) < 0.008) & (np.abs(hits.point[rays, 2] - (low[2] + high[2]) / 2) < 0.07)
            out[rays[handle]] = (0.5, 0.5, 0.5)


@lru_cache(maxsize=2)
def surfaces_of(seed: int) -> Surfaces:
    """Return the surfaces of a seed's room; kept, because making the floor takes a moment."""
    plan = plan_room(seed)
    walls: list[Vector] = [_WALL] * 6
    walls[DOOR_WALL], walls[FLOOR], walls[CEILING] = _ACCENT, _FLOOR, _CEILING
    solids = [box.albedo for box in plan.solids for _ in range(6)]
    floor = PlankFloor(seed)
    albedo = np.array(walls + solids, dtype=np.float32)
    return Surfaces(plan, albedo, floor)


def _paint_door(out: Floats, rays: Indices, door: WallRect, at: tuple[Floats, Floats]) -> None:
    along, z = at
    inside = np.minimum(np.minimum(along - door.a0, door.a1 - along), door.z1 - z)
    out[rays[(inside > -0.07) & (inside <= 0)]] = _TRIM
    out[rays[inside > 0]] = _DOOR
    out[rays[(inside > 0) & (inside < 0.006)]] = _GAP
    for z0, z1 in ((0.25, 0.95), (1.10, 1.85)):
        panel = np.minimum(np.minimum(along - door.a0, door.a1 - along) - 0.14, np.minimum(z - z0, z1 - z))
        out[rays[(panel > 0) & (panel < 0.02)]] = np.array(_DOOR, np.float32) * 0.6
    handle = (np.abs(along - (door.a0 + 0.09)) < 0.06) & (np.abs(z - 1.03) < 0.012)
    out[rays[handle]] = _BRASS


def _paint_picture(out: Floats, rays: Indices, frame: WallRect, at: tuple[Floats, Floats]) -> None:
    along, z = at
    inset = np.minimum(np.minimum(along - frame.a0, frame.a1 - along), np.minimum(z - frame.z0, frame.z1 - z))
    out[rays[inset > 0]] = _GAP
    out[rays[inset > 0.03]] = (0.82, 0.81, 0.77)
    u = (along - frame.a0) / (frame.a1 - frame.a0)
    v = (z - frame.z0) / (frame.z1 - frame.z0)
    hill = v < 0.42 + 0.10 * np.sin(7 * u + 0.6)
    sun = (u - 0.68) ** 2 + (0.65 * (v - 0.66)) ** 2 < 0.006
    out[rays[(inset > 0.10) & ~hill]] = (0.46, 0.55, 0.66)
    out[rays[(inset > 0.10) & hill]] = (0.20, 0.30, 0.20)
    out[rays[(inset > 0.10) & sun]] = (0.80, 0.50, 0.22)
