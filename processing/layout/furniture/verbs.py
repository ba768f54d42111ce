"""The verbs of designs: shapes that are made, posed and added to a bench, and whole assemblies."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from processing.ground.arrays import Doubles
from processing.ground.mesh import carried
from processing.layout.furniture import solids
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material, print_picture, rug_pattern
from processing.layout.furniture.soft import cushion, hanging, pad, pillow, sheets, wrinkled
from processing.layout.furniture.solids import Solid, Spot

Span = tuple[float, float]


def _box(x: Span, y: Span, z: Span, bevel: float = 0.003, fine: int = 1) -> Solid:
    return solids.box((x[0], y[0], z[0]), (x[1], y[1], z[1]), bevel, fine)


def _pad(
    x: Span, y: Span, z: Span, edge: float, puff: Any = 0.006, folds: float = 0.0015, inner: int = 6, fine: int = 3
) -> Solid:
    one = pad((x[0], y[0], z[0]), (x[1], y[1], z[1]), edge, puff, inner=inner, steps=fine)
    return wrinkled(one, folds, 0.4, round(1000 * abs(x[0] + 2 * z[0]))) if folds else one


def _cover(size: Span, drop: float, thick: float, seed: int = 4, foot: float = 0.0, begin: float = 0.0) -> Solid:
    cells = (46, 42) if foot else (46, 14)
    return hanging(*size, drop, thick, seed=seed, foot_drop_m=foot, begin_m=begin, cells=cells)


def _rod(path: Sequence[Spot], r: Any, smooth: int = 0, sides: int = 12, ring: int = 0) -> Solid:
    line = solids.curve(path, smooth) if smooth else np.asarray(path, dtype=np.float64)
    shares = np.linspace(0, 1, len(line))
    radii = np.interp(shares, np.linspace(0, 1, len(r)), r).tolist() if isinstance(r, tuple) else r
    return solids.tube(line, radii, sides, closed=bool(ring))


def sweep(
    path: Sequence[Spot],
    section: Span,
    side: Spot = (1.0, 0.0, 0.0),
    scale: Any = 1.0,
    smooth: int = 5,
    corner: float = 0.45,
) -> Solid:
    """Return a bar of rounded rectangular section along a smooth line; `side` is where the section's width points.

    `corner`: its rounding as a share of its thinner side; `scale`: of the section, along the line.
    """
    line = solids.curve(path, smooth)
    tangents = np.gradient(line, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    frames = carried(tangents, np.cross(tangents[0], np.asarray(side, dtype=np.float64)))
    ring = solids.rounded_rectangle(section[1], section[0], corner * min(section), steps=3)[:, :2]
    if isinstance(scale, tuple | list):
        scale = np.interp(np.linspace(0, 1, len(line)), np.linspace(0, 1, len(scale)), scale)
    rows = line[:, None, :] + np.broadcast_to(scale, len(line))[:, None, None] * (ring @ frames)
    return _outward(solids.loft(rows))


def _outward(body: Solid) -> Solid:
    volume_m3 = solids.signed_volume_m3(body.vertices, body.faces)
    return body if volume_m3 > 0 else solids.solid(body.vertices, body.faces[:, ::-1])


def _band(profile: Sequence[Span], sides: int = 48) -> Solid:
    """Return the ring of a closed profile of (radius, height), given counter-clockwise with the axis to its left."""
    return solids.closed_band(np.stack([solids.circle(r, sides, z) for r, z in profile]))


def _leaf(
    size: Span, droop: float = 0.3, fold: float = 0.22, blunt: float = 0.75, cells: tuple[int, int] = (7, 9)
) -> Solid:
    """Return a leaf along +y: oval, folded along its midrib, drooping to its tip, 1 mm thick."""
    long, wide = size
    u, t = np.meshgrid(*(np.linspace(a, 1, n) for a, n in zip((-1, 0), cells, strict=True)), indexing="ij")
    x = u * wide / 2 * np.sin(math.pi * t**0.82) ** blunt
    z = fold * np.abs(x) * (1 - 0.5 * t) - droop * long * t**2 * 0.55 + 0.012 * long * np.sin(9 * t) * np.abs(u)
    thick = 0.0012 * (1 - np.abs(u)) * np.sin(math.pi * np.clip(t, 0, 1)) ** 0.5
    return sheets(np.stack([x, long * t, z + thick], -1), np.stack([x, long * t, z - thick], -1))


def _drape(x: Span, z: Span, deep: float, pleats: int, seed: int = 0) -> Solid:
    """Return gathered cloth hanging in x at y = 0: pleats fixed above, wider and less even below."""
    rng = np.random.default_rng(seed)
    s, t = np.meshgrid(np.linspace(0, 1, 12 * pleats + 1), np.linspace(0, 1, 11), indexing="ij")
    wander = sum(rng.normal(0, 0.10) * np.sin((k + 1) * 2.1 * s + rng.uniform(0, 6)) for k in range(4))
    wave = 2 * np.pi * (pleats * s + 0.55 * (1 - t) * wander)
    across = x[0] + (x[1] - x[0]) * s + 0.12 * deep * np.sin(2 * wave) * (1 - 0.4 * t)
    y = deep / 2 * np.sin(wave) * (0.62 + 0.38 * (1 - t)) * 0.96
    slope = np.cos(wave)
    thick = 0.0012 + 0.0002 * slope
    across[0], across[-1] = x[0], x[1]
    up = z[0] + (z[1] - z[0]) * t
    return sheets(np.stack([across, y + thick, up], -1), np.stack([across, y - thick, up], -1))


SHAPES: dict[str, Callable[..., Solid]] = {
    "box": _box,
    "pad": _pad,
    "cover": _cover,
    "rod": _rod,
    "sweep": sweep,
    "band": _band,
    "leaf": _leaf,
    "drape": _drape,
    "plate": lambda size, z, corner=0.012, edge=0.006: solids.slab(
        *size, *z, corner_m=corner, edge_m=edge, steps=max(5, round(corner / 0.022))
    ),
    "cushion": lambda size, crown=0.03, piping=0.0045, seed=0, inner=5: cushion(
        *size, crown_m=crown, piping_m=piping, seed=seed, inner=inner
    ),
    "pillow": lambda size, seed=0: pillow(*size, seed=seed),
    "turned": lambda profile, sides=32, stretch=(1.0, 1.0): solids.turned_piece(profile, sides).scaled(
        stretch[0], stretch[1], 1.0
    ),
    "vessel": lambda profile, wall=0.006, sides=28, smooth=0: solids.vessel(
        solids.curve([(r, 0.0, z) for r, z in profile], smooth)[:, ::2].tolist() if smooth else profile, wall, sides
    ),
    "leg": lambda foot, hip, r, sides=14: solids.leg(foot, hip, r[0], r[1], sides),
    "post": lambda foot, hip, side: solids.square_leg(foot, hip, *side),
}


class Pose(NamedTuple):
    """How a shape is put into a piece: turned by degrees about x, y, z in this order, then moved."""

    at: Spot = (0.0, 0.0, 0.0)
    tilt: float = 0.0
    roll: float = 0.0
    turn: float = 0.0
    low: float | None = None
    """Height of its lowest point."""
    grain: int | None = None
    """Axis along which its texture runs; its longest side's where it is not given."""
    soft: int = 0
    """Rounded over wide angles."""
    lumen: float = 0.0
    """What it sends out while switched on."""


def add(bench: Bench, role: str, verb: str, **values: Any) -> None:
    """Make a shape of its measures, pose it and add it."""
    pose = Pose(**{key: values.pop(key) for key in Pose._fields if key in values})
    body = SHAPES[verb](**values)
    for axis, degrees in (("x", pose.tilt), ("y", pose.roll), ("z", pose.turn)):
        body = body.turned(axis, math.radians(degrees)) if degrees else body
    body = body.moved(*pose.at)
    if pose.low is not None:
        body = body.moved(0.0, 0.0, pose.low - float(body.vertices[:, 2].min()))
    material = bench.style.material(role)
    if pose.lumen:
        material = bench.glowing(material, pose.lumen)
    run = int(np.argmax(np.ptp(body.rest, axis=0))) if pose.grain is None else pose.grain
    bench.add(body, material, grain=run, crease_rad=math.radians(80 if pose.soft else 50))


def _block(bench: Bench, role: str, x: Span, y: Span, z: Span, bevel: float = 0.003, grain: int | None = None) -> None:
    low, high = zip(x, y, z, strict=True)
    bench.block(low, high, bench.style.material(role), bevel_m=bevel, grain=grain)


# The swivel chair: shapes that only it has.


def _swivel_chair(b: Bench, role: str) -> None:
    """Build a swivel chair: five spokes on castors, a gas lift, a padded seat and back, arm rests."""
    w, d, h = b.size
    x, y = w / 2, d / 2
    cloth, black = b.style.material(role), b.style.material("nylon")
    seat = min(0.47, 0.5 * h)
    _star(b, min(x, y) / max(abs(math.cos(math.radians(18))), 0.9))
    sleeve = [(0, 0.07), (0.032, 0.07), (0.030, 0.16), (0.026, 0.165), (0.026, seat - 0.18), (0, seat - 0.18)]
    b.add(solids.turned_piece(sleeve, 20), black)
    metal = b.style.material("metal")
    b.add(solids.turned_piece([(0, 0.16), (0.015, 0.16), (0.015, seat - 0.075), (0, seat - 0.075)], 16), metal)
    b.block((-0.09, -0.11, seat - 0.095), (0.09, 0.11, seat - 0.055), black, bevel_m=0.012, steps=2)
    sx, front = 0.43 * w, 0.86 * y
    cushion = pad((-sx, -0.62 * y, seat - 0.06), (sx, front, seat + 0.015), 0.034, (0.012, 0.012, 0.014), inner=10)
    # A seat whose front edge falls off and whose sides rise a little
    v = cushion.vertices.copy()
    v[:, 2] -= 0.03 * np.clip((v[:, 1] - 0.4 * front) / (0.6 * front), 0, 1) ** 2
    v[:, 2] += 0.012 * (v[:, 0] / np.abs(v[:, 0]).max()) ** 2
    b.add(wrinkled(Solid(v, cushion.faces, cushion.rest), 0.0012, 0.3, 5), cloth)
    _swivel_back(b, seat, h)
    for side in (-1, 1):
        at = side * (x - 0.024)
        line = [
            (side * 0.36 * w, -0.02, seat - 0.07),
            (at, -0.02, seat - 0.04),
            (at, -0.02, seat + 0.08),
            (at, -0.01, seat + 0.185),
        ]
        b.add(solids.tube(solids.curve(line, 5), 0.011, 10), black)
        rest = pad(
            (at - 0.024, -0.36 * y - 0.03, seat + 0.18), (at + 0.024, 0.44 * y, seat + 0.212), 0.014, 0.003, inner=4
        )
        b.add(rest, black)


def _star(b: Bench, r: float) -> None:
    nylon, reach = b.style.material("nylon"), r - 0.032
    for k in range(5):
        a = math.radians(90 + 72 * k)
        spoke = []
        for t in np.linspace(0, 1, 6):
            ring = solids.rounded_rectangle(0.05 - 0.024 * t, 0.036 - 0.012 * t, 0.010, steps=2)
            out = 0.02 + (r - 0.055) * t
            spoke.append(np.column_stack([np.full(len(ring), out), ring[:, 0], 0.098 - 0.028 * t * t + ring[:, 1]]))
        b.add(solids.loft(np.stack(spoke)).turned("z", a), nylon)
        at = (reach * math.cos(a), reach * math.sin(a), 0)
        for side in (-1, 1):
            wheel = solids.turned_piece(
                [(0, 0), (0.022, 0), (0.027, 0.004), (0.027, 0.013), (0.022, 0.017), (0, 0.017)], 20
            )
            wheel = wheel.turned("x", math.pi / 2).moved(0, 0.0085 + side * 0.0125, 0.027)
            b.add(wheel.turned("z", a + 0.6 * k).moved(*at), nylon)
        b.add(solids.turned_piece([(0, 0.02), (0.008, 0.02), (0.008, 0.075), (0, 0.075)], 10).moved(*at), nylon)


def _swivel_back(b: Bench, seat: float, h: float) -> None:
    """Add the back: a padded shell that bends around the sitter, on a bent spine."""
    w, d, _ = b.size
    y, low, wide = -d / 2, seat + 0.07, 0.42 * w
    shell = pad((-wide, -0.035, 0), (wide, 0.035, h - low), 0.03, (0.006, 0.012, 0.006), inner=12)
    v = shell.vertices.copy()
    t = v[:, 2] / (h - low)
    v[:, 0] *= 0.90 + 0.14 * np.sin(math.pi * (0.25 + 0.6 * t))
    v[:, 1] += 0.055 * (v[:, 0] / wide) ** 2 - 0.045 * t + 0.035 * np.sin(math.pi * np.clip(t / 0.7, 0, 1))
    v[:, 1] += y + 0.085
    v[:, 2] += low
    b.add(Solid(v, shell.faces, shell.rest), b.style.material("fabric"))
    bar = [(0, -0.08, seat - 0.075), (0, y + 0.07, seat - 0.05), (0, y + 0.035, seat + 0.1), (0, y + 0.04, seat + 0.26)]
    b.add(_swept(solids.curve(bar, 5)), b.style.material("nylon"))


def _swept(line: Doubles) -> Solid:
    """Return a flat bar along a line in the plane x = 0."""
    rows = []
    tangent = np.gradient(line, axis=0)
    for p, t in zip(line, tangent / np.linalg.norm(tangent, axis=1, keepdims=True), strict=True):
        ring = solids.rounded_rectangle(0.055, 0.020, 0.007, steps=2)
        across, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, t[2], -t[1]])
        rows.append(p + ring[:, :1] * across + ring[:, 1:2] * up)
    return _outward(solids.loft(np.stack(rows)))


# Books in shelves and on tables.

BOOKS = 9  # chosen: colours of spines
PLAIN_M2 = 1.8  # larger fronts hold so many books that their spines stay sharp


def books(b: Bench, _: str, x: Span, z: float, tall: float, y: float | None = None, deep: float = 0.25) -> None:
    """Add upright books between two places, their spines to the front at y."""
    at, usual = x[0], float(b.rng.uniform(0.19, 0.25))
    front_y = b.size[1] / 2 - 0.035 if y is None else y
    while at < x[1] - 0.016:
        thick = min(float(b.rng.uniform(0.018, 0.042)), x[1] - at)
        high = float(np.clip(b.rng.normal(usual, 0.022), 0.15, max(tall - 0.03, 0.12)))
        back = float(b.rng.uniform(0, 0.012))
        cover, pages = _book(thick - 0.0015, min(0.72 * high, deep), high, plain=b.size[0] * b.size[2] > PLAIN_M2)
        for body, role in ((cover, f"book{b.rng.integers(BOOKS)}"), (pages, "paper")):
            b.add(body.moved(at + thick / 2, front_y - back, z), b.style.material(role))
        at += thick


def _book(thick: float, deep: float, high: float, *, plain: bool = False) -> tuple[Solid, Solid]:
    """Return cover and pages of an upright book: its spine at y = 0 looking to +y, its foot at z = 0."""
    half, board = thick / 2, min(0.003, 0.2 * thick)
    covers = [
        solids.box((-half, -deep, 0), (-half + board, -board, high), steps=0),
        solids.box((half - board, -deep, 0), (half, -board, high), steps=0),
        solids.box((-half, -2 * board, 0), (half, 0, high), 0.0028, 0 if plain else 1),
    ]
    pages = solids.box((-half + board, -deep + 0.004, 0.004), (half - board, -2 * board, high - 0.004), steps=0)
    return solids.joined(covers), pages


def pile(b: Bench, _: str, at: Spot, wide: float, deep: float, count: int = 3, high: float = 0.0) -> None:
    """Add books that lie on each other; `high`: of the whole pile, else as it comes."""
    z = at[2]
    for k in range(count):
        thick = high / count if high else float(b.rng.uniform(0.018, 0.036))
        less = min(k, 7)  # else a high pile's upper books had no size
        size = (wide * (1 - 0.06 * less), min(deep, 0.72 * wide) * (1 - 0.07 * less))
        turn = float(b.rng.uniform(-0.12, 0.12)) if k else 0.0
        for mesh, role in zip(_book(thick, size[1], size[0]), (f"book{b.rng.integers(BOOKS)}", "paper"), strict=True):
            lying = mesh.moved(0, 0, -size[0] / 2).turned("y", math.pi / 2).moved(0, size[1] / 2, 0).turned("z", turn)
            b.add(lying.moved(at[0], at[1], z + thick / 2), b.style.material(role))
        z += thick


def _printed(bench: Bench, _: str, kind: str, x: Span, z: Span, y: Span, seed: int = 0) -> None:
    """Add a sheet in a frame whose front (+y) shows a print."""
    size = (x[1] - x[0], z[1] - z[0])
    body = _box(x, y, z, 0.0005)
    middle = np.array([(x[0] + x[1]) / 2, (z[0] + z[1]) / 2])
    uv = (body.vertices[body.faces][..., [0, 2]] - middle) * (-1.0, 1.0) / size + 0.5
    picture = print_picture(kind, bench.style.colours, size, seed)
    bench.add(body, Material("print", (1.0, 1.0, 1.0), 0.6, texture=picture), uv=uv)


def _woven(bench: Bench, _: str, kind: str, fringe: float = 0.0) -> None:
    """Add a rug's body with its pattern, and fringes at both ends where there are any."""
    w, d, h = bench.size
    picture = rug_pattern(kind, bench.style.colours, w - 2 * fringe, d)
    body = solids.slab(w - 2 * fringe, d, 0.0, h, corner_m=0.02, edge_m=min(0.004, 0.4 * h), steps=3)
    uv = (body.rest[body.faces][..., :2] + np.array([w / 2 - fringe, d / 2])) / np.array([w - 2 * fringe, d])
    bench.add(body, Material("rug", (1.0, 1.0, 1.0), 0.95, texture=picture), uv=uv)


VERBS: dict[str, Callable[..., None]] = {
    **{name: (lambda bench, role, name=name, **values: add(bench, role, name, **values)) for name in SHAPES},
    "printed": _printed,
    "woven": _woven,
    "block": _block,
    "books": books,
    "pile": pile,
    "swivel": _swivel_chair,
}
