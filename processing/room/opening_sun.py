"""Patches of sun on walls look like windows: bright, upright, four-cornered. The sun's position distinguishes them.

A patch lies where the sun falls through *another* opening, has its wall's own colour and no detail; a true window
shows the outdoors. What is recognised so becomes evidence of a wall, and the openings are looked for once more.
"""

import math
from dataclasses import replace

import cv2
import numpy as np

from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import Opening, RoomModel
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.room.openings import find_openings
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular, directions
from processing.surfaces import sun as beams
from processing.surfaces.maps import CEILING, FIRST_WALL, SurfaceMaps, surface_maps

ROWS = 512  # 0.35 degrees each; chosen, never swept
AZIMUTHS, ELEVATIONS = 5, 3  # directions tried within which the given one may be off
EDGE_M = 0.15  # by which windows, and so their beams, may be estimated wrong
DETAIL_STOPS = 0.25  # standard deviation within `DETAIL_RAD`: what shows more is no evenly lit wall
DETAIL_RAD = math.radians(1.5)
LEAST_SHARE_OF_OPENING = 0.1  # of an opening: less sun in it changes nothing


def find_openings_in_sun(
    image: RelativeImage | LuminanceImage,
    evidence: SceneEvidence,
    room: RoomModel,
    sun: tuple[float, float] | None,
    *,
    outdoor: LuminanceImage | None = None,
) -> tuple[Opening, ...]:
    """Return the openings as `find_openings` does, but for patches of sun on walls, where the sun's place is known.

    ``sun``: azimuth (from +y towards +x) and elevation in rad; None: not known, or no sun shines.
    """
    found = find_openings(image, evidence, room, outdoor=outdoor)
    if sun is None or sun[1] <= 0 or len(found) < 2:
        return found
    patches, maps = sun_patches(image, room.model_copy(update={"openings": found}), sun)
    panes = [maps.opening == i for i in range(len(found))]
    if not any((patches & pane).sum() > LEAST_SHARE_OF_OPENING * max(1, pane.sum()) for pane in panes):
        return found
    # Evidence of a wall where it was of a window
    shape = evidence.probabilities.shape[1:]
    grown = cv2.dilate(patches.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(np.float32)
    there = cv2.resize(grown, (shape[1], shape[0]), interpolation=cv2.INTER_AREA) > 0.5
    changed = evidence.probabilities.copy()
    window = changed[SceneClass.WINDOW]
    changed[SceneClass.WALL] += np.where(there, window, 0)
    changed[SceneClass.WINDOW] = np.where(there, 0, window)
    return find_openings(image, replace(evidence, probabilities=changed), room, outdoor=outdoor)


def sun_patches(
    image: RelativeImage | LuminanceImage, room: RoomModel, sun: tuple[float, float]
) -> tuple[Flags, SurfaceMaps]:
    """Return where openings of the room show sun on a wall of shape (ROWS, 2 ROWS), and the room's maps."""
    rows = min(ROWS, image.geometry.height_px)
    geometry = Equirectangular(2 * rows, rows)
    maps = surface_maps(room, geometry)
    rgb = np.asarray(image.rgb, np.float32)
    known = np.where(np.isfinite(rgb), rgb, 0)
    small = np.asarray(cv2.resize(known, (2 * rows, rows), interpolation=cv2.INTER_AREA), np.float32)
    asked = (maps.opening >= 0) & (maps.plane >= FIRST_WALL)
    # Which of the asked places the sun may reach through a window of another wall
    rays, _ = directions(geometry)
    points = rays[asked] * maps.depth_m[asked][:, None] + np.array([0.0, 0.0, room.camera_height_m])
    reached = np.zeros(len(points), bool)
    for turn in np.linspace(-beams.AZIMUTH_SLACK_RAD, beams.AZIMUTH_SLACK_RAD, AZIMUTHS):
        for rise in np.linspace(-beams.ELEVATION_SLACK_RAD, beams.ELEVATION_SLACK_RAD, ELEVATIONS):
            way = beams.sun_vector(sun[0] + float(turn), max(0.01, sun[1] + float(rise)))
            depth, _ = beams.window_depth(room, points, way)
            near = (depth > -EDGE_M) & ~reached
            reached[near] = ~beams.wall_between(room, points[near], way)
    found = np.zeros(asked.shape, bool)
    found[asked] = reached
    asked &= found
    asked &= _bright(small, maps, asked) & _even(small)
    hidden = (maps.opening >= 0) | (maps.plane == CEILING)
    return asked & beams.coloured_as_behind(small, maps.plane, asked, hidden), maps


def _bright(rgb: Floats, maps: SurfaceMaps, asked: Flags) -> Flags:
    luminance = luminance_cd_m2(rgb)
    found = np.zeros(asked.shape, bool)
    for plane in np.unique(maps.plane[asked]):
        shade = luminance[(maps.plane == plane) & (maps.opening < 0) & (luminance > 0)]
        if shade.size:
            found |= (maps.plane == plane) & (luminance > beams.LEAST_RATIO * float(np.median(shade)))
    return found


def _even(rgb: Floats) -> Flags:
    """Return where hardly any detail is seen."""
    level = np.log2(np.maximum(luminance_cd_m2(rgb), 1e-6)).astype(np.float32)
    side = max(3, round(DETAIL_RAD / math.pi * len(level))) | 1
    wide = cv2.copyMakeBorder(level, 0, 0, side, side, cv2.BORDER_WRAP)
    mean, square = (cv2.boxFilter(one, cv2.CV_64F, (side, side)) for one in (wide, wide * wide))
    spread = np.sqrt(np.maximum(square - mean * mean, 0))[:, side:-side]
    # The edge of a patch is no detail of it: what is even beside a place counts for it.
    return np.asarray(cv2.erode(spread.astype(np.float32), np.ones((side, side))) < DETAIL_STOPS, bool)
