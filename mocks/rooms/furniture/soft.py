"""Beds and seats, rugs, cushions and blankets: what is upholstered or cloth."""

import math

import numpy as np

from mocks.rooms.furniture.build import BLACK_PLASTIC, CORNERS, Build
from mocks.rooms.model import Material
from mocks.worlds.light import Vector
from processing.ground.arrays import Doubles
from processing.ground.mesh import Mesh, moved, turned
from processing.ground.shapes import beam, cylinder, deformed, pad, pillow, rounded_box, sheet, tube


def rug(b: Build) -> None:
    """Build a rug, round with the option ``round``."""
    w, d, h = b.size
    if b.option("round", 0.0):
        b.add(cylinder((0, 0, 0), w / 2, h, 0.004, 64), b.finish.rug)
    else:
        b.add(rounded_box((-w / 2, -d / 2, 0.0), (w / 2, d / 2, h), 0.004), b.finish.rug)


def cushion(b: Build) -> None:
    """Build a cushion that leans back towards +y by the option ``lean`` (radians from upright, pi/2 lying)."""
    w, _, h = b.size
    lean = b.option("lean", 0.35)
    side = min(w, (h - 0.10 * math.sin(lean)) / max(math.cos(lean), 0.25))
    thick = 0.15
    mesh = turned(pillow((w, side, thick)), (1, 0, 0), math.pi / 2 - lean)
    low = float(mesh.vertices[:, 2].min())
    middle = (mesh.vertices[:, 1].min() + mesh.vertices[:, 1].max()) / 2
    cloth = b.pick(b.finish.second_fabric, b.finish.rug, b.finish.curtain, b.finish.bedding)
    b.add(moved(mesh, (0.0, -float(middle), -low)), cloth)


def blanket(b: Build) -> None:
    """Build a blanket folded in three."""
    w, d, h = b.size
    cloth = b.pick(b.finish.second_fabric, b.finish.curtain, b.finish.rug)
    for k in range(3):
        z, inset = h * k / 3, 0.006 * float(b.rng.random())
        low, high = (-w / 2 + inset, -d / 2 + inset, z), (w / 2 - inset, d / 2, z + h / 3)
        b.add(rounded_box(low, high, 0.45 * h / 3, 2), cloth)


SHEET = Material("bed sheet", (0.80, 0.79, 0.76))


def bed(b: Build) -> None:
    """Build a bed, its head at +y; size is the whole bed's, the height the headboard's."""
    w, d, h = b.size
    timber, upholstered = b.timber(), b.item.seed % 3 == 0
    rail_top, board = 0.34, 0.05 if not upholstered else 0.09
    _frame(b, timber, rail_top, board)
    if upholstered:
        b.add(pad((-w / 2, d / 2 - board, 0.02), (w / 2, d / 2, h), 0.03, 0.012), b.finish.second_fabric)
    elif b.item.seed % 3 == 1:
        b.block((-w / 2, d / 2 - board, 0.15), (w / 2, d / 2, h), timber, 0.006)
    else:
        _slatted_head(b, timber, h)
    mattress = (w - 0.15, d - board - 0.12, 0.20)
    low = rail_top - 0.06
    front = -d / 2 + 0.10
    b.add(pad((-mattress[0] / 2, front, low), (mattress[0] / 2, front + mattress[1], low + 0.20), 0.04, 0.006), SHEET)
    top = low + 0.195
    b.add(_duvet(b, mattress[0], front, mattress[1] * float(b.rng.uniform(0.70, 0.78)), top), b.finish.bedding)
    _pillows(b, mattress[0], front + mattress[1], top)


def _frame(b: Build, timber: Material, rail_top: float, board: float) -> None:
    w, d, _ = b.size
    for side in (-1, 1):
        x = side * (w / 2 - 0.015)
        b.block((x - 0.015, -d / 2 + 0.01, 0.17), (x + 0.015, d / 2 - board, rail_top), timber)
        for y in (-d / 2 + 0.04, d / 2 - board - 0.04):
            b.bar((x * 0.97, y, 0.0), (x * 0.97, y, 0.18), 0.05, 0.05, timber)
    b.block((-w / 2, -d / 2, 0.17), (w / 2, -d / 2 + 0.03, rail_top), timber)


def _slatted_head(b: Build, timber: Material, height: float) -> None:
    """Add a headboard of posts, two rails and upright slats."""
    w, d, _ = b.size
    y = d / 2 - 0.025
    for side in (-1, 1):
        b.bar((side * (w / 2 - 0.03), y, 0.0), (side * (w / 2 - 0.03), y, height), 0.05, 0.05, timber)
    for z in (0.5, height - 0.04):
        b.bar((-w / 2 + 0.05, y, z), (w / 2 - 0.05, y, z), 0.03, 0.06, timber)
    for x in np.linspace(-w / 2 + 0.12, w / 2 - 0.12, max(5, int(w / 0.13))):
        b.add(beam((float(x), y, 0.52), (float(x), y, height - 0.06), 0.03, 0.018), timber)


def _duvet(b: Build, mattress_w: float, front: float, length: float, top: float) -> Mesh:
    """Return the duvet: soft folds on top, hanging over both sides and the foot, round at the corners."""
    hang, thick, edge = 0.19, 0.05, 0.03
    half, flat = mattress_w / 2 - edge, length - edge
    slab = rounded_box((-half - hang, -flat - hang, 0.0), (half + hang, 0.0, thick), 0.02, 2, (18, 16, 1))
    waves = [
        (b.rng.normal(0.0, 4.0, 2), float(b.rng.uniform(0, 6.3)), float(b.rng.uniform(0.003, 0.006))) for _ in range(6)
    ]

    def lay(v: Doubles) -> Doubles:
        x, y, z = v.T
        folds = sum((a * np.sin(x * k[0] + y * k[1] + p) for k, p, a in waves), np.zeros(len(v)))
        over_x, over_y = np.maximum(np.abs(x) - half, 0.0), np.maximum(-y - flat, 0.0)
        over, reach = (over_x**6 + over_y**6) ** (1 / 6), np.maximum(np.hypot(over_x, over_y), 1e-9)
        folds = 0.015 * np.tanh(folds / 0.015)
        z = z + np.where(z > thick / 2, (folds + 0.012) * (1 - 0.6 * np.minimum(over / 0.06, 1.0)), 0.0)
        drop, out = _over_edge(over, z, edge)
        ripple = 0.010 * np.sin(15.0 * (y - x) + waves[0][1]) * np.clip(np.abs(over_x - over_y) / 0.15, 0.0, 1.0) ** 2
        out = out + ripple
        px = np.sign(x) * (np.minimum(np.abs(x), half) + out * over_x / reach)
        py = np.maximum(y, -flat) - out * over_y / reach
        return np.stack([px, py + front + length, drop + top], axis=1)

    return deformed(slab, lay)


def _over_edge(over: Doubles, z: Doubles, radius: float) -> tuple[Doubles, Doubles]:
    """Return height and way out of cloth points that lie ``over`` beyond a round edge and ``z`` above the bed."""
    angle = np.minimum(over / radius, math.pi / 2)
    rest = np.maximum(over - radius * math.pi / 2, 0.0)
    reach = radius + z
    return reach * np.cos(angle) - radius - rest, reach * np.sin(angle)


def _pillows(b: Build, mattress_w: float, head: float, top: float) -> None:
    """Add pillows at the head: one for each sleeper, on wide beds a second row leaning."""
    sleepers = 2 if mattress_w > 1.25 else 1
    wide = min(0.72, mattress_w / sleepers - 0.06)
    for k in range(sleepers):
        x = (k - (sleepers - 1) / 2) * (mattress_w / sleepers) + float(b.rng.normal(0, 0.012))
        soft = pillow((wide, 0.46, 0.16))
        lying: Vector = (x, head - 0.26, top + 0.065)
        b.add(moved(turned(soft, (0, 0, 1), float(b.rng.normal(0, 0.05))), lying), SHEET, "pillow")
        if b.item.seed % 2:
            leaning = turned(pillow((wide * 0.8, 0.42, 0.15)), (1, 0, 0), 1.0)
            b.add(
                moved(leaning, (x + float(b.rng.normal(0, 0.02)), head - 0.28, top + 0.27)), b.finish.bedding, "pillow"
            )


SEAT_M = 0.44  # usual height of seats, 0.40 to 0.46 m


def sofa(b: Build) -> None:
    """Build a sofa or armchair: base, arms, and for each seat a cushion and a back cushion."""
    w, d, h = b.size
    design = b.item.seed % 3
    fabric = b.finish.fabric if b.item.kind == "sofa" or b.item.seed % 2 else b.finish.second_fabric
    arm = (0.16, 0.22, 0.11)[design]
    arm_top = (0.60, 0.56, 0.64)[design]
    leg = (0.14, 0.05, 0.17)[design]
    b.add(rounded_box((-w / 2 + 0.01, -d / 2 + 0.03, leg), (w / 2 - 0.01, d / 2 - 0.02, leg + 0.17), 0.02, 2), fabric)
    for side in (-1, 1):
        outer, inner = side * w / 2, side * (w / 2 - arm)
        low, high = sorted((outer, inner))
        b.add(pad((low, -d / 2, leg), (high, d / 2 - 0.04, arm_top), (0.05, 0.03, 0.055)[design], 0.008), fabric)
    b.add(pad((-w / 2 + arm * 0.6, d / 2 - 0.17, leg), (w / 2 - arm * 0.6, d / 2, h - 0.05), 0.06, 0.008), fabric)
    _cushions(b, fabric, arm, leg + 0.165)
    _feet(b, leg, design)


def _cushions(b: Build, fabric: Material, arm: float, base: float) -> None:
    w, d, h = b.size
    inner = w - 2 * arm
    seats = max(1, round(inner / 0.68))
    wide = inner / seats
    for k in range(seats):
        x = -inner / 2 + k * wide
        gap = 0.004
        seat = pad((x + gap, -d / 2 - 0.0, base), (x + wide - gap, d / 2 - 0.17, SEAT_M + 0.03), 0.055, 0.018)
        b.add(seat, fabric)
        top, thick = h - base - 0.15, 0.19
        back = pad((x + gap, -thick / 2, 0.0), (x + wide - gap, thick / 2, top), 0.075, 0.025)
        lean = float(b.rng.normal(0.20, 0.02))
        b.add(moved(turned(back, (1, 0, 0), -lean), (0.0, d / 2 - 0.17 - 0.13, base + 0.145)), fabric)


def _feet(b: Build, height: float, design: int) -> None:
    w, d, _ = b.size
    material = b.pick(b.finish.wood, b.finish.metal) if design != 1 else BLACK_PLASTIC
    for sx, sy in CORNERS:
        x, y = sx * (w / 2 - 0.10), sy * (d / 2 - 0.10)
        b.leg((x + sx * 0.03, y + sy * 0.03, 0.0), (x, y, height + 0.01), 0.014, 0.024, material)


def ottoman(b: Build) -> None:
    """Build an upholstered stool or pouffe."""
    w, d, h = b.size
    if b.item.seed % 2:
        b.add(pad((-w / 2, -d / 2, 0.10), (w / 2, d / 2, h), 0.05, 0.02), b.finish.second_fabric)
        b.legs(0.07, 0.12, 0.035, b.finish.wood)
    else:
        b.add(cylinder((0, 0, 0), w / 2, h, 0.05, 32), b.finish.second_fabric)


def chair(b: Build) -> None:
    """Build a chair; the seed chooses the design: slatted wood, shell on round legs, upholstered."""
    (_slatted, _shell, _upholstered)[int(b.option("design", b.item.seed % 3)) % 3](b)


def _slatted(b: Build) -> None:
    """Build a wooden chair: rear legs that run on into the back, rails and upright slats."""
    w, d, h = b.size
    timber = b.timber()
    x, front, rear, rake = w / 2 - 0.02, -d / 2 + 0.03, d / 2 - 0.09, 0.065
    for side in (-1, 1):
        b.bar((side * x, front, 0), (side * x, front, SEAT_M - 0.01), 0.034, 0.034, timber)
        b.bar((side * x, rear + 0.03, 0), (side * x, rear, SEAT_M), 0.034, 0.034, timber)
        b.bar((side * x, rear, SEAT_M - 0.02), (side * x, rear + rake, h - 0.002), 0.034, 0.034, timber)
        b.bar((side * x, front, SEAT_M - 0.045), (side * x, rear, SEAT_M - 0.045), 0.018, 0.05, timber)
        b.bar((side * x, front, 0.2), (side * x, rear + 0.015, 0.2), 0.016, 0.026, timber)
    for y in (front, rear):
        b.bar((-x, y, SEAT_M - 0.045), (x, y, SEAT_M - 0.045), 0.018, 0.05, timber)
    b.block((-w / 2, -d / 2, SEAT_M - 0.02), (w / 2, rear - 0.018, SEAT_M + 0.005), timber, 0.008)
    top = h - 0.06
    lean = rake / (h - SEAT_M)
    for z, tall in ((top, 0.09), (SEAT_M + 0.12, 0.04)):
        y = rear + lean * (z - SEAT_M)
        b.bar((-x, y, z), (x, y, z), 0.02, tall, timber)
    for k in range(4 + b.item.seed % 2):
        sx = x * (2 * (k + 1) / (5 + b.item.seed % 2) - 1)
        low, high = SEAT_M + 0.12, top
        a, c = (sx, rear + lean * (low - SEAT_M), low), (sx, rear + lean * (high - SEAT_M), high)
        b.add(beam(a, c, 0.028, 0.010), timber)


def _shell(b: Build) -> None:
    """Build a moulded shell on four splayed round legs."""
    w, d, h = b.size
    shell = b.plain("shell", ((0.72, 0.71, 0.68), (0.06, 0.06, 0.065), (0.30, 0.36, 0.36), (0.55, 0.44, 0.16)), 0.4)
    seat = pad((-w / 2 + 0.01, -d / 2 + 0.01, SEAT_M - 0.03), (w / 2 - 0.01, d / 2 - 0.07, SEAT_M), 0.014, 0.002)
    b.add(seat, shell)
    rows, columns = 9, 11
    t, s = np.meshgrid(np.linspace(0, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    narrow = 1 - 0.22 * t**3 * np.abs(s) ** 0.5
    x = s * (w / 2 - 0.01) * narrow
    z = SEAT_M - 0.012 + t * (h - SEAT_M) * (1 - 0.10 * s**4)
    y = d / 2 - 0.095 + 0.065 * t**1.3 - 0.055 * s**2 * (1 - 0.5 * t)
    from_below = np.stack([x, y, z], axis=-1)
    b.add(sheet(from_below.transpose(1, 0, 2), 0.010), shell)
    leg = b.pick(b.finish.wood, b.finish.metal)
    for sx, sy in CORNERS:
        foot, top = (sx * (w / 2 - 0.015), sy * (d / 2 - 0.02), 0.0), (sx * 0.12, sy * 0.13, SEAT_M - 0.03)
        b.leg(foot, top, 0.010, 0.015, leg)
    for sy in (-1, 1):
        b.add(tube([(-0.13, sy * 0.13, SEAT_M - 0.045), (0.13, sy * 0.13, SEAT_M - 0.045)], 0.009, 8), leg)


def _upholstered(b: Build) -> None:
    """Build a padded dining chair on slim tapered legs."""
    w, d, h = b.size
    cloth, leg = b.finish.second_fabric, b.pick(b.finish.wood, b.finish.metal)
    b.add(pad((-w / 2, -d / 2, SEAT_M - 0.07), (w / 2, d / 2 - 0.06, SEAT_M + 0.03), 0.035, 0.012), cloth)
    tall = h - SEAT_M + 0.04
    back = pad((-w / 2 + 0.01, -0.03, 0.0), (w / 2 - 0.01, 0.03, tall - 0.01), 0.028, 0.008)
    b.add(moved(turned(back, (1, 0, 0), -0.13), (0, d / 2 - 0.115, SEAT_M - 0.03)), cloth)
    for sx, sy in CORNERS:
        x, y = sx * (w / 2 - 0.05), sy * (d / 2 - 0.06) - 0.02 * (sy > 0)
        foot = (x + sx * 0.02, y + sy * 0.03, 0.0)
        b.leg(foot, (x, y, SEAT_M - 0.05), 0.010, 0.018, leg)


def swivel_chair(b: Build) -> None:
    """Build an office chair: five-star base with castors, gas spring, padded seat and back, armrests."""
    w, d, h = b.size
    dark = BLACK_PLASTIC
    cloth = b.pick(b.finish.second_fabric, Material("black mesh", (0.04, 0.04, 0.045)))
    reach = min(w, d) / 2 - 0.03
    for k in range(5):
        a = 2 * math.pi * k / 5 + 0.3
        x, y = reach * math.cos(a), reach * math.sin(a)
        b.add(tube([(0, 0, 0.11), (x * 0.95, y * 0.95, 0.075)], (0.024, 0.015), 10), b.pick(dark, b.finish.metal))
        castor = tube([(-0.022, 0, 0), (0.022, 0, 0)], 0.027, 14)
        b.add(moved(turned(castor, (0, 0, 1), a), (x * 0.93, y * 0.93, 0.027)), dark)
    b.add(cylinder((0, 0, 0.07), 0.035, 0.10, 0.006), dark)
    b.add(cylinder((0, 0, 0.15), 0.024, 0.26), b.finish.metal)
    sw, sd = w / 2 - 0.08, d / 2 - 0.08
    b.add(pad((-sw, -sd - 0.02, 0.42), (sw, sd - 0.02, 0.51), 0.04, 0.015), cloth)
    back = pad((-sw + 0.02, -0.03, 0.0), (sw - 0.02, 0.03, h - 0.58), 0.028, 0.01)
    b.add(moved(turned(back, (1, 0, 0), -0.10), (0, sd - 0.005, 0.575)), cloth)
    b.bar((0, 0.05, 0.40), (0, sd + 0.035, 0.42), 0.07, 0.02, dark)
    b.bar((0, sd + 0.035, 0.41), (0, sd + 0.05, 0.70), 0.07, 0.02, dark)
    for side in (-1, 1):
        x = side * (w / 2 - 0.05)
        b.bar((side * sw * 0.6, 0.03, 0.43), (x, 0.03, 0.43), 0.05, 0.02, dark)
        b.bar((x, 0.03, 0.42), (x, 0.03, 0.66), 0.05, 0.02, dark)
        b.add(rounded_box((x - 0.035, -0.12, 0.655), (x + 0.035, 0.13, 0.685), 0.012, 2), dark)
