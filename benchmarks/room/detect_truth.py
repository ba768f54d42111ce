"""What detection is measured by: masks of simulated rooms, hand-drawn masks of real ones, and the scores."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.shared_data import DATA
from benchmarks.truth_rooms import room_model_of
from mocks.rooms.model import Item, Role
from mocks.rooms.room import Room
from mocks.rooms.truth import TruthPictures
from processing.ground.arrays import Flags, Floats
from processing.ground.colour import linear_of_srgb
from processing.pictures.images import RelativeImage
from processing.sphere import Equirectangular, directions, solid_angles
from processing.surfaces.maps import CEILING, surface_maps
from processing.surfaces.sun import wall_between, window_depth

HUNG = frozenset({"picture", "wall clock", "wall shelf"})
LYING = frozenset({"rug"})
PLANAR = frozenset({"floor", "wall", "skirting", "rug", "socket", "switch"})
"""Surfaces on which direct sunlight counts: floor and walls, with what lies flat on them."""
LOOKED_AT, SCORED_ONLY = "bedroom_hn", "hotel_visualizer"
"""Of the two real rooms with hand-drawn masks: the one that was looked at while this was made, and the other."""
IGNORE, FURNITURE, TRIPOD = 128, 255, 64


@dataclass(frozen=True)
class SimulatedMasks:
    """Truth of a simulated room, (rows, 2 rows)."""

    furniture: Flags
    """Standing on the floor and what stands on that: without rugs and what hangs on walls."""
    ignore: Flags
    """Wall shelves and what stands on them: neither right nor wrong."""
    equipment: Flags
    """Tripod and meter board."""
    tripod: Flags
    sunlight: Flags
    planar: Flags


@dataclass(frozen=True)
class Score:
    """By solid angle."""

    iou: float
    precision: float
    recall: float


def simulated_masks(room: Room, truth: TruthPictures) -> SimulatedMasks:
    """Return the masks of a room."""
    hung = {item.instance for item in room.items if item.kind in HUNG}
    shelves = [item for item in room.items if item.kind == "wall shelf"]
    ignored = {shelf.instance for shelf in shelves}
    ignored |= {item.instance for item in room.items for shelf in shelves if _stands_on(item, shelf)}
    lying = {item.instance for item in room.items if item.kind in LYING}
    equipment = {item.instance for item in room.items if item.role is Role.EQUIPMENT}
    names = np.array((*truth.surface_names, "outdoors"))[truth.surface]
    planar = np.isin(names, list(PLANAR))
    return SimulatedMasks(
        furniture=truth.furniture & ~np.isin(truth.instance, list(hung | ignored | lying)),
        ignore=np.isin(truth.instance, list(ignored)),
        equipment=np.isin(truth.instance, list(equipment)),
        tripod=truth.tripod,
        sunlight=(truth.sunlit > 0.5) & planar,
        planar=planar,
    )


def _stands_on(item: Item, shelf: Item) -> bool:
    x, y = (a - b for a, b in zip(item.position_m[:2], shelf.position_m[:2], strict=True))
    near = float(np.hypot(x, y)) < shelf.size_m[0] / 2 + 0.05
    return item.role is Role.CLUTTER and near and abs(item.position_m[2] - shelf.position_m[2]) < shelf.size_m[2] + 0.1


def sun_enters(room: Room, least_share: float = 0.005) -> bool:
    """Return whether direct sun should cover a share of the sphere on the empty room's floor and walls."""
    if room.sky.disc() is None:
        return False
    model, geometry = room_model_of(room), Equirectangular(128, 64)
    maps = surface_maps(model, geometry)
    d, _ = directions(geometry)
    points = d * maps.depth_m[..., None] + np.array([0.0, 0.0, model.camera_height_m])
    depth, _ = window_depth(model, points, room.sky.sun_direction)
    lit = (depth > 0) & (maps.opening < 0) & (maps.plane != CEILING)
    lit[lit] &= ~wall_between(model, points[lit], room.sky.sun_direction)
    return share(lit) >= least_share


def sun_of(truth: Room) -> tuple[float, float] | None:
    """Return the sun's azimuth and elevation (rad), None where the sky shows none: a session knows both."""
    sky = truth.sky
    return (sky.sun_azimuth_rad, sky.sun_elevation_rad) if sky.disc() is not None else None


def score(found: Flags, true: Flags, ignore: Flags | None = None) -> Score:
    """Return how well a mask (H, W) meets the true one; two empty masks meet."""
    weight = solid_angles(Equirectangular(found.shape[1], found.shape[0]))
    if ignore is not None:
        weight = np.where(ignore, 0.0, weight)
    both, ours, theirs = (float((weight * mask).sum()) for mask in (found & true, found, true))
    union = ours + theirs - both
    return Score(
        iou=both / union if union else 1.0,
        precision=both / ours if ours else 1.0,
        recall=both / theirs if theirs else 1.0,
    )


def share(mask: Flags) -> float:
    """Return which part of the sphere a mask covers."""
    return float((solid_angles(Equirectangular(mask.shape[1], mask.shape[0])) * mask).sum() / (4 * np.pi))


def picture_of(rgb: Floats) -> RelativeImage:
    """Return linear light (H, W, 3) of a whole panorama as a picture without faults."""
    shape = rgb.shape[:2]
    light = np.ascontiguousarray(np.maximum(rgb, 0), dtype=np.float32)
    geometry = Equirectangular(shape[1], shape[0])
    return RelativeImage(light, np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), geometry)


def photograph(path: Path) -> RelativeImage:
    """Return an 8-bit sRGB panorama as linear light."""
    from PIL import Image

    with Image.open(path) as file:
        shown = np.asarray(file.convert("RGB"))
    return picture_of(linear_of_srgb(shown))


def hand_mask(name: str) -> npt.NDArray[np.uint8]:
    """Return a hand-drawn mask (H, W): `FURNITURE`, `TRIPOD`, `IGNORE`, 0."""
    from PIL import Image

    with Image.open(DATA / "panoramas" / "furnished" / f"{name}_mask.png") as file:
        return np.asarray(file.convert("L"))


def score_by_hand(found: Flags, name: str) -> Score:
    """Return how well a furniture mask meets a hand-drawn one."""
    drawn = hand_mask(name)
    return score(found, drawn == FURNITURE, drawn == IGNORE)
