"""Floor plans of arrangements, as an architect draws them: walls, openings, furniture, use zones, routes, sizes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from PIL import Image
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import LineString, Polygon

from processing.ground.arrays import Doubles
from processing.layout.arrangement import Arrangement, Arrangements, PlacedItem
from processing.layout.drawn.canvas import Area, Line, Point, Shape, Sheet, Text, symbol, write_sheet
from processing.layout.plan import Door, FloorPlan, Window
from processing.layout.plan_files import plan_from_mapping
from processing.layout.rules import RuleSet, built_in_rules
from processing.layout.solver.poses import Frame
from processing.layout.styling import outline
from processing.pictures.writing import write_whole

WALL_M = 0.14  # chosen by eye, as all below
INK, WALL, PAPER, ZONE, ROUTE, GREY = "#33383d", "#3b4046", "#ffffff", "#8db4d8", "#d1495b", "#767d84"
FLOOR = "#fbfaf7"
MARGIN_M = 0.70  # chosen by eye
HEAD_M = 0.55  # sizes and colours of the drawing were chosen by eye
CELL_M = 0.08  # cells of the grid on which routes are searched (chosen: a route to a stride's tenth)


def plan_sheet(plan: FloorPlan, arrangement: Arrangement, *, rules: RuleSet | None = None) -> Sheet:
    """Return the drawing of one arrangement."""
    low, high = plan.corners.min(axis=0), plan.corners.max(axis=0)
    shapes = [*_shell(plan), *_furniture(arrangement.items)]
    shapes += [Line([*m, m[0]], ZONE, 0.008, (0.06, 0.05)) for item in arrangement.items for m in _zone_rims(item)]
    turns = [(0.3 * math.cos(k * math.pi / 12), 0.3 * math.sin(k * math.pi / 12)) for k in range(24)]
    shapes += [Area([(x + dx, y + dy) for dx, dy in turns], "", GREY, 0.008) for x, y in plan.keep_free]
    shapes += _routes(plan, arrangement, rules or built_in_rules().sets.get(arrangement.rule_set))
    shapes += [*_labels(arrangement.items), *_sizes(plan)]
    top = float(high[1]) + MARGIN_M + HEAD_M
    shapes += _caption(plan, arrangement, float(low[0]) - WALL_M, top)
    return Sheet(shapes, (float(low[0]) - MARGIN_M, float(low[1]) - MARGIN_M), (float(high[0]) + MARGIN_M, top))


def floor_plan(plan: FloorPlan, items: Sequence[PlacedItem]) -> Sheet:
    """Return walls, openings, furniture and sizes, as who buys or lets a room reads them: no zones, routes or scores.

    Its longest wall is level.
    """
    _, along, _ = max((plan.edge(k) for k in range(len(plan.corners))), key=lambda edge: edge[2])
    level = Frame((0.0, 0.0), math.remainder(math.atan2(along[1], along[0]), math.pi / 2), mirrored=False)
    corners, *holes = (
        np.array([level.into((float(x), float(y), 0.0))[:2] for x, y in ring]) for ring in (plan.corners, *plan.holes)
    )
    plan, turned = replace(plan, corners=corners, holes=tuple(holes)), []
    for item in items:
        x, y, theta_rad = level.into((*item.t_m[:2], item.theta_rad))
        turned.append(item.model_copy(update={"t_m": (x, y, item.t_m[2]), "theta_rad": theta_rad}))
    named = [item for item in turned if item.category != "rug"]
    shapes = [*_shell(plan), *_furniture(turned), *_labels(named), *_sizes(plan)]
    low, high = corners.min(axis=0) - MARGIN_M, corners.max(axis=0) + MARGIN_M
    return Sheet(shapes, (float(low[0]), float(low[1])), (float(high[0]), float(high[1])))


def _shell(plan: FloorPlan) -> list[Shape]:
    """Return floor, walls, columns, doors and windows."""
    room = Polygon(plan.corners)
    solid = room.buffer(WALL_M, join_style="mitre", mitre_limit=3).difference(room)
    openings: list[Door | Window] = [*plan.doors, *plan.windows]
    gaps = [_strip(plan, o.edge, o.start_m, o.end_m, -WALL_M - 0.01, 0.005) for o in openings]
    parts = shapely.get_parts(solid.difference(shapely.union_all([Polygon(g) for g in gaps])))
    shapes: list[Shape] = [Area(_ring(plan.corners), FLOOR)]
    shapes += [
        Area(_ring(p.exterior.coords), WALL, INK, 0.012, [_ring(i.coords) for i in p.interiors])
        for p in parts
        if not p.is_empty
    ]
    shapes += [Area(_ring(hole), WALL, INK, 0.012) for hole in plan.holes]
    for window in plan.windows:
        middle = [_on(plan, window.edge, t, -WALL_M / 2) for t in (window.start_m, window.end_m)]
        rim = _strip(plan, window.edge, window.start_m, window.end_m, -WALL_M, 0.0)
        shapes += [Area(rim, PAPER, INK, 0.010), Line(middle, INK, 0.010)]
    for door in plan.doors:
        shapes += _door(plan, door)
    return shapes


def _ring(coords: object) -> list[Point]:
    return [(float(x), float(y)) for x, y in coords]  # type: ignore[attr-defined]


def _strip(plan: FloorPlan, edge: int, start_m: float, end_m: float, y0: float, y1: float) -> list[Point]:
    return [_on(plan, edge, t, y) for t, y in ((start_m, y0), (end_m, y0), (end_m, y1), (start_m, y1))]


def _on(plan: FloorPlan, edge: int, along_m: float, inward_m: float) -> Point:
    corner, u, _ = plan.edge(edge)
    return float(corner[0] + along_m * u[0] - inward_m * u[1]), float(corner[1] + along_m * u[1] + inward_m * u[0])


def _door(plan: FloorPlan, door: Door) -> list[Shape]:
    """Return a threshold, and leaf and swing (dashed where the hand is not known); sliding doors as two panels."""
    shapes: list[Shape] = [Area(_strip(plan, door.edge, door.start_m, door.end_m, -WALL_M, 0.0), PAPER, GREY, 0.004)]
    wide = door.end_m - door.start_m
    if door.swing == "sliding" or (wide > 2.0 and door.swing != "in"):
        half = (door.start_m + door.end_m) / 2
        for t0, t1, y in ((door.start_m, half + 0.06, -0.045), (half - 0.06, door.end_m, -0.095)):
            shapes.append(Area(_strip(plan, door.edge, t0, t1, y - 0.018, y + 0.018), PAPER, INK, 0.008))
        return shapes
    pair = wide > 1.0 and door.swing == "unknown"
    leaf = wide / 2 if pair else wide
    hands = ["left", "right"] if pair else [door.hinge if door.hinge != "unknown" else "right"]
    sign = -1.0 if door.swing == "out" else 1.0
    for hand in hands:
        at, turn = (door.end_m, -1.0) if hand == "left" else (door.start_m, 1.0)
        start = -WALL_M if sign < 0 else 0.0
        arc = [
            _on(plan, door.edge, at + turn * leaf * math.cos(a), start + sign * leaf * math.sin(a))
            for a in (k * math.pi / 36 for k in range(19))
        ]
        shapes.append(Line(arc, GREY, 0.007, None if door.hinge != "unknown" or pair else (0.05, 0.04)))
        ends = sorted((at, at + turn * 0.035))
        shapes.append(
            Area(_strip(plan, door.edge, ends[0], ends[1], *sorted((start, start + sign * leaf))), PAPER, INK, 0.008)
        )
    return shapes


def _furniture(items: Sequence[PlacedItem]) -> list[Shape]:
    shapes: list[Shape] = []
    for item in sorted(items, key=lambda i: (i.category != "rug", i.base_m, i.size_m[2])):
        for shape in symbol(item.category, item.size_m[0], item.size_m[1]):
            if isinstance(shape, Area):
                shapes.append(Area([item.place(*p) for p in shape.rim], shape.fill, shape.stroke, shape.width_m))
            elif isinstance(shape, Line):
                shapes.append(Line([item.place(*p) for p in shape.points], shape.stroke, shape.width_m, shape.dash_m))
    return shapes


def _zone_rims(item: PlacedItem) -> list[list[Point]]:
    zones = (((x0, y0), (x1, y0), (x1, y1), (x0, y1)) for x0, x1, y0, y1 in item.use_zones_m)
    return [[item.place(*corner) for corner in zone] for zone in zones]


def _routes(plan: FloorPlan, arrangement: Arrangement, rules: RuleSet | None) -> list[Shape]:
    if rules is None:
        return []
    deep = max(rules.door_approach, rules.path / 2 + 0.1)
    doors = [Polygon(_strip(plan, d.edge, d.start_m, d.end_m, 0.0, deep)) for d in plan.doors]
    solid, goals = [], []
    for item in arrangement.items:
        if item.category != "rug" and item.base_m < 2.0:
            solid.append(Polygon(outline(item)))
        goals += [Polygon(rim) for rim in _zone_rims(item)]
    found = routes(plan, solid, doors, goals, rules.path)
    shapes: list[Shape] = []
    for line in found:
        shapes.append(Line(line, ROUTE, 0.012, (0.012, 0.055)))
        (x, y), turns = line[-1], [k * 0.5236 for k in range(12)]
        shapes.append(Area([(x + 0.03 * math.cos(turn), y + 0.03 * math.sin(turn)) for turn in turns], ROUTE))
    return shapes


def _labels(items: Sequence[PlacedItem]) -> list[Shape]:
    shapes: list[Shape] = []
    for item in items:
        if item.category in {"tv", "dining chair", "desk chair", "floor lamp", "plant", "nightstand"}:
            continue
        long_way, deep_way = item.size_m[0], item.size_m[1]
        turn = item.theta_rad if long_way >= deep_way else item.theta_rad + math.pi / 2
        turn = math.remainder(turn, math.pi)
        turn = turn if turn > -math.pi / 2 + 1e-6 else turn + math.pi
        size = min(0.13, 1.55 * max(long_way, deep_way) / max(4, len(item.category)))
        ahead = 0.22 if "bed" in item.category else -0.42 if item.category == "rug" else 0.0
        shapes.append(Text(item.place(0.0, ahead * deep_way), item.category, size, INK, turn_rad=turn))
    return shapes


def _sizes(plan: FloorPlan) -> list[Shape]:
    """Return a dimension line along each wall, outside it."""
    shapes: list[Shape] = []
    for edge in range(len(plan.corners)):
        _, way, long_m = plan.edge(edge)
        shapes.append(Line([_on(plan, edge, s, -0.38) for s in (0.0, long_m)], GREY, 0.006))
        for s in (0.0, long_m):
            shapes.append(Line([_on(plan, edge, s - 0.05, -0.43), _on(plan, edge, s + 0.05, -0.33)], GREY, 0.010))
        turn = math.remainder(math.atan2(way[1], way[0]), math.pi)
        shapes.append(Text(_on(plan, edge, long_m / 2, -0.50), f"{long_m:.2f} m", 0.12, GREY, turn_rad=turn))
    return shapes


def _caption(plan: FloorPlan, arrangement: Arrangement, x: float, top: float) -> list[Shape]:
    meets = ", ".join(arrangement.meets) or arrangement.rule_set
    first = f"Layout {arrangement.rank}   ·   score {arrangement.score:.2f}"
    second = f"{plan.area_m2:.1f} m²   ·   meets {meets}"
    if arrangement.not_placed:
        second += f"   ·   not placed: {', '.join(n.id for n in arrangement.not_placed)}"
    return [Text((x, top - 0.20), first, 0.19, INK, "left"), Text((x, top - 0.43), second, 0.12, GREY, "left")]


def write_drawings(result: Arrangements, folder: Path, rules: RuleSet | None = None) -> list[Path]:
    """Write layout-N.svg and .png for each arrangement, and contact-sheet.png of all; return the paths."""
    plan = plan_from_mapping(result.plan, where="plan")
    written: list[Path] = []
    pictures = []
    for arrangement in result.arrangements:
        written += write_sheet(plan_sheet(plan, arrangement, rules=rules), folder / f"layout-{arrangement.rank}")
        pictures.append(Image.open(written[-1]).convert("RGB"))
    if pictures:
        path = folder / "contact-sheet.png"
        write_whole(path, contact_sheet(pictures).save)
        written.append(path)
    return written


def contact_sheet(pictures: Sequence[Image.Image], width_px: int = 1800) -> Image.Image:
    """Return pictures side by side, as many a row as makes the sheet about 4:3."""
    cell_w, cell_h = max(p.width for p in pictures), max(p.height for p in pictures)
    columns = max(1, min(len(pictures), round(math.sqrt(len(pictures) * 4 / 3 * cell_h / cell_w))))
    rows = math.ceil(len(pictures) / columns)
    scale = min(1.0, width_px / (columns * cell_w))
    w, h = round(cell_w * scale), round(cell_h * scale)
    sheet = Image.new("RGB", (columns * w, rows * h), "#ffffff")
    for number, picture in enumerate(pictures):
        small = picture.resize((round(picture.width * scale), round(picture.height * scale)), Image.Resampling.LANCZOS)
        sheet.paste(
            small, ((number % columns) * w + (w - small.width) // 2, (number // columns) * h + (h - small.height) // 2)
        )
    return sheet


def routes(
    plan: FloorPlan, solid: Sequence[Polygon], doors: Sequence[Polygon], goals: Sequence[Polygon], width_m: float
) -> list[list[Point]]:
    """Return polylines from the first door's floor to each other door and goal that a path of `width_m` reaches."""
    floor = Polygon(plan.corners, list(plan.holes)).difference(shapely.union_all(list(solid)))
    parts = shapely.get_parts(floor.buffer(-(width_m - 0.001) / 2))
    part = max(parts, key=lambda p: (any(p.intersects(d) for d in doors), p.area))
    doors = [door for door in doors if part.intersects(door)]
    if not doors:
        return []
    nodes, graph = _grid_graph(part)
    spots = shapely.points(nodes)
    starts = np.flatnonzero(shapely.intersects(doors[0], spots))
    if not len(starts):
        return []
    start = starts[np.argmin(shapely.distance(spots[starts], doors[0].centroid))]
    costs, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    found = []
    for goal in (*doors[1:], *goals):
        gaps = shapely.distance(spots, goal)
        totals = np.where(gaps <= width_m / 2, costs + 3 * gaps, math.inf)
        chain = [int(np.argmin(totals))]
        if math.isfinite(totals[chain[0]]):
            while before[chain[-1]] >= 0:
                chain.append(int(before[chain[-1]]))
            found.append(_straightened(part, [(float(nodes[n][0]), float(nodes[n][1])) for n in reversed(chain)]))
    return found


def _grid_graph(part: Polygon) -> tuple[Doubles, Any]:
    """Return the grid's points inside a polygon, (N, 2) metres, and the graph of eight neighbours, lengths in cells."""
    x0, y0, x1, y1 = part.bounds
    x, y = np.meshgrid(np.arange(x0 + CELL_M / 2, x1 + CELL_M, CELL_M), np.arange(y0 + CELL_M / 2, y1 + CELL_M, CELL_M))
    inside = shapely.contains_xy(part, x, y)
    number = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)
    rows, columns = inside.shape
    ends, lengths = [], []
    for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = number[: rows - di, max(0, -dj) : columns - max(0, dj)]
        b = number[di:, max(0, dj) : columns + min(0, dj)]
        joined = (a >= 0) & (b >= 0)
        ends.append(np.stack([a[joined], b[joined]]))
        lengths.append(np.full(int(joined.sum()), math.hypot(di, dj)))
    count = int(inside.sum())
    graph = csr_matrix((np.concatenate(lengths), tuple(np.concatenate(ends, axis=1))), shape=(count, count))
    return np.stack([x[inside], y[inside]], axis=1), graph


def _straightened(part: Polygon, chain: list[Point]) -> list[Point]:
    """Return the chain with what can be walked straight made straight."""
    loose = part.buffer(CELL_M / 2)
    kept, at = [chain[0]], 0
    while at < len(chain) - 1:
        ahead = len(chain) - 1
        while ahead > at + 1 and not loose.covers(LineString([chain[at], chain[ahead]])):
            ahead = at + (ahead - at) // 2 if ahead - at > 8 else ahead - 1
        kept.append(chain[ahead])
        at = ahead
    return kept
