"""What is fixed to walls and ceiling, as meshes: lamps, radiators, sockets, curtains and blinds."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mocks.rooms.model import Finish, Fixture, Material, Part, Plan, Role
from mocks.rooms.shell.surfaces import on_wall, part_of, repeated
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles
from processing.ground.mesh import Mesh, box, grid_faces, merge, moved, turned
from processing.ground.shapes import ball, cylinder, lathe, rounded_box, sheet, tube

OPAL = Material("opal glass", (0.82, 0.82, 0.8), roughness=0.2)
SHADE = Material("lamp shade", (0.74, 0.71, 0.65))
ENAMELS = tuple(
    Material("enamel", rgb, roughness=0.35) for rgb in ((0.035, 0.065, 0.052), (0.55, 0.33, 0.07), (0.045, 0.045, 0.05))
)
"""Of pendants' cones outside (chosen: green, ochre, graphite); inside they are as white as a shade."""
WARM_RGB: Vector = (1.846, 0.826, 0.233)
"""Light of an incandescent lamp (CIE illuminant A) in linear Rec. 709 at luminance 1."""
NEUTRAL_RGB: Vector = (1.414, 0.924, 0.533)  # light of 4000 K, likewise
LUMINANCE_CD_M2 = {
    "dome lamp": (3500.0, 7000.0),
    "disc lamp": (3000.0, 6500.0),
    "pendant lamp": (2000.0, 4000.0),
    "spot": (15000.0, 30000.0),
}
BULB_CD_M2 = 8000.0  # of the opal globe within a pendant's shade


def lamp(fixture: Fixture, ceiling_m: float, finish: Finish) -> list[Part]:
    """Return the parts of a ceiling lamp in the room's coordinates; lit parts have an emission."""
    rng = np.random.default_rng([fixture.seed, 21])
    cd_m2 = float(rng.uniform(*LUMINANCE_CD_M2[fixture.kind]))
    warmth = float(rng.uniform(0.4, 1.0))
    tint = np.array(WARM_RGB) * warmth + np.array(NEUTRAL_RGB) * (1.0 - warmth)
    radius = fixture.width_m / 2
    if fixture.kind == "pendant lamp":
        glowing, plain = _pendant(fixture, radius, float(rng.uniform()))
    elif fixture.kind == "spot":
        glowing = [(_disc(radius * 0.72, 0.004, 0.012), OPAL, cd_m2)]
        inner, high = radius * 0.7, 0.01  # of its rim
        rim = [(inner, -0.002), (inner, -high * 0.6), (inner + 0.004, -high), (radius - 0.003, -high), (radius, 0.0)]
        plain = [(lathe(rim), finish.metal)]
    elif fixture.kind == "disc lamp":
        glowing = [(_disc(radius * 0.96, fixture.height_m, fixture.height_m * 0.4), OPAL, cd_m2)]
        plain = [(_disc(radius, fixture.height_m * 0.6, 0.003), finish.lacquer)]
    else:
        # A shallow bowl under the ceiling
        r, height = radius * 0.95, fixture.height_m
        arc = [(r * math.sin(a), -0.02 - (height - 0.02) * math.cos(a)) for a in np.linspace(0.0, math.pi / 2, 12)]
        glowing = [(lathe([*arc, (r, 0.0)], 40), OPAL, cd_m2)]
        plain = [(_disc(radius, 0.03, 0.008), finish.metal)]
    top = (*fixture.centre, ceiling_m)
    parts = [_part(moved(mesh, top), material) for mesh, material in plain]
    for mesh, material, luminance in glowing:
        r, g, b = (float(v) for v in tint * (luminance or cd_m2))
        shown = replace(material, name=f"lit {material.name}", emission_cd_m2=(r, g, b)) if fixture.lit else material
        parts.append(_part(moved(mesh, top), shown))
    if fixture.kind == "pendant lamp":
        drop = fixture.height_m
        rose = cylinder((0.0, 0.0, -0.028), 0.045, 0.029, 0.006)
        cord = tube([(0.0, 0.0, -0.02), (0.0, 0.0, -drop + 0.2)], 0.0035, 8)
        holder = cylinder((0.0, 0.0, -drop + 0.14), 0.019, 0.06, 0.004)
        parts.append(_part(moved(merge([rose, cord, holder]), top), finish.metal))
    return parts


def _part(mesh: Mesh, material: Material) -> Part:
    return part_of(mesh, material, "lamp", "light", Role.FIXTURE)


def _disc(radius: float, height: float, edge: float) -> Mesh:
    """Return a flat round body under the ceiling (z 0) with a rounded lower rim."""
    arc = [(radius - edge + edge * math.sin(a), -height + edge - edge * math.cos(a)) for a in np.linspace(0, 1.571, 5)]
    return lathe([(0.0, -height), *arc, (radius, 0.001)], 40)


def _pendant(
    fixture: Fixture, radius: float, choice: float
) -> tuple[list[tuple[Mesh, Material, float]], list[tuple[Mesh, Material]]]:
    """Return globe, drum or cone: (glowing parts with their luminance, 0 for the drawn one), (others)."""
    low = -fixture.height_m
    if choice < 0.35:
        globe = min(radius * 0.75, 0.17)
        return [(ball((0.0, 0.0, low + globe), globe, 32), OPAL, 0.0)], []
    bulb = (ball((0.0, 0.0, low + 0.11), 0.045), OPAL, BULB_CD_M2)
    high, narrow = (0.22, radius) if choice < 0.7 else (0.2, radius * 0.35)
    wall, top = 0.003, low + high
    outline = [(radius - wall, low), (radius, low), (narrow, top), (narrow - wall, top), (radius - wall, low)]
    if choice < 0.7:
        return [(lathe(outline, 40), SHADE, 0.0), bulb], []
    enamel = ENAMELS[min(int((choice - 0.7) * 10), 2)]
    return [bulb], [(lathe(outline[:4], 40), enamel), (lathe(outline[3:], 40), SHADE)]


# What hangs at windows: curtains on their rods, roller and venetian blinds.

ROD_AWAY_M = 0.075  # chosen: from the wall to the rod's axis
BLIND_AWAY_M = 0.05  # how deep in the reveal a blind hangs
SLAT_M = 0.025  # the common 25 mm venetian blind
SLAT_PITCH_M = 0.0215  # of 25 mm slats
STACK_PITCH_M = 0.0035  # slats drawn up
STACKED_BELOW_M = 0.3  # a venetian blind no longer than this is drawn up


def curtain(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return cloth in folds that widen downwards, gathered at the top, hanging from the rod."""
    rng = np.random.default_rng([fixture.seed, 11])
    pitch = float(rng.uniform(0.065, 0.095))
    folds = max(3, round(fixture.width_m / pitch))
    columns, rows = 10 * folds + 1, 16
    across = np.linspace(0.0, 1.0, columns)
    widths = rng.uniform(0.75, 1.25, folds)
    ends = np.concatenate([[0.0], np.cumsum(widths) / widths.sum()])
    phase = 2 * math.pi * np.interp(across, np.linspace(0, 1, folds + 1), ends * folds)
    second = phase + np.interp(across, np.linspace(0, 1, folds + 1), rng.uniform(-1.2, 1.2, folds + 1))
    down = np.linspace(0.0, 1.0, rows)[:, None]
    turn = phase + (second - phase) * down**1.5
    deep = 0.017 + 0.02 * np.sqrt(down)
    y = ROD_AWAY_M - 0.002 + deep * np.sin(turn) + 0.006 * down * np.sin(0.5 * turn + rng.uniform(0, 6))
    inner = fixture.width_m - 0.02
    x = fixture.start_m + 0.01 + inner * across[None, :] + 0.006 * np.cos(turn) * np.sqrt(down)
    sway = 0.012 * down * np.sin(math.pi * across)[None, :] * float(rng.uniform(-1, 1))
    z = fixture.bottom_m + fixture.height_m * (1.0 - down) + 0.0 * across
    grid = np.stack([x + sway, y, z], axis=-1)
    # Its first normal is to look along +y, into the room.
    into_room = np.cross(grid[1, 0] - grid[0, 0], grid[0, -1] - grid[0, 0])[1] > 0
    cloth = sheet(grid if into_room else grid[:, ::-1], 0.0025)
    return [part_of(cloth, finish.curtain, "curtain", "curtain", Role.FIXTURE)]


def curtain_rod(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return the rod with a finial at each end and its brackets."""
    x0, x1, z = fixture.start_m, fixture.start_m + fixture.width_m, fixture.bottom_m + fixture.height_m / 2
    meshes = [tube([(x0 + 0.02, ROD_AWAY_M, z), (x1 - 0.02, ROD_AWAY_M, z)], 0.0125, 14)]
    meshes += [ball((x, ROD_AWAY_M, z), 0.021) for x in (x0 + 0.02, x1 - 0.02)]
    for x in (x0 + 0.05, x1 - 0.05):
        meshes.append(tube([(x, 0.0, z), (x, ROD_AWAY_M, z)], 0.007))
        meshes.append(turned(cylinder((x, 0.0, z), 0.022, 0.006, 0.002), (1.0, 0.0, 0.0), -math.pi / 2, (x, 0.0, z)))
    return [part_of(meshes, finish.metal, "curtain", "curtain", Role.FIXTURE)]


def roller_blind(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return the roll under the head of the window, its cloth and the bar at the end."""
    x0, x1 = fixture.start_m + 0.008, fixture.start_m + fixture.width_m - 0.008
    top, bottom, y = fixture.bottom_m + fixture.height_m, fixture.bottom_m, -BLIND_AWAY_M
    roll = tube([(x0, y, top - 0.024), (x1, y, top - 0.024)], 0.022, 18)
    cloth = box((x0 + 0.01, y + 0.0205, bottom), (x1 - 0.01, y + 0.022, top - 0.024))
    bar = rounded_box((x0 + 0.008, y + 0.014, bottom - 0.002), (x1 - 0.008, y + 0.028, bottom + 0.022), 0.005, 2)
    ends = [box((x - 0.006, y - 0.025, top - 0.05), (x + 0.006, y + 0.025, top)) for x in (x0, x1)]
    return [
        part_of([roll, cloth, bar], finish.curtain, "blind", "blind", Role.FIXTURE),
        part_of(ends, finish.metal, "blind", "blind", Role.FIXTURE),
    ]


def venetian_blind(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return head rail, slats (tilted, or stacked where the blind is drawn up), cords and bottom rail."""
    rng = np.random.default_rng([fixture.seed, 12])
    x0, x1 = fixture.start_m + 0.006, fixture.start_m + fixture.width_m - 0.006
    top, bottom, y = fixture.bottom_m + fixture.height_m, fixture.bottom_m, -BLIND_AWAY_M
    tilt = math.radians(float(rng.uniform(10.0, 55.0)))
    stacked = fixture.height_m < STACKED_BELOW_M
    pitch = STACK_PITCH_M if stacked else SLAT_PITCH_M
    rails = [
        rounded_box((x0, y - 0.014, top - 0.03), (x1, y + 0.014, top), 0.002),
        rounded_box((x0, y - 0.012, bottom), (x1, y + 0.012, bottom + 0.012), 0.004),
    ]
    places = np.arange(bottom + 0.012 + pitch, top - 0.03 - SLAT_M / 3, pitch)
    moves = np.stack([np.zeros_like(places), np.zeros_like(places), places], axis=1)
    flat = box((x0 + 0.004, y - SLAT_M / 2, -0.0004), (x1 - 0.004, y + SLAT_M / 2, 0.0004))
    slat = turned(flat, (1.0, 0.0, 0.0), 0.0 if stacked else tilt, (x0 + 0.004, y, 0.0))
    slats = [repeated(slat, moves)] if len(places) else []
    cords = [tube([(x, y, bottom), (x, y, top - 0.02)], 0.001, 6) for x in (x0 + 0.12, x1 - 0.12)]
    return [part_of([*rails, *slats, *cords], finish.window_frame, "blind", "blind", Role.FIXTURE)]


PLASTIC = Material("white plastic", (0.78, 0.78, 0.75), roughness=0.25)
DARK = Material("dark plastic", (0.03, 0.03, 0.03), roughness=0.4)
MODULE_M = 0.081  # width of one socket or switch
STANDOFF_M = 0.025  # air between a radiator and its wall


def fixture_parts(plan: Plan, finish: Finish) -> list[Part]:
    """Return the parts of all fixtures."""
    makers: dict[str, Callable[[Fixture, Finish], list[Part]]] = {
        "panel radiator": _panel_radiator,
        "column radiator": _column_radiator,
        "socket": _sockets,
        "switch": _switch,
        "thermostat": _thermostat,
        "curtain": curtain,
        "curtain rod": curtain_rod,
        "roller blind": roller_blind,
        "venetian blind": venetian_blind,
    }
    parts: list[Part] = []
    for fixture in plan.fixtures:
        if fixture.wall < 0:
            parts += lamp(fixture, plan.height_m, finish)
        else:
            parts += on_wall(plan, fixture.wall, makers[fixture.kind](fixture, finish))
    return parts


def _radiator(meshes: list[Mesh], material: Material) -> Part:
    return part_of(meshes, material, "radiator", "radiator", Role.FIXTURE)


def _panel_radiator(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return a steel panel with upright grooves, side covers, a grille on top, a valve and its pipes."""
    x0, x1, z0, z1 = _bounds(fixture)
    back, front = STANDOFF_M, fixture.depth_m
    side, inset = 0.004, 0.18 * (x1 - x0)
    places = (x0 + inset, x1 - inset)
    brackets = [box((x - 0.015, 0.0, z0 + 0.05), (x + 0.015, STANDOFF_M, z1 - 0.05)) for x in places]
    meshes = [
        _grooved(x0 + side, x1 - side, z0, z1 - 0.012, front),
        box((x0 + side, back, z0), (x1 - side, back + 0.012, z1 - 0.012)),
        rounded_box((x0, back, z0 + 0.01), (x0 + side, front, z1), 0.002),
        rounded_box((x1 - side, back, z0 + 0.01), (x1, front, z1), 0.002),
        *_grille(x0 + side, x1 - side, back, front, z1),
        *brackets,
    ]
    return [_radiator(meshes, finish.radiator), *_valve(fixture, finish, x1)]


def _grooved(x0: float, x1: float, z0: float, z1: float, front: float) -> Mesh:
    """Return the front panel: a sheet pressed in upright grooves, flat at its top and bottom edges."""
    pitch, deep = 0.0333, 0.011
    count = max(2, round((x1 - x0) / pitch))
    shape = np.array([(0.0, 0.0), (0.22, 0.0), (0.36, 1.0), (0.64, 1.0), (0.78, 0.0)])
    across = np.concatenate([np.stack([k + shape[:, 0], shape[:, 1]], axis=1) for k in range(count)] + [[(count, 0.0)]])
    x = x0 + across[:, 0] * (x1 - x0) / count
    rows = np.array([z0, z0 + 0.03, z0 + 0.05, z1 - 0.05, z1 - 0.03, z1])
    fade = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    y = np.where(fade[None, :] > 0, front - 0.002 - deep * across[:, 1:], front - 0.002 - 0.5 * deep)
    grid = np.stack([np.broadcast_to(x[:, None], y.shape), y, np.broadcast_to(rows[None, :], y.shape)], axis=-1)
    slope_x, slope_z = np.gradient(grid, axis=0), np.gradient(grid, axis=1)
    normal = np.cross(slope_z, slope_x)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    faces = np.ascontiguousarray(grid_faces(*y.shape)[:, ::-1])
    vertices = grid.reshape(-1, 3)
    return Mesh(vertices, normal.reshape(-1, 3), np.ascontiguousarray(vertices[:, [0, 2]]), faces)


def _grille(x0: float, x1: float, back: float, front: float, top: float) -> list[Mesh]:
    """Return the rim and the bars of the cover, between which one looks into the dark."""
    rim, bar = 0.012, 0.0045
    bars = [
        rounded_box((x0, back, top - 0.014), (x1, back + rim, top), 0.002),
        rounded_box((x0, front - rim, top - 0.014), (x1, front, top), 0.002),
    ]
    one = box((-bar / 2, back + rim, top - 0.01), (bar / 2, front - rim, top - 0.002))
    return [*bars, repeated(one, _along(np.linspace(x0 + bar, x1 - bar, max(4, round((x1 - x0) / 0.016)))))]


def _along(places: Doubles) -> Doubles:
    """Return moves along the wall."""
    return np.stack([places, np.zeros_like(places), np.zeros_like(places)], axis=1)


def _valve(fixture: Fixture, finish: Finish, end: float) -> list[Part]:
    """Return the thermostatic head at the radiator's lower corner and two pipes into the floor."""
    z, y = fixture.bottom_m + 0.05, (fixture.depth_m + STANDOFF_M) / 2
    start = (end - 0.005, y, z)
    head = turned(cylinder(start, 0.019, 0.075, 0.006), (0.0, 1.0, 0.0), math.pi / 2, start)
    pipes = [tube([(x, y, -0.001), (x, y, z + 0.02)], 0.0075) for x in (end - 0.03, end - 0.08)]
    return [_radiator([head], PLASTIC), _radiator(pipes, finish.radiator)]


def _column_radiator(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return a sectional radiator: rows of upright tubes between round headers, on feet."""
    x0, x1, z0, z1 = _bounds(fixture)
    radius = 0.0125
    rows = np.linspace(STANDOFF_M + radius, fixture.depth_m - radius, 2 if fixture.depth_m < 0.12 else 3)
    middle = float(rows.mean())
    meshes = []
    for y in rows:
        towards = middle + 0.35 * (y - middle)
        path = [(0.0, towards, z0 + 0.018), (0.0, y, z0 + 0.06), (0.0, y, z1 - 0.06), (0.0, towards, z1 - 0.018)]
        meshes.append(tube(path, radius))
    for z in (z0 + 0.025, z1 - 0.025):
        meshes.append(rounded_box((-0.021, STANDOFF_M, z - 0.024), (0.021, fixture.depth_m, z + 0.024), 0.012, 2))
    places = np.linspace(x0 + 0.022, x1 - 0.022, max(2, round((x1 - x0) / 0.046)))
    sections = repeated(merge(meshes), _along(places))
    feet = [cylinder((x, middle, -0.001), 0.012, z0 + 0.03) for x in (x0 + 0.09, x1 - 0.09)]
    return [_radiator([sections, *feet], finish.radiator), *_valve(fixture, finish, x1 - 0.01)]


def _plate(x0: float, x1: float, z0: float, z1: float, depth: float) -> Mesh:
    return rounded_box((x0, -0.001, z0), (x1, depth, z1), 0.005, 2)


def _sockets(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return one plate with a round well and two holes per module."""
    x0, x1, z0, z1 = _bounds(fixture)
    white = [_plate(x0, x1, z0, z1, fixture.depth_m)]
    dark: list[Mesh] = []
    for k in range(max(1, round(fixture.width_m / MODULE_M))):
        x, z, y = x0 + (k + 0.5) * MODULE_M, (z0 + z1) / 2, fixture.depth_m
        for radius, high, meshes in ((0.0225, 0.0006, dark), (0.0212, 0.0012, white)):
            meshes.append(turned(cylinder((x, y, z), radius, high), (1.0, 0.0, 0.0), -math.pi / 2, (x, y, z)))
        for side in (-0.0095, 0.0095):
            at = (x + side, y, z)
            dark.append(turned(cylinder(at, 0.0028, 0.0018, sides=10), (1.0, 0.0, 0.0), -math.pi / 2, at))
    return [part_of(white, PLASTIC, "socket", role=Role.FIXTURE), part_of(dark, DARK, "socket", role=Role.FIXTURE)]


def _switch(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return the plate with its rocker, slightly tilted."""
    x0, x1, z0, z1 = _bounds(fixture)
    m, y = 0.0125, fixture.depth_m
    rocker = rounded_box((x0 + m, y - 0.004, z0 + m), (x1 - m, y + 0.003, z1 - m), 0.002)
    rocker = turned(rocker, (1.0, 0.0, 0.0), math.radians(3.0), ((x0 + x1) / 2, y, (z0 + z1) / 2))
    rim = rounded_box((x0 + m - 0.001, y - 0.004, z0 + m - 0.001), (x1 - m + 0.001, y + 0.0003, z1 - m + 0.001), 0.0002)
    return [
        part_of([_plate(x0, x1, z0, z1, y), rocker], PLASTIC, "switch", role=Role.FIXTURE),
        part_of(rim, DARK, "switch", role=Role.FIXTURE),
    ]


def _thermostat(fixture: Fixture, finish: Finish) -> list[Part]:
    """Return a small box with a dial."""
    x0, x1, z0, z1 = _bounds(fixture)
    at = ((x0 + x1) / 2, fixture.depth_m - 0.006, (z0 + z1) / 2)
    dial = turned(cylinder(at, 0.024, 0.012, 0.003), (1.0, 0.0, 0.0), -math.pi / 2, at)
    case = rounded_box((x0, -0.001, z0), (x1, fixture.depth_m - 0.006, z1), 0.006, 2)
    return [part_of([case, dial], PLASTIC, "switch", role=Role.FIXTURE)]


def _bounds(fixture: Fixture) -> tuple[float, float, float, float]:
    """Return x0, x1, z0, z1 in the wall's frame."""
    end, top = fixture.start_m + fixture.width_m, fixture.bottom_m + fixture.height_m
    return fixture.start_m, end, fixture.bottom_m, top
