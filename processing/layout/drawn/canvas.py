"""Shapes in metres on a sheet of paper, the symbols of furniture made of them, and the sheet as SVG and PNG.

y points up. A piece's symbol lies in its own frame, its front at +y. One matplotlib figure is saved in both forms.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from processing.ground.designs import build
from processing.ground.tables import table_of
from processing.pictures.writing import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Point: TypeAlias = tuple[float, float]
INCHES_PER_M = 100 / 96  # an SVG has 96 pixels an inch: 100 a metre
PNG_PX_PER_M, MOST_PNG_PX = 110, 8000  # chosen: a room of 8 m fits a screen, every program opens a hall's picture
POINTS_PER_M = 72 * INCHES_PER_M
HALO = "#fdfcfa"
"""Colour around letters, so that they are read on top of lines."""
_ROUND: dict[str, Any] = dict.fromkeys(("solid_capstyle", "dash_capstyle", "solid_joinstyle"), "round")
_UPRIGHT = {"rotation_mode": "anchor", "va": "center_baseline"}
INK = "#33383d"
FINE = 0.010  # chosen: lines of plans, in metres of the room
THIN = 0.006  # chosen: lines within a piece


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
        write_whole(vector, lambda part: figure.savefig(part, metadata={"Date": None}))
        px_per_m = min(PNG_PX_PER_M, MOST_PNG_PX / max(width_m, height_m))
        write_whole(raster, lambda part: figure.savefig(part, dpi=px_per_m / INCHES_PER_M))
    return [vector, raster]


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


def symbol(category: str, width_m: float, depth_m: float) -> list[Shape]:
    """Return the symbol of a kind of furniture (`symbols.toml`); a plain box with its diagonal for unknown kinds."""
    table = table_of(__package__, "symbols")
    kind = table["like"].get(category, category)
    drawn: list[Shape] = []
    build(table.get(kind, table["other"]), (width_m, depth_m, 0.0), _Pen(drawn, table["fills"]).verbs())
    return drawn


@dataclass(frozen=True)
class _Pen:
    """Draws the shapes of symbols: each verb takes the fill's name and measures in metres."""

    drawn: list[Shape]
    fills: dict[str, str]

    def verbs(self) -> dict[str, Callable[..., None]]:
        return {verb.__name__: verb for verb in (self.rect, self.round, self.circle, self.leaf, self.books, self.line)}

    def _area(self, rim: Sequence[Point], fill: str, thin: int) -> None:
        self.drawn.append(Area(rim, self.fills[fill], INK, THIN if thin else FINE))

    def rect(self, fill: str, x: Point, y: Point, thin: int = 0) -> None:
        self._area([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])], fill, thin)

    def round(self, fill: str, x: Point, y: Point, r: float, thin: int = 0) -> None:
        """Add a rectangle with round corners."""
        r = min(r, (x[1] - x[0]) / 2, (y[1] - y[0]) / 2)
        corners = ((x[1] - r, y[1] - r), (x[0] + r, y[1] - r), (x[0] + r, y[0] + r), (x[1] - r, y[0] + r))
        turns = [[math.radians(90 * n + 15 * k) for k in range(7)] for n in range(4)]
        rim = [
            (cx + r * math.cos(a), cy + r * math.sin(a))
            for (cx, cy), quarter in zip(corners, turns, strict=True)
            for a in quarter
        ]
        self._area(rim, fill, thin)

    def circle(self, fill: str, r: float, at: Point = (0, 0), thin: int = 0) -> None:
        turns = [k * math.pi / 24 for k in range(48)]
        self._area([(at[0] + r * math.cos(a), at[1] + r * math.sin(a)) for a in turns], fill, thin)

    def leaf(self, fill: str, r: float, turn: float) -> None:
        """Add a leaf from the middle outwards."""
        ways = ((0.55 * r, turn - 0.32), (r, turn), (0.55 * r, turn + 0.32))
        self._area([(0, 0), *((out * math.cos(a), out * math.sin(a)) for out, a in ways)], fill, 1)

    def books(self, fill: str, x: Point, y: float, deep: float) -> None:
        """Add upright books from y on, a gap after every fifth; `x`: where the first begins and the last may begin."""
        at, k = x[0], 0
        while at < x[1]:
            thick = 0.025 + 0.015 * ((k * 7) % 3)
            self.rect(fill, (at, at + thick), (y, deep * (0.35 + 0.12 * ((k * 5) % 4))), 1)
            at, k = at + thick + (0.0 if k % 5 else 0.03), k + 1

    def line(self, _: str, points: Sequence[Point], width: float = THIN) -> None:
        self.drawn.append(Line(points, INK, width))
