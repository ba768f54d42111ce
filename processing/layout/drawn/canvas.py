"""Shapes in metres on a sheet of paper, the symbols of furniture made of them, and the sheet as SVG and PNG.

y points up. A piece's symbol lies in its own frame, its front at +y. One matplotlib figure is saved in both forms.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Point: TypeAlias = tuple[float, float]
INCHES_PER_M = 100 / 96  # an SVG has 96 pixels an inch: 100 a metre
PNG_PX_PER_M = 110  # chosen: a room of 8 m fits a screen
POINTS_PER_M = 72 * INCHES_PER_M
HALO = "#fdfcfa"
"""Colour around letters, so that they are read on top of lines."""


@dataclass(frozen=True)
class Area:
    """A filled outline with holes; holes run the other way round than the rim."""

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
    """One line of text around a point; `anchor` is center, left or right."""

    at: Point
    text: str
    size_m: float
    fill: str = "#222222"
    anchor: str = "center"
    turn_rad: float = 0.0


Shape: TypeAlias = Area | Line | Text


@dataclass(frozen=True)
class Sheet:
    """Shapes in back-to-front order, and the rectangle of paper in metres."""

    shapes: Sequence[Shape]
    low: Point
    high: Point


def write_sheet(sheet: Sheet, stem: Path) -> list[Path]:
    """Write `stem`.svg and `stem`.png; return both."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # Letters stay letters, and the same sheet gives the same bytes.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "daylit", "font.family": "sans-serif"}):
        width_m, height_m = sheet.high[0] - sheet.low[0], sheet.high[1] - sheet.low[1]
        figure = Figure(figsize=(width_m * INCHES_PER_M, height_m * INCHES_PER_M), facecolor="white")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set(xlim=(sheet.low[0], sheet.high[0]), ylim=(sheet.low[1], sheet.high[1]))
        for depth, shape in enumerate(sheet.shapes):
            _draw(axes, shape, depth)
        vector, raster = stem.with_suffix(".svg"), stem.with_suffix(".png")
        figure.savefig(vector, metadata={"Date": None})
        figure.savefig(raster, dpi=PNG_PX_PER_M / INCHES_PER_M)
    return [vector, raster]


_ROUND: dict[str, Any] = dict.fromkeys(("solid_capstyle", "dash_capstyle", "solid_joinstyle"), "round")
_UPRIGHT = {"rotation_mode": "anchor", "va": "center_baseline"}


def _draw(axes: Axes, shape: Shape, depth: int) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline
    from matplotlib.patheffects import Stroke

    if isinstance(shape, Text):
        size = shape.size_m * POINTS_PER_M
        look: dict[str, Any] = {"color": shape.fill, "fontsize": size, "ha": shape.anchor, **_UPRIGHT}
        look["rotation"] = math.degrees(shape.turn_rad)
        halo = Stroke(linewidth=0.3 * size, foreground=HALO)
        axes.text(*shape.at, shape.text, zorder=depth, path_effects=[halo], **look)
        axes.text(*shape.at, shape.text, zorder=depth + 0.5, **look)
        return
    width = shape.width_m * POINTS_PER_M
    if isinstance(shape, Line):
        dash: Any = (0, tuple(length / shape.width_m for length in shape.dash_m)) if shape.dash_m else "-"
        x, y = zip(*shape.points, strict=True)
        line = Line2D(x, y, color=shape.stroke, linewidth=width, linestyle=dash, zorder=depth, **_ROUND)
        line.set_snap(False)
        axes.add_line(line)
        return
    rings = [Outline([*ring, ring[0]], closed=True) for ring in (shape.rim, *shape.holes)]
    outline = Outline.make_compound_path(*rings)
    patch = PathPatch(outline, facecolor=shape.fill or "none", edgecolor=shape.stroke or "none", joinstyle="round")
    patch.set(linewidth=width if shape.stroke else 0.0, zorder=depth)
    patch.set_snap(False)  # rounded to pixels, corners of nearly upright pieces go either way
    axes.add_patch(patch)


Drawn: TypeAlias = list[Shape]
INK = "#33383d"
FINE = 0.010  # chosen: lines of plans, in metres of the room
THIN = 0.006  # chosen: lines within a piece
WOOD, CLOTH, LINEN, GREEN, DARK, PALE = "#ead9bf", "#cfd6dc", "#f4f1ea", "#c9dcc0", "#4a4f55", "#e6e3dc"


def symbol(category: str, width_m: float, depth_m: float) -> Drawn:
    """Return the symbol of a kind of furniture; a plain box with its diagonal for kinds that have none."""
    drawer = _SYMBOLS.get(category, _box)
    return drawer(width_m / 2, depth_m / 2)


def _rect(x0: float, x1: float, y0: float, y1: float, fill: str = "", width_m: float = FINE) -> Area:
    return Area([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], fill, INK, width_m)


def _round(x0: float, x1: float, y0: float, y1: float, r: float, fill: str = "", width_m: float = FINE) -> Area:
    r = min(r, (x1 - x0) / 2, (y1 - y0) / 2)
    rim: list[Point] = []
    for cx, cy, start in ((x1 - r, y1 - r, 0), (x0 + r, y1 - r, 90), (x0 + r, y0 + r, 180), (x1 - r, y0 + r, 270)):
        rim += [
            (cx + r * math.cos(math.radians(start + k * 15)), cy + r * math.sin(math.radians(start + k * 15)))
            for k in range(7)
        ]
    return Area(rim, fill, INK, width_m)


def _circle(x: float, y: float, r: float, fill: str = "", width_m: float = FINE) -> Area:
    rim = [(x + r * math.cos(k * math.pi / 24), y + r * math.sin(k * math.pi / 24)) for k in range(48)]
    return Area(rim, fill, INK, width_m)


def _box(w: float, d: float) -> Drawn:
    return [_rect(-w, w, -d, d, PALE), Line([(-w, -d), (w, d)], INK, THIN)]


def _bed(w: float, d: float) -> Drawn:
    drawn: Drawn = [_rect(-w, w, -d, d, LINEN), _rect(-w, w, -d, -d + 0.07, WOOD)]
    count = 2 if w > 0.6 else 1
    wide = (2 * w - 0.12) / count
    for k in range(count):
        x0 = -w + 0.06 + k * wide
        drawn.append(_round(x0 + 0.04, x0 + wide - 0.04, -d + 0.14, -d + 0.52, 0.08, "#ffffff"))
    fold = -d + 0.68
    drawn.append(_rect(-w, w, fold, d, CLOTH))
    drawn.append(Area([(-w, fold), (w, fold), (w, fold + 0.16), (-w, fold + 0.16)], "#ffffff", INK, THIN))
    drawn.append(Line([(w - 0.42, fold + 0.16), (w, fold + 0.60)], INK, THIN))
    return drawn


def _sofa(w: float, d: float) -> Drawn:
    arm, back = min(0.16, w / 3), min(0.22, d / 2)
    drawn: Drawn = [_round(-w, w, -d, d, 0.06, CLOTH)]
    drawn += [_round(-w, -w + arm, -d, d, 0.05, CLOTH), _round(w - arm, w, -d, d, 0.05, CLOTH)]
    drawn.append(_round(-w + arm, w - arm, -d, -d + back, 0.05, CLOTH))
    count = max(1, round(2 * (w - arm) / 0.75))
    wide = 2 * (w - arm) / count
    for k in range(count):
        x0 = -w + arm + k * wide
        drawn.append(_round(x0, x0 + wide, -d + back, d, 0.05, "#dfe4e8", THIN))
    return drawn


def _nightstand(w: float, d: float) -> Drawn:
    return [_rect(-w, w, -d, d, WOOD), _circle(0, 0, 0.45 * min(w, d), "#fff7df", THIN), _circle(0, 0, 0.05, "", THIN)]


def _wardrobe(w: float, d: float) -> Drawn:
    drawn: Drawn = [_rect(-w, w, -d, d, WOOD), Line([(-w + 0.04, 0), (w - 0.04, 0)], INK, THIN)]
    count = max(3, int(2 * w / 0.11))
    for k in range(count):
        x = -w + (k + 0.5) * 2 * w / count
        lean = 0.02 * math.sin(k * 2.4)
        drawn.append(Line([(x - lean, -0.72 * d), (x + lean, 0.72 * d)], INK, THIN))
    drawn.append(Line([(0, d - 0.02), (0, d)], INK, FINE))
    return drawn


def _drawers(w: float, d: float) -> Drawn:
    drawn: Drawn = [_rect(-w, w, -d, d, WOOD), Line([(-w, d - 0.04), (w, d - 0.04)], INK, THIN)]
    return [*drawn, Line([(0, d - 0.04), (0, d)], INK, THIN)]


def _shelf(w: float, d: float) -> Drawn:
    drawn: Drawn = [_rect(-w, w, -d, d, WOOD), _rect(-w + 0.02, w - 0.02, -d + 0.02, d, "#f3e8d6", THIN)]
    x, k = -w + 0.05, 0
    while x < w - 0.10:
        thick = 0.025 + 0.015 * ((k * 7) % 3)
        drawn.append(_rect(x, x + thick, -d + 0.03, d * (0.35 + 0.12 * ((k * 5) % 4)), "#ffffff", THIN))
        x, k = x + thick + (0.0 if k % 5 else 0.03), k + 1
    return drawn


def _desk(w: float, d: float) -> Drawn:
    drawn: Drawn = [_rect(-w, w, -d, d, WOOD), _rect(-0.26, 0.26, -d + 0.07, -d + 0.12, DARK, THIN)]
    return [*drawn, _round(-0.22, 0.22, 0.02, 0.14, 0.02, "#ffffff", THIN), _circle(0.34, 0.08, 0.035, "#ffffff", THIN)]


def _desk_chair(w: float, d: float) -> Drawn:
    r = 0.86 * min(w, d)
    drawn: Drawn = [_round(-r, r, -0.72 * r, r, 0.14, CLOTH)]
    drawn += [_round(-0.85 * r, 0.85 * r, -r, -0.66 * r, 0.06, "#aeb8c1")]
    return [
        *drawn,
        _round(-w, -w + 0.07, -0.4 * d, 0.5 * d, 0.03, DARK, THIN),
        _round(w - 0.07, w, -0.4 * d, 0.5 * d, 0.03, DARK, THIN),
    ]


def _chair(w: float, d: float) -> Drawn:
    return [_round(-w, w, -d + 0.05, d, 0.06, LINEN), _round(-w, w, -d, -d + 0.08, 0.03, WOOD)]


def _table(w: float, d: float) -> Drawn:
    return [_round(-w, w, -d, d, 0.05, WOOD), _round(-w + 0.04, w - 0.04, -d + 0.04, d - 0.04, 0.03, "", THIN)]


def _stand(w: float, d: float) -> Drawn:
    return [_rect(-w, w, -d, d, WOOD), *(Line([(x, d - 0.03), (x, d)], INK, THIN) for x in (-w / 3, w / 3))]


def _screen(w: float, d: float) -> Drawn:
    return [_rect(-w, w, -d, d, DARK), _rect(-0.18, 0.18, -d - 0.05, d + 0.03, DARK, THIN)]


def _rug(w: float, d: float) -> Drawn:
    drawn: Drawn = [_rect(-w, w, -d, d, "#f0e7e1", THIN), _rect(-w + 0.08, w - 0.08, -d + 0.08, d - 0.08, "", THIN)]
    count = int(2 * d / 0.06)
    for k in range(count + 1):
        y = -d + 2 * d * k / count
        drawn += [Line([(side * w, y), (side * (w + 0.03), y)], INK, 0.004) for side in (-1, 1)]
    return drawn


def _lamp(w: float, d: float) -> Drawn:
    r = min(w, d)
    drawn: Drawn = [_circle(0, 0, r, "#fff7df"), _circle(0, 0, 0.35 * r, "", THIN)]
    return [*drawn, Line([(-r, 0), (r, 0)], INK, THIN), Line([(0, -r), (0, r)], INK, THIN)]


def _plant(w: float, d: float) -> Drawn:
    r, drawn = min(w, d), list[Shape]()
    for k in range(9):
        a = k * 2 * math.pi / 9
        tip = (r * math.cos(a), r * math.sin(a))
        sides = [(0.55 * r * math.cos(a + s), 0.55 * r * math.sin(a + s)) for s in (-0.32, 0.32)]
        drawn.append(Area([(0, 0), sides[0], tip, sides[1]], GREEN, INK, THIN))
    return [*drawn, _circle(0, 0, 0.18 * r, "#ffffff", THIN)]


_DRAWERS: dict[Callable[[float, float], Drawn], tuple[str, ...]] = {
    _bed: ("bed", "single bed", "king bed"),
    _sofa: ("sofa", "armchair"),
    _nightstand: ("nightstand",),
    _wardrobe: ("wardrobe",),
    _drawers: ("chest",),
    _shelf: ("bookshelf",),
    _desk: ("desk",),
    _desk_chair: ("desk chair",),
    _chair: ("dining chair",),
    _table: ("dining table", "coffee table"),
    _stand: ("tv stand",),
    _screen: ("tv",),
    _rug: ("rug",),
    _lamp: ("floor lamp",),
    _plant: ("plant",),
}
_SYMBOLS = {kind: drawer for drawer, kinds in _DRAWERS.items() for kind in kinds}
