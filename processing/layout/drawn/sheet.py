"""A contact sheet of models."""

from __future__ import annotations

import math
from collections.abc import Sequence

from PIL import Image, ImageDraw, ImageFont

from processing.layout.drawn.preview import preview
from processing.layout.furniture.model import FurnitureModel

PAPER = "#e3e1de"
INK, GREY = "#2f3337", "#7a8087"


def model_sheet(
    models: Sequence[FurnitureModel], *, columns: int = 0, cell_px: int = 300, azimuth_rad: float = -0.62
) -> Image.Image:
    """Return pictures of models in rows, each with its name and its size in centimetres."""
    columns = columns or max(1, min(len(models), round(math.sqrt(1.6 * len(models)))))
    rows = math.ceil(len(models) / columns)
    text_px = round(0.15 * cell_px)
    sheet = Image.new("RGB", (columns * cell_px, rows * (cell_px + text_px)), PAPER)
    draw = ImageDraw.Draw(sheet)
    name_font, size_font = ImageFont.load_default(0.052 * cell_px), ImageFont.load_default(0.042 * cell_px)
    for number, model in enumerate(models):
        x, y = number % columns * cell_px, number // columns * (cell_px + text_px)
        sheet.paste(preview(model, size_px=(cell_px, cell_px), azimuth_rad=azimuth_rad), (x, y))
        middle, base = x + cell_px // 2, y + cell_px
        draw.rectangle((x, base, x + cell_px, base + text_px), fill=PAPER)
        draw.text((middle, base + 0.01 * cell_px), model.model_id, INK, name_font, anchor="mt")
        size = " x ".join(f"{100 * v:.0f}" for v in model.size_m) + " cm"
        draw.text((middle, base + 0.075 * cell_px), size, GREY, size_font, anchor="mt")
    return sheet


def two_sides(model: FurnitureModel, side_px: int = 640) -> Image.Image:
    """Return a model seen from the front and from behind, side by side."""
    sheet = Image.new("RGB", (2 * side_px, side_px), PAPER)
    for number, azimuth_rad in enumerate((-0.62, 2.45)):
        sheet.paste(preview(model, size_px=(side_px, side_px), azimuth_rad=azimuth_rad), (number * side_px, 0))
    return sheet
