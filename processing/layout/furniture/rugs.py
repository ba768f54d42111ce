"""The rug: a woven pattern and fringes."""

from __future__ import annotations

from processing.ground.arrays import Bytes

import numpy as np

from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import Colour, Material, srgb_of_linear
from processing.layout.furniture.solids import loft, rounded_rectangle, slab
from processing.layout.furniture.textures import noise

FRINGE_M = 0.05


def rug(b: Bench) -> None:
    """Build a rug with a woven pattern and, where it is long enough, fringes at both ends."""
    w, d, h = b.size
    fringe = FRINGE_M if w > 0.8 else 0.0
    picture = rug_pattern(b.style.rug, w - 2 * fringe, d)
    body = slab(w - 2 * fringe, d, 0.0, h, corner_m=0.02, edge_m=min(0.004, 0.4 * h), steps=3)
    uv = (body.rest[body.faces][..., :2] + np.array([w / 2 - fringe, d / 2])) / np.array([w - 2 * fringe, d])
    b.add(body, Material("rug", (1.0, 1.0, 1.0), 0.95, texture=picture), uv=uv)
    if not fringe:
        return
    yarn = Material("fringe", tuple(0.95 * c for c in b.style.rug[0]), 0.95)  # type: ignore[arg-type]
    count = round(d / 0.018)
    thick = min(0.006, 0.6 * h)
    for side in (-1, 1):
        for k in range(count):
            y = -d / 2 + (k + 0.5) * d / count
            sway, long = b.rng.normal(0, 0.003), fringe * (1.0 if k % 7 == 3 else b.rng.uniform(0.82, 1.0))
            rows = []
            for t, s in ((-0.05, 0.8), (0.12, 0.6), (0.3, 0.8), (1.0, 0.55)):
                ring = rounded_rectangle(0.010 * s, thick * s, 0.002, steps=0)
                x = w / 2 - fringe + long * t
                rows.append(
                    np.column_stack([np.full(len(ring), x), ring[:, 0] + y + sway * t * 3, ring[:, 1] + thick / 2])
                )
            one = loft(np.stack(rows))
            b.add(one if side > 0 else one.mirrored(), yarn)


def rug_pattern(colours: tuple[Colour, Colour, Colour], width_m: float, depth_m: float) -> Bytes:
    """Return a rug's picture: a bordered field of lozenges between lines, in uneven wool."""
    scale = min(400.0, 900.0 / max(width_m, depth_m))
    cols, rows = max(16, round(width_m * scale)), max(16, round(depth_m * scale))
    y, x = np.meshgrid((np.arange(rows) + 0.5) / scale, (np.arange(cols) + 0.5) / scale, indexing="ij")
    wobble = 0.004 * noise((rows, cols), (40, 40), 2)
    edge = np.minimum(np.minimum(x, width_m - x), np.minimum(y, depth_m - y)) + wobble
    nx, ny = max(2, round((width_m - 0.3) / 0.34)), max(2, round((depth_m - 0.3) / 0.34))
    u = (x - 0.15) / max(width_m - 0.3, 0.1) * nx + wobble * 2
    v = (y - 0.15) / max(depth_m - 0.3, 0.1) * ny + wobble * 2
    lozenge = np.abs(u % 1 - 0.5) + np.abs(v % 1 - 0.5)
    ground, figure, line = (np.array(c) for c in colours)
    picture = np.broadcast_to(ground, (rows, cols, 3)).copy()
    inside = edge > 0.15
    picture[inside & (np.abs(lozenge - 0.5) < 0.045)] = line
    picture[inside & (lozenge < 0.20)] = figure
    picture[inside & (lozenge < 0.09)] = ground
    picture[(edge > 0.06) & (edge < 0.115)] = figure
    picture[(np.abs(edge - 0.045) < 0.006) | (np.abs(edge - 0.13) < 0.006)] = line
    wool = 1 + 0.05 * noise((rows, cols), (3, 9), 4) + 0.04 * noise((rows, cols), (60, 60), 5)
    return srgb_of_linear(picture * np.clip(wool, 0.6, 1.4)[..., None])[::-1]
