"""Pictures of furniture models: in a white studio with one large window, by the light that rooms are rendered with."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from processing.ground.arrays import Doubles
from processing.ground.colour import srgb_of_linear
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.layout.furniture.model import FurnitureModel
from processing.light.picture.render import render
from processing.light.scene.scene import Outdoors, Scene, plain, shell_of
from processing.light.solver.irradiance import EFFORTS
from processing.sphere import Perspective
from processing.stages.furnishing import scene_parts

# All constants of the look were chosen by eye.
PAPER, INK, GREY = "#e3e1de", "#2f3337", "#7a8087"
WHITE = 0.82  # albedo of the studio
SUPER = 2  # pixels are drawn this much finer and averaged
FIELD_RAD = math.radians(24.0)
MARGIN = 0.86  # share of the picture that the furniture's bounds fill at most
FROM_THE_RIGHT_RAD, FROM_BEHIND_RAD, ELEVATION_RAD = -0.62, 2.45, 0.30
ROOM, HIGH = 1.25, 0.8  # half the studio's width and its height, times the camera's distance
GROUND_LEVEL, SHOULDER = 0.72, 0.7  # linear value of the ground's brightest tenth, and from where highlights roll off
EFFORT = replace(EFFORTS["draft"], rows=256, pixel_samples=32, cleaning="high")


def preview(model: FurnitureModel, size_px: int, azimuth_rad: float) -> Image.Image:
    """Return a square picture seen from the front (+y), the camera going round to the left (-x) by ``azimuth_rad``.

    Raises `EngineError` where Embree is not installed (Linux on ARM).
    """
    vertices = np.concatenate([part.vertices for part in model.parts]).astype(np.float64)
    eye, away_m = _eye(vertices.min(axis=0), vertices.max(axis=0), azimuth_rad)
    yaw_rad = math.atan2(math.sin(azimuth_rad), -math.cos(azimuth_rad))
    view = Perspective(size_px * SUPER, size_px * SUPER, FIELD_RAD, yaw_rad=yaw_rad, pitch_rad=-ELEVATION_RAD)
    scene = _studio(away_m, yaw_rad, float(vertices[:, 2].max())).furnished(scene_parts(model.parts))
    drawn = render(scene, view, (float(eye[0]), float(eye[1]), float(eye[2])), effort=EFFORT).rgb
    toned = GROUND_LEVEL * drawn / np.quantile(drawn[-SUPER * size_px // 8 :], 0.9)
    toned = np.where(toned < SHOULDER, toned, SHOULDER + (1 - SHOULDER) * np.tanh((toned - SHOULDER) / (1 - SHOULDER)))
    small = cv2.resize(toned.astype(np.float32), (size_px, size_px), interpolation=cv2.INTER_AREA)
    return Image.fromarray(srgb_of_linear(small))


def _eye(low: Doubles, high: Doubles, azimuth_rad: float) -> tuple[Doubles, float]:
    """Return a place (3,) from which all of a box is in a square view with a margin, and its distance, m."""
    c, s = math.cos(ELEVATION_RAD), math.sin(ELEVATION_RAD)
    forward = np.array([math.sin(azimuth_rad) * c, -math.cos(azimuth_rad) * c, -s])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    local = (corners - corners.mean(axis=0)) @ np.stack([right, np.cross(right, forward), forward]).T
    away = np.abs(local[:, :2]).max(axis=1) / (MARGIN * math.tan(FIELD_RAD / 2)) - local[:, 2]
    return corners.mean(axis=0) - forward * float(away.max()), float(away.max())


def _studio(away_m: float, yaw_rad: float, tall_m: float) -> Scene:
    """Return an empty white room, turned so that its window is on the left of a camera ``away_m`` from the middle."""
    half, high = ROOM * away_m, max(HIGH * away_m, 1.5 * tall_m)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    # Wall 3 runs from ahead to behind on the left.
    span = {"start_m": 0.2 * half, "end_m": 1.8 * half, "sill_m": 0.05 * high, "head_m": 0.95 * high}
    room = RoomModel(
        source="given",
        floor=tuple((x * c + y * s, y * c - x * s) for x, y in corners),
        camera_height_m=high / 2,
        ceiling_height_m=high,
        openings=(Opening(kind=OpeningKind.WINDOW, wall=3, **span),),
    )
    surfaces, panes = shell_of(room, reveal_m=0.0, albedo=lambda _: plain(WHITE))
    return Scene(surfaces, panes, Outdoors(np.full((16, 32, 3), 1000, np.float32)))


def model_sheet(models: Sequence[FurnitureModel], cell_px: int) -> Image.Image:
    """Return pictures of models in rows, each with its name and its size in centimetres."""
    columns = max(1, min(len(models), round(math.sqrt(1.6 * len(models)))))
    rows = math.ceil(len(models) / columns)
    text_px = round(0.15 * cell_px)
    sheet = Image.new("RGB", (columns * cell_px, rows * (cell_px + text_px)), PAPER)
    draw = ImageDraw.Draw(sheet)
    name_font, size_font = ImageFont.load_default(0.052 * cell_px), ImageFont.load_default(0.042 * cell_px)
    for number, model in enumerate(models):
        x, y = number % columns * cell_px, number // columns * (cell_px + text_px)
        sheet.paste(preview(model, cell_px, FROM_THE_RIGHT_RAD), (x, y))
        middle, base = x + cell_px // 2, y + cell_px
        draw.text((middle, base + 0.01 * cell_px), model.model_id, INK, name_font, anchor="mt")
        size = " x ".join(f"{100 * v:.0f}" for v in model.size_m) + " cm"
        draw.text((middle, base + 0.075 * cell_px), size, GREY, size_font, anchor="mt")
    return sheet


def two_sides(model: FurnitureModel, side_px: int = 640) -> Image.Image:
    """Return a model seen from the front and from behind, side by side."""
    sheet = Image.new("RGB", (2 * side_px, side_px), PAPER)
    for number, azimuth_rad in enumerate((FROM_THE_RIGHT_RAD, FROM_BEHIND_RAD)):
        sheet.paste(preview(model, side_px, azimuth_rad), (number * side_px, 0))
    return sheet
