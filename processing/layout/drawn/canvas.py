"""Shapes in metres, and two ways to put them on paper: SVG text and PNG through Pillow. y points up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias
from xml.sax.saxutils import escape

from PIL import Image, ImageDraw, ImageFont

Point: TypeAlias = tuple[float, float]
SUPER = 3
"""Pixels are drawn this much finer and averaged."""


@dataclass(frozen=True)
class Area:
    """A filled outline with holes."""

    rim: Sequence[Point]
    fill: str = ""
    stroke: str = ""
    width_m: float = 0.01
    holes: Sequence[Sequence[Point]] = ()


@dataclass(frozen=True)
class Line:
    """A polyline, dashed where `dash_m` is given."""

    points: Sequence[Point]
    stroke: str
    width_m: float = 0.01
    dash_m: tuple[float, float] | None = None


@dataclass(frozen=True)
class Text:
    """One line of text around a point; `anchor` is middle, start or end."""

    at: Point
    text: str
    size_m: float
    fill: str = "#222222"
    anchor: str = "middle"
    turn_rad: float = 0.0


Shape: TypeAlias = Area | Line | Text


@dataclass(frozen=True)
class Sheet:
    """Shapes in back-to-front order, and the rectangle of paper in metres."""

    shapes: Sequence[Shape]
    low: Point
    high: Point

    @property
    def size_m(self) -> Point:
        """Return width and height of the paper."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]


def svg(sheet: Sheet, px_per_m: float = 100.0) -> str:
    """Return the sheet as SVG."""
    width_m, height_m = sheet.size_m
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width_m * px_per_m:.0f}" height="{height_m * px_per_m:.0f}" '
        f'viewBox="0 0 {width_m:.3f} {height_m:.3f}" font-family="Helvetica, Arial, sans-serif">'
    )
    paper = f'<rect width="{width_m:.3f}" height="{height_m:.3f}" fill="#ffffff"/>'
    return "\n".join([head, paper, *(_svg_shape(s, sheet) for s in sheet.shapes), "</svg>\n"])


def _svg_shape(shape: Shape, sheet: Sheet) -> str:
    def at(p: Point) -> str:
        return f"{p[0] - sheet.low[0]:.4f} {sheet.high[1] - p[1]:.4f}"

    if isinstance(shape, Text):
        x, y = at(shape.at).split()
        turn = f' transform="rotate({-math.degrees(shape.turn_rad):.2f} {x} {y})"' if shape.turn_rad else ""
        return (
            f'<text x="{x}" y="{y}" font-size="{shape.size_m:.3f}" fill="{shape.fill}" text-anchor="{shape.anchor}" '
            f'dominant-baseline="central" paint-order="stroke" stroke="#fdfcfa" '
            f'stroke-width="{0.3 * shape.size_m:.3f}" stroke-linejoin="round"{turn}>{escape(shape.text)}</text>'
        )
    if isinstance(shape, Line):
        dash = f' stroke-dasharray="{shape.dash_m[0]} {shape.dash_m[1]}"' if shape.dash_m else ""
        return (
            f'<path d="M{" L".join(at(p) for p in shape.points)}" fill="none" stroke="{shape.stroke}" '
            f'stroke-width="{shape.width_m:.4f}" stroke-linejoin="round" stroke-linecap="round"{dash}/>'
        )
    rings = " ".join(f"M{' L'.join(at(p) for p in ring)} Z" for ring in (shape.rim, *shape.holes))
    edge = f' stroke="{shape.stroke}" stroke-width="{shape.width_m:.4f}"' if shape.stroke else ""
    return f'<path d="{rings}" fill="{shape.fill or "none"}" fill-rule="evenodd"{edge} stroke-linejoin="round"/>'


def png_image(sheet: Sheet, px_per_m: float = 110.0) -> Image.Image:
    """Return the sheet as a picture."""
    scale = px_per_m * SUPER
    width_m, height_m = sheet.size_m
    picture = Image.new("RGB", (max(1, round(width_m * scale)), max(1, round(height_m * scale))), "#ffffff")
    draw = ImageDraw.Draw(picture)
    for shape in sheet.shapes:
        _draw(picture, draw, shape, sheet, scale)
    return picture.resize((max(1, picture.width // SUPER), max(1, picture.height // SUPER)), Image.Resampling.BOX)


def _draw(picture: Image.Image, draw: ImageDraw.ImageDraw, shape: Shape, sheet: Sheet, scale: float) -> None:
    def at(p: Point) -> Point:
        return (p[0] - sheet.low[0]) * scale, (sheet.high[1] - p[1]) * scale

    if isinstance(shape, Text):
        _draw_text(picture, shape, at(shape.at), scale)
        return
    width = max(1, round(shape.width_m * scale))
    if isinstance(shape, Line):
        pieces = _dashes(shape.points, shape.dash_m) if shape.dash_m else [shape.points]
        for piece in pieces:
            draw.line([at(p) for p in piece], fill=shape.stroke, width=width, joint="curve")
        return
    if shape.holes and shape.fill:
        mask = Image.new("L", picture.size, 0)
        cut = ImageDraw.Draw(mask)
        cut.polygon([at(p) for p in shape.rim], fill=255)
        for hole in shape.holes:
            cut.polygon([at(p) for p in hole], fill=0)
        picture.paste(Image.new("RGB", picture.size, shape.fill), mask=mask)
    elif shape.fill:
        draw.polygon([at(p) for p in shape.rim], fill=shape.fill)
    if shape.stroke:
        for ring in (shape.rim, *shape.holes):
            draw.line([at(p) for p in (*ring, ring[0], ring[1])], fill=shape.stroke, width=width, joint="curve")


def _draw_text(picture: Image.Image, shape: Text, at: Point, scale: float) -> None:
    font = ImageFont.load_default(size=max(8.0, shape.size_m * scale))
    halo = max(1, round(0.15 * shape.size_m * scale))
    left, top, right, bottom = font.getbbox(shape.text, stroke_width=halo)
    label = Image.new("RGBA", (int(right - left) + 4, int(bottom - top) + 4), (253, 252, 250, 0))
    ImageDraw.Draw(label).text(
        (2 - left, 2 - top), shape.text, font=font, fill=shape.fill, stroke_width=halo, stroke_fill="#fdfcfa"
    )
    shift = {"middle": 0.5, "start": 0.0, "end": 1.0}[shape.anchor]
    if shape.turn_rad:
        label = label.rotate(math.degrees(shape.turn_rad), expand=True, resample=Image.Resampling.BICUBIC)
    picture.paste(label, (round(at[0] - shift * label.width), round(at[1] - label.height / 2)), label)


def _dashes(points: Sequence[Point], dash_m: tuple[float, float]) -> list[list[Point]]:
    """Return the drawn pieces of a dashed polyline."""
    on, off = dash_m
    pieces: list[list[Point]] = []
    walked = 0.0
    for a, b in pairwise(points):
        length = math.dist(a, b)
        if length == 0:
            continue
        start = 0.0
        while start < length:
            phase = (walked + start) % (on + off)
            run = on - phase if phase < on else on + off - phase
            end = min(length, start + max(run, 1e-6))
            if phase < on:
                pieces.append([_along(a, b, start / length), _along(a, b, end / length)])
            start = end
        walked += length
    return pieces


def _along(a: Point, b: Point, t: float) -> Point:
    return a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])


def write_sheet(sheet: Sheet, stem: Path) -> list[Path]:
    """Write `stem`.svg and `stem`.png; return both."""
    vector, raster = stem.with_suffix(".svg"), stem.with_suffix(".png")
    vector.write_text(svg(sheet), "utf-8")
    png_image(sheet).save(raster)
    return [vector, raster]
