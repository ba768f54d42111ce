"""The swivel chair: shapes that only it has."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from processing.ground.arrays import Doubles
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.soft import pad, wrinkled
from processing.layout.furniture.solids import (
    Solid,
    curve,
    loft,
    rounded_rectangle,
    signed_volume_m3,
    solid,
    tube,
    turned_piece,
)


def swivel_chair(b: Bench, role: str) -> None:
    """Build a swivel chair: five spokes on castors, a gas lift, a padded seat and back, arm rests."""
    w, d, h = b.size
    x, y = w / 2, d / 2
    cloth, black = b.style.material(role), b.style.material("nylon")
    seat = min(0.47, 0.5 * h)
    r = min(x, y) / max(abs(math.cos(math.radians(18))), 0.9)
    _star(b, r)
    sleeve = [(0, 0.07), (0.032, 0.07), (0.030, 0.16), (0.026, 0.165), (0.026, seat - 0.18), (0, seat - 0.18)]
    b.add(turned_piece(sleeve, 20), black)
    b.add(
        turned_piece([(0, 0.16), (0.015, 0.16), (0.015, seat - 0.075), (0, seat - 0.075)], 16),
        b.style.material("metal"),
    )
    b.block((-0.09, -0.11, seat - 0.095), (0.09, 0.11, seat - 0.055), black, bevel_m=0.012, steps=2)
    sx, front = 0.43 * w, 0.86 * y
    cushion = pad((-sx, -0.62 * y, seat - 0.06), (sx, front, seat + 0.015), 0.034, (0.012, 0.012, 0.014), inner=10)
    b.add(wrinkled(_waterfall(cushion, front), 0.0012, 0.3, 5), cloth)
    _swivel_back(b, seat, h)
    for side in (-1, 1):
        at = side * (x - 0.024)
        line = [
            (side * 0.36 * w, -0.02, seat - 0.07),
            (at, -0.02, seat - 0.04),
            (at, -0.02, seat + 0.08),
            (at, -0.01, seat + 0.185),
        ]
        b.add(tube(curve(line, 5), 0.011, 10), black)
        rest = pad(
            (at - 0.024, -0.36 * y - 0.03, seat + 0.18), (at + 0.024, 0.44 * y, seat + 0.212), 0.014, 0.003, inner=4
        )
        b.add(rest, black)


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
        b.add(loft(np.stack(spoke)).turned("z", a), b.style.material("nylon"))
        reach = r - 0.032
        for side in (-1, 1):
            wheel = turned_piece([(0, 0), (0.022, 0), (0.027, 0.004), (0.027, 0.013), (0.022, 0.017), (0, 0.017)], 20)
            wheel = wheel.turned("x", math.pi / 2).moved(0, 0.0085 + side * 0.0125, 0.027)
            b.add(
                wheel.turned("z", a + 0.6 * k).moved(reach * math.cos(a), reach * math.sin(a), 0),
                b.style.material("nylon"),
            )
        b.add(turned_piece([(0, 0.02), (0.008, 0.02), (0.008, 0.075), (0, 0.075)], 10)
              .moved(reach * math.cos(a), reach * math.sin(a), 0), b.style.material("nylon"))  # fmt: skip


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
    line = [
        (0, -0.08, seat - 0.075),
        (0, y + 0.07, seat - 0.05),
        (0, y + 0.035, seat + 0.10),
        (0, y + 0.04, seat + 0.26),
    ]
    b.add(_swept(curve(line, 5)), b.style.material("nylon"))


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


VERBS: dict[str, Callable[..., None]] = {"swivel": swivel_chair}
