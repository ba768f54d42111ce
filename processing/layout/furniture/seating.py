"""Seats: the sofa, the armchair with a wooden frame, the dining chair and the desk chair."""

from __future__ import annotations

import math

import numpy as np

from processing.ground.arrays import Doubles
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Material
from processing.layout.furniture.soft import cushion, pad, pillow, wrinkled
from processing.layout.furniture.solids import (
    Solid,
    box,
    curve,
    leg,
    loft,
    rounded_rectangle,
    signed_volume_m3,
    solid,
    tube,
    turned_piece,
)

LEG_M = 0.13
SEAT_M = 0.43


def sofa(b: Bench) -> None:
    """Build a sofa: base, arms, back, a seat and a back cushion a place, two scatter cushions."""
    w, d, h = b.size
    arm = float(np.clip(0.09 * w, 0.11, 0.18))
    arm_top = min(0.60, 0.76 * h)
    leg = min(LEG_M, 0.18 * h)
    base_top = min(SEAT_M, 0.55 * h) - 0.15
    x, y = w / 2, d / 2
    cloth = b.style.fabric
    b.add(pad((-x + 0.02, -y + 0.03, leg), (x - 0.02, y - 0.03, base_top), 0.02, 0.004, inner=4), cloth)
    for side in (-1, 1):
        lo, hi = sorted((side * x, side * (x - arm)))
        one = pad((lo, -y + 0.01, leg - 0.01), (hi, y, arm_top), 0.045, (0.008, 0.008, 0.012), inner=8)
        b.add(wrinkled(one, 0.0015, 0.4, 3 + side), cloth)
    back = pad((-x + 0.5 * arm, -y, leg), (x - 0.5 * arm, -y + 0.16, h - 0.06), 0.05, (0.004, 0.008, 0.010), inner=8)
    b.add(wrinkled(back, 0.002, 0.4, 9), cloth)
    _places(b, x - arm, base_top)
    _scatter(b, x - arm, base_top + 0.14)
    b.legs((x - 0.09, y - 0.12), leg + 0.01, thick_m=0.045, splay=0.015 if b.style.legs != "square" else 0.0)


def _places(b: Bench, half: float, base: float) -> None:
    """Add the seat and back cushions between the arms."""
    _, d, h = b.size
    count = max(1, round(2 * half / 0.72))
    wide = (2 * half - 0.01) / count
    cells = 8 if count < 3 else 5
    deep, thick = d - 0.16 - 0.03, 0.16
    for k in range(count):
        middle = -half + 0.005 + (k + 0.5) * wide
        seat = cushion(wide - 0.004, deep, thick, crown_m=0.028, seed=k, inner=cells).moved(
            middle, -d / 2 + 0.155 + deep / 2, base
        )
        b.add(seat, b.style.fabric)
        tall = h - base - thick + 0.045
        rest = cushion(wide - 0.012, tall, 0.19, crown_m=0.05, seed=20 + k, piping_m=0.0045, inner=cells)
        rest = rest.moved(0, tall / 2, -0.095).turned("x", math.radians(90 + 12))
        low = rest.vertices[:, 2].min()
        b.add(rest.moved(middle, -d / 2 + 0.285, base + thick - 0.035 - low), b.style.fabric)


def _scatter(b: Bench, half: float, seat: float) -> None:
    _, d, _ = b.size
    side = min(0.44, 0.62 * half)
    for k, (sign, material) in enumerate(((-1, b.style.accent), (1, b.style.second_fabric))):
        one = pillow(side, side, 0.16, seed=5 + k).turned("x", math.radians(68)).turned("z", math.radians(-sign * 24))
        low = one.vertices[:, 2].min()
        b.add(one.moved(sign * (half - 0.46 * side), -d / 2 + 0.46, seat + 0.005 - low), material)


def armchair(b: Bench) -> None:
    """Build an easy chair: a wooden frame with shaped arms, a leaning back of bars, loose cushions."""
    w, d, h = b.size
    x, y = w / 2, d / 2
    timber, thick = b.style.timber, 0.042
    arm_top = min(0.60, 0.72 * h)
    lean = math.radians(17)
    for side in (-1, 1):
        at = side * (x - 0.04)
        front, rear = (at, y - 0.10, 0.0), (at, -y + 0.10, 0.0)
        b.add(_leg_between(front, (at, y - 0.13, arm_top - 0.01), thick), timber)
        b.add(_leg_between(rear, (at, -y + 0.14, arm_top - 0.01), thick), timber)
        b.add(_arm(at, -y + 0.04, y, arm_top), timber, grain=1)
        b.block((at - 0.014, -y + 0.13, 0.23), (at + 0.014, y - 0.12, 0.285), timber, bevel_m=0.006)
    for yy, z in ((y - 0.125, 0.235), (-y + 0.16, 0.20)):
        b.block((-x + 0.03, yy - 0.014, z), (x - 0.03, yy + 0.014, z + 0.055), timber, bevel_m=0.006)
    back_low, back_y = 0.24, -y + 0.24
    tall = (h - back_low) / math.cos(lean)
    for s in np.linspace(-0.78, 0.78, 7):
        bar = box((s * (x - 0.1) - 0.011, -0.009, 0), (s * (x - 0.1) + 0.011, 0.009, tall - 0.03), 0.004)
        b.add(bar.turned("x", lean).moved(0, back_y - 0.02, back_low), timber)
    rail = box((-x + 0.075, -0.014, tall - 0.06), (x - 0.075, 0.014, tall), 0.008, 2)
    b.add(rail.turned("x", lean).moved(0, back_y - 0.02, back_low), timber, grain=0)
    wide = w - 0.17
    deep = d - 0.26
    seat = cushion(wide, deep, 0.13, crown_m=0.03, seed=2).turned("x", math.radians(4))
    b.add(seat.moved(0, y - 0.02 - deep / 2, 0.275), b.style.second_fabric)
    rest = cushion(wide - 0.02, tall - 0.20, 0.13, crown_m=0.045, seed=8)
    rest = rest.moved(0, (tall - 0.20) / 2, 0).turned("x", math.pi / 2 + lean)
    b.add(rest.moved(0, back_y + 0.135, back_low + 0.155), b.style.second_fabric)


def _leg_between(foot: tuple[float, float, float], hip: tuple[float, float, float], thick: float) -> Solid:
    f, t = np.array(foot), np.array(hip)
    rows = [f + (t - f) * s + rounded_rectangle(thick * q * 0.8, thick * q, 0.012, steps=3)
            for s, q in ((0, 0.62), (0.012, 0.68), (0.75, 1.0), (1, 0.9))]  # fmt: skip
    return loft(np.stack(rows))


def _arm(x: float, y0: float, y1: float, top: float) -> Solid:
    """Return an arm rest: a board that widens to the front and rises a little."""
    steps = np.linspace(0, 1, 11)
    rows: list[Doubles] = []
    for t in steps:
        wide = 0.052 + 0.026 * math.sin(math.pi * min(t, 0.75) / 1.5)
        ends = min(1.0, math.sin(math.pi * min(max(min(t, 1 - t), 0.0) * 6 + 0.12, 0.5)) + 0.0)
        ring = rounded_rectangle(wide * ends, 0.030 * (0.6 + 0.4 * ends), 0.010, steps=3)
        z = top - 0.015 + 0.02 * (t - 1) + 0.012 * math.sin(math.pi * t)
        rows.append(np.column_stack([ring[:, 0] + x, np.full(len(ring), y0 + (y1 - y0) * t), ring[:, 1] + z])[::-1])
    return loft(np.stack(rows))


BLACK = Material("black nylon", (0.022, 0.022, 0.024), 0.5)
CHAIR_SEAT_M = 0.455


def dining_chair(b: Bench) -> None:
    """Build a dining chair: bent rear posts, a curved back, a padded seat on an apron."""
    w, d, h = b.size
    x, y = w / 2, d / 2
    seat = min(CHAIR_SEAT_M, 0.56 * h)
    timber = b.style.second_timber
    for side in (-1, 1):
        at = side * (x - 0.035)
        line = [(side * (x - 0.018), -y + 0.02, 0.0), (at, -y + 0.065, 0.5 * seat), (at, -y + 0.075, seat),
                (at * 0.98, -y + 0.045, seat + 0.5 * (h - seat)), (at * 0.94, -y + 0.018, h - 0.012)]  # fmt: skip
        b.add(_post(curve(line, 5)), timber)
        b.add(
            leg((side * (x - 0.017), y - 0.02, 0.0), (side * (x - 0.032), y - 0.05, seat - 0.02), 0.012, 0.021), timber
        )
        rail = side * (x - 0.032)
        b.block((rail - 0.009, -y + 0.08, seat - 0.085), (rail + 0.009, y - 0.055, seat - 0.03), timber, grain=1)
    for yy in (-y + 0.075, y - 0.05):
        b.block((-x + 0.035, yy - 0.009, seat - 0.085), (x - 0.035, yy + 0.009, seat - 0.03), timber, grain=0)
    b.add(_seat(w, d, seat), b.style.fabric)
    _back(b, x * 0.92, -y, seat, h)


def _post(line: Doubles) -> Solid:
    """Return a post of rounded square section along a line that rises."""
    t = np.linspace(0, 1, len(line))
    scale = np.interp(t, (0, 0.02, 0.45, 1.0), (0.62, 0.70, 1.0, 0.66))
    ring = rounded_rectangle(0.036, 0.040, 0.014, steps=2)
    return loft(np.stack([p + ring * s for p, s in zip(line, scale, strict=True)]))


def _seat(w: float, d: float, top: float) -> Solid:
    """Return a padded seat that narrows to the back."""
    pad_ = pad((-w / 2, -d / 2 + 0.05, top - 0.045), (w / 2, d / 2 - 0.002, top + 0.012), 0.022, (0.004, 0.006, 0.012))
    shape = pad_.vertices.copy()
    shape[:, 0] *= np.interp(shape[:, 1], (-d / 2 + 0.05, d / 2), (0.84, 1.0))
    return wrinkled(Solid(shape, pad_.faces, pad_.rest), 0.001, 0.3, 3)


def _back(b: Bench, x: float, y: float, seat: float, h: float) -> None:
    """Add the curved back: one broad board, bars below it where the style has slats."""
    tall = 0.42 * (h - seat) if b.style.head != "slats" else 0.22 * (h - seat)
    cloth = b.style.head == "padded"
    b.add(
        _bent_board(x, y + 0.012, h - tall, h, 0.030 if cloth else 0.017),
        b.style.fabric if cloth else b.style.timber,
        grain=0,
    )
    if b.style.head == "slats":
        for k in range(1, 3):
            z = h - tall - k * 0.24 * (h - seat)
            b.add(_bent_board(x * 0.97, y + 0.012 + 0.014 * k, z, z + 0.036, 0.013), b.style.timber, grain=0)
    elif b.style.head == "panel":
        for s in (-0.45, 0.0, 0.45):
            b.rod([(s * x, y + 0.062, seat - 0.03), (s * x, y + 0.045, h - tall + 0.01)], 0.008, b.style.timber)


def _bent_board(x: float, y: float, z0: float, z1: float, thick: float) -> Solid:
    """Return a board across that bends back in its middle, its edges rounded."""
    rows = []
    for t in np.linspace(-1, 1, 15):
        ring = rounded_rectangle(thick, z1 - z0, 0.45 * thick, steps=3)
        scale = 1.0 if abs(t) < 0.99 else 0.75
        deep = 0.030 * (t * t)
        rows.append(np.column_stack([
            np.full(len(ring), x * t), y + thick / 2 + deep + ring[:, 0] * scale, (z0 + z1) / 2 + ring[:, 1] * scale,
        ]))  # fmt: skip
    return loft(np.stack(rows))


def desk_chair(b: Bench) -> None:
    """Build a swivel chair: five spokes on castors, a gas lift, a padded seat and back, arm rests."""
    w, d, h = b.size
    x, y = w / 2, d / 2
    seat = min(0.47, 0.5 * h)
    r = min(x, y) / max(abs(math.cos(math.radians(18))), 0.9)
    _star(b, r)
    sleeve = [(0, 0.07), (0.032, 0.07), (0.030, 0.16), (0.026, 0.165), (0.026, seat - 0.18), (0, seat - 0.18)]
    b.add(turned_piece(sleeve, 20), BLACK)
    b.add(turned_piece([(0, 0.16), (0.015, 0.16), (0.015, seat - 0.075), (0, seat - 0.075)], 16), b.style.metal)
    b.block((-0.09, -0.11, seat - 0.095), (0.09, 0.11, seat - 0.055), BLACK, bevel_m=0.012, steps=2)
    sx, front = 0.43 * w, 0.86 * y
    cushion = pad((-sx, -0.62 * y, seat - 0.06), (sx, front, seat + 0.015), 0.034, (0.012, 0.012, 0.014), inner=10)
    b.add(wrinkled(_waterfall(cushion, front), 0.0012, 0.3, 5), b.style.fabric)
    _swivel_back(b, seat, h)
    for side in (-1, 1):
        at = side * (x - 0.024)
        line = [
            (side * 0.36 * w, -0.02, seat - 0.07),
            (at, -0.02, seat - 0.04),
            (at, -0.02, seat + 0.08),
            (at, -0.01, seat + 0.185),
        ]
        b.add(tube(curve(line, 5), 0.011, 10), BLACK)
        rest = pad(
            (at - 0.024, -0.36 * y - 0.03, seat + 0.18), (at + 0.024, 0.44 * y, seat + 0.212), 0.014, 0.003, inner=4
        )
        b.add(rest, BLACK)


def _waterfall(body: Solid, front: float) -> Solid:
    """Return a seat whose front edge falls off and whose sides rise a little."""
    v = body.vertices.copy()
    v[:, 2] -= 0.03 * np.clip((v[:, 1] - 0.4 * front) / (0.6 * front), 0, 1) ** 2
    v[:, 2] += 0.012 * (v[:, 0] / np.abs(v[:, 0]).max()) ** 2
    return Solid(v, body.faces, body.rest)


def _star(b: Bench, r: float) -> None:
    for k in range(5):
        a = math.radians(90 + 72 * k)
        spoke = []
        for t in np.linspace(0, 1, 6):
            ring = rounded_rectangle(0.05 - 0.024 * t, 0.036 - 0.012 * t, 0.010, steps=2)
            out = 0.02 + (r - 0.055) * t
            spoke.append(np.column_stack([np.full(len(ring), out), ring[:, 0], 0.098 - 0.028 * t * t + ring[:, 1]]))
        b.add(loft(np.stack(spoke)).turned("z", a), BLACK)
        reach = r - 0.032
        for side in (-1, 1):
            wheel = turned_piece([(0, 0), (0.022, 0), (0.027, 0.004), (0.027, 0.013), (0.022, 0.017), (0, 0.017)], 20)
            wheel = wheel.turned("x", math.pi / 2).moved(0, 0.0085 + side * 0.0125, 0.027)
            b.add(wheel.turned("z", a + 0.6 * k).moved(reach * math.cos(a), reach * math.sin(a), 0), BLACK)
        b.add(turned_piece([(0, 0.02), (0.008, 0.02), (0.008, 0.075), (0, 0.075)], 10)
              .moved(reach * math.cos(a), reach * math.sin(a), 0), BLACK)  # fmt: skip


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
    b.add(Solid(v, shell.faces, shell.rest), b.style.fabric)
    line = [
        (0, -0.08, seat - 0.075),
        (0, y + 0.07, seat - 0.05),
        (0, y + 0.035, seat + 0.10),
        (0, y + 0.04, seat + 0.26),
    ]
    b.add(_swept(curve(line, 5)), BLACK)


def _swept(line: Doubles) -> Solid:
    """Return a flat bar along a line in the plane x = 0."""
    rows = []
    tangent = np.gradient(line, axis=0)
    for p, t in zip(line, tangent / np.linalg.norm(tangent, axis=1, keepdims=True), strict=True):
        ring = rounded_rectangle(0.055, 0.020, 0.007, steps=2)
        across, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, t[2], -t[1]])
        rows.append(p + ring[:, :1] * across + ring[:, 1:2] * up)
    return _outward(loft(np.stack(rows)))


def _outward(body: Solid) -> Solid:
    return body if signed_volume_m3(body.vertices, body.faces) > 0 else solid(body.vertices, body.faces[:, ::-1])
