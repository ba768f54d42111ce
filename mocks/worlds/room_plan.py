"""The built-in room as data: where walls, window, door and furniture are. Metres; the camera is at x = y = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocks.worlds.light import Vector

CAMERA_HEIGHT_M = 1.6


@dataclass(frozen=True)
class Box:
    """A block with sides along the axes; ``doors`` draws that many fronts (dark gaps) on its upright sides."""

    low: Vector
    high: Vector
    albedo: Vector
    doors: int = 0


@dataclass(frozen=True)
class WallRect:
    """A rectangle on a wall: ``a`` runs along the wall (x or y), ``z`` is height."""

    a0: float
    a1: float
    z0: float
    z1: float


@dataclass(frozen=True)
class RoomPlan:
    """Everything that has a place. The window is in the wall at ``high[1]``, the door in the one at ``low[0]``."""

    low: Vector
    high: Vector
    window: WallRect
    door: WallRect
    picture: WallRect
    rug: tuple[float, float, float, float]
    boxes: tuple[Box, ...]
    board: Box
    wall_thickness_m: float = 0.24
    frame_m: float = 0.055

    @property
    def board_centre(self) -> Vector:
        """Middle of the meter board's face, which looks along +y (towards camera and window)."""
        low, high = self.board.low, self.board.high
        return ((low[0] + high[0]) / 2, high[1], (low[2] + high[2]) / 2)

    @property
    def solids(self) -> tuple[Box, ...]:
        """Furniture and board together."""
        return (*self.boxes, self.board)


_WOOD = (0.32, 0.20, 0.12)
_WHITE = (0.78, 0.77, 0.74)
_BOARD = (0.90, 0.90, 0.90)


def plan_room(seed: int) -> RoomPlan:
    """Return a living room whose measures vary with ``seed``; the camera stands free by at least 0.9 m."""
    rng = np.random.default_rng(seed)

    def about(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 3)

    left, right = about(-2.5, -2.1), about(2.2, 2.8)
    back, ahead = about(-2.4, -2.1), about(2.3, 2.8)
    ceiling = about(2.5, 2.8)
    window_x = about(-0.9, -0.5)
    sofa_y = about(-0.5, -0.2)
    board_x = about(-1.1, -0.8)
    cabinet = Box((0.2, back, 0.08), (1.9, back + 0.45, about(0.75, 0.95)), _WOOD, doors=4)
    table_x, table_y = about(0.95, 1.1), about(0.9, 1.1)
    return RoomPlan(
        low=(left, back, 0.0),
        high=(right, ahead, ceiling),
        window=WallRect(window_x, window_x + about(1.7, 2.0), about(0.75, 0.9), about(2.1, 2.3)),
        door=WallRect(about(-0.8, -0.5), 0.35, 0.0, 2.05),
        picture=WallRect(sofa_y + 0.35, sofa_y + 1.25, 1.35, 1.95),
        rug=(-0.9, 1.3, 0.35, ahead - 0.45),
        boxes=(
            cabinet,
            *_shelf(right, back),
            *_sofa(right, sofa_y),
            *_table(table_x, table_y),
            Box((left, ahead - 0.5, 0.0), (left + 0.45, ahead - 0.05, 1.85), (0.70, 0.68, 0.62), doors=1),
        ),
        board=Box((board_x - 0.25, -1.52, 1.05), (board_x + 0.25, -1.5, 1.55), _BOARD),
    )


def _sofa(wall_x: float, y: float) -> tuple[Box, ...]:
    cloth, pillow = (0.16, 0.22, 0.30), (0.62, 0.42, 0.14)
    x = wall_x - 0.9
    return (
        Box((x, y, 0.12), (wall_x, y + 1.6, 0.42), cloth),
        Box((wall_x - 0.22, y, 0.42), (wall_x, y + 1.6, 0.85), cloth),
        Box((x, y - 0.16, 0.05), (wall_x, y, 0.62), cloth),
        Box((x, y + 1.6, 0.05), (wall_x, y + 1.76, 0.62), cloth),
        Box((wall_x - 0.36, y + 0.12, 0.43), (wall_x - 0.22, y + 0.52, 0.74), pillow),
    )


def _table(x: float, y: float) -> tuple[Box, ...]:
    leg, span_x, span_y = 0.05, 0.5, 0.75
    corners = [(x + dx, y + dy) for dx in (0.0, span_x - leg) for dy in (0.0, span_y - leg)]
    legs = tuple(Box((cx, cy, 0.0), (cx + leg, cy + leg, 0.4), _WOOD) for cx, cy in corners)
    top = Box((x - 0.03, y - 0.03, 0.4), (x + span_x + 0.03, y + span_y + 0.03, 0.44), (0.42, 0.28, 0.17))
    vase = Box((x + 0.18, y + 0.28, 0.44), (x + 0.28, y + 0.38, 0.66), (0.15, 0.35, 0.33))
    return (top, *legs, vase)


def _shelf(wall_x: float, back: float) -> tuple[Box, ...]:
    """Three boards on the back wall's right half, with books."""
    boards = tuple(Box((wall_x - 0.30, back + 0.1, z), (wall_x, back + 1.1, z + 0.03), _WHITE) for z in (1.2, 1.6))
    books = (
        Box((wall_x - 0.22, back + 0.20, 1.23), (wall_x - 0.02, back + 0.45, 1.47), (0.45, 0.10, 0.08)),
        Box((wall_x - 0.20, back + 0.45, 1.23), (wall_x - 0.02, back + 0.60, 1.45), (0.10, 0.20, 0.38)),
        Box((wall_x - 0.22, back + 0.55, 1.63), (wall_x - 0.02, back + 0.85, 1.88), (0.14, 0.30, 0.14)),
    )
    return (*boards, *books)
